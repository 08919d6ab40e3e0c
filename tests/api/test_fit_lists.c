/* Inside a fit a tile's lists leave out what is painted over, and what does not reach its strips: the image of a step
 * is that of a call outside, bit by bit, and so is the gradient, but for the order of sums. */
#include <math.h>

#include "saltus/fit.h"
#include "tests/api/program.h"

enum { SIDE = 96, FLOATS = 400 * 6 };

/* Small discs and some that cover whole tiles, the last ones among them; a [Disc] within a condition, too. */
static const char discs[] =
    "struct Disc { float2 centre; float radius; float3 ink; };\n"
    "Disc make(int i) { Disc d = { rand2(), i % 5 == 0 ? 0.3 * rand() : 0.03 + 0.03 * rand(), rand3() }; return d; }\n"
    "param Disc discs[400] = init(make);\n"
    "float4 extent(int i) { return float4(discs[i].centre - discs[i].radius, discs[i].centre + discs[i].radius); }\n"
    "shader float3 main(float2 x) {\n"
    "    float3 c = float3(1.0);\n"
    "    [Cull(extent)] for (int i = 0; i < 400; i++) {\n"
    "        [Disc] if (length(x - discs[i].centre) < discs[i].radius) c = discs[i].ink * (1.0 + 0.1 * x.x);\n"
    "    }\n"
    "    return c;\n"
    "}\n";

typedef struct Seen {
    uint32_t n;
    float image[SIDE * SIDE * 3];
    double gradient[FLOATS];
} Seen;

static bool see(void *user, const SltFitIteration *i) {
    Seen *s = user;
    assert_int_equal(i->count, FLOATS);
    memcpy(s->image, i->image, sizeof s->image);
    memcpy(s->gradient, i->gradient, sizeof s->gradient);
    return s->n++, true;
}

static void same(void **state) {
    (void)state;
    static Seen seen[3], out;
    static float target[SIDE * SIDE * 3];
    SltProgram *p = compile(discs);
    SltJob job = SLT_JOB_INIT;
    SltError err;
    double loss;
    job.size[0] = job.size[1] = SIDE, job.spp = 4, job.estimator = SLT_EST_LATTICE, job.seed = 3;
    for (uint32_t i = 0; i < SIDE * SIDE * 3; i++) target[i] = 0.5f;
    for (uint32_t threads = 1; threads <= 2; threads++) {
        SltFitView view = SLT_FIT_VIEW_INIT;
        SltFitOptions o = SLT_FIT_OPTIONS_INIT;
        job.threads = threads, view.target = target;
        o.job = &job, o.views = &view, o.nviews = 1, o.optimizer = "lbfgs", o.iterations = 1;
        o.iterated = see, o.iterated_user = &seen[threads];
        if (threads == 1)
            assert_ok(slt_grad_loss(p, &job, target, NULL, &loss, out.gradient, NULL, out.image, NULL, &err));
        assert_ok(slt_fit(p, &o, NULL, &err));
        assert_int_equal(seen[threads].n, 1);
        assert_memory_equal(seen[threads].image, out.image, sizeof out.image);
    }
    assert_memory_equal(seen[1].gradient, seen[2].gradient, sizeof out.gradient);
    double off = 0, size = 0;
    for (int i = 0; i < FLOATS; i++) {
        off += pow(seen[1].gradient[i] - out.gradient[i], 2), size += pow(out.gradient[i], 2);
        if (out.gradient[i] == 0) assert_float_equal(seen[1].gradient[i], 0, 0);
    }
    if (getenv("SALTUS_PRINT")) printf("relative difference %.3g\n", sqrt(off / size));
    assert_true(size > 0 && sqrt(off / size) < 1e-7);
    slt_program_free(p);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(same)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
