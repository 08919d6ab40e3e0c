/* Derived arrays: derived.h. */
#include "runtime/sample/derived.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/accum.h"
#include "runtime/sample/alloc.h"

enum { CALLS = 64 /* between emptying the log: its size stays that of a cache */ };

/* The kernels of one array with the parameters of a scene. */
typedef struct Elements {
    SltScene scene;
    Batch batch;
    uint32_t base, n;
} Elements;

static bool elements_begin(Elements *e, const SltScene *s, uint32_t d, const void *params) {
    const SltDerived *of = &s->derived[d];
    e->scene = of->scene, e->base = of->base, e->n = of->n;
    e->scene.params = params, e->scene.iparams = s->iparams;
    return batch_init(&e->batch, &e->scene, NULL);
}

/* Elements from `first` on; how many. */
static uint32_t put_elements(Elements *e, uint32_t first) {
    uint32_t n = e->n - first < BATCH ? e->n - first : BATCH;
    for (uint32_t i = 0; i < n; i++) batch_set_int(&e->batch, SLT_IN_K0, i, (int32_t)(first + i));
    return n;
}

static void put(bool f64, void *v, uint32_t at, double x) {
    if (f64) ((double *)v)[at] = x;
    else ((float *)v)[at] = (float)x;
}

bool derived_value(const SltScene *s, uint32_t d, void *params) {
    Elements e;
    bool ok = elements_begin(&e, s, d, params);
    for (uint32_t first = 0; ok && first < e.n; first += BATCH) {
        uint32_t n = put_elements(&e, first);
        batch_call(&e.batch, SLT_K_VALUE, n);
        for (uint32_t i = 0; i < n; i++)
            for (uint32_t c = 0; c < DERIVED_EACH; c++)
                put(s->f64, params, e.base + DERIVED_EACH * (first + i) + c, batch_get(&e.batch, SLT_OUT_F, c, i));
    }
    batch_free(&e.batch);
    return ok;
}

bool derived_values(const SltScene *s, void *params) {
    bool ok = true;
    for (uint32_t d = 0; d < s->nderived && ok; d++) ok = derived_value(s, d, params);
    return ok;
}

bool derived_push(const SltScene *s, double *direction) {
    if (!s->nderived) return true;
    void *flt = aligned_alloc(64, ((size_t)s->nfloats * sizeof(double) + 127) / 64 * 64);
    bool ok = flt != NULL;
    memset(direction + scene_params(s), 0, s->nplaced * sizeof *direction);
    for (uint32_t p = 0; ok && p < s->nfloats; p++) put(s->f64, flt, p, direction[p]);
    for (uint32_t d = 0; d < s->nderived && ok; d++) {
        if (!s->derived[d].scene.kernel[SLT_K_JVP]) continue;
        Elements e;
        ok = elements_begin(&e, s, d, s->params);
        e.batch.args.dparams = flt;
        for (uint32_t first = 0; ok && first < e.n; first += BATCH) {
            uint32_t n = put_elements(&e, first);
            batch_call(&e.batch, SLT_K_JVP, n);
            for (uint32_t i = 0; i < n; i++)
                for (uint32_t c = 0; c < DERIVED_EACH; c++) {
                    uint32_t at = e.base + DERIVED_EACH * (first + i) + c;
                    direction[at] = batch_get(&e.batch, SLT_OUT_DF, c, i);
                    put(s->f64, flt, at, direction[at]);
                }
        }
        batch_free(&e.batch);
    }
    free(flt);
    return ok;
}

static bool all_zero(const double *v, size_t n) {
    for (size_t i = 0; i < n; i++)
        if (v[i] != 0) return false;
    return true;
}

static bool pull_array(const SltScene *s, uint32_t d, double *derivative) {
    Elements e;
    Accum sums = {0};
    uint32_t calls = 0;
    bool ok = elements_begin(&e, s, d, s->params) && accum_init(&sums, &e.scene, 1);
    for (uint32_t first = 0; ok && first < e.n; first += BATCH) {
        uint32_t n = put_elements(&e, first);
        const double *of = derivative + e.base + (size_t)DERIVED_EACH * first;
        if (all_zero(of, (size_t)DERIVED_EACH * n)) continue;
        for (uint32_t i = 0; i < n; i++)
            for (uint32_t c = 0; c < DERIVED_EACH; c++)
                batch_set(&e.batch, SLT_IN_SEED0 + c, i, of[(size_t)DERIVED_EACH * i + c]);
        accum_call(&sums, &e.batch, SLT_K_VJP, n, 0);
        if (++calls % CALLS == 0) accum_close(&sums), accum_merge(&sums, &derivative);
    }
    if (ok) accum_close(&sums), accum_merge(&sums, &derivative);
    ok &= !sums.failed;
    accum_free(&sums), batch_free(&e.batch);
    memset(derivative + s->derived[d].base, 0, (size_t)DERIVED_EACH * s->derived[d].n * sizeof *derivative);
    return ok;
}

bool derived_pull(const SltScene *s, double *derivative) {
    bool ok = true;
    for (uint32_t d = s->nderived; derivative && d-- > 0 && ok;)
        if (s->derived[d].scene.kernel[SLT_K_VJP]) ok = pull_array(s, d, derivative);
    return ok;
}

static void add_size(double *to, double slope, double error) {
    if (slope != 0) *to += fabs(slope) * error; /* which may be infinite */
}

/* What the error of one number of one element is in the numbers that it is computed from. */
static void add_sizes(Accum *a, double error, double *to) {
    AdjointBuffer *b = &a->buf[0];
    for (uint32_t t = 0; t < b->ntouched; t++)
        for (uint32_t p = b->touched[t]; p < b->touched[t] + ACCUM_BLOCK && p < a->s->nfloats; p++)
            add_size(&to[p], b->sum[p], error);
    for (uint64_t k = 0; k < b->log_len; k++)
        add_size(&to[b->log_index[k]],
                 a->s->f64 ? ((const double *)b->log_value)[k] : (double)((const float *)b->log_value)[k], error);
    b->ntouched = 0, b->log_len = 0;
}

static bool pull_error(const SltScene *s, uint32_t d, double *error) {
    Elements e;
    Accum sums = {0};
    bool ok = elements_begin(&e, s, d, s->params) && accum_init(&sums, &e.scene, 1);
    for (uint32_t i = 0; ok && i < e.n; i++)
        for (uint32_t c = 0; ok && c < DERIVED_EACH; c++) {
            double of = error[e.base + (size_t)DERIVED_EACH * i + c];
            if (of == 0) continue;
            batch_set_int(&e.batch, SLT_IN_K0, 0, (int32_t)i);
            for (uint32_t k = 0; k < DERIVED_EACH; k++) batch_set(&e.batch, SLT_IN_SEED0 + k, 0, k == c);
            accum_call(&sums, &e.batch, SLT_K_VJP, 1, 0);
            accum_close(&sums);
            add_sizes(&sums, of, error);
        }
    ok &= !sums.failed;
    accum_free(&sums), batch_free(&e.batch);
    memset(error + s->derived[d].base, 0, (size_t)DERIVED_EACH * s->derived[d].n * sizeof *error);
    return ok;
}

bool derived_pull_error(const SltScene *s, double *error) {
    bool ok = true;
    for (uint32_t d = s->nderived; error && d-- > 0 && ok;)
        if (s->derived[d].scene.kernel[SLT_K_VJP]) ok = pull_error(s, d, error);
    return ok;
}
