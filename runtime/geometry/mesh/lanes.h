/* Lanes in the vector extensions of C; what an instruction set lacks compilers write in parts. Every operation rounds
 * as IEEE says, so all instruction sets agree bit for bit.
 *
 *   F8, D8  eight floats or doubles     F16  sixteen floats
 *   lower(a, b)  a < b ? a : b          higher(a, b)  a > b ? a : b     so where either is NaN: b
 *   chosen(m, a, b)  bit k of m ? a[k] : b[k]             least_of(a)  the least lane
 *   either(m, a, b)  the same of Many, m of lanes_not_0
 *   less(a, b)   bit k: a[k] < b[k]     upto(a, b)    bit k: a[k] <= b[k]
 *   under(a, b)  a < b, as vectors compare
 *
 *   Some         as many doubles as a register holds: of wider vectors compilers keep parts in memory
 *
 * Functions are always inlined: no vector is passed by an ABI. */
#ifndef SALTUS_MESH_LANES_H
#define SALTUS_MESH_LANES_H

#include <stdbool.h>
#include <stdint.h>
#include <string.h>
#if defined(__x86_64__)
#include <immintrin.h>
#endif

#define INLINE static inline __attribute__((always_inline, unused))

typedef float F8 __attribute__((vector_size(32)));
typedef float F16 __attribute__((vector_size(64)));
typedef double D8 __attribute__((vector_size(64)));
typedef int32_t I8 __attribute__((vector_size(32)));
typedef int32_t I16 __attribute__((vector_size(64)));
typedef int64_t L8 __attribute__((vector_size(64)));

/* Of what comparisons of doubles give. */
INLINE uint32_t bits_D8(L8 m) {
#if defined(__AVX512DQ__)
    return _mm512_movepi64_mask((__m512i)m);
#elif defined(__AVX__)
    const union {
        L8 all;
        __m256d half[2];
    } x = {.all = m};
    return (uint32_t)_mm256_movemask_pd(x.half[0]) | (uint32_t)_mm256_movemask_pd(x.half[1]) << 4;
#elif defined(__SSE2__)
    const union {
        L8 all;
        __m128d part[4];
    } x = {.all = m};
    uint32_t all = 0;
    for (int k = 0; k < 4; k++) all |= (uint32_t)_mm_movemask_pd(x.part[k]) << 2 * k;
    return all;
#else
    uint32_t all = 0;
    for (int k = 0; k < 8; k++) all |= (uint32_t)(m[k] & 1) << k;
    return all;
#endif
}

/* In parts: T vectors of n, M what their comparisons give. */
#define LANES_IN_PARTS(T, M, n)                                                                                        \
    INLINE T lower_##T(T a, T b) {                                                                                     \
        M m = a < b;                                                                                                   \
        return (T)((m & (M)a) | (~m & (M)b));                                                                          \
    }                                                                                                                  \
    INLINE T higher_##T(T a, T b) {                                                                                    \
        M m = a > b;                                                                                                   \
        return (T)((m & (M)a) | (~m & (M)b));                                                                          \
    }                                                                                                                  \
    INLINE M under_##T(T a, T b) { return a < b; }                                                                     \
    INLINE uint32_t less_##T(T a, T b) {                                                                               \
        M m = a < b;                                                                                                   \
        return bits_##T(m);                                                                                            \
    }                                                                                                                  \
    INLINE uint32_t upto_##T(T a, T b) {                                                                               \
        M m = a <= b;                                                                                                  \
        return bits_##T(m);                                                                                            \
    }

