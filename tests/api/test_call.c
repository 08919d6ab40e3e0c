/* What calls take and give: parameters of their own, structs of other versions, shapes, and what becomes of the
 * caller's memory. */
#include <math.h>
#include <unistd.h>

#include "tests/api/program.h"
#include "tests/scratch.h"

enum { SIDE = 24 };

static const char disc[] = "const int N = 1;\n"
                           "param float r = 0.5;\n"
                           "param int k = 3;\n"
                           "[Domain(-1.0, 1.0)] shader float main(float2 x) {\n"
                           "    float f = 0.0;\n"
                           "    [Disc] if (length(x) < r) f = float(k * N);\n"
                           "    return f;\n"
                           "}\n";
static const char terrain[] = "[Height(0.2, 0.0)] param heightfield h = zeros(17, 17);\n"
                              "param float sun = 0.4;\n"
                              "shader float main(float2 x) {\n"
                              "    float3 o = float3(x, h.height(x) + 0.001);\n"
                              "    float f = 1.0;\n"
                              "    [Disc] if (h.clearance(o, float3(0.9, 0.3, sun), 0.02, 1e9) < 0.0) f = 0.2;\n"
                              "    return f + sun;\n"
                              "}\n";

static SltJob small_job(void) {
    SltJob job = SLT_JOB_INIT;
    job.size[0] = job.size[1] = SIDE, job.threads = 2;
    return job;
}

static void hills(const SltProgram *p, double *floats, uint32_t seed) {
    memcpy(floats, slt_floats(p), slt_float_count(p) * sizeof *floats);
    SltParam h = param(p, "h");
    for (uint32_t i = 0; i < h.fcount; i++) floats[h.fbase + i] = fmod(0.618034 * (double)(i * (seed + 3) % 291), 1);
    floats[param(p, "sun").fbase] = 0.3 + 0.05 * seed;
}

/* What a call is given counts for it as what is set does, bit for bit, and for no other. */
static void own_parameters(void **state) {
    (void)state;
    SltError err;
    for (int form = 0; form < 4; form++) {
        SltOptions opt = SLT_OPTIONS_INIT;
        opt.f64 = form & 1, opt.field = form & 2 ? SLT_STRUCTURE_CONE : SLT_STRUCTURE_AUTO;
        SltProgram *p = compile_with(terrain, opt), *fresh = compile_with(terrain, opt);
        uint32_t n = slt_float_count(p);
        double *floats = malloc(n * sizeof *floats), *before = malloc(n * sizeof *before), *g[2];
        float image[2][SIDE * SIDE], flat[2][SIDE * SIDE];
        for (int i = 0; i < 2; i++) g[i] = malloc(n * sizeof *g[i]);
        SltJob job = small_job();
        assert_ok(slt_render(p, &job, flat[0], NULL, &err));
        memcpy(before, slt_floats(p), n * sizeof *before);
        for (uint32_t seed = 0; seed < 3; seed++) {
            SltJob own = small_job();
            hills(p, floats, seed);
            own.floats = floats;
            assert_ok(slt_render(p, &own, image[0], NULL, &err));
            assert_ok(slt_grad_adjoint(p, &own, image[0], g[0], NULL, NULL, &err));
            assert_memory_equal(slt_floats(p), before, n * sizeof *before);
            assert_ok(slt_set_floats(fresh, 0, n, floats, &err));
            assert_ok(slt_render(fresh, &job, image[1], NULL, &err));
            assert_ok(slt_grad_adjoint(fresh, &job, image[1], g[1], NULL, NULL, &err));
            assert_memory_equal(image[0], image[1], sizeof *image);
            assert_memory_equal(g[0], g[1], n * sizeof **g);
            assert_memory_not_equal(image[0], flat[0], sizeof *image);
            if (seed == 1) continue; /* two calls with their own parameters in a row */
            assert_ok(slt_render(p, &job, flat[1], NULL, &err));
            assert_memory_equal(flat[0], flat[1], sizeof *flat);
        }
        /* What is set between such calls is not lost. */
        SltJob own = small_job();
        own.floats = floats;
        uint32_t sun = param(p, "sun").fbase;
        double noon = 2;
        assert_ok(slt_render(p, &own, image[0], NULL, &err));
        assert_ok(slt_set_floats(p, sun, 1, &noon, &err));
        assert_ok(slt_render(p, &own, image[1], NULL, &err));
        assert_memory_equal(image[0], image[1], sizeof *image);
        assert_ok(slt_render(p, &job, image[0], NULL, &err));
        before[sun] = noon;
        assert_ok(slt_set_floats(fresh, 0, n, before, &err));
        assert_ok(slt_render(fresh, &job, image[1], NULL, &err));
        assert_memory_equal(image[0], image[1], sizeof *image);
        free(floats), free(before), free(g[0]), free(g[1]);
        slt_program_free(p), slt_program_free(fresh);
    }
}

