/* Peaks that no point has met, as exp(-r^2 / 1e-6): where bounds allow f far outside of what the lines have seen, the
 * boxes that allow most are cut, until f is as large in the middle of one, or bounds no longer allow it. Loose bounds
 * allow it in many boxes, and end the search. */
#include <math.h>
#include <string.h>

#include "runtime/sample/steep_inner.h"

enum {
    BOXES = 64,  /* at first, and that may stay at each level */
    LEVELS = 16, /* of cutting */
    COST = 2048  /* evaluations of bounds, where the first allow a peak */
};
#define EXCESS 1.0      /* of the range that was seen: by how much more f may be */
#define HEIGHT 0.5      /* of the excess: where a box is kept */
#define HIDDEN 0x1p-8   /* of the domain: the largest box around a peak that points are likely to miss */

typedef struct PeakBox {
    double lo[3], hi[3], most; /* most: the bound of f in the search's channel and direction */
} PeakBox;

typedef struct Search {
    SteepProbe *p;
    PeakBox box[BOXES << 3];
    uint32_t n, level, channel;
    double sign;   /* 1: above what was seen; -1: below */
    double limit;  /* what was seen, in that direction */
    double most;   /* of the bounds */
    uint64_t left; /* evaluations */
} Search;

static double range_of(const SteepProbe *p, uint32_t c) { return p->seen[c][1] - p->seen[c][0]; }

/* The bounds of all boxes. False: one is unknown, or they cost too much. */
static bool bound(Search *q) {
    SteepProbe *p = q->p;
    if (q->n > q->left) return false;
    q->left -= q->n;
    for (uint32_t i = 0; i < q->n; i++)
        for (uint32_t d = 0; d < p->s->dim; d++) {
            batch_set(&p->batch, SLT_IN_X0 + d, i, q->box[i].lo[d]);
            batch_set(&p->batch, SLT_IN_H0 + d, i, q->box[i].hi[d]);
        }
    batch_call(&p->batch, SLT_K_BOUNDS, q->n);
    if (!q->level) { /* the channel and direction that may exceed most */
        double best = -1;
        for (uint32_t c = 0; c < p->s->channels; c++)
            for (int side = 0; side < 2; side++) {
                double far = -HUGE_VAL, sign = side ? 1 : -1;
                for (uint32_t i = 0; i < q->n; i++)
                    far = fmax(far, sign * batch_get(&p->batch, side ? SLT_OUT_F_HI : SLT_OUT_F_LO, c, i));
                double excess = (far - sign * p->seen[c][side]) / (range_of(p, c) + 1e-3 * p->largest + 1e-30);
                if (isfinite(excess) && excess > best)
                    best = excess, q->channel = c, q->sign = sign, q->limit = sign * p->seen[c][side];
            }
        if (best < 0) return false;
    }
    q->most = -HUGE_VAL;
    for (uint32_t i = 0; i < q->n; i++) {
        PeakBox *b = &q->box[i];
        b->most = q->sign * batch_get(&p->batch, q->sign > 0 ? SLT_OUT_F_HI : SLT_OUT_F_LO, q->channel, i);
        if (!isfinite(b->most)) return false;
        q->most = fmax(q->most, b->most);
    }
    return q->most - q->limit > EXCESS * range_of(p, q->channel) + 1e-3 * p->largest;
}

/* Boxes that may hold what is nearly as large; false where they are too many. */
static bool keep(Search *q) {
    uint32_t kept = 0;
    for (uint32_t i = 0; i < q->n; i++)
        if (q->box[i].most > q->limit + HEIGHT * (q->most - q->limit)) q->box[kept++] = q->box[i];
    q->n = kept;
    return kept <= (q->level ? BOXES : BOXES / 4);
}

/* Is f as large in the middle of one? */
static bool reached(Search *q, double x[3], double *f) {
    SteepProbe *p = q->p;
    for (uint32_t i = 0; i < q->n; i++) {
        double middle[3];
        for (uint32_t d = 0; d < 3; d++) middle[d] = steep_round(p, 0.5 * (q->box[i].lo[d] + q->box[i].hi[d]));
        batch_set_x(&p->batch, i, middle);
        batch_set_stream(&p->batch, i, 0, 0.5);
    }
    steep_evaluate(p, q->n);
    uint32_t best = 0;
    for (uint32_t i = 1; i < q->n; i++)
        if (q->sign * steep_f(p, q->channel, i) > q->sign * steep_f(p, q->channel, best)) best = i;
    *f = steep_f(p, q->channel, best);
    for (uint32_t d = 0; d < 3; d++) x[d] = steep_round(p, 0.5 * (q->box[best].lo[d] + q->box[best].hi[d]));
    return q->sign * *f > q->limit + HEIGHT * (q->most - q->limit);
}

static void cut(Search *q) {
    const uint32_t dim = q->p->s->dim, n = q->n;
    for (uint32_t i = 0; i < n; i++) {
        const PeakBox whole = q->box[i];
        for (uint32_t part = 0; part < 1u << dim; part++) {
            PeakBox *b = part ? &q->box[q->n++] : &q->box[i];
            *b = whole;
            for (uint32_t d = 0; d < dim; d++)
                *(part >> d & 1 ? &b->lo[d] : &b->hi[d]) = steep_round(q->p, 0.5 * (whole.lo[d] + whole.hi[d]));
        }
    }
}

static void first_boxes(Search *q) {
    const SltScene *s = q->p->s;
    uint32_t across = s->dim == 1 ? BOXES : s->dim == 2 ? 8 : 4;
    for (q->n = 0; q->n < BOXES; q->n++) {
        PeakBox *b = &q->box[q->n];
        for (uint32_t d = 0, at = q->n; d < s->dim; d++, at /= across) {
            double side = (s->hi[d] - s->lo[d]) / across;
            b->lo[d] = steep_round(q->p, s->lo[d] + at % across * side);
            b->hi[d] = steep_round(q->p, s->lo[d] + (at % across + 1) * side);
        }
    }
}

bool steep_find_peak(SteepProbe *p, SteepPeak *peak) {
    Search q = {.p = p, .left = BOXES + COST};
    if (!p->s->kernel[SLT_K_BOUNDS] || p->s->uses_rand) return false;
    first_boxes(&q);
    for (; q.level < LEVELS; q.level++) {
        if (!bound(&q) || !keep(&q)) return false;
        if (reached(&q, peak->x, &peak->f)) break;
        cut(&q);
    }
    if (q.level == LEVELS) return false;
    double largest = 0;
    for (uint32_t d = 0; d < 3; d++) peak->lo[d] = HUGE_VAL, peak->hi[d] = -HUGE_VAL;
    for (uint32_t d = 0; d < p->s->dim; d++) {
        for (uint32_t i = 0; i < q.n; i++)
            peak->lo[d] = fmin(peak->lo[d], q.box[i].lo[d]), peak->hi[d] = fmax(peak->hi[d], q.box[i].hi[d]);
        largest = fmax(largest, (q.box[0].hi[d] - q.box[0].lo[d]) / (p->s->hi[d] - p->s->lo[d]));
    }
    peak->channel = q.channel, peak->over = q.sign * peak->f - q.limit;
    return largest <= HIDDEN;
}
