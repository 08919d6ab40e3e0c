/* (I + lambda L)^-1 on a grid, exactly, in O(n log n): L, the graph Laplacian of the grid's four-neighbourhood, is Lx
 * (x) I + I (x) Ly, and the cosines of the DCT-II are the eigenvectors of Lx. So rows are transformed, every frequency
 * is left with a tridiagonal system down its column, and rows are transformed back. A sparse
 * factorisation of the same matrix (LDL under AMD) takes 15 s at 1024 x 1024, and its solves ten times as long
 * (docs/performance.md). */
#include "optimise.h"

#include <complex.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_CELLS = 1 << 22 };
#define PI 3.14159265358979323846
#ifndef CMPLX /* glibc's header has it for gcc only */
#define CMPLX(re, im) __builtin_complex((double)(re), (double)(im))
#endif

typedef double complex cplx;

/* A transform of any length n: of length m = n by halving if n is a power of two, else as a convolution of length m >=
 * 2n - 1 (Bluestein 1970). */
typedef struct Dft {
    uint32_t n, m;
    cplx *root;           /* exp(-2 pi i k / m), k < m/2 */
    cplx *chirp, *kernel; /* exp(-pi i k^2 / n), and the transform of its conjugate; NULL where m = n */
} Dft;

struct Laplacian {
    uint32_t width, height;
    Dft dft;
    cplx *shift; /* exp(-pi i k / 2 width): from the DFT of a row to its DCT */
    double *off,
        *inverse; /* [height][width]: the tridiagonal systems, eliminated: multiplier of the row above, 1 / pivot */
    double lambda;
    cplx *row; /* two rows, and the work of their transform */
};

/* Stockham's radix 2: no bit reversal, every pass runs along memory. Result in a; b is scratch. */
static void fft(const Dft *d, cplx *a, cplx *b) {
    cplx *from = a, *to = b;
    for (uint32_t half = d->m / 2, stride = 1; half >= 1; half /= 2, stride *= 2) {
        for (uint32_t p = 0; p < half; p++) {
            cplx w = d->root[p * stride];
            double wr = creal(w), wi = cimag(w);
            for (uint32_t q = 0; q < stride; q++) {
                cplx x = from[q + stride * p], y = from[q + stride * (p + half)], e = x - y;
                to[q + stride * 2 * p] = x + y;
                to[q + stride * (2 * p + 1)] = CMPLX(creal(e) * wr - cimag(e) * wi, creal(e) * wi + cimag(e) * wr);
            }
        }
        cplx *swap = from;
        from = to, to = swap;
    }
    if (from != a) memcpy(a, from, d->m * sizeof *a);
}

static cplx times(cplx x, cplx y) {
    return CMPLX(creal(x) * creal(y) - cimag(x) * cimag(y), creal(x) * cimag(y) + cimag(x) * creal(y));
}

/* z[0..n) in place; work has 2 m. */
static void dft(const Dft *d, cplx *z, cplx *work) {
    if (!d->chirp) {
        fft(d, z, work);
        return;
    }
    cplx *a = work, *b = work + d->m;
    for (uint32_t k = 0; k < d->m; k++) a[k] = k < d->n ? times(z[k], d->chirp[k]) : 0;
    fft(d, a, b);
    for (uint32_t k = 0; k < d->m; k++) a[k] = conj(times(a[k], d->kernel[k])); /* the inverse by two conjugations */
    fft(d, a, b);
    for (uint32_t k = 0; k < d->n; k++) z[k] = times(conj(a[k]), d->chirp[k]) / d->m;
}

static bool dft_init(Dft *d, uint32_t n) {
    bool power = (n & (n - 1)) == 0;
    d->n = n, d->m = 1;
    while (d->m < (power ? n : 2 * n - 1)) d->m *= 2;
    d->root = malloc((d->m / 2 + 1) * sizeof *d->root);
    if (!d->root) return false;
    for (uint32_t k = 0; k < d->m / 2 + 1; k++) d->root[k] = cexp(-2 * PI * I * k / d->m);
    if (power) return true;
    d->chirp = malloc(n * sizeof *d->chirp), d->kernel = calloc(d->m, sizeof *d->kernel);
    cplx *work = malloc(d->m * sizeof *work);
    if (d->chirp && d->kernel && work) {
        for (uint32_t k = 0; k < n; k++) {
            d->chirp[k] = cexp(-PI * I * (double)((uint64_t)k * k % (2 * (uint64_t)n)) / n);
            d->kernel[k] = conj(d->chirp[k]);
            if (k) d->kernel[d->m - k] = d->kernel[k];
        }
        fft(d, d->kernel, work);
    }
    free(work);
    return d->chirp && d->kernel && work;
}

/* ---- rows, two at a time as the two parts of one complex sequence; the even samples first, then the odd ones
 * backwards (Makhoul 1980) */
typedef struct Rows {
    const Laplacian *l;
    double *u, *v; /* v may be u: a single row */
    cplx *z, *work;
} Rows;

