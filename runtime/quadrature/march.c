/* Curves through cells that bounds leave open, put together from where they cross the sides of the cells.
 *
 * The edge of a shadow on a terrain is a chain of straight pieces: one edge of the ground casts it, one triangle
 * catches it. So two crossings of the sides of a small cell, and the slope of g at both, say what lies between them:
 * one piece, or two that meet where the tangents do (Kobbelt et al., "Feature sensitive surface extraction from volume
 * data", 2001). Lines count how often they cross a curve, and err by a share of one line at the end of every piece;
 * this errs only where a cell holds more than two. Squares that are not so simple are quartered; so are those whose
 * sides nothing crosses, and what is beside the curves of simple ones: bounds say which quarters are open.
 *
 * The stated error has three parts: what the last halving found, which is about as much as it left (the coarse rule is
 * without it); how much it matters at which end of a chain of two pieces g is taken, from chunk to chunk by chance (the
 * group of sizes); and what is open in the least squares and was not seen (hidden.c). */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/quadrature/sweep.h"
#include "runtime/sample/prove.h"
#include "runtime/sample/search.h"

enum {
    SQUARES = 64, /* in hand at once */
    MOST = 4,     /* crossings of the sides of a square that are made sense of */
    FOUND = 16 * SQUARES,
    HALVINGS = 5 /* of a cell that is left */
};
#define STRAIGHT 0x1p-6  /* sine of the angle below which two pieces are one */
#define LEAST_F32 0x1p-15 /* sides of squares that are not halved, in parts of the largest coordinate: rounding of */
#define LEAST_F64 0x1p-44 /* rays leaves more and more of them open */

/* What crosses the sides of a cell in hand, in the order of its circumference. */
typedef struct Square {
    LeftCell *of;
    uint32_t n;
    struct {
        double at; /* number of the side, and how far along it */
        const Crossing *x;
    } met[MOST];
} Square;

/* Where curves turn inside a square: that of crossing i at at[i], where that of other[i] begins. */
typedef struct Joints {
    double at[MOST][2];
    uint32_t other[MOST];
} Joints;

typedef struct March {
    SweepWorker *v;
    uint32_t n, nsquare, npart, nout, nsize, nlast;
    LeftCell cell[SQUARES], last[LEFT_CHUNK]; /* last: nothing was seen in them, and they are cut no further */
    Square square[SQUARES];
    struct {
        Box box;
        const LeftCell *of;
    } part[4 * SQUARES]; /* quarters, of which bounds are asked */
    Crossing found[FOUND], out[BATCH], size[BATCH];
    bool keep[FOUND];
    uint64_t order[FOUND];
} March;

static bool is_last(const March *m, const LeftCell *c) {
    const SltScene *s = m->v->w->batch.s;
    double side = 0, size = 0;
    for (uint32_t d = 0; d < 2; d++) {
        side = fmax(side, c->box.end[d] - c->box.lo[d]);
        size = fmax(size, fmax(fabs(s->lo[d]), fabs(s->hi[d])));
    }
    return c->halvings >= HALVINGS || side <= (s->f64 ? LEAST_F64 : LEAST_F32) * size;
}

static void flush(March *m) {
    sink_put_weighed(&m->v->w->sink, m->out, m->nout);
    sink_put_size(&m->v->w->sink, m->size, m->nsize);
    m->nout = m->nsize = 0;
}

/* The crossing stands for so much of its curve; or, as well, for `as_well`. Of cells that stand for others every second
 * one belongs to a set of its own, as in left.c. */
static void put(March *m, const LeftCell *of, const Crossing *x, double length, double as_well) {
    if (m->nout + CELL_RULES > BATCH || m->nsize == BATCH) flush(m);
    bool sampled = m->v->sweep->sampled;
    uint32_t rules = sampled || (of->halvings && is_last(m, of)) ? 1 : CELL_RULES;
    for (uint32_t rule = 0; rule < rules; rule++) {
        Crossing *c = &m->out[m->nout++];
        *c = *x;
        c->weight *= of->stands * length * (sampled ? 2 : 1), c->cls = sampled ? of->set : (uint8_t)rule;
    }
    if (length == as_well) return;
    m->size[m->nsize] = *x, m->size[m->nsize++].weight *= of->stands * (length - as_well);
}

