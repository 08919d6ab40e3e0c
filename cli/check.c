/* saltus check: the gradient of the integral against finite differences with common random numbers.
 *
 * For every parameter (the largest components of long ones, and a random direction through the rest) the derivative of
 * L = sum_c w_c I_c with fixed weights w is compared with central differences of L over independent replicates, or, of
 * estimators with cells, whose values have no noise but a stated error, with one difference. A row
 * passes when |AD - FD| <= z sqrt(se_AD^2 + se_FD^2 + truncation^2 + floor^2), with the truncation taken from a second,
 * doubled step; the step grows where noise is the larger part of these, and shrinks where the truncation is, unless
 * --step says what it is. The slope of the Taylor remainder is 2 where L is smooth.
 *
 * Where cells state more than what is to be compared, as beside shapes that they sample, the row is done again by
 * lines, whose noise is common to both values. A row of which the error is larger than the derivative all the same says
 * nothing, and does not pass.
 *
 * What is printed as the error is that of AD - FD, all of these together: z is their quotient, and nothing else. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "bindings/c/api.h"
#include "cli/cli.h"

enum { REPLICATES = 8, AD_REPLICATES = 16, MAX_ROWS = 64, LARGEST = 3, FEWEST = 4096 };
#define BUDGET_ASKED 12.0 /* the same where --samples was given */
#define BUDGET 3.0 /* seconds of processor time for the values, if each row needs one pair of steps and every other two */

typedef struct Row {
    char name[256];
    double *dir; /* [nfloats], NULL: the unit vector of `index` */
    uint32_t index;
    double step, ad, ad_se, fd, fd_se, truncation, slope, error, z; /* error: of ad - fd, in units of z */
    double scale;                                                   /* of the parameter */
    double right, left; /* the differences to the two sides, where L bends: they do not meet as the step shrinks */
    bool bends;
    bool cells; /* the values of the difference came from these */
    bool pass, says_nothing;
} Row;

/* L, and its stated error where values come from cells, else 0. */
typedef struct Value {
    double v, error;
} Value;

typedef struct Check {
    Cli *c;
    SltProgram *p;
    Row *rows;
    uint32_t n;
    double weight[4];
    double *moved;            /* [nfloats]: parameters near the program's own */
    bool cells;               /* values come from cells */
    bool lines;               /* and no more: those state too much */
    Value centre[REPLICATES]; /* at the program's own parameters: the same for all rows */
    SltStats stats;
    SltError err;
    uint64_t samples;
} Check;

static const double weights[4] = {1.0, 0.7, 1.3, 0.4};

/* L at the given parameters (NULL: the program's own). */
static SltStatus value_of(Check *k, const double *floats, uint32_t seed, Value *out) {
    double v[4], se[4];
    SltStats stats = SLT_STATS_INIT;
    SltJob job = k->c->job;
    job.no_interior = job.no_boundary = true;
    job.replicates = 1;
    job.seed = seed;
    job.samples = k->samples;
    /* The estimator that the derivative was taken with: cells have no noise, and auto would look anew each time. */
    if (k->lines) job.estimator = SLT_EST_LATTICE;
    else if (job.estimator == SLT_EST_AUTO) job.estimator = k->stats.cells ? SLT_EST_QUADRATURE : SLT_EST_LATTICE;
    job.floats = floats;
    SltIntegral r = {.struct_size = sizeof r, .value = v, .value_stderr = se};
    SltStatus s = slt_grad_integral(k->p, &job, &r, &stats, &k->err);
    if (!k->stats.nonfinite_at.known) k->stats.nonfinite_at = stats.nonfinite_at;
    k->stats.nonfinite += stats.nonfinite;
    *out = (Value){0};
    for (uint32_t c = 0; s == SLT_OK && c < slt_channels(k->p); c++) {
        out->v += k->weight[c] * v[c];
        if (stats.cells) out->error += k->weight[c] * se[c];
    }
    k->cells = stats.cells;
    return s;
}

