/* Layouts of kernels that are written in C. */
#ifndef SALTUS_TESTS_SAMPLE_LAYOUTS_H
#define SALTUS_TESTS_SAMPLE_LAYOUTS_H

#include "runtime/sample/estimate.h"

/* Gives a kernel `count` more outputs. */
static inline void scene_add_output(SltScene *s, SltKernelKind kind, SltRole role, uint32_t count) {
    uint32_t n = 0;
    for (int r = 0; r < SLT_ROLES; r++) n += s->layout[kind].out[r].count;
    s->layout[kind].out[role].first = (uint16_t)n, s->layout[kind].out[role].count = (uint16_t)count;
}
/* The outputs that all scenes have; every input is read, but the reverse of f knows one row. */
static inline void scene_outputs_init(SltScene *s) {
    for (int k = 0; k < SLT_K_CULL; k++) {
        s->layout[k].reads = k == SLT_K_VJP ? ~((uint64_t)1 << SLT_IN_ROWS) : UINT64_MAX;
        if (k == SLT_K_VALUE || k == SLT_K_SIDES || k == SLT_K_JVP || k == SLT_K_VJP)
            scene_add_output(s, (SltKernelKind)k, SLT_OUT_F, s->channels);
        else if (k != SLT_K_REGION) scene_add_output(s, (SltKernelKind)k, SLT_OUT_G, 1);
    }
    scene_add_output(s, SLT_K_REGION, SLT_OUT_HASH, 1), scene_add_output(s, SLT_K_SIDES, SLT_OUT_HASH, 1);
    scene_add_output(s, SLT_K_EVENT, SLT_OUT_SITE, 1), scene_add_output(s, SLT_K_EVENT, SLT_OUT_K, 1);
    scene_add_output(s, SLT_K_JVP, SLT_OUT_DF, s->channels), scene_add_output(s, SLT_K_SITE_JVP, SLT_OUT_DG, 1);
    scene_add_output(s, SLT_K_SITE_GRAD, SLT_OUT_G_DX, s->dim);
}
static inline void scene_without_depth(SltScene *s) {
    s->layout[SLT_K_REGION].out[SLT_OUT_DEPTH].count = s->layout[SLT_K_SIDES].out[SLT_OUT_DEPTH].count = 0;
}
/* region tells the nearest event as well. */
static inline void scene_near_miss(SltScene *s) {
    scene_add_output(s, SLT_K_REGION, SLT_OUT_NEAR_SITE, 1), scene_add_output(s, SLT_K_REGION, SLT_OUT_NEAR_G, 1);
    scene_add_output(s, SLT_K_REGION, SLT_OUT_NEAR_K, 1);
}

#endif
