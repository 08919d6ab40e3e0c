/* The checker around the rules: modules, overrides, entries, values and bounds it leaves in the tree, and its cost on
 * programs made to be expensive. */
#include <time.h>

#include "tests/scratch.h"

#include "compiler/front/ast.h"
#include "tests/printed.h"

typedef struct Job {
    const char *path, *source;
    FrontOptions opt;
    Module *module;
    Func *entry;
    char errors[512];
} Job;

static bool probe(void *user, const char *path, const Symbol *of, uint32_t dims[4], uint32_t *ndims, const char **why) {
    (void)of;
    *(const char **)user = path;
    if (strstr(path, "none")) {
        *why = "No such file or directory";
        return false;
    }
    dims[0] = 7, dims[1] = 2;
    *ndims = 2;
    return true;
}

static void body(Session *s, void *arg) {
    Job *j = arg;
    const char *why = NULL;
    int file = j->path ? session_add_file(s, j->path, &why)
                       : session_add_text(s, "t.salt", "/assets", j->source, strlen(j->source));
    if (file < 0) session_limit(s, "%s", why);
    j->module = load_modules(s, file);
    j->entry = check_program(s, j->module, &j->opt);
}

/* Checks; errors as "CODE CODE …" in order of report. */
static Session *check(Job *j) {
    Session *s = session_create(0);
    assert_int_equal(session_protect(s, body, j), 0);
    j->errors[0] = 0;
    for (Diag *d = s->diags; d; d = d->next)
        if (d->severity == SEV_ERROR && strlen(j->errors) < 480) {
            if (j->errors[0]) strcat(j->errors, " ");
            strcat(j->errors, diag_code_name(d->code));
        }
    return s;
}

static void expect(const char *source, FrontOptions opt, const char *errors) {
    Job j = {.source = source, .opt = opt};
    Session *s = check(&j);
    if (strcmp(j.errors, errors)) diag_print_text(s, stderr, false);
    assert_string_equal(j.errors, errors);
    session_destroy(s);
}

static Symbol *const_named(Module *m, const char *name) {
    for (Symbol *c = m->consts; c; c = c->next)
        if (!strcmp(c->name, name)) return c;
    return NULL;
}
static Symbol *param_named(Module *m, const char *name) {
    for (Symbol *c = m->params; c; c = c->next)
        if (!strcmp(c->name, name)) return c;
    return NULL;
}
static Func *func_named(Module *m, const char *name) {
    for (Func *f = m->funcs; f; f = f->next)
        if (!strcmp(f->name, name)) return f;
    return NULL;
}

#define MAIN "shader float main(float2 x) { return 0.0; }\n"

/* ---- constants */

static void test_values(void **state) {
    (void)state;
    Job j = {
        .source =
            "const float a = 1.0 / 3.0; const int b = -7 / 2; const int c = -7 % 3; const uint d = 0u - 1u; const int e = 1 << 33;\n"
            "const int f = -8 >> 1; const float3 g = float3(1, 2, 3).zyx * 2; const float2x2 h = inverse(float2x2(2, 0, 0, 4));\n"
            "const float i = dot(g, float3(1, 0, 1)); const bool k = any(g > 5.0); const int l = int(1e20); const int m = int(-2.7);\n"
            "const float n = smoothstep(0.0, 2.0, 1.0) + clamp(5, 0, 1) + lerp(1.0, 3.0, 0.25); const float2 o = float2x2(1, 2, 3, 4) * float2(1, 1);\n"
            "const float p = determinant(float3x3(2, 0, 0, 0, 3, 0, 0, 0, 4)); const uint q = asuint(1.0); const float r = asfloat(0x40000000);\n"
            "const float s = round(2.5) + floor(-0.5) + frac(-0.25) + fmod(-5.5, 2.0) + step(1.0, 1.0);\n" MAIN};
    Session *s = check(&j);
    assert_string_equal(j.errors, "");
#define F_(name, at, value) assert_float_equal(const_named(j.module, name)->cval.v[at].f, value, 1e-14)
#define I_(name, value) assert_int_equal(const_named(j.module, name)->cval.v[0].i, value)
    F_("a", 0, 1.0 / 3.0);
    I_("b", -3);
    I_("c", -1);
    I_("d", 4294967295);
    I_("e", 2);
    I_("f", -4);
    F_("g", 0, 6);
    F_("g", 2, 2);
    F_("h", 0, 0.5);
    F_("h", 3, 0.25);
    F_("i", 0, 8);
    I_("k", 1);
    I_("l", 2147483647);
    I_("m", -2);
    F_("n", 0, 0.5 + 1 + 1.5);
    F_("o", 0, 3);
    F_("o", 1, 7);
    F_("p", 0, 24);
    I_("q", 0x3f800000);
    F_("r", 0, 2);
    F_("s", 0, 2 - 1 + 0.75 - 1.5 + 1);
    session_destroy(s);
}

