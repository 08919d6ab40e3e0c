/* Statements. */
#include "compiler/front/parse/internal.h"

#include <string.h>

#include "compiler/front/glsl/glsl.h"

static Stmt *new_stmt(Parser *p, StmtKind kind, Span span) {
    Stmt *st = ARENA_NEW(&p->s->module, Stmt);
    st->kind = kind;
    st->open_ended = p->glsl;
    st->span = span;
    return st;
}

/* ---- recovery ---- */

static bool starts_file_scope(TokenKind k) {
    return k == TOK_IMPORT || k == TOK_PARAM || k == TOK_SHADER || k == TOK_STRUCT || k == TOK_TYPEDEF;
}

static bool starts_statement(const Parser *p) {
    switch ((int)p->tok.kind) {
    case TOK_IF:
    case TOK_FOR:
    case TOK_WHILE:
    case TOK_DO:
    case TOK_SWITCH:
    case TOK_RETURN:
    case TOK_BREAK:
    case TOK_CONTINUE:
    case TOK_CASE:
    case TOK_DEFAULT:
    case TOK_CONST: return true;
    case TOK_TYPE: return parse_peek(p, 1).kind == TOK_IDENT;
    default: return starts_file_scope(p->tok.kind);
    }
}

/* Ends a panic: behind the `;`, or before what closes the block or begins a statement on a line of its own. */
static void synchronise(Parser *p) {
    uint32_t depth = 0;
    while (!parse_at(p, TOK_EOF)) {
        TokenKind k = p->tok.kind;
        if (k == TOK_SEMICOLON) {
            parse_advance(p);
            break;
        }
        if (k == TOK_LBRACE || k == TOK_RBRACE) break;
        if (p->tok.first_on_line && starts_statement(p)) break;
        if (k == TOK_LPAREN || k == TOK_LBRACKET) depth++;
        if ((k == TOK_RPAREN || k == TOK_RBRACKET) && depth) depth--;
        parse_advance(p);
    }
    if (!p->stopped) p->panic = false;
}

/* What follows can only stand at file scope: the `}` of this function is missing. */
static void leave_function(Parser *p, Span open, const char *fmt) {
    Diag *d = parse_error(p, DIAG_unbalanced, p->tok.span, fmt, lex_describe(p->s, &p->tok));
    if (d) diag_note(p->s, d, open, "this `{` is not closed");
    p->panic = p->to_file_scope = p->unclosed = true;
}

bool parse_at_function(const Parser *p) {
    if (!parse_at(p, TOK_TYPE) && !parse_at(p, TOK_IDENT)) return false;
    if (parse_peek(p, 1).kind != TOK_IDENT || parse_peek(p, 2).kind != TOK_LPAREN) return false;
    Token t = parse_peek(p, 3);
    if (t.kind == TOK_IN || t.kind == TOK_OUT || t.kind == TOK_INOUT || t.kind == TOK_RPAREN) return true;
    return (t.kind == TOK_TYPE || t.kind == TOK_IDENT) && parse_peek(p, 4).kind == TOK_IDENT;
}

void parse_skip_struct(Parser *p) {
    while (!parse_at(p, TOK_EOF) && !parse_at(p, TOK_SEMICOLON) && !parse_at(p, TOK_LBRACE) && !parse_at(p, TOK_RBRACE))
        parse_advance(p);
    if (parse_at(p, TOK_LBRACE)) {
        parse_advance(p);
        parse_skip_to_close(p, TOK_RBRACE, true);
    }
    if (!p->stopped) p->panic = false;
    if (parse_at(p, TOK_IDENT)) parse_advance(p);
    parse_accept(p, TOK_SEMICOLON);
}

/* ---- declarations ---- */

/* `T name`, `T[n] name` (not an index: a value is never followed by a name), `const T name`. */
static bool starts_declaration(const Parser *p) {
    if (parse_at(p, TOK_CONST)) return true;
    if (parse_at(p, TOK_TYPE)) return parse_peek(p, 1).kind != TOK_LPAREN;
    if (!parse_at(p, TOK_IDENT)) return false;
    Lexer ahead = p->lx;
    ahead.quiet = true;
    Token t = lex_next(&ahead);
    if (t.kind == TOK_IDENT || t.kind == TOK_IN || t.kind == TOK_OUT || t.kind == TOK_INOUT) return !t.first_on_line;
    if (t.kind != TOK_LBRACKET) return false;
    uint32_t depth = 0;
    for (;; t = lex_next(&ahead))
        if (t.kind == TOK_LBRACKET) depth++;
        else if (t.kind == TOK_RBRACKET) depth--;
        else if (t.kind == TOK_EOF || t.kind == TOK_SEMICOLON || t.kind == TOK_LBRACE || t.kind == TOK_RBRACE)
            return false;
        else if (depth == 0) return t.kind == TOK_IDENT && !t.first_on_line;
}