static void own_integers(void **state) {
    (void)state;
    SltError err;
    SltProgram *p = compile(disc);
    double x[2] = {0.1, 0.1}, out, radius = 0.7, a[3] = {0}, b[3] = {1, 0, 0};
    int32_t k = 8;
    SltJob job = SLT_JOB_INIT;
    job.ints = &k, job.floats = &radius;
    SltCrossing c = SLT_CROSSING_INIT;
    assert_ok(slt_eval(p, &job, 1, x, NULL, &out, NULL, &err));
    assert_true(out == 8);
    assert_ok(slt_crossing(p, &job, a, b, 0, &c, &err));
    assert_true(c.found && fabs(c.x[0] - 0.7) < 1e-4 && c.f_before[0] == 8 && c.f_after[0] == 0);
    assert_ok(slt_crossing(p, NULL, a, b, 0, &c, &err));
    assert_true(c.found && fabs(c.x[0] - 0.5) < 1e-4 && c.f_before[0] == 3);
    assert_ok(slt_crossing(p, NULL, a, a, 0, &c, &err));
    assert_true(!c.found && c.site == -1);
    assert_int_equal(c.struct_size, sizeof c);
    assert_ok(slt_eval(p, NULL, 1, x, NULL, &out, NULL, &err));
    assert_true(out == 3);
    SltOptions opt = SLT_OPTIONS_INIT;
    opt.rgba8 = true;
    SltProgram *bytes =
        compile_with("param int k = 1;\nshader float3 main(float2 x) { return float3(float(k)); }", opt);
    uint32_t pixels[SIDE * SIDE];
    SltJob image = small_job();
    k = 0, image.ints = &k;
    assert_ok(slt_render_rgba8(bytes, &image, pixels, NULL, &err));
    assert_int_equal(pixels[7] & 0xffffff, 0);
    image.ints = NULL;
    assert_ok(slt_render_rgba8(bytes, &image, pixels, NULL, &err));
    assert_int_equal(pixels[7] & 0xffffff, 0xffffff);
    slt_program_free(p), slt_program_free(bytes);
}

/* 8-bit pixels of every shape, also where lanes branch: each is shaded in its place, whole squares and what is left of
 * them, in an image that lies anywhere, and nothing beside it. */
