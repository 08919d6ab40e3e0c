/* Areas by what bounds them, where f is constant between curves and its hash tells it (2D): the integral of x_k n_k
 * around a part is its area. Every curve that is seen adds its own integral to what lies below it and takes it from
 * what lies above, by the points it has anyway; besides there is the face of the cell at whose opposite x_k is counted
 * from, in pieces between the places where curves leave through it. So no curve is cut where hidden ones meet it,
 * curves need no height axis in common, and parts between them get no points. */
#include <math.h>
#include <string.h>

#include "runtime/quadrature/cells_inner.h"

bool cells_may_border(const Cells *c, const Cell *cell) {
    const CellOptions *o = c->o;
    bool may = o->flat && o->volume && o->curves && !(o->grid[0] > 0) && c->s->told && c->b->f64 && c->dim == 2 &&
               !c->prunes && !cell->curves_done && cell->nedges > 0;
    for (uint32_t e = 0; e < cell->nedges && may; e++)
        may = (uint32_t)cell->edge[e].event.site < c->s->nsites && !(cell->edge[e].state & SLT_EDGE_BENDS) &&
              !cells_is_wave(c->s, cell->edge[e].event.site);
    return may;
}

/* A part of a face between two curves that leave through it. */
struct Rim {
    uint32_t hash;
    bool told; /* hash is */
    double x[3], area;
};

static bool add_rim(Cells *c, const Rim *r) {
    if (!CELLS_ROOM(c, rim, 1)) return false;
    c->rim[c->nrim++] = *r;
    return true;
}

/* ---- what was seen in the middle of a piece */
/* Bits of edges to edges, ascending in height; how many. */
static uint32_t ascending(const Piece *p, uint8_t edge[CELL_EDGES]) {
    uint32_t n = 0;
    for (uint32_t set = p->seen, e; cells_take_edge(&set, &e);) {
        uint32_t at = n++;
        for (; at && p->edge[edge[at - 1]].middle > p->edge[e].middle; at--) edge[at] = edge[at - 1];
        edge[at] = (uint8_t)e;
    }
    return n;
}

/* A place beside the curve of an edge, where it was looked at. */
static void place_beside(const Cells *c, const Piece *p, const PieceEdge *e, int side, double x[3]) {
    x[p->base] = e->at, x[p->axis] = cells_sides_of(c, e)->at[side];
}

/* Do all curves above the middle lie apart, and the sides of one fit those of the next? */
static bool is_plain(const Cells *c, const Piece *p, const Column *k) {
    uint8_t edge[CELL_EDGES];
    for (uint32_t i = k->first; i < k->first + k->nroots; i++) {
        const Root *r = &c->root[i];
        bool lost = p->present >> r->edge & 1 && !(p->seen >> r->edge & 1);
        if (r->twin || r->band || r->tie || r->other || lost) return false;
    }
    for (uint32_t n = ascending(p, edge), i = 1; i < n; i++) {
        const PieceEdge *below = &p->edge[edge[i - 1]], *above = &p->edge[edge[i]];
        if (!(below->middle < above->middle)) return false;
        if (c->cell[p->cell].common && cells_sides_of(c, below)->hash[1] != cells_sides_of(c, above)->hash[0])
            return false;
    }
    return true;
}

/* ---- the face of a cell whose curves have one height axis: piece by piece */
/* What is above a piece without curves, where one of the neighbour's, the only one there, left through this end. */
static bool told_by_neighbour(const Cells *c, const Piece *neighbour, int end, const Piece *p, Rim *r) {
    uint8_t edge[CELL_EDGES];
    uint32_t n = ascending(neighbour, edge);
    if (n != 1 || p->leaving[end] != (int8_t)edge[0]) return false;
    const PieceEdge *e = &neighbour->edge[edge[0]];
    r->hash = cells_sides_of(c, e)->hash[!p->up[end]], r->told = true;
    place_beside(c, neighbour, e, !p->up[end], r->x);
    return true;
}

static bool add_rims_of_pieces(Cells *c, uint32_t from, uint32_t to) {
    for (uint32_t i = from; i < to; i++) {
        const Piece *p = &c->piece[i];
        const Box *box = &c->cell[p->cell].box;
        double length = p->at[p->base][1] - p->at[p->base][0];
        Rim r = {.area = length * (box->end[p->axis] - box->lo[p->axis])};
        uint8_t edge[CELL_EDGES];
        uint32_t n = ascending(p, edge);
        if (n) {
            const PieceEdge *top = &p->edge[edge[n - 1]];
            r.hash = cells_sides_of(c, top)->hash[1], r.told = true;
            place_beside(c, p, top, 1, r.x);
        } else if (!(i > from && told_by_neighbour(c, p - 1, 0, p, &r)) &&
                   !(i + 1 < to && told_by_neighbour(c, p + 1, 1, p, &r))) {
            r.x[p->base] = cells_round(c, 0.5 * (p->at[p->base][0] + p->at[p->base][1]));
            r.x[p->axis] = cells_round(c, 0.5 * (box->lo[p->axis] + box->hi[p->axis]));
        }
        if (!add_rim(c, &r)) return false;
    }
    return true;
}