static void forward(const Rows *r) {
    uint32_t n = r->l->width;
    for (uint32_t i = 0; i < n; i++) {
        uint32_t to = i % 2 ? n - 1 - i / 2 : i / 2;
        r->z[to] = CMPLX(r->u[i], r->v[i]);
    }
    dft(&r->l->dft, r->z, r->work);
    for (uint32_t k = 0; k < n; k++) {
        cplx a = r->z[k], b = conj(r->z[k ? n - k : 0]);
        cplx u = 0.5 * (a + b), v = times(a - b, CMPLX(0, -0.5));
        r->u[k] = creal(times(u, r->l->shift[k]));
        r->v[k] = creal(times(v, r->l->shift[k]));
    }
}

static void backward(const Rows *r) {
    uint32_t n = r->l->width;
    for (uint32_t k = 0; k < n; k++) {
        /* X[k] and X[n - k] are the parts of one Fourier coefficient; its conjugate, so that the same transform goes
         * back. */
        cplx s = conj(r->l->shift[k]);
        cplx u = times(s, CMPLX(r->u[k], k ? -r->u[n - k] : 0)), v = times(s, CMPLX(r->v[k], k ? -r->v[n - k] : 0));
        r->z[k] = conj(u + times(v, CMPLX(0, 1)));
    }
    dft(&r->l->dft, r->z, r->work);
    for (uint32_t i = 0; i < n; i++) {
        cplx x = r->z[i % 2 ? n - 1 - i / 2 : i / 2];
        r->u[i] = creal(x) / n;
        r->v[i] = -cimag(x) / n;
    }
}

static void transform(const Laplacian *l, double *b, void (*f)(const Rows *), cplx *z) {
    for (uint32_t y = 0; y < l->height; y += 2) {
        double *u = b + (size_t)y * l->width;
        f(&(Rows){l, u, y + 1 < l->height ? u + l->width : u, z, z + l->width});
    }
}

/* ---- columns: (1 + lambda (mu_k + degree)) on the diagonal, -lambda beside it */
static void eliminate(Laplacian *l) {
    for (uint32_t y = 0; y < l->height; y++)
        for (uint32_t k = 0; k < l->width; k++) {
            size_t i = (size_t)y * l->width + k;
            double s = sin(PI * k / (2.0 * l->width)), degree = (y > 0) + (y + 1 < l->height);
            double pivot = 1 + l->lambda * (4 * s * s + degree);
            l->off[i] = y ? -l->lambda * l->inverse[i - l->width] : 0;
            l->inverse[i] = 1 / (pivot + l->lambda * l->off[i]);
        }
}

static void solve_columns(const Laplacian *l, double *b) {
    size_t w = l->width, n = w * l->height;
    for (size_t i = w; i < n; i++) b[i] -= l->off[i] * b[i - w];
    for (size_t k = 0; k < w; k++) b[n - w + k] *= l->inverse[n - w + k];
    for (size_t i = n - w; i-- > 0;) b[i] = (b[i] + l->lambda * b[i + w]) * l->inverse[i];
}

Laplacian *laplacian_create(int width, int height, double lambda, SltError *err) {
    if (width < 1 || height < 1 || !(lambda >= 0) || isinf(lambda)) {
        status_fail(err, SLT_USAGE, "a Laplacian of %d x %d cells with lambda %g", width, height, lambda);
        return NULL;
    }
    if ((double)width * height > MAX_CELLS) {
        status_fail(err, SLT_LIMIT, "a grid of %d x %d cells is too large for Laplacian smoothing (at most 2^22)",
                    width, height);
        return NULL;
    }
    Laplacian *l = calloc(1, sizeof *l);
    size_t n = (size_t)width * (size_t)height;
    if (l) {
        l->width = (uint32_t)width, l->height = (uint32_t)height, l->lambda = lambda;
        l->shift = malloc((size_t)width * sizeof *l->shift);
        l->off = malloc(n * sizeof *l->off), l->inverse = malloc(n * sizeof *l->inverse);
        bool ok = dft_init(&l->dft, l->width);
        l->row = malloc((l->width + 2 * (size_t)l->dft.m) * sizeof *l->row);
        if (ok && l->row && l->shift && l->off && l->inverse) {
            for (int k = 0; k < width; k++) l->shift[k] = cexp(-PI * I * k / (2.0 * width));
            eliminate(l);
            return l;
        }
    }
    laplacian_free(l);
    status_fail(err, SLT_LIMIT, "out of memory for the Laplacian of %d x %d cells", width, height);
    return NULL;
}

void laplacian_free(Laplacian *l) {
    if (!l) return;
    free(l->dft.root), free(l->dft.chirp), free(l->dft.kernel);
    free(l->shift), free(l->off), free(l->inverse), free(l->row);
    free(l);
}

void laplacian_solve(Laplacian *l, double *data, size_t stride_x, size_t stride_y, double *scratch) {
    double *b = scratch;
    for (uint32_t y = 0; y < l->height; y++)
        for (uint32_t x = 0; x < l->width; x++) b[(size_t)y * l->width + x] = data[x * stride_x + y * stride_y];
    transform(l, b, forward, l->row);
    solve_columns(l, b);
    transform(l, b, backward, l->row);
    for (uint32_t y = 0; y < l->height; y++)
        for (uint32_t x = 0; x < l->width; x++) data[x * stride_x + y * stride_y] = b[(size_t)y * l->width + x];
}
