/* Cells of the domain, and the points that integrate over them.
 *
 * A tile (a box of the domain) is cut into cells until bounds prove of each that it is *settled*, nothing in it jumps
 * or bends, or *curved*: the events that are open in it are graphs of functions over one face. Settled cells give
 * points of a tensor Gauss rule; curved ones points along their curves, and points on both sides of these. What is left
 * at the least size, or when the budget is spent, is handed over as it is. Saye, "High-order quadrature methods for
 * implicitly defined surfaces and volumes in hyperrectangles" (2015), with bounds from the program itself.
 *
 * A worker owns one Cells, which uses the worker's batch. Everything handed to a CellSink lives for the time of that
 * call. Deterministic: what comes out depends on tile, scene and options alone. */
#ifndef SALTUS_QUADRATURE_CELLS_H
#define SALTUS_QUADRATURE_CELLS_H

#include "runtime/base/threads.h"
#include "runtime/sample/finder.h"

/* fmax and fmin are calls, which count in loops over points, and over parameters where these are many. Of a NaN and a
 * number: the second. */
static inline double larger(double a, double b) { return a > b ? a : b; }
static inline double smaller(double a, double b) { return a < b ? a : b; }

/* A box of the domain: all points of the program's precision with lo <= x <= hi. Its measure goes up to `end`. In
 * general that is hi, and neighbours share the points of their face: of a jump between two adjacent floats both then
 * lie in one of the boxes, even where the shape ends exactly on the face. Only where a box was cut at a seam, on whose
 * two sides all is different, hi is the float before end, which belongs to the neighbour alone. */
typedef struct Box {
    double lo[3], hi[3], end[3];
} Box;

/* Each integral is taken twice on the same cells: by a rule of Q points, and by one of fewer whose distance from the
 * first states the error. */
typedef enum CellRule {
    CELL_FINE,
    CELL_COARSE,
    CELL_RULES,
    CELL_BOTH = CELL_RULES, /* of a point of the volume, CellOptions.flat: it is one of either */
    CELL_POINTS
} CellRule;

/* A point in the volume of the domain. */
typedef struct CellPoint {
    double x[3], weight; /* of f in the integral: a volume, or part of a sum that is one, which may be negative */
    double moved;        /* coarse rule: what rounding of curves may add to the weight of derivatives; of the value
                            CellCounts.moved tells */
} CellPoint;

typedef enum CellState { CELL_SETTLED, CELL_CURVED, CELL_LEFT } CellState;

/* While a sink runs, args.cull of the batch holds the lists that are good for all it was given. */
typedef struct CellSink {
    /* n <= BATCH points along curves. Of each: event, x, dg, jump, before (f where g < 0), and weight: the derivative
     * of the integral is the sum of weight * jump * d_theta g, jump being f where g > 0 less before. cls: its CellRule,
     * the same of all. Not called where CellOptions.curves is false. */
    void (*curve)(void *user, Crossing *c, uint32_t n);
    /* n <= BATCH points in the volume, of one rule or of both; all lie in `within`, the cell or its tile. Not called
     * where CellOptions.volume is false. */
    void (*volume)(void *user, const CellPoint *p, uint32_t n, CellRule rule, const Box *within);
    /* A point of which f is known already; NULL: those too come as all others do. */
    void (*value)(void *user, double weight, const double *f, CellRule rule);
    /* f is this constant in all of a cell, and no points are needed; NULL: points come all the same. */
    void (*constant)(void *user, const Box *cell, const double *f);
    /* A cell that is neither settled nor curved. bounds[2 * channels]: lo and hi of f by channel, infinite where not
     * known. apart: how often the tolerance goes into what the rules differ by there, of a curved cell of 3D that was
     * to be cut for that, when evaluations ran out; else 0. */
    void (*left)(void *user, const Box *cell, const double *bounds, double apart);
    /* The curves in the cell were handed over; its volume is cut no further. True: the sink sees to it. False, or NULL:
     * what two points of it give stands for it, which are handed over. bounds: as of left. */
    bool (*sampled)(void *user, const Box *cell, const double *bounds);
    /* For pictures and counts, every final cell; may be NULL. */
    void (*cell)(void *user, const Box *cell, CellState state);
    void *user;
} CellSink;

