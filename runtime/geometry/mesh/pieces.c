/* Windows: which are near each other, what is in them, which parts of them are looked at. */
#include "pieces.h"

#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "saltus/mesh.h"
#include "saltus/query.h"
#include "window.h"

enum {
    HALVINGS = 40,  /* at most */
    FEW_NEAR = 160, /* triangles listed for windows: for more windows then */
    MANY_NEAR = 400,
    MOST_REACH = 15 /* times as many windows */
};
#define BESIDE 1e-9 /* by which what lies where is widened, at least */
#define UNLIKELY 1.37 /* distances are powers of two, but not times this */
#define UNSTEADY 0.05 /* of several: rows of pixels in single precision are not quite straight */
#define SPARSE 4.0 /* times the area of windows is what is looked through for them together, at most */

/* ---- windows */

void window_planes(Window *w) {
    window_cross(w->v, w->c, w->plane[0]);
    window_cross(w->c, w->u, w->plane[1]);
    window_cross(w->u, w->v, w->plane[2]);
    const bool mirrored = window_dot(w->u, w->plane[0]) < 0;
    for (int k = 0; k < 3 && mirrored; k++)
        for (int a = 0; a < 3; a++) w->plane[k][a] = -w->plane[k][a];
    /* Where the eye is far rounding is more. */
    const double away = 0x1p-47 * window_dot(w->c, w->c) / fabs(window_dot(w->u, w->plane[0]));
    w->beside[0] = BESIDE + away * sqrt(window_dot(w->v, w->v));
    w->beside[1] = BESIDE + away * sqrt(window_dot(w->u, w->u));
}

static void window_set(Window *w, const Beams *b, uint32_t lane) {
    const uint32_t at = beam_lane(b, lane);
    for (int a = 0; a < 3; a++) {
        w->eye[a] = b->row[SLT_BEAM_EYE + a][at], w->c[a] = b->row[SLT_BEAM_CORNER + a][lane];
        w->u[a] = b->row[SLT_BEAM_U + a][at], w->v[a] = b->row[SLT_BEAM_V + a][at];
        w->q[a] = b->row[BEAM_Q + a][lane];
    }
    w->far = b->far >> lane & 1, w->own = b->row[BEAM_OWN][lane];
}

/* Windows of one eye with the same sides have one frame, in which it is told where they and triangles lie: a window
 * across from the eye, about as far as they are, by a power of two. So what a window may see hangs on itself alone,
 * not on those that are looked through with it. */
static void window_frame(Window *w, const Beams *b, uint32_t lane) {
    double n[3];
    window_set(w, b, lane);
    window_cross(w->u, w->v, n);
    const double along = window_dot(w->c, n), per_power = UNLIKELY / window_dot(n, n), at = fabs(along) * per_power;
    double far;
    w->per_power = 0, w->power = 0;
    if (!(at >= 1e-200 && at <= 1e200 && window_dot(w->c, w->c) <= GRAZING * per_power * along * along)) return;
    memcpy(&w->power, &at, sizeof at);
    w->power &= POWER_OF_TWO, w->per_power = per_power;
    memcpy(&far, &w->power, sizeof far);
    for (int a = 0; a < 3; a++) w->c[a] = (along < 0 ? -far : far) * n[a];
}

/* Parts of windows are no halves, as windows are put aside (beams.inc.h). */
#define PART 0.48171 /* of a window, in its first part */

static double area_of(const Rectangle *r) { return (r->hi[0] - r->lo[0]) * (r->hi[1] - r->lo[1]); }

/* ---- parts of a window, depth first */

static int nearest_first(const void *x, const void *y) {
    const Candidate *a = x, *b = y;
    if (a->most != b->most) return a->most < b->most ? 1 : -1;
    return (a->triangle > b->triangle) - (a->triangle < b->triangle);
}

