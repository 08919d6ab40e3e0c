/* Fits the table of linearly transformed cosines to GGX, and measures how far they are from it.
 *
 *   fit-ltc > runtime/geometry/mesh/ltc_table.inc      some minutes; the same numbers each time
 *   fit-ltc error                                      of the table that is compiled in: see below
 *
 * Fitted is M (ltc.h), its column of the axis of unit length, by Nelder and Mead's simplex: of normalised densities f
 * and g, least is the integral of (f - g)^2, by points of both. What of g is below the horizon counts against
 * it; the amplitude makes up for it. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/geometry/mesh/ltc.h"

#define PI 3.14159265358979323846
enum { POINTS = 40, FREE = 4, STEPS = 400 };

/* ---- GGX; the view is in the plane of x and z */

typedef struct Ggx {
    double alpha, view[3];
} Ggx;

static double smith(double alpha, double z) { /* Lambda */
    const double tan2 = (1 - z * z) / (z * z);
    return 0.5 * (sqrt(1 + alpha * alpha * tan2) - 1);
}

/* The lobe, the cosine included; *density: of the points that `ggx_point` makes. */
static double ggx(const Ggx *g, const double w[3], double *density) {
    double h[3], length = 0;
    *density = 0;
    for (int i = 0; i < 3; i++) h[i] = g->view[i] + w[i], length += h[i] * h[i];
    length = sqrt(length);
    if (!(length > 0)) return 0;
    const double z = h[2] / length, a2 = g->alpha * g->alpha, q = 1 + z * z * (a2 - 1);
    if (!(z > 0)) return 0;
    const double d = a2 / (PI * q * q), own = smith(g->alpha, g->view[2]);
    *density = d / (1 + own) / (4 * g->view[2]);
    return w[2] > 0 ? d / (1 + own + smith(g->alpha, w[2])) / (4 * g->view[2]) : 0;
}

/* By visible normals (Heitz 2018). May lie below the horizon. */
static void ggx_point(const Ggx *g, double u, double v, double w[3]) {
    double s[3] = {g->alpha * g->view[0], 0, g->view[2]}, length = sqrt(s[0] * s[0] + s[2] * s[2]);
    for (int i = 0; i < 3; i++) s[i] /= length;
    const double across = s[0] != 0 ? 1 : 0; /* t1 = (0, 1, 0), t2 = s x t1; head on any will do */
    const double t1[3] = {1 - across, across, 0},
                 t2[3] = {s[1] * t1[2] - s[2] * t1[1], s[2] * t1[0] - s[0] * t1[2], s[0] * t1[1] - s[1] * t1[0]};
    const double r = sqrt(u), angle = 2 * PI * v, p = r * cos(angle), part = 0.5 * (1 + s[2]),
                 q = (1 - part) * sqrt(1 - p * p) + part * r * sin(angle), up = sqrt(fmax(0, 1 - p * p - q * q));
    double h[3], n = 0, dot = 0;
    for (int i = 0; i < 3; i++) h[i] = (p * t1[i] + q * t2[i] + up * s[i]) * (i < 2 ? g->alpha : 1), n += h[i] * h[i];
    for (int i = 0; i < 3; i++) h[i] /= sqrt(n), dot += h[i] * g->view[i];
    for (int i = 0; i < 3; i++) w[i] = 2 * dot * h[i] - g->view[i];
}

/* ---- the transformed cosine */

typedef struct Cosine {
    double a, b, c, d, e; /* of M */
} Cosine;

static double cosine(const Cosine *m, const double w[3]) {
    const double det = m->a * m->e - m->b * m->d, x = (m->e * w[0] - m->b * w[2]) / det, y = w[1] / m->c,
                 z = (m->a * w[2] - m->d * w[0]) / det, square = x * x + y * y + z * z;
    return z > 0 ? z / (PI * square * square * fabs(det * m->c)) : 0;
}

