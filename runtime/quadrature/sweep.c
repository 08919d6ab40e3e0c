/* Tiles, the points of their cells, and the list of what is left over. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/quadrature/sweep.h"
#include "runtime/sample/alloc.h"
#include "runtime/sample/boundary.h"
#include "runtime/sample/near.h"
#include "runtime/sample/prove.h"

enum {
    SLOPES = 2,           /* units in the last place by which what a crossing weighs may round */
    ROUNDS = 6,           /* most rounds over cells whose tiles ran out of their budget */
    ROUNDING_TERMS = 128, /* of a tile, whose sum rounds as sums.c has it */
    LEAST_BUDGET = 512,   /* evaluations of a tile, below which a round makes no sense */
    DEEPER_BUDGET = 192,  /* and of a cell at the least size, to cut it further, */
    DEEPER_ROUNDS = 12,   /* this often, each time into parts so many times smaller */
    DEEPER = 16,
    PARTS = 8,  /* of a cell of 3D that is cut */
    FEWEST = 16 /* so large a part of those that are left a round is for */
};

#define ALIKE 0x1p-10 /* of what one sample may make of a value: two sets that differ by less agree */

static bool grow(void **v, uint64_t n, uint64_t *cap, size_t size) {
    if (n <= *cap) return true;
    uint64_t more = 2 * n;
    void *p = realloc(*v, more * size);
    if (p) *v = p, *cap = more;
    return p != NULL;
}

static SltStatus no_memory(const Sweep *p) { return status_fail(p->run->err, SLT_LIMIT, "out of memory"); }

/* ---- points */
static SumGroup interior_group(CellRule rule) {
    return rule == CELL_FINE ? SUM_INTERIOR_FINE : rule == CELL_BOTH ? SUM_INTERIOR_BOTH : SUM_INTERIOR_COARSE;
}

static void add_value(SweepWorker *v, CellRule rule, uint32_t channel, double f) {
    for (int r = 0; r < CELL_RULES; r++)
        if (rule == CELL_BOTH || r == (int)rule) v->f[r][channel] += f;
}

/* CellSink.value */
static void take_value(void *worker, double weight, const double *f, CellRule rule) {
    SweepWorker *v = worker;
    for (uint32_t c = 0; c < v->sweep->run->s->channels; c++) add_value(v, rule, c, weight * f[c]);
}

/* f, and its adjoints by channel with these weights as seeds. */
static void volume_integral(SweepWorker *v, const CellPoint *p, uint32_t n, CellRule rule) {
    Batch *b = &v->w->batch;
    uint32_t channels = b->s->channels;
    SumGroup group = interior_group(rule);
    if (!v->sweep->interior) {
        batch_call(b, SLT_K_VALUE, n);
        for (uint32_t c = 0; c < channels; c++)
            for (uint32_t i = 0; i < n; i++) add_value(v, rule, c, p[i].weight * batch_get(b, SLT_OUT_F, c, i));
        return;
    }
    double weight[BATCH];
    for (uint32_t i = 0; i < n; i++) weight[i] = p[i].weight + p[i].moved;
    accum_rows(&v->w->acc, b, weight, n, group * channels);
    for (uint32_t c = 0; c < channels; c++) /* the reverse kernel gives f as well */
        for (uint32_t i = 0; i < n; i++) add_value(v, rule, c, p[i].weight * batch_get(b, SLT_OUT_F, c, i));
}

static void volume_image(SweepWorker *v, const CellPoint *p, uint32_t n) {
    Sweep *q = v->sweep;
    Batch *b = &v->w->batch;
    double f[SLT_MAX_CHANNELS];
    bool forward = q->kind == SWEEP_FORWARD;
    for (uint32_t d = 0; d < (forward ? q->dirs->n : 1); d++) {
        if (forward) b->args.dparams = q->dirs->flt[d];
        b->again = d > 0;
        batch_call(b, forward ? SLT_K_JVP : SLT_K_VALUE, n);
        for (uint32_t i = 0; i < n; i++) {
            for (uint32_t c = 0; c < b->s->channels; c++)
                f[c] = p[i].weight * batch_get(b, forward ? SLT_OUT_DF : SLT_OUT_F, c, i);
            splat_add(&v->splat, d, p[i].x, f);
        }
    }
    b->again = false;
}

