/* What every file that touches memory needs: sizes and alignments, addresses, clamped indices, gathers and scatters,
 * the lanes that count; and which of them emits what. */
#include "compiler/back/cpu/emit.h"

#include "compiler/ir/range.h"

unsigned emit_part_align(const Emit *e, unsigned element) { return e->L * element > 64 ? 64 : e->L * element; }
Part emit_i64(Emit *e, uint64_t v) { return emit_int(e, e->t_i64, v); }
Part emit_at_byte(Emit *e, Part base, uint64_t offset) { return emit_gep(e, e->t_i8, base, emit_i64(e, offset)); }
Part emit_all_on(Emit *e) { return LL(ConstAllOnes)(emit_vector_type(e, e->t_i1)); }

Part emit_gather(Emit *e, LLVMTypeRef scalar, Part pointers, unsigned align) {
    LLVMTypeRef v = emit_vector_type(e, scalar), types[2] = {v, LL(TypeOf)(pointers)};
    unsigned id = LL(LookupIntrinsicID)("llvm.masked.gather", 18);
    Part f = LL(GetIntrinsicDeclaration)(e->mod, id, types, 2);
    Part args[4] = {pointers, emit_int(e, e->t_i32, align), emit_all_on(e), LL(ConstNull)(v)};
    return LL(BuildCall2)(e->b, LL(IntrinsicGetType)(e->ctx, id, types, 2), f, args, 4, "");
}

void emit_scatter(Emit *e, Part value, Part pointers, unsigned align, Part mask) {
    LLVMTypeRef types[2] = {LL(TypeOf)(value), LL(TypeOf)(pointers)};
    unsigned id = LL(LookupIntrinsicID)("llvm.masked.scatter", 19);
    Part f = LL(GetIntrinsicDeclaration)(e->mod, id, types, 2);
    Part args[4] = {value, pointers, emit_int(e, e->t_i32, align), mask ? mask : emit_all_on(e)};
    LL(BuildCall2)(e->b, LL(IntrinsicGetType)(e->ctx, id, types, 2), f, args, 4, "");
}

Part emit_clamped_index(Emit *e, const Inst *index, Part v, uint32_t count) {
    IrRange r = ir_range_of(index, NULL, 0);
    LLVMTypeRef t = LL(TypeOf)(v);
    if (r.lo < 0) {
        Part x[2] = {v, emit_const_like(e, t, e->t_i32, 0, 0, false)};
        v = emit_intrinsic(e, "llvm.smax", t, x, 2);
    }
    if (r.hi >= count) {
        Part x[2] = {v, emit_const_like(e, t, e->t_i32, 0, count ? count - 1 : 0, false)};
        v = emit_intrinsic(e, "llvm.smin", t, x, 2);
    }
    return v;
}

Part emit_scalar_index(Emit *e, const Inst *index, uint32_t count) {
    return LL(BuildZExt)(e->b, emit_clamped_index(e, index, emit_scalar(e, index), count), e->t_i64, "");
}

/* Lanes of part p whose sample is one the caller asked for. */
static Part valid_lanes(Emit *e, uint32_t p) {
    Part n = emit_load(e, e->t_i32, emit_field_ptr(e, offsetof(SltKernelArgs, n_valid)), 4, true);
    Part i = LL(BuildTrunc)(e->b, e->i, e->t_i32, "");
    if (e->W == 1) return LL(BuildICmp)(e->b, LLVMIntULT, i, n, "");
    Part lanes[BACK_MAX_WIDTH];
    for (uint32_t l = 0; l < e->L; l++) lanes[l] = emit_int(e, e->t_i32, p * e->L + l);
    Part index = LL(BuildAdd)(e->b, emit_splat(e, i), LL(ConstVector)(lanes, e->L), "");
    return LL(BuildICmp)(e->b, LLVMIntULT, index, emit_splat(e, n), "");
}

Part emit_counting_lanes(Emit *e, uint32_t p, Part cond) {
    Part m = e->spread ? emit_all_on(e) : valid_lanes(e, p); /* of samples that count alone items are listed */
    if (e->mask) m = LL(BuildAnd)(e->b, m, e->mask[p], "");
    return cond ? LL(BuildAnd)(e->b, m, cond, "") : m;
}

static void emit_any_lane(Emit *e, Inst *i) {
    if (!emit_is_vector(e, i->args[0])) {
        emit_slot(e, i)[0] = emit_scalar(e, i->args[0]);
        return;
    }
    Part on[BACK_MAX_PARTS];
    emit_parts(e, i->args[0], on);
    emit_and_mask(e, on, on);
    emit_slot(e, i)[0] = emit_any(e, on);
}

void emit_memory_op(Emit *e, Inst *i) {
    switch (i->op) {
    case OP_param:
    case OP_iparam:
    case OP_dparam: emit_param(e, i); break;
    case OP_adj: emit_adjoint(e, i); break;
    case OP_query: emit_query(e, i); break;
    case OP_told: emit_told(e, i); break;
    case OP_alloc: emit_alloc(e, i); break;
    case OP_load: emit_array_load(e, i); break;
    case OP_store: emit_array_store(e, i); break;
    case OP_acopy: emit_array_copy(e, i); break;
    case OP_tapemark: emit_slot(e, i)[0] = emit_load(e, e->t_i64, e->tape_top, 8, false); break;
    case OP_tapedrop: emit_store(e, emit_scalar(e, i->args[0]), e->tape_top, 8); break;
    case OP_tapepush: emit_tapepush(e, i); break;
    case OP_partner:
        if (emit_is_vector(e, i)) emit_partner(e, emit_slot(e, i->args[0]), emit_slot(e, i));
        else emit_slot(e, i)[0] = emit_scalar(e, i->args[0]);
        break;
    case OP_any: emit_any_lane(e, i); break;
    case OP_both: emit_both(e, i); break;
    case OP_give: emit_give(e, i); break;
    case OP_take: emit_take(e, i); break;
    case OP_settled: emit_settled(e, i); break;
    case OP_choice: emit_choice(e, i); break;
    case OP_count: emit_count(e, i); break;
    case OP_print: emit_print(e, i); break;
    case OP_note: emit_note(e, i); break;
    case OP_item:
    case OP_items: emit_item(e, i); break;
    default: emit_fail(e, "%s is not supported by this back end", ir_ops[i->op].name);
    }
}
