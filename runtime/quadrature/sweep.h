/* One sweep over the domain: its tiles are cut into cells, whose points go through the kernels, and then lines and
 * samples go through what is left over.
 *
 * A Sweep is made once a call, and run as often as the error asks for. What a tile gives is kept by its worker until
 * `merge`; what is left is listed in the order of tiles, and its cells are worked off in chunks of the list: the same
 * bits from any number of threads. */
#ifndef SALTUS_QUADRATURE_SWEEP_H
#define SALTUS_QUADRATURE_SWEEP_H

#include "runtime/quadrature/kept.h"
#include "runtime/quadrature/sums.h"
#include "runtime/sample/run.h"

typedef enum SweepKind {
    SWEEP_INTEGRAL, /* value and gradient of every channel */
    SWEEP_RENDER,   /* an image */
    SWEEP_FORWARD,  /* derivative images */
    SWEEP_REVERSE,  /* the gradient of an image weighed by an adjoint image */
    SWEEP_LOSS      /* a squared loss and its gradient, under the box filter: loss.c */
} SweepKind;

enum {
    LEFT_COST = 40,  /* evaluations that a cell costs which is left over, in a plane */
    MARCH_COST = 64, /* the same, where curves are followed; 36 to 50 on real ground */
    HIDDEN_COST = 8, /* and what it costs to tell what is open in a cell in which nothing is looked for */
    LEFT_CHUNK = 64  /* cells of the list of what is left that are worked off together */
};
/* A cell that bounds leave over. */
typedef struct LeftCell {
    Box box;
    double bounds[2 * SLT_MAX_CHANNELS]; /* as CellSink.left gets them */
    double stands;                       /* for so many cells like it; 0: another one stands for it */
    double asked;                        /* for so many cells bounds tell what lines may have missed; 0: not asked */
    uint8_t halvings, loose, set; /* march.c: how often it was quartered, and in vain; of two sets of cells that stand
                                     for others */
    double apart;                 /* as of CellSink.left */
    bool curved;                  /* its curves are integrated: the volume beside them waits for evaluations to spare */
} LeftCell;