/* ---- and of others */
static bool is_clear(const CellEdge *e, const Corner *k) { return fabs(k->g) > 2 * e->error; /* NaN is not */ }

/* Do corners tell of each curve whether it leaves through the upper face across an axis? */
static bool knows_face(const Cell *cell, int across) {
    bool known = true;
    for (uint32_t i = 0; i < cell->nedges; i++) {
        const CellEdge *e = &cell->edge[i];
        if (e->axis == across) known &= e->sure[1];
        else known &= is_clear(e, &e->corner[0][1]) && is_clear(e, &e->corner[1][1]);
    }
    return known;
}

/* The place on the face where a curve with another height axis leaves: begins to be solved. False: no memory. */
static bool begin_leaving(Cells *c, const Cell *cell, uint32_t edge, int across, bool *leaves) {
    const CellEdge *e = &cell->edge[edge];
    *leaves = (e->corner[0][1].g < 0) != (e->corner[1][1].g < 0);
    if (!*leaves) return true;
    double x[3] = {0};
    x[across] = cell->box.hi[across];
    Root *r = cells_root(c, cell, e, e->axis, x, cells_height_by_corners(cell, e, across, x[across]));
    if (r) r->turns = HUGE_VAL;
    return r != NULL;
}

/* Solves for the places, and parts the face there. */
static bool add_rims_of_face(Cells *c, const Cell *cell) {
    int across = cell->border_axis, along = 1 - across;
    double at[CELL_EDGES + 2], width = cell->box.end[across] - cell->box.lo[across];
    uint32_t n = 0, first = c->nroot;
    at[n++] = cell->box.lo[along];
    for (uint32_t i = 0; i < cell->nedges; i++) {
        const CellEdge *e = &cell->edge[i];
        bool leaves = e->axis == across && (e->corner[1][0].g < 0) != (e->corner[1][1].g < 0);
        if (leaves) at[n++] = e->leaves[1];
        if (e->axis != across && !begin_leaving(c, cell, i, across, &leaves)) return false;
    }
    if (!cells_solve(c)) return false;
    for (; first < c->nroot; first++) at[n++] = c->root[first].x[along];
    for (uint32_t i = 1; i < n; i++)
        for (uint32_t j = i; j > 1 && at[j - 1] > at[j]; j--) {
            double keep = at[j];
            at[j] = at[j - 1], at[j - 1] = keep;
        }
    at[n++] = cell->box.end[along];
    for (uint32_t i = 0; i + 1 < n; i++) {
        Rim r = {.area = (at[i + 1] - at[i]) * width};
        r.x[across] = cell->box.hi[across], r.x[along] = cells_round(c, 0.5 * (at[i] + at[i + 1]));
        if (at[i + 1] > at[i] && !add_rim(c, &r)) return false;
    }
    return true;
}

/* ---- rims go out */
static bool emit_rims(Cells *c) {
    uint32_t n = 0;
    if (!cells_grow(c, &c->active, &c->active_cap, c->nrim, sizeof *c->active)) return false;
    for (uint32_t i = 0; i < c->nrim; i++)
        if (!c->rim[i].told) c->active[n++] = i;
    for (uint32_t from = 0; from < n; from += BATCH) {
        uint32_t lanes = n - from < BATCH ? n - from : BATCH;
        for (uint32_t i = 0; i < lanes; i++) batch_set_x(c->b, i, c->rim[c->active[from + i]].x);
        cells_call(c, SLT_K_SIDES, lanes);
        for (uint32_t i = 0; i < lanes; i++)
            c->rim[c->active[from + i]].hash = (uint32_t)batch_get_int(c->b, SLT_OUT_HASH, 0, i);
    }
    for (uint32_t i = 0; i < c->nrim; i++) {
        const Rim *r = &c->rim[i];
        const double area[CELL_RULES] = {r->area, c->rule[CELL_COARSE].n ? r->area : 0};
        cells_add_shape(c, r->hash, r->x, area, 0, r->area);
    }
    return true;
}

/* ---- pieces of one curve each */
static bool has_same_sides(const Cells *c, uint32_t sides, uint32_t other) {
    const Sides *s = &c->sides[sides - 1], *t = &c->sides[other - 1];
    return s->hash[0] == t->hash[0] && s->hash[1] == t->hash[1];
}

static double length_of(const Piece *p) { return p->at[p->base][1] - p->at[p->base][0]; }

