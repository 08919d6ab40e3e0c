/* What the tests of bounds over random programs share: boxes, points in them, and the comparison, all interpreted. At
 * every point of a box f lies between its bounds, and where the box is said to be settled f does not jump. */
#ifndef SALTUS_TESTS_RANDOM_BOXES_H
#define SALTUS_TESTS_RANDOM_BOXES_H

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "compiler/pass/pass.h"
#include "saltus/kernel.h"
#include "saltus/status.h"

enum { BOXES = 64, POINTS = 16, ROOM = BOXES * POINTS };

static uint64_t seeds = 40, pairs, settled_boxes, boxes_seen, searches;

typedef struct Run {
    const Fn *value, *bounds;
    SltLayout layout;
    bool f64;
    uint64_t random;
    double lo[BOXES][2], hi[BOXES][2];
    unsigned char in[SLT_IN_VARYING][ROOM * 8], box_in[SLT_IN_VARYING][BOXES * 8];
    unsigned char out[8][ROOM * 8], box_out[SLT_OUT_MAX][BOXES * 8];
    unsigned char params[64 * 8];
    int32_t iparams[64];
} Run;

static double unit(Run *r) {
    r->random = r->random * 6364136223846793005ull + 1442695040888963407ull;
    return (double)(r->random >> 11) * 0x1p-53;
}

static double get(const Run *r, const void *a, uint32_t i) {
    return r->f64 ? ((const double *)a)[i] : (double)((const float *)a)[i];
}
static void set(const Run *r, void *a, uint32_t i, double v) {
    if (r->f64) ((double *)a)[i] = v;
    else ((float *)a)[i] = (float)v;
}
static double rounded(const Run *r, double v) { return r->f64 ? v : (double)(float)v; }
static double up(const Run *r, double v) { return r->f64 ? nextafter(v, 9) : (double)nextafterf((float)v, 9); }

static void values(Run *r, uint32_t n) {
    SltKernelArgs args = {.params = r->params, .dparams = r->params, .iparams = r->iparams, .n_valid = n};
    for (int s = 0; s < SLT_IN_VARYING; s++) args.in[s] = r->in[s];
    for (int o = 0; o < 8; o++) args.out[o] = r->out[o];
    assert_int_equal(ir_interpret(r->value, &args, n, 64), SLT_OK);
}

static void make_boxes(Run *r) {
    for (uint32_t i = 0; i < BOXES; i++) {
        double side = pow(2, -24 * unit(r));
        uint32_t ulps = (uint32_t)(3 * unit(r)), kind = (uint32_t)(6 * unit(r));
        for (uint32_t d = 0; d < 2; d++) {
            double lo = rounded(r, 4 * unit(r) - 2), hi = rounded(r, lo + (kind == 1 ? side * unit(r) : side));
            if (kind == 0) {
                hi = lo;
                for (uint32_t k = 0; k < ulps; k++) hi = up(r, hi);
            }
            r->lo[i][d] = lo, r->hi[i][d] = fmax(lo, hi);
            set(r, r->box_in[IN_X0 + d], i, r->lo[i][d]);
            set(r, r->box_in[IN_H0 + d], i, r->hi[i][d]);
            for (uint32_t k = 0; k < POINTS; k++) {
                double v = lo + (hi - lo) * unit(r);
                if (k < 4) v = k >> d & 1 ? hi : lo;
                set(r, r->in[IN_X0 + d], i * POINTS + k, fmin(fmax(rounded(r, v), lo), r->hi[i][d]));
            }
        }
    }
}

static const void *output(const Run *r, SltRole role, uint32_t k) { return r->box_out[r->layout.out[role].first + k]; }

/* Halves the way between two points towards where f changes most, down to neighbouring numbers: what is left of the
 * change is a jump. */
static double jump_between(Run *r, double a[2], double c[2]) {
    double left = 0;
    for (uint32_t step = 0; step < 60; step++) {
        double m[2] = {a[0] + (c[0] - a[0]) / 2, a[1] + (c[1] - a[1]) / 2};
        for (uint32_t d = 0; d < 2; d++) {
            set(r, r->in[IN_X0 + d], 0, a[d]);
            set(r, r->in[IN_X0 + d], 1, m[d]);
            set(r, r->in[IN_X0 + d], 2, c[d]);
        }
        values(r, 3);
        double f[3];
        for (uint32_t k = 0; k < 3; k++) f[k] = get(r, r->out[0], k);
        left = fabs(f[0] - f[2]);
        double *end = fabs(f[1] - f[0]) > fabs(f[2] - f[1]) ? c : a;
        end[0] = rounded(r, m[0]), end[1] = rounded(r, m[1]);
    }
    return left;
}

