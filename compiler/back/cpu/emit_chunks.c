/* Straight-line programs in chunks (pass/variant_chunks.c): a jump from chunk to chunk along the list of those that
 * run.
 *
 *     next:     switch *list++ { chunk 0, chunk 1, ... otherwise: behind }
 *     chunk k:  operands of other chunks from the frame; 16 operations; what others use to the frame; goto next
 *
 * Values that chunks hand to each other lie in memory, in slots of one frame a vector: as SSA values they would need a
 * phi at every chunk that may be skipped, and LLVM's time would grow with the square of the program. So blocks are
 * short, and compiling is linear. A slot is reused behind the last chunk that reads it. The slot of a chunk that did
 * not run holds anything: nobody looks at it. */
#include <string.h>

#include "compiler/back/cpu/emit.h"

struct ChunkState {
    Part list, settled; /* of SltPruned, or of constants that say the same of a program that is not pruned */
    Part choices;       /* of SltKernelArgs, or of a place that nobody reads */
    Part frame;
    uint32_t bytes;  /* of a slot */
    uint32_t *slot;  /* by id of a proj: 1 + its slot; 0: no value of a chunk */
    bool *outside;   /* by id of a proj: something that is in no chunk uses it */
    Vec(Inst *) own; /* values that the chunk at hand has read */
    Vec(Part *) was; /* and where they were before */
    bool inside;
};

static bool is_chunk(const Inst *i) { return i->op == OP_if_ && i->args[0]->op == OP_live; }
static bool of_chunk(const Inst *i) { return i->op == OP_proj && is_chunk(i->args[0]); }

/* ---- slots: the last place of the top block that uses a value decides when its slot is free */
typedef struct Uses {
    uint32_t *last; /* by id of a proj */
    uint32_t place; /* in the top block */
    bool *outside;
} Uses;

static void note_uses(Uses *u, const Inst *i, bool chunk) {
    for (uint32_t a = 0; a < i->nargs; a++)
        if (of_chunk(i->args[a])) u->last[i->args[a]->id] = u->place, u->outside[i->args[a]->id] |= !chunk;
    for (uint32_t r = 0; r < i->nregions; r++)
        for (const Inst *j = i->region[r]->first; j; j = j->next) note_uses(u, j, chunk);
}

static uint32_t give_slots(Emit *e, ChunkState *s) {
    Uses u = {.last = ARENA_ARRAY(e->arena, uint32_t, e->fn->ninsts + 1), .outside = s->outside};
    for (const Inst *i = e->fn->body->first; i; i = i->next) u.place++, note_uses(&u, i, is_chunk(i));
    uint32_t nslots = 0, place = 0;
    Vec(uint32_t) free = {0};
    Vec(const Inst *) taken = {0};
    for (const Inst *i = e->fn->body->first; i; i = i->next) {
        place++;
        if (is_chunk(i)) {
            uint32_t kept = 0;
            for (uint32_t t = 0; t < taken.len; t++)
                if (u.last[taken.data[t]->id] < place) vec_push(e->arena, &free, s->slot[taken.data[t]->id]);
                else taken.data[kept++] = taken.data[t];
            taken.len = kept;
        }
        if (!of_chunk(i)) continue;
        s->slot[i->id] = free.len ? free.data[--free.len] : ++nslots;
        vec_push(e->arena, &taken, i);
    }
    return nslots;
}

/* ---- what is loaded once a call */
static Part constant_array(Emit *e, uint32_t n, bool numbers, uint32_t end) {
    Part *v = ARENA_ARRAY(e->arena, Part, n + 1);
    for (uint32_t k = 0; k < n; k++) v[k] = emit_int(e, e->t_i32, numbers ? k : 0);
    v[n] = emit_int(e, e->t_i32, end);
    LLVMTypeRef t = LL(ArrayType2)(e->t_i32, n + 1);
    Part g = LL(AddGlobal)(e->mod, t, "unpruned");
    LL(SetInitializer)(g, LL(ConstArray2)(e->t_i32, v, n + 1));
    LL(SetGlobalConstant)(g, true);
    LL(SetLinkage)(g, LLVMPrivateLinkage);
    return g;
}

