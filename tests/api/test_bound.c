/* slt_bound: no point that slt_eval takes contradicts its box; events have their places; structs of other versions, bad
 * boxes. */
#include <math.h>

#include "tests/api/program.h"

static const char rings[] = "param float r = 0.5;\n"
                            "[Domain(-1.0, 1.0)] shader float2 main(float2 x) {\n"
                            "    float f = 0.1 * x.x;\n"
                            "    for (int i = 0; i < 3; i++)\n"
                            "        [Disc] if (length(x) < r * float(i + 1) / 3.0) f = f + 1.0;\n"
                            "    return float2(f, max(f, x.y));\n"
                            "}\n";

static double uniform(uint64_t *state) {
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (double)(*state >> 11) * 0x1p-53;
}

static void no_point_contradicts(void **state) {
    (void)state;
    enum { BOXES = 500, POINTS = 64 };
    static double lo[BOXES][2], hi[BOXES][2], x[POINTS][2], f[POINTS][2];
    static SltBound out[BOXES];
    SltError err;
    for (int form = 0; form < 4; form++) {
        SltOptions opt = SLT_OPTIONS_INIT;
        opt.f64 = form & 1, opt.interpret = form & 2;
        SltProgram *p = compile_with(rings, opt);
        uint64_t seed = 17;
        for (int i = 0; i < BOXES; i++) {
            double side = pow(10, -7 * uniform(&seed));
            for (int d = 0; d < 2; d++) lo[i][d] = 2 * uniform(&seed) - 1, hi[i][d] = lo[i][d] + side * uniform(&seed);
            if (i % 10 == 0) hi[i][0] = lo[i][0], hi[i][1] = lo[i][1];
            out[i] = SLT_BOUND_INIT;
        }
        assert_ok(slt_bound(p, NULL, BOXES, *lo, *hi, out, &err));
        for (int i = 0; i < BOXES; i++) {
            const SltBound *b = &out[i];
            assert_true(b->struct_size == sizeof *b && b->listed <= b->count && b->listed <= SLT_BOUND_OPEN);
            for (int k = 0; k < POINTS; k++)
                for (int d = 0; d < 2; d++)
                    x[k][d] = k < 4 ? (k >> d & 1 ? hi : lo)[i][d] : lo[i][d] + (hi[i][d] - lo[i][d]) * uniform(&seed);
            assert_ok(slt_eval(p, NULL, POINTS, *x, NULL, *f, NULL, &err));
            for (int k = 0; k < POINTS; k++) {
                for (int c = 0; c < 2; c++) assert_true(f[k][c] >= b->lo[c] && f[k][c] <= b->hi[c]);
                /* In a settled box all points have the same number of rings around them. */
                if (b->settled) assert_true(rint(f[k][0]) == rint(f[0][0]));
            }
            for (uint32_t e = 0; e < b->listed; e++) {
                const SltOpenEvent *o = &b->open[e];
                assert_string_equal(o->file, "t.salt");
                assert_true(o->seam == ((uint32_t)o->edge >= slt_site_count(p)));
                assert_int_equal(o->line, o->seam ? 6 : 5);
                if (!o->seam) assert_true(o->loops == 1 && o->k[0] >= 0 && o->k[0] < 3);
                assert_true(o->g[0] <= 0 && o->g[1] >= 0);
            }
        }
        slt_program_free(p);
    }
}

/* A call with parameters of its own bounds the program that they make. */
static void parameters_of_one_call(void **state) {
    (void)state;
    SltError err;
    SltProgram *p = compile(rings);
    double lo[2] = {0.6, 0.6}, hi[2] = {0.61, 0.61}, small[1] = {0.5}, large[1] = {3};
    SltBound out[2] = {SLT_BOUND_INIT, SLT_BOUND_INIT};
    SltJob job = SLT_JOB_INIT;
    job.floats = small;
    assert_ok(slt_bound(p, &job, 1, lo, hi, &out[0], &err));
    job.floats = large;
    assert_ok(slt_bound(p, &job, 1, lo, hi, &out[1], &err));
    assert_true(out[1].hi[0] >= 3.06 && slt_floats(p)[0] == 0.5);
    assert_true(out[0].lo[0] <= 0.0611);
    slt_program_free(p);
}

static void bad_calls(void **state) {
    (void)state;
    SltError err;
    SltProgram *p = compile(rings);
    static const double bad[][2] = {{NAN, 1}, {0, NAN}, {-INFINITY, 0}, {0, INFINITY}, {0, 1e300}, {1, 0}};
    SltBound out = SLT_BOUND_INIT;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        double lo[2] = {0, bad[i][0]}, hi[2] = {0, bad[i][1]};
        assert_int_equal(slt_bound(p, NULL, 1, lo, hi, &out, &err), SLT_USAGE);
        assert_non_null(strstr(err.text, "axis 1"));
    }
    double lo[2] = {0, 0}, hi[2] = {0.1, 0.1};
    SltBound pair[2] = {SLT_BOUND_INIT, {0}};
    assert_int_equal(slt_bound(p, NULL, 2, lo, hi, pair, &err), SLT_USAGE);
    assert_int_equal(slt_bound(p, NULL, 1, lo, hi, &pair[1], &err), SLT_USAGE);
    assert_ok(slt_bound(p, NULL, 0, NULL, NULL, NULL, &err));
    slt_program_free(p);
}

/* A caller of another version has another stride. */
static void structs_of_other_versions(void **state) {
    (void)state;
    SltError err;
    SltProgram *p = compile(rings);
    double lo[3][2] = {{0, 0}, {0.9, 0.9}, {0.2, 0.2}}, hi[3][2] = {{0.01, 0.01}, {0.91, 0.91}, {0.21, 0.21}};
    SltBound now[3] = {SLT_BOUND_INIT, SLT_BOUND_INIT, SLT_BOUND_INIT};
    assert_ok(slt_bound(p, NULL, 3, *lo, *hi, now, &err));
    struct Newer {
        SltBound b;
        double more;
    } newer[3];
    struct Older {
        size_t struct_size;
        bool settled, unknown;
    } older[3];
    for (int i = 0; i < 3; i++) {
        newer[i] = (struct Newer){.b = {.struct_size = sizeof *newer}, .more = 0};
        older[i] = (struct Older){.struct_size = sizeof *older};
    }
    assert_ok(slt_bound(p, NULL, 3, *lo, *hi, &newer[0].b, &err));
    assert_ok(slt_bound(p, NULL, 3, *lo, *hi, (SltBound *)older, &err));
    for (int i = 0; i < 3; i++) {
        assert_true(newer[i].b.struct_size == sizeof *newer && older[i].struct_size == sizeof *older);
        assert_true(newer[i].b.lo[1] == now[i].lo[1] && newer[i].b.count == now[i].count && newer[i].more == 0);
        assert_true(older[i].settled == now[i].settled && older[i].unknown == now[i].unknown);
    }
    slt_program_free(p);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(no_point_contradicts), cmocka_unit_test(parameters_of_one_call),
                                       cmocka_unit_test(bad_calls), cmocka_unit_test(structs_of_other_versions)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