/* Where each facet lies, before a window is halved. */
static void locate(Search *s) {
    for (uint32_t i = 0; i < s->store->facet.n; i++) {
        Facet *f = &s->store->facet.data[i];
        const int32_t *corner = s->scene->tree.bvh->face + 3 * (size_t)f->triangle;
        bool ahead = true;
        for (int a = 0; a < 2; a++) f->lo[a] = HUGE_VAL, f->hi[a] = -HUGE_VAL;
        for (int k = 0; k < 3; k++) {
            double p[3];
            window_vertex(s, corner[k], p);
            const double along = window_dot(p, s->window.plane[2]);
            ahead &= along > 0;
            for (int a = 0; a < 2; a++) {
                const double at = window_dot(p, s->window.plane[a]) / along;
                f->lo[a] = fmin(f->lo[a], at - s->window.beside[a] * (1 + fabs(at))),
                f->hi[a] = fmax(f->hi[a], at + s->window.beside[a] * (1 + fabs(at)));
            }
        }
        for (int a = 0; a < 2 && !ahead; a++) f->lo[a] = -HUGE_VAL, f->hi[a] = HUGE_VAL;
    }
}

/* May it be seen in the rectangle? most: of its 1 / t there; *least: the same, if it fills the rectangle. */
static bool meets(const Facet *f, const Rectangle *r, double *most, double *least) {
    bool fills = true;
    if (f->lo[0] > r->hi[0] || f->hi[0] < r->lo[0] || f->lo[1] > r->hi[1] || f->hi[1] < r->lo[1]) return false;
    for (int e = 0; e < 3; e++) {
        bool any = false;
        for (int k = 0; k < 4; k++) {
            const double d = window_at(f->g[e], k & 1 ? r->hi[0] : r->lo[0], k & 2 ? r->hi[1] : r->lo[1]);
            any |= d > 0, fills &= d > 0;
        }
        if (!any) return false;
    }
    *most = -HUGE_VAL, *least = HUGE_VAL;
    for (int k = 0; k < 4; k++) {
        const double d = window_at(f->depth, k & 1 ? r->hi[0] : r->lo[0], k & 2 ? r->hi[1] : r->lo[1]);
        *most = fmax(*most, d), *least = fmin(*least, d);
    }
    if (!fills) *least = -HUGE_VAL;
    return true;
}

/* Facets chosen[from], ..., in order, may be seen in the rectangle. */
static void look(Search *s, uint32_t from, uint32_t n, const Rectangle *r, int halvings) {
    Store *store = s->store;
    if (n <= FEW_FACETS || halvings == HALVINGS) {
        s->scene->facets->cover(s, r, from, n);
        for (uint32_t i = 0; i < store->live.n; i++) {
            const Polygon *p = &store->piece.data[store->live.data[i]];
            if (p->n && p->facet >= 0) told_piece(s, p);
        }
        return;
    }
    const int axis = r->hi[0] - r->lo[0] >= r->hi[1] - r->lo[1] ? 0 : 1;
    const double middle = r->lo[axis] + PART * (r->hi[axis] - r->lo[axis]);
    for (int half = 0; half < 2; half++) {
        const uint32_t start = store->chosen.n;
        double hidden = -HUGE_VAL, most, least;
        Rectangle part = *r;
        if (half) part.lo[axis] = middle;
        else part.hi[axis] = middle;
        if (!window_room(store, &store->chosen.data, start, &store->chosen.room, n, sizeof *store->chosen.data)) return;
        for (uint32_t k = from; k < from + n; k++) {
            const uint32_t i = store->chosen.data[k];
            if (!meets(&store->facet.data[i], &part, &most, &least) || most < hidden) continue;
            hidden = fmax(hidden, least);
            store->chosen.data[store->chosen.n++] = i;
        }
        uint32_t kept = start;
        for (uint32_t k = start; k < store->chosen.n; k++) {
            const uint32_t i = store->chosen.data[k];
            (void)meets(&store->facet.data[i], &part, &most, &least);
            if (!(most < hidden)) store->chosen.data[kept++] = i;
        }
        store->chosen.n = kept;
        look(s, start, kept - start, &part, halvings + 1);
        store->chosen.n = start;
    }
}

/* Pieces that are outlined are so in the last beam of the row. */
static __attribute__((noinline)) void keep_beam(Search *s) {
    OutlineBeam b;
    memcpy(b.eye, s->window.eye, sizeof b.eye), memcpy(b.c, s->window.c, sizeof b.c);
    memcpy(b.u, s->window.u, sizeof b.u), memcpy(b.v, s->window.v, sizeof b.v);
    (void)PUSH(s->store, s->store->beam, b);
}

