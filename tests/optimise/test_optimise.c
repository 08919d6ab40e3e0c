/* Optimisers: convergence, bounds, logarithms, non-finite losses, Laplacians, and bit-identical
 * resumption. */
#include <math.h>

#include "tests/scratch.h"

#include "runtime/image/image.h"
#include "runtime/optimise/optimise.h"

typedef double (*Objective)(const double *p, double *g, size_t n);

static Optimiser *make(const OptimiseConfig *c) {
    SltError err = {0};
    Optimiser *o = optimise_create(c, &err);
    if (!o) fail_msg("%s", err.text);
    return o;
}

/* Runs at most `steps` evaluations; every point must lie in the bounds. */
static OptimiseState run(Optimiser *o, const OptimiseConfig *c, Objective f, int steps) {
    double *g = calloc(c->n, sizeof *g);
    OptimiseState state = OPTIMISE_EVALUATE;
    for (int i = 0; i < steps && state == OPTIMISE_EVALUATE; i++) {
        const double *p = optimise_parameters(o);
        for (size_t k = 0; k < c->n; k++) {
            assert_true(!c->lo || p[k] >= c->lo[k]);
            assert_true(!c->hi || p[k] <= c->hi[k]);
        }
        state = optimise_step(o, f(p, g, c->n), g);
    }
    free(g);
    return state;
}

/* The chained Rosenbrock function: minimum 0 at ones. */
static double rosenbrock(const double *p, double *g, size_t n) {
    double sum = 0;
    memset(g, 0, n * sizeof *g);
    for (size_t i = 0; i + 1 < n; i++) {
        double a = p[i + 1] - p[i] * p[i], b = 1 - p[i];
        sum += 100 * a * a + b * b;
        g[i] += -400 * a * p[i] - 2 * b;
        g[i + 1] += 200 * a;
    }
    return sum;
}

/* sum of (i + 1) (p_i - i)^2 */
static double quadratic(const double *p, double *g, size_t n) {
    double sum = 0;
    for (size_t i = 0; i < n; i++) {
        double d = p[i] - (double)i;
        sum += (double)(i + 1) * d * d;
        g[i] = 2 * (double)(i + 1) * d;
    }
    return sum;
}

static void lbfgs_rosenbrock(void **state) {
    (void)state;
    double start2[2] = {-1.2, 1}, start20[20];
    for (int i = 0; i < 20; i++) start20[i] = i % 2 ? 1 : -1.2;
    for (int k = 0; k < 2; k++) {
        OptimiseConfig c = {.n = k ? 20 : 2, .method = OPTIMISE_LBFGS, .start = k ? start20 : start2};
        Optimiser *o = make(&c);
        assert_int_equal(run(o, &c, rosenbrock, 2000), OPTIMISE_CONVERGED);
        double loss;
        const double *best = optimise_best(o, &loss);
        print_message("rosenbrock n = %zu: %ld evaluations, loss %g: %s\n", c.n, optimise_evaluations(o), loss,
                      optimise_reason(o));
        assert_true(loss < 1e-16);
        assert_true(optimise_evaluations(o) < (k ? 400 : 100));
        for (size_t i = 0; i < c.n; i++) assert_true(fabs(best[i] - 1) < 1e-7);
        optimise_free(o);
    }
}

static void lbfgs_bounds(void **state) {
    (void)state;
    /* x <= 0.5: the minimum is at x = 0.5, y = 0.25, with a gradient that pushes against the bound
     */
    double start[2] = {-1.2, 1}, lo[2] = {-2, -2}, hi[2] = {0.5, 2};
    OptimiseConfig c = {.n = 2, .method = OPTIMISE_LBFGS, .start = start, .lo = lo, .hi = hi};
    Optimiser *o = make(&c);
    assert_int_equal(run(o, &c, rosenbrock, 500), OPTIMISE_CONVERGED);
    double loss;
    const double *best = optimise_best(o, &loss);
    assert_true(best[0] == 0.5);
    assert_true(fabs(best[1] - 0.25) < 1e-8);
    assert_true(fabs(loss - 0.25) < 1e-12);
    assert_true(optimise_evaluations(o) < 150);
    optimise_free(o);
    /* many bounds, some active: the quadratic separates, so the answer is the clamp */
    enum { N = 40 };
    double s[N], l[N], h[N];
    for (int i = 0; i < N; i++) {
        s[i] = 20;
        l[i] = i % 3 == 0 ? i + 0.5 : -1;
        h[i] = i % 5 == 1 ? i - 0.25 : 100;
    }
    OptimiseConfig q = {.n = N, .method = OPTIMISE_LBFGS, .start = s, .lo = l, .hi = h};
    for (int i = 0; i < N; i++)
        if (l[i] > h[i]) l[i] = -1;
    o = make(&q);
    run(o, &q, quadratic, 1000);
    best = optimise_best(o, NULL);
    for (int i = 0; i < N; i++) {
        double want = fmin(fmax(i, l[i]), h[i]);
        if (!(fabs(best[i] - want) < 1e-6)) fail_msg("%d: %.12g, want %g (%s)", i, best[i], want, optimise_reason(o));
    }
    optimise_free(o);
}