#if defined(__AVX512VL__)
INLINE F8 lower_F8(F8 a, F8 b) { return (F8)_mm256_min_ps((__m256)a, (__m256)b); }
INLINE F8 higher_F8(F8 a, F8 b) { return (F8)_mm256_max_ps((__m256)a, (__m256)b); }
INLINE uint32_t less_F8(F8 a, F8 b) { return _mm256_cmp_ps_mask((__m256)a, (__m256)b, _CMP_LT_OQ); }
INLINE uint32_t upto_F8(F8 a, F8 b) { return _mm256_cmp_ps_mask((__m256)a, (__m256)b, _CMP_LE_OQ); }
INLINE I8 under_F8(F8 a, F8 b) { return a < b; }
INLINE I16 under_F16(F16 a, F16 b) { return a < b; }
INLINE L8 under_D8(D8 a, D8 b) { return a < b; }
INLINE F16 lower_F16(F16 a, F16 b) { return (F16)_mm512_min_ps((__m512)a, (__m512)b); }
INLINE F16 higher_F16(F16 a, F16 b) { return (F16)_mm512_max_ps((__m512)a, (__m512)b); }
INLINE uint32_t less_F16(F16 a, F16 b) { return _mm512_cmp_ps_mask((__m512)a, (__m512)b, _CMP_LT_OQ); }
INLINE uint32_t upto_F16(F16 a, F16 b) { return _mm512_cmp_ps_mask((__m512)a, (__m512)b, _CMP_LE_OQ); }
INLINE D8 lower_D8(D8 a, D8 b) { return (D8)_mm512_min_pd((__m512d)a, (__m512d)b); }
INLINE D8 higher_D8(D8 a, D8 b) { return (D8)_mm512_max_pd((__m512d)a, (__m512d)b); }
INLINE uint32_t less_D8(D8 a, D8 b) { return _mm512_cmp_pd_mask((__m512d)a, (__m512d)b, _CMP_LT_OQ); }
INLINE uint32_t upto_D8(D8 a, D8 b) { return _mm512_cmp_pd_mask((__m512d)a, (__m512d)b, _CMP_LE_OQ); }
#elif defined(__AVX__)
INLINE F8 lower_F8(F8 a, F8 b) { return (F8)_mm256_min_ps((__m256)a, (__m256)b); }
INLINE F8 higher_F8(F8 a, F8 b) { return (F8)_mm256_max_ps((__m256)a, (__m256)b); }
INLINE uint32_t less_F8(F8 a, F8 b) {
    return (uint32_t)_mm256_movemask_ps(_mm256_cmp_ps((__m256)a, (__m256)b, _CMP_LT_OQ));
}
INLINE uint32_t upto_F8(F8 a, F8 b) {
    return (uint32_t)_mm256_movemask_ps(_mm256_cmp_ps((__m256)a, (__m256)b, _CMP_LE_OQ));
}
typedef union Halves {
    D8 all;
    __m256d half[2];
} Halves;
INLINE D8 lower_D8(D8 a, D8 b) {
    const Halves x = {.all = a}, y = {.all = b};
    return (Halves){.half = {_mm256_min_pd(x.half[0], y.half[0]), _mm256_min_pd(x.half[1], y.half[1])}}.all;
}
INLINE D8 higher_D8(D8 a, D8 b) {
    const Halves x = {.all = a}, y = {.all = b};
    return (Halves){.half = {_mm256_max_pd(x.half[0], y.half[0]), _mm256_max_pd(x.half[1], y.half[1])}}.all;
}
INLINE I8 under_F8(F8 a, F8 b) { return a < b; }
INLINE L8 under_D8(D8 a, D8 b) {
    const Halves x = {.all = a}, y = {.all = b};
    return (L8)(Halves){
        .half = {_mm256_cmp_pd(x.half[0], y.half[0], _CMP_LT_OQ), _mm256_cmp_pd(x.half[1], y.half[1], _CMP_LT_OQ)}}
        .all;
}
INLINE uint32_t less_D8(D8 a, D8 b) {
    const Halves x = {.all = a}, y = {.all = b};
    return (uint32_t)_mm256_movemask_pd(_mm256_cmp_pd(x.half[0], y.half[0], _CMP_LT_OQ)) |
           (uint32_t)_mm256_movemask_pd(_mm256_cmp_pd(x.half[1], y.half[1], _CMP_LT_OQ)) << 4;
}
INLINE uint32_t upto_D8(D8 a, D8 b) {
    const Halves x = {.all = a}, y = {.all = b};
    return (uint32_t)_mm256_movemask_pd(_mm256_cmp_pd(x.half[0], y.half[0], _CMP_LE_OQ)) |
           (uint32_t)_mm256_movemask_pd(_mm256_cmp_pd(x.half[1], y.half[1], _CMP_LE_OQ)) << 4;
}
#elif defined(__SSE2__)
/* By name: of comparisons of vectors wider than its registers GCC makes one for each number. */
#define LANES_OF_PARTS(T, M, R, n, suffix)                                                                                \
    typedef union T##Parts {                                                                                           \
        T all;                                                                                                         \
        R part[8 / n];                                                                                                 \
    } T##Parts;                                                                                                        \
    INLINE T lower_##T(T a, T b) {                                                                                     \
        T##Parts x = {.all = a}, y = {.all = b};                                                                       \
        for (int k = 0; k < 8 / n; k++) x.part[k] = _mm_min_##suffix(x.part[k], y.part[k]);                            \
        return x.all;                                                                                                  \
    }                                                                                                                  \
    INLINE T higher_##T(T a, T b) {                                                                                    \
        T##Parts x = {.all = a}, y = {.all = b};                                                                       \
        for (int k = 0; k < 8 / n; k++) x.part[k] = _mm_max_##suffix(x.part[k], y.part[k]);                            \
        return x.all;                                                                                                  \
    }                                                                                                                  \
    INLINE M under_##T(T a, T b) {                                                                                     \
        T##Parts x = {.all = a}, y = {.all = b};                                                                       \
        for (int k = 0; k < 8 / n; k++) x.part[k] = _mm_cmplt_##suffix(x.part[k], y.part[k]);                          \
        return (M)x.all;                                                                                               \
    }                                                                                                                  \
    INLINE uint32_t less_##T(T a, T b) {                                                                               \
        const T##Parts x = {.all = a}, y = {.all = b};                                                                 \
        uint32_t all = 0;                                                                                              \
        for (int k = 0; k < 8 / n; k++)                                                                                \
            all |= (uint32_t)_mm_movemask_##suffix(_mm_cmplt_##suffix(x.part[k], y.part[k])) << n * k;                 \
        return all;                                                                                                    \
    }                                                                                                                  \
    INLINE uint32_t upto_##T(T a, T b) {                                                                               \
        const T##Parts x = {.all = a}, y = {.all = b};                                                                 \
        uint32_t all = 0;                                                                                              \
        for (int k = 0; k < 8 / n; k++)                                                                                \
            all |= (uint32_t)_mm_movemask_##suffix(_mm_cmple_##suffix(x.part[k], y.part[k])) << n * k;                 \
        return all;                                                                                                    \
    }
