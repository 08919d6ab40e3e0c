/* Straight-line programs in chunks (pass/variant_chunks.c): a jump from chunk to chunk along the list of those that
 * run.
 *
 *     next:     switch *list++ { chunk 0, chunk 1, ... otherwise: behind }
 *     chunk k:  values of other chunks from the frame; 16 operations; what others use to the frame; goto next
 *
 * Values that chunks hand to each other lie in memory, in places of one frame a vector: as SSA values they would need a
 * phi at every chunk that may be skipped, and LLVM's time would grow with the square of the program. So blocks are
 * short, and compiling is linear. The place of a value that was not computed holds anything: nobody looks at it. */
#include "compiler/back/cpu/emit.h"

struct ChunkState {
    Part list, settled, from, choices; /* of SltPruned and SltKernelArgs */
    Part frame;
    uint32_t bytes; /* of a place */
};

static bool is_chunk(const Inst *i) { return i->op == OP_if_ && i->args[0]->op == OP_live; }

/* Places of the frame; 0: there are no chunks. */
static uint64_t count_places(const Block *b) {
    uint64_t n = 0;
    for (const Inst *i = b->first; i; i = i->next) {
        uint64_t own = i->op == OP_give ? (i->imm.frame.which + 1ull) * i->imm.frame.places : 0;
        n = own > n ? own : n;
        for (uint32_t r = 0; r < i->nregions; r++) {
            uint64_t below = count_places(i->region[r]);
            n = below > n ? below : n;
        }
    }
    return n;
}

void emit_chunks_setup(Emit *e) {
    uint64_t places = count_places(e->fn->body);
    if (!places) return;
    ChunkState *s = e->chunks = ARENA_NEW(e->arena, ChunkState);
    s->bytes = e->W * e->plan.flt_bytes;
    e->frame_bytes += places * s->bytes;
    if (e->frame_bytes > BACK_MAX_FRAME) {
        emit_fail(e, "the values of its chunks take more than %u bytes", BACK_MAX_FRAME);
        return;
    }
    s->frame = emit_alloca(e, LL(ArrayType2)(e->t_i8, places * s->bytes), 1, 64);
    Part pruned = emit_load(e, e->t_ptr, emit_field_ptr(e, offsetof(SltKernelArgs, pruned)), 8, true);
    s->list = emit_load(e, e->t_ptr, emit_at_byte(e, pruned, offsetof(SltPruned, chunks)), 8, true);
    s->settled = emit_load(e, e->t_ptr, emit_at_byte(e, pruned, offsetof(SltPruned, settled)), 8, true);
    s->from = emit_load(e, e->t_ptr, emit_at_byte(e, pruned, offsetof(SltPruned, from)), 8, true);
    s->choices = emit_load(e, e->t_ptr, emit_field_ptr(e, offsetof(SltKernelArgs, choices)), 8, true);
}

Inst *emit_chunks(Emit *e, Inst *first) {
    ChunkState *s = e->chunks;
    Inst *last = first;
    uint32_t n = 0;
    for (Inst *i = first; is_chunk(i) || i->op == OP_live; last = i, i = i->next) n += is_chunk(i);
    LLVMBasicBlockRef from = emit_here(e), head = emit_new_block(e, "next"), behind = emit_new_block(e, "behind");
    LL(BuildBr)(e->b, head);
    emit_at(e, head);
    Part at = emit_phi(e, e->t_ptr, "at");
    emit_incoming(e, at, s->list, from);
    Part which = emit_load(e, e->t_i32, at, 4, false), next = emit_at_byte(e, at, sizeof(int32_t)),
         pick = LL(BuildSwitch)(e->b, which, behind, n);
    for (Inst *i = first; i != last->next && !e->error; i = i->next) {
        if (!is_chunk(i)) continue;
        LLVMBasicBlockRef chunk = emit_new_block(e, "chunk");
        LL(AddCase)(pick, emit_int(e, e->t_i32, (uint64_t)i->args[0]->imm.i), chunk);
        emit_at(e, chunk);
        emit_block(e, i->region[0]);
        emit_incoming(e, at, next, emit_here(e));
        LL(BuildBr)(e->b, head);
    }
    emit_at(e, behind);
    s->list = at; /* of the chunks behind */
    return last;
}

/* ---- the frame */

/* A boolean lies there as an integer of the width of a float: vectors of i1 have no place in memory. */
static LLVMTypeRef place_type(Emit *e, const Inst *value) {
    LLVMTypeRef t = value->type != TY_BOOL   ? emit_scalar_type(e, value->type)
                    : e->plan.flt_bytes == 8 ? e->t_i64
                                             : e->t_i32;
    return emit_vector_type(e, t);
}

