/* A loss that is a function of the shader, of a pixel's colour and its target's. A small program is made around it: the
 * source with two textures behind it, the image and its target, and an entry that loads both where it stands. The
 * derivative of its integral by the texels of the image is the adjoint image; that by parameters which the function
 * itself reads joins the gradient. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bindings/c/fit_inner.h"

enum { NAME_MAX_LENGTH = 200 };

static bool is_name(const char *text) {
    size_t n = strspn(text, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_");
    return n && !text[n] && n < NAME_MAX_LENGTH && (text[0] < '0' || text[0] > '9');
}

static const char *first_error(const SltProgram *p) {
    for (const Diag *d = p->session ? p->session->diags : NULL; d; d = d->next)
        if (d->severity == SEV_ERROR) return d->text;
    return p->error.text;
}

/* Images of every shape lie in textures of as many columns, and of rows enough. */
static void shape_of(const SltFit *f, uint32_t size[2]) {
    size[0] = f->job.size[0], size[1] = f->job.size[1] * f->job.size[2];
}

static uint32_t texels_of(const SltProgram *p, const char *name) {
    ParamRef at = {0};
    const char *why;
    program_find(p->prog, name, &at, &why);
    return at.fbase;
}

SltStatus fit_entry_begin(SltFit *f, const char *name, SltError *err) {
    EntryLoss *e = calloc(1, sizeof *e);
    uint32_t size[2], channels = slt_channels(f->p);
    char source[1024], type[24] = "float";
    if (!e) return fit_out_of_memory(err);
    f->entry = e;
    for (uint32_t v = 0; v < f->nviews; v++)
        if (slt_channels(f->views[v].p) != channels)
            return status_fail(err, SLT_USAGE, "the views of a loss `%s` want images of as many channels each", name);
    if (!is_name(name)) return status_fail(err, SLT_USAGE, "the loss `%.100s` is no name of a function", name);
    if (channels > 1) snprintf(type, sizeof type, "float%u", channels);
    shape_of(f, size);
    snprintf(source, sizeof source,
             "\nparam texture2D saltus_image = zeros(%u, %u, %u);\n"
             "[NoDiff] param texture2D saltus_target = zeros(%u, %u, %u);\n"
             "shader float saltus_loss(float2 saltus_at) {\n"
             "    %s image = saltus_image.load(pixel());\n    %s target = saltus_target.load(pixel());\n"
             "    return %s(image, target);\n}\n",
             size[0], size[1], channels, size[0], size[1], channels, type, type, name);
    SltStatus status = api_compile_beside(f->p, source, "saltus_loss", &e->share.p);
    if (status != SLT_OK) {
        if (status == SLT_LIMIT || !e->share.p) return fit_out_of_memory(err);
        return status_fail(err, SLT_USAGE, "the loss wants a function `float %s(%s image, %s target)`: %s", name, type,
                           type, first_error(e->share.p));
    }
    SltProgram *p = e->share.p;
    e->image = texels_of(p, "saltus_image"), e->target = texels_of(p, "saltus_target");
    status = fit_share_begin(&e->share, f->p, p, err);
    if (status != SLT_OK) return status;
    memset(p->wrt + e->image, 1, (size_t)size[0] * size[1] * channels);
    api_forget_gradients(p);
    e->gradient = calloc((size_t)slt_float_count(p) + 1, sizeof *e->gradient);
    e->each = calloc((size_t)size[0] * size[1] * 2, sizeof *e->each);
    return e->gradient && e->each ? SLT_OK : fit_out_of_memory(err);
}

/* The pixel's weight in a mean under its mask: the mean of its channels' weights. */
static float weight(const View *v, size_t pixel, uint32_t channels, size_t pixels) {
    double sum = 0;
    for (uint32_t c = 0; v->mask && c < channels; c++) sum += (double)v->mask[pixel * channels + c];
    return (float)((v->mask ? sum / channels : 1) / (double)pixels);
}

SltStatus fit_entry_loss(SltFit *f, const View *v, const float *image, double *loss, SltError *err) {
    EntryLoss *e = f->entry;
    SltProgram *p = e->share.p;
    uint32_t channels = slt_channels(f->p);
    SltJob job = SLT_JOB_INIT;
    shape_of(f, job.size);
    size_t pixels = (size_t)job.size[0] * job.size[1];
    float *value = e->each, *adjoint = e->each + pixels;
    job.centred = true, job.spp = 1, job.no_boundary = true, job.estimator = SLT_EST_LATTICE;
    job.threads = f->job.threads, job.cancel = f->job.cancel, job.seed = f->job.seed;
    fit_share_values(&e->share, f->p);
    for (size_t i = 0; i < pixels * channels; i++) {
        p->floats[e->image + i] = (double)image[i];
        p->floats[e->target + i] = (double)v->target[i];
    }
    api_params_changed(p, 0, slt_float_count(p));
    for (size_t i = 0; i < pixels; i++) adjoint[i] = weight(v, i, channels, pixels);
    SltStatus status = slt_render(p, &job, value, NULL, err);
    double sum = 0;
    for (size_t i = 0; status == SLT_OK && i < pixels; i++) sum += (double)value[i] * (double)adjoint[i];
    *loss = sum;
    if (status != SLT_OK || isnan(sum)) return status;
    status = slt_grad_adjoint(p, &job, adjoint, e->gradient, NULL, NULL, err);
    for (size_t i = 0; status == SLT_OK && i < pixels * channels; i++) f->adjoint[i] = (float)e->gradient[e->image + i];
    return status;
}

void fit_entry_free(SltFit *f) {
    if (!f->entry) return;
    slt_program_free(f->entry->share.p);
    free(f->entry->share.part);
    free(f->entry->gradient);
    free(f->entry->each);
    free(f->entry);
}