void sweep_volume_reverse(SweepWorker *v, const CellPoint *p, uint32_t n, CellRule rule) {
    Batch *b = &v->w->batch;
    uint32_t channels = b->s->channels, used = 0;
    for (uint32_t i = 0; i < n; i++) {
        double a[SLT_MAX_CHANNELS];
        bool any = false;
        grid_gather(&v->sweep->run->grid, v->sweep->adjoint, channels, p[i].x, a);
        for (uint32_t c = 0; c < channels; c++) any |= a[c] != 0;
        if (!any) continue; /* no pixel asks for it */
        batch_set_x(b, used, p[i].x);
        for (uint32_t c = 0; c < channels; c++) batch_set(b, SLT_IN_SEED0 + c, used, (p[i].weight + p[i].moved) * a[c]);
        used++;
    }
    accum_call(&v->w->acc, b, SLT_K_VJP, used, interior_group(rule));
}

void sweep_volume(void *worker, const CellPoint *p, uint32_t n, CellRule rule, const Box *within) {
    SweepWorker *v = worker;
    (void)within;
    if (rule == CELL_COARSE && !v->sweep->errors) return;
    if (v->sweep->kind == SWEEP_REVERSE) {
        sweep_volume_reverse(v, p, n, rule);
        return;
    }
    for (uint32_t i = 0; i < n; i++) batch_set_x(&v->w->batch, i, p[i].x);
    if (v->sweep->kind == SWEEP_INTEGRAL) volume_integral(v, p, n, rule);
    else volume_image(v, p, n);
    if (v->sweep->kind == SWEEP_LOSS) v->failed |= !kept_points(&v->kept, &v->w->batch.args, p, n);
}

/* Where no errors are kept, the lower rule is there for pieces to be cut by. */
static uint32_t fine_alone(Crossing *c, uint32_t n) {
    uint32_t kept = 0;
    for (uint32_t i = 0; i < n; i++)
        if (c[i].cls == CELL_FINE) c[kept++] = c[i];
    return kept;
}

static void take_curve(void *worker, Crossing *c, uint32_t n) {
    SweepWorker *v = worker;
    if (!v->sweep->errors) n = fine_alone(c, n);
    for (uint32_t ch = 0; ch < v->sweep->run->s->channels; ch++)
        for (uint32_t i = 0; i < n; i++) v->jump[ch] = larger(fabs(c[i].jump[ch]), v->jump[ch]);
    if (v->sweep->kind == SWEEP_LOSS) v->failed |= !kept_crossings(&v->kept, &v->w->batch.args, c, n);
    else sink_put_weighed(&v->w->sink, c, n);
}

/* A cell of one colour: of each pixel the part of its filter that lies there. */
static void take_constant(void *worker, const Box *cell, const double *f) {
    SweepWorker *v = worker;
    uint32_t channels = v->sweep->run->s->channels;
    double m = sweep_measure(cell, v->sweep->run->s->dim);
    for (uint32_t c = 0; c < channels && v->sweep->kind == SWEEP_INTEGRAL; c++)
        v->f[CELL_FINE][c] += m * f[c], v->f[CELL_COARSE][c] += m * f[c];
    if (v->sweep->kind == SWEEP_RENDER) splat_add_box(&v->splat, cell->lo, cell->end, f);
}

int sweep_gap(const Sweep *p, const Box *b) {
    const SltScene *s = p->run->s;
    int axis = -1;
    for (uint32_t d = 0; d < s->dim; d++) {
        double next = s->f64 ? nextafter(b->lo[d], HUGE_VAL) : (double)nextafterf((float)b->lo[d], HUGE_VALF);
        if (next >= b->end[d]) axis = (int)d;
    }
    return axis;
}

/* Between two floats there is nothing to be cut. */
static bool is_gap(const Sweep *p, const Box *b) { return sweep_gap(p, b) >= 0; }

static bool is_large(const Sweep *p, const Box *b) {
    const SltScene *s = p->run->s;
    bool large = false;
    for (uint32_t d = 0; d < s->dim; d++) large |= b->end[d] - b->lo[d] > 2 * p->options.least * (s->hi[d] - s->lo[d]);
    return large;
}

bool sweep_room_left(SweepWorker *v) { return grow((void **)&v->left, v->nleft + 1, &v->left_cap, sizeof *v->left); }

