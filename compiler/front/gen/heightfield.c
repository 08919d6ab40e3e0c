/* Heightfields: heights are parameters, so `height`, `gradient` and `normal` are ordinary operations.
 *
 * A witness (saltus/heightfield.h) names a triangle or an edge of the grid; the evaluation is arithmetic on that
 * triangle's plane, in grid space, differentiable in the three heights and in the ray. An edge stays the edge on which
 * the ray is nearest to the ground, while the point of contact slides along it.
 *
 * Under [Disc], `trace` and `occluded` are sites whose g is the clearance over a window of the ray (OP_window), the
 * same for both ends of a segment. */
#include <math.h>

#include "compiler/front/gen/geometry.h"
#include "saltus/heightfield.h"

typedef struct Terrain {
    const Symbol *sym;
    uint32_t w, h;
    double x0, y0, dx, dy, scale, offset; /* dx, dy: sizes of a cell */
    double band;                          /* raw height of one cell's size */
} Terrain;

static Terrain terrain(const Symbol *sym) {
    const ParamAttrs *a = &sym->attrs;
    double e[4] = {0, 0, 1, 1};
    if (a->has_extent)
        for (int i = 0; i < 4; i++) e[i] = a->extent[i];
    Terrain t = {.sym = sym,
                 .w = sym->tex_w,
                 .h = sym->tex_h,
                 .x0 = e[0],
                 .y0 = e[1],
                 .scale = a->has_height ? a->height_scale : 1,
                 .offset = a->has_height ? a->height_offset : 0};
    t.dx = (e[2] - e[0]) / (t.w > 1 ? t.w - 1 : 1);
    t.dy = (e[3] - e[1]) / (t.h > 1 ? t.h - 1 : 1);
    t.band = (t.dx < t.dy ? t.dx : t.dy) / t.scale;
    return t;
}

static Inst *add(Lower *l, Inst *a, Inst *b) { return op2(l, OP_fadd, a, b); }
static Inst *sub(Lower *l, Inst *a, Inst *b) { return op2(l, OP_fsub, a, b); }
static Inst *mul(Lower *l, Inst *a, Inst *b) { return op2(l, OP_fmul, a, b); }

/* Sample (i, j), both inside and j counted upwards, as it is stored: row 0 of the data is the largest y. */
static Inst *raw_at(Lower *l, const Terrain *t, Inst *i, Inst *j) {
    Inst *row = op2(l, OP_isub, ki(l, (int64_t)t->h - 1), j);
    return param_float(l, t->sym, 0, op2(l, OP_iadd, op2(l, OP_imul, row, ki(l, t->w)), i), t->w * t->h - 1);
}

/* In height units of the world. */
static Inst *height_at(Lower *l, const Terrain *t, Inst *i, Inst *j) {
    Inst *h = raw_at(l, t, i, j);
    if (t->scale != 1) h = mul(l, h, kf(l, t->scale));
    return t->offset != 0 ? add(l, h, kf(l, t->offset)) : h;
}

typedef struct Cell {
    Inst *i0, *i1, *j0, *j1; /* corners */
    Inst *u, *v;             /* in [0, 1] */
    Inst *lower;             /* u + v <= 1: the triangle at (0,0), cut off by the diagonal (1,0)-(0,1) */
} Cell;

/* The two samples around `at` (in cells) and the weight u of the second. */
static void cell_axis(Lower *l, Inst *at, uint32_t n, Inst **i0, Inst **i1, Inst **u) {
    at = op2(l, OP_fmin, op2(l, OP_fmax, at, kf(l, 0)), kf(l, (double)n - 1)); /* outside: the edge */
    Inst *base = op2(l, OP_fmin, op1(l, OP_ffloor, at), kf(l, n > 1 ? (double)n - 2 : 0));
    *u = op2(l, OP_fsub, at, base);
    *i0 = op1(l, OP_f2i, base);
    *i1 = op2(l, OP_imin, op2(l, OP_iadd, *i0, ki(l, 1)), ki(l, (int64_t)n - 1));
}

static Cell cell_at(Lower *l, const Terrain *t, Inst *x, Inst *y) {
    Cell c;
    cell_axis(l, x, t->w, &c.i0, &c.i1, &c.u);
    cell_axis(l, y, t->h, &c.j0, &c.j1, &c.v);
    c.lower = op2(l, OP_fle, op2(l, OP_fadd, c.u, c.v), kf(l, 1));
    return c;
}

