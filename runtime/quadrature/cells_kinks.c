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

/* A root, and where it is after the two moves. */
typedef struct Bend {
    Root *root;
    uint32_t pair;
    bool done, lost;
    struct {
        double x[3], g, dg[3];
    } after[2];
} Bend;

static bool is_other_way(const Cells *c, const Root *r) {
    const Column *k = &c->column[r->column];
    for (uint32_t i = k->first; i < k->first + k->nroots; i++) {
        const Root *o = &c->root[i];
        if (o != r && o->other && &c->root[o->other - 1] == r && event_same(&o->of->event, &r->of->event)) return true;
    }
    return false;
}

/* May its g have a kink? Where several events have parts of the jump these are known. */
static bool may_bend(const Cells *c, const Root *r) {
    const Cell *cell = &c->cell[c->piece[c->column[r->column].piece].cell];
    const Tie *t = r->tie ? &c->tie[r->tie - 1] : NULL;
    if (c->prunes || !r->wanted || r->band || (uint32_t)r->of->event.site >= c->s->nsites) return false;
    bool ties = c->s->site_ties && c->s->site_ties[r->of->event.site];
    if (!cell->same && !ties && !(r->twin && is_other_way(c, r))) return false;
    if (t && !(t->whole && !t->naway && event_same(&t->event[0], &r->of->event))) return false;
    return c->s->site_kind[r->of->event.site] == SLT_SITE_COMPARE &&
           cells_sides(c, r)->hash[0] != cells_sides(c, r)->hash[1];
}

/* g and its gradient after a move, at all places of it. */
static void ask(Cells *c, Bend *of, uint32_t n, uint32_t move) {
    Batch *b = c->b;
    uint32_t lane[UNTIE_MOST], end = move % 2;
    for (uint32_t i = 0; i < n; i++) of[i].done = of[i].pair != move / 2;
    for (uint32_t from = 0; from < n; from++) {
        uint32_t lanes = 0;
        if (of[from].done) continue;
        b->args.site = of[from].root->of->event.site;
        for (uint32_t i = from; i < n; i++) {
            const Event *event = &of[i].root->of->event;
            if (of[i].done || event->site != b->args.site) continue;
            batch_set_x(b, lanes, of[i].after[end].x);
            batch_set_stream(b, lanes, 0, 0);
            batch_set_event(b, lanes, event);
            of[i].done = true, lane[lanes++] = i;
        }
        cells_call(c, SLT_K_SITE_GRAD, lanes);
        for (uint32_t i = 0; i < lanes; i++) {
            of[lane[i]].after[end].g = batch_get(b, SLT_OUT_G, 0, i);
            for (uint32_t d = 0; d < c->dim; d++) of[lane[i]].after[end].dg[d] = batch_get(b, SLT_OUT_G_DX, d, i);
        }
    }
}

/* Which piece of g is there after a move, that at its own root tells. */
static void find_after(Cells *c, Bend *of, uint32_t n) {
    Batch *b = c->b;
    const SltCullList *lists = b->args.cull; /* good where nothing has moved */
    b->args.cull = NULL;
    for (uint32_t m = 0; m < UNTIE_WAYS; m++) {
        untie_use(b, &c->apart->move[m].scene);
        for (uint32_t s = 0; s < STEPS; s++) {
            ask(c, of, n, m);
            for (uint32_t i = 0; i < n; i++) {
                const Root *r = of[i].root;
                if (of[i].pair != m / 2) continue;
                double up = of[i].after[m % 2].dg[r->axis];
                of[i].lost |= !(up * r->dg[r->axis] > 0) || !isfinite(of[i].after[m % 2].g);
                if (s + 1 < STEPS && !of[i].lost)
                    of[i].after[m % 2].x[r->axis] =
                        cells_round(c, of[i].after[m % 2].x[r->axis] - of[i].after[m % 2].g / up);
            }
        }
    }
    untie_use(b, b->s);
    b->args.cull = lists;
}

/* The tie of a root with a kink: half of the jump moves as after either move. */
static bool keep(Cells *c, const Bend *of) {
    Root *r = of->root;
    Crossing x = {.event = {0}};
    if (of->lost) return true;
    if (!CELLS_ROOM(c, tie, 1)) return false;
    cells_crossing(c, r, &x);
    Tie *t = &c->tie[c->ntie++];
    *t = (Tie){.naway = 2, .kink = true, .bent = true};
    for (uint32_t end = 0; end < 2; end++) {
        Away *a = &t->away[end];
        *a = (Away){.event = r->of->event, .move = 2 * of->pair + end, .part = {1, 0}, .g = {of->after[end].g}};
        memcpy(a->x[0], of->after[end].x, sizeof a->x[0]), memcpy(a->dg[0], of->after[end].dg, sizeof a->dg[0]);
        for (uint32_t ch = 0; ch < c->s->channels; ch++)
            a->jump[ch] = 0.5 * x.jump[ch], a->half[ch] = (end ? -0.5 : 0.5) * x.jump[ch];
    }
    r->tie = c->ntie;
    return true;
}

static bool keep_all(Cells *c, Bend *of, uint32_t n) {
    find_after(c, of, n);
    for (uint32_t i = 0; i < n; i++)
        if (!keep(c, &of[i])) return false;
    return true;
}

static Bend bend_of(Root *r, uint32_t pair) {
    Bend b = {.root = r, .pair = pair};
    for (int end = 0; end < 2; end++) memcpy(b.after[end].x, r->x, sizeof r->x);
    return b;
}

/* What may be rounding of g, or curvature, which is of second order in the step; infinite where a piece is so short
 * that a move leads beyond it. */
static double least(const Cells *c, const Root *r, const Crossing *x, double bent) {
    const Piece *p = &c->piece[c->column[r->column].piece];
    double steep = 0, most = 0, far = UNTIE_WAYS * c->apart->step * c->width;
    for (uint32_t d = 0; d < c->dim; d++) steep += r->dg[d] * r->dg[d], most = larger(most, fabs(r->x[d]));
    if (p->base >= 0 && !(ROOM * (p->at[p->base][1] - p->at[p->base][0]) > far)) return HUGE_VAL;
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
        for (uint32_t i = 0; i < most; i++)
            if (pair[i] != KINK_NONE) of[kinks++] = bend_of(&c->root[c->active[from + i]], pair[i]);
        if (kinks && !keep_all(c, of, kinks)) return false;
    }
    return true;
}

bool cells_follow_kinks(Cells *c) {
    Bend of[UNTIE_MOST];
    uint32_t n = 0;
    for (uint32_t i = 0; i < c->nroot; i++) {
        const Tie *t = c->root[i].tie ? &c->tie[c->root[i].tie - 1] : NULL;
        if (!t || !t->bent) continue;
        of[n++] = bend_of(&c->root[i], t->away[0].move / 2);
        c->root[i].tie = 0;
        if (n < UNTIE_MOST) continue;
        if (!keep_all(c, of, n)) return false;
        n = 0;
    }
    return !n || keep_all(c, of, n);
}
