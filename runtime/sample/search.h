/* Inside the finder: one segment in its search; what finder.c and window.c, the part for events about rays, share. */
#ifndef SALTUS_SAMPLE_SEARCH_H
#define SALTUS_SAMPLE_SEARCH_H

#include "runtime/sample/depth.h"
#include "runtime/sample/finder.h"

/* On a bracket of 2^-15 a slope of depth makes less than this part of its difference across the segment: what differs
 * by more than this part of the threshold is a jump. */
#define BRACKET_JUMP 0x1p-6
/* A jump that a bracket misses lies near it: the parts beside the bracket are cut this many paddings away. */
#define NEAR_PADS 16

/* One segment of the batch, during its root search. Positions and lengths are in t, parts of the whole segment. */
typedef struct Item {
    Segment s;
    Event event;
    double tol, pad;   /* wanted length of the bracket; what a bracket of rays is widened by on both sides, else 0 */
    double least;      /* wanted of one whose g bends much, in f64; 0: no other */
    double ga, gb;     /* g at ta and tb */
    double x1, x2, x3; /* x1 is the newest point, [x1, x2] (or [x2, x1]) the bracket, x3 the point before */
    double f1, f2, f3; /* g at these */
    uint32_t left;     /* evaluations before bisection takes over for good */
    bool exact;        /* g was exactly zero at x1 */
} Item;

static inline bool search_has_windows(const SltScene *s) { return scene_outputs(s, SLT_K_EVENT, SLT_OUT_WINDOW) > 0; }
static inline bool search_has_depth(const SltScene *s) { return scene_outputs(s, SLT_K_REGION, SLT_OUT_DEPTH) > 0; }
/* Bisections of a segment before it is dropped; with rays there may be another try and a cut beside a root between two.
 */
static inline uint32_t search_most_halvings(const SltScene *s) { return search_has_windows(s) ? 120 : 60; }
static inline double search_clamp(double v, double lo, double hi) { return v < lo ? lo : v > hi ? hi : v; }
static inline bool search_differ(Mark a, Mark b, double threshold) {
    return a.hash != b.hash || a.face != b.face || depth_differs(a.depth, b.depth, threshold);
}
/* Do they see different faces of a mesh, and nothing else tells them apart? Mostly these are of one surface. */
static inline bool search_differ_in_face(Mark a, Mark b, double threshold) {
    return a.face != b.face && a.hash == b.hash && !depth_differs(a.depth, b.depth, threshold);
}

/* Of numbers, none of which is NaN. */
static inline double search_greater(double a, double b) { return a > b ? a : b; }
static inline double search_lesser(double a, double b) { return a < b ? a : b; }

/* ---- finder.c: the part of s from ta to tb, with marks a and b, goes back on the stack if a and b differ */
void search_push(Finder *f, const Segment *s, double ta, double tb, Mark a, Mark b, SearchState state);

static inline void search_put(Finder *f, uint32_t lane, const Segment *s, double t) {
    double x[3];
    segment_at(s, t, x);
    batch_set_x(f->b, lane, x);
    batch_set_stream(f->b, lane, s->stream, s->rand0);
}
/* Two units in the last place of the position, in parts of the whole segment. */
double search_least(const Finder *f, const Segment *s);
void search_solve(Finder *f, Item *items, uint32_t n);
void search_bracket(const Item *it, double *lo, double *hi);

/* ---- flank.c: found[slot[i]] was made of items[i], which search_solve has done with; slot[i] UINT32_MAX: of this one
 * nothing. What f changes by on the brackets is taken off the jumps. */
void flank_settle(Finder *f, Item *items, const uint32_t *slot, uint32_t n);

/* ---- window.c */
/* Is the site a ray's, so that its g looks along a window? */
static inline bool window_site(const SltScene *s, int32_t site) {
    return search_has_windows(s) && s->site_kind[site] >= SLT_SITE_SILHOUETTE &&
           s->site_kind[site] <= SLT_SITE_MESH_SHADOW;
}
/* By how much brackets of such sites are widened on both sides, in parts of the segment. */
double window_padding(const Finder *f, const Segment *s, double tol);
void window_ask_again(Finder *f, const Segment *s, double lo, double hi, Mark before, Mark after);
void window_cut_near_zero(const Finder *f, Item *it);
bool window_misfits(const Item *it, double lo, double hi); /* [lo, hi]: the final bracket */
/* The state of a part of that length beside the bracket; jumped: f did on the bracket. */
SearchState window_next_state(const Item *it, double length, bool jumped);
/* Items to be bisected first leave the batch; returns how many stay. */
uint32_t window_take_halves(Finder *f, Item *items, uint32_t n);
/* A segment in SEARCH_DOUBT that was bisected at mid, whose mark m has the hash of both ends. */
void window_doubt(Finder *f, const Segment *s, double mid, Mark m);
/* What f does at parts where depths jump without an event: those where it jumps as well are dropped, the others were
 * rays that nobody sees. */
void window_settle_still(Finder *f);
/* Sorts the stack along a Z curve through the domain, so that rays of one vector go the same way. */
/* Where x lies on a curve that fills the plane of the first two axes (Morton): what is near on it is near. */
uint32_t window_place(const SltScene *s, const double x[3]);
void window_order(Finder *f);

#endif
