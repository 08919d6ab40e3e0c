/* Points of the volume: between the roots of columns, and in boxes on which f is smooth. Where the two rules differ the
 * part is halved. */
#include <math.h>
#include <string.h>

#include "runtime/quadrature/cells_inner.h"

enum { BOX_HALVINGS = 36 }; /* of a smooth box, along one axis at a time */

/* ---- what goes out */
static void flush_points(Cells *c, CellRule r) {
    uint32_t n = c->npoint[r];
    c->npoint[r] = 0;
    if (n) c->sink->volume(c->sink->user, c->point[r], n, r, &c->within);
}

static void emit_parts(Cells *c, const double x[3], double fine, double coarse, double moved, double size);

void cells_flush_points(Cells *c) {
    for (int i = 0; i < CELL_SHAPES; i++) {
        Shape *s = &c->shape[i];
        if (s->used) emit_parts(c, s->x, s->fine, s->coarse, s->moved, s->size);
        s->used = false;
    }
    for (int r = 0; r < CELL_POINTS; r++) flush_points(c, (CellRule)r);
}

static void emit_moved(Cells *c, const double x[3], double weight, double moved, CellRule rule) {
    if (c->npoint[rule] == BATCH) flush_points(c, rule);
    CellPoint *p = &c->point[rule][c->npoint[rule]++];
    memcpy(p->x, x, sizeof p->x);
    p->weight = weight, p->moved = moved;
}

static void emit(Cells *c, const double x[3], double weight, CellRule rule) { emit_moved(c, x, weight, 0, rule); }

/* A number that is none is counted where points go through kernels. */
static bool is_finite(const Cells *c, const double *f) {
    bool finite = true;
    for (uint32_t ch = 0; ch < c->s->channels; ch++) finite &= isfinite(f[ch]) != 0;
    return finite;
}

void cells_emit_spots(Cells *c, uint32_t from, uint32_t to, bool taken) {
    for (uint32_t i = from; i < to; i++) { /* there may be none, and no memory for them */
        const Spot *s = &c->spot[i];
        if (taken && c->sink->value && is_finite(c, s->f))
            c->sink->value(c->sink->user, s->weight, s->f, (CellRule)s->rule);
        else emit_moved(c, s->x, s->weight, s->moved, (CellRule)s->rule);
    }
}

void cells_emit_middle(Cells *c, const double lo[3], const double end[3]) {
    double x[3] = {0}, weight = 1;
    for (uint32_t d = 0; d < c->dim; d++)
        x[d] = cells_round(c, lo[d] + 0.5 * (end[d] - lo[d])), weight *= end[d] - lo[d];
    if (c->o->flat && c->rule[CELL_COARSE].n) emit(c, x, weight, CELL_BOTH);
    for (int r = 0; r < CELL_RULES && !(c->o->flat && c->rule[CELL_COARSE].n); r++)
        if (c->rule[r].n) emit(c, x, weight, (CellRule)r);
}

/* Of one piece, CellOptions.flat, part by part: the spots of the two rules, ascending; NULL: of that rule it has none.
 */
typedef struct PartSpots {
    const Spot *fine, *coarse;                    /* of the part */
    const Spot *at[CELL_RULES], *end[CELL_RULES]; /* what comes then */
} PartSpots;

static PartSpots parts_of(const Cells *c, uint32_t from, uint32_t to) {
    if (from == to) return (PartSpots){0}; /* there may be no list */
    uint32_t coarse = from;
    while (coarse < to && c->spot[coarse].rule == CELL_FINE) coarse++;
    const Spot *s = c->spot;
    return (PartSpots){.at = {s + from, s + coarse}, .end = {s + coarse, s + to}};
}

