/* (I + lambda L)^-1 on a grid, factorised once with LDL under an AMD ordering. */
#include "optimise.h"

#include <limits.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#if defined(__has_include) && __has_include(<suitesparse/ldl.h>)
#include <suitesparse/amd.h>
#include <suitesparse/ldl.h>
#else
#include <amd.h>
#include <ldl.h>
#endif

enum { MAX_CELLS = 1 << 22 };

struct Laplacian {
    int width, height, n;
    int *perm, *lp, *li;
    double *lx, *d;
};

/* Column-compressed matrix and the work space of the factorisation. */
typedef struct Build {
    int *ap, *ai, *parent, *lnz, *flag, *pattern, *inverse;
    double *ax, *y;
} Build;

static void fill_matrix(const Laplacian *l, double lambda, Build *b) {
    int at = 0;
    for (int i = 0; i < l->n; i++) {
        int x = i % l->width, y = i / l->width, diagonal = 0, degree = 0;
        b->ap[i] = at;
        const int neighbour[4] = {y > 0 ? i - l->width : -1, x > 0 ? i - 1 : -1,
                                  x + 1 < l->width ? i + 1 : -1,
                                  y + 1 < l->height ? i + l->width : -1};
        for (int k = 0; k < 4; k++) { /* rows ascend: two before the diagonal, two after */
            if (k == 2) {
                diagonal = at;
                b->ai[at++] = i;
            }
            if (neighbour[k] >= 0) {
                b->ai[at] = neighbour[k];
                b->ax[at++] = -lambda;
                degree++;
            }
        }
        b->ax[diagonal] = 1 + lambda * degree;
    }
    b->ap[l->n] = at;
}

static SltStatus factorise(Laplacian *l, Build *b, SltError *err) {
    size_t n = (size_t)l->n;
    if (amd_order(l->n, b->ap, b->ai, l->perm, NULL, NULL) < AMD_OK) {
        return status_fail(err, SLT_LIMIT, "out of memory for the Laplacian of %d x %d cells",
                           l->width, l->height);
    }
    ldl_symbolic(l->n, b->ap, b->ai, l->lp, b->parent, b->lnz, b->flag, l->perm, b->inverse);
    double total = 0; /* lp would wrap around before malloc could refuse */
    for (size_t i = 0; i < n; i++) {
        total += b->lnz[i];
    }
    if (total > INT_MAX) {
        return status_fail(err, SLT_LIMIT, "the Laplacian of %d x %d cells is too large", l->width,
                           l->height);
    }
    l->li = malloc(((size_t)total + 1) * sizeof *l->li);
    l->lx = malloc(((size_t)total + 1) * sizeof *l->lx);
    if (!l->li || !l->lx) {
        return status_fail(err, SLT_LIMIT, "out of memory for the Laplacian of %d x %d cells",
                           l->width, l->height);
    }
    int rank = ldl_numeric(l->n, b->ap, b->ai, b->ax, l->lp, b->parent, b->lnz, l->li, l->lx, l->d,
                           b->y, b->pattern, b->flag, l->perm, b->inverse);
    if (rank != l->n) { /* cannot be: the matrix is diagonally dominant */
        return status_fail(err, SLT_INTERNAL, "the Laplacian of %d x %d cells is singular",
                           l->width, l->height);
    }
    return SLT_OK;
}

Laplacian *laplacian_create(int width, int height, double lambda, SltError *err) {
    if (width < 1 || height < 1 || !(lambda >= 0) || isinf(lambda)) {
        status_fail(err, SLT_USAGE, "a Laplacian of %d x %d cells with lambda %g", width, height,
                    lambda);
        return NULL;
    }
    if ((double)width * height > MAX_CELLS) {
        status_fail(err, SLT_LIMIT,
                    "a grid of %d x %d cells is too large for Laplacian smoothing (at most 2^22)",
                    width, height);
        return NULL;
    }
    Laplacian *l = calloc(1, sizeof *l);
    Build b = {0};
    size_t n = (size_t)width * (size_t)height;
    if (l) {
        *l = (Laplacian){.width = width, .height = height, .n = (int)n};
        l->perm = malloc(n * sizeof *l->perm);
        l->lp = malloc((n + 1) * sizeof *l->lp);
        l->d = malloc(n * sizeof *l->d);
        int **const ints[] = {&b.ap, &b.ai, &b.parent, &b.lnz, &b.flag, &b.pattern, &b.inverse};
        bool ok = l->perm && l->lp && l->d;
        for (int i = 0; i < 7; i++) {
            *ints[i] = malloc((i == 1 ? 5 * n : n + 1) * sizeof(int));
            ok = ok && *ints[i];
        }
        b.ax = malloc(5 * n * sizeof *b.ax);
        b.y = malloc(n * sizeof *b.y);
        SltStatus status;
        if (ok && b.ax && b.y) {
            fill_matrix(l, lambda, &b);
            status = factorise(l, &b, err);
        } else {
            status = status_fail(err, SLT_LIMIT, "out of memory for the Laplacian of %d x %d cells",
                                 width, height);
        }
        for (int i = 0; i < 7; i++) {
            free(*ints[i]);
        }
        free(b.ax);
        free(b.y);
        if (status != SLT_OK) {
            laplacian_free(l);
            l = NULL;
        }
    } else {
        status_fail(err, SLT_LIMIT, "out of memory");
    }
    return l;
}

void laplacian_free(Laplacian *l) {
    if (l) {
        free(l->perm);
        free(l->lp);
        free(l->li);
        free(l->lx);
        free(l->d);
        free(l);
    }
}

void laplacian_solve(const Laplacian *l, double *data, size_t stride_x, size_t stride_y,
                     double *scratch) {
    size_t n = (size_t)l->n, width = (size_t)l->width;
    double *b = scratch, *x = scratch + n;
    for (size_t i = 0; i < n; i++) {
        b[i] = data[i % width * stride_x + i / width * stride_y];
    }
    ldl_perm(l->n, x, b, l->perm);
    ldl_lsolve(l->n, x, l->lp, l->li, l->lx);
    ldl_dsolve(l->n, x, l->d);
    ldl_ltsolve(l->n, x, l->lp, l->li, l->lx);
    ldl_permt(l->n, b, x, l->perm);
    for (size_t i = 0; i < n; i++) {
        data[i % width * stride_x + i / width * stride_y] = b[i];
    }
}
