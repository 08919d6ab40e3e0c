/* Values known when the program is compiled.
 *
 * Folding runs bottom-up as nodes get their types, so a value is computed once, where it stands. Floats are kept in
 * double whatever the precision of the program: lowering rounds once. Integers wrap to 32 bits at every step, as in the
 * program. Division by zero, shifts and conversions follow the language. */
#include "compiler/front/check/internal.h"

#include <float.h>
#include <math.h>
#include <string.h>

int64_t const_wrap(TypeKind k, int64_t v) {
    return k == T_UINT ? (int64_t)(uint32_t)v : k == T_INT ? (int32_t)(uint32_t)v : v;
}

static double as_double(TypeKind k, const ConstVal *v, uint32_t i) {
    return k == T_FLOAT ? v->v[i].f : (double)v->v[i].i;
}

static void convert_component(ConstVal *to, TypeKind kt, const ConstVal *from, TypeKind kf, uint32_t i, uint32_t j) {
    if (kt == kf) {
        to->v[i] = from->v[j];
    } else if (kt == T_FLOAT) {
        to->v[i].f = as_double(kf, from, j);
    } else if (kt == T_BOOL) {
        to->v[i].i = kf == T_FLOAT ? from->v[j].f != 0 : from->v[j].i != 0;
    } else if (kf == T_FLOAT) { /* saturates, NaN to 0 */
        double d = from->v[j].f, lo = kt == T_INT ? -2147483648.0 : 0, hi = kt == T_INT ? 2147483647.0 : 4294967295.0;
        to->v[i].i = isnan(d) ? 0 : (int64_t)(d < lo ? lo : d > hi ? hi : d);
    } else {
        to->v[i].i = const_wrap(kt, from->v[j].i);
    }
}

static bool fold_float(Operator op, double a, double b, double *r) {
    switch (op) {
    case OPR_ADD: *r = a + b; return true;
    case OPR_SUB: *r = a - b; return true;
    case OPR_MUL: *r = a * b; return true;
    case OPR_DIV: *r = a / b; return true;
    case OPR_MOD: *r = fmod(a, b); return true;
    default: return false;
    }
}

static bool fold_int(Operator op, TypeKind k, int64_t a, int64_t b, int64_t *out) {
    int64_t r;
    switch (op) {
    case OPR_ADD: r = a + b; break;
    case OPR_SUB: r = a - b; break;
    case OPR_MUL: r = (int64_t)((uint64_t)a * (uint64_t)b); break;
    case OPR_DIV: r = b ? a / b : 0; break;
    case OPR_MOD: r = b ? a % b : 0; break;
    case OPR_AND: r = a & b; break;
    case OPR_OR: r = a | b; break;
    case OPR_XOR: r = a ^ b; break;
    case OPR_SHL: r = (int64_t)((uint64_t)a << (b & 31)); break;
    case OPR_SHR: r = a >> (b & 31); break;
    default: return false;
    }
    *out = const_wrap(k, r);
    return true;
}

static bool fold_compare(Operator op, TypeKind k, const ConstVal *a, const ConstVal *b, uint32_t i, int64_t *r) {
    bool lt, eq, gt;
    if (k == T_FLOAT) {
        double x = a->v[i].f, y = b->v[i].f;
        lt = x < y, eq = x == y, gt = x > y;
    } else {
        int64_t x = a->v[i].i, y = b->v[i].i;
        lt = x < y, eq = x == y, gt = x > y;
    }
    switch (op) {
    case OPR_EQ: *r = eq; return true;
    case OPR_NE: *r = !eq; return true;
    case OPR_LT: *r = lt; return true;
    case OPR_LE: *r = lt || eq; return true;
    case OPR_GT: *r = gt; return true;
    case OPR_GE: *r = gt || eq; return true;
    default: return false;
    }
}

/* Rows times columns: a is ra x n, b is n x cb. */
static void fold_matmul(ConstVal *r, const ConstVal *a, const ConstVal *b, uint32_t ra, uint32_t n, uint32_t cb) {
    for (uint32_t i = 0; i < ra; i++)
        for (uint32_t j = 0; j < cb; j++) {
            double sum = 0;
            for (uint32_t k = 0; k < n; k++) sum += a->v[i * n + k].f * b->v[k * cb + j].f;
            r->v[i * cb + j].f = sum;
        }
}

