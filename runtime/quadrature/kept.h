/* Points of a tile that are kept to be evaluated again, each group with the lists of iterations that were good for it.
 * A worker owns its Kept, and lends out what is in it until it is emptied. */
#ifndef SALTUS_QUADRATURE_KEPT_H
#define SALTUS_QUADRATURE_KEPT_H

#include "runtime/quadrature/cells.h"

typedef struct KeptGroup {
    bool curve;        /* crossings, else points of the volume */
    uint32_t first, n; /* of crossing[] or point[] */
    uint32_t lists;    /* 1 + first of list[]; 0: no lists */
} KeptGroup;

typedef struct Kept {
    uint32_t nlists; /* lists of a group: those of the scene */
    KeptGroup *group;
    CellPoint *point;
    Crossing *crossing;
    struct KeptList {
        uint32_t first; /* of item[] */
        int32_t count;
    } *list;
    int32_t *item;
    uint64_t ngroup, npoint, ncrossing, nlist, nitem; /* and what there is room for: */
    uint64_t group_cap, point_cap, crossing_cap, list_cap, item_cap;
    SltCullList *lent; /* [nlists]: those of the group in hand */
} Kept;
bool kept_init(Kept *k, const SltScene *s);
void kept_free(Kept *k);
void kept_clear(Kept *k);
/* False when memory runs out. */
bool kept_points(Kept *k, const SltKernelArgs *args, const CellPoint *p, uint32_t n);
bool kept_crossings(Kept *k, const SltKernelArgs *args, const Crossing *c, uint32_t n);
/* The lists of a group, for args.cull; NULL: none. Good until the next call. */
const SltCullList *kept_lists(Kept *k, const KeptGroup *g);

#endif
