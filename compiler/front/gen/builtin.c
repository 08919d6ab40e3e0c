/* Builtin functions as ordinary operations. Those that jump ask site.c for a site. */
#include <string.h>

#include "compiler/front/gen/internal.h"
#include "compiler/front/rows.h"

static Inst *sum(Lower *l, Inst *a, Inst *b) { return op2(l, OP_fadd, a, b); }
static Inst *diff(Lower *l, Inst *a, Inst *b) { return op2(l, OP_fsub, a, b); }
static Inst *prod(Lower *l, Inst *a, Inst *b) { return op2(l, OP_fmul, a, b); }

Inst *dot_n(Lower *l, Inst *const *a, Inst *const *b, uint32_t n) {
    Inst *s = prod(l, a[0], b[0]);
    for (uint32_t i = 1; i < n; i++) s = sum(l, s, prod(l, a[i], b[i]));
    return s;
}

/* sqrt(v.v), with the select that makes its derivative 0 at 0: there is the kink of the norm, whose subdifferential
 * holds 0. */
static Inst *length_n(Lower *l, Inst *const *v, uint32_t n) {
    Inst *d = dot_n(l, v, v, n), *zero = kf(l, 0);
    return sel(l, op2(l, OP_feq, d, zero), zero, op1(l, OP_fsqrt, d));
}

static Inst *rand_next(Lower *l) {
    Inst *n = l->rand_counter->value;
    var_set(l, l->rand_counter, op2(l, OP_iadd, n, ki(l, 1)));
    return special(l, OP_rand, TY_FLT, 1, &n, (Imm){0});
}

/* hash: one integer hash for all targets and precisions. With
 *     mix(h) = h ^= h >> 16; h *= 0x7feb352d; h ^= h >> 15; h *= 0x846ca68b; h ^= h >> 16
 * hash(x) = mix(x + 0x9e3779b9), hash(x, y) = mix(hash(x) + y), hash(x, y, z) = mix(hash(x, y) + z), all modulo 2^32.
 */
static Inst *hash_mix(Lower *l, Inst *h) {
    h = op2(l, OP_ixor, h, op2(l, OP_ushr, h, ki(l, 16)));
    h = op2(l, OP_imul, h, ki(l, (int32_t)0x7feb352du));
    h = op2(l, OP_ixor, h, op2(l, OP_ushr, h, ki(l, 15)));
    h = op2(l, OP_imul, h, ki(l, (int32_t)0x846ca68bu));
    return op2(l, OP_ixor, h, op2(l, OP_ushr, h, ki(l, 16)));
}

static Inst *hash_n(Lower *l, Inst *const *v, uint32_t n) {
    Inst *h = hash_mix(l, op2(l, OP_iadd, v[0], ki(l, (int32_t)0x9e3779b9u)));
    for (uint32_t i = 1; i < n; i++) h = hash_mix(l, op2(l, OP_iadd, h, v[i]));
    return h;
}

static Inst *sign_scalar(Lower *l, Inst *v, TypeKind k, Span span) {
    if (k == T_UINT) return sel(l, op2(l, OP_ieq, v, ki(l, 0)), ki(l, 0), ki(l, 1));
    if (k == T_INT)
        return sel(l, op2(l, OP_ilt, ki(l, 0), v), ki(l, 1), sel(l, op2(l, OP_ilt, v, ki(l, 0)), ki(l, -1), ki(l, 0)));
    Inst *zero = kf(l, 0);
    Inst *up = site_compare(l, op2(l, OP_flt, zero, v), v, zero, span);
    return sel(l, up, kf(l, 1), sel(l, op2(l, OP_flt, v, zero), kf(l, -1), zero));
}

/* The same value; a scalar parameter is read anew at each mention. */
static bool same_value(const Inst *a, const Inst *b) {
    return a == b ||
           (a->op == OP_param && b->op == OP_param && a->imm.slot.base == b->imm.slot.base &&
            a->args[0]->op == OP_consti && b->args[0]->op == OP_consti && a->args[0]->imm.i == b->args[0]->imm.i);
}

/* The op gives its first argument where the second is NaN. In GLSL that is the bound: GPUs drop NaN there, and people's
 * pictures are what they are because of it (0/0 on a segment without length is clamped to 0). */
static Inst *bounded(Lower *l, Op op, Inst *v, Inst *bound) {
    return l->program->is_glsl ? op2(l, op, bound, v) : op2(l, op, v, bound);
}

