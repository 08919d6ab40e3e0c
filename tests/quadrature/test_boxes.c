/* Boxes that are asked about one by one, with kernels in C: every box gets its own answer, whatever the number of boxes
 * and threads; events keep their loop indices and boundaries on the way through `edge_bounds`; what a kernel does not
 * know is infinite. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "runtime/quadrature/boxes.h"
#include "tests/sample/layouts.h"

/* Domain [0, 10]. Edge 0, in a loop over k < 3: x < 2 + 3 k. Edge 1: floor(2 x). f: x itself, unknown beyond 9. */
enum { BOXES = 777 };

static double in(const SltKernelArgs *a, int slot, uint32_t i) { return ((const double *)a->in[slot])[i]; }

static double wall(int32_t k) { return 2 + 3 * k; }

static void bounds(const SltScene *s, SltKernelArgs *a, uint32_t i) {
#define OUT(type, role, k) ((type *)a->out[s->layout[SLT_K_BOUNDS].out[SLT_OUT_##role].first + (k)])[i]
    double lo = in(a, SLT_IN_X0, i), hi = in(a, SLT_IN_H0, i);
    int32_t n = 0;
    OUT(int32_t, BOX_STATE, 0) = hi > 9 ? SLT_BOX_UNKNOWN : 0;
    for (int32_t e = 0; e < SLT_MAX_OPEN; e++) OUT(int32_t, OPEN_EDGE, e) = -1;
    for (int32_t k = 0; k < 3; k++)
        if (lo < wall(k) && !(hi < wall(k))) OUT(int32_t, OPEN_EDGE, n) = 0, OUT(int32_t, OPEN_K, n) = k, n++;
    if (floor(2 * lo) != floor(2 * hi)) {
        OUT(int32_t, OPEN_EDGE, n) = 1, OUT(int32_t, OPEN_K, n) = 0;
        OUT(double, OPEN_FIRST, n) = floor(2 * lo) + 1, OUT(double, OPEN_LAST, n) = floor(2 * hi);
        n += (int32_t)(floor(2 * hi) - floor(2 * lo));
    }
    OUT(int32_t, OPEN, 0) = n;
    OUT(double, F_LO, 0) = lo, OUT(double, F_HI, 0) = hi > 9 ? NAN : hi;
#undef OUT
}

static void edge_bounds(const SltScene *s, SltKernelArgs *a, uint32_t i) {
#define OUT(type, role) ((type *)a->out[s->layout[SLT_K_EDGE_BOUNDS].out[SLT_OUT_##role].first])[i]
    double lo = in(a, SLT_IN_X0, i), hi = in(a, SLT_IN_H0, i);
    int32_t k = ((const int32_t *)a->in[SLT_IN_K0])[i];
    bool wave = a->site == 1;
    double scale = wave ? 2 : 1, at = wave ? in(a, SLT_IN_BOUNDARY, i) : wall(k);
    OUT(double, G_LO) = scale * lo - at, OUT(double, G_HI) = scale * hi - at;
    OUT(double, DG_LO) = wave ? NAN : 1, OUT(double, DG_HI) = wave ? NAN : 1;
    OUT(int32_t, G_STATE) = wave ? SLT_EDGE_JUMPS : 0;
#undef OUT
}

static void call(void *user, int kind, SltKernelArgs *a, uint32_t n) {
    for (uint32_t i = 0; i < n; i++)
        if (kind == SLT_K_BOUNDS) bounds(user, a, i);
        else edge_bounds(user, a, i);
}

static void never(SltKernelArgs *a, uint32_t n) { (void)a, (void)n, fail(); }

static void make_scene(SltScene *s) {
    static const uint8_t kinds[] = {SLT_SITE_COMPARE, SLT_SITE_FLOOR};
    *s = (SltScene){
        .call = call, .call_user = s, .f64 = true, .adj_lanes = 8, .dim = 1, .channels = 1, .hi = {10, 1, 1}};
    s->nsites = s->nedges = 2, s->site_kind = s->edge_kind = kinds;
    s->kernel[SLT_K_BOUNDS] = s->kernel[SLT_K_EDGE_BOUNDS] = never;
    s->layout[SLT_K_BOUNDS].reads = s->layout[SLT_K_EDGE_BOUNDS].reads = UINT64_MAX;
    static const struct {
        SltKernelKind kind;
        SltRole role;
        uint32_t count;
    } outs[] = {{SLT_K_BOUNDS, SLT_OUT_BOX_STATE, 1},
                {SLT_K_BOUNDS, SLT_OUT_OPEN, 1},
                {SLT_K_BOUNDS, SLT_OUT_OPEN_EDGE, SLT_MAX_OPEN},
                {SLT_K_BOUNDS, SLT_OUT_OPEN_K, SLT_MAX_OPEN},
                {SLT_K_BOUNDS, SLT_OUT_OPEN_FIRST, SLT_MAX_OPEN},
                {SLT_K_BOUNDS, SLT_OUT_OPEN_LAST, SLT_MAX_OPEN},
                {SLT_K_BOUNDS, SLT_OUT_F_LO, 1},
                {SLT_K_BOUNDS, SLT_OUT_F_HI, 1},
                {SLT_K_EDGE_BOUNDS, SLT_OUT_G_LO, 1},
                {SLT_K_EDGE_BOUNDS, SLT_OUT_G_HI, 1},
                {SLT_K_EDGE_BOUNDS, SLT_OUT_DG_LO, 1},
                {SLT_K_EDGE_BOUNDS, SLT_OUT_DG_HI, 1},
                {SLT_K_EDGE_BOUNDS, SLT_OUT_G_STATE, 1}};
    for (size_t i = 0; i < sizeof outs / sizeof *outs; i++)
        scene_add_output(s, outs[i].kind, outs[i].role, outs[i].count);
}

