/* Local arrays: [count][W] of T, or [count] where every lane has the same contents. Booleans are kept as 32-bit
 * integers. */
#include "compiler/back/cpu/emit.h"

static LLVMTypeRef element_type(Emit *e, const Inst *array) {
    return array->imm.arr.elem == TY_BOOL ? e->t_i32 : emit_scalar_type(e, array->imm.arr.elem);
}
static uint64_t array_bytes(const Emit *e, const Inst *array) {
    return (uint64_t)array->imm.arr.count * back_type_bytes(&e->plan, array->imm.arr.elem) *
           (emit_is_vector(e, array) ? e->W : 1);
}

void emit_alloc(Emit *e, Inst *i) {
    uint64_t bytes = array_bytes(e, i);
    e->frame_bytes += bytes;
    if (e->frame_bytes > BACK_MAX_FRAME) {
        emit_fail(e, "local arrays need more than %u bytes at %u lanes", BACK_MAX_FRAME, e->W);
        return;
    }
    Part p = emit_alloca(e, LL(ArrayType2)(e->t_i8, bytes ? bytes : 1), 1, 64);
    if (back_needs_zeros(i)) LL(BuildMemSet)(e->b, p, emit_int(e, e->t_i8, 0), emit_i64(e, bytes), 64);
    emit_slot(e, i)[0] = p;
}

static Part from_element(Emit *e, const Inst *array, Part v) {
    return array->imm.arr.elem == TY_BOOL
               ? LL(BuildTrunc)(e->b, v,
                                emit_is_vector(e, array) || LL(GetTypeKind)(LL(TypeOf)(v)) == LLVMVectorTypeKind
                                    ? emit_vector_type(e, e->t_i1)
                                    : e->t_i1,
                                "")
               : v;
}

static Part to_element(Emit *e, const Inst *array, Part v, bool vector) {
    return array->imm.arr.elem == TY_BOOL
               ? LL(BuildZExt)(e->b, v, vector ? emit_vector_type(e, e->t_i32) : e->t_i32, "")
               : v;
}

/* Pointers to the elements at varying indices, for part p. */
static Part element_pointers(Emit *e, const Inst *array, const Inst *index, Part v, uint32_t p) {
    Part at = emit_clamped_index(e, index, v, array->imm.arr.count);
    if (emit_is_vector(e, array)) {
        Part lanes[BACK_MAX_WIDTH];
        for (uint32_t l = 0; l < e->L; l++) lanes[l] = emit_int(e, e->t_i32, p * e->L + l);
        Part width = emit_const_like(e, LL(TypeOf)(at), e->t_i32, 0, e->W, false);
        at = LL(BuildAdd)(e->b, LL(BuildMul)(e->b, at, width, ""), LL(ConstVector)(lanes, e->L), "");
    }
    return emit_gep(e, element_type(e, array), emit_slot(e, array)[0], at);
}

/* Pointer to part p of the element at a uniform index (already 64-bit). */
static Part element_pointer(Emit *e, const Inst *array, Part index, uint32_t p) {
    if (emit_is_vector(e, array)) {
        index = LL(BuildMul)(e->b, index, emit_i64(e, e->W), "");
        index = LL(BuildAdd)(e->b, index, emit_i64(e, (uint64_t)p * e->L), "");
    }
    return emit_gep(e, element_type(e, array), emit_slot(e, array)[0], index);
}

void emit_array_load(Emit *e, Inst *i) {
    const Inst *array = i->args[0], *index = i->args[1];
    LLVMTypeRef t = element_type(e, array);
    unsigned bytes = back_type_bytes(&e->plan, array->imm.arr.elem);
    Part *out = emit_slot(e, i);
    if (emit_is_vector(e, index)) {
        for (uint32_t p = 0; p < e->P; p++)
            out[p] = from_element(
                e, array, emit_gather(e, t, element_pointers(e, array, index, emit_slot(e, index)[p], p), bytes));
        return;
    }
    Part at = emit_scalar_index(e, index, array->imm.arr.count);
    bool vector = emit_is_vector(e, array);
    for (uint32_t p = 0; p < (vector ? e->P : 1); p++)
        out[p] = from_element(e, array,
                              emit_load(e, vector ? emit_vector_type(e, t) : t, element_pointer(e, array, at, p),
                                        vector ? emit_part_align(e, bytes) : bytes, false));
}

