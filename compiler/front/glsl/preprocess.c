/* GLSL's preprocessor: #define, #undef, #if and its kin, #include; the rest of what begins with `#` is noted or
 * refused.
 *
 * Tokens come from a stack of feeds: the file at the bottom, above it the bodies of macros being expanded and the
 * arguments put into them. A macro is not expanded within itself. A token that a macro made stands where the macro was
 * used, so that errors point into the program as it is written. */
#include "compiler/front/glsl/glsl.h"

#include <string.h>

enum { MAX_TOKENS = 1 << 19, MAX_EXPANSIONS = 256, MAX_CONDITIONS = 256, MAX_PARAMS = 64, MAX_INCLUDES = 32 };

typedef struct Macro {
    const char *name;
    bool function, busy;
    const char *params[MAX_PARAMS];
    uint32_t nparams;
    TokenVec body;
    struct Macro *next;
} Macro;

typedef struct Feed {
    const Token *at, *end;
    Macro *macro; /* not expanded again before this feed is used up */
} Feed;

typedef struct Condition {
    bool outer, active, taken, in_else;
    Span span;
} Condition;

typedef struct Pre {
    Session *s;
    Arena *arena;
    Lexer lx;
    Token ahead; /* of the file: the next token, not taken yet */
    Macro *macros;
    Vec(Condition) conditions;
    uint32_t nmade, nopen; /* nopen: files that include this one */
    const char *line_word; /* __LINE__ */
    bool failed;           /* a limit was met; nothing more is expanded */
    TokenVec out;
} Pre;

/* A stream of tokens under expansion: the file's, or an argument's, which ends with its feed. */
typedef struct Stream {
    Feed feeds[MAX_EXPANSIONS];
    uint32_t nfeeds;
    bool file; /* below the feeds lies the file */
} Stream;

static void complain(Pre *p, Span span, const char *text) {
    if (!p->lx.quiet) diag_emit(p->s, DIAG_preprocessor, span, text);
}

static bool active(const Pre *p) { return !p->conditions.len || p->conditions.data[p->conditions.len - 1].active; }

static void advance(Pre *p) { p->ahead = lex_next(&p->lx); }

static Macro *find(const Pre *p, const char *name) {
    for (Macro *m = p->macros; m && name; m = m->next)
        if (m->name == name) return m;
    return NULL;
}

static bool is_word(const Token *t) { return t->kind == TOK_IDENT || t->kind == TOK_TYPE || t->kind >= TOK_IMPORT; }

/* ---- expansion */

static bool next_raw(Pre *p, Stream *st, Token *t) {
    while (st->nfeeds) {
        Feed *f = &st->feeds[st->nfeeds - 1];
        if (f->at < f->end) {
            *t = *f->at++;
            return true;
        }
        if (f->macro) f->macro->busy = false;
        st->nfeeds--;
    }
    if (!st->file || p->ahead.kind == TOK_EOF || (p->ahead.kind == TOK_HASH && p->ahead.first_on_line)) return false;
    *t = p->ahead;
    advance(p);
    return true;
}

/* Is the next token a `(`? Without taking it. */
static bool opens(const Pre *p, const Stream *st) {
    for (uint32_t i = st->nfeeds; i-- > 0;)
        if (st->feeds[i].at < st->feeds[i].end) return st->feeds[i].at->kind == TOK_LPAREN;
    return st->file && p->ahead.kind == TOK_LPAREN;
}

static bool push(Pre *p, Stream *st, const TokenVec *body, Macro *macro, Span at) {
    if (!body->len) return true;
    if (st->nfeeds == MAX_EXPANSIONS) {
        complain(p, at, "macros are nested deeper than 256");
        p->failed = true;
        return false;
    }
    st->feeds[st->nfeeds++] = (Feed){body->data, body->data + body->len, macro};
    if (macro) macro->busy = true;
    return true;
}

static bool expand(Pre *p, Stream *st, TokenVec *out);

