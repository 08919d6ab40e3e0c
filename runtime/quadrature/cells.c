/* The tree of cells: a node's halves go through `bounds`, and the halves of those of them that must be cut; each is
 * settled, curved, a node again, or left over. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/quadrature/cells_inner.h"
#include "runtime/sample/alloc.h"

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

static bool asks_rays_alone(const SltScene *s) {
    for (uint32_t i = 0; i < s->nsites; i++)
        if (!cells_is_ray(s, (int32_t)i)) return false;
    return s->nsites > 0;
}

Cells *cells_new(Batch *b, const double lo[3], const double hi[3]) {
    Cells *c = calloc(1, sizeof *c);
    if (!c) return NULL;
    c->b = b, c->s = b->s, c->dim = b->s->dim, c->volume = 1;
    uint32_t named = scene_outputs(c->s, SLT_K_BOUNDS, SLT_OUT_OPEN_EDGE);
    c->depth = named ? scene_outputs(c->s, SLT_K_BOUNDS, SLT_OUT_OPEN_K) / named : 0;
    for (uint32_t d = 0; d < c->dim; d++) {
        c->lo[d] = lo[d], c->hi[d] = hi[d], c->volume *= hi[d] - lo[d];
        c->width = fmax(c->width, hi[d] - lo[d]);
    }
    c->rays = asks_rays_alone(c->s);
    for (uint32_t e = 0; e < c->s->nedges; e++) c->waves |= cells_is_wave(c->s, (int32_t)e);
    for (uint32_t n = 1; n <= GAUSS_MAX; n++) gauss_rule(&c->of[n], n);
    bool made = lists_init(&c->lists, c->s) && cells_prune_init(c);
    made &= cells_grow(c, &c->cell, &c->cell_cap, CELL_BOXES, sizeof *c->cell);
    made &= (c->straight = calloc(c->s->nsites + 1, 1)) != NULL;
    /* What a curve does not set of its crossings stays 0. */
    for (int r = 0; r < CELL_RULES; r++) made &= (c->crossing[r] = alloc_sparse(BATCH, sizeof *c->crossing[r])) != NULL;
    for (int r = 0; r < CELL_POINTS; r++) made &= (c->point[r] = malloc(BATCH * sizeof *c->point[r])) != NULL;
    if (made) return c;
    cells_free(c);
    return NULL;
}

void cells_free(Cells *c) {
    if (!c) return;
    cells_prune_free(c);
    free(c->stack), free(c->cell), free(c->piece), free(c->column), free(c->root), free(c->probe), free(c->ask);
    free(c->active), free(c->order), free(c->stretch), free(c->cut), free(c->rim), free(c->first_column);
    free(c->straight), free(c->spot), free(c->smooth), free(c->sides), free(c->trial), free(c->tie), free(c->arc),
        free(c->arc_point);
    for (uint32_t i = 0; i < CELL_LONGER; i++) apart_free(c->longer[i]);
    untie_free(c->untie), apart_free(c->apart), finer_free(&c->finer), free(c->gap), free(c->face), free(c->beside);
    for (int r = 0; r < CELL_RULES; r++) free(c->crossing[r]);
    for (int r = 0; r < CELL_POINTS; r++) free(c->point[r]);
    lists_free(&c->lists);
    free(c);
}

/* ---- numbers of the program's precision */
double cells_next(const Cells *c, double v, double towards) {
    return c->b->f64 ? nextafter(v, towards) : (double)nextafterf((float)v, (float)towards);
}

double cells_move(const Cells *c, double v, double n, double scale) {
    double unit = (c->b->f64 ? 0x1p-52 : 0x1p-23) * larger(fabs(v), scale), moved = cells_round(c, v + n * unit);
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
    for (uint32_t d = 0; d < c->dim; d++) longest = larger(longest, (x->end[d] - x->lo[d]) / (c->hi[d] - c->lo[d]));
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
        if (grid_line(c, d, lo, end, lo + t * (end - lo), &line)) p = line;
        if (p > at[made] && p < end && p < x->hi[d]) at[++made] = p;
    }
    at[++made] = end;
    return made;
}

