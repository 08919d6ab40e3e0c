/* What is left over: its list, worked off in chunks, and how much each of its cells gets. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/quadrature/sweep.h"
#include "runtime/sample/near.h"
#include "runtime/sample/thin.h"

enum {
    LEFT_LINES = 32, /* most lines across a cell */
    LEFT_LEAST = 64, /* cells that are looked at, whatever they cost */
    CROSSING_COST = 6
};
#define LEFT_PAYS 0.125
#define UNSEEN 0.1
#define LEFT_SHORT 0x1p-24 /* of the domain's width */
#define LEFT_MOST 0.5
#define LEFT_HIDES 0x1p-5 /* of what cells have cost: to find out whether their lines must be cut by bounds */
#define LEFT_LOOKS 0x1p-4 /* for the same, of a number of evaluations that is given and that must be obeyed */
#define LEFT_ASKS 0x1p-6 /* of what cells have cost: for what those that are left may hide, whatever there is to spare */

double sweep_hidden(const Sweep *p, const LeftCell *l) {
    double most = 0;
    for (uint32_t c = 0; c < p->run->s->channels; c++) {
        double d = l->bounds[2 * c + 1] - l->bounds[2 * c];
        most = isnan(d) ? INFINITY : fmax(most, d);
    }
    return most * sweep_measure(&l->box, p->run->s->dim);
}

double left_divisor(const SweepWorker *v) {
    /* A curve crosses about two lines an axis and cell for each line across; cells err independently. */
    if (v->sweep->marches) return 1;
    double lines = v->sweep->lines;
    return lines * sqrt(fmax(1, (double)v->w->finder.crossings / (2 * lines)));
}

/* By how much f may jump in a cell: less than its bounds are apart, and about what is seen elsewhere. */
static void note_unit(SweepWorker *v, const LeftCell *l) {
    const Sweep *p = v->sweep;
    double sample = l->stands * sweep_measure(&l->box, p->run->s->dim) / pow(p->lines, p->run->s->dim);
    for (uint32_t c = 0; c < p->run->s->channels; c++) {
        double jump = l->bounds[2 * c + 1] - l->bounds[2 * c];
        if (!(jump < INFINITY)) jump = p->jump[c] > 0 ? p->jump[c] : 1;
        else if (p->jump[c] > 0) jump = fmin(jump, p->jump[c]);
        v->f_unit[c] = fmax(v->f_unit[c], jump * sample);
    }
}

/* Of what lines of the chunk met and could not integrate, of which each of their sets has all. Where it is not known by
 * how much f jumps, by as much as elsewhere. */
static void take_gone(SweepWorker *v) {
    const Sweep *p = v->sweep;
    Sink *k = &v->w->sink;
    double part = p->run->s->dim > 1 ? 0.5 : 1;
    for (uint32_t c = 0; c < p->run->s->channels; c++) {
        double usual = k->kind == SINK_REVERSE ? 0 : p->jump[c] > 0 ? p->jump[c] : 1;
        v->gone[c] = p->marches ? 0 : part * (k->gone[c] + usual * v->w->finder.parts_gone);
    }
    memset(k->gone, 0, sizeof k->gone), v->w->finder.parts_gone = 0;
}

/* How large a piece of a boundary a cell may hold: its largest face. A gap between two floats holds as much as the cell
 * that it was cut from. */
static double face(const Box *b, uint32_t dim) {
    double m = 1, shortest = HUGE_VAL;
    for (uint32_t d = 0; d < dim; d++) m *= b->end[d] - b->lo[d], shortest = fmin(shortest, b->end[d] - b->lo[d]);
    return shortest > 0 ? m / shortest : 0;
}

/* Cells of which no side is much longer than two floats are apart, around what is smaller than that: what lines find
 * there are the sides of floats. Both sets of them find the same. */
