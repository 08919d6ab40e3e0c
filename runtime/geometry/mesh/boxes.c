/* None of them meets anything if each triangle lies beside all of them, or before or behind. All of them meet something
 * if the middle one meets a triangle and no ray can leave what is around it: a set of triangles, each of which all rays
 * see from one side and within their ends, is closed but at edges that all rays pass on the inner side.
 *
 * Else there are lines between those that do and those that do not. A ray of the box is the last that meets anything
 * only where it passes an edge, or where a triangle passes one of its ends; and not at an edge where two triangles
 * meet that all rays see from one side: beyond it they meet the other one. So of all triangles that are not beside the
 * rays the edges are named that may pass the box and are not of that kind, and the planes that may pass an end. Lines
 * that parts of the mesh hide, or that end before the box, are among them: across these nothing changes. Where there
 * is no line all rays are as the middle one is. */
#include "boxes.h"

#include <math.h>
#include <string.h>

#include "saltus/mesh.h"
#include "saltus/query.h"

enum {
    PATCH = 24,   /* triangles around a ray, at most */
    FACES = 96,   /* beside which a box does not lie, at most, of which lines are looked for, */
    FEW = 24,     /* and of which some are told where not all can be */
    MOST_FLAT = 3 /* triangles without area one behind the other */
};
/* Rays see a corner, less their origin and sheared, where it is but for 6 roundings of its largest coordinate; f64 edge
 * functions are rounded as well (rays.inc.h). */
#define ROUNDED(f64) ((f64) ? 0x1p-49 : 0x1p-21)
#define ONE_LINE(f64) ((f64) ? 0x1p-23 : 0x1p-6) /* the angle below which two edges are one line */

typedef struct Range {
    double lo, hi;
} Range;

typedef struct Box {
    const BvhScene *scene;
    const WalkMesh *mesh;
    Range o[3], d[3], t0, t1;
    double wide; /* how far the boxes of the tree are from theirs, at most */
} Box;

/* fmin and fmax are calls. */
static inline double lesser(double a, double b) { return a < b ? a : b; }
static inline double greater(double a, double b) { return a > b ? a : b; }

/* Outward by more than one operation rounds. */
static inline Range widened(double lo, double hi) {
    const double out = 1 + 0x1p-51, in = 1 - 0x1p-51;
    return (Range){lo * (lo < 0 ? out : in) - 0x1p-1000, hi * (hi < 0 ? in : out) + 0x1p-1000};
}

static inline Range add(Range a, Range b) { return widened(a.lo + b.lo, a.hi + b.hi); }
static inline Range minus(Range a, Range b) { return widened(a.lo - b.hi, a.hi - b.lo); }

/* An end of a ray may be infinite, which times 0 is anything. */
static inline Range times(Range a, Range b) {
    double p = a.lo * b.lo, q = a.lo * b.hi, r = a.hi * b.lo, s = a.hi * b.hi;
    if (isnan(p + q + r + s)) return (Range){-INFINITY, INFINITY};
    return widened(lesser(lesser(p, q), lesser(r, s)), greater(greater(p, q), greater(r, s)));
}

static inline Range dot(const Range a[3], const Range b[3]) {
    return add(times(a[0], b[0]), add(times(a[1], b[1]), times(a[2], b[2])));
}

static inline void cross(const Range a[3], const Range b[3], Range out[3]) {
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        out[i] = minus(times(a[j], b[k]), times(a[k], b[j]));
    }
}

/* 1 or -1 where all of it has this sign, 0 where not. */
static int sign_of(Range a) { return a.lo > 0 ? 1 : a.hi < 0 ? -1 : 0; }

/* What is known of a triangle and all rays of the box. */
typedef struct Seen {
    int facing;    /* sign of d . normal */
    int side;      /* the same of rays that meet it, which do so in front of their origin: that side it lies on, too */
    int edge[3];   /* the sign of d . (P x (Q - P)), of the edge from corner k to the next */
    int near, far; /* whether the rays' ends lie before (1) or behind (-1) its plane, along the normal */
    bool begin, end; /* may a ray begin, or end, in the triangle? */
    bool beside;     /* no ray can meet it */
} Seen;

