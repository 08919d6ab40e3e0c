/* The parser: shapes of trees, and every literal and operator. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <cmocka.h>

#include "tests/front/parse_fixture.h"

#define CHECK_DUMP(source, expected)                                                                                   \
    do {                                                                                                               \
        Parsed p_ = parse_text(source);                                                                                \
        assert_string_equal(p_.text, "");                                                                              \
        assert_string_equal(p_.dump, expected);                                                                        \
        parsed_free(&p_);                                                                                              \
    } while (0)

/* One expression as the value of a constant. */
static void check_expr(const char *expr, const char *expected) {
    char source[512], shape[512];
    snprintf(source, sizeof source, "const float c = %s;", expr);
    snprintf(shape, sizeof shape, "(const (float c %s))\n", expected);
    CHECK_DUMP(source, shape);
}

static void check_body(const char *body, const char *expected) {
    char source[1024], shape[1024];
    snprintf(source, sizeof source, "void f() { %s }", body);
    snprintf(shape, sizeof shape, "(func void f (block %s))\n", expected);
    CHECK_DUMP(source, shape);
}

static void literals(void **state) {
    (void)state;
    check_expr("1", "1");
    check_expr("1u", "1u");
    check_expr("0x1F", "31");
    check_expr("0XffU", "255u");
    check_expr("1.0", "1f");
    check_expr("1.0f", "1f");
    check_expr(".5", "0.5f");
    check_expr("5.", "5f");
    check_expr("1e-3", "0.001f");
    check_expr("2.5E+2F", "250f");
    check_expr("true", "true");
    check_expr("false", "false");
    check_expr("2147483647", "2147483647");
    check_expr("2147483648", "2147483648u");
    check_expr("4294967295", "4294967295u");
    check_expr("-2147483648", "-2147483648");
    check_expr("-2147483648u", "(- 2147483648u)");
    check_expr("1e-400", "0f");
}

static void precedence(void **state) {
    (void)state;
    check_expr("a + b * c - d", "(- (+ a (* b c)) d)");
    check_expr("a - b - c", "(- (- a b) c)");
    check_expr("(a - (b - c))", "(- a (- b c))");
    check_expr("a || b && c | d ^ e & f == g < h << i + j * k",
               "(|| a (&& b (| c (^ d (& e (== f (< g (<< h (+ i (* j k))))))))))");
    check_expr("a * b + c << d < e == f & g ^ h | i && j || k",
               "(|| (&& (| (^ (& (== (< (<< (+ (* a b) c) d) e) f) g) h) i) j) k)");
    check_expr("a ? b : c ? d : e", "(?: a b (?: c d e))");
    check_expr("a ? b ? c : d : e", "(?: a (?: b c d) e)");
    check_expr("-a.x[1]++", "(- (_++ ([] (.x a) 1)))");
    check_expr("- -a", "(- (- a))");
    check_expr("!a && ~b != +c", "(&& (! a) (!= (~ b) (+ c)))");
    check_expr("--a % b", "(% (--_ a) b)");
    check_expr("a >= b != c <= d", "(!= (>= a b) (<= c d))");
    check_expr("f(a, g(), h(b)[2].xy)", "(call f a (call g) (.xy ([] (call h b) 2)))");
    check_expr("float3(v2, 1).zyx.r", "(.r (.zyx (make float3 v2 1)))");
    check_expr("t.sample(uv * 2.0).rgb", "(.rgb (method sample t (* uv 2f)))");
    check_expr("float2x2(1, 2, 3, 4)[0][1]", "([] ([] (make float2x2 1 2 3 4) 0) 1)");
    check_expr("(float)n / (int)x.y", "(/ (cast float n) (cast int (.y x)))");
    check_expr("(Disc)0", "(cast Disc 0)");
    check_expr("(a) - b", "(- a b)");
    check_expr("int(v) + uint2(w).x", "(+ (make int v) (.x (make uint2 w)))");
    check_expr("len(a)", "(call len a)");
    check_expr("{ 1, { 2, 3 }, { } }", "(list 1 (list 2 3) (list))");
    check_expr("{ 1, 2, }", "(list 1 2)");
}

