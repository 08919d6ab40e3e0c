/* Expressions, by precedence climbing; C's precedences. */
#include "compiler/front/parse/internal.h"

#include <string.h>

#include "compiler/front/glsl/glsl.h"

static Expr *new_expr(Parser *p, ExprKind kind, Span span) {
    Expr *e = ARENA_NEW(&p->s->module, Expr);
    e->kind = kind;
    e->span = e->op_span = span;
    e->depth = 1;
    return e;
}

static Expr *error_expr(Parser *p) { return new_expr(p, E_ERROR, p->tok.span); }

/* Every tree passes here: the height is what recursion over the tree costs later. */
static Expr *measured(Parser *p, Expr *e) {
    uint32_t depth = 0;
    for (int i = 0; i < 3; i++)
        if (e->a[i] && e->a[i]->depth > depth) depth = e->a[i]->depth;
    for (uint32_t i = 0; i < e->nargs; i++)
        if (e->args[i]->depth > depth) depth = e->args[i]->depth;
    e->depth = depth + 1;
    if (e->depth > MAX_EXPR_DEPTH) {
        parse_error(p, DIAG_chain_limit, e->op_span, "this expression has more than %d links in a chain",
                    MAX_EXPR_DEPTH);
        parse_stop(p);
        return new_expr(p, E_ERROR, e->op_span);
    }
    return e;
}

static bool enter(Parser *p) {
    if (++p->expr_nest <= MAX_NEST) return true;
    if (!p->panic && !p->stopped) diag_emit(p->s, DIAG_nesting_limit, p->tok.span, "expressions", MAX_NEST);
    parse_stop(p);
    return false;
}

static void leave(Parser *p) { p->expr_nest--; }

/* ---- primary expressions ---- */

static Expr *literal(Parser *p, TypeKind kind, ConstVal value) {
    Expr *e = new_expr(p, E_LITERAL, p->tok.span);
    e->type = type_scalar(kind);
    e->cval = value;
    parse_advance(p);
    return e;
}

static Expr *integer_literal(Parser *p) {
    const Token t = p->tok;
    /* As in HLSL, a literal that does not fit int is uint. */
    bool is_uint = t.is_unsigned || (t.integer > INT32_MAX && !p->glsl); /* there it is a pattern of bits */
    return literal(p, is_uint ? T_UINT : T_INT,
                   (ConstVal){.v = {{.i = is_uint ? (int64_t)t.integer : (int32_t)t.integer}}, .n = 1});
}

Expr *parse_string(Parser *p) {
    Expr *e = new_expr(p, E_LITERAL, p->tok.span);
    e->name = p->tok.text;
    bool broken = p->tok.broken;
    parse_advance(p);
    if (broken) p->panic = true; /* the lexer reported it */
    return e;
}

Expr **parse_arguments(Parser *p, Span open, bool strings, uint32_t *n) {
    ExprVec args = {0};
    *n = 0;
    if (!enter(p)) return NULL;
    if (!parse_at(p, TOK_RPAREN)) {
        do {
            Expr *arg = strings && parse_at(p, TOK_STRING) ? parse_string(p) : parse_expr(p);
            vec_push(&p->s->module, &args, arg);
        } while (parse_accept(p, TOK_COMMA));
    }
    parse_close(p, TOK_RPAREN, "`)` or `,`", open);
    leave(p);
    *n = args.len;
    return args.data;
}

static Expr *call(Parser *p, ExprKind kind, const Token *name) {
    Expr *e = new_expr(p, kind, name->span);
    Span open = p->tok.span;
    e->name = name->text;
    parse_advance(p);
    e->args = parse_arguments(p, open, false, &e->nargs);
    e->span = parse_span_from(p, name->span);
    return measured(p, e);
}

static Expr *unary(Parser *p);

/* `(float)x` and `(Disc)0` are what an HLSL user writes; a user's type is told from a parenthesised name by what
 * follows. */
