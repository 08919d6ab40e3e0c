/* Arrays of parameters' numbers that kernels compute, behind the parameters (compiler/front/front.h, Derived): where
 * vertices are placed, their normals. To all else that samples they are parameters like any others; here they follow
 * the parameters, and derivatives in them become derivatives in the parameters.
 *
 *   values   parameters -> arrays          before geometries follow, and where parameters are moved
 *   push     a direction in parameters -> in arrays too            before forward mode
 *   pull     a derivative in all numbers -> in parameters alone    behind reverse mode
 *
 * Element after element, in one thread: the same bits always. False: memory ran out. */
#ifndef SALTUS_SAMPLE_DERIVED_H
#define SALTUS_SAMPLE_DERIVED_H

#include "runtime/sample/estimate.h"

/* One array, whose kernels VALUE, JVP and VJP take the number of an element, k0, and give its three numbers. NULL:
 * none of them is differentiated. Later arrays may read earlier ones. */
typedef struct SltDerived {
    SltScene scene;
    uint32_t base, n; /* its slice: n times 3 */
} SltDerived;

enum { DERIVED_EACH = 3 };

/* Array d of flt params[nfloats], from those before it. */
bool derived_value(const SltScene *s, uint32_t d, void *params);
bool derived_values(const SltScene *s, void *params);
bool derived_push(const SltScene *s, double *direction);
bool derived_pull(const SltScene *s, double *derivative);
/* Of errors, all >= 0, that may have any signs: none of them cancels. */
bool derived_pull_error(const SltScene *s, double *error);

/* How many of the floats are parameters. */
static inline uint32_t scene_params(const SltScene *s) { return s->nfloats - s->nplaced; }

#endif
