/* Expressions: names, operators, fields, assignment. */
#include "compiler/front/check/internal.h"

#include <float.h>
#include <math.h>
#include <string.h>

static const char *operator_text(Operator op) {
    static const char *const text[] = {
        [OPR_NONE] = "=",  [OPR_ADD] = "+", [OPR_SUB] = "-",   [OPR_MUL] = "*",  [OPR_DIV] = "/",
        [OPR_MOD] = "%",   [OPR_AND] = "&", [OPR_OR] = "|",    [OPR_XOR] = "^",  [OPR_SHL] = "<<",
        [OPR_SHR] = ">>",  [OPR_EQ] = "==", [OPR_NE] = "!=",   [OPR_LT] = "<",   [OPR_LE] = "<=",
        [OPR_GT] = ">",    [OPR_GE] = ">=", [OPR_LAND] = "&&", [OPR_LOR] = "||", [OPR_NOT] = "!",
        [OPR_COMPL] = "~", [OPR_NEG] = "-", [OPR_PLUS] = "+",  [OPR_INC] = "++", [OPR_DEC] = "--"};
    return text[op];
}

static Expr *bad_operands(Checker *c, Expr *e, const char *op, const char *hint) {
    diag_emit(c->s, DIAG_bad_operands, e->op_span, op, e->a[0]->type->name, e->a[1]->type->name, hint);
    return fail(c, e);
}

static Expr *typed(Checker *c, Expr *e, Type *t) {
    e->type = t;
    const_fold(c, e);
    return e;
}

static bool any_error(const Expr *e) {
    for (int i = 0; i < 3; i++)
        if (e->a[i] && e->a[i]->type && e->a[i]->type->kind == T_ERROR) return true;
    return false;
}

Expr *check_value(Checker *c, Expr *e) {
    e = check_expr(c, e);
    if (e->type->kind == T_VOID) {
        diag_emit(c->s, DIAG_void_value, e->span, "call");
        return fail(c, e);
    }
    if (type_is_resource(e->type)) {
        diag_emit(c->s, DIAG_bad_resource, e->span,
                  arena_printf(&c->s->session, "a %s is not a value: call a method of it or pass it to a function",
                               e->type->name));
        return fail(c, e);
    }
    return e;
}

/* ---- names */

static Expr *language_constant(Checker *c, Expr *e) {
    double v;
    if (e->name == c->name_pi) v = 3.14159265358979323846;
    else if (e->name == c->name_tau) v = 6.28318530717958647692;
    else if (e->name == c->name_infinity) v = INFINITY;
    else if (e->name == c->name_epsilon) v = c->opt && c->opt->f64 ? DBL_EPSILON : (double)FLT_EPSILON;
    else return NULL;
    e->kind = E_LITERAL;
    e->cval.n = 1;
    e->cval.v[0].f = v;
    return typed(c, e, c->t_float);
}

static Expr *check_name(Checker *c, Expr *e) {
    Binding *b = map_get(&c->at.locals, e->name);
    if (b) {
        e->sym = b->sym;
        return typed(c, e, b->sym->type);
    }
    Decl *d = scope_find(c, e->name, e->span);
    if (!d) {
        if (language_constant(c, e)) return e;
        if (map_get(&c->builtin_funcs, e->name) || e->name == c->name_len)
            diag_emit(c->s, DIAG_not_a_value, e->span, e->name, "builtin function");
        else diag_emit(c->s, DIAG_unknown_name, e->span, e->name, suggest(c, e->name, false));
        return fail(c, e);
    }
    switch (d->kind) {
    case DECL_ERROR: return fail(c, e);
    case DECL_CONST: check_const_decl(c, d->sym, scope_of(c, d->module)); break;
    case DECL_PARAM: check_param_decl(c, d->sym, scope_of(c, d->module)); break;
    case DECL_FUNC:
    case DECL_STRUCT:
    case DECL_TYPEDEF: {
        Diag *diag = diag_emit(c->s, DIAG_not_a_value, e->span, e->name, decl_what(d));
        diag_note(c->s, diag, d->span, "`%s` is declared here", d->name);
        return fail(c, e);
    }
    }
    e->sym = d->sym;
    if (!d->sym->type) { /* the symbol's own value is being checked right now */
        diag_emit(c->s, DIAG_cyclic_const, d->span, d->name);
        return fail(c, e);
    }
    return typed(c, e, d->sym->type);
}