static void note_narrow(SweepWorker *v, const LeftCell *cell, uint32_t n) {
    const SltScene *s = v->sweep->run->s;
    memset(v->narrow, 0, sizeof v->narrow);
    for (uint32_t i = 0; i < n && !s->f64; i++) {
        const Box *b = &cell[i].box;
        double longest = 0, ulp = 0;
        for (uint32_t d = 0; d < s->dim; d++) {
            longest = fmax(longest, b->end[d] - b->lo[d]);
            ulp = fmax(ulp, FLT_EPSILON * fmax(fabs(b->lo[d]), fabs(b->end[d])));
        }
        if (longest > ulp) continue;
        for (uint32_t c = 0; c < s->channels; c++) {
            double range = cell[i].bounds[2 * c + 1] - cell[i].bounds[2 * c];
            if (range < HUGE_VAL) v->narrow[c] += cell[i].stands * range * face(b, s->dim);
        }
    }
}

static bool left_work(void *user, uint32_t worker, uint64_t chunk) {
    Sweep *p = user;
    SweepWorker *v = &p->worker[worker];
    uint64_t from = (p->first_chunk + chunk) * LEFT_CHUNK,
             to = from + LEFT_CHUNK < p->nleft ? from + LEFT_CHUNK : p->nleft;
    Box hull = p->left[from].box;
    v->differ0 = v->differ, v->unseen0 = v->unseen;
    bool seen[LEFT_CHUNK] = {false}, lost[LEFT_CHUNK] = {false}, done[LEFT_CHUNK] = {false}, met[LEFT_CHUNK] = {false};
    const LeftCell *first = &p->left[from];
    uint32_t n = (uint32_t)(to - from);
    double sides[LEFT_CHUNK][3] = {{0}};
    for (uint64_t i = from; i < to; i++)
        for (uint32_t d = 0; d < p->run->s->dim; d++) {
            sides[i - from][d] = p->left[i].box.end[d] - p->left[i].box.lo[d];
            hull.lo[d] = fmin(hull.lo[d], p->left[i].box.lo[d]);
            hull.end[d] = fmax(hull.end[d], p->left[i].box.end[d]);
        }
    sweep_begin_tile(v, &hull);
    if (!sweep_begin_splat(v, &hull)) return false;
    v->w->finder.lost = lost, v->w->finder.parts_gone = 0;
    memset(v->w->sink.gone, 0, sizeof v->w->sink.gone);
    v->w->sink.coincide.apart = p->apart, v->w->sink.coincide.no_kinks = true;
    v->w->sink.coincide.tied = v->w->finder.tied = p->apart ? p->run->tied : NULL;
    v->w->finder.ties = p->apart != NULL;
    if (p->cuts && !left_cut(v, first, from, n, done, seen)) return false;
    v->w->finder.met = met; /* by near misses, too */
    for (uint64_t i = from; i < to && pool_stop_reason(&p->run->pool) == SLT_OK; i++) {
        const LeftCell *l = &p->left[i];
        v->left_bound += sweep_hidden(p, l);
        int set = l->stands > 1 ? (int)(i & 1) : -1;
        uint64_t differ = v->differ;
        v->owner = (uint8_t)(i - from);
        if (!(l->stands > 0)) continue;
        if (p->options.curves && !p->marches && !done[i - from] && !left_lines(v, l, p->lines, set)) return false;
        if (p->options.volume) left_samples(v, l, p->lines, set), note_unit(v, l);
        seen[i - from] |= p->marches || v->differ != differ; /* march.c has asked already */
    }
    near_flush(v->w);
    finder_run(&v->w->finder, true);
    if (v->w->sink.misses) thin_flush_cells(v->w, sides, p->lines);
    v->w->finder.met = NULL;
    for (uint32_t i = 0; i < n; i++) done[i] |= seen[i] || met[i];
    /* A number of evaluations that is given is obeyed: then the few cells alone have told. */
    if (p->hides && !p->run->j->max_evaluations && !left_cut(v, first, from, n, done, seen)) return false;
    take_gone(v);
    note_narrow(v, first, n);
    v->w->finder.lost = NULL, v->w->sink.coincide.apart = NULL, v->w->finder.ties = false;
    v->w->sink.coincide.tied = v->w->finder.tied = NULL;
    if (p->marches && !left_curves(v, first, n, false)) return false;
    if (p->errors && p->options.curves && !left_hidden(v, first, n, seen, lost)) return false;
    accum_close(&v->w->acc);
    return !(v->w->finder.failed || v->w->sink.failed || v->w->acc.failed);
}

