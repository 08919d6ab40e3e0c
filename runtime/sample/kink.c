/* One comparison may hold a tie, too: max(a, b) > 0 where a and b are the same and move apart. Its g then has one slope
 * in the parameters to each side, and the integral no derivative. With the parameters moved forth and back (untie.h)
 * the changes of g are not opposite; its derivatives at the two moves are those of the two sides. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/sink.h"

enum { PAIRS = UNTIE_WAYS / 2, EACH = 16 /* crossings of which one is looked at */ };
#define BENT 0.125   /* changes forth and back that make up for each other to this part are those of a slope */
#define PART 0x1p-5   /* of the step, that a boundary must go */
#define FASTER 8.0    /* g may rise so many times faster after a move */
#define ROUNDING 4.0 /* of g, in units in the last place of the position times its gradient */

void finer_free(Finer *f) {
    for (int k = 0; k < FINER_RUNGS; k++) apart_free(f->apart[k]);
}

void kink_free(Kinks *q) {
    finer_free(&q->finer);
    for (int p = 0; p < PAIRS; p++) free(q->at[p]);
    memset(q, 0, sizeof *q);
}

/* What may be the rounding of g, */
static double noise(const Sink *k, const Crossing *c) {
    const Batch *b = k->b;
    double most = 0, steep = 0, unit = b->f64 ? DBL_EPSILON : (double)FLT_EPSILON;
    for (uint32_t d = 0; d < b->s->dim; d++) most = fmax(most, fabs(c->x[d])), steep += c->dg[d] * c->dg[d];
    return ROUNDING * unit * most * sqrt(steep);
}

/* or its curvature: of second order in the step. */
static double least(const Sink *k, const Crossing *c) {
    double steep = 0;
    for (uint32_t d = 0; d < k->b->s->dim; d++) steep += c->dg[d] * c->dg[d];
    /* Where g is not 0 beside the move it is no root, but a pole. */
    return noise(k, c) + PART * k->coincide.apart->step * sqrt(steep) + 4 * fabs(c->g);
}

uint32_t kink_find(Batch *b, const Apart *apart, const Crossing *const *at, const double *least, double bent,
                   uint32_t n, uint32_t *pair) {
    const SltCullList *lists = b->args.cull; /* good where nothing has moved */
    uint32_t found = 0;
    b->args.cull = NULL;
    for (uint32_t from = 0, to; from < n; from = to) {
        double by[UNTIE_WAYS][BATCH];
        for (to = from + 1; to < n && at[to]->event.site == at[from]->event.site;) to++;
        b->args.site = at[from]->event.site;
        for (uint32_t i = from; i < to; i++) {
            batch_set_x(b, i - from, at[i]->x);
            batch_set_stream(b, i - from, at[i]->stream, at[i]->rand0);
            batch_set_event(b, i - from, &at[i]->event);
        }
        for (uint32_t m = 0; m < UNTIE_WAYS; m++) {
            untie_use(b, &apart->move[m].scene);
            batch_call(b, SLT_K_SITE, to - from);
            for (uint32_t i = from; i < to; i++) by[m][i - from] = batch_get(b, SLT_OUT_G, 0, i - from) - at[i]->g;
        }
        for (uint32_t i = from; i < to; i++) {
            double most = 0;
            pair[i] = KINK_NONE;
            for (uint32_t p = 0; p < PAIRS; p++) {
                double forth = by[2 * p][i - from], back = by[2 * p + 1][i - from], sum = fabs(forth + back);
                if (!(sum > bent * (fabs(forth) + fabs(back)) + least[i] && sum > most)) continue;
                pair[i] = p, most = sum;
            }
            found += pair[i] != KINK_NONE;
        }
    }
    untie_use(b, b->s);
    b->args.cull = lists;
    return found;
}

/* ---- is it at the parameters? */
enum { SPOTS = 8 };
#define GONE 0.5 /* of what a bend at the parameters would leave after shorter moves */

