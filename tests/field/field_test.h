/* Terrains and rays for the tests of heightfields. Everything is a function of a seed. */
#ifndef SALTUS_TESTS_FIELD_TEST_H
#define SALTUS_TESTS_FIELD_TEST_H

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "runtime/geometry/heightfield/field.h"

typedef struct Rng {
    uint64_t state;
} Rng;

static inline double uniform(Rng *r) { /* [0, 1) */
    r->state = r->state * 6364136223846793005u + 1442695040888963407u;
    return (double)(r->state >> 11) * 0x1p-53;
}

static inline double between(Rng *r, double a, double b) { return a + (b - a) * uniform(r); }
static inline uint32_t below(Rng *r, uint32_t n) { return (uint32_t)(uniform(r) * n); }

typedef struct Terrain {
    char name[32];
    uint32_t w, h;
    float *z; /* rows of the data: j downwards */
    float low, high;
} Terrain;

static inline float *terrain_at(const Terrain *t, uint32_t i, uint32_t j) {
    return t->z + (size_t)(t->h - 1 - j) * t->w + i;
}

static inline double value_noise(double x, double y, uint32_t seed) {
    double fx = floor(x), fy = floor(y), u = x - fx, v = y - fy, c[4];
    for (int n = 0; n < 4; n++) {
        uint64_t k = (uint64_t)(int64_t)(fx + (n & 1)) * 0x9e3779b97f4a7c15u ^
                     (uint64_t)(int64_t)(fy + (n >> 1)) * 0xc2b2ae3d27d4eb4fu ^ seed;
        k ^= k >> 29, k *= 0xbf58476d1ce4e5b9u, k ^= k >> 32;
        c[n] = (double)(k >> 40) * 0x1p-24;
    }
    u = u * u * (3 - 2 * u), v = v * v * (3 - 2 * v);
    return (c[0] * (1 - u) + c[1] * u) * (1 - v) + (c[2] * (1 - u) + c[3] * u) * v;
}

static const char *const terrain_names[] = {"bumps", "ridges", "steps", "flat", "spikes", "borders", "noise", "data"};
enum { TERRAINS = 8 };

/* Heights are of the size of some cells. False: the data are not here (SALTUS_DATA). */
static inline bool terrain_make(Terrain *t, const char *name, uint32_t w, uint32_t h) {
    const char *folder = getenv("SALTUS_DATA");
    char path[512];
    FILE *file = NULL;
    if (!strcmp(name, "data")) {
        if (!folder) return false;
        snprintf(path, sizeof path, "%s/jacksboro_403x344.f32", folder);
        file = fopen(path, "rb");
        if (!file) return false;
        w = 403, h = 344;
    }
    Rng rng = {w * 7919u + h};
    snprintf(t->name, sizeof t->name, "%s %ux%u", name, w, h);
    t->w = w, t->h = h;
    t->z = malloc((size_t)w * h * sizeof *t->z);
    assert_non_null(t->z);
    if (file) {
        assert_int_equal(fread(t->z, sizeof *t->z, (size_t)w * h, file), (size_t)w * h);
        fclose(file);
        for (size_t n = 0; n < (size_t)w * h; n++) t->z[n] *= 3.0f / 90; /* metres to cells, exaggerated */
    } else {
        const double scale = 0.12 * (w < h ? w : h) + 0.5;
        for (uint32_t j = 0; j < h; j++) {
            for (uint32_t i = 0; i < w; i++) {
                double x = i / (w - 1.0), y = j / (h - 1.0), z = 0;
                if (!strcmp(name, "bumps"))
                    z = exp(-30 * ((x - 0.4) * (x - 0.4) + (y - 0.6) * (y - 0.6))) +
                        0.6 * exp(-60 * ((x - 0.8) * (x - 0.8) + (y - 0.3) * (y - 0.3)));
                else if (!strcmp(name, "ridges")) z = fabs(sin(9 * x + 4 * y)) + 0.3 * fabs(sin(21 * y - 8 * x));
                else if (!strcmp(name, "steps")) z = floor(4 * x + 2 * y) / 5 + (((i / 8) ^ (j / 8)) & 1 ? 0.2 : 0);
                else if (!strcmp(name, "flat")) z = 0.25;
                else if (!strcmp(name, "spikes")) z = uniform(&rng) < 0.02 ? uniform(&rng) : 0.02;
                else if (!strcmp(name, "borders"))
                    z = i == 0 || j == 0 || i == w - 1 || j == h - 1 ? 1 : 0.1 * value_noise(9 * x, 9 * y, 3);
                else
                    for (int o = 0; o < 7; o++)
                        z += value_noise(x * (4 << o), y * (4 << o), (uint32_t)o) / (1 << o) * 0.6;
                *terrain_at(t, i, j) = (float)(z * scale);
            }
        }
    }
    t->low = INFINITY, t->high = -INFINITY;
    for (size_t n = 0; n < (size_t)w * h; n++) {
        t->low = fminf(t->low, t->z[n]);
        t->high = fmaxf(t->high, t->z[n]);
    }
    return true;
}

