/* The flanks of a crossing: f beside it may be so steep that it changes on the bracket of the root, too, always towards
 * one sign along an edge. Of every few crossings f is taken once more, outside of the bracket; where it changes there
 * by more than is nothing beside the jump, brackets become as short as floats allow, and f on both sides is carried on
 * in a straight line from two floats to the root. A third tells by how much that may be wrong.
 *
 * Where f is a small power of the distance, or its logarithm, most of what it changes by lies nearer to the edge than
 * any sample, and so does what its derivative integrates to: all of the change is in doubt. */
#include <float.h>
#include <math.h>

#include "runtime/sample/search.h"
#include "runtime/sample/thin.h"

enum {
    EACH = 8,   /* crossings of which one is looked at */
    PLACES = 3, /* on each side, next to the root, */
    LANES = 6,  /* and as many farther away */
    ROOM = BATCH / (2 * LANES)
};
enum { ROUNDED_G = 64 /* in double precision there is room for brackets on which g is more than rounding */ };
#define CHANGES 1e-3 /* of what f changes by in all: so much it does from place to place if it is singular, */
#define ALIKE 0.76   /* and by no smaller part less from one to the next: a distance to the power of 0.4 */
#define STEEP 0x1p-18 /* a change on the bracket that matters, in parts of the jump: an eighth of it on the segment */

static double unit(const SltScene *s) { return s->f64 ? DBL_EPSILON : (double)FLT_EPSILON; }

/* Where the point of parameter t lies along the segment once it is rounded. */
static double place(const Finder *f, const Segment *s, double t) {
    double x[3], sum = 0, square = 0;
    segment_at(s, t, x);
    for (uint32_t d = 0; d < f->s->dim; d++) {
        double along = s->b[d] - s->a[d];
        sum += ((f->s->f64 ? x[d] : (double)(float)x[d]) - s->a[d]) * along, square += along * along;
    }
    return sum / square;
}

static bool known(const Finder *f, uint32_t lane, uint32_t hash, double t) {
    return t >= 0 && t <= 1 && batch_mark(f->b, lane).hash == hash;
}

/* May the next crossing of the line be so near that their jumps nearly take each other away? */
static bool is_narrow(const Item *it) {
    return it->s.narrow || it->s.thin == THIN_FOUND || it->s.ta > 0 || it->s.tb < 1;
}

/* Does f change beside any of these crossings by what matters? Two lanes each. If not, half of what it changes by is in
 * doubt: each speaks for `stands` of them. */
static bool any_steep(Finder *f, const Item *items, const uint32_t *slot, const uint32_t *at, uint32_t n,
                      double stands) {
    Batch *b = f->b;
    bool steep = false;
    for (uint32_t i = 0; i < n; i++) {
        double lo, hi;
        search_bracket(&items[at[i]], &lo, &hi);
        search_put(f, 2 * i, &items[at[i]].s, fmax(0, lo - (hi - lo)));
        search_put(f, 2 * i + 1, &items[at[i]].s, fmin(1, hi + (hi - lo)));
    }
    batch_call(b, SLT_K_SIDES, 2 * n);
    for (uint32_t i = 0; i < n && !steep; i++) {
        const Crossing *c = &f->found[slot[at[i]]];
        for (uint32_t end = 0; end < 2; end++)
            for (uint32_t ch = 0; ch < f->s->channels && known(f, 2 * i + end, end ? c->hb : c->ha, 0.5); ch++) {
                double v = end ? c->before[ch] + c->jump[ch] : c->before[ch];
                double change = fabs(batch_get(b, SLT_OUT_F, ch, 2 * i + end) - v);
                steep |= change > STEEP * fabs(c->jump[ch]) + 8 * unit(f->s) * fabs(v);
            }
    }
    for (uint32_t i = 0; i < n && !steep && f->pairs; i++) {
        Crossing *c = &f->found[slot[at[i]]];
        if (is_narrow(&items[at[i]])) continue;
        for (uint32_t end = 0; end < 2; end++)
            for (uint32_t ch = 0; ch < f->s->channels && known(f, 2 * i + end, end ? c->hb : c->ha, 0.5); ch++) {
                double v = end ? c->before[ch] + c->jump[ch] : c->before[ch];
                double change = fabs(batch_get(b, SLT_OUT_F, ch, 2 * i + end) - v) - 8 * unit(f->s) * fabs(v);
                if (change > 0) c->doubt[ch] += (float)(0.5 * stands * change), c->doubted = true;
            }
    }
    return steep;
}