typedef struct Counts {
    uint32_t chunks, choices; /* one more than the largest number */
    bool notes;
} Counts;

static void count(Counts *c, const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        uint32_t n = (uint32_t)i->imm.i + 1;
        if (i->op == OP_live && n > c->chunks) c->chunks = n;
        if (i->op == OP_choice && n > c->choices) c->choices = n;
        if (i->op == OP_settled && (n + 1) / 2 > c->choices) c->choices = (n + 1) / 2;
        c->notes |= i->op == OP_choice;
        for (uint32_t r = 0; r < i->nregions; r++) count(c, i->region[r]);
    }
}

void emit_chunks_setup(Emit *e) {
    Counts c = {0};
    count(&c, e->fn->body);
    if (!c.chunks && !c.choices) return;
    ChunkState *s = e->chunks = ARENA_NEW(e->arena, ChunkState);
    s->slot = ARENA_ARRAY(e->arena, uint32_t, e->fn->ninsts + 1);
    s->outside = ARENA_ARRAY(e->arena, bool, e->fn->ninsts + 1);
    s->bytes = e->W * e->plan.flt_bytes;
    uint64_t bytes = (uint64_t)give_slots(e, s) * s->bytes;
    e->frame_bytes += bytes;
    if (e->frame_bytes > BACK_MAX_FRAME) {
        emit_fail(e, "the values of its chunks take more than %u bytes", BACK_MAX_FRAME);
        return;
    }
    s->frame = emit_alloca(e, LL(ArrayType2)(e->t_i8, bytes + 1), 1, 64);
    Part all = constant_array(e, c.chunks, true, SLT_NO_CHUNK), none = constant_array(e, 2 * c.choices, false, 0);
    Part pruned = emit_load(e, e->t_ptr, emit_field_ptr(e, offsetof(SltKernelArgs, pruned)), 8, true);
    LLVMBasicBlockRef from = emit_here(e), given = emit_new_block(e, "pruned"), join = emit_new_block(e, "chunks");
    LL(BuildCondBr)(e->b, LL(BuildICmp)(e->b, LLVMIntNE, pruned, LL(ConstNull)(e->t_ptr), ""), given, join);
    emit_at(e, given);
    Part list = emit_load(e, e->t_ptr, emit_at_byte(e, pruned, offsetof(SltPruned, chunks)), 8, true),
         settled = emit_load(e, e->t_ptr, emit_at_byte(e, pruned, offsetof(SltPruned, settled)), 8, true);
    LL(BuildBr)(e->b, join);
    emit_at(e, join);
    s->list = emit_phi(e, e->t_ptr, "list"), s->settled = emit_phi(e, e->t_ptr, "settled");
    emit_incoming(e, s->list, all, from), emit_incoming(e, s->list, list, given);
    emit_incoming(e, s->settled, none, from), emit_incoming(e, s->settled, settled, given);
    if (!c.notes) return;
    Part unread = emit_alloca(e, LL(ArrayType2)(e->t_i64, 2 * (uint64_t)c.choices), 1, 64),
         noted = emit_load(e, e->t_ptr, emit_field_ptr(e, offsetof(SltKernelArgs, choices)), 8, true);
    Part wanted = LL(BuildICmp)(e->b, LLVMIntNE, noted, LL(ConstNull)(e->t_ptr), "");
    s->choices = LL(BuildSelect)(e->b, wanted, noted, unread, "");
}

/* ---- values between chunks */
static Part slot_part(Emit *e, const Inst *proj, uint32_t p) {
    uint64_t at = (uint64_t)(e->chunks->slot[proj->id] - 1) * e->chunks->bytes;
    return emit_at_byte(e, e->chunks->frame, at + (uint64_t)p * e->L * e->plan.flt_bytes);
}

