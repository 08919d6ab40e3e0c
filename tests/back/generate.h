/* Random programs over the whole IR, for comparing compiled kernels with the interpreter. Deterministic by seed. */
#ifndef SALTUS_TESTS_BACK_GENERATE_H
#define SALTUS_TESTS_BACK_GENERATE_H

#include <stdlib.h>
#include <string.h>

#include "compiler/ir/ir.h"

enum { GEN_FLOATS = 24, GEN_INTS = 8 };

typedef struct Gen {
    Fn *fn;
    uint64_t state;
    Vec(Inst *) pool[4]; /* visible values by type: bool, int, float in TY order */
    Vec(Inst *) arrays;
    uint32_t depth, budget, loops;
    bool effects; /* counters, adjoints */
    bool fma, pairs;
    bool forward; /* nothing of the reverse mode: no tape */
} Gen;

static uint32_t gen_next(Gen *g) {
    g->state = g->state * 6364136223846793005ull + 1442695040888963407ull;
    uint32_t x = (uint32_t)(g->state >> 33);
    return x ^ (x >> 15);
}

static uint32_t gen_below(Gen *g, uint32_t n) { return gen_next(g) % n; }

static Inst *gen_pick(Gen *g, IrType t) {
    uint32_t n = g->pool[t].len;
    /* recent values are preferred: programs become deep rather than wide */
    uint32_t back = gen_below(g, 3) ? gen_below(g, n < 8 ? n : 8) : gen_below(g, n);
    return g->pool[t].data[n - 1 - back];
}

static void gen_add(Gen *g, Inst *i) {
    if (i->type == TY_BOOL || i->type == TY_INT || i->type == TY_FLT) vec_push(g->fn->arena, &g->pool[i->type], i);
}

static IrType gen_type(Gen *g) {
    uint32_t r = gen_below(g, 8);
    return r < 4 ? TY_FLT : r < 6 ? TY_INT : TY_BOOL;
}

static void gen_value(Gen *g, Builder *b) {
    for (;;) {
        Op op = (Op)gen_below(g, OP_COUNT);
        const OpInfo *o = &ir_ops[op];
        if (o->special || o->math || op == OP_fmant || ir_is_log_part(op) || op == OP_fexpo || op == OP_ftwoi ||
            op == OP_fasuint || (op == OP_ffma && !g->fma))
            continue; /* domains of normal numbers; bits of a NaN are nobody's promise */
        Inst *args[3];
        for (uint32_t j = 0; j < o->nargs; j++) {
            bool select = o->selects;
            args[j] = gen_pick(g, select && j == 0 ? TY_BOOL : (IrType)o->arg);
        }
        gen_add(g, ir_emit(b, op, o->nargs, args));
        return;
    }
}

static Inst *gen_clamp01(Builder *b, Inst *x) {
    return ir_emit2(b, OP_fmin, ir_emit2(b, OP_fmax, ir_constf(b, 0), x), ir_constf(b, 1));
}

static void gen_body(Gen *g, Builder *b, uint32_t n);

typedef struct GenScope {
    uint32_t len[4], arrays;
} GenScope;
static GenScope gen_enter(const Gen *g) {
    GenScope s = {{g->pool[0].len, g->pool[1].len, g->pool[2].len, g->pool[3].len}, g->arrays.len};
    return s;
}
static void gen_leave(Gen *g, GenScope s) {
    for (int t = 0; t < 4; t++) g->pool[t].len = s.len[t];
    g->arrays.len = s.arrays;
}

static void gen_if(Gen *g, Builder *b) {
    Inst *i = ir_if(b, gen_pick(g, TY_BOOL));
    uint32_t n = gen_below(g, 4), keep = gen_below(g, 4);
    IrType types[4];
    for (uint32_t r = 0; r < n; r++) types[r] = gen_type(g);
    g->depth++;
    for (uint32_t s = 0; s < 2; s++) {
        GenScope scope = gen_enter(g);
        Builder in = ir_at_end(g->fn, i->region[s]);
        Inst *values[4];
        for (uint32_t r = 0; r < n; r++) values[r] = gen_pick(g, types[r]);
        if (keep != s) { /* sometimes a side is empty */
            gen_body(g, &in, 1 + gen_below(g, 8));
            for (uint32_t r = 0; r < n; r++) values[r] = gen_pick(g, types[r]);
        }
        ir_yield(&in, n, values);
        gen_leave(g, scope);
    }
    g->depth--;
    for (uint32_t r = 0; r < n; r++)
        if (gen_below(g, 4)) gen_add(g, ir_proj(b, i, r));
}

static Inst *gen_carried(Gen *g, Inst *c) { return gen_below(g, 2) ? c : gen_pick(g, (IrType)c->type); }

