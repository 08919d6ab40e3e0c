/* Events whose g other decisions change: their jumps and bends cost no more than other meetings of curves. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "saltus/saltus.h"

#define PI 3.14159265358979323846

typedef struct Nested {
    const char *name, *source;
    struct {
        const char *param;
        double value;
    } want[4];
    uint64_t most; /* evaluations; 0: a million */
    double error;  /* that is asked for; 0: 1e-9 */
} Nested;

/* The moment of the curve x = a - t y of a tagged read, seen through y = h + x / 10: with a = 0.43, t = 0.2 and reads p
 * = 0.71, q = 0.22. Where it leaves the lines of p and of q: */
#define AT(h) (((h) + 0.1 * 0.43) / (1 + 0.1 * 0.2))
#define BESIDE(h) (0.43 - 0.2 * AT(h))
/* of 1 + a - t y and of y times it, from one to the other; of 1 + x from 0 to x */
#define ARC(y) ((1.43 - 0.1 * (y)) * (y))
#define TURN(y) ((0.715 - 0.2 / 3 * (y)) * (y) * (y))
#define RAMP(x) ((x) + 0.5 * (x) * (x))

#define NESTED "param float a = 0.43; param float p = 0.71; param float q = 0.22; param float t = 0.2; "

/* Twenty stripes by what is left of a tagged rounding, whole ones. */
#define STRIPES(k)                                                                                                     \
    "param float w = 0.2; param float p = 0.35; param float t = 0.05; shader float main(float2 x) { "                  \
    "float u = 20.0 * x.x + p + t * x.y; " k " [Disc] if (k < w) return 1.0 + x.x; return 0.0; }",                     \
        .want = {{"w", 1 + (210 - 20 * 0.175) / 400}, {"p", -0.01}, {"t", -0.005}}, .most = 300000

static const Nested nested[] = {
    {"stripes by frac", STRIPES("[Disc] float k = frac(u);")},
    {"stripes by floor", STRIPES("[Disc] float k = u - floor(u);")},
    {"stripes by ceil", STRIPES("[Disc] float k = u - ceil(u) + 1.0;")},
    {"stripes by round", STRIPES("[Disc] float k = u - round(u - 0.5);")},
    {"stripes by trunc", STRIPES("[Disc] float k = u - trunc(u);")},
    {"stripes by trunc, below 0", STRIPES("[Disc] float k = u - 29.0 - trunc(u - 30.0);")},
    {"stripes by fmod", STRIPES("[Disc] float k = fmod(u, 1.0);")},
    {"stripes by an integer", STRIPES("[Disc] int n = int(u); float k = u - float(n);")},
    /* The second one's edge is that of the first, whose g has the other sign. */
    {"a maximum and a minimum of two, in either order",
     "param float w = 0.03; shader float main(float x) { float c = 0.5 - 0.3 * x; [Disc] if (max(c, x) - min(x, c) < w) "
     "return 1.0; return 0.0; }",
     .want = {{"w", 2 / 1.3}}, .most = 2000},
    {"the edge between two cells, by the second nearest",
     "param float w = 0.03; param float2 c[2] = { float2(0.2, 0.3), float2(0.7, 0.25) }; shader float main(float2 x) { "
     "float m = 9.0; float n = 9.0; for (int i = 0; i < 2; i++) { float2 d = x - c[i]; float q = dot(d, d); n = min(n, "
     "max(q, m)); m = min(m, q); } [Disc] if (n - m < w) return 1.0; return 0.0; }",
     .want = {{"w", 2}}, .most = 30000},
    {"stripes in a loop",
     "param float w = 0.2; param float p = 0.35; param float t = 0.05; shader float main(float2 x) { float f = 0.0; for "
     "(int i = 0; i < 2; i++) { [Disc] float k = frac(20.0 * x.x + p + t * x.y); [Disc] if (k < w + 0.1 * float(i)) f "
     "+= 1.0 + x.x; } return f; }",
     .want = {{"w", 2 + (420 - 20 * 0.25) / 400}, {"p", -0.025}, {"t", -0.0125}}, .most = 400000},
    {"a number that a jump replaces",
     NESTED "shader float main(float x) { float h = q; [Disc] if (x < a) h = p; [Disc] if (x < h) return 1.0 + x; "
            "return 0.0; }",
     /* below a it is below p, above a above q: the jump is at a */
     .want = {{"a", 1.43}, {"p", 0}, {"q", 0}}, .most = 2000},
    {"that is read on the near side",
     NESTED "shader float main(float x) { float h = p; [Disc] if (x < a) h = q; [Disc] if (x < h) return 1.0 + x; "
            "return 0.0; }",
     .want = {{"a", -1.43}, {"p", 1.71}, {"q", 1.22}}, .most = 2000},
    {"a height that a jump replaces",
     NESTED "shader float main(float2 x) { float h = q; [Disc] if (x.x + t * x.y < a) h = p; [Disc] if (x.y < h + 0.1 "
            "* x.x) return 1.0 + x.x; return 0.0; }",
     .want = {{"a", ARC(AT(0.71)) - ARC(AT(0.22))},
              {"p", RAMP(BESIDE(0.71))},
              {"q", 1.5 - RAMP(BESIDE(0.22))},
              {"t", TURN(AT(0.22)) - TURN(AT(0.71))}}},
    {"a height of a solid",
     NESTED "shader float main(float3 x) { [Disc] float h = x.x + t * x.y < a ? p : q; [Disc] if (x.z < h + 0.1 * x.x) "
            "return 1.0 + x.x; return 0.0; }",
     .want = {{"a", 0.49 * (1.43 - 0.1)},
              {"p", 0.43 - 0.1 + 0.5 * (0.43 * 0.43 - 0.2 * 0.43 + 0.04 / 3)},
              {"t", -0.49 * (0.715 - 0.2 / 3)}}},
    {"stairs of a loop",
     "param float a = 0.13; param float q = 0.11; param float s = 0.2; shader float main(float2 x) { float h = q; for "
     "(int i = 0; i < 3; i++) { [Disc] if (x.x < a + 0.3 * float(i)) h += s; } [Disc] return x.y < h ? 1.0 : 0.0; }",
     /* q + s (3 a + 0.9) */
     .want = {{"a", 0.6}, {"q", 1}, {"s", 3 * 0.13 + 0.9}}},
    {"elements of an array",
     "param float a = 0.31; param float b = 0.74; param float p = 0.6; param float q = 0.25; shader float main(float2 "
     "x) { float h[2] = {q, q}; [Disc] if (x.x < a) h[0] = p; [Disc] if (x.x < b) h[1] = p; float s = 0.0; for (int i "
     "= 0; i < 2; i++) s += h[i]; [Disc] return x.y < 0.7 * s ? 1.0 : 0.0; }",
     .want = {{"a", 0.7 * 0.35}, {"b", 0.7 * 0.35}, {"p", 0.7 * 1.05}, {"q", 0.7 * 0.95}}},
    {"minima and maxima",
     "param float a = 0.31; param float b = 0.74; param float c = 0.45; shader float main(float2 x) { float d = "
     "min(max(x.x - a, x.y - b), x.x + x.y - c); [Disc] return d < 0.0 ? 1.0 : 0.0; }",
     /* a b and the triangle of side c, less the part of it inside: beyond a there is one of side c - a */
     .want = {{"a", 0.74 - 0.14}, {"b", 0.31}, {"c", 0.14}}},
    {"a bound under another",
     NESTED "shader float main(float2 x) { float h = q; [Disc] if (x.x < a) { h = p; [Disc] if (x.y < t) h = x.y; } "
            "[Disc] return x.x < h ? 1.0 : 0.0; }",
     /* all of x < a, but for y < t: of that x < y */
     .want = {{"a", 0.8}, {"p", 0}, {"q", 0}, {"t", 0.2 - 0.43}}},
};