static void test_overrides(void **state) {
    (void)state;
    static const struct {
        const char *name, *text, *errors;
        bool usage;
    } rows[] = {
        {"N", "5", "", false},       {"N", "0x10", "", false},    {"N", "-1", "E0125", false},
        {"N", "5.0", "E0129", true}, {"N", "5u", "E0129", true},  {"N", "", "E0129", true},
        {"B", "true", "", false},    {"B", "1", "E0129", true},   {"U", "7u", "", false},
        {"U", "-7", "E0129", true},  {"F", "2", "", false},       {"F", "1e-3", "", false},
        {"F", "nan", "E0129", true}, {"V", "1.0", "E0129", true}, {"N", "4294967296", "E0129", true},
        {"Q", "1", "", false},       {"m.N", "5", "", false},
    };
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        ConstOverride o = {.name = rows[i].name, .text = rows[i].text};
        Job j = {
            .source =
                "const int N = 3; const bool B = false; const uint U = 1u; const float F = 1.0; const float2 V = 1.0; const int M = N * 2;\n"
                "float f() { float a[N]; return a[0]; }\n" MAIN,
            .opt = {.overrides = &o, .noverrides = 1}};
        Session *s = check(&j);
        assert_string_equal(j.errors, rows[i].errors);
        assert_int_equal(s->bad_usage, rows[i].usage);
        assert_int_equal(o.used, strlen(rows[i].name) == 1 && rows[i].name[0] != 'Q');
        if (!i) assert_int_equal(const_named(j.module, "M")->cval.v[0].i, 10); /* what is computed from it follows */
        session_destroy(s);
    }
}

static void test_epsilon(void **state) {
    (void)state;
    for (int f64 = 0; f64 < 2; f64++) {
        Job j = {.source = "const float e = EPSILON;\n" MAIN, .opt = {.f64 = f64}};
        Session *s = check(&j);
        assert_true(const_named(j.module, "e")->cval.v[0].f == (f64 ? 0x1p-52 : 0x1p-23));
        session_destroy(s);
    }
}

/* ---- entries */

static void test_entries(void **state) {
    (void)state;
    const char *two = "shader float a(float x) { return x; } shader float b(float2 x) { return x.x; }\n";
    Job j = {.source = two, .opt = {.entry = "b"}};
    Session *s = check(&j);
    assert_string_equal(j.entry->name, "b");
    assert_int_equal(j.entry->dim, 2);
    assert_true(j.entry->lo[1] == 0 && j.entry->hi[1] == 1);
    session_destroy(s);
    Job k = {.source = two, .opt = {.entry = "c"}};
    s = check(&k);
    assert_string_equal(k.errors, "E0214");
    assert_true(s->bad_usage);
    assert_null(k.entry);
    session_destroy(s);
    Job d = {.source =
                 "const float W = 2.0; [Domain(-W, float2(1.0, W))] shader float3 main(float2 x) { return 0.0; }\n"};
    s = check(&d);
    assert_string_equal(d.errors, "");
    assert_true(d.entry->lo[0] == -2 && d.entry->lo[1] == -2 && d.entry->hi[0] == 1 && d.entry->hi[1] == 2);
    session_destroy(s);
}

/* ---- parameters */