static void add_left(SweepWorker *v, const Box *cell, const double *bounds, double apart, bool curved) {
    if (!sweep_room_left(v)) {
        v->failed = true;
        return;
    }
    LeftCell *l = &v->left[v->nleft++];
    const double *known = v->within ? v->within->bounds : NULL;
    l->box = *cell, l->halvings = l->loose = 0, l->stands = l->asked = 1, l->curved = curved, l->apart = apart;
    for (uint32_t c = 0; c < 2 * v->sweep->run->s->channels; c++)
        l->bounds[c] = !known ? bounds[c] : c & 1 ? fmin(bounds[c], known[c]) : fmax(bounds[c], known[c]);
}

static void take_left(void *worker, const Box *cell, const double *bounds, double apart) {
    add_left(worker, cell, bounds, apart, false);
}

bool sweep_room_beside(Box **list, uint64_t n, uint64_t *cap) { return grow((void **)list, n + 1, cap, sizeof **list); }

/* What a cell that is only sampled can hide of the value: two points of it tell nothing, of many each other. */
static bool take_sampled(void *worker, const Box *cell, const double *bounds) {
    SweepWorker *v = worker;
    double m = sweep_measure(cell, v->sweep->run->s->dim), most = 0;
    if (v->sweep->waits && v->counts.spent && is_large(v->sweep, cell)) {
        v->counts.curved -= m / v->sweep->volume; /* it is counted when it has its volume */
        add_left(v, cell, bounds, 0, true);
        return true;
    }
    bool taken = sweep_takes_beside(v->sweep, cell);
    for (uint32_t c = 0; c < v->sweep->run->s->channels; c++) {
        double range = bounds[2 * c + 1] - bounds[2 * c];
        if (range < HUGE_VAL && !taken) v->f_hidden[c] += m * range; /* else the rules alone tell */
        most = isnan(range) ? INFINITY : fmax(most, range);
    }
    v->left_bound += m * most;
    if (!taken) v->volume_sampled += m; /* where f is one colour its derivatives may differ */
    else if (sweep_room_beside(&v->beside, v->nbeside, &v->beside_cap)) v->beside[v->nbeside++] = *cell;
    else v->failed = true;
    return taken;
}

/* ---- tiles */
/* As for the lattice, the ends of the domain lie two units in the last place inside: a jump exactly on the border is no
 * moving boundary inside it. */
static double tile_end(const Sweep *p, uint32_t axis, double x) {
    const SltScene *s = p->run->s;
    double eps = 2 * (s->f64 ? DBL_EPSILON : (double)FLT_EPSILON) * fmax(fabs(s->lo[axis]), fabs(s->hi[axis]));
    x = fmin(fmax(x, s->lo[axis] + eps), s->hi[axis] - eps);
    return s->f64 ? x : (double)(float)x;
}

/* Tiles of an image are squares of pixels, of which cells are quarters of quarters. Tiles of an integral end at places
 * that no shape is likely to have. */
static double tile_edge(const Sweep *p, uint32_t axis, uint32_t k, uint32_t n, uint32_t pixels) {
    const Grid *g = &p->run->grid;
    if (!g->integral) return g->lo[axis] + fmin((double)k * pixels, g->n[axis]) * g->side[axis];
    if (k == 0 || k == n) return k ? g->hi[axis] : g->lo[axis];
    double golden = 0.61803398874989485 * (k + 0.37 * axis + 0.2);
    return g->lo[axis] + (k + 0.2 * (golden - floor(golden) - 0.5)) / n * (g->hi[axis] - g->lo[axis]);
}

static SltStatus make_tiles(Sweep *p) {
    static const uint32_t parts[3] = {8, 4, 3};
    const Grid *g = &p->run->grid;
    uint32_t *n = p->tiles, *pixels = p->pixels;
    uint64_t total = 1;
    for (uint32_t d = 0; d < 3; d++) {
        n[d] = pixels[d] = 1;
        if (d >= g->dim) continue;
        uint32_t large = g->dim == 1 ? 4096 : g->dim == 2 ? 64 : 16;
        pixels[d] = g->n[d] > 2 * large ? large : large / 4;
        n[d] = g->integral ? parts[g->dim - 1] * (p->parts ? p->parts : 1) : (g->n[d] + pixels[d] - 1) / pixels[d];
        total *= n[d];
    }
    if (!grow((void **)&p->tile, total, &p->tile_cap, sizeof *p->tile)) return no_memory(p);
    p->ntiles = total;
    for (uint64_t t = 0; t < total; t++) {
        Box *b = &p->tile[t];
        uint64_t rest = t;
        *b = (Box){0};
        for (uint32_t d = 0; d < g->dim; d++) {
            uint32_t k = (uint32_t)(rest % n[d]);
            rest /= n[d];
            b->lo[d] = tile_end(p, d, tile_edge(p, d, k, n[d], pixels[d]));
            b->hi[d] = b->end[d] = tile_end(p, d, tile_edge(p, d, k + 1, n[d], pixels[d]));
        }
    }
    return SLT_OK;
}

