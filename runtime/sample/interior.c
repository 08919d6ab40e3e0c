/* The smooth part: f and its derivatives at samples.
 *
 * A tile is a block of pixels (of an integral, a run of samples); its samples go through the kernels pixel by pixel, so
 * neighbouring lanes are neighbouring points. Derivatives are taken at the very samples of the image. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/geometry/geometry.h"
#include "runtime/sample/boundary.h"
#include "runtime/sample/walk.h"

enum { INTEGRAL_TILE = 8192, COLUMN = 8 /* pixels across */ };

static uint32_t half_count(const SltJob *j, uint32_t half) {
    uint32_t spp = j->spp && !j->centred ? j->spp : 1;
    if (half == 0) return spp;
    uint32_t first = (spp + 1) / 2;
    return half == 1 ? first : spp - first > 0 ? spp - first : 1;
}

/* Pixels along a side of a tile as large as a square one of side2. */
static uint32_t tile_side(const Run *r, uint32_t side2) {
    return r->grid.dim == 1 ? side2 * side2 : r->grid.dim == 2 ? side2 : side2 / 4;
}

/* Samples of one call lie in a block rather than in a row where a geometry tells of windows: what they see together is
 * looked for once. */
static bool in_columns(const Run *r) {
    if (r->grid.dim != 2 || prune_can(r->s)) return false;
    for (uint32_t g = 0; g < r->s->ngeometries; g++)
        if (r->s->geometries[g]->told) return true;
    return false;
}

static void plan(Interior *p, Run *r, uint32_t half, uint32_t side) {
    const Grid *g = &r->grid;
    const uint32_t column = in_columns(r) ? side / COLUMN : 1;
    p->run = r, p->half = half, p->count = half_count(r->j, half);
    p->ntiles = 1;
    for (uint32_t d = 0; d < 3; d++) {
        p->tile[d] = d >= g->dim ? 1 : d == 0 ? side / column : side * column;
        p->tiles[d] = (g->n[d] + p->tile[d] - 1) / p->tile[d];
        p->ntiles *= p->tiles[d];
    }
}

static TileRect rect_of(const Interior *p, uint64_t tile) {
    TileRect t = {.pixels = 1};
    for (uint32_t d = 0; d < 3; d++) {
        t.lo[d] = (uint32_t)(tile % p->tiles[d]) * p->tile[d];
        tile /= p->tiles[d];
        uint32_t left = p->run->grid.n[d] - t.lo[d];
        t.n[d] = left < p->tile[d] ? left : p->tile[d];
        t.pixels *= t.n[d];
    }
    return t;
}

static void select_cull(const Interior *p, Worker *w, const TileRect *t) {
    const Grid *g = &p->run->grid;
    double lo[3], hi[3], grow = g->filter == SLT_FILTER_BOX ? 0.01 : g->radius;
    for (uint32_t d = 0; d < 3; d++) {
        lo[d] = g->lo[d] + (t->lo[d] - grow) * g->side[d];
        hi[d] = g->lo[d] + (t->lo[d] + t->n[d] + grow) * g->side[d];
    }
    cull_select(&p->run->cull, &w->cull, &w->batch, lo, hi);
}

/* The lists of a tile, of strips of its rows: of as many as make a call worth its while. */
static bool narrow(const Interior *p, Worker *w, const TileRect *t) {
    enum { LANES = 256, ROWS = 4 };
    const Grid *g = &p->run->grid;
    const double grow = g->filter == SLT_FILTER_BOX ? 0.01 : g->radius;
    w->narrow.rows = 0;
    if (!w->narrow.note || g->dim != 2 || g->integral) return true;
    uint32_t strip = (t->n[1] + NARROW_ROWS - 1) / NARROW_ROWS, lanes = t->n[0] * p->count;
    if (strip < ROWS) strip = ROWS;
    while (strip < t->n[1] && strip * lanes < LANES) strip++;
    NarrowParts parts = {.rows = (t->n[1] + strip - 1) / strip, .samples = (uint64_t)t->n[1] * lanes};
    parts.x[0] = g->lo[0] + (t->lo[0] - grow) * g->side[0];
    parts.x[1] = g->lo[0] + (t->lo[0] + t->n[0] + grow) * g->side[0];
    for (uint32_t r = 0; r < parts.rows; r++) {
        parts.y[r][0] = g->lo[1] + (t->lo[1] + r * strip - grow) * g->side[1];
        parts.y[r][1] = g->lo[1] + (t->lo[1] + (r + 1) * strip + grow) * g->side[1];
    }
    w->strip = strip;
    return narrow_tile(&w->narrow, &w->batch, &parts);
}

