/* What becomes of crossings: weights, then adjoints, tangents or a list. */
#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/sink.h"

bool sink_init(Sink *k, SinkKind kind, Batch *b, Accum *acc, Finder *f, const Grid *g) {
    memset(k, 0, sizeof *k);
    k->kind = kind, k->b = b, k->acc = acc, k->f = f, k->grid = g, k->classes = 1;
    for (int d = 0; d < 3; d++) k->scale[d] = g ? g->side[d] : 1;
    k->order = malloc(BATCH * sizeof *k->order);
    return k->order != NULL;
}

void sink_free(Sink *k) {
    free(k->order), free(k->kept), free(k->thin), free(k->doubt);
    coincide_free(&k->coincide), apart_free(k->far);
    splat_free(&k->splat);
    memset(k, 0, sizeof *k);
}

void directions_free(Directions *d) {
    for (uint32_t i = 0; i < d->n && d->flt; i++) free(d->flt[i]);
    free(d->flt);
}

bool directions_init(Directions *d, const SltScene *s, uint32_t n, const double *const *dirs) {
    d->n = n, d->flt = alloc_zero(n, sizeof *d->flt);
    if (!d->flt) return false;
    for (uint32_t i = 0; i < n; i++) {
        size_t size = s->f64 ? sizeof(double) : sizeof(float);
        if (!(d->flt[i] = aligned_alloc(64, (s->nfloats * size + 64) / 64 * 64))) return false;
        for (uint32_t p = 0; p < s->nfloats; p++)
            if (s->f64) ((double *)d->flt[i])[p] = dirs[i][p];
            else ((float *)d->flt[i])[p] = (float)dirs[i][p];
    }
    return true;
}

void sink_put(Sink *k, uint32_t lane, const Crossing *c) {
    Batch *b = k->b;
    batch_set_x(b, lane, c->x);
    batch_set_stream(b, lane, c->stream, c->rand0);
    batch_set_event(b, lane, &c->event);
}

void sink_move(Sink *k, const Crossing *c) {
    Batch *b = k->b;
    bool moves = c && c->move;
    if (!k->moved) k->lists = b->args.cull; /* good where nothing has moved */
    if (moves) untie_use(b, &c->apart->move[c->move - 1].scene);
    else if (k->moved) untie_use(b, b->s);
    b->args.cull = moves ? NULL : k->lists;
    k->moved = moves;
}

/* Part of a segment: a change of g on the bracket that its slope makes on this part is rounding. The g of a line of a
 * mesh is a polynomial that never jumps, and of an eye far away its rounding is more. */
#define ROUNDED 0x1p-6
#define ROUNDED_LINE 0x1p-2

static double rounded_part(const SltScene *s, int32_t site) {
    const bool line = s->site_kind[site] >= SLT_SITE_MESH && s->site_kind[site] <= SLT_SITE_MESH_SHADOW;
    return line ? ROUNDED_LINE : ROUNDED;
}

static double length(const double v[3], uint32_t dim) {
    double sum = 0;
    for (uint32_t d = 0; d < dim; d++) sum += v[d] * v[d];
    return sqrt(sum);
}

enum { UNITS = 1000 }; /* powers of two of which doubles hold the reciprocals, too */

/* Along a line: base * d_i g * s_i^2 / sum (s_j d_j g)^2, with the sign of the jump along the line. On a random
 * segment: base / |grad g|, with the jump turned towards growing g. False, with the reason, where there is no weight.
 */
