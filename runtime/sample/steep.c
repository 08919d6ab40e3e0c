/* Lines through the domain, the changes of f on them, and which of these halving does not make smaller. What they
 * weigh: steep_weigh.c. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/prove.h"
#include "runtime/sample/steep_inner.h"

enum {
    SHARE = 48, /* of the evaluations spent, one for a point of a line */
    FEWEST = 192,
    AGAIN = 4096, /* of the second look, where the first found something */
    MOST = 4096,
    ON_LINE = 16, /* points of a line, at least */
    HALVINGS = 8, /* after which a change must not have become smaller */
    FINER = 44,   /* and then, as long as it stays together */
    FLOATS = 64,  /* wide at most is a jump */
    DEARER = 8    /* f is when it is interpreted, by more than that: so many fewer lines */
};
#define TOGETHER 0.4  /* part of a change that is left after all halvings, at least, */
#define STAYS 0.75    /* or after one, where its width is sought */
#define VISIBLE 1e-3  /* a change of less, of the largest |f| on the lines, is not looked at */
#define STEP 0x1p-9   /* by which the parameters move, of max(0.1, |p|) */
#define MOVED 0.25    /* part of a change that must come or go at an end where it moves with them */

static double domain_size(const SltScene *s, uint32_t axis) { return s->hi[axis] - s->lo[axis]; }

double steep_round(const SteepProbe *p, double x) { return p->s->f64 ? x : (double)(float)x; }

void steep_evaluate(SteepProbe *p, uint32_t n) {
    batch_call(&p->batch, p->s->kernel[SLT_K_SIDES] ? SLT_K_SIDES : SLT_K_VALUE, n);
}

double steep_f(const SteepProbe *p, uint32_t channel, uint32_t i) {
    return batch_get(&p->batch, SLT_OUT_F, channel, i);
}

static uint32_t hash_at(const SteepProbe *p, uint32_t i) {
    return batch_has(&p->batch, SLT_OUT_HASH) ? ((const uint32_t *)batch_out(&p->batch, SLT_OUT_HASH, 0))[i] : 0;
}

void steep_put(SteepProbe *p, uint32_t i, const SteepStep *t, double at) {
    double x[4];
    memcpy(x, t->x, sizeof x);
    x[t->axis] = at;
    batch_set_x(&p->batch, i, x);
    batch_set_stream(&p->batch, i, t->stream, x[STEEP_RAND]);
}

/* ---- the lines */
static double golden(uint32_t k, double from) { return fmod(from + 0.61803398874989485 * k, 1); }

/* Point i of line `line` of an axis: lines by the R2 sequence over its cross-section, each with a phase of its own. */
void steep_place(const SteepProbe *p, uint32_t axis, uint32_t line, uint32_t i, double x[3]) {
    for (uint32_t d = 0, across = 0; d < 3; d++) {
        double t = 0;
        if (d >= p->s->dim) {
            x[d] = 0;
            continue;
        }
        if (d == axis) t = (i + 0.1 + 0.8 * golden(line, 0.37)) / p->points;
        else if (p->s->dim == 2 && axis != STEEP_RAND) t = (line + 0.25 + 0.5 * golden(line, 0.61)) / p->lines;
        else t = fmod(0.5 + (line + 1) * (across++ ? 0.56984029099805327 : 0.75487766624669276), 1);
        x[d] = steep_round(p, p->s->lo[d] + t * domain_size(p->s, d));
    }
}

/* The same with the random number, which only its own lines vary. */
static void place_with_rand(const SteepProbe *p, uint32_t axis, uint32_t line, uint32_t i, double x[4]) {
    steep_place(p, axis, line, i, x);
    x[STEEP_RAND] = axis == STEEP_RAND ? steep_round(p, (i + 0.1 + 0.8 * golden(line, 0.37)) / p->points) : 0.5;
}

