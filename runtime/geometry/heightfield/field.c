/* Making, refreshing and freeing fields; which kernels serve which structure. */
#include "internal.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/base/cpu.h"

static FieldIsa best_isa(void) {
#if defined(__x86_64__)
    if (cpu_has_avx512()) return FIELD_ISA_AVX512;
    if (cpu_has_avx2()) return FIELD_ISA_AVX2;
    return FIELD_ISA_SSE2;
#else
    return FIELD_ISA_SCALAR;
#endif
}

const FieldKernels *field_kernels(FieldIsa isa) {
#if defined(__x86_64__)
    switch (isa) {
    case FIELD_ISA_AVX512: return &field_avx512;
    case FIELD_ISA_AVX2: return &field_avx2;
    case FIELD_ISA_SSE2: return &field_sse2;
    case FIELD_ISA_SCALAR:
    case FIELD_ISA_BEST:
    case FIELD_ISAS: break;
    }
#else
    (void)isa;
#endif
    return &field_scalar;
}

static const char *const isa_names[FIELD_ISAS] = {"", "scalar", "SSE2", "AVX2", "AVX-512"};

/* RISE walks from where a ray is blocked to the next ridge, a few cells: packets, but no structure. */
static const uint32_t all_queries = (1u << SLT_QUERIES) - 1, searching = all_queries & ~(1u << SLT_QUERY_RISE);
/* Bounds need the levels whatever searches. */
static const uint32_t bounding = 1u << SLT_QUERY_BLOCKED;

static const uint32_t hits =
    1u << SLT_QUERY_TRACE | 1u << SLT_QUERY_OCCLUDED; /* served by safety shapes; the others by the mipmap */

static bool make_cones(Field *f, const void *heights) {
    const FieldOptions *o = &f->options;
    const FieldConeOptions options = {.directional = o->cone_directional,
                                      .exact = o->cone_exact,
                                      .bounded = o->max_slope != 0,
                                      .max_slope = o->max_slope};
    if (!cone_build(&f->cones, heights, f->f64, f->w, f->h, &options)) return false;
    if (f->cones.magnitude > f->magnitude) f->magnitude = f->cones.magnitude;
    return true;
}

static void describe(Field *f) {
    char cones[64] = "", levels[64] = "";
    const FieldCones *c = &f->cones;
    if (c->packed)
        snprintf(cones, sizeof cones, "%s%s safety shapes, ", c->classes > 1 ? "directional " : "",
                 c->relaxed ? "cylinder-cone" : "cone");
    if (f->mip.data && f->options.structure != SLT_STRUCTURE_NAIVE)
        snprintf(levels, sizeof levels, "maximum mipmap, %d levels, ", (int)f->mip.top);
    if (*cones || *levels) snprintf(f->text, sizeof f->text, "%s%s%s", cones, levels, isa_names[f->isa]);
    else snprintf(f->text, sizeof f->text, "cell by cell");
}

static void set_queries(Field *f) {
    const FieldKernels *k = field_kernels(f->isa);
    for (int what = 0; what < SLT_QUERIES; what++) {
        bool packets = f->options.structure != SLT_STRUCTURE_NAIVE && (f->mip.data || what == SLT_QUERY_RISE);
        SltQueryFn *q = packets ? k->query[f->f64][what] : NULL;
        f->base.shared.query[what] = q ? q : field_naive[f->f64][what];
    }
    f->base.shared.query[SLT_QUERY_BLOCKED] = f->mip.data ? field_boxes : NULL;
    if (f->cones.packed)
        f->base.shared.query[SLT_QUERY_TRACE] = f->base.shared.query[SLT_QUERY_OCCLUDED] = k->cone[f->f64];
}

static SltStatus check(const Field *f, SltError *err) {
    const FieldOptions *o = &f->options;
    const uint32_t w = f->w, h = f->h;
    if (w < 2 || h < 2)
        return status_fail(err, SLT_USAGE, "a heightfield needs at least 2 x 2 heights, not %u x %u", w, h);
    /* Edges are numbered in an int32. */
    if (w > MIP_MAX_SIDE || h > MIP_MAX_SIDE || (uint64_t)w * h > INT32_MAX / 4)
        return status_fail(err, SLT_LIMIT, "a heightfield of %u x %u heights is too large", w, h);
    if (!(o->band >= 0) || !(o->slack >= 0))
        return status_fail(err, SLT_USAGE, "band and slack of a heightfield must not be negative");
    if (o->isa < 0 || o->isa >= FIELD_ISAS || o->isa > best_isa())
        return status_fail(err, SLT_USAGE, "this machine has no such instruction set");
    return SLT_OK;
}

SltStatus field_make(SltGeometry **out, const void *heights, bool f64, uint32_t w, uint32_t h, const FieldOptions *o,
                     SltError *err) {
    *out = NULL;
    Field *f = calloc(1, sizeof *f);
    if (!f) return status_fail(err, SLT_LIMIT, "out of memory for a heightfield");
    if (o) f->options = *o;
    if (!f->options.queries)
        f->options.queries = f->options.structure == SLT_STRUCTURE_NAIVE ? all_queries & ~bounding : all_queries;
    f->f64 = f64;
    f->w = w;
    f->h = h;
    f->base.shared.slack = f->options.slack;
    f->base.shared.made = f;
    f->base.ops = &geometry_heightfield;
    SltStatus status = check(f, err);
    if (status != SLT_OK) {
        free(f);
        return status;
    }
    f->isa = f->options.isa ? f->options.isa : best_isa();
    const uint32_t cones = f->options.structure == SLT_STRUCTURE_CONE ? f->options.queries & hits : 0,
                   levels = f->options.queries &
                            (f->options.structure == SLT_STRUCTURE_NAIVE ? bounding : searching & ~cones);
    if ((levels && !mipmap_make(f, heights)) || (cones && !make_cones(f, heights))) {
        field_free(&f->base.shared);
        return status_fail(err, SLT_LIMIT, "out of memory for the structure of a heightfield of %u x %u", w, h);
    }
    describe(f);
    set_queries(f);
    *out = &f->base.shared;
    return SLT_OK;
}

