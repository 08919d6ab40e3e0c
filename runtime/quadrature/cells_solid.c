/* Curved cells of 3D: Gauss points along one axis, through each a plane, in which the cell is one of 2D. Along that
 * axis the cell is cut into slabs where the picture in the plane changes at an edge of the cell: where a curve passes
 * an edge, or two meet on a face. Where it changes inside, curves that touch a face, the rules differ and the cell is
 * cut further. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/quadrature/cells_inner.h"

enum { SLABS = 24, UNASKED = 7 };

/* May curves of the cell touch its faces inside, or each other, where no plane through a Gauss point need see it? Not
 * if they move along the base all over the cell, for then they reach its edges, where slabs end; nor do those that stay
 * off the faces across their height axis. Adds what must be asked for that. */
static bool ask_faces(Cells *c, const Cell *cell, int across) {
    for (uint32_t e = 0; e < cell->nedges; e++) {
        const CellEdge *edge = &cell->edge[e];
        if (edge->axis < 0 || edge->rises[3 - across - edge->axis]) continue;
        for (int far = 0; far < 2; far++) {
            double lo[3], hi[3];
            memcpy(lo, cell->box.lo, sizeof lo), memcpy(hi, cell->box.hi, sizeof hi);
            lo[edge->axis] = hi[edge->axis] = far ? hi[edge->axis] : lo[edge->axis];
            if (!cells_ask(c, edge, lo, hi)) return false;
        }
    }
    return true;
}

/* Is a within `slack` of `times` b? */
static bool is_near(const double a[2], const double b[2], double times, double slack) {
    bool turned = times < 0;
    return fabs(a[0] - times * b[turned]) <= slack && fabs(a[1] - times * b[!turned]) <= slack;
}

/* Is it the same surface, up to a factor of its g? Its bounds say so where it comes from the same operations; then the
 * two touch all over the cell, and every plane sees it. */
static bool is_same(const Cells *c, const CellEdge *e, const CellEdge *o) {
    const double *up = e->slope[e->axis], *other = o->slope[e->axis], times = (up[0] + up[1]) / (other[0] + other[1]);
    bool same = is_near(e->g, o->g, times, 2 * (e->error + fabs(times) * o->error)); /* NaN is not */
    for (int d = 0; d < 3; d++) {
        double size = fabs(e->slope[d][0]) + fabs(e->slope[d][1]);
        same &= is_near(e->slope[d], o->slope[d], times, (c->b->f64 ? 0x1p-48 : 0x1p-19) * size);
    }
    return same;
}

/* ask: what ask_faces asked, and behind it. */
static bool seen_by_planes(const Cells *c, const Cell *cell, int across, const Ask **ask) {
    bool seen = true;
    for (uint32_t e = 0; e < cell->nedges; e++) {
        const CellEdge *edge = &cell->edge[e];
        if (edge->axis < 0) continue;
        int base = 3 - across - edge->axis;
        /* What does not move along the base meets faces in lines along it, from one of the cell's edges to another. */
        bool still = edge->slope[base][0] == 0 && edge->slope[base][1] == 0;
        for (int far = 0; far < 2 && !edge->rises[base]; far++) {
            CellEdge face = *edge;
            cells_meet(c, &face, (*ask)++);
            seen &= still || face.g[0] > 0 || face.g[1] < 0;
        }
        for (uint32_t o = 0; o < cell->nedges; o++) {
            double climb[2], slope[2];
            if (o == e || (o < e && cell->edge[o].axis >= 0) || is_same(c, edge, &cell->edge[o])) continue;
            cells_slope_along(edge->slope, cell->edge[o].slope, base, edge->axis, climb, slope);
            seen &= slope[0] > 0 || slope[1] < 0;
        }
    }
    return seen;
}

/* The axes that may lie across the planes, bit by bit: no curve's height axis. */
static bool axes_of_planes(Cells *c, const Cell *cell, uint32_t *axes) {
    *axes = 0;
    c->nask = 0;
    for (int across = 0; across < 3; across++)
        if (!(cell->axes >> across & 1) && !ask_faces(c, cell, across)) return false;
    if (!cells_run_asks_about_centres(c)) return false;
    const Ask *ask = c->ask;
    for (int across = 0; across < 3; across++)
        if (!(cell->axes >> across & 1) && seen_by_planes(c, cell, across, &ask)) *axes |= 1u << across;
    return true;
}

