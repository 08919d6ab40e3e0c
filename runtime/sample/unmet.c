/* Things so small that no line meets them, as a disc of 1e-6: of a site that has no crossing at all bounds say where it
 * may decide either way, and the boxes where it may are cut until they are many beside what is small, or none is left.
 * There lines of their own are sent. A site that bounds leave open in too many boxes is given up. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/boundary.h"

enum {
    FIRST = 64,  /* boxes to begin with */
    MOST = 128,  /* that may be open at any time */
    ENOUGH = 16, /* around one small thing */
    LEVELS = 40, /* of halving */
    LINES = 6
};

typedef struct Search {
    const Run *r;
    Batch batch;
    Window box[MOST << 3];
    uint32_t n;
} Search;

static double round_to(const SltScene *s, double x) { return s->f64 ? x : (double)(float)x; }

static void first_boxes(Search *q) {
    const SltScene *s = q->r->s;
    uint32_t across = s->dim == 1 ? FIRST : s->dim == 2 ? 8 : 4;
    for (q->n = 0; q->n < FIRST; q->n++)
        for (uint32_t d = 0, at = q->n; d < s->dim; d++, at /= across) {
            double side = (s->hi[d] - s->lo[d]) / across;
            q->box[q->n].lo[d] = round_to(s, s->lo[d] + at % across * side);
            q->box[q->n].hi[d] = round_to(s, s->lo[d] + (at % across + 1) * side);
        }
}

/* May a site decide either way there that no line has met? */
static bool is_open(const Search *q, uint32_t lane) {
    const Batch *b = &q->batch;
    uint32_t named = scene_outputs(q->r->s, SLT_K_BOUNDS, SLT_OUT_OPEN_EDGE), open = batch_open(b, lane);
    for (uint32_t e = 0; e < named && e < open; e++) {
        int32_t edge = batch_get_int(b, SLT_OUT_OPEN_EDGE, e, lane);
        if (edge >= 0 && (uint32_t)edge < q->r->s->nsites && !q->r->met[edge]) return true;
    }
    return open > named; /* who knows which */
}

/* False: too many, or nothing is known of one. */
static bool keep_open(Search *q) {
    Batch *b = &q->batch;
    uint32_t kept = 0;
    for (uint32_t i = 0; i < q->n; i++)
        for (uint32_t d = 0; d < q->r->s->dim; d++) {
            batch_set(b, SLT_IN_X0 + d, i, q->box[i].lo[d]);
            batch_set(b, SLT_IN_H0 + d, i, q->box[i].hi[d]);
        }
    batch_call(b, SLT_K_BOUNDS, q->n);
    for (uint32_t i = 0; i < q->n; i++) {
        if (batch_get_int(b, SLT_OUT_BOX_STATE, 0, i) & SLT_BOX_UNKNOWN) return false;
        if (is_open(q, i)) q->box[kept++] = q->box[i];
    }
    q->n = kept;
    return kept <= MOST;
}

static void halve(Search *q) {
    const SltScene *s = q->r->s;
    const uint32_t n = q->n;
    for (uint32_t i = 0; i < n; i++) {
        const Window whole = q->box[i];
        for (uint32_t part = 0; part < 1u << s->dim; part++) {
            Window *b = part ? &q->box[q->n++] : &q->box[i];
            *b = whole;
            for (uint32_t d = 0; d < s->dim; d++)
                *(part >> d & 1 ? &b->lo[d] : &b->hi[d]) = round_to(s, 0.5 * (whole.lo[d] + whole.hi[d]));
        }
    }
}

/* Boxes around what is small; false: there is nothing, or it is not found. */
static bool find(Search *q, double spacing) {
    const SltScene *s = q->r->s;
    first_boxes(q);
    for (uint32_t level = 0; level < LEVELS; level++) {
        if (!keep_open(q) || !q->n) return false;
        if (q->n >= ENOUGH && (q->box[0].hi[0] - q->box[0].lo[0]) / (s->hi[0] - s->lo[0]) < spacing) return true;
        halve(q);
    }
    return false;
}

SltStatus unmet_add(Run *r, const Boundary *of, double *missed, double *error) {
    const SltScene *s = r->s;
    uint64_t size = (uint64_t)s->channels * s->nfloats;
    Search *q = calloc(1, sizeof *q);
    double *sum = alloc_zero(3 * size, sizeof *sum), crossings;
    SltStatus st = SLT_OK;
    bool memory = q && sum && batch_init(&q->batch, s, &r->grid), found = false;
    if (memory) {
        q->r = r;
        found = find(q, pow(of->segments / s->dim, -1.0 / s->dim));
        batch_collect(&q->batch, &r->stats);
    } else st = status_fail(r->err, SLT_LIMIT, "out of memory");
    if (found) {
        Windows windows = {.n = q->n, .lines = LINES, .vertices = LINES, .at = q->box};
        Boundary y = *of;
        y.windows = &windows;
        st = windows_run(r, &y, sum, &crossings);
    }
    for (uint64_t i = 0; i < size && found && st == SLT_OK; i++) {
        error[i] += fabs(sum[i]);
        if (missed) missed[i] += sum[i];
    }
    if (q) batch_free(&q->batch);
    free(q), free(sum);
    return st;
}