static Inst *to_grid(Lower *l, Inst *p, double lo, double d) { return op2(l, OP_fdiv, sub(l, p, kf(l, lo)), kf(l, d)); }

static Cell cell(Lower *l, const Terrain *t, Inst *x, Inst *y) {
    return cell_at(l, t, to_grid(l, x, t->x0, t->dx), to_grid(l, y, t->y0, t->dy));
}

/* Linear interpolation of corner values on the cell's two triangles. */
static Inst *on_cell(Lower *l, const Cell *c, Inst *a00, Inst *a10, Inst *a01, Inst *a11) {
    Inst *low = op2(l, OP_fadd, op2(l, OP_fadd, a00, op2(l, OP_fmul, c->u, op2(l, OP_fsub, a10, a00))),
                    op2(l, OP_fmul, c->v, op2(l, OP_fsub, a01, a00)));
    Inst *ru = op2(l, OP_fsub, kf(l, 1), c->u), *rv = op2(l, OP_fsub, kf(l, 1), c->v);
    Inst *high = op2(l, OP_fadd, op2(l, OP_fadd, a11, op2(l, OP_fmul, ru, op2(l, OP_fsub, a01, a11))),
                     op2(l, OP_fmul, rv, op2(l, OP_fsub, a10, a11)));
    return sel(l, c->lower, low, high);
}

/* Slope at a sample by central differences, one-sided at the edge. */
static void slope_at(Lower *l, const Terrain *t, Inst *i, Inst *j, Inst **sx, Inst **sy) {
    Inst *im = op2(l, OP_imax, op2(l, OP_isub, i, ki(l, 1)), ki(l, 0)),
         *ip = op2(l, OP_imin, op2(l, OP_iadd, i, ki(l, 1)), ki(l, (int64_t)t->w - 1));
    Inst *jm = op2(l, OP_imax, op2(l, OP_isub, j, ki(l, 1)), ki(l, 0)),
         *jp = op2(l, OP_imin, op2(l, OP_iadd, j, ki(l, 1)), ki(l, (int64_t)t->h - 1));
    Inst *one = ki(l, 1);
    Inst *wx = op2(l, OP_fmul, op1(l, OP_i2f, op2(l, OP_imax, op2(l, OP_isub, ip, im), one)), kf(l, t->dx));
    Inst *wy = op2(l, OP_fmul, op1(l, OP_i2f, op2(l, OP_imax, op2(l, OP_isub, jp, jm), one)), kf(l, t->dy));
    *sx = op2(l, OP_fdiv, op2(l, OP_fsub, height_at(l, t, ip, j), height_at(l, t, im, j)), wx);
    *sy = op2(l, OP_fdiv, op2(l, OP_fsub, height_at(l, t, i, jp), height_at(l, t, i, jm)), wy);
}

static void normal_at(Lower *l, const Terrain *t, Inst *px, Inst *py, Inst *out[3]) {
    Cell c = cell(l, t, px, py);
    Inst *x[4], *y[4];
    slope_at(l, t, c.i0, c.j0, &x[0], &y[0]);
    slope_at(l, t, c.i1, c.j0, &x[1], &y[1]);
    slope_at(l, t, c.i0, c.j1, &x[2], &y[2]);
    slope_at(l, t, c.i1, c.j1, &x[3], &y[3]);
    Inst *n[3] = {op1(l, OP_fneg, on_cell(l, &c, x[0], x[1], x[2], x[3])),
                  op1(l, OP_fneg, on_cell(l, &c, y[0], y[1], y[2], y[3])), kf(l, 1)};
    Inst *inv = op2(l, OP_fdiv, kf(l, 1), op1(l, OP_fsqrt, dot_n(l, n, n, 3)));
    for (uint32_t i = 0; i < 3; i++) out[i] = mul(l, n[i], inv);
}

