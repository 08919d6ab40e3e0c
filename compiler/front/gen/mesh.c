/* Triangle meshes: positions of vertices are parameters, faces are fixed integers (saltus/mesh.h).
 *
 * A witness names a triangle; the evaluation is arithmetic on its nine numbers. With corners A, B, C seen from the
 * origin, e_A = d . (B x C) and so on are the weights of the corners at the point that the ray meets, up to their sum
 * d . n: so t is the mean of the corners' t, and lies between them however thin the triangle is seen. */
#include "compiler/front/gen/mesh.h"
#include "saltus/mesh.h"

typedef Inst *Vec3[3];

static Inst *add(Lower *l, Inst *a, Inst *b) { return op2(l, OP_fadd, a, b); }
static Inst *sub(Lower *l, Inst *a, Inst *b) { return op2(l, OP_fsub, a, b); }
static Inst *mul(Lower *l, Inst *a, Inst *b) { return op2(l, OP_fmul, a, b); }

static void minus(Lower *l, Inst *const a[3], Inst *const b[3], Vec3 out) {
    for (int i = 0; i < 3; i++) out[i] = sub(l, a[i], b[i]);
}

static void cross(Lower *l, Inst *const a[3], Inst *const b[3], Vec3 out) {
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        out[i] = sub(l, mul(l, a[j], b[k]), mul(l, a[k], b[j]));
    }
}

/* `count` integers that the topology has of each triangle, from `base` on: number k of triangle tri. */
static Inst *of_triangle(Lower *l, const Symbol *sym, uint32_t base, uint32_t count, uint32_t k, Inst *tri) {
    return param_int(l, sym, base + k, op2(l, OP_imul, tri, ki(l, count)), (sym->nfaces - 1) * count, TY_INT);
}

/* What slice `base` of the floats has of a vertex. */
static void of_vertex(Lower *l, const Symbol *sym, uint32_t base, Inst *vertex, Vec3 out) {
    Inst *at = op2(l, OP_imul, clamp_index(l, vertex, false, sym->nvertices), ki(l, 3));
    for (uint32_t a = 0; a < 3; a++) out[a] = slice_float(l, base + a, at, 3 * (sym->nvertices - 1));
}

/* The corners of a triangle. */
static void corners(Lower *l, const Symbol *sym, Inst *tri, Vec3 out[3]) {
    for (uint32_t k = 0; k < 3; k++)
        of_vertex(l, sym, gen_placed(l, sym), of_triangle(l, sym, 0, SLT_MESH_FACE, k, tri), out[k]);
}

/* One of the two texture coordinates of a triangle's corner: the sum of two floats. */
static Inst *corner_uv(Lower *l, const Symbol *sym, Inst *tri, uint32_t k, uint32_t c) {
    Inst *part[2];
    for (uint32_t i = 0; i < 2; i++)
        part[i] = op1(
            l, OP_iasfloat,
            of_triangle(l, sym, sym->nfaces * (SLT_MESH_FACE + SLT_MESH_PART), SLT_MESH_UV, 4 * k + 2 * c + i, tri));
    return add(l, part[0], part[1]);
}

/* What a ray meets. */
typedef struct Met {
    Inst *t, *weight[3]; /* of the corners; their sum is 1 */
    Vec3 corner[3];
} Met;