/* Of the rays that meet a triangle: t is between those of its corners, d . (corner - o) / d . d. Not known where d may
 * be 0. */
static Range times_of(const Box *b, Range from[3][3]) {
    const Range square = dot(b->d, b->d);
    Range t = {INFINITY, -INFINITY};
    if (!(square.lo > 0)) return (Range){-INFINITY, INFINITY};
    for (int k = 0; k < 3; k++) {
        Range at = times(dot(b->d, from[k]), widened(1 / square.hi, 1 / square.lo));
        t.lo = lesser(t.lo, at.lo), t.hi = greater(t.hi, at.hi);
    }
    return t;
}

static void vertex_of(const Box *b, int32_t v, double out[3]) {
    for (size_t a = 0; a < 3; a++)
        out[a] = b->mesh->f64 ? ((const double *)b->mesh->vertex)[3 * (size_t)v + a]
                              : (double)((const float *)b->mesh->vertex)[3 * (size_t)v + a];
}

enum { LOOK_EDGES = 1, LOOK_PLANE = 2, LOOK_AT_ALL = LOOK_EDGES | LOOK_PLANE, LOOK_UNLESS_BESIDE = 4 };

static Seen look(const Box *b, int32_t face, int what) {
    Range at[3][3], from[3][3], along[3][3], normal[3], n[3];
    double v[3][3], far = 0;
    Seen s = {0};
    for (int k = 0; k < 3; k++) vertex_of(b, b->mesh->face[3 * (size_t)face + (size_t)k], v[k]);
    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++) far = greater(far, greater(fabs(v[k][a] - b->o[a].lo), fabs(v[k][a] - b->o[a].hi)));
    const double wide = ROUNDED(b->mesh->f64) * far;
    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++)
            at[k][a] = widened(v[k][a] - wide, v[k][a] + wide), from[k][a] = minus(at[k][a], b->o[a]);
    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++) along[k][a] = minus(at[(k + 1) % 3][a], at[k][a]);
    if (what & LOOK_EDGES) {
        bool plus = false, less = false;
        for (int k = 0; k < 3; k++) {
            cross(from[k], along[k], n);
            s.edge[k] = sign_of(dot(b->d, n));
            plus |= s.edge[k] > 0, less |= s.edge[k] < 0;
        }
        s.beside = plus && less;
    }
    if (s.beside && what & LOOK_UNLESS_BESIDE) return s;
    cross(along[0], along[1], normal);
    const Range height = dot(from[0], normal), speed = dot(b->d, normal);
    s.facing = sign_of(speed);
    s.side = s.facing ? s.facing : sign_of(height);
    s.near = sign_of(minus(height, times(b->t0, speed)));
    s.far = sign_of(minus(height, times(b->t1, speed)));
    s.beside |= s.near != 0 && s.near == s.far;
    if (s.near && s.far) return s;
    const Range t = times_of(b, from);
    s.begin = !s.near && t.lo <= b->t0.hi && t.hi >= b->t0.lo;
    s.end = !s.far && t.lo <= b->t1.hi && t.hi >= b->t1.lo;
    s.beside |= t.hi < b->t0.lo || t.lo > b->t1.hi;
    return s;
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

static bool is_covered(const Box *b, int32_t face) {
    int32_t patch[PATCH];
    int facing[PATCH];
    uint32_t n = 1;
    patch[0] = face, facing[0] = look(b, face, LOOK_PLANE).facing;
    for (uint32_t i = 0; i < n; i++) {
        const Seen s = look(b, patch[i], LOOK_AT_ALL);
        if (!is_between_ends(&s) || s.facing != facing[i]) return false;
        for (int k = 0; k < 3; k++) {
            if (s.edge[k] == s.facing) continue;
            if (s.edge[k] == -s.facing && i == 0) return false;
            if (!b->mesh->adjacency) return false;
            int32_t half = b->mesh->adjacency->across[3 * (size_t)patch[i] + (size_t)k];
            if (half < 0) return false;
            if (is_in(patch, n, half / 3)) continue;
            if (n == PATCH) return false;
            facing[n] = is_opposite(b->mesh, patch[i], k, half) ? s.facing : -s.facing;
            patch[n++] = half / 3;
        }
    }
    return true;
}