static void shapes_of_pixels(void **state) {
    (void)state;
    static const uint32_t shape[][2] = {{1, 1}, {7, 9}, {8, 8}, {16, 3}, {1, 40}, {1025, 8}, {1032, 9}, {129, 17}};
    static const char *const source[] = {
        "[Display] shader float3 main(float2 x) { int2 q = pixel();\n"
        "return float3(float(q.x % 256), float(q.y % 256), floor(255.0 * x.x)) / 255.0; }",
        "[Display] shader float3 main(float2 x) { int2 q = pixel(); int n = q.x % 5, k = 0;\n"
        "for (int i = 0; i < n; i++) k += 1 + q.x;\n"
        "return float3(float(k - n * q.x + q.x - n) / 255.0, float(q.y % 256) / 255.0, floor(255.0 * x.x) / 255.0); }"};
    enum { BEHIND = 64, UNTOUCHED = 7 };
    for (int k = 0; k < 32; k++) {
        SltOptions opt = SLT_OPTIONS_INIT;
        opt.rgba8 = true, opt.f64 = k & 1;
        SltProgram *p = compile_with(source[k >> 1 & 1], opt);
        const uint32_t *n = shape[k / 4];
        const size_t size = (size_t)n[0] * n[1];
        SltJob job = SLT_JOB_INIT;
        SltError err;
        job.size[0] = n[0], job.size[1] = n[1];
        uint32_t *memory = calloc(size + 1 + BEHIND, sizeof *memory), *pixels = memory + 1;
        for (uint32_t i = 0; i < BEHIND; i++) pixels[size + i] = UNTOUCHED;
        assert_ok(slt_render_rgba8(p, &job, pixels, NULL, &err));
        for (uint32_t y = 0; y < n[1]; y++)
            for (uint32_t x = 0; x < n[0]; x++) {
                uint32_t c = pixels[(size_t)y * n[0] + x];
                double blue = floor(255 * (x + 0.5) / n[0]);
                uint32_t red = k & 2 ? x < 255 ? x : 255 : x & 255;
                assert_int_equal(c & 0xffff, red | (y & 255) << 8);
                assert_true(fabs((c >> 16 & 255) - blue) <= 1);
            }
        for (uint32_t i = 0; i < BEHIND; i++) assert_int_equal(pixels[size + i], UNTOUCHED);
        assert_int_equal(memory[0], 0);
        free(memory);
        slt_program_free(p);
    }
}

/* Sizes along axes that the program lacks, and of an image where an integral is wanted, do not count: nothing is read
 * or written there. */
static void axes_that_do_not_count(void **state) {
    (void)state;
    enum { N = 9, BEHIND = 2048 };
    SltError err;
    SltOptions opt = SLT_OPTIONS_INIT;
    SltProgram *curve = compile("param float a = 2.0; shader float main(float x) { return a * x; }"),
               *plane = compile(disc);
    opt.rgba8 = true;
    SltProgram *bytes = compile_with("[Display] shader float3 main(float x) { return float3(x); }", opt);
    SltJob job = SLT_JOB_INIT;
    float image[N + BEHIND], *out[1] = {image};
    uint32_t pixels[N + BEHIND];
    const double direction[1] = {1}, *directions[1] = {direction};
    for (int i = 0; i < N + BEHIND; i++) image[i] = NAN, pixels[i] = 7;
    SltStats stats = SLT_STATS_INIT;
    job.size[0] = N, job.size[2] = 3;
    assert_ok(slt_render(curve, &job, image, &stats, &err));
    assert_ok(slt_grad_images(curve, &job, 1, directions, out, NULL, &stats, &err));
    assert_ok(slt_render_rgba8(bytes, &job, pixels, &stats, &err));
    for (int i = N; i < N + BEHIND; i++) assert_true(isnan(image[i]) && pixels[i] == 7);
    job.integral = true, job.samples = 256;
    assert_ok(slt_render(plane, &job, image, &stats, &err));
    assert_true(isfinite(image[0]));
    assert_int_equal(stats.nonfinite, 0);
    slt_program_free(curve);
    slt_program_free(plane);
    slt_program_free(bytes);
}

/* ---- sizes: as programs of an older and of a newer header would call */
typedef struct NewerJob {
    SltJob known;
    uint64_t later;
} NewerJob;
typedef struct NewerStats {
    SltStats known;
    uint64_t later;
} NewerStats;

