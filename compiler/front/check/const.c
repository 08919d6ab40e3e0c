/* Values known when the program is compiled.
 *
 * Folding runs bottom-up as nodes get their types, so a value is computed once, where it stands, by the rows of
 * ir/ops.def. Floats are kept in double whatever the precision of the program: gen rounds once. Integers wrap to
 * 32 bits at every step, as in the program. Division by zero, shifts and conversions follow the language. */
#include "compiler/front/check/internal.h"

#include <math.h>

#include "compiler/front/rows.h"

int64_t const_wrap(TypeKind k, int64_t v) {
    return k == T_UINT ? (int64_t)(uint32_t)v : k == T_INT ? (int32_t)(uint32_t)v : v;
}

/* The row on one component, as a value of kind k; arguments that the row does not have may be anything. */
static ConstNum apply(Op row, TypeKind k, ConstNum a, ConstNum b, ConstNum c) {
    const OpInfo *o = &ir_ops[row];
    bool f = o->arg == TY_FLT;
    Imm in[3] = {f ? (Imm){.f = a.f} : (Imm){.i = a.i}, f ? (Imm){.f = b.f} : (Imm){.i = b.i},
                 f ? (Imm){.f = c.f} : (Imm){.i = c.i}};
    Imm r = ir_row(row, PREC_F64, in);
    return o->result == TY_FLT ? (ConstNum){.f = r.f} : (ConstNum){.i = const_wrap(k, r.i)};
}

static ConstNum number(double f) { return (ConstNum){.f = f}; }
static double f2(Op row, double a, double b) { return apply(row, T_FLOAT, number(a), number(b), number(0)).f; }
static double f1(Op row, double a) { return f2(row, a, 0); }
static bool holds(Op row, double a, double b) { return apply(row, T_BOOL, number(a), number(b), number(0)).i != 0; }
static double add(double a, double b) { return f2(OP_fadd, a, b); }
static double sub(double a, double b) { return f2(OP_fsub, a, b); }
static double mul(double a, double b) { return f2(OP_fmul, a, b); }
static double divide(double a, double b) { return f2(OP_fdiv, a, b); }

static ConstNum convert_number(TypeKind to, TypeKind from, ConstNum a) {
    static const Op to_float[] = {[T_BOOL] = OP_i2f, [T_INT] = OP_i2f, [T_UINT] = OP_u2f};
    ConstNum zero = {0};
    if (to == from) return a;
    if (to == T_FLOAT) return apply(to_float[from], to, a, zero, zero);
    if (to == T_BOOL) return apply(from == T_FLOAT ? OP_fne : OP_ine, to, a, from == T_FLOAT ? number(0) : zero, zero);
    if (from == T_FLOAT) return apply(to == T_INT ? OP_f2i : OP_f2u, to, a, zero, zero);
    return (ConstNum){.i = const_wrap(to, a.i)};
}

static bool fold_operator(Operator op, TypeKind k, TypeKind result, ConstNum a, ConstNum b, ConstNum *r) {
    bool swap;
    Op row = row_of_operator(op, k, &swap);
    if (k == T_FLOAT && op == OPR_MOD) { /* exact, which a - b*trunc(a/b) of the program is not */
        r->f = fmod(a.f, b.f);
    } else if (k == T_BOOL && op == OPR_EQ) {
        r->i = a.i == b.i;
    } else {
        if (row == OP_COUNT) return false;
        *r = swap ? apply(row, result, b, a, a) : apply(row, result, a, b, b);
    }
    return true;
}

/* Rows times columns: a is ra x n, b is n x cb. */
static void fold_matmul(ConstVal *r, const ConstVal *a, const ConstVal *b, uint32_t ra, uint32_t n, uint32_t cb) {
    for (uint32_t i = 0; i < ra; i++)
        for (uint32_t j = 0; j < cb; j++) {
            double sum = 0;
            for (uint32_t k = 0; k < n; k++) sum = add(sum, mul(a->v[i * n + k].f, b->v[k * cb + j].f));
            r->v[i * cb + j].f = sum;
        }
}

