/* Shaders in C, seen through the kernel contract, without a compiler: each is a function of x that calls `disc` at its
 * sites, and a function that gives g of a site anywhere. All kernels are derived from the two, in double: hashes from
 * the log of decisions, events from two logs side by side, derivatives by central differences (of f with its decisions
 * replayed). Slow and simple: an independent oracle of what kernels should say. */
#ifndef SALTUS_TESTS_SAMPLE_ORACLE_H
#define SALTUS_TESTS_SAMPLE_ORACLE_H

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "runtime/sample/estimate.h"
#include "tests/sample/layouts.h"

enum { ORACLE_EVENTS = 64, ORACLE_PARAMS = 16 };

typedef struct Point {
    double x[3];
    const double *p; /* parameters */
    int32_t stream;
    double rand0;
} Point;

typedef struct Event {
    int site, k;
    double decision, g; /* 0/1, or the integer; g = a - b, or v */
    bool integer;
} Event;

typedef struct Oracle Oracle;
typedef struct Ctx {
    const Oracle *o;
    Point at;
    Event log[ORACLE_EVENTS];
    int n;
    const Event *replay; /* decisions to take instead */
} Ctx;

struct Oracle {
    SltScene scene;
    void (*f)(Ctx *c, double *out);
    double (*g)(const Point *p, int site, int k);
    double params[ORACLE_PARAMS];
    float params32[ORACLE_PARAMS];
    uint8_t active[ORACLE_PARAMS], kind[8], is_static[8];
    double step; /* of the differences in x */
};

static inline double oracle_note(Ctx *c, int site, int k, bool integer) {
    if (c->n >= ORACLE_EVENTS) return 0;
    Event *e = &c->log[c->n];
    *e = (Event){.site = site, .k = k, .integer = integer};
    e->g = c->o->g(&c->at, site, k);
    e->decision = integer ? floor(e->g) : e->g < 0;
    if (c->replay) e->decision = c->replay[c->n].decision;
    c->n++;
    return e->decision;
}
/* [Disc] g < 0 */
static inline bool disc(Ctx *c, int site, int k) { return oracle_note(c, site, k, false) != 0; }
/* [Disc] floor(v) */
static inline double disc_floor(Ctx *c, int site, int k) { return oracle_note(c, site, k, true); }

static inline uint32_t oracle_mix(uint32_t h, uint32_t v) {
    h = (h ^ v) * 0x9e3779b1u;
    h ^= h >> 15;
    h *= 0x85ebca77u;
    return h ^ h >> 13;
}

static inline uint32_t oracle_hash(const Ctx *c) {
    uint32_t h = 0;
    for (int i = 0; i < c->n; i++) {
        uint32_t key = oracle_mix(oracle_mix(0x1234567u, (uint32_t)c->log[i].site), (uint32_t)c->log[i].k);
        if (c->log[i].integer) h ^= oracle_mix(key, (uint32_t)(int32_t)c->log[i].decision);
        else if (c->log[i].decision != 0) h ^= key;
    }
    return h;
}

static inline double oracle_read(const Oracle *o, const void *v, uint32_t i) {
    return o->scene.f64 ? ((const double *)v)[i] : (double)((const float *)v)[i];
}
static inline void oracle_write(const Oracle *o, void *v, uint32_t i, double x) {
    if (o->scene.f64) ((double *)v)[i] = x;
    else ((float *)v)[i] = (float)x;
}

static inline double oracle_g(const Oracle *o, const Point *p, int site, int k, double aux) {
    double v = o->g(p, site, k);
    return o->kind[site] == SLT_SITE_COMPARE ? v : v - aux;
}

/* The nearest event, for the near-miss outputs. */
static inline const Event *oracle_nearest(const Ctx *c, double *g) {
    const Event *best = NULL;
    *g = 0;
    for (int i = 0; i < c->n; i++) {
        const Event *e = &c->log[i];
        double v = !e->integer ? e->g : e->g - e->decision < 0.5 ? e->g - e->decision : e->g - e->decision - 1;
        if (!best || fabs(v) < fabs(*g)) best = e, *g = v;
    }
    return best;
}

static inline void *oracle_out(const Oracle *o, const SltKernelArgs *a, int kind, SltRole role, uint32_t k) {
    return a->out[o->scene.layout[kind].out[role].first + k];
}