static Stmt *declaration(Parser *p) {
    Stmt *st = new_stmt(p, S_DECL, p->tok.span);
    SymbolVec decls = {0};
    bool is_const = parse_accept(p, TOK_CONST);
    TypeRef *base = parse_type(p, "a type");
    while (base) {
        Symbol *sym = ARENA_NEW(&p->s->module, Symbol);
        sym->kind = SYM_LOCAL;
        sym->is_const = is_const;
        sym->name = parse_name(p, "the name of a variable", &sym->span);
        if (!sym->name) break;
        sym->type_ref = parse_declarator_dims(p, base);
        if (parse_at(p, TOK_LPAREN) && !p->panic)
            parse_error(p, DIAG_syntax, p->tok.span, "a variable is initialised with `=`, as in `%s %s = …`",
                        base->name, sym->name);
        if (parse_at(p, TOK_ASSIGN) && p->tok.op == OPR_NONE && !p->panic) {
            parse_advance(p);
            sym->init = parse_initialiser(p);
            if (p->glsl) glsl_size_open(p, sym);
        } else if (is_const) {
            parse_complain(p, DIAG_no_value, sym->span, "the constant `%s` needs a value", sym->name);
        }
        /* Also where the initialiser is wrong: the name is declared, so that its uses are not errors too. */
        vec_push(&p->s->module, &decls, sym);
        if (!parse_accept(p, TOK_COMMA)) break;
    }
    st->decls = decls.data;
    st->ndecls = decls.len;
    st->span = parse_span_from(p, st->span);
    return st;
}

/* ---- compound statements ---- */

/* In GLSL the condition of a loop may declare a variable, which lives for one turn: the turn declares it, and goes on
 * or ends the loop by it. `*turn` is that `{ T x = e; if (x) …; else break; }`, whose body the caller has. */
static Expr *declared_condition(Parser *p, Stmt **turn) {
    Arena *a = &p->s->module;
    Stmt *decl = declaration(p), *test = new_stmt(p, S_IF, decl->span);
    const Symbol *sym = decl->ndecls ? decl->decls[decl->ndecls - 1] : NULL;
    Expr *e = ARENA_NEW(a, Expr);
    *e = (Expr){.kind = sym ? E_NAME : E_ERROR, .span = decl->span, .op_span = decl->span, .depth = 1};
    if (sym) e->name = sym->name;
    test->expr = e;
    test->orelse = new_stmt(p, S_BREAK, decl->span);
    *turn = new_stmt(p, S_BLOCK, decl->span);
    (*turn)->stmts = ARENA_ARRAY(a, Stmt *, 2);
    (*turn)->nstmts = 2;
    (*turn)->stmts[0] = decl;
    (*turn)->stmts[1] = test;
    Expr *yes = ARENA_NEW(a, Expr);
    *yes = (Expr){.kind = E_LITERAL, .span = decl->span, .op_span = decl->span, .depth = 1};
    yes->type = type_scalar(T_BOOL);
    yes->cval = (ConstVal){.v = {{.i = 1}}, .n = 1};
    return yes;
}

static Stmt *loop_body(Parser *p, Stmt *turn) {
    Stmt *body = parse_statement(p);
    if (!turn) return body;
    turn->stmts[1]->body = body;
    return turn;
}

/* `( expr )`; after an error parsing goes on behind the bracket. turn: the condition is that of a loop. */
static Expr *header_condition(Parser *p, Stmt *st, Span keyword, Stmt **turn) {
    Span open = p->tok.span;
    Expr *e = NULL;
    if (parse_expect(p, TOK_LPAREN, "`(`")) {
        if (turn && p->glsl && starts_declaration(p)) e = declared_condition(p, turn);
        else e = p->glsl ? parse_comma_expr(p) : parse_expr(p);
        parse_close(p, TOK_RPAREN, "`)`", open);
        if (p->panic && !p->stopped) parse_skip_to_close(p, TOK_RPAREN, false);
    } else if (!p->stopped) {
        /* `if x > 0 {`: on to the body. */
        while (!parse_at(p, TOK_EOF) && !parse_at(p, TOK_LBRACE) && !parse_at(p, TOK_RBRACE) &&
               !parse_at(p, TOK_SEMICOLON))
            parse_advance(p);
        p->panic = p->stopped;
    }
    st->span = parse_span_from(p, keyword);
    if (!e) {
        e = ARENA_NEW(&p->s->module, Expr);
        e->kind = E_ERROR;
        e->span = e->op_span = st->span;
        e->depth = 1;
    }
    return e;
}