static bool weigh(const Sink *k, Crossing *c, SltDrop *reason) {
    uint32_t dim = k->b->s->dim;
    double scaled = 0, plain = 0, along = 0, most = 0, unit;
    int power = 0; /* of two, in units of which slopes are: their squares stay in range, whatever g is measured in */
    for (uint32_t d = 0; d < dim; d++) most = fmax(most, fabs(c->dg[d]));
    if (isfinite(most)) frexp(most, &power);
    power = power < -UNITS ? -UNITS : power > UNITS ? UNITS : power;
    unit = ldexp(1, -power); /* products with it are exact */
    for (uint32_t d = 0; d < dim; d++) {
        double slope = unit * c->dg[d], v = k->scale[d] * slope;
        scaled += v * v, plain += slope * slope;
        along += slope * c->direction[d];
    }
    if (!isfinite(scaled) || !isfinite(plain)) *reason = SLT_DROP_NOT_FINITE;
    else if (!(scaled > 0) || !(plain > 0)) *reason = SLT_DROP_ZERO_GRADIENT;
    /* g changed on the bracket by far more than its gradient allows: g itself jumps, or its root is multiple. Unless
     * the change is little beside that of g on the segment: far from the origin, rounding in single precision makes as
     * much.
     */
    else if (unit * (fabs(c->ga) + fabs(c->gb)) >
             sqrt(plain) * fmax(32 * c->bracket, rounded_part(k->b->s, c->event.site) * length(c->direction, dim)))
        *reason = SLT_DROP_INCONSISTENT;
    else {
        if (c->axis >= 0) {
            double slope = unit * c->dg[c->axis];
            c->weight = unit * (c->base * slope * k->scale[c->axis] * k->scale[c->axis] / scaled);
        } else c->weight = unit * (c->base * (along < 0 ? -1 : 1) / sqrt(plain));
        if (isfinite(c->weight)) return true;
        *reason = SLT_DROP_NOT_FINITE;
    }
    return false;
}

/* g and its gradient from lane i of the kernel. */
static void take_gradient(const Sink *k, Crossing *c, uint32_t lane) {
    c->g = batch_get(k->b, SLT_OUT_G, 0, lane);
    for (uint32_t d = 0; d < k->b->s->dim; d++) c->dg[d] = batch_get(k->b, SLT_OUT_G_DX, d, lane);
}

static double steepness(const Crossing *c, uint32_t dim) {
    double steep = length(c->dg, dim);
    return isfinite(steep) ? steep : 0;
}

/* A crossing without a weight. */
static void drop(Sink *k, SltDrop reason, const Crossing *c) {
    uint32_t channels = k->b->s->channels;
    double a[SLT_MAX_CHANNELS];
    finder_drop(k->f, reason, c);
    if (k->kind == SINK_REVERSE) grid_gather(k->grid, k->adjoint, channels, c->x, a);
    for (uint32_t ch = 0; ch < channels; ch++)
        if (k->kind == SINK_REVERSE) k->gone[0] += fabs(c->base * a[ch] * c->jump[ch]);
        else k->gone[ch] += fabs(c->base * c->jump[ch]);
}

/* At a root where g is flat on one side, or its slope 0 or infinite, the ends of the bracket may have a gradient, and
 * the ratios of its components are those of the boundary: the crossing moves to the end where g is steeper. Crossings
 * at[0..n), n <= FIND. */
static void weigh_ends(Sink *k, Crossing *c, const uint64_t *order, const uint32_t *at, uint32_t n, bool *keep) {
    Batch *b = k->b;
    const Crossing *failed[FIND];
    SltDrop reasons[FIND];
    bool stands[FIND];
    uint32_t nfailed = 0;
    for (uint32_t i = 0; i < 2 * n; i++) {
        Crossing *x = &c[(uint32_t)order[at[i / 2]]];
        sink_put(k, i, x);
        batch_set_x(b, i, x->side[i % 2]);
    }
    batch_call(b, SLT_K_SITE_GRAD, 2 * n);
    for (uint32_t i = 0; i < n; i++) {
        Crossing *x = &c[(uint32_t)order[at[i]]], end[2] = {*x, *x};
        for (uint32_t e = 0; e < 2; e++) take_gradient(k, &end[e], 2 * i + e);
        uint32_t e = steepness(&end[1], b->s->dim) > steepness(&end[0], b->s->dim);
        SltDrop reason;
        keep[at[i]] = weigh(k, &end[e], &reason);
        if (!keep[at[i]]) {
            failed[nfailed] = x, reasons[nfailed++] = reason;
            continue;
        }
        memcpy(end[e].x, x->side[e], sizeof x->x);
        *x = end[e];
        finder_note_size(k->f, &k->f->kept, x);
    }
    stands_find(k, failed, nfailed, stands);
    for (uint32_t i = 0; i < nfailed; i++)
        if (stands[i]) k->f->crossings--;
        else drop(k, reasons[i], failed[i]);
}

