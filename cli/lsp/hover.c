/* What is said of the word under the cursor, and of the call around it. */
#include <ctype.h>
#include <string.h>

#include "cli/lsp/lsp.h"
#include "compiler/front/parse/lex.h"

/* ---- comments */

static uint32_t line_start(const Source *src, uint32_t pos) {
    while (pos > 0 && src->text[pos - 1] != '\n') pos--;
    return pos;
}

static uint32_t skip_spaces(const Source *src, uint32_t at) {
    while (at < src->len && (src->text[at] == ' ' || src->text[at] == '\t')) at++;
    return at;
}

/* Text between two places, without the marks of line comments. */
static const char *plain(Session *s, const Source *src, uint32_t from, uint32_t to) {
    char *out = arena_alloc(&s->session, to - from + 1), *end = out;
    while (from < to) {
        from = skip_spaces(src, from);
        while (from < to && src->text[from] == '/') from++;
        if (from < to && src->text[from] == ' ') from++;
        while (from < to && src->text[from] != '\n') {
            if (src->text[from] != '\r') *end++ = src->text[from];
            from++;
        }
        if (from < to) *end++ = '\n';
        from++;
    }
    while (end > out && isspace((unsigned char)end[-1])) end--;
    *end = 0;
    return *out ? out : NULL;
}

const char *comment_of(Analysis *a, Span declaration) {
    if (declaration.file < 0) return NULL;
    const Source *src = &a->s->sources[declaration.file];
    uint32_t start = line_start(src, declaration.pos), first = start;
    while (first > 0) { /* lines above that are comments; one with attributes alone may stand between */
        uint32_t above = line_start(src, first - 1), at = skip_spaces(src, above);
        if (!strncmp(src->text + at, "//", 2)) first = above;
        else if (first == start && src->text[at] == '[') start = first = above;
        else break;
    }
    if (first < start) return plain(a->s, src, first, start);
    uint32_t end = declaration.pos + declaration.len, at = end;
    while (at < src->len && src->text[at] != '\n' && strncmp(src->text + at, "//", 2)) at++;
    if (at >= src->len || src->text[at] == '\n') return NULL;
    uint32_t stop = at;
    while (stop < src->len && src->text[stop] != '\n') stop++;
    return plain(a->s, src, at, stop);
}

/* ---- heads */

static const char *type_text(const Type *t, const TypeRef *ref) {
    return t && t->kind != T_ERROR ? t->name : ref ? ref->name : "?";
}

const char *func_head(Analysis *a, const Func *f) {
    Arena *arena = &a->s->session;
    static const char *const modes[] = {"", "out ", "inout "};
    const char *text =
        arena_printf(arena, "%s%s %s(", f->is_shader ? "shader " : "", type_text(f->ret, f->ret_ref), f->name);
    for (uint32_t i = 0; i < f->nargs; i++)
        text = arena_printf(arena, "%s%s%s%s %s", text, i ? ", " : "", modes[f->args[i]->mode],
                            type_text(f->args[i]->type, f->args[i]->type_ref), f->args[i]->name);
    return arena_printf(arena, "%s)", text);
}

static const char *constant_text(Analysis *a, const Type *t, const ConstVal *c) {
    Arena *arena = &a->s->session;
    const Type *of = t->kind == T_VECTOR || t->kind == T_MATRIX ? t->elem : t;
    const char *text = c->n > 1 ? arena_printf(arena, "%s(", t->name) : "";
    for (uint32_t i = 0; i < c->n && i < 16; i++) {
        const char *one = of->kind == T_FLOAT  ? arena_printf(arena, "%.9g", c->v[i].f)
                          : of->kind == T_BOOL ? (c->v[i].i ? "true" : "false")
                                               : arena_printf(arena, "%lld", (long long)c->v[i].i);
        text = arena_printf(arena, "%s%s%s", text, i ? ", " : "", one);
    }
    return c->n > 1 ? arena_printf(arena, "%s)", text) : text;
}

static const char *symbol_head(Analysis *a, const Symbol *s) {
    static const char *const modes[] = {"", "out ", "inout "};
    Arena *arena = &a->s->session;
    const char *type = type_text(s->type, s->type_ref);
    const char *word = s->kind == SYM_PARAM                                            ? "param "
                       : s->kind == SYM_CONST || (s->kind == SYM_LOCAL && s->is_const) ? "const "
                       : s->kind == SYM_ARG                                            ? modes[s->mode]
                                                                                       : "";
    const char *head = arena_printf(arena, "%s%s %s", word, type, s->name);
    if (s->kind == SYM_CONST && s->cval.n && s->type && s->type->kind <= T_MATRIX)
        head = arena_printf(arena, "%s = %s", head, constant_text(a, s->type, &s->cval));
    return head;
}

/* ---- hover */

typedef struct Said {
    const char *head, *text; /* the text is Markdown */
    Span span;
} Said;

static const char *join(Analysis *a, const char *text, const char *more) {
    if (!more) return text;
    return *text ? arena_printf(&a->s->session, "%s\n\n%s", text, more) : more;
}

