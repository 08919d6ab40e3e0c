/* Walks over faces along a family of rays.
 *
 * The edge from P to Q is met by the ray s where G(s) = d . ((P - o) x (Q - P)) is 0: a quadric in s, linear where the
 * rays have one origin. Inside a face the G of its edges have the sign of d . n. So a face is left where the first of
 * these falls, seen with that sign. */
#include "walk.h"

#include <math.h>
#include <string.h>

#include "saltus/mesh.h"
#include "saltus/query.h"

enum {
    MOST_STEPS = 1 << 14, /* of a walk; a pair further apart is bisected */
    MOST_TURNS = 256,     /* of these around one vertex */
    MOST_FLAT = 16        /* faces without area that are passed at one edge */
};
#define FLAT 1e-28      /* of such a face the square of the sine between its sides */
#define PARALLEL 1e-3   /* the sine between faces, below which they may lie on each other */
/* The sine of the angle below which a face is seen edge-on. */
#define EDGE_ON(f) ((f)->mesh->f64 ? 0x1p-40 : 0x1p-20)
/* Of equal t up to rounding, in parts of the greater: which face a ray meets was decided in the mesh's precision. */
#define SAME_DEPTH(f) ((f)->mesh->f64 ? 0x1p-40 : 0x1p-20)

/* The rays from one end of a pair to the other. */
typedef struct Family {
    const WalkMesh *mesh;
    double o[3], d[3], from_o[3], from_d[3]; /* o(s) = o + s from_o */
    double t0[2], t1[2];                     /* at s = 0 and 1 */
} Family;

/* A place on a surface: the ray s meets this face, which was entered over its edge `over`; -1: there it began. */
typedef struct Place {
    int32_t face;
    int over;
    double s;
} Place;

typedef struct Line {
    int32_t a, b; /* SLT_SIDE_A, SLT_SIDE_B of saltus/mesh.h, and the ends of rays */
} Line;

typedef enum Outcome { GOES_ON, ARRIVED, PARTED, LOST } Outcome;

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void cross(const double a[3], const double b[3], double out[3]) {
    out[0] = a[1] * b[2] - a[2] * b[1], out[1] = a[2] * b[0] - a[0] * b[2], out[2] = a[0] * b[1] - a[1] * b[0];
}

static void minus(const double a[3], const double b[3], double out[3]) {
    for (int i = 0; i < 3; i++) out[i] = a[i] - b[i];
}

static void ray_at(const Family *f, double s, double o[3], double d[3]) {
    for (int i = 0; i < 3; i++) o[i] = f->o[i] + s * f->from_o[i], d[i] = f->d[i] + s * f->from_d[i];
}

/* Ends of rays may be infinite. */
static double end_at(const double t[2], double s) { return t[0] == t[1] ? t[0] : t[0] + s * (t[1] - t[0]); }

static int32_t corner(const Family *f, int32_t face, int k) {
    return f->mesh->face[3 * (int64_t)face + (k >= 3 ? k - 3 : k)];
}

static void vertex(const Family *f, int32_t v, double out[3]) {
    for (int i = 0; i < 3; i++)
        out[i] = f->mesh->f64 ? ((const double *)f->mesh->vertex)[3 * (int64_t)v + i]
                              : (double)((const float *)f->mesh->vertex)[3 * (int64_t)v + i];
}

static void corners(const Family *f, int32_t face, double at[3][3]) {
    for (int k = 0; k < 3; k++) vertex(f, corner(f, face, k), at[k]);
}

/* t at which the ray s meets the face: between the t of its corners. */
static double t_at(const Family *f, int32_t face, double s) {
    double at[3][3], o[3], d[3], sum = 0, mean = 0, low = INFINITY, high = -INFINITY;
    corners(f, face, at);
    ray_at(f, s, o, d);
    for (int k = 0; k < 3; k++) minus(at[k], o, at[k]);
    for (int k = 0; k < 3; k++) {
        double n[3], t = dot(d, at[k]) / dot(d, d);
        cross(at[(k + 1) % 3], at[(k + 2) % 3], n);
        double e = dot(d, n);
        sum += e, mean += e * t, low = fmin(low, t), high = fmax(high, t);
    }
    return sum == 0 ? 0.5 * (low + high) : fmin(fmax(mean / sum, low), high);
}

