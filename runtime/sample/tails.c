/* The sums of groups, and the tail that they have. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/tails.h"

enum {
    COMPONENTS = 256, /* most that are looked at */
    GROUPS = 512,     /* sums at a time, */
    KEPT = 128,       /* of which the largest stay */
    FEW = 8,          /* of the largest tell the power, as do twice and more times as many, */
    DEEP = 64         /* up to these */
};
#define INFINITE_VARIANCE 0.5 /* the power of the distance, in the measure of what lies nearer: from here on, */
#define UNSURE 0.25           /* (told by one, it may be as much higher) */
#define STEEPEST 0.9          /* and no further: 1 has no integral */

bool tails_wanted(const Tails *t) { return t && t->components; }

bool tails_init(Tails *t, const SltScene *s) {
    uint32_t active = 0;
    *t = (Tails){.channels = s->channels, .width = s->adj_lanes};
    for (uint32_t p = 0; p < s->nfloats; p++) active += !s->active || s->active[p];
    uint64_t all = (uint64_t)active * s->channels;
    if (!all || all > COMPONENTS || !s->kernel[SLT_K_VJP]) return true;
    t->parameter = alloc_zero(active, sizeof *t->parameter), t->of = alloc_zero(all, sizeof *t->of);
    t->sum = malloc(all * GROUPS * sizeof *t->sum);
    if (!t->parameter || !t->of || !t->sum) return false;
    for (uint32_t p = 0; p < s->nfloats; p++)
        if (!s->active || s->active[p]) t->parameter[t->components++] = p;
    return true;
}

void tails_free(Tails *t) { free(t->parameter), free(t->of), free(t->sum); }
void tails_free_tile(TailTile *tile) { free(tile->before), free(tile->sum); }

bool tails_begin(const Tails *t, TailTile *tile, uint32_t calls) {
    uint64_t size = (uint64_t)t->channels * t->components, groups = (uint64_t)calls * t->width;
    tile->n = 0;
    if (tile->cap < groups) {
        free(tile->before), free(tile->sum);
        tile->before = malloc(size * t->width * sizeof *tile->before);
        tile->sum = malloc(size * groups * sizeof *tile->sum);
        tile->cap = tile->before && tile->sum ? (uint32_t)groups : 0;
        if (!tile->cap) return false;
    }
    memset(tile->before, 0, size * t->width * sizeof *tile->before);
    return true;
}

/* A lane has the sum of its samples of a tile so far: what a call has added to it is a group. */
void tails_take(const Tails *t, TailTile *tile, const Accum *a) {
    uint64_t size = (uint64_t)t->channels * t->components, at = 0;
    if (tile->n + t->width > tile->cap) return;
    for (uint32_t c = 0; c < t->channels; c++)
        for (uint32_t i = 0; i < t->components; i++, at++) {
            const unsigned char *row = a->buf[c].adj + a->stride * t->parameter[i];
            for (uint32_t l = 0; l < t->width; l++) {
                double v = a->s->f64 ? ((const double *)row)[l] : (double)((const float *)row)[l];
                double *before = &tile->before[at * t->width + l];
                tile->sum[(tile->n + l) * size + at] = (float)(v - *before);
                *before = v;
            }
        }
    tile->n += t->width;
}

/* Orders v so that none before v[k] is larger than it and none behind it is smaller (Hoare 1961, Wirth's form). */
static void part_at(double *v, int32_t n, int32_t k) {
    for (int32_t lo = 0, hi = n - 1; lo < hi;) {
        double pivot = v[k];
        int32_t i = lo, j = hi;
        while (i <= j) {
            while (v[i] < pivot) i++;
            while (pivot < v[j]) j--;
            if (i > j) break;
            double t = v[i];
            v[i++] = v[j], v[j--] = t;
        }
        if (j < k) lo = i;
        if (k < i) hi = j;
    }
}

