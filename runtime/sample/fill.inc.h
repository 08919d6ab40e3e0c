/* fill.h in vectors of as many 64-bit lanes as the instruction set has. Every operation rounds as IEEE says, and
 * nothing is fused, so all instruction sets agree. */
#include <math.h>
#include <string.h>
#if defined(__x86_64__)
#include <immintrin.h>
#endif

#include "runtime/sample/fill.h"

#if defined(__AVX512DQ__)
enum { LANES = 8 };
#elif defined(__AVX2__)
enum { LANES = 4 };
#else
enum { LANES = 2 };
#endif
#define INLINE static inline __attribute__((always_inline, unused))

typedef uint64_t U __attribute__((vector_size(8 * LANES)));
typedef int64_t L __attribute__((vector_size(8 * LANES)));
typedef double D __attribute__((vector_size(8 * LANES)));
typedef float F __attribute__((vector_size(4 * LANES)));
typedef uint32_t W __attribute__((vector_size(4 * LANES)));
typedef int32_t I __attribute__((vector_size(4 * LANES)));

#define LOAD(T, from)                                                                                                  \
    ({                                                                                                                 \
        T v_;                                                                                                          \
        memcpy(&v_, (from), sizeof v_);                                                                                \
        v_;                                                                                                            \
    })

INLINE D all(double x) { return x - (D){0}; }
INLINE U ramp(uint64_t step) {
    U v;
    for (int i = 0; i < LANES; i++) v[i] = (uint64_t)i * step;
    return v;
}

/* Of the lower halves. */
INLINE U product(U a, uint32_t m) {
#if defined(__AVX512DQ__)
    return (U)_mm512_mul_epu32((__m512i)a, _mm512_set1_epi64(m));
#elif defined(__AVX2__)
    return (U)_mm256_mul_epu32((__m256i)a, _mm256_set1_epi64x(m));
#elif defined(__SSE2__)
    return (U)_mm_mul_epu32((__m128i)a, _mm_set1_epi64x(m));
#else
    return (a & 0xffffffffu) * m;
#endif
}

/* Philox 4x32-10: words in the lower halves of lanes, whatever is in the upper ones. Two vectors of blocks side by
 * side: rounds are a chain, of which a processor holds too little to begin the next one in time. */
static void blocks(uint32_t seed, uint32_t purpose, uint32_t n, const uint32_t *lane, const uint64_t *counter,
                   uint64_t *const words[2]) {
    enum { ROUNDS = 10, SIDE_BY_SIDE = 2 };
    const uint32_t m0 = 0xD2511F53u, m1 = 0xCD9E8D57u, w0 = 0x9E3779B9u, w1 = 0xBB67AE85u;
    for (uint32_t i = 0; i < n; i += SIDE_BY_SIDE * LANES) {
        U a[SIDE_BY_SIDE], b[SIDE_BY_SIDE], c[SIDE_BY_SIDE], d[SIDE_BY_SIDE];
        for (uint32_t v = 0; v < SIDE_BY_SIDE; v++) {
            a[v] = LOAD(U, counter + i + v * LANES), b[v] = a[v] >> 32;
            c[v] = __builtin_convertvector(LOAD(W, lane + i + v * LANES), U), d[v] = (U){0};
        }
        uint32_t k0 = seed, k1 = purpose;
        for (int round = 0; round < ROUNDS; round++, k0 += w0, k1 += w1)
            for (uint32_t v = 0; v < SIDE_BY_SIDE; v++) {
                const U p = product(a[v], m0), q = product(c[v], m1);
                a[v] = q >> 32 ^ b[v] ^ k0, c[v] = p >> 32 ^ d[v] ^ k1;
                b[v] = q, d[v] = p;
            }
        for (uint32_t v = 0; v < SIDE_BY_SIDE; v++) {
            const U low = (a[v] & 0xffffffffu) | b[v] << 32, high = (c[v] & 0xffffffffu) | d[v] << 32;
            memcpy(words[0] + i + v * LANES, &low, sizeof low);
            memcpy(words[1] + i + v * LANES, &high, sizeof high);
        }
    }
}

