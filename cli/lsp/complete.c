/* Completion: what may stand at the cursor, in the order in which people are likely to mean it. */
#include <dirent.h>
#include <stdlib.h>
#include <string.h>

#include "cli/lsp/lsp.h"
#include "compiler/front/parse/lex.h"

enum {
    ITEM_METHOD = 2,
    ITEM_FUNCTION,
    ITEM_FIELD = 5,
    ITEM_VARIABLE,
    ITEM_MODULE = 9,
    ITEM_KEYWORD = 14,
    ITEM_CONSTANT = 21,
    ITEM_STRUCT,
    ITEM_TYPE = 25
};

static const char marker[] = "saltus_cursor"; /* stands behind a dot where nothing is written yet */

typedef struct List {
    Analysis *a;
    uint32_t n;
    Vec(const char *) names; /* interned */
} List;

/* An item; of two with one name the first is kept. */
static void item(List *l, const char *name, int kind, const char *detail, const char *text, char order) {
    Session *s = l->a->s;
    const char *known = intern(s, name, strlen(name));
    FILE *out = l->a->out;
    for (uint32_t i = 0; i < l->names.len; i++)
        if (l->names.data[i] == known) return;
    vec_push(&s->session, &l->names, known);
    fputs(l->n++ ? ",{\"label\":" : "{\"label\":", out);
    json_text(out, name);
    fprintf(out, ",\"kind\":%d,\"sortText\":\"%c", kind, order);
    fputs("\"", out);
    if (detail) {
        fputs(",\"detail\":", out);
        json_text(out, detail);
    }
    if (text) {
        fputs(",\"documentation\":", out);
        json_text(out, text);
    }
    fputc('}', out);
}

static void words(List *l, WordKind kind, int item_kind, char order) {
    uint32_t n;
    const Word *all = words_all(&n);
    for (uint32_t i = 0; i < n; i++)
        if (all[i].kind == kind) item(l, all[i].name, item_kind, all[i].written, all[i].line, order);
}

/* ---- behind a dot */

static void members(List *l, const Type *t) {
    static const char *const sets[] = {"xyzw", "rgba"};
    if (t->kind == T_STRUCT)
        for (uint32_t i = 0; i < t->nfields; i++)
            if (!strchr(t->fields[i].name, ' '))
                item(l, t->fields[i].name, ITEM_FIELD, t->fields[i].type->name,
                     t->fields[i].span.file >= 0 ? comment_of(l->a, t->fields[i].span) : NULL, '0');
    for (uint32_t k = 0; t->kind == T_VECTOR && k < 2; k++)
        for (uint32_t i = 0; i < t->n; i++) item(l, (char[]){sets[k][i], 0}, ITEM_FIELD, t->elem->name, NULL, '0');
    uint32_t object = t->kind == T_GEOMETRY ? T_GEOMETRY + t->n : (uint32_t)t->kind;
    for (int m = 0; type_is_resource(t) && m < M_COUNT; m++) {
        const Word *w = methods[m].object == object ? word_of(WORD_METHOD, m) : NULL;
        if (w) item(l, w->name, ITEM_METHOD, w->written, w->line, '0');
    }
}

static void request_members(Analysis *a, uint32_t offset, json_t *params) {
    (void)offset, (void)params;
    List l = {.a = a};
    Names names = names_of(a, false);
    fputc('[', a->out);
    for (uint32_t i = 0; i < names.len; i++)
        if (names.data[i].kind == NAME_UNKNOWN && names.data[i].text && !strcmp(names.data[i].text, marker)) {
            members(&l, names.data[i].owner);
            break;
        }
    fputc(']', a->out);
}

/* ---- names in scope */

typedef struct Braces {
    uint32_t from, to;
} Braces;
typedef Vec(Braces) BraceList;

static BraceList braces(Analysis *a) {
    BraceList all = {0};
    Vec(uint32_t) open = {0};
    Lexer lx = lex_start(a->s, a->file);
    lx.quiet = true;
    for (Token t = lex_next(&lx); t.kind != TOK_EOF; t = lex_next(&lx)) {
        if (t.kind == TOK_LBRACE) {
            vec_push(&a->s->session, &open, all.len);
            vec_push(&a->s->session, &all, ((Braces){t.span.pos, UINT32_MAX}));
        }
        if (t.kind == TOK_RBRACE && open.len) all.data[open.data[--open.len]].to = t.span.pos;
    }
    return all;
}

/* Where the block ends in which it is declared. */
static uint32_t scope_end(const BraceList *all, uint32_t pos) {
    uint32_t end = UINT32_MAX;
    for (uint32_t i = 0; i < all->len; i++)
        if (all->data[i].from < pos && pos < all->data[i].to && all->data[i].to < end) end = all->data[i].to;
    return end;
}

