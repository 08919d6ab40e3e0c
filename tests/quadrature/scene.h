/* Scenes in C behind the kernels that cells call: a list of events, each with its g as intervals, and f as a function
 * of their decisions. */
#ifndef SALTUS_TESTS_QUADRATURE_SCENE_H
#define SALTUS_TESTS_QUADRATURE_SCENE_H

#include <string.h>

#include "runtime/sample/estimate.h"
#include "tests/quadrature/interval.h"

typedef struct Scene Scene;
/* Of a point: what was decided. */
typedef struct Look {
    const Scene *scene;
    double x[3];
    Num at[3];
    uint32_t hash;
} Look;

struct Scene {
    SltScene slt;
    uint32_t nevents, nseams; /* the last nseams events are seams */
    Num (*g)(const Scene *s, uint32_t event, const Num x[3]);
    /* The same g at a point, the same bits, for scenes that are asked often; NULL: none. */
    double (*point)(const Scene *s, uint32_t event, const double x[3], double dg[3]);
    void (*f)(Look *l, double *f);
    bool opaque; /* event e is where e is seen; of those that are the last hides the others */
    bool (*rough)(const Scene *s, const Num x[3]);
    const double *p;                   /* parameters */
    uint32_t np, moved;                /* moved: parameter in whose direction d[3] is; np: none */
    double boundary;                   /* of the event in hand: g is v - boundary */
    bool rounds;                       /* all sites are floors */
    const uint32_t *near_start, *near; /* opaque, over [0,1]^2: events by cell of a grid of near_n^2 */
    uint32_t near_n;
    uint64_t calls[SLT_KERNELS], lanes[SLT_KERNELS]; /* last: threads write them, and copy the rest */
};

static inline Num param(const Scene *s, uint32_t i) {
    Num r = num(s->p[i]);
    if (i == s->moved) r.d[3] = iv(1, 1);
    return r;
}
static inline uint32_t mix(uint32_t h) {
    h ^= h >> 16, h *= 0x85ebca6bu, h ^= h >> 13, h *= 0xc2b2ae35u;
    return h ^ h >> 16;
}
static inline bool decide(Look *l, uint32_t event) {
    bool yes = l->scene->g(l->scene, event, l->at).v.lo < 0;
    if (yes) l->hash ^= mix(event + 1);
    return yes;
}
static inline double decide_floor(Look *l, uint32_t event) {
    double n = floor(l->scene->g(l->scene, event, l->at).v.lo);
    l->hash ^= mix(event + 1) * (uint32_t)(int32_t)n;
    return n;
}

static inline double scene_in(const Scene *s, const SltKernelArgs *a, uint32_t slot, uint32_t i) {
    return s->slt.f64 ? ((const double *)a->in[slot])[i] : (double)((const float *)a->in[slot])[i];
}
static inline void scene_out(const Scene *s, SltKernelArgs *a, int kind, SltRole role, uint32_t k, uint32_t i,
                             double v) {
    void *to = a->out[s->slt.layout[kind].out[role].first + k];
    if (s->slt.f64) ((double *)to)[i] = v;
    else ((float *)to)[i] = (float)v;
}
static inline void scene_out_int(const Scene *s, SltKernelArgs *a, int kind, SltRole role, uint32_t k, uint32_t i,
                                 int32_t v) {
    ((int32_t *)a->out[s->slt.layout[kind].out[role].first + k])[i] = v;
}
static inline void scene_point(const Scene *s, const SltKernelArgs *a, uint32_t i, bool box, Num x[3]) {
    for (uint32_t d = 0; d < 3; d++) x[d] = num(0);
    for (uint32_t d = 0; d < s->slt.dim; d++) {
        double lo = scene_in(s, a, SLT_IN_X0 + d, i);
        x[d].v = iv(lo, box ? scene_in(s, a, SLT_IN_H0 + d, i) : lo);
        x[d].d[d] = iv(1, 1);
    }
}
/* Events are sites where edge numbers are; all events of a site-0 scene are told apart by k. */
static inline uint32_t scene_event(const Scene *s, const SltKernelArgs *a, uint32_t i) {
    uint32_t sites = s->nevents - s->nseams, k = (uint32_t)((const int32_t *)a->in[SLT_IN_K0])[i];
    return a->site == 0 ? k % sites : sites + (uint32_t)a->site - 1;
}

static inline void scene_open(const Scene *s, SltKernelArgs *a, uint32_t i, uint32_t *n, uint32_t event, Iv v) {
    uint32_t sites = s->nevents - s->nseams;
    if (*n < SLT_MAX_OPEN) {
        scene_out_int(s, a, SLT_K_BOUNDS, SLT_OUT_OPEN_EDGE, *n, i, event < sites ? 0 : (int32_t)(event - sites + 1));
        scene_out_int(s, a, SLT_K_BOUNDS, SLT_OUT_OPEN_K, *n, i, event < sites ? (int32_t)event : 0);
        scene_out(s, a, SLT_K_BOUNDS, SLT_OUT_OPEN_FIRST, *n, i, floor(v.lo) + 1);
        scene_out(s, a, SLT_K_BOUNDS, SLT_OUT_OPEN_LAST, *n, i, floor(v.hi));
    }
    ++*n;
}