static void other_versions(void **state) {
    (void)state;
    SltError err;
    SltProgram *p = compile(disc);
    double x[2] = {0.1, 0.1}, at[3] = {0}, out = 0, radius = 0.01;
    NewerJob job = {.known = SLT_JOB_INIT};
    NewerStats stats = {.known = SLT_STATS_INIT, .later = 77};

    job.known.struct_size = sizeof job;
    assert_ok(slt_eval(p, &job.known, 1, x, NULL, &out, NULL, &err));
    job.later = 1; /* something this version cannot do */
    assert_int_equal(slt_eval(p, &job.known, 1, x, NULL, &out, NULL, &err), SLT_USAGE);
    assert_non_null(strstr(err.text, "SltJob"));
    job.known.struct_size = 0;
    assert_int_equal(slt_eval(p, &job.known, 1, x, NULL, &out, NULL, &err), SLT_USAGE);
    job.known.struct_size = (size_t)-1;
    assert_int_equal(slt_eval(p, &job.known, 1, x, NULL, &out, NULL, &err), SLT_USAGE);
    job.known.struct_size = offsetof(SltJob, floats), job.known.floats = &radius; /* not read */
    assert_ok(slt_eval(p, &job.known, 1, x, NULL, &out, NULL, &err));
    assert_true(out == 3);

    stats.later = 0, stats.known.struct_size = sizeof stats;
    assert_ok(slt_eval(p, NULL, 1, x, NULL, &out, &stats.known, &err));
    assert_ok(slt_eval(p, NULL, 1, x, NULL, &out, &stats.known, &err));
    assert_int_equal(stats.known.samples, 2);
    assert_int_equal(stats.known.struct_size, sizeof stats);
    stats.known.struct_size = offsetof(SltStats, crossings), stats.known.crossings = 5, stats.known.seconds = -1;
    assert_ok(slt_eval(p, NULL, 1, x, NULL, &out, &stats.known, &err));
    assert_int_equal(stats.known.samples, 3);
    assert_true(stats.known.crossings == 5 && stats.known.seconds == -1);
    stats.known.struct_size = 0;
    assert_int_equal(slt_eval(p, NULL, 1, x, NULL, &out, &stats.known, &err), SLT_USAGE);

    SltParam q = SLT_PARAM_INIT;
    q.struct_size = offsetof(SltParam, doc), q.doc = "mine", q.rank = 9;
    assert_true(slt_param(p, 0, &q));
    assert_string_equal(q.name, "r");
    assert_true(!strcmp(q.doc, "mine") && q.rank == 9);
    q.struct_size = 0;
    assert_false(slt_param(p, 0, &q));
    assert_int_equal(slt_param_find(p, "r", &q, &err), SLT_USAGE);
    SltDiagnostic d = {0};
    assert_false(slt_diagnostic(p, 0, &d));

    double value = 0, gradient = 7;
    SltJob whole = SLT_JOB_INIT;
    whole.integral = true, whole.samples = 1 << 12;
    SltIntegral result = {.struct_size = offsetof(SltIntegral, gradient), .value = &value, .gradient = &gradient};
    assert_ok(slt_grad_integral(p, &whole, &result, NULL, &err));
    assert_true(value > 2 && value < 3 && gradient == 7 && !result.replicates);
    result.struct_size = 0;
    assert_int_equal(slt_grad_integral(p, &whole, &result, NULL, &err), SLT_USAGE);
    SltCrossing c = {0};
    assert_int_equal(slt_crossing(p, NULL, at, at, 0, &c, &err), SLT_USAGE);
    slt_program_free(p);

    SltOptions opt = SLT_OPTIONS_INIT;
    opt.struct_size = 0;
    assert_int_equal(slt_compile_string(disc, "t", &opt, &p), SLT_USAGE);
    assert_non_null(strstr(slt_last_error(p), "SltOptions"));
    slt_program_free(p);
}

/* Where memory ran out there is no program, and callers print what they always print. */
static void without_memory(void **state) {
    (void)state;
    SltDiagnostic d = SLT_DIAGNOSTIC_INIT;
    assert_int_equal(slt_diagnostic_count(NULL), 0);
    assert_false(slt_diagnostic(NULL, 0, &d));
    assert_string_equal(slt_last_error(NULL), "out of memory");
    assert_string_equal(slt_diagnostics_text(NULL), "error: out of memory\n");
    assert_non_null(strstr(slt_diagnostics_json(NULL), "\"out of memory\"}\n"));
    slt_program_free(NULL);
}

/* ---- shapes */
static void assert_shape(const SltParam *q, SltKind kind, uint32_t rank, const uint32_t *shape, uint32_t fstride,
                         uint32_t istride) {
    uint32_t elements = 1;
    assert_int_equal(q->kind, kind);
    assert_int_equal(q->rank, rank);
    for (uint32_t d = 0; d < rank; d++) assert_int_equal(q->shape[d], shape[d]), elements *= shape[d];
    assert_int_equal(q->fstride, fstride);
    assert_int_equal(q->istride, istride);
    assert_int_equal(q->fcount, elements * fstride);
    assert_int_equal(q->icount, elements * istride);
}

