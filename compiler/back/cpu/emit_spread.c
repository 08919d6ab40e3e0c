/* Iterations that add to adjoints and do nothing else, as many in each lane as the lane wants: over the sides of a
 * piece, over the frames of pieces. Most lanes want few, and with a lane for each sample most would be off. So
 * iterations are listed, those of all lanes, and run a part of a vector of them at a time: what they read of their
 * sample comes from its lane. In what runs so there may be a loop that does. */
#include "compiler/back/cpu/emit.h"

enum {
    SPREAD_MAX = 64, /* iterations of a lane */
    READ_MAX = 64,   /* values of a lane */
    FRAME_MAX = 4,   /* of a frame */
    FRAMES = 32      /* that are listed together */
};

typedef struct Spread {
    Block *body;
    Inst *k;                /* NULL: frames */
    const Inst *limit, *on; /* an iteration follows where on, k < limit */
    uint32_t most;          /* iterations */
    const FrameClass *frame;
    const Inst *read[READ_MAX];
    Part row[READ_MAX]; /* in memory, where lanes cannot be picked otherwise */
    uint32_t nread;
    uint32_t lane_bits;
    Part list;             /* of numbers of lanes and, above lane_bits, of iterations */
    Part value[FRAME_MAX]; /* beside it, of what frames have */
} Spread;

static bool inside(const Block *b, const Block *outer) {
    while (b != outer && b->owner) b = b->owner->block;
    return b == outer;
}

static bool note_read(Emit *e, Spread *s, const Inst *v) {
    if (ir_is_const(v) || !emit_is_vector(e, v) || inside(v->block, s->body)) return true;
    for (uint32_t i = 0; i < s->nread; i++)
        if (s->read[i] == v) return true;
    if (s->nread == READ_MAX) return false;
    s->read[s->nread++] = v;
    return true;
}

static bool counts(Emit *e, const Inst *loop, Spread *s);

/* Is there nothing that hangs on which sample runs in which lane? */
static bool can_spread(Emit *e, Spread *s, const Block *b) {
    Spread inner;
    for (const Inst *i = b->first; i; i = i->next) {
        switch (i->op) {
        case OP_adj:
            if (!emit_is_vector(e, i->args[0])) return false;
            break;
        case OP_loop:
            if (!s->frame || !counts(e, i, &inner)) return false;
            break;
        case OP_tapemark:
        case OP_tapepush:
            if (!s->frame) return false;
            break;
        case OP_revloop:
            if (!s->frame || i->nargs > 1) return false;
            break;
        case OP_constf:
        case OP_consti:
        case OP_constb:
        case OP_proj:
        case OP_yield:
        case OP_if_:
        case OP_any:
        case OP_told:
        case OP_param:
        case OP_iparam: break;
        default:
            if (ir_ops[i->op].special || ir_ops[i->op].math) return false;
        }
        for (uint32_t a = 0; a < i->nargs && i != s->on; a++) {
            if (i->args[a] == s->k && i->op != OP_yield && !emit_is_vector(e, i)) return false;
            if (!note_read(e, s, i->args[a])) return false;
        }
        for (uint32_t r = 0; r < i->nregions; r++)
            if (!can_spread(e, s, i->region[r])) return false;
    }
    return true;
}

/* Of AVX-512: lanes that are on are stored in front, and lanes of two vectors picked, by one instruction each. */
static bool compresses(const Emit *e) { return e->opt->target.vector_bytes == 64 && (e->L == 8 || e->L == 16); }
static bool picks(const Emit *e) { return compresses(e) && e->P <= 2; }

static void begin(Emit *e, Spread *s, Block *body) {
    *s = (Spread){.body = body};
    while (1u << s->lane_bits < e->plan.W) s->lane_bits++;
}

