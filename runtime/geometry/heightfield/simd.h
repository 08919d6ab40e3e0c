/* The vector operations that leaf.h and packet.inc.h are written in. Before including: LANES (16, 8, 4 or 1) and F64 (0
 * or 1); the file's -m flags must allow them.
 *
 *   flt  float or double
 *   vf   LANES of flt
 *   vi   LANES of int32
 *   vm   a mask of LANES, an integer or a vector: combined with &, | and m_not
 *
 * + - * / are the operators of C; every operation rounds as IEEE says, so all widths agree bit for bit. f_min(a, b) is
 * a < b ? a : b and f_max(a, b) is a > b ? a : b: where a or b is NaN both give b. May be included again with other
 * values of LANES and F64. */
#if defined(__x86_64__)
#include <immintrin.h>
#endif
#include <stdint.h>
#include <string.h>

#undef flt
#undef vf
#undef vi
#undef vm
#undef FN
#define FN_JOIN(a, b, c) a##_##b##x##c
#define FN_NAME(a, b, c) FN_JOIN(a, b, c)
#ifdef SALTUS_SANITIZE /* whole walks in one function, every access checked, take gcc a minute a file */
#define INLINE static inline __attribute__((unused))
#else
#define INLINE static inline __attribute__((always_inline, unused))
#endif

/* Each instance has its own names: NAME_f32x16 ... */
#if F64
#define FN(a) FN_NAME(a, f64, LANES)
#define flt double
#else
#define FN(a) FN_NAME(a, f32, LANES)
#define flt float
#endif
#define vf FN(vf)
#define vi FN(vi)
#define vm FN(vm)

#define f_all FN(f_all)
#define i_all FN(i_all)
#define f_min FN(f_min)
#define f_max FN(f_max)
#define f_abs FN(f_abs)
#define f_sel FN(f_sel)
#define i_sel FN(i_sel)
#define f_int FN(f_int)
#define i_flt FN(i_flt)
#define m_lt FN(m_lt)
#define m_le FN(m_le)
#define m_eq FN(m_eq)
#define mi_eq FN(mi_eq)
#define mi_gt FN(mi_gt)
#define m_not FN(m_not)
#define m_bits FN(m_bits)
#define m_make FN(m_make)
#define m_any FN(m_any)
#define m_opaque FN(m_opaque)
#define f_load FN(f_load)
#define f_store FN(f_store)
#define i_load FN(i_load)
#define i_store FN(i_store)
#define f_gather FN(f_gather)
#define f_corners FN(f_corners)
#define mip_gather FN(mip_gather)
#define i_lookup FN(i_lookup)
#define f_pack FN(f_pack)
#define i_pack FN(i_pack)
#define i_count FN(i_count)
#undef PACKS
#define PACKS (LANES == 16 || (LANES == 8 && F64)) /* has f_pack, i_pack: the lanes ma of a, then the lanes mb of b, from lane `after` on */

