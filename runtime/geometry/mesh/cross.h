/* Which segments of a plane cross: one against as many as a register holds. */
#ifndef SALTUS_MESH_CROSS_H
#define SALTUS_MESH_CROSS_H

#include <stdbool.h>
#include <stdint.h>

enum { CROSS_ROOM = 7 }; /* numbers that rows have behind the last, so that a register can be read */

/* Segment k goes from (x, y)[0][k] to (x, y)[1][k]. Ends of the same number are the same place. */
typedef struct CrossRows {
    const double *x[2], *y[2], *end[2];
    const double *blur; /* times twice the area of a triangle on the segment: how far its corner is from the line; what
                           is nearer than CROSS_NEAR may lie on it */
} CrossRows;
#define CROSS_NEAR 1e-12

/* Segment `other` has an end in common with the one that is asked, or it crosses it, from its right to its left if
 * `up`, at these parts of the ways along both. */
typedef struct CrossFound {
    uint32_t other;
    bool shares, up;
    double at, other_at;
} CrossFound;

typedef struct CrossSearch {
    /* Segment i against from .. to - 1: how many of them are found. False: rounding hides whether one crosses it. */
    bool (*row)(const CrossRows *r, uint32_t i, uint32_t from, uint32_t to, CrossFound *found, uint32_t *n);
} CrossSearch;

/* For each instruction set, the same bits from all (facets_plain.c, facets_avx2.c, facets_avx512.c). */
extern const CrossSearch cross_plain, cross_avx2, cross_avx512;

#endif
