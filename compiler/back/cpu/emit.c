/* One kernel: the loop over vectors of samples, and the helpers every emitting file uses. Control flow is in
 * emit_if.c and emit_loop.c, value rows in emit_ops.c; emit_memory.c says which file emits what touches memory.
 *
 * entry: stack objects only    setup: pointers, uniform inputs, uniform arithmetic of the top block    sample: one
 * vector    exit: ret */
#include "compiler/back/cpu/emit.h"

#include <stdarg.h>
#include <string.h>

void emit_fail(Emit *e, const char *fmt, ...) {
    if (e->error) return;
    char text[256];
    va_list ap;
    va_start(ap, fmt);
    vsnprintf(text, sizeof text, fmt, ap);
    va_end(ap);
    e->error = arena_printf(e->arena, "%s", text);
}

bool emit_is_vector(const Emit *e, const Inst *i) { return back_is_vector(&e->plan, i); }

LLVMTypeRef emit_scalar_type(Emit *e, IrType t) {
    switch (t) {
    case TY_BOOL: return e->t_i1;
    case TY_INT: return e->t_i32;
    case TY_FLT: return e->t_flt;
    case TY_TAPE: return e->t_i64;
    case TY_VOID:
    case TY_ARRAY: break;
    }
    return e->t_ptr;
}

LLVMTypeRef emit_vector_type(Emit *e, LLVMTypeRef scalar) { return e->W == 1 ? scalar : LL(VectorType)(scalar, e->L); }

Part *emit_slot(Emit *e, const Inst *i) { return e->val + (size_t)i->id * e->plan.P; }

Part emit_int(Emit *e, LLVMTypeRef t, uint64_t v) { return LL(ConstInt)(t, v, false); }

static Part constant(Emit *e, const Inst *i) {
    if (i->op == OP_constf)
        return LL(ConstReal)(e->t_flt, e->fn->precision == PREC_F32 ? (double)(float)i->imm.f : i->imm.f);
    return i->op == OP_consti ? emit_int(e, e->t_i32, (uint32_t)i->imm.i) : emit_int(e, e->t_i1, i->imm.i != 0);
}

Part emit_scalar(Emit *e, const Inst *i) { return ir_is_const(i) ? constant(e, i) : emit_slot(e, i)[0]; }

Part emit_splat(Emit *e, Part scalar) {
    if (e->W == 1) return scalar;
    Part lanes[BACK_MAX_WIDTH];
    if (LL(IsAConstant)(scalar)) {
        for (uint32_t l = 0; l < e->L; l++) lanes[l] = scalar;
        return LL(ConstVector)(lanes, e->L);
    }
    LLVMTypeRef v = emit_vector_type(e, LL(TypeOf)(scalar));
    Part one = LL(BuildInsertElement)(e->b, LL(GetPoison)(v), scalar, emit_int(e, e->t_i32, 0), "");
    return LL(BuildShuffleVector)(e->b, one, LL(GetPoison)(v), LL(ConstNull)(LL(VectorType)(e->t_i32, e->L)), "");
}

void emit_parts(Emit *e, const Inst *i, Part *out) {
    if (emit_is_vector(e, i)) {
        memcpy(out, emit_slot(e, i), e->P * sizeof *out);
        return;
    }
    Part v = emit_splat(e, emit_scalar(e, i));
    for (uint32_t p = 0; p < e->P; p++) out[p] = v;
}

Part emit_const_like(Emit *e, LLVMTypeRef shape, LLVMTypeRef scalar, double f, uint64_t i, bool is_float) {
    Part c = is_float ? LL(ConstReal)(scalar, f) : LL(ConstInt)(scalar, i, false);
    if (LL(GetTypeKind)(shape) != LLVMVectorTypeKind) return c;
    Part lanes[BACK_MAX_WIDTH];
    for (uint32_t l = 0; l < e->L; l++) lanes[l] = c;
    return LL(ConstVector)(lanes, e->L);
}