/* Is it a loop that counts, up to a number of the lane? */
static bool counts(Emit *e, const Inst *loop, Spread *s) {
    Block *body = loop->region[0];
    const Inst *on = body->last->args[0];
    begin(e, s, body);
    s->k = body->params[0], s->on = on, s->most = (uint32_t)loop->imm.loop.max_iters;
    if (loop->nargs || loop->imm.loop.cull || loop->imm.loop.max_iters > SPREAD_MAX) return false;
    if (on->op != OP_ilt || on->args[0] != s->k || inside(on->args[1]->block, body)) return false;
    s->limit = on->args[1];
    return emit_is_vector(e, s->limit) && can_spread(e, s, body);
}

/* Does it pop frames whose numbers are those of lanes? */
static bool pops(Emit *e, const Inst *loop, Spread *s) {
    Block *body = loop->region[0];
    begin(e, s, body);
    s->frame = back_frame_class(&e->plan.frames, e->arena, body->nparams, body->params);
    if (loop->nargs > 1 || !body->nparams || body->nparams > FRAME_MAX) return false;
    for (uint32_t j = 0; j < body->nparams; j++)
        if (!s->frame->varying[j] || body->params[j]->type == TY_BOOL) return false;
    return can_spread(e, s, body);
}

static Part integers(Emit *e, uint32_t v) { return emit_splat(e, emit_int(e, e->t_i32, v)); }

/* from, from + 1, ... */
static Part counting_from(Emit *e, Part from) {
    Part lane[BACK_MAX_WIDTH];
    for (uint32_t l = 0; l < e->L; l++) lane[l] = emit_int(e, e->t_i32, l);
    return LL(BuildAdd)(e->b, emit_splat(e, from), LL(ConstVector)(lane, e->L), "");
}

/* Where number `at` of a list goes: j = 0, the items, or what frames have. */
static Part place_in(Emit *e, const Spread *s, uint32_t j, Part at) {
    at = LL(BuildZExt)(e->b, at, e->t_i64, "");
    return j ? emit_gep(e, emit_scalar_type(e, (IrType)s->body->params[j - 1]->type), s->value[j - 1], at)
             : emit_gep(e, e->t_i32, s->list, at);
}

/* Adds what is on, part p; returns how many there are now. Before AVX-512 lane by lane: one that is off is overwritten
 * by the next. */
static Part append(Emit *e, const Spread *s, uint32_t p, Part on, Part first, const Part *value, Part count) {
    Part bits = LL(BuildBitCast)(e->b, on, LL(IntTypeInContext)(e->ctx, e->L), ""), all[FRAME_MAX + 1];
    const uint32_t n = 1 + (s->frame ? s->body->nparams : 0);
    all[0] = counting_from(e, LL(BuildAdd)(e->b, first, emit_int(e, e->t_i32, p * e->L), ""));
    for (uint32_t j = 1; j < n; j++) all[j] = value[j - 1];
    bits = LL(BuildZExt)(e->b, bits, e->t_i32, "");
    if (!compresses(e)) {
        for (uint32_t l = 0; l < e->L; l++) {
            Part lane = emit_int(e, e->t_i32, l), bit = LL(BuildLShr)(e->b, bits, lane, "");
            for (uint32_t j = 0; j < n; j++)
                emit_store(e, LL(BuildExtractElement)(e->b, all[j], lane, ""), place_in(e, s, j, count), 4);
            count = LL(BuildAdd)(e->b, count, LL(BuildAnd)(e->b, bit, emit_int(e, e->t_i32, 1), ""), "");
        }
        return count;
    }
    for (uint32_t j = 0; j < n; j++) emit_store(e, emit_compressed(e, all[j], on), place_in(e, s, j, count), 4);
    return LL(BuildAdd)(e->b, count, emit_intrinsic(e, "llvm.ctpop", e->t_i32, &bits, 1), "");
}

