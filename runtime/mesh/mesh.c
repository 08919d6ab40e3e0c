/* Meshes as they grow while a file is read; files by extension; normals of vertices. */
#include "internal.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "../image/image.h"

static const FileKind mesh_file = {.limit = (size_t)1 << 31};

SltStatus mesh_fail(const MeshReader *r, const char *fmt, ...) {
    char text[256];
    va_list args;
    va_start(args, fmt);
    vsnprintf(text, sizeof text, fmt, args);
    va_end(args);
    return status_fail(r->err, SLT_INPUT, "cannot read '%s': %s %llu: %s", r->name, r->unit,
                       (unsigned long long)r->place, text);
}

/* Room for one more row of `each` numbers of `size` bytes in *data. */
static SltStatus grow(MeshReader *r, void *data, uint32_t n, uint32_t each, size_t size, uint32_t *capacity) {
    void *old;
    if (n < *capacity) return SLT_OK;
    if (n >= MESH_MAX_NUMBERS / each)
        return status_fail(r->err, SLT_LIMIT, "'%s' is too large: a mesh has at most 2^28 numbers of a kind", r->name);
    uint32_t want = n ? 2 * n : 64;
    memcpy(&old, data, sizeof old);
    void *fresh = realloc(old, (size_t)want * each * size);
    if (!fresh) return status_fail(r->err, SLT_LIMIT, "cannot read '%s': out of memory", r->name);
    memcpy(data, &fresh, sizeof fresh);
    *capacity = want;
    return SLT_OK;
}

static SltStatus add_row(MeshReader *r, double **data, uint32_t *n, uint32_t *capacity, const double *v,
                         uint32_t each) {
    for (uint32_t k = 0; k < each; k++)
        if (!isfinite(v[k])) return mesh_fail(r, "a number is not finite");
    SltStatus status = grow(r, data, *n, each, sizeof **data, capacity);
    if (status == SLT_OK) memcpy(*data + (size_t)each * (*n)++, v, each * sizeof *v);
    return status;
}

SltStatus mesh_add_position(MeshReader *r, const double v[3]) {
    return add_row(r, &r->mesh->position, &r->mesh->nvertices, &r->capacity[0], v, 3);
}
SltStatus mesh_add_normal(MeshReader *r, const double v[3]) {
    return add_row(r, &r->mesh->normal, &r->mesh->nnormals, &r->capacity[1], v, 3);
}
SltStatus mesh_add_uv(MeshReader *r, const double v[2]) {
    return add_row(r, &r->mesh->uv, &r->mesh->nuvs, &r->capacity[2], v, 2);
}

void mesh_begin_polygon(MeshReader *r) { r->corners = 0; }

static SltStatus add_triangle(MeshReader *r, const uint32_t *const corner[3], uint32_t part) {
    Mesh *m = r->mesh;
    uint32_t capacity = r->capacity[3];
    uint32_t **const lists[MESH_CORNERS] = {&m->face, &m->face_uv, &m->face_normal};
    SltStatus status = grow(r, &m->part, m->nfaces, 1, sizeof *m->part, &r->capacity[4]);
    for (int k = 0; k < MESH_CORNERS && status == SLT_OK; k++) {
        uint32_t room = capacity;
        status = grow(r, lists[k], m->nfaces, 3, sizeof(uint32_t), &room);
        r->capacity[3] = room;
        for (int c = 0; c < 3 && status == SLT_OK; c++) (*lists[k])[3 * (size_t)m->nfaces + (size_t)c] = corner[c][k];
        if (status != SLT_OK) r->capacity[3] = capacity;
    }
    if (status == SLT_OK) m->part[m->nfaces++] = part;
    return status;
}

SltStatus mesh_add_corner(MeshReader *r, const uint32_t corner[MESH_CORNERS], uint32_t part) {
    SltStatus status = SLT_OK;
    for (int k = 0; k < MESH_CORNERS; k++)
        if (corner[k] != MESH_NONE && (!r->largest_at[k] || corner[k] > r->largest[k]))
            r->largest[k] = corner[k], r->largest_at[k] = r->place;
    r->any_uv |= corner[MESH_UV] != MESH_NONE, r->any_normal |= corner[MESH_NORMAL] != MESH_NONE;
    if (!r->corners) memcpy(r->first, corner, sizeof r->first);
    if (r->corners >= 2) status = add_triangle(r, (const uint32_t *const[]){r->first, r->last, corner}, part);
    memcpy(r->last, corner, sizeof r->last);
    r->corners++;
    return status;
}

