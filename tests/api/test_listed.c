/* Images of loops with lists, tile by tile (bindings/c/listed.h): every bit is what it is without lists, whatever
 * the image's shape, the precision and the threads; where lists save nothing there are none after the first image. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bindings/c/listed.h"

#define DISCS "param float d[200] = init(disc); float disc(int i) { return frac(float(i) * 0.618 + 0.37); }\n"

static const char *const painter =
    DISCS "[NoDisc] shader float3 main(float2 x) { float3 c = float3(0.0); float t = 1.0;\n"
          "for (int i = 0; i < 50; i++) { int q = i * 4; float2 e = x - float2(d[q], d[q + 1]);\n"
          "float s = dot(e, e); if (s < 0.01 * d[q + 2]) { float a = 0.2 + 0.7 * d[q + 3] * (1.0 - 9.0 * s);\n"
          "c += t * a * float3(d[q], d[q + 2], d[q + 3]); t *= 1.0 - a; if (t < 0.05) break; } } return c + t; }";
static const char *const opaque = DISCS
    "shader float3 main(float2 x) { float3 c = float3(0.9);\n"
    "for (int i = 0; i < 50; i++) { int q = i * 4; [Disc] if (distance(x, float2(d[q], d[q + 1])) < 0.2 * d[q + 2])\n"
    "c = float3(d[q], d[q + 2], d[q + 3]); } return c; }";
static const char *const nearest =
    DISCS "[NoDisc] shader float main(float2 x) { float best = 9.0, c = 0.0;\n"
          "for (int i = 0; i < 100; i++) { float2 e = x - float2(d[2 * i], d[2 * i + 1]); float s = dot(e, e);\n"
          "if (s < best) { best = s; c = d[i]; } } return c; }";
static const char *const cull =
    DISCS "float4 extent(int i) { float2 p = float2(d[2 * i], d[2 * i + 1]); return float4(p - 0.1, p + 0.1); }\n"
          "shader float main(float2 x) { float f = 0.1;\n"
          "[Cull(extent)] for (int i = 0; i < 100; i++) { float2 e = x - float2(d[2 * i], d[2 * i + 1]);\n"
          "[Disc] if (dot(e, e) < 0.01) f = d[i]; } return f; }";
static const char *const all_of_them =
    DISCS "[NoDisc] shader float main(float2 x) { float f = 0.0;\n"
          "for (int i = 0; i < 50; i++) { if (x.x + d[i] > -1.0) f += d[i] * 0.03; } return f * x.y; }";

/* Rays that are reflected, each of which looks for what it meets; decides: before what is hit. */
#define BOUNCES(decides)                                                                                               \
    DISCS "[NoDisc] shader float3 main(float2 x) { float3 o = float3(0.5, 0.5, -2.0), sum = float3(0.0);\n"            \
          "float3 r = normalize(float3(x - 0.5, 1.0)); float w = 1.0;\n"                                               \
          "for (int bounce = 0; bounce < 3; bounce++) { float t = 1e9, light = 1.0; float3 n = float3(0.0, 1.0, 0.0);\n" \
          "if (r.y < 0.0) t = -o.y / r.y;\n"                                                                           \
          "for (int i = 0; i < 40; i++) { int q = i * 4; float3 v = o - float3(d[q], d[q + 1], d[q + 2]);\n"           \
          "float b = dot(v, r), e = b * b - dot(v, v) + 0.02 * d[q + 3]; " decides "if (e > 0.0) {\n"                  \
          "float u = -b - sqrt(e); if (u > 1e-3 && u < t) { t = u; n = normalize(v + u * r); light = d[q]; } } }\n"    \
          "if (t > 1e8) { sum += w * (0.5 + 0.5 * r); break; } o += t * r;\n"                                          \
          "for (int i = 0; i < 40; i++) { int q = i * 4; float3 v = o - float3(d[q], d[q + 1], d[q + 2]);\n"           \
          "float b = v.y; if (b < 0.0 && b * b > dot(v, v) - 0.02 * d[q + 3]) { light = 0.0; break; } }\n"             \
          "sum += w * light * n; w *= 0.7; r -= 2.0 * dot(r, n) * n; o += 1e-3 * n; } return sum; }"
