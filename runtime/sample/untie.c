/* Several boundaries may lie on one crossing: that of a disc and of another of the same size, the middle lines of two
 * pairs of seeds on a grid. Only what each decides by itself is its to move; a decision that others hide moves nothing.
 *
 * With the parameters moved a little, each boundary goes its own way, and a short search across the place finds what
 * jumps at each: the derivative along that move, as the boundaries pass in one order. Back, they pass in the other
 * order. If each has the same jump in both, the integral has a derivative, whatever else moves with them; if not, it is
 * the mean of the two that is given, and half their difference is an error. What the move changes of a jump is of
 * second order in the mean. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/fill.h"
#include "runtime/sample/untie_inner.h"

enum {
    MOST_FLOATS = 1 << 16, /* a program with more parameters is not asked */
    AROUND = 4,            /* a search reaches so many times as far as the crossing's own boundary moves, */
    TRIES = 3              /* and again as many times farther where others have gone farther */
};
#define LEAST 0.25     /* of a step: the shortest reach, in parts of the domain */
#define SURE 0x1p-4    /* the way of a boundary is known to this part of it */
#define SAME 0x1p-5    /* parts of a jump that are no change of it */
#define BENT 0x1p-8 /* of jumps times the way that they go */

struct Untie {
    Batch *b;
    Finder finder;
    double width;                       /* of the domain, its longest side */
    double way[UNTIE_MOST][UNTIE_WAYS]; /* of each crossing's own boundary, along its normal */
    Order order[UNTIE_MOST][UNTIE_WAYS];
    uint32_t move;
    const Crossing *c; /* in hand: c[which[..]] */
    const uint32_t *which;
};

void apart_free(Apart *a) {
    for (int m = 0; m < UNTIE_WAYS && a; m++) moved_free(&a->move[m]);
    free(a);
}

/* One in which nothing lies along an axis, in the parameters that are active; false: there are none. */
static bool direction(const SltScene *s, uint32_t seed, uint32_t number, double step, double *dir) {
    enum { PART = 256 };
    uint32_t lane[PART + FILL_OVER] = {0};
    uint64_t counter[PART + FILL_OVER] = {0}, word[2][PART + FILL_OVER];
    bool any = false;
    for (uint32_t i = 0; i < PART; i++) lane[i] = number;
    for (uint32_t p0 = 0; p0 < s->nfloats; p0 += PART) {
        const uint32_t n = s->nfloats - p0 < PART ? s->nfloats - p0 : PART;
        for (uint32_t i = 0; i < n; i++) counter[i] = p0 + i;
        fill_best()->blocks(seed, RNG_COINCIDE, n, lane, counter, (uint64_t *const[2]){word[0], word[1]});
        for (uint32_t i = 0; i < n; i++) {
            const uint32_t p = p0 + i, u = (uint32_t)word[0][i], sign = (uint32_t)(word[0][i] >> 32) & 1;
            const double v = s->f64 ? ((const double *)s->params)[p] : (double)((const float *)s->params)[p];
            const double size = fabs(v) > 0.1 ? fabs(v) : 0.1; /* of what is no number, too */
            if (!s->active[p]) continue;
            dir[p] = step * (sign ? 1 : -1) * (0.5 + 0.5 * rng_unit(u)) * size;
            any = true;
        }
    }
    return any;
}

bool apart_new(const SltScene *s, uint32_t seed, double step, Apart **out) {
    if (!s->nfloats || s->nfloats > MOST_FLOATS || !s->active) return true;
    double *dir = alloc_zero(s->nfloats, sizeof *dir);
    Apart *a = alloc_zero(1, sizeof *a);
    bool memory = dir && a, ok = memory, any = false;
    /* Forth and back, because one boundary may hide behind the other; along two directions, because along one both may
     * happen to move alike. */
    for (uint32_t m = 0; m < UNTIE_WAYS && ok; m++) {
        if (!(m & 1)) any = direction(s, seed, m / 2, step, dir); /* back along the same direction */
        ok = any && scene_move(&a->move[m], s, dir, 0, m & 1 ? -1 : 1);
    }
    free(dir);
    if (a) a->step = step, a->seed = seed;
    if (ok) *out = a;
    else apart_free(a);
    return memory && (ok || !any);
}

