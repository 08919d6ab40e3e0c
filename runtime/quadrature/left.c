/* Where bounds prove nothing: a small lattice of lines through the cell, whose crossings the finder looks for, and
 * samples between them. Every second line, and every second sample, belongs to a set of its own: two estimates, whose
 * distance tells the error of their mean. */
#include <math.h>
#include <string.h>

#include "runtime/quadrature/sweep.h"
#include "runtime/sample/depth.h"
#include "runtime/sample/near.h"
#include "runtime/sample/thin.h"

enum {
    SIDE_MAX = 34, /* vertices along a line: LEFT_LINES and the two ends */
    GAP_LINES = 8  /* through a gap, for each line through another cell */
};

typedef struct Net {
    uint32_t dim, n[3], side[3]; /* n: lines across each axis; side: vertices along each axis */
    bool thin;                   /* runs that are shorter than the spacing are collected */
    uint64_t stride[3], runs;    /* as of Line */
    double pos[3][SIDE_MAX];
} Net;

/* In [0, 1), of a place and a number. All of the place counts: cells that stand above each other must not err alike. */
static double chance(const double place[3], uint32_t k) {
    uint64_t part[3], bits = 0;
    memcpy(part, place, sizeof part);
    for (uint32_t d = 0; d < 3; d++) bits = (bits ^ part[d]) * 0xff51afd7ed558ccdu, bits ^= bits >> 32;
    bits ^= 0x9e3779b97f4a7c15u * (k + 1);
    bits ^= bits >> 31, bits *= 0xbf58476d1ce4e5b9u, bits ^= bits >> 29, bits *= 0x94d049bb133111ebu;
    return (double)((bits ^ bits >> 32) >> 11) * 0x1p-53;
}

/* own >= 0: lines lie anywhere in their strata, otherwise for another number. */
static void net_init(Net *t, const SweepWorker *v, const Box *b, uint32_t n, int own) {
    t->dim = v->w->batch.s->dim;
    uint64_t stride = 1;
    uint32_t more = GAP_LINES * n < SIDE_MAX - 2 ? GAP_LINES * n : SIDE_MAX - 2;
    int gap = sweep_gap(v->sweep, b); /* lines run across it alone */
    t->thin = gap < 0 && v->w->sink.misses && !v->w->finder.proves;
    for (uint32_t d = 0; d < 3; d++) {
        t->n[d] = gap < 0 ? n : gap == (int)d ? 0 : more;
        t->side[d] = d < t->dim ? t->n[d] + 2 : 1, t->stride[d] = stride, t->pos[d][0] = 0;
        stride *= t->side[d];
        if (d >= t->dim) continue;
        double h = (b->end[d] - b->lo[d]) / t->n[d];
        t->pos[d][0] = b->lo[d], t->pos[d][t->n[d] + 1] = b->hi[d]; /* what jumps in the gap behind is cells_gap.c's */
        for (uint32_t k = 0; k < t->n[d]; k++)
            t->pos[d][k + 1] = b->lo[d] + (k + (own < 0 ? 0.5 : chance(b->lo, (3 * k + d) * 2 + (uint32_t)own))) * h;
    }
}

static uint64_t net_size(const Net *t) { return (uint64_t)t->side[0] * t->side[1] * t->side[2]; }

static void net_place(const Net *t, uint64_t vertex, double x[3]) {
    for (uint32_t d = 0; d < 3; d++) {
        x[d] = t->pos[d][vertex % t->side[d]];
        vertex /= t->side[d];
    }
}

static void evaluate(SweepWorker *v, const Net *t) {
    Batch *b = &v->w->batch;
    uint64_t size = net_size(t);
    for (uint64_t at = 0; at < size;) {
        uint32_t n = size - at < BATCH ? (uint32_t)(size - at) : BATCH;
        for (uint32_t i = 0; i < n; i++) {
            double x[3];
            net_place(t, at + i, x);
            batch_set_x(b, i, x);
        }
        vertices_call(v->w, n, at);
        at += n;
    }
}

/* The segments of one line, from `first`, whose ends differ. */
static void scan(SweepWorker *v, const Net *t, uint32_t axis, uint64_t first, double threshold, Segment *seg) {
    Worker *w = v->w;
    uint64_t stride = t->stride[axis];
    /* A line in one dimension is exact, but for what it stepped over. */
    bool sized = v->sweep->errors;
    uint8_t set = (uint8_t)(seg->cls | (sized && t->dim > 1 ? 4 : 0)), missed = sized ? 2 | 4 : 0;
    Line line = {.pos = t->pos[axis],
                 .first = first,
                 .stride = stride,
                 .n = t->side[axis],
                 .to = t->side[axis] - 1,
                 .at_start = true,
                 .at_end = true,
                 .threshold = threshold,
                 .runs = t->runs};
    for (uint32_t e = 0; e + 1 < t->side[axis]; e++) {
        uint64_t a = first + e * stride, b = a + stride;
        w->finder.segments++;
        double own = threshold;
        bool differ = w->hash[a] != w->hash[b];
        if (w->depth && (differ || depth_differs(w->depth[a], w->depth[b], threshold))) {
            own = depth_threshold(w->hash + first, w->depth + first, stride, e, t->side[axis], threshold);
            differ |= depth_differs(w->depth[a], w->depth[b], own);
        }
        bool faces = !differ && worker_faces_differ(w, a, b);
        differ |= faces;
        v->differ += differ;
        if (!differ && !w->finder.proves) continue;
        uint32_t pair = e & ~1u;
        bool seen = w->finder.proves || faces || pair + 2 >= t->side[axis] ||
                    w->hash[first + pair * stride] != w->hash[first + (pair + 2) * stride];
        seg->cls = set | (seen ? 0 : missed), v->unseen += differ && !seen;
        seg->a[axis] = t->pos[axis][e], seg->b[axis] = t->pos[axis][e + 1];
        seg->thin = t->thin && differ ? thin_edge(w, &line, e, axis) : 0;
        finder_add(&w->finder, seg, worker_mark(w, a), worker_mark(w, b), own);
    }
    if (!scene_outputs(w->batch.s, SLT_K_REGION, SLT_OUT_NEAR_SITE) || w->finder.finest) return;
    seg->cls = set | missed, seg->thin = 0;
    near_probe(w, &line, seg);
}

