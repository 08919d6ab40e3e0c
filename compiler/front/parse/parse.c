/* The parser's ground: tokens, errors, recovery. internal.h explains the scheme. */
#include "compiler/front/parse/internal.h"

#include <string.h>

#include "compiler/front/glsl/glsl.h"

bool parse_at(const Parser *p, TokenKind k) { return p->tok.kind == k; }

void parse_stop(Parser *p) {
    p->stopped = p->panic = true;
    p->tok = (Token){.kind = TOK_EOF, .span = {p->lx.file, p->tok.span.pos, 0}};
    p->lx.pos = p->lx.len;
    while (p->lx.tokens && p->lx.tokens->kind != TOK_EOF) p->lx.tokens++;
}

void parse_advance(Parser *p) {
    if (p->stopped) return;
    p->prev_end = p->tok.span.pos + p->tok.span.len;
    if (p->panic && p->skipped.len) {
        Span *last = &p->skipped.data[p->skipped.len - 1];
        if (p->prev_end > last->pos) last->len = p->prev_end - last->pos;
    }
    p->tok = lex_next(&p->lx);
    p->ntaken++;
    p->end_reported |= p->lx.cut;
    if (p->s->nerrors - p->first_error > MAX_FILE_ERRORS) {
        diag_emit(p->s, DIAG_error_limit, p->tok.span);
        parse_stop(p);
    }
}

Token parse_peek(const Parser *p, uint32_t n) {
    Lexer ahead = p->lx;
    ahead.quiet = true;
    Token t = p->tok;
    while (n--) t = lex_next(&ahead);
    return t;
}

bool parse_accept(Parser *p, TokenKind k) {
    if (p->panic || p->tok.kind != k) return false;
    parse_advance(p);
    return true;
}

static Diag *report(Parser *p, DiagCode code, Span span, const char *fmt, va_list ap) {
    if (p->panic || p->stopped) return NULL;
    /* Only one error at the end of the file, although every construct open there is one. */
    if (span.pos >= p->lx.len) {
        if (p->end_reported) return NULL;
        p->end_reported = true;
    }
    return diag_emit(p->s, code, span, arena_vprintf(&p->s->session, fmt, ap));
}

Diag *parse_error(Parser *p, DiagCode code, Span span, const char *fmt, ...) {
    va_list ap;
    va_start(ap, fmt);
    Diag *d = report(p, code, span, fmt, ap);
    va_end(ap);
    if (!p->panic) {
        uint32_t pos = span.pos < p->lx.len ? span.pos : p->lx.len, end = pos + span.len;
        const char *text = p->s->sources[p->lx.file].text;
        while (pos > 0 && text[pos - 1] != '\n') pos--;
        vec_push(&p->s->module, &p->skipped, ((Span){p->lx.file, pos, end - pos}));
    }
    p->panic = true;
    return d;
}

Diag *parse_complain(Parser *p, DiagCode code, Span span, const char *fmt, ...) {
    va_list ap;
    va_start(ap, fmt);
    Diag *d = report(p, code, span, fmt, ap);
    va_end(ap);
    return d;
}

void parse_unexpected(Parser *p, const char *what) {
    if (!p->panic) parse_error(p, DIAG_syntax, p->tok.span, "expected %s before %s", what, lex_describe(p->s, &p->tok));
}

bool parse_expect(Parser *p, TokenKind k, const char *what) {
    if (parse_accept(p, k)) return true;
    parse_unexpected(p, what);
    return false;
}

bool parse_close(Parser *p, TokenKind k, const char *what, Span open) {
    if (parse_accept(p, k)) return true;
    if (p->panic) return false;
    Diag *d = parse_error(p, parse_at(p, TOK_EOF) ? DIAG_unbalanced : DIAG_syntax, p->tok.span, "expected %s before %s",
                          what, lex_describe(p->s, &p->tok));
    if (d) diag_note(p->s, d, open, "to match this");
    return false;
}

