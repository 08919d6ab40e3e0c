/* Parts of segments between alike ends: settled, halved, or given up. */
#include <assert.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>

#include "runtime/sample/prove.h"
#include "runtime/sample/search.h"

bool prove_only_shadows(const SltScene *s) {
    bool shadows = false;
    for (uint32_t i = 0; i < s->nsites; i++) {
        if (s->site_kind[i] == SLT_SITE_SILHOUETTE ||
            (s->site_kind[i] >= SLT_SITE_MESH && s->site_kind[i] < SLT_SITE_MESH_HIT))
            return false;
        shadows |= s->site_kind[i] == SLT_SITE_SHADOW || s->site_kind[i] == SLT_SITE_MESH_HIT ||
                   s->site_kind[i] == SLT_SITE_MESH_SHADOW;
    }
    return shadows;
}

bool prove_serves(const SltScene *s) { return prove_only_shadows(s) && s->kernel[SLT_K_BOUNDS]; }

bool prove_is_settled(const Batch *b, uint32_t i) {
    if (batch_get_int(b, SLT_OUT_BOX_STATE, 0, i) & SLT_BOX_UNKNOWN) return false;
    if (!batch_open(b, i)) return true;
    /* Seams bend f, or jump where nothing is integrated. Are they all that is open? */
    uint32_t named = b->layout->out[SLT_OUT_OPEN_EDGE].count, n = 0;
    for (; n < named; n++) {
        int32_t edge = batch_get_int(b, SLT_OUT_OPEN_EDGE, n, i);
        if (edge < 0) return true;
        if ((uint32_t)edge < b->s->nsites) return false;
    }
    return batch_open(b, i) <= (int32_t)named;
}

void prove_set_box(Batch *b, uint32_t i, const Segment *s, double ta, double tb) {
    double lo[3], hi[3];
    segment_at(s, ta, lo), segment_at(s, tb, hi);
    for (uint32_t d = 0; d < b->s->dim; d++) {
        batch_set(b, SLT_IN_X0 + d, i, search_lesser(lo[d], hi[d]));
        batch_set(b, SLT_IN_H0 + d, i, search_greater(lo[d], hi[d]));
    }
}

void prove_add(Finder *f, const Segment *s, double ta, double tb, Mark a, Mark b) {
    if (f->nalike == f->alike_cap) {
        uint32_t cap = f->alike_cap ? 2 * f->alike_cap : 8 * BATCH;
        Segment *more = realloc(f->alike, cap * sizeof *more);
        if (!more) {
            f->failed = true;
            return;
        }
        f->alike = more, f->alike_cap = cap;
    }
    Segment *part = &f->alike[f->nalike++];
    *part = *s;
    part->ta = ta, part->tb = tb, part->ma = a, part->mb = b, part->cut = 0, part->event_threshold = 0;
    part->state = SEARCH_ROOT, part->hidden = true;
}

/* The least part of this segment: PROVE_LEAST, or a few units in the last place of the position. Beside a crossing no
 * less than roots are known to. */
static double least(const Finder *f, const Segment *s) {
    double len = 0, mag = 0;
    for (uint32_t d = 0; d < f->s->dim; d++) {
        len = search_greater(len, fabs(s->b[d] - s->a[d]));
        mag = search_greater(mag, search_greater(fabs(s->a[d]), fabs(s->b[d])));
    }
    double usual = !f->finest ? PROVE_LEAST : s->touches ? root_tolerance(f->coarse) : 0;
    return fmax(usual, 8 * (f->s->f64 ? DBL_EPSILON : (double)FLT_EPSILON) * mag / len);
}

/* Touching a crossing, a part is not settled: the box is that of its far half. */
static void box_of(const Segment *s, double *ta, double *tb) {
    double mid = 0.5 * (s->ta + s->tb);
    *ta = s->touches == TOUCH_A ? mid : s->ta;
    *tb = s->touches == TOUCH_B ? mid : s->tb;
}

/* The parts part[0..n), which bounds leave open, are halved. */
static void halve(Finder *f, Segment *part, uint32_t n) {
    Batch *b = f->b;
    for (uint32_t i = 0; i < n; i++) {
        double x[3];
        segment_at(&part[i], 0.5 * (part[i].ta + part[i].tb), x);
        batch_set_x(b, i, x);
        batch_set_stream(b, i, part[i].stream, part[i].rand0);
    }
    batch_call(b, SLT_K_REGION, n);
    for (uint32_t i = 0; i < n; i++) {
        Segment *s = &part[i];
        uint8_t touches = s->touches;
        double ta = s->ta, tb = s->tb, mid = 0.5 * (ta + tb);
        Mark a = s->ma, e = s->mb, m = batch_mark(b, i);
        /* What the last halving finds is about what the next ones would. */
        if (f->prove_classes) s->cls = mid - ta <= least(f, s);
        s->fine = f->finest; /* what it holds may be as narrow as the part */
        s->touches = touches & TOUCH_B;
        search_push(f, s, mid, tb, m, e, SEARCH_ROOT);
        s->touches = touches & TOUCH_A;
        search_push(f, s, ta, mid, a, m, SEARCH_ROOT);
    }
}

static void give_up(Finder *f, const Segment *s) {
    f->unproven++;
    if (f->open && !s->touches) f->open[s->owner] = true;
}

void prove_run(Finder *f, bool all) {
    enum { PLACE_BITS = 16 }; /* are left out: 256 columns and rows are enough for boxes to lie side by side */
    Batch *b = f->b;
    Segment part[FIND];
    uint64_t key[FIND];
    double end[FIND][2];
    uint32_t place[FIND];
    while (f->nalike && !f->failed && (all || f->nalike >= FIND)) {
        uint32_t n = f->nalike < FIND ? f->nalike : FIND, kept = 0, open = 0;
        f->nalike -= n;
        if (f->finest && f->prove_boxes < n) { /* there are none to spare */
            for (uint32_t i = 0; i < n; i++) give_up(f, &f->alike[f->nalike + i]);
            continue;
        }
        f->prove_boxes -= f->finest ? n : 0;
        for (uint32_t i = 0; i < n; i++) {
            const Segment *s = &f->alike[f->nalike + i];
            double ta, tb;
            if (s->touches && s->tb - s->ta <= least(f, s)) {
                f->unproven++;
                continue;
            }
            part[kept] = *s;
            box_of(s, &ta, &tb);
            end[kept][0] = ta, end[kept][1] = tb;
            double mid[3];
            segment_at(s, 0.5 * (ta + tb), mid);
            key[kept] = (uint64_t)(window_place(f->s, mid) >> PLACE_BITS) << 32 | kept;
            kept++;
        }
        sort_keys(key, kept);
        for (uint32_t i = 0; i < kept; i++) {
            const uint32_t k = (uint32_t)key[i];
            place[k] = i;
            prove_set_box(b, i, &part[k], end[k][0], end[k][1]);
        }
        if (kept) batch_call(b, SLT_K_BOUNDS, kept);
        for (uint32_t i = 0; i < kept; i++) {
            Segment *s = &part[i];
            double mid = 0.5 * (s->ta + s->tb);
            bool settled = prove_is_settled(b, place[i]);
            if (settled && s->touches == TOUCH_A) prove_add(f, s, s->ta, mid, s->ma, s->mb);
            else if (settled && s->touches == TOUCH_B) prove_add(f, s, mid, s->tb, s->ma, s->mb);
            else if (settled) continue;
            else if (s->tb - s->ta > least(f, s)) part[open++] = *s;
            else give_up(f, s);
        }
        if (open) halve(f, part, open);
    }
}
