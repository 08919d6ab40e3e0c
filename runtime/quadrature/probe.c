/* Does quadrature pay? First a few hundred boxes tell, for which bounds alone must be compiled: nested ones around
 * points spread over the domain. Of each point the largest box on which bounds prove enough is about the cell that will
 * hold it, and the mean of 1 / volume over points is the number of cells. Where that looks well, a few small tiles are
 * cut into cells in earnest. No clock is asked, and nothing is remembered. */
#include <math.h>
#include <stdlib.h>

#include "runtime/quadrature/inner.h"
#include "runtime/sample/alloc.h"
#include "runtime/sample/prove.h"

enum {
    POINTS = 48,    /* places that are looked at */
    LEVELS = 5,     /* boxes around each; the sides go down by four */
    CELL_COST = 32, /* evaluations that a cell costs, points and ancestors included */
    CHANCE = 4,     /* so many of the places may lie beside edges by chance: the trial tells what those cost */
    TRIALS = 16,    /* tiles of the trial */
    FEW = 4,        /* where no more of them were too dear, thin things may lie there: */
    WIDER = 64      /* other tiles, of more evaluations */
};
static const uint64_t trial_budget[3] = {400, 400, 2000}; /* evaluations of each, by dimension */
#define UNPROVEN 0.1  /* quadrature does not pay where so large a part of the domain will be left over */
#define TRIAL_LEFT 0.05        /* nor where so much of the trial is left over, */
#define TRIAL_LEFT_WANTED 0.25 /* where an error is wanted, which the lattice will not reach */
#define DEARER 0.4        /* nor where cells cost more than this part of what the lattice does, */
#define WORTH 8.0 /* times these, where curves are straight lines of meshes: of them cells know all digits at once */
#define DEARER_IMAGE 10.0 /* for an image: its lattice is coarse */
#define THIN 0.1          /* but where so many of its curves are too near to each other for that */
#define DEARER_THIN 100.0
/* Steps that bear noise want more of them, not better ones. An evaluation of cells takes longer than one of lines. */
#define FRUGAL 0.5
#define FRUGAL_THIN 1.0
#define FRUGAL_TRIAL 0.1 /* what the trial itself may cost then, of what the lattice does */
#define WIDER_BUDGET 0.05   /* what these may cost, of what the lattice does, */
#define WIDER_DEAREST 0.005 /* and each of them */
#define IMAGE_CELLS 16.0  /* nor where an image has more cells a pixel than this */

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

/* What bounds say of each box, level by level. Loops of many iterations are asked about by threads, some boxes each: no
 * list tells yet which of them matter. */
enum { BOXES = LEVELS * POINTS, SHARE = 24, MANY = 1 << 12 };
typedef struct Asking {
    const SltScene *s;
    const Grid *grid;
    uint32_t share;                    /* boxes of a call */
    int32_t state[BOXES], open[BOXES]; /* level by level */
    double seen;                       /* what |f| is at least somewhere */
    SltStats stats;
    struct {
        Batch batch;
        double seen; /* of its last call */
    } *worker;
} Asking;

static bool ask(void *user, uint32_t worker, uint64_t share) {
    Asking *a = user;
    Batch *b = &a->worker[worker].batch;
    const uint32_t first = (uint32_t)share * a->share;
    if (!b->s && !batch_init_few(b, a->s, a->grid, a->share)) return false;
    for (uint32_t i = 0; i < a->share; i++) {
        double lo[3] = {0}, hi[3] = {0};
        box_at(b->s, (first + i) % POINTS, (first + i) / POINTS, lo, hi);
        batch_set_x(b, i, lo);
        for (uint32_t d = 0; d < b->s->dim; d++) batch_set(b, SLT_IN_H0 + d, i, hi[d]);
    }
    batch_call(b, SLT_K_BOUNDS, a->share);
    double seen = 0;
    for (uint32_t i = 0; i < a->share; i++) {
        for (uint32_t c = 0; c < b->s->channels; c++) {
            double least = batch_get(b, SLT_OUT_F_LO, c, i), most = batch_get(b, SLT_OUT_F_HI, c, i);
            if (least <= most) seen = fmax(seen, fmax(least, -most)); /* all of the box is that far from 0 */
        }
        a->state[first + i] = batch_get_int(b, SLT_OUT_BOX_STATE, 0, i), a->open[first + i] = batch_open(b, i);
    }
    a->worker[worker].seen = seen;
    return true;
}
static void take_seen(void *user, uint32_t worker, uint64_t share) {
    Asking *a = user;
    (void)share;
    a->seen = fmax(a->seen, a->worker[worker].seen);
    batch_collect(&a->worker[worker].batch, &a->stats);
}

