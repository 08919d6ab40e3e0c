/* Any bytes as a mesh. The first byte chooses the format. What is read keeps its promises. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/mesh/mesh.h"
#include "tests/fuzz/fuzz.h"

static void check_indices(const uint32_t *index, size_t n, uint32_t count, bool none_allowed) {
    for (size_t k = 0; index && k < n; k++)
        if (index[k] >= count && !(none_allowed && index[k] == MESH_NONE)) abort();
}

static void check_numbers(const double *v, size_t n) {
    for (size_t k = 0; k < n; k++)
        if (!isfinite(v[k])) abort();
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
    mesh_free(&m);
    return 0;
}
