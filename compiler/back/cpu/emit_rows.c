/* Reads that lie side by side: the coordinates of a vertex, what is told of a unit, the corners of a face, the channels
 * of a texel. A gather takes one number of every lane from memory, and as long for it as for the line that it lies in.
 * So a row of numbers is read at once for each lane, as one vector of 16 bytes, and the vectors are transposed. */
#include "compiler/back/cpu/emit.h"

#include "saltus/mesh.h"

enum { ROW_BYTES = 16, ROW_MAX = 4 /* numbers of a row, at most */, AHEAD = 64 /* instructions that are looked at */ };

typedef struct Row {
    Inst *of[ROW_MAX]; /* who reads number k of it; NULL: nobody */
    uint32_t first, n; /* place of its first number; how many are read: those behind may not be there */
    uint32_t length;   /* numbers of ROW_BYTES */
    LLVMTypeRef t;     /* of a number */
    unsigned bytes;
} Row;

static uint32_t place_of(const Inst *i) { return i->op == OP_told ? i->imm.query.what : i->imm.slot.base; }

/* Are both of the same row, if their places are near enough? */
static bool beside(const Inst *i, const Inst *other) {
    if (other->op != i->op || other->args[0] != i->args[0]) return false;
    return i->op == OP_told ? other->imm.query.geometry == i->imm.query.geometry
                            : other->imm.slot.count == i->imm.slot.count;
}

/* The end of what is looked through for others of i's row: what is told may be elsewhere behind a query, and numbers
 * that are read before a branch have to be kept over it. */
static const Inst *end_of(const Inst *i) {
    for (uint32_t k = 0; k < AHEAD && i && !i->nregions && i->op != OP_query; k++) i = i->next;
    return i;
}

/* i's row, of those behind it that have not been read. */
static Row row_of(Emit *e, Inst *i) {
    Row r = {.t = i->op == OP_iparam ? e->t_i32 : e->t_flt, .bytes = i->op == OP_iparam ? 4 : e->plan.flt_bytes};
    const Inst *end = end_of(i);
    r.length = ROW_BYTES / r.bytes;
    r.first = place_of(i);
    if (i->op == OP_told) r.first -= r.first % r.length;
    else
        for (const Inst *j = i; j != end; j = j->next)
            if (beside(i, j) && place_of(j) < r.first && place_of(j) + r.length > place_of(i)) r.first = place_of(j);
    for (Inst *j = i; j != end; j = j->next) {
        if (!beside(i, j) || place_of(j) < r.first || place_of(j) >= r.first + r.length || emit_slot(e, j)[0]) continue;
        const uint32_t k = place_of(j) - r.first;
        if (!r.of[k]) r.of[k] = j;
        if (r.n <= k) r.n = k + 1;
    }
    return r;
}

/* The numbers of one lane, as a vector. */
static Part row_at(Emit *e, const Row *r, bool whole, Part at) {
    LLVMTypeRef v = LL(VectorType)(r->t, r->length);
    if (whole) return emit_load(e, v, at, r->bytes, false);
    LLVMTypeRef types[2] = {v, e->t_ptr};
    unsigned id = LL(LookupIntrinsicID)("llvm.masked.load", 16);
    Part there[ROW_MAX], f = LL(GetIntrinsicDeclaration)(e->mod, id, types, 2);
    for (uint32_t k = 0; k < r->length; k++) there[k] = emit_int(e, e->t_i1, k < r->n);
    Part args[4] = {at, emit_int(e, e->t_i32, r->bytes), LL(ConstVector)(there, r->length), LL(ConstNull)(v)};
    return LL(BuildCall2)(e->b, LL(IntrinsicGetType)(e->ctx, id, types, 2), f, args, 4, "");
}