void parse_semicolon(Parser *p, const char *after) {
    if (parse_accept(p, TOK_SEMICOLON) || p->panic) return;
    bool carry_on = p->tok.first_on_line || parse_at(p, TOK_RBRACE) || parse_at(p, TOK_EOF);
    /* The place where the `;` belongs, not the innocent token on the next line. */
    Span span = carry_on ? (Span){p->lx.file, p->prev_end, 0} : p->tok.span;
    if (carry_on) parse_complain(p, DIAG_syntax, span, "expected `;` after %s", after);
    else parse_error(p, DIAG_syntax, span, "expected `;` after %s, found %s", after, lex_describe(p->s, &p->tok));
}

void parse_reserved(Parser *p, const Token *t) {
    uint64_t bit = t->kind >= TOK_IMPORT ? 1ull << (t->kind - TOK_IMPORT) : 0;
    if (bit && (p->reserved_reported & bit)) return;
    if (p->panic || p->stopped) return;
    p->reserved_reported |= bit;
    diag_emit(p->s, DIAG_reserved_name, t->span, t->text);
}

_Static_assert(TOK_COUNT - TOK_IMPORT <= 64, "keywords fit the bits of reserved_reported");

const char *parse_name(Parser *p, const char *what, Span *span) {
    *span = p->tok.span;
    if (p->panic) return NULL;
    const char *name = p->tok.text;
    bool word = p->tok.kind >= TOK_IMPORT || parse_at(p, TOK_TYPE);
    /* `float` at the end of a line and `return` on the next: the name is missing, not reserved. */
    if (word && !p->tok.first_on_line) {
        Token t = p->tok;
        parse_reserved(p, &t);
        parse_advance(p);
        return name;
    }
    if (parse_accept(p, TOK_IDENT)) return name;
    parse_unexpected(p, what);
    return NULL;
}

void parse_skip_to_close(Parser *p, TokenKind close, bool past_semicolons) {
    uint32_t depth = 0;
    while (!parse_at(p, TOK_EOF)) {
        TokenKind k = p->tok.kind;
        bool opens = k == TOK_LPAREN || k == TOK_LBRACKET || (k == TOK_LBRACE && close == TOK_RBRACE);
        bool closes = k == TOK_RPAREN || k == TOK_RBRACKET || (k == TOK_RBRACE && close == TOK_RBRACE);
        if (depth == 0 && k == close) {
            parse_advance(p);
            break;
        }
        if ((k == TOK_LBRACE || k == TOK_RBRACE) && close != TOK_RBRACE) break;
        if (k == TOK_SEMICOLON && !past_semicolons) break;
        if (opens) depth++;
        if (closes && depth) depth--;
        parse_advance(p);
    }
    if (!p->stopped) p->panic = false;
}

Span parse_join(Span a, Span b) {
    if (a.file < 0) return b;
    uint32_t end = b.pos + b.len;
    return (Span){a.file, a.pos, end > a.pos ? end - a.pos : a.len};
}

Span parse_span_from(const Parser *p, Span first) {
    return (Span){first.file, first.pos, p->prev_end > first.pos ? p->prev_end - first.pos : first.len};
}

static bool is_string(const Expr *e) { return e->kind == E_LITERAL && !e->type; }

static Stmt call_instead(Parser *p, const Stmt *st, const char *name) {
    Expr *call = ARENA_NEW(&p->s->module, Expr);
    *call = (Expr){.kind = E_CALL,
                   .span = st->span,
                   .op_span = st->span,
                   .args = st->args,
                   .nargs = st->nargs,
                   .name = name,
                   .depth = 1};
    call->op_span.len = (uint32_t)strlen(name);
    for (uint32_t i = 0; i < st->nargs; i++) {
        if (st->args[i]->depth >= call->depth) call->depth = st->args[i]->depth + 1;
        if (!is_string(st->args[i])) continue;
        diag_emit(
            p->s, DIAG_syntax, st->args[i]->span,
            arena_printf(&p->s->session, "a string cannot be an argument of `%s`, which this file declares", name));
        st->args[i]->kind = E_ERROR;
    }
    return (Stmt){.kind = S_EXPR, .span = st->span, .attrs = st->attrs, .expr = call};
}