static void left_merge(void *user, uint32_t worker, uint64_t chunk) {
    Sweep *p = user;
    SweepWorker *v = &p->worker[worker];
    (void)chunk;
    p->left_bound += v->left_bound;
    for (uint32_t c = 0; c < p->run->s->channels; c++) p->gone[c] += v->gone[c], p->narrow[c] += v->narrow[c];
    p->differ += v->differ - v->differ0, p->unseen += v->unseen - v->unseen0;
    SumMode mode = p->marches && !p->sampled ? SUM_CURVES : p->run->s->dim == 1 ? SUM_LINE : SUM_SETS;
    sweep_merge_sums(p, v, p->errors ? mode : SUM_ONE, left_divisor(v));
}

/* Would a curve through all cells be of any length? Around points they are many and small. Where most of the domain is
 * left bounds tell nothing, of lines no more than of cells. */
static bool may_hide(const Sweep *p) {
    uint32_t dim = p->run->s->dim;
    double sum = 0, left = 0;
    for (uint64_t i = 0; i < p->nleft; i++)
        sum += face(&p->left[i].box, dim), left += sweep_measure(&p->left[i].box, dim);
    bool some = left < LEFT_MOST * p->volume && sum > LEFT_SHORT * pow(p->volume, 1 - 1.0 / dim);
    return p->options.curves && p->errors && !p->marches && some;
}

/* What so many lines along both axes of a cell cost: their vertices, and two crossings on each. */
static double cost_of(uint32_t lines) { return (lines + 2.0) * (lines + 2.0) + 4.0 * CROSSING_COST * lines; }

/* Lines across a cell such that all of them together cost what is wanted. */
static void plan_lines(Sweep *p, double used, double spare) {
    uint32_t dim = p->run->s->dim;
    double left = 0, cells = (double)p->nleft;
    for (uint64_t i = 0; i < p->nleft; i++) left += sweep_measure(&p->left[i].box, dim);
    double vertices = fmax(p->segments / dim, p->samples) * left / p->volume;
    if (p->budget) vertices = fmin(vertices, 0.5 * spare);
    double n = 2 * round(0.5 * pow(vertices / cells, 1.0 / dim));
    p->lines = n < 2 ? 2 : n > LEFT_LINES ? LEFT_LINES : (uint32_t)n;
    /* Where an error is wanted, no fewer than a share of what cells have cost pays for: in a plane few are left, around
     * points, and lines are cheaper there than ever smaller cells. Along the edges of a solid their errors would add
     * up. */
    double most = fmin(LEFT_PAYS * used, p->budget ? 0.5 * spare : HUGE_VAL) / cells;
    while (p->wanted && dim == 2 && p->lines < LEFT_LINES && cost_of(p->lines + 2) <= most) p->lines += 2;
}

/* Of more cells from `from` on than can be paid for some stand for all, chosen in proportion to their measure and to
 * what they may hold of boundaries. cost: evaluations of each; a few are always looked at. */
