/* The adjoints of a tile, parameter by parameter. Entries of a log are many times as many as parameters that the tile
 * touches, and these few of all: summed up here, in the worker, what is left to `merge` is little, and so is the
 * memory. Each sum has its terms in the order of the calls. */
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/accum.h"
#include "runtime/sample/alloc.h"

bool accum_folds(Accum *a) { return (a->folded.slot = alloc_zero(a->s->nfloats, sizeof *a->folded.slot)) != NULL; }

static bool grow(Folded *f, uint32_t buffers) {
    uint32_t cap = 2 * f->cap + 256;
    double *sum = realloc(f->sum, (size_t)cap * buffers * sizeof *sum);
    if (sum) f->sum = sum;
    uint32_t *parameter = realloc(f->parameter, cap * sizeof *parameter);
    if (parameter) f->parameter = parameter;
    if (!sum || !parameter) return false;
    f->cap = cap;
    return true;
}

/* The sums of a parameter; NULL when memory runs out. */
static double *sums_of(Accum *a, uint32_t p) {
    Folded *f = &a->folded;
    uint32_t slot = f->slot[p];
    if (!slot) {
        if (f->n == f->cap && !grow(f, a->n)) return NULL;
        memset(f->sum + (size_t)f->n * a->n, 0, a->n * sizeof *f->sum);
        f->parameter[f->n] = p, f->slot[p] = slot = ++f->n;
    }
    return f->sum + (size_t)(slot - 1) * a->n;
}

bool accum_fold_log(Accum *a, uint32_t which) {
    AdjointBuffer *b = &a->buf[which];
    const uint32_t rows = a->n, nfloats = a->s->nfloats, *index = b->log_index;
    const bool f64 = a->s->f64;
    const void *value = b->log_value;
    double none = 0, *sum = &none, all = 0; /* those of the entry before: samples of one event lie together */
    uint32_t last = UINT32_MAX;
    for (uint64_t e = 0, n = b->log_len; e < n; e++) {
        double v = f64 ? ((const double *)value)[e] : (double)((const float *)value)[e];
        if (v == 0) continue; /* of a colour all channels but one are */
        if (index[e] != last) {
            uint32_t p = last = index[e], row = which;
            *sum = all;
            for (; p >= nfloats && row < rows; row++) p -= nfloats;
            if (row < rows && !(sum = sums_of(a, p))) return false;
            sum = row < rows ? sum + row : &none, all = *sum;
        }
        all += v;
    }
    *sum = all;
    b->log_len = 0;
    return true;
}

bool accum_fold(Accum *a, uint32_t which, uint32_t first, const double *sums, uint32_t n) {
    for (uint32_t k = 0; k < n; k++) {
        double *sum = sums[k] != 0 ? sums_of(a, first + k) : NULL;
        if (sum) sum[which] += sums[k];
        else if (sums[k] != 0) return false;
    }
    return true;
}

void accum_unfold(Accum *a) {
    for (uint32_t i = 0; i < a->folded.n; i++) a->folded.slot[a->folded.parameter[i]] = 0;
    a->folded.n = 0;
}