/* ---- operators */

/* `*` and `/` with a matrix. NULL: not such a product. */
static Type *matrix_product(Checker *c, Expr *e) {
    Type *a = e->a[0]->type, *b = e->a[1]->type;
    bool ma = a->kind == T_MATRIX, mb = b->kind == T_MATRIX;
    if (e->op == OPR_MUL && ma && mb) return a->columns == b->n ? type_matrix(c->s, a->n, b->columns) : NULL;
    if (ma && is_scalar(b) && b->kind != T_BOOL && (e->op == OPR_MUL || e->op == OPR_DIV)) {
        e->a[1] = convert_scalar_kind(c, e->a[1], T_FLOAT, false);
        return a;
    }
    if (e->op != OPR_MUL) return NULL;
    if (mb && is_scalar(a) && a->kind != T_BOOL) {
        e->a[0] = convert_scalar_kind(c, e->a[0], T_FLOAT, false);
        return b;
    }
    Type *v = ma ? b : a;
    if (v->kind != T_VECTOR || v->n != (ma ? a->columns : b->n) || scalar_kind(v) == T_BOOL) return NULL;
    Expr **side = &e->a[ma ? 1 : 0];
    *side = convert_scalar_kind(c, *side, T_FLOAT, false);
    return ma ? type_vector(c->s, T_FLOAT, a->n) : type_row(b);
}

/* GLSL: a scalar and a matrix, component by component. NULL: it is none. */
static Type *component_wise(Checker *c, Expr *e) {
    int scalar = is_scalar(e->a[1]->type);
    const Type *t = e->a[scalar]->type;
    if (!is_scalar(t) || t->kind == T_BOOL || e->op < OPR_ADD || e->op > OPR_DIV) return NULL;
    e->a[scalar] = convert_scalar_kind(c, e->a[scalar], T_FLOAT, false);
    return e->a[!scalar]->type;
}

static const char *operand_hint(Type *a, Type *b, Operator op) {
    bool ma = a->kind == T_MATRIX, mb = b->kind == T_MATRIX;
    if (ma || mb) return is_scalar(a) || is_scalar(b) ? ": a matrix from a scalar is an error" : "";
    if (is_aggregate(a) || is_aggregate(b))
        return op == OPR_EQ || op == OPR_NE ? ": compare their fields or elements" : "";
    if (width_of(a) && width_of(b) && (scalar_kind(a) == T_BOOL) != (scalar_kind(b) == T_BOOL))
        return ": nothing converts to or from bool";
    if (width_of(a) > 1 && width_of(b) > 1 && width_of(a) != width_of(b)) return ": their sizes differ";
    return "";
}

