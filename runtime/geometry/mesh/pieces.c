/* Windows: which are near each other, what is in them, which parts of them are looked at. */
#include "pieces.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "saltus/mesh.h"
#include "saltus/query.h"
#include "window.h"

enum {
    FEW = 48,     /* facets in a part of a window that is not halved */
    HALVINGS = 40 /* at most */
};
#define SPARSE 4.0 /* times the area of windows is what is looked through for them together, at most */

/* ---- windows */

static bool window_set(Window *w, const PieceScene *s, const void *rays, uint32_t lane, uint32_t width) {
    double row[SLT_BEAM_ROWS];
    for (uint32_t k = 0; k < SLT_BEAM_ROWS; k++) {
        const size_t at = (size_t)k * width + lane;
        row[k] = s->tree.bvh->f64 ? ((const double *)rays)[at] : (double)((const float *)rays)[at];
        if (!(fabs(row[k]) <= 1e30)) return false;
    }
    for (int a = 0; a < 3; a++) {
        w->eye[a] = row[SLT_BEAM_EYE + a], w->c[a] = row[SLT_BEAM_CORNER + a] - w->eye[a];
        w->u[a] = row[SLT_BEAM_U + a], w->v[a] = row[SLT_BEAM_V + a];
    }
    window_cross(w->v, w->c, w->plane[0]);
    window_cross(w->c, w->u, w->plane[1]);
    window_cross(w->u, w->v, w->plane[2]);
    double whole = window_dot(w->u, w->plane[0]);
    if (whole == 0 || !isfinite(whole)) return false;
    for (int k = 0; k < 3 && whole < 0; k++)
        for (int a = 0; a < 3; a++) w->plane[k][a] = -w->plane[k][a];
    return true;
}

/* Where window w lies in the one of `base`, which has the same eye. False: not ahead of it. */
static bool lies_in(const Window *base, const Window *w, Rectangle *r) {
    for (int i = 0; i < 2; i++) r->lo[i] = HUGE_VAL, r->hi[i] = -HUGE_VAL;
    for (int k = 0; k < 4; k++) {
        double d[3];
        for (int a = 0; a < 3; a++) d[a] = w->c[a] + (k & 1 ? w->u[a] : 0) + (k & 2 ? w->v[a] : 0);
        const double along = window_dot(d, base->plane[2]);
        if (!(along > 0)) return false;
        for (int i = 0; i < 2; i++) {
            const double at = window_dot(d, base->plane[i]) / along;
            r->lo[i] = fmin(r->lo[i], at), r->hi[i] = fmax(r->hi[i], at);
        }
    }
    return true;
}

static double area_of(const Rectangle *r) { return (r->hi[0] - r->lo[0]) * (r->hi[1] - r->lo[1]); }

/* ---- parts of a window, depth first */

static int nearest_first(const void *x, const void *y) {
    const Facet *a = x, *b = y;
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
                f->lo[a] = fmin(f->lo[a], at - 1e-9 * (1 + fabs(at))),
                f->hi[a] = fmax(f->hi[a], at + 1e-9 * (1 + fabs(at)));
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
    if (n <= FEW || halvings == HALVINGS) {
        cover_all(store, r, from, n);
        for (uint32_t i = 0; i < store->piece.n; i++)
            if (store->piece.data[i].n >= 3 && store->piece.data[i].facet >= 0) told_piece(s, &store->piece.data[i]);
        return;
    }
    const int axis = r->hi[0] - r->lo[0] >= r->hi[1] - r->lo[1] ? 0 : 1;
    const double middle = 0.5 * (r->lo[axis] + r->hi[axis]);
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

static void look_through(Search *s, const Rectangle *within) {
    Store *store = s->store;
    s->first = s->last = 0;
    s->scene->facets->survey(s, within);
    const uint32_t n = store->facet.n;
    if (!n) return;
    if (n == 1 && store->facet.data[0].fills) {
        told_whole(s, &store->facet.data[0]);
        return;
    }
    if (n > 1) qsort(store->facet.data, n, sizeof *store->facet.data, nearest_first);
    if (n > FEW) locate(s);
    store->chosen.n = 0;
    if (!window_room(store, &store->chosen.data, 0, &store->chosen.room, n, sizeof *store->chosen.data)) return;
    for (uint32_t i = 0; i < n; i++) store->chosen.data[store->chosen.n++] = i;
    look(s, 0, n, &(Rectangle){{0, 0}, {1, 1}}, 0);
}

bool pieces_find(const PieceScene *scene, const void *rays, uint64_t mask, uint32_t width, int32_t *witness) {
    enum { MOST = 64 };
    Search s = {.scene = scene, .store = told_store(), .f64 = scene->tree.bvh->f64};
    for (uint32_t k = 0; k < width; k++) witness[k] = 0;
    if (!s.store || !s.store->n) return false;
    s.store->lost = false;
    Window window[MOST];
    for (uint32_t k = 0; k < width; k++)
        if (mask >> k & 1 && !window_set(&window[k], scene, rays, k, width)) mask &= ~(1ull << k);
    while (mask) {
        /* Lanes that look from one eye through windows side by side are listed for together. */
        const uint32_t base = (uint32_t)__builtin_ctzll(mask);
        uint32_t last = base;
        Rectangle lies[MOST], all;
        double area = 1;
        lies[base] = all = (Rectangle){{0, 0}, {1, 1}};
        for (uint32_t k = base + 1; k < width; k++) {
            if (!(mask >> k & 1)) continue;
            Rectangle wider = all;
            if (memcmp(window[k].eye, window[base].eye, sizeof window[k].eye) != 0 ||
                !lies_in(&window[base], &window[k], &lies[k]))
                break;
            for (int i = 0; i < 2; i++)
                wider.lo[i] = fmin(wider.lo[i], lies[k].lo[i]), wider.hi[i] = fmax(wider.hi[i], lies[k].hi[i]);
            if (!(area_of(&wider) <= SPARSE * (area + area_of(&lies[k])))) break;
            area += area_of(&lies[k]);
            all = wider, last = k;
        }
        scene->facets->list(&s, &window[base], &all);
        for (uint32_t k = base; k <= last; k++) {
            if (!(mask >> k & 1)) continue;
            mask &= ~(1ull << k);
            s.window = window[k];
            look_through(&s, &lies[k]);
            witness[k] = (int32_t)s.first;
        }
    }
    return !s.store->lost;
}