static bool at_cast(const Parser *p) {
    Token type = parse_peek(p, 1);
    if (type.kind != TOK_TYPE && type.kind != TOK_IDENT) return false;
    if (parse_peek(p, 2).kind != TOK_RPAREN) return false;
    if (type.kind == TOK_TYPE) return true;
    TokenKind k = parse_peek(p, 3).kind;
    return k == TOK_IDENT || k == TOK_INT || k == TOK_FLOAT || k == TOK_TYPE || k == TOK_TRUE || k == TOK_FALSE;
}

static Expr *cast(Parser *p) {
    Span open = p->tok.span;
    parse_advance(p);
    Expr *e = new_expr(p, E_CONSTRUCT, p->tok.span);
    e->name = p->tok.text;
    e->explicit_cast = true;
    parse_advance(p);
    parse_advance(p);
    if (!enter(p)) return e;
    e->args = ARENA_NEW(&p->s->module, Expr *);
    e->args[0] = unary(p);
    e->nargs = 1;
    leave(p);
    e->span = parse_span_from(p, open);
    return measured(p, e);
}

static Expr *parenthesised(Parser *p) {
    Span open = p->tok.span;
    if (!p->glsl && at_cast(p)) return cast(p);
    parse_advance(p);
    if (!enter(p)) return error_expr(p);
    Expr *e = p->glsl ? parse_comma_expr(p) : parse_expr(p);
    if (parse_at(p, TOK_COMMA) && !p->panic)
        parse_error(p, DIAG_syntax, p->tok.span, "a comma does not belong here; a vector is written `float3(a, b, c)`");
    parse_close(p, TOK_RPAREN, "`)`", open);
    leave(p);
    e->parenthesised = true;
    if (!p->panic) e->span = parse_span_from(p, open);
    return e;
}

static Expr *primary(Parser *p) {
    const Token t = p->tok;
    switch (t.kind) {
    case TOK_INT: return integer_literal(p);
    case TOK_FLOAT: return literal(p, T_FLOAT, (ConstVal){.v = {{.f = t.number}}, .n = 1});
    case TOK_TRUE:
    case TOK_FALSE: return literal(p, T_BOOL, (ConstVal){.v = {{.i = t.kind == TOK_TRUE}}, .n = 1});
    case TOK_LPAREN: return parenthesised(p);
    case TOK_IDENT: {
        if (p->glsl && glsl_at_array(p)) return glsl_array(p);
        parse_advance(p);
        if (parse_at(p, TOK_LPAREN)) return call(p, E_CALL, &t);
        Expr *e = new_expr(p, E_NAME, t.span);
        e->name = t.text;
        return e;
    }
    case TOK_TYPE:
        if (p->glsl && glsl_at_array(p)) return glsl_array(p);
        if (parse_peek(p, 1).kind == TOK_LPAREN) {
            parse_advance(p);
            return call(p, E_CONSTRUCT, &t);
        }
        parse_error(p, DIAG_syntax, t.span,
                    "expected an expression before the type `%s`; a value of it is written `%s(…)`", t.text, t.text);
        return error_expr(p);
    case TOK_STRING:
        if (!t.broken)
            parse_complain(p, DIAG_syntax, t.span,
                           "a string stands only in `print`, `assert`, `[Doc]` and as the file of a parameter");
        parse_advance(p);
        p->panic |= t.broken;
        return new_expr(p, E_ERROR, t.span);
    case TOK_LBRACE:
        parse_error(p, DIAG_syntax, t.span, "a list in braces stands only behind the `=` of a declaration");
        return error_expr(p);
    case TOK_IN:
    case TOK_OUT:
    case TOK_INOUT:
    case TOK_PARAM:
    case TOK_SHADER:
        /* Words that a program would use as the name of a variable. */
        parse_reserved(p, &t);
        parse_advance(p);
        return new_expr(p, E_ERROR, t.span);
    default: parse_unexpected(p, "an expression"); return error_expr(p);
    }
}

/* ---- postfix and unary operators ---- */

