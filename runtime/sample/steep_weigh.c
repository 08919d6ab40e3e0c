/* What steep changes weigh in derivatives.
 *
 * Of a ramp everything is in its slope: along a line its part of the integral of df/dtheta is that of its middle times
 * change / slope. Summed over the lines, with the squared normals as a partition of one, that is compared with what the
 * estimate found, less the mean of df/dtheta over the points of the lines that are not beside one. Of a jump only
 * the size is known: it counts as if it moved by 1 with every parameter that moves it. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/derived.h"
#include "runtime/sample/steep_inner.h"

enum { PARTS = 2 /* of the lines, whose distance is the error of what they say */, FEW = 32 };
#define UNSEEN 0.35     /* part of what ramps weigh by which the estimate may be off */
#define NARROW 0x1p-6   /* in image mode: of a pixel; ramps are that narrow where samples do not show them */
#define SURE 2.0        /* distances of the two parts */

typedef enum Group { RAMPS, SMOOTH, GROUPS } Group;
typedef struct Weights {
    SteepProbe *p;
    Accum acc;
    uint64_t size;              /* channels * nfloats */
    double *sum[GROUPS][PARTS]; /* [size]: of derivatives, as the lines have them */
} Weights;

/* The measure of the domain that a line of the axis stands for. */
static double section(const SteepProbe *p, uint32_t axis) {
    double m = 1;
    for (uint32_t d = 0; d < p->s->dim; d++)
        if (d != axis) m *= p->s->hi[d] - p->s->lo[d];
    return m / p->lines;
}

/* The points in the batch, with these weights, to one part of a group. */
static void add(Weights *w, Group g, uint32_t n, const double *weight, const uint32_t *line) {
    double of_part[BATCH];
    for (uint32_t part = 0; part < PARTS; part++) {
        for (uint32_t i = 0; i < n; i++) of_part[i] = line[i] % PARTS == part ? weight[i] : 0;
        accum_rows(&w->acc, &w->p->batch, of_part, n, (g * PARTS + part) * w->p->s->channels);
    }
}

/* f at the middle of each ramp and a little to both sides along every axis: its slope, and the square of its normal. */
static void slopes(SteepProbe *p, uint32_t n, double *slope, double *normal) {
    const uint32_t dim = p->s->dim;
    memset(normal, 0, n * sizeof *normal);
    for (uint32_t d = 0; d < dim; d++) {
        double *across = normal + (size_t)(d + 1) * n;
        for (uint32_t i = 0; i < n; i++) {
            const SteepStep *t = &p->step[i];
            double h = (t->b - t->a) / 8, x[3];
            for (int side = 0; side < 2; side++) {
                memcpy(x, t->x, sizeof x);
                x[t->axis] = 0.5 * (t->a + t->b), x[d] += side ? h : -h;
                x[d] = steep_round(p, fmin(fmax(x[d], p->s->lo[d]), p->s->hi[d]));
                across[i] = side ? x[d] - across[i] : x[d];
                batch_set_x(&p->batch, 2 * i + (uint32_t)side, x);
                batch_set_stream(&p->batch, 2 * i + (uint32_t)side, t->stream, 0.5);
            }
        }
        steep_evaluate(p, 2 * n);
        for (uint32_t i = 0; i < n; i++) {
            const SteepStep *t = &p->step[i];
            double apart = steep_f(p, t->channel, 2 * i + 1) - steep_f(p, t->channel, 2 * i);
            across[i] = across[i] > 0 ? apart / across[i] : 0;
            normal[i] += across[i] * across[i];
        }
    }
    for (uint32_t i = 0; i < n; i++) {
        slope[i] = normal[(size_t)(p->step[i].axis + 1) * n + i];
        normal[i] = normal[i] > 0 ? slope[i] * slope[i] / normal[i] : 0;
    }
}

static void add_ramps(Weights *w) {
    SteepProbe *p = w->p;
    double slope[STEEP_STEPS], normal[4 * STEEP_STEPS], weight[STEEP_STEPS], share = (double)p->found / p->n;
    uint32_t line[STEEP_STEPS];
    slopes(p, p->n, slope, normal);
    for (uint32_t i = 0; i < p->n; i++) {
        const SteepStep *t = &p->step[i];
        double width = t->first / fabs(slope[i]);
        bool known = !t->jump && slope[i] != 0 && isfinite(width);
        weight[i] = known ? share * section(p, t->axis) * normal[i] * width : 0;
        line[i] = (uint32_t)t->stream;
        steep_put(p, i, t, 0.5 * (t->a + t->b));
    }
    add(w, RAMPS, p->n, weight, line);
}

static bool beside_ramp(const SteepProbe *p, uint32_t axis, uint32_t line, uint32_t i) {
    for (uint32_t k = 0; k < p->n; k++) {
        const SteepStep *t = &p->step[k];
        if (t->axis == axis && (uint32_t)t->stream == line && (i == t->point || i == t->point + 1)) return true;
    }
    return false;
}