Expr *check_binary_typed(Checker *c, Expr *e) {
    if (any_error(e)) return fail(c, e);
    const char *text = operator_text(e->op);
    Type *a = e->a[0]->type, *b = e->a[1]->type;
    if (in_glsl(c) && a == b && (is_aggregate(a) || a->kind == T_MATRIX) && (e->op == OPR_EQ || e->op == OPR_NE))
        return typed(c, e, c->t_bool);
    if (a->kind == T_MATRIX || b->kind == T_MATRIX) {
        Expr *first = e->a[0];
        if (e->op == OPR_MUL && in_glsl(c) && !is_scalar(a) && !is_scalar(b)) /* (M v)ᵀ = vᵀ Mᵀ, and Mᵀ is stored */
            e->a[0] = e->a[1], e->a[1] = first;
        Type *t = matrix_product(c, e);
        if (!t && a == b && (e->op == OPR_ADD || e->op == OPR_SUB || (e->op == OPR_DIV && in_glsl(c)))) t = a;
        if (!t && in_glsl(c)) t = component_wise(c, e);
        if (!t) { /* in the order of the source */
            if (e->a[0]->type != a) e->a[1] = e->a[0], e->a[0] = first;
            return bad_operands(c, e, text, operand_hint(a, b, e->op));
        }
        return typed(c, e, t);
    }
    bool compare = e->op >= OPR_EQ && e->op <= OPR_GE, bits = e->op >= OPR_AND && e->op <= OPR_XOR,
         shift = e->op == OPR_SHL || e->op == OPR_SHR;
    Type *t = unify(c, a, b);
    if (!t || !width_of(t)) return bad_operands(c, e, text, operand_hint(a, b, e->op));
    TypeKind k = scalar_kind(t);
    if (shift) { /* the result has the type of the left operand, the count only loses its upper bits */
        if (scalar_kind(a) == T_FLOAT || scalar_kind(b) == T_FLOAT || k == T_BOOL)
            return bad_operands(c, e, text, ": shifts are of integers");
        t = with_width(c, scalar_kind(a), width_of(t));
        e->a[0] = convert(c, e->a[0], t, CONV_BROADCAST);
        e->a[1] = convert_scalar_kind(c, e->a[1], scalar_kind(t), false);
        e->a[1] = convert(c, e->a[1], t, CONV_BROADCAST);
        return typed(c, e, t);
    }
    if (k == T_BOOL && !(e->op == OPR_EQ || e->op == OPR_NE || bits))
        return bad_operands(c, e, text, ": nothing converts to or from bool");
    if (k == T_FLOAT && e->op == OPR_MOD && in_glsl(c))
        return bad_operands(c, e, text, ": it is of integers, `mod(x, y)` of floats");
    if (k == T_FLOAT && bits) return bad_operands(c, e, text, ": bit operations are of integers and bools");
    e->a[0] = convert(c, e->a[0], t, CONV_BROADCAST);
    e->a[1] = convert(c, e->a[1], t, CONV_BROADCAST);
    bool whole =
        (e->op == OPR_EQ || e->op == OPR_NE) && width_of(t) > 1 && in_glsl(c); /* there == is of whole vectors */
    e = typed(c, e, compare ? with_width(c, T_BOOL, width_of(t)) : t);
    if (!whole) return e;
    Expr *all = new_expr(c, E_BUILTIN, e, c->t_bool);
    all->builtin = e->op == OPR_EQ ? B_all : B_any;
    all->args = ARENA_NEW(c->arena, Expr *);
    all->args[0] = e;
    all->nargs = 1;
    return typed(c, all, c->t_bool);
}

static Expr *check_unary(Checker *c, Expr *e) {
    e->a[0] = check_value(c, e->a[0]);
    Type *t = e->a[0]->type;
    if (t->kind == T_ERROR) return fail(c, e);
    TypeKind k = scalar_kind(t);
    bool ok = false;
    switch (e->op) {
    case OPR_NEG:
    case OPR_PLUS: ok = k == T_INT || k == T_UINT || k == T_FLOAT; break;
    case OPR_NOT: ok = k == T_BOOL; break;
    case OPR_COMPL: ok = k == T_INT || k == T_UINT; break;
    default: break;
    }
    if (!ok) {
        diag_emit(c->s, DIAG_bad_operand, e->op_span, operator_text(e->op), t->name);
        return fail(c, e);
    }
    return typed(c, e, t);
}

Expr *check_condition(Checker *c, Expr *e, const char *what) {
    e = check_value(c, e);
    Type *t = e->type;
    if (t->kind == T_ERROR || t->kind == T_BOOL) return e;
    const char *hint = t->kind == T_VECTOR && scalar_kind(t) == T_BOOL ? ": use `any` or `all`"
                       : is_scalar(t)                                  ? ": compare, as in `v != 0`"
                                                                       : "";
    diag_emit(c->s, DIAG_cond_not_bool, e->span, what, t->name, hint);
    Expr *n = new_expr(c, E_CONVERT, e, c->t_error);
    n->a[0] = e;
    return n;
}

static Expr *check_logic(Checker *c, Expr *e) {
    const char *what = e->op == OPR_LAND ? "an operand of `&&`" : "an operand of `||`";
    e->a[0] = check_condition(c, e->a[0], what);
    e->a[1] = check_condition(c, e->a[1], what);
    return any_error(e) ? fail(c, e) : typed(c, e, c->t_bool);
}

static Expr *check_cond(Checker *c, Expr *e) {
    e->a[0] = check_condition(c, e->a[0], "the condition of `?:`");
    e->a[1] = check_value(c, e->a[1]);
    e->a[2] = check_value(c, e->a[2]);
    if (any_error(e)) return fail(c, e);
    Type *t = unify(c, e->a[1]->type, e->a[2]->type);
    if (!t) {
        diag_emit(c->s, DIAG_bad_operands, e->op_span, "?:", e->a[1]->type->name, e->a[2]->type->name,
                  operand_hint(e->a[1]->type, e->a[2]->type, e->op));
        return fail(c, e);
    }
    e->a[1] = convert(c, e->a[1], t, CONV_BROADCAST);
    e->a[2] = convert(c, e->a[2], t, CONV_BROADCAST);
    return typed(c, e, t);
}