static void cosine_point(const Cosine *m, double u, double v, double w[3]) {
    const double r = sqrt(u), x = r * cos(2 * PI * v), y = r * sin(2 * PI * v), z = sqrt(1 - u);
    w[0] = m->a * x + m->b * z, w[1] = m->c * y, w[2] = m->d * x + m->e * z;
    const double length = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
    for (int i = 0; i < 3; i++) w[i] /= length;
}

/* ---- the fit */

typedef struct Task {
    Ggx ggx;
    double albedo;
    bool head_on;
} Task;

/* Free numbers: log C / alpha, log of A to C, its shear, the tilt of the axis. */
static Cosine from_free(const Task *t, const double x[FREE]) {
    const double c = t->ggx.alpha * exp(x[0]), a = c * exp(x[1]), tilt = x[3], shear = x[2];
    if (t->head_on) return (Cosine){.a = c, .c = c, .e = 1};
    const double b = shear * cos(tilt) - sin(tilt), e = shear * sin(tilt) + cos(tilt), size = sqrt(b * b + e * e);
    return (Cosine){.a = a * cos(tilt) / size, .b = b / size, .c = c / size, .d = a * sin(tilt) / size, .e = e / size};
}

static double albedo_of(const Ggx *g) {
    double sum = 0;
    for (int i = 0; i < 8 * POINTS; i++)
        for (int k = 0; k < 8 * POINTS; k++) {
            double w[3], density;
            ggx_point(g, (i + 0.5) / (8 * POINTS), (k + 0.5) / (8 * POINTS), w);
            const double f = ggx(g, w, &density);
            if (density > 0) sum += f / density;
        }
    return sum / (64.0 * POINTS * POINTS);
}

static double distance(const Task *t, const double x[FREE]) {
    const Cosine m = from_free(t, x);
    double sum = 0;
    /* Of a small lobe it hardly matters how the axes lean on each other: then at right angles. */
    if (!t->head_on) sum += 1e-5 * POINTS * POINTS * x[2] * x[2] / (t->ggx.alpha * t->ggx.alpha);
    for (int i = 0; i < POINTS; i++)
        for (int k = 0; k < POINTS; k++)
            for (int which = 0; which < 2; which++) {
                double w[3], density;
                if (which) cosine_point(&m, (i + 0.5) / POINTS, (k + 0.5) / POINTS, w);
                else ggx_point(&t->ggx, (i + 0.5) / POINTS, (k + 0.5) / POINTS, w);
                const double f = ggx(&t->ggx, w, &density) / t->albedo, g = cosine(&m, w);
                if (density + g > 0) sum += (f - g) * (f - g) / (density + g);
            }
    return sum / (POINTS * POINTS);
}

/* From the middle of the others `by` times away from the last corner. */
static double towards(const Task *t, double p[FREE + 1][FREE], int n, double by, double out[FREE]) {
    memcpy(out, p[n], sizeof p[n]);
    for (int k = 0; k < n; k++) {
        double middle = 0;
        for (int i = 0; i < n; i++) middle += p[i][k] / n;
        out[k] = middle + by * (middle - p[n][k]);
    }
    return distance(t, out);
}

