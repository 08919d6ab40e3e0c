/* Arrays from meshes: "spot.obj" gives positions to an array of floats and faces to one of integers, "spot.obj:normals"
 * and the like what is named. And meshes that are geometries: vertices that lie at one place are one there, and what is
 * between them never changes. */
#include <stdlib.h>
#include <string.h>

#include "bindings/c/values_read.h"
#include "runtime/mesh/mesh.h"
#include "saltus/mesh.h"

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

/* ---- geometries */

static SltStatus read_welded(const char *path, Mesh *m, uint32_t **vertex_part, SltError *err) {
    *vertex_part = NULL;
    *m = (Mesh){0};
    if (!mesh_is_file(path))
        return status_fail(err, SLT_INPUT, "'%s' is no mesh: the value of a mesh is a file of .obj or .ply", path);
    SltStatus status = mesh_read(path, m, err);
    if (status != SLT_OK) return status;
    *vertex_part = calloc(m->nvertices + 1u, sizeof **vertex_part);
    if (!*vertex_part || !mesh_weld(m, *vertex_part)) status = status_fail(err, SLT_LIMIT, "%s: out of memory", path);
    else if (!m->nfaces) status = status_fail(err, SLT_INPUT, "there are no faces in %s", path);
    if (status == SLT_OK) return SLT_OK;
    free(*vertex_part), mesh_free(m);
    return status;
}

SltStatus values_probe_geometry(const char *path, uint32_t dims[4], uint32_t *ndims, SltError *err) {
    Mesh m;
    uint32_t *part;
    SltStatus status = read_welded(path, &m, &part, err);
    if (status != SLT_OK) return status;
    dims[0] = m.nvertices, dims[1] = m.nfaces, dims[2] = m.face_uv != NULL, *ndims = 4;
    memset(part, 0, m.nvertices * sizeof *part); /* now how many faces a vertex has */
    for (size_t k = 0; k < 3 * (size_t)m.nfaces; k++) part[m.face[k]]++;
    for (uint32_t v = dims[3] = 0; v < m.nvertices; v++) dims[3] = part[v] > dims[3] ? part[v] : dims[3];
    free(part), mesh_free(&m);
    return SLT_OK;
}

/* As saltus/mesh.h has it. */
static void topology_of(const Mesh *m, int32_t *to) {
    for (size_t k = 0; k < 3 * (size_t)m->nfaces; k++) *to++ = (int32_t)m->face[k];
    for (size_t k = 0; k < m->nfaces; k++) *to++ = (int32_t)m->part[k];
    for (size_t k = 0; m->face_uv && k < 6 * (size_t)m->nfaces; k++) {
        uint32_t at = m->face_uv[k / 2];
        double v = at != MESH_NONE ? m->uv[2 * (size_t)at + k % 2] : 0;
        float high = (float)v, low = (float)(v - (double)high);
        memcpy(to++, &high, sizeof high);
        memcpy(to++, &low, sizeof low);
    }
}

/* The faces around each vertex, in their order. */
static void rings_of(const Mesh *m, int32_t *rings) {
    int32_t *face = rings + m->nvertices + 1;
    memset(rings, 0, (m->nvertices + 1u) * sizeof *rings);
    for (size_t k = 0; k < 3 * (size_t)m->nfaces; k++) rings[m->face[k] + 1]++;
    for (uint32_t v = 0; v < m->nvertices; v++) rings[v + 1] += rings[v];
    for (size_t k = 0; k < 3 * (size_t)m->nfaces; k++) face[rings[m->face[k]]++] = (int32_t)(k / 3);
    for (uint32_t v = m->nvertices; v > 0; v--) rings[v] = rings[v - 1];
    rings[0] = 0;
}

/* Positions; the first time its topology, later on only files with the same one. */
static SltStatus read_geometry(Stage *s, const Param *q, const char *path) {
    Mesh m;
    uint32_t *part;
    SltStatus status = read_welded(path, &m, &part, s->err);
    if (status != SLT_OK) return status;
    bool *loaded = &s->p->asset_loaded[q - s->p->prog->params];
    int32_t *topology = malloc((q->tcount + 1u) * sizeof *topology);
    bool fits = m.nvertices * 3 == q->fcount && m.nfaces == q->sym->nfaces && (m.face_uv != NULL) == q->sym->has_uv;
    if (!topology) {
        status = status_fail(s->err, SLT_LIMIT, "%s: out of memory", path);
    } else if (fits) {
        topology_of(&m, topology);
        size_t same = (size_t)q->sym->nfaces * (SLT_MESH_FACE + SLT_MESH_PART) * sizeof *topology;
        fits = !*loaded || !memcmp(topology, s->ints + q->tbase, same);
    }
    if (status == SLT_OK && !fits)
        status = status_fail(s->err, SLT_INPUT,
                             "%s has %u vertices and %u triangles; those of `%s` are %u and %u, and fixed: only a file "
                             "with the same triangles can give it other positions",
                             path, m.nvertices, m.nfaces, q->name, q->fcount / 3, q->sym->nfaces);
    if (status == SLT_OK) {
        memcpy(s->floats + q->fbase, m.position, q->fcount * sizeof(double));
        if (!*loaded) memcpy(s->ints + q->tbase, topology, q->tcount * sizeof *topology);
        if (q->vertex_parts) memcpy(s->ints + q->vertex_parts, part, m.nvertices * sizeof *part);
        if (q->rings) rings_of(&m, s->ints + q->rings);
        *loaded = true;
    }
    free(topology), free(part), mesh_free(&m);
    return status;
}

SltStatus values_read_mesh(Stage *s, const Param *q, const char *path) {
    double *v;
    size_t rows;
    uint32_t each;
    if (q->is_mesh) return read_geometry(s, q, path);
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
