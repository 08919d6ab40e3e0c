/* Means and bars. */
#include <float.h>
#include <math.h>
#include <stddef.h>

#include "runtime/sample/bars.h"
#include "runtime/sample/sketch.h"

/* After Wallace 1959. */
double bars_factor(uint32_t n) {
    double nu = n - 1.0, z = 2 * (8 * nu + 3) / (8 * nu + 1);
    return 0.5 * sqrt(nu * expm1(z * z / nu));
}

/* The mean of component i of n rows, and the square of its standard error. */
static double mean_of(const double *rows, const double *other, uint32_t n, uint64_t size, uint64_t i,
                      double *variance) {
    double sum = 0, v = 0;
    for (uint32_t k = 0; k < n; k++) sum += rows[k * size + i] + (other ? other[k * size + i] : 0);
    sum /= n;
    for (uint32_t k = 0; k < n; k++) {
        double e = rows[k * size + i] + (other ? other[k * size + i] : 0) - sum;
        v += e * e;
    }
    *variance = n < 2 ? 0 : isnan(v) ? HUGE_VAL : v / (n - 1) / n; /* of values that are not finite */
    return sum;
}

void bars_of_rows(const double *rows, const double *other, uint32_t n, uint64_t size, double *mean, double *error) {
    double factor = n > 1 ? bars_factor(n) : 0, v;
    if (!mean && !error) return;
    for (uint64_t i = 0; i < size; i++) {
        double m = mean_of(rows, other, n, size, i, &v);
        if (mean) mean[i] = m;
        if (error) error[i] = factor * sqrt(v);
    }
}

/* Replicates are parts of one family of lines, and their spread says more of the distance between lines of one
 * replicate than of the family: too much where edges bend or lines are spread over a cross-section, and nothing where
 * each has met an edge equally often. What differences of lines say is exact for edges that end; a part of the spread
 * is for noise from line to line. */
void bars_add_boundary(const Replicates *k, double part, double *error) {
    double sketch[SKETCHES], v;
    for (uint64_t i = 0; i < k->size; i++) {
        mean_of(k->boundary, NULL, k->n, k->size, i, &v);
        for (uint32_t q = 0; q < SKETCHES; q++) sketch[q] = k->sketch[q * k->size + i] / k->n;
        error[i] = sqrt(error[i] * error[i] + part * v + sketch_variance(sketch));
    }
}

/* What is missed is a part of the error, and none that the replicates differ by: of lines without gaps what is narrower
 * than their last halving, about as much as that one found; of others see thin.h. It is known as well as replicates
 * agree on it. */
void bars_add_missed(const Replicates *k, double *error) {
    double v;
    for (uint64_t i = 0; i < k->size; i++) {
        error[i] += fabs(mean_of(k->missed, NULL, k->n, k->size, i, &v));
        error[i] += sqrt(v);
    }
}

void bars_add_denormals(const double *gradient, uint32_t nfloats, double crossings, double weight, double *error) {
    for (uint32_t p = 0; p < nfloats; p++) {
        double typical = gradient[p] != 0 ? fmin(fabs(gradient[p]) / crossings, weight) : weight;
        if (typical < (double)FLT_MIN) error[p] += 0x1p-150 * crossings;
    }
}

void bars_add_counts(const double *boundary, uint64_t size, double crossings, uint32_t replicates, double *error) {
    for (uint64_t i = 0; i < size && crossings > 0; i++)
        error[i] = hypot(error[i], 0.5 * fabs(boundary[i]) * sqrt(replicates) / crossings);
}