static inline void oracle_call(void *user, int kind, SltKernelArgs *a, uint32_t n) {
#define OUT(role, k) oracle_out(o, a, kind, SLT_OUT_##role, k)
    Oracle *o = user;
    const SltScene *s = &o->scene;
    double theta[ORACLE_PARAMS];
    uint32_t width = s->adj_lanes, padded = (n + SLT_PAD - 1) / SLT_PAD * SLT_PAD;
    for (uint32_t p = 0; p < s->nfloats; p++) theta[p] = oracle_read(o, a->params, p);
    Ctx pair[2];
    /* Kernels work in whole vectors: what lies behind n must be readable and harmless. */
    for (uint32_t i = 0; i < padded; i++) {
        Ctx *c = &pair[i & 1];
        memset(c, 0, sizeof *c);
        c->o = o, c->at.p = theta;
        for (uint32_t d = 0; d < s->dim; d++) c->at.x[d] = oracle_read(o, a->in[SLT_IN_X0 + d], i);
        c->at.stream = ((const int32_t *)a->in[SLT_IN_STREAM])[i], c->at.rand0 = oracle_read(o, a->in[SLT_IN_RAND0], i);
        int k = ((const int32_t *)a->in[SLT_IN_K0])[i];
        double aux = oracle_read(o, a->in[SLT_IN_BOUNDARY], i), f[4] = {0}, g = 0;
        Point *at = &c->at;
        if (kind <= SLT_K_SIDES || kind == SLT_K_JVP || kind == SLT_K_VJP) o->f(c, f);
        switch (kind) {
        case SLT_K_VALUE:
            for (uint32_t ch = 0; ch < s->channels; ch++) oracle_write(o, OUT(F, ch), i, f[ch]);
            break;
        case SLT_K_REGION:
            ((uint32_t *)OUT(HASH, 0))[i] = oracle_hash(c);
            if (scene_outputs(s, SLT_K_REGION, SLT_OUT_NEAR_SITE)) {
                const Event *e = oracle_nearest(c, &g);
                ((int32_t *)OUT(NEAR_SITE, 0))[i] = e ? e->site : -1;
                oracle_write(o, OUT(NEAR_G, 0), i, g);
                ((int32_t *)OUT(NEAR_K, 0))[i] = e ? e->k : 0;
            }
            break;
        case SLT_K_EVENT:
            if (!(i & 1)) break;
            for (int l = 0; l < 2; l++)
                ((int32_t *)OUT(SITE, 0))[i - 1 + l] = -1, ((int32_t *)OUT(K, 0))[i - 1 + l] = 0;
            for (int e = 0; e < pair[0].n && e < pair[1].n; e++) {
                const Event *u = &pair[0].log[e], *v = &pair[1].log[e];
                if (u->site != v->site || u->k != v->k) break;
                if (u->decision == v->decision) continue;
                double boundary = u->integer ? fmin(u->decision, v->decision) + 1 : 0;
                for (int l = 0; l < 2; l++) {
                    ((int32_t *)OUT(SITE, 0))[i - 1 + l] = u->site, ((int32_t *)OUT(K, 0))[i - 1 + l] = u->k;
                    oracle_write(o, OUT(G, 0), i - 1 + l, (l ? v->g : u->g) - boundary);
                    oracle_write(o, OUT(BOUNDARY, 0), i - 1 + l, boundary);
                }
                break;
            }
            break;
        case SLT_K_SIDES:
            for (uint32_t ch = 0; ch < s->channels; ch++) oracle_write(o, OUT(F, ch), i, f[ch]);
            ((uint32_t *)OUT(HASH, 0))[i] = oracle_hash(c);
            break;
        case SLT_K_SITE: oracle_write(o, OUT(G, 0), i, oracle_g(o, at, a->site, k, aux)); break;
        case SLT_K_SITE_GRAD:
            oracle_write(o, OUT(G, 0), i, oracle_g(o, at, a->site, k, aux));
            for (uint32_t d = 0; d < s->dim; d++) {
                Point lo = *at, hi = *at;
                lo.x[d] -= o->step, hi.x[d] += o->step;
                oracle_write(o, OUT(G_DX, d), i,
                             (oracle_g(o, &hi, a->site, k, aux) - oracle_g(o, &lo, a->site, k, aux)) / (2 * o->step));
            }
            break;
        case SLT_K_SITE_JVP:
        case SLT_K_SITE_VJP: {
            uint32_t rows = a->rows > 1 ? s->channels : 1;
            double dot = 0;
            for (uint32_t p = 0; p < s->nfloats; p++) {
                double keep = theta[p], hi, lo;
                theta[p] = keep + 1e-6, hi = oracle_g(o, at, a->site, k, aux);
                theta[p] = keep - 1e-6, lo = oracle_g(o, at, a->site, k, aux);
                theta[p] = keep;
                double d = (hi - lo) / 2e-6;
                if (kind == SLT_K_SITE_JVP) dot += d * oracle_read(o, a->dparams, p);
                for (uint32_t r = 0; r < rows && kind == SLT_K_SITE_VJP; r++) {
                    uint64_t slot = (uint64_t)(r * s->nfloats + p) * width + i % width;
                    double seed = oracle_read(o, a->in[SLT_IN_SEED0 + r], i), old;
                    old = oracle_read(o, a->adj, (uint32_t)slot);
                    oracle_write(o, a->adj, (uint32_t)slot, seed != 0 ? old + seed * d : old);
                }
            }
            oracle_write(o, OUT(G, 0), i, oracle_g(o, at, a->site, k, aux));
            if (kind == SLT_K_SITE_JVP) oracle_write(o, OUT(DG, 0), i, dot);
            break;
        }
        case SLT_K_JVP:
        case SLT_K_VJP: {
            double dot[4] = {0};
            for (uint32_t p = 0; p < s->nfloats; p++) {
                double keep = theta[p], out[2][4] = {{0}};
                for (int side = 0; side < 2; side++) {
                    Ctx r = {.o = o, .at = *at, .replay = c->log};
                    theta[p] = keep + (side ? 1e-6 : -1e-6);
                    o->f(&r, out[side]);
                }
                theta[p] = keep;
                double seeded = 0;
                for (uint32_t ch = 0; ch < s->channels; ch++) {
                    double d = (out[1][ch] - out[0][ch]) / 2e-6;
                    if (kind == SLT_K_JVP) dot[ch] += d * oracle_read(o, a->dparams, p);
                    else seeded += d * oracle_read(o, a->in[SLT_IN_SEED0 + ch], i);
                }
                if (kind == SLT_K_VJP && seeded != 0 && i < a->n_valid) {
                    if (p % 2) { /* every second parameter as if it were read at a varying index */
                        if (a->log_len < a->log_cap)
                            a->log_index[a->log_len] = p, oracle_write(o, a->log_value, (uint32_t)a->log_len, seeded);
                        a->log_len++;
                    } else {
                        uint64_t slot = (uint64_t)p * width + i % width;
                        oracle_write(o, a->adj, (uint32_t)slot, oracle_read(o, a->adj, (uint32_t)slot) + seeded);
                    }
                }
            }
            for (uint32_t ch = 0; ch < s->channels; ch++) {
                oracle_write(o, OUT(F, ch), i, f[ch]);
                if (kind == SLT_K_JVP) oracle_write(o, OUT(DF, ch), i, dot[ch]);
            }
            break;
        }
        default: break;
        }
    }
}

