/* Queries: rays to memory, a call through the geometry, witnesses back. */
#include "compiler/back/cpu/emit.h"

static Part active_bits(Emit *e) {
    if (!e->mask) return emit_i64(e, e->W == 64 ? UINT64_MAX : (1ull << e->W) - 1);
    Part bits = emit_i64(e, 0);
    for (uint32_t p = 0; p < e->P; p++) {
        Part m = LL(BuildZExt)(e->b, LL(BuildBitCast)(e->b, e->mask[p], LL(IntTypeInContext)(e->ctx, e->L), ""),
                               e->t_i64, "");
        bits = LL(BuildOr)(e->b, bits, LL(BuildShl)(e->b, m, emit_i64(e, (uint64_t)p * e->L), ""), "");
    }
    return bits;
}

static Part geometry_of(Emit *e, const Inst *i) {
    Part geometries = emit_load(e, e->t_ptr, emit_field_ptr(e, offsetof(SltKernelArgs, geometries)), 8, true);
    return emit_load(e, e->t_ptr, emit_at_byte(e, geometries, 8ull * i->imm.query.geometry), 8, true);
}

/* One vector of results in memory, as whole numbers where the instruction is one. */
static void take_told(Emit *e, Inst *i, Part told, unsigned align) {
    bool vector = emit_is_vector(e, i);
    uint32_t flt = e->plan.flt_bytes;
    LLVMTypeRef t = vector ? emit_vector_type(e, e->t_flt) : e->t_flt,
                whole = vector ? emit_vector_type(e, e->t_i32) : e->t_i32;
    Part *out = emit_slot(e, i);
    for (uint32_t p = 0; p < (vector ? e->P : 1); p++) {
        out[p] = emit_load(e, t, emit_at_byte(e, told, (uint64_t)flt * p * e->L), align, false);
        if (i->type == TY_INT) out[p] = LL(BuildFPToSI)(e->b, out[p], whole, "");
    }
}

void emit_told(Emit *e, Inst *i) {
    bool vector = emit_is_vector(e, i);
    uint32_t width = vector ? e->W : 1, flt = e->plan.flt_bytes;
    unsigned align = vector ? emit_part_align(e, flt) : flt, ialign = vector ? emit_part_align(e, 4) : 4;
    Part units = emit_alloca(e, e->t_i8, 4ull * width, 64), told = emit_alloca(e, e->t_i8, (uint64_t)flt * width, 64);
    Part v[BACK_MAX_PARTS];
    if (vector) emit_parts(e, i->args[0], v);
    else v[0] = emit_scalar(e, i->args[0]);
    for (uint32_t p = 0; p < (vector ? e->P : 1); p++)
        emit_store(e, v[p], emit_at_byte(e, units, 4ull * p * e->L), ialign);
    Part geometry = geometry_of(e, i),
         tell = emit_load(e, e->t_ptr, emit_at_byte(e, geometry, offsetof(SltGeometry, tell)), 8, true);
    LLVMTypeRef types[6] = {e->t_ptr, e->t_i32, e->t_ptr, e->t_i64, e->t_i32, e->t_ptr};
    Part args[6] = {geometry,
                    emit_int(e, e->t_i32, i->imm.query.what),
                    units,
                    vector ? active_bits(e) : emit_i64(e, 1),
                    emit_int(e, e->t_i32, width),
                    told};
    LL(BuildCall2)(e->b, LL(FunctionType)(e->t_void, types, 6, 0), tell, args, 6, "");
    take_told(e, i, told, align);
}

void emit_query(Emit *e, Inst *i) {
    bool vector = emit_is_vector(e, i);
    uint32_t width = vector ? e->W : 1, flt = e->plan.flt_bytes;
    unsigned align = vector ? emit_part_align(e, flt) : flt, ialign = vector ? emit_part_align(e, 4) : 4;
    Part rays = emit_alloca(e, e->t_i8, (uint64_t)i->nargs * width * flt, 64),
         witnesses = emit_alloca(e, e->t_i8, 4ull * width, 64);
    for (uint32_t a = 0; a < i->nargs; a++) {
        Part v[BACK_MAX_PARTS];
        if (vector) emit_parts(e, i->args[a], v);
        else v[0] = emit_scalar(e, i->args[a]);
        for (uint32_t p = 0; p < (vector ? e->P : 1); p++)
            emit_store(e, v[p], emit_at_byte(e, rays, ((uint64_t)a * width + (uint64_t)p * e->L) * flt), align);
    }
    Part geometry = geometry_of(e, i);
    Part query = emit_load(e, e->t_ptr,
                           emit_at_byte(e, geometry, offsetof(SltGeometry, query) + 8ull * i->imm.query.what), 8, true);
    Part values = emit_at_byte(e, e->params, (uint64_t)i->imm.query.base * flt);
    LLVMTypeRef types[6] = {e->t_ptr, e->t_ptr, e->t_ptr, e->t_i64, e->t_i32, e->t_ptr};
    Part args[6] = {geometry, values, rays, vector ? active_bits(e) : emit_i64(e, 1), emit_int(e, e->t_i32, width),
                    witnesses};
    LL(BuildCall2)(e->b, LL(FunctionType)(e->t_void, types, 6, 0), query, args, 6, "");
    Part *out = emit_slot(e, i);
    LLVMTypeRef t = vector ? emit_vector_type(e, e->t_i32) : e->t_i32;
    for (uint32_t p = 0; p < (vector ? e->P : 1); p++)
        out[p] = emit_load(e, t, emit_at_byte(e, witnesses, 4ull * p * e->L), ialign, false);
}