static Met meet(Lower *l, const Symbol *sym, const Val *o, const Val *d, Inst *found, Inst *tri) {
    Met m;
    Vec3 from[3], normal;
    corners(l, sym, tri, m.corner);
    for (int k = 0; k < 3; k++) minus(l, m.corner[k], o->c, from[k]);
    Inst *sum = NULL, *at = NULL, *low = NULL, *high = NULL;
    Inst *square = sel(l, found, dot_n(l, d->c, d->c, 3), kf(l, 1));
    for (int k = 0; k < 3; k++) {
        cross(l, from[(k + 1) % 3], from[(k + 2) % 3], normal);
        Inst *e = m.weight[k] = dot_n(l, d->c, normal, 3), *z = op2(l, OP_fdiv, dot_n(l, d->c, from[k], 3), square);
        sum = sum ? add(l, sum, e) : e, at = at ? add(l, at, mul(l, e, z)) : mul(l, e, z);
        low = low ? op2(l, OP_fmin, low, z) : z, high = high ? op2(l, OP_fmax, high, z) : z;
    }
    /* Seen nearly edge-on the sum may be rounded to 0. */
    Inst *real = op2(l, OP_band, found, op2(l, OP_fne, sum, kf(l, 0))), *whole = sel(l, real, sum, kf(l, 1));
    /* The bounds are for rounding alone: where all corners have one t, as faces square to the ray have, the derivative
     * is that of the mean all the same. */
    Inst *mean = op2(l, OP_fdiv, at, whole), *bounded = op2(l, OP_fmin, op2(l, OP_fmax, mean, low), high);
    m.t = add(l, op1(l, OP_detach, bounded), op1(l, OP_ghost, mean));
    for (int k = 0; k < 3; k++) m.weight[k] = op2(l, OP_fdiv, m.weight[k], whole);
    return m;
}

static void normal_of(Lower *l, const Met *m, Inst *found, Inst *out[3]) {
    Vec3 p, q, n;
    minus(l, m->corner[1], m->corner[0], p);
    minus(l, m->corner[2], m->corner[0], q);
    cross(l, p, q, n);
    Inst *length = op1(l, OP_fsqrt, sel(l, found, dot_n(l, n, n, 3), kf(l, 1)));
    for (int a = 0; a < 3; a++) out[a] = sel(l, found, op2(l, OP_fdiv, n[a], length), kf(l, 0));
}

/* The first triangle that a ray meets. */
typedef struct First {
    Inst *id, *hit, *tri; /* tri: 0 where nothing is hit */
    Met met;
} First;

static First first_of(Lower *l, const Symbol *sym, const Ray *r, const Val *o, const Val *d) {
    First f = {.id = gen_query(l, (Searched){.sym = sym}, SLT_QUERY_TRACE, r)};
    f.hit = gen_found(l, f.id);
    f.tri = op2(l, OP_imin, op2(l, OP_imax, f.id, ki(l, 0)), ki(l, (int64_t)sym->nfaces - 1));
    range_set(l, f.tri, 0, (int64_t)sym->nfaces - 1);
    f.met = meet(l, sym, o, d, f.hit, f.tri);
    return f;
}

/* hit: whether; whether as one who tells faces apart, and places of a texture. */
static Val trace(Lower *l, Expr *e, const Symbol *sym, const Ray *r, const Val *o, const Val *d, const First *f,
                 Inst *hit, Inst *hit_face, Inst *hit_uv) {
    Val v = val_new(l, e->type);
    Inst *tri = f->tri;
    const Met m = f->met;
    v.c[0] = hit;
    v.c[1] = sel(l, hit, m.t, r->t1);
    /* A miss is at tmax, and its p is the origin: finite whatever tmax is. */
    Inst *to = sel(l, hit, m.t, kf(l, 0));
    for (int a = 0; a < 3; a++) v.c[2 + a] = add(l, o->c[a], mul(l, to, d->c[a]));
    normal_of(l, &m, hit_face, v.c + 5);
    for (uint32_t c = 0; c < 2; c++) {
        Inst *u = m.weight[1 + c];
        if (sym->has_uv) {
            u = NULL;
            for (uint32_t k = 0; k < 3; k++) {
                Inst *part = mul(l, m.weight[k], corner_uv(l, sym, tri, k, c));
                u = u ? add(l, u, part) : part;
            }
        }
        v.c[8 + c] = sel(l, hit_uv, u, kf(l, 0));
    }
    v.c[10] = sel(l, hit_face, tri, ki(l, -1));
    v.c[11] = sel(l, hit, of_triangle(l, sym, sym->nfaces * SLT_MESH_FACE, SLT_MESH_PART, 0, tri), ki(l, -1));
    v.c[12] = f->id;
    return v;
}

