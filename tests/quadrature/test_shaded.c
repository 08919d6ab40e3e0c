/* Smooth shading between curves: it takes as many points as it needs and no more, whatever it hangs on, and what is
 * stated holds. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/quadrature/integrate.h"

#define BLOBS(k)                                                                                                       \
    "param float k = " #k "; param float level = 0.3; param float a = 0.5; param float none = 0.0;\n"                  \
    "[Domain(-1.0, 1.0)] shader float main(float2 x) { float f = 0.0;\n"                                               \
    "[Disc] if (sin(k * x.x) * sin(k * x.y) + level < 0.0) "

/* most: evaluations to 1e-9 of the largest component. */
static const struct {
    const char *name, *source;
    double most;
} cases[] = {
    {"constant", BLOBS(28.0) "f = 1.0; return f; }", 3.0e5},
    {"slow", BLOBS(28.0) "f = 1.0 + 0.5 * sin(3.0 * x.x) * cos(2.0 * x.y); return f; }", 7.8e5},
    {"its own parameter", BLOBS(9.0) "f = 1.0 + a * sin(3.0 * x.x) * cos(2.0 * x.y); return f; }", 5e5},
    {"constant, but no derivative is", BLOBS(9.0) "f = 1.0 + none * sin(9.0 * x.x) * x.y; return f; }", 1e6},
    {"of the level alone", BLOBS(9.0) "f = 1.0 + 0.5 * sin(k * x.x) * sin(k * x.y); return f; }", 5e5},
    {"fast", BLOBS(9.0) "f = 1.0 + a * sin(40.0 * x.x + 30.0 * x.y); return f; }", 1.5e6},
    {"a step", BLOBS(5.0) "f = 2.0 + tanh(60.0 * (x.x + 0.3 * x.y - 0.1)); return f; }", 2e6},
    {"both sides", BLOBS(9.0) "f = 1.0 + a * cos(3.0 * x.x + x.y); else f = 0.3 * exp(x.x * x.y); return f; }", 6e5},
};

static void as_many_points_as_it_needs(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        Result r = integrate("shaded", cases[i].source, true, 1e-9),
               fine = integrate("shaded", cases[i].source, true, 1e-11);
        double largest = 0;
        for (int k = 0; k < (int)fine.n; k++) largest = fmax(largest, fabs(fine.g[k]));
        if (getenv("SALTUS_PRINT"))
            printf("    %s: %llu evaluations, value %.2g, stated %.2g\n", cases[i].name,
                   (unsigned long long)r.stats.evaluations, r.value - fine.value, r.value_error);
        if (!((double)r.stats.evaluations < cases[i].most))
            fail_msg("%s: %llu evaluations", cases[i].name, (unsigned long long)r.stats.evaluations);
        if (!(fabs(r.value - fine.value) <= r.value_error + fine.value_error) || !(r.value_error < 1e-8))
            fail_msg("%s: value off by %g, stated %g", cases[i].name, r.value - fine.value, r.value_error);
        for (int k = 0; k < (int)fine.n; k++)
            if (!(fabs(r.g[k] - fine.g[k]) <= r.error[k] + fine.error[k]) || !(r.error[k] <= 1e-9 * largest))
                fail_msg("%s: derivative %d off by %g, stated %g", cases[i].name, k, r.g[k] - fine.g[k], r.error[k]);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(as_many_points_as_it_needs)};
    return cmocka_run_group_tests_name("shaded", tests, NULL, NULL);
}
