/* Parameters, and adjoints of parameters: summed in place where the index is uniform, logged where it varies. */
#include "compiler/back/cpu/emit.h"

void emit_param(Emit *e, Inst *i) {
    Part base = i->op == OP_param ? e->params : i->op == OP_iparam ? e->iparams : e->dparams;
    LLVMTypeRef t = emit_scalar_type(e, i->type);
    unsigned bytes = back_type_bytes(&e->plan, i->type);
    Part *out = emit_slot(e, i);
    if (!emit_is_vector(e, i)) {
        base = emit_gep(e, t, base, emit_i64(e, i->imm.slot.base));
        out[0] =
            emit_load(e, t, emit_gep(e, t, base, emit_scalar_index(e, i->args[0], i->imm.slot.count)), bytes, false);
        return;
    }
    Part index[BACK_MAX_PARTS], *own = emit_slot(e, i->args[0]);
    for (uint32_t p = 0; p < e->P; p++) index[p] = emit_clamped_index(e, i->args[0], own[p], i->imm.slot.count);
    const uint64_t numbers = i->op == OP_iparam ? e->fn->nints : e->fn->nfloats;
    if (emit_beside(e, i, base, index, numbers - (i->imm.slot.count - 1))) return;
    base = emit_gep(e, t, base, emit_i64(e, i->imm.slot.base));
    for (uint32_t p = 0; p < e->P; p++) out[p] = emit_gather(e, t, emit_gep(e, t, base, index[p]), bytes);
}

typedef struct Log {
    Part index, value; /* pointers to the first entry */
    Part cap, len;     /* entries, i64 */
} Log;

Part emit_compressed(Emit *e, Part v, Part mask) {
    LLVMTypeRef t = LL(TypeOf)(v);
    unsigned id = LL(LookupIntrinsicID)("llvm.x86.avx512.mask.compress", 29);
    Part f = LL(GetIntrinsicDeclaration)(e->mod, id, &t, 1), args[3] = {v, LL(ConstNull)(t), mask};
    return LL(BuildCall2)(e->b, LL(IntrinsicGetType)(e->ctx, id, &t, 1), f, args, 3, "");
}

/* What is logged of a few numbers at one index, that lie beside it: the lanes of the first, then of the second... */
enum { ROW = 4 };
typedef struct LogRow {
    Inst *of[ROW];
    Part index, value[ROW]; /* of one part */
    uint32_t n;
} LogRow;

static Part index_of(Emit *e, const LogRow *r, uint32_t k) {
    const uint32_t base = r->of[k]->imm.slot.base;
    return LL(BuildAdd)(e->b, r->index, emit_const_like(e, LL(TypeOf)(r->index), e->t_i32, 0, base, false), "");
}

static void append_vector(Emit *e, const LogRow *r, uint32_t k, Part mask, const Log *log) {
    emit_store(e, emit_compressed(e, index_of(e, r, k), mask), emit_gep(e, e->t_i32, log->index, log->len), 4);
    emit_store(e, emit_compressed(e, r->value[k], mask), emit_gep(e, e->t_flt, log->value, log->len),
               e->plan.flt_bytes);
}

