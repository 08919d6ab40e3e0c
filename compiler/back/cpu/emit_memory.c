/* Everything that touches memory or leaves the kernel: parameters, local arrays, adjoints, the tape, counters, print,
 * pairs of lanes. */
#include "compiler/back/cpu/emit.h"

#include <string.h>

/* ---- shared helpers */
static unsigned flt_bytes(const Emit *e) { return e->fn->precision == PREC_F64 ? 8 : 4; }
static unsigned type_bytes(const Emit *e, uint8_t type) {
    return type == TY_FLT ? flt_bytes(e) : type == TY_TAPE ? 8 : 4;
}
static unsigned part_align(const Emit *e, unsigned element) { return e->L * element > 64 ? 64 : e->L * element; }
static Part k64(Emit *e, uint64_t v) { return emit_int(e, e->t_i64, v); }
static Part at_byte(Emit *e, Part base, uint64_t offset) { return emit_gep(e, e->t_i8, base, k64(e, offset)); }
static Part all_on(Emit *e) { return LL(ConstAllOnes)(emit_vector_type(e, e->t_i1)); }

static Part gather(Emit *e, LLVMTypeRef scalar, Part pointers, unsigned align) {
    LLVMTypeRef v = emit_vector_type(e, scalar), types[2] = {v, LL(TypeOf)(pointers)};
    unsigned id = LL(LookupIntrinsicID)("llvm.masked.gather", 18);
    Part f = LL(GetIntrinsicDeclaration)(e->mod, id, types, 2);
    Part args[4] = {pointers, emit_int(e, e->t_i32, align), all_on(e), LL(ConstNull)(v)};
    return LL(BuildCall2)(e->b, LL(IntrinsicGetType)(e->ctx, id, types, 2), f, args, 4, "");
}

static void scatter(Emit *e, Part value, Part pointers, unsigned align, Part mask) {
    LLVMTypeRef types[2] = {LL(TypeOf)(value), LL(TypeOf)(pointers)};
    unsigned id = LL(LookupIntrinsicID)("llvm.masked.scatter", 19);
    Part f = LL(GetIntrinsicDeclaration)(e->mod, id, types, 2);
    Part args[4] = {value, pointers, emit_int(e, e->t_i32, align), mask ? mask : all_on(e)};
    LL(BuildCall2)(e->b, LL(IntrinsicGetType)(e->ctx, id, types, 2), f, args, 4, "");
}

/* index clamped to [0, count - 1], as cheaply as what is known about it allows. */
static Part clamped(Emit *e, const Inst *index, Part v, uint32_t count) {
    int64_t lo = INT32_MIN, hi = INT32_MAX;
    back_int_range(index, &lo, &hi);
    LLVMTypeRef t = LL(TypeOf)(v);
    if (lo < 0) {
        Part x[2] = {v, emit_const_like(e, t, e->t_i32, 0, 0, false)};
        v = emit_intrinsic(e, "llvm.smax", t, x, 2);
    }
    if (hi >= (int64_t)count) {
        Part x[2] = {v, emit_const_like(e, t, e->t_i32, 0, count ? count - 1 : 0, false)};
        v = emit_intrinsic(e, "llvm.smin", t, x, 2);
    }
    return v;
}

static Part scalar_index(Emit *e, const Inst *index, uint32_t count) {
    return LL(BuildZExt)(e->b, clamped(e, index, emit_scalar(e, index), count), e->t_i64, "");
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

/* The executing lanes of part p that count, further narrowed by `cond` (may be NULL). */
static Part counting_lanes(Emit *e, uint32_t p, Part cond) {
    Part m = valid_lanes(e, p);
    if (e->mask) m = LL(BuildAnd)(e->b, m, e->mask[p], "");
    return cond ? LL(BuildAnd)(e->b, m, cond, "") : m;
}

/* ---- parameters */
static void emit_param(Emit *e, Inst *i) {
    Part base = i->op == OP_param ? e->params : i->op == OP_iparam ? e->iparams : e->dparams;
    LLVMTypeRef t = emit_scalar_type(e, i->type);
    unsigned bytes = type_bytes(e, i->type);
    base = emit_gep(e, t, base, k64(e, i->imm.slot.base));
    Part *out = emit_slot(e, i);
    if (!emit_is_vector(e, i)) {
        out[0] = emit_load(e, t, emit_gep(e, t, base, scalar_index(e, i->args[0], i->imm.slot.count)), bytes, false);
        return;
    }
    Part *index = emit_slot(e, i->args[0]);
    for (uint32_t p = 0; p < e->P; p++)
        out[p] = gather(e, t, emit_gep(e, t, base, clamped(e, i->args[0], index[p], i->imm.slot.count)), bytes);
}

/* ---- local arrays: [count][W] of T, or [count] where every lane has the same contents. Booleans are kept as 32-bit
 * integers. */
static LLVMTypeRef element_type(Emit *e, const Inst *array) {
    return array->imm.arr.elem == TY_BOOL ? e->t_i32 : emit_scalar_type(e, array->imm.arr.elem);
}
static uint64_t array_bytes(const Emit *e, const Inst *array) {
    return (uint64_t)array->imm.arr.count * type_bytes(e, array->imm.arr.elem) * (emit_is_vector(e, array) ? e->W : 1);
}

static void emit_alloc(Emit *e, Inst *i) {
    uint64_t bytes = array_bytes(e, i);
    e->frame_bytes += bytes;
    if (e->frame_bytes > BACK_MAX_FRAME) {
        emit_fail(e, "local arrays need more than %u bytes at %u lanes", BACK_MAX_FRAME, e->W);
        return;
    }
    Part p = emit_alloca(e, LL(ArrayType2)(e->t_i8, bytes ? bytes : 1), 1, 64);
    LL(BuildMemSet)(e->b, p, emit_int(e, e->t_i8, 0), k64(e, bytes), 64);
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
    Part at = clamped(e, index, v, array->imm.arr.count);
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
        index = LL(BuildMul)(e->b, index, k64(e, e->W), "");
        index = LL(BuildAdd)(e->b, index, k64(e, (uint64_t)p * e->L), "");
    }
    return emit_gep(e, element_type(e, array), emit_slot(e, array)[0], index);
}