static void add_smooth(Weights *w) {
    SteepProbe *p = w->p;
    uint32_t n = 0, line[BATCH];
    double weight[BATCH];
    for (uint32_t d = 0; d < p->s->dim; d++)
        for (uint32_t k = 0; k < p->lines; k++)
            for (uint32_t i = 0; i < p->points; i++) {
                double x[3];
                steep_place(p, d, k, i, x);
                batch_set_x(&p->batch, n, x);
                batch_set_stream(&p->batch, n, (int32_t)k, 0.5);
                line[n] = p->lines > 1 ? k : i;
                double measure = section(p, d) * (p->s->hi[d] - p->s->lo[d]) / (p->points * p->s->dim);
                weight[n++] = beside_ramp(p, d, k, i) ? 0 : measure;
                if (n == BATCH) add(w, SMOOTH, n, weight, line), n = 0;
            }
    add(w, SMOOTH, n, weight, line);
}

static bool weights_init(Weights *w, SteepProbe *p) {
    *w = (Weights){.p = p, .size = (uint64_t)p->s->channels * p->s->nfloats};
    bool ok = accum_init(&w->acc, p->s, GROUPS * PARTS * p->s->channels);
    for (int g = 0; g < GROUPS; g++)
        for (int k = 0; k < PARTS; k++) ok &= (w->sum[g][k] = alloc_zero(w->size, sizeof(double))) != NULL;
    return ok;
}

static void weights_free(Weights *w) {
    accum_free(&w->acc);
    for (int g = 0; g < GROUPS; g++)
        for (int k = 0; k < PARTS; k++) free(w->sum[g][k]);
}

static void collect(Weights *w) {
    double *targets[ACCUMS];
    uint32_t channels = w->p->s->channels;
    for (uint32_t i = 0; i < GROUPS * PARTS * channels; i++)
        targets[i] = w->sum[i / channels / PARTS][i / channels % PARTS] + (uint64_t)(i % channels) * w->p->s->nfloats;
    accum_close(&w->acc);
    accum_merge(&w->acc, targets);
}

/* How far the estimate of one component is from what ramps say, beyond what they may be wrong by; 0: it agrees. */
static double distance(const Weights *w, uint64_t at, double interior) {
    const double *r0 = w->sum[RAMPS][0], *r1 = w->sum[RAMPS][1], *s0 = w->sum[SMOOTH][0], *s1 = w->sum[SMOOTH][1];
    double ramps = r0[at] + r1[at], smooth = s0[at] + s1[at];
    double doubt = UNSEEN * fabs(ramps) + SURE * (fabs(r0[at] - r1[at]) + fabs(s0[at] - s1[at]));
    double far = fabs(ramps + smooth - interior);
    return far > doubt ? far : 0; /* nothing is known where one is not a number */
}

/* Ramps that the estimate has not seen, and by how much the components are off. Stated so wide that it may have seen
 * them or not: that is no news for the error, but for whoever reads it. */
static bool weigh_ramps(SteepProbe *p, const SltIntegral *out, const double *interior, double *off, bool *unseen) {
    Weights w;
    bool memory = weights_init(&w, p);
    bool wide = false;
    *unseen = false;
    if (memory) {
        add_ramps(&w), add_smooth(&w);
        collect(&w);
        for (uint64_t at = 0; at < w.size; at++) {
            if (p->s->active && !p->s->active[at % p->s->nfloats]) continue;
            double d = distance(&w, at, interior[at]), stated = out->gradient_stderr ? out->gradient_stderr[at] : 0;
            *unseen |= d > 2 * stated, off[at] += d;
            wide |= stated > UNSEEN * fabs(w.sum[RAMPS][0][at] + w.sum[RAMPS][1][at]) &&
                    stated > UNSEEN * fabs(interior[at]);
        }
    }
    if (!*unseen) memset(off, 0, w.size * sizeof *off);
    *unseen |= wide;
    memory &= !w.acc.failed;
    weights_free(&w);
    return memory;
}

