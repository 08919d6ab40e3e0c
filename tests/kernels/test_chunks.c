/* Straight-line programs in chunks: random expressions of min, max, select and shared values. Bounds play no part here:
 * what a choice may be in a tile is what it was at 64 points of it, noted by a point kernel. Leaving out all that then
 * does not matter must give the same bits at those points, at every width, on every target, in both precisions and in
 * the interpreter. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "bindings/c/api.h"
#include "compiler/pass/variant.h"
#include "runtime/sample/prune.h"

enum { POINTS = 64, TILES = 24, TEXT = 1 << 18 };

static uint64_t state;
static uint32_t below(uint32_t n) {
    state = state * 6364136223846793005ull + 1442695040888963407ull;
    return (uint32_t)(state >> 33) % n;
}
static double uniform(void) { return (below(1u << 30) + 0.5) * 0x1p-30; }

/* `ops` operations, most on recent values; `middle`: a loop and a branch stand between two stretches of them. */
static char *program(uint32_t seed, uint32_t ops, bool middle) {
    state = seed;
    char *text = malloc(TEXT), *t = text;
    t += sprintf(t, "param float scale = 1.25;\nparam float2 shift = float2(0.1, -0.2);\n[Domain(-2.0, 2.0)]\n"
                    "shader float2 main(float2 p) {\n  float2 q = p * scale + shift;\n"
                    "  float v0 = q.x; float v1 = q.y; float v2 = q.x * q.y; float v3 = length(q) - 1.0;\n");
    for (uint32_t k = 4; k < ops + 4; k++) {
        uint32_t a = below(3) ? k - 1 - below(k < 12 ? k : 12) : below(k),
                 b = below(2) ? k - 1 - below(k < 40 ? k : 40) : below(k);
        double c = 4 * uniform() - 2;
        t += sprintf(t, "  float v%u = ", k);
        switch (below(12)) {
        case 0: t += sprintf(t, "v%u + %.6f;\n", a, c); break;
        case 1: t += sprintf(t, "0.5 * (v%u + v%u);\n", a, b); break;
        case 2: t += sprintf(t, "v%u - v%u;\n", a, b); break;
        case 3: t += sprintf(t, "clamp(v%u, -4.0, 4.0) * %.6f;\n", a, c); break;
        case 4: t += sprintf(t, "abs(v%u) - %.6f;\n", a, c); break;
        case 5: t += sprintf(t, "sqrt(abs(v%u));\n", a); break;
        case 6: t += sprintf(t, "select(v%u < v%u, v%u, v%u);\n", a, b, below(k), below(k)); break;
        case 7: t += sprintf(t, "min(v%u, q.%c * %.6f + %.6f);\n", a, "xy"[below(2)], c, uniform()); break;
        case 8:
        case 9: t += sprintf(t, "min(v%u, v%u);\n", a, b); break;
        default: t += sprintf(t, "max(v%u, v%u);\n", a, b); break;
        }
        if (middle && k == ops / 2)
            t += sprintf(t,
                         "  float w = 0.0;\n  for (int i = 0; i < 9; i++) w = 0.5 * w + min(v%u, float(i) * v%u);\n"
                         "  if (w < v%u) w = v%u;\n  v%u = w;\n",
                         k - 1, k, k - 2, k - 3, k);
    }
    t += sprintf(t, "  float c = v%u;\n", ops + 3);
    for (uint32_t k = 5; k < ops; k += 6) t += sprintf(t, "  c = %s(c, v%u);\n", k % 4 ? "max" : "min", k);
    sprintf(t, "  float d = c;\n  [Disc] if (v%u < 0.3) d = v%u;\n  return float2(c, d);\n}\n", ops + 2, ops - 5);
    return text;
}

typedef struct Noting { /* the point kernel that notes what its choices are */
    SltProgram *p;
    Fn *fn;
    CompiledModule *module;
    int status;
} Noting;