void field_refresh(SltGeometry *field, const void *heights, uint32_t x0, uint32_t y0, uint32_t x1, uint32_t y1) {
    Field *f = (Field *)field;
    x1 = x1 < f->w ? x1 : f->w;
    y1 = y1 < f->h ? y1 : f->h;
    if (x0 >= x1 || y0 >= y1) return;
    if (f->mip.data) mipmap_refresh(f, heights, x0, y0, x1, y1);
    if (!f->cones.packed) return;
    /* A height limits shapes all over the field, so all are made again; without memory for that, rays step cell by
     * cell. */
    cone_free(&f->cones);
    if (!make_cones(f, heights)) describe(f);
    set_queries(f);
}

void field_free(SltGeometry *field) {
    if (!field) return;
    Field *f = (Field *)field;
    mipmap_free(&f->mip);
    cone_free(&f->cones);
    free(f);
}

size_t field_bytes(const SltGeometry *field) {
    const Field *f = field_impl(field);
    return (f->mip.data ? f->mip.count * sizeof(float) : 0) + (f->cones.packed ? cone_bytes(&f->cones) : 0);
}

const char *field_describe(const SltGeometry *field) { return field_impl(field)->text; }

/* ---- the seam */

static SltStatus make(SltGeometry **out, const GeometrySource *from, const void *values, SltError *err) {
    const FieldOptions o = {.structure = from->structure, .queries = from->queries, .band = from->band};
    return field_make(out, values, from->f64, from->size[0], from->size[1], &o, err);
}

static void mark(Field *f, uint32_t x0, uint32_t x1, uint32_t y) {
    if (f->x0 >= f->x1) f->x0 = x0, f->x1 = x1, f->y0 = y, f->y1 = y + 1; /* the first */
    if (x0 < f->x0) f->x0 = x0;
    if (x1 > f->x1) f->x1 = x1;
    if (y < f->y0) f->y0 = y;
    if (y >= f->y1) f->y1 = y + 1;
}

/* Grows the rectangle around all changed vertices. Rows of the data run downwards, those of the field upwards. */
static void changed(SltGeometry *g, uint64_t first, uint64_t count) {
    Field *f = (Field *)g;
    const uint64_t end = first + count;
    for (uint64_t next; first < end; first = next) {
        const uint64_t row = first / f->w, start = row * f->w;
        next = start + f->w < end ? start + f->w : end;
        mark(f, (uint32_t)(first - start), (uint32_t)(next - start), f->h - 1 - (uint32_t)row);
    }
}

static uint64_t follow(SltGeometry *g, const void *values) {
    Field *f = (Field *)g;
    if (f->x0 >= f->x1) return 0;
    const uint64_t heights = (uint64_t)(f->x1 - f->x0) * (f->y1 - f->y0);
    field_refresh(g, values, f->x0, f->y0, f->x1, f->y1);
    f->x0 = f->x1 = f->y0 = f->y1 = 0;
    return heights;
}

/* The largest increase of a height. */
static double growth(const SltGeometry *g, const void *from, const void *to) {
    const Field *f = field_impl(g);
    double most = 0;
    for (size_t i = 0, n = (size_t)f->w * f->h; i < n; i++)
        most = fmax(most, f->f64 ? ((const double *)to)[i] - ((const double *)from)[i]
                                 : (double)((const float *)to)[i] - (double)((const float *)from)[i]);
    return most;
}

const GeometryOps geometry_heightfield = {.make = make,
                                          .free = field_free,
                                          .changed = changed,
                                          .follow = follow,
                                          .growth = growth,
                                          .bytes = field_bytes,
                                          .describe = field_describe};

void field_count(const SltGeometry *field, SltQuery what, const void *heights, const void *rays, uint64_t mask,
                 uint32_t width, int32_t *id, FieldCounts *counts) {
    const Field *f = field_impl(field);
    if (f->cones.packed && hits >> what & 1 && !(f->cones.relaxed && field->slack > 0))
        field_scalar_cone_count(f, heights, rays, mask, width, id, counts);
    else if (f->mip.data && f->options.structure != SLT_STRUCTURE_NAIVE)
        field_scalar_count(f, what, heights, rays, mask, width, id, counts);
    else field_naive_count(f, what, heights, rays, mask, width, id, counts);
}

uint32_t field_silhouettes(const SltGeometry *field, const void *heights, const void *o, const void *d, double kmin,
                           double kmax, int32_t *id, uint32_t cap, FieldCounts *counts) {
    const Field *f = field_impl(field);
    Slice slice = {id, cap, 0};
    float ray32[8] = {0};
    double ray64[8] = {0};
    const void *ray;
    if (f->f64) {
        memcpy(ray64, o, 3 * sizeof *ray64);
        memcpy(ray64 + 3, d, 2 * sizeof *ray64);
        ray64[6] = kmin, ray64[7] = kmax;
        ray = ray64;
    } else {
        memcpy(ray32, o, 3 * sizeof *ray32);
        memcpy(ray32 + 3, d, 2 * sizeof *ray32);
        ray32[6] = (float)kmin, ray32[7] = (float)kmax;
        ray = ray32;
    }
    if (f->mip.data && f->options.structure != SLT_STRUCTURE_NAIVE) field_scalar_slice(f, heights, ray, &slice, counts);
    else field_naive_slice(f, heights, ray, &slice, counts);
    if (counts) counts->rays++;
    return slice.count;
}