/* Coupled: sum over i of w_i (x_i - m_i + c (x_i+1 - m_i+1))^2, x logarithms where it says so. */
enum { BOXED = 12 };
static struct {
    double w[BOXED], m[BOXED], c;
    uint8_t log[BOXED];
} boxed_now;

static double boxed(const double *p, double *g, size_t n) {
    double sum = 0, x[BOXED + 1] = {0};
    memset(g, 0, n * sizeof *g);
    for (size_t i = 0; i < n; i++) x[i] = (boxed_now.log[i] ? log(p[i]) : p[i]) - boxed_now.m[i];
    for (size_t i = 0; i < n; i++) {
        const double d = x[i] + boxed_now.c * x[i + 1];
        sum += boxed_now.w[i] * d * d;
        g[i] += 2 * boxed_now.w[i] * d;
        if (i + 1 < n) g[i + 1] += 2 * boxed_now.w[i] * d * boxed_now.c;
    }
    for (size_t i = 0; i < n; i++) g[i] /= boxed_now.log[i] ? p[i] : 1;
    return sum;
}

/* Minima inside the bounds, at them, and beyond them, some reached from a bound that the first step runs into: at the
 * end no derivative points into the box, and the optimiser says that it has converged. */
static void lbfgs_inside_at_and_beyond_bounds(void **state) {
    (void)state;
    uint32_t seed = 7, inside = 0, at_bound = 0, most = 0;
    for (int round = 0; round < 60; round++) {
        double start[BOXED], lo[BOXED], hi[BOXED], g[BOXED];
        for (int i = 0; i < BOXED; i++) {
            double u[4];
            for (int k = 0; k < 4; k++) seed = seed * 1664525u + 1013904223u, u[k] = (seed >> 8) * 0x1p-24;
            boxed_now.log[i] = i % 3 == 0;
            boxed_now.w[i] = exp(6 * u[0] - 3), boxed_now.m[i] = 3 * u[1] - 1.5; /* of bounds -1 and 1 */
            if (u[3] < 0.2) boxed_now.m[i] = u[3] < 0.1 ? -1 : 1;
            start[i] = 2 * u[2] - 1, lo[i] = -1, hi[i] = 1;
            if (boxed_now.log[i]) start[i] = exp(start[i]), lo[i] = exp(-1), hi[i] = exp(1);
        }
        boxed_now.c = round % 3 == 0 ? 0 : 0.6;
        OptimiseConfig c = {.n = BOXED,
                            .method = OPTIMISE_LBFGS,
                            .start = start,
                            .lo = lo,
                            .hi = hi,
                            .log = boxed_now.log,
                            .default_rate = round % 2 ? 0.1 : 5};
        Optimiser *o = make(&c);
        assert_int_equal(run(o, &c, boxed, 1000), OPTIMISE_CONVERGED);
        const double *best = optimise_best(o, NULL);
        (void)boxed(best, g, BOXED);
        for (int i = 0; i < BOXED; i++) {
            const bool low = best[i] == lo[i], high = best[i] == hi[i];
            if (low ? g[i] < -1e-6 : high ? g[i] > 1e-6 : fabs(g[i]) > 1e-5)
                fail_msg("round %d, %d: %.12g with a slope of %.3g (%s)", round, i, best[i], g[i], optimise_reason(o));
            if (low || high) at_bound++;
            else inside++;
        }
        if (optimise_evaluations(o) > most) most = (uint32_t)optimise_evaluations(o);
        optimise_free(o);
    }
    print_message("%u inside, %u at bounds, at most %u evaluations\n", inside, at_bound, most);
    assert_true(inside > 200 && at_bound > 100);
    assert_true(most < 250);
}