/* The arguments behind a macro's name, each expanded by itself. */
static bool arguments(Pre *p, Stream *st, const Macro *m, Span at, TokenVec *args) {
    Token t;
    uint32_t depth = 0, n = 0;
    TokenVec raw[MAX_PARAMS] = {0};
    next_raw(p, st, &t);
    for (;;) {
        if (!next_raw(p, st, &t)) {
            complain(p, at, arena_printf(&p->s->session, "the arguments of `%s` are not closed by `)`", m->name));
            return false;
        }
        if (t.kind == TOK_LPAREN) depth++;
        if (t.kind == TOK_RPAREN && depth-- == 0) break;
        if (t.kind == TOK_COMMA && depth == 0) n++;
        else if (n < MAX_PARAMS) vec_push(p->arena, &raw[n], t);
    }
    uint32_t given = n || raw[0].len || m->nparams ? n + 1 : 0;
    if (given != m->nparams) {
        complain(p, at,
                 arena_printf(&p->s->session, "the macro `%s` takes %u argument%s, %u given", m->name, m->nparams,
                              m->nparams == 1 ? "" : "s", given));
        return false;
    }
    for (uint32_t i = 0; i < m->nparams; i++) {
        Stream *inner = ARENA_NEW(p->arena, Stream);
        push(p, inner, &raw[i], NULL, at);
        if (!expand(p, inner, &args[i])) return false;
    }
    return true;
}

/* A macro whose name was just taken; false: it is no macro here, or it is wrong. */
static bool expand_macro(Pre *p, Stream *st, Macro *m, const Token *name) {
    TokenVec args[MAX_PARAMS] = {0}, *made = ARENA_NEW(p->arena, TokenVec);
    if (m->function && !arguments(p, st, m, name->span, args)) return false;
    for (uint32_t i = 0; i < m->body.len; i++) {
        Token t = m->body.data[i];
        uint32_t k = 0;
        while (k < m->nparams && !(is_word(&t) && t.text == m->params[k])) k++;
        if (k < m->nparams) {
            for (uint32_t j = 0; j < args[k].len; j++) vec_push(p->arena, made, args[k].data[j]);
        } else {
            t.span = name->span;
            t.first_on_line = false;
            vec_push(p->arena, made, t);
        }
        if (made->len > MAX_TOKENS) {
            complain(p, name->span, "macros make more than 500 000 tokens of this file");
            p->failed = true;
            return false;
        }
    }
    if (made->len) made->data[0].first_on_line = name->first_on_line;
    return push(p, st, made, m, name->span);
}

/* Everything up to the end of the stream, or to a directive of the file. */
static bool expand(Pre *p, Stream *st, TokenVec *out) {
    Token t;
    while (!p->failed && next_raw(p, st, &t)) {
        Macro *m = is_word(&t) ? find(p, t.text) : NULL;
        if (m && !m->busy && (!m->function || opens(p, st))) {
            expand_macro(p, st, m, &t);
            continue;
        }
        if (t.kind == TOK_IDENT && t.text == p->line_word) {
            uint32_t column;
            t.kind = TOK_INT;
            span_position(p->s, t.span, &t.integer, &column);
        }
        vec_push(p->arena, out, t);
        if (++p->nmade > MAX_TOKENS) {
            complain(p, t.span, "this file has more than 500 000 tokens, macros expanded");
            p->failed = true;
        }
    }
    while (st->nfeeds) /* after an error: macros may be used again */
        if (st->feeds[--st->nfeeds].macro) st->feeds[st->nfeeds].macro->busy = false;
    return !p->failed;
}

/* ---- conditions of #if */

typedef struct Eval {
    Pre *p;
    const Token *at, *end;
    bool bad;
    uint32_t depth;
} Eval;

static int64_t eval(Eval *e, int least);