static bool next_part(PartSpots *p) {
    p->fine = p->at[CELL_FINE] < p->end[CELL_FINE] ? p->at[CELL_FINE] : NULL;
    p->coarse = p->at[CELL_COARSE] < p->end[CELL_COARSE] ? p->at[CELL_COARSE] : NULL;
    if (p->fine && p->coarse && p->fine->part > p->coarse->part) p->fine = NULL;
    if (p->fine && p->coarse && p->fine->part < p->coarse->part) p->coarse = NULL;
    if (p->fine) p->at[CELL_FINE]++;
    if (p->coarse) p->at[CELL_COARSE]++;
    return p->fine || p->coarse;
}

double cells_part_noise(const Cells *c, double size) { return larger(c->b->f64 ? 0x1p-50 : 0x1p-21, c->slack) * size; }

/* Measures by the two rules: what both make equal goes out once, and else what the coarse one has more or less. */
static void emit_parts(Cells *c, const double x[3], double fine, double coarse, double moved, double size) {
    double noise = cells_part_noise(c, size);
    bool both = c->rule[CELL_COARSE].n > 0, same = fabs(coarse - fine) <= noise && fabs(moved) <= noise;
    if (fine != 0) emit(c, x, fine, both ? CELL_BOTH : CELL_FINE);
    if (both && !same) emit_moved(c, x, coarse - fine, moved, CELL_COARSE);
}

/* Those with the same hash, of a cell or of many, are parts of one shape: one point does for all. */
void cells_add_shape(Cells *c, uint32_t hash, const double x[3], const double area[CELL_RULES], double moved,
                     double size) {
    Shape *s = &c->shape[hash % CELL_SHAPES];
    if (s->used && s->hash != hash) {
        emit_parts(c, s->x, s->fine, s->coarse, s->moved, s->size);
        s->used = false;
    }
    if (!s->used) {
        *s = (Shape){.used = true, .hash = hash};
        memcpy(s->x, x, sizeof s->x);
    }
    s->fine += area[CELL_FINE], s->coarse += area[CELL_COARSE], s->moved += moved, s->size += size;
}

/* Parts of one piece; of an image each pixel has its own. */
void cells_emit_parts(Cells *c, uint32_t from, uint32_t to) {
    PartSpots p = parts_of(c, from, to);
    while (next_part(&p)) {
        const Spot *spot = p.fine ? p.fine : p.coarse;
        const double area[CELL_RULES] = {p.fine ? p.fine->weight : 0, p.coarse ? p.coarse->weight : 0};
        double moved = p.coarse ? p.coarse->moved : 0;
        if (!spot->hashed || c->o->grid[0] > 0) {
            emit_parts(c, spot->x, area[CELL_FINE], area[CELL_COARSE], moved, area[CELL_FINE]);
            continue;
        }
        cells_add_shape(c, spot->hash, spot->x, area, moved, area[CELL_FINE]);
    }
}

void cells_emit_few(Cells *c, const Box *cell) {
    double x[CELL_RULES][2][3] = {{{0}}}, weight = 1;
    for (uint32_t d = 0; d < c->dim; d++) {
        double lo = cell->lo[d], width = cell->end[d] - lo;
        weight *= width;
        for (int i = 0; i < 2; i++) {
            x[CELL_FINE][i][d] = smaller(cells_round(c, lo + 0.5 * width), cell->hi[d]);
            x[CELL_COARSE][i][d] = smaller(cells_round(c, lo + (0.25 + 0.5 * i) * width), cell->hi[d]);
        }
    }
    if (c->rule[CELL_FINE].n) emit(c, x[CELL_FINE][0], weight, CELL_FINE);
    for (int i = 0; i < 2 && c->rule[CELL_COARSE].n; i++) emit(c, x[CELL_COARSE][i], 0.5 * weight, CELL_COARSE);
}

/* ---- spots */
static bool add_spot(Cells *c, uint32_t owner, const double x[3], double weight, uint8_t rule) {
    if (!CELLS_ROOM(c, spot, 1)) return false;
    Spot *s = &c->spot[c->nspot++];
    s->owner = owner, s->rule = rule, s->part = 0, s->hashed = false, s->weight = weight,
    s->moved = 0; /* and f comes later */
    for (uint32_t d = 0; d < 3; d++) s->x[d] = d < c->dim ? cells_round(c, x[d]) : 0;
    return true;
}