static void plan_cells(Sweep *p, uint64_t from, double used, double spare, double cost) {
    uint32_t dim = p->run->s->dim;
    double left = 0, faces = 0, at = 0.5, sum = 0, cells = (double)(p->nleft - from);
    double most = fmax(spare / cost, LEFT_LEAST * cells / (double)p->nleft);
    for (uint64_t i = from; i < p->nleft; i++) {
        left += sweep_measure(&p->left[i].box, dim), faces += face(&p->left[i].box, dim);
        p->left[i].stands = p->left[i].asked = 1;
    }
    if (!p->budget || cells <= most) return;
    p->sampled = true;
    /* Of a quarter of what can be spent. */
    most = fmax(0.75 * most, LEFT_LEAST * cells / (double)p->nleft);
    double asks = fmin(cells, fmax(fmax(0.25 * spare, LEFT_ASKS * used) / HIDDEN_COST, 1)), asked = 0, asked_at = 0.5;
    for (uint64_t i = from; i < p->nleft; i++) {
        LeftCell *l = &p->left[i];
        double part = sweep_measure(&l->box, dim) / left, of_faces = face(&l->box, dim) / faces;
        double expected = (p->options.curves ? 0.5 * (part + of_faces) : part) * most;
        sum += expected;
        l->stands = sum >= at ? fmax(1, 1 / expected) : 0;
        /* Not by measure: a gap has none, and the one with the largest face may hold as much as all the others. */
        double chance = fmin(1, (0.5 / cells + 0.5 * of_faces) * asks);
        asked += chance;
        l->asked = l->stands > 0 ? 1 : asked >= asked_at ? 1 / chance : 0;
        while (asked >= asked_at) asked_at += 1;
        while (sum >= at) at += 1;
    }
}

/* Where so many of the crossings would be missed by lines with half as many vertices, that many may be missed by these,
 * too: fewer cells with more lines each, which stand for the others, tell more. Not after few crossings. */
static bool refine_lines(Sweep *p) {
    enum { FEW = 256 };
    bool coarse = p->sampled && p->run->s->dim == 2 && p->differ > FEW && p->unseen > UNSEEN * p->differ;
    if (coarse) p->lines = 2 * p->lines < LEFT_LINES ? 2 * p->lines : LEFT_LINES;
    p->differ = p->unseen = 0;
    return coarse;
}

static bool make_apart(Sweep *p) {
    const SltScene *s = p->run->s;
    double longest = 0;
    for (uint64_t i = 0; i < p->nleft; i++)
        for (uint32_t d = 0; d < s->dim; d++)
            longest = fmax(longest, (p->left[i].box.end[d] - p->left[i].box.lo[d]) / (s->hi[d] - s->lo[d]));
    double step = coincide_step(root_tolerance(run_is_coarse(p->run)) * longest / p->lines, s->f64 ? 0x1p-26 : 0x1p-14);
    return apart_new(s, p->run->j->seed, step, &p->apart) && twins_begin(p->run);
}

/* Cells are left as large as a tile where its evaluations ran out, and each gets as many lines: halves of those that
 * are larger than a cell is on average, of as many as can be paid for, until none is. False when memory runs out. */
static bool cut_large(Sweep *p, double cells) {
    uint32_t dim = p->run->s->dim;
    double left = 0;
    uint64_t n = 0, room = p->nleft;
    for (uint64_t i = 0; i < p->nleft; i++) left += sweep_measure(&p->left[i].box, dim);
    double lattice = fmax(p->segments / dim, p->samples) / p->volume;
    double most = fmax(left / fmax(cells, LEFT_LEAST), pow(2, dim) / lattice);
    for (uint64_t i = 0; i < p->nleft; i++) room += (uint64_t)(2 * sweep_measure(&p->left[i].box, dim) / most);
    if (room == p->nleft) return true;
    LeftCell *list = malloc(room * sizeof *list);
    if (!list) return false;
    for (uint64_t i = 0; i < p->nleft; i++) {
        uint64_t first = n;
        list[n++] = p->left[i];
        for (uint64_t at = first; at < n;) {
            Box *b = &list[at].box;
            uint32_t longest = 0;
            for (uint32_t d = 1; d < dim; d++)
                if (b->end[d] - b->lo[d] > b->end[longest] - b->lo[longest]) longest = d;
            double middle = 0.5 * (b->lo[longest] + b->end[longest]);
            if (!p->run->s->f64) middle = (float)middle;
            if (!(sweep_measure(b, dim) > most) || n == room || !(b->lo[longest] < middle && middle < b->hi[longest])) {
                at++;
                continue;
            }
            list[n] = list[at], list[n].box.lo[longest] = middle, n++;
            b->hi[longest] = b->end[longest] = middle;
        }
    }
    free(p->left);
    p->left = list, p->nleft = n, p->left_cap = room;
    return true;
}