static void check(Run *r, uint64_t seed) {
    SltKernelArgs args = {.params = r->params, .dparams = r->params, .iparams = r->iparams, .n_valid = BOXES};
    for (int s = 0; s < SLT_IN_VARYING; s++) args.in[s] = r->box_in[s];
    for (int o = 0; o < SLT_OUT_MAX; o++) args.out[o] = r->box_out[o];
    assert_int_equal(ir_interpret(r->bounds, &args, BOXES, 16), SLT_OK);
    values(r, ROOM);
    uint32_t channels = r->layout.out[SLT_OUT_F_LO].count;
    static double f[ROOM];
    for (uint32_t c = 0; c < channels; c++)
        for (uint32_t i = 0; i < BOXES; i++) {
            double lo = get(r, output(r, SLT_OUT_F_LO, c), i), hi = get(r, output(r, SLT_OUT_F_HI, c), i);
            for (uint32_t k = 0; k < POINTS; k++, pairs++) {
                double v = get(r, r->out[c], i * POINTS + k);
                if (!c) f[i * POINTS + k] = v;
                bool lies = isnan(v) ? !(lo > -INFINITY) && !(hi < INFINITY) : !(v < lo) && !(v > hi);
                if (!lies)
                    fail_msg("seed %llu %s channel %u: %.17g at (%a, %a), box [%a, %a] x [%a, %a] has [%.17g, %.17g]",
                             (unsigned long long)seed, r->f64 ? "f64" : "f32", c, v,
                             get(r, r->in[IN_X0], i * POINTS + k), get(r, r->in[IN_X1], i * POINTS + k), r->lo[i][0],
                             r->hi[i][0], r->lo[i][1], r->hi[i][1], lo, hi);
            }
        }
    static unsigned char points[2][ROOM * 8];
    memcpy(points, r->in[IN_X0], sizeof points);
    for (uint32_t i = 0; i < BOXES; i++) {
        boxes_seen++;
        if (((const int32_t *)output(r, SLT_OUT_BOX_STATE, 0))[i]) continue;
        if (r->layout.out[SLT_OUT_OPEN].count && ((const int32_t *)output(r, SLT_OUT_OPEN, 0))[i]) continue;
        settled_boxes++;
        if (!r->f64) continue; /* binary32 has too few numbers to tell steep from a jump */
        uint32_t most = 1;
        for (uint32_t k = 1; k < POINTS; k++)
            if (fabs(f[i * POINTS + k] - f[i * POINTS]) > fabs(f[i * POINTS + most] - f[i * POINTS])) most = k;
        if (fabs(f[i * POINTS + most] - f[i * POINTS]) < 1e-3) continue;
        double a[2], c[2];
        for (uint32_t d = 0; d < 2; d++)
            a[d] = get(r, points[d], i * POINTS), c[d] = get(r, points[d], i * POINTS + most);
        double jump = jump_between(r, a, c);
        searches++;
        if (jump > 1e-5 + 4 * 0x1p-52 * fabs(f[i * POINTS])) /* neighbours of 1e11 are 2e-5 apart */
            fail_msg("seed %llu: f jumps by %g near (%a, %a) in the settled box [%a, %a] x [%a, %a]",
                     (unsigned long long)seed, jump, a[0], a[1], r->lo[i][0], r->hi[i][0], r->lo[i][1], r->hi[i][1]);
    }
}

/* A program with float outputs; primal: before the passes of a primal. */
static void compare_program(Session *s, Fn *primal, uint64_t seed) {
    static Run r;
    r = (Run){.f64 = primal->precision == PREC_F64, .random = seed};
    PassCtx ctx = {.session = s, .has_fma = true, .verify = {.pass = PASS_ALL}};
    for (PassId p = PASS_opt_fold; p <= PASS_opt_contract; p++) pass_run(&ctx, PASS_NEEDS_PRIMAL, primal, p);
    opt_dce(&ctx, primal);
    if (getenv("SHOW")) ir_print(primal, stdout);
    Fn *value = variant_value(&ctx, primal), *bounds = variant_bounds(&ctx, variant_seams(&ctx, primal), false);
    pipeline_kernel(&ctx, value);
    pipeline_kernel(&ctx, bounds);
    ir_require(bounds, "bounds");
    r.value = value, r.bounds = bounds;
    r.layout = pipeline_layout(bounds);
    for (uint32_t k = 0; k < primal->nfloats; k++) set(&r, r.params, k, 2 * unit(&r) - 1);
    for (uint32_t k = 0; k < primal->nints; k++) r.iparams[k] = (int32_t)(9 * unit(&r)) - 3;
    make_boxes(&r);
    check(&r, seed);
}

/* Seeds from `first` on, or the one of the environment. make: a program, in the session's module arena. */
typedef struct Job {
    Fn *(*make)(Session *s, uint64_t seed, Precision precision, const void *shape);
    const void *shape;
    uint64_t first;
} Job;

static void check_job(Session *s, void *arg) {
    const Job *job = arg;
    const char *only = getenv("SEED");
    for (uint64_t k = 0; k < seeds; k++) {
        uint64_t seed = only ? strtoull(only, NULL, 10) : job->first + k;
        if (getenv("VERBOSE")) print_message("seed %llu\n", (unsigned long long)seed);
        ArenaMark m = arena_mark(&s->module);
        compare_program(s, job->make(s, seed, k % 2 ? PREC_F32 : PREC_F64, job->shape), seed);
        arena_reset(&s->module, m);
    }
}

static void run_job(Job job) {
    Session *s = session_create(0);
    if (session_protect(s, check_job, &job)) fail_msg("%s", s->unwind_text);
    session_destroy(s);
}

static void report(void) {
    printf("%llu pairs; %llu of %llu boxes settled, in %llu of them f was searched for jumps\n",
           (unsigned long long)pairs, (unsigned long long)settled_boxes, (unsigned long long)boxes_seen,
           (unsigned long long)searches);
}

#endif
