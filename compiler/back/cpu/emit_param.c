/* Parameters, and adjoints of parameters: summed in place where the index is uniform, logged where it varies. */
#include "compiler/back/cpu/emit.h"

void emit_param(Emit *e, Inst *i) {
    Part base = i->op == OP_param ? e->params : i->op == OP_iparam ? e->iparams : e->dparams;
    LLVMTypeRef t = emit_scalar_type(e, i->type);
    unsigned bytes = back_type_bytes(&e->plan, i->type);
    base = emit_gep(e, t, base, emit_i64(e, i->imm.slot.base));
    Part *out = emit_slot(e, i);
    if (!emit_is_vector(e, i)) {
        out[0] =
            emit_load(e, t, emit_gep(e, t, base, emit_scalar_index(e, i->args[0], i->imm.slot.count)), bytes, false);
        return;
    }
    Part *index = emit_slot(e, i->args[0]);
    for (uint32_t p = 0; p < e->P; p++)
        out[p] = emit_gather(e, t, emit_gep(e, t, base, emit_clamped_index(e, i->args[0], index[p], i->imm.slot.count)),
                             bytes);
}

typedef struct Log {
    Part index, value; /* pointers to the first entry */
    Part cap, len;     /* entries, i64 */
} Log;

/* One instruction a vector where the processor moves the lanes of a mask together. */
static Part compressed(Emit *e, Part v, Part mask) {
    LLVMTypeRef t = LL(TypeOf)(v);
    unsigned id = LL(LookupIntrinsicID)("llvm.x86.avx512.mask.compress", 29);
    Part f = LL(GetIntrinsicDeclaration)(e->mod, id, &t, 1), args[3] = {v, LL(ConstNull)(t), mask};
    return LL(BuildCall2)(e->b, LL(IntrinsicGetType)(e->ctx, id, &t, 1), f, args, 3, "");
}

static void append_vector(Emit *e, Part index, Part value, Part mask, const Log *log) {
    emit_store(e, compressed(e, index, mask), emit_gep(e, e->t_i32, log->index, log->len), 4);
    emit_store(e, compressed(e, value, mask), emit_gep(e, e->t_flt, log->value, log->len), e->plan.flt_bytes);
}

/* Elsewhere lane by lane; a lane that is off is overwritten by the next. */
static void append_lanes(Emit *e, Part index, Part value, Part bits, const Log *log) {
    Part at = log->len;
    for (uint32_t l = 0; l < e->L; l++) {
        Part lane = emit_int(e, e->t_i32, l);
        emit_store(e, e->W > 1 ? LL(BuildExtractElement)(e->b, index, lane, "") : index,
                   emit_gep(e, e->t_i32, log->index, at), 4);
        emit_store(e, e->W > 1 ? LL(BuildExtractElement)(e->b, value, lane, "") : value,
                   emit_gep(e, e->t_flt, log->value, at), e->plan.flt_bytes);
        Part bit = LL(BuildAnd)(e->b, LL(BuildLShr)(e->b, bits, emit_i64(e, l), ""), emit_i64(e, 1), "");
        at = LL(BuildAdd)(e->b, at, bit, "");
    }
}

/* Appends the lanes of one part that are on in `mask`, in lane order; returns the new length. */
static Part append(Emit *e, Part index, Part value, Part mask, Log log) {
    LLVMTypeRef t = LL(IntTypeInContext)(e->ctx, e->L);
    Part bits = e->W > 1 ? LL(BuildBitCast)(e->b, mask, t, "") : mask;
    if (e->L < 64) bits = LL(BuildZExt)(e->b, bits, e->t_i64, "");
    Part some = LL(BuildICmp)(e->b, LLVMIntNE, bits, emit_i64(e, 0), ""),
         room = LL(BuildICmp)(e->b, LLVMIntULE, log.len, log.cap, "");
    LLVMBasicBlockRef write = emit_new_block(e, "log"), done = emit_new_block(e, "logged");
    LL(BuildCondBr)(e->b, LL(BuildAnd)(e->b, some, room, ""), write, done);
    emit_at(e, write);
    if (e->opt->target.vector_bytes == 64 && e->L >= 4 && e->L * e->plan.flt_bytes <= 64)
        append_vector(e, index, value, mask, &log);
    else append_lanes(e, index, value, bits, &log);
    LL(BuildBr)(e->b, done);
    emit_at(e, done);
    return LL(BuildAdd)(e->b, log.len, emit_intrinsic(e, "llvm.ctpop", e->t_i64, &bits, 1), "");
}

