/* File scope: imports, constants, parameters, types, functions, shaders. */
#include "compiler/front/parse/internal.h"

#include <string.h>

#include "compiler/front/glsl/glsl.h"

/* ---- types ---- */

/* `[n][m]` at the current token, appended to dims. */
static bool dimensions(Parser *p, ExprVec *dims) {
    bool any = false;
    while (parse_at(p, TOK_LBRACKET) && !p->panic) {
        Span open = p->tok.span;
        parse_advance(p);
        Expr *size = NULL;
        if (!parse_at(p, TOK_RBRACKET)) size = parse_cond_expr(p);
        parse_close(p, TOK_RBRACKET, "`]`", open);
        if (!size && dims->len > 0)
            parse_complain(p, DIAG_syntax, parse_span_from(p, open),
                           "only the first size of an array can be left open");
        vec_push(&p->s->module, dims, size);
        if (dims->len > MAX_DIMS) {
            parse_error(p, DIAG_chain_limit, open, "an array has at most %d dimensions", MAX_DIMS);
            dims->len = MAX_DIMS;
        }
        any = true;
    }
    return any;
}

TypeRef *parse_type(Parser *p, const char *what) {
    if (p->panic) return NULL;
    if (!parse_at(p, TOK_TYPE) && !parse_at(p, TOK_IDENT)) {
        parse_unexpected(p, what);
        return NULL;
    }
    TypeRef *t = ARENA_NEW(&p->s->module, TypeRef);
    ExprVec dims = {0};
    t->name = p->tok.text;
    t->span = p->tok.span;
    parse_advance(p);
    if (parse_at(p, TOK_LBRACKET)) dimensions(p, &dims);
    t->dims = dims.data;
    t->ndims = dims.len;
    return t;
}

void parse_skip_foreign_words(Parser *p) {
    if (p->glsl) return;
    while (parse_at(p, TOK_IDENT) && !p->panic) {
        Token next = parse_peek(p, 1);
        bool declares =
            next.kind == TOK_TYPE || next.kind == TOK_CONST || next.kind == TOK_PARAM || next.kind == TOK_SHADER;
        if (!declares || next.first_on_line) return;
        parse_complain(p, DIAG_syntax, p->tok.span, "`%s` before `%s` is not a word of the language", p->tok.text,
                       next.text);
        parse_advance(p);
    }
}

TypeRef *parse_declarator_dims(Parser *p, const TypeRef *base) {
    TypeRef *t = ARENA_NEW(&p->s->module, TypeRef);
    ExprVec dims = {0};
    *t = *base;
    if (!p->panic && dimensions(p, &dims)) {
        for (uint32_t i = 0; i < base->ndims; i++) {
            if (!base->dims[i])
                parse_complain(p, DIAG_syntax, base->span, "only the first size of an array can be left open");
            if (dims.len < MAX_DIMS) vec_push(&p->s->module, &dims, base->dims[i]);
            else parse_error(p, DIAG_chain_limit, base->span, "an array has at most %d dimensions", MAX_DIMS);
        }
        t->dims = dims.data;
        t->ndims = dims.len;
    }
    return t;
}

/* Reports an open size where no value can give it. */
static void need_sizes(Parser *p, const TypeRef *t, Span name, const char *what) {
    if (t->ndims && !t->dims[0]) parse_complain(p, DIAG_syntax, name, "an array that is %s needs its size", what);
}

/* ---- recovery ---- */

static bool starts_declaration(TokenKind k) {
    return k == TOK_IMPORT || k == TOK_CONST || k == TOK_PARAM || k == TOK_STRUCT || k == TOK_TYPEDEF ||
           k == TOK_SHADER || k == TOK_TYPE || k == TOK_LBRACKET;
}

