/* Textures and heightfields: their texels and heights are parameters, so lookups are ordinary operations and differentiable in everything. */
#include "compiler/front/lower_internal.h"

typedef struct Grid {
    const Symbol *sym;
    uint32_t w, h, c;
} Grid;

/* Texel (x, y), both inside; missing channels are 0, missing alpha is 1. */
static Inst *texel(Lower *l, const Grid *g, Inst *x, Inst *y, uint32_t channel) {
    if (channel >= g->c) return kf(l, channel == 3 ? 1 : 0);
    Inst *i = op2(l, OP_iadd, op2(l, OP_imul, y, ki(l, g->w)), x);
    if (g->c > 1) i = op2(l, OP_imul, i, ki(l, g->c));
    return param_float(l, g->sym, channel, i, (g->w * g->h - 1) * g->c);
}

static Inst *clamp_to(Lower *l, Inst *i, uint32_t n) { return op2(l, OP_imax, op2(l, OP_imin, i, ki(l, (int64_t)n - 1)), ki(l, 0)); }

/* Continuous coordinate along one axis -> the two neighbours and the weight of the second. Outside the grid both are the edge. */
typedef struct Axis {
    Inst *i0, *i1, *t;
} Axis;
static Axis axis(Lower *l, Inst *at, uint32_t n) {
    Axis a;
    Inst *base = op1(l, OP_ffloor, at);
    a.t = op2(l, OP_fsub, at, base);
    Inst *i = op2(l, OP_imax, op2(l, OP_imin, op1(l, OP_f2i, base), ki(l, (int64_t)n - 1)), ki(l, -1));
    range_set(l, i, -1, (int64_t)n - 1);
    a.i0 = op2(l, OP_imax, i, ki(l, 0));
    a.i1 = op2(l, OP_imin, op2(l, OP_iadd, i, ki(l, 1)), ki(l, (int64_t)n - 1));
    return a;
}

static Inst *mix(Lower *l, Inst *a, Inst *b, Inst *t) { return op2(l, OP_fadd, a, op2(l, OP_fmul, t, op2(l, OP_fsub, b, a))); }

static Val texture_method(Lower *l, Expr *e, const Grid *g) {
    Val v = val_new(l, e->type), at = lower_expr(l, e->args[0]);
    if (e->method == M_LOAD) {
        Inst *x = clamp_to(l, at.c[0], g->w), *y = clamp_to(l, at.c[1], g->h);
        for (uint32_t c = 0; c < v.n; c++) v.c[c] = texel(l, g, x, y, c);
        return v;
    }
    /* v up, row 0 at the top, texel centres at (i + 0.5) / n. */
    Inst *px = op2(l, OP_fmul, at.c[0], kf(l, g->w)), *py = op2(l, OP_fmul, op2(l, OP_fsub, kf(l, 1), at.c[1]), kf(l, g->h));
    if (e->method == M_NEAREST) {
        Inst *fx = site_integer(l, SITE_FLOOR, op1(l, OP_ffloor, px), px, e->span);
        Inst *fy = site_integer(l, SITE_FLOOR, op1(l, OP_ffloor, py), py, e->span);
        Inst *x = clamp_to(l, op1(l, OP_f2i, fx), g->w), *y = clamp_to(l, op1(l, OP_f2i, fy), g->h);
        for (uint32_t c = 0; c < v.n; c++) v.c[c] = texel(l, g, x, y, c);
        return v;
    }
    Axis x = axis(l, op2(l, OP_fsub, px, kf(l, 0.5)), g->w), y = axis(l, op2(l, OP_fsub, py, kf(l, 0.5)), g->h);
    for (uint32_t c = 0; c < v.n; c++) {
        if (c >= g->c) {
            v.c[c] = kf(l, c == 3 ? 1 : 0);
            continue;
        }
        Inst *top = mix(l, texel(l, g, x.i0, y.i0, c), texel(l, g, x.i1, y.i0, c), x.t);
        Inst *bottom = mix(l, texel(l, g, x.i0, y.i1, c), texel(l, g, x.i1, y.i1, c), x.t);
        v.c[c] = mix(l, top, bottom, y.t);
    }
    return v;
}

