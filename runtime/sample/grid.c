/* Pixels, filters and where samples lie.
 *
 * A pixel is the mean of f under its filter over the part of the domain that the filter covers: samples are drawn from
 * the filter (so every sample belongs to one pixel and weighs the same), and crossings use the same normalised filter
 * as a weight. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/grid.h"

#define INLINE static inline
typedef double D;
typedef uint64_t U;
typedef int64_t L;
INLINE D all(double x) { return x; }
INLINE D root(D x) { return sqrt(x); }
INLINE D either(L where, D a, D b) { return where ? a : b; }
INLINE U bits_of(D x) {
    U bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}
INLINE D with_bits(U bits) {
    D x;
    memcpy(&x, &bits, sizeof x);
    return x;
}
#include "runtime/sample/quantile.inc.h"

/* Gaussian: sigma half a pixel, cut at 2 pixels = 4 sigma. */
#define GAUSS_RADIUS 2.0
#define SQRT2 1.4142135623730951
#define GAUSS_MASS 0.99993665751633376 /* erf(4 / sqrt 2) */
#define GAUSS_PEAK 0.79788456080286536 /* 1 / (sigma sqrt(2 pi)) */

static double kernel(SltFilter f, double u) {
    double a = fabs(u);
    switch (f) {
    case SLT_FILTER_BOX: return a <= 0.5;
    case SLT_FILTER_TENT: return a < 1 ? 1 - a : 0;
    case SLT_FILTER_GAUSSIAN: return a < GAUSS_RADIUS ? exp(-2 * u * u) * (GAUSS_PEAK / GAUSS_MASS) : 0;
    }
    return 0;
}

static double cumulative(SltFilter f, double u, double radius) {
    if (u <= -radius) return 0;
    if (u >= radius) return 1;
    switch (f) {
    case SLT_FILTER_BOX: return u + 0.5;
    case SLT_FILTER_TENT: return u < 0 ? 0.5 * (1 + u) * (1 + u) : 1 - 0.5 * (1 - u) * (1 - u);
    case SLT_FILTER_GAUSSIAN: return 0.5 * (1 + erf(u * SQRT2) / GAUSS_MASS);
    }
    return 0;
}

static double inverse(SltFilter f, double p) {
    switch (f) {
    case SLT_FILTER_BOX: return p - 0.5;
    case SLT_FILTER_TENT: return p < 0.5 ? sqrt(2 * p) - 1 : 1 - sqrt(2 * (1 - p));
    case SLT_FILTER_GAUSSIAN: return gaussian_quantile(p);
    }
    return 0;
}

/* The part [from, to] of pixel p's filter that lies in the domain, in pixels from the middle of p. */
static void covered(const Grid *g, uint32_t p, uint32_t axis, double *from, double *to) {
    *from = fmax(-g->radius, -(p + 0.5));
    *to = fmin(g->radius, g->n[axis] - (p + 0.5));
}

SltStatus grid_init(Grid *g, const SltScene *s, const SltJob *j, SltError *err) {
    memset(g, 0, sizeof *g);
    g->integral = j->integral, g->dim = s->dim, g->filter = j->filter;
    g->radius = j->filter == SLT_FILTER_BOX ? 0.5 : j->filter == SLT_FILTER_TENT ? 1 : GAUSS_RADIUS;
    g->pixels = 1, g->density = 1;
    if (s->dim < 1 || s->dim > 3 || s->channels < 1 || s->channels > SLT_MAX_CHANNELS)
        return status_fail(err, SLT_INTERNAL, "a scene of %u dimensions and %u channels", s->dim, s->channels);
    for (uint32_t d = 0; d < 3; d++) {
        g->n[d] = d < s->dim && !j->integral ? j->size[d] : 1;
        g->lo[d] = d < s->dim ? s->lo[d] : 0, g->hi[d] = d < s->dim ? s->hi[d] : 1;
        if (!(g->hi[d] > g->lo[d]) || !isfinite(g->hi[d] - g->lo[d]))
            return status_fail(err, SLT_USAGE, "the domain is empty or not finite along axis %u", d);
        if (!g->n[d] || g->n[d] > 1u << 24)
            return status_fail(err, SLT_USAGE, "%u pixels along axis %u: 1 to 16777216 are possible", g->n[d], d);
        g->side[d] = (g->hi[d] - g->lo[d]) / g->n[d];
        if (g->pixels > (1ull << 40) / g->n[d]) return status_fail(err, SLT_LIMIT, "the image has too many pixels");
        g->pixels *= g->n[d];
        if (d < s->dim) g->density *= 1 / g->side[d];
    }
    if (!j->integral && j->filter != SLT_FILTER_BOX) {
        for (uint32_t d = 0; d < s->dim; d++) {
            g->mass[d] = malloc(2 * (size_t)g->n[d] * sizeof *g->mass[d]);
            if (!g->mass[d]) return status_fail(err, SLT_LIMIT, "out of memory");
            g->before[d] = g->mass[d] + g->n[d];
            for (uint32_t p = 0; p < g->n[d]; p++) {
                double from, to;
                covered(g, p, d, &from, &to);
                g->before[d][p] = cumulative(g->filter, from, g->radius);
                g->mass[d][p] = cumulative(g->filter, to, g->radius) - g->before[d][p];
            }
        }
    }
    return SLT_OK;
}

