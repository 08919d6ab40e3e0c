/* Curves that lie on each other as far as rounding lets one tell: a condition that is asked twice, an edge that two
 * shapes share; or the two sides of a band, thinner than the bound of rounding is. The first site stands for all of
 * them, and the jump there is that of all together.
 *
 * Where f is the same on the two sides of all together, nothing is lost if the one hides the other, or the band. So it
 * is looked for: halfway between the roots, as the program decides there; and if it is not seen, with parameters moved
 * so that the curves come apart, in the one order and in the other. What is seen in one order alone rounding hides from
 * view: the mean of the two is given, half of how they differ is an error, and the cell is not certified. */
#include <math.h>
#include <string.h>

#include "runtime/quadrature/cells_inner.h"

/* Units in the last place: */
#define WIDE 8   /* what lies between roots so far apart, and farther than half the bound of rounding, is no chance of it; */
#define THIN 4   /* nearer to each other than so they leave no place between that is on neither, */
#define APART 16 /* curves that were moved so far from each other can be told apart, */
#define LONGER 16 /* times */
#define FAR 64   /* and so far they are no two that move alike, up to what rounding makes of moves */

static bool is_site(const Cells *c, const Root *r) { return (uint32_t)r->of->event.site < c->s->nsites; }

static double unit(const Cells *c, double size) { return size * (c->b->f64 ? 0x1p-52 : 0x1p-23); }

/* Of a root's place: of numbers as large as its cell has, for next to 0 places are finer than what g makes of them. */
static double unit_at(const Cells *c, const Root *r) {
    const Box *b = &c->cell[c->piece[c->column[r->column].piece].cell].box;
    return unit(c, larger(fabs(b->lo[r->axis]), fabs(b->hi[r->axis])));
}

static double size_along(const Box *b, int axis) { return larger(fabs(b->lo[axis]), fabs(b->hi[axis])); }

/* By how much g rounds may move the two roots towards each other. */
static double noise_of(const Root *r, const Root *s) {
    return r->noise / fabs(r->dg[r->axis]) + s->noise / fabs(s->dg[s->axis]);
}

/* Are they as near as rounding lets one tell? */
static bool are_near(const Cells *c, const Cell *cell, const Root *r, const Root *s) {
    double width = cell->box.end[r->axis] - cell->box.lo[r->axis], most = cells_reach(c->b->f64) * width;
    double same = smaller(2 * noise_of(r, s) + 8 * unit(c, size_along(&cell->box, r->axis)), most);
    return fabs(r->x[r->axis] - s->x[r->axis]) <= same;
}

static bool is_present(const Cells *c, const Root *r) {
    return c->piece[c->column[r->column].piece].present >> r->edge & 1;
}

/* What g rounds by in all of a cell may be far more than at its roots: where a length is nearly 0 that is not what
 * decides, places are large. Of roots that this bound makes near, though places can be told apart, it is asked there.
 */
static bool take_noise(Cells *c) {
    uint32_t n = 0;
    c->nask = 0;
    for (uint32_t i = 0; i < c->nroot; i++) {
        Root *r = &c->root[i];
        const Column *k = &c->column[r->column];
        const Cell *cell = &c->cell[c->piece[k->piece].cell];
        double size = size_along(&cell->box, r->axis);
        bool asks = false;
        for (uint32_t j = k->first; j < k->first + k->nroots && !asks && is_present(c, r); j++) {
            const Root *s = &c->root[j];
            bool other = j != i && is_present(c, s);
            asks = other && fabs(r->x[r->axis] - s->x[r->axis]) > 8 * unit(c, size) && are_near(c, cell, r, s);
        }
        if (asks && !cells_ask(c, r->of, r->x, r->x)) return false;
        if (asks) c->active[n++] = i;
    }
    if (n && !cells_run_asks(c)) return false;
    for (uint32_t i = 0; i < n; i++) {
        Root *r = &c->root[c->active[i]];
        r->noise = smaller(c->ask[i].error, r->noise); /* NaN is not */
    }
    return true;
}

static void find_twins(Cells *c, const Column *k) {
    Piece *p = &c->piece[k->piece];
    const Cell *cell = &c->cell[p->cell];
    for (uint32_t i = 1; i < k->nroots; i++)
        for (uint32_t j = 0; j < i; j++) {
            Root *r = &c->root[k->first + i], *s = &c->root[k->first + j];
            if (!is_present(c, r) || !is_present(c, s) || !are_near(c, cell, r, s)) continue;
            bool later = is_site(c, s) || !is_site(c, r);
            Root *stays = later ? s : r, *goes = later ? r : s;
            p->present &= ~(1u << goes->edge);
            stays->twin = true, goes->other = (uint32_t)(stays - c->root) + 1;
        }
}