static void emit_array_load(Emit *e, Inst *i) {
    const Inst *array = i->args[0], *index = i->args[1];
    LLVMTypeRef t = element_type(e, array);
    unsigned bytes = type_bytes(e, array->imm.arr.elem);
    Part *out = emit_slot(e, i);
    if (emit_is_vector(e, index)) {
        for (uint32_t p = 0; p < e->P; p++)
            out[p] = from_element(e, array,
                                  gather(e, t, element_pointers(e, array, index, emit_slot(e, index)[p], p), bytes));
        return;
    }
    Part at = scalar_index(e, index, array->imm.arr.count);
    bool vector = emit_is_vector(e, array);
    for (uint32_t p = 0; p < (vector ? e->P : 1); p++)
        out[p] = from_element(e, array,
                              emit_load(e, vector ? emit_vector_type(e, t) : t, element_pointer(e, array, at, p),
                                        vector ? part_align(e, bytes) : bytes, false));
}

static void emit_array_store(Emit *e, Inst *i) {
    const Inst *array = i->args[0], *index = i->args[1];
    LLVMTypeRef t = element_type(e, array);
    unsigned bytes = type_bytes(e, array->imm.arr.elem);
    if (!emit_is_vector(e, array)) {
        Part at = scalar_index(e, index, array->imm.arr.count);
        emit_store(e, to_element(e, array, emit_scalar(e, i->args[2]), false), element_pointer(e, array, at, 0), bytes);
        return;
    }
    Part value[BACK_MAX_PARTS];
    emit_parts(e, i->args[2], value);
    /* lanes that were dead when the array was made never read it */
    bool masked = e->mask && back_diverges_between(i->block, array->block);
    if (emit_is_vector(e, index)) {
        for (uint32_t p = 0; p < e->P; p++)
            scatter(e, to_element(e, array, value[p], true),
                    element_pointers(e, array, index, emit_slot(e, index)[p], p), bytes, masked ? e->mask[p] : NULL);
        return;
    }
    Part at = scalar_index(e, index, array->imm.arr.count);
    for (uint32_t p = 0; p < e->P; p++) {
        Part to = element_pointer(e, array, at, p), v = to_element(e, array, value[p], true);
        if (masked)
            v = LL(BuildSelect)(e->b, e->mask[p], v,
                                emit_load(e, emit_vector_type(e, t), to, part_align(e, bytes), false), "");
        emit_store(e, v, to, part_align(e, bytes));
    }
}

static void emit_array_copy(Emit *e, Inst *i) {
    const Inst *to = i->args[0], *from = i->args[1];
    bool masked = emit_is_vector(e, to) && e->mask && back_diverges_between(i->block, to->block);
    if (!masked && emit_is_vector(e, to) == emit_is_vector(e, from)) {
        LL(BuildMemCpy)(e->b, emit_slot(e, to)[0], 64, emit_slot(e, from)[0], 64, k64(e, array_bytes(e, to)));
        return;
    }
    LLVMTypeRef t = element_type(e, to), v = emit_vector_type(e, t);
    unsigned bytes = type_bytes(e, to->imm.arr.elem);
    LLVMBasicBlockRef before = emit_here(e), body = emit_new_block(e, "copy"), done = emit_new_block(e, "copied");
    LL(BuildBr)(e->b, body);
    emit_at(e, body);
    Part k = emit_phi(e, e->t_i64, "k");
    emit_incoming(e, k, k64(e, 0), before);
    Part scalar =
        emit_is_vector(e, from) ? NULL : emit_splat(e, emit_load(e, t, element_pointer(e, from, k, 0), bytes, false));
    for (uint32_t p = 0; p < e->P; p++) {
        Part x = scalar ? scalar : emit_load(e, v, element_pointer(e, from, k, p), part_align(e, bytes), false),
             at = element_pointer(e, to, k, p);
        if (masked) x = LL(BuildSelect)(e->b, e->mask[p], x, emit_load(e, v, at, part_align(e, bytes), false), "");
        emit_store(e, x, at, part_align(e, bytes));
    }
    Part next = LL(BuildAdd)(e->b, k, k64(e, 1), "");
    emit_incoming(e, k, next, body);
    LL(BuildCondBr)(e->b, LL(BuildICmp)(e->b, LLVMIntULT, next, k64(e, to->imm.arr.count), ""), body, done);
    emit_at(e, done);
}

