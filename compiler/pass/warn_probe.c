/* Does f jump where an untagged decision changes? Asked of the program itself: it is interpreted in double precision on
 * lines through the domain; where a decision differs between neighbours its place is bisected, and f compared on its
 * two sides. If f differs nowhere, with the parameters' values and with values near them, the decision is a matter of
 * how f is written: `x < 0 ? -x : x`, a spline in pieces, floor and frac that cancel, the cut of an angle that does not
 * show. Where the decision never changes on these lines nothing is known.
 *
 * That it does not show where lines happen to cross it is not enough. A rounding jumps at each of its integers, and may
 * show at one of them: every integer that it reaches is tried, and one that reaches too many stays in doubt. What else
 * decides are guides (warn_watch.c): lines go through the places where they decide as they hardly ever do. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "compiler/pass/warn_watch.h"

enum {
    POINTS = 32, /* of a line; two lines go through the program at once */
    LINES = 12,  /* an axis */
    SETS = 3,    /* of parameters */
    WIDE = 12,   /* more, farther away, for what did not change with those: */
    SCALES = 6,  /* by twice as much each time, then again */
    HALVINGS = 40,
    EACH = 24,         /* changes of a decision that are looked at, of each set of parameters, at most */
    FEWEST = 3,        /* and in all, at least */
    THROUGH = 6,       /* on lines through a place */
    NEARER = 14,       /* steps of the search for a place where one that never changed does */
    MANY = 2048,       /* integers of a rounding, a power of two; with more it cannot be shown to be continuous */
    RARE = 16,         /* one place in so many */
    LARGEST = 1 << 15, /* instructions of a program: all values of all lanes have memory */
    FUEL = 1 << 20,
    SPARE = 1 << 19 /* of it, for the lines; the rest is for what guides and integers ask */
};
#define NOTHING 1e-5  /* of the largest |f|, and of what parameters change: a jump that is none */
#define ROUNDING 1e-12 /* of the largest |f| */
#define BESIDE 8      /* widths of a bracket beside it: does f change as fast there? */
#define TOUCHES 1e-6  /* part of |g| that is left where it tends to 0 */
#define SHRINK 0.25   /* of the box that is searched, in a step */
#define AWAY 0.25     /* by which parameters differ from their values, of max(0.1, |p|) */

typedef struct Change {
    uint32_t of;
    bool counts; /* of a rounding: it reaches `target`; else its hash is no more `before` */
    double target, a[PLACE], b[PLACE];
    uint32_t before; /* at a */
} Change;

/* What is known of one that is watched, with these parameters. */
typedef struct Known {
    uint32_t found, tested, outcome, like, unlike; /* points where it decides as at the first, and where not */
    double nearest[1 + PLACE], like_at[PLACE], unlike_at[PLACE]; /* the least |a - b|, and where; the last of either */
    double jump;      /* the largest of f; it outlives the set, as `tested` does */
    uint32_t touched; /* times that it came up to an integer and no change was found; it outlives the set as well */
    bool settled;     /* it was tested with values near the parameters' */
} Known;

typedef struct Rounding {
    double end[2], at[2][PLACE],
        argument[2]; /* the least integer and the greatest, and where its argument is extreme */
    bool too_many;
    uint64_t tried[MANY / 64];
} Rounding;

typedef struct Search {
    Probe p;
    Arena *arena;
    Known *known;       /* [p.n] */
    Rounding *rounding; /* [p.nlist] */
    Vec(Change) pending;
    Vec(double) first; /* f at the points of the lines, with the parameters' values */
    uint32_t set, points;
    double largest, variation; /* |f|; of f with the parameters */
} Search;

static bool may_ask(const Search *s) { return !s->p.failed && s->p.fuel > SPARE; }

/* ---- changes */
static void add_change(Search *s, uint32_t k, const double *a, const double *b, uint32_t before) {
    Change c = {.of = k, .before = before};
    memcpy(c.a, a, sizeof c.a), memcpy(c.b, b, sizeof c.b);
    vec_push(s->arena, &s->pending, c);
}

