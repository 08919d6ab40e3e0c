/* Roots that are only compared with what lanes share: kernels compare what is under the root with a bound instead, and
 * decide as the interpreter, which takes the root. Points lie where the root is r, or a few floats beside it. */
#include <float.h>
#include <math.h>

#include "bindings/c/api.h"
#include "tests/api/program.h"

enum { POINTS = 4096 };

static uint64_t seed = 1;
static double uniform(void) {
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return (double)(seed >> 11) * 0x1p-53;
}

static void decide(SltProgram *p, double r, const double *x, double *out) {
    SltJob job = SLT_JOB_INIT;
    SltError err;
    assert_ok(slt_set_floats(p, 0, 1, &r, &err));
    assert_ok(slt_eval(p, &job, POINTS, x, NULL, out, NULL, &err));
}

/* On a circle of radius r, as near as floats come. (Where gcc 12 makes a vector of two neighbours, it leaves the
 * rounding of `(double)(float)x` out: hence volatile. In the library it makes none of such.) */
static void around(double r, double *x) {
    const double size = isfinite(r) ? fabs(r) : 1;
    for (int i = 0; i < POINTS; i++) {
        const double turn = uniform() * 6.283185307179586, nudge = 1 + (i % 4 - 1.5) * 0x1p-24;
        const volatile float at[2] = {(float)(size * nudge * cos(turn)), (float)(size * nudge * sin(turn))};
        x[2 * i] = (double)at[0], x[2 * i + 1] = (double)at[1];
    }
}

static const char compared[] = "param float r = 1.0;\n"
                               "shader float main(float2 x) { float f = 0.0; [NoDisc] if (%s) f = 1.0; return f; }\n";

static void decided_as_by_the_root(void **state) {
    (void)state;
    static const char *const how[] = {"length(x) < r", "length(x) - abs(r) < 0.0", "sqrt(x.x * x.x + x.y * x.y) < r"},
                             *const target[] = {"native", "avx2", "sse2"};
    static const double radius[] = {1,     0.7,      3,         1 + 0x1p-23, 2 - 0x1p-23, 0x1p-70, 1e-22,
                                    1e-42, 0x1p-149, 1.5e19,    1.9e19,      3e38,        FLT_MAX, 0,
                                    -1,    INFINITY, -INFINITY, 0x1p-63,     0.1234567,   1e-15,   1.844674352e19};
    static double x[2 * POINTS], wanted[POINTS], got[POINTS];
    uint64_t inside = 0, all = 0;
    for (size_t h = 0; h < sizeof how / sizeof *how; h++) {
        char source[256];
        snprintf(source, sizeof source, compared, how[h]);
        for (size_t t = 0; t < 6; t++) {
            SltOptions opt = SLT_OPTIONS_INIT;
            opt.target = t % 3 ? target[t % 3] : NULL, opt.width = t < 3 ? 0 : 64; /* with products fused, or not */
            SltProgram *p = compile_with(source, opt);
            opt.interpret = true;
            SltProgram *oracle = compile_with(source, opt);
            for (size_t k = 0; k < sizeof radius / sizeof *radius + 20; k++) {
                const double r = k < sizeof radius / sizeof *radius ? radius[k] : (float)exp(20 * uniform() - 10);
                around(r, x);
                decide(oracle, r, x, wanted), decide(p, r, x, got);
                for (int i = 0; i < POINTS; i++) {
                    if (wanted[i] != got[i])
                        fail_msg("%s, r = %a at %a, %a: %g, interpreted %g", how[h], r, x[2 * i], x[2 * i + 1], got[i],
                                 wanted[i]);
                    inside += wanted[i] == 1, all++;
                }
            }
            slt_program_free(p), slt_program_free(oracle);
        }
    }
    assert_in_range(inside, all / 4, 3 * (all / 4)); /* they lie on both sides */
}

/* A root is taken where it is wanted, or where lanes have bounds of their own. */
static bool takes_root(const char *how) {
    static const bool needs[K_KINDS] = {[K_VALUE] = true};
    char source[256];
    SltError err;
    snprintf(source, sizeof source, compared, how);
    SltProgram *p = compile(source);
    assert_ok(api_kernels(p, needs, &err));
    const KernelRequest k = {"value", p->fn[K_VALUE]};
    const BackOptions o = {.target = p->target, .opt_level = 2};
    unsigned char *text;
    size_t size;
    const char *why = "";
    assert_int_equal(back_emit(p->session, &k, 1, &o, 's', &text, &size, &why), SLT_OK);
    bool takes = false;
    for (size_t i = 0; i + 4 <= size; i++) takes |= !memcmp(text + i, "sqrt", 4);
    free(text);
    slt_program_free(p);
    return takes;
}

static void taken_where_it_is_wanted(void **state) {
    (void)state;
    assert_false(takes_root("length(x) < r"));
    assert_false(takes_root("length(x) - abs(r) < 0.0"));
    assert_true(takes_root("length(x) < r * x.x"));
    assert_true(takes_root("sqrt(x.x) < r"));
    assert_true(takes_root("sin(length(x)) < r"));
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(decided_as_by_the_root),
                                       cmocka_unit_test(taken_where_it_is_wanted)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
