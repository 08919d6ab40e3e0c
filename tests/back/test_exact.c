/* What kernels compute another way than it is written: roots by Newton's steps, products and quotients that are 0 where
 * a factor is. Every bit is that of the plain operation. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "compiler/back/back.h"

static CompiledModule *compile(Session *s, Fn *fn, const BackOptions *o) {
    KernelRequest k = {"kernel", fn};
    CompiledModule *m = NULL;
    const char *why = "";
    int status = back_compile(s, &k, 1, o, &m, &why);
    if (status) fprintf(stderr, "%s\n", why);
    assert_int_equal(status, 0);
    return m;
}

static uint32_t bits_of(float x) {
    uint32_t b;
    memcpy(&b, &x, sizeof b);
    return b;
}
static float float_of(uint32_t b) {
    float x;
    memcpy(&x, &b, sizeof x);
    return x;
}

/* ---- Newton's steps, in C: the proof that emit_newton.c rests on */
static float steps(float v, float y) {
    float g = v * y, h = y * 0.5f;
    const float r = fmaf(-h, g, 0.5f);
    g = fmaf(g, r, g), h = fmaf(h, r, h);
    const float d = fmaf(-g, g, v);
    return fmaf(d, h, g);
}

/* All floats of two binades, from approximations as bad as processors may make them and from ones in between. (All
 * those in between were tried once, 2200 for each float: 3.7e10 roots, which took 9 s by vectors.) */
static void every_root_of_two_binades(void **state) {
    (void)state;
    const double worst = 0x1p-14;
    uint32_t seed = 1;
    uint64_t wrong = 0;
    for (uint32_t i = 0; i < 1u << 24; i++) {
        const float v = float_of(0x3f800000 + i), root = sqrtf(v);
        const double y = 1 / sqrt((double)v);
        seed = seed * 1664525 + 1013904223;
        const double some = ((double)seed * 0x1p-31 - 1) * worst;
        wrong += steps(v, (float)(y * (1 + worst))) != root;
        wrong += steps(v, (float)(y * (1 - worst))) != root;
        wrong += steps(v, (float)(y * (1 + some))) != root;
    }
    assert_int_equal(wrong, 0);
}

/* ---- what kernels make of them */
enum { ROOTS = 4, LANES = 1 << 16, PAD = 64 };

/* A loop that does nothing but take roots: the divider has more to do than all else. */
static Fn *four_roots(Session *s) {
    Fn *fn = ir_fn(s, &s->module, "roots", PREC_F32);
    Builder b = ir_at_end(fn, fn->body);
    Inst *x[ROOTS], *out[ROOTS];
    for (uint32_t i = 0; i < ROOTS; i++) x[i] = ir_input(&b, IN_X0);
    Inst *loop = ir_loop(&b, ROOTS, x, (LoopInfo){.max_iters = 1, .exact = true});
    Builder t = ir_at_end(fn, loop->region[0]);
    Inst *y[ROOTS + 1] = {ir_emit2(&t, OP_ilt, loop->region[0]->params[0], ir_consti(&t, 0))};
    for (uint32_t i = 0; i < ROOTS; i++) y[i + 1] = ir_emit1(&t, OP_fsqrt, loop->region[0]->params[i + 1]);
    ir_yield(&t, ROOTS + 1, y);
    for (uint32_t i = 0; i < ROOTS; i++) out[i] = ir_proj(&b, loop, i);
    ir_yield(&b, ROOTS, out);
    return fn;
}

static uint32_t count_in(const char *text, const char *word) {
    uint32_t n = 0;
    for (const char *at = text; (at = strstr(at, word)); at++) n++;
    return n;
}

/* To be freed. */
static char *assembly(Session *s, Fn *fn, const BackOptions *o) {
    const KernelRequest k = {"kernel", fn};
    unsigned char *bytes = NULL;
    size_t size = 0;
    const char *why = "";
    assert_int_equal(back_emit(s, &k, 1, o, 's', &bytes, &size, &why), 0);
    char *text = calloc(size + 1, 1);
    assert_non_null(text);
    memcpy(text, bytes, size);
    free(bytes);
    return text;
}

static void assert_steps(Session *s, bool slow, uint32_t width, uint32_t by_steps) {
    BackOptions o = {.width = width, .no_cache = true, .opt_level = 2};
    assert_true(target_named(&o.target, "avx512"));
    o.target.slow_divider = slow;
    char *text = assembly(s, four_roots(s), &o);
    assert_int_equal(count_in(text, "vrsqrt14ps"), by_steps);
    assert_int_equal(count_in(text, "vsqrtps"), width / 16 * ROOTS - by_steps);
    free(text);
}

/* Half of them; none where a vector waits for its own root, nor where the divider is as fast as it is wide. */
static void some_roots_by_steps(void **state) {
    (void)state;
    Session *s = session_create(0);
    assert_steps(s, true, 64, 4 * ROOTS / 2);
    assert_steps(s, true, 16, 0);
    assert_steps(s, false, 64, 0);
    session_destroy(s);
}

