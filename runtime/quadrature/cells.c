/* The tree of cells: a node's sub-boxes go through one call of `bounds`; each is settled, curved, a node again, or left
 * over. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/quadrature/cells_inner.h"

/* ---- memory */
bool cells_grow(Cells *c, void *array, uint32_t *cap, uint32_t need, size_t size) {
    if (need <= *cap) return true;
    uint32_t room = need + need / 2 + 64;
    void *old, *p;
    memcpy(&old, array, sizeof old);
    p = realloc(old, room * size);
    if (!p) {
        c->failed = true;
        return false;
    }
    memcpy(array, &p, sizeof p);
    *cap = room;
    return true;
}

Cells *cells_new(Batch *b, const double lo[3], const double hi[3]) {
    Cells *c = calloc(1, sizeof *c);
    if (!c) return NULL;
    c->b = b, c->s = b->s, c->dim = b->s->dim, c->volume = 1;
    uint32_t named = scene_outputs(c->s, SLT_K_BOUNDS, SLT_OUT_OPEN_EDGE);
    c->depth = named ? scene_outputs(c->s, SLT_K_BOUNDS, SLT_OUT_OPEN_K) / named : 0;
    for (uint32_t d = 0; d < c->dim; d++) c->lo[d] = lo[d], c->hi[d] = hi[d], c->volume *= hi[d] - lo[d];
    bool made = cells_grow(c, &c->cell, &c->cell_cap, CELL_BOXES, sizeof *c->cell);
    made &= (c->crossing = malloc(BATCH * sizeof *c->crossing)) != NULL;
    for (int r = 0; r < CELL_RULES; r++) made &= (c->point[r] = malloc(BATCH * sizeof *c->point[r])) != NULL;
    if (made) return c;
    cells_free(c);
    return NULL;
}

void cells_free(Cells *c) {
    if (!c) return;
    free(c->stack), free(c->cell), free(c->piece), free(c->column), free(c->root), free(c->probe), free(c->ask);
    free(c->active), free(c->order), free(c->crossing);
    for (int r = 0; r < CELL_RULES; r++) free(c->point[r]);
    free(c);
}

/* ---- numbers of the program's precision */
double cells_next(const Cells *c, double v, double towards) {
    return c->b->f64 ? nextafter(v, towards) : (double)nextafterf((float)v, (float)towards);
}

double cells_move(const Cells *c, double v, double n, double scale) {
    double unit = (c->b->f64 ? 0x1p-52 : 0x1p-23) * fmax(fabs(v), scale), moved = cells_round(c, v + n * unit);
    return moved != v ? moved : cells_next(c, v, n > 0 ? HUGE_VAL : -HUGE_VAL);
}

/* ---- boxes */
static double measure(const Cells *c, const Box *x) {
    double m = 1;
    for (uint32_t d = 0; d < c->dim; d++) m *= x->end[d] - x->lo[d];
    return m;
}

/* Its longest side, in parts of the domain. */
static double side(const Cells *c, const Box *x) {
    double longest = 0;
    for (uint32_t d = 0; d < c->dim; d++) longest = fmax(longest, (x->end[d] - x->lo[d]) / (c->hi[d] - c->lo[d]));
    return longest;
}

/* A line of the image's grid that lies inside (lo, hi), the nearest to x; false: there is none. */
static bool grid_line(const Cells *c, uint32_t d, double lo, double hi, double x, double *line) {
    double step = c->o->grid[d], from = c->o->grid_lo[d];
    if (!(step > 0)) return false;
    double k = nearbyint((x - from) / step), at[3] = {k, k - 1, k + 1};
    for (int i = 0; i < 3; i++) {
        *line = cells_round(c, from + at[i] * step);
        if (*line > lo && *line < hi) return true;
    }
    return false;
}

/* Places that cut the axis into at most n parts, off the dyadic ones, where shapes like to end; on the lines of an
 * image's grid while there are any inside. at[0] and at[returned] are the ends. */
static uint32_t cuts(const Cells *c, const Box *x, uint32_t d, uint32_t n, double *at) {
    double lo = x->lo[d], end = x->end[d];
    uint32_t made = 0;
    at[made] = lo;
    for (uint32_t i = 1; i < n; i++) {
        /* Bends the even division by up to a sixteenth of a part: no two levels cut alike. */
        double t = (double)i / n, p = cells_round(c, lo + (t + 0.2357 * t * (1 - t) / n) * (end - lo)), line;
        if (grid_line(c, d, lo, end, p, &line)) p = line;
        if (p > at[made] && p < end && p < x->hi[d]) at[++made] = p;
    }
    at[++made] = end;
    return made;
}