Part emit_intrinsic(Emit *e, const char *name, LLVMTypeRef overload, Part *args, unsigned n) {
    unsigned id = LL(LookupIntrinsicID)(name, strlen(name));
    LLVMTypeRef *types = overload ? &overload : NULL;
    Part f = LL(GetIntrinsicDeclaration)(e->mod, id, types, overload != NULL);
    return LL(BuildCall2)(e->b, LL(IntrinsicGetType)(e->ctx, id, types, overload != NULL), f, args, n, "");
}

Part emit_gep(Emit *e, LLVMTypeRef elem, Part base, Part index) {
    return LL(BuildGEP2)(e->b, elem, base, &index, 1, "");
}
Part emit_field_ptr(Emit *e, size_t offset) { return emit_gep(e, e->t_i8, e->args, emit_int(e, e->t_i64, offset)); }

Part emit_load(Emit *e, LLVMTypeRef t, Part ptr, unsigned align, bool invariant) {
    Part v = LL(BuildLoad2)(e->b, t, ptr, "");
    LL(SetAlignment)(v, align);
    if (invariant)
        LL(SetMetadata)(v, e->md_invariant, LL(MetadataAsValue)(e->ctx, LL(MDNodeInContext2)(e->ctx, NULL, 0)));
    return v;
}

void emit_store(Emit *e, Part value, Part ptr, unsigned align) {
    LL(SetAlignment)(LL(BuildStore)(e->b, value, ptr), align);
}

LLVMBasicBlockRef emit_here(Emit *e) { return LL(GetInsertBlock)(e->b); }
LLVMBasicBlockRef emit_new_block(Emit *e, const char *name) {
    return LL(AppendBasicBlockInContext)(e->ctx, e->func, name);
}

void emit_at(Emit *e, LLVMBasicBlockRef bb) {
    LL(PositionBuilderAtEnd)(e->b, bb);
    e->since_split = 0;
}

Part emit_alloca(Emit *e, LLVMTypeRef t, uint64_t count, unsigned align) {
    LLVMBasicBlockRef here = emit_here(e);
    LL(PositionBuilderAtEnd)(e->b, e->entry);
    Part p =
        count == 1 ? LL(BuildAlloca)(e->b, t, "") : LL(BuildArrayAlloca)(e->b, t, emit_int(e, e->t_i64, count), "");
    LL(SetAlignment)(p, align);
    LL(PositionBuilderAtEnd)(e->b, here);
    return p;
}

Part emit_phi(Emit *e, LLVMTypeRef t, const char *name) { return LL(BuildPhi)(e->b, t, name); }
void emit_incoming(Emit *e, Part phi, Part v, LLVMBasicBlockRef from) { LL(AddIncoming)(phi, &v, &from, 1); }

Part emit_any(Emit *e, const Part *mask) {
    if (e->W == 1) return mask[0];
    Part all = mask[0];
    for (uint32_t p = 1; p < e->P; p++) all = LL(BuildOr)(e->b, all, mask[p], "");
    LLVMTypeRef bits = LL(IntTypeInContext)(e->ctx, e->L);
    return LL(BuildICmp)(e->b, LLVMIntNE, LL(BuildBitCast)(e->b, all, bits, ""), LL(ConstNull)(bits), "any");
}

const uint32_t *emit_uses(Emit *e) {
    if (!e->uses) {
        e->uses = ARENA_ARRAY(e->arena, uint32_t, e->fn->ninsts + 1);
        ir_count_uses(e->fn->body, e->uses);
    }
    return e->uses;
}

void emit_and_mask(Emit *e, const Part *m, Part *out) {
    for (uint32_t p = 0; p < e->P; p++) out[p] = e->mask ? LL(BuildAnd)(e->b, m[p], e->mask[p], "") : m[p];
}

/* ---- inputs and outputs */
static Part pointer_field(Emit *e, Part *cache, size_t offset) {
    if (!*cache) *cache = emit_load(e, e->t_ptr, emit_field_ptr(e, offset), 8, true);
    return *cache;
}

