/* Scanlines: lines parallel to each axis through a box, each with its own phase and, for shaders that call rand(), its
 * own stream: both ends of every segment of a line see the same numbers, the first of which goes by the golden ratio
 * from line to line. In image mode the boxes are tiles of pixels, so that pixels far apart do not share a stream. */
#include <assert.h>
#include <float.h>
#include <math.h>

#include "runtime/sample/boundary.h"
#include "runtime/sample/depth.h"
#include "runtime/sample/thin.h"

enum { LINE_CHUNK = 8192, LINE_MAX = 4096 };
#define GOLDEN 0.61803398874989485

typedef struct Scan {
    Boundary *y;
    uint32_t box_pixels, boxes[3]; /* image mode: side of a box in pixels, boxes by axis */
    uint32_t m[3], v, lines_1d;    /* integral mode: lines a side of the cross-section, vertices a line, lines in 1D */
    uint64_t chunk[3], chunks[3], lines[3]; /* integral mode, by axis: lines of a tile, tiles, lines in all */
} Scan;

typedef struct Box {
    double lo[3], hi[3];
    uint32_t m[3], v[3], lines_1d; /* by axis: lines a side, vertices a line; lines in 1D */
    uint64_t id;
} Box;

static uint64_t line_count(const Scan *k, const Box *b, uint32_t axis) {
    uint64_t n = 1;
    uint32_t dim = k->y->run->s->dim;
    if (dim == 1) return b->lines_1d;
    for (uint32_t d = 0; d < dim; d++)
        if (d != axis) n *= b->m[d];
    return n;
}

static double shrink(const SltScene *s, double x, double other) {
    double eps = 2 * (s->f64 ? DBL_EPSILON : (double)FLT_EPSILON) * fmax(fabs(x), fabs(other));
    return x < other ? x + eps : x - eps;
}

/* Where line l along the axis runs, into seg, and positions of its vertices; returns how many. */
static uint32_t line_place(const Scan *k, const Box *b, uint32_t axis, uint64_t l, Segment *seg, double *pos) {
    const SltScene *s = k->y->run->s;
    uint32_t shift[4], own[4], lane = k->y->replicate * 4 + axis, v = b->v[axis];
    /* With random numbers the lines of a replicate must not be a function of those of another: what rand() does to f is
     * no function of the place, and strata of one shift would say nothing of it. */
    bool strata = k->y->replicates > 1 && !s->uses_rand, spread = s->dim == 3 && k->y->run->grid.integral;
    rng_block(k->y->run->j->seed, RNG_BOX, strata ? axis : lane, b->id, shift);
    rng_block(k->y->run->j->seed, RNG_LINE, lane, b->id << 32 | l, own);
    uint64_t rest = l;
    for (uint32_t d = 0, at = 0; d < s->dim; d++) {
        if (d == axis) continue;
        if (spread) {
            /* The R2 sequence (Roberts 2018): evenly spread over the cross-section for any number of lines, replicates
             * interleaved. */
            static const double alpha[2] = {0.75487766624669276, 0.56984029099805327};
            uint64_t line = strata ? l * k->y->replicates + k->y->replicate : l;
            double t = rng_unit(shift[at]) + alpha[at] * (double)line;
            seg->line = (uint32_t)line;
            seg->a[d] = seg->b[d] = b->lo[d] + (t - floor(t)) * (b->hi[d] - b->lo[d]);
            at++;
            continue;
        }
        uint64_t i = rest % b->m[d];
        rest /= b->m[d];
        double t = stratified_shift(rng_unit(shift[at]), k->y->replicate, strata ? k->y->replicates : 1, at);
        at++;
        seg->a[d] = seg->b[d] = b->lo[d] + (i + t) / b->m[d] * (b->hi[d] - b->lo[d]);
    }
    seg->stream = s->uses_rand ? (int32_t)own[1] : 0;
    double u = rng_unit(shift[3]) + GOLDEN * (double)l;
    seg->rand0 = u - floor(u);
    double h = (b->hi[axis] - b->lo[axis]) / v, phase = rng_unit(own[0]);
    pos[0] = shrink(s, b->lo[axis], b->hi[axis]);
    for (uint32_t i = 0; i < v; i++) pos[i + 1] = b->lo[axis] + (i + phase) * h;
    pos[v + 1] = shrink(s, b->hi[axis], b->lo[axis]);
    return v + 2;
}

