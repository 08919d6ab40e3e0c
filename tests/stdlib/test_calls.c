/* Who asks for sites in library functions: the statement that calls them, by [Disc] or --disc auto. */
#include "tests/stdlib/fixture.h"

static const char SAW[] = "import glsl;\nparam float phase = 0.13;\nshader float main(vec2 x) { %s }\n";

/* Sites and W0401 of a program; messages stand in the program's own file. */
static void count(const char *source, bool disc_auto, uint32_t *sites, uint32_t *warnings) {
    SltOptions opt = SLT_OPTIONS_INIT;
    opt.stdlib_dir = SALTUS_STDLIB_BUILD;
    opt.disc_auto = disc_auto;
    SltProgram *p = NULL;
    if (slt_compile_string(source, "test.salt", &opt, &p) != SLT_OK)
        fail_msg("%s\n%s", source, slt_diagnostics_text(p));
    *sites = slt_site_count(p), *warnings = 0;
    for (uint32_t i = 0; i < slt_diagnostic_count(p); i++) {
        SltDiagnostic d = SLT_DIAGNOSTIC_INIT;
        if (!slt_diagnostic(p, i, &d) || strcmp(d.code, "W0401") != 0) continue;
        assert_string_equal(d.file, "test.salt");
        ++*warnings;
    }
    slt_program_free(p);
}

static void expect(const char *source, bool disc_auto, uint32_t sites, uint32_t warnings) {
    uint32_t s, w;
    count(source, disc_auto, &s, &w);
    if (s != sites || w != warnings) fail_msg("%s\n%u sites for %u, %u warnings for %u", source, s, sites, w, warnings);
}

static void test_only_who_asks(void **state) {
    (void)state;
    static const struct {
        const char *body;
        bool disc_auto;
        uint32_t sites, warnings;
    } cases[] = {
        {"return fract(3.3 * x.x + phase);", false, 0, 1},
        {"[Disc] return fract(3.3 * x.x + phase);", false, 1, 0},
        {"[NoDisc] return fract(3.3 * x.x + phase);", false, 0, 0},
        {"return fract(3.3 * x.x + phase);", true, 1, 0},
        {"[NoDisc] return fract(3.3 * x.x + phase);", true, 0, 0},
        /* Asked by one of two statements. */
        {"float a = fract(3.3 * x.x + phase); [Disc] return a + mod(x.y + phase, 0.3);", false, 1, 1},
        /* In an arm that is not always taken, and in a loop's header. */
        {"[Disc] return x.x < 0.5 ? fract(3.3 * x.y + phase) : 0.0;", false, 2, 0},
        {"float s = 0.0; [Disc] for (int i = 0; i < 4 && fract(x.x + phase) < 0.5; i++) s += 1.0; return s;", false, 2,
         0},
        /* Continuous in spite of its fract: nothing to ask, nothing to say. */
        {"float f = fract(3.3 * x.x + phase); return f * (1.0 - f);", false, 0, 0},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char source[512];
        snprintf(source, sizeof source, SAW, cases[i].body);
        expect(source, cases[i].disc_auto, cases[i].sites, cases[i].warnings);
    }
}

/* A tag reaches through library functions that call others; continuous ones have no site for anyone. */
static void test_reach(void **state) {
    (void)state;
    static const char noise[] = "import noise;\nparam float s = 2.1;\nshader float main(float2 x) { %s }\n";
    char source[512];
    snprintf(source, sizeof source, noise, "[Disc] return voronoi(s * x).y;");
    expect(source, false, 1, 0);
    snprintf(source, sizeof source, noise, "return voronoi(s * x).y;");
    expect(source, false, 0, 1);
    snprintf(source, sizeof source, noise, "return fbm(s * x, 4) + value_noise(s * x) + worley(s * x).x;");
    expect(source, true, 0, 0);
}

/* A cloud as people paste it: value noise over a hash by fract(sin()), five octaves. */
static void test_cloud(void **state) {
    (void)state;
    expect(
        "import glsl;\nparam float wind = 0.13;\n"
        "float h(vec2 p) { return fract(sin(dot(p, vec2(12.9898, 78.233))) * 43758.5453); }\n"
        "float v(vec2 p) { [NoDisc] vec2 i = floor(p); vec2 f = fract(p), u = f * f * (3.0 - 2.0 * f);\n"
        "    return mix(mix(h(i), h(i + vec2(1.0, 0.0)), u.x), mix(h(i + vec2(0.0, 1.0)), h(i + 1.0), u.x), u.y); }\n"
        "shader float main(vec2 x) { float s = 0.0, a = 0.5; vec2 p = 4.0 * x + wind;\n"
        "    for (int i = 0; i < 5; i++) { s += a * v(p); p *= 2.0; a *= 0.5; } return s; }\n",
        false, 0, 0);
}

/* [Disc] on a call that cannot jump is the mistake that it is elsewhere. */
static void test_nothing_to_ask(void **state) {
    (void)state;
    SltOptions opt = SLT_OPTIONS_INIT;
    opt.stdlib_dir = SALTUS_STDLIB_BUILD;
    SltProgram *p = NULL;
    SltStatus s = slt_compile_string("import sdf;\nparam float r = 0.4;\nshader float main(float2 x) { [Disc] float d "
                                     "= sd_box(x, float2(r)); return d; }\n",
                                     "test.salt", &opt, &p);
    assert_int_not_equal(s, SLT_OK);
    assert_non_null(strstr(slt_diagnostics_text(p), "E0401"));
    slt_program_free(p);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_only_who_asks),
        cmocka_unit_test(test_reach),
        cmocka_unit_test(test_cloud),
        cmocka_unit_test(test_nothing_to_ask),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
