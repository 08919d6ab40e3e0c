/* Rows of the mipmap. Plain loops: the file's -m flags decide how wide they become. A NaN is never the larger one. */
#include <float.h>
#include <math.h>

#define LARGER(a, b) ((a) > (b) ? (a) : (b))

static inline void pairs_of_row(const float *restrict s, uint32_t w, float *restrict out) {
    const uint32_t whole = (w - 1) / 2;
    for (uint32_t i = 0; i < whole; i++) {
        float a = LARGER(s[2 * i], s[2 * i + 1]);
        out[i] = LARGER(a, s[2 * i + 2]);
    }
    if (!(w & 1)) out[whole] = LARGER(s[w - 2], s[w - 1]);
}

static float first_level32(const float *a, const float *b, const float *c, uint32_t w, float *restrict out,
                           float *restrict scratch) {
    enum { N = 16 };
    float most[N] = {0}, all = 0;
    uint32_t i = 0;
    for (; i + N <= w; i += N) {
        for (uint32_t n = 0; n < N; n++) {
            float x = a[i + n], y = b[i + n], z = c[i + n], m = -INFINITY, p;
            m = LARGER(x, m);
            m = LARGER(y, m);
            m = LARGER(z, m);
            scratch[i + n] = m;
            p = fabsf(x), p = p <= FLT_MAX ? p : 0, most[n] = LARGER(p, most[n]);
            p = fabsf(y), p = p <= FLT_MAX ? p : 0, most[n] = LARGER(p, most[n]);
            p = fabsf(z), p = p <= FLT_MAX ? p : 0, most[n] = LARGER(p, most[n]);
        }
    }
    for (; i < w; i++) {
        const float v[3] = {a[i], b[i], c[i]};
        float m = -INFINITY;
        for (int n = 0; n < 3; n++) {
            m = LARGER(v[n], m);
            float p = fabsf(v[n]);
            if (p <= FLT_MAX) all = LARGER(p, all);
        }
        scratch[i] = m;
    }
    pairs_of_row(scratch, w, out);
    for (uint32_t n = 0; n < N; n++) all = LARGER(most[n], all);
    return all;
}

/* The least float that is not below v, or the one after it. */
static inline float float_above(double v) {
    float f = (float)v, g = LARGER(f, -FLT_MAX);
    return (double)f < v ? g + (fabsf(g) * 0x1p-23f + FLT_MIN) : f;
}

static double first_level64(const double *a, const double *b, const double *c, uint32_t w, float *restrict out,
                            float *restrict scratch) {
    enum { N = 16 };
    double most[N] = {0}, all = 0;
    uint32_t i = 0;
    for (; i + N <= w; i += N) {
        for (uint32_t n = 0; n < N; n++) {
            double x = a[i + n], y = b[i + n], z = c[i + n], m = -INFINITY, p;
            m = LARGER(x, m);
            m = LARGER(y, m);
            m = LARGER(z, m);
            scratch[i + n] = float_above(m);
            p = fabs(x), p = p <= DBL_MAX ? p : 0, most[n] = LARGER(p, most[n]);
            p = fabs(y), p = p <= DBL_MAX ? p : 0, most[n] = LARGER(p, most[n]);
            p = fabs(z), p = p <= DBL_MAX ? p : 0, most[n] = LARGER(p, most[n]);
        }
    }
    for (; i < w; i++) {
        const double v[3] = {a[i], b[i], c[i]};
        double m = -INFINITY;
        for (int n = 0; n < 3; n++) {
            m = LARGER(v[n], m);
            double p = fabs(v[n]);
            if (p <= DBL_MAX) all = LARGER(p, all);
        }
        scratch[i] = float_above(m);
    }
    pairs_of_row(scratch, w, out);
    for (uint32_t n = 0; n < N; n++) all = LARGER(most[n], all);
    return all;
}

static void next_level(const float *a, const float *b, uint32_t w, float *restrict out) {
    const uint32_t whole = w / 2;
    for (uint32_t i = 0; i < whole; i++) {
        float x = LARGER(a[2 * i], a[2 * i + 1]), y = LARGER(b[2 * i], b[2 * i + 1]);
        out[i] = LARGER(x, y);
    }
    if (w & 1) out[whole] = LARGER(a[w - 1], b[w - 1]);
}
#undef LARGER
