/* What the files of runtime/quadrature/cells*.c share.
 *
 *   cells.c         the tree: nodes, their sub-boxes, what is settled, points in it, what is left
 *   cells_edge.c    kernels at many points and boxes of many events; which open events are really open, and along
 *                   which axis each is a graph
 *   cells_root.c    roots of g on lines, many at once, and f on their two sides
 *   cells_base.c    2D: where along its base the shape of a curved cell changes
 *   cells_column.c  pieces of the base become columns, these roots, crossings and points of the volume
 *
 * A curve g = 0 in a cell is a graph over the *base*, the other axes: its height is the one root of g on the *column*
 * above a point of the base, along the *height axis*. On a *piece* of the base the same curves lie in the same order
 * above every point, and nothing that decides changes along any of them. */
#ifndef SALTUS_QUADRATURE_CELLS_INNER_H
#define SALTUS_QUADRATURE_CELLS_INNER_H

#include "runtime/quadrature/cells.h"
#include "runtime/quadrature/gauss.h"

enum {
    CELL_BOXES = 72, /* halves of a node along all axes, and theirs: 8 + 64 */
    CELL_EVENTS = SLT_MAX_OPEN,
    CELL_BENDS = 10, /* levels by which a cell is cut further where f or g bends at no seam */
};

/* An open event of a cell, and what is proven of its g there. */
typedef struct CellEdge {
    Event event;
    double g[2], slope[3][2]; /* lo and hi of g, and of its gradient */
    double error;             /* g as computed is no farther than this from g without rounding */
    uint32_t state;           /* SLT_EDGE_* */
    int8_t rises[3];          /* sign of d_axis g, where it has one; else 0 */
    int8_t axis;              /* height axis */
} CellEdge;

typedef struct Cell {
    Box box;
    uint32_t level, bends; /* how often its ancestors were cut, and since when only because something bends */
    uint32_t state;        /* SLT_BOX_* */
    uint32_t nopen;        /* as the kernel counts: more than CELL_EVENTS where they are too many */
    uint32_t nedges;       /* those that edge[] holds: may really be open */
    CellEdge edge[CELL_EVENTS];
    double f[2 * SLT_MAX_CHANNELS]; /* lo and hi by channel */
    uint32_t axes;                  /* bit by axis: height axes of its edges */
    bool refine;                    /* cannot be integrated as it is */
    bool done;                      /* nothing more is to be done with it */
} Cell;

/* A part of the base of a cell, and what is found there. */
typedef struct PieceEdge {
    double height, slope[3]; /* on the column above the middle; d height / d base */
    bool open, twin;         /* the crossing changes the region; other curves lie on this one */
} PieceEdge;
typedef struct Piece {
    uint32_t cell;
    int8_t axis;      /* height axis */
    double at[3][2];  /* by axis: the two ends, but of the height axis */
    uint32_t present; /* bit by edge of the cell: the curve is there */
    uint32_t halvings;
    bool graded; /* f has a root singularity at an end of its columns: places are denser there */
    PieceEdge edge[CELL_EVENTS];
} Piece;

/* A point of the base with the line above it. */
typedef struct Column {
    uint32_t piece, first, nroots; /* roots: c->root[first .. first + nroots - 1], ascending in height */
    uint8_t rule;                  /* CellRule */
    double x[3], weight;           /* x: of the base; weight: measure of the base */
} Column;

/* The root of g along one axis, in a bracket in which g is monotone. */
typedef struct Root {
    const Event *event;
    double x[3];   /* where; of x[axis] only a guess until it is solved */
    double lo, hi; /* the bracket: ends of the line, and later places where g was taken */
    int8_t axis, rises;
    bool ends[2];          /* g was taken at lo, at hi */
    double g, dg[3], step; /* g and its gradient at x; the last step */
    /* Of columns: */
    uint32_t column;
    uint8_t edge;
    bool wanted, twin; /* f on the two sides is; another event has its root here too */
    double side[2];    /* places on the axis on whose two sides g has different signs, next to the root */
    double f[2][SLT_MAX_CHANNELS];
    uint32_t hash[2];
} Root;

