/* Syntax errors: where they are, that none follows from another, that all of a file are found, and the limits. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <cmocka.h>

#include "tests/front/parse_fixture.h"

static void check_brief(const char *source, const char *expected) {
    Parsed p = parse_text(source);
    if (strcmp(p.brief, expected)) print_message("%s\n%s", source, p.text);
    assert_string_equal(p.brief, expected);
    parsed_free(&p);
}

/* In a function of its own; the first line is line 1. */
static void check_body(const char *body, const char *expected) {
    char source[2048];
    snprintf(source, sizeof source, "void f() {%s\n}\nvoid g() { a + ; }", body);
    /* The error in g shows that the parser was back in step. */
    unsigned lines = 2;
    for (const char *c = body; *c; c++) lines += *c == '\n';
    char all[1024];
    snprintf(all, sizeof all, "%s%s%u:16 E0001", expected, *expected ? "; " : "", lines + 1);
    check_brief(source, all);
}

static void message(const char *source, const char *part) {
    Parsed p = parse_text(source);
    if (!strstr(p.text, part)) print_message("wanted: %s\ngot:\n%s", part, p.text);
    assert_non_null(strstr(p.text, part));
    parsed_free(&p);
}

static void single_errors(void **state) {
    (void)state;
    check_body("", "");
    check_body("\n a = ;", "2:6 E0001");
    check_body("\n a = 1\n b = 2;", "2:7 E0001");
    check_body("\n a = 1 b = 2;", "2:8 E0001");
    check_body("\n return a", "2:10 E0001");
    check_body("\n f(1, 2;", "2:8 E0001");
    check_body("\n f(1 2);", "2:6 E0001");
    check_body("\n a[1 = 2;", "2:9 E0001");
    check_body("\n if a > 1 { b(); }", "2:5 E0001");
    check_body("\n if (a > ) { b(); }", "2:10 E0001");
    check_body("\n if (a { b(); }", "2:8 E0001");
    check_body("\n for (int i = 0; i < 3) { b(); }", "2:23 E0001");
    check_body("\n for (int i = 0, i < 3; i++) { b(); }", "2:20 E0001");
    check_body("\n while () b();", "2:9 E0001");
    check_body("\n do { b(); } while (a)\n c();", "2:23 E0001");
    check_body("\n do { b(); } a = 1;", "2:14 E0001");
    check_body("\n else b();", "2:2 E0001");
    check_body("\n case 1: b();", "2:2 E0001");
    check_body("\n switch (a) { b(); }", "2:15 E0001");
    check_body("\n switch (a) { case 1 b(); break; default: c(); }", "2:22 E0001");
    check_body("\n float x = , y = 2;", "2:12 E0001");
    check_body("\n float ;", "2:8 E0001");
    check_body("\n float a[3] = { 1, , 3 };", "2:20 E0001");
    check_body("\n float a[] [] = b;", "2:12 E0001");
    check_body("\n a = { 1, 2 };", "2:6 E0001");
    check_body("\n return { 1 };", "2:9 E0001");
    check_body("\n float3 v = (1, 2, 3);", "2:15 E0001");
    check_body("\n float3 v(1, 2, 3);", "2:10 E0001");
    check_body("\n const int n;", "2:12 E0011");
    check_body("\n a = \"text\";", "2:6 E0001");
    check_body("\n assert();", "2:2 E0001");
    check_body("\n assert(\"text\");", "2:2 E0001");
    check_body("\n assert(a, b);", "2:2 E0001");
    check_body("\n struct S { float a; float b; };\n a = 1;", "2:2 E0001");
    check_body("\n a = b ? c;", "2:11 E0001");
    check_body("\n a..b;", "2:4 E0001");
    check_body("\n static float x = 1.0;", "2:2 E0001");
    check_body("\n float float2 = 1.0;", "2:8 E0007");
    check_body("\n float in = 1.0; in = 2.0; a = in + in;", "2:8 E0007");
    check_body("\n [Disc]", "2:3 E0009");
}

static void literals(void **state) {
    (void)state;
    check_body("\n a = 1.0.0;", "2:6 E0003");
    check_body("\n a = 0x;", "2:6 E0003");
    check_body("\n a = 0xfg;", "2:6 E0003");
    check_body("\n a = 1e;", "2:6 E0003");
    check_body("\n a = 1e+;", "2:6 E0003");
    check_body("\n a = 12ab + 1f + 010 + 1.0h;", "2:6 E0003; 2:13 E0003; 2:18 E0003; 2:24 E0003");
    check_body("\n a = 4294967296;", "2:6 E0006");
    check_body("\n a = 0x100000000;", "2:6 E0006");
    check_body("\n a = 99999999999999999999999999;", "2:6 E0006");
    check_body("\n a = 1e999;", "2:6 E0006");
    check_body("\n print(\"a\\qb\");", "2:10 E0003");
    check_body("\n print(\"abc);\n a = 1;", "2:8 E0004");
    check_body("\n a = b @@ c;", "2:8 E0002; 2:11 E0001");
    check_body("\n a = \xC3\xA9\xC3\xA9;", "2:6 E0002; 2:8 E0001");
    check_body("\n#define X 1\n a = 1;", "2:1 E0002");
    check_brief("void f() { /* never closed\n }", "1:12 E0004");
    message("void f() { a \xE2\x88\x92 b; }", "unexpected character `\xE2\x88\x92` (U+2212); write `-`");
    message("const int a = 0777;", "no octal numbers");
}

