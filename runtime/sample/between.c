/* What lines step over between two vertices, however thin: a few lines of their own are cut by bounds until nothing is
 * open on their parts (prove.h). What they meet between vertices that look alike, beside what a probe would have found
 * there, is what all lines miss. Crossings between vertices that differ are found as well, for beside them more may
 * hide; but all lines find those, and here nobody asks what they weigh. */
#include <math.h>
#include <stdlib.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/boundary.h"

enum { FEWEST = 12, MOST = 4096 /* vertices */, BOXES = 3 /* for each vertex, and */, BOXES_LEAST = 4096 };
#define COST 0.02 /* of the vertices of all lines */
#define SURE 2.0  /* where some were found along fingers: how many standard deviations the others are */

static double vertices_of(const SltScene *s, const Boundary *of) {
    return floor(pow(of->segments / s->dim, 1.0 / s->dim));
}

bool between_serves(const SltScene *s, const Boundary *of) {
    return s->dim > 1 && !s->ngeometries && !s->uses_rand && s->kernel[SLT_K_BOUNDS] && vertices_of(s, of) >= 2;
}

SltStatus between_find(Run *r, const Boundary *of, uint32_t replicates, Between *b) {
    const SltScene *s = r->s;
    uint64_t size = (uint64_t)s->channels * s->nfloats;
    double vertices = vertices_of(s, of);
    double lines = COST * of->segments / s->dim * replicates / (s->dim * fmax(vertices, 1));
    lines = pow(fmax(lines, FEWEST), 1.0 / (s->dim - 1));
    Windows windows = {.n = 1, .lines = (uint32_t)ceil(lines), .vertices = (uint32_t)fmin(vertices, MOST)};
    for (uint32_t d = 0; d < s->dim; d++) windows.side[d] = s->hi[d] - s->lo[d];
    *b = (Between){
        .lines = windows.lines, .vertices = vertices, .probes = scene_outputs(s, SLT_K_REGION, SLT_OUT_NEAR_SITE) > 0};
    b->sum = alloc_dense((b->probes ? 6 : 3) * size, sizeof *b->sum);
    if (!b->sum) return status_fail(r->err, SLT_LIMIT, "out of memory");
    SltStatus st = SLT_OK;
    for (uint32_t cut = !b->probes; cut < 2 && st == SLT_OK; cut++) {
        Boundary y = *of;
        y.windows = &windows, y.only_hidden = true;
        if (cut) y.boxes = BOXES_LEAST + BOXES * s->dim * (uint64_t)(pow(windows.lines, s->dim - 1) * vertices);
        st = windows_run(r, &y, b->sum + (cut && b->probes ? 3 * size : 0), &b->found[cut]);
    }
    return st;
}

void between_add(const SltScene *s, const Between *b, double *missed, double *error) {
    uint64_t size = (uint64_t)s->channels * s->nfloats;
    /* What is found along fingers no line of its own would have met: as many of theirs, but for chance. */
    double met = b->found[1] - b->found[0], known = s->followed ? *s->followed * b->lines / b->vertices : 0,
           part = met > 0 && met - known > (known > 0 ? SURE * sqrt(met) : 0) ? (met - known) / met : 0;
    for (uint64_t i = 0; i < size && part > 0; i++) {
        double more = part * (b->probes ? b->sum[3 * size + i] - b->sum[i] : b->sum[i]);
        double told = missed ? fabs(missed[i]) : 0;
        if (fabs(more) <= told) continue;
        error[i] += fabs(more) - told;
        if (missed) missed[i] = more;
    }
}
