/* Tiles that err independently: parts.h. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/bars.h"
#include "runtime/sample/derived.h"
#include "runtime/sample/parts.h"

bool parts_init(Parts *p, const SltScene *s, bool whole) {
    const uint32_t nfloats = s->nfloats;
    *p = (Parts){.s = s,
                 .nfloats = nfloats,
                 .whole = whole,
                 .sum = alloc_zero((PARTS_SUMS + 2) * (uint64_t)nfloats, sizeof *p->sum)};
    p->variance = p->sum ? p->sum + (uint64_t)PARTS_SUMS * nfloats : NULL;
    p->square = p->sum ? p->variance + nfloats : NULL;
    return p->sum != NULL;
}

void parts_free(Parts *p) { free(p->sum); }

static void add(Parts *p, uint32_t i, double v, double freedom) {
    p->variance[i] += v, p->square[i] += v * v / freedom;
}

/* Of the sum of n parts of one tile. */
static double spread_of(double *const *part, uint32_t n, uint32_t i) {
    double mean = 0, v = 0;
    for (uint32_t c = 0; c < n; c++) mean += part[c][i] / n;
    for (uint32_t c = 0; c < n; c++) v += (part[c][i] - mean) * (part[c][i] - mean);
    return v * n / (n - 1);
}

static uint32_t count(const PartsOf *of) { return of->pairs ? 2 * of->pairs : of->spread; }

/* Where the sums of buffers go, of which the first n may be others'. */
static void find_targets(const Parts *p, const PartsOf *of, double *const *targets, uint32_t n, double **to) {
    uint32_t parts = count(of);
    for (uint32_t c = 0; c < n; c++) to[c] = targets[c];
    for (uint32_t c = 0; c < parts; c++) to[c] = p->sum + (uint64_t)c * p->nfloats;
    for (uint32_t c = 0; c < PARTS_NOISE && of->noise; c++)
        to[of->noise + c] = p->sum + (uint64_t)(parts + c) * p->nfloats;
}

/* Parameters of which a tile mostly touches few. */
enum { TOGETHER = 8 };

static bool any(double *const *part, uint32_t n, uint32_t from, uint32_t to) {
    uint64_t one = 0;
    for (uint32_t c = 0; c < n; c++)
        for (uint32_t i = from; i < to; i++) {
            uint64_t bits;
            memcpy(&bits, &part[c][i], sizeof bits);
            one |= bits;
        }
    return one;
}

static void settle(Parts *p, const PartsOf *of, double *const *targets, double *const *to, uint32_t i) {
    double pairs = 0, noise = 0;
    for (uint32_t c = 0; c < of->pairs; c++) pairs += pow(to[2 * c][i] - to[2 * c + 1][i], 2);
    if (of->pairs) add(p, i, pairs, of->pairs);
    if (of->spread > 1) add(p, i, spread_of(to, of->spread, i), of->spread - 1);
    for (uint32_t c = 0; c < count(of); c++) targets[c][i] += to[c][i], to[c][i] = 0;
    for (uint32_t c = of->noise; of->noise && c < of->noise + PARTS_NOISE; c++)
        noise += to[c][i] * to[c][i], to[c][i] = 0;
    if (of->noise) add(p, i, noise, PARTS_NOISE);
}

bool parts_settle(Parts *p, const PartsOf *of, double *const *targets) {
    double *to[ACCUMS];
    const uint32_t n = count(of), noises = of->noise ? PARTS_NOISE : 0;
    find_targets(p, of, targets, 0, to);
    for (uint32_t c = 0; c < (p->whole ? n : 0); c++)
        if (!derived_pull(p->s, to[c])) return false;
    for (uint32_t c = 0; c < (p->whole ? noises : 0); c++)
        if (!derived_pull(p->s, to[of->noise + c])) return false;
    for (uint32_t from = 0, end; from < p->nfloats; from = end) {
        end = p->nfloats - from < TOGETHER ? p->nfloats : from + TOGETHER;
        if (!any(to, n, from, end) && !any(to + of->noise, noises, from, end)) continue;
        for (uint32_t i = from; i < end; i++) settle(p, of, targets, to, i);
    }
    return true;
}

void parts_merge(Parts *p, Accum *a, const PartsOf *of, double *const *targets) {
    double *to[ACCUMS];
    find_targets(p, of, targets, a->n, to);
    accum_merge(a, to);
    if (!p->whole) parts_settle(p, of, targets);
}

/* Degrees of freedom by Satterthwaite 1946: those of one tile, as many of each where all weigh alike. */
double parts_variance(const Parts *p, uint32_t i) {
    double v = p->variance[i];
    if (!(v > 0) || !isfinite(v)) return v;
    double factor = bars_factor((uint32_t)fmin(v * (v / p->square[i]) + 1.5, 1e9));
    return v * factor * factor;
}