static void declarations(void **state) {
    (void)state;
    check_brief("float x = 1.0;\nconst int N = 2;", "1:7 E0012");
    check_brief("float x;\nconst int N = ;", "1:7 E0012; 2:15 E0001");
    check_brief("param float a;\nconst int N;\nparam float b = ;", "1:13 E0011; 2:11 E0011; 3:17 E0001");
    check_brief("param float a = init(3);\nparam float b = init(f, g);\nparam texture2D t = zeros(3);",
                "1:17 E0001; 2:17 E0001; 3:21 E0001");
    check_brief("struct { float a; };\nconst int N = ;", "1:8 E0001; 2:15 E0001");
    check_brief("struct S { };", "1:8 E0001");
    check_brief("struct S { float a b; int c = 3; float d[]; float m() { return 1.0; } float e; }",
                "1:20 E0001; 1:29 E0001; 1:40 E0001; 1:52 E0001; 1:81 E0001");
    check_brief("typedef struct { float a; } S;\ntypedef float;\nconst int N = ;", "1:9 E0001; 2:14 E0001; 3:15 E0001");
    check_brief("import \"sdf\";\nimport ;\nimport a b;\nconst int N = ;",
                "1:8 E0001; 2:8 E0001; 3:10 E0001; 4:15 E0001");
    check_brief("float f(float a float b) { c = ; }", "1:17 E0001; 1:32 E0001");
    check_brief("float f(float) { c = ; }", "1:14 E0001; 1:22 E0001");
    check_brief("float f(float a = 1.0, float b) { c = ; }", "1:17 E0001; 1:39 E0001");
    check_brief("shader main(float2 x) { a = ; }\nconst int N = ;", "1:12 E0001; 1:29 E0001; 2:15 E0001");
    check_brief("float4 main(float2 uv : TEXCOORD) : SV_Target { a = ; }", "1:23 E0001; 1:35 E0001; 1:53 E0001");
    check_brief("main(float2 x) { a = 1; }\nconst int N = ;", "1:1 E0001; 2:15 E0001");
    check_brief("static const float x = 1.0;\nuniform float y = ;", "1:1 E0001; 2:1 E0001; 2:15 E0012; 2:19 E0001");
    check_brief(")) + 3;\nconst int N = ;", "1:1 E0001; 2:15 E0001");
    check_brief("}\n}\nconst int N = ;", "1:1 E0010; 2:1 E0010; 3:15 E0001");
    check_brief("const float a[1][1][1][1][1][1][1][1][1][1][1][1][1][1][1][1][1] = b;", "1:62 E0521");
    check_brief("const float[1][1][1][1][1][1][1][1][1] a[1][1][1][1][1][1][1][1] = b;", "1:7 E0521");
}

/* A `}` too few: one error, and the next declaration is found again. */
static void missing_braces(void **state) {
    (void)state;
    check_brief("void f() {\n  if (a) {\n    b();\n}\nfloat g(float x) { return x + ; }\n", "5:1 E0010; 5:31 E0001");
    check_brief(
        "void f() {\n  while (a) { b();\n\n[Domain(0, 1)]\nshader float main(float x) { return ; }\nvoid g() { a + ; }",
        "5:1 E0010; 6:16 E0001");
    check_brief("void f() {\n  a = 1;\nparam float r = ;\n", "3:1 E0010; 3:17 E0001");
    check_brief("void f() {\n  a = 1;\n", "3:1 E0010");
    check_brief("void f() { a(", "1:14 E0001");
    check_brief("void f() { float g(float x) { return x; } a = ; }\nvoid h() { a + ; }",
                "1:12 E0010; 1:47 E0001; 2:16 E0001");
    message("void f() {\n  if (a) {\n    b();\n}\nfloat g(float x) { return x; }\n",
            "t.salt:1:10: note: this `{` is not closed");
}

