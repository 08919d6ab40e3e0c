/* Does quadrature pay? First a few hundred boxes tell, for which bounds alone must be compiled: nested ones around
 * points spread over the domain. Of each point the largest box on which bounds prove enough is about the cell that will
 * hold it, and the mean of 1 / volume over points is the number of cells. Where that looks well, a few small tiles are
 * cut into cells in earnest. No clock is asked, and nothing is remembered. */
#include <math.h>

#include "runtime/quadrature/inner.h"
#include "runtime/sample/prove.h"

enum {
    POINTS = 48,    /* places that are looked at */
    LEVELS = 5,     /* boxes around each; the sides go down by four */
    CELL_COST = 32, /* evaluations that a cell costs, points and ancestors included */
    TRIALS = 16     /* tiles of the trial */
};
static const uint64_t trial_budget[3] = {400, 400, 2000}; /* evaluations of each, by dimension */
#define UNPROVEN 0.1  /* quadrature does not pay where so large a part of the domain will be left over */
#define TRIAL_LEFT 0.05        /* nor where so much of the trial is left over, */
#define TRIAL_LEFT_WANTED 0.25 /* where an error is wanted, which the lattice will not reach */
#define DEARER 0.4        /* nor where cells cost more than this part of what the lattice does, */
#define DEARER_IMAGE 10.0 /* for an image: its lattice is coarse */
#define IMAGE_CELLS 16.0 /* nor where an image has more cells a pixel than this */

/* The box of a level around a place. */
static void box_at(const SltScene *s, uint32_t point, uint32_t level, double lo[3], double hi[3]) {
    static const uint32_t shift[3] = {0x3243f6a8, 0x885a308d, 0x313198a2}; /* digits of pi: no special places */
    double side = ldexp(1, -2 * (int)(level + 1));
    for (uint32_t d = 0; d < s->dim; d++) {
        double u = rng_recurrence(s->dim, d, point, shift[d]), from = fmin(fmax(u - 0.5 * side, 0), 1 - side);
        lo[d] = s->lo[d] + from * (s->hi[d] - s->lo[d]), hi[d] = lo[d] + side * (s->hi[d] - s->lo[d]);
        if (!s->f64) lo[d] = (double)(float)lo[d], hi[d] = fmax(lo[d], (double)(float)hi[d]);
    }
}

static void ask(Batch *b, int32_t state[LEVELS][POINTS], int32_t open[LEVELS][POINTS]) {
    for (uint32_t l = 0; l < LEVELS; l++)
        for (uint32_t i = 0; i < POINTS; i++) {
            double lo[3] = {0}, hi[3] = {0};
            box_at(b->s, i, l, lo, hi);
            batch_set_x(b, l * POINTS + i, lo);
            for (uint32_t d = 0; d < b->s->dim; d++) batch_set(b, SLT_IN_H0 + d, l * POINTS + i, hi[d]);
        }
    batch_call(b, SLT_K_BOUNDS, LEVELS * POINTS);
    for (uint32_t l = 0; l < LEVELS; l++)
        for (uint32_t i = 0; i < POINTS; i++) {
            state[l][i] = batch_get_int(b, SLT_OUT_BOX_STATE, 0, l * POINTS + i);
            open[l][i] = batch_has(b, SLT_OUT_OPEN) ? batch_get_int(b, SLT_OUT_OPEN, 0, l * POINTS + i) : 0;
        }
}

Outlook quadrature_outlook(const SltScene *s, const SltJob *j, SltStats *stats) {
    Outlook o = {.unproven = 1, .side = 1};
    Batch b;
    Grid g;
    SltError err;
    int32_t state[LEVELS][POINTS], open[LEVELS][POINTS];
    if (!s->kernel[SLT_K_BOUNDS] || s->uses_rand || grid_init(&g, s, j, &err) != SLT_OK) return o;
    bool ok = batch_init(&b, s, &g);
    if (ok) {
        uint32_t unproven = 0, finest[LEVELS + 1] = {0}, level = 0, places = 0;
        ask(&b, state, open);
        for (uint32_t i = 0; i < POINTS; i++) {
            uint32_t l = 0;
            while (l < LEVELS && (state[l][i] & SLT_BOX_UNKNOWN || open[l][i] > SLT_MAX_OPEN)) l++;
            if (l == LEVELS && state[l - 1][i] & SLT_BOX_UNKNOWN) unproven++;
            o.cells += ldexp(1, 2 * (int)((l + 1) * s->dim)) / POINTS;
            finest[l]++;
        }
        while ((places += finest[level]) <= POINTS / 2) level++;
        o.side = ldexp(1, -2 * (int)(level + 1));
        o.unproven = (double)unproven / POINTS;
        SltStats own = SLT_STATS_INIT;
        batch_collect(&b, &own);
        if (stats) stats->evaluations += own.evaluations;
    }
    batch_free(&b), grid_free(&g);
    return o;
}

bool quadrature_marches(const SltScene *s, const SltJob *j) {
    return prove_only_shadows(s) && j->integral && s->dim == 2;
}

/* Does f hang on rays? Bounds of these settle much and make no curves: the lattice says more for the same evaluations,
 * but for shadows alone march.c says more still. */
