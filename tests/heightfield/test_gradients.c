/* Gradients of terrain scenes, against differences of the integral with common random numbers: bumps, ridges, steps,
 * flat ground, spikes of one texel, borders, the sun at the horizon, the camera at the ground. Every parameter is
 * compared: heights, camera, sun, albedo. The integral has kinks (an edge of the mesh turns from a fold into a ridge),
 * so the gradient must lie between the slopes to the left and to the right. Tolerance: 1 % of the largest component of
 * its kind, or four standard errors of the difference, and what one sample weighs in it. SALTUS_LONG=1 takes 2^20
 * samples for the gradient, the default run fewer. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "saltus/saltus.h"

enum { N = 9, HEIGHTS = N * N, REPLICATES = 8 };
#define STEP 0.003

typedef struct Scene {
    const char *name;
    double (*height)(int i, int j); /* j upwards */
    double eye[3], look[3], fov, sun[3];
    const char *body; /* NULL: the usual one */
} Scene;

/* A pinhole camera over the terrain in [-1, 1]^2, patterned ground, a sun with sharp shadows, a sky of another colour.
 */
static const char *const head =
    "[Extent(-1.0, -1.0, 1.0, 1.0)] param heightfield h = zeros(9, 9);\n"
    "param float3 eye = float3(0.0, -3.0, 1.0);\n"
    "param float3 look = float3(0.0, 1.0, -0.4);\n"
    "param float3 sun = float3(0.5, 0.3, 0.4);\n"
    "param float albedo = 0.8;\n"
    "[NoDiff] param float fov = 0.5;\n"
    "float3 ray(float2 x) {\n"
    "    float3 f = normalize(look), r = normalize(cross(f, float3(0.0, 0.0, 1.0))), u = cross(r, f);\n"
    "    return f + fov * (x.x * r + x.y * u);\n"
    "}\n"
    "[Domain(-1.0, 1.0)]\n";
static const char *const seen = "shader float main(float2 x) {\n"
                                "    float3 d = ray(x);\n"
                                "    [Disc] Hit v = h.trace(eye, d, 0.0, 50.0);\n"
                                "    if (!v.hit) return 0.1 + 0.05 * x.y;\n"
                                "    float3 n = v.normal;\n"
                                "    float3 p = float3(v.p, eye.z + v.t * d.z) + 0.002 * n;\n"
                                "    float c = albedo * (0.6 + 0.4 * sin(4.0 * p.x) * cos(3.0 * p.y));\n"
                                "    float l = max(dot(n, normalize(sun)), 0.0);\n"
                                "    [Disc] if (h.occluded(p, sun, 0.02, 50.0)) l = 0.0;\n"
                                "    return c * (0.2 + l);\n"
                                "}\n";
/* Seen from straight above: shadows alone, by the sign of the clearance. */
static const char *const above = "shader float main(float2 x) {\n"
                                 "    float3 p = float3(x, h.height(x) + 0.01 * eye.z);\n"
                                 "    [Disc] if (h.clearance(p, sun, 0.3, 50.0) < 0.0) return 0.1;\n"
                                 "    return albedo + 0.1 * look.x;\n"
                                 "}\n";

static double bump(int i, int j) {
    double x = (i - 4) / 4.0, y = (j - 4) / 4.0;
    return 0.5 * exp(-4 * (x * x + y * y));
}
static double bumps(int i, int j) {
    return 0.257 * sin(1.3 * i + 0.4) * cos(1.1 * j + 0.2) + 0.02 * ((i * 7 + j * 5) % 4);
}
static double ridge(int i, int j) { return (i == 3 ? 0.4 : i == 6 ? 0.25 : 0) + 0.01 * j; }
static double crests(int i, int j) { return (j == 2 ? 0.2 : j == 5 ? 0.35 : 0) + 0.013 * i; }
static double step(int i, int j) { return (j > 4 ? 0.3 : 0) + 0.01 * i; }
static double flat(int i, int j) { return 0 * i * j; }
static double spike(int i, int j) { return (i == 4 && j == 3 ? 0.5 : 0) + (i == 6 && j == 6 ? 0.2 : 0); }
static double bowl(int i, int j) {
    double x = (i - 4) / 4.0, y = (j - 4) / 4.0;
    return 0.3 * (x * x + y * y);
}