void sink_weigh(Sink *k, Crossing *c, const uint64_t *order, uint32_t n, bool *keep) {
    uint32_t failed[BATCH], nfailed = 0;
    SltDrop reason;
    if (k->met && n) __atomic_store_n(&k->met[c[(uint32_t)order[0]].event.site], 1, __ATOMIC_RELAXED);
    for (uint32_t i = 0; i < n; i++) sink_put(k, i, &c[(uint32_t)order[i]]);
    batch_call(k->b, SLT_K_SITE_GRAD, n);
    for (uint32_t i = 0; i < n; i++) {
        Crossing *x = &c[(uint32_t)order[i]];
        take_gradient(k, x, i);
        keep[i] = weigh(k, x, &reason);
        if (keep[i]) {
            finder_note_size(k->f, &k->f->kept, x);
            continue;
        }
        if (x->bracket > 0) failed[nfailed++] = i;
        else drop(k, reason, x);
    }
    for (uint32_t from = 0; from < nfailed; from += FIND)
        weigh_ends(k, c, order, failed + from, nfailed - from < FIND ? nfailed - from : FIND, keep);
}

bool sink_rect(Sink *k, const double lo[3], const double hi[3]) {
    bool ok = splat_begin(&k->splat, k->grid, k->dirs->n, k->b->s->channels, lo, hi);
    k->failed |= !ok;
    return ok;
}

/* 1 or -1, by the place. */
static double sign_of(const Crossing *x) {
    uint64_t bits = 0, mixed = 0;
    for (uint32_t d = 0; d < 3; d++) {
        memcpy(&bits, &x->x[d], sizeof bits);
        mixed = (mixed ^ bits) * 0x9e3779b97f4a7c15u;
        mixed ^= mixed >> 29;
    }
    return mixed >> 40 & 1 ? 1 : -1;
}

/* ---- a group of crossings order[0..n) of one site and class, with their weights */
/* The seed of each channel; false where all are 0. */
static bool put_seeds(Sink *k, uint32_t lane, const Crossing *x, double weight) {
    bool any = false;
    for (uint32_t ch = 0; ch < k->b->s->channels; ch++) {
        double seed = weight * x->jump[ch];
        any |= seed != 0;
        batch_set(k->b, SLT_IN_SEED0 + ch, lane, seed);
    }
    return any;
}

/* Adjoints by channel, into the buffers from `first` on, and into those from `again` on if it is not the same. */
static void emit_integral(Sink *k, const Crossing *c, const uint64_t *order, uint32_t n, uint32_t first,
                          uint32_t again) {
    bool any = false;
    for (uint32_t i = 0; i < n; i++) {
        const Crossing *x = &c[(uint32_t)order[i]];
        double weight = x->weight * (k->any_sign ? sign_of(x) : 1);
        sink_put(k, i, x);
        any |= put_seeds(k, i, x, weight);
    }
    if (!any) return;
    accum_site_rows(k->acc, k->b, n, first);
    if (again != first) accum_site_rows(k->acc, k->b, n, again);
}

/* Into the sketches, which come after the other sums. */
static void emit_sketches(Sink *k, const Crossing *c, const uint64_t *order, uint32_t n) {
    uint32_t channels = k->b->s->channels;
    double weight[BATCH][SKETCHES];
    for (uint32_t i = 0; i < n; i++) {
        const Crossing *x = &c[(uint32_t)order[i]];
        if (k->sketch.apart[0]) sketch_weights_spread(&k->sketch, x->line, x->axis, weight[i]);
        else sketch_weights(&k->sketch, x->x, x->axis, weight[i]);
    }
    for (uint32_t q = 0; q < SKETCHES; q++) {
        uint32_t used = 0;
        for (uint32_t i = 0; i < n; i++) {
            const Crossing *x = &c[(uint32_t)order[i]];
            if (!put_seeds(k, used, x, weight[i][q] * x->weight)) continue;
            sink_put(k, used++, x);
        }
        accum_site_rows(k->acc, k->b, used, (3 + q) * channels);
    }
}

/* Of crossings of lines: how much there is of the boundary, jumps of both signs alike; those that coarser lines miss
 * count twice. */
static void emit_size(Sink *k, const Crossing *c, const uint64_t *order, uint32_t n, uint32_t first, bool missed) {
    uint32_t channels = k->b->s->channels;
    for (uint32_t i = 0; i < n; i++) {
        const Crossing *x = &c[(uint32_t)order[i]];
        sink_put(k, i, x);
        for (uint32_t ch = 0; ch < channels; ch++)
            batch_set(k->b, SLT_IN_SEED0 + ch, i, (missed ? 2 : 1) * fabs(x->weight * x->jump[ch]));
    }
    accum_site_rows(k->acc, k->b, n, first);
}