/* How far x lies from the crossing along the gradient of its g. */
static double distance(const Batch *b, const Crossing *c, const double x[3]) {
    double along = 0;
    for (uint32_t d = 0; d < b->s->dim; d++) along += (x[d] - c->x[d]) * c->dg[d];
    return along / untie_steepness(b, c);
}

/* Finder.full: the crossings of one move, which say by `edge` whose they are. */
static void take(void *user, Crossing *c, uint32_t n) {
    Untie *u = user;
    for (uint32_t i = 0; i < n; i++) {
        Order *o = &u->order[c[i].edge - 1][u->move];
        double at = distance(u->b, &u->c[u->which[c[i].edge - 1]], c[i].x);
        for (uint32_t ch = 0; ch < u->b->s->channels; ch++) o->moment[ch] += at * c[i].jump[ch];
        o->far = fmax(o->far, fabs(at));
        uint32_t e = 0;
        while (e < o->n && !event_same(&o->event[e], &c[i].event)) e++;
        if (e == UNTIE_EVENTS) continue; /* the sum will tell */
        if (e == o->n) o->event[o->n++] = c[i].event, memset(o->jump[e], 0, sizeof o->jump[e]);
        memcpy(o->x[e], c[i].x, sizeof o->x[e]);
        for (uint32_t ch = 0; ch < u->b->s->channels; ch++) o->jump[e][ch] += c[i].jump[ch];
    }
}

Untie *untie_new(Batch *b) {
    Untie *u = malloc(sizeof *u); /* ways and orders are set for the crossings in hand, which mostly are few */
    if (!u) return NULL;
    u->b = b, u->width = 0;
    for (uint32_t d = 0; d < b->s->dim; d++) u->width = fmax(u->width, b->s->hi[d] - b->s->lo[d]);
    if (!finder_init(&u->finder, b)) {
        untie_free(u);
        return NULL;
    }
    u->finder.full = take, u->finder.full_user = u;
    return u;
}

void untie_free(Untie *u) {
    if (!u) return;
    finder_free(&u->finder);
    free(u);
}

void untie_use(Batch *b, const SltScene *s) { b->args.params = s->params, b->args.geometries = s->geometries; }

/* The point at this distance from the crossing, along the gradient of its g. */
static void beside(const Batch *b, const Crossing *c, double at, double x[3]) {
    double steep = untie_steepness(b, c);
    for (uint32_t d = 0; d < 3; d++) x[d] = d < b->s->dim ? c->x[d] + at * c->dg[d] / steep : 0;
}

static bool inside(const SltScene *s, const double x[3]) {
    bool is = true;
    for (uint32_t d = 0; d < s->dim; d++) is &= x[d] >= s->lo[d] && x[d] <= s->hi[d];
    return is;
}

static void put(Batch *b, uint32_t lane, const Crossing *c, double at) {
    double x[3];
    beside(b, c, at, x);
    batch_set_x(b, lane, x);
    batch_set_stream(b, lane, c->stream, c->rand0);
}

/* How far each crossing's own boundary goes. */
static void find_ways(Untie *u, const Crossing *c, const uint32_t *which, uint32_t n) {
    Batch *b = u->b;
    uint32_t lane[UNTIE_MOST];
    bool done[UNTIE_MOST] = {false};
    for (uint32_t from = 0; from < n; from++) {
        uint32_t lanes = 0;
        if (done[from]) continue;
        b->args.site = c[which[from]].event.site;
        for (uint32_t i = from; i < n; i++) {
            const Crossing *x = &c[which[i]];
            if (done[i] || x->event.site != b->args.site) continue;
            put(b, lanes, x, 0);
            batch_set_event(b, lanes, &x->event);
            done[i] = true, lane[lanes++] = i;
        }
        batch_call(b, SLT_K_SITE, lanes);
        for (uint32_t i = 0; i < lanes; i++) {
            const Crossing *x = &c[which[lane[i]]];
            u->way[lane[i]][u->move] = (x->g - batch_get(b, SLT_OUT_G, 0, i)) / untie_steepness(b, x);
        }
    }
}

