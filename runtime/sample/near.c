/* The near-miss probe: an even number of crossings between two vertices leaves their regions equal and is not seen.
 * Where the same event is the nearest on four vertices in a row and |g| falls towards the middle edge from both sides,
 * so steeply that the straight lines through it from both sides meet below zero, the region is evaluated once where
 * they meet. For convex |g| that is exact. Where g has a double root, or two that are near to each other, |g| falls
 * like a square and the lines meet halfway, wherever the root is: so the region is evaluated where the square roots of
 * |g| would meet, too. At the ends of a line of the lattice, where the fourth vertex is missing, the gradient of g
 * gives the slope on that side. */
#include <assert.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/ask.h"
#include "runtime/sample/depth.h"
#include "runtime/sample/near.h"

enum { READY, SLOPE_START, SLOPE_END }; /* a candidate, or one that still wants the slope at that end */

typedef struct Candidate {
    Segment s;     /* the edge */
    double g0, g1; /* |g| at its ends */
    double s0, s1; /* slopes of |g| towards its start and behind its end */
    double len, t; /* length of the edge; where the lines meet, in parts of it */
    Event event;   /* of a comparison where a slope is wanted: others have none to ask for */
    uint8_t kind;  /* READY, SLOPE_START or SLOPE_END */
} Candidate;

typedef struct Probes {
    Candidate c[FIND];
    uint32_t n;
} Probes;

/* The lines through the outer slopes meet inside the edge, below zero. */
static bool meets(Candidate *c) {
    if (!(c->s0 < 0 && c->s1 > 0)) return false;
    double t = (c->g0 - c->g1 + c->s1 * c->len) / (c->s1 - c->s0);
    if (!(t > 0 && t < c->len) || !(c->g0 + c->s0 * t < 0)) return false;
    c->t = t / c->len;
    return true;
}

/* Where a square that is g0 and g1 at the ends is 0, in parts of the edge. */
static double root_of_square(double g0, double g1) { return sqrt(g0) / (sqrt(g0) + sqrt(g1)); }

bool near_aims(const double g[4], const double pos[4], double at[NEAR_AIMS]) {
    Candidate c = {.g0 = g[1],
                   .g1 = g[2],
                   .s0 = (g[1] - g[0]) / (pos[1] - pos[0]),
                   .s1 = (g[3] - g[2]) / (pos[3] - pos[2]),
                   .len = pos[2] - pos[1]};
    if (!meets(&c)) return false;
    at[0] = pos[1] + c.t * c.len, at[1] = pos[1] + root_of_square(c.g0, c.g1) * c.len;
    return true;
}

static void add(Worker *w, const Candidate *c) {
    if (!w->probes && !(w->probes = alloc_sparse(1, sizeof(Probes)))) {
        w->finder.failed = true;
        return;
    }
    Probes *p = w->probes;
    assert(p->n < FIND);
    p->c[p->n++] = *c;
    if (p->n == FIND) near_flush(w);
}

void near_probe(Worker *w, const Line *l, const Segment *like) {
    uint32_t loops = scene_outputs(w->batch.s, SLT_K_REGION, SLT_OUT_NEAR_K);
    const uint32_t end = l->to < l->n - 1 ? l->to : l->n - 1;
    for (uint32_t e = l->from; e < end; e++) {
        if (l->ask && (e = ask_next(l->ask + l->first, l->stride, e, end, ASK_NEAR)) == end) break;
        uint64_t v = l->first + e * l->stride, v1 = v + l->stride;
        uint32_t key = w->near_key[v];
        if (w->near_key[v1] != key || w->hash[v] != w->hash[v1] || w->near_event[v] < 0) continue;
        if (worker_faces_differ(w, v, v1)) continue;
        if (w->depth && depth_differs(w->depth[v], w->depth[v1], l->threshold)) continue;
        bool before = e > 0, after = e + 2 < l->n;
        if ((!before && !l->at_start) || (!after && !l->at_end) || (!before && !after)) continue;
        if (before && w->near_key[v - l->stride] != key) continue;
        if (after && w->near_key[v1 + l->stride] != key) continue;
        Candidate c;
        c.g0 = w->near_g[v], c.g1 = w->near_g[v1], c.len = l->pos[e + 1] - l->pos[e], c.kind = READY;
        c.s0 = before ? (c.g0 - w->near_g[v - l->stride]) / (l->pos[e] - l->pos[e - 1]) : -HUGE_VAL;
        c.s1 = after ? (w->near_g[v1 + l->stride] - c.g1) / (l->pos[e + 2] - l->pos[e + 1]) : HUGE_VAL;
        if (!before) {
            /* The line from the known side must reach zero inside the edge by itself. */
            if (!(c.s1 > 0) || !(c.g1 - c.s1 * c.len < 0)) continue;
            c.kind = SLOPE_START;
        } else if (!after) {
            if (!(c.s0 < 0) || !(c.g0 + c.s0 * c.len < 0)) continue;
            c.kind = SLOPE_END;
        } else if (!meets(&c)) {
            continue;
        }
        c.event = (Event){.site = w->near_event[v]};
        if (c.kind != READY &&
            (!w->batch.s->kernel[SLT_K_SITE_GRAD] || w->batch.s->site_kind[c.event.site] != SLT_SITE_COMPARE))
            continue;
        for (uint32_t d = 0; d < loops; d++) c.event.k[d] = w->near_event[(d + 1) * w->vertex_cap + v];
        c.s = *like;
        c.s.a[like->axis] = l->pos[e], c.s.b[like->axis] = l->pos[e + 1];
        c.s.ta = 0, c.s.tb = 1, c.s.halvings = 0;
        c.s.ma = worker_mark(w, v), c.s.mb = worker_mark(w, v1), c.s.threshold = l->threshold, c.s.state = SEARCH_ROOT;
        c.s.edge = (uint32_t)v + 1;
        add(w, &c);
    }
}