static int by_excess(const void *a, const void *b) {
    const SteepStep *x = a, *y = b;
    return x->excess > y->excess ? -1 : x->excess < y->excess;
}

/* Keeps the changes that exceed those beside them by most. */
static void keep_best(SteepProbe *p) {
    if (p->n <= p->room) return;
    qsort(p->step, p->n, sizeof *p->step, by_excess);
    p->n = p->room;
}

static void look_at_line(SteepProbe *p, uint32_t axis, uint32_t line, uint32_t first) {
    for (uint32_t c = 0; c < p->s->channels; c++) {
        double before = 0, f = steep_f(p, c, first);
        for (uint32_t i = 0; i + 1 < p->points; i++) {
            double next = steep_f(p, c, first + i + 1), change = fabs(next - f), after = 0;
            bool same = hash_at(p, first + i) == hash_at(p, first + i + 1) && isfinite(change);
            if (isfinite(next)) {
                p->largest = fmax(p->largest, fabs(next));
                p->seen[c][0] = fmin(p->seen[c][0], next), p->seen[c][1] = fmax(p->seen[c][1], next);
            }
            if (i + 2 < p->points && hash_at(p, first + i + 1) == hash_at(p, first + i + 2))
                after = fabs(steep_f(p, c, first + i + 2) - next);
            double least = isfinite(after) ? fmin(before, after) : before;
            if (same && change > least) {
                SteepStep *t = &p->step[p->n++];
                *t = (SteepStep){.axis = axis,
                                 .point = i,
                                 .channel = c,
                                 .stream = (int32_t)line,
                                 .number = p->number,
                                 .excess = change - least};
                double end[4];
                place_with_rand(p, axis, line, i, t->x), place_with_rand(p, axis, line, i + 1, end);
                t->a = t->x[axis], t->b = end[axis], t->fa = f, t->fb = next, t->first = change;
                t->hash = hash_at(p, first + i);
            }
            before = same ? change : 0, f = next;
        }
    }
}

/* The lines of one axis, as many at once as a call takes. */
static void look_along(SteepProbe *p, uint32_t axis) {
    uint32_t at_once = BATCH / p->points;
    for (uint32_t from = 0; from < p->lines; from += at_once) {
        uint32_t n = p->lines - from < at_once ? p->lines - from : at_once;
        for (uint32_t k = 0; k < n; k++)
            for (uint32_t i = 0; i < p->points; i++) {
                double x[4];
                place_with_rand(p, axis, from + k, i, x);
                batch_set_x(&p->batch, k * p->points + i, x);
                batch_set_stream(&p->batch, k * p->points + i, (int32_t)(from + k), x[STEEP_RAND]);
            }
        steep_evaluate(p, n * p->points);
        for (uint32_t k = 0; k < n; k++) look_at_line(p, axis, from + k, k * p->points);
        keep_best(p);
    }
}

/* ---- halving */
/* One halving of every change; those that fall below `part` of what they were, or come apart, are dropped, or, with
 * `stay`, left as they were. */
static bool halve(SteepProbe *p, double part, bool stay) {
    uint32_t kept = 0, asked = 0;
    for (uint32_t i = 0; i < p->n; i++) {
        SteepStep *t = &p->step[i];
        double middle = steep_round(p, 0.5 * (t->a + t->b));
        t->asked = !t->done && middle != t->a && middle != t->b;
        if (t->asked) steep_put(p, asked++, t, middle);
        else t->jump |= !t->done;
    }
    steep_evaluate(p, asked);
    for (uint32_t i = 0, k = 0; i < p->n; i++) {
        SteepStep t = p->step[i];
        if (t.asked) {
            double middle = steep_round(p, 0.5 * (t.a + t.b)), f = steep_f(p, t.channel, k);
            bool same = hash_at(p, k++) == t.hash && isfinite(f), near = fabs(f - t.fa) > fabs(t.fb - f);
            double change = near ? fabs(f - t.fa) : fabs(t.fb - f);
            bool pole = stay && !isfinite(f); /* between two numbers: 0 / 0, a pole */
            bool together = same && change >= part * (stay ? fabs(t.fb - t.fa) : t.first);
            if (!together && !stay) continue;
            if (together && near) t.b = middle, t.fb = f;
            else if (together) t.a = middle, t.fa = f;
            t.done = !together, t.jump |= pole;
        }
        p->step[kept++] = t;
    }
    p->n = kept;
    return asked > 0;
}