static void make_noting(Session *s, void *user) {
    Noting *n = user;
    const SltChunks *table;
    n->fn = variant_chunks(&n->p->passes, n->p->prog->primal, &table);
    variant_drop_sites(n->fn);
    pipeline_kernel(&n->p->passes, n->fn);
    KernelRequest r = {"noting", n->fn};
    BackOptions o = {.target = n->p->target, .width = n->p->opt.width, .no_cache = true, .opt_level = 2};
    const char *why = NULL;
    n->status = back_compile(s, &r, 1, &o, &n->module, &why);
}

typedef struct Arrays {
    unsigned char *memory;
    SltKernelArgs args;
    size_t each;
} Arrays;

static Arrays arrays(const SltProgram *p) {
    Arrays a = {.each = p->opt.f64 ? 8 : 4};
    size_t slot = (POINTS + SLT_PAD) * 8;
    a.memory = aligned_alloc(64, slot * 5);
    memset(a.memory, 0, slot * 5);
    for (uint32_t k = 0; k < 2; k++) {
        a.args.in[IN_X0 + k] = a.memory + k * slot;
        a.args.out[k] = a.memory + (2 + k) * slot;
    }
    a.args.params = p->flt, a.args.iparams = p->ints, a.args.n_valid = POINTS;
    return a;
}

static void set_x(Arrays *a, uint32_t axis, uint32_t i, double v) {
    if (a->each == 8) ((double *)a->args.in[IN_X0 + axis])[i] = v;
    else ((float *)a->args.in[IN_X0 + axis])[i] = (float)v;
}

static void points_in(Arrays *a, const double lo[2], double side) {
    for (uint32_t i = 0; i < POINTS; i++)
        for (uint32_t d = 0; d < 2; d++) set_x(a, d, i, lo[d] + side * uniform());
}

static void same_outputs(const Arrays *a, unsigned char *const want[2], const char *what, uint32_t tile) {
    for (uint32_t c = 0; c < 2; c++)
        if (memcmp(a->args.out[c], want[c], POINTS * a->each))
            fail_msg("%s: channel %u of tile %u is another than that of the whole program", what, c, tile);
}

/* Bits of 64 points become those of two boxes, the first 32 and the others. */
static void two_boxes(uint64_t *bits, uint32_t n) {
    for (uint32_t k = 0; k < n; k++)
        bits[k] = (uint64_t)((bits[k] & UINT32_MAX) != 0) | (uint64_t)(bits[k] >> 32 != 0) << 1;
}

static uint32_t length(const PruneLevel *s) {
    uint32_t n = 0;
    while (s->chunks[n] != SLT_NO_CHUNK) n++;
    return n;
}

typedef struct Seen {
    uint64_t run, all; /* chunks, summed over tiles */
} Seen;