/* Appends the parts of a box to c->cell: in halves along every axis, in quarters in 1D. */
static void split(Cells *c, const Box *box, uint32_t level, uint32_t bends) {
    enum { MOST = 4 };
    uint32_t parts = c->dim == 1 ? 4 : 2;
    double at[3][MOST + 1] = {{0}}, longest = side(c, box);
    uint32_t n[3] = {1, 1, 1};
    for (uint32_t d = 0; d < c->dim; d++) {
        /* A side that is already far shorter than the others is left as it is. */
        bool thin = (box->end[d] - box->lo[d]) / (c->hi[d] - c->lo[d]) < 0.6 * longest;
        n[d] = cuts(c, box, d, thin ? 1 : parts, at[d]);
    }
    for (uint32_t z = 0; z < n[2]; z++)
        for (uint32_t y = 0; y < n[1]; y++)
            for (uint32_t x = 0; x < n[0]; x++) {
                Cell *cell = &c->cell[c->ncell++];
                const uint32_t i[3] = {x, y, z};
                cell->box = *box;
                for (uint32_t d = 0; d < c->dim; d++) {
                    cell->box.lo[d] = at[d][i[d]];
                    cell->box.end[d] = at[d][i[d] + 1];
                    if (i[d] + 1 < n[d]) cell->box.hi[d] = at[d][i[d] + 1];
                }
                cell->level = level + 1, cell->bends = bends, cell->done = false, cell->axes = 0;
            }
}

/* ---- what becomes of a cell */
static void count_cell(Cells *c, const Cell *cell, CellState state) {
    double part = measure(c, &cell->box) / c->volume;
    *(state == CELL_SETTLED  ? &c->counts->settled
      : state == CELL_CURVED ? &c->counts->curved
                             : &c->counts->left) += part;
    c->counts->cells++;
    if (c->sink->cell) c->sink->cell(c->sink->user, &cell->box, state);
}

static bool is_constant(const Cells *c, const Cell *cell) {
    for (uint32_t ch = 0; ch < c->s->channels; ch++)
        if (!(cell->f[2 * ch] == cell->f[2 * ch + 1])) return false;
    return true;
}

/* Points of the tensor rule in a box. */
static void fill_box(Cells *c, const double lo[3], const double end[3], CellRule rule, const GaussRule *r) {
    uint32_t n[3] = {1, 1, 1};
    for (uint32_t d = 0; d < c->dim; d++) n[d] = r->n;
    for (uint32_t z = 0; z < n[2]; z++)
        for (uint32_t y = 0; y < n[1]; y++)
            for (uint32_t i = 0; i < n[0]; i++) {
                const uint32_t at[3] = {i, y, z};
                double x[3] = {0}, weight = 1;
                for (uint32_t d = 0; d < c->dim; d++) {
                    x[d] = lo[d] + r->x[at[d]] * (end[d] - lo[d]);
                    weight *= r->w[at[d]] * (end[d] - lo[d]);
                }
                cells_emit_point(c, x, weight, rule);
            }
}

/* Where the box is cut by lines of the grid: the next after `from`, or its end. */
static double next_line(const Cells *c, const Box *x, uint32_t d, double from) {
    double step = c->o->grid[d], line = x->end[d];
    if (!(step > 0)) return line;
    double k = floor((from - c->o->grid_lo[d]) / step) + 1, at = c->o->grid_lo[d] + k * step;
    if (at <= from + 1e-9 * step) at += step;
    return at < line - 1e-9 * step ? at : line;
}

static void settle(Cells *c, const Cell *cell) {
    count_cell(c, cell, CELL_SETTLED);
    if (!c->o->volume) return;
    bool constant = is_constant(c, cell);
    if (constant && c->sink->constant) {
        double f[SLT_MAX_CHANNELS];
        for (uint32_t ch = 0; ch < c->s->channels; ch++) f[ch] = cell->f[2 * ch];
        c->sink->constant(c->sink->user, &cell->box, f);
        return;
    }
    const Box *x = &cell->box;
    double lo[3] = {0}, end[3] = {1, 1, 1};
    uint32_t last = c->dim - 1;
    for (uint32_t d = 0; d < c->dim; d++) lo[d] = x->lo[d], end[d] = next_line(c, x, d, x->lo[d]);
    for (;;) {
        for (int r = 0; r < CELL_RULES; r++)
            if (c->rule[r].n) fill_box(c, lo, end, (CellRule)r, &c->rule[r]);
        uint32_t d = 0; /* the next part of the grid inside the box, as one counts */
        for (; d <= last && end[d] >= x->end[d]; d++) lo[d] = x->lo[d], end[d] = next_line(c, x, d, x->lo[d]);
        if (d > last) return;
        lo[d] = end[d], end[d] = next_line(c, x, d, lo[d]);
    }
}

/* May it be cut further? */
static bool divisible(Cells *c, const Cell *cell) {
    bool room = false;
    for (uint32_t d = 0; d < c->dim; d++) room |= cell->box.hi[d] > cells_next(c, cell->box.lo[d], HUGE_VAL);
    if (c->o->budget && c->b->evaluations - c->began >= c->o->budget) c->counts->spent = true;
    return room && !c->counts->spent && side(c, &cell->box) > c->o->least;
}

