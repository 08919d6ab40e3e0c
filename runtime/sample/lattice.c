/* The default estimator: one lattice over the domain, shifted at random as a whole; every vertex owns one segment along
 * each axis, so one evaluation of the region serves two segments an axis.
 *
 * Along an axis the vertices are 0 (the border), 1 .. n (the lattice), n + 1 (the border): lines are clamped, nothing
 * is evaluated outside the domain. A tile owns the segments that start at its vertices, and evaluates a halo of one
 * vertex (two and one before with the near-miss probe). */
#include <assert.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/ask.h"
#include "runtime/sample/boundary.h"
#include "runtime/sample/depth.h"
#include "runtime/sample/near.h"
#include "runtime/sample/prove.h"
#include "runtime/sample/thin.h"

enum { SPAN_MAX = 4096 + 8, SPAN_2D = 128 + 8 }; /* vertices of a tile along an axis */

typedef struct Lattice {
    Boundary *y;
    uint32_t n[3], tile[3], tiles[3]; /* by axis: inner vertices, vertices a tile owns, tiles */
    double h[3], shift[3], base[3];   /* by axis: spacing, shift in parts of it, Segment.base */
    /* For fingers that leave their tiles (follow.c). Filled in merge, in the order of tiles. */
    double (*threshold)[2]; /* of depths, by tile and axis */
    struct Guest {          /* a finger that leaves its tile */
        FollowExit at;
        uint64_t tile, n; /* the tile to which it goes; its place in the order of leaving */
    } *guest;
    struct Known { /* what a tile has found by itself */
        FollowFound edge;
        uint64_t tile;
    } *known;
    uint64_t nguest, guest_cap, nknown, known_cap;
    bool *proves;            /* by tile: its lines have no gaps (prove.h), and fingers are not followed into it */
    uint64_t *visit, nvisit; /* [nvisit]: for each tile with guests the number of its first one */
    bool failed;
} Lattice;

/* Borders lie two units in the last place inside the domain: a jump exactly on the border is no moving boundary inside
 * it. */
static double inside(const SltScene *s, double x, double other) {
    double eps = 2 * (s->f64 ? DBL_EPSILON : (double)FLT_EPSILON) * fmax(fabs(x), fabs(other));
    return x < other ? x + eps : x - eps;
}

static double position(const Lattice *l, uint32_t axis, uint32_t e) {
    const SltScene *s = l->y->run->s;
    if (e == 0) return inside(s, s->lo[axis], s->hi[axis]);
    if (e == l->n[axis] + 1) return inside(s, s->hi[axis], s->lo[axis]);
    return s->lo[axis] + (e - 1 + l->shift[axis]) * l->h[axis];
}

/* What a tile covers, by axis: it owns the edges that start at vertices [e0, e1) of the lattice, and evaluates vertices
 * [v0, v0 + vn). */
typedef struct Span {
    uint32_t e0[3], e1[3], v0[3], vn[3];
    uint64_t stride[3];
    double pos[3][SPAN_MAX];
} Span;

static void span_of(const Lattice *l, uint64_t tile, Span *sp) {
    const SltScene *s = l->y->run->s;
    uint32_t before = scene_outputs(s, SLT_K_REGION, SLT_OUT_NEAR_SITE) ? 1 : 0,
             after = scene_outputs(s, SLT_K_REGION, SLT_OUT_NEAR_SITE) ? 2 : 1;
    uint64_t stride = 1;
    for (uint32_t d = 0; d < 3; d++) {
        sp->e0[d] = sp->e1[d] = sp->v0[d] = 0, sp->vn[d] = 1, sp->pos[d][0] = 0;
        sp->stride[d] = stride;
        if (d >= s->dim) continue;
        uint32_t t = (uint32_t)(tile % l->tiles[d]), last = l->n[d] + 1;
        tile /= l->tiles[d];
        sp->e0[d] = t * l->tile[d];
        sp->e1[d] = sp->e0[d] + l->tile[d] < last ? sp->e0[d] + l->tile[d] : last;
        sp->v0[d] = sp->e0[d] > before ? sp->e0[d] - before : 0;
        uint32_t v1 = sp->e1[d] - 1 + after;
        if (v1 > last) v1 = last;
        sp->vn[d] = v1 - sp->v0[d] + 1;
        assert(sp->vn[d] <= SPAN_MAX);
        for (uint32_t v = 0; v < sp->vn[d]; v++) sp->pos[d][v] = position(l, d, sp->v0[d] + v);
        stride *= sp->vn[d];
    }
}