/* False when memory runs out. */
static bool ask_all(Asking *a, const SltJob *j) {
    uint64_t iterations = 0;
    for (uint32_t i = 0; i < a->s->nlists; i++) iterations += a->s->list_count[i];
    a->share = iterations < MANY ? BOXES : SHARE;
    PoolOptions pool = {.threads = pool_threads(j->threads, BOXES / a->share)};
    a->worker = alloc_zero(pool.threads, sizeof *a->worker);
    bool ok = a->worker && pool_run(&pool, BOXES / a->share, ask, take_seen, a, NULL) == SLT_OK;
    for (uint32_t i = 0; i < pool.threads && a->worker; i++)
        if (a->worker[i].batch.s) batch_free(&a->worker[i].batch);
    free(a->worker);
    return ok;
}

Outlook quadrature_outlook(const SltScene *s, const SltJob *j, SltStats *stats) {
    Outlook o = {.unproven = 1, .side = 1};
    Grid g;
    SltError err;
    if (!s->kernel[SLT_K_BOUNDS] || s->uses_rand || grid_init(&g, s, j, &err) != SLT_OK) return o;
    Asking a = {.s = s, .grid = &g, .stats = SLT_STATS_INIT};
    o.no_memory = !ask_all(&a, j);
    if (!o.no_memory) {
        uint32_t unproven = 0, finest[LEVELS + 1] = {0}, level = 0, places = 0;
        o.seen = a.seen;
        for (uint32_t i = 0; i < POINTS; i++) {
            uint32_t l = 0;
            while (l < LEVELS && (a.state[l * POINTS + i] & SLT_BOX_UNKNOWN || a.open[l * POINTS + i] > SLT_MAX_OPEN))
                l++;
            if (l == LEVELS && a.state[(l - 1) * POINTS + i] & SLT_BOX_UNKNOWN) unproven++;
            finest[l]++;
        }
        for (uint32_t l = 0, rest = POINTS - CHANCE; l <= LEVELS; l++) {
            uint32_t surely = finest[l] < rest ? finest[l] : rest;
            double each = ldexp(1, 2 * (int)((l + 1) * s->dim)) / POINTS;
            o.cells += finest[l] * each, o.likely += surely * each, rest -= surely;
        }
        while ((places += finest[level]) <= POINTS / 2) level++;
        o.side = ldexp(1, -2 * (int)(level + 1));
        o.unproven = (double)unproven / POINTS;
        if (stats) stats->evaluations += a.stats.evaluations;
    }
    grid_free(&g);
    return o;
}

/* Of meshes bounds know the lines, and cells have curves. */
bool quadrature_marches(const SltScene *s, const SltJob *j) {
    return prove_only_shadows(s) && !scene_asks_meshes(s) && j->integral && s->dim == 2;
}

/* Does f hang on rays of which bounds make no curves? They settle much, but the lattice says more for the same
 * evaluations; for shadows of terrain alone march.c says more still. Of meshes there are no curves where f hangs on
 * what is met, and not on whether anything is; in f32 rounding leaves so much open between them that cells cost more
 * than they tell, unless an error is wanted. */
