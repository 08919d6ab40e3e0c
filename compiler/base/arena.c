/* Arenas: a list of chunks, newest first; a mark is a chunk and a place in it. */
#include "compiler/base/arena.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct ArenaChunk {
    ArenaChunk *older;
    size_t used, size; /* bytes of data behind this header */
    size_t pad;        /* keeps the data 16-byte aligned */
};

enum { CHUNK_MIN = 1 << 16, CHUNK_MAX = 1 << 20, ALIGN = 16 };

_Static_assert(sizeof(ArenaChunk) % ALIGN == 0, "chunk data must be aligned");

static char *chunk_data(ArenaChunk *c) { return (char *)(c + 1); }

void arena_init(Arena *a, const char *name, ArenaBudget *budget) { *a = (Arena){.name = name, .budget = budget}; }

static void free_chunk(Arena *a, ArenaChunk *c) {
    a->budget->used -= c->size + sizeof *c;
    free(c);
}

void arena_free_all(Arena *a) {
    while (a->head) {
        ArenaChunk *older = a->head->older;
        free_chunk(a, a->head);
        a->head = older;
    }
}

_Noreturn static void fail(Arena *a) {
    a->budget->fail(a->budget->user);
    /* The contract of `fail` is not to return; going on would hand out memory that is not there. */
    __builtin_trap();
}

static void add_chunk(Arena *a, size_t bytes) {
    size_t size = a->head ? a->head->size * 2 : CHUNK_MIN;
    if (size > CHUNK_MAX) size = CHUNK_MAX;
    if (size < bytes) size = bytes;
    ArenaBudget *b = a->budget;
    size_t left = b->limit > b->used ? b->limit - b->used : 0;
    if (left < sizeof(ArenaChunk) || bytes > left - sizeof(ArenaChunk)) fail(a);
    /* Near the end of the budget a chunk shrinks to what is left instead of failing early. */
    if (size > left - sizeof(ArenaChunk)) size = bytes;
    ArenaChunk *c = malloc(sizeof *c + size);
    b->refused = !c;
    if (!c) fail(a);
    *c = (ArenaChunk){.older = a->head, .size = size};
    b->used += sizeof *c + size;
    a->head = c;
}

void *arena_alloc(Arena *a, size_t bytes) {
    if (bytes > SIZE_MAX - ALIGN) fail(a);
    bytes = bytes ? (bytes + ALIGN - 1) & ~(size_t)(ALIGN - 1) : ALIGN;
    if (!a->head || a->head->size - a->head->used < bytes) add_chunk(a, bytes);
    char *p = chunk_data(a->head) + a->head->used;
    a->head->used += bytes;
    return memset(p, 0, bytes);
}

void *arena_copy(Arena *a, const void *data, size_t bytes) {
    void *p = arena_alloc(a, bytes);
    if (bytes) memcpy(p, data, bytes);
    return p;
}

char *arena_strndup(Arena *a, const char *s, size_t n) {
    char *p = arena_alloc(a, n + 1);
    if (n) memcpy(p, s, n);
    return p;
}

char *arena_vprintf(Arena *a, const char *fmt, va_list ap) {
    va_list again;
    if (!fmt) fmt = "";
    va_copy(again, ap);
    int n = vsnprintf(NULL, 0, fmt, ap);
    if (n < 0) n = 0;
    char *p = arena_alloc(a, (size_t)n + 1);
    vsnprintf(p, (size_t)n + 1, fmt, again);
    va_end(again);
    return p;
}

char *arena_printf(Arena *a, const char *fmt, ...) {
    va_list ap;
    va_start(ap, fmt);
    char *p = arena_vprintf(a, fmt, ap);
    va_end(ap);
    return p;
}

ArenaMark arena_mark(Arena *a) { return (ArenaMark){a->head, a->head ? a->head->used : 0}; }

void arena_reset(Arena *a, ArenaMark mark) {
    while (a->head != mark.head) {
        ArenaChunk *older = a->head->older;
        free_chunk(a, a->head);
        a->head = older;
    }
    if (a->head) a->head->used = mark.at;
}
