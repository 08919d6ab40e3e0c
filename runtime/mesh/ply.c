/* Stanford PLY: a header that says what elements have, then the elements, as text or binary of either byte order.
 * Vertices give x y z, nx ny nz and a place in a texture (s t, u v, texture_u texture_v); faces the list vertex_indices
 * (or vertex_index). Other properties and elements are passed over. */
#include "internal.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../base/decimal.h"

typedef enum PlyType { PLY_NONE, PLY_I8, PLY_U8, PLY_I16, PLY_U16, PLY_I32, PLY_U32, PLY_F32, PLY_F64 } PlyType;
static const uint8_t type_bytes[] = {0, 1, 1, 2, 2, 4, 4, 4, 8};

/* What a property is for. */
typedef enum PlyUse { USE_NONE, USE_X, USE_Y, USE_Z, USE_NX, USE_NY, USE_NZ, USE_U, USE_V, USE_INDICES, USES } PlyUse;
enum { MAX_PROPERTIES = 256, MAX_ELEMENTS = 64 };

typedef struct Property {
    PlyType count, type; /* count PLY_NONE: no list */
    PlyUse use;
} Property;

typedef struct Element {
    enum { OTHER, VERTICES, FACES } kind;
    uint64_t n;
    uint32_t first, properties; /* in Ply.property */
} Element;

typedef struct Ply {
    MeshReader *r;
    const char *at, *end;
    bool binary, big;
    Element element[MAX_ELEMENTS];
    Property property[MAX_PROPERTIES];
    uint32_t elements, properties;
} Ply;

/* ---- the header */

/* A word of the line, into buf; "" at its end. */
static const char *next_word(const char **at, const char *end, char buf[32]) {
    size_t n = 0;
    while (*at < end && (**at == ' ' || **at == '\t' || **at == '\r')) ++*at;
    for (; *at < end && **at != ' ' && **at != '\t' && **at != '\r'; ++*at)
        if (n < 31) buf[n++] = **at;
    buf[n] = 0;
    return buf;
}

static PlyType type_named(const char *name) {
    static const struct {
        const char *name;
        PlyType type;
    } names[] = {{"char", PLY_I8},   {"uchar", PLY_U8},   {"short", PLY_I16},   {"ushort", PLY_U16},
                 {"int", PLY_I32},   {"uint", PLY_U32},   {"float", PLY_F32},   {"double", PLY_F64},
                 {"int8", PLY_I8},   {"uint8", PLY_U8},   {"int16", PLY_I16},   {"uint16", PLY_U16},
                 {"int32", PLY_I32}, {"uint32", PLY_U32}, {"float32", PLY_F32}, {"float64", PLY_F64}};
    for (size_t k = 0; k < sizeof names / sizeof *names; k++)
        if (!strcmp(name, names[k].name)) return names[k].type;
    return PLY_NONE;
}

static PlyUse use_named(const Element *e, const char *name, bool list) {
    static const struct {
        const char *name;
        PlyUse use;
    } names[] = {{"x", USE_X}, {"y", USE_Y}, {"z", USE_Z}, {"nx", USE_NX}, {"ny", USE_NY},       {"nz", USE_NZ},
                 {"s", USE_U}, {"t", USE_V}, {"u", USE_U}, {"v", USE_V},   {"texture_u", USE_U}, {"texture_v", USE_V}};
    if (list) {
        bool indices = e->kind == FACES && (!strcmp(name, "vertex_indices") || !strcmp(name, "vertex_index"));
        return indices ? USE_INDICES : USE_NONE;
    }
    for (size_t k = 0; e->kind == VERTICES && k < sizeof names / sizeof *names; k++)
        if (!strcmp(name, names[k].name)) return names[k].use;
    return USE_NONE;
}

static SltStatus take_element(Ply *p, const char *at, const char *end) {
    char word[32];
    if (p->elements == MAX_ELEMENTS) return mesh_fail(p->r, "more than %d elements", MAX_ELEMENTS);
    Element *e = &p->element[p->elements++];
    next_word(&at, end, word);
    *e = (Element){.first = p->properties};
    e->kind = !strcmp(word, "vertex") ? VERTICES : !strcmp(word, "face") ? FACES : OTHER;
    char *stop;
    next_word(&at, end, word);
    e->n = strtoull(word, &stop, 10);
    if (*stop || !(word[0] >= '0' && word[0] <= '9') || e->n > UINT32_MAX)
        return mesh_fail(p->r, "`%s` is no number of elements", word);
    return SLT_OK;
}