/* One `if`; the `else if` chain is a loop, since it may be long. */
static Stmt *if_chain(Parser *p) {
    Stmt *first = NULL, **end = &first;
    AttrVec attrs = {0};
    uint32_t links = 0;
    for (;;) {
        Stmt *st = new_stmt(p, S_IF, p->tok.span);
        attrs_to_stmt(p, &attrs, &st->attrs);
        *end = st;
        end = &st->orelse;
        parse_advance(p);
        st->expr = header_condition(p, st, st->span, NULL);
        st->body = parse_statement(p);
        if (p->to_file_scope || !parse_accept(p, TOK_ELSE)) break;
        links++;
        if (++p->stmt_depth > MAX_STMT_DEPTH) {
            parse_error(p, DIAG_chain_limit, p->tok.span, "this `else if` chain has more than %d links",
                        MAX_STMT_DEPTH);
            parse_stop(p);
            break;
        }
        Lexer before = p->lx;
        Token before_tok = p->tok;
        uint32_t before_end = p->prev_end;
        parse_attributes(p, &attrs);
        if (parse_at(p, TOK_IF) && !p->panic) continue;
        /* The attributes belong to another statement, which reads them again (an error is reported only once
         * all the same). */
        if (!p->stopped) {
            p->lx = before;
            p->tok = before_tok;
            p->prev_end = before_end;
            *end = parse_statement(p);
        }
        break;
    }
    p->stmt_depth -= links;
    return first;
}

static Stmt *for_loop(Parser *p) {
    Stmt *st = new_stmt(p, S_FOR, p->tok.span);
    Span keyword = p->tok.span, open;
    Stmt *turn = NULL;
    parse_advance(p);
    open = p->tok.span;
    if (parse_expect(p, TOK_LPAREN, "`(`")) {
        if (starts_declaration(p)) {
            st->init = declaration(p);
        } else if (!parse_at(p, TOK_SEMICOLON)) {
            st->init = new_stmt(p, S_EXPR, p->tok.span);
            st->init->expr = parse_comma_expr(p);
            st->init->span = st->init->expr->span;
        }
        parse_expect(p, TOK_SEMICOLON, "`;` after the first part of `for`");
        if (p->glsl && starts_declaration(p)) st->expr = declared_condition(p, &turn);
        else if (!parse_at(p, TOK_SEMICOLON) && !p->panic) st->expr = parse_comma_expr(p);
        parse_expect(p, TOK_SEMICOLON, "`;` after the condition of `for`");
        if (!parse_at(p, TOK_RPAREN) && !p->panic) st->step = parse_comma_expr(p);
        parse_close(p, TOK_RPAREN, "`)`", open);
        if (p->panic && !p->stopped) parse_skip_to_close(p, TOK_RPAREN, true);
    } else if (!p->stopped) {
        while (!parse_at(p, TOK_EOF) && !parse_at(p, TOK_LBRACE) && !parse_at(p, TOK_RBRACE)) parse_advance(p);
        p->panic = p->stopped;
    }
    st->span = parse_span_from(p, keyword);
    st->body = loop_body(p, turn);
    return st;
}

static Stmt *do_loop(Parser *p) {
    Span keyword = p->tok.span;
    Stmt *st = new_stmt(p, S_DO, keyword);
    parse_advance(p);
    st->body = parse_statement(p);
    Stmt header = {0};
    Span tail = p->tok.span;
    if (parse_expect(p, TOK_WHILE, "`while` of `do`")) {
        st->expr = header_condition(p, &header, tail, NULL);
        parse_semicolon(p, "`do … while (…)`");
    }
    st->span = keyword;
    if (!st->expr) {
        st->expr = ARENA_NEW(&p->s->module, Expr);
        *st->expr = (Expr){.kind = E_ERROR, .span = keyword, .op_span = keyword, .depth = 1};
    }
    return st;
}

