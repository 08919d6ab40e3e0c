/* Bounds of the elementary functions.
 *
 * What kernels compute is a polynomial with an error of a few units in the last place: where the function rises, the
 * polynomial may fall by as much. So the row is evaluated at the end, and moved outward by its error twice, once for
 * that end and once for the point inside. Results that would be subnormal may be 0: hence the smallest normal number.
 */
#include "compiler/ir/bounds_rules.h"

static double epsilon(const Rule *r) { return r->f64 ? DBL_EPSILON : (double)FLT_EPSILON; }
static double least(const Rule *r) { return r->f64 ? DBL_MIN : (double)FLT_MIN; }
static double greatest(const Rule *r) { return r->f64 ? DBL_MAX : (double)FLT_MAX; }

static Inst *slack(Rule *r, double ulps, Inst *x) {
    Inst *part = e2(r, OP_fmul, e1(r, OP_fabs, x), num(r, (2 * ulps + 2) * epsilon(r)));
    return e2(r, OP_fadd, part, num(r, least(r)));
}

/* Where an overflow is an end, a value inside may still be finite. */
Bound bound_near(Rule *r, double ulps, Bound x) {
    if (SPOILED(SPOIL_WIDENING)) return x;
    Inst *lo = min(r, x.lo, num(r, greatest(r))), *hi = max(r, x.hi, num(r, -greatest(r)));
    return (Bound){e2(r, OP_fsub, lo, slack(r, ulps, lo)), e2(r, OP_fadd, hi, slack(r, ulps, hi))};
}

/* Of subnormal numbers in f32 only that it is about the logarithm of the smallest normal one: the exponent is taken
 * from the bits. */
Bound bound_log(Rule *r, double ulps) {
    Bound x = r->arg[0];
    Inst *normal = num(r, least(r));
    Bound y = {e1(r, r->op, x.lo), e1(r, r->op, max(r, x.hi, normal))};
    Bound wide = bound_near(r, ulps, y);
    Inst *tiny = both(r, le(r, num(r, 0), x.lo), lt(r, x.lo, normal));
    return (Bound){sel(r, tiny, num(r, -INFINITY), wide.lo), wide.hi};
}

static const double one_over_pi = 0.318309886183790671538;
/* Up to here the error of x/2pi, relative 2^-23 or 2^-52, stays below half the margin. */
static double wave_limit(const Rule *r) { return r->f64 ? 1e5 : 4096; }
static double wave_margin(const Rule *r) { return r->f64 ? 1e-9 : 4e-4; }

/* Is there an integer in [lo - margin, hi + margin]? */
static Inst *holds_integer(Rule *r, Inst *lo, Inst *hi, double margin) {
    if (SPOILED(SPOIL_TURN)) lo = e2(r, OP_fadd, lo, num(r, 0.25)), hi = e2(r, OP_fadd, hi, num(r, 0.25));
    Inst *n = e1(r, OP_ffloor, e2(r, OP_fadd, hi, num(r, margin)));
    return le(r, e2(r, OP_fsub, lo, num(r, margin)), n);
}

static Inst *inside(Rule *r, double limit) {
    if (SPOILED(SPOIL_FAR)) return ir_constb(&r->b, true);
    return both(r, le(r, num(r, -limit), r->arg[0].lo), le(r, r->arg[0].hi, num(r, limit)));
}

/* sin(x) and cos(x) are 1 at x/2pi = phase + n, -1 half a turn further. Beyond the limit [-1, 1]; of infinities NaN. */
Bound bound_wave(Rule *r, double ulps, double phase) {
    Bound x = r->arg[0], one = {num(r, -1), num(r, 1)};
    Inst *turns = num(r, one_over_pi / 2);
    Inst *lo = e2(r, OP_fsub, e2(r, OP_fmul, x.lo, turns), num(r, phase));
    Inst *hi = e2(r, OP_fsub, e2(r, OP_fmul, x.hi, turns), num(r, phase));
    Inst *half = num(r, 0.5), *near = inside(r, wave_limit(r));
    Inst *top = holds_integer(r, lo, hi, wave_margin(r));
    Inst *bottom = holds_integer(r, e2(r, OP_fadd, lo, half), e2(r, OP_fadd, hi, half), wave_margin(r));
    Inst *p = e1(r, r->op, x.lo), *q = e1(r, r->op, x.hi);
    Bound y = bound_near(r, ulps, (Bound){min(r, p, q), max(r, p, q)});
    Inst *far = not(r, near);
    y = (Bound){sel(r, either(r, bottom, far), one.lo, max(r, y.lo, one.lo)),
                sel(r, either(r, top, far), one.hi, min(r, y.hi, one.hi))};
    Inst *finite = both(r, lt(r, num(r, -INFINITY), x.lo), lt(r, x.hi, num(r, INFINITY)));
    return bound_where(r, finite, y);
}

/* Between two poles; unknown where one may be inside. What rounding puts on the other side of a pole shows in ends that
 * are the wrong way round. */
