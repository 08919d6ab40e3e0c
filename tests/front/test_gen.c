/* Programs for every feature of the language, lowered and run in the interpreter: in f32 and f64, with 16 lanes that
 * take different ways. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <string.h>

#include "compiler/front/front.h"
#include "include/saltus/kernel.h"

enum { LANES = 16 };
#define assert_near(a, b, tol) assert_true(fabs((double)(a) - (double)(b)) <= (tol))

typedef struct Case {
    const char *source;
    double (*expect)(double x, double y); /* of channel 0 */
    double tolerance;
} Case;

typedef struct Run {
    const char *source;
    Precision precision;
    bool disc_auto;
    Program *program;
    double out[4][64 + SLT_PAD];
    uint64_t counters[SLT_COUNTERS];
    int status;
    uint32_t n;
    double x[2][64];
} Run;

static void run_body(Session *s, void *user) {
    Run *r = user;
    int file = session_add_text(s, "test.salt", ".", r->source, strlen(r->source));
    ProgramOptions opt = {.precision = r->precision, .seed = 1};
    opt.front.disc_auto = r->disc_auto;
    Program *p = r->program = front_compile(s, file, &opt);
    if (!p) return;
    SltKernelArgs args = {.iparams = p->init_ints, .n_valid = r->n, .resolution = {7, 5}};
    static float f32[SLT_IN_VARYING][64 + SLT_PAD];
    static double f64[SLT_IN_VARYING][64 + SLT_PAD];
    static int32_t ints[3][64 + SLT_PAD];
    static float of[4][64 + SLT_PAD];
    bool single = r->precision == PREC_F32;
    for (uint32_t i = 0; i < r->n; i++) {
        for (int d = 0; d < 2; d++) f32[d][i] = (float)(f64[d][i] = r->x[d][i]);
        f32[IN_RAND0][i] = 0.25f, f64[IN_RAND0][i] = 0.25;
        ints[0][i] = (int32_t)i;
        ints[1][i] = (int32_t)i % 4;
        ints[2][i] = (int32_t)i / 4;
    }
    for (int i = 0; i < SLT_IN_VARYING; i++) args.in[i] = single ? (void *)f32[i] : (void *)f64[i];
    args.in[IN_STREAM] = args.in[IN_SAMPLE] = ints[0];
    args.in[IN_PIXEL0] = ints[1], args.in[IN_PIXEL1] = ints[2];
    for (int c = 0; c < 4; c++) args.out[c] = single ? (void *)of[c] : (void *)r->out[c];
    float *pf = ARENA_ARRAY(&s->scratch, float, p->nfloats + 1);
    for (uint32_t i = 0; i < p->nfloats; i++) pf[i] = (float)p->init_floats[i];
    args.params = single ? (void *)pf : (void *)p->init_floats;
    r->status = ir_interpret(p->primal, &args, r->n, LANES);
    for (int c = 0; c < 4 && single; c++)
        for (uint32_t i = 0; i < r->n; i++) r->out[c][i] = (double)of[c][i];
    memcpy(r->counters, args.counters, sizeof r->counters);
}

/* The session stays open so that the caller can look at diagnostics and the program. */
static Session *run(Run *r) {
    Session *s = session_create(0);
    assert_non_null(s);
    if (!r->n) {
        r->n = 32;
        for (uint32_t i = 0; i < r->n; i++)
            r->x[0][i] = -2.0 + 4.0 * (i + 0.5) / r->n, r->x[1][i] = -1.0 + 2.0 * ((i * 7) % r->n + 0.25) / r->n;
    }
    int status = session_protect(s, run_body, r);
    if (status) print_message("%s\nunwound: %s\n", r->source, s->unwind_text);
    assert_int_equal(status, 0);
    return s;
}

