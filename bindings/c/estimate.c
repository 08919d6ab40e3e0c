/* Estimating: each call makes sure of its kernels and hands the scene to the runtime. */
#include <math.h>

#include "bindings/c/api.h"

static const bool needs_render[K_KINDS] = {[K_VALUE] = true};

static void gradient_needs(const SltJob *j, bool forward, bool needs[K_KINDS]) {
    for (int k = 0; k < K_KINDS; k++) needs[k] = false;
    needs[K_VALUE] = true;
    if (slt_estimate_by_differences(j->estimator)) return;
    if (!j->no_interior) needs[forward ? K_JVP : K_VJP] = true;
    if (j->no_boundary) return;
    needs[K_REGION] = needs[K_EVENT] = needs[K_SIDES] = needs[K_SITE] = needs[K_SITE_GRAD] = true;
    needs[forward ? K_SITE_JVP : K_SITE_VJP] = true;
}

static SltStatus prepare(SltProgram *p, const SltJob *j, bool gradient, bool forward, SltError *err) {
    bool needs[K_KINDS];
    if (gradient) gradient_needs(j, forward, needs);
    p->error = (SltError){0};
    return api_kernels(p, gradient ? needs : needs_render, err);
}

static SltStatus finish(SltProgram *p, SltStatus status, SltError *err) {
    if (status == SLT_OK && p->error.status != SLT_OK) return status_fail(err, p->error.status, "%s", p->error.text);
    return status;
}

/* What is truly infinite is infinite, and counted. */
static void count_nonfinite(const double *v, size_t n, SltStats *stats) {
    if (!v || !stats) return;
    uint64_t bad = 0;
    for (size_t i = 0; i < n; i++) bad += !isfinite(v[i]);
    stats->nonfinite += bad;
}

SltStatus slt_render(SltProgram *p, const SltJob *job, float *image, SltStats *stats, SltError *err) {
    SltStatus s = prepare(p, job, false, false, err);
    return s != SLT_OK ? s : finish(p, slt_estimate_render(&p->scene, job, 0, image, stats, err), err);
}

SltStatus slt_grad_images(SltProgram *p, const SltJob *job, uint32_t ndir, const double *const *dirs, float *const *out,
                          float *crossings, SltStats *stats, SltError *err) {
    SltStatus s = prepare(p, job, true, true, err);
    return s != SLT_OK ? s
                       : finish(p, slt_estimate_forward(&p->scene, job, ndir, dirs, out, crossings, stats, err), err);
}

SltStatus slt_grad_adjoint(SltProgram *p, const SltJob *job, const float *adjoint, double *gradient,
                           double *stderr_bound, SltStats *stats, SltError *err) {
    const float *both[2] = {adjoint, adjoint};
    SltStatus s = prepare(p, job, true, false, err);
    if (s == SLT_OK) s = finish(p, slt_estimate_reverse(&p->scene, job, both, gradient, stderr_bound, stats, err), err);
    if (s == SLT_OK) count_nonfinite(gradient, p->prog->nfloats, stats);
    return s;
}

SltStatus slt_grad_loss(SltProgram *p, const SltJob *job, const float *target, const float *mask, double *loss,
                        double *gradient, double *stderr_bound, float *image, SltStats *stats, SltError *err) {
    SltStatus s = prepare(p, job, true, false, err);
    if (s == SLT_OK)
        s = finish(p, slt_estimate_loss(&p->scene, job, target, mask, loss, gradient, stderr_bound, image, stats, err),
                   err);
    if (s == SLT_OK) count_nonfinite(gradient, p->prog->nfloats, stats);
    return s;
}

SltStatus slt_grad_integral(SltProgram *p, const SltJob *job, SltIntegral *out, SltStats *stats, SltError *err) {
    SltStatus s = prepare(p, job, true, false, err);
    if (s == SLT_OK) s = finish(p, slt_estimate_integral(&p->scene, job, out, stats, err), err);
    if (s == SLT_OK) count_nonfinite(out->gradient, (size_t)p->prog->channels * p->prog->nfloats, stats);
    return s;
}

SltStatus slt_crossing(SltProgram *p, const double a[3], const double b[3], uint32_t stream, SltCrossing *out,
                       SltError *err) {
    SltJob job = SLT_JOB_INIT;
    SltStatus s = prepare(p, &job, true, false, err);
    return s != SLT_OK ? s : finish(p, slt_estimate_crossing(&p->scene, a, b, stream, out, err), err);
}