/* Which part of an image a line belongs to. With random numbers the four parts take the lines of each group of four in
 * an order of chance: number 0 goes by the golden ratio from line to line, and comes back nearly to itself every
 * fourth line of two turns, so that every fourth line would be far from a fair part (errors 2.5 times too wide). */
static uint8_t line_class(const Scan *k, const Box *b, uint32_t axis, uint64_t l) {
    enum { OWN = 1u << 31 };
    uint8_t order[COSETS] = {0, 1, 2, 3};
    uint32_t chance[4];
    if (!k->y->run->s->uses_rand) return l % COSETS;
    rng_block(k->y->run->j->seed, RNG_LINE, OWN | (k->y->replicate * 4 + axis), b->id << 32 | l / COSETS, chance);
    for (uint32_t i = COSETS - 1; i > 0; i--) {
        uint32_t other = chance[i] % (i + 1);
        uint8_t was = order[i];
        order[i] = order[other], order[other] = was;
    }
    return order[l % COSETS];
}

static void scan_lines(Scan *k, Worker *w, const Box *b, uint32_t axis, uint64_t from, uint64_t to) {
    Boundary *y = k->y;
    Batch *batch = &w->batch;
    const SltScene *s = y->run->s;
    double pos[LINE_MAX + 2], area = 1;
    for (uint32_t d = 0; d < s->dim; d++)
        if (d != axis) area *= b->hi[d] - b->lo[d];
    Segment seg = {.axis = (int8_t)axis, .base = area / (double)line_count(k, b, axis)};
    assert(b->v[axis] <= LINE_MAX);
    uint32_t fill = 0, n = 0;
    uint64_t at = 0;
    for (uint64_t l = from; l < to; l++) {
        n = line_place(k, b, axis, l, &seg, pos);
        for (uint32_t i = 0; i < n; i++) {
            double x[3] = {seg.a[0], seg.a[1], seg.a[2]};
            x[axis] = pos[i];
            batch_set_x(batch, fill, x);
            batch_set_stream(batch, fill, seg.stream, seg.rand0);
            if (++fill == BATCH) vertices_call(w, fill, at), at += fill, fill = 0;
        }
    }
    if (fill) vertices_call(w, fill, at);
    double threshold = HUGE_VAL;
    if (scene_outputs(s, SLT_K_REGION, SLT_OUT_DEPTH)) {
        Spread spread;
        spread_clear(&spread);
        for (uint64_t l = 0; l < to - from; l++) spread_line(&spread, w->hash + l * n, w->depth + l * n, 1, n);
        threshold = spread_threshold(&spread) * (w->finder.coarse ? DEPTH_COARSE : 1);
    }
    for (uint64_t l = from; l < to; l++) {
        n = line_place(k, b, axis, l, &seg, pos);
        uint64_t first = (l - from) * n;
        const uint32_t *hash = w->hash + first;
        const double *depth = w->depth ? w->depth + first : NULL;
        Line line = {.pos = pos,
                     .first = first,
                     .stride = 1,
                     .n = n,
                     .from = 0,
                     .to = n - 1,
                     .at_start = true,
                     .at_end = true,
                     .threshold = threshold};
        w->finder.segments += n - 1;
        for (uint32_t e = 0; e + 1 < n; e++) {
            double da = 0, db = 0, own = threshold;
            if (depth) {
                da = depth[e], db = depth[e + 1];
                if (hash[e] != hash[e + 1] || depth_differs(da, db, threshold))
                    own = depth_threshold(hash, depth, 1, e, n, threshold);
            }
            if (hash[e] == hash[e + 1] && !depth_differs(da, db, own) &&
                !worker_faces_differ(w, first + e, first + e + 1) && !w->finder.proves)
                continue;
            if (w->finder.only_hidden && !w->finder.proves) continue;
            seg.a[axis] = pos[e], seg.b[axis] = pos[e + 1];
            seg.cls = y->run->grid.integral || y->classes < 2 ? 0 : line_class(k, b, axis, l);
            seg.thin = w->sink.misses && !w->finder.proves ? thin_edge(w, &line, e, axis) : 0;
            seg.narrow = differs_beside(w, &line, e);
            finder_add(&w->finder, &seg, worker_mark(w, first + e), worker_mark(w, first + e + 1), own);
        }
        if (scene_outputs(s, SLT_K_REGION, SLT_OUT_NEAR_SITE) && !w->finder.finest) {
            seg.cls = y->run->grid.integral || y->classes < 2 ? 0 : line_class(k, b, axis, l);
            seg.thin = 0, seg.narrow = true;
            near_probe(w, &line, &seg);
        }
        finder_run(&w->finder, false);
    }
    near_flush(w);
    finder_run(&w->finder, true);
    thin_flush(w, (uint64_t[]){1, 1, 1});
}