void sweep_begin_tile(SweepWorker *v, const Box *box) {
    v->counts = (CellCounts){0}, v->nleft = 0, v->left_bound = v->loss = 0;
    v->volume_sampled = 0, v->nbeside = 0;
    kept_clear(&v->kept);
    memset(v->f, 0, sizeof v->f), memset(v->f_hidden, 0, sizeof v->f_hidden), memset(v->f_unit, 0, sizeof v->f_unit);
    cull_select(&v->sweep->run->cull, &v->w->cull, &v->w->batch, box->lo, box->end);
}

bool sweep_begin_splat(SweepWorker *v, const Box *box) {
    Sweep *p = v->sweep;
    if (p->kind == SWEEP_FORWARD && !sink_rect(&v->w->sink, box->lo, box->end)) return false;
    if (p->kind == SWEEP_INTEGRAL || p->kind == SWEEP_REVERSE) return true;
    uint32_t planes = p->kind == SWEEP_FORWARD ? p->dirs->n : 1;
    return splat_begin(&v->splat, &p->run->grid, planes, p->run->s->channels, box->lo, box->end);
}

static bool tile_work(void *user, uint32_t worker, uint64_t tile) {
    Sweep *p = user;
    SweepWorker *v = &p->worker[worker];
    sweep_begin_tile(v, &p->tile[tile]);
    v->within = p->nparents ? &p->parent[tile] : NULL;
    if (!sweep_begin_splat(v, &p->tile[tile])) return false;
    /* What happens away from curves is f's value. Not of solids: what these cost tells how much is cut. */
    bool known = p->run->s->dim < 3, rigid = !p->interior || (known && p->run->s->rigid);
    CellSink sink = {.curve = take_curve,
                     .volume = sweep_volume,
                     .value = known && rigid && p->kind == SWEEP_INTEGRAL ? take_value : NULL,
                     .constant = !rigid || p->kind >= SWEEP_FORWARD ? NULL : take_constant,
                     .left = take_left,
                     .sampled = take_sampled,
                     .user = v};
    CellOptions o = p->options;
    o.divides = v->within && v->within->apart > 0 && !o.last;
    o.curves_done = v->within && v->within->curved, v->counts.spent = p->ends;
    if (!cells_run(v->cells, &p->tile[tile], &o, &sink, &v->counts)) return false;
    if (p->kind == SWEEP_LOSS && !loss_tile(v, tile)) return false;
    accum_close(&v->w->acc);
    return !(v->failed || v->w->sink.failed || v->w->acc.failed);
}

void sweep_merge_sums(Sweep *p, SweepWorker *v, SumMode mode, double lines) {
    const SltScene *s = p->run->s;
    if (p->kind == SWEEP_FORWARD) splat_merge(&v->w->sink.splat, p->out, p->crossings);
    if (p->kind == SWEEP_RENDER || p->kind == SWEEP_FORWARD) splat_merge(&v->splat, p->out, NULL);
    else sums_merge(&p->sums, &v->w->acc, mode, lines);
    for (uint32_t c = 0; c < s->channels && p->kind == SWEEP_INTEGRAL; c++) {
        double fine = v->f[0][c], coarse = v->f[1][c], d = fabs(fine - coarse);
        bool sets = mode == SUM_SETS || mode == SUM_LINE || mode == SUM_CURVES;
        p->f[c] += sets ? 0.5 * (fine + coarse) : fine;
        if (mode == SUM_RULES) p->f_error[c] += d + (p->sums.rounding + p->sums.roots) * fabs(fine);
        /* Samples that all agree know no error: another one may have met what they all missed. */
        if (sets && d < ALIKE * v->f_unit[c]) d = 2 * v->f_unit[c];
        if (sets) p->f_variance[c] += 0.25 * d * d;
        p->f_hidden[c] += v->f_hidden[c];
    }
    run_collect(p->run, v->w);
}