static const char *const bounces = BOUNCES(""), *const sharp_bounces = BOUNCES("[Disc] ");
enum { BOUNCES_LISTS = 3 * 2 };

static SltProgram *compile(const char *source, bool f64) {
    SltOptions o = SLT_OPTIONS_INIT;
    SltProgram *p = NULL;
    o.rgba8 = true, o.f64 = f64, o.no_cache = true;
    if (slt_compile_string(source, "listed.salt", &o, &p) != SLT_OK) fail_msg("%s", slt_diagnostics_text(p));
    return p;
}

static void shade(SltProgram *p, uint32_t width, uint32_t height, uint32_t threads, uint32_t *pixels) {
    SltJob job = SLT_JOB_INIT;
    SltError err = {0};
    job.size[0] = width, job.size[1] = height, job.threads = threads;
    if (slt_render_rgba8(p, &job, pixels, NULL, &err) != SLT_OK) fail_msg("%s", err.text);
}

static const double at_once = 1e300, never = -1e300; /* SltProgram.list_work */

static void one_program(const char *source, bool f64) {
    static const uint32_t shape[][2] = {{304, 200}, {8, 8}, {264, 131}, {1032, 24}, {301, 200}, {128, 1}};
    SltProgram *with = compile(source, f64), *without = compile(source, f64);
    for (size_t i = 0; i < sizeof shape / sizeof *shape; i++) {
        const uint32_t *n = shape[i];
        const size_t size = (size_t)n[0] * n[1];
        uint32_t *x = calloc(size, sizeof *x), *y = calloc(size, sizeof *y);
        without->list_work = never, with->list_work = at_once;
        shade(without, n[0], n[1], 1, x);
        shade(with, n[0], n[1], i % 2 ? 3 : 1, y);
        assert_int_equal(with->lists, LISTS_USED);
        assert_int_equal(without->lists, LISTS_UNASKED);
        if (memcmp(x, y, size * sizeof *x)) fail_msg("%u x %u: other pixels\n%s", n[0], n[1], source);
        free(x), free(y);
    }
    slt_program_free(with), slt_program_free(without);
}

static void same_bits(void **state) {
    (void)state;
    const char *const source[] = {painter, opaque, nearest, cull};
    for (size_t i = 0; i < sizeof source / sizeof *source; i++) one_program(source[i], i % 2);
    one_program(painter, true), one_program(nearest, true);
    one_program(bounces, false), one_program(bounces, true), one_program(sharp_bounces, false);
}

/* Each bounce of a ray has lists of its own: the first, all of whose rays leave one eye, the shortest. */
static void lists_of_bounces(void **state) {
    (void)state;
    enum { SIDE = 256 };
    SltProgram *p = compile(bounces, false);
    SltJob job = SLT_JOB_INIT;
    Listed l = {0};
    uint32_t *x = calloc(SIDE * SIDE, sizeof *x), n = 0, kept[BOUNCES_LISTS] = {0};
    p->list_work = at_once;
    shade(p, SIDE, SIDE, 1, x);
    assert_int_equal(p->lists, LISTS_USED);
    assert_int_equal(p->nlists, BOUNCES_LISTS);
    job.size[0] = job.size[1] = SIDE;
    assert_true(listed_serves(p, &job) && listed_init(&l, p, &job));
    for (uint32_t tile = 0; tile < 4; tile++) {
        const PixelPart all = {.first = {tile % 2 * LISTED_TILE, tile / 2 * LISTED_TILE},
                               .n = {LISTED_TILE, LISTED_TILE}};
        PixelPart part[LISTED_PARTS];
        const uint32_t parts = listed_tile(&l, p, &job, &all, part);
        for (uint32_t i = 0; i < parts; i++, n++) {
            const SltCullList *list = listed_part(&l, i);
            for (uint32_t k = 0; k < BOUNCES_LISTS; k++) kept[k] += (uint32_t)list[k].count;
        }
    }
    assert_true(n && kept[0] < 10 * n && kept[0] < kept[2] && kept[0] < kept[4]);
    listed_free(&l), free(x);
    slt_program_free(p);
}

