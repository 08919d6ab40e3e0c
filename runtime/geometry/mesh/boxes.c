/* None of them meets anything if each triangle lies beside all of them, or before or behind. All of them meet something
 * if the middle one meets a triangle and no ray can leave what is around it: a set of triangles, each of which all rays
 * see from one side and within their ends, is closed but at edges that all rays pass on the inner side. If every other
 * triangle lies beside all rays or behind the set, this is the surface that all of them meet. */
#include "boxes.h"

#include <math.h>
#include <string.h>

#include "saltus/mesh.h"
#include "saltus/query.h"

enum { PATCH = SLT_RAYS_PATCH_MOST }; /* triangles around a ray, at most */
/* Rays see a corner, less their origin and sheared, where it is but for 6 roundings of its largest coordinate; f64 edge
 * functions are rounded as well (rays.inc.h). */
#define ROUNDED(f64) ((f64) ? 0x1p-49 : 0x1p-21)

typedef struct Range {
    double lo, hi;
} Range;

typedef struct Box {
    const BvhScene *scene;
    const WalkMesh *mesh;
    Range o[3], d[3], t0, t1;
    double wide; /* how far the boxes of the tree are from theirs, at most */
} Box;

/* Outward by more than one operation rounds. */
static Range widened(double lo, double hi) {
    return (Range){isinf(lo) ? lo : lo - fabs(lo) * 0x1p-51 - 0x1p-1000,
                   isinf(hi) ? hi : hi + fabs(hi) * 0x1p-51 + 0x1p-1000};
}

static Range add(Range a, Range b) { return widened(a.lo + b.lo, a.hi + b.hi); }
static Range minus(Range a, Range b) { return widened(a.lo - b.hi, a.hi - b.lo); }

/* An end of a ray may be infinite, which times 0 is anything. */
static Range times(Range a, Range b) {
    double p = a.lo * b.lo, q = a.lo * b.hi, r = a.hi * b.lo, s = a.hi * b.hi;
    if (isnan(p) || isnan(q) || isnan(r) || isnan(s)) return (Range){-INFINITY, INFINITY};
    return widened(fmin(fmin(p, q), fmin(r, s)), fmax(fmax(p, q), fmax(r, s)));
}

static Range dot(const Range a[3], const Range b[3]) {
    return add(times(a[0], b[0]), add(times(a[1], b[1]), times(a[2], b[2])));
}

static void cross(const Range a[3], const Range b[3], Range out[3]) {
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        out[i] = minus(times(a[j], b[k]), times(a[k], b[j]));
    }
}

/* 1 or -1 where all of it has this sign, 0 where not. */
static int sign_of(Range a) { return a.lo > 0 ? 1 : a.hi < 0 ? -1 : 0; }

/* What is known of a triangle and all rays of the box. */
typedef struct Seen {
    int facing;          /* sign of d . normal */
    int edge[3];         /* the sign of d . (P x (Q - P)), of the edge from corner k to the next */
    Range height, speed; /* of its plane above the origins, along the normal, and of the rays: t is their quotient */
    int near, far;       /* whether the rays' ends lie before (1) or behind (-1) its plane, along the normal */
} Seen;

static Seen look(const Box *b, int32_t face) {
    Range at[3][3], along[3][3], normal[3], n[3];
    double v[3][3], far = 0;
    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++) {
            const size_t i = 3 * (size_t)b->mesh->face[3 * (size_t)face + (size_t)k] + (size_t)a;
            v[k][a] = b->mesh->f64 ? ((const double *)b->mesh->vertex)[i] : (double)((const float *)b->mesh->vertex)[i];
            far = fmax(far, fmax(fabs(v[k][a] - b->o[a].lo), fabs(v[k][a] - b->o[a].hi)));
        }
    const double wide = ROUNDED(b->mesh->f64) * far;
    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++) at[k][a] = widened(v[k][a] - wide, v[k][a] + wide);
    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++) along[k][a] = minus(at[(k + 1) % 3][a], at[k][a]);
    cross(along[0], along[1], normal);
    Range from[3][3];
    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++) from[k][a] = minus(at[k][a], b->o[a]);
    Seen s = {.height = dot(from[0], normal), .speed = dot(b->d, normal)};
    s.facing = sign_of(s.speed);
    for (int k = 0; k < 3; k++) {
        cross(from[k], along[k], n);
        s.edge[k] = sign_of(dot(b->d, n));
    }
    s.near = sign_of(minus(s.height, times(b->t0, s.speed)));
    s.far = sign_of(minus(s.height, times(b->t1, s.speed)));
    return s;
}

/* Can no ray meet it? */
static bool is_beside(const Seen *s) {
    bool plus = false, less = false;
    for (int k = 0; k < 3; k++) plus |= s->edge[k] > 0, less |= s->edge[k] < 0;
    return (plus && less) || (s->near != 0 && s->near == s->far);
}

