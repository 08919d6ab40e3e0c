/* The boxes of a [Cull] loop's iterations by strips of the domain: which may touch a small rectangle, roughly but in no
 * time. The domain is cut into STRIPS columns and as many rows; for each a set of bits holds the boxes that begin there
 * or before, and another those that end there or behind. A rectangle is touched by what is in all four sets that its
 * sides name: the answer may hold boxes that end in the strip in which it begins. */
#ifndef SALTUS_SAMPLE_CULL_STRIPS_H
#define SALTUS_SAMPLE_CULL_STRIPS_H

#include "runtime/sample/cull_grid.h"

enum { CULL_STRIPS = 64, CULL_STRIPS_MOST = 4096 /* boxes: sets of more take longer to intersect than they save */ };

typedef struct CullStrips {
    uint32_t words;            /* of a set; 0: there are too many boxes, and nothing is known */
    double lo[2], by[2];       /* a strip is (x - lo) times by, rounded down */
    uint64_t *from[2], *to[2]; /* by axis, strip and word: boxes that begin no later, that end no earlier */
} CullStrips;
/* Of the boxes of g. False when memory runs out. */
bool cull_strips_make(CullStrips *s, const CullGrid *g);
void cull_strips_free(CullStrips *s);
/* The iterations whose boxes may touch [lo, hi], in order, into items, which has room for all; returns how many. All
 * that cull_grid_find finds are among them. */
int32_t cull_strips_find(const CullStrips *s, const double lo[2], const double hi[2], int32_t *items);

#endif