/* The plane at x, a cell of 2D at the end of c->cell. */
static Cell *add_plane(Cells *c, uint32_t i, int across, double x, double weight, int8_t rule) {
    if (!CELLS_ROOM(c, cell, 1)) return NULL;
    Cell *p = &c->cell[c->ncell++];
    *p = c->cell[i];
    p->slice = (int8_t)across, p->rule = rule, p->weight = weight, p->halved = 0;
    p->box.lo[across] = p->box.hi[across] = p->box.end[across] = cells_round(c, x);
    return p;
}

static int ascending(const void *a, const void *b) {
    const double *p = a, *q = b;
    return (*p > *q) - (*p < *q);
}

/* Where slabs end: places along `across` where a face that runs along it is cut. at[0 .. *n]; 0 slabs: they cannot be
 * told apart, or are too many. */
static bool find_slabs(Cells *c, uint32_t i, int across, double at[SLABS + 1], uint32_t *n) {
    uint32_t first = c->ncell, count = 0;
    for (int d = 0; d < 3; d++) {
        if (d == across) continue;
        for (int far = 0; far < 2; far++) {
            const Box *box = &c->cell[i].box;
            Cell *p = add_plane(c, i, d, far ? box->hi[d] : box->lo[d], 1, -1);
            if (!p) return false;
            /* Across its height axis a curve need not be a graph: then only where it passes the face's ends is known.
             */
            for (uint32_t e = 0; e < p->nedges; e++)
                if (p->edge[e].axis == d) p->edge[e].axis = (int8_t)(3 - across - d);
        }
    }
    bool good = cells_cut_planes(c, first);
    at[count++] = c->cell[i].box.lo[across];
    bool apart = true;
    for (uint32_t k = first; k < c->ncell; k++) apart &= !c->cell[k].refine;
    for (uint32_t k = 0; k < c->ncut; k++) {
        const Cell *p = &c->cell[c->cut[k].cell];
        if (3 - p->slice - c->cut[k].axis != across) continue;
        if (count < SLABS) at[count++] = c->cut[k].at;
        else apart = false;
    }
    c->ncell = first, *n = 0;
    if (!apart) return good;
    at[count] = c->cell[i].box.end[across];
    qsort(at, count + 1, sizeof *at, ascending);
    for (uint32_t k = 1; k <= count; k++)
        if (at[k] - at[*n] > 0x1p-40 * (at[count] - at[0]) || k == count) at[++*n] = at[k];
    return good;
}

/* Of the axes the one along which there are the fewest slabs; none, where they cannot be told apart. */
static bool choose_slabs(Cells *c, uint32_t i, uint32_t axes, int *across, double at[SLABS + 1], uint32_t *slabs) {
    *slabs = 0;
    for (int d = 2; d >= 0 && *slabs != 1; d--) {
        double ends[SLABS + 1];
        uint32_t n;
        if (!(axes >> d & 1)) continue;
        if (!find_slabs(c, i, d, ends, &n)) return false;
        if (*slabs && (!n || n >= *slabs)) continue;
        if (!n) return true;
        *across = d, *slabs = n;
        memcpy(at, ends, sizeof ends);
    }
    return true;
}

static bool add_planes(Cells *c, uint32_t i, int across, const double *at, uint32_t slabs) {
    for (uint32_t s = 0; s < slabs; s++)
        for (int8_t r = 0; r < CELL_RULES; r++)
            for (uint32_t q = 0; q < c->rule[r].n; q++) {
                double width = at[s + 1] - at[s];
                if (!add_plane(c, i, across, at[s] + c->rule[r].x[q] * width, c->rule[r].w[q] * width, r)) return false;
            }
    return true;
}

/* How often the tolerance goes into what the rules make differ of the integral of |jump| over the surface of an event,
 * or of its moments in the position. */
