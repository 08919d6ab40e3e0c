/* The bases of curved cells in pieces. */
#include <string.h>

#include "runtime/quadrature/cells_inner.h"

static bool whole_base(Cells *c, uint32_t i, int8_t axis) {
    if (!CELLS_ROOM(c, piece, 1)) return false;
    Piece *p = &c->piece[c->npiece++];
    memset(p, 0, sizeof *p);
    p->cell = i, p->axis = axis;
    for (uint32_t d = 0; d < c->dim; d++) p->at[d][0] = c->cell[i].box.lo[d], p->at[d][1] = c->cell[i].box.end[d];
    return true;
}

bool cells_cut_bases(Cells *c) {
    c->npiece = 0;
    for (uint32_t i = 0; i < c->ncell; i++) {
        Cell *cell = &c->cell[i];
        if (!cell->axes) continue;
        if (c->dim > 1) cell->refine = true;
        else if (!whole_base(c, i, 0)) return false;
    }
    return true;
}
