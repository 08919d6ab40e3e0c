/* What the files of runtime/quadrature/cells*.c share.
 *
 *   cells.c         the tree: nodes, their sub-boxes, what is settled, points in it, what is left
 *   cells_edge.c    kernels at many points and boxes of many events; which open events are really open, and along
 *                   which axis each is a graph
 *   cells_given.c   events whose g others change: what these decide is given
 *   cells_prune.c   straight-line programs: what runs in a node, open choices as edges
 *   cells_same.c    choices between values that are the same
 *   cells_root.c    roots of g on lines, many at once, and f on their two sides
 *   cells_rounding.c what rounding makes of roots, and so of curves
 *   cells_base.c    2D: where along its base the shape of a curved cell changes
 *   cells_stretch.c that asked of stretches of the base, until bounds prove the answer
 *   cells_border.c  areas by what bounds them, where f is constant between curves
 *   cells_points.c  how many points a piece gets, and where
 *   cells_column.c  pieces of the base become columns, these roots and crossings
 *   cells_arc.c     pieces of one quadric, with f constant on both sides, become crossings at once
 *   cells_twins.c   curves that lie on each other as far as rounding lets one tell: what is between them
 *   cells_tied.c    whose the jump is
 *   cells_kinks.c   curves of a g that has a kink in the parameters
 *   cells_solid.c   3D: planes through a cell, each a cell of 2D
 *   cells_gap.c     curves that lie in the gap between two floats at which a cell was cut, several on one line untied
 *   cells_upset.c   seams at whose jump tagged decisions change
 *   cells_layer.c   f that climbs so steeply next to a curve that points miss it
 *   cells_steep.c   or away from curves
 *   cells_agree.c   do the rules agree on curves?
 *   cells_parts.c   how many points a column gets between its roots
 *   cells_volume.c  points of the volume: between the roots of columns, and in boxes where f is smooth
 *
 * A curve g = 0 in a cell is a graph over the *base*, the other axes: its height is the one root of g on the *column*
 * above a point of the base, along the *height axis*. On a *piece* of the base the same curves lie in the same order
 * above every point, and nothing that decides changes along any of them. */
#ifndef SALTUS_QUADRATURE_CELLS_INNER_H
#define SALTUS_QUADRATURE_CELLS_INNER_H

#include <math.h>

#include "runtime/quadrature/cells.h"
#include "runtime/quadrature/gauss.h"
#include "runtime/quadrature/lists.h"
#include "runtime/sample/prune.h"
#include "runtime/sample/untie.h"

enum {
    CELL_BOXES = 240, /* in hand at once: of a node its halves along all axes, and theirs, 4 + 16 or 8 + 64 */
    CELL_EVENTS = SLT_MAX_OPEN,
    CELL_EDGES = 2 * CELL_EVENTS, /* of a cell: an event may have several */
    CELL_FEW_EVENTS = 4,          /* of a cell that is not yet small, in 2D, */
    CELL_FEW_GIVEN = 3,           /* and of halves, where each may have an edge for every way in which others decide */
    CELL_GIVEN = 8, /* events that are given: SLT_GIVEN by the kernels, the others choices of a straight-line program */
    CELL_CHOICES = 3,  /* of these most that are open in a cell */
    CELL_CLIMBING = 2, /* places on a climb of f, from a quarter of its height to three, by which it is seen */
    CELL_SHAPES = 64,  /* in hand at once */
    CELL_LONGER = 2,   /* moves that are longer than those of ties */
    CELL_FEWEST = 3,   /* points that a line through the volume gets, CellOptions.fewer */
    SITE_STRAIGHT = 1, /* g changes along one axis alone */
    SITE_BENT = 2,
    CELL_BENDS = 10, /* levels by which a cell is cut further where f or g bends at no seam */
};

/* Rules that differ by no more than so much of the tolerance may do with fewer points. */
#define CELL_FEWER 0x1p-10

/* Rounding may blur what lies so far apart, in parts of a cell, and no farther. In f32 it does reach so far: around the
 * place where curves touch, cells are small. */
static inline double cells_reach(bool f64) { return f64 ? 0x1p-16 : 0x1p-6; }

/* What other events of the cell are taken to decide. */
typedef struct Given {
    uint32_t n;
    struct {
        int32_t site, k[SLT_GIVEN_K];
        uint8_t event; /* which one in Cell.event */
        bool below;    /* where its g < 0 */
    } is[CELL_GIVEN];
} Given;

/* g and its slopes along the base and along the height axis in a corner of a cell of 2D. */
typedef struct Corner {
    double g, along, up;
} Corner;

/* g, where it is a polynomial of the second degree on a cell as far as rounding lets one tell. */
typedef struct Quadric {
    bool is, flat;         /* flat: of the first */
    double x[3], g, dg[3]; /* at x */
    double bend[3][3];     /* second derivatives */
} Quadric;

/* Its value and gradient elsewhere. */
static inline double cells_on_quadric(const Quadric *q, const double x[3], uint32_t dim, double dg[3]) {
    double g = q->g;
    if (dim == 2) { /* a good part of all time goes here */
        double u = x[0] - q->x[0], v = x[1] - q->x[1];
        g += q->dg[0] * u + q->dg[1] * v;
        dg[0] = q->dg[0], dg[1] = q->dg[1];
        if (q->flat) return g;
        double p = q->bend[0][0] * u + q->bend[0][1] * v, r = q->bend[1][0] * u + q->bend[1][1] * v;
        dg[0] += p, dg[1] += r;
        return g + 0.5 * (p * u + r * v);
    }
    for (uint32_t d = 0; d < dim; d++) g += q->dg[d] * (x[d] - q->x[d]), dg[d] = q->dg[d];
    for (uint32_t d = 0; d < dim && !q->flat; d++) {
        double more = 0;
        for (uint32_t k = 0; k < dim; k++) more += q->bend[d][k] * (x[k] - q->x[k]);
        g += 0.5 * more * (x[d] - q->x[d]), dg[d] += more;
    }
    return g;
}

