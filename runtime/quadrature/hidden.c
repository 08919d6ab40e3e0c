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

#define MOST_ALONG 64 /* the slope of g along a gap that it jumps across, in parts of that across it */
#define LARGE 0x1p-16 /* of the domain: a cell in which other lines of a mesh may matter than those that are told */
#define ALIKE 0.9 /* cosine between slopes of one piece */

/* What a place tells of an event's g. */
typedef struct Place {
    double x[3], dg[3];
    double range; /* by how much g changes across the cell; 0: it does not tell */
} Place;

typedef struct Hidden {
    uint32_t n;
    LeftCell of[LEFT_CHUNK];   /* those that are asked */
    uint8_t index[LEFT_CHUNK]; /* of them in the chunk */
    Crossing crossing[LEFT_CHUNK * SLT_MAX_OPEN];
    uint8_t cell[LEFT_CHUNK * SLT_MAX_OPEN];
    Place place[PLACES][LEFT_CHUNK * SLT_MAX_OPEN];
    Crossing out[PLACES * LEFT_CHUNK * SLT_MAX_OPEN];
    double jump[LEFT_CHUNK][SLT_MAX_CHANNELS];
    double part[LEFT_CHUNK]; /* of a whole curve, that is not among what lines have found */
} Hidden;

static double middle(const Box *b, uint32_t d, double t) { return b->lo[d] + t * (b->end[d] - b->lo[d]); }

/* Events of sites that are open in cell i, lane i of a call of `bounds`. False where more are than it names. */
static bool read_open(const Batch *b, uint32_t i, bool large, Hidden *h) {
    const SltScene *s = b->s;
    int32_t open = batch_open(b, i);
    /* Of the lines of a mesh that pass a box only so many are told, or none; of a small one these tell enough. */
    bool many = batch_get_int(b, SLT_OUT_BOX_STATE, 0, i) & SLT_BOX_UNKNOWN && scene_asks_meshes(s);
    if (many && (!open || large)) return false;
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
        batch_read_line(b, e, i, &c->event);
        for (int place = 0; place < PLACES; place++) h->place[place][h->n].range = 0;
        h->cell[h->n++] = (uint8_t)i;
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

static const double at[PLACES] = {0.5, 0.9, 0.1};

/* A gap between two floats hides a jump across it, and nothing else: curves that cross it have no length in it. At how
 * many places is f not the same on its two sides, and which piece of g lies along it there, with the steepest slope? */
static void find_gap(SweepWorker *v, const Box *box, int axis, Hidden *h, uint32_t i) {
    Batch *b = &v->w->batch;
    Crossing *c = &h->crossing[i];
    double x[2 * PLACES][3] = {{0}}, steepest = 0;
    uint32_t differ = 0;
    bool jumps[PLACES];
    for (int k = 0; k < 2 * PLACES; k++) {
        for (uint32_t d = 0; d < b->s->dim; d++) x[k][d] = middle(box, d, at[k / 2]);
        x[k][axis] = k & 1 ? box->hi[axis] : box->lo[axis];
    }
    for (uint32_t k = 0; k < 2 * PLACES; k++) batch_set_x(b, k, x[k]);
    batch_call(b, SLT_K_REGION, 2 * PLACES);
    for (uint32_t k = 0; k < PLACES; k++) {
        int32_t lo = batch_get_int(b, SLT_OUT_HASH, 0, 2 * k), hi = batch_get_int(b, SLT_OUT_HASH, 0, 2 * k + 1);
        jumps[k] = lo != hi, differ += jumps[k];
    }
    b->args.site = c->event.site;
    for (uint32_t k = 0; k < 2 * PLACES; k++) batch_set_x(b, k, x[k]), batch_set_event(b, k, &c->event);
    batch_call(b, SLT_K_SITE_GRAD, 2 * PLACES);
    for (uint32_t k = 0; k < 2 * PLACES; k++) {
        double up = fabs(batch_get(b, SLT_OUT_G_DX, (uint32_t)axis, k));
        bool across = jumps[k / 2] && isfinite(up) && up > steepest;
        for (uint32_t d = 0; d < b->s->dim; d++) across &= fabs(batch_get(b, SLT_OUT_G_DX, d, k)) <= MOST_ALONG * up;
        if (!across) continue;
        steepest = up;
        memcpy(h->place[0][i].x, x[k], sizeof x[k]);
    }
    for (int place = 0; place < PLACES; place++) h->place[place][i].range = 0;
    h->place[0][i].range = steepest * (box->end[axis] - box->lo[axis]);
    c->base *= (double)differ / PLACES;
}

/* The places of each event's cell: there g changes by its slope times the sides, and by enough to come to 0. */
static void find_ranges(SweepWorker *v, const LeftCell *l, Hidden *h) {
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
                    const Crossing *c = &h->crossing[lane[from + i]];
                    const Box *box = &l[h->cell[lane[from + i]]].box;
                    Place *p = &h->place[place][lane[from + i]];
                    for (uint32_t d = 0; d < 3; d++) p->x[d] = d < b->s->dim ? middle(box, d, at[place]) : 0;
                    batch_set_x(b, i, p->x);
                    batch_set_event(b, i, &c->event);
                }
                batch_call(b, SLT_K_SITE_GRAD, m);
                for (uint32_t i = 0; i < m; i++) {
                    Place *p = &h->place[place][lane[from + i]];
                    const Box *box = &l[h->cell[lane[from + i]]].box;
                    double range = 0, g = fabs(batch_get(b, SLT_OUT_G, 0, i));
                    for (uint32_t d = 0; d < b->s->dim; d++) {
                        p->dg[d] = batch_get(b, SLT_OUT_G_DX, d, i);
                        range += fabs(p->dg[d]) * (box->end[d] - box->lo[d]);
                    }
                    p->range = isfinite(range) && isfinite(g) ? fmax(range, 2 * g) : 0;
                }
            }
    }
}