static void check_case(const Case *c) {
    for (int prec = 0; prec < 2; prec++) {
        Run r = {.source = c->source, .precision = prec ? PREC_F64 : PREC_F32};
        Session *s = run(&r);
        if (!r.program || s->nerrors) diag_print_text(s, stderr, false);
        assert_non_null(r.program);
        assert_int_equal(r.status, 0);
        for (uint32_t i = 0; i < r.n; i++) {
            double want = c->expect(r.x[0][i], r.x[1][i]), tol = c->tolerance != 0 ? c->tolerance
                                                                 : prec            ? 1e-12
                                                                                   : 2e-6 * (1 + fabs(want));
            if (!(fabs(r.out[0][i] - want) <= tol)) {
                print_message("%s\nprecision %d x %g y %g: %.9g, expected %.9g\n", c->source, prec, r.x[0][i],
                              r.x[1][i], r.out[0][i], want);
                fail();
            }
        }
        session_destroy(s);
    }
}

/* ---- the table */

#define MAIN(body) "shader float main(float2 x) {" body "}"

static double e_branches(double x, double y) { return x < 0 ? (y < 0 ? 1 : 2) : x < 1 ? 3 : 4; }
static double e_sum(double x, double y) {
    double s = 0;
    for (int i = 0; i < 10; i++) s += x * i + y;
    return s;
}
static double e_break(double x, double y) {
    int n = 0;
    double t = x;
    for (int i = 0; i < 20; i++) {
        if (t > 3) break;
        if (i % 3 == 1) continue;
        t += 0.5;
        n++;
    }
    return n + t + y;
}
static double e_early(double x, double y) {
    for (int i = 0; i < 8; i++)
        if (x < -1.5 + 0.5 * i) return i;
    return y < 0 ? 100 : 200;
}
static double e_while(double x, double y) {
    double t = fabs(x) + 0.1;
    int n = 0;
    while (t < 5 && n < 6) t *= 1.7, n++;
    return t + y;
}
static double e_do(double x, double y) {
    double t = x;
    int n = 0;
    do {
        t += 1;
        n++;
    } while (t < 1 && n < 10);
    return t * n + y;
}
static double e_switch(double x, double y) {
    int k = (int)floor((x + 2) * 2);
    double r = 0;
    switch (k) {
    case 0:
    case 1: r = 1; break;
    case 2: r = 2; /* fall through */
    case 3: r += 10; break;
    case 7:
        if (y < 0) break;
        r = 70;
        break;
    default: r = 5;
    }
    return r;
}
static double e_array(double x, double y) {
    double a[4][3] = {{0}};
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 3; j++) a[i][j] = x * i + j;
    int k = (int)trunc(y * 10);
    int i = k < 0 ? 0 : k > 3 ? 3 : k, j = k - 1 < 0 ? 0 : k - 1 > 2 ? 2 : k - 1;
    return a[i][j] + a[2][1];
}
static double e_struct(double x, double y) { return (x + 1) * 2 + y * 3 + 0.5 * 2 + (x + 1); }
static double e_swizzle(double x, double y) { return y * 100 + x * 10 + x + 7; }
static double e_matrix(double x, double y) {
    double m[2][2] = {{1, 2}, {3, 4}};
    double v0 = m[0][0] * x + m[0][1] * y, v1 = m[1][0] * x + m[1][1] * y, w0 = x * m[0][0] + y * m[1][0];
    double det = -2, inv00 = 4 / det, inv10 = -3 / det;
    return v0 + 10 * v1 + 100 * w0 + det + inv00 * 7 + inv10 * 3 + (m[0][0] * m[0][1] + m[0][1] * m[1][1]);
}
static double e_inout(double x, double y) { return (x + y) * 2 + (x + 5) + 3; }
static double e_ints(double x, double y) {
    int a = (int)trunc(x * 100), b = 7;
    return (uint32_t)(a / b + a % b + (a >> 2)) + ((uint32_t)a >> 28) + (uint32_t)(a & 15) + 5u + 0 * y;
}
static double e_builtins(double x, double y) {
    double t = fmin(fmax((x + 1) / 2, 0), 1);
    return fabs(x) + (x > 0) - (x < 0) + floor(x) + ceil(y) + (x - floor(x)) + fmin(x, y) + fmax(x, y) +
           fmin(fmax(x, 0), 1) + (x + 0.25 * (y - x)) + (y < x ? 0 : 1) + t * t * (3 - 2 * t) + sqrt(x * x + y * y) +
           trunc(x) + rint(x) + (x - 0.7 * trunc(x / 0.7)) + atan2(y, x);
}
static double e_vectors(double x, double y) {
    double l = sqrt(x * x + y * y + 9);
    return x * 3 + y * 2 + 3 * 1 + l + x / l + (y * 1 - 3 * 2) + sqrt((x - 3) * (x - 3) + (y - 2) * (y - 2) + 4);
}
static uint32_t mix32(uint32_t h) {
    h ^= h >> 16, h *= 0x7feb352du, h ^= h >> 15, h *= 0x846ca68bu;
    return h ^ (h >> 16);
}
static double e_misc(double x, double y) {
    double s = 0;
    for (int i = 0, j = 10; i < j; i++, j--) s += i * j * x;
    int n = 0;
    for (int i = 1; i < 100; i *= 3) n++;
    return s + n + x * y + y * x + (3 * x + 4 * y) + 1 + 5 + (x > 0);
}
static double e_overload(double x, double y) { return 1 + 20 + 300 + x * y * 0; }
static double e_switch_fall(double x, double y) {
    int k = (int)floor((x + 2) * 3), n = 0;
    double r = 0;
    for (int i = 0; i < 3; i++) {
        switch (k - i) {
        default: r += 1; /* fall through */
        case 4:
            if (y > 0.5) continue;
            r += 10;
            break;
        case 5: r += 100;
        }
        n++;
    }
    return r + n * 0.5;
}
static double e_hash(double x, double y) {
    uint32_t k = (uint32_t)trunc((x + 2) * 50) + 0 * (uint32_t)y;
    uint32_t h = mix32(mix32(k + 0x9e3779b9u) + 5);
    return (h >> 8) / 16777216.0;
}
static double e_texture(double x, double y) { return 0 * x * y + 1.0; }
static double e_logic(double x, double y) {
    int a = x > 0 && y > 0, b = x > 1 || y < -0.5, n = 0;
    if (x > 0 && (n++, 1)) {
    }
    return a + 2 * b + 4 * !a + (x != y) + 10 * n;
}
static double e_trunc(double x, double y) { return 5 + 0 * x * y; }
static double e_nested(double x, double y) {
    double s = 0;
    for (int i = 0; i < 4; i++)
        for (int j = 0; j <= i; j++) {
            if (j == 2 && x < 0) break;
            s += i * 10 + j + y;
        }
    return s;
}
static double e_skip(double x, double y) { return x < 0.2 || x > 1.5 ? 1 + y : y; }
static double e_param(double x, double y) {
    int i = (int)trunc(x * 2);
    i = i < 0 ? 0 : i > 2 ? 2 : i;
    static const double r[3] = {1, 4, 7}, cy[3] = {3, 6, 9};
    return r[i] + cy[i] * 10 + 6 + 42 + 1 + y * 0;
}
static double e_tangent(double x, double y) { return x * x * y; }
static double e_const_table(double x, double y) {
    static const double t[4] = {1, 3, 9, 27};
    int i = (int)trunc(x * 3), j = i + 2;
    i = i < 0 ? 0 : i > 3 ? 3 : i;
    j = j < 0 ? 0 : j > 11 ? 11 : j;
    return t[i] + j * 2 + 0 * y;
}
static double e_dynamic(double x, double y) {
    double v[3] = {x, y, 5};
    int i = (int)trunc(x * 2);
    i = i < 0 ? 0 : i > 2 ? 2 : i;
    double r = v[i];
    v[i] = 100;
    return r + v[0] + v[1] * 2 + v[2] * 4;
}
static double e_ret_loop(double x, double y) {
    double acc = 0;
    for (int i = 0; i < 5; i++) {
        for (int j = 0; j < 5; j++) {
            acc += 0.25;
            if (acc > x + 2) return acc * 10 + i;
        }
    }
    return acc + 0 * y;
}
static double e_rand_count(double x, double y) { return (x < 0 ? 3 : 1) + 0 * y; }
static double e_inputs(double x, double y) {
    int i = (int)lround((x + 2) * 8 - 0.5);
    return i % 4 + 10 * (i / 4) + 100 * 7 + 1000 * 5 + 10000.0 * i + 0 * y;
}