/* ---- none, or lines */

/* The t at which o + t d may be in [lo, hi]. */
static Range times_inside(Range o, Range d, double lo, double hi) {
    const Range away = minus((Range){lo, hi}, o);
    if (d.lo <= 0 && d.hi >= 0) {
        const double least = away.lo > 0 ? away.lo : away.hi < 0 ? -away.hi : 0, fastest = fmax(-d.lo, d.hi);
        if (least == 0) return (Range){-INFINITY, INFINITY};
        if (!(fastest > 0)) return (Range){INFINITY, INFINITY}; /* never */
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

typedef struct Lines {
    uint32_t n, faces;
    struct {
        int32_t a, b; /* as of saltus/mesh.h */
    } line[SLT_LINES];
    bool many; /* there are more than are told */
    bool lost; /* and nothing is */
} Lines;

/* In order, each once: it must not matter in which order a tree has the triangles. */
static void add_line(Lines *l, int32_t a, int32_t b) {
    uint32_t at = 0;
    while (at < l->n && (l->line[at].a < a || (l->line[at].a == a && l->line[at].b < b))) at++;
    if (at < l->n && l->line[at].a == a && l->line[at].b == b) return;
    l->many |= l->n == SLT_LINES;
    if (at == SLT_LINES) return;
    l->n -= l->n == SLT_LINES; /* the last one goes */
    memmove(&l->line[at + 1], &l->line[at], (l->n - at) * sizeof *l->line);
    l->line[at].a = a, l->line[at].b = b, l->n++;
}

#define FLAT 1e-28 /* of a triangle without area the square of the sine between its sides */

/* No ray meets it, and no bounds say so. */
static bool has_no_area(const Box *b, int32_t face) {
    double v[3][3], u[3], w[3], uu = 0, ww = 0, nn = 0;
    for (int k = 0; k < 3; k++) vertex_of(b, b->mesh->face[3 * (size_t)face + (size_t)k], v[k]);
    for (int a = 0; a < 3; a++) {
        u[a] = v[1][a] - v[0][a], w[a] = v[2][a] - v[0][a];
        uu += u[a] * u[a], ww += w[a] * w[a];
    }
    for (int a = 0; a < 3; a++) {
        const double n = u[(a + 1) % 3] * w[(a + 2) % 3] - u[(a + 2) % 3] * w[(a + 1) % 3];
        nn += n * n;
    }
    return nn <= FLAT * uu * ww; /* without a side, too */
}

/* The side that all rays see of what lies beyond an edge, as of this face; 0: not known, or nothing does. Beyond a
 * triangle without area lies what its other edges lead to, where they agree. */
static int side_beyond(const Box *b, int32_t face, int k, int flat) {
    const int32_t half = b->mesh->adjacency->across[3 * (size_t)face + (size_t)k];
    if (half < 0) return 0;
    int side = look(b, half / 3, LOOK_PLANE).side;
    if (!side && flat < MOST_FLAT && has_no_area(b, half / 3)) {
        side = side_beyond(b, half / 3, (half + 1) % 3, flat + 1);
        if (side && side != side_beyond(b, half / 3, (half + 2) % 3, flat + 1)) side = 0;
    }
    return is_opposite(b->mesh, face, k, half) ? side : -side;
}

/* Do all rays that meet the face near this edge meet the neighbour beyond it? */
static bool goes_on(const Box *b, int32_t face, int k, int side) { return side && side_beyond(b, face, k, 0) == side; }

/* Is a triangle without area part of a surface that goes on beyond all of its edges, or of none? Then nothing hangs on
 * it; else it may open a gap, or close one, as soon as it moves. */
static bool hangs_on_nothing(const Box *b, int32_t face) {
    const int32_t *corner = b->mesh->face + 3 * (size_t)face, *across = b->mesh->adjacency->across + 3 * (size_t)face;
    if (corner[0] == corner[1] || corner[1] == corner[2] || corner[2] == corner[0]) return true;
    if (across[0] == ADJACENCY_BORDER && across[1] == ADJACENCY_BORDER && across[2] == ADJACENCY_BORDER) return true;
    const int side = side_beyond(b, face, 0, 0);
    return side && side == side_beyond(b, face, 1, 0) && side == side_beyond(b, face, 2, 0);
}

static void add_lines(const Box *b, int32_t face, const Seen *s, Lines *l) {
    if (s->begin) add_line(l, face, face);
    if (s->end) add_line(l, face, ~face);
    for (int k = 0; k < 3; k++) {
        if (s->edge[k] || goes_on(b, face, k, s->side)) continue;
        const int32_t *corner = b->mesh->face + 3 * (size_t)face, p = corner[k], q = corner[(k + 1) % 3];
        double end[2][3];
        vertex_of(b, p, end[0]), vertex_of(b, q, end[1]);
        if (memcmp(end[0], end[1], sizeof end[0]) == 0) continue; /* a point, which parts nothing */
        add_line(l, p < q ? p : q, p < q ? q : p);
    }
}

/* May a ray of the box pass through p? */
static bool may_pass(const Box *b, const double p[3]) {
    double far = 0;
    Range from[3], across[3];
    for (int a = 0; a < 3; a++) far = greater(far, greater(fabs(p[a] - b->o[a].lo), fabs(p[a] - b->o[a].hi)));
    const double wide = ROUNDED(b->mesh->f64) * far;
    for (int a = 0; a < 3; a++) from[a] = minus(widened(p[a] - wide, p[a] + wide), b->o[a]);
    cross(from, b->d, across);
    return !sign_of(across[0]) && !sign_of(across[1]) && !sign_of(across[2]) && dot(from, b->d).hi >= 0;
}

/* Of two ways from a point: their cross product, and how long both are across a ray. */
static double across_both(const Range u[3], const Range v[3], const Range ray[3]) {
    double along[3], uu = 0, vv = 0, uv[2] = {0}, rr = 0;
    for (int a = 0; a < 3; a++) {
        along[a] = 0.5 * (ray[a].lo + ray[a].hi);
        uu += u[a].lo * u[a].lo, vv += v[a].lo * v[a].lo, rr += along[a] * along[a];
        uv[0] += u[a].lo * along[a], uv[1] += v[a].lo * along[a];
    }
    return sqrt(fmax(0, uu * rr - uv[0] * uv[0]) * fmax(0, vv * rr - uv[1] * uv[1]) / rr);
}

/* May a ray along one of these see two ways from where it passes as one line, and the second go on where the first
 * ends? */
typedef struct OneLine {
    bool line, beyond;
} OneLine;

static OneLine see_along(const Box *b, const Range u[3], const Range v[3], const Range ray[3]) {
    Range n[3];
    cross(u, v, n);
    const Range high = dot(n, ray);
    const double most = ONE_LINE(b->mesh->f64) * across_both(u, v, ray);
    const Range along = minus(times(dot(u, v), dot(ray, ray)), times(dot(u, ray), dot(v, ray)));
    return (OneLine){!(high.lo > most || high.hi < -most), along.lo < 0}; /* NaN is neither */
}

/* The ways from p to q and from p to `to`, as rays through p see them: these come from the box's origins and go in its
 * directions, and what either of the two excludes no ray sees. */
static OneLine see_from(const Box *b, const double p[3], const double q[3], const double to[3]) {
    Range u[3], v[3], from[3];
    for (int a = 0; a < 3; a++) {
        u[a] = (Range){q[a] - p[a], q[a] - p[a]}, v[a] = (Range){to[a] - p[a], to[a] - p[a]};
        from[a] = minus((Range){p[a], p[a]}, b->o[a]);
    }
    const OneLine s = see_along(b, u, v, from), t = see_along(b, u, v, b->d);
    return (OneLine){s.line && t.line, s.beyond && t.beyond};
}

/* Does an edge end where another goes on that rays may see on one line with it? Be it that they meet there, or that one
 * lies behind the other: their lines are one, as far as rounding tells, and whose a place of it is, the lines do not
 * say. At the end the box must be cut; where edges meet, until it has one of them alone, for beside their corner the
 * two lines stay too near each other, however they are moved, for anyone to tell whose the jump is. */
static bool continues(const Box *b, const int32_t edge[2], const int32_t other[2]) {
    double p[2][3], q[2][3];
    for (int k = 0; k < 2; k++) vertex_of(b, edge[k], p[k]), vertex_of(b, other[k], q[k]);
    for (int i = 0; i < 2; i++) {
        bool meet = false, line = true, beyond = false;
        for (int j = 0; j < 2; j++) {
            const bool same = memcmp(p[i], q[j], sizeof p[i]) == 0;
            const OneLine s = same ? (OneLine){true, false} : see_from(b, p[i], p[1 - i], q[j]);
            meet |= same, line &= s.line, beyond |= s.beyond;
        }
        if (line && beyond && (meet || may_pass(b, p[i]))) return true;
    }
    return false;
}

static void normal_of(const double p[3], const double q[3], const double r[3], double out[3]) {
    for (int a = 0; a < 3; a++) {
        const int j = (a + 1) % 3, k = (a + 2) % 3;
        out[a] = (q[j] - p[j]) * (r[k] - p[k]) - (q[k] - p[k]) * (r[j] - p[j]);
    }
}

/* Likewise of triangles in one plane that an end of the rays passes: of those with an edge in common a box must have
 * one alone; with a corner in common, one of them or not the corner. Which lie on each other no box parts. */
static bool lie_beside(const Box *b, int32_t face, int32_t other) {
    const double least = ONE_LINE(b->mesh->f64);
    double v[2][3][3], n[2][3], square[2] = {0}, sine = 0, along = 0;
    int at[2][2], common = 0; /* corners in common */
    for (int k = 0; k < 3; k++) {
        vertex_of(b, b->mesh->face[3 * (size_t)face + (size_t)k], v[0][k]);
        vertex_of(b, b->mesh->face[3 * (size_t)other + (size_t)k], v[1][k]);
    }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            if (memcmp(v[0][i], v[1][j], sizeof v[0][i]) == 0 && common++ < 2)
                at[0][common - 1] = i, at[1][common - 1] = j;
    if (common < 1 || common > 2) return false;
    for (int f = 0; f < 2; f++) {
        if (common == 1) at[f][1] = (at[f][0] + 1) % 3;
        else if (at[f][0] == at[f][1]) return false; /* a triangle without an area */
        normal_of(v[f][at[f][0]], v[f][at[f][1]], v[f][3 - at[f][0] - at[f][1]], n[f]);
    }
    for (int a = 0; a < 3; a++) {
        const double w = n[0][(a + 1) % 3] * n[1][(a + 2) % 3] - n[0][(a + 2) % 3] * n[1][(a + 1) % 3];
        sine += w * w, along += n[0][a] * n[1][a];
        square[0] += n[0][a] * n[0][a], square[1] += n[1][a] * n[1][a];
    }
    if (!(sine <= least * least * square[0] * square[1])) return false;
    return common == 1 ? may_pass(b, v[0][at[0][0]]) : along < 0;
}

static bool is_edge(const Lines *l, uint32_t i) { return l->line[i].b >= 0 && l->line[i].a != l->line[i].b; }

static bool has_continued(const Box *b, const Lines *l) {
    for (uint32_t i = 0; i < l->n; i++)
        for (uint32_t k = 0; k < i; k++) {
            const int32_t one[2] = {l->line[i].a, l->line[i].b}, other[2] = {l->line[k].a, l->line[k].b};
            if (is_edge(l, i) && is_edge(l, k)) {
                if (continues(b, one, other) || continues(b, other, one)) return true;
            } else if (!is_edge(l, i) && !is_edge(l, k) && (one[1] < 0) == (other[1] < 0)) {
                if (lie_beside(b, one[0], other[0])) return true;
            }
        }
    return false;
}

/* False: it need not go on. */
static bool look_at_leaf(const Box *b, int32_t leaf, Lines *l) {
    for (int k = 0; k < BVH_LEAF; k++) {
        const Bvh *t = b->scene->bvh;
        const int32_t face =
            t->f64 ? ((const BvhLeaf64 *)t->leaf)[leaf].triangle[k] : ((const BvhLeaf32 *)t->leaf)[leaf].triangle[k];
        if (face < 0) continue;
        const Seen s = look(b, face, LOOK_AT_ALL | LOOK_UNLESS_BESIDE);
        if (s.beside || (!s.side && b->mesh->adjacency && has_no_area(b, face) && hangs_on_nothing(b, face))) continue;
        l->faces++;
        if (b->mesh->adjacency) add_lines(b, face, &s, l);
        l->lost = !b->mesh->adjacency || l->faces > (l->many ? FEW : FACES);
        if (l->lost) return false;
    }
    return true;
}

static void find_lines(const Box *b, Lines *l) {
    int32_t stack[BVH_STACK];
    uint32_t depth = 1;
    stack[0] = 0;
    while (depth) {
        const BvhNode *node = &b->scene->bvh->node[stack[--depth]];
        for (int k = 0; k < BVH_WIDTH; k++) {
            if (!may_enter(b, node, k)) continue;
            if (node->child[k] >= 0) stack[depth++] = node->child[k];
            else if (!look_at_leaf(b, ~node->child[k], l)) return;
        }
    }
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

static int32_t decide(const Box *b, BvhSearch *search, Lines *l) {
    const int32_t face = middle(b, search);
    if (face >= 0 && is_covered(b, face)) return SLT_RAYS_BLOCKED;
    find_lines(b, l);
    if (l->lost || (l->many && !l->n)) return SLT_RAYS_EITHER;
    if (l->n) return SLT_RAYS_EITHER + (int32_t)l->n + (l->many || has_continued(b, l) ? SLT_LINES : 0);
    /* Of triangles without neighbours that are known nothing is proven but that there is none. */
    return face >= 0 ? SLT_RAYS_BLOCKED : SLT_RAYS_FREE;
}

/* Of the box of each lane what was found last: who asks for lines has asked for their number just before, of the same
 * vertices. */
typedef struct Last {
    const void *mesh, *vertex;
    double row[SLT_BOX_ROWS], slack;
    int32_t answer;
    Lines lines;
} Last;
static _Thread_local Last last[64];

static bool is_last(const Last *l, const BvhScene *s, const WalkMesh *mesh, const double row[SLT_BOX_ROWS]) {
    return l->mesh == s->bvh && l->vertex == mesh->vertex && l->slack == s->slack &&
           !memcmp(l->row, row, sizeof l->row);
}

static const Last *ask(const BvhScene *s, const WalkMesh *mesh, BvhSearch *search, const void *rays, uint32_t width,
                       uint32_t lane, bool again) {
    Last *l = &last[lane % 64];
    double row[SLT_BOX_ROWS];
    for (uint32_t i = 0; i < SLT_BOX_ROWS; i++) row[i] = number(mesh->f64, rays, i, width, lane);
    if (again && is_last(l, s, mesh, row)) return l;
    Box b = {.scene = s, .mesh = mesh};
    *l = (Last){.mesh = s->bvh, .vertex = mesh->vertex, .slack = s->slack, .answer = SLT_RAYS_EITHER};
    memcpy(l->row, row, sizeof row);
    if (box_of(&b, rays, width, lane)) l->answer = decide(&b, search, &l->lines);
    return l;
}

void boxes_decide(const BvhScene *s, const WalkMesh *mesh, BvhSearch *search, const void *rays, uint64_t mask,
                  uint32_t width, int32_t *witness) {
    for (uint32_t k = 0; k < width; k++)
        witness[k] = mask >> k & 1 ? ask(s, mesh, search, rays, width, k, false)->answer : SLT_RAYS_EITHER;
}

void boxes_line(const BvhScene *s, const WalkMesh *mesh, BvhSearch *search, const void *rays, uint64_t mask,
                uint32_t width, int32_t *witness) {
    for (uint32_t k = 0; k < width; k++) {
        witness[k] = SLT_WITNESS_NONE;
        if (!(mask >> k & 1)) continue;
        const Last *l = ask(s, mesh, search, rays, width, k, true);
        const uint32_t which = (uint32_t)number(mesh->f64, rays, SLT_LINE_WHICH, width, k), n = which / 2;
        if (l->answer <= SLT_RAYS_EITHER || n >= l->lines.n) continue;
        witness[k] = which % 2 ? l->lines.line[n].b : l->lines.line[n].a;
    }
}
