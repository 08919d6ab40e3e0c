/* Safety shapes (Baboud, Eisemann, Seidel 2012): for every cell a cylinder and a cone inside which a ray that starts
 * anywhere above the cell meets the surface at most once.
 *
 *        \              /   slope s          u: how far along its longer horizontal axis a ray has come, in cells
 *         \   free     /                     the shape: u <= radius, or height > base + slope * u
 *          \__      __/  base + slope * r    what limits it: triangles whose back such a ray can hit ("limiting")
 *             |    |
 *             |____|     radius r
 *
 * Without relaxation (`exact` not set, no bound on the slope: every radius 0) the shape holds no terrain at all; a step
 * is then free of any test. Where it may hold one crossing, the end of a step is tested and the crossing found by
 * bisection. Departures from the paper: shapes are for start points anywhere in a cell and not on its centre line, a
 * step ends where the shape does and not on a grid line, and which triangles a ray can see is not asked (rays may start
 * on the surface).
 *
 * A field owns its cones; they are read-only while queries run. */
#ifndef SALTUS_HEIGHTSLT_STRUCTURE_CONE_H
#define SALTUS_HEIGHTSLT_STRUCTURE_CONE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct FieldConeOptions {
    bool directional; /* a shape for each of +x, -x, +y, -y as a ray's main direction, instead of one for all: four
                         times the memory */
    bool exact; /* only triangles that limit count, at their distances; else all terrain in rings that grow by a quarter
                 */
    bool bounded; /* only for rays that rise at most by max_slope a unit of horizontal length; the others step cell by
                     cell */
    float max_slope;
} FieldConeOptions;

enum { FIELD_CONE_MAX_RADIUS = 16 };

typedef struct FieldCones {
    uint32_t w, h;    /* vertices; the shape of cell (i, j) and class c is number (c * h + j) * w + i */
    uint32_t classes; /* 1 or 4: +x, -x, +y, -y */
    bool relaxed;     /* a step may cross the surface once */
    FieldConeOptions options;
    float lowest, step; /* base = lowest + step * (packed & 0xffff); slope: the float of packed & 0xffff0000, >= 0. Both
                           rounded up */
    double magnitude;   /* the largest finite |height| */
    uint32_t *packed;
    uint8_t *radius; /* NULL: 0 everywhere */
} FieldCones;

/* cone_build.c. heights: rows from the top, as in saltus/heightfield.h. False when out of memory. */
bool cone_build(FieldCones *c, const void *heights, bool f64, uint32_t w, uint32_t h, const FieldConeOptions *options);
void cone_free(FieldCones *c);
size_t cone_bytes(const FieldCones *c);

#endif