/* An open event of a cell, and what is proven of its g there. An event whose g others change has an edge for each way
 * in which these may decide (cells_given.c): a g that is smooth in all of the cell, and that of the program where they
 * do decide so. */
typedef struct CellEdge {
    Event event;
    Given given;
    double g[2], slope[3][2]; /* lo and hi of g, and of its gradient */
    double error;             /* g as computed is no farther than this from g without rounding */
    Quadric quadric;          /* and this no farther than twice */
    uint32_t state;           /* SLT_EDGE_* */
    uint8_t before;           /* those of Cell.event[0 .. before - 1] may yet be given */
    bool same;                /* a choice between two that are the same in the middle of the cell, to rounding, */
    int8_t sense;             /* the sign of their difference all the same, where it is one; else 0 */
    int8_t rises[3];          /* sign of d_axis g, where it has one; else 0 */
    int8_t axis;              /* height axis */
    /* By face across it, by end of the base. sure: of a face that the signs of g all over it are those in its corners,
     * which change where the curve leaves the cell, if they do. cells_base.c sets them. */
    bool sure[2];
    double leaves[2];
    Corner corner[2][2];
} CellEdge;

typedef struct Cell {
    Box box;
    uint32_t level, bends; /* how often its ancestors were cut, and of these because something bends */
    uint32_t seams;        /* and at seams */
    bool curves_done;      /* the curves in it were integrated already; the volume is not */
    bool lonely;           /* few of its ancestor's parts were no cells: around a point */
    int8_t cut;            /* edge along which it is cut; -1: none */
    uint32_t node, number; /* in hand; of the cell in c->cell */
    /* A plane through a cell of 3D: the axis that it is across, its CellRule and the measure that it stands for; else
     * -1, -1 and 1. */
    int8_t slice, rule;
    double weight;
    uint32_t state;  /* SLT_BOX_* */
    uint32_t nopen;  /* as the kernel counts: more than CELL_EVENTS where they are too many */
    bool many;       /* and they are: edges are some of them */
    uint64_t same;   /* of events: choices between two values that are the same, to rounding: cells_same.c */
    uint32_t nedges; /* those that edge[] holds: may really be open */
    CellEdge edge[CELL_EDGES];
    /* What the kernel called open, in the order of execution, and what sign its g has after all; 0: it is open. */
    uint32_t nevents;
    Event event[CELL_EVENTS];
    int8_t sign[CELL_EVENTS];
    double f[2 * SLT_MAX_CHANNELS]; /* lo and hi by channel */
    uint32_t axes;                  /* bit by axis: height axes of its edges */
    bool common;                    /* it is one, for seams too: the volume can be integrated */
    uint32_t cuts;                  /* of its pieces, made because the rules differed */
    uint32_t halved;                /* stretches of its bases, and of what they were cut into */
    double apart;                   /* as of CellSink.left */
    bool refine;                    /* cannot be integrated as it is */
    bool upset, band;               /* its measure is in CellCounts.upset, in .banded already */
    bool borders;                   /* the areas of its parts are told by what bounds them: cells_border.c */
    int8_t border_axis;             /* then: whose x is integrated */
    bool done;                      /* nothing more is to be done with it */
} Cell;

/* A part of the base of a cell, and what is found there. */
typedef struct PieceEdge {
    double at, height, g, dg[3]; /* on the column above a place of the base: g and its gradient there. The place is the
                                    middle, or that of the piece before, on which nothing differs */
    double middle;               /* about its height above the middle */
    double off;                  /* by so much corners tell it too low there */
    uint32_t sides, tie;         /* as in Root, there */
    bool open, twin, band;       /* the crossing changes the region; other curves lie on this one; as in Root */
    bool upset;                  /* a seam, where f jumps */
} PieceEdge;
typedef struct Piece {
    uint32_t cell;
    int8_t axis, base; /* height axis; that of the base, -1 in 1D */
    double at[3][2];   /* by axis: the two ends, but of the height axis */
    uint32_t present;  /* bit by edge of the cell: the curve is there */
    uint32_t begins;   /* likewise: it has to do with what cuts the base where the piece begins */
    uint32_t heirs;    /* and nothing has changed since the piece before, whose edges are its own, */
    uint32_t seen;     /* and its two sides are known, be it hidden or not */
    uint32_t asked;    /* likewise: whether it is was asked of the program, not of corners */
    uint32_t halvings; /* of its base */
    uint32_t parts;    /* in which the columns are cut between roots */
    bool layered;      /* and of these each is twice as long as the one nearer to the root */
    bool graded;       /* f may have a root singularity at a curve: places are denser at the ends of base and columns */
    bool halve;        /* it is too long for the rules */
    uint8_t points;    /* of the fine rule; 0: not chosen yet. The coarse one has one less */
    double bend;       /* 1 / the length on which its curves bend, as the two rules tell; 0: not known */
    int8_t leaving[2]; /* by end: the edge whose curve leaves the cell there; -1: none */
    bool up[2];        /* and whether through the upper face */
    bool alone;        /* it is of one curve, `only`, and tells areas */
    uint8_t only;
    uint32_t arc;   /* then: c->arc[arc - 1] has its points, and it has no columns; 0: it has */
    double pace[3]; /* of one curve: how fast its base is gone along, at both ends and in the middle; all 1 else */
    double turn;    /* and the angle by which its direction changes; 0: not known */
    double beyond[2], spread[2]; /* as in Cut */
    uint32_t meet[2];            /* by end: bits of the edges whose curves meet there */
    bool within[2];              /* likewise: a half goes on there */
    bool agrees, last;           /* the rules agree on its curves; it is cut no further if they do not */
    bool smooth;                 /* likewise on f between them */
    bool layer;                  /* f lies outside of what points beside its curves have met: cells_layer */
    bool hides;                  /* bounds say that points there may miss something */
    uint32_t capped; /* bit by part, those from 31 on together: it has fewer points than its columns are long for */
    bool again;      /* and needs more */
    uint8_t depth, tries; /* most points that a column of it has between two roots; how often it got more */
    uint32_t spots[2];    /* its own: c->spot[spots[0]] .. */
    PieceEdge edge[CELL_EDGES];
} Piece;

