/* Inside of the estimators; nobody outside runtime/sample includes this.
 *
 *   grid       pixels, filters, positions of samples                          grid.c
 *   Batch      the arrays of one thread's kernel calls                        batch.c
 *   Accum      adjoints of one tile in the kernels' layout, summed in double  accum.c
 *   Spread     how far apart the depths of neighbours usually are            depth.c
 *   Finder     segments whose ends differ -> verified crossings               finder.c
 *   Sink       crossings -> weights -> gradients or splats                    sink.c
 *   lattice.c, scanline.c, segments.c make the segments; interior.c does the smooth part; near.c the near-miss probe
 *   follow.c looks for thin features where its neighbours' crossings point
 *   coincide.c looks for boundaries that lie on one another
 *   eval.c     f at given points, the Batch alone
 *   estimate.c puts them together; difference.c is the finite-difference estimator
 *
 * One Worker per thread owns a Batch, a Finder, a Sink and an Accum. Nothing here is shared but read-only Run and
 * Scene; results are added in `merge`, in tile order. */
#ifndef SALTUS_SAMPLE_INTERNAL_H
#define SALTUS_SAMPLE_INTERNAL_H

#include <assert.h>
#include <math.h>

#include "runtime/base/rng.h"
#include "runtime/base/threads.h"
#include "runtime/sample/estimate.h"

enum { BATCH = 1024, FIND = BATCH / 2, ACCUMS = 8, COSETS = 4 };

/* ---- grid.c: the pixels of an image, or the domain as one. Axis 1 of a position goes up, rows of images go down. */
typedef struct Grid {
    bool integral;      /* one "pixel" with the constant filter 1: an integral, not a mean */
    uint32_t dim, n[3]; /* n is 1 beyond dim */
    double lo[3], hi[3], side[3];
    SltFilter filter;
    double radius;   /* of the filter, in pixels */
    double *mass[3]; /* by pixel of the axis: the part of the filter inside the domain; NULL when integral */
    uint64_t pixels;
} Grid;
SltStatus grid_init(Grid *g, const SltScene *s, const SltJob *j, SltError *err);
void grid_free(Grid *g);
/* Row-major index, row 0 at the top. */
static inline uint64_t grid_index(const Grid *g, uint32_t x, uint32_t y, uint32_t z) {
    return ((uint64_t)z * g->n[1] + (g->n[1] - 1 - y)) * g->n[0] + x;
}
/* The pixel of the axis that holds x. */
static inline uint32_t grid_cell(const Grid *g, uint32_t axis, double x) {
    double c = (x - g->lo[axis]) / g->side[axis];
    if (!(c > 0)) return 0;
    return c >= g->n[axis] ? g->n[axis] - 1 : (uint32_t)c;
}
/* Pixels whose filter reaches x along an axis, and their normalised weights (1/length). At most GRID_REACH of them. */
enum { GRID_REACH = 6 };
uint32_t grid_reach(const Grid *g, uint32_t axis, double x, uint32_t *first, double weight[GRID_REACH]);
/* Position inside pixel p of the axis for u in (0,1), distributed as the filter over the part of the domain it covers.
 */
double grid_place(const Grid *g, uint32_t axis, uint32_t p, double u);
/* sum over pixels of adjoint * filter at x, per channel. */
void grid_gather(const Grid *g, const float *adjoint, uint32_t channels, const double x[3], double *out);

/* A pattern of samples of a pixel, or of the whole domain: additive recurrence with a random shift each. */
typedef struct Pattern {
    uint32_t dims; /* of the recurrence: position, and number 0 of the stream */
    uint32_t shift[4];
    uint32_t seed, lane;
    uint64_t owner; /* pixel or replicate, for the streams */
    RngPurpose purpose;
} Pattern;
void pattern_init(Pattern *p, const SltScene *s, uint32_t seed, RngPurpose purpose, uint32_t lane, uint64_t owner);
static inline double pattern_at(const Pattern *p, uint32_t dim, uint64_t index) {
    return rng_recurrence(p->dims, dim, index, p->shift[dim]);
}
int32_t pattern_stream(const Pattern *p, uint64_t index);

