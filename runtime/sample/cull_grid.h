/* The boxes of a [Cull] loop's iterations, sorted into cells, so that a rectangle asks the boxes near it alone.
 *
 * Level l cuts the domain into 2^l by 2^l cells. A box lies once, at the finest level whose cells are no smaller, in
 * the cell that holds its lower corner: it reaches no farther than the next one.
 *
 *     level 1   . A | . . |     a box at A is in this cell, and is found by rectangles that touch
 *               . A-|-A . |     this cell or the next ones upwards
 *
 * Made once a call, read by all threads. */
#ifndef SALTUS_SAMPLE_CULL_GRID_H
#define SALTUS_SAMPLE_CULL_GRID_H

#include "runtime/sample/batch.h"

enum { CULL_LEVELS = 11 };

typedef struct CullBox {
    double lo[2], hi[2];
} CullBox;

typedef struct CullGrid {
    double lo[2], side[2]; /* of the domain */
    uint32_t levels, n;
    uint32_t *start; /* by level, row and column of a cell: its first box; one more at the end */
    CullBox *box;    /* [n]: in the order of cells */
    int32_t *number; /* [n]: the iteration of each */
} CullGrid;
/* box[n], by iteration, is copied. False when memory runs out. */
bool cull_grid_make(CullGrid *g, const SltScene *s, const CullBox *box, uint32_t n);
void cull_grid_free(CullGrid *g);
/* Sets the bits of the iterations whose boxes touch [lo, hi], and by word of these another bit. Comparisons with NaN
 * are false: a box of NaN touches all. */
void cull_grid_find(const CullGrid *g, const double lo[2], const double hi[2], uint64_t *found, uint64_t *some);

#endif
