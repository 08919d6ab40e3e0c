/* What the readers of meshes share: a mesh that grows, and messages. */
#ifndef SALTUS_RUNTIME_MESH_INTERNAL_H
#define SALTUS_RUNTIME_MESH_INTERNAL_H

#include "mesh.h"

enum { MESH_VERTEX, MESH_UV, MESH_NORMAL, MESH_CORNERS }; /* the indices of a corner */

typedef struct MeshReader {
    const char *name;
    const char *unit; /* "line", "vertex", "face": what `place` counts, from 1 */
    uint64_t place;
    Mesh *mesh;
    SltError *err;
    uint32_t capacity[5]; /* of positions, normals, uvs, faces; of the parts */
    /* the largest index of each kind, and where it stands: faces may come before their vertices */
    uint32_t largest[MESH_CORNERS];
    uint64_t largest_at[MESH_CORNERS];
    uint32_t corners, first[MESH_CORNERS], last[MESH_CORNERS]; /* of the polygon that is being read */
    bool any_uv, any_normal;
    uint32_t counts_from; /* what the file calls its first vertex: 1, or 0 */
} MeshReader;

SltStatus mesh_fail(const MeshReader *r, const char *fmt, ...) __attribute__((format(printf, 2, 3)));
SltStatus mesh_add_position(MeshReader *r, const double v[3]);
SltStatus mesh_add_normal(MeshReader *r, const double v[3]);
SltStatus mesh_add_uv(MeshReader *r, const double v[2]);
/* Corner by corner; the third and each next one makes a triangle. */
void mesh_begin_polygon(MeshReader *r);
SltStatus mesh_add_corner(MeshReader *r, const uint32_t corner[MESH_CORNERS], uint32_t part);
SltStatus mesh_end_polygon(MeshReader *r);

SltStatus mesh_decode_obj(MeshReader *r, const char *text, size_t size);
SltStatus mesh_decode_ply(MeshReader *r, const char *text, size_t size);

#endif