static Val lookup(Lower *l, Expr *e, const Terrain *t) {
    Val p = gen_expr(l, e->args[0]), v = val_new(l, e->type);
    if (e->method == M_NORMAL) {
        normal_at(l, t, p.c[0], p.c[1], v.c);
        return v;
    }
    Cell c = cell(l, t, p.c[0], p.c[1]);
    Inst *a00 = height_at(l, t, c.i0, c.j0), *a10 = height_at(l, t, c.i1, c.j0);
    Inst *a01 = height_at(l, t, c.i0, c.j1), *a11 = height_at(l, t, c.i1, c.j1);
    if (e->method == M_HEIGHT) {
        v.c[0] = on_cell(l, &c, a00, a10, a01, a11);
        vec_push(l->arena, &l->surfaces, ((Surface){t->sym, v.c[0], p.c[0], p.c[1]}));
        return v;
    }
    v.c[0] = op2(l, OP_fdiv, sel(l, c.lower, sub(l, a10, a00), sub(l, a11, a01)), kf(l, t->dx));
    v.c[1] = op2(l, OP_fdiv, sel(l, c.lower, sub(l, a01, a00), sub(l, a11, a10)), kf(l, t->dy));
    /* The gradient is constant on each triangle and jumps on the edges of the grid, which move with p. */
    for (uint32_t i = 0; i < 2; i++) site_untracked(l, v.c[i], p.c[0], p.c[1], e->span, JUMP_ALWAYS);
    return v;
}

/* ---- rays, in grid space: a cell is 1 x 1, heights are as stored; t is the same as in the world */

static Inst *query(Lower *l, const Terrain *t, SltQuery what, const Ray *r) {
    return gen_query(l, (Searched){t->sym, t->band}, what, r);
}

/* The plane of a triangle: height hc + gx (x - ci) + gy (y - cj). */
typedef struct Plane {
    Inst *ci, *cj, *hc, *gx, *gy;
} Plane;

static Plane plane(Lower *l, const Terrain *t, Inst *i, Inst *j, Inst *upper) {
    Inst *one = ki(l, 1), *i1 = op2(l, OP_imin, op2(l, OP_iadd, i, one), ki(l, (int64_t)t->w - 1)),
         *j1 = op2(l, OP_imin, op2(l, OP_iadd, j, one), ki(l, (int64_t)t->h - 1));
    Inst *ci = sel(l, upper, i1, i), *cj = sel(l, upper, j1, j);
    Inst *c = raw_at(l, t, ci, cj), *b = raw_at(l, t, i1, j), *d = raw_at(l, t, i, j1);
    return (Plane){op1(l, OP_i2f, ci), op1(l, OP_i2f, cj), c, sel(l, upper, sub(l, c, d), sub(l, b, c)),
                   sel(l, upper, sub(l, c, b), sub(l, d, c))};
}

static Inst *plane_height(Lower *l, const Plane *p, Inst *x, Inst *y) {
    return add(l, add(l, p->hc, mul(l, p->gx, sub(l, x, p->ci))), mul(l, p->gy, sub(l, y, p->cj)));
}

/* number = j * w + i */
static void split(Lower *l, const Terrain *t, Inst *number, Inst **i, Inst **j) {
    Inst *n = op2(l, OP_imin, number, ki(l, (int64_t)t->w * t->h - 1));
    range_set(l, n, 0, (int64_t)t->w * t->h - 1);
    *j = op2(l, OP_idiv, n, ki(l, t->w));
    *i = op2(l, OP_isub, n, op2(l, OP_imul, *j, ki(l, t->w)));
    range_set(l, *j, 0, (int64_t)t->h - 1);
    range_set(l, *i, 0, (int64_t)t->w - 1);
}

static Inst *not_negative(Lower *l, Inst *id) { return op2(l, OP_imax, id, ki(l, 0)); }

/* What an evaluation finds. */
typedef struct Contact {
    Inst *t, *ground; /* ground: raw height of the terrain there; NULL for a hit, where the ray has this height */
} Contact;