/* ---- assignment */

static void report_not_place(Checker *c, Expr *e) {
    Symbol *root = place_root(e);
    const char *what = "the result of an expression";
    for (Expr *p = e; p->kind == E_SWIZZLE || p->kind == E_INDEX || p->kind == E_FIELD; p = p->a[0]) {
        if (p->kind != E_SWIZZLE) continue;
        for (int i = 0; i < p->nswz; i++)
            for (int j = 0; j < i; j++)
                if (p->swz[i] == p->swz[j]) what = "a swizzle that repeats a component";
    }
    Span at = e->span;
    bool named = false;
    if (root && what[0] == 't') {
        named = root->kind == SYM_CONST || root->kind == SYM_PARAM || (root->kind == SYM_LOCAL && root->is_const) ||
                type_is_resource(root->type);
        if (named)
            what = arena_printf(&c->s->session, "%s `%s`",
                                root->kind == SYM_PARAM        ? in_glsl(c) ? "uniform" : "parameter"
                                : type_is_resource(root->type) ? "resource"
                                                               : "constant",
                                root->name);
    }
    Diag *d = diag_emit(c->s, DIAG_not_assignable, at, what);
    if (named) diag_note(c->s, d, root->span, "`%s` is declared here", root->name);
}

/* The right side of `place op= value`, brought to what the operation wants. */
static bool check_compound(Checker *c, Expr *e) {
    Type *t = e->a[0]->type;
    if (is_texture_result(e->a[1]) && is_numeric(t) && scalar_kind(t) == T_FLOAT && width_of(t) < 4)
        e->a[1] = convert(c, e->a[1], t, CONV_NARROW);
    Expr probe = *e; /* the same operands under the binary operator */
    probe.kind = E_BINARY;
    Expr *r = check_binary_typed(c, &probe);
    if (r->type->kind == T_ERROR) return false;
    if (r->type != t) {
        diag_emit(c->s, DIAG_cannot_convert, e->op_span, r->type->name, t->name,
                  width_of(r->type) == width_of(t) ? arena_printf(&c->s->session, ": write `= %s(...)`", t->name)
                                                   : ": the operation gives more components than the left side has");
        return false;
    }
    e->a[1] = probe.a[1];
    return true;
}

/* v *= M is v = v * M, whose operands are exchanged; for `op=` gen knows one order only. */
static void spell_out_product(Checker *c, Expr *e) {
    if (e->op != OPR_MUL || e->a[1]->type->kind != T_MATRIX || !in_glsl(c) || is_scalar(e->a[0]->type)) return;
    Expr *product = new_expr(c, E_BINARY, e, NULL);
    product->op = OPR_MUL;
    product->a[0] = e->a[0];
    product->a[1] = e->a[1];
    e->a[1] = check_binary_typed(c, product);
    e->op = OPR_NONE;
}

static Expr *check_assign(Checker *c, Expr *e) {
    e->a[0] = check_expr(c, e->a[0]);
    if (e->a[1]->kind == E_LIST && e->op == OPR_NONE && !e->a[1]->type) e->a[1] = check_init(c, e->a[1], e->a[0]->type);
    else e->a[1] = check_value(c, e->a[1]);
    if (e->a[0]->type->kind == T_ERROR) return fail(c, e);
    if (!is_place(e->a[0])) {
        report_not_place(c, e->a[0]);
        return fail(c, e);
    }
    if (any_error(e)) return fail(c, e);
    spell_out_product(c, e);
    if (e->op == OPR_NONE) {
        e->a[1] = convert(c, e->a[1], e->a[0]->type, CONV_BROADCAST | CONV_NARROW);
        if (any_error(e)) return fail(c, e);
    } else if (!check_compound(c, e)) {
        return fail(c, e);
    }
    e->type = e->a[0]->type;
    return e;
}

static Expr *check_incdec(Checker *c, Expr *e) {
    e->a[0] = check_expr(c, e->a[0]);
    Type *t = e->a[0]->type;
    if (t->kind == T_ERROR) return fail(c, e);
    if (!is_place(e->a[0])) {
        report_not_place(c, e->a[0]);
        return fail(c, e);
    }
    if (!is_numeric(t) && !(t->kind == T_MATRIX && in_glsl(c))) {
        diag_emit(c->s, DIAG_bad_operand, e->op_span, operator_text(e->op), t->name);
        return fail(c, e);
    }
    e->type = t;
    return e;
}

