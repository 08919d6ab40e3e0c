/* Images and their derivatives: closed forms, forward against reverse, bits against the number of threads. */
#include <sched.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>

#include <cmocka.h>

#include "runtime/base/rng.h"
#include "runtime/base/threads.h"
#include "shaders.h"

enum { SIDE = 40 };

static void close_to(double got, double want, double tolerance, const char *what) {
    if (!(fabs(got - want) <= tolerance)) fail_msg("%s: got %.10g, want %.10g +- %.3g", what, got, want, tolerance);
}

static void ok(SltStatus st, const SltError *err) {
    if (st != SLT_OK) fail_msg("status %d: %s", st, err->text);
}

static double sum_image(const float *v, uint32_t pixels, uint32_t channels, uint32_t c) {
    double s = 0;
    for (uint32_t i = 0; i < pixels; i++) s += (double)v[i * channels + c];
    return s / pixels;
}

static void test_render(void **state) {
    (void)state;
    Oracle o;
    oracle_init(&o, circle_f, circle_g, 2, 2, 1, 3, (double[]){0.2, 0.7, 0.75});
    float image[SIDE * SIDE * 2];
    SltError err;
    for (int filter = SLT_FILTER_BOX; filter <= SLT_FILTER_GAUSSIAN; filter++) {
        SltJob j = {.size = {SIDE, SIDE, 1}, .spp = 16, .filter = filter, .threads = 2};
        SltStats stats = {0};
        ok(slt_estimate_render(&o.scene, &j, 0, image, &stats, &err), &err);
        assert_int_equal(stats.samples, SIDE * SIDE * 16);
        close_to(sum_image(image, SIDE * SIDE, 2, 0), PI * 0.04, 1e-3, "area");
        close_to(sum_image(image, SIDE * SIDE, 2, 1), PI * 0.04 * 1.7, 2e-3, "moment");
        /* y up, row 0 on top: the disc is in the upper right. */
        assert_true(image[(10 * SIDE + 28) * 2] == 1 && image[(30 * SIDE + 28) * 2] == 0 &&
                    image[(10 * SIDE + 5) * 2] == 0);
        close_to((double)image[(10 * SIDE + 28) * 2 + 1], 1 + 28.5 / SIDE, 0.01, "value at a pixel");
        float half[SIDE * SIDE * 2];
        ok(slt_estimate_render(&o.scene, &j, 1, half, NULL, &err), &err);
        assert_memory_not_equal(image, half, sizeof half);
        close_to(sum_image(half, SIDE * SIDE, 2, 0), PI * 0.04, 2e-3, "area of a half");
    }
}

/* f = a x (no jump in the middle of the image): every filter keeps a mean of 1 on a constant, at the border too. */
static void constant_f(Ctx *c, double *f) { f[0] = c->at.p[0]; }
static void test_filters_are_normalised(void **state) {
    (void)state;
    Oracle o;
    oracle_init(&o, constant_f, circle_g, 2, 1, 1, 1, (double[]){0.75});
    float image[SIDE * SIDE], d[SIDE * SIDE], *out[1] = {d};
    SltError err;
    double unit[1] = {1};
    for (int filter = SLT_FILTER_BOX; filter <= SLT_FILTER_GAUSSIAN; filter++) {
        SltJob j = {.size = {SIDE, SIDE, 1}, .spp = 3, .filter = filter, .threads = 1};
        ok(slt_estimate_render(&o.scene, &j, 0, image, NULL, &err), &err);
        ok(slt_estimate_forward(&o.scene, &j, 1, (const double *[]){unit}, out, NULL, NULL, &err), &err);
        for (int i = 0; i < SIDE * SIDE; i++) {
            assert_true(image[i] == 0.75f);
            close_to((double)d[i], 1, 1e-6, "derivative of a constant");
        }
    }
    /* An edge through the whole image, vertical, moving right: each row's weights sum to one pixel a pixel. */
    oracle_init(&o, one_f, step_g, 2, 1, 1, 1, (double[]){0.0});
    for (int filter = SLT_FILTER_BOX; filter <= SLT_FILTER_GAUSSIAN; filter++)
        for (int at = 0; at < 3; at++) {
            o.params[0] = at == 0 ? 0.511 : at == 1 ? 0.004 : 0.2501; /* also inside the border pixel */
            SltJob j = {.size = {SIDE, SIDE, 1}, .spp = 8, .filter = filter, .threads = 1};
            ok(slt_estimate_forward(&o.scene, &j, 1, (const double *[]){unit}, out, NULL, NULL, &err), &err);
            /* I_p = mass of {x > t} under the pixel's filter: differences of a row sum by t are exact. */
            SltJob fd = j;
            fd.estimator = SLT_EST_FD, fd.fd_step = 2e-3, fd.spp = 4096, fd.size[1] = 1;
            float row[SIDE], *rows[1] = {row};
            if (at == 2) continue;
            ok(slt_estimate_forward(&o.scene, &fd, 1, (const double *[]){unit}, rows, NULL, NULL, &err), &err);
            for (int x = 0; x < SIDE; x++) {
                double column = 0;
                for (int y = 0; y < SIDE; y++) column += (double)d[y * SIDE + x] / SIDE;
                close_to(column, (double)row[x], 0.05 * SIDE, "column against differences");
            }
        }
}