static void tile_merge(void *user, uint32_t worker, uint64_t tile) {
    Sweep *p = user;
    SweepWorker *v = &p->worker[worker];
    (void)tile;
    CellCounts *t = &p->counts, *c = &v->counts;
    t->settled += c->settled, t->curved += c->curved, t->left += c->left;
    t->upset += c->upset, t->banded += c->banded;
    t->rough_jump += c->rough_jump, t->rim_jump += c->rim_jump;
    for (uint32_t ch = 0; ch < SLT_MAX_CHANNELS; ch++)
        t->upset_jump[ch] += c->upset_jump[ch], t->rims[ch] += c->rims[ch];
    if (c->upset_edge && (!t->upset_edge || c->upset_edge < t->upset_edge)) t->upset_edge = c->upset_edge;
    p->run->stats.dropped[SLT_DROP_COINCIDENT] += c->coincident;
    place_least(&p->run->stats.dropped_at[SLT_DROP_COINCIDENT], &c->coincident_at);
    t->tried += c->tried, t->tall = t->tall > c->tall ? t->tall : c->tall;
    t->cells += c->cells, t->boxes += c->boxes, t->points += c->points, t->spent |= c->spent;
    p->loss += v->loss, p->left_bound += v->left_bound;
    p->short_of_volume |= c->spent && (v->volume_sampled > 0 || v->nbeside);
    p->volume_sampled += v->volume_sampled;
    if (p->kind == SWEEP_LOSS) p->mixed |= v->nleft > 0, v->nleft = 0;
    /* Roundings of so many terms in each of a few lanes. */
    double terms = sqrt(fmax(1, (double)c->points / ROUNDING_TERMS));
    p->sums.roots = c->loose ? p->options.slack : 0;
    p->sums.curves = SLOPES * (p->run->s->f64 ? DBL_EPSILON : (double)FLT_EPSILON);
    if (c->weighed > 0) p->sums.curves += c->blurred / c->weighed;
    for (uint32_t ch = 0; ch < SLT_MAX_CHANNELS; ch++) p->f_error[ch] += c->moved[ch];
    sweep_merge_sums(p, v, p->errors ? SUM_RULES : SUM_ONE, terms);
    p->sums.roots = p->sums.curves = 0;
    for (uint64_t i = 0; i < v->nbeside && !p->failed; i++) {
        p->failed |= !sweep_room_beside(&p->beside, p->nbeside, &p->beside_cap);
        if (!p->failed) p->beside[p->nbeside++] = v->beside[i];
    }
    if (!v->nleft) return;
    if (!grow((void **)&p->left, p->nleft + v->nleft, &p->left_cap, sizeof *p->left)) {
        p->failed = true;
        return;
    }
    memcpy(p->left + p->nleft, v->left, v->nleft * sizeof *v->left);
    p->nleft += v->nleft;
}

/* ---- a sweep */
SltStatus sweep_begin(Sweep *p) {
    Run *r = p->run;
    p->options.pool = &r->pool;
    p->options.flat = r->s->flat && (r->grid.integral || r->grid.filter == SLT_FILTER_BOX);
    const SltScene *s = r->s;
    static const SinkKind kinds[] = {SINK_PARTS, SINK_KEEP, SINK_FORWARD, SINK_REVERSE, SINK_REVERSE};
    p->volume = 1;
    for (uint32_t d = 0; d < s->dim; d++) p->volume *= s->hi[d] - s->lo[d];
    uint32_t rows = p->kind == SWEEP_INTEGRAL ? s->channels : p->kind >= SWEEP_REVERSE ? 1 : 0;
    p->marches &= p->options.curves;
    r->spares = true; /* tiles are few, and what they cost differs by twice */
    if (!sums_init(&p->sums, s, rows)) return no_memory(p);
    SltStatus st = run_workers(r, UINT32_MAX, SUM_GROUPS * rows, kinds[p->kind]);
    if (st != SLT_OK) return st;
    p->worker = alloc_zero(r->nworkers, sizeof *p->worker);
    if (!p->worker) return no_memory(p);
    for (uint32_t i = 0; i < r->nworkers; i++) {
        SweepWorker *v = &p->worker[i];
        v->sweep = p, v->w = &r->worker[i];
        v->w->finder.proves = p->kind == SWEEP_INTEGRAL && prove_serves(s) && !p->marches;
        v->w->finder.coarse = run_is_coarse(r);
        Sink *k = &v->w->sink;
        k->adjoint = p->adjoint, k->sizes = p->kind == SWEEP_REVERSE && p->errors, k->dirs = p->dirs;
        k->misses = p->errors && (p->kind == SWEEP_INTEGRAL || p->kind == SWEEP_REVERSE) && !p->marches;
        if (!kept_init(&v->kept, s) || (rows && !accum_folds(&v->w->acc))) return no_memory(p);
        if (!(v->cells = cells_new(&v->w->batch, s->lo, s->hi))) return no_memory(p);
    }
    return SLT_OK;
}

