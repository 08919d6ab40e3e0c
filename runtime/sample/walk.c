/* Samples of pixels, and of the domain as one. */
#include <string.h>

#include "runtime/sample/walk.h"

enum { CHUNK = 64 }; /* runs that are filled together */

/* The runs that come next: their pixels, and which sample is the first. */
typedef struct Chunk {
    uint32_t n, lanes;
    bool later; /* some begin behind sample 0 */
    int32_t cell[3][CHUNK + FILL_OVER];
    uint64_t first[CHUNK + FILL_OVER];
    uint32_t half[CHUNK + FILL_OVER]; /* of the walk, for each */
} Chunk;

/* Sets all but the runs. */
void walk_begin(Walk *k, const Interior *p, const TileRect *t, uint32_t n, uint32_t cls) {
    k->p = p, k->t = t, k->end = t + n, k->cls = cls;
    k->pixel = k->sample = k->runs = 0;
    memcpy(k->at, t->lo, sizeof k->at);
}

static void next_pixels(Walk *k, uint32_t n) {
    const TileRect *t = k->t;
    k->pixel += n, k->sample = 0, k->at[0] += n - 1;
    for (uint32_t d = 0; d < 3; d++) {
        if (++k->at[d] < t->lo[d] + t->n[d]) return;
        k->at[d] = t->lo[d];
    }
    if (++k->t < k->end) memcpy(k->at, k->t->lo, sizeof k->at);
}

/* What no adjoint asks for is not run: where f is NaN, 0 times its derivative would be NaN as well. */
static bool asked(const Interior *p, uint64_t pixel) {
    if (!p->adjoint) return true;
    uint32_t channels = p->run->s->channels;
    const float *a = p->adjoint + pixel * channels;
    for (uint32_t c = 0; c < channels; c++)
        if (a[c] != 0) return true;
    return false;
}

/* Samples from one of a run to the next. */
static uint32_t stride_of(const Interior *p) { return p->classes > 1 && !p->parts_of.pairs ? COSETS : 1; }

/* The next pixels of a row that are in the coset and asked for, with their samples that are; at most `room` of them. */
static void take_some(Walk *k, Chunk *c, uint32_t room) {
    const Interior *p = k->p;
    const uint64_t row = grid_index(&p->run->grid, 0, k->at[1], k->at[2]);
    const uint32_t stride = stride_of(p), other = 2 * k->at[1] + k->at[2], end = k->t->lo[0] + k->t->n[0];
    const bool pairs = p->classes > 1 && stride == 1;
    uint32_t x = k->at[0];
    while (x < end && c->n < CHUNK && room) {
        const uint32_t own = k->cls - x - other;
        uint32_t first = k->sample + (stride > 1 ? (own - k->sample) & (COSETS - 1) : 0);
        if (pairs && own & (COSETS - 1)) {
            x += own & (COSETS - 1);
            continue;
        }
        if (first >= p->count || !asked(p, row + x)) {
            x++, k->sample = 0;
            continue;
        }
        const uint32_t all = (p->count - first + stride - 1) / stride, n = all < room ? all : room, r = k->runs + c->n;
        k->owner[r] = row + x, k->count[r] = n;
        c->cell[0][c->n] = (int32_t)x, c->cell[1][c->n] = (int32_t)k->at[1], c->cell[2][c->n] = (int32_t)k->at[2];
        c->later |= first > 0, c->first[c->n++] = first, c->lanes += n, room -= n;
        if (n < all) k->sample = first + n * stride;
        else x++, k->sample = 0;
    }
    const uint32_t sample = k->sample, done = (x < end ? x : end) - k->at[0];
    if (done) next_pixels(k, done), k->sample = sample;
}

/* How many of the next n pixels of the row are asked for, up to the first that is not. */
static uint32_t asked_from(const Walk *k, uint32_t n) {
    if (!k->p->adjoint) return n;
    const uint64_t first = grid_index(&k->p->run->grid, k->at[0], k->at[1], k->at[2]);
    const uint32_t channels = k->p->run->s->channels;
    uint32_t i = 0;
    if (channels == 1) { /* mostly all are, which nothing needs to be decided for */
        uint32_t zeros = 0;
        for (uint32_t x = 0; x < n; x++) zeros |= k->p->adjoint[first + x] == 0;
        if (!zeros) return n;
    }
    while (i < n && asked(k->p, first + i)) i++;
    return i;
}