/* A place where the base of a cell is cut, along `axis` as height axis. */
typedef struct Cut {
    uint32_t cell;
    int8_t axis, edge; /* edge: whose curve leaves the cell there; -1: two meet */
    bool up;           /* through the upper face */
    uint32_t edges;    /* bits of the one, or of both */
    double at, beyond; /* beyond: length along the base of what it has between there and the domain's border */
    double spread;     /* how far from there rounding may let two meet */
    double height;     /* of the curve that leaves; NaN: not known as well as numbers go */
} Cut;

/* A point of the curve of an arc; weight: measure of the base. */
typedef struct ArcPoint {
    double x[2], dg[2], weight;
} ArcPoint;
typedef struct Arc {
    uint32_t first, n[CELL_RULES]; /* c->arc_point[first ..]: n of the fine rule, then those of the coarse one */
    double moment[CELL_RULES][3], area[CELL_RULES], size; /* as in measure_curve and area_below */
} Arc;

/* A point of the base with the line above it. */
typedef struct Column {
    uint32_t piece, first, nroots; /* roots: c->root[first .. first + nroots - 1], ascending in height */
    uint8_t rule;                  /* CellRule */
    uint32_t spots[2];             /* its own, where f is not flat: c->spot[spots[0]] .. */
    double x[3], weight;           /* x: of the base; weight: measure of the base */
} Column;

/* What lies on the two sides of a root. */
typedef struct Sides {
    double at[2]; /* places on the axis on whose two sides g has different signs, next to the root */
    double f[2][SLT_MAX_CHANNELS];
    uint32_t hash[2];
} Sides;

/* The root of g along one axis, in a bracket in which g is monotone. */
typedef struct Root {
    const CellEdge *of;
    double x[3];       /* where; of x[axis] only a guess until it is solved */
    double ends_at[2]; /* of the line */
    double guess;      /* of x[axis], with which it began */
    double lo, hi;     /* the bracket: ends of the line, and later places where g was taken */
    int8_t axis, rises;
    bool ends[2];          /* g was taken at lo, at hi */
    double g, dg[3], step; /* g and its gradient at x; the last step */
    double before[2];      /* the place before x, and g there; NaN: there was none */
    double dg_before[3];
    /* How far from it the root may end, in parts of its line; 0: at the last floats. Less than 0: and there g is asked,
     * not taken for what cubics say. */
    double slack;
    /* By how much its slope may be off, in parts, where the place is wanted to the last floats: then nothing need be
     * asked there. HUGE_VAL: nobody asks for the slope. */
    double turns;
    /* Of columns: */
    uint32_t column;
    uint8_t edge;
    bool wanted, twin;  /* f on the two sides is; another event has its root here too */
    bool band;          /* one of a pair, of which the order is not known: cells_part_twins */
    bool solved, waits; /* waits: for a better guess */
    uint32_t other;     /* c->root[other - 1] stands for this one; 0: it stands for itself */
    uint32_t sides;     /* where they are: c->sides[sides - 1]; 0: not known */
    uint32_t between;   /* likewise, f[0]: what lies between the two, and on neither side; 0: nothing else was seen */
    double noise;       /* what g rounds by: all over the cell, or at x, where others are near (cells_twins.c) */
    double blur;        /* what rounding may make of its weight, in parts of it: cells_rounding.c */
    uint32_t tie;       /* whose the jump is: c->tie[tie - 1]; 0: its own event's */
} Root;

/* A point of the volume, before it is known whether its part is small enough. */
typedef struct Spot {
    uint32_t owner;     /* piece, or smooth box */
    uint8_t rule, part; /* part: CellOptions.flat, which one of the piece; */
    bool hashed;        /* its hash is known */
    uint32_t hash;
    double x[3], weight, moved, f[SLT_MAX_CHANNELS]; /* moved: as in CellPoint */
} Spot;

/* CellOptions.flat: parts of one hash, how large they are by each rule, and how large are the terms that adds up from.
 */
typedef struct Shape {
    bool used;
    uint32_t hash;
    double x[3], fine, coarse, moved, size;
} Shape;
typedef struct Rim Rim; /* cells_border.c */

/* How many points columns get in parts of one hash. */
typedef struct Depth {
    bool used;
    uint32_t hash;
    uint8_t points, least; /* least: fewer did not do */
} Depth;

/* A box on which f is smooth. */
typedef struct Smooth {
    double lo[3], end[3], hi[3];    /* hi: as in Box */
    double f[2 * SLT_MAX_CHANNELS]; /* bounds: those of the cell, or, where it was looked for what they hide, its own */
    uint32_t halvings;
    bool all, again; /* it gets all points of the rule; it did not, and is to be asked again with them */
    bool hunted;     /* it is to be halved for that */
    bool steep; /* a larger one was: what f changes by on a short way weighs more in derivatives, where that moves */
} Smooth;