static SltStatus moved_value(Check *k, const Row *row, const double *base, double t, uint32_t seed, Value *out) {
    uint32_t nf = slt_float_count(k->p);
    memcpy(k->moved, base, nf * sizeof *base);
    if (!row->dir) k->moved[row->index] += t;
    for (uint32_t i = 0; row->dir && i < nf; i++) k->moved[i] += t * row->dir[i];
    return value_of(k, k->moved, seed, out);
}

static double mean_of(const double *v, int n, double *se) {
    double m = 0, q = 0;
    for (int i = 0; i < n; i++) m += v[i] / n;
    for (int i = 0; i < n; i++) q += (v[i] - m) * (v[i] - m);
    *se = n > 1 ? sqrt(q / (n - 1) / n) : 0;
    return m;
}

/* The step that is really taken, as the moved parameter is rounded to the program's precision; 0: none. */
static double real_step(const Check *k, const Row *row, const double *base, double h) {
    if (row->dir) return h;
    double up = base[row->index] + h, down = base[row->index] - h;
    return k->p->opt.f64 ? (up - down) / 2 : ((double)(float)up - (double)(float)down) / 2;
}

static uint32_t seed_of(const Check *k, int replicate) { return k->c->job.seed + 7919u * (uint32_t)(replicate + 1); }

/* As many samples a value as fit the budget, and L at the program's own parameters with these. Processor time: on a
 * busy machine the check is slower, and no worse. */
static SltStatus measure_centre(Check *k) {
    k->samples = k->c->job.samples;
    Value v;
    SltStatus s = value_of(k, NULL, k->c->job.seed, &v); /* compiles, too */
    clock_t start = clock();
    if (s == SLT_OK) s = value_of(k, NULL, seed_of(k, 0), &k->centre[0]);
    int n = k->cells ? 1 : REPLICATES;
    double each = (double)(clock() - start) / CLOCKS_PER_SEC, planned = each * k->n * n * 4 * 1.5;
    double budget = k->c->samples_given ? BUDGET_ASKED : BUDGET;
    while (!k->cells && planned > budget && k->samples / 2 >= FEWEST) k->samples /= 2, planned /= 2;
    for (int r = 0; r < n && s == SLT_OK; r++) s = value_of(k, NULL, seed_of(k, r), &k->centre[r]);
    return s;
}

static SltStatus difference(Check *k, Row *row, const double *base) {
    double one[REPLICATES], two[REPLICATES], ignored, h = row->step, remainder[2] = {0}, stated = 0;
    double bend[2][REPLICATES], left[REPLICATES], right[REPLICATES], noise;
    int n = k->cells ? 1 : REPLICATES;
    if (real_step(k, row, base, h) == 0)
        return status_fail(&k->err, SLT_USAGE,
                           "a step of %g vanishes beside %s = %.9g in %s precision: take a larger --step", h, row->name,
                           base[row->index], k->p->opt.f64 ? "double" : "single");
    for (int r = 0; r < n; r++) {
        uint32_t seed = seed_of(k, r);
        Value up, down;
        SltStatus s = SLT_OK;
        for (int twice = 0; twice < 2 && s == SLT_OK; twice++) {
            double step = h * (twice + 1), taken = real_step(k, row, base, step);
            s = moved_value(k, row, base, step, seed, &up);
            if (s == SLT_OK) s = moved_value(k, row, base, -step, seed, &down);
            (twice ? two : one)[r] = (up.v - down.v) / (2 * taken);
            double below = (k->centre[r].v - down.v) / taken, above = (up.v - k->centre[r].v) / taken;
            bend[twice][r] = above - below;
            if (!twice) left[r] = below, right[r] = above;
            remainder[twice] += (up.v - k->centre[r].v - taken * row->ad) / n;
            if (!twice) stated = hypot(up.error, down.error) / (2 * taken);
        }
        if (s != SLT_OK) return s;
    }
    row->fd = mean_of(one, n, &row->fd_se);
    row->fd_se += stated;
    row->truncation = fabs(mean_of(two, n, &ignored) - row->fd) / 3;
    row->slope = log2(fabs(remainder[1]) / fabs(remainder[0]));
    /* Of a smooth L the sides are half as far apart by half the step. */
    double near = mean_of(bend[0], n, &noise), far = mean_of(bend[1], n, &ignored);
    row->left = mean_of(left, n, &ignored), row->right = mean_of(right, n, &ignored);
    row->bends = fabs(near) > 4 * (noise + stated) + 0.02 * fabs(row->fd) && fabs(far) < 1.5 * fabs(near);
    return SLT_OK;
}

