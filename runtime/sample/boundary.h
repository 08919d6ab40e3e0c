/* The boundary term: crossings on the segments of one estimator go to the sinks of the run's workers. */
#ifndef SALTUS_SAMPLE_BOUNDARY_H
#define SALTUS_SAMPLE_BOUNDARY_H

#include "runtime/sample/parts.h"
#include "runtime/sample/run.h"

typedef struct Boundary {
    Run *run;
    uint32_t replicate, replicates; /* its number, and how many there are; their shifts are strata of one another */
    double segments;                /* a pixel, or of an integral in all */
    double *const *targets; /* sums [nfloats]. SINK_INTEGRAL: by channel, by channel the part that coarser lines miss,
                               by channel what boundaries that coincide leave open, then the sketches, by channel each;
                               SINK_REVERSE: by class, then as `misses` says */
    float *const *out;      /* SINK_FORWARD: images, by direction */
    float *crossings;       /* SINK_FORWARD: crossings a pixel; may be NULL */
    const float *adjoint;   /* SINK_REVERSE: an image */
    const Directions *dirs; /* SINK_FORWARD */
    uint32_t classes;       /* SINK_REVERSE: 1, or COSETS */
    Parts *parts;           /* SINK_REVERSE: how the tiles of the classes spread; may be NULL */
    bool misses;            /* SINK_REVERSE: after those a target for what is missed (thin.h) */
    bool any_sign;          /* each crossing counts with a random sign */
} Boundary;
/* The boundary term by the job's estimator; nothing where the program has none. */
SltStatus boundary_run(Boundary *y, SinkKind kind);
/* An estimator's `run` in estimators.def: makes the segments, and workers whose sinks are of that kind. */
typedef SltStatus BoundaryRun(Boundary *y, SinkKind kind);
#define SLT_ESTIMATOR(id, name, run, ...) BoundaryRun run;
#include "saltus/estimators.def"
/* Are the lines of all replicates together evenly spaced, so that replicates do not err independently? Then sketches
 * (sketch.h) tell how the lines of an integral err. */
bool boundary_in_order(const Run *r);
/* Sets up a worker's sink for this boundary before its first tile. */
void boundary_bind(Boundary *y, Worker *w, SinkKind kind);
void boundary_merge(Boundary *y, Worker *w);

/* lost.c: adds to the errors of an integral's derivatives, [channels][nfloats], or of a weighted image's, [nfloats],
 * what the crossings weigh that the run has dropped: as many as were found weigh, in the mean. Infinite where none was
 * found. Of `of` the segments (of one replicate) count, the classes, and the adjoint image, NULL for integrals. */
SltStatus lost_add(Run *r, const Boundary *of, uint32_t replicates, double *error);

/* Shift of replicate r of n along dimension d, in [0, 1): the random number u is the same for all replicates, the
 * stratum of width 1/n is each one's own, in another order for each dimension. So the mean over replicates is as good
 * as lines n times denser, and the spread of the replicates is an upper estimate of its error. */
double stratified_shift(double u, uint32_t r, uint32_t n, uint32_t d);

#endif