LANES_OF_PARTS(F8, I8, __m128, 4, ps)
LANES_OF_PARTS(D8, L8, __m128d, 2, pd)
INLINE F8 chosen_F8(uint64_t m, F8 a, F8 b) {
    F8Parts x = {.all = a}, y = {.all = b};
    for (int k = 0; k < 2; k++) {
        const __m128i bit = _mm_slli_epi32(_mm_setr_epi32(1, 2, 4, 8), 4 * k);
        const __m128 on = (__m128)_mm_cmpeq_epi32(_mm_and_si128(_mm_set1_epi32((int)m), bit), bit);
        x.part[k] = _mm_or_ps(_mm_and_ps(on, x.part[k]), _mm_andnot_ps(on, y.part[k]));
    }
    return x.all;
}
INLINE D8 chosen_D8(uint64_t m, D8 a, D8 b) {
    D8Parts x = {.all = a}, y = {.all = b};
    for (int k = 0; k < 4; k++) {
        const __m128i bit = _mm_slli_epi32(_mm_setr_epi32(1, 1, 2, 2), 2 * k);
        const __m128d on = (__m128d)_mm_cmpeq_epi32(_mm_and_si128(_mm_set1_epi32((int)m), bit), bit);
        x.part[k] = _mm_or_pd(_mm_and_pd(on, x.part[k]), _mm_andnot_pd(on, y.part[k]));
    }
    return x.all;
}
INLINE uint32_t equal(I8 a, int32_t b) {
    const union {
        I8 all;
        __m128i part[2];
    } x = {.all = a};
    const __m128i to = _mm_set1_epi32(b);
    return (uint32_t)_mm_movemask_ps((__m128)_mm_cmpeq_epi32(x.part[0], to)) |
           (uint32_t)_mm_movemask_ps((__m128)_mm_cmpeq_epi32(x.part[1], to)) << 4;
}
#else
INLINE uint32_t bits_F8(I8 m) {
    uint32_t all = 0;
    for (int k = 0; k < 8; k++) all |= (uint32_t)(m[k] & 1) << k;
    return all;
}
INLINE uint32_t equal(I8 a, int32_t b) { return bits_F8(a == b); }
LANES_IN_PARTS(F8, I8, 8)
LANES_IN_PARTS(D8, L8, 8)
#endif