/* ---- batch.c */
typedef struct Batch {
    const SltScene *s;
    SltKernelArgs args;
    bool f64, pixels; /* fill the pixel() inputs */
    const Grid *grid;
    void *memory;
    unsigned char *tape;
    const SltLayout *layout; /* of the kernel that was called last: where its outputs are */
    uint64_t evaluations;
    bool
        again; /* these samples have been through a kernel that counts: cuts and failed asserts are not counted twice */
} Batch;
bool batch_init(Batch *b, const SltScene *s, const Grid *g);
void batch_free(Batch *b);
void batch_collect(Batch *b, SltStats *t); /* adds what the calls counted, and counts from 0 again */
static inline void batch_set(Batch *b, uint32_t slot, uint32_t i, double v) {
    if (b->f64) ((double *)b->args.in[slot])[i] = v;
    else ((float *)b->args.in[slot])[i] = (float)v;
}
static inline void batch_set_int(Batch *b, uint32_t slot, uint32_t i, int32_t v) {
    ((int32_t *)b->args.in[slot])[i] = v;
}
/* Output number k of a role, of the kernel that was called last: all samples, or one. */
static inline const void *batch_out(const Batch *b, SltRole role, uint32_t k) {
    assert(k < b->layout->out[role].count);
    return b->args.out[b->layout->out[role].first + k];
}
static inline double batch_get(const Batch *b, SltRole role, uint32_t k, uint32_t i) {
    const void *v = batch_out(b, role, k);
    return b->f64 ? ((const double *)v)[i] : (double)((const float *)v)[i];
}
static inline int32_t batch_get_int(const Batch *b, SltRole role, uint32_t k, uint32_t i) {
    return ((const int32_t *)batch_out(b, role, k))[i];
}
static inline bool batch_has(const Batch *b, SltRole role) { return b->layout->out[role].count > 0; }
/* Position, and the pixel it lies in when the shader's image has pixels. */
void batch_set_x(Batch *b, uint32_t i, const double x[3]);
/* What a site kernel must know besides the point. */
typedef struct Event {
    int32_t site, k[SLT_MAX_K];
    double boundary, window[2]; /* where it is about an integer, or a ray */
} Event;
/* All but the site, which is the same for all samples. */
void batch_set_event(Batch *b, uint32_t i, const Event *e);
/* Number 0 of a stream: kept below 1 in the program's precision. */
void batch_set_stream(Batch *b, uint32_t i, int32_t stream, double rand0);
/* Calls a kernel on lanes 0..n-1 of the inputs; the tail up to the next multiple of SLT_PAD becomes copies of lane n-1
 * (with zero seeds). */
void batch_call(Batch *b, SltKernelKind kind, uint32_t n);

/* ---- accum.c */
typedef struct AdjointBuffer {
    unsigned char *adj; /* flt[nfloats][width] or flt[nfloats] */
    double *sum;        /* [nfloats]: of the tile */
    uint32_t *touched;  /* blocks of ACCUM_BLOCK parameters with a sum */
    uint32_t ntouched;
    bool dirty;
    uint32_t *log_index;
    unsigned char *log_value; /* flt */
    uint64_t log_len, log_cap;
} AdjointBuffer;
typedef struct Accum {
    const SltScene *s;
    uint32_t n;
    uint64_t stride, bytes; /* bytes a parameter, bytes of adj */
    AdjointBuffer buf[ACCUMS];
    uint32_t *blocks, nblocks; /* first parameter of each block that kernels may add to */
    unsigned char *scratch;    /* where a repeated call adds what must not count twice */
    bool failed;
} Accum;
bool accum_init(Accum *a, const SltScene *s, uint32_t n);
void accum_free(Accum *a);
/* Runs a reverse kernel that adds into buffer `which`. */
void accum_call(Accum *a, Batch *b, SltKernelKind kind, uint32_t n, uint32_t which);
/* End of a tile: lanes into doubles (in `work`); then in `merge` into targets[which][nfloats], which also empties the
 * buffers. */
