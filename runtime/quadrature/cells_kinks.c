/* Curves of a g that has a kink in the parameters: `max(a, b) > 0` where a and b are the same along the curve, and move
 * apart. The integral then has no derivative. As of boundaries that coincide the mean of those after a move forth and
 * after one back is given, and half of how much they differ is an error (kink.c does so for lines).
 *
 * Asked are curves in whose cell a choice is between values that are the same (cells_same.c), those on which another
 * lies that is the same event's, with something else decided, and those whose g hangs on a choice that parameters alone
 * make, as max(r, q). Others have one g all along them, or cross where they have not: in points. So programs without
 * such choices pay nothing. */
#include <math.h>
#include <string.h>

#include "runtime/quadrature/cells_inner.h"
#include "runtime/sample/coincide.h"

enum { STEPS = 3 }; /* of Newton's method, to the root that g has after a move */
/* Changes forth and back that make up for each other to this part are those of a slope: what curvature makes of moves
 * as long as cells_tied.c makes them. */
#define BENT_F64 0x1p-10
#define BENT_F32 0x1p-5
#define ROOM 0.25 /* of a piece: at its ends other curves meet it */

/* A root with its tie, of which each part is where g is 0 after a move. */
typedef struct Bend {
    Root *root;
    Tie tie;
    bool done, lost;
} Bend;

static const Root *other_way(const Cells *c, const Root *r) {
    const Column *k = &c->column[r->column];
    for (uint32_t i = k->first; i < k->first + k->nroots; i++) {
        const Root *o = &c->root[i];
        if (o != r && o->other && &c->root[o->other - 1] == r && event_same(&o->of->event, &r->of->event)) return o;
    }
    return NULL;
}

/* May its g have a kink? Where several events have parts of the jump these are known. */
static bool may_bend(const Cells *c, const Root *r) {
    const Cell *cell = &c->cell[c->piece[c->column[r->column].piece].cell];
    const Tie *t = r->tie ? &c->tie[r->tie - 1] : NULL;
    if (c->prunes || !r->wanted || r->band || (uint32_t)r->of->event.site >= c->s->nsites) return false;
    bool ties = c->s->site_ties && c->s->site_ties[r->of->event.site];
    if (!cell->same && !ties && !(r->twin && other_way(c, r))) return false;
    if (t && !(t->whole && !t->naway && event_same(&t->event[0], &r->of->event))) return false;
    return c->s->site_kind[r->of->event.site] == SLT_SITE_COMPARE &&
           cells_sides(c, r)->hash[0] != cells_sides(c, r)->hash[1];
}

/* The part of a tie after this move; NULL: there is none. */
static Away *part_of(Bend *of, uint32_t move) {
    for (uint32_t k = 0; k < of->tie.naway; k++)
        if (of->tie.away[k].move == move) return &of->tie.away[k];
    return NULL;
}

/* g and its gradient after a move, at all places of it. */
static void ask(Cells *c, Bend *of, uint32_t n, uint32_t move) {
    Batch *b = c->b;
    uint32_t lane[UNTIE_MOST];
    for (uint32_t i = 0; i < n; i++) of[i].done = !part_of(&of[i], move);
    for (uint32_t from = 0; from < n; from++) {
        uint32_t lanes = 0;
        if (of[from].done) continue;
        b->args.site = of[from].root->of->event.site;
        for (uint32_t i = from; i < n; i++) {
            if (of[i].done || of[i].root->of->event.site != b->args.site) continue;
            batch_set_x(b, lanes, part_of(&of[i], move)->x[0]);
            batch_set_stream(b, lanes, 0, 0);
            batch_set_event(b, lanes, &of[i].root->of->event);
            of[i].done = true, lane[lanes++] = i;
        }
        cells_call(c, SLT_K_SITE_GRAD, lanes);
        for (uint32_t i = 0; i < lanes; i++) {
            Away *a = part_of(&of[lane[i]], move);
            a->g[0] = batch_get(b, SLT_OUT_G, 0, i);
            for (uint32_t d = 0; d < c->dim; d++) a->dg[0][d] = batch_get(b, SLT_OUT_G_DX, d, i);
        }
    }
}

static void go(const Cells *c, Bend *of, Away *a, double g, double up) {
    int axis = of->root->axis;
    of->lost |= !(up * of->root->dg[axis] > 0) || !isfinite(g);
    if (!of->lost) a->x[0][axis] = cells_round(c, a->x[0][axis] - g / up);
}

/* Of two ways that have their curves here each begins at its own root. */
static bool begin_after(Cells *c, Bend *of, uint32_t n, uint32_t move) {
    c->nprobe = 0;
    for (uint32_t i = 0; i < n; i++)
        if (of[i].root->band && part_of(&of[i], move) && !cells_probe(c, of[i].root->of, of[i].root->x)) return false;
    if (!cells_run_probes(c)) return false;
    const Probe *p = c->probe;
    for (uint32_t i = 0; i < n; i++) {
        Away *a = part_of(&of[i], move);
        if (!a || !of[i].root->band) continue;
        go(c, &of[i], a, p->g, p->dg[of[i].root->axis]), p++;
    }
    return true;
}