static void statements(void **state) {
    (void)state;
    check_body("float a[3], b = 2.0, c[N][2];", "(decl (float[3] a) (float b 2f) (float[N][2] c))");
    check_body("float[3] a;", "(decl (float[3] a))");
    check_body("float[3] a[2];", "(decl (float[2][3] a))");
    check_body("Disc d, e[4];", "(decl (Disc d) (Disc[4] e))");
    check_body("Disc[2] d;", "(decl (Disc[2] d))");
    check_body("const int n = 3;", "(decl (const int n 3))");
    check_body("S s = { a, b };", "(decl (S s (list a b)))");
    check_body("d[0] = 1;", "(= ([] d 0) 1)");
    check_body("d[a[1]].x += 1;", "(+= (.x ([] d ([] a 1))) 1)");
    check_body("a = b = c;", "(= a (= b c))");
    check_body("a -= 1; a *= 2; a /= 3; a %= 4; a &= 5; a |= 6; a ^= 7; a <<= 8; a >>= 9;",
               "(-= a 1) (*= a 2) (/= a 3) (%= a 4) (&= a 5) (|= a 6) (^= a 7) (<<= a 8) (>>= a 9)");
    check_body("a++, --b;", "(, (_++ a) (--_ b))");
    check_body("if (a) b = 1; else if (c) { } else d();", "(if a (= b 1) else (if c (block) else (call d)))");
    check_body("if (a) if (b) c(); else d();", "(if a (if b (call c) else (call d)))");
    check_body("for (int i = 0, j = 9; i < j; i++, j--) ;",
               "(for (decl (int i 0) (int j 9)) (< i j) (, (_++ i) (_-- j)) (empty))");
    check_body("for (i = 0; ; ) break;", "(for (= i 0) _ _ (break))");
    check_body("for (;;) { continue; }", "(for _ _ _ (block (continue)))");
    check_body("while (a < b) a++;", "(while (< a b) (_++ a))");
    check_body("do { a++; } while (a < b);", "(do (< a b) (block (_++ a)))");
    check_body("switch (n) { case 0: case 1: a = 1; break; case 2: { b(); } default: return; }",
               "(switch n (0) (1 (= a 1) (break)) (2 (block (call b))) (default (return)))");
    check_body("return a + b;", "(return (+ a b))");
    check_body("print(\"x {}\\n\", x, y.z); assert(x > 0.0); assert(y, \"no\");",
               "(print \"x {}\n\" x (.z y)) (assert (> x 0f)) (assert y \"no\")");
    check_body("[Disc] if (a < b) c();", "@Disc (if (< a b) (call c))");
    check_body("[Disc, SkipLoop] if (a) ;", "@Disc @SkipLoop (if a (empty))");
    check_body("[Disc] [SkipLoop] if (a) ;", "@Disc @SkipLoop (if a (empty))");
    check_body("[MaxIters(N * 2)] while (a) [NoDisc] b = floor(c);",
               "@MaxIters:(* N 2) (while a @NoDisc (= b (call floor c)))");
    check_body("[Cull(box)] for (;;) ;", "@Cull:box (for _ _ _ (empty))");
    check_body("if (a) ; else [Disc] if (b) ; else [NoDisc] c();",
               "(if a (empty) else @Disc (if b (empty) else @NoDisc (call c)))");
    check_body("[Disc] Hit v = h.trace(o, d, 0.0, 1e9);", "@Disc (decl (Hit v (method trace h o d 0f 1e+09f)))");
}

