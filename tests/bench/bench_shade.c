/* Forward shading: kernels in Saltus against the same kernels in scalar C, interleaved in one run, on one thread.
 *
 *     bench_shade FOLDER scalar.so:suffix [more.so:suffix ...] [@TARGET[/LANES] ...] [=NAME ...]
 *
 * FOLDER holds shade_NAME.salt, and the C libraries export NAME_suffix(uint32_t *out, int w, int h, const float *d).
 * @avx2, @native/16 and so on are ways to compile ours, side by side; without one it is @native. =NAME runs that kernel
 * alone. Prints Mpixel/s, the ratio to the first library (median over rounds of the ratio in each round), the share of
 * pixels that differ by more than 2/255, and the geometric means. d of the kernels named below is made here; of others
 * it is what the parameters of the Saltus program are.
 */
#include <dirent.h>
#include <dlfcn.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "saltus/saltus.h"

typedef void Kernel(uint32_t *, int, int, const float *);
enum { MADE = 7, MAX_KERNELS = 64, SIZE = 1024, ROUNDS = 9, MAX_LIBS = 16, MAX_FLOATS = 8192 };
static const char *const made[MADE] = {"circle", "voronoi", "painterly", "fbm", "raymarch", "mlp", "mandel"};
static char names[MAX_KERNELS][64];
static int kernels;

static uint32_t rng;
static float rnd(void) {
    rng = rng * 1664525u + 1013904223u;
    return (float)(rng >> 8) * (1.0f / 16777216.0f);
}

/* The number of a kernel whose data is made here, or MADE. */
static int made_index(const char *name) {
    int k = 0;
    while (k < MADE && strcmp(made[k], name) != 0) k++;
    return k;
}

static int by_name(const void *a, const void *b) {
    const char *x = a, *y = b;
    int i = made_index(x), j = made_index(y);
    return i != j ? i - j : strcmp(x, y);
}

/* Those of shade_NAME.salt in the folder: first those made here, in their order, then the others by name. */
static void find_kernels(const char *folder, char **only, int n) {
    DIR *dir = opendir(folder);
    if (!dir) fprintf(stderr, "cannot read %s\n", folder), exit(1);
    for (const struct dirent *e; kernels < MAX_KERNELS && (e = readdir(dir));) {
        char name[64], rest[8] = "";
        if (sscanf(e->d_name, "shade_%63[^.].%7s", name, rest) != 2 || strcmp(rest, "salt") != 0) continue;
        bool wanted = n == 0;
        for (int i = 0; i < n; i++) wanted |= strcmp(only[i] + 1, name) == 0;
        if (wanted) memcpy(names[kernels++], name, sizeof name);
    }
    closedir(dir);
    qsort(names, (size_t)kernels, sizeof names[0], by_name);
}

