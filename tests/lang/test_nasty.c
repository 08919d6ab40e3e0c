/* Programs that nobody means: huge, half-typed, pathological. Each ends in less than a second with a status and, if
 * that is an error, with a place; none crashes. */
#include <ctype.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <cmocka.h>

#include "saltus/saltus.h"

typedef struct Text {
    char *s;
    size_t len, cap;
} Text;

__attribute__((format(printf, 2, 3))) static void add(Text *t, const char *format, ...) {
    va_list ap;
    char piece[512];
    va_start(ap, format);
    int n = vsnprintf(piece, sizeof piece, format, ap);
    va_end(ap);
    assert_true(n >= 0 && (size_t)n < sizeof piece);
    if (t->len + (size_t)n + 1 > t->cap) {
        t->cap = 2 * (t->len + (size_t)n + 1);
        t->s = realloc(t->s, t->cap);
        assert_non_null(t->s);
    }
    memcpy(t->s + t->len, piece, (size_t)n + 1);
    t->len += (size_t)n;
}

static void repeat(Text *t, int n, const char *piece) {
    for (int i = 0; i < n; i++) add(t, "%s", piece);
}

/* Of processor time, so that a busy machine changes nothing; sanitizers cost several times as much. */
#if defined __SANITIZE_ADDRESS__ || defined __SANITIZE_THREAD__
enum { LIMIT = 15 };
#else
enum { LIMIT = 1 };
#endif

