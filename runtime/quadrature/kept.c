/* Points of a tile that are kept. */
#include <stdlib.h>
#include <string.h>

#include "runtime/quadrature/kept.h"
#include "runtime/sample/alloc.h"

bool kept_init(Kept *k, const SltScene *s) {
    memset(k, 0, sizeof *k);
    k->nlists = s->nlists > s->ncull ? s->nlists : s->ncull;
    return (k->lent = alloc_zero(k->nlists, sizeof *k->lent)) != NULL;
}

void kept_free(Kept *k) {
    free(k->group), free(k->point), free(k->crossing), free(k->list), free(k->item), free(k->lent);
    memset(k, 0, sizeof *k);
}

void kept_clear(Kept *k) { k->ngroup = k->npoint = k->ncrossing = k->nlist = k->nitem = 0; }

static bool room(void *array, uint64_t need, uint64_t *cap, size_t size) {
    if (need <= *cap) return true;
    void **v = array, *p = realloc(*v, 2 * need * size);
    if (!p) return false;
    *v = p, *cap = 2 * need;
    return true;
}

static bool keep_group(Kept *k, const SltKernelArgs *args, bool curve, uint64_t first, uint32_t n) {
    if (!room(&k->group, k->ngroup + 1, &k->group_cap, sizeof *k->group)) return false;
    KeptGroup *g = &k->group[k->ngroup++];
    *g = (KeptGroup){.curve = curve, .first = (uint32_t)first, .n = n};
    if (!args->cull || !k->nlists) return true;
    if (!room(&k->list, k->nlist + k->nlists, &k->list_cap, sizeof *k->list)) return false;
    g->lists = 1 + (uint32_t)k->nlist;
    for (uint32_t l = 0; l < k->nlists; l++) {
        int32_t count = args->cull[l].count;
        uint64_t items = count > 0 ? (uint64_t)count : 0;
        if (!room(&k->item, k->nitem + items, &k->item_cap, sizeof *k->item)) return false;
        if (items) memcpy(k->item + k->nitem, args->cull[l].items, items * sizeof *k->item);
        k->list[k->nlist].first = (uint32_t)k->nitem, k->list[k->nlist].count = count;
        k->nlist++, k->nitem += items;
    }
    return true;
}

bool kept_points(Kept *k, const SltKernelArgs *args, const CellPoint *p, uint32_t n) {
    if (!room(&k->point, k->npoint + n, &k->point_cap, sizeof *k->point)) return false;
    memcpy(k->point + k->npoint, p, n * sizeof *p);
    k->npoint += n;
    return keep_group(k, args, false, k->npoint - n, n);
}

bool kept_crossings(Kept *k, const SltKernelArgs *args, const Crossing *c, uint32_t n) {
    if (!room(&k->crossing, k->ncrossing + n, &k->crossing_cap, sizeof *k->crossing)) return false;
    memcpy(k->crossing + k->ncrossing, c, n * sizeof *c);
    k->ncrossing += n;
    return keep_group(k, args, true, k->ncrossing - n, n);
}

const SltCullList *kept_lists(Kept *k, const KeptGroup *g) {
    if (!g->lists) return NULL;
    for (uint32_t l = 0; l < k->nlists; l++) {
        const struct KeptList *from = &k->list[g->lists - 1 + l];
        k->lent[l] = (SltCullList){k->item + from->first, from->count};
    }
    return k->lent;
}
