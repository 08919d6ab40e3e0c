/* What samples cost outside the kernel, nanoseconds each: images of 512 x 512 pixels of a kernel that copies x, which
 * takes less than a tenth of one, on one thread, the least of several renders. And what a call costs: 16 x 16 pixels.
 *
 *     bench-samples [ROUNDS] */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "tests/sample/layouts.h"

enum { SIZE = 512, SMALL = 16 };

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void copy(SltKernelArgs *a, uint32_t n) { memcpy(a->out[0], a->in[SLT_IN_X0], n * sizeof(float)); }
static void copy_f64(SltKernelArgs *a, uint32_t n) { memcpy(a->out[0], a->in[SLT_IN_X0], n * sizeof(double)); }

typedef struct Row {
    const char *name;
    bool rand, f64;
    SltFilter filter;
} Row;

static SltScene scene_of(const Row *r) {
    SltScene s = {.dim = 2, .channels = 1, .adj_lanes = 32, .uses_rand = r->rand, .f64 = r->f64};
    for (int d = 0; d < 2; d++) s.lo[d] = -1, s.hi[d] = 1;
    scene_add_output(&s, SLT_K_VALUE, SLT_OUT_F, 1);
    s.layout[SLT_K_VALUE].reads = 3u << SLT_IN_X0 | (r->rand ? 1u << SLT_IN_STREAM | 1u << SLT_IN_RAND0 : 0);
    s.kernel[SLT_K_VALUE] = r->f64 ? copy_f64 : copy;
    return s;
}

static double render(const SltScene *s, SltJob *j, float *image) {
    SltError err = {0};
    double start = now();
    if (slt_estimate_render(s, j, 0, image, NULL, &err) != SLT_OK) fprintf(stderr, "%s\n", err.text), exit(1);
    return now() - start;
}

int main(int argc, char **argv) {
    static const Row rows[] = {{"box", false, false, SLT_FILTER_BOX},
                               {"box, f64", false, true, SLT_FILTER_BOX},
                               {"box, rand()", true, false, SLT_FILTER_BOX},
                               {"tent", false, false, SLT_FILTER_TENT},
                               {"Gaussian", false, false, SLT_FILTER_GAUSSIAN}};
    static const uint32_t spp[] = {1, 4, 5, 16, 64};
    enum { NSPP = sizeof spp / sizeof *spp };
    int rounds = argc > 1 ? atoi(argv[1]) : 9;
    static float image[SIZE * SIZE];
    printf("ns a sample, at samples a pixel: ");
    for (int k = 0; k < NSPP; k++) printf("%8u", spp[k]);
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        SltScene s = scene_of(&rows[i]);
        printf("\n%-32s ", rows[i].name);
        for (int k = 0; k < NSPP; k++) {
            SltJob j = {.size = {SIZE, SIZE, 1}, .spp = spp[k], .threads = 1, .filter = rows[i].filter};
            double best = HUGE_VAL;
            for (int r = 0; r < rounds; r++) best = fmin(best, render(&s, &j, image));
            printf("%8.2f", 1e9 * best / SIZE / SIZE / spp[k]);
            fflush(stdout);
        }
    }
    SltScene s = scene_of(&rows[0]);
    SltJob j = {.size = {SMALL, SMALL, 1}, .spp = 1, .threads = 1};
    double best = HUGE_VAL;
    for (int r = 0; r < 100 * rounds; r++) best = fmin(best, render(&s, &j, image));
    printf("\na call for %d x %d pixels, us: %.2f\n", SMALL, SMALL, 1e6 * best);
    return 0;
}
