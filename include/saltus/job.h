/* Jobs and results: what is to be estimated, how, and what came out. Plain data, owned by the caller.
 *
 * Structs that callers allocate, here, in saltus.h and in fit.h, begin with their size, so that a program and a library
 * of different versions understand each other. Start from SLT_JOB_INIT and its like. A struct shorter than the
 * library's lacks members that were added later: the library takes their defaults and writes nothing there. A longer
 * one comes from a newer program: the library leaves alone the part that it does not know, but where it reads the
 * struct that part must be zero, else the status is SLT_USAGE. A size of 0 (a forgotten _INIT) is SLT_USAGE too.
 * Structs without a size (SltError, SltSet, SltOpenEvent, SltFitNumber, SltFitMask) never change. */
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
#define SLT_CELLS(id, ...) SLT_EST_##id,
#include "saltus/estimators.def"
    SLT_ESTIMATORS
} SltEstimator;
typedef enum SltFilter { SLT_FILTER_BOX, SLT_FILTER_TENT, SLT_FILTER_GAUSSIAN } SltFilter;

/* How the smooth part is integrated. AUTO: by quadrature where the estimator is SLT_EST_QUADRATURE or _AUTO and
 * certifies the domain, else by samples. */
typedef enum SltInterior { SLT_INTERIOR_AUTO, SLT_INTERIOR_SAMPLES, SLT_INTERIOR_QUADRATURE } SltInterior;

typedef struct SltJob {
    size_t struct_size;
    bool integral;          /* the whole domain is one pixel; else image mode */
    uint32_t size[3];       /* image mode: pixels along x, y, z, 1 to 2^24 each; axes beyond slt_dim do not count */
    uint32_t spp;           /* image mode: samples a pixel */
    uint64_t samples;       /* integral mode: samples in all */
    uint64_t segments;      /* boundary segments, a pixel or in integral mode in all; 0: as many as samples */
    SltFilter filter;       /* image mode */
    uint32_t seed, threads; /* threads 0: all cores; the result is the same bits for any number */
    SltEstimator estimator; /* of the boundary term */
    bool no_interior, no_boundary; /* leave that part of a derivative out */
    uint32_t replicates; /* integral mode: lattices whose spread gives the standard errors; 0: 4, or 8 with rand() */
    double fd_step;      /* SLT_EST_FD: the step h; 0: max(0.1, |parameter|) / 100 */
    double time_limit;   /* seconds, then status SLT_LIMIT; 0: none */
    volatile const int *cancel;                    /* may be NULL; non-zero: stop soon, status SLT_INTERRUPTED */
    void (*progress)(void *user, double fraction); /* may be NULL; fraction 0 to 1, one call at a time */
    void *progress_user;
    /* Parameters for this call alone: floats[slt_float_count], ints[slt_int_count]; NULL: the program's own. The call
     * leaves the program's own as they are. */
    const double *floats;
    const int32_t *ints;
    /* SLT_EST_QUADRATURE, SLT_EST_AUTO */
    SltInterior interior;
    uint32_t gauss; /* points along a piece of a curve, 1 to SLT_GAUSS_MAX, the same everywhere; 0: as needed */
    double error, abs_error;  /* refine until the stated error is below: relative to the largest component, or pixel, or
                                 absolute; 0: spend what the lattice would */
    uint64_t max_evaluations; /* of points and boxes; then the result so far, and SltStats.stopped; 0: by `segments`,
                                 and with an error wanted 2^25 or more: docs/estimators.md */
    bool centred; /* image mode: one sample in the middle of each pixel, whatever spp and the filter are; of slt_render
                     and of the smooth part of derivatives, where these are sampled */
} SltJob;
enum { SLT_GAUSS_MAX = 16 };
#define SLT_JOB_INIT ((SltJob){.struct_size = sizeof(SltJob), .size = {512, 512, 1}, .spp = 4, .estimator = SLT_EST_AUTO})