static Inst *min_max(Lower *l, bool max, Inst *a, Inst *b, TypeKind k) {
    /* max(x, -x) is abs(x): its slope at 0 is 0. */
    if (k == T_FLOAT &&
        ((b->op == OP_fneg && same_value(a, b->args[0])) || (a->op == OP_fneg && same_value(a->args[0], b)))) {
        Inst *size = op1(l, OP_fabs, b->op == OP_fneg ? a : b);
        return max ? size : op1(l, OP_fneg, size);
    }
    Op row = row_of_builtin(max ? B_max : B_min, k);
    return k == T_FLOAT && ir_is_const(b) ? bounded(l, row, a, b) : op2(l, row, a, b);
}

static Inst *smoothstep_scalar(Lower *l, Inst *e0, Inst *e1, Inst *x) {
    Inst *t = op2(l, OP_fdiv, diff(l, x, e0), diff(l, e1, e0));
    t = bounded(l, OP_fmin, bounded(l, OP_fmax, t, kf(l, 0)), kf(l, 1));
    return prod(l, prod(l, t, t), diff(l, kf(l, 3), prod(l, kf(l, 2), t)));
}

/* The cut of atan2 runs along y = 0, x < 0; for x > 0 both sides agree. */
static Inst *atan2_scalar(Lower *l, Inst *y, Inst *x, Span span) {
    if (l->tag.disc && !l->quiet && !l->in_tangent) {
        Inst *up = op2(l, OP_fatan2, op1(l, OP_fabs, y), x), *zero = kf(l, 0);
        Inst *below = site_compare(l, op2(l, OP_flt, y, zero), y, zero, span);
        return sel(l, below, op1(l, OP_fneg, up), up);
    }
    Inst *r = op2(l, OP_fatan2, y, x);
    site_untracked(l, r, y, NULL, span, JUMP_BUILTIN);
    return r;
}

/* A decision of the argument that has no boundary function. */
static Inst *jumping(Lower *l, Inst *decision, Inst *x, Span span) {
    site_untracked(l, decision, x, NULL, span, JUMP_BUILTIN);
    return decision;
}

/* One component of a component-wise builtin. */
static Inst *component(Lower *l, Builtin b, Inst *x, Inst *y, Inst *z, TypeKind k, Span span) {
    bool f = k == T_FLOAT;
    switch (b) {
    case B_abs: return f ? op1(l, OP_fabs, x) : k == T_UINT ? x : op2(l, OP_imax, x, op1(l, OP_ineg, x));
    case B_sign: return sign_scalar(l, x, k, span);
    case B_floor: return site_integer(l, SITE_FLOOR, op1(l, OP_ffloor, x), x, span);
    case B_ceil: return site_integer(l, SITE_CEIL, op1(l, OP_fceil, x), x, span);
    case B_round: return site_integer(l, SITE_ROUND, op1(l, OP_fround, x), x, span);
    case B_trunc: return site_integer(l, SITE_TRUNC, op1(l, OP_ftrunc, x), x, span);
    case B_frac: return diff(l, x, site_integer(l, SITE_FLOOR, op1(l, OP_ffloor, x), x, span));
    case B_fmod: {
        Inst *q = op2(l, OP_fdiv, x, y);
        if (!ir_is_const(y))
            y = sel(l, op1(l, OP_fisinf, y), kf(l, 0), y); /* fmod(x, inf) is x, and inf * 0 would be NaN */
        return diff(l, x, prod(l, y, site_integer(l, SITE_FMOD, op1(l, OP_ftrunc, q), q, span)));
    }
    case B_min: return min_max(l, false, x, y, k);
    case B_max: return min_max(l, true, x, y, k);
    case B_clamp:
        if (f) return bounded(l, OP_fmin, bounded(l, OP_fmax, x, y), z);
        return min_max(l, false, min_max(l, true, x, y, k), z, k);
    case B_saturate: return op2(l, OP_fmin, op2(l, OP_fmax, x, kf(l, 0)), kf(l, 1));
    case B_lerp: return sum(l, x, prod(l, z, diff(l, y, x)));
    case B_step: return sel(l, site_compare(l, op2(l, OP_flt, y, x), y, x, span), kf(l, 0), kf(l, 1));
    case B_smoothstep: return smoothstep_scalar(l, x, y, z);
    case B_atan2: return atan2_scalar(l, x, y, span);
    case B_isnan: return jumping(l, op1(l, OP_fisnan, x), x, span);
    case B_isinf: return jumping(l, op1(l, OP_fisinf, x), x, span);
    case B_isfinite:
        return op1(l, OP_bnot, jumping(l, op2(l, OP_bor, op1(l, OP_fisnan, x), op1(l, OP_fisinf, x)), x, span));
    case B_dFdx: return special(l, OP_ddx, TY_FLT, 1, &x, (Imm){.i = 0});
    case B_dFdy: return l->program->dim < 2 ? kf(l, 0) : special(l, OP_ddx, TY_FLT, 1, &x, (Imm){.i = 1});
    case B_detach: return x->type == TY_FLT ? op1(l, OP_detach, x) : x;
    case B_asuint: {
        Inst *r = op1(l, OP_fasuint, x);
        site_untracked(l, r, x, NULL, span, JUMP_ALWAYS);
        return r;
    }
    default: { /* a builtin that is one row */
        Op row = row_of_builtin(b, k);
        return row == OP_COUNT ? NULL : !y ? op1(l, row, x) : !z ? op2(l, row, x, y) : op3(l, row, x, y, z);
    }
    }
}