/* Vectors of n numbers behind one another, `count` of them, a power of two. */
static Part joined(Emit *e, Part *v, uint32_t count, uint32_t n) {
    Part pick[BACK_MAX_WIDTH];
    for (; count > 1; count /= 2, n *= 2) {
        for (uint32_t k = 0; k < 2 * n; k++) pick[k] = emit_int(e, e->t_i32, k);
        for (uint32_t k = 0; k < count / 2; k++)
            v[k] = LL(BuildShuffleVector)(e->b, v[2 * k], v[2 * k + 1], LL(ConstVector)(pick, 2 * n), "");
    }
    return v[0];
}

/* In every 16 bytes: `step` numbers of a and as many of b, alternately, from number `from` of each on. */
static Part mixed(Emit *e, Part a, Part b, uint32_t length, uint32_t step, uint32_t from) {
    Part pick[BACK_MAX_WIDTH];
    for (uint32_t l = 0; l < e->L; l++) {
        const uint32_t base = l / length * length, k = l % length, own = from + k / (2 * step) * step + k % step;
        pick[l] = emit_int(e, e->t_i32, base + own + (k / step % 2 ? e->L : 0));
    }
    return LL(BuildShuffleVector)(e->b, a, b, LL(ConstVector)(pick, e->L), "");
}

/* Number k of the row in all lanes of a part. lane: the vectors of the lanes. */
static void transpose(Emit *e, const Row *r, const Part *lane, Part out[ROW_MAX]) {
    Part some[BACK_MAX_WIDTH], v[ROW_MAX]; /* v[j]: of lanes j, j + length, ... */
    for (uint32_t j = 0; j < r->length; j++) {
        for (uint32_t k = 0; k < e->L / r->length; k++) some[k] = lane[k * r->length + j];
        v[j] = joined(e, some, e->L / r->length, r->length);
    }
    if (r->length == 2) {
        for (uint32_t k = 0; k < 2; k++) out[k] = mixed(e, v[0], v[1], 2, 1, k);
        return;
    }
    for (uint32_t half = 0; half < 2; half++) {
        Part low = mixed(e, v[0], v[1], 4, 1, 2 * half), high = mixed(e, v[2], v[3], 4, 1, 2 * half);
        for (uint32_t k = 0; k < 2; k++) out[2 * half + k] = mixed(e, low, high, 4, 2, 2 * k);
    }
}

static Part as_type(Emit *e, const Row *r, const Inst *i, Part v) {
    if (i->type != TY_INT || r->t == e->t_i32) return v;
    LLVMTypeRef bits = r->bytes == 8 ? e->t_i64 : e->t_i32;
    v = LL(BuildBitCast)(e->b, v, emit_vector_type(e, bits), "");
    return r->bytes == 8 ? LL(BuildTrunc)(e->b, v, emit_vector_type(e, e->t_i32), "") : v;
}

bool emit_beside(Emit *e, Inst *i, Part base, const Part *index, uint64_t readable) {
    const Row r = row_of(e, i);
    uint32_t readers = 0;
    for (uint32_t k = 0; k < r.length; k++) readers += r.of[k] != NULL;
    if (readers < 2 || e->L < r.length) return false;
    const bool whole = r.first + r.length <= readable;
    if (!e->lanes) e->lanes = emit_alloca(e, emit_vector_type(e, e->t_i32), 1, 64);
    base = emit_gep(e, r.t, base, emit_i64(e, r.first));
    for (uint32_t p = 0; p < e->P; p++) {
        Part lane[BACK_MAX_WIDTH], out[ROW_MAX];
        emit_store(e, index[p], e->lanes, emit_part_align(e, 4));
        for (uint32_t l = 0; l < e->L; l++) {
            Part at = emit_load(e, e->t_i32, emit_at_byte(e, e->lanes, 4ull * l), 4, false);
            lane[l] = row_at(e, &r, whole, emit_gep(e, r.t, base, LL(BuildZExt)(e->b, at, e->t_i64, "")));
        }
        transpose(e, &r, lane, out);
        for (uint32_t k = 0; k < r.length; k++)
            if (r.of[k]) emit_slot(e, r.of[k])[p] = as_type(e, &r, r.of[k], out[k]);
    }
    e->since_split += 4 * e->L;
    return true;
}
