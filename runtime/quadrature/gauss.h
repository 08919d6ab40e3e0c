/* Gauss-Legendre rules: n points that integrate polynomials of degree 2 n - 1 exactly. */
#ifndef SALTUS_QUADRATURE_GAUSS_H
#define SALTUS_QUADRATURE_GAUSS_H

#include <stdint.h>

enum { GAUSS_MAX = 16 };

typedef struct GaussRule {
    uint32_t n;
    double x[GAUSS_MAX], w[GAUSS_MAX]; /* places in (0, 1), ascending; weights, of sum 1 */
} GaussRule;

/* 1 <= n <= GAUSS_MAX */
void gauss_rule(GaussRule *r, uint32_t n);

#endif
