/* Does f jump where an untagged decision changes? Asked of the program itself: it is interpreted in double precision on
 * lines through the domain; where a decision differs between neighbours its place is bisected, and f compared on its
 * two sides. If f differs nowhere, with the parameters' values and with values near them, the decision is a matter of
 * how f is written: `x < 0 ? -x : x`, a spline in pieces, floor and frac that cancel, the cut of an angle that does not
 * show. Where the decision never changes on these lines nothing is known. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "compiler/pass/warn.h"
#include "saltus/status.h"

enum {
    LANES = 64,
    POINTS = 32, /* of a line; two lines go through the program at once */
    LINES = 12,  /* an axis */
    SETS = 3,    /* of parameters */
    HALVINGS = 40,
    EACH = 24,         /* changes of a decision that are looked at, of each set of parameters, at most */
    FEWEST = 3,        /* and in all, at least */
    NEARER = 14,       /* steps of the search for a place where one that never changed does */
    LARGEST = 1 << 15, /* instructions of a program: all values of all lanes have memory */
    FUEL = 1 << 19
};
#define NOTHING 1e-5 /* of the largest |f|: a difference after all halvings that is none */
#define TOUCHES 1e-6 /* part of |g| that is left where it tends to 0 */
#define SHRINK 0.25  /* of the box that is searched, in a step */
#define AWAY 0.25    /* by which parameters differ from their values, of max(0.1, |p|) */

typedef struct Change {
    uint32_t decision;
    double a[3], b[3];
    uint32_t before; /* what the decision is at a */
} Change;

typedef struct Probe {
    const Program *program;
    Fn fn;                  /* the primal, in double precision */
    const Untracked **list; /* [n] */
    uint32_t n;
    uint32_t *which;          /* by id: decision + 1 */
    uint32_t *seen;           /* [n][LANES]: a hash of all that the decision was */
    uint32_t *tested, *jumps; /* [n] */
    double *near;             /* [n][LANES]: the least |g| of its comparisons */
    double (*nearest)[4];     /* [n]: the least on the lines, and where */
    Change change[LANES];
    uint32_t nchanges, *found; /* found: [n] with these parameters */
    double *params;            /* [nfloats] */
    double x[3][LANES], f[SLT_MAX_CHANNELS][LANES];
    double largest;
    uint64_t fuel;
    bool failed;
} Probe;

/* A result that is no decision itself is asked by the sign of its argument: the cut of atan2. */
static bool by_argument(const Inst *i) {
    return i->type == TY_FLT && i->op != OP_ffloor && i->op != OP_fceil && i->op != OP_fround && i->op != OP_ftrunc &&
           i->op != OP_fsel;
}

static void watch(void *user, const Inst *i, const void *const *slot, const uint8_t *on) {
    Probe *p = user;
    uint32_t at = p->which[i->id];
    if (!at) return;
    bool sign = by_argument(i);
    const Untracked *t = p->list[at - 1];
    const double *a = t->g1 ? slot[t->g0->id] : NULL, *b = t->g1 ? slot[t->g1->id] : NULL;
    const void *v = slot[sign ? t->g0->id : i->id];
    for (uint32_t l = 0; l < LANES; l++) {
        if (!on[l]) continue;
        uint32_t value;
        if (sign) value = ((const double *)v)[l] < 0;
        else if (i->type == TY_FLT) value = (uint32_t)(int32_t)fmin(fmax(((const double *)v)[l], -1e9), 1e9);
        else value = ((const uint32_t *)v)[l];
        if (b) p->near[(at - 1) * LANES + l] = fmin(p->near[(at - 1) * LANES + l], fabs(a[l] - b[l]));
        uint32_t *h = &p->seen[(at - 1) * LANES + l];
        *h = ir_mix(*h, value + 1);
    }
}

static bool run(Probe *p) {
    static const double zero[LANES];
    double half[LANES];
    for (uint32_t l = 0; l < LANES; l++) half[l] = 0.5;
    SltKernelArgs a = {
        .params = p->params, .iparams = p->program->init_ints, .resolution = {512, 512}, .n_valid = LANES};
    for (uint32_t s = 0; s < SLT_IN_VARYING; s++) a.in[s] = zero;
    for (uint32_t d = 0; d < 3; d++) a.in[IN_X0 + d] = p->x[d];
    a.in[SLT_IN_RAND0] = half;
    for (uint32_t c = 0; c < p->program->channels; c++) a.out[c] = p->f[c];
    memset(p->seen, 0, p->n * LANES * sizeof *p->seen);
    for (uint32_t i = 0; i < p->n * LANES; i++) p->near[i] = HUGE_VAL;
    int status = ir_interpret_watched(&p->fn, &a, LANES, LANES, &p->fuel, watch, p);
    p->failed |= status != SLT_OK;
    return !p->failed;
}

