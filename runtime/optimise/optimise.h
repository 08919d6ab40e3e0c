/* Optimisers over a flat vector of n parameters: the rows of optimisers.def.
 *
 * The caller owns the loop and evaluates; the optimiser only says where:
 *
 *     Optimiser *o = optimise_create(&config, &err);
 *     while (running) {
 *         const double *p = optimise_parameters(o);           // evaluate here ...
 *         loss = f(p, gradient);                              // ... dloss/dp, in the same units
 *         if (optimise_step(o, loss, gradient) != OPTIMISE_EVALUATE) break;
 *     }
 *     best = optimise_best(o, &loss);
 *     optimise_free(o);
 *
 * Inside, a parameter marked `log` is optimised as its logarithm; bounds are kept exactly by
 * projection. A loss or a gradient that is not finite never enters the state: the step is taken
 * back, shortened and counted; after `max_failures` in a row the optimiser stops and says so. The
 * best point so far is kept: the one of the lowest loss; where losses are noisy, the last of those
 * that the noise does not tell from it.
 *
 * Everything is deterministic: the same calls give the same bits, also across save and load. An
 * Optimiser owns all its memory (copies of the config's arrays too); one thread at a time. */
#ifndef SALTUS_RUNTIME_OPTIMISE_H
#define SALTUS_RUNTIME_OPTIMISE_H

#include "../base/status.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* OPTIMISE_ADAM, ...: the rows of optimisers.def. */
typedef enum OptimiseMethod {
#define OPTIMISER(id, ...) OPTIMISE_##id,
#include "optimisers.def"
#undef OPTIMISER
    OPTIMISE_METHODS
} OptimiseMethod;

typedef enum OptimiseState {
    OPTIMISE_EVALUATE,  /* evaluate optimise_parameters and call optimise_step again */
    OPTIMISE_CONVERGED, /* see optimise_reason */
    OPTIMISE_FAILED     /* the loss stayed non-finite; see optimise_reason */
} OptimiseState;

/* A grid among the parameters: element (x, y, c) is parameter offset + x * stride_x + y * stride_y
 * + c * stride_c. Its gradient is preconditioned with (I + lambda L)^-2, L the graph Laplacian of 4
 * neighbours (Nicolet, Jacobson, Jakob 2021, "Large Steps in Inverse Rendering of Geometry"). Grids
 * must not overlap. */
typedef struct OptimiseGrid {
    size_t offset;
    int width, height, channels;
    size_t stride_x, stride_y, stride_c;
    double lambda; /* > 0; some tens make a smooth field of it, 0 means no preconditioning */
    /* Other neighbours: pairs of cells, numbered x + y * width. NULL: the four of the grid. Read by optimise_create. */
    const uint32_t *edges; /* [2 * nedges] */
    size_t nedges;
} OptimiseGrid;

/* Initialise with zeros: a 0 means the default named after the colon. Arrays are copied; each has n
 * entries or is NULL. `start` is required. */
typedef struct OptimiseConfig {
    size_t n;
    OptimiseMethod method;
    const double *start;         /* finite; moved into the bounds if outside */
    const double *learning_rate; /* > 0, or 0 to hold the parameter fixed; NULL: default_rate for
                                    all. For L-BFGS: how far the first step may move each parameter,
                                    and the relative scale of the variables */
    double default_rate;         /* > 0: that of the optimiser's row */
    const double *lo, *hi;       /* lo <= hi; infinite or NULL for none */
    const uint8_t *log;          /* 1: optimise the logarithm; start must be > 0; the rate is in log units */
    const OptimiseGrid *grids;
    int grid_count;
    double beta1, beta2, epsilon; /* Adam: 0.9, 0.999, 1e-8 */
    double momentum;              /* SGD, 0 <= m < 1: none */
    int history;                  /* L-BFGS, pairs kept: 10 */
    double gradient_tolerance;    /* converged when no component of the projected gradient is larger: exactly zero */
    double loss_tolerance;        /* converged when the best loss fell by less than this part of itself ... */
    int patience;                 /* ... in so many iterations: both from the optimiser's row, mostly off */
    int zeros; /* first-order methods: converged when so many gradients from the start on are zero: 1. More where each
                  is of other samples, and may be zero by chance */
    int max_failures; /* non-finite evaluations in a row before the optimiser fails: 10 */
} OptimiseConfig;