/* ---- loops over lanes, for the rare operations that serve one lane at a time */
typedef struct LaneLoop {
    LLVMBasicBlockRef head, skip, done;
    Part lane; /* i64 */
} LaneLoop;

/* Runs what follows, up to lane_loop_end, for every lane that is on in `mask` (P parts), in lane order. */
static LaneLoop lane_loop_begin(Emit *e, const Part *mask) {
    Part bytes = emit_alloca(e, LL(ArrayType2)(e->t_i8, e->W), 1, 64);
    for (uint32_t p = 0; p < e->P; p++)
        emit_store(e, LL(BuildZExt)(e->b, mask[p], emit_vector_type(e, e->t_i8), ""),
                   at_byte(e, bytes, (uint64_t)p * e->L), 1);
    LaneLoop l = {
        .head = emit_new_block(e, "lane"), .skip = emit_new_block(e, "next"), .done = emit_new_block(e, "lanes")};
    LLVMBasicBlockRef from = emit_here(e), on = emit_new_block(e, "on");
    LL(BuildBr)(e->b, l.head);
    emit_at(e, l.head);
    l.lane = emit_phi(e, e->t_i64, "lane");
    emit_incoming(e, l.lane, k64(e, 0), from);
    Part active = emit_load(e, e->t_i8, emit_gep(e, e->t_i8, bytes, l.lane), 1, false);
    LL(BuildCondBr)(e->b, LL(BuildICmp)(e->b, LLVMIntNE, active, emit_int(e, e->t_i8, 0), ""), on, l.skip);
    emit_at(e, on);
    return l;
}

static void lane_loop_end(Emit *e, LaneLoop *l) {
    LL(BuildBr)(e->b, l->skip);
    emit_at(e, l->skip);
    Part next = LL(BuildAdd)(e->b, l->lane, k64(e, 1), "");
    emit_incoming(e, l->lane, next, l->skip);
    LL(BuildCondBr)(e->b, LL(BuildICmp)(e->b, LLVMIntULT, next, k64(e, e->W), ""), l->head, l->done);
    emit_at(e, l->done);
}

/* Spills the parts of a value so that lanes can be picked at run time; elements of type t. */
static Part spill_lanes(Emit *e, const Part *parts, LLVMTypeRef t, unsigned bytes) {
    Part mem = emit_alloca(e, LL(ArrayType2)(t, e->W), 1, 64);
    for (uint32_t p = 0; p < e->P; p++)
        emit_store(e, parts[p], emit_gep(e, t, mem, k64(e, (uint64_t)p * e->L)), part_align(e, bytes));
    return mem;
}

/* ---- adjoints of parameters */
typedef struct Log {
    Part index, value; /* where it begins */
    Part cap, len;     /* i64 */
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
    emit_store(e, compressed(e, value, mask), emit_gep(e, e->t_flt, log->value, log->len), flt_bytes(e));
}

/* Elsewhere lane by lane; a lane that is off is overwritten by the next. */
static void append_lanes(Emit *e, Part index, Part value, Part bits, const Log *log) {
    Part at = log->len;
    for (uint32_t l = 0; l < e->L; l++) {
        Part lane = emit_int(e, e->t_i32, l);
        emit_store(e, e->W > 1 ? LL(BuildExtractElement)(e->b, index, lane, "") : index,
                   emit_gep(e, e->t_i32, log->index, at), 4);
        emit_store(e, e->W > 1 ? LL(BuildExtractElement)(e->b, value, lane, "") : value,
                   emit_gep(e, e->t_flt, log->value, at), flt_bytes(e));
        Part bit = LL(BuildAnd)(e->b, LL(BuildLShr)(e->b, bits, k64(e, l), ""), k64(e, 1), "");
        at = LL(BuildAdd)(e->b, at, bit, "");
    }
}