/* ---- parts */

static Expr *check_index(Checker *c, Expr *e) {
    e->a[0] = check_expr(c, e->a[0]);
    e->a[1] = check_value(c, e->a[1]);
    if (any_error(e)) return fail(c, e);
    Type *t = e->a[0]->type, *i = e->a[1]->type;
    if (t->kind != T_ARRAY && t->kind != T_VECTOR && t->kind != T_MATRIX) {
        diag_emit(c->s, DIAG_bad_index, e->a[0]->span, arena_printf(&c->s->session, "%s cannot be indexed", t->name));
        return fail(c, e);
    }
    if (i->kind != T_INT && i->kind != T_UINT) {
        diag_emit(c->s, DIAG_bad_index, e->a[1]->span,
                  arena_printf(&c->s->session, "an index is an int or a uint, this is %s%s", i->name,
                               i->kind == T_FLOAT ? ": write `int(...)`" : ""));
        return fail(c, e);
    }
    /* GLSL calls it an error; in the language constants that --set changes may make such a branch, which is not run. */
    if (in_glsl(c) && e->a[1]->is_const && e->a[1]->cval.n == 1 && (uint64_t)e->a[1]->cval.v[0].i >= t->n) {
        diag_emit(c->s, DIAG_bad_index, e->a[1]->span,
                  arena_printf(&c->s->session, "there is no [%lld] in %s: its indices are 0 to %u",
                               (long long)e->a[1]->cval.v[0].i, t->name, t->n - 1));
        return fail(c, e);
    }
    return typed(c, e, t->kind == T_MATRIX ? type_row(t) : t->elem);
}

static Expr *bad_swizzle(Checker *c, Expr *e, const char *hint) {
    diag_emit(c->s, DIAG_bad_swizzle, e->op_span, e->name, e->a[0]->type->name, hint);
    return fail(c, e);
}

static Expr *check_swizzle(Checker *c, Expr *e) {
    static const char sets[3][5] = {"xyzw", "rgba", "stpq"};
    uint32_t width = width_of(e->a[0]->type);
    size_t n = strlen(e->name);
    if (n < 1 || n > 4) return bad_swizzle(c, e, ": it has one to four letters");
    int set = strchr(sets[1], e->name[0]) ? 1 : in_glsl(c) && strchr(sets[2], e->name[0]) ? 2 : 0;
    for (size_t i = 0; i < n; i++) {
        const char *at = strchr(sets[set], e->name[i]);
        if (!at)
            return bad_swizzle(c, e,
                               strchr(sets[set == 0], e->name[i]) ? ": `xyzw` and `rgba` do not mix"
                                                                  : ": letters are `xyzw` or `rgba`");
        if ((uint32_t)(at - sets[set]) >= width)
            return bad_swizzle(c, e, arena_printf(&c->s->session, ": there is no `%c`", e->name[i]));
        e->swz[i] = (uint8_t)(at - sets[set]);
    }
    e->kind = E_SWIZZLE;
    e->nswz = (uint8_t)n;
    /* v.zyx.xy is one swizzle of v, so that a place has at most one */
    if (e->a[0]->kind == E_SWIZZLE) {
        for (size_t i = 0; i < n; i++) e->swz[i] = e->a[0]->swz[e->swz[i]];
        e->a[0] = e->a[0]->a[0];
    }
    return typed(c, e, with_width(c, scalar_kind(e->a[0]->type), (uint32_t)n));
}