/* Why a crossing was not integrated (docs/estimators.md). g: the boundary function of its site. */
typedef enum SltDrop {
    SLT_DROP_ZERO_GRADIENT, /* g has no slope at the crossing */
    SLT_DROP_NOT_FINITE,    /* g, its gradient or the jump is not finite */
    SLT_DROP_INCONSISTENT, /* g changes by far more than its gradient allows: it jumps itself, or has a multiple root */
    SLT_DROP_NO_EVENT,     /* f jumps, but no site decides differently: an untracked discontinuity */
    SLT_DROP_NO_ROOT,      /* g has the same sign on both sides */
    SLT_DROP_STATIC,       /* g does not depend on the position */
    SLT_DROP_HALVINGS,     /* the segment was bisected too often; its JSON key is "depth", of the bisection */
    SLT_DROP_COINCIDENT,   /* integrated, but boundaries lie there that move apart: the integral has no derivative */
    SLT_DROP_REASONS
} SltDrop;
extern const char *const slt_drop_names[SLT_DROP_REASONS]; /* JSON keys: "zero_gradient", ... */

/* Where something happened: of all such places the one with the least x, whatever the threads. All zero: not known. */
typedef struct SltPlace {
    bool known;
    bool in_image;           /* pixel says something */
    uint32_t site;           /* 1 + the site whose g was asked; 0: none */
    uint32_t line, column;   /* in the source, from 1; 0: not known */
    uint32_t pixel[3];       /* column, row from the top, slice */
    const char *file, *text; /* the program's: the file, and what stands there; NULL: not known */
    double x[3], beyond[3];  /* of a crossing that was dropped: points on its two sides; else beyond is x */
    int32_t stream;          /* of random numbers, and number 0 of it */
    double rand0;
} SltPlace;

/* What ended a refinement towards an error before it was reached. */
typedef enum SltStop { SLT_STOP_NONE, SLT_STOP_EVALUATIONS, SLT_STOP_ROUNDING } SltStop;

/* Counts of a call. Calls add to what is there, so that one struct can collect those of many. */
typedef struct SltStats {
    size_t struct_size;
    uint64_t samples, segments, crossings;
    uint64_t evaluations;               /* runs of any kernel on one sample */
    uint64_t dropped[SLT_DROP_REASONS]; /* crossings, by SltDrop */
    uint64_t truncated, asserts;        /* loops cut at [MaxIters], asserts failed */
    uint64_t nonfinite;                 /* results that are not finite, samples that were left out for that */
    double seconds;                     /* of wall time, in all */
    double seconds_interior, seconds_boundary;
    /* Estimators with cells; of the last call. */
    bool cells;             /* cells were used, and the members below say something */
    double certified;       /* share of the domain on which every jump of f is proven to be among those integrated */
    double settled, curved; /* its two parts: no event is open; all that are open are curves with Gauss points */
    double left;            /* measure of the rest, in units of the domain */
    double left_bound;      /* what the rest can hide of a value, at most; NaN: not bounded */
    uint64_t boxes;         /* evaluations of bounds, which count in `evaluations` too */
    SltStop stopped;
    double upset; /* measure of cells in which f jumps, at a place that moves, where no [Disc] is, or where such a place
                     makes a [Disc] decide otherwise; it is part of settled or curved, not of certified */
    uint32_t upset_line; /* where the first such jump stands in the source; 0: there is none */
    double ulps;         /* of coordinates in single precision between neighbouring lines, where they are fewer than
                            SLT_FEW_ULPS: answers are then wrong by more than is stated; 0: enough. Of the last call */
    SltPlace dropped_at[SLT_DROP_REASONS]; /* and the site or the decision that is to blame */
    SltPlace nonfinite_at;                 /* the first value of an image, in its order, or a point of an integral or
                                              of a derivative; and the operation that made it of finite numbers */
    double singular; /* error that is stated because a few samples, or crossings, beside which f is a small power of the
                        distance hold much of a derivative, in parts of the largest; 0: none do */
    int out_of_range;         /* in single precision squares of lengths, in much of the domain, vanish (-1) or are
                                 infinite (1), and a root or a [Disc] asks about them: answers are wrong by more than is stated;
                                 0: they do not. Of the last call */
    SltPlace out_of_range_at; /* that root, or the [Disc] */
    uint64_t unmet;           /* triangles of meshes that nothing meets, as a corner is not finite, or too large for a
                                 float: rays and windows see through them. When the last call began */
    SltPlace unmet_at;        /* the first such mesh */
    uint32_t blind;           /* meshes with a window (Beam) whose numbers were not finite, or beyond 1e30: nothing was
                                 seen through it. Of the last call */
    SltPlace blind_at;        /* the first such mesh */
} SltStats;
enum { SLT_FEW_ULPS = 32 };
#define SLT_STATS_INIT ((SltStats){.struct_size = sizeof(SltStats)})

