/* From noted choices to the chunks that run. */
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/prune.h"

/* In the place of an operation: the value lies in no memory that other chunks see. */
#define NOWHERE UINT32_MAX

static bool level_init(PruneLevel *l, const SltChunks *c) {
    l->chunks = alloc_zero((size_t)c->nchunks + 1, sizeof *l->chunks);
    l->settled = alloc_zero(2 * (size_t)c->nchoices + 1, sizeof *l->settled);
    l->from = alloc_zero((size_t)c->nimports + 1, sizeof *l->from); /* and the difference of a choice */
    l->via = alloc_zero((size_t)c->nimports + 1, sizeof *l->via);
    l->choices = alloc_zero(2 * (size_t)c->nchoices + 1, sizeof *l->choices);
    l->live = alloc_zero((size_t)c->nops + 1 + c->nimports, sizeof *l->live);
    l->runs = alloc_zero((size_t)c->nchunks + 1, sizeof *l->runs);
    l->is = alloc_zero((size_t)c->nchoices * SLT_CHOICE_BOXES + 1, sizeof *l->is);
    l->passed = alloc_zero((size_t)c->nchoices + 1, sizeof *l->passed);
    if (!l->chunks || !l->settled || !l->from || !l->via || !l->choices || !l->live || !l->runs || !l->is || !l->passed)
        return false;
    l->pruned = (SltPruned){l->chunks, l->settled, l->from};
    /* Every chunk runs, and takes what the program says. */
    for (uint32_t k = 0; k < c->nchunks; k++) l->chunks[k] = (int32_t)k;
    l->chunks[c->nchunks] = SLT_NO_CHUNK;
    for (uint32_t i = 0; i < c->nimports; i++) l->via[i] = c->import[i], l->from[i] = c->exported[c->import[i]];
    l->from[c->nimports] = (int32_t)c->nexports;
    return true;
}

bool prune_init(Pruner *p, const SltChunks *c) {
    *p = (Pruner){.c = c};
    bool ok = true;
    for (uint32_t l = 0; l < PRUNE_LEVELS && ok; l++) ok = level_init(&p->level[l], c);
    if (!ok) prune_free(p);
    return ok;
}

void prune_free(Pruner *p) {
    for (uint32_t k = 0; k < PRUNE_LEVELS; k++) {
        PruneLevel *l = &p->level[k];
        free(l->chunks), free(l->settled), free(l->from), free(l->via), free(l->choices), free(l->live), free(l->runs);
        free(l->is), free(l->passed);
    }
    memset(p, 0, sizeof *p);
}

/* In which boxes a choice is known to be its first operand, its second: as around them, else where it may not be the
 * other. Takes the place of what it may be. */
static const uint64_t *settle(PruneLevel *l, uint32_t choice) {
    uint64_t *is = l->choices + 2 * (size_t)choice, may[2] = {is[0], is[1]};
    const int32_t *around = l->settled + 2 * (size_t)choice;
    uint64_t first = (uint64_t)(int64_t)around[0], second = (uint64_t)(int64_t)around[1];
    is[0] = first | (~second & ~may[1]), is[1] = second | (~first & ~may[0]);
    return is;
}

/* Settled choices do not make a chunk run: unless they are a number of no chunk, which then lies nowhere but there. */
static uint64_t walk_chunk(const SltChunks *c, PruneLevel *l, uint32_t k) {
    uint64_t *live = l->live, any = 0;
    live[c->nops] = 0;
    for (uint32_t o = c->first_op[k + 1]; o-- > c->first_op[k];) {
        const SltChunkOp *op = &c->op[o];
        uint64_t m = live[o];
        if (!m) continue; /* most of a chunk that runs */
        if (op->choice < 0) {
            any |= m;
            live[op->arg[0]] |= m, live[op->arg[1]] |= m, live[op->arg[2]] |= m;
        } else {
            l->passed[l->npassed++] = o;
            const uint64_t *is = settle(l, (uint32_t)op->choice);
            uint64_t open = m & ~(is[0] | is[1]);
            any |= open;
            live[op->arg[0]] |= m & ~is[1], live[op->arg[1]] |= m & ~is[0], live[op->arg[2]] |= open;
        }
    }
    return any | live[c->nops];
}

void prune_boxes(Pruner *p, Batch *b, uint32_t level, uint32_t n) {
    PruneLevel *l = &p->level[level];
    assert(n <= SLT_CHOICE_BOXES);
    batch_prune(b, &l->pruned, l->choices);
    batch_call(b, SLT_K_PRUNE, n);
    batch_prune(b, NULL, NULL);
}

/* Boxes of which rows are worked on at once: short loops of a known length, which become vectors. */
enum { GROUP = 16 };

/* By box, what a choice is. Rows are as short as the boxes allow: fewer lines of cache. */
static uint32_t *row_of(const PruneLevel *l, int32_t choice) { return l->is + (size_t)choice * l->stride; }