static void test_assets(void **state) {
    (void)state;
    const char *seen = NULL;
    FrontOptions opt = {.probe = probe, .probe_user = &seen};
    Job j = {.source = "param float2 v[] = \"data/v.npy\"; param texture2D t = zeros(4, 5);\n" MAIN, .opt = opt};
    Session *s = check(&j);
    assert_string_equal(j.errors, "");
    assert_string_equal(seen, "/assets/data/v.npy");
    assert_string_equal(param_named(j.module, "v")->type->name, "float2[7]");
    assert_int_equal(param_named(j.module, "t")->tex_w, 4);
    assert_int_equal(param_named(j.module, "t")->tex_h, 5);
    assert_int_equal(param_named(j.module, "t")->tex_c, 4);
    session_destroy(s);
    Job k = {.source = "param float2 v[] = \"none.npy\";\n" MAIN, .opt = opt};
    s = check(&k);
    assert_string_equal(k.errors, "E0303");
    assert_true(s->bad_input);
    session_destroy(s);
    ParamFile file = {.name = "v", .path = "here.npy"}; /* --param v=@here.npy stands in for the missing file */
    Job o = {.source = k.source, .opt = opt};
    o.opt.files = &file;
    o.opt.nfiles = 1;
    s = check(&o);
    assert_string_equal(o.errors, "");
    assert_string_equal(seen, "here.npy");
    assert_true(file.used);
    assert_int_equal(param_named(o.module, "v")->type->n, 7);
    session_destroy(s);
    Job none = {.source = "param float2 v[] = \"v.npy\";\n" MAIN}; /* no probe at all */
    s = check(&none);
    assert_string_equal(none.errors, "E0303");
    session_destroy(s);
}

/* ---- loops */

static void test_bounds(void **state) {
    (void)state;
    static const struct {
        const char *header;
        int64_t bound;
        bool exact;
        int64_t count;
    } rows[] = {
        {"for (int i = 0; i < 10; i++)", 10, true, 10},
        {"for (int i = 0; i <= 10; i += 3)", 4, true, 4},
        {"for (int i = 10; i > 0; i -= 3)", 4, true, 4},
        {"for (int i = 10; i >= 0; i--)", 11, true, 11},
        {"for (uint i = 0u; i < 7u; i++)", 7, true, 7},
        {"for (int i = 0; i != 12; i += 4)", 3, true, 3},
        {"for (int i = 1; i < 100; i *= 3)", 5, true, 5},
        {"for (int i = 100; i > 0; i /= 2)", 7, true, 7},
        {"for (int i = 256; i != 0; i >>= 2)", 5, true, 5},
        {"for (int i = 5; i < 3; i++)", 1, true, 0},
        {"for (int i = 0; i < 10 && a > 0.0; i++)", 10, true, 0},
        {"[MaxIters(4)] for (int i = 0; i < 10; i++)", 4, false, 4},
        {"[MaxIters(40)] for (int i = 0; i < 10; i++)", 10, true, 10},
        {"[MaxIters(9)] while (a > 0.0)", 9, false, 0},
        {"[MaxIters(9)] while (true)", 9, false, 9},
        {"for (int i = 0; i < n; i++)", 0, false, 0},
        {"for (int i = 0; i < min(n, 6); i++)", 6, true, 0},
        {"for (int i = 0; i < 6 * 2 - 1; i++)", 11, true, 11},
        {"for (int i = 3; 3 + 5 > i; i = 1 + i)", 5, true, 5},
        {"for (int i = -2147483647; i < -2147483640; i++)", 7, true, 7},
    };
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        char source[512];
        snprintf(source, sizeof source, "float f(float a, int n) { %s { a += 1.0; } return a; }\n" MAIN,
                 rows[i].header);
        Job j = {.source = source};
        Session *s = check(&j);
        assert_string_equal(j.errors, "");
        Stmt *loop = func_named(j.module, "f")->body->stmts[0];
        if (loop->trip_bound != rows[i].bound || loop->trip_exact != rows[i].exact || loop->trip_count != rows[i].count)
            fail_msg("%s: %lld %d %lld", rows[i].header, (long long)loop->trip_bound, loop->trip_exact,
                     (long long)loop->trip_count);
        session_destroy(s);
    }
    /* inner loops by the counters of outer ones */
    Job j = {
        .source =
            "float f() { for (int i = 0; i < 5; i++) for (int j = i; j <= 2 * i + 1; j++) { } return 1.0; }\n" MAIN};
    Session *s = check(&j);
    assert_string_equal(j.errors, "");
    Stmt *inner = func_named(j.module, "f")->body->stmts[0]->body;
    assert_true(inner->trip_bound >= 6 && inner->trip_bound <= 10 && inner->trip_exact);
    session_destroy(s);
}

/* ---- modules */