/* The cell is cut further, or left over. */
static bool refine(Cells *c, Cell *cell) {
    cell->done = true, cell->axes = 0;
    if (!divisible(c, cell)) {
        count_cell(c, cell, CELL_LEFT);
        c->sink->left(c->sink->user, &cell->box, cell->f);
        return true;
    }
    if (!CELLS_ROOM(c, stack, 1)) return false;
    c->stack[c->nstack++] = (Node){.box = cell->box, .level = cell->level, .bends = cell->bends};
    return true;
}

/* Does a line of the grid run through the inside? */
static bool across_grid(const Cells *c, const Box *x) {
    for (uint32_t d = 0; d < c->dim; d++)
        if (next_line(c, x, d, x->lo[d]) < x->end[d]) return true;
    return false;
}

/* Settles a cell, or finds that it is curved, or that it must be refined. */
static void judge(Cells *c, Cell *cell) {
    uint32_t sites = 0, bends = cell->state & SLT_BOX_ROUGH;
    for (uint32_t e = 0; e < cell->nedges && !cell->refine; e++) {
        sites += (uint32_t)cell->edge[e].event.site < c->s->nsites;
        bends |= cell->edge[e].state & SLT_EDGE_BENDS;
    }
    bool rough = !cell->refine && bends && cell->bends < CELL_BENDS;
    cell->bends += rough;
    if (!cell->refine && !(c->o->volume ? cell->nedges : sites) && !(rough && c->o->volume)) {
        settle(c, cell);
        cell->done = true;
    } else if (rough || across_grid(c, &cell->box) || (!cell->refine && !cells_choose_axes(c, cell))) {
        cell->refine = true, cell->axes = 0;
    }
}

/* A node's halves and the halves of these go through one call of `bounds`; the small ones count where the large one is
 * no cell. */
static bool work(Cells *c, const Node *node) {
    enum { HALVES = 8 };
    uint32_t first[HALVES + 1], halves;
    c->ncell = 0, c->within = node->box;
    split(c, &node->box, node->level, node->bends);
    halves = c->ncell;
    for (uint32_t i = 0; i < halves; i++) {
        first[i] = c->ncell;
        split(c, &c->cell[i].box, c->cell[i].level, c->cell[i].bends);
    }
    first[halves] = c->ncell;
    cells_bound(c, c->cell, c->ncell);
    if (!cells_close(c, c->cell, halves)) return false;
    for (uint32_t i = 0; i < halves; i++) {
        Cell *cell = &c->cell[i];
        judge(c, cell);
        bool deeper = cell->refine && divisible(c, cell);
        for (uint32_t k = first[i]; k < first[i + 1]; k++) c->cell[k].done = !deeper, c->cell[k].bends = cell->bends;
        if (deeper) cell->done = true;
        else if (cell->refine && !refine(c, cell)) return false;
    }
    if (!cells_close(c, c->cell + halves, c->ncell - halves)) return false;
    for (uint32_t i = halves; i < c->ncell; i++) {
        Cell *cell = &c->cell[i];
        if (cell->done) continue;
        judge(c, cell);
        if (cell->refine && !refine(c, cell)) return false;
    }
    if (!cells_cut_bases(c)) return false;
    for (uint32_t i = 0; i < c->ncell; i++) {
        Cell *cell = &c->cell[i];
        if (!cell->axes) continue;
        if (!cell->refine) count_cell(c, cell, CELL_CURVED);
        else if (!refine(c, cell)) return false;
    }
    if (!cells_integrate(c)) return false;
    cells_flush(c);
    return !c->failed;
}

/* The budget is spent: nothing more is asked of this part. */
static void give_up(Cells *c, const Node *node) {
    Cell cell = {.box = node->box};
    for (uint32_t ch = 0; ch < c->s->channels; ch++) cell.f[2 * ch] = -HUGE_VAL, cell.f[2 * ch + 1] = HUGE_VAL;
    count_cell(c, &cell, CELL_LEFT);
    c->sink->left(c->sink->user, &cell.box, cell.f);
}

bool cells_run(Cells *c, const Box *tile, const CellOptions *o, const CellSink *sink, CellCounts *counts) {
    c->o = o, c->sink = sink, c->counts = counts;
    c->began = c->b->evaluations;
    c->failed = false, c->nstack = 0;
    gauss_rule(&c->rule[CELL_FINE], o->gauss);
    if (o->coarse) gauss_rule(&c->rule[CELL_COARSE], o->coarse);
    else c->rule[CELL_COARSE].n = 0;
    if (!CELLS_ROOM(c, stack, 1)) return false;
    c->stack[c->nstack++] = (Node){.box = *tile};
    while (c->nstack) {
        Node node = c->stack[--c->nstack];
        if (counts->spent) give_up(c, &node);
        else if (!work(c, &node)) return false;
    }
    return true;
}