/* f at one, two and three widths from the root, and how far these lie; lanes `from` on. False: another curve is near,
 * or the floats are too few. */
typedef struct Flank {
    double at[PLACES], f[PLACES][SLT_MAX_CHANNELS];
} Flank;

static bool read_flank(const Finder *f, const Item *it, uint32_t from, const double t[PLACES], uint32_t hash,
                       Flank *k) {
    for (uint32_t i = 0; i < PLACES; i++) {
        k->at[i] = place(f, &it->s, t[i]);
        if (!known(f, from + i, hash, t[i]) || (i && k->at[i] == k->at[i - 1])) return false;
        for (uint32_t ch = 0; ch < f->s->channels; ch++) k->f[i][ch] = batch_get(f->b, SLT_OUT_F, ch, from + i);
    }
    return true;
}

/* f at 1, 1/2 and 1/4 of a segment from the root changes by as much from each to the next, or nearly: all that it
 * changes by up to the root; else 0. */
static double singular(const Finder *f, uint32_t from, uint32_t hash, uint32_t ch, double at_root) {
    double v[PLACES];
    for (uint32_t i = 0; i < PLACES; i++) {
        if (batch_mark(f->b, from + i).hash != hash) return 0;
        v[i] = batch_get(f->b, SLT_OUT_F, ch, from + i);
    }
    double far = v[0] - v[1], near = v[1] - v[2], all = fabs(v[0] - at_root), ratio = far / near;
    return fabs(far) > CHANGES * all && ratio > ALIKE && ratio * ALIKE < 1 ? all : 0;
}

static double slope(const Flank *k, uint32_t i, uint32_t ch) {
    return (k->f[i][ch] - k->f[i + 1][ch]) / (k->at[i] - k->at[i + 1]);
}

/* Where g is 0 along the chord of the bracket's ends, in parts of the segment. */
static double root_t(const Item *it) {
    bool chord = !it->exact && isfinite(it->f1) && isfinite(it->f2) && it->f1 != it->f2;
    return chord ? it->x1 + (it->x2 - it->x1) * (it->f1 / (it->f1 - it->f2)) : it->x1;
}

/* The root where g is 0 along the chord of the bracket's ends. */
static double root_of(const Finder *f, const Item *it) {
    double x1 = place(f, &it->s, it->x1);
    if (it->exact || !isfinite(it->f1) || !isfinite(it->f2) || it->f1 == it->f2) return x1;
    return x1 + (place(f, &it->s, it->x2) - x1) * (it->f1 / (it->f1 - it->f2));
}

static void settle(Finder *f, const Item *it, const Flank k[2], double width, uint32_t lane, Crossing *c) {
    double root = root_of(f, it);
    for (uint32_t ch = 0; ch < f->s->channels; ch++) {
        double v[2], first[2], off = 0;
        for (int end = 0; end < 2; end++) {
            first[end] = slope(&k[end], 0, ch);
            v[end] = k[end].f[0][ch] + first[end] * (root - k[end].at[0]);
            off += fabs((slope(&k[end], 1, ch) - first[end]) * (k[end].at[1] - k[end].at[0]));
            double rim = singular(f, lane + (uint32_t)end * LANES + PLACES, end ? c->hb : c->ha, ch, k[end].f[0][ch]);
            off += rim, f->rims += rim > 0;
        }
        f->steep++;
        off += 0.5 * fabs(first[1] - first[0]) * width; /* the root is known to a float */
        if (!isfinite(v[0]) || !isfinite(v[1]) || !isfinite(off)) continue;
        c->before[ch] = v[0], c->jump[ch] = v[1] - v[0], c->doubt[ch] = (float)off;
        c->doubted |= c->doubt[ch] > 0;
    }
}