/* Shortens the tile's lists, of strips of rows of its vertices. What looks for roots keeps the tile's: at a hidden edge
 * an edge of the lattice is cut, and of what lies between lines more is met so. */
static bool narrow(Worker *w, const Span *sp) {
    enum { ROWS = 4 };
    w->narrow.rows = 0;
    if (!w->narrow.note || !w->batch.s->hides) return true;
    const uint32_t edges = sp->vn[1] > 1 ? sp->vn[1] - 1 : 1, most = sp->vn[1] - 1;
    w->strip = (edges + NARROW_ROWS - 1) / NARROW_ROWS;
    if (w->strip < ROWS) w->strip = ROWS;
    NarrowParts parts = {.rows = (edges + w->strip - 1) / w->strip, .x = {sp->pos[0][0], sp->pos[0][sp->vn[0] - 1]}};
    for (uint32_t r = 0; r < parts.rows; r++) {
        const uint32_t last = (r + 1) * w->strip;
        parts.y[r][0] = sp->pos[1][r * w->strip], parts.y[r][1] = sp->pos[1][last < most ? last : most];
    }
    return narrow_tile(&w->narrow, &w->batch, &parts);
}

static void evaluate(const Lattice *l, Worker *w, const Span *sp) {
    Batch *b = &w->batch;
    const Grid *g = &l->y->run->grid;
    uint32_t fill = 0;
    uint64_t at = 0;
    for (uint32_t z = 0; z < sp->vn[2]; z++)
        for (uint32_t y = 0; y < sp->vn[1]; y++) {
            if (w->narrow.rows && y % w->strip == 0 && y / w->strip < w->narrow.rows) {
                if (fill) vertices_call(w, fill, at);
                at += fill, fill = 0;
                narrow_rows(&w->narrow, b, y / w->strip, y / w->strip);
            }
            int32_t row = b->pixels && g->dim > 1 ? (int32_t)(g->n[1] - 1 - grid_cell(g, 1, sp->pos[1][y])) : 0;
            for (uint32_t x = 0; x < sp->vn[0];) {
                uint32_t run = sp->vn[0] - x < BATCH - fill ? sp->vn[0] - x : BATCH - fill;
                for (uint32_t i = 0; i < run; i++) batch_set(b, SLT_IN_X0, fill + i, sp->pos[0][x + i]);
                if (g->dim > 1)
                    for (uint32_t i = 0; i < run; i++) batch_set(b, SLT_IN_X1, fill + i, sp->pos[1][y]);
                if (g->dim > 2)
                    for (uint32_t i = 0; i < run; i++) batch_set(b, SLT_IN_X2, fill + i, sp->pos[2][z]);
                if (b->pixels)
                    for (uint32_t i = 0; i < run; i++) {
                        batch_set_int(b, SLT_IN_PIXEL0, fill + i, (int32_t)grid_cell(g, 0, sp->pos[0][x + i]));
                        batch_set_int(b, SLT_IN_PIXEL1, fill + i, row);
                    }
                x += run, fill += run;
                if (fill == BATCH) {
                    vertices_call(w, fill, at);
                    at += fill, fill = 0;
                }
            }
        }
    if (fill) vertices_call(w, fill, at);
    narrow_end(&w->narrow, b);
}

/* The threshold of depths for lines of the tile along an axis, from all of its vertices. */
static double tile_threshold(const Worker *w, const Span *sp, uint32_t axis) {
    Spread spread;
    spread_clear(&spread);
    uint32_t a = axis == 0 ? 1 : 0, b = axis == 2 ? 1 : 2;
    for (uint32_t q = 0; q < sp->vn[b]; q++)
        for (uint32_t p = 0; p < sp->vn[a]; p++) {
            uint64_t first = p * sp->stride[a] + q * sp->stride[b];
            spread_line(&spread, w->hash + first, w->depth + first, sp->stride[axis], sp->vn[axis]);
        }
    return spread_threshold(&spread) * (w->finder.coarse ? DEPTH_COARSE : 1);
}