/* In parts of the list, after each of which what its cells have cost tells how many of those that follow can be paid
 * for: of crossings in a cell there may be one or hundreds, and one that is tied costs as much as ten. The last parts
 * are small, so that little is spent beyond the budget. */
SltStatus sweep_work_off_left(Sweep *p, uint64_t start) {
    static const double upto[] = {0x1p-8, 0x1p-6, 0x1p-4, 0.25, 0.5, 0.75, 0.875, 0.9375, 0.96875, 1};
    enum { PARTS = sizeof upto / sizeof *upto };
    Run *r = p->run;
    uint64_t began = r->stats.evaluations, used = began - start, worked = 0;
    double cost = p->marches ? MARCH_COST : LEFT_COST, spare = p->budget > used ? (double)(p->budget - used) : 0;
    SltStatus st = SLT_OK;
    bool cuts = p->budget && !p->marches && r->s->dim == 2;
    if (cuts && !cut_large(p, spare / cost)) return status_fail(r->err, SLT_LIMIT, "out of memory");
    uint64_t chunks = (p->nleft + LEFT_CHUNK - 1) / LEFT_CHUNK;
    plan_lines(p, (double)used, spare);
    if (p->options.curves && !p->marches && !make_apart(p)) return status_fail(r->err, SLT_LIMIT, "out of memory");
    p->first_chunk = 0;
    p->hides = may_hide(p);
    double look = LEFT_HIDES * (double)used;
    if (r->j->max_evaluations) look = fmin(look, LEFT_LOOKS * spare);
    p->cuts = p->hides && left_hides(&p->worker[0], look);
    began = r->stats.evaluations;
    if (sweep_failed(p)) st = status_fail(r->err, SLT_LIMIT, "out of memory");
    for (uint32_t k = p->marches || !p->budget ? PARTS - 1 : 0; k < PARTS && st == SLT_OK; k++) {
        uint64_t to = k + 1 < PARTS ? (uint64_t)(upto[k] * (double)chunks) : chunks, from = p->first_chunk;
        used = r->stats.evaluations - start;
        if (to <= from) continue;
        plan_cells(p, from * LEFT_CHUNK, (double)used, p->budget > used ? (double)(p->budget - used) : 0, cost);
        st = run_tiles(r, to - from, left_work, left_merge, p);
        for (uint64_t i = from * LEFT_CHUNK; i < to * LEFT_CHUNK && i < p->nleft; i++) worked += p->left[i].stands > 0;
        if (worked) cost = fmax(1, (double)(r->stats.evaluations - began) / (double)worked);
        if (refine_lines(p)) cost *= 4, worked = 0, began = r->stats.evaluations;
        p->first_chunk = to;
    }
    apart_free(p->apart), p->apart = NULL;
    return st;
}

bool sweep_march_is_dear(Sweep *p, uint64_t used) {
    SweepWorker *v = &p->worker[0];
    LeftCell cell[LEFT_CHUNK];
    Box hull = p->left[0].box;
    uint32_t n = p->nleft < LEFT_CHUNK ? (uint32_t)p->nleft : LEFT_CHUNK;
    for (uint32_t i = 0; i < n; i++) {
        cell[i] = p->left[(2 * i + 1) * p->nleft / (2 * n)];
        for (uint32_t d = 0; d < p->run->s->dim; d++) {
            hull.lo[d] = fmin(hull.lo[d], cell[i].box.lo[d]);
            hull.end[d] = fmax(hull.end[d], cell[i].box.end[d]);
        }
    }
    SltStats before = p->run->stats;
    sweep_begin_tile(v, &hull);
    v->failed |= !left_curves(v, cell, n, true);
    run_collect(p->run, v->w);
    uint64_t evaluations = p->run->stats.evaluations;
    p->run->stats = before, p->run->stats.evaluations = evaluations; /* what was found is found again */
    return (double)used + (double)(evaluations - before.evaluations) / n * (double)p->nleft > p->only_if_cost;
}
