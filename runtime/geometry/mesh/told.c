/* The store that kernels read, and what is told of a piece.
 *
 * A side that lies on an edge's line moves with the edge as far as the edge goes. Where faces are flat or nearly so the
 * next edge lies on the line's extension, and a side of that, cut before the next face came, is the next edge's to
 * move: a side is told in parts, each with the edge that goes there. Which edge that is hangs on edges alone, not on
 * the side, so that cuts between pieces of one face cancel. What no edge continues is a cut of one face: it moves with
 * the edge that it extends. */
#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "saltus/mesh.h"
#include "saltus/query.h"
#include "window.h"

enum { MOST = 1 << 24 }; /* of a row */
#define FLAT 1e-28      /* of a triangle without area the square of the sine between two of its sides */
enum { MOST_EDGE_ON = 32 }; /* faces that are seen edge-on, one before the other */
#define CONTINUES 1e-6 /* of a window's side: an edge whose end is nearer to a line lies on it */

static _Thread_local Store *own;
static _Thread_local uint64_t begun;
static pthread_key_t key;
static pthread_once_t once = PTHREAD_ONCE_INIT;

static void release(void *p) {
    Store *s = p;
    free(s->unit), free(s->list.data), free(s->near.data), free(s->boxes.data), free(s->close.data),
        free(s->found.data), free(s->candidate.data);
    free(s->met.data), free(s->order.data), free(s->most.data), free(s->parts.data), free(s->facet.data);
    free(s->chosen.data), free(s->crossing.data), free(s->piece.data), free(s->live.data), free(s->extents.data),
        free(s->held.all);
    free(s->beam.data), free(s->outline.data), free(s->corner.data), free(s->part.data);
    free(s->answer.data), free(s);
}

static void make_key(void) { (void)pthread_key_create(&key, release); }

bool window_more_room(Store *s, void *row, uint32_t n, uint32_t *room, uint32_t more, size_t size) {
    void *old;
    uint32_t want = *room ? 2 * *room : 64;
    while (want < n + more) want *= 2;
    memcpy(&old, row, sizeof old);
    void *fresh = want <= MOST ? aligned_alloc(64, (want * size + 63) / 64 * 64) : NULL;
    if (!fresh) return s->lost = true, false;
    if (*room) memcpy(fresh, old, (n < *room ? n : *room) * size);
    free(old);
    memcpy(row, &fresh, sizeof fresh);
    *room = want;
    return true;
}

/* Room for a piece and its sides. */
static bool room_for_piece(Store *s) {
    return window_room(s, &s->unit, s->n + 1, &s->room, 1 + SLT_PIECE_MAX_SIDES, sizeof *s->unit);
}

static void count_units(Store *s, uint32_t n) {
    s->n = n;
    const uint32_t last = n - 1;
    memcpy(&s->unit[0], &last, sizeof last);
}

static void empty(Store *s) {
    if (!s->n && !room_for_piece(s)) return;
    memset(&s->unit[1], 0, sizeof *s->unit);
    s->beam.n = s->outline.n = s->corner.n = s->part.n = s->answer.n = 0;
    count_units(s, 1);
}

void told_end(Store *s) { count_units(s, s->n); }

Store *told_store(void) {
    if (own) return own;
    pthread_once(&once, make_key);
    own = calloc(1, sizeof *own);
    if (!own) return NULL;
    (void)pthread_setspecific(key, own);
    empty(own);
    return own;
}

/* Outlines stay of the pieces that do. */
static void outlines_begin(Store *s) {
    while (s->outline.n && s->outline.data[s->outline.n - 1].unit >= s->n) {
        const OutlineRow *last = &s->outline.data[--s->outline.n];
        s->corner.n = last->corner, s->part.n = last->part, s->beam.n = last->beam + 1;
    }
    s->answer.n = 0;
}

void pieces_begin(void) {
    begun++;
    if (own && own->held.on && own->n) {
        count_units(own, held_begin(&own->held, own->n));
        outlines_begin(own);
    } else if (own) {
        empty(own);
    }
}

Held *pieces_held(void) { return own && own->held.on ? &own->held : NULL; }

void pieces_hold(bool on) {
    Store *s = told_store();
    if (!s) return;
    begun++;
    held_set(&s->held, on);
    empty(s);
}