static void fill(uint32_t *row, uint32_t stride, uint32_t value) {
    for (uint32_t g = 0; g < stride; g += GROUP)
        for (uint32_t k = 0; k < GROUP; k++) row[g + k] = value;
}

/* All ones in the lanes of those boxes of a group that are in the set. */
static void spread(uint64_t set, uint32_t group, uint32_t lane[GROUP]) {
    uint32_t bits = (uint32_t)(set >> group) & 0xffffu;
    for (uint32_t k = 0; k < GROUP; k++) lane[k] = bits & 1u << k ? UINT32_MAX : 0;
}

/* Where the value of an operand of a choice lies in memory, in each box: the operation that exports it. A value that
 * only its own chunk has lies nowhere. */
static const uint32_t *operand(const SltChunks *c, const PruneLevel *l, uint32_t arg, uint32_t *own) {
    if (arg > c->nops) arg = l->via[arg - c->nops - 1];
    if (arg < c->nops && c->op[arg].choice >= 0) return row_of(l, c->op[arg].choice);
    uint32_t is = arg < c->nops && c->exported[arg] >= 0 ? arg : NOWHERE;
    fill(own, l->stride, is);
    return own;
}

/* What a choice is in each box: an operand that is settled, as far as that lies in memory, else itself. */
static void pass_choice(const SltChunks *c, PruneLevel *l, uint32_t o) {
    const SltChunkOp *op = &c->op[o];
    const uint64_t *settled = l->choices + 2 * (size_t)op->choice;
    uint32_t *is = row_of(l, op->choice), here = c->exported[o] >= 0 ? o : NOWHERE, own[2][SLT_CHOICE_BOXES];
    if (!((settled[0] | settled[1]) & l->live[o])) { /* the same in all boxes, mostly */
        fill(is, l->stride, here);
        return;
    }
    if (!(l->live[o] & ~settled[0]) || !(l->live[o] & ~settled[1])) {
        const uint32_t *of = operand(c, l, op->arg[(l->live[o] & ~settled[0]) != 0], own[0]);
        for (uint32_t g = 0; g < l->stride; g += GROUP)
            for (uint32_t k = g; k < g + GROUP; k++) is[k] = of[k] == NOWHERE ? here : of[k];
        return;
    }
    const uint32_t *first = operand(c, l, op->arg[0], own[0]), *second = operand(c, l, op->arg[1], own[1]);
    for (uint32_t g = 0; g < l->stride; g += GROUP) {
        uint32_t to_first[GROUP], to_second[GROUP];
        spread(settled[0], g, to_first), spread(settled[1], g, to_second);
        for (uint32_t k = 0; k < GROUP; k++) {
            uint32_t other = (second[g + k] & to_second[k]) | (NOWHERE & ~to_second[k]);
            uint32_t which = (first[g + k] & to_first[k]) | (other & ~to_first[k]);
            is[g + k] = which == NOWHERE ? here : which;
        }
    }
}

void prune_walk(Pruner *p, uint32_t level, uint64_t boxes) {
    const SltChunks *c = p->c;
    PruneLevel *l = &p->level[level];
    uint64_t *live = l->live, *imports = live + c->nops + 1;
    uint32_t n = boxes ? 64 - (uint32_t)__builtin_clzll(boxes) : 0;
    l->stride = n <= GROUP ? GROUP : SLT_CHOICE_BOXES;
    uint32_t count = 0, outside = c->first_import[c->nchunks];
    for (; l->chunks[count] != SLT_NO_CHUNK; count++) {
        uint32_t k = (uint32_t)l->chunks[count], op = c->first_op[k], import = c->first_import[k];
        memset(live + op, 0, (c->first_op[k + 1] - op) * sizeof *live);
        memset(imports + import, 0, (c->first_import[k + 1] - import) * sizeof *live);
    }
    for (uint32_t i = outside; i < c->nimports; i++) imports[i] = boxes, live[l->via[i]] |= boxes;
    while (count--) {
        uint32_t k = (uint32_t)l->chunks[count];
        l->runs[k] = walk_chunk(c, l, k);
        for (uint32_t i = c->first_import[k]; i < c->first_import[k + 1]; i++) live[l->via[i]] |= imports[i];
    }
    while (l->npassed) pass_choice(c, l, l->passed[--l->npassed]); /* operands first */
}

/* What does not matter in the box stays as it is. No branch depends on it: it would be guessed wrongly half the time.
 */
static void pick_imports(const SltChunks *c, const PruneLevel *l, PruneLevel *to, uint32_t first, uint32_t end,
                         uint32_t box) {
    const SltChunkOp *const ops = c->op;
    const uint64_t *const live = l->live + c->nops + 1;
    const uint32_t *const from = l->via, *const is = l->is + box, stride = l->stride;
    uint32_t *const via = to->via;
    int32_t *const place = to->from;
    for (uint32_t i = first; i < end; i++) {
        uint32_t op = from[i];
        int32_t choice = ops[op].choice;
        uint32_t passed = -(uint32_t)(live[i] >> box & 1) & ~(uint32_t)(choice >> 31); /* all ones: it is another */
        op = (is[(size_t)((uint32_t)choice & passed) * stride] & passed) | (op & ~passed);
        via[i] = op, place[i] = c->exported[op];
    }
}