static bool work(void *user, uint32_t worker, uint64_t tile) {
    Scan *k = user;
    Boundary *y = k->y;
    Worker *w = &y->run->worker[worker];
    const SltScene *s = y->run->s;
    const Grid *g = &y->run->grid;
    Box box = {.id = tile, .lines_1d = k->lines_1d};
    uint32_t axis = 0;
    uint64_t chunk = 0;
    if (g->integral) {
        box.id = 0;
        for (chunk = tile; chunk >= k->chunks[axis]; axis++) chunk -= k->chunks[axis];
        for (uint32_t d = 0; d < s->dim; d++)
            box.lo[d] = s->lo[d], box.hi[d] = s->hi[d], box.m[d] = k->m[d], box.v[d] = k->v;
    } else {
        double per_axis = pow(y->segments / s->dim, 1.0 / s->dim);
        for (uint32_t d = 0; d < s->dim; d++) {
            uint32_t t = (uint32_t)(tile % k->boxes[d]), p0 = t * k->box_pixels;
            uint32_t p1 = p0 + k->box_pixels < g->n[d] ? p0 + k->box_pixels : g->n[d];
            tile /= k->boxes[d];
            box.lo[d] = s->lo[d] + p0 * g->side[d], box.hi[d] = p1 == g->n[d] ? s->hi[d] : s->lo[d] + p1 * g->side[d];
            double m = round((p1 - p0) * (s->dim == 1 ? 2 : per_axis));
            if (s->uses_rand && s->dim > 1 && m > COSETS) m = COSETS * round(m / COSETS); /* whole groups */
            box.m[d] = m < 1 ? 1 : m > LINE_MAX ? LINE_MAX : (uint32_t)m, box.v[d] = box.m[d];
        }
    }
    cull_select(&y->run->cull, &w->cull, &w->batch, box.lo, box.hi);
    if (w->sink.kind == SINK_FORWARD && !sink_rect(&w->sink, box.lo, box.hi)) return false;
    for (uint32_t a = g->integral ? axis : 0; a < (g->integral ? axis + 1 : s->dim); a++) {
        uint64_t lines = line_count(k, &box, a), per = g->integral ? k->chunk[a] : LINE_CHUNK / (box.v[a] + 2) + 1;
        uint64_t from = g->integral ? chunk * per : 0, end = g->integral && from + per < lines ? from + per : lines;
        for (; from < end; from += per) {
            uint64_t to = from + per < end ? from + per : end;
            if (!worker_vertices(w, (to - from) * (box.v[a] + 2))) return false;
            scan_lines(k, w, &box, a, from, to);
        }
    }
    accum_close(&w->acc);
    return !(w->finder.failed || w->sink.failed || w->acc.failed);
}

static void merge(void *user, uint32_t worker, uint64_t tile) {
    Scan *k = user;
    (void)tile;
    boundary_merge(k->y, &k->y->run->worker[worker]);
}