static void emit_input(Emit *e, Inst *i) {
    Part *v = emit_slot(e, i);
    uint32_t slot = (uint32_t)i->imm.i;
    if (slot >= SLT_IN_VARYING) {
        v[0] = e->in[slot];
        return;
    }
    LLVMTypeRef t = emit_scalar_type(e, i->type);
    unsigned bytes = back_type_bytes(&e->plan, i->type);
    if (e->fn->same >> slot & 1) {
        v[0] = emit_load(e, t, e->in[slot], bytes, true);
        return;
    }
    Part first = emit_gep(e, t, e->in[slot], e->i);
    for (uint32_t p = 0; p < e->P; p++) {
        Part at = p ? emit_gep(e, t, first, emit_int(e, e->t_i64, (uint64_t)p * e->L)) : first;
        v[p] = emit_load(e, emit_vector_type(e, t), at, emit_part_align(e, bytes), false);
    }
}

void emit_outputs(Emit *e, const Inst *yield) {
    if (emit_packs_pixels(e, yield)) {
        emit_pixels(e, yield);
        return;
    }
    for (uint32_t j = 0; j < yield->nargs; j++) {
        const Inst *x = yield->args[j];
        Part v[BACK_MAX_PARTS];
        emit_parts(e, x, v);
        LLVMTypeRef t = x->type == TY_FLT ? e->t_flt : e->t_i32;
        Part first = emit_gep(e, t, e->out[j], e->i);
        for (uint32_t p = 0; p < e->P; p++) {
            Part w = x->type == TY_BOOL ? LL(BuildZExt)(e->b, v[p], emit_vector_type(e, t), "") : v[p];
            emit_store(e, w, emit_gep(e, t, first, emit_int(e, e->t_i64, (uint64_t)p * e->L)),
                       emit_part_align(e, back_type_bytes(&e->plan, x->type)));
        }
    }
}

/* ---- what the kernel needs from its arguments, loaded once */
static void setup_culls(Emit *e, uint32_t id);
static void setup_notes(Emit *e, uint32_t id);

static void setup_block(Emit *e, const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        switch (i->op) {
        case OP_input: {
            uint32_t s = (uint32_t)i->imm.i;
            if (s < SLT_IN_VARYING) pointer_field(e, &e->in[s], offsetof(SltKernelArgs, in) + s * sizeof(void *));
            else if (!e->in[s])
                e->in[s] = emit_load(e, e->t_i32, emit_field_ptr(e, ir_uniform_offset((InputSlot)s)), 4, true);
            break;
        }
        case OP_param:
        case OP_query: /* the search reads the geometry's numbers in the parameters */
            pointer_field(e, &e->params, offsetof(SltKernelArgs, params));
            break;
        case OP_iparam: pointer_field(e, &e->iparams, offsetof(SltKernelArgs, iparams)); break;
        case OP_dparam: pointer_field(e, &e->dparams, offsetof(SltKernelArgs, dparams)); break;
        case OP_adj: pointer_field(e, &e->adj, offsetof(SltKernelArgs, adj)); break;
        case OP_told:
            if (!e->told) emit_setup_told(e, i);
            break;
        case OP_tapemark:
        case OP_tapepush:
        case OP_tapedrop:
        case OP_revloop:
            if (!e->tape_top) {
                pointer_field(e, &e->tape, offsetof(SltKernelArgs, tape));
                e->tape_end = emit_load(e, e->t_i64, emit_field_ptr(e, offsetof(SltKernelArgs, tape_bytes)), 8, true);
                e->tape_top = emit_alloca(e, e->t_i64, 1, 8);
            }
            break;
        case OP_loop:
            if (i->imm.loop.cull) setup_culls(e, i->imm.loop.cull_id);
            break;
        case OP_item:
        case OP_items: setup_culls(e, (uint32_t)i->imm.i); break;
        case OP_note: setup_notes(e, (uint32_t)i->imm.i); break;
        default: break;
        }
        for (uint32_t r = 0; r < i->nregions; r++) setup_block(e, i->region[r]);
    }
}