/* The end of a loop's body, as `break` and `continue` make it: nested ifs of which one side computes nothing. Fills the
 * carried values and the flag to go on (NULL: true), which is that of the side taken. */
static void gen_end(Gen *g, Builder *b, uint32_t nest, uint32_t n, Inst *const *carried, Inst **values, Inst **flag) {
    gen_body(g, b, 1 + gen_below(g, 4));
    if (!nest || !gen_below(g, 4)) {
        for (uint32_t r = 0; r < n; r++) values[r] = gen_carried(g, carried[r]);
        *flag = gen_below(g, 2) ? gen_pick(g, TY_BOOL) : ir_constb(b, gen_below(g, 4) != 0);
        return;
    }
    Inst *i = ir_if(b, gen_pick(g, TY_BOOL)), *inner[6];
    bool leaves = gen_below(g, 2); /* then result n says whether it leaves, else whether it stays */
    uint32_t empty = gen_below(g, 2);
    g->depth++;
    for (uint32_t s = 0; s < 2; s++) {
        GenScope scope = gen_enter(g);
        Builder in = ir_at_end(g->fn, i->region[s]);
        Inst *f;
        if (s == empty) {
            for (uint32_t r = 0; r < n; r++) inner[r] = gen_carried(g, carried[r]);
            f = gen_below(g, 4) ? ir_constb(&in, gen_below(g, 2)) : gen_pick(g, TY_BOOL);
        } else {
            gen_end(g, &in, nest - 1, n, carried, inner, &f);
        }
        inner[n] = !leaves ? f : ir_is_const(f) ? ir_constb(&in, !f->imm.i) : ir_emit1(&in, OP_bnot, f);
        ir_yield(&in, n + 1, inner);
        gen_leave(g, scope);
    }
    g->depth--;
    for (uint32_t r = 0; r <= n; r++) values[r] = ir_proj(b, i, r);
    *flag = leaves ? ir_emit1(b, OP_bnot, values[n]) : values[n];
    if (!gen_below(g, 4)) *flag = ir_emit2(b, OP_band, *flag, gen_pick(g, TY_BOOL));
    for (uint32_t r = 0; r < n; r++)
        if (!gen_below(g, 8)) values[r] = gen_carried(g, carried[r]);
}

static void gen_loop(Gen *g, Builder *b) {
    uint32_t n = 1 + gen_below(g, 4), trips = 1 + gen_below(g, 5);
    Inst *init[4];
    for (uint32_t r = 0; r < n; r++) init[r] = gen_pick(g, gen_type(g));
    LoopInfo info = {.max_iters = trips, .loop_id = g->loops++};
    info.cull = gen_below(g, 4) == 0;
    info.cull_id = gen_below(g, 2);
    if (info.cull) info.max_iters = trips = 4;
    Inst *i = ir_loop(b, n, init, info);
    GenScope scope = gen_enter(g);
    Block *body = i->region[0];
    for (uint32_t r = 0; r < body->nparams; r++) gen_add(g, body->params[r]);
    Builder in = ir_at_end(g->fn, body);
    g->depth++;
    Inst *values[6], *ends = NULL;
    IrType types[4];
    for (uint32_t r = 0; r < n; r++) types[r] = (IrType)init[r]->type;
    if (gen_below(g, 2)) gen_end(g, &in, 3, n, body->params + 1, values + 1, &ends);
    else gen_body(g, &in, 2 + gen_below(g, 8));
    g->depth--;
    Inst *more = ir_emit2(&in, OP_ilt, ir_emit2(&in, OP_iadd, body->params[0], ir_consti(&in, 1)),
                          ir_consti(&in, (int32_t)trips));
    values[0] = ends              ? ir_emit2(&in, OP_band, more, ends)
                : gen_below(g, 2) ? ir_emit2(&in, OP_band, more, gen_pick(g, TY_BOOL))
                                  : more;
    for (uint32_t r = 0; r < n && !ends; r++) values[r + 1] = gen_pick(g, types[r]);
    ir_yield(&in, n + 1, values);
    gen_leave(g, scope);
    for (uint32_t r = 0; r < n; r++)
        if (gen_below(g, 4)) gen_add(g, ir_proj(b, i, r));
}