static bool has_no_curves(const SltScene *s, bool wanted) {
    for (uint32_t i = 0; i < s->nsites; i++) {
        uint8_t kind = s->site_kind[i];
        if (scene_is_of_mesh(s, (int32_t)i) && (kind < SLT_SITE_MESH_HIT || !(s->f64 || wanted))) return true;
        if ((kind == SLT_SITE_SILHOUETTE || kind == SLT_SITE_SHADOW) && !wanted) return true;
    }
    return false;
}

static bool wants_error(const SltJob *j) { return j->error > 0 || j->abs_error > 0; }

bool quadrature_hopes(const SltScene *s, const SltJob *j) {
    return quadrature_may(s) && (!has_no_curves(s, wants_error(j)) || quadrature_marches(s, j));
}

bool quadrature_likely(const SltScene *s, const SltJob *j, uint64_t events) {
    enum { EVENT_CELLS = 4 };
    return !j->integral || wants_error(j) ||
           (double)events * EVENT_CELLS * CELL_COST <= quadrature_lattice(s, j, true, !j->no_interior);
}

SltEstimator quadrature_choose(const SltScene *s, const SltJob *j, SltStats *stats) {
    if (!quadrature_hopes(s, j)) return SLT_EST_LATTICE;
    Outlook o = quadrature_outlook(s, j, stats);
    if (o.no_memory) return SLT_EST_QUADRATURE; /* which asks again, and has a status for it */
    /* What cells leave over tells more, when they are made. */
    if (quadrature_marches(s, j)) return o.unproven <= QUADRATURE_HOPELESS ? SLT_EST_QUADRATURE : SLT_EST_LATTICE;
    double lattice = quadrature_lattice(s, j, true, !j->no_interior), pixels = 1;
    for (uint32_t d = 0; d < s->dim; d++) pixels *= j->size[d];
    bool cheap = j->integral ? o.likely * CELL_COST <= lattice : o.cells <= IMAGE_CELLS * pixels;
    if (wants_error(j)) cheap = true; /* the lattice reaches no error that is asked for */
    return o.unproven <= UNPROVEN && cheap ? SLT_EST_QUADRATURE : SLT_EST_LATTICE;
}

/* What the sinks of a sweep would evaluate at the points, which the trial does not; and how many of those on curves lie
 * so near to another that the lattice would see neither. */
typedef struct Cost {
    uint64_t curve, volume, thin; /* points */
    double spacing[3];            /* of the lattice of an image; else 0 */
} Cost;

/* Are they neighbours on one line, nearer than the lattice's vertices? */
static bool is_thin(const Cost *cost, const Crossing *a, const Crossing *b) {
    bool near = a->axis == b->axis && a->cls == b->cls;
    for (int d = 0; d < 3; d++) near &= d == a->axis ? fabs(a->x[d] - b->x[d]) < cost->spacing[d] : a->x[d] == b->x[d];
    return near;
}

static void count_curve(void *user, Crossing *c, uint32_t n) {
    Cost *cost = user;
    cost->curve += n;
    for (uint32_t i = 1; i < n; i++) cost->thin += is_thin(cost, &c[i - 1], &c[i]);
}
static void count_volume(void *user, const CellPoint *p, uint32_t n, CellRule rule, const Box *within) {
    (void)p, (void)rule, (void)within, ((Cost *)user)->volume += n;
}
static void no_left(void *user, const Box *cell, const double *bounds, double apart) {
    (void)user, (void)cell, (void)bounds, (void)apart;
}

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

typedef struct Trial {
    const SltScene *s;
    const SltJob *j;
    const Grid *g;
    Cells *cells;
    Batch *b;
    double lattice; /* evaluations */
} Trial;

/* Tiles of a trial, and what each and all of them may cost. */
typedef struct Tiles {
    uint32_t first, n;
    uint64_t budget, most;
    double dearer, thin; /* than the lattice cells may be, so many times; where it would see neither of two curves */
} Tiles;