typedef struct CellOptions {
    bool curves, volume; /* which points are wanted */
    bool seams;          /* does f jump at seams that move? (SltScene.edge_upsets) */
    uint32_t gauss;      /* points along a piece of a curve and along each side of a cell, fine rule */
    uint32_t coarse;     /* likewise of the coarse rule; 0: no coarse points */
    uint32_t few;        /* at least along a piece that is short for how its curve bends; less than 2: 2 */
    bool flat;  /* f and its derivatives, times the filter, are constant between curves and seams: a place for each part
                 */
    bool fixed; /* --gauss: pieces are not cut further where the two rules differ */
    double tolerance; /* of the two rules on one piece, in parts of the integral of |jump| over a curve as long as the
                         domain is wide; pieces that differ more are halved */
    double seen;      /* |f| is known to be that large somewhere in the domain: 0 where that is not known */
    bool fewer;       /* points of the volume may be fewer where they tell f all the same, if not its derivatives */
    uint32_t tall;    /* 3D: points along columns, as a tile needed them; 0: as many as along other lines */
    double slack; /* of roots beside which f is not asked, in parts of the lines that they lie on; 0: the last floats */
    double least; /* side of the least cell, in parts of the domain */
    bool curves_done;        /* of this tile curves were handed over before: the volume alone is wanted */
    const PoolOptions *pool; /* cutting ends where the pool must stop, whatever is left; NULL: never */
    bool divides;            /* the tile itself is known to be no cell */
    bool returns;            /* what is left when the budget is spent comes back, cell by cell, */
    bool last;               /* 3D: no cell is cut because the rules differ, for that there are no evaluations */
    bool trial;              /* only what cells cost is asked: no peaks are hunted */
    uint64_t budget;         /* evaluations that this tile may spend, those of the sink included; 0: no limit */
    /* Of an image: cells end where the filter bends, multiples of `grid` from `grid_lo` along each axis; 0: nowhere */
    double grid[3], grid_lo[3];
} CellOptions;

typedef struct CellCounts {
    double settled, curved, left;  /* measures, in units of the domain */
    uint64_t cells, boxes, points; /* final cells; evaluations of bounds, and of anything at a point */
    uint64_t tried;                /* curved cells of 3D that were to be integrated */
    uint32_t tall;                 /* points that columns in them needed beside their curves; 0: there were none */
    uint64_t coincident;           /* points of curves that coincide and move apart, where there is no derivative; */
    SltPlace coincident_at;        /* the least of them */
    double banded; /* measure of cells, counted as curved, with curves whose order rounding hides; f depends on it */
    /* What rounding of g may make of curves: of the value, by channel; of derivatives, the integral of |jump| along
     * curves, and of |jump| * Root.blur. */
    double moved[SLT_MAX_CHANNELS], weighed, blurred;
    bool spent; /* the budget was */
    bool loose; /* roots ended where CellOptions.slack lets them */
    /* Where f jumps at seams that tagged decisions hang on, which nothing integrates: measure of the cells, which count
     * as settled or curved all the same; the integral of |jump| along them, by channel; 1 + the first such seam, 0:
     * none */
    double upset, upset_jump[SLT_MAX_CHANNELS];
    uint32_t upset_edge;
    double rims[SLT_MAX_CHANNELS]; /* likewise of what f changes by between a seam and the nearest place, where it is a
                                      small power of the distance */
    /* Jumps of roots beside which f may be rough, and of those beside which it is a small power; no integrals. */
    double rough_jump, rim_jump;
} CellCounts;

/* What a cell of 3D costs that is integrated, in parts of what those cost on average that were to be. */
#define CELL_GOES_OUT 1.5

/* Is every site about a ray? Bounds make no curves of these. */
bool cells_ask_rays_alone(const SltScene *s);

typedef struct Cells Cells;
/* b, and what it points to, outlives the Cells. NULL when memory runs out. */
Cells *cells_new(Batch *b, const double lo[3], const double hi[3]);
void cells_free(Cells *c);
/* Cuts the tile, hands everything over and adds to `counts`. False when memory runs out. */
bool cells_run(Cells *c, const Box *tile, const CellOptions *o, const CellSink *sink, CellCounts *counts);

#endif
