/* The pixels of an image, or the domain as one pixel, and the positions of samples in them. Axis 1 of a position goes
 * up, rows of images go down. The run owns its Grid, which is read-only while tiles are worked on. */
#ifndef SALTUS_SAMPLE_GRID_H
#define SALTUS_SAMPLE_GRID_H

#include "runtime/sample/estimate.h"
#include "runtime/base/rng.h"

typedef struct Grid {
    bool integral;                /* one "pixel" with the constant filter 1: an integral, not a mean */
    uint32_t dim, n[3];           /* n: pixels by axis, 1 beyond dim */
    double lo[3], hi[3], side[3]; /* of the domain; side of a pixel */
    SltFilter filter;
    double radius;   /* of the filter, in pixels */
    double density;  /* of a box filter: 1 / volume of a pixel */
    double *mass[3]; /* by pixel of the axis: the part of its filter inside the domain; NULL for a box or an integral */
    double *before[3]; /* likewise: the part of its filter's whole range that lies in front of the domain */
    uint64_t pixels;   /* in all */
} Grid;
SltStatus grid_init(Grid *g, const SltScene *s, const SltJob *j, SltError *err);
void grid_free(Grid *g);
/* Index in an image of the pixel (x, y, z), y upwards: rows of the image go down. */
static inline uint64_t grid_index(const Grid *g, uint32_t x, uint32_t y, uint32_t z) {
    return ((uint64_t)z * g->n[1] + (g->n[1] - 1 - y)) * g->n[0] + x;
}
/* The pixel of the axis that holds x. */
static inline uint32_t grid_cell(const Grid *g, uint32_t axis, double x) {
    double c = (x - g->lo[axis]) / g->side[axis];
    if (!(c > 0)) return 0;
    return c >= g->n[axis] ? g->n[axis] - 1 : (uint32_t)c;
}
/* Moves x by units in the last place, of the ends of the domain, until its pixel is one of from .. to - 1. */
void grid_into(const Grid *g, const uint32_t from[3], const uint32_t to[3], double x[3]);
enum { GRID_REACH = 6 }; /* most pixels along an axis whose filters reach a point */
/* Pixels first, first + 1, ... whose filters reach x along an axis, and their normalised weights (1/length); returns
 * how many. */
uint32_t grid_reach(const Grid *g, uint32_t axis, double x, uint32_t *first, double weight[GRID_REACH]);
/* The part of pixel p's filter along an axis that lies between a and b. */
double grid_share(const Grid *g, uint32_t axis, uint32_t p, double a, double b);
/* The position along the axis of a sample of pixel p: u uniform in (0, 1) becomes distributed as the filter, over the
 * part of the domain that it covers. */
double grid_place_filtered(const Grid *g, uint32_t axis, uint32_t p, double u); /* of a filter that is no box */
static inline double grid_place(const Grid *g, uint32_t axis, uint32_t p, double u) {
    if (!g->integral && g->filter != SLT_FILTER_BOX) return grid_place_filtered(g, axis, p, u);
    return g->lo[axis] + (p + u) * g->side[axis];
}
static inline double grid_middle(const Grid *g, uint32_t axis, uint32_t p) {
    return g->lo[axis] + (p + 0.5) * g->side[axis];
}
/* The pixel that holds x, by axis. */
static inline void grid_cells(const Grid *g, const double x[3], uint32_t cell[3]) {
    for (uint32_t d = 0; d < 3; d++) cell[d] = d < g->dim ? grid_cell(g, d, x[d]) : 0;
}
/* Has each point the pixel alone that holds it? */
static inline bool grid_is_box(const Grid *g) { return g->filter == SLT_FILTER_BOX && !g->integral; }
/* grid_gather of a box filter, at any point of the pixel `cell`. */
static inline void grid_gather_box(const Grid *g, const float *adjoint, uint32_t channels, const uint32_t cell[3],
                                   double *out) {
    const float *a = adjoint + grid_index(g, cell[0], cell[1], cell[2]) * channels;
    for (uint32_t c = 0; c < channels; c++) out[c] = g->density * (double)a[c];
}
/* out[channels] = sum over pixels of adjoint * filter at x. */
void grid_gather(const Grid *g, const float *adjoint, uint32_t channels, const double x[3], double *out);
/* The same, of every channel, of an image that is v everywhere. */
double grid_gather_all(const Grid *g, float v, const double x[3]);

/* The samples of a pixel, or of the whole domain: an additive recurrence with a random shift. */
typedef struct Pattern {
    uint32_t dims;     /* of the recurrence: those of the position, and one for number 0 of the stream */
    uint32_t shift[4]; /* by dimension, as fractions of 2^32 */
    uint32_t seed, lane;
    uint64_t owner; /* which pixel or replicate */
    RngPurpose purpose;
} Pattern;
void pattern_init(Pattern *p, const SltScene *s, uint32_t seed, RngPurpose purpose, uint32_t lane, uint64_t owner);
/* Coordinate of sample `index` in a dimension, in [0, 1). */
static inline double pattern_at(const Pattern *p, uint32_t dim, uint64_t index) {
    return rng_recurrence(p->dims, dim, index, p->shift[dim]);
}
int32_t pattern_stream(const Pattern *p, uint64_t index);

#endif