/* The next strip of a tile, whose lists the batch gets; all of the tile where there are none. A strip of no pixels
 * comes before the first. */
static bool next_strip(Worker *w, const TileRect *t, TileRect *strip) {
    const bool begins = !strip->pixels, whole = !w->narrow.rows;
    const uint32_t from = begins ? 0 : strip->lo[1] + strip->n[1] - t->lo[1];
    if (whole || from >= t->n[1]) {
        *strip = *t;
        return whole && begins;
    }
    *strip = *t;
    strip->lo[1] += from, strip->n[1] = t->n[1] - from < w->strip ? t->n[1] - from : w->strip;
    strip->pixels = (uint64_t)strip->n[0] * strip->n[1];
    narrow_rows(&w->narrow, &w->batch, from / w->strip, from / w->strip);
    return true;
}

/* Where in an image a pixel of the tile is, given by its number in the walk. A tile has few pixels, and divisions of 32
 * bits are several times cheaper. */
static uint64_t image_index(const Interior *p, const TileRect *t, uint32_t pixel) {
    uint32_t row = pixel / t->n[0];
    return grid_index(&p->run->grid, t->lo[0] + pixel % t->n[0], t->lo[1] + row % t->n[1], t->lo[2] + row / t->n[1]);
}

/* ---- value */
/* One sample in the middle of each pixel, without random numbers: nothing to draw, nothing to add up. Fills up to BATCH
 * lanes with whole rows of rectangles, which are no longer than that, from `t` and `row` on; at[] is where in an image
 * they begin. */
typedef struct Rows {
    const TileRect *t, *end;
    uint32_t row, n;
    struct {
        uint64_t pixel;
        uint32_t n;
    } at[BATCH];
    /* what grid_middle is to fill.h */
    uint64_t start[BATCH + FILL_OVER];
    int32_t cell[BATCH + FILL_OVER];
} Rows;

/* Sets all but what fill_rows sets. */
static void begin_rows(Rows *k, const TileRect *t, uint32_t rects) {
    uint32_t widest = 0;
    k->t = t, k->end = t + rects, k->row = 0;
    for (uint32_t r = 0; r < rects; r++) widest = t[r].n[0] > widest ? t[r].n[0] : widest;
    assert(widest <= BATCH);
    for (uint32_t i = 0; i < widest + FILL_OVER; i++) k->start[i] = 1ull << 63;
}

/* Across a row of a rectangle. What the row below has is copied: a column has many short ones. */
static void fill_across(const Grid *g, Batch *b, Rows *k, const TileRect *t, uint32_t lanes, bool again) {
    const uint32_t n = t->n[0];
    if (again) {
        enum { BYTES = 2 * FILL_OVER }; /* short enough for FILL_OVER numbers, long enough for a column */
        const size_t size = n * (b->f64 ? sizeof(double) : sizeof(float));
        unsigned char *x = batch_row(b, SLT_IN_X0, lanes);
        for (size_t i = 0; i < size; i += BYTES) memcpy(x + i, x + i - size, BYTES);
    } else {
        const FillAxis across = {.lo = g->lo[0], .side = g->side[0], .f64 = b->f64};
        for (uint32_t i = 0; i < n; i++) k->cell[i] = (int32_t)(t->lo[0] + i);
        b->fill->place(&across, n, NULL, k->start, k->cell, batch_row(b, SLT_IN_X0, lanes));
    }
    if (batch_wants(b, SLT_IN_PIXEL0)) memcpy(batch_row_int(b, SLT_IN_PIXEL0, lanes), k->cell, n * sizeof *k->cell);
}