/* Places about a crossing, along its boundary: as far from each other as roundings there have to do with one another.
 */
static void make_spots(const Batch *b, const Crossing *c, double x[SPOTS][3]) {
    static const double aside[SPOTS] = {0, 61, -83, 147, -179, 233, -271, 317};
    double square = 0;
    for (uint32_t d = 0; d < b->s->dim; d++) square += c->dg[d] * c->dg[d];
    for (uint32_t k = 0; k < SPOTS; k++) {
        double by[3] = {0}, along = 0;
        for (uint32_t d = 0; d < b->s->dim; d++) {
            double unit = b->f64 ? DBL_EPSILON : (double)FLT_EPSILON;
            by[d] = aside[(k + 3 * d) % SPOTS] * unit * fmax(fabs(b->s->lo[d]), fabs(b->s->hi[d]));
            along += by[d] * c->dg[d];
        }
        for (uint32_t d = 0; d < b->s->dim; d++)
            x[k][d] = fmin(fmax(c->x[d] + by[d] - along * c->dg[d] / square, b->s->lo[d]), b->s->hi[d]);
    }
}

/* g of the crossing's event at all spots; moved: with these parameters. */
static void take(Batch *b, const SltScene *moved, const Crossing *c, double x[SPOTS][3], double g[SPOTS]) {
    untie_use(b, moved);
    for (uint32_t k = 0; k < SPOTS; k++) {
        batch_set_x(b, k, x[k]);
        batch_set_stream(b, k, c->stream, c->rand0);
        batch_set_event(b, k, &c->event);
    }
    batch_call(b, SLT_K_SITE, SPOTS);
    for (uint32_t k = 0; k < SPOTS; k++) g[k] = batch_get(b, SLT_OUT_G, 0, k);
}

/* By how much changes of g forth and back do not make up for each other, by spot. */
static void take_bends(Batch *b, const Apart *a, const Crossing *c, uint32_t pair, double x[SPOTS][3],
                       const double here[SPOTS], double bend[SPOTS]) {
    double forth[SPOTS], back[SPOTS];
    take(b, &a->move[2 * pair].scene, c, x, forth);
    take(b, &a->move[2 * pair + 1].scene, c, x, back);
    for (uint32_t k = 0; k < SPOTS; k++) bend[k] = (forth[k] - here[k]) + (back[k] - here[k]);
}

bool kink_is_beside(Batch *b, const Apart *apart, Finer *finer, const Crossing *c, uint32_t pair, double noise,
                    bool *memory) {
    const SltCullList *lists = b->args.cull;
    double x[SPOTS][3] = {{0}}, here[SPOTS], bend[SPOTS], whole, shorter = 1;
    bool beside = false;
    b->args.cull = NULL, b->args.site = c->event.site;
    make_spots(b, c, x);
    take(b, b->s, c, x, here);
    take_bends(b, apart, c, pair, x, here, bend);
    whole = bend[0];
    for (uint32_t rung = 0; rung < FINER_RUNGS && !beside; rung++) {
        Apart **a = &finer->apart[rung];
        double most = 0;
        shorter /= FINER_EACH;
        if (!(fabs(whole) * shorter > noise)) break;
        if (!*a && !(*memory = apart_new(b->s, apart->seed, apart->step * shorter, a))) break;
        if (!*a) break;
        take_bends(b, *a, c, pair, x, here, bend);
        for (uint32_t k = 0; k < SPOTS; k++) most = fmax(most, whole < 0 ? -bend[k] : bend[k]);
        beside = most < GONE * shorter * fabs(whole);
    }
    untie_use(b, b->s);
    b->args.cull = lists;
    return beside;
}

static uint32_t find(Sink *k, const Crossing *const *at, uint32_t n, uint32_t *pair) {
    double slack[BATCH];
    for (uint32_t i = 0; i < n; i++) slack[i] = least(k, at[i]);
    return kink_find(k->b, k->coincide.apart, at, slack, BENT, n, pair);
}