static bool asks_rays(const SltScene *s) {
    for (uint32_t i = 0; i < s->nsites; i++)
        if (s->site_kind[i] == SLT_SITE_SILHOUETTE || s->site_kind[i] == SLT_SITE_SHADOW) return true;
    return false;
}

static bool wants_error(const SltJob *j) { return j->error > 0 || j->abs_error > 0; }

bool quadrature_hopes(const SltScene *s, const SltJob *j) {
    return quadrature_may(s) && (wants_error(j) || !asks_rays(s) || quadrature_marches(s, j));
}

SltEstimator quadrature_choose(const SltScene *s, const SltJob *j, SltStats *stats) {
    if (!quadrature_hopes(s, j)) return SLT_EST_LATTICE;
    Outlook o = quadrature_outlook(s, j, stats);
    /* What cells leave over tells more, when they are made. */
    if (quadrature_marches(s, j)) return o.unproven <= QUADRATURE_HOPELESS ? SLT_EST_QUADRATURE : SLT_EST_LATTICE;
    double lattice = quadrature_lattice(s, j, true, !j->no_interior), pixels = 1;
    for (uint32_t d = 0; d < s->dim; d++) pixels *= j->size[d];
    bool cheap = j->integral ? o.cells * CELL_COST <= lattice : o.cells <= IMAGE_CELLS * pixels;
    if (wants_error(j)) cheap = true; /* the lattice reaches no error that is asked for */
    return o.unproven <= UNPROVEN && cheap ? SLT_EST_QUADRATURE : SLT_EST_LATTICE;
}

/* What the sinks of a sweep would evaluate at the points, which the trial does not. */
typedef struct Cost {
    uint64_t curve, volume; /* points */
} Cost;
static void count_curve(void *user, Crossing *c, uint32_t n) { (void)c, ((Cost *)user)->curve += n; }
static void count_volume(void *user, const CellPoint *p, uint32_t n, CellRule rule, const Box *within) {
    (void)p, (void)rule, (void)within, ((Cost *)user)->volume += n;
}
static void no_left(void *user, const Box *cell, const double *bounds) { (void)user, (void)cell, (void)bounds; }

/* The tile of a trial, so wide that its own cost does not matter beside that of all such tiles; or four pixels. */
static Box trial_tile(const Grid *g, bool f64, uint32_t k) {
    static const uint32_t shift[3] = {0x299f31d0, 0x082efa98, 0xec4e6c89};
    static const double wide[3] = {1.0 / 64, 1.0 / 64, 1.0 / 16};
    Box t = {.lo = {0}};
    for (uint32_t d = 0; d < g->dim; d++) {
        double side = fmin(1, fmax(wide[g->dim - 1], g->integral ? 0 : 4.0 / g->n[d]));
        double at = rng_recurrence(g->dim, d, k, shift[d]) * (1 - side), width = g->hi[d] - g->lo[d];
        t.lo[d] = g->lo[d] + at * width, t.end[d] = g->lo[d] + (at + side) * width;
        if (!f64) t.lo[d] = (double)(float)t.lo[d], t.end[d] = (double)(float)t.end[d];
        t.hi[d] = t.end[d];
    }
    return t;
}

SltEstimator quadrature_try(const SltScene *s, const SltJob *j, SltStats *stats) {
    if (quadrature_marches(s, j)) return SLT_EST_QUADRATURE;
    Cost cost = {0};
    CellSink sink = {.curve = count_curve, .volume = count_volume, .left = no_left, .user = &cost};
    CellOptions o = {.curves = true, .volume = true, .gauss = 3, .coarse = 2, .tolerance = 1e-4, .least = 1e-5};
    Batch b;
    Grid g;
    SltError err;
    CellCounts counts = {0};
    if (grid_init(&g, s, j, &err) != SLT_OK) return SLT_EST_LATTICE;
    for (uint32_t d = 0; d < s->dim; d++)
        if (!g.integral) o.grid[d] = g.filter == SLT_FILTER_BOX ? g.side[d] : 0.5 * g.side[d], o.grid_lo[d] = g.lo[d];
    bool ok = batch_init(&b, s, &g);
    Cells *cells = ok ? cells_new(&b, s->lo, s->hi) : NULL;
    ok &= cells != NULL;
    o.budget = trial_budget[g.dim - 1], o.fixed = !g.integral;
    for (uint32_t k = 0; k < TRIALS && ok; k++) {
        Box tile = trial_tile(&g, s->f64, k);
        counts.spent = false;
        ok = cells_run(cells, &tile, &o, &sink, &counts);
    }
    SltStats own = SLT_STATS_INIT;
    if (ok) batch_collect(&b, &own);
    if (stats) stats->evaluations += own.evaluations;
    cells_free(cells), batch_free(&b), grid_free(&g);
    double done = counts.settled + counts.curved, all = done + counts.left;
    double spent = (double)(own.evaluations + cost.curve) + (double)cost.volume * (j->no_interior ? 1 : s->channels);
    double lattice = quadrature_lattice(s, j, true, !j->no_interior);
    bool cheap = wants_error(j) || spent / all <= (j->integral ? DEARER : DEARER_IMAGE) * lattice;
    return ok && cheap && counts.left <= (wants_error(j) ? TRIAL_LEFT_WANTED : TRIAL_LEFT) * all ? SLT_EST_QUADRATURE
                                                                                                 : SLT_EST_LATTICE;
}