/* items and count of one cull list; without a list the count is -1 and items some readable int. */
static void setup_culls(Emit *e, uint32_t id) {
    if (id >= BACK_MAX_CULL) {
        emit_fail(e, "more than %d loops with lists", BACK_MAX_CULL);
        return;
    }
    if (e->cull[id].items) return;
    Part lists = emit_load(e, e->t_ptr, emit_field_ptr(e, offsetof(SltKernelArgs, cull)), 8, true);
    LLVMBasicBlockRef from = emit_here(e), given = emit_new_block(e, "cull"), join = emit_new_block(e, "culled");
    LL(BuildCondBr)(e->b, LL(BuildICmp)(e->b, LLVMIntNE, lists, LL(ConstNull)(e->t_ptr), ""), given, join);
    emit_at(e, given);
    Part list = emit_gep(e, e->t_i8, lists, emit_int(e, e->t_i64, id * sizeof(SltCullList)));
    Part items = emit_load(e, e->t_ptr, list, 8, true);
    Part count = emit_load(e, e->t_i32, emit_gep(e, e->t_i8, list, emit_int(e, e->t_i64, offsetof(SltCullList, count))),
                           4, true);
    Part some = LL(BuildICmp)(e->b, LLVMIntSGT, count, emit_int(e, e->t_i32, 0), "");
    items = LL(BuildSelect)(e->b, some, items, e->args, "");
    LL(BuildBr)(e->b, join);
    emit_at(e, join);
    e->cull[id].items = emit_phi(e, e->t_ptr, "items");
    e->cull[id].count = emit_phi(e, e->t_i32, "count");
    emit_incoming(e, e->cull[id].items, e->args, from);
    emit_incoming(e, e->cull[id].items, items, given);
    emit_incoming(e, e->cull[id].count, emit_int(e, e->t_i32, UINT32_MAX), from);
    emit_incoming(e, e->cull[id].count, count, given);
}

/* Where the notes of one list go: some readable pointer stands for the address where there are none. */
static void setup_notes(Emit *e, uint32_t id) {
    if (e->cull[id].notes) return;
    Part scratch = emit_alloca(e, LL(ArrayType2)(e->t_i64, sizeof(SltNote) / 8), 1, 8);
    Part notes = emit_load(e, e->t_ptr, emit_field_ptr(e, offsetof(SltKernelArgs, note)), 8, true);
    Part wanted = LL(BuildICmp)(e->b, LLVMIntNE, notes, LL(ConstNull)(e->t_ptr), "");
    Part from = LL(BuildSelect)(e->b, wanted, notes, e->args, "");
    Part at = emit_load(e, e->t_ptr, emit_gep(e, e->t_ptr, from, emit_int(e, e->t_i64, id)), 8, true);
    e->cull[id].notes = LL(BuildSelect)(e->b, wanted, at, scratch, "notes");
    e->cull[id].noted = LL(BuildSExt)(e->b, wanted, e->t_i64, "noted");
}

/* Uniform arithmetic of the top block depends on nothing in the loop over samples: it is done once a call. LLVM cannot
 * know that the outputs do not alias the parameters. Bounded, since every such value lives through the whole loop; a
 * plain read of a parameter is cheaper where it is used. */
enum { HOIST_LIMIT = 128 };

static bool is_read(const Inst *i) { return i->op == OP_param || i->op == OP_iparam || i->op == OP_dparam; }
static bool ready(const Emit *e, const Inst *i) { return ir_is_const(i) || e->val[(size_t)i->id * e->plan.P]; }

/* A read of a parameter at an index that is known or hoisted is emitted when hoisted arithmetic asks for it. */
static bool available(Emit *e, Inst *i) {
    if (ready(e, i)) return true;
    if (i->flags & BACK_VARYING || i->block != e->fn->body) return false;
    if (i->op == OP_input) emit_input(e, i);
    else if (is_read(i) && ready(e, i->args[0])) emit_memory_op(e, i);
    return ready(e, i);
}

