/* The scenes of scene.h behind all kernels that estimators call: derivatives of g from its dual numbers, of f by
 * differences with its decisions kept. */
#ifndef SALTUS_TESTS_QUADRATURE_ESTIMATES_H
#define SALTUS_TESTS_QUADRATURE_ESTIMATES_H

#include "tests/quadrature/scene.h"

/* Boxes of which nothing is known; NULL: none. */
static bool (*estimates_unknown)(const Scene *s, const SltKernelArgs *a, uint32_t i);

static inline double estimates_g(Scene *s, SltKernelArgs *a, uint32_t event, uint32_t i, uint32_t moved, double dg[3]) {
    Num x[3];
    scene_point(s, a, i, false, x);
    Scene own; /* threads share s */
    memcpy(&own, s, offsetof(Scene, calls));
    own.moved = moved;
    Num g = own.g(&own, event, x);
    for (uint32_t d = 0; d < 3 && dg; d++) dg[d] = g.d[d].lo;
    return moved < s->np ? g.d[3].lo : g.v.lo;
}

/* The first site on whose two sides a pair of points lies; -1: none. */
static inline int32_t estimates_event(Scene *s, SltKernelArgs *a, uint32_t i) {
    for (uint32_t e = 0; e < s->nevents - s->nseams; e++) {
        double u = estimates_g(s, a, e, i, s->np, NULL), v = estimates_g(s, a, e, i + 1, s->np, NULL);
        if (s->rounds ? floor(u) != floor(v) : (u < 0) != (v < 0)) return (int32_t)e;
    }
    return -1;
}

static inline void estimates_call(void *user, int kind, SltKernelArgs *a, uint32_t n) {
    Scene *s = user;
    double dg[3];
    for (uint32_t i = 0; i < n; i++) {
        Look l = {.scene = s};
        double f[SLT_MAX_CHANNELS] = {0};
        scene_point(s, a, i, false, l.at);
        for (int d = 0; d < 3; d++) l.x[d] = l.at[d].v.lo;
        switch (kind) {
        case SLT_K_REGION:
            s->f(&l, f);
            ((uint32_t *)a->out[s->slt.layout[kind].out[SLT_OUT_HASH].first])[i] = l.hash;
            break;
        case SLT_K_EVENT: {
            if (i & 1) break;
            int32_t e = estimates_event(s, a, i);
            for (uint32_t k = i; k < i + 2 && k < n; k++) {
                double g = e < 0 ? 0 : estimates_g(s, a, (uint32_t)e, k, s->np, NULL), other;
                other = e < 0 ? 0 : estimates_g(s, a, (uint32_t)e, k ^ 1, s->np, NULL);
                double boundary = s->rounds ? fmin(floor(g), floor(other)) + 1 : 0;
                scene_out_int(s, a, kind, SLT_OUT_SITE, 0, k, e < 0 ? -1 : 0);
                scene_out_int(s, a, kind, SLT_OUT_K, 0, k, e);
                scene_out(s, a, kind, SLT_OUT_G, 0, k, g - boundary);
                scene_out(s, a, kind, SLT_OUT_BOUNDARY, 0, k, boundary);
            }
            break;
        }
        case SLT_K_SITE:
        case SLT_K_SITE_GRAD:
        case SLT_K_SITE_VJP:
        case SLT_K_SITE_JVP: {
            uint32_t e = scene_event(s, a, i);
            double boundary = s->rounds ? scene_in(s, a, SLT_IN_BOUNDARY, i) : 0, dot = 0;
            scene_out(s, a, kind, SLT_OUT_G, 0, i, estimates_g(s, a, e, i, s->np, dg) - boundary);
            for (uint32_t d = 0; d < s->slt.dim && kind == SLT_K_SITE_GRAD; d++)
                scene_out(s, a, kind, SLT_OUT_G_DX, d, i, dg[d]);
            if (kind != SLT_K_SITE_VJP && kind != SLT_K_SITE_JVP) break;
            for (uint32_t p = 0; p < s->np; p++) {
                double d = estimates_g(s, a, e, i, p, NULL);
                if (kind == SLT_K_SITE_VJP) ((double *)a->adj)[p] += d * scene_in(s, a, SLT_IN_SEED0, i);
                else dot += d * ((const double *)a->dparams)[p];
            }
            if (kind == SLT_K_SITE_JVP) scene_out(s, a, kind, SLT_OUT_DG, 0, i, dot);
            break;
        }
        default:
            scene_call(user, kind, a, n);
            for (i = 0; i < n && kind == SLT_K_BOUNDS && estimates_unknown; i++)
                scene_out_int(s, a, kind, SLT_OUT_BOX_STATE, 0, i, estimates_unknown(s, a, i) ? SLT_BOX_UNKNOWN : 0);
            return;
        }
    }
}

/* After scene_init; s->p stays as it is. f has no derivative of its own. */
static inline void estimates_init(Scene *s) {
    SltScene *t = &s->slt;
    t->call = estimates_call, t->adj_lanes = 1;
    t->params = s->p, t->nfloats = s->np;
    t->kernel[SLT_K_VJP] = t->kernel[SLT_K_JVP] = NULL;
    scene_role(t, SLT_K_REGION, SLT_OUT_HASH, 1);
    static const SltRole event[] = {SLT_OUT_SITE, SLT_OUT_K, SLT_OUT_G, SLT_OUT_BOUNDARY};
    for (int i = 0; i < 4; i++) scene_role(t, SLT_K_EVENT, event[i], 1);
    for (int k = SLT_K_SITE; k <= SLT_K_SITE_VJP; k++) scene_role(t, (SltKernelKind)k, SLT_OUT_G, 1);
    scene_role(t, SLT_K_SITE_GRAD, SLT_OUT_G_DX, t->dim), scene_role(t, SLT_K_SITE_JVP, SLT_OUT_DG, 1);
}

#endif