/* Where another curve is too near, what f changes by on the bracket is not known. */
static void settle_some(Finder *f, Item *items, const uint32_t *slot, const uint32_t *at, uint32_t n) {
    double t[ROOM][2][PLACES];
    for (uint32_t i = 0; i < n; i++) {
        const Item *it = &items[at[i]];
        double lo, hi;
        search_bracket(it, &lo, &hi);
        double width = fmax(hi - lo, it->tol);
        for (uint32_t j = 0; j < PLACES; j++) {
            t[i][0][j] = lo - j * width, t[i][1][j] = hi + j * width;
            for (uint32_t end = 0; end < 2; end++) {
                double far = ldexp(end ? 1 : -1, -(int)j);
                search_put(f, (2 * i + end) * LANES + j, &it->s, search_clamp(t[i][end][j], 0, 1));
                search_put(f, (2 * i + end) * LANES + PLACES + j, &it->s, (end ? hi : lo) + far);
            }
        }
    }
    batch_call(f->b, SLT_K_SIDES, 2 * LANES * n);
    for (uint32_t i = 0; i < n; i++) {
        Crossing *c = &f->found[slot[at[i]]];
        const Item *it = &items[at[i]];
        Flank k[2];
        if (read_flank(f, it, 2 * LANES * i, t[i][0], c->ha, &k[0]) &&
            read_flank(f, it, 2 * LANES * i + LANES, t[i][1], c->hb, &k[1]))
            settle(f, it, k, it->tol, 2 * LANES * i, c);
    }
}

/* Brackets of the wanted items become as short as floats allow. */
static void shorten(Finder *f, Item *items, uint32_t nitems, const bool *wanted) {
    for (uint32_t i = 0; i < nitems; i++) {
        Item *it = &items[i];
        double least = (f->s->f64 ? ROUNDED_G : 1) * search_least(f, &it->s), width = fabs(it->x2 - it->x1);
        if (!wanted[i]) it->exact = true; /* nothing more to be searched */
        it->tol = fmin(it->tol, least);
        it->left = !it->exact && width > least ? (uint32_t)ceil(log2(width / least)) + 2 : 0;
    }
    search_solve(f, items, nitems);
}

/* A crossing near another one. */
typedef struct Narrow {
    uint32_t item;
    double near[2], far[2]; /* ends of the short bracket, and places beyond them */
    double at_near[SLT_MAX_CHANNELS][2], at_far[SLT_MAX_CHANNELS][2]; /* f there */
    bool known[2];                                                    /* at_far is on the side of its end */
} Narrow;

/* Is f beside the root another one than at the ends of the longer bracket, but for what before + jump rounds? If not,
 * the crossing stays to the bit what it is in a scene that is known to be flat: whether that is known depends on what
 * was asked of the program before. */
static bool changes_beside(const Finder *f, const Narrow *k, const Crossing *c) {
    for (uint32_t ch = 0; ch < f->s->channels; ch++)
        for (uint32_t end = 0; end < 2; end++) {
            double v = end ? c->before[ch] + c->jump[ch] : c->before[ch];
            double rounding = 2 * DBL_EPSILON * (fabs(c->before[ch]) + fabs(v));
            if (!(fabs(k->at_near[ch][end] - v) <= rounding)) return true;
            if (k->known[end] && !(fabs(k->at_far[ch][end] - v) <= rounding)) return true;
        }
    return false;
}

static void settle_narrow(const Finder *f, const Item *it, const Narrow *k, Crossing *c) {
    double root = root_of(f, it), least = search_least(f, &it->s);
    for (uint32_t ch = 0; ch < f->s->channels; ch++) {
        double v[2], slopes[2] = {0}, off = 0;
        for (uint32_t end = 0; end < 2; end++) {
            double from = place(f, &it->s, k->near[end]), run = from - place(f, &it->s, k->far[end]);
            if (k->known[end] && run != 0) slopes[end] = (k->at_near[ch][end] - k->at_far[ch][end]) / run;
            v[end] = k->at_near[ch][end] + slopes[end] * (root - from);
            off += 0.5 * unit(f->s) * fabs(v[end]);
        }
        off += 0.5 * fabs(slopes[1] - slopes[0]) * least; /* the root is known to a float */
        if (!isfinite(v[0]) || !isfinite(v[1]) || !isfinite(off)) continue;
        c->before[ch] = v[0], c->jump[ch] = v[1] - v[0], c->doubt[ch] += (float)off;
        c->doubted |= c->doubt[ch] > 0;
    }
    c->narrow = true;
    if (!it->exact) c->t = search_clamp(root_t(it), k->near[0], k->near[1]), segment_at(&it->s, c->t, c->x);
}

