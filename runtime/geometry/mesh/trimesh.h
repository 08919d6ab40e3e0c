/* Triangle meshes as geometries: geometry_mesh is what runtime/geometry/geometry.h calls; the functions here are for
 * tests and benchmarks, which ask more.
 *
 *   vertices, faces (caller's)  ->  bvh.h  ->  rays.h, one ray against eight boxes  ->  witnesses
 *                    faces      ->  adjacency.h  ->  walk.h, what parts two rays
 *
 * A mesh that nobody asks about rays holds nothing; adjacency is made where [Disc] asks for it. */
#ifndef SALTUS_MESH_TRIMESH_H
#define SALTUS_MESH_TRIMESH_H

#include <stdatomic.h>

#include "adjacency.h"
#include "bvh.h"
#include "cones.h"
#include "rays.h"
#include "runtime/geometry/geometry.h"

typedef enum TrimeshIsa {
    TRIMESH_ISA_BEST,
    TRIMESH_ISA_PLAIN,
    TRIMESH_ISA_AVX2,
    TRIMESH_ISA_AVX512,
    TRIMESH_ISAS
} TrimeshIsa;

typedef struct Trimesh {
    Geometry base;
    GeometrySource from;
    bool dirty, has_tree, has_adjacency;
    /* Queries see the mesh as const. lost: pieces, for want of memory; blind: a window whose numbers are not finite. */
    atomic_bool lost_, *lost, blind_, *blind;
    Bvh bvh;             /* where has_tree */
    Adjacency adjacency; /* where has_adjacency */
    Cones cones;         /* where lights are asked about */
    const BvhSearches *rays;
    const struct FacetSearch *facets;
    const struct BeamSearch *beam;
    const struct CrossSearch *cross;
    char text[96]; /* describe */
} Trimesh;

/* The same with an instruction set: wider than the machine has: SLT_USAGE. */
SltStatus trimesh_make(SltGeometry **out, const GeometrySource *from, const void *values, TrimeshIsa isa,
                       SltError *err);

#endif
