/* Seams that move with a parameter, at which f may jump, by itself or by a tagged decision that changes though its g
 * does not cross 0 (SltScene.edge_upsets): along a curve that nothing integrates. On a piece of a curve nothing else
 * that decides changes, so its middle tells of all of it; where cells are cut at a straight seam a few places do. */
#include <math.h>
#include <string.h>

#include "runtime/quadrature/cells_inner.h"

#define STEEP 64 /* times its mean slope: f may climb so along a gap and not jump */
#define BESIDE 4

bool cells_upsets(const Cells *c, int32_t edge) {
    if ((uint32_t)edge >= c->s->nedges) return false; /* a choice of a straight-line program: it tells nothing of f */
    return c->o->seams && c->s->edge_upsets[edge] != SLT_UPSETS_NOTHING;
}

/* Does f jump between the two sides, which are `apart` on that axis? By more than floats so near to each other differ
 * anyway: of f, and where no hash tells, of what f changes by in the cell and along the gap. */
static bool jumps(const Cells *c, const Cell *cell, int32_t edge, const Sides *s, int axis, double apart) {
    double slack = c->b->f64 ? 0x1p-30 : 0x1p-12, size = cell->box.end[axis] - cell->box.lo[axis];
    bool unseen = c->s->edge_upsets[edge] == SLT_UPSETS_UNSEEN && s->hash[0] == s->hash[1], any = false;
    if (c->s->edge_upsets[edge] != SLT_UPSETS_UNSEEN && s->hash[0] == s->hash[1]) return false;
    for (uint32_t ch = 0; ch < c->s->channels; ch++) {
        double p = s->f[0][ch], q = s->f[1][ch], least = slack * (fabs(p) + fabs(q));
        double range = cell->f[2 * ch + 1] - cell->f[2 * ch];
        if (unseen && isfinite(range)) least = fmax(least, range * (slack + STEEP * apart / size));
        any |= !(fabs(p - q) <= least); /* NaN is one */
    }
    return any;
}

/* Of what two sides differ by: is it no more than f changes by beside them, on BESIDE times their distance? */
static bool is_slope(Cells *c, const Root *r, const Sides *s) {
    double change[SLT_MAX_CHANNELS] = {0}, x[3];
    memcpy(x, r->x, sizeof x);
    for (uint32_t i = 0; i < 2; i++) {
        double to = s->at[i] + BESIDE * (s->at[i] - s->at[!i]);
        x[r->axis] = cells_round(c, fmin(fmax(to, c->lo[r->axis]), c->hi[r->axis]));
        batch_set_x(c->b, i, x);
    }
    cells_call(c, SLT_K_SIDES, 2);
    bool slope = true;
    for (uint32_t ch = 0; ch < c->s->channels; ch++) {
        for (uint32_t i = 0; i < 2; i++) change[ch] += fabs(batch_get(c->b, SLT_OUT_F, ch, i) - s->f[i][ch]);
        slope &= fabs(s->f[0][ch] - s->f[1][ch]) <= change[ch];
    }
    return slope;
}

bool cells_is_upset(Cells *c, const Root *r) {
    if (!cells_upsets(c, r->of->event.site) || r->twin) return false;
    const Cell *cell = &c->cell[c->piece[c->column[r->column].piece].cell];
    const Sides *s = cells_sides(c, r);
    if (!jumps(c, cell, r->of->event.site, s, r->axis, fabs(s->at[1] - s->at[0]))) return false;
    return s->hash[0] != s->hash[1] || !is_slope(c, r, s);
}

/* size: of the curve or surface. */
static void add(Cells *c, Cell *cell, int32_t edge, const Sides *s, double size) {
    CellCounts *n = c->counts;
    double part = 1;
    for (uint32_t d = 0; d < c->dim; d++) part *= (cell->box.end[d] - cell->box.lo[d]) / (c->hi[d] - c->lo[d]);
    if (!cell->upset) n->upset += part;
    cell->upset = true;
    for (uint32_t ch = 0; ch < c->s->channels; ch++) {
        double jump = fabs(s->f[1][ch] - s->f[0][ch]);
        n->upset_jump[ch] += isfinite(jump) ? jump * size : HUGE_VAL;
    }
    if (!n->upset_edge || (uint32_t)edge + 1 < n->upset_edge) n->upset_edge = (uint32_t)edge + 1;
}

void cells_add_upset(Cells *c, const Piece *p, Cell *owner) {
    const Cell *cell = &c->cell[p->cell];
    if (!c->s->edge_upsets || cell->rule == CELL_COARSE) return;
    for (uint32_t set = p->present, e; cells_take_edge(&set, &e);) {
        const PieceEdge *edge = &p->edge[e];
        if (!edge->upset) continue;
        double size = cell->weight * (p->base < 0 ? 1 : p->at[p->base][1] - p->at[p->base][0]), steep = 0;
        for (uint32_t d = 0; d < c->dim; d++) steep += edge->dg[d] * edge->dg[d];
        add(c, owner ? owner : &c->cell[p->cell], cell->edge[e].event.site, &c->sides[edge->sides - 1],
            size * sqrt(steep) / fabs(edge->dg[p->axis]));
    }
}

