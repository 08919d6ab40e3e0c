/* From noted choices to the chunks that run. */
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/prune.h"

/* Every chunk runs, and takes what the program says. */
static void fill_whole(const SltChunks *c, PruneSet *set) {
    for (uint32_t k = 0; k < c->nchunks; k++) set->chunks[k] = (int32_t)k;
    set->chunks[c->nchunks] = SLT_NO_CHUNK;
    for (uint32_t i = 0; i < c->nimports; i++) set->via[i] = c->import[i], set->from[i] = c->exported[c->import[i]];
}

bool prune_init(Pruner *p, const SltChunks *c) {
    *p = (Pruner){.c = c};
    p->choices = alloc_zero(2 * (size_t)c->nchoices + 1, sizeof *p->choices);
    p->live = alloc_zero((size_t)c->nops + 1 + c->nimports, sizeof *p->live);
    p->runs = alloc_zero((size_t)c->nchunks + 1, sizeof *p->runs);
    p->stamp = alloc_zero((size_t)c->nops + 1, sizeof *p->stamp);
    p->is = alloc_zero((size_t)c->nops + 1, sizeof *p->is);
    p->way = alloc_zero((size_t)c->nops + 1, sizeof *p->way);
    bool ok = p->choices && p->live && p->runs && p->stamp && p->is && p->way;
    for (uint32_t l = 0; l < PRUNE_LEVELS && ok; l++) {
        PruneSet *set = &p->set[l];
        set->chunks = alloc_zero((size_t)c->nchunks + 1, sizeof *set->chunks);
        set->settled = alloc_zero(2 * (size_t)c->nchoices + 1, sizeof *set->settled);
        set->from = alloc_zero((size_t)c->nimports + 1, sizeof *set->from);
        set->via = alloc_zero((size_t)c->nimports + 1, sizeof *set->via);
        set->pruned = (SltPruned){set->chunks, set->settled, set->from};
        ok = set->chunks && set->settled && set->from && set->via;
        if (ok) fill_whole(c, set);
    }
    if (!ok) prune_free(p);
    return ok;
}

void prune_free(Pruner *p) {
    for (uint32_t l = 0; l < PRUNE_LEVELS; l++) {
        PruneSet *set = &p->set[l];
        free(set->chunks), free(set->settled), free(set->from), free(set->via);
    }
    free(p->choices), free(p->live), free(p->runs), free(p->stamp), free(p->is), free(p->way);
    memset(p, 0, sizeof *p);
}

/* The boxes in which choice k / 2 is known to be operand k % 2: as in the parent, else where it may not be the other.
 */
static uint64_t settled_in(const Pruner *p, const PruneSet *parent, uint32_t k) {
    uint64_t here = (uint64_t)(int64_t)parent->settled[k], other = (uint64_t)(int64_t)parent->settled[k ^ 1];
    return here | (~other & ~p->choices[k ^ 1]);
}

static uint64_t walk_chunk(Pruner *p, const PruneSet *parent, uint32_t k) {
    const SltChunks *c = p->c;
    uint64_t *live = p->live, any = 0;
    for (uint32_t o = c->first_op[k + 1]; o-- > c->first_op[k];) {
        const SltChunkOp *op = &c->op[o];
        uint64_t m = live[o];
        if (op->settled < 0) {
            any |= m;
            live[op->arg[0]] |= m, live[op->arg[1]] |= m, live[op->arg[2]] |= m;
        } else {
            uint64_t is = settled_in(p, parent, (uint32_t)op->settled);
            live[op->arg[0]] |= m & is, live[op->arg[1]] |= m & ~is;
        }
    }
    return any;
}

