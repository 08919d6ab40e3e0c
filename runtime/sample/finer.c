/* Do the lines of an integral resolve what they meet? Where a shader repeats something as often as lines have vertices,
 * or is noise, a segment holds several crossings, of which one is found or none, and lines of one spacing know nothing
 * of it: their replicates agree. So lines eight times finer look at a few places, and how many more crossings they meet
 * is what all others miss. It has to be half as many again, since features that are too narrow here and there have
 * their own estimate (thin.h). */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/boundary.h"

enum { WINDOWS = 24, SEGMENTS = 16, FINER = 8, FEWEST = 8 /* crossings more, at least */ };
#define COST 0.02 /* of the vertices of all lines, at most */

SltStatus windows_run(Run *r, Boundary *y, double *sum, double *crossings) {
    double *targets[3 * SLT_MAX_CHANNELS];
    for (uint32_t c = 0; c < 3 * r->s->channels; c++) targets[c] = sum + (uint64_t)c * r->s->nfloats;
    y->targets = targets, y->replicates = 1;
    Sizes kept = r->kept, gone = r->gone;
    double along[SLT_MAX_CHANNELS], parts = r->parts_gone;
    memcpy(along, r->gone_along, sizeof along);
    SltStats before = r->stats;
    r->kept = (Sizes){0};
    SltStatus st = boundary_run(y, SINK_INTEGRAL);
    *crossings = (double)r->kept.n;
    before.evaluations = r->stats.evaluations;
    r->stats = before, r->kept = kept, r->gone = gone, r->parts_gone = parts;
    memcpy(r->gone_along, along, sizeof along);
    return st;
}

static SltStatus count(Run *r, Boundary *y, double *crossings) {
    double *sum = alloc_zero(3ull * r->s->channels * r->s->nfloats, sizeof *sum);
    if (!sum) return status_fail(r->err, SLT_LIMIT, "out of memory");
    SltStatus st = windows_run(r, y, sum, crossings);
    free(sum);
    return st;
}

SltStatus finer_missed(Run *r, const Boundary *of, uint32_t replicates, double *missed) {
    const SltScene *s = r->s;
    double per_axis = floor(pow(of->segments / s->dim, 1.0 / s->dim));
    *missed = 0;
    /* One line is all there is in 1D, and finer than anybody asks. Of terrain slopes say what to look for. */
    if (s->dim == 1 || s->uses_rand || scene_outputs(s, SLT_K_REGION, SLT_OUT_DEPTH) || per_axis < SEGMENTS)
        return SLT_OK;
    double vertices = of->segments / s->dim * replicates, most = COST * vertices / (s->dim * SEGMENTS * (1 + FINER));
    Windows windows = {.n = (uint32_t)fmin(WINDOWS, most), .lines = 1};
    if (!windows.n || replicates < 2) return SLT_OK; /* of one replicate no error is known */
    for (uint32_t d = 0; d < s->dim; d++) windows.side[d] = (s->hi[d] - s->lo[d]) * SEGMENTS / per_axis;
    Boundary y = *of;
    y.windows = &windows, y.any_sign = true;
    double found[2];
    for (int fine = 0; fine < 2; fine++) {
        windows.vertices = SEGMENTS * (fine ? FINER : 1);
        SltStatus st = count(r, &y, &found[fine]);
        if (st != SLT_OK) return st;
    }
    double more = found[1] - found[0], windows_of_all = of->segments / s->dim / SEGMENTS * replicates;
    if (more > fmax(FEWEST, 0.5 * found[0])) *missed = more / windows.n * windows_of_all;
    return SLT_OK;
}
