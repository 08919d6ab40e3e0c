/* Queries: rays to memory, a call through the geometry, witnesses back. */
#include "compiler/back/cpu/emit.h"

#include "saltus/mesh.h"

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

/* Where what is told lies may change with every query that finds units. */
static void find_told(Emit *e, Part geometry) {
    LLVMTypeRef type = LL(FunctionType)(e->t_ptr, NULL, 0, 0);
    Part told = emit_load(e, e->t_ptr, emit_at_byte(e, geometry, offsetof(SltGeometry, told)), 8, true);
    emit_store(e, LL(BuildCall2)(e->b, type, told, NULL, 0, ""), e->told, 8);
}

void emit_setup_told(Emit *e, const Inst *i) {
    e->told = emit_alloca(e, e->t_ptr, 1, 8);
    find_told(e, geometry_of(e, i));
}

/* A number of a unit in each lane. Where it does not count, the unit may be any number, and unit 0 is read, of which
 * all is 0: others have integers where sides have floats, and these are denormal, which costs some processors more than
 * all that is computed of them. */
void emit_told(Emit *e, Inst *i) {
    const bool whole = i->type == TY_INT, vector = emit_is_vector(e, i);
    const uint32_t stride = e->plan.flt_bytes / (whole ? 4 : e->plan.flt_bytes); /* integers lie where numbers do */
    const unsigned size = whole ? 4 : e->plan.flt_bytes;
    LLVMTypeRef t = whole ? e->t_i32 : e->t_flt;
    Part row = emit_load(e, e->t_ptr, e->told, 8, false),
         last = emit_load(e, e->t_i32, emit_at_byte(e, row, (uint64_t)-SLT_TOLD_LAST), 4, false),
         number = emit_at_byte(e, row, (uint64_t)i->imm.query.what * e->plan.flt_bytes), unit[BACK_MAX_PARTS],
         *out = emit_slot(e, i);
    if (vector) emit_parts(e, i->args[0], unit), last = emit_splat(e, last);
    else unit[0] = emit_scalar(e, i->args[0]);
    for (uint32_t p = 0; p < (vector ? e->P : 1); p++) {
        Part both[2] = {unit[p], last}, none = LL(ConstNull)(LL(TypeOf)(last));
        if (vector && e->mask) both[0] = LL(BuildSelect)(e->b, e->mask[p], unit[p], none, "");
        unit[p] = emit_intrinsic(e, "llvm.umin", LL(TypeOf)(last), both, 2);
        unit[p] = LL(BuildMul)(e->b, unit[p], emit_const_like(e, LL(TypeOf)(last), e->t_i32, 0, SLT_TOLD, false), "");
    }
    if (vector && emit_beside(e, i, row, unit, SLT_TOLD)) return;
    for (uint32_t p = 0; p < (vector ? e->P : 1); p++) {
        Part by = emit_const_like(e, LL(TypeOf)(last), e->t_i32, 0, stride, false),
             pointer = emit_gep(e, t, number, LL(BuildMul)(e->b, unit[p], by, ""));
        out[p] = vector ? emit_gather(e, t, pointer, size) : emit_load(e, t, pointer, size, false);
    }
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
    if (e->told && (query_rows[i->imm.query.what].witness == WITNESS_UNIT || i->imm.query.what == SLT_QUERY_BEGIN))
        find_told(e, geometry);
    Part *out = emit_slot(e, i);
    LLVMTypeRef t = vector ? emit_vector_type(e, e->t_i32) : e->t_i32;
    for (uint32_t p = 0; p < (vector ? e->P : 1); p++)
        out[p] = emit_load(e, t, emit_at_byte(e, witnesses, 4ull * p * e->L), ialign, false);
}