/* Of the first groups the median is what the others are compared with; from then on the largest are kept. */
static void keep_largest(TailSums *t, double *v) {
    if (!t->known) {
        part_at(v, (int32_t)t->n, (int32_t)t->n / 2);
        t->middle = v[t->n / 2], t->known = true;
        for (uint32_t k = 0; k < t->n; k++) v[k] = fabs(v[k] - t->middle);
    }
    if (t->n < KEPT) return;
    part_at(v, (int32_t)t->n, (int32_t)t->n - KEPT);
    memmove(v, v + t->n - KEPT, KEPT * sizeof *v);
    t->n = KEPT, t->least = v[0];
    for (uint32_t k = 1; k < KEPT; k++) t->least = fmin(t->least, v[k]);
}

void tails_merge(Tails *t, TailTile *tile) {
    uint64_t size = (uint64_t)t->channels * t->components;
    for (uint64_t i = 0; i < size; i++) {
        TailSums *of = &t->of[i];
        double *kept = t->sum + i * GROUPS;
        for (uint32_t g = 0; g < tile->n; g++) {
            double v = (double)tile->sum[g * size + i];
            if (isnan(v)) v = HUGE_VAL;
            if (of->known) v = fabs(v - of->middle);
            if (of->known && !(v > of->least)) continue;
            if (of->n == GROUPS) keep_largest(of, kept);
            kept[of->n++] = v;
        }
    }
    t->seen += tile->n, tile->n = 0;
}

static int ascending(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* By which power of 1 / rank the k largest of n ascending sizes grow (Hill 1975); 0: they are too few. */
static double power_of(const double *v, uint32_t n, uint32_t k) {
    double sum = 0, least = k < n ? v[n - 1 - k] : 0;
    if (!(least > 0) || !isfinite(v[n - 1])) return 0;
    for (uint32_t i = n - k; i < n; i++) sum += log(v[i] / least);
    return sum / k;
}

/* What lies further out than the largest of u samples has a measure of 1 / u, and a mean of 1 / (1 - power) times that
 * one. Here u is `times` as many as those of which v[n] are the largest, ascending. */
static double further(const double *v, uint32_t n, uint32_t k, double times, double power) {
    return v[n - 1 - k] * pow(k * times, power) / (1 - power);
}

/* The part of a sum that is nearer than all samples, or was met by chance. Other contributions may hide all but the
 * very largest. Sums that vary over decades for another reason, as where few samples meet anything, grow by less the
 * fewer are looked at. */
static double beyond(const double *v, uint32_t n, double times, double *most) {
    double more = 0;
    for (uint32_t k = FEW; k <= DEEP; k *= 2) {
        double power = power_of(v, n, k);
        if (!(power > INFINITE_VARIANCE - UNSURE / sqrt(k))) break;
        power = fmin(power, STEEPEST), *most = fmax(*most, power);
        more = fmax(more, further(v, n, k, times, power));
    }
    return more;
}

/* One channel may hide what another shows: the largest power is that of all. Of a derivative without a tail it is that
 * of a few samples. */
double tails_add(Tails *t, double samples, uint32_t replicates, uint32_t nfloats, const double *gradient,
                 double *error) {
    double most = 0, largest = 0, power = 0, times = samples * t->width / ((double)t->seen * TAIL_CALL);
    for (uint32_t i = 0; i < t->channels * t->components; i++) {
        double *v = t->sum + (uint64_t)i * GROUPS;
        keep_largest(&t->of[i], v);
        if (t->of[i].n < KEPT) return 0;
        qsort(v, t->of[i].n, sizeof *v, ascending);
        t->of[i].beyond = beyond(v, t->of[i].n, times, &power);
    }
    for (uint32_t i = 0; i < t->channels * t->components && power > 0; i++) {
        const double *v = t->sum + (uint64_t)i * GROUPS;
        uint64_t at = (uint64_t)(i / t->components) * nfloats + t->parameter[i % t->components];
        double more = fmax(t->of[i].beyond, further(v, t->of[i].n, FEW, times, power)) / replicates;
        error[at] = hypot(error[at], more);
        most = fmax(most, more), largest = fmax(largest, fabs(gradient[at]));
    }
    return most > 0 ? most / largest : 0;
}