#if LANES == 16 && !F64
typedef __m512 vf;
typedef int vi __attribute__((vector_size(64)));
typedef __mmask16 vm;
INLINE vf f_all(flt a) { return _mm512_set1_ps(a); }
INLINE vi i_all(int a) { return (vi)_mm512_set1_epi32(a); }
INLINE vf f_min(vf a, vf b) { return _mm512_min_ps(a, b); }
INLINE vf f_max(vf a, vf b) { return _mm512_max_ps(a, b); }
INLINE vf f_abs(vf a) { return _mm512_abs_ps(a); }
INLINE vf f_sel(vm m, vf a, vf b) { return _mm512_mask_blend_ps(m, b, a); }
INLINE vi i_sel(vm m, vi a, vi b) { return (vi)_mm512_mask_blend_epi32(m, (__m512i)b, (__m512i)a); }
INLINE vi f_int(vf a) { return (vi)_mm512_cvttps_epi32(a); }
INLINE vf i_flt(vi a) { return _mm512_cvtepi32_ps((__m512i)a); }
INLINE vm m_lt(vf a, vf b) { return _mm512_cmp_ps_mask(a, b, _CMP_LT_OQ); }
INLINE vm m_le(vf a, vf b) { return _mm512_cmp_ps_mask(a, b, _CMP_LE_OQ); }
INLINE vm m_eq(vf a, vf b) { return _mm512_cmp_ps_mask(a, b, _CMP_EQ_OQ); }
INLINE vm mi_eq(vi a, vi b) { return _mm512_cmpeq_epi32_mask((__m512i)a, (__m512i)b); }
INLINE vm mi_gt(vi a, vi b) { return _mm512_cmpgt_epi32_mask((__m512i)a, (__m512i)b); }
INLINE vm m_not(vm m) { return (vm)~m; }
INLINE uint32_t m_bits(vm m) { return m; }
INLINE vm m_make(uint32_t bits) { return (vm)bits; }
INLINE vf f_load(const flt *p) { return _mm512_loadu_ps(p); }
INLINE void f_store(flt *p, vf a) { _mm512_storeu_ps(p, a); }
INLINE vi i_load(const int32_t *p) { return (vi)_mm512_loadu_si512(p); }
INLINE void i_store(int32_t *p, vi a) { _mm512_storeu_si512(p, (__m512i)a); }
INLINE vf f_gather(const flt *p, vi at, vm m) {
    return _mm512_mask_i32gather_ps(_mm512_setzero_ps(), m, (__m512i)at, p, 4);
}
INLINE vf mip_gather(const float *p, vi at, vm m) { return f_gather(p, at, m); }
INLINE vi i_lookup(const int32_t table[16], vi at) {
    return (vi)_mm512_permutexvar_epi32((__m512i)at, _mm512_loadu_si512(table));
}
INLINE vi i_count(int from) { return (vi){0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15} + i_all(from); }
INLINE vf f_pack(vf a, vm ma, vf b, vm mb, vm after) {
    return _mm512_mask_expand_ps(_mm512_maskz_compress_ps(ma, a), after, _mm512_maskz_compress_ps(mb, b));
}
INLINE vi i_pack(vi a, vm ma, vi b, vm mb, vm after) {
    return (vi)_mm512_mask_expand_epi32(_mm512_maskz_compress_epi32(ma, (__m512i)a), after,
                                        _mm512_maskz_compress_epi32(mb, (__m512i)b));
}