static int64_t eval_unary(Eval *e) {
    if (e->at == e->end || ++e->depth > 200) {
        e->bad = true;
        return 0;
    }
    const Token t = *e->at++;
    int64_t v = 0;
    if (t.kind == TOK_INT) v = t.integer;
    else if (t.kind == TOK_LPAREN) {
        v = eval(e, 1);
        if (e->at == e->end || e->at++->kind != TOK_RPAREN) e->bad = true;
    } else if (t.kind == TOK_OP && t.op == OPR_NOT) v = !eval_unary(e);
    else if (t.kind == TOK_OP && t.op == OPR_SUB) v = -(int64_t)(int32_t)eval_unary(e);
    else if (t.kind == TOK_OP && t.op == OPR_ADD) v = eval_unary(e);
    else if (t.kind == TOK_OP && t.op == OPR_COMPL) v = ~eval_unary(e);
    else if (t.kind == TOK_TRUE) v = 1;
    else if (!is_word(&t)) e->bad = true; /* a word that is no macro counts as 0, as in C */
    e->depth--;
    return v;
}

/* In 32 bits, wrapping, as GLSL's int. */
static int64_t apply(Eval *e, Operator op, int64_t a, int64_t b) {
    switch ((int)op) {
    case OPR_LOR: return a || b;
    case OPR_LAND: return a && b;
    case OPR_OR: return a | b;
    case OPR_XOR: return a ^ b;
    case OPR_AND: return a & b;
    case OPR_EQ: return a == b;
    case OPR_NE: return a != b;
    case OPR_LT: return a < b;
    case OPR_LE: return a <= b;
    case OPR_GT: return a > b;
    case OPR_GE: return a >= b;
    case OPR_SHL: return (int32_t)((uint32_t)a << (b & 31));
    case OPR_SHR: return (int32_t)a >> (b & 31);
    case OPR_ADD: return (int32_t)(uint32_t)(a + b);
    case OPR_SUB: return (int32_t)(uint32_t)(a - b);
    case OPR_MUL: return (int32_t)((uint32_t)a * (uint32_t)b);
    default: break;
    }
    if (b == 0) {
        e->bad = true;
        return 0;
    }
    return op == OPR_DIV ? a / b : a % b;
}

static int64_t eval(Eval *e, int least) {
    int64_t left = eval_unary(e);
    int r;
    while (!e->bad && e->at < e->end && (r = parse_precedence(e->at)) >= least && r > 0) {
        Operator op = e->at++->op;
        left = apply(e, op, left, eval(e, r + 1));
    }
    return left;
}

/* ---- directives */

/* The rest of the line. */
static TokenVec line(Pre *p) {
    TokenVec v = {0};
    while (p->ahead.kind != TOK_EOF && !p->ahead.first_on_line) {
        vec_push(p->arena, &v, p->ahead);
        advance(p);
    }
    return v;
}

/* `defined X` and `defined(X)` become 1 or 0, then macros are expanded. */
static bool condition(Pre *p, const TokenVec *words, Span at) {
    TokenVec plain = {0}, full = {0};
    for (uint32_t i = 0; i < words->len; i++) {
        Token t = words->data[i];
        if (t.kind == TOK_IDENT && !strcmp(t.text, "defined")) {
            bool bracket = i + 1 < words->len && words->data[i + 1].kind == TOK_LPAREN;
            uint32_t k = i + 1 + bracket;
            if (k >= words->len || !is_word(&words->data[k]) ||
                (bracket && (k + 1 >= words->len || words->data[k + 1].kind != TOK_RPAREN))) {
                complain(p, t.span, "`defined` wants a name");
                return false;
            }
            t = (Token){.kind = TOK_INT, .span = t.span, .integer = find(p, words->data[k].text) != NULL};
            i = k + bracket;
        }
        vec_push(p->arena, &plain, t);
    }
    Stream *st = ARENA_NEW(p->arena, Stream);
    push(p, st, &plain, NULL, at);
    expand(p, st, &full);
    Eval e = {.p = p, .at = full.data, .end = full.len ? full.data + full.len : full.data};
    int64_t v = eval(&e, 1);
    if (e.bad || e.at != e.end)
        complain(p, at, "this is no condition that can be evaluated: integers, macros, `defined`, operators");
    return v != 0;
}