/* Only at the end of a file is it known whether it declares its own `print` or `assert`; a user's names win over
 * builtins. */
static void finish_prints(Parser *p) {
    const char *print = intern(p->s, "print", 5), *assertion = intern(p->s, "assert", 6);
    bool own_print = false, own_assert = false;
    for (Func *f = p->module->funcs; f; f = f->next) {
        own_print |= f->name == print;
        own_assert |= f->name == assertion;
    }
    for (uint32_t i = 0; i < p->prints.len; i++) {
        Stmt *st = p->prints.data[i];
        if (st->kind == S_PRINT) {
            if (own_print) *st = call_instead(p, st, print);
        } else if (own_assert) {
            *st = call_instead(p, st, assertion);
        } else if (st->nargs < 1 || st->nargs > 2 || is_string(st->args[0]) ||
                   (st->nargs == 2 && !is_string(st->args[1]))) {
            diag_emit(p->s, DIAG_syntax, st->span,
                      "`assert` takes a condition and, if wanted, a text: `assert(x > 0.0, \"x is positive\");`");
            *st = (Stmt){.kind = S_EMPTY, .span = st->span};
        } else {
            st->expr = st->args[0];
            st->args++;
            st->nargs--;
        }
    }
}

static bool word_char(char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
}

/* The names in what was skipped: declarations among them are lost. */
static void collect_lost(Parser *p) {
    Vec(const char *) names = {0};
    const Source *src = &p->s->sources[p->lx.file];
    enum { MOST = 4096 };
    for (uint32_t i = 0; i < p->skipped.len; i++) {
        uint32_t end = p->skipped.data[i].pos + p->skipped.data[i].len;
        if (end > src->len) end = src->len;
        for (uint32_t at = p->skipped.data[i].pos; at < end;) {
            uint32_t from = at;
            while (at < end && word_char(src->text[at])) at++;
            if (at > from && names.len < MOST)
                vec_push(&p->s->module, &names, intern(p->s, src->text + from, at - from));
            if (at == from) at++;
        }
    }
    p->module->lost = names.data;
    p->module->nlost = names.len;
    p->module->unusable |= p->stopped || names.len == MOST;
}

Module *parse_module(Session *s, int file, const char *name) {
    Module *m = ARENA_NEW(&s->module, Module);
    m->name = intern(s, name, strlen(name));
    m->file = file;
    Parser p = {.s = s, .module = m, .first_error = s->nerrors};
    p.consts_end = &m->consts;
    p.params_end = &m->params;
    p.funcs_end = &m->funcs;
    p.structs_end = &m->struct_decls;
    p.typedefs_end = &m->typedefs;
    if (s->sources[file].too_large) {
        diag_emit(s, DIAG_source_limit, (Span){file, 0, 0}, SOURCE_MAX >> 20);
        m->unusable = true;
        return m;
    }
    GlslUnit unit = {.size = {s->sources[file].glsl[0], s->sources[file].glsl[1]}};
    m->glsl = p.glsl = unit.size[0] != 0;
    p.unit = &unit;
    p.lx = lex_start(s, file);
    if (p.glsl) {
        TokenVec tokens = glsl_preprocess(s, file);
        glsl_words(s, &tokens, &unit.words);
        glsl_flatten(s, &tokens);
        p.lx.tokens = tokens.data;
    }
    parse_advance(&p);
    p.prev_end = p.tok.span.pos;
    parse_file_scope(&p);
    if (p.glsl) glsl_complete(&p);
    m->imports = p.imports.data;
    m->nimports = p.imports.len;
    finish_prints(&p);
    collect_lost(&p);
    return m;
}
