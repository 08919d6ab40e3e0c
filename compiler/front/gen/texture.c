/* Textures: their texels are parameters, so lookups are ordinary operations and differentiable in everything. */
#include "compiler/front/gen/internal.h"

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

static Inst *clamp_to(Lower *l, Inst *i, uint32_t n) {
    return op2(l, OP_imax, op2(l, OP_imin, i, ki(l, (int64_t)n - 1)), ki(l, 0));
}

/* The two texels around a coordinate along one axis, and the weight of the second; outside the grid both are the edge.
 */
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

static Inst *mix(Lower *l, Inst *a, Inst *b, Inst *t) {
    return op2(l, OP_fadd, a, op2(l, OP_fmul, t, op2(l, OP_fsub, b, a)));
}

Val gen_texture(Lower *l, Expr *e, const Symbol *sym) {
    const Grid *g = &(Grid){sym, sym->tex_w, sym->tex_h, sym->tex_c};
    Val v = val_new(l, e->type), at = gen_expr(l, e->args[0]);
    if (e->method == M_LOAD) {
        Inst *x = clamp_to(l, at.c[0], g->w), *y = clamp_to(l, at.c[1], g->h);
        for (uint32_t c = 0; c < v.n; c++) v.c[c] = texel(l, g, x, y, c);
        return v;
    }
    /* v up, row 0 at the top, texel centres at (i + 0.5) / n. */
    Inst *px = op2(l, OP_fmul, at.c[0], kf(l, g->w)),
         *py = op2(l, OP_fmul, op2(l, OP_fsub, kf(l, 1), at.c[1]), kf(l, g->h));
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
