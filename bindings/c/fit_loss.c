/* One evaluation of a fit: the loss, and its derivative by the optimised floats. */
#include <math.h>
#include <string.h>

#include "bindings/c/fit_inner.h"
#include "runtime/base/rng.h"

/* Flipped in the seed of the derivative after a loss that is not squared, so that its samples are others than those of
 * the image from which the adjoint came. */
enum { OTHER_SAMPLES = 0x40000000 };

/* What a difference weighs, and the derivative of that. */
static double weigh(const SltFitOptions *o, double off, double *slope) {
    double size = fabs(off), delta = o->huber_delta;
    *slope = (off > 0) - (off < 0);
    if (o->metric == SLT_FIT_L1) return size;
    if (size <= delta) return *slope = off, off * off / 2;
    *slope *= delta;
    return delta * (size - delta / 2);
}

/* The mean over pixels and channels of mask * metric(image - target), and its adjoint image. */
static double compare(const SltFit *f, const View *v, const float *image) {
    double sum = 0, row = 0, slope;
    for (size_t i = 0; i < v->size; i++) {
        double m = v->mask ? (double)v->mask[i] : 1;
        row += m * weigh(&f->opt, (double)image[i] - (double)v->target[i], &slope);
        f->adjoint[i] = (float)(m * slope / (double)v->size);
        if (i % 4096 == 4095) sum += row, row = 0;
    }
    return (sum + row) / (double)v->size;
}

static SltStatus ask_caller(SltFit *f, const SltJob *job, uint32_t view, const float *image, double *loss,
                            SltError *err) {
    SltFitRequest q = {.struct_size = sizeof q,
                       .iteration = fit_number(f),
                       .view = view,
                       .views = f->nviews,
                       .pixels = {job->size[0], job->size[1], job->size[2]},
                       .channels = slt_channels(f->views[view].p),
                       .image = image};
    return f->opt.loss(f->opt.loss_user, &q, loss, f->adjoint, err);
}

/* A loss that is not squared: the image and its adjoint first; the derivative of the image is then taken with other
 * samples, so that the noise in the adjoint is independent of the noise in the derivative. */
static SltStatus adjoint_loss(SltFit *f, const SltJob *job, uint32_t view, double *loss, SltError *err) {
    float *image = view == 0 ? f->image : f->other;
    const View *v = &f->views[view];
    SltStatus status = slt_render(v->p, job, image, f->opt.stats, err);
    if (status == SLT_OK && f->opt.loss) status = ask_caller(f, job, view, image, loss, err);
    else if (status == SLT_OK && f->entry) status = fit_entry_loss(f, v, image, loss, err);
    else if (status == SLT_OK) *loss = compare(f, v, image);
    /* The optimiser steps back from a loss of NaN, and wants no gradient there. */
    if (status != SLT_OK || isnan(*loss)) return status;
    SltJob other = *job;
    other.seed ^= OTHER_SAMPLES;
    return slt_grad_adjoint(v->p, &other, f->adjoint, f->all, NULL, f->opt.stats, err);
}

static SltStatus evaluate_integral(SltFit *f, SltJob *job, double *loss, SltError *err) {
    uint32_t nf = slt_float_count(f->p);
    double *value = f->all + (size_t)slt_channels(f->p) * nf;
    SltIntegral out = SLT_INTEGRAL_INIT;
    out.value = value, out.gradient = f->all;
    job->replicates = 1;
    SltStatus status = slt_grad_integral(f->p, job, &out, f->opt.stats, err);
    for (uint32_t k = 0; status == SLT_OK && k < slt_channels(f->p); k++) {
        *loss += value[k];
        for (uint32_t i = 0; i < f->n; i++) f->gradient[i] += f->all[(size_t)k * nf + f->index[i]];
    }
    return status;
}

/* The derivative of a view's loss by the floats of the fit's program. */
static const double *joined(SltFit *f, const View *v) {
    if (!v->share.p && !f->entry) return f->all;
    size_t nf = slt_float_count(f->p);
    if (v->share.p) memset(f->joined, 0, nf * sizeof *f->joined);
    else memcpy(f->joined, f->all, nf * sizeof *f->joined);
    if (v->share.p) fit_share_gradient(&v->share, f->all, f->joined);
    if (f->entry) fit_share_gradient(&f->entry->share, f->entry->gradient, f->joined);
    return f->joined;
}

/* Marks the views of this iteration; how many there are. By a shuffle whose words are of the seed and the iteration. */
static uint32_t choose_views(SltFit *f) {
    uint32_t n = f->nviews, k = f->opt.views_per_step, word[4];
    memset(f->drawn, !k, n * sizeof *f->drawn);
    if (!k) return n;
    /* Floyd's choice of k of n: each set is as likely. */
    for (uint32_t j = n - k; j < n; j++) {
        rng_block(f->job.seed, RNG_VIEW, j, fit_number(f), word);
        uint32_t pick = (uint32_t)(((uint64_t)word[0] * (j + 1)) >> 32);
        f->drawn[f->drawn[pick] ? j : pick] = true;
    }
    return k;
}

static double latest(const SltFit *f) {
    double sum = 0;
    uint32_t n = 0;
    for (uint32_t v = 0; v < f->nviews; v++)
        if (!isnan(f->latest[v])) sum += f->latest[v], n++;
    return sum / n;
}

/* The mean over the views of the loss at the optimiser's point, into *loss and f->gradient. */
SltStatus fit_evaluate(SltFit *f, double *loss, SltError *err) {
    SltStatus status = SLT_OK;
    SltJob job = f->job;
    fit_set_active(f, optimise_parameters(f->optimiser));
    if (!optimise_wants_same_loss(f->method)) job.seed += 0x9e3779b9u * (fit_number(f) + 1);
    memset(f->gradient, 0, f->n * sizeof *f->gradient);
    *loss = 0;
    if (f->opt.minimize) return evaluate_integral(f, &job, loss, err);
    uint32_t each = choose_views(f);
    for (uint32_t v = 0; v < f->nviews && status == SLT_OK; v++) {
        const View *view = &f->views[v];
        double one = 0;
        job.seed += v;
        if (!f->drawn[v]) continue;
        fit_use_view(f, view, &job);
        view->p->scene.frugal = !optimise_wants_same_loss(f->method);
        if (fit_wants_adjoint(f)) status = adjoint_loss(f, &job, v, &one, err);
        else
            status = slt_grad_loss(view->p, &job, view->target, view->mask, &one, f->all, NULL,
                                   v == 0 ? f->image : NULL, f->opt.stats, err);
        view->p->scene.frugal = false;
        if (status != SLT_OK) break;
        if (isfinite(one)) f->latest[v] = one;
        *loss += one / each;
        const double *all = joined(f, view);
        for (uint32_t i = 0; i < f->n; i++) f->gradient[i] += all[f->index[i]] / each;
    }
    if (f->opt.views_per_step && isfinite(*loss)) *loss = latest(f);
    return status;
}
