/* One piece and one point light: the query, the window on the piece's plane, areas in the camera's window. */
#include "lit.h"
#include "light_inner.h"

#include <math.h>

#include "saltus/mesh.h"

#define MARGIN (1.0 / 64) /* of the window around the piece, so that its border is nobody's */

/* ---- places */

/* Of the camera's window. */
static OutlinePlace seen_at(const Lit *q, double u, double v) {
    double at[3];
    for (int i = 0; i < 3; i++) at[i] = q->to_camera[i][0] * u + q->to_camera[i][1] * v + q->to_camera[i][2];
    return (OutlinePlace){at[0] / at[2], at[1] / at[2]};
}

/* The point of the piece's plane, from the eye; false: it is not ahead. */
static bool point_under(const Lit *q, const OutlinePlace *p, double x[3]) {
    const OutlineBeam *b = q->piece.beam;
    for (int a = 0; a < 3; a++) x[a] = b->c[a] + p->s * b->u[a] + p->t * b->v[a];
    const double t = q->det / vec_dot(x, q->normal);
    for (int a = 0; a < 3; a++) x[a] *= t;
    return t > 0 && isfinite(t);
}

static double number(const Light *l, size_t at) {
    return l->f64 ? ((const double *)l->s->values)[at] : (double)((const float *)l->s->values)[at];
}

/* ---- the window */

typedef struct Bounds {
    double origin[3], axis[2][3], low[2], size[2]; /* origin from the eye */
} Bounds;

static void place_in(const Bounds *b, const double x[3], double at[2]) {
    double from[3];
    vec_minus(x, b->origin, from);
    for (int i = 0; i < 2; i++) at[i] = (vec_dot(from, b->axis[i]) - b->low[i]) / b->size[i];
}

/* Along the way to the corner that is farthest from the first, and across. height: of the plane from the light. */
static bool bounds_of(const Lit *q, double x[][3], double height, Bounds *b) {
    double most = 0, length = sqrt(vec_dot(q->normal, q->normal)), n[3] = {0}, low[2] = {0}, high[2] = {0};
    *b = (Bounds){.size = {1, 1}};
    memcpy(b->origin, x[0], sizeof b->origin);
    vec_add(n, 1 / length, q->normal);
    for (uint32_t k = 1; k < q->piece.ncorners; k++) {
        double way[3];
        vec_minus(x[k], x[0], way);
        const double far = vec_dot(way, way);
        if (far > most) most = far, memcpy(b->axis[0], way, sizeof way);
    }
    vec_add(b->axis[0], -vec_dot(b->axis[0], n), n);
    length = sqrt(vec_dot(b->axis[0], b->axis[0]));
    if (!(length > 0)) return false;
    for (int a = 0; a < 3; a++) b->axis[0][a] /= length;
    vec_cross(n, b->axis[0], b->axis[1]);
    for (int a = 0; a < 3 && height < 0; a++) b->axis[1][a] = -b->axis[1][a];
    for (uint32_t k = 1; k < q->piece.ncorners; k++) {
        double at[2];
        place_in(b, x[k], at);
        for (int i = 0; i < 2; i++) low[i] = light_min(low[i], at[i]), high[i] = light_max(high[i], at[i]);
    }
    for (int i = 0; i < 2; i++) {
        const double size = high[i] - low[i];
        b->low[i] = low[i] - MARGIN * size, b->size[i] = (1 + 2 * MARGIN) * size;
    }
    return b->size[0] > 0 && b->size[1] > 0;
}

static void set_window(Light *l, const Bounds *b) {
    Lit *q = l->lit;
    const OutlineBeam *beam = q->piece.beam;
    double inverse[3][3], first[3], product[3];
    memcpy(first, b->origin, sizeof first);
    for (int i = 0; i < 2; i++) vec_add(first, b->low[i], b->axis[i]);
    for (int a = 0; a < 3; a++) {
        l->u[a] = b->size[0] * b->axis[0][a], l->v[a] = b->size[1] * b->axis[1][a];
        l->c[a] = first[a] + q->eye[a];
    }
    vec_cross(beam->v, beam->c, inverse[0]);
    vec_cross(beam->c, beam->u, inverse[1]);
    vec_cross(beam->u, beam->v, inverse[2]);
    for (int i = 0; i < 3; i++) {
        q->to_camera[i][0] = vec_dot(l->u, inverse[i]), q->to_camera[i][1] = vec_dot(l->v, inverse[i]);
        q->to_camera[i][2] = vec_dot(first, inverse[i]);
    }
    vec_cross(l->u, l->v, product);
    const double det = vec_dot(l->c, product), *column[3] = {l->u, l->v, l->c};
    for (int k = 0; k < 3; k++) {
        vec_cross(column[(k + 1) % 3], column[(k + 2) % 3], l->row[k]);
        for (int a = 0; a < 3; a++) l->row[k][a] /= det;
    }
}

