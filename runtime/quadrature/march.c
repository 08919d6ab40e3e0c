/* Curves through cells that bounds leave open, put together from where they cross the sides of the cells.
 *
 * The edge of a shadow on a terrain is a chain of straight pieces: one edge of the ground casts it, one triangle
 * catches it. So two crossings of the sides of a small cell, and the slope of g at both, say what lies between them:
 * one piece, or two that meet where the tangents do (Kobbelt et al., "Feature sensitive surface extraction from volume
 * data", 2001). Lines count how often they cross a curve, and err by a share of one line at the end of every piece;
 * this errs only where a cell holds more than two, and a look around the place where they meet notices most of those.
 * Squares that are not so simple are quartered; so are those whose sides nothing crosses, and what is beside the curves
 * of simple ones: bounds say which quarters are open. The least squares are looked at along their sides as well.
 *
 * The stated error has four parts: what half as many places on the sides of the least squares would not see, twice, for
 * as much or more is missed by all of them, and always of one sign (the coarse rule lacks it twice); by how much the
 * sides of a least square that is not simple disagree, from square to square by chance (the group of sizes); how much
 * it matters at which end of a chain of two pieces g is taken, likewise; and what is open in the least squares and was
 * not seen, or not integrated (hidden.c). */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/quadrature/sweep.h"
#include "runtime/sample/prove.h"
#include "runtime/sample/search.h"

enum {
    SQUARES = 64, /* in hand at once */
    MOST = 4,     /* crossings of the sides of a square that are made sense of */
    AROUND = 4,   /* places that are looked at around a joint */
    FOUND = 16 * SQUARES,
    HALVINGS = 4, /* of a cell that is left, */
    LOOSE = 2,    /* but so often where nothing is seen and bounds settle not even a quarter: they are loose there, or
                     rounding is large */
    PIECES = 8,   /* of a side of a square that is not halved, each looked at by itself */
    RIM = 4 * PIECES
};
#define STRAIGHT 0x1p-6  /* sine of the angle below which two pieces are one */
#define NEAR 0x1p-4      /* how far from a joint these are, in parts of the pieces */
#define BENT 0.25        /* sine of the angle below which they lie across both pieces */
#define LEAST_F32 0x1p-15 /* sides of squares that are not halved, in parts of the largest coordinate: rounding of */
#define LEAST_F64 0x1p-44 /* rays leaves more and more of them open */

/* Where curves turn inside a square: that of crossing i at at[i], where that of other[i] begins. */
typedef struct Joints {
    double at[MOST][2];
    uint32_t other[MOST];
} Joints;

/* What crosses the sides of a cell in hand, in the order of its circumference. */
typedef struct Square {
    LeftCell *of;
    uint32_t n;
    struct {
        double at; /* number of the side, and how far along it */
        const Crossing *x;
    } met[MOST];
    Joints joints;
    bool simple; /* and these are all there is to it */
    bool lost;   /* something crosses a side that could not be integrated */
} Square;

typedef struct March {
    SweepWorker *v;
    bool dry; /* nothing is put */
    uint32_t n, nsquare, npart, nout, nsize, nlast;
    LeftCell cell[SQUARES];
    LeftCell last[LEFT_CHUNK];  /* nothing was seen in them, and they are cut no further, */
    bool last_lost[LEFT_CHUNK]; /* or not all of it could be integrated */
    Square square[SQUARES];
    Mark mark[RIM * SQUARES]; /* around them */
    bool lost[SQUARES];       /* Finder.lost */
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
    return c->halvings >= HALVINGS || c->loose >= LOOSE || side <= (s->f64 ? LEAST_F64 : LEAST_F32) * size;
}

static void flush(March *m) {
    if (!m->dry) {
        sink_put_weighed(&m->v->w->sink, m->out, m->nout);
        sink_put_size(&m->v->w->sink, m->size, m->nsize);
    }
    m->nout = m->nsize = 0;
}

/* The crossing stands for so much of its curve, give or take so much. What is not sure may be missed as often
 * as it is found, or twice: the coarse rule lacks it twice. Of cells
 * that stand for others every second one belongs to a set of its own, as in left.c. */