static uint32_t fill_rows(const Interior *p, Batch *b, Rows *k) {
    const Grid *g = &p->run->grid;
    uint32_t lanes = 0;
    const TileRect *last = NULL;
    for (k->n = 0; k->t < k->end && lanes + k->t->n[0] <= BATCH; k->n++) {
        const TileRect *t = k->t;
        const uint32_t deep = t->n[2] > 1 ? k->row / t->n[1] : 0, y = t->lo[1] + k->row - deep * t->n[1],
                       z = t->lo[2] + deep;
        const double middle[3] = {0, grid_middle(g, 1, y), g->dim > 2 ? grid_middle(g, 2, z) : 0};
        k->at[k->n].pixel = grid_index(g, t->lo[0], y, z), k->at[k->n].n = t->n[0];
        fill_across(g, b, k, t, lanes, t == last);
        last = t;
        for (uint32_t d = 1; d < g->dim; d++) batch_set_all(b, SLT_IN_X0 + d, lanes, t->n[0], middle[d]);
        if (batch_wants(b, SLT_IN_PIXEL1))
            for (uint32_t i = 0; i < t->n[0]; i++)
                batch_set_int(b, SLT_IN_PIXEL1, lanes + i, (int32_t)(g->n[1] - 1 - y));
        lanes += t->n[0];
        if (++k->row == t->n[1] * t->n[2]) k->t++, k->row = 0;
    }
    return lanes;
}

static bool only_middles(const Interior *p) { return p->run->j->centred && !p->run->s->uses_rand; }

static void put_row(float *to, uint32_t channels, const double *f, uint32_t n) {
    for (uint32_t x = 0; x < n; x++) to[x * channels] = (float)f[x];
}

static void put_row_f32(float *to, uint32_t channels, const float *f, uint32_t n) {
    if (channels == 1)
        for (uint32_t x = 0; x < n; x++) to[x] = f[x];
    else
        for (uint32_t x = 0; x < n; x++) to[x * channels] = f[x];
}

static void middle_samples(const Interior *p, Worker *w, SltKernelKind kernel, const TileRect *t, uint32_t rects) {
    Batch *b = &w->batch;
    uint32_t channels = p->run->s->channels, n;
    Rows k; /* `at` is long, and fill_rows sets it */
    begin_rows(&k, t, rects);
    while ((n = fill_rows(p, b, &k))) {
        batch_call(b, kernel, n);
        for (uint32_t c = 0; c < channels; c++) {
            const void *f = batch_out(b, SLT_OUT_F, c);
            for (uint32_t r = 0, i = 0; r < k.n; i += k.at[r++].n) {
                float *to = p->image + k.at[r].pixel * channels + c;
                if (b->f64) put_row(to, channels, (const double *)f + i, k.at[r].n);
                else put_row_f32(to, channels, (const float *)f + i, k.at[r].n);
            }
        }
    }
}

/* Adds the outputs of a batch to the pixels of its runs, which follow one another. */
static void add_samples(const Walk *k, const Batch *b, SltRole role, double *value) {
    const uint32_t channels = b->s->channels, *count = k->single ? NULL : k->count;
    for (uint32_t c = 0; c < channels; c++) {
        const void *f = batch_out(b, role, c);
        double *to = value + (uint64_t)k->first_pixel * channels + c;
        if (b->f64) b->fill->sum_f64(f, k->runs, count, to, channels);
        else b->fill->sum_f32(f, k->runs, count, to, channels);
    }
}

static bool value_samples(Interior *p, Worker *w, SltKernelKind kernel, const TileRect *t, uint32_t rects) {
    Batch *b = &w->batch;
    uint32_t channels = p->run->s->channels, n;
    uint64_t pixels = 0;
    if (only_middles(p)) {
        middle_samples(p, w, kernel, t, rects);
        return true;
    }
    for (uint32_t k = 0; k < rects; k++) pixels += t[k].pixels;
    if (!worker_values(w, pixels * channels)) return false;
    Walk k;
    for (walk_begin(&k, p, t, rects, 0); (n = walk_fill(&k, b));) {
        batch_call(b, kernel, n);
        add_samples(&k, b, SLT_OUT_F, w->value);
    }
    const double *v = w->value;
    for (; rects--; t++)
        for (uint32_t row = 0; row < t->n[1] * t->n[2]; row++, v += t->n[0] * channels)
            b->fill->mean(v, t->n[0] * channels, p->count, p->image + image_index(p, t, row * t->n[0]) * channels);
    return true;
}