/* Appends the lanes of one part that are on in `mask`, in lane order; returns the new length. */
static Part append(Emit *e, Part index, Part value, Part mask, Log log) {
    LLVMTypeRef t = LL(IntTypeInContext)(e->ctx, e->L);
    Part bits = e->W > 1 ? LL(BuildBitCast)(e->b, mask, t, "") : mask;
    if (e->L < 64) bits = LL(BuildZExt)(e->b, bits, e->t_i64, "");
    Part some = LL(BuildICmp)(e->b, LLVMIntNE, bits, k64(e, 0), ""),
         room = LL(BuildICmp)(e->b, LLVMIntULE, log.len, log.cap, "");
    LLVMBasicBlockRef write = emit_new_block(e, "log"), done = emit_new_block(e, "logged");
    LL(BuildCondBr)(e->b, LL(BuildAnd)(e->b, some, room, ""), write, done);
    emit_at(e, write);
    if (e->opt->target.vector_bytes == 64 && e->L >= 4 && e->L * flt_bytes(e) <= 64)
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
        index[p] = clamped(e, i->args[0], index[p], i->imm.slot.count);
        index[p] = LL(BuildAdd)(e->b, index[p],
                                emit_const_like(e, LL(TypeOf)(index[p]), e->t_i32, 0, i->imm.slot.base, false), "");
        /* Zeros add nothing: texels of what is in shadow, heights that a query did not meet. */
        Part some = LL(BuildFCmp)(e->b, LLVMRealUNE, value[p], LL(ConstNull)(LL(TypeOf)(value[p])), "");
        mask[p] = counting_lanes(e, p, some);
    }
    Part len_at = emit_field_ptr(e, offsetof(SltKernelArgs, log_len)), len = emit_load(e, e->t_i64, len_at, 8, false);
    Part cap = emit_load(e, e->t_i64, emit_field_ptr(e, offsetof(SltKernelArgs, log_cap)), 8, true);
    Part indices = emit_load(e, e->t_ptr, emit_field_ptr(e, offsetof(SltKernelArgs, log_index)), 8, true);
    Part values = emit_load(e, e->t_ptr, emit_field_ptr(e, offsetof(SltKernelArgs, log_value)), 8, true);
    for (uint32_t p = 0; p < e->P; p++) len = append(e, index[p], value[p], mask[p], (Log){indices, values, cap, len});
    emit_store(e, len, len_at, 8);
}

/* Sum over all lanes, halving: the order does not depend on how lanes are cut into parts. */
static Part horizontal_sum(Emit *e, Part *v) {
    uint32_t p = e->P;
    for (; p > 1; p /= 2)
        for (uint32_t k = 0; k < p / 2; k++) v[k] = LL(BuildFAdd)(e->b, v[k], v[k + p / 2], "");
    if (e->W == 1) return v[0];
    Part x = v[0];
    for (uint32_t half = e->L / 2; half; half /= 2) {
        Part pick[BACK_MAX_WIDTH];
        for (uint32_t l = 0; l < e->L; l++) pick[l] = emit_int(e, e->t_i32, l < half ? l + half : l);
        x = LL(BuildFAdd)(
            e->b, x, LL(BuildShuffleVector)(e->b, x, LL(GetPoison)(LL(TypeOf)(x)), LL(ConstVector)(pick, e->L), ""),
            "");
    }
    return LL(BuildExtractElement)(e->b, x, emit_int(e, e->t_i32, 0), "");
}

static void emit_adjoint(Emit *e, Inst *i) {
    if (i->args[0]->flags & BACK_VARYING) {
        log_adjoint(e, i);
        return;
    }
    Part value[BACK_MAX_PARTS], index = scalar_index(e, i->args[0], i->imm.slot.count);
    emit_parts(e, i->args[1], value);
    index = LL(BuildAdd)(e->b, index, k64(e, i->imm.slot.base), "");
    for (uint32_t p = 0; e->mask && p < e->P; p++)
        value[p] = LL(BuildSelect)(e->b, e->mask[p], value[p], LL(ConstNull)(LL(TypeOf)(value[p])), "");
    if (e->opt->adj == ADJ_FLAT) {
        Part at = emit_gep(e, e->t_flt, e->adj, index), sum = horizontal_sum(e, value);
        emit_store(e, LL(BuildFAdd)(e->b, emit_load(e, e->t_flt, at, flt_bytes(e), false), sum, ""), at, flt_bytes(e));
        return;
    }
    index = LL(BuildMul)(e->b, index, k64(e, e->W), "");
    Part row = emit_gep(e, e->t_flt, e->adj, index);
    unsigned align = part_align(e, flt_bytes(e));
    for (uint32_t p = 0; p < e->P; p++) {
        Part at = emit_gep(e, e->t_flt, row, k64(e, (uint64_t)p * e->L));
        Part old = emit_load(e, emit_vector_type(e, e->t_flt), at, align, false);
        emit_store(e, LL(BuildFAdd)(e->b, old, value[p], ""), at, align);
    }
}