static void hoist_uniform(Emit *e) {
    uint32_t hoisted = 0;
    for (Inst *i = e->fn->body->first; i && hoisted < HOIST_LIMIT; i = i->next) {
        if ((i->flags & BACK_VARYING) || ir_ops[i->op].special || ir_ops[i->op].math) continue;
        bool all = true;
        for (uint32_t j = 0; j < i->nargs && all; j++) all = available(e, i->args[j]);
        if (!all) continue;
        emit_value_op(e, i);
        hoisted++;
    }
    for (Inst *i = e->fn->body->first; i; i = i->next)
        if (is_read(i)) emit_slot(e, i)[0] = NULL; /* other uses read again, close by */
}

/* ---- blocks */
/* LLVM's scheduling is worse than linear in the length of a block, so long ones are cut by a branch that is never
 * taken, on a condition that no pass can decide. */
enum { LONG_BLOCK = 300, RUN = 64, LONG_RUN = 160 /* with lookups */ };

static bool is_long(const Emit *e) { return e->since_split * e->P >= LONG_BLOCK; }

static void split_long_block(Emit *e) {
    if (!is_long(e)) return;
    LLVMBasicBlockRef next = emit_new_block(e, "next");
    Part never =
        LL(BuildICmp)(e->b, LLVMIntEQ, e->n, emit_int(e, e->t_i32, 0xfffffff0u - e->nsplits++ % 0x1000000), "");
    LL(BuildCondBr)(e->b, never, e->exit, next);
    emit_at(e, next);
}

void emit_control(Emit *e, Inst *i);

void emit_block(Emit *e, Block *b) { emit_range(e, b->first, NULL); }

/* Varying values one after the other, with nothing between them that must wait for them. */
typedef struct Run {
    Inst *at[LONG_RUN];
    uint32_t n, most;
} Run;

static void end_run(Emit *e, Run *r) {
    if (r->n) emit_value_run(e, r->at, r->n);
    r->n = 0;
}

/* Does i wait for nothing but what is uniform? */
static bool passes_run(const Emit *e, const Inst *i) {
    if (ir_is_const(i) || i->op == OP_proj || i->op == OP_yield || i->op == OP_arg || i->op == OP_input) return true;
    return !emit_is_vector(e, i) && (!ir_ops[i->op].special || is_read(i));
}

static bool joins_run(const Emit *e, const Inst *i) {
    return !ir_ops[i->op].special && emit_is_vector(e, i) && (i->op != OP_band || i->args[1]->op != OP_both);
}

/* The run that begins here is one, however long, if anything in it is looked up. */
static uint32_t longest_run(Emit *e, Inst *from, const Inst *end) {
    Run run;
    run.n = 0;
    for (Inst *i = from; i != end; i = i->next) {
        if (joins_run(e, i)) {
            if (run.n == LONG_RUN) return RUN;
            if (!emit_slot(e, i)[0]) run.at[run.n++] = i;
        } else if (!passes_run(e, i)) {
            break;
        }
    }
    return emit_looks_up(e, run.at, run.n) ? LONG_RUN : RUN;
}

static void emit_special(Emit *e, Inst *i);

void emit_range(Emit *e, Inst *from, const Inst *end) {
    Run run;
    run.n = 0;
    e->runs.root = NULL; /* the code may be emitted twice */
    for (Inst *i = from; i != end && !e->error; i = i->next) {
        bool joins = joins_run(e, i);
        if (!joins && !passes_run(e, i)) end_run(e, &run);
        if (i->op == OP_if_ && i->args[0]->op == OP_live) {
            i = emit_chunks(e, i);
            continue;
        }
        if (ir_ops[i->op].special) {
            emit_special(e, i);
            continue;
        }
        if (emit_slot(e, i)[0]) continue;
        if (joins && !run.n) run.most = longest_run(e, i, end);
        if (joins) run.at[run.n++] = i;
        else if (i->op != OP_band || !emit_pairs_apart(e, i)) emit_value_op(e, i);
        e->since_split++;
        if (run.n && run.most == LONG_RUN && run.n < LONG_RUN) continue;
        if (run.n == RUN || is_long(e)) end_run(e, &run);
        split_long_block(e);
    }
    if (!e->error) end_run(e, &run);
}

