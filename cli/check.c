/* saltus check: the gradient of the integral against finite differences with common random numbers.
 *
 * For every parameter (the largest components of long ones, and a random direction through the rest) the derivative of
 * L = sum_c w_c I_c with fixed weights w is compared with central differences of L over independent replicates, or, of
 * estimators with cells, whose values have no noise but a stated error, with one difference. A row
 * passes when |AD - FD| <= z sqrt(se_AD^2 + se_FD^2 + truncation^2 + floor^2), with the truncation taken from a second,
 * doubled step, and its order from a third; the step grows where noise is the larger part of these, and shrinks where
 * the truncation is, unless
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

#include "bindings/c/api.h"
#include "bindings/c/warnings.h"
#include "cli/check.h"

enum { MAX_ROWS = 64, LARGEST = 3 };
#define AD_NUMBERS (1 << 24) /* in the sums of all replicates of the gradient, three of them: 400 MB */

static const double weights[4] = {1.0, 0.7, 1.3, 0.4};

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

/* How large a component is for sure: of millions the largest estimates are those with the largest errors. */
static double sure(double g, double error) {
    double least = fabs(g) - 2 * error;
    return least > 0 ? least : 1e-6 * fabs(g);
}

/* The weighted sum of the channels' gradients. */
static void weigh(const Check *k, const double *g, double *total) {
    uint32_t nf = slt_float_count(k->p), ch = slt_channels(k->p);
    for (uint32_t i = 0; i < nf; i++)
        for (uint32_t q = 0; q < ch; q++) total[i] += k->weight[q] * g[(size_t)q * nf + i];
}

/* Which way is up: a derivative that thousands of components cancel from tells nothing beside their noise, so the
 * random direction goes up the slope. Which way that is is asked of other samples than those of the gradient, whose own
 * noise would else choose what is added up; fewer will do. Cells have no noise. */
static SltStatus find_up(Check *k, const double *g) {
    enum { FEWER = 4 };
    uint32_t nf = slt_float_count(k->p);
    k->up = calloc(nf + 1, sizeof *k->up);
    if (!k->up) return status_fail(&k->err, SLT_LIMIT, "out of memory");
    if (k->stats.cells) {
        memcpy(k->up, g, nf * sizeof *g);
        return SLT_OK;
    }
    double *other = calloc((size_t)slt_channels(k->p) * nf + 1, sizeof *other);
    if (!other) return status_fail(&k->err, SLT_LIMIT, "out of memory");
    SltIntegral out = {.struct_size = sizeof out, .gradient = other};
    SltJob j = k->c->job;
    SltStats ignored = SLT_STATS_INIT;
    j.seed += 104729, j.samples = j.samples / FEWER + 1, j.replicates = AD_FEWEST;
    SltStatus s = slt_grad_integral(k->p, &j, &out, &ignored, &k->err);
    if (s == SLT_OK) weigh(k, other, k->up);
    free(other);
    return s;
}

/* Makes the rows: every component of small parameters, the largest of long ones and one random direction through the
 * rest. */
static SltStatus choose_rows(Check *k, const double *g, const double *error, const double *base) {
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
                if (!taken && (best == UINT32_MAX || sure(g[f], error[f]) > sure(g[best], error[best]))) best = f;
            }
            top[ntop] = best;
            report_component_name(k->p, best, name, sizeof name);
            add_row(k, name, best, NULL, base);
        }
        SltStatus s = k->up ? SLT_OK : find_up(k, g);
        if (s != SLT_OK) return s;
        double *dir = calloc(nf + 1, sizeof *dir), scale = 0;
        if (!dir) return status_fail(&k->err, SLT_LIMIT, "out of memory");
        uint32_t state = 12345u + i;
        for (uint32_t f = q->fbase; f < q->fbase + q->fcount; f++) {
            state = state * 1664525u + 1013904223u;
            if (mask[f]) dir[f] = (double)(state >> 8) / 8388608.0 - 1.0;
            if (k->up[f] != 0) dir[f] = copysign(dir[f], k->up[f]);
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
           spread = row->cells ? 0 : ad2 * ad2 / (k->c->job.replicates - 1) + fd2 * fd2 / (REPLICATES - 1);
    double nu = spread > 0 ? fmin(bar * bar * bar * bar / spread, 1e6) : 1e6; /* Welch and Satterthwaite */
    row->z = bar > 0 ? normal_deviate((row->ad - row->fd) / bar, nu) : row->ad == row->fd ? 0 : INFINITY;
    row->error = row->z != 0 && isfinite(row->z) ? (row->ad - row->fd) / row->z : bar;
    bool close = isfinite(bar) && fabs(row->z) <= k->c->tolerance; /* false for NaN */
    row->says_nothing = close && says_nothing(k, row, row->error, largest);
    row->pass = close && !row->says_nothing;
}