/* ---- visible pieces
 *
 * What a query has found, polygons, is constant for derivatives. A piece with sides on lines g_j = 0, g_j > 0 inside,
 * changes by moving sides alone: of its area by the sum of the integrals of dg / |grad g| along them, exact, as dg is
 * linear there; of the moments likewise, of products of two linear functions. So its area is what was found and the
 * ghost of that sum (OP_ghost), with the ends of the sides held. */

enum { BEAM_EYE = 0, BEAM_CORNER = 3, BEAM_U = 6, BEAM_V = 9 }; /* among its parts */

typedef struct Beam {
    const Symbol *sym;
    uint32_t geometry;
    Inst *const *eye, *const *corner, *const *u, *const *v;
    Vec3 c; /* of the window's first corner, from the eye */
} Beam;

static Beam beam_of(Lower *l, const Symbol *sym, Inst *const *parts) {
    Beam b = {.sym = sym,
              .geometry = gen_geometry_number(l, (Searched){.sym = sym}),
              .eye = parts + BEAM_EYE,
              .corner = parts + BEAM_CORNER,
              .u = parts + BEAM_U,
              .v = parts + BEAM_V};
    minus(l, parts + BEAM_CORNER, b.eye, b.c);
    return b;
}

/* To a place of the window from its first corner. */
static void inside(Lower *l, const Beam *b, Inst *s, Inst *t, Vec3 out) {
    for (int a = 0; a < 3; a++) out[a] = add(l, mul(l, s, b->u[a]), mul(l, t, b->v[a]));
}

/* Is the window's first corner far nearer to a point of the mesh than to the eye? Then a direction d to the window is
 * better less the way to that point, `at`: what is orthogonal to `at` has the same product with both, and where the eye
 * is far this difference is what derivatives hang on. */
static Inst *much_nearer(Lower *l, const Beam *b, Inst *const at[3]) {
    Vec3 from;
    minus(l, b->corner, at, from);
    return op2(l, OP_flt, mul(l, kf(l, 64), dot_n(l, from, from, 3)), dot_n(l, b->c, b->c, 3));
}

/* The window's first corner from the point, if that is much nearer, or else from the eye. */
static void corner_from(Lower *l, const Beam *b, Inst *nearer, Inst *const at[3], Vec3 out) {
    for (int a = 0; a < 3; a++) out[a] = sel(l, nearer, sub(l, b->corner[a], at[a]), b->c[a]);
}

static Inst *told(Lower *l, const Beam *b, uint32_t which, Inst *unit, IrType t) {
    return special(l, OP_told, t, 1, &unit, (Imm){.query = {b->geometry, which, 0}});
}

static void vertex_at(Lower *l, const Beam *b, Inst *number, Vec3 out) {
    of_vertex(l, b->sym, gen_placed(l, b->sym), number, out);
}

/* The plane of a triangle, through `at`, seen from the eye: d . normal / det is 1 / t. */
static void plane_through(Lower *l, const Beam *b, Inst *tri, Vec3 at, Vec3 normal, Inst **det) {
    Vec3 corner[3], p, q, from;
    corners(l, b->sym, tri, corner);
    minus(l, corner[1], corner[0], p);
    minus(l, corner[2], corner[0], q);
    cross(l, p, q, normal);
    minus(l, corner[0], b->eye, from);
    *det = dot_n(l, from, normal, 3);
    for (int a = 0; a < 3; a++) at[a] = corner[0][a];
}

static void plane_from(Lower *l, const Beam *b, Inst *tri, Vec3 normal, Inst **det) {
    Vec3 at;
    plane_through(l, b, tri, at, normal, det);
}

static Inst *triangle_in(Lower *l, const Symbol *sym, Inst *tri) { return clamp_index(l, tri, false, sym->nfaces); }

/* h . n at both ends of a side, h from `corner`, inside[k] further. */
static void products(Lower *l, Inst *const corner[3], Vec3 inside[2], Inst *const n[3], Inst *out[2]) {
    for (int k = 0; k < 2; k++) {
        Vec3 h;
        for (int a = 0; a < 3; a++) h[a] = add(l, corner[a], inside[k][a]);
        out[k] = dot_n(l, h, n, 3);
    }
}

