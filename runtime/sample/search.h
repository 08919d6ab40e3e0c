/* Inside of the finder: one segment in its search, and what window.c does where events are about rays. */
#ifndef SALTUS_SAMPLE_SEARCH_H
#define SALTUS_SAMPLE_SEARCH_H

#include "runtime/sample/depth.h"
#include "runtime/sample/finder.h"

/* Across a bracket of 2^-15, slopes are this much flatter than across the segment, and more. */
#define BRACKET_JUMP 0x1p-6
/* Where the jump is beside the bracket all the same, it is near: parts are cut this many paddings from it. */
#define NEAR_PADS 16

/* One segment of the batch, during its root search: x1 is the newest point, [x1, x2] the bracket, x3 the point before.
 */
typedef struct Item {
    Segment s;
    Event event;
    double tol, pad, ga, gb;
    double x1, x2, x3, f1, f2, f3, next;
    uint32_t left; /* evaluations before bisection takes over for good */
    bool exact;    /* g was exactly zero at x1 */
} Item;

static inline bool search_has_windows(const SltScene *s) { return scene_outputs(s, SLT_K_EVENT, SLT_OUT_WINDOW) > 0; }
static inline bool search_has_depth(const SltScene *s) { return scene_outputs(s, SLT_K_REGION, SLT_OUT_DEPTH) > 0; }
/* Between two halvings of a segment of rays there may be another try, and a cut beside a root. */
static inline uint32_t search_most_halvings(const SltScene *s) { return search_has_windows(s) ? 120 : 60; }
static inline double search_clamp(double v, double lo, double hi) { return v < lo ? lo : v > hi ? hi : v; }
static inline bool search_differ(Mark a, Mark b, double threshold) {
    return a.hash != b.hash || depth_differs(a.depth, b.depth, threshold);
}

/* ---- finder.c: the part of s from ta to tb goes back on the stack, if its ends differ. cut: where to bisect it; 0: in
 * the middle */
void search_push(Finder *f, const Segment *s, double ta, double tb, Mark a, Mark b, SearchState state);
void search_push_cut(Finder *f, const Segment *s, double ta, double tb, Mark a, Mark b, SearchState state, double cut);

/* ---- window.c */
/* Are this site's events about rays, and their g looks through a window? */
bool window_site(const SltScene *s, int32_t site);
/* By how much brackets are wider than their roots are known; in parts of the segment. */
double window_padding(const Finder *f, const Segment *s, double tol);
void window_ask_again(Finder *f, const Segment *s, double lo, double hi, Mark before, Mark after);
void window_cut_near_zero(const Finder *f, Item *it);
bool window_misfits(const Item *it, double lo, double hi);
/* Of a part of that length beside the bracket at which f jumped, or not. */
SearchState window_next_state(const Item *it, double length, bool jumped);
/* Items to be bisected first leave the batch; returns how many stay. */
uint32_t window_take_halves(Finder *f, Item *items, uint32_t n);
/* A segment in doubt that was bisected, its middle m on the near side's piece. */
void window_doubt(Finder *f, const Segment *s, double mid, Mark m);
/* Rays of one vector should go the same way: the stack along a Z curve through the domain. */
void window_order(Finder *f);

#endif