void sweep_end(Sweep *p) {
    for (uint32_t i = 0; i < p->run->nworkers && p->worker; i++)
        cells_free(p->worker[i].cells), splat_free(&p->worker[i].splat), kept_free(&p->worker[i].kept),
            free(p->worker[i].left), free(p->worker[i].beside), free(p->worker[i].hidden), free(p->worker[i].march);
    free(p->worker), free(p->tile), free(p->left), free(p->parent), free(p->beside);
    sums_free(&p->sums);
    run_free_workers(p->run);
}

/* Those of the cells that are left which pass become tiles. False when memory runs out. */
static bool begin_again(Sweep *p, bool (*passes)(const Sweep *, const LeftCell *)) {
    uint64_t kept = 0;
    p->ntiles = p->nparents = 0;
    if (!grow((void **)&p->tile, p->nleft, &p->tile_cap, sizeof *p->tile)) return false;
    if (!grow((void **)&p->parent, p->nleft, &p->parent_cap, sizeof *p->parent)) return false;
    for (uint64_t i = 0; i < p->nleft; i++)
        if (!passes(p, &p->left[i])) p->left[kept++] = p->left[i];
        else p->tile[p->ntiles++] = p->left[i].box, p->parent[p->nparents++] = p->left[i];
    p->nleft = kept;
    return true;
}

static uint64_t count_left(const Sweep *p, bool (*passes)(const Sweep *, const LeftCell *)) {
    uint64_t n = 0;
    for (uint64_t i = 0; i < p->nleft; i++) n += passes(p, &p->left[i]);
    return n;
}

static bool may_be_cut(const Sweep *p, const LeftCell *l) { return !is_gap(p, &l->box); }
static bool is_unfinished(const Sweep *p, const LeftCell *l) {
    return !l->curved && is_large(p, &l->box) && !is_gap(p, &l->box);
}
static bool is_next(const Sweep *p, const LeftCell *l) {
    return is_unfinished(p, l) && (!(l->apart > 0) || l->apart >= p->worst);
}
static bool is_volume(const Sweep *p, const LeftCell *l) {
    (void)p;
    return l->curved;
}
static bool is_either(const Sweep *p, const LeftCell *l) { return l->curved || is_next(p, l); }

/* Cells that were left because their tile had no evaluations to spare become tiles, if there are as many to spare for
 * all of them as makes sense; what is left at the least size stays. Derivatives come first. */
static bool again(Sweep *p, uint64_t spare) {
    uint64_t all = count_left(p, is_either), curves = count_left(p, is_next);
    if (all && spare / all >= LEAST_BUDGET) return begin_again(p, is_either);
    return curves && spare / curves >= LEAST_BUDGET && begin_again(p, is_next);
}

static int descending(const void *a, const void *b) {
    const double *p = a, *q = b;
    return (*p < *q) - (*p > *q);
}

/* Of a solid cells that were left because their rules differ cost about so much if they are integrated as they are:
 * those that differ most are cut, as many as can be paid for so that as much remains for the others: *kept. False:
 * there is nothing but cells that differ and cannot be paid for, or memory ran out. */
static bool choose_worst(Sweep *p, uint64_t used, uint64_t spare, uint64_t *kept) {
    uint64_t n = 0, others = 0, k = 0;
    p->worst = 0, *kept = 0;
    for (uint64_t i = 0; i < p->nleft; i++) {
        bool next = is_unfinished(p, &p->left[i]), differs = p->left[i].apart > 0;
        n += next && differs, others += next && !differs;
    }
    if (!n) return true;
    double *apart = malloc(n * sizeof *apart);
    if (!apart) return false;
    for (uint64_t i = 0; i < p->nleft; i++)
        if (is_unfinished(p, &p->left[i]) && p->left[i].apart > 0) apart[k++] = p->left[i].apart;
    qsort(apart, n, sizeof *apart, descending);
    double each = CELL_GOES_OUT * (double)used / (double)p->counts.tried;
    double paid = ((double)spare / each - (double)n) / PARTS - (double)others;
    k = paid >= (double)n ? n : paid * FEWEST >= (double)n ? (uint64_t)paid : 0;
    p->worst = k ? apart[k - 1] : HUGE_VAL, *kept = (uint64_t)fmin(each * (double)(n - k), (double)spare);
    free(apart);
    return k || (others && paid >= 0);
}