/* The upper 53 bits as a fraction. */
INLINE D unit(U v) {
#if defined(__AVX512DQ__)
    return __builtin_convertvector(v >> 11, D) * 0x1p-53;
#else
    /* As mantissas of 2^20 + a and 0.5 + b: nothing here rounds. */
    const D a = (D)(v >> 32 | 0x4130000000000000u), b = (D)((v >> 11 & 0x1fffffu) | 0x3fe0000000000000u);
    return (a - 0x1p20) + (b - 0.5);
#endif
}

INLINE D either(L mask, D a, D b) { return (D)((mask & (L)a) | (~mask & (L)b)); }
INLINE D root(D x) {
    D r;
    for (int i = 0; i < LANES; i++) r[i] = sqrt(x[i]);
    return r;
}

INLINE U bits_of(D x) { return (U)x; }
INLINE D with_bits(U bits) { return (D)bits; }
#include "runtime/sample/quantile.inc.h"

INLINE D tent_quantile(D q) {
    const L left = q < 0.5;
    const D r = root(either(left, 2 * q, 2 * (1 - q)));
    return either(left, r - 1, 1 - r);
}

/* grid_place_filtered, in pixels from the middle of the pixel. */
INLINE D in_filter(SltFilter filter, double radius, double n, D u, D p, D before, D mass) {
    const D middle = p + 0.5, from = either(-middle > -radius, -middle, all(-radius)),
            to = either(n - middle < radius, n - middle, all(radius)), q = before + u * mass,
            v = filter == SLT_FILTER_TENT ? tent_quantile(q) : gaussian_quantile(q);
    return either(v < from, from, either(v > to, to, v));
}

INLINE bool are_alike(const uint32_t *count, uint32_t n) {
    for (uint32_t k = 1; k < n; k++)
        if (count[k] != *count) return false;
    return true;
}

INLINE D placed(const FillAxis *a, SltFilter filter, D u, D p, D before, D mass) {
    const D v = filter == SLT_FILTER_BOX ? p + u : p + 0.5 + in_filter(filter, a->radius, a->n, u, p, before, mass);
    return a->lo + v * a->side;
}

INLINE void put(bool f64, D x, void *to, uint32_t at) {
    if (f64) {
        memcpy((double *)to + at, &x, sizeof x);
    } else {
        const F narrow = __builtin_convertvector(x, F);
        memcpy((float *)to + at, &narrow, sizeof narrow);
    }
}

/* The first numbers, several times each. */
#if defined(__AVX512DQ__)
#define TWICE(v) __builtin_shufflevector(v, v, 0, 0, 1, 1, 2, 2, 3, 3)
#define FOUR_TIMES(v) __builtin_shufflevector(v, v, 0, 0, 0, 0, 1, 1, 1, 1)
#elif defined(__AVX2__)
#define TWICE(v) __builtin_shufflevector(v, v, 0, 0, 1, 1)
#define FOUR_TIMES(v) (v)
#else
#define TWICE(v) (v)
#define FOUR_TIMES(v) (v)
#endif

INLINE void place_as(const FillAxis *given, SltFilter filter, bool f64, uint32_t runs, const uint32_t *count,
                     const uint64_t *start, const int32_t *cell, void *x) {
    const FillAxis a = *given;
    const bool box = filter == SLT_FILTER_BOX;
    if (!count) {
        for (uint32_t r = 0; r < runs; r += LANES) {
            const D u = unit(LOAD(U, start + r)), p = __builtin_convertvector(LOAD(I, cell + r), D);
            D before = {0}, mass = {0};
            for (int i = 0; !box && i < LANES; i++) {
                const uint32_t at = r + (uint32_t)i < runs ? (uint32_t)cell[r + (uint32_t)i] : 0;
                before[i] = a.before[at], mass[i] = a.mass[at];
            }
            put(f64, placed(&a, filter, u, p, before, mass), x, r);
        }
        return;
    }
    /* Of few samples each, several runs share a vector. */
    const uint32_t few = runs && (*count == 2 || *count == 4) && *count < LANES ? *count : 0,
                   many = few ? LANES / few : 1;
    const U first = ramp(a.step), of_run = ramp(1) >> (few == 4 ? 2 : 1), of_few = first - of_run * (few * a.step);
    const uint64_t step = LANES * a.step;
    for (uint32_t r = 0, at = 0; r < runs;) {
        const uint32_t n = count[r];
        if (n == few && r + many <= runs && are_alike(count + r, many)) {
            const U begins = LOAD(U, start + r), s = (few == 4 ? FOUR_TIMES(begins) : TWICE(begins)) + of_few;
            const D at_run = __builtin_convertvector(LOAD(I, cell + r), D),
                    p = few == 4 ? FOUR_TIMES(at_run) : TWICE(at_run);
            D before = {0}, mass = {0};
            for (uint32_t i = 0; !box && i < LANES; i++) {
                const uint32_t in = (uint32_t)cell[r + i / few];
                before[i] = a.before[in], mass[i] = a.mass[in];
            }
            put(f64, placed(&a, filter, unit(s), p, before, mass), x, at);
            r += many, at += LANES;
            continue;
        }
        const D p = all((double)cell[r]), before = all(box ? 0 : a.before[cell[r]]),
                mass = all(box ? 0 : a.mass[cell[r]]);
        U s = start[r] + first;
        for (uint32_t i = 0; i < n; i += LANES, s += step)
            put(f64, placed(&a, filter, unit(s), p, before, mass), x, at + i);
        r++, at += n;
    }
}