/* Is a side of the box more than two floats? */
static bool has_room(const Cells *c, const Box *box, uint32_t d) {
    return box->hi[d] > cells_next(c, box->lo[d], HUGE_VAL);
}

/* Appends the parts of a box to c->cell: in halves along every axis, in quarters in 1D. */
static void split(Cells *c, const Box *box, const Node *node, uint32_t in_hand, bool whole) {
    enum { MOST = 4 };
    uint32_t parts = whole ? 1 : c->dim == 1 ? 4 : 2;
    double at[3][MOST + 1] = {{0}}, longest = 0;
    uint32_t n[3] = {1, 1, 1};
    for (uint32_t d = 0; d < c->dim; d++)
        if (has_room(c, box, d)) longest = larger(longest, (box->end[d] - box->lo[d]) / (c->hi[d] - c->lo[d]));
    for (uint32_t d = 0; d < c->dim; d++) {
        /* A side that is already far shorter than the others is left as it is, if these can be cut. */
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
                cell->level = node->level + !whole, cell->bends = node->bends, cell->seams = node->seams;
                cell->curves_done = node->curves_done, cell->lonely = node->lonely, cell->cut = -1;
                cell->upset = node->upset, cell->band = false;
                cell->node = in_hand, cell->number = c->ncell - 1, cell->slice = -1, cell->rule = -1, cell->weight = 1;
                cell->refine = false, cell->done = false, cell->axes = 0, cell->cuts = cell->halved = 0;
                cell->borders = false, cell->apart = 0;
            }
}

/* ---- what becomes of a cell */
static void count_box(Cells *c, const Box *box, CellState state) {
    double part = measure(c, box) / c->volume;
    *(state == CELL_SETTLED  ? &c->counts->settled
      : state == CELL_CURVED ? &c->counts->curved
                             : &c->counts->left) += part;
    c->counts->cells++;
    if (c->sink->cell) c->sink->cell(c->sink->user, box, state);
}

static void count_cell(Cells *c, const Cell *cell, CellState state) { count_box(c, &cell->box, state); }

void cells_leave(Cells *c, const Box *box, const double *bounds, double apart) {
    count_box(c, box, CELL_LEFT);
    c->sink->left(c->sink->user, box, bounds, apart);
}

static bool is_constant(const Cells *c, const Cell *cell) {
    for (uint32_t ch = 0; ch < c->s->channels; ch++)
        if (!(cell->f[2 * ch] == cell->f[2 * ch + 1])) return false;
    return true;
}

/* Where the box is cut by lines of the grid, rounded as `cuts` does it: the next after `from`, or its end. */
static double next_line(const Cells *c, const Box *x, uint32_t d, double from) {
    double step = c->o->grid[d], line = x->end[d];
    if (!(step > 0)) return line;
    double k = floor((from - c->o->grid_lo[d]) / step) + 1, at = cells_round(c, c->o->grid_lo[d] + k * step);
    if (at <= from + 1e-9 * step) at = cells_round(c, c->o->grid_lo[d] + (k + 1) * step);
    return at < line - 1e-9 * step ? at : line;
}

/* Points of the whole box, part by part of the grid. */
static bool fill(Cells *c, const Cell *cell, bool constant) {
    const Box *x = &cell->box;
    double lo[3] = {0}, end[3] = {1, 1, 1};
    uint32_t last = c->dim - 1;
    for (uint32_t d = 0; d < c->dim; d++) lo[d] = x->lo[d], end[d] = next_line(c, x, d, x->lo[d]);
    for (;;) {
        if (constant) cells_emit_middle(c, lo, end);
        else if (!cells_settle_box(c, cell, lo, end)) return false;
        uint32_t d = 0; /* the next part of the grid inside the box, as one counts */
        for (; d <= last && end[d] >= x->end[d]; d++) lo[d] = x->lo[d], end[d] = next_line(c, x, d, x->lo[d]);
        if (d > last) return true;
        lo[d] = end[d], end[d] = next_line(c, x, d, lo[d]);
    }
}

static bool settle(Cells *c, const Cell *cell) {
    count_cell(c, cell, CELL_SETTLED);
    if (!c->o->volume) return true;
    bool constant = is_constant(c, cell);
    if (!constant || !c->sink->constant) return fill(c, cell, constant || c->o->flat);
    double f[SLT_MAX_CHANNELS];
    for (uint32_t ch = 0; ch < c->s->channels; ch++) f[ch] = cell->f[2 * ch];
    c->sink->constant(c->sink->user, &cell->box, f);
    return true;
}

