/* saltus bench: error against run time of every estimator, or with --kernels nanoseconds a sample of every kernel.
 *
 * The error is the root mean square over independent seeds of ||gradient - reference|| / ||reference||. The reference
 * is quadrature where that states a far smaller error than any curve can show, else a lattice of 64 times the largest
 * number of samples (averaged over seeds). Samples double along a curve; of quadrature it is the number of Gauss points
 * that grows, unless --gauss has fixed it. Seconds are the median of the runs, with --threads 1 of processor time,
 * which other programs do not lengthen; evaluations count every kernel call on a sample and every box. */
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <time.h>

#include "bindings/c/api.h"
#include "cli/bench.h"
#include "runtime/base/text.h"

enum { MAX_POINTS = 16, MAX_REPEATS = 256 };

static const char *const names[SLT_ESTIMATORS] = {
#define SLT_ESTIMATOR(id, name, ...) name,
#define SLT_DIFFERENCES(id, name, ...) name,
#define SLT_CELLS(id, name, ...) name,
#include "saltus/estimators.def"
};

typedef struct Point {
    uint64_t samples;
    uint32_t gauss; /* of quadrature: points along a piece; 0: by samples */
    double evaluations, seconds, error;
} Point;

typedef struct Curve {
    const char *name;
    SltEstimator estimator;
    Point at[MAX_POINTS];
    int n;
    const char *skipped;
} Curve;

typedef struct Bench {
    Cli *c;
    SltProgram *p;
    double *reference, *g, *stated; /* stated: the errors that quadrature states */
    size_t size;
    double norm;
    Curve curves[SLT_ESTIMATORS];
    SltError err;
    double budget;       /* seconds a point */
    const char *made_by; /* the reference */
    Curve other;         /* the lattice in the other precision, at the largest number of samples */
} Bench;