static bool host_runs(const char *name) {
    Target here, t;
    assert_true(target_named(&here, "native") && target_named(&t, name));
    return target_runs(&t, &here);
}

/* Of floats from `first` on; true: a root of each of them is right. */
static bool roots_are_right(CompiledModule *m, uint32_t first) {
    _Alignas(64) static float x[LANES + PAD], out[ROOTS][LANES + PAD];
    for (uint32_t i = 0; i < LANES; i++) x[i] = float_of(first + i);
    SltKernelArgs a = {.in = {[IN_X0] = x}, .out = {out[0], out[1], out[2], out[3]}, .n_valid = LANES};
    back_kernel(m, "kernel")(&a, LANES);
    uint64_t wrong = 0;
    for (uint32_t i = 0; i < LANES; i++) {
        const uint32_t root = bits_of(__builtin_sqrtf(x[i]));
        for (uint32_t k = 0; k < ROOTS; k++) wrong += bits_of(out[k][i]) != root;
    }
    return !wrong;
}

/* Both signs of floats that are not, are hardly or are just numbers, or are near where small ones are scaled, two
 * binades in the middle, and one block in 61 of the others; SALTUS_EVERY_FLOAT in the environment: all 2^32. */
static void roots_of_kernels(void **state) {
    (void)state;
    if (!host_runs("avx512")) skip();
    enum { BLOCKS = 1 << 16 }; /* a block has a sign, the exponent and 7 bits */
    const bool every = getenv("SALTUS_EVERY_FLOAT");
    Session *s = session_create(0);
    BackOptions o = {.width = 64, .no_cache = true, .opt_level = 2};
    assert_true(target_named(&o.target, "avx512"));
    o.target.slow_divider = true;
    CompiledModule *m = compile(s, four_roots(s), &o);
    for (uint32_t block = 0; block < BLOCKS; block++) {
        const int exponent = (int)(block >> 7 & 255) - 127;
        const bool end = exponent < -125 || exponent == 128 || exponent == -61 || exponent == -60;
        const bool middle = block < BLOCKS / 2 && (exponent == 0 || exponent == 1),
                   edge = end && (block & 127) % 42 == 0;
        if (!every && !edge && !middle && block % 61) continue;
        if (!roots_are_right(m, block << 16)) fail_msg("a float from %a on", (double)float_of(block << 16));
    }
    back_free(m);
    session_destroy(s);
}

/* ---- guarded products */
enum { GUARDED = 4, KINDS = 12, PAIRS = (KINDS * KINDS + PAD - 1) / PAD * PAD };

/* What is 0 where g is, or x is, whatever the other is. */
static Fn *guarded(Session *s) {
    Fn *fn = ir_fn(s, &s->module, "guarded", PREC_F32);
    Builder b = ir_at_end(fn, fn->body);
    Inst *x = ir_input(&b, IN_X0), *g = ir_input(&b, IN_X1), *zero = ir_constf(&b, 0);
    Inst *once = ir_emit2(&b, OP_zmul, x, g), *quotient = ir_emit2(&b, OP_zdiv, g, x);
    Inst *twice = ir_emit3(&b, OP_fsel, ir_emit2(&b, OP_feq, g, zero), zero, once);
    Inst *other = ir_emit3(&b, OP_fsel, ir_emit2(&b, OP_feq, x, zero), zero, once); /* once more by the same */
    ir_yield(&b, GUARDED, (Inst *[]){once, twice, other, quotient});
    return fn;
}

static void guarded_products(void **state) {
    (void)state;
    static const char *const targets[] = {"sse2", "avx2", "avx512"};
    static const float kinds[KINDS] = {0,         -0.0f,      1,       -1.5f, INFINITY, -INFINITY,
                                       0x1p-149f, -0x1p-140f, FLT_MAX, 0.1f,  FLT_MIN,  0 /* a NaN */};
    _Alignas(64) float x[PAIRS + PAD] = {0}, g[PAIRS + PAD] = {0}, out[GUARDED][PAIRS + PAD];
    for (int i = 0; i < KINDS * KINDS; i++) {
        x[i] = i % KINDS == KINDS - 1 ? __builtin_nanf("") : kinds[i % KINDS];
        g[i] = i / KINDS == KINDS - 1 ? __builtin_nanf("") : kinds[i / KINDS];
    }
    for (int t = 0; t < 3; t++)
        for (uint32_t w = 1; w <= 64 && host_runs(targets[t]); w *= 2) {
            Session *s = session_create(0);
            BackOptions o = {.width = w, .no_cache = true, .opt_level = 2};
            assert_true(target_named(&o.target, targets[t]));
            CompiledModule *m = compile(s, guarded(s), &o);
            SltKernelArgs a = {
                .in = {[IN_X0] = x, [IN_X1] = g}, .out = {out[0], out[1], out[2], out[3]}, .n_valid = PAIRS};
            back_kernel(m, "kernel")(&a, PAIRS);
            for (int i = 0; i < KINDS * KINDS; i++) {
                const float once = x[i] == 0 ? 0 : x[i] * g[i], twice = g[i] == 0 ? 0 : once;
                const float want[GUARDED] = {once, twice, once, g[i] == 0 ? 0 : g[i] / x[i]};
                for (int k = 0; k < GUARDED; k++)
                    if (!(isnan(want[k]) && isnan(out[k][i])) && bits_of(want[k]) != bits_of(out[k][i]))
                        fail_msg("%s, %u lanes, output %d of %a, %a: %a, not %a", targets[t], w, k, (double)x[i],
                                 (double)g[i], (double)out[k][i], (double)want[k]);
            }
            back_free(m);
            session_destroy(s);
        }
}