/* The events of a grid's cell that holds all of the box; NULL: all events. */
static inline const uint32_t *scene_near(const Scene *s, const Num x[3], uint32_t *n) {
    *n = s->nevents;
    if (!s->near) return NULL;
    uint32_t at[2];
    for (int d = 0; d < 2; d++) {
        double lo = floor(x[d].v.lo * s->near_n), hi = floor(x[d].v.hi * s->near_n);
        if (lo != hi || lo < 0 || hi >= s->near_n) return NULL;
        at[d] = (uint32_t)lo;
    }
    uint32_t cell = at[1] * s->near_n + at[0];
    *n = s->near_start[cell + 1] - s->near_start[cell];
    return s->near + s->near_start[cell];
}

static inline void scene_bounds(const Scene *s, SltKernelArgs *a, uint32_t i) {
    Num x[3];
    uint32_t open = 0, n;
    scene_point(s, a, i, true, x);
    const uint32_t *near = scene_near(s, x, &n);
    Iv f = iv(-HUGE_VAL, HUGE_VAL);
    for (uint32_t j = n; j-- > 0;) {
        uint32_t e = near ? near[j] : j;
        Iv v = s->g(s, e, x).v;
        bool site = e < s->nevents - s->nseams;
        bool is_open = site && s->rounds ? floor(v.lo) != floor(v.hi) : !(v.lo >= 0 || v.hi < 0);
        if (is_open) scene_open(s, a, i, &open, e, v);
        else if (s->opaque && v.hi < 0) {
            if (!open) f = iv((double)(mix(e) & 255) / 255, (double)(mix(e) & 255) / 255);
            break;
        }
    }
    scene_out_int(s, a, SLT_K_BOUNDS, SLT_OUT_OPEN, 0, i, (int32_t)open);
    scene_out_int(s, a, SLT_K_BOUNDS, SLT_OUT_BOX_STATE, 0, i, s->rough && s->rough(s, x) ? SLT_BOX_ROUGH : 0);
    scene_out(s, a, SLT_K_BOUNDS, SLT_OUT_F_LO, 0, i, f.lo);
    scene_out(s, a, SLT_K_BOUNDS, SLT_OUT_F_HI, 0, i, f.hi);
}

/* f of opaque shapes, painted in order. */
static inline void paint(Look *l, double *f) {
    uint32_t n;
    const uint32_t *near = scene_near(l->scene, l->at, &n);
    f[0] = 0;
    for (uint32_t j = n; j-- > 0;) {
        uint32_t e = near ? near[j] : j;
        double dg[3];
        const Scene *s = l->scene;
        if ((s->point ? s->point(s, e, l->x, dg) : s->g(s, e, l->at).v.lo) < 0) {
            l->hash = mix(e + 1);
            f[0] = (double)(mix(e) & 255) / 255;
            return;
        }
    }
}

static inline void scene_call(void *user, int kind, SltKernelArgs *a, uint32_t n) {
    Scene *s = user;
    __atomic_fetch_add(&s->calls[kind], 1, __ATOMIC_RELAXED); /* threads share the scene */
    __atomic_fetch_add(&s->lanes[kind], n, __ATOMIC_RELAXED);
    for (uint32_t i = 0; i < n; i++) {
        Num x[3], g;
        switch (kind) {
        case SLT_K_BOUNDS: scene_bounds(s, a, i); break;
        case SLT_K_EDGE:
        case SLT_K_EDGE_BOUNDS: {
            bool box = kind == SLT_K_EDGE_BOUNDS;
            if (!box && s->point && a->site == 0) {
                double dg[3], at[3] = {scene_in(s, a, SLT_IN_X0, i), scene_in(s, a, SLT_IN_X1, i), 0};
                scene_out(s, a, kind, SLT_OUT_G, 0, i, s->point(s, scene_event(s, a, i), at, dg));
                for (uint32_t d = 0; d < s->slt.dim; d++) scene_out(s, a, kind, SLT_OUT_G_DX, d, i, dg[d]);
                break;
            }
            scene_point(s, a, i, box, x);
            g = s->g(s, scene_event(s, a, i), x);
            if (s->rounds && a->site == 0) g = num_sub(g, num(scene_in(s, a, SLT_IN_BOUNDARY, i)));
            if (box) {
                scene_out(s, a, kind, SLT_OUT_G_LO, 0, i, g.v.lo), scene_out(s, a, kind, SLT_OUT_G_HI, 0, i, g.v.hi);
                scene_out(s, a, kind, SLT_OUT_G_ERROR, 0, i, g.error);
                scene_out_int(s, a, kind, SLT_OUT_G_STATE, 0, i,
                              (g.jumps ? SLT_EDGE_JUMPS : 0) | (g.bends ? SLT_EDGE_BENDS : 0));
            } else scene_out(s, a, kind, SLT_OUT_G, 0, i, g.v.lo);
            for (uint32_t d = 0; d < s->slt.dim; d++)
                if (box) {
                    scene_out(s, a, kind, SLT_OUT_DG_LO, d, i, g.d[d].lo);
                    scene_out(s, a, kind, SLT_OUT_DG_HI, d, i, g.d[d].hi);
                } else scene_out(s, a, kind, SLT_OUT_G_DX, d, i, g.d[d].lo);
            break;
        }
        case SLT_K_SIDES:
        case SLT_K_VALUE: {
            Look l = {.scene = s};
            double f[SLT_MAX_CHANNELS] = {0};
            scene_point(s, a, i, false, l.at);
            for (int d = 0; d < 3; d++) l.x[d] = l.at[d].v.lo;
            s->f(&l, f);
            for (uint32_t ch = 0; ch < s->slt.channels; ch++) scene_out(s, a, kind, SLT_OUT_F, ch, i, f[ch]);
            if (kind == SLT_K_SIDES) ((uint32_t *)a->out[s->slt.layout[kind].out[SLT_OUT_HASH].first])[i] = l.hash;
            break;
        }
        default: break;
        }
    }
}

