/* Sites, warnings about what is none, and the limits found while inlining. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <string.h>
#include <time.h>

#include "compiler/pass/pass.h"
#include "include/saltus/kernel.h"

typedef struct Build {
    const char *source;
    bool disc_auto;
    Program *program;
} Build;

static void build_body(Session *s, void *user) {
    Build *b = user;
    int file = session_add_text(s, "test.salt", ".", b->source, strlen(b->source));
    ProgramOptions opt = {.precision = PREC_F64};
    opt.front.disc_auto = b->disc_auto;
    b->program = front_compile(s, file, &opt);
    if (b->program) warn_jumps(&(PassCtx){.session = s, .program = b->program}, b->program->primal);
}

static Session *build(Build *b) {
    Session *s = session_create(0);
    assert_non_null(s);
    int status = session_protect(s, build_body, b);
    if (status) print_message("%s\nunwound: %s\n", b->source, s->unwind_text);
    assert_int_equal(status, 0);
    return s;
}

static uint32_t count_code(const Session *s, const char *code, const char *text) {
    uint32_t n = 0;
    for (const Diag *d = s->diags; d; d = d->next)
        if (!strcmp(diag_code_name(d->code), code) && (!text || strstr(d->text, text))) n++;
    return n;
}

/* ---- sites */

typedef struct SiteCase {
    const char *source;
    bool disc_auto;
    uint32_t n;
    SiteKind kind;
    uint32_t depth;
    uint64_t events;
    const char *text, *path;
} SiteCase;

#define MAIN(body) "param float p = 0.5; shader float main(float2 x) {" body "}"

static const SiteCase site_cases[] = {
    {MAIN("[Disc] if (x.x < p) return 1.0; return 0.0;"), false, 1, SITE_COMPARE, 0, 1, "x.x < p", "main"},
    {MAIN(
         "float s = 0.0; for (int i = 0; i < 7; i++) for (int j = 0; j < 3; j++) { [Disc] s += x.x * i < p + j ? 1.0 : 0.0; } return s;"),
     false, 1, SITE_COMPARE, 2, 21, "x.x * i < p + j", "main"},
    {"param float p = 0.5; float f(float a) { [Disc] if (a < p) return 1.0; return 0.0; } shader float main(float2 x) { return f(x.x) + f(x.y); }",
     false, 2, SITE_COMPARE, 0, 1, "a < p", "main > f"},
    {MAIN("[Disc] return floor(x.x * p);"), false, 1, SITE_FLOOR, 0, 1, "floor(x.x * p)", "main"},
    {MAIN("[Disc] float r = frac(x.x * p); return r;"), false, 1, SITE_FLOOR, 0, 1, NULL, NULL},
    {MAIN("[Disc] return ceil(x.x * p);"), false, 1, SITE_CEIL, 0, 1, NULL, NULL},
    {MAIN("[Disc] return round(x.x * p);"), false, 1, SITE_ROUND, 0, 1, NULL, NULL},
    {MAIN("[Disc] return trunc(x.x * p);"), false, 1, SITE_TRUNC, 0, 1, NULL, NULL},
    {MAIN("[Disc] int k = int(x.x * p); return float(k);"), false, 1, SITE_TRUNC, 0, 1, NULL, NULL},
    {MAIN("[Disc] return x.x % p;"), false, 1, SITE_FMOD, 0, 1, NULL, NULL},
    {MAIN("[Disc] return fmod(x.x, p);"), false, 1, SITE_FMOD, 0, 1, NULL, NULL},
    {MAIN("[Disc] return step(p, x.x);"), false, 1, SITE_COMPARE, 0, 1, NULL, NULL},
    {MAIN("[Disc] return sign(x.x - p);"), false, 1, SITE_COMPARE, 0, 1, NULL, NULL},
    {MAIN("[Disc] return atan2(x.x - p, x.y);"), false, 1, SITE_COMPARE, 0, 1, NULL, NULL},
    {MAIN("[Disc] return refract(float2(x.x, p), float2(0.0, 1.0), 1.5).x;"), false, 1, SITE_COMPARE, 0, 1, NULL, NULL},
    {MAIN("[Disc] bool2 h = x < float2(p); return any(h) ? 1.0 : 0.0;"), false, 2, SITE_COMPARE, 0, 1, NULL, NULL},
    {MAIN("[Disc] if (x.x < p && !(x.y > p) || x.x > 0.9) return 1.0; return 0.0;"), false, 3, SITE_COMPARE, 0, 1, NULL,
     NULL},
    {MAIN("float t = x.x; [Disc] [MaxIters(9)] while (t < p) t += 0.1; return t;"), false, 1, SITE_COMPARE, 1, 10,
     "t < p", NULL},
    {"param texture2D t = zeros(4, 4); param float p = 0.0; shader float main(float2 x) { [Disc] float4 c = t.nearest(x + p); return c.x; }",
     false, 2, SITE_FLOOR, 0, 1, NULL, NULL},
    {MAIN("if (x.x < p) return floor(x.y * p); [NoDisc] if (x.y < p) return 2.0; return x.x == p ? 1.0 : 0.0;"), true,
     2, SITE_COMPARE, 0, 1, NULL, NULL},
    {MAIN(
         "bool hit = false; for (int k = 0; k < 4; k++) { for (int i = 0; i < 9; i++) [Disc, SkipLoop] if (x.x * i < p + k) hit = true; } return hit ? 1.0 : 0.0;"),
     false, 1, SITE_COMPARE, 0, 1, NULL, NULL},
    {"param float p = 0.5; float f(float a) { bool hit = false; for (int i = 0; i < 9; i++) [Disc, SkipLoop] if (a * i < p) hit = true; return hit ? 1.0 : 0.0; }"
     "shader float main(float2 x) { float s = 0.0; for (int k = 0; k < 4; k++) s += f(x.x + k); return s; }",
     false, 1, SITE_COMPARE, 1, 4, NULL, NULL},
    {MAIN(
         "float c = 0.0; for (int i = 0; i < 9; i++) [Disc, SkipLoop] if (x.x * i < p) { [Disc] if (x.y < p) c = 1.0; } return c;"),
     false, 2, SITE_COMPARE, 0, 1, NULL, NULL},
};

