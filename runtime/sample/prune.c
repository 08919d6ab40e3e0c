/* From noted choices to the chunks that run. */
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/prune.h"

bool prune_init(Pruner *p, const SltScene *s) {
    const SltChunks *c = s->chunks;
    *p = (Pruner){.c = c};
    p->choices = alloc_zero(2 * (size_t)c->nchoices + 1, sizeof *p->choices);
    p->live = alloc_zero((size_t)c->nops + 1, sizeof *p->live);
    p->runs = alloc_zero((size_t)c->nchunks + 1, sizeof *p->runs);
    bool ok = p->choices && p->live && p->runs;
    for (uint32_t l = 0; l < PRUNE_LEVELS && ok; l++) {
        PruneSet *set = &p->set[l];
        set->chunks = alloc_zero((size_t)c->nchunks + 1, sizeof *set->chunks);
        set->settled = alloc_zero(2 * (size_t)c->nchoices + 1, sizeof *set->settled);
        set->pruned = (SltPruned){set->chunks, set->settled};
        if (!(ok = set->chunks && set->settled)) break;
        for (uint32_t k = 0; k < c->nchunks; k++) set->chunks[k] = (int32_t)k;
        set->chunks[c->nchunks] = SLT_NO_CHUNK;
    }
    if (!ok) prune_free(p);
    return ok;
}

void prune_free(Pruner *p) {
    for (uint32_t l = 0; l < PRUNE_LEVELS; l++) free(p->set[l].chunks), free(p->set[l].settled);
    free(p->choices), free(p->live), free(p->runs);
    memset(p, 0, sizeof *p);
}

/* The boxes in which choice k / 2 is known to be operand k % 2: as in the parent, else where it may not be the other.
 */
static uint64_t settled_in(const Pruner *p, const PruneSet *parent, uint32_t k) {
    uint64_t here = (uint64_t)(int64_t)parent->settled[k], other = (uint64_t)(int64_t)parent->settled[k ^ 1];
    return here | (~other & ~p->choices[k ^ 1]);
}

void prune_walk(Pruner *p, const PruneSet *parent, uint32_t n) {
    const SltChunks *c = p->c;
    uint64_t *live = p->live, all = n < 64 ? ((uint64_t)1 << n) - 1 : UINT64_MAX;
    uint32_t count = 0;
    for (; parent->chunks[count] != SLT_NO_CHUNK; count++) {
        uint32_t k = (uint32_t)parent->chunks[count], first = c->first_op[k];
        memset(live + first, 0, (c->first_op[k + 1] - first) * sizeof *live);
    }
    for (uint32_t r = 0; r < c->nroots; r++) live[c->root[r]] = all;
    while (count--) {
        uint32_t k = (uint32_t)parent->chunks[count];
        uint64_t any = 0;
        for (uint32_t o = c->first_op[k + 1]; o-- > c->first_op[k];) {
            const SltChunkOp *op = &c->op[o];
            uint64_t m = live[o];
            any |= m;
            if (op->settled < 0) {
                live[op->arg[0]] |= m, live[op->arg[1]] |= m, live[op->arg[2]] |= m;
            } else {
                uint64_t is = settled_in(p, parent, (uint32_t)op->settled);
                live[op->arg[0]] |= m & is, live[op->arg[1]] |= m & ~is;
            }
        }
        p->runs[k] = any;
    }
}

void prune_boxes(Pruner *p, Batch *b, const PruneSet *parent, uint32_t n) {
    assert(n <= SLT_CHOICE_BOXES);
    b->args.pruned = &parent->pruned, b->args.choices = p->choices;
    batch_call(b, SLT_K_BOUNDS, n);
    b->args.pruned = NULL, b->args.choices = NULL;
    prune_walk(p, parent, n);
}

const PruneSet *prune_pick(Pruner *p, const PruneSet *parent, uint32_t box, uint32_t level) {
    const SltChunks *c = p->c;
    PruneSet *set = &p->set[level];
    assert(level > 0 && level < PRUNE_LEVELS && set != parent);
    uint32_t n = 0;
    for (const int32_t *k = parent->chunks; *k != SLT_NO_CHUNK; k++) {
        if (!(p->runs[*k] >> box & 1)) continue;
        set->chunks[n++] = *k;
        for (uint32_t s = 2 * c->first_choice[*k]; s < 2 * c->first_choice[*k + 1]; s++)
            set->settled[s] = -(int32_t)(settled_in(p, parent, s) >> box & 1);
    }
    set->chunks[n] = SLT_NO_CHUNK;
    return set;
}
