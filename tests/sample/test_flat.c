/* Boundary functions that are flat on a side, or have multiple, singular or rounded roots; untagged masks beside tagged
 * edges; marches by equal steps under [SkipLoop]. Every estimator, both precisions, several seeds: within four stated
 * errors, and within 1 % of the exact derivative. What cannot be had is not stated as 0. */
#define make_cases make_other_cases
#include "tests/sample/closed_forms.h"
#undef make_cases

#define DISC(condition) DISC_OF("", condition)
#define DISC_OF(before, condition)                                                                                     \
    SHADER2("param float r = 0.4;", UNIT,                                                                              \
            "float d = r - length(x);" before "[Disc] if (" condition ") return 1.0; return 0.0;")
#define ROUND .want = {{"r", 2 * PI * 0.4}}

static void make_flat_cases(void) {
    ncases = 0;
    /* ---- rewritten */
    CASE("max", DISC("max(d, 0.0) > 0.0"), ROUND);
    CASE("max, used beside",
         SHADER2("param float r = 0.4;", UNIT,
                 "float v = max(r - length(x), 0.0); [Disc] if (v > 0.0) return 1.0 + v; return 0.0;"),
         .want = {{"r", 2 * PI * 0.4 + PI * 0.16}});
    CASE("saturate", DISC("saturate(d) > 0.0"), ROUND);
    CASE("saturate, upper end", DISC("saturate(d + 1.0) >= 1.0"), ROUND);
    CASE("smoothstep", DISC("smoothstep(0.0, 0.1, d) > 0.0"), ROUND);
    CASE("smoothstep, upper end", DISC("smoothstep(0.0, 0.1, d) < 1.0"), .want = {{"r", -2 * PI * 0.3}});
    CASE("cube", DISC("d * d * d > 0.0"), ROUND);
    CASE("fifth power", DISC("pow(d, 5.0) > 0.0"), ROUND);
    CASE("cube root", DISC("cbrt(d) > 0.0"), ROUND);
    CASE("square root", DISC("sqrt(max(d, 0.0)) > 0.0"), ROUND);
    CASE("magnitude and itself", DISC("d + abs(d) > 0.0"), ROUND);
    CASE("magnitude less itself", DISC("!(abs(d) - d > 0.0)"), ROUND);
    CASE("itself less magnitude", DISC("d - abs(d) >= 0.0"), ROUND);
    CASE("arc", DISC("acos(clamp(length(x) / r, -1.0, 1.0)) > 0.0"), ROUND);
    CASE("length of what sticks out", DISC("length(max(abs(x) - float2(r, r), 0.0)) <= 0.0"), .want = {{"r", 8 * 0.4}});
    CASE("maximum of two", DISC("max(d, x.x) > x.x"), /* within the parabola x < (r^2 - y^2) / 2r, and above x = -1 */
         .want = {{"r", sqrt(0.96) + 0.96 * sqrt(0.96) / (3 * 0.16)}});
    /* ---- not rewritten: the search and the ends of brackets */
    CASE("chosen", DISC_OF("float h = 0.0; if (d > 0.0) h = d;", "h > 0.0"), ROUND);
    CASE("product with what varies", DISC("max(d * (1.0 + x.x * x.x), 0.0) * exp(x.y) + 1.0 > 1.0"), ROUND);
    CASE("sum of flat ones", DISC("max(d, 0.0) + max(2.0 * d, 0.0) * x.x * x.x > 0.0"), ROUND);
    CASE("sum of cubes", DISC("d * d * d + d * d * d * x.x * x.x > 0.0"), ROUND);
    CASE("cube root and more", DISC("cbrt(d) + 0.25 * d * x.x * x.x > 0.0"), ROUND);
    CASE("square root and more", DISC("sqrt(max(d, 0.0)) + max(d, 0.0) > 0.0"), ROUND);
    CASE("square with a sign", DISC("d * abs(d) > 0.0"), ROUND);
    CASE("far from 0", DISC("d + 1000.0 > 1000.0"), ROUND);
    /* ---- masks that stand still */
    CASE("beside a mask",
         SHADER2("param float r = 0.4;", UNIT,
                 "float f = 0.0; if (x.x > 0.1) { [Disc] if (length(x) < r) f = 1.0; } return f;"),
         .want = {{"r", 2 * 0.4 * acos(0.25)}});
    CASE("beside many",
         SHADER2("param float r = 0.4;", UNIT,
                 "float f = 0.0; if (frac(4.0 * x.x) < 0.5) { [Disc] if (length(x) < r) f = 1.0; } return f;"),
         .want = {{"r", PI * 0.4}});
    CASE("a radius by a mask",
         SHADER2("param float r = 0.4;", UNIT,
                 "float k = x.x > 0.1 ? 1.0 : 0.5; [Disc] if (length(x) < r * k) return 1.0; return 0.0;"),
         .want = {{"r", 2 * 0.4 * acos(0.25) + 0.5 * 2 * 0.2 * (PI - acos(0.5))}});
    /* In a loop each iteration has its own. Half of each circle is behind stripes; without them as events a twentieth
     * of the derivative was lost. */
#define IN_LOOP(n, body)                                                                                               \
    SHADER2("param float r = 0.3;", UNIT,                                                                              \
            "float f = 0.0; for (int i = 0; i < " n "; i++) { float turn = float(i) * 2.399963; float2 c = 0.3 * "     \
            "float2(cos(turn), sin(turn)); " body " } return f;")
#define STRIPES "frac(16.0 * (x.x - c.x)) < 0.5"
    CASE("a wall of bricks", /* a rounding of a rounding: of area 1 - (1 - m)^2 */
         SHADER2("param float m = 0.08;", "",
                 "float2 q = x * float2(4.0, 8.0); float row = floor(q.y); if ((int(row) & 1) == 1) q.x += 0.5; "
                 "float2 c = frac(q); [Disc] if (c.x < m || c.y < m) return 1.0; return 0.0;"),
         .want = {{"m", 2 * 0.92}});
    CASE("masks in a loop", IN_LOOP("8", "if (" STRIPES ") { [Disc] if (length(x - c) < r) f += 1.0; }"),
         .want = {{"r", 8 * PI * 0.3}});
    CASE("masks by continue", IN_LOOP("8", "if (!(" STRIPES ")) continue; [Disc] if (length(x - c) < r) f += 1.0;"),
         .want = {{"r", 8 * PI * 0.3}});
    CASE("masks in a long loop", IN_LOOP("80", "if (x.x > c.x) { [Disc] if (length(x - c) < r) f += 1.0; }"),
         .want = {{"r", 80 * PI * 0.3}});
    CASE("a mask that ends a loop", /* discs at -0.7, -0.5, .., 0.5, seen in x > -0.6, -0.4, .. */
         SHADER2("param float r = 0.3;", UNIT,
                 "float f = 0.0; for (int i = 0; i < 7; i++) { if (x.x < 0.2 * float(i) - 0.6) break; [Disc] if "
                 "(length(x - float2(0.2 * float(i) - 0.7, 0.0)) < r) f += 1.0; } return f;"),
         .want = {{"r", 7 * 2 * 0.3 * acos(1.0 / 3)}});
    CASE("the nearest of what stands still", /* discs cut off a quarter to the left and to the right */
         SHADER2("param float r = 0.3;", UNIT,
                 "float least = 1e9, s = 0.0; for (int i = 0; i < 4; i++) { float2 c = float2(0.5 * float(i) - 0.75, "
                 "0.0); float d = distance(x, c); if (d < least) { least = d; s = float(i); } } [Disc] if (least < r) "
                 "return 1.0 + s; return 0.0;"),
         .want = {{"r", 10 * 2 * 0.3 * (PI - 2 * acos(0.25 / 0.3))}});
    /* ---- [SkipLoop] on equal steps: discs of radius sqrt(r^2 - z^2), of which each hands on its own number */
    CASE("steps by number",
         SHADER2(
             "param float r = 0.4;", UNIT,
             "for (int i = 0; i < 32; i++) { [Disc, SkipLoop] if (length(float3(x, -1.0 + i / 16.0)) < r) return 1.0 "
             "* i; } return 0.0;"),
         .want = {{"r", 2 * PI * 0.4 * 10}}); /* steps 10 to 16 hide one another: 10 + 6 less 6 */
    CASE("steps by sum",
         SHADER2(
             "param float r = 0.4;", UNIT,
             "float t = -1.0; for (int i = 0; i < 32; i++) { [Disc, SkipLoop] if (length(float3(x, t)) < r) return t; "
             "t += 0.0625; } return 1.0;"),
         .want = {{"r", 2 * PI * 0.4 * -1.375}}); /* 1 to 0 at the silhouette, and 6 steps of 1/16 inside */
    CASE("steps that only ask whether",
         SHADER2("param float r = 0.4;", UNIT,
                 "float t = -1.0; for (int i = 0; i < 32; i++) { [Disc, SkipLoop] if (length(float3(x, t)) < r) return "
                 "1.0; t += 0.0625; } return 0.0;"),
         ROUND);
}

