/* Estimators: from kernels to integrals, images and their derivatives, the moving jumps included.
 *
 *   render        image or volume, or the integral over the domain
 *   grad_forward  derivative images along parameter directions (one direction a component)
 *   grad_reverse  gradient of sum a.I for an adjoint image a, or of a squared loss against a target
 *   grad_integral integral of every channel and its gradient in every parameter, with standard errors
 *
 * The boundary term is  + sum over axes i of (A_i/N_i) sum over crossings on lines parallel to e_i of [f]_i d_i g
 * d_theta g / |grad g|^2  (s_j-scaled by the sides of the domain or the pixel), [f]_i = f after - f before along +e_i:
 * the lattice estimator with squared-normal weights. See docs/estimators.md.
 *
 * Deterministic: fixed tiles, reduction in tile order, counter-based random numbers: the same seed gives the same bits
 * with any number of threads. Nothing here includes the compiler. A Scene is read-only during a call. */
#ifndef SALTUS_SAMPLE_ESTIMATE_H
#define SALTUS_SAMPLE_ESTIMATE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "runtime/base/status.h"
#include "saltus/job.h"
#include "saltus/kernel.h"

/* Compiled (or interpreted) kernels and what the runtime must know of the program. A NULL kernel is one that the
 * program does not need. */
typedef struct SltScene {
    /* Interpreted kernels have the same signature through `call`: every call goes through it when it is not NULL. */
    void (*call)(void *user, int kind, SltKernelArgs *args, uint32_t n);
    void *call_user;
    SltKernel *kernel[SLT_KERNELS]; /* by SltKernelKind; those of CULL are in cull_bounds */
    SltLayout layout[SLT_KERNELS];  /* what they read, and where their outputs are */
    bool f64;                       /* flt is double */
    bool flat_adj;                  /* layout of SltKernelArgs.adj */
    const uint8_t *dense; /* nfloats: 1 where a kernel may add to adj; the others get their adjoints through the log
                             alone. NULL: all */
    uint32_t width;       /* lanes */
    uint32_t dim, channels;
    double lo[3], hi[3];
    uint32_t nfloats, nints;
    const void *params; /* flt[nfloats] */
    const int32_t *iparams;
    const uint8_t *active; /* nfloats: 1 where the gradient is wanted */
    uint32_t nsites;
    const uint8_t *site_kind;   /* SltSiteKind */
    const uint8_t *site_static; /* 1: g does not depend on x (static discontinuity): contributes nothing */
    const uint8_t *site_skips;  /* 1: [SkipLoop], one boundary of many iterations; NULL: none is */
    int follow; /* thin features are followed from line to line of a lattice: 0 no, 1 not for rays in images, 2 yes */
    bool uses_rand;
    uint64_t tape_bytes; /* per lane, worst case; already capped by the compiler */
    uint32_t ncull;
    SltKernel *const *cull_bounds;               /* by cull_id: kernels of kind CULL */
    const uint32_t *cull_count;                  /* iterations of each */
    const struct SltGeometry *const *geometries; /* [ngeometries]; NULL: nobody asks it anything */
    uint32_t ngeometries;
    const uint32_t *geometry_base; /* where in `params` the numbers of each begin */
    void (*print)(void *user, const char *text, uint32_t len, const double *values, uint32_t n, uint32_t lane);
    void *print_user;
} SltScene;

/* Outputs of a role that a kernel has. */
static inline uint32_t scene_outputs(const SltScene *s, SltKernelKind kind, SltRole role) {
    return s->layout[kind].out[role].count;
}

/* Does it need no kernels but `value`? */
bool slt_estimate_by_differences(SltEstimator e);

/* Image (one pixel in integral mode: the integral): out[((z*h + y)*w + x)*channels + c], top row first. `half` 0: all
 * samples; 1, 2: one of the two independent sample halves (for squared losses). */
SltStatus slt_estimate_render(const SltScene *s, const SltJob *j, int half, float *out, SltStats *stats, SltError *err);

/* Derivative images along ndir directions of parameter space: dirs[k] is double[nfloats];
 * out[k] is an image. Image mode. crossings (may be NULL): an image counting crossings. */
SltStatus slt_estimate_forward(const SltScene *s, const SltJob *j, uint32_t ndir, const double *const *dirs,
                               float *const *out, float *crossings, SltStats *stats, SltError *err);

/* gradient[nfloats] of sum over pixels and channels of adjoint * image. `adjoint[2]`: for the two sample halves (the
 * same pointer twice where the adjoint does not come from this render: then both halves are used with it).
 * stderr_bound[nfloats] may be NULL: upper bound from interleaved cosets. */
SltStatus slt_estimate_reverse(const SltScene *s, const SltJob *j, const float *const adjoint[2], double *gradient,
                               double *stderr_bound, SltStats *stats, SltError *err);

/* Squared loss: mean over pixels and channels of mask * (I - T)^2 (target and mask have the image's shape; mask may be
 * NULL); each half of the samples takes its adjoint from the other. image (may be NULL) gets the full render. The loss
 * is the unbiased product of the two halves' residuals when two_halves, else of the full image. */
SltStatus slt_estimate_loss(const SltScene *s, const SltJob *j, const float *target, const float *mask, double *loss,
                            double *gradient, double *stderr_bound, float *image, SltStats *stats, SltError *err);

/* f at x[n][dim] into out[n][channels]; see slt_eval. */
SltStatus slt_estimate_points(const SltScene *s, const SltJob *j, uint64_t n, const double *x, const uint32_t *streams,
                              double *out, SltStats *stats, SltError *err);

SltStatus slt_estimate_integral(const SltScene *s, const SltJob *j, SltIntegral *out, SltStats *stats, SltError *err);

/* The crossing on the segment from a to b, if any. */
SltStatus slt_estimate_crossing(const SltScene *s, const double a[3], const double b[3], uint32_t stream,
                                SltCrossing *out, SltError *err);

#endif
