/* The optimiser's state, shared by the files of this folder only.
 *
 * What a checkpoint must carry is in two places and nowhere else: `Numbers`, and the first
 * `persistent` doubles of `block`. Everything after them is scratch that one call to optimise_step
 * fills and forgets, so that save and load cannot miss a field. */
#ifndef SALTUS_RUNTIME_OPTIMISE_INTERNAL_H
#define SALTUS_RUNTIME_OPTIMISE_INTERNAL_H

#include "optimise.h"

#include <stdbool.h>

enum { OPTIMISE_RECENT = 16 };

typedef struct Numbers {
    double best_loss, base_loss;               /* of `best`, of `base` */
    double lowest_loss;                        /* of all, which noise may have made lower than that of `best` */
    double recent[OPTIMISE_RECENT];            /* first-order methods: a ring of the last losses */
    int64_t losses;                            /* that were put there */
    double reference_loss;                     /* the best loss that the fall of the loss is measured from */
    double step_scale;                         /* of `step`: halved by rejections and backtracking */
    double slope;                              /* L-BFGS: gradient at base times (u - base) */
    int64_t state, started;                    /* OptimiseState; whether there is a base */
    int64_t iterations, evaluations, rejected; /* in all */
    int64_t failures, stalled, backtracks;     /* in a row */
    int64_t age;                               /* Adam: gradients in the moments */
    int64_t pairs, newest;                     /* L-BFGS: how many, and the slot of the last */
    char reason[192];
} Numbers;

/* What tells one optimiser from another: a row of optimisers.def. */
typedef struct Method {
    const char *name;
    /* Takes a finite loss, with its gradient in `fresh`, and moves to the next trial or finishes. */
    OptimiseState (*accept)(Optimiser *o, double loss);
    void (*retreat)(Optimiser *o);   /* moves to a shorter trial: the last was not finite */
    void (*direction)(Optimiser *o); /* first-order methods: `step` from the gradient `g` and the vectors; else NULL */
    size_t vectors;                  /* of n doubles each; zero at the start, and part of checkpoints */
    bool pairs;                      /* keeps `history` pairs of steps and gradient differences */
    bool same_loss;                  /* compares losses: all evaluations must be of the same samples */
    double rate;                     /* the default of OptimiseConfig.default_rate */
    int patience;                    /* the default of OptimiseConfig.patience; 0: off */
    double loss_tolerance;           /* the default of OptimiseConfig.loss_tolerance */
} Method;
extern const Method optimise_methods[OPTIMISE_METHODS];

struct Optimiser {
    OptimiseConfig config; /* its arrays are owned copies; start is NULL */
    const Method *method;
    Numbers now;
    size_t persistent; /* doubles of block in a checkpoint */
    double *block;
    /* Persistent: parts of block, of n doubles each, in internal units (logarithms where asked) unless said. */
    double *u;        /* the point to evaluate */
    double *params;   /* the same in the caller's units */
    double *best;     /* the best point, in the caller's units */
    double *base, *g; /* last accepted point and its gradient */
    double *step;     /* from base, before scaling and projection */
    double *vectors;  /* those of the method, one after the other; a first-order method's first is its momentum */
    double *s, *y;    /* of a method with pairs: [history][n] steps, and differences of gradients */
    /* Scratch of one call. fresh: the gradient of this evaluation. */
    double *fresh, *work, *grid_scratch, *alpha;
    uint8_t *is_free;   /* L-BFGS, [n]: not held at a bound */
    double rate_factor; /* optimise_set_rate */
    /* Fixed. */
    double *lo, *hi;
    Laplacian **solvers; /* one per grid, NULL where lambda is 0; equal grids share one */
    Graph **graphs;      /* the same of grids with edges of their own */
};

/* Moves to project(base + step_scale * step); false when that is base itself. */
bool optimise_move_to_trial(Optimiser *o);
/* The largest magnitude of a component of the gradient g that the bounds do not block. */
double optimise_projected_gradient(const Optimiser *o, const double *g);
/* v := (I + lambda L)^-1 v on grid k, `times` times. */
void optimise_smooth_grid(Optimiser *o, int k, double *v, int times);
/* Is grid k preconditioned at all? */
static inline bool optimise_is_smooth(const Optimiser *o, int k) { return o->solvers[k] || o->graphs[k]; }
OptimiseState optimise_finish(Optimiser *o, OptimiseState state, const char *fmt, ...)
    __attribute__((format(printf, 3, 4)));
/* At an accepted point: has the loss stalled, or is the gradient small enough? True when the optimiser has stopped. */
bool optimise_has_converged(Optimiser *o);

static inline double optimise_clamp(double v, double lo, double hi) { return v < lo ? lo : v > hi ? hi : v; }

static inline size_t optimise_grid_index(const OptimiseGrid *g, int x, int y, int c) {
    return g->offset + (size_t)x * g->stride_x + (size_t)y * g->stride_y + (size_t)c * g->stride_c;
}

/* first_order.c */
OptimiseState first_order_accept(Optimiser *o, double loss);
void first_order_retreat(Optimiser *o);

/* What the rows name: members `direction`, `accept` and `retreat` of Method. */
#define OPTIMISER(id, name, functions, ...) functions
#define FIRST_ORDER(direction, vectors) void direction(Optimiser *o);
#define LINE_SEARCH(accept, retreat)                                                                                   \
    OptimiseState accept(Optimiser *o, double loss);                                                                   \
    void retreat(Optimiser *o);
#include "optimisers.def"
#undef OPTIMISER
#undef FIRST_ORDER
#undef LINE_SEARCH

#endif