typedef struct SweepWorker SweepWorker;
typedef struct Sweep {
    Run *run;
    SweepKind kind;
    bool boundary, interior;    /* of the gradient: which parts are wanted */
    bool value;                 /* SWEEP_INTEGRAL: of f as well */
    bool errors;                /* two rules, and two sets of lines */
    const float *adjoint;       /* SWEEP_REVERSE: an image */
    const float *target, *mask; /* SWEEP_LOSS: images; mask may be NULL */
    float *image, *weighed;     /* SWEEP_LOSS: the render, which may be NULL; room for the adjoint image */
    const Directions *dirs;     /* SWEEP_FORWARD */
    float *const *out;          /* SWEEP_RENDER: one image; SWEEP_FORWARD: by direction */
    float *crossings;           /* SWEEP_FORWARD: points of curves, by pixel; may be NULL */
    double segments, samples;   /* of lines and samples, in all, if everything were left */
    CellOptions options;
    double least_ever, deeper; /* cells that are left at options.least are cut down to this size, for so many times what
                                  the sweep has cost */
    uint32_t parts;        /* SWEEP_INTEGRAL: by how much tiles are smaller along each axis than the usual ones; 0: 1 */
    uint64_t budget;       /* evaluations of the whole sweep, cells and what is left; 0: no limit */
    bool wanted;           /* an error is: lines through what is left are as many as makes sense beside cells */
    double left_share;     /* of the budget, for what is left */
    uint64_t cells_budget; /* of the cells alone, if less; 0: no limit of its own */
    double only_if_left;   /* if cells leave over more than this share, the sweep ends with them; */
    double only_if_cost;   /* or, where it marches, if it would cost more evaluations than this; 0: no matter */
    /* What comes out. */
    Sums sums; /* SWEEP_INTEGRAL, SWEEP_REVERSE */
    double f[SLT_MAX_CHANNELS], f_error[SLT_MAX_CHANNELS], f_variance[SLT_MAX_CHANNELS]; /* SWEEP_INTEGRAL: the value */
    double f_hidden[SLT_MAX_CHANNELS]; /* what cells whose volume is only sampled can hide of it, at most */
    bool gave_up;                      /* it has ended so */
    bool failed;                       /* memory ran out where tiles are merged */
    bool short_of_volume;              /* evaluations ran out where curves were known, but not the volume beside them */
    double loss;                       /* SWEEP_LOSS: sum over pixels and channels */
    double left_bound; /* what is left can hide of the value of any channel, at most; infinite: not bounded */
    CellCounts counts;
    /* Inner. */
    SweepWorker *worker;
    Box *tile;
    uint32_t pixels[3], tiles[3]; /* by axis: of an image's tile; tiles of the first round */
    uint64_t ntiles, tile_cap;
    LeftCell *left;
    uint64_t nleft, left_cap;
    LeftCell *parent; /* [nparents]: of the tiles, where they are cells that were left; else none */
    uint64_t nparents, parent_cap;
    double worst;     /* of cells that are left unfinished those whose rules differ by as much are next */
    bool waits, ends; /* volume that a tile had no evaluations for goes to `left`, for another round; there is none */
    Box *beside;      /* [nbeside]: cells of which the curves are integrated, and the volume gets samples */
    uint64_t nbeside, beside_cap;
    double density;                  /* of these samples */
    double volume;                   /* of the domain */
    double volume_sampled;           /* measure of cells whose volume is only sampled */
    uint32_t lines;                  /* across a cell that is left, along each axis */
    uint64_t differ, unseen;         /* of segments in such cells: whose ends differ, and that lines with half as many
                                        vertices would not have seen */
    uint64_t first_chunk;            /* of the part of the list that is worked off */
    Apart *apart;                    /* for boundaries that coincide there; NULL: not looked for */
    bool marches;                    /* in cells that are left curves are followed from side to side: march.c */
    bool sampled;                    /* cells that are left stand for others */
    bool hides, cuts;                /* lines in them may step over what counts; they do: cut.c */
    bool mixed;                      /* lines or samples were used */
    bool unnamed;                    /* more events are open in what is left than bounds name */
    double jump[SLT_MAX_CHANNELS];   /* the largest at the curves of cells */
    double gone[SLT_MAX_CHANNELS];   /* what lines there could not integrate: sums_gone */
    double narrow[SLT_MAX_CHANNELS]; /* what boundary cells may hold that are narrower than floats tell apart */
} Sweep;
/* Between runs of tiles: has memory run out? A worker says so of what it did on its own. */
bool sweep_failed(const Sweep *p);
/* The members above `sums` are the caller's; `run` has begun. */
SltStatus sweep_begin(Sweep *p);
void sweep_end(Sweep *p);
SltStatus sweep_run(Sweep *p);

/* ---- what sweep.c, sweep_left.c and left.c share */
static inline double sweep_measure(const Box *b, uint32_t dim) {
    double m = 1;
    for (uint32_t d = 0; d < dim; d++) m *= b->end[d] - b->lo[d];
    return m;
}
struct SweepWorker {
    Sweep *sweep;
    Worker *w;
    Cells *cells;
    CellCounts counts;
    LeftCell *left; /* [nleft]: of the tile in hand */
    uint64_t nleft, left_cap;
    Box *beside; /* [nbeside]: likewise */
    uint64_t nbeside, beside_cap;
    double f[CELL_RULES][SLT_MAX_CHANNELS]; /* sums of the tile */
    double f_hidden[SLT_MAX_CHANNELS];      /* as in Sweep */
    double f_unit[SLT_MAX_CHANNELS];        /* of cells that are left: what one sample may make of the value, at most */
    double left_bound, loss;
    double volume_sampled;         /* measure of cells of the tile whose volume is only sampled */
    double jump[SLT_MAX_CHANNELS]; /* as in Sweep; of this worker's tiles */
    bool unnamed;
    double gone[SLT_MAX_CHANNELS]; /* as in Sweep; of the chunk in hand */
    double narrow[SLT_MAX_CHANNELS];
    uint64_t differ, unseen;   /* segments of lines, so far, as in Sweep; */
    uint64_t differ0, unseen0; /* and before the chunk in hand */
    const LeftCell *within;    /* the cell that the tile is; NULL: no such one */
    uint8_t owner;             /* which cell of its chunk lines go through: Segment.owner */
    struct Hidden *hidden;     /* hidden.c: room for a chunk; NULL until it is needed */
    struct March *march;       /* march.c, likewise */
    Splat splat;               /* SWEEP_RENDER, SWEEP_FORWARD: planes of the interior; SWEEP_LOSS: pixels of the tile */
    Kept kept;                 /* SWEEP_LOSS */
    double vain;               /* share of the cells that left_cut gave up */
    bool failed;               /* memory ran out */
};
/* What bounds say that a cell which is left can hide of the value: measure times the largest range of a channel. */
double sweep_hidden(const Sweep *p, const LeftCell *l);
/* The axis along which a box is but a gap between two floats, whose two sides nothing can be put between; -1: none. */
int sweep_gap(const Sweep *p, const Box *b);
/* Nothing is summed up yet, and lists of culling are those of the box; then planes of pixels. False when memory runs
 * out. */