uint64_t pieces_begun(void) { return begun; }

const void *pieces_told(void) {
    static const Unit nothing[2];
    return own && own->n ? own->unit + 1 : nothing + 1;
}

/* ---- units */

static unsigned char *place(const Search *s, uint32_t unit, uint32_t which) {
    const size_t size = s->f64 ? sizeof(double) : sizeof(float);
    return (unsigned char *)(s->store->unit + 1) + ((size_t)unit * SLT_TOLD + which) * size;
}

static void put(const Search *s, uint32_t unit, uint32_t which, double v) {
    const float narrow = (float)v;
    if (s->f64) memcpy(place(s, unit, which), &v, sizeof v);
    else memcpy(place(s, unit, which), &narrow, sizeof narrow);
}

static void put_int(const Search *s, uint32_t unit, uint32_t which, int32_t v) {
    memcpy(place(s, unit, which), &v, sizeof v);
}

typedef double Two __attribute__((vector_size(16)));
typedef float TwoNarrow __attribute__((vector_size(8)));
static inline void put_narrow(unsigned char *to, Two v) {
    const TwoNarrow narrow = __builtin_convertvector(v, TwoNarrow);
    memcpy(to, &narrow, sizeof narrow);
}

/* A side, whose numbers are those from SLT_SIDE_WEIGHT on, weight and ends. */
static inline __attribute__((always_inline)) void put_side(const Search *s, uint32_t unit, int32_t a, int32_t b,
                                                           double weight, double s0, double t0, double s1, double t1) {
    const Search as = {.store = s->store, .f64 = s->f64};
    unsigned char *to = place(&as, unit, 0);
    if (s->f64) {
        const double at[] = {weight, s0, t0, s1, t1};
        put_int(&as, unit, SLT_SIDE_A, a), put_int(&as, unit, SLT_SIDE_B, b);
        memcpy(to + SLT_SIDE_WEIGHT * sizeof(double), at, sizeof at);
        return;
    }
    const Two x = {weight, s0}, y = {t0, s1}, z = {t1, 0};
    const int32_t edge[2] = {a, b};
    memcpy(to, edge, sizeof edge);
    put_narrow(to + 2 * sizeof(float), x), put_narrow(to + 4 * sizeof(float), y);
    put_narrow(to + 6 * sizeof(float), z);
}
_Static_assert(SLT_SIDE_WEIGHT == 2 && SLT_SIDE_T1 == 6 && SLT_TOLD == 8, "the last number of a side is free");

uint32_t pieces_tell(bool f64, const double number[SLT_TOLD], uint32_t whole) {
    Store *store = told_store();
    if (!store || !store->n || !window_room(store, &store->unit, store->n + 1, &store->room, 1, sizeof *store->unit))
        return 0;
    const Search s = {.store = store, .f64 = f64};
    const uint32_t unit = store->n;
    for (uint32_t k = 0; k < SLT_TOLD; k++)
        if (k < whole) put_int(&s, unit, k, (int32_t)number[k]);
        else put(&s, unit, k, number[k]);
    count_units(store, unit + 1);
    return unit;
}

static inline __attribute__((always_inline)) void put_piece(const Search *s, uint32_t unit, double area, double at_s,
                                                            double at_t, int32_t triangle, uint32_t sides) {
    const Search as = {.store = s->store, .f64 = s->f64};
    unsigned char *to = place(&as, unit, 0);
    if (s->f64) {
        const double at[] = {area, at_s, at_t};
        memcpy(to, at, sizeof at);
        put_int(&as, unit, SLT_PIECE_NEXT, 0);
        put_int(&as, unit, SLT_PIECE_TRIANGLE, triangle), put_int(&as, unit, SLT_PIECE_SIDES, (int32_t)sides);
        return;
    }
    const Two x = {area, at_s}, y = {at_t, 0};
    const int32_t numbers[2] = {triangle, (int32_t)sides};
    put_narrow(to, x), put_narrow(to + 2 * sizeof(float), y);
    memcpy(to + 4 * sizeof(float), numbers, sizeof numbers);
}
_Static_assert(SLT_PIECE_T == 2 && SLT_PIECE_NEXT == 3 && SLT_PIECE_SIDES == 5, "no next one is a float, 0");

