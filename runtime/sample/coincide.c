/* Boundaries that coincide but move differently: the search gives the whole jump to the first of them.
 *
 * A crossing is suspect where other events than its own decide differently on its two sides too. They may all move
 * alike: the same predicate may be tested twice, or guard another one. So a few suspects of each batch are untied
 * (untie.c), and if that finds something, all are. The derivative of what then is no derivative, a kink, is the mean of
 * its two sides; it is counted, and half their difference goes to the error. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/coincide.h"
#include "runtime/sample/run.h"

enum {
    ASKED = 8,        /* suspects of a batch, before all are, */
    ASKED_SILENT = 4, /* and of silent ones */
    ALONG = 16,       /* `elsewhere` goes aside by the segment's length divided by this */
    NEWTON = 3        /* and so many steps back to g = 0 */
};
/* Parameters are moved by STEP_BRACKETS times the bracket of roots (in a domain of size 1), but at most by STEP_MOST.
 */
#define STEP_MOST 0x1p-9
#define STEP_BRACKETS 0x1p7

double coincide_step(double bracket, double least) { return fmin(fmax(least, STEP_BRACKETS * bracket), STEP_MOST); }

void coincide_free(Coincide *q) { untie_free(q->untie), free(q->part), free(q->half), kink_free(&q->kinks); }

bool coincide_begin(Run *r, double step) { return r->apart || apart_new(r->s, r->j->seed, step, &r->apart); }