static void look_through(Search *s, const Beams *b, uint32_t lane, Candidate *c, uint32_t n) {
    Store *store = s->store;
    if (n > FEW_FACETS) qsort(c, n, sizeof *c, nearest_first);
    store->facet.n = store->chosen.n = 0;
    if (!window_room(store, &store->facet.data, 0, &store->facet.room, n, sizeof *store->facet.data) ||
        !window_room(store, &store->chosen.data, 0, &store->chosen.room, n, sizeof *store->chosen.data))
        return;
    s->candidate = c;
    for (uint32_t i = 0; i < n; i++) store->chosen.data[store->chosen.n++] = i;
    window_set(&s->window, b, lane);
    if (n > FEW_FACETS || s->scene->adjacency) window_planes(&s->window);
    if (n > FEW_FACETS) {
        window_facets(s, n);
        locate(s);
    }
    look(s, 0, n, &(Rectangle){{0, 0}, {1, 1}}, 0);
}

/* Lanes from `base` on that look from one eye through windows side by side, which are listed for together. */
static void neighbours(const Beams *b, uint32_t base, uint32_t width, const Places *lie, Neighbours *n) {
    n->base = n->last = base;
    const uint64_t later = b->mask & ~1ull << base;
    if (!(later & ~lie->ahead) && area_of(&lie->all) <= SPARSE * lie->area) {
        n->all = lie->all;
        if (later) n->last = 63 - (uint32_t)__builtin_clzll(later);
        n->alike = !(later & ~lie->alike);
        return;
    }
    n->all = (Rectangle){{lie->lo[0][base], lie->lo[1][base]}, {lie->hi[0][base], lie->hi[1][base]}}, n->alike = true;
    double area = area_of(&n->all);
    for (uint32_t k = base + 1; k < width; k++) {
        if (!(b->mask >> k & 1)) continue;
        if (!(lie->ahead >> k & 1)) break;
        Rectangle wider = n->all, own = {{lie->lo[0][k], lie->lo[1][k]}, {lie->hi[0][k], lie->hi[1][k]}};
        for (int i = 0; i < 2; i++) {
            if (own.lo[i] < wider.lo[i]) wider.lo[i] = own.lo[i];
            if (own.hi[i] > wider.hi[i]) wider.hi[i] = own.hi[i];
        }
        if (!(area_of(&wider) <= SPARSE * (area + area_of(&own)))) break;
        area += area_of(&own);
        n->all = wider, n->last = k, n->alike &= lie->alike >> k & 1;
    }
}

/* ---- what is listed */

static bool same_frame(const Window *a, const Window *b) {
    return a->far == b->far && !memcmp(a, b, offsetof(Window, far)); /* eye, u, v, c */
}

/* Has the one lane after the other that windows share the eye and the sides of a frame? The frame is theirs then, where
 * `place` says that they lie ahead in it. */
static bool in_frame(const Beams *b, const Window *frame) {
    if (!b->shared || frame->far != (b->far & 1) || !(frame->per_power > 0)) return false;
    bool alike = true;
    for (int a = 0; a < 3; a++)
        alike &= !memcmp(&b->row[SLT_BEAM_EYE + a][0], &frame->eye[a], sizeof frame->eye[a]) &
                 !memcmp(&b->row[SLT_BEAM_U + a][0], &frame->u[a], sizeof frame->u[a]) &
                 !memcmp(&b->row[SLT_BEAM_V + a][0], &frame->v[a], sizeof frame->v[a]);
    return alike;
}

/* Where windows follow each other, as those of the pixels of an image do, triangles are listed for some of them ahead,
 * for more if they are few. How far changes no answer. */
static void look_ahead(Listed *l, uint32_t near, const Rectangle *all) {
    int axis = -1;
    double by[2];
    for (int a = 0; a < 2; a++) {
        const double size = all->hi[a] - all->lo[a];
        by[a] = 0.5 * (all->lo[a] + all->hi[a]) - l->middle[a];
        if (fabs(by[a]) <= 0.5 * size) continue;
        if (axis >= 0 || fabs(by[a]) > 1.5 * size) return;
        axis = a;
    }
    if (axis < 0) return;
    if (near <= FEW_NEAR) l->reach = l->reach < MOST_REACH ? 2 * l->reach + 1 : l->reach;
    else if (near > MANY_NEAR) l->reach /= 2;
    (by[axis] < 0 ? l->in.lo : l->in.hi)[axis] += l->reach * by[axis];
    for (int a = 0; a < 2; a++) {
        const double unsteady = UNSTEADY * (all->hi[a] - all->lo[a]);
        l->in.lo[a] -= unsteady, l->in.hi[a] += unsteady;
    }
}

