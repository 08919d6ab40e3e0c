/* Images by quadrature, on scenes in C: pixels and their derivatives against integrals over pixels, for every filter.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#include <cmocka.h>

#include <float.h>

#include "runtime/sample/grid.h"
#include "tests/quadrature/estimates.h"

#define PI 3.14159265358979323846
enum { SIDE = 12, PIXELS = SIDE * SIDE };

/* A disc before a slope: jumps, a smooth part, cells of one colour outside of neither. */
static const double disc[] = {0.52, 0.47, 0.3};
static Num disc_g(const Scene *s, uint32_t e, const Num *x) {
    (void)e;
    Num dx = num_sub(x[0], param(s, 0)), dy = num_sub(x[1], param(s, 1));
    return num_sub(num_add(num_sqr(dx), num_sqr(dy)), num_sqr(param(s, 2)));
}
static double inside(const double x[2]) { return 1 + x[0] * x[1]; }
static void disc_f(Look *l, double *f) { f[0] = decide(l, 0) ? inside(l->x) : 0.25; }

static void make(Scene *s) {
    scene_init(s, 2, 1, 0, disc_g, disc_f, disc, 3);
    estimates_init(s);
}

static SltJob job_of(SltFilter filter) {
    SltJob j = SLT_JOB_INIT;
    j.size[0] = j.size[1] = SIDE, j.estimator = SLT_EST_QUADRATURE, j.filter = filter, j.spp = 16;
    return j;
}

/* ---- the filters, written once more */
static double along(SltFilter filter, double u) {
    double a = fabs(u);
    if (filter == SLT_FILTER_BOX) return a < 0.5;
    if (filter == SLT_FILTER_TENT) return a < 1 ? 1 - a : 0;
    return a < 2 ? exp(-2 * a * a) : 0;
}
/* Of the part of the domain: pixels from one border to the other. */
static double mass(SltFilter filter, int pixel) {
    enum { STEPS = 4000 };
    double sum = 0, from = fmax(-2, -(pixel + 0.5)), to = fmin(2, SIDE - (pixel + 0.5));
    for (int i = 0; i < STEPS; i++) sum += along(filter, from + (i + 0.5) / STEPS * (to - from));
    return sum * (to - from) / STEPS / SIDE;
}
static double masses[3][SIDE];
/* Of pixel (i, j), j upwards, at x. */
static double weight(SltFilter filter, int i, int j, const double x[2]) {
    return along(filter, x[0] * SIDE - i - 0.5) * along(filter, x[1] * SIDE - j - 0.5) / masses[filter][i] /
           masses[filter][j];
}

/* Derivatives of a pixel in the disc's radius and in its x: integrals along the circle. */
static void slopes(SltFilter filter, int i, int j, double *radius, double *shift) {
    enum { STEPS = 200000 };
    *radius = *shift = 0;
    for (int k = 0; k < STEPS; k++) {
        double t = 2 * PI * (k + 0.5) / STEPS, x[2] = {disc[0] + disc[2] * cos(t), disc[1] + disc[2] * sin(t)};
        double w = weight(filter, i, j, x) * (inside(x) - 0.25) * disc[2] * 2 * PI / STEPS;
        *radius += w, *shift += w * cos(t);
    }
}

static void near(const char *what, int i, int j, double is, double want, double tolerance) {
    if (!(fabs(is - want) <= tolerance)) {
        printf("%s of pixel %d %d: %.10g instead of %.10g, off by %g\n", what, i, j, is, want, is - want);
        fail();
    }
}

/* Rows of midpoint sums, each cut where the disc begins and ends. */
static double pixel_value(int i, int j) {
    enum { ROWS = 20000 };
    double sum = 0, h = 1.0 / SIDE;
    for (int k = 0; k < ROWS; k++) {
        double y = (j + (k + 0.5) / ROWS) * h, dy = y - disc[1], in = disc[2] * disc[2] - dy * dy;
        double a = i * h, b = a + h, from = b, to = b;
        if (in > 0) from = fmin(fmax(disc[0] - sqrt(in), a), b), to = fmin(fmax(disc[0] + sqrt(in), a), b);
        sum += 0.25 * (b - a - (to - from)) + (to - from) + y * (to * to - from * from) / 2;
    }
    return sum / ROWS / h;
}

static void pixels_are_exact(void **state) {
    (void)state;
    Scene s;
    float image[PIXELS];
    SltStats stats = SLT_STATS_INIT;
    make(&s);
    SltJob j = job_of(SLT_FILTER_BOX);
    assert_int_equal(slt_estimate_render(&s.slt, &j, 0, image, &stats, NULL), SLT_OK);
    assert_true(stats.cells && stats.left == 0);
    for (int y = 0; y < SIDE; y++)
        for (int x = 0; x < SIDE; x++)
            near("value", x, y, (double)image[(SIDE - 1 - y) * SIDE + x], pixel_value(x, y), 1e-6);
}