static void test_sites(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof site_cases / sizeof *site_cases; i++) {
        const SiteCase *c = &site_cases[i];
        Build b = {.source = c->source, .disc_auto = c->disc_auto};
        Session *s = build(&b);
        if (!b.program) diag_print_text(s, stderr, false);
        assert_non_null(b.program);
        const Fn *fn = b.program->primal;
        if (fn->nsites != c->n) print_message("%s: %u sites, expected %u\n", c->source, fn->nsites, c->n);
        assert_int_equal(fn->nsites, c->n);
        assert_int_equal(fn->sites[0].kind, c->kind);
        assert_int_equal(fn->sites[0].depth, c->depth);
        assert_int_equal(fn->sites[0].max_events, c->events);
        if (c->text) assert_string_equal(fn->sites[0].text, c->text);
        if (c->path) assert_string_equal(fn->sites[0].path, c->path);
        assert_int_equal(count_code(s, "W0401", NULL), 0);
        session_destroy(s);
    }
}

/* Finds the only site and makes its decision and boundary function the outputs. */
static Inst *find_site(Block *b) {
    for (Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_site) return i;
        for (uint32_t r = 0; r < i->nregions; r++) {
            Inst *found = find_site(i->region[r]);
            if (found) return found;
        }
    }
    return NULL;
}