/* A boolean lies there as an integer of the width of a float: vectors of i1 have no place in memory. */
static LLVMTypeRef slot_type(Emit *e, const Inst *i) {
    LLVMTypeRef t = i->type != TY_BOOL ? emit_scalar_type(e, i->type) : e->plan.flt_bytes == 8 ? e->t_i64 : e->t_i32;
    return emit_is_vector(e, i) ? emit_vector_type(e, t) : t;
}

static void read_slot(Emit *e, Inst *proj) {
    LLVMTypeRef t = slot_type(e, proj);
    for (uint32_t p = 0; p < back_value_parts(&e->plan, proj); p++) {
        Part v = emit_load(e, t, slot_part(e, proj, p), emit_part_align(e, e->plan.flt_bytes), false);
        if (proj->type == TY_BOOL) v = LL(BuildICmp)(e->b, LLVMIntNE, v, LL(ConstNull)(t), "");
        emit_slot(e, proj)[p] = v;
    }
}

static void write_slot(Emit *e, const Inst *proj, const Inst *value) {
    Part v[BACK_MAX_PARTS];
    if (emit_is_vector(e, proj)) emit_parts(e, value, v);
    else v[0] = emit_scalar(e, value);
    for (uint32_t p = 0; p < back_value_parts(&e->plan, proj); p++) {
        if (proj->type == TY_BOOL) v[p] = LL(BuildSExt)(e->b, v[p], slot_type(e, proj), "");
        emit_store(e, v[p], slot_part(e, proj, p), emit_part_align(e, e->plan.flt_bytes));
    }
}

void emit_chunk_operands(Emit *e, const Inst *i) {
    ChunkState *s = e->chunks;
    if (!s->inside) return;
    for (uint32_t a = 0; a < i->nargs; a++) {
        Inst *x = i->args[a];
        bool known = !of_chunk(x);
        for (uint32_t k = 0; k < s->own.len && !known; k++) known = s->own.data[k] == x;
        if (known) continue;
        vec_push(e->arena, &s->own, x);
        vec_push(e->arena, &s->was, arena_copy(e->arena, emit_slot(e, x), e->P * sizeof(Part)));
        read_slot(e, x);
    }
}

static void emit_chunk(Emit *e, const Inst *i) {
    ChunkState *s = e->chunks;
    s->own.len = s->was.len = 0, s->inside = true;
    emit_block(e, i->region[0]);
    const Inst *y = ir_yield_of(i->region[0]);
    for (const Inst *p = i->next; p && p->op == OP_proj && p->args[0] == i; p = p->next)
        if (!e->error) write_slot(e, p, y->args[p->imm.i]);
    s->inside = false;
    for (uint32_t k = 0; k < s->own.len; k++) memcpy(emit_slot(e, s->own.data[k]), s->was.data[k], e->P * sizeof(Part));
}

Inst *emit_chunks(Emit *e, Inst *first) {
    ChunkState *s = e->chunks;
    Inst *last = first;
    uint32_t n = 0;
    for (Inst *i = first; is_chunk(i) || of_chunk(i) || i->op == OP_live || ir_is_const(i); last = i, i = i->next)
        n += is_chunk(i);
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
        emit_chunk(e, i);
        emit_incoming(e, at, next, emit_here(e));
        LL(BuildBr)(e->b, head);
    }
    emit_at(e, behind);
    s->list = at; /* of the chunks behind */
    for (Inst *i = first; i != last->next; i = i->next)
        if (of_chunk(i) && s->outside[i->id]) read_slot(e, i);
    return last;
}

/* ---- choices */
void emit_settled(Emit *e, Inst *i) {
    Part v = emit_load(e, e->t_i32, emit_at_byte(e, e->chunks->settled, 4 * (uint64_t)i->imm.i), 4, false);
    if (e->plan.flt_bytes == 8) v = LL(BuildSExt)(e->b, v, e->t_i64, "");
    v = emit_splat(e, v);
    v = LL(BuildICmp)(e->b, LLVMIntSLT, v, LL(ConstNull)(LL(TypeOf)(v)), "");
    for (uint32_t p = 0; p < back_value_parts(&e->plan, i); p++) emit_slot(e, i)[p] = v;
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
