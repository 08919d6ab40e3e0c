#include "tests/ad/random_program.h"

enum { MAX_ENV = 256, MAX_ARRAYS = 8 };

typedef struct Gen {
    Fn *fn;
    Builder b;
    RandomShape shape;
    uint64_t state;
    Inst *f[MAX_ENV], *i[MAX_ENV], *a[MAX_ARRAYS]; /* what is visible here */
    uint32_t nf, ni, na, loops;
} Gen;

static uint32_t roll(Gen *g, uint32_t n) {
    g->state = g->state * 6364136223846793005ull + 1442695040888963407ull;
    return (uint32_t)(g->state >> 33) % n;
}
static double real(Gen *g, double lo, double hi) { return lo + (hi - lo) * roll(g, 10000) / 10000.0; }
static Inst *flt(Gen *g) { return g->f[roll(g, 3) ? g->nf - 1 - roll(g, g->nf < 6 ? g->nf : 6) : roll(g, g->nf)]; }
static Inst *num(Gen *g) { return g->i[roll(g, g->ni)]; }
static void add_f(Gen *g, Inst *v) {
    if (g->nf < MAX_ENV) g->f[g->nf++] = v;
}
static void add_i(Gen *g, Inst *v) {
    if (g->ni < MAX_ENV) g->i[g->ni++] = v;
}
static Inst *k(Gen *g, double v) { return ir_constf(&g->b, v); }
static Inst *op1(Gen *g, Op op, Inst *x) { return ir_emit1(&g->b, op, x); }
static Inst *op2(Gen *g, Op op, Inst *x, Inst *y) { return ir_emit2(&g->b, op, x, y); }
static Inst *square_plus(Gen *g, Inst *x, double c) { return op2(g, OP_fadd, op2(g, OP_fmul, x, x), k(g, c)); }
static Inst *bounded(Gen *g, Inst *x) {
    switch (roll(g, 3)) {
    case 0: return op1(g, OP_fsin, x);
    case 1: return op1(g, OP_ftanh, x);
    default: return op2(g, OP_fmin, op2(g, OP_fmax, x, k(g, -1.7)), k(g, 1.9));
    }
}

static Inst *condition(Gen *g) {
    switch (roll(g, 6)) {
    case 0: return op2(g, OP_band, op2(g, OP_flt, flt(g), flt(g)), op2(g, OP_fle, flt(g), k(g, 0.4)));
    case 1: return op2(g, OP_ilt, num(g), ir_consti(&g->b, 2));
    case 2: return op1(g, OP_bnot, op2(g, OP_flt, flt(g), k(g, -0.3)));
    default: return op2(g, OP_flt, flt(g), k(g, real(g, -0.5, 0.5)));
    }
}

static Inst *parameter(Gen *g) {
    Imm m = {0};
    Inst *index;
    m.slot.base = roll(g, g->shape.nfloats);
    m.slot.count = 1 + roll(g, g->shape.nfloats - m.slot.base);
    index = roll(g, 2) ? num(g) : ir_consti(&g->b, (int32_t)roll(g, m.slot.count));
    return ir_special(&g->b, OP_param, TY_FLT, 1, &index, m);
}

