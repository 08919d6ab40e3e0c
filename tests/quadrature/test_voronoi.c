/* The mosaic of the nearest seed, all derivatives against polygons that are clipped exactly: a running minimum bends
 * the g of every event behind it, and three curves meet in every corner. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "saltus/saltus.h"

enum { SEEDS = 900, CORNERS = 64, BORDER = -1 };

typedef struct Seed {
    double at[2], ink[3];
} Seed;

static double next_number(uint64_t *state) {
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (double)(*state >> 11) * 0x1p-53;
}

/* ---- the reference */
typedef struct Polygon {
    uint32_t n;
    double x[CORNERS][2];
    int beyond[CORNERS]; /* of the side from corner i: the seed on its other side, or BORDER */
} Polygon;

/* What of p is nearer to a than to seed j at b. */
static void clip(Polygon *p, const double a[2], const double b[2], int j) {
    double nx = b[0] - a[0], ny = b[1] - a[1], c = 0.5 * (nx * (a[0] + b[0]) + ny * (a[1] + b[1]));
    Polygon q = {.n = 0};
    for (uint32_t i = 0; i < p->n; i++) {
        const double *u = p->x[i], *v = p->x[(i + 1) % p->n];
        double du = nx * u[0] + ny * u[1] - c, dv = nx * v[0] + ny * v[1] - c, t = du / (du - dv);
        double meet[2] = {u[0] + t * (v[0] - u[0]), u[1] + t * (v[1] - u[1])};
        if (du <= 0) memcpy(q.x[q.n], u, sizeof meet), q.beyond[q.n++] = p->beyond[i];
        if ((du <= 0) != (dv <= 0)) memcpy(q.x[q.n], meet, sizeof meet), q.beyond[q.n++] = du <= 0 ? j : p->beyond[i];
        assert_true(q.n + 2 < CORNERS);
    }
    *p = q;
}

/* Derivatives of the integral of one channel: of ink the area; of a seed's place, its half of the sides: the side
 * between a and b moves along a - b by (x - a) . da / |a - b|. */
static void exact(const Seed *s, double *want) {
    memset(want, 0, 5 * SEEDS * sizeof *want);
    for (int i = 0; i < SEEDS; i++) {
        Polygon p = {4, {{0, 0}, {1, 0}, {1, 1}, {0, 1}}, {BORDER, BORDER, BORDER, BORDER}};
        for (int j = 0; j < SEEDS; j++)
            if (j != i) clip(&p, s[i].at, s[j].at, j);
        for (uint32_t k = 0; k < p.n; k++) {
            const double *u = p.x[k], *v = p.x[(k + 1) % p.n];
            int j = p.beyond[k];
            want[5 * i + 2] += 0.5 * (u[0] * v[1] - u[1] * v[0]);
            if (j == BORDER) continue;
            double far = hypot(s[j].at[0] - s[i].at[0], s[j].at[1] - s[i].at[1]),
                   length = hypot(v[0] - u[0], v[1] - u[1]);
            for (int d = 0; d < 2; d++)
                want[5 * i + d] += (s[i].ink[0] - s[j].ink[0]) * length * (0.5 * (u[d] + v[d]) - s[i].at[d]) / far;
        }
    }
}

/* ---- the program */
#define RUN(loop, key, better)                                                                                         \
    "shader float3 main(float2 x) { float best = " key "1e9; float3 c = float3(0.0); " loop                            \
    " float2 v = x - seeds[i].at; float d = " key "dot(v, v); [Disc] if (" better                                      \
    ") { best = d; c = seeds[i].ink; } } return c; }"

/* In a row; in rows, of which each hands on what it has kept; and the other way round: the greatest, the last of
 * equals. */
static const char *const programs[] = {
    RUN("for (int i = 0; i < 900; i++) {", "", "d < best"),
    RUN("for (int j = 0; j < 30; j++) for (int k = 0; k < 30; k++) { int i = 30 * j + k;", "", "d < best"),
    RUN("for (int i = 0; i < 900; i++) {", "-", "!(d < best)"),
};

static char *source_of(const Seed *s, const char *program) {
    char *text = malloc(SEEDS * 160 + 1000), *at = text;
    at += sprintf(at, "struct Seed { float2 at; float3 ink; };\nparam Seed seeds[%d] = {\n", SEEDS);
    for (int i = 0; i < SEEDS; i++)
        at += sprintf(at, "{ float2(%.17g, %.17g), float3(%.17g, %.17g, %.17g) }%s\n", s[i].at[0], s[i].at[1],
                      s[i].ink[0], s[i].ink[1], s[i].ink[2], i + 1 < SEEDS ? "," : "};");
    sprintf(at, "%s", program);
    return text;
}

static void nearest_of_many(void **state) {
    static Seed s[SEEDS];
    static double want[5 * SEEDS], got[3 * 5 * SEEDS];
    uint64_t random = 2011;
    for (int i = 0; i < SEEDS; i++)
        for (int d = 0; d < 5; d++) *(d < 2 ? &s[i].at[d] : &s[i].ink[d - 2]) = next_number(&random);
    char *source = source_of(s, *state);
    SltOptions o = SLT_OPTIONS_INIT;
    o.f64 = true;
    SltProgram *p = NULL;
    if (slt_compile_string(source, "voronoi", &o, &p) != SLT_OK) fail_msg("%s", slt_diagnostics_text(p));
    assert_int_equal(slt_float_count(p), 5 * SEEDS);
    SltJob job = SLT_JOB_INIT;
    job.integral = true, job.estimator = SLT_EST_QUADRATURE, job.error = 1e-6, job.threads = 2;
    SltIntegral out = {.struct_size = sizeof out, .gradient = got};
    SltStats stats = SLT_STATS_INIT;
    SltError err = {0};
    if (slt_grad_integral(p, &job, &out, &stats, &err) != SLT_OK) fail_msg("%s", err.text);
    exact(s, want);
    double off = 0, size = 0;
    for (int i = 0; i < 5 * SEEDS; i++) off += (got[i] - want[i]) * (got[i] - want[i]), size += want[i] * want[i];
    if (getenv("SALTUS_PRINT"))
        printf("    off by %.2g, %llu evaluations, %.3f s\n", sqrt(off / size), (unsigned long long)stats.evaluations,
               stats.seconds);
    if (!(sqrt(off / size) <= 1e-6)) fail_msg("off by %g", sqrt(off / size));
    if (stats.left > 0) fail_msg("left %g", stats.left);
    if (stats.evaluations > 252000) fail_msg("%llu evaluations", (unsigned long long)stats.evaluations);
    slt_program_free(p);
    free(source);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test_prestate(nearest_of_many, (void *)programs[0]),
                                       cmocka_unit_test_prestate(nearest_of_many, (void *)programs[1]),
                                       cmocka_unit_test_prestate(nearest_of_many, (void *)programs[2])};
    return cmocka_run_group_tests_name("voronoi", tests, NULL, NULL);
}