bool cells_find_twins(Cells *c) {
    if (!cells_grow(c, &c->active, &c->active_cap, c->nroot, sizeof *c->active) || !take_noise(c)) return false;
    for (uint32_t i = 0; i < c->ncolumn; i++) find_twins(c, &c->column[i]);
    return true;
}

static Root *stands_for(const Cells *c, uint32_t i) { return &c->root[c->root[i].other - 1]; }

/* Both count again, each with its sides, of which those of the one that stood for the other are known. */
static bool restore(Cells *c, Root *r, Root *stood, uint32_t more) {
    if (!CELLS_ROOM(c, sides, more)) return false;
    r->sides = c->nsides + 1, c->nsides += more;
    for (uint32_t i = 0; i < more; i++) c->sides[r->sides - 1 + i] = *cells_sides(c, stood);
    c->piece[c->column[r->column].piece].present |= 1u << r->edge;
    r->wanted = is_site(c, r);
    r->twin = stood->twin = false, r->other = 0;
    return true;
}

/* At x region and f are these, and not those on the two sides. */
static bool part(Cells *c, Root *r, Root *stood, double x, uint32_t lane) {
    if (!restore(c, r, stood, 1)) return false;
    for (int upper = 0; upper < 2; upper++) {
        bool first = (stood->x[r->axis] < r->x[r->axis]) == !upper;
        Sides *s = &c->sides[(first ? stood : r)->sides - 1];
        s->at[!upper] = x, s->hash[!upper] = (uint32_t)batch_get_int(c->b, SLT_OUT_HASH, 0, lane);
        for (uint32_t ch = 0; ch < c->s->channels; ch++) s->f[!upper][ch] = batch_get(c->b, SLT_OUT_F, ch, lane);
    }
    return true;
}

/* What is seen there may be a chance of rounding. */
static bool note_between(Cells *c, Root *r, uint32_t lane) {
    if (!CELLS_ROOM(c, sides, 1)) return false;
    Sides *s = &c->sides[c->nsides++];
    for (uint32_t ch = 0; ch < c->s->channels; ch++) s->f[0][ch] = batch_get(c->b, SLT_OUT_F, ch, lane);
    r->between = c->nsides;
    return true;
}

static bool is_beside(const Sides *s, uint32_t hash) { return hash == s->hash[0] || hash == s->hash[1]; }

/* Is f the same on both sides, whatever is decided there? */
static bool is_alike(const Cells *c, const Sides *s) {
    bool alike = true;
    double slack = c->b->f64 ? 0x1p-30 : 0x1p-12;
    for (uint32_t ch = 0; ch < c->s->channels; ch++)
        alike &= fabs(s->f[1][ch] - s->f[0][ch]) <= slack * (fabs(s->f[0][ch]) + fabs(s->f[1][ch]));
    return alike || s->hash[0] == s->hash[1];
}

/* After others were parted: the root that is nearest now stands for it. */
static void choose_other(const Cells *c, Root *r) {
    const Column *k = &c->column[r->column];
    double least = HUGE_VAL;
    for (uint32_t i = k->first; i < k->first + k->nroots; i++) {
        const Root *s = &c->root[i];
        double d = fabs(s->x[s->axis] - r->x[r->axis]);
        if (s == r || !s->wanted || !s->sides || !(d < least)) continue;
        least = d, r->other = i + 1;
    }
    stands_for(c, (uint32_t)(r - c->root))->twin = true;
}

/* Halfway between the roots of active[0 .. n) and those that stand for them, where that is far enough from both. Those
 * that something was parted from in this very round stay, to be asked once more. */