#elif LANES == 8 && F64
typedef __m512d vf;
typedef int vi __attribute__((vector_size(32)));
typedef __mmask8 vm;
INLINE vf f_all(flt a) { return _mm512_set1_pd(a); }
INLINE vi i_all(int a) { return (vi)_mm256_set1_epi32(a); }
INLINE vf f_min(vf a, vf b) { return _mm512_min_pd(a, b); }
INLINE vf f_max(vf a, vf b) { return _mm512_max_pd(a, b); }
INLINE vf f_abs(vf a) { return _mm512_abs_pd(a); }
INLINE vf f_sel(vm m, vf a, vf b) { return _mm512_mask_blend_pd(m, b, a); }
INLINE vi i_sel(vm m, vi a, vi b) { return (vi)_mm256_mask_blend_epi32(m, (__m256i)b, (__m256i)a); }
INLINE vi f_int(vf a) { return (vi)_mm512_cvttpd_epi32(a); }
INLINE vf i_flt(vi a) { return _mm512_cvtepi32_pd((__m256i)a); }
INLINE vm m_lt(vf a, vf b) { return _mm512_cmp_pd_mask(a, b, _CMP_LT_OQ); }
INLINE vm m_le(vf a, vf b) { return _mm512_cmp_pd_mask(a, b, _CMP_LE_OQ); }
INLINE vm m_eq(vf a, vf b) { return _mm512_cmp_pd_mask(a, b, _CMP_EQ_OQ); }
INLINE vm mi_eq(vi a, vi b) { return _mm256_cmpeq_epi32_mask((__m256i)a, (__m256i)b); }
INLINE vm mi_gt(vi a, vi b) { return _mm256_cmpgt_epi32_mask((__m256i)a, (__m256i)b); }
INLINE vm m_not(vm m) { return (vm)~m; }
INLINE uint32_t m_bits(vm m) { return m; }
INLINE vm m_make(uint32_t bits) { return (vm)bits; }
INLINE vf f_load(const flt *p) { return _mm512_loadu_pd(p); }
INLINE void f_store(flt *p, vf a) { _mm512_storeu_pd(p, a); }
INLINE vi i_load(const int32_t *p) { return (vi)_mm256_loadu_si256((const __m256i *)p); }
INLINE void i_store(int32_t *p, vi a) { _mm256_storeu_si256((__m256i *)p, (__m256i)a); }
INLINE vf f_gather(const flt *p, vi at, vm m) {
    return _mm512_mask_i32gather_pd(_mm512_setzero_pd(), m, (__m256i)at, p, 8);
}
INLINE vf mip_gather(const float *p, vi at, vm m) {
    return _mm512_cvtps_pd(_mm256_mmask_i32gather_ps(_mm256_setzero_ps(), m, (__m256i)at, p, 4));
}
INLINE vi i_lookup(const int32_t table[16], vi at) {
    return (vi)_mm256_permutex2var_epi32(_mm256_loadu_si256((const __m256i *)table), (__m256i)at,
                                         _mm256_loadu_si256((const __m256i *)(table + 8)));
}
INLINE vi i_count(int from) { return (vi){0, 1, 2, 3, 4, 5, 6, 7} + i_all(from); }
INLINE vf f_pack(vf a, vm ma, vf b, vm mb, vm after) {
    return _mm512_mask_expand_pd(_mm512_maskz_compress_pd(ma, a), after, _mm512_maskz_compress_pd(mb, b));
}
INLINE vi i_pack(vi a, vm ma, vi b, vm mb, vm after) {
    return (vi)_mm256_mask_expand_epi32(_mm256_maskz_compress_epi32(ma, (__m256i)a), after,
                                        _mm256_maskz_compress_epi32(mb, (__m256i)b));
}

#elif LANES == 8
typedef __m256 vf;
typedef int vi __attribute__((vector_size(32)));
typedef vi vm;
INLINE vf f_all(flt a) { return _mm256_set1_ps(a); }
INLINE vi i_all(int a) { return (vi)_mm256_set1_epi32(a); }
INLINE vf f_min(vf a, vf b) { return _mm256_min_ps(a, b); }
INLINE vf f_max(vf a, vf b) { return _mm256_max_ps(a, b); }
INLINE vf f_abs(vf a) { return _mm256_andnot_ps(_mm256_set1_ps(-0.0f), a); }
INLINE vf f_sel(vm m, vf a, vf b) { return _mm256_blendv_ps(b, a, (__m256)m); }
INLINE vi i_sel(vm m, vi a, vi b) { return (vi)_mm256_blendv_epi8((__m256i)b, (__m256i)a, (__m256i)m); }
INLINE vi f_int(vf a) { return (vi)_mm256_cvttps_epi32(a); }
INLINE vf i_flt(vi a) { return _mm256_cvtepi32_ps((__m256i)a); }
INLINE vm m_lt(vf a, vf b) { return (vm)_mm256_cmp_ps(a, b, _CMP_LT_OQ); }
INLINE vm m_le(vf a, vf b) { return (vm)_mm256_cmp_ps(a, b, _CMP_LE_OQ); }
INLINE vm m_eq(vf a, vf b) { return (vm)_mm256_cmp_ps(a, b, _CMP_EQ_OQ); }
INLINE vm mi_eq(vi a, vi b) { return (vm)_mm256_cmpeq_epi32((__m256i)a, (__m256i)b); }
INLINE vm mi_gt(vi a, vi b) { return (vm)_mm256_cmpgt_epi32((__m256i)a, (__m256i)b); }
INLINE vm m_not(vm m) { return ~m; }
INLINE uint32_t m_bits(vm m) { return (uint32_t)_mm256_movemask_ps((__m256)m); }
INLINE vm m_make(uint32_t bits) {
    const vi bit = {1, 2, 4, 8, 16, 32, 64, 128};
    return mi_eq(i_all((int)bits) & bit, bit);
}
INLINE vf f_load(const flt *p) { return _mm256_loadu_ps(p); }
INLINE void f_store(flt *p, vf a) { _mm256_storeu_ps(p, a); }
INLINE vi i_load(const int32_t *p) { return (vi)_mm256_loadu_si256((const __m256i *)p); }
INLINE void i_store(int32_t *p, vi a) { _mm256_storeu_si256((__m256i *)p, (__m256i)a); }
INLINE vf f_gather(const flt *p, vi at, vm m) {
    return _mm256_mask_i32gather_ps(_mm256_setzero_ps(), p, (__m256i)at, (__m256)m, 4);
}
INLINE vf mip_gather(const float *p, vi at, vm m) { return f_gather(p, at, m); }
INLINE vi i_lookup(const int32_t table[16], vi at) {
    __m256i lo = _mm256_permutevar8x32_epi32(_mm256_loadu_si256((const __m256i *)table), (__m256i)at);
    __m256i hi = _mm256_permutevar8x32_epi32(_mm256_loadu_si256((const __m256i *)(table + 8)), (__m256i)at);
    return i_sel(mi_gt(at, i_all(7)), (vi)hi, (vi)lo);
}