typedef struct Optimiser Optimiser;

/* optimise.c ---------------------------------------------------------------------------------- */

/* The method whose row has this name ("adam"); false where there is none. */
bool optimise_find(const char *name, OptimiseMethod *method);
const char *optimise_name(OptimiseMethod method);
double optimise_rate(OptimiseMethod method); /* the default learning rate */
/* Does the method compare the losses of different evaluations, so that all must be of the same samples? */
bool optimise_wants_same_loss(OptimiseMethod method);

/* NULL with err set: SLT_USAGE for a bad config (the text names the parameter's index), SLT_LIMIT
 * for memory or a grid beyond 2^22 cells. */
Optimiser *optimise_create(const OptimiseConfig *config, SltError *err);
void optimise_free(Optimiser *o);

/* The n parameters to evaluate next; valid until the next call that changes `o`. */
const double *optimise_parameters(const Optimiser *o);

/* Takes the loss and its gradient (n entries) at optimise_parameters and chooses the next ones.
 * After anything but OPTIMISE_EVALUATE further calls change nothing and return the same. */
OptimiseState optimise_step(Optimiser *o, double loss, const double *gradient);

/* Of a first-order method: a factor of all learning rates from the next step on; 1 at first. Not part of a checkpoint:
 * the caller says it before every step. */
void optimise_set_rate(Optimiser *o, double factor);

/* The best parameters evaluated so far and, if `loss` is not NULL, their loss (infinity before the
 * first finite one). */
const double *optimise_best(const Optimiser *o, double *loss);

long optimise_evaluations(const Optimiser *o); /* all */
long optimise_rejected(const Optimiser *o);    /* those that were not finite */

/* Why the optimiser stopped, in words; "" while it runs. */
const char *optimise_reason(const Optimiser *o);

/* checkpoint.c -------------------------------------------------------------------------------- */

/* Writes the whole state and the caller's blob (may be NULL with size 0) atomically. `key`
 * describes what is optimised (program hash, target): a checkpoint is only loaded under the same
 * key. */
SltStatus optimise_save(const Optimiser *o, const char *path, const char *key, const void *blob, size_t blob_size,
                        SltError *err);

/* Restores a state into an optimiser created from the same config. *blob is malloc'd (NULL when
 * empty), with a NUL after it; `blob` may be NULL. SLT_INPUT for a damaged file, another key, or
 * another config; then `o` is unchanged. */
SltStatus optimise_load(Optimiser *o, const char *path, const char *key, void **blob, size_t *blob_size, SltError *err);

/* graph.c ------------------------------------------------------------------------------------- */

/* I + lambda L of a graph, ready to be solved; for one thread at a time. */
typedef struct Graph Graph;

/* edges: nedges pairs of cells; a pair that comes again, and one of a cell with itself, count for nothing. 1 <= cells
 * <= 2^24, lambda >= 0 and finite. NULL with err set. */
Graph *graph_create(uint32_t cells, const uint32_t *edges, size_t nedges, double lambda, SltError *err);
void graph_free(Graph *g);
/* Solves (I + lambda L) x = b in place to nine digits, cell i at data[i * stride]. Constants stay constant, and sums
 * are kept. */
void graph_solve(Graph *g, double *data, size_t stride);
uint64_t graph_hash(const Graph *g, uint64_t h); /* of its edges, mixed into h */

/* laplacian.c --------------------------------------------------------------------------------- */

/* I + lambda L of a width x height grid, L the Laplacian of its four-neighbourhood, ready to be solved; for one thread
 * at a time. */
typedef struct Laplacian Laplacian;

/* 1 <= width * height <= 2^22, lambda >= 0 and finite. NULL with err set. */
Laplacian *laplacian_create(int width, int height, double lambda, SltError *err);
void laplacian_free(Laplacian *l);

/* Solves (I + lambda L) x = b in place, element (x, y) at data[x * stride_x + y * stride_y].
 * `scratch` has width * height entries. Constants stay constant, and sums are kept. */
void laplacian_solve(Laplacian *l, double *data, size_t stride_x, size_t stride_y, double *scratch);

#ifdef __cplusplus
}
#endif
#endif
