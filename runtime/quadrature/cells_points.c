/* How many points a piece gets, and where along its base they lie. */
#include <math.h>

#include "runtime/quadrature/cells_inner.h"

#define AIM 0.1 /* of the tolerance: how far apart rules that are chosen should be */
#define ARC_AIM 0.6 /* likewise of a curve that is known */

static double length_of(const Piece *p) { return p->base < 0 ? 0 : p->at[p->base][1] - p->at[p->base][0]; }

/* Points lie evenly along a curve, not along its base: what is integrated has a factor of one over its slope, which
 * is nothing but the length along it, and is smooth there where it would be a root along the base. Of a curve that is
 * known: the cosine of its direction at both ends, and in the middle of an arc of a circle with these. */
static void find_pace(const Cells *c, Piece *p) {
    const Cell *cell = &c->cell[p->cell];
    const CellEdge *e = &cell->edge[p->only];
    const Quadric *q = &e->quadric;
    double cosine[2], sine[2];
    p->pace[0] = p->pace[1] = p->pace[2] = 1, p->turn = 0;
    if (!p->alone || p->base < 0 || !q->is || q->flat) return;
    for (int end = 0; end < 2; end++) {
        double by = p->at[p->base][end] - q->x[p->base], bend = q->bend[p->base][p->base];
        double g = q->g + by * (q->dg[p->base] + 0.5 * bend * by), twist = q->bend[p->base][p->axis];
        double slope = q->dg[p->axis] + twist * by, up = sqrt(slope * slope - 2 * q->bend[p->axis][p->axis] * g);
        double along = q->dg[p->base] + bend * by;
        if (twist != 0) along -= twist * 2 * g / (slope + e->rises[p->axis] * up);
        double size = 1 / sqrt(up * up + along * along);
        cosine[end] = up * size, sine[end] = -e->rises[p->axis] * along * size;
    }
    double across = cosine[0] + cosine[1], along = sine[0] + sine[1],
           middle = across / sqrt(across * across + along * along);
    if (!(middle > 0)) return; /* NaN is not */
    p->pace[0] = cosine[0], p->pace[1] = middle, p->pace[2] = cosine[1];
    p->turn = fabs(cosine[0] * sine[1] - cosine[1] * sine[0]); /* the sine of it, that is */
}

/* Where t of [0, 1] lies on its base, in parts of that, and how fast that goes there: the parabola through the paces.
 */
double cells_along_base(const Piece *p, double t, double *pace) {
    const double *v = p->pace;
    double a = 2 * (v[0] - 2 * v[1] + v[2]), b = 4 * v[1] - 3 * v[0] - v[2], all = (v[0] + 4 * v[1] + v[2]) / 6;
    *pace = (v[0] + t * (b + t * a)) / all;
    return t * (v[0] + t * (b / 2 + t * (a / 3))) / all;
}

/* The same of an arc that turns by so much: of the sine of it a rule of m points errs by K turn^2m, and of its moments
 * in parts of its own length by twice that over the turn. */
static uint32_t points_of_turn(double turn, double most) {
    double error = 2 / turn;
    for (uint32_t m = 1; m < GAUSS_MAX; m++) {
        double n = m, two = 2 * n * (2 * n - 1);
        error *= turn * turn * n * n * n * n * (2 * n - 1) / ((2 * n + 1) * two * two * two);
        if (error <= most) return m + 1;
    }
    return GAUSS_MAX;
}

/* Points that make two rules agree on a piece whose curves bend like those before it: a rule of n points errs by
 * (length * bend)^2n. Planes of a solid have points in common, and f between curves may need more than these do. */
void cells_choose_points(const Cells *c, Piece *p) {
    enum { FIRST = 3 }; /* as long as nothing is known */
    if (p->points) return;
    find_pace(c, p);
    uint32_t full = c->rule[CELL_FINE].n, least = c->o->volume && !c->o->flat ? full - (full > 3) : 2;
    double bend = p->bend > 0 ? p->bend : c->bend, length = length_of(p), n = FIRST;
    p->points = (uint8_t)full;
    if (c->o->fixed || !c->rule[CELL_COARSE].n || p->graded || c->cell[p->cell].slice >= 0) return;
    if (p->turn > 0 && !(p->bend > 0)) n = points_of_turn(p->turn, ARC_AIM * c->o->tolerance * c->width / length);
    else if (bend * length > 0)
        n = 1 + ceil(0.5 * logf((float)(AIM * c->o->tolerance * c->width / length)) /
                     logf((float)smaller(bend * length, 0.5)));
    n = larger(n, larger(least, c->o->few));
    if (n < full) p->points = (uint8_t)n;
}

const GaussRule *cells_rule_of(const Cells *c, const Piece *p, CellRule rule) {
    if (p->graded) return &c->graded[rule];
    uint32_t n = p->points - (rule == CELL_COARSE);
    return p->points < c->rule[CELL_FINE].n ? &c->of[n] : &c->rule[rule];
}