static uint32_t tell(Search *s, int32_t triangle, double area, double at_s, double at_t, uint32_t sides) {
    const uint32_t unit = s->store->n;
    put_piece(s, unit, area, at_s, at_t, triangle, sides);
    if (s->first) put_int(s, s->last, SLT_PIECE_NEXT, (int32_t)unit);
    else s->first = unit;
    s->last = unit;
    s->store->n = unit + 1 + sides;
    return unit;
}

/* ---- outlines */

/* Parts from `part` on are those of its sides. */
static __attribute__((noinline)) void outline_add(Search *s, uint32_t unit, int32_t triangle, const Polygon *p,
                                                  uint32_t part) {
    Store *store = s->store;
    OutlineRow row = {.unit = unit,
                      .beam = store->beam.n - 1,
                      .corner = store->corner.n,
                      .ncorners = p->n,
                      .part = part,
                      .nparts = store->part.n - part,
                      .triangle = triangle};
    for (uint32_t k = 0; k < p->n; k++)
        if (!PUSH(store, store->corner, ((OutlinePlace){p->s[k], p->t[k]}))) return;
    if (store->beam.n) (void)PUSH(store, store->outline, row);
}

bool outline_find(uint32_t unit, Outline *out) {
    if (!own) return false;
    uint32_t low = 0, high = own->outline.n;
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (own->outline.data[middle].unit < unit) low = middle + 1;
        else high = middle;
    }
    if (low == own->outline.n || own->outline.data[low].unit != unit) return false;
    const OutlineRow *row = &own->outline.data[low];
    *out = (Outline){.beam = own->beam.data + row->beam,
                     .corner = own->corner.data + row->corner,
                     .part = row->nparts ? own->part.data + row->part : NULL,
                     .ncorners = row->ncorners,
                     .nparts = row->nparts,
                     .triangle = row->triangle,
                     .row = low};
    return true;
}

bool outline_recall(const Outline *o, const double light[3], int32_t *unit) {
    const OutlineRow *row = &own->outline.data[o->row];
    for (uint32_t i = row->begun == begun ? row->answer : 0; i; i = own->answer.data[i - 1].before) {
        const OutlineAnswer *a = &own->answer.data[i - 1];
        if (memcmp(a->light, light, sizeof a->light)) continue;
        *unit = a->unit;
        return true;
    }
    return false;
}

void outline_remember(const Outline *o, const double light[3], int32_t unit) {
    OutlineRow *row = &own->outline.data[o->row];
    OutlineAnswer a = {.unit = unit, .before = row->begun == begun ? row->answer : 0};
    memcpy(a.light, light, sizeof a.light);
    if (PUSH(own, own->answer, a)) row->answer = own->answer.n, row->begun = begun;
}

void told_whole(Search *s, int32_t triangle) {
    static const Polygon window = {.n = 4, .s = {0, 1, 1, 0}, .t = {0, 0, 1, 1}};
    if (!room_for_piece(s->store)) return;
    const uint32_t unit = tell(s, triangle, 1, 0.5, 0.5, 0);
    if (s->scene->outlined) outline_add(s, unit, triangle, &window, s->store->part.n);
}

/* ---- one sheet */

/* Sides that are not there are written as well, and over by what comes next: which are is hard to predict. */
static void tell_part(Search *s, const Candidate *c) {
    const Parts *p = &s->store->parts.data[c->part / 8];
    const uint32_t i = c->part % 8;
    uint32_t sides = 0;
    if (!room_for_piece(s->store)) return;
    if (s->scene->adjacency) {
        const int32_t *corner = s->store->near.data[c->near].corner;
        for (uint32_t k = 0; k < 3; k++) {
            const uint32_t next = k < 2 ? k + 1 : 0, from = c->turned ? next : k, to = c->turned ? k : next;
            put_side(s, s->store->n + 1 + sides, corner[from], corner[to], p->weight[k][i], p->end[k][0][i],
                     p->end[k][1][i], p->end[k][2][i], p->end[k][3][i]);
            sides += p->there[k] >> i & 1;
        }
    }
    tell(s, c->triangle, p->area[i], p->centre[0][i], p->centre[1][i], sides);
}