static SltStatus take_property(Ply *p, const char *at, const char *end) {
    char word[32];
    Property q = {0};
    if (!p->elements) return mesh_fail(p->r, "a property before the first element");
    if (p->properties == MAX_PROPERTIES) return mesh_fail(p->r, "more than %d properties", MAX_PROPERTIES);
    bool list = !strcmp(next_word(&at, end, word), "list");
    if (list) {
        q.count = type_named(next_word(&at, end, word));
        if (q.count == PLY_NONE || q.count >= PLY_F32)
            return mesh_fail(p->r, "`%s` is no type of a list's length", word);
        next_word(&at, end, word);
    }
    q.type = type_named(word);
    if (q.type == PLY_NONE) return mesh_fail(p->r, "unknown type `%s`", word);
    Element *e = &p->element[p->elements - 1];
    next_word(&at, end, word);
    q.use = use_named(e, word, list);
    for (uint32_t k = 0; k < e->properties; k++)
        if (q.use && p->property[e->first + k].use == q.use) return mesh_fail(p->r, "`%s` is there twice", word);
    p->property[p->properties++] = q;
    e->properties++;
    return SLT_OK;
}

static SltStatus take_format(Ply *p, const char *at, const char *end) {
    char word[32];
    next_word(&at, end, word);
    p->big = !strcmp(word, "binary_big_endian");
    p->binary = p->big || !strcmp(word, "binary_little_endian");
    if (!p->binary && strcmp(word, "ascii") != 0) return mesh_fail(p->r, "unknown format `%s`", word);
    return SLT_OK;
}

static SltStatus take_header(Ply *p) {
    bool format = false;
    char word[32];
    SltStatus status = SLT_OK;
    for (p->r->place = 1; status == SLT_OK; p->r->place++) {
        const char *line = p->at, *end = memchr(line, '\n', (size_t)(p->end - line));
        if (!end) return mesh_fail(p->r, "the file ends in its header");
        p->at = end + 1;
        next_word(&line, end, word);
        if (p->r->place == 1) {
            if (strcmp(word, "ply") != 0) return mesh_fail(p->r, "it is no PLY file");
        } else if (!strcmp(word, "format")) {
            status = take_format(p, line, end), format = true;
        } else if (!strcmp(word, "element")) {
            status = take_element(p, line, end);
        } else if (!strcmp(word, "property")) {
            status = take_property(p, line, end);
        } else if (!strcmp(word, "end_header")) {
            p->r->place++;
            return format ? SLT_OK : mesh_fail(p->r, "the header has no format");
        } else if (*word && strcmp(word, "comment") != 0 && strcmp(word, "obj_info") != 0) {
            return mesh_fail(p->r, "`%s` in the header", word);
        }
    }
    return status;
}

/* ---- the elements */

static SltStatus take_text(Ply *p, double *v) {
    const char *after;
    for (; p->at < p->end && strchr(" \t\r\n", *p->at); p->at++) p->r->place += *p->at == '\n';
    if (p->at == p->end) return mesh_fail(p->r, "the file ends too early");
    *v = decimal_read(p->at, &after);
    bool hex = p->at[0] == '0' && (p->at[1] | 32) == 'x';
    if (after == p->at || hex || after > p->end || (after < p->end && !strchr(" \t\r\n", *after)))
        return mesh_fail(p->r, "a number is wanted");
    p->at = after;
    return SLT_OK;
}

static SltStatus take_number(Ply *p, PlyType type, double *v) {
    uint32_t n = type_bytes[type];
    uint64_t bits = 0;
    if (!p->binary) return take_text(p, v);
    if ((size_t)(p->end - p->at) < n) return mesh_fail(p->r, "the file ends too early");
    for (uint32_t k = 0; k < n; k++) bits |= (uint64_t)(uint8_t)p->at[p->big ? n - 1 - k : k] << 8 * k;
    p->at += n;
    uint32_t low = (uint32_t)bits;
    float single;
    memcpy(&single, &low, sizeof single);
    switch (type) {
    case PLY_I8: *v = (int8_t)bits; break;
    case PLY_I16: *v = (int16_t)bits; break;
    case PLY_I32: *v = (int32_t)bits; break;
    case PLY_F32: *v = (double)single; break;
    case PLY_F64: memcpy(v, &bits, sizeof *v); break;
    default: *v = (double)bits;
    }
    return SLT_OK;
}

