/* Estimators: from kernels to integrals, images and their derivatives, the moving jumps included.
 *
 *   slt_estimate_render    image or volume, or the integral over the domain
 *   slt_estimate_forward   derivative images along directions in parameter space
 *   slt_estimate_reverse   gradient of the sum of adjoint * image
 *   slt_estimate_loss      a squared loss against a target, and its gradient
 *   slt_estimate_integral  integral of every channel and its gradient in every parameter, with standard errors
 *   slt_estimate_points    f at given points
 *   slt_estimate_crossing  the crossing on one segment
 *
 * The boundary term is the sum over axes i, and over the crossings on lines parallel to axis i, of
 *     (A_i / N_i) [f]_i  s_i^2 d_i g / (sum over j of (s_j d_j g)^2)  d_theta g:
 * A_i / N_i is the cross-section that a line stands for, [f]_i the jump of f along axis i, s_j the sides of the domain
 * or of a pixel. docs/estimators.md explains it.
 *
 * Deterministic: fixed tiles, sums in tile order, counter-based random numbers: the same seed gives the same bits with
 * any number of threads. Nothing here includes the compiler. The caller owns the SltScene and all arrays; a scene is
 * read-only during a call. */
#ifndef SALTUS_SAMPLE_ESTIMATE_H
#define SALTUS_SAMPLE_ESTIMATE_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "runtime/base/side.h"
#include "runtime/base/status.h"
#include "saltus/job.h"
#include "saltus/kernel.h"

/* Compiled (or interpreted) kernels and what the runtime must know of the program. It owns nothing. A NULL kernel is
 * one that the program does not need. */
/* What may change at the jump of a seam that moves with a parameter, though no g crosses 0 there. */
typedef enum SltUpset {
    SLT_UPSETS_NOTHING,
    SLT_UPSETS_SITES, /* what sites decide, and so the hash */
    SLT_UPSETS_UNSEEN /* f, whatever decides: no [NoDisc] says that it does not matter */
} SltUpset;

/* Two sites whose g are one, up to a factor, where some parameters are equal. */
typedef struct SltTwins {
    uint32_t site[2];
    double times; /* g of the second is so many times that of the first */
    bool indexed; /* the parameters are those of an iteration */
} SltTwins;

/* How many calls go to VJP_GUARDED at once, since VJP came to no end lately. Both give the same bits where both are
 * finite, so threads may take turns as they like. */
typedef struct SltDoubt {
    _Atomic uint32_t left, next; /* next: how many it will be */
} SltDoubt;