/* The rule along a part of the volume of that length: of n points it errs by (length / scale)^2n, and the scale on
 * which f varies is taken for half the domain. Where it is shorter the two rules differ, and the part is halved. */
static const GaussRule *rule_along(const Cells *c, CellRule r, double length, uint32_t most) {
    const GaussRule *full = &c->rule[r];
    int bits = c->o->fixed || !full->n ? 0 : ilogb(length / (0.5 * c->width)) + 1;
    double n = bits < 0 ? 1 + ceil(c->bits / (2.0 * bits)) : most; /* of no length: bits is the least of its type */
    uint32_t points = n < 2 ? 2 : n < most ? (uint32_t)n : most;
    points -= r == CELL_COARSE && points > 1;
    return points < full->n ? &c->of[points] : full;
}

uint32_t cells_part_ends(const Cells *c, const Column *k, double heights[CELL_EDGES + 1]) {
    const Piece *p = &c->piece[k->piece];
    uint32_t n = 0;
    for (uint32_t i = 0; i < k->nroots; i++) {
        double h = c->root[k->first + i].x[p->axis];
        uint32_t at = n++;
        for (; at && heights[at - 1] > h; at--) heights[at] = heights[at - 1];
        heights[at] = h;
    }
    heights[n++] = c->cell[p->cell].box.end[p->axis];
    return n;
}

/* On a column, between one root and the next. depth[part]: most points there; NULL: as many as its length asks for.
 * Sets Piece.capped and Piece.depth. */
static bool fill_column(Cells *c, const Column *k, CellRule rule, const uint32_t *depth) {
    Piece *p = &c->piece[k->piece];
    double x[3], from = c->cell[p->cell].box.lo[p->axis], heights[CELL_EDGES + 1], longer[CELL_EDGES + 1];
    uint32_t n = cells_part_ends(c, k, heights), most = c->cell[p->cell].slice < 0 ? c->rule[CELL_FINE].n : c->tall;
    memcpy(x, k->x, sizeof x);
    cells_moved_parts(c, k, longer);
    for (uint32_t i = 0; i < n; from = heights[i++]) {
        const GaussRule *g = p->graded ? &c->rule[rule] : rule_along(c, rule, heights[i] - from, most);
        if (depth && g->n > depth[i] - (rule == CELL_COARSE))
            g = &c->of[depth[i] - (rule == CELL_COARSE)], p->capped |= cells_part_bit(i);
        if (g->n > p->depth) p->depth = (uint8_t)g->n;
        for (uint32_t q = 0; q < g->n * p->parts && heights[i] > from; q++) {
            double begin = cells_part_begins(p, q / g->n), length = cells_part_begins(p, q / g->n + 1) - begin;
            double t = begin + g->x[q % g->n] * length, w = g->w[q % g->n] * length;
            if (p->graded) w *= 6 * t * (1 - t), t = t * t * (3 - 2 * t);
            x[p->axis] = from + t * (heights[i] - from);
            if (!add_spot(c, k->piece, x, k->weight * w * (heights[i] - from), (uint8_t)rule)) return false;
            c->spot[c->nspot - 1].part = (uint8_t)i;
            if (rule == CELL_COARSE) c->spot[c->nspot - 1].moved = k->weight * w * longer[i];
        }
    }
    return true;
}

void cells_part_hashes(const Cells *c, const Column *k, bool *known, uint32_t *hash) {
    const Piece *p = &c->piece[k->piece];
    if (!k->nroots) return; /* then there may be no list */
    const Root *root = &c->root[k->first];
    for (uint32_t i = 0; i < k->nroots; i++) {
        const PieceEdge *e = &p->edge[root[i].edge];
        double at = root[i].x[p->axis];
        uint32_t below = 0; /* the part that ends at the root */
        if (!e->open || !e->sides || e->twin || e->band || e->tie) continue;
        for (uint32_t j = 0; j < k->nroots; j++) {
            double other = root[j].x[p->axis];
            below += other < at || (other == at && j < i);
        }
        const Sides *s = &c->sides[e->sides - 1];
        known[below] = known[below + 1] = true, hash[below] = s->hash[0], hash[below + 1] = s->hash[1];
    }
}