/* The difference of 1 / t of two triangles, of 1 / t - 1 if that is better. */
static void depths_at_ends(Lower *l, const Beam *b, Inst *const tri[2], Vec3 inside[2], Inst *g[2]) {
    Inst *nearer = NULL, *of[2][2];
    for (int i = 0; i < 2; i++) {
        Vec3 at, n, corner;
        Inst *det;
        plane_through(l, b, triangle_in(l, b->sym, tri[i]), at, n, &det);
        if (!nearer) nearer = much_nearer(l, b, at);
        corner_from(l, b, nearer, at, corner);
        products(l, corner, inside, n, of[i]);
        for (int k = 0; k < 2; k++) of[i][k] = op2(l, OP_fdiv, of[i][k], det);
    }
    for (int k = 0; k < 2; k++) g[k] = sub(l, of[0][k], of[1][k]);
}

/* g of a side at both its ends, which lie inside[k] in the window. */
static void side_at_ends(Lower *l, const Beam *b, Inst *one, Inst *two, Vec3 inside[2], Inst *g[2]) {
    Var *out = var_new(l, TY_FLT, 2);
    IfCtx c;
    for (int k = 0; k < 2; k++) out[k].value = kf(l, 0);
    if_begin(l, &c, op2(l, OP_ilt, two, ki(l, 0)));
    Inst *const tri[] = {one, op2(l, OP_isub, ki(l, -1), two)};
    depths_at_ends(l, b, tri, inside, g);
    for (int k = 0; k < 2; k++) var_set(l, &out[k], g[k]);
    if_else(l, &c);
    Vec3 p, q, along, from, corner, n;
    vertex_at(l, b, one, p);
    vertex_at(l, b, two, q);
    minus(l, q, p, along);
    minus(l, p, b->eye, from);
    cross(l, from, along, n);
    corner_from(l, b, much_nearer(l, b, p), p, corner);
    products(l, corner, inside, n, g);
    for (int k = 0; k < 2; k++) var_set(l, &out[k], g[k]);
    if_end(l, &c);
    for (int k = 0; k < 2; k++) g[k] = var_get(l, &out[k]);
}

/* Sums over the sides: what they add to the area, and to its moments about the centroid. */
static void moving_sides(Lower *l, const Beam *b, Inst *unit, Inst *const centre[2], Inst *sum[3]) {
    Var *out = var_new(l, TY_FLT, 3);
    Inst *sides = told(l, b, SLT_PIECE_SIDES, unit, TY_INT);
    IfCtx some;
    for (int k = 0; k < 3; k++) out[k].value = kf(l, 0);
    if_begin(l, &some, op2(l, OP_ilt, ki(l, 0), sides));
    LoopCtx c = {0};
    VarList carried = {0};
    for (int k = 0; k < 3; k++) vec_push(l->arena, &carried, &out[k]);
    loop_begin(l, &c, &carried, (LoopInfo){.max_iters = SLT_PIECE_MAX_SIDES});
    Inst *side = op2(l, OP_iadd, op2(l, OP_iadd, unit, c.k), ki(l, 1)), *at[2][2], *g[2];
    Vec3 end[2];
    for (uint32_t k = 0; k < 2; k++) {
        for (uint32_t a = 0; a < 2; a++) at[k][a] = told(l, b, SLT_SIDE_S0 + 2 * k + a, side, TY_FLT);
        inside(l, b, at[k][0], at[k][1], end[k]);
    }
    side_at_ends(l, b, told(l, b, SLT_SIDE_A, side, TY_INT), told(l, b, SLT_SIDE_B, side, TY_INT), end, g);
    Inst *weight = told(l, b, SLT_SIDE_WEIGHT, side, TY_FLT), *both = add(l, g[0], g[1]);
    var_set(l, &out[0], add(l, var_get(l, &out[0]), mul(l, mul(l, weight, kf(l, 0.5)), both)));
    for (int a = 0; a < 2; a++) {
        Inst *part = kf(l, 0);
        for (int k = 0; k < 2; k++) part = add(l, part, mul(l, sub(l, at[k][a], centre[a]), add(l, both, g[k])));
        var_set(l, &out[1 + a], add(l, var_get(l, &out[1 + a]), mul(l, mul(l, weight, kf(l, 1.0 / 6)), part)));
    }
    loop_end(l, &c, op2(l, OP_ilt, c.k, op2(l, OP_isub, sides, ki(l, 1))));
    if_else(l, &some);
    if_end(l, &some);
    for (int k = 0; k < 3; k++) sum[k] = var_get(l, &out[k]);
}

