/* 8-bit pixels. What hangs on a column's cell alone is looked up where cells are few, and computed where they are not;
 * loops run what matters in parts of the image. Every pixel is what one lane at a time gives, whatever the parameters:
 * far apart, falling, 2^31 and beyond, infinite, NaN. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "bindings/c/listed.h"

enum { WIDTH = 304, HEIGHT = 57, SIZE = WIDTH * HEIGHT }; /* parts of tiles, and of strips */

#define HASH                                                                                                           \
    "param float d[3] = { 8.0, -3.7, 2.1 }; param float q[24] = init(point);\n"                                        \
    "float point(int i) { return frac(float(i) * 0.381966); }\n"                                                       \
    "float4 extent(int i) { return float4(q[i] - 0.2, q[12 + i] - 0.2, q[i] + 0.2, q[12 + i] + 0.2); }\n"              \
    "uint hash(int i, int j) { uint h = uint(i) * 374761393u + uint(j) * 668265263u;\n"                                \
    "    h = (h ^ (h >> 13)) * 1274126177u; return h ^ (h >> 16); }\n"                                                 \
    "float3 bytes(uint h) { return float3(float(int(h & 255u)), float(int(h >> 8 & 255u)), float(int(h >> 16 & "       \
    "255u))) / 255.0; }\n"                                                                                             \
    "float g(int i, int j, float x, float y) { uint h = hash(i, j);\n"                                                 \
    "    return (float(int(h & 0xffffu)) / 32768.0 - 1.0) * x + (float(int(h >> 16)) / 32768.0 - 1.0) * y; }\n"        \
    "float noise(float x, float y) { float a = floor(x), b = floor(y); int i = int(a), j = int(b);\n"                  \
    "    float u = x - a, v = y - b;\n"                                                                                \
    "    return lerp(lerp(g(i, j, u, v), g(i + 1, j, u - 1.0, v), u * u), lerp(g(i, j + 1, u, v - 1.0), "              \
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
           "    return float3(0.5 + 0.5 * a, frac(64.0 * b), frac(64.0 * c));\n"),
#define FIRST_LIMITED 3
    /* an edge, its colours shared by lanes or not */
    SHADER("    float a = saturate((d[0] - length(p - 0.5)) * d[1] + 0.5);\n"
           "    return float3(0.1 + a * 0.8, a * d[2] - 0.5, 0.4 - a * 0.3);\n"),
    /* between two numbers, rising or falling with them */
    SHADER("    float a = smoothstep(d[0], d[1], p.x + p.y); return float3(a, frac(64.0 * a), 1.0 - a);\n"),
    /* 1 in one point only, and limits other than 0 and 1 */
    SHADER("    float2 q = p - 0.25; float a = saturate(1.0 - d[1] * dot(q, q)); return float3(a, sqrt(a), a * a);\n"),
    SHADER("    float a = clamp(-(x + d[1]) / d[2], -0.3, 0.7); return float3(a + 0.3, a, d[0]);\n"),
    /* of two limited numbers, and one that shows beside its limits: nothing is beyond */
    SHADER("    float a = saturate(x), b = saturate(p.x * d[1] - 1.0); return float3(a, b, a * b);\n"),
    SHADER("    float a = saturate(x); return float3(a, frac(x), 0.0);\n"),
    /* what lanes share of iterations: of all of them, with a number that is carried and shows behind the loop */
    SHADER("    float best = 9.0, c = 0.0, w = 1.0;\n"
           "    for (int i = 0; i < 12; i++) { float u = x - q[i], v = y - q[12 + i], e = u * u + v * v * w;\n"
           "        w = w * 0.9 + y * 0.01; if (e < best) { best = e; c = q[i] * w + float(i) * u; } }\n"
           "    return float3(best, frac(c), w);\n"),
    /* of those up to where a row, or a lane, leaves */
    SHADER("    float s = 0.0, w = 1.0; int n = 0;\n"
           "    for (int i = 0; i < 40; i++) { w *= 0.95 + 0.1 * frac(y); if (w * float(i) > 11.0) break;\n"
           "        s += sin(w * x + float(i)); n += int(8.0 * y) * i; s += float(n % 7) * x; }\n"
           "    return float3(frac(s), w, float(n & 255) / 255.0);\n"),
    SHADER("    float s = 0.0; for (int i = 0; i < 30; i++) { s += (y + q[i % 24]) * x; if (s > 3.0) break; }\n"
           "    return float3(frac(s), 0.0, 0.0);\n"),
    /* of a loop in a loop, and behind a branch */
    SHADER(
        "    float s = 0.0; for (int i = 0; i < 5; i++) { float v = y * q[i]; if (v > 0.3) s += v * x; else s -= x;\n"
        "        for (int j = 0; j < 7; j++) s += frac(v * float(j)) * x; }\n"
        "    return float3(frac(s), frac(8.0 * s), 0.0);\n"),
    /* of one whose lanes have a list */
    SHADER("    float3 c = float3(0.1); [Cull(extent)]\n"
           "    for (int i = 0; i < 12; i++) { float u = p.x - q[i], v = p.y - q[12 + i];\n"
           "        if (u * u + v * v < 0.04) c = float3(q[i], v * v, 0.5); }\n"
           "    return c;\n"),