/* Which piece of g is there after a move, that at its own root tells. */
static bool find_after(Cells *c, Bend *of, uint32_t n) {
    const SltCullList *lists = c->b->args.cull; /* good where nothing has moved */
    bool memory = true;
    c->b->args.cull = NULL;
    for (uint32_t m = 0; m < UNTIE_WAYS && memory; m++) {
        untie_use(c->b, &c->apart->move[m].scene);
        memory = begin_after(c, of, n, m);
        for (uint32_t s = 0; s < STEPS && memory; s++) {
            ask(c, of, n, m);
            for (uint32_t i = 0; i < n; i++) {
                Away *a = part_of(&of[i], m);
                if (a && s + 1 < STEPS) go(c, &of[i], a, a->g[0], a->dg[0][of[i].root->axis]);
            }
        }
    }
    untie_use(c->b, c->b->s);
    c->b->args.cull = lists;
    return memory;
}

/* Those that were lost are ties no longer. */
static bool keep_all(Cells *c, Bend *of, uint32_t n) {
    if (!find_after(c, of, n)) return false;
    for (uint32_t i = 0; i < n; i++) {
        of[i].root->tie = 0;
        if (of[i].lost) continue;
        if (!CELLS_ROOM(c, tie, 1)) return false;
        c->tie[c->ntie++] = of[i].tie, of[i].root->tie = c->ntie;
    }
    return true;
}

/* ---- do they lie on each other, or does rounding hide what is between them? */
enum { SPOTS = 8 }; /* about a root, as far from each other as roundings there have to do with one another */

/* The k-th, along the tangent of its curve: where g is next to 0 it is as fine as f32 can be. Round numbers of the
 * domain: next to 0 places are finer than what g makes of them. */
static void spot(const Cells *c, const Root *r, uint32_t k, double x[3]) {
    static const double along[SPOTS] = {0, 61, -83, 147, -179, 233, -271, 317};
    double drop = 0;
    memset(x, 0, 3 * sizeof *x);
    for (uint32_t n = 0; n < c->dim; n++) {
        uint32_t d = (r->axis + 1 + n) % c->dim; /* the height is the last */
        int power;
        frexp(larger(fabs(c->lo[d]), fabs(c->hi[d])), &power);
        double unit = ldexp(c->b->f64 ? 0x1p-53 : 0x1p-24, power);
        bool height = (int)d == r->axis;
        double by = height ? -drop / r->dg[d] + ((double)k - SPOTS / 2) * unit : along[(k + 3 * d) % SPOTS] * unit;
        x[d] = smaller(larger(unit * rint((r->x[d] + by) / unit), c->lo[d]), c->hi[d]);
        if (!height) drop += r->dg[d] * (x[d] - r->x[d]);
    }
}

/* What is 0 but for rounding is so at some of the spots, or has both signs. */
static bool is_0(const double v[SPOTS]) {
    bool zero = false, below = false, above = false;
    for (uint32_t k = 0; k < SPOTS; k++) zero |= v[k] == 0, below |= v[k] < 0, above |= v[k] > 0;
    return zero || (below && above);
}

bool cells_lie_on_each_other(Cells *c, const Root *r, const Root *s, bool *is) {
    double x[3], apart[SPOTS];
    c->nprobe = 0;
    for (uint32_t k = 0; k < SPOTS; k++) {
        spot(c, r, k, x);
        if (!cells_probe(c, r->of, x) || !cells_probe(c, s->of, x)) return false;
    }
    if (!cells_run_probes(c)) return false;
    const Probe *p = c->probe;
    for (uint32_t k = 0; k < SPOTS; k++, p += 2) apart[k] = p[0].g / p[0].dg[r->axis] - p[1].g / p[1].dg[r->axis];
    *is = is_0(apart);
    return true;
}

static Bend bend_of(Root *r) { return (Bend){.root = r, .tie = {.kink = true, .bent = true}}; }

/* So much of the jump moves as after this move; and half of how much the two orders differ is an error. */
static void add_part(const Cells *c, Bend *of, uint32_t move, const double *jump) {
    Away *a = &of->tie.away[of->tie.naway++];
    *a = (Away){.event = of->root->of->event, .move = move, .part = {1, 0}};
    memcpy(a->x[0], of->root->x, sizeof a->x[0]);
    for (uint32_t ch = 0; ch < c->s->channels; ch++)
        a->jump[ch] = 0.5 * jump[ch], a->half[ch] = (move % 2 ? -0.5 : 0.5) * jump[ch];
}

/* Are the values of one of the choices in its cell apart, by less than bounds of rounding are? Or the two ways? */
static bool is_hidden(Cells *c, const Root *r, bool *hidden) {
    const Cell *cell = &c->cell[c->piece[c->column[r->column].piece].cell];
    const Root *other = r->twin ? other_way(c, r) : NULL;
    bool one = true;
    double x[3], g[SPOTS];
    *hidden = false;
    if (other && !cells_lie_on_each_other(c, r, other, &one)) return false;
    c->nprobe = 0;
    for (uint32_t e = 0; e < cell->nevents; e++)
        for (uint32_t k = 0; k < SPOTS && cell->same >> e & 1; k++) {
            spot(c, r, k, x);
            if (!cells_probe_event(c, &cell->event[e], x)) return false;
        }
    if (!cells_run_probes(c)) return false;
    *hidden = !one;
    for (uint32_t i = 0; i < c->nprobe; i++) {
        g[i % SPOTS] = c->probe[i].g;
        if (i % SPOTS == SPOTS - 1) *hidden |= !is_0(g);
    }
    return true;
}

