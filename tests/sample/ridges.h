/* A landscape in slices, through the kernel contract: column x of the picture looks along its own profile of heights
 * (straight between nodes a unit apart), row y is the slope of the ray. Traces, tops and clearances by brute force,
 * kernels with depth and windows as compiled heightfield sites have them, in double. f = 1/t where a ray hits, `sky`
 * where it does not (or a constant on the ground, too), so integrals over a column have closed forms. */
#ifndef SALTUS_TESTS_SAMPLE_RIDGES_H
#define SALTUS_TESTS_SAMPLE_RIDGES_H

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "runtime/sample/estimate.h"
#include "saltus/heightfield.h"
#include "tests/sample/layouts.h"

enum { RIDGE_NODES = 512, RIDGE_PARAMS = 4 };

typedef struct Ridges Ridges;
struct Ridges {
    SltScene scene;
    uint32_t nodes;
    double (*height)(const double *p, double x, double rand0, uint32_t node); /* p[0] is the camera's height */
    double sky, ground, repeat; /* f; ground 0: 1/t. The trace is asked `repeat` times */
    double params[RIDGE_PARAMS];
    uint8_t active[RIDGE_PARAMS], kind[4], is_static[4];
    uint64_t calls[SLT_K_CULL + 1]; /* lanes by kernel */
    uint64_t named;                 /* pairs in which event found something */
    double (*lie)(double x);        /* instead of g, between ends that event gives -1 and 1 */
    double slack, low;              /* largest and smallest that a kernel saw in field 0 */
};

typedef struct Column {
    double h[RIDGE_NODES], z0;
    uint32_t n;
} Column;

static inline void column_at(const Ridges *r, const double *p, double x, double rand0, Column *c) {
    c->n = r->nodes, c->z0 = p[0];
    for (uint32_t i = 0; i < c->n; i++) c->h[i] = r->height(p, x, rand0, i);
}
/* Node i lies at t = i + 1. */
static inline double column_k(const Column *c, double t) {
    double at = t - 1;
    uint32_t i = at < c->n - 2 ? (uint32_t)at : c->n - 2;
    return (c->h[i] + (at - i) * (c->h[i + 1] - c->h[i]) - c->z0) / t;
}
/* The part of the profile that the ray hits first, or -1. */
static inline int column_trace(const Column *c, double slope) {
    for (uint32_t i = 0; i + 1 < c->n; i++)
        if (c->z0 + slope * (i + 2) < c->h[i + 1]) return (int)i;
    return -1;
}
static inline double column_t(const Column *c, double slope, int part) {
    double m = c->h[part + 1] - c->h[part];
    return (c->h[part] - m * (part + 1) - c->z0) / (slope - m);
}
/* The first local maximum of k from t on; the end of the land where it rises till there. */
static inline double column_top(const Column *c, double t) {
    double k = column_k(c, t), at = t;
    for (uint32_t i = (uint32_t)floor(t); i < c->n; i++) {
        double next = column_k(c, i + 1);
        if (next < k) return at;
        k = next, at = i + 1;
    }
    return at;
}
/* Least (ray - terrain) / t over [lo, hi]; nothing there: INFINITY. */
static inline double column_clearance(const Column *c, double slope, double lo, double hi) {
    double best = -HUGE_VAL;
    lo = fmax(lo, 1), hi = fmin(hi, c->n);
    if (!(lo <= hi)) return HUGE_VAL;
    best = fmax(column_k(c, lo), column_k(c, hi));
    for (double t = ceil(lo); t <= hi; t++) best = fmax(best, column_k(c, t));
    return slope - best;
}

/* The integral of f over the slopes [lo, hi] of a column: k is monotone on every part, and what rises above all before
 * is seen. */
static inline double column_integral(const Column *c, double lo, double hi, double sky, double ground) {
    double sum = 0, seen = column_k(c, 1);
    for (uint32_t i = 0; i + 1 < c->n; i++) {
        double k1 = column_k(c, i + 2);
        if (k1 <= seen) continue;
        double m = c->h[i + 1] - c->h[i], a = c->h[i] - m * (i + 1) - c->z0, from = fmax(seen, lo), to = fmin(k1, hi);
        /* slope = a/t + m, so 1/t is linear in it. */
        if (from < to)
            sum += ground != 0 ? ground * (to - from) : ((to - m) * (to - m) - (from - m) * (from - m)) / (2 * a);
        seen = k1;
    }
    return sum + sky * fmax(0, hi - fmax(seen, lo));
}
static inline double ridges_integral(const Ridges *r, const double *p) {
    uint32_t columns = r->scene.uses_rand ? 65536 : 4096;
    double sum = 0;
    Column c;
    for (uint32_t i = 0; i < columns; i++) {
        /* Random numbers are one more dimension: a rank-1 lattice with x. */
        double at = (i + 0.5) / columns, rand0 = r->scene.uses_rand ? at * 25281 - floor(at * 25281) : 0.5;
        column_at(r, p, r->scene.lo[0] + at * (r->scene.hi[0] - r->scene.lo[0]), rand0, &c);
        sum += column_integral(&c, r->scene.lo[1], r->scene.hi[1], r->sky, r->ground);
    }
    return r->repeat * sum * (r->scene.hi[0] - r->scene.lo[0]) / columns;
}
static inline double ridges_exact(const Ridges *r, uint32_t param) {
    double p[RIDGE_PARAMS], up;
    memcpy(p, r->params, sizeof p);
    p[param] = r->params[param] + 1e-4, up = ridges_integral(r, p);
    p[param] = r->params[param] - 1e-4;
    return (up - ridges_integral(r, p)) / 2e-4;
}

