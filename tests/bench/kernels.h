/* What the second and the third set of forward kernels begin with: scalar C, or ISPC behind ispc.h. One thread, f32,
 * RGBA8: void NAME_SUF(uint32_t *out, int w, int h, const float *d). POLY: polynomials in place of libm. */
#ifndef ISPC
#include <math.h>
#include <stdint.h>
#ifndef SUF
#define SUF scalar
#endif
#define UNI
#define DATA const float *
#define INL static inline __attribute__((always_inline))
#ifdef POLY
#include "poly.h"
#endif
#define CAT_(a, b) a##_##b
#define CAT(a, b) CAT_(a, b)
#define KERNEL(NAME)                                                                        \
    void CAT(NAME, SUF)(uint32_t *restrict out, int w, int h, const float *restrict d) {    \
        const float iw = 1.0f / (float)w, ih = 1.0f / (float)h;                             \
        for (int y = 0; y < h; y++) {                                                       \
            const float v = ((float)y + 0.5f) * ih;                                         \
            for (int x = 0; x < w; x++) out[(long)y * w + x] = px_##NAME(((float)x + 0.5f) * iw, v, d); \
        }                                                                                   \
    }
#endif

INL float minf(float a, float b) { return a < b ? a : b; }
INL float maxf(float a, float b) { return a > b ? a : b; }
INL float clamp01(float x) { return minf(maxf(x, 0.0f), 1.0f); }
INL float mix(float a, float b, float t) { return a + t * (b - a); }
INL float smooth(float lo, float hi, float x) {
    float t = clamp01((x - lo) / (hi - lo));
    return t * t * (3.0f - 2.0f * t);
}
INL float fract(float x) { return x - floorf(x); }
INL float len2(float x, float y) { return sqrtf(x * x + y * y); }
INL uint32_t pack(float r, float g, float b) {
    uint32_t R = (uint32_t)(int)(clamp01(r) * 255.0f + 0.5f);
    uint32_t G = (uint32_t)(int)(clamp01(g) * 255.0f + 0.5f);
    uint32_t B = (uint32_t)(int)(clamp01(b) * 255.0f + 0.5f);
    return R | (G << 8) | (B << 16) | 0xff000000u;
}
INL uint32_t hash2(int ix, int iy) {
    uint32_t h = (uint32_t)ix * 374761393u + (uint32_t)iy * 668265263u;
    h = (h ^ (h >> 13)) * 1274126177u;
    return h ^ (h >> 16);
}
INL float sd_segment(float x, float y, float ax, float ay, float bx, float by) {
    float px = x - ax, py = y - ay, ex = bx - ax, ey = by - ay;
    float t = clamp01((px * ex + py * ey) / (ex * ex + ey * ey));
    return len2(px - ex * t, py - ey * t);
}