typedef struct Case {
    const char *name;
    void (*f)(Ctx *, double *);
    double (*g)(const Point *, int, int);
    uint32_t channels, nparams, nsites;
    bool rand, near, f32, flat;
    SltEstimator estimator;
    SltFilter filter;
} Case;

static void setup(Oracle *o, const Case *c) {
    static const double params[] = {0.31, 0.46, 0.53, 0.8, 0.6, 0.55};
    oracle_init(o, c->f, c->g, 2, c->channels, c->nsites, c->nparams, params);
    if (c->f32) oracle_use_f32(o);
    if (c->near) scene_near_miss(&o->scene);
    o->scene.uses_rand = c->rand;
    if (c->flat) o->scene.adj_lanes = 1;
}

static const Case cases[] = {
    {"circle", circle_f, circle_g, 2, 3, 1, .estimator = SLT_EST_LATTICE},
    {"shaded tent f32", shaded_f, circle_g, 1, 4, 1, .f32 = true, .filter = SLT_FILTER_TENT},
    {"shaded gaussian flat probe", shaded_f, circle_g, 1, 4, 1, .flat = true, .near = true,
     .filter = SLT_FILTER_GAUSSIAN},
    {"random", one_f, random_g, 1, 1, 1, .rand = true},
    {"scanline probe", shaded_f, circle_g, 1, 4, 1, .near = true, .estimator = SLT_EST_SCANLINE},
    {"crofton tent", shaded_f, circle_g, 1, 4, 1, .estimator = SLT_EST_SNAP_CROFTON, .filter = SLT_FILTER_TENT},
    {"knn", circle_f, circle_g, 2, 3, 1, .estimator = SLT_EST_SNAP_KNN},
    {"guarded f32", guarded_f, guarded_g, 1, 2, 2, .f32 = true},
};

