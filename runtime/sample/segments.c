/* Random segments: snap-crofton (a constant weight by Cauchy and Crofton) and snap-knn (the weights of Belhe et al.:
 * nearest-neighbour densities). For comparison: their error falls with the square root of the number of crossings.
 *
 * snap-crofton: n segments of length L, centres stratified over the domain padded by L/2, uniform directions, weight
 * |padded domain| / (n L c_d) with c_d the mean of |cos|: unbiased. The densities of snap-knn are consistent only for a
 * number of neighbours that grows with n: about one per cent of bias stays on a circle, more near borders. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/boundary.h"
#include "runtime/sample/search.h"

enum { CHUNK = 4096, NEIGHBOURS = 14, NEIGHBOURS_MOST = 64 };

typedef struct Snap {
    Boundary *y;
    bool knn;
    double lo[3], side[3], length, weight;
    uint32_t m[3];
    uint64_t n;
    Crossing *all;
    uint64_t nall, cap;
    bool failed;
} Snap;

static double mean_cosine(uint32_t dim) {
    /* By dimension d, Gamma(d/2) / (sqrt(pi) Gamma((d+1)/2)): the mean over directions. */
    static const double c[4] = {0, 1, 0.63661977236758134, 0.5};
    return c[dim];
}

static void draw(const Snap *k, uint64_t i, Segment *s) {
    const SltScene *scene = k->y->run->s;
    uint32_t r[4], q[4], seed = k->y->run->j->seed;
    rng_block(seed, RNG_SEGMENT, k->y->replicate * 2, i, r);
    rng_block(seed, RNG_SEGMENT, k->y->replicate * 2 + 1, i, q);
    double dir[3] = {1, 0, 0}, angle = 6.283185307179586 * rng_unit(q[0]);
    if (scene->dim == 2) dir[0] = cos(angle), dir[1] = sin(angle);
    if (scene->dim == 3) {
        double z = 2 * rng_unit(q[1]) - 1, rho = sqrt(fmax(0, 1 - z * z));
        dir[0] = rho * cos(angle), dir[1] = rho * sin(angle), dir[2] = z;
    }
    uint64_t rest = i;
    memset(s, 0, sizeof *s);
    for (uint32_t d = 0; d < scene->dim; d++) {
        double x = k->lo[d] + (rest % k->m[d] + rng_unit(r[d])) / k->m[d] * k->side[d];
        rest /= k->m[d];
        s->a[d] = x - 0.5 * k->length * dir[d], s->b[d] = x + 0.5 * k->length * dir[d];
    }
    s->ta = 0, s->tb = 1, s->axis = -1, s->base = k->weight;
    s->stream = scene->uses_rand ? (int32_t)q[2] : 0, s->rand0 = rng_unit(q[3]);
    s->cls = k->y->classes > 1 ? (uint8_t)(i & 3) : 0;
}

static bool work(void *user, uint32_t worker, uint64_t tile) {
    Snap *k = user;
    Worker *w = &k->y->run->worker[worker];
    Batch *b = &w->batch;
    uint64_t from = tile * CHUNK, to = from + CHUNK < k->n ? from + CHUNK : k->n;
    Segment seg[FIND];
    w->finder.halve_only = k->knn;
    w->sink.clip = true;
    if (w->sink.kind == SINK_FORWARD && !sink_rect(&w->sink, k->y->run->s->lo, k->y->run->s->hi)) return false;
    for (uint64_t i = from; i < to;) {
        uint32_t n = to - i < FIND ? (uint32_t)(to - i) : FIND;
        for (uint32_t l = 0; l < n; l++, i++) {
            draw(k, i, &seg[l]);
            batch_set_x(b, 2 * l, seg[l].a), batch_set_x(b, 2 * l + 1, seg[l].b);
            batch_set_stream(b, 2 * l, seg[l].stream, seg[l].rand0),
                batch_set_stream(b, 2 * l + 1, seg[l].stream, seg[l].rand0);
        }
        batch_call(b, SLT_K_REGION, 2 * n);
        const uint32_t *hash = batch_out(b, SLT_OUT_HASH, 0);
        double threshold = HUGE_VAL;
        if (batch_has(b, SLT_OUT_DEPTH)) {
            Spread spread;
            spread_clear(&spread);
            for (uint32_t l = 0; l < 2 * n; l += 2)
                if (hash[l] == hash[l + 1])
                    spread_add(&spread, batch_get(b, SLT_OUT_DEPTH, 0, l) - batch_get(b, SLT_OUT_DEPTH, 0, l + 1));
            threshold = spread_threshold(&spread);
        }
        for (uint32_t l = 0; l < n; l++) {
            Mark ma = batch_mark(b, 2 * l), mb = batch_mark(b, 2 * l + 1);
            if (search_differ(ma, mb, threshold)) finder_add(&w->finder, &seg[l], ma, mb, threshold);
        }
        w->finder.segments += n;
        finder_run(&w->finder, false);
    }
    finder_run(&w->finder, true);
    accum_close(&w->acc);
    return !(w->finder.failed || w->sink.failed || w->acc.failed);
}