/* g of an event at a point, or on a box. */
typedef struct Probe {
    const Event *event;
    const Given *given;
    double x[3];
    double g, dg[3];
    bool told; /* they are known already */
} Probe;
typedef struct Ask {
    const Event *event;
    const Given *given;
    double lo[3], hi[3];
    double g[2], slope[3][2], error; /* as in CellEdge */
    uint32_t state;
    double bend[6][2], slope_error[3]; /* second derivatives, by row from the diagonal on; where `bends` are known */
    uint32_t centre;                   /* probe[centre - 1] is there; 0: it was not asked */
} Ask;

typedef struct Node {
    Box box;
    uint32_t level, bends, seams;    /* as in Cell */
    bool whole;                      /* the box itself may be a cell: it was cut at a seam */
    bool curves_done, lonely, upset; /* as in Cell */
    double apart;                    /* likewise */
    ListsAt lists;
    int32_t *runs; /* straight-line programs: what runs in it (prune_keep), its own; NULL: everything */
} Node;

struct Cells {
    Batch *b;
    const SltScene *s;
    double lo[3], hi[3], volume; /* of the domain */
    uint32_t dim, depth;         /* depth: loop indices of an event */
    bool rays;                   /* every site is about rays, of which bounds make no curves */
    bool waves;                  /* of some sites the edge kernels know levels of a wave */
    const CellOptions *o;
    const CellSink *sink;
    CellCounts *counts;
    uint64_t began;                  /* evaluations counted before this tile */
    uint64_t hunted;                 /* of these, for what bounds may hide: cells_layer.c */
    uint32_t tried, differ;          /* curved cells of 3D: of this tile, and nodes that wait because rules differ */
    bool failed;                     /* memory ran out */
    bool prunes;                     /* a straight-line program, of which only some chunks run in a node */
    Pruner pruner;                   /* its level PRUNED is the node's */
    int32_t *runs[SLT_CHOICE_BOXES]; /* by box of the last call, what will run in nodes made of it; NULL: as here */
    Lists lists;                     /* of loops that have them: args.cull is the node's while it is worked on */
    double width;                    /* the longest side of the domain */
    /* graded: substituted t^2 (3 - 2 t), which makes roots at the ends polynomials */
    GaussRule rule[CELL_RULES], graded[CELL_RULES];
    GaussRule of[GAUSS_MAX + 1];        /* by number of points */
    double slack;                       /* Root.slack of columns at which f is not asked */
    double bend;                        /* Piece.bend of late: for those that come next */
    double most;                        /* |f| that points of this tile have met */
    uint32_t tall, tallest;             /* points along a column of a solid's plane: as many as f seems to need; no
                                           fewer than tallest, by what was seen in this tile */
    uint32_t broad, broadest;           /* likewise along the sides of a smooth box */
    uint32_t unasked;                   /* solids whose volume need not be compared */
    double bits;                        /* log2 of what the coarse rule may err by on a part of the volume */
    Node *stack;                        /* nodes to be worked on */
    uint32_t oldest, nstack, stack_cap; /* stack[oldest .. nstack - 1] wait */
    Cell *cell;                         /* [ncell]: boxes in hand */
    uint32_t ncell, nhalves, cell_cap;  /* the first nhalves are the large ones */
    Piece *piece;
    uint32_t npiece, piece_cap;
    Column *column;
    uint32_t ncolumn, column_cap;
    uint32_t *first_column; /* of each piece in hand */
    uint32_t first_column_cap;
    Arc *arc;
    uint32_t narc, arc_cap;
    ArcPoint *arc_point;
    uint32_t narc_point, arc_point_cap;
    Spot *spot;
    uint32_t nspot, spot_cap;
    Smooth *smooth;
    uint32_t nsmooth, smooth_cap;
    Root *root;
    uint32_t nroot, root_cap;
    Sides *sides;
    uint32_t nsides, sides_cap;
    struct Stretch *stretch; /* cells_stretch.h */
    uint32_t nstretch, stretch_cap;
    Cut *cut;
    uint32_t ncut, cut_cap;
    Rim *rim;
    uint32_t nrim, rim_cap;
    Probe *probe;
    uint32_t nprobe, probe_cap;
    Ask *ask;
    uint32_t nask, ask_cap;
    struct Beside *beside; /* cells_steep.c */
    uint32_t nbeside, beside_cap;
    uint32_t *active; /* roots that are still worked on */
    uint32_t active_cap;
    Tie *tie;
    uint32_t ntie, tie_cap;
    uint8_t *straight; /* [nsites]: SITE_*, as far as asked in this tile */
    struct Gap *gap;   /* cells_gap.c */
    uint32_t ngap, gap_cap;
    Cell *face;                 /* likewise */
    Apart *apart;               /* cells_tied.c: made when first needed */
    Apart *longer[CELL_LONGER]; /* cells_twins.c: likewise */
    Finer finer;                /* kink.c: likewise */
    Untie *untie;
    struct Trial *trial; /* cells_given.c */
    uint32_t ntrial, trial_cap;
    uint32_t *order; /* of probes and asks, by edge */
    uint32_t order_cap;
    Crossing *crossing[CELL_RULES]; /* [ncrossing], room for BATCH each */
    uint32_t ncrossing[CELL_RULES];
    CellPoint *point[CELL_POINTS]; /* [npoint], room for BATCH each */
    uint32_t npoint[CELL_POINTS];
    Shape shape[CELL_SHAPES];    /* by hash */
    Depth deep[CELL_SHAPES + 1]; /* likewise; the last one of parts whose hash is not known */
    Box within;                  /* of the points */
};