/* alone[i]: the regions on both sides of crossing i are still what they were where its own boundary has gone. */
static void find_alone(Untie *u, const Crossing *c, const uint32_t *which, uint32_t n, bool *alone) {
    Batch *b = u->b;
    for (uint32_t i = 0; i < n; i++) {
        const Crossing *x = &c[which[i]];
        double way = u->way[i][u->move], margin = fmax(2 * x->bracket, SURE * fabs(way));
        put(b, 2 * i, x, way - margin), put(b, 2 * i + 1, x, way + margin);
    }
    batch_call(b, SLT_K_REGION, 2 * n);
    for (uint32_t i = 0; i < n; i++) {
        const Crossing *x = &c[which[i]];
        uint32_t below = x->rising > 0 ? x->ha : x->hb, above = x->rising > 0 ? x->hb : x->ha;
        alone[i] &= (uint32_t)batch_get_int(b, SLT_OUT_HASH, 0, 2 * i) == below &&
                    (uint32_t)batch_get_int(b, SLT_OUT_HASH, 0, 2 * i + 1) == above;
    }
}

/* Do the parts make up the jump? If not, something has gone farther, or another boundary is near. */
static bool is_whole(const Batch *b, const Crossing *c, const Order *o) {
    bool whole = true;
    for (uint32_t ch = 0; ch < b->s->channels; ch++) {
        double sum = c->rising > 0 ? -c->jump[ch] : c->jump[ch], size = fabs(sum);
        for (uint32_t e = 0; e < o->n; e++) sum += o->jump[e][ch], size = fmax(size, fabs(o->jump[e][ch]));
        whole &= fabs(sum) <= SAME * size;
    }
    return whole;
}

/* Searches as far as `reach` on both sides of those that are not done. */
static void search(Untie *u, const Crossing *c, const uint32_t *which, uint32_t n, const bool *done,
                   const double *reach) {
    Batch *b = u->b;
    uint32_t lane[UNTIE_MOST], lanes = 0;
    for (uint32_t i = 0; i < n; i++) {
        double x[2][3];
        if (done[i] || u->order[i][u->move].whole) continue;
        for (int end = 0; end < 2; end++) beside(b, &c[which[i]], end ? reach[i] : -reach[i], x[end]);
        if (!inside(b->s, x[0]) || !inside(b->s, x[1])) continue;
        put(b, 2 * lanes, &c[which[i]], -reach[i]), put(b, 2 * lanes + 1, &c[which[i]], reach[i]);
        lane[lanes++] = i;
    }
    batch_call(b, SLT_K_REGION, 2 * lanes);
    for (uint32_t k = 0; k < lanes; k++) {
        const Crossing *x = &c[which[lane[k]]];
        Mark from = batch_mark(b, 2 * k), to = batch_mark(b, 2 * k + 1);
        Segment s = {.base = 1, .stream = x->stream, .rand0 = x->rand0, .axis = -1, .edge = 1 + lane[k]};
        u->order[lane[k]][u->move] = (Order){.n = 0};
        beside(b, x, -reach[lane[k]], s.a), beside(b, x, reach[lane[k]], s.b);
        if (from.hash != to.hash) finder_add(&u->finder, &s, from, to, HUGE_VAL);
    }
    finder_run(&u->finder, true);
    for (uint32_t k = 0; k < lanes; k++) {
        Order *o = &u->order[lane[k]][u->move];
        /* Where f does not jump at the crossing it need not after a move. */
        o->whole = (o->n || c[which[lane[k]]].silent) && is_whole(b, &c[which[lane[k]]], o);
    }
}

