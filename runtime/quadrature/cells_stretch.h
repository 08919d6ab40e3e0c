/* Stretches of the base of a cell, on which a function of one number, the place s, is followed: g on a face, or
 * phi(s) = g_j(s, h_i(s)) on the curve i. Its roots are isolated by bounds: values at the two ends of a stretch and
 * bounds of the slope in between prove that there is no root, or that there is at most one; else the stretch is halved.
 */
#ifndef SALTUS_QUADRATURE_CELLS_STRETCH_H
#define SALTUS_QUADRATURE_CELLS_STRETCH_H

#include <string.h>

#include "runtime/quadrature/cells_inner.h"

enum { FACE = -1, ARC = -2 };
#define NARROW 0x1p-44 /* parts of a base that are shorter are no pieces */

/* A stretch of the base of a cell. */
typedef struct Stretch {
    uint32_t cell;
    int8_t edge, other; /* FACE: g of `edge` on a face; ARC: nothing yet; else g of `other` on the curve of `edge` */
    uint8_t halvings;
    bool known[2];                        /* height[] is, for the curve leaves the cell there, or is a quadric */
    double at[2];                         /* the two ends, */
    double height[2];                     /* what the height is there, */
    double value[2];                      /* and the function */
    double slope[2];                      /* bounds of the function's slope */
    double climb[2];                      /* of the curve's */
    double x[2];                          /* root: place and height */
    double step;                          /* the last one towards it, in parts of the cell */
    double spread[2];                     /* how far along the base it moves as either g does, in parts of that */
    enum { OPEN, ROOT, MET, DONE } state; /* MET: around a root that is known as well as numbers go */
} Stretch;

/* The axis of the base, of the plane that the cell lies in. */
static inline int base_axis(const Cell *cell, int axis) { return (cell->slice < 0 ? 1 : 3 - cell->slice) - axis; }

/* A point above s on the base. */
static inline void place(const Cell *cell, int axis, double s, double height, double x[3]) {
    memcpy(x, cell->box.lo, 3 * sizeof *x);
    x[base_axis(cell, axis)] = s, x[axis] = height;
}

static inline const CellEdge *curve_of(const Cells *c, const Stretch *s) { return &c->cell[s->cell].edge[s->edge]; }
static inline const CellEdge *tested(const Cells *c, const Stretch *s) {
    return &c->cell[s->cell].edge[s->other < 0 ? s->edge : s->other];
}

/* g of an edge at a place where it is a quadric: *own gets it. Elsewhere it is the next probe, which was asked. */
static inline const Probe *tell_or_next(const Cells *c, const CellEdge *e, const double x[3], Probe *own,
                                        const Probe **next) {
    if (!e->quadric.is) return (*next)++;
    own->g = cells_on_quadric(&e->quadric, x, c->dim, own->dg);
    return own;
}
static inline bool ask_unless_told(Cells *c, const CellEdge *e, const double x[3]) {
    return e->quadric.is || cells_probe(c, e, x);
}

Stretch *stretch_add(Cells *c, const Stretch *from);
/* What values and slopes prove; error: of the function's values. */
void stretch_judge(Stretch *s, double error);
/* The height of the curve at ends, bit by bit, of all stretches from `first` on; on faces it is known. */
enum { STRETCH_NEAR = 1, STRETCH_FAR = 2, STRETCH_BOTH = 3 };
bool stretch_heights(Cells *c, uint32_t first, int ends);
/* The value of the function there. */
bool stretch_values(Cells *c, uint32_t first, int ends);
/* Halves every open stretch: the far half is appended. */
bool stretch_halve(Cells *c);
/* Until every stretch has at most one root. */
bool stretch_isolate(Cells *c);

#endif
