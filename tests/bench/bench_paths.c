/* What the adjoint of a path costs, bounce by bounce: bytes of tape a lane, and processor time of an image and of its
 * interior gradient in all parameters (4225 heights, sun, albedo), taken in turn in one process on one thread, best of
 * several. bench-paths [repetitions [bounces...]] The scene is a bowl with steep walls, which paths leave only after
 * many bounces. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "bindings/c/api.h"

enum { SIDE = 65, PIXELS = 64, SPP = 4, MAX = 16 };

static const char *const source =
    "import pathtrace;\n"
    "[Extent(-1.0, -1.0, 1.0, 1.0)] param heightfield h = zeros(65, 65);\n"
    "param float elevation = 1.2;\nparam float albedo = 0.8;\nconst int BOUNCES = 1;\n"
    "[Domain(-0.4, 0.4)]\nshader float3 main(float2 x) {\n"
    "    Sun sun = { float3(cos(2.9) * cos(elevation), sin(2.9) * cos(elevation), sin(elevation)), float3(3.0), 0.05 };\n"
    "    return path_radiance(h, float3(albedo), sun, float3(0.8), float3(0.2, 0.3, 0.7), float3(x, 2.5),\n"
    "                         float3(0.05, 0.02, -1.0), BOUNCES);\n}\n";

static double seconds(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static double height(int i, int j) {
    double x = (double)i / (SIDE - 1), y = (double)j / (SIDE - 1), r = fmax(fabs(2 * x - 1), fabs(2 * y - 1));
    double t = fmin(fmax((r - 0.55) / 0.25, 0), 1);
    return 3 * (t * t * (3 - 2 * t) + 0.02 * sin(9 * x + 3) * cos(7 * y));
}

int main(int argc, char **argv) {
    static const char *const usual[] = {"1", "2", "4", "8", "16", "32", "64", "128", "1024"};
    int reps = argc > 1 ? atoi(argv[1]) : 7, n = argc > 2 ? argc - 2 : (int)(sizeof usual / sizeof *usual);
    static float image[3 * PIXELS * PIXELS], adjoint[3 * PIXELS * PIXELS];
    double v[SIDE * SIDE], forward[MAX], back[MAX];
    SltProgram *p[MAX];
    SltError e = {0};
    SltJob job = SLT_JOB_INIT;
    job.size[0] = job.size[1] = PIXELS, job.spp = SPP, job.threads = 1, job.no_boundary = true;
    for (int k = 0; k < SIDE * SIDE; k++) v[k] = height(k % SIDE, k / SIDE);
    for (int k = 0; k < 3 * PIXELS * PIXELS; k++) adjoint[k] = (float)((k * 2654435761u >> 8) & 0xffff) / 65536;
    if (n > MAX) n = MAX;
    for (int b = 0; b < n; b++) {
        SltSet set = {"BOUNCES", argc > 2 ? argv[2 + b] : usual[b]};
        SltOptions o = SLT_OPTIONS_INIT;
        o.set = &set, o.nset = 1;
        if (slt_compile_string(source, "paths", &o, &p[b]) != SLT_OK)
            return fprintf(stderr, "%s", slt_diagnostics_text(p[b])), 1;
        SltParam q = SLT_PARAM_INIT;
        slt_param_find(p[b], "h", &q, NULL);
        slt_set_floats(p[b], q.fbase, SIDE * SIDE, v, NULL);
        forward[b] = back[b] = INFINITY;
    }
    double *g = malloc(sizeof *g * slt_float_count(p[0]));
    for (int r = -1; r < reps; r++) /* the first round compiles */
        for (int b = 0; b < n; b++) {
            double t = seconds();
            if (slt_render(p[b], &job, image, NULL, &e) != SLT_OK) return fprintf(stderr, "%s\n", e.text), 1;
            if (r >= 0) forward[b] = fmin(forward[b], seconds() - t);
            t = seconds();
            if (slt_grad_adjoint(p[b], &job, adjoint, g, NULL, NULL, &e) != SLT_OK)
                return fprintf(stderr, "%s\n", e.text), 1;
            if (r >= 0) back[b] = fmin(back[b], seconds() - t);
        }
    printf(
        "| bounces | tape, bytes | image, ns a path | gradient, ns a path | gradient / image |\n|---|---|---|---|---|\n");
    for (int b = 0; b < n; b++) {
        double paths = (double)PIXELS * PIXELS * SPP;
        printf("| %s | %llu | %.0f | %.0f | %.2f |\n", argc > 2 ? argv[2 + b] : usual[b],
               (unsigned long long)p[b]->tape[K_VJP].bytes_per_lane, 1e9 * forward[b] / paths, 1e9 * back[b] / paths,
               back[b] / forward[b]);
        slt_program_free(p[b]);
    }
    free(g);
    return 0;
}