/* Every integer between the two that was not tried with these parameters. */
static void add_integers(Search *s, uint32_t k, double va, double vb, const double *a, const double *b) {
    Rounding *r = &s->rounding[k];
    if (!(fabs(va) < 1e15 && fabs(vb) < 1e15)) {
        r->too_many = true;
        return;
    }
    double lo = fmin(va, vb), hi = fmax(va, vb);
    if (!(r->end[0] <= lo)) r->end[0] = lo;
    if (!(r->end[1] >= hi)) r->end[1] = hi;
    r->too_many |= r->end[1] - r->end[0] > MANY;
    for (double t = lo + 1; t <= hi && !r->too_many; t++) {
        uint32_t bit = (uint32_t)((int64_t)t & (MANY - 1));
        if (r->tried[bit / 64] >> bit % 64 & 1) continue;
        if (!may_ask(s) || s->pending.len > MANY) {
            r->too_many |= s->set == 0;
            return;
        }
        r->tried[bit / 64] |= (uint64_t)1 << bit % 64;
        add_change(s, k, a, b, va >= t);
        Change *c = &s->pending.data[s->pending.len - 1];
        c->counts = true, c->target = t;
    }
}

static bool is_before(const Search *s, const Change *c, uint32_t lane) {
    uint32_t at = watch_at(c->of, lane);
    return c->counts ? (s->p.value[at] >= c->target) == c->before : s->p.seen[at] == c->before;
}

/* f at both ends of n changes, or beside them. */
static bool ends(Search *s, const Change *change, uint32_t n, bool second, double beside) {
    const Program *g = s->p.program;
    for (uint32_t i = 0; i < WARN_LANES; i++) {
        const Change *c = &change[i < n ? i : 0];
        const double *u = second ? c->b : c->a, *v = second ? c->a : c->b;
        double x[PLACE] = {[PLACE_RANDOM] = u[PLACE_RANDOM]};
        for (uint32_t d = 0; d < 3; d++)
            x[d] = d < g->dim ? fmin(fmax(u[d] + beside * (u[d] - v[d]), g->lo[d]), g->hi[d]) : 0;
        watch_place(&s->p, i, x);
    }
    return watch_run(&s->p);
}

/* Bisects up to WARN_LANES changes at once, and compares f on the two sides of each with how it changes beside. */
static void judge(Search *s, Change *change, uint32_t n) {
    static const struct {
        bool second;
        double beside;
    } at[4] = {{false, 0}, {true, 0}, {false, BESIDE}, {true, BESIDE}};
    Probe *p = &s->p;
    double f[4][SLT_MAX_CHANNELS][WARN_LANES];
    uint32_t *seen[2];
    for (uint32_t step = 0; step < HALVINGS; step++) {
        double middle[WARN_LANES][PLACE];
        for (uint32_t i = 0; i < WARN_LANES; i++) {
            const Change *c = &change[i < n ? i : 0];
            for (uint32_t d = 0; d < PLACE; d++) middle[i][d] = 0.5 * (c->a[d] + c->b[d]);
            watch_place(p, i, middle[i]);
        }
        if (!watch_run(p)) return;
        for (uint32_t i = 0; i < n; i++)
            memcpy(is_before(s, &change[i], i) ? change[i].a : change[i].b, middle[i], sizeof middle[i]);
    }
    for (int e = 0; e < 4; e++) {
        if (!ends(s, change, n, at[e].second, at[e].beside)) return;
        memcpy(f[e], p->f, sizeof p->f);
        if (e < 2) seen[e] = arena_copy(s->arena, p->seen, sizeof *p->seen * p->nlist * WARN_LANES);
    }
    for (uint32_t i = 0; i < n; i++) {
        double jump = 0;
        for (uint32_t c = 0; c < p->program->channels; c++) {
            double u = f[0][c][i], v = f[1][c][i], slope = fabs(f[2][c][i] - u) + fabs(f[3][c][i] - v);
            if (fabs(u - v) <= slope || u == v || (isnan(u) && isnan(v))) continue;
            jump = fabs(u - v) >= 0 ? fmax(jump, fabs(u - v)) : HUGE_VAL; /* NaN on one side */
        }
        for (uint32_t k = 0; k < p->nlist; k++) {
            if (seen[0][watch_at(k, i)] == seen[1][watch_at(k, i)]) continue;
            if (s->known[k].settled) continue;
            s->known[k].tested++, s->known[k].jump = fmax(s->known[k].jump, jump);
        }
    }
}

static void judge_all(Search *s) {
    for (uint32_t i = 0; i < s->pending.len && !s->p.failed; i += WARN_LANES)
        judge(s, s->pending.data + i, s->pending.len - i < WARN_LANES ? s->pending.len - i : WARN_LANES);
    s->pending.len = 0;
}

