/* Roots of the Legendre polynomials by Newton's method, from Chebyshev's. */
#include <assert.h>
#include <math.h>

#include "runtime/quadrature/gauss.h"

#define PI 3.14159265358979323846

/* P_n(x), and its derivative in *d. */
static double legendre(uint32_t n, double x, double *d) {
    double before = 1, p = x;
    for (uint32_t k = 2; k <= n; k++) {
        double next = ((2 * k - 1) * x * p - (k - 1) * before) / k;
        before = p, p = next;
    }
    *d = n * (x * p - before) / (x * x - 1);
    return p;
}

void gauss_rule(GaussRule *r, uint32_t n) {
    assert(n >= 1 && n <= GAUSS_MAX);
    r->n = n;
    for (uint32_t i = 0; i < (n + 1) / 2; i++) {
        double x = cos(PI * (i + 0.75) / (n + 0.5)), d = 0;
        if (2 * i + 1 == n) x = 0;
        for (int step = 0; step < 8; step++) {
            double p = legendre(n, x, &d);
            x -= p / d;
        }
        legendre(n, x, &d);
        double w = 1 / ((1 - x * x) * d * d);
        r->x[i] = 0.5 - 0.5 * x, r->x[n - 1 - i] = 0.5 + 0.5 * x;
        r->w[i] = r->w[n - 1 - i] = w;
    }
}