static void test_modules(void **state) {
    (void)state;
    scratch_put(
        "a.salt",
        "import deep;\nconst int N = 2; param float p = 1.0; float f(float v) { return v * deep_f(); } float g(int v) { return 1.0; } struct S { float s; };\n");
    scratch_put(
        "b.salt",
        "float f(float v) { return v; } float g(float v) { return v; } float saturate(float v) { return v; } const int K = 1;\n");
    scratch_put("deep.salt", "float deep_f() { return 2.0; } const int N = 9;\n");
    static const struct {
        const char *source, *errors;
    } rows[] = {
        {"import a;\n float h() { S s = { p }; float w[N]; return f(1.0) + s.s + w[0]; }\n" MAIN, ""},
        {"import a; import b;\n float h() { return 1.0; }\n" MAIN, ""},
        {"import a; import b;\n float h() { return f(1.0); }\n" MAIN, "E0104"},
        {"import a; import b;\n float h() { return g(1); }\n" MAIN, "E0104"}, /* overload sets do not merge */
        {"import a; import b;\n float f(float v) { return v; } float h() { return f(1.0); }\n" MAIN, ""},
        {"import a;\n float h() { return deep_f(); }\n" MAIN, "E0101"}, /* not transitive */
        {"import b;\n float h() { return saturate(2.0) + saturate(float2(1.0)).x; }\n" MAIN,
         "E0107"}, /* a user's name wins over the builtin */
        {"import nothing;\n float h() { bool b = other(1.0); K k; return sin(1.0) + PI + L; }\n" MAIN,
         "E0020"}, /* what may come from there is not reported */
        {"import nothing;\n float h() { return sin(true); }\n" MAIN, "E0020 E0119"},
        {"import a; import a;\n float h() { return f(p); }\n" MAIN, ""},
        {"import a;\n const int N = 5; float h() { float w[N]; float v[5]; v = w; return 1.0; }\n" MAIN, ""},
    };
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        scratch_put("main.salt", rows[i].source);
        Job j = {.path = scratch_path("main.salt")};
        Session *s = check(&j);
        if (strcmp(j.errors, rows[i].errors)) diag_print_text(s, stderr, false);
        assert_string_equal(j.errors, rows[i].errors);
        session_destroy(s);
    }
    scratch_put("main.salt", rows[0].source);
    ConstOverride o[2] = {{.name = "a.N", .text = "4"}, {.name = "N", .text = "4"}};
    Job j = {.path = scratch_path("main.salt"), .opt = {.overrides = o, .noverrides = 2}};
    Session *s = check(&j);
    assert_string_equal(j.errors, "");
    assert_true(o[0].used && !o[1].used);
    Module *a = j.module->imports[0].module;
    assert_int_equal(const_named(a, "N")->cval.v[0].i, 4);
    assert_string_equal(param_named(a, "p")->doc_name, "a.p");
    session_destroy(s);
}

/* ---- messages */

static void expect_text(const char *source, const char *part) {
    Job j = {.source = source};
    Session *s = check(&j);
    char *text = printed(s, print_text);
    if (!strstr(text, part)) fail_msg("no `%s` in\n%s", part, text);
    free(text);
    session_destroy(s);
}

static void test_messages(void **state) {
    (void)state;
    expect_text("float f(float radius) { return radus; }\n" MAIN, "did you mean `radius`?");
    expect_text("float f() { return smoothstp(0.0, 1.0, 0.5); }\n" MAIN, "did you mean `smoothstep`?");
    expect_text("struct Disc { float r; }; float f(Disk d) { return 1.0; }\n" MAIN, "did you mean `Disc`?");
    expect_text("float f(float a) { int i = a; return 1.0; }\n" MAIN, "cannot convert float to int: write `int(...)`");
    expect_text("float f(float2 a) { return a; }\n" MAIN,
                "cannot convert float2 to float: take one component, as `.x`");
    expect_text("float f() { return g(); } float g() { return h(); } float h() { return f(); }\n" MAIN,
                "f -> g -> h -> f");
    expect_text("float f(int a) { return 1.0; } float f(float2 a) { return 1.0; } float g() { return f(true); }\n" MAIN,
                "candidate: `float f(float2)`");
    expect_text("float f(float d) { bool hit = d < 0.0; [Disc] if (hit) return 1.0; return 0.0; }\n" MAIN,
                "t.salt:1:33: note: the value was computed here");
    expect_text(
        "bool g(float d) { return d < 0.0; } float f(float d) { [Disc] if (g(d)) return 1.0; return 0.0; }\n" MAIN,
        "t.salt:1:28: note: the comparison is in `g`");
    expect_text("param int n = 3; float f() { for (int i = 0; i < n; i++) { } return 1.0; }\n" MAIN,
                "`n` is a parameter");
    expect_text("float f() { for (int i = 0; i < 5; i++) { i = 0; } return 1.0; }\n" MAIN,
                "`i` is changed in more than one place");
}