static bool is_between_ends(const Seen *s) { return s->facing != 0 && s->near == s->facing && s->far == -s->facing; }

/* ---- all */
static bool is_in(const int32_t *patch, uint32_t n, int32_t face) {
    for (uint32_t i = 0; i < n; i++)
        if (patch[i] == face) return true;
    return false;
}

/* Does the other face run along the half-edge the other way, as neighbours do? Then they face one side. */
static bool is_opposite(const WalkMesh *m, int32_t face, int k, int32_t half) {
    return m->face[3 * (size_t)face + (size_t)k] != m->face[half];
}

/* Triangles around the middle ray, all seen from one side. */
typedef struct Patch {
    uint32_t n;
    int32_t face[PATCH];
    int facing[PATCH];
} Patch;

static bool is_covered(const Box *b, int32_t face, Patch *p) {
    p->n = 1, p->face[0] = face, p->facing[0] = look(b, face).facing;
    for (uint32_t i = 0; i < p->n; i++) {
        const Seen s = look(b, p->face[i]);
        if (!is_between_ends(&s) || s.facing != p->facing[i]) return false;
        for (int k = 0; k < 3; k++) {
            if (s.edge[k] == s.facing) continue;
            if (s.edge[k] == -s.facing && i == 0) return false;
            if (!b->mesh->adjacency) return false;
            int32_t half = b->mesh->adjacency->across[3 * (size_t)p->face[i] + (size_t)k];
            if (half < 0) return false;
            if (is_in(p->face, p->n, half / 3)) continue;
            if (p->n == PATCH) return false;
            p->facing[p->n] = is_opposite(b->mesh, p->face[i], k, half) ? s.facing : -s.facing;
            p->face[p->n++] = half / 3;
        }
    }
    return true;
}

/* ---- none */

/* The t at which o + t d may be in [lo, hi]. */
static Range times_inside(Range o, Range d, double lo, double hi) {
    const Range away = minus((Range){lo, hi}, o);
    if (d.lo <= 0 && d.hi >= 0) {
        const double least = away.lo > 0 ? away.lo : away.hi < 0 ? -away.hi : 0, fastest = fmax(-d.lo, d.hi);
        if (least == 0) return (Range){-INFINITY, INFINITY};
        /* Before or behind, but not at once: only the smallest |t| is known. Rays do not run backwards here. */
        return widened(least / fastest, INFINITY);
    }
    const Range inverse = widened(1 / d.hi, 1 / d.lo);
    return times(away, inverse);
}

static bool may_enter(const Box *b, const BvhNode *node, int k) {
    double from = b->t0.lo, to = b->t1.hi;
    for (int a = 0; a < 3; a++) {
        if (node->lo[a][k] > node->hi[a][k]) return false;
        Range t = times_inside(b->o[a], b->d[a], (double)node->lo[a][k] - b->wide, (double)node->hi[a][k] + b->wide);
        from = fmax(from, t.lo), to = fmin(to, t.hi);
    }
    return from <= to;
}

/* Of the triangles of a leaf but a patch. */
static bool leaf_is_free(const Box *b, int32_t leaf, const Patch *but) {
    for (int k = 0; k < BVH_LEAF; k++) {
        const Bvh *t = b->scene->bvh;
        const int32_t face =
            t->f64 ? ((const BvhLeaf64 *)t->leaf)[leaf].triangle[k] : ((const BvhLeaf32 *)t->leaf)[leaf].triangle[k];
        if (face < 0 || is_in(but->face, but->n, face)) continue;
        const Seen s = look(b, face);
        if (!is_beside(&s)) return false;
    }
    return true;
}

/* Do rays meet nothing, or but these triangles? */
static bool is_free(const Box *b, const Patch *but) {
    int32_t stack[BVH_STACK];
    uint32_t depth = 1;
    stack[0] = 0;
    while (depth) {
        const BvhNode *node = &b->scene->bvh->node[stack[--depth]];
        for (int k = 0; k < BVH_WIDTH; k++) {
            if (!may_enter(b, node, k)) continue;
            if (node->child[k] >= 0) stack[depth++] = node->child[k];
            else if (!leaf_is_free(b, ~node->child[k], but)) return false;
        }
    }
    return true;
}

/* ---- what is met first */

/* The t at which rays meet the plane of a face that all of them see from one side, but for rounding. */
static Range reach(const Box *b, const Seen *s) {
    const Range inverse = widened(1 / s->speed.hi, 1 / s->speed.lo), t = times(s->height, inverse);
    const double wide = ROUNDED(b->mesh->f64) * fmax(fabs(t.lo), fabs(t.hi));
    return widened(t.lo - wide, t.hi + wide);
}

/* Does nothing lie before a patch that covers the box? */
static bool is_nearest(const Box *b, const Patch *p) {
    Box before = *b;
    double farthest = 0;
    for (uint32_t i = 0; i < p->n; i++) {
        const Seen s = look(b, p->face[i]);
        farthest = fmax(farthest, reach(b, &s).hi);
    }
    before.t1.lo = before.t1.hi = fmin(b->t1.hi, farthest);
    return is_free(&before, p);
}