static void attributes(void **state) {
    (void)state;
    check_brief("[Rnge(0, 1)] param float a = 1.0;", "1:2 E0008");
    message("[Rnge(0, 1)] param float a = 1.0;", "unknown attribute `Rnge`; did you mean `Range`? [E0008]");
    message("void f() { [disc] if (a) b(); }", "did you mean `Disc`?");
    message("void f() { [unroll] for (;;) b(); }", "unknown attribute `unroll`; leave it out");
    check_brief("[Range(1.0)] [Doc] [Doc(3)] [Log(1)] param float a = 1.0;",
                "1:2 E0009; 1:15 E0009; 1:21 E0009; 1:30 E0009");
    check_brief("[NoDiff, NoDiff] param float a = 1.0;", "1:10 E0009");
    check_brief("[Disc] param float a = 1.0; [Range(0, 1)] const int N = 3; [Log] import x;",
                "1:2 E0009; 1:30 E0009; 1:61 E0009");
    check_brief("[Domain(0, 1)] float f() { [NoDiff] return 1.0; }", "1:2 E0009; 1:29 E0009");
    check_brief("void f() { [Cull(3)] for (;;) ; [MaxIters] while (a) ; [MaxIters(] while (b) ; [] c = ; }",
                "1:13 E0009; 1:34 E0009; 1:66 E0001; 1:81 E0001; 1:87 E0001");
    message("[Disc] param float a = 1.0;", "`[Disc]` marks a statement, not a parameter");
}

static void many_errors(void **state) {
    (void)state;
    /* One per function, every one found, 20 printed. */
    char source[4096] = "";
    for (int i = 0; i < 45; i++) strcat(source, "void f() { a = ; }\n");
    Parsed p = parse_text(source);
    assert_int_equal(p.s->nerrors, 45);
    p.s->max_errors = 20;
    char *text = printed(p.s, print_text);
    assert_non_null(strstr(text, "t.salt:20:16: error: "));
    assert_null(strstr(text, "t.salt:21:"));
    assert_non_null(strstr(text, "\n25 more errors\n"));
    free(text);
    parsed_free(&p);
    /* A file that is no shader ends after a bounded number of errors. */
    size_t n = 200000;
    char *garbage = malloc(n + 1);
    for (size_t i = 0; i < n; i++) garbage[i] = "@;$ "[i % 4];
    garbage[n] = 0;
    p = parse_text(garbage);
    assert_in_range(p.s->nerrors, 900, 1002);
    assert_non_null(strstr(p.text, "too many errors in this file"));
    parsed_free(&p);
    free(garbage);
}

static void encodings(void **state) {
    (void)state;
    Parsed p = parse_bytes("const int a = 1; // caf\xE9\nconst int b = 2; // \xFF", 47);
    assert_string_equal(p.brief, "1:24 E0005");
    parsed_free(&p);
    p = parse_bytes("const int a\0= 1;", 16);
    assert_string_equal(p.brief, "1:12 E0002");
    parsed_free(&p);
    p = parse_bytes("\xFF\xFE"
                    "i\0n\0t\0",
                    8);
    assert_string_equal(p.brief, "1:1 E0005");
    parsed_free(&p);
    /* Columns count code points, and a byte order mark is none. */
    check_brief("\xEF\xBB\xBF"
                "const int a = ;",
                "1:15 E0001");
    check_brief("/* \xC3\xA9\xE4\xBD\xA0 */ const int a = ;", "1:24 E0001");
    check_brief("const int a = 1;\r\nconst int b = ;\rconst int c = ;", "2:15 E0001; 3:15 E0001");
}

/* ---- limits ---- */

static char *repeat(const char *before, const char *unit, size_t n, const char *after) {
    size_t u = strlen(unit), b = strlen(before);
    char *text = malloc(b + u * n + strlen(after) + 1);
    strcpy(text, before);
    for (size_t i = 0; i < n; i++) memcpy(text + b + i * u, unit, u);
    strcpy(text + b + u * n, after);
    return text;
}

static uint32_t tallest_stmt(const Stmt *st) {
    uint32_t best = 0, d;
    if (!st) return 0;
    if ((d = tallest_stmt(st->body)) > best) best = d;
    if ((d = tallest_stmt(st->orelse)) > best) best = d;
    for (uint32_t i = 0; i < st->nstmts; i++)
        if ((d = tallest_stmt(st->stmts[i])) > best) best = d;
    return best + 1;
}

/* `code` or "" for none; the tree that is left must be shallow enough to walk. */
static void check_limit(const char *before, const char *unit, size_t n, const char *after, const char *code) {
    char *source = repeat(before, unit, n, after);
    Parsed p = parse_text(source);
    if (*code) {
        assert_non_null(strstr(p.text, code));
        assert_int_equal(p.s->nerrors, 1);
    } else {
        assert_string_equal(p.text, "");
    }
    for (const Func *f = p.module->funcs; f; f = f->next) assert_in_range(tallest_stmt(f->body), 0, 1400);
    for (const Symbol *c = p.module->consts; c; c = c->next)
        if (c->init) assert_in_range(c->init->depth, 0, 4096);
    assert_int_equal(p.status, 0);
    parsed_free(&p);
    free(source);
}

