/* The near-miss probe on a line of vertices already evaluated. */
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
} Line;
/* `like` is a segment with everything but ends and hashes; its a and b hold the other coordinates. */
void near_probe(Worker *w, const Line *l, const Segment *like);
void near_flush(Worker *w);
bool near_init(Worker *w);

#endif