typedef struct Asked {
    double lo[BOXES], hi[BOXES];
    BoxFacts facts[BOXES];
    uint32_t taken[BOXES];
} Asked;

static void take(void *user, uint64_t i, const BoxFacts *f) {
    Asked *a = user;
    a->facts[i] = *f, a->taken[i]++;
}

static void make_boxes(Asked *a) {
    memset(a, 0, sizeof *a);
    for (int i = 0; i < BOXES; i++) {
        a->lo[i] = 0.0131 * i;
        a->hi[i] = a->lo[i] + (i % 7) * (i % 5) * 0.05; /* some of one point */
    }
}

static void each_gets_its_own(void **state) {
    (void)state;
    static Asked a[2];
    static SltScene s;
    make_scene(&s);
    for (uint32_t t = 0; t < 2; t++) {
        SltJob job = SLT_JOB_INIT;
        SltStats stats = SLT_STATS_INIT;
        job.threads = 1 + 2 * t;
        make_boxes(&a[t]);
        assert_int_equal(slt_estimate_boxes(&s, &job, BOXES, a[t].lo, a[t].hi, take, &a[t], &stats, NULL), SLT_OK);
        assert_int_equal(stats.boxes, BOXES);
    }
    assert_memory_equal(a[0].taken, a[1].taken, sizeof a[0].taken);
    uint32_t walls = 0, waves = 0;
    for (int i = 0; i < BOXES; i++) {
        const BoxFacts *f = &a[0].facts[i];
        assert_int_equal(a[0].taken[i], 1);
        double lo = a[0].lo[i], hi = a[0].hi[i];
        assert_true(hi > 9 ? f->state == SLT_BOX_UNKNOWN && f->f[0][0] == -INFINITY && f->f[0][1] == INFINITY
                           : !f->state && f->f[0][0] == lo && f->f[0][1] == hi);
        uint32_t open = 0;
        for (uint32_t e = 0; e < f->listed; e++) {
            const BoxEvent *v = &f->event[e];
            double scale = 1 + v->edge, at = v->edge ? floor(2 * lo) + 1 : wall(v->k[0]);
            assert_true(v->g[0] == scale * lo - at && v->g[1] == scale * hi - at);
            assert_true(v->edge ? v->dg[0][0] == -INFINITY && v->dg[0][1] == INFINITY && v->state == SLT_EDGE_JUMPS
                                : v->dg[0][0] == 1 && v->dg[0][1] == 1 && !v->state);
            assert_true(v->edge ? v->first == at && v->last == floor(2 * hi) : v->first == 0);
            open += v->edge ? (uint32_t)(v->last - v->first + 1) : 1;
            walls += !v->edge, waves += v->edge == 1;
        }
        assert_int_equal(open, f->open);
    }
    assert_true(walls > 50 && waves > 100); /* they were there to be confused */
}

/* Without kernels nothing is known, and nothing is called. */
static void without_kernels(void **state) {
    (void)state;
    static Asked a;
    static SltScene s;
    SltJob job = SLT_JOB_INIT;
    make_scene(&s), make_boxes(&a);
    s.kernel[SLT_K_EDGE_BOUNDS] = NULL;
    assert_int_equal(slt_estimate_boxes(&s, &job, BOXES, a.lo, a.hi, take, &a, NULL, NULL), SLT_OK);
    for (int i = 0; i < BOXES; i++)
        for (uint32_t e = 0; e < a.facts[i].listed; e++)
            assert_true(a.facts[i].event[e].g[0] == -INFINITY && a.facts[i].event[e].dg[0][1] == INFINITY);
    s.kernel[SLT_K_BOUNDS] = NULL;
    assert_int_equal(slt_estimate_boxes(&s, &job, BOXES, a.lo, a.hi, take, &a, NULL, NULL), SLT_OK);
    for (int i = 0; i < BOXES; i++) {
        assert_int_equal(a.facts[i].state, SLT_BOX_UNKNOWN);
        assert_int_equal(a.facts[i].listed, 0);
        assert_true(a.facts[i].f[0][0] == -INFINITY && a.facts[i].f[0][1] == INFINITY);
    }
    assert_int_equal(slt_estimate_boxes(&s, &job, 0, NULL, NULL, take, &a, NULL, NULL), SLT_OK);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(each_gets_its_own), cmocka_unit_test(without_kernels)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