/* Segments of one line of the tile along `axis`; `first`: index of the line's vertex 0. */
static void scan(const Lattice *l, Worker *w, const Span *sp, uint32_t axis, uint64_t first, double threshold,
                 Segment *s) {
    uint64_t stride = sp->stride[axis];
    w->finder.segments += sp->e1[axis] - sp->e0[axis];
    if (!(w->ask[first] & (ASK_LINE_EDGE | ASK_LINE_NEAR))) {
        finder_run(&w->finder, false);
        return;
    }
    const uint32_t *hash = w->hash + first;
    const double *depth = w->depth ? w->depth + first : NULL;
    const double *pos = sp->pos[axis];
    uint32_t searched[SPAN_MAX], nsearched = 0;
    Line line = {.pos = pos,
                 .first = first,
                 .stride = stride,
                 .n = sp->vn[axis],
                 .from = sp->e0[axis] - sp->v0[axis],
                 .to = sp->e1[axis] - sp->v0[axis],
                 .at_start = sp->v0[axis] == 0,
                 .at_end = sp->v0[axis] + sp->vn[axis] == l->n[axis] + 2,
                 .threshold = threshold,
                 .ask = w->ask};
    for (uint32_t v = line.from; (v = ask_next(w->ask + first, stride, v, line.to, ASK_EDGE)) < line.to; v++) {
        uint32_t ha = hash[v * stride], hb = hash[(v + 1) * stride];
        double da = 0, db = 0, own = threshold;
        if (depth) {
            da = depth[v * stride], db = depth[(v + 1) * stride];
            if (ha != hb || depth_differs(da, db, threshold))
                own = depth_threshold(hash, depth, stride, v, sp->vn[axis], threshold);
        }
        bool alike = ha == hb && !depth_differs(da, db, own) &&
                     !worker_faces_differ(w, first + v * stride, first + (v + 1) * stride);
        if (alike && (!w->finder.proves || w->settled[first + v * stride] >> axis & 1)) continue;
        s->a[axis] = pos[v], s->b[axis] = pos[v + 1];
        s->thin = w->sink.misses && !alike && !w->finder.proves ? thin_edge(w, &line, v, axis) : 0;
        s->narrow = !alike && differs_beside(w, &line, v);
        s->edge = w->follow ? (uint32_t)(first + v * stride) + 1 : 0;
        if (!alike) searched[nsearched++] = v;
        finder_add(&w->finder, s, worker_mark(w, first + v * stride), worker_mark(w, first + (v + 1) * stride), own);
    }
    if (w->follow && !w->finder.proves)
        follow_line(w->follow, axis, (uint32_t)(first / sp->stride[1 - axis]), searched, nsearched);
    if (w->ask[first] & ASK_LINE_NEAR) {
        s->thin = 0, s->narrow = true;
        near_probe(w, &line, s);
    }
    finder_run(&w->finder, false);
}

static uint8_t coset(const Lattice *l, uint32_t dim, uint32_t p, uint32_t q) {
    (void)l;
    return (uint8_t)(dim == 2 ? p & 3 : dim == 3 ? (p & 1) | (q & 1) << 1 : 0);
}

double stratified_shift(double u, uint32_t r, uint32_t n, uint32_t d) {
    if (n < 2) return u;
    uint32_t place = r;
    if (d == 1) { /* r with its bits reversed; of n that is no power of two, r times a step without a factor of n */
        uint32_t bits = 0, step = (uint32_t)(0.618 * n) | 1;
        while (1u << bits < n) bits++;
        place = 0;
        for (uint32_t b = 0; b < bits; b++) place |= (r >> b & 1) << (bits - 1 - b);
        if (1u << bits != n) {
            for (uint32_t a = step, b = n; b;) {
                uint32_t t = a % b;
                a = b, b = t;
                if (!b && a != 1) step++, a = step, b = n;
            }
            place = (uint32_t)((uint64_t)r * step % n);
        }
    } else if (d == 2) {
        place = n - 1 - r;
    }
    double s = u + (double)place / n;
    return s - floor(s);
}