static Inst *expression(Gen *g) {
    Inst *x = flt(g), *y = flt(g);
    switch (roll(g, 26)) {
    case 0:
    case 1: return op2(g, OP_fadd, x, y);
    case 2: return op2(g, OP_fsub, x, y);
    case 3:
    case 4:
    case 5: return bounded(g, op2(g, OP_fmul, x, y));
    case 6: return op2(g, OP_fdiv, x, square_plus(g, y, 0.5));
    case 7: return op1(g, OP_fneg, x);
    case 8: return bounded(g, ir_emit3(&g->b, OP_ffma, x, y, flt(g)));
    case 9: return op1(g, OP_fabs, x);
    case 10: return op2(g, OP_fmin, x, y);
    case 11: return op2(g, OP_fmax, x, y);
    case 12: return op1(g, OP_fsqrt, square_plus(g, x, 0.1));
    case 13: return op1(g, OP_fexp, op2(g, OP_fmin, x, k(g, 0.5)));
    case 14: return op1(g, OP_flog, square_plus(g, x, 0.4));
    case 15: return op1(g, OP_fsin, x);
    case 16: return op1(g, OP_fcos, x);
    case 17: return op2(g, OP_fatan2, x, square_plus(g, y, 0.3));
    case 18: return bounded(g, op2(g, OP_fpow, square_plus(g, x, 0.5), bounded(g, y)));
    case 19: return ir_select(&g->b, condition(g), x, y);
    case 20: return op1(g, OP_ftanh, x);
    case 21: return op2(g, OP_fadd, op1(g, OP_ffloor, x), y);
    case 22: return op1(g, OP_i2f, op2(g, OP_iand, num(g), ir_consti(&g->b, 3)));
    case 23: return op1(g, OP_frsqrt, square_plus(g, x, 0.6));
    case 24: return op1(g, OP_ferf, x);
    default: return parameter(g);
    }
}

static void gen_block(Gen *g, uint32_t depth);

typedef struct Env {
    uint32_t nf, ni, na;
} Env;
static Env enter(Gen *g) { return (Env){g->nf, g->ni, g->na}; }
static void leave(Gen *g, Env e) { g->nf = e.nf, g->ni = e.ni, g->na = e.na; }

static void gen_if(Gen *g, uint32_t depth) {
    uint32_t n = 1 + roll(g, 3);
    bool one_sided = roll(g, 2);
    Inst *keep[3];
    for (uint32_t r = 0; r < n; r++) keep[r] = flt(g);
    Inst *i = ir_if(&g->b, condition(g));
    Builder outer = g->b;
    for (uint32_t side = 0; side < 2; side++) {
        Env e = enter(g);
        g->b = ir_at_end(g->fn, i->region[side]);
        Inst *y[3];
        if (side == 0 || !one_sided) gen_block(g, depth);
        for (uint32_t r = 0; r < n; r++) y[r] = side == 1 && one_sided ? keep[r] : roll(g, 4) ? flt(g) : keep[r];
        ir_yield(&g->b, n, y);
        leave(g, e);
    }
    g->b = outer;
    for (uint32_t r = 0; r < n; r++) add_f(g, ir_proj(&g->b, i, r));
}

static void gen_loop(Gen *g, uint32_t depth) {
    uint32_t n = 1 + roll(g, 3), max = 1 + roll(g, depth > 1 ? 4 : 9);
    bool exact = roll(g, 2), sparse = roll(g, 3) == 0;
    Inst *init[3], *next[4];
    for (uint32_t c = 0; c < n; c++) init[c] = flt(g);
    Inst *i = ir_loop(&g->b, n, init, (LoopInfo){.max_iters = max, .exact = exact, .loop_id = g->loops++});
    Builder outer = g->b;
    Env e = enter(g);
    Block *body = i->region[0];
    g->b = ir_at_end(g->fn, body);
    add_i(g, body->params[0]);
    for (uint32_t c = 0; c < n; c++) add_f(g, body->params[c + 1]);
    if (sparse) { /* the shape of a painter's loop */
        Inst *cond = condition(g), *taken = ir_if(&g->b, cond);
        Builder at = g->b;
        Env inner = enter(g);
        g->b = ir_at_end(g->fn, taken->region[0]);
        gen_block(g, depth);
        for (uint32_t c = 0; c < n; c++) next[c] = bounded(g, flt(g));
        ir_yield(&g->b, n, next);
        leave(g, inner);
        g->b = ir_at_end(g->fn, taken->region[1]);
        ir_yield(&g->b, n, body->params + 1);
        g->b = at;
        for (uint32_t c = 0; c < n; c++) next[c + 1] = ir_proj(&g->b, taken, c);
    } else {
        gen_block(g, depth);
        for (uint32_t c = 0; c < n; c++)
            next[c + 1] =
                roll(g, 3) == 0 ? op2(g, OP_fadd, body->params[c + 1], bounded(g, flt(g))) : bounded(g, flt(g));
    }
    next[0] = op2(g, OP_ilt, body->params[0], ir_consti(&g->b, (int32_t)max - 1));
    if (!exact) next[0] = op2(g, OP_band, next[0], condition(g));
    ir_yield(&g->b, n + 1, next);
    leave(g, e);
    g->b = outer;
    for (uint32_t c = 0; c < n; c++) add_f(g, ir_proj(&g->b, i, c));
}