static bool fold_binary(Expr *e) {
    const Type *ta = e->a[0]->type, *tb = e->a[1]->type;
    const ConstVal *a = &e->a[0]->cval, *b = &e->a[1]->cval;
    ConstVal *r = &e->cval;
    if (ta->kind == T_MATRIX || tb->kind == T_MATRIX) {
        if (e->op == OPR_MUL && ta->kind == T_MATRIX && tb->kind != T_FLOAT) {
            fold_matmul(r, a, b, ta->n, ta->n, tb->kind == T_MATRIX ? ta->n : 1);
            return true;
        }
        if (e->op == OPR_MUL && ta->kind == T_VECTOR) {
            fold_matmul(r, a, b, 1, tb->n, tb->n);
            return true;
        }
        for (uint32_t i = 0; i < r->n; i++)
            if (!fold_float(e->op, a->v[ta->kind == T_MATRIX ? i : 0].f, b->v[tb->kind == T_MATRIX ? i : 0].f,
                            &r->v[i].f))
                return false;
        return true;
    }
    TypeKind k = scalar_kind(ta);
    for (uint32_t i = 0; i < r->n; i++) {
        if (e->op >= OPR_EQ && e->op <= OPR_GE) {
            if (!fold_compare(e->op, k, a, b, i, &r->v[i].i)) return false;
        } else if (k == T_FLOAT) {
            if (!fold_float(e->op, a->v[i].f, b->v[i].f, &r->v[i].f)) return false;
        } else if (!fold_int(e->op, k, a->v[i].i, b->v[i].i, &r->v[i].i)) {
            return false;
        }
    }
    return true;
}

static bool fold_unary(Expr *e) {
    TypeKind k = scalar_kind(e->type);
    const ConstVal *a = &e->a[0]->cval;
    for (uint32_t i = 0; i < e->cval.n; i++) {
        switch (e->op) {
        case OPR_PLUS: e->cval.v[i] = a->v[i]; break;
        case OPR_NEG:
            if (k == T_FLOAT) e->cval.v[i].f = -a->v[i].f;
            else e->cval.v[i].i = const_wrap(k, -a->v[i].i);
            break;
        case OPR_NOT: e->cval.v[i].i = !a->v[i].i; break;
        case OPR_COMPL: e->cval.v[i].i = const_wrap(k, ~a->v[i].i); break;
        default: return false;
        }
    }
    return true;
}

static double sign_of(double a) { return (a > 0) - (a < 0); }
static double smoothstep(double lo, double hi, double v) {
    double t = (v - lo) / (hi - lo);
    t = t < 0 ? 0 : t > 1 ? 1 : t;
    return t * t * (3 - 2 * t);
}

/* Component-wise builtins of floats. */
static bool fold_builtin_float(Builtin f, double a, double b, double x, double *r) {
    switch (f) {
    case B_abs: *r = fabs(a); return true;
    case B_sign: *r = sign_of(a); return true;
    case B_floor: *r = floor(a); return true;
    case B_ceil: *r = ceil(a); return true;
    case B_round: *r = rint(a); return true;
    case B_trunc: *r = trunc(a); return true;
    case B_frac: *r = a - floor(a); return true;
    case B_fmod: *r = fmod(a, b); return true;
    case B_min: *r = b < a ? b : a; return true;
    case B_max: *r = a < b ? b : a; return true;
    case B_clamp:
        a = a < b ? b : a;
        *r = x < a ? x : a;
        return true;
    case B_saturate: *r = a < 0 ? 0 : 1 < a ? 1 : a; return true;
    case B_lerp: *r = a + (b - a) * x; return true;
    case B_step: *r = b >= a; return true;
    case B_smoothstep: *r = smoothstep(a, b, x); return true;
    case B_sqrt: *r = sqrt(a); return true;
    case B_rsqrt: *r = 1 / sqrt(a); return true;
    case B_cbrt: *r = cbrt(a); return true;
    case B_pow: *r = pow(a, b); return true;
    case B_exp: *r = exp(a); return true;
    case B_exp2: *r = exp2(a); return true;
    case B_log: *r = log(a); return true;
    case B_log2: *r = log2(a); return true;
    case B_sin: *r = sin(a); return true;
    case B_cos: *r = cos(a); return true;
    case B_tan: *r = tan(a); return true;
    case B_asin: *r = asin(a); return true;
    case B_acos: *r = acos(a); return true;
    case B_atan: *r = atan(a); return true;
    case B_atan2: *r = atan2(a, b); return true;
    case B_sinh: *r = sinh(a); return true;
    case B_cosh: *r = cosh(a); return true;
    case B_tanh: *r = tanh(a); return true;
    case B_erf: *r = erf(a); return true;
    case B_fma: *r = fma(a, b, x); return true;
    default: return false;
    }
}

static bool fold_builtin_int(Builtin f, TypeKind k, int64_t a, int64_t b, int64_t x, int64_t *r) {
    switch (f) {
    case B_abs: *r = const_wrap(k, a < 0 ? -a : a); return true;
    case B_sign: *r = (a > 0) - (a < 0); return true;
    case B_min: *r = b < a ? b : a; return true;
    case B_max: *r = a < b ? b : a; return true;
    case B_clamp:
        a = a < b ? b : a;
        *r = x < a ? x : a;
        return true;
    default: return false;
    }
}

