/* GLSL's words become the language's: types by their names here, qualifiers without a meaning go, words that are
 * reserved here and not in GLSL are names. */
#include "compiler/front/glsl/glsl.h"

#include <string.h>

typedef struct Word {
    const char *glsl, *ours;
} Word;

static const Word types[] = {
    {"vec2", "float2"},         {"vec3", "float3"},     {"vec4", "float4"},
    {"ivec2", "int2"},          {"ivec3", "int3"},      {"ivec4", "int4"},
    {"uvec2", "uint2"},         {"uvec3", "uint3"},     {"uvec4", "uint4"},
    {"bvec2", "bool2"},         {"bvec3", "bool3"},     {"bvec4", "bool4"},
    {"mat2", "float2x2"},       {"mat3", "float3x3"},   {"mat4", "float4x4"},
    {"mat2x2", "float2x2"},     {"mat3x3", "float3x3"}, {"mat4x4", "float4x4"},
    {"mat2x3", "float2x3"},     {"mat2x4", "float2x4"}, {"mat3x2", "float3x2"},
    {"mat3x4", "float3x4"},     {"mat4x2", "float4x2"}, {"mat4x3", "float4x3"},
    {"bool", "bool"},           {"int", "int"},         {"uint", "uint"},
    {"float", "float"},         {"void", "void"},       {"sampler2D", "texture2D"},
    {"sampler3D", "texture3D"},
};
/* Dropped wherever they stand. */
static const char *const qualifiers[] = {"highp",    "mediump",       "lowp",      "flat",   "smooth",
                                         "centroid", "noperspective", "invariant", "precise"};
static const char *const foreign[] = {"samplerCube", "sampler2DArray", "sampler2DShadow", "samplerCubeShadow",
                                      "isampler2D",  "usampler2D",     "sampler1D",       "sampler2DRect",
                                      "isampler3D",  "usampler3D",     "double",          "dvec2",
                                      "dvec3",       "dvec4",          "dmat2",           "dmat3",
                                      "dmat4",       "buffer",         "shared",          "image2D"};

#define COUNT(a) (sizeof(a) / sizeof *(a))

static bool is_in(const char *text, const char *const *list, size_t n) {
    for (size_t i = 0; i < n; i++)
        if (!strcmp(text, list[i])) return true;
    return false;
}

static bool has_text(const Token *t) { return t->kind == TOK_IDENT || t->kind == TOK_TYPE || t->kind >= TOK_IMPORT; }
static bool is(const Token *t, const char *text) { return has_text(t) && !strcmp(t->text, text); }

static void translate(Session *s, Token *t) {
    bool ours = t->kind == TOK_TYPE || t->kind == TOK_IMPORT || t->kind == TOK_PARAM || t->kind == TOK_TYPEDEF ||
                t->kind == TOK_SHADER;
    if (ours) t->kind = TOK_IDENT;
    for (size_t i = 0; i < COUNT(types); i++)
        if (!strcmp(t->text, types[i].glsl)) {
            t->kind = TOK_TYPE;
            t->text = intern(s, types[i].ours, strlen(types[i].ours));
            return;
        }
    if (is_in(t->text, foreign, COUNT(foreign)))
        diag_emit(s, DIAG_glsl_unsupported, t->span,
                  arena_printf(&s->session,
                               "`%s` is not supported: there are sampler2D, sampler3D and single "
                               "precision (--precision f64 computes all in double)",
                               t->text));
}

/* ---- messages */

typedef Vec(char) Text;

static const char *word_here(const char *ours, size_t n) {
    for (size_t i = 0; i < COUNT(types); i++)
        if (strlen(types[i].ours) == n && !strncmp(types[i].ours, ours, n)) return types[i].glsl;
    return glsl_function_behind(ours, n);
}