/* The missing slopes of candidates, from gradients of g, one site at a time. */
static void border_slopes(Worker *w, Probes *p) {
    Batch *b = &w->batch;
    uint64_t order[FIND];
    uint32_t n = 0;
    for (uint32_t i = 0; i < p->n; i++)
        if (p->c[i].kind != READY) order[n++] = (uint64_t)(uint32_t)p->c[i].event.site << 32 | i;
    sort_keys(order, n);
    for (uint32_t from = 0, to; from < n; from = to) {
        for (to = from + 1; to < n && order[to] >> 32 == order[from] >> 32;) to++;
        for (uint32_t i = from; i < to; i++) {
            const Candidate *c = &p->c[(uint32_t)order[i]];
            batch_set_x(b, i - from, c->kind == SLOPE_START ? c->s.a : c->s.b);
            batch_set_stream(b, i - from, c->s.stream, c->s.rand0);
            batch_set_event(b, i - from, &c->event);
        }
        b->args.site = p->c[(uint32_t)order[from]].event.site;
        batch_call(b, SLT_K_SITE_GRAD, to - from);
        for (uint32_t i = from; i < to; i++) {
            Candidate *c = &p->c[(uint32_t)order[i]];
            double g = batch_get(b, SLT_OUT_G, 0, i - from),
                   slope = batch_get(b, SLT_OUT_G_DX, (uint32_t)c->s.axis, i - from);
            if (g < 0) slope = -slope;
            if (c->kind == SLOPE_START) c->s0 = slope;
            else c->s1 = slope;
            if (meets(c)) c->kind = READY;
        }
    }
}

void near_flush(Worker *w) {
    Probes *p = w->probes;
    Batch *b = &w->batch;
    uint32_t n = 0;
    if (!p || !p->n) return;
    border_slopes(w, p);
    for (uint32_t i = 0; i < p->n; i++)
        if (p->c[i].kind == READY) p->c[n++] = p->c[i];
    for (uint32_t aim = 0; aim < NEAR_AIMS && n; aim++) {
        for (uint32_t i = 0; i < n; i++) {
            double x[3];
            if (aim) p->c[i].t = root_of_square(p->c[i].g0, p->c[i].g1);
            segment_at(&p->c[i].s, p->c[i].t, x);
            batch_set_x(b, i, x);
            batch_set_stream(b, i, p->c[i].s.stream, p->c[i].s.rand0);
        }
        batch_call(b, SLT_K_REGION, n);
        uint32_t rest = 0;
        for (uint32_t i = 0; i < n; i++) {
            Segment s = p->c[i].s;
            Mark m = batch_mark(b, i);
            if (m.hash == s.ma.hash) {
                p->c[rest++] = p->c[i];
                continue;
            }
            s.hidden = true;
            s.fine = true; /* the slope of g may be another a little beside the root, where all is so narrow */
            s.tb = p->c[i].t, s.mb = m;
            finder_push(&w->finder, &s);
            s.ta = s.tb, s.ma = m, s.tb = 1, s.mb = p->c[i].s.mb;
            finder_push(&w->finder, &s);
            if (w->follow) follow_found(w->follow, (uint32_t)s.axis, s.edge);
        }
        n = rest;
    }
    p->n = 0;
}