/* g of an event at a point, or on a box. */
typedef struct Probe {
    const Event *event;
    double x[3];
    double g, dg[3];
} Probe;
typedef struct Ask {
    const Event *event;
    double lo[3], hi[3];
    double g[2], slope[3][2], error; /* as in CellEdge */
    uint32_t state;
} Ask;

typedef struct Node {
    Box box;
    uint32_t level, bends;
} Node;

struct Cells {
    Batch *b;
    const SltScene *s;
    double lo[3], hi[3], volume; /* of the domain */
    uint32_t dim, depth;         /* depth: loop indices of an event */
    const CellOptions *o;
    const CellSink *sink;
    CellCounts *counts;
    uint64_t began; /* evaluations counted before this tile */
    bool failed;    /* memory ran out */
    GaussRule rule[CELL_RULES];
    Node *stack; /* nodes to be worked on */
    uint32_t nstack, stack_cap;
    Cell *cell; /* [ncell]: sub-boxes of the node in hand */
    uint32_t ncell, cell_cap;
    Piece *piece;
    uint32_t npiece, piece_cap;
    Column *column;
    uint32_t ncolumn, column_cap;
    Root *root;
    uint32_t nroot, root_cap;
    struct Stretch *stretch; /* cells_base.c */
    uint32_t nstretch, stretch_cap;
    struct Cut *cut;
    uint32_t ncut, cut_cap;
    Probe *probe;
    uint32_t nprobe, probe_cap;
    Ask *ask;
    uint32_t nask, ask_cap;
    uint32_t *active; /* roots that are still worked on */
    uint32_t active_cap;
    uint32_t *order; /* of probes and asks, by edge */
    uint32_t order_cap;
    Crossing *crossing; /* [ncrossing], room for BATCH */
    uint32_t ncrossing;
    CellPoint *point[CELL_RULES]; /* [npoint], room for BATCH each */
    uint32_t npoint[CELL_RULES];
    Box within; /* of the points */
};

/* Room for one more element; false, and `failed`, when memory runs out. */
bool cells_grow(Cells *c, void *array, uint32_t *cap, uint32_t need, size_t size);
#define CELLS_ROOM(c, name, extra)                                                                                     \
    cells_grow(c, &(c)->name, &(c)->name##_cap, (c)->n##name + (extra), sizeof *(c)->name)

/* ---- numbers of the program's precision */
static inline double cells_round(const Cells *c, double v) { return c->b->f64 ? v : (double)(float)v; }
double cells_next(const Cells *c, double v, double towards);
/* v moved by n units in its last place, or in that of `scale` where that is more. */
double cells_move(const Cells *c, double v, double n, double scale);

/* ---- cells_edge.c */
void cells_call(Cells *c, SltKernelKind kind, uint32_t n); /* counts */
bool cells_run_probes(Cells *c);                           /* probe[nprobe] */
bool cells_run_asks(Cells *c);                             /* ask[nask] */
Probe *cells_probe(Cells *c, const Event *e, const double x[3]);
Ask *cells_ask(Cells *c, const Event *e, const double lo[3], const double hi[3]);
/* What is decided in boxes and what is open. */
void cells_bound(Cells *c, Cell *cell, uint32_t n);
/* Bounds of the open events of those that are not done and need not be refined: closes what the mean-value form proves
 * closed. */
bool cells_close(Cells *c, Cell *cell, uint32_t n);
/* Chooses height axes; false: the cell must be cut. */
bool cells_choose_axes(const Cells *c, Cell *cell);

/* ---- cells_root.c */
Root *cells_root(Cells *c, const Cell *cell, const CellEdge *e, int axis, const double x[3], double guess);
/* All of root[nroot]. A root that lies outside of its line by rounding ends at the line's end. */
bool cells_solve(Cells *c);
/* f and the hash on the two sides of the roots that are wanted. */
bool cells_take_sides(Cells *c);

/* ---- cells_base.c: adds the pieces of a cell; sets cell->refine where they cannot be told apart */
bool cells_cut_bases(Cells *c);

/* ---- cells_column.c: integrates over all pieces */
bool cells_integrate(Cells *c);
void cells_flush(Cells *c);
void cells_emit_point(Cells *c, const double x[3], double weight, CellRule rule);

#endif
