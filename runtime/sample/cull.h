/* Lists of [Cull] iterations for a rectangle of the domain. The boxes are made once a call and shared, the lists are a
 * thread's own. */
#ifndef SALTUS_SAMPLE_CULL_H
#define SALTUS_SAMPLE_CULL_H

#include "runtime/sample/batch.h"

typedef struct CullBoxes {
    uint32_t n;
    double **box; /* by cull_id: [count][4] lo.x lo.y hi.x hi.y */
    const uint32_t *count;
} CullBoxes;
SltStatus cull_boxes(CullBoxes *c, const SltScene *s, SltError *err);
void cull_free(CullBoxes *c);
typedef struct CullLists {
    SltCullList *list; /* by cull_id */
    int32_t **items;
} CullLists;
bool cull_lists_init(CullLists *l, const CullBoxes *c);
void cull_lists_free(CullLists *l, const CullBoxes *c);
/* Lists for the rectangle [lo, hi]; `args.cull` of the batch points at them afterwards. */
void cull_select(const CullBoxes *c, CullLists *l, Batch *b, const double lo[3], const double hi[3]);

#endif
