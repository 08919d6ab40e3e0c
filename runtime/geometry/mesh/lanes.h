/* Eight lanes in the vector extensions of C; what an instruction set lacks compilers write in parts. Every operation
 * rounds as IEEE says, so all instruction sets agree bit for bit.
 *
 * Before including: F64, 0 or 1. May be included again with another.
 *   flt  float or double     Flt8  eight of them     Int8  what comparisons give: 0 or -1 in each lane
 * keep_max(a, b): a = b > a ? b : a, keep_min(a, b): a = b < a ? b : a: where b is NaN a stays. */
#include <stdint.h>
#include <string.h>
#if defined(__x86_64__)
#include <immintrin.h>
#endif

#undef flt
#undef Flt8
#undef Int8
#undef FN
#define FN_JOIN(a, b) a##_##b
#if F64
#define FN(a) FN_JOIN(a, f64)
#define flt double
#else
#define FN(a) FN_JOIN(a, f32)
#define flt float
#endif
#ifdef SALTUS_SANITIZE
#define INLINE static inline __attribute__((unused))
#else
#define INLINE static inline __attribute__((always_inline, unused))
#endif
#define Flt8 FN(Flt8)
#define Int8 FN(Int8)
#define keep_max FN(keep_max)
#define keep_min FN(keep_min)
#define bits FN(bits)
#define load8 FN(load8)

#if F64
typedef double Flt8 __attribute__((vector_size(64)));
typedef int64_t Int8 __attribute__((vector_size(64)));
#else
typedef float Flt8 __attribute__((vector_size(32)));
typedef int32_t Int8 __attribute__((vector_size(32)));
#endif

INLINE void keep_max(Flt8 *a, Flt8 *b) {
#if defined(__AVX512F__) && F64
    *a = (Flt8)_mm512_max_pd((__m512d)*b, (__m512d)*a);
#elif defined(__AVX__) && !F64
    *a = (Flt8)_mm256_max_ps((__m256)*b, (__m256)*a);
#else
    Int8 m = *b > *a;
    *a = (Flt8)((m & (Int8)*b) | (~m & (Int8)*a));
#endif
}

INLINE void keep_min(Flt8 *a, Flt8 *b) {
#if defined(__AVX512F__) && F64
    *a = (Flt8)_mm512_min_pd((__m512d)*b, (__m512d)*a);
#elif defined(__AVX__) && !F64
    *a = (Flt8)_mm256_min_ps((__m256)*b, (__m256)*a);
#else
    Int8 m = *b < *a;
    *a = (Flt8)((m & (Int8)*b) | (~m & (Int8)*a));
#endif
}

/* Bit k: is lane k on? */
INLINE uint32_t bits(const Int8 *m) {
#if defined(__AVX512DQ__) && F64
    return _mm512_movepi64_mask((__m512i)*m);
#elif defined(__AVX__) && F64
    __m256d half[2];
    memcpy(half, m, sizeof half);
    return (uint32_t)_mm256_movemask_pd(half[0]) | (uint32_t)_mm256_movemask_pd(half[1]) << 4;
#elif defined(__AVX__)
    return (uint32_t)_mm256_movemask_ps((__m256)*m);
#elif defined(__SSE2__) && !F64
    __m128 half[2];
    memcpy(half, m, sizeof half);
    return (uint32_t)_mm_movemask_ps(half[0]) | (uint32_t)_mm_movemask_ps(half[1]) << 4;
#else
    uint32_t all = 0;
    for (int k = 0; k < 8; k++) all |= (uint32_t)((*m)[k] & 1) << k;
    return all;
#endif
}