static void put(March *m, const LeftCell *of, const Crossing *x, bool sure, double length, double give) {
    if (m->nout + CELL_RULES > BATCH || m->nsize == BATCH) flush(m);
    bool sampled = m->v->sweep->sampled;
    for (uint32_t rule = 0; rule < (sampled ? 1 : CELL_RULES); rule++) {
        Crossing *c = &m->out[m->nout++];
        *c = *x;
        c->weight *= of->stands * length * (sampled ? 2 : rule && !sure ? -1 : 1);
        c->cls = sampled ? of->set : (uint8_t)rule;
    }
    if (give == 0) return;
    m->size[m->nsize] = *x, m->size[m->nsize++].weight *= of->stands * give;
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

static void find_joints(Square *q) {
    Joints other;
    if (q->lost || (q->n != 2 && q->n != 4)) return;
    bool first = join(q, 0, &q->joints), second = q->n == 4 && join(q, 1, &other);
    if (second) q->joints = other;
    q->simple = first != second; /* or either is possible */
}

/* Places around the joint of crossing i: one between its two pieces, and three on the other side of them. */
static void around(const Square *q, uint32_t i, double place[AROUND][2]) {
    const double *at = q->joints.at[i], *a = q->met[i].x->x, *b = q->met[q->joints.other[i]].x->x;
    for (int d = 0; d < 2; d++) {
        double along = NEAR * (a[d] - at[d]), back = NEAR * (b[d] - at[d]);
        place[0][d] = at[d] + along + back, place[1][d] = at[d] - along - back;
        place[2][d] = at[d] + along - back, place[3][d] = at[d] - along + back;
    }
    double to_a[2] = {a[0] - at[0], a[1] - at[1]}, to_b[2] = {b[0] - at[0], b[1] - at[1]};
    if (fabs(turn(to_a, to_b)) > BENT * hypot(to_a[0], to_a[1]) * hypot(to_b[0], to_b[1])) return;
    for (int d = 0; d < 2; d++) { /* they go on in nearly one direction, or back: what lies between them is thin */
        double along = 0.5 * NEAR * (b[d] - a[d]), off = 0.5 * NEAR * (d ? b[0] - a[0] : a[1] - b[1]);
        place[0][d] = at[d] + off, place[1][d] = at[d] - off;
        place[2][d] = at[d] - off + along, place[3][d] = at[d] - off - along;
    }
}

static bool is_inside(const Box *box, const double x[2]) {
    return x[0] >= box->lo[0] && x[0] <= box->end[0] && x[1] >= box->lo[1] && x[1] <= box->end[1];
}

/* Crossings and slopes would be the same if a third piece cut the corner between two off, or the first went on past it:
 * around the joint things look otherwise. */
static void check_joints(March *m) {
    Batch *b = &m->v->w->batch;
    struct {
        Square *q;
        bool inside[AROUND];
    } of[BATCH / AROUND];
    for (uint32_t k = 0; k < m->nsquare;) {
        uint32_t n = 0;
        for (; k < m->nsquare && n + MOST / 2 <= BATCH / AROUND; k++) {
            Square *q = &m->square[k];
            for (uint32_t i = 0; q->simple && i < q->n; i++) {
                double place[AROUND][2];
                if (q->joints.other[i] < i) continue;
                around(q, i, place);
                of[n].q = q;
                for (uint32_t p = 0; p < AROUND; p++) {
                    of[n].inside[p] = is_inside(&q->of->box, place[p]);
                    batch_set_x(b, n * AROUND + p, (double[3]){place[p][0], place[p][1], 0});
                }
                n++;
            }
        }
        if (n) batch_call(b, SLT_K_REGION, n * AROUND);
        for (uint32_t i = 0; i < n; i++) {
            Mark between = batch_mark(b, i * AROUND);
            for (uint32_t p = 1; p < AROUND; p++)
                if (of[i].inside[0] && of[i].inside[p])
                    of[i].q->simple &= search_differ(between, batch_mark(b, i * AROUND + p), HUGE_VAL);
        }
    }
}

/* Pieces of each side. A tip that comes in and goes out by one side is not seen from the corners: a square is halved as
 * bounds leave it open, but in the least one the rest of its tips would be missed. */
static uint32_t pieces(const March *m, const LeftCell *c) { return is_last(m, c) ? PIECES : 1; }

/* Would half as many places on the rim have told of the crossing? Of tips that reach a little way into a square, those
 * that they miss are at least as much again as all places do. */
static bool half_tells(const March *m, const Square *q, double at) {
    uint32_t of = RIM * (uint32_t)(q - m->square), span = 2 * PIECES / pieces(m, q->of);
    uint32_t from = (uint32_t)(at * PIECES) / span * span;
    return search_differ(m->mark[of + from], m->mark[of + (from + span) % RIM], HUGE_VAL);
}

/* Puts what crosses a square that is simple. */
static void take(March *m, const Square *q) {
    const Joints *j = &q->joints;
    for (uint32_t i = 0; i < q->n; i++) {
        const double *x = q->met[i].x->x, *y = q->met[j->other[i]].x->x;
        double length = hypot(j->at[i][0] - x[0], j->at[i][1] - x[1]);
        double other = hypot(j->at[i][0] - y[0], j->at[i][1] - y[1]);
        bool sure = !is_last(m, q->of) || half_tells(m, q, q->met[i].at);
        put(m, q->of, q->met[i].x, sure, length, 0.25 * (length - other)); /* the distance of two rules, see SUM_SURE */
    }
    if (!is_last(m, q->of)) note_quarters(m, q, j);
}

/* ---- all squares in hand */
/* Sides 0 to 3, one after the other around the square: the axis along it, and its ends, a bit an axis. */
static const struct {
    uint8_t axis, from, to;
} sides[4] = {{0, 0, 1}, {1, 1, 3}, {0, 3, 2}, {1, 2, 0}};

/* The point around the box at k of PIECES a side, from corner 0. */
static void on_rim(const March *m, const Box *box, uint32_t k, double x[3]) {
    uint32_t side = k % RIM / PIECES, step = k % PIECES;
    for (uint32_t d = 0; d < 2; d++) {
        double from = sides[side].from >> d & 1 ? box->end[d] : box->lo[d];
        double to = sides[side].to >> d & 1 ? box->end[d] : box->lo[d];
        x[d] = from + (to - from) * step / PIECES;
        if (!m->v->w->batch.s->f64) x[d] = (double)(float)x[d];
    }
    x[2] = 0;
}

/* The square and the place on its rim that a crossing was found from. */
static Square *square_of(March *m, const Crossing *x) { return &m->square[(x->edge - 1) / RIM]; }
static uint32_t rim_of(const Crossing *x) { return (x->edge - 1) % RIM; }

static void collect(void *march, Crossing *c, uint32_t n) {
    March *m = march;
    for (uint32_t i = 0; i < n; i++)
        if (m->n < FOUND) m->found[m->n++] = c[i];
        else square_of(m, &c[i])->lost = true;
}

/* What the points around the squares look like. */
static void look(March *m) {
    Batch *b = &m->v->w->batch;
    uint32_t of[BATCH];
    for (uint32_t i = 0; i < m->nsquare;) {
        uint32_t n = 0;
        for (; i < m->nsquare && n + RIM <= BATCH; i++)
            for (uint32_t k = 0; k < RIM; k += PIECES / pieces(m, &m->cell[i])) {
                double x[3];
                on_rim(m, &m->cell[i].box, k, x);
                batch_set_x(b, n, x), of[n++] = RIM * i + k;
            }
        batch_call(b, SLT_K_REGION, n);
        for (uint32_t p = 0; p < n; p++) m->mark[of[p]] = batch_mark(b, p);
    }
}

/* Where the sides of the squares are crossed. */
static void cross(March *m) {
    Finder *f = &m->v->w->finder;
    for (uint32_t i = 0; i < m->nsquare; i++) m->square[i] = (Square){.of = &m->cell[i]}, m->lost[i] = false;
    look(m);
    void (*full)(void *, Crossing *, uint32_t) = f->full;
    void *user = f->full_user;
    f->full = collect, f->full_user = m, f->lost = m->lost, m->n = 0;
    for (uint32_t i = 0; i < m->nsquare; i++)
        for (uint32_t k = 0, step = PIECES / pieces(m, &m->cell[i]); k < RIM; k += step) {
            Mark from = m->mark[RIM * i + k], to = m->mark[RIM * i + (k + step) % RIM];
            f->segments++;
            if (!search_differ(from, to, HUGE_VAL)) continue;
            Segment s = {.base = 1, .axis = -1, .edge = RIM * i + k + 1, .owner = (uint8_t)i};
            on_rim(m, &m->cell[i].box, k, s.a), on_rim(m, &m->cell[i].box, k + step, s.b);
            finder_add(f, &s, from, to, HUGE_VAL);
        }
    finder_run(f, true);
    f->full = full, f->full_user = user, f->lost = NULL;
    for (uint32_t i = 0; i < m->nsquare; i++) m->square[i].lost |= m->lost[i];
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
        Square *q = square_of(m, x);
        q->lost |= !m->keep[i];
        if (q->lost || q->n >= MOST) {
            q->n = MOST + 1;
            continue;
        }
        double at = (double)rim_of(x) / PIECES + x->t / pieces(m, q->of);
        uint32_t k = q->n++;
        for (; k && q->met[k - 1].at > at; k--) q->met[k] = q->met[k - 1];
        q->met[k].at = at, q->met[k].x = x;
    }
}