void emit_array_store(Emit *e, Inst *i) {
    const Inst *array = i->args[0], *index = i->args[1];
    LLVMTypeRef t = element_type(e, array);
    unsigned bytes = back_type_bytes(&e->plan, array->imm.arr.elem);
    if (!emit_is_vector(e, array)) {
        Part at = emit_scalar_index(e, index, array->imm.arr.count);
        emit_store(e, to_element(e, array, emit_scalar(e, i->args[2]), false), element_pointer(e, array, at, 0), bytes);
        return;
    }
    Part value[BACK_MAX_PARTS];
    emit_parts(e, i->args[2], value);
    /* lanes that were dead when the array was made never read it */
    bool masked = e->mask && back_diverges_between(i->block, array->block);
    if (emit_is_vector(e, index)) {
        for (uint32_t p = 0; p < e->P; p++)
            emit_scatter(e, to_element(e, array, value[p], true),
                         element_pointers(e, array, index, emit_slot(e, index)[p], p), bytes,
                         masked ? e->mask[p] : NULL);
        return;
    }
    Part at = emit_scalar_index(e, index, array->imm.arr.count);
    for (uint32_t p = 0; p < e->P; p++) {
        Part to = element_pointer(e, array, at, p), v = to_element(e, array, value[p], true);
        if (masked)
            v = LL(BuildSelect)(e->b, e->mask[p], v,
                                emit_load(e, emit_vector_type(e, t), to, emit_part_align(e, bytes), false), "");
        emit_store(e, v, to, emit_part_align(e, bytes));
    }
}

void emit_array_copy(Emit *e, Inst *i) {
    const Inst *to = i->args[0], *from = i->args[1];
    bool masked = emit_is_vector(e, to) && e->mask && back_diverges_between(i->block, to->block);
    if (!masked && emit_is_vector(e, to) == emit_is_vector(e, from)) {
        LL(BuildMemCpy)(e->b, emit_slot(e, to)[0], 64, emit_slot(e, from)[0], 64, emit_i64(e, array_bytes(e, to)));
        return;
    }
    LLVMTypeRef t = element_type(e, to), v = emit_vector_type(e, t);
    unsigned bytes = back_type_bytes(&e->plan, to->imm.arr.elem);
    LLVMBasicBlockRef before = emit_here(e), body = emit_new_block(e, "copy"), done = emit_new_block(e, "copied");
    LL(BuildBr)(e->b, body);
    emit_at(e, body);
    Part k = emit_phi(e, e->t_i64, "k");
    emit_incoming(e, k, emit_i64(e, 0), before);
    Part scalar =
        emit_is_vector(e, from) ? NULL : emit_splat(e, emit_load(e, t, element_pointer(e, from, k, 0), bytes, false));
    for (uint32_t p = 0; p < e->P; p++) {
        Part x = scalar ? scalar : emit_load(e, v, element_pointer(e, from, k, p), emit_part_align(e, bytes), false),
             at = element_pointer(e, to, k, p);
        if (masked) x = LL(BuildSelect)(e->b, e->mask[p], x, emit_load(e, v, at, emit_part_align(e, bytes), false), "");
        emit_store(e, x, at, emit_part_align(e, bytes));
    }
    Part next = LL(BuildAdd)(e->b, k, emit_i64(e, 1), "");
    emit_incoming(e, k, next, body);
    LL(BuildCondBr)(e->b, LL(BuildICmp)(e->b, LLVMIntULT, next, emit_i64(e, to->imm.arr.count), ""), body, done);
    emit_at(e, done);
}