/* ---- lines */
static void place(const Search *s, uint32_t axis, uint32_t line, uint32_t point, double x[PLACE]) {
    static const double steps[3] = {0.61803398874989485, 0.75487766624669276, 0.56984029099805327};
    const Program *g = s->p.program;
    for (uint32_t d = 0; d < 3; d++) {
        double t = d == axis ? (point + 0.1 + 0.8 * fmod(0.37 + steps[0] * line, 1)) / POINTS
                             : fmod(0.29 + steps[(d + 2 - axis) % 3] * (line + 1), 1);
        x[d] = d < g->dim ? g->lo[d] + t * (g->hi[d] - g->lo[d]) : 0;
    }
    x[PLACE_RANDOM] = line + LINES * (axis + 3 * s->set);
}

static void note_extremes(Search *s, uint32_t k, double x[WARN_LANES][PLACE]) {
    Rounding *r = &s->rounding[k];
    for (uint32_t l = 0; l < WARN_LANES; l++) {
        double v = s->p.argument[watch_at(k, l)];
        if (!(r->argument[0] <= v)) r->argument[0] = v, memcpy(r->at[0], x[l], sizeof x[l]);
        if (!(r->argument[1] >= v)) r->argument[1] = v, memcpy(r->at[1], x[l], sizeof x[l]);
    }
}

static void note(Search *s, uint32_t k, double x[WARN_LANES][PLACE]) {
    Known *n = &s->known[k];
    for (uint32_t l = 0; l < WARN_LANES; l++) {
        double near = s->p.near[watch_at(k, l)];
        uint32_t outcome = s->p.seen[watch_at(k, l)];
        if (near < n->nearest[0]) n->nearest[0] = near, memcpy(n->nearest + 1, x[l], sizeof x[l]);
        if (!n->like) n->outcome = outcome;
        if (outcome == n->outcome) n->like++, memcpy(n->like_at, x[l], sizeof x[l]);
        else n->unlike++, memcpy(n->unlike_at, x[l], sizeof x[l]);
    }
}

/* Both lines of the points x: changes of each that is in question, `most` of them at most. */
static void scan(Search *s, double x[WARN_LANES][PLACE], uint32_t most) {
    Probe *p = &s->p;
    for (uint32_t l = 0; l < WARN_LANES; l++) watch_place(p, l, x[l]);
    if (!watch_run(p)) return;
    for (uint32_t k = 0; k < p->n; k++) {
        uint32_t before = s->known[k].found;
        bool rounds = p->watched[k].kind == WATCH_ROUNDING;
        note(s, k, x);
        if (rounds) note_extremes(s, k, x);
        if (s->known[k].settled) continue;
        for (uint32_t l = 0; l + 1 < WARN_LANES; l++) {
            uint32_t at = watch_at(k, l);
            if (l % POINTS == POINTS - 1 || p->seen[at] == p->seen[at + 1]) continue;
            if (rounds) add_integers(s, k, p->value[at], p->value[at + 1], x[l], x[l + 1]);
            if (s->known[k].found >= before + most) continue;
            add_change(s, k, x[l], x[l + 1], p->seen[at]);
            s->known[k].found++;
        }
    }
}

/* By how much f differs from what it was with the parameters' values. */
static void compare_values(Search *s) {
    if (s->set >= SETS) return;
    for (uint32_t l = 0; l < WARN_LANES; l++)
        for (uint32_t c = 0; c < s->p.program->channels; c++, s->points++) {
            double f = s->p.f[c][l];
            if (s->set == 0) vec_push(s->arena, &s->first, f);
            double apart = s->points < s->first.len ? fabs(f - s->first.data[s->points]) : 0;
            if (isfinite(f)) s->largest = fmax(s->largest, fabs(f));
            if (isfinite(apart)) s->variation = fmax(s->variation, apart);
        }
}

static void look_along(Search *s, uint32_t axis, uint32_t line) {
    double x[WARN_LANES][PLACE];
    for (uint32_t l = 0; l < WARN_LANES; l++) place(s, axis, line + l / POINTS, l % POINTS, x[l]);
    scan(s, x, EACH / LINES + 1);
    if (!s->p.failed) compare_values(s);
}