enum { SEEDS = 3 };

static void run(const Case *c, bool f64) {
    SltJob job = SLT_JOB_INIT;
    job.integral = true, job.samples = 1u << 18, job.threads = 2;
    double least = f64 ? 1e-8 : 1e-3; /* f32: the root lies where the decision is rounded */
    job.estimator = SLT_EST_QUADRATURE;
    run_case(c, &job, f64, least, 4);
    job.estimator = SLT_EST_AUTO;
    run_case(c, &job, f64, least, 4);
    job.estimator = SLT_EST_LATTICE;
    run_case(c, &job, f64, 0.01, 0);
    for (job.seed = 0; job.seed < SEEDS; job.seed++) run_case(c, &job, f64, least, 4);
}
static void run_f32(void **state) { run(*state, false); }
static void run_f64(void **state) { run(*state, true); }

/* A root of third order by cancellation, which leaves no gradient in single precision: no number is claimed. */
static void test_unknown(void **state) {
    (void)state;
    const Case c = {.name = "d - sin(d)", .source = DISC("d - sin(d) > 0.0"), ROUND};
    SltJob job = SLT_JOB_INIT;
    job.integral = true, job.samples = 1u << 18, job.threads = 2, job.estimator = SLT_EST_LATTICE;
    run_case(&c, &job, false, 0, 1);
}

int main(void) {
    make_flat_cases();
    (void)make_other_cases;
    static struct CMUnitTest tests[80];
    static char names[80][96];
    int n = 0;
    for (int i = 0; i < ncases; i++)
        for (int f64 = 0; f64 < 2; f64++, n++) {
            snprintf(names[n], sizeof names[n], "%s, %s", cases[i].name, f64 ? "f64" : "f32");
            tests[n] = (struct CMUnitTest){names[n], f64 ? run_f64 : run_f32, NULL, NULL, &cases[i]};
        }
    tests[n++] = (struct CMUnitTest){"unknown", test_unknown, NULL, NULL, NULL};
    return _cmocka_run_group_tests("flat", tests, (size_t)n, NULL, NULL);
}