/* ---- matrices: row r, column c at r * columns + c */

Val gen_matmul(Lower *l, Val a, Val b, Type *type) {
    Val v = val_new(l, type);
    bool am = a.type->kind == T_MATRIX, bm = b.type->kind == T_MATRIX;
    if (!am && a.n == 1) {
        for (uint32_t i = 0; i < v.n; i++) v.c[i] = prod(l, a.c[0], b.c[i]);
        return v;
    }
    if (!bm && b.n == 1) {
        for (uint32_t i = 0; i < v.n; i++) v.c[i] = prod(l, a.c[i], b.c[0]);
        return v;
    }
    uint32_t n = am ? a.type->columns : b.type->n, rows = am ? a.type->n : 1, cols = bm ? b.type->columns : 1;
    for (uint32_t r = 0; r < rows; r++)
        for (uint32_t c = 0; c < cols; c++) {
            Inst *x[4], *y[4];
            for (uint32_t k = 0; k < n; k++) x[k] = a.c[r * n + k], y[k] = b.c[k * cols + c];
            v.c[r * cols + c] = dot_n(l, x, y, n);
        }
    return v;
}

/* Determinant of the minor with rows from r0 on and the columns of the mask, by its first row. */
static Inst *minor(Lower *l, Inst *const *m, uint32_t n, uint32_t rows, uint32_t cols) {
    uint32_t r = 0;
    while (!(rows >> r & 1)) r++;
    Inst *det = NULL;
    bool minus = false;
    for (uint32_t c = 0; c < n; c++) {
        if (!(cols >> c & 1)) continue;
        uint32_t rest = rows & ~(1u << r);
        Inst *t = rest ? prod(l, m[r * n + c], minor(l, m, n, rest, cols & ~(1u << c))) : m[r * n + c];
        det = !det ? t : minus ? diff(l, det, t) : sum(l, det, t);
        minus = !minus;
    }
    return det;
}

static Val inverse(Lower *l, Val m) {
    uint32_t n = m.type->n, all = (1u << n) - 1;
    Val v = val_new(l, m.type);
    Inst *det = minor(l, m.c, n, all, all);
    for (uint32_t r = 0; r < n; r++)
        for (uint32_t c = 0; c < n; c++) {
            Inst *t = minor(l, m.c, n, all & ~(1u << c), all & ~(1u << r));
            if ((r + c) & 1) t = op1(l, OP_fneg, t);
            v.c[r * n + c] = op2(l, OP_fdiv, t, det);
        }
    return v;
}

/* ---- vectors */

static Val refract(Lower *l, Val i, Val n, Inst *eta, Type *type, Span span) {
    Val v = val_new(l, type);
    Inst *ni = dot_n(l, n.c, i.c, v.n), *one = kf(l, 1), *zero = kf(l, 0);
    Inst *k = diff(l, one, prod(l, prod(l, eta, eta), diff(l, one, prod(l, ni, ni))));
    Inst *total = site_compare(l, op2(l, OP_flt, k, zero), k, zero, span);
    Inst *f = sum(l, prod(l, eta, ni), op1(l, OP_fsqrt, op2(l, OP_fmax, k, zero)));
    for (uint32_t c = 0; c < v.n; c++) v.c[c] = sel(l, total, zero, diff(l, prod(l, eta, i.c[c]), prod(l, f, n.c[c])));
    return v;
}