static void synchronise(Parser *p) {
    uint32_t depth = 0;
    while (!parse_at(p, TOK_EOF)) {
        TokenKind k = p->tok.kind;
        if (p->tok.first_on_line) {
            if (depth == 0 && starts_declaration(k)) break;
            if (k == TOK_IMPORT || k == TOK_PARAM || k == TOK_SHADER) break;
        }
        parse_advance(p);
        if (k == TOK_SEMICOLON && depth == 0) break;
        if (k == TOK_LBRACE) depth++;
        if (k == TOK_RBRACE && (depth == 0 || --depth == 0)) {
            if (parse_at(p, TOK_SEMICOLON)) parse_advance(p);
            break;
        }
    }
    if (!p->stopped) p->panic = false;
}

/* ---- imports, structs, typedefs ---- */

static void import(Parser *p) {
    Import im = {0};
    parse_advance(p);
    if (parse_at(p, TOK_STRING)) {
        parse_complain(p, DIAG_syntax, p->tok.span, "a module is imported by its name: `import sdf;`");
        parse_advance(p);
        parse_semicolon(p, "the import");
        return;
    }
    /* A module is a file: one named as a type is clashes with nothing. */
    if (parse_at(p, TOK_TYPE) && !p->tok.first_on_line) {
        im.name = p->tok.text, im.span = p->tok.span;
        parse_advance(p);
    } else {
        im.name = parse_name(p, "the name of a module", &im.span);
    }
    if (im.name) vec_push(&p->s->module, &p->imports, im);
    parse_semicolon(p, "the import");
}

static void struct_declaration(Parser *p) {
    StructDecl *d = ARENA_NEW(&p->s->module, StructDecl);
    Vec(FieldDecl) fields = {0};
    d->module = p->module;
    parse_advance(p);
    d->name = parse_name(p, "the name of the struct", &d->span);
    Span open = p->tok.span;
    if (!d->name || !parse_expect(p, TOK_LBRACE, "`{`")) return;
    while (!parse_at(p, TOK_RBRACE) && !parse_at(p, TOK_EOF) && !p->panic) {
        TypeRef *base = parse_type(p, "the type of a field or `}`");
        while (base) {
            FieldDecl f = {0};
            f.name = parse_name(p, "the name of a field", &f.span);
            if (!f.name) break;
            f.type_ref = parse_declarator_dims(p, base);
            need_sizes(p, f.type_ref, f.span, "a field");
            if (parse_at(p, TOK_ASSIGN))
                parse_error(p, DIAG_syntax, p->tok.span,
                            "fields have no default values; write them where the struct is made");
            if (parse_at(p, TOK_LPAREN))
                parse_error(p, DIAG_syntax, p->tok.span, "a struct has no methods; write a function that takes it");
            vec_push(&p->s->module, &fields, f);
            if (!parse_accept(p, TOK_COMMA)) break;
        }
        parse_semicolon(p, "the field");
        if (p->panic && !p->stopped) {
            while (!parse_at(p, TOK_EOF) && !parse_at(p, TOK_SEMICOLON) && !parse_at(p, TOK_LBRACE) &&
                   !parse_at(p, TOK_RBRACE))
                parse_advance(p);
            bool body = parse_at(p, TOK_LBRACE);
            if (body || parse_at(p, TOK_SEMICOLON)) parse_advance(p);
            if (body) parse_skip_to_close(p, TOK_RBRACE, true);
            if (!p->stopped) p->panic = false;
        }
    }
    parse_close(p, TOK_RBRACE, "`}`", open);
    if (fields.len == 0 && !p->panic) parse_complain(p, DIAG_syntax, d->span, "a struct needs a field");
    parse_semicolon(p, "the struct");
    d->fields = fields.data;
    d->nfields = fields.len;
    *p->structs_end = d;
    p->structs_end = &d->next;
}

static void typedef_declaration(Parser *p) {
    parse_advance(p);
    if (parse_at(p, TOK_STRUCT)) {
        parse_complain(p, DIAG_syntax, p->tok.span, "a struct is declared by `struct Name { … };`, without `typedef`");
        parse_skip_struct(p);
        return;
    }
    TypeRef *base = parse_type(p, "a type");
    while (base) {
        TypedefDecl *d = ARENA_NEW(&p->s->module, TypedefDecl);
        d->module = p->module;
        d->name = parse_name(p, "the new name of the type", &d->span);
        if (!d->name) return;
        d->type_ref = parse_declarator_dims(p, base);
        need_sizes(p, d->type_ref, d->span, "a type");
        *p->typedefs_end = d;
        p->typedefs_end = &d->next;
        if (!parse_accept(p, TOK_COMMA)) break;
    }
    parse_semicolon(p, "the typedef");
}

