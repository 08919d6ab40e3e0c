/* The pixels of an image, or the domain as one, and the positions of samples in them. Axis 1 of a position goes up,
 * rows of images go down. Read-only during a call; the run owns it. */
#ifndef SALTUS_SAMPLE_GRID_H
#define SALTUS_SAMPLE_GRID_H

#include "runtime/sample/estimate.h"
#include "runtime/base/rng.h"

typedef struct Grid {
    bool integral;      /* one "pixel" with the constant filter 1: an integral, not a mean */
    uint32_t dim, n[3]; /* n is 1 beyond dim */
    double lo[3], hi[3], side[3];
    SltFilter filter;
    double radius;   /* of the filter, in pixels */
    double *mass[3]; /* by pixel of the axis: the part of the filter inside the domain; NULL when integral */
    uint64_t pixels;
} Grid;
SltStatus grid_init(Grid *g, const SltScene *s, const SltJob *j, SltError *err);
void grid_free(Grid *g);
/* Row-major index, row 0 at the top. */
static inline uint64_t grid_index(const Grid *g, uint32_t x, uint32_t y, uint32_t z) {
    return ((uint64_t)z * g->n[1] + (g->n[1] - 1 - y)) * g->n[0] + x;
}
/* The pixel of the axis that holds x. */
static inline uint32_t grid_cell(const Grid *g, uint32_t axis, double x) {
    double c = (x - g->lo[axis]) / g->side[axis];
    if (!(c > 0)) return 0;
    return c >= g->n[axis] ? g->n[axis] - 1 : (uint32_t)c;
}
/* Pixels whose filter reaches x along an axis, and their normalised weights (1/length). At most GRID_REACH of them. */
enum { GRID_REACH = 6 };
uint32_t grid_reach(const Grid *g, uint32_t axis, double x, uint32_t *first, double weight[GRID_REACH]);
/* Position inside pixel p of the axis for u in (0,1), distributed as the filter over the part of the domain it covers.
 */
double grid_place(const Grid *g, uint32_t axis, uint32_t p, double u);
/* sum over pixels of adjoint * filter at x, per channel. */
void grid_gather(const Grid *g, const float *adjoint, uint32_t channels, const double x[3], double *out);

/* A pattern of samples of a pixel, or of the whole domain: additive recurrence with a random shift each. */
typedef struct Pattern {
    uint32_t dims; /* of the recurrence: position, and number 0 of the stream */
    uint32_t shift[4];
    uint32_t seed, lane;
    uint64_t owner; /* pixel or replicate, for the streams */
    RngPurpose purpose;
} Pattern;
void pattern_init(Pattern *p, const SltScene *s, uint32_t seed, RngPurpose purpose, uint32_t lane, uint64_t owner);
static inline double pattern_at(const Pattern *p, uint32_t dim, uint64_t index) {
    return rng_recurrence(p->dims, dim, index, p->shift[dim]);
}
int32_t pattern_stream(const Pattern *p, uint64_t index);

#endif