static void log_adjoint(Emit *e, Inst *i) {
    Part index[BACK_MAX_PARTS], value[BACK_MAX_PARTS], mask[BACK_MAX_PARTS];
    emit_parts(e, i->args[0], index);
    emit_parts(e, i->args[1], value);
    for (uint32_t p = 0; p < e->P; p++) {
        index[p] = emit_clamped_index(e, i->args[0], index[p], i->imm.slot.count);
        index[p] = LL(BuildAdd)(e->b, index[p],
                                emit_const_like(e, LL(TypeOf)(index[p]), e->t_i32, 0, i->imm.slot.base, false), "");
        /* Zeros add nothing: texels in shadow, numbers of a geometry that the ray did not meet. */
        Part some = LL(BuildFCmp)(e->b, LLVMRealUNE, value[p], LL(ConstNull)(LL(TypeOf)(value[p])), "");
        mask[p] = emit_counting_lanes(e, p, some);
    }
    Part len_at = emit_field_ptr(e, offsetof(SltKernelArgs, log_len)), len = emit_load(e, e->t_i64, len_at, 8, false);
    Part cap = emit_load(e, e->t_i64, emit_field_ptr(e, offsetof(SltKernelArgs, log_cap)), 8, true);
    Part indices = emit_load(e, e->t_ptr, emit_field_ptr(e, offsetof(SltKernelArgs, log_index)), 8, true);
    Part values = emit_load(e, e->t_ptr, emit_field_ptr(e, offsetof(SltKernelArgs, log_value)), 8, true);
    for (uint32_t p = 0; p < e->P; p++) len = append(e, index[p], value[p], mask[p], (Log){indices, values, cap, len});
    emit_store(e, len, len_at, 8);
}

/* Sum over parts until `left` are left, halving. */
static void sum_parts(Emit *e, Part *v, uint32_t left) {
    for (uint32_t p = e->P; p > left; p /= 2)
        for (uint32_t k = 0; k < p / 2; k++) v[k] = LL(BuildFAdd)(e->b, v[k], v[k + p / 2], "");
}

/* Sum over the lanes of a part, halving: the order does not depend on how lanes were cut into parts. */
static Part sum_of_lanes(Emit *e, Part x) {
    for (uint32_t half = e->L / 2; e->W > 1 && half; half /= 2) {
        Part pick[BACK_MAX_WIDTH];
        for (uint32_t l = 0; l < e->L; l++) pick[l] = emit_int(e, e->t_i32, l < half ? l + half : l);
        x = LL(BuildFAdd)(
            e->b, x, LL(BuildShuffleVector)(e->b, x, LL(GetPoison)(LL(TypeOf)(x)), LL(ConstVector)(pick, e->L), ""),
            "");
    }
    return e->W == 1 ? x : LL(BuildExtractElement)(e->b, x, emit_int(e, e->t_i32, 0), "");
}

void emit_adjoint(Emit *e, Inst *i) {
    if (i->args[0]->flags & BACK_VARYING) {
        log_adjoint(e, i);
        return;
    }
    Part value[BACK_MAX_PARTS], index = emit_scalar_index(e, i->args[0], i->imm.slot.count);
    emit_parts(e, i->args[1], value);
    index = LL(BuildAdd)(e->b, index, emit_i64(e, i->imm.slot.base), "");
    for (uint32_t p = 0; e->mask && p < e->P; p++)
        value[p] = LL(BuildSelect)(e->b, e->mask[p], value[p], LL(ConstNull)(LL(TypeOf)(value[p])), "");
    bool flat = e->opt->adj == ADJ_FLAT;
    uint32_t lanes = back_adjoint_lanes(e->opt, e->fn->precision), parts = lanes > e->L ? lanes / e->L : 1;
    sum_parts(e, value, parts);
    if (flat) value[0] = sum_of_lanes(e, value[0]);
    Part row = emit_gep(e, e->t_flt, e->adj, flat ? index : LL(BuildMul)(e->b, index, emit_i64(e, lanes), ""));
    unsigned align = flat ? e->plan.flt_bytes : emit_part_align(e, e->plan.flt_bytes);
    for (uint32_t p = 0; p < parts && p < e->P; p++) {
        Part at = emit_gep(e, e->t_flt, row, emit_i64(e, (uint64_t)p * e->L));
        Part old = emit_load(e, LL(TypeOf)(value[p]), at, align, false);
        emit_store(e, LL(BuildFAdd)(e->b, old, value[p], ""), at, align);
    }
}
