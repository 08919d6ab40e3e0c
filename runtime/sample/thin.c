/* What lines do not see, from what they see by chance: thin.h. */
#include <math.h>
#include <stdlib.h>

#include "runtime/sample/depth.h"
#include "runtime/sample/thin.h"

#define MOST 0x1p15 /* that one run stands for: roots are not known better than that */
enum {
    SHIFTS = 16,
    LOOKS = 4, /* places between a run's vertex and each of its ends */
    RUNS = BATCH / (2 * LOOKS),
    FEW = 16 /* of a tile */
};

/* May the near-miss probe see a run? */
typedef enum Probe {
    PROBE_BLIND, /* no */
    PROBE_SURE,  /* the line ends near by, where it has gradients to ask */
    PROBE_TRY    /* perhaps: all it looks at is known */
} Probe;
/* Between unlike neighbours, as when an edge that shows nowhere lies beside every vertex (cells of `frac`): whether f
 * is the same on both sides tells whether it is a run, the probe is not tried, and every other vertex is looked at, as
 * an edge belongs to one run. */
enum { UNLIKE = PROBE_TRY + 1, PROBES };
/* Segment.thin from THIN_FIRST on: the run's vertex, the axis, the probe, and whether the edge lies behind the vertex.
 */
enum { THIN_FIRST = 2, AXES = 3 };
#define SHORTER 0.75
#define SAME 0.125 /* of the jump: by what f may change between the two sides of a run */

static bool alike(const Worker *w, const Line *l, uint64_t a, uint64_t b) {
    return w->hash[a] == w->hash[b] && !(w->depth && depth_differs(w->depth[a], w->depth[b], l->threshold));
}

static uint64_t vertex(const Line *l, uint32_t v) { return l->first + v * l->stride; }

static Probe probe_of(const Worker *w, const Line *l, uint32_t v) {
    if (!w->near_key) return PROBE_BLIND;
    uint64_t a = vertex(l, v - 1), b = vertex(l, v + 1);
    if (w->near_event[a] < 0 || w->near_key[a] != w->near_key[b]) return PROBE_BLIND;
    if (v < 2 || v + 2 >= l->n) return PROBE_SURE;
    uint64_t before = vertex(l, v - 2), after = vertex(l, v + 2);
    return w->near_key[before] == w->near_key[a] && w->near_key[after] == w->near_key[a] ? PROBE_TRY : PROBE_BLIND;
}

/* Is there anything by which to tell them apart? Faces may be of one surface: there is no crossing between them then.
 */
static bool apart(const Worker *w, const Line *l, uint64_t a, uint64_t b) {
    return !alike(w, l, a, b) || worker_faces_differ(w, a, b);
}

/* Surfaces of a mesh are told apart by faces alone: a face before another one. Not where the ends see different faces,
 * which may be of one surface: may_be_run. */
static bool is_run(const Worker *w, const Line *l, uint32_t v) {
    if (v == 0 || v + 1 >= l->n) return false;
    uint64_t a = vertex(l, v - 1), at = vertex(l, v), b = vertex(l, v + 1);
    return alike(w, l, a, b) &&
           (!alike(w, l, at, b) || (!worker_faces_differ(w, a, b) && worker_faces_differ(w, at, b)));
}

/* Of neighbours that are runs of each other every second counts. */
static bool counts(const Worker *w, const Line *l, uint32_t v) {
    uint32_t row = 0;
    while (row <= v && is_run(w, l, v - row)) row++;
    return row & 1;
}

static bool may_be_run(const Worker *w, const Line *l, uint32_t v) {
    return !w->depth && v & 1 && v + 1 < l->n && !is_run(w, l, v - 1) && !is_run(w, l, v + 1) &&
           apart(w, l, vertex(l, v - 1), vertex(l, v)) && apart(w, l, vertex(l, v), vertex(l, v + 1));
}

