/* Programs whose gradients of the integral are known: edges, corners, composed, nested and repeated conditions,
 * randomness, integer jumps, thin features, extreme scales; in 1D, 2D and 3D. Estimators are held against them. */
#ifndef SALTUS_TESTS_SAMPLE_CLOSED_FORMS_H
#define SALTUS_TESTS_SAMPLE_CLOSED_FORMS_H

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "saltus/saltus.h"

#define PI 3.14159265358979323846

typedef struct Want {
    const char *param;
    double value;
} Want;

typedef struct Case {
    const char *name, *source;
    Want want[4];
    double scale;     /* of the gradient, where the wanted ones are 0; 0: the largest wanted */
    double tolerance; /* relative, of sampled lines; 0: 0.5 % */
    bool f64_only;
} Case;

/* A lens: the overlap of two discs of radius r and R at distance d; its derivative in r is the arc of the r-circle
 * inside the other. */
static double arc_inside(double r, double R, double d) { return 2 * r * acos((d * d + r * r - R * R) / (2 * d * r)); }

static Case cases[128];
static int ncases;
static void add(Case c) { cases[ncases++] = c; }
#define CASE(title, text, ...) add((Case){.name = title, .source = text, __VA_ARGS__})

#define SHADER1(decl, body) decl "shader float main(float x) {" body "}"
#define SHADER2(decl, domain, body) decl domain "shader float main(float2 x) {" body "}"
#define SHADER3(decl, domain, body) decl domain "shader float main(float3 x) {" body "}"
#define UNIT "[Domain(-1.0, 1.0)] "

