/* Instantiates the value expressions of ops.def in float and in double. <tgmath.h> makes sqrt(a) of a float a float
 * function, so the f32 evaluator never computes in double; -ffp-contract=off keeps a*b + c two roundings. */
#include <math.h>
#include <string.h>
#include <tgmath.h>

#undef I /* the imaginary unit of <complex.h>; in the rows I is the integer type */

#include "compiler/ir/ir.h"
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