uint32_t thin_edge(const Worker *w, const Line *l, uint32_t v, uint32_t axis) {
    for (uint32_t end = 0; end < 2; end++) {
        bool run = counts(w, l, v + end);
        if (!run && !may_be_run(w, l, v + end)) continue;
        uint32_t probe = run ? probe_of(w, l, v + end) : UNLIKE;
        return THIN_FIRST + 2 * (uint32_t)(((l->runs + vertex(l, v + end)) * AXES + axis) * PROBES + probe) +
               (end ? 0 : 1);
    }
    return 0;
}

bool differs_beside(const Worker *w, const Line *l, uint32_t v) {
    return (v > 0 && !alike(w, l, vertex(l, v - 1), vertex(l, v))) ||
           (v + 2 < l->n && !alike(w, l, vertex(l, v + 1), vertex(l, v + 2)));
}

/* The parabola through (0, 0), (x, g) and (x2, g2), at t. */
static double parabola(double t, double x, double g, double x2, double g2) {
    double slope = g / x, bend = (g2 / x2 - slope) / (x2 - x);
    return t * (slope + bend * (t - x));
}

/* Does |g| go on between a run and the vertex beside it as between that and the next one? A slope that doubles or
 * halves is no parabola, but something that the spacing does not resolve. */
static bool resolved(double x, double g, double h, double g2) {
    double inner = g / x, outer = (g2 - g) / h;
    return outer < 2 * inner && inner < 2 * outer;
}

/* How often the probe finds a run that no vertex meets. The run goes from 0 to `length`, with |g| on both sides as on
 * the vertices beside it: those before it at -before and so on. */
static double finds(const Worker *w, uint64_t run, uint64_t stride, double before, double length, double after,
                    double h) {
    const float *g = w->near_g;
    double g1 = (double)g[run - stride], g2 = (double)g[run - 2 * stride], found = 0;
    double g3 = (double)g[run + stride], g4 = (double)g[run + 2 * stride];
    if (!resolved(before, g1, h, g2) || !resolved(after, g3, h, g4)) return 0;
    for (int k = 0; k < SHIFTS; k++) {
        double right = length + (h - length) * (k + 0.5) / SHIFTS, left = right - h;
        double pos[4] = {left - h, left, right, right + h}, at[4];
        for (int i = 0; i < 2; i++) {
            at[i] = parabola(-pos[i], before, g1, before + h, g2);
            at[2 + i] = parabola(pos[2 + i] - length, after, g3, after + h, g4);
        }
        double aim[NEAR_AIMS];
        bool any = false, aims = near_aims(at, pos, aim);
        for (int i = 0; i < NEAR_AIMS && aims; i++) any |= aim[i] >= 0 && aim[i] <= length;
        found += any;
    }
    return found / SHIFTS;
}

/* By run, and along its line; crossings are large, and lie still until it is known where they go. */
typedef struct Place {
    uint64_t run;
    double at;
    uint64_t from;
} Place;

static int by_run(const void *pa, const void *pb) {
    const Place *a = pa, *b = pb;
    if (a->run != b->run) return a->run < b->run ? -1 : 1;
    if (a->at < b->at || a->at > b->at) return a->at < b->at ? -1 : 1;
    return a->from < b->from ? -1 : 1;
}

/* Those of one run are few as a rule. */
static void sort_run(Place *p, uint64_t n) {
    enum { FEW_PLACES = 16 };
    if (n > FEW_PLACES) qsort(p, n, sizeof *p, by_run);
    for (uint64_t i = 1; i < n && n <= FEW_PLACES; i++) {
        const Place moved = p[i];
        uint64_t at = i;
        for (; at && by_run(&p[at - 1], &moved) > 0; at--) p[at] = p[at - 1];
        p[at] = moved;
    }
}