static void first_order_quadratic(void **state) {
    (void)state;
    double start[5] = {3, -2, 8, 0, 1}, rate[5] = {0.05, 0.05, 0.05, 0.05, 0}, hi[5] = {9, 9, 1.5, 9, 9};
    static const double want[5] = {0, 1, 1.5, 3, 1}; /* a bound holds the third, a rate of zero the last */
    for (int method = 0; method < OPTIMISE_METHODS; method++) {
        if (optimise_wants_same_loss((OptimiseMethod)method))
            continue; /* those with a line search are not of first order */
        for (int momentum = 0; momentum < 2; momentum++) {
            OptimiseConfig c = {.n = 5,
                                .method = (OptimiseMethod)method,
                                .start = start,
                                .learning_rate = rate,
                                .hi = hi,
                                .momentum = momentum ? 0.5 : 0};
            Optimiser *o = make(&c);
            assert_int_equal(run(o, &c, quadratic, 3000), OPTIMISE_EVALUATE);
            for (int i = 0; i < 5; i++) assert_true(fabs(optimise_best(o, NULL)[i] - want[i]) < 1e-4);
            assert_true(optimise_best(o, NULL)[4] == 1);
            optimise_free(o);
        }
    }
}

static void adam_first_steps(void **state) {
    (void)state;
    /* the bias-corrected first step is the rate, whatever the gradient's size; the second by hand
     */
    double start = 0, g1 = 1e-3, g2 = -2e-3;
    OptimiseConfig c = {.n = 1, .start = &start, .default_rate = 0.1};
    Optimiser *o = make(&c);
    optimise_step(o, 1, &g1);
    double first = optimise_parameters(o)[0];
    assert_true(fabs(first + 0.1 * g1 / (g1 + 1e-8)) < 1e-15);
    optimise_step(o, 0.9, &g2);
    double m = (0.9 * 0.1 * g1 + 0.1 * g2) / (1 - 0.81),
           v = (0.999 * 0.001 * g1 * g1 + 0.001 * g2 * g2) / (1 - 0.999 * 0.999);
    assert_true(fabs(optimise_parameters(o)[0] - (first - 0.1 * m / (sqrt(v) + 1e-8))) < 1e-14);
    optimise_free(o);
}

/* (log10 p - 3)^2: hopeless from 1e-3 on a linear scale */
static double far_away(const double *p, double *g, size_t n) {
    (void)n;
    double d = log10(p[0]) - 3;
    g[0] = 2 * d / (p[0] * log(10));
    return d * d;
}

static void logarithms(void **state) {
    (void)state;
    double start = 1e-3, lo = 1e-4, hi = 500;
    uint8_t flag = 1;
    for (int method = 0; method < OPTIMISE_METHODS; method++) {
        for (int bounded = 0; bounded < 2; bounded++) {
            OptimiseConfig c = {.n = 1,
                                .method = (OptimiseMethod)method,
                                .start = &start,
                                .log = &flag,
                                .default_rate = 0.2,
                                .lo = bounded ? &lo : NULL,
                                .hi = bounded ? &hi : NULL};
            Optimiser *o = make(&c);
            assert_true(optimise_parameters(o)[0] == 1e-3);
            run(o, &c, far_away, 600);
            assert_true(fabs(optimise_best(o, NULL)[0] / (bounded ? 500 : 1000) - 1) < 1e-3);
            optimise_free(o);
        }
    }
    start = -1;
    SltError err = {0};
    OptimiseConfig bad = {.n = 1, .start = &start, .log = &flag};
    assert_null(optimise_create(&bad, &err));
    assert_int_equal(err.status, SLT_USAGE);
    assert_non_null(strstr(err.text, "parameter 0"));
}

/* A quadratic that is NaN beyond 1.5 and whose gradient is infinite below -4. */
static double cliff(const double *p, double *g, size_t n) {
    (void)n;
    g[0] = p[0] < -4 ? INFINITY : 2 * (p[0] - 1);
    return p[0] > 1.5 ? NAN : (p[0] - 1) * (p[0] - 1);
}

