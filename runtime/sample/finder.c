/* From segments whose ends lie in different regions to verified crossings.
 *
 * A batch of segments at a time: the kernel `event` says for each segment which event separates its ends, and g there;
 * the root of that g is bracketed with the kernel `site` (Chandrupatla's method, never more than two steps behind
 * bisection); the kernel `sides` gives f and the region at the two ends of the final bracket. If those are the regions
 * of the segment's ends, that was the only crossing; else the parts whose ends still differ go back on the stack. Where
 * there is no event or no change of sign, the segment is bisected on the region. window.c has what scenes with rays
 * need beside this. */
#include <assert.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/prove.h"
#include "runtime/sample/search.h"
#include "runtime/sample/thin.h"

bool finder_init(Finder *f, Batch *b) {
    memset(f, 0, sizeof *f);
    f->b = b, f->s = b->s;
    f->cap = 8 * BATCH;
    f->stack = malloc(f->cap * sizeof *f->stack);
    f->split = malloc(FIND * sizeof *f->split), f->still = malloc(FIND * sizeof *f->still);
    f->found = malloc(BATCH * sizeof *f->found);
    f->items = malloc(FIND * sizeof(Item));
    f->order = malloc(BATCH * sizeof *f->order);
    f->roots = calloc(1, sizeof *f->roots); /* whole vectors are read */
    return f->stack && f->split && f->still && f->found && f->items && f->order && f->roots;
}

void finder_free(Finder *f) {
    free(f->alike), free(f->silent), free(f->stack), free(f->sorted), free(f->keys), free(f->split), free(f->still),
        free(f->found), free(f->items), free(f->order), free(f->roots);
    memset(f, 0, sizeof *f);
}

enum { RADIX_LEAST = 32, RADIX_MOST = 2048 }; /* keys */

/* By bytes, the lowest first, of those in which some keys differ. */
static void sort_by_bytes(uint64_t *v, uint32_t n, uint64_t differ) {
    uint64_t other[RADIX_MOST], *from = v, *to = other;
    for (uint32_t shift = 0; shift < 64; shift += 8) {
        if (!(differ >> shift & 255)) continue;
        uint32_t place[256] = {0}, sum = 0;
        for (uint32_t i = 0; i < n; i++) place[from[i] >> shift & 255]++;
        for (uint32_t k = 0; k < 256; k++) {
            const uint32_t count = place[k];
            place[k] = sum, sum += count;
        }
        for (uint32_t i = 0; i < n; i++) to[place[from[i] >> shift & 255]++] = from[i];
        uint64_t *swap = from;
        from = to, to = swap;
    }
    if (from != v) memcpy(v, from, n * sizeof *v);
}

void sort_keys(uint64_t *v, uint32_t n) {
    bool sorted = true, numbered = true; /* numbered: the lower halves are in order already, as most callers' are */
    uint64_t differ = 0;
    for (uint32_t i = 1; i < n; i++) {
        sorted &= v[i - 1] <= v[i], numbered &= (uint32_t)v[i - 1] <= (uint32_t)v[i];
        differ |= v[i] ^ v[0];
    }
    if (sorted) return;
    if (n >= RADIX_LEAST && n <= RADIX_MOST) {
        sort_by_bytes(v, n, numbered ? differ >> 32 << 32 : differ);
        return;
    }
    static const uint32_t gaps[] = {701, 301, 132, 57, 23, 10, 4, 1};
    for (size_t g = 0; g < sizeof gaps / sizeof *gaps; g++)
        for (uint32_t gap = gaps[g], i = gap; i < n; i++) {
            uint64_t x = v[i];
            uint32_t at = i;
            for (; at >= gap && v[at - gap] > x; at -= gap) v[at] = v[at - gap];
            v[at] = x;
        }
}

double search_least(const Finder *f, const Segment *s) {
    double len = 0, mag = 0;
    for (uint32_t d = 0; d < f->s->dim; d++) {
        len = search_greater(len, fabs(s->b[d] - s->a[d]));
        mag = search_greater(mag, search_greater(fabs(s->a[d]), fabs(s->b[d])));
    }
    return 2 * (f->s->f64 ? DBL_EPSILON : (double)FLT_EPSILON) * mag / len;
}