INLINE F8 all_F8(float v) { return (F8){v, v, v, v, v, v, v, v}; }
INLINE D8 all_D8(double v) { return (D8){v, v, v, v, v, v, v, v}; }
#if defined(__AVX512VL__)
INLINE F8 chosen_F8(uint64_t m, F8 a, F8 b) { return (F8)_mm256_mask_mov_ps((__m256)b, (__mmask8)m, (__m256)a); }
#elif defined(__AVX__) || !defined(__SSE2__)
INLINE F8 chosen_F8(uint64_t m, F8 a, F8 b) {
    const I8 bit = {1, 2, 4, 8, 16, 32, 64, 128}, on = ((bit & (int32_t)m) != 0);
    return (F8)((on & (I8)a) | (~on & (I8)b));
}
#endif
#if defined(__AVX512F__)
INLINE D8 chosen_D8(uint64_t m, D8 a, D8 b) { return (D8)_mm512_mask_mov_pd((__m512d)b, (__mmask8)m, (__m512d)a); }
#elif defined(__AVX2__)
INLINE D8 chosen_D8(uint64_t m, D8 a, D8 b) {
    Halves x = {.all = a}, y = {.all = b};
    for (int k = 0; k < 2; k++) {
        const __m256i bit = _mm256_slli_epi64(_mm256_setr_epi64x(1, 2, 4, 8), 4 * k),
                      on = _mm256_cmpeq_epi64(_mm256_and_si256(_mm256_set1_epi64x((int64_t)m), bit), bit);
        x.half[k] = _mm256_blendv_pd(y.half[k], x.half[k], (__m256d)on);
    }
    return x.all;
}
#elif !defined(__SSE2__)
INLINE D8 chosen_D8(uint64_t m, D8 a, D8 b) {
    const L8 bit = {1, 2, 4, 8, 16, 32, 64, 128}, on = ((bit & (int64_t)m) != 0);
    return (D8)((on & (L8)a) | (~on & (L8)b));
}
#endif
INLINE float least_of_F8(F8 a) {
    a = lower_F8(a, __builtin_shufflevector(a, a, 4, 5, 6, 7, 0, 1, 2, 3));
    a = lower_F8(a, __builtin_shufflevector(a, a, 2, 3, 0, 1, 6, 7, 4, 5));
    return a[0] < a[1] ? a[0] : a[1];
}
INLINE double least_of_D8(D8 a) {
    a = lower_D8(a, __builtin_shufflevector(a, a, 4, 5, 6, 7, 0, 1, 2, 3));
    a = lower_D8(a, __builtin_shufflevector(a, a, 2, 3, 0, 1, 6, 7, 4, 5));
    return a[0] < a[1] ? a[0] : a[1];
}
/* The least lanes of four. */
INLINE void least_of_four(D8 a, D8 b, D8 c, D8 d, double out[4]) {
#if defined(__AVX512F__)
    const __m512d x = _mm512_min_pd(_mm512_unpacklo_pd((__m512d)a, (__m512d)b),
                                    _mm512_unpackhi_pd((__m512d)a, (__m512d)b)),
                  y = _mm512_min_pd(_mm512_unpacklo_pd((__m512d)c, (__m512d)d),
                                    _mm512_unpackhi_pd((__m512d)c, (__m512d)d)),
                  both = _mm512_min_pd(_mm512_shuffle_f64x2(x, y, 0x44), _mm512_shuffle_f64x2(x, y, 0xee)),
                  least = _mm512_min_pd(both, _mm512_shuffle_f64x2(both, both, 0xb1));
    _mm_storeu_pd(out, _mm512_castpd512_pd128(least));
    _mm_storeu_pd(out + 2, _mm512_extractf64x2_pd(least, 2));
#else
    out[0] = least_of_D8(a), out[1] = least_of_D8(b), out[2] = least_of_D8(c), out[3] = least_of_D8(d);
#endif
}
#if defined(__AVX512VL__)
INLINE F16 chosen_F16(uint64_t m, F16 a, F16 b) { return (F16)_mm512_mask_mov_ps((__m512)b, (__mmask16)m, (__m512)a); }
INLINE float least_of_F16(F16 a) { return _mm512_reduce_min_ps((__m512)a); }
INLINE uint32_t equal(I16 a, int32_t b) { return _mm512_cmpeq_epi32_mask((__m512i)a, _mm512_set1_epi32(b)); }
#elif defined(__AVX2__)
INLINE uint32_t equal(I8 a, int32_t b) { return (uint32_t)_mm256_movemask_ps((__m256)(a == b)); }
#endif

