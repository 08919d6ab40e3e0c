/* What lines may have stepped over in cells that are left, or met and could not integrate: bounds say which events are
 * open there, and each of these weighs as a curve of its g does that crosses the cell somewhere. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/quadrature/sweep.h"

enum {
    FEW = 16,  /* cells in all, of which two sets of lines tell little */
    PLACES = 3 /* where g is asked in a cell: in its middle and off it on two sides, as it may be NaN in a part */
};

typedef struct Hidden {
    uint32_t n;
    LeftCell of[LEFT_CHUNK];   /* those that are asked */
    uint8_t index[LEFT_CHUNK]; /* of them in the chunk */
    Crossing crossing[LEFT_CHUNK * SLT_MAX_OPEN];
    uint8_t cell[LEFT_CHUNK * SLT_MAX_OPEN];
    double range[LEFT_CHUNK * SLT_MAX_OPEN]; /* by how much g changes across the cell, the least that a place tells; 0:
                                                none does */
    double jump[LEFT_CHUNK][SLT_MAX_CHANNELS];
    double part[LEFT_CHUNK]; /* of a whole curve, that is not among what lines have found */
} Hidden;

static double middle(const Box *b, uint32_t d, double t) { return b->lo[d] + t * (b->end[d] - b->lo[d]); }

