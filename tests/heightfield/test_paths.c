/* The adjoint of a path: how many bytes it needs, what it searches, and that it is right. Kernels run in the
 * interpreter, lane by lane and together. The oracles: forward mode, differences, and the reverse kernel that stores
 * everything. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "bindings/c/api.h"

enum { SIDE = 17, HEIGHTS = SIDE * SIDE, SAMPLES = 64, MAX_FLOATS = HEIGHTS + 16, FRAME = 48, BUDGET = 4096 };

/* A bowl with steep walls, so that paths stay in it for long. */
#define HEAD                                                                                                            \
    "import pathtrace;\nimport heightfield;\nimport brdf;\n"                                                                        \
    "[Extent(-1.0, -1.0, 1.0, 1.0)] param heightfield h = zeros(17, 17);\n"                                             \
    "param float elevation = 1.1;\nparam float3 albedo = float3(0.8, 0.7, 0.6);\nparam float eye = 2.2;\n"              \
    "const int BOUNCES = 4;\n"                                                                                           \
    "Sun light() {\n"                                                                                                    \
    "    Sun s = { float3(cos(elevation) * 0.6, cos(elevation) * 0.8, sin(elevation)), float3(3.0, 2.5, 2.0), 0.05 };\n" \
    "    return s;\n}\n"                                                                                                 \
    "[Domain(-0.4, 0.4)]\nshader float3 main(float2 x) {\n"                                                              \
    "    float3 o = float3(x, eye), d = normalize(float3(0.2 * x.y, 0.3 * x.x, -1.0)), sky = float3(0.3, 0.5, 0.9);\n"

static const char *const path =
    HEAD "    return path_radiance(h, albedo, light(), float3(0.8), sky, o, d, BOUNCES);\n}\n";

/* Without a break: a path that has ended does nothing. */
static const char *const guarded = HEAD
    "    float3 sum = float3(0.0), weight = float3(1.0);\n    bool alive = true;\n"
    "    for (int i = 0; i < BOUNCES; i++) {\n"
    "        [NoDisc] if (alive) {\n"
    "            Ground g = ground(h, o, d);\n"
    "            [NoDisc] if (g.hit) {\n"
    "                sum += weight * reflected(h, albedo, g.p, g.n, sun_light(light(), rand2()), 0.1);\n"
    "                weight *= albedo;\n                o = g.p;\n                d = cosine_sample(g.n, rand2());\n"
    "            } else {\n                sum += weight * sky_gradient(float3(0.8), sky, d);\n                alive = false;\n"
    "            }\n        }\n    }\n    return sum;\n}\n";

/* A loop over lights in each bounce, an array, nested ifs that disagree from lane to lane. */
static const char *const lights =
    HEAD "    float3 sum = float3(0.0), weight = float3(1.0);\n"
         "    for (int i = 0; i < BOUNCES; i++) {\n"
         "        Ground g = ground(h, o, d);\n"
         "        [NoDisc] if (!g.hit) break;\n"
         "        float dim[4];\n        for (int k = 0; k < 4; k++) dim[k] = 1.0 / (1.0 + float(k) + g.p.z * g.p.z);\n"
         "        for (int k = 0; k < 20; k++) {\n"
         "            Light l = sun_light(light(), rand2());\n"
         "            float s = lit(h, g.p, l, 0.0) * max(dot(g.n, l.to), 0.0) * dim[k % 4];\n"
         "            [NoDisc] if (s > 0.3) s = 0.3 + 0.5 * (s - 0.3);\n"
         "            sum += 0.1 * s * weight;\n        }\n"
         "        weight *= albedo;\n        o = g.p;\n"
         "        [NoDisc] if (g.n.x > 0.1) d = cosine_sample(g.n, rand2());\n"
         "        else d = normalize(d - 1.9 * dot(d, g.n) * g.n + float3(0.0, 0.0, 0.05));\n"
         "    }\n    return sum;\n}\n";

/* By slices: an inner loop looks for silhouettes. */
static const char *const slices =
    HEAD "    AreaLight l = area_sun(light().to, float3(3.0), 0.05);\n    Ride first = { d, 1.0 };\n"
         "    return slice_radiance(h, albedo, l, float3(0.8), sky, o, first, 1e-4, 0.1, BOUNCES);\n}\n";

static double height(int i, int j) {
    double x = 2.0 * i / (SIDE - 1) - 1, y = 2.0 * j / (SIDE - 1) - 1, r = fmax(fabs(x), fabs(y)),
           t = fmin(fmax((r - 0.5) / 0.3, 0), 1);
    return 1.8 * t * t * (3 - 2 * t) + 0.05 * sin(7 * x + 1) * cos(5 * y);
}