/* The same data for every implementation. Returns how many floats. */
static int make_data(const char *folder, const char *name, float *d) {
    int k = made_index(name);
    rng = 12345u + (uint32_t)k * 777u;
    memset(d, 0, MAX_FLOATS * sizeof *d);
    switch (k) {
    case MADE: {
        char file[1024];
        snprintf(file, sizeof file, "%.900s/shade_%.60s.salt", folder, name);
        SltProgram *p;
        if (slt_compile_file(file, NULL, &p) != SLT_OK)
            fprintf(stderr, "%s: %s\n%s", file, slt_last_error(p), slt_diagnostics_text(p)), exit(1);
        uint32_t n = slt_float_count(p);
        if (n > MAX_FLOATS) fprintf(stderr, "%s: too many parameters\n", file), exit(1);
        for (uint32_t i = 0; i < n; i++) d[i] = (float)slt_floats(p)[i];
        slt_program_free(p);
        return (int)n;
    }
    case 0: d[0] = 0.5f, d[1] = 0.45f, d[2] = 0.3f, d[3] = 40.0f; return 4;
    case 1:
        for (int i = 0; i < 64; i++)
            for (int c = 0; c < 5; c++) d[64 * c + i] = rnd();
        return 320;
    case 2:
        for (int i = 0; i < 200; i++) {
            float *q = d + 8 * i;
            q[0] = rnd(), q[1] = rnd();
            float r = 0.03f + 0.17f * rnd();
            q[2] = r * r, q[3] = 1.0f / (r * r), q[4] = rnd(), q[5] = rnd(), q[6] = rnd(), q[7] = 0.3f + 0.6f * rnd();
        }
        return 1600;
    case 3: d[0] = 8.0f, d[1] = -3.7f, d[2] = 2.1f; return 3;
    case 4: {
        float l[3] = {0.5f, 0.7f, -0.6f}, n = sqrtf(l[0] * l[0] + l[1] * l[1] + l[2] * l[2]);
        d[0] = 0.0f, d[1] = 1.6f, d[2] = -4.2f, d[3] = 1.2f, d[4] = l[0] / n, d[5] = l[1] / n, d[6] = l[2] / n;
        return 7;
    }
    case 5:
        for (int i = 0; i < 64; i++) d[i] = (2 * rnd() - 1) * 6.0f;
        for (int i = 0; i < 32; i++) d[64 + i] = (2 * rnd() - 1) * 3.0f;
        for (int i = 0; i < 1024; i++) d[96 + i] = (2 * rnd() - 1) * 0.6f;
        for (int i = 0; i < 32; i++) d[1120 + i] = 2 * rnd() - 1;
        for (int i = 0; i < 32; i++) d[1152 + i] = (2 * rnd() - 1) * 0.25f;
        d[1184] = 0.05f;
        return 1185;
    default: d[0] = -2.2f, d[1] = -1.3f, d[2] = 3.2f, d[3] = 2.6f; return 4;
    }
}

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}
static int compare(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

typedef struct Runner {
    Kernel *c;
    SltProgram *p;
    const float *d;
    uint32_t *out;
    int times;
    double mpix[ROUNDS], ratio[ROUNDS];
} Runner;

static double run(Runner *r) {
    double start = now();
    for (int i = 0; i < r->times; i++) {
        if (r->c) {
            r->c(r->out, SIZE, SIZE, r->d);
        } else {
            SltJob job = SLT_JOB_INIT;
            job.size[0] = job.size[1] = SIZE, job.spp = 1, job.threads = 1;
            SltError err = {0};
            if (slt_render_rgba8(r->p, &job, r->out, NULL, &err) != SLT_OK) fprintf(stderr, "%s\n", err.text), exit(1);
        }
    }
    return (now() - start) / r->times;
}

static double differing(const uint32_t *a, const uint32_t *b) {
    long bad = 0;
    for (long i = 0; i < (long)SIZE * SIZE; i++)
        for (int s = 0; s < 24; s += 8)
            if (abs((int)(a[i] >> s & 255) - (int)(b[i] >> s & 255)) > 2) {
                bad++;
                break;
            }
    return 100.0 * (double)bad / ((double)SIZE * SIZE);
}

typedef struct Way {
    char name[64];
    void *lib;       /* of C, or NULL */
    char target[32]; /* ours */
    uint32_t lanes;  /* 0: chosen */
    double log_sum;
} Way;

/* LIB:SUFFIX or @TARGET[/LANES]. */
static bool read_way(char *text, Way *w) {
    memset(w, 0, sizeof *w);
    if (*text == '@') {
        snprintf(w->name, sizeof w->name, "%s", text);
        char *slash = strchr(text, '/');
        if (slash) *slash = 0, w->lanes = (uint32_t)strtoul(slash + 1, NULL, 10);
        snprintf(w->target, sizeof w->target, "%s", text + 1);
        return true;
    }
    char *colon = strrchr(text, ':');
    if (!colon) return fprintf(stderr, "%s: LIB:SUFFIX or @TARGET is wanted\n", text), false;
    *colon = 0;
    snprintf(w->name, sizeof w->name, "%s", colon + 1);
    if (!(w->lib = dlopen(text, RTLD_NOW))) return fprintf(stderr, "%s\n", dlerror()), false;
    return true;
}

static bool make_runner(const Way *w, const char *folder, const char *name, const float *d, uint32_t n, uint32_t *out,
                        Runner *r) {
    *r = (Runner){.d = d, .out = out, .times = 1};
    char text[1024];
    if (w->lib) {
        snprintf(text, sizeof text, "%.60s_%.60s", name, w->name);
        r->c = (Kernel *)dlsym(w->lib, text);
        return r->c || (fprintf(stderr, "no %s\n", text), false);
    }
    snprintf(text, sizeof text, "%.900s/shade_%.60s.salt", folder, name);
    SltOptions o = SLT_OPTIONS_INIT;
    o.rgba8 = true, o.width = w->lanes, o.target = w->target;
    if (slt_compile_file(text, &o, &r->p) != SLT_OK)
        return fprintf(stderr, "%s: %s\n%s", text, slt_last_error(r->p), slt_diagnostics_text(r->p)), false;
    static double wide[MAX_FLOATS];
    for (uint32_t i = 0; i < n; i++) wide[i] = (double)d[i];
    return slt_set_floats(r->p, 0, n, wide, NULL) == SLT_OK;
}

int main(int argc, char **argv) {
    if (argc < 3)
        return fprintf(stderr, "usage: bench_shade FOLDER LIB.so:SUFFIX ... [@TARGET[/LANES] ...] [=NAME ...]\n"), 2;
    static Way way[MAX_LIBS];
    uint32_t *out[MAX_LIBS];
    int n = 0;
    bool ours = false;
    char *only[MAX_KERNELS];
    int wanted = 0;
    for (int i = 2; i < argc && n < MAX_LIBS - 1; i++) {
        if (argv[i][0] == '=') {
            if (wanted < MAX_KERNELS) only[wanted++] = argv[i];
            continue;
        }
        if (!read_way(argv[i], &way[n])) return 2;
        ours |= !way[n++].lib;
    }
    if (!ours) read_way((char[]){"@native"}, &way[n++]);
    for (int j = 0; j < n; j++)
        if (!(out[j] = aligned_alloc(64, 4ul * SIZE * SIZE))) return fprintf(stderr, "out of memory\n"), 1;
    find_kernels(argv[1], only, wanted);
    static float d[MAX_FLOATS];
    for (int k = 0; k < kernels; k++) {
        int floats = make_data(argv[1], names[k], d);
        static Runner r[MAX_LIBS];
        for (int j = 0; j < n; j++)
            if (!make_runner(&way[j], argv[1], names[k], d, (uint32_t)floats, out[j], &r[j])) return 1;
        for (int j = 0; j < n; j++) {
            /* What pays only for several images is compiled by then; one more may still have compiled. */
            double t = 0;
            for (int warm = 0; warm < 40 && t < 0.3; warm++) t += run(&r[j]);
            t = fmin(run(&r[j]), run(&r[j]));
            r[j].times = t < 0.05 ? (int)ceil(0.05 / t) : 1;
        }
        for (int round = 0; round < ROUNDS; round++)
            for (int j = 0; j < n; j++) {
                r[j].mpix[round] = (double)SIZE * SIZE / run(&r[j]) * 1e-6;
                r[j].ratio[round] = r[j].mpix[round] / r[0].mpix[round];
            }
        for (int j = 0; j < n; j++) {
            qsort(r[j].mpix, ROUNDS, sizeof(double), compare);
            qsort(r[j].ratio, ROUNDS, sizeof(double), compare);
            printf("%-10s %-14s %9.1f Mpixel/s  x%.2f  differ %.4f %%\n", names[k], way[j].name, r[j].mpix[ROUNDS / 2],
                   r[j].ratio[ROUNDS / 2], differing(out[0], out[j]));
            way[j].log_sum += log(r[j].ratio[ROUNDS / 2]);
            slt_program_free(r[j].p);
        }
        fflush(stdout);
    }
    for (int j = 1; j < n; j++) printf("geometric mean of %s: x%.2f\n", way[j].name, exp(way[j].log_sum / kernels));
    return 0;
}
