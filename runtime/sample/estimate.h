/* Estimators: from kernels to integrals, images and their derivatives, the moving jumps included.
 *
 *   render        image or volume, or the integral over the domain
 *   grad_forward  derivative images along parameter directions (one direction a component)
 *   grad_reverse  gradient of sum a.I for an adjoint image a, or of a squared loss against a target
 *   grad_integral integral of every channel and its gradient in every parameter, with standard errors
 *
 * The boundary term is  + sum over axes i of (A_i/N_i) sum over crossings on lines parallel to e_i of [f]_i d_i g d_theta g / |grad g|^2  (s_j-scaled by the sides of the
 * domain or the pixel), [f]_i = f after - f before along +e_i: the lattice estimator with squared-normal weights. See docs/estimators.md.
 *
 * Deterministic: fixed tiles, reduction in tile order, counter-based random numbers: the same seed gives the same bits with any
 * number of threads. Nothing here includes the compiler. A Scene is read-only during a call. */
#ifndef SALTUS_SAMPLE_ESTIMATE_H
#define SALTUS_SAMPLE_ESTIMATE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "runtime/base/status.h"
#include "saltus/kernel.h"

typedef enum SltSiteKind { SLT_SITE_COMPARE, SLT_SITE_FLOOR, SLT_SITE_CEIL, SLT_SITE_ROUND, SLT_SITE_TRUNC, SLT_SITE_FMOD, SLT_SITE_FIELD } SltSiteKind;

/* Compiled (or interpreted) kernels and what the runtime must know of the program. A NULL kernel is one that the program does not need. */
typedef struct SltScene {
    /* Interpreted kernels have the same signature through `call`: every call goes through it when it is not NULL. */
    void (*call)(void *user, int kind, SltKernelArgs *args, uint32_t n);
    void *call_user;
    SltKernel *value, *region, *event, *sides, *site, *site_grad, *site_jvp, *site_vjp, *jvp, *vjp;
    bool f64;               /* flt is double */
    bool flat_adj;          /* layout of SltKernelArgs.adj */
    uint32_t width;         /* lanes */
    uint32_t dim, channels;
    double lo[3], hi[3];
    uint32_t nfloats, nints;
    const void *params;     /* flt[nfloats] */
    const int32_t *iparams;
    const uint8_t *active;  /* nfloats: 1 where the gradient is wanted */
    uint32_t nsites;
    const uint8_t *site_kind; /* SltSiteKind */
    const uint8_t *site_static; /* 1: g does not depend on x (static discontinuity): contributes nothing */
    uint32_t event_depth;   /* number of k outputs of the event kernel */
    bool near_miss;         /* region kernel has near outputs: near_site, near_g, near_k0.. */
    bool uses_rand;
    uint64_t tape_bytes;    /* per lane, worst case; already capped by the compiler */
    uint32_t ncull;
    SltKernel *const *cull_bounds; /* by cull_id: in K0 = iteration, out lo.x lo.y hi.x hi.y */
    const uint32_t *cull_count;    /* iterations of each */
    const struct SltField *const *fields;
    void (*print)(void *user, const char *text, uint32_t len, const double *values, uint32_t n, uint32_t lane);
    void *print_user;
} SltScene;

typedef enum SltEstimator { SLT_EST_LATTICE, SLT_EST_SCANLINE, SLT_EST_SNAP_KNN, SLT_EST_SNAP_CROFTON, SLT_EST_FD } SltEstimator;
typedef enum SltFilter { SLT_FILTER_BOX, SLT_FILTER_TENT, SLT_FILTER_GAUSSIAN } SltFilter;