static const Case cases[] = {
    {MAIN(
         "float r; if (x.x < 0.0) { if (x.y < 0.0) r = 1.0; else r = 2.0; } else if (x.x < 1.0) r = 3.0; else r = 4.0; return r;"),
     e_branches, 0},
    {"float f(float2 x) { if (x.x < 0.0) { if (x.y < 0.0) return 1.0; return 2.0; } if (x.x < 1.0) return 3.0; return 4.0; }" MAIN(
         "return f(x);"),
     e_branches, 0},
    {MAIN("return x.x < 0.0 ? x.y < 0.0 ? 1.0 : 2.0 : x.x < 1.0 ? 3.0 : 4.0;"), e_branches, 0},
    {"const int N = 10;" MAIN("float s = 0.0; for (int i = 0; i < N; i++) s += x.x * i + x.y; return s;"), e_sum, 1e-4},
    {MAIN("float s = 0.0; for (int i = 9; i >= 0; --i) { s += x.x * i + x.y; } return s;"), e_sum, 1e-4},
    {MAIN("float s = 0.0; for (uint i = 0u; i != 20u; i += 2u) { s += x.x * (i / 2u) + x.y; } return s;"), e_sum, 1e-4},
    {MAIN(
         "float s = 0.0; int i = 0; [MaxIters(50)] while (true) { if (i >= 10) break; s += x.x * i + x.y; i++; } return s;"),
     e_sum, 1e-4},
    {MAIN(
         "int n = 0; float t = x.x; for (int i = 0; i < 20; i++) { if (t > 3.0) break; if (i % 3 == 1) continue; t += 0.5; n++; } return n + t + x.y;"),
     e_break, 0},
    {MAIN(
         "int n = 0; float t = x.x; int i; for (i = 0; i < 20; i++) { if (t > 3.0) { break; } else if (i % 3 != 1) { t += 0.5; n++; } } return n + t + x.y;"),
     e_break, 0},
    {"float f(float2 x) { for (int i = 0; i < 8; i++) { if (x.x < -1.5 + 0.5 * i) return float(i); } return x.y < 0.0 ? 100.0 : 200.0; }" MAIN(
         "return f(x);"),
     e_early, 0},
    {MAIN("float t = abs(x.x) + 0.1; int n = 0; [MaxIters(6)] while (t < 5.0) { t *= 1.7; n++; } return t + x.y;"),
     e_while, 0},
    {MAIN("float t = x.x; int n = 0; [MaxIters(10)] do { t += 1.0; n++; } while (t < 1.0); return t * n + x.y;"), e_do,
     0},
    {MAIN(
         "int k = int(floor((x.x + 2.0) * 2.0)); float r = 0.0; switch (k) { case 0: case 1: r = 1.0; break; case 2: r = 2.0; case 3: r += 10.0; break;"
         " case 7: if (x.y < 0.0) break; r = 70.0; break; default: r = 5.0; } return r;"),
     e_switch, 0},
    {MAIN(
         "float a[4][3]; for (int i = 0; i < 4; i++) for (int j = 0; j < 3; j++) a[i][j] = x.x * i + j; int k = int(x.y * 10.0); float b[3] = a[2];"
         " return a[k][k - 1] + b[1];"),
     e_array, 1e-5},
    {"struct S { float a; float2 b; float w[2]; }; S make(float2 x) { S s; s.a = x.x + 1.0; s.b = x; s.w[0] = 0.5; s.w[1] = s.a; return s; }"
     "float use(S s, float k) { return s.a * k + s.b.y * 3.0 + s.w[0] * k; }" MAIN(
         "S s = make(x); S t = s; t.w[1] = 99.0; return use(s, 2.0) + s.w[1];"),
     e_struct, 0},
    {MAIN("float3 v = float3(x, 7.0); v.xy = v.yx; float4 w = v.xyyz; return w.x * 100.0 + w.y * 10.0 + w.b + w.a;"),
     e_swizzle, 1e-4},
    {MAIN(
         "float2x2 m = float2x2(1.0, 2.0, 3.0, 4.0); float2 v = m * x; float2 w = x * m; float2x2 i = inverse(m); float2x2 mm = m * m;"
         " return v.x + 10.0 * v.y + 100.0 * w.x + determinant(m) + i[0][0] * 7.0 + transpose(i)[0][1] * -3.0 * -1.0 + mm[0][1] - 0.0;"),
     e_matrix, 1e-3},
    {"void f(in float a, inout float b, out float c) { b = (a + b) * 2.0; c = a + 5.0; a = 0.0; } void g(inout int k[3]) { k[1] += 1; if (k[1] > 2) return; k[1] = 0; }" MAIN(
         "float b = x.y, c; f(x.x, b, c); int k[3] = { 1, 2, 3 }; g(k); return b + c + k[1];"),
     e_inout, 0},
    {MAIN(
         "int a = int(x.x * 100.0); int b = 7; int z = int(x.y * 0.0); return a / b + a % b + (a >> 2) + (uint(a) >> 28u) + (a & 15) + 5 / 1 + a / z;"),
     e_ints, 0},
    {MAIN(
         "return abs(x.x) + sign(x.x) + floor(x.x) + ceil(x.y) + frac(x.x) + min(x.x, x.y) + max(x.x, x.y) + saturate(x.x) + lerp(x.x, x.y, 0.25) + step(x.x, x.y)"
         " + smoothstep(-1.0, 1.0, x.x) + length(x) + trunc(x.x) + round(x.x) + fmod(x.x, 0.7) + atan2(x.y, x.x);"),
     e_builtins, 2e-5},
    {MAIN(
         "float3 a = float3(x, 3.0), b = float3(3.0, 2.0, 1.0); return dot(a, b) + length(a) + normalize(a).x + cross(a, b).x + distance(a, b);"),
     e_vectors, 0},
    {"struct S { float a; float2 b; int k; };" MAIN(
         "float s = 0.0; for (int i = 0, j = 10; i < 5; i++, j--) s += i * j * x.x; int n = 0; for (int i = 1; i < 100; i *= 3) n++; S z = (S)0; S w = S(1.0, float2(2.0), 3);"
         " float2x2 m = { { 1.0, 2.0 }, { 3.0, 4.0 } }; return s + n + mul(x, x.yx) + mul(m, x)[1] + w.a + (z.k + w.k + w.b.y) + z.a + z.b.x + float(x.x > 0.0);"),
     e_misc, 2e-4},
    {"float f(float a) { return 1.0; } float f(int a) { return 20.0; } float f(float2 a) { return 300.0; }" MAIN(
         "return f(x.x) + f(3) + f(x);"),
     e_overload, 0},
    {MAIN(
         "int k = int(floor((x.x + 2.0) * 3.0)); int n = 0; float r = 0.0; for (int i = 0; i < 3; i++) { switch (k - i) { default: r += 1.0; case 4: if (x.y > 0.5) continue; r += 10.0; break;"
         " case 5: r += 100.0; } n++; } return r + n * 0.5;"),
     e_switch_fall, 0},
    {MAIN("uint k = uint((x.x + 2.0) * 50.0); return (hash(uint2(k, 5u)) >> 8u) / 16777216.0;"), e_hash, 0},
    {MAIN(
         "int n = 0; bool a = x.x > 0.0 && x.y > 0.0; bool b = x.x > 1.0 || x.y < -0.5; bool c = x.x > 0.0 && n++ == 0; float r = 0.0; if (a) r += 1.0; if (b) r += 2.0; if (!a) r += 4.0;"
         " if (x.x != x.y) r += 1.0; return r + 10.0 * n;"),
     e_logic, 0},
    {MAIN("int n = 0; [MaxIters(5)] while (true) n++; return n + 0.0 * x.x * x.y;"), e_trunc, 0},
    {MAIN(
         "float s = 0.0; for (int i = 0; i < 4; i++) for (int j = 0; j <= i; j++) { if (j == 2 && x.x < 0.0) break; s += i * 10 + j + x.y; } return s;"),
     e_nested, 1e-4},
    {"param float edge = 0.2;" MAIN(
         "bool hit = false; for (int i = 0; i < 2; i++) { float d = i == 0 ? x.x - edge : 1.5 - x.x; [Disc, SkipLoop] if (d < 0.0) hit = true; } return hit ? 1.0 + x.y : x.y;"),
     e_skip, 0},
    {"struct Disc { float r; float2 c; int k; }; param Disc discs[3] = { { 1.0, { 2.0, 3.0 }, 40 }, { 4.0, { 5.0, 6.0 }, 41 }, { 7.0, { 8.0, 9.0 }, 42 } }; param bool on = true;"
     "float pick(Disc d[3], int i) { return d[i].r + d[i].c.y * 10.0; }" MAIN(
         "int i = int(x.x * 2.0); return pick(discs, i) + discs[1].c.y + discs[2].k + (on ? 1.0 : 0.0);"),
     e_param, 1e-4},
    {"float df(float a, float b, float da, float db) { return 2.0 * a * b * da + a * a * db; } [Tangent(df)] float f(float a, float b) { return a * a * b; }" MAIN(
         "return f(x.x, x.y);"),
     e_tangent, 0},
    {"const float T[4] = { 1.0, 3.0, 9.0, 27.0 }; const int U[12] = { 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11 };" MAIN(
         "int i = int(x.x * 3.0); return T[i] + 2 * U[i + 2];"),
     e_const_table, 0},
    {MAIN(
         "float3 v = float3(5.0, x.yx); int i = int(x.x * 2.0); float r = v.zyx[i]; v.zyx[i] = 100.0; return r + v.z + v.y * 2.0 + v.x * 4.0;"),
     e_dynamic, 1e-4},
    {MAIN(
         "float3 v = float3(x, 5.0); int i = int(x.x * 2.0); float r = v[i]; v[i] = 100.0; return r + v.x + v.y * 2.0 + v.z * 4.0;"),
     e_dynamic, 1e-4},
    {"float f(float2 x) { float acc = 0.0; for (int i = 0; i < 5; i++) { for (int j = 0; j < 5; j++) { acc += 0.25; if (acc > x.x + 2.0) return acc * 10.0 + i; } } return acc; }" MAIN(
         "return f(x);"),
     e_ret_loop, 0},
    {MAIN(
         "int n = 0; if (x.x < 0.0) { for (int i = 0; i < 3; i++) { float r = rand(); if (r >= 0.0 && r < 1.0) n++; } } else if (rand() < 1.0) n++; return float(n);"),
     e_rand_count, 0},
    {MAIN(
         "int2 p = pixel(); return p.x + 10.0 * p.y + 100.0 * resolution().x + 1000.0 * resolution().y + 10000.0 * sample_index();"),
     e_inputs, 0.1},
    {"param texture2D t = zeros(4, 2, 2);" MAIN(
         "float4 c = t.sample(x); float2 d = t.load(int2(9, -1)); int2 s = t.size(); float4 n = t.nearest(x); return c.a + c.x + d.y + (s.x - 4) + (s.y - 2) + n.z;"),
     e_texture, 0},
};

