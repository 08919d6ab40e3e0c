/* Boundaries that coincide but move differently: found by a few crossings of each batch, for the search gives the whole
 * jump to the first of them.
 *
 * One picture does not show whether another boundary lies on a crossing: the same predicate may be tested twice, or
 * guard another one. Moving the parameters a little does. The crossing's own boundary goes where its g says; if the
 * regions on its two sides are still what they were, everything that jumped moved along. If not, and if there is
 * nothing else near by, a second boundary has come apart from the first. At most COINCIDE_MAX crossings of a batch are
 * asked; where one has come apart, all are untied. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/coincide.h"
#include "runtime/sample/run.h"

enum {
    AROUND = 4,            /* `reach` looks this many times as far as the boundary moved */
    ALONG = 16,            /* `elsewhere` goes aside by the segment's length divided by this */
    NEWTON = 3             /* steps of `elsewhere` back to g = 0 */
};
/* Parameters are moved by STEP: by STEP_BRACKETS times the bracket of roots (in a domain of size 1) where that is more,
 * but at most by STEP_MOST. */
#define STEP 0x1p-15
#define STEP_MOST 0x1p-9
#define STEP_BRACKETS 0x1p7
/* The way of a boundary is known to this part of it. */
#define SURE 0x1p-4
/* Below this squared cosine between segment and gradient of g the crossing of a moved boundary runs away. */
#define FLAT 0.1

double coincide_step(double bracket) { return fmin(fmax(STEP, STEP_BRACKETS * bracket), STEP_MOST); }

void coincide_free(Coincide *q) { untie_free(q->untie), free(q->part), free(q->half); }

bool coincide_begin(Run *r, double step) { return r->apart || apart_new(r->s, r->j->seed, step, &r->apart); }

void coincide_end(Run *r) {
    apart_free(r->apart);
    r->apart = NULL;
}

static void use(Batch *b, const SltScene *s) { b->args.params = s->params, b->args.geometries = s->geometries; }

static double length_of(const SltScene *s, const Crossing *c) {
    double sum = 0;
    for (uint32_t d = 0; d < s->dim; d++) sum += c->direction[d] * c->direction[d];
    return sqrt(sum);
}

static void direction(const SltScene *s, const Crossing *c, double unit[3]) {
    double length = length_of(s, c);
    for (uint32_t d = 0; d < 3; d++) unit[d] = d < s->dim ? c->direction[d] / length : 0;
}

/* Does the segment's line stay in the domain for `reach` to both sides of the crossing? */
static bool inside(const SltScene *s, const Crossing *c, double reach) {
    double unit[3];
    direction(s, c, unit);
    for (uint32_t d = 0; d < s->dim; d++)
        if (c->x[d] - reach * fabs(unit[d]) < s->lo[d] || c->x[d] + reach * fabs(unit[d]) > s->hi[d]) return false;
    return true;
}

static double margin(const Crossing *c, double way) { return fmax(2 * c->bracket, SURE * fabs(way)); }

/* How far the boundary of crossing x goes along its segment, given g with the parameters moved; NAN where the segment
 * is too FLAT to say. */
static double way_of(const SltScene *s, const Crossing *x, double g) {
    double unit[3], slope = 0, steepest = 0;
    direction(s, x, unit);
    for (uint32_t d = 0; d < s->dim; d++) slope += x->dg[d] * unit[d], steepest += x->dg[d] * x->dg[d];
    return slope * slope >= FLAT * steepest ? (x->g - g) / slope : (double)NAN;
}

/* How far the boundaries of crossings which[0..n), of one site, go with each move of the parameters. */
static void find_ways(Sink *k, const Crossing *c, const uint32_t *which, uint32_t n, double way[][UNTIE_WAYS]) {
    Batch *b = k->b;
    for (uint32_t side = 0; side < UNTIE_WAYS; side++) {
        use(b, &k->coincide.apart->move[side].scene);
        for (uint32_t i = 0; i < n; i++) sink_put(k, i, &c[which[i]]);
        batch_call(b, SLT_K_SITE, n);
        for (uint32_t i = 0; i < n; i++) way[i][side] = way_of(b->s, &c[which[i]], batch_get(b, SLT_OUT_G, 0, i));
    }
    use(b, b->s);
}