static void place(const FillAxis *a, uint32_t runs, const uint32_t *count, const uint64_t *start, const int32_t *cell,
                  void *x) {
#define AS(filter)                                                                                                     \
    case filter:                                                                                                       \
        if (a->f64) place_as(a, filter, true, runs, count, start, cell, x);                                            \
        else place_as(a, filter, false, runs, count, start, cell, x);                                                  \
        break
    switch (a->filter) {
        AS(SLT_FILTER_BOX);
        AS(SLT_FILTER_TENT);
        AS(SLT_FILTER_GAUSSIAN);
    }
}

static void spread(uint32_t runs, const uint32_t *count, const void *values, uint32_t step, void *words) {
    const unsigned char *value = values;
    uint32_t *to = words;
    typedef uint32_t V __attribute__((vector_size(8 * LANES)));
    V first;
    for (uint32_t i = 0; i < 2 * LANES; i++) first[i] = i * step;
    for (uint32_t r = 0; r < runs; to += count[r++]) {
        uint32_t word;
        memcpy(&word, value + r * sizeof word, sizeof word);
        V v = word + first;
        for (uint32_t i = 0; i < count[r]; i += 2 * LANES, v += 2 * LANES * step) memcpy(to + i, &v, sizeof v);
    }
}

#define SUM_SINGLE(name, T)                                                                                            \
    static void name(const T *f, uint32_t runs, double *to, uint32_t stride) {                                        \
        if (stride == 1)                                                                                               \
            for (uint32_t r = 0; r < runs; r++) to[r] += (double)f[r];                                                 \
        else                                                                                                           \
            for (uint32_t r = 0; r < runs; r++) to[(uint64_t)r * stride] += (double)f[r];                              \
    }
SUM_SINGLE(sum_single_f32, float)
SUM_SINGLE(sum_single_f64, double)

/* One run a lane. */
enum { RUNS = LANES < 4 ? 4 : LANES };
typedef float F4 __attribute__((vector_size(16)));
typedef float FR __attribute__((vector_size(4 * RUNS)));
typedef double DR __attribute__((vector_size(8 * RUNS)));

INLINE DR widened(FR x) {
#if defined(__AVX512DQ__)
    return (DR)_mm512_cvtps_pd((__m256)x); /* compilers take __builtin_convertvector apart */
#elif defined(__AVX2__)
    return (DR)_mm256_cvtps_pd((__m128)x);
#else
    return __builtin_convertvector(x, DR);
#endif
}