void accum_close(Accum *a);
void accum_merge(Accum *a, double *const *targets);

/* ---- cull.c: lists of [Cull] iterations for a rectangle of the domain */
typedef struct CullBoxes {
    uint32_t n;
    double **box; /* by cull_id: [count][4] lo.x lo.y hi.x hi.y */
    const uint32_t *count;
} CullBoxes;
SltStatus cull_boxes(CullBoxes *c, const SltScene *s, SltError *err);
void cull_free(CullBoxes *c);
typedef struct CullLists {
    SltCullList *list; /* by cull_id */
    int32_t **items;
} CullLists;
bool cull_lists_init(CullLists *l, const CullBoxes *c);
void cull_lists_free(CullLists *l, const CullBoxes *c);
/* Lists for the rectangle [lo, hi]; `args.cull` of the batch points at them afterwards. */
void cull_select(const CullBoxes *c, CullLists *l, Batch *b, const double lo[3], const double hi[3]);

/* ---- depth.c: scenes with depth. A histogram of the differences between neighbours with equal hashes */
enum { SPREAD_BUCKETS = 160 };
typedef struct Spread {
    uint64_t n, edges; /* edges: of lines */
    uint32_t count[SPREAD_BUCKETS];
    uint32_t odd[SPREAD_BUCKETS]; /* of lines: those that stand out beside their neighbours */
} Spread;
void spread_clear(Spread *s);
void spread_add(Spread *s, double difference);
/* The edges of a line of n vertices. */
void spread_line(Spread *s, const uint32_t *hash, const double *depth, uint64_t stride, uint32_t n);
/* J: the difference beyond which two neighbours are worth a search. */
/* In an image J is this many times larger: edges asked in vain are what the boundary term of a terrain costs, and what
 * is lost are jumps of a few ordinary steps. */
#define DEPTH_COARSE 3.0
double spread_jump(const Spread *s);
/* J of edge e of a line of n vertices, from that of its tile and from the edges beside it. */
double depth_jump(const uint32_t *hash, const double *depth, uint64_t stride, uint32_t e, uint32_t n, double jump);
/* An infinite depth (a ray that starts in the ground) is no jump. */
static inline bool depth_differs(double a, double b, double jump) {
    double d = a < b ? b - a : a - b;
    return d > jump && d < HUGE_VAL;
}

/* ---- finder.c */
/* What is known of a point: its region, its depth where the scene has one, and what its rays met (0: not known). */
typedef struct Mark {
    uint32_t hash;
    double depth;
    int32_t witness[SLT_WITNESSES];
} Mark;
/* Of lane i of a call of the region or sides kernel. */
Mark batch_mark(const Batch *b, uint32_t i);