static double fit(const Task *t, double x[FREE]) {
    const int n = t->head_on ? 1 : FREE;
    double p[FREE + 1][FREE], v[FREE + 1];
    for (int i = 0; i <= n; i++) {
        memcpy(p[i], x, sizeof p[i]);
        if (i) p[i][i - 1] += 0.1;
        v[i] = distance(t, p[i]);
    }
    for (int step = 0; step < STEPS; step++) {
        for (int i = 1; i <= n; i++)
            for (int k = i; k > 0 && v[k] < v[k - 1]; k--) {
                double keep[FREE], value = v[k];
                memcpy(keep, p[k], sizeof keep), memcpy(p[k], p[k - 1], sizeof keep);
                memcpy(p[k - 1], keep, sizeof keep), v[k] = v[k - 1], v[k - 1] = value;
            }
        if (v[n] - v[0] < 1e-9 * v[0] + 1e-14) break;
        double try[FREE], further[FREE];
        double value = towards(t, p, n, 1, try), other;
        if (value < v[0]) {
            other = towards(t, p, n, 2, further);
            if (other < value) memcpy(try, further, sizeof try), value = other;
        } else if (!(value < v[n - 1])) {
            other = towards(t, p, n, value < v[n] ? 0.5 : -0.5, further);
            if (other < value) memcpy(try, further, sizeof try), value = other;
        }
        if (value < v[n]) {
            memcpy(p[n], try, sizeof try), v[n] = value;
            continue;
        }
        for (int i = 1; i <= n; i++) {
            for (int k = 0; k < n; k++) p[i][k] = p[0][k] + 0.5 * (p[i][k] - p[0][k]);
            v[i] = distance(t, p[i]);
        }
    }
    memcpy(x, p[0], sizeof p[0]);
    return v[0];
}

/* What of the transformed cosine is above the horizon. */
static double above(const Cosine *m) {
    double sum = 0;
    for (int i = 0; i < 8 * POINTS; i++)
        for (int k = 0; k < 8 * POINTS; k++) {
            double w[3];
            cosine_point(m, (i + 0.5) / (8 * POINTS), (k + 0.5) / (8 * POINTS), w);
            sum += w[2] > 0;
        }
    return sum / (64.0 * POINTS * POINTS);
}

static Ggx ggx_at(double roughness, double z) {
    return (Ggx){.alpha = roughness * roughness, .view = {sqrt(1 - z * z), 0, z}};
}

static void fit_all(void) {
    static double table[LTC_ROUGHNESSES][LTC_COSINES][LTC_PARTS];
    static double rougher[LTC_COSINES][FREE]; /* what was found there */
    for (int i = LTC_ROUGHNESSES - 1; i >= 0; i--) {
        double x[FREE] = {log(2), 0, 0, 0};
        for (int k = LTC_COSINES - 1; k >= 0; k--) {
            const double roughness = LTC_LEAST + (1 - LTC_LEAST) * i / (LTC_ROUGHNESSES - 1),
                         z = k ? (double)k / (LTC_COSINES - 1) : 0.2 / (LTC_COSINES - 1), s = sqrt(1 - z * z);
            Task t = {.ggx = ggx_at(roughness, z), .head_on = k == LTC_COSINES - 1};
            t.albedo = albedo_of(&t.ggx);
            double other[FREE];
            memcpy(other, rougher[k], sizeof other);
            const double found = fit(&t, x);
            if (i < LTC_ROUGHNESSES - 1 && fit(&t, other) < found) memcpy(x, other, sizeof x);
            memcpy(rougher[k], x, sizeof x);
            const Cosine m = from_free(&t, x);
            double *p = table[i][k];
            p[0] = m.c / t.ggx.alpha, p[4] = m.e, p[5] = t.albedo / above(&m);
            if (t.head_on) continue;
            p[1] = (m.a - m.c) / (t.ggx.alpha * s * s), p[2] = -m.b / s, p[3] = m.d / (t.ggx.alpha * s);
        }
        for (int k = 1; k < 4; k++)
            table[i][LTC_COSINES - 1][k] = 2 * table[i][LTC_COSINES - 2][k] - table[i][LTC_COSINES - 3][k];
        fprintf(stderr, "%d\n", i);
    }
    puts("/* Made by tests/bench/fit_ltc.c: p0 to p5 of ltc.h; roughness from LTC_LEAST to 1, cosine from 0 to 1. */");
    for (int i = 0; i < LTC_ROUGHNESSES; i++)
        for (int k = 0; k < LTC_COSINES; k++) {
            const double *p = table[i][k];
            printf("%s{%.7g, %.7g, %.7g, %.7g, %.7g, %.7g}%s", k ? " " : "{", p[0], p[1], p[2], p[3], p[4], p[5],
                   k + 1 < LTC_COSINES ? ",\n" : "},\n");
        }
}

