/* What values may be: the range column of ops.def, and the two analyses that use it.
 *
 * lo and hi bound the finite values; `beyond` says what else the value may be. Unknown is {-inf, inf, 0}: sums and
 * products of finite values count as finite, or ordinary code would pay for overflows that no program wants. A pole
 * makes an infinity out of ordinary numbers, an overflow (exp, what loops square again and again) only out of large
 * ones; what loops carry otherwise (IR_CARRIED; IR_SQUARED, a product of two such) in more steps than anybody takes. A
 * NaN comes of roots and logarithms of what may be negative, of 0/0, and of poles and overflows that meet.
 *
 * Bounds of integers are exact: clamps of indices may be left out because of them. Those of floats are computed in
 * double and hold up to the rounding of the kernel's own precision, so no bound of an integer rests on them. */
#ifndef SALTUS_IR_RANGE_H
#define SALTUS_IR_RANGE_H

#include <math.h>

#include "compiler/ir/ir.h"

enum { IR_CARRIED = 1, IR_SQUARED = 2, IR_OVERFLOW = 4, IR_POLE = 8, IR_NAN = 16 };
typedef struct IrRange {
    double lo, hi;
    uint8_t beyond; /* all but IR_NAN: it may be infinite */
} IrRange;
#define IR_RANGE_FINITE ((IrRange){-INFINITY, INFINITY, 0})
#define IR_RANGE_CARRIED ((IrRange){-INFINITY, INFINITY, IR_CARRIED})
#define IR_RANGE_WIDE ((IrRange){-INFINITY, INFINITY, IR_OVERFLOW | IR_POLE})
#define IR_RANGE_ANY ((IrRange){-INFINITY, INFINITY, IR_OVERFLOW | IR_POLE | IR_NAN})
#define IR_RANGE_INT ((IrRange){INT32_MIN, INT32_MAX, 0})

static inline bool ir_range_nonzero(IrRange r) { return r.lo > 0 || r.hi < 0; }
IrRange ir_range_const(double v);
/* The range column of op, before integers wrap. same: the first two arguments are one value. */
IrRange ir_range_row(Op op, IrRange a, IrRange b, IrRange c, bool same);

/* range.c */
/* Forwards through a whole Fn with dense ids: fills range[ninsts], by id of value or block parameter. told (may be
 * NULL): values whose NaN is of no interest, by id. */
void ir_ranges(const Fn *fn, Arena *scratch, const uint8_t *told, IrRange *range);

/* range_told.c */
/* Fills told[ninsts] with 1 where a NaN makes every float that the Fn gives NaN, else 0. */
void ir_told(const Fn *fn, Arena *scratch, uint8_t *told);

/* range.c */

/* Backwards from one integer, a few operands deep, without looking at the rest of the Fn. known (may be NULL): ranges
 * that the caller knows better, by Inst.tag; a tag of 0, or of nknown and more, has none. */
IrRange ir_range_of(const Inst *i, const IrRange *known, uint32_t nknown);
/* Likewise from one float, with every rounding on the way in either precision: it holds exactly, where v is no NaN. */
IrRange ir_range_rounded(const Inst *v);
/* Is its sign clear, or is it a NaN? By a look a few operands deep. */
bool ir_is_never_negative(const Inst *v);

#endif