bool sweep_failed(const Sweep *p) { return p->failed || p->worker[0].failed; }

/* Volume for which nothing is to spare is sampled. */
static SltStatus end_waiting(Sweep *p) {
    SltStatus st = SLT_OK;
    p->waits = false;
    if (!count_left(p, is_volume)) return st;
    if (!begin_again(p, is_volume)) return no_memory(p);
    p->ends = true;
    st = run_tiles(p->run, p->ntiles, tile_work, tile_merge, p);
    p->ends = false, p->nparents = 0;
    return st == SLT_OK && sweep_failed(p) ? no_memory(p) : st;
}

/* An event may be open in a cell of the least size because bounds are loose there, or around a point: a few more boxes
 * tell. Where they do not, along curves, cells would become ever more: so it is done for a small share of what the
 * sweep has cost. */
static SltStatus deepen(Sweep *p, uint64_t start, uint64_t share) {
    Run *r = p->run;
    SltStatus st = SLT_OK;
    bool spent = p->counts.spent;
    double least = p->options.least;
    uint64_t used = r->stats.evaluations - start, most = used + (uint64_t)(p->deeper * (double)used);
    if (p->budget && share < most) most = share;
    for (uint32_t round = 0; round < DEEPER_ROUNDS && st == SLT_OK; round++) {
        used = r->stats.evaluations - start;
        uint64_t spare = most > used ? most - used : 0;
        if (!p->nleft || spare / p->nleft < DEEPER_BUDGET || p->options.least <= p->least_ever) break;
        if (!count_left(p, may_be_cut) || !begin_again(p, may_be_cut)) break;
        p->options.budget = spare / p->ntiles, p->options.least = fmax(p->options.least / DEEPER, p->least_ever);
        st = run_tiles(r, p->ntiles, tile_work, tile_merge, p);
        if (st == SLT_OK && sweep_failed(p)) st = no_memory(p);
    }
    p->counts.spent = spent, p->options.least = least, p->nparents = 0;
    return st;
}

/* The derivative of an integral in which f jumps across the domain, along a curve that moves as its parameter does. */
static double unit_of(const Sweep *p) {
    const SltScene *s = p->run->s;
    double jump = 0, size = 0;
    for (uint32_t c = 0; c < s->channels; c++) jump = fmax(jump, p->jump[c]);
    for (uint32_t d = 0; d < s->dim; d++) size += p->volume / (s->hi[d] - s->lo[d]);
    return (jump > 0 ? jump : 1) * size;
}

/* In single precision weights of a jump that is a few denormals are 0 or twice what they should be: what curves as long
 * as the domain's sides weigh. */
static void add_denormals(Sweep *p) {
    enum { FEW = 32 };
    const SltScene *s = p->run->s;
    double moved[SLT_MAX_CHANNELS] = {0}, size = 0;
    for (uint32_t d = 0; d < s->dim; d++) size += 2 * p->volume / (s->hi[d] - s->lo[d]);
    for (uint32_t i = 0; i < p->run->nworkers; i++)
        for (uint32_t c = 0; c < s->channels; c++)
            if (p->worker[i].jump[c] < FEW * 0x1p-149) moved[c] = fmax(moved[c], p->worker[i].jump[c] * size);
    sums_upset(&p->sums, s->active, moved);
}

