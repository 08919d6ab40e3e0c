/* Central differences with common random numbers, two renders a parameter: the tests compare with them, and `bench` has
 * them as its baseline. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/base/rng.h"
#include "runtime/geometry/geometry.h"
#include "runtime/sample/alloc.h"
#include "runtime/sample/bars.h"
#include "runtime/sample/derived.h"
#include "runtime/sample/difference.h"
#include "runtime/sample/interior.h"

/* The step h for a parameter of this value. Where f jumps the error of a difference grows as 1 / sqrt(h), where it is
 * smooth as h^2: a hundredth is a compromise that both survive. */
static double step_of(const SltJob *j, double value) {
    return j->fd_step > 0 ? j->fd_step : 0.01 * fmax(0.1, fabs(value));
}

static double param_get(const SltScene *s, uint32_t p) {
    return s->f64 ? ((const double *)s->params)[p] : (double)((const float *)s->params)[p];
}

/* The step that is taken, as both moved values are rounded to the program's precision; 0: none. */
static double taken_step(const SltScene *s, uint32_t p, double h) {
    double x = param_get(s, p), up = x + h, down = x - h;
    return s->f64 ? (up - down) / 2 : ((double)(float)up - (double)(float)down) / 2;
}

static SltStatus no_step(const SltScene *s, uint32_t p, double h, SltError *err) {
    return status_fail(err, SLT_USAGE,
                       "a step of %g vanishes beside the parameter's %.9g in %s precision: take a larger one", h,
                       param_get(s, p), s->f64 ? "double" : "single");
}

void moved_free(Moved *m) { free(m->params), free(m->geometry), free(m->geometries); }

static bool move_geometries(Moved *m, const SltScene *s) {
    size_t size = s->f64 ? sizeof(double) : sizeof(float);
    m->geometry = alloc_zero(s->ngeometries, sizeof *m->geometry);
    m->geometries = alloc_zero(s->ngeometries, sizeof *m->geometries);
    if (!m->geometry || !m->geometries) return false;
    for (uint32_t i = 0; i < s->ngeometries; i++) {
        if (!s->geometries[i]) continue;
        size_t at = s->geometry_base[i] * size;
        m->geometry[i] =
            geometry_moved(s->geometries[i], (const char *)s->params + at, (const char *)m->scene.params + at);
        m->geometries[i] = &m->geometry[i];
    }
    m->scene.geometries = m->geometries;
    return true;
}

bool scene_move(Moved *m, const SltScene *s, const double *dir, uint32_t axis, double h) {
    size_t size = s->f64 ? sizeof(double) : sizeof(float);
    memset(m, 0, sizeof *m);
    m->scene = *s;
    void *v = m->params = aligned_alloc(64, (s->nfloats * size + 128) / 64 * 64);
    if (!v) return false;
    memcpy(v, s->params, s->nfloats * size);
    for (uint32_t p = dir ? 0 : axis; p < (dir ? scene_params(s) : axis + 1); p++) {
        double x = param_get(s, p) + h * (dir ? dir[p] : 1);
        if (s->f64) ((double *)v)[p] = x;
        else ((float *)v)[p] = (float)x;
    }
    m->scene.params = v;
    if (!derived_values(&m->scene, v)) return false;
    return !s->ngeometries || !s->geometries || move_geometries(m, s);
}

/* (image at +h - image at -h) / 2h into out, an image; `scratch` is another. */
static SltStatus image_difference(const SltScene *s, const SltJob *j, const double *dir, uint32_t axis, double h,
                                  float *out, float *scratch, SltStats *stats, SltError *err) {
    SltStatus st = SLT_OK;
    uint64_t n = s->channels;
    for (uint32_t p = 0; p < scene_params(s) && dir;
         p++) /* the component that goes farthest stands for the direction */
        if (!p || fabs(dir[p]) > fabs(dir[axis])) axis = p;
    double taken = dir && dir[axis] != 0 ? taken_step(s, axis, h * dir[axis]) / dir[axis] : taken_step(s, axis, h);
    if (taken == 0) return no_step(s, axis, h, err);
    for (uint32_t d = 0; d < s->dim; d++) n *= j->size[d];
    for (int side = 0; side < 2 && st == SLT_OK; side++) {
        Moved m;
        st = scene_move(&m, s, dir, axis, side ? -h : h)
                 ? slt_estimate_render(&m.scene, j, 0, side ? scratch : out, stats, err)
                 : status_fail(err, SLT_LIMIT, "out of memory");
        moved_free(&m);
    }
    for (uint64_t i = 0; i < n && st == SLT_OK; i++)
        out[i] = (float)(((double)out[i] - (double)scratch[i]) / (2 * taken));
    return st;
}