static void pick_choices(const uint64_t *restrict settled, int32_t *restrict to, uint32_t n, uint32_t box) {
    for (uint32_t h = 0; h < n; h++) to[h] = -(int32_t)(settled[h] >> box & 1);
}

void prune_pick(Pruner *p, uint32_t level, uint32_t box) {
    const SltChunks *c = p->c;
    assert(level + 1 < PRUNE_LEVELS);
    const PruneLevel *l = &p->level[level];
    PruneLevel *to = &p->level[level + 1];
    uint32_t n = 0;
    for (const int32_t *k = l->chunks; *k != SLT_NO_CHUNK; k++) to->chunks[n] = *k, n += l->runs[*k] >> box & 1;
    to->chunks[n] = SLT_NO_CHUNK;
    for (uint32_t i = 0; i < n; i++) {
        uint32_t k = (uint32_t)to->chunks[i], h = 2 * c->first_choice[k];
        pick_choices(l->choices + h, to->settled + h, 2 * c->first_choice[k + 1] - h, box);
        pick_imports(c, l, to, c->first_import[k], c->first_import[k + 1], box);
    }
    pick_imports(c, l, to, c->first_import[c->nchunks], c->nimports, box);
}

uint32_t prune_open(const Pruner *p, uint32_t level, uint32_t box, int32_t *choice, uint32_t most) {
    const SltChunks *c = p->c;
    const PruneLevel *l = &p->level[level];
    uint32_t n = 0;
    for (const int32_t *k = l->chunks; *k != SLT_NO_CHUNK; k++) {
        if (!(l->runs[*k] >> box & 1)) continue;
        for (uint32_t o = c->first_op[*k]; o < c->first_op[*k + 1]; o++) {
            int32_t is = c->op[o].choice;
            if (is < 0 || !(l->live[o] >> box & 1)) continue;
            const uint64_t *settled = l->choices + 2 * (size_t)is;
            if ((settled[0] | settled[1]) >> box & 1) continue;
            if (n == most) return most + 1;
            choice[n++] = is;
        }
    }
    return n;
}

/* Of each chunk what of its choices is settled, and whence its imports come; then those used outside. */
static uint32_t kept_size(const SltChunks *c, const int32_t *chunks) {
    uint32_t n = 2 + c->nimports - c->first_import[c->nchunks];
    for (const int32_t *k = chunks; *k != SLT_NO_CHUNK; k++)
        n += 1 + 2 * (c->first_choice[*k + 1] - c->first_choice[*k]) + c->first_import[*k + 1] - c->first_import[*k];
    return n;
}

int32_t *prune_keep(const Pruner *p, uint32_t level) {
    const SltChunks *c = p->c;
    const PruneLevel *l = &p->level[level];
    int32_t *kept = malloc(kept_size(c, l->chunks) * sizeof *kept), *to = kept;
    if (!kept) return NULL;
    for (const int32_t *k = l->chunks; *k != SLT_NO_CHUNK; k++) {
        *to++ = *k;
        for (uint32_t h = 2 * c->first_choice[*k]; h < 2 * c->first_choice[*k + 1]; h++) *to++ = l->settled[h];
        for (uint32_t i = c->first_import[*k]; i < c->first_import[*k + 1]; i++) *to++ = (int32_t)l->via[i];
    }
    *to++ = SLT_NO_CHUNK;
    for (uint32_t i = c->first_import[c->nchunks]; i < c->nimports; i++) *to++ = (int32_t)l->via[i];
    return kept;
}

static const int32_t *enter_imports(const SltChunks *c, PruneLevel *l, const int32_t *kept, uint32_t first,
                                    uint32_t end) {
    for (uint32_t i = first; i < end; i++) l->via[i] = (uint32_t)*kept++, l->from[i] = c->exported[l->via[i]];
    return kept;
}

void prune_enter(Pruner *p, uint32_t level, const int32_t *kept) {
    const SltChunks *c = p->c;
    PruneLevel *l = &p->level[level];
    uint32_t n = 0;
    for (int32_t k; (k = *kept++) != SLT_NO_CHUNK;) {
        l->chunks[n++] = k;
        for (uint32_t h = 2 * c->first_choice[k]; h < 2 * c->first_choice[k + 1]; h++) l->settled[h] = *kept++;
        kept = enter_imports(c, l, kept, c->first_import[k], c->first_import[k + 1]);
    }
    l->chunks[n] = SLT_NO_CHUNK;
    enter_imports(c, l, kept, c->first_import[c->nchunks], c->nimports);
}
