/* Rays of the heightfield benchmark. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "field_bench.h"

static const double PI = 3.141592653589793;
static const float FAR = 1e9f;

/* Where the ray enters and leaves the box seen from above. */
static bool box_interval(const Terrain *t, const Ray *r, double *in, double *out) {
    double side = t->n - 1.0;
    *in = 0.0, *out = 1e30;
    for (int a = 0; a < 2; a++) {
        double p = (0.0 - r->o[a]) / r->d[a], q = (side - r->o[a]) / r->d[a];
        if (r->d[a] == 0.0f) {
            if (r->o[a] < 0.0f || r->o[a] > side) return false;
            continue;
        }
        *in = fmax(*in, fmin(p, q)), *out = fmin(*out, fmax(p, q));
    }
    return *in < *out;
}

/* The camera looks at the middle of the terrain from 35 degrees above, with a field of view of 45 degrees. */
Rays rays_camera(const Terrain *t, uint32_t size) {
    Rays rays = {.name = "primary", .count = size * size, .ray = malloc(sizeof(Ray) * size * size)};
    double n = t->n, elevation = 35.0 * PI / 180.0, azimuth = 20.0 * PI / 180.0, half = tan(22.5 * PI / 180.0),
           away = 0.95 * n;
    double look[3] = {cos(elevation) * cos(azimuth), cos(elevation) * sin(azimuth), -sin(elevation)},
           right[3] = {sin(azimuth), -cos(azimuth), 0.0}, up[3], eye[3];
    for (int a = 0; a < 3; a++) eye[a] = (a < 2 ? 0.5 * (n - 1.0) : 0.5 * (t->lowest + t->highest)) - away * look[a];
    up[0] = right[1] * look[2] - right[2] * look[1], up[1] = right[2] * look[0] - right[0] * look[2],
    up[2] = right[0] * look[1] - right[1] * look[0];
    for (uint32_t k = 0; k < rays.count; k++) {
        uint32_t x, y;
        rays_pixel(k, size, &x, &y);
        double u = half * (2.0 * (x + 0.5) / size - 1.0), v = half * (1.0 - 2.0 * (y + 0.5) / size),
               length = sqrt(1.0 + u * u + v * v), in_t, out_t;
        Ray *r = &rays.ray[k];
        for (int a = 0; a < 3; a++)
            r->o[a] = (float)eye[a], r->d[a] = (float)((look[a] + u * right[a] + v * up[a]) / length);
        r->t0 = 0.0f, r->t1 = FAR;
        if (!box_interval(t, r, &in_t, &out_t)) continue;
        double px = r->o[0] + in_t * r->d[0], py = r->o[1] + in_t * r->d[1];
        if (r->o[2] + in_t * r->d[2] < terrain_height(t, px, py, NULL) + 1e-3)
            r->t1 = (float)(in_t * 0.999), rays.cut++;
    }
    return rays;
}

/* The points that `from` hits, lifted a hundredth of a cell along the facet's normal. */
static Rays secondary(const Terrain *t, const Rays *from, const double *where, const char *name,
                      void direct(uint64_t *, const double *, const double *, float *), const double *sun) {
    Rays rays = {.name = name, .ray = malloc(sizeof(Ray) * from->count)};
    uint64_t state = 12345;
    for (uint32_t k = 0; k < from->count; k++) {
        if (!isfinite(where[k])) continue;
        const Ray *f = &from->ray[k];
        double p[3], normal[3], side = t->n - 1.0;
        for (int a = 0; a < 3; a++) p[a] = f->o[a] + where[k] * f->d[a];
        p[0] = fmin(fmax(p[0], 0.02), side - 0.02), p[1] = fmin(fmax(p[1], 0.02), side - 0.02);
        p[2] = terrain_height(t, p[0], p[1], normal);
        Ray *r = &rays.ray[rays.count++];
        for (int a = 0; a < 3; a++) r->o[a] = (float)(p[a] + 0.01 * normal[a]);
        direct(&state, normal, sun, r->d);
        r->t0 = 0.0f, r->t1 = FAR;
    }
    rays.count -= rays.count % 64;
    return rays;
}
static void to_sun(uint64_t *state, const double *normal, const double *sun, float *d) {
    (void)state, (void)normal;
    for (int a = 0; a < 3; a++) d[a] = (float)sun[a];
}
static void to_sky(uint64_t *state, const double *n, const double *sun, float *d) {
    (void)sun;
    double z = 2.0 * bench_unit(state) - 1.0, phi = 2.0 * PI * bench_unit(state), s = sqrt(1.0 - z * z),
           v[3] = {s * cos(phi) + n[0], s * sin(phi) + n[1], z + n[2]};
    double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]) + 1e-12;
    for (int a = 0; a < 3; a++) d[a] = (float)(v[a] / length);
}
Rays rays_sun(const Terrain *t, const Rays *from, const double *where, double elevation) {
    double e = elevation * PI / 180.0, azimuth = 110.0 * PI / 180.0,
           sun[3] = {cos(e) * cos(azimuth), cos(e) * sin(azimuth), sin(e)};
    return secondary(t, from, where, "shadow", to_sun, sun);
}
Rays rays_hemisphere(const Terrain *t, const Rays *from, const double *where) {
    return secondary(t, from, where, "hemi", to_sky, NULL);
}