/* The least squares that are not simple: two lines an axis, each for half of the square. Two sides that meet in a
 * corner are one estimate, and those across from them another; which of two neighbours says more, is chance. */
static void put_lines(March *m) {
    for (uint32_t i = 0; i < m->n; i++) {
        const Crossing *x = &m->found[i];
        const Square *q = square_of(m, x);
        uint32_t side = rim_of(x) / PIECES, axis = sides[side].axis, odd = (uint32_t)(q - m->square) & 1;
        double half = 0.5 * (q->of->box.end[1 - axis] - q->of->box.lo[1 - axis]);
        double length = half * fabs(x->dg[axis]) / hypot(x->dg[0], x->dg[1]);
        if (m->keep[i] && q->of->asked < 0) put(m, q->of, x, true, length, (side < 2) == odd ? length : -length);
    }
}

static bool hidden(March *m) {
    static const bool none[LEFT_CHUNK] = {false}; /* was seen */
    uint32_t n = m->nlast;
    m->nlast = 0;
    return m->dry || left_hidden(m->v, m->last, n, none, m->last_lost);
}

/* Simple squares are done; of the others quarters are noted, or what their sides tell must do. */
static bool sort_out(March *m) {
    m->npart = 0;
    for (uint32_t i = 0; i < m->nsquare; i++) {
        Square *q = &m->square[i];
        if (q->simple) {
            take(m, q);
        } else if (!is_last(m, q->of)) {
            note_quarters(m, q, NULL);
        } else {
            if (q->lost || !q->n) m->last_lost[m->nlast] = q->lost, m->last[m->nlast++] = *q->of;
            if (m->nlast == LEFT_CHUNK && !hidden(m)) return false;
            q->of->asked = -1; /* put_lines */
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
    for (uint32_t i = 0, end; i < m->npart; i = end) {
        const LeftCell *of = m->part[i].of;
        uint32_t open = 0;
        for (end = i; end < m->npart && m->part[end].of == of; end++) open += !prove_is_settled(b, end);
        for (uint32_t k = i; k < end; k++) {
            if (prove_is_settled(b, k)) continue;
            if (!sweep_room_left(v)) return false;
            LeftCell *c = &v->left[v->nleft++];
            *c = *of, c->box = m->part[k].box, c->halvings++;
            c->loose = open == 4 && !m->square[of - m->cell].n ? of->loose + 1 : 0;
        }
    }
    return true;
}

bool left_curves(SweepWorker *v, const LeftCell *cell, uint32_t n, bool dry) {
    March *m = v->march ? v->march : (v->march = malloc(sizeof *m));
    if (!m) return false;
    m->v = v, m->dry = dry, m->nout = m->nsize = m->nlast = 0;
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
        for (uint32_t i = 0; i < m->nsquare; i++) find_joints(&m->square[i]);
        check_joints(m);
        if (!sort_out(m) || !deeper(m)) return false;
    }
    flush(m);
    return hidden(m);
}
