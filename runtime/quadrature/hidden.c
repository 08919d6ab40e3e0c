/* What lines may have stepped over in cells that are left: bounds say which events are open there, and each of these
 * weighs as a curve through the middle of its cell. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/quadrature/sweep.h"

enum { PLACES = 3 }; /* where g is asked in a cell: in its middle and off it on two sides, as it may be NaN in a part */

typedef struct Hidden {
    uint32_t n;
    LeftCell of[LEFT_CHUNK]; /* those that are asked */
    Crossing crossing[LEFT_CHUNK * SLT_MAX_OPEN];
    uint8_t cell[LEFT_CHUNK * SLT_MAX_OPEN];
    double steep[LEFT_CHUNK * SLT_MAX_OPEN]; /* least |grad g| of a curve g = 0 in the cell, as places tell; 0: none */
    double jump[LEFT_CHUNK][SLT_MAX_CHANNELS];
    double part[LEFT_CHUNK]; /* of a whole curve, that lines may have missed */
} Hidden;

static double middle(const Box *b, uint32_t d, double t) { return b->lo[d] + t * (b->end[d] - b->lo[d]); }

/* Events of sites that are open in cell i, lane i of a call of `bounds`. False where more are than it names. */
static bool read_open(const Batch *b, uint32_t i, Hidden *h) {
    const SltScene *s = b->s;
    if (!batch_has(b, SLT_OUT_OPEN)) return true;
    int32_t open = batch_get_int(b, SLT_OUT_OPEN, 0, i);
    uint32_t named = scene_outputs(s, SLT_K_BOUNDS, SLT_OUT_OPEN_EDGE), n = 0;
    uint32_t depth = named ? scene_outputs(s, SLT_K_BOUNDS, SLT_OUT_OPEN_K) / named : 0;
    for (uint32_t e = 0; e < named && n < (uint32_t)open; e++) {
        int32_t edge = batch_get_int(b, SLT_OUT_OPEN_EDGE, e, i);
        if (edge < 0) break;
        double count = 1, first = 0;
        if (s->edge_kind && s->edge_kind[edge] != SLT_SITE_COMPARE && batch_has(b, SLT_OUT_OPEN_FIRST)) {
            first = batch_get(b, SLT_OUT_OPEN_FIRST, e, i);
            count = batch_get(b, SLT_OUT_OPEN_LAST, e, i) - first + 1;
            if (!(count >= 1 && count <= SLT_MAX_OPEN)) return false;
        }
        n += (uint32_t)count;
        if ((uint32_t)edge >= s->nsites) continue; /* a seam moves no boundary */
        Crossing *c = &h->crossing[h->n];
        *c = (Crossing){.event = {.site = edge, .boundary = first + floor(0.5 * count)}, .base = count, .axis = -1};
        for (uint32_t k = 0; k < depth; k++) c->event.k[k] = batch_get_int(b, SLT_OUT_OPEN_K, e * depth + k, i);
        h->steep[h->n] = 0, h->cell[h->n++] = (uint8_t)i;
    }
    return open >= 0 && n >= (uint32_t)open;
}

/* What f may jump by, by cell: less than its bounds are apart, and about what is seen elsewhere. */
static void find_jumps(SweepWorker *v, const LeftCell *l, uint32_t n, Hidden *h) {
    Batch *b = &v->w->batch;
    uint32_t channels = b->s->channels;
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t c = 0; c < channels; c++) {
            double lo = batch_get(b, SLT_OUT_F_LO, c, i), hi = batch_get(b, SLT_OUT_F_HI, c, i);
            h->jump[i][c] = lo <= hi ? hi - lo : INFINITY;
        }
    for (uint32_t i = 0; i < n; i++) {
        double x[3] = {0};
        for (uint32_t d = 0; d < b->s->dim; d++) x[d] = middle(&l[i].box, d, 0.5);
        batch_set_x(b, i, x);
    }
    batch_call(b, SLT_K_VALUE, n);
    for (uint32_t c = 0; c < channels; c++) {
        double least = INFINITY, most = -INFINITY, usual;
        for (uint32_t i = 0; i < n; i++) {
            double f = batch_get(b, SLT_OUT_F, c, i);
            if (isfinite(f)) least = fmin(least, f), most = fmax(most, f);
        }
        usual = fmax(v->sweep->jump[c], most > least ? most - least : 0);
        for (uint32_t i = 0; i < n; i++)
            if (usual > 0) h->jump[i][c] = fmin(h->jump[i][c], usual);
            else if (!isfinite(h->jump[i][c])) h->jump[i][c] = 1; /* nothing is known: that of a colour */
    }
}

/* g at the places of each event's cell: a curve in it is about as steep as g is there, and not flatter than it must be
 * to come to 0 within the cell. */