static Said said_word(Analysis *a, const Word *w, Span span) {
    const char *text = w->line ? w->line : "A type of the language.";
    if (w->written && strstr(w->written, "floatN"))
        text = arena_printf(&a->s->session, "%s\n\n`floatN` is `float`, `float2`, `float3` or `float4`.", text);
    return (Said){w->written ? w->written : w->name, text, span};
}

static Said said_symbol(Analysis *a, const Name *n) {
    const Symbol *s = n->sym;
    Arena *arena = &a->s->session;
    Said out = {symbol_head(a, s), "", n->span};
    const ParamAttrs *attrs = &s->attrs;
    if (attrs->doc) out.text = join(a, out.text, attrs->doc);
    out.text = join(a, out.text, comment_of(a, s->span));
    if (attrs->has_range)
        out.text = join(a, out.text, arena_printf(arena, "Range %.9g to %.9g.", attrs->lo, attrs->hi));
    if (attrs->log) out.text = join(a, out.text, "Optimised on a logarithmic scale.");
    if (s->asset) out.text = join(a, out.text, arena_printf(arena, "Values from `%s`.", s->asset));
    out.text = join(a, out.text, gradient_text(a, n));
    return out;
}

static Said said_struct(Analysis *a, const Name *n) {
    const StructDecl *d = n->structure;
    const char *head = arena_printf(&a->s->session, "struct %s {", d->name);
    for (uint32_t i = 0; i < d->nfields && i < 32; i++)
        head = arena_printf(&a->s->session, "%s\n    %s %s;", head,
                            d->type && d->type->kind == T_STRUCT && i < d->type->nfields ? d->type->fields[i].type->name
                                                                                         : d->fields[i].type_ref->name,
                            d->fields[i].name);
    return (Said){arena_printf(&a->s->session, "%s\n}", head), join(a, "", comment_of(a, d->span)), n->span};
}

static Said said_value(Analysis *a, const Name *n) {
    const Word *w = n->expr->kind == E_LITERAL && n->text ? word_find(WORD_OTHER, n->text) : NULL;
    if (w) return said_word(a, w, n->span);
    if (n->expr->kind == E_LEN) return said_word(a, word_find(WORD_OTHER, "len"), n->span);
    if (!n->type || n->type->kind == T_ERROR) return (Said){NULL, "", n->span};
    const char *head = n->type->name;
    if (n->expr->is_const && n->expr->cval.n && n->type->kind <= T_MATRIX && n->expr->kind != E_LITERAL)
        head = arena_printf(&a->s->session, "%s = %s", head, constant_text(a, n->type, &n->expr->cval));
    return (Said){head, join(a, "", n->expr->kind == E_LITERAL ? NULL : gradient_text(a, n)), n->span};
}

static Said said_name(Analysis *a, const Name *n) {
    Arena *arena = &a->s->session;
    switch (n->kind) {
    case NAME_SYMBOL: return said_symbol(a, n);
    case NAME_FUNC:
        return (Said){func_head(a, n->func),
                      join(a, join(a, "", comment_of(a, n->func->span.len ? n->func->span : n->func->name_span)),
                           n->expr ? gradient_text(a, n) : NULL),
                      n->span};
    case NAME_STRUCT: return said_struct(a, n);
    case NAME_TYPEDEF:
        return (Said){arena_printf(arena, "typedef %s %s", type_text(n->type, n->type_def->type_ref), n->text),
                      join(a, "", comment_of(a, n->type_def->span)), n->span};
    case NAME_FIELD: {
        const Field *f = &n->owner->fields[n->field];
        const char *text = join(a, "", f->span.file >= 0 ? comment_of(a, f->span) : NULL);
        return (Said){arena_printf(arena, "%s %s.%s", f->type->name, n->owner->name, f->name),
                      join(a, text, n->declares ? NULL : gradient_text(a, n)), n->span};
    }
    case NAME_BUILTIN: {
        Said out = said_word(a, word_of(WORD_BUILTIN, (int)n->builtin), n->span);
        out.text = join(a, out.text, gradient_text(a, n));
        return out;
    }
    case NAME_METHOD: {
        Said out = said_word(a, word_of(WORD_METHOD, (int)n->method), n->span);
        out.text = join(a, out.text, gradient_text(a, n));
        return out;
    }
    case NAME_MODULE:
        return (Said){arena_printf(arena, "import %s", n->text),
                      n->module->missing ? "" : a->s->sources[n->module->file].path, n->span};
    case NAME_TYPE: {
        const Word *w = word_find(WORD_TYPE, n->text);
        if (w) return said_word(a, w, n->span);
        break;
    }
    case NAME_VALUE: return said_value(a, n);
    case NAME_UNKNOWN: break;
    }
    return (Said){NULL, "", n->span};
}