/* In a loop of few iterations even four of an inner one are worth a list. */
static void lists_of_few(void **state) {
    (void)state;
    char text[4000];
    snprintf(text, sizeof text, "%s", bounces);
    for (char *at = text; (at = strstr(at, "i < 40")); at++) memcpy(at, "i < 4 ", 6);
    SltProgram *p = compile(text, false);
    uint32_t *x = calloc(160 * 160, sizeof *x);
    p->list_work = at_once;
    shade(p, 160, 160, 1, x);
    assert_int_equal(p->lists, LISTS_USED);
    assert_int_equal(p->nlists, BOUNCES_LISTS);
    free(x);
    slt_program_free(p);
    one_program(text, false);
}

/* Terms that follow the position in many ways, compared in a loop: what bounds leave out changes no pixel. */
static uint32_t random_state;
static uint32_t pick(uint32_t n) {
    random_state = random_state * 1664525u + 1013904223u;
    return (random_state >> 8) % n;
}

static void term(char *to, size_t size, uint32_t depth) {
    static const char *const leaf[] = {"x.x", "x.y", "x.x", "x.y", "d[4 * i]", "d[4 * i + 1]", "0.7"};
    char a[2000] = "", b[2000] = "";
    if (!depth) {
        snprintf(to, size, "%s", leaf[pick(7)]);
        return;
    }
    term(a, sizeof a, depth - 1 - pick(depth));
    term(b, sizeof b, depth - 1 - pick(depth));
    switch (pick(8)) {
    case 0: snprintf(to, size, "(%.900s + %.900s)", a, b); break;
    case 1: snprintf(to, size, "(%.900s - %.900s)", a, b); break;
    case 2:
    case 3: snprintf(to, size, "(%.900s * %.900s)", a, b); break;
    case 4: snprintf(to, size, "square(%.900s - d[4 * i + 2])", a); break;
    case 5: snprintf(to, size, "(%.900s / (%.900s + 1.3))", a, b); break;
    case 6: snprintf(to, size, "(%.900s / %.900s)", a, b); break;
    default: snprintf(to, size, "sqrt(%.900s * %.900s + 0.1)", a, a); break;
    }
}

static void random_terms(void **state) {
    (void)state;
    enum { SIDE = 160, PROGRAMS = 60, LEAN_TERM = 7000 };
    uint32_t *x = calloc(SIDE * SIDE, sizeof *x), *y = calloc(SIDE * SIDE, sizeof *y), used = 0;
    for (uint32_t n = 0; n < PROGRAMS; n++) {
        static char t[3][2000], text[LEAN_TERM + 1000];
        random_state = 977 * n + 5;
        for (int k = 0; k < 3; k++) term(t[k], sizeof t[k], 4);
        snprintf(text, sizeof text,
                 DISCS "float square(float v) { return v * v; }\n[NoDisc] shader float3 main(float2 p) {\n"
                       "float3 c = float3(0.0); float2 x = p * %d.0 - %d.0; for (int i = 0; i < 24; i++) {\n"
                       "float u = %.2000s, v = %.2000s; if (u * u - v < d[4 * i + 3] - 0.8)\n"
                       "{ c = float3(d[i], d[i + 1], frac(v)); if (v * %.2000s > 0.3) c.x = 0.5; } } return c; }",
                 n % 3 ? 1 << pick(4) : 1000, n % 3 ? (int)pick(3) : 500, t[0], t[1], t[2]);
        SltProgram *with = compile(text, n % 2), *without = compile(text, n % 2);
        without->list_work = never, with->list_work = at_once;
        shade(without, SIDE, SIDE, 1, x), shade(with, SIDE, SIDE, 1, y);
        used += with->lists == LISTS_USED;
        if (memcmp(x, y, SIDE * SIDE * sizeof *x)) fail_msg("program %u: other pixels\n%s", n, text);
        slt_program_free(with), slt_program_free(without);
    }
    assert_true(used > PROGRAMS / 4);
    free(x), free(y);
}