/* What SltStats says that the results do not: why they may be wrong, or less than they seem. */
typedef struct SltWarning {
    size_t struct_size;
    int severity;     /* 1 error (a failed assert), 2 warning */
    const char *code; /* "dropped", ...: docs/command.md lists them, `saltus explain dropped` explains */
    SltPlace at;      /* where most of it happened, as far as that is known */
    char text[1024];  /* a sentence or two, without a newline */
} SltWarning;
#define SLT_WARNING_INIT ((SltWarning){.struct_size = sizeof(SltWarning)})

/* Results of slt_grad_integral. The arrays are the caller's, nfloats = slt_float_count; NULL: not wanted. */
typedef struct SltIntegral {
    size_t struct_size;
    double *value, *value_stderr;       /* [channels] */
    double *gradient, *gradient_stderr; /* [channels][nfloats] */
    double *interior, *boundary;        /* [channels][nfloats]: the two parts of the gradient */
    double *missed_estimate; /* [channels][nfloats]: what lines are thought to have missed; not in the gradient,
                                but in its error */
    bool replicates;         /* true: standard errors from replicates; false: upper bounds */
    /* Estimators with cells, where SltStats.cells is set: the standard errors are those of quadrature, of every part
     * and of what was left over too. */
    bool mixed;         /* some came from lines in what was left over */
    double *left_bound; /* [channels][nfloats]: what the rest can hide of the gradient, at most; NaN: not bounded */
} SltIntegral;
#define SLT_INTEGRAL_INIT ((SltIntegral){.struct_size = sizeof(SltIntegral)})

/* A crossing on the segment from a to b. Where none was found only `found` and `drop` say something. */
typedef struct SltCrossing {
    size_t struct_size;
    bool found;
    double x[3], t;                 /* x = a + t (b - a) */
    double g, dg[3];                /* the boundary function there, nearly 0, and its gradient in x */
    double f_before[4], f_after[4]; /* by channel: f on a's side and on b's side */
    int32_t site, k[8];             /* the site, and the loop indices of its event, outermost first */
    int drop;                       /* SltDrop: why it would not be integrated; -1: it would */
} SltCrossing;
#define SLT_CROSSING_INIT ((SltCrossing){.struct_size = sizeof(SltCrossing)})

/* An event that may decide either way somewhere on a box: one of the list in SltBound, without a size of its own, so it
 * will never change. The strings are the program's. */
typedef struct SltOpenEvent {
    int32_t edge;                   /* the site; numbers from slt_site_count on are seams */
    uint32_t loops;                 /* how many of k */
    int32_t k[8];                   /* indices of the loops around it, outermost first */
    const char *kind, *file, *text; /* "compare", "floor", ...; file "" where there is no place; "d < r" */
    uint32_t line, column;          /* from 1; 0 where there is no place */
    double g[2];                    /* least and greatest value of its boundary function; infinite: not known */
    double dg[3][2];                /* ... and of its derivatives along the axes */
    double boundary[2]; /* of a rounding: the least and the greatest boundary of its integer; g is that of the least */
    bool seam;          /* no [Disc]: f may jump or bend there, and moving it contributes nothing */
    bool jumps, bends;  /* g itself may jump on the box; its derivatives may */
} SltOpenEvent;

/* What slt_bound knows of a box. settled: every decision goes one way at all of its points, and f is smooth there. */
enum { SLT_BOUND_OPEN = 8 };
typedef struct SltBound {
    size_t struct_size;
    bool settled;
    bool unknown;    /* something decides that is no event, or has no bound: rand(), a ray, an endless march */
    bool rough;      /* f may be not smooth where nothing decides: a root of 0, a pole */
    uint32_t count;  /* events that may decide either way */
    uint32_t listed; /* the first so many of them are in `open` */
    SltOpenEvent open[SLT_BOUND_OPEN];
    double lo[4], hi[4]; /* by channel: f lies between them at every point; infinite: not known */
} SltBound;
#define SLT_BOUND_INIT ((SltBound){.struct_size = sizeof(SltBound)})

#ifdef __cplusplus
}
#endif
#endif