static bool fold_binary(Expr *e) {
    const Type *ta = e->a[0]->type, *tb = e->a[1]->type;
    const ConstVal *a = &e->a[0]->cval, *b = &e->a[1]->cval;
    ConstVal *r = &e->cval;
    bool ma = ta->kind == T_MATRIX, mb = tb->kind == T_MATRIX, matrices = ma || mb;
    if (e->op == OPR_MUL && ma && tb->kind != T_FLOAT) {
        fold_matmul(r, a, b, ta->n, ta->columns, mb ? tb->columns : 1);
        return true;
    }
    if (e->op == OPR_MUL && mb && ta->kind == T_VECTOR) {
        fold_matmul(r, a, b, 1, tb->n, tb->columns);
        return true;
    }
    if (is_aggregate(ta)) return false;
    bool whole = ma && e->type->kind == T_BOOL, all = e->op == OPR_EQ; /* == and != of matrices */
    for (uint32_t i = 0; whole && i < a->n; i++)
        if (a->v[i].f != b->v[i].f) all = !all, i = a->n - 1;
    if (whole) {
        r->v[0].i = all;
        return true;
    }
    for (uint32_t i = 0; i < r->n; i++)
        if (!fold_operator(e->op, scalar_kind(ta), scalar_kind(e->type), a->v[matrices && !ma ? 0 : i],
                           b->v[matrices && !mb ? 0 : i], &r->v[i]))
            return false;
    return true;
}

static bool fold_unary(Expr *e) {
    TypeKind k = scalar_kind(e->type);
    const ConstVal *a = &e->a[0]->cval;
    for (uint32_t i = 0; i < e->cval.n; i++)
        if (e->op == OPR_PLUS) e->cval.v[i] = a->v[i];
        else if (!fold_operator(e->op, k, k, a->v[i], a->v[i], &e->cval.v[i])) return false;
    return true;
}

static double smoothstep(double lo, double hi, double v) {
    double t = divide(sub(v, lo), sub(hi, lo));
    t = f2(OP_fmin, f2(OP_fmax, t, 0), 1);
    return mul(mul(t, t), sub(3, mul(2, t)));
}

/* Component-wise builtins of several rows. */
static bool fold_builtin_float(Builtin f, double a, double b, double x, double *r) {
    switch (f) {
    case B_sign: *r = (double)holds(OP_flt, 0, a) - (double)holds(OP_flt, a, 0); return true;
    case B_frac: *r = sub(a, f1(OP_ffloor, a)); return true;
    case B_fmod: *r = fmod(a, b); return true;
    case B_clamp: *r = f2(OP_fmin, f2(OP_fmax, a, b), x); return true;
    case B_saturate: *r = f2(OP_fmin, f2(OP_fmax, a, 0), 1); return true;
    case B_lerp: *r = add(a, mul(sub(b, a), x)); return true;
    case B_step: *r = holds(OP_fle, a, b); return true;
    case B_smoothstep: *r = smoothstep(a, b, x); return true;
    default: return false;
    }
}

static bool fold_builtin_int(Builtin f, TypeKind k, ConstNum a, ConstNum b, ConstNum x, ConstNum *r) {
    Op min = row_of_builtin(B_min, k), max = row_of_builtin(B_max, k);
    switch (f) {
    case B_abs: *r = k == T_UINT ? a : apply(max, k, a, apply(OP_ineg, k, a, a, a), a); return true;
    case B_sign: r->i = (a.i > 0) - (a.i < 0); return true;
    case B_clamp: *r = apply(min, k, apply(max, k, a, b, b), x, x); return true;
    default: return false;
    }
}