static bool sort_runs(Crossing *c, uint64_t n) {
    Place *place = malloc(n * sizeof *place);
    uint64_t *key = malloc(n * sizeof *key);
    if (!place || !key) {
        free(place), free(key);
        return false;
    }
    for (uint64_t i = 0; i < n; i++) key[i] = (uint64_t)c[i].thin << 32 | i;
    sort_keys(key, (uint32_t)n);
    for (uint64_t i = 0; i < n; i++) {
        const Crossing *of = &c[(uint32_t)key[i]];
        place[i] = (Place){of->thin, of->x[of->axis], (uint32_t)key[i]};
    }
    free(key);
    for (uint64_t i = 0, to; i < n; i = to) {
        for (to = i + 1; to < n && place[to].run == place[i].run;) to++;
        sort_run(place + i, to - i);
    }
    for (uint64_t i = 0; i < n; i++) { /* round by round, each to its place */
        uint64_t to = i, from = place[i].from;
        if (from == i) continue;
        const Crossing first = c[i];
        for (; from != i; to = from, from = place[to].from) c[to] = c[from], place[to].from = to;
        c[to] = first, place[to].from = to;
    }
    free(place);
    return true;
}

/* Do both tell of one decision, and is f behind b what it was before a? */
static bool returns(const Worker *w, const Crossing *a, const Crossing *b) {
    double jump = 0, change = 0;
    for (uint32_t c = 0; c < w->batch.s->channels; c++) {
        jump = fmax(jump, fabs(a->jump[c]));
        change = fmax(change, fabs(b->before[c] + b->jump[c] - a->before[c]));
    }
    return event_same(&a->event, &b->event) && change <= SAME * jump;
}

/* Where lines are: of a tile of the lattice, or of cells. */
typedef struct Net {
    const uint64_t *stride;  /* of vertices by axis; NULL: of cells, */
    const double (*side)[3]; /* whose sides by owner and axis are these, */
    uint32_t lines;          /* with so many vertices each between the two at its ends */
} Net;

/* A run that a vertex holds, between the crossings c and c + 1. */
typedef struct Vertex {
    uint64_t c;
    double length;
} Vertex;

static Probe probe_of_run(const Crossing *a) { return (Probe)((a->thin - THIN_FIRST) / 2 % PROBES); }

/* How many runs like this one, between crossings a and b, were missed for each that was found. */
static double stands_in_tile(const Worker *w, const Crossing *a, const Crossing *b, double length,
                             const uint64_t stride[3]) {
    uint64_t run = (a->thin - THIN_FIRST) / 2 / PROBES / AXES;
    double h = 0, chance;
    for (uint32_t d = 0; d < w->batch.s->dim; d++) h += fabs(a->direction[d]);
    if (!(length < h) || probe_of_run(a) == PROBE_SURE) return 0;
    chance = length / h;
    if ((int)probe_of_run(a) == UNLIKE) return returns(w, a, b) ? 2 * (fmin(1 / chance, MOST) - 1) : 0;
    if (probe_of_run(a) == PROBE_TRY) /* t of a crossing is where it lies on its edge, from the vertex before it. */
        chance += (1 - chance) * finds(w, run, stride[a->axis], a->t * h, length, (1 - b->t) * h, h);
    return fmin(1 / chance, MOST) - 1;
}

/* In a cell a run holds each of the vertices with the same chance, wherever that lies, and those at its two ends count
 * once: they belong to the next cells as well. */
static double stands_in_cell(const Worker *w, const Crossing *a, const Crossing *b, double length, const Net *t) {
    double chance = length / t->side[a->owner][a->axis], n = t->lines;
    bool unlike = (int)probe_of_run(a) == UNLIKE;
    if (!(chance > 0) || (!unlike && probe_of_run(a) != PROBE_BLIND)) return 0;
    if (unlike && !returns(w, a, b)) return 0;
    return fmin(fmax(0, 1 / chance - (n + 1)) / (unlike ? 0.5 * n : n), MOST);
}

/* The finder knows a root on each side of the vertex, and others may lie between: where lines are wider apart than what
 * is repeated, and vertices say only whether they lie in it. A few places up to each root tell how long the run is. Not
 * between unlike neighbours, where edges that show nowhere are not among the crossings. Is any much shorter? */