/* How near a root must be bracketed, in parts of the whole segment. */
static double tolerance(const Finder *f, const Segment *s, double least) {
    if (s->fine) return least;
    double usual = root_tolerance(f->coarse && s->state != SEARCH_FRESH);
    return search_greater(f->s->halvings ? ldexp(1, -(int)f->s->halvings) : usual, least);
}

void finder_push(Finder *f, const Segment *s) {
    if (f->n == f->cap) {
        Segment *more = realloc(f->stack, 2 * (size_t)f->cap * sizeof *more);
        if (!more) {
            f->failed = true;
            return;
        }
        f->stack = more, f->cap *= 2;
    }
    f->stack[f->n++] = *s;
}

void finder_add(Finder *f, Segment *s, Mark a, Mark b, double threshold) {
    s->ta = 0, s->tb = 1, s->ma = a, s->mb = b, s->threshold = threshold, s->halvings = 0, s->cut = 0;
    s->touches = 0, s->fine = s->hidden = false;
    if (f->proves && !search_differ(a, b, threshold)) {
        prove_add(f, s, 0, 1, a, b);
        return;
    }
    s->state = a.hash == b.hash && depth_differs(a.depth, b.depth, threshold) ? SEARCH_HALVE : SEARCH_ROOT;
    finder_push(f, s);
}

void place_least(SltPlace *to, const SltPlace *other) {
    if (!other->known || to->line) return; /* what has a place in the source keeps it */
    if (!to->known) *to = *other;
    for (uint32_t d = 0; d < 3; d++) {
        if (other->x[d] > to->x[d]) return;
        if (other->x[d] < to->x[d]) *to = *other;
    }
}

static void drop(Finder *f, SltDrop reason, uint8_t owner, const SltPlace *at) {
    f->dropped[reason]++;
    if (f->lost && reason != SLT_DROP_COINCIDENT) f->lost[owner] = true;
    place_least(&f->dropped_at[reason], at);
}

void finder_note_size(const Finder *f, Sizes *s, const Crossing *c) {
    s->n++;
    for (uint32_t i = 0; i < f->s->channels; i++) s->sum += fabs(c->jump[i]), s->by[i] += fabs(c->jump[i]);
}

void sizes_add(Sizes *to, const Sizes *s) {
    to->n += s->n, to->sum += s->sum;
    for (uint32_t i = 0; i < SLT_MAX_CHANNELS; i++) to->by[i] += s->by[i];
}

void finder_drop(Finder *f, SltDrop reason, const Crossing *c) {
    if (reason != SLT_DROP_COINCIDENT) finder_note_size(f, &f->gone, c);
    SltPlace at = {.known = true, .site = (uint32_t)(c->event.site + 1), .stream = c->stream, .rand0 = c->rand0};
    memcpy(at.x, c->side[0], sizeof at.x), memcpy(at.beyond, c->side[1], sizeof at.beyond);
    drop(f, reason, c->owner, &at);
}

void finder_drop_part(Finder *f, SltDrop reason, const Segment *s, int32_t site) {
    SltPlace at = {.known = true, .stream = s->stream, .rand0 = s->rand0};
    if (site >= 0 && (uint32_t)site < f->s->nsites) at.site = (uint32_t)site + 1;
    segment_at(s, s->ta, at.x), segment_at(s, s->tb, at.beyond);
    if (reason != SLT_DROP_STATIC) f->parts_gone += s->base;
    drop(f, reason, s->owner, &at);
}

/* What a part is that goes back on the stack, besides its ends. */
typedef struct Part {
    double cut; /* the t at which to bisect it; 0: in the middle */
    SearchState state;
    uint8_t touches;
} Part;

