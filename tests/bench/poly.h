/* Polynomials in place of libm, as the compiler's own functions have them: what is left of a ratio is not libm's. */
#include <string.h>
INL float from_bits(uint32_t b) {
    float f;
    memcpy(&f, &b, 4);
    return f;
}
INL uint32_t to_bits(float f) {
    uint32_t b;
    memcpy(&b, &f, 4);
    return b;
}
INL float poly_sin(float x) {
    float k = rintf(x * 0.318309886f), r = __builtin_fmaf(k, -3.14159274f, x);
    r = __builtin_fmaf(k, 8.74227766e-8f, r);
    float q = r * r,
          p = r +
              r * q * (-1.6666657096e-01f + q * (8.3330172817e-03f + q * (-1.9806614597e-04f + q * 2.6000536074e-06f)));
    return from_bits(to_bits(p) ^ (uint32_t)(int)k << 31);
}
INL float poly_cos(float x) {
    float k = rintf(x * 0.318309886f - 0.5f), h = k + 0.5f, r = __builtin_fmaf(h, -3.14159274f, x);
    r = __builtin_fmaf(h, 8.74227766e-8f, r);
    float q = r * r,
          p = r +
              r * q * (-1.6666657096e-01f + q * (8.3330172817e-03f + q * (-1.9806614597e-04f + q * 2.6000536074e-06f)));
    return from_bits(to_bits(p) ^ ~(uint32_t)(int)k << 31);
}
INL float poly_exp2(float x) {
    x = x < -126.0f ? -126.0f : x > 127.0f ? 127.0f : x;
    float k = rintf(x), f = x - k;
    float p =
        1.0f +
        f * (0.69314718f +
             f * (0.24022651f + f * (0.055504109f + f * (0.0096181291f + f * (0.0013333558f + f * 0.00015403530f)))));
    return from_bits(to_bits(p) + ((uint32_t)(int)k << 23));
}
INL float poly_exp(float x) { return poly_exp2(x * 1.44269504f); }
INL float poly_log2(float x) {
    uint32_t b = to_bits(x);
    int e = (int)(b - 0x3f3504f3u) >> 23;
    float m = from_bits(b - ((uint32_t)e << 23)), s = (m - 1.0f) / (m + 1.0f), q = s * s;
    return (float)e + s * (2.88539008f + q * (0.96179669f + q * (0.57707802f + q * 0.4121985f)));
}
INL float poly_log(float x) { return 0.69314718f * poly_log2(x); }
INL float poly_pow(float x, float y) { return poly_exp2(y * poly_log2(x)); }
INL float poly_acos(float x) {
    float a = fabsf(x),
          p = sqrtf(1.0f - a) *
              (1.5707963f + a * (-0.2145988f +
                                 a * (0.0889790f + a * (-0.0501743f +
                                                        a * (0.0308919f + a * (-0.0170881f +
                                                                               a * (0.0066701f + a * -0.0012625f)))))));
    return x < 0.0f ? 3.14159265f - p : p;
}
INL float poly_atan2(float y, float x) {
    float ax = fabsf(x), ay = fabsf(y), hi = ax > ay ? ax : ay, lo = ax > ay ? ay : ax, t = lo / hi, q = t * t;
    float p =
        t *
        (0.99999934f +
         q * (-0.33329856f +
              q * (0.19946536f + q * (-0.13908534f +
                                      q * (0.09642004f + q * (-0.05590986f + q * (0.02186123f + q * -0.00405406f)))))));
    p = ay > ax ? 1.57079633f - p : p;
    p = x < 0.0f ? 3.14159265f - p : p;
    return y < 0.0f ? -p : p;
}
#define sinf poly_sin
#define cosf poly_cos
#define expf poly_exp
#define log2f poly_log2
#define logf poly_log
#define powf poly_pow
#define acosf poly_acos
#define atan2f poly_atan2
