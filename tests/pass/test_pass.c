/* One pass on textual IR: PASS.ir or PASS.WHAT.ir has a function, a line `; ---- becomes`, and the function behind the
 * pass. `BLESS=1 ctest -R pass` rewrites what is behind the line; the diff is reviewed like code. Each file also tests
 * that the pass keeps the contract of its row in passes.def, and that its text reads back as what was printed. */
#include <dirent.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "compiler/pass/pass.h"
#include "runtime/image/image.h"
#include "saltus/kernel.h"
#include "tests/blessed.h"

static const char becomes[] = "\n; ---- becomes\n";

/* ---- running the function */

enum { LANES = 8, VALUES = 64 };

typedef struct Results {
    int status;
    unsigned char out[SLT_OUT_MAX][(LANES + SLT_PAD) * sizeof(double)];
    unsigned char adj[VALUES * sizeof(double)];
    uint64_t counters[SLT_COUNTERS];
} Results;

/* The same inputs whatever the function: positions on both sides of 0, small integers. */
static Results interpret(const Fn *fn) {
    static const char *const types[] = {
#define SLT_INPUT(id, text, type, ...) #type,
#include "saltus/kernel.def"
    };
    static double f64[SLT_IN_VARYING][LANES + SLT_PAD], params64[VALUES];
    static float f32[SLT_IN_VARYING][LANES + SLT_PAD], params32[VALUES];
    static int32_t ints[SLT_IN_VARYING][LANES + SLT_PAD], iparams[VALUES];
    bool single = fn->precision == PREC_F32;
    SltKernelArgs args = {.params = single ? (void *)params32 : (void *)params64, .iparams = iparams, .n_valid = LANES};
    Results r = {0};
    for (int v = 0; v < VALUES; v++) {
        iparams[v] = v % 5;
        params32[v] = (float)(params64[v] = 0.25 * v - 1);
    }
    for (int i = 0; i < SLT_IN_VARYING; i++) {
        bool is_int = !strcmp(types[i], "INT");
        for (int lane = 0; lane < LANES; lane++) {
            ints[i][lane] = (lane * 7 + i) % 11;
            f32[i][lane] = (float)(f64[i][lane] = ((lane * 5 + i * 3) % 17) / 8.0 - 1);
        }
        args.in[i] = is_int ? (void *)ints[i] : single ? (void *)f32[i] : (void *)f64[i];
    }
    for (int o = 0; o < SLT_OUT_MAX; o++) args.out[o] = r.out[o];
    args.adj = r.adj;
    r.status = ir_interpret(fn, &args, LANES, LANES);
    memcpy(r.counters, args.counters, sizeof r.counters);
    return r;
}

static bool searches(const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_query) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (searches(i->region[r])) return true;
    }
    return false;
}

/* ---- one file */

typedef struct Case {
    const char *path, *name;
    PassId pass;
    char *input, *want; /* want NULL: the file has no second part yet */
    char *got;
} Case;

static Fn *parse(Session *s, const char *path, const char *text) {
    Fn *fn = ir_parse(s, &s->module, session_add_text(s, path, ".", text, strlen(text)));
    if (!fn) diag_print_text(s, stderr, false);
    assert_non_null(fn);
    return fn;
}

static void check_reads_back(Session *s, const char *path, const char *text) {
    if (!blessed_same(path, text, ir_print_string(parse(s, path, text), &s->module)))
        fail_msg("%s: reads back as another", path);
}

static void run_body(Session *s, void *user) {
    Case *c = user;
    const PassInfo *pass = &pass_info[c->pass];
    PassCtx ctx = {.session = s, .verify = {.pass = PASS_ALL}, .has_fma = true};
    PassStage stage = pass->needs == PASS_NEEDS_ANY ? PASS_NEEDS_PRIMAL : pass->needs;
    Fn *fn = parse(s, c->path, c->input);
    char *before = ir_print_string(fn, &s->module);
    check_reads_back(s, c->path, before);
    Results had = interpret(fn);

    bool changed = pass_run(&ctx, stage, fn, c->pass);
    char *after = ir_print_string(fn, &s->module);
    c->got = strdup(after);
    check_reads_back(s, c->path, after);
    if (changed != (strcmp(before, after) != 0))
        fail_msg("%s: the pass says %d to having changed anything", c->path, changed);

    Results has = interpret(fn);
    int runs = searches(fn->body) ? SLT_USAGE : SLT_OK; /* there is no geometry here */
    if (c->pass == PASS_lower_ddx) had.status = had.status == SLT_INTERNAL ? (int)has.status : SLT_CHECK_FAILED;
    if (had.status != runs) fail_msg("%s: the interpreter gives status %d", c->path, had.status);
    if ((pass->keeps & PASS_KEEPS_FLOATS) && memcmp(&had, &has, sizeof had) != 0) fail_msg("%s: other values", c->path);
    if (pass->keeps & PASS_SETTLES) {
        if (pass_run(&ctx, stage, fn, c->pass)) fail_msg("%s: changed something again", c->path);
        assert_string_equal(ir_print_string(fn, &s->module), after);
    }
}

