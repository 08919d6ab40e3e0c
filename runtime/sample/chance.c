/* Along a line the random numbers stay what they are. Where these nearly decide alone, as in `rand() < p + 1e-3 * x.x`,
 * one line in a thousand is crossed, and its crossing weighs a thousand times as much: the mean is right, but few lines
 * meet any, and replicates that met none agree that there is nothing.
 *
 * At a point with all of its random numbers moved parameters tell as well. The points at which the region is another
 * forth than back, times what f differs by, over twice the step, estimate the same boundary term, whatever turns the
 * decision: a point is as good as any other, and the error falls with the root of their number. What untagged decisions
 * do is in neither estimate, as the region does not know them. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/sample/alloc.h"
#include "runtime/sample/bars.h"
#include "runtime/sample/chance.h"
#include "runtime/sample/derived.h"
#include "runtime/sample/untie.h"

enum {
    WAYS = 16,   /* parameters of their own; more are moved together, in so many groups */
    BLOCKS = 16, /* of points, whose spread is the error */
    FEW = 8,
    MANY = 64,     /* changes: to say anything, and to take the lines' place */
    FEWEST = 4096, /* points of a way, */
    TEST = 32,     /* its part of the points, for all parameters at once */
    AGAIN = 8      /* and so many times as many, others, where a contradiction is to be confirmed */
};
#define STEP 0.05        /* the longer one, of max(0.1, |parameter|) */
#define CONTRADICTS 3.0  /* errors of both */
#define SURER 0.25       /* the second estimate's error, in parts of the contradiction, to take the lines' place */
#define HOPE 2.5         /* by so much more points may make it smaller, */
#define EVEN 0.2         /* at least, of the error that changes would have that are thrown at random */
#define REMAINS 0.25     /* the part of the contradiction that stays in the error all the same */

typedef struct Way {
    double *dir; /* [nfloats] */
    double step; /* in units of dir */
} Way;

/* The boundary term along one way, by column: its mean and error. */
typedef struct Told {
    double mean[SLT_MAX_CHANNELS], error[SLT_MAX_CHANNELS], changes[SLT_MAX_CHANNELS];
} Told;

static bool serves(const Run *r) {
    const SltScene *s = r->s;
    bool decides = s->layout[SLT_K_REGION].reads & ((uint64_t)1 << SLT_IN_STREAM | (uint64_t)1 << SLT_IN_RAND0);
    if (!s->uses_rand || !decides || !s->nsites || s->detached || s->ngeometries || !s->kernel[SLT_K_SIDES])
        return false;
    if (scene_outputs(s, SLT_K_REGION, SLT_OUT_DEPTH) || scene_outputs(s, SLT_K_REGION, SLT_OUT_FACE))
        return false; /* regions do not tell all there is */
    for (uint32_t i = 0; i < s->nsites && s->site_static; i++)
        if (s->site_static[i]) return false;
    return !s->site_kind || !memchr(s->site_kind, SLT_SITE_SILHOUETTE, s->nsites);
}

static double param(const SltScene *s, uint32_t p) {
    return s->f64 ? ((const double *)s->params)[p] : (double)((const float *)s->params)[p];
}

/* Sets the batch to points from .. from + n of the sequence. */
static void put_points(Batch *b, uint32_t seed, uint64_t from, uint32_t n, double (*x)[3]) {
    const SltScene *s = b->s;
    for (uint32_t i = 0; i < n; i++) {
        uint32_t shift[4], own[4], dims = s->dim + 1;
        rng_block(seed, RNG_CHANCE, 0, 0, shift);
        rng_block(seed, RNG_CHANCE, 1, from + i, own);
        for (uint32_t d = 0; d < s->dim; d++)
            x[i][d] = s->lo[d] + rng_recurrence(dims, d, from + i, shift[d]) * (s->hi[d] - s->lo[d]);
        batch_set_x(b, i, x[i]);
        batch_set_stream(b, i, (int32_t)own[0], rng_recurrence(dims, s->dim, from + i, shift[s->dim]));
    }
}

typedef struct Sides {
    int32_t hash[BATCH];
    double f[BATCH][SLT_MAX_CHANNELS];
} Sides;