/* Two balls of radii r = 0.5 and s = 0.45 whose centres are c = 0.4 apart meet in the plane x = h: what one has of the
 * surface is a cap. */
#define BALLS(d) "param float r = 0.5; param float s = 0.45; param float c = 0.4; [Domain(-1.0, 1.0)] shader float main(float3 x) { float a = length(x) - r; float b = length(x - float3(c, 0.0, 0.0)) - s; float d = " d "; [Disc] return d < 0.0 ? 1.0 : 0.0; }"
#define MEET ((0.16 + 0.25 - 0.2025) / 0.8)
#define CAP(radius, height) (2 * PI * (radius) * (height))

static const Nested solids[] = {
    {"union of balls", BALLS("min(a, b)"), .want = {{"r", CAP(0.5, 0.5 + MEET)}, {"s", CAP(0.45, 0.45 + 0.4 - MEET)}},
     .most = 8000000, .error = 1e-6},
    {"intersection of balls", BALLS("max(a, b)"),
     .want = {{"r", CAP(0.5, 0.5 - MEET)}, {"s", CAP(0.45, 0.45 - 0.4 + MEET)}}, .most = 8000000, .error = 1e-6},
    {"difference of balls", BALLS("max(a, -b)"),
     .want = {{"r", CAP(0.5, 0.5 + MEET)}, {"s", -CAP(0.45, 0.45 - 0.4 + MEET)}}, .most = 8000000, .error = 1e-6},
};