static SltStatus take_list(Ply *p, const Property *q) {
    double count, v;
    SltStatus status = take_number(p, q->count, &count);
    if (status != SLT_OK) return status;
    if (!(count >= 0 && count <= UINT32_MAX) || count != floor(count))
        return mesh_fail(p->r, "%g is no length of a list", count);
    if (q->use == USE_INDICES) mesh_begin_polygon(p->r);
    for (uint32_t k = 0; k < (uint32_t)count && status == SLT_OK; k++) {
        status = take_number(p, q->type, &v);
        if (status != SLT_OK || q->use != USE_INDICES) continue;
        if (!(v >= 0 && v < UINT32_MAX) || v != floor(v)) return mesh_fail(p->r, "%g is no vertex", v);
        status = mesh_add_corner(p->r, (const uint32_t[]){(uint32_t)v, MESH_NONE, MESH_NONE}, 0);
    }
    return status == SLT_OK && q->use == USE_INDICES ? mesh_end_polygon(p->r) : status;
}

static SltStatus take_one(Ply *p, const Element *e) {
    double v[USES] = {0};
    bool has[USES] = {false};
    SltStatus status = SLT_OK;
    for (uint32_t k = 0; k < e->properties && status == SLT_OK; k++) {
        const Property *q = &p->property[e->first + k];
        status = q->count ? take_list(p, q) : take_number(p, q->type, &v[q->use]);
        has[q->use] = true;
    }
    if (status != SLT_OK || e->kind != VERTICES) return status;
    status = mesh_add_position(p->r, v + USE_X);
    if (status == SLT_OK && has[USE_NX] && has[USE_NY] && has[USE_NZ]) status = mesh_add_normal(p->r, v + USE_NX);
    if (status == SLT_OK && has[USE_U] && has[USE_V]) status = mesh_add_uv(p->r, v + USE_U);
    return status;
}

static bool has_use(const Ply *p, const Element *e, PlyUse use) {
    for (uint32_t k = 0; k < e->properties; k++)
        if (p->property[e->first + k].use == use) return true;
    return false;
}

static SltStatus take_elements(Ply *p, const Element *e) {
    uint64_t least = 0; /* bytes of one: a claim that the file cannot hold ends before it costs anything */
    for (uint32_t k = 0; k < e->properties; k++) {
        const Property *q = &p->property[e->first + k];
        least += !p->binary ? 1 : type_bytes[q->count ? q->count : q->type];
    }
    if (!least) return SLT_OK;
    if (p->binary) p->r->place = 1;
    if (e->n && e->n > (uint64_t)(p->end - p->at + 1) / least)
        return mesh_fail(p->r, "%llu elements are more than the file holds", (unsigned long long)e->n);
    SltStatus status = SLT_OK;
    for (uint64_t k = 0; k < e->n && status == SLT_OK; k++) {
        if (p->binary) p->r->place = k + 1;
        status = take_one(p, e);
    }
    return status;
}

/* The normal and the place in a texture of a corner are those of its vertex. */
static void corners_as_vertices(MeshReader *r) {
    Mesh *m = r->mesh;
    size_t bytes = 3 * (size_t)m->nfaces * sizeof *m->face;
    if (m->nfaces && m->nnormals == m->nvertices) memcpy(m->face_normal, m->face, bytes), r->any_normal = true;
    if (m->nfaces && m->nuvs == m->nvertices) memcpy(m->face_uv, m->face, bytes), r->any_uv = true;
}

SltStatus mesh_decode_ply(MeshReader *r, const char *text, size_t size) {
    Ply *p = calloc(1, sizeof *p);
    if (!p) return status_fail(r->err, SLT_LIMIT, "cannot read '%s': out of memory", r->name);
    *p = (Ply){.r = r, .at = text, .end = text + size};
    SltStatus status = take_header(p);
    for (uint32_t k = 0; k < p->elements && status == SLT_OK; k++) {
        const Element *e = &p->element[k];
        bool vertices = e->kind == VERTICES, faces = e->kind == FACES;
        if (vertices && !(has_use(p, e, USE_X) && has_use(p, e, USE_Y) && has_use(p, e, USE_Z)))
            status = mesh_fail(r, "vertices have no x, y and z");
        else if (faces && e->n && !has_use(p, e, USE_INDICES))
            status = mesh_fail(r, "faces have no list vertex_indices");
        if (p->binary) r->unit = vertices ? "vertex" : faces ? "face" : "element";
        if (status == SLT_OK) status = take_elements(p, e);
    }
    free(p);
    if (status == SLT_OK) corners_as_vertices(r);
    r->mesh->nparts = r->mesh->nfaces ? 1 : 0;
    return status;
}