/* Lines along every axis, with points that lie the closer the nearer they are. */
static void look_through(Search *s, const double *at) {
    const Program *g = s->p.program;
    for (uint32_t first = 0; first < g->dim && may_ask(s); first += WARN_LANES / POINTS) {
        double x[WARN_LANES][PLACE];
        for (uint32_t l = 0; l < WARN_LANES; l++) {
            uint32_t d = (first + l / POINTS) % g->dim;
            double u = (l % POINTS + 0.5) / POINTS * 2 - 1, t = u * u * u;
            memcpy(x[l], at, sizeof x[l]);
            x[l][d] += t * (t < 0 ? at[d] - g->lo[d] : g->hi[d] - at[d]);
        }
        scan(s, x, THROUGH);
    }
}

/* ---- places that lines miss */
typedef enum Wish { NEAR, LEAST, GREATEST } Wish;

static double score(const Search *s, uint32_t k, uint32_t lane, Wish wish) {
    uint32_t at = watch_at(k, lane);
    double v = wish == NEAR ? s->p.near[at] : wish == LEAST ? s->p.argument[at] : -s->p.argument[at];
    return isnan(v) ? HUGE_VAL : v;
}

/* Points around the best place so far, ever closer. best[0] is its score, then the place. Until some decide otherwise
 * than it (NEAR), or to the end: then the values at the place are in lane WARN_LANES - 1. */
static bool search(Search *s, uint32_t k, Wish wish, double best[1 + PLACE], double other[PLACE]) {
    const Program *g = s->p.program;
    double x[WARN_LANES][PLACE], reach = 1.0 / LINES;
    for (uint32_t step = 0; step < NEARER && best[0] < HUGE_VAL; step++, reach *= SHRINK) {
        uint32_t across = g->dim == 1 ? WARN_LANES : g->dim == 2 ? 8 : 4;
        for (uint32_t l = 0; l < WARN_LANES; l++) {
            for (uint32_t d = 0, at = l; d < 3; d++, at /= across) {
                double t = reach * ((2.0 * (at % across) + 1) / across - 1), side = g->hi[d] - g->lo[d];
                x[l][d] = d < g->dim ? fmin(fmax(best[1 + d] + t * side, g->lo[d]), g->hi[d]) : 0;
            }
            x[l][PLACE_RANDOM] = best[1 + PLACE_RANDOM];
            if (l == WARN_LANES - 1) memcpy(x[l], best + 1, sizeof x[l]); /* what the others are compared with */
            watch_place(&s->p, l, x[l]);
        }
        if (!watch_run(&s->p)) return false;
        for (uint32_t l = 0; l < WARN_LANES; l++) {
            if (score(s, k, l, wish) < best[0]) best[0] = score(s, k, l, wish), memcpy(best + 1, x[l], sizeof x[l]);
            if (wish != NEAR || s->p.seen[watch_at(k, l)] == s->p.seen[watch_at(k, WARN_LANES - 1)]) continue;
            memcpy(other, x[l], sizeof x[l]);
            add_change(s, k, x[WARN_LANES - 1], other, s->p.seen[watch_at(k, WARN_LANES - 1)]);
            return true;
        }
    }
    return false;
}

/* One that did not change on the lines. Where its g tends to 0 and no side is ever the other one it decides on no area,
 * as the guard of a length, and does no harm. */
static void look_closer(Search *s, uint32_t k) {
    Known *n = &s->known[k];
    double best[1 + PLACE], other[PLACE];
    memcpy(best, n->nearest, sizeof best);
    if (search(s, k, NEAR, best, other)) {
        n->found++;
        if (may_ask(s)) look_through(s, other);
    } else if (best[0] < TOUCHES * n->nearest[0]) n->tested++;
}

/* It tends to the next integer, and does not reach it: an angle at its cut. */
static bool touches(const Search *s, uint32_t k, int side, double score) {
    const Rounding *r = &s->rounding[k];
    double extreme = side ? -score : score;
    return fabs(extreme - round(extreme)) < TOUCHES * (r->argument[1] - r->argument[0]);
}

/* The integers beyond those that lines met. */
static void look_beyond(Search *s, uint32_t k) {
    Rounding *r = &s->rounding[k];
    for (int side = 0; side < 2 && may_ask(s) && !r->too_many; side++) {
        double best[1 + PLACE] = {side ? -r->argument[1] : r->argument[0]}, from[PLACE];
        if (!isfinite(best[0])) continue;
        memcpy(from, r->at[side], sizeof from), memcpy(best + 1, from, sizeof from);
        search(s, k, side ? GREATEST : LEAST, best, NULL);
        for (uint32_t l = 0; l < WARN_LANES; l++) watch_place(&s->p, l, l ? best + 1 : from);
        if (!watch_run(&s->p)) return;
        double va = s->p.value[watch_at(k, 0)], vb = s->p.value[watch_at(k, 1)];
        if (va != vb) add_integers(s, k, va, vb, from, best + 1);
        else s->known[k].touched += touches(s, k, side, best[0]);
    }
}