static double difference_error(const Row *row) { return hypot(row->fd_se, row->truncation); }

/* The difference by the step that leaves the least error. */
static SltStatus best_difference(Check *k, Row *row, const double *base) {
    enum { TRIES = 3 };
    SltStatus s = difference(k, row, base);
    if (k->c->job.fd_step > 0) return s;
    /* A difference of 0 in every replicate moved no sample across a jump: it wants a wider step. */
    for (int wider = 0; wider < 4 && s == SLT_OK && row->fd == 0 && row->fd_se == 0 && row->ad != 0; wider++) {
        row->step *= 8;
        s = difference(k, row, base);
    }
    for (int i = 0; i < TRIES && s == SLT_OK; i++) {
        double noise = row->fd_se, bend = row->truncation;
        /* What AD itself does not know, or less than a thousandth, need not be known better. */
        if (difference_error(row) <= fmax(0.5 * row->ad_se, 1e-3 * fabs(row->ad))) break;
        if (!(noise > 4 * bend) && !(bend > 4 * noise)) break;
        Row other = *row;
        other.step *= bend > noise ? 0.25 : 4;
        s = difference(k, &other, base);
        if (s != SLT_OK || !(difference_error(&other) < difference_error(row))) break;
        *row = other;
    }
    return s;
}

/* How large the values of one kind are: those at the same place in all elements of an array, in all texels. One of them
 * near 0 is as easily moved as the others. */
static double typical(const Param *q, uint32_t index, const double *base) {
    uint32_t n = param_is_image(q) ? q->fcount / q->tex_c : q->type->kind == T_ARRAY ? q->type->n : 1;
    uint32_t each = q->fcount / n;
    double sum = 0;
    for (uint32_t i = 0; i < n; i++) sum += fabs(base[q->fbase + i * each + (index - q->fbase) % each]);
    return sum / n;
}

static void add_row(Check *k, const char *name, uint32_t index, double *dir, const double *base) {
    if (k->n >= MAX_ROWS) {
        free(dir);
        return;
    }
    Row *row = &k->rows[k->n++];
    *row = (Row){.index = index, .dir = dir};
    snprintf(row->name, sizeof row->name, "%s", name);
    double scale = 1;
    for (uint32_t i = 0; i < k->p->prog->nparams && !dir; i++) {
        const Param *q = &k->p->prog->params[i];
        if (index < q->fbase || index >= q->fbase + q->fcount) continue;
        double size = fmax(fabs(base[index]), typical(q, index, base));
        /* Extreme scales: a tiny but non-zero parameter moves in its own units. */
        scale = size > 0.05 || (size > 0 && size < 1e-6) ? size : size > 0 ? fmax(size, 1e-3) : 0.05;
    }
    row->step = scale * (k->p->opt.f64 ? 2e-3 : 5e-3);
    if (k->c->job.fd_step > 0) row->step = k->c->job.fd_step;
    row->scale = scale;
}

/* Makes the rows: every component of small parameters, the largest of long ones and one random direction through the
 * rest. */