/* What is told of a piece, and where it lies. */
static void seen_of(Lower *l, const Beam *b, Inst *unit, Inst *of[PIECE_UNIT]) {
    Inst *area = told(l, b, SLT_PIECE_AREA, unit, TY_FLT), *held[2], *sum[3], *tri, *det;
    for (uint32_t a = 0; a < 2; a++) held[a] = told(l, b, SLT_PIECE_S + a, unit, TY_FLT);
    moving_sides(l, b, unit, held, sum);
    of[1] = add(l, area, op1(l, OP_ghost, sum[0]));
    for (int a = 0; a < 2; a++) of[2 + a] = add(l, held[a], op1(l, OP_ghost, op2(l, OP_fdiv, sum[1 + a], area)));
    of[PIECE_TRI] = tri = triangle_in(l, b->sym, told(l, b, SLT_PIECE_TRIANGLE, unit, TY_INT));
    /* p = start + t d: from the eye, or from the window's place, where t is -(d - at) . n / d . n. */
    Vec3 in, d, at, n, from;
    inside(l, b, of[2], of[3], in);
    plane_through(l, b, tri, at, n, &det);
    Inst *nearer = much_nearer(l, b, at);
    for (int a = 0; a < 3; a++) {
        d[a] = add(l, b->c[a], in[a]);
        from[a] = sub(l, sub(l, at[a], b->corner[a]), in[a]);
    }
    Inst *t = op2(l, OP_fdiv, sel(l, nearer, dot_n(l, from, n, 3), det), dot_n(l, d, n, 3)),
         *length = op1(l, OP_fsqrt, dot_n(l, n, n, 3));
    for (int a = 0; a < 3; a++) {
        Inst *start = sel(l, nearer, add(l, b->corner[a], in[a]), b->eye[a]);
        of[PIECE_P + a] = add(l, start, mul(l, t, d[a]));
        of[PIECE_NORMAL + a] = op2(l, OP_fdiv, n[a], length);
    }
    of[PIECE_PART] = of_triangle(l, b->sym, b->sym->nfaces * SLT_MESH_FACE, SLT_MESH_PART, 0, tri);
}

/* Most lanes see nothing further, and often all of them: under an if, that is not evaluated, nor differentiated. */
static Val piece_of(Lower *l, Type *type, const Symbol *sym, Inst *unit, Inst *const *parts) {
    Val v = val_new(l, type);
    const Beam beam = beam_of(l, sym, parts), *b = &beam;
    Var *number = var_new(l, TY_FLT, PIECE_TRI), *name = var_new(l, TY_INT, 2);
    Inst *found = v.c[0] = op2(l, OP_ine, unit, ki(l, 0)), *of[PIECE_UNIT];
    IfCtx c;
    for (int k = 1; k < PIECE_TRI; k++)
        number[k].value = k >= PIECE_P && k < PIECE_NORMAL ? b->eye[k - PIECE_P] : kf(l, 0);
    for (int k = 0; k < 2; k++) name[k].value = ki(l, -1);
    if_begin(l, &c, found);
    seen_of(l, b, unit, of);
    for (int k = 1; k < PIECE_TRI; k++) var_set(l, &number[k], of[k]);
    for (int k = 0; k < 2; k++) var_set(l, &name[k], of[PIECE_TRI + k]);
    if_else(l, &c);
    if_end(l, &c);
    for (int k = 1; k < PIECE_TRI; k++) v.c[k] = var_get(l, &number[k]);
    for (int k = 0; k < 2; k++) v.c[PIECE_TRI + k] = var_get(l, &name[k]);
    v.c[PIECE_UNIT] = unit;
    v.c[PIECE_MESH] = ki(l, 1 + (int32_t)b->geometry);
    for (int k = 0; k < SLT_BEAM_ROWS; k++) v.c[PIECE_BEAM + k] = parts[k];
    return v;
}