/* Of a solid: evaluations for which the nodes that wait because rules differ can be integrated as they are. That is far
 * better than lines that look for surfaces in them. */
static double reserve(const Cells *c) {
    if (!c->o->returns || !c->tried) return 0;
    return c->differ * CELL_GOES_OUT * ((double)(c->b->evaluations - c->began) / (double)c->tried);
}

bool cells_spent(Cells *c) {
    double used = (double)(c->b->evaluations - c->began);
    if (c->o->budget && used + reserve(c) >= (double)c->o->budget) c->counts->spent = true;
    return c->counts->spent;
}

#define LONELY 0x1p-12 /* how much smaller cells around points may be, */
#define BESIDE 0x1p-3  /* and those of which only the volume is wanted, where f is constant in it: all that they hide is of the value */

static bool is_divisible(const Cells *c, const Cell *cell) {
    bool room = false;
    for (uint32_t d = 0; d < c->dim; d++) room |= has_room(c, &cell->box, d);
    /* Around points little is left, and each level costs the same; along curves each costs twice the one before. */
    double least = c->o->least * (cell->lonely ? LONELY : cell->curves_done && c->o->flat && c->dim < 3 ? BESIDE : 1);
    return room && side(c, &cell->box) > least;
}

/* May it be cut further? */
bool cells_may_divide(Cells *c, const Cell *cell) { return !cells_spent(c) && is_divisible(c, cell); }

/* What remains of the volume where the curves are known: around a point or an edge of the least size, or larger where
 * the budget was spent. */
static bool sample(Cells *c, const Cell *cell) {
    count_cell(c, cell, CELL_CURVED);
    if (!c->o->volume) return true;
    if (!c->sink->sampled || !c->sink->sampled(c->sink->user, &cell->box, cell->f)) cells_emit_few(c, &cell->box);
    return true;
}

static bool push(Cells *c, const Cell *cell, const Box *box, bool whole) {
    if (!CELLS_ROOM(c, stack, 1)) return false;
    bool listed = c->lists.any && cell->number >= c->nhalves;
    int32_t *runs = cells_take_chunks(c, cell->number >= c->nhalves && !whole ? (int)(cell->number - c->nhalves) : -1);
    if (c->prunes && !runs) return false;
    ListsAt lists = listed ? lists_of(&c->lists, cell->number - c->nhalves) : lists_of_node(&c->lists);
    c->differ += cell->apart > 0;
    c->stack[c->nstack++] = (Node){.box = *box,
                                   .lists = lists,
                                   .runs = runs,
                                   .level = cell->level,
                                   .bends = cell->bends,
                                   .seams = cell->seams + whole,
                                   .whole = whole,
                                   .curves_done = cell->curves_done,
                                   .lonely = cell->lonely,
                                   .upset = cell->upset,
                                   .apart = cell->apart};
    return true;
}

bool cells_put_back(Cells *c, const Cell *cell, const Box *part) {
    c->counts->curved -= measure(c, part) / c->volume;
    return push(c, cell, part, false);
}

/* The cell is cut further, or left over. */
static bool refine(Cells *c, Cell *cell) {
    cell->done = true, cell->axes = 0;
    if (cells_may_divide(c, cell)) return push(c, cell, &cell->box, false);
    if (cell->curves_done) return sample(c, cell);
    cells_leave(c, &cell->box, cell->f, cell->apart);
    return true;
}

/* Does a line of the grid run through the inside? */
static bool across_grid(const Cells *c, const Box *x) {
    for (uint32_t d = 0; d < c->dim; d++)
        if (next_line(c, x, d, x->lo[d]) < x->end[d]) return true;
    return false;
}