/* Lists what is to run, iteration 0 of all lanes first; returns how many, i32. */
static Part list_all(Emit *e, const Spread *s) {
    Part trips[BACK_MAX_PARTS], on[BACK_MAX_PARTS], zero = emit_int(e, e->t_i32, 0);
    emit_parts(e, s->limit, trips);
    for (uint32_t p = 0; p < e->P; p++) {
        Part low[2] = {trips[p], integers(e, 0)}, high[2];
        high[0] = emit_intrinsic(e, "llvm.smax", LL(TypeOf)(low[0]), low, 2), high[1] = integers(e, s->most - 1);
        trips[p] = emit_intrinsic(e, "llvm.smin", LL(TypeOf)(low[0]), high, 2);
        trips[p] = LL(BuildAdd)(e->b, trips[p], integers(e, 1), "");
        trips[p] = LL(BuildSelect)(e->b, emit_counting_lanes(e, p, NULL), trips[p], integers(e, 0), "");
    }
    LLVMBasicBlockRef from = emit_here(e), head = emit_new_block(e, "spread"), list = emit_new_block(e, "list"),
                      done = emit_new_block(e, "listed");
    LL(BuildBr)(e->b, head);
    emit_at(e, head);
    Part k = emit_phi(e, e->t_i32, "k"), count = emit_phi(e, e->t_i32, "count"), more = count;
    emit_incoming(e, k, zero, from), emit_incoming(e, count, zero, from);
    for (uint32_t p = 0; p < e->P; p++) on[p] = LL(BuildICmp)(e->b, LLVMIntSGT, trips[p], emit_splat(e, k), "");
    LL(BuildCondBr)(e->b, emit_any(e, on), list, done);
    emit_at(e, list);
    Part first = LL(BuildShl)(e->b, k, emit_int(e, e->t_i32, s->lane_bits), "");
    for (uint32_t p = 0; p < e->P; p++) more = append(e, s, p, on[p], first, NULL, more);
    emit_incoming(e, k, LL(BuildAdd)(e->b, k, emit_int(e, e->t_i32, 1), ""), emit_here(e));
    emit_incoming(e, count, more, emit_here(e));
    LL(BuildBr)(e->b, head);
    emit_at(e, done);
    return count;
}

/* Lists those of the frames above the mark that come next, and pops them; returns how many items that is, i32. */
static Part list_frames(Emit *e, const Spread *s, Part mark) {
    const FrameClass *c = s->frame;
    LLVMBasicBlockRef from = emit_here(e), head = emit_new_block(e, "frames"), list = emit_new_block(e, "frame"),
                      done = emit_new_block(e, "listed");
    Part first = emit_load(e, e->t_i64, e->tape_top, 8, false);
    LL(BuildBr)(e->b, head);
    emit_at(e, head);
    Part top = emit_phi(e, e->t_i64, "top"), count = emit_phi(e, e->t_i32, "count"), more = count;
    emit_incoming(e, top, first, from), emit_incoming(e, count, emit_int(e, e->t_i32, 0), from);
    Part room = LL(BuildICmp)(e->b, LLVMIntULE, count, emit_int(e, e->t_i32, (FRAMES - 1) * e->W), ""),
         some = LL(BuildICmp)(e->b, LLVMIntUGT, top, mark, "");
    LL(BuildCondBr)(e->b, LL(BuildAnd)(e->b, room, some, ""), list, done);
    emit_at(e, list);
    Part next = LL(BuildSub)(e->b, top, emit_i64(e, c->bytes), ""), frame = emit_gep(e, e->t_i8, e->tape, next),
         on[BACK_MAX_PARTS] = {NULL};
    if (c->masked) emit_load_bits(e, on, emit_at_byte(e, frame, c->mask_offset));
    for (uint32_t p = 0; p < e->P; p++) {
        Part value[FRAME_MAX];
        for (uint32_t j = 0; j < s->body->nparams; j++) {
            const Inst *x = s->body->params[j];
            const unsigned bytes = back_type_bytes(&e->plan, x->type);
            value[j] = emit_load(e, emit_vector_type(e, emit_scalar_type(e, (IrType)x->type)),
                                 emit_at_byte(e, frame, c->offset[j] + (uint64_t)p * e->L * bytes), bytes, false);
        }
        more = append(e, s, p, emit_counting_lanes(e, p, on[p]), emit_int(e, e->t_i32, 0), value, more);
    }
    emit_incoming(e, top, next, emit_here(e)), emit_incoming(e, count, more, emit_here(e));
    LL(BuildBr)(e->b, head);
    emit_at(e, done);
    emit_store(e, top, e->tape_top, 8);
    return count;
}

