/* Tiles that err independently: parts.h. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/bars.h"
#include "runtime/sample/parts.h"

bool parts_init(Parts *p, uint32_t n, uint32_t nfloats) {
    *p = (Parts){.n = n, .nfloats = nfloats, .sum = alloc_zero((n + 2) * (uint64_t)nfloats, sizeof *p->sum)};
    p->variance = p->sum ? p->sum + (uint64_t)n * nfloats : NULL;
    p->square = p->sum ? p->variance + nfloats : NULL;
    return p->sum != NULL;
}

void parts_free(Parts *p) { free(p->sum); }

void parts_merge(Parts *p, Accum *a, double *const *targets) {
    double *to[ACCUMS];
    for (uint32_t c = 0; c < a->n; c++) to[c] = c < p->n ? p->sum + (uint64_t)c * p->nfloats : targets[c];
    accum_merge(a, to);
    for (uint32_t i = 0; i < p->nfloats; i++) {
        double mean = 0, v = 0;
        for (uint32_t c = 0; c < p->n; c++) mean += to[c][i] / p->n, targets[c][i] += to[c][i];
        for (uint32_t c = 0; c < p->n; c++) v += (to[c][i] - mean) * (to[c][i] - mean), to[c][i] = 0;
        v *= p->n / (p->n - 1.0);
        p->variance[i] += v, p->square[i] += v * v;
    }
}

/* Degrees of freedom by Satterthwaite 1946: n - 1 of one tile, as many of each where all weigh alike. */
double parts_variance(const Parts *p, uint32_t i) {
    double v = p->variance[i];
    if (!(v > 0) || !isfinite(v)) return v;
    double freedom = (p->n - 1) * v * (v / p->square[i]), factor = bars_factor((uint32_t)fmin(freedom + 1.5, 1e9));
    return v * factor * factor;
}