/* Settles a cell, or finds that it is curved, or where it is to be cut, or that it must be refined. */
static bool judge(Cells *c, Cell *cell) {
    enum { SEAMS = 24 };
    uint32_t sites = 0;
    bool bends = false;
    for (uint32_t e = 0; e < cell->nedges && !cell->refine; e++) {
        int32_t edge = cell->edge[e].event.site;
        sites += (uint32_t)edge < c->s->nsites || (!cell->curves_done && cells_upsets(c, edge));
        bends |= (cell->edge[e].state & SLT_EDGE_BENDS) != 0;
    }
    /* Of choices f may only hang by what they decide: nothing any more. */
    if (c->prunes && !sites && !cell->state) cell->nedges = 0, bends = false;
    /* Pieces end where curves meet, and at curves they are graded. What bends a g is an edge itself, open here too; if
     * it is not, a few levels lead to where it bends. */
    bool rough = bends && cell->nedges < 2;
    rough |= cell->state & SLT_BOX_ROUGH && !cell->nedges;
    rough &= !cell->refine && cell->bends < (c->dim < 3 ? CELL_BENDS : CELL_BENDS / 2);
    bool unknown = cell->state & SLT_BOX_UNKNOWN || cell->many;
    if (!cell->refine && !unknown && !(c->o->volume ? cell->nedges : sites) && !(rough && c->o->volume)) {
        cell->done = true;
        return settle(c, cell);
    }
    if (cell->refine || across_grid(c, &cell->box)) {
        cell->refine = true;
        return true;
    }
    if (!rough && !unknown && cells_choose_axes(c, cell)) {
        cell->borders = cells_may_border(c, cell);
        if (cell->common || !c->o->volume || cell->borders) return true;
    }
    int axis, straight = cell->seams < SEAMS ? cells_straight_edge(c, cell, &axis) : -1;
    if (straight >= 0) cell->cut = (int8_t)straight, cell->done = true, cell->axes = 0;
    else if (rough || !cell->axes) cell->bends += rough, cell->refine = true, cell->axes = 0;
    return true;
}

/* Which way an angle turns where its y is 0 goes by the sign of the 0, which bounds cannot tell: it lies in the gap. */
static void clear_zero(const Cells *c, const Box *box, Root *r, const double near[2], const double far[2]) {
    int32_t edge = r->of->event.site;
    if ((uint32_t)edge < c->s->nsites || (uint32_t)edge >= c->s->nedges || !c->s->edge_kind) return;
    if (c->s->edge_kind[edge] != SLT_SITE_COMPARE || (c->s->edge_bends && c->s->edge_bends[edge])) return;
    double lo = cells_next(c, r->lo, -HUGE_VAL), hi = cells_next(c, r->hi, HUGE_VAL);
    if ((near[0] == 0 || near[1] == 0) && lo > box->lo[r->axis]) r->lo = lo;
    if ((far[0] == 0 || far[1] == 0) && hi < box->end[r->axis]) r->hi = hi;
}

/* Beside the gap g has one sign all over the two faces, however it is rounded there; else the parts would not be
 * settled. Of one that does not the bracket becomes empty. */
static bool check_faces(Cells *c) {
    c->nask = 0;
    const Root *r = c->root;
    for (uint32_t i = 0; i < c->ncell; i++) {
        const Cell *cell = &c->cell[i];
        if (cell->cut < 0) continue;
        for (int side = 0; side < 2; side++) {
            Box face = cell->box;
            face.lo[r->axis] = face.hi[r->axis] = side ? r->hi : r->lo;
            if (!cells_ask(c, &cell->edge[cell->cut], face.lo, face.hi)) return false;
        }
        r++;
    }
    if (!cells_run_asks(c)) return false;
    for (uint32_t i = 0, k = 0; i < c->ncell; i++) {
        if (c->cell[i].cut < 0) continue;
        Root *root = &c->root[k];
        const Ask *near = &c->ask[2 * k], *far = near + 1;
        bool settled = (near->g[1] < 0 && far->g[0] >= 0) || (near->g[0] >= 0 && far->g[1] < 0);
        if (!settled) root->hi = root->lo;
        else clear_zero(c, &c->cell[i].box, root, near->g, far->g);
        k++;
    }
    return true;
}