static bool shorten(Worker *w, const Crossing *c, Vertex *run, uint32_t n) {
    Batch *b = &w->batch;
    uint32_t lane = 0;
    bool any = false;
    for (uint32_t i = 0; i < n; i++)
        for (int end = 0; end < 2; end++) {
            const Crossing *x = &c[run[i].c + (uint64_t)end];
            for (int k = 0; k < LOOKS; k++, lane++) {
                double t = (k + 0.5) / LOOKS, at[3];
                for (int d = 0; d < 3; d++) at[d] = x->x[d] + (end ? -x->t : 1 - x->t) * (1 - t) * x->direction[d];
                batch_set_x(b, lane, at);
                batch_set_stream(b, lane, x->stream, x->rand0);
            }
        }
    batch_call(b, SLT_K_REGION, lane);
    lane = 0;
    for (uint32_t i = 0; i < n; i++) {
        double length = 0;
        for (int end = 0; end < 2; end++, lane += LOOKS) {
            const Crossing *x = &c[run[i].c + (uint64_t)end];
            double to = fabs(end ? x->t : 1 - x->t) * fabs(x->direction[x->axis]);
            int k = 0;
            while (k < LOOKS && batch_mark(b, lane + (uint32_t)k).hash == (end ? x->ha : x->hb)) k++;
            length += to * fmax(k, 0.5) / LOOKS;
        }
        if ((int)probe_of_run(&c[run[i].c]) == UNLIKE) continue;
        any |= length < SHORTER * run[i].length;
        run[i].length = fmin(run[i].length, length);
    }
    return any;
}

/* What runs stand for goes to the front; returns how many crossings that are. */
static uint64_t put_runs(Worker *w, Crossing *c, uint64_t kept, Vertex *run, uint32_t n, const Net *t) {
    for (uint32_t i = 0; i < n; i++) {
        const Crossing *a = &c[run[i].c];
        double more = t->stride ? stands_in_tile(w, a, a + 1, run[i].length, t->stride)
                                : stands_in_cell(w, a, a + 1, run[i].length, t);
        for (uint64_t k = run[i].c; k < run[i].c + 2 && more > 0; k++) {
            Crossing x = c[k];
            x.weight *= more;
            c[kept++] = x;
        }
    }
    return kept;
}

/* The pairs among n crossings in order, weighed by what they stand for, and those that were found by following, go to
 * the front; returns how many. */
static uint64_t pair(Worker *w, Crossing *c, uint64_t n, const Net *t) {
    Vertex run[RUNS];
    uint64_t kept = 0;
    uint32_t runs = 0, most = w->depth ? RUNS : FEW;
    bool look = !w->depth;
    for (uint64_t i = 0; i < n; i++) {
        if (c[i].thin == THIN_FOUND) { /* before all others */
            c[kept] = c[i], c[kept++].weight *= -1;
            continue;
        }
        /* The last crossing before the vertex, the first behind it. */
        if (i + 1 == n || c[i].thin & 1 || c[i + 1].thin != c[i].thin + 1) continue;
        run[runs++] = (Vertex){i, c[i + 1].x[c[i].axis] - c[i].x[c[i].axis]};
        if (runs == most) { /* the first few tell whether the others must be looked at, too */
            look = look && shorten(w, c, run, runs), most = RUNS;
            kept = put_runs(w, c, kept, run, runs, t), runs = 0;
        }
        i++;
    }
    if (look && runs) shorten(w, c, run, runs);
    return put_runs(w, c, kept, run, runs, t);
}

static void flush(Worker *w, const Net *t) {
    Sink *k = &w->sink;
    if (!k->nthin) return;
    if (!sort_runs(k->thin, k->nthin)) k->failed = true, k->nthin = 0;
    uint64_t n = pair(w, k->thin, k->nthin, t);
    for (uint64_t i = 0; i < n; i += BATCH) {
        uint32_t some = (uint32_t)fmin(BATCH, (double)(n - i));
        if (t->stride) sink_put_missed(k, k->thin + i, some);
        else sink_put_weighed(k, k->thin + i, some);
    }
    k->nthin = 0;
}

void thin_flush(Worker *w, const uint64_t stride[3]) { flush(w, &(Net){.stride = stride}); }

void thin_flush_cells(Worker *w, const double (*side)[3], uint32_t lines) {
    flush(w, &(Net){.side = side, .lines = lines});
}