#if defined(__AVX512VL__)
#define LANES_OF(op, a) _Generic((a), F8: op##_F8, F16: op##_F16, D8: op##_D8)
typedef F16 Many; /* floats at once */
typedef I16 Whether;
typedef __mmask16 Lanes; /* yes or no */
typedef uint16_t Bits;   /* one a lane */
INLINE Many all_Many(float v) { return (Many)_mm512_set1_ps(v); }
INLINE Lanes lanes_not_0(const uint32_t *v) {
    const __m512i all = _mm512_load_si512(v);
    return _mm512_test_epi32_mask(all, all);
}
INLINE Many either(Lanes m, Many a, Many b) { return (Many)_mm512_mask_mov_ps((__m512)b, m, (__m512)a); }
#else
#define LANES_OF(op, a) _Generic((a), F8: op##_F8, D8: op##_D8)
typedef F8 Many;
typedef I8 Whether;
typedef I8 Lanes;
typedef uint8_t Bits;
INLINE Many all_Many(float v) { return all_F8(v); }
INLINE Lanes lanes_not_0(const uint32_t *v) { return *(const I8 *)v != 0; }
INLINE Many either(Lanes m, Many a, Many b) { return (Many)((m & (I8)a) | (~m & (I8)b)); }
#endif
#define lower(a, b) LANES_OF(lower, a)(a, b)
#define higher(a, b) LANES_OF(higher, a)(a, b)
#define less(a, b) LANES_OF(less, a)(a, b)
#define upto(a, b) LANES_OF(upto, a)(a, b)
#define under(a, b) LANES_OF(under, a)(a, b)
#define chosen(m, a, b) LANES_OF(chosen, a)(m, a, b)
#define least_of(a) LANES_OF(least_of, a)(a)

#if defined(__AVX512F__)
INLINE D8 wide_F8(F8 v) { return (D8)_mm512_cvtps_pd((__m256)v); }
INLINE F8 narrow_D8(D8 v) { return (F8)_mm512_cvtpd_ps((__m512d)v); }
#else
INLINE D8 wide_F8(F8 v) { return __builtin_convertvector(v, D8); }
INLINE F8 narrow_D8(D8 v) { return __builtin_convertvector(v, F8); }
#endif