bool cells_keep_kink(Cells *c, Root *r, uint32_t move, const bool seen[2], double jump[2][SLT_MAX_CHANNELS],
                     bool hidden) {
    Bend of = bend_of(r);
    of.tie.hidden = hidden;
    for (uint32_t way = 0; way < 2; way++)
        if (seen[way]) add_part(c, &of, move + way, jump[way]);
    return keep_all(c, &of, 1);
}

bool cells_has_room(const Cells *c, const Root *r) {
    const Piece *p = &c->piece[c->column[r->column].piece];
    return p->base < 0 || ROOM * (p->at[p->base][1] - p->at[p->base][0]) > UNTIE_WAYS * c->apart->step * c->width;
}

/* What may be rounding of g, or curvature, which is of second order in the step. */
static double least(const Cells *c, const Root *r, const Crossing *x, double bent) {
    double steep = 0, most = 0;
    if (!cells_has_room(c, r)) return HUGE_VAL;
    for (uint32_t d = 0; d < c->dim; d++) steep += r->dg[d] * r->dg[d], most = larger(most, fabs(r->x[d]));
    double rounding = 4 * (c->b->f64 ? 0x1p-52 : 0x1p-23) * most + 0.25 * bent * c->apart->step;
    return rounding * sqrt(steep) + 4 * fabs(x->g) + 8 * r->of->error;
}

bool cells_find_kinks(Cells *c) {
    uint32_t n = 0;
    double bent = c->b->f64 ? BENT_F64 : BENT_F32;
    for (uint32_t i = 0; i < c->nroot; i++)
        if (may_bend(c, &c->root[i])) c->active[n++] = i;
    if (!n) return true;
    if (!cells_ready_to_tie(c)) return false;
    for (uint32_t from = 0; from < n && c->apart; from += UNTIE_MOST) {
        uint32_t most = n - from < UNTIE_MOST ? n - from : UNTIE_MOST, pair[UNTIE_MOST], kinks = 0;
        Crossing x[UNTIE_MOST];
        const Crossing *at[UNTIE_MOST];
        double slack[UNTIE_MOST];
        Bend of[UNTIE_MOST];
        memset(x, 0, sizeof x);
        for (uint32_t i = 0; i < most; i++) {
            const Root *r = &c->root[c->active[from + i]];
            cells_crossing(c, r, &x[i]);
            at[i] = &x[i], slack[i] = least(c, r, &x[i], bent);
        }
        kink_find(c->b, c->apart, at, slack, bent, most, pair);
        for (uint32_t i = 0; i < most; i++) {
            const Root *r = &c->root[c->active[from + i]];
            bool memory = true;
            if (pair[i] == KINK_NONE) continue;
            double noise = 4 * r->of->error;
            if (kink_is_beside(c->b, c->apart, &c->finer, &x[i], pair[i], noise, &memory)) continue;
            if (!memory) return false;
            of[kinks] = bend_of(&c->root[c->active[from + i]]);
            for (uint32_t way = 0; way < 2; way++) add_part(c, &of[kinks], 2 * pair[i] + way, x[i].jump);
            if (!is_hidden(c, of[kinks].root, &of[kinks].tie.hidden)) return false;
            kinks++;
        }
        if (kinks && !keep_all(c, of, kinks)) return false;
    }
    return true;
}

/* The tie of a column is that of the middle, at another place; where both orders have all of the jump, it is that
 * there. */
static Bend follow(const Cells *c, Root *r) {
    Bend of = {.root = r, .tie = c->tie[r->tie - 1]};
    Crossing x = {.event = {0}};
    cells_crossing(c, r, &x);
    for (uint32_t k = 0; k < of.tie.naway; k++) {
        Away *a = &of.tie.away[k];
        memcpy(a->x[0], r->x, sizeof a->x[0]);
        for (uint32_t ch = 0; ch < c->s->channels && !r->band; ch++)
            a->jump[ch] = 0.5 * x.jump[ch], a->half[ch] = (a->move % 2 ? -0.5 : 0.5) * x.jump[ch];
    }
    return of;
}

bool cells_follow_kinks(Cells *c) {
    Bend of[UNTIE_MOST];
    uint32_t n = 0;
    for (uint32_t i = 0; i < c->nroot; i++) {
        Root *r = &c->root[i];
        if (!r->tie || !c->tie[r->tie - 1].bent) continue;
        of[n++] = follow(c, r);
        if (n < UNTIE_MOST) continue;
        if (!keep_all(c, of, n)) return false;
        n = 0;
    }
    return !n || keep_all(c, of, n);
}