SltStatus sweep_run(Sweep *p) {
    Run *r = p->run;
    sums_clear(&p->sums);
    p->counts = (CellCounts){0}, p->left_bound = p->loss = 0, p->nleft = p->nbeside = 0, p->mixed = false, p->lines = 2;
    p->differ = p->unseen = 0;
    p->short_of_volume = p->unnamed = p->sampled = false, p->volume_sampled = 0;
    memset(p->gone, 0, sizeof p->gone), memset(p->narrow, 0, sizeof p->narrow);
    memset(p->f, 0, sizeof p->f), memset(p->f_error, 0, sizeof p->f_error),
        memset(p->f_variance, 0, sizeof p->f_variance), memset(p->f_hidden, 0, sizeof p->f_hidden);
    uint64_t start = r->stats.evaluations, share = (uint64_t)((1 - p->left_share) * (double)p->budget), kept = 0;
    if (p->cells_budget && p->cells_budget < share) share = p->cells_budget;
    SltStatus st = make_tiles(p);
    p->nparents = 0;
    for (uint32_t round = 0; round < ROUNDS && st == SLT_OK && p->ntiles; round++) {
        uint64_t used = r->stats.evaluations - start;
        p->waits = p->kind == SWEEP_INTEGRAL && p->errors && p->wanted && round + 1 < ROUNDS;
        p->options.budget = p->budget ? (share > used + kept ? share - used - kept : 0) / p->ntiles + 1 : 0;
        p->counts.spent = false, p->options.returns = !p->options.last;
        st = run_tiles(r, p->ntiles, tile_work, tile_merge, p);
        if (st == SLT_OK && sweep_failed(p)) st = no_memory(p);
        used = r->stats.evaluations - start;
        p->counts.spent |= p->options.last || p->worst > 0; /* some were held back */
        bool more = st == SLT_OK && p->counts.spent;
        p->options.tall = p->counts.tall;
        /* Where nothing is left at the least size, or nothing will be, lines need no share. */
        bool lines = p->cells_budget || count_left(p, is_either) < p->nleft;
        if (p->counts.tried && !lines) share = p->budget;
        uint64_t spare = used < share ? share - used : 0;
        if (more && p->counts.tried) p->options.last |= !choose_worst(p, used, spare, &kept) || round + 2 == ROUNDS;
        if (p->options.last) {
            p->worst = 0, kept = 0, share = p->cells_budget ? share : p->budget;
            spare = used < share ? share - used : 0;
        }
        if (!more || !again(p, spare - kept)) break;
    }
    p->options.last = p->options.returns = false, p->options.tall = 0, p->worst = 0;
    if (st == SLT_OK) st = end_waiting(p);
    if (st == SLT_OK && p->errors && !p->cells_budget && !p->marches) st = deepen(p, start, share);
    double left = 0;
    if (p->errors) sums_upset(&p->sums, r->s->active, p->counts.upset_jump);
    if (p->errors && !r->s->f64) add_denormals(p);
    if (p->errors) r->stats.singular = sums_rims(&p->sums, r->s->active, p->counts.rims);
    if (p->errors) sums_sampled(&p->sums, r->s->active, p->volume_sampled / p->volume);
    for (uint64_t i = 0; i < p->nleft; i++) left += sweep_measure(&p->left[i].box, r->s->dim) / p->volume;
    if (p->kind != SWEEP_LOSS) p->counts.left = left;
    /* Cells that are left get a few samples, of which two sets may agree by chance: cells err independently. */
    if (p->errors && p->options.volume && !p->marches && p->nleft)
        sums_sampled(&p->sums, r->s->active, 0.5 * left / sqrt((double)p->nleft));
    p->gave_up = left > p->only_if_left;
    if (st == SLT_OK && p->nleft && !p->gave_up && p->only_if_cost > 0)
        p->gave_up = sweep_march_is_dear(p, r->stats.evaluations - start);
    if (st == SLT_OK && sweep_failed(p)) st = no_memory(p);
    if (st == SLT_OK && !p->gave_up) st = sweep_sample_beside(p);
    if (st == SLT_OK && p->nleft && !p->gave_up) {
        p->mixed = true;
        for (uint32_t i = 0; i < r->nworkers; i++) {
            p->worker[i].unnamed = false;
            for (uint32_t c = 0; c < r->s->channels; c++) p->jump[c] = fmax(p->jump[c], p->worker[i].jump[c]);
        }
        st = sweep_work_off_left(p, start);
        for (uint32_t i = 0; i < r->nworkers; i++) p->unnamed |= p->worker[i].unnamed;
        if (p->errors) sums_few(&p->sums);
        if (p->unnamed && p->errors) sums_unnamed(&p->sums, r->s->active, left, unit_of(p));
        if (p->errors) sums_gone(&p->sums, r->s->active, p->gone), sums_upset(&p->sums, r->s->active, p->narrow);
    }
    return st;
}