/* Places of a face, off the dyadic ones. */
static uint32_t face_places(const Cells *c, const Cell *cell, int axis, double x[][3]) {
    enum { LINE = 8, SIDE = 4 };
    uint32_t n[3] = {1, 1, 1}, count = 0;
    for (uint32_t d = 0; d < c->dim; d++) n[d] = (int)d == axis ? 1 : c->dim == 2 ? LINE : SIDE;
    for (uint32_t k = 0; k < n[2]; k++)
        for (uint32_t j = 0; j < n[1]; j++)
            for (uint32_t i = 0; i < n[0]; i++) {
                const uint32_t at[3] = {i, j, k};
                for (uint32_t d = 0; d < 3; d++)
                    x[count][d] = d >= c->dim
                                      ? 0
                                      : cells_round(c, cell->box.lo[d] + (at[d] + 0.4873) / n[d] *
                                                                             (cell->box.hi[d] - cell->box.lo[d]));
                count++;
            }
    return count;
}

enum { PLACES = 16 };

/* Is g as near to 0 as the other side of the gap is? */
static bool is_near_zero(const Ask *a, int axis, double gap) {
    double steep = fmax(fabs(a->slope[axis][0]), fabs(a->slope[axis][1]));
    return !(a->state & SLT_EDGE_JUMPS) && fmax(-a->g[0], a->g[1]) <= BESIDE * (a->error + steep * gap);
}

/* Of places on a cut at which sites decide otherwise on both sides: where the g of one crosses 0 in between, and does
 * not jump over it, as that of a box's outline on the line that says whether its corner counts, its curve lies in the
 * gap and is integrated there. */
static bool drop_crossings(Cells *c, const Cell *cell, const Root *r, double x[][3], uint32_t n, bool *upset) {
    c->nask = 0;
    uint32_t nsites = 0;
    for (uint32_t e = 0; e < cell->nedges; e++) {
        if ((uint32_t)cell->edge[e].event.site >= c->s->nsites) continue;
        nsites++;
        for (uint32_t i = 0; i < n; i++)
            for (uint32_t s = 0; s < 2; s++) {
                x[i][r->axis] = s ? r->hi : r->lo;
                if (!cells_ask(c, &cell->edge[e], x[i], x[i])) return false;
            }
    }
    if (!nsites) return true;
    if (!cells_run_asks(c)) return false;
    for (uint32_t k = 0; k < nsites * n; k++) {
        const Ask *near = &c->ask[2 * k], *far = near + 1;
        bool crosses = (near->g[0] <= 0 && far->g[1] >= 0) || (near->g[1] >= 0 && far->g[0] <= 0);
        double gap = r->hi - r->lo;
        if (crosses && is_near_zero(near, r->axis, gap) && is_near_zero(far, r->axis, gap)) upset[k % n] = false;
    }
    return true;
}

bool cells_check_cut(Cells *c, Cell *cell, const Root *r) {
    if (cell->curves_done || !cells_upsets(c, r->of->event.site) || !(r->lo < r->hi)) return true;
    double x[PLACES][3], area = 1;
    Sides sides[PLACES];
    bool upset[PLACES], otherwise[PLACES], any = false;
    uint32_t n = face_places(c, cell, r->axis, x);
    Batch *b = c->b;
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t s = 0; s < 2; s++) x[i][r->axis] = s ? r->hi : r->lo, batch_set_x(b, 2 * i + s, x[i]);
    cells_call(c, SLT_K_SIDES, 2 * n);
    for (uint32_t d = 0; d < c->dim; d++) area *= (int)d == r->axis ? 1 : cell->box.end[d] - cell->box.lo[d];
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t s = 0; s < 2; s++) {
            sides[i].hash[s] = (uint32_t)batch_get_int(b, SLT_OUT_HASH, 0, 2 * i + s);
            for (uint32_t ch = 0; ch < c->s->channels; ch++) sides[i].f[s][ch] = batch_get(b, SLT_OUT_F, ch, 2 * i + s);
        }
        upset[i] = jumps(c, cell, r->of->event.site, &sides[i], r->axis, r->hi - r->lo);
        otherwise[i] = upset[i] && sides[i].hash[0] != sides[i].hash[1];
        any |= otherwise[i];
    }
    bool crossing[PLACES];
    memcpy(crossing, otherwise, sizeof crossing);
    if (any && !drop_crossings(c, cell, r, x, n, crossing)) return false;
    for (uint32_t i = 0; i < n; i++)
        if (upset[i] && (!otherwise[i] || crossing[i])) add(c, cell, r->of->event.site, &sides[i], area / n);
    return true;
}