static void shapes(void **state) {
    (void)state;
    static const char source[] = "struct Ring { float2 centre; int n; float r[3]; };\n"
                                 "struct Pair { bool on; Ring rings[2]; uint id; float2x2 m; };\n"
                                 "param float a = 1.0;\n"
                                 "param float3 b = float3(1.0, 2.0, 3.0);\n"
                                 "param float3x3 m = float3x3(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);\n"
                                 "param int c[2] = { 1, 2 };\n"
                                 "param bool on = true;\n"
                                 "param uint3 u = uint3(1u, 2u, 3u);\n"
                                 "param Pair p[4] = { %s, %s, %s, %s };\n"
                                 "param heightfield h = zeros(5, 7);\n"
                                 "shader float main(float2 x) { return a + h.height(x); }\n";
    static const char pair[] = "{ true, { { float2(1.0, 2.0), 1, { 1.0, 2.0, 3.0 } }, { float2(1.0, 2.0), 1, { 1.0, "
                               "2.0, 3.0 } } }, 1u, float2x2(1.0, 0.0, 0.0, 1.0) }";
    char text[4096];
    snprintf(text, sizeof text, source, pair, pair, pair, pair);
    SltProgram *p = compile(text);
    SltParam q = param(p, "a"), f = SLT_PARAM_INIT, g = SLT_PARAM_INIT;
    assert_shape(&q, SLT_KIND_FLOAT, 0, NULL, 1, 0);
    q = param(p, "b"), assert_shape(&q, SLT_KIND_FLOAT, 1, (uint32_t[]){3}, 1, 0);
    q = param(p, "b[1]"), assert_shape(&q, SLT_KIND_FLOAT, 0, NULL, 1, 0);
    q = param(p, "m"), assert_shape(&q, SLT_KIND_FLOAT, 2, (uint32_t[]){3, 3}, 1, 0);
    q = param(p, "m[2]"), assert_shape(&q, SLT_KIND_FLOAT, 1, (uint32_t[]){3}, 1, 0);
    q = param(p, "c"), assert_shape(&q, SLT_KIND_INT, 1, (uint32_t[]){2}, 0, 1);
    q = param(p, "on"), assert_shape(&q, SLT_KIND_BOOL, 0, NULL, 0, 1);
    q = param(p, "u"), assert_shape(&q, SLT_KIND_UINT, 1, (uint32_t[]){3}, 0, 1);
    q = param(p, "h"), assert_shape(&q, SLT_KIND_FLOAT, 2, (uint32_t[]){q.tex_h, q.tex_w}, 1, 0);
    assert_int_equal(q.tex_w * q.tex_h, 35);
    q = param(p, "h[1]"), assert_shape(&q, SLT_KIND_FLOAT, 1, (uint32_t[]){q.tex_w}, 1, 0);
    q = param(p, "h[1][2]"), assert_shape(&q, SLT_KIND_FLOAT, 0, NULL, 1, 0);
    q = param(p, "p"), assert_shape(&q, SLT_KIND_STRUCT, 1, (uint32_t[]){4}, 14, 4);
    assert_int_equal(q.nfields, 4);
    assert_false(slt_param_field(&q, 4, &f));
    /* Every leaf, walked to and by name. */
    static const char *const names[] = {"on", "rings", "id", "m"};
    for (uint32_t i = 0; i < 4; i++) {
        char name[64];
        assert_true(slt_param_field(&q, i, &f));
        assert_string_equal(f.name, names[i]);
        for (uint32_t k = 0; k < 4; k++) {
            snprintf(name, sizeof name, "p[%u].%s", k, names[i]);
            SltParam named = param(p, name);
            assert_int_equal(named.fbase, f.fbase + k * q.fstride);
            assert_int_equal(named.ibase, f.ibase + k * q.istride);
            assert_shape(&named, f.kind, f.rank, f.shape, f.fstride, f.istride);
            assert_string_equal(named.type, f.type);
        }
    }
    assert_true(slt_param_field(&q, 1, &f));
    assert_shape(&f, SLT_KIND_STRUCT, 1, (uint32_t[]){2}, 5, 1);
    assert_true(slt_param_field(&f, 2, &g));
    assert_shape(&g, SLT_KIND_FLOAT, 1, (uint32_t[]){3}, 1, 0);
    assert_int_equal(g.fbase, param(p, "p[0].rings[0].r").fbase);
    assert_true(g.differentiable);
    assert_true(slt_param_field(&f, 1, &g));
    assert_false(g.differentiable);
    assert_false(slt_param_field(&g, 0, &f));
    slt_program_free(p);
}

