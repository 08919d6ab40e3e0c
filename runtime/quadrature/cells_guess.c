/* About where the roots of the coarse rule lie, once those of the fine one are known. */
#include <math.h>

#include "runtime/quadrature/cells_inner.h"

enum { PLACES = 6 }; /* most that a guess is made of */
#define STRAIGHT 0x1p-30 /* of the height of a cell: so little a curve departs from its tangent */
#define COARSE 0.02      /* of what the rules may differ by on a piece: what the slope of a coarse root may be off by */

static double climb_of(const Piece *p, const Root *r) { return -r->dg[p->base] / r->dg[p->axis]; }

/* At `at`, on the polynomial through n roots of the edge with their slopes: Newton's form, each place twice. */
static double through(const Cells *c, const Piece *p, const Column *from, uint32_t n, uint32_t i, double at) {
    double x[2 * PLACES], d[2 * PLACES];
    for (uint32_t k = 0; k < n; k++) {
        const Root *r = &c->root[from[k].first + i];
        x[2 * k] = x[2 * k + 1] = r->x[p->base], d[2 * k] = d[2 * k + 1] = r->x[p->axis];
    }
    for (uint32_t order = 1; order < 2 * n; order++)
        for (uint32_t k = 2 * n; k-- > order;) {
            bool twice = order == 1 && k % 2;
            d[k] = twice ? climb_of(p, &c->root[from[k / 2].first + i]) : (d[k] - d[k - 1]) / (x[k] - x[k - order]);
        }
    double y = d[2 * n - 1];
    for (uint32_t k = 2 * n - 1; k-- > 0;) y = y * (at - x[k]) + d[k];
    return y;
}

/* By how much a guess there is wrong, as it was at two roots. */
static double wrong_by(const Piece *p, const Root *a, const Root *b, double at) {
    double t = (at - a->x[p->base]) / (b->x[p->base] - a->x[p->base]);
    return (1 - t) * (a->x[p->axis] - a->guess) + t * (b->x[p->axis] - b->guess);
}

/* The points of rules of n and n - 1 points alternate. Of few, where corners made the guesses, these are put right. So
 * good guesses need one evaluation where the slope may then be off a little: the coarse rule tells how far the fine one
 * is off, and of that a part does not count. */
void cells_guess_coarse(Cells *c, const Column *from, const Column *to) {
    const Piece *p = &c->piece[from->piece];
    const Column *coarse = from;
    while (coarse < to && coarse->rule == CELL_FINE) coarse++;
    uint32_t n = (uint32_t)(coarse - from), many = n < PLACES ? n : PLACES;
    bool alternate = p->base >= 0 && coarse - from == to - coarse + 1;
    double length = p->base < 0 ? 0 : p->at[p->base][1] - p->at[p->base][0];
    for (uint32_t k = 0; coarse + k < to; k++)
        for (uint32_t i = 0; i < coarse[k].nroots; i++) {
            Root *r = &c->root[coarse[k].first + i];
            r->waits = false;
            if (r->solved || !alternate) continue;
            if (r->slack >= 0) r->turns = COARSE * c->o->tolerance * c->width / length;
            const Root *a = &c->root[from[k].first + i], *b = &c->root[from[k + 1].first + i];
            bool told = !isnan(p->edge[r->edge].off);
            uint32_t first = k + 1 < many / 2 ? 0 : k + 1 - many / 2;
            if (first + many > n) first = n - many;
            double guess = told && n < 3 ? r->guess + wrong_by(p, a, b, r->x[p->base])
                                         : through(c, p, from + first, many, i, r->x[p->base]);
            /* Of a straight curve the guess from the middle is the better one. */
            bool straight = !told && fabs(guess - r->guess) <= STRAIGHT * (r->hi - r->lo);
            if (!straight && guess > r->lo && guess < r->hi) r->x[p->axis] = cells_round(c, guess);
        }
}