typedef struct Segment {
    double a[3], b[3]; /* ends of the whole segment; x(t) = a + t (b - a) */
    double ta, tb;     /* the part still to be searched */
    double base;       /* A_i / N_i of a line, or the weight of a random segment */
    Mark ma, mb;       /* at ta and tb */
    double jump, ask;  /* ask: what `event` is told instead, if not 0. jump: by how much depths differ across a
                          silhouette; HUGE_VAL in scenes without depth */
    double rand0;
    int32_t stream;
    int8_t axis;        /* of the line; -1: a random direction */
    uint8_t depth, cls; /* cls: which adjoint buffer, see Sink */
    uint8_t field;      /* see finder.c */
    uint32_t edge;      /* of the lattice's tile: 1 + its first vertex; 0: none */
    double cut;         /* where to bisect; 0: in the middle */
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
typedef struct Sink Sink;
struct Finder {
    Batch *b;
    const SltScene *s;
    Segment *stack;
    uint32_t n, cap;
    Segment *split; /* to be bisected on the hash */
    uint32_t nsplit;
    Crossing *found;
    uint32_t nfound;
    void (*full)(void *user, Crossing *c, uint32_t n); /* called with at most BATCH crossings */
    void *full_user;
    void *items; /* of the batch in hand */
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
void finder_add(Finder *f, Segment *s, Mark a, Mark b, double jump);
/* A segment whose ends differ. */
void finder_push(Finder *f, const Segment *s);
/* Works off full batches; everything when `all`. */
void finder_run(Finder *f, bool all);
void segment_at(const Segment *s, double t, double x[3]);
/* Sorts order[0..n) ascending. */
void sort_keys(uint64_t *order, uint32_t n);

/* ---- sink.c: what becomes of crossings */
typedef enum SinkKind { SINK_INTEGRAL, SINK_REVERSE, SINK_FORWARD, SINK_KEEP } SinkKind;
typedef struct Directions {
    uint32_t n;
    void **flt; /* [n]: flt[nfloats] */
} Directions;
typedef struct Follow Follow;
/* A scene whose parameters are moved: difference.c */
typedef struct Moved {
    SltScene scene;
    void *params;
    struct SltGeometry *geometry; /* moved copies */
    const struct SltGeometry **geometries;
} Moved;
/* Along dir (NULL: along axis p). Free it, whatever the result. */
bool scene_move(Moved *m, const SltScene *s, const double *dir, uint32_t axis, double h);
void moved_free(Moved *m);

/* ---- coincide.c: crossings on which another boundary lies, see there */
enum { COINCIDE_MAX = 8, COINCIDE_WAYS = 4 };
typedef struct Coincide {
    const Moved *apart;                                    /* [COINCIDE_WAYS], or NULL: nothing is looked for */
    uint32_t n, which[COINCIDE_MAX], stands[COINCIDE_MAX]; /* crossings to ask, and how many each stands for */
    double way[COINCIDE_MAX][COINCIDE_WAYS];
} Coincide;
struct Sink {
    SinkKind kind;
    Batch *b;
    Accum *acc;
    Finder *f; /* counters of dropped crossings */
    const Grid *grid;
    double scale[3];        /* s_j of the weights */
    const float *adjoint;   /* SINK_REVERSE */
    uint32_t classes;       /* adjoint buffers of SINK_REVERSE: 1, or COSETS */
    const Directions *dirs; /* SINK_FORWARD: into splat, double[dir][pixel of the rectangle][channel] */
    double *splat;
    float *count;       /* crossings, same rectangle, may be NULL */
    uint64_t splat_cap; /* doubles of splat: it grows with the largest rectangle */
    uint32_t rect_lo[3], rect_n[3];
    Crossing *kept; /* SINK_KEEP */
    uint64_t nkept, kept_cap;
    uint64_t *order;
    Coincide coincide;
    Follow *follow; /* NULL: nobody asks */
    bool clip;      /* drop crossings outside the domain */
    bool failed;
};
bool sink_init(Sink *k, SinkKind kind, Batch *b, Accum *acc, Finder *f, const Grid *g);
void sink_free(Sink *k);
void sink_take(void *sink, Crossing *c, uint32_t n);
/* g and its gradient at each crossing, then the weight; false in keep[] where nothing can be integrated. reason may be
 * NULL. */
void sink_weigh(Sink *k, Crossing *c, const uint64_t *order, uint32_t n, bool *keep);
/* A lane of the site kernels. */
void sink_put(Sink *k, uint32_t lane, const Crossing *c);
bool sink_rect(Sink *k, const double lo[3], const double hi[3]);
/* Adds the rectangle to the images, in tile order. */
void sink_merge_splat(Sink *k, float *const *out, float *crossings);

/* ---- a call */
typedef struct Worker {
    Batch batch;
    Accum acc;
    Finder finder;
    Sink sink;
    CullLists cull;
    uint32_t *hash;   /* of a tile of vertices, or of lines */
    double *depth;    /* NULL without depth */
    int32_t *witness; /* [vertex][of region]; NULL without */
    float *near_g;    /* |g| of the nearest event, its key */
    uint32_t *near_key;
    int32_t *near_event; /* site, k0.. of it, SoA by vertex */
    uint64_t vertex_cap;
    double *value; /* of the tile: pixels or sums */
    uint64_t value_cap;
    void *scratch;  /* near.c's candidates */
    Follow *follow; /* NULL: off */
    uint64_t counters[SLT_COUNTERS];
    bool failed;
} Worker;

typedef struct Run {
    const SltScene *s;
    const SltJob *j;
    Grid grid;
    CullBoxes cull;
    Worker *worker;
    uint32_t nworkers;
    PoolOptions pool;
    Moved *apart;   /* [COINCIDE_WAYS] */
    SltStats stats; /* added to by merge */
    SltError *err;
    double start;
} Run;
SltStatus run_begin(Run *r, const SltScene *s, const SltJob *j, SltError *err);
/* Adds the run's counts to `stats` (may be NULL) and frees everything. */
void run_end(Run *r, SltStats *stats);
void stats_add(SltStats *to, const SltStats *s); /* to may be NULL */
/* Workers with `accums` adjoint buffers and a sink. */
SltStatus run_workers(Run *r, uint64_t tiles, uint32_t accums, SinkKind kind);
void run_free_workers(Run *r);
SltStatus run_tiles(Run *r, uint64_t tiles, PoolWork *work, PoolMerge *merge, void *user);
/* In `merge`: the worker's counters join the run's. */
void run_collect(Run *r, Worker *w);
bool worker_vertices(Worker *w, uint64_t n);
Mark worker_mark(const Worker *w, uint64_t vertex);
bool worker_values(Worker *w, uint64_t n);
void *alloc_zero(size_t n, size_t size);

/* Before the first crossing, and when all is done. Crossings order[from..to) of `all`, of one site and with their
 * gradients; then the count, when all groups have been given. */
bool coincide_begin(Run *r, double bracket); /* of roots, in parts of the domain */
void coincide_end(Run *r);
void coincide_group(Sink *k, const Crossing *c, const uint64_t *order, const bool *keep, uint32_t from, uint32_t to,
                    uint32_t all);
void coincide_count(Sink *k, const Crossing *c);

/* ---- interior.c: the samples of f */
typedef struct Interior {
    Run *run;
    uint32_t half;  /* 0: all samples; 1, 2 */
    uint32_t count; /* samples of a pixel */
    uint32_t tile[3], tiles[3];
    uint64_t ntiles;
    /* value: one of */
    float *image;
    /* reverse */
    const float *adjoint;
    double factor; /* of every seed */
    uint32_t classes;
    double *const *targets;
    /* forward */
    const Directions *dirs;
    float *const *out;
} Interior;
SltStatus interior_image(Run *r, uint32_t half, float *image);
SltStatus interior_reverse(Run *r, uint32_t half, const float *adjoint, double factor, uint32_t classes,
                           double *const *targets);
SltStatus interior_forward(Run *r, const Directions *d, float *const *out);
/* Integral over the domain of every channel, replicate r of n: value[channels]; gradient [channels][nfloats] when not
 * NULL. */
/* Shift of replicate r of n along dimension d: one random number for all, and a stratum each, in another order for each
 * dimension. So the mean over replicates is as good as lines n times denser, and their spread is an upper estimate of
 * its error. */
double stratified_shift(double u, uint32_t r, uint32_t n, uint32_t d);

SltStatus interior_integral(Run *r, uint32_t replicate, uint64_t samples, double *value, double *gradient);

/* ---- boundary: segments of one estimator into the run's sinks. In integral mode of replicate `rep` with `segments` of
 * them; targets as the sink wants. */
typedef struct Boundary {
    Run *run;
    uint32_t replicate, replicates; /* of how many; their shifts are strata of one another */
    double segments;                /* a pixel, or in all */
    double *const *targets;         /* SINK_INTEGRAL: [channels], then [channels] of missed; SINK_REVERSE: [classes] */
    float *const *out;              /* SINK_FORWARD */
    float *crossings;
    const float *adjoint;
    const Directions *dirs;
    uint32_t classes;
} Boundary;
SltStatus boundary_run(Boundary *y, SinkKind kind);
SltStatus lattice_run(Boundary *y);
SltStatus scanline_run(Boundary *y);
SltStatus segments_run(Boundary *y, SinkKind kind);
/* Sets up a worker's sink for this boundary before its first tile. */
void boundary_bind(Boundary *y, Worker *w, SinkKind kind);
void boundary_merge(Boundary *y, Worker *w);

/* ---- near.c: near-miss probe on a line of vertices already evaluated */
typedef struct Line {
    const double *pos;      /* positions along the axis, by vertex */
    uint64_t first, stride; /* into the worker's vertex arrays */
    uint32_t n;             /* vertices */
    uint32_t from, to;      /* edges [from, to) to be probed: edge e joins vertices e and e+1 */
    bool at_start, at_end;  /* vertex 0 / n-1 ends the line: one-sided gradients there */
    double jump;            /* edges whose depths differ by more are searched already */
} Line;
/* `like` is a segment with everything but ends and hashes; its a and b hold the other coordinates. */
void near_probe(Worker *w, const Line *l, const Segment *like);
void near_flush(Worker *w);
bool near_init(Worker *w);
/* Evaluates region on n vertices of the batch, storing hash and near-miss record at vertex index `at`. */
void vertices_call(Worker *w, uint32_t n, uint64_t at);

/* ---- follow.c: a two-dimensional lattice's tile, in its own numbers */
typedef struct FollowTile {
    const double *pos[2];
    const uint32_t *hash; /* NULL: a visit, nothing is known of the vertices */
    const double *depth;  /* NULL without depth */
    double jump[2], base[2], spacing[2];
    uint64_t stride[2];                /* of vertices; stride[0] is 1 */
    uint32_t from[2], to[2];           /* edges of a line that the tile owns */
    uint32_t line_from[2], line_to[2]; /* lines across axis i, by their vertex on it */
    uint32_t first[2], lines[2];       /* vertex 0 of the tile in the lattice, whose lines are 1 .. lines */
    uint32_t classes;
} FollowTile;
/* A finger between l and r on a line that is another tile's, and an edge of a tile in which a probe found something. */
typedef struct FollowExit {
    uint32_t line; /* of the lattice */
    uint8_t axis;
    int8_t step;
    double l, r;
} FollowExit;
typedef struct FollowFound {
    uint32_t edge;
    uint8_t axis;
} FollowFound;
Follow *follow_new(void);
void follow_free(Follow *f);
bool follow_begin(Follow *f, const FollowTile *t, uint64_t vertices);
/* Before their crossings are looked for: edges of a line, by their first vertex, whose ends differ; an edge in which
 * another probe found something. */
void follow_line(Follow *f, uint32_t axis, uint32_t line, const bool *searched);
void follow_found(Follow *f, uint32_t axis, uint32_t edge);
/* A crossing with its gradient. */
void follow_note(Follow *f, const Crossing *c);
/* When all the tile's segments are done; and then what is to be kept for the others, valid until the next tile. */
bool follow_run(Worker *w);
const FollowExit *follow_exits(const Follow *f, uint32_t *n);
const FollowFound *follow_seen(const Follow *f, uint32_t *n);
/* On a visit, between follow_begin and follow_run: what the tile has found, then who comes. */
void follow_known(Follow *f, const FollowFound *known);
void follow_enter(Follow *f, const FollowExit *in);

/* ---- difference.c */
SltStatus difference_forward(const SltScene *s, const SltJob *j, uint32_t ndir, const double *const *dirs,
                             float *const *out, SltStats *stats, SltError *err);
SltStatus difference_reverse(const SltScene *s, const SltJob *j, const float *const adjoint[2], double *gradient,
                             double *stderr_bound, SltStats *stats, SltError *err);
SltStatus difference_integral(const SltScene *s, const SltJob *j, SltIntegral *out, SltStats *stats, SltError *err);

#endif