#define FIRST_LISTED 14
    /* of painters and the nearest of points, of which few matter in a box of pixels */
    SHADER(
        "    float t = 1.0; float3 c = float3(0.0);\n"
        "    for (int i = 0; i < 24; i++) { float u = p.x - q[i], v = p.y - q[(7 * i + 3) % 24], e = u * u + v * v;\n"
        "        if (e < 0.02) { float a = 0.7 - 30.0 * e; c += t * a * float3(q[i], u, 0.5); t *= 1.0 - a;\n"
        "            if (t < 0.1) break; } }\n"
        "    return c + t * 0.2;\n"),
    SHADER(
        "    float3 c = float3(0.1); for (int i = 0; i < 24; i++) { float u = p.x - q[i] * d[0], v = p.y - q[23 - i];\n"
        "        if (abs(u) < 0.2 && abs(v) < 0.3) c = float3(q[i], d[1], 0.5); }\n"
        "    return c;\n"),
    SHADER("    float best = 1e30; float3 c = float3(0.0);\n"
           "    for (int i = 0; i < 24; i++) { float u = d[0] * (p.x - q[i]), v = p.y - q[(5 * i) % 24] + d[1];\n"
           "        float e = u * u + v * v; if (e < best) { best = e; c = float3(q[i], q[23 - i], u); } }\n"
           "    return c;\n"),
    SHADER(
        "    float best = d[1]; for (int i = 0; i < 24; i++) best = min(best, length(p - float2(q[i], d[0] * q[23 - i])));\n"
        "    return float3(best, frac(64.0 * best), 0.0);\n"),
    /* of balls in a mirror, first and second sight of which have lists of their own */
    SHADER("    float3 o = float3(0.5, 0.5, d[1]), r = float3(p - 0.5, d[0]), c = float3(0.0); float w = 1.0;\n"
           "    for (int k = 0; k < 2; k++) { float t = 1e9, z = 0.0;\n"
           "        for (int i = 0; i < 24; i++) { float3 v = o - float3(q[i], q[23 - i], q[(7 * i + 3) % 24]);\n"
           "            float b = dot(v, r), e = b * b - (dot(v, v) - 0.01) * dot(r, r);\n"
           "            if (e > 0.0) { float u = -b - sqrt(e); if (u > 0.0 && u < t) { t = u; z = q[i]; } } }\n"
           "        if (t > 1e8) break;\n"
           "        c += w * float3(z, frac(t), 0.2); w *= 0.5; o += t * r; r.z = -r.z; }\n"
           "    return c;\n")};

static const float scale[][2] = {{8, -3.7f},
                                 {-8, 3.7f},
                                 {0, 0.25f},
                                 {0.5f, 0.4f},
                                 {40, 100},
                                 {300, -150},
                                 {-300, 150},
                                 {4000, 0},
                                 {5e9f, -2.5e9f},
                                 {2e3f, 2147483e3f},
                                 {2e3f, -2147484e3f},
                                 {1e30f, -5e29f},
                                 {INFINITY, 0},
                                 {1, INFINITY},
                                 {1, -INFINITY},
                                 {1, NAN},
                                 {16, 0x7fffff},
                                 {1000, 2147482624.f},
                                 {0.3f, 40},
                                 {0.3f, -40},
                                 {0.3f, 0},
                                 {0.3f, 1e-3f},
                                 {0.3f, 1e9f},
                                 {0.3f, 1e30f},
                                 {-1, 40},
                                 {0.01f, 5},
                                 {0.45f, 1},
                                 {2, 40},
                                 {1e30f, 1e-30f},
                                 {0.9f, 0.2f},
                                 {0.3f, 0.3f},
                                 {NAN, 1},
                                 {-3, 6},
                                 {0, 1},
                                 {0.3f, INFINITY},
                                 {-0.f, -0.f}};
enum { SCALES = sizeof scale / sizeof *scale };