/* ---- what the orders say */
static const double *jump_of(const Order *o, const Event *e) {
    static const double none[SLT_MAX_CHANNELS] = {0};
    for (uint32_t i = 0; i < o->n; i++)
        if (event_same(&o->event[i], e)) return o->jump[i];
    return none;
}

static void gather_events(const Order *o, Tie *t) {
    for (uint32_t i = 0; i < o->n; i++) {
        uint32_t e = 0;
        while (e < t->n && !event_same(&t->event[e], &o->event[i])) e++;
        if (e == t->n && e < UNTIE_EVENTS) t->event[t->n++] = o->event[i];
    }
}

/* Where boundaries move nearly alike, rounding may give one of them the jump after one move, and another after the
 * next: half of how much the moves differ most is uncertain. */
static void doubt(const Order order[UNTIE_WAYS], uint32_t channels, Tie *t) {
    double most = SAME;
    for (uint32_t m = 1; m < UNTIE_WAYS; m++)
        for (uint32_t k = 0; k < m; k++) {
            double half[UNTIE_EVENTS][SLT_MAX_CHANNELS], size = 0, apart = 0;
            if (!order[m].whole || !order[k].whole) continue;
            for (uint32_t e = 0; e < t->n; e++) {
                const double *a = jump_of(&order[m], &t->event[e]), *b = jump_of(&order[k], &t->event[e]);
                for (uint32_t ch = 0; ch < channels; ch++) {
                    half[e][ch] = 0.5 * (a[ch] - b[ch]);
                    size = fmax(size, fmax(fabs(a[ch]), fabs(b[ch]))), apart = fmax(apart, fabs(half[e][ch]));
                }
            }
            if (!(apart > most * size)) continue;
            most = apart / size, t->doubted = true, t->between[0] = (uint8_t)m, t->between[1] = (uint8_t)k;
            memcpy(t->half, half, t->n * sizeof *half);
        }
}

/* Does the integral change by something else forth than it changes back? If not, decisions that move alike share a jump
 * in another way, which matters nothing. */
static bool is_bent(const Order pair[2], uint32_t channels, double rounding) {
    bool bent = false;
    for (uint32_t ch = 0; ch < channels; ch++) {
        double size = 0;
        for (int way = 0; way < 2; way++)
            for (uint32_t e = 0; e < pair[way].n; e++) size = fmax(size, fabs(pair[way].jump[e][ch]));
        bent |=
            fabs(pair[0].moment[ch] + pair[1].moment[ch]) > size * (BENT * fmax(pair[0].far, pair[1].far) + rounding);
    }
    return bent;
}

/* The mean over pairs of moves, forth and back, of which both are known; those of a pair are the two orders. How much
 * these differ is that of the first pair: of two, one might take away what the other gives. */
static void combine(const Order order[UNTIE_WAYS], uint32_t channels, double rounding, Tie *t) {
    uint32_t pairs = 0, kinks = 0;
    bool bent = false;
    memset(t, 0, sizeof *t);
    for (uint32_t m = 0; m < UNTIE_WAYS; m += 2)
        if (order[m].whole && order[m + 1].whole) gather_events(&order[m], t), gather_events(&order[m + 1], t), pairs++;
    for (uint32_t m = 0, seen = 0; m < UNTIE_WAYS; m += 2) {
        double size = 0, apart = 0;
        if (!order[m].whole || !order[m + 1].whole) continue;
        if (!seen) t->between[0] = (uint8_t)m, t->between[1] = (uint8_t)(m + 1);
        for (uint32_t e = 0; e < t->n; e++) {
            const double *forth = jump_of(&order[m], &t->event[e]), *back = jump_of(&order[m + 1], &t->event[e]);
            for (uint32_t ch = 0; ch < channels; ch++) {
                double d = 0.5 * (forth[ch] - back[ch]);
                t->jump[e][ch] += 0.5 * (forth[ch] + back[ch]) / pairs, t->half[e][ch] += seen ? 0 : d;
                size = fmax(size, fmax(fabs(forth[ch]), fabs(back[ch]))), apart = fmax(apart, fabs(d));
            }
        }
        kinks += apart > SAME * size, bent |= is_bent(&order[m], channels, rounding), seen++;
    }
    /* Two that happen to move alike along one direction, up to rounding, look like a kink there. */
    t->whole = t->n == 1, t->kink = kinks && bent;
    if (!t->kink) doubt(order, channels, t);
}

