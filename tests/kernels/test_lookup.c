/* Noise by rows of pixels: what hangs on a column's cell alone is looked up where cells are few, and computed where
 * they are not; every pixel is what one lane at a time gives, whatever the integers: far apart, falling, 2^31 and
 * beyond, NaN. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "bindings/c/api.h"

enum { WIDTH = 300, HEIGHT = 3, SIZE = WIDTH * HEIGHT };

#define HASH                                                                                                           \
    "param float d[3] = { 8.0, -3.7, 2.1 };\n"                                                                         \
    "uint hash(int i, int j) { uint h = uint(i) * 374761393u + uint(j) * 668265263u;\n"                                \
    "    h = (h ^ (h >> 13)) * 1274126177u; return h ^ (h >> 16); }\n"                                                 \
    "float3 bytes(uint h) { return float3(float(int(h & 255u)), float(int(h >> 8 & 255u)), float(int(h >> 16 & "       \
    "255u))) / 255.0; }\n"                                                                                             \
    "float g(int i, int j, float x, float y) { uint h = hash(i, j);\n"                                                 \
    "    return (float(int(h & 0xffffu)) / 32768.0 - 1.0) * x + (float(int(h >> 16)) / 32768.0 - 1.0) * y; }\n"        \
    "float noise(float x, float y) { float a = floor(x), b = floor(y); int i = int(a), j = int(b);\n"                  \
    "    float u = x - a, v = y - b;\n"                                                                                \
    "    return lerp(lerp(g(i, j, u, v), g(i + 1, j, u - 1.0, v), u * u), lerp(g(i, j + 1, u, v - 1.0), "                 \
    "g(i + 1, j + 1, u - 1.0, v - 1.0), u * u), v * v); }\n"
#define SHADER(body)                                                                                                   \
    HASH "[Display] [NoDisc] shader float3 main(float2 p) {\n"                                                         \
         "    float x = p.x * d[0] + d[1], y = p.y * d[0] + d[2];\n" body "}\n"

static const char *const source[] = {
    /* every bit of the integer shows */
    SHADER("    int i = int(floor(x)), j = int(floor(y));\n"
           "    return bytes(hash(i, j) ^ hash(i + 1, j) * 5u ^ hash(i, j + 1) * 9u ^ hash(i + 7, j) ^ uint(i) ^\n"
           "                 (x < y ? 85u : 0u));\n"),
    /* octaves in a loop, as noise is */
    SHADER("    float s = 0.5, amp = 0.5;\n"
           "    for (int o = 0; o < 4; o++) { s += amp * noise(x, y); x = x * 2.0 + 17.3; y = y * 2.0 - 9.1;\n"
           "        amp *= 0.5; }\n"
           "    return float3(s, frac(64.0 * s), frac(4096.0 * s));\n"),
    /* two lattices in one run, and one whose cell another moves */
    SHADER("    float a = noise(x, y), b = noise(3.0 * x + 0.5, y), c = noise(x + a, y);\n"
           "    return float3(0.5 + 0.5 * a, frac(64.0 * b), frac(64.0 * c));\n")};

static const float scale[][2] = {
    {8, -3.7f},    {-8, 3.7f},    {0, 0.25f},      {0.5f, 0.4f},       {40, 100},           {300, -150},
    {-300, 150},   {4000, 0},     {5e9f, -2.5e9f}, {2e3f, 2147483e3f}, {2e3f, -2147484e3f}, {1e30f, -5e29f},
    {INFINITY, 0}, {1, INFINITY}, {1, -INFINITY},  {1, NAN},           {16, 0x7fffff},      {1000, 2147482624.f}};
enum { SCALES = sizeof scale / sizeof *scale };

static SltProgram *compile(const char *text, const char *target, uint32_t width) {
    SltOptions o = SLT_OPTIONS_INIT;
    SltProgram *p;
    o.rgba8 = o.no_cache = true, o.stdlib_dir = SALTUS_STDLIB_BUILD, o.target = target, o.width = width;
    if (slt_compile_string(text, "lookup", &o, &p) == SLT_OK) return p;
    slt_program_free(p);
    return NULL; /* not on this processor */
}

static void render(SltProgram *p, const float *at, uint32_t *pixels) {
    SltJob job = SLT_JOB_INIT;
    SltError err = {0};
    job.size[0] = WIDTH, job.size[1] = HEIGHT, job.threads = 1;
    const double d[3] = {at[0], at[1], 2.1};
    assert_int_equal(slt_set_floats(p, 0, 3, d, &err), SLT_OK);
    if (slt_render_rgba8(p, &job, pixels, NULL, &err) != SLT_OK) fail_msg("%s", err.text);
}

static void same_pixels(void **state) {
    (void)state;
    static const struct {
        const char *target;
        uint32_t width;
    } way[] = {{"avx512", 0}, {"avx512", 32}, {"avx512", 64}, {"avx2", 0}, {"avx2", 16}, {"avx2", 64}, {"avx2", 8}};
    static uint32_t want[SCALES][SIZE], got[SIZE];
    uint32_t ways = 0;
    for (size_t s = 0; s < sizeof source / sizeof *source; s++) {
        SltProgram *one = compile(source[s], "avx2", 1); /* with fma, as the others */
        if (!one) break;
        for (uint32_t k = 0; k < SCALES; k++) render(one, scale[k], want[k]);
        slt_program_free(one);
        for (size_t w = 0; w < sizeof way / sizeof *way; w++) {
            SltProgram *p = compile(source[s], way[w].target, way[w].width);
            if (!p) continue;
            for (uint32_t k = 0; k < SCALES; k++) {
                render(p, scale[k], got);
                for (uint32_t i = 0; i < SIZE; i++)
                    if (got[i] != want[k][i])
                        fail_msg("source %zu, %s/%u, scale %g %+g: pixel %u is %08x, not %08x", s, way[w].target,
                                 way[w].width, (double)scale[k][0], (double)scale[k][1], i, got[i], want[k][i]);
            }
            slt_program_free(p), ways++;
        }
    }
    if (!ways) skip();
}

/* A register's worth of cells is hashed once, and permuted. */
static void permutes(void **state) {
    (void)state;
    for (size_t s = 0; s < sizeof source / sizeof *source; s++) {
        SltProgram *p = compile(source[s], "sse2", 0);
        static uint32_t pixels[SIZE];
        assert_non_null(p);
        render(p, scale[0], pixels); /* makes the kernel's IR */
        static const char *const target[] = {"avx512", "avx2", "sse2"};
        for (int t = 0; t < 3; t++) {
            KernelRequest k = {"value", p->fn[K_VALUE]};
            BackOptions o = {.width = 64, .opt_level = 2, .pixels = BACK_PIXELS_RAW};
            const char *why = "";
            unsigned char *bytes;
            size_t size;
            assert_true(target_named(&o.target, target[t]));
            back_share_row(k.fn, &o.target, o.width);
            assert_int_equal(back_emit(k.fn->session, &k, 1, &o, 's', &bytes, &size, &why), 0);
            const bool found = memmem(bytes, size, "\tvpermd\t", 8) || memmem(bytes, size, "\tvpermps\t", 9);
            if (found != (t < 2)) fail_msg("source %zu for %s", s, target[t]);
            free(bytes);
        }
        slt_program_free(p);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(same_pixels), cmocka_unit_test(permutes)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
