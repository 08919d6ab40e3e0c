/* Truth values by vectors, on processors whose masks are vectors (before AVX-512).
 *
 * There the code generator keeps a vector of i1 that leaves its block as narrow integers: a pack and an unpack of every
 * mask of a loop, in each iteration, on the way from one iteration to the next. So what combines masks, and what takes
 * them from block to block, is rewritten in integers as wide as a register holds for so many lanes, all ones or all
 * zeros: what comparisons give, and what blends take by its sign. This is the last that is done to the IR, since its
 * simplification would undo it. */
#include <stdlib.h>

#include "compiler/back/cpu/emit.h"

/* A mask, and what stands for it. */
typedef struct Twin {
    LLVMValueRef mask, wide;
    bool combined;        /* made of other twins: the mask goes */
    LLVMBasicBlockRef at; /* the last block that wanted it as i1 again, and that there */
    LLVMValueRef narrow;
} Twin;

typedef struct Masks {
    const LlvmApi *ll;
    LLVMContextRef ctx;
    LLVMBuilderRef b;
    LLVMTypeRef i1;
    uint32_t vector_bits;
    bool blends; /* the processor can, by signs */
    Twin *twin;  /* [n], as they came up, with room for all masks */
    uint32_t n;
    uint32_t *slot; /* hashed by mask: 1 + number of its twin, 0: free; [size], a power of two, at most half full */
    size_t size;
} Masks;

#undef LL
#define LL(name) (m->ll->name)

static uint32_t *slot_of(Masks *m, LLVMValueRef mask) {
    size_t k = ((uintptr_t)mask >> 4) * 0x9E3779B97F4A7C15u & (m->size - 1);
    while (m->slot[k] && m->twin[m->slot[k] - 1].mask != mask) k = (k + 1) & (m->size - 1);
    return &m->slot[k];
}

/* The type of what stands for a mask; NULL: v is none. */
static LLVMTypeRef wide_type(Masks *m, LLVMValueRef v) {
    LLVMTypeRef t = LL(TypeOf)(v);
    if (LL(GetTypeKind)(t) != LLVMVectorTypeKind || LL(GetElementType)(t) != m->i1) return NULL;
    const uint32_t lanes = LL(GetVectorSize)(t), bits = m->vector_bits / lanes;
    return bits == 32 || bits == 64 ? LL(VectorType)(LL(IntTypeInContext)(m->ctx, bits), lanes) : NULL;
}

static bool is_comparison(Masks *m, LLVMValueRef v) {
    if (!LL(IsAInstruction)(v)) return false;
    const LLVMOpcode op = LL(GetInstructionOpcode)(v);
    return op == LLVMFCmp || op == LLVMICmp;
}

/* Is this made of masks lane by lane, and so its twin of theirs? Else the twin is made from it, as that of a comparison
 * is, and of one turned round, which is another comparison. */
static bool combines(Masks *m, LLVMValueRef i) {
    if (!wide_type(m, i)) return false;
    switch (LL(GetInstructionOpcode)(i)) {
    case LLVMAnd:
    case LLVMOr:
    case LLVMPHI:
    case LLVMSelect: return true;
    case LLVMXor: return !LL(IsAConstant)(LL(GetOperand)(i, 1)) || !is_comparison(m, LL(GetOperand)(i, 0));
    default: return false;
    }
}

static void before(Masks *m, LLVMValueRef i) { LL(PositionBuilderBefore)(m->b, i); }
static LLVMValueRef past_phis(Masks *m, LLVMValueRef i) {
    while (LL(GetInstructionOpcode)(i) == LLVMPHI) i = LL(GetNextInstruction)(i);
    return i;
}

static LLVMValueRef wide(Masks *m, LLVMValueRef v);