/* f is constant in each part between two curves: of all columns of a piece and rule one point, in the longest of them.
 */
static bool fill_parts(Cells *c, const Column *from, const Column *to) {
    const Piece *p = &c->piece[from->piece];
    double weight[CELL_EDGES + 1], longest[CELL_EDGES + 1], moved[CELL_EDGES + 1], x[CELL_EDGES + 1][3];
    uint32_t n = from->nroots + 1; /* as of all its columns */
    bool known[CELL_EDGES + 1] = {false};
    uint32_t hash[CELL_EDGES + 1] = {0};
    cells_part_hashes(c, from, known, hash);
    for (uint32_t i = 0; i < n; i++) weight[i] = longest[i] = moved[i] = 0;
    for (const Column *k = from; k < to; k++) {
        double heights[CELL_EDGES + 1], longer[CELL_EDGES + 1], last = c->cell[p->cell].box.lo[p->axis];
        cells_part_ends(c, k, heights), cells_moved_parts(c, k, longer);
        for (uint32_t i = 0; i < n; last = heights[i++]) {
            double length = heights[i] - last;
            if (from->rule == CELL_COARSE) moved[i] += k->weight * longer[i];
            if (!(length > 0)) continue;
            weight[i] += k->weight * length;
            if (length <= longest[i]) continue;
            longest[i] = length;
            memcpy(x[i], k->x, sizeof x[i]);
            x[i][p->axis] = last + 0.5 * length;
        }
    }
    for (uint32_t i = 0; i < n; i++) {
        if (!(weight[i] > 0)) continue;
        if (!add_spot(c, from->piece, x[i], weight[i], from->rule)) return false;
        Spot *s = &c->spot[c->nspot - 1];
        s->moved = moved[i], s->part = (uint8_t)i, s->hashed = known[i] && c->s->told, s->hash = hash[i];
    }
    return true;
}

bool cells_parts_agree(const Cells *c, uint32_t from, uint32_t to) {
    double apart = 0, total = 0;
    PartSpots p = parts_of(c, from, to);
    while (next_part(&p)) {
        double fine = p.fine ? p.fine->weight : 0, coarse = p.coarse ? p.coarse->weight : 0;
        apart += fabs(fine - coarse), total += fine + coarse;
    }
    return apart <= larger(c->o->tolerance * c->volume, cells_part_noise(c, total));
}

bool cells_fill_piece(Cells *c, uint32_t i, Column *from, Column *to, const uint32_t *depth) {
    Piece *p = &c->piece[i];
    p->spots[0] = p->spots[1] = c->nspot, p->capped = p->depth = 0;
    if (from == to || !c->cell[p->cell].common || p->alone) return true;
    for (Column *k = from, *end; k < to; k = end) {
        end = k + 1, k->spots[0] = c->nspot;
        while (c->o->flat && end < to && k->rule == end->rule) end++;
        if (!(c->o->flat ? fill_parts(c, k, end) : fill_column(c, k, (CellRule)k->rule, depth))) return false;
        k->spots[1] = c->nspot;
    }
    p->spots[1] = c->nspot;
    return true;
}

bool cells_add_points(Cells *c, uint32_t first) {
    for (uint32_t i = first; i < c->npiece; i++) {
        const uint32_t *column = c->first_column + (i - first);
        if (!cells_fill_piece(c, i, c->column + column[0], c->column + column[1], NULL)) return false;
    }
    return true;
}

/* ---- singular rims */
enum { BESIDE = 3 };
#define SMALL_POWER 0.4
#define SEAM_POWER 0.46 /* roots are exact */

/* The fine places of a column next to a root, on one side of it and short of the next: how far they are and which.
 * False: there are too few. */