static double nothing_but_nan(const double *p, double *g, size_t n) {
    (void)n;
    g[0] = 1;
    return p[0] == 0 ? 1 : NAN;
}

static void non_finite(void **state) {
    (void)state;
    for (int method = 0; method < OPTIMISE_METHODS; method++) {
        double start = -3, rate = method == OPTIMISE_SGD ? 0.9 : 6;
        OptimiseConfig c = {
            .n = 1, .method = (OptimiseMethod)method, .start = &start, .default_rate = rate, .momentum = 0.1};
        Optimiser *o = make(&c);
        OptimiseState s = run(o, &c, cliff, 400);
        assert_int_not_equal(s, OPTIMISE_FAILED);
        assert_true(optimise_rejected(o) > 0);
        double loss;
        assert_true(fabs(optimise_best(o, &loss)[0] - 1) < 0.05);
        optimise_free(o);

        start = 0;
        OptimiseConfig d = {.n = 1, .method = (OptimiseMethod)method, .start = &start, .max_failures = 7};
        o = make(&d);
        assert_int_equal(run(o, &d, nothing_but_nan, 400), OPTIMISE_FAILED);
        assert_int_equal(optimise_rejected(o), 8);
        assert_non_null(strstr(optimise_reason(o), "not finite"));
        assert_true(optimise_best(o, &loss)[0] == 0 && loss == 1);
        double g = 1;
        assert_int_equal(optimise_step(o, 0, &g), OPTIMISE_FAILED); /* it stays stopped */
        optimise_free(o);

        start = 7;
        o = make(&d);
        assert_int_equal(run(o, &d, nothing_but_nan, 400), OPTIMISE_FAILED);
        assert_non_null(strstr(optimise_reason(o), "at the start"));
        optimise_free(o);
    }
}

/* A slow descent to 1 whose losses are noisy by much more than what they fall by at the end. */
static double noisy(const double *p, double *g, size_t n) {
    static uint32_t x = 12345;
    double sum = 0;
    for (int i = 0; i < 12; i++) x = x * 1664525u + 1013904223u, sum += x / 4294967296.0;
    (void)n;
    g[0] = 2 * (p[0] - 1);
    return (p[0] - 1) * (p[0] - 1) + 0.05 * (sum - 6);
}

static double steep(const double *p, double *g, size_t n) {
    (void)n;
    g[0] = 2 * p[0];
    return p[0] * p[0];
}

/* The best of noisy losses is no lucky draw of long ago, and the best of exact ones is the lowest. */
static void best_of_noise(void **state) {
    (void)state;
    double start = -1, loss, worst = 0;
    for (int k = 0; k < 100; k++) {
        OptimiseConfig c = {.n = 1, .start = &start, .default_rate = 0.005};
        Optimiser *o = make(&c);
        run(o, &c, noisy, 1500);
        worst = fmax(worst, fabs(optimise_best(o, NULL)[0] - 1));
        optimise_free(o);
    }
    assert_true(worst < 0.01); /* of the lowest loss: .16 */
    start = 1;
    OptimiseConfig c = {
        .n = 1, .method = OPTIMISE_SGD, .start = &start, .default_rate = 1.05}; /* every step is too long */
    Optimiser *o = make(&c);
    run(o, &c, steep, 100);
    assert_true(optimise_best(o, &loss)[0] == 1 && loss == 1);
    optimise_free(o);
}

static void stopping(void **state) {
    (void)state;
    double start[3] = {0, 1, 2}; /* already at the minimum */
    for (int method = 0; method < OPTIMISE_METHODS; method++) {
        OptimiseConfig c = {.n = 3, .method = (OptimiseMethod)method, .start = start};
        Optimiser *o = make(&c);
        assert_int_equal(run(o, &c, quadratic, 5), OPTIMISE_CONVERGED);
        assert_int_equal(optimise_evaluations(o), 1);
        optimise_free(o);
    }
    double away[3] = {5, 5, 5};
    OptimiseConfig c = {.n = 3, .start = away, .default_rate = 0.1, .patience = 20, .loss_tolerance = 1e-4};
    Optimiser *o = make(&c);
    assert_int_equal(run(o, &c, quadratic, 5000), OPTIMISE_CONVERGED);
    assert_true(optimise_evaluations(o) > 50 && optimise_evaluations(o) < 1000);
    double loss;
    optimise_best(o, &loss);
    assert_true(loss < 1e-2);
    optimise_free(o);
    OptimiseConfig d = {.n = 3, .method = OPTIMISE_SGD, .start = away, .default_rate = 0.1, .gradient_tolerance = 1e-3};
    o = make(&d);
    assert_int_equal(run(o, &d, quadratic, 5000), OPTIMISE_CONVERGED);
    assert_non_null(strstr(optimise_reason(o), "gradient"));
    optimise_free(o);
}

