/* Pairs of lanes: what the event kernel asks about a sample and its neighbour. */
#include "compiler/back/cpu/emit.h"

void emit_partner(Emit *e, const Part *in, Part *out) {
    bool bits = LL(GetElementType)(LL(TypeOf)(in[0])) == e->t_i1;
    if (bits && e->opt->target.vector_bytes == 64 && e->L >= 8) {
        /* Mask registers have no shuffle: swap neighbouring bits as an integer. */
        LLVMTypeRef word = LL(IntTypeInContext)(e->ctx, e->L);
        Part even = LL(ConstInt)(word, 0x5555555555555555ull, 0), one = LL(ConstInt)(word, 1, 0);
        for (uint32_t p = 0; p < e->P; p++) {
            Part m = LL(BuildBitCast)(e->b, in[p], word, "");
            Part up = LL(BuildShl)(e->b, LL(BuildAnd)(e->b, m, even, ""), one, "");
            Part down = LL(BuildAnd)(e->b, LL(BuildLShr)(e->b, m, one, ""), even, "");
            out[p] = LL(BuildBitCast)(e->b, LL(BuildOr)(e->b, up, down, ""), LL(TypeOf)(in[p]), "");
        }
        return;
    }
    Part pick[BACK_MAX_WIDTH];
    for (uint32_t l = 0; l < e->L; l++) pick[l] = emit_int(e, e->t_i32, l ^ 1);
    for (uint32_t p = 0; p < e->P; p++)
        out[p] = LL(BuildShuffleVector)(e->b, in[p], LL(GetPoison)(LL(TypeOf)(in[p])), LL(ConstVector)(pick, e->L), "");
}

/* differ & both, the heart of the event kernel: pairs whose lanes are on and disagree. With mask registers all of this
 * is done on one bit a pair, as integers, and spread to both lanes at the end. False where i is something else. */
bool emit_pairs_apart(Emit *e, Inst *i) {
    const Inst *differ = i->args[0], *both = i->args[1];
    if (i->op != OP_band || both->op != OP_both || differ->op != OP_bxor || differ->args[1]->op != OP_partner ||
        differ->args[1]->args[0] != differ->args[0])
        return false;
    if (e->opt->target.vector_bytes != 64 || e->L < 8 || !emit_is_vector(e, i) || !emit_is_vector(e, differ->args[0]))
        return false;
    LLVMTypeRef word = LL(IntTypeInContext)(e->ctx, e->L);
    Part even = LL(ConstInt)(word, 0x5555555555555555ull, 0), one = LL(ConstInt)(word, 1, 0);
    Part *decision = emit_slot(e, differ->args[0]), *out = emit_slot(e, i);
    for (uint32_t p = 0; p < e->P; p++) {
        Part d = LL(BuildBitCast)(e->b, decision[p], word, "");
        Part apart = LL(BuildAnd)(e->b, LL(BuildXor)(e->b, d, LL(BuildLShr)(e->b, d, one, ""), ""), even, "");
        if (e->mask) {
            Part m = LL(BuildBitCast)(e->b, e->mask[p], word, "");
            apart = LL(BuildAnd)(e->b, apart, LL(BuildAnd)(e->b, m, LL(BuildLShr)(e->b, m, one, ""), ""), "");
        }
        apart = LL(BuildOr)(e->b, apart, LL(BuildShl)(e->b, apart, one, ""), "");
        out[p] = LL(BuildBitCast)(e->b, apart, LL(TypeOf)(decision[p]), "");
    }
    return true;
}

void emit_both(Emit *e, Inst *i) {
    Part *out = emit_slot(e, i);
    if (!emit_is_vector(e, i)) {
        out[0] = emit_int(e, e->t_i1, 1);
        return;
    }
    emit_partner(e, e->mask, out); /* the partner's mask: this lane is on wherever the answer is used */
}