#if defined(__AVX512DQ__)
/* Four numbers of a run, and four of the fourth one behind it; of two such the first of both, or the last. */
#define QUADS(f, n) __builtin_shufflevector(LOAD(F4, f), LOAD(F4, (f) + 4 * (n)), 0, 1, 2, 3, 4, 5, 6, 7)
#define ZIP_LOW(a, b) __builtin_shufflevector(a, b, 0, 8, 1, 9, 4, 12, 5, 13)
#define ZIP_HIGH(a, b) __builtin_shufflevector(a, b, 2, 10, 3, 11, 6, 14, 7, 15)
#define JOIN_LOW(a, b) __builtin_shufflevector(a, b, 0, 1, 8, 9, 4, 5, 12, 13)
#define JOIN_HIGH(a, b) __builtin_shufflevector(a, b, 2, 3, 10, 11, 6, 7, 14, 15)
#define EVEN(a, b) __builtin_shufflevector(a, b, 0, 2, 4, 6, 8, 10, 12, 14)
#define ODD(a, b) __builtin_shufflevector(a, b, 1, 3, 5, 7, 9, 11, 13, 15)
#else
#define QUADS(f, n) LOAD(F4, f)
#define ZIP_LOW(a, b) __builtin_shufflevector(a, b, 0, 4, 1, 5)
#define ZIP_HIGH(a, b) __builtin_shufflevector(a, b, 2, 6, 3, 7)
#define JOIN_LOW(a, b) __builtin_shufflevector(a, b, 0, 1, 4, 5)
#define JOIN_HIGH(a, b) __builtin_shufflevector(a, b, 2, 3, 6, 7)
#define EVEN(a, b) __builtin_shufflevector(a, b, 0, 2, 4, 6)
#define ODD(a, b) __builtin_shufflevector(a, b, 1, 3, 5, 7)
#endif

INLINE DR sums_at(const double *to, uint32_t stride) {
    if (stride == 1) return LOAD(DR, to);
    DR sum;
    for (uint32_t k = 0; k < RUNS; k++) sum[k] = to[k * stride];
    return sum;
}
INLINE void put_sums(DR sum, double *to, uint32_t stride) {
    if (stride == 1) memcpy(to, &sum, sizeof sum);
    else
        for (uint32_t k = 0; k < RUNS; k++) to[k * stride] = sum[k];
}

/* Of as many runs at a time as there are lanes: each is a chain of additions that wait for each other. */
static void sum_f32(const float *f, uint32_t runs, const uint32_t *count, double *to, uint32_t stride) {
    enum { FOUR = 4 };
    uint32_t r = 0;
    if (!count) {
        sum_single_f32(f, runs, to, stride);
        return;
    }
    while (r < runs) {
        const uint32_t n = count[r];
        if (n >= FOUR && r + RUNS <= runs && are_alike(count + r, RUNS)) {
            DR sum = sums_at(to, stride);
            uint32_t i = 0;
            for (; i + FOUR <= n; i += FOUR) {
                const FR a = QUADS(f + i, n), b = QUADS(f + n + i, n), c = QUADS(f + 2 * n + i, n),
                         d = QUADS(f + 3 * n + i, n);
                const FR ab = ZIP_LOW(a, b), cd = ZIP_LOW(c, d), ba = ZIP_HIGH(a, b), dc = ZIP_HIGH(c, d);
                sum += widened(JOIN_LOW(ab, cd));
                sum += widened(JOIN_HIGH(ab, cd));
                sum += widened(JOIN_LOW(ba, dc));
                sum += widened(JOIN_HIGH(ba, dc));
            }
            for (; i < n; i++)
                for (uint32_t k = 0; k < RUNS; k++) sum[k] += (double)f[k * n + i];
            put_sums(sum, to, stride);
            f += RUNS * n, to += RUNS * stride, r += RUNS;
            continue;
        }
        if (n == 2 && r + RUNS <= runs && are_alike(count + r, RUNS)) {
            const FR a = LOAD(FR, f), b = LOAD(FR, f + RUNS);
            put_sums(sums_at(to, stride) + widened(EVEN(a, b)) + widened(ODD(a, b)), to, stride);
            f += RUNS * n, to += RUNS * stride, r += RUNS;
            continue;
        }
        double sum = *to;
        for (uint32_t i = 0; i < n; i++) sum += (double)f[i];
        *to = sum, f += n, to += stride, r++;
    }
}

static void sum_f64(const double *f, uint32_t runs, const uint32_t *count, double *to, uint32_t stride) {
    if (!count) {
        sum_single_f64(f, runs, to, stride);
        return;
    }
    for (uint32_t r = 0; r < runs; f += count[r++], to += stride) {
        double sum = *to;
        for (uint32_t i = 0; i < count[r]; i++) sum += f[i];
        *to = sum;
    }
}

/* Of a power of two the reciprocal is exact, and so is what a product with it rounds to. */
static void mean(const double *sum, uint64_t n, uint32_t count, float *to) {
    const double by = count, part = 1 / by;
    if (count & (count - 1))
        for (uint64_t i = 0; i < n; i++) to[i] = (float)(sum[i] / by);
    else
        for (uint64_t i = 0; i < n; i++) to[i] = (float)(sum[i] * part);
}