static Val vectors(Lower *l, Expr *e, Val *a) {
    Val v = val_new(l, e->type);
    uint32_t n = e->nargs ? a[0].n : 0;
    switch (e->builtin) {
    case B_dot: v.c[0] = dot_n(l, a[0].c, a[1].c, n); break;
    case B_cross:
        for (uint32_t i = 0; i < 3; i++) {
            uint32_t j = (i + 1) % 3, k = (i + 2) % 3;
            v.c[i] = diff(l, prod(l, a[0].c[j], a[1].c[k]), prod(l, a[0].c[k], a[1].c[j]));
        }
        break;
    case B_length: v.c[0] = length_n(l, a[0].c, n); break;
    case B_distance: {
        Inst *d[4];
        for (uint32_t i = 0; i < n && i < 4; i++) d[i] = diff(l, a[0].c[i], a[1].c[i]);
        v.c[0] = length_n(l, d, n);
        break;
    }
    case B_normalize: {
        Inst *inv = op2(l, OP_fdiv, kf(l, 1), op1(l, OP_fsqrt, dot_n(l, a[0].c, a[0].c, n)));
        for (uint32_t i = 0; i < n; i++) v.c[i] = prod(l, a[0].c[i], inv);
        break;
    }
    case B_reflect: {
        Inst *d = prod(l, kf(l, 2), dot_n(l, a[1].c, a[0].c, n));
        for (uint32_t i = 0; i < n; i++) v.c[i] = diff(l, a[0].c[i], prod(l, d, a[1].c[i]));
        break;
    }
    case B_refract: return refract(l, a[0], a[1], a[2].c[0], e->type, e->span);
    case B_any:
    case B_all:
        v.c[0] = a[0].c[0];
        for (uint32_t i = 1; i < n; i++) v.c[0] = op2(l, e->builtin == B_any ? OP_bor : OP_band, v.c[0], a[0].c[i]);
        break;
    case B_select:
        for (uint32_t i = 0; i < v.n; i++)
            v.c[i] = sel(l, a[0].c[n == 1 ? 0 : i], a[1].c[a[1].n == 1 ? 0 : i], a[2].c[a[2].n == 1 ? 0 : i]);
        break;
    case B_mul:
        if (a[0].type->kind == T_VECTOR && a[1].type->kind == T_VECTOR && v.n == 1) { /* a row times a column */
            v.c[0] = dot_n(l, a[0].c, a[1].c, n);
            break;
        }
        return a[0].type->kind == T_MATRIX || a[1].type->kind == T_MATRIX
                   ? gen_matmul(l, a[0], a[1], e->type)
                   : gen_binary(l, OPR_MUL, a[0], a[1], e->type, e->span);
    case B_transpose: {
        uint32_t rows = e->type->n, columns = e->type->columns;
        for (uint32_t i = 0; i < v.n; i++) v.c[i] = a[0].c[i % columns * rows + i / columns];
        break;
    }
    case B_determinant:
        v.c[0] = minor(l, a[0].c, a[0].type->n, (1u << a[0].type->n) - 1, (1u << a[0].type->n) - 1);
        break;
    case B_inverse: return inverse(l, a[0]);
    case B_hash: v.c[0] = hash_n(l, a[0].c, n); break;
    case B_rand:
    case B_rand2:
    case B_rand3:
        for (uint32_t i = 0; i < v.n; i++) v.c[i] = rand_next(l);
        break;
    case B_pixel:
        v.c[0] = ir_input(&l->b, IN_PIXEL0), v.c[1] = ir_input(&l->b, IN_PIXEL1), l->program->uses_pixel = true;
        break;
    case B_resolution: v.c[0] = ir_input(&l->b, IN_RES0), v.c[1] = ir_input(&l->b, IN_RES1); break;
    case B_sample_index: v.c[0] = ir_input(&l->b, IN_SAMPLE); break;
    default: ice(l->s, "builtin %d is not lowered", (int)e->builtin);
    }
    return v;
}

Val gen_builtin(Lower *l, Expr *e) {
    Val a[4] = {0};
    if (e->nargs > 4) ice(l->s, "a builtin with %u arguments", e->nargs);
    for (uint32_t i = 0; i < e->nargs; i++) a[i] = gen_expr(l, e->args[i]);
    /* clang-format off */
    switch (e->builtin) {
    case B_dot: case B_cross: case B_length: case B_distance: case B_normalize: case B_reflect: case B_refract: case B_any: case B_all: case B_select: case B_mul:
    case B_transpose: case B_determinant: case B_inverse: case B_hash: case B_rand: case B_rand2: case B_rand3: case B_pixel: case B_resolution: case B_sample_index:
        return vectors(l, e, a);
    default: break;
    }
    /* clang-format on */
    Val v = val_new(l, e->type);
    TypeKind k = scalar_of(a[0].type)->kind;
    for (uint32_t i = 0; i < v.n; i++) {
        Inst *x[3] = {0};
        for (uint32_t j = 0; j < e->nargs && j < 3; j++) x[j] = a[j].c[a[j].n == 1 ? 0 : i];
        v.c[i] = component(l, e->builtin, x[0], x[1], x[2], k, e->span);
        if (!v.c[i]) ice(l->s, "builtin %d is not lowered", (int)e->builtin);
    }
    return v;
}