/* Gaussian elimination with partial pivoting, the slow oracle. */
static void dense_solve(double *a, double *b, int n) {
    for (int k = 0; k < n; k++) {
        int pivot = k;
        for (int i = k; i < n; i++) pivot = fabs(a[i * n + k]) > fabs(a[pivot * n + k]) ? i : pivot;
        for (int j = 0; j < n; j++) {
            double t = a[k * n + j];
            a[k * n + j] = a[pivot * n + j];
            a[pivot * n + j] = t;
        }
        double t = b[k];
        b[k] = b[pivot];
        b[pivot] = t;
        for (int i = k + 1; i < n; i++) {
            double f = a[i * n + k] / a[k * n + k];
            for (int j = k; j < n; j++) a[i * n + j] -= f * a[k * n + j];
            b[i] -= f * b[k];
        }
    }
    for (int k = n - 1; k >= 0; k--) {
        for (int j = k + 1; j < n; j++) b[k] -= a[k * n + j] * b[j];
        b[k] /= a[k * n + k];
    }
}

/* Two faces beside each other and one apart, an edge that comes twice, a vertex without any. */
static void graph_is_right(void **state) {
    (void)state;
    static const uint32_t edges[] = {0, 1, 1, 2, 2, 0, 2, 1, 1, 3, 3, 2, 4, 5, 5, 6, 6, 4, 5, 5};
    enum { N = 8 };
    double lambda = 37, a[N * N] = {0}, b[N], data[2 * N];
    for (int i = 0; i < N; i++) {
        a[i * N + i] = 1;
        data[2 * i] = b[i] = sin(i * 1.7), data[2 * i + 1] = 42;
    }
    for (int e = 0; e < 9; e++) {
        uint32_t i = edges[2 * e], j = edges[2 * e + 1];
        if (e == 3) continue; /* the one that comes again */
        a[i * N + i] += lambda, a[j * N + j] += lambda, a[i * N + j] -= lambda, a[j * N + i] -= lambda;
    }
    SltError err = {0};
    Graph *g = graph_create(N, edges, 10, lambda, &err);
    assert_non_null(g);
    graph_solve(g, data, 2);
    dense_solve(a, b, N);
    for (int i = 0; i < N; i++) {
        assert_true(fabs(data[2 * i] - b[i]) < 1e-8);
        assert_true(data[2 * i + 1] == 42);
    }
    graph_free(g);
    assert_null(graph_create(5, edges, 10, lambda, &err));
    assert_int_equal(err.status, SLT_USAGE);
    assert_null(graph_create((1u << 24) + 1, edges, 10, lambda, &err));
    assert_int_equal(err.status, SLT_LIMIT);
    assert_null(graph_create(N, edges, 10, -1, &err));
}

static void laplacian_is_right(void **state) {
    (void)state;
    static const int sizes[][2] = {{1, 1}, {7, 1}, {1, 5}, {6, 4}, {9, 11}};
    for (int k = 0; k < 5; k++) {
        int w = sizes[k][0], h = sizes[k][1], n = w * h;
        double lambda = 3.7, *a = calloc((size_t)n * (size_t)n, sizeof *a), *b = calloc((size_t)n, sizeof *b);
        double *data = calloc((size_t)n * 3, sizeof *data), *scratch = calloc((size_t)n * 2, sizeof *scratch);
        for (int i = 0; i < n; i++) {
            a[i * n + i] += 1;
            int right = i % w + 1 < w ? i + 1 : -1, down = i / w + 1 < h ? i + w : -1;
            for (int e = 0; e < 2; e++) {
                int j = e ? down : right;
                if (j >= 0) {
                    a[i * n + i] += lambda;
                    a[j * n + j] += lambda;
                    a[i * n + j] -= lambda;
                    a[j * n + i] -= lambda;
                }
            }
            b[i] = sin(i * 1.7);
            data[3 * i + 1] = b[i]; /* the middle of three channels */
            data[3 * i] = data[3 * i + 2] = 42;
        }
        SltError err = {0};
        Laplacian *l = laplacian_create(w, h, lambda, &err);
        assert_non_null(l);
        laplacian_solve(l, data + 1, 3, 3 * (size_t)w, scratch);
        dense_solve(a, b, n);
        for (int i = 0; i < n; i++) {
            assert_true(fabs(data[3 * i + 1] - b[i]) < 1e-12);
            assert_true(data[3 * i] == 42 && data[3 * i + 2] == 42);
        }
        laplacian_free(l);
        free(a);
        free(b);
        free(data);
        free(scratch);
    }
    SltError err = {0};
    assert_null(laplacian_create(1 << 12, 1 << 12, 1, &err));
    assert_int_equal(err.status, SLT_LIMIT);
    assert_null(laplacian_create(4, 4, -1, &err));
    assert_null(laplacian_create(4, 4, NAN, &err));
}

