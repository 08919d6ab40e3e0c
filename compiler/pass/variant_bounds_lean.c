/* Bounds of floats that lean: how a value follows the position across the box, so that two that follow it together do
 * not count twice.
 *
 *     value = mid + slope[0] e0 + slope[1] e1 + r,   |e0|, |e1| <= 1 along the two axes of the box, |r| <= rest
 *
 * Natural bounds of b * b - c, whether a ray meets a ball, know nothing of that b and c rise together; these do, up to
 * the square of the box's size (Comba and Stolfi, "Affine arithmetic and its applications to computer graphics", 1993,
 * with no other symbols than the two axes). `rest` takes up what is not linear, what a kernel rounds, and what these
 * numbers are rounded by themselves. Of images' bounds alone, and of values that comparisons in loops with lists are
 * made of, where these put together two that hang on one coordinate. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "compiler/pass/variant_bounds.h"

static bool leans(Op op) {
    return op == OP_fadd || op == OP_fsub || op == OP_fneg || op == OP_fmul || op == OP_ffma || op == OP_fdiv ||
           op == OP_fsqrt;
}

bool bounds_hands_on_lean(const Inst *i) { return leans((Op)i->op) || variant_is_site(i) || i->op == OP_detach; }

/* ---- which values: from comparisons backwards */

enum { EITHER = 3, UNKNOWN = 255 };

static bool is_of_list(const Inst *owner) { return owner->op == OP_loop && owner->imm.loop.cull; }

/* The coordinates that v hangs on, a bit each. Of what a loop with a list carries, a sum or the least
 * distance, it is not known how it leans: that counts for nothing. */
static uint8_t coordinates(const Boxes *x, const Inst *v, uint8_t *known) {
    if (!bounds_wide(x, v)) return 0;
    if (known[v->id] != UNKNOWN) return known[v->id];
    uint8_t on = 0;
    if (v->op == OP_input) on = v->imm.i <= IN_X1 ? (uint8_t)(1u << (v->imm.i - IN_X0)) : EITHER;
    else if (v->op == OP_arg || v->op == OP_proj)
        on = is_of_list(v->op == OP_arg ? v->block->owner : v->args[0]) ? 0 : EITHER;
    else
        for (uint32_t a = 0; a < v->nargs && on != EITHER; a++) on |= coordinates(x, v->args[a], known);
    return known[v->id] = on;
}

static bool meet(const Boxes *x, const Inst *p, const Inst *q, uint8_t *known) {
    return p != q && (coordinates(x, p, known) & coordinates(x, q, known));
}

/* Is v made of two that hang on one coordinate? */
static bool is_entangled(const Boxes *x, const Inst *v, uint8_t *known, uint32_t depth) {
    enum { DEEP = 24 };
    if (v->type != TY_FLT || !bounds_wide(x, v) || !bounds_hands_on_lean(v) || depth == DEEP) return false;
    if (variant_is_site(v) || v->op == OP_detach) return is_entangled(x, v->args[0], known, depth + 1);
    if (v->nargs > 1 && meet(x, v->args[0], v->args[1], known)) return true;
    if (v->nargs > 2 && (meet(x, v->args[0], v->args[2], known) || meet(x, v->args[1], v->args[2], known))) return true;
    for (uint32_t a = 0; a < v->nargs; a++)
        if (is_entangled(x, v->args[a], known, depth + 1)) return true;
    return false;
}

static bool is_entangled_pair(const Boxes *x, const Inst *p, const Inst *q, uint8_t *known) {
    return meet(x, p, q, known) || is_entangled(x, p, known, 0) || is_entangled(x, q, known, 0);
}

