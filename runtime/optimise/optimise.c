/* Setting up, and what all optimisers share: units, bounds, rejection, convergence. */
#include "internal.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

const Method optimise_methods[OPTIMISE_METHODS] = {
#define OPTIMISER(id, shown, functions, ...) [OPTIMISE_##id] = {.name = shown, functions, __VA_ARGS__},
#define FIRST_ORDER(step, n) .accept = first_order_accept, .retreat = first_order_retreat, .direction = step, .vectors = n
#define LINE_SEARCH(take, shorten) .accept = take, .retreat = shorten, .same_loss = true
#include "optimisers.def"
#undef OPTIMISER
#undef FIRST_ORDER
#undef LINE_SEARCH
};

bool optimise_find(const char *name, OptimiseMethod *method) {
    for (int k = 0; k < OPTIMISE_METHODS; k++) {
        if (strcmp(optimise_methods[k].name, name) != 0) continue;
        *method = (OptimiseMethod)k;
        return true;
    }
    return false;
}

const char *optimise_name(OptimiseMethod method) { return optimise_methods[method].name; }
double optimise_rate(OptimiseMethod method) { return optimise_methods[method].rate; }
bool optimise_wants_same_loss(OptimiseMethod method) { return optimise_methods[method].same_loss; }

/* The caller's value of an internal one. Bounds are applied here too: exp(log(x)) may miss x by a
 * rounding. */
static double to_caller(const Optimiser *o, size_t i, double u) {
    double v = o->config.log[i] ? exp(u) : u;
    return optimise_clamp(v, o->config.lo[i], o->config.hi[i]);
}

bool optimise_move_to_trial(Optimiser *o) {
    bool moved = false;
    for (size_t i = 0; i < o->config.n; i++) {
        double u = optimise_clamp(o->base[i] + o->now.step_scale * o->step[i], o->lo[i], o->hi[i]);
        if (o->config.learning_rate[i] == 0) /* held: not even a rounding may change it */
            continue;
        moved |= u != o->base[i];
        o->u[i] = u;
        o->params[i] = to_caller(o, i, u);
    }
    return moved;
}

double optimise_projected_gradient(const Optimiser *o, const double *g) {
    double worst = 0;
    for (size_t i = 0; i < o->config.n; i++) {
        bool blocked = (o->base[i] <= o->lo[i] && g[i] > 0) || (o->base[i] >= o->hi[i] && g[i] < 0);
        worst = blocked ? worst : fmax(worst, fabs(g[i]));
    }
    return worst;
}

OptimiseState optimise_finish(Optimiser *o, OptimiseState state, const char *fmt, ...) {
    va_list args;
    o->now.state = state;
    va_start(args, fmt);
    vsnprintf(o->now.reason, sizeof o->now.reason, fmt, args);
    va_end(args);
    return state;
}

bool optimise_has_converged(Optimiser *o) {
    const OptimiseConfig *c = &o->config;
    double size = optimise_projected_gradient(o, o->g);
    /* At exactly zero a first-order method still coasts on its momentum. */
    if (size <= c->gradient_tolerance && (c->gradient_tolerance > 0 || !o->method->direction)) {
        optimise_finish(o, OPTIMISE_CONVERGED, "no component of the gradient is larger than %.3g", size);
        return true;
    }
    if (c->patience > 0) {
        double fall = o->now.reference_loss - o->now.lowest_loss;
        if (isinf(o->now.reference_loss) || fall > c->loss_tolerance * fabs(o->now.reference_loss)) {
            o->now.reference_loss = o->now.lowest_loss;
            o->now.stalled = 0;
        } else if (++o->now.stalled >= c->patience) {
            optimise_finish(o, OPTIMISE_CONVERGED, "the loss fell by less than %.3g of itself over %d iterations",
                            c->loss_tolerance, c->patience);
            return true;
        }
    }
    return false;
}

void optimise_smooth_grid(Optimiser *o, int k, double *v, int times) {
    const OptimiseGrid *g = &o->config.grids[k];
    for (int c = 0; o->graphs[k] && c < g->channels; c++)
        for (int t = 0; t < times; t++) graph_solve(o->graphs[k], v + optimise_grid_index(g, 0, 0, c), g->stride_x);
    for (int c = 0; o->solvers[k] && c < g->channels; c++)
        for (int t = 0; t < times; t++)
            laplacian_solve(o->solvers[k], v + optimise_grid_index(g, 0, 0, c), g->stride_x, g->stride_y,
                            o->grid_scratch);
}