static void push_part(Finder *f, const Segment *s, double ta, double tb, const Mark *a, const Mark *b, Part as) {
    if (!search_differ(*a, *b, s->threshold)) {
        if (!f->proves || !(tb > ta) || s->halvings >= search_most_halvings(f->s)) return;
        Segment alike = *s;
        alike.touches = as.touches;
        prove_add(f, &alike, ta, tb, *a, *b);
        return;
    }
    if (!(tb > ta) || s->halvings >= search_most_halvings(f->s)) {
        finder_drop_part(f, SLT_DROP_HALVINGS, s, -1);
        return;
    }
    Segment part = *s;
    part.ta = ta, part.tb = tb, part.ma = *a, part.mb = *b;
    part.halvings++, part.state = (uint8_t)as.state, part.cut = as.cut, part.event_threshold = 0;
    part.touches = as.touches;
    finder_push(f, &part);
}

void search_push(Finder *f, const Segment *s, double ta, double tb, Mark a, Mark b, SearchState state) {
    push_part(f, s, ta, tb, &a, &b, (Part){.state = state, .touches = s->touches});
}

/* Room for n more crossings. `full` runs kernels in the same batch, so this is never called while outputs of a kernel
 * are still to be read. */
static void found_reserve(Finder *f, uint32_t n) {
    if (f->nfound + n > BATCH) f->full(f->full_user, f->found, f->nfound), f->nfound = 0;
    if (f->nsilent + n > BATCH) f->silent_full(f->full_user, f->silent, f->nsilent), f->nsilent = 0;
}

/* ---- bisection on the region */
static double middle(const Segment *s) { return s->cut > s->ta && s->cut < s->tb ? s->cut : 0.5 * (s->ta + s->tb); }

static void flush_split(Finder *f) {
    Batch *b = f->b;
    window_settle_still(f);
    if (!f->nsplit) return;
    for (uint32_t i = 0; i < f->nsplit; i++) search_put(f, i, &f->split[i], middle(&f->split[i]));
    batch_call(b, SLT_K_REGION, f->nsplit);
    for (uint32_t i = 0; i < f->nsplit; i++) {
        const Segment *s = &f->split[i];
        double mid = middle(s);
        Mark m = batch_mark(b, i), a = s->ma, e = s->mb;
        if (s->state == SEARCH_DOUBT && m.hash == a.hash) {
            window_doubt(f, s, mid, m);
            continue;
        }
        SearchState state = s->cut != 0               ? SEARCH_AGAIN /* a cut beside a root need not shorten the part */
                            : s->state == SEARCH_FLAT ? SEARCH_FLAT
                                                      : SEARCH_ROOT;
        search_push(f, s, mid, s->tb, m, e, state);
        search_push(f, s, s->ta, mid, a, m, state);
    }
    f->nsplit = 0;
}

/* Puts s among the segments to be bisected; one that is as short as the tolerance is dropped for this reason. */
static void split(Finder *f, const Segment *s, double tol, SltDrop reason, int32_t site) {
    if (s->tb - s->ta <= tol) {
        if (search_has_depth(f->s) && s->state != SEARCH_FRESH && s->state != SEARCH_DOUBT) {
            window_ask_again(f, s, s->ta, s->tb, s->ma, s->mb);
            return;
        }
        /* A jump that stands still adds nothing. */
        bool stands = reason == SLT_DROP_NO_EVENT && f->s->still && !search_has_windows(f->s);
        if (reason == SLT_DROP_NO_EVENT && search_has_windows(f->s) && s->ma.hash == s->mb.hash)
            assert(f->nstill < FIND), f->still[f->nstill++] = *s;
        else if (!stands) finder_drop_part(f, reason, s, site);
        return;
    }
    assert(f->nsplit < FIND);
    f->split[f->nsplit++] = *s;
}

/* ---- root of g on the bracket */
static bool same_sign(double a, double b) { return (a < 0) == (b < 0); }

/* By how much, of itself, the slope of g may change between x1 and the root: more than this is asked for a root that is
 * nearer, as the slope is what the crossing weighs. Not of a g that jumps, whose root is anywhere in the bracket. */