/* Into the buffer `which`. size: 0, or as emit_size how much there is of the boundary where an adjoint is, so many
 * times; what was not found by a line has a sign of its own. */
static void emit_reverse(Sink *k, const Crossing *c, const uint64_t *order, uint32_t n, uint32_t which, double size) {
    uint32_t channels = k->b->s->channels, used = 0;
    for (uint32_t i = 0; i < n; i++) {
        const Crossing *x = &c[(uint32_t)order[i]];
        double a[SLT_MAX_CHANNELS], seed = 0;
        grid_gather(k->grid, k->adjoint, channels, x->x, a);
        for (uint32_t ch = 0; ch < channels; ch++) seed += size > 0 ? fabs(a[ch] * x->jump[ch]) : a[ch] * x->jump[ch];
        if (seed == 0) continue; /* no pixel asks for it */
        seed *= size > 0 ? size * (x->axis >= 0 ? fabs(x->weight) : x->weight) : x->weight;
        if (k->any_sign) seed *= sign_of(x);
        sink_put(k, used, x);
        batch_set(k->b, SLT_IN_SEED0, used++, seed);
    }
    accum_call(k->acc, k->b, SLT_K_SITE_VJP, used, which);
}

/* The seed of a crossing by the error of the adjoint, before its weight. */
static double noise_seed(const Sink *k, const Crossing *x, const uint32_t cell[3]) {
    const uint32_t channels = k->b->s->channels;
    const bool box = grid_is_box(k->grid);
    double off[SLT_MAX_CHANNELS], least[SLT_MAX_CHANNELS] = {0}, seed = 0;
    if (box) grid_gather_box(k->grid, k->noise[0], channels, cell, off);
    else grid_gather(k->grid, k->noise[0], channels, x->x, off);
    if (k->noise[1]) grid_gather(k->grid, k->noise[1], channels, x->x, least);
    else if (k->least > 0) {
        const double all = grid_gather_all(k->grid, k->least, x->x);
        for (uint32_t ch = 0; ch < channels; ch++) least[ch] = all;
    }
    for (uint32_t ch = 0; ch < channels; ch++)
        seed += copysign(fmax(fabs(off[ch]), fabs(least[ch] * x->jump[ch])), off[ch]) * x->jump[ch];
    return seed;
}

/* What crossings weigh by the error of the adjoint, which is each pixel's own: into one of PARTS_NOISE sums of pixels
 * that are not neighbours. */
static void emit_noise(Sink *k, const Crossing *c, const uint64_t *order, uint32_t n) {
    const uint32_t first = k->classes + k->misses;
    double seed[BATCH];
    uint8_t of[BATCH];
    uint16_t sorted[BATCH];
    uint32_t place[PARTS_NOISE + 1] = {0};
    for (uint32_t i = 0; i < n; i++) {
        const Crossing *x = &c[(uint32_t)order[i]];
        uint32_t cell[3], sum = 0;
        grid_cells(k->grid, x->x, cell);
        for (uint32_t d = 0; d < k->grid->dim; d++) sum += (2 * d + 1) * cell[d];
        of[i] = sum % PARTS_NOISE;
        seed[i] = noise_seed(k, x, cell);
        place[of[i] + 1] += seed[i] != 0;
    }
    for (uint32_t g = 0; g < PARTS_NOISE; g++) place[g + 1] += place[g];
    uint32_t end[PARTS_NOISE];
    memcpy(end, place, sizeof end);
    for (uint32_t i = 0; i < n; i++)
        if (seed[i] != 0) sorted[end[of[i]]++] = (uint16_t)i;
    for (uint32_t g = 0; g < PARTS_NOISE; g++) {
        for (uint32_t at = place[g]; at < end[g]; at++) {
            const Crossing *x = &c[(uint32_t)order[sorted[at]]];
            sink_put(k, at - place[g], x);
            batch_set(k->b, SLT_IN_SEED0, at - place[g], seed[sorted[at]] * x->weight);
        }
        accum_call(k->acc, k->b, SLT_K_SITE_VJP, end[g] - place[g], first + g);
    }
}

