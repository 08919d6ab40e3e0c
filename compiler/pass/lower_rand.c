/* rand n -> the counter hash of ir_rand_u32 in integer operations, and the stratified number 0 from the runtime. */
#include "compiler/pass/pass.h"

static Inst *hash(Builder *b, Inst *stream, Inst *n) {
    Inst *mul = ir_consti(b, (int32_t)IR_RAND_MUL), *x = n, *y = NULL, *key = stream;
    for (int round = 0; round < IR_RAND_ROUNDS; round++) {
        Inst *hi = ir_emit2(b, OP_umulh, x, mul), *lo = ir_emit2(b, OP_imul, x, mul);
        x = ir_emit2(b, OP_ixor, hi, key);
        if (y) x = ir_emit2(b, OP_ixor, x, y); /* the second word starts as 0 */
        y = lo;
        if (round + 1 < IR_RAND_ROUNDS) key = ir_emit2(b, OP_iadd, key, ir_consti(b, (int32_t)IR_RAND_WEYL));
    }
    return x;
}

static Inst *expand(Inst *rand, Fn *fn) {
    Builder b = ir_before(fn, rand);
    Inst *n = rand->args[0];
    bool is_const = n->op == OP_consti;
    if (is_const && n->imm.i == 0) return ir_input(&b, IN_RAND0);
    Inst *bits = ir_emit2(&b, OP_ushr, hash(&b, ir_input(&b, IN_STREAM), n), ir_consti(&b, 8));
    Inst *u = ir_emit2(&b, OP_fmul, ir_emit1(&b, OP_i2f, bits), ir_constf(&b, 0x1p-24));
    if (is_const) return u;
    return ir_select(&b, ir_emit2(&b, OP_ieq, n, ir_consti(&b, 0)), ir_input(&b, IN_RAND0), u);
}

static bool lower_block(Fn *fn, Block *b, Inst **map) {
    bool changed = false;
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        for (uint32_t r = 0; r < i->nregions; r++) changed |= lower_block(fn, i->region[r], map);
        if (i->op != OP_rand) continue;
        map[i->id] = expand(i, fn);
        ir_unlink(i);
        changed = true;
    }
    return changed;
}

bool lower_rand(PassCtx *ctx, Fn *fn) {
    Arena *scratch = &ctx->session->scratch;
    ArenaMark m = arena_mark(scratch);
    uint32_t n = ir_number(fn);
    Inst **map = ARENA_ARRAY(scratch, Inst *, n + 1);
    bool changed = lower_block(fn, fn->body, map);
    if (changed) ir_replace_all(fn, map);
    arena_reset(scratch, m);
    return changed;
}