/* ---- suspects */
static uint32_t mix(uint32_t h, uint32_t v) { /* ir_mix, of which keys of events are made */
    uint32_t x = h * 0x9e3779b1u + v;
    x = (x ^ x >> 16) * 0x7feb352du;
    x = (x ^ x >> 15) * 0x846ca68bu;
    return x ^ x >> 16;
}

/* Is it the crossing's event alone that makes the two hashes differ? Where hashes are those of the path they tell, for
 * they are sums of the keys of what has decided; of how many loops the key is made the event does not say. */
static bool is_alone(const Crossing *c) {
    uint32_t key = mix(0x9e3779b9u, (uint32_t)c->event.site + 1), differ = c->ha ^ c->hb;
    double n = floor(c->event.boundary);
    for (uint32_t d = 0;; d++) {
        if (key == differ) return true;
        for (int by = -1; by < 1; by++) { /* an integer that changes to the next */
            uint32_t below = (uint32_t)(int32_t)fmin(fmax(n + by, -0x1p30), 0x1p30);
            if ((mix(key, below) ^ mix(key, below + 1)) == differ) return true;
        }
        if (d == SLT_MAX_K) return false;
        key = mix(key, (uint32_t)c->event.k[d]);
    }
}

/* Moves those of order[0 .. n) that are kept and may be not alone to list; how many. */
static uint32_t find_suspects(const Sink *k, const Crossing *c, const uint64_t *order, const bool *keep, uint32_t n,
                              uint32_t *list) {
    const uint8_t *skips = k->b->s->site_skips; /* another iteration may decide when the parameters have moved */
    uint32_t suspects = 0;
    for (uint32_t i = 0; i < n; i++) {
        const Crossing *x = &c[(uint32_t)order[i]];
        if (keep[i] && !(skips && skips[x->event.site]) && !is_alone(x)) list[suspects++] = i;
    }
    return suspects;
}

/* Chooses among the suspects, which are ordered by site, and finds their ways. */
static void choose(Sink *k, const Crossing *c, const uint64_t *order, const uint32_t *suspect, uint32_t n) {
    Coincide *q = &k->coincide;
    uint32_t share = (n + COINCIDE_MAX - 1) / COINCIDE_MAX;
    q->n = 0;
    for (uint32_t i = 0; i < n; i += share) q->which[q->n++] = (uint32_t)order[suspect[i]];
    for (uint32_t from = 0, to; from < q->n; from = to) {
        int32_t site = k->b->args.site = c[q->which[from]].event.site;
        for (to = from + 1; to < q->n && c[q->which[to]].event.site == site;) to++;
        find_ways(k, c, q->which + from, to - from, q->way + from);
    }
}

/* Are the regions of lanes 2 i and 2 i + 1 those on the two sides of the crossing? */
static bool as_before(const Batch *b, const Crossing *c, uint32_t i) {
    return (uint32_t)batch_get_int(b, SLT_OUT_HASH, 0, 2 * i) == c->ha &&
           (uint32_t)batch_get_int(b, SLT_OUT_HASH, 0, 2 * i + 1) == c->hb;
}

/* Has the boundary left lanes 2 i and 2 i + 1? The edge that a ray passes may be another one when the geometry has
 * moved: then nothing jumps where the g of the old edge says. That is a kink of its own, not a second boundary. */
static bool gone(const Batch *b, uint32_t i) {
    return b->s->ngeometries &&
           batch_get_int(b, SLT_OUT_HASH, 0, 2 * i) == batch_get_int(b, SLT_OUT_HASH, 0, 2 * i + 1);
}

/* Lanes 2 i and 2 i + 1: the points at `at` -+ `beside` along the segment, counted from the crossing. */
static void place(Batch *b, uint32_t i, const Crossing *c, double at, double beside) {
    double unit[3], x[3] = {0};
    direction(b->s, c, unit);
    for (uint32_t side = 0; side < 2; side++) {
        for (uint32_t d = 0; d < b->s->dim; d++) x[d] = c->x[d] + (at + (side ? beside : -beside)) * unit[d];
        batch_set_x(b, 2 * i + side, x);
        batch_set_stream(b, 2 * i + side, c->stream, c->rand0);
    }
}

/* The longest of the ways; NAN where one is. */
static double farthest(const double *way) {
    double far = 0;
    for (uint32_t side = 0; side < UNTIE_WAYS && !isnan(far); side++)
        far = fabs(way[side]) <= far ? far : fabs(way[side]);
    return far;
}