bool told_sheet(Search *s, const Candidate *c, uint32_t n, double others) {
    const Store *store = s->store;
    double area = 0, least = HUGE_VAL;
    uint64_t open = 0; /* 0: each part of an edge has its other side */
    uint32_t count = 0;
    if (store->lost) return false; /* some have not been measured */
    for (; count < n && !(area >= 1 - COVERED); count++) {
        const Parts *p = &store->parts.data[c[count].part / 8];
        const uint32_t bit = c[count].part % 8;
        const uint64_t *edge = store->near.data[c[count].near].edge;
        if (!(p->good >> bit & 1)) return false;
        /* All of them are turned alike, so edges need not be. */
        for (uint32_t k = 0; k < 3; k++) open += edge[k] & -(uint64_t)(p->there[k] >> bit & 1);
        area += p->area[bit];
        if (c[count].least < least) least = c[count].least;
    }
    if (!(fabs(area - 1) <= COVERED) || open || others > least || (count < n && c[count].most > least)) return false;
    for (uint32_t i = 0; i < count; i++) tell_part(s, &c[i]);
    return true;
}

/* ---- sides */

/* A side of a piece, counter-clockwise. */
typedef struct Side {
    double at[2][2]; /* its ends */
    double d[2][3];  /* their directions */
    double g[3];     /* of its line */
    double length;
    uint32_t unit, count; /* of the piece's sides: the first, how many */
    uint32_t corner;      /* where it begins */
} Side;

/* Kept for outlines. */
static __attribute__((noinline)) void outline_part(Search *s, const Side *side, int32_t a, int32_t b, bool outside,
                                                   double from, double to) {
    const double ds = side->at[1][0] - side->at[0][0], dt = side->at[1][1] - side->at[0][1];
    const OutlinePart part = {.from = {side->at[0][0] + from * ds, side->at[0][1] + from * dt},
                              .to = {side->at[0][0] + to * ds, side->at[0][1] + to * dt},
                              .a = a,
                              .b = b,
                              .side = side->corner,
                              .outside = outside};
    (void)PUSH(s->store, s->store->part, part);
}

/* The part from `from` to `to` of the way between the ends, on a line g = 0 with g > 0 on the left. */
static void tell_side(Search *s, Side *side, int32_t a, int32_t b, const double g[3], double from, double to) {
    if (!(from < to)) return;
    const uint32_t unit = side->unit + side->count++;
    if (side->count > SLT_PIECE_MAX_SIDES) return; /* told in two */
    const double slope = sqrt(g[0] * g[0] + g[1] * g[1]), ds = side->at[1][0] - side->at[0][0],
                 dt = side->at[1][1] - side->at[0][1];
    const double weight = slope > 0 ? (to - from) * side->length / slope : 0;
    const double at[] = {side->at[0][0] + from * ds, side->at[0][1] + from * dt, side->at[0][0] + to * ds,
                         side->at[0][1] + to * dt};
    put_side(s, unit, a, b, g[1] * ds - g[0] * dt < 0 ? -weight : weight, at[0], at[1], at[2], at[3]);
    if (s->scene->outlined) outline_part(s, side, a, b, g[1] * ds - g[0] * dt < 0, from, to);
}

/* Of the plane of two directions, which may be long beside what parts them. */
static void across_both(const double p[3], const double q[3], double out[3]) {
    double apart[3];
    for (int a = 0; a < 3; a++) apart[a] = q[a] - p[a];
    window_cross(p, apart, out);
}

/* Narrows from and to to where the directions of the side are on q's side of p, in the plane of both. */
static void on_side_of(const Side *side, const double p[3], const double q[3], double *from, double *to) {
    double across[3], f[2];
    across_both(p, q, across);
    for (int k = 0; k < 2; k++) { /* d . ((p x q) x p) */
        double of_d[3];
        window_cross(p, side->d[k], of_d);
        f[k] = window_dot(across, of_d);
    }
    if (f[0] >= 0 && f[1] >= 0) return;
    if (f[0] < 0 && f[1] < 0) {
        *from = 1, *to = 0;
        return;
    }
    const double at = f[0] / (f[0] - f[1]);
    if (f[0] < 0) *from = at > *from ? at : *from;
    else *to = at < *to ? at : *to;
}

static void line_of(const Search *s, const double normal[3], double g[3]) {
    g[0] = window_dot(s->window.u, normal), g[1] = window_dot(s->window.v, normal);
    g[2] = window_dot(s->window.c, normal);
}

