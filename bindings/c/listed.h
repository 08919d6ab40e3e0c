/* Tiles of 8-bit pixels of programs with loops of which `bounds` tells the iterations that can matter: a tile is cut
 * into parts, and each is shaded with lists of its own (runtime/quadrature/lists.h). The same bits as without.
 *
 * Of a worker, whose it is:
 *
 *     n = listed_tile(l, q, &tile, part)     cuts a tile; 0: memory has run out
 *     cull = listed_part(l, i)               the lists of part i, ascending: SltKernelArgs.cull until the next one
 */
#ifndef SALTUS_BINDINGS_LISTED_H
#define SALTUS_BINDINGS_LISTED_H

#include "bindings/c/api.h"
#include "runtime/quadrature/lists.h"

/* PIXEL_SIDE: of the squares of pixels that are shaded side by side. */
enum { PIXEL_SIDE = 8, LISTED_PART = 32, LISTED_TILE = 4 * LISTED_PART, LISTED_PARTS = 16 };

/* Pixels: columns and rows, rows downwards. */
typedef struct PixelPart {
    uint32_t first[2], n[2];
} PixelPart;

typedef struct Listed {
    Batch batch;
    Lists lists;
    ListsAt of[LISTED_PARTS];
    uint32_t flat;      /* bit i: f is one number, of each channel, all over part i */
    uint64_t all, kept; /* iterations of all parts so far: of loops, in lists */
} Listed;

bool listed_serves(const SltProgram *p, const SltJob *job);
/* Behind an image: did so many lists of so many iterations save anything? If not there are none in the next. */
void listed_judge(SltProgram *p, uint64_t all, uint64_t kept);
bool listed_init(Listed *l, const SltProgram *p, const SltJob *job);
void listed_free(Listed *l);
uint32_t listed_tile(Listed *l, const SltProgram *p, const SltJob *job, const PixelPart *tile,
                     PixelPart part[LISTED_PARTS]);
const SltCullList *listed_part(Listed *l, uint32_t i);

#endif
