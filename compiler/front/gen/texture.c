/* Textures of two and three dimensions: their texels are parameters, so lookups are ordinary operations and
 * differentiable in everything. */
#include "compiler/front/gen/internal.h"

enum { MAX_AXES = 3 };

typedef struct Grid {
    const Symbol *sym;
    uint32_t axes, n[MAX_AXES], c; /* columns, rows, slices */
} Grid;

static Grid grid_of(const Symbol *sym) {
    return (Grid){sym, sym->tex_d ? 3 : 2, {sym->tex_w, sym->tex_h, sym->tex_d}, sym->tex_c};
}

/* The texel at `at`, all inside; missing channels are 0, missing alpha is 1. */
static Inst *texel(Lower *l, const Grid *g, Inst *const at[], uint32_t channel) {
    if (channel >= g->c) return kf(l, channel == 3 ? 1 : 0);
    Inst *i = at[g->axes - 1];
    uint32_t texels = g->n[g->axes - 1];
    for (uint32_t a = g->axes - 1; a-- > 0; texels *= g->n[a])
        i = op2(l, OP_iadd, op2(l, OP_imul, i, ki(l, g->n[a])), at[a]);
    if (g->c > 1) i = op2(l, OP_imul, i, ki(l, g->c));
    return param_float(l, g->sym, channel, i, (texels - 1) * g->c);
}

static Inst *clamp_to(Lower *l, Inst *i, uint32_t n) {
    return op2(l, OP_imax, op2(l, OP_imin, i, ki(l, (int64_t)n - 1)), ki(l, 0));
}

/* The two texels around a coordinate along one axis, and the weight of the second; outside the grid both are the edge.
 */
typedef struct Axis {
    Inst *i[2], *t;
} Axis;
static Axis axis(Lower *l, Inst *at, uint32_t n) {
    Axis a;
    Inst *base = op1(l, OP_ffloor, at);
    a.t = op2(l, OP_fsub, at, base);
    Inst *i = op2(l, OP_imax, op2(l, OP_imin, op1(l, OP_f2i, base), ki(l, (int64_t)n - 1)), ki(l, -1));
    range_set(l, i, -1, (int64_t)n - 1);
    a.i[0] = op2(l, OP_imax, i, ki(l, 0));
    a.i[1] = op2(l, OP_imin, op2(l, OP_iadd, i, ki(l, 1)), ki(l, (int64_t)n - 1));
    return a;
}

static Inst *mix(Lower *l, Inst *a, Inst *b, Inst *t) {
    return op2(l, OP_fadd, a, op2(l, OP_fmul, t, op2(l, OP_fsub, b, a)));
}

/* Linear along the axes 0 .. axes - 1; further ones are settled in `at`. */
static Inst *interpolate(Lower *l, const Grid *g, const Axis *around, uint32_t axes, Inst *at[], uint32_t channel) {
    if (!axes) return texel(l, g, at, channel);
    Inst *end[2];
    for (int k = 0; k < 2; k++) {
        at[axes - 1] = around[axes - 1].i[k];
        end[k] = interpolate(l, g, around, axes - 1, at, channel);
    }
    return mix(l, end[0], end[1], around[axes - 1].t);
}

Val gen_texture(Lower *l, Expr *e, const Symbol *sym) {
    const Grid grid = grid_of(sym), *g = &grid;
    Val v = val_new(l, e->type), place = gen_expr(l, e->args[0]);
    Inst *at[MAX_AXES];
    if (e->method == M_LOAD || e->method == M_LOAD3D) {
        for (uint32_t a = 0; a < g->axes; a++) at[a] = clamp_to(l, place.c[a], g->n[a]);
        for (uint32_t c = 0; c < v.n; c++) v.c[c] = texel(l, g, at, c);
        return v;
    }
    /* v up, row 0 at the top, slice 0 at w = 0, texel centres at (i + 0.5) / n. */
    for (uint32_t a = 0; a < g->axes; a++)
        at[a] = op2(l, OP_fmul, a == 1 ? op2(l, OP_fsub, kf(l, 1), place.c[a]) : place.c[a], kf(l, g->n[a]));
    if (e->method == M_NEAREST || e->method == M_NEAREST3D) {
        Inst *whole[MAX_AXES];
        for (uint32_t a = 0; a < g->axes; a++)
            whole[a] = site_integer(l, SITE_FLOOR, op1(l, OP_ffloor, at[a]), at[a], e->span);
        for (uint32_t a = 0; a < g->axes; a++) at[a] = clamp_to(l, op1(l, OP_f2i, whole[a]), g->n[a]);
        for (uint32_t c = 0; c < v.n; c++) v.c[c] = texel(l, g, at, c);
        return v;
    }
    Axis around[MAX_AXES];
    for (uint32_t a = 0; a < g->axes; a++) around[a] = axis(l, op2(l, OP_fsub, at[a], kf(l, 0.5)), g->n[a]);
    for (uint32_t c = 0; c < v.n; c++)
        v.c[c] = c < g->c ? interpolate(l, g, around, g->axes, at, c) : kf(l, c == 3 ? 1 : 0);
    return v;
}