static void test_programs(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) check_case(&cases[i]);
}

/* Many early returns with declarations between them: the flat form. */
static double e_flat(double x, double y) {
    double s = y;
    for (int i = 0; i < 40; i++) {
        s += i * x;
        if (x * i > 20 + i % 3) return s;
    }
    return -1;
}
static void test_flat(void **state) {
    (void)state;
    static char source[16384];
    size_t at = (size_t)snprintf(source, sizeof source, "float f(float2 x) { float s = x.y;");
    for (int i = 0; i < 40; i++)
        at += (size_t)snprintf(source + at, sizeof source - at,
                               "float t%d = %d.0 * x.x; s += t%d; if (t%d > %d.0) return s;", i, i, i, i, 20 + i % 3);
    snprintf(source + at, sizeof source - at, "return t0 - 1.0; } shader float main(float2 x) { return f(x); }");
    Case c = {source, e_flat, 1e-3};
    check_case(&c);
}

/* ---- textures, values */

static void test_texture_values(void **state) {
    (void)state;
    static const char source[] =
        "param texture2D t = zeros(4, 2, 3); shader float4 main(float2 x) { return t.sample(x); }";
    Session *s = session_create(0);
    Run r = {.source = source, .precision = PREC_F64, .n = 5};
    double xs[5] = {0.125, 0.25, 0.9, -1, 0.125}, ys[5] = {0.75, 0.75, 0.5, 2, 0.5};
    memcpy(r.x[0], xs, sizeof xs), memcpy(r.x[1], ys, sizeof ys);
    session_destroy(s);
    s = run(&r);
    assert_non_null(r.program);
    /* again with texels: value = 100*row + 10*column + channel */
    Program *p = r.program;
    assert_int_equal(p->nfloats, 24);
    for (int i = 0; i < 24; i++) p->init_floats[i] = 100 * (i / 12) + 10 * (i / 3 % 4) + i % 3;
    SltKernelArgs args = {.params = p->init_floats, .iparams = p->init_ints, .n_valid = 5};
    args.in[IN_X0] = r.x[0], args.in[IN_X1] = r.x[1];
    for (int c = 0; c < 4; c++) args.out[c] = r.out[c];
    assert_int_equal(ir_interpret(p->primal, &args, 5, 4), 0);
    double want[5] = {0, 5, 30 + 50, 0, 50};
    for (int i = 0; i < 5; i++) {
        for (int c = 0; c < 3; c++) assert_near(r.out[c][i], want[i] + c, 1e-9);
        assert_near(r.out[3][i], 1, 0);
    }
    session_destroy(s);
}