static SltProgram *compile(const char *text, const char *target, uint32_t width, bool f64) {
    SltOptions o = SLT_OPTIONS_INIT;
    SltProgram *p;
    o.rgba8 = o.no_cache = true, o.stdlib_dir = SALTUS_STDLIB_BUILD, o.target = target, o.width = width, o.f64 = f64;
    if (slt_compile_string(text, "lookup", &o, &p) == SLT_OK) return p;
    slt_program_free(p);
    return NULL; /* not on this processor */
}

static void render(SltProgram *p, const float *at, uint32_t *pixels) {
    SltJob job = SLT_JOB_INIT;
    SltError err = {0};
    job.size[0] = WIDTH, job.size[1] = HEIGHT, job.threads = p->list_work < 1e30 ? 1 : 2;
    const double d[3] = {at[0], at[1], 2.1};
    assert_int_equal(slt_set_floats(p, 0, 3, d, &err), SLT_OK);
    if (slt_render_rgba8(p, &job, pixels, NULL, &err) != SLT_OK) fail_msg("%s", err.text);
}

static void same_pixels(void **state) {
    (void)state;
    static const struct {
        const char *target;
        uint32_t width; /* 1: what the others must give */
    } way[] = {{"sse2", 1},  {"sse2", 0}, {"sse2", 16},  {"avx2", 1},    {"avx2", 0},   {"avx2", 16},
               {"avx2", 64}, {"avx2", 8}, {"avx512", 0}, {"avx512", 32}, {"avx512", 64}};
    static uint32_t want[SCALES][SIZE], got[SIZE];
    for (size_t s = 0; s < 2 * sizeof source / sizeof *source; s++)
        for (size_t w = 0; w < sizeof way / sizeof *way; w++) {
            if (s % 2 && way[w].width > 1) continue;
            SltProgram *p = compile(source[s / 2], way[w].target, way[w].width, s % 2);
            if (!p && w > 2) continue;
            assert_non_null(p);
            for (uint32_t k = 0; k < SCALES; k++) {
                render(p, scale[k], way[w].width == 1 ? want[k] : got);
                for (uint32_t i = 0; i < SIZE && way[w].width != 1; i++)
                    if (got[i] != want[k][i])
                        fail_msg("source %zu, f%d, %s/%u, scale %g %+g: pixel %u is %08x, not %08x", s / 2,
                                 s % 2 ? 64 : 32, way[w].target, way[w].width, (double)scale[k][0], (double)scale[k][1],
                                 i, got[i], want[k][i]);
            }
            p->list_work = 1e30; /* so that bounds are worth it */
            for (uint32_t k = 0; k < SCALES && !way[w].width; k++) {
                render(p, scale[k], got);
                if (k == 0 && s / 2 >= FIRST_LISTED) assert_true(p->lists == LISTS_USED || p->lists == LISTS_USELESS);
                if (memcmp(got, want[k], sizeof got))
                    fail_msg("source %zu, f%d, %s, scale %g %+g, lists", s / 2, s % 2 ? 64 : 32, way[w].target,
                             (double)scale[k][0], (double)scale[k][1]);
            }
            slt_program_free(p);
        }
}

static bool has(const unsigned char *bytes, size_t size, const char *what) {
    return memmem(bytes, size, what, strlen(what));
}

/* A register's worth of cells is hashed once, and permuted. */
static void is_there(void **state) {
    (void)state;
    static const char *const target[] = {"avx512", "avx2", "sse2"};
    for (size_t s = 0; s < sizeof source / sizeof *source; s++) {
        SltProgram *p = compile(source[s], "sse2", 0, false);
        static uint32_t pixels[SIZE];
        assert_non_null(p);
        render(p, scale[0], pixels); /* makes the kernel's IR */
        for (int t = 0; t < 3; t++) {
            KernelRequest k = {"value", p->fn[K_VALUE]};
            BackOptions o = {.width = 64, .opt_level = 2, .pixels = BACK_PIXELS_RAW};
            const char *why = "";
            unsigned char *bytes;
            size_t size;
            assert_true(target_named(&o.target, target[t]));
            back_share_row(k.fn, &o.target, o.width);
            assert_int_equal(back_emit(k.fn->session, &k, 1, &o, 's', &bytes, &size, &why), 0);
            const bool permutes = has(bytes, size, "\tvpermd\t") || has(bytes, size, "\tvpermps\t");
            if (permutes != (s < FIRST_LIMITED && t < 2)) fail_msg("permutes: source %zu for %s", s, target[t]);
            free(bytes);
        }
        slt_program_free(p);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(same_pixels), cmocka_unit_test(is_there)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