#if defined(__AVX512DQ__)
typedef D8 Some;
INLINE uint32_t less_some(Some a, Some b) { return less_D8(a, b); }
INLINE uint32_t upto_some(Some a, Some b) { return upto_D8(a, b); }
INLINE uint32_t equal_some(Some a, Some b) { return _mm512_cmp_pd_mask((__m512d)a, (__m512d)b, _CMP_EQ_OQ); }
INLINE Some lower_some(Some a, Some b) { return lower_D8(a, b); }
INLINE Some higher_some(Some a, Some b) { return higher_D8(a, b); }
INLINE Some some_floats(const float *from) { return (Some)_mm512_cvtps_pd(_mm256_loadu_ps(from)); }
#elif defined(__AVX__)
typedef double Some __attribute__((vector_size(32)));
INLINE uint32_t less_some(Some a, Some b) { return (uint32_t)_mm256_movemask_pd(_mm256_cmp_pd(a, b, _CMP_LT_OQ)); }
INLINE uint32_t upto_some(Some a, Some b) { return (uint32_t)_mm256_movemask_pd(_mm256_cmp_pd(a, b, _CMP_LE_OQ)); }
INLINE uint32_t equal_some(Some a, Some b) { return (uint32_t)_mm256_movemask_pd(_mm256_cmp_pd(a, b, _CMP_EQ_OQ)); }
INLINE Some lower_some(Some a, Some b) { return _mm256_min_pd(a, b); }
INLINE Some higher_some(Some a, Some b) { return _mm256_max_pd(a, b); }
INLINE Some some_floats(const float *from) { return _mm256_cvtps_pd(_mm_loadu_ps(from)); }
#elif defined(__SSE2__)
typedef double Some __attribute__((vector_size(16)));
INLINE uint32_t less_some(Some a, Some b) { return (uint32_t)_mm_movemask_pd(_mm_cmplt_pd(a, b)); }
INLINE uint32_t upto_some(Some a, Some b) { return (uint32_t)_mm_movemask_pd(_mm_cmple_pd(a, b)); }
INLINE uint32_t equal_some(Some a, Some b) { return (uint32_t)_mm_movemask_pd(_mm_cmpeq_pd(a, b)); }
INLINE Some lower_some(Some a, Some b) { return _mm_min_pd(a, b); }
INLINE Some higher_some(Some a, Some b) { return _mm_max_pd(a, b); }
INLINE Some some_floats(const float *from) { return (Some){(double)from[0], (double)from[1]}; }
#else
typedef double Some __attribute__((vector_size(16)));
INLINE uint32_t less_some(Some a, Some b) { return (uint32_t)(a[0] < b[0]) | (uint32_t)(a[1] < b[1]) << 1; }
INLINE uint32_t upto_some(Some a, Some b) { return (uint32_t)(a[0] <= b[0]) | (uint32_t)(a[1] <= b[1]) << 1; }
INLINE uint32_t equal_some(Some a, Some b) { return (uint32_t)(a[0] == b[0]) | (uint32_t)(a[1] == b[1]) << 1; }
INLINE Some lower_some(Some a, Some b) { return (Some){a[0] < b[0] ? a[0] : b[0], a[1] < b[1] ? a[1] : b[1]}; }
INLINE Some higher_some(Some a, Some b) { return (Some){a[0] > b[0] ? a[0] : b[0], a[1] > b[1] ? a[1] : b[1]}; }
INLINE Some some_floats(const float *from) { return (Some){(double)from[0], (double)from[1]}; }
#endif
enum { SOME = sizeof(Some) / sizeof(double) };
INLINE Some all_some(double v) {
    Some s;
    for (int k = 0; k < SOME; k++) s[k] = v;
    return s;
}
INLINE Some some_doubles(const double *from) {
    Some s;
    memcpy(&s, from, sizeof s);
    return s;
}
INLINE Some size_some(Some a) { return higher_some(a, -a); }