/* by ? x : y before i, of integers */
static LLVMValueRef choose(Masks *m, LLVMValueRef by, LLVMValueRef x, LLVMValueRef y, LLVMValueRef i) {
    if (!wide_type(m, by)) return LL(BuildSelect)(m->b, by, x, y, "");
    by = wide(m, by);
    before(m, i);
    y = LL(BuildAnd)(m->b, y, LL(BuildNot)(m->b, by, ""), "");
    return LL(BuildOr)(m->b, LL(BuildAnd)(m->b, x, by, ""), y, "");
}

static LLVMValueRef wide(Masks *m, LLVMValueRef v) {
    LLVMTypeRef t = wide_type(m, v);
    if (LL(IsAConstant)(v)) return LL(BuildSExt)(m->b, v, t, "");
    uint32_t *known = slot_of(m, v);
    if (*known) return m->twin[*known - 1].wide;
    LLVMValueRef made;
    if (!combines(m, v)) {
        before(m, past_phis(m, LL(GetNextInstruction)(v)));
        made = LL(BuildSExt)(m->b, v, t, "");
    } else if (LL(GetInstructionOpcode)(v) == LLVMPHI) { /* takes its values when all masks have twins */
        before(m, v);
        made = LL(BuildPhi)(m->b, t, "");
    } else {
        const bool choice = LL(GetInstructionOpcode)(v) == LLVMSelect;
        LLVMValueRef x = wide(m, LL(GetOperand)(v, choice)), y = wide(m, LL(GetOperand)(v, choice + 1u));
        before(m, v);
        switch (LL(GetInstructionOpcode)(v)) {
        case LLVMAnd: made = LL(BuildAnd)(m->b, x, y, ""); break;
        case LLVMOr: made = LL(BuildOr)(m->b, x, y, ""); break;
        case LLVMXor: made = LL(BuildXor)(m->b, x, y, ""); break;
        default: made = choose(m, LL(GetOperand)(v, 0), x, y, v);
        }
    }
    m->twin[m->n] = (Twin){.mask = v, .wide = made, .combined = combines(m, v)};
    *slot_of(m, v) = ++m->n;
    return made;
}

/* The mask as i1 again, in a block that looks at it: the sign of each lane. */
static LLVMValueRef narrow(Masks *m, Twin *of, LLVMBasicBlockRef at) {
    if (of->at == at) return of->narrow;
    const bool home = LL(GetInstructionParent)(of->mask) == at;
    before(m, past_phis(m, home ? LL(GetNextInstruction)(of->wide) : LL(GetFirstInstruction)(at)));
    of->at = at;
    return of->narrow = LL(BuildICmp)(m->b, LLVMIntSLT, of->wide, LL(ConstNull)(LL(TypeOf)(of->wide)), "");
}

/* Does anything combine v, or look at it in another block? */
static bool travels(Masks *m, LLVMValueRef v) {
    LLVMBasicBlockRef home = LL(GetInstructionParent)(v);
    for (LLVMUseRef u = LL(GetFirstUse)(v); u; u = LL(GetNextUse)(u)) {
        LLVMValueRef user = LL(GetUser)(u);
        if (LL(GetInstructionParent)(user) != home || combines(m, user)) return true;
    }
    return false;
}

/* A choice by lanes, where no instruction makes one by signs; NULL: of other numbers than masks are as wide as. */
static LLVMValueRef spelled(Masks *m, LLVMValueRef choice, LLVMValueRef by) {
    LLVMTypeRef t = LL(TypeOf)(choice), bits = LL(TypeOf)(by), number = LL(GetElementType)(t);
    const bool single = LL(GetElementType)(bits) == LL(IntTypeInContext)(m->ctx, 32);
    if (t != bits && number != (single ? LL(FloatTypeInContext) : LL(DoubleTypeInContext))(m->ctx)) return NULL;
    before(m, choice);
    LLVMValueRef x = LL(BuildBitCast)(m->b, LL(GetOperand)(choice, 1), bits, ""),
                 y = LL(BuildBitCast)(m->b, LL(GetOperand)(choice, 2), bits, "");
    x = LL(BuildAnd)(m->b, x, by, ""), y = LL(BuildAnd)(m->b, y, LL(BuildNot)(m->b, by, ""), "");
    return LL(BuildBitCast)(m->b, LL(BuildOr)(m->b, x, y, ""), t, "");
}