static void find_slopes(SweepWorker *v, const LeftCell *l, Hidden *h) {
    static const double at[PLACES] = {0.5, 0.9, 0.1};
    Batch *b = &v->w->batch;
    uint32_t lane[LEFT_CHUNK * SLT_MAX_OPEN];
    for (uint32_t site = 0; site < b->s->nsites; site++) {
        uint32_t n = 0;
        for (uint32_t i = 0; i < h->n; i++)
            if ((uint32_t)h->crossing[i].event.site == site) lane[n++] = i;
        b->args.site = (int32_t)site;
        for (int place = 0; place < PLACES && n; place++) {
            for (uint32_t i = 0; i < n; i++) {
                Crossing *c = &h->crossing[lane[i]];
                const Box *box = &l[h->cell[lane[i]]].box;
                for (uint32_t d = 0; d < b->s->dim; d++) c->dg[d] = middle(box, d, at[place]);
                batch_set_x(b, i, c->dg);
                batch_set_event(b, i, &c->event);
            }
            batch_call(b, SLT_K_SITE_GRAD, n);
            for (uint32_t i = 0; i < n; i++) {
                uint32_t k = lane[i];
                const Box *box = &l[h->cell[k]].box;
                double slope = 0, half = 0, g = fabs(batch_get(b, SLT_OUT_G, 0, i));
                for (uint32_t d = 0; d < b->s->dim; d++) {
                    double dg = batch_get(b, SLT_OUT_G_DX, d, i), side = 0.5 * (box->end[d] - box->lo[d]);
                    slope += dg * dg, half += side * side;
                }
                double steep = fmax(sqrt(slope), g / sqrt(half));
                bool told = isfinite(slope) && isfinite(g) && steep > 0 && isfinite(steep);
                if (!told || (h->steep[k] > 0 && h->steep[k] <= steep)) continue;
                h->steep[k] = steep;
                memcpy(h->crossing[k].x, h->crossing[k].dg, sizeof h->crossing[k].x);
            }
        }
    }
}

bool left_hidden(SweepWorker *v, const LeftCell *l, uint32_t n, const bool *seen) {
    Sweep *p = v->sweep;
    Batch *b = &v->w->batch;
    uint32_t dim = b->s->dim, kept = 0;
    Hidden *h = v->hidden;
    if (!h) h = v->hidden = malloc(sizeof *h);
    if (!h) return false;
    h->n = 0;
    LeftCell *of = h->of;
    uint32_t lanes = 0;
    bool met[LEFT_CHUNK];
    for (uint32_t i = 0; i < n; i++)
        if (l[i].asked > 0) met[lanes] = seen[i], of[lanes++] = l[i];
    if (!lanes) return true;
    for (uint32_t i = 0; i < lanes; i++) {
        batch_set_x(b, i, of[i].box.lo);
        for (uint32_t d = 0; d < dim; d++) batch_set(b, SLT_IN_H0 + d, i, of[i].box.hi[d]);
    }
    b->args.note = NULL;
    batch_call(b, SLT_K_BOUNDS, lanes);
    for (uint32_t i = 0; i < lanes; i++) {
        uint32_t before = h->n;
        /* What fits between lines is closed: it goes round once. */
        h->part[i] = of[i].stands > 0 ? 2.0 * dim / p->lines : sqrt(of[i].asked);
        if (!read_open(b, i, h)) v->unnamed = true;
        if (met[i]) h->n = before;
    }
    if (!h->n) return true;
    find_jumps(v, of, lanes, h);
    find_slopes(v, of, h);
    for (uint32_t i = 0; i < h->n; i++) {
        if (!(h->steep[i] > 0)) continue;
        const Box *box = &of[h->cell[i]].box;
        Crossing *c = &h->crossing[kept];
        double volume = 1, longest = 0, most = 0;
        for (uint32_t d = 0; d < dim; d++) {
            double side = box->end[d] - box->lo[d];
            volume *= side, longest = fmax(longest, side);
        }
        *c = h->crossing[i];
        c->weight = c->base * h->part[h->cell[i]] * volume / longest / h->steep[i];
        for (uint32_t k = 0; k < b->s->channels; k++)
            c->jump[k] = h->jump[h->cell[i]][k], most = fmax(most, c->jump[k]);
        if (!isfinite(c->weight) || !(most > 0)) continue;
        kept++;
    }
    if (!kept) return true;
    /* They err independently, whichever way each moves: signs by chance, and sizes that seldom cancel. What is merged
     * is divided as sizes of crossings are. */
    for (uint32_t i = 0; i < kept; i++) {
        uint32_t mixed = (i + 1) * 0x9e3779b1u;
        mixed ^= mixed >> 15, mixed *= 0x85ebca6bu, mixed ^= mixed >> 13;
        double chance = (mixed & 1 ? 1 : -1) * (0.6 + 0.8 * (mixed >> 8) * 0x1p-24);
        h->crossing[i].weight *= chance * left_divisor(v);
    }
    sink_put_size(&v->w->sink, h->crossing, kept);
    return true;
}