static Expr *check_field(Checker *c, Expr *e) {
    e->a[0] = check_expr(c, e->a[0]);
    Type *t = e->a[0]->type;
    if (t->kind == T_ERROR) return fail(c, e);
    if (t->kind == T_VECTOR || is_scalar(t)) {
        /* `1.0.xxx` works as in Slang: a scalar is a vector of one, which only repeats */
        if (t->kind == T_VECTOR) return check_swizzle(c, e);
        for (const char *p = e->name; *p; p++)
            if ((*p != 'x' && *p != 'r') || *p != e->name[0] || p - e->name > 3)
                return bad_swizzle(c, e, ": a scalar has only `x`");
        uint32_t n = (uint32_t)strlen(e->name);
        if (n == 1) return e->a[0];
        e->kind = E_BROADCAST;
        return typed(c, e, type_vector(c->s, t->kind, n));
    }
    if (t->kind != T_STRUCT) {
        diag_emit(c->s, DIAG_unknown_field, e->op_span, t->name, e->name,
                  type_is_resource(t) ? ": its methods are called, as `t.size()`" : "");
        return fail(c, e);
    }
    for (uint32_t i = 0; i < t->nfields; i++)
        if (t->fields[i].name == e->name || !strcmp(t->fields[i].name, e->name)) {
            e->field = i;
            return typed(c, e, t->fields[i].type);
        }
    if (name_lost(c, e->name)) return fail(c, e);
    const char **names = ARENA_ARRAY(c->arena, const char *, t->nfields);
    for (uint32_t i = 0; i < t->nfields; i++) names[i] = t->fields[i].name;
    const char *near = suggest_nearest(e->name, names, t->nfields);
    Diag *d = diag_emit(c->s, DIAG_unknown_field, e->op_span, t->name, e->name,
                        near ? arena_printf(&c->s->session, ", did you mean `%s`?", near) : "");
    for (uint32_t i = 0; near && i < t->nfields; i++)
        if (t->fields[i].name == near && t->fields[i].span.file >= 0)
            diag_note(c->s, d, t->fields[i].span, "`%s` is declared here", near);
    return fail(c, e);
}

static Expr *check_literal(Checker *c, Expr *e) {
    if (!e->type) {
        diag_emit(c->s, DIAG_bad_argument, e->span,
                  "a text stands only in `print`, `assert` and as the file name of a `param`");
        return fail(c, e);
    }
    return typed(c, e, e->type);
}

/* A type name with arguments. */
static Expr *check_type_call(Checker *c, Expr *e) {
    TypeRef ref = {.name = e->name, .span = e->op_span};
    Type *t = resolve_type(c, &ref, false, CHECK_MAX_ARRAY);
    return check_construct(c, e, t);
}

static Expr *check_kind(Checker *c, Expr *e) {
    switch (e->kind) {
    case E_ERROR: return fail(c, e);
    case E_LITERAL: return check_literal(c, e);
    case E_NAME: return check_name(c, e);
    case E_UNARY: return check_unary(c, e);
    case E_BINARY:
        e->a[0] = check_value(c, e->a[0]);
        e->a[1] = check_value(c, e->a[1]);
        return check_binary_typed(c, e);
    case E_LOGIC: return check_logic(c, e);
    case E_COND: return check_cond(c, e);
    case E_ASSIGN: return check_assign(c, e);
    case E_INCDEC: return check_incdec(c, e);
    case E_CALL: return check_call(c, e);
    case E_CONSTRUCT: return check_type_call(c, e);
    case E_METHOD: return check_method(c, e);
    case E_INDEX: return check_index(c, e);
    case E_FIELD: return check_field(c, e);
    case E_LIST:
        if (e->of) return check_list(c, e, resolve_type(c, e->of, false, CHECK_MAX_ARRAY));
        diag_emit(c->s, DIAG_bad_list, e->span, "a list stands only as the value of a declaration");
        for (uint32_t i = 0; i < e->nargs; i++)
            if (e->args[i]->kind != E_LIST) e->args[i] = check_expr(c, e->args[i]);
        return fail(c, e);
    case E_COMMA:
        for (int i = 0; i < 2; i++) {
            e->a[i] = check_expr(c, e->a[i]);
            if (type_is_resource(e->a[i]->type)) e->a[i] = check_value(c, e->a[i]); /* says that it is none */
        }
        e->type = e->a[1]->type;
        return e;
    case E_BUILTIN:
    case E_CONVERT:
    case E_BROADCAST:
    case E_SWIZZLE:
    case E_LEN: break; /* made here, so already typed */
    }
    ice(c->s, "expression kind %d has no type", (int)e->kind);
}

/* Idempotent: sizes of arrays are shared between the declarators of one line. */
Expr *check_expr(Checker *c, Expr *e) {
    if (e->type && e->kind != E_LITERAL) return e;
    enter_depth(c);
    Expr *r = check_kind(c, e);
    c->depth--;
    return r;
}

Expr *check_init(Checker *c, Expr *e, Type *type) {
    if (e->kind == E_LIST && !e->type) return check_list(c, e, type);
    e = check_value(c, e);
    return convert(c, e, type, CONV_BROADCAST | CONV_NARROW);
}