/* t where a ray meets the triangle (or the wall) that TRACE named; something finite where it named none. */
static Contact hit(Lower *l, const Terrain *t, const Ray *r, Inst *id) {
    Inst *tri = not_negative(l, id), *i, *j;
    split(l, t, op2(l, OP_ushr, tri, ki(l, 1)), &i, &j);
    Plane p = plane(l, t, i, j, op2(l, OP_ine, op2(l, OP_iand, tri, ki(l, 1)), ki(l, 0)));
    Inst *num = sub(l, plane_height(l, &p, r->x, r->y), r->z);
    Inst *den = sub(l, sub(l, r->dz, mul(l, p.gx, r->dx)), mul(l, p.gy, r->dy));
    /* Walls: x = 0, x = w - 1, y = 0, y = h - 1. */
    Inst *flat = op2(l, OP_ile, ki(l, 0), id), *along_x = op2(l, OP_ile, ki(l, SLT_HEIGHTFIELD_WALL - 1), id);
    Inst *at = sel(l, gen_is(l, id, SLT_HEIGHTFIELD_WALL - 1), kf(l, (double)t->w - 1),
                   sel(l, gen_is(l, id, SLT_HEIGHTFIELD_WALL - 3), kf(l, (double)t->h - 1), kf(l, 0)));
    num = sel(l, flat, num, sub(l, at, sel(l, along_x, r->x, r->y)));
    den = sel(l, flat, den, sel(l, along_x, r->dx, r->dy));
    Inst *found = op2(l, OP_fdiv, num, sel(l, gen_is(l, id, SLT_WITNESS_NONE), kf(l, 1), den));
    return (Contact){sel(l, gen_is(l, id, SLT_WITNESS_AT_T0), r->t0, found), NULL};
}

/* An edge, and where along the ray its line is crossed. */
typedef struct Edge {
    Inst *i, *j, *fi, *fj; /* the vertex that its number names, fi and fj as floats */
    Inst *k0, *k1;         /* of kind 0, of kind 1 */
    Inst *t;
} Edge;

static Edge edge_of(Lower *l, const Terrain *t, const Ray *r, Inst *id) {
    Inst *number = not_negative(l, id), *kind = op2(l, OP_iand, number, ki(l, 3));
    Edge e;
    split(l, t, op2(l, OP_ushr, number, ki(l, 2)), &e.i, &e.j);
    e.k0 = gen_is(l, kind, 0), e.k1 = gen_is(l, kind, 1);
    e.fi = op1(l, OP_i2f, e.i), e.fj = op1(l, OP_i2f, e.j);
    Inst *diagonal = sub(l, add(l, add(l, e.fi, e.fj), kf(l, 1)), add(l, r->x, r->y));
    Inst *num = sel(l, e.k0, sub(l, e.fj, r->y), sel(l, e.k1, sub(l, e.fi, r->x), diagonal));
    Inst *den = sel(l, e.k0, r->dy, sel(l, e.k1, r->dx, add(l, r->dx, r->dy)));
    e.t = mul(l, num, op2(l, OP_fdiv, kf(l, 1), sel(l, op2(l, OP_ile, ki(l, 0), id), den, kf(l, 1))));
    return e;
}

/* The top of a silhouette: the point of the edge itself, in the order of operations of the search (leaf_test in
 * runtime/geometry/heightfield/leaf.h): a walk from silhouette to silhouette asks above the slope it was given, and
 * must not find the same one again. tests/heightfield/test_contact.c compares the bits of the two. */
static Contact peak(Lower *l, const Terrain *t, const Ray *r, Inst *id) {
    Edge e = edge_of(l, t, r, id);
    Inst *one = ki(l, 1), *i1 = op2(l, OP_imin, op2(l, OP_iadd, e.i, one), ki(l, (int64_t)t->w - 1)),
         *j1 = op2(l, OP_imin, op2(l, OP_iadd, e.j, one), ki(l, (int64_t)t->h - 1));
    Inst *x = add(l, r->x, mul(l, e.t, r->dx)), *y = add(l, r->y, mul(l, e.t, r->dy));
    Inst *a = raw_at(l, t, e.i, sel(l, op2(l, OP_bor, e.k0, e.k1), e.j, j1)),
         *b = raw_at(l, t, sel(l, e.k1, e.i, i1), sel(l, e.k1, j1, e.j));
    return (Contact){e.t, add(l, a, mul(l, sel(l, e.k1, sub(l, y, e.fj), sub(l, x, e.fi)), sub(l, b, a)))};
}

/* Where the ray is nearest to the ground: on an edge, measured above the plane of the edge's lower triangle (as the ray
 * moves, the point of contact slides along the edge), or at an end of the ray, above the triangle there. */
