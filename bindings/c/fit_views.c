/* The views of a fit: their targets, and the values that parameters have in one of them alone. */
#include <stdlib.h>
#include <string.h>

#include "bindings/c/fit_inner.h"

enum { MAX_VALUES = 1 << 28 }; /* floats of an image */

static bool drawn_by(const SltFit *f, const SltProgram *p, uint32_t before) {
    for (uint32_t v = 0; v < before; v++)
        if (f->views[v].share.p == p) return true;
    return false;
}

static void *copy_of(const void *from, size_t count, size_t size) {
    void *to = malloc((count + 1) * size);
    if (to && count) memcpy(to, from, count * size);
    return to;
}

/* Reads a value that a parameter has in one view, and puts the common value back. */
static SltStatus read_value(SltProgram *p, const SltSet *set, OwnValue *v, SltError *err) {
    SltStatus status = fit_find_param(p, set->name, "value of a view", &v->at, err);
    for (uint32_t i = 0; status == SLT_OK && i < v->at.fcount; i++)
        if (p->wrt[v->at.fbase + i])
            status =
                status_fail(err, SLT_INPUT, "`%s` is optimised; a view cannot give it a value of its own", set->name);
    if (status == SLT_OK) {
        v->floats = copy_of(p->floats + v->at.fbase, v->at.fcount, sizeof(double));
        v->ints = copy_of(p->ints + v->at.ibase, v->at.icount, sizeof(int32_t));
        if (!v->floats || !v->ints) return fit_out_of_memory(err);
        status = api_set_text(p, set->name, set->value, err);
    }
    if (status == SLT_OK) {
        for (uint32_t i = 0; i < v->at.fcount; i++) {
            double own = p->floats[v->at.fbase + i];
            p->floats[v->at.fbase + i] = v->floats[i], v->floats[i] = own;
        }
        for (uint32_t i = 0; i < v->at.icount; i++) {
            int32_t own = p->ints[v->at.ibase + i];
            p->ints[v->at.ibase + i] = v->ints[i], v->ints[i] = own;
        }
        api_params_changed(p, v->at.fbase, v->at.fcount);
    }
    /* A view's values are data, as a scene file is: a bad one is bad input. */
    if (status == SLT_USAGE) status = SLT_INPUT, err->status = SLT_INPUT;
    return status;
}

/* The program that draws the view, whose parameters follow the fit's from now on. */
static SltStatus read_program(SltFit *f, SltProgram *given, uint32_t index, View *v, SltError *err) {
    v->p = f->p;
    if (given && given != f->p) {
        if (!given->ready || slt_dim(given) != slt_dim(f->p))
            return status_fail(err, SLT_USAGE, "the program of view %u %s", index,
                               given->ready ? "is of another dimension" : "did not compile");
        if (atomic_load(&given->fitted) && !drawn_by(f, given, index))
            return status_fail(err, SLT_USAGE, "the program of view %u is part of another fit", index);
        v->p = given;
        atomic_store(&given->fitted, true);
        SltStatus status = fit_share_begin(&v->share, f->p, given, err);
        if (status != SLT_OK) return status;
        fit_share_values(&v->share, f->p);
    }
    v->size = slt_channels(v->p);
    for (uint32_t d = 0; d < slt_dim(v->p); d++) v->size *= f->job.size[d];
    if (v->size > MAX_VALUES) return status_fail(err, SLT_LIMIT, "view %u is larger than 2^28 values", index);
    if (v->size > f->nvalues) f->nvalues = v->size;
    return SLT_OK;
}

SltStatus fit_read_views(SltFit *f, SltError *err) {
    f->nviews = f->opt.minimize ? 0 : f->opt.nviews ? f->opt.nviews : 1;
    f->views = calloc(f->nviews + 1, sizeof *f->views);
    if (!f->views) return fit_out_of_memory(err);
    if (f->nviews && !f->opt.nviews) f->views[0].p = f->p, f->views[0].size = f->nvalues;
    const char *at = (const char *)f->opt.views;
    for (uint32_t i = 0; i < f->opt.nviews; i++, at += f->opt.views->struct_size) {
        SltFitView given = SLT_FIT_VIEW_INIT;
        if (!api_struct_read(&given, sizeof given, at)) return api_struct_unknown(err, "SltFitView");
        View *v = &f->views[i];
        *v = (View){.target = given.target, .mask = given.mask, .p = f->p};
        SltStatus status = read_program(f, given.program, i, v, err);
        if (status != SLT_OK) return status;
        if (!given.target && !f->opt.loss) return status_fail(err, SLT_USAGE, "view %u has no target", i);
        v->values = calloc(given.nvalues + 1, sizeof *v->values);
        if (!v->values) return fit_out_of_memory(err);
        while (v->nvalues < given.nvalues) {
            uint32_t k = v->nvalues++;
            status = read_value(v->p, &given.values[k], &v->values[k], err);
            if (status != SLT_OK) return status;
        }
    }
    return SLT_OK;
}

void fit_use_view(SltFit *f, const View *v, SltJob *job) {
    job->floats = NULL, job->ints = NULL;
    if (v->share.p) fit_share_values(&v->share, f->p);
    if (!v->nvalues) return;
    memcpy(f->own_floats, v->p->floats, program_floats(v->p->prog) * sizeof(double));
    memcpy(f->own_ints, v->p->ints, slt_int_count(v->p) * sizeof(int32_t));
    for (uint32_t k = 0; k < v->nvalues; k++) {
        const OwnValue *o = &v->values[k];
        memcpy(f->own_floats + o->at.fbase, o->floats, o->at.fcount * sizeof(double));
        memcpy(f->own_ints + o->at.ibase, o->ints, o->at.icount * sizeof(int32_t));
    }
    job->floats = f->own_floats, job->ints = f->own_ints;
}
void fit_free_views(SltFit *f) {
    for (uint32_t v = 0; f->views && v < f->nviews; v++) {
        for (uint32_t k = 0; k < f->views[v].nvalues; k++)
            free(f->views[v].values[k].floats), free(f->views[v].values[k].ints);
        free(f->views[v].values);
        if (f->views[v].share.p) atomic_store(&f->views[v].share.p->fitted, false);
        free(f->views[v].share.part);
    }
    free(f->views);
}