/* ---- the tape. A frame: whole vectors first, then 8-byte, 4-byte and bit values, then the mask; one size for each
 * signature. A frame takes at most the sum of its values' bytes and 4 more for each lane: the mask, an iteration number
 * and the padding fit in those. */
static uint32_t bits_bytes(const Emit *e) { return e->P * (e->L < 8 ? 1 : e->L / 8); }

void emit_layout_frames(Emit *e) {
    for (uint32_t k = 0; k < e->frames.len; k++) {
        FrameClass *c = e->frames.data[k];
        uint32_t at = 0;
        if (e->W == 1) {
            c->masked = false;
            memset(c->varying, 0, c->n * sizeof *c->varying);
        }
        for (int pass = 0; pass < 4; pass++)
            for (uint32_t j = 0; j < c->n; j++) {
                unsigned bytes = c->types[j] == TY_BOOL ? 1 : type_bytes(e, c->types[j]);
                bool bits = c->types[j] == TY_BOOL, vector = c->varying[j] && !bits;
                int when = vector ? 0 : bits ? 3 : bytes == 8 ? 1 : 2;
                if (when != pass) continue;
                c->offset[j] = at;
                at += vector ? bytes * e->W : bits && c->varying[j] ? bits_bytes(e) : bytes;
            }
        c->mask_offset = at;
        at += c->masked ? bits_bytes(e) : 0;
        uint32_t align = e->W * 4 < 64 ? e->W * 4 : 64;
        c->bytes = at ? (at + align - 1) / align * align : align; /* an empty frame still counts an iteration */
    }
}

static void store_bits(Emit *e, const Part *bits, Part at) {
    LLVMTypeRef t = LL(IntTypeInContext)(e->ctx, e->L);
    for (uint32_t p = 0; p < e->P; p++) {
        Part v = LL(BuildBitCast)(e->b, bits[p], t, "");
        if (e->L < 8) v = LL(BuildZExt)(e->b, v, e->t_i8, "");
        emit_store(e, v, at_byte(e, at, (uint64_t)p * (e->L < 8 ? 1 : e->L / 8)), 1);
    }
}

static void load_bits(Emit *e, Part *bits, Part at) {
    LLVMTypeRef t = LL(IntTypeInContext)(e->ctx, e->L), v = emit_vector_type(e, e->t_i1);
    for (uint32_t p = 0; p < e->P; p++) {
        Part x =
            emit_load(e, e->L < 8 ? e->t_i8 : t, at_byte(e, at, (uint64_t)p * (e->L < 8 ? 1 : e->L / 8)), 1, false);
        if (e->L < 8) x = LL(BuildTrunc)(e->b, x, t, "");
        bits[p] = LL(BuildBitCast)(e->b, x, v, "");
    }
}

static void emit_tapepush(Emit *e, Inst *i) {
    FrameClass *c = back_frame_class(&e->frames, e->arena, i->nargs, i->args);
    Part top = emit_load(e, e->t_i64, e->tape_top, 8, false), next = LL(BuildAdd)(e->b, top, k64(e, c->bytes), "");
    LLVMBasicBlockRef push = emit_new_block(e, "push"), full = emit_new_block(e, "full"),
                      done = emit_new_block(e, "pushed");
    LL(BuildCondBr)(e->b, LL(BuildICmp)(e->b, LLVMIntULE, next, e->tape_end, ""), push, full);
    emit_at(e, full);
    Part counter = emit_field_ptr(e, offsetof(SltKernelArgs, counters) + COUNTER_TAPE_OVERFLOW * sizeof(uint64_t));
    emit_store(e, LL(BuildAdd)(e->b, emit_load(e, e->t_i64, counter, 8, false), k64(e, 1), ""), counter, 8);
    LL(BuildBr)(e->b, done);
    emit_at(e, push);
    Part frame = emit_gep(e, e->t_i8, e->tape, top);
    for (uint32_t j = 0; j < i->nargs; j++) {
        const Inst *x = i->args[j];
        Part at = at_byte(e, frame, c->offset[j]);
        if (!c->varying[j]) {
            Part v = emit_scalar(e, x);
            emit_store(e, x->type == TY_BOOL ? LL(BuildZExt)(e->b, v, e->t_i8, "") : v, at, x->type == TY_BOOL ? 1 : 4);
            continue;
        }
        Part v[BACK_MAX_PARTS];
        emit_parts(e, x, v);
        if (x->type == TY_BOOL) {
            store_bits(e, v, at);
            continue;
        }
        unsigned bytes = type_bytes(e, x->type), align = e->W * 4 < 64 ? e->L * 4 : part_align(e, bytes);
        for (uint32_t p = 0; p < e->P; p++)
            emit_store(e, v[p], at_byte(e, at, (uint64_t)p * e->L * bytes),
                       align < part_align(e, bytes) ? align : part_align(e, bytes));
    }
    if (c->masked) {
        Part on[BACK_MAX_PARTS];
        for (uint32_t p = 0; p < e->P; p++) on[p] = e->mask ? e->mask[p] : all_on(e);
        store_bits(e, on, at_byte(e, frame, c->mask_offset));
    }
    emit_store(e, next, e->tape_top, 8);
    LL(BuildBr)(e->b, done);
    emit_at(e, done);
}