/* width 0: interpreted. */
static SltProgram *load(const char *source, int bounces, bool f64, uint32_t width) {
    char number[16];
    snprintf(number, sizeof number, "%d", bounces);
    SltSet set = {"BOUNCES", number};
    SltOptions o = SLT_OPTIONS_INIT;
    o.stdlib_dir = SALTUS_STDLIB_BUILD, o.f64 = f64, o.interpret = !width, o.width = width, o.set = &set, o.nset = 1;
    SltProgram *p = NULL;
    SltError err = {0};
    if (slt_compile_string(source, "path.salt", &o, &p) != SLT_OK) fail_msg("%s", slt_diagnostics_text(p));
    double v[HEIGHTS];
    for (int k = 0; k < HEIGHTS; k++) v[k] = height(k % SIDE, k / SIDE);
    SltParam q = SLT_PARAM_INIT;
    assert_int_equal(slt_param_find(p, "h", &q, &err), SLT_OK);
    assert_int_equal(slt_set_floats(p, q.fbase, HEIGHTS, v, &err), SLT_OK);
    assert_true(slt_float_count(p) <= MAX_FLOATS);
    return p;
}

static SltProgram *program(const char *source, int bounces, bool f64, const bool needs[K_KINDS]) {
    SltProgram *p = load(source, bounces, f64, 0);
    SltError err = {0};
    assert_int_equal(api_kernels(p, needs, &err), SLT_OK);
    assert_int_equal(api_geometries(p, &err), SLT_OK);
    return p;
}

typedef struct Run {
    double x[2][SAMPLES], seed[3][SAMPLES], rand0[SAMPLES], params[MAX_FLOATS], dparams[MAX_FLOATS], adj[MAX_FLOATS],
        out[8][SAMPLES];
    int32_t stream[SAMPLES];
} Run;

static double uniform(uint64_t *state) {
    *state = *state * 6364136223846793005ull + 1442695040888963407ull;
    return (double)(*state >> 11) * 0x1p-53;
}

static Run *new_run(const SltProgram *p) {
    Run *r = calloc(1, sizeof *r);
    uint64_t state = 5;
    for (int i = 0; i < SAMPLES; i++) {
        for (int d = 0; d < 2; d++) r->x[d][i] = 0.8 * uniform(&state) - 0.4;
        for (int c = 0; c < 3; c++) r->seed[c][i] = 2 * uniform(&state) - 1;
        r->rand0[i] = uniform(&state), r->stream[i] = 11 * i + 3;
    }
    for (uint32_t k = 0; k < slt_float_count(p); k++)
        r->params[k] = ((const double *)p->flt)[k], r->dparams[k] = 2 * uniform(&state) - 1;
    return r;
}

static void run(SltProgram *p, const Fn *fn, Run *r, uint32_t first, uint32_t n, uint32_t lanes) {
    SltKernelArgs a = {0};
    for (int d = 0; d < 2; d++) a.in[IN_X0 + d] = r->x[d] + first;
    for (int c = 0; c < 3; c++) a.in[IN_SEED0 + c] = r->seed[c] + first;
    a.in[IN_RAND0] = r->rand0 + first, a.in[IN_STREAM] = r->stream + first;
    for (int o = 0; o < 8; o++) a.out[o] = r->out[o] + first;
    a.params = r->params, a.dparams = r->dparams, a.adj = r->adj, a.iparams = p->ints, a.geometries = p->geometries,
    a.n_valid = n;
    assert_int_equal(ir_interpret(fn, &a, n, lanes), SLT_OK);
}

static uint32_t searches(const Block *b, bool in_sweep) {
    uint32_t n = 0;
    for (const Inst *i = b->first; i; i = i->next) {
        n += in_sweep && i->op == OP_query;
        for (uint32_t r = 0; r < i->nregions; r++) n += searches(i->region[r], in_sweep || i->op == OP_revloop);
    }
    return n;
}

/* ---- bytes */

static const bool reverse[K_KINDS] = {[K_VALUE] = true, [K_VJP] = true, [K_SITE_VJP] = true};

/* Up to 64 bounces a path keeps 48 bytes for each; beyond, the state of some is kept and the others are run again:
 * never more than 4 KiB. */
