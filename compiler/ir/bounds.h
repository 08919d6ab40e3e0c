/* Bounds: the bounds and events columns of ops.def as code, built into a Fn that computes on boxes instead of points.
 *
 * A Bound holds for all points of a box at once. It bounds the *rounded* value, which is what kernels decide by: rows
 * that are correctly rounded are monotone, so the same row on the ends, rounded to nearest, encloses it; elementary
 * functions are polynomials that are monotone only up to their errors, so their ends are widened by twice those (Moore
 * 1966, with the program's own arithmetic in the place of directed rounding). A zero end stands for both zeros.
 *
 *   floats    [lo, hi]. An end that is NaN says that *nothing* is known, whatever the other end is. Otherwise no value
 * at any point of the box is below lo or above hi, and where it may be NaN, lo is -inf and hi is inf. integers  [lo,
 * hi] as signed numbers, always true; unknown is the whole range booleans  lo: it holds at every point; hi: it may hold
 * at some point. false, true: open
 *
 * So sums and products carry what is unknown along by themselves. What drops a NaN must not be applied to ends by hand:
 * comparisons, hulls, minima are functions here. ir_bound_ends gives ends that can be looked at one by one.
 *
 * Instructions are made at the builder's place and owned by its Fn. Two equal pointers are a point, whose value is
 * exact: rows of points stay one instruction. */
#ifndef SALTUS_IR_BOUNDS_H
#define SALTUS_IR_BOUNDS_H

#include "compiler/ir/ir.h"

typedef struct Bound {
    Inst *lo, *hi;
} Bound;

static inline Bound ir_bound_point(Inst *v) { return (Bound){v, v}; }
Bound ir_bound_whole(Builder *b, IrType t);

/* What is known of the arguments of a row beside their bounds, bits. */
enum {
    BOUND_SAME = 1,      /* the first two are one value: x*x, a square, which is not negative */
    BOUND_NO_MINUS_0 = 2 /* the first is never -0, as a magnitude is not */
};
/* The bounds column of value row op on the bounds a[0..n) of its arguments. known: BOUND_*. */
Bound ir_bound_row(Builder *b, Op op, const Bound *a, uint32_t n, uint32_t known);

/* The events column: what else may happen to the row on the box, as booleans; NULL: never. Meant are events of its own:
 * what jumps or bends in its arguments is theirs. */
typedef struct BoundEvents {
    Inst *jumps; /* may be discontinuous in float arguments, or have a pole or an end of its domain */
    Inst *bends; /* continuous, but may not be differentiable */
} BoundEvents;
BoundEvents ir_bound_events(Builder *b, Op op, const Bound *a, uint32_t n, uint32_t known);
bool ir_bound_has_events(Op op); /* is there a box on which the row has any? */

/* Holds for what x holds for and for what y holds for. */
Bound ir_bound_hull(Builder *b, Bound x, Bound y);
/* The row of a choice: x where cond holds for certain, y where it cannot hold, else the hull. */
Bound ir_bound_select(Builder *b, Bound cond, Bound x, Bound y);
/* Has the box one value only? A boolean. */
Inst *ir_bound_is_point(Builder *b, Bound x);
/* Floats: is the value known to be a number (not NaN) on the whole box? */
Inst *ir_bound_is_number(Builder *b, Bound x);
/* Floats: the same with ends that are no NaN: each holds by itself, and where the value may be NaN they are -inf, inf.
 */
Bound ir_bound_ends(Builder *b, Bound x);

#endif
