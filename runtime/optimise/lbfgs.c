/* L-BFGS with bounds, turned inside out: each call takes one evaluation and returns the next point.
 *
 * Bounds by projection and an active set by sign (Bertsekas 1982): a variable at its bound whose
 * gradient pushes outwards is held, the two-loop recursion runs over the others, and the line
 * search follows the projected path base -> P(base + t d). Backtracking with Armijo's condition and
 * quadratic interpolation; pairs without positive curvature are not kept. A direction that does not
 * descend, or a search that finds nothing, drops the history once and tries the preconditioned
 * gradient. */
#include "internal.h"

#include <math.h>
#include <string.h>

static const double ARMIJO = 1e-4;
enum { MAX_BACKTRACKS = 40 };

static double dot_free(const Optimiser *o, const double *a, const double *b) {
    double sum = 0;
    for (size_t i = 0; i < o->config.n; i++) sum += o->is_free[i] ? a[i] * b[i] : 0;
    return sum;
}

static void find_free(Optimiser *o) {
    for (size_t i = 0; i < o->config.n; i++) {
        bool blocked = (o->base[i] <= o->lo[i] && o->g[i] > 0) || (o->base[i] >= o->hi[i] && o->g[i] < 0);
        o->is_free[i] = !blocked && o->config.learning_rate[i] > 0;
    }
}

/* v := P v on the free variables, P = sqrt(rate) (I + lambda L)^-2 sqrt(rate): symmetric and
 * positive, so a valid start of the recursion. */
static void precondition(Optimiser *o, double *v) {
    for (size_t i = 0; i < o->config.n; i++) v[i] = o->is_free[i] ? v[i] * sqrt(o->config.learning_rate[i]) : 0;
    for (int k = 0; k < o->config.grid_count; k++) optimise_smooth_grid(o, k, v, 2);
    for (size_t i = 0; i < o->config.n; i++) v[i] = o->is_free[i] ? v[i] * sqrt(o->config.learning_rate[i]) : 0;
}

/* step := -P g, so long that the variable that moves furthest moves by its rate. */
static void gradient_direction(Optimiser *o) {
    double furthest = 0;
    memcpy(o->step, o->g, o->config.n * sizeof *o->step);
    precondition(o, o->step);
    for (size_t i = 0; i < o->config.n; i++)
        if (o->is_free[i]) furthest = fmax(furthest, fabs(o->step[i]) / o->config.learning_rate[i]);
    for (size_t i = 0; i < o->config.n; i++) o->step[i] = furthest > 0 ? -o->step[i] / furthest : 0;
}

static void two_loop(Optimiser *o) {
    size_t n = o->config.n;
    int history = o->config.history, kept = (int)o->now.pairs;
    double gamma = 0, *q = o->step;
    for (size_t i = 0; i < n; i++) q[i] = o->is_free[i] ? o->g[i] : 0;
    for (int k = 0; k < kept; k++) { /* newest first */
        size_t at = (size_t)(((int)o->now.newest - k + history) % history);
        const double *s = o->s + at * n, *y = o->y + at * n;
        double curvature = dot_free(o, s, y);
        o->alpha[at] = 0;
        if (curvature > 0) {
            o->alpha[at] = dot_free(o, s, q) / curvature;
            for (size_t i = 0; i < n; i++) q[i] -= o->is_free[i] ? o->alpha[at] * y[i] : 0;
            if (gamma == 0) {
                memcpy(o->work, y, n * sizeof *y);
                precondition(o, o->work);
                double size = dot_free(o, y, o->work);
                gamma = size > 0 ? curvature / size : 0;
            }
        }
    }
    precondition(o, q);
    for (size_t i = 0; i < n; i++) q[i] *= gamma;
    for (int k = kept - 1; k >= 0; k--) {
        size_t at = (size_t)(((int)o->now.newest - k + history) % history);
        const double *s = o->s + at * n, *y = o->y + at * n;
        double curvature = dot_free(o, s, y);
        if (curvature > 0) {
            double beta = dot_free(o, y, q) / curvature;
            for (size_t i = 0; i < n; i++) q[i] += o->is_free[i] ? (o->alpha[at] - beta) * s[i] : 0;
        }
    }
    for (size_t i = 0; i < n; i++) q[i] = -q[i];
}