/* ---- cost */

static double seconds(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void expect_fast(char *source, const char *errors) {
    double start = seconds();
    Job j = {.source = source};
    Session *s = session_create(0);
    int status = session_protect(s, body, &j);
    if (errors) assert_int_equal(status, 0);
    if (errors) assert_int_equal(s->nerrors, (uint32_t)atoi(errors));
    session_destroy(s);
    assert_true(seconds() - start < 8.0);
    free(source);
}

static void test_cost(void **state) {
    (void)state;
    size_t cap = 4 << 20, n = 0;
    char *text = malloc(cap);
    /* every function calls the one before twice */
    n = (size_t)snprintf(text, cap, "float f0(float a) { return a; }\n");
    for (int i = 1; i <= 1000; i++)
        n += (size_t)snprintf(text + n, cap - n, "float f%d(float a) { return f%d(a) + f%d(a * 2.0); }\n", i, i - 1,
                              i - 1);
    snprintf(text + n, cap - n, MAIN);
    expect_fast(text, "0");
    /* structs that double each other */
    text = malloc(cap);
    n = (size_t)snprintf(text, cap, "struct S0 { float a; };\n");
    for (int i = 1; i <= 60; i++)
        n += (size_t)snprintf(text + n, cap - n, "struct S%d { S%d a; S%d b; };\n", i, i - 1, i - 1);
    snprintf(text + n, cap - n, MAIN);
    expect_fast(text, "1");
    /* many locals, many branches */
    text = malloc(cap);
    n = (size_t)snprintf(text, cap, "float f(float a) { float s = 0.0;\n");
    for (int i = 0; i < 3000; i++)
        n += (size_t)snprintf(text + n, cap - n, "float v%d; if (a > %d.0) v%d = 1.0; else v%d = 2.0; s += v%d;\n", i,
                              i, i, i, i);
    snprintf(text + n, cap - n, "return s; }\n" MAIN);
    expect_fast(text, "0");
    /* constants in the wrong order: each asks for the next (a chain too long is a limit, not a crash) */
    text = malloc(cap);
    n = 0;
    for (int i = 0; i < 20000; i++) n += (size_t)snprintf(text + n, cap - n, "const int C%d = C%d + 1;\n", i, i + 1);
    snprintf(text + n, cap - n, "const int C20000 = 0;\n" MAIN);
    expect_fast(text, NULL);
    /* a chain of calls as long as a file, closed to a circle */
    text = malloc(cap);
    n = 0;
    for (int i = 0; i < 20000; i++)
        n += (size_t)snprintf(text + n, cap - n, "float f%d() { return f%d(); }\n", i, i + 1);
    snprintf(text + n, cap - n, "float f20000() { return f0(); }\n" MAIN);
    expect_fast(text, "1");
    /* a long table */
    text = malloc(cap);
    n = (size_t)snprintf(text, cap, "const float T[40000] = { ");
    for (int i = 0; i < 40000; i++) n += (size_t)snprintf(text + n, cap - n, "%s%d.5", i ? ", " : "", i);
    snprintf(text + n, cap - n, " };\nconst float K = T[39999];\n" MAIN);
    expect_fast(text, "0");
    /* one line of operators, as deep as the parser allows */
    text = malloc(cap);
    n = (size_t)snprintf(text, cap, "float f(float a) { return a");
    for (int i = 0; i < 4000; i++) n += (size_t)snprintf(text + n, cap - n, " + a");
    snprintf(text + n, cap - n, "; }\n" MAIN);
    expect_fast(text, "0");
}

static void test_broken(void **state) {
    (void)state;
    /* syntax errors before checking: no crash, and what is sound is still checked */
    expect("float f( { return 1.0; }\n", (FrontOptions){0}, "E0001");
    expect("float f() { return 1 +; }\nfloat g() { return q; }\n" MAIN, (FrontOptions){0}, "E0001 E0101");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_values),
        cmocka_unit_test(test_overrides),
        cmocka_unit_test(test_epsilon),
        cmocka_unit_test(test_entries),
        cmocka_unit_test(test_assets),
        cmocka_unit_test(test_bounds),
        cmocka_unit_test_setup_teardown(test_modules, scratch_make, scratch_drop),
        cmocka_unit_test(test_messages),
        cmocka_unit_test(test_cost),
        cmocka_unit_test(test_broken),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