/* ---- heightfields: samples at the corners of the cells, row 0 of the data at the largest y */

typedef struct Terrain {
    Grid g;
    double x0, y0, dx, dy, scale, offset; /* sizes of a cell */
} Terrain;

static Terrain terrain(const Symbol *sym, const Grid *g) {
    const ParamAttrs *a = &sym->attrs;
    double e[4] = {0, 0, 1, 1};
    if (a->has_extent)
        for (int i = 0; i < 4; i++) e[i] = a->extent[i];
    return (Terrain){*g, e[0], e[1], (e[2] - e[0]) / (g->w > 1 ? g->w - 1 : 1), (e[3] - e[1]) / (g->h > 1 ? g->h - 1 : 1),
                     a->has_height ? a->height_scale : 1, a->has_height ? a->height_offset : 0};
}

/* Sample (i, j), j counted upwards, in height units of the world. */
static Inst *height_at(Lower *l, const Terrain *t, Inst *i, Inst *j) {
    Inst *h = texel(l, &t->g, i, op2(l, OP_isub, ki(l, (int64_t)t->g.h - 1), j), 0);
    if (t->scale != 1) h = op2(l, OP_fmul, h, kf(l, t->scale));
    return t->offset != 0 ? op2(l, OP_fadd, h, kf(l, t->offset)) : h;
}

typedef struct Cell {
    Inst *i0, *i1, *j0, *j1; /* corners */
    Inst *u, *v;             /* in [0, 1] */
    Inst *lower;             /* u + v <= 1: the triangle at (0,0), cut off by the diagonal (1,0)-(0,1) */
} Cell;

static void cell_axis(Lower *l, Inst *p, double lo, double d, uint32_t n, Inst **i0, Inst **i1, Inst **u) {
    Inst *at = op2(l, OP_fdiv, op2(l, OP_fsub, p, kf(l, lo)), kf(l, d));
    at = op2(l, OP_fmin, op2(l, OP_fmax, at, kf(l, 0)), kf(l, (double)n - 1)); /* outside: the edge */
    Inst *base = op2(l, OP_fmin, op1(l, OP_ffloor, at), kf(l, n > 1 ? (double)n - 2 : 0));
    *u = op2(l, OP_fsub, at, base);
    *i0 = op1(l, OP_f2i, base);
    *i1 = op2(l, OP_imin, op2(l, OP_iadd, *i0, ki(l, 1)), ki(l, (int64_t)n - 1));
}

static Cell cell(Lower *l, const Terrain *t, Val p) {
    Cell c;
    cell_axis(l, p.c[0], t->x0, t->dx, t->g.w, &c.i0, &c.i1, &c.u);
    cell_axis(l, p.c[1], t->y0, t->dy, t->g.h, &c.j0, &c.j1, &c.v);
    c.lower = op2(l, OP_fle, op2(l, OP_fadd, c.u, c.v), kf(l, 1));
    return c;
}

/* Linear interpolation of corner values on the cell's two triangles. */
static Inst *on_cell(Lower *l, const Cell *c, Inst *a00, Inst *a10, Inst *a01, Inst *a11) {
    Inst *low = op2(l, OP_fadd, op2(l, OP_fadd, a00, op2(l, OP_fmul, c->u, op2(l, OP_fsub, a10, a00))), op2(l, OP_fmul, c->v, op2(l, OP_fsub, a01, a00)));
    Inst *ru = op2(l, OP_fsub, kf(l, 1), c->u), *rv = op2(l, OP_fsub, kf(l, 1), c->v);
    Inst *high = op2(l, OP_fadd, op2(l, OP_fadd, a11, op2(l, OP_fmul, ru, op2(l, OP_fsub, a01, a11))), op2(l, OP_fmul, rv, op2(l, OP_fsub, a10, a11)));
    return sel(l, c->lower, low, high);
}

