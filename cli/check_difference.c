/* The finite differences of `check`: by common random numbers, or of values that cells give. */
#include <string.h>
#include <time.h>

#include "bindings/c/api.h"
#include "cli/check.h"

enum {
    FEWEST = 4096,
    MORE = 32 /* samples, at most, where a row is doubted */
};
#define BUDGET_ASKED 12.0 /* the same where --samples was given */
#define DOUBT 4.0 /* and for a row that is doubted */
#define BUDGET 3.0 /* seconds of processor time for the values, if each row needs one pair of steps and every other two */

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
SltStatus check_centre(Check *k) {
    k->samples = k->c->job.samples;
    Value v;
    SltStatus s = value_of(k, NULL, k->c->job.seed, &v); /* compiles, too */
    clock_t start = clock();
    if (s == SLT_OK) s = value_of(k, NULL, seed_of(k, 0), &k->centre[0]);
    int n = k->cells ? 1 : REPLICATES;
    double each = (double)(clock() - start) / CLOCKS_PER_SEC, planned = each * k->n * n * 4 * 1.5;
    double budget = k->c->samples_given ? BUDGET_ASKED : BUDGET;
    while (!k->cells && planned > budget && k->samples / 2 >= FEWEST) k->samples /= 2, planned /= 2;
    k->each = planned / (1.5 * 4 * n * k->n);
    for (int r = 0; r < n && s == SLT_OK; r++) s = value_of(k, NULL, seed_of(k, r), &k->centre[r]);
    return s;
}

/* The difference that spans `step` to both sides. */
static SltStatus wide_difference(Check *k, const Row *row, const double *base, double step, double *out) {
    double all[REPLICATES], ignored, taken = real_step(k, row, base, step);
    int n = k->cells ? 1 : REPLICATES;
    for (int r = 0; r < n; r++) {
        Value up, down;
        SltStatus s = moved_value(k, row, base, step, seed_of(k, r), &up);
        if (s == SLT_OK) s = moved_value(k, row, base, -step, seed_of(k, r), &down);
        if (s != SLT_OK) return s;
        all[r] = (up.v - down.v) / (2 * taken);
    }
    *out = mean_of(all, n, &ignored);
    return SLT_OK;
}

/* Doubling the step of a smooth L makes the error of its difference fourfold, so a third of what that changes is the
 * error. Where features of all sizes come and go, as of a threshold in a noisy grid, it may grow as the step, and all
 * of the change is the error: where there is more change than noise, a third step tells. */
static SltStatus measure_truncation(Check *k, Row *row, const double *base, double twice) {
    double change = fabs(twice - row->fd), four;
    row->truncation = change / 3;
    if (!(change > row->fd_se) || change <= 1e-3 * fabs(row->ad)) return SLT_OK;
    SltStatus s = wide_difference(k, row, base, 4 * row->step, &four);
    if (s == SLT_OK) row->truncation = change / fmin(fmax(fabs(four - twice) / change - 1, 1), 3);
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
    row->slope = log2(fabs(remainder[1]) / fabs(remainder[0]));
    /* Of a smooth L the sides are half as far apart by half the step. */
    double near = mean_of(bend[0], n, &noise), far = mean_of(bend[1], n, &ignored);
    row->left = mean_of(left, n, &ignored), row->right = mean_of(right, n, &ignored);
    row->bends = fabs(near) > 4 * (noise + stated) + 0.02 * fabs(row->fd) && fabs(far) < 1.5 * fabs(near);
    return measure_truncation(k, row, base, mean_of(two, n, &ignored));
}

/* Before a row fails, a quarter of the step is asked, by more samples. What L does between one and two steps says
 * little of its error where something happens within the first, as where cells of a mosaic meet other neighbours: there
 * the difference may grow, turn, and be at two steps where it was at one. */
static SltStatus doubt(Check *k, Row *row, const double *base) {
    if (!(fabs(row->ad - row->fd) > k->c->tolerance * hypot(row->ad_se, check_difference_error(row)))) return SLT_OK;
    Row near = *row;
    near.step *= 0.25;
    if (real_step(k, &near, base, near.step) == 0) return SLT_OK;
    uint64_t samples = k->samples;
    Value centre[REPLICATES];
    memcpy(centre, k->centre, sizeof centre);
    int n = k->cells ? 1 : REPLICATES;
    SltStatus s = SLT_OK;
    for (double used = 6 * n * k->each; !k->cells && k->samples < MORE * samples && 2 * used < DOUBT; used *= 2)
        k->samples *= 2;
    for (int r = 0; r < n && s == SLT_OK && k->samples != samples; r++)
        s = value_of(k, NULL, seed_of(k, r), &k->centre[r]);
    if (s == SLT_OK) s = difference(k, &near, base);
    k->samples = samples, memcpy(k->centre, centre, sizeof centre);
    if (s != SLT_OK) return s;
    double change = fabs(row->fd - near.fd);
    if (change > 3 * hypot(near.fd_se, row->fd_se)) row->truncation = fmax(row->truncation, change);
    if (!(k->c->job.fd_step > 0) && check_difference_error(&near) < check_difference_error(row)) *row = near;
    return SLT_OK;
}

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
        if (check_difference_error(row) <= fmax(0.5 * row->ad_se, 1e-3 * fabs(row->ad))) break;
        if (!(noise > 4 * bend) && !(bend > 4 * noise)) break;
        Row other = *row;
        other.step *= bend > noise ? 0.25 : 4;
        s = difference(k, &other, base);
        if (s != SLT_OK || !(check_difference_error(&other) < check_difference_error(row))) break;
        *row = other;
    }
    return s;
}

SltStatus check_difference(Check *k, Row *row, const double *base) {
    SltStatus s = best_difference(k, row, base);
    return s == SLT_OK ? doubt(k, row, base) : s;
}