typedef struct Ray {
    double x, slope, rand0;
    int part;
    double t, depth;
} Ray;

static inline Ray ridges_ray(const Ridges *r, const SltKernelArgs *a, uint32_t i, Column *c) {
    Ray y = {.x = ((const double *)a->in[SLT_IN_X0])[i],
             .slope = ((const double *)a->in[SLT_IN_X1])[i],
             .rand0 = ((const double *)a->in[SLT_IN_RAND0])[i]};
    column_at(r, a->params, y.x, y.rand0, c);
    y.part = column_trace(c, y.slope);
    y.t = y.part < 0 ? HUGE_VAL : column_t(c, y.slope, y.part);
    y.depth = y.part < 0 ? 0 : r->repeat * log2(y.t);
    return y;
}

static inline void ridges_call(void *user, int kind, SltKernelArgs *a, uint32_t n) {
#define OUT(role, k, type) ((type *)a->out[s->layout[kind].out[SLT_OUT_##role].first + k])
#define FLT(role) OUT(role, 0, double)
#define INT(role) OUT(role, 0, int32_t)
    Ridges *r = user;
    const SltScene *s = &r->scene;
    bool depth = scene_outputs(s, SLT_K_REGION, SLT_OUT_DEPTH);
    static _Thread_local Column c[2], moved;
    Ray pair[2];
    memset(pair, 0, sizeof pair);
    uint32_t padded = (n + SLT_PAD - 1) / SLT_PAD * SLT_PAD;
    __atomic_fetch_add(&r->calls[kind], n, __ATOMIC_RELAXED);
    if (a->geometries)
        r->slack = fmax(r->slack, (double)a->geometries[0]->slack),
        r->low = fmin(r->low, (double)a->geometries[0]->slack);
    for (uint32_t i = 0; i < padded; i++) {
        Ray *y = &pair[i & 1];
        *y = ridges_ray(r, a, i, &c[i & 1]);
        double f = r->repeat * (y->part < 0      ? r->sky
                                : r->ground != 0 ? r->ground
                                                 : 1 / y->t),
               lo = ((const double *)a->in[SLT_IN_WINDOW0])[i], hi = ((const double *)a->in[SLT_IN_WINDOW1])[i];
        int32_t hash = y->part < 0 ? 17 : 3;
        switch (kind) {
        case SLT_K_VALUE: FLT(F)[i] = f; break;
        case SLT_K_REGION:
        case SLT_K_SIDES:
            INT(HASH)[i] = hash;
            if (depth) FLT(DEPTH)[i] = y->depth;
            if (kind == SLT_K_SIDES) FLT(F)[i] = f;
            break;
        case SLT_K_EVENT: {
            if (!(i & 1)) break;
            bool a_near = pair[0].t < pair[1].t;
            const Ray *near = a_near ? &pair[0] : &pair[1];
            const Column *at = a_near ? &c[0] : &c[1];
            double far = a_near ? pair[1].t : pair[0].t, jump = ((const double *)a->in[SLT_IN_THRESHOLD])[i],
                   top = near->part < 0 ? HUGE_VAL : column_top(at, near->t);
            bool differ = (pair[0].part < 0) != (pair[1].part < 0);
            if (depth && !differ && near->part >= 0) differ = top < far && log2(far) - log2(near->t) > jump / r->repeat;
            double from = near->t - 1, to = fmin(top + 1, 0.5 * (top + far));
            double g[2] = {column_clearance(&c[0], pair[0].slope, from, to),
                           column_clearance(&c[1], pair[1].slope, from, to)};
            if (r->lie) g[0] = -1, g[1] = 1;
            if (differ && i < n) __atomic_fetch_add(&r->named, 1, __ATOMIC_RELAXED);
            for (int l = 0; l < 2; l++) {
                INT(SITE)[i - 1 + l] = differ ? 0 : -1, INT(K)[i - 1 + l] = 0;
                FLT(G)[i - 1 + l] = g[l], FLT(WINDOW)[i - 1 + l] = from, OUT(WINDOW, 1, double)[i - 1 + l] = to;
            }
            break;
        }
        case SLT_K_SITE:
        case SLT_K_SITE_GRAD:
        case SLT_K_SITE_JVP:
        case SLT_K_SITE_VJP: {
            FLT(G)[i] = column_clearance(&c[i & 1], y->slope, lo, hi);
            if (r->lie) FLT(G)[i] = r->lie(y->x);
            if (kind == SLT_K_SITE_GRAD) {
                column_at(r, a->params, y->x + 1e-6, y->rand0, &moved);
                double up = column_clearance(&moved, y->slope, lo, hi);
                column_at(r, a->params, y->x - 1e-6, y->rand0, &moved);
                FLT(G_DX)[i] = (up - column_clearance(&moved, y->slope, lo, hi)) / 2e-6, OUT(G_DX, 1, double)[i] = 1;
            }
            if (kind < SLT_K_SITE_JVP) break;
            double dot = 0, seed = kind == SLT_K_SITE_VJP ? ((const double *)a->in[SLT_IN_SEED0])[i] : 0,
                   p[RIDGE_PARAMS];
            for (uint32_t k = 0; k < s->nfloats; k++) {
                memcpy(p, a->params, s->nfloats * sizeof *p);
                p[k] += 1e-6, column_at(r, p, y->x, y->rand0, &moved);
                double d = column_clearance(&moved, y->slope, lo, hi);
                p[k] -= 2e-6, column_at(r, p, y->x, y->rand0, &moved);
                d = isinf(d) ? 0 : (d - column_clearance(&moved, y->slope, lo, hi)) / 2e-6;
                if (kind == SLT_K_SITE_JVP) dot += d * ((const double *)a->dparams)[k];
                else if (seed != 0 && i < n) ((double *)a->adj)[k] += seed * d;
            }
            if (kind == SLT_K_SITE_JVP) FLT(DG)[i] = dot;
            break;
        }
        case SLT_K_JVP:
        case SLT_K_VJP: {
            double dot = 0, seed = kind == SLT_K_VJP ? ((const double *)a->in[SLT_IN_SEED0])[i] : 0, p[RIDGE_PARAMS];
            for (uint32_t k = 0; k < s->nfloats && y->part >= 0 && r->ground == 0; k++) {
                memcpy(p, a->params, s->nfloats * sizeof *p);
                p[k] += 1e-6, column_at(r, p, y->x, y->rand0, &moved);
                double d = 1 / column_t(&moved, y->slope, y->part);
                p[k] -= 2e-6, column_at(r, p, y->x, y->rand0, &moved);
                d = r->repeat * (d - 1 / column_t(&moved, y->slope, y->part)) / 2e-6;
                if (kind == SLT_K_JVP) dot += d * ((const double *)a->dparams)[k];
                else if (seed != 0 && i < n) ((double *)a->adj)[k] += seed * d;
            }
            FLT(F)[i] = f;
            if (kind == SLT_K_JVP) FLT(DF)[i] = dot;
            break;
        }
        default: break;
        }
    }
}