/* Boxes of pixels of which only some chunks run: prune_image. */
typedef struct Pruning {
    Interior *p;
    Worker *w;
    bool failed;
} Pruning;

/* Most rows are of four pixels: no place to call memcpy. */
static void fill_row(float *o, uint32_t n, const float *value, uint32_t channels) {
    float first = value[0];
    for (uint32_t x = 0; x < n && channels == 1; x++) o[x] = first;
    for (uint32_t x = 0; x < n && channels > 1; x++)
        for (uint32_t c = 0; c < channels; c++) *o++ = value[c];
}

static void prune_constant(void *user, const PixelRect *r, const double *value) {
    const Pruning *q = user;
    const Interior *p = q->p;
    uint32_t channels = p->run->s->channels;
    float mean[SLT_MAX_CHANNELS];
    for (uint32_t c = 0; c < channels; c++) {
        double sum = 0; /* as it would be summed sample by sample */
        for (uint32_t i = 0; i < p->count; i++) sum += value[c];
        mean[c] = (float)(sum / p->count);
    }
    const Grid *g = &p->run->grid;
    for (uint32_t z = 0; z < r->n[2]; z++)
        for (uint32_t y = 0; y < r->n[1]; y++)
            fill_row(p->image + grid_index(g, r->lo[0], r->lo[1] + y, r->lo[2] + z) * channels, r->n[0], mean,
                     channels);
}

static void prune_sample(void *user, const PixelRect *r, uint32_t n, const SltPruned *pruned) {
    Pruning *q = user;
    TileRect t[SLT_CHOICE_BOXES];
    for (uint32_t k = 0; k < n; k++) {
        t[k].pixels = (uint64_t)r[k].n[0] * r[k].n[1] * r[k].n[2];
        memcpy(t[k].lo, r[k].lo, sizeof t->lo), memcpy(t[k].n, r[k].n, sizeof t->n);
    }
    batch_prune(&q->w->batch, pruned, NULL);
    q->failed |= !value_samples(q->p, q->w, SLT_K_PRUNED, t, n);
    batch_prune(&q->w->batch, NULL, NULL);
}

static bool value_pruned(Interior *p, Worker *w, const TileRect *t) {
    const Grid *g = &p->run->grid;
    if (!w->pruner.c && !prune_init(&w->pruner, p->run->s->chunks)) return false;
    Pruning q = {.p = p, .w = w};
    PruneImage image = {.dim = g->dim,
                        .reach = p->run->j->centred || g->filter == SLT_FILTER_BOX ? 0 : g->radius - 0.5,
                        .user = &q,
                        .constant = prune_constant,
                        .sample = prune_sample};
    PixelRect r;
    memcpy(image.lo, g->lo, sizeof image.lo), memcpy(image.side, g->side, sizeof image.side);
    memcpy(r.lo, t->lo, sizeof r.lo), memcpy(r.n, t->n, sizeof r.n);
    prune_image(&w->pruner, &w->batch, &image, &r);
    return !q.failed;
}

static bool value_work(void *user, uint32_t worker, uint64_t tile) {
    Interior *p = user;
    Worker *w = &p->run->worker[worker];
    TileRect t = rect_of(p, tile);
    select_cull(p, w, &t);
    if (prune_can(p->run->s)) return value_pruned(p, w, &t);
    TileRect strip = {0};
    bool fine = narrow(p, w, &t);
    while (fine && next_strip(w, &t, &strip)) {
        fine = value_samples(p, w, SLT_K_VALUE, &strip, 1);
        if (!p->other) continue;
        Interior second = *p;
        second.half = 2, second.count = half_count(p->run->j, 2), second.image = p->other;
        fine = fine && value_samples(&second, w, SLT_K_VALUE, &strip, 1);
    }
    return fine;
}

static void plain_merge(void *user, uint32_t worker, uint64_t tile) {
    Interior *p = user;
    TileRect t = rect_of(p, tile);
    p->run->stats.samples += t.pixels * (p->count + (p->other ? half_count(p->run->j, 2) : 0));
    run_collect(p->run, &p->run->worker[worker]);
}