static AskTile ask_tile(const Lattice *l, const Span *sp) {
    AskTile t;
    for (uint32_t d = 0; d < 3; d++) {
        t.n[d] = sp->vn[d], t.from[d] = sp->e0[d] - sp->v0[d], t.to[d] = sp->e1[d] - sp->v0[d],
        t.stride[d] = sp->stride[d];
        t.at_start[d] = sp->v0[d] == 0, t.at_end[d] = sp->v0[d] + sp->vn[d] == l->n[d] + 2;
    }
    return t;
}

static FollowTile follow_tile(const Lattice *l, const Span *sp) {
    FollowTile t = {.classes = l->y->classes};
    for (uint32_t d = 0; d < 2; d++) {
        t.pos[d] = sp->pos[d], t.base[d] = l->base[d], t.stride[d] = sp->stride[d], t.threshold[d] = HUGE_VAL,
        t.spacing[d] = l->h[d];
        t.first[d] = sp->v0[d], t.lines[d] = l->n[d], t.from[d] = sp->e0[d] - sp->v0[d],
        t.to[d] = sp->e1[d] - sp->v0[d];
        t.line_from[d] = (sp->e0[d] > 1 ? sp->e0[d] : 1) - sp->v0[d];
        t.line_to[d] = (sp->e1[d] < l->n[d] + 1 ? sp->e1[d] : l->n[d] + 1) - sp->v0[d];
    }
    return t;
}

/* Do bounds settle enough of the tile's edges to be worth asking? Some of them, spread evenly, say so. And does halving
 * settle the others, but where they are crossed? Where an untagged ray leaves boxes of any size open, each would be
 * halved hundreds of times in vain: a small part of each tells. */
static bool tile_proves(const Lattice *l, Worker *w, const Span *sp) {
    enum { ASKED = 64, ENOUGH = ASKED / 4, PARTS = 64, FEW = 4 };
    if (!w->follow || !prove_serves(l->y->run->s)) return false; /* where fingers would be followed */
    uint32_t edges[2], open = 0, settled = 0;
    Segment edge[ASKED];
    for (uint32_t d = 0; d < 2; d++) edges[d] = sp->vn[d] - 1;
    for (uint32_t i = 0; i < ASKED; i++) {
        uint32_t axis = i & 1, at[2];
        for (uint32_t d = 0; d < 2; d++) at[d] = (uint32_t)(rng_recurrence(2, d, i, 0) * edges[d]);
        edge[i] = (Segment){.tb = 1};
        for (uint32_t d = 0; d < 2; d++)
            edge[i].a[d] = sp->pos[d][at[d]], edge[i].b[d] = sp->pos[d][at[d] + (d == axis)];
        prove_set_box(&w->batch, i, &edge[i], 0, 1);
    }
    batch_call(&w->batch, SLT_K_BOUNDS, ASKED);
    for (uint32_t i = 0; i < ASKED; i++)
        if (!prove_is_settled(&w->batch, i)) edge[open++] = edge[i];
    if (ASKED - open < ENOUGH) return false;
    if (open < FEW) return true;
    for (uint32_t i = 0; i < open; i++) {
        double at = (double)(i * 37 % PARTS) / PARTS;
        prove_set_box(&w->batch, i, &edge[i], at, at + 1.0 / PARTS);
    }
    batch_call(&w->batch, SLT_K_BOUNDS, open);
    for (uint32_t i = 0; i < open; i++) settled += prove_is_settled(&w->batch, i);
    return 2 * settled >= open;
}

typedef struct Block {
    uint16_t at[2], size; /* first vertex in the tile, edges a side */
} Block;
enum { BLOCK = 16, BLOCK_LEAST = 2, BLOCKS = (SPAN_2D / BLOCK_LEAST + 1) * (SPAN_2D / BLOCK_LEAST + 1) };

/* Notes the edges of blocks of the lattice that are settled as a whole, blocks of BLOCK by BLOCK edges and their
 * quarters. */
