/* Instantiates the value expressions of ops.def in float and in double. <tgmath.h> makes sqrt(a) of a float a float
 * function, so the f32 evaluator never computes in double; -ffp-contract=off keeps a*b + c two roundings. */
#include <math.h>
#include <string.h>
#include <tgmath.h>

#undef I /* the imaginary unit of <complex.h>; in the rows I is the integer type */

#include "compiler/ir/ir.h"
#include "compiler/ir/logs.h"
#include "compiler/ir/rows.h"

typedef int32_t I;
typedef uint32_t U;

static inline int32_t bits_of_f32(float x) {
    int32_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}
static inline float f32_of_bits(int32_t bits) {
    float x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

/* ---- parts of logarithms (logs.h). In double the sums of the two tables are exact, whatever they are rounded to then.
 */
typedef struct LogSplit {
    double e, m; /* |x| = 2^e m, m in [1, 2); of 0 and infinity e is infinite */
    int k;
} LogSplit;

static LogSplit log_split(double x) {
    const double a = fabs(x);
    LogSplit s = {.e = a == 0 ? -INFINITY : a, .m = 1};
    if (a > 0 && a < INFINITY) s.e = ilogb(a), s.m = scalbn(a, -(int)s.e);
    s.k = (int)((s.m - 1 + LOG_OFFSET * 0x1p-23) * 8);
    return s;
}

static double log_rest(double x) {
    const LogSplit s = log_split(x);
    return x >= 0 ? fma(s.m, log_inverse[s.k], -1) : NAN;
}
static double log_high(double x) {
    const LogSplit s = log_split(x);
    return s.e * log_ln2_high + log_table_high[s.k];
}
static double log_low(double x) {
    const LogSplit s = log_split(x);
    return s.e * log_ln2_low + log_table_low[s.k];
}

#define T float
#define ROWS_NAME rows_eval_f32
#include "compiler/ir/rows_body.h"
#undef T
#undef ROWS_NAME

#define T double
#define ROWS_NAME rows_eval_f64
#include "compiler/ir/rows_body.h"
#undef T
#undef ROWS_NAME