#define SLOPE_KEEPS 0x1p-26
#define SMOOTH 0.5

static bool slope_changes(const Item *it) {
    double width = it->x2 - it->x1, far = it->x3 - it->x2, slope = (it->f2 - it->f1) / width;
    if (it->x3 == it->x1 || far == 0) return false;
    double bend = fabs((it->f3 - it->f2) / far - slope), change = bend / fabs(it->x3 - it->x1) * fabs(it->f1 / slope);
    return bend < SMOOTH * fabs(slope) && change > SLOPE_KEEPS * fabs(slope); /* NaN is not */
}

/* Bisections that make a width the tolerance, and two: ceil(log2(width / tol)) + 2. */
static uint32_t steps_to(double width, double tol) {
    enum { MANTISSA = 52, BIAS = 1023, NEAR = 1 << 12 };
    const double times = width / tol;
    uint64_t bits;
    memcpy(&bits, &times, sizeof bits);
    /* The logarithm of what is little more than a power of two may be rounded to a whole number. */
    if (times > 1 && (bits & ((1ull << MANTISSA) - 1)) > NEAR) return (uint32_t)(bits >> MANTISSA) - BIAS + 1 + 2;
    return (uint32_t)ceil(log2(times)) + 2;
}

/* In double precision a g that bends much is asked for a root that is nearer. */
static void ask_nearer(Item *it) {
    const double width = fabs(it->x2 - it->x1);
    if (!(it->least > 0) || !(width <= it->tol) || !(width > it->least) || it->exact || !slope_changes(it)) return;
    it->tol = it->least, it->least = 0;
    it->left = steps_to(width, it->tol);
}

static void root_begin(Item *it) {
    it->x1 = it->s.ta, it->f1 = it->ga, it->x2 = it->s.tb, it->f2 = it->gb;
    it->x3 = it->x2, it->f3 = it->f2;
    it->exact = false;
    double width = it->s.tb - it->s.ta;
    it->left = width > it->tol ? steps_to(width, it->tol) : 0;
    if (it->ga == 0 || it->gb == 0) {
        it->exact = true;
        if (it->ga != 0) it->x1 = it->s.tb;
        it->f1 = 0;
    }
}

static void load_root(Roots *r, uint32_t i, const Item *it) {
    r->x1[i] = it->x1, r->x2[i] = it->x2, r->x3[i] = it->x3, r->f1[i] = it->f1, r->f2[i] = it->f2, r->f3[i] = it->f3;
    r->tol[i] = it->tol, r->left[i] = it->left, r->exact[i] = -(int64_t)it->exact;
}

static void store_root(const Roots *r, uint32_t i, Item *it) {
    it->x1 = r->x1[i], it->x2 = r->x2[i], it->x3 = r->x3[i], it->f1 = r->f1[i], it->f2 = r->f2[i], it->f3 = r->f3[i];
    it->left = (uint32_t)r->left[i], it->exact = r->exact[i];
}

static void move_root(Roots *r, uint32_t to, uint32_t i) {
    r->x1[to] = r->x1[i], r->x2[to] = r->x2[i], r->x3[to] = r->x3[i], r->f1[to] = r->f1[i], r->f2[to] = r->f2[i];
    r->f3[to] = r->f3[i], r->tol[to] = r->tol[i], r->next[to] = r->next[i], r->left[to] = r->left[i];
    r->exact[to] = r->exact[i];
}