static void emit_forward(Sink *k, const Crossing *c, const uint64_t *order, uint32_t n) {
    Batch *b = k->b;
    uint32_t channels = b->s->channels;
    for (uint32_t i = 0; i < n; i++) splat_count(&k->splat, c[(uint32_t)order[i]].x);
    for (uint32_t d = 0; d < k->dirs->n; d++) {
        for (uint32_t i = 0; i < n; i++) sink_put(k, i, &c[(uint32_t)order[i]]);
        b->args.dparams = k->dirs->flt[d];
        batch_call(b, SLT_K_SITE_JVP, n);
        for (uint32_t i = 0; i < n; i++) {
            const Crossing *x = &c[(uint32_t)order[i]];
            double gdot = batch_get(b, SLT_OUT_DG, 0, i), value[SLT_MAX_CHANNELS];
            if (gdot == 0) continue;
            for (uint32_t ch = 0; ch < channels; ch++) value[ch] = x->weight * x->jump[ch] * gdot;
            splat_add(&k->splat, d, x->x, value);
        }
    }
}

static bool room(Sink *k, Crossing **list, uint64_t *cap, uint64_t n) {
    if (n <= *cap) return true;
    Crossing *more = realloc(*list, 2 * n * sizeof *more);
    if (!more) k->failed = true;
    else *list = more, *cap = 2 * n;
    return more != NULL;
}

static void keep_all(Sink *k, const Crossing *c, uint32_t n) {
    if (!room(k, &k->kept, &k->kept_cap, k->nkept + n)) return;
    memcpy(k->kept + k->nkept, c, n * sizeof *c);
    k->nkept += n;
}

static uint32_t clip(const Sink *k, Crossing *c, uint32_t n) {
    uint32_t kept = 0;
    for (uint32_t i = 0; i < n; i++) {
        bool inside = true;
        for (uint32_t d = 0; d < k->grid->dim; d++)
            inside &= c[i].x[d] >= k->grid->lo[d] && c[i].x[d] <= k->grid->hi[d];
        if (inside) c[kept++] = c[i];
    }
    return kept;
}

/* Sorts by site, move and class. The bits of k->order: below these places the number of a crossing, its class too, its
 * move too. */
enum { CLASS_BIT = 32, MOVE_BIT = 36, SITE_BIT = 40 };
static void group(Sink *k, const Crossing *c, uint32_t n) {
    assert(n <= BATCH);
    for (uint32_t i = 0; i < n; i++)
        k->order[i] = (uint64_t)(uint32_t)c[i].event.site << SITE_BIT | (uint64_t)c[i].move << MOVE_BIT |
                      (uint64_t)c[i].cls << CLASS_BIT | i;
    sort_keys(k->order, n);
}

/* The end of the group that begins at `from`, whose site and parameters the next calls are for; behind the last group
 * sink_move(k, NULL) is due. */
static uint32_t group_end(Sink *k, const Crossing *c, uint32_t from, uint32_t n) {
    uint32_t to = from + 1;
    while (to < n && k->order[to] >> CLASS_BIT == k->order[from] >> CLASS_BIT) to++;
    k->b->args.site = c[(uint32_t)k->order[from]].event.site;
    sink_move(k, &c[(uint32_t)k->order[from]]);
    return to;
}

/* Of crossings by quadrature: the group of buffers that sizes go to, as SUM_SIZE. */
enum { SIZE_GROUP = 4 };

static void emit(Sink *k, const Crossing *c, const uint64_t *order, uint32_t n) {
    if (!n) return;
    uint32_t cls = c[(uint32_t)order[0]].cls, channels = k->b->s->channels;
    switch (k->kind) {
    case SINK_INTEGRAL:
        emit_integral(k, c, order, n, 0, cls ? channels : 0);
        if (k->sketch.lines[0]) emit_sketches(k, c, order, n);
        break;
    case SINK_PARTS:
        emit_integral(k, c, order, n, (cls & 1) * channels, (cls & 1) * channels);
        if (cls & 4) emit_size(k, c, order, n, SIZE_GROUP * channels, cls & 2);
        break;
    case SINK_REVERSE:
        emit_reverse(k, c, order, n, k->sizes ? cls & 1 : k->classes > 1 ? cls : 0, 0);
        if (k->sizes && cls & 4) emit_reverse(k, c, order, n, SIZE_GROUP, cls & 2 ? 2 : 1);
        break;
    case SINK_FORWARD: emit_forward(k, c, order, n); break;
    case SINK_KEEP:
    case SINK_NONE: break;
    }
}