static bool places_beside(const Cells *c, const Column *k, const Root *r, int up, uint32_t from, uint32_t to,
                          double away[BESIDE], const Spot *spot[BESIDE]) {
    double end = HUGE_VAL;
    uint32_t n = 0;
    for (uint32_t i = 0; i < k->nroots; i++) {
        double d = up * (c->root[k->first + i].x[r->axis] - r->x[r->axis]);
        if (d > 0) end = smaller(end, d);
    }
    for (uint32_t q = from; q < to; q++) {
        const Spot *s = &c->spot[q];
        double d = up * (s->x[r->axis] - r->x[r->axis]);
        bool here = s->rule == CELL_FINE && d > 0 && d < end;
        for (uint32_t b = 0; b < c->dim; b++) here &= (int)b == r->axis || s->x[b] == k->x[b];
        if (!here || (n == BESIDE && d >= away[n - 1])) continue;
        uint32_t at = n < BESIDE ? n++ : n - 1;
        for (; at && away[at - 1] > d; at--) away[at] = away[at - 1], spot[at] = spot[at - 1];
        away[at] = d, spot[at] = s;
    }
    return n == BESIDE;
}

/* What f changes by between the root and the nearest place, if it does so as a small power of the distance. */
static double rim(const Cells *c, const Root *r, int up, const double away[BESIDE], const Spot *const spot[BESIDE],
                  uint32_t ch) {
    double v[BESIDE], at_root = cells_sides(c, r)->f[up > 0][ch];
    for (uint32_t i = 0; i < BESIDE; i++) v[i] = spot[i]->f[ch] - at_root;
    for (uint32_t i = 0; i + 1 < BESIDE; i++)
        if (!(v[i] / v[i + 1] > pow(away[i] / away[i + 1], SMALL_POWER))) return 0;
    return fabs(v[0]);
}

/* The same beside a seam, where f is continuous and nobody has asked for it: by which power of the distance the last
 * three places change tells what is left. */
static double seam_rim(const double away[BESIDE], const Spot *const spot[BESIDE], uint32_t ch) {
    double near = spot[1]->f[ch] - spot[0]->f[ch], far = spot[2]->f[ch] - spot[1]->f[ch], ratio = far / near;
    double power = SEAM_POWER, p[BESIDE];
    for (uint32_t halving = 0; halving < 5; halving++, power *= 0.5) {
        for (uint32_t i = 0; i < BESIDE; i++) p[i] = pow(away[i], power);
        if (!(ratio > 0) || !(ratio < (p[2] - p[1]) / (p[1] - p[0]))) return 0;
        double left = fabs(near) * p[0] / (p[1] - p[0]);
        for (uint32_t i = 0; i < BESIDE; i++) p[i] = pow(away[i], 0.5 * power);
        if (ratio > (p[2] - p[1]) / (p[1] - p[0])) return left;
    }
    return fabs(near) * p[0] / (p[1] - p[0]);
}

static void doubt_seam(Cells *c, const Column *k, const Root *r, uint32_t first, uint32_t last) {
    double away[BESIDE], steep = 0;
    const Spot *spot[BESIDE];
    for (uint32_t d = 0; d < c->dim; d++) steep += r->dg[d] * r->dg[d];
    double length = k->weight * sqrt(steep) / fabs(r->dg[r->axis]);
    for (int up = -1; up < 2; up += 2) {
        if (!places_beside(c, k, r, up, first, last, away, spot)) continue;
        for (uint32_t ch = 0; ch < c->s->channels; ch++) c->counts->rims[ch] += length * seam_rim(away, spot, ch);
    }
}