SltStatus mesh_end_polygon(MeshReader *r) {
    return r->corners < 3 ? mesh_fail(r, "a face of %u corner%s", r->corners, r->corners == 1 ? "" : "s") : SLT_OK;
}

/* Every index is that of something. */
static SltStatus check_indices(MeshReader *r) {
    const Mesh *m = r->mesh;
    const uint32_t count[MESH_CORNERS] = {m->nvertices, m->nuvs, m->nnormals};
    static const char *const what[MESH_CORNERS] = {"vertex", "texture coordinate", "normal"},
                             *const whats[MESH_CORNERS] = {"vertices", "texture coordinates", "normals"};
    for (int k = 0; k < MESH_CORNERS; k++)
        if (r->largest_at[k] && r->largest[k] >= count[k]) {
            r->place = r->largest_at[k];
            return mesh_fail(r, "there is no %s %llu: the file has %u %s%s", what[k],
                             r->largest[k] + (unsigned long long)r->counts_from, count[k], whats[k],
                             r->counts_from ? "" : ", from 0 on");
        }
    return SLT_OK;
}

static const char *extension(const char *path) {
    const char *dot = strrchr(path, '.');
    return dot ? dot : "";
}

bool mesh_is_file(const char *path) {
    return !strcasecmp(extension(path), ".obj") || !strcasecmp(extension(path), ".ply");
}

SltStatus mesh_decode(const char *name, const uint8_t *bytes, size_t size, Mesh *out, SltError *err) {
    *out = (Mesh){0};
    static const uint8_t mark[] = {0xef, 0xbb, 0xbf}; /* of UTF-8, which some editors put first */
    if (size >= sizeof mark && !memcmp(bytes, mark, sizeof mark)) bytes += sizeof mark, size -= sizeof mark;
    const bool ply = !strcasecmp(extension(name), ".ply");
    MeshReader r = {.name = name, .unit = "line", .place = 1, .counts_from = !ply, .mesh = out, .err = err};
    SltStatus status = (ply ? mesh_decode_ply : mesh_decode_obj)(&r, (const char *)bytes, size);
    if (status == SLT_OK) status = check_indices(&r);
    if (status == SLT_OK && !out->nvertices)
        status = status_fail(err, SLT_INPUT, "cannot read '%s': there are no vertices in it", name);
    if (!r.any_uv) free(out->face_uv), out->face_uv = NULL;
    if (!r.any_normal) free(out->face_normal), out->face_normal = NULL;
    if (status != SLT_OK) mesh_free(out);
    return status;
}

SltStatus mesh_read(const char *path, Mesh *out, SltError *err) {
    uint8_t *bytes = NULL;
    size_t size;
    *out = (Mesh){0};
    if (!mesh_is_file(path)) return status_fail(err, SLT_INPUT, "cannot read '%s': a mesh is .obj or .ply", path);
    SltStatus status = file_read_all(path, &mesh_file, &bytes, &size, err);
    if (status == SLT_OK) status = mesh_decode(path, bytes, size, out, err);
    free(bytes);
    return status;
}

void mesh_free(Mesh *m) {
    if (!m) return;
    free(m->position), free(m->normal), free(m->uv), free(m->face), free(m->face_normal), free(m->face_uv);
    free(m->part);
    *m = (Mesh){0};
}

void mesh_vertex_normals(const Mesh *m, double *out) {
    memset(out, 0, 3 * (size_t)m->nvertices * sizeof *out);
    for (size_t f = 0; f < m->nfaces; f++) {
        const uint32_t *v = m->face + 3 * f, *n = m->face_normal ? m->face_normal + 3 * f : NULL;
        const double *a = m->position + 3 * (size_t)v[0], *b = m->position + 3 * (size_t)v[1],
                     *c = m->position + 3 * (size_t)v[2];
        double e[3], g[3];
        for (int k = 0; k < 3; k++) e[k] = b[k] - a[k], g[k] = c[k] - a[k];
        double area[3] = {e[1] * g[2] - e[2] * g[1], e[2] * g[0] - e[0] * g[2], e[0] * g[1] - e[1] * g[0]};
        for (int corner = 0; corner < 3; corner++) {
            const double *add = n && n[corner] != MESH_NONE ? m->normal + 3 * (size_t)n[corner] : NULL;
            if (!add && m->face_normal) continue; /* others of this vertex may say */
            double *to = out + 3 * (size_t)v[corner];
            for (int k = 0; k < 3; k++) to[k] += add ? add[k] : area[k];
        }
    }
    for (size_t v = 0; v < m->nvertices; v++) {
        double *n = out + 3 * v, length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
        for (int k = 0; k < 3; k++) n[k] = length > 0 && isfinite(length) ? n[k] / length : 0;
    }
}