static bool look_between(Cells *c, uint32_t *n) {
    uint32_t again = 0;
    for (uint32_t from = 0; from < *n; from += BATCH) {
        uint32_t lanes = *n - from < BATCH ? *n - from : BATCH;
        double middle[BATCH];
        for (uint32_t i = 0; i < lanes; i++) {
            const Root *r = &c->root[c->active[from + i]], *s = stands_for(c, c->active[from + i]);
            double x[3];
            memcpy(x, r->x, sizeof x);
            x[r->axis] = middle[i] = cells_round(c, 0.5 * (r->x[r->axis] + s->x[r->axis]));
            batch_set_x(c->b, i, x);
        }
        cells_call(c, SLT_K_SIDES, lanes);
        for (uint32_t i = 0; i < lanes; i++) {
            uint32_t at = c->active[from + i], hash = (uint32_t)batch_get_int(c->b, SLT_OUT_HASH, 0, i);
            Root *r = &c->root[at], *s = stands_for(c, at);
            double p = r->x[r->axis], q = s->x[r->axis];
            double noise = 0.5 * noise_of(r, s);
            double units = fabs(p - q) / unit_at(c, r);
            bool wide = units >= WIDE && fabs(p - q) > noise;
            r->twin = s->twin && is_alike(c, cells_sides(c, s)); /* to be moved, if nothing is seen */
            bool other = units >= THIN && !is_beside(cells_sides(c, s), hash);
            if (!s->twin) c->active[again++] = at;
            else if (other && !(wide ? part(c, r, s, middle[i], i) : note_between(c, r, i))) return false;
        }
    }
    for (uint32_t i = 0; i < again; i++) choose_other(c, &c->root[c->active[i]]);
    *n = again;
    return true;
}

/* What the jump of a root is, upwards, after one move; told: the two curves came apart, and nothing else is near. */
typedef struct Order {
    bool told, seen, far, lower; /* lower: the root that is to return lies below */
    double jump[SLT_MAX_CHANNELS];
} Order;

enum { AT_ONCE = 64, PLACES = 3 }; /* pairs; below both, between, above both */

static void use(Batch *b, const SltScene *s) { b->args.params = s->params, b->args.geometries = s->geometries; }

/* The orders of pairs active[from .. from + n) after one move of the parameters. */
static bool see(Cells *c, const SltScene *moved, uint32_t from, uint32_t n, Order *order) {
    double x[AT_ONCE][PLACES];
    Batch *b = c->b;
    c->nprobe = 0;
    use(b, moved);
    for (uint32_t i = 0; i < n; i++) {
        const Root *r = &c->root[c->active[from + i]], *s = stands_for(c, c->active[from + i]);
        if (!cells_probe(c, r->of, s->x) || !cells_probe(c, s->of, s->x)) return false;
    }
    if (!cells_run_probes(c)) return false;
    for (uint32_t i = 0; i < n; i++) {
        const Root *s = stands_for(c, c->active[from + i]);
        const Probe *p = &c->probe[2 * i], *q = p + 1;
        double at = s->x[s->axis], r = at - p->g / p->dg[s->axis], t = at - q->g / q->dg[s->axis], d = fabs(r - t);
        double place[PLACES] = {smaller(r, t) - 0.5 * d, 0.5 * (r + t), larger(r, t) + 0.5 * d};
        order[i].lower = r < t;
        order[i].far = d >= FAR * unit_at(c, s);
        order[i].told =
            d >= APART * unit_at(c, s) && place[0] > c->lo[s->axis] && place[2] < c->hi[s->axis]; /* NaN is not */
        for (uint32_t k = 0; k < PLACES; k++) {
            double to[3];
            memcpy(to, s->x, sizeof to);
            to[s->axis] = x[i][k] = order[i].told ? cells_round(c, place[k]) : at;
            batch_set_x(b, PLACES * i + k, to);
        }
    }
    cells_call(c, SLT_K_SIDES, PLACES * n);
    for (uint32_t i = 0; i < n; i++) {
        const Sides *s = cells_sides(c, stands_for(c, c->active[from + i]));
        uint32_t lane = PLACES * i, hash[PLACES];
        for (uint32_t k = 0; k < PLACES; k++) hash[k] = (uint32_t)batch_get_int(b, SLT_OUT_HASH, 0, lane + k);
        order[i].told &= hash[0] == s->hash[0] && hash[2] == s->hash[1];
        order[i].seen = order[i].told && !is_beside(s, hash[1]);
        for (uint32_t ch = 0; ch < c->s->channels; ch++) {
            double f = batch_get(b, SLT_OUT_F, ch, lane + 1);
            order[i].jump[ch] = !order[i].seen   ? 0
                                : order[i].lower ? f - batch_get(b, SLT_OUT_F, ch, lane)
                                                 : batch_get(b, SLT_OUT_F, ch, lane + 2) - f;
        }
    }
    return true;
}