enum { SIDE = 24 };

/* Only a few scattered cells are seen, as a boundary term sees few texels. */
static double sparse_target(const double *p, double *g, size_t n) {
    double sum = 0;
    memset(g, 0, n * sizeof *g);
    for (int i = 0; i < 40; i++) {
        int k = (i * 131 + 17) % (SIDE * SIDE);
        double d = p[k] - sin(k % SIDE * 0.2) * cos(k / SIDE * 0.2);
        sum += d * d;
        g[k] += 2 * d;
    }
    return sum;
}

static double roughness(const double *p) {
    double sum = 0;
    for (int y = 0; y < SIDE; y++) {
        for (int x = 0; x + 1 < SIDE; x++) {
            double d = p[y * SIDE + x + 1] - p[y * SIDE + x];
            sum += d * d;
        }
    }
    return sum;
}

static void smooth_steps(void **state) {
    (void)state;
    double start[SIDE * SIDE] = {0};
    for (int method = 0; method < OPTIMISE_METHODS; method++) {
        double rough[2], loss[2];
        for (int smooth = 0; smooth < 2; smooth++) {
            OptimiseGrid grid = {
                .width = SIDE, .height = SIDE, .channels = 1, .stride_x = 1, .stride_y = SIDE, .lambda = 10};
            OptimiseConfig c = {.n = SIDE * SIDE,
                                .method = (OptimiseMethod)method,
                                .start = start,
                                .default_rate = 0.1,
                                .grids = &grid,
                                .grid_count = smooth};
            Optimiser *o = make(&c);
            run(o, &c, sparse_target, 300);
            rough[smooth] = roughness(optimise_best(o, &loss[smooth]));
            optimise_free(o);
        }
        print_message("%s: roughness %.3g plain, %.3g smooth; loss %.3g, %.3g\n", optimise_name((OptimiseMethod)method),
                      rough[0], rough[1], loss[0], loss[1]);
        assert_true(rough[1] < 0.35 * rough[0]);
        assert_true(loss[1] < (method == OPTIMISE_SGD ? 0.7 * 18 : 1e-2));
    }
}

/* A gradient with one wild entry, once: it neither moves its own parameter far nor slows the others down. */
static void outliers_on_grids(void **state) {
    (void)state;
    double start[SIDE * SIDE] = {0}, g[SIDE * SIDE], worst = 0;
    OptimiseGrid grid = {.width = SIDE, .height = SIDE, .channels = 1, .stride_x = 1, .stride_y = SIDE, .lambda = 2};
    OptimiseConfig c = {.n = SIDE * SIDE,
                        .method = OPTIMISE_ADAM,
                        .start = start,
                        .default_rate = 0.02,
                        .grids = &grid,
                        .grid_count = 1};
    Optimiser *o = make(&c);
    for (int step = 0; step < 200; step++) {
        const double *p = optimise_parameters(o);
        double loss = 0;
        for (int i = 0; i < SIDE * SIDE; i++) {
            g[i] = p[i] - 1;
            loss += 0.5 * g[i] * g[i];
            if (step > 10) worst = fmax(worst, fabs(p[i] - p[0]));
        }
        if (step == 10) g[SIDE * SIDE / 2] = 1e4;
        optimise_step(o, loss, g);
    }
    double loss;
    optimise_best(o, &loss);
    print_message("worst bump %.3g, loss %.3g\n", worst, loss);
    assert_true(worst < 0.2);
    assert_true(loss < 1e-3);
    optimise_free(o);
}