static inline double terrain_height(const Terrain *t, double x, double y) {
    double i = fmin(fmax(floor(x), 0), t->w - 2.0), j = fmin(fmax(floor(y), 0), t->h - 2.0), u = x - i, v = y - j;
    uint32_t a = (uint32_t)i, b = (uint32_t)j;
    double h10 = *terrain_at(t, a + 1, b), h01 = *terrain_at(t, a, b + 1);
    if (u + v < 1) {
        double h00 = *terrain_at(t, a, b);
        return h00 + u * (h10 - h00) + v * (h01 - h00);
    }
    double h11 = *terrain_at(t, a + 1, b + 1);
    return h11 + (1 - u) * (h01 - h11) + (1 - v) * (h10 - h11);
}

/* One ray of many kinds: o, d, t0, t1. */
static inline void some_ray(const Terrain *t, Rng *r, double out[8]) {
    const double W = t->w - 1, H = t->h - 1, top = t->high + 1, side = W > H ? W : H, pi = 3.14159265358979323846;
    const uint32_t kind = below(r, 16);
    double x = between(r, 0, W), y = between(r, 0, H), z, a = between(r, 0, 2 * pi), e;
    double dx = cos(a), dy = sin(a), dz, t0 = 0, t1 = uniform(r) < 0.5 ? INFINITY : between(r, 0, 2 * side);
    switch (kind) {
    case 0: /* a camera */
    case 1: z = between(r, top, top + 0.4 * side), dz = between(r, -1.5, 0.1); break;
    case 2: /* shadow rays from the surface */
    case 3:
    case 4:
        z = terrain_height(t, x, y) + 0.01, dz = tan(between(r, 1, 30) * pi / 180), t0 = uniform(r) < 0.5 ? 0 : 1.5;
        break;
    case 5: /* the hemisphere */
    case 6:
        e = uniform(r), z = terrain_height(t, x, y) + 1e-3, dx *= sqrt(1 - e), dy *= sqrt(1 - e), dz = sqrt(e);
        break;
    case 7: /* from outside */
        x = W / 2 - dx * side * between(r, 0.6, 3), y = H / 2 - dy * side * between(r, 0.6, 3),
        z = between(r, t->low - 1, top), dz = between(r, -0.1, 0.1);
        break;
    case 8: /* along the axes, often exactly on lines */
        dx = (double)below(r, 3) - 1, dy = dx == 0 ? (double)below(r, 3) - 1 : 0, z = between(r, t->low, top),
        dz = between(r, -0.3, 0.3);
        if (uniform(r) < 0.6) x = floor(x + 0.5), y = floor(y + 0.5);
        break;
    case 9: /* through corners, along diagonals */
        x = floor(x), y = floor(y), dx = (double)below(r, 7) - 3, dy = (double)below(r, 7) - 3,
        z = between(r, t->low, top), dz = between(r, -0.3, 0.3);
        break;
    case 10: /* under the surface */ z = terrain_height(t, x, y) - between(r, 0, 1), dz = between(r, -0.3, 0.6); break;
    case 11: /* vertical */ dx = dy = 0, z = between(r, t->low - 1, top), dz = between(r, -1, 1); break;
    case 12: /* not of unit length */
        e = pow(10, between(r, -6, 6)), z = between(r, t->low, top), dx *= e, dy *= e, dz = e * between(r, -0.2, 0.2),
        t1 = INFINITY;
        break;
    case 13: /* flat, low: grazing */ z = between(r, t->low, t->high), dz = between(r, -0.01, 0.01); break;
    case 14: /* borders and their corners */
        x = uniform(r) < 0.5 ? 0 : W, y = uniform(r) < 0.5 ? floor(y) : H, z = between(r, t->low - 0.5, top),
        dz = between(r, -0.2, 0.2);
        if (uniform(r) < 0.3) dx = 0;
        break;
    default: /* windows */
        z = between(r, t->low, top), dz = between(r, -0.5, 0.3), t0 = between(r, -side, side),
        t1 = t0 + between(r, -1, side);
        break;
    }
    const double ray[8] = {x, y, z, dx, dy, dz, t0, t1};
    memcpy(out, ray, sizeof ray);
    if (uniform(r) < 0.001) out[below(r, 8)] = uniform(r) < 0.7 ? NAN : -INFINITY;
}

