/* Values as JSON: there are two readers, a quick one for what slt_params_json writes, and one for the rest, with the
 * words. Whatever the text is, both must come to the same; an escape in a name makes it one for the second. */
#include "bindings/c/api.h"
#include "bindings/c/values_plain.h"
#include "tests/api/program.h"
#include "tests/scratch.h"

#include <locale.h>
#include <stdbool.h>

static const char program[] =
    "struct In { float q; int tag; };\nstruct S { float2 c; In inner[2]; bool on; };\n"
    "param float a = 1.0;\nparam float3 v = float3(1.0);\nparam float2x3 m = float2x3(1.0, 2.0, 3.0, 4.0, 5.0, 6.0);\n"
    "param S s[2] = { { float2(1.0), { { 1.0, 1 }, { 2.0, 2 } }, true }, { float2(1.0), { { 1.0, 1 }, { 2.0, 2 } }, false } };\n"
    "param float w[2][3] = { { 1.0, 2.0, 3.0 }, { 4.0, 5.0, 6.0 } };\nparam texture2D t = zeros(3, 2, 2);\n"
    "param texture2D g = zeros(2, 2, 1);\nparam int n = 1;\nparam uint u = 1u;\nparam bool on = true;\nparam int2 k = int2(1, 2);\n"
    "shader float main(float2 x) { return a + v.x + m[0][1] + s[1].c.y + w[1][2] + t.sample(x).x + g.sample(x).x + n + k.x; }\n";

static const char rest[] =
    "\n\"v\": [-0.0, 1e-3, 12345678901234567890123.25e-7], \"m\": [[1, 2.5, 3], [4e0, -5E+1, 6]],\n"
    "\"s\": [{\"c\": [1, 2], \"inner\": [{\"q\": 0.1, \"tag\": -2147483648}, {\"q\": 3.14159, \"tag\": 7}], \"on\": false},\n"
    "{\"c\": [3, 4], \"inner\": [{\"q\": 1e300, \"tag\": 0}, {\"q\": 4.9e-324, \"tag\": 2147483647}], \"on\": true}],\n"
    "\"w\": [[0, -1, 123456789012345678], [0.30000000000000004, 1e22, 9007199254740993]],\n"
    "\"t\": [[[1, 2], [3, 4], [5, 6]], [[7, 8], [9, 10], [11, 12]]], \"g\": [[1, 2], [3, 4]], \"n\": -12, \"u\": 4294967295,\n"
    "\"on\": true, \"k\": [5, -6]}";

typedef struct Read {
    SltStatus status;
    double floats[64];
    int32_t ints[32];
    char text[sizeof((SltError *)NULL)->text];
} Read;

static void read_text(SltProgram *p, const char *name, const char *text, Read *out) {
    static char all[4096];
    SltError err = {0};
    const double floats[64] = {0};
    const int32_t ints[32] = {0};
    memset(out, 0, sizeof *out);
    assert_ok(slt_set_floats(p, 0, slt_float_count(p), floats, &err));
    assert_ok(slt_set_ints(p, 0, slt_int_count(p), ints, &err));
    snprintf(all, sizeof all, "{\"%s\": 7.25, %s", name, text);
    err = (SltError){0};
    out->status = slt_set_params_json(p, all, "f.json", &err);
    memcpy(out->floats, slt_floats(p), slt_float_count(p) * sizeof(double));
    memcpy(out->ints, slt_ints(p), slt_int_count(p) * sizeof(int32_t));
    memcpy(out->text, err.text, sizeof out->text);
}

static SltStatus agree(SltProgram *p, const char *text) {
    static Read quick, other;
    read_text(p, "a", text, &quick);
    read_text(p, "\\u0061", text, &other);
    if (quick.status != other.status || strcmp(quick.text, other.text) != 0)
        fail_msg("%s: %d %s, and %d %s", text, quick.status, quick.text, other.status, other.text);
    if (memcmp(quick.floats, other.floats, sizeof quick.floats) || memcmp(quick.ints, other.ints, sizeof quick.ints))
        fail_msg("%s: the values differ", text);
    return quick.status;
}

static uint32_t next(void) {
    static uint64_t state = 1;
    state = state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return (uint32_t)(state >> 33);
}