static void pop_frame(Emit *e, const FrameClass *c, Block *body, Part frame) {
    for (uint32_t j = 0; j < c->n; j++) {
        const Inst *x = body->params[j];
        Part *out = emit_slot(e, x), at = at_byte(e, frame, c->offset[j]);
        if (!c->varying[j]) {
            out[0] = emit_load(e, x->type == TY_BOOL ? e->t_i8 : emit_scalar_type(e, x->type), at,
                               x->type == TY_BOOL ? 1 : 4, false);
            if (x->type == TY_BOOL) out[0] = LL(BuildTrunc)(e->b, out[0], e->t_i1, "");
            continue;
        }
        if (x->type == TY_BOOL) {
            load_bits(e, out, at);
            continue;
        }
        unsigned bytes = type_bytes(e, x->type), align = e->W * 4 < 64 ? e->L * 4 : part_align(e, bytes);
        for (uint32_t p = 0; p < e->P; p++)
            out[p] = emit_load(e, emit_vector_type(e, emit_scalar_type(e, x->type)),
                               at_byte(e, at, (uint64_t)p * e->L * bytes),
                               align < part_align(e, bytes) ? align : part_align(e, bytes), false);
    }
}

/* Pops frames until the mark. Lanes that were not there when a frame was pushed keep their carried values. */
void emit_revloop(Emit *e, Inst *i) {
    Block *body = i->region[0];
    uint32_t carried = i->nargs - 1, nframe = body->nparams - carried;
    FrameClass *c = back_frame_class(&e->frames, e->arena, nframe, body->params);
    Inst **params = body->params + nframe;
    Part(*init)[BACK_MAX_PARTS] = arena_alloc(e->arena, (carried + 1) * sizeof *init);
    uint32_t *n = ARENA_ARRAY(e->arena, uint32_t, carried + 1);
    for (uint32_t r = 0; r < carried; r++) {
        n[r] = emit_is_vector(e, params[r]) ? e->P : 1;
        if (n[r] == e->P && emit_is_vector(e, params[r])) emit_parts(e, i->args[1 + r], init[r]);
        else init[r][0] = emit_scalar(e, i->args[1 + r]);
    }
    Part mark = emit_scalar(e, i->args[0]);
    LLVMBasicBlockRef from = emit_here(e), head = emit_new_block(e, "unwind"), pop = emit_new_block(e, "pop"),
                      done = emit_new_block(e, "unwound");
    LL(BuildBr)(e->b, head);
    emit_at(e, head);
    for (uint32_t r = 0; r < carried; r++)
        for (uint32_t k = 0; k < n[r]; k++) {
            LLVMTypeRef t = emit_scalar_type(e, params[r]->type);
            emit_slot(e, params[r])[k] = emit_phi(e, emit_is_vector(e, params[r]) ? emit_vector_type(e, t) : t, "");
            emit_incoming(e, emit_slot(e, params[r])[k], init[r][k], from);
        }
    Part top = emit_load(e, e->t_i64, e->tape_top, 8, false);
    LL(BuildCondBr)(e->b, LL(BuildICmp)(e->b, LLVMIntUGT, top, mark, ""), pop, done);
    emit_at(e, pop);
    top = LL(BuildSub)(e->b, top, k64(e, c->bytes), "");
    emit_store(e, top, e->tape_top, 8);
    Part frame = emit_gep(e, e->t_i8, e->tape, top);
    pop_frame(e, c, body, frame);
    Part *outer = e->mask, *mask = ARENA_ARRAY(e->arena, Part, e->P);
    if (c->masked) {
        load_bits(e, mask, at_byte(e, frame, c->mask_offset));
        emit_and_mask(e, mask, mask);
        e->mask = mask;
    }
    emit_block(e, body);
    e->mask = outer;
    if (e->error) return;
    const Inst *y = ir_yield_of(body);
    Part(*next)[BACK_MAX_PARTS] = arena_alloc(e->arena, (carried + 1) * sizeof *next);
    for (uint32_t r = 0; r < carried; r++) {
        if (!emit_is_vector(e, params[r])) {
            next[r][0] = emit_scalar(e, y->args[r]);
            continue;
        }
        emit_parts(e, y->args[r], next[r]);
        for (uint32_t k = 0; c->masked && k < e->P; k++)
            next[r][k] = LL(BuildSelect)(e->b, mask[k], next[r][k], emit_slot(e, params[r])[k], "");
    }
    LLVMBasicBlockRef latch = emit_here(e);
    LL(BuildBr)(e->b, head);
    for (uint32_t r = 0; r < carried; r++)
        for (uint32_t k = 0; k < n[r]; k++) emit_incoming(e, emit_slot(e, params[r])[k], next[r][k], latch);
    emit_at(e, done);
    for (const Inst *p = i->next; p && p->op == OP_proj && p->args[0] == i; p = p->next)
        memcpy(emit_slot(e, p), emit_slot(e, params[p->imm.i]), n[p->imm.i] * sizeof(Part));
}

