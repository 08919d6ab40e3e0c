/* Arenas: the compiler's only allocator.
 *
 * Nothing is freed singly. A Session owns three arenas, named at the call: `session` (source text, types,
 * symbols, diagnostics), `module` (AST and IR of the program being compiled) and `scratch` (reset by whoever
 * marked it). Memory comes zeroed and 16-byte aligned. An arena has no failure path of its own: when the budget
 * that it shares with its siblings is spent, or malloc fails, it calls `fail(user)`, which must not return (the session
 * longjmps out of the compilation and reports a limit). Not thread-safe: one session, one thread at a time. */
#ifndef SALTUS_BASE_ARENA_H
#define SALTUS_BASE_ARENA_H

#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct ArenaBudget {
    size_t used, limit;       /* bytes over all arenas that share this budget */
    void (*fail)(void *user); /* never returns */
    bool refused;             /* by the system, and not by the limit: why it fails */
    void *user;
} ArenaBudget;

typedef struct ArenaChunk ArenaChunk;
typedef struct Arena {
    const char *name;
    ArenaBudget *budget;
    ArenaChunk *head;
} Arena;
typedef struct ArenaMark {
    ArenaChunk *head;
    size_t at; /* bytes used of head */
} ArenaMark;

void arena_init(Arena *a, const char *name, ArenaBudget *budget);
void arena_free_all(Arena *a);
void *arena_alloc(Arena *a, size_t bytes);
void *arena_copy(Arena *a, const void *data, size_t bytes);
char *arena_strndup(Arena *a, const char *s, size_t n);
char *arena_printf(Arena *a, const char *fmt, ...) __attribute__((format(printf, 2, 3)));
char *arena_vprintf(Arena *a, const char *fmt, va_list ap) __attribute__((format(printf, 2, 0)));
ArenaMark arena_mark(Arena *a);
void arena_reset(Arena *a, ArenaMark mark); /* frees everything allocated since the mark */

#define ARENA_NEW(a, T) ((T *)arena_alloc((a), sizeof(T)))
#define ARENA_ARRAY(a, T, n) ((T *)arena_alloc((a), sizeof(T) * (size_t)(n)))

/* Growing arrays inside an arena: `Vec(Inst *) v = {0}; vec_push(arena, &v, x);` The old storage stays in the arena. */
#define Vec(T)                                                                                                         \
    struct {                                                                                                           \
        T *data;                                                                                                       \
        uint32_t len, cap;                                                                                             \
    }
#define vec_push(a, v, x)                                                                                              \
    do {                                                                                                               \
        if ((v)->len == (v)->cap) {                                                                                    \
            uint32_t vec_cap_ = (v)->cap ? (v)->cap * 2 : 8;                                                           \
            void *vec_new_ = arena_alloc((a), sizeof(*(v)->data) * vec_cap_);                                          \
            if ((v)->len) __builtin_memcpy(vec_new_, (v)->data, sizeof(*(v)->data) * (v)->len);                        \
            (v)->data = vec_new_;                                                                                      \
            (v)->cap = vec_cap_;                                                                                       \
        }                                                                                                              \
        (v)->data[(v)->len++] = (x);                                                                                   \
    } while (0)

#endif
