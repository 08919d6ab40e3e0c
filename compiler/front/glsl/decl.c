/* GLSL's declarations at file scope, its array constructors and open arrays. */
#include "compiler/front/glsl/glsl.h"

#include <string.h>

static bool at_word(const Parser *p, const char *text) { return parse_at(p, TOK_IDENT) && !strcmp(p->tok.text, text); }

static Expr *integer(Parser *p, uint32_t v, Span at) {
    Expr *e = ARENA_NEW(&p->s->module, Expr);
    *e = (Expr){.kind = E_LITERAL, .span = at, .op_span = at, .type = type_scalar(T_INT), .depth = 1};
    e->cval = (ConstVal){.v = {{.i = v}}, .n = 1};
    return e;
}

static TypeRef *sized(Parser *p, TypeRef *t, const Expr *list) {
    if (!t || !t->ndims || t->dims[0] || !list || list->kind != E_LIST) return t;
    TypeRef *of = ARENA_NEW(&p->s->module, TypeRef);
    *of = *t;
    of->dims = arena_copy(&p->s->module, t->dims, sizeof *t->dims * t->ndims);
    of->dims[0] = integer(p, list->nargs, list->span);
    return of;
}

void glsl_size_open(Parser *p, Symbol *sym) { sym->type_ref = sized(p, sym->type_ref, sym->init); }

bool glsl_at_array(const Parser *p) {
    if (!parse_at(p, TOK_TYPE) && !parse_at(p, TOK_IDENT)) return false;
    Lexer ahead = p->lx;
    uint32_t depth = 0;
    Token t = lex_next(&ahead);
    if (t.kind != TOK_LBRACKET) return false;
    for (;; t = lex_next(&ahead)) {
        if (t.kind == TOK_EOF || t.kind == TOK_SEMICOLON || t.kind == TOK_LBRACE) return false;
        if (t.kind == TOK_LBRACKET) depth++;
        else if (t.kind == TOK_RBRACKET) depth--;
        else if (depth == 0) return t.kind == TOK_LPAREN;
    }
}

/* `float[3](a, b, c)` is the list { a, b, c }: its elements and their number are checked against what it initialises,
 * elsewhere against its own type. */
Expr *glsl_array(Parser *p) {
    Span start = p->tok.span;
    TypeRef *of = parse_type(p, "a type");
    Span open = p->tok.span;
    Expr *e = ARENA_NEW(&p->s->module, Expr);
    *e = (Expr){.kind = E_LIST, .span = start, .op_span = start, .depth = 1};
    if (!parse_expect(p, TOK_LPAREN, "`(`")) return e;
    e->args = parse_arguments(p, open, false, &e->nargs);
    for (uint32_t i = 0; i < e->nargs; i++)
        if (e->args[i]->depth >= e->depth) e->depth = e->args[i]->depth + 1;
    e->span = parse_span_from(p, start);
    e->of = sized(p, of, e);
    return e;
}

void glsl_length(Parser *p, Expr *e) {
    e->kind = E_CALL;
    e->name = intern(p->s, "len", 3);
    e->args = ARENA_NEW(&p->s->module, Expr *);
    e->args[0] = e->a[0];
    e->nargs = 1;
    e->a[0] = NULL;
}

/* `{ gl_discard = true; return; }`: callers go on, to no effect, and the entry gives black. */
Stmt *glsl_discard(Parser *p) {
    Arena *a = &p->s->module;
    Span at = p->tok.span;
    parse_advance(p);
    Expr *flag = ARENA_NEW(a, Expr), *yes = ARENA_NEW(a, Expr), *set = ARENA_NEW(a, Expr);
    *flag = (Expr){.kind = E_NAME, .span = at, .op_span = at, .name = intern(p->s, "gl_discard", 10), .depth = 1};
    *yes = (Expr){.kind = E_LITERAL, .span = at, .op_span = at, .type = type_scalar(T_BOOL), .depth = 1};
    yes->cval = (ConstVal){.v = {{.i = 1}}, .n = 1};
    *set = (Expr){.kind = E_ASSIGN, .span = at, .op_span = at, .a = {flag, yes}, .depth = 2};
    Stmt *block = ARENA_NEW(a, Stmt);
    *block = (Stmt){.kind = S_BLOCK, .span = at, .nstmts = 2, .stmts = ARENA_ARRAY(a, Stmt *, 2)};
    for (int i = 0; i < 2; i++) {
        block->stmts[i] = ARENA_NEW(a, Stmt);
        *block->stmts[i] = (Stmt){.kind = i ? S_RETURN : S_EXPR, .span = at, .expr = i ? NULL : set};
    }
    parse_semicolon(p, "`discard`");
    return block;
}

/* ---- file scope */

typedef enum Storage { PLAIN, CONSTANT, UNIFORM, INPUT, OUTPUT } Storage;

static Storage storage(Parser *p) {
    Storage s = PLAIN;
    for (;; parse_advance(p))
        if (parse_at(p, TOK_CONST)) s = CONSTANT;
        else if (at_word(p, "uniform")) s = UNIFORM;
        else if (parse_at(p, TOK_IN) || at_word(p, "varying") || at_word(p, "attribute")) s = INPUT;
        else if (parse_at(p, TOK_OUT)) s = OUTPUT;
        else return s;
}