static uint64_t image_size(const SltScene *s, const SltJob *j) {
    uint64_t n = s->channels;
    for (uint32_t d = 0; d < s->dim; d++) n *= j->size[d];
    return n;
}

SltStatus difference_forward(const SltScene *s, const SltJob *j, uint32_t ndir, const double *const *dirs,
                             float *const *out, SltStats *stats, SltError *err) {
    float *scratch = malloc(image_size(s, j) * sizeof *scratch + 1);
    SltStatus st = scratch ? SLT_OK : status_fail(err, SLT_LIMIT, "out of memory");
    for (uint32_t d = 0; d < ndir && st == SLT_OK; d++) {
        double size = 0, value = 0;
        for (uint32_t p = 0; p < scene_params(s); p++)
            if (dirs[d][p] != 0) size = fmax(size, fabs(dirs[d][p])), value = fmax(value, fabs(param_get(s, p)));
        if (size > 0) st = image_difference(s, j, dirs[d], 0, step_of(j, value) / size, out[d], scratch, stats, err);
        else memset(out[d], 0, image_size(s, j) * sizeof *out[d]);
    }
    free(scratch);
    return st;
}

SltStatus difference_reverse(const SltScene *s, const SltJob *j, const float *const adjoint[2], double *gradient,
                             double *stderr_bound, SltStats *stats, SltError *err) {
    uint64_t n = image_size(s, j);
    float *image = malloc(n * sizeof *image + 1), *scratch = malloc(n * sizeof *scratch + 1);
    SltStatus st = image && scratch ? SLT_OK : status_fail(err, SLT_LIMIT, "out of memory");
    memset(gradient, 0, s->nfloats * sizeof *gradient);
    if (stderr_bound) memset(stderr_bound, 0, s->nfloats * sizeof *stderr_bound);
    for (uint32_t p = 0; p < scene_params(s) && st == SLT_OK; p++) {
        if (s->active && !s->active[p]) continue;
        st = image_difference(s, j, NULL, p, step_of(j, param_get(s, p)), image, scratch, stats, err);
        double part[COSETS] = {0}, sum = 0, v = 0;
        for (uint64_t i = 0; i < n && st == SLT_OK; i++)
            part[i / s->channels % COSETS] += 0.5 * ((double)adjoint[0][i] + (double)adjoint[1][i]) * (double)image[i];
        for (int c = 0; c < COSETS; c++) sum += part[c];
        for (int c = 0; c < COSETS; c++) v += (part[c] - sum / COSETS) * (part[c] - sum / COSETS);
        gradient[p] = sum;
        if (stderr_bound) stderr_bound[p] = sqrt(v * COSETS / (COSETS - 1));
    }
    free(image), free(scratch);
    return st;
}

/* The integrals of all n replicates at moved parameters: value[n][channels]. */
static SltStatus integrals(const SltScene *s, const SltJob *j, uint32_t n, double *value, SltStats *stats,
                           SltError *err) {
    Run r;
    SltStatus st = run_begin(&r, s, j, err);
    memset(value, 0, (size_t)n * s->channels * sizeof *value);
    if (st == SLT_OK) st = interior_integral(&r, n, (j->samples + n - 1) / n, value, NULL, NULL);
    run_end(&r, stats);
    return st;
}

static void spread(const double *v, uint32_t n, uint32_t channels, uint32_t c, double *mean, double *error) {
    double sum = 0, var = 0;
    for (uint32_t i = 0; i < n; i++) sum += v[i * channels + c];
    sum /= n;
    for (uint32_t i = 0; i < n; i++) var += (v[i * channels + c] - sum) * (v[i * channels + c] - sum);
    *mean = sum, *error = n < 2 ? 0 : isnan(var) ? HUGE_VAL : bars_factor(n) * sqrt(var / (n - 1) / n);
}

/* Differences by a step of h in parameter p, of all replicates: up[n][channels]; `down` is room for as many. */
static SltStatus integral_differences(const SltScene *s, const SltJob *j, uint32_t p, double h, uint32_t n, double *up,
                                      double *down, SltStats *stats, SltError *err) {
    SltStatus st = SLT_OK;
    double taken = taken_step(s, p, h);
    if (taken == 0) return no_step(s, p, h, err);
    for (int side = 0; side < 2 && st == SLT_OK; side++) {
        Moved m;
        st = scene_move(&m, s, NULL, p, side ? -h : h) ? integrals(&m.scene, j, n, side ? down : up, stats, err)
                                                       : status_fail(err, SLT_LIMIT, "out of memory");
        moved_free(&m);
    }
    for (uint32_t i = 0; i < n * s->channels; i++) up[i] = (up[i] - down[i]) / (2 * taken);
    return st;
}