/* Bit k: bit n of the byte k, of 64 that are aligned. */
INLINE uint64_t column(const uint8_t *bytes, uint32_t n) {
#if defined(__AVX512BW__)
    return _mm512_test_epi8_mask(*(const __m512i *)bytes, _mm512_set1_epi8((char)(1 << n)));
#else
    uint64_t all = 0;
#if defined(__SSE2__)
    for (int k = 0; k < 4; k++)
        all |= (uint64_t)(uint32_t)_mm_movemask_epi8(_mm_slli_epi16(((const __m128i *)bytes)[k], 7 - (int)n)) << 16 * k;
#else
    for (int k = 0; k < 64; k++) all |= (uint64_t)(bytes[k] >> n & 1) << k;
#endif
    return all;
#endif
}

/* Not below v, by no more than a few units in its last place. */
INLINE float outwards_of(double v) {
    const float near = (float)v;
    return near + (near < 0 ? -near : near) * 0x1p-22f;
}

/* Those of m one after the other; there is room for eight. */
INLINE void pack(uint32_t m, D8 v, double *to) {
#if defined(__AVX512F__)
    _mm512_storeu_pd(to, _mm512_maskz_compress_pd((__mmask8)m, (__m512d)v));
#else
    double all[8];
    memcpy(all, &v, sizeof all);
    for (; m; m &= m - 1) *to++ = all[__builtin_ctz(m)];
#endif
}

/* What belongs to a triangle's corners; the fourth lane is not minded. */
typedef float F4 __attribute__((vector_size(16)));
typedef double D4 __attribute__((vector_size(32)));
#if defined(__AVX__)
INLINE D4 wide_F4(F4 v) { return (D4)_mm256_cvtps_pd((__m128)v); }
#else
INLINE D4 wide_F4(F4 v) { return __builtin_convertvector(v, D4); }
#endif
#if defined(__SSE2__)
INLINE F4 lower_F4(F4 a, F4 b) { return (F4)_mm_min_ps((__m128)a, (__m128)b); }
INLINE F4 higher_F4(F4 a, F4 b) { return (F4)_mm_max_ps((__m128)a, (__m128)b); }
INLINE F4 all_F4(float v) { return (F4)_mm_set1_ps(v); }
INLINE uint32_t less_F4(F4 a, F4 b) { return (uint32_t)_mm_movemask_ps(_mm_cmplt_ps((__m128)a, (__m128)b)); }
INLINE uint32_t upto_F4(F4 a, F4 b) { return (uint32_t)_mm_movemask_ps(_mm_cmple_ps((__m128)a, (__m128)b)); }
#endif
/* Is any of three of them over 0? */
INLINE bool any_over(D4 v) {
#if defined(__AVX512VL__)
    return _mm256_cmp_pd_mask((__m256d)v, _mm256_setzero_pd(), _CMP_GT_OQ) & 7;
#elif defined(__AVX__)
    return _mm256_movemask_pd(_mm256_cmp_pd((__m256d)v, _mm256_setzero_pd(), _CMP_GT_OQ)) & 7;
#else
    return (v[0] > 0) | (v[1] > 0) | (v[2] > 0);
#endif
}

