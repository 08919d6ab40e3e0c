/* words.def as a table, with signatures made of the compiler's own. */
#include <stdlib.h>
#include <string.h>

#include "cli/lsp/lsp.h"
#include "compiler/front/parse/lex.h"

typedef struct Row {
    WordKind kind;
    int id;
    const char *name, *text, *line; /* text: names of arguments, or the whole signature */
} Row;

static const Row rows[] = {
#define BUILTIN_WORD(id, arguments, line) {WORD_BUILTIN, B_##id, NULL, arguments, line},
#define SPECIAL_WORD(id, signature, line) {WORD_BUILTIN, B_##id, signature, NULL, line},
#define METHOD_WORD(id, arguments, line) {WORD_METHOD, M_##id, NULL, arguments, line},
#define ATTRIBUTE_WORD(name, line) {WORD_ATTRIBUTE, 0, #name, NULL, line},
#define KEYWORD_WORD(id, line) {WORD_KEYWORD, TOK_##id - TOK_IMPORT, NULL, NULL, line},
#define OTHER_WORD(name, written, line) {WORD_OTHER, 0, #name, written, line},
#include "cli/lsp/words.def"
};

/* A letter of builtins.def or methods.def, as people write the type. */
static const char *letter_type(char letter) {
    static const char letters[] = "FNIBfiubvms32wWxy4HSMEPA";
    static const char *const types[] = {"floatN", "T",          "intN",    "boolN",    "float",    "int",
                                        "uint",   "bool",       "floatN",  "floatRxC", "floatNxN", "float3",
                                        "float2", "uint2",      "uint3",   "int2",     "int3",     "float4",
                                        "Hit",    "Silhouette", "MeshHit", "Beam",     "Piece",    "AreaLight"};
    const char *at = strchr(letters, letter);
    return at ? types[at - letters] : "T";
}

static char *signature(const char *name, const char *letters, const char *arguments) {
    char text[512];
    size_t n = (size_t)snprintf(text, sizeof text, "%s %s(", letter_type(letters[0]), name);
    for (const char *l = letters + 1; *l; l++) {
        size_t word = strcspn(arguments, ",");
        n += (size_t)snprintf(text + n, sizeof text - n, "%s%s %.*s", l > letters + 1 ? ", " : "", letter_type(*l),
                              (int)word, arguments);
        arguments += word + strspn(arguments + word, ", ");
    }
    snprintf(text + n, sizeof text - n, ")");
    return cli_need(strdup(text));
}

static const char *object_name(uint32_t object) {
    return object == T_TEXTURE     ? "texture2D"
           : object == T_TEXTURE3D ? "texture3D"
                                   : geometry_types[object - T_GEOMETRY].name;
}

static const char *attribute_written(const char *name) {
    const char *known, *usage;
    for (uint32_t i = 0; (usage = attribute_usage(i, &known)); i++)
        if (!strcmp(known, name)) return usage;
    return NULL;
}

static void fill(Word *w, const Row *r) {
    *w = (Word){.kind = r->kind, .name = r->name, .written = r->text, .line = r->line, .id = r->id};
    if (r->kind == WORD_BUILTIN) {
        w->name = builtin_name((Builtin)r->id);
        w->written = r->text ? signature(w->name, builtin_signature((Builtin)r->id), r->text) : r->name;
    }
    if (r->kind == WORD_METHOD) {
        char full[64];
        const MethodInfo *m = &methods[r->id];
        snprintf(full, sizeof full, "%s.%s", object_name(m->object), m->name);
        w->name = m->name;
        w->written = signature(full, m->signature, r->text);
    }
    if (r->kind == WORD_ATTRIBUTE) w->written = attribute_written(r->name);
    if (r->kind == WORD_KEYWORD) w->name = keyword_name((uint32_t)r->id);
}

static uint32_t fill_types(Word *w) {
    static const char *const made[] = {"Hit", "Silhouette", "MeshHit", "Beam", "Piece", "AreaLight"};
    uint32_t n = 0;
    for (TypeKind k = T_VOID; k <= T_FLOAT; k++) w[n++].name = type_scalar(k)->name;
    for (TypeKind k = T_BOOL; k <= T_FLOAT; k++)
        for (uint32_t c = 2; c <= 4; c++) w[n++].name = type_vector(NULL, k, c)->name;
    for (uint32_t r = 2; r <= 4; r++)
        for (uint32_t c = 2; c <= 4; c++) w[n++].name = type_matrix(NULL, r, c)->name;
    w[n++].name = type_scalar(T_TEXTURE)->name;
    w[n++].name = type_scalar(T_TEXTURE3D)->name;
    for (int k = 0; k < SLT_GEOMETRIES; k++) w[n++].name = geometry_types[k].name;
    for (size_t k = 0; k < sizeof made / sizeof *made; k++) w[n++].name = made[k];
    for (uint32_t i = 0; i < n; i++) w[i].kind = WORD_TYPE;
    return n;
}

const Word *words_all(uint32_t *n) {
    enum { NROWS = sizeof rows / sizeof *rows };
    static Word all[NROWS + 64];
    static uint32_t count;
    if (!count) {
        for (uint32_t i = 0; i < NROWS; i++) fill(&all[i], &rows[i]);
        count = NROWS + fill_types(all + NROWS);
    }
    *n = count;
    return all;
}

const Word *word_find(WordKind kind, const char *name) {
    uint32_t n;
    const Word *all = words_all(&n);
    for (uint32_t i = 0; i < n; i++)
        if (all[i].kind == kind && !strcmp(all[i].name, name)) return &all[i];
    return NULL;
}

const Word *word_of(WordKind kind, int id) {
    uint32_t n;
    const Word *all = words_all(&n);
    for (uint32_t i = 0; i < n; i++)
        if (all[i].kind == kind && all[i].id == id) return &all[i];
    return NULL;
}