/* Rosenbrock, not finite in places, so that a resumed run must also remember rejections. */
static double hard(const double *p, double *g, size_t n) {
    double f = rosenbrock(p, g, n);
    return p[0] > 1.2 ? NAN : f;
}

static void resume_is_bit_identical(void **state) {
    (void)state;
    enum { N = 24, STEPS = 60 };
    const char *path = scratch_path("c.ckpt");
    double start[N], lo[N], hi[N], g[N];
    uint8_t flag[N] = {0};
    for (int i = 0; i < N; i++) {
        start[i] = i % 2 ? 1 : -1.2;
        lo[i] = -3;
        hi[i] = i % 4 == 0 ? 0.9 : 3;
    }
    hi[0] = 3;
    start[5] = 0.2;
    flag[5] = 1;
    OptimiseGrid grid = {
        .offset = 8, .width = 4, .height = 4, .channels = 1, .stride_x = 1, .stride_y = 4, .lambda = 0.5};
    for (int method = 0; method < OPTIMISE_METHODS; method++) {
        OptimiseConfig c = {.n = N,
                            .method = (OptimiseMethod)method,
                            .start = start,
                            .lo = lo,
                            .hi = hi,
                            .log = flag,
                            .grids = &grid,
                            .grid_count = 1,
                            .momentum = 0.7,
                            .default_rate = method == OPTIMISE_SGD ? 2e-4 : 0.05,
                            .history = 5};
        double straight[STEPS][N], loss;
        Optimiser *o = make(&c);
        for (int i = 0; i < STEPS; i++) {
            memcpy(straight[i], optimise_parameters(o), sizeof straight[i]);
            optimise_step(o, hard(optimise_parameters(o), g, N), g);
        }
        double best[N];
        memcpy(best, optimise_best(o, &loss), sizeof best);
        optimise_free(o);
        for (int stop = 0; stop < STEPS; stop += 7) { /* also in the middle of a line search */
            SltError err = {0};
            o = make(&c);
            for (int i = 0; i < stop; i++) optimise_step(o, hard(optimise_parameters(o), g, N), g);
            assert_int_equal(optimise_save(o, path, "program 1", "blob!", 5, &err), SLT_OK);
            optimise_free(o);
            o = make(&c);
            void *blob;
            size_t size;
            if (optimise_load(o, path, "program 1", &blob, &size, &err) != SLT_OK) fail_msg("%s", err.text);
            assert_int_equal(size, 5);
            assert_string_equal(blob, "blob!");
            free(blob);
            for (int i = stop; i < STEPS; i++) {
                assert_memory_equal(optimise_parameters(o), straight[i], sizeof straight[i]);
                optimise_step(o, hard(optimise_parameters(o), g, N), g);
            }
            double again;
            assert_memory_equal(optimise_best(o, &again), best, sizeof best);
            assert_memory_equal(&again, &loss, sizeof loss);
            optimise_free(o);
        }
        assert_true(isfinite(loss));
    }
}