typedef struct SltScene {
    /* Not NULL: kernels are interpreted, and every call of a kernel goes through this function. */
    void (*call)(void *user, int kind, SltKernelArgs *args, uint32_t n);
    void *call_user;
    SltKernel *kernel[SLT_KERNELS]; /* by SltKernelKind; those of CULL are in cull_bounds */
    /* Compiles what slt_kernel_late stands for in `kernel`, on the thread that calls it first. NULL: it could not. */
    SltKernel *(*make)(void *user, int kind);
    void *make_user;
    SltLayout layout[SLT_KERNELS]; /* what they read, and where their outputs are */
    bool f64;                      /* flt is double */
    const uint8_t *dense; /* [nfloats]: 1 where a kernel may add to adj; the others get their adjoints through the log
                             alone. NULL: all */
    bool site_logs;       /* SITE_VJP adds to adj nowhere */
    uint32_t adj_lanes;   /* SltKernelArgs.adj is flt[nfloats][adj_lanes] */
    uint32_t widest;      /* most lanes of any kernel; 0: SLT_PAD */
    uint32_t lanes[SLT_KERNELS]; /* of this one, at most; 0: widest */
    uint32_t dim, channels;
    double lo[3], hi[3]; /* the domain, by axis */
    uint32_t nfloats, nints;
    uint32_t nplaced;                 /* the last of the floats: those of derived arrays (runtime/sample/derived.h) */
    const struct SltDerived *derived; /* [nderived] */
    uint32_t nderived;
    const void *params;     /* flt[nfloats] */
    const int32_t *iparams; /* [nints] */
    const uint8_t *active;  /* [nfloats]: 1 where the gradient is wanted; NULL: everywhere */
    uint32_t nsites;
    const uint8_t *site_kind;   /* [nsites]: SltSiteKind */
    const uint8_t *site_static; /* [nsites]: 1 where g does not depend on x: contributes nothing; NULL: none */
    const uint8_t *site_skips;  /* [nsites]: 1 under [SkipLoop], one boundary of many iterations; NULL: none */
    const uint8_t *site_ties;   /* [nsites]: 1 where g hangs on a choice that parameters alone make; NULL: none */
    const SltTwins *twins;      /* [ntwins] */
    uint32_t ntwins;
    double work;                /* instructions that a sample takes at most; 0: not known, or few */
    bool still;                 /* what is no site does not move */
    uint32_t nedges;            /* sites, then seams, which only `bounds` and the edge kernels know */
    const uint8_t *edge_kind;   /* [nedges]: SltSiteKind */
    const uint8_t *edge_upsets; /* [nedges]: SltUpset; NULL: none */
    const int8_t *edge_argmin;  /* [nedges]: the sign of g with which an iteration takes over, of loops around it
                                   that keep one alone, of the least key: they carry nothing else; 0: no such edge.
                                   NULL: none */
    const uint8_t *edge_bends;  /* [nedges]: 1 for a minimum, maximum or absolute value; NULL: none */
    double *followed;           /* lattices of integrals: crossings of a replicate found along fingers; NULL likewise */
    uint8_t *met;               /* [nsites + 1]: lattices of integrals set what lines have met to 1, and the last,
                                   as they were asked; NULL: nobody wants to know */
    const uint32_t *edge_line;  /* [nedges]: of the source; NULL: not known */
    bool flat;                  /* between edges neither f nor its derivatives change with the position */
    bool told;                  /* and they are the same wherever the hash is: seams do not jump */
    bool rigid;                 /* f changes with the parameters by jumps alone: VJP has no adjoints to add to */
    uint32_t nlists;            /* loops with lists, [Cull] loops first: lengths of SltKernelArgs.cull, .note */
    const uint32_t *list_count; /* [nlists]: iterations of each */
    const uint8_t *list_noted;  /* [nlists]: 1 where `bounds` notes which of them can matter; NULL: nowhere */
    bool hides;                 /* hashes do not hang on iterations that later ones overwrite */
    const struct SltChunks *chunks; /* of prune and pruned (saltus/chunks.h); NULL: the program has no use for them */
    bool chunked; /* bounds and the edge kernels are in chunks too: its choices are edges behind all others */
    int follow;   /* fingers are followed from line to line of a lattice: 0 never, 1 but not rays in images, 2 always */
    bool uses_rand;
    bool pixelwise;      /* f is one number all over a pixel, and all over the domain of an integral */
    bool boundless;      /* nothing is known of f on boxes: `bounds` and the edge kernels are never made */
    bool detached;       /* somewhere the program has no derivative of a value on purpose */
    bool frugal;         /* whoever asks takes many steps, and bears noise: SLT_EST_AUTO spends what the lattice does */
    uint64_t tape_bytes; /* a lane, the largest of all kernels */
    bool tape_grows;     /* some push more, with what queries tell */
    atomic_bool *tape_full; /* a tape that grows was: derivatives are not whole */
    SltDoubt *doubt;        /* of VJP, where there is a VJP_GUARDED; NULL: it is always tried first */
    uint32_t ncull;
    SltKernel *const *cull_bounds;               /* [ncull]: kernels of kind CULL, by [Cull] loop */
    const uint32_t *cull_count;                  /* [ncull]: iterations of each loop */
    const struct SltGeometry *const *geometries; /* [ngeometries]; NULL: no kernel asks it anything */
    uint32_t neighbours, halvings; /* of snapped segments, and down to which roots are searched, where a benchmark
                                      varies them; 0: 14 and 15 */
    uint32_t ngeometries;
    const uint32_t *geometry_base; /* [ngeometries]: where in `params` the numbers of each begin */
    struct Side *side;             /* a thread beside the one that answers; NULL: none */
    void (*print)(void *user, const char *text, uint32_t len, const double *values, uint32_t n, uint32_t lane);
    void *print_user;
} SltScene;

/* How many outputs of a role a kernel has. */
static inline uint32_t scene_outputs(const SltScene *s, SltKernelKind kind, SltRole role) {
    return s->layout[kind].out[role].count;
}

/* Is the site about a ray that meets a mesh? */
static inline bool scene_is_of_mesh(const SltScene *s, int32_t site) {
    return (uint32_t)site < s->nsites && s->site_kind[site] >= SLT_SITE_MESH &&
           s->site_kind[site] <= SLT_SITE_MESH_SHADOW;
}
static inline bool scene_asks_meshes(const SltScene *s) {
    for (uint32_t i = 0; i < s->nsites; i++)
        if (scene_is_of_mesh(s, (int32_t)i)) return true;
    return false;
}
/* The integral by lines and samples: as many as the job says, or, where it wants an error, until that is reached;
 * SltStats.stopped says where it was not. */
SltStatus slt_estimate_sampled(const SltScene *s, const SltJob *j, SltIntegral *out, SltStats *stats, SltError *err);
/* Single precision: how many units in the last place of a coordinate lie between neighbouring lines of a lattice for
 * this job, along the axis where that is least; infinite in double precision. */
