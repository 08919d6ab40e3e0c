/* Any bytes as a program, GLSL where the first is `#`: front end, passes and every kernel's IR, verified; then a few
 * samples in the interpreter when the program is small. The back end is left out: tests/back compares it with the
 * interpreter, and LLVM would take most of the time. */
#include <stdlib.h>
#include <string.h>

#include "bindings/c/api.h"
#include "compiler/pass/walk.h"
#include "tests/fuzz/fuzz.h"

/* IR operations times loop trips, roughly: above this the interpreter is not asked. An engine wants many small
 * programs.
 */
#ifdef FUZZ_ENGINE
enum { MAX_WORK = 4000 };
#else
enum { MAX_WORK = 200000 };
#endif

static double work(const Block *b) {
    double sum = 0;
    for (const Inst *i = b->first; i; i = i->next) {
        double inner = 1;
        for (uint32_t r = 0; r < i->nregions; r++) inner += work(i->region[r]);
        sum += i->op == OP_loop ? inner * (1 + i->imm.loop.max_iters) : inner;
    }
    return sum;
}

static void take_line(void *user, const char *line, const double *values, uint32_t n) {
    volatile double sum = (double)strlen(line);
    for (uint32_t i = 0; i < n; i++) sum += values[i];
    (void)user;
}

/* What bounds say of a box holds at its points. */
static SltStatus look(SltProgram *p, const SltJob *job) {
    enum { POINTS = 5 };
    double x[POINTS * 3], values[POINTS * 4];
    const double lo[3] = {0.25, -0.5, 0.125}, hi[3] = {0.5, 0.25, 0.75};
    SltError err = {0};
    uint32_t dim = slt_dim(p), channels = slt_channels(p);
    for (uint32_t i = 0; i < POINTS; i++)
        for (uint32_t d = 0; d < dim; d++)
            x[i * dim + d] = lo[d] + (hi[d] - lo[d]) * (double)(i * (d + 1) % POINTS) / (POINTS - 1);
    SltBound bound = SLT_BOUND_INIT;
    SltCrossing crossing = SLT_CROSSING_INIT;
    SltStatus status = slt_eval(p, job, POINTS, x, NULL, values, NULL, &err);
    if (status == SLT_OK) status = slt_bound(p, job, 1, lo, hi, &bound, &err);
    if (status != SLT_OK) return status;
    for (uint32_t i = 0; i < POINTS * channels; i++)
        if (values[i] < bound.lo[i % channels] || values[i] > bound.hi[i % channels]) abort();
    return slt_crossing(p, job, lo, hi, 0, &crossing, &err);
}

/* A small job, which of them by `way`: the gradient of the integral by three estimators, that of a loss, an image of
 * derivatives, an image, ... */
static SltStatus estimate(SltProgram *p, size_t way) {
    enum { SIDE = 3 };
    SltJob job = SLT_JOB_INIT;
    SltError err = {0};
    SltStats stats = SLT_STATS_INIT;
    job.threads = 1, job.samples = 64, job.spp = 1, job.max_evaluations = 4096;
    for (int i = 0; i < 3; i++) job.size[i] = SIDE;
    uint32_t nfloats = slt_float_count(p), channels = slt_channels(p);
    float *image = calloc((size_t)SIDE * SIDE * SIDE * channels, sizeof *image);
    double value[4], *gradient = calloc((size_t)channels * nfloats + 1, sizeof *gradient);
    const double *along = gradient;
    SltIntegral out = {.struct_size = sizeof out, .value = value, .gradient = gradient};
    SltStatus status = SLT_LIMIT;
    if (image && gradient) {
        /* Those that people choose are wanted often, the others (SCANLINE ... FD) now and then. */
        static const SltEstimator estimators[] = {SLT_EST_AUTO, SLT_EST_LATTICE, SLT_EST_QUADRATURE};
        job.estimator = way % 4 < 3 ? estimators[way % 4] : (SltEstimator)(way / 28 % SLT_ESTIMATORS);
        switch (way / 4 % 7) {
        case 0: status = slt_grad_loss(p, &job, image, NULL, NULL, gradient, NULL, NULL, &stats, &err); break;
        case 1:
            for (uint32_t i = 0; i < nfloats; i++) gradient[i] = 1;
            status = slt_grad_images(p, &job, 1, &along, &image, NULL, &stats, &err);
            break;
        case 2: status = slt_grad_adjoint(p, &job, image, gradient, NULL, &stats, &err); break;
        case 3: status = look(p, &job); break;
        case 4: status = slt_render(p, &job, image, &stats, &err); break;
        default: status = slt_grad_integral(p, &job, &out, &stats, &err);
        }
    }
    free(image);
    free(gradient);
    return status;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (size > 1 << 16) return 0;
    char *text = malloc(size + 1);
    if (!text) return 0;
    memcpy(text, data, size);
    text[size] = 0;
    SltOptions opt = SLT_OPTIONS_INIT;
    opt.interpret = opt.verify = true;
    opt.f64 = size & 1;
    opt.disc_auto = size & 2;
    /* Nothing of the language begins with `#`. */
    opt.language = size && data[0] == '#' ? SLT_LANGUAGE_GLSL : SLT_LANGUAGE_SALTUS;
    SltProgram *p = NULL;
    SltStatus status = slt_compile_string(text, "fuzz.salt", &opt, &p);
    free(text);
    if (status == SLT_INTERNAL) abort();
    if (status == SLT_OK) {
        bool needs[K_KINDS];
        for (int k = 0; k < K_KINDS; k++) needs[k] = true;
        SltError err = {0};
        status = api_kernels(p, needs, &err);
        if (status == SLT_INTERNAL) abort();
        char *values = slt_params_json(p);
        if (!values || slt_set_params_json(p, values, "values.json", &err) != SLT_OK) abort();
        free(values);
        slt_set_print(p, take_line, NULL, &err);
        double all = 0;
        for (int k = 0; k < K_KINDS && status == SLT_OK; k++)
            if (p->fn[k]) all += work(p->fn[k]->body);
        if (status == SLT_OK && all < MAX_WORK && estimate(p, size >> 2) == SLT_INTERNAL) abort();
    }
    if (p) slt_diagnostics_text(p), slt_diagnostics_json(p);
    slt_program_free(p);
    return 0;
}