/* Samples of pixels, too, strip by strip of a tile (runtime/sample/narrow.h). */
static void samples_of_pixels(void **state) {
    (void)state;
    static const char *const source[] = {painter, opaque, nearest, cull, all_of_them, bounces};
    enum { WIDTH = 101, HEIGHT = 66, MOST = 3 };
    static const uint32_t spp[] = {1, 4, 5};
    for (size_t i = 0; i < sizeof source / sizeof *source; i++) {
        SltOptions o = SLT_OPTIONS_INIT;
        SltProgram *p[2] = {NULL, NULL};
        float *image[2];
        o.f64 = i % 2, o.no_cache = true;
        for (int k = 0; k < 2; k++) {
            if (slt_compile_string(source[i], "listed.salt", &o, &p[k]) != SLT_OK)
                fail_msg("%s", slt_diagnostics_text(p[k]));
            image[k] = calloc((size_t)WIDTH * HEIGHT * MOST, sizeof(float));
        }
        for (size_t n = 0; n < sizeof spp / sizeof *spp; n++) {
            SltJob job = SLT_JOB_INIT;
            SltError err = {0};
            job.size[0] = WIDTH, job.size[1] = HEIGHT, job.spp = spp[n], job.threads = 1 + (uint32_t)n;
            job.filter = n ? SLT_FILTER_BOX : SLT_FILTER_GAUSSIAN;
            for (int k = 0; k < 2; k++) {
                p[k]->list_work = k ? at_once : never;
                if (slt_render(p[k], &job, image[k], NULL, &err) != SLT_OK) fail_msg("%s", err.text);
                assert_int_equal(p[k]->image_bounds != NULL, k);
                assert_null(p[k]->scene.kernel[SLT_K_BOUNDS]); /* no other call sees them */
                assert_false(p[k]->has[K_BOUNDS] || p[k]->nedges);
            }
            assert_memory_equal(image[0], image[1], (size_t)WIDTH * HEIGHT * MOST * sizeof(float));
        }
        for (int k = 0; k < 2; k++) slt_program_free(p[k]), free(image[k]);
    }
}

/* Lists follow the parameters; kernels are made once. */
static void parameters_move(void **state) {
    (void)state;
    enum { SIDE = 160 };
    SltProgram *with = compile(opaque, false), *without = compile(opaque, false);
    uint32_t *x = calloc(SIDE * SIDE, sizeof *x), *y = calloc(SIDE * SIDE, sizeof *y), modules = 0;
    SltError err;
    with->list_work = at_once, without->list_work = never;
    for (int k = 0; k < 3; k++) {
        const double v[4] = {0.3 * k, 0.5, 0.9, 0.1 * k};
        assert_int_equal(slt_set_floats(with, 192, 4, v, &err), SLT_OK);
        assert_int_equal(slt_set_floats(without, 192, 4, v, &err), SLT_OK);
        shade(with, SIDE, SIDE, 2, y), shade(without, SIDE, SIDE, 2, x);
        assert_memory_equal(x, y, SIDE * SIDE * sizeof *x);
        if (k) assert_int_equal(with->nmodules, modules);
        modules = with->nmodules;
    }
    free(x), free(y);
    slt_program_free(with), slt_program_free(without);
}

/* Small images ask for no other kernel; many of them do. Where all iterations matter everywhere, no lists are made
 * again. */
static void only_where_it_pays(void **state) {
    (void)state;
    enum { SIDE = 160 };
    SltProgram *p = compile(all_of_them, false);
    uint32_t *x = calloc(SIDE * SIDE, sizeof *x), *y = calloc(SIDE * SIDE, sizeof *y);
    shade(p, SIDE, SIDE, 1, x);
    assert_int_equal(p->lists, LISTS_UNASKED);
    assert_null(p->scene.kernel[SLT_K_BOUNDS]);
    p->list_work = at_once;
    for (int k = 0; k < 2; k++) {
        shade(p, SIDE, SIDE, 1, y);
        assert_int_equal(p->lists, LISTS_USELESS);
        assert_memory_equal(x, y, SIDE * SIDE * sizeof *x);
    }
    assert_non_null(p->scene.kernel[SLT_K_BOUNDS]);
    free(x), free(y);
    slt_program_free(p);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(same_bits),         cmocka_unit_test(lists_of_bounces),
                                       cmocka_unit_test(lists_of_few),      cmocka_unit_test(random_terms),
                                       cmocka_unit_test(samples_of_pixels), cmocka_unit_test(parameters_move),
                                       cmocka_unit_test(only_where_it_pays)};
    return cmocka_run_group_tests_name("listed", tests, NULL, NULL);
}
