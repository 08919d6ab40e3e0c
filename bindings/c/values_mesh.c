/* Arrays from meshes: "spot.obj" gives positions to an array of floats and faces to one of integers, "spot.obj:normals"
 * and the like what is named. */
#include <stdlib.h>
#include <string.h>

#include "bindings/c/values_read.h"
#include "runtime/mesh/mesh.h"

typedef enum MeshPart {
    MESH_POSITIONS,
    MESH_FACES,
    MESH_NORMALS,
    MESH_UV_CORNERS,
    MESH_PARTS,
    MESH_PART_COUNT
} MeshPart;
static const struct {
    const char *name;
    uint32_t each; /* numbers a vertex or face */
    bool whole;    /* they are integers */
} parts[] = {[MESH_POSITIONS] = {"positions", 3, false},
             [MESH_FACES] = {"faces", 3, true},
             [MESH_NORMALS] = {"normals", 3, false},
             [MESH_UV_CORNERS] = {"uv", 6, false},
             [MESH_PARTS] = {"parts", 1, true}};

/* The file in front of `:part`, into file[4096]; false: the path is no mesh's. Part "": the path names none. */
static bool split(const char *path, char file[4096], const char **part) {
    const char *colon = strrchr(path, ':');
    if (strlen(path) >= 4096) return false;
    strcpy(file, path);
    *part = "";
    if (mesh_is_file(file)) return true;
    if (!colon) return false;
    file[colon - path] = 0;
    *part = colon + 1;
    return mesh_is_file(file);
}

bool values_is_mesh(const char *path) {
    char file[4096];
    const char *part;
    return split(path, file, &part);
}

static const Type *scalar_of(const Type *t) {
    while (t->kind == T_ARRAY || t->kind == T_VECTOR || t->kind == T_MATRIX) t = t->elem;
    return t;
}

/* The numbers that the path names, for a value of that type: *out malloc'd, rows x *each of them. */
static SltStatus read_part(const char *path, const Type *t, double **out, size_t *rows, uint32_t *each, SltError *err) {
    char file[4096];
    const char *name;
    if (!split(path, file, &name)) return status_fail(err, SLT_INPUT, "'%s' is no mesh", path);
    TypeKind kind = scalar_of(t)->kind;
    bool whole = kind == T_INT || kind == T_UINT;
    int part = *name ? 0 : whole ? MESH_FACES : MESH_POSITIONS;
    while (*name && part < MESH_PART_COUNT && strcmp(parts[part].name, name) != 0) part++;
    if (part == MESH_PART_COUNT)
        return status_fail(err, SLT_INPUT, "'%s': a mesh has positions, faces, normals, uv and parts, and no `%s`",
                           file, name);
    if (parts[part].whole && !whole)
        return status_fail(err, SLT_INPUT, "'%s': %s are integers, int3 or uint3", path, parts[part].name);
    Mesh m;
    SltStatus status = mesh_read(file, &m, err);
    if (status != SLT_OK) return status;
    bool by_vertex = part == MESH_POSITIONS || part == MESH_NORMALS;
    *rows = by_vertex ? m.nvertices : m.nfaces, *each = parts[part].each;
    size_t n = *rows * *each;
    double *v = *out = calloc(n ? n : 1, sizeof *v);
    if (!v) status = status_fail(err, SLT_LIMIT, "%s: out of memory", file);
    else if (!n) status = status_fail(err, SLT_INPUT, "there are no faces in %s", file);
    else if (part == MESH_UV_CORNERS && !m.face_uv)
        status = status_fail(err, SLT_INPUT, "there are no texture coordinates in %s", file);
    else if (part == MESH_POSITIONS) memcpy(v, m.position, n * sizeof *v);
    else if (part == MESH_NORMALS) mesh_vertex_normals(&m, v);
    for (size_t k = 0; status == SLT_OK && k < n; k++) {
        if (part == MESH_FACES) v[k] = m.face[k];
        if (part == MESH_PARTS) v[k] = m.part[k];
        if (part == MESH_UV_CORNERS && m.face_uv[k / 2] != MESH_NONE) v[k] = m.uv[2 * (size_t)m.face_uv[k / 2] + k % 2];
    }
    if (status != SLT_OK) free(v), *out = NULL;
    mesh_free(&m);
    return status;
}

SltStatus values_read_mesh(Stage *s, const Param *q, const char *path) {
    double *v;
    size_t rows;
    uint32_t each;
    SltStatus status = read_part(path, q->type, &v, &rows, &each, s->err);
    if (status != SLT_OK) return status;
    status = values_fill(s, q, path, v, rows * each);
    free(v);
    return status;
}

SltStatus values_probe_mesh(const char *path, const Type *t, uint32_t dims[4], uint32_t *ndims, SltError *err) {
    double *v;
    size_t rows;
    SltStatus status = read_part(path, t, &v, &rows, &dims[1], err);
    if (status != SLT_OK) return status;
    dims[0] = (uint32_t)rows, *ndims = 2;
    free(v);
    return status;
}