/* ---- do they move? */
static bool any_active(const SltScene *s) {
    for (uint32_t q = 0; q < s->nfloats; q++)
        if (!s->active || s->active[q]) return true;
    return false;
}

double steep_move_of(const SltScene *s, uint32_t q) {
    double v = s->f64 ? ((const double *)s->params)[q] : (double)((const float *)s->params)[q];
    return STEP * fmax(0.1, fabs(v));
}

void steep_moved(SteepProbe *p, const SltScene *moved, uint32_t from, uint32_t n, bool *hit) {
    p->batch.args.params = moved->params, p->batch.args.geometries = moved->geometries;
    for (uint32_t i = 0; i < n; i++) {
        const SteepStep *t = &p->step[from + i];
        steep_put(p, 2 * i, t, t->a), steep_put(p, 2 * i + 1, t, t->b);
    }
    steep_evaluate(p, 2 * n);
    for (uint32_t i = 0; i < n; i++) {
        const SteepStep *t = &p->step[from + i];
        double a = steep_f(p, t->channel, 2 * i), b = steep_f(p, t->channel, 2 * i + 1), all = fabs(t->fb - t->fa);
        hit[i] |= !(fmax(fabs(a - t->fa), fabs(b - t->fb)) < MOVED * all); /* what is not a number has moved too */
    }
    p->batch.args.params = p->s->params, p->batch.args.geometries = p->s->geometries;
}

/* Drops what stays where it is: the grain of a texture, a pattern. */
static bool drop_static(SteepProbe *p) {
    bool hit[STEEP_STEPS] = {false}, memory = true;
    double *dir = alloc_zero(p->s->nfloats, sizeof *dir);
    for (uint32_t side = 0; dir && side < 4 && memory; side++) { /* forth and back, along two directions */
        Moved m;
        for (uint32_t q = 0; q < p->s->nfloats; q++) {
            uint32_t u[4];
            if (p->s->active && !p->s->active[q]) continue;
            rng_block(0, RNG_COINCIDE, side / 2, q, u);
            dir[q] = steep_move_of(p->s, q) * (u[1] & 1 ? 1 : -1) * (0.5 + 0.5 * rng_unit(u[0]));
        }
        memory = scene_move(&m, p->s, dir, 0, side & 1 ? -1 : 1);
        if (memory) steep_moved(p, &m.scene, 0, p->n, hit);
        moved_free(&m);
    }
    uint32_t kept = 0;
    for (uint32_t i = 0; i < p->n; i++)
        if (hit[i]) p->step[kept++] = p->step[i];
    p->n = kept;
    free(dir);
    return dir && memory;
}

/* ---- the whole */
static int by_change(const void *a, const void *b) {
    const SteepStep *x = a, *y = b;
    double u = fabs(x->fb - x->fa), v = fabs(y->fb - y->fa);
    return u > v ? -1 : u < v;
}

static void place_of(const SteepStep *t, SteepPlace *o) {
    memcpy(o->a, t->x, sizeof o->a), memcpy(o->b, t->x, sizeof o->b);
    o->rand[0] = o->rand[1] = t->x[STEEP_RAND], o->number = t->number;
    if (t->axis == STEEP_RAND) o->rand[0] = t->a, o->rand[1] = t->b;
    else o->a[t->axis] = t->a, o->b[t->axis] = t->b;
    o->change = t->fb - t->fa, o->stream = t->stream, o->jump = t->jump;
}

