/* The part of the search that is for events about rays.
 *
 * Two ends with equal hashes whose depths are more than the threshold apart lie on two sides of a silhouette, or on one
 * steep slope. One bisection (HALVE) tells most slopes from jumps before `event` is asked; where `event` knows of none
 * (DOUBT) the search goes on only while one half keeps most of the difference. And g looks along a window of the ray
 * that `event` chose from the segment's ends: its root need not be the jump. Parts ask for windows of their own
 * (FRESH), at most twice before a bisection, so every search ends. */
#include <assert.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>

#include "runtime/sample/search.h"

/* Of a jump of depth one half of a bisected segment keeps at least this part. */
#define KEEPS 0.75
#define PAD_ULPS 8       /* window_padding: units in the last place of the domain */
#define NEAR_ZERO 0x1p-5 /* g at one end is nearly zero if it is this part of g at the other */
/* g changes this many times faster on the bracket than on the segment: the window does not fit. */
#define MISFIT 16.0
/* A bracket that is asked again is this part of the last one or less; slopes of the depth on it are at most this many
 * times those across the whole segment; and rounding of the depth is below FRESH_LEAST. */
#define FRESH_PART 0.25
#define FRESH_SLOPE 4
#define FRESH_LEAST(scene) ((scene)->f64 ? 0x1p-36 : 0x1p-19)

/* Whether a ray is blocked and its clearance are different arithmetic, and both are rounded in units of the domain's
 * size, not of the position: brackets are wide enough to hold the jump and the root of the clearance. */
double window_padding(const Finder *f, const Segment *s, double tol) {
    double len = 0, mag = 0;
    for (uint32_t d = 0; d < f->s->dim; d++) {
        len = fmax(len, fabs(s->b[d] - s->a[d]));
        mag = fmax(mag, fmax(fabs(f->s->lo[d]), fabs(f->s->hi[d])));
    }
    return fmax(2 * tol, PAD_ULPS * (f->s->f64 ? DBL_EPSILON : (double)FLT_EPSILON) * mag / len);
}

/* Asks for the event of the stretch [lo, hi] of s by itself: slopes are flatter on it, so a smaller difference of
 * depths is a jump. */
void window_ask_again(Finder *f, const Segment *s, double lo, double hi, Mark before, Mark after) {
    Segment part = *s;
    part.ta = lo, part.tb = hi, part.ma = before, part.mb = after;
    part.state = SEARCH_FRESH, part.halvings++;
    part.event_threshold = fmax(fmin(1, FRESH_SLOPE * (hi - lo)) * s->threshold, FRESH_LEAST(f->s));
    finder_push(f, &part);
}

/* g has one sign at both ends, but almost vanishes at one: the jump is there, and rounding hides the change of sign. */
void window_cut_near_zero(const Finder *f, Item *it) {
    if (it->s.state != SEARCH_ROOT) return;
    double a = fabs(it->ga), b = fabs(it->gb), pad = NEAR_PADS * window_padding(f, &it->s, it->tol);
    if (b < NEAR_ZERO * a) it->s.cut = it->s.tb - pad;
    if (a < NEAR_ZERO * b) it->s.cut = it->s.ta + pad;
}

/* f jumps at the root, but g changes too fast there to be the reason: g itself jumps. Another window would show why; or
 * a step of the ground makes both jump, too small to be seen across the whole segment. */
bool window_misfits(const Item *it, double lo, double hi) {
    if (it->exact || !(hi > lo) || (it->s.state == SEARCH_FRESH && hi - lo > FRESH_PART * (it->s.tb - it->s.ta)))
        return false;
    if (isinf(it->f1) || isinf(it->f2)) return true;
    return !(fabs(it->f1 - it->f2) * (it->s.tb - it->s.ta) <= MISFIT * fabs(it->gb - it->ga) * fabs(it->x2 - it->x1));
}

SearchState window_next_state(const Item *it, double length, bool jumped) {
    if (length <= 0.5 * (it->s.tb - it->s.ta)) return SEARCH_ROOT;
    if (!jumped || it->s.state >= SEARCH_HALVE) return SEARCH_HALVE;
    return (SearchState)(it->s.state + 1); /* ROOT to AGAIN, AGAIN to HALVE */
}