/* ---- one square */
static double turn(const double a[2], const double b[2]) { return a[0] * b[1] - a[1] * b[0]; }

/* Where the pieces from a and b meet; false where that is not in the box. */
static bool meet(const Box *box, const Crossing *a, const Crossing *b, double at[2]) {
    double chord[2] = {b->x[0] - a->x[0], b->x[1] - a->x[1]}, little = STRAIGHT * hypot(chord[0], chord[1]);
    double la = hypot(a->dg[0], a->dg[1]), lb = hypot(b->dg[0], b->dg[1]);
    double ta[2] = {-a->dg[1] / la, a->dg[0] / la}, tb[2] = {-b->dg[1] / lb, b->dg[0] / lb};
    for (int d = 0; d < 2; d++) at[d] = 0.5 * (a->x[d] + b->x[d]);
    if (fabs(turn(ta, chord)) <= little && fabs(turn(tb, chord)) <= little) return true;
    double along = turn(chord, tb) / turn(ta, tb);
    for (int d = 0; d < 2; d++) {
        double slack = 0x1p-10 * (box->end[d] - box->lo[d]);
        at[d] = a->x[d] + along * ta[d];
        if (!(at[d] >= box->lo[d] - slack && at[d] <= box->end[d] + slack)) return false; /* NaN too */
    }
    return true;
}

/* Joins neighbours along the circumference: the first to the second, or to the last. */
static bool join(const Square *q, uint32_t from, Joints *j) {
    for (uint32_t i = 0; i < q->n; i += 2) {
        uint32_t a = (from + i) % q->n, b = (from + i + 1) % q->n;
        if (!meet(&q->of->box, q->met[a].x, q->met[b].x, j->at[a])) return false;
        memcpy(j->at[b], j->at[a], sizeof j->at[b]);
        j->other[a] = b, j->other[b] = a;
    }
    return true;
}

static void quarter(const SltScene *s, const Box *from, uint32_t part, Box *to) {
    *to = *from;
    for (uint32_t d = 0; d < 2; d++) {
        double middle = 0.5 * (from->lo[d] + from->end[d]);
        if (!s->f64) middle = (double)(float)middle;
        if (part >> d & 1) to->lo[d] = middle;
        else to->hi[d] = to->end[d] = middle;
    }
}

/* Does the line from a to b come near the box? */
static bool touches(const Box *box, const double a[2], const double b[2]) {
    double from = 0, to = 1;
    for (int d = 0; d < 2; d++) {
        double slack = 0x1p-7 * (box->end[d] - box->lo[d]), way = b[d] - a[d];
        double lo = box->lo[d] - slack - a[d], hi = box->end[d] + slack - a[d];
        if (way == 0) {
            if (lo > 0 || hi < 0) return false;
            continue;
        }
        from = fmax(from, fmin(lo / way, hi / way)), to = fmin(to, fmax(lo / way, hi / way));
    }
    return from <= to;
}

/* Notes the quarters that none of its curves touches; without joints all. */
static void note_quarters(March *m, const Square *q, const Joints *j) {
    for (uint32_t k = 0; k < 4; k++) {
        bool touched = false;
        quarter(m->v->w->batch.s, &q->of->box, k, &m->part[m->npart].box);
        for (uint32_t i = 0; j && i < q->n; i++) touched |= touches(&m->part[m->npart].box, q->met[i].x->x, j->at[i]);
        if (!touched) m->part[m->npart++].of = q->of;
    }
}

