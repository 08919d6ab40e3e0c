/* 8-bit pixels packed by the kernel itself: R in the lowest byte, then G, B and 255. */
#include "compiler/back/cpu/emit.h"
#include "compiler/ir/range.h"

const double BACK_SRGB[BACK_SRGB_TERMS] = {-0.04086402, 1.54233637, -1.64561153, 3.03261645,
                                           -3.55274765, 2.24849906, -0.58427069};

/* The curve of sRGB on [0, 1], within .09 of 1 / 255 of it: above the straight piece a polynomial in the square root of
 * v, with which v^(1 / 2.4) is nearly straight, through the Chebyshev nodes. Nothing is contracted: the same bits at
 * every width. */
static Part curve(Emit *e, Part v) {
    LLVMTypeRef shape = LL(TypeOf)(v);
    Part root = emit_intrinsic(e, "llvm.sqrt", shape, &v, 1), r = NULL;
    for (int k = BACK_SRGB_TERMS - 1; k >= 0; k--) {
        Part ck = emit_const_like(e, shape, e->t_flt, BACK_SRGB[k], 0, true);
        r = r ? LL(BuildFAdd)(e->b, LL(BuildFMul)(e->b, r, root, ""), ck, "") : ck;
    }
    Part low = LL(BuildFMul)(e->b, v, emit_const_like(e, shape, e->t_flt, 12.92, 0, true), "");
    Part small = LL(BuildFCmp)(e->b, LLVMRealOLT, v, emit_const_like(e, shape, e->t_flt, 0.0031308, 0, true), "");
    return LL(BuildSelect)(e->b, small, low, r, "");
}

static Part at_most(Emit *e, Part x, double limit) {
    Part most = emit_const_like(e, LL(TypeOf)(x), e->t_flt, limit, 0, true);
    return LL(BuildSelect)(e->b, LL(BuildFCmp)(e->b, LLVMRealOLT, x, most, ""), x, most, "");
}

/* Is v between what rounds to 0 and what rounds to 255, if it is no NaN? */
static bool gives_byte(const Emit *e, const Inst *v) {
    if (e->opt->pixels == BACK_PIXELS_SRGB || !emit_converts(e)) return false;
    const IrRange r = ir_range_rounded(v);
    return r.lo > -0.49 / 255 && r.hi < 1 + 0.49 / 255;
}

/* One 8-bit channel of every lane of a part: clamp to 0..1 (NaN gives 0), curve, scale, round half up. Without a curve
 * the upper limit comes last, which changes no byte: LLVM would draw a product into the choice, and blend under a mask
 * what is one minimum. What is known to give a byte needs no limits: INT_MIN, as of a NaN, leaves nothing in the byte
 * either, and only the bit of alpha that is 1 above it. */
static Part channel8(Emit *e, Part x, bool is_byte) {
    LLVMTypeRef shape = LL(TypeOf)(x), ints = emit_vector_type(e, e->t_i32);
    const bool curved = e->opt->pixels == BACK_PIXELS_SRGB;
    Part zero = emit_const_like(e, shape, e->t_flt, 0, 0, true);
    if (!is_byte) x = LL(BuildSelect)(e->b, LL(BuildFCmp)(e->b, LLVMRealOGT, x, zero, ""), x, zero, "");
    if (curved) x = curve(e, at_most(e, x, 1));
    x = LL(BuildFMul)(e->b, x, emit_const_like(e, shape, e->t_flt, 255, 0, true), "");
    x = LL(BuildFAdd)(e->b, x, emit_const_like(e, shape, e->t_flt, 0.5, 0, true), "");
    if (is_byte) return emit_converted(e, x, NULL, true);
    if (!curved) x = at_most(e, x, 255.5);
    return LL(BuildFPToSI)(e->b, x, ints, "");
}

void emit_pixels(Emit *e, const Inst *yield) {
    Part rgb[3][BACK_MAX_PARTS];
    for (uint32_t c = 0; c < 3; c++) emit_parts(e, yield->args[yield->nargs >= 3 ? c : 0], rgb[c]);
    LLVMTypeRef ints = emit_vector_type(e, e->t_i32);
    bool is_byte[3];
    for (uint32_t c = 0; c < 3; c++) is_byte[c] = gives_byte(e, yield->args[yield->nargs >= 3 ? c : 0]);
    Part first = emit_gep(e, e->t_i32, e->out[0], e->i);
    for (uint32_t p = 0; p < e->P; p++) {
        Part word = emit_const_like(e, ints, e->t_i32, 0, 0xff000000u, false);
        for (uint32_t c = 0; c < 3; c++) {
            Part byte = channel8(e, rgb[c][p], is_byte[c]);
            Part shifted = LL(BuildShl)(e->b, byte, emit_const_like(e, ints, e->t_i32, 0, 8 * c, false), "");
            word = LL(BuildOr)(e->b, word, shifted, "");
        }
        emit_store(e, word, emit_gep(e, e->t_i32, first, emit_int(e, e->t_i64, (uint64_t)p * e->L)),
                   4 /* they go to the caller's image as well, which may lie anywhere */);
    }
}

bool emit_packs_pixels(const Emit *e, const Inst *yield) {
    if (!e->opt->pixels || !yield->nargs) return false;
    const Output *is = e->fn->outputs;
    for (uint32_t j = 0; j < yield->nargs; j++)
        if (yield->args[j]->type != TY_FLT || (is && is[j].role != SLT_OUT_F)) return false;
    return true;
}
