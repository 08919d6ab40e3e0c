/* The near-miss probe on a line of vertices that are already evaluated. A worker owns its candidates. */
#ifndef SALTUS_SAMPLE_NEAR_H
#define SALTUS_SAMPLE_NEAR_H

#include "runtime/sample/run.h"

typedef struct Line {
    const double *pos;      /* positions along the axis, by vertex */
    uint64_t first, stride; /* into the worker's vertex arrays */
    uint32_t n;             /* vertices */
    uint32_t from, to;      /* edges [from, to) to be probed: edge e joins vertices e and e+1 */
    bool at_start, at_end;  /* vertex 0 / n-1 ends the line: one-sided gradients there */
    double threshold;       /* of depths: edges whose ends differ by more are searched already */
    const uint8_t *ask;     /* ask.h: only edges with ASK_NEAR can be candidates; NULL: not known */
    uint64_t runs;          /* thin.h: added to the numbers of vertices, where several nets are collected together */
} Line;
/* Collects candidates among the edges of a line. `like` is a segment of it with all but ta, tb, marks and threshold;
 * its a and b hold the coordinates across the line. */
void near_probe(Worker *w, const Line *l, const Segment *like);
/* Evaluates the candidates; those in which something lies go to the worker's finder. */
void near_flush(Worker *w);
/* |g| at four vertices in a row: where between the inner two the region is evaluated. False: nowhere. */
enum { NEAR_AIMS = 2 };
bool near_aims(const double g[4], const double pos[4], double at[NEAR_AIMS]);

#endif
