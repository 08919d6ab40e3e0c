/* Sums over tiles of what two rules give. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/quadrature/sums.h"
#include "runtime/sample/alloc.h"

#define FEW 1.5 /* t(n) is nearly 1 + FEW / n normal deviates, at two of them */

bool sums_init(Sums *m, const SltScene *s, uint32_t rows) {
    memset(m, 0, sizeof *m);
    m->rows = rows, m->nfloats = s->nfloats;
    size_t n = (size_t)rows * s->nfloats;
    /* A lane adds up some hundred terms of a tile in the program's precision. */
    m->rounding = 8 * (s->f64 ? DBL_EPSILON : (double)FLT_EPSILON);
    m->boundary = alloc_zero(n, sizeof(double)), m->interior = alloc_zero(n, sizeof(double));
    m->error = alloc_zero(n, sizeof(double)), m->variance = alloc_zero(n, sizeof(double));
    m->size = alloc_zero(n, sizeof(double));
    if (s->dim == 3) m->fourth = alloc_zero(n, sizeof(double));
    return m->boundary && m->interior && m->error && m->variance && m->size && (m->fourth || s->dim < 3);
}

void sums_free(Sums *m) {
    free(m->boundary), free(m->interior), free(m->error), free(m->variance), free(m->size), free(m->fourth);
    memset(m, 0, sizeof *m);
}

void sums_clear(Sums *m) {
    if (!m->begun) { /* they are 0 yet, in pages that none has touched */
        m->begun = true;
        return;
    }
    size_t bytes = (size_t)m->rows * m->nfloats * sizeof(double);
    memset(m->boundary, 0, bytes), memset(m->interior, 0, bytes);
    memset(m->error, 0, bytes), memset(m->variance, 0, bytes), memset(m->size, 0, bytes);
    if (m->fourth) memset(m->fourth, 0, bytes);
}

/* Two estimates become one, with its error. Of rules their distance is the error of the lower one: how much better the
 * higher one is, a tile cannot tell, in whose distance a few pieces that bend count among many that do not. */
static double join(const Sums *m, double fine, double coarse, SumMode mode, double terms, double *error,
                   double *variance) {
    if (mode == SUM_ONE) return fine;
    if (mode == SUM_RULES) {
        *error += fabs(fine - coarse) + (m->rounding * terms + m->roots) * fabs(fine);
        return fine;
    }
    double e = 0.5 * (fine - coarse);
    *variance += e * e;
    return 0.5 * (fine + coarse);
}

void sums_merge(Sums *m, Accum *a, SumMode mode, double lines) {
    const SumMode boundary = mode == SUM_LINE ? SUM_ONE : mode == SUM_CURVES ? SUM_RULES : mode;
    const SumMode interior = mode == SUM_LINE || mode == SUM_CURVES ? SUM_SETS : mode;
    const Folded *f = &a->folded;
    const uint32_t rows = m->rows;
    for (uint32_t i = 0; i < f->n; i++) {
        const double *v = f->sum + (size_t)i * a->n;
        for (uint32_t row = 0; row < rows; row++, v++) {
            size_t at = (size_t)row * m->nfloats + f->parameter[i];
            double both = v[SUM_INTERIOR_BOTH * rows], share = v[SUM_SIZE * rows] / lines;
            double before = m->variance[at];
            if (share != 0) m->variance[at] += share * share; /* else its page stays untouched */
            m->size[at] += fabs(v[SUM_BOUNDARY_FINE * rows]) + fabs(v[SUM_INTERIOR_FINE * rows] + both);
            m->error[at] += m->curves * fabs(v[SUM_BOUNDARY_FINE * rows]);
            m->boundary[at] += join(m, v[SUM_BOUNDARY_FINE * rows], v[SUM_BOUNDARY_COARSE * rows], boundary, lines,
                                    &m->error[at], &m->variance[at]);
            m->interior[at] += join(m, v[SUM_INTERIOR_FINE * rows] + both, v[SUM_INTERIOR_COARSE * rows] + both,
                                    interior, lines, &m->error[at], &m->variance[at]);
            double term = m->variance[at] - before;
            if (m->fourth && term > 0) m->fourth[at] += term * term;
        }
    }
    accum_unfold(a);
}