static void want(Boxes *x, const Inst *v) {
    if (v->type != TY_FLT || !bounds_wide(x, v) || x->leans[v->id]) return;
    x->leans[v->id] = true;
    if (v->op == OP_arg) {
        const Inst *loop = v->block->owner;
        want(x, loop->args[v->imm.i - 1]), want(x, v->block->last->args[v->imm.i]);
    } else if (v->op == OP_proj) {
        const Inst *owner = v->args[0];
        for (uint32_t r = 0; r < owner->nregions; r++) want(x, walk_results(owner, owner->region[r])[v->imm.i]);
        if (owner->op == OP_loop) want(x, owner->region[0]->params[v->imm.i + 1]);
    } else if (bounds_hands_on_lean(v)) {
        for (uint32_t a = 0; a < (leans((Op)v->op) ? v->nargs : 1); a++) want(x, v->args[a]);
    }
}

static void want_compared(Boxes *x, const Block *b, bool listed, uint8_t *known) {
    for (const Inst *i = b->first; i; i = i->next) {
        const bool compares = listed && (i->op == OP_flt || i->op == OP_fle);
        if (compares && is_entangled_pair(x, i->args[0], i->args[1], known)) want(x, i->args[0]), want(x, i->args[1]);
        for (uint32_t r = 0; r < i->nregions; r++)
            want_compared(x, i->region[r], listed || (i->op == OP_loop && i->imm.loop.cull), known);
    }
}

void bounds_want_lean(Boxes *x, uint32_t n) {
    if (x->from->dim != 2) return;
    uint8_t *known = ARENA_ARRAY(x->arena, uint8_t, n + 1);
    memset(known, UNKNOWN, n + 1);
    bool *wanted = x->leans = ARENA_ARRAY(x->arena, bool, n + 1), any = false;
    want_compared(x, x->from->body, false, known);
    for (uint32_t i = 0; i < n; i++) any |= wanted[i];
    if (!any) x->leans = NULL;
}

/* ---- sums and products, of which NULL is 0 */

static Inst *number(Builder *b, double v) { return ir_constf(b, v); }
static Inst *plus(Builder *b, Inst *p, Inst *q) { return !p ? q : !q ? p : ir_emit2(b, OP_fadd, p, q); }
static Inst *minus(Builder *b, Inst *p, Inst *q) {
    return !q ? p : !p ? ir_emit1(b, OP_fneg, q) : ir_emit2(b, OP_fsub, p, q);
}
static Inst *times(Builder *b, Inst *p, Inst *q) { return p && q ? ir_emit2(b, OP_fmul, p, q) : NULL; }
static Inst *magnitude(Builder *b, Inst *p) { return p ? ir_emit1(b, OP_fabs, p) : NULL; }

/* How far from mid, at most. */
static Inst *deviation(Builder *b, Lean v) {
    return plus(b, plus(b, magnitude(b, v.slope[0]), magnitude(b, v.slope[1])), v.rest);
}

/* Sixteen roundings of what is at most so large, and of what underflows. */
static Inst *with_rounding(const Boxes *x, Builder *b, Inst *rest, Inst *size) {
    const bool f64 = x->to->precision == PREC_F64;
    rest = plus(b, rest, times(b, size, number(b, 8 * (f64 ? DBL_EPSILON : (double)FLT_EPSILON))));
    return plus(b, rest, number(b, f64 ? DBL_MIN : (double)FLT_MIN));
}

/* The middle of two ends, and how far they are from it. */
static Lean between(const Boxes *x, Builder *b, Bound is) {
    Lean v = {.mid = plus(b, times(b, is.lo, number(b, 0.5)), times(b, is.hi, number(b, 0.5)))};
    Inst *above = minus(b, is.hi, v.mid), *below = minus(b, v.mid, is.lo);
    v.rest = ir_emit2(b, OP_fmax, above, below);
    v.rest = with_rounding(x, b, v.rest, plus(b, v.rest, magnitude(b, v.mid)));
    return v;
}

Lean bounds_lean_of(const Boxes *x, Builder *b, Boxed v) {
    if (v.lean.mid) return v.lean;
    return v.is.lo == v.is.hi ? (Lean){.mid = v.is.lo} : between(x, b, v.is);
}

/* ---- rows */