/* A loop that records frames, and the loop that unwinds them in reverse with values of both passes. */
static void gen_tape(Gen *g, Builder *b) {
    Inst *mark = ir_special(b, OP_tapemark, TY_TAPE, 0, NULL, (Imm){0});
    Inst *init[2] = {gen_pick(g, TY_FLT), gen_pick(g, TY_INT)};
    Inst *loop = ir_loop(b, 2, init, (LoopInfo){.max_iters = 4, .loop_id = g->loops++});
    Block *body = loop->region[0];
    GenScope scope = gen_enter(g);
    for (uint32_t r = 0; r < body->nparams; r++) gen_add(g, body->params[r]);
    Builder in = ir_at_end(g->fn, body);
    g->depth += 2;
    gen_body(g, &in, 3);
    Inst *frame[4] = {gen_pick(g, TY_FLT), body->params[0], gen_pick(g, TY_BOOL), gen_pick(g, TY_INT)};
    uint32_t nframe = 2 + gen_below(g, 3);
    ir_special(&in, OP_tapepush, TY_VOID, nframe, frame, (Imm){0});
    Inst *more = ir_emit2(&in, OP_ilt, body->params[0], ir_consti(&in, 3));
    Inst *y[3] = {gen_below(g, 3) ? ir_emit2(&in, OP_band, more, gen_pick(g, TY_BOOL)) : more, gen_pick(g, TY_FLT),
                  gen_pick(g, TY_INT)};
    ir_yield(&in, 3, y);
    gen_leave(g, scope);
    gen_add(g, ir_proj(b, loop, 0));
    gen_body(g, b, 2);
    Inst *back[3] = {mark, gen_pick(g, TY_FLT), gen_pick(g, TY_INT)};
    Inst *rev = ir_special(b, OP_revloop, TY_VOID, 3, back, (Imm){0});
    Block *rbody = ir_block(g->fn, rev);
    scope = gen_enter(g);
    for (uint32_t r = 0; r < nframe; r++) gen_add(g, ir_block_param(g->fn, rbody, (IrType)frame[r]->type));
    gen_add(g, ir_block_param(g->fn, rbody, TY_FLT));
    gen_add(g, ir_block_param(g->fn, rbody, TY_INT));
    Builder rin = ir_at_end(g->fn, rbody);
    gen_body(g, &rin, 4);
    g->depth -= 2;
    Inst *ry[2] = {ir_emit2(&rin, OP_fadd, gen_pick(g, TY_FLT), rbody->params[0]),
                   ir_emit2(&rin, OP_ixor, gen_pick(g, TY_INT), rbody->params[1])};
    ir_yield(&rin, 2, ry);
    gen_leave(g, scope);
    gen_add(g, ir_proj(b, rev, 0));
    gen_add(g, ir_proj(b, rev, 1));
}

static Inst *gen_array(Gen *g, Builder *b) {
    static const IrType elems[3] = {TY_FLT, TY_INT, TY_BOOL};
    if (!g->arrays.len || gen_below(g, 6) == 0) {
        Imm imm = {0};
        imm.arr.count = 1 + gen_below(g, 5);
        imm.arr.elem = elems[gen_below(g, 3)];
        Inst *a = ir_special(b, OP_alloc, TY_ARRAY, 0, NULL, imm);
        vec_push(g->fn->arena, &g->arrays, a);
        return a;
    }
    return g->arrays.data[gen_below(g, g->arrays.len)];
}

static void gen_memory(Gen *g, Builder *b) {
    Imm imm = {0};
    switch (gen_below(g, g->effects ? 9 : 7)) {
    case 0:
    case 1: {
        imm.slot.base = gen_below(g, GEN_FLOATS - 8);
        imm.slot.count = 1 + gen_below(g, 8);
        Inst *index = gen_pick(g, TY_INT);
        gen_add(g, ir_special(b, gen_below(g, 4) ? OP_param : OP_dparam, TY_FLT, 1, &index, imm));
        break;
    }
    case 2: {
        imm.slot.base = gen_below(g, 4);
        imm.slot.count = 1 + gen_below(g, 4);
        Inst *index = gen_pick(g, TY_INT);
        gen_add(g, ir_special(b, OP_iparam, TY_INT, 1, &index, imm));
        break;
    }
    case 3:
    case 4: {
        Inst *a = gen_array(g, b), *args[3] = {a, gen_pick(g, TY_INT), gen_pick(g, a->imm.arr.elem)};
        ir_special(b, OP_store, TY_VOID, 3, args, imm);
        break;
    }
    case 5: {
        Inst *a = gen_array(g, b), *args[2] = {a, gen_pick(g, TY_INT)};
        gen_add(g, ir_special(b, OP_load, a->imm.arr.elem, 2, args, imm));
        break;
    }
    case 6: {
        Inst *a = gen_array(g, b), *args[2] = {ir_special(b, OP_alloc, TY_ARRAY, 0, NULL, a->imm), a};
        vec_push(g->fn->arena, &g->arrays, args[0]);
        if (gen_below(g, 2)) {
            args[0] = a, args[1] = g->arrays.data[gen_below(g, g->arrays.len)];
            if (args[1]->imm.arr.count != a->imm.arr.count || args[1]->imm.arr.elem != a->imm.arr.elem) break;
        }
        if (args[0] != args[1]) ir_special(b, OP_acopy, TY_VOID, 2, args, imm);
        break;
    }
    case 7: {
        Inst *cond = gen_pick(g, TY_BOOL);
        imm.i = gen_below(g, 2) ? COUNTER_TRUNCATED : COUNTER_ASSERT;
        ir_special(b, OP_count, TY_VOID, 1, &cond, imm);
        break;
    }
    default: {
        Inst *v = gen_clamp01(b, gen_pick(g, TY_FLT)), *args[2] = {gen_pick(g, TY_INT), v};
        imm.slot.base = gen_below(g, GEN_FLOATS - 8);
        imm.slot.count = 1 + gen_below(g, 8);
        ir_special(b, OP_adj, TY_VOID, 2, args, imm);
    }
    }
}