/* Two ways of one event: which of them a point has before the move is a matter of rounding. */
static bool keep_way(Cells *c, Root *r, const Order order[2], uint32_t move, double times, bool hidden) {
    double up[2][SLT_MAX_CHANNELS] = {{0}};
    for (uint32_t way = 0; way < 2; way++)
        for (uint32_t ch = 0; ch < c->s->channels; ch++) up[way][ch] = times * r->rises * order[way].jump[ch];
    return cells_keep_kink(c, r, move, (const bool[2]){order[0].seen, order[1].seen}, up, hidden);
}

void cells_count_kink(Cells *c, const Event *event, const double x[3]) {
    SltPlace at = {.known = true, .site = (uint32_t)event->site + 1};
    for (uint32_t d = 0; d < c->dim; d++) at.x[d] = at.beyond[d] = x[d];
    if ((uint32_t)event->site < c->s->nsites) place_least(&c->counts->coincident_at, &at);
    c->counts->coincident++;
}

/* Does one of them jump by something else in the one order than in the other? */
static bool differ(const Cells *c, const Order order[2]) {
    bool differ = false;
    for (uint32_t ch = 0; ch < c->s->channels; ch++) {
        double p = order[0].jump[ch], q = order[1].jump[ch];
        differ |= fabs(p - q) > 0x1p-10 * (fabs(p) + fabs(q));
    }
    return differ && order[0].far && order[1].far;
}

/* They have a kink where they are one curve. What is a band all the same, thinner than rounding, is not certified. Of
 * different events the mean of the two orders is given already: where they differ that it is a kink is told. */
static bool keep_ways(Cells *c, Root *r, Root *stood, const Order order[2], uint32_t move) {
    bool one;
    if (c->prunes || !cells_has_room(c, r)) return true;
    use(c->b, c->s);
    if (!cells_lie_on_each_other(c, r, stood, &one)) return false;
    if (!event_same(&r->of->event, &stood->of->event)) {
        if (one && differ(c, order)) cells_count_kink(c, &stood->of->event, stood->x);
        return true;
    }
    return keep_way(c, r, order, move, 1, !one) && keep_way(c, stood, order, move, -1, !one);
}

/* A pair of orders, forth and back: sides of which the jump is their mean, and those for the coarse rule. */
static bool keep_orders(Cells *c, Root *r, Root *stood, const Order order[2]) {
    if (!restore(c, r, stood, 2) || !CELLS_ROOM(c, sides, 2)) return false;
    const Sides of = *cells_sides(c, stood);
    stood->sides = c->nsides + 1, c->nsides += 2;
    r->band = stood->band = true;
    for (uint32_t i = 0; i < 4; i++) {
        bool own = i < 2, coarse = i & 1;
        Sides *s = &c->sides[(own ? r : stood)->sides - 1 + coarse];
        *s = of, s->hash[1] = ~of.hash[0];
        for (uint32_t ch = 0; ch < c->s->channels; ch++) {
            double jump = coarse ? order[1].jump[ch] : 0.5 * (order[0].jump[ch] + order[1].jump[ch]);
            s->f[1][ch] = of.f[0][ch] + (own ? jump : -jump);
        }
    }
    return true;
}

static bool keep_pair(Cells *c, Root *r, Root *stood, const Order order[2], uint32_t move) {
    if (!stood->twin) return true; /* another curve was parted from it, that is nearer */
    return keep_orders(c, r, stood, order) && keep_ways(c, r, stood, order, move);
}

/* The jump of r is this, and half of how far that is from the other an error. */
static bool keep_likely(Cells *c, Root *r, Root *stood, const double likely[], const double other[]) {
    Order order[2];
    if (!stood->twin) return true;
    for (uint32_t ch = 0; ch < c->s->channels; ch++) {
        order[0].jump[ch] = 1.5 * likely[ch] - 0.5 * other[ch];
        order[1].jump[ch] = 0.5 * likely[ch] + 0.5 * other[ch];
    }
    return keep_orders(c, r, stood, order);
}

/* What was seen between the two, where moves do not tell, is taken for what it looks like. */
static bool keep_between(Cells *c, Root *r, Root *stood) {
    const double none[SLT_MAX_CHANNELS] = {0}, *f = c->sides[r->between - 1].f[0];
    const Sides *s = cells_sides(c, stood);
    double jump[SLT_MAX_CHANNELS];
    bool lower = r->x[r->axis] < stood->x[r->axis];
    for (uint32_t ch = 0; ch < c->s->channels; ch++) jump[ch] = lower ? f[ch] - s->f[0][ch] : s->f[1][ch] - f[ch];
    return keep_likely(c, r, stood, jump, none);
}

