/* Inside ir/bounds*.c: the vocabulary of the bounds column, and what its rules share. Each rule takes the row at hand.
 */
#ifndef SALTUS_IR_BOUNDS_RULES_H
#define SALTUS_IR_BOUNDS_RULES_H

#include <float.h>
#include <math.h>

#include "compiler/ir/bounds.h"

/* Test builds only: one kind of mistake, made wherever it can be. Each must be noticed (tests/ir/test_bounds.c). */
enum {
    SPOIL_NOTHING,
    SPOIL_WIDENING, /* elementary functions are not moved outward */
    SPOIL_ENDS,     /* the ends of a trend are swapped */
    SPOIL_TREND,    /* what falls in its last argument rises */
    SPOIL_WHERE,    /* the condition of a bound is dropped */
    SPOIL_NAN,      /* ends that are NaN count as ends */
    SPOIL_LINE,     /* the whole line counts as numbers */
    SPOIL_SQUARE,   /* the least square is that of an end */
    SPOIL_CORNER,   /* a product forgets a corner */
    SPOIL_SIGN,     /* a negative factor or divisor turns nothing */
    SPOIL_TURN,     /* the extremes of waves, a quadrant off */
    SPOIL_FAR,      /* waves and poles are trusted anywhere */
    SPOIL_POINTS,   /* bits are mixed at one end */
    SPOIL_EQUAL,    /* comparisons take the other end */
    SPOIL_KINDS
};
#ifdef SALTUS_BOUNDS_MUTATION
extern int bound_mutation;
#define SPOILED(kind) (bound_mutation == (kind))
#else
#define SPOILED(kind) false
#endif

typedef struct Rule {
    Builder b; /* folds: only the sign of a zero end may differ, which says nothing */
    Op op;
    const Bound *arg;
    Bound source[3], instead[3]; /* of bound_points */
    uint32_t n;
    bool same, no_minus_0; /* BOUND_SAME, BOUND_NO_MINUS_0 */
    bool f64;
} Rule;

static inline Inst *e1(Rule *r, Op op, Inst *x) { return ir_emit1(&r->b, op, x); }
static inline Inst *e2(Rule *r, Op op, Inst *x, Inst *y) { return ir_emit2(&r->b, op, x, y); }
static inline Inst *e3(Rule *r, Op op, Inst *x, Inst *y, Inst *z) { return ir_emit3(&r->b, op, x, y, z); }
static inline Inst *num(Rule *r, double v) { return ir_constf(&r->b, v); }
static inline Inst *int_num(Rule *r, int32_t v) { return ir_consti(&r->b, v); }
static inline Inst *both(Rule *r, Inst *x, Inst *y) { return e2(r, OP_band, x, y); }
static inline Inst *either(Rule *r, Inst *x, Inst *y) { return e2(r, OP_bor, x, y); }
static inline Inst * not(Rule * r, Inst *x) { return e1(r, OP_bnot, x); }
static inline Inst *sel(Rule *r, Inst *cond, Inst *x, Inst *y) { return ir_select(&r->b, cond, x, y); }
static inline Inst *lt(Rule *r, Inst *x, Inst *y) { return e2(r, OP_flt, x, y); }
static inline Inst *le(Rule *r, Inst *x, Inst *y) { return e2(r, OP_fle, x, y); }
static inline Inst *is_number(Rule *r, Inst *x) { return e2(r, OP_feq, x, x); }
static inline Inst *max(Rule *r, Inst *x, Inst *y) { return e2(r, OP_fmax, x, y); } /* a NaN in x stays, in y it goes */
static inline Inst *min(Rule *r, Inst *x, Inst *y) { return e2(r, OP_fmin, x, y); } /* likewise */
static inline bool is_point(Bound x) { return x.lo == x.hi; }
static inline bool is_constant(Bound x) { return is_point(x) && x.lo->op == OP_constf; }
static inline Bound at(Inst *v) { return ir_bound_point(v); }

enum { UP = 0, DOWN = 1 };
/* The row on the ends: it rises in each argument, or falls where a bit is set. */
Bound bound_trend(Rule *r, uint32_t falls);
/* x where ok, else unknown. */
Bound bound_where(Rule *r, Inst *ok, Bound x);
/* Floats: no end is NaN. */
static inline Inst *has_ends(Rule *r, Bound x) {
    return SPOILED(SPOIL_NAN) ? ir_constb(&r->b, true) : le(r, x.lo, x.hi);
}
/* Floats: no end is NaN, nor is the bound the whole line: the value is a number. */
Inst *bound_is_number(Rule *r, Bound x);
/* The least and the greatest magnitude of a float, for even functions. Of the whole line the least is -inf, so that
 * whoever squares it makes it NaN; MAGNITUDE is what is not below 0. */
Bound bound_even(Rule *r, Bound x);

Rule bound_rule(Builder *b, Op op, const Bound *a, uint32_t n, uint32_t known);
bool bound_all_points(const Bound *a, uint32_t n);
Bound bound_row(Rule *r); /* the column, for arguments not all of which are points */
/* Is the extreme of x and y known? It is NaN where x is. */
static inline Inst *bound_extreme_known(Rule *r, Bound x, Bound y) {
    return both(r, bound_is_number(r, x), has_ends(r, y));
}

/* bounds_math.c: elementary functions. ulps: the largest error of the row. */
Bound bound_near(Rule *r, double ulps, Bound x);
Bound bound_log(Rule *r, double ulps);
Bound bound_wave(Rule *r, double ulps, double phase);
Bound bound_tan(Rule *r, double ulps);
Bound bound_atan2(Rule *r, double ulps, Inst **uncut);
Bound bound_pow(Rule *r, double ulps);

/* bounds_int.c: integers, conversions */
bool bound_is_point_where(Bound x);
void bound_points_begin(Rule *r);
Bound bound_points(Rule *r, Bound other);
Inst *bound_int_is_point(Builder *b, Bound x);
Bound bound_sum(Rule *r);
Bound bound_product(Rule *r);
Bound bound_quotient(Rule *r);
Bound bound_remainder(Rule *r, bool is_unsigned);
Bound bound_and(Rule *r);
Bound bound_shift(Rule *r);
Bound bound_unwrapped(Rule *r, Bound x);
Bound bound_if_positive(Rule *r, Bound x);
Bound bound_int_compare(Rule *r);
Bound bound_int_equal(Rule *r);
Bound bound_where_int(Rule *r, Inst *ok, Bound x);
Bound bound_unsigned_float(Rule *r);
Bound bound_bits(Rule *r);
Bound bound_from_bits(Rule *r);
Bound bound_exponent(Rule *r);
Bound bound_power_of_two(Rule *r);
Bound bound_mantissa(Rule *r);

#endif
