/* csg.salt: set operations by their closed forms, the volumes they leave, parts on the surface. */
#include "tests/stdlib/table.h"

static double r_union(const double *v) { return v[0] + v[1] - hypot(v[0], v[1]); }
static double r_intersect(const double *v) { return v[0] + v[1] + hypot(v[0], v[1]); }
static double r_subtract(const double *v) { return v[0] - v[1] + hypot(v[0], v[1]); }
static double exclusive(const double *v) { return fmax(fmin(v[0], v[1]), -fmax(v[0], v[1])); }
static double first(const double *v) { return fmin(fmin(v[0], v[1]), fmax(v[2], -v[3])); }
static double soft(const double *v) {
    double sum = 0;
    for (int i = 0; i < 5; i++) sum += exp(-v[i] / 0.1);
    return -0.1 * log(sum);
}
static double inside(double d, double k) { return 1 / (1 + exp(d / k)); }
static double occupied(const double *v) {
    double a = inside(v[0], 0.3), b = inside(v[1], 0.3), c = inside(v[2], 0.3);
    return a + b - a * b - a * b * c + (a - a * c);
}
static double mixed(const double *v) {
    double e[4], sum = 0, a = v[4], b = v[5];
    for (int i = 0; i < 4; i++) sum += e[i] = exp(v[i]);
    return (e[0] * a * b + e[1] * (a + b - a * b) + e[2] * (a - a * b) + e[3] * (b - a * b)) / sum;
}

static const Case cases[] = {
    {.body = "r_union(v[0], v[1])", .want = r_union},
    {.body = "r_intersect(v[0], v[1])", .want = r_intersect},
    {.body = "r_subtract(v[0], v[1])", .want = r_subtract},
    {.body = "csg_xor(v[0], v[1])", .want = exclusive},
    {.body = "return csg_union(csg_union(csg_solid(v[0], 0), csg_solid(v[1], 1)), "
             "csg_subtract(csg_solid(v[2], 2), csg_solid(v[3], 3))).d;",
     .want = first},
    {.body = "SoftUnion s = soft_union_begin(); for (int i = 0; i < 5; i++) s = soft_union_add(s, v[i], 0.1); "
             "return soft_union_end(s, 0.1);",
     .want = soft},
    {.body = "float a = occupancy(v[0], 0.3), b = occupancy(v[1], 0.3), c = occupancy(v[2], 0.3); return "
             "occupied_union(a, b) - occupied_intersect(occupied_intersect(a, b), c) + occupied_subtract(a, c);",
     .want = occupied},
    {.body = "occupied_mix(v[4], v[5], csg_choice(" VEC4(0) "))", .want = mixed},
};

static void test_closed_forms(void **state) {
    (void)state;
    TABLE_RUN("csg", cases);
}

static double value_and_slope(const char *source, double *slope, double *se, uint32_t *sites) {
    SltProgram *p = compile(source, NULL);
    SltJob job = SLT_JOB_INIT;
    SltError err = {0};
    double value;
    SltIntegral out = {.struct_size = sizeof out, .value = &value, .gradient = slope, .gradient_stderr = se};
    job.integral = true, job.samples = 1 << 15, job.threads = 1;
    if (slt_grad_integral(p, &job, &out, NULL, &err) != SLT_OK) fail_msg("%s", err.text);
    *sites = slt_site_count(p);
    slt_program_free(p);
    return value;
}

/* A half-plane x < s cut from, met with, or joined to the half-plane y < 1/2 of the unit square: every family has the
 * same set, so the same area and the same derivative. */
static void test_sets(void **state) {
    (void)state;
    static const struct {
        const char *set;
        double area, slope;
    } sets[] = {
        {"r_union(a, b)", 0.65, 0.5},
        {"r_intersect(a, b)", 0.15, 0.5},
        {"r_subtract(b, a)", 0.35, -0.5},
        {"csg_xor(a, b)", 0.5, 0},
        {"csg_intersect(csg_solid(a, 0), csg_solid(b, 1)).d", 0.15, 0.5},
        {"csg_subtract(csg_solid(b, 0), csg_solid(a, 1)).d", 0.35, -0.5},
    };
    for (size_t i = 0; i < sizeof sets / sizeof *sets; i++) {
        char source[512];
        snprintf(source, sizeof source,
                 "import csg;\nparam float s = 0.3;\nshader float main(float2 x) { float a = x.x - s, b = x.y - 0.5;\n"
                 "    [NoDisc] float d = %s; [Disc] if (d < 0.0) return 1.0; return 0.0; }\n",
                 sets[i].set);
        double slope, se;
        uint32_t sites;
        double area = value_and_slope(source, &slope, &se, &sites);
        assert_int_equal(sites, 1);
        if (fabs(area - sets[i].area) > 2e-3 || fabs(slope - sets[i].slope) > 6 * se + 2e-3)
            fail_msg("%s: area %.6g, slope %.6g +- %.2g", sets[i].set, area, slope, se);
    }
}

/* The part that shows jumps where two distances tie: sites of the tagged statement. */
static void test_parts(void **state) {
    (void)state;
    double slope, se;
    uint32_t sites;
    double mean = value_and_slope("import csg;\nparam float s = 0.3;\nshader float main(float2 x) { [Disc] Csg c = "
                                  "csg_union(csg_solid(x.x - s, 1), csg_solid(s - x.x, 4)); return c.part; }\n",
                                  &slope, &se, &sites);
    assert_int_equal(sites, 1);
    /* 1 on [0, s], 4 behind. */
    assert_true(fabs(mean - 3.1) < 1e-2 && fabs(slope + 3) < 6 * se + 1e-3);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_closed_forms),
        cmocka_unit_test(test_sets),
        cmocka_unit_test(test_parts),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
