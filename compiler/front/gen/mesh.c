/* Triangle meshes: positions of vertices are parameters, faces are fixed integers (saltus/mesh.h).
 *
 * A witness names a triangle; the evaluation is arithmetic on its nine numbers. With corners A, B, C seen from the
 * origin, e_A = d . (B x C) and so on are the weights of the corners at the point that the ray meets, up to their sum
 * d . n: so t is the mean of the corners' t, and lies between them however thin the triangle is seen. */
#include "compiler/front/gen/geometry.h"
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

/* The corners of a triangle. */
static void corners(Lower *l, const Symbol *sym, Inst *tri, Vec3 out[3]) {
    const uint32_t last = sym->nvertices - 1;
    for (uint32_t k = 0; k < 3; k++) {
        Inst *vertex = clamp_index(l, of_triangle(l, sym, 0, SLT_MESH_FACE, k, tri), false, sym->nvertices),
             *at = op2(l, OP_imul, vertex, ki(l, 3));
        for (uint32_t a = 0; a < 3; a++) out[k][a] = param_float(l, sym, a, at, 3 * last);
    }
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
    m.t = op2(l, OP_fmin, op2(l, OP_fmax, op2(l, OP_fdiv, at, whole), low), high);
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

static Val trace(Lower *l, Expr *e, const Symbol *sym, const Ray *r, const Val *o, const Val *d) {
    Val v = val_new(l, e->type);
    First f = first_of(l, sym, r, o, d);
    Inst *hit = f.hit, *tri = f.tri;
    const Met m = f.met;
    site_untracked(l, f.id, m.t, NULL, e->span, JUMP_ALWAYS);
    v.c[0] = hit;
    v.c[1] = sel(l, hit, m.t, r->t1);
    /* A miss is at tmax, and its p is the origin: finite whatever tmax is. */
    Inst *to = sel(l, hit, m.t, kf(l, 0));
    for (int a = 0; a < 3; a++) v.c[2 + a] = add(l, o->c[a], mul(l, to, d->c[a]));
    normal_of(l, &m, hit, v.c + 5);
    for (uint32_t c = 0; c < 2; c++) {
        Inst *u = m.weight[1 + c];
        if (sym->has_uv) {
            u = NULL;
            for (uint32_t k = 0; k < 3; k++) {
                Inst *part = mul(l, m.weight[k], corner_uv(l, sym, tri, k, c));
                u = u ? add(l, u, part) : part;
            }
        }
        v.c[8 + c] = sel(l, hit, u, kf(l, 0));
    }
    v.c[10] = sel(l, hit, tri, ki(l, -1));
    v.c[11] = sel(l, hit, of_triangle(l, sym, sym->nfaces * SLT_MESH_FACE, SLT_MESH_PART, 0, tri), ki(l, -1));
    return v;
}

Val gen_mesh(Lower *l, Expr *e, const Symbol *sym) {
    const MethodInfo *method = &methods[e->method];
    const char *why = l->quiet      ? "is asked by the shader itself, not by bounds and initial values"
                      : l->tag.disc ? "is no site yet: its silhouettes are not integrated, so take [Disc] away"
                                    : NULL;
    if (why) {
        diag_emit(l->s, DIAG_geometry_query, e->span, method->name, sym->type->name, why);
        gen_giveup(l);
    }
    Val o = gen_expr(l, e->args[0]), d = gen_expr(l, e->args[1]);
    Inst *t0 = gen_scalar(l, e->args[2]), *t1 = gen_scalar(l, e->args[3]);
    Ray r = {.x = o.c[0], .y = o.c[1], .z = o.c[2], .dx = d.c[0], .dy = d.c[1], .dz = d.c[2], .t0 = t0, .t1 = t1};
    if (e->method == M_MESH_TRACE) return trace(l, e, sym, &r, &o, &d);
    Val v = val_new(l, e->type);
    /* The first point says what the jump depends on; kernels that do not ask for it get the cheaper OCCLUDED
     * (opt_hits). */
    First f = first_of(l, sym, &r, &o, &d);
    v.c[0] = f.hit;
    site_untracked(l, f.hit, f.met.t, NULL, e->span, JUMP_BUILTIN);
    return v;
}
