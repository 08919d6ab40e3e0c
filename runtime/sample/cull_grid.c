/* Boxes of [Cull] iterations by cells: cull_grid.h. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/cull_grid.h"

/* The first cell of a level; all before it have (4^l - 1) / 3. */
static uint32_t first_cell(uint32_t level) { return ((1u << 2 * level) - 1) / 3; }

/* Levels until there are about as many cells as boxes. */
static uint32_t levels_for(uint32_t n) {
    uint32_t l = 1;
    while (l < CULL_LEVELS && 1u << 2 * l <= n) l++;
    return l;
}

/* The column or row of x at a level; outside of the domain that of the border. */
static uint32_t place(const CullGrid *g, uint32_t level, int d, double x) {
    double cells = (double)(1u << level), at = floor((x - g->lo[d]) / g->side[d] * cells);
    return at >= cells ? (1u << level) - 1 : at > 0 ? (uint32_t)at : 0; /* NaN: 0 */
}

static uint32_t level_of(const CullGrid *g, const CullBox *b) {
    uint32_t l = 0;
    double part = fmax((b->hi[0] - b->lo[0]) / g->side[0], (b->hi[1] - b->lo[1]) / g->side[1]);
    for (int d = 0; d < 2; d++) /* those of NaN or without an end are asked for all */
        if (!(b->lo[d] - b->lo[d] == 0) || !(b->hi[d] - b->hi[d] == 0)) return 0;
    while (l + 1 < g->levels && part * (double)(2u << l) <= 1) l++;
    return l;
}

static uint32_t cell_of(const CullGrid *g, const CullBox *b) {
    uint32_t l = level_of(g, b);
    return first_cell(l) + (place(g, l, 1, b->lo[1]) << l) + place(g, l, 0, b->lo[0]);
}

bool cull_grid_make(CullGrid *g, const SltScene *s, const CullBox *box, uint32_t n) {
    *g = (CullGrid){.levels = levels_for(n), .n = n};
    for (int d = 0; d < 2; d++) {
        g->lo[d] = s->lo[d], g->side[d] = s->hi[d] - s->lo[d];
        if (!(g->side[d] > 0) || isinf(g->side[d])) g->levels = 1, g->side[d] = 1;
    }
    uint32_t cells = first_cell(g->levels), *cell = malloc(((size_t)n + 1) * sizeof *cell);
    g->start = alloc_zero(cells + 2, sizeof *g->start);
    g->box = malloc(((size_t)n + 1) * sizeof *g->box), g->number = malloc(((size_t)n + 1) * sizeof *g->number);
    bool memory = cell && g->start && g->box && g->number;
    if (memory) { /* sorted by counting: start[c + 1] runs from the first box of c to the first behind it */
        for (uint32_t i = 0; i < n; i++) g->start[(cell[i] = cell_of(g, &box[i])) + 2]++;
        for (uint32_t c = 0; c < cells; c++) g->start[c + 2] += g->start[c + 1];
        for (uint32_t i = 0; i < n; i++) {
            uint32_t at = g->start[cell[i] + 1]++;
            g->box[at] = box[i], g->number[at] = (int32_t)i;
        }
    }
    free(cell);
    return memory;
}

void cull_grid_free(CullGrid *g) {
    free(g->start), free(g->box), free(g->number);
    memset(g, 0, sizeof *g);
}

void cull_grid_find(const CullGrid *g, const double lo[2], const double hi[2], uint64_t *found, uint64_t *some) {
    for (uint32_t l = 0; l < g->levels; l++) {
        uint32_t from[2], to[2];
        for (int d = 0; d < 2; d++) {
            double cell = g->side[d] / (double)(1u << l); /* and a little, for what rounding has moved */
            from[d] = place(g, l, d, lo[d] - 1.0001 * cell), to[d] = place(g, l, d, hi[d] + 0.0001 * cell);
        }
        for (uint32_t row = from[1]; row <= to[1]; row++) {
            const uint32_t *start = g->start + first_cell(l) + (row << l);
            for (uint32_t k = start[from[0]], end = start[to[0] + 1]; k < end; k++) {
                const CullBox *b = &g->box[k];
                if (b->lo[0] > hi[0] || b->hi[0] < lo[0] || b->lo[1] > hi[1] || b->hi[1] < lo[1]) continue;
                uint32_t i = (uint32_t)g->number[k];
                found[i / 64] |= (uint64_t)1 << i % 64;
                some[i / 4096] |= (uint64_t)1 << i / 64 % 64;
            }
        }
    }
}