static bool lines(SweepWorker *v, const Net *t, const Box *box, double stands, int set) {
    Sweep *p = v->sweep;
    Worker *w = v->w;
    if (!worker_vertices(w, net_size(t))) return false;
    evaluate(v, t);
    for (uint32_t axis = 0; axis < t->dim; axis++) {
        uint32_t a = axis == 0 ? 1 : 0, b = axis == 2 ? 1 : 2, from[3] = {0}, to[3] = {1, 1, 1};
        double base = 1, threshold = HUGE_VAL;
        uint64_t count = 1;
        for (uint32_t d = 0; d < t->dim; d++) {
            from[d] = 1, to[d] = t->n[d] + 1;
            if (d != axis) base *= box->end[d] - box->lo[d], count *= t->n[d];
        }
        if (!count) continue;
        /* Two sets: each has half of the lines. */
        uint32_t sets = p->errors && t->dim > 1 ? 2 : 1;
        base *= stands * (double)sets / (double)count;
        if (w->depth) {
            Spread spread;
            spread_clear(&spread);
            for (uint32_t q = from[b]; q < to[b]; q++)
                for (uint32_t r = from[a]; r < to[a]; r++) {
                    uint64_t first = r * t->stride[a] + q * t->stride[b];
                    spread_line(&spread, w->hash + first, w->depth + first, t->stride[axis], t->side[axis]);
                }
            threshold = spread_threshold(&spread) * (w->finder.coarse ? DEPTH_COARSE : 1);
        }
        for (uint32_t q = from[b]; q < to[b]; q++)
            for (uint32_t r = from[a]; r < to[a]; r++) {
                Segment seg = {.base = base,
                               .axis = (int8_t)axis,
                               .owner = v->owner,
                               .cls = sets < 2  ? 0
                                      : set < 0 ? (q + r) & 1
                                                : (uint8_t)set};

                seg.a[a] = seg.b[a] = t->pos[a][r], seg.a[b] = seg.b[b] = t->pos[b][q];
                scan(v, t, axis, r * t->stride[a] + q * t->stride[b], threshold, &seg);
            }
    }
    finder_run(&w->finder, false);
    return true;
}

/* Where errors are stated, samples lie anywhere in their strata: in the middle of them, a boundary along the axes would
 * give both sets the same, however wrong. */
static void samples(SweepWorker *v, uint32_t lines, const Box *box, double stands, int own) {
    const uint32_t dim = v->w->batch.s->dim;
    CellPoint point[2][BATCH];
    uint32_t n[2] = {0}, sets = v->sweep->errors ? 2 : 1, across[3];
    uint64_t count = 1;
    double m = 1;
    for (uint32_t d = 0; d < 3; d++) {
        across[d] = d < dim ? lines : 1, count *= across[d];
        if (d < dim) m *= box->end[d] - box->lo[d];
    }
    for (uint64_t i = 0; i < count; i++) {
        uint64_t rest = i, parity = 0;
        CellPoint x = {.weight = stands * m * sets / (double)count};
        for (uint32_t d = 0; d < dim; d++) {
            uint64_t k = rest % across[d];
            rest /= across[d], parity += k;
            double h = (box->end[d] - box->lo[d]) / lines;
            x.x[d] = box->lo[d] + (k + (sets < 2 ? 0.5 : chance(box->lo, (uint32_t)(dim * i + d)))) * h;
        }
        uint32_t set = sets < 2 ? 0 : own < 0 ? parity & 1 : (uint32_t)own;
        point[set][n[set]++] = x;
        if (n[set] == BATCH) sweep_volume(v, point[set], n[set], (CellRule)set, box), n[set] = 0;
    }
    for (uint32_t set = 0; set < sets; set++)
        if (n[set]) sweep_volume(v, point[set], n[set], (CellRule)set, box);
}

/* Along the edge of a solid cells are alike, and lines in the middle of their strata err alike in all of them, and in
 * both sets: there each set has lines of its own. */
bool left_lines(SweepWorker *v, const LeftCell *c, uint32_t n, int set) {
    Net t;
    bool solid = v->sweep->errors && v->w->batch.s->dim == 3, ok = true;
    for (int own = 0; own < 2 && ok && solid && set < 0; own++) {
        net_init(&t, v, &c->box, n, own), t.runs = (2 * v->owner + (uint64_t)own) * net_size(&t);
        ok = lines(v, &t, &c->box, 0.5 * c->stands, own);
    }
    if (solid && set < 0) return ok;
    net_init(&t, v, &c->box, n, solid ? set : -1), t.runs = 2 * v->owner * net_size(&t);
    return lines(v, &t, &c->box, c->stands, set);
}

void left_samples(SweepWorker *v, const LeftCell *c, uint32_t n, int set) { samples(v, n, &c->box, c->stands, set); }