/* The edge at vertex v that goes on where a line comes from `before`, seen: its other end lies on the line. -1: none.
 */
static int32_t next_end(const Search *s, const double g[3], int32_t v, const double before[3], const double here[3]) {
    const Adjacency *adjacency = s->scene->adjacency;
    const double whole = fabs(window_dot(s->window.u, s->window.plane[0])), slope = sqrt(g[0] * g[0] + g[1] * g[1]);
    double n[3], least = CONTINUES;
    int32_t best = -1;
    across_both(before, here, n);
    for (uint32_t i = adjacency->first[v]; i < adjacency->first[v + 1]; i++) {
        double p[3], at[3], ahead[3];
        window_vertex(s, adjacency->end[i], p);
        across_both(here, p, ahead);
        if (!(window_dot(n, ahead) > 0)) continue;
        for (int k = 0; k < 3; k++) at[k] = window_dot(p, s->window.plane[k]) / whole;
        const double apart = fabs(g[0] * at[0] + g[1] * at[1] + g[2] * at[2]) / (fabs(at[2]) * slope);
        if (apart < least) least = apart, best = adjacency->end[i];
    }
    return best;
}

/* What of the side lies beyond the end `v` of the edge that its line is of. */
static void tell_beyond(Search *s, Side *side, const int32_t edge[2], int32_t v, const double other[3], double from,
                        double to) {
    double before[3], here[3];
    memcpy(before, other, sizeof before);
    window_vertex(s, v, here);
    for (uint32_t step = 0; from < to && step < s->scene->adjacency->nvertices; step++) {
        const int32_t end = next_end(s, side->g, v, before, here);
        if (end < 0) break;
        double there[3], normal[3], g[3], mine[2] = {from, to}, rest[2] = {from, to};
        window_vertex(s, end, there);
        on_side_of(side, there, here, &mine[0], &mine[1]);
        across_both(here, there, normal);
        line_of(s, normal, g);
        tell_side(s, side, v, end, g, mine[0], mine[1]);
        /* Beyond `there`: what is left at the end that `mine` does not reach. */
        if (mine[0] < mine[1]) rest[0] = mine[0] > from ? from : mine[1], rest[1] = mine[0] > from ? mine[0] : to;
        memcpy(before, here, sizeof before), memcpy(here, there, sizeof here);
        v = end, from = rest[0], to = rest[1];
        if (side->count > SLT_PIECE_MAX_SIDES) return;
    }
    tell_side(s, side, edge[0], edge[1], side->g, from, to);
}

/* Of a face beyond the edge from a to b, seen from the eye: its other corner. */
typedef struct Beyond {
    double at[2][3], w[3]; /* a, b and the corner */
    int32_t corner;
    int place; /* of the corner along the edge's line: -1 not before the edge's end a, 1 not before b, 0 between */
    enum { IS_SEEN, IS_BEFORE, IS_BEHIND, HAS_NO_AREA } how; /* of what is seen as a line: where, from the eye */
} Beyond;

static void look_beyond(const Search *s, int32_t half, int32_t a, int32_t b, const double g[3], Beyond *out) {
    double n[3], along[3], to[3], at[3], inward[3], across[3];
    out->corner = s->scene->tree.bvh->face[3 * (size_t)(half / 3) + (size_t)((half + 2) % 3)], out->how = IS_SEEN;
    const double whole = fabs(window_dot(s->window.u, s->window.plane[0]));
    window_vertex(s, out->corner, out->w);
    for (int k = 0; k < 3; k++) at[k] = window_dot(out->w, s->window.plane[k]) / whole;
    const double apart = fabs(g[0] * at[0] + g[1] * at[1] + g[2] * at[2]);
    if (!(apart <= ON_LINE * fabs(at[2]) * (fabs(g[0]) + fabs(g[1])))) return; /* it may be a piece */
    window_vertex(s, a, out->at[0]), window_vertex(s, b, out->at[1]);
    across_both(out->at[0], out->at[1], n);
    for (int i = 0; i < 3; i++) along[i] = out->at[1][i] - out->at[0][i], to[i] = out->w[i] - out->at[0][i];
    window_cross(along, n, inward);
    const double high = window_dot(inward, to), size = window_dot(inward, inward) * window_dot(to, to);
    out->how = high * high <= FLAT * size                  ? HAS_NO_AREA
               : high * window_dot(inward, out->at[0]) < 0 ? IS_BEFORE
                                                           : IS_BEHIND;
    across_both(out->at[0], out->w, across);
    out->place = window_dot(n, across) > 0 ? 0 : -1;
    across_both(out->w, out->at[1], across);
    if (!out->place && !(window_dot(n, across) > 0)) out->place = 1;
}