/* Children that wait, eight at once: numbers of 64 bits, above where a child is entered, below which it is. */
enum { WAITS_ATONCE = 8 };
#if defined(__AVX512VL__)
#define WAITS_BY_LANES 1
/* Those of the children m come first, then what lies below all. */
INLINE void waits_of(F8 enter, const int32_t *child, uint32_t m, int64_t *to) {
    const __m512i at = _mm512_set_epi32(23, 7, 22, 6, 21, 5, 20, 4, 19, 3, 18, 2, 17, 1, 16, 0),
                  both = _mm512_permutex2var_epi32(_mm512_castsi256_si512(_mm256_load_si256((const __m256i *)child)),
                                                   at, _mm512_castsi256_si512((__m256i)enter));
    _mm512_store_si512(to, _mm512_mask_compress_epi64(_mm512_set1_epi64(INT64_MIN), (__mmask8)m, both));
}
/* Bit k: waits[k] <= most. */
INLINE uint32_t waits_upto(const int64_t *waits, int64_t most) {
    return _mm512_cmple_epi64_mask(_mm512_loadu_si512(waits), _mm512_set1_epi64(most));
}
INLINE void waits_copy(const int64_t *from, int64_t *to) { _mm512_storeu_si512(to, _mm512_load_si512(from)); }
/* The first four, downwards: 0 with 2 and 1 with 3, 0 with 1 and 2 with 3, 1 with 2. */
INLINE void waits_sort_four(const int64_t *from, int64_t *to) {
    __m256i v = _mm256_load_si256((const __m256i *)from), other = _mm256_permute4x64_epi64(v, 0x4e);
    v = _mm256_mask_max_epi64(_mm256_min_epi64(v, other), 3, v, other);
    other = _mm256_shuffle_epi32(v, 0x4e);
    v = _mm256_mask_max_epi64(_mm256_min_epi64(v, other), 5, v, other);
    other = _mm256_permute4x64_epi64(v, 0xd8);
    v = _mm256_mask_max_epi64(_mm256_mask_min_epi64(v, 4, v, other), 2, v, other);
    _mm256_storeu_si256((__m256i *)to, v);
}
#else
#define WAITS_BY_LANES 0
INLINE void waits_of(F8 enter, const int32_t *child, uint32_t m, int64_t *to) {
    typedef uint32_t U8 __attribute__((vector_size(32)));
    typedef uint64_t UL8 __attribute__((vector_size(64)));
    (void)m;
    *(UL8 *)to = __builtin_convertvector((U8)enter, UL8) << 32 | __builtin_convertvector(*(const U8 *)child, UL8);
}
#endif

/* The lowest n bits, n from 1 to 64. */
#define LOW_BITS(n) (~(uint64_t)0 >> (64 - (n)))
/* What rays go by (rays.inc.h); measured, they change no answer. */
enum {
    PACKET = 8,      /* rays that go together, at least */
    TRIES = 4,       /* to find such */
    FEW = 4,         /* rays that leave a packet at a node */
    FEW_MIXED = 4,   /* rays that share a node no more, but go on each for itself */
    LATER = 32,      /* nodes or leaves that wait till then */
    FEW_IN_LEAF = 6, /* rays of a packet that meet a leaf one by one, */
    LANES_A_RAY = 11 /* as do more, where lanes times triangles are so many a ray */
};
/* Rays from which on MANY are tested at a time: at the root of each for itself, and where they share nodes; 65: never.
 */
#if defined(__AVX512VL__)
enum { MANY_EACH = 12, MANY_MIXED = 28 };
#elif defined(__AVX__)
enum { MANY_EACH = 12, MANY_MIXED = 65 };
#else
enum { MANY_EACH = 65, MANY_MIXED = 65 };
#endif
#define SPREAD 0.25f /* of the slopes of a packet's rays */
#define NEAR 0.25    /* of the mesh's largest coordinate: how far apart rays begin that share nodes */
enum { RAYS = 64, MANY = sizeof(Many) / sizeof(float) };

/* The least and the most of the rays `who` of a row. */
INLINE void bounds_of_floats(const float *row, uint64_t who, float *least, float *most) {
    Many low, high;
    low = high = (Many){0} + row[__builtin_ctzll(who)];
    for (uint32_t k = 0; k < RAYS; k += MANY)
        if (who >> k & LOW_BITS(MANY)) {
            const Many v = chosen(who >> k & LOW_BITS(MANY), *(const Many *)(row + k), low);
            low = lower(v, low), high = higher(v, high);
        }
    *least = least_of(low), *most = -least_of(-high);
}

#endif
