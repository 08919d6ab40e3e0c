/* Declarations within declarations are taken apart, in the tokens: `const struct S { … } a;` becomes `struct S { … };
 * const S a;`, a struct within a function stands before it, and the members of a block of uniforms become uniforms,
 * `block.member` being `member`. */
#include "compiler/front/glsl/glsl.h"

#include <string.h>

typedef struct Flat {
    Session *s;
    const Token *t;
    uint32_t n;
    TokenVec out;
    uint32_t start; /* in out: where the declaration at file scope began */
    uint32_t depth; /* of braces */
    uint32_t nunnamed;
    NameMap instances; /* of blocks */
} Flat;

static bool is_word(const Token *t, const char *text) { return t->kind == TOK_IDENT && !strcmp(t->text, text); }

/* The `}` of the `{` at i, or what ends the file. */
static uint32_t closing(const Flat *f, uint32_t i) {
    for (uint32_t depth = 0; i + 1 < f->n; i++)
        if (f->t[i].kind == TOK_LBRACE) depth++;
        else if (f->t[i].kind == TOK_RBRACE && --depth == 0) break;
    return i;
}

static void put(Flat *f, Token t) { vec_push(&f->s->module, &f->out, t); }

/* Opens a gap of n tokens at the start of the declaration at file scope. */
static uint32_t insert_before(Flat *f, uint32_t n) {
    uint32_t at = f->start;
    for (uint32_t i = 0; i < n; i++) put(f, (Token){0});
    memmove(&f->out.data[at + n], &f->out.data[at], sizeof(Token) * (f->out.len - n - at));
    f->start += n;
    return at;
}

/* At `struct`; behind it, or i where it is nothing that has to be taken apart. */
static uint32_t structure(Flat *f, uint32_t i) {
    uint32_t open = i + 1 + (f->t[i + 1].kind == TOK_IDENT);
    if (f->t[open].kind != TOK_LBRACE) return i;
    uint32_t end = closing(f, open);
    if (f->t[end].kind != TOK_RBRACE || (f->depth == 0 && f->t[end + 1].kind == TOK_SEMICOLON)) return i;
    Token name = f->t[i + 1], qualifiers[4];
    uint32_t nqualifiers = 0;
    if (name.kind != TOK_IDENT) {
        name = (Token){.kind = TOK_IDENT, .span = f->t[i].span};
        name.text = arena_printf(&f->s->session, "gl_struct_%u", f->nunnamed++);
        name.text = intern(f->s, name.text, strlen(name.text));
    }
    while (f->out.len > f->start && nqualifiers < 4) {
        const Token *last = &f->out.data[f->out.len - 1];
        if (last->kind != TOK_CONST && !is_word(last, "uniform")) break;
        qualifiers[nqualifiers++] = *last;
        f->out.len--;
    }
    uint32_t at = insert_before(f, end - open + 4);
    Token *to = &f->out.data[at];
    *to++ = f->t[i];
    *to++ = name;
    for (uint32_t k = open; k <= end; k++) *to++ = f->t[k];
    *to = (Token){.kind = TOK_SEMICOLON, .span = f->t[end].span};
    if (f->t[end + 1].kind == TOK_SEMICOLON) return end + 1; /* an empty statement is left */
    while (nqualifiers) put(f, qualifiers[--nqualifiers]);
    name.first_on_line = false;
    put(f, name);
    return end + 1;
}

/* At the name of a block of uniforms, behind `uniform`. */
static uint32_t block(Flat *f, uint32_t i) {
    uint32_t end = closing(f, i + 1);
    Token word = f->out.data[--f->out.len];
    bool begins = true;
    for (uint32_t k = i + 2; k < end; k++) {
        if (begins) put(f, word);
        put(f, f->t[k]);
        begins = f->t[k].kind == TOK_SEMICOLON;
    }
    if (f->t[end].kind != TOK_RBRACE) return end;
    if (f->t[end + 1].kind == TOK_IDENT) map_put(&f->s->module, &f->instances, f->t[++end].text, f);
    return f->t[end + 1].kind == TOK_SEMICOLON ? end + 2 : end + 1;
}

void glsl_flatten(Session *s, TokenVec *tokens) {
    Flat f = {.s = s, .t = tokens->data, .n = tokens->len};
    for (uint32_t i = 0; i < f.n;) {
        const Token *t = &f.t[i];
        uint32_t next = i;
        if (t->kind == TOK_STRUCT) next = structure(&f, i);
        else if (f.depth == 0 && t->kind == TOK_IDENT && f.out.len && is_word(&f.out.data[f.out.len - 1], "uniform") &&
                 f.t[i + 1].kind == TOK_LBRACE)
            next = block(&f, i);
        else if (t->kind == TOK_IDENT && f.t[i + 1].kind == TOK_DOT && map_get(&f.instances, t->text)) next = i + 2;
        if (next > i) {
            i = next;
            if (f.depth == 0 && f.out.len && f.out.data[f.out.len - 1].kind == TOK_SEMICOLON) f.start = f.out.len;
            continue;
        }
        if (t->kind == TOK_LBRACE) f.depth++;
        if (t->kind == TOK_RBRACE && f.depth) f.depth--;
        put(&f, *t);
        i++;
        if (f.depth == 0 && (t->kind == TOK_SEMICOLON || t->kind == TOK_RBRACE)) f.start = f.out.len;
    }
    *tokens = f.out;
}
