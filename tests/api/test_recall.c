/* Kernels recalled from the cache, without their IR: what the library knows of them, and what it computes, is what it
 * is where passes ran; IR that is asked for after all is made. */
#include <dirent.h>
#include <math.h>
#include <unistd.h>

#include "bindings/c/api.h"
#include "compiler/pass/walk.h"
#include "tests/api/program.h"
#include "tests/scratch.h"

static const char disc[] = "[Range(0.1, 0.9)] param float r = 0.5;\n"
                           "param float ink = 0.25;\n"
                           "[Domain(-1.0, 1.0)] shader float main(float2 x) {\n"
                           "    float f = ink * x.x;\n"
                           "    [Disc] if (length(x) < r) f = 1.0;\n"
                           "    return f;\n"
                           "}\n";
/* Lines take over where the discs touch; a seam bends. */
static const char touching[] = "param float r = 0.5;\n"
                               "param float[3] w = {0.25, 0.5, 0.125};\n"
                               "[Domain(-1.0, 1.0)] shader float main(float2 x) {\n"
                               "    float f = w[int(abs(x.x) * 2.0)];\n"
                               "    [Disc] if (length(x - float2(0.5, 0.0)) < r) f = 1.0;\n"
                               "    [Disc] if (length(x + float2(0.5, 0.0)) < r) f = max(x.y, 0.1);\n"
                               "    return f;\n"
                               "}\n";
static const char culled[] = "struct D { float2 centre; float radius; };\n"
                             "D at(int i) { D d = { float2(rand(), rand()), 0.1 * rand() }; return d; }\n"
                             "param D discs[40] = init(at);\n"
                             "float4 around(int i) { float2 c = discs[i].centre; float r = discs[i].radius;\n"
                             "    return float4(c.x - r, c.y - r, c.x + r, c.y + r); }\n"
                             "shader float main(float2 x) {\n"
                             "    float f = 0.0;\n"
                             "    [Cull(around)] for (int i = 0; i < 40; i++)\n"
                             "        [Disc] if (length(x - discs[i].centre) < discs[i].radius) f += 0.25;\n"
                             "    return f;\n"
                             "}\n";
static const char marched[] = "param float r = 0.5;\n"
                              "shader float main(float2 x) {\n"
                              "    float t = 0.0;\n"
                              "    for (int i = 0; i < 24; i++) t += length(float2(x.x, t - 2.0)) - r;\n"
                              "    float f = 0.1 * sin(t);\n"
                              "    [Disc] if (t < 2.0 + 0.1 * x.y) f += exp(-t);\n"
                              "    return f;\n"
                              "}\n";
static const char *const sources[] = {disc, touching, culled, marched};
enum { SOURCES = sizeof sources / sizeof *sources, SIZE = 12, MOST = 128 };

static SltProgram *begin(const char *source, bool f64) {
    SltOptions opt = SLT_OPTIONS_INIT;
    SltProgram *p;
    opt.stdlib_dir = SALTUS_STDLIB_BUILD, opt.f64 = f64;
    if (slt_compile_string(source, "t.salt", &opt, &p) != SLT_OK)
        fail_msg("%s%s", slt_diagnostics_text(p), slt_last_error(p));
    assert_true(slt_float_count(p) <= MOST);
    return p;
}

/* What calls of several kinds give. */
typedef struct Answers {
    float image[SIZE * SIZE], derivative[SIZE * SIZE];
    double loss, adjoint[MOST], of_lattice[MOST], of_cells[MOST], of_auto[MOST];
} Answers;

static void integrate(SltProgram *p, SltEstimator estimator, double gradient[MOST]) {
    SltJob job = SLT_JOB_INIT;
    SltError err;
    SltIntegral out = SLT_INTEGRAL_INIT;
    double errors[MOST];
    out.gradient = gradient, out.gradient_stderr = errors;
    job.integral = true, job.samples = 1 << 10, job.estimator = estimator;
    assert_ok(slt_grad_integral(p, &job, &out, NULL, &err));
}

static void ask(SltProgram *p, Answers *a) {
    static const float target[SIZE * SIZE];
    static const double ones[MOST] = {1, 1, 1};
    const double *direction = ones;
    float *derivative = a->derivative;
    SltJob job = SLT_JOB_INIT;
    SltError err;
    memset(a, 0, sizeof *a);
    job.size[0] = job.size[1] = SIZE, job.estimator = SLT_EST_LATTICE;
    integrate(p, SLT_EST_AUTO, a->of_auto);
    integrate(p, SLT_EST_QUADRATURE, a->of_cells);
    integrate(p, SLT_EST_LATTICE, a->of_lattice);
    assert_ok(slt_render(p, &job, a->image, NULL, &err));
    assert_ok(slt_grad_images(p, &job, 1, &direction, &derivative, NULL, NULL, &err));
    assert_ok(slt_grad_loss(p, &job, target, NULL, &a->loss, a->adjoint, NULL, NULL, NULL, &err));
}

