/* Segments whose ends differ become verified crossings. A worker owns one finder, which calls kernels in the worker's
 * batch; the finder owns its stack, and lends the crossings that it has found to `full` for the time of that call. */
#ifndef SALTUS_SAMPLE_FINDER_H
#define SALTUS_SAMPLE_FINDER_H

#include "runtime/sample/batch.h"

enum { FIND = BATCH / 2 }; /* segments of a batch: two samples each */
static_assert((int)FIND <= (int)ROOTS, "each may have a root");

/* What is known of a point. */
typedef struct Mark {
    uint32_t hash;                  /* of its region */
    uint32_t face;                  /* of the faces of meshes that its rays hit; 0 where the scene has none */
    double depth;                   /* see depth.h; 0 where the scene has none */
    int32_t witness[SLT_WITNESSES]; /* what its first rays met; 0: not known */
} Mark;
/* The mark of sample i, after a call of the region or sides kernel. */
static inline Mark batch_mark(const Batch *b, uint32_t i) {
    Mark m = {.hash = (uint32_t)batch_get_int(b, SLT_OUT_HASH, 0, i)};
    if (batch_has(b, SLT_OUT_DEPTH)) m.depth = batch_get(b, SLT_OUT_DEPTH, 0, i);
    if (batch_has(b, SLT_OUT_FACE)) m.face = (uint32_t)batch_get_int(b, SLT_OUT_FACE, 0, i);
    for (uint32_t k = 0; k < b->layout->out[SLT_OUT_WITNESS].count; k++)
        m.witness[k] = batch_get_int(b, SLT_OUT_WITNESS, k, i);
    return m;
}

/* What is to be done with a part of a segment. All but the first and the last are for scenes with rays: window.c. The
 * order of the first three is that of tries. */
typedef enum SearchState {
    SEARCH_ROOT,  /* ask for the event and look for the root of its g */
    SEARCH_AGAIN, /* the same, a second time without a bisection in between */
    SEARCH_HALVE, /* bisect before asking for an event */
    SEARCH_FRESH, /* a short bracket, for which `event` is to choose the window of its own ends */
    SEARCH_DOUBT, /* the depths differ, but there is no event: is it a slope? */
    SEARCH_FLAT   /* g is 0 on a stretch: bisect on the region down to the tolerance, and then ask for the event */
} SearchState;

enum { TOUCH_A = 1, TOUCH_B = 2 };

typedef struct Segment {
    double a[3], b[3];      /* ends of the whole segment; x(t) = a + t (b - a) */
    double ta, tb;          /* the part still to be searched */
    double base;            /* A_i / N_i of a line, or the weight of a random segment */
    Mark ma, mb;            /* of the points at ta and tb */
    double threshold;       /* of depths: ends that differ by more are apart; HUGE_VAL in scenes without depth */
    double event_threshold; /* the threshold that the kernel `event` gets; 0: the same as threshold */
    double rand0;
    int32_t stream;
    int8_t axis; /* of the line; -1: a random direction */
    uint8_t cls; /* class: of a reverse sink which adjoint buffer; in an integral not 0 where coarser lines miss it */
    uint8_t halvings; /* how often the segment was cut */
    uint8_t state;    /* SearchState */
    uint8_t touches;  /* TOUCH_* bits: there is a crossing right beside this end of the part; prove.h */
    uint8_t owner;    /* whose it is: an index of Finder.lost */
    bool fine;        /* a bracket of which both sides were alike: as near as rounding allows */
    bool hidden;      /* it is part of one with ends that look alike */
    bool narrow;   /* another crossing of the line is near: the next edge, or the one before, has ends that differ, too,
                      or what is left of this one */
    uint32_t edge; /* of the lattice's tile: 1 + its first vertex; 0: none */
    uint32_t thin; /* beside which run of one vertex it lies: thin.h */
    uint32_t line; /* in a volume: which of the lines of all replicates */
    double cut;    /* the t at which to bisect; 0: in the middle of ta and tb */
} Segment;

struct Apart;
typedef struct Crossing {
    Event event;
    const struct Apart *apart;       /* move: whose parameters g has; 1 + the move. 0: those of the scene (untie.h) */
    double x[3], t;                  /* x = a + t (b - a) on the segment */
    double side[2][3];               /* the ends of the final bracket */
    double before[SLT_MAX_CHANNELS]; /* f on a's side */
    double jump[SLT_MAX_CHANNELS];   /* f on b's side, less before */
    float doubt[SLT_MAX_CHANNELS];   /* by how much the jump may be another: flank.c */
    bool doubted;                    /* any is not 0 */
    bool narrow;                     /* another one is near, and its jump may take away nearly all of this one's */
    bool silent;                     /* f does not jump: Finder.silent */
    double ga, gb, bracket; /* g at the ends of the final bracket (0, 0: an exact zero), its length in the domain */
    double direction[3];    /* b - a */
    uint32_t ha, hb;        /* hashes of the regions on a's and b's side */
    double base, rand0;     /* from here to line: of the segment */
    int32_t stream;
    int8_t axis, rising; /* rising: 1 where g grows from a to b, else -1 */
    uint8_t cls, owner, move;
    uint32_t edge, thin, line;
    double weight, g, dg[3]; /* sink.c: the factor of jump * d_theta g, g at x, and its gradient in x */
} Crossing;