void grid_free(Grid *g) {
    for (int d = 0; d < 3; d++) free(g->mass[d]), g->mass[d] = g->before[d] = NULL;
}

void grid_into(const Grid *g, const uint32_t from[3], const uint32_t to[3], double x[3]) {
    for (uint32_t d = 0; d < g->dim; d++) {
        uint32_t at = grid_cell(g, d, x[d]);
        if (at >= from[d] && at < to[d]) continue;
        double unit = DBL_EPSILON * fmax(fabs(g->lo[d]), fabs(g->hi[d])), step;
        for (step = unit; grid_cell(g, d, x[d]) >= to[d]; step *= 2) x[d] = g->lo[d] + to[d] * g->side[d] - step;
        for (step = unit; grid_cell(g, d, x[d]) < from[d]; step *= 2) x[d] = g->lo[d] + from[d] * g->side[d] + step;
    }
}

uint32_t grid_reach(const Grid *g, uint32_t axis, double x, uint32_t *first, double weight[GRID_REACH]) {
    if (g->integral) {
        *first = 0, weight[0] = 1;
        return 1;
    }
    if (g->filter == SLT_FILTER_BOX) {
        *first = grid_cell(g, axis, x), weight[0] = 1 / g->side[axis];
        return 1;
    }
    double c = (x - g->lo[axis]) / g->side[axis] - 0.5;
    double lo = ceil(c - g->radius), hi = floor(c + g->radius);
    if (!(lo > 0)) lo = 0;
    if (hi > g->n[axis] - 1.0) hi = g->n[axis] - 1.0;
    uint32_t n = 0;
    *first = (uint32_t)lo;
    for (double p = lo; p <= hi && n < GRID_REACH; p++, n++) {
        double m = g->mass[axis][(uint32_t)p];
        weight[n] = m > 0 ? kernel(g->filter, c - p) / (m * g->side[axis]) : 0;
    }
    return n;
}

double grid_share(const Grid *g, uint32_t axis, uint32_t p, double a, double b) {
    double middle = g->lo[axis] + (p + 0.5) * g->side[axis];
    double part = cumulative(g->filter, (b - middle) / g->side[axis], g->radius) -
                  cumulative(g->filter, (a - middle) / g->side[axis], g->radius);
    double mass = g->mass[axis] ? g->mass[axis][p] : 1;
    return mass > 0 ? part / mass : 0;
}

double grid_place_filtered(const Grid *g, uint32_t axis, uint32_t p, double u) {
    double from, to;
    covered(g, p, axis, &from, &to);
    double q = g->before[axis][p] + u * g->mass[axis][p];
    double v = inverse(g->filter, q);
    v = v < from ? from : v > to ? to : v;
    return g->lo[axis] + (p + 0.5 + v) * g->side[axis];
}

void grid_gather(const Grid *g, const float *adjoint, uint32_t channels, const double x[3], double *out) {
    if (grid_is_box(g)) {
        uint32_t cell[3];
        grid_cells(g, x, cell);
        grid_gather_box(g, adjoint, channels, cell, out);
        return;
    }
    uint32_t first[3] = {0}, n[3] = {1, 1, 1};
    double w[3][GRID_REACH] = {{1}, {1}, {1}};
    for (uint32_t d = 0; d < g->dim; d++) n[d] = grid_reach(g, d, x[d], &first[d], w[d]);
    for (uint32_t c = 0; c < channels; c++) out[c] = 0;
    for (uint32_t k = 0; k < n[2]; k++)
        for (uint32_t j = 0; j < n[1]; j++)
            for (uint32_t i = 0; i < n[0]; i++) {
                const float *a = adjoint + grid_index(g, first[0] + i, first[1] + j, first[2] + k) * channels;
                double weight = w[0][i] * w[1][j] * w[2][k];
                for (uint32_t c = 0; c < channels; c++) out[c] += weight * (double)a[c];
            }
}

double grid_gather_all(const Grid *g, float v, const double x[3]) {
    if (grid_is_box(g)) return g->density * (double)v;
    uint32_t first, n[3] = {1, 1, 1};
    double w[3][GRID_REACH] = {{1}, {1}, {1}}, out = 0;
    for (uint32_t d = 0; d < g->dim; d++) n[d] = grid_reach(g, d, x[d], &first, w[d]);
    for (uint32_t k = 0; k < n[2]; k++)
        for (uint32_t j = 0; j < n[1]; j++)
            for (uint32_t i = 0; i < n[0]; i++) out += w[0][i] * w[1][j] * w[2][k] * (double)v;
    return out;
}

void pattern_init(Pattern *p, const SltScene *s, uint32_t seed, RngPurpose purpose, uint32_t lane, uint64_t owner) {
    p->dims = s->dim + (s->uses_rand ? 1 : 0);
    p->seed = seed, p->lane = lane, p->owner = owner, p->purpose = purpose;
    rng_block(seed, purpose, lane, owner, p->shift);
}

/* A stream is named by 32 random bits. Four samples of a pixel share one block of Philox. */
int32_t pattern_stream(const Pattern *p, uint64_t index) {
    uint32_t v[4];
    rng_block(p->seed ^ (uint32_t)p->purpose * 0x85ebca6bu, RNG_STREAM, p->lane ^ (uint32_t)(index >> 2) * 0x9e3779b9u,
              p->owner << 24 ^ index >> 2, v);
    return (int32_t)v[index & 3];
}
