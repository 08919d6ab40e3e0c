/* What bounds know of given boxes: for slt_bound, for pictures and tests. Cells ask the same kernels in their own order
 * (cells.h).
 *
 * A box is what lies between two corners, both included, rounded to the program's precision as points are: it holds
 * every point that rounds to one inside. */
#ifndef SALTUS_QUADRATURE_BOXES_H
#define SALTUS_QUADRATURE_BOXES_H

#include "runtime/sample/estimate.h"

/* An event that may decide either way on the box. Unknown ends are infinite, never NaN. */
typedef struct BoxEvent {
    int32_t edge, k[SLT_MAX_K]; /* k: loop indices, outermost first */
    double first, last;         /* of a rounding: the least and the greatest boundary of its integer; else 0 */
    double line[2];             /* of a ray that meets a mesh: a line (saltus/mesh.h); else 0 */
    double g[2], dg[3][2];      /* bounds of g (of the least boundary) and of its gradient */
    int32_t state;              /* SLT_EDGE_* bits */
} BoxEvent;

typedef struct BoxFacts {
    int32_t state;         /* SLT_BOX_* bits */
    uint32_t open, listed; /* events that may decide either way; how many of them are listed */
    uint32_t loops;        /* numbers in k */
    BoxEvent event[SLT_MAX_OPEN];
    double f[SLT_MAX_CHANNELS][2];
} BoxFacts;

/* Gets box i; from any of the job's threads, each box once. */
typedef void BoxTake(void *user, uint64_t i, const BoxFacts *facts);

/* lo[n][dim], hi[n][dim]: corners, finite in the program's precision. A program without a bounds kernel knows nothing:
 * SLT_BOX_UNKNOWN and infinite bounds. */
SltStatus slt_estimate_boxes(const SltScene *s, const SltJob *j, uint64_t n, const double *lo, const double *hi,
                             BoxTake *take, void *user, SltStats *stats, SltError *err);

#endif
