/* Which edges of a tile of a lattice are looked at one by one: those whose ends differ or that bounds have not settled,
 * and those where the near-miss probe may aim. Of most tiles these are few: a pass over all vertices in the order of
 * memory finds them, for either axis, and tells which lines have none. */
#ifndef SALTUS_SAMPLE_ASK_H
#define SALTUS_SAMPLE_ASK_H

#include <string.h>

#include "runtime/sample/run.h"

/* Of the edge that starts at a vertex; and at the first vertex of a line whether some edge of it has the bit. */
enum { ASK_EDGE = 1, ASK_NEAR = 2, ASK_LINE_EDGE = 4, ASK_LINE_NEAR = 8 };
typedef struct AskTile {
    uint32_t n[3], from[3], to[3]; /* by axis: vertices, the edges [from, to) */
    uint64_t stride[3];
    bool at_start[3], at_end[3]; /* the tile begins or ends at the border of the domain */
} AskTile;
/* Fills w->ask for the edges along an axis; those whose depths differ by no more than the threshold are alike. A bit
 * that is set may be so in vain. */
void ask_edges(Worker *w, const AskTile *t, uint32_t axis, double threshold);

/* The first edge from v on, before `to`, that has the bit, of a line whose first vertex has ask[0]; else `to`. */
static inline uint32_t ask_next(const uint8_t *ask, uint64_t stride, uint32_t v, uint32_t to, uint8_t bit) {
    enum { WORD = 8 };
    while (v < to) {
        uint64_t word = 1;
        if (stride == 1 && v + WORD <= to) memcpy(&word, ask + v, sizeof word);
        if (!word) {
            v += WORD;
            continue;
        }
        if (ask[v * stride] & bit) break;
        v++;
    }
    return v;
}

#endif