#undef OUT
#undef FLT
#undef INT

static inline void ridges_present(SltKernelArgs *a, uint32_t n) { (void)a, (void)n; }

/* x in [0, 1], slopes in [lo, hi]. */
static inline void ridges_init(Ridges *r, double (*height)(const double *, double, double, uint32_t), uint32_t nodes,
                               double lo, double hi, uint32_t nparams, const double *params) {
    memset(r, 0, sizeof *r);
    r->height = height, r->nodes = nodes, r->sky = 0.75, r->repeat = 1;
    SltScene *s = &r->scene;
    s->call = ridges_call, s->call_user = r;
    for (int k = 0; k < SLT_K_CULL; k++) s->kernel[k] = ridges_present;
    s->f64 = true, s->adj_lanes = 1, s->dim = 2, s->channels = 1;
    s->lo[0] = 0, s->hi[0] = 1, s->lo[1] = lo, s->hi[1] = hi, s->hi[2] = 1;
    s->nfloats = nparams, s->nsites = 1;
    scene_outputs_init(s);
    scene_add_output(s, SLT_K_REGION, SLT_OUT_DEPTH, 1), scene_add_output(s, SLT_K_SIDES, SLT_OUT_DEPTH, 1);
    scene_add_output(s, SLT_K_EVENT, SLT_OUT_WINDOW, 2);
    for (uint32_t p = 0; p < nparams; p++) r->params[p] = params[p], r->active[p] = 1;
    for (int k = 0; k < 4; k++) r->kind[k] = SLT_SITE_SILHOUETTE;
    s->params = r->params, s->active = r->active, s->site_kind = r->kind, s->site_static = r->is_static;
}

#endif