static void make_cases(void) {
    /* ---- 1D */
    CASE("step", SHADER1("param float t = 0.37;", "[Disc] if (x > t) return 1.0; return 0.0;"), .want = {{"t", -1}});
    CASE("step, other side", SHADER1("param float t = 0.37;", "float f = 0.0; [Disc] if (x < t) f = 2.5; return f;"),
         .want = {{"t", 2.5}});
    CASE("window", SHADER1("param float t = 0.4; param float w = 0.2;", "[Disc] return abs(x - t) < w ? 1.0 : 0.0;"),
         .want = {{"t", 0}, {"w", 2}});
    CASE("varying jump", SHADER1("param float t = 0.6;", "[Disc] return x > t ? x * x : 0.0;"), .want = {{"t", -0.36}});
    CASE("scaled argument",
         SHADER1("param float t = 0.9; param float a = 2.5;", "[Disc] return a * x > t ? 1.0 : 0.0;"),
         .want = {{"t", -0.4}, {"a", 0.9 / 6.25}});
    CASE("floor", SHADER1("param float a = 4.3;", "[Disc] return floor(a * x);"), .want = {{"a", 10 / (4.3 * 4.3)}});
    CASE("frac moves nothing", SHADER1("param float t = 0.3;", "[Disc] return frac(x - t);"), .want = {{"t", 0}},
         .scale = 1);
    CASE("ceil", SHADER1("param float a = 3.4;", "[Disc] return ceil(a * x);"), .want = {{"a", 6 / (3.4 * 3.4)}});
    CASE("round", SHADER1("param float a = 3.2;", "[Disc] return round(a * x);"),
         .want = {{"a", (0.5 + 1.5 + 2.5) / (3.2 * 3.2)}});
    CASE("int()", SHADER1("param float a = 2.7;", "[Disc] int n = int(a * x); return float(n * n);"),
         .want = {{"a", (1 * 1 + 3 * 2) / (2.7 * 2.7)}});
    CASE("trunc through 0",
         "param float t = 0.25; [Domain(-2.0, 2.0)] shader float main(float x) { [Disc] return trunc(x - t); }",
         .want = {{"t", -3}}, .tolerance = 0.006);
    /* f = x - a n, n = floor(x / a), x in (0, 1): I = 1/2 - a sum_k=1..3 (1 - a k) = 1/2 - 3 a + 6 a^2 */
    CASE("fmod", SHADER1("param float a = 0.3;", "[Disc] return fmod(x, a);"), .want = {{"a", -3 + 12 * 0.3}},
         .scale = 3);
    CASE("step()", SHADER1("param float t = 0.21;", "[Disc] return step(t, x);"), .want = {{"t", -1}});
    CASE("sign", SHADER1("param float t = 0.71;", "[Disc] return sign(x - t);"), .want = {{"t", -2}});
    CASE("composed condition",
         SHADER1("param float t = 0.45;", "[Disc] float h = x > t ? 1.0 : 0.0; return h * h + 2.0 * h;"),
         .want = {{"t", -3}});
    CASE("product of coincident jumps",
         SHADER1("param float t = 0.45;",
                 "[Disc] float a = x > t ? 1.0 : 0.0; [Disc] float b = x > t ? 1.0 : 0.0; return a * b;"),
         .want = {{"t", -1}});
    CASE("condition tested twice",
         SHADER1("param float t = 0.45;",
                 "float f = 0.0; [Disc] if (x < t) f += 1.0; [Disc] if (x < t) f += 2.0; return f;"),
         .want = {{"t", 3}});
    CASE("nested",
         SHADER1("param float a = 0.2; param float b = 0.83;",
                 "[Disc] if (x > a) { [Disc] if (x < b) return 1.0; } return 0.0;"),
         .want = {{"a", -1}, {"b", 1}});
    CASE("decision kept in a bool",
         SHADER1("param float t = 0.3;", "[Disc] bool hit = x < t; if (hit) return 1.0; return 0.0;"),
         .want = {{"t", 1}});
    CASE("exponential edge", SHADER1("param float t = -1.0;", "[Disc] return x > exp(t) ? 1.0 : 0.0;"),
         .want = {{"t", -0.36787944117144233}});
    CASE("tiny domain",
         "param float t = 3e-13; [Domain(0.0, 1e-12)] shader float main(float x) { [Disc] return x > t ? 1.0 : 0.0; }",
         .want = {{"t", -1}});
    CASE("huge domain",
         "param float t = 3e11; [Domain(-1e12, 1e12)] shader float main(float x) { [Disc] return x > t ? 1.0 : 0.0; }",
         .want = {{"t", -1}});
    CASE("steep g", SHADER1("param float t = 0.6180339;", "[Disc] return 1e12 * (x - t) > 0.0 ? 1.0 : 0.0;"),
         .want = {{"t", -1}});
    CASE("flat g", SHADER1("param float t = 0.6180339;", "[Disc] return 1e-12 * (x - t) > 0.0 ? 1.0 : 0.0;"),
         .want = {{"t", -1}});
    CASE("random edge", SHADER1("param float t = 0.8;", "float u = rand(); [Disc] return x < t * u ? 1.0 : 0.0;"),
         .want = {{"t", 0.5}}, .tolerance = 0.01);
    CASE("interior and boundary", SHADER1("param float t = 0.5;", "[Disc] return x > t ? t * x : 0.0;"),
         .want = {{"t", 0.375 - 0.25}}, .scale = 0.375);
    CASE("loop of steps",
         "param float a[4] = { 0.1, 0.35, 0.6, 0.9 }; shader float main(float x) { float f = 0.0; for (int i = 0; i < "
         "4; i++) { [Disc] if (x < a[i]) f += float(i + 1); } return f; }",
         .want = {{"a[0]", 1}, {"a[1]", 2}, {"a[2]", 3}, {"a[3]", 4}});
    CASE("first hit in a loop",
         "param float a = 0.35; shader float main(float x) { int n = 0; for (int i = 1; i < 10; i++) { [Disc] if (x < "
         "a * float(i)) break; n++; } return float(n); }",
         .want = {{"a", -3}}); /* jumps of 1 at a, 2a (x = ia, i = 1, 2): -(1 + 2) */
    /* ---- 2D */
    CASE("disc",
         SHADER2("param float r = 0.4; param float2 c = float2(0.1, 0.05);", UNIT,
                 "[Disc] return length(x - c) < r ? 1.0 : 0.0;"),
         .want = {{"r", 2 * PI * 0.4}, {"c.x", 0}, {"c.y", 0}});
    CASE("disc leaving the domain",
         SHADER2("param float cx = 1.0; param float r = 0.5;", UNIT,
                 "[Disc] return length(x - float2(cx, 0.0)) < r ? 1.0 : 0.0;"),
         .want = {{"cx", -1}, {"r", PI * 0.5}});
    CASE("ellipse",
         SHADER2("param float a = 0.7; param float b = 0.3;", UNIT,
                 "float2 q = x / float2(a, b); [Disc] return dot(q, q) < 1.0 ? 1.0 : 0.0;"),
         .want = {{"a", PI * 0.3}, {"b", PI * 0.7}});
    CASE("half plane",
         SHADER2("param float s = 0.3; param float o = 0.45;", "",
                 "[Disc] return x.y < o + s * (x.x - 0.5) ? 1.0 : 0.0;"),
         .want = {{"o", 1}, {"s", 0}});
    CASE("triangle (corner)",
         SHADER2("param float a = 0.6; param float b = 0.8;", "", "[Disc] return x.x / a + x.y / b < 1.0 ? 1.0 : 0.0;"),
         .want = {{"a", 0.4}, {"b", 0.3}});
    CASE("rectangle (and)",
         SHADER2("param float a = 0.61; param float b = 0.37;", "", "[Disc] return x.x < a && x.y < b ? 1.0 : 0.0;"),
         .want = {{"a", 0.37}, {"b", 0.61}});
    CASE("complement (or)",
         SHADER2("param float a = 0.61; param float b = 0.37;", "", "[Disc] return !(x.x > a || x.y > b) ? 1.0 : 0.0;"),
         .want = {{"a", 0.37}, {"b", 0.61}});
    CASE("lens (and of discs)",
         SHADER2("param float r = 0.4; param float q = 0.5;", UNIT,
                 "[Disc] return length(x) < r && length(x - float2(0.55, 0.0)) < q ? 1.0 : 0.0;"),
         .want = {{"r", arc_inside(0.4, 0.5, 0.55)}, {"q", arc_inside(0.5, 0.4, 0.55)}});
    CASE("disc over disc",
         SHADER2("param float r = 0.4; param float q = 0.5;", UNIT,
                 "float f = 0.0; [Disc] if (length(x) < r) f = 1.0; [Disc] if (length(x - float2(0.48, 0.0)) < q) f = "
                 "3.0; return f;"),
         .want = {{"r", 2 * PI * 0.4 - arc_inside(0.4, 0.5, 0.48)},
                  {"q", 3 * 2 * PI * 0.5 - arc_inside(0.5, 0.4, 0.48)}});
    CASE("ring, one comparison",
         SHADER2("param float r = 0.5; param float w = 0.01;", UNIT,
                 "[Disc] return abs(length(x) - r) < w ? 1.0 : 0.0;"),
         .want = {{"r", 4 * PI * 0.01}, {"w", 4 * PI * 0.5}});
    CASE("thin strip",
         SHADER2("param float o = 0.5123; param float w = 0.0005;", "",
                 "[Disc] return abs(x.y - o - 0.1 * x.x) < w ? 1.0 : 0.0;"),
         .want = {{"w", 2}, {"o", 0}});
    CASE("varying colour", SHADER2("param float r = 0.6;", UNIT, "[Disc] return length(x) < r ? x.x * x.x : 0.0;"),
         .want = {{"r", PI * 0.216}});
    CASE("flower",
         SHADER2("param float a = 0.5; param float b = 0.12;", UNIT,
                 "[NoDisc] float t = atan2(x.y, x.x); [Disc] return length(x) < a + b * cos(5.0 * t) ? 1.0 : 0.0;"),
         .want = {{"a", 2 * PI * 0.5}, {"b", PI * 0.12}});
    CASE("flower by atan2's own cut",
         SHADER2("param float a = 0.5;", UNIT,
                 "[Disc] float t = atan2(x.y, x.x); [Disc] return length(x) < a ? t : 0.0;"),
         .want = {{"a", 0}}, .scale = 1);
    CASE("checkerboard",
         SHADER2("param float s = 0.1;", "",
                 "[Disc] float2 n = floor(x * 4.0 + float2(s, 0.0)); return n.x * (n.y == 1.0 ? 1.0 : 0.0);"),
         .want = {{"s", 0.25}});
    CASE("square by max",
         SHADER2("param float h = 0.45;", UNIT, "[Disc] return max(abs(x.x), abs(x.y)) < h ? 1.0 : 0.0;"),
         .want = {{"h", 8 * 0.45}});
    CASE("tiny disc in a tiny domain",
         SHADER2("param float r = 3e-7;", "[Domain(-1e-6, 1e-6)] ", "[Disc] return length(x) < r ? 1.0 : 0.0;"),
         .want = {{"r", 2 * PI * 3e-7}});
    CASE("huge disc",
         SHADER2("param float r = 3e6;", "[Domain(-1e7, 1e7)] ", "[Disc] return length(x) < r ? 1.0 : 0.0;"),
         .want = {{"r", 2 * PI * 3e6}});
    CASE(
        "random radius",
        SHADER2("param float r = 0.5;", UNIT, "float u = rand(); [Disc] return length(x) < r * (0.5 + u) ? 1.0 : 0.0;"),
        .want = {{"r", 2 * PI * 0.5 * (0.25 + 0.5 + 1.0 / 3)}}, .tolerance = 0.01);
    CASE("square root guarded by its site",
         SHADER2("param float r = 0.6;", UNIT,
                 "float k = r * r - dot(x, x); [Disc] if (k > 0.0) return sqrt(k); return 0.0;"),
         .want = {{"r", 2 * PI * 0.36}});
    CASE("thin band between two comparisons",
         SHADER2("param float w = 0.0005;", "",
                 "float d = x.y - 0.5123 - 0.1 * x.x; [Disc] return d > 0.0 && d < w ? 1.0 : 0.0;"),
         .want = {{"w", 1}});
    CASE("thin band by nested ifs",
         SHADER1("param float w = 0.00001;",
                 "float f = 0.0; [Disc] if (x > 0.37) { [Disc] if (x < 0.37 + w) f = 1.0; } return f;"),
         .want = {{"w", 1}});
    /* ---- 3D */
    CASE("sphere", SHADER3("param float r = 0.6;", UNIT, "[Disc] return length(x) < r ? 1.0 : 0.0;"),
         .want = {{"r", 4 * PI * 0.36}});
    CASE("ellipsoid",
         SHADER3("param float a = 0.8; param float b = 0.5; param float c = 0.4;", UNIT,
                 "float3 q = x / float3(a, b, c); [Disc] return dot(q, q) < 1.0 ? 1.0 : 0.0;"),
         .want = {{"a", 4 * PI / 3 * 0.2}, {"b", 4 * PI / 3 * 0.32}, {"c", 4 * PI / 3 * 0.4}});
    CASE("box",
         SHADER3("param float3 h = float3(0.3, 0.5, 0.7);", UNIT,
                 "float3 d = abs(x) - h; [Disc] return max(d.x, max(d.y, d.z)) < 0.0 ? 1.0 : 0.0;"),
         .want = {{"h.x", 8 * 0.35}, {"h.y", 8 * 0.21}, {"h.z", 8 * 0.15}});
    CASE("cylinder",
         SHADER3("param float r = 0.5; param float h = 0.6;", UNIT,
                 "[Disc] return length(x.xy) < r && abs(x.z) < h ? 1.0 : 0.0;"),
         .want = {{"r", 2 * PI * 0.5 * 1.2}, {"h", 2 * PI * 0.25}});
    CASE("shell",
         SHADER3("param float r = 0.5; param float w = 0.05;", UNIT,
                 "[Disc] return abs(length(x) - r) < w ? 1.0 : 0.0;"),
         .want = {{"r", 16 * PI * 0.5 * 0.05}, {"w", 8 * PI * (0.25 + 0.0025)}});
    CASE("sphere minus sphere",
         SHADER3("param float r = 0.7; param float q = 0.4;", UNIT,
                 "[Disc] return length(x) < r && !(length(x) < q) ? 2.0 : 0.0;"),
         .want = {{"r", 8 * PI * 0.49}, {"q", -8 * PI * 0.16}});
    CASE("half space",
         SHADER3("param float o = 0.4;", "", "[Disc] return x.z < o + 0.2 * x.x - 0.1 * x.y ? 1.0 : 0.0;"),
         .want = {{"o", 1}});
}