Inst *gen_begun(Lower *l, uint32_t geometry, Span span) {
    if (l->begun) return l->begun;
    Builder at = ir_after(l->fn, l->anchor);
    at.span = span;
    Inst *begin = ir_special(&at, OP_query, TY_INT, 0, NULL,
                             (Imm){.query = {geometry, SLT_QUERY_BEGIN, l->geometries.data[geometry].base}});
    return l->begun = ir_emit1(&at, OP_i2f, begin);
}

Inst *gen_piece_unit(Lower *l, uint32_t geometry, const Val *piece) {
    Inst *own = op2(l, OP_ieq, piece->c[PIECE_MESH], ki(l, 1 + (int32_t)geometry));
    return sel(l, own, piece->c[PIECE_UNIT], ki(l, 0));
}

static Val first(Lower *l, Expr *e, const Symbol *sym) {
    Val beam = gen_expr(l, e->args[0]);
    uint32_t geometry = gen_geometry_number(l, (Searched){.sym = sym});
    Inst *args[SLT_BEAM_ROWS + 1];
    for (int k = 0; k < SLT_BEAM_ROWS; k++) args[k] = beam.c[k];
    args[SLT_BEAM_ROWS] = gen_begun(l, geometry, e->span);
    Inst *unit = special(l, OP_query, TY_INT, SLT_BEAM_ROWS + 1, args,
                         (Imm){.query = {geometry, SLT_QUERY_PIECES, l->geometries.data[geometry].base}});
    Val piece = piece_of(l, e->type, sym, unit, beam.c);
    site_untracked(l, unit, piece.c[1], NULL, e->span, JUMP_PIECES);
    return piece;
}

static Val next(Lower *l, Expr *e, const Symbol *sym) {
    Val q = gen_expr(l, e->args[0]);
    const Beam b = {.sym = sym, .geometry = gen_geometry_number(l, (Searched){.sym = sym})};
    Inst *unit = told(l, &b, SLT_PIECE_NEXT, gen_piece_unit(l, b.geometry, &q), TY_INT);
    return piece_of(l, e->type, sym, unit, q.c + PIECE_BEAM);
}

/* ---- sites
 *
 * What parts two rays, an edge, a crossing or an end of theirs, is found by a query of the pair (compiler/pass/
 * variant_mesh.c), which names it by two numbers as sides of pieces are named. g is arithmetic on the vertices behind
 * them. A program that tells faces apart has a second site, whose
 * events are all edges; one that looks up textures one whose events are seams. */

/* d . (n t - det): below 0 on one side of the plane; where the ray at t is in the triangle's plane, 0. */
static Inst *end_in_plane(Lower *l, const Beam *b, Inst *tri, Inst *const d[3], Inst *t) {
    Vec3 n;
    Inst *det;
    plane_from(l, b, tri, n, &det);
    return sub(l, mul(l, t, dot_n(l, d, n, 3)), det);
}

/* Of two planes the difference of 1 / t, times both determinants: a polynomial. */
static Inst *planes_cross(Lower *l, const Beam *b, Inst *one, Inst *two, Inst *const d[3]) {
    Vec3 n[2];
    Inst *det[2];
    plane_from(l, b, one, n[0], &det[0]);
    plane_from(l, b, two, n[1], &det[1]);
    return sub(l, mul(l, dot_n(l, d, n[0], 3), det[1]), mul(l, dot_n(l, d, n[1], 3), det[0]));
}

