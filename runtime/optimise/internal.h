/* The optimiser's state, shared by the files of this folder only.
 *
 * What a checkpoint must carry is in two places and nowhere else: `Numbers`, and the first
 * `persistent` doubles of `block`. Everything after them is scratch that one call to optimise_step
 * fills and forgets, so that save and load cannot miss a field. */
#ifndef SALTUS_RUNTIME_OPTIMISE_INTERNAL_H
#define SALTUS_RUNTIME_OPTIMISE_INTERNAL_H

#include "optimise.h"

#include <stdbool.h>

typedef struct Numbers {
    double best_loss, base_loss, reference_loss;
    double step_scale; /* of `step`: halved by rejections and backtracking */
    double slope;      /* L-BFGS: gradient at base times (u - base) */
    int64_t state, started;
    int64_t iterations, evaluations, rejected, failures, stalled, backtracks;
    int64_t age;           /* Adam: gradients in the moments */
    int64_t pairs, newest; /* L-BFGS: how many, and the slot of the last */
    char reason[192];
} Numbers;

struct Optimiser {
    OptimiseConfig config; /* its arrays are owned copies; start is NULL */
    Numbers now;
    size_t persistent; /* doubles of block in a checkpoint */
    double *block;
    /* persistent; all of n, in internal units (logarithms where asked) unless said */
    double *u;               /* the point to evaluate */
    double *params;          /* the same in the caller's units */
    double *best;            /* caller's units */
    double *base, *g;        /* last accepted point and its gradient */
    double *step;            /* from base, before scaling and projection */
    double *moment, *square; /* Adam: both; SGD: moment is the velocity */
    double *s, *y;           /* L-BFGS: history x n */
    /* scratch */
    double *fresh, *work, *grid_scratch, *alpha;
    uint8_t *is_free;
    /* fixed */
    double *lo, *hi;
    Laplacian **solvers; /* one per grid, NULL where lambda is 0; equal grids share one */
};

/* Moves to project(base + step_scale * step); false when that is base itself. */
bool optimise_move_to_trial(Optimiser *o);
/* The largest component of the gradient that the bounds do not block. */
double optimise_projected_gradient(const Optimiser *o, const double *g);
/* v := (I + lambda L)^-1 v on grid k, `times` times. */
void optimise_smooth_grid(Optimiser *o, int k, double *v, int times);
OptimiseState optimise_finish(Optimiser *o, OptimiseState state, const char *fmt, ...)
    __attribute__((format(printf, 3, 4)));
/* Tests the loss's stall and the gradient's size at an accepted point; true when it stopped. */
bool optimise_has_converged(Optimiser *o);

/* lbfgs.c: takes a finite loss, with its gradient in o->fresh */
OptimiseState lbfgs_step(Optimiser *o, double loss);
/* Moves to the trial of the present step_scale and notes the decrease that the linear model
 * promises for it as projected. False when it promises none. */
bool lbfgs_place_trial(Optimiser *o);

#endif