/* All pixels together are the integral, whatever the filter, but for what borders take. */
static void filters_keep_constants(void **state) {
    (void)state;
    Scene s;
    float image[PIXELS];
    make(&s);
    double far[] = {0.52, 0.47, 0.01};
    s.p = far;
    for (int filter = 0; filter < 3; filter++) {
        SltJob j = job_of((SltFilter)filter);
        assert_int_equal(slt_estimate_render(&s.slt, &j, 0, image, NULL, NULL), SLT_OK);
        for (int y = 0; y < SIDE; y++)
            for (int x = 0; x < SIDE; x++)
                if (abs(x - 6) > 3 || abs(y - 5) > 3)
                    near("value", x, y, (double)image[(SIDE - 1 - y) * SIDE + x], 0.25, 1e-6);
    }
}

static void derivative_images(void **state) {
    (void)state;
    static const double dirs[2][3] = {{0, 0, 1}, {1, 0, 0}};
    const double *along_dirs[2] = {dirs[0], dirs[1]};
    Scene s;
    float image[2][PIXELS], *out[2] = {image[0], image[1]};
    make(&s);
    for (int filter = 0; filter < 3; filter++) {
        SltJob j = job_of((SltFilter)filter);
        assert_int_equal(slt_estimate_forward(&s.slt, &j, 2, along_dirs, out, NULL, NULL, NULL), SLT_OK);
        for (int y = 0; y < SIDE; y++)
            for (int x = 0; x < SIDE; x++) {
                double radius, shift;
                int at = (SIDE - 1 - y) * SIDE + x;
                slopes((SltFilter)filter, x, y, &radius, &shift);
                near("slope in the radius", x, y, (double)image[0][at], radius, 4e-3);
                near("slope in x", x, y, (double)image[1][at], shift, 4e-3);
            }
    }
}

/* However few points are asked for at first, and however curves lie in the pixels. */
static void an_error_is_reached(void **state) {
    (void)state;
    static const double dirs[2][3] = {{0, 0, 1}, {1, 0, 0}};
    const double *along_dirs[2] = {dirs[0], dirs[1]};
    Scene s;
    float image[2][PIXELS], *out[2] = {image[0], image[1]}, adjoint[PIXELS];
    make(&s);
    for (int i = 0; i < PIXELS; i++) adjoint[i] = (float)sin(1.7 * i) + 0.3f;
    const float *both[2] = {adjoint, adjoint};
    SltJob j = job_of(SLT_FILTER_TENT), most = j;
    double rough[3], gradient[3], error[3];
    SltStats stats = SLT_STATS_INIT;
    j.spp = 1, j.error = 3e-6;
    assert_int_equal(slt_estimate_forward(&s.slt, &j, 2, along_dirs, out, NULL, &stats, NULL), SLT_OK);
    assert_int_equal(stats.stopped, SLT_STOP_NONE);
    for (int y = 0; y < SIDE; y++)
        for (int x = 0; x < SIDE; x++) {
            double radius, shift;
            int at = (SIDE - 1 - y) * SIDE + x;
            slopes(SLT_FILTER_TENT, x, y, &radius, &shift);
            near("slope in the radius", x, y, (double)image[0][at], radius, 1e-5);
            near("slope in x", x, y, (double)image[1][at], shift, 1e-5);
        }
    j.error = 1e-9;
    assert_int_equal(slt_estimate_reverse(&s.slt, &j, both, gradient, error, &stats, NULL), SLT_OK);
    assert_int_equal(stats.stopped, SLT_STOP_NONE);
    most.gauss = SLT_GAUSS_MAX;
    assert_int_equal(slt_estimate_reverse(&s.slt, &most, both, rough, NULL, NULL, NULL), SLT_OK);
    for (int p = 0; p < 3; p++) near("gradient", p, 0, gradient[p], rough[p], error[p] + 1e-10);
    j.max_evaluations = 2000;
    assert_int_equal(slt_estimate_forward(&s.slt, &j, 2, along_dirs, out, NULL, &stats, NULL), SLT_OK);
    assert_int_equal(stats.stopped, SLT_STOP_EVALUATIONS);
    j.max_evaluations = 0;
    assert_int_equal(slt_estimate_render(&s.slt, &j, 0, image[0], &stats, NULL), SLT_OK);
    assert_int_equal(stats.stopped, SLT_STOP_ROUNDING); /* pixels are floats */
}