static void drop_known(SteepProbe *p, const Steep *steep) {
    uint32_t kept = 0;
    for (uint32_t i = 0; steep->known && i < p->n; i++) {
        SteepPlace at;
        place_of(&p->step[i], &at);
        if (!steep->known(steep->user, &at)) p->step[kept++] = p->step[i];
    }
    if (steep->known) p->n = kept;
}

/* A few floats wide: there is no slope to be had. */
static bool is_narrow(const SteepProbe *p, const SteepStep *t) {
    double unit = p->s->f64 ? DBL_EPSILON : (double)FLT_EPSILON;
    if (t->axis == STEEP_RAND) return true; /* nothing weighs its slope */
    return t->b - t->a < FLOATS * unit * fmax(fabs(p->s->lo[t->axis]), fabs(p->s->hi[t->axis]));
}

/* Along the axes first to end - 1. */
static bool find_along(SteepProbe *p, const Steep *steep, uint32_t first, uint32_t end) {
    for (uint32_t d = first; d < end; d++) look_along(p, d);
    uint32_t kept = 0;
    for (uint32_t i = 0; i < p->n; i++)
        if (p->step[i].first > VISIBLE * p->largest) p->step[kept++] = p->step[i];
    p->n = kept;
    for (uint32_t k = 0; k < HALVINGS && halve(p, TOGETHER, false);) k++;
    qsort(p->step, p->n, sizeof *p->step, by_change);
    p->found = p->n;
    if (p->n > STEEP_STEPS) p->n = STEEP_STEPS;
    for (uint32_t k = 0; k < FINER && halve(p, STAYS, true);) k++;
    for (uint32_t i = 0; i < p->n; i++) p->step[i].jump |= !p->step[i].done || is_narrow(p, &p->step[i]);
    uint32_t before = p->n;
    bool memory = !p->n || drop_static(p);
    drop_known(p, steep);
    p->found = before ? p->found * p->n / before : 0;
    return memory;
}

/* What jumps with a random number alone is seen on no line through the domain. Kernels make all but the first from
 * the number of the sample: the others only the caller can vary. */
static bool find(SteepProbe *p, Steep *steep) {
    bool memory = find_along(p, steep, 0, p->s->dim);
    if (memory && !p->n && p->s->uses_rand) memory = find_along(p, steep, STEEP_RAND, STEEP_RAND + 1);
    uint32_t lines = p->lines;
    p->lines = p->lines > DEARER ? p->lines / DEARER : 1;
    for (uint32_t k = 1; k < 32 && memory && !p->n && steep->call; k++) {
        if (!(steep->numbers >> k & 1)) continue;
        p->quiet.call = steep->call, p->quiet.call_user = steep, p->number = steep->number = k;
        memory = find_along(p, steep, STEEP_RAND, STEEP_RAND + 1);
    }
    p->found *= p->n && p->number ? lines / p->lines : 1;
    p->lines = lines;
    return memory;
}

static bool probe_init(SteepProbe *p, const SltScene *s, const Grid *g, double n) {
    n /= s->dim;
    p->points = s->dim == 1 ? (uint32_t)fmin(n, BATCH) : (uint32_t)fmax(sqrt(n), ON_LINE);
    p->lines = s->dim == 1 ? 1 : (uint32_t)fmax(n / p->points, 1);
    p->room = p->lines * p->points * s->dim / 16 + 8;
    if (p->room > BATCH) p->room = BATCH;
    for (uint32_t c = 0; c < SLT_MAX_CHANNELS; c++) p->seen[c][0] = HUGE_VAL, p->seen[c][1] = -HUGE_VAL;
    p->quiet = *s, p->quiet.print = NULL, p->s = &p->quiet;
    /* Kernels may not read all that is varied, and what none reads shares one place. */
    for (uint32_t d = 0; d < 3; d++) p->quiet.layout[SLT_K_VALUE].reads |= (uint64_t)1 << (SLT_IN_X0 + d);
    p->quiet.layout[SLT_K_VALUE].reads |= (uint64_t)1 << SLT_IN_STREAM | (uint64_t)1 << SLT_IN_RAND0;
    /* What look_along adds before the best are kept. */
    p->step = alloc_sparse(p->room + (size_t)BATCH * s->channels, sizeof *p->step);
    bool ok = p->step && batch_init(&p->batch, p->s, g);
    p->batch.again = true; /* what they count has been counted by the estimate */
    return ok;
}