static void settle_blocks(Worker *w, const Span *sp) {
    Batch *b = &w->batch;
    Block now[BLOCKS], next[BLOCKS];
    uint32_t n = 0;
    memset(w->settled, 0, (uint64_t)sp->vn[0] * sp->vn[1]);
    for (uint16_t y = 0; y + 1u < sp->vn[1]; y += BLOCK)
        for (uint16_t x = 0; x + 1u < sp->vn[0]; x += BLOCK) now[n++] = (Block){{x, y}, BLOCK};
    while (n) {
        uint32_t more = 0;
        for (uint32_t from = 0; from < n; from += BATCH) {
            uint32_t count = n - from < BATCH ? n - from : BATCH;
            for (uint32_t i = 0; i < count; i++)
                for (uint32_t d = 0; d < 2; d++) {
                    uint32_t first = now[from + i].at[d], last = first + now[from + i].size;
                    batch_set(b, SLT_IN_X0 + d, i, sp->pos[d][first]);
                    batch_set(b, SLT_IN_H0 + d, i, sp->pos[d][last < sp->vn[d] ? last : sp->vn[d] - 1]);
                }
            batch_call(b, SLT_K_BOUNDS, count);
            for (uint32_t i = 0; i < count; i++) {
                Block k = now[from + i];
                if (!prove_is_settled(b, i)) {
                    uint16_t half = k.size / 2;
                    for (uint16_t c = 0; c < 4 && half >= BLOCK_LEAST; c++) {
                        Block q = {{(uint16_t)(k.at[0] + (c & 1) * half), (uint16_t)(k.at[1] + (c >> 1) * half)}, half};
                        if (q.at[0] + 1u < sp->vn[0] && q.at[1] + 1u < sp->vn[1]) next[more++] = q;
                    }
                    continue;
                }
                for (uint32_t y = k.at[1]; y <= k.at[1] + k.size && y < sp->vn[1]; y++)
                    for (uint32_t x = k.at[0]; x <= k.at[0] + k.size && x < sp->vn[0]; x++)
                        w->settled[y * sp->stride[1] + x] |=
                            (uint8_t)((x < k.at[0] + k.size) | (y < k.at[1] + k.size) << 1);
            }
        }
        memcpy(now, next, more * sizeof *now);
        n = more;
    }
}

static bool work(void *user, uint32_t worker, uint64_t tile) {
    Lattice *l = user;
    Boundary *y = l->y;
    Worker *w = &y->run->worker[worker];
    const SltScene *s = y->run->s;
    Span sp;
    span_of(l, tile, &sp);
    uint64_t total = (uint64_t)sp.vn[0] * sp.vn[1] * sp.vn[2];
    if (!worker_vertices(w, total)) return false;
    double lo[3], hi[3];
    for (int d = 0; d < 3; d++) lo[d] = sp.pos[d][0], hi[d] = sp.pos[d][sp.vn[d] - 1];
    cull_select(&y->run->cull, &w->cull, &w->batch, lo, hi);
    if (w->sink.kind == SINK_FORWARD && !sink_rect(&w->sink, lo, hi)) return false;
    if (!narrow(w, &sp)) return false;
    evaluate(l, w, &sp);
    w->finder.proves = tile_proves(l, w, &sp);
    if (w->finder.proves) settle_blocks(w, &sp);
    w->finder.prove_classes = y->run->grid.integral;
    const AskTile ask = ask_tile(l, &sp);
    FollowTile follow;
    if (w->follow) {
        follow = follow_tile(l, &sp);
        follow.hash = w->hash, follow.depth = w->depth, follow.faces = w->face != NULL;
        if (!follow_begin(w->follow, &follow, total)) return false;
    }
    for (uint32_t axis = 0; axis < s->dim; axis++) {
        /* Every line: fixed coordinates on the lattice proper, not on the borders. */
        uint32_t a = axis == 0 ? 1 : 0, b = axis == 2 ? 1 : 2, from[3] = {0}, to[3] = {1, 1, 1};
        double threshold = scene_outputs(s, SLT_K_REGION, SLT_OUT_DEPTH) ? tile_threshold(w, &sp, axis) : HUGE_VAL;
        if (w->follow) follow.threshold[axis] = l->threshold[tile][axis] = threshold;
        ask_edges(w, &ask, axis, threshold);
        for (uint32_t d = 0; d < s->dim; d++) {
            from[d] = sp.e0[d] > 1 ? sp.e0[d] : 1;
            to[d] = sp.e1[d] < l->n[d] + 1 ? sp.e1[d] : l->n[d] + 1;
        }
        for (uint32_t q = from[b]; q < to[b]; q++)
            for (uint32_t p = from[a]; p < to[a]; p++) {
                Segment seg = {
                    .base = l->base[axis], .axis = (int8_t)axis, .cls = y->classes > 1 ? coset(l, s->dim, p, q) : 0};
                seg.a[a] = seg.b[a] = sp.pos[a][p - sp.v0[a]];
                seg.a[b] = seg.b[b] = sp.pos[b][q - sp.v0[b]];
                scan(l, w, &sp, axis, (p - sp.v0[a]) * sp.stride[a] + (q - sp.v0[b]) * sp.stride[b], threshold, &seg);
            }
    }
    near_flush(w);
    finder_run(&w->finder, true);
    if (w->follow && !follow_run(w)) return false;
    thin_flush(w, sp.stride);
    accum_close(&w->acc);
    return !(w->finder.failed || w->sink.failed || w->acc.failed);
}