static double dot(const ConstVal *a, const ConstVal *b) {
    double sum = 0;
    for (uint32_t i = 0; i < a->n; i++) sum += a->v[i].f * b->v[i].f;
    return sum;
}

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
            det = -det;
            for (uint32_t j = 0; j < 2 * n; j++) {
                double t = a[p][j];
                a[p][j] = a[best][j];
                a[best][j] = t;
            }
        }
        double d = a[p][p];
        det *= d;
        for (uint32_t j = 0; j < 2 * n; j++) a[p][j] /= d;
        for (uint32_t i = 0; i < n; i++) {
            double f = a[i][p];
            for (uint32_t j = 0; i != p && j < 2 * n; j++) a[i][j] -= f * a[p][j];
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
    case B_isnan:
    case B_isinf:
    case B_isfinite:
        for (uint32_t i = 0; i < r->n; i++)
            r->v[i].i = e->builtin == B_isnan   ? isnan(a->v[i].f)
                        : e->builtin == B_isinf ? isinf(a->v[i].f) != 0
                                                : isfinite(a->v[i].f) != 0;
        return true;
    case B_dot: r->v[0].f = dot(a, b); return true;
    case B_length: r->v[0].f = sqrt(dot(a, a)); return true;
    case B_distance: {
        ConstVal d = *a;
        for (uint32_t i = 0; i < d.n; i++) d.v[i].f -= b->v[i].f;
        r->v[0].f = sqrt(dot(&d, &d));
        return true;
    }
    case B_normalize: {
        double len = sqrt(dot(a, a));
        for (uint32_t i = 0; i < r->n; i++) r->v[i].f = a->v[i].f / len;
        return true;
    }
    case B_cross:
        for (int i = 0; i < 3; i++) {
            int j = (i + 1) % 3, k = (i + 2) % 3;
            r->v[i].f = a->v[j].f * b->v[k].f - a->v[k].f * b->v[j].f;
        }
        return true;
    case B_reflect: {
        double d = 2 * dot(a, b);
        for (uint32_t i = 0; i < r->n; i++) r->v[i].f = a->v[i].f - d * b->v[i].f;
        return true;
    }
    case B_refract: {
        double eta = e->args[2]->cval.v[0].f, d = dot(a, b), k = 1 - eta * eta * (1 - d * d);
        for (uint32_t i = 0; i < r->n; i++) r->v[i].f = k < 0 ? 0 : eta * a->v[i].f - (eta * d + sqrt(k)) * b->v[i].f;
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
        for (uint32_t i = 0; i < ta->n; i++)
            for (uint32_t j = 0; j < ta->n; j++) r->v[i * ta->n + j] = a->v[j * ta->n + i];
        return true;
    case B_determinant: r->v[0].f = invert(a, ta->n, NULL); return true;
    case B_inverse: invert(a, ta->n, r); return true;
    case B_asuint:
        for (uint32_t i = 0; i < r->n; i++) {
            float f = (float)a->v[i].f;
            uint32_t bits;
            memcpy(&bits, &f, 4);
            r->v[i].i = bits;
        }
        return true;
    case B_asfloat:
        for (uint32_t i = 0; i < r->n; i++) {
            uint32_t bits = (uint32_t)a->v[i].i;
            float f;
            memcpy(&f, &bits, 4);
            r->v[i].f = f;
        }
        return true;
    case B_detach: *r = *a; return true;
    default: return false;
    }
}

static bool fold_builtin(Expr *e) {
    if (!e->nargs) return false; /* rand(), pixel(), … */
    for (uint32_t i = 0; i < e->nargs; i++)
        if (!e->args[i]->is_const || !e->args[i]->cval.n) return false;
    TypeKind k = scalar_kind(e->type);
    const ConstVal *a = &e->args[0]->cval, *b = e->nargs > 1 ? &e->args[1]->cval : a,
                   *x = e->nargs > 2 ? &e->args[2]->cval : a;
    for (uint32_t i = 0; i < e->cval.n; i++) {
        bool ok;
        if (e->args[0]->type != e->type) ok = false;
        else if (k == T_FLOAT) ok = fold_builtin_float(e->builtin, a->v[i].f, b->v[i].f, x->v[i].f, &e->cval.v[i].f);
        else ok = fold_builtin_int(e->builtin, k, a->v[i].i, b->v[i].i, x->v[i].i, &e->cval.v[i].i);
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
    uint32_t stride = base->type->kind == T_MATRIX ? base->type->n : 1;
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
        for (uint32_t i = 0; i < e->cval.n; i++) convert_component(&e->cval, kt, &e->a[0]->cval, kf, i, i);
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
                      "`%s` is a `param`, which may change without compiling; a `const` can be set with --set",
                      root->name);
        return false;
    }
    *out = e->cval.v[0].i;
    return true;
}