/* ---- pairs of lanes */
static void emit_partner(Emit *e, const Part *in, Part *out) {
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

/* differ & both, the heart of the event kernel: pairs whose lanes are on and disagree. On mask registers the whole of
 * it is done on one bit a pair, as integers, and spread to both lanes at the end. False where i is something else. */
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

static void emit_both(Emit *e, Inst *i) {
    Part *out = emit_slot(e, i);
    if (!emit_is_vector(e, i)) {
        out[0] = emit_int(e, e->t_i1, 1);
        return;
    }
    emit_partner(e, e->mask, out); /* this lane is on wherever the answer is used */
}

/* ---- counters and print */
static void emit_count(Emit *e, Inst *i) {
    Part cond[BACK_MAX_PARTS];
    emit_parts(e, i->args[0], cond);
    LLVMBasicBlockRef some = emit_new_block(e, "count"), done = emit_new_block(e, "counted");
    LL(BuildCondBr)(e->b, emit_any(e, cond), some, done);
    emit_at(e, some);
    Part sum = k64(e, 0);
    LLVMTypeRef bits = LL(IntTypeInContext)(e->ctx, e->L);
    for (uint32_t p = 0; p < e->P; p++) {
        Part m = counting_lanes(e, p, cond[p]);
        m = LL(BuildZExt)(e->b, e->W == 1 ? m : LL(BuildBitCast)(e->b, m, bits, ""), e->t_i64, "");
        sum = LL(BuildAdd)(e->b, sum, emit_intrinsic(e, "llvm.ctpop", e->t_i64, &m, 1), "");
    }
    Part at = emit_field_ptr(e, offsetof(SltKernelArgs, counters) + (size_t)i->imm.i * sizeof(uint64_t));
    emit_store(e, LL(BuildAdd)(e->b, emit_load(e, e->t_i64, at, 8, false), sum, ""), at, 8);
    LL(BuildBr)(e->b, done);
    emit_at(e, done);
}

static Part as_double(Emit *e, const Inst *x, Part v) {
    LLVMTypeRef d = emit_vector_type(e, e->t_f64);
    if (x->type == TY_BOOL) return LL(BuildUIToFP)(e->b, v, d, "");
    if (x->type == TY_INT) return LL(BuildSIToFP)(e->b, v, d, "");
    return e->t_flt == e->t_f32 ? LL(BuildFPExt)(e->b, v, d, "") : v;
}

static void emit_print(Emit *e, Inst *i) {
    LLVMBasicBlockRef on = emit_new_block(e, "print"), done = emit_new_block(e, "printed");
    Part f = emit_load(e, e->t_ptr, emit_field_ptr(e, offsetof(SltKernelArgs, print)), 8, true);
    LL(BuildCondBr)(e->b, LL(BuildICmp)(e->b, LLVMIntNE, f, LL(ConstNull)(e->t_ptr), ""), on, done);
    emit_at(e, on);
    Part *spilled = ARENA_ARRAY(e->arena, Part, i->nargs + 1), mask[BACK_MAX_PARTS];
    for (uint32_t j = 0; j < i->nargs; j++) {
        Part v[BACK_MAX_PARTS];
        emit_parts(e, i->args[j], v);
        for (uint32_t p = 0; p < e->P; p++) v[p] = as_double(e, i->args[j], v[p]);
        spilled[j] = spill_lanes(e, v, e->t_f64, 8);
    }
    for (uint32_t p = 0; p < e->P; p++) mask[p] = counting_lanes(e, p, NULL);
    char *text = arena_strndup(e->arena, i->imm.text.text, i->imm.text.len);
    Part name = LL(BuildGlobalStringPtr)(e->b, text, "text");
    Part values = emit_alloca(e, LL(ArrayType2)(e->t_f64, i->nargs + 1), 1, 8);
    LaneLoop l = lane_loop_begin(e, mask);
    for (uint32_t j = 0; j < i->nargs; j++)
        emit_store(e, emit_load(e, e->t_f64, emit_gep(e, e->t_f64, spilled[j], l.lane), 8, false),
                   emit_gep(e, e->t_f64, values, k64(e, j)), 8);
    Part lane = LL(BuildTrunc)(e->b, LL(BuildAdd)(e->b, e->i, l.lane, ""), e->t_i32, "");
    Part user = emit_load(e, e->t_ptr, emit_field_ptr(e, offsetof(SltKernelArgs, user)), 8, true);
    LLVMTypeRef types[6] = {e->t_ptr, e->t_ptr, e->t_i32, e->t_ptr, e->t_i32, e->t_i32};
    Part args[6] = {user, name, emit_int(e, e->t_i32, i->imm.text.len), values, emit_int(e, e->t_i32, i->nargs), lane};
    LL(BuildCall2)(e->b, LL(FunctionType)(e->t_void, types, 6, false), f, args, 6, "");
    lane_loop_end(e, &l);
    LL(BuildBr)(e->b, done);
    emit_at(e, done);
}

/* ---- heightfields: rays to memory, a call through the field, witnesses back */
static Part active_bits(Emit *e) {
    if (!e->mask) return k64(e, e->W == 64 ? UINT64_MAX : (1ull << e->W) - 1);
    Part bits = k64(e, 0);
    for (uint32_t p = 0; p < e->P; p++) {
        Part m = LL(BuildZExt)(e->b, LL(BuildBitCast)(e->b, e->mask[p], LL(IntTypeInContext)(e->ctx, e->L), ""),
                               e->t_i64, "");
        bits = LL(BuildOr)(e->b, bits, LL(BuildShl)(e->b, m, k64(e, (uint64_t)p * e->L), ""), "");
    }
    return bits;
}

static void emit_fieldop(Emit *e, Inst *i) {
    bool vector = emit_is_vector(e, i);
    uint32_t width = vector ? e->W : 1, flt = flt_bytes(e);
    unsigned align = vector ? part_align(e, flt) : flt, ialign = vector ? part_align(e, 4) : 4;
    Part rays = emit_alloca(e, e->t_i8, (uint64_t)SLT_RAY_ROWS * width * flt, 64),
         ids = emit_alloca(e, e->t_i8, 4ull * width, 64);
    for (uint32_t a = 0; a < i->nargs; a++) {
        Part v[BACK_MAX_PARTS];
        if (vector) emit_parts(e, i->args[a], v);
        else v[0] = emit_scalar(e, i->args[a]);
        for (uint32_t p = 0; p < (vector ? e->P : 1); p++)
            emit_store(e, v[p], at_byte(e, rays, ((uint64_t)a * width + (uint64_t)p * e->L) * flt), align);
    }
    Part fields = emit_load(e, e->t_ptr, emit_field_ptr(e, offsetof(SltKernelArgs, fields)), 8, true);
    Part field = emit_load(e, e->t_ptr, at_byte(e, fields, 8ull * i->imm.field.field), 8, true);
    Part query =
        emit_load(e, e->t_ptr, at_byte(e, field, offsetof(SltGeometry, query) + 8ull * i->imm.field.what), 8, true);
    Part heights = at_byte(e, e->params, (uint64_t)i->imm.field.base * flt);
    LLVMTypeRef types[6] = {e->t_ptr, e->t_ptr, e->t_ptr, e->t_i64, e->t_i32, e->t_ptr};
    Part args[6] = {field, heights, rays, vector ? active_bits(e) : k64(e, 1), emit_int(e, e->t_i32, width), ids};
    LL(BuildCall2)(e->b, LL(FunctionType)(e->t_void, types, 6, 0), query, args, 6, "");
    Part *out = emit_slot(e, i);
    LLVMTypeRef t = vector ? emit_vector_type(e, e->t_i32) : e->t_i32;
    for (uint32_t p = 0; p < (vector ? e->P : 1); p++)
        out[p] = emit_load(e, t, at_byte(e, ids, 4ull * p * e->L), ialign, false);
}

void emit_memory_op(Emit *e, Inst *i) {
    switch (i->op) {
    case OP_param:
    case OP_iparam:
    case OP_dparam: emit_param(e, i); break;
    case OP_adj: emit_adjoint(e, i); break;
    case OP_fieldop: emit_fieldop(e, i); break;
    case OP_alloc: emit_alloc(e, i); break;
    case OP_load: emit_array_load(e, i); break;
    case OP_store: emit_array_store(e, i); break;
    case OP_acopy: emit_array_copy(e, i); break;
    case OP_tapemark: emit_slot(e, i)[0] = emit_load(e, e->t_i64, e->tape_top, 8, false); break;
    case OP_tapepush: emit_tapepush(e, i); break;
    case OP_partner:
        if (emit_is_vector(e, i)) emit_partner(e, emit_slot(e, i->args[0]), emit_slot(e, i));
        else emit_slot(e, i)[0] = emit_scalar(e, i->args[0]);
        break;
    case OP_both: emit_both(e, i); break;
    case OP_count: emit_count(e, i); break;
    case OP_print: emit_print(e, i); break;
    default: emit_fail(e, "%s is not supported by this back end", ir_ops[i->op].name);
    }
}