/* False: nothing of it is lit. */
static bool lit_set(Light *l, Lit *q, const double row[SLT_LIT_ROWS]) {
    double x[LIGHT_CORNERS][3], far = 0, way[2][3];
    Bounds bounds;
    if (q->piece.ncorners > LIGHT_KEPT) return false; /* never */
    l->own = q->piece.triangle;
    const double *eye = q->piece.beam->eye;
    const int32_t *face = l->s->tree.bvh->face + 3 * (size_t)l->own;
    for (int a = 0; a < 3; a++) {
        l->p[a] = row[SLT_LIT_LIGHT + a], q->eye[a] = eye[a] - l->p[a], far = fmax(far, fabs(l->p[a]));
        for (int k = 0; k < 3; k++) q->corner[k][a] = number(l, 3 * (size_t)face[k] + (size_t)a) - eye[a];
    }
    for (int k = 0; k < 2; k++) vec_minus(q->corner[k + 1], q->corner[0], way[k]);
    vec_cross(way[0], way[1], q->normal);
    q->det = vec_dot(q->corner[0], q->normal);
    for (uint32_t k = 0; k < q->piece.ncorners; k++)
        if (!point_under(q, &q->piece.corner[k], x[k])) return false;
    /* From the light to the plane: a light in it sees nothing of it, within rounding. */
    const double height =
        (q->det + vec_dot(q->eye, q->normal)) / sqrt(vec_dot(q->normal, q->normal)); /* (corner - light) . n */
    const double rounding = 0x1p-46 * (far + l->s->tree.bvh->magnitude);
    if (!(fabs(height) > rounding) || !bounds_of(q, x, height, &bounds)) return false;
    l->near = rounding, l->beyond = 1 - rounding / fabs(height), l->touches = true;
    set_window(l, &bounds);
    double twice = 0, at[LIGHT_CORNERS][2];
    const uint32_t n = q->polygon.n = q->piece.ncorners;
    for (uint32_t k = 0; k < n; k++) place_in(&bounds, x[k], at[k]);
    for (uint32_t k = 0; k < n; k++) twice += at[k][0] * at[(k + 1) % n][1] - at[k][1] * at[(k + 1) % n][0];
    q->turn = twice < 0 ? -1 : 1;
    for (uint32_t k = 0; k < n; k++) {
        const double *from = at[twice < 0 ? n - 1 - k : k];
        q->polygon.u[k] = from[0], q->polygon.v[k] = from[1];
    }
    return true;
}

/* ---- its sides */

/* Segments of the side of the polygon from corner k to the next, which is `side` of the piece: one of each part. */
static void add_parts(Light *l, uint32_t k, uint32_t side) {
    Lit *q = l->lit;
    Polygon *p = &q->polygon;
    const uint32_t next = k + 1 < p->n ? k + 1 : 0;
    const double du = p->u[next] - p->u[k], dv = p->v[next] - p->v[k], length = sqrt(du * du + dv * dv);
    uint32_t first = 0;
    p->side[k] = LINE_FIXED;
    while (first < q->piece.nparts && q->piece.part[first].side != side) first++;
    if (first == q->piece.nparts || !(length > 0)) return;
    uint32_t end = first;
    while (end < q->piece.nparts && q->piece.part[end].side == side) end++;
    p->side[k] = l->store->segment.n;
    for (uint32_t i = first; i < end; i++) {
        Segment s = {.g = {-dv / length, du / length, (dv * p->u[k] - du * p->v[k]) / length},
                     .kind = SEGMENT_PIECE,
                     .a = (int32_t)i,
                     .b = (int32_t)(end - 1 - i)};
        double along[2];
        for (int e = 0; e < 2; e++) {
            /* The inverse of seen_at, along the side. */
            const OutlinePlace *at = e ? &q->piece.part[i].to : &q->piece.part[i].from,
                               ends[2] = {seen_at(q, p->u[k], p->v[k]), seen_at(q, p->u[next], p->v[next])};
            double w[2], ds = ends[1].s - ends[0].s, dt = ends[1].t - ends[0].t;
            const double part = ((at->s - ends[0].s) * ds + (at->t - ends[0].t) * dt) / (ds * ds + dt * dt);
            for (int c = 0; c < 2; c++) {
                const uint32_t corner = c ? next : k;
                w[c] = q->to_camera[2][0] * p->u[corner] + q->to_camera[2][1] * p->v[corner] + q->to_camera[2][2];
            }
            const double there = part * w[0] / (part * w[0] + (1 - part) * w[1]), u = p->u[k] + there * du,
                         v = p->v[k] + there * dv;
            along[e] = s.g[0] * v - s.g[1] * u;
        }
        s.from = light_min(along[0], along[1]), s.to = light_max(along[0], along[1]);
        if (!ROW_ADD(l->store->segment, s)) l->lost = true;
    }
}

/* ---- sums (light_sum.c) */