/* A value of the other lane of the pair, where that lane is here too. */
static void gen_pair(Gen *g, Builder *b) {
    Inst *x = gen_pick(g, gen_type(g));
    Inst *both = ir_special(b, OP_both, TY_BOOL, 0, NULL, (Imm){0}),
         *other = ir_special(b, OP_partner, (IrType)x->type, 1, &x, (Imm){0});
    gen_add(g, ir_select(b, both, other, x));
}

static void gen_body(Gen *g, Builder *b, uint32_t n) {
    for (uint32_t k = 0; k < n && g->budget; k++) {
        g->budget--;
        uint32_t r = gen_below(g, 20);
        if (r == 0 && g->depth < 4) gen_loop(g, b);
        else if (r <= 2 && g->depth < 4) gen_if(g, b);
        else if (r == 3 && g->depth < 3 && !g->forward) gen_tape(g, b);
        else if (r <= 7) gen_memory(g, b);
        else if (r == 8 && g->pairs) gen_pair(g, b);
        else gen_value(g, b);
    }
}

/* A program of about `size` instructions with the outputs of its last values. */
static Fn *gen_fn(Session *s, Gen g, uint64_t seed, Precision p, uint32_t size) {
    g.fn = ir_fn(s, &s->module, "f", p);
    g.state = seed * 0x9e3779b97f4a7c15ull + 1, g.budget = size;
    g.fn->nfloats = GEN_FLOATS;
    g.fn->nints = GEN_INTS;
    Builder b = ir_at_end(g.fn, g.fn->body);
    for (int k = 0; k < 3; k++) gen_add(&g, ir_input(&b, IN_X0 + k));
    for (int k = 0; k < 3; k++) gen_add(&g, ir_input(&b, IN_K0 + k));
    gen_add(&g, ir_input(&b, IN_RES0));
    for (int k = 0; k < 4; k++) {
        Inst *at = ir_consti(&b, k);
        gen_add(&g, ir_special(&b, OP_iparam, TY_INT, 1, &at, (Imm){.slot = {0, GEN_INTS}}));
        gen_add(&g, ir_special(&b, OP_param, TY_FLT, 1, &at, (Imm){.slot = {4, 4}}));
        gen_add(&g, ir_constf(&b, k == 3 ? -0.5 : k));
        gen_add(&g, ir_consti(&b, k - 1));
    }
    gen_add(&g, ir_emit2(&b, OP_flt, g.pool[TY_FLT].data[0], g.pool[TY_FLT].data[1]));
    gen_add(&g, ir_emit2(&b, OP_ilt, g.pool[TY_INT].data[3], ir_consti(&b, 100)));
    gen_add(&g,
            ir_emit2(&b, OP_ine, ir_emit2(&b, OP_iand, g.pool[TY_INT].data[0], ir_consti(&b, 1)), ir_consti(&b, 0)));
    gen_body(&g, &b, size);
    Inst *out[12];
    for (uint32_t k = 0; k < 12; k++) {
        IrType t = k < 6 ? TY_FLT : k < 10 ? TY_INT : TY_BOOL;
        uint32_t n = g.pool[t].len, back = k < 6 ? k : k < 10 ? k - 6 : k - 10;
        out[k] = g.pool[t].data[back < n ? n - 1 - back : 0];
    }
    ir_yield(&b, 12, out);
    ir_number(g.fn);
    return g.fn;
}

static inline Fn *gen_wild(Session *s, uint64_t seed, Precision p, uint32_t size, bool fma, bool pairs) {
    return gen_fn(s, (Gen){.effects = true, .fma = fma, .pairs = pairs}, seed, p, size);
}

#endif