/* ---- values at file scope ---- */

/* = init(f), = "file", = zeros(w, h[, d][, c]), or an expression or list. */
static void param_value(Parser *p, Symbol *sym) {
    const Token t = p->tok;
    sym->value_span = t.span;
    if (t.kind == TOK_STRING) {
        sym->asset_text = t.text;
        if (!*t.text) parse_complain(p, DIAG_syntax, t.span, "the name of the file is empty");
        parse_advance(p);
        p->panic |= t.broken;
        return;
    }
    bool call = t.kind == TOK_IDENT && parse_peek(p, 1).kind == TOK_LPAREN;
    if (call && !strcmp(t.text, "init")) {
        Token name = parse_peek(p, 2);
        if (name.kind != TOK_IDENT || parse_peek(p, 3).kind != TOK_RPAREN) {
            parse_error(p, DIAG_syntax, t.span, "`init` takes the name of a function: `init(f)`");
            return;
        }
        for (int i = 0; i < 4; i++) parse_advance(p);
        sym->init_name = name.text;
        sym->value_span = name.span;
    } else if (call && !strcmp(t.text, "zeros")) {
        parse_advance(p);
        Span open = p->tok.span;
        parse_advance(p);
        sym->zeros_args = parse_arguments(p, open, false, &sym->nzeros_args);
        sym->zeros = true;
        sym->value_span = parse_span_from(p, t.span);
        if (!p->panic && (sym->nzeros_args < 2 || sym->nzeros_args > 4)) {
            parse_complain(p, DIAG_syntax, sym->value_span,
                           "`zeros` is written `zeros(width, height)` or `zeros(width, height, channels)`");
            sym->zeros = false;
        }
    } else {
        sym->init = parse_initialiser(p);
        sym->value_span = sym->init->span;
    }
}

/* Declarators of const and param, behind the type. */
static void values(Parser *p, SymbolKind kind, const TypeRef *base, const AttrVec *attrs) {
    for (;;) {
        Symbol *sym = ARENA_NEW(&p->s->module, Symbol);
        sym->kind = kind;
        sym->module = p->module;
        sym->is_const = true;
        sym->name = parse_name(p, kind == SYM_PARAM ? "the name of a parameter" : "the name of a constant", &sym->span);
        if (!sym->name) return;
        sym->type_ref = parse_declarator_dims(p, base);
        if (kind == SYM_PARAM) attrs_to_param(p, attrs, sym);
        if (parse_at(p, TOK_ASSIGN) && p->tok.op == OPR_NONE && !p->panic) {
            parse_advance(p);
            if (kind == SYM_PARAM) {
                param_value(p, sym);
            } else {
                sym->init = parse_initialiser(p);
                sym->value_span = sym->init->span;
            }
        } else {
            parse_complain(p, DIAG_no_value, sym->span, "the %s `%s` needs a value",
                           kind == SYM_PARAM ? "parameter" : "constant", sym->name);
            if (parse_at(p, TOK_LPAREN)) parse_error(p, DIAG_syntax, p->tok.span, "expected `=`");
        }
        Symbol ***end = kind == SYM_PARAM ? &p->params_end : &p->consts_end;
        **end = sym;
        *end = &sym->next;
        if (!parse_accept(p, TOK_COMMA)) break;
    }
    parse_semicolon(p, kind == SYM_PARAM ? "the parameter" : "the constant");
}

static void value_declaration(Parser *p, SymbolKind kind, const AttrVec *attrs) {
    parse_advance(p);
    TypeRef *base = parse_type(p, "a type");
    if (kind != SYM_PARAM) attrs_none(p, attrs, "a constant");
    if (base) values(p, kind, base, attrs);
}