static SltStatus make_image(Run *r, uint32_t half, float *image, float *other) {
    Interior p = {.image = image, .other = other, .classes = 1};
    plan(&p, r, half, prune_can(r->s) ? prune_tile(r->grid.dim, r->grid.n) : tile_side(r, 32));
    SltStatus st = run_workers(r, p.ntiles, 0, SINK_NONE);
    if (st == SLT_OK) st = run_tiles(r, p.ntiles, value_work, plain_merge, &p);
    run_free_workers(r);
    return st;
}

SltStatus interior_image(Run *r, uint32_t half, float *image) { return make_image(r, half, image, NULL); }

SltStatus interior_halves(Run *r, float *const image[2]) {
    if (!prune_can(r->s)) return make_image(r, 1, image[0], image[1]);
    SltStatus st = make_image(r, 1, image[0], NULL);
    return st == SLT_OK ? make_image(r, 2, image[1], NULL) : st;
}

/* ---- reverse */
/* Of channel c: the adjoint of its pixel, each sample's part of it. */
static void set_seeds(const Walk *k, Batch *b, uint32_t c, double part) {
    const uint32_t channels = b->s->channels;
    const float *a = k->p->adjoint + c;
    void *seed = batch_row(b, SLT_IN_SEED0 + c, 0);
    if (b->f64) {
        for (uint32_t r = 0, i = 0; r < k->runs; r++)
            for (uint32_t n = k->count[r]; n--; i++) ((double *)seed)[i] = part * (double)a[k->owner[r] * channels];
        return;
    }
    float spread[BATCH + FILL_OVER], *value = k->single ? seed : spread;
    for (uint32_t r = 0; r < k->runs; r++) value[r] = (float)(part * (double)a[k->owner[r] * channels]);
    if (!k->single) b->fill->spread(k->runs, k->count, value, 0, seed);
}

/* Are all pixels asked for? Then the walk makes batches of whole rows, if these fit in. */
static bool asks_for_rows(const Interior *p, const TileRect *t) {
    const Grid *g = &p->run->grid;
    const uint32_t channels = p->run->s->channels, n = t->n[0] * channels;
    uint32_t zeros = 0;
    if (!only_middles(p) || p->classes > 1 || (t->pixels > BATCH && BATCH % t->n[0])) return false;
    for (uint32_t z = 0; z < t->n[2] && !zeros; z++) {
        uint64_t at = grid_index(g, t->lo[0], t->lo[1], t->lo[2] + z) * channels;
        /* Rows go up, and each of a column is a line of memory of its own: nothing is decided before all are on their
         * way. */
        for (uint32_t y = 0; y < t->n[1]; y++, at -= (uint64_t)g->n[0] * channels)
            for (uint32_t i = 0; i < n; i++) zeros |= p->adjoint[at + i] == 0;
    }
    return !zeros;
}

static void seed_row(void *seed, bool f64, const float *adjoint, uint32_t channels, uint32_t n, double part) {
    if (f64)
        for (uint32_t x = 0; x < n; x++) ((double *)seed)[x] = part * (double)adjoint[x * channels];
    else if (channels == 1)
        for (uint32_t x = 0; x < n; x++) ((float *)seed)[x] = (float)(part * (double)adjoint[x]);
    else
        for (uint32_t x = 0; x < n; x++) ((float *)seed)[x] = (float)(part * (double)adjoint[x * channels]);
}

static void reverse_middles(const Interior *p, Worker *w, const TileRect *t, double part, uint32_t half) {
    Batch *b = &w->batch;
    const uint32_t channels = p->run->s->channels;
    uint32_t n;
    Rows k;
    for (begin_rows(&k, t, 1); (n = fill_rows(p, b, &k));) {
        for (uint32_t c = 0; c < channels; c++)
            for (uint32_t r = 0, i = 0; r < k.n; i += k.at[r++].n)
                seed_row(batch_row(b, SLT_IN_SEED0 + c, i), b->f64, p->adjoint + k.at[r].pixel * channels + c, channels,
                         k.at[r].n, part);
        accum_call(&w->acc, b, SLT_K_VJP, n, p->parts_of.pairs ? half : 0);
    }
}