typedef struct SltJob {
    bool integral;              /* the whole domain is one pixel */
    uint32_t size[3];           /* image mode: pixels by axis (x, y, z); row 0 is the top */
    uint32_t spp;               /* samples a pixel (integral mode: 0) */
    uint64_t samples;           /* integral mode, in all */
    uint64_t segments;          /* boundary segments a pixel, or in all in integral mode; 0: as the samples. A lattice vertex owns dim segments */
    SltFilter filter;
    uint32_t seed, threads;     /* threads 0: all cores */
    SltEstimator estimator;
    bool no_interior, no_boundary;
    uint32_t replicates;        /* independent lattices for standard errors: 4 in integral mode (default 0 = 4), 1 in image mode */
    double fd_step;             /* SLT_EST_FD; 0: by precision */
    double time_limit;          /* seconds; 0: none. Status SLT_LIMIT */
    volatile const int *cancel; /* non-zero: stop soon, status SLT_INTERRUPTED */
    void (*progress)(void *user, double fraction);
    void *progress_user;
} SltJob;

typedef enum SltDrop { SLT_DROP_ZERO_GRADIENT, SLT_DROP_NOT_FINITE, SLT_DROP_INCONSISTENT, SLT_DROP_NO_EVENT, SLT_DROP_NO_ROOT, SLT_DROP_STATIC, SLT_DROP_DEPTH, SLT_DROP_COINCIDENT, SLT_DROP_REASONS } SltDrop;
extern const char *const slt_drop_names[SLT_DROP_REASONS]; /* JSON keys: "zero_gradient", ... */

typedef struct SltStats {
    uint64_t samples, segments, crossings, evaluations; /* evaluations of f or of its path, for bench: every kernel counts */
    uint64_t dropped[SLT_DROP_REASONS];
    uint64_t truncated, asserts, nonfinite;
    double seconds;
    double seconds_interior, seconds_boundary;
} SltStats;

/* Image: out is flt-independent double or float? float: out[((z*h + y)*w + x)*channels + c], top row first. `half` 0: all samples; 1, 2: one of the two
 * independent sample halves (for squared losses). */
SltStatus slt_render(const SltScene *s, const SltJob *j, int half, float *out, SltStats *stats, SltError *err);

/* Derivative images along ndir directions of parameter space: dirs[k] is flt-typed double[nfloats] (sparse directions are cheap: unit vectors);
 * out[k] is an image. Image mode. crossings (may be NULL): an image counting crossings. */
SltStatus slt_grad_forward(const SltScene *s, const SltJob *j, uint32_t ndir, const double *const *dirs, float *const *out, float *crossings, SltStats *stats, SltError *err);

/* gradient[nfloats] of sum over pixels and channels of adjoint * image. `adjoint[2]`: for the two sample halves (the same pointer twice where the adjoint
 * does not come from this render: then both halves are used with it). stderr_bound[nfloats] may be NULL: upper bound from interleaved cosets. */
SltStatus slt_grad_reverse(const SltScene *s, const SltJob *j, const float *const adjoint[2], double *gradient, double *stderr_bound, SltStats *stats, SltError *err);

/* Squared loss: mean over pixels and channels of mask * (I - T)^2; each half of the samples takes its adjoint from the other. image (may be NULL) gets the full render. The loss is
 * the unbiased product of the two halves' residuals when two_halves, else of the full image. */
SltStatus slt_loss_gradient(const SltScene *s, const SltJob *j, const float *target, const float *mask, double *loss, double *gradient, double *stderr_bound, float *image, SltStats *stats, SltError *err);

typedef struct SltIntegral {
    double *value, *value_stderr;              /* [channels] */
    double *gradient, *gradient_stderr;        /* [channels][nfloats] */
    double *interior, *boundary;               /* [channels][nfloats] */
    double *missed_estimate;                   /* [channels][nfloats]: what the half-resolution lines would have missed */
    bool replicates;                           /* stderr_kind: "replicates" or "bound" */
} SltIntegral;                                 /* arrays owned by the caller, may be NULL each */
SltStatus slt_grad_integral(const SltScene *s, const SltJob *j, SltIntegral *out, SltStats *stats, SltError *err);

/* The story of one point (explain --at): the crossing found on a segment from a to b: fills what is found. */
typedef struct SltCrossing {
    bool found;
    double x[3], t, g, dg[3], f_before[4], f_after[4];
    int32_t site, k[8];
    int drop;                                  /* SltDrop, or -1 */
} SltCrossing;
SltStatus slt_find_crossing(const SltScene *s, const double a[3], const double b[3], uint32_t stream, SltCrossing *out, SltError *err);

#endif