Rays rays_any(const Terrain *t, uint32_t count, uint64_t seed) {
    count -= count % 64;
    Rays rays = {.name = "any", .count = count, .ray = malloc(sizeof(Ray) * count)};
    uint64_t s = seed * 2 + 1;
    double side = t->n - 1.0, range = t->highest - t->lowest;
    for (uint32_t k = 0; k < count; k++) {
        Ray *r = &rays.ray[k];
        double phi = 2.0 * PI * bench_unit(&s), slope = tan((bench_unit(&s) - 0.6) * 1.2),
               margin = bench_unit(&s) < 0.3 ? 0.3 * side : 0.0, x, y, z;
        x = -margin + bench_unit(&s) * (side + 2.0 * margin), y = -margin + bench_unit(&s) * (side + 2.0 * margin);
        bool above = bench_unit(&s) < 0.5;
        uint32_t odd = bench_random(&s) % 16;
        if (odd == 0 || odd == 3 || odd == 5) x = rint(x), y = rint(y);      /* from a vertex */
        if (odd == 1 || odd == 3) phi = rint(phi / (0.25 * PI)) * 0.25 * PI; /* along grid lines and diagonals */
        z = above ? t->lowest + (0.2 + bench_unit(&s)) * range * 1.1
                  : terrain_height(t, fmin(fmax(x, 0), side), fmin(fmax(y, 0), side), NULL);
        if (odd == 2) z -= 0.1 * range * bench_unit(&s); /* from below */
        else if (!above && odd != 5) z += 0.01 + 0.02 * range * bench_unit(&s);
        if (odd == 4) slope = 0.0;
        double d[3] = {cos(phi), sin(phi), slope}, scale = odd == 6 ? 10.0 * bench_unit(&s) + 1e-3 : 1.0;
        if (fabs(d[0]) < 1e-12) d[0] = 0.0;
        if (fabs(d[1]) < 1e-12) d[1] = 0.0;
        if (odd == 1 && fabs(fabs(d[0]) - fabs(d[1])) < 1e-6) d[1] = copysign(d[0], d[1]);
        if (odd == 7) d[0] = d[1] = 0.0, d[2] = bench_unit(&s) < 0.8 ? -1.0 : 1.0; /* straight down or up */
        if (odd == 8) { /* at a vertex elsewhere, exactly as well as floats can aim */
            uint32_t i = bench_random(&s) % t->n, j = bench_random(&s) % t->n;
            d[0] = i - (double)(float)x, d[1] = j - (double)(float)y, d[2] = terrain_at(t, i, j) - (double)(float)z;
            if (d[0] == 0.0 && d[1] == 0.0 && d[2] == 0.0) d[2] = -1.0;
        }
        r->o[0] = (float)x, r->o[1] = (float)y, r->o[2] = (float)z;
        for (int a = 0; a < 3; a++) r->d[a] = (float)(d[a] * scale);
        r->t0 = odd == 9 ? (float)(10.0 * bench_unit(&s)) : 0.0f;
        r->t1 = odd >= 12 ? (float)(side * bench_unit(&s)) : FAR;
    }
    return rays;
}