/* ---- whose memory: everything that was given is overwritten before the kernels are compiled */
static char *scribbled[32];
static int nscribbled;
static char *mine(const char *text) { return scribbled[nscribbled++] = strdup(text); }

static void nothing_is_kept(void **state) {
    (void)state;
    SltError err;
    scratch_put("shapes.salt", "float inside(float2 x, float r) { return length(x) - r; }\n");
    char source[1024];
    snprintf(source, sizeof source,
             "import shapes;\nimport sdf;\nconst int N = 1;\nparam float r = 0.5;\n"
             "[Extent(0, 0, 1, 1)] param heightfield h = zeros(5, 5);\n"
             "[Domain(-1.0, 1.0)] shader float one(float2 x) { return 0.0; }\n"
             "[Domain(-1.0, 1.0)] shader float two(float2 x) {\n"
             "    float f = 0.0; [Disc] if (inside(x, r) < 0.0) f = float(N);\n"
             "    return f + h.height(x);\n}\n");
    SltSet *set = malloc(sizeof *set);
    *set = (SltSet){mine("N"), mine("2")};
    const char **dirs = malloc(sizeof *dirs);
    dirs[0] = mine(scratch);
    SltOptions *opt = malloc(sizeof *opt);
    *opt = SLT_OPTIONS_INIT;
    opt->entry = mine("two"), opt->set = set, opt->nset = 1, opt->import_dirs = dirs, opt->nimport_dirs = 1;
    opt->stdlib_dir = mine(SALTUS_STDLIB_BUILD), opt->target = mine("sse2"), opt->dump = mine("jvp:opt_dce");
    opt->stop_after = mine("jvp:opt_cse"), opt->verify_after = mine("vjp:opt_dce"); /* jvp: not needed below */
    opt->no_cache = true;
    char *text = mine(source), *shown = mine("shown.salt"), *wrt = mine("r");
    SltProgram *p;
    if (slt_compile_string(text, shown, opt, &p) != SLT_OK)
        fail_msg("%s%s", slt_diagnostics_text(p), slt_last_error(p));
    assert_ok(slt_wrt(p, (const char *const[]){wrt}, 1, &err));
    unlink(scratch_path("shapes.salt"));
    for (int i = 0; i < nscribbled; i++) memset(scribbled[i], 0xaa, strlen(scribbled[i])), free(scribbled[i]);
    memset(set, 0xaa, sizeof *set), memset(dirs, 0xaa, sizeof *dirs), memset(opt, 0xaa, sizeof *opt);
    free(set), free(dirs), free(opt);

    SltJob job = small_job();
    float image[SIDE * SIDE], adjoint[SIDE * SIDE];
    assert_ok(slt_render(p, &job, image, NULL, &err));
    for (int i = 0; i < SIDE * SIDE; i++) adjoint[i] = 4.0f / (SIDE * SIDE);
    double *gradient = malloc(slt_float_count(p) * sizeof *gradient);
    job.spp = 16;
    assert_ok(slt_grad_adjoint(p, &job, adjoint, gradient, NULL, NULL, &err));
    double got = gradient[param(p, "r").fbase];
    assert_true(fabs(got - 2 * M_PI) < 0.2); /* N times the circumference */
    assert_string_equal(slt_entry(p), "two");
    free(gradient);
    slt_program_free(p);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(own_parameters),   cmocka_unit_test(own_integers),
                                       cmocka_unit_test(other_versions),   cmocka_unit_test(without_memory),
                                       cmocka_unit_test(shapes),           cmocka_unit_test(nothing_is_kept),
                                       cmocka_unit_test(shapes_of_pixels), cmocka_unit_test(axes_that_do_not_count)};
    return cmocka_run_group_tests(tests, scratch_make, scratch_drop);
}
