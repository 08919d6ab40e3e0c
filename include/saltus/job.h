/* Jobs and results: what is to be estimated, how, and what came out. Plain data, owned by the caller.
 *
 * Structs that callers allocate, here and in saltus.h, begin with their size, so that a program and a library of other
 * versions understand each other. Start from SLT_JOB_INIT and its like. A shorter struct than the library's lacks
 * members that came later: these have their defaults, and nothing is written there. A longer one is a newer program's:
 * what the library does not know it leaves alone, but where it reads such a struct that part must be zero, else the
 * status is SLT_USAGE. A size of 0, a forgotten _INIT, is SLT_USAGE too. SltError and SltSet have no size: they never
 * change. */
#ifndef SALTUS_JOB_H
#define SALTUS_JOB_H

#include <stdbool.h>
#include <stddef.h>
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
    size_t struct_size;
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
    /* The parameters of this call alone, slt_float_count and slt_int_count of them; NULL: those of the program, which
     * neither are changed by it. */
    const double *floats;
    const int32_t *ints;
} SltJob;
#define SLT_JOB_INIT ((SltJob){.struct_size = sizeof(SltJob), .size = {512, 512, 1}, .spp = 4})

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

/* Calls add to what is there: one struct can collect those of many calls. */
typedef struct SltStats {
    size_t struct_size;
    uint64_t samples, segments, crossings;
    uint64_t evaluations; /* of f or of its path, for bench: every kernel counts */
    uint64_t dropped[SLT_DROP_REASONS];
    uint64_t truncated, asserts, nonfinite;
    double seconds;
    double seconds_interior, seconds_boundary;
} SltStats;
#define SLT_STATS_INIT ((SltStats){.struct_size = sizeof(SltStats)})

/* Arrays of the caller; NULL: not wanted. */
typedef struct SltIntegral {
    size_t struct_size;
    double *value, *value_stderr;       /* [channels] */
    double *gradient, *gradient_stderr; /* [channels][nfloats] */
    double *interior, *boundary;        /* [channels][nfloats] */
    double *missed_estimate;            /* [channels][nfloats]: what lines half as dense would have missed */
    bool replicates;                    /* stderr_kind: "replicates" or "bound" */
} SltIntegral;
#define SLT_INTEGRAL_INIT ((SltIntegral){.struct_size = sizeof(SltIntegral)})

/* The story of one point (explain --at): the crossing found on a segment from a to b: fills what is found. */
typedef struct SltCrossing {
    size_t struct_size;
    bool found;
    double x[3], t, g, dg[3], f_before[4], f_after[4];
    int32_t site, k[8];
    int drop; /* SltDrop, or -1 */
} SltCrossing;
#define SLT_CROSSING_INIT ((SltCrossing){.struct_size = sizeof(SltCrossing)})

#ifdef __cplusplus
}
#endif
#endif