void cells_doubt_rims(Cells *c, const Column *from, const Column *to, uint32_t first, uint32_t last) {
    for (const Column *k = from; k < to && c->rule[CELL_COARSE].n; k++)
        for (uint32_t i = 0; i < k->nroots && k->rule == CELL_FINE; i++) {
            const Root *r = &c->root[k->first + i];
            double doubt[SLT_MAX_CHANNELS] = {0}, any = 0, away[BESIDE];
            const Spot *spot[BESIDE];
            if (r->tie || r->band) continue;
            if ((uint32_t)r->of->event.site >= c->s->nsites) doubt_seam(c, k, r, first, last);
            if (!r->wanted || !r->sides) continue;
            for (int up = -1; up < 2; up += 2) {
                if (!places_beside(c, k, r, up, first, last, away, spot)) continue;
                for (uint32_t ch = 0; ch < c->s->channels; ch++)
                    doubt[ch] += rim(c, r, up, away, spot, ch), any += doubt[ch];
            }
            if (!(any > 0)) continue;
            Crossing *x = cells_add_crossing(c, CELL_COARSE);
            cells_crossing(c, r, x);
            x->weight = k->weight / fabs(r->dg[r->axis]);
            memcpy(x->jump, doubt, c->s->channels * sizeof *doubt);
        }
}

/* A program without edges has no `sides`. */
bool cells_take_values(Cells *c, uint32_t first) {
    SltKernelKind kind = c->s->kernel[SLT_K_SIDES] ? SLT_K_SIDES : SLT_K_VALUE;
    for (uint32_t from = first; from < c->nspot; from += BATCH) {
        uint32_t n = c->nspot - from < BATCH ? c->nspot - from : BATCH;
        for (uint32_t i = 0; i < n; i++) batch_set_x(c->b, i, c->spot[from + i].x);
        cells_call(c, kind, n);
        for (uint32_t ch = 0; ch < c->s->channels; ch++)
            for (uint32_t i = 0; i < n; i++) c->spot[from + i].f[ch] = batch_get(c->b, SLT_OUT_F, ch, i);
    }
    return true;
}

bool cells_columns_differ(Cells *c, const Column *from, const Column *to, bool *differ) {
    uint32_t first = c->nspot;
    for (const Column *k = from; k < to; k++)
        for (int r = 0; k->rule == CELL_FINE && r < CELL_RULES; r++)
            if (!fill_column(c, k, (CellRule)r, NULL)) return false;
    if (!cells_take_values(c, first)) return false;
    *differ = !cells_values_agree(c, first, c->nspot, 1);
    c->nspot = first;
    return true;
}

/* By how much f differs at spots, in the channel where it does most. */
static double range_of(const Cells *c, uint32_t from, uint32_t to) {
    double most = 0;
    for (uint32_t ch = 0; ch < c->s->channels; ch++) {
        double low = HUGE_VAL, high = -HUGE_VAL;
        for (uint32_t i = from; i < to; i++)
            low = smaller(low, c->spot[i].f[ch]), high = larger(high, c->spot[i].f[ch]);
        most = larger(most, high - low);
    }
    return most;
}

/* Compares the integral of each channel and its moments in the position. Less than the rounding of f and, in moments,
 * of positions makes, in f too, is no difference. */