void prune_walk(Pruner *p, const PruneSet *parent, uint32_t n) {
    const SltChunks *c = p->c;
    uint64_t *live = p->live, *imports = live + c->nops + 1, all = n < 64 ? ((uint64_t)1 << n) - 1 : UINT64_MAX;
    uint32_t count = 0, outside = c->first_import[c->nchunks];
    for (; parent->chunks[count] != SLT_NO_CHUNK; count++) {
        uint32_t k = (uint32_t)parent->chunks[count], op = c->first_op[k], import = c->first_import[k];
        memset(live + op, 0, (c->first_op[k + 1] - op) * sizeof *live);
        memset(imports + import, 0, (c->first_import[k + 1] - import) * sizeof *live);
    }
    for (uint32_t i = outside; i < c->nimports; i++) imports[i] = all, live[parent->via[i]] |= all;
    while (count--) {
        uint32_t k = (uint32_t)parent->chunks[count];
        live[c->nops] = 0;
        p->runs[k] = walk_chunk(p, parent, k) | live[c->nops];
        for (uint32_t i = c->first_import[k]; i < c->first_import[k + 1]; i++) live[parent->via[i]] |= imports[i];
    }
}

void prune_boxes(Pruner *p, Batch *b, const PruneSet *parent, uint32_t n) {
    assert(n <= SLT_CHOICE_BOXES);
    b->args.pruned = &parent->pruned, b->args.choices = p->choices;
    batch_call(b, SLT_K_PRUNE, n);
    b->args.pruned = NULL, b->args.choices = NULL;
    prune_walk(p, parent, n);
}

/* The operation whose value an exported one has in the box: settled choices passed, as far as what they are lies in
 * memory: the last operation that is reached from another chunk. */
static uint32_t source(Pruner *p, const PruneSet *parent, uint32_t op, uint32_t box) {
    const SltChunks *c = p->c;
    uint32_t n = 0, at = op;
    while (p->stamp[op] != p->picks) {
        p->way[n++] = op;
        for (at = op; at < c->nops && c->op[at].settled >= 0;) {
            const SltChunkOp *o = &c->op[at];
            at = o->arg[!(settled_in(p, parent, (uint32_t)o->settled) >> box & 1)];
        }
        if (at <= c->nops) break; /* it is of this chunk, or of none: `op` has its value */
        op = parent->via[at - c->nops - 1];
    }
    uint32_t is = p->stamp[op] == p->picks ? p->is[op] : op;
    for (uint32_t k = 0; k < n; k++) p->stamp[p->way[k]] = p->picks, p->is[p->way[k]] = is;
    return is;
}

static void pick_imports(Pruner *p, const PruneSet *parent, PruneSet *set, uint32_t from, uint32_t to, uint32_t box) {
    const SltChunks *c = p->c;
    for (uint32_t i = from; i < to; i++) {
        if (p->live[c->nops + 1 + i] >> box & 1) set->via[i] = source(p, parent, parent->via[i], box);
        set->from[i] = c->exported[set->via[i]];
    }
}

const PruneSet *prune_pick(Pruner *p, const PruneSet *parent, uint32_t box, uint32_t level) {
    const SltChunks *c = p->c;
    PruneSet *set = &p->set[level];
    assert(level > 0 && level < PRUNE_LEVELS && set != parent);
    if (!++p->picks) memset(p->stamp, 0, c->nops * sizeof *p->stamp), p->picks = 1;
    uint32_t n = 0;
    for (const int32_t *k = parent->chunks; *k != SLT_NO_CHUNK; k++) {
        if (!(p->runs[*k] >> box & 1)) continue;
        set->chunks[n++] = *k;
        for (uint32_t s = 2 * c->first_choice[*k]; s < 2 * c->first_choice[*k + 1]; s++)
            set->settled[s] = -(int32_t)(settled_in(p, parent, s) >> box & 1);
        pick_imports(p, parent, set, c->first_import[*k], c->first_import[*k + 1], box);
    }
    pick_imports(p, parent, set, c->first_import[c->nchunks], c->nimports, box);
    set->chunks[n] = SLT_NO_CHUNK;
    return set;
}
