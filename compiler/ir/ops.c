/* Facts of ops.def as a table, and the two hashes that exist both in C and as IR. */
#include <stddef.h>

#include "compiler/ir/ir.h"
#include "saltus/kernel.h"

/* Argument counts and result types of the special rows are spelled in their signature "result:arguments". */
#define MANY 255
_Static_assert(OP_COUNT < 255, "Inst.op is a byte");

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

#define SPECIAL_ARGS_constf 0
#define SPECIAL_ARGS_consti 0
#define SPECIAL_ARGS_constb 0
#define SPECIAL_ARGS_input 0
#define SPECIAL_ARGS_param 1
#define SPECIAL_ARGS_iparam 1
#define SPECIAL_ARGS_dparam 1
#define SPECIAL_ARGS_adj 2
#define SPECIAL_ARGS_rand 1
#define SPECIAL_ARGS_detach 1
#define SPECIAL_ARGS_site MANY
#define SPECIAL_ARGS_siten MANY
#define SPECIAL_ARGS_alloc 0
#define SPECIAL_ARGS_load 2
#define SPECIAL_ARGS_store 3
#define SPECIAL_ARGS_acopy 2
#define SPECIAL_ARGS_if_ 1
#define SPECIAL_ARGS_loop MANY
#define SPECIAL_ARGS_revloop MANY
#define SPECIAL_ARGS_custom MANY
#define SPECIAL_ARGS_yield MANY
#define SPECIAL_ARGS_proj 1
#define SPECIAL_ARGS_arg 0
#define SPECIAL_ARGS_partner 1
#define SPECIAL_ARGS_both 0
#define SPECIAL_ARGS_tapemark 0
#define SPECIAL_ARGS_tapepush MANY
#define SPECIAL_ARGS_count 1
#define SPECIAL_ARGS_print MANY
#define SPECIAL_ARGS_query 8
#define SPECIAL_ARGS_window 3

/* The first letter of a signature is the result; '?' and '.' are TY_VOID here. */
#define SIGNATURE_TYPE(s)                                                                                              \
    ((s)[0] == 'f' ? TY_FLT : (s)[0] == 'i' ? TY_INT : (s)[0] == 'b' ? TY_BOOL : (s)[0] == 't' ? TY_TAPE : TY_VOID)

const OpInfo ir_ops[OP_COUNT] = {
#define FOP1(name, value, partials, domain, lowering, policy) {#name, 1, TY_FLT, TY_FLT, false, IS_##lowering},
#define FOP2(name, value, partials, domain, lowering, policy) {#name, 2, TY_FLT, TY_FLT, false, IS_##lowering},
#define FOP3(name, value, partials, domain, lowering, policy) {#name, 3, TY_FLT, TY_FLT, false, IS_##lowering},
#define FCMP2(name, ...) {#name, 2, TY_BOOL, TY_FLT, false, false},
#define FSEL(name, value) {#name, 3, TYPE_##name, TYPE_##name, false, false},
#define IOP1(name, ...) {#name, 1, TY_INT, TY_INT, false, false},
#define IOP2(name, ...) {#name, 2, TY_INT, TY_INT, false, false},
#define ICMP2(name, ...) {#name, 2, TY_BOOL, TY_INT, false, false},
#define BOP1(name, ...) {#name, 1, TY_BOOL, TY_BOOL, false, false},
#define BOP2(name, ...) {#name, 2, TY_BOOL, TY_BOOL, false, false},
#define CONV(name, result, argument, ...) {#name, 1, TYPE_##result, TYPE_##argument, false, false},
#define SPECIAL(name, signature, ...)                                                                                  \
    {#name, SPECIAL_ARGS_##name, SIGNATURE_TYPE(signature), TY_VOID, true, false},
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