static Stmt *switch_statement(Parser *p) {
    Stmt *st = new_stmt(p, S_SWITCH, p->tok.span);
    Span keyword = p->tok.span;
    Vec(SwitchCase) cases = {0};
    parse_advance(p);
    st->expr = header_condition(p, st, keyword, NULL);
    Span open = p->tok.span;
    if (!parse_expect(p, TOK_LBRACE, "`{` of `switch`")) return st;
    while (!parse_at(p, TOK_RBRACE) && !parse_at(p, TOK_EOF) && !p->to_file_scope) {
        uint32_t start = p->ntaken;
        SwitchCase c = {.span = p->tok.span};
        StmtVec body = {0};
        if (parse_accept(p, TOK_DEFAULT)) {
            c.is_default = true;
        } else if (parse_accept(p, TOK_CASE)) {
            c.label_expr = parse_cond_expr(p);
        } else {
            parse_error(p, DIAG_syntax, p->tok.span, "expected `case` or `default` before %s",
                        lex_describe(p->s, &p->tok));
        }
        c.span = parse_span_from(p, c.span);
        parse_expect(p, TOK_COLON, "`:`");
        if (p->panic) {
            /* To the next label, statement or the end of this one. */
            while (!parse_at(p, TOK_EOF) && !parse_at(p, TOK_SEMICOLON) && !parse_at(p, TOK_COLON) &&
                   !parse_at(p, TOK_RBRACE) && !parse_at(p, TOK_LBRACE) &&
                   !(p->tok.first_on_line && p->ntaken != start && starts_statement(p)))
                parse_advance(p);
            if (!p->stopped) p->panic = false;
            if (parse_at(p, TOK_COLON) || parse_at(p, TOK_SEMICOLON)) parse_advance(p);
        }
        while (!parse_at(p, TOK_RBRACE) && !parse_at(p, TOK_EOF) && !parse_at(p, TOK_CASE) &&
               !parse_at(p, TOK_DEFAULT) && !p->to_file_scope) {
            uint32_t before = p->ntaken;
            Stmt *inner = parse_statement(p);
            vec_push(&p->s->module, &body, inner);
            if (p->ntaken == before && !p->to_file_scope) parse_advance(p);
        }
        c.body = body.data;
        c.nbody = body.len;
        if (c.is_default || c.label_expr) vec_push(&p->s->module, &cases, c);
        if (p->ntaken == start && !p->to_file_scope) parse_advance(p);
    }
    if (!p->to_file_scope) parse_close(p, TOK_RBRACE, "`}` of `switch`", open);
    st->cases = cases.data;
    st->ncases = cases.len;
    return st;
}

Stmt *parse_block(Parser *p) {
    Span open = p->tok.span;
    Stmt *st = new_stmt(p, S_BLOCK, open);
    StmtVec stmts = {0};
    parse_advance(p);
    while (!parse_at(p, TOK_RBRACE) && !parse_at(p, TOK_EOF) && !p->to_file_scope) {
        uint32_t before = p->ntaken;
        if (starts_file_scope(p->tok.kind)) {
            bool indented = p->tok.span.pos > 0 && !strchr("\n\r", p->lx.text[p->tok.span.pos - 1]);
            if (indented && (parse_at(p, TOK_STRUCT) || parse_at(p, TOK_TYPEDEF))) {
                parse_complain(p, DIAG_syntax, p->tok.span, "`%s` stands at file scope only", p->tok.text);
                parse_skip_struct(p);
                continue;
            }
            leave_function(p, open, "expected `}` before %s");
            break;
        }
        if (parse_at_function(p)) {
            leave_function(p, open, "a function cannot stand inside a function; is a `}` missing before %s?");
            break;
        }
        Stmt *inner = parse_statement(p);
        vec_push(&p->s->module, &stmts, inner);
        if (p->ntaken == before && !p->to_file_scope) parse_advance(p);
    }
    if (!p->to_file_scope) parse_close(p, TOK_RBRACE, "`}`", open);
    st->stmts = stmts.data;
    st->nstmts = stmts.len;
    return st;
}

/* ---- simple statements ---- */

static Stmt *print_or_assert(Parser *p, StmtKind kind) {
    Stmt *st = new_stmt(p, kind, p->tok.span);
    parse_advance(p);
    Span open = p->tok.span;
    parse_advance(p);
    st->args = parse_arguments(p, open, true, &st->nargs);
    st->span = parse_span_from(p, st->span);
    vec_push(&p->s->module, &p->prints, st);
    parse_semicolon(p, kind == S_PRINT ? "`print(…)`" : "`assert(…)`");
    return st;
}