/* The next edge of a set of bits, ascending, which is taken out of it; false: it is empty. */
static inline bool cells_take_edge(uint32_t *set, uint32_t *edge) {
    if (!*set) return false;
    *edge = (uint32_t)__builtin_ctz(*set);
    *set &= *set - 1;
    return true;
}

/* Room for one more element; false, and `failed`, when memory runs out. */
bool cells_grow(Cells *c, void *array, uint32_t *cap, uint32_t need, size_t size);
#define CELLS_ROOM(c, name, extra)                                                                                     \
    cells_grow(c, &(c)->name, &(c)->name##_cap, (c)->n##name + (extra), sizeof *(c)->name)

/* Rays that meet a mesh are decided by other arithmetic than their lines' g: so near to 0, in bounds of what g rounds
 * by, the two may disagree. Along a face of a cell a line then is in both cells, and at the one where rays differ it
 * counts. */
enum { CELL_RAY = 16 };
static inline double cells_doubt(const CellEdge *e) { return e->event.line ? CELL_RAY * e->error : 0; }
/* Does g, of which these are the values at the two ends of a column, come to 0 between them? */
static inline bool cells_spans(const CellEdge *e, int axis, double lo, double hi) {
    const double up = e->rises[axis], near = cells_doubt(e);
    return up * lo <= near && up * hi >= -near;
}

/* Is the site about a ray over terrain? Of these bounds know whether they are open, and no curve. */
static inline bool cells_is_ray(const SltScene *s, int32_t site) {
    return (uint32_t)site < s->nsites && s->site_kind[site] >= SLT_SITE_SILHOUETTE &&
           s->site_kind[site] <= SLT_SITE_SHADOW;
}

/* Is what the edge kernels know of the site levels of a wave, and not its g? */
static inline bool cells_is_wave(const SltScene *s, int32_t edge) {
    return s->edge_kind && s->edge_kind[edge] == SLT_SITE_WAVE;
}

/* ---- numbers of the program's precision */
static inline double cells_round(const Cells *c, double v) { return c->b->f64 ? v : (double)(float)v; }
/* Sums of numbers that differ by less than this part of their size are the same. */
static inline double cells_rounding(const Cells *c) { return c->b->f64 ? 0x1p-46 : 0x1p-18; }
bool cells_spent(Cells *c);                                                     /* has this tile used its budget up? */
void cells_leave(Cells *c, const Box *box, const double *bounds, double apart); /* CellSink.left */
double cells_next(const Cells *c, double v, double towards);
/* v moved by n units in its last place, or in that of `scale` where that is more. */
double cells_move(const Cells *c, double v, double n, double scale);

/* ---- cells.c */
bool cells_may_divide(Cells *c, const Cell *cell); /* is it large enough to be cut further? */
/* A part of a cell that was counted as curved becomes a node again. False when memory runs out. */
bool cells_put_back(Cells *c, const Cell *cell, const Box *part);

/* ---- cells_edge.c */
void cells_call(Cells *c, SltKernelKind kind, uint32_t n); /* counts */
bool cells_run_probes(Cells *c);                           /* probe[nprobe] */
bool cells_run_site_probes(Cells *c); /* the same of sites' own g, which the edges of waves are only levels of */
bool cells_run_asks(Cells *c);        /* ask[nask] */
/* The same, and g at the centres of boxes on which it may be 0 and does not jump: for cells_meet. */
bool cells_run_asks_about_centres(Cells *c);
/* g and its gradient at root[active[0 .. n)], where one call does for all of them and needs no more than they hold;
 * false: it does not. */
bool cells_run_roots(Cells *c, uint32_t n);
Probe *cells_probe(Cells *c, const CellEdge *e, const double x[3]);
Probe *cells_probe_or_tell(Cells *c, const CellEdge *e, const double x[3]); /* not asked where g is a quadric */
Probe *cells_probe_event(Cells *c, const Event *e, const double x[3]);      /* with nothing given */
Ask *cells_ask(Cells *c, const CellEdge *e, const double lo[3], const double hi[3]);
/* What is decided in boxes and what is open: in cell[0 .. nhalves - 1], and in those behind, for which it also makes
 * lists of iterations. */
bool cells_bound_halves(Cells *c);
bool cells_bound_small(Cells *c);
/* Of others; `lonely` is the caller's. few_events: most that may be open, but for what CELL_FEW_EVENTS says. */
void cells_bound_boxes(Cells *c, Cell *cell, uint32_t n, uint32_t few_events);
void cells_bound_range(Cells *c, Cell *cell); /* of one: what f may be there */
/* Bounds of the open events of those that are not done and need not be refined: closes what the mean-value form proves
 * closed. */
bool cells_close(Cells *c, Cell *cell, uint32_t n);
/* What a box and its centre prove: bounds of g, those of its natural form met with those of the mean-value form. */
void cells_meet(const Cells *c, CellEdge *e, const Ask *box);
/* The axis along which alone g changes; -1: there is none. */
int cells_straight_axis(const Cells *c, const CellEdge *e);
/* An edge that is straight, at which the cell may be cut exactly; -1: none. */
int cells_straight_edge(const Cells *c, const Cell *cell, int *axis);
/* Chooses height axes; false: the cell must be cut. */
bool cells_choose_axes(const Cells *c, Cell *cell);

/* ---- cells_prune.c: straight-line programs (saltus/chunks.h). Choice c is edge nedges + c. */
enum { CELL_PRUNED = 1 }; /* level of the Pruner */
bool cells_prune_init(Cells *c);
void cells_prune_free(Cells *c);
void cells_enter_chunks(Cells *c, Node *node); /* and frees what it kept; NULL: none, everything runs */
/* Calls `bounds` on the n boxes of the batch. */
void cells_call_bounds(Cells *c, uint32_t n);
/* Behind it: the choices that are open in box i, ahead of the events that are. */
void cells_add_choices(Cells *c, Cell *cell, uint32_t i);
/* Of a tile, before anything is asked of one of its curves: tiles may be small, and the whole program is slow. */
bool cells_prune_root(Cells *c, Node *root);
/* Keeps what runs in boxes that may become nodes. False when memory runs out. */
bool cells_keep_chunks(Cells *c, uint32_t n, uint64_t wanted);
int32_t *cells_take_chunks(Cells *c, int box); /* of a box that becomes a node, -1: of the node in hand; to be freed */
/* For calls of the edge kernels: the choices that are given are settled; and then no more. */
void cells_give_choices(Cells *c, const Given *given, bool on);
bool cells_same_choices(const Cells *c, const Given *p, const Given *q);
/* ---- cells_same.c */
bool cells_is_bend(const Cells *c, int32_t edge); /* a choice at which f and g bend, and do not jump */
/* May it be a choice between two values of which each is the other in all of the cell? centre: g there. */
bool cells_may_be_same(const Cells *c, const CellEdge *e, double centre);
/* Of the edges that are open in n cells: drops those that are. False when memory runs out. */
bool cells_close_same(Cells *c, Cell *cell, uint32_t n);
/* ---- cells_given.c */
/* Of those that are not done and need not be refined: edges for the ways in which others decide. */
bool cells_give(Cells *c, Cell *cell, uint32_t n);
/* Can no point lie on the curves of both, because they need another event to decide differently? */
bool cells_contradict(const CellEdge *e, const CellEdge *f);
/* Do they ask where one and the same function has two different values? */
bool cells_are_levels(const Event *e, const Event *f);
/* At the roots of columns: drops curves from pieces on which what they have given does not hold. */
bool cells_drop_wrong(Cells *c);
/* g this near to 0 may be 0 but for rounding; dg: its gradient, error: of g. */
double cells_nearly_0(const Cells *c, const Box *box, double error, const double dg[3]);
/* ---- cells_root.c */
Root *cells_root(Cells *c, const Cell *cell, const CellEdge *e, int axis, const double x[3], double guess);
/* Where the cubic with these values and slopes at two places is 0, near `at`. */
double cells_cubic_root(const double x[2], const double g[2], const double slope[2], double at);
/* Where g is about 0 between two places with these g and slopes: the place as a function of g, a cubic through both. */
static inline double cells_between(const double x[2], const double g[2], const double slope[2]) {
    double t = g[0] / (g[0] - g[1]), u = 1 - t;
    return u * u * (1 + 2 * t) * x[0] + t * t * (3 - 2 * t) * x[1] +
           (g[1] - g[0]) * t * u * (u / slope[0] - t / slope[1]);
}
/* All of root[nroot] that are not solved and do not wait. By Root.slack g is not asked again at the place where cubics
 * say that the root is: there g is taken for 0, and its slope for theirs. A root that lies outside of its line
 * by rounding ends at the line's end. */
bool cells_solve(Cells *c);
/* Narrows the brackets of solved roots to two adjacent numbers, between which g changes from < 0 to >= 0 or back. Those
 * where it does not get lo = hi. */
bool cells_narrow(Cells *c);
/* f and the hash on the two sides of the roots that are wanted, where they are not known. */
bool cells_take_sides(Cells *c);
/* ---- cells_rounding.c: of roots that go out: how far rounding blurs them, Root.blur and CellCounts. In f32 those of
 * the coarse rule are moved, and slopes are those of the sites. */
bool cells_round_roots(Cells *c, const Column *from, const Column *to);
void cells_round_arc(Cells *c, const Piece *p, const Arc *arc); /* and weights of the coarse rule */
/* By how much rounding may make the parts of a column longer, part by part: CellPoint.moved. Each root goes the way
 * that makes f less, so that what a band loses on one side it does not gain on the other; where f is the same on both
 * sides, and derivatives may not be, by turns. 0 in f64. */
void cells_moved_parts(const Cells *c, const Column *k, double longer[CELL_EDGES + 1]);
static inline const Sides *cells_sides(const Cells *c, const Root *r) { return &c->sides[r->sides - 1]; }
static inline const Sides *cells_sides_of(const Cells *c, const PieceEdge *e) { return &c->sides[e->sides - 1]; }

/* ---- cells_stretch.c and cells_base.c, for cells of one and two dimensions and planes of 3D, from cell[first] on;
 * cell->refine where curves cannot be told apart */
/* On the curve of an event with gradient bounds `a`, whose height axis is `axis`: bounds of how it climbs along the
 * base, and of the slope there of a function with gradient bounds `f`. */
void cells_slope_along(const double a[3][2], const double f[3][2], int base, int axis, double climb[2],
                       double slope[2]);
/* Is the curve of an edge in the cell above s on the base? False: the corners do not tell. */
bool cells_told_by_corners(const CellEdge *e, double s, bool *present);
/* The height of a quadric: of the two roots the one where the slope has the sign `rises`. */
double cells_height_on_quadric(const CellEdge *e, int base, double s);
/* About where it is, as they tell; NaN: they do not. */
double cells_height_by_corners(const Cell *cell, const CellEdge *e, int base, double s);
bool cells_cut_planes(Cells *c, uint32_t first); /* makes the cuts, sorted */
bool cells_cut_bases(Cells *c, uint32_t first);  /* and the pieces between them */
/* The coarse rule has what lies between the end of a piece that goes out and the border of the domain. */
void cells_emit_beyond(Cells *c, const Piece *p);

/* ---- cells_points.c */
/* Those of the fine rule, unless they are chosen already. */
void cells_choose_points(const Cells *c, Piece *p);
const GaussRule *cells_rule_of(const Cells *c, const Piece *p, CellRule rule);
/* Where t of [0, 1] lies on the base of a piece with a turn, in parts of that, and how fast that goes there. */
double cells_along_base(const Piece *p, double t, double *pace);

/* ---- cells_column.c */
bool cells_integrate(Cells *c); /* over all pieces */
/* Columns and roots of the pieces from `first` on: first_column[i - first] is that of piece i. */
bool cells_evaluate(Cells *c, uint32_t first);
bool cells_emit_columns(Cells *c, const Column *from, const Column *to); /* crossings */
void cells_flush(Cells *c);
/* An empty crossing of a rule, which is to be handed over. */
Crossing *cells_add_crossing(Cells *c, uint8_t rule);
/* The crossing that a root with known sides is. */
void cells_crossing(const Cells *c, const Root *r, Crossing *x);

/* ---- cells_agree.c
 * Sets Piece.last, and Piece.agrees to false where the rules do not agree on curves, whatever f is beside them: that
 * need not be told there. */
void cells_drop_bent(Cells *c, uint32_t first, uint32_t n);
/* Piece.agrees and, of areas that curves tell, Piece.smooth. */
void cells_compare_curves(Cells *c, uint32_t first, uint32_t n, bool compare);
/* Sets the bend of a piece whose rules are so far apart, in parts of what they integrate. */
void cells_note_bend(const Cells *c, Piece *p, double apart);

/* ---- cells_arc.c */
/* Makes an arc of a piece, if it is one. False when memory runs out. */
bool cells_add_arc(Cells *c, Piece *p, bool *is);
bool cells_arc_agrees(const Cells *c, Piece *p, bool *areas); /* the rules; sets the bend. areas: those too */
void cells_emit_arc(Cells *c, const Piece *p);

/* ---- cells_twins.c */
/* Of roots of a column that lie on each other one stays, which stands for all. */
bool cells_find_twins(Cells *c);
/* Looks between those whose two sides are alike. A band that is seen there parts them; where none is, parameters that
 * are moved tell whether the one hides the other, or rounding both. Of these each has sides for the fine rule and,
 * behind them, for the coarse one, which differ by as much as their order decides. */
bool cells_part_twins(Cells *c);
/* Counts the cell of a root whose order is not known as not certified, once. */
void cells_count_band(Cells *c, const Root *r);
void cells_count_hidden(Cells *c, const Root *r); /* whatever its sides are */
/* A point of CellCounts.coincident. */
void cells_count_kink(Cells *c, const Event *event, const double x[3]);

/* ---- cells_tied.c */
/* Sets up c->apart, if it can be, and c->untie; false when memory runs out. */
bool cells_ready_to_tie(Cells *c);
/* Sets the ties of roots active[0 .. n), on which other curves lie. */
bool cells_tie(Cells *c, uint32_t n);
/* Of a tied crossing the parts whose boundary is there only after a move; base: the measure that it stands for. */
void cells_emit_away(Cells *c, const Crossing *x, double base, uint8_t rule, const Tie *t);
/* The crossings of the tied roots among those that are wanted. */
bool cells_emit_tied(Cells *c, const Column *from, const Column *to);

/* ---- cells_kinks.c: ties of the roots of middles whose g has a kink in the parameters, and of columns those */
bool cells_find_kinks(Cells *c);
/* Is the root's piece longer than moves go? At its ends other curves meet it. */
bool cells_has_room(const Cells *c, const Root *r);
/* Are two curves one, to the last place, and not a band that is thinner than rounding? False: memory ran out. */
bool cells_lie_on_each_other(Cells *c, const Root *r, const Root *s, bool *is);
/* That of a root, by the two orders after `move` and the next: the jump towards growing g, 0 where it is not seen. */
bool cells_keep_kink(Cells *c, Root *r, uint32_t move, const bool seen[2], double jump[2][SLT_MAX_CHANNELS],
                     bool hidden);
bool cells_follow_kinks(Cells *c);

/* ---- cells_solid.c: integrates over a curved cell of 3D. done: false where it must be refined, because curves cannot
 * be told apart, or because the rules differ and `may_refine`: Cell.apart. */
bool cells_integrate_solid(Cells *c, uint32_t i, bool may_refine, bool *done);

/* ---- cells_gap.c */
/* The cell is cut in the gap of r: if a site's curve may lie there, that waits for cells_integrate_gaps, for which the
 * cells stay in hand; what it cannot integrate is left over. */
bool cells_add_gap(Cells *c, uint32_t cell, const Root *r);
bool cells_integrate_gaps(Cells *c);

/* ---- cells_upset.c */
bool cells_upsets(const Cells *c, int32_t edge); /* must the two sides of a seam be compared? */
bool cells_is_upset(Cells *c, const Root *r);    /* of which the sides were taken: does f jump there? */
/* Counts what f jumps by along the curves of a piece that goes out; owner: the cell that is charged, NULL: its own. */
void cells_add_upset(Cells *c, const Piece *p, Cell *owner);
/* The same of the face in which a cell is cut at a seam, r. */
bool cells_check_cut(Cells *c, Cell *cell, const Root *r);

/* ---- cells_layer.c */
/* By how much f, next to the curves of a piece, lies outside of what points beside them have met; 0: by no more than it
 * may climb there. count: adds it to what is lost, CellCounts.upset_jump. */
double cells_layer(Cells *c, const Piece *p, const Column *from, const Column *to, bool count);
/* ---- cells_steep.c */
bool cells_may_ask(const Cells *c); /* bounds of boxes that are no cells */
/* May f be far from what points of the box have met, by bounds? A tile has so many evaluations for that, and no more.
 */
bool cells_hides_peak(Cells *c, const Smooth *s, const Spot *first, const Spot *end);
/* Should it be looked for that? With few points a box in which f has its least value may look so. */
bool cells_doubts(Cells *c, const Smooth *s, const Spot *first, const Spot *end);
/* In f32: where f climbs in few floats, what the rounding of points makes of derivatives. */
void cells_state_rounding(Cells *c, const Smooth *s, const Spot *first, const Spot *end);
/* Of a box that is not cut further, though the rules may not agree: counts a step that it may hold as lost. */
void cells_state_hidden(Cells *c, const Smooth *s, const Spot *first, const Spot *end, bool agree);
/* The same of the parts of a piece between its curves, of many pieces at once: those that are asked about, and then
 * Piece.hides. The first is false when memory runs out. */
bool cells_ask_beside(Cells *c, uint32_t piece, const Column *from, const Column *to);
void cells_find_hidden(Cells *c);
/* The axis along which bounds of its halves tell most, and these bounds. */
uint32_t cells_hunt(Cells *c, const Smooth *s, double f[2][2 * SLT_MAX_CHANNELS]);

void cells_copy_piece(Cells *c, uint32_t to, uint32_t from);

/* ---- cells_border.c */
/* May areas in the cell be told by what bounds them? */
bool cells_may_border(const Cells *c, const Cell *cell);
/* Behind the middles of the pieces from `first` on, all of a cell: of cells with `borders` they become pieces of one
 * curve each, and what their faces tell goes out; of those where that cannot be `borders` ends. */
bool cells_part_borders(Cells *c, uint32_t first);
bool cells_borders_agree(const Cells *c, const Piece *p, const Column *from, const Column *to); /* the rules */
void cells_emit_borders(Cells *c, const Piece *p, const Column *from, const Column *to);
void cells_add_borders(Cells *c, const Piece *p, const double area[CELL_RULES], double size);
/* cells.c: it is known what becomes of a cell that has no common axis. */
bool cells_end_borders(Cells *c, Cell *cell);

/* ---- cells_parts.c */
static inline uint32_t cells_part_bit(uint32_t part) { return 1u << (part < 31 ? part : 31); }
/* Spots between the curves of pieces that need them, f there, and Piece.smooth. */
bool cells_take_points(Cells *c, uint32_t first, uint32_t n);

/* ---- cells_volume.c */
/* Where part k of a column between two roots begins, in parts of its length. */
static inline double cells_part_begins(const Piece *p, uint32_t k) {
    int half = (int)p->parts / 2;
    if (!p->layered) return (double)k / p->parts;
    if (k == 0 || k == p->parts) return k > 0;
    return (int)k <= half ? ldexp(1, (int)k - half - 1) : 1 - ldexp(1, half - (int)k - 1);
}

/* So much of what has this hash, at x; size: of the terms that this is made of. */
void cells_add_shape(Cells *c, uint32_t hash, const double x[3], const double area[CELL_RULES], double moved,
                     double size);
/* What two measures may differ by through rounding, of terms of this size. */
double cells_part_noise(const Cells *c, double size);
/* The spots of a piece with these columns, and of all from `first` on. depth: by part, most points along a column;
 * NULL: as many as its length asks for. */
bool cells_fill_piece(Cells *c, uint32_t i, Column *from, Column *to, const uint32_t *depth);
bool cells_add_points(Cells *c, uint32_t first);
bool cells_take_values(Cells *c, uint32_t first); /* f at the spots from there on */
/* The hashes of the parts of a column, where the sides of open curves tell them; known[], hash[]: zeros at first. */
void cells_part_hashes(const Cells *c, const Column *k, bool *known, uint32_t *hash);
/* Do the rules agree on spot[from .. to - 1], to that part of the tolerance? */
bool cells_values_agree(Cells *c, uint32_t from, uint32_t to, double part);
/* The same of one piece where f is constant in each part: their measures tell, and f need not be taken. */
bool cells_parts_agree(const Cells *c, uint32_t from, uint32_t to);
/* Where the parts of a column end, ascending; the last one at the end of the cell. How many. */
uint32_t cells_part_ends(const Cells *c, const Column *k, double heights[CELL_EDGES + 1]);
/* Do the rules differ along the columns of the fine rule, rather than along the base? */
bool cells_columns_differ(Cells *c, const Column *from, const Column *to, bool *differ);
void cells_emit_spots(Cells *c, uint32_t from, uint32_t to, bool taken); /* taken: f was */
/* Of a graded piece, whose spots these are: beside curves at which f is a small power of the distance no rule has seen
 * what it changes by up to them; the coarse rule has that more. */
void cells_doubt_rims(Cells *c, const Column *from, const Column *to, uint32_t first, uint32_t last);
void cells_emit_parts(Cells *c, uint32_t from, uint32_t to); /* of one piece, CellOptions.flat */
/* f is smooth in this part of a cell. */
bool cells_settle_box(Cells *c, const Cell *cell, const double lo[3], const double end[3]);
void cells_emit_middle(Cells *c, const double lo[3], const double end[3]); /* f is constant: one point */
/* The middle against two places beside it: rules that differ where f is not constant. */
void cells_emit_few(Cells *c, const Box *cell);
bool cells_integrate_smooth(Cells *c);
void cells_flush_points(Cells *c);

#endif