static void merge(void *user, uint32_t worker, uint64_t tile) {
    Snap *k = user;
    Worker *w = &k->y->run->worker[worker];
    (void)tile;
    if (w->sink.kind == SINK_KEEP) {
        if (k->nall + w->sink.nkept > k->cap) {
            uint64_t cap = 2 * (k->nall + w->sink.nkept);
            Crossing *more = realloc(k->all, cap * sizeof *more);
            if (!more) k->failed = true;
            else k->all = more, k->cap = cap;
        }
        if (!k->failed) {
            if (w->sink.nkept) memcpy(k->all + k->nall, w->sink.kept, w->sink.nkept * sizeof *k->all);
            k->nall += w->sink.nkept;
        }
        w->sink.nkept = 0;
        run_collect(k->y->run, w);
        return;
    }
    boundary_merge(k->y, w);
}

/* ---- nearest neighbours among the crossings of the same site: sorted by site and x, scanned outwards until x alone is
 * too far */
static int by_place(const void *pa, const void *pb) {
    const Crossing *a = pa, *b = pb;
    if (a->event.site != b->event.site) return a->event.site < b->event.site ? -1 : 1;
    for (int d = 0; d < 3; d++)
        if (a->x[d] != b->x[d]) return a->x[d] < b->x[d] ? -1 : 1;
    return 0;
}

static double distance2(const Crossing *a, const Crossing *b) {
    double r = 0;
    for (int d = 0; d < 3; d++) r += (a->x[d] - b->x[d]) * (a->x[d] - b->x[d]);
    return r;
}

static void insert(double *best, uint32_t *n, uint32_t k, double r2) {
    if (*n == k && r2 >= best[k - 1]) return;
    uint32_t at = *n < k ? (*n)++ : k - 1;
    for (; at > 0 && best[at - 1] > r2; at--) best[at] = best[at - 1];
    best[at] = r2;
}

static double knn_weight(const Snap *s, uint64_t i, uint64_t from, uint64_t to) {
    const Crossing *c = &s->all[i];
    uint32_t dim = s->y->run->s->dim, n = 0;
    if (dim == 1) {
        /* In 1D a boundary is a point, which has no density: the crossings that found the same one have equal shares.
         */
        uint32_t same = 0;
        for (uint64_t j = from; j < to; j++) same += fabs(s->all[j].x[0] - c->x[0]) <= s->length * 0x1p-10;
        return 1.0 / same;
    }
    uint32_t k = s->y->run->s->neighbours ? s->y->run->s->neighbours : NEIGHBOURS;
    if (k > NEIGHBOURS_MOST) k = NEIGHBOURS_MOST;
    if (k > to - from - 1) k = (uint32_t)(to - from - 1);
    if (!k) return s->weight; /* the only crossing of its site */
    double best[NEIGHBOURS_MOST];
    for (uint64_t j = i; j-- > from;) {
        double dx = c->x[0] - s->all[j].x[0];
        if (n == k && dx * dx >= best[k - 1]) break;
        insert(best, &n, k, distance2(c, &s->all[j]));
    }
    for (uint64_t j = i + 1; j < to; j++) {
        double dx = s->all[j].x[0] - c->x[0];
        if (n == k && dx * dx >= best[k - 1]) break;
        insert(best, &n, k, distance2(c, &s->all[j]));
    }
    double r = sqrt(best[k - 1]);
    return dim == 2 ? 2 * r / k : 3.141592653589793 * r * r / k;
}