uint32_t window_take_halves(Finder *f, Item *items, uint32_t n) {
    uint32_t kept = 0;
    for (uint32_t i = 0; i < n; i++)
        if ((items[i].s.state == SEARCH_HALVE || items[i].s.state == SEARCH_FLAT) &&
            items[i].s.tb - items[i].s.ta > items[i].tol)
            assert(f->nsplit < FIND), f->split[f->nsplit++] = items[i].s;
        else if (kept++ != i) items[kept - 1] = items[i];
    return kept;
}

/* A slope's difference of depth falls into two parts; of a jump one half keeps nearly all. */
void window_doubt(Finder *f, const Segment *s, double mid, Mark m) {
    double most = KEEPS * fabs(s->ma.depth - s->mb.depth);
    if (depth_differs(m.depth, s->mb.depth, most)) search_push(f, s, mid, s->tb, m, s->mb, SEARCH_ROOT);
    if (depth_differs(s->ma.depth, m.depth, most)) search_push(f, s, s->ta, mid, s->ma, m, SEARCH_ROOT);
}

/* Slopes change f by less on a part that is as short as can be; what jumps by less is not worth a word. */
#define STILL_JUMP 0x1p-10

void window_settle_still(Finder *f) {
    Batch *b = f->b;
    if (!f->nstill) return;
    for (uint32_t i = 0; i < f->nstill; i++)
        search_put(f, 2 * i, &f->still[i], f->still[i].ta), search_put(f, 2 * i + 1, &f->still[i], f->still[i].tb);
    batch_call(b, SLT_K_SIDES, 2 * f->nstill);
    bool jumps[FIND] = {0};
    double size[FIND] = {0};
    for (uint32_t c = 0; c < f->s->channels; c++)
        for (uint32_t i = 0; i < f->nstill; i++) {
            double v = batch_get(b, SLT_OUT_F, c, 2 * i), w = batch_get(b, SLT_OUT_F, c, 2 * i + 1);
            size[i] += fabs(v - w), jumps[i] |= !(fabs(v - w) <= STILL_JUMP * fmax(fabs(v), fabs(w)));
        }
    for (uint32_t i = 0; i < f->nstill; i++)
        if (jumps[i]) {
            finder_drop_part(f, SLT_DROP_NO_EVENT, &f->still[i], -1);
            f->gone.n++, f->gone.sum += isfinite(size[i]) ? size[i] : 0;
        }
    f->nstill = 0;
}

/* The 16 low bits of v, two apart: one of them at every even place. */
static uint32_t spread_bits(uint32_t v) {
    v = (v | v << 8) & 0x00ff00ffu;
    v = (v | v << 4) & 0x0f0f0f0fu;
    v = (v | v << 2) & 0x33333333u;
    return (v | v << 1) & 0x55555555u;
}

uint32_t window_place(const SltScene *s, const double x[3]) {
    uint32_t at[2] = {0, 0};
    for (uint32_t d = 0; d < 2 && d < s->dim; d++) {
        double u = (x[d] - s->lo[d]) / (s->hi[d] - s->lo[d]);
        at[d] = (uint32_t)(65535 * search_clamp(u, 0, 1));
    }
    return spread_bits(at[0]) | spread_bits(at[1]) << 1;
}

/* Room to sort the stack in. */
static bool sorted_room(Finder *f) {
    if (f->sorted_cap == f->cap) return true; /* stack and sorted change places, so both have the same capacity */
    free(f->sorted), free(f->keys);
    f->sorted = malloc(f->cap * sizeof *f->sorted), f->keys = malloc(f->cap * sizeof *f->keys);
    f->sorted_cap = f->sorted && f->keys ? f->cap : 0;
    return f->sorted_cap > 0;
}

void window_order(Finder *f) {
    if (!sorted_room(f)) return; /* without memory the stack keeps its order */
    for (uint32_t i = 0; i < f->n; i++) f->keys[i] = (uint64_t)window_place(f->s, f->stack[i].a) << 32 | i;
    sort_keys(f->keys, f->n);
    for (uint32_t i = 0; i < f->n; i++) f->sorted[i] = f->stack[(uint32_t)f->keys[i]];
    Segment *old = f->stack;
    f->stack = f->sorted, f->sorted = old;
}
