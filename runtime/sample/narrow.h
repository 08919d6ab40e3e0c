/* Lists of a tile, shortened by what `bounds` proves of parts of it.
 *
 * Boxes of [Cull] iterations say which of them reach a tile. `bounds` says more (SltNote): which may change anything in
 * a part of the tile, and which surely overwrite there all that came before them. What a painter has painted over is
 * left out, of a loop over 20 000 discs nearly everything where they have grown large. A tile is cut into rows of
 * parts; a kernel that is asked about some of the rows runs what matters in one of their parts.
 *
 *     columns   0      1
 *     row 2   +------+------+     8 rows of 2 parts are one call of `bounds`
 *     row 1   +------+------+     narrow_rows(.., 1, 1): the lists of this row
 *     row 0   +------+------+
 *
 * What is left out changes neither f nor its derivatives anywhere in the part, nor a hash of provenance. Of a worker,
 * whose Narrowed it is; it grows with the longest lists. */
#ifndef SALTUS_SAMPLE_NARROW_H
#define SALTUS_SAMPLE_NARROW_H

#include "runtime/sample/batch.h"

enum { NARROW_ROWS = 8, NARROW_COLUMNS = 2 };

/* Of a tile of a plane. Both ends belong to a part; neighbours may overlap. */
typedef struct NarrowParts {
    uint32_t rows;
    uint64_t samples; /* that the lists are for; 0: many */
    double x[2], y[NARROW_ROWS][2];
} NarrowParts;

typedef struct Narrowed {
    uint32_t rows;              /* 0: nothing was narrowed, lists are the tile's */
    SltCullList *whole, *of;    /* [nlists]: what matters anywhere in the tile; in the rows that were asked for */
    const SltCullList *current; /* what was there before */
    SltNote *notes, **note;     /* by list */
    uint32_t *keep;             /* by item of `whole`, list behind list: bits by part */
    int32_t *items, *some;      /* likewise: the iterations; room for those of `of` */
    uint64_t cap;
    uint32_t idle; /* tiles that will not be asked about, since of the last too little could be left out */
} Narrowed;
bool narrow_init(Narrowed *k, const SltScene *s);
void narrow_free(Narrowed *k);
/* Has this scene any use for it? */
bool narrow_serves(const SltScene *s);
/* Asks about the lists of b->args.cull, which are good for all of the tile, and stay. Where they are short it does
 * nothing. False when memory runs out. */
bool narrow_tile(Narrowed *k, Batch *b, const NarrowParts *p);
/* For calls to come: lists of points in these rows; the tile's again, for good. */
void narrow_rows(Narrowed *k, Batch *b, uint32_t first, uint32_t last);
void narrow_end(Narrowed *k, Batch *b);

#endif