typedef struct Locals {
    List *l;
    BraceList braces;
    uint32_t offset;
} Locals;

static const char *type_of(const Symbol *s) {
    return s->type && s->type->kind != T_ERROR ? s->type->name : s->type_ref ? s->type_ref->name : NULL;
}

static void locals(Locals *x, const Stmt *s) {
    if (!s) return;
    locals(x, s->body);
    locals(x, s->orelse);
    for (uint32_t i = s->nstmts; i-- > 0;) locals(x, s->stmts[i]);
    for (uint32_t i = 0; i < s->ncases; i++)
        for (uint32_t k = 0; k < s->cases[i].nbody; k++) locals(x, s->cases[i].body[k]);
    locals(x, s->init);
    for (uint32_t i = s->ndecls; i-- > 0;) { /* the innermost first, which hides the others */
        const Symbol *d = s->decls[i];
        if (d->name && d->span.pos + d->span.len <= x->offset && x->offset <= scope_end(&x->braces, d->span.pos))
            item(x->l, d->name, ITEM_VARIABLE, type_of(d), NULL, '0');
    }
}

static void names_in(List *l, const Module *m, char order) {
    Analysis *a = l->a;
    for (const Symbol *s = m->params; s; s = s->next)
        item(l, s->name, ITEM_VARIABLE, type_of(s), comment_of(a, s->span), order);
    for (const Symbol *s = m->consts; s; s = s->next)
        item(l, s->name, ITEM_CONSTANT, type_of(s), comment_of(a, s->span), order);
    for (const Func *f = m->funcs; f; f = f->next)
        if (!f->is_shader && f->name) item(l, f->name, ITEM_FUNCTION, func_head(a, f), comment_of(a, f->span), order);
    for (const StructDecl *d = m->struct_decls; d; d = d->next)
        if (d->name) item(l, d->name, ITEM_STRUCT, NULL, comment_of(a, d->span), order);
    for (const TypedefDecl *d = m->typedefs; d; d = d->next)
        if (d->name) item(l, d->name, ITEM_TYPE, NULL, comment_of(a, d->span), order);
}

static void request_names(Analysis *a, uint32_t offset, json_t *params) {
    (void)params;
    List l = {.a = a};
    fputc('[', a->out);
    Locals x = {&l, braces(a), offset};
    for (const Func *f = a->main->funcs; f; f = f->next) {
        if (offset < f->name_span.pos || (f->end_span.len && offset > f->end_span.pos)) continue;
        if (!f->end_span.len && f->next && offset > f->next->name_span.pos) continue;
        locals(&x, f->body);
        for (uint32_t i = 0; i < f->nargs; i++)
            item(&l, f->args[i]->name, ITEM_VARIABLE, type_of(f->args[i]), NULL, '0');
    }
    names_in(&l, a->main, '1');
    for (uint32_t i = 0; i < a->main->nimports; i++) names_in(&l, a->main->imports[i].module, '2');
    words(&l, WORD_BUILTIN, ITEM_FUNCTION, '3');
    words(&l, WORD_OTHER, ITEM_CONSTANT, '3');
    words(&l, WORD_TYPE, ITEM_TYPE, '4');
    words(&l, WORD_KEYWORD, ITEM_KEYWORD, '4');
    fputc(']', a->out);
}

static void request_attributes(Analysis *a, uint32_t offset, json_t *params) {
    (void)offset, (void)params;
    List l = {.a = a};
    fputc('[', a->out);
    words(&l, WORD_ATTRIBUTE, ITEM_KEYWORD, '0');
    fputc(']', a->out);
}

static int by_name(const void *a, const void *b) { return strcmp(*(const char *const *)a, *(const char *const *)b); }

static void modules_in(List *l, const char *folder, char order) {
    enum { MOST = 1000 };
    Session *s = l->a->s;
    DIR *d = folder ? opendir(folder) : NULL;
    Vec(const char *) found = {0};
    for (struct dirent *e; d && found.len < MOST && (e = readdir(d));) {
        size_t n = strlen(e->d_name);
        if (n > 5 && !strcmp(e->d_name + n - 5, ".salt"))
            vec_push(&s->session, &found, (const char *)arena_strndup(&s->session, e->d_name, n - 5));
    }
    if (d) closedir(d);
    if (found.len) qsort(found.data, found.len, sizeof *found.data, by_name);
    for (uint32_t i = 0; i < found.len; i++) item(l, found.data[i], ITEM_MODULE, folder, NULL, order);
}

static void request_modules(Analysis *a, uint32_t offset, json_t *params) {
    (void)offset, (void)params;
    List l = {.a = a};
    fputc('[', a->out);
    modules_in(&l, a->s->sources[a->file].dir, '0');
    for (uint32_t i = 0; i < a->s->nimport_dirs; i++) modules_in(&l, a->s->import_dirs[i], '1');
    modules_in(&l, a->s->stdlib_dir, '2');
    fputc(']', a->out);
}