/* Cuts the tiles into cells. May all of the domain be cut? Told too: how many had not enough. */
static bool tiles_pay(const Trial *t, const Tiles *a, uint32_t *spent, bool *ok) {
    const SltJob *j = t->j;
    Cost cost = {0};
    CellSink sink = {.curve = count_curve, .volume = count_volume, .left = no_left, .user = &cost};
    CellOptions o = {
        .curves = true, .volume = true, .trial = true, .gauss = 3, .coarse = 2, .tolerance = 1e-4, .least = 1e-5};
    CellCounts counts = {0};
    for (uint32_t d = 0; d < t->s->dim; d++)
        if (!t->g->integral)
            cost.spacing[d] = 0.5 * t->g->side[d],
            o.grid[d] = t->g->filter == SLT_FILTER_BOX ? t->g->side[d] : 0.5 * t->g->side[d],
            o.grid_lo[d] = t->g->lo[d];
    o.budget = a->budget, o.fixed = !t->g->integral;
    uint64_t before = t->b->evaluations;
    *spent = 0;
    for (uint32_t k = a->first; k < a->first + a->n && *ok; k++) {
        Box tile = trial_tile(t->g, t->s->f64, k);
        counts.spent = false;
        *ok = cells_run(t->cells, &tile, &o, &sink, &counts);
        *spent += counts.spent;
        if (t->b->evaluations - before > a->most) return false;
    }
    double all = counts.settled + counts.curved + counts.left;
    double used =
        (double)(t->b->evaluations - before + cost.curve) + (double)cost.volume * (j->no_interior ? 1 : t->s->channels);
    /* What the lattice would not see is no matter of its price. */
    double dearer = cost.thin > THIN * (double)cost.curve ? a->thin : a->dearer;
    if (j->integral && scene_asks_meshes(t->s)) dearer *= WORTH;
    bool cheap = wants_error(j) || used / all <= dearer * t->lattice;
    return *ok && cheap && counts.left <= (wants_error(j) ? TRIAL_LEFT_WANTED : TRIAL_LEFT) * all;
}

SltEstimator quadrature_try(const SltScene *s, const SltJob *j, SltStats *stats) {
    if (quadrature_marches(s, j)) return SLT_EST_QUADRATURE;
    Batch b;
    Grid g;
    SltError err;
    if (grid_init(&g, s, j, &err) != SLT_OK) return SLT_EST_LATTICE;
    bool ok = batch_init(&b, s, &g), pays = false;
    Trial t = {s, j, &g, ok ? cells_new(&b, s->lo, s->hi) : NULL, &b, quadrature_lattice(s, j, true, !j->no_interior)};
    ok &= t.cells != NULL;
    uint32_t spent = 0;
    Tiles few = {0, TRIALS, trial_budget[g.dim - 1], UINT64_MAX, g.integral ? DEARER : DEARER_IMAGE, DEARER_THIN};
    Tiles wider = {TRIALS, WIDER, (uint64_t)(WIDER_DEAREST * t.lattice), (uint64_t)(WIDER_BUDGET * t.lattice), 1, 1};
    bool frugal = s->frugal && !g.integral && !wants_error(j) && j->interior != SLT_INTERIOR_QUADRATURE;
    if (frugal) few.most = (uint64_t)(FRUGAL_TRIAL * t.lattice), few.dearer = FRUGAL, few.thin = FRUGAL_THIN;
    if (ok) pays = tiles_pay(&t, &few, &spent, &ok);
    /* What the rest of a tile costs that had not enough is not known: it may be a hundred times as much. */
    if (frugal && spent) pays = false;
    /* Most were cheap: the rest may be thin things, to which lines are blind. Other tiles tell more, if there is more
     * to spend on each. In a volume what is left over has no bars as good as those of lines. */
    bool asks = g.integral && g.dim < 3 && spent <= FEW && wider.most > WIDER * few.budget;
    if (ok && !pays && asks) pays = tiles_pay(&t, &wider, &spent, &ok);
    SltStats own = SLT_STATS_INIT;
    if (ok) batch_collect(&b, &own);
    if (stats) stats->evaluations += own.evaluations;
    cells_free(t.cells), batch_free(&b), grid_free(&g);
    return pays ? SLT_EST_QUADRATURE : SLT_EST_LATTICE;
}