static OptimiseState reject(Optimiser *o, bool bad_loss) {
    const char *what = bad_loss ? "loss" : "gradient";
    o->now.rejected++;
    o->now.failures++;
    if (!o->now.started) return optimise_finish(o, OPTIMISE_FAILED, "the %s at the start is not finite", what);
    if (o->now.failures > o->config.max_failures) {
        return optimise_finish(o, OPTIMISE_FAILED, "the %s is not finite, also after %d shorter steps", what,
                               o->config.max_failures);
    }
    o->method->retreat(o);
    return OPTIMISE_EVALUATE;
}

static double median(const double *v, int n) {
    double sorted[OPTIMISE_RECENT];
    for (int i = 0; i < n; i++) {
        int k = i;
        for (; k > 0 && sorted[k - 1] > v[i]; k--) sorted[k] = sorted[k - 1];
        sorted[k] = v[i];
    }
    return 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]);
}

/* What the losses of one point differ by, as they come of other samples every time: their second differences, which a
 * smooth descent leaves small (of independent noise sqrt(6) of its deviation; of these the median, so that a few steps
 * that went wrong are no noise). */
static double noise_of_losses(const Numbers *now) {
    double d[OPTIMISE_RECENT];
    int n = (int)(now->losses < OPTIMISE_RECENT ? now->losses : OPTIMISE_RECENT), count = 0;
    for (int64_t t = now->losses - n + 2; t < now->losses; t++)
        d[count++] = fabs(now->recent[t % OPTIMISE_RECENT] - 2 * now->recent[(t - 1) % OPTIMISE_RECENT] +
                          now->recent[(t - 2) % OPTIMISE_RECENT]);
    return count > 4 ? 1.4826 * median(d, count) / sqrt(6) : 0;
}

/* Is this the best point so far? Of many noisy losses the lowest is a lucky draw, maybe of long ago: so what is not
 * told from it, and not worse than half of the last ones, is better for having come later. */
static bool is_best(Optimiser *o, double loss) {
    Numbers *now = &o->now;
    bool lowest = loss < now->lowest_loss;
    if (lowest) now->lowest_loss = loss;
    if (o->method->same_loss) return lowest;
    now->recent[now->losses++ % OPTIMISE_RECENT] = loss;
    int n = (int)(now->losses < OPTIMISE_RECENT ? now->losses : OPTIMISE_RECENT);
    return lowest || (loss <= now->lowest_loss + 3 * noise_of_losses(now) && loss <= median(now->recent, n));
}

OptimiseState optimise_step(Optimiser *o, double loss, const double *gradient) {
    if (o->now.state != OPTIMISE_EVALUATE) return (OptimiseState)o->now.state;
    o->now.evaluations++;
    bool finite = true;
    for (size_t i = 0; i < o->config.n; i++) { /* chain rule of the logarithm; held parameters have no gradient */
        o->fresh[i] = o->config.learning_rate[i] == 0 ? 0 : gradient[i] * (o->config.log[i] ? o->params[i] : 1);
        finite = finite && isfinite(o->fresh[i]);
    }
    if (!isfinite(loss) || !finite) return reject(o, !isfinite(loss));
    o->now.failures = 0;
    if (is_best(o, loss)) {
        o->now.best_loss = loss;
        memcpy(o->best, o->params, o->config.n * sizeof *o->best);
    }
    OptimiseState state = o->method->accept(o, loss);
    o->now.started = 1;
    return state;
}

const double *optimise_parameters(const Optimiser *o) { return o->params; }

const double *optimise_best(const Optimiser *o, double *loss) {
    if (loss) *loss = o->now.best_loss;
    return o->best;
}

void optimise_set_rate(Optimiser *o, double factor) { o->rate_factor = factor; }
long optimise_evaluations(const Optimiser *o) { return (long)o->now.evaluations; }
long optimise_rejected(const Optimiser *o) { return (long)o->now.rejected; }
const char *optimise_reason(const Optimiser *o) { return o->now.reason; }

/* making -------------------------------------------------------------------------------------- */