static void move_all(Untie *u, const Apart *apart, const Crossing *c, const uint32_t *which, uint32_t n, bool *alone) {
    for (uint32_t i = 0; i < n; i++) alone[i] = true;
    for (u->move = 0; u->move < UNTIE_WAYS; u->move++) {
        untie_use(u->b, &apart->move[u->move].scene);
        find_ways(u, c, which, n), find_alone(u, c, which, n, alone);
    }
}

void untie_alone(Untie *u, const Apart *apart, const Crossing *c, const uint32_t *which, uint32_t n, bool *alone) {
    Batch *b = u->b;
    const SltCullList *lists = b->args.cull; /* good where nothing has moved */
    b->args.cull = NULL;
    move_all(u, apart, c, which, n, alone);
    untie_use(b, b->s);
    b->args.cull = lists;
}

bool untie(Untie *u, const Apart *apart, const Crossing *c, const uint32_t *which, uint32_t n, const double *room,
           Tie *tie) {
    Batch *b = u->b;
    const SltCullList *lists = b->args.cull;
    bool done[UNTIE_MOST], again[UNTIE_MOST];
    double reach[UNTIE_MOST] = {0},
           rounding = 3 * u->width * (b->f64 ? DBL_EPSILON : (double)FLT_EPSILON); /* of places */
    b->args.cull = NULL;
    u->c = c, u->which = which;
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t m = 0; m < UNTIE_WAYS; m++) u->order[i][m].whole = false, u->order[i][m].n = 0;
    move_all(u, apart, c, which, n, done);
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t m = 0; m < UNTIE_WAYS; m++) reach[i] = fmax(reach[i], AROUND * fabs(u->way[i][m]));
        reach[i] = fmax(fmax(reach[i], LEAST * apart->step * u->width), 4 * c[which[i]].bracket);
        if (!isfinite(reach[i])) done[i] = true;
    }
    for (int t = 0; t < TRIES; t++) {
        for (u->move = 0; u->move < UNTIE_WAYS; u->move++) {
            untie_use(b, &apart->move[u->move].scene);
            search(u, c, which, n, done, reach);
        }
        for (uint32_t i = 0; i < n; i++) {
            bool whole = true;
            for (uint32_t m = 0; m < UNTIE_WAYS; m++) whole &= u->order[i][m].whole;
            if (!whole) reach[i] *= AROUND;
        }
    }
    untie_use(b, b->s);
    for (uint32_t i = 0; i < n; i++) combine(u->order[i], b->s->channels, rounding, &tie[i]);
    untie_agree(b, apart, c, which, n, u->order, tie, again);
    for (uint32_t i = 0; i < n; i++) {
        if (again[i]) combine(u->order[i], b->s->channels, rounding, &tie[i]);
        if (done[i] || (room && !tie[i].whole && reach[i] > room[i])) tie[i].n = 0, tie[i].kink = false;
    }
    untie_away(b, apart, c, which, n, u->order, reach, tie);
    b->args.cull = lists;
    for (uint32_t i = 0; i < n; i++) tie[i].untold = !done[i] && !tie[i].n && !tie[i].naway;
    return !u->finder.failed;
}