/* All groups, of those that are kept (NULL: of all). Noise asks for no class: those of one site and move go together,
 * as each of its sums gets few. */
static void emit_groups(Sink *k, const Crossing *c, const bool *keep, uint32_t n) {
    uint32_t put = 0, quiet = 0; /* entries of k->order that are out, and those of them whose noise is, too */
    for (uint32_t from = 0, to; from < n; from = to) {
        const uint64_t key = k->order[from] >> MOVE_BIT;
        const uint32_t first = put;
        to = group_end(k, c, from, n);
        for (uint32_t i = from; i < to; i++)
            if (!keep || keep[i]) k->order[put++] = k->order[i];
        emit(k, c, k->order + first, put - first);
        if (to < n && k->order[to] >> MOVE_BIT == key) continue;
        if (k->noise[0] && put > quiet) emit_noise(k, c, k->order + quiet, put - quiet);
        quiet = put;
    }
}

void sink_put_weighed(Sink *k, const Crossing *c, uint32_t n) {
    group(k, c, n);
    emit_groups(k, c, NULL, n);
    sink_move(k, NULL);
}

void sink_put_missed(Sink *k, const Crossing *c, uint32_t n) {
    uint32_t missed = k->b->s->channels;
    group(k, c, n);
    for (uint32_t from = 0, to; from < n; from = to) {
        to = group_end(k, c, from, n);
        if (k->kind == SINK_REVERSE) emit_reverse(k, c, k->order + from, to - from, k->classes, 0);
        else emit_integral(k, c, k->order + from, to - from, missed, missed);
    }
    sink_move(k, NULL);
}

void sink_put_size(Sink *k, const Crossing *c, uint32_t n) {
    uint32_t size = SIZE_GROUP * k->b->s->channels;
    group(k, c, n);
    for (uint32_t from = 0, to; from < n; from = to) {
        to = group_end(k, c, from, n);
        if (k->kind == SINK_REVERSE) emit_reverse(k, c, k->order + from, to - from, SIZE_GROUP, 1);
        else emit_integral(k, c, k->order + from, to - from, size, size);
    }
    sink_move(k, NULL);
}

/* Half of how much two orders of boundaries differ belongs to the error: of a whole integral to sums of its own, of two
 * sets of lines, or four, so much to one and as much less to another, that this is what their spread says of it. */
#define OF_FOUR 0.6123724356957945

static void put_half(Sink *k, Crossing *c, uint32_t n) {
    uint32_t channels = k->b->s->channels;
    bool sets = k->kind == SINK_PARTS || (k->kind == SINK_REVERSE && (k->sizes || k->classes > 1));
    double part = k->kind == SINK_REVERSE && !k->sizes ? OF_FOUR : 1;
    if (k->kind == SINK_INTEGRAL) {
        group(k, c, n);
        for (uint32_t from = 0, to; from < n; from = to) {
            to = group_end(k, c, from, n);
            emit_integral(k, c, k->order + from, to - from, 2 * channels, 2 * channels);
        }
        sink_move(k, NULL);
    }
    for (uint32_t set = 0; set < 2 && sets; set++) {
        for (uint32_t i = 0; i < n; i++) c[i].cls = (uint8_t)set, c[i].weight *= set ? -1 : part;
        sink_put_weighed(k, c, n);
    }
}

/* What has become of crossings that were untied. */
static void put_parts(Sink *k) {
    const Coincide *q = &k->coincide;
    for (uint32_t from = 0; from < q->nparts; from += BATCH)
        sink_put_weighed(k, q->part + from, q->nparts - from < BATCH ? q->nparts - from : BATCH);
    for (uint32_t from = 0; from < q->nhalves; from += BATCH)
        put_half(k, q->half + from, q->nhalves - from < BATCH ? q->nhalves - from : BATCH);
}

/* Half of each crossing on a kink moves as g does where the parameters have gone forth, half as where they have gone
 * back; half of how much these differ is an error. */