void sums_few(Sums *m) {
    for (size_t i = 0; m->fourth && i < (size_t)m->rows * m->nfloats; i++) {
        if (!(m->fourth[i] > 0)) continue;
        double grows = 1 + FEW * m->fourth[i] / (m->variance[i] * m->variance[i]);
        m->variance[i] *= grows * grows;
    }
}

void sums_unnamed(Sums *m, const uint8_t *active, double left, double unit) {
    for (size_t row = 0; row < m->rows; row++) {
        double sum = 0, met = 0, largest = 0, usual;
        size_t first = row * m->nfloats;
        for (size_t at = first; at < first + m->nfloats; at++) {
            if (active && !active[at - first]) continue;
            if (m->variance[at] > 0) sum += sqrt(m->variance[at]), met++;
            largest = fmax(largest, fabs(m->boundary[at] + m->interior[at]));
        }
        usual = met > 0 ? sum / met : left * largest;
        if (!(usual > 0)) usual = left * unit;
        for (size_t at = first; at < first + m->nfloats; at++)
            if (!active || active[at - first]) m->variance[at] = fmax(m->variance[at], usual * usual);
    }
}

void sums_upset(Sums *m, const uint8_t *active, const double jump[SLT_MAX_CHANNELS]) {
    double all = 0; /* an image's gradient has one row for all channels */
    for (uint32_t c = 0; c < SLT_MAX_CHANNELS; c++) all += jump[c];
    if (all == 0) return;
    for (size_t row = 0; row < m->rows; row++) {
        double half = (m->rows == 1 ? all : jump[row]) / SUM_SURE;
        for (size_t p = 0; p < m->nfloats; p++)
            if (!active || active[p]) m->variance[row * m->nfloats + p] += half * half;
    }
}

void sums_gone(Sums *m, const uint8_t *active, const double jump[SLT_MAX_CHANNELS]) {
    size_t n = (size_t)m->rows * m->nfloats;
    bool any = false, some = false;
    for (uint32_t c = 0; c < SLT_MAX_CHANNELS; c++) any |= jump[c] > 0;
    for (size_t i = 0; i < n && any && !some; i++) some = m->boundary[i] != 0;
    if (some) sums_upset(m, active, jump);
    for (size_t i = 0; i < n && any && !some; i++)
        if (!active || active[i % m->nfloats]) m->variance[i] = INFINITY;
}

#define SLOWLY 64 /* times the distance of two rules, at most, is what they leave at a small power */

double sums_rims(Sums *m, const uint8_t *active, const double rims[SLT_MAX_CHANNELS]) {
    double all = 0, added = 0, largest = 0;
    for (uint32_t c = 0; c < SLT_MAX_CHANNELS; c++) all += rims[c];
    for (size_t row = 0; row < m->rows && all > 0; row++) {
        double most = m->rows == 1 ? all : rims[row];
        for (size_t i = row * m->nfloats, end = i + m->nfloats; i < end; i++)
            if (!active || active[i % m->nfloats]) {
                double more = fmin(most, SLOWLY * m->error[i]);
                m->error[i] += more;
                added = fmax(added, more), largest = fmax(largest, fabs(m->boundary[i] + m->interior[i]));
            }
    }
    return added > 0 ? added / largest : 0;
}

void sums_sampled(Sums *m, const uint8_t *active, double share) {
    if (!(share > 0)) return;
    for (size_t row = 0; row < m->rows; row++) {
        size_t first = row * m->nfloats;
        double all = 0;
        for (size_t p = 0; p < m->nfloats; p++)
            if (!active || active[p]) all += fabs(m->interior[first + p]);
        for (size_t p = 0; p < m->nfloats; p++)
            if (!active || active[p]) m->variance[first + p] += 0.25 * share * share * all * all;
    }
}