static void test_heights(void **state) {
    (void)state;
    /* 3 x 2 samples over [0,1]^2; row 0 is y = 1 */
    static const char source[] =
        "[Height(2.0, 1.0)] param heightfield h = zeros(3, 2);\n"
        "shader float4 main(float2 x) { [NoDisc] float2 g = h.gradient(x); return float4(h.height(x), g, h.normal(x).z); }";
    Run r = {.source = source, .precision = PREC_F64, .n = 4};
    double xs[4] = {0.1, 0.4, 0.75, 5}, ys[4] = {0.2, 0.9, 0.25, -3};
    memcpy(r.x[0], xs, sizeof xs), memcpy(r.x[1], ys, sizeof ys);
    Session *s = run(&r);
    diag_print_text(s, stderr, false);
    assert_non_null(r.program);
    Program *p = r.program;
    assert_int_equal(p->nfloats, 6);
    double rows[6] = {3, 5, 4, 0, 1, 2}; /* top: y = 1 */
    memcpy(p->init_floats, rows, sizeof rows);
    SltKernelArgs args = {.params = p->init_floats, .iparams = p->init_ints, .n_valid = 4};
    args.in[IN_X0] = r.x[0], args.in[IN_X1] = r.x[1];
    for (int c = 0; c < 4; c++) args.out[c] = r.out[c];
    assert_int_equal(ir_interpret(p->primal, &args, 4, 4), 0);
    /* cell 0: corners 0 1 3 5; (0.1, 0.2): u = 0.2, v = 0.2, lower triangle: 0 + u*1 + v*3 */
    assert_near(r.out[0][0], 2 * (0.2 + 0.6) + 1, 1e-12);
    assert_near(r.out[1][0], 2 * 1 / 0.5, 1e-12);
    assert_near(r.out[2][0], 2 * 3 / 1.0, 1e-12);
    /* (0.4, 0.9): u = 0.8, v = 0.9, upper: 5 + (1-u)(3-5) + (1-v)(1-5) */
    assert_near(r.out[0][1], 2 * (5 - 0.4 - 0.4) + 1, 1e-12);
    /* cell 1: corners 1 2 5 4; (0.75, 0.25): u = 0.5, v = 0.25 */
    assert_near(r.out[0][2], 2 * (1 + 0.5 + 0.25 * 4) + 1, 1e-12);
    assert_near(r.out[0][3], 2 * 2 + 1, 1e-12);
    session_destroy(s);
}

