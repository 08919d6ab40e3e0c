/* A 2D program in chunks, one value a pixel: its whole kernel, called in the middle of each pixel, against slt_render
 * (centred) and slt_render_rgba8, in turn on one thread. Least processor time of all rounds.
 *
 *     bench-chunks FILE.salt [avx512|avx2|sse2 [f64]] */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "bindings/c/api.h"

enum { SIZE = 1024, ROUNDS = 40 };

static double now_ms(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return 1e3 * (double)t.tv_sec + 1e-6 * (double)t.tv_nsec;
}

static void keep_least(double *least, double ms) { *least = ms < *least ? ms : *least; }

static void call_kernel(const SltProgram *p, const SltJob *job) {
    static _Alignas(64) double in[3][SIZE + SLT_PAD], out[SIZE + SLT_PAD];
    SltKernelArgs a = {.out = {out}, .params = p->flt, .iparams = p->scene.iparams, .resolution = {SIZE, SIZE}};
    for (uint32_t s = 0; s < SLT_IN_VARYING; s++) a.in[s] = in[2];
    a.in[IN_X0] = in[0], a.in[IN_X1] = in[1];
    for (uint32_t y = 0; y < SIZE; y++) {
        for (uint32_t x = 0; x < SIZE; x++)
            for (uint32_t d = 0; d < 2; d++) {
                double at = api_middle(p, job, d, d ? y : x);
                if (p->opt.f64) in[d][x] = at;
                else ((float *)in[d])[x] = (float)at;
            }
        p->scene.kernel[K_VALUE](&a, SIZE);
    }
}

static SltProgram *open_program(int argc, char **argv, bool rgba8) {
    SltOptions o = SLT_OPTIONS_INIT;
    if (argc > 2) o.target = argv[2];
    o.f64 = argc > 3 && !strcmp(argv[3], "f64"), o.rgba8 = rgba8;
    SltProgram *p = NULL;
    static const bool needs[K_KINDS] = {[K_VALUE] = true, [K_PRUNE] = true, [K_PRUNED] = true};
    SltError err = {0};
    if (slt_compile_file(argv[1], &o, &p) == SLT_OK && api_kernels(p, needs, &err) == SLT_OK) return p;
    fprintf(stderr, "%s%s\n", slt_diagnostics_text(p), err.text);
    exit(1);
}

int main(int argc, char **argv) {
    if (argc < 2) return 2;
    SltProgram *floats = open_program(argc, argv, false), *bytes = open_program(argc, argv, true);
    SltJob job = SLT_JOB_INIT;
    job.size[0] = job.size[1] = SIZE, job.spp = 1, job.threads = 1, job.centred = true;
    float *image = malloc(SIZE * SIZE * slt_channels(floats) * sizeof *image);
    uint32_t *pixels = malloc(SIZE * SIZE * sizeof *pixels);
    double least[3] = {1e9, 1e9, 1e9}, start;
    for (int round = 0; image && pixels && round < ROUNDS; round++) {
        start = now_ms(), call_kernel(floats, &job), keep_least(&least[0], now_ms() - start);
        start = now_ms(), slt_render_rgba8(bytes, &job, pixels, NULL, NULL), keep_least(&least[1], now_ms() - start);
        start = now_ms(), slt_render(floats, &job, image, NULL, NULL), keep_least(&least[2], now_ms() - start);
    }
    printf("kernel alone %.1f ms, rgba8 %.1f (%.1f times), slt_render %.1f (%.1f times)\n", least[0], least[1],
           least[0] / least[1], least[2], least[0] / least[2]);
    free(image), free(pixels);
    slt_program_free(floats), slt_program_free(bytes);
    return 0;
}