/* ---- functions ---- */

static Symbol *argument(Parser *p) {
    Symbol *sym = ARENA_NEW(&p->s->module, Symbol);
    sym->kind = SYM_ARG;
    sym->is_const = parse_accept(p, TOK_CONST);
    if (parse_accept(p, TOK_INOUT)) sym->mode = ARG_INOUT;
    else if (parse_accept(p, TOK_OUT)) sym->mode = p->glsl ? ARG_INOUT : ARG_OUT, sym->was_out = p->glsl;
    else if (parse_accept(p, TOK_IN) && parse_accept(p, TOK_OUT)) sym->mode = ARG_INOUT;
    if (parse_accept(p, TOK_CONST)) sym->is_const = true;
    TypeRef *base = parse_type(p, "the type of an argument");
    if (!base) return NULL;
    if (p->glsl && (parse_at(p, TOK_COMMA) || parse_at(p, TOK_RPAREN))) { /* of a prototype */
        sym->name = "";
        sym->type_ref = base;
        return sym;
    }
    sym->name = parse_name(p, "the name of an argument", &sym->span);
    if (!sym->name) return NULL;
    sym->type_ref = parse_declarator_dims(p, base);
    need_sizes(p, sym->type_ref, sym->span, "an argument");
    if (parse_at(p, TOK_ASSIGN))
        parse_error(p, DIAG_syntax, p->tok.span, "arguments have no default values; overload the function instead");
    return sym;
}

static void arguments(Parser *p, Func *f) {
    Span open = p->tok.span;
    SymbolVec args = {0};
    parse_advance(p);
    bool none = parse_at(p, TOK_RPAREN);
    if (parse_at(p, TOK_TYPE) && !strcmp(p->tok.text, "void") && parse_peek(p, 1).kind == TOK_RPAREN) {
        /* C's way to say that there are none. */
        parse_advance(p);
        none = true;
    }
    while (!none) {
        Symbol *arg = argument(p);
        if (arg) vec_push(&p->s->module, &args, arg);
        if (!parse_accept(p, TOK_COMMA)) break;
    }
    parse_close(p, TOK_RPAREN, "`)` or `,`", open);
    if (p->panic && !p->stopped) parse_skip_to_close(p, TOK_RPAREN, false);
    f->args = args.data;
    f->nargs = args.len;
}

/* From the `(` on. */
static void function(Parser *p, Func *f, Span start, const AttrVec *attrs) {
    f->module = p->module;
    attrs_to_func(p, attrs, f);
    arguments(p, f);
    f->span = parse_span_from(p, start);
    if (parse_at(p, TOK_SEMICOLON) && !f->is_shader) {
        /* A prototype says nothing: names may be used before they are declared. */
        parse_advance(p);
        return;
    }
    if (parse_at(p, TOK_COLON) && !p->panic) {
        parse_complain(p, DIAG_syntax, p->tok.span,
                       "there are no semantics; the channels of a shader are what it returns");
        parse_advance(p);
        if (parse_at(p, TOK_IDENT)) parse_advance(p);
    }
    if (!parse_at(p, TOK_LBRACE)) {
        parse_unexpected(p, "`{`");
        return;
    }
    p->stmt_nest = p->stmt_depth = p->expr_nest = 0;
    f->body = parse_block(p);
    f->end_span = (Span){start.file, p->prev_end ? p->prev_end - 1 : 0, 1};
    *p->funcs_end = f;
    p->funcs_end = &f->next;
}

static void shader(Parser *p, const AttrVec *attrs) {
    Span start = p->tok.span;
    Func *f = ARENA_NEW(&p->s->module, Func);
    f->is_shader = true;
    parse_advance(p);
    f->ret_ref = parse_type(p, "the type of the shader");
    f->name = parse_name(p, "the name of the shader", &f->name_span);
    if (f->name && !parse_at(p, TOK_LPAREN)) parse_unexpected(p, "`(`");
    if (!p->panic) {
        function(p, f, start, attrs);
        return;
    }
    /* The head is wrong; the body can still have errors of its own. */
    while (!parse_at(p, TOK_EOF) && !parse_at(p, TOK_LBRACE) && !parse_at(p, TOK_SEMICOLON) && !parse_at(p, TOK_RBRACE))
        parse_advance(p);
    if (!parse_at(p, TOK_LBRACE)) return;
    p->panic = false;
    p->stmt_nest = p->stmt_depth = p->expr_nest = 0;
    parse_block(p);
}