/* Where sign * (c0 + c1 s + c2 s^2) falls through 0; INFINITY: nowhere. */
static double falls(const double c[3], double sign) {
    double c0 = sign * c[0], c1 = sign * c[1], c2 = sign * c[2];
    if (c2 == 0) return c1 < 0 ? -c0 / c1 : INFINITY;
    double disc = c1 * c1 - 4 * c2 * c0;
    if (!(disc > 0)) return INFINITY;
    /* At the root that falls the slope is -sqrt(disc). Where c1 has the other sign, the product of the roots tells. */
    double root = sqrt(disc);
    return c1 < 0 ? 2 * c0 / (root - c1) : (-c1 - root) / (2 * c2);
}

/* G of the edge from p to q, as a quadric in s. */
static void edge_quadric(const Family *f, const double p[3], const double q[3], double c[3]) {
    double along[3], from[3], n[3], dn[3];
    minus(q, p, along);
    minus(p, f->o, from);
    cross(from, along, n);
    cross(f->from_o, along, dn);
    c[0] = dot(f->d, n);
    c[1] = dot(f->from_d, n) - dot(f->d, dn);
    c[2] = -dot(f->from_d, dn);
}

/* The first s, from the place on, at which its face is left, and over which edge. */
static double leaves(const Family *f, const Place *at, int *over) {
    double p[3][3], c[3][3], o[3], d[3], u[3], v[3], n[3], first = INFINITY;
    corners(f, at->face, p);
    ray_at(f, at->s, o, d);
    minus(p[1], p[0], u), minus(p[2], p[0], v);
    cross(u, v, n);
    double sign = dot(d, n) < 0 ? -1 : 1;
    *over = -1;
    for (int k = 0; k < 3; k++) {
        edge_quadric(f, p[k], p[(k + 1) % 3], c[k]);
        double s = falls(c[k], sign);
        if (!(s > at->s)) {
            /* Rounding, at a corner: the place lies outside already. Not where it has come in. */
            double now = sign * (c[k][0] + at->s * (c[k][1] + at->s * c[k][2]));
            if (k == at->over || !(now < 0) || s == INFINITY) continue;
            s = at->s;
        }
        if (s < first) first = s, *over = k;
    }
    return first;
}

/* On which side of the plane of the ray s's origin and the edge from p to q is v? 0: in it, up to rounding, as a face
 * is that is seen edge-on. */
static double side_of(const Family *f, double s, int32_t p, int32_t q, int32_t v) {
    double at[3][3], o[3], d[3], along[3], away[3], n[3];
    ray_at(f, s, o, d);
    vertex(f, p, at[0]), vertex(f, q, at[1]), vertex(f, v, at[2]);
    minus(at[1], at[0], along), minus(at[2], at[0], away), minus(at[0], o, at[0]);
    cross(at[0], along, n);
    double side = dot(away, n);
    return fabs(side) <= EDGE_ON(f) * sqrt(dot(away, away) * dot(n, n)) ? 0 : side;
}

static bool is_flat(const Family *f, int32_t face) {
    double p[3][3], u[3], v[3], n[3];
    corners(f, face, p);
    minus(p[1], p[0], u), minus(p[2], p[0], v);
    cross(u, v, n);
    return dot(n, n) <= FLAT * dot(u, u) * dot(v, v);
}

/* A face without area was entered over edge k by the ray s: over which edge does it leave? */
static int leaves_flat(const Family *f, double s, int32_t face, int k) {
    double p[3][3], o[3], d[3], along[3], across[3], from[3], n[3], to[3];
    corners(f, face, p);
    ray_at(f, s, o, d);
    const double *a = p[k], *b = p[(k + 1) % 3], *apex = p[(k + 2) % 3];
    minus(b, a, along), minus(a, o, from), minus(apex, a, to);
    cross(along, d, across), cross(from, d, n);
    double here = -dot(n, across) / dot(across, across), there = dot(to, along) / dot(along, along);
    return (here < there ? k + 2 : k + 1) % 3;
}

static Line edge_line(const Family *f, int32_t face, int k) {
    int32_t p = corner(f, face, k), q = corner(f, face, k + 1);
    return p < q ? (Line){p, q} : (Line){q, p};
}