/* Where g is 0 on a face `a > b` decides there as beyond it: of sites the gap gets one float more on both sides. */
static void widen(const Cells *c, const Cell *cell, Root *r) {
    double lo = cells_next(c, r->lo, -HUGE_VAL), hi = cells_next(c, r->hi, HUGE_VAL);
    if ((uint32_t)cell->edge[cell->cut].event.site >= c->s->nsites || cell->curves_done || !(r->lo < r->hi)) return;
    if (lo > cell->box.lo[r->axis]) r->lo = lo;
    if (hi < cell->box.hi[r->axis]) r->hi = hi;
}

/* Cells that have a straight edge become two, that share no point: what jumps or bends there does so in neither. */
static bool cut_cells(Cells *c) {
    c->nroot = 0;
    for (uint32_t i = 0; i < c->ncell; i++) {
        const Cell *cell = &c->cell[i];
        if (cell->cut < 0) continue;
        int axis = cells_straight_axis(c, &cell->edge[cell->cut]);
        double middle[3] = {0};
        for (uint32_t d = 0; d < c->dim; d++) middle[d] = cells_round(c, 0.5 * (cell->box.lo[d] + cell->box.hi[d]));
        if (!cells_root(c, cell, &cell->edge[cell->cut], axis, middle, middle[axis])) return false;
    }
    if (!c->nroot) return true;
    if (!cells_solve(c) || !cells_narrow(c)) return false;
    for (uint32_t i = 0, k = 0; i < c->ncell; i++)
        if (c->cell[i].cut >= 0) widen(c, &c->cell[i], &c->root[k++]);
    if (!check_faces(c)) return false;
    const Root *r = c->root;
    for (uint32_t i = 0; i < c->ncell; i++) {
        Cell *cell = &c->cell[i];
        if (cell->cut < 0) continue;
        Box near = cell->box, far = cell->box;
        near.hi[r->axis] = r->lo, near.end[r->axis] = far.lo[r->axis] = r->hi;
        bool cut = r->lo < r->hi; /* else it does not decide there after all */
        if (cut && !cells_add_gap(c, i, r)) return false;
        if (!cells_check_cut(c, cell, r++)) return false;
        if (!cut && cells_choose_axes(c, cell)) cell->done = false;
        else if (!cut && !refine(c, cell)) return false;
        if (cut && (!push(c, cell, &near, true) || !push(c, cell, &far, true))) return false;
    }
    return cells_integrate_gaps(c);
}

/* Where areas are told by what bounds them nothing is left to do; else the volume is another matter. */
bool cells_end_borders(Cells *c, Cell *cell) {
    if (cell->borders) {
        count_cell(c, cell, CELL_CURVED);
        return true;
    }
    bool done = cell->done, curves_done = cell->curves_done;
    uint32_t axes = cell->axes;
    cell->curves_done = true;
    bool ok = refine(c, cell);
    cell->done = done, cell->curves_done = curves_done, cell->axes = axes;
    return ok;
}

/* 3D: those on which the rules differ are cut further, as long as that can be. */
static bool integrate_solids(Cells *c) {
    for (uint32_t i = 0, n = c->ncell; i < n; i++) {
        if (!c->cell[i].axes) continue;
        bool agree = true;
        c->tried++, c->counts->tried++;
        bool may_refine = c->o->returns ? is_divisible(c, &c->cell[i]) : cells_may_divide(c, &c->cell[i]);
        may_refine &= !c->o->last;
        if (!cells_integrate_solid(c, i, may_refine, &agree)) return false;
        c->cell[i].refine = !agree;
    }
    return true;
}

/* Marks the cells of nodes of which few parts are no cells. */
static void find_lonely(Cells *c) {
    enum { FEW = 3 };
    uint32_t count[CELL_BOXES] = {0};
    for (uint32_t i = 0; i < c->ncell; i++) count[c->cell[i].node] += c->cell[i].refine && !c->cell[i].done;
    for (uint32_t i = 0; i < c->ncell; i++) c->cell[i].lonely = count[c->cell[i].node] <= FEW;
}

/* Cuts those of the halves of nodes that are no cells in halves. Where nothing is ever a curve no shape of a cell is
 * better than another: these are nodes. */