/* The sum of adjoint * derivative image is the reverse gradient: same samples, same crossings. */
static void test_forward_is_reverse(void **state) {
    (void)state;
    for (size_t t = 0; t < sizeof cases / sizeof *cases; t++) {
        const Case *c = &cases[t];
        Oracle o;
        setup(&o, c);
        static float adjoint[SIDE * SIDE * 2], derivative[4][SIDE * SIDE * 2], crossings[SIDE * SIDE];
        double dirs[4][4] = {{0}}, gradient[4], bound[4];
        const double *dir[4];
        float *out[4];
        for (uint32_t i = 0; i < SIDE * SIDE * c->channels; i++) adjoint[i] = (float)sin(0.7 * i) + 0.3f;
        for (uint32_t p = 0; p < c->nparams; p++) dirs[p][p] = 1, dir[p] = dirs[p], out[p] = derivative[p];
        SltJob j = {
            .size = {SIDE, SIDE, 1}, .spp = 3, .filter = c->filter, .seed = 5, .threads = 2, .estimator = c->estimator};
        SltError err;
        SltStats stats = {0};
        ok(slt_estimate_forward(&o.scene, &j, c->nparams, dir, out, crossings, &stats, &err), &err);
        ok(slt_estimate_reverse(&o.scene, &j, (const float *[]){adjoint, adjoint}, gradient, NULL, NULL, &err), &err);
        double found = 0;
        for (int i = 0; i < SIDE * SIDE; i++) found += (double)crossings[i];
        assert_true(found > 50 && found <= stats.crossings);
        double with_bound[4];
        ok(slt_estimate_reverse(&o.scene, &j, (const float *[]){adjoint, adjoint}, with_bound, bound, NULL, &err),
           &err);
        for (uint32_t p = 0; p < c->nparams; p++) {
            double sum = 0, scale = 0;
            for (uint32_t i = 0; i < SIDE * SIDE * c->channels; i++) {
                sum += (double)adjoint[i] * (double)derivative[p][i];
                scale += fabs((double)adjoint[i] * (double)derivative[p][i]);
            }
            close_to(gradient[p], sum, (c->f32 ? 2e-5 : 1e-6) * scale, c->name);
            close_to(with_bound[p], gradient[p], (c->f32 ? 2e-5 : 1e-9) * scale, c->name);
            assert_true(isfinite(bound[p]) && bound[p] >= 0 && (bound[p] > 0 || scale == 0));
        }
    }
}

static void test_threads_do_not_matter(void **state) {
    (void)state;
    for (size_t t = 0; t < sizeof cases / sizeof *cases; t++) {
        const Case *c = &cases[t];
        Oracle o;
        setup(&o, c);
        static float image[3][SIDE * 3 * SIDE * 2 * 2], derivative[3][SIDE * 3 * SIDE * 2 * 2],
            adjoint[SIDE * 3 * SIDE * 2 * 2];
        double gradient[3][4] = {{0}}, bound[3][4] = {{0}}, total[3][16] = {{0}}, dir[4] = {1, 0.5, -0.25, 0.125};
        uint32_t threads[3] = {1, 2, 5}, n = SIDE * 3 * SIDE * 2 * c->channels;
        SltStats stats[3] = {{0}};
        SltError err;
        for (uint32_t i = 0; i < n; i++) adjoint[i] = (float)cos(0.3 * i);
        for (int r = 0; r < 3; r++) {
            SltJob j = {.size = {SIDE * 3, SIDE * 2, 1},
                        .spp = 2,
                        .filter = c->filter,
                        .seed = 9,
                        .threads = threads[r],
                        .estimator = c->estimator};
            SltJob whole = {.samples = 30000, .seed = 9, .threads = threads[r], .estimator = c->estimator};
            float *out[1] = {derivative[r]};
            ok(slt_estimate_render(&o.scene, &j, 0, image[r], &stats[r], &err), &err);
            ok(slt_estimate_forward(&o.scene, &j, 1, (const double *[]){dir}, out, NULL, &stats[r], &err), &err);
            ok(slt_estimate_reverse(&o.scene, &j, (const float *[]){adjoint, adjoint}, gradient[r], bound[r], &stats[r],
                                    &err),
               &err);
            ok(slt_estimate_integral(&o.scene, &whole,
                                     &(SltIntegral){.gradient = total[r], .gradient_stderr = total[r] + 8}, &stats[r],
                                     &err),
               &err);
            stats[r].seconds = stats[r].seconds_interior = stats[r].seconds_boundary = 0;
            assert_memory_equal(image[0], image[r], n * sizeof(float));
            assert_memory_equal(derivative[0], derivative[r], n * sizeof(float));
            assert_memory_equal(gradient[0], gradient[r], sizeof *gradient);
            assert_memory_equal(bound[0], bound[r], sizeof *bound);
            assert_memory_equal(total[0], total[r], sizeof *total);
            assert_memory_equal(&stats[0], &stats[r], sizeof *stats);
        }
        SltJob other = {.size = {SIDE * 3, SIDE * 2, 1}, .spp = 2, .seed = 10, .threads = 2};
        ok(slt_estimate_render(&o.scene, &other, 0, image[1], NULL, &err), &err);
        assert_memory_not_equal(image[0], image[1], n * sizeof(float));
    }
}