static void reverse_samples(const Interior *p, Worker *w, const TileRect *t, double factor, uint32_t half) {
    Batch *b = &w->batch;
    uint32_t channels = p->run->s->channels, n;
    if (asks_for_rows(p, t)) {
        reverse_middles(p, w, t, factor / p->count, half);
        return;
    }
    for (uint32_t cls = 0; cls < p->classes; cls++) {
        Walk k;
        for (walk_begin(&k, p, t, 1, cls); (n = walk_fill(&k, b));) {
            for (uint32_t c = 0; c < channels; c++) set_seeds(&k, b, c, factor / p->count);
            accum_call(&w->acc, b, SLT_K_VJP, n, p->parts_of.pairs ? 2 * cls + half : cls);
        }
    }
}

static void hold(const SltScene *s, bool on) {
    for (uint32_t g = 0; g < s->ngeometries; g++) geometry_hold(s->geometries[g], on);
}

/* The image of a tile, and what the loss weighs it with. */
static bool value_and_adjoint(const Interior *p, Worker *w, const TileRect *t) {
    const PixelLoss *loss = p->loss;
    const Grid *g = &p->run->grid;
    const uint32_t channels = p->run->s->channels;
    const double numbers = (double)g->pixels * channels;
    Interior own = {.run = p->run, .count = p->count, .image = loss->image, .classes = 1};
    if (!value_samples(&own, w, SLT_K_VALUE, t, 1)) return false;
    for (uint32_t row = 0; row < t->n[1] * t->n[2]; row++) {
        const uint64_t at = image_index(p, t, row * t->n[0]) * channels;
        for (uint64_t i = at; i < at + (uint64_t)t->n[0] * channels; i++)
            loss->adjoint[i] = pixel_loss_adjoint((double)loss->image[i] - (double)loss->target[i],
                                                  loss->mask ? (double)loss->mask[i] : 1, numbers);
    }
    return true;
}

static bool reverse_tile(const Interior *p, Worker *w, TileRect t) {
    select_cull(p, w, &t);
    if (p->loss) {
        hold(p->run->s, true);
        const bool fine = value_and_adjoint(p, w, &t);
        w->batch.again = true;
        if (fine) reverse_samples(p, w, &t, 1, 0);
        w->batch.again = false;
        hold(p->run->s, false);
        accum_close(&w->acc);
        return fine && !w->acc.failed;
    }
    TileRect strip = {0};
    if (!narrow(p, w, &t)) return false;
    while (!p->halves[1] && next_strip(w, &t, &strip)) reverse_samples(p, w, &strip, 1, 0);
    for (uint32_t h = 0; h < 2 && p->halves[1]; h++) {
        Interior own = *p;
        own.half = h + 1, own.count = half_count(p->run->j, own.half), own.adjoint = p->halves[h];
        strip.pixels = 0;
        while (next_strip(w, &t, &strip)) reverse_samples(&own, w, &strip, 0.5, h);
    }
    accum_close(&w->acc);
    return !w->acc.failed;
}

static bool reverse_work(void *user, uint32_t worker, uint64_t tile) {
    const Interior *p = user;
    Worker *w = &p->run->worker[worker];
    bool fine;
    accum_begin(&w->acc, &w->batch);
    do fine = reverse_tile(p, w, rect_of(p, tile));
    while (accum_again(&w->acc, &w->batch));
    return fine;
}

static void reverse_merge(void *user, uint32_t worker, uint64_t tile) {
    Interior *p = user;
    Accum *a = &p->run->worker[worker].acc;
    if (p->parts) parts_merge(p->parts, a, &p->parts_of, p->targets);
    else accum_merge(a, p->targets);
    plain_merge(user, worker, tile);
}

/* Parameters by which goes what a tile costs besides its samples. Vertices have the log, a short one lies in a cache.
 */
static uint32_t summed(const Run *r) {
    const SltScene *s = r->s;
    if (!s->dense || !in_columns(r)) return s->nfloats;
    uint32_t n = 0;
    for (uint32_t p = 0; p < s->nfloats; p++) n += s->dense[p];
    return n;
}