/* Slope at a sample by central differences, one-sided at the edge. */
static void slope_at(Lower *l, const Terrain *t, Inst *i, Inst *j, Inst **sx, Inst **sy) {
    Inst *im = op2(l, OP_imax, op2(l, OP_isub, i, ki(l, 1)), ki(l, 0)), *ip = op2(l, OP_imin, op2(l, OP_iadd, i, ki(l, 1)), ki(l, (int64_t)t->g.w - 1));
    Inst *jm = op2(l, OP_imax, op2(l, OP_isub, j, ki(l, 1)), ki(l, 0)), *jp = op2(l, OP_imin, op2(l, OP_iadd, j, ki(l, 1)), ki(l, (int64_t)t->g.h - 1));
    Inst *one = ki(l, 1);
    Inst *wx = op2(l, OP_fmul, op1(l, OP_i2f, op2(l, OP_imax, op2(l, OP_isub, ip, im), one)), kf(l, t->dx));
    Inst *wy = op2(l, OP_fmul, op1(l, OP_i2f, op2(l, OP_imax, op2(l, OP_isub, jp, jm), one)), kf(l, t->dy));
    *sx = op2(l, OP_fdiv, op2(l, OP_fsub, height_at(l, t, ip, j), height_at(l, t, im, j)), wx);
    *sy = op2(l, OP_fdiv, op2(l, OP_fsub, height_at(l, t, i, jp), height_at(l, t, i, jm)), wy);
}

static Val heightfield_method(Lower *l, Expr *e, const Grid *g) {
    static const char *const names[] = {"trace", "occluded", "clearance", "silhouette"};
    if (e->method >= M_TRACE) {
        diag_emit(l->s, DIAG_heightfield_query, e->span, names[e->method - M_TRACE]);
        lower_giveup(l);
    }
    Terrain t = terrain(g->sym, g);
    Val p = lower_expr(l, e->args[0]), v = val_new(l, e->type);
    Cell c = cell(l, &t, p);
    if (e->method == M_NORMAL) {
        Inst *x[4], *y[4];
        slope_at(l, &t, c.i0, c.j0, &x[0], &y[0]);
        slope_at(l, &t, c.i1, c.j0, &x[1], &y[1]);
        slope_at(l, &t, c.i0, c.j1, &x[2], &y[2]);
        slope_at(l, &t, c.i1, c.j1, &x[3], &y[3]);
        Inst *n[3] = {op1(l, OP_fneg, on_cell(l, &c, x[0], x[1], x[2], x[3])), op1(l, OP_fneg, on_cell(l, &c, y[0], y[1], y[2], y[3])), kf(l, 1)};
        Inst *inv = op2(l, OP_fdiv, kf(l, 1), op1(l, OP_fsqrt, dot_n(l, n, n, 3)));
        for (uint32_t i = 0; i < 3; i++) v.c[i] = op2(l, OP_fmul, n[i], inv);
        return v;
    }
    Inst *a00 = height_at(l, &t, c.i0, c.j0), *a10 = height_at(l, &t, c.i1, c.j0);
    Inst *a01 = height_at(l, &t, c.i0, c.j1), *a11 = height_at(l, &t, c.i1, c.j1);
    if (e->method == M_HEIGHT) {
        v.c[0] = on_cell(l, &c, a00, a10, a01, a11);
        return v;
    }
    v.c[0] = op2(l, OP_fdiv, sel(l, c.lower, op2(l, OP_fsub, a10, a00), op2(l, OP_fsub, a11, a01)), kf(l, t.dx));
    v.c[1] = op2(l, OP_fdiv, sel(l, c.lower, op2(l, OP_fsub, a01, a00), op2(l, OP_fsub, a11, a10)), kf(l, t.dy));
    /* Constant on each triangle: it jumps on the edges of the grid, which move with p. */
    for (uint32_t i = 0; i < 2; i++) site_untracked(l, v.c[i], p.c[0], p.c[1], e->span, JUMP_ALWAYS);
    return v;
}

Val lower_method(Lower *l, Expr *e) {
    const Symbol *sym = lower_resource(l, e->a[0]);
    bool field = sym->type->kind == T_HEIGHTFIELD;
    Grid g = {sym, sym->tex_w, sym->tex_h, field ? 1 : sym->tex_c};
    if (e->method == M_SIZE) {
        Val v = val_new(l, e->type);
        v.c[0] = ki(l, g.w);
        v.c[1] = ki(l, g.h);
        return v;
    }
    return field ? heightfield_method(l, e, &g) : texture_method(l, e, &g);
}
