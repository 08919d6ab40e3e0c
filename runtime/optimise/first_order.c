/* Adam, SGD, and what first-order optimisers share: each finite evaluation is accepted, and `direction` makes the next
 * step from the last gradients; a step to where the loss is not finite is halved, and half-way through the allowed
 * failures the method's vectors are set to zero. */
#include "internal.h"

#include <math.h>
#include <string.h>

static void smooth_grids(Optimiser *o, double *v, int times) {
    for (int k = 0; k < o->config.grid_count; k++) optimise_smooth_grid(o, k, v, times);
}

/* Under a Laplacian, Adam's scaling by each entry's own second moment would undo the smoothing; the
 * paper's uniform variant divides a whole grid by its largest. `work` gets the denominator of every
 * parameter. */
static void adam_denominators(Optimiser *o, const double *square, double correction) {
    for (size_t i = 0; i < o->config.n; i++) o->work[i] = sqrt(square[i] / correction) + o->config.epsilon;
    for (int k = 0; k < o->config.grid_count; k++) {
        const OptimiseGrid *g = &o->config.grids[k];
        double largest = 0;
        for (int pass = 0; optimise_is_smooth(o, k) && pass < 2; pass++) {
            for (int c = 0; c < g->channels; c++) {
                for (int y = 0; y < g->height; y++) {
                    for (int x = 0; x < g->width; x++) {
                        size_t i = optimise_grid_index(g, x, y, c);
                        if (pass == 0) largest = fmax(largest, o->work[i]);
                        else o->work[i] = largest;
                    }
                }
            }
        }
    }
}

/* Sampled gradients have heavy tails: where a silhouette ends, one crossing may weigh ten times what others do. Under
 * one second moment for the grid such an entry would move its own parameter by as many steps, and hold back all others
 * for as long as Adam remembers: so an entry is cut to three times the largest so far. */
static void limit_outliers(Optimiser *o, const double *square, double correction) {
    for (int k = 0; k < o->config.grid_count; k++) {
        const OptimiseGrid *g = &o->config.grids[k];
        double largest = 0;
        for (int pass = 0; optimise_is_smooth(o, k) && pass < 2; pass++) {
            double limit = 3 * sqrt(largest / correction);
            for (int c = 0; c < g->channels; c++) {
                for (int y = 0; y < g->height; y++) {
                    for (int x = 0; x < g->width; x++) {
                        size_t i = optimise_grid_index(g, x, y, c);
                        if (pass == 0) largest = fmax(largest, square[i]);
                        else if (limit > 0) o->step[i] = optimise_clamp(o->step[i], -limit, limit);
                    }
                }
            }
        }
    }
}

void adam_direction(Optimiser *o) {
    const OptimiseConfig *c = &o->config;
    double *moment = o->vectors, *square = o->vectors + c->n;
    double before = 1 - pow(c->beta2, (double)o->now.age);
    double t = (double)++o->now.age;
    double first = 1 - pow(c->beta1, t), second = 1 - pow(c->beta2, t);
    memcpy(o->step, o->g, c->n * sizeof *o->step);
    smooth_grids(o, o->step, 1);
    if (t > 1) limit_outliers(o, square, before);
    for (size_t i = 0; i < c->n; i++) {
        double g = o->step[i];
        moment[i] = c->beta1 * moment[i] + (1 - c->beta1) * g;
        square[i] = c->beta2 * square[i] + (1 - c->beta2) * g * g;
    }
    adam_denominators(o, square, second);
    for (size_t i = 0; i < c->n; i++)
        o->step[i] = -o->rate_factor * o->config.learning_rate[i] * (moment[i] / first) / o->work[i];
    smooth_grids(o, o->step, 1);
}

void sgd_direction(Optimiser *o) {
    const OptimiseConfig *c = &o->config;
    double *velocity = o->vectors;
    memcpy(o->work, o->g, c->n * sizeof *o->work);
    smooth_grids(o, o->work, 2);
    for (size_t i = 0; i < c->n; i++) {
        velocity[i] = c->momentum * velocity[i] + o->work[i];
        o->step[i] = -o->rate_factor * o->config.learning_rate[i] * velocity[i];
    }
}

static bool all_zero(const double *v, size_t n) {
    for (size_t i = 0; i < n; i++)
        if (v[i] != 0) return false;
    return true;
}

OptimiseState first_order_accept(Optimiser *o, double loss) {
    size_t n = o->config.n;
    memcpy(o->base, o->u, n * sizeof *o->base);
    memcpy(o->g, o->fresh, n * sizeof *o->g);
    o->now.base_loss = loss;
    o->now.iterations++;
    if (optimise_has_converged(o)) return (OptimiseState)o->now.state;
    /* A zero by chance in mid-run still coasts on its momentum; as long as there is none, it takes some in a row. */
    if (o->now.iterations >= o->config.zeros && all_zero(o->g, n) && all_zero(o->vectors, n))
        return optimise_finish(o, OPTIMISE_CONVERGED, "the gradient is zero");
    o->method->direction(o);
    o->now.step_scale = 1;
    optimise_move_to_trial(o);
    return OPTIMISE_EVALUATE;
}

void first_order_retreat(Optimiser *o) {
    o->now.step_scale *= 0.5;
    if (o->now.failures ==
        o->config.max_failures / 2) { /* momentum may push into a wall that the gradient here avoids */
        memset(o->vectors, 0, o->method->vectors * o->config.n * sizeof *o->vectors);
        o->now.age = 0;
        o->method->direction(o);
    }
    optimise_move_to_trial(o);
}