static double seconds(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* want < 0: SLT_OK or SLT_PROGRAM. code: of one of the errors, or NULL. */
static void compile(const char *what, const char *source, int want, const char *code) {
    SltProgram *p = NULL;
    SltOptions o = SLT_OPTIONS_INIT;
    o.stdlib_dir = SALTUS_STDLIB_BUILD, o.no_cache = true;
    double start = seconds();
    SltStatus s = slt_compile_string(source, "nasty.salt", &o, &p);
    double took = seconds() - start;
    if (want < 0 ? s != SLT_OK && s != SLT_PROGRAM : (int)s != want)
        fail_msg("%s: status %d: %s\n%s", what, (int)s, slt_last_error(p), slt_diagnostics_text(p));
    if (took > LIMIT) fail_msg("%s: %.2f s", what, took);
    bool placed = s == SLT_OK, found = !code;
    SltDiagnostic d = SLT_DIAGNOSTIC_INIT;
    for (uint32_t i = 0; slt_diagnostic(p, i, &d); i++) {
        if (d.severity != 1) continue;
        if (d.line == 0 || d.column == 0 || !d.file || strcmp(d.file, "nasty.salt") != 0)
            fail_msg("%s: an error without a place: %s", what, d.message);
        placed = true;
        if (code && !strcmp(d.code, code)) found = true;
    }
    if (!placed) fail_msg("%s: status %d without an error", what, (int)s);
    if (!found) fail_msg("%s: no %s in\n%s", what, code, slt_diagnostics_text(p));
    slt_program_free(p);
}

static void empty(void **state) {
    (void)state;
    compile("empty file", "", SLT_PROGRAM, "E0213");
    compile("one newline", "\n", SLT_PROGRAM, "E0213");
    compile("blanks", " \t\r\n  ", SLT_PROGRAM, "E0213");
    compile("only comments", "// nothing\n/* here */\n", SLT_PROGRAM, "E0213");
    compile("byte order mark", "\xEF\xBB\xBFshader float main(float x) { return x; }", -1, NULL);
    compile("carriage returns", "shader float main(float x) {\r\n    return x;\r\n}\r\n", SLT_OK, NULL);
    compile("no newline at the end", "shader float main(float x) { return x; } // end", SLT_OK, NULL);
    compile("bad UTF-8", "// \xFF\xFE\nshader float main(float x) { return x; }", SLT_PROGRAM, "E0005");
}

/* Each function calls the one before twice: 2^25 calls if they were all made. */
static void doubling(void **state) {
    (void)state;
    Text t = {0};
    add(&t, "float f0(float x) { return sin(x); }\n");
    for (int i = 1; i <= 25; i++) add(&t, "float f%d(float x) { return f%d(x) + f%d(2.0 * x); }\n", i, i - 1, i - 1);
    add(&t, "shader float main(float x) { return f25(x); }\n");
    compile("25 functions", t.s, SLT_PROGRAM, "E0501");
    free(t.s);
}

static void doubling_of_types(void **state) {
    (void)state;
    Text t = {0};
    add(&t, "struct S0 { float a; };\n");
    for (int i = 1; i <= 40; i++) add(&t, "struct S%d { S%d a; S%d b; };\n", i, i - 1, i - 1);
    add(&t, "shader float main(float x) { S40 s; return x; }\n");
    compile("40 structs", t.s, SLT_PROGRAM, NULL);
    t.len = 0;
    add(&t, "typedef float A0[2];\n");
    for (int i = 1; i <= 40; i++) add(&t, "typedef A%d A%d[1000];\n", i - 1, i);
    add(&t, "shader float main(float x) { A40 a; return x; }\n");
    compile("40 arrays", t.s, SLT_PROGRAM, NULL);
    free(t.s);
}

static void brackets(void **state) {
    (void)state;
    static const char *const pairs[][2] = {{"(", ")"},       {"{", "}"},         {"[", "]"},
                                           {"-", ""},        {"!", ""},          {"f(", ")"},
                                           {"float2(", ")"}, {"x ? ", " : 1.0"}, {"x.x + (", ")"}};
    for (size_t k = 0; k < sizeof pairs / sizeof *pairs; k++) {
        Text t = {0};
        add(&t, "shader float main(float x) { return ");
        repeat(&t, 10000, pairs[k][0]);
        add(&t, "x");
        repeat(&t, 10000, pairs[k][1]);
        add(&t, "; }\n");
        compile(pairs[k][0], t.s, SLT_PROGRAM, NULL);
        t.len = 0;
        add(&t, "shader float main(float x) { return ");
        repeat(&t, 10000, pairs[k][0]);
        compile("never closed", t.s, SLT_PROGRAM, NULL);
        t.len = 0;
        repeat(&t, 10000, pairs[k][0]);
        compile("at file scope", t.s, SLT_PROGRAM, NULL);
        t.len = 0;
        repeat(&t, 10000, pairs[k][1]);
        add(&t, ";");
        compile("never opened", t.s, SLT_PROGRAM, NULL);
        free(t.s);
    }
}

static void long_things(void **state) {
    (void)state;
    Text t = {0};
    add(&t, "shader float main(float x) { return x");
    repeat(&t, 100000, " + x");
    add(&t, "; }\n");
    compile("long sum", t.s, SLT_PROGRAM, "E0521");
    t.len = 0;
    add(&t, "shader float main(float x) { if (x < 0.0) return 0.0;");
    repeat(&t, 20000, " else if (x < 1.0) return 1.0;");
    add(&t, " return 2.0; }\n");
    compile("long else if", t.s, SLT_PROGRAM, NULL);
    t.len = 0;
    add(&t, "shader float main(float x) { float y = x;\n");
    repeat(&t, 20000, "y = y * 1.01 + x;\n");
    add(&t, "return y; }\n");
    compile("long body", t.s, -1, NULL);
    t.len = 0;
    add(&t, "shader float main(float x) { return ");
    repeat(&t, 20000, "very_");
    add(&t, "long_name; }\n");
    compile("long name", t.s, SLT_PROGRAM, "E0101");
    t.len = 0;
    add(&t, "shader float main(float x) { return 0.");
    repeat(&t, 50000, "1234567890");
    add(&t, "; }\n");
    compile("long number", t.s, -1, NULL);
    t.len = 0;
    for (int i = 0; i < 5000; i++) add(&t, "float f%d(float x) { return undefined%d; }\n", i, i);
    compile("five thousand errors", t.s, SLT_PROGRAM, NULL);
    t.len = 0;
    repeat(&t, 200000, "@#$ ");
    compile("no program at all", t.s, SLT_PROGRAM, NULL);
    t.len = 0;
    for (int i = 0; i < 1500; i++) add(&t, "const int C%d = C%d + 1;\n", i, i + 1);
    add(&t, "const int C1500 = 0;\nshader float main(float x) { return float(C0); }\n");
    compile("long chain of constants", t.s, -1, NULL);
    t.len = 0;
    for (int i = 0; i < 3000; i++) add(&t, "float f%d(float x) { return f%d(x); }\n", i, i + 1);
    add(&t, "float f3000(float x) { return x; }\nshader float main(float x) { return f0(x); }\n");
    compile("long chain of calls", t.s, -1, NULL);
    free(t.s);
}

static void long_loops(void **state) {
    (void)state;
    compile("10^9 iterations",
            "shader float main(float x) { float s = 0.0; for (int i = 0; i < 1000000000; i++) s += x; return s; }",
            SLT_PROGRAM, "E0311");
    compile("never ends", "shader float main(float x) { while (true) {} return x; }", SLT_PROGRAM, "E0310");
    compile("counts away",
            "shader float main(float x) { float s = 0.0; for (int i = 1; i > 0; i++) s += x; return s; }", SLT_PROGRAM,
            NULL);
    compile("step of zero",
            "shader float main(float x) { float s = 0.0; for (int i = 0; i < 4; i += 0) s += x; return s; }",
            SLT_PROGRAM, NULL);
    compile("float step too small",
            "shader float main(float x) { float s = 0.0; for (float t = 0.0; t < 1.0; t += 1e-30) s += x; return s; }",
            SLT_PROGRAM, NULL);
    compile(
        "nested to 2^40",
        "shader float main(float x) { float s = 0.0; for (int i = 0; i < 1048576; i++) for (int j = 0; j < 1048576; j++) s += x; return s; }",
        -1, NULL);
    compile(
        "nine deep",
        "param float p = 0.5; shader float main(float x) { float s = 0.0;"
        "for (int a = 0; a < 2; a++) for (int b = 0; b < 2; b++) for (int c = 0; c < 2; c++) for (int d = 0; d < 2; d++) for (int e = 0; e < 2; e++)"
        "for (int f = 0; f < 2; f++) for (int g = 0; g < 2; g++) for (int h = 0; h < 2; h++) for (int i = 0; i < 2; i++) { [Disc] if (x < p) s += 1.0; } return s; }",
        SLT_PROGRAM, "E0502");
}

static void large_sizes(void **state) {
    (void)state;
    compile("huge array", "shader float main(float x) { float a[1000000000]; return a[0]; }", SLT_PROGRAM, "E0126");
    compile("huge product", "shader float main(float x) { float a[65536][65536]; return a[0][0]; }", SLT_PROGRAM,
            "E0126");
    compile(
        "huge parameter",
        "param float a[2000000000] = init(f); float f(int i) { return 1.0; } shader float main(float x) { return a[0]; }",
        SLT_PROGRAM, "E0126");
    compile("huge texture",
            "param texture2D t = zeros(1000000, 1000000); shader float main(float2 x) { return t.sample(x); }",
            SLT_PROGRAM, "E0305");
    compile("constant that divides by zero",
            "const int N = 1 / 0; shader float main(float x) { float a[N]; return a[0]; }", SLT_PROGRAM, "E0125");
    compile("constant overflow",
            "const int N = 2147483647 + 1; shader float main(float x) { float a[N]; return a[0]; }", SLT_PROGRAM,
            "E0125");
}

/* As typed: every prefix of a program, and the program without each of its tokens. Of blanks only those that keep two
 * words apart are tokens here: with or without another the program is the same. */
static const char typed[] = "import sdf;\n"
                            "const int N = 3; /* a comment */\n"
                            "typedef float2 P;\n"
                            "struct Disc { P centre; float r[2]; };\n"
                            "[Range(0.05, 0.9), Doc(\"size\")] param float radius = 0.4;\n"
                            "param Disc discs[N] = init(make);\n"
                            "param texture2D t = zeros(4, 4);\n"
                            "Disc make(int i) { Disc d = { P(rand(), 0.5), { 0.1f * i, 0x1F } }; return d; }\n"
                            "void both(in float a, out float b, inout float2 c) { b = a; c.xy += -c.yx * 2.0; }\n"
                            "[Tangent(df)] float f(float a) { return a * a; }\n"
                            "float df(float a, float da) { return 2.0 * a * da; }\n"
                            "[Domain(-1.0, 1.0)] shader float3 main(float2 x) {\n"
                            "    float3 c = float3(1.0), w; float2x2 m = float2x2(1, 2, 3, 4); float b;\n"
                            "    w = float3(m * x, x.x > 0.0 && !(x.y <= 0.0) ? 1e-3 : 2u);\n"
                            "    for (int i = 0, j = 1; i < N; i++, j *= 2) {\n"
                            "        float d = sd_circle(x - discs[i].centre, radius);\n"
                            "        [Disc] [SkipLoop] if (d < 0.0) c = lerp(c, w, 0.5); else if (i == 2) continue;\n"
                            "        switch (i % 3) { case 0: c.x++; case 1: break; default: --c.y; }\n"
                            "    }\n"
                            "    [MaxIters(9)] while (c.x > 3.0) { c.x -= f(c.y); if (c.x < 0.0) break; }\n"
                            "    both(x.x, b, x); print(\"c\", c); assert(b > -2.0, \"b\");\n"
                            "    return c + t.sample(x).rgb + detach(b) % 3.0;\n"
                            "}\n";

static void typed_whole(void **state) {
    (void)state;
    compile("whole", typed, SLT_OK, NULL);
}

static void typed_prefixes(void **state) {
    (void)state;
    for (size_t n = 0; n + 2 < sizeof typed - 1; n++) {
        char what[32], *s = strndup(typed, n);
        snprintf(what, sizeof what, "prefix of %zu bytes", n);
        compile(what, s, SLT_PROGRAM, NULL);
        free(s);
    }
}

static bool is_word(char c) { return isalnum((unsigned char)c) || c == '_'; }

static void typed_holes(void **state) {
    (void)state;
    size_t len = sizeof typed - 1;
    for (size_t at = 0; at < len;) {
        size_t end = at + 1;
        bool word = isalpha((unsigned char)typed[at]);
        while (word && end < len && (isalpha((unsigned char)typed[end]) || typed[end] == '_')) end++;
        bool blank = isspace((unsigned char)typed[at]);
        if (blank && !(at && end < len && is_word(typed[at - 1]) && is_word(typed[end]))) {
            at = end;
            continue;
        }
        char what[64], *s = malloc(2 * len + 2);
        snprintf(what, sizeof what, "without bytes %zu to %zu", at, end);
        memcpy(s, typed, at);
        memcpy(s + at, typed + end, len - end + 1);
        compile(what, s, -1, NULL);
        snprintf(what, sizeof what, "bytes %zu to %zu twice", at, end);
        memcpy(s, typed, end);
        memcpy(s + end, typed + at, len - at + 1);
        if (!blank) compile(what, s, -1, NULL);
        free(s);
        at = end;
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(empty),       cmocka_unit_test(doubling),    cmocka_unit_test(doubling_of_types),
        cmocka_unit_test(brackets),    cmocka_unit_test(long_things), cmocka_unit_test(long_loops),
        cmocka_unit_test(large_sizes), cmocka_unit_test(typed_whole), cmocka_unit_test(typed_prefixes),
        cmocka_unit_test(typed_holes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