static bool split_halves(Cells *c, const Node *node) {
    for (uint32_t i = 0; i < c->nhalves; i++) {
        Cell *cell = &c->cell[i];
        if (!cell->refine) continue;
        if (c->rays || !cells_may_divide(c, cell)) {
            if (!refine(c, cell)) return false;
            continue;
        }
        cell->done = true;
        uint32_t first = c->ncell;
        split(c, &cell->box, &node[cell->node], cell->node, false);
        for (uint32_t k = first; k < c->ncell; k++) c->cell[k].bends = cell->bends;
    }
    return true;
}

/* Do lines of an image's grid run through its halves too? */
static bool is_coarse(const Cells *c, const Node *node) {
    bool coarse = !node->whole;
    for (uint32_t d = 0; d < c->dim; d++) {
        double side = node->box.end[d] - node->box.lo[d];
        coarse &= c->o->grid[d] > 0 && side > 3 * c->o->grid[d];
    }
    return coarse;
}

/* The halves of halves, at once. */
static void split_twice(Cells *c, const Node *node, uint32_t in_hand) {
    uint32_t first = c->ncell;
    Box half[8];
    split(c, &node->box, node, in_hand, false);
    uint32_t n = c->ncell - first;
    for (uint32_t i = 0; i < n; i++) half[i] = c->cell[first + i].box;
    c->ncell = first;
    for (uint32_t i = 0; i < n; i++) split(c, &half[i], node, in_hand, false);
    for (uint32_t i = first; i < c->ncell; i++) c->cell[i].level++;
}

/* The halves of nodes go through one call of `bounds`, and the halves of these through another; where the first could
 * only be cut again, for lines of the grid run through them, there is no first. */
static bool work(Cells *c, const Node *node, uint32_t nodes) {
    c->ncell = 0;
    for (uint32_t i = 0; i < nodes; i++)
        if (!is_coarse(c, &node[i])) split(c, &node[i].box, &node[i], i, node[i].whole);
    c->nhalves = c->ncell;
    if (!cells_bound_halves(c) || !cells_close(c, c->cell, c->nhalves)) return false;
    for (uint32_t i = 0; i < c->nhalves; i++)
        if (!judge(c, &c->cell[i])) return false;
    const uint32_t halves = c->nhalves;
    if (!split_halves(c, node)) return false;
    for (uint32_t i = 0; i < nodes; i++)
        if (is_coarse(c, &node[i])) split_twice(c, &node[i], i);
    if (!cells_bound_small(c)) return false;
    if (!cells_close(c, c->cell + halves, c->ncell - halves)) return false;
    for (uint32_t i = halves; i < c->ncell; i++)
        if (!judge(c, &c->cell[i])) return false;
    if (!cut_cells(c)) return false;
    if (c->dim < 3 ? !cells_cut_bases(c, 0) : !integrate_solids(c)) return false;
    find_lonely(c);
    for (uint32_t i = halves; i < c->ncell; i++) {
        Cell *cell = &c->cell[i];
        if (cell->refine && !cell->done && !cell->axes && !refine(c, cell)) return false;
    }
    for (uint32_t i = 0; i < c->ncell; i++) {
        Cell *cell = &c->cell[i];
        if (!cell->axes) continue;
        if (cell->refine) {
            if (!refine(c, cell)) return false;
        } else if (!c->o->volume || cell->common) count_cell(c, cell, CELL_CURVED);
        else if (!cell->borders && !cells_end_borders(c, cell)) return false;
    }
    return (c->dim == 3 || cells_integrate(c)) && cells_integrate_smooth(c) && !c->failed;
}

/* The budget is spent: nothing more is asked of this part but its range, where that alone tells its error. */
static void give_up(Cells *c, Node *node) {
    Cell *cell = &c->cell[0];
    memset(cell, 0, sizeof *cell);
    cell->box = node->box, cell->curves_done = node->curves_done;
    cells_enter_chunks(c, node);
    if (node->curves_done) {
        lists_enter(&c->lists, c->b, node->lists);
        if (c->lists.any) c->within = node->box;
        cells_bound_range(c, cell);
        sample(c, cell);
        if (c->lists.any) cells_flush(c);
        return;
    }
    for (uint32_t ch = 0; ch < c->s->channels; ch++) cell->f[2 * ch] = -HUGE_VAL, cell->f[2 * ch + 1] = HUGE_VAL;
    cells_leave(c, &cell->box, cell->f, node->apart);
}