static const Scene scenes[] = {
    {"bump", bump, {0.2, -3, 1.2}, {-0.05, 1, -0.35}, 0.45, {0.7, 0.25, 0.45}, NULL},
    {"bumps", bumps, {0.3, -2.8, 1.6}, {-0.1, 1, -0.5}, 0.45, {-0.6, 0.4, 0.5}, NULL},
    {"ridges along the view", ridge, {0.4, -2.7, 1.1}, {-0.1, 1, -0.35}, 0.45, {0.8, 0.1, 0.45}, NULL},
    {"ridges across the view", crests, {0.1, -2.9, 0.8}, {0.05, 1, -0.22}, 0.45, {0.2, 0.7, 0.35}, NULL},
    {"step", step, {0.2, -2.8, 0.9}, {-0.1, 1, -0.25}, 0.45, {0.3, 0.8, 0.4}, NULL},
    {"flat", flat, {0.2, -2.8, 0.9}, {-0.1, 1, -0.25}, 0.5, {0.3, 0.8, 0.4}, NULL},
    {"spikes", spike, {0.15, -2.8, 1.0}, {-0.03, 1, -0.3}, 0.45, {0.6, 0.5, 0.4}, NULL},
    {"borders", bowl, {0.3, -2.6, 1.2}, {-0.1, 1, -0.4}, 0.6, {0.9, 0.1, 0.35}, NULL},
    {"sun at the horizon", bumps, {0.3, -2.8, 1.6}, {-0.1, 1, -0.5}, 0.45, {0.9, 0.5, 0.03}, NULL},
    {"camera at the ground", bumps, {0.05, -0.93, 0.35}, {0.1, 1, -0.02}, 0.6, {-0.5, 0.6, 0.4}, NULL},
    {"shadow from above, bump", bump, {0, 0, 1}, {0, 1, 0}, 0.5, {0.7, 0.25, 0.25}, "above"},
    {"shadow from above, spikes", spike, {0, 0, 1}, {0, 1, 0}, 0.5, {-0.7, -0.4, 0.3}, "above"},
};

static SltProgram *load(const Scene *s) {
    char source[8192];
    snprintf(source, sizeof source, "%s%s", head, s->body ? above : seen);
    SltOptions o = SLT_OPTIONS_INIT;
    o.f64 = true;
    SltProgram *p = NULL;
    if (slt_compile_string(source, s->name, &o, &p) != SLT_OK)
        fail_msg("%s: %s%s", s->name, slt_diagnostics_text(p), slt_last_error(p));
    double v[HEIGHTS];
    for (int j = 0; j < N; j++)
        for (int i = 0; i < N; i++) v[(N - 1 - j) * N + i] = s->height(i, j);
    SltParam q = SLT_PARAM_INIT;
    slt_param_find(p, "h", &q, NULL);
    slt_set_floats(p, q.fbase, HEIGHTS, v, NULL);
    const struct {
        const char *name;
        const double *v;
        uint32_t n;
    } set[] = {{"eye", s->eye, 3}, {"look", s->look, 3}, {"sun", s->sun, 3}, {"fov", &s->fov, 1}};
    for (int k = 0; k < 4; k++) {
        slt_param_find(p, set[k].name, &q, NULL);
        slt_set_floats(p, q.fbase, set[k].n, set[k].v, NULL);
    }
    return p;
}

static double value(SltProgram *p, uint64_t samples, uint32_t seed) {
    SltJob j = SLT_JOB_INIT;
    j.integral = true, j.samples = samples, j.replicates = 1, j.seed = seed, j.no_interior = j.no_boundary = true;
    double v;
    SltIntegral r = {.struct_size = sizeof r, .value = &v};
    SltError e = {0};
    if (slt_grad_integral(p, &j, &r, NULL, &e) != SLT_OK) fail_msg("%s", e.text);
    return v;
}

/* Slopes to the left and to the right, with common random numbers, and their standard errors over replicates. */
typedef struct Slopes {
    double mean[2], se[2];
} Slopes;

static Slopes slopes(SltProgram *p, uint32_t at, uint64_t samples) {
    double x = slt_floats(p)[at], v[2][REPLICATES];
    Slopes s = {{0}, {0}};
    for (uint32_t r = 0; r < REPLICATES; r++) {
        double at_step[3];
        for (int k = 0; k < 3; k++) {
            double moved = x + (k - 1) * STEP;
            slt_set_floats(p, at, 1, &moved, NULL);
            at_step[k] = value(p, samples, 100 + r);
        }
        for (int side = 0; side < 2; side++) {
            v[side][r] = (at_step[side + 1] - at_step[side]) / STEP;
            s.mean[side] += v[side][r] / REPLICATES;
        }
    }
    slt_set_floats(p, at, 1, &x, NULL);
    for (int side = 0; side < 2; side++) {
        double var = 0;
        for (uint32_t r = 0; r < REPLICATES; r++) var += (v[side][r] - s.mean[side]) * (v[side][r] - s.mean[side]);
        s.se[side] = sqrt(var / (REPLICATES - 1) / REPLICATES);
    }
    return s;
}