static void define(Pre *p, const TokenVec *words, Span at) {
    if (!words->len || !is_word(&words->data[0])) {
        complain(p, at, "`#define` wants a name");
        return;
    }
    const Token *name = &words->data[0];
    Macro *m = ARENA_NEW(p->arena, Macro);
    m->name = name->text;
    uint32_t i = 1;
    /* Only a `(` that touches the name makes a macro with arguments. */
    if (i < words->len && words->data[i].kind == TOK_LPAREN &&
        words->data[i].span.pos == name->span.pos + name->span.len) {
        m->function = true;
        for (i++; i < words->len && words->data[i].kind != TOK_RPAREN; i++) {
            if (words->data[i].kind == TOK_COMMA) continue;
            if (!is_word(&words->data[i]) || m->nparams == MAX_PARAMS) {
                complain(p, words->data[i].span, "the arguments of a macro are names, at most 64");
                return;
            }
            m->params[m->nparams++] = words->data[i].text;
        }
        if (i++ == words->len) {
            complain(p, at, "the arguments of the macro are not closed by `)`");
            return;
        }
    }
    for (; i < words->len; i++) {
        if (words->data[i].kind == TOK_HASH) {
            complain(p, words->data[i].span, "`#` and `##` in macros are not supported");
            return;
        }
        vec_push(p->arena, &m->body, words->data[i]);
    }
    m->next = p->macros;
    p->macros = m;
}

static void undefine(Pre *p, const TokenVec *words) {
    for (Macro **m = &p->macros; *m && words->len;)
        if ((*m)->name == words->data[0].text) *m = (*m)->next;
        else m = &(*m)->next;
}

static void begin_if(Pre *p, Span span, bool holds) {
    if (p->conditions.len == MAX_CONDITIONS) {
        complain(p, span, "`#if` is nested deeper than 256");
        p->failed = true;
        return;
    }
    bool outer = active(p);
    vec_push(p->arena, &p->conditions,
             ((Condition){.outer = outer, .active = outer && holds, .taken = holds, .span = span}));
}

static void alternative(Pre *p, const char *word, const TokenVec *rest, Span at) {
    Condition *c = p->conditions.len ? &p->conditions.data[p->conditions.len - 1] : NULL;
    if (!c || c->in_else) {
        p->lx.quiet = false;
        complain(p, at, arena_printf(&p->s->session, "`#%s` without `#if`", word));
        return;
    }
    c->in_else = !strcmp(word, "else");
    if (c->in_else) {
        c->active = c->outer && !c->taken;
        return;
    }
    c->active = false;
    if (c->taken || !c->outer) return;
    p->lx.quiet = false;
    c->active = c->taken = condition(p, rest, at);
}

static void file(Pre *p, Stream *st, int32_t source);

/* The file stands where the line stood; a path is relative to the file that names it. */
static void include(Pre *p, Stream *st, const TokenVec *rest, Span at) {
    const char *why = NULL, *text = rest->len == 1 && rest->data[0].kind == TOK_STRING ? rest->data[0].text : NULL;
    if (!text) {
        complain(p, at, "`#include` wants the name of a file, as in `#include \"noise.glsl\"`");
        return;
    }
    if (p->nopen == MAX_INCLUDES) {
        complain(p, at, "files include each other too deeply");
        p->failed = true;
        return;
    }
    const char *dir = p->s->sources[p->lx.file].dir;
    const char *path = text[0] == '/' ? text : arena_printf(&p->s->session, "%s/%s", dir, text);
    int source = session_allows(p->s, text, path, &why) ? session_add_file(p->s, path, &why) : -1;
    if (source < 0) {
        complain(p, at, arena_printf(&p->s->session, "cannot read `%s`: %s", path, why ? why : "unknown cause"));
        return;
    }
    Lexer lx = p->lx;
    Token ahead = p->ahead;
    memcpy(p->s->sources[source].glsl, p->s->sources[lx.file].glsl, sizeof p->s->sources[source].glsl);
    p->nopen++;
    file(p, st, source);
    p->nopen--;
    p->lx = lx;
    p->ahead = ahead;
}

