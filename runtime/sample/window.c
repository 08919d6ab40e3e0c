/* What is different about the search where events are about rays.
 *
 * Two ends with equal hashes may lie on two sides of a silhouette, if their depths are more than the threshold apart:
 * or on one steep slope. One bisection (HALVE) tells most slopes from jumps before `event` is asked, and where it knows
 * of none (DOUBT) the search goes on only while one half keeps most of the difference. And g is that of a window chosen
 * from the segment's ends: its root need not be the jump. Parts ask for windows of their own (FRESH), at most twice
 * before a bisection, so every search ends. */
#include <assert.h>
#include <float.h>
#include <stdlib.h>

#include "runtime/sample/search.h"

/* A bisection leaves a jump this part of it. */
#define KEEPS 0.75
#define PAD_ULPS 8 /* of the domain, see window_padding */
#define NEAR_ZERO 0x1p-5
/* g changes this many times faster on the bracket than on the segment: its window does not fit. */
#define MISFIT 16.0
/* A bracket that is asked again is this part of the last one or less; slopes of the depth there are this many times
 * what they are across the whole at most, and rounding of the depth is below FRESH_LEAST. */
#define FRESH_PART 0.25
#define FRESH_SLOPE 4
#define FRESH_LEAST(scene) ((scene)->f64 ? 0x1p-36 : 0x1p-19)

bool window_site(const SltScene *s, int32_t site) {
    return search_has_windows(s) &&
           (s->site_kind[site] == SLT_SITE_SILHOUETTE || s->site_kind[site] == SLT_SITE_SHADOW);
}

/* Whether a ray is blocked is decided by other arithmetic than its clearance, and neither knows how near zero the
 * position is: brackets of their roots are wider than what may lie between, by the ulps of the domain. */
double window_padding(const Finder *f, const Segment *s, double tol) {
    double len = 0, mag = 0;
    for (uint32_t d = 0; d < f->s->dim; d++) {
        len = fmax(len, fabs(s->b[d] - s->a[d]));
        mag = fmax(mag, fmax(fabs(f->s->lo[d]), fabs(f->s->hi[d])));
    }
    return fmax(2 * tol, PAD_ULPS * (f->s->f64 ? DBL_EPSILON : (double)FLT_EPSILON) * mag / len);
}

/* Asks for the event of a short stretch of s by itself, where depths that differ less say something. */
void window_ask_again(Finder *f, const Segment *s, double lo, double hi, Mark before, Mark after) {
    Segment part = *s;
    part.ta = lo, part.tb = hi, part.ma = before, part.mb = after;
    part.state = SEARCH_FRESH, part.halvings++;
    part.told = fmax(fmin(1, FRESH_SLOPE * (hi - lo)) * s->threshold, FRESH_LEAST(f->s));
    finder_push(f, &part);
}

/* No change of sign, but nearly: the jump is where g almost vanishes, and rounding hides the sign. */
void window_cut_near_zero(const Finder *f, Item *it) {
    if (it->s.state != SEARCH_ROOT) return;
    double a = fabs(it->ga), b = fabs(it->gb), pad = NEAR_PADS * window_padding(f, &it->s, it->tol);
    if (b < NEAR_ZERO * a) it->s.cut = it->s.tb - pad;
    if (a < NEAR_ZERO * b) it->s.cut = it->s.ta + pad;
}

/* The root of a window's g at which f jumps, but not because of this g: another window would show why, or it is not
 * this g that jumps f, but a step of the ground that made it jump, and that is too small to be seen across the whole
 * segment. */
bool window_misfits(const Item *it, double lo, double hi) {
    if (it->exact || !(hi > lo) || (it->s.state == SEARCH_FRESH && hi - lo > FRESH_PART * (it->s.tb - it->s.ta)))
        return false;
    if (isinf(it->f1) || isinf(it->f2)) return true;
    return !(fabs(it->f1 - it->f2) * (it->s.tb - it->s.ta) <= MISFIT * fabs(it->gb - it->ga) * fabs(it->x2 - it->x1));
}

SearchState window_next_state(const Item *it, double length, bool jumped) {
    if (length <= 0.5 * (it->s.tb - it->s.ta)) return SEARCH_ROOT;
    if (!jumped || it->s.state >= SEARCH_HALVE) return SEARCH_HALVE;
    return (SearchState)(it->s.state + 1); /* from ROOT to AGAIN to HALVE */
}

uint32_t window_take_halves(Finder *f, Item *items, uint32_t n) {
    uint32_t kept = 0;
    for (uint32_t i = 0; i < n; i++)
        if (items[i].s.state == SEARCH_HALVE && items[i].s.tb - items[i].s.ta > items[i].tol)
            assert(f->nsplit < FIND), f->split[f->nsplit++] = items[i].s;
        else items[kept++] = items[i];
    return kept;
}

/* A slope falls into two; of a jump one half keeps nearly all. */
void window_doubt(Finder *f, const Segment *s, double mid, Mark m) {
    double most = KEEPS * fabs(s->ma.depth - s->mb.depth);
    if (depth_differs(m.depth, s->mb.depth, most)) search_push(f, s, mid, s->tb, m, s->mb, SEARCH_ROOT);
    if (depth_differs(s->ma.depth, m.depth, most)) search_push(f, s, s->ta, mid, s->ma, m, SEARCH_ROOT);
}

/* Bits of v two apart. */
static uint32_t spread_bits(uint32_t v) {
    v = (v | v << 8) & 0x00ff00ffu;
    v = (v | v << 4) & 0x0f0f0f0fu;
    v = (v | v << 2) & 0x33333333u;
    return (v | v << 1) & 0x55555555u;
}

/* Room to sort the stack in. */
static bool sorted_room(Finder *f) {
    if (f->sorted_cap == f->cap) return true; /* they change places: always the same */
    free(f->sorted), free(f->keys);
    f->sorted = malloc(f->cap * sizeof *f->sorted), f->keys = malloc(f->cap * sizeof *f->keys);
    f->sorted_cap = f->sorted && f->keys ? f->cap : 0;
    return f->sorted_cap > 0;
}

void window_order(Finder *f) {
    if (!sorted_room(f)) return; /* then the order is as it came */
    for (uint32_t i = 0; i < f->n; i++) {
        uint32_t at[2] = {0, 0};
        for (uint32_t d = 0; d < 2 && d < f->s->dim; d++) {
            double x = (f->stack[i].a[d] - f->s->lo[d]) / (f->s->hi[d] - f->s->lo[d]);
            at[d] = (uint32_t)(65535 * search_clamp(x, 0, 1));
        }
        f->keys[i] = (uint64_t)(spread_bits(at[0]) | spread_bits(at[1]) << 1) << 32 | i;
    }
    sort_keys(f->keys, f->n);
    for (uint32_t i = 0; i < f->n; i++) f->sorted[i] = f->stack[(uint32_t)f->keys[i]];
    Segment *old = f->stack;
    f->stack = f->sorted, f->sorted = old;
}