static SltStatus choose_rows(Check *k, const double *g, const double *base) {
    uint32_t nf = slt_float_count(k->p);
    const uint8_t *mask = slt_wrt_mask(k->p);
    char name[256];
    for (uint32_t i = 0; i < k->p->prog->nparams; i++) {
        const Param *q = &k->p->prog->params[i];
        uint32_t active = 0, top[LARGEST], ntop = 0;
        for (uint32_t f = q->fbase; f < q->fbase + q->fcount; f++) active += mask[f];
        if (!active) continue;
        if (active <= 4) {
            for (uint32_t f = q->fbase; f < q->fbase + q->fcount; f++) {
                if (!mask[f]) continue;
                report_component_name(k->p, f, name, sizeof name);
                add_row(k, name, f, NULL, base);
            }
            continue;
        }
        for (; ntop < LARGEST; ntop++) {
            uint32_t best = UINT32_MAX;
            for (uint32_t f = q->fbase; f < q->fbase + q->fcount; f++) {
                bool taken = !mask[f];
                for (uint32_t t = 0; t < ntop; t++) taken |= top[t] == f;
                if (!taken && (best == UINT32_MAX || fabs(g[f]) > fabs(g[best]))) best = f;
            }
            top[ntop] = best;
            report_component_name(k->p, best, name, sizeof name);
            add_row(k, name, best, NULL, base);
        }
        double *dir = calloc(nf + 1, sizeof *dir), scale = 0;
        if (!dir) return status_fail(&k->err, SLT_LIMIT, "out of memory");
        uint32_t state = 12345u + i;
        for (uint32_t f = q->fbase; f < q->fbase + q->fcount; f++) {
            state = state * 1664525u + 1013904223u;
            if (mask[f]) dir[f] = (double)(state >> 8) / 8388608.0 - 1.0;
            scale = fabs(base[f]) > scale ? fabs(base[f]) : scale;
        }
        snprintf(name, sizeof name, "%s (random direction of %u)", q->name, active);
        add_row(k, name, 0, dir, base);
        if (!(k->c->job.fd_step > 0)) k->rows[k->n - 1].step *= scale > 0.05 ? (scale < 1 ? scale : 1) * 0.5 : 0.05;
    }
    return SLT_OK;
}

/* The normal deviate as improbable as t with nu degrees of freedom (Wallace 1959): a standard error from few replicates
 * is itself uncertain. */
static double normal_deviate(double t, double nu) {
    double z = (8 * nu + 1) / (8 * nu + 3) * sqrt(nu * log1p(t * t / nu));
    return t < 0 ? -z : z;
}

static double along(const Check *k, const Row *row, const double *all, bool squared) {
    uint32_t nf = slt_float_count(k->p);
    double sum = 0;
    /* Channels come from the same samples: their errors add. Components are as good as independent. */
    if (squared && !row->dir) {
        for (uint32_t c = 0; c < slt_channels(k->p); c++) sum += k->weight[c] * all[(size_t)c * nf + row->index];
        return sum;
    }
    for (uint32_t i = 0; squared && i < nf; i++) {
        double one = 0;
        for (uint32_t c = 0; c < slt_channels(k->p); c++) one += k->weight[c] * all[(size_t)c * nf + i];
        sum += row->dir[i] * row->dir[i] * one * one;
    }
    for (uint32_t c = 0; !squared && c < slt_channels(k->p); c++) {
        const double *g = all + (size_t)c * nf;
        if (!row->dir) sum += k->weight[c] * g[row->index];
        for (uint32_t i = 0; row->dir && i < nf; i++) sum += k->weight[c] * row->dir[i] * g[i];
    }
    return squared ? sqrt(sum) : sum;
}

#define MATTERS 0.5 /* of the largest row, */
#define MEANS 1e-3  /* or beside what the value would change by if it went as the parameter: a derivative may be 0 */

static double larger_of(const Row *row) { return fmax(fabs(row->ad), fabs(row->fd)); }

/* Does the error leave open what the derivative is? It is larger than both, or the same of the other sign lies within.
 */