/* Points all over the place of a peak and four times as far, by parity. Returns its part of the integral of f. */
static double add_peak(Weights *w, const SteepPeak *k) {
    SteepProbe *p = w->p;
    uint32_t across = p->s->dim == 1 ? BATCH : p->s->dim == 2 ? 32 : 10, n = 1, line[BATCH] = {0};
    double weight[BATCH] = {0};
    for (uint32_t d = 0; d < p->s->dim; d++) n *= across;
    for (uint32_t i = 0; i < n; i++) {
        double x[3] = {0};
        weight[i] = 1, line[i] = 0;
        for (uint32_t d = 0, at = i; d < p->s->dim; d++, at /= across) {
            double wide = 2 * (k->hi[d] - k->lo[d]), middle = 0.5 * (k->lo[d] + k->hi[d]);
            double lo = fmax(middle - wide, p->s->lo[d]), hi = fmin(middle + wide, p->s->hi[d]);
            x[d] = steep_round(p, lo + (at % across + 0.5) / across * (hi - lo));
            weight[i] *= (hi - lo) / across, line[i] += at % across;
        }
        batch_set_x(&p->batch, i, x);
        batch_set_stream(&p->batch, i, 0, 0.5);
    }
    add(w, RAMPS, n, weight, line);
    double sum = 0; /* the reverse kernel gives f as well */
    for (uint32_t i = 0; i < n; i++) sum += weight[i] * steep_f(p, k->channel, i);
    return sum;
}

bool steep_weigh_peak(SteepProbe *p, const SteepPeak *peak, SltIntegral *out, bool *seen) {
    Weights w;
    *seen = true;
    if (!p->s->kernel[SLT_K_VJP] || !(out->interior || out->gradient)) return true;
    bool memory = weights_init(&w, p);
    double value = 0;
    if (memory) {
        value = add_peak(&w, peak), add_smooth(&w);
        collect(&w);
    }
    for (uint64_t at = 0; memory && at < w.size; at++) {
        if (p->s->active && !p->s->active[at % p->s->nfloats]) continue;
        double d = distance(&w, at, out->interior ? out->interior[at] : out->gradient[at]);
        if (!(d > (out->gradient_stderr ? 2 * out->gradient_stderr[at] : 0))) continue;
        *seen = false, out->mixed = true;
        if (out->gradient_stderr) out->gradient_stderr[at] += d;
        if (out->left_bound) out->left_bound[at] = NAN;
    }
    if (!*seen && out->value_stderr) out->value_stderr[peak->channel] += fabs(value);
    memory &= !w.acc.failed;
    weights_free(&w);
    return memory;
}

/* All that jumps, weighed as if it moved by 1, to the components whose parameters move it. */
static bool weigh_jumps(SteepProbe *p, double *off) {
    const SltScene *s = p->s;
    uint32_t active = 0;
    for (uint32_t q = 0; q < scene_params(s); q++) active += !s->active || s->active[q];
    for (uint32_t q = 0; q < scene_params(s); q++) {
        bool hit[STEEP_STEPS] = {false}, memory = true;
        if (s->active && !s->active[q]) continue;
        for (int side = 0; side < 2 && active <= FEW && memory; side++) {
            Moved m;
            memory = scene_move(&m, s, NULL, q, side ? -steep_move_of(s, q) : steep_move_of(s, q));
            if (memory) steep_moved(p, &m.scene, 0, p->n, hit);
            moved_free(&m);
        }
        if (!memory) return false;
        for (uint32_t i = 0; i < p->n; i++) {
            const SteepStep *t = &p->step[i];
            if (!t->jump || (active <= FEW && !hit[i])) continue;
            off[(uint64_t)t->channel * s->nfloats + q] +=
                section(p, t->axis) * fabs(t->fb - t->fa) * ((double)p->found / p->n);
        }
    }
    return true;
}

/* In an image nothing is known of the sum. */
static void narrow_alone(SteepProbe *p, const Grid *g) {
    for (uint32_t i = 0; i < p->n; i++) {
        SteepStep *t = &p->step[i];
        t->seen = !t->jump && t->b - t->a > NARROW * g->side[t->axis];
    }
}

bool steep_weigh(SteepProbe *p, Run *r, SltIntegral *out) {
    if (!out) {
        narrow_alone(p, &r->grid);
        return true;
    }
    uint64_t n = (uint64_t)p->s->channels * p->s->nfloats;
    double *off = alloc_zero(n, sizeof *off), *interior = alloc_zero(n, sizeof *interior);
    bool memory = off && interior, unseen = false, ramps = false;
    for (uint64_t at = 0; memory && at < n; at++)
        interior[at] = out->interior ? out->interior[at] : out->gradient ? out->gradient[at] : 0;
    for (uint32_t i = 0; i < p->n; i++) ramps |= !p->step[i].jump;
    if (memory && ramps && !r->j->no_interior && p->s->kernel[SLT_K_VJP])
        memory = weigh_ramps(p, out, interior, off, &unseen);
    for (uint32_t i = 0; i < p->n; i++) p->step[i].seen = !p->step[i].jump && !unseen;
    if (memory) memory = weigh_jumps(p, off);
    for (uint64_t at = 0; memory && at < n; at++) {
        if (!(off[at] > 0)) continue;
        if (out->gradient_stderr) out->gradient_stderr[at] += off[at];
        if (out->left_bound) out->left_bound[at] = NAN;
        out->mixed = true;
    }
    free(off), free(interior);
    return memory;
}