static double dot(const ConstVal *a, const ConstVal *b) {
    double sum = 0;
    for (uint32_t i = 0; i < a->n; i++) sum = add(sum, mul(a->v[i].f, b->v[i].f));
    return sum;
}
static double length(const ConstVal *a) { return f1(OP_fsqrt, dot(a, a)); }

/* Gauss-Jordan with the largest pivot: returns the determinant; inv (may be NULL) gets the inverse. */
static double invert(const ConstVal *m, uint32_t n, ConstVal *inv) {
    double a[4][8] = {{0}}, det = 1;
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t j = 0; j < n; j++) a[i][j] = m->v[i * n + j].f;
        a[i][n + i] = 1;
    }
    for (uint32_t p = 0; p < n; p++) {
        uint32_t best = p;
        for (uint32_t i = p + 1; i < n; i++)
            if (fabs(a[i][p]) > fabs(a[best][p])) best = i;
        if (best != p) {
            det = f1(OP_fneg, det);
            for (uint32_t j = 0; j < 2 * n; j++) {
                double t = a[p][j];
                a[p][j] = a[best][j];
                a[best][j] = t;
            }
        }
        double d = a[p][p];
        det = mul(det, d);
        for (uint32_t j = 0; j < 2 * n; j++) a[p][j] = divide(a[p][j], d);
        for (uint32_t i = 0; i < n; i++) {
            double f = a[i][p];
            for (uint32_t j = 0; i != p && j < 2 * n; j++) a[i][j] = sub(a[i][j], mul(f, a[p][j]));
        }
    }
    for (uint32_t i = 0; inv && i < n; i++)
        for (uint32_t j = 0; j < n; j++) inv->v[i * n + j].f = a[i][n + j];
    return det;
}

static bool fold_special(Expr *e) {
    const ConstVal *a = &e->args[0]->cval, *b = e->nargs > 1 ? &e->args[1]->cval : a;
    ConstVal *r = &e->cval;
    const Type *ta = e->args[0]->type;
    switch (e->builtin) {
    case B_isfinite:
        for (uint32_t i = 0; i < r->n; i++)
            r->v[i].i = !holds(OP_fisnan, a->v[i].f, 0) && !holds(OP_fisinf, a->v[i].f, 0);
        return true;
    case B_dot: r->v[0].f = dot(a, b); return true;
    case B_length: r->v[0].f = length(a); return true;
    case B_distance: {
        ConstVal d = *a;
        for (uint32_t i = 0; i < d.n; i++) d.v[i].f = sub(a->v[i].f, b->v[i].f);
        r->v[0].f = length(&d);
        return true;
    }
    case B_normalize: {
        double len = length(a);
        for (uint32_t i = 0; i < r->n; i++) r->v[i].f = divide(a->v[i].f, len);
        return true;
    }
    case B_cross:
        for (int i = 0; i < 3; i++) {
            int j = (i + 1) % 3, k = (i + 2) % 3;
            r->v[i].f = sub(mul(a->v[j].f, b->v[k].f), mul(a->v[k].f, b->v[j].f));
        }
        return true;
    case B_reflect: {
        double d = mul(2, dot(a, b));
        for (uint32_t i = 0; i < r->n; i++) r->v[i].f = sub(a->v[i].f, mul(d, b->v[i].f));
        return true;
    }
    case B_refract: {
        double eta = e->args[2]->cval.v[0].f, d = dot(a, b), k = sub(1, mul(mul(eta, eta), sub(1, mul(d, d))));
        double along = add(mul(eta, d), f1(OP_fsqrt, k));
        for (uint32_t i = 0; i < r->n; i++)
            r->v[i].f = holds(OP_flt, k, 0) ? 0 : sub(mul(eta, a->v[i].f), mul(along, b->v[i].f));
        return true;
    }
    case B_any:
    case B_all:
        r->v[0].i = e->builtin == B_all;
        for (uint32_t i = 0; i < a->n; i++)
            r->v[0].i = e->builtin == B_all ? r->v[0].i && a->v[i].i : r->v[0].i || a->v[i].i;
        return true;
    case B_select:
        for (uint32_t i = 0; i < r->n; i++) r->v[i] = a->v[a->n == 1 ? 0 : i].i ? b->v[i] : e->args[2]->cval.v[i];
        return true;
    case B_transpose:
        for (uint32_t i = 0; i < ta->columns; i++)
            for (uint32_t j = 0; j < ta->n; j++) r->v[i * ta->n + j] = a->v[j * ta->columns + i];
        return true;
    case B_determinant: r->v[0].f = invert(a, ta->n, NULL); return true;
    case B_inverse: invert(a, ta->n, r); return true;
    case B_detach: *r = *a; return true;
    default: return false;
    }
}