/* Do the two sides of an edge, that of face a and that of face b, lie at different places of a texture? */
static bool is_seam(const Family *f, int32_t a, int k, int32_t b, int over) {
    const int32_t *uv = f->mesh->face + (SLT_MESH_FACE + SLT_MESH_PART) * (size_t)f->mesh->adjacency->nfaces;
    const int each = SLT_MESH_UV / 3;
    for (int end = 0; end < 2; end++) {
        const int at = (k + end) % 3, same = corner(f, b, over) == corner(f, a, at) ? over : (over + 1) % 3;
        if (memcmp(uv + SLT_MESH_UV * (size_t)a + each * at, uv + SLT_MESH_UV * (size_t)b + each * same,
                   (size_t)each * sizeof *uv) != 0)
            return true;
    }
    return false;
}

/* Over edge k, which the ray at->s meets, to the face beyond. */
static Outcome pass(const Family *f, Place *at, int k, int edges, Line *line) {
    int32_t face = at->face, behind = corner(f, face, k + 2);
    for (int flat = 0; flat <= MOST_FLAT; flat++) {
        *line = edge_line(f, face, k);
        int32_t half = f->mesh->adjacency->across[3 * (int64_t)face + k];
        if (line->a == line->b) return LOST;
        if (half < 0 || edges == SLT_EDGES_ALL) return PARTED;
        int32_t next = half / 3;
        int over = half % 3;
        if (edges == SLT_EDGES_SEAMS && is_seam(f, face, k, next, over)) return PARTED;
        if (is_flat(f, next)) {
            face = next, k = leaves_flat(f, at->s, next, over);
            continue;
        }
        double from = side_of(f, at->s, line->a, line->b, behind),
               to = side_of(f, at->s, line->a, line->b, corner(f, next, over + 2));
        if (!((from < 0 && to > 0) || (from > 0 && to < 0))) return PARTED;
        at->face = next, at->over = over;
        return GOES_ON;
    }
    return LOST;
}

/* One face further, but not beyond `until`. edges: SLT_EDGES_* part, besides. */
static Outcome step(const Family *f, Place *at, double until, int edges, Line *line) {
    int k;
    double s = leaves(f, at, &k), to = s < until ? s : until;
    double t = t_at(f, at->face, to), t0 = end_at(f->t0, to), t1 = end_at(f->t1, to);
    if (t < t0 || t > t1) {
        double before = t_at(f, at->face, at->s),
               was = t < t0 ? end_at(f->t0, at->s) - before : before - end_at(f->t1, at->s),
               is = t < t0 ? t0 - t : t - t1;
        *line = t < t0 ? (Line){at->face, at->face} : (Line){at->face, ~at->face};
        at->s += (to - at->s) * (was < 0 ? was / (was - is) : 0);
        return PARTED;
    }
    at->s = to;
    return s < until ? pass(f, at, k, edges, line) : ARRIVED;
}

static Outcome walk(const Family *f, Place *at, double until, int edges, Line *line) {
    for (int steps = 0, turns = 0; steps < MOST_STEPS && turns < MOST_TURNS; steps++) {
        double s = at->s;
        Outcome o = step(f, at, until, edges, line);
        if (o != GOES_ON) return o;
        turns = at->s > s ? 0 : turns + 1;
    }
    return LOST;
}

static bool is_near(const Family *f, double t, double u) {
    return fabs(t - u) <= SAME_DEPTH(f) * fmax(fabs(t), fabs(u));
}

/* Where the walk arrives, but the ray there meets something else, or nothing: rounding has parted them, at the end of
 * the ray, or at the edge of the face that is nearest. */
static Outcome nearest(const Family *f, Place *at, int edges, Line *line) {
    const double t = t_at(f, at->face, at->s), t0 = end_at(f->t0, at->s), t1 = end_at(f->t1, at->s);
    if (is_near(f, t, t0) || is_near(f, t, t1)) {
        *line = is_near(f, t, t0) ? (Line){at->face, at->face} : (Line){at->face, ~at->face};
        return PARTED;
    }
    double p[3][3], c[3], along[3], least = INFINITY;
    int near = 0;
    corners(f, at->face, p);
    for (int k = 0; k < 3; k++) {
        edge_quadric(f, p[k], p[(k + 1) % 3], c);
        minus(p[(k + 1) % 3], p[k], along);
        double away = fabs(c[0] + at->s * (c[1] + at->s * c[2])) / sqrt(dot(along, along));
        if (away < least) least = away, near = k;
    }
    return pass(f, at, near, edges, line) == PARTED ? PARTED : LOST;
}