Bound bound_tan(Rule *r, double ulps) {
    Bound x = r->arg[0];
    double limit = wave_limit(r), margin = 2 * wave_margin(r);
    Inst *turns = num(r, one_over_pi), *lo = e2(r, OP_fmul, x.lo, turns), *hi = e2(r, OP_fmul, x.hi, turns);
    Inst *n = e1(r, OP_fround, lo), *reach = num(r, 0.5 - margin);
    Inst *between = both(r, lt(r, e2(r, OP_fsub, n, lo), reach), lt(r, e2(r, OP_fsub, hi, n), reach));
    Bound y = bound_trend(r, 0);
    Inst *known = both(r, both(r, between, inside(r, limit)), has_ends(r, y));
    return bound_where(r, known, bound_near(r, ulps, y));
}

/* The angle of a box that holds neither the origin nor a part of the cut (y = 0, x <= 0): the corners at which it is
 * least and greatest. To y that is never -0 the cut's upper side belongs. uncut, if asked for, is all that is made. */
Bound bound_atan2(Rule *r, double ulps, Inst **uncut) {
    Bound y = r->arg[0], x = r->arg[1];
    Inst *zero = num(r, 0), *below = lt(r, y.hi, zero);
    Inst *clear = either(r, either(r, lt(r, zero, y.lo), below), lt(r, zero, x.lo));
    Inst *known = is_number(r, e2(r, OP_fadd, e2(r, OP_fadd, y.lo, y.hi), e2(r, OP_fadd, x.lo, x.hi)));
    if (r->no_minus_0) { /* the end may be, as it stands for both zeros */
        clear = either(r, clear, both(r, le(r, zero, y.lo), lt(r, x.hi, zero)));
        y.lo = e1(r, OP_fabs, y.lo);
    }
    clear = both(r, clear, known);
    if (uncut) {
        *uncut = clear;
        return (Bound){0};
    }
    Inst *x_least = sel(r, lt(r, y.lo, zero), x.lo, x.hi), *x_most = sel(r, below, x.hi, x.lo);
    Inst *y_least = sel(r, lt(r, zero, x_least), y.lo, y.hi), *y_most = sel(r, lt(r, zero, x_most), y.hi, y.lo);
    Bound z = bound_near(r, ulps, (Bound){e2(r, r->op, y_least, x_least), e2(r, r->op, y_most, x_most)});
    const double turn = 3.14159265358979323846 * (1 + 8 * epsilon(r));
    return bound_where(r, known, (Bound){sel(r, clear, z.lo, num(r, -turn)), sel(r, clear, z.hi, num(r, turn))});
}

/* b log a is bilinear in b and log a: over a >= 0 the extremes are at corners. pow(-0, b) of b < 0 may be -inf, so a
 * zero asks for b >= 0. */
static Bound power_corners(Rule *r, double ulps) {
    Bound x = r->arg[0], y = r->arg[1];
    Inst *zero = num(r, 0), *ok = either(r, lt(r, zero, x.lo), both(r, le(r, zero, x.lo), le(r, zero, y.lo)));
    ok = both(r, ok, bound_is_number(r, y)); /* an end of x that is NaN stays at hi */
    Bound z;
    if (is_point(x) || is_point(y)) {
        Inst *p = e2(r, r->op, x.lo, y.lo), *q = e2(r, r->op, x.hi, y.hi);
        z = (Bound){min(r, p, q), max(r, q, p)};
    } else {
        Inst *a = e2(r, r->op, x.lo, y.lo), *b = e2(r, r->op, x.lo, y.hi), *c = e2(r, r->op, x.hi, y.lo),
             *d = e2(r, r->op, x.hi, y.hi);
        z = (Bound){min(r, min(r, a, b), min(r, c, d)), max(r, max(r, d, c), max(r, a, b))};
        ok = both(r, ok, is_number(r, e2(r, OP_fadd, b, c)));
    }
    z = bound_near(r, ulps, z);
    return bound_where(r, ok, (Bound){max(r, z.lo, zero), z.hi});
}

/* A constant exponent that is an integer: even, or odd and rising or falling on either side of 0. */
Bound bound_pow(Rule *r, double ulps) {
    Bound x = r->arg[0], y = r->arg[1];
    bool integer = is_constant(y) && y.lo->imm.f == floor(y.lo->imm.f) && fabs(y.lo->imm.f) < 0x1p24;
    if (!integer || y.lo->imm.f == 0) return power_corners(r, ulps);
    double n = y.lo->imm.f;
    bool odd = fmod(n, 2) != 0;
    if (!odd) {
        Bound m = bound_even(r, x);
        x = (Bound){max(r, m.lo, num(r, 0)), m.hi};
    }
    Bound z = {e2(r, r->op, n > 0 ? x.lo : x.hi, y.lo), e2(r, r->op, n > 0 ? x.hi : x.lo, y.lo)};
    z = bound_near(r, ulps, z);
    Inst *ok = bound_is_number(r, r->arg[0]);
    if (n < 0) {
        Inst *zero = num(r, 0);
        ok = both(r, ok, either(r, lt(r, zero, r->arg[0].lo), lt(r, r->arg[0].hi, zero)));
    }
    return bound_where(r, ok, odd ? z : (Bound){max(r, z.lo, num(r, 0)), z.hi});
}