void sweep_begin_tile(SweepWorker *v, const Box *box);
bool sweep_begin_splat(SweepWorker *v, const Box *box);
/* In `merge`: what the worker's tile, or chunk, has gathered. lines: as of sums_merge. */
void sweep_merge_sums(Sweep *p, SweepWorker *v, SumMode mode, double lines);
/* ---- sweep_left.c: lines through the cells of the list, and samples in them, for what the budget still holds. start:
 * evaluations before the sweep. */
SltStatus sweep_work_off_left(Sweep *p, uint64_t start);
/* Would curves through what is left cost too much? How many evaluations a cell takes hangs on how loose bounds are
 * there, and how many curves it holds: a few cells tell, all over the list. */
bool sweep_march_is_dear(Sweep *p, uint64_t used);
/* Derivatives of f at points, weighed by the adjoint image. */
void sweep_volume_reverse(SweepWorker *v, const CellPoint *p, uint32_t n, CellRule rule);
/* Points of the volume: CellSink.volume. */
void sweep_volume(void *worker, const CellPoint *p, uint32_t n, CellRule rule, const Box *within);
/* ---- sweep_beside.c: is the volume of this cell, of which the curves are integrated, for the samples of
 * sweep_sample_beside? Else it is for two points: where the lattice would have less than one. */
bool sweep_takes_beside(const Sweep *p, const Box *cell);
SltStatus sweep_sample_beside(Sweep *p);
/* Room for one more box; false when memory runs out. */
bool sweep_room_beside(Box **list, uint64_t n, uint64_t *cap);
/* ---- left.c: lines, or samples, in a cell; n: lines across it along each axis, even; set: -1, or to which set of
 * estimates all of them belong. False when memory runs out. */
bool left_lines(SweepWorker *v, const LeftCell *c, uint32_t n, int set);
void left_samples(SweepWorker *v, const LeftCell *c, uint32_t n, int set);
/* What crossings of the chunk in hand are divided by for the error of its lines. */
double left_divisor(const SweepWorker *v);
/* ---- cut.c: lines through those of n <= LEFT_CHUNK cells, the from-th of the list and so on, that are not done, cut
 * by bounds until nothing is open on their parts. done: set where bounds know the cell; seen: where a crossing is
 * found. False when memory runs out. */
bool left_cut(SweepWorker *v, const LeftCell *l, uint64_t from, uint32_t n, bool *done, bool *seen);
/* Do lines that are not cut step over much of what the cells hold? A few of the list tell, for so many evaluations. */
bool left_hides(SweepWorker *v, double spend);
/* ---- march.c: the curves in n <= LEFT_CHUNK cells, where `marches`; they have no other lines. dry: nothing comes out
 * but what it costs. False when memory runs out. */
bool left_curves(SweepWorker *v, const LeftCell *c, uint32_t n, bool dry);
/* Room for one more cell in v->left; false when memory runs out. */
bool sweep_room_left(SweepWorker *v);
/* ---- hidden.c: adds to the stated error what lines may have missed in n <= LEFT_CHUNK cells; seen[i]: they have met
 * something in cell i; lost[i]: and could not integrate it. After the finder has run. False when memory runs out. */
bool left_hidden(SweepWorker *v, const LeftCell *l, uint32_t n, const bool *seen, const bool *lost);
/* ---- loss.c: the gradient of a tile whose points are kept. False when memory runs out. */
bool loss_tile(SweepWorker *v, uint64_t tile);

#endif
