/* Means and bars. */
#include <float.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "runtime/sample/bars.h"
#include "runtime/sample/sketch.h"

/* After Wallace 1959. */
double bars_factor(uint32_t n) {
    double nu = n - 1.0, z = 2 * (8 * nu + 3) / (8 * nu + 1);
    return 0.5 * sqrt(nu * expm1(z * z / nu));
}

enum { PART = 64 }; /* components at a time, which go side by side through vectors */

/* v[i] / n; by a power of two, as the number of replicates mostly is, a product has the same bits, and takes a third of
 * the time. */
static void divide(double v[PART], uint32_t n) {
    const double part = 1.0 / n;
    if (n & (n - 1))
        for (uint32_t i = 0; i < PART; i++) v[i] /= n;
    else
        for (uint32_t i = 0; i < PART; i++) v[i] *= part;
}

/* The means of components from .. from + count - 1 of n rows, and the squares of their standard errors, where they are
 * wanted. */
static void means_of(const double *rows, const double *other, uint32_t n, uint64_t size, uint64_t from, uint32_t count,
                     double mean[PART], double *variance) {
    double v[PART] = {0};
    for (uint32_t i = 0; i < PART; i++) mean[i] = 0;
    for (uint32_t k = 0; k < n; k++) {
        const double *a = rows + k * size + from, *b = other ? other + k * size + from : NULL;
        if (b)
            for (uint32_t i = 0; i < count; i++) mean[i] += a[i] + b[i];
        else
            for (uint32_t i = 0; i < count; i++) mean[i] += a[i];
    }
    divide(mean, n);
    if (!variance) return;
    for (uint32_t k = 0; k < n; k++) {
        const double *a = rows + k * size + from, *b = other ? other + k * size + from : NULL;
        if (b)
            for (uint32_t i = 0; i < count; i++) v[i] += (a[i] + b[i] - mean[i]) * (a[i] + b[i] - mean[i]);
        else
            for (uint32_t i = 0; i < count; i++) v[i] += (a[i] - mean[i]) * (a[i] - mean[i]);
    }
    for (uint32_t i = 0; i < PART; i++) variance[i] = v[i] / (n - 1);
    divide(variance, n);
    for (uint32_t i = 0; i < count; i++)
        variance[i] = n < 2 ? 0 : isnan(v[i]) ? HUGE_VAL : variance[i]; /* of values that are not finite */
}

static uint32_t part_of(uint64_t size, uint64_t from) { return size - from < PART ? (uint32_t)(size - from) : PART; }

void bars_of_rows(const double *rows, const double *other, uint32_t n, uint64_t size, double *mean, double *error) {
    double factor = n > 1 ? bars_factor(n) : 0, m[PART], v[PART];
    if (!mean && !error) return;
    for (uint64_t from = 0; from < size; from += PART) {
        const uint32_t count = part_of(size, from);
        means_of(rows, other, n, size, from, count, m, error ? v : NULL);
        if (mean) memcpy(mean + from, m, count * sizeof *m);
        for (uint32_t i = 0; i < count && error; i++) error[from + i] = factor * sqrt(v[i]);
    }
}

/* Replicates are parts of one family of lines, and their spread says more of the distance between lines of one
 * replicate than of the family: too much where edges bend or lines are spread over a cross-section, and nothing where
 * each has met an edge equally often. What differences of lines say is exact for edges that end; a part of the spread
 * is for noise from line to line. */
void bars_add_boundary(const Replicates *k, double part, double *error) {
    double m[PART], v[PART], of_lines[PART];
    for (uint64_t from = 0; from < k->size; from += PART) {
        const uint32_t count = part_of(k->size, from);
        means_of(k->boundary, NULL, k->n, k->size, from, count, m, v);
        sketch_variances(k->sketch + from, k->size, k->n, count, of_lines);
        for (uint32_t i = 0; i < count; i++) {
            double *e = &error[from + i];
            *e = sqrt(*e * *e + part * v[i] + of_lines[i]);
        }
    }
}

/* What is missed is a part of the error, and none that the replicates differ by: of lines without gaps what is narrower
 * than their last halving, about as much as that one found; of others see thin.h. It is known as well as replicates
 * agree on it. */
void bars_add_missed(const Replicates *k, double *mean, double *error) {
    double m[PART], v[PART];
    for (uint64_t from = 0; from < k->size; from += PART) {
        const uint32_t count = part_of(k->size, from);
        means_of(k->missed, NULL, k->n, k->size, from, count, m, v);
        if (mean) memcpy(mean + from, m, count * sizeof *m);
        for (uint32_t i = 0; i < count; i++) error[from + i] += fabs(m[i]), error[from + i] += sqrt(v[i]);
    }
}

/* fmin, which is a call. */
static double least(double a, double b) { return a < b || isnan(b) ? a : b; }

void bars_add_denormals(const double *gradient, uint32_t nfloats, double crossings, double weight, double *error) {
    for (uint32_t p = 0; p < nfloats; p++) {
        double typical = gradient[p] != 0 ? least(fabs(gradient[p]) / crossings, weight) : weight;
        if (typical < (double)FLT_MIN) error[p] += 0x1p-150 * crossings;
    }
}

void bars_add_counts(const double *boundary, uint64_t size, double crossings, uint32_t replicates, double *error) {
    for (uint64_t i = 0; i < size && crossings > 0; i++)
        error[i] = hypot(error[i], 0.5 * fabs(boundary[i]) * sqrt(replicates) / crossings);
}
