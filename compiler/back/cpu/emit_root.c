/* A root that is only compared: sqrt(v) < r, or sqrt(v) - r < 0, of a sum of squares v and an r that all lanes share.
 * As rounded, sqrt(v) is below r just where v is below the least float whose root is not. Roots round to r, or to more,
 * from the midpoint of r and the float before it on: a number of 25 bits, which doubles hold, as they do its square, of
 * 50. No float is that square, since its last bit is odd; so the next float above it is the bound, exactly, and every
 * decision is what it was. Instead of a root a lane it takes some scalars. */
#include "compiler/back/cpu/emit.h"

enum { TERMS = 4 /* of sums of squares that are looked through */ };

/* Never -1, say, and never -0 where the root of 0 would tell. */
static bool is_sum_of_squares(const Inst *v, uint32_t depth) {
    switch (v->op) {
    case OP_fmul: return v->args[0] == v->args[1];
    case OP_ffma: return v->args[0] == v->args[1] && depth && is_sum_of_squares(v->args[2], depth - 1);
    case OP_fadd: return depth && is_sum_of_squares(v->args[0], depth - 1) && is_sum_of_squares(v->args[1], depth - 1);
    default: return false;
    }
}

static bool is_used_once(Emit *e, const Inst *i) { return emit_uses(e)[i->id] == 1; }

/* The least float whose root is not below r: 0 where r is not positive, or not a number. */
static Part bound_of_squares(Emit *e, Part r) {
    Part bits = LL(BuildBitCast)(e->b, r, e->t_i32, ""),
         before = LL(BuildBitCast)(e->b, LL(BuildSub)(e->b, bits, emit_int(e, e->t_i32, 1), ""), e->t_f32, "");
    Part twice =
             LL(BuildFAdd)(e->b, LL(BuildFPExt)(e->b, r, e->t_f64, ""), LL(BuildFPExt)(e->b, before, e->t_f64, ""), ""),
         middle = LL(BuildFMul)(e->b, twice, LL(ConstReal)(e->t_f64, 0.5), ""),
         square = LL(BuildFMul)(e->b, middle, middle, ""), near = LL(BuildFPTrunc)(e->b, square, e->t_f32, "");
    Part next = LL(BuildAdd)(e->b, LL(BuildBitCast)(e->b, near, e->t_i32, ""), emit_int(e, e->t_i32, 1), ""),
         below = LL(BuildFCmp)(e->b, LLVMRealOLT, LL(BuildFPExt)(e->b, near, e->t_f64, ""), square, "");
    Part least = LL(BuildSelect)(e->b, below, LL(BuildBitCast)(e->b, next, e->t_f32, ""), near, ""),
         zero = LL(ConstReal)(e->t_f32, 0);
    return LL(BuildSelect)(e->b, LL(BuildFCmp)(e->b, LLVMRealOGT, r, zero, ""), least, zero, "");
}

const Inst *emit_compared_root(Emit *e, const Inst *i, Part *bound) {
    if (i->op != OP_flt || e->fn->precision != PREC_F32 || !emit_is_vector(e, i)) return NULL;
    const Inst *root = i->args[0], *r = i->args[1];
    if (root->op == OP_fsub && r->op == OP_constf && r->imm.f == 0) {
        if (!is_used_once(e, root)) return NULL;
        r = root->args[1], root = root->args[0];
    }
    if (root->op != OP_fsqrt || emit_is_vector(e, r) || !emit_is_vector(e, root) || !is_used_once(e, root) ||
        !is_sum_of_squares(root->args[0], TERMS))
        return NULL;
    *bound = bound_of_squares(e, emit_scalar(e, r));
    return root->args[0];
}