/* ---- quotients by constants, as two products */
enum { DIVISORS = 10 };
static const double divisors[DIVISORS] = {3, -0.04, 10, 255, 1e-5, 6.2831853, 0.7, 1.7320508, 12345.678, 0x1.fffffep9};

/* Of whole numbers and of roots, by each; the seventh and the eighth are not to be had by products. */
static Fn *by_constants(Session *s, bool roots) {
    Fn *fn = ir_fn(s, &s->module, "quotients", PREC_F32);
    Builder b = ir_at_end(fn, fn->body);
    Inst *x = ir_input(&b, IN_X0), *out[DIVISORS];
    x = roots ? ir_emit1(&b, OP_fsqrt, x) : ir_emit1(&b, OP_i2f, ir_emit1(&b, OP_f2i, x));
    for (uint32_t k = 0; k < DIVISORS; k++)
        out[k] = ir_emit2(&b, OP_fdiv, x, ir_constf(&b, (double)(float)divisors[k]));
    ir_yield(&b, DIVISORS, out);
    return fn;
}

static uint64_t wrong_quotients(CompiledModule *m, const float *x, bool roots) {
    _Alignas(64) static float out[DIVISORS][LANES + PAD];
    SltKernelArgs a = {.in = {[IN_X0] = x}, .n_valid = LANES};
    for (uint32_t k = 0; k < DIVISORS; k++) a.out[k] = out[k];
    back_kernel(m, "kernel")(&a, LANES);
    uint64_t wrong = 0;
    for (uint32_t i = 0; i < LANES; i++) {
        const float v = roots ? __builtin_sqrtf(x[i]) : x[i];
        for (uint32_t k = 0; k < DIVISORS; k++) {
            const float q = v / (float)divisors[k];
            wrong += isnan(q) ? !isnan(out[k][i]) : bits_of(out[k][i]) != bits_of(q);
        }
    }
    return wrong;
}

/* All 24 bits that a float may have, of both signs; and roots of the least, of the largest and of what is no number. */
static void quotients_of_kernels(void **state) {
    (void)state;
    _Alignas(64) static float x[LANES + PAD];
    static const char *const targets[2] = {"avx512", "avx2"};
    for (int t = 0; t < 2; t++) {
        if (!host_runs(targets[t])) continue;
        Session *s = session_create(0);
        BackOptions o = {.width = 32, .no_cache = true, .opt_level = 2};
        assert_true(target_named(&o.target, targets[t]));
        CompiledModule *m = compile(s, by_constants(s, false), &o), *r = compile(s, by_constants(s, true), &o);
        for (uint32_t first = 1u << 23; first < 1u << 24; first += LANES) {
            for (uint32_t i = 0; i < LANES; i++) x[i] = (float)(first + i) * (i % 3 ? 1 : -1);
            assert_int_equal(wrong_quotients(m, x, false), 0);
        }
        for (uint32_t high = 0; high < 1u << 16; high += 251) {
            for (uint32_t i = 0; i < LANES; i++) x[i] = float_of(high << 16 | i);
            assert_int_equal(wrong_quotients(r, x, true), 0);
        }
        x[0] = 0, x[1] = -0.0f, x[2] = INFINITY, x[3] = NAN, x[4] = FLT_MIN, x[5] = float_of(1), x[6] = FLT_MAX;
        assert_int_equal(wrong_quotients(r, x, true), 0);
        back_free(m), back_free(r);
        session_destroy(s);
    }
}

/* No division is left but those by 0.7 and the root of 3; all where a numerator may be as small as floats are. */
static void constants_by_products(void **state) {
    (void)state;
    Session *s = session_create(0);
    for (int known = 0; known < 2; known++) {
        BackOptions o = {.width = 16, .no_cache = true, .opt_level = 2};
        assert_true(target_named(&o.target, "avx512"));
        Fn *fn = by_constants(s, false);
        if (!known)
            for (Inst *i = fn->body->first; i; i = i->next)
                if (i->op == OP_fdiv) i->args[0] = fn->body->first;
        char *text = assembly(s, fn, &o);
        assert_int_equal(count_in(text, "vdivps"), known ? 2 : DIVISORS);
        free(text);
    }
    session_destroy(s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_root_of_two_binades), cmocka_unit_test(some_roots_by_steps),
        cmocka_unit_test(roots_of_kernels),          cmocka_unit_test(guarded_products),
        cmocka_unit_test(quotients_of_kernels),      cmocka_unit_test(constants_by_products),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