/* ---- the error */

static Cosine cosine_at(double roughness, double z, double *amplitude) {
    double p[LTC_PARTS], by_roughness[LTC_PARTS], by_cosine[LTC_PARTS], alpha = roughness * roughness,
                                                                        s = sqrt(1 - z * z);
    ltc_parts(roughness, z, p, by_roughness, by_cosine);
    *amplitude = p[5];
    return (Cosine){
        .a = alpha * (p[0] + s * s * p[1]), .b = -s * p[2], .c = alpha * p[0], .d = alpha * s * p[3], .e = p[4]};
}

static double uniform(uint64_t *state) {
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (double)(*state >> 11) * 0x1p-53;
}

/* Of random parallelograms at height 1, root mean square of (table - GGX) to that of GGX, both by the same points. */
static void measure(double roughness, double z) {
    enum { LIGHTS = 200, SIDE = 300 };
    static double light[LIGHTS][4], sum[2][LIGHTS];
    uint64_t state = 5;
    double amplitude, off = 0, size = 0;
    const Ggx g = ggx_at(roughness, z);
    const Cosine m = cosine_at(roughness, z, &amplitude);
    memset(sum, 0, sizeof sum);
    for (int i = 0; i < LIGHTS; i++) { /* around where the mirror would look, and anywhere */
        const double x = -g.view[0] / g.view[2], wide = 0.1 + 2 * uniform(&state), high = 0.1 + 2 * uniform(&state);
        light[i][0] = fmax(x, -8) + 4 * (uniform(&state) - 0.5) - 0.5 * wide;
        light[i][1] = 4 * (uniform(&state) - 0.5) - 0.5 * high;
        light[i][2] = light[i][0] + wide, light[i][3] = light[i][1] + high;
    }
    for (int i = 0; i < SIDE; i++)
        for (int k = 0; k < SIDE; k++)
            for (int which = 0; which < 2; which++) {
                double w[3], density;
                if (which) cosine_point(&m, (i + 0.5) / SIDE, (k + 0.5) / SIDE, w);
                else ggx_point(&g, (i + 0.5) / SIDE, (k + 0.5) / SIDE, w);
                if (!(w[2] > 0)) continue;
                const double f = ggx(&g, w, &density), c = cosine(&m, w), x = w[0] / w[2], y = w[1] / w[2];
                for (int n = 0; n < LIGHTS; n++)
                    if (x > light[n][0] && x < light[n][2] && y > light[n][1] && y < light[n][3])
                        sum[0][n] += f / (density + c), sum[1][n] += amplitude * c / (density + c);
            }
    for (int n = 0; n < LIGHTS; n++)
        off += (sum[1][n] - sum[0][n]) * (sum[1][n] - sum[0][n]), size += sum[0][n] * sum[0][n];
    printf(" %7.2f", 100 * sqrt(off / size));
}

int main(int argc, char **argv) {
    if (argc < 2 || strcmp(argv[1], "error")) {
        fit_all();
        return 0;
    }
    static const double roughness[] = {0.1, 0.2, 0.35, 0.5, 0.7, 1}, cosines[] = {1, 0.9, 0.75, 0.5, 0.3, 0.15, 0.05};
    printf("%% rms   cos");
    for (size_t k = 0; k < sizeof cosines / sizeof *cosines; k++) printf(" %7.2f", cosines[k]);
    for (size_t i = 0; i < sizeof roughness / sizeof *roughness; i++) {
        printf("\nroughness %.2f", roughness[i]);
        for (size_t k = 0; k < sizeof cosines / sizeof *cosines; k++) measure(roughness[i], cosines[k]);
    }
    puts("");
    return 0;
}