static void one_tile(SltProgram *p, Noting *noting, Pruner *pr, Arrays *a, uint32_t tile, Seen *seen) {
    const char *what = p->opt.f64 ? "f64" : "f32";
    const SltChunks *c = p->scene.chunks;
    size_t bytes = 2 * (size_t)c->nchoices * sizeof *pr->level[0].choices;
    double side = exp2(-(double)below(12)), lo[2] = {4 * uniform() - 2, 4 * uniform() - 2};
    points_in(a, lo, side);
    unsigned char *want[2] = {malloc(POINTS * 8), malloc(POINTS * 8)};
    uint64_t *noted = malloc(bytes);
    a->args.pruned = &pr->level[0].pruned, a->args.choices = noted;
    memset(noted, 0xa5, bytes);
    assert_int_equal(ir_interpret(noting->fn, &a->args, POINTS, 16), SLT_OK);
    for (uint32_t k = 0; k < 2; k++) memcpy(want[k], a->args.out[k], POINTS * a->each);
    a->args.choices = pr->level[0].choices;
    memset(pr->level[0].choices, 0x5a, bytes);
    back_kernel(noting->module, "noting")(&a->args, POINTS);
    same_outputs(a, want, what, tile);
    if (memcmp(noted, pr->level[0].choices, bytes)) fail_msg("%s: interpreter and kernel note other choices", what);
    a->args.choices = NULL;
    p->scene.kernel[K_PRUNED](&a->args, POINTS);
    same_outputs(a, want, what, tile);
    a->args.pruned = NULL;
    p->scene.kernel[K_VALUE](&a->args, POINTS);
    same_outputs(a, want, what, tile);

    /* The whole tile, then its halves inside it. */
    for (uint32_t k = 0; k < 2 * c->nchoices; k++) pr->level[0].choices[k] = noted[k] != 0;
    prune_walk(pr, 0, 1);
    prune_pick(pr, 0, 0);
    memcpy(pr->level[1].choices, noted, bytes), two_boxes(pr->level[1].choices, 2 * c->nchoices);
    prune_walk(pr, 1, 3);
    uint32_t whole = length(&pr->level[1]);
    seen->run += whole, seen->all += c->nchunks;
    SltKernelArgs nowhere = a->args; /* NaN in all that the kernel leaves behind it */
    _Alignas(64) float nan32[POINTS + SLT_PAD];
    _Alignas(64) double nan64[POINTS + SLT_PAD];
    for (uint32_t i = 0; i < POINTS + SLT_PAD; i++) nan32[i] = NAN, nan64[i] = NAN;
    for (uint32_t d = 0; d < 2; d++) nowhere.in[IN_X0 + d] = p->opt.f64 ? (void *)nan64 : (void *)nan32;
    for (uint32_t half = 0; half < 3; half++) {
        const PruneLevel *set = &pr->level[half == 2 ? 1 : 2];
        if (half < 2) prune_pick(pr, 1, half);
        assert_true(length(set) <= whole);
        nowhere.pruned = &pr->level[0].pruned;
        p->scene.kernel[K_PRUNED](&nowhere, POINTS);
        a->args.pruned = &set->pruned;
        p->scene.kernel[K_PRUNED](&a->args, POINTS);
        a->args.pruned = NULL;
        uint32_t from = half == 1 ? 32 : 0, to = half == 0 ? 32 : POINTS;
        for (uint32_t k = 0; k < 2; k++)
            if (memcmp((char *)a->args.out[k] + from * a->each, want[k] + from * a->each, (to - from) * a->each))
                fail_msg("%s width %u %s: channel %u of half %u of tile %u is another when pruned", what, p->opt.width,
                         p->opt.target ? p->opt.target : "native", k, half, tile);
        a->args.pruned = &set->pruned;
        if (tile < 4) {
            assert_int_equal(ir_interpret(p->fn[K_PRUNED], &a->args, POINTS, 16), SLT_OK);
            for (uint32_t k = 0; k < 2; k++)
                if (memcmp((char *)a->args.out[k] + from * a->each, want[k] + from * a->each, (to - from) * a->each))
                    fail_msg("%s: interpreted, channel %u of half %u of tile %u is another", what, k, half, tile);
        }
        a->args.pruned = NULL;
    }
    free(want[0]), free(want[1]), free(noted);
}

static void one_program(uint32_t seed, bool middle, bool f64, uint32_t width, const char *target) {
    char *text = program(seed, 1050, middle);
    SltOptions o = SLT_OPTIONS_INIT;
    o.f64 = f64, o.width = width, o.no_cache = true, o.target = target, o.verify = width == 1;
    SltProgram *p = NULL;
    if (slt_compile_string(text, "random.salt", &o, &p) != SLT_OK)
        fail_msg("%s\n%s", slt_last_error(p), slt_diagnostics_text(p));
    SltError err = {0};
    bool needs[K_KINDS] = {[K_VALUE] = true, [K_PRUNE] = true, [K_PRUNED] = true};
    if (api_kernels(p, needs, &err) != SLT_OK) fail_msg("%s", err.text);
    assert_non_null(p->scene.chunks);
    assert_true(p->scene.chunks->nchoices >= 64);
    Noting noting = {.p = p};
    assert_int_equal(session_protect(p->session, make_noting, &noting), 0);
    assert_int_equal(noting.status, SLT_OK);
    Pruner pr;
    assert_true(prune_init(&pr, p->scene.chunks));
    Arrays a = arrays(p);
    Seen seen = {0};
    for (uint32_t tile = 0; tile < TILES; tile++) one_tile(p, &noting, &pr, &a, tile, &seen);
    assert_true(seen.run < seen.all); /* else nothing was shown */
    free(a.memory);
    prune_free(&pr);
    back_free(noting.module);
    slt_program_free(p);
    free(text);
}