/* Events of sites that are open in cell i, lane i of a call of `bounds`. False where more are than it names. */
static bool read_open(const Batch *b, uint32_t i, Hidden *h) {
    const SltScene *s = b->s;
    int32_t open = batch_open(b, i);
    if (!open) return true;
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
        h->range[h->n] = 0, h->cell[h->n++] = (uint8_t)i;
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

/* The places of each event's cell: there g changes by its slope times the sides, and by enough to come to 0. */
static void find_ranges(SweepWorker *v, const LeftCell *l, Hidden *h) {
    static const double at[PLACES] = {0.5, 0.9, 0.1};
    Batch *b = &v->w->batch;
    uint32_t lane[LEFT_CHUNK * SLT_MAX_OPEN];
    for (uint32_t site = 0; site < b->s->nsites; site++) {
        uint32_t n = 0;
        for (uint32_t i = 0; i < h->n; i++)
            if ((uint32_t)h->crossing[i].event.site == site) lane[n++] = i;
        b->args.site = (int32_t)site;
        for (uint32_t from = 0; from < n; from += BATCH)
            for (int place = 0; place < PLACES; place++) {
                uint32_t m = n - from < BATCH ? n - from : BATCH;
                for (uint32_t i = 0; i < m; i++) {
                    Crossing *c = &h->crossing[lane[from + i]];
                    const Box *box = &l[h->cell[lane[from + i]]].box;
                    for (uint32_t d = 0; d < b->s->dim; d++) c->dg[d] = middle(box, d, at[place]);
                    batch_set_x(b, i, c->dg);
                    batch_set_event(b, i, &c->event);
                }
                batch_call(b, SLT_K_SITE_GRAD, m);
                for (uint32_t i = 0; i < m; i++) {
                    uint32_t k = lane[from + i];
                    const Box *box = &l[h->cell[k]].box;
                    double range = 0, g = fabs(batch_get(b, SLT_OUT_G, 0, i));
                    for (uint32_t d = 0; d < b->s->dim; d++)
                        range += fabs(batch_get(b, SLT_OUT_G_DX, d, i)) * (box->end[d] - box->lo[d]);
                    bool told = isfinite(range) && isfinite(g);
                    range = fmax(range, 2 * g);
                    if (!told || !(range > 0) || (h->range[k] > 0 && h->range[k] <= range)) continue;
                    h->range[k] = range;
                    memcpy(h->crossing[k].x, h->crossing[k].dg, sizeof h->crossing[k].x);
                }
            }
    }
}

/* Of a curve g = 0 through a box whose place is not known: the mean over the values of g of the integral of
 * delta(g). False: nothing is known of g. */
static bool weigh(const SweepWorker *v, const Hidden *h, uint32_t i, const Box *box, Crossing *c) {
    double volume = 1, most = 0;
    uint32_t cell = h->cell[i];
    if (!(h->range[i] > 0)) return false;
    for (uint32_t d = 0; d < v->w->batch.s->dim; d++) volume *= box->end[d] - box->lo[d];
    *c = h->crossing[i];
    c->weight = c->base * h->part[cell] * volume / h->range[i];
    for (uint32_t k = 0; k < v->w->batch.s->channels; k++) c->jump[k] = h->jump[cell][k], most = fmax(most, c->jump[k]);
    return isfinite(c->weight) && most > 0;
}

/* They err independently, whichever way each moves: signs by chance, and sizes that seldom cancel. What is merged is
 * divided as sizes of crossings are. */
static void put(SweepWorker *v, Hidden *h, uint32_t n) {
    for (uint32_t i = 0; i < n; i++) {
        uint32_t mixed = (i + 1) * 0x9e3779b1u;
        mixed ^= mixed >> 15, mixed *= 0x85ebca6bu, mixed ^= mixed >> 13;
        double chance = (mixed & 1 ? 1 : -1) * (0.6 + 0.8 * (mixed >> 8) * 0x1p-24);
        h->crossing[i].weight *= chance * left_divisor(v);
    }
    for (uint32_t from = 0; from < n; from += BATCH)
        sink_put_size(&v->w->sink, h->crossing + from, n - from < BATCH ? n - from : BATCH);
}

/* Bounds of the cells that are asked, one lane each; returns how many those are. */
static uint32_t ask(SweepWorker *v, const LeftCell *l, uint32_t n, Hidden *h) {
    Batch *b = &v->w->batch;
    uint32_t lanes = 0;
    for (uint32_t i = 0; i < n; i++)
        if (l[i].asked > 0) h->index[lanes] = (uint8_t)i, h->of[lanes++] = l[i];
    for (uint32_t i = 0; i < lanes; i++) {
        batch_set_x(b, i, h->of[i].box.lo);
        for (uint32_t d = 0; d < b->s->dim; d++) batch_set(b, SLT_IN_H0 + d, i, h->of[i].box.hi[d]);
    }
    b->args.note = NULL;
    if (lanes) batch_call(b, SLT_K_BOUNDS, lanes);
    return lanes;
}

bool left_hidden(SweepWorker *v, const LeftCell *l, uint32_t n, const bool *seen, const bool *lost) {
    Sweep *p = v->sweep;
    Batch *b = &v->w->batch;
    uint32_t kept = 0;
    Hidden *h = v->hidden;
    if (!h) h = v->hidden = malloc(sizeof *h);
    if (!h) return false;
    h->n = 0;
    uint32_t lanes = ask(v, l, n, h);
    for (uint32_t i = 0; i < lanes; i++) {
        uint32_t before = h->n;
        const LeftCell *cell = &h->of[i];
        bool dropped = lost[h->index[i]];
        /* What fits between lines is closed: it goes round once. What was dropped is a whole curve. */
        h->part[i] = dropped ? cell->stands : cell->stands > 0 ? 2.0 * b->s->dim / p->lines : sqrt(cell->asked);
        if (!read_open(b, i, h)) v->unnamed = true;
        if (dropped && h->n == before) v->unnamed = true;
        if (!seen[h->index[i]] || dropped) continue;
        /* Of many cells the two sets of lines tell the error; of a few they may agree by chance. */
        if (p->nleft > FEW) h->n = before;
        else h->part[i] = cell->stands / p->lines;
    }
    if (!h->n) return true;
    find_jumps(v, h->of, lanes, h);
    find_ranges(v, h->of, h);
    for (uint32_t i = 0; i < h->n; i++) {
        Crossing c;
        if (weigh(v, h, i, &h->of[h->cell[i]].box, &c)) h->crossing[kept++] = c;
        else if (lost[h->index[h->cell[i]]] || p->sampled) v->unnamed = true;
    }
    put(v, h, kept);
    return true;
}
