/* What the files of this folder share. */
#ifndef SALTUS_HEIGHTFIELD_INTERNAL_H
#define SALTUS_HEIGHTFIELD_INTERNAL_H

#include "cone.h"
#include "field.h"

enum {
    MIP_LEVELS = 16, /* table size: levels 1 .. 15; a larger field has several nodes at the top */
    MIP_MAX_SIDE = 1 << 24
};

/* Level l has ceil((w-1) / 2^l) x ceil((h-1) / 2^l) nodes, node (I, J) at data[base[l] + J * stride[l] + I]: the
 * maximum over the vertices of its cells, borders included. There is no level 0: the test of a cell reads the four
 * heights at its corners anyway. */
typedef struct Mipmap {
    float *data;
    /* By level; entry 0 is that of level 1, so that a lane that is at a cell looks up something valid. */
    int32_t base[MIP_LEVELS], stride[MIP_LEVELS], rows[MIP_LEVELS];
    int32_t top;  /* the last level */
    float max;    /* over all heights */
    size_t count; /* numbers in data */
} Mipmap;

typedef struct Field {
    Geometry base;
    uint32_t w, h; /* vertices, each at least 2 */
    FieldOptions options;
    uint32_t x0, y0, x1, y1; /* vertices whose heights have changed since the last refresh, y upwards; x0 >= x1: none */
    FieldIsa isa;
    bool f64;
    double magnitude; /* the largest finite |height| since the field was made, or more: the scale of rounding errors */
    Mipmap mip;       /* data is NULL where no query needs it */
    FieldCones cones; /* packed is NULL where no query needs it */
    char text[160];   /* field_describe */
} Field;

static inline const Field *field_impl(const SltGeometry *field) { return field->made; }

/* The field that a query is asked of. `field` may be a copy with another slack (finite differences): then the whole is
 * copied to `room`, with that slack. */
static inline const Field *field_asked(const SltGeometry *field, Field *room) {
    const Field *f = field->made;
    if (field == &f->base.shared) return f;
    *room = *f;
    room->base.shared = *field;
    return room;
}

/* The edges that field_silhouettes collects; count goes on beyond cap. */
typedef struct Slice {
    int32_t *id;
    uint32_t cap, count;
} Slice;

static inline void slice_add(Slice *s, int32_t id) {
    if (s->count < s->cap) s->id[s->count] = id;
    s->count++;
}

/* What is compiled for each instruction set. */
typedef struct FieldKernels {
    SltQueryFn *query[2][SLT_QUERIES]; /* [f64] */
    SltQueryFn *cone[2];               /* [f64]: trace and occluded by safety shapes (cone.inc.h) */
    /* One row of level 1 from the three rows of vertices that its cells touch, or two: c == b; returns the largest
     * finite |height|. Then one row of the next level from two rows of this. w: vertices, or nodes, of a row. */
    float (*first_level32)(const float *a, const float *b, const float *c, uint32_t w, float *out, float *scratch);
    double (*first_level64)(const double *a, const double *b, const double *c, uint32_t w, float *out, float *scratch);
    void (*next_level)(const float *a, const float *b, uint32_t w, float *out);
} FieldKernels;

/* naive.c: cell by cell */
extern SltQueryFn *const field_naive[2][SLT_QUERIES];
void field_naive_count(const Field *f, SltQuery what, const void *heights, const void *rays, uint64_t mask,
                       uint32_t width, int32_t *id, FieldCounts *counts);
void field_naive_slice(const Field *f, const void *heights, const void *ray, Slice *slice, FieldCounts *counts);

/* packet_*.c: one instance for each instruction set */
extern const FieldKernels field_scalar, field_sse2, field_avx2, field_avx512;
void field_scalar_count(const Field *f, SltQuery what, const void *heights, const void *rays, uint64_t mask,
                        uint32_t width, int32_t *id, FieldCounts *counts);
void field_scalar_cone_count(const Field *f, const void *heights, const void *rays, uint64_t mask, uint32_t width,
                             int32_t *id, FieldCounts *counts);
void field_scalar_slice(const Field *f, const void *heights, const void *ray, Slice *slice,
                        FieldCounts *counts); /* ray: width 1 */

/* boxes.c: SLT_QUERY_BLOCKED, of either precision; the field has a mipmap */
SltQueryFn field_boxes;

/* mipmap.c */
bool mipmap_make(Field *f, const void *heights);
void mipmap_refresh(Field *f, const void *heights, uint32_t x0, uint32_t y0, uint32_t x1, uint32_t y1);
void mipmap_free(Mipmap *m);
const FieldKernels *field_kernels(FieldIsa isa);
#endif
