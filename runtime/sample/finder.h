/* Segments whose ends differ become verified crossings. One finder a thread, in that thread's batch; it owns its stack,
 * and lends what it has found to whoever takes it (`full`) for the time of that call. */
#ifndef SALTUS_SAMPLE_FINDER_H
#define SALTUS_SAMPLE_FINDER_H

#include "runtime/sample/batch.h"

enum { FIND = BATCH / 2 }; /* segments at a time: two samples each */

/* What is known of a point: its region, its depth where the scene has one, and what its rays met (0: not known). */
typedef struct Mark {
    uint32_t hash;
    double depth;
    int32_t witness[SLT_WITNESSES];
} Mark;
/* Of lane i of a call of the region or sides kernel. */
Mark batch_mark(const Batch *b, uint32_t i);

/* What is to be done with a part of a segment. All but the first are for scenes with rays, see window.c. */
typedef enum SearchState {
    SEARCH_ROOT,  /* ask for the event and look for the root of its g */
    SEARCH_AGAIN, /* the same, a second time without a halving in between */
    SEARCH_HALVE, /* bisect before asking for an event */
    SEARCH_FRESH, /* a bracket that wants the window of its own ends */
    SEARCH_DOUBT  /* no event: is it a slope? */
} SearchState;

typedef struct Segment {
    double a[3], b[3]; /* ends of the whole segment; x(t) = a + t (b - a) */
    double ta, tb;     /* the part still to be searched */
    double base;       /* A_i / N_i of a line, or the weight of a random segment */
    Mark ma, mb;       /* at ta and tb */
    double threshold;  /* ends are apart whose depths differ by more; HUGE_VAL in scenes without depth */
    double told;       /* what `event` is told instead; 0: the same */
    double rand0;
    int32_t stream;
    int8_t axis;      /* of the line; -1: a random direction */
    uint8_t cls;      /* which adjoint buffer, see Sink */
    uint8_t halvings; /* how often it was cut */
    uint8_t state;    /* SearchState */
    uint32_t edge;    /* of the lattice's tile: 1 + its first vertex; 0: none */
    double cut;       /* where to bisect; 0: in the middle */
} Segment;

typedef struct Crossing {
    Event event;
    double x[3], t, base, rand0;
    double jump[SLT_MAX_CHANNELS], before[SLT_MAX_CHANNELS];
    double ga, gb, bracket; /* g at the ends of the final bracket (0, 0: an exact zero), its length in the domain */
    double direction[3];    /* b - a */
    uint32_t ha, hb;        /* regions on both sides */
    int32_t stream;
    int8_t axis, rising; /* sign of g after - g before */
    uint8_t cls;
    uint32_t edge;           /* of the segment */
    double weight, g, dg[3]; /* by sink.c */
} Crossing;

typedef struct Finder Finder;
struct Finder {
    Batch *b;
    const SltScene *s;
    Segment *stack;
    uint32_t n, cap;
    Segment *sorted; /* where window_order puts the stack in order, and by what */
    uint64_t *keys;
    uint32_t sorted_cap;
    Segment *split; /* to be bisected on the hash */
    uint32_t nsplit;
    Crossing *found;
    uint32_t nfound;
    void (*full)(void *user, Crossing *c, uint32_t n); /* called with at most BATCH crossings */
    void *full_user;
    struct Item *items; /* of the batch in hand, see search.h */
    uint64_t *order;
    uint64_t crossings, segments, dropped[SLT_DROP_REASONS];
    bool coarse;     /* rays in an image: a root to 2^-9 of a segment, less than a hundredth of a pixel, will do */
    bool halve_only; /* the paper's search: bisection on the hash down to 2^-15 */
    bool failed;
};
/* Of a segment. */
static inline double root_tolerance(bool coarse) { return coarse ? 0x1p-9 : 0x1p-15; }
bool finder_init(Finder *f, Batch *b);
void finder_free(Finder *f);
/* A segment from x(0) to x(1) whose ends differ, with the rest filled in. */
void finder_add(Finder *f, Segment *s, Mark a, Mark b, double threshold);
/* A segment whose ends differ. */
void finder_push(Finder *f, const Segment *s);
/* Works off full batches; everything when `all`. */
void finder_run(Finder *f, bool all);
void segment_at(const Segment *s, double t, double x[3]);
/* Sorts order[0..n) ascending. */
void sort_keys(uint64_t *order, uint32_t n);

#endif