/* The sum is a chain, so what can go side by side is a loop of its own. */
#define RESIDUALS(name, weighed, halves)                                                                               \
    static double name(float *restrict half0, float *restrict half1, const float *restrict target,                     \
                       const float *restrict mask, uint64_t n, double numbers) {                                       \
        double sum = 0;                                                                                                \
        for (uint64_t i = 0; i < n; i++) {                                                                             \
            const double m = weighed ? (double)mask[i] : 1, a = (double)half0[i] - (double)target[i],                  \
                         b = halves ? (double)half1[i] - (double)target[i] : a;                                        \
            sum += m * a * b;                                                                                          \
        }                                                                                                              \
        for (uint64_t i = 0; i < n; i++) {                                                                             \
            const double m = weighed ? (double)mask[i] : 1, a = (double)half0[i] - (double)target[i],                  \
                         b = halves ? (double)half1[i] - (double)target[i] : a;                                        \
            half0[i] = pixel_loss_adjoint(b, m, numbers);                                                              \
            if (halves) half1[i] = pixel_loss_adjoint(a, m, numbers);                                                  \
        }                                                                                                              \
        return sum;                                                                                                    \
    }
RESIDUALS(residuals_of_halves, false, true)
RESIDUALS(residuals_of_masked_halves, true, true)
RESIDUALS(residuals_of_one, false, false)
RESIDUALS(residuals_of_masked, true, false)

static double residuals(float *half0, float *half1, const float *target, const float *mask, uint64_t n,
                        double numbers) {
    if (half1) return (mask ? residuals_of_masked_halves : residuals_of_halves)(half0, half1, target, mask, n, numbers);
    return (mask ? residuals_of_masked : residuals_of_one)(half0, half1, target, mask, n, numbers);
}

#include "runtime/sample/roots.inc.h"

static uint64_t zeros(const void *v, uint64_t bytes) {
    enum { LINE = 64, LONG = 8 * LINE };
    const unsigned char *from = v;
    uint64_t at = 0;
    for (; at + LONG <= bytes; at += LONG) {
        U any = {0};
        for (uint32_t k = 0; k < LONG; k += sizeof any) any |= LOAD(U, from + at + k);
        uint64_t one = 0;
        for (int i = 0; i < LANES; i++) one |= any[i];
        if (one) break;
    }
    for (; at < bytes; at += LINE) {
        uint64_t n = bytes - at < LINE ? bytes - at : LINE;
        unsigned char one = 0;
        for (uint64_t k = 0; k < n; k++) one |= from[at + k];
        if (one) return at;
    }
    return bytes;
}

/* Not finite: the exponent is all ones. Of both precisions' numbers, as integers of theirs. */
#define IS_FINITE(name, V, N, ones)                                                                                    \
    static bool name(const unsigned char *v, uint64_t bytes) {                                                         \
        enum { FOUR = 4 };                                                                                             \
        const V mask = (V){0} + (ones);                                                                                \
        uint64_t at = 0;                                                                                               \
        V any = {0};                                                                                                   \
        for (; at + FOUR * sizeof any <= bytes; at += FOUR * sizeof any)                                               \
            for (uint32_t k = 0; k < FOUR; k++) any |= (V)((LOAD(V, v + at + k * sizeof any) & mask) == mask);         \
        for (N one; at < bytes; at += sizeof one) {                                                                    \
            memcpy(&one, v + at, sizeof one);                                                                          \
            any[0] |= (N) - ((one & (ones)) == (ones));                                                                \
        }                                                                                                              \
        N all = 0;                                                                                                     \
        for (uint32_t k = 0; k < sizeof any / sizeof all; k++) all |= any[k];                                          \
        return !all;                                                                                                   \
    }
typedef uint32_t W2 __attribute__((vector_size(8 * LANES)));
IS_FINITE(is_finite_f32, W2, uint32_t, UINT32_C(0x7f8) << 20)
IS_FINITE(is_finite_f64, U, uint64_t, UINT64_C(0x7ff) << 52)

static bool all_finite(const void *v, uint64_t bytes, bool f64) {
    return f64 ? is_finite_f64(v, bytes) : is_finite_f32(v, bytes);
}