static Lean sum(const Boxes *x, Builder *b, bool less, Lean p, Lean q) {
    Lean r = {.mid = less ? minus(b, p.mid, q.mid) : plus(b, p.mid, q.mid)};
    for (uint32_t d = 0; d < 2; d++) r.slope[d] = (less ? minus : plus)(b, p.slope[d], q.slope[d]);
    Inst *size = plus(b, magnitude(b, r.mid), plus(b, deviation(b, p), deviation(b, q)));
    r.rest = with_rounding(x, b, plus(b, p.rest, q.rest), size);
    return r;
}

/* (p + dp) (q + dq) = p q + p dq + q dp + dp dq; of a square the last is not negative. */
static Lean product(const Boxes *x, Builder *b, Lean p, Lean q, bool square) {
    Inst *pm = magnitude(b, p.mid), *qm = magnitude(b, q.mid), *pd = deviation(b, p), *qd = deviation(b, q);
    Inst *both = times(b, pd, qd);
    Lean r = {.mid = times(b, p.mid, q.mid)};
    if (square && both) both = times(b, both, number(b, 0.5)), r.mid = plus(b, r.mid, both);
    for (uint32_t d = 0; d < 2; d++) r.slope[d] = plus(b, times(b, p.mid, q.slope[d]), times(b, q.mid, p.slope[d]));
    r.rest = plus(b, plus(b, times(b, pm, q.rest), times(b, qm, p.rest)), both);
    r.rest = with_rounding(x, b, r.rest, times(b, plus(b, pm, pd), plus(b, qm, qd)));
    return r;
}

/* Where it deviates by a larger part than this, of a divisor or under a root, nothing is said. */
#define MOST_PART 0.9

/* How much of its magnitude v deviates by; *ok: by no more than MOST_PART. */
static Inst *part(Builder *b, Lean v, Inst *size, Inst **ok) {
    Inst *p = ir_emit2(b, OP_fdiv, deviation(b, v), size);
    *ok = ir_emit2(b, OP_fle, p, number(b, MOST_PART));
    return p;
}

static Inst *if_ok(Builder *b, Inst *ok, Inst *rest) { return ir_select(b, ok, rest, number(b, INFINITY)); }

/* 1 / (1 + d) = 1 - d + d^2 / (1 + d), and the last is between 0 and D^2 / (1 - D) */
static Lean inverse(const Boxes *x, Builder *b, Lean v) {
    Inst *g = ir_emit2(b, OP_fdiv, number(b, 1), v.mid), *gm = magnitude(b, g), *ok;
    if (!deviation(b, v)) return (Lean){.mid = g, .rest = with_rounding(x, b, NULL, gm)};
    Inst *d = part(b, v, magnitude(b, v.mid), &ok), *room = ir_emit2(b, OP_fsub, number(b, 1), d);
    Inst *half = ir_emit2(b, OP_fdiv, times(b, times(b, d, d), number(b, 0.5)), room), *g2 = times(b, g, g);
    Lean r = {.mid = plus(b, g, times(b, g, half))};
    for (uint32_t k = 0; k < 2; k++)
        if (v.slope[k]) r.slope[k] = ir_emit1(b, OP_fneg, times(b, g2, v.slope[k]));
    r.rest = plus(b, times(b, g2, v.rest), times(b, gm, half));
    r.rest = if_ok(b, ok, with_rounding(x, b, r.rest, ir_emit2(b, OP_fdiv, gm, room)));
    return r;
}

/* sqrt(1 + d) = 1 + d/2 - e, and e is between 0 and d^2 / (2 (1 + sqrt(1 + d))^2), below D^2 / (2 (2 - D)^2) */
static Lean root(const Boxes *x, Builder *b, Lean v) {
    Inst *s = ir_emit1(b, OP_fsqrt, v.mid), *ok;
    if (!deviation(b, v)) return (Lean){.mid = s, .rest = with_rounding(x, b, NULL, s)};
    Inst *d = part(b, v, v.mid, &ok), *two = ir_emit2(b, OP_fsub, number(b, 2), d);
    ok = bounds_and(b, ok, ir_emit2(b, OP_flt, number(b, 0), v.mid));
    Inst *share = ir_emit2(b, OP_fdiv, d, two), *half = times(b, times(b, share, share), number(b, 0.25));
    Inst *slope = ir_emit2(b, OP_fdiv, number(b, 0.5), s);
    Lean r = {.mid = minus(b, s, times(b, s, half))};
    for (uint32_t k = 0; k < 2; k++) r.slope[k] = times(b, slope, v.slope[k]);
    r.rest = plus(b, times(b, slope, v.rest), times(b, s, half));
    r.rest = if_ok(b, ok, with_rounding(x, b, r.rest, plus(b, s, s)));
    return r;
}