SltStatus scanline_run(Boundary *y, SinkKind kind) {
    const SltScene *s = y->run->s;
    const Grid *g = &y->run->grid;
    Scan k = {.y = y, .lines_1d = 1};
    uint64_t tiles = 1;
    if (s->dim == 1 && !s->uses_rand) return lattice_run(y, kind); /* one line is all there is */
    if (g->integral) {
        /* Probes resolve features, lines bring the variance down: both grow with the budget, lines faster. */
        double per_axis = y->segments / s->dim, even = pow(per_axis, 1.0 / s->dim),
               v = fmin(fmax(round(4 * sqrt(even)), 1), LINE_MAX);
        if (s->dim > 1) v = fmin(v, fmax(1, round(even)));
        if (s->dim == 3) v = fmin(fmax(round(even), 1), LINE_MAX); /* few enough already: what is thinner is missed */
        double m = s->dim == 1 ? 1 : round(pow(per_axis / v, 1.0 / (s->dim - 1)));
        if (s->dim == 1) {
            /* Lines differ by their random numbers only. */
            v = fmin(fmax(16, round(sqrt(y->segments))), LINE_MAX);
            k.lines_1d = (uint32_t)fmin(fmax(1, round(y->segments / v)), 1e9);
        }
        tiles = 0;
        k.v = (uint32_t)v;
        for (uint32_t d = 0; d < s->dim; d++) k.m[d] = m < 1 ? 1 : m > 1e9 ? 1000000000u : (uint32_t)m;
        Box b = {.m = {k.m[0], k.m[1], k.m[2]}, .lines_1d = k.lines_1d};
        for (uint32_t d = 0; d < s->dim; d++) {
            k.lines[d] = line_count(&k, &b, d);
            k.chunk[d] = LINE_CHUNK / (k.v + 2) + 1;
            k.chunks[d] = (k.lines[d] + k.chunk[d] - 1) / k.chunk[d];
            tiles += k.chunks[d];
        }
    } else {
        k.box_pixels = s->dim == 1 ? 64 : s->dim == 2 ? 16 : 8;
        if (s->dim == 1) k.lines_1d = (uint32_t)fmin(fmax(1, round(y->segments / 2)), 1e6);
        for (uint32_t d = 0; d < s->dim; d++) {
            k.boxes[d] = (g->n[d] + k.box_pixels - 1) / k.box_pixels;
            tiles *= k.boxes[d];
        }
    }
    if (kind == SINK_INTEGRAL && !y->any_sign && boundary_in_order(y->run)) {
        double lines = (double)k.lines[0] * (y->replicates ? y->replicates : 1);
        Sketch sketch = sketch_spread((uint32_t)fmin(lines, UINT32_MAX), y->run->j->seed);
        for (uint32_t i = 0; i < y->run->nworkers; i++) y->run->worker[i].sink.sketch = sketch;
    }
    return run_tiles(y->run, tiles, work, merge, &k);
}

static bool window_work(void *user, uint32_t worker, uint64_t tile) {
    Scan *k = user;
    Worker *w = &k->y->run->worker[worker];
    const SltScene *s = k->y->run->s;
    const Windows *of = k->y->windows;
    enum { APART = 1 << 20 }; /* from the boxes of tiles */
    Box box = {.id = APART + tile, .lines_1d = 1};
    uint32_t place[4];
    rng_block(k->y->run->j->seed, RNG_BOX, UINT32_MAX, box.id, place);
    for (uint32_t d = 0; d < s->dim; d++) {
        double room = s->hi[d] - s->lo[d] - of->side[d];
        box.lo[d] = s->lo[d] + rng_unit(place[d]) * fmax(0, room);
        box.hi[d] = room > 0 ? box.lo[d] + of->side[d] : s->hi[d];
        box.m[d] = of->lines, box.v[d] = of->vertices;
        if (of->at) box.lo[d] = of->at[tile].lo[d], box.hi[d] = of->at[tile].hi[d];
    }
    cull_select(&k->y->run->cull, &w->cull, &w->batch, box.lo, box.hi);
    for (uint32_t axis = 0; axis < s->dim; axis++) {
        uint64_t lines = line_count(k, &box, axis);
        if (!worker_vertices(w, lines * (box.v[axis] + 2))) return false;
        scan_lines(k, w, &box, axis, 0, lines);
    }
    accum_close(&w->acc);
    return !(w->finder.failed || w->sink.failed || w->acc.failed);
}

SltStatus scanline_windows(Boundary *y) {
    Scan k = {.y = y, .lines_1d = 1};
    for (uint32_t i = 0; i < y->run->nworkers; i++) { /* from line to line there is nothing to follow */
        Worker *w = &y->run->worker[i];
        follow_free(w->follow);
        w->follow = w->sink.follow = NULL;
    }
    return run_tiles(y->run, y->windows->n, window_work, merge, &k);
}