static int compare(const Scene *s, bool print) {
    bool thorough = getenv("SALTUS_LONG") != NULL;
    SltProgram *p = load(s);
    uint32_t nf = slt_float_count(p);
    double *g = calloc(nf, sizeof *g), *se = calloc(nf, sizeof *se);
    SltJob j = SLT_JOB_INIT;
    j.integral = true, j.samples = thorough ? 1 << 20 : 1 << 16, j.replicates = 4, j.seed = 7;
    SltIntegral r = {.struct_size = sizeof r, .gradient = g, .gradient_stderr = se};
    SltStats stats = SLT_STATS_INIT;
    SltError e = {0};
    if (slt_grad_integral(p, &j, &r, &stats, &e) != SLT_OK) fail_msg("%s: %s", s->name, e.text);
    int bad = 0;
    for (uint32_t q = 0; q < slt_param_count(p); q++) {
        SltParam param = SLT_PARAM_INIT;
        slt_param(p, q, &param);
        if (!param.differentiable) continue;
        double largest = 0;
        for (uint32_t k = 0; k < param.fcount; k++) largest = fmax(largest, fabs(g[param.fbase + k]));
        uint32_t stride = param.fcount > 8 && !thorough ? 9 : 1;
        for (uint32_t k = 0; k < param.fcount; k += stride) {
            double own = g[param.fbase + k], own_se = se[param.fbase + k];
            uint64_t samples = thorough ? 1 << 16 : 1 << 14;
            Slopes fd = slopes(p, param.fbase + k, samples);
            /* A difference is a multiple of one sample's weight: boundaries that cross few samples are seen in steps of
             * this, and a standard error may miss them. */
            double grain = 4.0 / samples / STEP / REPLICATES, lo = INFINITY, hi = -INFINITY;
            for (int side = 0; side < 2; side++) {
                double tolerance = grain + fmax(0.01 * largest, 4 * sqrt(own_se * own_se + fd.se[side] * fd.se[side]));
                lo = fmin(lo, fd.mean[side] - tolerance), hi = fmax(hi, fd.mean[side] + tolerance);
            }
            if (print)
                printf("  %s[%u]: %g +- %g, slopes %g +- %g, %g +- %g\n", param.name, k, own, own_se, fd.mean[0],
                       fd.se[0], fd.mean[1], fd.se[1]);
            if (!(own >= lo && own <= hi)) {
                print_error("%s: %s[%u]: gradient %g +- %g, slopes %g +- %g, %g +- %g\n", s->name, param.name, k, own,
                            own_se, fd.mean[0], fd.se[0], fd.mean[1], fd.se[1]);
                bad++;
            }
        }
    }
    for (int d = 0; d < SLT_DROP_REASONS; d++)
        if (stats.dropped[d] * 200 > stats.crossings)
            print_error("%s: %llu of %llu crossings dropped: %s\n", s->name, (unsigned long long)stats.dropped[d],
                        (unsigned long long)stats.crossings, slt_drop_names[d]);
    free(g), free(se);
    slt_program_free(p);
    return bad;
}

static void test_scene(void **state) { assert_int_equal(compare(*state, getenv("SALTUS_PRINT") != NULL), 0); }

/* Points below the ground, asked with upright rays from t = 0 on: the volume under the terrain, whose derivative in
 * each height is the integral of its hat function. */
static void test_volume(void **state) {
    (void)state;
    static const char *const source = "param heightfield h = zeros(5, 5);\n"
                                      "shader float main(float3 x) {\n"
                                      "    [Disc] if (h.occluded(x, float3(0.0, 0.0, 1.0), 0.0, 5.0)) return 1.0;\n"
                                      "    return 0.0;\n"
                                      "}\n";
    SltOptions o = SLT_OPTIONS_INIT;
    SltProgram *p = NULL;
    if (slt_compile_string(source, "volume", &o, &p) != SLT_OK) fail_msg("%s", slt_diagnostics_text(p));
    double v[25], g[25], volume;
    for (int i = 0; i < 25; i++) v[i] = 0.3 + 0.03 * (i * 7 % 5);
    slt_set_floats(p, 0, 25, v, NULL);
    SltJob j = SLT_JOB_INIT;
    j.integral = true, j.samples = 1 << 16;
    SltIntegral r = {.struct_size = sizeof r, .value = &volume, .gradient = g};
    SltStats stats = SLT_STATS_INIT;
    assert_int_equal(slt_grad_integral(p, &j, &r, &stats, NULL), SLT_OK);
    double sum = 0;
    for (int i = 0; i < 25; i++) sum += g[i];
    assert_true(fabs(sum - 1) < 0.01);
    assert_true(fabs(g[12] - 1.0 / 16) < 0.01 / 16 * 4); /* two triangles of each of six around it: a cell in all */
    for (int d = 0; d < SLT_DROP_REASONS; d++) assert_true(stats.dropped[d] * 100 < stats.crossings);
    slt_program_free(p);
}

int main(void) {
    enum { SCENES = sizeof scenes / sizeof *scenes };
    struct CMUnitTest tests[SCENES + 1];
    for (int i = 0; i < SCENES; i++)
        tests[i] = (struct CMUnitTest){scenes[i].name, test_scene, NULL, NULL, (void *)&scenes[i]};
    tests[SCENES] = (struct CMUnitTest){"volume", test_volume, NULL, NULL, NULL};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