/* The decision is "true in any iteration", and g changes sign exactly there, continuously. */
static void test_skip_boundary(void **state) {
    (void)state;
    static const char *const sources[] = {
        "param float p = 0.3; shader float main(float2 x) { bool hit = false; for (int i = 0; i < 4; i++) { float d = abs(x.x - 0.25 * i) - p * 0.2; [Disc, SkipLoop] if (d < 0.0) hit = true; } return hit ? 1.0 : 0.0; }",
        "param float p = 0.3; shader float main(float2 x) { bool hit = false; for (int i = 0; i < 4; i++) { float d = x.x - 0.25 * i; [Disc, SkipLoop] if (d < p * 0.2 && !(d <= -p * 0.2)) { hit = true; } } return hit ? 1.0 : 0.0; }",
        "param float p = 0.3; shader float main(float2 x) { bool hit = false; int n = 4; [MaxIters(4)] for (int i = 0; i < n; i++) { float d = p * 0.2 - abs(x.x - 0.25 * i); if (i >= 0) { [Disc, SkipLoop] if (d > 0.0) { hit = true; n = 4; } } } return hit ? 1.0 : 0.0; }",
    };
    for (int k = 0; k < 3; k++) {
        Build b = {.source = sources[k]};
        Session *s = build(&b);
        if (!b.program) diag_print_text(s, stderr, false);
        assert_non_null(b.program);
        Fn *fn = b.program->primal;
        Inst *site = find_site(fn->body);
        assert_non_null(site);
        assert_true(fn->sites[0].skip_loop);
        assert_ptr_equal(site->block, fn->body);
        Inst *outs[2] = {site->args[1], fn->body->last->args[0]};
        ir_unlink(fn->body->last);
        Builder end = ir_at_end(fn, fn->body);
        outs[1] = ir_select(&end, site, ir_constf(&end, 1), ir_constf(&end, 0));
        ir_yield(&end, 2, outs);
        enum { N = 400 };
        static double x[N + SLT_PAD], y[N + SLT_PAD], g[N + SLT_PAD], d[N + SLT_PAD];
        for (int i = 0; i < N; i++) x[i] = -0.2 + 1.2 * (i + 0.5) / N;
        SltKernelArgs args = {.params = b.program->init_floats, .iparams = b.program->init_ints, .n_valid = N};
        args.in[IN_X0] = x, args.in[IN_X1] = y, args.out[0] = g, args.out[1] = d;
        assert_int_equal(ir_interpret(fn, &args, N, 16), 0);
        int flips = 0;
        for (int i = 0; i < N; i++) {
            double nearest = 1e9;
            for (int j = 0; j < 4; j++) nearest = fmin(nearest, fabs(x[i] - 0.25 * j));
            int hit = nearest < 0.06;
            assert_int_equal((int)d[i], hit);
            assert_int_equal(g[i] > 0, hit);
            if (i > 0 && (d[i] != d[i - 1])) {
                flips++;
                assert_true(fabs(g[i] - g[i - 1]) < 0.004);
            }
        }
        assert_int_equal(flips, 8);
        session_destroy(s);
    }
}

/* ---- warnings */

typedef struct WarnCase {
    const char *source, *code, *text; /* NULL code: no warning at all */
    uint32_t n;
} WarnCase;

#define WMAIN(body) "param float p = 0.5; param float q = 0.25; [NoDiff] param float k = 1.0; param int n = 3; shader float main(float2 x) {" body "}"

static const WarnCase warn_cases[] = {
    {WMAIN("if (x.x < p) return 1.0; return 0.0;"), "W0401", "`p`", 1},
    {WMAIN("return x.x < p * q ? 1.0 : 0.0;"), "W0401", "`p` and `q`", 1},
    {WMAIN("return floor(x.x * p);"), "W0401", "`p`", 1},
    {WMAIN("return frac(x.x * p);"), "W0401", "`p`", 1},
    {WMAIN("return step(p, x.x);"), "W0401", "`p`", 1},
    {WMAIN("return float(int(x.x + p));"), "W0401", "`p`", 1},
    {WMAIN("return float(asuint(x.x * p));"), "W0401", "cannot be a site", 1},
    {WMAIN("int m = 0; [MaxIters(9)] while (x.x * m < p) m++; return float(m);"), "W0401", "`p`", 1},
    {WMAIN("float a[2]; if (x.x < p) a[0] = 1.0; return a[0];"), "W0401", "`p`", 1},
    {"param float p = 0.5; float f(float a) { return a < p ? 1.0 : 0.0; } shader float main(float2 x) { return f(x.x) + f(x.y); }",
     "W0401", "`p`", 1},
    {WMAIN("if (x.x < 0.5) return p; return q;"), NULL, NULL, 0},
    {WMAIN("if (x.x < k) return p; return q;"), NULL, NULL, 0},
    {WMAIN("[NoDisc] if (x.x < p) return 1.0; return 0.0;"), NULL, NULL, 0},
    {"param float p = 0.5; [NoDisc] float f(float a) { return a < p ? 1.0 : 0.0; } shader float main(float2 x) { return f(x.x); }",
     NULL, NULL, 0},
    {WMAIN("bool unused = x.x < p; float r = floor(x.y * p); return x.y;"), NULL, NULL, 0},
    {WMAIN("assert(x.x < p + 10.0); print(\"d\", x.x < p); return x.y;"), NULL, NULL, 0},
    {WMAIN("return max(x.x, p) + min(x.y, p) + abs(x.x - p) + clamp(x.x, p, 1.0) + saturate(x.x * p);"), NULL, NULL, 0},
    {WMAIN("return x.x < p ? x.x : p;"), NULL, NULL, 0},
    {WMAIN("float d = x.x - p; return d < 0.0 ? -d : d;"), NULL, NULL, 0},
    {WMAIN("float d = x.x - p; if (d < 0.0) d = 0.0; return d;"), NULL, NULL, 0},
    {WMAIN("float d = x.x - p; return d > 0.0 ? d * q : 0.0;"), NULL, NULL, 0},
    {WMAIN("float d = x.x - p; float r = q; if (d > 0.0) { r = q + d * 3.0; } return r;"), NULL, NULL, 0},
    {WMAIN("float d = x.x - p; if (!(d >= 0.0)) return d * d; return sin(d);"), NULL, NULL, 0},
    {WMAIN("float d = x.x - p; return d < 0.0 ? -d : d + 0.1;"), "W0401", "`p`", 1},
    {WMAIN("float d = x.x - p; return d > 0.0 && x.y > 0.0 ? d : 0.0;"), NULL, NULL, 0}, /* where it moves f is 0 */
    {WMAIN("float d = x.x - p; return d > 0.0 && x.y > 0.0 ? d + 0.1 : 0.0;"), "W0401", "`p`", 1},
    {WMAIN("return rand() < p ? 1.0 : x.x;"), "W0402", "`p`", 1},
    {WMAIN("return isnan(sqrt(x.x - p)) ? 1.0 : x.y;"), "W0401", "`p`", 1},
    {WMAIN("return cos(atan2(x.y - p, x.x));"), NULL, NULL, 0},
    {WMAIN("float t = 4.0 * x.x + p; return floor(t) + frac(t);"), NULL, NULL, 0},
    {WMAIN("[Disc] if (p < q) return 1.0; return x.x;"), "W0402", "`p` and `q`", 1},
    {WMAIN("[Disc] if (rand() < 0.5) return 1.0; return x.x;"), "W0402", "random numbers", 1},
    {WMAIN("[Disc] if (rand() * x.x < p) return 1.0; return x.x;"), NULL, NULL, 0},
    {WMAIN("return x.x == p ? 1.0 : x.y;"), NULL, NULL, 0},
    {WMAIN("return length(x - p) + normalize(x - p).x;"), NULL, NULL, 0},
};

