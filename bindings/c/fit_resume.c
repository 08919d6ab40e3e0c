/* Checkpoints of a fit: the losses so far go with the optimiser's state, and behind them, where each step draws some
 * views only, the last loss of every view. */
#include <stdlib.h>
#include <string.h>

#include "bindings/c/fit_inner.h"

static uint32_t mix_double(uint32_t h, double v) {
    uint32_t words[2];
    memcpy(words, &v, sizeof words);
    return ir_mix(ir_mix(h, words[0]), words[1]);
}

/* The code of a program and its fixed parameters; the code is written into the scratch memory of the session s. */
static uint32_t hash_program(uint32_t h, const SltProgram *p, Session *s) {
    ArenaMark mark = arena_mark(&s->scratch);
    for (const char *c = ir_print_string(p->prog->primal, &s->scratch); *c; c++) h = ir_mix(h, (uint8_t)*c);
    arena_reset(&s->scratch, mark);
    for (uint32_t i = 0; i < program_floats(p->prog); i++)
        if (!p->wrt[i]) h = mix_double(h, p->floats[i]);
    for (uint32_t i = 0; i < p->prog->nints; i++) h = ir_mix(h, (uint32_t)p->ints[i]);
    return h;
}

/* The key of a checkpoint: a hash of the programs, targets, masks, values of the views and what the loss
 * is. */
static void hash_problem(Session *s, void *arg) {
    SltFit *f = arg;
    uint32_t h = hash_program(1, f->p, s);
    if (f->entry) h = hash_program(h, f->entry->share.p, s);
    h = ir_mix(h, f->job.no_interior | f->job.no_boundary << 1 | (f->opt.loss != NULL) << 2 | f->opt.minimize << 3);
    for (uint32_t v = 0; v < f->nviews; v++) {
        const View *view = &f->views[v];
        if (view->share.p) h = hash_program(h, view->p, s);
        for (size_t i = 0; view->mask && i < view->size; i++) h = mix_double(h, (double)view->mask[i]);
        for (size_t i = 0; view->target && i < view->size; i++) {
            uint32_t bits;
            memcpy(&bits, &view->target[i], sizeof bits);
            h = ir_mix(h, bits);
        }
        for (uint32_t k = 0; k < view->nvalues; k++) {
            const OwnValue *o = &view->values[k];
            for (uint32_t i = 0; i < o->at.fcount; i++) h = mix_double(h, o->floats[i]);
            for (uint32_t i = 0; i < o->at.icount; i++) h = ir_mix(h, (uint32_t)o->ints[i]);
        }
    }
    if (f->opt.metric != SLT_FIT_L2) h = ir_mix(h, f->opt.metric);
    if (f->opt.metric == SLT_FIT_HUBER) h = mix_double(h, f->opt.huber_delta);
    if (f->opt.views_per_step) h = ir_mix(h, f->opt.views_per_step);
    if (f->opt.schedule) h = mix_double(ir_mix(h, f->opt.schedule), f->opt.decay);
    if (f->opt.schedule == SLT_FIT_COSINE) h = ir_mix(h, f->opt.planned);
    if (f->opt.first) h = ir_mix(h, f->opt.first);
    for (const char *c = f->opt.loss ? f->opt.loss_name : NULL; c && *c; c++) h = ir_mix(h, (uint8_t)*c);
    snprintf(f->key, sizeof f->key,
             "saltus fit %08x %ux%u spp %u samples %llu segments %llu seed %u filter %d estimator %d optimizer %s", h,
             f->job.size[0], f->job.size[1], f->job.spp, (unsigned long long)f->job.samples,
             (unsigned long long)f->job.segments, f->job.seed, (int)f->job.filter, (int)f->job.estimator,
             optimise_name(f->method));
}

SltStatus fit_prepare_checkpoint(SltFit *f, SltError *err) {
    const SltFitOptions *o = &f->opt;
    if (!o->checkpoint && !o->resume) return SLT_OK;
    int unwound = session_protect(f->p->session, hash_problem, f);
    if (unwound) return status_fail(err, (SltStatus)unwound, "%s", f->p->session->unwind_text);
    if (o->checkpoint && !(f->checkpoint = strdup(o->checkpoint))) return fit_out_of_memory(err);
    if (!o->resume) return SLT_OK;
    double *numbers = NULL;
    size_t size = 0, behind = f->opt.views_per_step ? f->nviews : 0;
    SltStatus status = optimise_load(f->optimiser, o->resume, f->key, (void **)&numbers, &size, err);
    if (status != SLT_OK) return status;
    if (size < behind * sizeof *numbers) status = status_fail(err, SLT_INPUT, "cannot resume from '%s'", o->resume);
    else f->iteration = (uint32_t)(size / sizeof *numbers - behind);
    if (status == SLT_OK && !fit_room_for_losses(f, f->iteration + behind)) status = fit_out_of_memory(err);
    if (status == SLT_OK && f->iteration) memcpy(f->losses, numbers, f->iteration * sizeof *numbers);
    if (status == SLT_OK && behind) memcpy(f->latest, numbers + f->iteration, behind * sizeof *numbers);
    free(numbers);
    return status;
}

SltStatus fit_save(SltFit *f, SltError *err) {
    if (!f->checkpoint || f->unsaved) return SLT_OK;
    size_t behind = f->opt.views_per_step ? f->nviews : 0, size = (f->iteration + behind) * sizeof *f->losses;
    if (!fit_room_for_losses(f, f->iteration + behind)) return fit_out_of_memory(err);
    if (behind) memcpy(f->losses + f->iteration, f->latest, behind * sizeof *f->latest);
    SltStatus status = optimise_save(f->optimiser, f->checkpoint, f->key, f->losses, size, err);
    f->unsaved = status != SLT_OK;
    return status;
}