static bool says_nothing(const Check *k, const Row *row, double error, double largest) {
    double least = fmax(MATTERS * largest, MEANS * fabs(k->centre[0].v) / row->scale);
    return error > fmin(larger_of(row), 2 * fabs(row->ad)) && error > least;
}

/* z, and whether the row passes. */
static void judge(const Check *k, Row *row, double largest) {
    bool f64 = k->c->opt.f64;
    /* Rounding: the difference of two sums, each good to a few ulp of the precision. */
    double eps = f64 ? 1e-13 : 3e-6, floor = eps * fmax(1, largest) / fmax(row->step, 1e-300) * (f64 ? 1 : 0.02) +
                                             1e-4 * fabs(row->fd) + 1e-6 * largest;
    double ad2 = row->ad_se * row->ad_se, fd2 = row->fd_se * row->fd_se,
           bar = sqrt(ad2 + fd2 + row->truncation * row->truncation + floor * floor),
           spread = row->cells ? 0 : ad2 * ad2 / (AD_REPLICATES - 1) + fd2 * fd2 / (REPLICATES - 1);
    double nu = spread > 0 ? fmin(bar * bar * bar * bar / spread, 1e6) : 1e6; /* Welch and Satterthwaite */
    row->z = bar > 0 ? normal_deviate((row->ad - row->fd) / bar, nu) : row->ad == row->fd ? 0 : INFINITY;
    row->error = row->z != 0 && isfinite(row->z) ? (row->ad - row->fd) / row->z : bar;
    bool close = isfinite(bar) && fabs(row->z) <= k->c->tolerance; /* false for NaN */
    row->says_nothing = close && says_nothing(k, row, row->error, largest);
    row->pass = close && !row->says_nothing;
}

/* The differences of all rows, by the step that is best for each; of those that cells do not tell again by lines. */
static SltStatus take_differences(Check *k, const double *base, Progress *pr, double *largest) {
    SltStatus s = measure_centre(k);
    for (uint32_t i = 0; i < k->n && s == SLT_OK; i++) {
        Row *row = &k->rows[i];
        s = best_difference(k, row, base);
        row->cells = k->cells, *largest = fmax(*largest, larger_of(row));
        progress_update(pr, (double)(i + 1) / k->n, row->name);
    }
    double all = 0;
    for (uint32_t i = 0; i < k->n && s == SLT_OK; i++) {
        Row *row = &k->rows[i];
        double most = fmax(2 * row->ad_se, 0.25 * fabs(row->ad));
        if (row->cells && row->fd_se > most && says_nothing(k, row, 4 * row->fd_se, *largest)) {
            if (!k->lines) k->lines = true, s = measure_centre(k);
            Row again = *row;
            again.step = row->scale * (k->c->opt.f64 ? 2e-3 : 5e-3);
            if (k->c->job.fd_step > 0 || row->dir) again.step = row->step;
            if (s == SLT_OK) s = best_difference(k, &again, base);
            again.cells = false;
            if (s == SLT_OK && difference_error(&again) < difference_error(row)) *row = again;
        }
        all = fmax(all, larger_of(row));
    }
    *largest = all;
    return s;
}

#define UNSURE "rows say nothing: their +- is larger than the derivative; --samples N makes it smaller"

static uint32_t unsure_rows(const Check *k) {
    uint32_t n = 0;
    for (uint32_t i = 0; i < k->n; i++) n += k->rows[i].says_nothing;
    return n;
}

