/* What region and sides say their rays met spares event the search, and changes nothing of its answers. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "bindings/c/api.h"
#include "saltus/heightfield.h"

enum { N = 2048, SIDE = 32, NOUT = 8 };

static const char source[] =
    "[Extent(-1.0, -1.0, 1.0, 1.0)] param heightfield h = zeros(32, 32);\n"
    "[Domain(-1.0, 1.0)]\n"
    "shader float main(float2 x) {\n"
    "    float3 o = float3(x.x, -2.0, 1.0), d = float3(0.0, 1.0, 0.3 * x.y - 0.4), sun = float3(0.7, 0.4, 0.3);\n"
    "    [Disc] Hit v = h.trace(o, d, 0.0, 50.0);\n"
    "    if (!v.hit) return 0.1;\n"
    "    float3 p = float3(v.p, o.z + v.t * d.z) + 0.001 * v.normal;\n"
    "    float l = 1.0;\n"
    "    [Disc] if (h.occluded(p, sun, 0.003, 50.0)) l = 0.0;\n"
    "    return l;\n"
    "}\n";

static uint64_t searched;
static SltQueryFn *real[SLT_QUERIES];
static void count_trace(const SltGeometry *f, const void *h, const void *rays, uint64_t mask, uint32_t width,
                        int32_t *id) {
    searched += (uint64_t)__builtin_popcountll(mask);
    real[SLT_QUERY_TRACE](f, h, rays, mask, width, id);
}
static void count_occluded(const SltGeometry *f, const void *h, const void *rays, uint64_t mask, uint32_t width,
                           int32_t *id) {
    searched += (uint64_t)__builtin_popcountll(mask);
    real[SLT_QUERY_OCCLUDED](f, h, rays, mask, width, id);
}

typedef struct Io {
    float *in[SLT_IN_VARYING], *out[NOUT];
    SltKernelArgs args;
} Io;

static void io_make(Io *io, const SltProgram *p) {
    memset(io, 0, sizeof *io);
    for (int i = 0; i < SLT_IN_VARYING; i++) {
        io->args.in[i] = io->in[i] = aligned_alloc(64, N * sizeof(float));
        memset(io->in[i], 0, N * sizeof(float));
    }
    for (int i = 0; i < NOUT; i++) {
        io->args.out[i] = io->out[i] = aligned_alloc(64, N * sizeof(float));
        memset(io->out[i], 0, N * sizeof(float));
    }
    io->args.params = p->flt, io->args.iparams = p->ints, io->args.geometries = p->geometries, io->args.n_valid = N;
    for (int i = 0; i < N; i++) { /* pairs of neighbours */
        io->in[IN_X0][i] = (float)((i / 2 % 64 + 0.37) / 32 - 1 + i % 2 * 0.05);
        io->in[IN_X1][i] = (float)((i / 2 / 64 + 0.21) / 8 - 1 + i % 2 * 0.07);
    }
}

static void io_free(Io *io) {
    for (int i = 0; i < SLT_IN_VARYING; i++) free(io->in[i]);
    for (int i = 0; i < NOUT; i++) free(io->out[i]);
}

static void event_does_not_search_again(void **state) {
    (void)state;
    SltOptions o = SLT_OPTIONS_INIT;
    o.no_cache = true;
    SltProgram *p = NULL;
    SltError err = {0};
    assert_int_equal(slt_compile_string(source, "witness", &o, &p), SLT_OK);
    double height[SIDE * SIDE];
    for (int j = 0; j < SIDE; j++)
        for (int i = 0; i < SIDE; i++)
            height[j * SIDE + i] = 0.2 * sin(0.9 * i) * cos(0.7 * j) + 0.1 * sin(2.3 * i + j);
    SltParam h = SLT_PARAM_INIT;
    slt_param_find(p, "h", &h, NULL);
    slt_set_floats(p, h.fbase, SIDE * SIDE, height, NULL);
    bool needs[K_KINDS] = {[K_REGION] = true, [K_EVENT] = true, [K_SIDES] = true};
    assert_int_equal(api_kernels(p, needs, &err), SLT_OK);
    assert_int_equal(api_geometries(p, &err), SLT_OK);
    assert_int_equal(scene_outputs(&p->scene, SLT_K_REGION, SLT_OUT_WITNESS), 2);
    assert_int_equal(scene_outputs(&p->scene, SLT_K_REGION, SLT_OUT_DEPTH), 1);

    Io region, sides, alone, told;
    io_make(&region, p), io_make(&sides, p), io_make(&alone, p), io_make(&told, p);
    p->scene.kernel[SLT_K_REGION](&region.args, N);
    p->scene.kernel[SLT_K_SIDES](&sides.args, N);
    uint32_t at = p->scene.layout[SLT_K_REGION].out[SLT_OUT_WITNESS].first, met = 0,
             same = p->scene.layout[SLT_K_SIDES].out[SLT_OUT_WITNESS].first;
    for (uint32_t k = 0; k < 2; k++) {
        const int32_t *w = (const int32_t *)region.out[at + k];
        assert_memory_equal(w, sides.out[same + k], N * sizeof *w);
        memcpy(told.in[IN_WITNESS0 + k], w, N * sizeof *w);
        for (int i = 0; i < N; i++) met += w[i] > 7; /* 8 + a triangle */
    }
    assert_true(met > N / 2);

    /* The field's own pointers, with a count in front. */
    SltGeometry counted = *p->geometries[0];
    memcpy(real, counted.query, sizeof real);
    counted.query[SLT_QUERY_TRACE] = count_trace, counted.query[SLT_QUERY_OCCLUDED] = count_occluded;
    const SltGeometry *fields[1] = {&counted};
    alone.args.geometries = told.args.geometries = fields;
    p->scene.kernel[SLT_K_EVENT](&alone.args, N);
    assert_true(searched > N);
    searched = 0;
    p->scene.kernel[SLT_K_EVENT](&told.args, N);
    /* Where a ray hits nothing there is no second search at the vertex: event asks, for the pair's sake, and only
     * there. */
    uint64_t unknown = 0;
    for (int i = 0; i < N; i++) unknown += ((const int32_t *)told.in[IN_WITNESS1])[i] == 0;
    assert_true(searched <= unknown);
    uint32_t events = 0;
    for (int i = 0; i < N; i++)
        events += ((const int32_t *)alone.out[p->scene.layout[SLT_K_EVENT].out[SLT_OUT_SITE].first])[i] >= 0;
    assert_true(events > N / 16);
    for (uint32_t k = 0; k < p->fn[K_EVENT]->body->last->nargs; k++)
        assert_memory_equal(alone.out[k], told.out[k], N * sizeof(float));
    io_free(&region), io_free(&sides), io_free(&alone), io_free(&told);
    slt_program_free(p);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(event_does_not_search_again)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