/* Of a value with these parts, the lanes that `lane` names. */
static Part from_lanes(Emit *e, const Part *v, IrType type, Part lane) {
    const bool wide = type == TY_FLT && e->plan.flt_bytes == 8;
    LLVMTypeRef own = LL(TypeOf)(v[0]), t = emit_vector_type(e, wide ? e->t_i64 : e->t_i32);
    const char *name = wide         ? "llvm.x86.avx512.vpermi2var.q.512"
                       : e->L == 16 ? "llvm.x86.avx512.vpermi2var.d.512"
                                    : "llvm.x86.avx512.vpermi2var.d.256";
    unsigned id = LL(LookupIntrinsicID)(name, 32);
    Part f = LL(GetIntrinsicDeclaration)(e->mod, id, NULL, 0), args[3] = {v[0], lane, v[e->P - 1]};
    for (int a = 0; a < 3; a += 2)
        args[a] = type == TY_BOOL ? LL(BuildZExt)(e->b, args[a], t, "") : LL(BuildBitCast)(e->b, args[a], t, "");
    if (wide) args[1] = LL(BuildZExt)(e->b, lane, t, "");
    Part x = LL(BuildCall2)(e->b, LL(IntrinsicGetType)(e->ctx, id, NULL, 0), f, args, 3, "");
    return type == TY_BOOL ? LL(BuildTrunc)(e->b, x, own, "") : LL(BuildBitCast)(e->b, x, own, "");
}

/* Of a value in memory. */
static Part from_row(Emit *e, Part row, IrType type, Part lane) {
    LLVMTypeRef t = type == TY_BOOL ? e->t_i32 : emit_scalar_type(e, type);
    Part x = emit_gather(e, t, emit_gep(e, t, row, lane), type == TY_FLT ? e->plan.flt_bytes : 4);
    return type == TY_BOOL ? LL(BuildTrunc)(e->b, x, emit_vector_type(e, e->t_i1), "") : x;
}

static void put_row(Emit *e, Spread *s, uint32_t i) {
    const IrType type = (IrType)s->read[i]->type;
    const unsigned bytes = type == TY_FLT ? e->plan.flt_bytes : 4;
    LLVMTypeRef t = type == TY_BOOL ? e->t_i32 : emit_scalar_type(e, type);
    Part v[BACK_MAX_PARTS];
    emit_parts(e, s->read[i], v);
    s->row[i] = emit_alloca(e, LL(ArrayType2)(t, e->W), 1, 64);
    for (uint32_t p = 0; p < e->P; p++)
        emit_store(e, type == TY_BOOL ? LL(BuildZExt)(e->b, v[p], emit_vector_type(e, t), "") : v[p],
                   emit_at_byte(e, s->row[i], (uint64_t)p * e->L * bytes), bytes);
}