static void emit_special(Emit *e, Inst *i) {
    switch (i->op) {
    case OP_constf:
    case OP_consti:
    case OP_constb:
    case OP_proj:
    case OP_arg:
    case OP_live:
    case OP_yield: break;
    case OP_input:
        if (!emit_slot(e, i)[0]) emit_input(e, i);
        break;
    case OP_detach:
    case OP_site:
    case OP_siten:
        if (emit_is_vector(e, i)) emit_parts(e, i->args[0], emit_slot(e, i));
        else emit_slot(e, i)[0] = emit_scalar(e, i->args[0]);
        break;
    case OP_if_: emit_control(e, i); break;
    case OP_loop:
        if (!emit_spread(e, i)) emit_control(e, i);
        break;
    case OP_revloop:
        if (!emit_spread_frames(e, i)) emit_revloop(e, i);
        break;
    case OP_rand:
    case OP_window:
    case OP_ghost:
    case OP_custom: emit_fail(e, "%s was not lowered", ir_ops[i->op].name); break;
    default:
        if (!emit_slot(e, i)[0]) emit_memory_op(e, i);
        e->since_split += 4;
        split_long_block(e);
    }
}

/* ---- the kernel */
static void init_types(Emit *e) {
    e->t_void = LL(VoidTypeInContext)(e->ctx);
    e->t_i1 = LL(Int1TypeInContext)(e->ctx);
    e->t_i8 = LL(Int8TypeInContext)(e->ctx);
    e->t_i16 = LL(Int16TypeInContext)(e->ctx);
    e->t_i32 = LL(Int32TypeInContext)(e->ctx);
    e->t_i64 = LL(Int64TypeInContext)(e->ctx);
    e->t_ptr = LL(PointerTypeInContext)(e->ctx, 0);
    e->t_f32 = LL(FloatTypeInContext)(e->ctx);
    e->t_f64 = LL(DoubleTypeInContext)(e->ctx);
    e->t_flt = e->fn->precision == PREC_F64 ? e->t_f64 : e->t_f32;
    e->md_invariant = LL(GetMDKindIDInContext)(e->ctx, "invariant.load", 14);
}

static void add_attribute(Emit *e, const char *key, const char *value) {
    LL(AddAttributeAtIndex)(
        e->func, (LLVMAttributeIndex)LLVMAttributeFunctionIndex,
        LL(CreateStringAttribute)(e->ctx, key, (unsigned)strlen(key), value, (unsigned)strlen(value)));
}

/* Registers that are spilled take vector_bytes each, and LLVM aligns the stack for them only if it is told so before it
 * knows that any will be: else they lie across two cache lines, every one or every other, as chance places the stack.
 */
enum { STACK_ALIGN = 16 /* of a caller */ };