static Inst *g_of_line(Lower *l, const Beam *b, const Ray *r, Inst *const d[3], Inst *one, Inst *two) {
    Var *g = var_new(l, TY_FLT, 1);
    IfCtx edge, crossing;
    g->value = kf(l, 0);
    if_begin(l, &edge, op2(l, OP_ilt, one, two));
    Vec3 p, q, along, n;
    vertex_at(l, b, one, p);
    vertex_at(l, b, two, q);
    minus(l, q, p, along);
    minus(l, p, b->eye, p);
    cross(l, p, along, n);
    var_set(l, g, dot_n(l, d, n, 3));
    if_else(l, &edge);
    Inst *near = op2(l, OP_ieq, one, two), *first = triangle_in(l, b->sym, one),
         *second = triangle_in(l, b->sym, op2(l, OP_isub, ki(l, -1), two));
    if_begin(l, &crossing, op2(l, OP_bor, near, op2(l, OP_ieq, first, second)));
    var_set(l, g, end_in_plane(l, b, first, d, sel(l, near, r->t0, r->t1)));
    if_else(l, &crossing);
    var_set(l, g, planes_cross(l, b, first, second, d));
    if_end(l, &crossing);
    if_end(l, &edge);
    return var_get(l, g);
}

/* f.hit as a site. */
static Inst *line_site(Lower *l, const Symbol *sym, const Ray *r, const Val *o, const Val *d, const First *f,
                       SiteKind kind, Span span) {
    const Beam from = {.sym = sym, .geometry = gen_geometry_number(l, (Searched){.sym = sym}), .eye = o->c};
    int edges = kind == SITE_MESH_FACE ? SLT_EDGES_ALL : kind == SITE_MESH_SEAM ? SLT_EDGES_SEAMS : SLT_EDGES_NONE;
    Inst *face = op1(l, OP_i2f, f->id), *number[2];
    for (uint32_t k = 0; k < 2; k++) {
        Inst *ray[] = {r->x, r->y, r->z, r->dx, r->dy, r->dz, r->t0, r->t1}, *args[SLT_PAIR_ROWS];
        for (uint32_t i = 0; i < SLT_PAIR_OTHER; i++) args[i] = args[SLT_PAIR_OTHER + i] = ray[i];
        args[SLT_PAIR_FACE] = args[SLT_PAIR_OTHER_FACE] = face;
        args[SLT_PAIR_EDGES] = kf(l, edges), args[SLT_PAIR_WHICH] = kf(l, k);
        number[k] = special(l, OP_query, TY_INT, SLT_PAIR_ROWS, args,
                            (Imm){.query = {from.geometry, SLT_QUERY_BETWEEN, l->geometries.data[from.geometry].base}});
    }
    return site_ray(l, kind, f->hit, g_of_line(l, &from, r, d->c, number[0], number[1]), span);
}

static void want_exact_numbers(Lower *l, const Symbol *sym) {
    uint32_t most = sym->nvertices > sym->nfaces ? sym->nvertices : sym->nfaces;
    if (l->fn->precision == PREC_F32 && most >= SLT_MESH_EXACT)
        session_limit(l->s,
                      "[Disc] on the mesh `%s` in f32: floats cannot number its %u vertices and %u triangles; "
                      "--precision f64 can",
                      sym->name, sym->nvertices, sym->nfaces);
}

/* ---- normals that bend with the surface */

enum { HIT_P = 2, HIT_FACE = 12 }; /* among the parts of a MeshHit */