SltStatus interior_reverse(Run *r, const float *const adjoint[2], uint32_t classes, double *const *targets,
                           Parts *parts, PartsOf of, const PixelLoss *loss) {
    if (!r->s->kernel[SLT_K_VJP]) return SLT_OK;
    Interior p = {
        .adjoint = adjoint[0], .loss = loss, .classes = classes, .targets = targets, .parts = parts, .parts_of = of};
    if (adjoint[0] != adjoint[1]) p.halves[0] = adjoint[0], p.halves[1] = adjoint[1];
    const bool many = summed(r) > 1u << 14 && !r->s->ncull;
    plan(&p, r, 0, tile_side(r, many ? 64 : 32));
    SltStatus st = run_workers(r, p.ntiles, of.pairs ? 2 * of.pairs : classes, SINK_NONE);
    if (st == SLT_OK) st = run_tiles(r, p.ntiles, reverse_work, reverse_merge, &p);
    run_free_workers(r);
    return st;
}

/* ---- forward */
static bool forward_work(void *user, uint32_t worker, uint64_t tile) {
    Interior *p = user;
    Worker *w = &p->run->worker[worker];
    Batch *b = &w->batch;
    TileRect t = rect_of(p, tile);
    uint32_t channels = p->run->s->channels, n;
    uint64_t plane = t.pixels * channels;
    if (!worker_values(w, plane * p->dirs->n)) return false;
    select_cull(p, w, &t);
    Walk k;
    for (walk_begin(&k, p, &t, 1, 0); (n = walk_fill(&k, b));)
        for (uint32_t d = 0; d < p->dirs->n; d++) {
            b->args.dparams = p->dirs->flt[d];
            b->again = d > 0;
            batch_call(b, SLT_K_JVP, n);
            add_samples(&k, b, SLT_OUT_DF, w->value + d * plane);
        }
    for (uint32_t d = 0; d < p->dirs->n; d++)
        for (uint32_t i = 0; i < t.pixels; i++) {
            float *o = p->out[d] + image_index(p, &t, i) * channels;
            for (uint32_t c = 0; c < channels; c++) o[c] = (float)(w->value[d * plane + i * channels + c] / p->count);
        }
    return true;
}

SltStatus interior_forward(Run *r, const Directions *dirs, float *const *out) {
    if (!r->s->kernel[SLT_K_JVP]) return SLT_OK;
    Interior p = {.dirs = dirs, .out = out, .classes = 1};
    plan(&p, r, 0, tile_side(r, 32));
    SltStatus st = run_workers(r, p.ntiles, 0, SINK_NONE);
    if (st == SLT_OK) st = run_tiles(r, p.ntiles, forward_work, plain_merge, &p);
    run_free_workers(r);
    return st;
}

/* ---- integral */
typedef struct Total {
    Run *run;
    uint64_t samples, tiles; /* of each replicate */
    double weight;           /* of a sample: volume / samples */
    double *value, *to;      /* [replicates][channels], [replicates][channels][nfloats] */
    bool gradient, both;     /* both: values come from the reverse kernel */
    Tails *tails;            /* NULL: not wanted */
} Total;

/* The samples of a tile, *from .. *to - 1 of its replicate. */
static uint64_t replicate_of(const Total *p, uint64_t tile, uint64_t *from, uint64_t *to) {
    *from = tile % p->tiles * INTEGRAL_TILE;
    *to = *from + INTEGRAL_TILE < p->samples ? *from + INTEGRAL_TILE : p->samples;
    return tile / p->tiles;
}