/* Whoever looks at a mask and does not combine it looks at the signs. */
static void replace_uses(Masks *m, Twin *of) {
    const bool stays = !of->combined; /* in its block it is there as i1 */
    LLVMBasicBlockRef home = LL(GetInstructionParent)(of->mask);
    for (LLVMUseRef u = LL(GetFirstUse)(of->mask), next; u; u = next) {
        next = LL(GetNextUse)(u);
        LLVMValueRef user = LL(GetUser)(u);
        LLVMBasicBlockRef at = LL(GetInstructionParent)(user);
        if (user == of->wide || (stays && at == home) || combines(m, user)) continue;
        LLVMValueRef other =
            m->blends || LL(GetInstructionOpcode)(user) != LLVMSelect ? NULL : spelled(m, user, of->wide);
        if (other) {
            LL(ReplaceAllUsesWith)(user, other);
            LL(InstructionEraseFromParent)(user);
            continue;
        }
        unsigned k = 0;
        while (LL(GetOperandUse)(user, k) != u) k++;
        LL(SetOperand)(user, k, narrow(m, of, at));
    }
}

static void rewrite(Masks *m, LLVMValueRef f) {
    for (LLVMBasicBlockRef b = LL(GetFirstBasicBlock)(f); b; b = LL(GetNextBasicBlock)(b))
        for (LLVMValueRef i = LL(GetFirstInstruction)(b); i; i = LL(GetNextInstruction)(i))
            if (wide_type(m, i) && (combines(m, i) || travels(m, i))) wide(m, i);
    const uint32_t n = m->n;
    for (uint32_t k = 0; k < n; k++) {
        LLVMValueRef phi = m->twin[k].mask;
        if (LL(GetInstructionOpcode)(phi) != LLVMPHI) continue;
        for (unsigned e = 0; e < LL(CountIncoming)(phi); e++) {
            LLVMValueRef v = wide(m, LL(GetIncomingValue)(phi, e));
            LLVMBasicBlockRef from = LL(GetIncomingBlock)(phi, e);
            LL(AddIncoming)(m->twin[k].wide, &v, &from, 1);
        }
    }
    for (uint32_t k = 0; k < m->n; k++) replace_uses(m, &m->twin[k]);
    for (uint32_t k = 0; k < m->n; k++)
        if (m->twin[k].combined) LL(ReplaceAllUsesWith)(m->twin[k].mask, LL(GetPoison)(LL(TypeOf)(m->twin[k].mask)));
    for (uint32_t k = 0; k < m->n; k++)
        if (m->twin[k].combined) LL(InstructionEraseFromParent)(m->twin[k].mask);
}

bool masks_widen(const LlvmApi *ll, LLVMContextRef ctx, LLVMValueRef f, uint32_t vector_bytes) {
    Masks made = {.ll = ll,
                  .ctx = ctx,
                  .i1 = ll->Int1TypeInContext(ctx),
                  .vector_bits = 8 * vector_bytes,
                  .blends = vector_bytes > 16},
          *m = &made;
    size_t n = 0;
    for (LLVMBasicBlockRef b = LL(GetFirstBasicBlock)(f); b; b = LL(GetNextBasicBlock)(b))
        for (LLVMValueRef i = LL(GetFirstInstruction)(b); i; i = LL(GetNextInstruction)(i))
            n += wide_type(m, i) != NULL;
    if (!n) return true;
    for (m->size = 16; m->size < 2 * n; m->size *= 2) {
    }
    m->twin = calloc(n, sizeof *m->twin);
    m->slot = calloc(m->size, sizeof *m->slot);
    if (m->twin && m->slot) {
        m->b = LL(CreateBuilderInContext)(ctx);
        rewrite(m, f);
        LL(DisposeBuilder)(m->b);
    }
    const bool done = m->twin && m->slot;
    free(m->twin);
    free(m->slot);
    return done;
}