static void test_counters(void **state) {
    (void)state;
    Run r = {
        .source = MAIN(
            "int n = 0; [MaxIters(3)] for (int i = 0; float(i) < x.x * 4.0; i++) n++; assert(n < 3, \"few\"); return float(n);"),
        .precision = PREC_F64};
    Session *s = run(&r);
    assert_non_null(r.program);
    uint64_t cut = 0, bad = 0;
    for (uint32_t i = 0; i < r.n; i++) {
        double n = ceil(fmax(r.x[0][i] * 4, 0));
        cut += n > 3, bad += n >= 3;
        assert_near(r.out[0][i], fmin(n, 3), 0);
    }
    assert_int_equal(r.counters[SLT_COUNT_TRUNCATED], cut);
    assert_int_equal(r.counters[SLT_COUNT_ASSERT], bad);
    session_destroy(s);
}

/* ---- init(f), names */

static void test_init(void **state) {
    (void)state;
    static const char source[] =
        "struct Disc { float r; float2 c; int k; float w[2]; };\n"
        "Disc make(int i) { Disc d; d.r = 0.5 * i; d.c = float2(i, rand()); d.k = i * i; d.w[0] = 7.0; d.w[1] = -float(i); return d; }\n"
        "float cell(int i, int j) { return 10.0 * i + j; }\n"
        "float noise(int i) { return rand(); }\n"
        "param Disc discs[5] = init(make); param float a[2][3] = init(cell); param float n[64] = init(noise);\n"
        "param float2x2 m = float2x2(1.0, 2.0, 3.0, 4.0); param int3 q = int3(1, 2, 3);\n" MAIN(
            "return discs[1].r + x.x;");
    Run r = {.source = source, .precision = PREC_F64};
    Session *s = run(&r);
    if (!r.program) diag_print_text(s, stderr, false);
    assert_non_null(r.program);
    Program *p = r.program;
    ParamRef ref;
    const char *why = NULL;
    for (int i = 0; i < 5; i++) {
        char name[64];
        snprintf(name, sizeof name, "discs[%d].c.x", i);
        assert_true(program_find(p, name, &ref, &why));
        assert_int_equal(ref.fcount, 1);
        assert_near(p->init_floats[ref.fbase], i, 0);
        assert_true(p->init_floats[ref.fbase + 1] > 0 && p->init_floats[ref.fbase + 1] < 1);
        snprintf(name, sizeof name, "discs[%d].w[1]", i);
        assert_true(program_find(p, name, &ref, &why));
        assert_near(p->init_floats[ref.fbase], -i, 0);
        snprintf(name, sizeof name, "discs[%d].k", i);
        assert_true(program_find(p, name, &ref, &why));
        assert_int_equal(ref.icount, 1);
        assert_int_equal(p->init_ints[ref.ibase], i * i);
    }
    assert_true(program_find(p, "a[1][2]", &ref, &why));
    assert_near(p->init_floats[ref.fbase], 12, 0);
    assert_true(program_find(p, "m[1][0]", &ref, &why));
    assert_near(p->init_floats[ref.fbase], 3, 0);
    assert_true(program_find(p, "q.b", &ref, &why));
    assert_int_equal(p->init_ints[ref.ibase], 3);
    assert_true(program_find(p, "n", &ref, &why));
    double mean = 0;
    for (int i = 0; i < 64; i++) mean += p->init_floats[ref.fbase + i] / 64;
    assert_true(mean > 0.35 && mean < 0.65);
    assert_true(p->init_floats[ref.fbase] != p->init_floats[ref.fbase + 1]);
    assert_false(program_find(p, "disc[1].r", &ref, &why));
    assert_non_null(strstr(why, "`discs`"));
    assert_false(program_find(p, "discs[1].radius", &ref, &why));
    assert_false(program_find(p, "discs[5].r", &ref, &why));
    assert_non_null(strstr(why, "0..4"));
    assert_false(program_find(p, "discs[1", &ref, &why));
    assert_false(program_find(p, "m[0][0][0]", &ref, &why));
    session_destroy(s);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_programs),       cmocka_unit_test(test_flat),
                                       cmocka_unit_test(test_texture_values), cmocka_unit_test(test_heights),
                                       cmocka_unit_test(test_counters),       cmocka_unit_test(test_init)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
