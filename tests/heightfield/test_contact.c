/* The evaluation of a peak (`peak` in compiler/front/gen/heightfield.c) against the search that names it
 * (`search_event` and `leaf_test` in runtime/geometry/heightfield/leaf.h): the same bits. A walk from silhouette to
 * silhouette asks above the slope that the evaluation gave; were it one ulp lower, the same silhouette would be found
 * again. Compared without the instruction that contracts a multiplication and an addition into one rounding, and but
 * for rays along the far borders, which the search takes one ulp inside (`ray_setup`). */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "bindings/c/api.h"
#include "saltus/heightfield.h"

#define LANES 1
#define F64 0
#include "runtime/geometry/heightfield/simd.h"
#include "runtime/geometry/heightfield/leaf.h"
#include "contact_walk.inc.h"
#undef F64
#define F64 1
#include "runtime/geometry/heightfield/simd.h"
#include "runtime/geometry/heightfield/leaf.h"
#include "contact_walk.inc.h"
#undef flt

enum { W = 9, H = 7, RAYS = 20000 };

/* A cell of the grid is 1 x 1 and heights are as stored, so that the ray reaches the search as it is written. */
static const char source[] = "[Extent(0.0, 0.0, 8.0, 6.0)] param heightfield h = zeros(9, 7);\n"
                             "param float3 o = float3(0.0);\n"
                             "param float2 d = float2(1.0, 0.0);\n"
                             "param float2 k = float2(0.0);\n"
                             "shader float3 main(float2 x) {\n"
                             "    Silhouette s = h.silhouette(o, d, k.x, k.y);\n"
                             "    return float3(s.found ? 1.0 : 0.0, s.t, s.slope);\n"
                             "}\n";

static uint32_t state;
static double uniform(void) {
    state = state * 747796405u + 2891336453u;
    uint32_t v = ((state >> ((state >> 28) + 4)) ^ state) * 277803737u;
    return ((v >> 22) ^ v) * 0x1p-32;
}

static bool along_far_border(const double ray[8]) {
    return (ray[3] == 0 && ray[0] == W - 1) || (ray[4] == 0 && ray[1] == H - 1);
}

/* Origins and directions that meet corners, borders and diagonals, beside any others. */
static void some_ray(double ray[8]) {
    static const double d[8][2] = {{1, 0}, {0, 1}, {-1, 0}, {0, -1}, {1, 1}, {1, -1}, {-1, 2}, {3, 1}};
    uint32_t how = (uint32_t)(uniform() * 4), to = (uint32_t)(uniform() * 8);
    ray[0] = uniform() * (W + 3) - 2, ray[1] = uniform() * (H + 3) - 2, ray[2] = uniform() * 2 - 1;
    ray[3] = uniform() * 2 - 1, ray[4] = uniform() * 2 - 1, ray[5] = 0;
    if (how & 1) ray[0] = floor(ray[0]), ray[1] = floor(ray[1]);
    if (how & 2) ray[3] = d[to][0], ray[4] = d[to][1];
    if (along_far_border(ray)) ray[0] -= 0.25, ray[1] -= 0.25;
    ray[6] = -1e30, ray[7] = 1e30;
}

static void compare(bool f64) {
    SltOptions o = SLT_OPTIONS_INIT;
    SltProgram *p = NULL;
    o.no_cache = true, o.f64 = f64, o.target = "sse2"; /* which has no instruction to contract into */
    SltError err = {0};
    assert_int_equal(slt_compile_string(source, "contact", &o, &p), SLT_OK);
    uint32_t n = p->prog->nfloats, base = p->prog->params[0].fbase, at = p->prog->params[1].fbase, found = 0;
    double *values = calloc(n, sizeof *values);
    assert_non_null(values);
    state = 1;
    for (uint32_t i = 0; i < W * H; i++) values[base + i] = i % 5 ? uniform() : 0.5; /* some of equal height */
    assert_int_equal(slt_set_floats(p, 0, n, values, NULL), SLT_OK);
    api_geometries_want(p, p->prog->primal);
    assert_int_equal(api_geometries(p, &err), SLT_OK);

    enum { N = 64 };
    static _Alignas(64) double in[N], out[3][N];
    SltKernelArgs args = {.params = p->flt, .iparams = p->ints, .n_valid = 1, .geometries = p->geometries};
    for (int s = 0; s < SLT_IN_VARYING; s++) args.in[s] = in;
    for (int c = 0; c < 3; c++) args.out[c] = out[c];
    for (uint32_t r = 0; r < RAYS; r++) {
        double ray[8];
        some_ray(ray);
        for (uint32_t asked = 0; asked < W + H; asked++) { /* from one silhouette to the next */
            float ray32[8];
            for (int i = 0; i < 8; i++) ray32[i] = (float)ray[i];
            for (int i = 0; i < 7; i++) { /* the parameters o, d, k */
                double v = ray[i < 5 ? i : i + 1];
                if (f64) ((double *)p->flt)[at + (uint32_t)i] = v;
                else ((float *)p->flt)[at + (uint32_t)i] = (float)v;
            }
            assert_int_equal(ir_interpret(p->prog->primal, &args, 1, 2), SLT_OK);
            double t, slope;
            float t32, slope32;
            float got32[3];
            for (int c = 0; c < 3; c++) memcpy(&got32[c], out[c], sizeof got32[c]);
            bool is = f64 ? contact_walk_f64x1((const double *)p->flt + base, W, H, ray, &t, &slope)
                          : contact_walk_f32x1((const float *)p->flt + base, W, H, ray32, &t32, &slope32);
            assert_int_equal(is, f64 ? out[0][0] == 1 : got32[0] == 1);
            if (!is) break;
            if (f64) assert_memory_equal(&t, out[1], sizeof t), assert_memory_equal(&slope, out[2], sizeof slope);
            else assert_true(t32 == got32[1]), assert_true(slope32 == got32[2]);
            ray[6] = f64 ? slope : (double)slope32;
            found++;
        }
    }
    assert_true(found > RAYS / 2);
    free(values);
    slt_program_free(p);
}

static void bits_agree(void **unused) {
    (void)unused;
    compare(false);
    compare(true);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(bits_agree)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