static bool room(void **v, uint64_t n, uint64_t *cap, size_t size) {
    if (n <= *cap) return true;
    uint64_t more = 2 * n;
    void *p = realloc(*v, more * size);
    if (p) *v = p, *cap = more;
    return p != NULL;
}

/* The tile that owns the place to which a finger goes. */
static uint64_t tile_at(const Lattice *l, const FollowExit *x) {
    double e = floor((0.5 * (x->l + x->r) - l->y->run->s->lo[x->axis]) / l->h[x->axis] - l->shift[x->axis]) + 1;
    if (!(e >= 0 && e <= l->n[x->axis])) return UINT64_MAX;
    uint64_t t[2];
    t[x->axis] = (uint32_t)e / l->tile[x->axis], t[1 - x->axis] = x->line / l->tile[1 - x->axis];
    return t[1] * l->tiles[0] + t[0];
}

static void merge(void *user, uint32_t worker, uint64_t tile) {
    Lattice *l = user;
    Worker *w = &l->y->run->worker[worker];
    if (w->follow) {
        uint32_t n;
        l->proves[tile] = w->finder.proves;
        l->y->run->proven |= w->finder.proves;
        const FollowExit *out = follow_exits(w->follow, &n);
        if (!room((void **)&l->guest, l->nguest + n, &l->guest_cap, sizeof *l->guest)) l->failed = true, n = 0;
        for (uint32_t i = 0; i < n; i++) {
            uint64_t to = tile_at(l, &out[i]);
            if (to != UINT64_MAX && to != tile)
                l->guest[l->nguest] = (struct Guest){out[i], to, l->nguest}, l->nguest++;
        }
        const FollowFound *seen = follow_seen(w->follow, &n);
        if (!room((void **)&l->known, l->nknown + n, &l->known_cap, sizeof *l->known)) l->failed = true, n = 0;
        for (uint32_t i = 0; i < n; i++) l->known[l->nknown++] = (struct Known){seen[i], tile};
    }
    boundary_merge(l->y, w);
}

/* ---- visits */
static int by_tile(const void *pa, const void *pb) {
    const struct Guest *a = pa, *b = pb;
    return a->tile != b->tile ? (a->tile < b->tile ? -1 : 1) : a->n < b->n ? -1 : a->n > b->n;
}

/* The first entry of `known` for a tile; entries are in the order of tiles. */
static uint64_t first_known(const Lattice *l, uint64_t tile) {
    uint64_t lo = 0, hi = l->nknown;
    while (lo < hi) {
        uint64_t mid = (lo + hi) / 2;
        if (l->known[mid].tile < tile) lo = mid + 1;
        else hi = mid;
    }
    return lo;
}