enum { WIDTH = 64 };
typedef union Rows {
    float f[8 * WIDTH];
    double d[8 * WIDTH];
} Rows;

/* Up to 64 rays of a query in the layout of queries. */
static inline void some_rays(const Terrain *t, Rng *r, SltQuery what, bool f64, uint32_t width, Rows *rays) {
    for (uint32_t lane = 0; lane < width; lane++) {
        double ray[8];
        some_ray(t, r, ray);
        if (what == SLT_QUERY_SILHOUETTE) {
            double middle = between(r, -1, 1), half = pow(10, between(r, -3, 1));
            ray[6] = uniform(r) < 0.2 ? -INFINITY : middle - half;
            ray[7] = uniform(r) < 0.2 ? INFINITY : middle + half;
        } else if (what == SLT_QUERY_RISE && uniform(r) < 0.8) {
            ray[6] = between(r, 0.1, 5);
        }
        for (int n = 0; n < 8; n++)
            if (f64) rays->d[(uint32_t)n * width + lane] = ray[n];
            else rays->f[(uint32_t)n * width + lane] = (float)ray[n];
    }
}

static const char *const what_names[SLT_QUERIES] = {"trace", "occluded", "clearance", "shadow", "silhouette", "rise"};
static const char *const isa_names[FIELD_ISAS] = {"best", "scalar", "SSE2", "AVX2", "AVX-512"};

static inline SltGeometry *make_field(const void *z, bool f64, uint32_t w, uint32_t h, FieldOptions o) {
    SltGeometry *f;
    SltError err;
    SltStatus status = field_make(&f, z, f64, w, h, &o, &err);
    if (status == SLT_USAGE && o.isa) return NULL; /* an instruction set that this machine lacks */
    if (status != SLT_OK) fail_msg("%s", err.text);
    return f;
}

/* A query's witnesses are those expected; otherwise the ray is printed. */
static inline void expect_witnesses(const char *name, const char *how, const SltGeometry *field, const void *z,
                                    bool f64, SltQuery what, const Rows *rays, uint64_t mask, uint32_t width,
                                    const int32_t *expected) {
    int32_t got[WIDTH];
    field->query[what](field, z, rays, mask, width, got);
    for (uint32_t n = 0; n < width; n++) {
        if (what == SLT_QUERY_OCCLUDED ? (got[n] == SLT_WITNESS_NONE) == (expected[n] == SLT_WITNESS_NONE)
                                       : got[n] == expected[n])
            continue; /* any blocked point will do */
        char text[512] = "";
        for (uint32_t row = 0; row < 8; row++) {
            size_t at = strlen(text);
            snprintf(text + at, sizeof text - at, " %.17g",
                     f64 ? rays->d[row * width + n] : (double)rays->f[row * width + n]);
        }
        fail_msg("%s, %s, f%d, %s, lane %u of %u: %d, cell by cell %d; ray%s", name, what_names[what], f64 ? 64 : 32,
                 how, n, width, got[n], expected[n], text);
    }
}

static inline double *doubles(const float *z, size_t n) {
    double *d = malloc(n * sizeof *d);
    assert_non_null(d);
    for (size_t i = 0; i < n; i++) d[i] = z[i];
    return d;
}
#endif