static Contact nearest(Lower *l, const Terrain *t, const Ray *r, Inst *id) {
    Edge e = edge_of(l, t, r, id);
    Inst *end = op2(l, OP_ilt, id, ki(l, 0));
    Inst *at = sel(l, end, sel(l, gen_is(l, id, SLT_WITNESS_AT_T1), r->t1, r->t0), e.t);
    Cell c = cell_at(l, t, add(l, r->x, mul(l, at, r->dx)), add(l, r->y, mul(l, at, r->dy)));
    Inst *i = sel(l, end, c.i0, e.i), *j = sel(l, end, c.j0, e.j);
    range_set(l, i, 0, (int64_t)t->w - 1);
    range_set(l, j, 0, (int64_t)t->h - 1);
    Inst *upper = op2(l, OP_band, end, op1(l, OP_bnot, c.lower));
    Plane p = plane(l, t, i, j, upper);
    return (Contact){at, plane_height(l, &p, add(l, r->x, mul(l, at, r->dx)), add(l, r->y, mul(l, at, r->dy)))};
}

static Contact evaluate(Lower *l, const Terrain *t, SltQuery what, const Ray *r, Inst *id) {
    switch (query_rows[what].evaluation) {
    case EVALUATE_HIT: return hit(l, t, r, id);
    case EVALUATE_NEAREST: return nearest(l, t, r, id);
    case EVALUATE_PEAK: return peak(l, t, r, id);
    case EVALUATE_NOTHING: break;
    }
    return (Contact){0};
}

/* Least (ray - terrain) / t over [t0, t1], in raw heights; t0 > 0. */
static Inst *clearance(Lower *l, const Terrain *t, const Ray *ray, Inst **search) {
    Ray r = *ray;
    r.t0 = op2(l, OP_fmax, r.t0, kf(l, 0x1p-40));
    Inst *id = *search = query(l, t, SLT_QUERY_CLEARANCE, &r);
    Contact c = evaluate(l, t, SLT_QUERY_CLEARANCE, &r, id);
    Inst *none = gen_is(l, id, SLT_WITNESS_NONE);
    Inst *over = sub(l, add(l, r.z, mul(l, c.t, r.dz)), c.ground);
    return sel(l, none, kf(l, __builtin_inf()), op2(l, OP_fdiv, over, sel(l, none, kf(l, 1), c.t)));
}

/* The t in which a ray covers one cell's length, in three dimensions. */
static Inst *cell_time(Lower *l, const Terrain *t, const Ray *r) {
    Inst *steep = mul(l, r->dz, kf(l, 1 / t->band)),
         *length = add(l, add(l, mul(l, r->dx, r->dx), mul(l, r->dy, r->dy)), mul(l, steep, steep));
    return op1(l, OP_detach, op2(l, OP_fdiv, kf(l, 1), op1(l, OP_fsqrt, length)));
}

/* How much of t the ray lacks to touch the box: negative inside. The walls below the rim end at the corners of the box,
 * where nothing else is 0. A ray along a wall (parallel rays straight down, or along an axis) passes the box at full
 * length however little it is inside, so there it is the distance to the wall, in the time of a cell. */
static Inst *box_gap(Lower *l, const Terrain *t, const Ray *r, Inst *cell) {
    Inst *from = r->t0, *to = r->t1, *beside = kf(l, -__builtin_inf());
    Inst *o[2] = {r->x, r->y}, *d[2] = {r->dx, r->dy};
    for (int i = 0; i < 2; i++) {
        Inst *low = op1(l, OP_fneg, o[i]), *high = sub(l, kf(l, (i ? t->h : t->w) - 1.0), o[i]);
        Inst *along = op2(l, OP_flt, mul(l, op1(l, OP_fabs, d[i]), cell), kf(l, 0x1p-21)),
             *den = sel(l, along, kf(l, 1), d[i]);
        Inst *a = op2(l, OP_fdiv, low, den), *b = op2(l, OP_fdiv, high, den);
        from = sel(l, along, from, op2(l, OP_fmax, from, op2(l, OP_fmin, a, b)));
        to = sel(l, along, to, op2(l, OP_fmin, to, op2(l, OP_fmax, a, b)));
        Inst *out = mul(l, op2(l, OP_fmax, low, op1(l, OP_fneg, high)), cell);
        beside = sel(l, along, op2(l, OP_fmax, beside, out), beside);
    }
    return op2(l, OP_fmax, sub(l, from, to), beside);
}