/* The boundary part of a derivative image, summed, is the length of the curve; pixels far from it are zero. */
static void test_derivative_image(void **state) {
    (void)state;
    Oracle o;
    oracle_init(&o, circle_f, circle_g, 2, 2, 1, 3, (double[]){0.3, 0.45, 0.52});
    float d[SIDE * SIDE * 2], *out[1] = {d};
    double dir[3] = {1, 0, 0};
    SltError err;
    SltJob j = {.size = {SIDE, SIDE, 1}, .spp = 8, .threads = 2};
    ok(slt_estimate_forward(&o.scene, &j, 1, (const double *[]){dir}, out, NULL, NULL, &err), &err);
    close_to(sum_image(d, SIDE * SIDE, 2, 0), 2 * PI * 0.3, 0.01, "sum");
    for (int y = 0; y < SIDE; y++)
        for (int x = 0; x < SIDE; x++) {
            double r = hypot((x + 0.5) / SIDE - 0.45, (SIDE - y - 0.5) / SIDE - 0.52);
            if (fabs(r - 0.3) > 1.0 / SIDE) assert_true(d[(y * SIDE + x) * 2] == 0);
        }
    /* 256 seeds of few samples: the pixel means agree with a run of many. */
    float mean[SIDE * SIDE * 2] = {0}, one[SIDE * SIDE * 2], *few[1] = {one};
    for (uint32_t seed = 0; seed < 256; seed++) {
        SltJob k = {.size = {SIDE, SIDE, 1}, .spp = 1, .seed = seed, .threads = 1};
        ok(slt_estimate_forward(&o.scene, &k, 1, (const double *[]){dir}, few, NULL, NULL, &err), &err);
        for (int i = 0; i < SIDE * SIDE * 2; i++) mean[i] += one[i] / 256;
    }
    SltJob many = {.size = {SIDE, SIDE, 1}, .spp = 2000, .threads = 2};
    many.no_interior = true;
    ok(slt_estimate_forward(&o.scene, &many, 1, (const double *[]){dir}, out, NULL, NULL, &err), &err);
    for (int i = 0; i < SIDE * SIDE; i++)
        close_to((double)mean[2 * i], (double)d[2 * i], 6, "pixel"); /* values reach 50, one seed spreads by 30 */
}

/* The gradient of the loss against differences of the loss of the same samples at large spp. */
static void test_loss(void **state) {
    (void)state;
    Oracle o;
    oracle_init(&o, shaded_f, circle_g, 2, 1, 1, 4, (double[]){0.3, 0.45, 0.52, 0.8});
    static float target[SIDE * SIDE], mask[SIDE * SIDE], image[SIDE * SIDE];
    SltError err;
    SltJob j = {.size = {SIDE, SIDE, 1}, .spp = 512, .threads = 2};
    for (int i = 0; i < SIDE * SIDE; i++) mask[i] = i % SIDE < 30 ? 1 : 0.5f;
    ok(slt_estimate_render(&o.scene, &j, 0, target, NULL, &err), &err);
    double step[4] = {0.05, 0.03, -0.04, 0.1}, loss, gradient[4], bound[4], same;
    ok(slt_estimate_loss(&o.scene, &j, target, NULL, &same, gradient, NULL, image, NULL, &err), &err);
    for (int p = 0; p < 4; p++) o.params[p] += step[p];
    ok(slt_estimate_loss(&o.scene, &j, target, mask, &loss, gradient, bound, image, NULL, &err), &err);
    assert_true(loss > 10 * fabs(same));
    for (int p = 0; p < 4; p++) {
        double moved[2], h = 0.0015, keep = o.params[p];
        for (int s = 0; s < 2; s++) {
            o.params[p] = keep + (s ? h : -h);
            ok(slt_estimate_loss(&o.scene, &j, target, mask, &moved[s], NULL, NULL, NULL, NULL, &err), &err);
        }
        o.params[p] = keep;
        double fd = (moved[1] - moved[0]) / (2 * h);
        close_to(gradient[p], fd, 0.02 * fabs(fd) + 0.006, "loss gradient");
        assert_true(bound[p] > 0 && bound[p] < 0.3 * fabs(fd) + 0.01);
    }
    /* One sample a pixel has no halves, and still works. */
    j.spp = 1;
    ok(slt_estimate_loss(&o.scene, &j, target, mask, &loss, gradient, NULL, image, NULL, &err), &err);
    assert_true(isfinite(loss) && isfinite(gradient[0]));
}