void lit_add(Light *l, const Polygon *p) {
    const OutlinePlace first = seen_at(l->lit, p->u[0], p->v[0]);
    OutlinePlace last = seen_at(l->lit, p->u[1], p->v[1]);
    for (uint32_t k = 2; k < p->n; k++) {
        const OutlinePlace next = seen_at(l->lit, p->u[k], p->v[k]);
        const double twice = (last.s - first.s) * (next.t - first.t) - (last.t - first.t) * (next.s - first.s);
        l->lit->area += 0.5 * l->lit->turn * twice;
        last = next;
    }
}

void lit_add_side(const Light *l, const double from[2], const double to[2], double sign, double j[3]) {
    const OutlinePlace a = seen_at(l->lit, from[0], from[1]), b = seen_at(l->lit, to[0], to[1]);
    const double ds = b.s - a.s, dt = b.t - a.t, length = sign * sqrt(ds * ds + dt * dt);
    j[0] += length * 0.5 * (a.s + b.s), j[1] += length * 0.5 * (a.t + b.t), j[2] += length;
}

/* ---- the query */

static double whole_area(const Lit *q) {
    double twice = 0;
    const OutlinePlace *p = q->piece.corner;
    for (uint32_t k = 1; k + 1 < q->piece.ncorners; k++)
        twice += (p[k].s - p[0].s) * (p[k + 1].t - p[0].t) - (p[k].t - p[0].t) * (p[k + 1].s - p[0].s);
    return 0.5 * twice;
}

/* Triangles that hide nothing are asked no more. */
static void keep_hiding(Light *l) {
    LightStore *s = l->store;
    uint32_t n = 0;
    for (uint32_t i = 0; i < s->triangle.n; i++)
        if (light_hides_some(l, s->triangle.data[i])) s->triangle.data[n++] = s->triangle.data[i];
    s->triangle.n = n;
}

static int32_t answer(Light *l) {
    LightStore *s = l->store;
    Lit *q = l->lit;
    double head[SLT_LIGHT_EDGES * SLT_TOLD] = {0}, *slope = head + SLT_LIGHT_SLOPES;
    light_borders(l);
    for (uint32_t k = 0; k < q->polygon.n; k++)
        add_parts(l, k, q->turn < 0 ? (2 * q->polygon.n - 2 - k) % q->polygon.n : k);
    l->nborder = s->segment.n;
    light_gather(l, false);
    if (l->s->way != LIGHT_TRIANGLES && !l->lost) light_edges(l);
    if (!l->lost) keep_hiding(l);
    const bool facets = light_wants_triangles(l);
    if (facets) s->segment.n = l->nborder, light_facets(l);
    if (!l->lost) light_look(l, facets);
    if (!l->lost) light_shine(l);
    LitSlopes slopes = {0};
    if (!l->lost) lit_turn(l, &slopes);
    if (l->lost) return 0;
    head[SLT_LIGHT_VALUE] = light_max(0, light_min(q->area, whole_area(q)));
    head[SLT_LIGHT_COUNT] = s->edge.n;
    const double *row[] = {slopes.eye, slopes.corner, slopes.u, slopes.v, slopes.light};
    for (int k = 0; k < SLT_LIT_UNIT; k++) slope[k] = row[k / 3][k % 3];
    const int32_t unit = light_tell(l, head, s->edge.data, s->edge.n, 1);
    l->lost = !unit;
    return unit;
}

bool lit_find(const LightScene *s, const void *rays, uint64_t mask, uint32_t width, int32_t *witness) {
    static const double unknown[SLT_LIGHT_EDGES * SLT_TOLD] = {[SLT_LIGHT_VALUE] = NAN};
    const bool f64 = s->tree.bvh->f64;
    bool all = true;
    for (uint32_t k = 0; k < width; k++) {
        double row[SLT_LIT_ROWS];
        bool known = true;
        Lit q = {.area = 0};
        Light l = {.s = s, .store = light_store(), .lit = &q, .f64 = f64};
        witness[k] = 0;
        if (!(mask >> k & 1)) continue;
        for (size_t r = 0; r < SLT_LIT_ROWS; r++) {
            row[r] = f64 ? ((const double *)rays)[r * width + k] : (double)((const float *)rays)[r * width + k];
            known &= r < SLT_LIT_LIGHT || fabs(row[r]) <= 1e30;
        }
        if (!(row[SLT_LIT_UNIT] > 0)) continue; /* no piece */
        if (!l.store || !outline_find((uint32_t)row[SLT_LIT_UNIT], &q.piece)) {
            all = false;
            continue;
        }
        const double *light = row + SLT_LIT_LIGHT;
        if (outline_recall(&q.piece, light, &witness[k])) continue;
        if (!known) witness[k] = light_tell(&l, unknown, NULL, 0, 1), l.lost = !witness[k];
        else if (lit_set(&l, &q, row)) witness[k] = answer(&l);
        if (l.lost) all = false;
        else outline_remember(&q.piece, light, witness[k]);
    }
    return all;
}