Lean bounds_lean(const Boxes *x, Builder *b, const Inst *i, const Boxed *a) {
    Lean v[3] = {0}, r = {0};
    for (uint32_t k = 0; k < i->nargs; k++) v[k] = bounds_lean_of(x, b, a[k]);
    const bool same = i->nargs > 1 && i->args[0] == i->args[1];
    switch ((Op)i->op) {
    case OP_fadd:
    case OP_fsub: return sum(x, b, i->op == OP_fsub, v[0], v[1]);
    case OP_fmul: return product(x, b, v[0], v[1], same);
    case OP_ffma: return sum(x, b, false, product(x, b, v[0], v[1], same), v[2]);
    case OP_fdiv: return product(x, b, v[0], inverse(x, b, v[1]), false);
    case OP_fsqrt: return root(x, b, v[0]);
    default: /* fneg */
        r.mid = minus(b, NULL, v[0].mid), r.rest = v[0].rest;
        for (uint32_t d = 0; d < 2; d++)
            if (v[0].slope[d]) r.slope[d] = minus(b, NULL, v[0].slope[d]);
        return r;
    }
}

Lean bounds_lean_input(const Boxes *x, Builder *b, uint32_t axis, Bound is) {
    Lean v = between(x, b, is);
    v.slope[axis] = v.rest, v.rest = NULL;
    return v;
}

Lean bounds_lean_where(const Boxes *x, Builder *b, Inst *which, Boxed p, Boxed q) {
    Lean r = {0}, v[2] = {bounds_lean_of(x, b, p), bounds_lean_of(x, b, q)};
    Inst *const zero = number(b, 0);
    r.mid = bounds_choose(b, which, v[0].mid, v[1].mid);
    for (uint32_t d = 0; d < 2; d++)
        if (v[0].slope[d] != v[1].slope[d])
            r.slope[d] =
                bounds_choose(b, which, v[0].slope[d] ? v[0].slope[d] : zero, v[1].slope[d] ? v[1].slope[d] : zero);
        else r.slope[d] = v[0].slope[d];
    if (v[0].rest != v[1].rest)
        r.rest = bounds_choose(b, which, v[0].rest ? v[0].rest : zero, v[1].rest ? v[1].rest : zero);
    else r.rest = v[0].rest;
    return r;
}

/* An end that would be no number stays what it was. */
Bound bounds_lean_meets(const Boxes *x, Builder *b, Bound is, Lean v) {
    Inst *far = deviation(b, v);
    far = with_rounding(x, b, far, plus(b, magnitude(b, v.mid), far));
    return (Bound){ir_emit2(b, OP_fmax, is.lo, minus(b, v.mid, far)), ir_emit2(b, OP_fmin, is.hi, plus(b, v.mid, far))};
}

Bound bounds_lean_order(const Boxes *x, Builder *b, const Inst *i, const Boxed *a, Bound is) {
    if (!(x->fact[i->args[0]->id] & x->fact[i->args[1]->id] & FACT_LEAN)) return is;
    const Lean d = sum(x, b, true, bounds_lean_of(x, b, a[0]), bounds_lean_of(x, b, a[1]));
    Inst *far = deviation(b, d);
    far = with_rounding(x, b, far, plus(b, magnitude(b, d.mid), far));
    Inst *below = ir_emit2(b, OP_flt, plus(b, d.mid, far), number(b, 0)),
         *above = ir_emit2(b, OP_flt, number(b, 0), minus(b, d.mid, far));
    return (Bound){bounds_op2(b, OP_bor, is.lo, below), bounds_op2(b, OP_band, is.hi, bounds_not(b, above))};
}