static void test_warnings(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof warn_cases / sizeof *warn_cases; i++) {
        const WarnCase *c = &warn_cases[i];
        Build b = {.source = c->source};
        Session *s = build(&b);
        bool good = b.program && s->nerrors == 0;
        good = good && (c->code ? count_code(s, c->code, c->text) == c->n && s->nwarnings == c->n : s->nwarnings == 0);
        if (!good) {
            print_message("%s\nexpected %u of %s\n", c->source, c->n, c->code ? c->code : "nothing");
            diag_print_text(s, stderr, false);
        }
        assert_true(good);
        session_destroy(s);
    }
}

/* ---- errors found while inlining */

typedef struct ErrorCase {
    const char *source, *code, *text;
} ErrorCase;

static const ErrorCase error_cases[] = {
    {"param int n = 3; float f(int m) { float s = 0.0; for (int i = 0; i < m; i++) s += 1.0; return s; } shader float main(float2 x) { return f(3) + f(n); }",
     "E0310", NULL},
    {"float f(int m) { float s = 0.0; for (int i = 0; i < m; i++) s += 1.0; return s; } shader float main(float2 x) { return f(20000000); }",
     "E0311", "20000000"},
    {"float df(float a, float da) { return da * da; } [Tangent(df)] float f(float a) { return a; } shader float main(float2 x) { return f(x.x); }",
     "E0420", "product of two tangents"},
    {"float df(float a, float da) { return da + 1.0; } [Tangent(df)] float f(float a) { return a; } shader float main(float2 x) { return f(x.x); }",
     "E0420", "sum"},
    {"float df(float a, float da) { return a; } [Tangent(df)] float f(float a) { return a; } shader float main(float2 x) { return f(x.x); }",
     "E0420", "without a tangent"},
    {"float df(float a, float da) { return abs(da); } [Tangent(df)] float f(float a) { return a; } shader float main(float2 x) { return f(x.x); }",
     "E0420", "not linear"},
    {"float df(float a, float da) { if (da > 0.0) return da; return 0.0; } [Tangent(df)] float f(float a) { return a; } shader float main(float2 x) { return f(x.x); }",
     "E0420", NULL},
    {"float df(float a, float da) { return a / da; } [Tangent(df)] float f(float a) { return a; } shader float main(float2 x) { return f(x.x); }",
     "E0420", "division"},
    {"[Height(-1.0, 0.0)] param heightfield h = zeros(4, 4); shader float main(float2 x) { Hit v = h.trace(float3(x, 1.0), float3(0.0, 0.0, -1.0), 0.0, 9.0); return v.t; }",
     "E0503", "trace"},
    {MAIN(
         "float s = 0.0; for (int a = 0; a < 2; a++) for (int b = 0; b < 2; b++) for (int c = 0; c < 2; c++) for (int d = 0; d < 2; d++) for (int e = 0; e < 2; e++) for (int f = 0; f < 2; f++)"
         " for (int g = 0; g < 2; g++) for (int h = 0; h < 2; h++) for (int i = 0; i < 2; i++) { [Disc] s += x.x < p ? 1.0 : 0.0; } return s;"),
     "E0502", "9 loops"},
};