#elif LANES == 4 && F64
typedef __m256d vf;
typedef int vi __attribute__((vector_size(16)));
typedef long long vm __attribute__((vector_size(32)));
INLINE vf f_all(flt a) { return _mm256_set1_pd(a); }
INLINE vi i_all(int a) { return (vi)_mm_set1_epi32(a); }
INLINE vf f_min(vf a, vf b) { return _mm256_min_pd(a, b); }
INLINE vf f_max(vf a, vf b) { return _mm256_max_pd(a, b); }
INLINE vf f_abs(vf a) { return _mm256_andnot_pd(_mm256_set1_pd(-0.0), a); }
INLINE vf f_sel(vm m, vf a, vf b) { return _mm256_blendv_pd(b, a, (__m256d)m); }
INLINE vi i_sel(vm m, vi a, vi b) {
    vi n =
        (vi)_mm256_castsi256_si128(_mm256_permutevar8x32_epi32((__m256i)m, _mm256_setr_epi32(0, 2, 4, 6, 0, 2, 4, 6)));
    return (vi)_mm_blendv_epi8((__m128i)b, (__m128i)a, (__m128i)n);
}
INLINE vi f_int(vf a) { return (vi)_mm256_cvttpd_epi32(a); }
INLINE vf i_flt(vi a) { return _mm256_cvtepi32_pd((__m128i)a); }
INLINE vm m_lt(vf a, vf b) { return (vm)_mm256_cmp_pd(a, b, _CMP_LT_OQ); }
INLINE vm m_le(vf a, vf b) { return (vm)_mm256_cmp_pd(a, b, _CMP_LE_OQ); }
INLINE vm m_eq(vf a, vf b) { return (vm)_mm256_cmp_pd(a, b, _CMP_EQ_OQ); }
INLINE vm mi_eq(vi a, vi b) { return (vm)_mm256_cvtepi32_epi64(_mm_cmpeq_epi32((__m128i)a, (__m128i)b)); }
INLINE vm mi_gt(vi a, vi b) { return (vm)_mm256_cvtepi32_epi64(_mm_cmpgt_epi32((__m128i)a, (__m128i)b)); }
INLINE vm m_not(vm m) { return ~m; }
INLINE uint32_t m_bits(vm m) { return (uint32_t)_mm256_movemask_pd((__m256d)m); }
INLINE vm m_make(uint32_t bits) {
    const vi bit = {1, 2, 4, 8};
    return mi_eq(i_all((int)bits) & bit, bit);
}
INLINE vf f_load(const flt *p) { return _mm256_loadu_pd(p); }
INLINE void f_store(flt *p, vf a) { _mm256_storeu_pd(p, a); }
INLINE vi i_load(const int32_t *p) { return (vi)_mm_loadu_si128((const __m128i *)p); }
INLINE void i_store(int32_t *p, vi a) { _mm_storeu_si128((__m128i *)p, (__m128i)a); }
INLINE vf f_gather(const flt *p, vi at, vm m) {
    return _mm256_mask_i32gather_pd(_mm256_setzero_pd(), p, (__m128i)at, (__m256d)m, 8);
}
INLINE vf mip_gather(const float *p, vi at, vm m) {
    __m128i n =
        _mm256_castsi256_si128(_mm256_permutevar8x32_epi32((__m256i)m, _mm256_setr_epi32(0, 2, 4, 6, 0, 2, 4, 6)));
    return _mm256_cvtps_pd(_mm_mask_i32gather_ps(_mm_setzero_ps(), p, (__m128i)at, (__m128)n, 4));
}
INLINE vi i_lookup(const int32_t table[16], vi at) {
    return (vi){table[at[0]], table[at[1]], table[at[2]], table[at[3]]};
}