static void file_scope(void **state) {
    (void)state;
    CHECK_DUMP("import sdf; import noise;", "(import sdf)\n(import noise)\n");
    CHECK_DUMP("struct Disc { float2 centre; float r, w[2]; };",
               "(struct Disc (float2 centre) (float r) (float[2] w))\n");
    CHECK_DUMP("typedef float3 Ink; typedef float M[2][3]; typedef float[4] Q;",
               "(typedef Ink float3)\n(typedef M float[2][3])\n(typedef Q float[4])\n");
    CHECK_DUMP("const int N = 3, M = N * 2; const float w[3] = { 1, 2, 3 };",
               "(const (int N 3))\n(const (int M (* N 2)))\n(const (float[3] w (list 1 2 3)))\n");
    CHECK_DUMP("[Range(0.05, 0.9)] [Doc(\"how \\\"wide\\\"\")] param float r = 0.4;",
               "(param @Doc:how \"wide\" @Range:0.05f 0.9f (float r 0.4f))\n");
    CHECK_DUMP("[NoDiff, Color] param float3 c = float3(1.0); [Log] param float s = 1.0;",
               "(param @NoDiff @Color (float3 c (make float3 1f)))\n(param @Log (float s 1f))\n");
    CHECK_DUMP("param Disc discs[N] = init(f);", "(param (Disc[N] discs init f))\n");
    CHECK_DUMP("param float verts[][3] = \"mesh.npy\";", "(param (float[][3] verts file \"mesh.npy\"))\n");
    CHECK_DUMP("param texture2D t = zeros(4, N, 3);", "(param (texture2D t zeros 4 N 3))\n");
    CHECK_DUMP("[Extent(0.0, 0.0, 2.0, 2.0)] [Height(100.0, -5.0)] param heightfield h = \"dem.exr\";",
               "(param @Extent:0f 0f 2f 2f @Height:100f (- 5f) (heightfield h file \"dem.exr\"))\n");
    CHECK_DUMP("float f(float a, in int b, out float2 c, inout S d[2]) { return a; }",
               "(func float f (float a) (int b) (out float2 c) (inout S[2] d) (block (return a)))\n");
    CHECK_DUMP("[Tangent(df)] float f(float a) { return a; } [NoDisc] void g() {}",
               "(func @Tangent:df float f (float a) (block (return a)))\n(func @NoDisc void g (block))\n");
    CHECK_DUMP("[Domain(-1.0, float2(1.0, 2.0))] shader float3 main(float2 x) { return x.xyx; }",
               "(shader @Domain:(- 1f) (make float2 1f 2f) float3 main (float2 x) (block (return (.xyx x))))\n");
    CHECK_DUMP("float f(float a); float f(float a) { return a; }", "(func float f (float a) (block (return a)))\n");
    /* A file's own print is a function like any other. */
    CHECK_DUMP("void print(int i) {} void f() { print(3); }",
               "(func void print (int i) (block))\n(func void f (block (call print 3)))\n");
    CHECK_DUMP("", "");
    CHECK_DUMP("// nothing\r\n/* at\rall */", "");
    CHECK_DUMP("\xEF\xBB\xBF"
               "const int N = 1;\r\nconst int M = 2;\rconst int K = 3;",
               "(const (int N 1))\n(const (int M 2))\n(const (int K 3))\n");
}

/* Spans are what every later error points with. */
static void spans(void **state) {
    (void)state;
    const char *text = "const float c = a.b + f( x )[ 2 ];";
    Parsed p = parse_text(text);
    const Expr *sum = p.module->consts->init;
    assert_int_equal(p.module->consts->span.pos, 12);
    assert_int_equal(sum->span.pos, 16);
    assert_int_equal(sum->span.len, strlen("a.b + f( x )[ 2 ]"));
    assert_int_equal(sum->op_span.pos, 20);
    assert_int_equal(sum->op_span.len, 1);
    assert_int_equal(sum->a[0]->span.len, 3);
    assert_int_equal(sum->a[0]->op_span.pos, 18);
    assert_int_equal(sum->a[1]->span.len, strlen("f( x )[ 2 ]"));
    assert_int_equal(sum->a[1]->a[0]->span.len, strlen("f( x )"));
    assert_int_equal(sum->a[1]->a[0]->op_span.len, 1);
    assert_int_equal(sum->depth, 4);
    parsed_free(&p);
    p = parse_text("void f() {\n  if (a)\n    b();\n}\n");
    const Func *f = p.module->funcs;
    assert_int_equal(f->span.len, strlen("void f()"));
    assert_int_equal(f->name_span.pos, 5);
    assert_int_equal(f->end_span.pos, strlen("void f() {\n  if (a)\n    b();\n"));
    assert_int_equal(f->body->stmts[0]->span.pos, strlen("void f() {\n  "));
    assert_int_equal(f->body->stmts[0]->span.len, strlen("if (a)"));
    parsed_free(&p);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(literals), cmocka_unit_test(precedence),
                                       cmocka_unit_test(statements), cmocka_unit_test(file_scope),
                                       cmocka_unit_test(spans)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