/* By how much f differs in its domain, at a few places: jumps of it are about as large. */
static SltStatus find_range(const SltScene *s, const SltJob *j, double range[SLT_MAX_CHANNELS], SltStats *stats,
                            SltError *err) {
    enum { PLACES = 64 };
    double x[PLACES * 3], f[PLACES * SLT_MAX_CHANNELS];
    for (uint32_t i = 0; i < PLACES * s->dim; i++) {
        uint32_t d = i % s->dim, word[4];
        rng_block(j->seed, RNG_POINT, 1, i, word);
        x[i] = s->lo[d] + rng_unit(word[0]) * (s->hi[d] - s->lo[d]);
    }
    SltStatus st = slt_estimate_points(s, j, PLACES, x, NULL, f, stats, err);
    for (uint32_t c = 0; c < s->channels && st == SLT_OK; c++) {
        double lo = HUGE_VAL, hi = -HUGE_VAL;
        for (uint32_t i = 0; i < PLACES; i++)
            if (isfinite(f[i * s->channels + c]))
                lo = fmin(lo, f[i * s->channels + c]), hi = fmax(hi, f[i * s->channels + c]);
        range[c] = hi > lo ? hi - lo : 0;
    }
    return st;
}

/* No sample of any replicate has changed. */
static bool is_zero(const double *v, uint32_t n, uint32_t channels, uint32_t c) {
    bool zero = true;
    for (uint32_t i = 0; i < n; i++) zero &= v[i * channels + c] == 0;
    return zero;
}

SltStatus difference_integral(const SltScene *s, const SltJob *j, SltIntegral *out, SltStats *stats, SltError *err) {
    uint32_t n = j->replicates ? j->replicates : 4, channels = s->channels;
    bool few = n > 1 && (j->samples + n - 1) / n < BARS_FEWEST;
    uint64_t size = (uint64_t)channels * s->nfloats;
    double *up = alloc_zero((size_t)n * channels, sizeof *up), *down = alloc_zero((size_t)n * channels, sizeof *down),
           *wide = alloc_zero((size_t)n * channels, sizeof *wide),
           *arrays[] = {out->gradient, out->gradient_stderr, out->interior, out->boundary, out->missed_estimate};
    double range[SLT_MAX_CHANNELS] = {0}, volume = 1;
    SltStatus st =
        up && down && wide ? integrals(s, j, n, up, stats, err) : status_fail(err, SLT_LIMIT, "out of memory");
    for (uint32_t d = 0; d < s->dim; d++) volume *= s->hi[d] - s->lo[d];
    if (st == SLT_OK && s->nsites && out->gradient_stderr) st = find_range(s, j, range, stats, err);
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays; i++)
        if (arrays[i]) memset(arrays[i], 0, size * sizeof **arrays);
    for (uint32_t c = 0; c < channels && st == SLT_OK; c++) {
        double mean, error;
        spread(up, n, channels, c, &mean, &error);
        if (out->value) out->value[c] = mean;
        if (out->value_stderr) out->value_stderr[c] = few ? HUGE_VAL : error;
    }
    for (uint32_t p = 0; p < scene_params(s) && st == SLT_OK; p++) {
        if (s->active && !s->active[p]) continue;
        double h = step_of(j, param_get(s, p));
        st = integral_differences(s, j, p, h, n, up, down, stats, err);
        /* What the step itself leaves out goes with its square: twice the step says how much. */
        if (st == SLT_OK && out->gradient_stderr) st = integral_differences(s, j, p, 2 * h, n, wide, down, stats, err);
        for (uint32_t c = 0; c < channels && st == SLT_OK; c++) {
            double mean, error, other, ignored;
            spread(up, n, channels, c, &mean, &error);
            spread(wide, n, channels, c, &other, &ignored);
            if (out->gradient_stderr) error = few ? HUGE_VAL : hypot(error, (other - mean) / 3);
            /* Where f jumps, one of the samples may have been near to changing. */
            if (is_zero(up, n, channels, c) && is_zero(wide, n, channels, c))
                error += range[c] * volume / (double)j->samples / (2 * h);
            if (out->gradient) out->gradient[(uint64_t)c * s->nfloats + p] = mean;
            if (out->gradient_stderr) out->gradient_stderr[(uint64_t)c * s->nfloats + p] = error;
        }
    }
    out->replicates = true;
    free(up), free(down), free(wide);
    return st;
}