/* NAME of NAME.ir or NAME.WHAT.ir; PASS_NONE if there is no such pass. */
static PassId pass_of(const char *file) {
    size_t n = strcspn(file, ".");
    for (int p = PASS_NONE + 1; p < PASS_ALL; p++)
        if (pass_info[p].run && strlen(pass_info[p].name) == n && !strncmp(pass_info[p].name, file, n))
            return (PassId)p;
    return PASS_NONE;
}

static bool try_file(Case *c) {
    uint8_t *bytes = NULL;
    size_t size;
    SltError err = {0};
    if (file_read_all(c->path, &file_binary, &bytes, &size, &err) != SLT_OK) fail_msg("%s", err.text);
    c->input = strndup((const char *)bytes, size);
    free(bytes);
    char *end = strstr(c->input, becomes);
    if (end) *end = 0, c->want = end + strlen(becomes);
    Session *s = session_create(0);
    int status = session_protect(s, run_body, c);
    if (status) fail_msg("%s: %s", c->path, s->unwind_text);
    bool good = true;
    if (getenv("BLESS")) {
        char *text = NULL;
        assert_true(asprintf(&text, "%s%s%s", c->input, becomes, c->got) > 0);
        assert_int_equal(file_write_atomic(c->path, text, strlen(text), &err), SLT_OK);
        free(text);
    } else {
        good = blessed_same_ir(c->path, c->want ? c->want : "", c->got);
    }
    session_destroy(s);
    free(c->input);
    free(c->got);
    return good;
}

static void test_files(void **state) {
    (void)state;
    DIR *d = opendir(SALTUS_TEST_DIR "/pass");
    bool tried[PASS_ALL] = {false};
    int wrong = 0;
    assert_non_null(d);
    for (struct dirent *e; (e = readdir(d));) {
        size_t n = strlen(e->d_name);
        char path[1024];
        if (n < 4 || strcmp(e->d_name + n - 3, ".ir") != 0) continue;
        snprintf(path, sizeof path, SALTUS_TEST_DIR "/pass/%s", e->d_name);
        Case c = {.path = path, .pass = pass_of(e->d_name)};
        if (c.pass == PASS_NONE) fail_msg("%s: no such pass", e->d_name);
        tried[c.pass] = true;
        wrong += !try_file(&c);
    }
    closedir(d);
    for (int p = PASS_NONE + 1; p < PASS_ALL; p++)
        if (pass_info[p].run && !tried[p]) print_error("tests/pass has no %s.ir\n", pass_info[p].name), wrong++;
    assert_int_equal(wrong, 0);
}

/* ---- contracts and names */

static const char with_math[] = "fn \"k\" f32 dim 1 channels 1 floats 1 ints 0\n"
                                "{\n  %0 = input:f x0\n  %1 = fsin %0\n  yield %1\n}\n";

typedef struct Faulty {
    PassStage stage;
    PassId pass;
    bool broken;
} Faulty;

static void run_faulty(Session *s, void *user) {
    const Faulty *f = user;
    PassCtx ctx = {.session = s, .verify = {.pass = PASS_ALL}};
    Fn *fn = parse(s, "<test>", with_math);
    if (f->broken) fn->body->last->prev->args[0] = fn->body->last->prev;
    pass_run(&ctx, f->stage, fn, f->pass);
}

static void test_contract(void **state) {
    (void)state;
    const struct {
        Faulty faulty;
        const char *says;
    } cases[] = {
        {{PASS_NEEDS_KERNEL, PASS_opt_contract, false}, "opt_contract of k runs at the wrong time"},
        {{PASS_NEEDS_PRIMAL, PASS_lower_math, false}, "lower_math of k runs at the wrong time"},
        {{PASS_NEEDS_KERNEL, PASS_opt_hits, true}, "after opt_hits of k: broken IR, 1 problem"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        Session *s = session_create(0);
        assert_int_equal(session_protect(s, run_faulty, (void *)&cases[i].faulty), SLT_INTERNAL);
        if (!strstr(s->unwind_text, cases[i].says)) fail_msg("'%s' does not say '%s'", s->unwind_text, cases[i].says);
        session_destroy(s);
    }
}

static void names_body(Session *s, void *user) {
    (void)user;
    PassPoint point;
    assert_null(pass_point(&s->module, "opt_fold", &point));
    assert_int_equal(point.pass, PASS_opt_fold);
    assert_null(point.kernel);
    assert_null(pass_point(&s->module, "site_vjp:all", &point));
    assert_int_equal(point.pass, PASS_ALL);
    assert_string_equal(point.kernel, "site_vjp");
    assert_null(pass_point(&s->module, "primal:front", &point));
    assert_string_equal(pass_point(&s->module, "opt_flod", &point),
                        "unknown pass `opt_flod`; did you mean `opt_fold`?");
    assert_string_equal(pass_point(&s->module, "vjb:all", &point), "unknown kernel `vjb`; did you mean `vjp`?");
    assert_non_null(pass_point(&s->module, "", &point));
    assert_non_null(pass_point(&s->module, "vjp", &point));
}

static void test_names(void **state) {
    (void)state;
    Session *s = session_create(0);
    assert_int_equal(session_protect(s, names_body, NULL), 0);
    session_destroy(s);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_files), cmocka_unit_test(test_contract),
                                       cmocka_unit_test(test_names)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