/* Roots of the items order[0..n), all of one site. */
static void solve_site(Finder *f, Item *items, uint64_t *order, uint32_t n) {
    Batch *b = f->b;
    Roots *r = f->roots;
    b->args.site = items[(uint32_t)order[0]].event.site;
    for (uint32_t i = 0; i < n; i++) load_root(r, i, &items[(uint32_t)order[i]]);
    for (;;) {
        uint32_t active = 0;
        for (uint32_t i = 0; i < n && b->f64; i++) {
            Item *it = &items[(uint32_t)order[i]];
            store_root(r, i, it), ask_nearer(it), load_root(r, i, it);
        }
        b->fill->roots_step(r, n);
        for (uint32_t i = 0; i < n; i++) {
            Item *it = &items[(uint32_t)order[i]];
            if (!r->go[i]) {
                store_root(r, i, it);
                continue;
            }
            search_put(f, active, &it->s, r->next[i]);
            batch_set_event(b, active, &it->event);
            if (active != i) move_root(r, active, i), order[active] = order[i];
            active++;
        }
        if (!active) return;
        batch_call(b, SLT_K_SITE, active);
        n = active;
        b->fill->roots_take(r, n, batch_out(b, SLT_OUT_G, 0), b->f64);
    }
}

void search_solve(Finder *f, Item *items, uint32_t n) {
    for (uint32_t i = 0; i < n; i++) f->order[i] = (uint64_t)(uint32_t)items[i].event.site << 32 | i;
    sort_keys(f->order, n);
    for (uint32_t from = 0, to; from < n; from = to) {
        int32_t site = items[(uint32_t)f->order[from]].event.site;
        for (to = from + 1; to < n && items[(uint32_t)f->order[to]].event.site == site;) to++;
        solve_site(f, items, f->order + from, to - from);
    }
}

/* ---- one batch */
/* Does g say on which side the ends lie? It may be infinite where the window of a ray is empty. */
static bool usable(const Finder *f, const Item *it) {
    if (isfinite(it->ga) && isfinite(it->gb)) return true;
    return window_site(f->s, it->event.site) && !isnan(it->ga) && !isnan(it->gb);
}

static bool changes_sign(const Item *it) { return it->ga != 0 && it->gb != 0 && !same_sign(it->ga, it->gb); }

/* The event of lane i, after a call of the event kernel. */
static void take_event(const Batch *b, uint32_t i, Event *e) {
    *e = (Event){.site = batch_get_int(b, SLT_OUT_SITE, 0, i)};
    for (uint32_t d = 0; d < b->layout->out[SLT_OUT_K].count; d++) e->k[d] = batch_get_int(b, SLT_OUT_K, d, i);
    if (batch_has(b, SLT_OUT_BOUNDARY)) e->boundary = batch_get(b, SLT_OUT_BOUNDARY, 0, i);
    for (uint32_t end = 0; end < b->layout->out[SLT_OUT_WINDOW].count; end++)
        e->window[end] = batch_get(b, SLT_OUT_WINDOW, end, i);
    e->line = scene_is_of_mesh(b->s, e->site);
}

/* Items are long, and mostly stay where they are. */
static void keep_item(Item *items, uint32_t *kept, uint32_t i) {
    if (*kept != i) items[*kept] = items[i];
    ++*kept;
}

/* Which event separates the ends of each item, and g there. Items with a root to look for move to the front; returns
 * how many they are. */