/* Puts what crosses a square, if it is simple; else false. */
static bool take(March *m, const Square *q) {
    Joints one, other;
    if (q->n != 2 && q->n != 4) return false;
    bool first = join(q, 0, &one), second = q->n == 4 && join(q, 1, &other);
    if (first == second) return false; /* or either is possible */
    const Joints *j = first ? &one : &other;
    for (uint32_t i = 0; i < q->n; i++) {
        const double *x = q->met[i].x->x, *y = q->met[j->other[i]].x->x;
        double length = hypot(j->at[i][0] - x[0], j->at[i][1] - x[1]);
        put(m, q->of, q->met[i].x, length, 0.5 * (length + hypot(j->at[i][0] - y[0], j->at[i][1] - y[1])));
    }
    if (!is_last(m, q->of)) note_quarters(m, q, j);
    return true;
}

/* ---- all squares in hand */
/* Sides 0 to 3, one after the other around the square: the axis along it, and its ends, a bit an axis. */
static const struct {
    uint8_t axis, from, to;
} sides[4] = {{0, 0, 1}, {1, 1, 3}, {0, 3, 2}, {1, 2, 0}};

static void corner(const Box *box, uint32_t k, double x[3]) {
    for (uint32_t d = 0; d < 2; d++) x[d] = k >> d & 1 ? box->end[d] : box->lo[d];
    x[2] = 0;
}

static void collect(void *march, Crossing *c, uint32_t n) {
    March *m = march;
    for (uint32_t i = 0; i < n; i++)
        if (m->n < FOUND) m->found[m->n++] = c[i];
        else m->square[(c[i].edge - 1) / 4].n = MOST + 1; /* is quartered, with its neighbours */
}

/* Where the sides of the squares are crossed. */
static void cross(March *m) {
    Worker *w = m->v->w;
    Batch *b = &w->batch;
    Mark mark[4 * SQUARES];
    double x[3];
    for (uint32_t i = 0; i < m->nsquare; i++) m->square[i] = (Square){.of = &m->cell[i]};
    for (uint32_t i = 0; i < 4 * m->nsquare; i++) corner(&m->cell[i / 4].box, i % 4, x), batch_set_x(b, i, x);
    batch_call(b, SLT_K_REGION, 4 * m->nsquare);
    for (uint32_t i = 0; i < 4 * m->nsquare; i++) mark[i] = batch_mark(b, i);
    void (*full)(void *, Crossing *, uint32_t) = w->finder.full;
    void *user = w->finder.full_user;
    w->finder.full = collect, w->finder.full_user = m, m->n = 0;
    for (uint32_t i = 0; i < 4 * m->nsquare; i++) {
        const Mark *from = &mark[i / 4 * 4 + sides[i % 4].from], *to = &mark[i / 4 * 4 + sides[i % 4].to];
        w->finder.segments++;
        if (!search_differ(*from, *to, HUGE_VAL)) continue;
        Segment s = {.base = 1, .axis = -1, .edge = i + 1};
        corner(&m->cell[i / 4].box, sides[i % 4].from, s.a), corner(&m->cell[i / 4].box, sides[i % 4].to, s.b);
        finder_add(&w->finder, &s, *from, *to, HUGE_VAL);
    }
    finder_run(&w->finder, true);
    w->finder.full = full, w->finder.full_user = user;
}

/* The slope of g at what was found, site by site, and 1 / |slope| as weight. */
static void weigh(March *m) {
    Sink *k = &m->v->w->sink;
    bool keep[BATCH];
    for (uint32_t i = 0; i < m->n; i++) m->order[i] = (uint64_t)(uint32_t)m->found[i].event.site << 32 | i;
    sort_keys(m->order, m->n);
    for (uint32_t from = 0, to; from < m->n; from = to) {
        for (to = from + 1; to < m->n && to - from < BATCH && m->order[to] >> 32 == m->order[from] >> 32;) to++;
        k->b->args.site = (int32_t)(m->order[from] >> 32);
        sink_weigh(k, m->found, m->order + from, to - from, keep);
        for (uint32_t i = from; i < to; i++) m->keep[(uint32_t)m->order[i]] = keep[i - from];
    }
}