static bool fold_builtin(Expr *e) {
    if (!e->nargs) return false; /* rand(), pixel(), … */
    for (uint32_t i = 0; i < e->nargs; i++)
        if (!e->args[i]->is_const || !e->args[i]->cval.n) return false;
    TypeKind k = scalar_kind(e->type), of = scalar_kind(e->args[0]->type);
    const ConstVal *a = &e->args[0]->cval, *b = e->nargs > 1 ? &e->args[1]->cval : a,
                   *x = e->nargs > 2 ? &e->args[2]->cval : a;
    Op row = row_of_builtin(e->builtin, of);
    for (uint32_t i = 0; i < e->cval.n; i++) {
        ConstNum *r = &e->cval.v[i];
        bool ok = true;
        if (row != OP_COUNT) *r = apply(row, k, a->v[i], b->v[i], x->v[i]);
        else if (e->args[0]->type != e->type) ok = false;
        else if (k == T_FLOAT) ok = fold_builtin_float(e->builtin, a->v[i].f, b->v[i].f, x->v[i].f, &r->f);
        else ok = fold_builtin_int(e->builtin, k, a->v[i], b->v[i], x->v[i], r);
        if (!ok) return fold_special(e);
    }
    return true;
}

/* An element, row or component picked out of a constant; indices outside are clamped, as everywhere. */
static bool fold_pick(Expr *e) {
    Expr *base = e->a[0];
    uint32_t count = base->type->kind == T_STRUCT ? base->type->nfields : base->type->n, at = e->field;
    if (e->kind == E_INDEX) {
        if (!e->a[1]->is_const || !count) return false;
        int64_t i = e->a[1]->cval.v[0].i;
        at = (uint32_t)(i < 0 ? 0 : i >= count ? count - 1 : i);
    }
    if (is_aggregate(base->type)) {
        Expr *list = const_list(base);
        if (!list || at >= list->nargs) return false;
        e->cval = list->args[at]->cval;
        return true;
    }
    uint32_t stride = base->type->kind == T_MATRIX ? base->type->columns : 1;
    for (uint32_t i = 0; i < stride; i++) e->cval.v[i] = base->cval.v[at * stride + i];
    return true;
}