/* What a row that failed shows of L itself; NULL: nothing. */
static const char *why_row(const Row *row, char *text, size_t size) {
    if (row->pass || row->says_nothing) return NULL;
    /* Then AD has the derivative to one side, or their mean. */
    double gap = fabs(row->right - row->left), off = fmin(fabs(row->ad - row->left), fabs(row->ad - row->right));
    off = fmin(off, fabs(row->ad - 0.5 * (row->left + row->right)));
    if (row->bends && off < 4 * row->ad_se + 0.01 * gap) {
        snprintf(
            text, size,
            "the integral bends or jumps where %s is: its derivative is %.5g below and %.5g above. Boundaries coincide there, "
            "one lies on the edge of the domain, or cells decide (`saltus explain coincident`); check beside it, with --param",
            row->name, row->left, row->right);
        return text;
    }
    if (row->ad != 0 || row->ad_se != 0) return NULL;
    snprintf(text, size,
             "the integral changes with %s, and no boundary moves with it: something decides by whole numbers "
             "(cells, hashes, bits) or without the position (W0402); write a smooth weight instead",
             row->name);
    return text;
}

/* What failed, in one line. */
static void print_summary(const Check *k, bool all_pass, const SltPlace *at, const char *other) {
    uint32_t failed = 0, unsure = unsure_rows(k);
    for (uint32_t i = 0; i < k->n; i++) failed += !k->rows[i].pass && !k->rows[i].says_nothing;
    printf("%s", all_pass ? "PASS" : failed || other ? "FAIL" : "NOT CHECKED");
    if (failed) printf(": %u of %u rows:", failed, k->n);
    for (uint32_t i = 0; i < k->n; i++)
        if (!k->rows[i].pass && !k->rows[i].says_nothing) printf(" %s (z %.3g)", k->rows[i].name, k->rows[i].z);
    if (other) {
        fputs(failed ? "; " : ": ", stdout);
        if (at) report_place(stdout, at);
        fputs(other, stdout);
    }
    putchar('\n');
    if (unsure) printf("%u of %u " UNSURE "\n", unsure, k->n);
}

static void print_rows(const Check *k, bool all_pass, const SltPlace *at, const char *other) {
    if (k->c->json) {
        printf("{\"pass\": %s, \"why\": ", all_pass ? "true" : "false");
        if (!other && unsure_rows(k)) other = UNSURE;
        if (other) json_text(stdout, other);
        else fputs("null", stdout);
        fputs(", \"rows\": [", stdout);
        for (uint32_t i = 0; i < k->n; i++) {
            const Row *r = &k->rows[i];
            const struct {
                const char *key;
                double v;
            } list[] = {{"ad", r->ad},           {"ad_stderr", r->ad_se}, {"fd", r->fd},
                        {"fd_stderr", r->fd_se}, {"step", r->step},       {"truncation", r->truncation},
                        {"slope", r->slope},     {"error", r->error},     {"z", r->z}};
            printf("%s{\"param\": ", i ? ", " : "");
            json_text(stdout, r->name);
            for (size_t f = 0; f < sizeof list / sizeof *list; f++) {
                printf(", \"%s\": ", list[f].key);
                json_number(stdout, list[f].v);
            }
            printf(", \"pass\": %s, \"says_nothing\": %s}", r->pass ? "true" : "false",
                   r->says_nothing ? "true" : "false");
        }
        fputs("], ", stdout);
        report_stats_json(stdout, &k->stats);
        fputs(", ", stdout);
        report_warnings_json(stdout, k->p, &k->stats);
        fputs("}\n", stdout);
        return;
    }
    printf("%-34s %14s %14s %10s %9s %9s %6s %7s\n", "parameter", "AD", "FD", "AD - FD", "+-", "step", "slope", "z");
    for (uint32_t i = 0; i < k->n; i++) {
        const Row *r = &k->rows[i];
        printf("%-34s %14.7g %14.7g %10.2g %9.2g %9.2g %6.2f %7.2f  %s\n", r->name, r->ad, r->fd, r->ad - r->fd,
               r->error, r->step, r->slope, r->z,
               r->says_nothing ? "says nothing"
               : r->pass       ? "PASS"
                               : "FAIL");
    }
    print_summary(k, all_pass, at, other);
}

