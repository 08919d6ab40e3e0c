/* Roots by Newton's steps, beside those of the divider.
 *
 * Where a vector of 64 bytes goes through the divider in two halves (Target.slow_divider), a root keeps it busy for as
 * long as the rest of the processor takes for two dozen additions; and nothing else is wanted of it meanwhile. So some
 * roots of a loop, as many as make both parts of the processor take equally long, are made of an approximation of 14
 * bits and seven products and sums:
 *
 *     y ~ 1/sqrt(v);  g = v y;  h = y/2;  r = 1/2 - h g;  g += g r;  h += h r;  d = v - g g;  g += d h
 *
 * with every difference rounded once (Markstein, Computation of elementary functions on the IBM RISC System/6000
 * processor, 1990; Cornea, Harrison and Tang, Scientific Computing on Itanium-based Systems, 2002). What comes out is
 * the root as rounded, to the last bit, whatever y is within 2^-14 of 1/sqrt(v): for floats this was proven by trying
 * all v of two binades and all such y (tests/back/test_exact.c tries all v, and the ends of y). Other binades
 * differ by a power of 4, as long as d is not below what floats hold: small v are made 2^64 times as large before. What
 * has no approximation, 0, infinities, negative numbers and NaN, is put right at the end, in one instruction. */
#include "compiler/back/cpu/emit.h"

/* In cycles of such a divider, and in instructions, two of which begin in a cycle. */
enum { ROOT_CYCLES = 12, QUOTIENT_CYCLES = 10, DIVIDER_INSTRUCTIONS = 3, STEPS = 14 };

/* What an iteration does. */
typedef struct Work {
    uint32_t instructions, quotients, roots;
    bool loops; /* another loop is in it */
} Work;

static bool is_root(const Emit *e, const Inst *i) { return i->op == OP_fsqrt && emit_is_vector(e, i); }

static void add_work(const Emit *e, const Block *b, Work *w) {
    for (const Inst *i = b->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) add_work(e, i->region[r], w);
        if (i->op == OP_loop || i->op == OP_revloop) w->loops = true;
        if (!emit_is_vector(e, i)) continue;
        float inverse[2];
        if (i->op == OP_fsqrt) w->roots++;
        else if (emit_divides_by_products(e, i, inverse)) w->instructions += 2;
        else if (i->op == OP_fdiv || i->op == OP_zdiv) w->quotients++;
        else w->instructions += ir_ops[i->op].cost;
    }
}

/* Every root by steps takes the divider less time, and the rest more: until these are equal. */
static uint32_t most_by_steps(const Work *w) {
    const uint32_t by_divider = w->roots + w->quotients,
                   divider = 2 * (w->roots * ROOT_CYCLES + w->quotients * QUOTIENT_CYCLES),
                   others = w->instructions + by_divider * DIVIDER_INSTRUCTIONS;
    if (w->loops || divider <= others) return 0;
    const uint32_t n = (divider - others) / (2 * ROOT_CYCLES + STEPS - DIVIDER_INSTRUCTIONS);
    return n < w->roots ? n : w->roots;
}

/* Every so many of them, from the middle on. */
static void choose(Emit *e, const Block *b, const Work *w, uint32_t n, uint32_t *sum) {
    for (const Inst *i = b->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) choose(e, i->region[r], w, n, sum);
        if (!is_root(e, i)) continue;
        *sum += n;
        e->by_steps[i->id] = *sum >= w->roots;
        if (e->by_steps[i->id]) *sum -= w->roots;
    }
}

void emit_choose_roots(Emit *e, const Block *body) {
    /* One vector a value waits for its roots, and Newton's take longer. */
    if (!e->opt->target.slow_divider || e->fn->precision != PREC_F32 || e->L * 4 < 64 || e->P == 1) return;
    Work w = {0};
    add_work(e, body, &w);
    const uint32_t n = most_by_steps(&w);
    if (!n) return;
    if (!e->by_steps) e->by_steps = ARENA_ARRAY(e->arena, bool, e->fn->ninsts + 1);
    uint32_t sum = w.roots / 2;
    choose(e, body, &w, n, &sum);
}

/* ---- one part */
static Part splat_f(Emit *e, double v) { return emit_splat(e, LL(ConstReal)(e->t_f32, v)); }
static Part product(Emit *e, Part a, Part b) { return LL(BuildFMul)(e->b, a, b, ""); }

static Part fma_of(Emit *e, Part a, Part b, Part c) {
    Part x[3] = {a, b, c};
    return emit_intrinsic(e, "llvm.fma", LL(TypeOf)(a), x, 3);
}
static Part minus_product(Emit *e, Part c, Part a, Part b) { return fma_of(e, LL(BuildFNeg)(e->b, a, ""), b, c); }

/* What vfixupimmps answers for each kind of v, four bits a kind: the root that was made, v itself, or the NaN of an
 * operation that has no result. */
enum { MADE = 0, ITSELF = 1, ITSELF_QUIET = 2, NO_RESULT = 3 };
enum { QUIET_NAN, SIGNALLING_NAN, ZERO, ONE, MINUS_INFINITY, INFINITE, NEGATIVE, POSITIVE };
#define ANSWER(kind, what) ((uint32_t)(what) << 4 * (kind))
static const uint32_t answers = ANSWER(QUIET_NAN, ITSELF_QUIET) | ANSWER(SIGNALLING_NAN, ITSELF_QUIET) |
                                ANSWER(ZERO, ITSELF) | ANSWER(ONE, MADE) | ANSWER(MINUS_INFINITY, NO_RESULT) |
                                ANSWER(INFINITE, ITSELF) | ANSWER(NEGATIVE, NO_RESULT) | ANSWER(POSITIVE, MADE);

Part emit_root_by_steps(Emit *e, Part v) {
    const Part all = LL(ConstAllOnes)(LL(IntTypeInContext)(e->ctx, e->L)), half = splat_f(e, 0.5);
    const Part small = LL(BuildFCmp)(e->b, LLVMRealOLT, v, splat_f(e, 0x1p-60), ""),
               u = LL(BuildSelect)(e->b, small, product(e, v, splat_f(e, 0x1p64)), v, "");
    Part guess[3] = {u, LL(ConstNull)(LL(TypeOf)(v)), all};
    const Part y = emit_intrinsic(e, "llvm.x86.avx512.rsqrt14.ps.512", NULL, guess, 3);
    Part g = product(e, u, y), h = product(e, y, half);
    const Part r = minus_product(e, half, h, g);
    g = fma_of(e, g, r, g), h = fma_of(e, h, r, h);
    const Part d = minus_product(e, u, g, g);
    g = fma_of(e, d, h, g);
    g = LL(BuildSelect)(e->b, small, product(e, g, splat_f(e, 0x1p-32)), g, "");
    Part fix[6] = {g,
                   v,
                   emit_splat(e, emit_int(e, e->t_i32, answers)),
                   emit_int(e, e->t_i32, 0 /* no kind raises a flag */),
                   all,
                   emit_int(e, e->t_i32, 4 /* rounding as set */)};
    return emit_intrinsic(e, "llvm.x86.avx512.mask.fixupimm.ps.512", NULL, fix, 6);
}