/* The largest of the wanted components, or what stands for it. */
static double scale_of(const Case *c) {
    double largest = c->scale;
    for (int w = 0; w < 4 && c->want[w].param && c->scale == 0; w++) largest = fmax(largest, fabs(c->want[w].value));
    return largest;
}

/* Runs a program; its gradient must be off by no more than `allowed` of the largest component, or by `sure` stated
 * errors. */
static SltStats run_case(const Case *c, const SltJob *job, bool f64, double allowed, double sure) {
    SltOptions o = SLT_OPTIONS_INIT;
    o.f64 = f64;
    SltProgram *p = NULL;
    if (slt_compile_string(c->source, c->name, &o, &p) != SLT_OK)
        fail_msg("%s: %s\n%s", c->name, slt_last_error(p), slt_diagnostics_text(p));
    uint32_t n = slt_float_count(p);
    double *g = calloc(n, sizeof *g), *se = calloc(n, sizeof *se);
    SltIntegral out = {.struct_size = sizeof out, .gradient = g, .gradient_stderr = se};
    SltStats stats = SLT_STATS_INIT;
    SltError err = {0};
    if (slt_grad_integral(p, job, &out, &stats, &err) != SLT_OK) fail_msg("%s: %s", c->name, err.text);
    for (int w = 0; w < 4 && c->want[w].param; w++) {
        SltParam q = SLT_PARAM_INIT;
        if (slt_param_find(p, c->want[w].param, &q, &err) != SLT_OK) fail_msg("%s: %s", c->name, err.text);
        double got = g[q.fbase], off = fabs(got - c->want[w].value),
               most = fmax(allowed * scale_of(c), sure * se[q.fbase]);
        if (!(off <= most)) {
            print_error("%s (%s): d/d%s = %.12g, exact %.12g, off by %.3g (allowed %.3g, stated error %.2g; "
                        "%llu crossings, %llu evaluations, left %g)\n",
                        c->name, f64 ? "f64" : "f32", q.name, got, c->want[w].value, off, most, se[q.fbase],
                        (unsigned long long)stats.crossings, (unsigned long long)stats.evaluations, stats.left);
            fail();
        }
    }
    free(g);
    free(se);
    slt_program_free(p);
    return stats;
}

#endif
