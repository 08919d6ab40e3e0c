/* Jobs and results: what is to be estimated, how, and what came out. Plain data, owned by the caller. */
#ifndef SALTUS_JOB_H
#define SALTUS_JOB_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum SltEstimator {
#define SLT_ESTIMATOR(id, ...) SLT_EST_##id,
#define SLT_DIFFERENCES(id, ...) SLT_EST_##id,
#include "saltus/estimators.def"
    SLT_ESTIMATORS
} SltEstimator;
typedef enum SltFilter { SLT_FILTER_BOX, SLT_FILTER_TENT, SLT_FILTER_GAUSSIAN } SltFilter;

typedef struct SltJob {
    bool integral;     /* the whole domain is one pixel */
    uint32_t size[3];  /* image mode: pixels by axis (x, y, z); row 0 is the top */
    uint32_t spp;      /* samples a pixel (integral mode: 0) */
    uint64_t samples;  /* integral mode, in all */
    uint64_t segments; /* boundary segments a pixel, or in all in integral mode; 0: as the samples */
    SltFilter filter;
    uint32_t seed, threads; /* threads 0: all cores */
    SltEstimator estimator;
    bool no_interior, no_boundary;
    uint32_t replicates;        /* independent lattices for standard errors, integral mode; 0: 4. In image mode 1 */
    double fd_step;             /* SLT_EST_FD; 0: by precision */
    double time_limit;          /* seconds; 0: none. Status SLT_LIMIT */
    volatile const int *cancel; /* non-zero: stop soon, status SLT_INTERRUPTED */
    void (*progress)(void *user, double fraction);
    void *progress_user;
} SltJob;

/* Why a crossing was not integrated (docs/estimators.md); coincident ones were, but have no derivative. */
typedef enum SltDrop {
    SLT_DROP_ZERO_GRADIENT,
    SLT_DROP_NOT_FINITE,
    SLT_DROP_INCONSISTENT,
    SLT_DROP_NO_EVENT,
    SLT_DROP_NO_ROOT,
    SLT_DROP_STATIC,
    SLT_DROP_HALVINGS, /* key "depth": halved too often */
    SLT_DROP_COINCIDENT,
    SLT_DROP_REASONS
} SltDrop;
extern const char *const slt_drop_names[SLT_DROP_REASONS]; /* JSON keys: "zero_gradient", ... */

typedef struct SltStats {
    uint64_t samples, segments, crossings;
    uint64_t evaluations; /* of f or of its path, for bench: every kernel counts */
    uint64_t dropped[SLT_DROP_REASONS];
    uint64_t truncated, asserts, nonfinite;
    double seconds;
    double seconds_interior, seconds_boundary;
} SltStats;

typedef struct SltIntegral {
    double *value, *value_stderr;       /* [channels] */
    double *gradient, *gradient_stderr; /* [channels][nfloats] */
    double *interior, *boundary;        /* [channels][nfloats] */
    double *missed_estimate;            /* [channels][nfloats]: what lines half as dense would have missed */
    bool replicates;                    /* stderr_kind: "replicates" or "bound" */
} SltIntegral;                          /* arrays owned by the caller, may be NULL each */
/* The story of one point (explain --at): the crossing found on a segment from a to b: fills what is found. */
typedef struct SltCrossing {
    bool found;
    double x[3], t, g, dg[3], f_before[4], f_after[4];
    int32_t site, k[8];
    int drop; /* SltDrop, or -1 */
} SltCrossing;

#ifdef __cplusplus
}
#endif
#endif