bool cells_values_agree(Cells *c, uint32_t from, uint32_t to, double part) {
    double sum[CELL_RULES][SLT_MAX_CHANNELS][4], most = 0, total = 0, side = c->width, measure = 0, far = 0, lo[3],
                                                 hi[3];
    for (int r = 0; r < CELL_RULES; r++) memset(sum[r], 0, c->s->channels * sizeof *sum[r]);
    for (int d = 0; d < 3; d++) lo[d] = HUGE_VAL, hi[d] = -HUGE_VAL;
    for (uint32_t i = from; i < to; i++)
        for (uint32_t d = 0; d < c->dim; d++)
            lo[d] = smaller(lo[d], c->spot[i].x[d]), hi[d] = larger(hi[d], c->spot[i].x[d]);
    for (uint32_t i = from; i < to; i++) {
        const Spot *s = &c->spot[i];
        measure += 0.5 * s->weight; /* of two rules */
        for (uint32_t ch = 0; ch < c->s->channels; ch++) {
            double v = s->weight * s->f[ch];
            most = larger(most, fabs(s->f[ch])), total += fabs(v);
            sum[s->rule][ch][0] += v;
            for (uint32_t d = 0; d < c->dim; d++)
                if (hi[d] > lo[d]) sum[s->rule][ch][1 + d] += v * (2 * (s->x[d] - lo[d]) / (hi[d] - lo[d]) - 1);
        }
    }
    for (uint32_t d = 0; d < c->dim; d++)
        far = larger(far, larger(fabs(lo[d]), fabs(hi[d]))), side = hi[d] > lo[d] ? smaller(side, hi[d] - lo[d]) : side;
    double blur = range_of(c, from, to) / side * measure * far;
    /* Where f fades away next to where it is large, the tail need not be known as well as that. */
    c->most = most = larger(c->most, most);
    double unit = c->b->f64 ? 0x1p-51 : 0x1p-22;
    for (uint32_t m = 0; m <= (c->o->flat ? 0 : c->dim); m++) { /* a place for all of a part has no moments */
        double noise = unit * larger(total, blur);
        if (m && hi[m - 1] > lo[m - 1]) noise *= 1 + larger(fabs(lo[m - 1]), fabs(hi[m - 1])) / (hi[m - 1] - lo[m - 1]);
        double most_apart = larger(c->o->tolerance * part * most * c->volume, noise);
        for (uint32_t ch = 0; ch < c->s->channels; ch++)
            if (fabs(sum[CELL_FINE][ch][m] - sum[CELL_COARSE][ch][m]) > most_apart) return false;
    }
    return true;
}

/* ---- smooth boxes */
bool cells_settle_box(Cells *c, const Cell *cell, const double lo[3], const double end[3]) {
    if (!CELLS_ROOM(c, smooth, 1)) return false;
    Smooth *s = &c->smooth[c->nsmooth++];
    s->halvings = 0, s->hunted = s->steep = s->all = s->again = false;
    for (uint32_t d = 0; d < 3; d++) s->hi[d] = smaller(end[d], cell->box.hi[d]);
    memcpy(s->f, cell->f, 2 * c->s->channels * sizeof *s->f);
    memcpy(s->lo, lo, sizeof s->lo), memcpy(s->end, end, sizeof s->end);
    return true;
}

/* How often each side was halved, because f varies faster than that: its parts need as many points as it had. */
static double halved(const Cells *c, const Smooth *s) { return ldexp(1, (int)(s->halvings / c->dim)); }

#define CLIMBS 0x1p-6 /* of the largest f */

static double shortest(const Cells *c, const Smooth *s) {
    double side = HUGE_VAL;
    for (uint32_t d = 0; d < c->dim; d++) side = smaller(side, s->end[d] - s->lo[d]);
    return side;
}

/* Points of the tensor rule. */
static bool fill_box(Cells *c, uint32_t owner, uint8_t rule) {
    const Smooth *s = &c->smooth[owner];
    const GaussRule *r[3] = {NULL};
    uint32_t n[3] = {1, 1, 1}, most = s->all ? c->rule[CELL_FINE].n : c->broad;
    if (!c->rule[rule].n) return true;
    for (uint32_t d = 0; d < c->dim; d++)
        r[d] = rule_along(c, (CellRule)rule, halved(c, s) * (s->end[d] - s->lo[d]), most), n[d] = r[d]->n;
    for (uint32_t z = 0; z < n[2]; z++)
        for (uint32_t y = 0; y < n[1]; y++)
            for (uint32_t i = 0; i < n[0]; i++) {
                const uint32_t at[3] = {i, y, z};
                double x[3] = {0}, weight = 1;
                for (uint32_t d = 0; d < c->dim; d++) {
                    x[d] = s->lo[d] + r[d]->x[at[d]] * (s->end[d] - s->lo[d]);
                    weight *= r[d]->w[at[d]] * (s->end[d] - s->lo[d]);
                }
                if (!add_spot(c, owner, x, weight, rule)) return false;
            }
    return true;
}