/* After long moves: the two are more likely to lie in the order that their roots have. */
static bool keep_order(Cells *c, Root *r, Root *stood, const Order order[2]) {
    bool lower = r->x[r->axis] < stood->x[r->axis];
    uint32_t likely = order[0].lower != lower && order[1].lower == lower;
    return keep_likely(c, r, stood, order[likely].jump, order[!likely].jump);
}

/* Of active[0 .. *n), by moves of one length; those that they do not tell of stay. first: there are longer ones. */
static bool move_by(Cells *c, const Apart *apart, bool first, uint32_t *n) {
    uint32_t kept = 0;
    bool memory = true;
    for (uint32_t from = 0; from < *n && memory; from += AT_ONCE) {
        uint32_t most = *n - from < AT_ONCE ? *n - from : AT_ONCE;
        Order order[UNTIE_WAYS][AT_ONCE];
        for (uint32_t m = 0; m < UNTIE_WAYS && memory; m++)
            memory = see(c, &apart->move[m].scene, from, most, order[m]);
        for (uint32_t i = 0; i < most && memory; i++) {
            uint32_t at = c->active[from + i], m = 0;
            Root *r = &c->root[at], *s = stands_for(c, at);
            while (m < UNTIE_WAYS && !(order[m][i].told && order[m + 1][i].told)) m += 2;
            const bool told = m < UNTIE_WAYS;
            const Order both[2] = {order[told ? m : 0][i], order[told ? m + 1 : 0][i]};
            bool seen = told && (both[0].seen || both[1].seen);
            if (seen) memory = first ? keep_pair(c, r, s, both, m) : keep_order(c, r, s, both);
            else if (!told && r->between) memory = keep_between(c, r, s);
            else if (!told && r->x[r->axis] != s->x[s->axis]) c->active[kept++] = at;
        }
    }
    *n = kept;
    return memory;
}

/* Moves are as long as those that tell whose a jump is; in f32 these may be no longer than what rounds. */
static bool move_apart(Cells *c, uint32_t n) {
    if (!cells_ready_to_tie(c)) return false;
    const SltCullList *lists = c->b->args.cull; /* good where nothing has moved */
    bool memory = true;
    c->b->args.cull = NULL;
    for (uint32_t i = 0; i < CELL_LONGER + 1 && n && c->apart && memory; i++) {
        Apart **a = i ? &c->longer[i - 1] : &c->apart;
        if (!*a) memory = apart_new(c->s, c->apart->seed, c->apart->step * pow(LONGER, i), a);
        if (*a && memory) memory = move_by(c, *a, !i, &n);
    }
    use(c->b, c->s);
    c->b->args.cull = lists;
    return memory;
}

/* Does a root stand for it of which f on the two sides is known? That one may have gone itself, where three lie in a
 * row. */
static bool may_part(const Cells *c, uint32_t i) {
    if (!c->root[i].other || !is_site(c, &c->root[i])) return false;
    const Root *s = stands_for(c, i);
    return s->wanted && s->sides;
}

bool cells_part_twins(Cells *c) {
    uint32_t n = 0;
    if (!cells_grow(c, &c->active, &c->active_cap, c->nroot, sizeof *c->active)) return false;
    for (uint32_t i = 0; i < c->nroot; i++)
        if (may_part(c, i)) c->active[n++] = i;
    if (!n) return true;
    while (n)
        if (!look_between(c, &n)) return false;
    for (uint32_t i = 0; i < c->nroot; i++)
        if (may_part(c, i) && c->root[i].twin && stands_for(c, i)->twin) c->active[n++] = i;
    return !n || move_apart(c, n);
}

void cells_count_hidden(Cells *c, const Root *r) {
    Cell *cell = &c->cell[c->piece[c->column[r->column].piece].cell];
    if (cell->band || cell->rule == CELL_COARSE) return;
    double part = cell->weight / c->volume;
    for (uint32_t d = 0; d < c->dim; d++)
        if ((int)d != cell->slice) part *= cell->box.end[d] - cell->box.lo[d];
    cell->band = true, c->counts->banded += part;
}

void cells_count_band(Cells *c, const Root *r) {
    const Sides *s = cells_sides(c, r);
    if (memcmp(s[0].f[1], s[1].f[1], c->s->channels * sizeof(double))) cells_count_hidden(c, r);
}