static uint32_t ask_events(Finder *f, Item *items, uint32_t n) {
    Batch *b = f->b;
    for (uint32_t i = 0; i < n; i++) {
        search_put(f, 2 * i, &items[i].s, items[i].s.ta);
        search_put(f, 2 * i + 1, &items[i].s, items[i].s.tb);
        for (uint32_t k = 0; k < scene_outputs(f->s, SLT_K_REGION, SLT_OUT_WITNESS); k++) {
            batch_set_int(b, SLT_IN_WITNESS0 + k, 2 * i, items[i].s.ma.witness[k]);
            batch_set_int(b, SLT_IN_WITNESS0 + k, 2 * i + 1, items[i].s.mb.witness[k]);
        }
        if (!search_has_windows(f->s)) continue;
        double threshold = items[i].s.event_threshold > 0 ? items[i].s.event_threshold : items[i].s.threshold;
        batch_set(b, SLT_IN_THRESHOLD, 2 * i, threshold), batch_set(b, SLT_IN_THRESHOLD, 2 * i + 1, threshold);
    }
    batch_call(b, SLT_K_EVENT, 2 * n);
    uint32_t kept = 0;
    for (uint32_t i = 0; i < n; i++) {
        Item *it = &items[i];
        it->ga = batch_get(b, SLT_OUT_G, 0, 2 * i), it->gb = batch_get(b, SLT_OUT_G, 0, 2 * i + 1);
        take_event(b, 2 * i, &it->event);
        if (it->event.site == -1 && search_differ_in_face(it->s.ma, it->s.mb, it->s.threshold)) continue;
        if (it->event.site == -1 && it->s.ma.hash == it->s.mb.hash) it->s.state = SEARCH_DOUBT;
        if (it->event.site < 0 || (uint32_t)it->event.site >= f->s->nsites) {
            split(f, &it->s, it->tol, SLT_DROP_NO_EVENT, -1);
        } else if (f->s->site_static && f->s->site_static[it->event.site]) {
            finder_drop_part(f, SLT_DROP_STATIC, &it->s, it->event.site);
        } else if (!usable(f, it)) {
            split(f, &it->s, it->tol, SLT_DROP_NOT_FINITE, it->event.site);
        } else if (it->s.tb - it->s.ta <= it->tol && (window_site(f->s, it->event.site) || !changes_sign(it))) {
            /* The part is as short as can be: g is zero on it but for rounding, and if not, weigh in sink.c drops it.
             * It may be flat on a side. */
            it->x1 = 0.5 * (it->s.ta + it->s.tb), it->exact = true, it->left = 0;
            keep_item(items, &kept, i);
        } else if ((it->ga == 0 && it->gb == 0) || (it->ga != 0 && it->gb != 0 && same_sign(it->ga, it->gb))) {
            if (window_site(f->s, it->event.site)) window_cut_near_zero(f, it);
            split(f, &it->s, it->tol, SLT_DROP_NO_ROOT, it->event.site);
        } else {
            if (window_site(f->s, it->event.site)) it->pad = window_padding(f, &it->s, it->tol);
            root_begin(it);
            keep_item(items, &kept, i);
        }
    }
    return kept;
}

void search_bracket(const Item *it, double *lo, double *hi) {
    double other = it->exact ? it->x1 : it->x2;
    *lo = search_lesser(it->x1, other), *hi = search_greater(it->x1, other);
    if (it->pad > 0) {
        *lo = search_greater(it->s.ta, *lo - it->pad), *hi = search_lesser(it->s.tb, *hi + it->pad);
    } else if (it->exact) {
        /* g is exactly zero at x1: a bracket of the tolerance around x1, inside the part. */
        *lo = search_greater(it->s.ta, it->x1 - 0.5 * it->tol), *hi = search_lesser(it->s.tb, it->x1 + 0.5 * it->tol);
    }
}

static bool has_silent(Finder *f) {
    if (!f->silent && !(f->silent = malloc(BATCH * sizeof *f->silent))) f->failed = true;
    return f->silent;
}