static bool fold(Expr *e) {
    switch (e->kind) {
    case E_LITERAL:
    case E_LEN: return true;
    case E_NAME:
        if (!e->sym || !(e->sym->kind == SYM_CONST || (e->sym->kind == SYM_LOCAL && e->sym->is_const))) return false;
        if (is_aggregate(e->type)) return e->sym->array_init != NULL;
        if (!e->sym->cval.n) return false;
        e->cval = e->sym->cval;
        return true;
    case E_UNARY: return e->a[0]->is_const && fold_unary(e);
    case E_BINARY: return e->a[0]->is_const && e->a[1]->is_const && fold_binary(e);
    case E_LOGIC:
        if (!e->a[0]->is_const) return false;
        if (e->a[0]->cval.v[0].i == (e->op == OPR_LOR)) {
            e->cval = e->a[0]->cval;
            return true;
        }
        e->cval = e->a[1]->cval;
        return e->a[1]->is_const;
    case E_COND: {
        if (!e->a[0]->is_const || is_aggregate(e->type)) return false;
        Expr *taken = e->a[0]->cval.v[0].i ? e->a[1] : e->a[2];
        e->cval = taken->cval;
        return taken->is_const;
    }
    case E_BUILTIN: return fold_builtin(e);
    case E_CONSTRUCT: {
        uint32_t n = 0;
        for (uint32_t i = 0; i < e->nargs; i++) {
            if (!e->args[i]->is_const) return false;
            for (uint32_t j = 0; j < e->args[i]->cval.n && n < 16; j++) e->cval.v[n++] = e->args[i]->cval.v[j];
        }
        return n == e->cval.n;
    }
    case E_CONVERT: {
        if (!e->a[0]->is_const) return false;
        TypeKind kt = scalar_kind(e->type), kf = scalar_kind(e->a[0]->type);
        for (uint32_t i = 0; i < e->cval.n; i++) e->cval.v[i] = convert_number(kt, kf, e->a[0]->cval.v[i]);
        return true;
    }
    case E_BROADCAST:
        if (!e->a[0]->is_const) return false;
        for (uint32_t i = 0; i < e->cval.n; i++) e->cval.v[i] = e->a[0]->cval.v[0];
        return true;
    case E_INDEX:
    case E_FIELD: return e->a[0]->is_const && fold_pick(e);
    case E_SWIZZLE:
        if (!e->a[0]->is_const) return false;
        for (uint32_t i = 0; i < e->nswz; i++) e->cval.v[i] = e->a[0]->cval.v[e->swz[i]];
        return true;
    case E_LIST:
        for (uint32_t i = 0; i < e->nargs; i++)
            if (!e->args[i]->is_const) return false;
        return true;
    case E_ERROR:
    case E_ASSIGN:
    case E_INCDEC:
    case E_CALL:
    case E_METHOD:
    case E_COMMA: return false;
    }
    return false;
}

void const_fold(Checker *c, Expr *e) {
    (void)c;
    if (e->type->kind == T_ERROR || e->type->kind == T_VOID || type_is_resource(e->type)) return;
    if (!is_aggregate(e->type) && e->kind != E_LITERAL && e->kind != E_LEN) e->cval.n = type_components(e->type);
    e->is_const = fold(e);
}

Expr *const_list(Expr *e) {
    if (!e->is_const || !is_aggregate(e->type)) return NULL;
    if (e->kind == E_LIST) return e;
    if (e->kind == E_NAME) return e->sym->array_init;
    if (e->kind != E_INDEX && e->kind != E_FIELD) return NULL;
    Expr *base = const_list(e->a[0]);
    if (!base) return NULL;
    int64_t at = e->field;
    if (e->kind == E_INDEX) {
        at = e->a[1]->cval.v[0].i;
        at = at < 0 ? 0 : at >= base->nargs ? (int64_t)base->nargs - 1 : at;
    }
    return base->nargs ? const_list(base->args[at]) : NULL;
}

bool const_int(Checker *c, Expr *e, const char *what, int64_t *out) {
    if (e->type->kind == T_ERROR) return false;
    if (e->type->kind != T_INT && e->type->kind != T_UINT) {
        diag_emit(c->s, DIAG_cannot_convert, e->span, e->type->name, "int",
                  arena_printf(&c->s->session, ": %s is an integer constant", what));
        return false;
    }
    if (!e->is_const) {
        Diag *d = diag_emit(c->s, DIAG_not_constant, e->span, what);
        Symbol *root = place_root(e);
        if (root && root->kind == SYM_PARAM)
            diag_note(c->s, d, root->span,
                      in_glsl(c)
                          ? "`%s` is a uniform, which may change without compiling"
                          : "`%s` is a `param`, which may change without compiling; a `const` can be set with --set",
                      root->name);
        return false;
    }
    *out = e->cval.v[0].i;
    return true;
}