/* Normals of the corners, weighted by the areas that p cuts the triangle into. */
static Val smooth_normal(Lower *l, Expr *e, const Symbol *sym) {
    bool piece = e->method == M_MESH_SMOOTH_PIECE;
    Val v = val_new(l, e->type), hit = gen_expr(l, e->args[0]);
    Inst *const *at = hit.c + (piece ? PIECE_P : HIT_P), *face = hit.c[piece ? PIECE_TRI : HIT_FACE],
                *found = op2(l, OP_band, hit.c[0], op2(l, OP_ile, ki(l, 0), face)), *tri = triangle_in(l, sym, face),
                *sum[3] = {kf(l, 0), kf(l, 0), kf(l, 0)};
    Vec3 corner[3], from[3], p, q, across, part, normal;
    corners(l, sym, tri, corner);
    minus(l, corner[1], corner[0], p);
    minus(l, corner[2], corner[0], q);
    cross(l, p, q, across);
    Inst *whole = dot_n(l, across, across, 3), *real = op2(l, OP_fne, whole, kf(l, 0));
    for (int k = 0; k < 3; k++) minus(l, corner[k], at, from[k]);
    for (uint32_t k = 0; k < 3; k++) {
        cross(l, from[(k + 1) % 3], from[(k + 2) % 3], part);
        Inst *area = op2(l, OP_fdiv, dot_n(l, part, across, 3), sel(l, real, whole, kf(l, 1)));
        of_vertex(l, sym, gen_normals(l, sym), of_triangle(l, sym, 0, SLT_MESH_FACE, k, tri), normal);
        for (int a = 0; a < 3; a++) sum[a] = add(l, sum[a], mul(l, area, normal[a]));
    }
    Inst *square = dot_n(l, sum, sum, 3), *some = op2(l, OP_band, found, op2(l, OP_fne, square, kf(l, 0))),
         *length = op1(l, OP_fsqrt, sel(l, some, square, kf(l, 1)));
    for (int a = 0; a < 3; a++) v.c[a] = sel(l, some, op2(l, OP_fdiv, sum[a], length), kf(l, 0));
    return v;
}

Val gen_mesh(Lower *l, Expr *e, const Symbol *sym) {
    const MethodInfo *method = &methods[e->method];
    if (l->quiet) {
        diag_emit(l->s, DIAG_geometry_query, e->span, method->name, sym->type->name,
                  "is asked by the shader itself, not by bounds, initial values and what places vertices");
        gen_giveup(l);
    }
    if (e->method == M_MESH_FIRST) return first(l, e, sym);
    if (e->method == M_MESH_NEXT) return next(l, e, sym);
    if (e->method == M_MESH_SMOOTH || e->method == M_MESH_SMOOTH_PIECE) return smooth_normal(l, e, sym);
    if (e->method == M_MESH_IRRADIANCE || e->method == M_MESH_LTC || e->method == M_MESH_LIT)
        return gen_mesh_light(l, e, sym);
    Val o = gen_expr(l, e->args[0]), d = gen_expr(l, e->args[1]);
    Inst *t0 = gen_scalar(l, e->args[2]), *t1 = gen_scalar(l, e->args[3]);
    Ray r = {.x = o.c[0], .y = o.c[1], .z = o.c[2], .dx = d.c[0], .dy = d.c[1], .dz = d.c[2], .t0 = t0, .t1 = t1};
    /* The first point says what the jump depends on; kernels that do not ask for it get the cheaper OCCLUDED
     * (opt_hits). */
    First f = first_of(l, sym, &r, &o, &d);
    bool traces = e->method == M_MESH_TRACE, disc = traces ? site_wanted(l, f.id, f.met.t, e->span, JUMP_TRACE)
                                                           : site_wanted(l, f.hit, f.met.t, e->span, JUMP_BUILTIN);
    Inst *hit = f.hit, *hit_face = hit, *hit_uv = hit;
    if (disc) {
        want_exact_numbers(l, sym);
        hit = line_site(l, sym, &r, &o, &d, &f, traces ? SITE_MESH : SITE_MESH_SHADOW, e->span);
        if (traces) hit_uv = hit_face = line_site(l, sym, &r, &o, &d, &f, SITE_MESH_FACE, e->span);
        if (traces && sym->has_uv) hit_uv = line_site(l, sym, &r, &o, &d, &f, SITE_MESH_SEAM, e->span);
    }
    if (traces) return trace(l, e, sym, &r, &o, &d, &f, hit, hit_face, hit_uv);
    Val v = val_new(l, e->type);
    v.c[0] = hit;
    return v;
}
