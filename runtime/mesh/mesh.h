/* Triangle meshes from files: OBJ and PLY (text, binary of both byte orders).
 *
 * A Mesh is what the file says, in its order: vertices are not joined, and unused ones stay. Polygons are fans from
 * their first vertex: a b c d is a b c, a c d. A corner may have a normal and a place in a texture of its own, by
 * further indices, as OBJ has them. Ownership: mesh_free releases what a Mesh holds. Numbers are doubles, as written.
 *
 * Readers take untrusted input: what is missing, cut off, out of range or not finite is an SltError that names the
 * file, the line (of binary files the element) and the cause, and leaves the mesh empty. Memory is at most 64 bytes for
 * each byte of the file. Threads: no global state. */
#ifndef SALTUS_RUNTIME_MESH_H
#define SALTUS_RUNTIME_MESH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "../base/status.h"

#define MESH_NONE UINT32_MAX /* a corner without a normal or a place in a texture */
enum { MESH_MAX_NUMBERS = 1 << 28 };

typedef struct Mesh {
    uint32_t nvertices, nfaces, nnormals, nuvs;
    uint32_t nparts;                 /* at least 1 where there are faces */
    double *position;                /* [nvertices][3] */
    double *normal;                  /* [nnormals][3]: of any length */
    double *uv;                      /* [nuvs][2] */
    uint32_t *face;                  /* [nfaces][3]: vertices */
    uint32_t *face_normal, *face_uv; /* [nfaces][3]; NULL: no corner has any */
    uint32_t *part;                  /* [nfaces]: which `o` or `g` of an OBJ, from 0; 0 in a PLY */
} Mesh;

/* Does the name end in .obj or .ply? */
bool mesh_is_file(const char *path);

/* By extension. `out` need not be initialised. */
SltStatus mesh_read(const char *path, Mesh *out, SltError *err);
/* The same from memory; bytes[size] is 0. `name` is used for the format and in messages. */
SltStatus mesh_decode(const char *name, const uint8_t *bytes, size_t size, Mesh *out, SltError *err);
void mesh_free(Mesh *m);

/* Vertices of one part with equal positions become one, in the order of the file; unused ones stay. A vertex is of the
 * part of the first face that has it, unused ones of part 0; vertex_part[nvertices] gets that of each that is left.
 * False when out of memory: the mesh is as it was but for positions. */
bool mesh_weld(Mesh *m, uint32_t *vertex_part);

/* A normal of unit length for each vertex, out[nvertices][3]: the mean of those of its corners, and where the file has
 * none the mean of its faces' (by area). Of a vertex without either (0, 0, 0). */
void mesh_vertex_normals(const Mesh *m, double *out);

/* ---- inspect.c: counts of a welded mesh, which tell whether light leaks and where no derivative exists. */
typedef struct MeshCounts {
    uint32_t vertices, triangles, parts, edges;
    uint32_t open_edges;        /* of one face */
    uint32_t nonmanifold_edges; /* of more than two */
    uint32_t duplicates;        /* faces that lie where an earlier one does, corner on corner */
    uint32_t degenerate;        /* faces without an area */
    uint32_t on_edges;          /* vertices that lie on an edge between two others: T-junctions */
    uint32_t lone;              /* vertices of no face */
} MeshCounts;
/* face[nfaces][3], part[nfaces]. False when out of memory. */
bool mesh_inspect(const double *position, uint32_t nvertices, const int32_t *face, const int32_t *part, uint32_t nfaces,
                  MeshCounts *out);

#endif