static void gather(March *m) {
    for (uint32_t i = 0; i < m->n; i++) {
        const Crossing *x = &m->found[i];
        Square *q = &m->square[(x->edge - 1) / 4];
        if (!m->keep[i] || q->n >= MOST) {
            q->n = MOST + 1;
            continue;
        }
        double at = (x->edge - 1) % 4 + x->t;
        uint32_t k = q->n++;
        for (; k && q->met[k - 1].at > at; k--) q->met[k] = q->met[k - 1];
        q->met[k].at = at, q->met[k].x = x;
    }
}

/* The least squares that are not simple: two lines an axis, each for half of the square. */
static void put_lines(March *m) {
    for (uint32_t i = 0; i < m->n; i++) {
        const Crossing *x = &m->found[i];
        const Square *q = &m->square[(x->edge - 1) / 4];
        uint8_t axis = sides[(x->edge - 1) % 4].axis;
        double half = 0.5 * (q->of->box.end[1 - axis] - q->of->box.lo[1 - axis]);
        double length = half * fabs(x->dg[axis]) / hypot(x->dg[0], x->dg[1]);
        if (m->keep[i] && q->of->asked < 0) put(m, q->of, x, length, length);
    }
}

static bool hidden(March *m) {
    static const bool none[LEFT_CHUNK] = {false}; /* neither seen nor lost */
    uint32_t n = m->nlast;
    m->nlast = 0;
    return left_hidden(m->v, m->last, n, none, none);
}

/* Simple squares are done; of the others quarters are noted, or what their sides tell must do. */
static bool sort_out(March *m) {
    m->npart = 0;
    for (uint32_t i = 0; i < m->nsquare; i++) {
        Square *q = &m->square[i];
        if (take(m, q)) continue;
        if (!is_last(m, q->of)) {
            note_quarters(m, q, NULL);
        } else if (q->n) {
            q->of->asked = -1; /* put_lines */
        } else {
            m->last[m->nlast++] = *q->of;
            if (m->nlast == LEFT_CHUNK && !hidden(m)) return false;
        }
    }
    put_lines(m);
    return true;
}

/* What of the noted quarters bounds leave open is to be worked on. */
static bool deeper(March *m) {
    SweepWorker *v = m->v;
    Batch *b = &v->w->batch;
    for (uint32_t i = 0; i < m->npart; i++) {
        batch_set_x(b, i, m->part[i].box.lo);
        for (uint32_t d = 0; d < 2; d++) batch_set(b, SLT_IN_H0 + d, i, m->part[i].box.hi[d]);
    }
    b->args.note = NULL;
    batch_call(b, SLT_K_BOUNDS, m->npart);
    for (uint32_t i = 0; i < m->npart; i++) {
        if (prove_is_settled(b, i)) continue;
        if (!sweep_room_left(v)) return false;
        LeftCell *c = &v->left[v->nleft++];
        *c = *m->part[i].of, c->box = m->part[i].box, c->halvings++;
    }
    return true;
}

bool left_curves(SweepWorker *v, const LeftCell *cell, uint32_t n) {
    March *m = v->march ? v->march : (v->march = malloc(sizeof *m));
    if (!m) return false;
    m->v = v, m->nout = m->nsize = m->nlast = 0;
    for (uint32_t i = 0; i < n; i++) {
        if (!(cell[i].stands > 0)) continue;
        if (!sweep_room_left(v)) return false;
        v->left[v->nleft] = cell[i], v->left[v->nleft].set = i & 1, v->left[v->nleft++].asked = 1;
    }
    while (v->nleft && pool_stop_reason(&v->sweep->run->pool) == SLT_OK) {
        m->nsquare = v->nleft < SQUARES ? (uint32_t)v->nleft : SQUARES;
        v->nleft -= m->nsquare;
        memcpy(m->cell, v->left + v->nleft, m->nsquare * sizeof *m->cell);
        cross(m), weigh(m), gather(m);
        if (!sort_out(m) || !deeper(m)) return false;
    }
    flush(m);
    return hidden(m);
}