void coincide_end(Run *r) {
    apart_free(r->apart), free(r->tied);
    r->apart = NULL, r->tied = NULL, r->tied_known = false;
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
static bool is_alone(const SltScene *s, const Crossing *c) {
    bool rounds = s->site_kind[c->event.site] != SLT_SITE_COMPARE; /* a comparison has no integer, but loops' indices */
    uint32_t key = mix(0x9e3779b9u, (uint32_t)c->event.site + 1), differ = c->ha ^ c->hb;
    double n = rounds ? floor(c->event.boundary) : 0;
    const uint32_t loops = scene_outputs(s, SLT_K_EVENT, SLT_OUT_K);
    for (uint32_t d = 0;; d++) {
        if (key == differ) return true;
        for (int by = -1; by < 1 && rounds; by++) { /* an integer that changes to the next */
            uint32_t below = (uint32_t)(int32_t)fmin(fmax(n + by, -0x1p30), 0x1p30);
            if ((mix(key, below) ^ mix(key, below + 1)) == differ) return true;
        }
        if (d == loops) return false;
        key = mix(key, (uint32_t)c->event.k[d]);
    }
}

static bool is_suspect(const Sink *k, const Crossing *c) {
    const SltScene *s = k->b->s;
    bool skips = s->site_skips && s->site_skips[c->event.site],   /* other iterations may decide for moved ones, */
        ray = s->site_kind[c->event.site] >= SLT_SITE_SILHOUETTE, /* another edge be the one that a ray passes */
        tied = k->coincide.tied && k->coincide.tied[c->event.site];
    return !skips && !ray && (tied || !is_alone(s, c));
}

/* Where two boundaries lie in neighbouring floats, g of both is 0 between these, and the kernel names one of them
 * twice. Does the hash name another comparison alone, outside of loops? */
static void take_other(const SltScene *s, Crossing *c) {
    uint32_t differ = c->ha ^ c->hb;
    for (uint32_t site = 0; site < s->nsites; site++)
        if (s->site_kind[site] == SLT_SITE_COMPARE && mix(0x9e3779b9u, site + 1) == differ) {
            c->event = (Event){.site = (int32_t)site};
            return;
        }
}

void coincide_name(const Sink *k, Crossing *c, uint32_t n) {
    for (uint32_t i = 0; i < n && k->coincide.apart; i++)
        if (is_suspect(k, &c[i]) && !is_alone(k->b->s, &c[i])) take_other(k->b->s, &c[i]);
}

uint32_t coincide_sift(const Sink *k, Crossing *c, uint32_t n) {
    uint32_t kept = 0;
    for (uint32_t i = 0; i < n && k->coincide.apart; i++)
        if (is_suspect(k, &c[i])) {
            if (kept != i) c[kept] = c[i];
            kept++;
        }
    return kept;
}

/* Those of order[0 .. n) that are kept and may be not alone; how many. */
static uint32_t find_suspects(const Sink *k, const Crossing *c, const uint64_t *order, const bool *keep, uint32_t n,
                              uint32_t *list) {
    uint32_t suspects = 0;
    for (uint32_t i = 0; i < n; i++) {
        const Crossing *x = &c[(uint32_t)order[i]];
        if (keep[i] && is_suspect(k, x)) list[suspects++] = i;
    }
    return suspects;
}

/* ---- untying */
static void push(Sink *k, Crossing **list, uint32_t *n, uint32_t *cap, const Crossing *c) {
    if (*n == *cap) {
        uint32_t more = 2 * *cap + BATCH;
        Crossing *grown = realloc(*list, more * sizeof *grown);
        if (!grown) {
            k->failed = true;
            return;
        }
        *list = grown, *cap = more;
    }
    (*list)[(*n)++] = *c;
}

/* So much of a jump, and of what is uncertain of it. */
static void push_part(Sink *k, Crossing *part, const double *jump, const double *half, double times) {
    Coincide *q = &k->coincide;
    uint32_t channels = k->b->s->channels;
    for (uint32_t ch = 0; ch < channels && jump; ch++) part->jump[ch] = times * jump[ch];
    push(k, &q->part, &q->nparts, &q->part_cap, part);
    for (uint32_t ch = 0; ch < channels && half; ch++) part->jump[ch] = times * half[ch];
    if (half) push(k, &q->half, &q->nhalves, &q->half_cap, part);
}

/* The parts of a crossing: each with its event, and its part of the jump along the crossing's segment. */
static void add_parts(Sink *k, const Crossing *c, const Tie *t) {
    double along = c->rising > 0 ? 1 : -1;
    for (uint32_t e = 0; e < t->n; e++) {
        Crossing part = *c;
        part.event = t->event[e], part.ga = part.gb = 0;
        push_part(k, &part, t->whole ? NULL : t->jump[e], t->kink || t->doubted ? t->half[e] : NULL, along);
    }
    for (uint32_t e = 0; e < t->naway; e++) {
        const Away *a = &t->away[e];
        for (int end = 0; end < 2; end++) {
            Crossing part = *c;
            part.event = a->event, part.ga = part.gb = part.bracket = 0;
            part.apart = k->coincide.apart, part.move = (uint8_t)(1 + a->move);
            memcpy(part.x, a->x[end], sizeof part.x);
            if (a->part[end] > 0) push_part(k, &part, a->jump, a->half, along * a->part[end]);
        }
    }
}

uint32_t coincide_weigh(Sink *k, Crossing *c, uint32_t n) {
    uint32_t kept = 0;
    for (uint32_t from = 0; from < n; from += BATCH) {
        uint64_t order[BATCH];
        bool keep[BATCH], known[BATCH];
        uint32_t all = n - from < BATCH ? n - from : BATCH;
        for (uint32_t i = 0; i < all; i++)
            order[i] = (uint64_t)(uint32_t)c[from + i].event.site << 40 | (uint64_t)c[from + i].move << 32 | i;
        sort_keys(order, all);
        for (uint32_t i = 0, to; i < all; i = to) {
            for (to = i + 1; to < all && order[to] >> 32 == order[i] >> 32;) to++;
            k->b->args.site = (int32_t)(order[i] >> 40);
            sink_move(k, &c[from + (uint32_t)order[i]]);
            sink_weigh(k, c + from, order + i, to - i, keep);
            for (uint32_t j = i; j < to; j++) known[(uint32_t)order[j]] = keep[j - i];
        }
        for (uint32_t i = 0; i < all; i++)
            if (known[i]) c[kept++] = c[from + i];
    }
    sink_move(k, NULL);
    return kept;
}

bool coincide_aside(Sink *k, const Crossing *c, Crossing *x) {
    Batch *b = k->b;
    uint32_t dim = b->s->dim, steep = 0;
    uint64_t order = 0, dropped[SLT_DROP_REASONS];
    SltPlace dropped_at[SLT_DROP_REASONS];
    bool keep;
    double square = 0, length = 0;
    *x = *c;
    for (uint32_t d = 0; d < dim; d++) {
        square += c->dg[d] * c->dg[d], steep = fabs(c->dg[d]) > fabs(c->dg[steep]) ? d : steep;
        length += c->direction[d] * c->direction[d];
    }
    /* Along the tangent that has no part of a third axis, and back to g = 0. */
    uint32_t other = steep == 0 ? 1 : 0;
    double by = sqrt(length / square) / ALONG;
    x->x[other] += by * c->dg[steep], x->x[steep] -= by * c->dg[other];
    b->args.site = c->event.site;
    memcpy(dropped_at, k->f->dropped_at, sizeof dropped_at);
    memcpy(dropped, k->f->dropped, sizeof dropped); /* x is no crossing, and must not be counted as dropped */
    for (uint32_t step = 0; step < NEWTON; step++) {
        sink_weigh(k, x, &order, 1, &keep);
        square = 0;
        for (uint32_t d = 0; d < dim; d++) square += x->dg[d] * x->dg[d];
        for (uint32_t d = 0; d < dim && step + 1 < NEWTON; d++) x->x[d] -= x->g * x->dg[d] / square;
    }
    memcpy(k->f->dropped, dropped, sizeof dropped);
    memcpy(k->f->dropped_at, dropped_at, sizeof dropped_at);
    return keep;
}

/* A corner with a hidden boundary looks like a kink, but only there: is there one a little further along, too? */
static bool elsewhere(Sink *k, const Crossing *c) {
    Crossing x;
    uint32_t zero = 0;
    Tie tie;
    if (k->b->s->dim == 1) return true;
    if (!coincide_aside(k, c, &x)) return false;
    k->failed |= !untie(k->coincide.untie, k->coincide.apart, &x, &zero, 1, NULL, &tie);
    return tie.n && tie.kink;
}

/* Has the crossing a tie in which its event is not alone? */
static bool is_tied(const Tie *t, const Crossing *c) {
    return (t->n || t->naway) && !(t->whole && event_same(&t->event[0], &c->event));
}

static void untie_some(Sink *k, const Crossing *c, const uint64_t *order, bool *keep, const uint32_t *suspect,
                       uint32_t n) {
    Coincide *q = &k->coincide;
    Tie tie[UNTIE_MOST];
    uint32_t which[UNTIE_MOST] = {0};
    for (uint32_t i = 0; i < n; i++) which[i] = (uint32_t)order[suspect[i]];
    k->failed |= !untie(q->untie, q->apart, c, which, n, NULL, tie);
    for (uint32_t i = 0; i < n; i++) {
        const Crossing *x = &c[which[i]];
        if (!is_tied(&tie[i], x)) continue;
        if (tie[i].kink && elsewhere(k, x)) finder_drop(k->f, SLT_DROP_COINCIDENT, x);
        else tie[i].kink = false;
        keep[suspect[i]] = false;
        add_parts(k, x, &tie[i]);
    }
}

/* Is any of a few of the suspects tied? */
static bool any_tied(Sink *k, const Crossing *c, const uint64_t *order, const uint32_t *suspect, uint32_t n,
                     uint32_t most) {
    uint32_t share = (n + most - 1) / most, asked = 0, which[ASKED];
    Tie tie[ASKED];
    bool any = false;
    for (uint32_t i = 0; i < n; i += share) which[asked++] = (uint32_t)order[suspect[i]];
    k->failed |= !untie(k->coincide.untie, k->coincide.apart, c, which, asked, NULL, tie);
    for (uint32_t i = 0; i < asked; i++) any |= is_tied(&tie[i], &c[which[i]]);
    return any;
}

/* Those of the suspects that are not alone, to the front: few, which are then searched for together. */
static uint32_t find_moved(Sink *k, const Crossing *c, const uint64_t *order, uint32_t *suspect, uint32_t n) {
    Coincide *q = &k->coincide;
    uint32_t kept = 0;
    for (uint32_t from = 0; from < n; from += UNTIE_MOST) {
        uint32_t which[UNTIE_MOST], some = n - from < UNTIE_MOST ? n - from : UNTIE_MOST;
        bool alone[UNTIE_MOST];
        for (uint32_t i = 0; i < some; i++) which[i] = (uint32_t)order[suspect[from + i]];
        untie_alone(q->untie, q->apart, c, which, some, alone);
        for (uint32_t i = 0; i < some; i++)
            if (!alone[i]) suspect[kept++] = suspect[from + i];
    }
    return kept;
}

void coincide_settle(Sink *k, const Crossing *c, const uint64_t *order, bool *keep, uint32_t n) {
    Coincide *q = &k->coincide;
    uint32_t suspect[BATCH], suspects = q->apart ? find_suspects(k, c, order, keep, n, suspect) : 0;
    q->nparts = q->nhalves = 0;
    if (!suspects) return;
    if (!q->untie && !(q->untie = untie_new(k->b))) {
        k->failed = true;
        return;
    }
    /* Edges that lie on each other and are hidden are many, and silent. */
    if (!any_tied(k, c, order, suspect, suspects, c->silent ? ASKED_SILENT : ASKED)) return;
    if (suspects > UNTIE_MOST) suspects = find_moved(k, c, order, suspect, suspects);
    for (uint32_t from = 0; from < suspects; from += UNTIE_MOST)
        untie_some(k, c, order, keep, suspect + from, suspects - from < UNTIE_MOST ? suspects - from : UNTIE_MOST);
    q->nparts = coincide_weigh(k, q->part, q->nparts), q->nhalves = coincide_weigh(k, q->half, q->nhalves);
}
