/* Things so small that no line meets them, as a disc of 1e-6: of a site that has no crossing at all bounds say where it
 * may decide either way, and the boxes where it may are cut until they are many beside what is small, or none is left.
 * There lines of their own are sent. A site that bounds leave open in too many boxes is given up. What stays open in a
 * few boxes down to the least, as a disc of 1e-40 does, no line meets there either: it may have as much boundary as
 * their faces, and is taken to move by as much as a parameter does. Where bounds are loose at a point, that adds next
 * to nothing. */
#include <float.h>
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

#define TINY 0x1p-8 /* side by side too many boxes are still no more of the domain's side */

typedef struct Search {
    const Run *r;
    Batch batch;
    Window box[MOST << 3];
    uint32_t n;
    double face[SLT_MAX_CHANNELS]; /* range of f in the open boxes times the measure of their faces */
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

static void add_faces(Search *q, uint32_t lane) {
    const Batch *b = &q->batch;
    const Window *box = &q->box[lane];
    double faces = 0;
    for (uint32_t d = 0; d < q->r->s->dim; d++) {
        double face = 1;
        for (uint32_t e = 0; e < q->r->s->dim; e++) face *= e == d ? 1 : box->hi[e] - box->lo[e];
        faces += face;
    }
    for (uint32_t c = 0; c < q->r->s->channels; c++) {
        double range = batch_get(b, SLT_OUT_F_HI, c, lane) - batch_get(b, SLT_OUT_F_LO, c, lane);
        q->face[c] += faces * (isnan(range) ? HUGE_VAL : range);
    }
}

/* False: nothing is known of one. */
static bool keep_open(Search *q) {
    Batch *b = &q->batch;
    uint32_t kept = 0;
    for (uint32_t i = 0; i < q->n; i++)
        for (uint32_t d = 0; d < q->r->s->dim; d++) {
            batch_set(b, SLT_IN_X0 + d, i, q->box[i].lo[d]);
            batch_set(b, SLT_IN_H0 + d, i, q->box[i].hi[d]);
        }
    batch_call(b, SLT_K_BOUNDS, q->n);
    memset(q->face, 0, sizeof q->face);
    for (uint32_t i = 0; i < q->n; i++) {
        if (batch_get_int(b, SLT_OUT_BOX_STATE, 0, i) & SLT_BOX_UNKNOWN) return false;
        if (!is_open(q, i)) continue;
        add_faces(q, i);
        q->box[kept++] = q->box[i];
    }
    q->n = kept;
    return true;
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

/* Are boxes a few floats wide, or will be after another halving? */
static bool is_least(const Search *q) {
    const SltScene *s = q->r->s;
    for (uint32_t i = 0; i < q->n; i++)
        for (uint32_t d = 0; d < s->dim; d++) {
            const Window *b = &q->box[i];
            double far = fmax(fabs(b->lo[d]), fabs(b->hi[d])),
                   ulp = fmax(s->f64 ? DBL_EPSILON * far : (double)FLT_EPSILON * far, s->f64 ? 0x1p-1074 : 0x1p-149);
            if (b->hi[d] - b->lo[d] < 4 * ulp) return true;
        }
    return false;
}

typedef enum Found {
    NOTHING, /* or too much, or the search has ended */
    BOXES,   /* around something small */
    POINTS   /* boxes that cannot be halved any more, or need not be */
} Found;

/* Goes on with the boxes of q, from *level, until at least so many are around what is small. */
static Found find(Search *q, double spacing, uint32_t enough, uint32_t *level) {
    const SltScene *s = q->r->s;
    for (; *level < LEVELS; ++*level) {
        bool known = keep_open(q);
        double side = (q->box[0].hi[0] - q->box[0].lo[0]) / (s->hi[0] - s->lo[0]);
        if (!q->n) return NOTHING;
        if (!known || q->n > MOST) return known && enough > ENOUGH && q->n * side < TINY ? POINTS : NOTHING;
        bool small = side < spacing;
        if (q->n >= enough && small) return BOXES;
        if (*level + 1 == LEVELS || is_least(q)) return small ? POINTS : NOTHING;
        halve(q);
    }
    return NOTHING;
}

SltStatus unmet_add(Run *r, const Boundary *of, double *missed, double *error) {
    const SltScene *s = r->s;
    uint64_t size = (uint64_t)s->channels * s->nfloats;
    Search *q = calloc(1, sizeof *q);
    double *sum = alloc_zero(3 * size, sizeof *sum), crossings;
    SltStatus st = SLT_OK;
    bool memory = q && sum && batch_init(&q->batch, s, &r->grid);
    Found found = NOTHING;
    if (!memory) st = status_fail(r->err, SLT_LIMIT, "out of memory");
    if (memory) q->r = r, first_boxes(q);
    for (uint32_t enough = ENOUGH, level = 0; st == SLT_OK; level++) {
        found = find(q, pow(of->segments / s->dim, -1.0 / s->dim), enough, &level);
        if (found != BOXES) break;
        Windows windows = {.n = q->n, .lines = LINES, .vertices = LINES, .at = q->box};
        Boundary y = *of;
        y.windows = &windows;
        memset(sum, 0, 3 * size * sizeof *sum);
        st = windows_run(r, &y, sum, &crossings);
        if (crossings > 0) break;
        enough = 2 * q->n;
        halve(q); /* as many specks, each smaller than its boxes */
    }
    for (uint64_t i = 0; i < size && found != NOTHING && st == SLT_OK; i++) {
        bool moves = !s->active || s->active[i % s->nfloats];
        error[i] += found == BOXES ? fabs(sum[i]) : moves ? q->face[i / s->nfloats] : 0;
        if (missed && found == BOXES) missed[i] += sum[i];
    }
    if (memory) batch_collect(&q->batch, &r->stats);
    if (q) batch_free(&q->batch);
    free(q), free(sum);
    return st;
}