static void ask(Batch *b, const SltScene *moved, uint32_t n, Sides *out) {
    untie_use(b, moved);
    batch_call(b, SLT_K_SIDES, n);
    untie_use(b, b->s);
    for (uint32_t i = 0; i < n; i++) {
        out->hash[i] = batch_get_int(b, SLT_OUT_HASH, 0, i);
        for (uint32_t c = 0; c < b->s->channels; c++) out->f[i][c] = batch_get(b, SLT_OUT_F, c, i);
    }
}

/* What the changes at n points weigh, added to sum[columns]. */
static void add_changes(const Run *r, const Chance *k, const Sides s[2], double (*x)[3], uint32_t n, double *sum,
                        double *changes) {
    uint32_t channels = r->s->channels;
    for (uint32_t i = 0; i < n; i++) {
        double a[SLT_MAX_CHANNELS];
        if (s[0].hash[i] == s[1].hash[i]) continue;
        if (k->adjoint) grid_gather(&r->grid, k->adjoint, channels, x[i], a);
        for (uint32_t c = 0; c < channels; c++) {
            uint32_t column = k->adjoint ? 0 : c;
            double jump = s[0].f[i][c] - s[1].f[i][c], weighs = k->adjoint ? a[c] * jump : jump;
            sum[column] += weighs, changes[column] += weighs != 0;
        }
    }
}

/* Twice the step says how far the step itself is off: what f is on each side of a change moves with it, too. */
static void tell(uint32_t columns, double (*rows)[BLOCKS * SLT_MAX_CHANNELS], Told *t) {
    double wide[SLT_MAX_CHANNELS], ignored[SLT_MAX_CHANNELS];
    bars_of_rows(rows[0], NULL, BLOCKS, columns, t->mean, t->error);
    bars_of_rows(rows[1], NULL, BLOCKS, columns, wide, ignored);
    for (uint32_t c = 0; c < columns; c++) {
        double chance = t->changes[c] > 0 ? EVEN * fabs(t->mean[c]) / sqrt(t->changes[c]) : HUGE_VAL;
        t->error[c] = t->changes[c] < FEW ? HUGE_VAL : hypot(fmax(t->error[c], chance), wide[c] - t->mean[c]);
    }
}

static SltStatus estimate(Run *r, const Chance *k, Batch *b, const Way *w, uint32_t seed, uint64_t points, Told *t) {
    const SltScene *s = r->s;
    uint32_t columns = k->adjoint ? 1 : s->channels;
    uint64_t each = (points + BLOCKS - 1) / BLOCKS;
    double(*rows)[BLOCKS * SLT_MAX_CHANNELS] = alloc_zero(2, sizeof *rows), volume = 1;
    double(*x)[3] = alloc_zero(BATCH, sizeof *x);
    Sides *sides = alloc_zero(2, sizeof *sides);
    Moved moved[4] = {0};
    double ignored[SLT_MAX_CHANNELS] = {0};
    bool memory = rows && x && sides;
    memset(t, 0, sizeof *t);
    for (uint32_t m = 0; m < 4; m++)
        memory &= scene_move(&moved[m], s, w->dir, 0, (m % 2 ? -1 : 1) * w->step * (m < 2 ? 0.5 : 1));
    for (uint32_t d = 0; d < s->dim; d++) volume *= s->hi[d] - s->lo[d];
    for (uint32_t block = 0; block < BLOCKS && memory; block++)
        for (uint64_t from = 0; from < each && pool_stop_reason(&r->pool) == SLT_OK; from += BATCH) {
            uint32_t n = each - from < BATCH ? (uint32_t)(each - from) : BATCH;
            put_points(b, seed, block * each + from, n, x);
            for (uint32_t m = 0; m < 4; m += 2) {
                ask(b, &moved[m].scene, n, &sides[0]), ask(b, &moved[m + 1].scene, n, &sides[1]);
                add_changes(r, k, sides, x, n, rows[m / 2] + block * columns, m ? ignored : t->changes);
            }
        }
    for (uint32_t m = 0; m < 2 && memory; m++)
        for (uint32_t i = 0; i < BLOCKS * columns; i++)
            rows[m][i] *= volume / (double)each / (2 * w->step * (m ? 1 : 0.5));
    if (memory) tell(columns, rows, t);
    for (uint32_t m = 0; m < 4; m++) moved_free(&moved[m]);
    free(rows), free(x), free(sides);
    return memory ? SLT_OK : status_fail(r->err, SLT_LIMIT, "out of memory");
}