#elif LANES == 4
typedef __m128 vf;
typedef int vi __attribute__((vector_size(16)));
typedef vi vm;
INLINE vf f_all(flt a) { return _mm_set1_ps(a); }
INLINE vi i_all(int a) { return (vi)_mm_set1_epi32(a); }
INLINE vf f_min(vf a, vf b) { return _mm_min_ps(a, b); }
INLINE vf f_max(vf a, vf b) { return _mm_max_ps(a, b); }
INLINE vf f_abs(vf a) { return _mm_andnot_ps(_mm_set1_ps(-0.0f), a); }
INLINE vf f_sel(vm m, vf a, vf b) { return (vf)(((vi)a & m) | ((vi)b & ~m)); }
INLINE vi i_sel(vm m, vi a, vi b) { return (a & m) | (b & ~m); }
INLINE vi f_int(vf a) { return (vi)_mm_cvttps_epi32(a); }
INLINE vf i_flt(vi a) { return _mm_cvtepi32_ps((__m128i)a); }
INLINE vm m_lt(vf a, vf b) { return (vm)_mm_cmplt_ps(a, b); }
INLINE vm m_le(vf a, vf b) { return (vm)_mm_cmple_ps(a, b); }
INLINE vm m_eq(vf a, vf b) { return (vm)_mm_cmpeq_ps(a, b); }
INLINE vm mi_eq(vi a, vi b) { return (vm)_mm_cmpeq_epi32((__m128i)a, (__m128i)b); }
INLINE vm mi_gt(vi a, vi b) { return (vm)_mm_cmpgt_epi32((__m128i)a, (__m128i)b); }
INLINE vm m_not(vm m) { return ~m; }
INLINE uint32_t m_bits(vm m) { return (uint32_t)_mm_movemask_ps((__m128)m); }
INLINE vm m_make(uint32_t bits) {
    const vi bit = {1, 2, 4, 8};
    return mi_eq(i_all((int)bits) & bit, bit);
}
INLINE vf f_load(const flt *p) { return _mm_loadu_ps(p); }
INLINE void f_store(flt *p, vf a) { _mm_storeu_ps(p, a); }
INLINE vi i_load(const int32_t *p) { return (vi)_mm_loadu_si128((const __m128i *)p); }
INLINE void i_store(int32_t *p, vi a) { _mm_storeu_si128((__m128i *)p, (__m128i)a); }
INLINE vf f_gather(const flt *p, vi at, vm m) {
    at &= m; /* element 0 of a lane that is off */
    return (vf){p[at[0]], p[at[1]], p[at[2]], p[at[3]]};
}
INLINE vf mip_gather(const float *p, vi at, vm m) { return f_gather(p, at, m); }
INLINE vi i_lookup(const int32_t table[16], vi at) {
    return (vi){table[at[0]], table[at[1]], table[at[2]], table[at[3]]};
}