/* How many crossings, and what f jumps by at them, summed over the channels and by channel. */
typedef struct Sizes {
    uint64_t n;
    double sum, by[SLT_MAX_CHANNELS];
} Sizes;
void sizes_add(Sizes *to, const Sizes *s);

typedef struct Finder Finder;
struct Finder {
    Batch *b;
    const SltScene *s;
    Segment *stack; /* [n]: segments to be searched */
    uint32_t n, cap;
    Segment *sorted; /* window_order: room for the stack in its new order, */
    uint64_t *keys;  /* and what it is ordered by */
    uint32_t sorted_cap;
    Segment *split; /* [nsplit], room for FIND: to be bisected on the hash */
    uint32_t nsplit;
    Segment *still; /* [nstill], room for FIND: the depths of a ray jump there, and no event says why */
    uint32_t nstill;
    Crossing *found; /* [nfound], room for BATCH: not handed over yet */
    uint32_t nfound;
    void (*full)(void *user, Crossing *c, uint32_t n); /* takes the n <= BATCH crossings found */
    void *full_user;
    /* Crossings of these sites ([sites]; NULL: of none) are handed over though f does not jump there: [nsilent], room
     * for BATCH where there are such. */
    const uint8_t *tied;
    Crossing *silent;
    uint32_t nsilent;
    void (*silent_full)(void *user, Crossing *c, uint32_t n);
    struct Item *items; /* of the batch in hand: search.h */
    uint64_t *order;
    Roots *roots;                                            /* of those items whose roots are looked for */
    uint64_t crossings, segments, dropped[SLT_DROP_REASONS]; /* counts */
    SltPlace dropped_at[SLT_DROP_REASONS];                   /* the least of those places */
    Sizes kept, gone;  /* of the crossings that have a weight, and of those that were dropped for the want of one */
    uint64_t followed; /* crossings that were found along fingers: follow.h */
    double parts_gone; /* what the lines stand for of parts that were dropped: where f jumps by nobody knows how much */
    uint64_t steep, rims; /* crossings beside which f is steep, and of these a small power of the distance */
    bool *lost;           /* set by owner where a crossing was dropped; NULL: nobody asks */
    /* prove.h. `proves`: parts between alike ends are not believed; prove_classes: their crossings get a cls, 1 for
     * those that only the last halving found */
    Segment *alike; /* [nalike] */
    uint32_t nalike, alike_cap;
    uint64_t unproven; /* parts of the least length that bounds left open */
    bool proves, prove_classes;
    bool finest;          /* they are cut down to a few floats, for no more than */
    uint64_t prove_boxes; /* this many boxes; */
    bool *open, *met; /* set by owner where a part was given up that touches none, and where a crossing was found; NULL:
                         nobody asks */
    bool only_hidden; /* crossings of segments that are not hidden are found, and handed over to nobody */
    bool ties;        /* crossings at which regions differ and f does not are wanted too: Crossing.silent */
    bool coarse;      /* rays in an image: a root to 2^-9 of a segment, less than a hundredth of a pixel, will do */
    bool pairs;       /* of an integral: what jumps of crossings near each other leave of each other counts: flank.c */
    bool halve_only;  /* as Belhe et al. search: bisection on the hash down to 2^-15 */
    bool failed;      /* memory ran out */
};
/* How well roots are known, in parts of a segment. */
static inline double root_tolerance(bool coarse) { return coarse ? 0x1p-9 : 0x1p-15; }
bool finder_init(Finder *f, Batch *b);
void finder_free(Finder *f);
/* Adds a whole segment: its ends a and b differ. The caller has set the members a, b, base, stream, rand0, axis, cls
 * and edge. */
void finder_add(Finder *f, Segment *s, Mark a, Mark b, double threshold);
/* Adds a segment with all of its members set. */
void finder_push(Finder *f, const Segment *s);
/* Counts a crossing that cannot be integrated, or one of boundaries that coincide: one that was found, or a part of a
 * segment, which may name no site. */
void finder_drop(Finder *f, SltDrop reason, const Crossing *c);
void finder_note_size(const Finder *f, Sizes *s, const Crossing *c);
void finder_drop_part(Finder *f, SltDrop reason, const Segment *s, int32_t site);
/* Makes `to` the one of both with the lesser x. */
void place_least(SltPlace *to, const SltPlace *other);
/* Works off full batches of the stack; with `all` everything. */
void finder_run(Finder *f, bool all);
/* x = a + t (b - a): exact at both ends, and constant along an axis where a and b agree. */
static inline void segment_at(const Segment *s, double t, double x[3]) {
    for (int d = 0; d < 3; d++) x[d] = s->a[d] == s->b[d] ? s->a[d] : (1 - t) * s->a[d] + t * s->b[d];
}
/* Sorts order[0..n) ascending. */
void sort_keys(uint64_t *order, uint32_t n);

#endif