/* Another boundary that lies as near as this to the crossing forbids an answer. Other boundaries may move faster than
 * this one, but hardly faster than `typical`, the farthest way of any crossing in the batch. */
static double reach(const SltScene *s, const Crossing *c, const double *way, double typical) {
    double far = farthest(way);
    return fmax(AROUND * far, fmin(typical, length_of(s, c))) + margin(c, far);
}

/* apart[i]: from the boundary of crossing which[i] a second one has come apart. */
static void tear(Sink *k, const Crossing *c, const uint32_t *which, uint32_t n, double way[][UNTIE_WAYS],
                 double typical, bool *apart) {
    Batch *b = k->b;
    const SltScene *s = b->s;
    uint32_t at[COINCIDE_MAX], kept = 0, torn = 0;
    for (uint32_t i = 0; i < n; i++) {
        const Crossing *x = &c[which[i]];
        bool near = 2 * AROUND * farthest(way[i]) < length_of(s, x) &&
                    inside(s, x, reach(s, x, way[i], typical)); /* false where a way is NAN */
        apart[i] = false;
        if (near) at[kept++] = i;
    }
    for (uint32_t side = 0; side < UNTIE_WAYS; side++) {
        use(b, &k->coincide.apart->move[side].scene);
        for (uint32_t i = 0; i < kept; i++) {
            const Crossing *x = &c[which[at[i]]];
            place(b, i, x, way[at[i]][side], margin(x, way[at[i]][side]));
        }
        batch_call(b, SLT_K_REGION, 2 * kept);
        for (uint32_t i = 0; i < kept; i++) apart[at[i]] |= !as_before(b, &c[which[at[i]]], i) && !gone(b, i);
    }
    use(b, s);
    /* Another boundary near by may have come between: those crossings do not count. */
    for (uint32_t i = 0; i < kept; i++) {
        if (!apart[at[i]]) continue;
        place(b, torn, &c[which[at[i]]], 0, reach(s, &c[which[at[i]]], way[at[i]], typical));
        at[torn++] = at[i];
    }
    batch_call(b, SLT_K_REGION, 2 * torn);
    for (uint32_t i = 0; i < torn; i++) apart[at[i]] = as_before(b, &c[which[at[i]]], i);
}

/* A corner with a hidden boundary looks as if something had come apart, but only there: does the crossing's boundary
 * look so a little further along, too? */
static bool elsewhere(Sink *k, const Crossing *c, double typical) {
    Batch *b = k->b;
    Crossing x = *c;
    uint32_t dim = b->s->dim, steep = 0, zero = 0;
    uint64_t order = 0, dropped[SLT_DROP_REASONS];
    bool keep, apart;
    double way[1][UNTIE_WAYS], square = 0;
    if (dim == 1) return true;
    for (uint32_t d = 0; d < dim; d++)
        square += c->dg[d] * c->dg[d], steep = fabs(c->dg[d]) > fabs(c->dg[steep]) ? d : steep;
    /* Along the tangent that has no part of a third axis, and back to g = 0. */
    uint32_t other = steep == 0 ? 1 : 0;
    double by = length_of(b->s, c) / ALONG / sqrt(square);
    x.x[other] += by * c->dg[steep], x.x[steep] -= by * c->dg[other];
    b->args.site = c->event.site;
    memcpy(dropped, k->f->dropped, sizeof dropped); /* x is no crossing, and must not be counted as dropped */
    for (uint32_t step = 0; step < NEWTON; step++) {
        sink_weigh(k, &x, &order, 1, &keep);
        square = 0;
        for (uint32_t d = 0; d < dim; d++) square += x.dg[d] * x.dg[d];
        for (uint32_t d = 0; d < dim && step + 1 < NEWTON; d++) x.x[d] -= x.g * x.dg[d] / square;
    }
    memcpy(k->f->dropped, dropped, sizeof dropped);
    if (!keep || !inside(b->s, &x, margin(&x, 0))) return false;
    place(b, 0, &x, 0, margin(&x, 0));
    batch_call(b, SLT_K_REGION, 2);
    if (!as_before(b, &x, 0)) return false;
    find_ways(k, &x, &zero, 1, way);
    tear(k, &x, &zero, 1, way, typical, &apart);
    return apart;
}

/* ---- untying */
enum { PARTS = UNTIE_EVENTS * BATCH };