static void same_tables(const SltProgram *a, const SltProgram *b) {
    const SltScene *x = &a->scene, *y = &b->scene;
    assert_memory_equal(a->has, b->has, sizeof a->has);
    assert_memory_equal(a->tried, b->tried, sizeof a->tried);
    assert_memory_equal(a->compiled_few, b->compiled_few, sizeof a->compiled_few);
    assert_memory_equal(a->compiled_level, b->compiled_level, sizeof a->compiled_level);
    assert_memory_equal(x->layout, y->layout, sizeof x->layout);
    assert_int_equal(x->tape_bytes, y->tape_bytes);
    assert_int_equal(x->widest, y->widest);
    const bool of_x[] = {x->tape_grows, x->hides, x->site_logs, x->rigid, x->flat, x->told, x->chunked},
               of_y[] = {y->tape_grows, y->hides, y->site_logs, y->rigid, y->flat, y->told, y->chunked};
    assert_memory_equal(of_x, of_y, sizeof of_x);
    assert_memory_equal(a->dense, b->dense, a->prog->nfloats);
    assert_memory_equal(a->list_noted, b->list_noted, SLT_MAX_CULL);
    assert_int_equal(a->nedges, b->nedges);
    assert_memory_equal(a->edge_kind, b->edge_kind, a->nedges);
    assert_memory_equal(a->edge_bends, b->edge_bends, a->nedges);
    assert_true(!a->edge_upsets == !b->edge_upsets && !a->edge_argmin == !b->edge_argmin);
    if (a->edge_upsets) assert_memory_equal(a->edge_upsets, b->edge_upsets, a->nedges);
    if (a->edge_argmin) assert_memory_equal(a->edge_argmin, b->edge_argmin, a->nedges);
    for (uint32_t e = 0; a->edge_upsets && e < a->nedges; e++)
        if (a->edge_upsets[e]) assert_int_equal(a->edge_line[e], b->edge_line[e]);
}

static uint32_t with_ir(const SltProgram *p) {
    uint32_t n = 0;
    for (int k = 0; k < K_KINDS; k++) n += p->fn[k] != NULL;
    return n;
}

static void as_if_passes_had_run(void **state) {
    (void)state;
    for (int i = 0; i < 2 * SOURCES; i++) {
        static Answers first, again;
        SltProgram *p = begin(sources[i / 2], i & 1), *q = begin(sources[i / 2], i & 1);
        ask(p, &first), ask(q, &again);
        assert_true(with_ir(p) >= 6);
        /* Only of those that waited and were called all the same. */
        for (int k = 0; k < K_KINDS; k++)
            assert_true(!q->fn[k] || k == K_VALUE || k == K_EVENT || k == K_SITE || k == K_SITE_GRAD);
        assert_true(q->cached);
        assert_memory_equal(&first, &again, sizeof first);
        same_tables(p, q);
        slt_program_free(p), slt_program_free(q);
    }
}

/* An image needs no chunks of a program that has none. */
static void an_image_alone(void **state) {
    (void)state;
    float image[2][SIZE * SIZE];
    SltJob job = SLT_JOB_INIT;
    SltError err;
    job.size[0] = job.size[1] = SIZE;
    for (int turn = 0; turn < 2; turn++) {
        SltProgram *p = begin("shader float main(float2 x) { return x.x * sin(x.y); }\n", false);
        assert_ok(slt_render(p, &job, image[turn], NULL, &err));
        assert_int_equal(p->fn[K_VALUE] == NULL, turn);
        slt_program_free(p);
    }
    assert_memory_equal(image[0], image[1], sizeof image[0]);
}

