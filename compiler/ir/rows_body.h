/* No include guard: one evaluator of ops.def for the element type T, named ROWS_NAME. Included by rows.c only. */
#define ROW1(name, R, A, value)                                                                    \
    case OP_##name: {                                                                              \
        R *d = dst;                                                                                \
        const A *xa = pa;                                                                          \
        for (uint32_t l = 0; l < n; l++) {                                                         \
            const A a = xa[l];                                                                     \
            d[l] = (R)(value);                                                                     \
        }                                                                                          \
        return;                                                                                    \
    }
#define ROW2(name, R, A, value)                                                                    \
    case OP_##name: {                                                                              \
        R *d = dst;                                                                                \
        const A *xa = pa, *xb = pb;                                                                \
        for (uint32_t l = 0; l < n; l++) {                                                         \
            const A a = xa[l], b = xb[l];                                                          \
            d[l] = (R)(value);                                                                     \
        }                                                                                          \
        return;                                                                                    \
    }
#define ROW3(name, R, A, B, value)                                                                 \
    case OP_##name: {                                                                              \
        R *d = dst;                                                                                \
        const A *xa = pa;                                                                          \
        const B *xb = pb, *xc = pc;                                                                \
        for (uint32_t l = 0; l < n; l++) {                                                         \
            const A a = xa[l];                                                                     \
            const B b = xb[l], c = xc[l];                                                          \
            d[l] = (R)(value);                                                                     \
        }                                                                                          \
        return;                                                                                    \
    }

/* C types of the column letters of CONV, and of the select rows. */
#define CTYPE_F T
#define CTYPE_I int32_t
#define CTYPE_B int32_t
#define CTYPE_fsel T
#define CTYPE_isel int32_t
#define CTYPE_bsel int32_t

void ROWS_NAME(uint8_t op, uint32_t n, void *dst, const void *pa, const void *pb, const void *pc) {
    switch ((Op)op) {
#define FOP1(name, value, ...) ROW1(name, T, T, value)
#define FOP2(name, value, ...) ROW2(name, T, T, value)
#define FOP3(name, value, ...) ROW3(name, T, T, T, value)
#define FCMP2(name, value, ...) ROW2(name, int32_t, T, value)
#define FSEL(name, value, ...) ROW3(name, CTYPE_##name, int32_t, CTYPE_##name, value)
#define IOP1(name, value, ...) ROW1(name, int32_t, int32_t, value)
#define IOP2(name, value, ...) ROW2(name, int32_t, int32_t, value)
#define ICMP2(name, value, ...) ROW2(name, int32_t, int32_t, value)
#define BOP1(name, value, ...) ROW1(name, int32_t, int32_t, value)
#define BOP2(name, value, ...) ROW2(name, int32_t, int32_t, value)
#define CONV(name, result, argument, value, ...) ROW1(name, CTYPE_##result, CTYPE_##argument, value)
#define SPECIAL(name, ...) case OP_##name:
#include "compiler/ir/ops.def"
#include "compiler/ir/ops_undef.h"
    case OP_COUNT: return;
    }
}

#undef ROW1
#undef ROW2
#undef ROW3
#undef CTYPE_F
#undef CTYPE_I
#undef CTYPE_B
#undef CTYPE_fsel
#undef CTYPE_isel
#undef CTYPE_bsel