static double processor_seconds(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static SltStatus gradient(Bench *b, SltEstimator e, uint64_t samples, uint32_t gauss, uint32_t seed, SltStats *stats) {
    SltJob job = b->c->job;
    if (gauss) job.gauss = gauss;
    job.estimator = e;
    job.samples = samples;
    job.segments = 0;
    job.seed = seed;
    job.replicates = 1;
    SltIntegral out = {.struct_size = sizeof out, .gradient = b->g};
    double start = processor_seconds();
    SltStatus s = slt_grad_integral(b->p, &job, &out, stats, &b->err);
    if (job.threads == 1) stats->seconds = processor_seconds() - start;
    return s;
}

static double norm(const double *v, size_t n) {
    double sum = 0;
    for (size_t i = 0; i < n; i++) sum += v[i] * v[i];
    return sqrt(sum);
}

/* The gradient by quadrature, as exact as the precision allows: true if it states so. */
static bool make_certified(Bench *b) {
    double wanted = b->c->opt.f64 ? 1e-11 : 1e-6, enough = b->c->opt.f64 ? 1e-8 : 1e-5;
    SltJob job = b->c->job;
    SltStats stats = SLT_STATS_INIT;
    job.estimator = SLT_EST_QUADRATURE, job.error = wanted, job.gauss = 0, job.max_evaluations = 0;
    job.time_limit = 20;
    SltIntegral out = {.struct_size = sizeof out, .gradient = b->reference, .gradient_stderr = b->stated};
    SltError ignored = {0};
    if (slt_grad_integral(b->p, &job, &out, &stats, &ignored) != SLT_OK || !stats.cells) return false;
    b->norm = norm(b->reference, b->size);
    return norm(b->stated, b->size) <= enough * b->norm;
}

static SltStatus make_reference(Bench *b, uint64_t largest) {
    enum { SEEDS = 4 };
    SltStatus s = SLT_OK;
    b->made_by = "quadrature";
    if (make_certified(b)) return SLT_OK;
    b->made_by = "lattice";
    memset(b->reference, 0, b->size * sizeof *b->reference);
    /* As many samples as fit in ten seconds. */
    uint64_t samples = largest * 64;
    SltStats stats = SLT_STATS_INIT;
    double start = cli_now();
    s = gradient(b, SLT_EST_LATTICE, largest, 0, 999331, &stats);
    double each = cli_now() - start;
    while (each * (double)samples / (double)largest * SEEDS > 20 && samples > largest * 4) samples /= 2;
    for (int r = 0; r < SEEDS && s == SLT_OK; r++) {
        s = gradient(b, SLT_EST_LATTICE, samples, 0, 999331u + 7u * (uint32_t)(r + 1), &stats);
        for (size_t i = 0; i < b->size; i++) b->reference[i] += b->g[i] / SEEDS;
    }
    b->norm = norm(b->reference, b->size);
    return s;
}

static int compare(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static SltStatus measure(Bench *b, Curve *k, uint64_t samples, uint32_t gauss) {
    double seconds[MAX_REPEATS], square = 0, evaluations = 0;
    uint32_t repeats = b->c->repeats < MAX_REPEATS ? b->c->repeats : MAX_REPEATS;
    double start = cli_now();
    uint32_t done = 0;
    for (uint32_t r = 0; r < repeats; r++) {
        SltStats stats = SLT_STATS_INIT;
        SltStatus s = gradient(b, k->estimator, samples, gauss, b->c->job.seed + 104729u * (r + 1), &stats);
        if (s != SLT_OK) return s;
        if (k->estimator == SLT_EST_QUADRATURE && !stats.cells) {
            k->skipped = "the program has no bounds";
            return SLT_OK;
        }
        double d = 0;
        for (size_t i = 0; i < b->size; i++) d += (b->g[i] - b->reference[i]) * (b->g[i] - b->reference[i]);
        square += d / (b->norm > 0 ? b->norm * b->norm : 1);
        seconds[done++] = stats.seconds;
        evaluations += (double)stats.evaluations;
        if (cli_now() - start > b->budget && done >= 3) break;
    }
    qsort(seconds, done, sizeof *seconds, compare);
    k->at[k->n++] = (Point){samples, gauss, evaluations / done, seconds[done / 2], sqrt(square / done)};
    return SLT_OK;
}

/* The error of the same lattice in the other precision, which shows where f32 stops gaining. */
static SltStatus measure_other(Bench *b, uint64_t samples) {
    SltProgram *own = b->p, *other = NULL;
    bool quiet = b->c->quiet;
    b->c->opt.f64 = !b->c->opt.f64, b->c->quiet = true;
    int status = cli_compile(b->c, &other);
    b->c->opt.f64 = !b->c->opt.f64, b->c->quiet = quiet;
    b->other = (Curve){.name = b->c->opt.f64 ? "lattice, f32" : "lattice, f64", .estimator = SLT_EST_LATTICE};
    if (status == SLT_OK) {
        b->p = other;
        status = measure(b, &b->other, samples, 0);
        b->p = own;
    }
    slt_program_free(other);
    return (SltStatus)status;
}

/* Is `name`, of n bytes, the item of a list with commas that starts at `at`? */
static bool is_item(const char *at, const char *name, size_t n) {
    return !strncmp(at, name, n) && (at[n] == 0 || at[n] == ',');
}

static const char *next_item(const char *at) {
    at = strchr(at, ',');
    return at ? at + 1 : NULL;
}

static bool wanted(const Bench *b, const char *name) {
    if (!b->c->estimators) return true;
    for (const char *at = b->c->estimators; at; at = next_item(at))
        if (is_item(at, name, strlen(name))) return true;
    return false;
}

static int check_estimators(const Cli *c) {
    for (const char *at = c->estimators; at; at = next_item(at)) {
        bool known = false;
        for (int e = 0; e < SLT_ESTIMATORS; e++) known |= is_item(at, names[e], strlen(names[e]));
        if (!known)
            return cli_usage(c, "--estimators: `%.*s` is none of %s", (int)strcspn(at, ","), at, cli_estimators + 1);
    }
    return SLT_OK;
}

/* ---- outputs */
static char *make_csv(Bench *b) {
    Text text;
    FILE *out = text_open(&text);
    if (!out) return NULL;
    fputs("estimator,samples,evaluations,seconds,relative_rmse,gauss\n", out);
    for (int e = 0; e < SLT_ESTIMATORS; e++)
        for (int i = 0; i < b->curves[e].n; i++) {
            const Point *q = &b->curves[e].at[i];
            fprintf(out, "%s,%llu,%.0f,%.9g,%.9g,%u\n", b->curves[e].name, (unsigned long long)q->samples,
                    q->evaluations, q->seconds, q->error, q->gauss);
        }
    return text_close(&text);
}

static char *make_json(Bench *b) {
    Text text;
    FILE *out = text_open(&text);
    if (!out) return NULL;
    fputs("{\"shader\": ", out);
    json_text(out, b->c->expr ? b->c->expr : b->c->file);
    fprintf(out, ", \"precision\": \"%s\", \"threads\": %u, \"reference\": \"%s\", \"reference_norm\": ",
            b->c->opt.f64 ? "f64" : "f32", b->c->job.threads, b->made_by);
    json_number(out, b->norm);
    fputs(", \"curves\": {", out);
    bool first = true;
    for (int e = 0; e < SLT_ESTIMATORS; e++) {
        if (!b->curves[e].n) continue;
        fprintf(out, "%s\"%s\": [", first ? "" : ", ", b->curves[e].name);
        first = false;
        for (int i = 0; i < b->curves[e].n; i++) {
            const Point *q = &b->curves[e].at[i];
            fprintf(out, "%s{\"samples\": %llu, \"evaluations\": ", i ? ", " : "", (unsigned long long)q->samples);
            json_number(out, q->evaluations);
            fputs(", \"seconds\": ", out);
            json_number(out, q->seconds);
            fputs(", \"error\": ", out);
            json_number(out, q->error);
            if (q->gauss) fprintf(out, ", \"gauss\": %u", q->gauss);
            fputs("}", out);
        }
        fputs("]", out);
    }
    fputs("}", out);
    if (b->other.n) {
        fprintf(out, ", \"other_precision\": {\"precision\": \"%s\", \"samples\": %llu, \"seconds\": ",
                b->c->opt.f64 ? "f32" : "f64", (unsigned long long)b->other.at[0].samples);
        json_number(out, b->other.at[0].seconds);
        fputs(", \"error\": ", out);
        json_number(out, b->other.at[0].error);
        fputs("}", out);
    }
    fputs(", \"skipped\": {", out);
    first = true;
    for (int e = 0; e < SLT_ESTIMATORS; e++) {
        if (!b->curves[e].skipped) continue;
        fprintf(out, "%s\"%s\": ", first ? "" : ", ", b->curves[e].name);
        json_text(out, b->curves[e].skipped);
        first = false;
    }
    fputs("}}\n", out);
    return text_close(&text);
}

static char *make_svg(Bench *b) {
    double x[SLT_ESTIMATORS][MAX_POINTS], y[SLT_ESTIMATORS][MAX_POINTS];
    PlotSeries series[SLT_ESTIMATORS];
    int n = 0;
    for (int e = 0; e < SLT_ESTIMATORS; e++) {
        Curve *k = &b->curves[e];
        if (!k->n) continue;
        for (int i = 0; i < k->n; i++) {
            x[e][i] = b->c->against_evaluations ? k->at[i].evaluations : k->at[i].seconds;
            y[e][i] = k->at[i].error;
        }
        series[n++] = (PlotSeries){.name = k->name, .x = x[e], .y = y[e], .count = k->n};
    }
    PlotOptions plot = {.title = b->c->against_evaluations ? "Error of the gradient against evaluations"
                                                           : "Error of the gradient against run time",
                        .x_label = b->c->against_evaluations ? "evaluations" : "seconds",
                        .y_label = "relative RMSE",
                        .log_x = true,
                        .log_y = true};
    return plot_svg(&plot, series, n, &b->err);
}

/* -o FILE.csv, .json or .svg is that file alone; any other name is a folder for all three. */
static const struct Form {
    const char *suffix;
    char *(*make)(Bench *b);
} forms[] = {{".csv", make_csv}, {".json", make_json}, {".svg", make_svg}};
enum { FORMS = sizeof forms / sizeof *forms };

static const struct Form *form_of(const char *path) {
    size_t n = strlen(path);
    for (int i = 0; i < FORMS; i++) {
        size_t m = strlen(forms[i].suffix);
        if (n > m && !strcasecmp(path + n - m, forms[i].suffix)) return &forms[i];
    }
    return NULL;
}

static SltStatus write_files(Bench *b) {
    const char *out = b->c->output;
    const struct Form *only = form_of(out);
    if (!only && mkdir(out, 0777) != 0 && errno != EEXIST)
        return status_fail_errno(&b->err, SLT_OUTPUT, errno, "cannot make the folder %s", out);
    SltStatus s = SLT_OK;
    FileGroup outputs;
    file_group_begin(&outputs);
    for (const struct Form *f = forms; f < forms + FORMS && s == SLT_OK; f++) {
        char path[4096], *text;
        if (only && f != only) continue;
        int n =
            only ? snprintf(path, sizeof path, "%s", out) : snprintf(path, sizeof path, "%s/bench%s", out, f->suffix);
        if (n >= (int)sizeof path) s = status_fail(&b->err, SLT_OUTPUT, "%s: the path is too long", out);
        else if (!(text = f->make(b))) s = status_fail(&b->err, SLT_LIMIT, "%s: out of memory", path);
        else s = file_write_atomic(path, text, strlen(text), &b->err), free(text);
    }
    s = file_group_end(&outputs, s, &b->err);
    if (s != SLT_OK || b->c->json || b->c->quiet) return s;
    if (only) fprintf(stderr, "saltus: %s\n", out);
    else fprintf(stderr, "saltus: %s/bench.csv, .json and .svg\n", out);
    return s;
}

static void print_table(const Bench *b) {
    printf("%-14s %12s %14s %12s %14s\n", "estimator", "samples", "evaluations", "seconds", "relative RMSE");
    for (int e = 0; e < SLT_ESTIMATORS; e++) {
        for (int i = 0; i < b->curves[e].n; i++) {
            const Point *q = &b->curves[e].at[i];
            if (q->gauss) printf("%-14s %9s %2u", b->curves[e].name, "gauss", q->gauss);
            else printf("%-14s %12llu", b->curves[e].name, (unsigned long long)q->samples);
            printf(" %14.0f %12.3g %14.3g\n", q->evaluations, q->seconds, q->error);
        }
        if (b->curves[e].skipped) printf("%-14s left out: %s\n", b->curves[e].name, b->curves[e].skipped);
    }
    if (b->other.n)
        printf("%-14s %12llu %14.0f %12.3g %14.3g\n", b->other.name, (unsigned long long)b->other.at[0].samples,
               b->other.at[0].evaluations, b->other.at[0].seconds, b->other.at[0].error);
}

static int bench(Bench *b) {
    Cli *c = b->c;
    c->job.integral = true;
    int status = cli_prepare_job(c, b->p);
    if (status != SLT_OK) return status;
    b->size = (size_t)slt_channels(b->p) * slt_float_count(b->p);
    b->reference = cli_need(calloc(b->size + 1, sizeof *b->reference));
    b->g = cli_need(calloc(b->size + 1, sizeof *b->g));
    b->stated = cli_need(calloc(b->size + 1, sizeof *b->stated));
    /* One sample tells all of a shader that is one number all over a pixel: a curve is a point then. */
    bool told = b->p->scene.pixelwise;
    uint64_t largest = told ? 1 : c->job.samples, smallest = told ? 1 : largest >> 10 > 256 ? largest >> 10 : 256;
    uint32_t active = 0;
    for (uint32_t i = 0; i < slt_float_count(b->p); i++) active += slt_wrt_mask(b->p)[i];
    Progress pr;
    progress_begin(&pr, c, "bench");
    SltStatus s = make_reference(b, largest);
    b->budget = 3;
    double done = 0;
    for (int e = 0; e < SLT_ESTIMATORS && s == SLT_OK; e++) {
        Curve *k = &b->curves[e];
        *k = (Curve){.name = names[e], .estimator = (SltEstimator)e};
        if (!wanted(b, names[e])) continue;
        if (e == SLT_EST_AUTO && !c->estimators) {
            k->skipped = "it is one of two others; name it with --estimators";
            continue;
        }
        if (e == SLT_EST_FD && active > 64 && !c->estimators) {
            k->skipped = "more than 64 parameter components; name it with --estimators to run it all the same";
            continue;
        }
        if (told && e != SLT_EST_LATTICE && e != SLT_EST_FD) {
            k->skipped = "one sample tells all: it is the lattice's";
            continue;
        }
        if (slt_uses_rand(b->p) && e == SLT_EST_LATTICE)
            k->skipped = "rand() is called: the lattice is cut into scanlines";
        bool by_gauss = e == SLT_EST_QUADRATURE && !c->job.gauss;
        for (uint32_t q = 2; by_gauss && q <= SLT_GAUSS_MAX && !k->skipped && s == SLT_OK; q += 2)
            s = measure(b, k, largest, q);
        for (uint64_t n = smallest; !by_gauss && n <= largest && k->n < MAX_POINTS && s == SLT_OK; n *= 2) {
            s = measure(b, k, n, 0);
            progress_update(&pr, (++done) / (SLT_ESTIMATORS * 11.0), names[e]);
            if (!k->n || k->at[k->n - 1].seconds > b->budget) break;
        }
    }
    if (s == SLT_OK && wanted(b, "lattice") && strcmp(c->file ? c->file : "", "-")) s = measure_other(b, largest);
    progress_end(&pr);
    if (s == SLT_OK && c->output) s = write_files(b);
    if (s == SLT_OK && c->json) {
        char *json = cli_need(make_json(b));
        fputs(json, stdout);
        free(json);
    } else if (s == SLT_OK) {
        print_table(b);
    }
    /* what did not compile in the other precision has said so */
    return s == SLT_OK || b->err.status == SLT_OK ? (int)s : cli_fail(c, &b->err);
}

int verb_bench(Cli *c) {
    Bench b = {.c = c};
    int status = check_estimators(c);
    if (status != SLT_OK) return status;
    if (c->output && c->kernels) return cli_usage(c, "--kernels prints a table: leave out -o");
    status = cli_compile(c, &b.p);
    if (status == SLT_OK && c->output && image_can_write(c->output))
        status = cli_usage(c, "-o %s: bench writes .csv, .json, .svg, or all three to a folder", c->output);
    if (status == SLT_OK) status = c->kernels ? bench_kernels(c, b.p) : bench(&b);
    free(b.reference);
    free(b.g);
    free(b.stated);
    slt_program_free(b.p);
    return status;
}