/* The differences of all rows, by the step that is best for each; of those that cells do not tell again by lines. */
static SltStatus take_differences(Check *k, const double *base, Progress *pr, double *largest) {
    SltStatus s = check_centre(k);
    for (uint32_t i = 0; i < k->n && s == SLT_OK; i++) {
        Row *row = &k->rows[i];
        s = check_difference(k, row, base);
        row->cells = k->cells, *largest = fmax(*largest, larger_of(row));
        progress_update(pr, (double)(i + 1) / k->n, row->name);
    }
    double all = 0;
    for (uint32_t i = 0; i < k->n && s == SLT_OK; i++) {
        Row *row = &k->rows[i];
        double most = fmax(2 * row->ad_se, 0.25 * fabs(row->ad));
        if (row->cells && row->fd_se > most && says_nothing(k, row, 4 * row->fd_se, *largest)) {
            if (!k->lines) k->lines = true, s = check_centre(k);
            Row again = *row;
            again.step = row->scale * (k->c->opt.f64 ? 2e-3 : 5e-3);
            if (k->c->job.fd_step > 0 || row->dir) again.step = row->step;
            if (s == SLT_OK) s = check_difference(k, &again, base);
            again.cells = false;
            if (s == SLT_OK && check_difference_error(&again) < check_difference_error(row)) *row = again;
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

/* Along a direction the errors of components are not independent: a crossing moves several at once, and up the slope
 * all the same way. So the derivative is asked again, in parts of other samples. Cells have no noise. */
static SltStatus spread_along(Check *k) {
    enum { PARTS = 8 };
    double mean[MAX_ROWS] = {0}, squares[MAX_ROWS] = {0};
    size_t size = (size_t)slt_channels(k->p) * slt_float_count(k->p) + 1;
    bool any = false;
    for (uint32_t i = 0; i < k->n; i++) any |= k->rows[i].dir != NULL;
    if (!any || k->stats.cells) return SLT_OK;
    double *part = calloc(size, sizeof *part);
    SltStatus s = part ? SLT_OK : status_fail(&k->err, SLT_LIMIT, "out of memory");
    SltIntegral out = {.struct_size = sizeof out, .gradient = part};
    SltStats ignored = SLT_STATS_INIT;
    SltJob j = k->c->job;
    j.samples = j.samples / PARTS + 1, j.replicates = j.replicates > PARTS ? j.replicates / PARTS : 1;
    for (uint32_t r = 0; r < PARTS && s == SLT_OK; r++) {
        j.seed += 7919, memset(part, 0, size * sizeof *part);
        s = slt_grad_integral(k->p, &j, &out, &ignored, &k->err);
        for (uint32_t i = 0; i < k->n && s == SLT_OK; i++) {
            double v = along(k, &k->rows[i], part, false), step = v - mean[i];
            mean[i] += step / (r + 1), squares[i] += step * (v - mean[i]);
        }
    }
    for (uint32_t i = 0; i < k->n && s == SLT_OK; i++)
        if (k->rows[i].dir) k->rows[i].ad_se = fmax(k->rows[i].ad_se, sqrt(squares[i] / ((PARTS - 1) * PARTS)));
    free(part);
    return s;
}

static int check(Check *k) {
    Cli *c = k->c;
    c->job.integral = true;
    int status = cli_prepare_job(c, k->p);
    if (status != SLT_OK) return status;
    uint32_t nf = slt_float_count(k->p), ch = slt_channels(k->p);
    size_t size = (size_t)ch * nf + 1;
    double *g = cli_need(calloc(3 * size, sizeof *g)), *base = cli_need(malloc((nf + 1) * sizeof *base)),
           *total = cli_need(calloc(nf + 1, sizeof *total)), *error = cli_need(calloc(nf + 1, sizeof *error));
    k->rows = cli_need(calloc(MAX_ROWS, sizeof *k->rows));
    k->moved = cli_need(malloc((nf + 1) * sizeof *k->moved));
    memcpy(base, slt_floats(k->p), nf * sizeof *base);
    memcpy(k->weight, weights, sizeof k->weight);
    SltIntegral out = {
        .struct_size = sizeof out, .gradient = g, .gradient_stderr = g + size, .missed_estimate = g + 2 * size};
    c->job.replicates = AD_REPLICATES;
    while (c->job.replicates > AD_FEWEST && c->job.replicates * size > AD_NUMBERS) c->job.replicates /= 2;
    Progress pr;
    progress_begin(&pr, c, "check");
    bool without = false;
    SltStatus s = effort_integral(c, k->p, &out, &k->stats, &without, &k->err);
    if (s == SLT_OK && without)
        s = status_fail(&k->err, SLT_LIMIT,
                        "a check without the boundary would check nothing: --samples N, or [NoDisc] where it costs");
    weigh(k, g, total), weigh(k, g + size, error);
    if (s == SLT_OK) s = choose_rows(k, total, error, base);
    for (uint32_t i = 0; i < k->n && s == SLT_OK; i++) {
        Row *row = &k->rows[i];
        row->ad = along(k, row, g, false), row->ad_se = along(k, row, g + size, true);
        /* What lines miss of one component they miss of its neighbours too. */
        if (row->dir) row->ad_se = hypot(row->ad_se, along(k, row, g + 2 * size, false));
    }
    if (s == SLT_OK) s = spread_along(k);
    double largest = 0;
    if (s == SLT_OK) s = take_differences(k, base, &pr, &largest);
    progress_end(&pr);
    bool all_pass = true, failed = false;
    for (uint32_t i = 0; i < k->n && s == SLT_OK; i++) {
        Row *row = &k->rows[i];
        judge(k, row, largest);
        all_pass &= row->pass, failed |= !row->pass && !row->says_nothing;
    }
    uint64_t dropped = api_lost(&k->stats);
    if (s == SLT_OK) {
        const char *other = NULL;
        char text[1024];
        const SltPlace *at = NULL;
        if (dropped * 100 > k->stats.crossings + dropped)
            at = api_lost_text(&k->stats, text, sizeof text), other = text;
        bool finite = true;
        for (uint32_t i = 0; i < k->n; i++) finite &= isfinite(k->rows[i].ad) && isfinite(k->rows[i].fd);
        if (!finite && k->stats.nonfinite) at = api_nonfinite_text(&k->stats, text, sizeof text), other = text;
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
    free(error);
    return s != SLT_OK ? cli_fail(c, &k->err) : all_pass ? SLT_OK : failed ? SLT_CHECK_FAILED : SLT_LIMIT;
}

int verb_check(Cli *c) {
    Check k = {.c = c, .stats = SLT_STATS_INIT};
    int status = cli_compile(c, &k.p);
    if (status == SLT_OK) status = check(&k);
    for (uint32_t i = 0; i < k.n; i++) free(k.rows[i].dir);
    free(k.rows);
    free(k.moved);
    free(k.up);
    slt_program_free(k.p);
    return status;
}