/* Moves to the trial of the present step_scale, and notes the decrease that the linear model promises for the projected
 * trial. False when the model promises none. */
static bool place_trial(Optimiser *o) {
    bool moved = optimise_move_to_trial(o);
    double slope = 0;
    for (size_t i = 0; i < o->config.n; i++) slope += o->g[i] * (o->u[i] - o->base[i]);
    o->now.slope = slope;
    return moved && slope < 0;
}

static OptimiseState start_search(Optimiser *o) {
    find_free(o);
    o->now.backtracks = 0;
    o->now.step_scale = 1;
    if (o->now.pairs > 0) {
        two_loop(o);
        if (place_trial(o)) return OPTIMISE_EVALUATE;
        o->now.pairs = 0;
    }
    gradient_direction(o);
    if (!place_trial(o))
        return optimise_finish(o, OPTIMISE_CONVERGED, "no step along the gradient changes the parameters");
    return OPTIMISE_EVALUATE;
}

static OptimiseState backtrack(Optimiser *o, double loss) {
    double t = o->now.step_scale, excess = loss - o->now.base_loss - o->now.slope;
    double factor = excess > 0 ? -0.5 * o->now.slope / excess : 0.5; /* the parabola's minimum */
    o->now.step_scale = t * fmin(fmax(factor, 0.1), 0.5);
    if (++o->now.backtracks <= MAX_BACKTRACKS && place_trial(o)) return OPTIMISE_EVALUATE;
    if (o->now.pairs > 0) { /* a stale history may be the cause */
        o->now.pairs = 0;
        return start_search(o);
    }
    /* leave the caller at the best point of the search, not at a failed trial */
    o->now.step_scale = 0;
    optimise_move_to_trial(o);
    return optimise_finish(o, OPTIMISE_CONVERGED, "no step along the gradient lowers the loss any more");
}

static void keep_pair(Optimiser *o) {
    size_t n = o->config.n;
    int next = o->now.pairs == 0 ? 0 : (int)((o->now.newest + 1) % o->config.history);
    double *s = o->s + (size_t)next * n, *y = o->y + (size_t)next * n, sy = 0, ss = 0, yy = 0;
    for (size_t i = 0; i < n; i++) { /* measured first: the slot may hold the oldest pair, which a
                                        bad one must not replace */
        double ds = o->u[i] - o->base[i], dy = o->fresh[i] - o->g[i];
        sy += ds * dy;
        ss += ds * ds;
        yy += dy * dy;
    }
    if (!(sy > 1e-10 * sqrt(ss) * sqrt(yy))) return;
    for (size_t i = 0; i < n; i++) {
        s[i] = o->u[i] - o->base[i];
        y[i] = o->fresh[i] - o->g[i];
    }
    o->now.newest = next;
    o->now.pairs += o->now.pairs < o->config.history;
}

OptimiseState lbfgs_accept(Optimiser *o, double loss) {
    size_t n = o->config.n;
    if (o->now.started) {
        if (loss > o->now.base_loss + ARMIJO * o->now.slope) return backtrack(o, loss);
        keep_pair(o);
        o->now.iterations++;
    }
    memcpy(o->base, o->u, n * sizeof *o->base);
    memcpy(o->g, o->fresh, n * sizeof *o->g);
    o->now.base_loss = loss;
    return optimise_has_converged(o) ? (OptimiseState)o->now.state : start_search(o);
}

void lbfgs_retreat(Optimiser *o) {
    o->now.step_scale *= 0.25;
    place_trial(o);
}