static bool same_depth(const Family *f, int32_t a, int32_t b, double s) {
    if (a == b) return true;
    return is_near(f, t_at(f, a, s), t_at(f, b, s));
}

static bool in_front(const Family *f, int32_t a, int32_t b, double s) {
    double t = t_at(f, a, s), u = t_at(f, b, s);
    return t < u - SAME_DEPTH(f) * fmax(fabs(t), fabs(u));
}

static Line crossing_line(int32_t a, int32_t b) { return a < b ? (Line){a, ~b} : (Line){b, ~a}; }

/* Two surfaces from one s on, a in front of b, until b is in front: the faces that cross. */
static Outcome find_crossing(const Family *f, Place a, Place b, double until, Line *line) {
    for (int steps = 0; steps < MOST_STEPS; steps++) {
        int ka, kb;
        Line unused;
        double sa = leaves(f, &a, &ka), sb = leaves(f, &b, &kb), s = fmin(fmin(sa, sb), until);
        if (in_front(f, b.face, a.face, s)) {
            *line = crossing_line(a.face, b.face);
            return PARTED;
        }
        if (s >= until) return LOST;
        a.s = b.s = s;
        if (pass(f, sa <= sb ? &a : &b, sa <= sb ? ka : kb, false, &unused) != GOES_ON) return LOST;
    }
    return LOST;
}

/* Two faces that one ray meets at the same depth: neighbours, or one lies on the other; else they cross there. */
static bool meet(const Family *f, int32_t a, int32_t b) {
    double p[3][3], u[3], v[3], n[2][3], c[3];
    const int32_t face[2] = {a, b};
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            if (corner(f, a, i) == corner(f, b, k)) return true;
    for (int i = 0; i < 2; i++) {
        corners(f, face[i], p);
        minus(p[1], p[0], u), minus(p[2], p[0], v);
        cross(u, v, n[i]);
    }
    cross(n[0], n[1], c);
    return dot(c, c) <= PARALLEL * PARALLEL * dot(n[0], n[0]) * dot(n[1], n[1]);
}

/* f: from the ray that meets face a to the one that meets face b, back: from that one; -1: nothing. */
static Outcome between(const Family *f, const Family *back, int32_t a, int32_t b, int edges, Line *line) {
    Place pa = {.face = a, .over = -1}, pb = {.face = b, .over = -1};
    if (a < 0 || b < 0) {
        Outcome o = a >= 0 ? walk(f, &pa, 1, edges, line) : walk(back, &pb, 1, edges, line);
        return o == ARRIVED ? nearest(a >= 0 ? f : back, a >= 0 ? &pa : &pb, edges, line) : o;
    }
    Outcome from_a = walk(f, &pa, 1, edges, line);
    if (from_a == LOST) return LOST;
    if (from_a == ARRIVED && same_depth(f, pa.face, b, 1)) {
        if (pa.face != b && !meet(f, pa.face, b)) return *line = crossing_line(pa.face, b), PARTED;
        return edges == SLT_EDGES_ALL ? nearest(f, &pa, edges, line) : ARRIVED;
    }
    double end = pa.s; /* up to here goes the surface of a, from `begin` on that of b */
    Line of_b;
    Outcome from_b = walk(back, &pb, 1 - end, edges, &of_b);
    if (from_a == PARTED && (from_b != ARRIVED || !in_front(f, pb.face, pa.face, end))) return PARTED;
    if (from_b == ARRIVED) from_b = walk(back, &pb, 1, edges, &of_b);
    if (from_b == ARRIVED && same_depth(f, a, pb.face, 0) && a != pb.face && !meet(f, a, pb.face))
        return *line = crossing_line(a, pb.face), PARTED;
    if (from_b == LOST || (from_b == ARRIVED && same_depth(f, a, pb.face, 0))) return from_b;
    double begin = from_b == ARRIVED ? 0 : 1 - pb.s;
    pa = (Place){.face = a, .over = -1};
    if (from_b == PARTED) {
        Outcome again = walk(f, &pa, begin, edges, line);
        *line = of_b;
        if (again != ARRIVED || !in_front(f, pa.face, pb.face, begin)) return PARTED;
    }
    return find_crossing(f, (Place){pa.face, -1, begin}, (Place){pb.face, -1, begin}, end, line);
}