static void test_other_dimensions(void **state) {
    (void)state;
    Oracle o;
    SltError err;
    static float d[16 * 16 * 16], *out[1] = {d};
    double unit[1] = {1}, sum = 0;
    oracle_init(&o, one_f, ball_g, 3, 1, 1, 1, (double[]){0.3});
    SltJob j = {.size = {16, 16, 16}, .spp = 6, .threads = 2};
    ok(slt_estimate_forward(&o.scene, &j, 1, (const double *[]){unit}, out, NULL, NULL, &err), &err);
    close_to(sum_image(d, 16 * 16 * 16, 1, 0), 4 * PI * 0.09, 0.01, "ball");
    oracle_init(&o, step_f, step_g, 1, 1, 1, 1, (double[]){0.37});
    j = (SltJob){.size = {64, 1, 1}, .spp = 2, .filter = SLT_FILTER_TENT, .threads = 2};
    ok(slt_estimate_forward(&o.scene, &j, 1, (const double *[]){unit}, out, NULL, NULL, &err), &err);
    for (int i = 0; i < 64; i++) sum += (double)d[i] / 64;
    close_to(sum, -2 * 0.37, 1e-3, "step");
    j.estimator = SLT_EST_SCANLINE, o.scene.uses_rand = true, j.spp = 8, sum = 0;
    ok(slt_estimate_forward(&o.scene, &j, 1, (const double *[]){unit}, out, NULL, NULL, &err), &err);
    for (int i = 0; i < 64; i++) sum += (double)d[i] / 64;
    close_to(sum, -2 * 0.37, 1e-3, "step on scanlines");
}

/* The bound is one: the spread over seeds stays below it. */
static void test_bound(void **state) {
    (void)state;
    Oracle o;
    oracle_init(&o, shaded_f, circle_g, 2, 1, 1, 4, (double[]){0.3, 0.45, 0.52, 0.8});
    static float ones[SIDE * SIDE];
    for (int i = 0; i < SIDE * SIDE; i++) ones[i] = 1.0f / (SIDE * SIDE);
    double sum[4] = {0}, square[4] = {0}, worst[4] = {0};
    SltError err;
    for (uint32_t seed = 0; seed < 30; seed++) {
        double g[4], b[4];
        SltJob j = {.size = {SIDE, SIDE, 1}, .spp = 4, .seed = seed, .threads = 1};
        ok(slt_estimate_reverse(&o.scene, &j, (const float *[]){ones, ones}, g, b, NULL, &err), &err);
        for (int p = 0; p < 4; p++) sum[p] += g[p], square[p] += g[p] * g[p], worst[p] += b[p] / 30;
    }
    for (int p = 0; p < 4; p++) {
        double sd = sqrt(fmax(0, square[p] / 30 - pow(sum[p] / 30, 2)));
        assert_true(sd < 1.3 * worst[p] + 1e-9);
    }
    double area = PI * 0.09, jump = 0.3 + 0.8 * 0.45 - 0.2;
    close_to(sum[0] / 30, 2 * PI * 0.3 * jump + area, 0.01, "d/dr");
    close_to(sum[3] / 30, 0.45 * area + 0.25 * (1 - area), 0.002, "d/dp3");
    close_to(sum[1] / 30, 0.8 * area, 0.01, "d/dcx");
}