/* The parts of a crossing: each with its event, and its part of the jump along the crossing's segment. */
static void add_parts(Coincide *q, const Crossing *c, const Tie *t, uint32_t channels) {
    double along = c->rising > 0 ? 1 : -1;
    for (uint32_t e = 0; e < t->n; e++) {
        Crossing part = *c;
        part.event = t->event[e], part.ga = part.gb = 0;
        for (uint32_t ch = 0; ch < channels && !t->whole; ch++) part.jump[ch] = along * t->jump[e][ch];
        q->part[q->nparts++] = part;
        for (uint32_t ch = 0; ch < channels; ch++) part.jump[ch] = along * t->half[e][ch];
        if (t->kink) q->half[q->nhalves++] = part;
    }
}

static bool room(Sink *k) {
    Coincide *q = &k->coincide;
    if (!q->untie) q->untie = untie_new(k->b);
    if (!q->part) q->part = malloc(PARTS * sizeof *q->part);
    if (!q->half) q->half = malloc(PARTS * sizeof *q->half);
    return q->untie && q->part && q->half;
}

/* Those whose weight is known move to the front; returns how many. */
static uint32_t weigh_parts(Sink *k, Crossing *c, uint32_t n) {
    uint32_t kept = 0;
    for (uint32_t from = 0; from < n; from += BATCH) {
        uint64_t order[BATCH];
        bool keep[BATCH], known[BATCH];
        uint32_t all = n - from < BATCH ? n - from : BATCH;
        for (uint32_t i = 0; i < all; i++) order[i] = (uint64_t)(uint32_t)c[from + i].event.site << 32 | i;
        sort_keys(order, all);
        for (uint32_t i = 0, to; i < all; i = to) {
            for (to = i + 1; to < all && order[to] >> 32 == order[i] >> 32;) to++;
            k->b->args.site = (int32_t)(order[i] >> 32);
            sink_weigh(k, c + from, order + i, to - i, keep);
            for (uint32_t j = i; j < to; j++) known[(uint32_t)order[j]] = keep[j - i];
        }
        for (uint32_t i = 0; i < all; i++)
            if (known[i]) c[kept++] = c[from + i];
    }
    return kept;
}

static void untie_some(Sink *k, const Crossing *c, const uint64_t *order, bool *keep, const uint32_t *suspect,
                       uint32_t n, double typical) {
    Coincide *q = &k->coincide;
    Tie tie[UNTIE_MOST];
    uint32_t which[UNTIE_MOST];
    for (uint32_t i = 0; i < n; i++) which[i] = (uint32_t)order[suspect[i]];
    k->failed |= !untie(q->untie, q->apart, c, which, n, NULL, tie);
    for (uint32_t i = 0; i < n; i++) {
        const Crossing *x = &c[which[i]];
        if (!tie[i].n || (tie[i].whole && event_same(&tie[i].event[0], &x->event))) continue;
        if (tie[i].kink && elsewhere(k, x, typical)) k->f->dropped[SLT_DROP_COINCIDENT]++;
        else tie[i].kink = false;
        keep[suspect[i]] = false;
        add_parts(q, x, &tie[i], k->b->s->channels);
    }
}

void coincide_settle(Sink *k, const Crossing *c, const uint64_t *order, bool *keep, uint32_t n) {
    Coincide *q = &k->coincide;
    uint32_t suspect[BATCH], suspects = q->apart ? find_suspects(k, c, order, keep, n, suspect) : 0;
    bool apart[COINCIDE_MAX], any = false;
    double typical = 0;
    q->nparts = q->nhalves = 0;
    if (!suspects) return;
    choose(k, c, order, suspect, suspects);
    for (uint32_t i = 0; i < q->n; i++) typical = fmax(typical, farthest(q->way[i])); /* fmax passes over NAN */
    tear(k, c, q->which, q->n, q->way, typical, apart);
    for (uint32_t i = 0; i < q->n; i++) any |= apart[i];
    if (!any) return;
    if (!room(k)) {
        k->failed = true;
        return;
    }
    for (uint32_t from = 0; from < suspects; from += UNTIE_MOST)
        untie_some(k, c, order, keep, suspect + from, suspects - from < UNTIE_MOST ? suspects - from : UNTIE_MOST,
                   typical);
    q->nparts = weigh_parts(k, q->part, q->nparts), q->nhalves = weigh_parts(k, q->half, q->nhalves);
}