#elif LANES == 1
typedef flt vf;
typedef int vi;
typedef int vm; /* 0 or -1 */
INLINE vf f_all(flt a) { return a; }
INLINE vi i_all(int a) { return a; }
INLINE vf f_min(vf a, vf b) { return a < b ? a : b; }
INLINE vf f_max(vf a, vf b) { return a > b ? a : b; }
INLINE vf f_abs(vf a) { return F64 ? (vf)__builtin_fabs(a) : (vf)__builtin_fabsf((float)a); }
INLINE vf f_sel(vm m, vf a, vf b) { return m ? a : b; }
INLINE vi i_sel(vm m, vi a, vi b) { return m ? a : b; }
INLINE vi f_int(vf a) { return (vi)a; }
INLINE vf i_flt(vi a) { return (vf)a; }
INLINE vm m_lt(vf a, vf b) { return -(a < b); }
INLINE vm m_le(vf a, vf b) { return -(a <= b); }
INLINE vm m_eq(vf a, vf b) { return -(a == b); }
INLINE vm mi_eq(vi a, vi b) { return -(a == b); }
INLINE vm mi_gt(vi a, vi b) { return -(a > b); }
INLINE vm m_not(vm m) { return ~m; }
INLINE uint32_t m_bits(vm m) { return (uint32_t)m & 1; }
INLINE vm m_make(uint32_t bits) { return -(vm)(bits & 1); }
INLINE vf f_load(const flt *p) { return *p; }
INLINE void f_store(flt *p, vf a) { *p = a; }
INLINE vi i_load(const int32_t *p) { return *p; }
INLINE void i_store(int32_t *p, vi a) { *p = a; }
INLINE vf f_gather(const flt *p, vi at, vm m) { return m ? p[at] : 0; }
INLINE vf mip_gather(const float *p, vi at, vm m) { return m ? (vf)p[at] : 0; }
INLINE vi i_lookup(const int32_t table[16], vi at) { return table[at]; }
#endif

/* Returns m. clang's optimiser takes minutes over long chains of mask logic unless some links are opaque to it; this
 * costs nothing. */
INLINE vm m_opaque(vm m) {
#if defined(__clang__) && ((LANES == 16 && !F64) || (LANES == 8 && F64))
    __asm__("" : "+k"(m));
#endif
    return m;
}

INLINE int m_any(vm m) { return m_bits(m) != 0; }

/* Three corners of a cell: p[at + 1], p[at - w], and p[at + 1 - w] where `far`, else p[at]. */
INLINE void f_corners(const flt *p, vi at, int w, vm far, vm on, vf *right, vf *up, vf *corner) {
#if LANES == 16 && !F64
    /* A gather costs the same whatever the mask is, and a gather of eight pairs no more than one of eight numbers:
     * where few lanes want a cell, two gathers of pairs have all their heights. */
    const uint32_t bits = m_bits(on);
    if (__builtin_popcount(bits) <= 8) {
        const __m512i number = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
        const __m512i place = _mm512_maskz_expand_epi32(on, number),
                      next = _mm512_or_si512(place, _mm512_set1_epi32(1));
        const __m256i few = _mm512_castsi512_si256(_mm512_maskz_compress_epi32(on, (__m512i)at));
        const __mmask8 some = (__mmask8)((1u << __builtin_popcount(bits)) - 1);
        const __m512 near = _mm512_castpd_ps(_mm512_mask_i32gather_pd(_mm512_setzero_pd(), some, few, p, 4));
        const __m512 above = _mm512_castpd_ps(
            _mm512_mask_i32gather_pd(_mm512_setzero_pd(), some, _mm256_sub_epi32(few, _mm256_set1_epi32(w)), p, 4));
        *right = _mm512_permutexvar_ps(next, near);
        *up = _mm512_permutexvar_ps(place, above);
        *corner = f_sel(far, _mm512_permutexvar_ps(next, above), _mm512_permutexvar_ps(place, near));
        return;
    }
#endif
    *right = f_gather(p, at + i_all(1), on);
    *up = f_gather(p, at - i_all(w), on);
    *corner = f_gather(p, at + i_sel(far, i_all(1 - w), i_all(0)), on);
}
