/* Which iterations of [Cull] loops may do something in a rectangle of the domain. The boxes of all iterations are made
 * once a call and shared; the lists for a rectangle are a thread's own. */
#ifndef SALTUS_SAMPLE_CULL_H
#define SALTUS_SAMPLE_CULL_H

#include "runtime/sample/cull_strips.h"

typedef struct CullBoxes {
    uint32_t n;            /* [Cull] loops */
    uint32_t nlists;       /* of the program, theirs first */
    CullGrid *grid;        /* by loop */
    CullStrips *strips;    /* by loop; NULL: not made, nobody asks about a few samples */
    const uint32_t *count; /* by loop: iterations */
} CullBoxes;
SltStatus cull_boxes(CullBoxes *c, const SltScene *s, SltError *err);
/* From now on, for lists and rectangles to come, calls of kernels that search lines run few samples at a time, each
 * with the iterations that may reach them alone. False when memory runs out. */
bool cull_by_parts(CullBoxes *c);
void cull_free(CullBoxes *c);
typedef struct CullLists {
    SltCullList *list; /* by number of the list; those of no [Cull] loop stay without */
    int32_t **items;   /* by [Cull] loop: room for all iterations */
    uint64_t *found;   /* bits by iteration; 0 between calls */
    uint64_t *some;    /* bits by word of `found`: it is not 0; likewise */
    const CullBoxes *of;
    SltCullList *part;   /* as `list`, of a few samples; NULL: there are none such */
    int32_t **part_item; /* as `items` */
} CullLists;
bool cull_lists_init(CullLists *l, const CullBoxes *c);
void cull_lists_free(CullLists *l, const CullBoxes *c);
/* Lists for the rectangle [lo, hi]; args.cull of the batch points at these lists afterwards. */
void cull_select(const CullBoxes *c, CullLists *l, Batch *b, const double lo[3], const double hi[3]);
/* May the lists of args.cull, which are those of cull_select, be much shorter for a few samples? */
bool cull_may_part(const Batch *b);
/* Sets args.cull to lists for the first n samples of the call that is about to be; boxes: of `bounds`. */
void cull_part(Batch *b, uint32_t n, bool boxes);

#endif