static double boundary_of(const Chance *k, uint64_t i) {
    return k->boundary ? k->boundary[i] : k->gradient[i] - k->interior[i];
}

/* How far both are apart along the way; *sure: what that is measured by. */
static double apart(const Chance *k, const Way *w, const Told *t, uint32_t nfloats, uint32_t column, double *sure) {
    double sum = 0, error = 0;
    for (uint32_t p = 0; p < nfloats; p++) {
        if (w->dir[p] == 0) continue;
        uint64_t i = (uint64_t)column * nfloats + p;
        sum += w->dir[p] * boundary_of(k, i), error += fabs(w->dir[p]) * k->error[i];
    }
    *sure = hypot(error, t->error[column]);
    return t->mean[column] - sum;
}

static bool contradicts(double by, double sure) {
    return isfinite(by) && isfinite(sure) && fabs(by) > CONTRADICTS * sure;
}

/* Though they agree, within an error of lines that is much the wider one. */
static bool is_surer(const Chance *k, double error, uint64_t i) {
    return k->smooth && isfinite(k->error[i]) && hypot(k->smooth[i], error) < SURER * k->error[i];
}

static void settle(const Chance *k, const Way *w, const Told *t, uint32_t nfloats, uint32_t column, bool alone) {
    double sure, by = apart(k, w, t, nfloats, column, &sure);
    bool differs = contradicts(by, sure);
    for (uint32_t p = 0; p < nfloats; p++) {
        uint64_t i = (uint64_t)column * nfloats + p;
        double off = by / w->dir[p], error = t->error[column] / fabs(w->dir[p]);
        if (w->dir[p] == 0) continue;
        if (!differs && !(alone && t->changes[column] >= MANY && is_surer(k, error, i))) continue;
        bool many = t->changes[column] >= MANY, starved = many && alone && k->starved && k->starved[i],
             takes = many && (starved || !differs || (alone && error < SURER * fabs(off)));
        if (takes) {
            k->gradient[i] += off;
            if (k->boundary) k->boundary[i] += off;
        }
        k->error[i] = !differs  ? hypot(k->smooth[i], error)
                      : starved ? hypot(k->error[i], error)
                                : hypot(takes ? error : k->error[i], (takes ? REMAINS : 1) * off);
    }
}

/* Whether the lines' answer along a way of many parameters is worth asking each of them. */
static bool doubtful(const Chance *k, const Way *w, const Told *t, uint32_t nfloats, uint32_t columns) {
    for (uint32_t c = 0; c < columns; c++) {
        double sure, by = apart(k, w, t, nfloats, c, &sure), lines = 0, smooth = 0;
        if (contradicts(by, sure)) return true;
        for (uint32_t p = 0; p < nfloats; p++) {
            uint64_t i = (uint64_t)c * nfloats + p;
            if (w->dir[p] == 0) continue;
            if (k->starved && k->starved[i] && t->changes[c] > 0) return true;
            lines = hypot(lines, w->dir[p] * k->error[i]);
            if (k->smooth) smooth += fabs(w->dir[p]) * k->smooth[i];
        }
        if (k->smooth && isfinite(lines) && hypot(smooth, t->error[c] / HOPE) < SURER * lines) return true;
    }
    return false;
}

typedef enum Whose { WHOSE_ALL, WHOSE_STARVED } Whose;

static bool is_starved(const Chance *k, uint32_t p, uint32_t nfloats, uint32_t columns) {
    for (uint32_t c = 0; c < columns && k->starved; c++)
        if (k->starved[(uint64_t)c * nfloats + p]) return true;
    return false;
}

/* Parameters to ask about, [nfloats]; how many. */
static uint32_t ask_of(const SltScene *s, const Chance *k, Whose whose, uint32_t columns, uint8_t *asked) {
    uint32_t n = 0;
    for (uint32_t p = 0; p < scene_params(s); p++) {
        asked[p] = (!s->active || s->active[p]) && (whose == WHOSE_ALL || is_starved(k, p, s->nfloats, columns));
        n += asked[p];
    }
    return n;
}

