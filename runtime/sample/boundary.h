/* The boundary term: segments of one estimator into the run's sinks. */
#ifndef SALTUS_SAMPLE_BOUNDARY_H
#define SALTUS_SAMPLE_BOUNDARY_H

#include "runtime/sample/run.h"

typedef struct Boundary {
    Run *run;
    uint32_t replicate, replicates; /* of how many; their shifts are strata of one another */
    double segments;                /* a pixel, or in all */
    double *const *targets;         /* SINK_INTEGRAL: [channels], then [channels] of missed; SINK_REVERSE: [classes] */
    float *const *out;              /* SINK_FORWARD */
    float *crossings;
    const float *adjoint;
    const Directions *dirs;
    uint32_t classes;
} Boundary;
/* The boundary term by the job's estimator; nothing where the program has none. */
SltStatus boundary_run(Boundary *y, SinkKind kind);
/* Each estimator: crossings on its segments go to the workers' sinks, which are of that kind. */
typedef SltStatus BoundaryRun(Boundary *y, SinkKind kind);
#define SLT_ESTIMATOR(id, name, run, ...) BoundaryRun run;
#include "saltus/estimators.def"
/* Sets up a worker's sink for this boundary before its first tile. */
void boundary_bind(Boundary *y, Worker *w, SinkKind kind);
void boundary_merge(Boundary *y, Worker *w);

/* Shift of replicate r of n along dimension d: one random number for all, and a stratum each, in another order for each
 * dimension. So the mean over replicates is as good as lines n times denser, and their spread is an upper estimate of
 * its error. */
double stratified_shift(double u, uint32_t r, uint32_t n, uint32_t d);

#endif