/* Bit by place: the one that tells the least range, and those where g has another slope: another piece of it, which
 * other parameters move. */
static uint32_t pieces(const Hidden *h, uint32_t i, uint32_t dim) {
    int least = -1;
    uint32_t set = 0;
    for (int k = 0; k < PLACES; k++)
        if (h->place[k][i].range > 0 && (least < 0 || h->place[k][i].range < h->place[least][i].range)) least = k;
    for (int k = 0; k < PLACES && least >= 0; k++) {
        const Place *p = &h->place[k][i], *q = &h->place[least][i];
        double pp = 0, qq = 0, pq = 0;
        for (uint32_t d = 0; d < dim; d++)
            pp += p->dg[d] * p->dg[d], qq += q->dg[d] * q->dg[d], pq += p->dg[d] * q->dg[d];
        if (p->range > 0 && (k == least || pq < ALIKE * sqrt(pp * qq))) set |= 1u << k;
    }
    return set;
}

/* Of a curve g = 0 through a box whose place is not known: the mean over the values of g of the integral of
 * delta(g). False: nothing is known of g. */
static bool weigh(const SweepWorker *v, const Hidden *h, uint32_t i, const Place *p, const Box *box, Crossing *c) {
    double volume = 1, most = 0;
    uint32_t cell = h->cell[i];
    *c = h->crossing[i];
    memcpy(c->x, p->x, sizeof c->x);
    for (uint32_t d = 0; d < v->w->batch.s->dim; d++) volume *= box->end[d] - box->lo[d];
    c->weight = c->base * h->part[cell] * volume / p->range;
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
        h->out[i].weight *= chance * left_divisor(v);
    }
    for (uint32_t from = 0; from < n; from += BATCH)
        sink_put_size(&v->w->sink, h->out + from, n - from < BATCH ? n - from : BATCH);
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
        bool large = sweep_measure(&cell->box, b->s->dim) > LARGE * p->volume;
        if (!read_open(b, i, large, h)) v->unnamed = true;
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
        int axis = sweep_gap(p, &h->of[h->cell[i]].box);
        if (axis >= 0) find_gap(v, &h->of[h->cell[i]].box, axis, h, i);
    }
    for (uint32_t i = 0; i < h->n; i++) {
        uint32_t set = pieces(h, i, b->s->dim), before = kept;
        for (uint32_t k; set; set &= set - 1) {
            k = (uint32_t)__builtin_ctz(set);
            kept += weigh(v, h, i, &h->place[k][i], &h->of[h->cell[i]].box, &h->out[kept]);
        }
        bool nothing = kept == before && h->crossing[i].base > 0;
        if (nothing && (lost[h->index[h->cell[i]]] || p->sampled)) v->unnamed = true;
    }
    put(v, h, kept);
    return true;
}