static SltStatus check_config(const OptimiseConfig *c, SltError *err) {
    if (c->n < 1 || c->n > ((size_t)1 << 31) || !c->start)
        return status_fail(err, SLT_USAGE, "an optimiser of %zu parameters", c->n);
    if ((unsigned)c->method >= OPTIMISE_METHODS)
        return status_fail(err, SLT_USAGE, "unknown optimiser %d", (int)c->method);
    if (!(c->default_rate >= 0) || isinf(c->default_rate) || !(c->beta1 >= 0 && c->beta1 < 1) ||
        !(c->beta2 >= 0 && c->beta2 < 1) || !(c->epsilon >= 0) || !(c->momentum >= 0 && c->momentum < 1)) {
        return status_fail(err, SLT_USAGE, "a rate, beta, epsilon or momentum of the optimiser is out of range");
    }
    if (c->history < 0 || c->history > 1000 || c->grid_count < 0 || c->patience < 0 || c->zeros < 0 ||
        c->max_failures < 0 || !(c->gradient_tolerance >= 0) || !(c->loss_tolerance >= 0)) {
        return status_fail(err, SLT_USAGE, "a history, tolerance or patience of the optimiser is out of range");
    }
    if (c->grid_count && !c->grids)
        return status_fail(err, SLT_USAGE, "an optimiser of %d grids without their description", c->grid_count);
    for (size_t i = 0; i < c->n; i++) {
        double lo = c->lo ? c->lo[i] : -INFINITY, hi = c->hi ? c->hi[i] : INFINITY;
        if (!isfinite(c->start[i])) return status_fail(err, SLT_USAGE, "parameter %zu starts at %g", i, c->start[i]);
        if (!(lo <= hi) || lo == INFINITY || hi == -INFINITY)
            return status_fail(err, SLT_USAGE, "parameter %zu has the bounds [%g, %g]", i, lo, hi);
        if (c->learning_rate && (!(c->learning_rate[i] >= 0) || isinf(c->learning_rate[i])))
            return status_fail(err, SLT_USAGE, "parameter %zu has the learning rate %g", i, c->learning_rate[i]);
        if (c->log && c->log[i] && !(optimise_clamp(c->start[i], lo, hi) > 0)) {
            return status_fail(err, SLT_USAGE, "parameter %zu is optimised as its logarithm but starts at %g", i,
                               optimise_clamp(c->start[i], lo, hi));
        }
    }
    for (int k = 0; k < c->grid_count; k++) {
        const OptimiseGrid *g = &c->grids[k];
        double last = 0;
        if (g->width >= 1 && g->height >= 1 && g->channels >= 1) {
            last = (double)g->offset + (g->width - 1.0) * (double)g->stride_x +
                   (g->height - 1.0) * (double)g->stride_y + (g->channels - 1.0) * (double)g->stride_c;
        }
        if (g->edges && g->height > 1 && g->stride_y != g->stride_x * (size_t)g->width) last = INFINITY;
        if (g->width < 1 || g->height < 1 || g->channels < 1 || !(last < (double)c->n) || !(g->lambda >= 0) ||
            isinf(g->lambda)) {
            return status_fail(err, SLT_USAGE,
                               "grid %d of the optimiser does not fit its %zu parameters, or lambda is bad", k, c->n);
        }
    }
    return SLT_OK;
}

static void fill_defaults(OptimiseConfig *c) {
    const Method *m = &optimise_methods[(unsigned)c->method < OPTIMISE_METHODS ? c->method : 0];
    c->default_rate = c->default_rate != 0 ? c->default_rate : m->rate;
    c->beta1 = c->beta1 != 0 ? c->beta1 : 0.9;
    c->beta2 = c->beta2 != 0 ? c->beta2 : 0.999;
    c->epsilon = c->epsilon != 0 ? c->epsilon : 1e-8;
    c->history = c->history ? c->history : 10;
    c->zeros = c->zeros ? c->zeros : 1;
    c->max_failures = c->max_failures ? c->max_failures : 10;
    if (c->patience == 0 && m->patience > 0) {
        c->patience = m->patience;
        c->loss_tolerance = c->loss_tolerance > 0 ? c->loss_tolerance : m->loss_tolerance;
    }
}

/* Replaces the config's arrays by owned ones. False when out of memory; what was made is then freed
 * by optimise_free. */
static bool own_arrays(Optimiser *o, const OptimiseConfig *from) {
    OptimiseConfig *c = &o->config;
    double *rate = malloc(c->n * sizeof *rate), *lo = malloc(c->n * sizeof *lo), *hi = malloc(c->n * sizeof *hi);
    uint8_t *log_flag = malloc(c->n);
    OptimiseGrid *grids = malloc(((size_t)c->grid_count + 1) * sizeof *grids);
    c->start = NULL;
    c->learning_rate = rate;
    c->lo = lo;
    c->hi = hi;
    c->log = log_flag;
    c->grids = grids;
    o->solvers = calloc((size_t)c->grid_count + 1, sizeof *o->solvers);
    o->graphs = calloc((size_t)c->grid_count + 1, sizeof *o->graphs);
    o->lo = malloc(c->n * sizeof *o->lo);
    o->hi = malloc(c->n * sizeof *o->hi);
    if (!rate || !lo || !hi || !log_flag || !grids || !o->solvers || !o->graphs || !o->lo || !o->hi) return false;
    for (size_t i = 0; i < c->n; i++) {
        rate[i] = from->learning_rate ? from->learning_rate[i] : c->default_rate;
        lo[i] = from->lo ? from->lo[i] : -INFINITY;
        hi[i] = from->hi ? from->hi[i] : INFINITY;
        log_flag[i] = from->log && from->log[i];
        o->lo[i] = !log_flag[i] ? lo[i] : lo[i] > 0 ? log(lo[i]) : -INFINITY;
        o->hi[i] = !log_flag[i] ? hi[i] : log(hi[i]);
    }
    if (c->grid_count) memcpy(grids, from->grids, (size_t)c->grid_count * sizeof *grids);
    return true;
}