/* `T name(…)`: a function; `T name …`: a variable, which file scope does not have. */
static void function_or_variable(Parser *p, const AttrVec *attrs) {
    const Token start = p->tok;
    TypeRef *ret = parse_type(p, "a type");
    Token name_tok = p->tok;
    bool is_function = parse_peek(p, 1).kind == TOK_LPAREN;
    if (!ret || p->panic) return;
    if (!is_function && parse_at(p, TOK_IDENT)) {
        TokenKind next = parse_peek(p, 1).kind;
        if (next == TOK_ASSIGN || next == TOK_SEMICOLON || next == TOK_COMMA || next == TOK_LBRACKET) {
            diag_emit(p->s, DIAG_global_variable, name_tok.span, name_tok.text);
            /* A variable with a value is declared as a constant, so that its uses are not errors too. */
            AttrVec none = {0};
            if (next == TOK_ASSIGN) values(p, SYM_CONST, ret, &none);
            else p->panic = true;
            return;
        }
    }
    Func *f = ARENA_NEW(&p->s->module, Func);
    f->ret_ref = ret;
    if (start.kind == TOK_IDENT && parse_at(p, TOK_LPAREN)) {
        parse_error(p, DIAG_syntax, start.span, "expected the type of the function before its name `%s`", start.text);
        return;
    }
    f->name = parse_name(p, "a name", &f->name_span);
    if (!f->name) return;
    if (!parse_at(p, TOK_LPAREN)) {
        parse_unexpected(p, "`(`");
        return;
    }
    function(p, f, start.span, attrs);
}

void parse_file_scope(Parser *p) {
    while (!parse_at(p, TOK_EOF)) {
        uint32_t before = p->ntaken;
        AttrVec attrs;
        parse_attributes(p, &attrs);
        parse_skip_foreign_words(p);
        switch (p->glsl && glsl_declaration(p) ? TOK_COUNT : (int)p->tok.kind) {
        case TOK_COUNT: break;
        case TOK_IMPORT:
            attrs_none(p, &attrs, "an import");
            import(p);
            break;
        case TOK_CONST: value_declaration(p, SYM_CONST, &attrs); break;
        case TOK_PARAM: value_declaration(p, SYM_PARAM, &attrs); break;
        case TOK_STRUCT:
            attrs_none(p, &attrs, "a struct");
            struct_declaration(p);
            break;
        case TOK_TYPEDEF:
            attrs_none(p, &attrs, "a typedef");
            typedef_declaration(p);
            break;
        case TOK_SHADER: shader(p, &attrs); break;
        case TOK_TYPE:
        case TOK_IDENT:
            /* Behind a function that was taken for one at file scope: the rest of the function around it. */
            if (p->unclosed && !parse_at_function(p)) parse_statement(p);
            else function_or_variable(p, &attrs);
            break;
        case TOK_SEMICOLON: parse_advance(p); break;
        case TOK_RBRACE:
            if (!p->unclosed) parse_complain(p, DIAG_unbalanced, p->tok.span, "this `}` closes nothing");
            parse_advance(p);
            break;
        default:
            if (p->unclosed) parse_statement(p);
            else
                parse_error(p, DIAG_syntax, p->tok.span, "expected a declaration before %s",
                            lex_describe(p->s, &p->tok));
            break;
        }
        if (p->to_file_scope) {
            p->to_file_scope = false;
            if (!p->stopped) p->panic = false;
        } else if (p->panic && !p->stopped) {
            synchronise(p);
        }
        if (p->ntaken == before && !parse_at(p, TOK_EOF)) parse_advance(p);
    }
}