static void test_errors(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof error_cases / sizeof *error_cases; i++) {
        const ErrorCase *c = &error_cases[i];
        Build b = {.source = c->source};
        Session *s = build(&b);
        if (b.program || count_code(s, c->code, c->text) != 1) {
            print_message("%s\nexpected %s\n", c->source, c->code);
            diag_print_text(s, stderr, false);
        }
        assert_null(b.program);
        assert_int_equal(count_code(s, c->code, c->text), 1);
        session_destroy(s);
    }
}

/* 25 functions that call the one before twice: an error with the call tree, at once. */
static void test_limit(void **state) {
    (void)state;
    static char source[8192];
    size_t at = (size_t)snprintf(source, sizeof source, "float f0(float a) { return a * 2.0 + 1.0; }\n");
    for (int i = 1; i < 25; i++)
        at += (size_t)snprintf(source + at, sizeof source - at,
                               "float f%d(float a) { return f%d(a) + f%d(a * 0.5); }\n", i, i - 1, i - 1);
    snprintf(source + at, sizeof source - at, "shader float main(float2 x) { return f24(x.x); }\n");
    Build b = {.source = source};
    clock_t start = clock();
    Session *s = build(&b);
    double seconds = (double)(clock() - start) / CLOCKS_PER_SEC;
    assert_null(b.program);
    assert_int_equal(count_code(s, "E0501", NULL), 1);
    assert_true(seconds < 1.0);
    uint32_t notes = 0;
    bool counts = false;
    for (const DiagNote *n = s->diags->notes; n; n = n->next)
        notes++, counts |= strstr(n->text, "16777216 times") != NULL;
    assert_true(notes >= 8);
    assert_true(counts);
    session_destroy(s);
    /* one level below the limit compiles */
    at = (size_t)snprintf(source, sizeof source, "float f0(float a) { return a * 2.0 + 1.0; }\n");
    for (int i = 1; i < 15; i++)
        at += (size_t)snprintf(source + at, sizeof source - at,
                               "float f%d(float a) { return f%d(a) + f%d(a * 0.5); }\n", i, i - 1, i - 1);
    snprintf(source + at, sizeof source - at, "shader float main(float2 x) { return f14(x.x); }\n");
    b = (Build){.source = source};
    s = build(&b);
    assert_non_null(b.program);
    session_destroy(s);
}

/* ---- [Cull] */
static void test_cull(void **state) {
    (void)state;
    Build b = {
        .source =
            "param float r[5] = { 0.1, 0.2, 0.3, 0.4, 0.5 }; float4 bounds(int i) { return float4(-r[i], -1.0, r[i], 1.0); }\n"
            "shader float main(float2 x) { float c = 0.0; [Cull(bounds)] for (int i = 0; i < 5; i++) { [Disc] if (abs(x.x) < r[i]) c += 1.0; } return c; }"};
    Session *s = build(&b);
    if (!b.program) diag_print_text(s, stderr, false);
    assert_non_null(b.program);
    assert_int_equal(b.program->ncull, 1);
    Fn *fn = b.program->cull_bounds[0];
    int32_t k[4 + SLT_PAD] = {0, 1, 4, 2};
    double out[4][4 + SLT_PAD];
    SltKernelArgs args = {.params = b.program->init_floats, .iparams = b.program->init_ints, .n_valid = 4};
    args.in[IN_ITERATION] = k;
    for (int c = 0; c < 4; c++) args.out[c] = out[c];
    assert_int_equal(ir_interpret(fn, &args, 4, 4), 0);
    assert_true(out[0][2] == -0.5 && out[2][1] == 0.2 && out[3][3] == 1);
    session_destroy(s);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_sites),    cmocka_unit_test(test_skip_boundary),
                                       cmocka_unit_test(test_warnings), cmocka_unit_test(test_errors),
                                       cmocka_unit_test(test_limit),    cmocka_unit_test(test_cull)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