static void random_programs(void **unused) {
    (void)unused;
    one_program(1, false, false, 1, NULL);
    one_program(2, true, true, 2, "sse2");
    one_program(3, true, false, 4, "sse2");
    one_program(4, false, false, 8, "avx2");
    one_program(5, true, true, 4, "avx2");
    one_program(6, true, true, 16, NULL);
    one_program(7, false, false, 32, NULL);
}

/* A union of discs and boxes, some cut out again: most of it matters nowhere. */
static char *shapes(uint32_t dim, uint32_t n) {
    static const char *const kinds[] = {"float p", "float2 p", "float3 p"};
    char *text = malloc(TEXT), *t = text;
    state = 17 * dim;
    t += sprintf(
        t, "param float size = 1.0;\n[Domain(-1.0, 1.0)]\nshader float2 main(%s) {\n  float d = 9.0;\n  float e;\n",
        kinds[dim - 1]);
    for (uint32_t k = 0; k < n; k++) {
        t += sprintf(t, "  e = %s(", below(2) ? "length" : "max");
        double at[3] = {2 * uniform() - 1, 2 * uniform() - 1, 2 * uniform() - 1}, r = 0.02 + 0.1 * uniform();
        if (text[strlen(text) - 2] == 'h') {
            if (dim == 1) t += sprintf(t, "float2(p - %.4f, 0.01)) - size * %.4f;\n", at[0], r);
            if (dim == 2) t += sprintf(t, "p - float2(%.4f, %.4f)) - size * %.4f;\n", at[0], at[1], r);
            if (dim == 3) t += sprintf(t, "p - float3(%.4f, %.4f, %.4f)) - size * %.4f;\n", at[0], at[1], at[2], r);
        } else {
            const char *x = dim == 1 ? "p" : "p.x", *y = dim == 1 ? "p" : "p.y";
            t += sprintf(t, "abs(%s - %.4f), abs(%s - %.4f)) - size * %.4f;\n", x, at[0], y, at[dim > 1], r);
        }
        t += sprintf(t, k % 7 == 6 ? "  d = max(d, -e);\n" : "  d = min(d, e);\n");
    }
    sprintf(t,
            "  float c = 0.25;\n  [Disc] if (d < 0.0) c = 1.0;\n  return float2(c, clamp(d * 60.0, -0.5, 0.5));\n}\n");
    return text;
}