static void set_point(Probe *p, uint32_t lane, const double x[3]) {
    for (uint32_t d = 0; d < 3; d++) p->x[d][lane] = x[d];
}

static void place(const Probe *p, uint32_t axis, uint32_t line, uint32_t point, double x[3]) {
    static const double steps[3] = {0.61803398874989485, 0.75487766624669276, 0.56984029099805327};
    const Program *g = p->program;
    for (uint32_t d = 0; d < 3; d++) {
        double t = d == axis ? (point + 0.1 + 0.8 * fmod(0.37 + steps[0] * line, 1)) / POINTS
                             : fmod(0.29 + steps[(d + 2 - axis) % 3] * (line + 1), 1);
        x[d] = d < g->dim ? g->lo[d] + t * (g->hi[d] - g->lo[d]) : 0;
    }
}

static void look_along(Probe *p, uint32_t axis, uint32_t line) {
    double x[LANES][3];
    for (uint32_t l = 0; l < LANES; l++) {
        place(p, axis, line + l / POINTS, l % POINTS, x[l]);
        set_point(p, l, x[l]);
    }
    if (!run(p)) return;
    for (uint32_t l = 0; l < LANES; l++)
        for (uint32_t c = 0; c < p->program->channels; c++)
            if (isfinite(p->f[c][l])) p->largest = fmax(p->largest, fabs(p->f[c][l]));
    for (uint32_t k = 0; k < p->n; k++)
        for (uint32_t l = 0; l < LANES; l++) {
            if (!(p->near[k * LANES + l] < p->nearest[k][0])) continue;
            p->nearest[k][0] = p->near[k * LANES + l], memcpy(p->nearest[k] + 1, x[l], sizeof x[l]);
        }
    for (uint32_t k = 0; k < p->n; k++)
        for (uint32_t l = 0; l + 1 < LANES && p->nchanges < LANES; l++) {
            const uint32_t *seen = &p->seen[k * LANES];
            if (l % POINTS == POINTS - 1 || seen[l] == seen[l + 1] || p->found[k] >= EACH / (p->n > 2 ? 2 : 1))
                continue;
            Change *c = &p->change[p->nchanges++];
            *c = (Change){.decision = k, .before = seen[l]};
            memcpy(c->a, x[l], sizeof c->a), memcpy(c->b, x[l + 1], sizeof c->b);
            p->found[k]++;
        }
}

/* One that did not change on the lines: points around where it came nearest to it, ever closer, until some differ.
 * Where its g tends to 0 and no side is ever the other one it decides on no area, as the guard of a length, and does no
 * harm. */
static void look_closer(Probe *p, uint32_t k) {
    const Program *g = p->program;
    double *best = p->nearest[k], x[LANES][3], reach = 1.0 / LINES, first = best[0];
    for (uint32_t step = 0; step < NEARER && best[0] < HUGE_VAL && p->nchanges < LANES; step++, reach *= SHRINK) {
        uint32_t across = g->dim == 1 ? LANES : g->dim == 2 ? 8 : 4;
        double centre[3] = {best[1], best[2], best[3]};
        for (uint32_t l = 0; l < LANES; l++) {
            for (uint32_t d = 0, at = l; d < 3; d++, at /= across) {
                double t = reach * ((2.0 * (at % across) + 1) / across - 1), side = g->hi[d] - g->lo[d];
                x[l][d] = d < g->dim ? fmin(fmax(centre[d] + t * side, g->lo[d]), g->hi[d]) : 0;
            }
            if (l == LANES - 1) memcpy(x[l], centre, sizeof centre); /* what the others are compared with */
            set_point(p, l, x[l]);
        }
        if (!run(p)) return;
        const uint32_t *seen = &p->seen[k * LANES];
        for (uint32_t l = 0; l + 1 < LANES; l++) {
            if (p->near[k * LANES + l] < best[0]) best[0] = p->near[k * LANES + l], memcpy(best + 1, x[l], sizeof x[l]);
            if (seen[l] == seen[LANES - 1] || p->nchanges == LANES || p->found[k] == FEWEST) continue;
            Change *c = &p->change[p->nchanges++];
            *c = (Change){.decision = k, .before = seen[LANES - 1]};
            memcpy(c->a, centre, sizeof c->a), memcpy(c->b, x[l], sizeof c->b);
            p->found[k]++;
        }
        if (p->found[k]) return;
    }
    if (best[0] < TOUCHES * first) p->tested[k]++;
}