/* Elsewhere lane by lane; a lane that is off is overwritten by the next. */
static void append_lanes(Emit *e, const LogRow *r, uint32_t k, Part bits, const Log *log) {
    Part at = log->len, index = index_of(e, r, k), value = r->value[k];
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
static Part append(Emit *e, const LogRow *r, Part mask, Log log) {
    LLVMTypeRef t = LL(IntTypeInContext)(e->ctx, e->L);
    Part bits = e->W > 1 ? LL(BuildBitCast)(e->b, mask, t, "") : mask;
    if (e->L < 64) bits = LL(BuildZExt)(e->b, bits, e->t_i64, "");
    Part some = LL(BuildICmp)(e->b, LLVMIntNE, bits, emit_i64(e, 0), ""),
         room = LL(BuildICmp)(e->b, LLVMIntULE, log.len, log.cap, ""),
         lanes = emit_intrinsic(e, "llvm.ctpop", e->t_i64, &bits, 1);
    LLVMBasicBlockRef write = emit_new_block(e, "log"), done = emit_new_block(e, "logged");
    LL(BuildCondBr)(e->b, LL(BuildAnd)(e->b, some, room, ""), write, done);
    emit_at(e, write);
    Log to = log;
    for (uint32_t k = 0; k < r->n; k++) {
        if (e->opt->target.vector_bytes == 64 && e->L >= 4 && e->L * e->plan.flt_bytes <= 64)
            append_vector(e, r, k, mask, &to);
        else append_lanes(e, r, k, bits, &to);
        to.len = LL(BuildAdd)(e->b, to.len, lanes, "");
    }
    LL(BuildBr)(e->b, done);
    emit_at(e, done);
    return LL(BuildAdd)(e->b, log.len, LL(BuildMul)(e->b, lanes, emit_i64(e, r->n), ""), "");
}

/* v moved up by k lanes; what comes in below is of no meaning. */
static Part moved_up(Emit *e, Part v, uint32_t k) {
    Part pick[BACK_MAX_WIDTH];
    for (uint32_t l = 0; l < e->L; l++) pick[l] = emit_int(e, e->t_i32, l < k ? l : l - k);
    return LL(BuildShuffleVector)(e->b, v, LL(GetPoison)(LL(TypeOf)(v)), LL(ConstVector)(pick, e->L), "");
}

/* The integer of the same block that an index is a function of: where it is the same the index is. */
static const Inst *root_of(const Inst *index) {
    for (;;) {
        const Inst *next = NULL;
        if (index->op != OP_iparam && (ir_ops[index->op].special || index->op == OP_proj)) return index;
        for (uint32_t a = 0; a < index->nargs; a++) {
            if (ir_is_const(index->args[a])) continue;
            if (next) return index;
            next = index->args[a];
        }
        if (!next || next->type != TY_INT || next->block != index->block) return index;
        index = next;
    }
}

/* Which neighbouring lanes of a part have one index: of all indices that one integer makes, in a block, they are the
 * same. */
static void find_runs(Emit *e, const Inst *index, uint32_t p, Part on) {
    LLVMTypeRef bits = LL(IntTypeInContext)(e->ctx, e->L), lanes = emit_vector_type(e, e->t_i1);
    Part root[BACK_MAX_PARTS], one = LL(ConstInt)(bits, 1, 0);
    emit_parts(e, index, root);
    Part like = LL(BuildICmp)(e->b, LLVMIntEQ, root[p], moved_up(e, root[p], 1), "");
    Part both = LL(BuildBitCast)(e->b, on, bits, "");
    /* Lanes that are off may have another index for the same integer. Bit l: from lane l - k on it is one run. */
    both = LL(BuildAnd)(e->b, both, LL(BuildShl)(e->b, both, one, ""), "");
    like = LL(BuildAnd)(e->b, LL(BuildBitCast)(e->b, like, bits, ""), both, "");
    e->runs.end[p] = LL(BuildBitCast)(e->b, LL(BuildNot)(e->b, LL(BuildLShr)(e->b, like, one, ""), ""), lanes, "");
    for (uint32_t k = 1, step = 0; k < e->L; k *= 2, step++) {
        e->runs.like[p][step] = LL(BuildBitCast)(e->b, like, lanes, "");
        like = LL(BuildAnd)(e->b, like, LL(BuildShl)(e->b, like, LL(ConstInt)(bits, k, 0), ""), "");
    }
}

/* Neighbouring lanes of one index are added up into the last of them: samples that lie side by side see one triangle,
 * and an entry of the log costs as much whatever it adds. */
static void add_runs(Emit *e, LogRow *r, uint32_t p) {
    for (uint32_t k = 1, step = 0; k < e->L; k *= 2, step++)
        for (uint32_t m = 0; m < r->n; m++) {
            Part more = LL(BuildFAdd)(e->b, r->value[m], moved_up(e, r->value[m], k), "");
            r->value[m] = LL(BuildSelect)(e->b, e->runs.like[p][step], more, r->value[m], "");
        }
}

/* Where a mesh's pieces are differentiated the three coordinates of a vertex go together. */
static LogRow log_row(Emit *e, Inst *i) {
    LogRow r = {.of = {i}, .n = 1};
    for (Inst *j = i->next; e->told && j && j->op == OP_adj && r.n < ROW && (r.n + 1) * e->L <= SLT_PAD; j = j->next) {
        if (j->args[0] != i->args[0] || j->imm.slot.count != i->imm.slot.count) break;
        r.of[r.n++] = j;
    }
    return r;
}

static void log_adjoint(Emit *e, Inst *i) {
    Part index[BACK_MAX_PARTS], value[ROW][BACK_MAX_PARTS];
    LogRow r = log_row(e, i);
    emit_parts(e, i->args[0], index);
    for (uint32_t k = 0; k < r.n; k++) emit_parts(e, r.of[k]->args[1], value[k]);
    Part len_at = emit_field_ptr(e, offsetof(SltKernelArgs, log_len)), len = emit_load(e, e->t_i64, len_at, 8, false);
    Part cap = emit_load(e, e->t_i64, emit_field_ptr(e, offsetof(SltKernelArgs, log_cap)), 8, true);
    Part indices = emit_load(e, e->t_ptr, emit_field_ptr(e, offsetof(SltKernelArgs, log_index)), 8, true);
    Part values = emit_load(e, e->t_ptr, emit_field_ptr(e, offsetof(SltKernelArgs, log_value)), 8, true);
    const Inst *root = root_of(i->args[0]);
    const bool runs = e->told && e->L > 1, known = root == e->runs.root && i->block == e->runs.block;
    e->runs.root = root, e->runs.block = i->block;
    for (uint32_t p = 0; p < e->P; p++) {
        Part on = emit_counting_lanes(e, p, NULL), zero = LL(ConstNull)(LL(TypeOf)(value[0][p])), any = NULL;
        r.index = emit_clamped_index(e, i->args[0], index[p], i->imm.slot.count);
        for (uint32_t k = 0; k < r.n; k++) {
            r.value[k] = value[k][p];
            if (e->told) r.value[k] = LL(BuildSelect)(e->b, on, r.value[k], zero, "");
        }
        if (runs && !known) find_runs(e, root, p, on);
        if (runs) add_runs(e, &r, p), on = e->runs.end[p];
        /* Zeros add nothing: texels in shadow, numbers of a geometry that the ray did not meet. */
        for (uint32_t k = 0; k < r.n; k++) {
            Part some = LL(BuildFCmp)(e->b, LLVMRealUNE, r.value[k], zero, "");
            any = any ? LL(BuildOr)(e->b, any, some, "") : some;
        }
        len = append(e, &r, LL(BuildAnd)(e->b, on, any, ""), (Log){indices, values, cap, len});
    }
    emit_store(e, len, len_at, 8);
    for (uint32_t k = 1; k < r.n; k++) emit_slot(e, r.of[k])[0] = len; /* done */
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