/* A word that is no name: a keyword, an attribute, `print`. */
static Said said_plain_word(Analysis *a, uint32_t offset) {
    Lexer lx = lex_start(a->s, a->file);
    lx.quiet = true;
    TokenKind before = TOK_EOF;
    for (Token t = lex_next(&lx); t.kind != TOK_EOF && t.span.pos <= offset; before = t.kind, t = lex_next(&lx)) {
        if (offset > t.span.pos + t.span.len || !t.text || t.kind == TOK_STRING) continue;
        const Word *w = t.kind >= TOK_IMPORT                            ? word_find(WORD_KEYWORD, t.text)
                        : t.kind == TOK_TYPE                            ? word_find(WORD_TYPE, t.text)
                        : before == TOK_LBRACKET || before == TOK_COMMA ? word_find(WORD_ATTRIBUTE, t.text)
                                                                        : NULL;
        if (!w) w = word_find(WORD_OTHER, t.text);
        if (w) return said_word(a, w, t.span);
    }
    return (Said){NULL, "", SPAN_NONE};
}

void request_hover(Analysis *a, uint32_t offset, json_t *params) {
    (void)params;
    Names names = names_of(a, false);
    const Name *n = name_at(a, &names, offset);
    Said said = n ? said_name(a, n) : (Said){NULL, "", SPAN_NONE};
    if (!said.head && !a->document->glsl) said = said_plain_word(a, offset);
    if (!said.head) {
        fputs("null", a->out);
        return;
    }
    fputs("{\"contents\":{\"kind\":\"markdown\",\"value\":", a->out);
    json_text(a->out,
              arena_printf(&a->s->session, "```saltus\n%s\n```%s%s", said.head, *said.text ? "\n\n" : "", said.text));
    fputs("},", a->out);
    put_range(a, "range", said.span);
    fputc('}', a->out);
}

/* ---- signatures */

typedef struct CallAt {
    const char *name;
    bool method;
    uint32_t comma; /* how many stand before the cursor */
} CallAt;

/* The innermost call whose brackets are open at the offset. */
static CallAt call_at(Analysis *a, uint32_t offset) {
    Vec(CallAt) open = {0};
    Lexer lx = lex_start(a->s, a->file);
    lx.quiet = true;
    Token last = {0}, before = {0};
    for (Token t = lex_next(&lx); t.kind != TOK_EOF && t.span.pos < offset;
         before = last, last = t, t = lex_next(&lx)) {
        if (t.kind == TOK_LPAREN)
            vec_push(&a->s->session, &open,
                     ((CallAt){last.kind == TOK_IDENT ? last.text : NULL, before.kind == TOK_DOT, 0}));
        if (t.kind == TOK_LBRACKET || t.kind == TOK_LBRACE) vec_push(&a->s->session, &open, ((CallAt){0}));
        bool closes = t.kind == TOK_RPAREN || t.kind == TOK_RBRACKET || t.kind == TOK_RBRACE;
        if (closes && open.len) open.len--;
        if (t.kind == TOK_COMMA && open.len) open.data[open.len - 1].comma++;
    }
    return open.len ? open.data[open.len - 1] : (CallAt){0};
}

static void put_signature(Analysis *a, const char *label, const char *text, uint32_t *n) {
    fputs((*n)++ ? ",{\"label\":" : "{\"label\":", a->out);
    json_text(a->out, label);
    if (text && *text) {
        fputs(",\"documentation\":", a->out);
        json_text(a->out, text);
    }
    fputs(",\"parameters\":[", a->out);
    const char *at = strchr(label, '(');
    for (bool first = true; at && at[1] && at[1] != ')'; first = false) {
        size_t from = (size_t)(at + 1 - label), len = strcspn(at + 1, ",)");
        while (label[from] == ' ') from++, len--;
        fprintf(a->out, "%s{\"label\":[%zu,%zu]}", first ? "" : ",", from, from + len);
        at = label + from + len;
        if (*at != ',') break;
    }
    fputs("]}", a->out);
}

static uint32_t put_functions(Analysis *a, const Module *m, const char *name, uint32_t n) {
    for (const Func *f = m->funcs; f; f = f->next)
        if (f->name == name && !f->is_shader) put_signature(a, func_head(a, f), comment_of(a, f->span), &n);
    return n;
}

void request_signature(Analysis *a, uint32_t offset, json_t *params) {
    (void)params;
    CallAt c = call_at(a, offset);
    uint32_t n = 0, count;
    if (!c.name || a->document->glsl) {
        fputs("null", a->out);
        return;
    }
    fputs("{\"signatures\":[", a->out);
    if (!c.method) n = put_functions(a, a->main, c.name, n);
    for (uint32_t i = 0; !c.method && !n && i < a->main->nimports; i++)
        n = put_functions(a, a->main->imports[i].module, c.name, n);
    const Word *all = words_all(&count);
    for (uint32_t i = 0, own = n; !own && i < count; i++)
        if (all[i].kind == (c.method ? WORD_METHOD : WORD_BUILTIN) && !strcmp(all[i].name, c.name))
            put_signature(a, all[i].written, all[i].line, &n);
    fprintf(a->out, "],\"activeSignature\":0,\"activeParameter\":%u}", c.comma);
}
