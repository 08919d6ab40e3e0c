/* What neighbours and halvings are worth: root mean square error of the derivative of a circle's integral by its
 * radius, over seeds, as the number of neighbours of snapped segments varies, and how near to a root searches go.
 * bench-search [samples [seeds]]: lines of estimator,knob,value,evaluations,error for tests/bench/errors.py. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "bindings/c/api.h"

static const char *const source = "param float r = 0.4;\n"
                                  "[Domain(-1.0, 1.0)]\nshader float main(float2 x) { float f = 0.25;\n"
                                  "    [Disc] if (length(x - float2(0.1, -0.05)) < r) f = 1.0;\n    return f; }\n";
#define TRUTH (0.75 * 2 * 3.14159265358979323846 * 0.4)

static int measure(SltProgram *p, SltEstimator e, uint64_t samples, int seeds, const char *name) {
    double square = 0, evaluations = 0, g = 0;
    for (int i = 0; i < seeds; i++) {
        SltJob job = SLT_JOB_INIT;
        SltStats stats = SLT_STATS_INIT;
        SltIntegral out = SLT_INTEGRAL_INIT;
        SltError err = {0};
        job.integral = true, job.estimator = e, job.samples = samples, job.seed = (uint32_t)(17 * i + 1);
        job.replicates = 1, job.threads = 1, job.no_interior = true, out.gradient = &g;
        if (slt_grad_integral(p, &job, &out, &stats, &err) != SLT_OK) return fprintf(stderr, "%s\n", err.text), 1;
        square += (g - TRUTH) * (g - TRUTH), evaluations += (double)stats.evaluations;
    }
    printf("%s,%u,%u,%.0f,%.6g\n", name, p->scene.neighbours, p->scene.halvings, evaluations / seeds,
           sqrt(square / seeds) / TRUTH);
    return 0;
}

int main(int argc, char **argv) {
    static const uint32_t neighbours[] = {2, 4, 9, 14, 28, 56}, halvings[] = {2, 4, 6, 8, 10, 12, 15, 20, 30};
    uint64_t samples = argc > 1 ? strtoull(argv[1], NULL, 10) : 32768;
    int seeds = argc > 2 ? atoi(argv[2]) : 16, bad = 0;
    SltOptions o = SLT_OPTIONS_INIT;
    SltProgram *p;
    o.f64 = true;
    if (slt_compile_string(source, "circle", &o, &p) != SLT_OK)
        return fprintf(stderr, "%s", slt_diagnostics_text(p)), 1;
    puts("estimator,neighbours,halvings,evaluations,relative_rmse");
    for (size_t i = 0; i < sizeof neighbours / sizeof *neighbours; i++)
        p->scene.neighbours = neighbours[i], bad |= measure(p, SLT_EST_SNAP_KNN, samples, seeds, "snap-knn");
    p->scene.neighbours = 0;
    for (size_t i = 0; i < sizeof halvings / sizeof *halvings; i++) {
        p->scene.halvings = halvings[i];
        bad |= measure(p, SLT_EST_LATTICE, samples, seeds, "lattice");
        bad |= measure(p, SLT_EST_SNAP_KNN, samples, seeds, "snap-knn");
    }
    slt_program_free(p);
    return bad;
}