static void damaged_checkpoints(void **state) {
    (void)state;
    const char *path = scratch_path("d.ckpt"), *bad = scratch_path("bad.ckpt");
    double start[2] = {-1.2, 1}, other_rate[2] = {0.01, 0.02}, lo[2] = {-5, -5};
    OptimiseConfig c = {.n = 2, .method = OPTIMISE_LBFGS, .start = start, .history = 3};
    SltError err = {0};
    Optimiser *o = make(&c);
    run(o, &c, rosenbrock, 12);
    assert_int_equal(optimise_save(o, path, "k", NULL, 0, &err), SLT_OK);
    void *blob;
    size_t size;
    uint8_t *bytes;
    assert_int_equal(optimise_load(o, path, "k", &blob, &size, &err), SLT_OK);
    assert_null(blob);
    assert_int_equal(optimise_load(o, path, "another", &blob, &size, &err), SLT_INPUT);
    assert_non_null(strstr(err.text, "another"));
    assert_int_equal(optimise_load(o, "nowhere.ckpt", "k", &blob, &size, &err), SLT_INPUT);
    OptimiseConfig foreign[4] = {c, c, c, c};
    foreign[0].method = OPTIMISE_ADAM;
    foreign[1].learning_rate = other_rate;
    foreign[2].lo = lo;
    foreign[3].history = 4;
    for (int i = 0; i < 4; i++) {
        Optimiser *f = make(&foreign[i]);
        assert_int_equal(optimise_load(f, path, "k", &blob, &size, &err), SLT_INPUT);
        assert_non_null(strstr(err.text, "changed"));
        optimise_free(f);
    }
    size_t length;
    assert_int_equal(file_read_all(path, &file_binary, &bytes, &length, &err), SLT_OK);
    double before[2];
    memcpy(before, optimise_parameters(o), sizeof before);
    for (size_t n = 0; n < length; n += 3) {
        FILE *f = fopen(bad, "wb");
        fwrite(bytes, 1, n, f);
        fclose(f);
        assert_int_equal(optimise_load(o, bad, "k", &blob, &size, &err), SLT_INPUT);
        assert_non_null(strstr(err.text, "bad.ckpt"));
    }
    for (size_t at = 0; at < length; at += 2) {
        bytes[at] ^= 0x10;
        FILE *f = fopen(bad, "wb");
        fwrite(bytes, 1, length, f);
        fclose(f);
        assert_int_equal(optimise_load(o, bad, "k", &blob, &size, &err), SLT_INPUT);
        bytes[at] ^= 0x10;
    }
    assert_memory_equal(before, optimise_parameters(o), sizeof before);
    free(bytes);
    optimise_free(o);
}

/* Names lead to rows, and docs/command.md has each. */
static void names(void **state) {
    (void)state;
    uint8_t *page;
    size_t size;
    SltError err = {0};
    assert_int_equal(file_read_all(SALTUS_TEST_DIR "/../docs/command.md", &file_binary, &page, &size, &err), SLT_OK);
    for (int k = 0; k < OPTIMISE_METHODS; k++) {
        OptimiseMethod found;
        const char *name = optimise_name((OptimiseMethod)k);
        assert_true(optimise_find(name, &found));
        assert_int_equal(found, k);
        if (!strstr((const char *)page, name)) fail_msg("docs/command.md does not name `%s`", name);
    }
    OptimiseMethod found;
    assert_false(optimise_find("", &found));
    assert_false(optimise_find("Adam", &found));
    free(page);
}

static void bad_configs(void **state) {
    (void)state;
    double start[2] = {0, 0}, nan[2] = {0, NAN}, lo[2] = {1, 1}, hi[2] = {2, 0};
    OptimiseGrid outside = {
        .offset = 1, .width = 2, .height = 1, .channels = 1, .stride_x = 1, .stride_y = 2, .lambda = 1};
    const OptimiseConfig bad[] = {
        {.n = 0, .start = start},
        {.n = 2},
        {.n = 2, .start = nan},
        {.n = 2, .start = start, .lo = lo, .hi = hi},
        {.n = 2, .start = start, .learning_rate = nan},
        {.n = 2, .start = start, .beta1 = 1},
        {.n = 2, .start = start, .momentum = -1},
        {.n = 2, .start = start, .grids = &outside, .grid_count = 1},
        {.n = 2, .start = start, .method = OPTIMISE_METHODS},
        {.n = 2, .start = start, .method = (OptimiseMethod)-1},
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        SltError err = {0};
        assert_null(optimise_create(&bad[i], &err));
        assert_int_equal(err.status, SLT_USAGE);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lbfgs_rosenbrock),
        cmocka_unit_test(lbfgs_bounds),
        cmocka_unit_test(lbfgs_inside_at_and_beyond_bounds),
        cmocka_unit_test(first_order_quadratic),
        cmocka_unit_test(adam_first_steps),
        cmocka_unit_test(logarithms),
        cmocka_unit_test(non_finite),
        cmocka_unit_test(best_of_noise),
        cmocka_unit_test(stopping),
        cmocka_unit_test(laplacian_is_right),
        cmocka_unit_test(graph_is_right),
        cmocka_unit_test(smooth_steps),
        cmocka_unit_test(outliers_on_grids),
        cmocka_unit_test(resume_is_bit_identical),
        cmocka_unit_test(damaged_checkpoints),
        cmocka_unit_test(names),
        cmocka_unit_test(bad_configs),
    };
    return cmocka_run_group_tests(tests, scratch_make, scratch_drop);
}