/* Does the line belong to the face's other edges? Of a triangle without area that is so of its longest edge, or, where
 * two corners are at one place, of the edge whose corner there has the higher number: of either of its sides the same.
 */
static bool gives_way(const Beyond *f, int32_t a, int32_t b) {
    if (f->how != HAS_NO_AREA) return f->how == IS_BEFORE;
    if (!memcmp(f->w, f->at[0], sizeof f->w)) return f->corner < a;
    if (!memcmp(f->w, f->at[1], sizeof f->w)) return f->corner < b;
    return !f->place;
}

/* A part of a side on the edge from a to b, beyond which `half` lies. Where that is a face that is seen edge-on, in
 * front of the edge, the edge is hidden or about to be, with all that goes on behind it: the line is that of the edge
 * at which such faces begin. So a step of stairs that is seen at its height neither opens a gap nor hides anything. */
static void tell_own(Search *s, Side *side, int32_t half, int32_t a, int32_t b, const double g[3], double from,
                     double to, int steps) {
    double across[3], line[3], part[2][2] = {{from, to}, {from, to}};
    Beyond f = {.how = IS_SEEN};
    if (!(from < to)) return;
    if (half >= 0 && steps < MOST_EDGE_ON) look_beyond(s, half, a, b, g, &f);
    if (f.how == IS_SEEN || !gives_way(&f, a, b)) {
        tell_side(s, side, a, b, g, from, to);
        return;
    }
    if (f.place) {
        const int none = f.place < 0 ? 0 : 1;
        part[none][1] = part[none][0];
    } else {
        on_side_of(side, f.w, f.at[0], &part[0][0], &part[0][1]);
        on_side_of(side, f.w, f.at[1], &part[1][0], &part[1][1]);
    }
    for (int i = 0; i < 2; i++) {
        const int32_t face = half / 3, *corner = s->scene->tree.bvh->face + 3 * (size_t)face;
        const int32_t end[2] = {i ? f.corner : a, i ? b : f.corner};
        int32_t next = ADJACENCY_BORDER;
        for (int32_t k = 0; k < 3; k++) {
            const int32_t p = corner[k], q = corner[(k + 1) % 3];
            if ((p == end[0] && q == end[1]) || (p == end[1] && q == end[0]))
                next = s->scene->adjacency->across[3 * (size_t)face + (size_t)k];
        }
        across_both(i ? f.w : f.at[0], i ? f.at[1] : f.w, across);
        line_of(s, across, line);
        tell_own(s, side, next, end[0], end[1], line, part[i][0], part[i][1], steps + 1);
    }
}

static void tell_edge(Search *s, Side *side, uint32_t number, uint32_t k, int32_t own) {
    const Facet *f = &s->store->facet.data[number];
    const int32_t *corner = s->scene->tree.bvh->face + 3 * (size_t)f->triangle;
    int32_t edge[2] = {corner[k], corner[(k + 1) % 3]};
    const int32_t half =
        s->store->edge_on ? s->scene->adjacency->across[3 * (size_t)f->triangle + k] : ADJACENCY_BORDER;
    if (f->turned) edge[0] = edge[1], edge[1] = corner[k];
    memcpy(side->g, f->g[k], sizeof side->g);
    if ((int32_t)number == own) { /* it ends where its triangle does */
        tell_own(s, side, half, edge[0], edge[1], side->g, 0, 1, 0);
        return;
    }
    /* In the plane of both ends directions lie around a circle: of those that are beyond either end, as where an end
     * behind the eye is seen from the back, the first end has them, whatever else the side reaches. */
    double p[2][3], own_part[2] = {0, 1}, beyond[2][2];
    for (int i = 0; i < 2; i++) window_vertex(s, edge[i], p[i]);
    for (int i = 0; i < 2; i++) {
        const double from = own_part[0], to = own_part[1];
        beyond[i][0] = from, beyond[i][1] = to;
        if (!(from < to)) continue;
        on_side_of(side, p[i], p[!i], &own_part[0], &own_part[1]);
        if (!(own_part[0] < own_part[1])) continue;
        if (own_part[0] > from) beyond[i][1] = own_part[0];
        else beyond[i][0] = own_part[1];
    }
    tell_own(s, side, half, edge[0], edge[1], side->g, own_part[0], own_part[1], 0);
    for (int i = 0; i < 2; i++)
        if (beyond[i][0] < beyond[i][1]) tell_beyond(s, side, edge, edge[i], p[!i], beyond[i][0], beyond[i][1]);
}