/* Takes up to `most` of the nodes that wait; how many. The largest come first: what a budget leaves over is then small
 * everywhere, and not all of a corner. The last ones come first where there are lists, which lie in a stack, and when
 * more wait than memory is meant for. */
static uint32_t take_nodes(Cells *c, uint32_t most, Node *node) {
    enum { WAITING = 1 << 15 };
    bool oldest = !c->lists.any && c->o->budget && c->nstack - c->oldest < WAITING;
    uint32_t waiting = c->nstack - c->oldest, n = waiting < most ? waiting : most;
    memcpy(node, c->stack + (oldest ? c->oldest : c->nstack - n), n * sizeof *node);
    for (uint32_t i = 0; i < n; i++) c->differ -= node[i].apart > 0;
    if (oldest) c->oldest += n;
    else c->nstack -= n;
    if (c->oldest > WAITING || c->oldest == c->nstack) { /* the room of those that are done */
        c->nstack -= c->oldest;
        memmove(c->stack, c->stack + c->oldest, c->nstack * sizeof *c->stack);
        c->oldest = 0;
    }
    return n;
}

bool cells_run(Cells *c, const Box *tile, const CellOptions *o, const CellSink *sink, CellCounts *counts) {
    c->o = o, c->sink = sink, c->counts = counts;
    c->began = c->b->evaluations;
    while (c->nstack > c->oldest) free(c->stack[--c->nstack].runs); /* of a tile that was stopped */
    c->failed = false, c->nstack = c->oldest = c->nsmooth = c->npiece = c->ngap = c->nbeside = 0, c->bend = 0,
    c->hunted = 0, c->tried = c->differ = 0, c->most = o->seen;
    memset(c->straight, 0, c->s->nsites);
    gauss_rule(&c->rule[CELL_FINE], o->gauss);
    if (o->coarse) gauss_rule(&c->rule[CELL_COARSE], o->coarse);
    else c->rule[CELL_COARSE].n = 0;
    c->slack = o->slack, c->tallest = c->broadest = CELL_FEWEST, c->broad = c->rule[CELL_FINE].n, c->unasked = 0;
    memset(c->deep, 0, sizeof c->deep);
    c->tall = o->tall && o->tall < c->rule[CELL_FINE].n ? o->tall : c->rule[CELL_FINE].n;
    c->bits = log2(fmin(10 * o->tolerance, 0.5));
    for (int r = 0; r < CELL_RULES; r++) {
        c->graded[r] = c->rule[r];
        for (uint32_t i = 0; i < c->rule[r].n; i++) {
            double t = c->rule[r].x[i];
            c->graded[r].x[i] = t * t * (3 - 2 * t), c->graded[r].w[i] *= 6 * t * (1 - t);
        }
    }
    if (!CELLS_ROOM(c, stack, 1)) return false;
    const SltCullList *given = c->b->args.cull;
    Node root = {.box = *tile, .lists = lists_begin(&c->lists, c->b), .curves_done = o->curves_done};
    root.whole = !o->divides && !is_coarse(c, &root);
    if (!cells_prune_root(c, &root)) return false;
    c->stack[c->nstack++] = root;
    /* Many nodes at once keep vectors full. With lists it is one: they are good for it alone. */
    const uint32_t parts = c->rays ? 1u << c->dim : c->dim < 3 ? 20 : 72;
    uint32_t at_once = c->lists.any || c->prunes ? 1 : CELL_BOXES / parts;
    bool worked = true;
    c->within = *tile;
    while (worked && c->nstack && !(o->pool && pool_stop_reason(o->pool) != SLT_OK)) {
        Node node[CELL_BOXES / 2];
        uint32_t n = take_nodes(c, counts->spent ? 1 : at_once, node);
        if (counts->spent) {
            give_up(c, node);
            continue;
        }
        lists_enter(&c->lists, c->b, node[0].lists);
        cells_enter_chunks(c, node);
        if (c->lists.any) c->within = node[0].box;
        worked = work(c, node, n);
        if (c->lists.any) cells_flush(c);
    }
    counts->tall = c->tried ? c->tall : 0;
    batch_prune(c->b, NULL, NULL);
    cells_flush(c);
    c->b->args.cull = given, c->b->args.note = NULL;
    return worked;
}