static void put_kinks(Sink *k) {
    const Coincide *q = &k->coincide;
    for (uint32_t m = 0; m < UNTIE_WAYS; m++) {
        uint32_t n = q->kinks.n[m / 2];
        if (!n || !room(k, &k->doubt, &k->doubt_cap, n)) continue;
        Crossing *c = k->doubt;
        for (uint32_t i = 0; i < n; i++) {
            c[i] = q->kinks.at[m / 2][i], c[i].ga = c[i].gb = 0;
            c[i].apart = q->apart, c[i].move = (uint8_t)(1 + m);
        }
        n = coincide_weigh(k, c, n); /* g may be steeper, too, on one side */
        for (uint32_t i = 0; i < n; i++) c[i].weight *= 0.5;
        sink_put_weighed(k, c, n);
        for (uint32_t i = 0; i < n && m % 2; i++) c[i].weight = -c[i].weight;
        put_half(k, c, n);
    }
}

/* The sign of an edge where it is one of a band's two, whose g rise in opposite directions: what moves with the
 * parameters as one adds up, and is not what it takes from the other. */
static double side_of_band(const Crossing *c) {
    return c->dg[0] + 0.61803398874989485 * c->dg[1] + 0.38196601125010515 * c->dg[2] < 0 ? -1 : 1;
}

/* By how much jumps may be others, among the kept ones: as if all erred towards one sign. */
static void put_doubts(Sink *k, const Crossing *c, const bool *keep, uint32_t n) {
    uint32_t doubted = 0;
    for (uint32_t i = 0; i < n; i++) {
        const Crossing *x = &c[(uint32_t)k->order[i]];
        if (!keep[i] || !x->doubted || !room(k, &k->doubt, &k->doubt_cap, doubted + 1)) continue;
        Crossing *d = &k->doubt[doubted++];
        *d = *x;
        for (uint32_t ch = 0; ch < k->b->s->channels; ch++)
            d->jump[ch] = copysign(x->doubt[ch], x->weight * (x->narrow ? side_of_band(x) : 1));
    }
    if (!doubted) return;
    uint64_t order[BATCH];
    memcpy(order, k->order, n * sizeof *order);
    put_half(k, k->doubt, doubted);
    memcpy(k->order, order, n * sizeof *order);
}

void sink_take(void *sink, Crossing *c, uint32_t n) {
    Sink *k = sink;
    if (k->clip) n = clip(k, c, n);
    coincide_name(k, c, n);
    if (k->kind == SINK_KEEP) {
        keep_all(k, c, n);
        return;
    }
    bool keep[BATCH];
    group(k, c, n);
    for (uint32_t from = 0, to; from < n; from = to) {
        to = group_end(k, c, from, n);
        sink_weigh(k, c, k->order + from, to - from, keep + from);
        for (uint32_t i = from; i < to && k->follow; i++) {
            const Crossing *x = &c[(uint32_t)k->order[i]];
            if (keep[i] && x->edge) follow_note(k->follow, x);
        }
    }
    coincide_settle(k, c, k->order, keep, n);
    put_doubts(k, c, keep, n);
    kink_settle(k, c, k->order, keep, n);
    for (uint32_t i = 0; i < n && k->misses; i++) {
        const Crossing *x = &c[(uint32_t)k->order[i]];
        if (keep[i] && x->thin && room(k, &k->thin, &k->thin_cap, k->nthin + 1)) k->thin[k->nthin++] = *x;
    }
    emit_groups(k, c, keep, n);
    if (k->coincide.nparts) put_parts(k);
    put_kinks(k);
}

void sink_take_silent(void *sink, Crossing *c, uint32_t n) {
    Sink *k = sink;
    Finder *f = k->f;
    Finder before = *f; /* what cannot be weighed is no loss, for it would weigh nothing */
    double gone[SLT_MAX_CHANNELS];
    bool keep[BATCH];
    memcpy(gone, k->gone, sizeof gone);
    if (k->kind == SINK_KEEP) return;
    if (k->clip) n = clip(k, c, n);
    n = coincide_sift(k, c, n);
    f->lost = NULL;
    group(k, c, n);
    for (uint32_t from = 0, to; from < n; from = to) {
        to = group_end(k, c, from, n);
        sink_weigh(k, c, k->order + from, to - from, keep + from);
    }
    memcpy(f->dropped, before.dropped, sizeof f->dropped);
    memcpy(f->dropped_at, before.dropped_at, sizeof f->dropped_at);
    f->lost = before.lost, f->kept = before.kept, f->gone = before.gone;
    memcpy(k->gone, gone, sizeof gone);
    coincide_settle(k, c, k->order, keep, n);
    if (k->coincide.nparts) put_parts(k);
}