static bool visit(void *user, uint32_t worker, uint64_t number) {
    Lattice *l = user;
    Boundary *y = l->y;
    Worker *w = &y->run->worker[worker];
    uint64_t from = l->visit[number], tile = l->guest[from].tile;
    w->finder.proves = false;
    if (l->proves[tile]) {
        accum_close(&w->acc);
        return true;
    }
    Span sp;
    span_of(l, tile, &sp);
    double lo[3], hi[3];
    for (int d = 0; d < 3; d++) lo[d] = sp.pos[d][0], hi[d] = sp.pos[d][sp.vn[d] - 1];
    cull_select(&y->run->cull, &w->cull, &w->batch, lo, hi);
    if (w->sink.kind == SINK_FORWARD && !sink_rect(&w->sink, lo, hi)) return false;
    FollowTile follow = follow_tile(l, &sp);
    memcpy(follow.threshold, l->threshold[tile], sizeof follow.threshold);
    if (!follow_begin(w->follow, &follow, (uint64_t)sp.vn[0] * sp.vn[1])) return false;
    for (uint64_t i = first_known(l, tile); i < l->nknown && l->known[i].tile == tile; i++)
        follow_known(w->follow, &l->known[i].edge);
    for (uint64_t i = from; i < l->nguest && l->guest[i].tile == tile; i++) follow_enter(w->follow, &l->guest[i].at);
    if (!follow_run(w)) return false;
    thin_flush(w, sp.stride);
    accum_close(&w->acc);
    return !(w->finder.failed || w->sink.failed || w->acc.failed);
}

static void merge_visit(void *user, uint32_t worker, uint64_t number) {
    Lattice *l = user;
    (void)number;
    boundary_merge(l->y, &l->y->run->worker[worker]);
}

static SltStatus run_visits(Lattice *l) {
    if (!l->nguest) return SLT_OK;
    qsort(l->guest, l->nguest, sizeof *l->guest, by_tile);
    l->visit = alloc_zero(l->nguest, sizeof *l->visit);
    if (!l->visit) return status_fail(l->y->run->err, SLT_LIMIT, "out of memory");
    for (uint64_t i = 0; i < l->nguest; i++)
        if (!i || l->guest[i].tile != l->guest[i - 1].tile) l->visit[l->nvisit++] = i;
    PoolOptions *pool = &l->y->run->pool;
    double from = pool->from;
    pool->from = pool->to; /* visits make no progress of their own */
    SltStatus st = run_tiles(l->y->run, l->nvisit, visit, merge_visit, l);
    pool->from = from;
    return st;
}

/* The lattices of all replicates are one family of lines an axis. */
static void begin_sketches(const Lattice *l, const uint32_t shift[4]) {
    const Boundary *y = l->y;
    uint32_t replicates = y->replicates ? y->replicates : 1;
    Sketch k = {.seed = y->run->j->seed};
    for (uint32_t d = 0; d < 2; d++) {
        double fine = rng_unit(shift[d]) * replicates;
        k.lo[d] = y->run->s->lo[d], k.step[d] = l->h[d] / replicates, k.phase[d] = fine - floor(fine);
        k.lines[d] = l->n[d] * replicates;
    }
    for (uint32_t i = 0; i < y->run->nworkers; i++) y->run->worker[i].sink.sketch = k;
}

/* Sets n, tile and tiles; returns the number of all. */
static uint64_t cut_tiles(Lattice *l) {
    const SltScene *s = l->y->run->s;
    const Grid *g = &l->y->run->grid;
    double per_axis = pow(l->y->segments / s->dim, 1.0 / s->dim);
    uint64_t tiles = 1;
    for (uint32_t d = 0; d < s->dim; d++) {
        double n = round(per_axis * (g->integral ? 1 : g->n[d]));
        l->n[d] = n < 1 ? 1 : n > 1e9 ? 1000000000u : (uint32_t)n;
        /* A tile is about 64 pixels a side, so that a tile's crossings touch few pixels; even, for the pairs of the
         * half-resolution lines. */
        uint32_t most = s->dim == 1 ? 4096 : s->dim == 2 ? 128 : 24, want = s->dim == 1 ? 4096 : s->dim == 2 ? 64 : 16;
        if (!g->integral && s->dim > 1) {
            double t = (s->ncull ? 32 : want) * per_axis;
            want = t < 8 ? 8 : t > most ? most : (uint32_t)t & ~1u;
        }
        if (s->nfloats > 1u << 16 && s->dim < 3 && !s->ncull) want = most;
        l->tile[d] = want;
        l->tiles[d] = (l->n[d] + 1 + want - 1) / want;
        tiles *= l->tiles[d];
    }
    return tiles;
}

/* Where rand() is called, points of different lines must not share a stream. In a volume a lattice of n^3 vertices has
 * so few lines a side that flat faces along the axes are off by 1/n: lines spread evenly over the cross-sections are
 * several times better at the same number of segments. */