/* How many there are; more than SLT_PIECE_MAX_SIDES were not told. */
static uint32_t tell_sides(Search *s, const Polygon *p) {
    Side side = {.unit = s->store->n + 1};
    for (uint32_t k = 0; k < p->n && s->scene->adjacency; k++) {
        const uint32_t next = k + 1 < p->n ? k + 1 : 0;
        const Window *w = &s->window;
        if (p->side[k] == SIDE_FIXED) continue;
        side.corner = k;
        side.at[0][0] = p->s[k], side.at[0][1] = p->t[k], side.at[1][0] = p->s[next], side.at[1][1] = p->t[next];
        const double ds = side.at[1][0] - side.at[0][0], dt = side.at[1][1] - side.at[0][1];
        side.length = sqrt(ds * ds + dt * dt);
        for (int i = 0; i < 2; i++)
            for (int a = 0; a < 3; a++) side.d[i][a] = w->c[a] + side.at[i][0] * w->u[a] + side.at[i][1] * w->v[a];
        if (p->side[k] & SIDE_CROSSING) {
            const Crossing *c = &s->store->crossing.data[p->side[k] & ~SIDE_CROSSING];
            tell_side(s, &side, c->a, ~c->b, c->g, 0, 1);
        } else {
            tell_edge(s, &side, (p->side[k] - 1) / 3, (p->side[k] - 1) % 3, p->facet);
        }
        if (side.count > SLT_PIECE_MAX_SIDES) break;
    }
    return side.count;
}

/* Across its longest side, in the middle. */
static void tell_in_two(Search *s, const Polygon *p) {
    double longest = 0, g[3] = {0};
    for (uint32_t k = 0; k < p->n; k++) {
        const uint32_t next = k + 1 < p->n ? k + 1 : 0;
        const double ds = p->s[next] - p->s[k], dt = p->t[next] - p->t[k];
        if (!(ds * ds + dt * dt > longest)) continue;
        longest = ds * ds + dt * dt;
        g[0] = ds, g[1] = dt, g[2] = -0.5 * (ds * (p->s[next] + p->s[k]) + dt * (p->t[next] + p->t[k]));
    }
    Polygon half[2];
    s->scene->facets->split(p, g, SIDE_FIXED, &half[0], &half[1]);
    for (int i = 0; i < 2; i++)
        if (half[i].n < p->n + 2) told_piece(s, &half[i]);
}

void told_piece(Search *s, const Polygon *p) {
    double area = 0, centre[2] = {0, 0};
    for (uint32_t k = 1; k + 1 < p->n; k++) {
        const double as = p->s[k] - p->s[0], at = p->t[k] - p->t[0], bs = p->s[k + 1] - p->s[0],
                     bt = p->t[k + 1] - p->t[0], part = 0.5 * (as * bt - at * bs);
        area += part, centre[0] += part * (as + bs), centre[1] += part * (at + bt);
    }
    if (!(area > 0) || !room_for_piece(s->store)) return;
    const uint32_t part = s->store->part.n, sides = tell_sides(s, p);
    if (sides > SLT_PIECE_MAX_SIDES) {
        s->store->part.n = part;
        tell_in_two(s, p);
        return;
    }
    const int32_t triangle = s->store->facet.data[p->facet].triangle;
    const uint32_t unit =
        tell(s, triangle, area, p->s[0] + centre[0] / (3 * area), p->t[0] + centre[1] / (3 * area), sides);
    if (s->scene->outlined) outline_add(s, unit, triangle, p, part);
}