/* Lists what windows in a rectangle of the frame may see; again: it is the frame of what was listed. */
static void list_for(Search *s, const Window *frame, bool again, const Rectangle *all) {
    Listed *l = &s->store->listed;
    const Rectangle *in = &l->in;
    if (again && all->lo[0] >= in->lo[0] && all->lo[1] >= in->lo[1] && all->hi[0] <= in->hi[0] &&
        all->hi[1] <= in->hi[1])
        return;
    l->in = *all;
    if (again) look_ahead(l, s->store->near.n, all);
    else l->window = *frame, l->reach = 0;
    s->scene->facets->list(s, &l->window, &l->in);
    l->version = s->scene->tree.moved || s->store->lost ? 0 : s->scene->tree.bvh->version;
}

bool pieces_none(const PieceScene *scene, const void *rays, uint32_t width) {
    const BvhScene *tree = &scene->tree;
    Store *store = told_store();
    if (!store || store->near.n || store->listed.version != tree->bvh->version || tree->moved) return false;
    Listed *l = &store->listed;
    Rectangle all;
    if (!scene->facets->inside(&l->window, &l->in, tree->bvh->f64, rays, width, &all)) return false;
    for (int a = 0; a < 2; a++) l->middle[a] = 0.5 * (all.lo[a] + all.hi[a]);
    return true;
}

bool pieces_find(const PieceScene *scene, const void *rays, uint64_t mask, uint32_t width, int32_t *witness) {
    Search s; /* much of it is set where it is asked */
    s.scene = scene, s.store = told_store(), s.f64 = scene->tree.bvh->f64;
    Beams beams;
    Places lie;
    Neighbours group;
    if (!s.store || !s.store->n) return false;
    s.store->lost = false;
    scene->facets->read(&beams, s.f64, rays, mask, width, scene->tree.bvh->magnitude);
    if (beams.blind) atomic_store(scene->blind, true);
    while (beams.mask) {
        const uint32_t base = (uint32_t)__builtin_ctzll(beams.mask);
        Listed *listed = &s.store->listed;
        Window frame;
        const bool current = listed->version == scene->tree.bvh->version && !scene->tree.moved;
        bool again = current && in_frame(&beams, &listed->window);
        if (again) {
            scene->facets->place(&listed->window, &beams, base, width, &lie);
            again = lie.ahead >> base & 1;
        }
        if (!again) {
            window_frame(&frame, &beams, base);
            again = current && same_frame(&frame, &listed->window);
            if (!again) window_planes(&frame);
            scene->facets->place(again ? &listed->window : &frame, &beams, base, width, &lie);
        }
        neighbours(&beams, base, width, &lie, &group);
        list_for(&s, &frame, again, &group.all);
        for (int a = 0; a < 2; a++) listed->middle[a] = 0.5 * (group.all.lo[a] + group.all.hi[a]);
        s.alike = group.alike;
        if (s.store->near.n) scene->facets->survey(&s, &beams, &lie, &group);
        else group.whole = group.open = 0;
        for (uint64_t left = group.whole | group.open; left; left &= left - 1) {
            const uint32_t k = (uint32_t)__builtin_ctzll(left), n = group.count[k];
            const bool whole = group.whole >> k & 1;
            s.first = s.last = 0;
            if (scene->outlined) window_set(&s.window, &beams, k), keep_beam(&s);
            if (whole) {
                told_whole(&s, group.triangle[k]);
            } else if (scene->outlined || n > FEW_FACETS ||
                       !told_sheet(&s, s.store->candidate.data + group.first[k], n, group.others[k])) {
                scene->facets->survey_all(&s, &beams, &lie, &group, k);
                look_through(&s, &beams, k, s.store->candidate.data + group.first[k], group.count[k]);
            }
            witness[k] = (int32_t)s.first;
        }
        beams.mask &= group.last == LANES - 1 ? 0 : ~0ull << (group.last + 1);
    }
    told_end(s.store);
    return !s.store->lost;
}