/* A patch that covers the box lies over it as often everywhere as over the middle: once, or it winds around a vertex
 * more than once. */
static bool is_single(const Box *b, const Patch *p) {
    Box at = *b;
    uint32_t n = 0;
    for (int a = 0; a < 3; a++) {
        at.o[a].lo = at.o[a].hi = 0.5 * (b->o[a].lo + b->o[a].hi);
        at.d[a].lo = at.d[a].hi = 0.5 * (b->d[a].lo + b->d[a].hi);
    }
    for (uint32_t i = 0; i < p->n; i++) {
        const Seen s = look(&at, p->face[i]);
        n += !is_beside(&s);
    }
    return n == 1;
}

/* Of a patch that covers the box what SLT_QUERY_SURFACE answers; which: 0, or one more than that of a face in it. */
static int32_t name(const Box *b, const Patch *p, double which) {
    if (!(which > 0)) which = 0;
    if (p->face[0] >= INT32_MAX - SLT_RAYS_FACE || !is_nearest(b, p) || !is_single(b, p)) return SLT_RAYS_BLOCKED;
    if (which == 0 && p->n > 1) return SLT_RAYS_PATCH - (int32_t)p->n;
    return SLT_RAYS_FACE + p->face[which < 1 || which > p->n ? 0 : (uint32_t)which - 1];
}

/* ---- the question */

static double number(bool f64, const void *rays, uint32_t row, uint32_t width, uint32_t lane) {
    const size_t i = (size_t)row * width + lane;
    return f64 ? ((const double *)rays)[i] : (double)((const float *)rays)[i];
}

static bool range_of(Range *r, bool f64, const void *rays, uint32_t row, uint32_t width, uint32_t lane) {
    r->lo = number(f64, rays, row, width, lane), r->hi = number(f64, rays, row + SLT_RAY_ROWS, width, lane);
    return r->lo <= r->hi;
}

static bool box_of(Box *b, const void *rays, uint32_t width, uint32_t lane) {
    const bool f64 = b->mesh->f64;
    const double huge = f64 ? 1e300 : 1e30;
    double size = b->scene->bvh->magnitude + b->scene->slack;
    bool ok =
        range_of(&b->t0, f64, rays, SLT_RAY_T0, width, lane) && range_of(&b->t1, f64, rays, SLT_RAY_T1, width, lane);
    for (uint32_t a = 0; a < 3; a++) {
        ok = ok && range_of(&b->o[a], f64, rays, SLT_RAY_OX + a, width, lane) &&
             range_of(&b->d[a], f64, rays, SLT_RAY_DX + a, width, lane);
        size = fmax(size, fmax(fabs(b->o[a].lo), fabs(b->o[a].hi)));
    }
    /* As rays widen the boxes that they go through. */
    b->wide = size * (f64 ? 0x1p-48 : 0x1p-20) + b->scene->slack;
    return ok && b->t0.lo >= 0 && size < huge;
}

/* What the ray in the middle meets; SLT_WITNESS_NONE where it meets nothing. */
static int32_t middle(const Box *b, BvhSearch *search) {
    double ray[SLT_RAY_POINT_ROWS];
    float single[SLT_RAY_POINT_ROWS];
    int32_t found;
    for (int a = 0; a < 3; a++)
        ray[SLT_RAY_OX + a] = 0.5 * (b->o[a].lo + b->o[a].hi), ray[SLT_RAY_DX + a] = 0.5 * (b->d[a].lo + b->d[a].hi);
    ray[SLT_RAY_T0] = b->t0.hi, ray[SLT_RAY_T1] = b->t1.lo;
    for (int i = 0; i < SLT_RAY_POINT_ROWS; i++) single[i] = (float)ray[i];
    search(b->scene, b->mesh->f64 ? (const void *)ray : single, 1, 1, false, &found);
    return found;
}

void boxes_decide(const BvhScene *s, const WalkMesh *mesh, BvhSearch *search, const void *rays, uint64_t mask,
                  uint32_t width, bool names, int32_t *witness) {
    for (uint32_t k = 0; k < width; k++) {
        Box b = {.scene = s, .mesh = mesh};
        witness[k] = SLT_RAYS_EITHER;
        if (!(mask >> k & 1) || !box_of(&b, rays, width, k)) continue;
        int32_t face = middle(&b, search);
        Patch patch = {0};
        if (face < 0) witness[k] = is_free(&b, &patch) ? SLT_RAYS_FREE : SLT_RAYS_EITHER;
        else if (!is_covered(&b, face, &patch)) continue;
        else witness[k] = names ? name(&b, &patch, number(mesh->f64, rays, SLT_RAY_LIFT, width, k)) : SLT_RAYS_BLOCKED;
    }
}