static bool any_of(const char *word, const char *const *list) {
    for (; *list; list++)
        if (!strcmp(word, *list)) return true;
    return false;
}

static void directive(Pre *p, Stream *st) {
    static const char *const ignored[] = {"version", "extension", "pragma", "line", NULL};
    Span at = p->ahead.span;
    p->lx.quiet = !active(p);
    advance(p);
    if (p->ahead.first_on_line || p->ahead.kind == TOK_EOF) return; /* a `#` alone */
    const char *word = is_word(&p->ahead) ? p->ahead.text : "";
    at = parse_join(at, p->ahead.span);
    if (!strcmp(word, "error") || any_of(word, ignored)) p->lx.quiet = true; /* text behind it need be no tokens */
    advance(p);
    TokenVec rest = line(p);
    p->lx.quiet = !active(p);
    Span all = rest.len ? parse_join(at, rest.data[rest.len - 1].span) : at;
    if (!strcmp(word, "if")) {
        begin_if(p, at, active(p) && condition(p, &rest, all));
    } else if (!strcmp(word, "ifdef") || !strcmp(word, "ifndef")) {
        if (!rest.len) complain(p, at, arena_printf(&p->s->session, "`#%s` wants a name", word));
        begin_if(p, at, (rest.len && find(p, rest.data[0].text)) == !strcmp(word, "ifdef"));
    } else if (!strcmp(word, "elif") || !strcmp(word, "else")) {
        alternative(p, word, &rest, at);
    } else if (!strcmp(word, "endif")) {
        p->lx.quiet = false;
        if (p->conditions.len) p->conditions.len--;
        else complain(p, at, "`#endif` without `#if`");
    } else if (active(p)) {
        if (!strcmp(word, "define")) define(p, &rest, at);
        else if (!strcmp(word, "undef")) undefine(p, &rest);
        else if (!strcmp(word, "error")) complain(p, all, "the program refuses to be compiled by this `#error`");
        else if (!strcmp(word, "include")) include(p, st, &rest, all);
        else if (!any_of(word, ignored)) complain(p, at, arena_printf(&p->s->session, "`#%s` is not supported", word));
    }
    p->lx.quiet = !active(p);
}

/* The tokens of a file, up to its end; an #if ends in the file in which it begins. */
static void file(Pre *p, Stream *st, int32_t source) {
    uint32_t outer = p->conditions.len;
    p->lx = lex_start(p->s, source);
    p->lx.glsl = true;
    advance(p);
    while (p->ahead.kind != TOK_EOF && !p->failed)
        if (p->ahead.kind == TOK_HASH && p->ahead.first_on_line) directive(p, st);
        else if (active(p)) expand(p, st, &p->out);
        else advance(p);
    if (p->conditions.len > outer && !p->failed) {
        p->lx.quiet = false;
        complain(p, p->conditions.data[p->conditions.len - 1].span, "this `#if` has no `#endif`");
        p->conditions.len = outer;
    }
}

static void predefine(Pre *p, const char *name, uint32_t value) {
    Macro *m = ARENA_NEW(p->arena, Macro);
    m->name = intern(p->s, name, strlen(name));
    vec_push(p->arena, &m->body, ((Token){.kind = TOK_INT, .integer = value}));
    m->next = p->macros;
    p->macros = m;
}

TokenVec glsl_preprocess(Session *s, int source) {
    Pre *p = ARENA_NEW(&s->module, Pre);
    p->s = s;
    p->arena = &s->module;
    p->line_word = intern(s, "__LINE__", 8);
    predefine(p, "GL_ES", 1);
    predefine(p, "GL_FRAGMENT_PRECISION_HIGH", 1);
    predefine(p, "__VERSION__", 300);
    predefine(p, "GL_OES_standard_derivatives", 1);
    predefine(p, "SALTUS", 1);
    Stream *st = ARENA_NEW(p->arena, Stream);
    st->file = true;
    file(p, st, source);
    vec_push(p->arena, &p->out, ((Token){.kind = TOK_EOF, .span = {source, p->lx.len, 0}}));
    return p->out;
}