static Part part_at(Emit *e, Part place, uint32_t p) {
    return emit_at_byte(e, place, (uint64_t)p * e->L * e->plan.flt_bytes);
}

void emit_give(Emit *e, const Inst *i) {
    const Inst *value = i->args[0];
    Part v[BACK_MAX_PARTS];
    emit_parts(e, value, v);
    Part place =
        emit_at_byte(e, e->chunks->frame,
                     (i->imm.frame.which * (uint64_t)i->imm.frame.places + i->imm.frame.place) * e->chunks->bytes);
    for (uint32_t p = 0; p < e->P; p++) {
        if (value->type == TY_BOOL) v[p] = LL(BuildSExt)(e->b, v[p], place_type(e, value), "");
        emit_store(e, v[p], part_at(e, place, p), emit_part_align(e, e->plan.flt_bytes));
    }
}

void emit_take(Emit *e, Inst *i) {
    Part which = emit_load(e, e->t_i32, emit_at_byte(e, e->chunks->from, 4 * (uint64_t)i->imm.frame.which), 4, false);
    Part offset = LL(BuildMul)(e->b, LL(BuildZExt)(e->b, which, e->t_i64, ""),
                               emit_i64(e, (uint64_t)i->imm.frame.places * e->chunks->bytes), "");
    Part place = emit_gep(e, e->t_i8, e->chunks->frame, offset);
    place = emit_at_byte(e, place, (uint64_t)i->imm.frame.place * e->chunks->bytes);
    LLVMTypeRef t = place_type(e, i);
    for (uint32_t p = 0; p < e->P; p++) {
        Part v = emit_load(e, t, part_at(e, place, p), emit_part_align(e, e->plan.flt_bytes), false);
        if (i->type == TY_BOOL) v = LL(BuildICmp)(e->b, LLVMIntNE, v, LL(ConstNull)(t), "");
        emit_slot(e, i)[p] = v;
    }
}

/* ---- choices */
void emit_settled(Emit *e, Inst *i) {
    Part v = emit_load(e, e->t_i32, emit_at_byte(e, e->chunks->settled, 4 * (uint64_t)i->imm.i), 4, false);
    if (e->plan.flt_bytes == 8) v = LL(BuildSExt)(e->b, v, e->t_i64, "");
    v = emit_splat(e, v);
    v = LL(BuildICmp)(e->b, LLVMIntSLT, v, LL(ConstNull)(LL(TypeOf)(v)), "");
    for (uint32_t p = 0; p < e->P; p++) emit_slot(e, i)[p] = v;
}

/* The lanes of this vector are bits i % 64 .. of the number for each operand: whole bytes, or a part of one. */
void emit_choice(Emit *e, const Inst *i) {
    LLVMTypeRef bits = LL(IntTypeInContext)(e->ctx, e->L), all = LL(IntTypeInContext)(e->ctx, e->W < 8 ? 8 : e->W);
    Part first = LL(BuildAnd)(e->b, e->i, emit_i64(e, SLT_CHOICE_BOXES - 1), ""),
         byte = LL(BuildLShr)(e->b, first, emit_i64(e, 3), "");
    for (uint32_t w = 0; w < 2; w++) {
        Part v[BACK_MAX_PARTS], sum = NULL;
        emit_parts(e, i->args[w], v);
        for (uint32_t p = 0; p < e->P; p++) {
            Part x = e->W == 1 ? v[p] : LL(BuildBitCast)(e->b, v[p], bits, "");
            if (LL(TypeOf)(x) != all) x = LL(BuildZExt)(e->b, x, all, "");
            if (p) x = LL(BuildShl)(e->b, x, emit_int(e, all, (uint64_t)p * e->L), "");
            sum = sum ? LL(BuildOr)(e->b, sum, x, "") : x;
        }
        Part at = emit_at_byte(e, e->chunks->choices, 8 * (2 * (uint64_t)i->imm.i + w));
        at = emit_gep(e, e->t_i8, at, byte);
        if (e->W < 8) {
            Part shift = LL(BuildTrunc)(e->b, LL(BuildAnd)(e->b, first, emit_i64(e, 7), ""), e->t_i8, ""),
                 one = emit_int(e, e->t_i8, 1), below = LL(BuildSub)(e->b, LL(BuildShl)(e->b, one, shift, ""), one, "");
            Part kept = LL(BuildAnd)(e->b, emit_load(e, e->t_i8, at, 1, false), below, "");
            sum = LL(BuildOr)(e->b, kept, LL(BuildShl)(e->b, sum, shift, ""), "");
        }
        emit_store(e, sum, at, 1);
    }
}
