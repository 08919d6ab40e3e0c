/* What lines have not met, after them: things so small that none came near (unmet.c), and what they step over
 * (between.c). The second needs nothing of what they find, so another thread may look for it while they run: by few
 * lines, one after another, which threads could not share. */
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/boundary.h"

enum { REPLICATES = 4 };

struct SltHidden {
    const SltScene *s;
    SltJob j;
    Between between;
    SltStatus status;
    SltError err;
    uint64_t evaluations;
};

bool slt_estimate_by_lines(const SltScene *s) { return s->met && s->nsites && s->met[s->nsites] && !s->uses_rand; }

bool slt_estimate_has_unmet(const SltScene *s) { return slt_estimate_by_lines(s) && memchr(s->met, 0, s->nsites); }

static Boundary lines_of(Run *r, const SltJob *j) {
    return (Boundary){.run = r, .segments = boundary_segments(j) / REPLICATES, .classes = 1};
}

static bool looks_between(const SltScene *s, const SltJob *j) {
    const Boundary of = lines_of(NULL, j);
    return !j->max_evaluations && between_serves(s, &of); /* a number that is given is obeyed */
}

void slt_estimate_hidden_look(SltHidden *h) {
    Run r;
    h->status = run_begin(&r, h->s, &h->j, &h->err);
    const Boundary of = lines_of(&r, &h->j);
    if (h->status == SLT_OK) h->status = between_find(&r, &of, REPLICATES, &h->between);
    SltStats own = SLT_STATS_INIT;
    run_end(&r, &own);
    h->evaluations = own.evaluations;
}

SltHidden *slt_estimate_hidden_new(const SltScene *s, const SltJob *j) {
    enum { MOST = 1 << 20 }; /* derivatives: what this takes beside the lines is memory that they take, too */
    const bool lines = j->estimator == SLT_EST_LATTICE && !s->pixelwise && s->nsites,
               few = (uint64_t)s->channels * s->nfloats <= MOST, made = s->kernel[SLT_K_BOUNDS] != slt_kernel_late;
    SltHidden of = {.s = s, .j = *j};
    of.j.integral = true, of.j.progress = NULL; /* which is that of the lines */
    SltHidden *h = lines && few && made && looks_between(s, &of.j) ? malloc(sizeof *h) : NULL;
    if (h) *h = of;
    return h;
}

void slt_estimate_hidden_free(SltHidden *h) {
    if (h) free(h->between.sum), free(h);
}

/* Small things. */
static SltStatus add_unmet(const SltScene *s, const SltJob *j, SltIntegral *out, SltStats *stats, SltError *err) {
    Run r;
    SltStatus st = run_begin(&r, s, j, err);
    const Boundary of = lines_of(&r, j);
    r.met = s->met;
    if (st == SLT_OK) st = unmet_add(&r, &of, out->missed_estimate, out->gradient_stderr);
    SltStats own = SLT_STATS_INIT;
    run_end(&r, &own);
    if (stats) stats->evaluations += own.evaluations; /* all else is as it was */
    return st;
}

SltStatus slt_estimate_hidden(const SltScene *s, const SltJob *job, const SltHidden *seen, SltIntegral *out,
                              SltStats *stats, SltError *err) {
    SltHidden own = {.s = s, .j = *job};
    SltStatus st = SLT_OK;
    own.j.integral = true;
    if (!slt_estimate_by_lines(s) || !out->gradient_stderr || !s->kernel[SLT_K_BOUNDS]) return SLT_OK;
    if (slt_estimate_has_unmet(s)) st = add_unmet(s, &own.j, out, stats, err);
    if (st != SLT_OK) return st;
    if (!seen && looks_between(s, &own.j)) slt_estimate_hidden_look(&own);
    const SltHidden *h = seen ? seen : &own;
    if (h->status == SLT_OK && h->between.sum) between_add(s, &h->between, out->missed_estimate, out->gradient_stderr);
    else if (h->status != SLT_OK && err) *err = h->err;
    if (stats) stats->evaluations += h->evaluations;
    free(own.between.sum);
    return h->status;
}