static bool total_tile(const Total *p, Worker *w, uint64_t tile) {
    Batch *b = &w->batch;
    const SltScene *s = p->run->s;
    uint64_t from, to, replicate = replicate_of(p, tile, &from, &to);
    double weight[BATCH];
    Pattern pattern;
    pattern_init(&pattern, s, p->run->j->seed, RNG_INTEGRAL, 0, replicate);
    if (!worker_values(w, s->channels)) return false;
    b->args.cull = NULL;
    bool tails = p->gradient && p->tails;
    uint32_t call = tails ? TAIL_CALL : BATCH;
    if (tails && !tails_begin(p->tails, &w->tail, INTEGRAL_TILE / TAIL_CALL)) return false;
    for (uint64_t at = from; at < to;) {
        uint32_t n = to - at < call ? (uint32_t)(to - at) : call;
        walk_integral(b, &pattern, at, n);
        at += n;
        if (!p->gradient) {
            batch_call(b, SLT_K_VALUE, n);
            for (uint32_t c = 0; c < s->channels; c++)
                for (uint32_t i = 0; i < n; i++) w->value[c] += batch_get(b, SLT_OUT_F, c, i);
            continue;
        }
        for (uint32_t i = 0; i < n; i++) weight[i] = p->weight;
        b->again = !p->both;
        accum_rows(&w->acc, b, weight, n, 0);
        if (tails && n == TAIL_CALL) tails_take(p->tails, &w->tail, &w->acc);
        for (uint32_t c = 0; p->both && c < s->channels; c++) /* the reverse kernel gives f as well */
            for (uint32_t i = 0; i < n; i++) w->value[c] += batch_get(b, SLT_OUT_F, c, i);
    }
    accum_close(&w->acc);
    return !w->acc.failed;
}

static bool total_work(void *user, uint32_t worker, uint64_t tile) {
    const Total *p = user;
    Worker *w = &p->run->worker[worker];
    bool fine;
    if (!p->gradient) return total_tile(p, w, tile);
    accum_begin(&w->acc, &w->batch);
    do fine = total_tile(p, w, tile);
    while (accum_again(&w->acc, &w->batch));
    return fine;
}

static void total_merge(void *user, uint32_t worker, uint64_t tile) {
    Total *p = user;
    Worker *w = &p->run->worker[worker];
    const SltScene *s = p->run->s;
    uint64_t from, to, first = replicate_of(p, tile, &from, &to) * s->channels;
    double *targets[SLT_MAX_CHANNELS];
    for (uint32_t c = 0; c < s->channels && p->gradient; c++) targets[c] = p->to + (first + c) * s->nfloats;
    if (p->gradient) accum_merge(&w->acc, targets);
    if (p->gradient && p->tails) tails_merge(p->tails, &w->tail);
    if (!p->gradient || p->both)
        for (uint32_t c = 0; c < s->channels; c++) p->value[first + c] += p->weight * w->value[c];
    if (!p->gradient || p->both) p->run->stats.samples += to - from;
    run_collect(p->run, w);
}

bool interior_is_small(const Run *r, uint32_t replicates, uint64_t samples) {
    return samples <= INTEGRAL_TILE && !run_is_long(r, (double)samples * replicates);
}

SltStatus interior_integral(Run *r, uint32_t replicates, uint64_t samples, double *value, double *gradient,
                            Tails *tails) {
    const SltScene *s = r->s;
    Total p = {.run = r, .samples = samples ? samples : 1, .value = value, .to = gradient};
    if (tails_wanted(tails)) p.tails = tails;
    double volume = 1;
    for (uint32_t d = 0; d < s->dim; d++) volume *= s->hi[d] - s->lo[d];
    p.weight = volume / (double)p.samples;
    p.tiles = (p.samples + INTEGRAL_TILE - 1) / INTEGRAL_TILE;
    const uint64_t tiles = p.tiles * replicates, most = interior_is_small(r, replicates, p.samples) ? 1 : tiles;
    /* What a shader prints comes from the value kernel. */
    p.both = value && gradient && s->kernel[SLT_K_VJP] && scene_outputs(s, SLT_K_VJP, SLT_OUT_F) && !s->print;
    for (int pass = value && !p.both ? 0 : 1; pass < (gradient && s->kernel[SLT_K_VJP] ? 2 : 1); pass++) {
        p.gradient = pass == 1;
        r->most = p.gradient && p.tails ? TAIL_CALL : p.samples < BATCH ? (uint32_t)p.samples : BATCH;
        SltStatus st = run_workers(r, most, p.gradient ? s->channels : 0, SINK_NONE);
        r->most = 0;
        if (st == SLT_OK) st = run_tiles(r, tiles, total_work, total_merge, &p);
        run_free_workers(r);
        if (st != SLT_OK) return st;
    }
    return SLT_OK;
}