static bool knn_work(void *user, uint32_t worker, uint64_t tile) {
    Snap *k = user;
    Worker *w = &k->y->run->worker[worker];
    uint64_t from = tile * BATCH, to = from + BATCH < k->nall ? from + BATCH : k->nall;
    Crossing *chunk = w->finder.found;
    memcpy(chunk, k->all + from, (to - from) * sizeof *chunk);
    for (uint64_t i = from, lo = 0, hi = 0; i < to; i++) {
        if (i == from || k->all[i].event.site != k->all[i - 1].event.site) {
            for (lo = i; lo > 0 && k->all[lo - 1].event.site == k->all[i].event.site;) lo--;
            for (hi = i + 1; hi < k->nall && k->all[hi].event.site == k->all[i].event.site;) hi++;
        }
        chunk[i - from].base = knn_weight(k, i, lo, hi);
    }
    if (w->sink.kind == SINK_FORWARD && !sink_rect(&w->sink, k->y->run->s->lo, k->y->run->s->hi)) return false;
    sink_take(&w->sink, chunk, (uint32_t)(to - from));
    accum_close(&w->acc);
    return !(w->sink.failed || w->acc.failed);
}

static SltStatus run(Boundary *y, SinkKind kind, bool knn) {
    const SltScene *s = y->run->s;
    const Grid *g = &y->run->grid;
    Snap k = {.y = y, .knn = knn};
    double n = fmax(1, y->segments * (g->integral ? 1.0 : (double)g->pixels)), volume = 1;
    for (uint32_t d = 0; d < s->dim; d++) volume *= s->hi[d] - s->lo[d];
    k.length = pow(volume / n, 1.0 / s->dim);
    volume = 1;
    for (uint32_t d = 0; d < s->dim; d++) {
        double pad = k.knn ? 0 : k.length;
        k.lo[d] = s->lo[d] - 0.5 * pad, k.side[d] = s->hi[d] - s->lo[d] + pad;
        volume *= k.side[d];
    }
    k.n = 1;
    for (uint32_t d = 0; d < s->dim; d++) {
        double m = round(k.side[d] * pow(n / volume, 1.0 / s->dim));
        k.m[d] = m < 1 ? 1 : m > 1e6 ? 1000000u : (uint32_t)m;
        k.n *= k.m[d];
    }
    k.weight = volume / ((double)k.n * k.length * mean_cosine(s->dim));
    SltStatus st = SLT_OK;
    if (k.knn) {
        for (uint32_t i = 0; i < y->run->nworkers; i++) y->run->worker[i].sink.kind = SINK_KEEP;
        st = run_tiles(y->run, (k.n + CHUNK - 1) / CHUNK, work, merge, &k);
        for (uint32_t i = 0; i < y->run->nworkers; i++) y->run->worker[i].sink.kind = kind;
        if (st == SLT_OK && k.failed) st = status_fail(y->run->err, SLT_LIMIT, "out of memory");
        if (st == SLT_OK && k.nall) {
            qsort(k.all, k.nall, sizeof *k.all, by_place);
            st = run_tiles(y->run, (k.nall + BATCH - 1) / BATCH, knn_work, merge, &k);
        }
        free(k.all);
    } else {
        st = run_tiles(y->run, (k.n + CHUNK - 1) / CHUNK, work, merge, &k);
    }
    return st;
}

SltStatus knn_run(Boundary *y, SinkKind kind) { return run(y, kind, true); }

SltStatus crofton_run(Boundary *y, SinkKind kind) { return run(y, kind, false); }
