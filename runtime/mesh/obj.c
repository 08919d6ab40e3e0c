/* Wavefront OBJ: v, vt, vn, f, and o and g, which number the parts. Other statements mean nothing here. */
#include "internal.h"

#include <string.h>

#include "../base/decimal.h"

typedef struct Obj {
    MeshReader *r;
    const char *at, *end; /* the rest of the line: up to its end, a comment, or the end of the file */
    uint32_t part, parts;
    bool has_faces; /* of this part */
} Obj;

static bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f'; }

/* A line that ends in a backslash goes on in the next one. */
static void skip_blanks(Obj *o) {
    for (;;) {
        while (o->at < o->end && is_blank(*o->at)) o->at++;
        const char *next = o->at + 1;
        if (o->at == o->end || *o->at != '\\') return;
        while (next < o->end && *next == '\r') next++;
        if (next == o->end || *next != '\n') return;
        o->at = next + 1;
    }
}

static bool at_end(Obj *o) {
    skip_blanks(o);
    return o->at == o->end || *o->at == '#';
}

static SltStatus take_numbers(Obj *o, const char *what, uint32_t least, uint32_t most, double *v) {
    uint32_t n = 0;
    while (!at_end(o)) {
        const char *after;
        double x = decimal_read(o->at, &after);
        bool hex = o->at[0] == '0' && (o->at[1] | 32) == 'x';
        if (after == o->at || after > o->end || hex || (after < o->end && !is_blank(*after) && !strchr("#\\", *after)))
            return mesh_fail(o->r, "`%s` wants numbers", what);
        if (n < most) v[n] = x;
        o->at = after, n++;
    }
    return n < least ? mesh_fail(o->r, "`%s` wants %u numbers, there are %u", what, least, n) : SLT_OK;
}

/* An index from 1, or from the end below 0; false where there is none. */
static bool take_index(Obj *o, uint32_t count, uint32_t *index) {
    bool minus = o->at < o->end && *o->at == '-';
    const char *first = o->at += minus;
    uint64_t v = 0;
    for (; o->at < o->end && (unsigned char)(*o->at - '0') < 10 && o->at - first < 10; o->at++)
        v = 10 * v + (uint64_t)(*o->at - '0');
    if (o->at == first || !v || v >= MESH_NONE || (minus && v > count)) return false;
    *index = minus ? count - (uint32_t)v : (uint32_t)v - 1;
    return true;
}

/* v, v/vt, v//vn or v/vt/vn. */
static bool take_corner(Obj *o, uint32_t corner[MESH_CORNERS]) {
    const Mesh *m = o->r->mesh;
    corner[MESH_UV] = corner[MESH_NORMAL] = MESH_NONE;
    if (!take_index(o, m->nvertices, &corner[MESH_VERTEX])) return false;
    if (o->at < o->end && *o->at == '/') {
        o->at++;
        bool uv = o->at < o->end && *o->at != '/' && !is_blank(*o->at);
        if (uv && !take_index(o, m->nuvs, &corner[MESH_UV])) return false;
        if (o->at < o->end && *o->at == '/') {
            o->at++;
            bool normal = o->at < o->end && !is_blank(*o->at);
            if (normal && !take_index(o, m->nnormals, &corner[MESH_NORMAL])) return false;
        }
    }
    return o->at == o->end || is_blank(*o->at) || *o->at == '#' || *o->at == '\\';
}

static SltStatus take_face(Obj *o) {
    uint32_t corner[MESH_CORNERS];
    SltStatus status = SLT_OK;
    mesh_begin_polygon(o->r);
    while (status == SLT_OK && !at_end(o)) {
        const char *text = o->at;
        if (take_corner(o, corner)) {
            status = mesh_add_corner(o->r, corner, o->part);
            continue;
        }
        size_t n = 0;
        while (text + n < o->end && !is_blank(text[n]) && n < 32) n++;
        return mesh_fail(o->r, "`%.*s` is no corner of a face", (int)n, text);
    }
    o->has_faces = true;
    return status == SLT_OK ? mesh_end_polygon(o->r) : status;
}

static bool take_word(Obj *o, const char *word) {
    size_t n = strlen(word);
    if ((size_t)(o->end - o->at) < n || strncmp(o->at, word, n) != 0) return false;
    if (o->at + n < o->end && !is_blank(o->at[n])) return false;
    return o->at += n, true;
}

static SltStatus take_line(Obj *o) {
    double v[3] = {0};
    SltStatus status;
    if (at_end(o)) return SLT_OK;
    if (take_word(o, "v")) {
        status = take_numbers(o, "v", 3, 3, v);
        return status == SLT_OK ? mesh_add_position(o->r, v) : status;
    }
    if (take_word(o, "vn")) {
        status = take_numbers(o, "vn", 3, 3, v);
        return status == SLT_OK ? mesh_add_normal(o->r, v) : status;
    }
    if (take_word(o, "vt")) {
        status = take_numbers(o, "vt", 1, 2, v);
        return status == SLT_OK ? mesh_add_uv(o->r, v) : status;
    }
    if (take_word(o, "f")) return take_face(o);
    /* `o` and then `g` without faces between are one part. */
    if ((take_word(o, "o") || take_word(o, "g")) && o->has_faces) o->part++, o->has_faces = false;
    return SLT_OK;
}

SltStatus mesh_decode_obj(MeshReader *r, const char *text, size_t size) {
    Obj o = {.r = r};
    const char *at = text, *stop = text + size;
    SltStatus status = SLT_OK;
    if (memchr(text, 0, size))
        return status_fail(r->err, SLT_INPUT, "cannot read '%s': it is not a text file", r->name);
    while (status == SLT_OK && at < stop) {
        uint64_t lines = 0;
        const char *end = at;
        for (bool more = true; more; lines++) {
            const char *line = memchr(end, '\n', (size_t)(stop - end));
            const char *last = line ? line : stop;
            while (last > at && last[-1] == '\r') last--;
            more = line && last > at && last[-1] == '\\';
            end = line ? line + 1 : stop;
        }
        o.at = at, o.end = end > at && end[-1] == '\n' ? end - 1 : end;
        status = take_line(&o);
        at = end;
        r->place += lines;
    }
    r->mesh->nparts = r->mesh->nfaces ? r->mesh->part[r->mesh->nfaces - 1] + 1 : 0;
    return status;
}