static void test_bytes(void **state) {
    (void)state;
    static const int bounces[] = {1, 2, 4, 8, 16, 32, 64, 84, 100, 1000, 100000, 10000000};
    for (uint32_t k = 0; k < sizeof bounces / sizeof *bounces; k++) {
        SltProgram *p = program(path, bounces[k], false, reverse);
        uint64_t bytes = p->tape[K_VJP].bytes_per_lane, all = (uint64_t)FRAME * ((uint64_t)bounces[k] + 2);
        print_message("%d bounces: %llu bytes, of the sites %llu\n", bounces[k], (unsigned long long)bytes,
                      (unsigned long long)p->tape[K_SITE_VJP].bytes_per_lane);
        if (all <= BUDGET) {
            assert_int_equal(bytes, all);
            assert_non_null(
                strstr(p->tape[K_VJP].text, "each iteration replayed from its frame: one frame of 48 bytes"));
            assert_non_null(strstr(p->tape[K_VJP].text, "9 x carried value"));
            assert_non_null(strstr(p->tape[K_VJP].text, "2 x witness"));
            assert_int_equal(searches(p->fn[K_VJP]->body, false), 0); /* reverse mode never searches */
        } else {
            assert_true(bytes <= BUDGET);
            assert_non_null(strstr(p->tape[K_VJP].text, "checkpointed in"));
        }
        assert_true(p->tape[K_SITE_VJP].bytes_per_lane <= BUDGET);
        slt_program_free(p);
    }
}

/* Other ways to write a path. The bound holds for each; an inner loop that asks and is differentiated has frames
 * of its own. */
static void test_other_paths(void **state) {
    (void)state;
    const char *const sources[] = {guarded, lights, slices};
    const uint32_t frame[] = {52, 60, 88}; /* guarded: a counter of random numbers that stands still at the end */
    for (int s = 0; s < 3; s++)
        for (int bounces = 2; bounces <= 2048; bounces *= 32) {
            SltProgram *p = program(sources[s], bounces, false, reverse);
            uint64_t bytes = p->tape[K_VJP].bytes_per_lane;
            print_message("%s, %d bounces: %llu bytes\n",
                          s == 0   ? "guarded"
                          : s == 1 ? "lights"
                                   : "slices",
                          bounces, (unsigned long long)bytes);
            assert_true(bytes <= BUDGET);
            if (bounces == 2) {
                char text[32];
                snprintf(text, sizeof text, "frame of %u bytes", frame[s]);
                assert_non_null(strstr(p->tape[K_VJP].text, text));
            }
            slt_program_free(p);
        }
}

/* The small bound is for paths: a long loop of arithmetic beside one stores up to 64 KiB, as it is faster. */
static void test_beside_a_path(void **state) {
    (void)state;
    static const char *const source = HEAD
        "    float t = 0.0;\n"
        "    for (int k = 0; k < 800; k++) {\n        t = t + sin(t * elevation + x.x) * exp(-t * t);\n        if (t > 3.0) break;\n    }\n"
        "    return t * path_radiance(h, albedo, light(), float3(0.8), sky, o, d, BOUNCES);\n}\n";
    for (int bounces = 8; bounces <= 200; bounces += 192) {
        SltProgram *p = program(source, bounces, false, reverse);
        const TapeReport *tape = &p->tape[K_VJP];
        assert_true(tape->bytes_per_lane > 2 * BUDGET);
        assert_true(bounces == 8 ? !strstr(tape->text, "checkpointed")
                                 : strstr(tape->text, "checkpointed in 1 level") != NULL);
        slt_program_free(p);
    }
}

/* ---- the same gradient, replayed or stored, in one run or in many */

static void test_replayed_is_stored(void **state) {
    (void)state;
    const char *const sources[] = {path, guarded, lights, slices};
    static const uint32_t budgets[] = {1u << 30, 400, 120, 1};
    for (int s = 0; s < 4; s++) {
        SltProgram *p = program(sources[s], 6, true, (bool[K_KINDS]){[K_VALUE] = true, [K_VJP] = true});
        uint32_t n = slt_float_count(p);
        Fn *value = variant_value(&p->passes, p->prog->primal);
        Fn *stored = ad_vjp(&p->passes, value, &(AdOptions){.tape_budget = 1u << 30, .replay = AD_REPLAY_NEVER}, NULL);
        pipeline_kernel(&p->passes, stored);
        Run *want = new_run(p);
        run(p, stored, want, 0, SAMPLES, 1);
        double size = 0;
        for (uint32_t k = 0; k < n; k++) size = fmax(size, fabs(want->adj[k]));
        assert_true(size > 0.1);
        uint64_t least = UINT64_MAX;
        for (uint32_t b = 0; b < sizeof budgets / sizeof *budgets; b++) {
            TapeReport tape;
            Fn *fn = ad_vjp(&p->passes, value, &(AdOptions){.tape_budget = budgets[b]}, &tape);
            pipeline_kernel(&p->passes, fn);
            assert_true(tape.bytes_per_lane <= least);
            least = tape.bytes_per_lane;
            for (uint32_t lanes = 1; lanes <= 64; lanes *= 8) {
                Run *got = new_run(p);
                run(p, fn, got, 0, SAMPLES, lanes);
                assert_memory_equal(got->out[0], want->out[0], 3 * sizeof *got->out);
                for (uint32_t k = 0; k < n; k++)
                    if (!(fabs(got->adj[k] - want->adj[k]) <= 1e-11 * size))
                        fail_msg("program %d, budget %u, %u lanes, parameter %u: %.17g, stored %.17g", s, budgets[b],
                                 lanes, k, got->adj[k], want->adj[k]);
                free(got);
            }
        }
        free(want);
        slt_program_free(p);
    }
}