static void probe_free(SteepProbe *p, Run *r) {
    batch_collect(&p->batch, &r->stats);
    batch_free(&p->batch);
    free(p->step);
    *p = (SteepProbe){0};
}

static bool look(SteepProbe *p, const SltScene *s, Run *r, double n, Steep *steep) {
    return probe_init(p, s, &r->grid, n) && find(p, steep);
}

static void report(const SteepProbe *p, Steep *steep) {
    for (uint32_t i = 0; i < p->n; i++) {
        const SteepStep *t = &p->step[i];
        if (t->seen) continue;
        if (steep->n == STEEP_PLACES) break;
        place_of(t, &steep->place[steep->n++]);
    }
    steep->share = steep->n ? fmin(1, (double)p->found / ((double)p->lines * p->points * p->s->dim)) : 0;
}

/* Where the lines found nothing. */
static bool look_for_peak(SteepProbe *p, SltIntegral *out, Steep *steep) {
    SteepPeak peak;
    bool seen = false;
    if (!steep_find_peak(p, &peak)) return true;
    if (out && !steep_weigh_peak(p, &peak, out, &seen)) return false;
    if (seen) return true;
    SteepPlace *o = &steep->place[steep->n++];
    *o = (SteepPlace){.change = peak.over, .peak = true, .rand = {0.5, 0.5}};
    memcpy(o->a, peak.x, sizeof o->a), memcpy(o->b, peak.x, sizeof o->b);
    for (uint32_t d = 0; d < p->s->dim; d++) o->b[d] = steep_round(p, fmin(p->s->hi[d], 2 * peak.hi[d] - peak.lo[d]));
    steep->share = 1.0 / ((double)p->lines * p->points * p->s->dim);
    return true;
}

SltStatus slt_estimate_steep(const SltScene *s, const SltJob *j, SltIntegral *out, uint64_t spent, Steep *steep,
                             SltStats *stats, SltError *err) {
    if ((s->nedges && s->flat && !s->uses_rand) || !s->kernel[SLT_K_VALUE] || !any_active(s)) return SLT_OK;
    /* Between two ridges f jumps though a ray meets ground at both ends: a line cannot tell that from arithmetic. */
    if ((s->ngeometries && !prove_only_shadows(s)) || scene_outputs(s, SLT_K_REGION, SLT_OUT_DEPTH) > 0) return SLT_OK;
    if (s->nsites && !s->kernel[SLT_K_SIDES]) return SLT_OK;
    Run r;
    SteepProbe p = {0};
    SltStatus st = run_begin(&r, s, j, err);
    if (st == SLT_OK) {
        double n = fmin(fmax((double)spent / SHARE, FEWEST), MOST);
        bool memory = look(&p, s, &r, n, steep);
        if (memory && p.n && n < AGAIN) { /* few lines do not tell what it weighs */
            probe_free(&p, &r);
            memory = look(&p, s, &r, AGAIN, steep);
        }
        if (memory && p.n) memory = steep_weigh(&p, &r, out);
        if (memory) report(&p, steep);
        if (memory && !steep->n) memory = look_for_peak(&p, out, steep);
        if (!memory) st = status_fail(err, SLT_LIMIT, "out of memory");
        probe_free(&p, &r);
    }
    double seconds = stats ? stats->seconds : 0;
    if (stats) stats->evaluations += r.stats.evaluations, stats->seconds = seconds + pool_now() - r.start;
    run_end(&r, NULL);
    return st;
}