static void readers_agree(void **state) {
    (void)state;
    static const char *const pieces[] = {"0",
                                         "1",
                                         "9",
                                         ".",
                                         "-",
                                         "+",
                                         "e",
                                         "E",
                                         "x",
                                         "[",
                                         "]",
                                         "{",
                                         "}",
                                         ",",
                                         ":",
                                         "\"",
                                         " ",
                                         "\n",
                                         "\t",
                                         "\v",
                                         "null",
                                         "true",
                                         "\"inf\"",
                                         "1e999",
                                         "-0",
                                         "\"a\": 1,",
                                         "00",
                                         "0x1",
                                         "\"v\": [1, 2, 3],",
                                         "12345678901234567890",
                                         "/",
                                         "\xff",
                                         "5e-1",
                                         "\"c\"",
                                         "\\",
                                         "4294967296",
                                         "-2147483649",
                                         "\"w[0][1]\": 3,",
                                         "nan"};
    SltOptions opt = SLT_OPTIONS_INIT;
    opt.interpret = opt.f64 = true;
    SltProgram *p = compile_with(program, opt);
    assert_in_range(slt_float_count(p), 30, 64);
    assert_in_range(slt_int_count(p), 8, 32);
    assert_int_equal(agree(p, rest), SLT_OK);
    uint32_t fine = 0, changes = 6000;
    for (uint32_t i = 0; i < changes; i++) {
        char text[sizeof rest + 64];
        const char *piece = pieces[next() % (sizeof pieces / sizeof *pieces)];
        size_t at = 1 + next() % (sizeof rest - 2), n = strlen(piece), cut = next() % 3;
        if (cut > sizeof rest - 1 - at) cut = 0;
        memcpy(text, rest, at);
        memcpy(text + at, piece, n);
        memcpy(text + at + n, rest + at + cut, sizeof rest - at - cut);
        fine += agree(p, text) == SLT_OK;
    }
    assert_in_range(fine, changes / 50, changes / 2);
    double floats[64];
    int32_t ints[32];
    agree(p, rest);
    char *text = slt_params_json(p);
    assert_true(plain_params(p->prog, text, floats, ints)); /* of all types, what we write */
    assert_memory_equal(floats, slt_floats(p), slt_float_count(p) * sizeof *floats);
    assert_memory_equal(ints, slt_ints(p), slt_int_count(p) * sizeof *ints);
    free(text);
    slt_program_free(p);
}

/* In either precision, numbers come back with the same bits. */
static void returns(void **state) {
    (void)state;
    SltError err = {0};
    for (int f64 = 0; f64 < 2; f64++) {
        SltOptions opt = SLT_OPTIONS_INIT;
        opt.interpret = true, opt.f64 = f64;
        SltProgram *p = compile_with("float none(int i) { return 0.0; }\nparam float a[20000] = init(none);\n"
                                     "shader float main(float x) { return a[0] + x; }\n",
                                     opt);
        static double want[20000];
        for (int i = 0; i < 20000; i++) want[i] = f64 ? 1.0 / (i + 1) : (double)(1.0f / (float)(i + 1));
        assert_ok(slt_set_floats(p, 0, 20000, want, &err));
        char *text = slt_params_json(p);
        const double zero[20000] = {0};
        assert_ok(slt_set_floats(p, 0, 20000, zero, &err));
        assert_ok(slt_set_params_json(p, text, "a.json", &err));
        for (int i = 0; i < 20000; i++) {
            double got = slt_floats(p)[i];
            if (f64 ? got != want[i] : (float)got != (float)want[i]) fail_msg("%d: %a, not %a", i, got, want[i]);
        }
        free(text);
        slt_program_free(p);
    }
}

/* A host that has chosen a locale in which numbers have a comma gives and gets the same numbers. */
static void comma(void **state) {
    (void)state;
    char line[600];
    snprintf(line, sizeof line, "localedef -i de_DE -f ISO-8859-1 '%s' >'%s' 2>&1", scratch_path("de_DE"),
             scratch_path("log"));
    bool made = system(line) == 0;
    setenv("LOCPATH", scratch, 1);
    if (!setlocale(LC_ALL, "de_DE") || strcmp(localeconv()->decimal_point, ",") != 0)
        print_message("%s\n", made ? "the locale cannot be chosen" : "no locale with a comma");
    SltError err = {0};
    SltOptions opt = SLT_OPTIONS_INIT;
    const SltSet set[] = {{"K", "2.5"}};
    opt.interpret = opt.f64 = true, opt.set = set, opt.nset = 1;
    SltProgram *p = compile_with("const float K = 1.5;\nparam float a = 0.25;\nparam float2 b = float2(K, 1.0e-1);\n"
                                 "shader float main(float x) { return a + b.x + x; }\n",
                                 opt);
    char *text = slt_params_json(p);
    assert_string_equal(text, "{\n  \"a\": 0.25,\n  \"b\": [2.5, 0.1]\n}\n");
    assert_ok(slt_set_text(p, "a", "1.75", &err));
    assert_ok(slt_set_text(p, "b", "0.5, 0.125", &err));
    assert_true(slt_floats(p)[0] == 1.75 && slt_floats(p)[1] == 0.5 && slt_floats(p)[2] == 0.125);
    assert_ok(slt_set_params_json(p, text, "back", &err));
    assert_true(slt_floats(p)[0] == 0.25 && slt_floats(p)[1] == 2.5 && slt_floats(p)[2] == 0.1);
    assert_ok(slt_set_params_json(p, "{\"\\u0061\": 3.5}", "slow", &err));
    assert_true(slt_floats(p)[0] == 3.5);
    free(text);
    slt_program_free(p);
    setlocale(LC_ALL, "C");
}