/* ---- <w, Jv> = <J'w, v>, and both are the slope of the samples. A sample whose ray meets another triangle within the
 * step has no slope to compare with: few have. */
static void test_oracles(void **state) {
    (void)state;
    const char *const sources[] = {path, guarded, lights};
    for (int s = 0; s < 3; s++) {
        SltProgram *p = program(sources[s], s == 2 ? 3 : 6, true,
                                (bool[K_KINDS]){[K_VALUE] = true, [K_JVP] = true, [K_VJP] = true});
        uint32_t n = slt_float_count(p), odd = 0, indirect = 0;
        const double step = 1e-7;
        for (uint32_t lane = 0; lane < SAMPLES; lane++) {
            Run *f = new_run(p), *r = new_run(p), *at[2] = {new_run(p), new_run(p)};
            run(p, p->fn[K_JVP], f, lane, 1, 1);
            run(p, p->fn[K_VJP], r, lane, 1, 1);
            double forward = 0, back = 0, slope = 0, scale = 0;
            for (int e = 0; e < 2; e++) {
                for (uint32_t k = 0; k < n; k++) at[e]->params[k] += (e ? step : -step) * at[e]->dparams[k];
                run(p, p->fn[K_VALUE], at[e], lane, 1, 1);
            }
            for (int c = 0; c < 3; c++) {
                forward += f->seed[c][lane] * f->out[3 + c][lane];
                slope += f->seed[c][lane] * (at[1]->out[c][lane] - at[0]->out[c][lane]) / (2 * step);
            }
            uint32_t heights = 0;
            for (uint32_t k = 0; k < n; k++) {
                back += r->adj[k] * r->dparams[k], scale += fabs(r->adj[k] * r->dparams[k]);
                heights += k < HEIGHTS && r->adj[k] != 0;
            }
            if (!(fabs(forward - back) <= 1e-10 * (1 + scale)))
                fail_msg("program %d, lane %u: %.17g forward, %.17g back", s, lane, forward, back);
            odd += !(fabs(slope - back) <= 1e-4 * (1 + scale));
            indirect += heights > 12; /* a normal is of 12 heights at most: this path went on */
            for (int e = 0; e < 2; e++) free(at[e]);
            free(f), free(r);
        }
        print_message("program %d: %u of %d samples have no slope, %u are indirect\n", s, odd, SAMPLES, indirect);
        assert_true(odd <= 3);
        assert_true(indirect > SAMPLES / 8);
        slt_program_free(p);
    }
}

/* Compiled, at several widths, with one level of checkpoints and without: the interpreter's gradient. */
static void test_widths(void **state) {
    (void)state;
    for (int bounces = 4; bounces <= 100; bounces += 96) {
        double want[MAX_FLOATS * 3] = {0}, got[MAX_FLOATS * 3], size = 0;
        for (uint32_t width = 0; width <= 16; width = width ? 4 * width : 4) {
            SltProgram *p = load(path, bounces, true, width);
            uint32_t n = 3 * slt_float_count(p);
            SltJob job = SLT_JOB_INIT;
            SltError err = {0};
            job.integral = true, job.samples = 256, job.threads = 1, job.no_boundary = true;
            SltIntegral out = {.struct_size = sizeof out, .gradient = width ? got : want};
            if (slt_grad_integral(p, &job, &out, NULL, &err) != SLT_OK) fail_msg("%s", err.text);
            for (uint32_t k = 0; k < n && !width; k++) size = fmax(size, fabs(want[k]));
            for (uint32_t k = 0; k < n && width; k++)
                if (!(fabs(got[k] - want[k]) <= 1e-10 * size))
                    fail_msg("width %u, component %u: %.17g, interpreter %.17g", width, k, got[k], want[k]);
            slt_program_free(p);
        }
        assert_true(size > 0.1);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_bytes),         cmocka_unit_test(test_other_paths),
                                       cmocka_unit_test(test_beside_a_path), cmocka_unit_test(test_replayed_is_stored),
                                       cmocka_unit_test(test_oracles),       cmocka_unit_test(test_widths)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