static Stmt *jump(Parser *p, StmtKind kind, const char *what) {
    Stmt *st = new_stmt(p, kind, p->tok.span);
    parse_advance(p);
    bool valueless =
        parse_at(p, TOK_SEMICOLON) || parse_at(p, TOK_RBRACE) || (p->tok.first_on_line && starts_statement(p));
    if (kind == S_RETURN && !valueless && !p->panic) {
        st->expr = parse_at(p, TOK_LBRACE) ? parse_initialiser(p) : parse_expr(p);
        if (st->expr->kind == E_LIST && !p->glsl) {
            parse_complain(p, DIAG_syntax, st->expr->span,
                           "a list in braces initialises a declaration; it cannot be returned");
            st->expr->kind = E_ERROR;
        }
    }
    st->span = parse_span_from(p, st->span);
    parse_semicolon(p, what);
    return st;
}

static Stmt *simple(Parser *p) {
    parse_skip_foreign_words(p);
    const Token t = p->tok;
    if (starts_declaration(p)) {
        Stmt *st = declaration(p);
        parse_semicolon(p, "the declaration");
        return st;
    }
    if (p->glsl && t.kind == TOK_IDENT && !strcmp(t.text, "discard")) return glsl_discard(p);
    if (t.kind == TOK_IDENT && parse_peek(p, 1).kind == TOK_LPAREN) {
        if (!strcmp(t.text, "print")) return print_or_assert(p, S_PRINT);
        if (!strcmp(t.text, "assert")) return print_or_assert(p, S_ASSERT);
    }
    if (t.kind == TOK_RBRACE || t.kind == TOK_EOF) {
        parse_error(p, DIAG_syntax, t.span, "expected a statement before %s", lex_describe(p->s, &t));
        return new_stmt(p, S_EMPTY, t.span);
    }
    Stmt *st = new_stmt(p, S_EXPR, t.span);
    st->expr = parse_comma_expr(p);
    st->span = parse_span_from(p, t.span);
    parse_semicolon(p, "the expression");
    return st;
}

static Stmt *unmarked(Parser *p) {
    Span span = p->tok.span;
    switch ((int)p->tok.kind) {
    case TOK_LBRACE: return parse_block(p);
    case TOK_IF: return if_chain(p);
    case TOK_FOR: return for_loop(p);
    case TOK_DO: return do_loop(p);
    case TOK_SWITCH: return switch_statement(p);
    case TOK_BREAK: return jump(p, S_BREAK, "`break`");
    case TOK_CONTINUE: return jump(p, S_CONTINUE, "`continue`");
    case TOK_RETURN: return jump(p, S_RETURN, "`return`");
    case TOK_SEMICOLON: parse_advance(p); return new_stmt(p, S_EMPTY, span);
    case TOK_WHILE: {
        Stmt *st = new_stmt(p, S_WHILE, span);
        parse_advance(p);
        Stmt *turn = NULL;
        st->expr = header_condition(p, st, span, &turn);
        st->body = loop_body(p, turn);
        return st;
    }
    case TOK_ELSE:
        parse_complain(p, DIAG_syntax, span, "`else` without `if`");
        parse_advance(p);
        return parse_statement(p);
    case TOK_CASE:
    case TOK_DEFAULT:
        parse_error(p, DIAG_syntax, span, "`%s` stands directly in a `switch` only", p->tok.text);
        parse_advance(p);
        return new_stmt(p, S_EMPTY, span);
    default: return simple(p);
    }
}

Stmt *parse_statement(Parser *p) {
    Span span = p->tok.span;
    if (p->panic) return new_stmt(p, S_EMPTY, span);
    if (p->stmt_nest + 1 > MAX_NEST) {
        diag_emit(p->s, DIAG_nesting_limit, span, "statements", MAX_NEST);
        parse_stop(p);
        return new_stmt(p, S_EMPTY, span);
    }
    p->stmt_nest++;
    p->stmt_depth++;
    AttrVec attrs;
    bool marked = parse_attributes(p, &attrs);
    Stmt *st;
    if (marked && (starts_file_scope(p->tok.kind) || parse_at(p, TOK_RBRACE) || parse_at(p, TOK_EOF))) {
        /* `[Domain(…)] shader …` behind an unclosed function; the block sees the keyword next. */
        if (parse_at(p, TOK_RBRACE))
            parse_complain(p, DIAG_bad_attribute, attrs.data[0].span,
                           "this attribute marks nothing: no statement follows");
        st = new_stmt(p, S_EMPTY, span);
    } else {
        st = unmarked(p);
        /* An `else if` chain returns its first link. */
        attrs_to_stmt(p, &attrs, &st->attrs);
    }
    if (p->panic && !p->stopped && !p->to_file_scope) synchronise(p);
    p->stmt_nest--;
    p->stmt_depth--;
    return st;
}
