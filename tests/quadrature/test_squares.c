/* A length compared with what does not change with the position (variant_squares.c): the same numbers as its square
 * beside a square, and in f64 for as many evaluations, however it is written. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "tests/quadrature/integrate.h"

#define HEAD "param float2 c = float2(0.47, 0.52); param float r = 0.31; param float w = 0.04; param float n = -0.2;\n"
#define PLANE(body) HEAD "shader float main(float2 x) { float f = 0.0; float2 d = x - c; " body " return f; }"
#define SOLID(body)                                                                                                    \
    HEAD "shader float main(float3 x) { float f = 0.0; float3 d = x - float3(c, 0.5); " body " return f; }"

/* most: evaluations of the first to those of the second; 0: any. */
static const struct {
    const char *name, *length, *square;
    double most;
} pairs[] = {
    {"disc", PLANE("[Disc] if (length(d) < r) f = 1.0 + x.x;"), PLANE("[Disc] if (dot(d, d) < r * r) f = 1.0 + x.x;"),
     1.1},
    {"distance", PLANE("float s = distance(x, c) - r; [Disc] if (s < 0.0) f = 1.0 + x.x;"),
     PLANE("[Disc] if (dot(d, d) < r * r) f = 1.0 + x.x;"), 1.1},
    {"share of the radius", PLANE("[Disc] if (1.0 - length(d) / r >= 0.0) f = 1.0 + x.x;"),
     PLANE("[Disc] if (dot(d, d) < r * r) f = 1.0 + x.x;"), 1.1},
    {"outside", PLANE("[Disc] if (2.0 * length(d) + n > 2.0 * r) f = x.y;"),
     PLANE("[Disc] if (4.0 * dot(d, d) > (2.0 * r - n) * (2.0 * r - n)) f = x.y;"), 1.1},
    {"ellipse", PLANE("d.x += 0.3 * d.y; [Disc] if (length(d * float2(1.0, 1.7)) < r) f = x.y;"),
     PLANE("d.x += 0.3 * d.y; d.y *= 1.7; [Disc] if (dot(d, d) < r * r) f = x.y;"), 1.1},
    {"negative factor", PLANE("[Disc] if (n * length(d) > n * r) f = x.y;"),
     PLANE("[Disc] if (dot(d, d) < r * r) f = x.y;"), 1.1},
    {"negative level", PLANE("[Disc] if (length(d) < n) f = x.y; else f = r;"), PLANE("f = r;"), 0},
    {"negative divisor", PLANE("[Disc] if (length(d) / n > -1.0) f = x.y;"),
     PLANE("[Disc] if (dot(d, d) < n * n) f = x.y;"), 1.1},
    {"ring", PLANE("[Disc] if (abs(length(d) - r) < w) f = x.y;"),
     PLANE("[Disc] if (dot(d, d) < (r + w) * (r + w)) { [Disc] if (dot(d, d) > (r - w) * (r - w)) f = x.y; }"), 1.5},
    {"discs", PLANE("for (int i = 0; i < 5; i++) [Disc] if (length(d - w * float(i)) < r) f = x.y + float(i);"),
     PLANE("for (int i = 0; i < 5; i++) { float2 e = d - w * float(i); [Disc] if (dot(e, e) < r * r) f = x.y + "
           "float(i); }"),
     1.1},
    {"also a maximum",
     PLANE("float s = length(d) - r; [Disc] if (s < 0.0) f = 1.0 + max(s + w, 0.0); f += max(s, 0.0);"),
     PLANE("float s = length(d) - r; [Disc] if (dot(d, d) < r * r) f = 1.0 + max(s + w, 0.0); f += s * step(0.0, s);"),
     0},
    {"also a choice", PLANE("float s = length(d) - r; [Disc] if (s < 0.0) f = 1.0; f += s > 0.0 ? s * x.x : 0.0;"),
     PLANE("float s = length(d) - r; [Disc] if (dot(d, d) < r * r) f = 1.0; f += max(s, 0.0) * x.x;"), 0},
    {"sphere", SOLID("[Disc] if (length(d) < r) f = 1.0 + x.z;"), SOLID("[Disc] if (dot(d, d) < r * r) f = 1.0 + x.z;"),
     1.1},
};

/* bars: of the first. */
static void agree(const char *name, const Result *a, const Result *b, double bars) {
    if (!(fabs(a->value - b->value) <= bars * a->value_error + b->value_error))
        fail_msg("%s: %.9g +- %g and %.9g +- %g", name, a->value, a->value_error, b->value, b->value_error);
    for (uint32_t k = 0; k < a->n; k++)
        if (!(fabs(a->g[k] - b->g[k]) <= bars * a->error[k] + b->error[k] + 1e-14))
            fail_msg("%s: derivative %u: %g +- %g and %g +- %g", name, k, a->g[k], a->error[k], b->g[k], b->error[k]);
}

static void lengths_are_squares(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof pairs / sizeof *pairs; i++) {
        Result single = integrate("squares", pairs[i].length, false, 1e-4),
               length = integrate("squares", pairs[i].length, true, 1e-7),
               square = integrate("squares", pairs[i].square, true, 1e-7);
        double times = (double)length.stats.evaluations / (double)square.stats.evaluations;
        if (getenv("SALTUS_PRINT")) printf("    %s: %.2f times\n", pairs[i].name, times);
        agree(pairs[i].name, &length, &square, 1);
        agree(pairs[i].name, &single, &square, 2); /* rounding is estimated */
        if (pairs[i].most > 0 && !(times < pairs[i].most)) fail_msg("%s: %.2f times", pairs[i].name, times);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(lengths_are_squares)};
    return cmocka_run_group_tests_name("squares", tests, NULL, NULL);
}