/* Bisects all changes at once, and compares f on the two sides of each. */
static void judge(Probe *p) {
    double f[SLT_MAX_CHANNELS][LANES];
    if (!p->nchanges) return;
    for (uint32_t step = 0; step < HALVINGS; step++) {
        double middle[LANES][3];
        for (uint32_t i = 0; i < LANES; i++) {
            const Change *c = &p->change[i < p->nchanges ? i : 0];
            for (uint32_t d = 0; d < 3; d++) middle[i][d] = 0.5 * (c->a[d] + c->b[d]);
            set_point(p, i, middle[i]);
        }
        if (!run(p)) return;
        for (uint32_t i = 0; i < p->nchanges; i++) {
            Change *c = &p->change[i];
            bool near = p->seen[c->decision * LANES + i] == c->before;
            memcpy(near ? c->a : c->b, middle[i], sizeof middle[i]);
        }
    }
    for (int side = 0; side < 2; side++) {
        for (uint32_t i = 0; i < LANES; i++) {
            const Change *c = &p->change[i < p->nchanges ? i : 0];
            set_point(p, i, side ? c->b : c->a);
        }
        if (!run(p)) return;
        if (!side) memcpy(f, p->f, sizeof f);
    }
    for (uint32_t i = 0; i < p->nchanges; i++) {
        uint32_t k = p->change[i].decision;
        p->tested[k]++;
        for (uint32_t c = 0; c < p->program->channels; c++)
            p->jumps[k] += !(fabs(p->f[c][i] - f[c][i]) <= NOTHING * p->largest);
    }
}

/* The parameters' values, then others: where they happen to be 0 a jump may not show. */
static void set_params(Probe *p, uint32_t set) {
    for (uint32_t q = 0; q < p->program->nfloats; q++) {
        double v = p->program->init_floats[q], u = 2 * fmod(0.5 + 0.7548776662 * (q + 1) + 0.5698402910 * set, 1) - 1;
        p->params[q] = set ? v + AWAY * u * fmax(0.1, fabs(v)) : v;
    }
}

void warn_probe(PassCtx *ctx, const Fn *fn, const Untracked **list, uint32_t n, bool *shows) {
    Arena *scratch = &ctx->session->scratch;
    for (uint32_t k = 0; k < n; k++) shows[k] = true;
    if (!n || !ctx->program->init_floats || ctx->program->ngeometries || fn->ninsts > LARGEST) return;
    Probe *p = ARENA_NEW(scratch, Probe);
    p->program = ctx->program, p->fn = *fn, p->fn.precision = PREC_F64;
    p->list = list, p->n = n, p->fuel = FUEL;
    p->which = ARENA_ARRAY(scratch, uint32_t, fn->ninsts + 1);
    p->seen = ARENA_ARRAY(scratch, uint32_t, (size_t)n *LANES);
    p->tested = ARENA_ARRAY(scratch, uint32_t, n), p->jumps = ARENA_ARRAY(scratch, uint32_t, n);
    p->found = ARENA_ARRAY(scratch, uint32_t, n);
    p->near = ARENA_ARRAY(scratch, double, (size_t)n *LANES);
    p->nearest = (double(*)[4])ARENA_ARRAY(scratch, double, (size_t)n * 4);
    p->params = ARENA_ARRAY(scratch, double, ctx->program->nfloats + 1);
    for (uint32_t k = 0; k < n; k++) p->which[list[k]->at->id] = k + 1;
    for (uint32_t set = 0; set < SETS && !p->failed; set++) {
        set_params(p, set);
        p->nchanges = 0;
        memset(p->found, 0, n * sizeof *p->found);
        for (uint32_t k = 0; k < n; k++) p->nearest[k][0] = HUGE_VAL;
        for (uint32_t d = 0; d < p->program->dim; d++)
            for (uint32_t line = 0; line < (p->program->dim > 1 ? LINES : 4) && !p->failed; line += LANES / POINTS)
                look_along(p, d, line);
        for (uint32_t k = 0; k < n && !p->failed; k++)
            if (!p->found[k]) look_closer(p, k);
        if (!p->failed) judge(p);
    }
    for (uint32_t k = 0; k < n && !p->failed; k++) shows[k] = p->tested[k] < FEWEST || p->jumps[k];
}