/* The site of a ray that is blocked at t: hit, with the clearance of the pair's window as g. */
static Inst *ray_site(Lower *l, const Terrain *t, const Ray *r, SiteKind kind, Inst *hit, Inst *at, Span span) {
    Inst *far = kf(l, __builtin_inf());
    Ray behind = *r;
    behind.t0 = sel(l, hit, at, far);
    Inst *id = query(l, t, SLT_QUERY_RISE, &behind);
    Contact crest = evaluate(l, t, SLT_QUERY_RISE, &behind, id);
    Inst *top = sel(l, op2(l, OP_ile, ki(l, 0), id), crest.t, sel(l, gen_is(l, id, SLT_WITNESS_AT_T0), behind.t0, far));
    /* The t in which the ray crosses one cell, seen from above. */
    Inst *margin = op2(l, OP_fdiv, kf(l, 1), op1(l, OP_fsqrt, add(l, mul(l, r->dx, r->dx), mul(l, r->dy, r->dy))));
    Inst *pair[3] = {behind.t0, top, margin};
    int64_t site = l->sites.len;
    Inst *lo = special(l, OP_window, TY_FLT, 3, pair, (Imm){.i = 2 * site}),
         *hi = special(l, OP_window, TY_FLT, 3, pair, (Imm){.i = 2 * site + 1});
    /* t is counted from a cell's length (in three dimensions) behind the origin: (ray - terrain) / t has the same sign
     * there, and t0 may be 0. */
    Inst *back = cell_time(l, t, r);
    Ray window = {.x = sub(l, r->x, mul(l, back, r->dx)),
                  .y = sub(l, r->y, mul(l, back, r->dy)),
                  .z = sub(l, r->z, mul(l, back, r->dz)),
                  .dx = r->dx,
                  .dy = r->dy,
                  .dz = r->dz,
                  .t0 = add(l, op2(l, OP_fmax, r->t0, lo), back),
                  .t1 = add(l, op2(l, OP_fmin, r->t1, hi), back)};
    Clearance c = {.cell = back};
    c.value = clearance(l, t, &window, &c.search);
    c.gap = box_gap(l, t, r, back);
    return site_ray(l, kind, hit, gen_clearance_bounded(l, c.value, &c), span);
}

/* ---- how high rays start above the terrain: bounds of rays (SLT_QUERY_BLOCKED) need it, for the interval of an
 * origin's height says nothing of the ground right below */

static bool is_ground(const Lower *l, const Terrain *t, const Inst *z, const Val *o) {
    for (uint32_t i = 0; i < l->surfaces.len; i++) {
        const Surface *s = &l->surfaces.data[i];
        if (s->height == z && s->sym == t->sym && s->x == o->c[0] && s->y == o->c[1]) return true;
    }
    return false;
}

enum { LIFT_TERMS = 8 };

/* z is the height of the ground at o, plus *lift (of which *size is the sum of magnitudes): looked for through sums. */
static bool over_ground(Lower *l, const Terrain *t, Inst *z, const Val *o, Inst **lift, Inst **size, int depth) {
    if (is_ground(l, t, z, o)) {
        *lift = *size = kf(l, 0);
        return true;
    }
    if (depth == LIFT_TERMS || (z->op != OP_fadd && z->op != OP_fsub)) return false;
    for (int side = 0; side < (z->op == OP_fadd ? 2 : 1); side++) {
        if (!over_ground(l, t, z->args[side], o, lift, size, depth + 1)) continue;
        *lift = op2(l, (Op)z->op, *lift, z->args[1 - side]);
        *size = add(l, *size, op1(l, OP_fabs, z->args[1 - side]));
        return true;
    }
    return false;
}

static void find_lift(Lower *l, const Terrain *t, Ray *r, const Val *o) {
    Inst *lift, *size;
    if (!over_ground(l, t, o->c[2], o, &lift, &size, 0)) return;
    Inst *scale = kf(l, t->scale);
    r->lift = op2(l, OP_fdiv, lift, scale);
    r->lift_of = op2(l, OP_fdiv, add(l, size, kf(l, fabs(t->offset))), scale);
}

