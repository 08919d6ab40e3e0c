/* The boundary term: crossings on the segments of one estimator go to the sinks of the run's workers. */
#ifndef SALTUS_SAMPLE_BOUNDARY_H
#define SALTUS_SAMPLE_BOUNDARY_H

#include "runtime/sample/parts.h"
#include "runtime/sample/run.h"

/* Lines in boxes of their own, instead of those of the estimator. */
typedef struct Window {
    double lo[3], hi[3];
} Window;
typedef struct Windows {
    uint32_t n, lines, vertices; /* boxes; of each lines a side, and vertices of a line */
    double side[3];              /* spread over the domain by chance, of these sides; or */
    const Window *at;            /* [n]: there */
} Windows;

typedef struct Boundary {
    Run *run;
    uint32_t replicate, replicates; /* its number, and how many there are; their shifts are strata of one another */
    double segments;                /* a pixel, or of an integral in all */
    double *const *targets; /* sums [nfloats]. SINK_INTEGRAL: by channel, by channel the part that coarser lines miss,
                               by channel what boundaries that coincide leave open, then the sketches, by channel each;
                               SINK_REVERSE: by class, then as `misses` says, then the noise */
    float *const *out;      /* SINK_FORWARD: images, by direction */
    float *crossings;       /* SINK_FORWARD: crossings a pixel; may be NULL */
    const float *adjoint;   /* SINK_REVERSE: an image */
    const Directions *dirs; /* SINK_FORWARD */
    uint32_t classes;       /* SINK_REVERSE: 1, or COSETS */
    const float *noise[2];  /* SINK_REVERSE: see Sink; NULL: none */
    float least;            /* likewise */
    Parts *parts;           /* SINK_REVERSE: what tiles err by; may be NULL */
    PartsOf parts_of;
    bool misses;            /* SINK_REVERSE: after those a target for what is missed (thin.h) */
    const Windows *windows; /* NULL: the whole domain */
    bool any_sign;          /* each crossing counts with a random sign */
    uint64_t boxes;         /* lines of `windows` are cut by bounds, for so many boxes; 0: they are not */
    bool only_hidden;       /* of lines of `windows` nothing counts but what lies between ends that look alike */
} Boundary;
/* The boundary term by the job's estimator; nothing where the program has none. */
SltStatus boundary_run(Boundary *y, SinkKind kind);
/* Those of the n replicates of an integral, in their order: small ones are tiles of one run. */
SltStatus boundary_run_all(Boundary *y, uint32_t n, SinkKind kind);
/* An estimator's `run` in estimators.def: makes the segments, and workers whose sinks are of that kind. */
typedef SltStatus BoundaryRun(Boundary *y, SinkKind kind);
#define SLT_ESTIMATOR(id, name, run, ...) BoundaryRun run;
#include "saltus/estimators.def"
/* lattice.c: how many tiles it cuts the domain into; there may be workers for so many. */
uint64_t lattice_tiles(const Boundary *y);
/* Has the lattice of an integral one tile? Then those of n replicates are run at once. */
bool lattice_is_small(const Boundary *y);
SltStatus lattice_run_small(Boundary *y, uint32_t n, SinkKind kind);
/* Are the lines of all replicates together evenly spaced, so that replicates do not err independently? Then sketches
 * (sketch.h) tell how the lines of an integral err. */
bool boundary_in_order(const Run *r);
/* Sets up a worker's sink for this boundary before its first tile. */
void boundary_bind(Boundary *y, Worker *w, SinkKind kind);
void boundary_merge(Boundary *y, Worker *w);

double boundary_segments(const SltJob *j); /* as in Boundary.segments, of all replicates */

/* scanline.c: the boundary term on y->windows. */
SltStatus scanline_windows(Boundary *y);

/* finer.c: the boundary term on y->windows into sum[3][channels][nfloats], as SINK_INTEGRAL has it; returns nothing but
 * evaluations in the run's counts. *crossings: that were integrated. */
SltStatus windows_run(Run *r, Boundary *y, double *sum, double *crossings);

/* unmet.c: adds what small things weigh that no line has met (of sites that are 0 in r->met), and that bounds lead to,
 * to the estimate of what is missed and to the error, [channels][nfloats]. */
SltStatus unmet_add(Run *r, const Boundary *of, double *missed, double *error);

/* between.c: where a few lines, cut by bounds, meet more than they met before, that is missed by all: it takes the
 * place of what is known to be missed, and is added to the error, [channels][nfloats]. To find it nothing need be known
 * of what other lines have met. The caller frees `sum`, whatever happened. */
typedef struct Between {
    double found[2];        /* crossings, by probes, by bounds */
    double lines, vertices; /* a side; of a line */
    bool probes;            /* there are any */
    double *sum;            /* [probes ? 2 : 1][3][channels][nfloats], likewise; NULL: nothing was looked for */
} Between;
bool between_serves(const SltScene *s, const Boundary *of);
SltStatus between_find(Run *r, const Boundary *of, uint32_t replicates, Between *b);
void between_add(const SltScene *s, const Between *b, double *missed, double *error);

/* finer.c: about how many crossings lines that are eight times finer meet and those of an integral's replicates do not;
 * 0 where they meet about the same. */
SltStatus finer_missed(Run *r, const Boundary *of, uint32_t replicates, double *missed);

/* Crossings of which no more is known than how many there are beside those that were found. */
typedef struct Missed {
    double number;
    double *told;           /* [channels][nfloats]: what is missed, as far as it was told and is in the error already;
                               where this is more, it takes its place */
    const double *gradient; /* for the sign */
} Missed;

/* lost.c: adds to the errors of an integral's derivatives, [channels][nfloats], or of a weighted image's, [nfloats],
 * what the crossings weigh that the run has dropped, or missed (may be NULL): as many as were found weigh, in the mean.
 * Infinite where none was found. Of `of` the segments (of one replicate) count, the classes, and the adjoint image,
 * NULL for integrals. */
SltStatus lost_add(Run *r, const Boundary *of, uint32_t replicates, const Missed *missed, double *error);

/* Shift of replicate r of n along dimension d, in [0, 1): the random number u is the same for all replicates, the
 * stratum of width 1/n is each one's own, in another order for each dimension. So the mean over replicates is as good
 * as lines n times denser, and the spread of the replicates is an upper estimate of its error. */
double stratified_shift(double u, uint32_t r, uint32_t n, uint32_t d);

#endif
