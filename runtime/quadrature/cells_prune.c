/* Straight-line programs: in a node of the tree only those chunks of operations run that matter there.
 *
 * `bounds` on the boxes of a node notes what each choice (min, max, select) may be. What is settled is left out in the
 * nodes made of them; what is open, and matters, is an edge like any other, along which f or a g jumps or bends: the
 * edge kernels know g of it, the difference of what it compares, and to give its decision is to call it settled. So a
 * formula of thousands of operations has in each cell the few curves that it has there, each smooth. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/quadrature/cells_inner.h"

bool cells_prune_init(Cells *c) {
    c->prunes = c->s->chunked && c->s->chunks;
    return !c->prunes || prune_init(&c->pruner, c->s->chunks);
}

void cells_prune_free(Cells *c) {
    for (uint32_t i = 0; i < SLT_CHOICE_BOXES; i++) free(c->runs[i]);
    for (uint32_t i = c->oldest; i < c->nstack; i++) free(c->stack[i].runs);
    prune_free(&c->pruner);
}

void cells_enter_chunks(Cells *c, Node *node) {
    if (!c->prunes) return;
    PruneLevel *l = &c->pruner.level[CELL_PRUNED];
    if (node && node->runs) {
        prune_enter(&c->pruner, CELL_PRUNED, node->runs);
        free(node->runs), node->runs = NULL;
    } else {
        const SltChunks *t = c->s->chunks;
        memcpy(l->chunks, c->b->all.chunks, (t->nchunks + 1) * sizeof *l->chunks);
        memset(l->settled, 0, 2 * (size_t)t->nchoices * sizeof *l->settled);
        for (uint32_t i = 0; i < t->nimports; i++) l->via[i] = t->import[i], l->from[i] = t->exported[t->import[i]];
    }
    batch_prune(c->b, &l->pruned, NULL);
}

void cells_call_bounds(Cells *c, uint32_t n) {
    if (!c->prunes) {
        cells_call(c, SLT_K_BOUNDS, n);
        return;
    }
    PruneLevel *l = &c->pruner.level[CELL_PRUNED];
    batch_prune(c->b, &l->pruned, l->choices);
    cells_call(c, SLT_K_BOUNDS, n);
    batch_prune(c->b, &l->pruned, NULL);
    if (n <= SLT_CHOICE_BOXES) prune_walk(&c->pruner, CELL_PRUNED, n < 64 ? ((uint64_t)1 << n) - 1 : UINT64_MAX);
}

void cells_add_choices(Cells *c, Cell *cell, uint32_t i) {
    if (!c->prunes || cell->nopen > CELL_EVENTS || !(cell->nopen || cell->state)) return;
    int32_t choice[CELL_EVENTS];
    uint32_t n = prune_open(&c->pruner, CELL_PRUNED, i, choice, CELL_EVENTS), kept = 0;
    if (n > CELL_EVENTS || n + cell->nedges > CELL_EVENTS) {
        cell->nopen = CELL_EVENTS + 1;
        return;
    }
    for (uint32_t k = 0; k < n; k++)
        if (c->s->chunks->below[choice[k]] >= 0) choice[kept++] = choice[k];
    memmove(&cell->edge[kept], &cell->edge[0], cell->nedges * sizeof *cell->edge);
    for (uint32_t k = 0; k < kept; k++) {
        memset(&cell->edge[k], 0, sizeof *cell->edge);
        cell->edge[k].event.site = (int32_t)c->s->nedges + choice[k];
    }
    cell->nedges += kept, cell->nopen += kept;
}

bool cells_keep_chunks(Cells *c, uint32_t n, uint64_t wanted) {
    for (uint32_t i = 0; i < SLT_CHOICE_BOXES && c->prunes; i++) free(c->runs[i]), c->runs[i] = NULL;
    for (uint32_t i = 0; i < n && c->prunes; i++) {
        if (!(wanted >> i & 1)) continue;
        prune_pick(&c->pruner, CELL_PRUNED, i);
        if (!(c->runs[i] = prune_keep(&c->pruner, CELL_PRUNED + 1))) return false;
    }
    return true;
}

bool cells_prune_root(Cells *c, Node *root) {
    if (!c->prunes) return true;
    Cell *cell = &c->cell[0];
    memset(cell, 0, sizeof *cell);
    cell->box = root->box;
    cells_enter_chunks(c, NULL);
    cells_bound_range(c, cell);
    if (!cells_keep_chunks(c, 1, 1)) return false;
    root->runs = cells_take_chunks(c, 0);
    return root->runs != NULL;
}

int32_t *cells_take_chunks(Cells *c, int box) {
    if (!c->prunes) return NULL;
    if (box < 0 || !c->runs[box]) return prune_keep(&c->pruner, CELL_PRUNED);
    int32_t *runs = c->runs[box];
    c->runs[box] = NULL;
    return runs;
}

/* The choice that a given event is; -1: it is none. */
static int32_t choice_of(const Cells *c, const Given *given, uint32_t j) {
    return j < given->n ? given->is[j].site - (int32_t)c->s->nedges : -1;
}

void cells_give_choices(Cells *c, const Given *given, bool on) {
    for (uint32_t j = 0; c->prunes && j < given->n; j++) {
        int32_t choice = choice_of(c, given, j);
        if (choice < 0) continue;
        uint32_t operand = (uint32_t)c->s->chunks->below[choice] ^ !given->is[j].below;
        c->pruner.level[CELL_PRUNED].settled[2 * choice + (int32_t)operand] = -on;
    }
}

bool cells_same_choices(const Cells *c, const Given *p, const Given *q) {
    for (uint32_t j = 0; c->prunes && j < CELL_GIVEN; j++) {
        int32_t a = choice_of(c, p, j), b = choice_of(c, q, j);
        if ((a < 0) != (b < 0)) return false;
        if (a >= 0 && (a != b || p->is[j].below != q->is[j].below)) return false;
    }
    return true;
}