/* Appends pieces [from, to) of a cell as those of one curve each, which go on where nothing changes beside them. */
static bool part_curves(Cells *c, uint32_t from, uint32_t to) {
    uint32_t all = 0;
    for (uint32_t i = from; i < to; i++) all |= c->piece[i].present;
    for (uint32_t e; cells_take_edge(&all, &e);) {
        double longest = 0;
        Piece *q = NULL;
        for (uint32_t i = from; i < to; i++) {
            if (!(c->piece[i].present >> e & 1)) {
                q = NULL;
                continue;
            }
            if (!CELLS_ROOM(c, piece, 1)) return false;
            const Piece *p = &c->piece[i];
            if (q) q = &c->piece[c->npiece - 1]; /* the array may have moved */
            if (q && q->axis == p->axis && q->at[q->base][1] == p->at[p->base][0] &&
                has_same_sides(c, q->edge[e].sides, p->edge[e].sides)) {
                q->at[q->base][1] = p->at[p->base][1], q->leaving[1] = p->leaving[1], q->beyond[1] = p->beyond[1];
            } else {
                q = &c->piece[c->npiece++];
                memcpy(q, p, offsetof(Piece, edge));
                q->present = 1u << e, q->alone = true, q->only = (uint8_t)e, longest = 0;
            }
            if (!(length_of(p) > longest)) continue;
            longest = length_of(p), q->edge[e] = p->edge[e];
        }
    }
    return true;
}

/* Of pieces [from, to), all those of a cell: is what was seen in their middles as simple as it must be? */
static bool is_simple(const Cells *c, uint32_t first, uint32_t from, uint32_t to) {
    bool simple = true;
    for (uint32_t i = from; i < to && simple; i++) simple = is_plain(c, &c->piece[i], &c->column[i - first]);
    return simple;
}

static bool find_border_axis(Cell *cell) {
    for (int8_t k = 0; k < 2; k++)
        if (knows_face(cell, k)) {
            cell->border_axis = k;
            return true;
        }
    return false;
}

bool cells_part_borders(Cells *c, uint32_t first) {
    uint32_t end = c->npiece, kept = first;
    c->nrim = 0;
    for (uint32_t from = first, to; from < end; from = to) {
        Cell *cell = &c->cell[c->piece[from].cell];
        to = from + 1;
        if (!cell->borders || c->piece[from].alone) continue;
        while (to < end && c->piece[to].cell == c->piece[from].cell && !c->piece[to].alone) to++;
        cell->border_axis = c->piece[from].axis;
        cell->borders = is_simple(c, first, from, to) && (cell->common || find_border_axis(cell));
        if (!cell->common && !cells_end_borders(c, cell)) return false;
        if (!cell->borders) continue;
        if (!(cell->common ? add_rims_of_pieces(c, from, to) : add_rims_of_face(c, cell))) return false;
        if (!part_curves(c, from, to)) return false;
    }
    for (uint32_t i = first; i < c->npiece; i++) {
        const Piece *p = &c->piece[i];
        if (i < end && !p->alone && c->cell[p->cell].borders) continue;
        if (kept != i) cells_copy_piece(c, kept, i);
        kept++;
    }
    c->npiece = kept;
    return emit_rims(c);
}

/* ---- the areas that curves tell of */
/* What a curve adds to the part below it, by rule; and the size of the terms. */
static double area_below(const Cells *c, const Piece *p, const Column *from, const Column *to,
                         double area[CELL_RULES]) {
    const Cell *cell = &c->cell[p->cell];
    int k = cell->border_axis;
    double size = 0;
    area[CELL_FINE] = area[CELL_COARSE] = 0;
    for (const Column *q = from; q < to; q++)
        for (uint32_t i = q->first; i < q->first + q->nroots; i++) {
            const Root *r = &c->root[i];
            double normal = k == p->axis ? 1 : r->dg[k] / r->dg[p->axis];
            double part = q->weight * (r->x[k] - cell->box.lo[k]) * normal;
            area[q->rule] += part, size += fabs(part);
        }
    return size;
}

bool cells_borders_agree(const Cells *c, const Piece *p, const Column *from, const Column *to) {
    double area[CELL_RULES], size = area_below(c, p, from, to, area);
    return fabs(area[CELL_FINE] - area[CELL_COARSE]) <= larger(c->o->tolerance * c->volume, cells_part_noise(c, size));
}

void cells_add_borders(Cells *c, const Piece *p, const double area[CELL_RULES], double size) {
    const PieceEdge *e = &p->edge[p->only];
    double x[3] = {0};
    for (int side = 0; side < 2; side++) {
        double sign = side ? -1 : 1;
        place_beside(c, p, e, side, x);
        const double part[CELL_RULES] = {sign * area[CELL_FINE], sign * area[CELL_COARSE]};
        cells_add_shape(c, cells_sides_of(c, e)->hash[side], x, part, 0, size);
    }
}

void cells_emit_borders(Cells *c, const Piece *p, const Column *from, const Column *to) {
    double area[CELL_RULES], size = area_below(c, p, from, to, area);
    bool told = p->present >> p->only & 1 && p->edge[p->only].sides && from != to;
    if (told) cells_add_borders(c, p, area, size);
}