static bool in_word(char c) {
    return c == '_' || (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
}

/* Does the source have the word itself, as of its own? */
static bool stands_in(const Source *src, const char *word, size_t n) {
    for (const char *at = src->text; (at = strstr(at, word)); at += n)
        if ((at == src->text || !in_word(at[-1])) && !in_word(at[n])) return true;
    return false;
}

const char *glsl_in_words(Session *s, const Source *src, const char *text) {
    Text out = {0};
    for (const char *at = text; *at;) {
        size_t n = 0;
        while (in_word(at[n])) n++;
        const char *word = n ? word_here(at, n) : NULL;
        if (word && stands_in(src, arena_strndup(&s->session, at, n), n)) word = NULL;
        for (size_t i = 0; word && word[i]; i++) vec_push(&s->session, &out, word[i]);
        for (size_t i = 0; !word && i < (n ? n : 1); i++) vec_push(&s->session, &out, at[i]);
        at += n ? n : 1;
    }
    vec_push(&s->session, &out, 0);
    return out.data;
}

static bool is_of_glsl(const Session *s, Span at) { return at.file >= 0 && s->sources[at.file].glsl[0]; }

/* Notes that point into what nobody wrote, the host's declarations or the functions behind GLSL's names, go. */
void glsl_speak(Session *s) {
    for (Diag *d = s->diags; d; d = d->next) {
        if (!is_of_glsl(s, d->span)) continue;
        const Source *src = &s->sources[d->span.file];
        d->text = glsl_in_words(s, src, d->text);
        for (DiagNote **n = &d->notes; *n;) {
            (*n)->text = glsl_in_words(s, src, (*n)->text);
            if ((*n)->span.file >= 0 && !is_of_glsl(s, (*n)->span)) *n = (*n)->next;
            else n = &(*n)->next;
        }
    }
}

/* ---- tokens */

/* `uniform samplerCube sky;` that nothing reads: people leave these standing. */
static uint32_t skip_unread(const TokenVec *v, uint32_t i) {
    const Token *t = v->data;
    uint32_t name = i + 2, uses = 0;
    if (!is(&t[i], "uniform") || t[i + 1].kind != TOK_IDENT || !is_in(t[i + 1].text, foreign, COUNT(foreign)) ||
        t[name].kind != TOK_IDENT || t[name + 1].kind != TOK_SEMICOLON)
        return i;
    for (uint32_t k = 0; k < v->len; k++) uses += t[k].kind == TOK_IDENT && t[k].text == t[name].text;
    return uses == 1 ? name + 2 : i;
}

/* Behind what begins at tokens[i] and is left out; i itself where it stays. */
static uint32_t skipped(const TokenVec *v, uint32_t i) {
    const Token *t = v->data;
    if (!has_text(&t[i])) return i;
    if (is(&t[i], "invariant") && t[i + 1].kind == TOK_IDENT && t[i + 2].kind == TOK_SEMICOLON) return i + 3;
    if (is_in(t[i].text, qualifiers, COUNT(qualifiers))) return i + 1;
    if (is(&t[i], "in") && is(&t[i + 1], "vec4") && is(&t[i + 2], "gl_FragCoord") && t[i + 3].kind == TOK_SEMICOLON)
        return i + 4;
    uint32_t behind = skip_unread(v, i);
    if (behind > i) return behind;
    if (is(&t[i], "precision"))
        while (t[i].kind != TOK_EOF)
            if (t[i++].kind == TOK_SEMICOLON) return i;
    if (is(&t[i], "layout") && t[i + 1].kind == TOK_LPAREN)
        while (t[i].kind != TOK_EOF)
            if (t[i++].kind == TOK_RPAREN) return i;
    return i;
}

void glsl_words(Session *s, TokenVec *tokens, NameMap *words) {
    uint32_t kept = 0;
    for (uint32_t i = 0; i < tokens->len;) {
        uint32_t next = skipped(tokens, i);
        bool fresh = tokens->data[i].first_on_line;
        if (next > i) {
            i = next;
            if (i < tokens->len) tokens->data[i].first_on_line |= fresh;
            continue;
        }
        Token t = tokens->data[i++];
        if (has_text(&t)) translate(s, &t), map_put(&s->module, words, t.text, words);
        tokens->data[kept++] = t;
    }
    tokens->len = kept;
}