static Val trace(Lower *l, Expr *e, const Terrain *t, const Ray *r, const Val *o, const Val *d) {
    Val v = val_new(l, e->type);
    Inst *id = query(l, t, SLT_QUERY_TRACE, r), *hit = gen_found(l, id);
    Inst *at = evaluate(l, t, SLT_QUERY_TRACE, r, id).t;
    if (site_wanted(l, hit, at, e->span, JUMP_BUILTIN))
        hit = ray_site(l, t, r, gen_site_kind(SLT_QUERY_TRACE), hit, at, e->span);
    /* A miss is at tmax, and its p and normal are those of the origin: finite whatever tmax is. */
    Inst *to = sel(l, hit, at, kf(l, 0));
    v.c[0] = hit;
    v.c[1] = sel(l, hit, at, r->t1);
    for (int i = 0; i < 2; i++) v.c[2 + i] = add(l, o->c[i], mul(l, to, d->c[i]));
    normal_at(l, t, v.c[2], v.c[3], v.c + 4);
    return v;
}

static Val silhouette(Lower *l, Expr *e, const Terrain *t, Ray r) {
    Val v = val_new(l, e->type);
    Inst *scale = kf(l, t->scale), *kmax = r.t1;
    r.t0 = op2(l, OP_fdiv, r.t0, scale);
    r.t1 = op2(l, OP_fdiv, r.t1, scale);
    Inst *id = query(l, t, SLT_QUERY_SILHOUETTE, &r), *found = gen_found(l, id);
    Contact c = evaluate(l, t, SLT_QUERY_SILHOUETTE, &r, id);
    Inst *slope = op2(l, OP_fdiv, mul(l, sub(l, c.ground, r.z), scale), sel(l, found, c.t, kf(l, 1)));
    v.c[0] = found;
    v.c[1] = sel(l, found, c.t, kf(l, __builtin_inf()));
    v.c[2] = sel(l, found, slope, kmax);
    site_untracked(l, id, slope, NULL, e->span, JUMP_ALWAYS);
    return v;
}

Val gen_heightfield(Lower *l, Expr *e, const Symbol *sym) {
    Terrain t = terrain(sym);
    const MethodInfo *method = &methods[e->method];
    if (method->query == SLT_QUERIES) return lookup(l, e, &t);
    if (!(t.scale > 0) || l->quiet) {
        diag_emit(l->s, DIAG_geometry_query, e->span, method->name, sym->type->name,
                  l->quiet ? "is asked by the shader itself, not by bounds and initial values"
                           : "needs a [Height] scale above 0");
        gen_giveup(l);
    }
    Val o = gen_expr(l, e->args[0]), d = gen_expr(l, e->args[1]);
    Inst *a = gen_scalar(l, e->args[2]), *b = gen_scalar(l, e->args[3]);
    Inst *scale = kf(l, t.scale);
    Ray r = {.x = to_grid(l, o.c[0], t.x0, t.dx),
             .y = to_grid(l, o.c[1], t.y0, t.dy),
             .z = op2(l, OP_fdiv, sub(l, o.c[2], kf(l, t.offset)), scale),
             .dx = op2(l, OP_fdiv, d.c[0], kf(l, t.dx)),
             .dy = op2(l, OP_fdiv, d.c[1], kf(l, t.dy)),
             .t0 = a,
             .t1 = b};
    r.dz = query_rows[method->query].ray == RAY_SLICE ? kf(l, 0) : op2(l, OP_fdiv, d.c[2], scale);
    if (query_rows[method->query].ray == RAY_SEGMENT) find_lift(l, &t, &r, &o);
    if (e->method == M_TRACE) return trace(l, e, &t, &r, &o, &d);
    if (e->method == M_SILHOUETTE) return silhouette(l, e, &t, r);
    Val v = val_new(l, e->type);
    if (e->method == M_CLEARANCE) {
        Clearance c;
        v.c[0] = c.value = mul(l, clearance(l, &t, &r, &c.search), scale);
        c.cell = cell_time(l, &t, &r);
        c.gap = box_gap(l, &t, &r, c.cell);
        gen_clearance_note(l, c);
        return v;
    }
    /* The g of a site needs the first point; kernels that do not ask for it get the cheaper OCCLUDED (opt_hits). */
    Inst *id = query(l, &t, SLT_QUERY_TRACE, &r), *hit = gen_found(l, id),
         *at = evaluate(l, &t, SLT_QUERY_TRACE, &r, id).t;
    v.c[0] = site_wanted(l, hit, at, e->span, JUMP_BUILTIN)
                 ? ray_site(l, &t, &r, gen_site_kind(method->query), hit, at, e->span)
                 : hit;
    return v;
}