/* Of n parameters that are asked about, those of group g of so many; returns their number. */
static uint32_t way_of(const Run *r, const uint8_t *asked, uint32_t n, uint32_t g, uint32_t groups, Way *w) {
    uint32_t of = 0, chance[4];
    w->step = STEP;
    memset(w->dir, 0, r->s->nfloats * sizeof *w->dir);
    for (uint32_t p = 0, i = 0; p < r->s->nfloats; p++) {
        if (!asked[p] || (uint64_t)i++ * groups / n != g) continue;
        rng_block(r->j->seed, RNG_CHANCE, 2, p, chance);
        w->dir[p] = (n > groups && chance[0] & 1 ? -1 : 1) * fmax(0.1, fabs(param(r->s, p))), of++;
    }
    return of;
}

/* All of them moved at once, at few points: *doubts says whether to go on. */
static SltStatus test(Run *r, const Chance *k, Batch *b, const uint8_t *asked, uint32_t n, Whose whose, Way *w,
                      bool *doubts) {
    Told t;
    way_of(r, asked, n, 0, 1, w);
    SltStatus st = estimate(r, k, b, w, r->j->seed + 2 + (uint32_t)whose, k->points / TEST + 1, &t);
    *doubts = st == SLT_OK && doubtful(k, w, &t, r->s->nfloats, k->adjoint ? 1 : r->s->channels);
    return st;
}

/* One after the other, or as many groups as there may be. */
static SltStatus one_by_one(Run *r, const Chance *k, Batch *b, const uint8_t *asked, uint32_t n, Way *w) {
    const SltScene *s = r->s;
    uint32_t columns = k->adjoint ? 1 : s->channels, ways = n < WAYS ? n : WAYS;
    SltStatus st = SLT_OK;
    for (uint32_t g = 0; g < ways && st == SLT_OK; g++) {
        uint32_t of = way_of(r, asked, n, g, ways, w);
        Told t;
        uint64_t points = k->points / ways > FEWEST ? k->points / ways : FEWEST;
        st = estimate(r, k, b, w, r->j->seed, points, &t);
        bool doubts = false;
        for (uint32_t c = 0; c < columns && st == SLT_OK; c++) {
            double sure, by = apart(k, w, &t, s->nfloats, c, &sure);
            doubts |= contradicts(by, sure);
            doubts |= t.changes[c] > 0 && t.changes[c] < FEW;    /* nothing is known so far */
            for (uint32_t p = 0; p < s->nfloats && of == 1; p++) /* it may be surer after more points */
                doubts |= w->dir[p] != 0 && is_surer(k, t.error[c] / w->dir[p] / HOPE, (uint64_t)c * s->nfloats + p);
        }
        if (!doubts) continue;
        st = estimate(r, k, b, w, r->j->seed + 1, (r->j->max_evaluations ? 1 : AGAIN) * points, &t);
        for (uint32_t c = 0; c < columns && st == SLT_OK; c++) settle(k, w, &t, s->nfloats, c, of == 1);
    }
    return st;
}

/* First all parameters at once; then those at once of which the lines know nothing, as their part is lost among the
 * errors of all. */
static SltStatus ask_all(Run *r, const Chance *k, Batch *b, uint8_t *asked, Way *w) {
    uint32_t columns = k->adjoint ? 1 : r->s->channels, all = ask_of(r->s, k, WHOSE_ALL, columns, asked), n = all;
    bool doubts = false;
    SltStatus st = n ? test(r, k, b, asked, n, WHOSE_ALL, w, &doubts) : SLT_OK;
    if (st == SLT_OK && !doubts) {
        n = ask_of(r->s, k, WHOSE_STARVED, columns, asked);
        if (n && n < all) st = test(r, k, b, asked, n, WHOSE_STARVED, w, &doubts);
    }
    return st == SLT_OK && doubts ? one_by_one(r, k, b, asked, n, w) : st;
}

SltStatus chance_add(Run *r, Chance *k) {
    const SltScene *s = r->s;
    if (!serves(r)) return SLT_OK;
    Batch b;
    Way w = {.dir = alloc_zero(s->nfloats + 1, sizeof(double))};
    uint8_t *asked = alloc_zero(s->nfloats + 1, 1);
    if (!w.dir || !asked || !batch_init(&b, s, &r->grid)) {
        free(w.dir), free(asked);
        return status_fail(r->err, SLT_LIMIT, "out of memory");
    }
    b.pool = &r->pool, b.again = true;
    SltStatus st = ask_all(r, k, &b, asked, &w);
    batch_collect(&b, &r->stats);
    batch_free(&b), free(w.dir), free(asked);
    return st;
}