static void declare_kernel(Emit *e, const char *name) {
    LLVMTypeRef params[2] = {e->t_ptr, e->t_i32};
    e->func = LL(AddFunction)(e->mod, name, LL(FunctionType)(e->t_void, params, 2, false));
    unsigned nounwind = LL(GetEnumAttributeKindForName)("nounwind", 8);
    LL(AddAttributeAtIndex)(e->func, (LLVMAttributeIndex)LLVMAttributeFunctionIndex,
                            LL(CreateEnumAttribute)(e->ctx, nounwind, 0));
    const Target *t = &e->opt->target;
    if (e->W > 1 && t->vector_bytes > STACK_ALIGN) {
        unsigned align = LL(GetEnumAttributeKindForName)("alignstack", 10);
        LL(AddAttributeAtIndex)(e->func, (LLVMAttributeIndex)LLVMAttributeFunctionIndex,
                                LL(CreateEnumAttribute)(e->ctx, align, t->vector_bytes));
    }
    char bits[16];
    snprintf(bits, sizeof bits, "%u", t->vector_bytes * 8);
    add_attribute(e, "target-cpu", t->cpu);
    if (t->features[0]) add_attribute(e, "target-features", t->features);
    add_attribute(e, "prefer-vector-width", bits);
    add_attribute(e, "min-legal-vector-width", bits);
    e->args = LL(GetParam)(e->func, 0);
    e->n = LL(GetParam)(e->func, 1);
}

const char *back_emit_kernel(const LlvmApi *ll, LLVMContextRef ctx, LLVMModuleRef mod, const KernelRequest *k,
                             const BackOptions *o, uint32_t width) {
    Emit *e = ARENA_NEW(&k->fn->session->scratch, Emit);
    *e = (Emit){.ll = ll,
                .ctx = ctx,
                .mod = mod,
                .opt = o,
                .fn = k->fn,
                .session = k->fn->session,
                .arena = &k->fn->session->scratch};
    e->plan = back_plan(k->fn, &o->target, width);
    e->W = e->plan.W;
    e->P = e->plan.P;
    e->L = e->plan.L;
    e->sse2_only = back_lacks_rounding(&o->target);
    init_types(e);
    uint32_t count = ir_number(k->fn);
    e->val = ARENA_ARRAY(e->arena, Part, (size_t)count * e->P + 1);
    emit_find_hidden(e);
    const Inst *yield = ir_yield_of(k->fn->body);
    if (yield->nargs > SLT_OUT_MAX)
        return arena_printf(e->arena, "kernel %s has %u outputs; the limit is %d", k->name, yield->nargs, SLT_OUT_MAX);

    declare_kernel(e, k->name);
    e->b = LL(CreateBuilderInContext)(ctx);
    e->entry = emit_new_block(e, "entry");
    LLVMBasicBlockRef setup = emit_new_block(e, "setup"), sample = emit_new_block(e, "sample");
    e->exit = emit_new_block(e, "exit");
    emit_at(e, setup);
    setup_block(e, k->fn->body);
    uint32_t nout = emit_packs_pixels(e, yield) ? 1 : yield->nargs;
    for (uint32_t j = 0; j < nout; j++) pointer_field(e, &e->out[j], offsetof(SltKernelArgs, out) + j * sizeof(void *));
    emit_chunks_setup(e);
    hoist_uniform(e);
    Part end = LL(BuildZExt)(e->b, e->n, e->t_i64, "end");
    LLVMBasicBlockRef from = emit_here(e);
    LL(BuildCondBr)(e->b, LL(BuildICmp)(e->b, LLVMIntEQ, e->n, emit_int(e, e->t_i32, 0), ""), e->exit, sample);

    emit_at(e, sample);
    e->i = emit_phi(e, e->t_i64, "i");
    emit_incoming(e, e->i, emit_int(e, e->t_i64, 0), from);
    if (e->tape_top) emit_store(e, emit_int(e, e->t_i64, 0), e->tape_top, 8);
    emit_block(e, k->fn->body);
    if (!e->error) emit_outputs(e, yield);
    Part next = LL(BuildAdd)(e->b, e->i, emit_int(e, e->t_i64, e->W), "");
    emit_incoming(e, e->i, next, emit_here(e));
    LL(BuildCondBr)(e->b, LL(BuildICmp)(e->b, LLVMIntULT, next, end, ""), sample, e->exit);
    emit_at(e, e->exit);
    LL(BuildRetVoid)(e->b);
    emit_at(e, e->entry);
    LL(BuildBr)(e->b, setup);
    LL(DisposeBuilder)(e->b);
    return e->error;
}
