/* Intervals with derivatives and a running error, in double: what `bounds` and the edge kernels compute, written in C.
 * The ends are rounded to nearest as the points are, which encloses them; elementary functions are widened. */
#ifndef SALTUS_TESTS_QUADRATURE_INTERVAL_H
#define SALTUS_TESTS_QUADRATURE_INTERVAL_H

#include <math.h>
#include <stdbool.h>

typedef struct Iv {
    double lo, hi;
} Iv;
enum { NUM_D = 4 }; /* derivatives in x, y, z and in one parameter */
typedef struct Num {
    Iv v, d[NUM_D];
    double error;      /* of v as computed */
    bool jumps, bends; /* somewhere on the box */
} Num;

static inline Iv iv(double lo, double hi) { return (Iv){lo, hi}; }
static inline Iv iv_known(Iv a) { return a.lo <= a.hi ? a : iv(-HUGE_VAL, HUGE_VAL); }
static inline Iv iv_add(Iv a, Iv b) { return iv_known(iv(a.lo + b.lo, a.hi + b.hi)); }
static inline Iv iv_neg(Iv a) { return iv(-a.hi, -a.lo); }
static inline double times(double a, double b) { return a == 0 || b == 0 ? 0 : a * b; }
static inline Iv iv_mul(Iv a, Iv b) {
    double p = times(a.lo, b.lo), q = times(a.lo, b.hi), r = times(a.hi, b.lo), s = times(a.hi, b.hi);
    return iv_known(iv(fmin(fmin(p, q), fmin(r, s)), fmax(fmax(p, q), fmax(r, s))));
}
static inline Iv iv_hull(Iv a, Iv b) { return iv(fmin(a.lo, b.lo), fmax(a.hi, b.hi)); }
static inline Iv iv_div(Iv a, Iv b) {
    return b.lo > 0 || b.hi < 0 ? iv_mul(a, iv(1 / b.hi, 1 / b.lo)) : iv(-HUGE_VAL, HUGE_VAL);
}
static inline double iv_size(Iv a) { return fmax(fabs(a.lo), fabs(a.hi)); }

static inline Num num(double v) { return (Num){.v = {v, v}}; }
static inline Num num_out(Num r) {
    r.error += 0x1p-53 * iv_size(r.v);
    return r;
}
static inline Num num_add(Num a, Num b) {
    Num r = {.v = iv_add(a.v, b.v), .error = a.error + b.error, a.jumps || b.jumps, a.bends || b.bends};
    for (int i = 0; i < NUM_D; i++) r.d[i] = iv_add(a.d[i], b.d[i]);
    return num_out(r);
}
static inline Num num_neg(Num a) {
    a.v = iv_neg(a.v);
    for (int i = 0; i < NUM_D; i++) a.d[i] = iv_neg(a.d[i]);
    return a;
}
static inline Num num_sub(Num a, Num b) { return num_add(a, num_neg(b)); }
static inline Num num_mul(Num a, Num b) {
    Num r = {.v = iv_mul(a.v, b.v),
             .error = a.error * iv_size(b.v) + b.error * iv_size(a.v),
             a.jumps || b.jumps,
             a.bends || b.bends};
    for (int i = 0; i < NUM_D; i++) r.d[i] = iv_add(iv_mul(a.v, b.d[i]), iv_mul(b.v, a.d[i]));
    return num_out(r);
}
static inline Num num_scale(double k, Num a) { return num_mul(num(k), a); }
/* f(a) with slope between the ends of `slope` on all of a. */
static inline Num num_chain(Num a, Iv value, Iv slope) {
    Num r = {.v = value, .error = a.error * iv_size(slope), a.jumps, a.bends};
    for (int i = 0; i < NUM_D; i++) r.d[i] = iv_mul(slope, a.d[i]);
    return num_out(r);
}
static inline Num num_sqr(Num a) {
    double p = a.v.lo * a.v.lo, q = a.v.hi * a.v.hi;
    Iv v = iv(a.v.lo <= 0 && a.v.hi >= 0 ? 0 : fmin(p, q), fmax(p, q));
    return num_chain(a, v, iv(2 * a.v.lo, 2 * a.v.hi));
}
static inline Num num_sqrt(Num a) {
    double lo = sqrt(fmax(0, a.v.lo)), hi = sqrt(fmax(0, a.v.hi));
    return num_chain(a, iv(lo, hi), iv(0.5 / hi, lo > 0 ? 0.5 / lo : HUGE_VAL));
}
static inline Num num_inv(Num a) {
    Iv v = iv_div(iv(1, 1), a.v);
    return num_chain(a, v, iv_neg(iv_mul(v, v)));
}
static inline Iv iv_sin(Iv a) {
    const double half = 1.57079632679489661923;
    if (!(a.hi - a.lo < 4 * half)) return iv(-1, 1);
    double p = sin(a.lo), q = sin(a.hi);
    Iv r = iv(fmin(p, q) - 0x1p-50, fmax(p, q) + 0x1p-50);
    if (ceil((a.lo / half - 1) / 4) <= (a.hi / half - 1) / 4) r.hi = 1;
    if (ceil((a.lo / half + 1) / 4) <= (a.hi / half + 1) / 4) r.lo = -1;
    return r;
}
static inline Num num_sin(Num a) {
    Iv turned = iv(a.v.lo + 1.57079632679489661923, a.v.hi + 1.57079632679489661923);
    Iv v = a.v.lo == a.v.hi ? iv(sin(a.v.lo), sin(a.v.lo)) : iv_sin(a.v);
    return num_chain(a, v, a.v.lo == a.v.hi ? iv(cos(a.v.lo), cos(a.v.lo)) : iv_sin(turned));
}
static inline Num num_cos(Num a) { return num_sin(num_add(a, num(1.57079632679489661923))); }
static inline Num num_max(Num a, Num b) {
    if (a.v.lo >= b.v.hi) return a;
    if (b.v.lo >= a.v.hi) return b;
    Num r = {
        .v = {fmax(a.v.lo, b.v.lo), fmax(a.v.hi, b.v.hi)}, .error = fmax(a.error, b.error), a.jumps || b.jumps, true};
    for (int i = 0; i < NUM_D; i++) r.d[i] = iv_hull(a.d[i], b.d[i]);
    return r;
}
static inline Num num_min(Num a, Num b) { return num_neg(num_max(num_neg(a), num_neg(b))); }
static inline Num num_abs(Num a) { return num_max(a, num_neg(a)); }
static inline Num num_floor(Num a) {
    Num r = {.v = {floor(a.v.lo), floor(a.v.hi)}};
    r.jumps = a.jumps || r.v.lo < r.v.hi;
    if (r.jumps)
        for (int i = 0; i < NUM_D; i++) r.d[i] = iv(-HUGE_VAL, HUGE_VAL);
    return r;
}
static inline double num_mid(Num a) { return a.v.lo; } /* of a point */

#endif
