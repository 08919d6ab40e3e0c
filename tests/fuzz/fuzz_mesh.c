/* Any bytes as a mesh. The first byte chooses the format. What is read keeps its promises, as a geometry too: welded,
 * counted, met by rays and seen through a window. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/geometry/geometry.h"
#include "runtime/mesh/mesh.h"
#include "saltus/mesh.h"
#include "tests/fuzz/fuzz.h"

static void check_indices(const uint32_t *index, size_t n, uint32_t count, bool none_allowed) {
    for (size_t k = 0; index && k < n; k++)
        if (index[k] >= count && !(none_allowed && index[k] == MESH_NONE)) abort();
}

static void check_numbers(const double *v, size_t n) {
    for (size_t k = 0; k < n; k++)
        if (!isfinite(v[k])) abort();
}

/* Rays, and what is seen of the mesh from outside of it; witnesses name what is there. */
static void search(const Mesh *m, const int32_t *topology, const void *values, bool f64) {
    static const double ray[SLT_RAY_POINT_ROWS] = {0.3, 0.2, 5, -0.01, 0.02, -1, 0, 1e9},
                        beam[SLT_BEAM_ROWS + 1] = {0, 0, 5, -1, -1, 0, 2, 0, 0, 0, 2, 0};
    float narrow[SLT_BEAM_ROWS + 1];
    int32_t id;
    SltGeometry *g = NULL;
    SltError err = {0};
    const GeometrySource from = {.kind = SLT_GEOMETRY_MESH,
                                 .f64 = f64,
                                 .nvertices = m->nvertices,
                                 .nfaces = m->nfaces,
                                 .faces = topology,
                                 .queries = 1u << SLT_QUERY_TRACE | 1u << SLT_QUERY_BEGIN | 1u << SLT_QUERY_PIECES};
    if (geometry_make(&g, &from, values, &err) != SLT_OK) return;
    for (int k = 0; k < SLT_RAY_POINT_ROWS; k++) narrow[k] = (float)ray[k];
    g->query[SLT_QUERY_TRACE](g, values, f64 ? (const void *)ray : narrow, 1, 1, &id);
    if (id < SLT_WITNESS_NONE || id >= (int32_t)m->nfaces) abort();
    g->query[SLT_QUERY_BEGIN](g, values, f64 ? (const void *)ray : narrow, 1, 1, &id);
    for (int k = 0; k < SLT_BEAM_ROWS + 1; k++) narrow[k] = (float)beam[k];
    g->query[SLT_QUERY_PIECES](g, values, f64 ? (const void *)beam : narrow, 1, 1, &id);
    if (id < SLT_WITNESS_NONE) abort();
    geometry_free(g);
}

static void use(Mesh *m) {
    uint32_t *part = malloc((m->nvertices + 1u) * sizeof *part);
    if (part && mesh_weld(m, part) && m->nfaces) {
        const size_t faces = 3 * (size_t)m->nfaces, numbers = 3 * (size_t)m->nvertices;
        int32_t *topology = malloc(SLT_MESH_TOPOLOGY(m->nfaces, false) * sizeof *topology);
        float *narrow = malloc((numbers + 1) * sizeof *narrow);
        MeshCounts counts;
        check_indices(m->face, faces, m->nvertices, false);
        check_indices(part, m->nvertices, m->nparts, false);
        for (size_t k = 0; topology && k < faces; k++) topology[k] = (int32_t)m->face[k];
        for (size_t k = 0; topology && k < m->nfaces; k++) topology[faces + k] = (int32_t)m->part[k];
        for (size_t k = 0; narrow && k < numbers; k++) narrow[k] = (float)m->position[k];
        if (topology && mesh_inspect(m->position, m->nvertices, topology, topology + faces, m->nfaces, &counts) &&
            (counts.lone > m->nvertices || counts.duplicates >= m->nfaces || counts.open_edges > counts.edges))
            abort();
        if (topology && narrow && m->nfaces <= 1 << 10)
            search(m, topology, narrow, false), search(m, topology, m->position, true);
        free(topology), free(narrow);
    }
    free(part);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (size < 1 || size > 1 << 18) return 0;
    uint8_t *text = malloc(size);
    if (!text) return 0;
    memcpy(text, data + 1, size - 1);
    text[size - 1] = 0;
    Mesh m;
    SltError err = {0};
    SltStatus status = mesh_decode(data[0] & 1 ? "a.ply" : "a.obj", text, size - 1, &m, &err);
    free(text);
    if (status != SLT_OK) {
        if (!err.text[0] || m.position || m.face) abort();
        return 0;
    }
    size_t corners = 3 * (size_t)m.nfaces;
    check_indices(m.face, corners, m.nvertices, false);
    check_indices(m.face_normal, corners, m.nnormals, true), check_indices(m.face_uv, corners, m.nuvs, true);
    check_indices(m.part, m.nfaces, m.nparts, false);
    check_numbers(m.position, 3 * (size_t)m.nvertices), check_numbers(m.normal, 3 * (size_t)m.nnormals);
    check_numbers(m.uv, 2 * (size_t)m.nuvs);
    double *normals = malloc(3 * (size_t)m.nvertices * sizeof *normals);
    if (normals) mesh_vertex_normals(&m, normals);
    free(normals);
    use(&m);
    mesh_free(&m);
    return 0;
}
