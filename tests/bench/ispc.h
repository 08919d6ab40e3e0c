// Kernels in C as ISPC: the same text behind other names. -DSUF=... is the suffix of the symbols.
#define UNI uniform
#define DATA const uniform float *uniform
#define INL static inline
#define uint32_t uint32
#define sinf sin
#define cosf cos
#define expf exp
#define logf log
#define log2f(x) (log(x) * 1.44269504f)
#define powf pow
#define acosf acos
#define atan2f atan2
#define sqrtf sqrt
#define fabsf abs
#define floorf floor
#define CAT_(a, b) a##_##b
#define CAT(a, b) CAT_(a, b)
#define KERNEL(NAME)                                                                                    \
    export void CAT(NAME, SUF)(uniform uint32 out[], uniform int w, uniform int h, uniform const float d[]) { \
        const uniform float iw = 1.0f / (float)w, ih = 1.0f / (float)h;                                 \
        for (uniform int y = 0; y < h; y++) {                                                           \
            const uniform float v = ((float)y + 0.5f) * ih;                                             \
            foreach (x = 0 ... w) { out[y * w + x] = px_##NAME(((float)x + 0.5f) * iw, v, d); }         \
        }                                                                                               \
    }