/* Uniforms that hosts set to the size of the image; their further components are 1. */
static bool is_resolution(const Symbol *sym) {
    static const char *const names[] = {"iResolution", "u_resolution", "uResolution", "resolution"};
    const char *type = sym->type_ref->name;
    if (sym->type_ref->ndims || strncmp(type, "float", 5) || type[5] < '2' || type[5] > '4' || type[6]) return false;
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        if (!strcmp(sym->name, names[i])) return true;
    return false;
}

/* One of another name that is probably that, and not a texture's: a parameter that begins at the size. */
static bool may_be_resolution(const Symbol *sym) {
    static const char *const others[] = {"tex", "Tex", "hannel", "mage", "uffer"};
    if (sym->init || sym->type_ref->ndims || strcmp(sym->type_ref->name, "float2") != 0) return false;
    for (size_t i = 0; i < sizeof others / sizeof *others; i++)
        if (strstr(sym->name, others[i])) return false;
    return strstr(sym->name, "esolution") && !strpbrk(sym->name, "0123456789");
}

static Expr *size_of_image(Parser *p, const Symbol *sym) {
    Arena *a = &p->s->module;
    uint32_t n = (uint32_t)(sym->type_ref->name[5] - '0');
    Expr *e = ARENA_NEW(a, Expr);
    *e = (Expr){.kind = E_CONSTRUCT, .span = sym->span, .op_span = sym->span, .name = sym->type_ref->name, .nargs = n};
    e->depth = 2;
    e->args = ARENA_ARRAY(a, Expr *, n);
    for (uint32_t i = 0; i < n; i++) e->args[i] = integer(p, i < 2 ? p->unit->size[i] : 1, sym->span);
    return e;
}

static void keep_uniform(Parser *p, Symbol *sym) {
    Arena *a = &p->s->module;
    bool volume = !strcmp(sym->type_ref->name, "texture3D"), texture = !strcmp(sym->type_ref->name, "texture2D");
    sym->is_const = true;
    sym->value_span = sym->init ? sym->init->span : sym->span;
    if (is_resolution(sym)) {
        sym->init = size_of_image(p, sym);
        sym->kind = SYM_CONST;
        *p->consts_end = sym;
        p->consts_end = &sym->next;
        return;
    }
    sym->kind = SYM_PARAM;
    if (may_be_resolution(sym)) sym->init = size_of_image(p, sym);
    if (texture || volume) { /* black until a file is given */
        sym->zeros = true;
        sym->nzeros_args = volume ? 3 : 2;
        sym->zeros_args = ARENA_ARRAY(a, Expr *, sym->nzeros_args);
        for (uint32_t i = 0; i < sym->nzeros_args; i++) sym->zeros_args[i] = integer(p, 1, sym->span);
    } else if (!sym->init) {
        sym->starts_zero = true;
    }
    *p->params_end = sym;
    p->params_end = &sym->next;
}

static void keep(Parser *p, Storage s, Symbol *sym) {
    sym->module = p->module;
    switch (s) {
    case UNIFORM: keep_uniform(p, sym); break;
    case INPUT: vec_push(&p->s->module, &p->unit->inputs, sym); break;
    case OUTPUT: vec_push(&p->s->module, &p->unit->outputs, sym); break;
    case CONSTANT: sym->is_const = true; /* fall through */
    case PLAIN: vec_push(&p->s->module, &p->unit->globals, sym); break;
    }
}

static void variables(Parser *p, Storage s) {
    if (parse_at(p, TOK_SEMICOLON)) { /* `invariant gl_Position;`, a qualifier alone */
        parse_advance(p);
        return;
    }
    TypeRef *base = parse_type(p, "a type");
    if (s == UNIFORM && base && parse_at(p, TOK_LBRACE)) {
        parse_error(p, DIAG_glsl_unsupported, base->span,
                    "blocks of uniforms are not supported: declare each by itself");
        return;
    }
    while (base) {
        Symbol *sym = ARENA_NEW(&p->s->module, Symbol);
        sym->kind = SYM_LOCAL;
        sym->name = parse_name(p, "the name of a variable", &sym->span);
        if (!sym->name) return;
        sym->type_ref = parse_declarator_dims(p, base);
        if (parse_at(p, TOK_ASSIGN) && p->tok.op == OPR_NONE && !p->panic) {
            parse_advance(p);
            sym->init = parse_initialiser(p);
            glsl_size_open(p, sym);
        }
        if (sym->type_ref->ndims && !sym->type_ref->dims[0])
            parse_complain(p, DIAG_syntax, sym->span, "the array `%s` needs a size", sym->name);
        keep(p, s, sym);
        if (!parse_accept(p, TOK_COMMA)) break;
    }
    parse_semicolon(p, "the declaration");
}

/* `T name (` and `T[n] name (` declare functions. */
static bool at_function(const Parser *p) {
    Lexer ahead = p->lx;
    uint32_t depth = 0;
    for (Token t = lex_next(&ahead);; t = lex_next(&ahead))
        if (t.kind == TOK_LBRACKET) depth++;
        else if (t.kind == TOK_RBRACKET) depth--;
        else if (t.kind == TOK_EOF || t.kind == TOK_SEMICOLON || t.kind == TOK_LBRACE) return false;
        else if (depth == 0) return t.kind != TOK_IDENT || lex_next(&ahead).kind == TOK_LPAREN;
}

bool glsl_declaration(Parser *p) {
    Storage s = storage(p);
    if (s == PLAIN && ((!parse_at(p, TOK_TYPE) && !parse_at(p, TOK_IDENT)) || at_function(p))) return false;
    variables(p, s);
    return true;
}