/* IR is made for who asks for it, and derivatives of other parameters have other kernels. */
static void asked_for_after_all(void **state) {
    (void)state;
    static const char *const wrt[] = {"ink"};
    static Answers all, one;
    SltError err;
    SltProgram *p = compile(disc), *q = begin(disc, false);
    ask(p, &all), ask(q, &all); /* by now the cache has what q asks for */
    const Fn *vjp = api_fn(q, K_VJP);
    assert_non_null(vjp);
    assert_int_equal(walk_fn_size(vjp), walk_fn_size(p->fn[K_VJP]));
    assert_null(api_fn(q, K_WRITTEN_BOUNDS));
    static const bool needs[K_KINDS] = {[K_VALUE] = true, [K_REGION] = true, [K_SITE_VJP] = true};
    assert_ok(api_kernels(q, needs, &err));
    for (int k = 0; k < K_KINDS; k++)
        if (needs[k]) assert_int_equal(walk_fn_size(q->fn[k]), walk_fn_size(p->fn[k]));
    assert_ok(slt_wrt(q, wrt, 1, &err));
    assert_ok(slt_wrt(p, wrt, 1, &err));
    ask(q, &one), ask(p, &all);
    assert_memory_equal(&one, &all, sizeof one);
    assert_true(all.of_lattice[0] == 0);
    slt_program_free(p), slt_program_free(q);
}

/* Of each file with this ending: it is cut, or gone. */
static int damage(const char *ending, bool gone) {
    char folder[512], path[1024];
    int n = 0;
    snprintf(folder, sizeof folder, "%s/saltus", scratch);
    DIR *d = opendir(folder);
    assert_non_null(d);
    for (struct dirent *f; (f = readdir(d));) {
        const size_t len = strlen(f->d_name), end = strlen(ending);
        if (len < end || strcmp(f->d_name + len - end, ending) != 0) continue;
        snprintf(path, sizeof path, "%s/%s", folder, f->d_name);
        assert_int_equal(gone ? unlink(path) : truncate(path, 100), 0);
        n++;
    }
    closedir(d);
    return n;
}

/* What is not whole is as if it were not there, and is made again. */
static void damaged(void **state) {
    (void)state;
    static Answers first, again;
    SltProgram *p = begin(marched, false);
    ask(p, &first);
    slt_program_free(p);
    for (int turn = 0; turn < 3; turn++) {
        assert_true(damage(turn == 1 ? ".o" : ".facts", turn > 0) > 0);
        p = begin(marched, false);
        ask(p, &again);
        assert_memory_equal(&first, &again, sizeof first);
        assert_true(with_ir(p) >= 6);
        assert_true(p->cached == (turn != 1));
        slt_program_free(p);
    }
    p = begin(marched, false);
    ask(p, &again);
    assert_null(p->fn[K_VJP]);
    slt_program_free(p);
}

/* A constant that is set, and where a line is, are no less of the key than the text. */
static void other_programs(void **state) {
    (void)state;
    static const char source[] = "const float SIDE = 0.5;\nparam float r = 0.5;\n"
                                 "shader float main(float2 x) { [Disc] if (x.x < SIDE * r) return 1.0; return 0.0; }\n";
    static const SltSet other = {"SIDE", "0.25"};
    double at[3][MOST];
    for (int i = 0; i < 3; i++) {
        SltOptions opt = SLT_OPTIONS_INIT;
        SltProgram *p;
        opt.stdlib_dir = SALTUS_STDLIB_BUILD;
        opt.set = &other, opt.nset = i == 1;
        assert_int_equal(slt_compile_string(source, "t.salt", &opt, &p), SLT_OK);
        integrate(p, SLT_EST_LATTICE, at[i]);
        assert_true((with_ir(p) > 0) == (i < 2));
        slt_program_free(p);
    }
    assert_true(fabs(at[0][0] - 0.5) < 1e-4 && fabs(at[1][0] - 0.25) < 1e-4 && at[2][0] == at[0][0]);
}

/* Kernels for few samples are found by those alone who ask for them, and give the same to the bit. */
static void few_samples(void **state) {
    (void)state;
    static const char source[] = "param float r = 0.53125;\n" /* no other test's */
                                 "shader float main(float2 x) { [Disc] if (length(x) < r) return 1.0; return 0.0; }\n";
    double gradient[4][MOST];
    for (int i = 0; i < 4; i++) {
        SltProgram *p = begin(source, false);
        p->few_samples = i % 2;
        integrate(p, SLT_EST_LATTICE, gradient[i]);
        assert_true((with_ir(p) > 0) == (i < 2));
        assert_int_equal(p->compiled_few[K_REGION], i % 2);
        assert_true(gradient[i][0] == gradient[0][0]);
        slt_program_free(p);
    }
}

static int setup(void **state) { return scratch_make(state) || setenv("XDG_CACHE_HOME", scratch, 1); }

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(as_if_passes_had_run), cmocka_unit_test(an_image_alone),
                                       cmocka_unit_test(asked_for_after_all),  cmocka_unit_test(damaged),
                                       cmocka_unit_test(other_programs),       cmocka_unit_test(few_samples)};
    return cmocka_run_group_tests(tests, setup, scratch_drop);
}