static bool by_scanlines(const Run *r) { return r->s->uses_rand || (r->s->dim == 3 && r->grid.integral); }

uint64_t lattice_tiles(const Boundary *y) {
    Boundary of = *y;
    Lattice l = {.y = &of};
    return by_scanlines(y->run) ? UINT32_MAX : cut_tiles(&l);
}

/* Of a replicate; *shift: of all of them. Returns the number of tiles. */
static uint64_t place(Lattice *l, Boundary *y, uint32_t shift[4]) {
    const SltScene *s = y->run->s;
    *l = (Lattice){.y = y};
    uint64_t tiles = cut_tiles(l);
    rng_block(y->run->j->seed, RNG_LATTICE, 0, 0, shift);
    for (uint32_t d = 0; d < s->dim; d++) {
        l->h[d] = (s->hi[d] - s->lo[d]) / l->n[d];
        l->shift[d] = stratified_shift(rng_unit(shift[d]), y->replicate, y->replicates, d);
    }
    for (uint32_t d = 0; d < s->dim; d++) {
        l->base[d] = 1;
        for (uint32_t o = 0; o < s->dim; o++)
            if (o != d) l->base[d] *= l->h[o];
    }
    return tiles;
}

/* ---- lattices of one tile each, which no finger leaves for another */
typedef struct Family {
    Lattice *of;
    double (*threshold)[2];
    bool *proves;
} Family;

bool lattice_is_small(const Boundary *y) {
    return y->run->grid.integral && !by_scanlines(y->run) && lattice_tiles(y) == 1;
}

static bool work_one(void *user, uint32_t worker, uint64_t number) {
    const Family *f = user;
    return work(&f->of[number], worker, 0);
}

static void merge_one(void *user, uint32_t worker, uint64_t number) {
    const Family *f = user;
    merge(&f->of[number], worker, 0);
}

SltStatus lattice_run_small(Boundary *y, uint32_t n, SinkKind kind) {
    uint32_t shift[4];
    Family f = {.of = alloc_zero(n, sizeof *f.of),
                .threshold = alloc_zero(n, sizeof *f.threshold),
                .proves = alloc_zero(n, sizeof *f.proves)};
    bool failed = !f.of || !f.threshold || !f.proves;
    for (uint32_t i = 0; i < n && !failed; i++) {
        place(&f.of[i], &y[i], shift);
        f.of[i].threshold = &f.threshold[i], f.of[i].proves = &f.proves[i];
    }
    if (!failed && kind == SINK_INTEGRAL && !y->any_sign && boundary_in_order(y->run)) begin_sketches(&f.of[0], shift);
    SltStatus st = failed ? SLT_OK : run_tiles(y->run, n, work_one, merge_one, &f);
    for (uint32_t i = 0; i < n && f.of; i++) {
        failed |= f.of[i].failed;
        free(f.of[i].guest), free(f.of[i].known);
    }
    free(f.of), free(f.threshold), free(f.proves);
    return st == SLT_OK && failed ? status_fail(y->run->err, SLT_LIMIT, "out of memory") : st;
}

SltStatus lattice_run(Boundary *y, SinkKind kind) {
    if (by_scanlines(y->run)) return scanline_run(y, kind);
    Lattice l;
    uint32_t shift[4];
    uint64_t tiles = place(&l, y, shift);
    if (kind == SINK_INTEGRAL && !y->any_sign && boundary_in_order(y->run)) begin_sketches(&l, shift);
    bool follows = y->run->nworkers && y->run->worker[0].follow;
    if (follows && (!(l.threshold = alloc_zero(tiles, sizeof *l.threshold)) ||
                    !(l.proves = alloc_zero(tiles, sizeof *l.proves)))) {
        free(l.threshold);
        return status_fail(y->run->err, SLT_LIMIT, "out of memory");
    }
    SltStatus st = run_tiles(y->run, tiles, work, merge, &l);
    if (st == SLT_OK && l.failed) st = status_fail(y->run->err, SLT_LIMIT, "out of memory");
    if (st == SLT_OK) st = run_visits(&l);
    free(l.threshold), free(l.proves), free(l.guest), free(l.known), free(l.visit);
    return st;
}
