/* The benchmark of rays against meshes: meshes and rays (mesh_bench.c is the driver, mesh.sh the way to run it). */
#ifndef SALTUS_MESH_BENCH_H
#define SALTUS_MESH_BENCH_H

#include "rays.h"

typedef struct Surface {
    char name[32];
    uint32_t nvertices, nfaces;
    float *vertex;   /* [nvertices][3] */
    double *precise; /* the same numbers */
    uint32_t *face;  /* [nfaces][3] */
    double middle[3], radius;
} Surface;

/* mesh_scenes.c: "spot" (SALTUS_DATA), "spot4", "spot16": its flat subdivisions, "sphere": a noisy one of 10^6
 * triangles. False when the data are not there. */
bool surface_make(Surface *s, const char *name);
void surface_free(Surface *s);
/* Where the ray meets the triangle's plane. */
double surface_distance(const Surface *s, const Ray *r, int32_t triangle);

/* A camera before the mesh that sees all of it. */
Rays rays_primary(const Surface *s, uint32_t size);
/* From points that rays of `from` hit (witness < 0: of that ray itself), to a light above, and over the hemisphere. */
Rays rays_shadow(const Surface *s, const Rays *from, const int32_t *witness);
Rays rays_scattered(const Surface *s, const Rays *from, const int32_t *witness);
/* Between any two points of a sphere around the mesh. */
Rays rays_through(const Surface *s, uint32_t count);

#endif