static void nesting(void **state) {
    (void)state;
    check_limit("const float a = ", "(", 255, "", "E0001");
    char *closed = repeat("1", ")", 256, ";");
    check_limit("const float a = ", "(", 256, closed, "");
    check_limit("const float a = ", "(", 257, closed, "E0520");
    free(closed);
    check_limit("const float a = ", "(", 10000, "", "E0520");
    check_limit("const float a = ", "(", 100000, "", "E0520");
    check_limit("const float a = ", "b[", 10000, "", "E0520");
    check_limit("const float a = ", "f(", 10000, "", "E0520");
    check_limit("const float a = ", "{", 10000, "", "E0520");
    check_limit("const float a = ", "- ", 100000, "1;", "E0520");
    check_limit("const float a = ", "(float)", 100000, "1;", "E0520");
    check_limit("const float a = ", "b ? c : ", 100000, "1;", "E0520");
    check_limit("void f() { ", "a = ", 100000, "1; }", "E0520");
    check_limit("void f() ", "{", 100000, "", "E0520");
    check_limit("void f() ", "{", 200, "", "E0010");
    check_limit("void f() { ", "if (a) ", 100000, "; }", "E0520");
    check_limit("void f() { ", "for (;;) ", 10000, "; }", "E0520");
    check_limit("void f() { ", "switch (a) { case 1: ", 10000, "", "E0520");
    check_limit("void f() { ", "do ", 10000, "", "E0520");
    check_limit("const float a", "[1]", 10000, " = 1;", "E0521");
}

static void chains(void **state) {
    (void)state;
    check_limit("const float a = 1", " + b", 4000, ";", "");
    check_limit("const float a = 1", " + b", 100000, ";", "E0521");
    check_limit("const float a = 1", " && b", 100000, ";", "E0521");
    check_limit("const float a = b", ".x", 100000, ";", "E0521");
    check_limit("const float a = b", "[0]", 100000, ";", "E0521");
    check_limit("const float a = b", "++", 100000, ";", "E0521");
    check_limit("void f() { a", ", b", 100000, "; }", "E0521");
    check_limit("void f() { ", "if (a) b(); else ", 1000, "c(); }", "");
    check_limit("void f() { ", "if (a) b(); else ", 100000, "c(); }", "E0521");
    /* What is wide and not deep has no limit. */
    check_limit("void f() { ", "a = b;\n", 100000, "}", "");
    check_limit("const float a[100000] = { 0", ", 1", 99999, " };", "");
    check_limit("const float a = f(0", ", 1", 20000, ");", "");
    check_limit("", "void f() { a(); }\n", 20000, "", "");
}

static void sizes(void **state) {
    (void)state;
    size_t n = (16u << 20) + 1;
    char *text = malloc(n + 1);
    memset(text, ' ', n);
    text[n] = 0;
    Parsed p = parse_bytes(text, n);
    assert_string_equal(p.brief, "1:1 E0522");
    parsed_free(&p);
    /* The largest allowed, with its only error at the end of a line of 16 MiB. */
    text[n - 2] = ')';
    p = parse_bytes(text, n - 1);
    assert_string_equal(p.brief, "1:16777216 E0001");
    assert_in_range(strlen(p.text), 0, 600);
    parsed_free(&p);
    free(text);
    /* A name of a megabyte is quoted in part. */
    text = repeat("const int a = b ", "x", 1 << 20, ";");
    p = parse_text(text);
    assert_string_equal(p.brief, "1:17 E0001");
    assert_in_range(strlen(p.text), 0, 800);
    parsed_free(&p);
    free(text);
    /* A tree beyond the budget of memory is a limit, and nothing is lost. */
    Session *s = session_create(8 << 20);
    text = repeat("void f() { ", "a = b + c;", 100000, "}");
    ParseJob job = {.text = text, .len = strlen(text)};
    assert_int_equal(session_protect(s, parse_body, &job), 6);
    assert_non_null(strstr(s->unwind_text, "8 MiB"));
    session_destroy(s);
    free(text);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(single_errors), cmocka_unit_test(literals),
                                       cmocka_unit_test(declarations),  cmocka_unit_test(missing_braces),
                                       cmocka_unit_test(attributes),    cmocka_unit_test(many_errors),
                                       cmocka_unit_test(encodings),     cmocka_unit_test(nesting),
                                       cmocka_unit_test(chains),        cmocka_unit_test(sizes)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