/* The whole image has the same bits whether it is pruned or not. spp 0: centred. */
static void one_image(uint32_t dim, bool f64, uint32_t width, bool interpret, SltFilter filter, uint32_t spp) {
    static const uint32_t sizes[3][3] = {{5003, 1, 1}, {423, 317, 1}, {37, 29, 23}};
    char *text = shapes(dim, dim == 1 ? 230 : 170);
    SltOptions o = SLT_OPTIONS_INIT;
    o.f64 = f64, o.width = width, o.interpret = interpret, o.no_cache = true;
    SltProgram *p = NULL;
    if (slt_compile_string(text, "shapes.salt", &o, &p) != SLT_OK) fail_msg("%s\n%s", text, slt_diagnostics_text(p));
    SltJob job = SLT_JOB_INIT;
    memcpy(job.size, sizes[dim - 1], sizeof job.size);
    if (interpret) job.size[0] /= 8, job.size[1] = (job.size[1] + 7) / 8, job.size[2] = (job.size[2] + 7) / 8;
    job.filter = filter, job.spp = spp, job.centred = !spp, job.threads = 2;
    size_t n = (size_t)job.size[0] * job.size[1] * job.size[2] * 2;
    float *pruned = malloc(n * sizeof *pruned), *whole = malloc(n * sizeof *whole);
    SltStats with = SLT_STATS_INIT, without = SLT_STATS_INIT;
    SltError err = {0};
    if (slt_render(p, &job, pruned, &with, &err) != SLT_OK) fail_msg("%s", err.text);
    assert_non_null(p->scene.chunks);
    p->scene.chunks = NULL;
    assert_int_equal(slt_render(p, &job, whole, &without, &err), SLT_OK);
    if (memcmp(pruned, whole, n * sizeof *whole)) fail_msg("%uD: the pruned image is another", dim);
    assert_true(with.samples == without.samples);
    if (dim == 2 && !interpret) assert_true(with.evaluations < without.evaluations);
    free(pruned), free(whole), free(text);
    slt_program_free(p);
}

static void images(void **unused) {
    (void)unused;
    one_image(1, false, 0, false, SLT_FILTER_BOX, 3);
    one_image(2, false, 0, false, SLT_FILTER_BOX, 1);
    one_image(2, true, 0, false, SLT_FILTER_GAUSSIAN, 3);
    one_image(2, false, 1, false, SLT_FILTER_TENT, 2);
    one_image(3, false, 0, false, SLT_FILTER_BOX, 3);
    one_image(2, false, 0, false, SLT_FILTER_GAUSSIAN, 0);
    one_image(3, true, 0, false, SLT_FILTER_BOX, 0);
    one_image(2, false, 0, true, SLT_FILTER_BOX, 1);
}

/* 8-bit pixels too. */
static void squares(void **unused) {
    (void)unused;
    char *text = shapes(2, 170);
    SltOptions o = SLT_OPTIONS_INIT;
    o.rgba8 = true, o.no_cache = true;
    SltProgram *p = NULL;
    assert_int_equal(slt_compile_string(text, "shapes.salt", &o, &p), SLT_OK);
    SltJob job = SLT_JOB_INIT;
    job.size[0] = 301, job.size[1] = 223, job.threads = 2;
    size_t n = (size_t)job.size[0] * job.size[1];
    uint32_t *pruned = malloc(n * sizeof *pruned), *whole = malloc(n * sizeof *whole);
    SltError err = {0};
    if (slt_render_rgba8(p, &job, pruned, NULL, &err) != SLT_OK) fail_msg("%s", err.text);
    assert_non_null(p->scene.chunks);
    p->scene.chunks = NULL;
    assert_int_equal(slt_render_rgba8(p, &job, whole, NULL, &err), SLT_OK);
    assert_memory_equal(pruned, whole, n * sizeof *whole);
    free(pruned), free(whole), free(text);
    slt_program_free(p);
}

/* Below the threshold nothing changes. */
static void small_programs(void **unused) {
    (void)unused;
    char *text = program(5, 300, false);
    SltOptions o = SLT_OPTIONS_INIT;
    o.no_cache = true;
    SltProgram *p = NULL;
    assert_int_equal(slt_compile_string(text, "small.salt", &o, &p), SLT_OK);
    SltError err = {0};
    bool needs[K_KINDS] = {[K_VALUE] = true, [K_PRUNE] = true, [K_PRUNED] = true};
    assert_int_equal(api_kernels(p, needs, &err), SLT_OK);
    assert_null(p->scene.chunks);
    slt_program_free(p);
    free(text);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(random_programs), cmocka_unit_test(images),
                                       cmocka_unit_test(squares), cmocka_unit_test(small_programs)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