static Expr *member(Parser *p, Expr *object) {
    Span span;
    parse_advance(p);
    /* Fields are not file-scope names, yet reserved words are reserved everywhere. */
    const char *name = parse_name(p, "a field, swizzle or method", &span);
    if (!name) return error_expr(p);
    Expr *e = new_expr(p, E_FIELD, parse_join(object->span, span));
    e->op_span = span;
    e->name = name;
    e->a[0] = object;
    if (parse_at(p, TOK_LPAREN)) {
        Span open = p->tok.span;
        e->kind = E_METHOD;
        parse_advance(p);
        e->args = parse_arguments(p, open, false, &e->nargs);
        e->span = parse_span_from(p, object->span);
        if (p->glsl && !e->nargs && !strcmp(name, "length")) glsl_length(p, e);
    }
    return measured(p, e);
}

static Expr *postfix(Parser *p) {
    Expr *e = primary(p);
    while (!p->panic) {
        const Token t = p->tok;
        if (t.kind == TOK_DOT) {
            e = member(p, e);
        } else if (t.kind == TOK_LBRACKET) {
            /* On a new line a `[` after a value is more likely an attribute behind a forgotten `;`. */
            if (t.first_on_line && parse_peek(p, 1).kind == TOK_IDENT) {
                TokenKind after = parse_peek(p, 2).kind;
                TokenKind last = parse_peek(p, 3).kind;
                if (after == TOK_RBRACKET &&
                    (last == TOK_IF || last == TOK_FOR || last == TOK_WHILE || last == TOK_DO || last == TOK_RETURN ||
                     last == TOK_SWITCH || last == TOK_TYPE || last == TOK_LBRACE))
                    break;
            }
            parse_advance(p);
            if (!enter(p)) break;
            Expr *index = new_expr(p, E_INDEX, t.span);
            index->a[0] = e;
            index->a[1] = parse_expr(p);
            parse_close(p, TOK_RBRACKET, "`]`", t.span);
            leave(p);
            index->span = parse_span_from(p, e->span);
            e = measured(p, index);
        } else if (t.kind == TOK_OP && (t.op == OPR_INC || t.op == OPR_DEC)) {
            Expr *step = new_expr(p, E_INCDEC, parse_join(e->span, t.span));
            step->op_span = t.span;
            step->op = t.op;
            step->a[0] = e;
            parse_advance(p);
            e = measured(p, step);
        } else {
            break;
        }
    }
    return e;
}

static Operator unary_operator(const Token *t) {
    if (t->kind != TOK_OP) return OPR_NONE;
    switch ((int)t->op) {
    case OPR_SUB: return OPR_NEG;
    case OPR_ADD: return OPR_PLUS;
    case OPR_NOT:
    case OPR_COMPL:
    case OPR_INC:
    case OPR_DEC: return t->op;
    default: return OPR_NONE;
    }
}

static Expr *unary(Parser *p) {
    const Token t = p->tok;
    Operator op = unary_operator(&t);
    if (op == OPR_NONE || p->panic) return postfix(p);
    parse_advance(p);
    if (!enter(p)) return error_expr(p);
    const Token operand_token = p->tok;
    Expr *operand = unary(p);
    leave(p);
    /* -2147483648 is an int, although 2147483648 alone is not. */
    if (op == OPR_NEG && operand->kind == E_LITERAL && operand_token.kind == TOK_INT && !operand_token.is_unsigned &&
        !operand->parenthesised && operand->type == type_scalar(T_UINT) && operand->cval.v[0].i == 2147483648) {
        operand->type = type_scalar(T_INT);
        operand->cval.v[0].i = INT32_MIN;
        operand->span = parse_join(t.span, operand->span);
        return operand;
    }
    bool step = op == OPR_INC || op == OPR_DEC;
    Expr *e = new_expr(p, step ? E_INCDEC : E_UNARY, parse_join(t.span, operand->span));
    e->op_span = t.span;
    e->op = op;
    e->prefix = step;
    e->a[0] = operand;
    return measured(p, e);
}

/* ---- binary operators ---- */

int parse_precedence(const Token *t) {
    if (t->kind != TOK_OP) return 0;
    switch ((int)t->op) {
    case OPR_LOR: return 1;
    case OPR_LAND: return 2;
    case OPR_OR: return 3;
    case OPR_XOR: return 4;
    case OPR_AND: return 5;
    case OPR_EQ:
    case OPR_NE: return 6;
    case OPR_LT:
    case OPR_LE:
    case OPR_GT:
    case OPR_GE: return 7;
    case OPR_SHL:
    case OPR_SHR: return 8;
    case OPR_ADD:
    case OPR_SUB: return 9;
    case OPR_MUL:
    case OPR_DIV:
    case OPR_MOD: return 10;
    default: return 0;
    }
}