/* Does g rise the same way after both moves, and about as fast? If not they have gone farther than the other side of a
 * thin band, or the root is a multiple one, of which rounding makes anything. */
static bool same_way(Sink *k, const Crossing *c, uint32_t pair) {
    Batch *b = k->b;
    const SltCullList *lists = b->args.cull;
    double square = 0;
    bool same = true;
    for (uint32_t d = 0; d < b->s->dim; d++) square += c->dg[d] * c->dg[d];
    b->args.cull = NULL, b->args.site = c->event.site;
    sink_put(k, 0, c);
    for (uint32_t m = 0; m < 2; m++) {
        double along = 0;
        untie_use(b, &k->coincide.apart->move[2 * pair + m].scene);
        batch_call(b, SLT_K_SITE_GRAD, 1);
        for (uint32_t d = 0; d < b->s->dim; d++) along += c->dg[d] * batch_get(b, SLT_OUT_G_DX, d, 0);
        same &= along * FASTER > square && along < square * FASTER;
    }
    untie_use(b, b->s);
    b->args.cull = lists;
    return same;
}

static bool is_beside(Sink *k, const Crossing *c, uint32_t pair) {
    bool memory = true,
         beside = kink_is_beside(k->b, k->coincide.apart, &k->coincide.kinks.finer, c, pair, noise(k, c), &memory);
    k->failed |= !memory;
    return beside;
}

/* A corner looks like a kink, but only there: if it is a sharp one, its other side is near a little farther along,
 * too. */
static bool is_kink(Sink *k, const Crossing *c, uint32_t pair) {
    Crossing aside;
    const Crossing *at = &aside;
    uint32_t other;
    if (!same_way(k, c, pair) || is_beside(k, c, pair)) return false;
    return k->b->s->dim == 1 ||
           (coincide_aside(k, c, &aside) && find(k, &at, 1, &other) && !is_beside(k, &aside, other));
}

/* g of a [SkipLoop] is that of another iteration where parameters have moved; that of a ray looks past another edge. */
static bool may_bend(const SltScene *s, int32_t site) {
    return s->site_kind[site] == SLT_SITE_COMPARE && !(s->site_skips && s->site_skips[site]);
}

/* On the final bracket g rises far faster than its gradient says: what is there is rounding. */
static bool is_rough(const Sink *k, const Crossing *c) {
    double square = 0;
    for (uint32_t d = 0; d < k->b->s->dim; d++) square += c->dg[d] * c->dg[d];
    return fabs(c->gb - c->ga) > FASTER * sqrt(square) * c->bracket && c->bracket > 0;
}

void kink_settle(Sink *k, const Crossing *c, const uint64_t *order, bool *keep, uint32_t n) {
    Kinks *q = &k->coincide.kinks;
    const Crossing *at[BATCH];
    uint32_t which[BATCH], pair[BATCH], nat = 0;
    memset(q->n, 0, sizeof q->n);
    if (!k->coincide.apart || k->coincide.no_kinks) return;
    /* First a few of them. */
    for (uint32_t look = EACH; look; look = look == EACH ? 1 : 0) {
        uint32_t seen = 0;
        nat = 0;
        for (uint32_t i = 0; i < n; i++) {
            const Crossing *x = &c[(uint32_t)order[i]];
            if (!keep[i] || !may_bend(k->b->s, x->event.site) || is_rough(k, x) || seen++ % look) continue;
            which[nat] = i, at[nat++] = x;
        }
        if (!find(k, at, nat, pair)) return;
    }
    for (uint32_t i = 0; i < nat; i++) {
        if (pair[i] == KINK_NONE || !is_kink(k, at[i], pair[i])) continue;
        Crossing **list = &q->at[pair[i]];
        if (!*list && !(*list = malloc(BATCH * sizeof **list))) {
            k->failed = true;
            return;
        }
        (*list)[q->n[pair[i]]++] = *at[i];
        keep[which[i]] = false;
        finder_drop(k->f, SLT_DROP_COINCIDENT, at[i]);
    }
}