static Inst *index_of(Gen *g) { return roll(g, 3) ? num(g) : op1(g, OP_f2i, op2(g, OP_fmul, flt(g), k(g, 2.3))); }

static void gen_array(Gen *g) {
    if (g->na == 0 || (g->na < MAX_ARRAYS && roll(g, 5) == 0)) {
        Imm m = {0};
        m.arr.count = 4; /* all of one shape, so that they can be copied */
        m.arr.elem = TY_FLT;
        g->a[g->na++] = ir_special(&g->b, OP_alloc, TY_ARRAY, 0, NULL, m);
    }
    Inst *a = g->a[roll(g, g->na)];
    switch (roll(g, 5)) {
    case 0:
    case 1: add_f(g, ir_special(&g->b, OP_load, TY_FLT, 2, (Inst *[]){a, index_of(g)}, (Imm){0})); break;
    case 2: ir_special(&g->b, OP_acopy, TY_VOID, 2, (Inst *[]){a, g->a[roll(g, g->na)]}, (Imm){0}); break;
    default: {
        Inst *index = index_of(g), *v = bounded(g, flt(g));
        ir_special(&g->b, OP_store, TY_VOID, 3, (Inst *[]){a, index, v}, (Imm){0});
    }
    }
}

static void gen_block(Gen *g, uint32_t depth) {
    uint32_t n = 1 + roll(g, g->shape.statements);
    for (uint32_t s = 0; s < n; s++) {
        uint32_t what = roll(g, 10);
        if (what < 2 && depth > 0 && !g->shape.no_ifs) gen_if(g, depth - 1);
        else if (what < 4 && depth > 0 && !g->shape.no_loops) gen_loop(g, depth - 1);
        else if (what < 6 && !g->shape.no_arrays) gen_array(g);
        else if (what == 6) add_i(g, op2(g, roll(g, 2) ? OP_iadd : OP_ixor, num(g), num(g)));
        else add_f(g, expression(g));
    }
}

Fn *random_program(Session *s, Arena *arena, Precision precision, uint64_t seed, RandomShape shape) {
    if (!shape.statements) shape.statements = 8;
    if (!shape.depth) shape.depth = 3;
    if (!shape.nfloats) shape.nfloats = 12;
    if (!shape.outputs) shape.outputs = 2;
    Gen *g = ARENA_NEW(arena, Gen);
    *g = (Gen){.fn = ir_fn(s, arena, "random", precision), .shape = shape, .state = seed * 0x9E3779B97F4A7C15ull + 1};
    g->fn->nfloats = shape.nfloats;
    g->fn->dim = 2;
    g->fn->channels = shape.outputs;
    g->b = ir_at_end(g->fn, g->fn->body);
    for (int n = 0; n < 4; n++) add_i(g, ir_consti(&g->b, n));
    add_f(g, ir_input(&g->b, IN_X0));
    add_f(g, ir_input(&g->b, IN_X1));
    for (int n = 0; n < 3; n++) add_f(g, parameter(g));
    for (int n = 0; n < 3; n++) gen_block(g, shape.depth);
    Inst *out[4];
    for (uint32_t o = 0; o < shape.outputs; o++) out[o] = op2(g, OP_fadd, flt(g), op2(g, OP_fmul, flt(g), k(g, 0.3)));
    ir_yield(&g->b, shape.outputs, out);
    ir_name_outputs(g->fn, SLT_OUT_F);
    return g->fn;
}