/* The next n pixels of a row with all their samples. */
static void take_row(Walk *k, Chunk *c, uint32_t n) {
    const uint64_t owner = grid_index(&k->p->run->grid, k->at[0], k->at[1], k->at[2]);
    const uint32_t r = k->runs + c->n, samples = k->p->count;
    uint64_t *restrict owners = k->owner + r;
    for (uint32_t i = 0; i < n; i++) owners[i] = owner + i;
    uint32_t *restrict counts = k->count + r;
    for (uint32_t i = 0; i < n; i++) counts[i] = samples;
    for (uint32_t d = 0; d < k->p->run->grid.dim; d++) {
        int32_t *restrict cells = c->cell[d] + c->n;
        const int32_t first = (int32_t)k->at[d];
        for (uint32_t i = 0; i < n; i++) cells[i] = first + (d ? 0 : (int32_t)i);
    }
    c->n += n, c->lanes += n * samples;
    next_pixels(k, n);
}

static void take(Walk *k, Chunk *c, uint32_t room) {
    const Interior *p = k->p;
    const bool plain = p->classes == 1;
    if (c->later) memset(c->first, 0, sizeof c->first);
    c->n = c->lanes = 0, c->later = false;
    while (c->n < CHUNK && c->lanes < room && k->t < k->end) {
        uint32_t n = k->t->lo[0] + k->t->n[0] - k->at[0], whole = plain ? (room - c->lanes) / p->count : 0;
        if (n > whole) n = whole;
        if (n > CHUNK - c->n) n = CHUNK - c->n;
        if (n && !k->sample) n = asked_from(k, n);
        if (n && !k->sample) take_row(k, c, n);
        else take_some(k, c, room - c->lanes);
    }
}

/* Where runs of a batch begin. */
typedef struct Place {
    Batch *b;
    uint32_t lane, runs;
    const uint32_t *count;
    bool single; /* every run is one sample */
} Place;

/* Coordinate d of the pattern, as positions. */
static void place_axis(const Place *at, uint32_t d, const uint64_t *start, uint64_t step, const int32_t *cell) {
    Batch *b = at->b;
    const Grid *g = b->grid;
    const uint32_t *count = at->single ? NULL : at->count;
    FillAxis a = {.lo = g->lo[d], .side = g->side[d], .step = step, .f64 = b->f64};
    void *x = batch_row(b, SLT_IN_X0 + d, at->lane);
    if (g->mass[d] && step)
        a.filter = g->filter, a.radius = g->radius, a.n = g->n[d], a.before = g->before[d], a.mass = g->mass[d];
    b->fill->place(&a, at->runs, count, start, cell, x);
}

/* Number 0 of the streams, as batch_set_stream has it: rounding to a float is monotonic, so the bound may come after.
 */
static void place_rand0(const Place *at, uint32_t lanes, const uint64_t *start, uint64_t step) {
    static const int32_t first[CHUNK + FILL_OVER];
    Batch *b = at->b;
    const FillAxis a = {.side = 1, .step = step, .f64 = b->f64};
    void *x = batch_row(b, SLT_IN_RAND0, at->lane);
    b->fill->place(&a, at->runs, at->single ? NULL : at->count, start, first, x);
    if (b->f64) {
        double *v = x;
        for (uint32_t i = 0; i < lanes; i++) v[i] = v[i] < 0x1.fffffep-1 ? v[i] : 0x1.fffffep-1;
    } else {
        float *v = x;
        for (uint32_t i = 0; i < lanes; i++) v[i] = v[i] < 0x1.fffffep-1f ? v[i] : 0x1.fffffep-1f;
    }
}

static void spread(const Place *at, uint32_t slot, const uint32_t *value, uint32_t step) {
    if (batch_wants(at->b, slot))
        at->b->fill->spread(at->runs, at->count, value, step, batch_row_int(at->b, slot, at->lane));
}