double slt_estimate_ulps(const SltScene *s, const SltJob *j);
/* The largest stated error of an integral, in parts of what the job wants it to be; 0: it wants none. */
double slt_estimate_beyond(const SltScene *s, const SltJob *j, const SltIntegral *out);

/* Does this estimator difference renders, so that it needs no kernel but `value`? */
bool slt_estimate_by_differences(SltEstimator e);

/* False where SLT_EST_AUTO is SLT_EST_LATTICE whatever the program's bounds say, which then need not be compiled. */
bool slt_estimate_has_choice(const SltScene *s, const SltJob *j);
bool slt_estimate_hopes(const SltScene *s, const SltJob *j, uint64_t events); /* quadrature_likely */
/* SLT_EST_LATTICE instead of SLT_EST_AUTO where a look at the program's bounds on a few hundred boxes is enough to see
 * that cells will not pay, which needs the kernel `bounds` alone. Else the job's estimator. */
SltEstimator slt_estimate_choose(const SltScene *s, const SltJob *j, SltStats *stats);

/* A place holder in SltScene.kernel, compared and never called: the kernel is compiled when first called. */
void slt_kernel_late(SltKernelArgs *args, uint32_t n);

/* out[((z*h + y)*w + x)*channels + c], top row first; in integral mode out[channels]. Sampled, unless the estimator is
 * SLT_EST_QUADRATURE or the interior SLT_INTERIOR_QUADRATURE. `half` 0: all samples of a pixel;
 * 1 or 2: one of two independent halves of them (for squared losses). */
SltStatus slt_estimate_render(const SltScene *s, const SltJob *j, int half, float *out, SltStats *stats, SltError *err);

/* Image mode. Derivative images out[ndir] along directions dirs[ndir], each double[nfloats]. crossings (may be NULL):
 * crossings by pixel, as float. */
SltStatus slt_estimate_forward(const SltScene *s, const SltJob *j, uint32_t ndir, const double *const *dirs,
                               float *const *out, float *crossings, SltStats *stats, SltError *err);

/* Image mode. gradient[nfloats] of the sum over pixels and channels of adjoint * image. adjoint[0] and [1] are images
 * for the two halves of the samples, or the same pointer: then it is for all samples. stderr_bound[nfloats] (may be
 * NULL): an upper bound of the standard error, from interleaved cosets. */
SltStatus slt_estimate_reverse(const SltScene *s, const SltJob *j, const float *const adjoint[2], double *gradient,
                               double *stderr_bound, SltStats *stats, SltError *err);

/* Image mode. The loss is the mean over pixels and channels of mask * (I - T)^2; target and mask (may be NULL) have the
 * image's shape. With spp > 1 it is the product of the residuals of the two halves of the samples, unbiased, and each
 * half takes its adjoint from the other; with spp 1 the square of the one residual. loss, gradient and stderr_bound
 * [nfloats] and image, which gets the full render, may be NULL. */
SltStatus slt_estimate_loss(const SltScene *s, const SltJob *j, const float *target, const float *mask, double *loss,
                            double *gradient, double *stderr_bound, float *image, SltStats *stats, SltError *err);

/* f at x[n][dim] into out[n][channels]; see slt_eval. */
SltStatus slt_estimate_points(const SltScene *s, const SltJob *j, uint64_t n, const double *x, const uint32_t *streams,
                              double *out, SltStats *stats, SltError *err);

/* See SltIntegral; as if job.integral were set. */
SltStatus slt_estimate_integral(const SltScene *s, const SltJob *j, SltIntegral *out, SltStats *stats, SltError *err);
/* Afterwards, where s->met is: what lines step over, and what small things weigh that no line has met, is added to the
 * estimate of what is missed and to the errors. Wants the kernel `bounds`. */
bool slt_estimate_by_lines(const SltScene *s); /* is the answer that of lines? */
bool slt_estimate_has_unmet(const SltScene *s);
/* What lines step over may be looked for before and while they run, with the same job, of derivatives of an integral
 * with errors: by any one thread, and until then scene, job and what they point to must stay, and no kernel be
 * exchanged. NULL: it is not likely to be asked for. */
typedef struct SltHidden SltHidden;
SltHidden *slt_estimate_hidden_new(const SltScene *s, const SltJob *j);
void slt_estimate_hidden_look(SltHidden *h);
void slt_estimate_hidden_free(SltHidden *h); /* h may be NULL */
/* seen: what has been looked for; NULL: nothing. */
SltStatus slt_estimate_hidden(const SltScene *s, const SltJob *j, const SltHidden *seen, SltIntegral *out,
                              SltStats *stats, SltError *err);

/* The crossing nearest to a on the segment from a to b, if any. */
SltStatus slt_estimate_crossing(const SltScene *s, const double a[3], const double b[3], uint32_t stream,
                                SltCrossing *out, SltError *err);

#endif