static void ask_guides(Search *s) {
    for (uint32_t k = 0; k < s->p.n && may_ask(s); k++) {
        const Known *n = &s->known[k];
        uint32_t few = n->like < n->unlike ? n->like : n->unlike;
        if (k >= s->p.nlist && !n->unlike && s->set == 0) look_closer(s, k);
        else if (few && few <= (n->like + n->unlike) / RARE)
            look_through(s, few == n->like ? n->like_at : n->unlike_at);
    }
}

/* The parameters' values, then others: where they happen to be 0 a jump may not show. What does not change with them
 * has no jump to lose, but may have one during a fit: it is asked with values farther away. */
static void set_params(Search *s) {
    Probe *p = &s->p;
    double away = s->set < SETS ? AWAY : AWAY * (2u << (s->set - SETS) % SCALES);
    for (uint32_t q = 0; q < p->program->nfloats; q++) {
        double v = p->program->init_floats[q],
               u = 2 * fmod(0.5 + 0.7548776662 * (q + 1) + 0.5698402910 * s->set, 1) - 1;
        p->params[q] = s->set ? v + away * u * fmax(0.1, fabs(v)) : v;
    }
}

static bool is_known(const Search *s, uint32_t k) {
    return s->known[k].tested >= FEWEST || (k < s->p.nlist && s->rounding[k].too_many);
}

static void forget(Search *s) {
    s->points = 0;
    for (uint32_t k = 0; k < s->p.n; k++)
        s->known[k] = (Known){.tested = s->known[k].tested,
                              .touched = s->known[k].touched,
                              .jump = s->known[k].jump,
                              .settled = s->set >= SETS && (s->known[k].settled || is_known(s, k)),
                              .nearest = {HUGE_VAL}};
    for (uint32_t k = 0; k < s->p.nlist; k++)
        s->rounding[k] = (Rounding){.too_many = s->rounding[k].too_many, .end = {NAN, NAN}, .argument = {NAN, NAN}};
}

static void ask(Search *s) {
    const Program *g = s->p.program;
    uint32_t lines = g->dim > 1 ? LINES : 4;
    set_params(s);
    forget(s);
    for (uint32_t d = 0; d < g->dim; d++)
        for (uint32_t line = 0; line < lines && !s->p.failed; line += WARN_LANES / POINTS) look_along(s, d, line);
    for (uint32_t k = 0; k < s->p.nlist && !s->p.failed; k++)
        if (!s->known[k].found && !s->known[k].settled) look_closer(s, k);
    judge_all(s);
    ask_guides(s);
    for (uint32_t k = 0; k < s->p.nlist; k++)
        if (s->p.watched[k].kind == WATCH_ROUNDING && !s->known[k].settled) look_beyond(s, k);
    judge_all(s);
}

static bool any_untested(const Search *s) {
    for (uint32_t k = 0; k < s->p.nlist; k++)
        if (!is_known(s, k)) return true;
    return false;
}

void warn_probe(PassCtx *ctx, const Fn *fn, const Depend *dep, const Untracked **list, uint32_t n, bool *shows) {
    for (uint32_t k = 0; k < n; k++) shows[k] = true;
    if (!n || !ctx->program->init_floats || ctx->program->ngeometries || fn->ninsts > LARGEST) return;
    Search *s = ARENA_NEW(&ctx->session->scratch, Search);
    s->arena = &ctx->session->scratch, s->p.fuel = FUEL;
    watch_init(&s->p, ctx, fn, dep, list, n);
    s->known = ARENA_ARRAY(s->arena, Known, s->p.n);
    s->rounding = ARENA_ARRAY(s->arena, Rounding, n);
    for (; s->set < SETS && !s->p.failed; s->set++) ask(s);
    bool asked = !s->p.failed;
    for (; s->set < SETS + WIDE && !s->p.failed && any_untested(s); s->set++) ask(s);
    double nothing = fmax(NOTHING * fmin(s->largest, s->variation / AWAY), ROUNDING * s->largest);
    for (uint32_t k = 0; k < n && asked; k++)
        shows[k] =
            s->known[k].tested + s->known[k].touched < FEWEST || s->known[k].jump > nothing || s->rounding[k].too_many;
}