#undef OUT

static inline void oracle_present(SltKernelArgs *a, uint32_t n) { (void)a, (void)n; }

/* Domain [0,1]^dim; every kernel present. */
static inline void oracle_init(Oracle *o, void (*f)(Ctx *, double *), double (*g)(const Point *, int, int),
                               uint32_t dim, uint32_t channels, uint32_t nsites, uint32_t nparams,
                               const double *params) {
    memset(o, 0, sizeof *o);
    o->f = f, o->g = g, o->step = 1e-6;
    SltScene *s = &o->scene;
    s->call = oracle_call, s->call_user = o;
    for (int k = 0; k < SLT_K_CULL; k++) s->kernel[k] = oracle_present;
    s->f64 = true, s->adj_lanes = 8, s->dim = dim, s->channels = channels;
    for (int d = 0; d < 3; d++) s->lo[d] = 0, s->hi[d] = 1;
    s->nfloats = nparams, s->nsites = nsites;
    scene_outputs_init(s);
    scene_add_output(s, SLT_K_EVENT, SLT_OUT_BOUNDARY, 1);
    for (uint32_t p = 0; p < nparams; p++)
        o->params[p] = params[p], o->params32[p] = (float)params[p], o->active[p] = 1;
    s->params = o->params, s->active = o->active, s->site_kind = o->kind, s->site_static = o->is_static;
}
static inline void oracle_use_f32(Oracle *o) { o->scene.f64 = false, o->scene.params = o->params32; }

#endif