static void exact(void **state) {
    const Nested *c = *state;
    SltOptions o = SLT_OPTIONS_INIT;
    o.f64 = true;
    SltProgram *p = NULL;
    if (slt_compile_string(c->source, c->name, &o, &p) != SLT_OK) fail_msg("%s", slt_diagnostics_text(p));
    SltJob job = SLT_JOB_INIT;
    job.integral = true, job.estimator = SLT_EST_QUADRATURE, job.threads = 2;
    job.error = c->error > 0 ? c->error : 1e-9;
    double g[8] = {0};
    SltIntegral out = {.struct_size = sizeof out, .gradient = g};
    SltStats stats = SLT_STATS_INIT;
    SltError err = {0};
    if (slt_grad_integral(p, &job, &out, &stats, &err) != SLT_OK) fail_msg("%s", err.text);
    for (int w = 0; w < 4 && c->want[w].param; w++) {
        SltParam q = SLT_PARAM_INIT;
        assert_int_equal(slt_param_find(p, c->want[w].param, &q, &err), SLT_OK);
        if (!(fabs(g[q.fbase] - c->want[w].value) <= (c->error > 0 ? 2 * c->error : 1e-9)))
            fail_msg("d/d%s = %.12g, exact %.12g", q.name, g[q.fbase], c->want[w].value);
    }
    if (getenv("SALTUS_PRINT")) printf("    %llu evaluations\n", (unsigned long long)stats.evaluations);
    if (stats.left > 0) fail_msg("left %g", stats.left);
    if (stats.evaluations > (c->most ? c->most : 1000000))
        fail_msg("%llu evaluations", (unsigned long long)stats.evaluations);
    slt_program_free(p);
}

/* Where it is no site that makes g jump, nothing is proven of the stretch along which it does: it is left, and said to
 * be.
 */
static void by_a_seam(void **state) {
    (void)state;
    static const char *const reads[] = {
        "[NoDisc] if (x.x + t * x.y < a) h = p;",
        "[Disc] if (x.x * x.x + x.y < 0.9 + a) { [NoDisc] if (x.x + t * x.y < a) h = p; }",
        "[Disc] if (x.y < t) h = 0.3; [NoDisc] h = min(h, x.x + t * x.y < a ? p : q);",
    };
    for (int i = 0; i < 3; i++) {
        char source[600];
        snprintf(source, sizeof source,
                 NESTED
                 "shader float main(float2 x) { float h = q; %s [Disc] return x.y < h + 0.1 * x.x ? 1.0 : 0.0; }",
                 reads[i]);
        SltOptions o = SLT_OPTIONS_INIT;
        o.f64 = true;
        SltProgram *p = NULL;
        if (slt_compile_string(source, "seam", &o, &p) != SLT_OK) fail_msg("%s", slt_diagnostics_text(p));
        SltJob job = SLT_JOB_INIT;
        job.integral = true, job.estimator = SLT_EST_QUADRATURE, job.error = 1e-6, job.max_evaluations = 300000;
        double g[4];
        SltIntegral out = {.struct_size = sizeof out, .gradient = g};
        SltStats stats = SLT_STATS_INIT;
        SltError err = {0};
        if (slt_grad_integral(p, &job, &out, &stats, &err) != SLT_OK) fail_msg("%s", err.text);
        if (!(stats.left > 0)) fail_msg("%d: nothing is left", i);
        slt_program_free(p);
    }
}

/* A box and a ball's intersection, drilled along the axes (examples/csg): a face is a ring; of the ball there is what
 * six caps leave; two drills meet where max(|sin|, |cos|) of the angle says. */
static void drilled(void **state) {
    (void)state;
    const double want[3] = {4 * PI * 0.5625 - 6 * CAP(0.75, 0.15), 6 * PI * (0.2025 - 0.09),
                            -3 * (2 * PI * 0.3 * 1.2 - 16 * 0.09 * sqrt(0.5))};
    SltOptions o = SLT_OPTIONS_INIT;
    o.f64 = true, o.stdlib_dir = SALTUS_STDLIB_BUILD;
    SltProgram *p = NULL;
    if (slt_compile_file(SALTUS_TEST_DIR "/../examples/csg/csg.salt", &o, &p) != SLT_OK)
        fail_msg("%s", slt_diagnostics_text(p));
    SltJob job = SLT_JOB_INIT;
    job.integral = true, job.estimator = SLT_EST_QUADRATURE, job.error = 1e-4, job.threads = 2;
    job.max_evaluations = 1 << 24;
    double g[3];
    SltIntegral out = {.struct_size = sizeof out, .gradient = g};
    SltStats stats = SLT_STATS_INIT;
    SltError err = {0};
    if (slt_grad_integral(p, &job, &out, &stats, &err) != SLT_OK) fail_msg("%s", err.text);
    for (int i = 0; i < 3; i++)
        if (!(fabs(g[i] - want[i]) <= 4e-4)) fail_msg("%d: %.12g, exact %.12g", i, g[i], want[i]);
    if (!(stats.certified >= 0.999)) fail_msg("certified: %g", stats.certified);
    slt_program_free(p);
}

int main(void) {
    enum { N = sizeof nested / sizeof *nested, M = sizeof solids / sizeof *solids };
    struct CMUnitTest tests[N + M + 2];
    for (int i = 0; i < N + M; i++) {
        const Nested *c = i < N ? &nested[i] : &solids[i - N];
        tests[i] = (struct CMUnitTest){c->name, exact, NULL, NULL, (void *)c};
    }
    tests[N + M] = (struct CMUnitTest)cmocka_unit_test(by_a_seam);
    tests[N + M + 1] = (struct CMUnitTest)cmocka_unit_test(drilled);
    return _cmocka_run_group_tests("given", tests, N + M + 2, NULL, NULL);
}