/* Recursion is at most one level a precedence; chains of one precedence are loops. */
static Expr *binary(Parser *p, int least) {
    Expr *left = unary(p);
    int prec;
    while (!p->panic && (prec = parse_precedence(&p->tok)) >= least && prec > 0) {
        const Token t = p->tok;
        parse_advance(p);
        Expr *right = binary(p, prec + 1);
        Expr *e =
            new_expr(p, t.op == OPR_LAND || t.op == OPR_LOR ? E_LOGIC : E_BINARY, parse_join(left->span, right->span));
        e->op_span = t.span;
        e->op = t.op;
        e->a[0] = left;
        e->a[1] = right;
        left = measured(p, e);
    }
    return left;
}

Expr *parse_cond_expr(Parser *p) {
    Expr *test = binary(p, 1);
    if (p->panic || !parse_at(p, TOK_QUESTION)) return test;
    Span op_span = p->tok.span;
    parse_advance(p);
    if (!enter(p)) return error_expr(p);
    Expr *e = new_expr(p, E_COND, op_span);
    e->a[0] = test;
    e->a[1] = p->glsl ? parse_comma_expr(p) : parse_expr(p);
    if (parse_expect(p, TOK_COLON, "`:` of `?:`")) e->a[2] = p->glsl ? parse_expr(p) : parse_cond_expr(p);
    else e->a[2] = error_expr(p);
    leave(p);
    e->span = parse_join(test->span, e->a[2]->span);
    return measured(p, e);
}

Expr *parse_expr(Parser *p) {
    Expr *place = parse_cond_expr(p);
    if (p->panic || !parse_at(p, TOK_ASSIGN)) return place;
    const Token t = p->tok;
    parse_advance(p);
    if (!enter(p)) return error_expr(p);
    Expr *value = parse_at(p, TOK_LBRACE) && !p->panic ? parse_initialiser(p) : parse_expr(p);
    leave(p);
    Expr *e = new_expr(p, E_ASSIGN, parse_join(place->span, value->span));
    if (value->kind == E_LIST && !p->glsl) {
        parse_complain(p, DIAG_syntax, value->span,
                       "a list in braces initialises a declaration; it cannot be assigned");
        value->kind = E_ERROR;
    }
    e->op_span = t.span;
    e->op = t.op;
    e->a[0] = place;
    e->a[1] = value;
    return measured(p, e);
}

Expr *parse_comma_expr(Parser *p) {
    Expr *left = parse_expr(p);
    while (!p->panic && parse_at(p, TOK_COMMA)) {
        Span op_span = p->tok.span;
        parse_advance(p);
        Expr *right = parse_expr(p);
        Expr *e = new_expr(p, E_COMMA, parse_join(left->span, right->span));
        e->op_span = op_span;
        e->a[0] = left;
        e->a[1] = right;
        left = measured(p, e);
    }
    return left;
}

Expr *parse_initialiser(Parser *p) {
    if (p->panic || !parse_at(p, TOK_LBRACE)) return parse_expr(p);
    Span open = p->tok.span;
    Expr *list = new_expr(p, E_LIST, open);
    ExprVec items = {0};
    parse_advance(p);
    if (!enter(p)) return list;
    while (!p->panic && !parse_at(p, TOK_RBRACE) && !parse_at(p, TOK_EOF)) {
        vec_push(&p->s->module, &items, parse_initialiser(p));
        if (!parse_accept(p, TOK_COMMA)) break;
    }
    parse_close(p, TOK_RBRACE, "`}` or `,`", open);
    if (p->panic && !p->stopped) parse_skip_to_close(p, TOK_RBRACE, false);
    leave(p);
    list->args = items.data;
    list->nargs = items.len;
    list->span = parse_span_from(p, open);
    return measured(p, list);
}