/* In the middle of its longest side; of one that may hide something where that takes most from its bounds. */
static bool halve_box(Cells *c, const Smooth *s) {
    double f[2][2 * SLT_MAX_CHANNELS];
    uint32_t axis = 0;
    for (uint32_t d = 1; d < c->dim; d++)
        if (s->end[d] - s->lo[d] > s->end[axis] - s->lo[axis]) axis = d;
    if (s->hunted) axis = cells_hunt(c, s, f);
    for (int half = 0; half < 2; half++) {
        if (!CELLS_ROOM(c, smooth, 1)) return false;
        Smooth *h = &c->smooth[c->nsmooth++];
        *h = *s;
        double middle = 0.5 * (s->lo[axis] + s->end[axis]);
        if (half) h->lo[axis] = middle;
        else h->end[axis] = middle, h->hi[axis] = cells_round(c, middle);
        if (s->hunted) memcpy(h->f, f[half], 2 * c->s->channels * sizeof *f[half]);
        h->halvings++, h->all = true, h->steep |= s->hunted, h->hunted = false;
    }
    return true;
}

/* How many points boxes need, if f is as it is in this one, whose spots these are. True: this one needs more. */
static bool choose_points(Cells *c, const Smooth *s, uint32_t from, uint32_t to, bool same, uint32_t points) {
    const uint32_t full = c->rule[CELL_FINE].n;
    if (!c->o->fewer) return false;
    if (!same) c->broad = full, c->broadest = points < full ? points + 1 : full;
    else if (points > c->broadest && c->broad == points && cells_values_agree(c, from, to, CELL_FEWER))
        c->broad = points > c->broadest + 1 ? points - 2 : c->broadest;
    return points < full && (!same || cells_doubts(c, s, c->spot + from, c->spot + to));
}

static bool integrate_last(Cells *c, uint32_t first) {
    uint32_t n = c->nsmooth, at = 0, kept = first;
    const uint32_t points = c->broad;
    bool compare = !c->o->fixed && c->rule[CELL_COARSE].n;
    c->nspot = 0;
    for (uint32_t i = first; i < n; i++)
        for (uint8_t r = 0; r < CELL_RULES; r++)
            if (!fill_box(c, i, r)) return false;
    if (compare && !cells_take_values(c, 0)) return false;
    for (uint32_t i = first; i < n; i++) {
        uint32_t end = at;
        while (end < c->nspot && c->spot[end].owner == i) end++;
        Smooth *s = &c->smooth[i];
        bool last = !compare || s->halvings >= BOX_HALVINGS || cells_spent(c), agree;
        /* Halved before, and yet there is no small change in it. */
        bool steep = s->steep || (s->halvings >= c->dim && range_of(c, at, end) > CLIMBS * c->most);
        bool same = !compare || cells_values_agree(c, at, end, steep ? shortest(c, s) / c->width : 1);
        if (compare && !s->all) s->all = s->again = choose_points(c, s, at, end, same, points);
        agree = (same || last) && !s->again;
        if (!last && agree) s->hunted = cells_hides_peak(c, s, c->spot + at, c->spot + end);
        if (last && compare && agree) cells_state_hidden(c, s, c->spot + at, c->spot + end, same);
        if (agree && !s->hunted) {
            if (compare) cells_state_rounding(c, s, c->spot + at, c->spot + end);
            cells_emit_spots(c, at, end, compare);
        } else c->smooth[kept++] = *s;
        at = end;
    }
    c->nsmooth = kept;
    for (uint32_t i = first; i < kept; i++) {
        Smooth s = c->smooth[i];
        uint32_t last = c->nsmooth;
        c->smooth[i].again = false;
        if (s.again) continue;
        if (!halve_box(c, &s)) return false;
        c->smooth[i] = c->smooth[last], c->smooth[last] = c->smooth[last + 1], c->nsmooth--;
    }
    return true;
}

bool cells_integrate_smooth(Cells *c) {
    enum { AT_ONCE = 16 };
    while (c->nsmooth)
        if (!integrate_last(c, c->nsmooth > AT_ONCE ? c->nsmooth - AT_ONCE : 0)) return false;
    return true;
}