/* The gradient of a weighed image is the sum of its weighed derivatives. */
static void gradient_of_an_image(void **state) {
    (void)state;
    static const double dirs[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    const double *along_dirs[3] = {dirs[0], dirs[1], dirs[2]};
    Scene s;
    float image[3][PIXELS], *out[3] = {image[0], image[1], image[2]}, adjoint[PIXELS];
    make(&s);
    for (int i = 0; i < PIXELS; i++) adjoint[i] = (float)sin(1.7 * i) + 0.3f;
    const float *both[2] = {adjoint, adjoint};
    for (int filter = 0; filter < 3; filter++) {
        SltJob j = job_of((SltFilter)filter);
        double gradient[3], error[3];
        assert_int_equal(slt_estimate_forward(&s.slt, &j, 3, along_dirs, out, NULL, NULL, NULL), SLT_OK);
        assert_int_equal(slt_estimate_reverse(&s.slt, &j, both, gradient, NULL, NULL, NULL), SLT_OK);
        for (int p = 0; p < 3; p++) {
            double sum = 0;
            for (int i = 0; i < PIXELS; i++) sum += (double)adjoint[i] * (double)image[p][i];
            near("gradient", filter, p, gradient[p], sum, 1e-4);
        }
        double stated[3];
        assert_int_equal(slt_estimate_reverse(&s.slt, &j, both, stated, error, NULL, NULL), SLT_OK);
        for (int p = 0; p < 3; p++) {
            near("gradient", filter, p, stated[p], gradient[p], 1e-9);
            assert_true(error[p] > 0 && error[p] < 0.1);
        }
    }
}

/* The loss is that of the exact image, and its gradient that of the loss. */
static void loss_of(SltFilter filter) {
    Scene s;
    float target[PIXELS], image[PIXELS];
    make(&s);
    for (int i = 0; i < PIXELS; i++) target[i] = (float)cos(0.4 * i);
    SltJob j = job_of(filter);
    double loss, gradient[3], sides[2], moved[3] = {disc[0], disc[1], disc[2]};
    assert_int_equal(slt_estimate_loss(&s.slt, &j, target, NULL, &loss, gradient, NULL, image, NULL, NULL), SLT_OK);
    double sum = 0;
    for (int i = 0; i < PIXELS; i++) sum += pow((double)image[i] - (double)target[i], 2) / PIXELS;
    near("loss", 0, 0, loss, sum, 1e-6);
    s.p = moved;
    for (int p = 0; p < 3; p++) {
        for (int k = 0; k < 2; k++) {
            moved[p] = disc[p] + (k ? 1e-3 : -1e-3);
            slt_estimate_loss(&s.slt, &j, target, NULL, &sides[k], NULL, NULL, NULL, NULL, NULL);
        }
        moved[p] = disc[p];
        near("gradient of the loss", p, 0, gradient[p], (sides[1] - sides[0]) / 2e-3, 2e-4);
    }
}

/* Out of the next tile in a few steps, and not far, wherever the border lies: from 0 units in the last place of x would
 * take for ever. */
static void into_a_tile(void **state) {
    (void)state;
    static const double lo[] = {-1, 0, -1e-6, 3, -1e9};
    for (int k = 0; k < 5; k++)
        for (int far = 0; far < 2; far++) {
            double width = k == 2 ? 2e-6 : 2, at = lo[k] + 0.5 * width;
            Grid g = {.dim = 1, .n = {128, 1, 1}, .lo = {lo[k]}, .hi = {lo[k] + width}, .side = {width / 128}};
            uint32_t from[3] = {far ? 64 : 0}, to[3] = {far ? 128 : 64};
            double x[3] = {far ? nextafter(at, -HUGE_VAL) : at};
            grid_into(&g, from, to, x);
            assert_true(grid_cell(&g, 0, x[0]) >= from[0] && grid_cell(&g, 0, x[0]) < to[0]);
            assert_true(fabs(x[0] - at) <= 8 * DBL_EPSILON * fmax(fabs(lo[k]), fabs(lo[k] + width)));
        }
}
static void a_loss(void **state) {
    (void)state;
    loss_of(SLT_FILTER_TENT);
}
static void a_loss_in_one_sweep(void **state) {
    (void)state;
    loss_of(SLT_FILTER_BOX);
}

int main(void) {
    for (int filter = 0; filter < 3; filter++)
        for (int i = 0; i < SIDE; i++) masses[filter][i] = mass((SltFilter)filter, i);
    const struct CMUnitTest tests[] = {cmocka_unit_test(pixels_are_exact),
                                       cmocka_unit_test(filters_keep_constants),
                                       cmocka_unit_test(derivative_images),
                                       cmocka_unit_test(gradient_of_an_image),
                                       cmocka_unit_test(an_error_is_reached),
                                       cmocka_unit_test(into_a_tile),
                                       cmocka_unit_test(a_loss),
                                       cmocka_unit_test(a_loss_in_one_sweep)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
