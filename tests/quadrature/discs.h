/* Opaque discs painted in order, and the derivatives of their picture's integral in all centres and radii: exactly, arc
 * by arc. */
#ifndef SALTUS_TESTS_QUADRATURE_DISCS_H
#define SALTUS_TESTS_QUADRATURE_DISCS_H

#include <stdlib.h>

#include "tests/quadrature/scene.h"

static inline double disc_random(uint64_t *state) {
    *state += 0x9e3779b97f4a7c15u;
    uint64_t z = *state;
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u, z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return (double)((z ^ z >> 31) >> 11) * 0x1p-53;
}

static inline Num disc_g(const Scene *s, uint32_t e, const Num *x) {
    Num dx = num_sub(x[0], param(s, 3 * e)), dy = num_sub(x[1], param(s, 3 * e + 1));
    return num_sub(num_add(num_sqr(dx), num_sqr(dy)), num_sqr(param(s, 3 * e + 2)));
}

static inline double disc_point(const Scene *s, uint32_t e, const double x[3], double dg[3]) {
    double dx = x[0] - s->p[3 * e], dy = x[1] - s->p[3 * e + 1], r = s->p[3 * e + 2];
    dg[0] = 2 * dx, dg[1] = 2 * dy;
    return dx * dx + dy * dy - r * r;
}

/* Which discs reach a cell of an n x n grid over [0,1]^2; the caller frees start and items. */
static inline void discs_near(Scene *s, const double *p, uint32_t count, uint32_t n) {
    uint32_t *start = calloc((size_t)n * n + 1, sizeof *start), *items = NULL;
    for (int pass = 0; pass < 2; pass++) {
        for (uint32_t i = 0; i < count; i++) {
            double reach = p[3 * i + 2] + 1e-9;
            int lo[2], hi[2];
            for (int d = 0; d < 2; d++) {
                lo[d] = (int)fmax(0, floor((p[3 * i + d] - reach) * n));
                hi[d] = (int)fmin(n - 1, floor((p[3 * i + d] + reach) * n));
            }
            for (int y = lo[1]; y <= hi[1]; y++)
                for (int x = lo[0]; x <= hi[0]; x++) {
                    uint32_t at = (uint32_t)y * n + (uint32_t)x;
                    if (pass) items[start[at]++] = i;
                    else start[at + 1]++;
                }
        }
        if (pass) break;
        for (uint32_t i = 0; i < n * n; i++) start[i + 1] += start[i];
        items = malloc((start[n * n] + 1) * sizeof *items);
    }
    for (uint32_t i = n * n; i > 0; i--) start[i] = start[i - 1];
    start[0] = 0;
    s->near = items, s->near_start = start, s->near_n = n;
}

static inline double disc_color(uint32_t e) { return (double)(mix(e) & 255) / 255; }

static inline int by_angle(const void *a, const void *b) {
    const double *p = a, *q = b;
    return (*p > *q) - (*p < *q);
}

/* d[3 * count] */
static inline void discs_exact(const double *p, uint32_t count, double *d) {
    const double pi = acos(-1);
    double *cut = malloc((4 * (size_t)count + 16) * sizeof *cut);
    uint32_t *by = malloc(count * sizeof *by);
    for (uint32_t i = 0; i < count; i++) {
        double x = p[3 * i], y = p[3 * i + 1], r = p[3 * i + 2];
        uint32_t n = 0, nby = 0;
        cut[n++] = -pi, cut[n++] = pi;
        for (int side = 0; side < 4; side++) { /* the domain's sides */
            double to = (side < 2 ? x : y), h = (side & 1 ? 1 : 0) - to;
            if (fabs(h) >= r) continue;
            double a = acos(h / r), b = side < 2 ? 0 : pi / 2;
            cut[n++] = remainder(b + a, 2 * pi), cut[n++] = remainder(b - a, 2 * pi);
        }
        for (uint32_t j = 0; j < count; j++) {
            double dx = p[3 * j] - x, dy = p[3 * j + 1] - y, R = p[3 * j + 2], D = sqrt(dx * dx + dy * dy);
            if (j == i || D >= r + R) continue;
            by[nby++] = j;
            if (D <= fabs(r - R)) continue;
            double a = acos((D * D + r * r - R * R) / (2 * D * r)), b = atan2(dy, dx);
            cut[n++] = remainder(b + a, 2 * pi), cut[n++] = remainder(b - a, 2 * pi);
        }
        qsort(cut, n, sizeof *cut, by_angle);
        for (int k = 0; k < 3; k++) d[3 * i + k] = 0;
        for (uint32_t k = 0; k + 1 < n; k++) {
            double a = cut[k], b = cut[k + 1], m = 0.5 * (a + b), mx = x + r * cos(m), my = y + r * sin(m), out = 0;
            if (!(b > a) || mx < 0 || mx > 1 || my < 0 || my > 1) continue;
            bool hidden = false;
            for (uint32_t t = 0; t < nby && !hidden; t++) {
                uint32_t j = by[t];
                double ex = mx - p[3 * j], ey = my - p[3 * j + 1];
                if (ex * ex + ey * ey >= p[3 * j + 2] * p[3 * j + 2]) continue;
                if (j > i) hidden = true;
                else out = disc_color(j);
            }
            if (hidden) continue;
            double jump = disc_color(i) - out;
            d[3 * i] += jump * r * (sin(b) - sin(a)), d[3 * i + 1] += jump * r * (cos(a) - cos(b));
            d[3 * i + 2] += jump * r * (b - a);
        }
    }
    free(cut), free(by);
}

#endif
