/* What the gradient of direct light costs: heights of an n x n field, 512 x 512 pixels, one sample, one thread;
 * processor time of the forward image and of its reverse derivative (smooth part and jumps), taken in turn in one
 * process, best of several. bench-terrain [repetitions]       a fractal terrain; with SALTUS_DATA the Jacksboro
 * elevation, upsampled */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "saltus/saltus.h"

enum { PIXELS = 512, DEM_W = 403, DEM_H = 344 };

static const char *const source =
    "[Extent(-1.0, -1.0, 1.0, 1.0)] param heightfield h = zeros(%u, %u);\n"
    "[NoDiff] param float3 eye = float3(0.0, -2.4, 1.6);\n"
    "[NoDiff] param float3 sun = float3(0.7, -0.3, 0.5);\n"
    "[Domain(-1.0, 1.0)]\n"
    "shader float main(float2 x) {\n"
    "    float3 f = normalize(float3(0.0, 1.0, -0.62)), r = float3(1.0, 0.0, 0.0), u = cross(r, f);\n"
    "    float3 d = f + 0.42 * (x.x * r + x.y * u);\n"
    "    [Disc] Hit v = h.trace(eye, d, 0.0, 50.0);\n"
    "    if (!v.hit) return 0.1;\n"
    "    float3 p = float3(v.p, eye.z + v.t * d.z) + 0.001 * v.normal;\n"
    "    float l = max(dot(v.normal, normalize(sun)), 0.0);\n"
    "    [Disc] if (h.occluded(p, sun, 0.003, 50.0)) l = 0.0;\n"
    "    return 0.8 * (0.2 + l);\n"
    "}\n";

static double seconds(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static float *read_dem(void) {
    const char *folder = getenv("SALTUS_DATA");
    char path[4096];
    if (!folder) return NULL;
    snprintf(path, sizeof path, "%s/jacksboro_403x344.f32", folder);
    FILE *f = fopen(path, "rb");
    float *v = malloc(sizeof *v * DEM_W * DEM_H);
    bool ok = f && v && fread(v, sizeof *v, DEM_W * DEM_H, f) == DEM_W * DEM_H;
    if (f) fclose(f);
    if (!ok) free(v), v = NULL;
    return v;
}

static double height(const float *dem, double x, double y) {
    double v = 0;
    if (!dem) {
        double a = 0.12, k = 5;
        for (int o = 0; o < 7; o++, a *= 0.45, k *= 2.1)
            v += a * sin(k * x + 1.3 * o + 2 * cos(0.7 * k * y)) * cos(k * y - o);
        return v;
    }
    double u = x * (DEM_W - 1.001), w = y * (DEM_H - 1.001);
    int i = (int)u, j = (int)w;
    u -= i, w -= j;
    const float *p = dem + j * DEM_W + i;
    return 3e-4 * ((p[0] * (1 - u) + p[1] * u) * (1 - w) + (p[DEM_W] * (1 - u) + p[DEM_W + 1] * u) * w - 400);
}

int main(int argc, char **argv) {
    int reps = argc > 1 ? atoi(argv[1]) : 5;
    float *dem = read_dem(), *image = malloc(PIXELS * PIXELS * sizeof *image),
          *adjoint = malloc(PIXELS * PIXELS * sizeof *adjoint);
    for (int i = 0; i < PIXELS * PIXELS; i++) adjoint[i] = (float)((i * 2654435761u >> 8) & 0xffff) / 65536;
    printf("%s\n%6s %12s %12s %8s %12s\n", dem ? "Jacksboro" : "fractal", "n", "forward ms", "gradient ms", "ratio",
           "crossings");
    for (uint32_t n = 128; n <= 2048; n *= 2) {
        char text[4096];
        snprintf(text, sizeof text, source, n, n);
        SltOptions o = SLT_OPTIONS_INIT;
        SltProgram *p = NULL;
        if (slt_compile_string(text, "terrain", &o, &p) != SLT_OK)
            return fprintf(stderr, "%s", slt_diagnostics_text(p)), 1;
        double *v = malloc((size_t)n * n * sizeof *v), *g = malloc((size_t)slt_float_count(p) * sizeof *g);
        for (uint32_t j = 0; j < n; j++)
            for (uint32_t i = 0; i < n; i++)
                v[(size_t)j * n + i] = height(dem, (double)i / (n - 1), (double)j / (n - 1));
        SltParam q = SLT_PARAM_INIT;
        SltError e = {0};
        slt_param_find(p, "h", &q, NULL);
        slt_set_floats(p, q.fbase, n * n, v, NULL);
        SltJob j = SLT_JOB_INIT;
        j.size[0] = j.size[1] = PIXELS, j.spp = 1, j.threads = 1;
        double forward = INFINITY, back = INFINITY;
        SltStats stats = SLT_STATS_INIT;
        for (int r = -1; r < reps; r++) { /* the first round compiles */
            double t = seconds();
            if (slt_render(p, &j, image, NULL, &e) != SLT_OK) return fprintf(stderr, "%s\n", e.text), 1;
            if (r >= 0) forward = fmin(forward, seconds() - t);
            stats = SLT_STATS_INIT;
            t = seconds();
            if (slt_grad_adjoint(p, &j, adjoint, g, NULL, &stats, &e) != SLT_OK)
                return fprintf(stderr, "%s\n", e.text), 1;
            if (r >= 0) back = fmin(back, seconds() - t);
        }
        printf("%6u %12.1f %12.1f %8.2f %12llu\n", n, 1e3 * forward, 1e3 * back, back / forward,
               (unsigned long long)stats.crossings);
        free(v), free(g);
        slt_program_free(p);
    }
    free(dem), free(image), free(adjoint);
    return 0;
}