static inline void scene_role(SltScene *s, SltKernelKind kind, SltRole role, uint32_t count) {
    uint32_t n = 0;
    for (int r = 0; r < SLT_ROLES; r++) n += s->layout[kind].out[r].count;
    s->layout[kind].out[role].first = (uint16_t)n, s->layout[kind].out[role].count = (uint16_t)count;
}
static inline void scene_present(SltKernelArgs *a, uint32_t n) { (void)a, (void)n; }

/* Domain [0,1]^dim, one channel. */
static inline void scene_init(Scene *s, uint32_t dim, uint32_t nsites, uint32_t nseams,
                              Num (*g)(const Scene *, uint32_t, const Num *), void (*f)(Look *, double *),
                              const double *p, uint32_t np) {
    static const uint8_t kinds[64] = {0}, floors[64] = {SLT_SITE_FLOOR};
    memset(s, 0, sizeof *s);
    s->g = g, s->f = f, s->p = p, s->np = s->moved = np, s->nevents = nsites + nseams, s->nseams = nseams;
    SltScene *t = &s->slt;
    t->call = scene_call, t->call_user = s, t->f64 = true, t->adj_lanes = 8, t->dim = dim, t->channels = 1;
    for (int k = 0; k < SLT_K_CULL; k++) t->kernel[k] = scene_present, t->layout[k].reads = UINT64_MAX;
    for (int d = 0; d < 3; d++) t->lo[d] = 0, t->hi[d] = 1;
    t->nsites = 1, t->nedges = 1 + nseams, t->site_kind = t->edge_kind = kinds;
    if (s->rounds) t->edge_kind = floors;
    scene_role(t, SLT_K_VALUE, SLT_OUT_F, 1);
    scene_role(t, SLT_K_SIDES, SLT_OUT_F, 1), scene_role(t, SLT_K_SIDES, SLT_OUT_HASH, 1);
    scene_role(t, SLT_K_EDGE, SLT_OUT_G, 1), scene_role(t, SLT_K_EDGE, SLT_OUT_G_DX, dim);
    static const SltRole box[] = {SLT_OUT_G_LO, SLT_OUT_G_HI, SLT_OUT_G_STATE, SLT_OUT_G_ERROR};
    for (int i = 0; i < 4; i++) scene_role(t, SLT_K_EDGE_BOUNDS, box[i], 1);
    scene_role(t, SLT_K_EDGE_BOUNDS, SLT_OUT_DG_LO, dim), scene_role(t, SLT_K_EDGE_BOUNDS, SLT_OUT_DG_HI, dim);
    scene_role(t, SLT_K_BOUNDS, SLT_OUT_BOX_STATE, 1), scene_role(t, SLT_K_BOUNDS, SLT_OUT_OPEN, 1);
    scene_role(t, SLT_K_BOUNDS, SLT_OUT_F_LO, 1), scene_role(t, SLT_K_BOUNDS, SLT_OUT_F_HI, 1);
    static const SltRole lists[] = {SLT_OUT_OPEN_EDGE, SLT_OUT_OPEN_K, SLT_OUT_OPEN_FIRST, SLT_OUT_OPEN_LAST};
    for (int i = 0; i < 4; i++) scene_role(t, SLT_K_BOUNDS, lists[i], SLT_MAX_OPEN);
}
static inline void scene_floors(Scene *s) {
    static const uint8_t floors[64] = {SLT_SITE_FLOOR};
    s->rounds = true, s->slt.edge_kind = s->slt.site_kind = floors;
}

#endif