static bool make_block(Optimiser *o) {
    size_t n = o->config.n, history = o->method->pairs ? (size_t)o->config.history : 0;
    size_t vectors = o->method->vectors * n;
    size_t cells = 0;
    for (int k = 0; k < o->config.grid_count; k++) {
        size_t count = (size_t)o->config.grids[k].width * (size_t)o->config.grids[k].height;
        cells = count > cells ? count : cells;
    }
    o->persistent = 6 * n + vectors + 2 * history * n;
    o->block = calloc(o->persistent + 2 * n + cells + history + 1, sizeof *o->block);
    o->is_free = calloc(n, 1);
    if (!o->block || !o->is_free) return false;
    double *p = o->block;
    struct {
        double **to;
        size_t size;
    } const parts[] = {{&o->u, n},           {&o->params, n}, {&o->best, n},          {&o->base, n},
                       {&o->g, n},           {&o->step, n},   {&o->vectors, vectors}, {&o->s, history * n},
                       {&o->y, history * n}, {&o->fresh, n},  {&o->work, n},          {&o->grid_scratch, cells},
                       {&o->alpha, history}};
    for (size_t i = 0; i < sizeof parts / sizeof *parts; i++) {
        *parts[i].to = p;
        p += parts[i].size;
    }
    return true;
}

static SltStatus make_solvers(Optimiser *o, SltError *err) {
    for (int k = 0; k < o->config.grid_count; k++) {
        const OptimiseGrid *g = &o->config.grids[k];
        if (g->edges && g->lambda > 0) {
            o->graphs[k] = graph_create((uint32_t)g->width * (uint32_t)g->height, g->edges, g->nedges, g->lambda, err);
            if (!o->graphs[k]) return err ? err->status : SLT_LIMIT;
            continue;
        }
        for (int j = 0; j < k && g->lambda > 0; j++) {
            const OptimiseGrid *h = &o->config.grids[j];
            if (o->solvers[j] && h->width == g->width && h->height == g->height && h->lambda == g->lambda)
                o->solvers[k] = o->solvers[j];
        }
        if (!o->solvers[k] && g->lambda > 0) {
            o->solvers[k] = laplacian_create(g->width, g->height, g->lambda, err);
            if (!o->solvers[k]) return err ? err->status : SLT_LIMIT;
        }
    }
    return SLT_OK;
}

Optimiser *optimise_create(const OptimiseConfig *config, SltError *err) {
    OptimiseConfig c = *config;
    fill_defaults(&c);
    if (check_config(&c, err) != SLT_OK) return NULL;
    Optimiser *o = calloc(1, sizeof *o);
    if (o) o->config = c, o->method = &optimise_methods[c.method], o->rate_factor = 1;
    if (!o || !own_arrays(o, config) || !make_block(o)) {
        optimise_free(o);
        status_fail(err, SLT_LIMIT, "out of memory for an optimiser of %zu parameters", c.n);
        return NULL;
    }
    if (make_solvers(o, err) != SLT_OK) {
        optimise_free(o);
        return NULL;
    }
    for (size_t i = 0; i < c.n; i++) {
        o->params[i] = optimise_clamp(config->start[i], o->config.lo[i], o->config.hi[i]);
        o->u[i] = o->base[i] = o->config.log[i] ? log(o->params[i]) : o->params[i];
        o->best[i] = o->params[i];
    }
    o->now.best_loss = o->now.lowest_loss = o->now.base_loss = o->now.reference_loss = INFINITY;
    o->now.step_scale = 1;
    return o;
}

void optimise_free(Optimiser *o) {
    if (!o) return;
    for (int k = 0; o->solvers && k < o->config.grid_count; k++) {
        for (int j = k + 1; j < o->config.grid_count; j++) /* shared ones are freed once */
            o->solvers[j] = o->solvers[j] == o->solvers[k] ? NULL : o->solvers[j];
        laplacian_free(o->solvers[k]);
    }
    for (int k = 0; o->graphs && k < o->config.grid_count; k++) graph_free(o->graphs[k]);
    free(o->graphs);
    free(o->solvers);
    free((void *)o->config.learning_rate);
    free((void *)o->config.lo);
    free((void *)o->config.hi);
    free((void *)o->config.log);
    free((void *)o->config.grids);
    free(o->lo);
    free(o->hi);
    free(o->block);
    free(o->is_free);
    free(o);
}
