/* Safety shapes (Baboud, Eisemann, Seidel 2012): for every cell a cylinder and a cone inside which a ray that starts
 * anywhere above the cell meets the surface at most once.
 *
 *        \              /   slope            u: how far along its longer horizontal axis a ray has come, in cells
 *         \   free     /                     the shape: u <= radius, or height > base + slope * u
 *          \__      __/  base + slope * u    limiting triangles: those whose back such a ray can hit
 *             |    |
 *             |____|     radius
 *
 * Without relaxation (`exact` not set, no bound on the slope: every radius 0) the shape holds no terrain at all, and a
 * step needs no test. A relaxed shape may hold one crossing: the end of a step is tested, and the crossing found by
 * bisection. Departures from the paper: shapes are for start points anywhere in a cell and not on its centre line, a
 * step ends where the shape does and not on a grid line, and a shape is not told which triangles a ray can see (rays
 * may start on the surface).
 *
 * A field owns its cones; they are read-only while queries run. */
#ifndef SALTUS_HEIGHTFIELD_CONE_H
#define SALTUS_HEIGHTFIELD_CONE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct FieldConeOptions {
    bool directional; /* a shape for each of +x, -x, +y, -y as a ray's main direction: four times the memory of one for
                         all */
    bool exact;       /* only limiting triangles count, at their distances; else all terrain, in rings that grow by a
                         quarter */
    bool bounded;     /* shapes are for rays that rise at most by max_slope a unit of horizontal length; steeper rays
                         step cell by cell */
    float max_slope;
} FieldConeOptions;

enum { FIELD_CONE_MAX_RADIUS = 16 }; /* cells */

typedef struct FieldCones {
    uint32_t w, h;    /* vertices; the shape of cell (i, j) and class c is number (c * h + j) * w + i */
    uint32_t classes; /* of main directions: 1, or 4: +x, -x, +y, -y */
    bool relaxed;     /* a step may cross the surface once */
    FieldConeOptions options;
    float lowest, step; /* base = lowest + step * (packed & 0xffff), slope = the float of packed & 0xffff0000, >= 0;
                           both rounded up */
    double magnitude;   /* the largest finite |height| */
    uint32_t *packed;   /* by number of the shape */
    uint8_t *radius;    /* in cells, by number of the shape; NULL: 0 everywhere */
} FieldCones;

/* cone_build.c. heights: rows from the top, as in saltus/heightfield.h. False when out of memory. */
bool cone_build(FieldCones *c, const void *heights, bool f64, uint32_t w, uint32_t h, const FieldConeOptions *options);
void cone_free(FieldCones *c);
size_t cone_bytes(const FieldCones *c);

#endif