static void fill_chunk(const Walk *k, Batch *b, const Chunk *c, uint32_t lane) {
    const Run *run = k->p->run;
    const Grid *g = b->grid;
    const uint32_t dim = g->dim, stride = stride_of(k->p), n = c->n;
    const bool rand = run->s->uses_rand, centred = run->j->centred;
    const uint32_t dims = dim + rand;
    const Place at = {b, lane, n, k->count + k->runs, c->lanes == n};
    uint64_t words[2][CHUNK + FILL_OVER], start[CHUNK + FILL_OVER];
    uint32_t value[CHUNK + FILL_OVER];
    if (rand || !centred)
        b->fill->blocks(run->j->seed, RNG_PIXEL, n, c->half, k->owner + k->runs,
                        (uint64_t *const[]){words[0], words[1]});
    for (uint32_t d = 0; d < dims; d++) {
        const uint64_t ratio = rng_ratio[dims - 1][d], *w = words[d / 2];
        const bool middle = centred && d < dim;
        if (!batch_wants(b, d < dim ? SLT_IN_X0 + d : SLT_IN_RAND0)) continue;
        if (middle)
            for (uint32_t i = 0; i < n; i++) start[i] = 1ull << 63;
        else if (d % 2)
            for (uint32_t i = 0; i < n; i++) start[i] = fill_start((uint32_t)(w[i] >> 32), 0, 0);
        else
            for (uint32_t i = 0; i < n; i++) start[i] = fill_start((uint32_t)w[i], 0, 0);
        if (c->later && !middle)
            for (uint32_t i = 0; i < n; i++) start[i] += c->first[i] * ratio;
        if (d < dim) place_axis(&at, d, start, middle ? 0 : stride * ratio, c->cell[d]);
        else place_rand0(&at, c->lanes, start, stride * ratio);
    }
    spread(&at, SLT_IN_PIXEL0, (const uint32_t *)c->cell[0], 0);
    if (batch_wants(b, SLT_IN_PIXEL1))
        for (uint32_t i = 0; i < n; i++) value[i] = g->n[1] - 1 - (dim > 1 ? (uint32_t)c->cell[1][i] : 0);
    spread(&at, SLT_IN_PIXEL1, value, 0);
    if (batch_wants(b, SLT_IN_SAMPLE))
        for (uint32_t i = 0; i < n; i++) value[i] = (uint32_t)c->first[i];
    spread(&at, SLT_IN_SAMPLE, value, stride);
    if (rand && batch_wants(b, SLT_IN_STREAM)) {
        const FillStreams s = {.seed = run->j->seed, .lane = k->p->half, .stride = stride, .purpose = RNG_PIXEL};
        fill_streams(b->fill, &s, n, at.single ? NULL : at.count, k->owner + k->runs, c->first,
                     batch_row_int(b, SLT_IN_STREAM, lane));
    }
}

uint32_t walk_fill(Walk *k, Batch *b) {
    Chunk c; /* long, and set as it is used */
    uint32_t n = 0;
    c.later = true;
    for (uint32_t i = 0; i < CHUNK + FILL_OVER; i++) c.half[i] = k->p->half;
    k->runs = 0, k->first_pixel = k->pixel;
    while (n < BATCH && k->t < k->end) {
        take(k, &c, BATCH - n);
        if (!c.n) break;
        fill_chunk(k, b, &c, n);
        k->runs += c.n, n += c.lanes;
    }
    k->single = n == k->runs;
    return n;
}

void walk_integral(Batch *b, const Pattern *p, uint64_t from, uint32_t n) {
    const uint32_t dim = b->grid->dim;
    const Place at = {b, 0, 1, &n, false};
    const int32_t cell[1 + FILL_OVER] = {0};
    const uint32_t first = (uint32_t)from;
    for (uint32_t d = 0; d < p->dims; d++) {
        const uint64_t ratio = rng_ratio[p->dims - 1][d], start = fill_start(p->shift[d], ratio, from);
        if (!batch_wants(b, d < dim ? SLT_IN_X0 + d : SLT_IN_RAND0)) continue;
        if (d < dim) place_axis(&at, d, &start, ratio, cell);
        else place_rand0(&at, n, &start, ratio);
    }
    spread(&at, SLT_IN_SAMPLE, &first, 1);
    if (p->dims > dim && batch_wants(b, SLT_IN_STREAM)) {
        const FillStreams s = {.seed = p->seed, .lane = p->lane, .stride = 1, .purpose = p->purpose};
        fill_streams(b->fill, &s, 1, &n, &p->owner, &from, batch_row_int(b, SLT_IN_STREAM, 0));
    }
}