/* The crossing's place in `found`, or UINT32_MAX. */
static uint32_t accept(Finder *f, const Item *it, double lo, double hi, Mark before, Mark after, uint32_t lane) {
    uint32_t channels = f->s->channels;
    assert(f->nfound < BATCH);
    Crossing *c = &f->found[f->nfound];
    bool jumps = false, finite = true;
    *c = (Crossing){.event = it->event};
    for (uint32_t i = 0; i < channels; i++) {
        c->before[i] = batch_get(f->b, SLT_OUT_F, i, lane);
        c->jump[i] = batch_get(f->b, SLT_OUT_F, i, lane + 1) - c->before[i];
        jumps |= c->jump[i] != 0;
        finite &= isfinite(c->jump[i]);
    }
    f->crossings++;
    if (!finite) {
        finder_drop_part(f, SLT_DROP_NOT_FINITE, &it->s, it->event.site);
        return UINT32_MAX;
    }
    if (f->only_hidden && !it->s.hidden) return UINT32_MAX;
    if (f->met) f->met[it->s.owner] = true;
    f->followed += it->s.thin == THIN_FOUND;
    bool tied = f->tied && f->tied[it->event.site],
         several = f->ties && before.hash != after.hash && !search_has_depth(f->s); /* decisions, may be */
    if (!jumps && !((tied || several) && has_silent(f))) return UINT32_MAX;
    c->t = it->x1;
    double slack = 0; /* by how much rounding of g widens the bracket, in parts of the segment */
    if (it->exact && it->s.tb - it->s.ta <= it->tol) {
        c->ga = it->ga, c->gb = it->gb;
        if (window_site(f->s, it->event.site)) slack = 2 * window_padding(f, &it->s, it->tol);
    } else if (!it->exact) {
        /* The secant's zero inside the final bracket is much closer to the root than the bracket's ends. */
        double t = it->x1 + (it->x2 - it->x1) * (it->f1 / (it->f1 - it->f2));
        c->t = t >= lo && t <= hi ? t : 0.5 * (lo + hi); /* also where an end of g is infinite */
        c->ga = it->f1, c->gb = it->f2;
    }
    segment_at(&it->s, c->t, c->x), segment_at(&it->s, lo, c->side[0]), segment_at(&it->s, hi, c->side[1]);
    double len = 0;
    for (uint32_t d = 0; d < f->s->dim; d++) {
        c->direction[d] = it->s.b[d] - it->s.a[d];
        len += c->direction[d] * c->direction[d];
    }
    c->bracket = sqrt(len) * (hi - lo + slack);
    c->rising = it->ga < it->gb ? 1 : -1;
    c->base = it->s.base, c->rand0 = it->s.rand0, c->stream = it->s.stream, c->axis = it->s.axis, c->cls = it->s.cls;
    c->owner = it->s.owner;
    c->ha = before.hash, c->hb = after.hash, c->edge = it->s.edge, c->thin = it->s.thin, c->line = it->s.line;
    if (!jumps) {
        assert(f->nsilent < BATCH);
        c->silent = true;
        f->silent[f->nsilent++] = *c;
        return UINT32_MAX;
    }
    return f->nfound++;
}

/* Regions differ at the ends of a bracket, and f does not: an edge that something hides, or a band that is narrower
 * than the bracket, whose two edges it holds. Of solids: in a plane and on a line bounds find bands, and edges that
 * coincide, which rounding parts by some floats, must stay in one bracket to be known as such. */
static bool may_hold_band(const Finder *f, const Item *it, double width, uint32_t lane) {
    if (f->s->dim < 3 || f->coarse || it->s.fine || search_has_depth(f->s) || !(width > 2 * search_least(f, &it->s)))
        return false;
    for (uint32_t c = 0; c < f->s->channels; c++)
        if (!(batch_get(f->b, SLT_OUT_F, c, lane) == batch_get(f->b, SLT_OUT_F, c, lane + 1))) return false;
    return true;
}

/* f and the region at both ends of each final bracket: accepts crossings, and puts back what still differs beside them.
 */