/* Names, right and wrong ones, may be asked for ever: nothing of it stays, and where memory ends there is a status. */
static void asking_takes_nothing(void **state) {
    (void)state;
    SltError err;
    SltParam q = SLT_PARAM_INIT;
    SltProgram *p = compile(program);
    ArenaBudget *budget = &p->session->budget;
    enum { LONG = 1 << 17 };
    char *wrong = malloc(LONG + 1), *json = malloc(LONG + 32);
    memset(wrong, 'a', LONG), wrong[LONG] = 0;
    sprintf(json, "{\"%s\": 1}", wrong);
    const char *names[] = {wrong}, *right[] = {"s[*].inner[0].q"};
    size_t used = budget->used, limit = budget->limit;
    for (int round = 0; round < 3; round++) {
        SltStatus want = round ? SLT_LIMIT : SLT_USAGE;
        if (round) budget->limit = used; /* as if a GiB of questions had been asked */
        for (int i = 0; i < 2000; i++) {
            assert_ok(slt_set_text(p, "s[1].inner[0].q", "3", &err));
            assert_ok(slt_param_find(p, "s[1].inner[0].tag", &q, &err));
            assert_ok(slt_wrt(p, right, 1, &err));
        }
        assert_int_equal(slt_param_find(p, wrong, &q, &err), want);
        assert_int_equal(slt_set_text(p, wrong, "3", &err), want);
        assert_int_equal(slt_wrt(p, names, 1, &err), want);
        assert_int_equal(slt_set_params_json(p, json, "a.json", &err), round ? SLT_LIMIT : SLT_INPUT);
        assert_int_equal(budget->used, used);
    }
    assert_non_null(strstr(err.text, "out of memory"));
    budget->limit = limit;
    slt_program_free(p);
    free(wrong);
    free(json);
}

/* Open arrays have the lengths of the values that are going to be set; nothing else of these is looked at. */
static void lengths(void **state) {
    (void)state;
    static const char source[] =
        "struct D { float2 c; int tag; };\nparam D ds[] = { { float2(1.0), 1 } };\nparam float v[] = { 1.0, 2.0 };\n"
        "param float fixed[2] = { 1.0, 2.0 };\nshader float main(float2 x) { return len(ds) + len(v) + fixed[0]; }\n";
    static const struct {
        const char *text;
        uint32_t ds, v;
    } rows[] = {{"{\"ds\": [{\"c\": [1, 2], \"tag\": 1}, {\"c\": [1, 2], \"tag\": 1}], \"fixed\": [1, 2, 3]}", 2, 2},
                {" {\"a,]\\\"b\": [{}, \"[\"], \"v\" : [ 1,[2] , {\"x\": [3, 4]}]}", 1, 3},
                {"{\"v\": 3, \"ds\": {\"v\": [1, 2, 3]}}", 1, 2},
                {"{\"v\": [1, 2, 3", 1, 2},
                {"{\"v\": [1, 2, \"3", 1, 2},
                {"{\"x\": \"\\", 1, 2},
                {"[1, 2]", 1, 2},
                {"", 1, 2}};
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        SltOptions opt = SLT_OPTIONS_INIT;
        char *text = strdup(rows[i].text);
        SltError err;
        opt.lengths = text;
        SltProgram *p = compile_with(source, opt);
        free(text);
        if (param(p, "ds").shape[0] != rows[i].ds || param(p, "v").shape[0] != rows[i].v)
            fail_msg("%s: %u and %u", rows[i].text, param(p, "ds").shape[0], param(p, "v").shape[0]);
        assert_int_equal(param(p, "fixed").shape[0], 2);
        if (!i)
            assert_ok(slt_set_params_json(p, "{\"ds\": [{\"c\": [1, 2], \"tag\": 1}, {\"c\": [3, 4], \"tag\": 5}]}",
                                          "f", &err));
        assert_int_equal(slt_ints(p)[param(p, "ds[0].tag").ibase], 1);
        assert_true(slt_floats(p)[param(p, "v[0]").fbase] == (rows[i].v == 3 ? 0 : 1));
        slt_program_free(p);
    }
}