static double surfaces_apart(const Cells *c, const Cell *cell) {
    double apart = 0;
    for (uint32_t e = 0; e < cell->nedges; e++) {
        double sum[CELL_RULES][SLT_MAX_CHANNELS][4] = {{{0}}}, most = 0, total = 0, steep = 0;
        for (int d = 0; d < 3; d++) {
            double s = 0.5 * (cell->edge[e].slope[d][0] + cell->edge[e].slope[d][1]);
            steep += s * s;
        }
        steep = sqrt(steep);
        for (uint32_t i = 0; i < c->nroot; i++) {
            const Root *r = &c->root[i];
            const Column *k = &c->column[r->column];
            if (r->edge != e || !r->wanted) continue;
            const Sides *sides = cells_sides(c, r);
            double w = k->weight * steep / fabs(r->dg[r->axis]);
            for (uint32_t ch = 0; ch < c->s->channels; ch++) {
                double jump = sides->f[1][ch] - sides->f[0][ch];
                most = fmax(most, fabs(jump)), total += w * fabs(jump);
                sum[k->rule][ch][0] += w * jump;
                for (int d = 0; d < 3; d++) {
                    double side = cell->box.end[d] - cell->box.lo[d];
                    sum[k->rule][ch][1 + d] += w * jump * (2 * (r->x[d] - cell->box.lo[d]) / side - 1);
                }
            }
        }
        double least = fmax(c->o->tolerance * most * c->width * c->width, cells_rounding(c) * total);
        for (uint32_t ch = 0; ch < c->s->channels; ch++)
            for (int m = 0; m < 4; m++) {
                double d = fabs(sum[CELL_FINE][ch][m] - sum[CELL_COARSE][ch][m]);
                if (d > least) apart = larger(d / least, apart);
            }
    }
    return apart;
}

/* Do the rules agree on the volume? How many points its columns need f tells, not the surfaces: where two fewer make no
 * difference the next cell gets fewer, and where they do this one gets all. Where that has come to an end it is asked
 * of some cells only. taken: f was, at all points. False when memory runs out. */
static bool compare_volume(Cells *c, bool *agree, bool *taken) {
    *agree = true, *taken = c->nspot && !c->unasked;
    if (!*taken) {
        c->unasked -= c->unasked > 0;
        return true;
    }
    if (!cells_take_values(c, 0)) return false;
    *agree = cells_values_agree(c, 0, c->nspot, 1);
    if (!*agree && c->tall < c->rule[CELL_FINE].n) {
        c->tallest = c->tall + 1, c->tall = c->rule[CELL_FINE].n, c->nspot = 0;
        if (!cells_add_points(c, 0) || !cells_take_values(c, 0)) return false;
        *agree = cells_values_agree(c, 0, c->nspot, 1);
    }
    if (!*agree || !c->o->fewer || !cells_values_agree(c, 0, c->nspot, CELL_FEWER)) return true;
    if (c->tall > c->tallest) c->tall = c->tall > c->tallest + 1 ? c->tall - 2 : c->tallest;
    else if (!c->o->flat) c->unasked = UNASKED;
    return true;
}

bool cells_integrate_solid(Cells *c, uint32_t i, bool may_refine, bool *done) {
    double at[SLABS + 1];
    uint32_t slabs, first = c->ncell;
    int across = -1;
    uint32_t axes;
    if (!axes_of_planes(c, &c->cell[i], &axes)) return false;
    *done = axes != 0;
    if (!*done) return true;
    if (!choose_slabs(c, i, axes, &across, at, &slabs)) return false;
    *done = slabs > 0;
    if (!*done) return true;
    if (!add_planes(c, i, across, at, slabs) || !cells_cut_bases(c, first)) return false;
    for (uint32_t k = first; k < c->ncell; k++) *done &= !c->cell[k].refine;
    bool compare = !c->o->fixed && may_refine && c->rule[CELL_COARSE].n, taken = false;
    if (*done && (!cells_evaluate(c, 0) || (c->o->volume && !cells_add_points(c, 0)))) return false;
    if (*done && compare) {
        double apart = surfaces_apart(c, &c->cell[i]);
        *done = !(apart > 1);
        if (*done && !compare_volume(c, done, &taken)) return false;
        c->cell[i].apart = *done ? 0 : larger(apart, 1); /* its volume may be cut all the same */
    }
    if (*done) {
        if (!cells_emit_columns(c, c->column, c->column + c->ncolumn)) return false;
        cells_emit_spots(c, 0, c->nspot, taken);
        for (uint32_t k = 0; k < c->npiece; k++) cells_add_upset(c, &c->piece[k], &c->cell[i]);
    }
    c->ncell = first;
    return true;
}