static void request_nothing(Analysis *a, uint32_t offset, json_t *params) {
    (void)offset, (void)params;
    fputs("[]", a->out);
}

/* ---- where the cursor is */

static bool is_word(char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
}

/* Between the last whole token and the word at the cursor there is a comment that is still open. */
static bool in_comment(const char *text, uint32_t from, uint32_t to) {
    for (uint32_t at = from; at + 1 < to; at++) {
        if (text[at] != '/') continue;
        bool block = text[at + 1] == '*';
        if (!block && text[at + 1] != '/') continue;
        for (at += 2; at < to && !(block ? text[at - 1] == '*' && text[at] == '/' && at > from + 2 : text[at] == '\n');)
            at++;
        if (at >= to) return true;
    }
    return false;
}

typedef struct Where {
    uint32_t word; /* where the word at the cursor begins */
    Request *run;
    Session *s;
    uint32_t offset;
} Where;

static void find_where(Session *s, void *arg) {
    Where *w = arg;
    int file = 0;
    const char *text = s->sources[file].text;
    Lexer lx = lex_start(s, file);
    lx.quiet = true;
    Token last = {0};
    Vec(TokenKind)
        before_open = {0}; /* of each bracket that is open: the token before it, TOK_EOF: it opens attributes */
    bool attributes = false;
    TokenKind previous = TOK_SEMICOLON;
    for (Token t = lex_next(&lx); t.kind != TOK_EOF && t.span.pos < w->offset; previous = t.kind, t = lex_next(&lx)) {
        if (t.span.pos + t.span.len > w->word && t.span.pos >= w->word) break;
        if (t.kind == TOK_STRING && t.span.pos + t.span.len >= w->offset + !t.broken) {
            w->run = request_nothing;
            return;
        }
        bool opens = t.kind == TOK_LPAREN || t.kind == TOK_LBRACKET || t.kind == TOK_LBRACE;
        bool closes = t.kind == TOK_RPAREN || t.kind == TOK_RBRACKET || t.kind == TOK_RBRACE;
        bool begins = previous == TOK_SEMICOLON || previous == TOK_LBRACE || previous == TOK_RBRACE ||
                      (previous == TOK_RBRACKET && attributes) || previous == TOK_ELSE;
        if (opens) vec_push(&s->session, &before_open, t.kind == TOK_LBRACKET && begins ? TOK_EOF : t.kind);
        if (closes) {
            attributes = before_open.len && before_open.data[before_open.len - 1] == TOK_EOF;
            if (before_open.len) before_open.len--;
        }
        last = t;
    }
    uint32_t end = last.span.pos + last.span.len;
    bool marks = before_open.len && before_open.data[before_open.len - 1] == TOK_EOF;
    if (in_comment(text, end, w->word)) w->run = request_nothing;
    else if (last.kind == TOK_DOT) w->run = request_members;
    else if (last.kind == TOK_IMPORT) w->run = request_modules;
    else if ((last.kind == TOK_INT || last.kind == TOK_FLOAT) && end == w->word) w->run = request_nothing; /* `1.` */
    else if (marks && (last.kind == TOK_LBRACKET || last.kind == TOK_COMMA)) w->run = request_attributes;
}

void request_complete(const Server *server, const Document *d, uint32_t offset, FILE *out) {
    Where w = {.word = offset, .run = request_names, .offset = offset};
    if (d->glsl || d->len > SOURCE_MAX) {
        fputs("[]", out);
        return;
    }
    while (w.word && is_word(d->text[w.word - 1])) w.word--;
    bool number = w.word < offset && d->text[w.word] >= '0' && d->text[w.word] <= '9';
    Session *s = cli_need(session_create(LSP_MEMORY));
    session_add_text(s, d->path, NULL, d->text, d->len);
    if (session_protect(s, find_where, &w) || number) w.run = request_nothing;
    if (w.run != request_members) {
        analyse_request(server, d, w.run, offset, NULL, out);
        return;
    }
    /* Behind a dot the word that is being written gives way to one that means nothing. */
    size_t end = offset;
    while (end < d->len && is_word(d->text[end])) end++;
    Document patched = *d;
    patched.len = w.word + strlen(marker) + (d->len - end);
    patched.text = cli_need(malloc(patched.len + 1));
    memcpy(patched.text, d->text, w.word);
    memcpy(patched.text + w.word, marker, strlen(marker));
    memcpy(patched.text + w.word + strlen(marker), d->text + end, d->len - end);
    patched.text[patched.len] = 0;
    analyse_request(server, &patched, w.run, w.word, NULL, out);
    free(patched.text);
}