/* Textures have the sizes of rows that are going to be set; what is no rows of texels leaves them as the source says.
 */
static void sizes(void **state) {
    (void)state;
    static const char source[] = "param texture2D t = zeros(2, 2, 3);\nparam heightfield h = zeros(4, 4);\n"
                                 "param texture3D v = zeros(2, 2, 2, 1);\nshader float main(float2 x) {\n"
                                 "    return t.sample(x).x + h.height(x) + v.sample(float3(x, 0.5)).x;\n}\n";
    static const struct {
        const char *text, *wrong;
        uint32_t t[3], h[2], v[4];
    } rows[] = {{"{}", NULL, {2, 2, 3}, {4, 4}, {2, 2, 2, 1}},
                {"{\"t\": [[0, 0, 0], 0], \"h\": [[1, 2], [3, 4], [5, 6]]}", NULL, {3, 2, 1}, {2, 3}, {2, 2, 2, 1}},
                {"{\"t\": [[[0, 0, 0, 0]]], \"v\": [[[0, 0], 0], 0, 0]}", NULL, {1, 1, 4}, {4, 4}, {2, 2, 3, 1}},
                {"{\"v\": [[[[1, 2]]]], \"t\": [1, 2, 3], \"h\": [1]}", NULL, {2, 2, 3}, {4, 4}, {1, 1, 1, 2}},
                {"{\"h\": [[1, 2]]}", "2 x 1", {0}, {0}, {0}},
                {"{\"h\": [[[1, 2], 0], 0]}", "2 channels", {0}, {0}, {0}},
                {"{\"t\": [[[1, 2, 3, 4, 5]]]}", "5 channels", {0}, {0}, {0}}};
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        SltOptions opt = SLT_OPTIONS_INIT;
        opt.lengths = rows[i].text;
        SltProgram *p = NULL;
        SltStatus status = slt_compile_string(source, NULL, &opt, &p);
        assert_int_equal(status, rows[i].wrong ? SLT_INPUT : SLT_OK);
        if (rows[i].wrong) {
            assert_non_null(strstr(slt_diagnostics_text(p), rows[i].wrong));
        } else {
            SltParam t = param(p, "t"), h = param(p, "h"), v = param(p, "v");
            const uint32_t found[] = {t.tex_w, t.tex_h, t.tex_c, h.tex_w, h.tex_h, v.tex_w, v.tex_h, v.tex_d, v.tex_c};
            assert_memory_equal(found, rows[i].t, sizeof found);
        }
        slt_program_free(p);
    }
}

/* A texture has all its sizes, ones too, and a part of it those behind its indices. */
static void sizes_of_one(void **state) {
    (void)state;
    SltProgram *p = compile_with("param texture2D t = zeros(1, 3, 1);\nparam texture3D v = zeros(1, 1, 1, 3);\n"
                                 "shader float main(float2 x) { return t.sample(x).x + v.sample(float3(x, 0.5)).x; }\n",
                                 (SltOptions)SLT_OPTIONS_INIT);
    static const struct {
        const char *name;
        uint32_t rank, shape[4];
    } rows[] = {{"t", 2, {3, 1}},       {"t[1]", 1, {1}},       {"t[1][0]", 0, {0}},      {"v", 4, {1, 1, 1, 3}},
                {"v[0]", 3, {1, 1, 3}}, {"v[0][0][0]", 1, {3}}, {"v[0][0][0][2]", 0, {0}}};
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        SltParam q = param(p, rows[i].name);
        if (q.rank != rows[i].rank || memcmp(q.shape, rows[i].shape, q.rank * sizeof *q.shape))
            fail_msg("%s has %u dimensions, the first of %u", rows[i].name, q.rank, q.shape[0]);
    }
    slt_program_free(p);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(sizes),         cmocka_unit_test(sizes_of_one),
                                       cmocka_unit_test(readers_agree), cmocka_unit_test(asking_takes_nothing),
                                       cmocka_unit_test(returns),       cmocka_unit_test(comma),
                                       cmocka_unit_test(lengths)};
    return cmocka_run_group_tests(tests, scratch_make, scratch_drop);
}