static int check(Check *k) {
    Cli *c = k->c;
    c->job.integral = true;
    int status = cli_prepare_job(c, k->p);
    if (status != SLT_OK) return status;
    uint32_t nf = slt_float_count(k->p), ch = slt_channels(k->p);
    size_t size = (size_t)ch * nf + 1;
    double *g = cli_need(calloc(2 * size, sizeof *g)), *base = cli_need(malloc((nf + 1) * sizeof *base)),
           *total = cli_need(calloc(nf + 1, sizeof *total));
    k->rows = cli_need(calloc(MAX_ROWS, sizeof *k->rows));
    k->moved = cli_need(malloc((nf + 1) * sizeof *k->moved));
    memcpy(base, slt_floats(k->p), nf * sizeof *base);
    memcpy(k->weight, weights, sizeof k->weight);
    SltIntegral out = {.struct_size = sizeof out, .gradient = g, .gradient_stderr = g + size};
    c->job.replicates = AD_REPLICATES;
    Progress pr;
    progress_begin(&pr, c, "check");
    bool without = false;
    SltStatus s = effort_integral(c, k->p, &out, &k->stats, &without, &k->err);
    if (s == SLT_OK && without)
        s = status_fail(&k->err, SLT_LIMIT,
                        "a check without the boundary would check nothing: --samples N, or [NoDisc] where it costs");
    for (uint32_t i = 0; i < nf; i++)
        for (uint32_t q = 0; q < ch; q++) total[i] += k->weight[q] * g[(size_t)q * nf + i];
    if (s == SLT_OK) s = choose_rows(k, total, base);
    for (uint32_t i = 0; i < k->n && s == SLT_OK; i++) {
        Row *row = &k->rows[i];
        row->ad = along(k, row, g, false), row->ad_se = along(k, row, g + size, true);
    }
    double largest = 0;
    if (s == SLT_OK) s = take_differences(k, base, &pr, &largest);
    progress_end(&pr);
    bool all_pass = true, failed = false;
    for (uint32_t i = 0; i < k->n && s == SLT_OK; i++) {
        Row *row = &k->rows[i];
        judge(k, row, largest);
        all_pass &= row->pass, failed |= !row->pass && !row->says_nothing;
    }
    uint64_t dropped = report_lost(&k->stats);
    if (s == SLT_OK) {
        const char *other = NULL;
        char text[1024];
        const SltPlace *at = NULL;
        if (dropped * 100 > k->stats.crossings + dropped)
            at = report_lost_text(&k->stats, text, sizeof text), other = text;
        bool finite = true;
        for (uint32_t i = 0; i < k->n; i++) finite &= isfinite(k->rows[i].ad) && isfinite(k->rows[i].fd);
        if (!finite && k->stats.nonfinite) at = report_nonfinite_text(&k->stats, text, sizeof text), other = text;
        if (k->stats.asserts) at = NULL, other = "an assert failed: `assert` in the shader says where";
        for (uint32_t i = 0; i < k->n; i++)
            if (isinf(k->rows[i].ad_se) && !other) other = "the error of the derivative is not known: more --samples";
        if (other) all_pass = false, failed = true;
        for (uint32_t i = 0; i < k->n && !other; i++) other = why_row(&k->rows[i], text, sizeof text);
        print_rows(k, all_pass, at, other);
        if (!c->quiet) cli_tell(c, k->p);
        report_dropped(c, &k->stats);
    }
    free(g);
    free(base);
    free(total);
    return s != SLT_OK ? cli_fail(c, &k->err) : all_pass ? SLT_OK : failed ? SLT_CHECK_FAILED : SLT_LIMIT;
}

int verb_check(Cli *c) {
    Check k = {.c = c, .stats = SLT_STATS_INIT};
    int status = cli_compile(c, &k.p);
    if (status == SLT_OK) status = check(&k);
    for (uint32_t i = 0; i < k.n; i++) free(k.rows[i].dir);
    free(k.rows);
    free(k.moved);
    slt_program_free(k.p);
    return status;
}
