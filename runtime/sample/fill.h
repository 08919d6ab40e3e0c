/* What samples are made of, many at a time: random words, coordinates of the recurrence, positions in pixels; and what
 * they add up to by pixel. Compiled for each instruction set (fill_plain.c, fill_avx2.c, fill_avx512.c), the same bits
 * from all: those of rng_block, rng_recurrence and grid_place, sample by sample. fill_best chooses.
 *
 * Samples come in runs: samples of one pixel that lie side by side in the arrays of a batch, run behind run. Rows are
 * written in whole vectors: up to FILL_OVER numbers behind the last one may be overwritten, and as many behind the
 * inputs are read. */
#ifndef SALTUS_SAMPLE_FILL_H
#define SALTUS_SAMPLE_FILL_H

#include "runtime/base/rng.h"
#include "runtime/sample/grid.h"
#include "runtime/sample/roots.h"

enum { FILL_OVER = 16 };

/* The adjoint of a mean square. */
static inline float pixel_loss_adjoint(double residual, double mask, double numbers) {
    return (float)(2 * mask * residual / numbers);
}

/* What points of the recurrence become along an axis. */
typedef struct FillAxis {
    double lo, side; /* of the axis */
    uint64_t step;   /* what the recurrence adds from one sample of a run to the next, in 2^-64 */
    bool f64;        /* doubles are written */
    SltFilter filter;
    /* not of a box: Grid.radius, pixels along the axis, and Grid.before and Grid.mass of it */
    double radius;
    uint32_t n;
    const double *before, *mass;
} FillAxis;

typedef struct Fill {
    /* words[0][i], words[1][i]: the first two and the last two words of rng_block(seed, purpose, lane[i], counter[i]),
     * the earlier ones in the lower halves. */
    void (*blocks)(uint32_t seed, uint32_t purpose, uint32_t n, const uint32_t *lane, const uint64_t *counter,
                   uint64_t *const words[2]);
    /* Positions along an axis of the samples of runs, which are in pixels cell[runs] of it and begin at points
     * start[runs] of the recurrence, in 2^-64. count: samples of each; NULL: one of each. */
    void (*place)(const FillAxis *a, uint32_t runs, const uint32_t *count, const uint64_t *start, const int32_t *cell,
                  void *x);
    /* Words of 32 bits: that of sample i of run r is value[r] + i * step. */
    void (*spread)(uint32_t runs, const uint32_t *count, const void *value, uint32_t step, void *to);
    /* Adds the samples f of each run in their order to to[0], to[stride], ...; count as for `place`. */
    void (*sum_f32)(const float *f, uint32_t runs, const uint32_t *count, double *to, uint32_t stride);
    void (*sum_f64)(const double *f, uint32_t runs, const uint32_t *count, double *to, uint32_t stride);
    /* to[n] = sum[n] / count */
    void (*mean)(const double *sum, uint64_t n, uint32_t count, float *to);
    /* The sum of m a b in order, of residuals a and b of the halves of an image, and in place of each half
     * 2 m / numbers times the other's residual; half[1] NULL: of one image, with itself. mask m: NULL: 1. */
    double (*residuals)(float *half0, float *half1, const float *target, const float *mask, uint64_t n, double numbers);
    /* roots.h: prepares the next evaluation of brackets 0 .. n - 1; takes g at `next`, doubles or floats, of which as
     * many more are read as fill a vector. */
    void (*roots_step)(Roots *r, uint32_t n);
    void (*roots_take)(Roots *r, uint32_t n, const void *g, bool f64);
    /* How many bytes from v on are 0: all `bytes` of them, or of those before the first that is not whole 64 a time. */
    uint64_t (*zeros)(const void *v, uint64_t bytes);
    /* Are all floats, or doubles, of so many bytes finite? */
    bool (*finite)(const void *v, uint64_t bytes, bool f64);
} Fill;
extern const Fill fill_plain, fill_avx2, fill_avx512;
/* All that this machine can run, narrowest first; returns how many. */
uint32_t fill_all(const Fill *all[3]);
const Fill *fill_best(void);

/* Point `index` of a recurrence with this shift, in 2^-64. */
static inline uint64_t fill_start(uint32_t shift, uint64_t ratio, uint64_t index) {
    return ((uint64_t)shift << 32 | 0x80000000u) + index * ratio;
}
/* pattern_stream of samples first[r], first[r] + stride, ... (1 or 4) of owner[r]; count as for `place`. */
typedef struct FillStreams {
    uint32_t seed, lane, stride;
    RngPurpose purpose;
} FillStreams;
void fill_streams(const Fill *f, const FillStreams *s, uint32_t runs, const uint32_t *count, const uint64_t *owner,
                  const uint64_t *first, int32_t *to);

#endif