/* The body, for the items from `at` on: one part of them, as most lists are short. */
static void emit_items(Emit *e, const Spread *s, Part at, Part count) {
    Part *outer = e->mask, here = LL(BuildICmp)(e->b, LLVMIntULT, counting_from(e, at), emit_splat(e, count), "");
    Part(*kept)[BACK_MAX_PARTS] = arena_alloc(e->arena, (s->nread + 1) * sizeof *kept);
    const uint32_t P = e->P, W = e->W;
    const bool spread = e->spread;
    at = LL(BuildZExt)(e->b, at, e->t_i64, "");
    Part item = emit_load(e, emit_vector_type(e, e->t_i32), emit_gep(e, e->t_i32, s->list, at), 4, false);
    Part lane = LL(BuildAnd)(e->b, item, integers(e, (1u << s->lane_bits) - 1), "");
    for (uint32_t i = 0; i < s->nread; i++) {
        emit_parts(e, s->read[i], kept[i]);
        const IrType type = (IrType)s->read[i]->type;
        emit_slot(e, s->read[i])[0] =
            picks(e) ? from_lanes(e, kept[i], type, lane) : from_row(e, s->row[i], type, lane);
    }
    if (s->k) {
        s->k->flags |= BACK_VARYING;
        emit_slot(e, s->k)[0] = LL(BuildLShr)(e->b, item, integers(e, s->lane_bits), "");
    }
    for (uint32_t j = 0; s->frame && j < s->body->nparams; j++) {
        LLVMTypeRef t = emit_scalar_type(e, (IrType)s->body->params[j]->type);
        emit_slot(e, s->body->params[j])[0] = emit_load(e, emit_vector_type(e, t), emit_gep(e, t, s->value[j], at),
                                                        back_type_bytes(&e->plan, s->body->params[j]->type), false);
    }
    e->mask = &here, e->spread = true, e->P = 1, e->W = e->L;
    emit_block(e, s->body);
    e->mask = outer, e->spread = spread, e->P = P, e->W = W;
    for (uint32_t i = 0; i < s->nread; i++) emit_slot(e, s->read[i])[0] = kept[i][0];
}

/* All that are listed, and then on to `done`. */
static void run_all(Emit *e, Spread *s, Part count, LLVMBasicBlockRef done) {
    for (uint32_t i = 0; i < s->nread && !picks(e); i++) put_row(e, s, i);
    LLVMBasicBlockRef from = emit_here(e), head = emit_new_block(e, "items"), some = emit_new_block(e, "some");
    LL(BuildBr)(e->b, head);
    emit_at(e, head);
    Part at = emit_phi(e, e->t_i32, "at");
    emit_incoming(e, at, emit_int(e, e->t_i32, 0), from);
    LL(BuildCondBr)(e->b, LL(BuildICmp)(e->b, LLVMIntULT, at, count, ""), some, done);
    emit_at(e, some);
    emit_items(e, s, at, count);
    if (e->error) return;
    emit_incoming(e, at, LL(BuildAdd)(e->b, at, emit_int(e, e->t_i32, e->L), ""), emit_here(e));
    LL(BuildBr)(e->b, head);
}

static Part list_of(Emit *e, IrType type, uint32_t items) {
    return emit_alloca(e, LL(ArrayType2)(emit_scalar_type(e, type), items + SLT_PAD), 1, 64);
}

bool emit_spread(Emit *e, Inst *loop) {
    Spread s;
    if (!e->told || e->L < 4 || !counts(e, loop, &s)) return false;
    s.list = list_of(e, TY_INT, e->W * s.most);
    Part count = list_all(e, &s);
    LLVMBasicBlockRef done = emit_new_block(e, "spread_out");
    run_all(e, &s, count, done);
    emit_at(e, done);
    return true;
}

bool emit_spread_frames(Emit *e, Inst *loop) {
    Spread s;
    if (!e->told || e->L < 4 || e->spread || !pops(e, loop, &s)) return false;
    s.list = list_of(e, TY_INT, e->W * FRAMES);
    for (uint32_t j = 0; j < s.body->nparams; j++)
        s.value[j] = list_of(e, (IrType)s.body->params[j]->type, e->W * FRAMES);
    Part mark = emit_scalar(e, loop->args[0]);
    LLVMBasicBlockRef head = emit_new_block(e, "unwind"), some = emit_new_block(e, "pop"),
                      done = emit_new_block(e, "unwound");
    LL(BuildBr)(e->b, head);
    emit_at(e, head);
    Part top = emit_load(e, e->t_i64, e->tape_top, 8, false);
    LL(BuildCondBr)(e->b, LL(BuildICmp)(e->b, LLVMIntUGT, top, mark, ""), some, done);
    emit_at(e, some);
    run_all(e, &s, list_frames(e, &s, mark), head);
    emit_at(e, done);
    return true;
}