static void verify(Finder *f, Item *items, uint32_t n) {
    Batch *b = f->b;
    found_reserve(f, n);
    double low[FIND], high[FIND];
    for (uint32_t i = 0; i < n; i++) {
        search_bracket(&items[i], &low[i], &high[i]);
        search_put(f, 2 * i, &items[i].s, low[i]);
        search_put(f, 2 * i + 1, &items[i].s, high[i]);
    }
    batch_call(b, SLT_K_SIDES, 2 * n);
    uint32_t slot[FIND];
    for (uint32_t i = 0; i < n; i++) {
        Item *it = &items[i];
        const double lo = low[i], hi = high[i];
        slot[i] = UINT32_MAX;
        Mark before = batch_mark(b, 2 * i), after = batch_mark(b, 2 * i + 1);
        bool window = window_site(f->s, it->event.site),
             jumped = search_differ(before, after, BRACKET_JUMP * it->s.threshold);
        if (jumped && (window || search_has_depth(f->s)) && window_misfits(it, lo, hi) &&
            it->s.halvings < search_most_halvings(f->s))
            window_ask_again(f, &it->s, lo, hi, before, after);
        else if (jumped && !window && may_hold_band(f, it, hi - lo, 2 * i)) {
            Segment band = it->s;
            band.fine = true;
            search_push(f, &band, lo, hi, before, after, SEARCH_ROOT);
        } else if (jumped) slot[i] = accept(f, it, lo, hi, before, after, 2 * i);
        it->s.narrow |=
            search_differ(it->s.ma, before, it->s.threshold) || search_differ(after, it->s.mb, it->s.threshold);
        /* g is 0 at an end of the part, and nothing jumps there: it is flat, and says nothing of where the decision
         * changes. */
        bool flat = !jumped && it->exact && (it->ga == 0 || it->gb == 0);
        SearchState behind = window ? window_next_state(it, it->s.tb - hi, jumped)
                             : flat ? SEARCH_FLAT
                                    : SEARCH_ROOT,
                    front = window ? window_next_state(it, lo - it->s.ta, jumped)
                            : flat ? SEARCH_FLAT
                                   : SEARCH_ROOT;
        double near = window && !jumped && it->s.state == SEARCH_ROOT ? NEAR_PADS * it->pad : 0;
        Part part = {near > 0 ? hi + near : 0, behind, it->s.touches};
        if (jumped) part.touches = (uint8_t)(TOUCH_A | (it->s.touches & TOUCH_B));
        push_part(f, &it->s, hi, it->s.tb, &after, &it->s.mb, part);
        part = (Part){near > 0 ? lo - near : 0, front, part.touches};
        if (jumped) part.touches = (uint8_t)(TOUCH_B | (it->s.touches & TOUCH_A));
        push_part(f, &it->s, it->s.ta, lo, &it->s.ma, &before, part);
    }
    if (!f->s->flat && !search_has_windows(f->s)) flank_settle(f, items, slot, n);
}

/* halve_only: segments are bisected down to the tolerance, and only then asked for their event. */
static uint32_t halve(Finder *f, Item *items, uint32_t n) {
    uint32_t kept = 0;
    for (uint32_t i = 0; i < n; i++)
        if (items[i].s.tb - items[i].s.ta > 1.01 * items[i].tol) f->split[f->nsplit++] = items[i].s;
        else items[kept++] = items[i];
    flush_split(f);
    kept = kept ? ask_events(f, items, kept) : 0;
    f->nsplit = 0; /* those without an event have nothing to snap to */
    window_settle_still(f);
    return kept;
}

/* Segments of a scene with rays wait until there are this many, so that neighbours come into one batch. */
enum { TOGETHER = 16 * FIND };

static void run_stack(Finder *f, bool all) {
    Item *items = f->items;
    if (search_has_windows(f->s)) {
        if (!all && f->n < TOGETHER) return;
        if (f->n > 1) window_order(f);
    }
    while (f->n && !f->failed && (all || f->n >= FIND)) {
        uint32_t n = f->n < FIND ? f->n : FIND;
        for (uint32_t i = 0; i < n; i++) {
            items[i].s = f->stack[f->n - n + i];
            const double least = search_least(f, &items[i].s);
            items[i].tol = tolerance(f, &items[i].s, least);
            items[i].least = f->s->f64 ? search_lesser(items[i].tol, least) : 0;
            items[i].pad = 0;
        }
        f->n -= n;
        if (f->halve_only) {
            n = halve(f, items, n);
        } else {
            n = ask_events(f, items, window_take_halves(f, items, n));
            flush_split(f);
            if (n) search_solve(f, items, n);
        }
        if (n) verify(f, items, n);
    }
}

void finder_run(Finder *f, bool all) {
    do {
        prove_run(f, all);
        run_stack(f, all);
    } while (all && (f->n || f->nalike) && !f->failed);
    if (all && f->nfound) f->full(f->full_user, f->found, f->nfound), f->nfound = 0;
    if (all && f->nsilent) f->silent_full(f->full_user, f->silent, f->nsilent), f->nsilent = 0;
}
