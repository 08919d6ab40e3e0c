/* Facts of ops.def as a table, and the two hashes that exist both in C and as IR. */
#include <stddef.h>

#include "compiler/ir/ir.h"
#include "saltus/kernel.h"

_Static_assert(OP_COUNT < IR_MANY, "Inst.op is a byte");

#define TYPE_F TY_FLT
#define TYPE_I TY_INT
#define TYPE_B TY_BOOL
#define TYPE_fsel TY_FLT
#define TYPE_isel TY_INT
#define TYPE_bsel TY_BOOL

/* MATH in the lowering column becomes true, everything else false. */
#define IS_MATH true
#define IS_BIN(x) false
#define IS_INTRIN(x) false
#define IS_EMIT false

/* A signature is "result:arguments". Its first letter is the result; '?' and '.' are TY_VOID here. */
#define SIGNATURE_TYPE(s)                                                                                              \
    ((s)[0] == 'f' ? TY_FLT : (s)[0] == 'i' ? TY_INT : (s)[0] == 'b' ? TY_BOOL : (s)[0] == 't' ? TY_TAPE : TY_VOID)
#define SIGNATURE_ARGS(s) ((s)[sizeof(s) - 2] == '*' ? IR_MANY : sizeof(s) - sizeof "r:")

#define FLOAT(n) .nargs = (n), .result = TY_FLT, .arg = TY_FLT
#define INT(n) .nargs = (n), .result = TY_INT, .arg = TY_INT
#define BOOL(n) .nargs = (n), .result = TY_BOOL, .arg = TY_BOOL, .cost = 1
#define COMPARE(t) .nargs = 2, .result = TY_BOOL, .arg = (t), .compares = true, .cost = 1
#define FOP(name_, n, cost_, lowering) {.name = #name_, FLOAT(n), .math = IS_##lowering, .cost = (cost_)},

const OpInfo ir_ops[OP_COUNT] = {
#define FOP1(name, value, partials, bounds, events, range, cost, domain, lowering, ...) FOP(name, 1, cost, lowering)
#define FOP2(name, value, partials, bounds, events, range, cost, domain, lowering, ...) FOP(name, 2, cost, lowering)
#define FOP3(name, value, partials, bounds, events, range, cost, domain, lowering, ...) FOP(name, 3, cost, lowering)
#define FCMP2(name_, ...) {.name = #name_, COMPARE(TY_FLT)},
#define FSEL(name_, value, bounds, range, cost_)                                                                               \
    {.name = #name_, .nargs = 3, .result = TYPE_##name_, .arg = TYPE_##name_, .selects = true, .cost = (cost_)},
#define IOP1(name_, value, bounds, range, cost_, ...) {.name = #name_, INT(1), .cost = (cost_)},
#define IOP2(name_, value, bounds, range, cost_, ...) {.name = #name_, INT(2), .cost = (cost_)},
#define ICMP2(name_, ...) {.name = #name_, COMPARE(TY_INT)},
#define BOP1(name_, ...) {.name = #name_, BOOL(1)},
#define BOP2(name_, ...) {.name = #name_, BOOL(2)},
#define CONV(name_, result_, argument, value, bounds, events, range, cost_, ...)                                                       \
    {.name = #name_, .nargs = 1, .result = TYPE_##result_, .arg = TYPE_##argument, .cost = (cost_)},
#define SPECIAL(name_, signature, kind_, range, cost_, ...)                                                            \
    {.name = #name_,                                                                                                   \
     .nargs = SIGNATURE_ARGS(signature),                                                                               \
     .result = SIGNATURE_TYPE(signature),                                                                              \
     .special = true,                                                                                                  \
     .kind = KIND_##kind_,                                                                                             \
     .cost = (cost_)},
#include "compiler/ir/ops.def"
#include "compiler/ir/ops_undef.h"
};

uint32_t ir_mix(uint32_t h, uint32_t v) {
    /* h is scaled first so that mix(a, b) and mix(b, a) differ; then two rounds of multiply and shift. */
    uint32_t x = h * 0x9e3779b1u + v;
    x ^= x >> 16;
    x *= 0x7feb352du;
    x ^= x >> 15;
    x *= 0x846ca68bu;
    return x ^ (x >> 16);
}

Inst *ir_mix_inst(Builder *b, Inst *h, Inst *v) {
    Inst *x = ir_emit2(b, OP_iadd, ir_emit2(b, OP_imul, h, ir_consti(b, (int32_t)0x9e3779b1u)), v);
    x = ir_emit2(b, OP_ixor, x, ir_emit2(b, OP_ushr, x, ir_consti(b, 16)));
    x = ir_emit2(b, OP_imul, x, ir_consti(b, 0x7feb352d));
    x = ir_emit2(b, OP_ixor, x, ir_emit2(b, OP_ushr, x, ir_consti(b, 15)));
    x = ir_emit2(b, OP_imul, x, ir_consti(b, (int32_t)0x846ca68bu));
    return ir_emit2(b, OP_ixor, x, ir_emit2(b, OP_ushr, x, ir_consti(b, 16)));
}

/* Philox2x32 with 7 rounds (Salmon et al. 2011, "Parallel random numbers: as easy as 1, 2, 3"): key = stream,
 * counter = (n, 0). The second word of the block is not used. */
uint32_t ir_rand_u32(uint32_t stream, uint32_t n) {
    uint32_t x = n, y = 0, key = stream;
    for (int round = 0; round < IR_RAND_ROUNDS; round++, key += IR_RAND_WEYL) {
        uint64_t p = (uint64_t)IR_RAND_MUL * x;
        x = (uint32_t)(p >> 32) ^ key ^ y;
        y = (uint32_t)p;
    }
    return x;
}

IrType ir_input_type(InputSlot slot) {
    static const uint8_t type[SLT_INPUTS] = {
#define SLT_INPUT(id, text, type, ...) [IN_##id] = TY_##type,
#define SLT_UNIFORM(id, ...) [IN_##id] = TY_INT,
#include "saltus/kernel.def"
    };
    return (IrType)type[slot];
}

size_t ir_uniform_offset(InputSlot slot) {
    static const uint16_t offset[SLT_INPUTS] = {
#define SLT_UNIFORM(id, text, field, ...) [IN_##id] = offsetof(SltKernelArgs, field),
#include "saltus/kernel.def"
    };
    return offset[slot];
}