/* Both sides of a narrow band: where its edges move together all that is left is by how much f differs from one to the
 * other, and what f changes by on a bracket of the usual length is as much. So brackets become short, and f is carried
 * on to the root as it changes beside it; rounding of f is in doubt. */
static void settle_pairs(Finder *f, Item *items, uint32_t n, const uint32_t *slot, const uint32_t *at, uint32_t nat) {
    enum { FAR = 8 };
    Narrow all[FIND];
    uint32_t count = 0;
    bool wanted[FIND] = {false};
    for (uint32_t i = 0; i < nat; i++) {
        const Item *it = &items[at[i]];
        if (!is_narrow(it)) continue;
        wanted[at[i]] = true, all[count].item = at[i];
        search_bracket(it, &all[count].far[0], &all[count].far[1]), count++;
    }
    if (!count) return;
    shorten(f, items, n, wanted);
    for (uint32_t i = 0; i < count; i++) {
        Narrow *k = &all[i];
        const Item *it = &items[k->item];
        double away = FAR * search_least(f, &it->s);
        search_bracket(it, &k->near[0], &k->near[1]);
        k->far[0] = fmax(0, fmin(k->far[0], k->near[0] - away)),
        k->far[1] = fmin(1, fmax(k->far[1], k->near[1] + away));
        for (uint32_t end = 0; end < 2; end++) search_put(f, 2 * i + end, &it->s, k->far[end]);
    }
    batch_call(f->b, SLT_K_SIDES, 2 * count);
    for (uint32_t i = 0; i < 2 * count; i++) {
        const Crossing *c = &f->found[slot[all[i / 2].item]];
        all[i / 2].known[i % 2] = known(f, i, i % 2 ? c->hb : c->ha, all[i / 2].far[i % 2]);
        for (uint32_t ch = 0; ch < f->s->channels; ch++)
            all[i / 2].at_far[ch][i % 2] = batch_get(f->b, SLT_OUT_F, ch, i);
    }
    for (uint32_t i = 0; i < 2 * count; i++) search_put(f, i, &items[all[i / 2].item].s, all[i / 2].near[i % 2]);
    batch_call(f->b, SLT_K_SIDES, 2 * count);
    for (uint32_t i = 0; i < count; i++) {
        Crossing *c = &f->found[slot[all[i].item]];
        if (!known(f, 2 * i, c->ha, all[i].near[0]) || !known(f, 2 * i + 1, c->hb, all[i].near[1])) continue;
        for (uint32_t ch = 0; ch < f->s->channels; ch++)
            for (uint32_t end = 0; end < 2; end++)
                all[i].at_near[ch][end] = batch_get(f->b, SLT_OUT_F, ch, 2 * i + end);
        if (changes_beside(f, &all[i], c)) settle_narrow(f, &items[all[i].item], &all[i], c);
    }
}

void flank_settle(Finder *f, Item *items, const uint32_t *slot, uint32_t n) {
    uint32_t at[FIND], asked[FIND], nat = 0, nasked = 0;
    for (uint32_t i = 0; i < n; i++)
        if (slot[i] != UINT32_MAX) at[nat++] = i;
    for (uint32_t i = 0; i < nat; i += EACH) asked[nasked++] = at[i];
    if (!nasked) return;
    if (!any_steep(f, items, slot, asked, nasked, (double)nat / nasked)) {
        if (f->pairs) settle_pairs(f, items, n, slot, at, nat);
        return;
    }
    bool wanted[FIND];
    for (uint32_t i = 0; i < n; i++) wanted[i] = slot[i] != UINT32_MAX;
    shorten(f, items, n, wanted);
    for (uint32_t from = 0; from < nat; from += ROOM)
        settle_some(f, items, slot, at + from, nat - from < ROOM ? nat - from : ROOM);
}