static Family reversed(const Family *f) {
    Family r = *f;
    ray_at(f, 1, r.o, r.d);
    for (int i = 0; i < 3; i++) r.from_o[i] = f->o[i] - r.o[i], r.from_d[i] = f->d[i] - r.d[i];
    for (int k = 0; k < 2; k++) r.t0[k] = f->t0[1 - k], r.t1[k] = f->t1[1 - k];
    return r;
}

static double number(const WalkMesh *m, const void *rays, uint32_t row, uint32_t width, uint32_t lane) {
    size_t i = (size_t)row * width + lane;
    return m->f64 ? ((const double *)rays)[i] : (double)((const float *)rays)[i];
}

/* Does the ray of the pair come behind its partner? Both lanes must go the same way. */
static bool is_second(const double ray[SLT_PAIR_ROWS]) {
    for (int i = 0; i < SLT_RAY_POINT_ROWS; i++)
        if (ray[i] != ray[SLT_PAIR_OTHER + i]) return ray[i] > ray[SLT_PAIR_OTHER + i];
    return false;
}

static int32_t answer(const WalkMesh *m, const double row[SLT_PAIR_ROWS]) {
    bool second = is_second(row);
    const double *one = row + (second ? SLT_PAIR_OTHER : 0), *two = row + (second ? 0 : SLT_PAIR_OTHER);
    Family f = {.mesh = m};
    for (int i = 0; i < 3; i++) {
        f.o[i] = one[i], f.d[i] = one[3 + i];
        f.from_o[i] = two[i] - one[i], f.from_d[i] = two[3 + i] - one[3 + i];
        if (!isfinite(f.from_o[i]) || !isfinite(f.from_d[i])) return SLT_BETWEEN_LOST;
    }
    f.t0[0] = one[SLT_RAY_T0], f.t0[1] = two[SLT_RAY_T0], f.t1[0] = one[SLT_RAY_T1], f.t1[1] = two[SLT_RAY_T1];
    const Family back = reversed(&f);
    int32_t a = (int32_t)row[second ? SLT_PAIR_OTHER_FACE : SLT_PAIR_FACE],
            b = (int32_t)row[second ? SLT_PAIR_FACE : SLT_PAIR_OTHER_FACE];
    if (a == b) return SLT_WITNESS_NONE;
    Line line = {0};
    Outcome o = between(&f, &back, a, b, (int)row[SLT_PAIR_EDGES], &line);
    if (o != PARTED) return o == ARRIVED ? SLT_WITNESS_NONE : SLT_BETWEEN_LOST;
    return row[SLT_PAIR_WHICH] != 0 ? line.b : line.a;
}

/* Is lane k the partner of the lane before it? */
static bool is_partner(const WalkMesh *m, const void *rays, uint32_t width, uint32_t k) {
    for (uint32_t i = 0; i < SLT_PAIR_OTHER; i++)
        if (number(m, rays, i, width, k) != number(m, rays, SLT_PAIR_OTHER + i, width, k - 1) ||
            number(m, rays, i, width, k - 1) != number(m, rays, SLT_PAIR_OTHER + i, width, k))
            return false;
    return number(m, rays, SLT_PAIR_FACE, width, k) == number(m, rays, SLT_PAIR_OTHER_FACE, width, k - 1) &&
           number(m, rays, SLT_PAIR_FACE, width, k - 1) == number(m, rays, SLT_PAIR_OTHER_FACE, width, k);
}

void walk_between(const WalkMesh *m, const void *rays, uint64_t mask, uint32_t width, int32_t *witness) {
    for (uint32_t k = 0; k < width; k++) {
        witness[k] = SLT_WITNESS_NONE;
        if (!(mask >> k & 1)) continue;
        if (k % 2 && mask >> (k - 1) & 1 && is_partner(m, rays, width, k)) {
            witness[k] = witness[k - 1];
            continue;
        }
        double row[SLT_PAIR_ROWS];
        for (uint32_t i = 0; i < SLT_PAIR_ROWS; i++) row[i] = number(m, rays, i, width, k);
        witness[k] = answer(m, row);
    }
}