static bool count_work(void *user, uint32_t worker, uint64_t tile) {
    (void)worker;
    return ((uint64_t *)user)[1] == 0 || tile < ((uint64_t *)user)[1];
}
static void count_merge(void *user, uint32_t worker, uint64_t tile) {
    (void)worker;
    uint64_t *at = user;
    if (*at != tile) fail_msg("merged out of order");
    (*at)++;
}
static void test_pool(void **state) {
    (void)state;
    SltError err;
    for (uint32_t threads = 1; threads < 9; threads += 3) {
        uint64_t at[2] = {0, 0};
        PoolOptions o = {.threads = threads};
        assert_int_equal(pool_run(&o, 1000, count_work, count_merge, at, &err), SLT_OK);
        assert_int_equal(at[0], 1000);
        at[0] = 0, at[1] = 500;
        assert_int_equal(pool_run(&o, 1000, count_work, count_merge, at, &err), SLT_LIMIT);
        assert_true(at[0] <= 500);
    }
}

/* With a worker to spare a thread goes on while a tile before its own is still worked on: the first tile ends when the
 * fourth has begun. */
typedef struct Race {
    _Atomic uint64_t begun;
    uint64_t merged, of[4]; /* of: by worker, the tile that it has worked on */
} Race;
static bool race_work(void *user, uint32_t worker, uint64_t tile) {
    Race *r = user;
    double late = pool_now() + 20;
    r->of[worker] = tile, r->begun |= (uint64_t)1 << tile;
    while (tile == 0 && !(r->begun & 8) && pool_now() < late) sched_yield();
    return tile != 0 || r->begun & 8;
}
static void race_merge(void *user, uint32_t worker, uint64_t tile) {
    Race *r = user;
    if (r->merged++ != tile || r->of[worker] != tile) fail_msg("merged out of order, or what another tile has left");
}
static void test_spares(void **state) {
    (void)state;
    Race r = {0};
    SltError err;
    PoolOptions o = {.threads = 2, .workers = 4};
    assert_int_equal(pool_run(&o, 12, race_work, race_merge, &r, &err), SLT_OK);
    assert_int_equal(r.merged, 12);
}

static void test_rng(void **state) {
    (void)state;
    uint32_t a[4], b[4];
    rng_block(1, RNG_PIXEL, 0, 7, a), rng_block(1, RNG_PIXEL, 0, 7, b);
    assert_memory_equal(a, b, sizeof a);
    rng_block(1, RNG_LINE, 0, 7, b);
    assert_memory_not_equal(a, b, sizeof a);
    for (uint32_t dims = 1; dims <= 4; dims++)
        for (uint32_t d = 0; d < dims; d++) {
            /* Every interval of 1/64 gets its share of 6400 points, far from the start too. */
            int hist[64] = {0};
            for (uint64_t i = 0; i < 6400; i++) {
                double u = rng_recurrence(dims, d, i + 3000000000u, 12345);
                assert_true(u >= 0 && u < 1);
                hist[(int)(u * 64)]++;
            }
            for (int h = 0; h < 64; h++) assert_true(hist[h] > 85 && hist[h] < 115);
        }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_render),
                                       cmocka_unit_test(test_filters_are_normalised),
                                       cmocka_unit_test(test_forward_is_reverse),
                                       cmocka_unit_test(test_threads_do_not_matter),
                                       cmocka_unit_test(test_derivative_image),
                                       cmocka_unit_test(test_loss),
                                       cmocka_unit_test(test_other_dimensions),
                                       cmocka_unit_test(test_bound),
                                       cmocka_unit_test(test_pool),
                                       cmocka_unit_test(test_spares),
                                       cmocka_unit_test(test_rng)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
