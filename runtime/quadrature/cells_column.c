/* Pieces of the base become columns at Gauss points, and these roots, crossings and points of the volume. */
#include <math.h>
#include <string.h>

#include "runtime/quadrature/cells_inner.h"

/* ---- what goes out */
static void flush_crossings(Cells *c, CellRule r) {
    uint32_t n = c->ncrossing[r];
    c->ncrossing[r] = 0;
    if (n) c->sink->curve(c->sink->user, c->crossing[r], n);
}

void cells_flush(Cells *c) {
    for (int r = 0; r < CELL_RULES; r++) flush_crossings(c, (CellRule)r);
    cells_flush_points(c);
}

/* ---- columns */
static Column *add_column(Cells *c, uint32_t piece, uint8_t rule, const double x[3], double weight) {
    if (!CELLS_ROOM(c, column, 1)) return NULL;
    Column *k = &c->column[c->ncolumn++];
    *k = (Column){.piece = piece, .rule = rule, .weight = weight, .first = c->nroot};
    for (uint32_t d = 0; d < c->dim; d++) k->x[d] = cells_round(c, x[d]);
    return k;
}

/* The root of an edge in the column that was added last; the search begins at `guess`. */
static bool add_root(Cells *c, Column *k, uint32_t edge, double guess) {
    const Piece *p = &c->piece[k->piece];
    const Cell *cell = &c->cell[p->cell];
    Root *r = cells_root(c, cell, &cell->edge[edge], p->axis, k->x, guess);
    if (!r) return false;
    r->column = (uint32_t)(k - c->column), r->edge = (uint8_t)edge;
    k->nroots++;
    return true;
}

/* ---- pieces */
/* Bit by edge: those whose curve is asked for along this axis. */
static uint32_t wanted(const Cells *c, const Piece *p) {
    const Cell *cell = &c->cell[p->cell];
    uint32_t bits = 0;
    if (p->alone) return 1u << p->only;
    for (uint32_t e = 0; e < cell->nedges; e++)
        if (cell->edge[e].axis == p->axis && (c->o->volume || (uint32_t)cell->edge[e].event.site < c->s->nsites ||
                                              cells_upsets(c, cell->edge[e].event.site)))
            bits |= 1u << e;
    return bits;
}

static void middle(const Cells *c, const Piece *p, double x[3]) {
    for (uint32_t d = 0; d < c->dim; d++) x[d] = 0.5 * (p->at[d][0] + p->at[d][1]);
}

static double guess_height(const Probe at[2], int axis) {
    return cells_between((double[2]){at[0].x[axis], at[1].x[axis]}, (double[2]){at[0].g, at[1].g},
                         (double[2]){at[0].dg[axis], at[1].dg[axis]});
}

/* Which curves are there: g has different signs at the two ends of the column above the middle. Where the corners of
 * the cell tell, nothing is asked. */
static bool find_present(Cells *c, uint32_t first) {
    c->nprobe = 0;
    for (uint32_t i = first; i < c->npiece; i++) {
        Piece *p = &c->piece[i];
        const Cell *cell = &c->cell[p->cell];
        double x[3] = {0};
        middle(c, p, x);
        p->present = p->asked = 0;
        for (uint32_t set = wanted(c, p), e; cells_take_edge(&set, &e);) {
            const CellEdge *edge = &cell->edge[e];
            bool present;
            if (p->base >= 0 && cells_told_by_corners(edge, x[p->base], &present)) {
                if (present) p->edge[e].height = cells_height_by_corners(cell, edge, p->base, x[p->base]);
                p->present |= (uint32_t)present << e;
                continue;
            }
            p->asked |= 1u << e;
            for (int s = 0; s < 2; s++) {
                x[p->axis] = s ? cell->box.hi[p->axis] : cell->box.lo[p->axis];
                if (!cells_probe_or_tell(c, edge, x)) return false;
            }
        }
    }
    if (!cells_run_probes(c)) return false;
    const Probe *at = c->probe;
    for (uint32_t i = first; i < c->npiece; i++) {
        Piece *p = &c->piece[i];
        for (uint32_t set = p->asked, e; cells_take_edge(&set, &e); at += 2) {
            if (cells_spans(&c->cell[p->cell].edge[e], p->axis, at[0].g, at[1].g)) p->present |= 1u << e;
            p->edge[e].height = guess_height(at, p->axis); /* NaN where it is not there, or a slope is 0 */
        }
    }
    return true;
}

static bool is_site(const Cells *c, const Piece *p, uint32_t e) {
    return (uint32_t)c->cell[p->cell].edge[e].event.site < c->s->nsites;
}

/* Those wanted on which other curves lie, and whose sides differ: whose the jump is. */
static bool tie_roots(Cells *c) {
    uint32_t n = 0;
    for (uint32_t i = 0; i < c->nroot; i++) {
        const Root *r = &c->root[i];
        if (!r->wanted || !r->twin || cells_sides(c, r)->hash[0] == cells_sides(c, r)->hash[1]) continue;
        c->active[n++] = i;
    }
    return !n || cells_tie(c, n);
}

/* Whose it is, the middle of a piece tells for all of it; how much, only where f is flat; and not
 * where it is after a move. */
static bool tie_columns(Cells *c) {
    uint32_t n = 0;
    for (uint32_t i = 0; i < c->nroot; i++) {
        const Tie *t = c->root[i].tie ? &c->tie[c->root[i].tie - 1] : NULL;
        if (t && !t->untold && !t->bent && (t->naway || (!c->o->flat && !t->whole))) c->active[n++] = i;
    }
    return (!n || cells_tie(c, n)) && cells_follow_kinks(c);
}

/* Does f come about in the same way on both sides, all along the piece? Where it is flat, nothing then needs to be
 * known of the curve. */
static bool is_hidden(const Cells *c, const Piece *p, const Root *r) {
    if (!c->o->flat || !r->wanted || r->twin || r->band || !is_site(c, p, r->edge)) return false;
    return cells_sides(c, r)->hash[0] == cells_sides(c, r)->hash[1];
}

#define APART 0x1p-6 /* of the height of a cell: so far from each other curves are surely not one, */
#define TOLD 0x1p-14 /* and so much nearer they can still be told apart */

static bool is_apart(const Piece *p, uint32_t e, double apart) {
    for (uint32_t others = p->present & ~(1u << e), f; cells_take_edge(&others, &f);)
        if (!(fabs(p->edge[e].height - p->edge[f].height) > apart)) return false;
    return true;
}

/* Where areas are told by borders: curves of a piece that were those of the one before, and which nothing has met since
 * then, have the sides that they had there. */
static void find_heirs(Cells *c, uint32_t first) {
    for (uint32_t i = first; i < c->npiece; i++) {
        Piece *p = &c->piece[i], *q = p - 1;
        const Cell *cell = &c->cell[p->cell];
        p->heirs = p->seen = 0;
        if (i == first || !cell->borders || p->alone || q->alone || q->cell != p->cell || q->axis != p->axis) continue;
        if (q->at[q->base][1] != p->at[p->base][0]) continue;
        double apart = APART * (cell->box.end[p->axis] - cell->box.lo[p->axis]);
        p->heirs = p->present & q->present & ~(p->begins | p->asked | q->asked);
        /* In the one before, too: where several meet in a point pieces between them may be as short as rounding. */
        for (uint32_t set = p->heirs, e; cells_take_edge(&set, &e);)
            if (!is_apart(p, e, apart) || !is_apart(q, e, TOLD * apart)) p->heirs &= ~(1u << e);
    }
}

/* Behind the roots of all pieces. */
static void inherit(Cells *c, uint32_t first) {
    for (uint32_t i = first + 1; i < c->npiece; i++) {
        Piece *p = &c->piece[i], *q = p - 1;
        for (uint32_t set = p->heirs, e; cells_take_edge(&set, &e);) {
            double told = p->edge[e].height;
            if (!(q->present >> e & 1)) p->present &= ~(1u << e);
            if (!(q->seen >> e & 1)) continue;
            p->seen |= 1u << e;
            p->edge[e] = q->edge[e], p->edge[e].middle = told + q->edge[e].off;
        }
    }
}

/* Must the sides of a root lie next to it? What f is there is what it is a little farther off, but where it may have a
 * root singularity at the curve, or where other curves are near. */
static bool lies_next(const Cells *c, const Piece *p, const Root *r) {
    bool rough = c->cell[p->cell].state & SLT_BOX_ROUGH;
    return !c->o->flat && (c->dim != 2 || c->slack > 0 || rough || r->twin || r->band);
}

/* The column above the middle of each piece: where the curves are there, and which of them change the region. */
static bool look_at_middles(Cells *c, uint32_t first) {
    find_heirs(c, first);
    c->ncolumn = c->nroot = c->nsides = c->ntie = 0;
    for (uint32_t i = first; i < c->npiece; i++) {
        const Piece *p = &c->piece[i];
        double x[3] = {0};
        middle(c, p, x);
        Column *k = add_column(c, i, CELL_FINE, x, 0);
        if (!k) return false;
        for (uint32_t set = p->present & ~p->heirs, e; cells_take_edge(&set, &e);) {
            if (!add_root(c, k, e, p->edge[e].height)) return false;
            Root *r = &c->root[c->nroot - 1];
            if (lies_next(c, p, r)) r->slack = -1;
            r->turns = c->slack;
        }
    }
    if (!cells_solve(c) || !cells_drop_wrong(c)) return false;
    if (!cells_find_twins(c)) return false;
    for (uint32_t i = 0; i < c->nroot; i++) {
        Root *r = &c->root[i];
        if (!(c->piece[c->column[r->column].piece].present >> r->edge & 1)) continue;
        const Piece *p = &c->piece[c->column[r->column].piece];
        r->wanted = !c->cell[p->cell].curves_done &&
                    ((c->o->curves && is_site(c, p, r->edge)) || cells_upsets(c, r->of->event.site));
    }
    if (!cells_take_sides(c) || !cells_part_twins(c) || !tie_roots(c) || !cells_find_kinks(c)) return false;
    for (uint32_t i = 0; i < c->nroot; i++) {
        const Root *r = &c->root[i];
        Piece *p = &c->piece[c->column[r->column].piece];
        PieceEdge *e = &p->edge[r->edge];
        if (!(p->present >> r->edge & 1)) continue;
        e->off = p->asked >> r->edge & 1 ? NAN : r->x[p->axis] - e->height;
        e->at = r->x[p->base < 0 ? 0 : p->base], e->middle = r->x[p->axis];
        if (r->wanted && r->sides) p->seen |= 1u << r->edge;
        e->twin = r->twin, e->height = r->x[p->axis], e->g = r->g, e->sides = r->sides, e->tie = r->tie;
        e->band = r->band;
        memcpy(e->dg, r->dg, sizeof e->dg);
        e->upset = r->wanted && cells_is_upset(c, r);
        e->open = r->wanted && is_site(c, p, r->edge) && cells_sides(c, r)->hash[0] != cells_sides(c, r)->hash[1];
        if (!e->open && !e->upset && (!c->o->volume || is_hidden(c, p, r))) p->present &= ~(1u << r->edge);
    }
    inherit(c, first);
    return true;
}

/* How high a curve is at a place: as corners tell, put right by what they tell where it is known, or along its tangent
 * there. */
static double guess_beside(const Cells *c, const Piece *p, uint32_t e, double at) {
    const Cell *cell = &c->cell[p->cell];
    const PieceEdge *edge = &p->edge[e];
    double told = cells_height_by_corners(cell, &cell->edge[e], p->base, at) + edge->off; /* NaN: they did not tell */
    return !isnan(told) ? told : edge->height - edge->dg[p->base] / edge->dg[p->axis] * (at - edge->at);
}

/* The roots of a column at `along` from the middle of the piece; of the middle itself they are known. */
static bool add_roots(Cells *c, uint32_t piece, Column *k, double along) {
    const Piece *p = &c->piece[piece];
    for (uint32_t set = p->present, e; cells_take_edge(&set, &e);) {
        const PieceEdge *edge = &p->edge[e];
        bool known = along == 0 && (p->base < 0 || k->x[p->base] == edge->at);
        bool told = c->cell[p->cell].edge[e].quadric.is; /* wherever it begins */
        if (!add_root(c, k, e, known || told ? edge->height : guess_beside(c, p, e, k->x[p->base]))) return false;
        Root *r = &c->root[c->nroot - 1];
        r->twin = edge->twin, r->wanted = edge->open, r->tie = edge->tie;
        r->band = edge->band;
        if (c->o->flat || (known && (c->b->f64 || k->rule == CELL_FINE)) || r->band) r->sides = edge->sides;
        bool next = r->wanted && !r->sides && lies_next(c, p, r);
        r->slack = next || r->of->state & SLT_EDGE_BENDS ? -1 : c->slack > 0 ? c->slack : r->slack;
        if (!known) continue;
        r->x[p->axis] = edge->height, r->g = edge->g, r->solved = true;
        memcpy(r->dg, edge->dg, sizeof r->dg);
    }
    return true;
}

static double length_of(const Piece *p) { return p->base < 0 ? 0 : p->at[p->base][1] - p->at[p->base][0]; }

/* The columns of a piece and rule: in 1D the one there is, else at Gauss points of the base. */
static bool add_columns(Cells *c, uint32_t piece, CellRule rule) {
    const GaussRule *g = cells_rule_of(c, &c->piece[piece], rule);
    const Cell *cell = &c->cell[c->piece[piece].cell];
    if (cell->rule >= 0 && cell->rule != (int8_t)rule) return true;
    for (uint32_t i = 0; i < (c->piece[piece].base < 0 ? g->n > 0 : g->n); i++) {
        const Piece *p = &c->piece[piece];
        double x[3] = {0}, along = 0, weight = cell->weight;
        middle(c, p, x);
        if (p->base >= 0) {
            double length = p->at[p->base][1] - p->at[p->base][0];
            double pace = 1, at = p->turn > 0 ? cells_along_base(p, g->x[i], &pace) : g->x[i];
            if (2 * i + 1 != g->n || p->turn > 0) along = (at - 0.5) * length;
            x[p->base] += along, weight *= g->w[i] * pace * length;
        }
        Column *k = add_column(c, piece, (uint8_t)rule, x, weight);
        if (!k || !add_roots(c, piece, k, along)) return false;
    }
    return true;
}

#define STRAIGHT 0x1p-30 /* of the height of a cell: so little a curve departs from its tangent */

/* On the cubic through two roots with their slopes. */
static double on_cubic(const Piece *p, const Root *a, const Root *b, double at) {
    double width = b->x[p->base] - a->x[p->base], t = (at - a->x[p->base]) / width, u = 1 - t;
    double climb[2] = {-a->dg[p->base] / a->dg[p->axis], -b->dg[p->base] / b->dg[p->axis]};
    return u * u * (1 + 2 * t) * a->x[p->axis] + t * t * (3 - 2 * t) * b->x[p->axis] +
           t * u * width * (u * climb[0] - t * climb[1]);
}

/* By how much a guess there is wrong, as it was at two roots. */
static double wrong_by(const Piece *p, const Root *a, const Root *b, double at) {
    double t = (at - a->x[p->base]) / (b->x[p->base] - a->x[p->base]);
    return (1 - t) * (a->x[p->axis] - a->guess) + t * (b->x[p->axis] - b->guess);
}

/* Roots of the fine rule are solved: of those of the coarse one they tell more, for the points of rules of n and n - 1
 * points alternate. Where corners made the guesses they are put right, else they are taken from cubics. */
static void guess_coarse(Cells *c, const Column *from, const Column *to) {
    const Piece *p = &c->piece[from->piece];
    const Column *coarse = from;
    while (coarse < to && coarse->rule == CELL_FINE) coarse++;
    bool alternate = p->base >= 0 && coarse - from == to - coarse + 1;
    for (uint32_t k = 0; coarse + k < to; k++)
        for (uint32_t i = 0; i < coarse[k].nroots; i++) {
            Root *r = &c->root[coarse[k].first + i];
            r->waits = false;
            if (r->solved || !alternate) continue;
            const Root *a = &c->root[from[k].first + i], *b = &c->root[from[k + 1].first + i];
            bool told = !isnan(p->edge[r->edge].off);
            double guess = told ? r->guess + wrong_by(p, a, b, r->x[p->base]) : on_cubic(p, a, b, r->x[p->base]);
            /* Of a straight curve the guess from the middle is the better one. */
            bool straight = !told && fabs(guess - r->guess) <= STRAIGHT * (r->hi - r->lo);
            if (!straight && guess > r->lo && guess < r->hi) r->x[p->axis] = cells_round(c, guess);
        }
}

static bool solve_columns(Cells *c, const uint32_t *first, uint32_t pieces) {
    for (uint32_t i = 0; i < c->nroot; i++) c->root[i].waits = c->column[c->root[i].column].rule == CELL_COARSE;
    if (!cells_solve(c)) return false;
    for (uint32_t i = 0; i < pieces; i++)
        if (first[i] < first[i + 1]) guess_coarse(c, &c->column[first[i]], &c->column[first[i + 1]]);
    return cells_solve(c);
}

void cells_crossing(const Cells *c, const Root *r, Crossing *x) {
    const Sides *s = cells_sides(c, r);
    uint32_t below = r->rises > 0 ? 0 : 1; /* the side where g < 0 */
    x->event = r->of->event;
    if (cells_is_wave(c->s, r->of->event.site)) x->event.boundary = 0; /* a level, which only the edge kernels know */
    memcpy(x->x, r->x, sizeof x->x), memcpy(x->dg, r->dg, sizeof x->dg);
    x->g = r->g;
    for (uint32_t ch = 0; ch < c->s->channels; ch++)
        x->before[ch] = s->f[below][ch], x->jump[ch] = s->f[!below][ch] - s->f[below][ch];
    x->ha = s->hash[below], x->hb = s->hash[!below];
    x->axis = r->axis, x->rising = 1;
}

Crossing *cells_add_crossing(Cells *c, uint8_t rule) {
    if (c->ncrossing[rule] == BATCH) flush_crossings(c, (CellRule)rule);
    Crossing *x = &c->crossing[rule][c->ncrossing[rule]++];
    x->cls = rule, x->apart = NULL, x->move = 0; /* cells_emit_away sets these */
    return x;
}

static void emit_crossing(Cells *c, const Root *r) {
    const Column *k = &c->column[r->column];
    Crossing *x = cells_add_crossing(c, k->rule);
    if (r->band) cells_count_band(c, r);
    if (r->band && k->rule == CELL_COARSE) { /* cells_part_twins */
        Root of = *r;
        of.sides++;
        cells_crossing(c, &of, x);
    } else cells_crossing(c, r, x);
    x->weight = k->weight / fabs(r->dg[r->axis]) * (k->rule == CELL_COARSE ? 1 + r->blur : 1);
}

enum { PIECE_STEEP = 4 };

/* What to try next with a piece on which the rules differ. Where f alone is to blame it may have a root singularity at
 * a curve; else its base or its columns are too long. */
static bool shorten(Cells *c, uint32_t i, bool curves_agree, bool layer, const Column *from, const Column *to) {
    Piece *p = &c->piece[i];
    bool columns = c->dim == 1 || layer;
    c->cell[p->cell].cuts++;
    uint32_t before = p->points, full = c->rule[CELL_FINE].n;
    if (before < full && !layer) {
        p->points = 0;
        cells_choose_points(c, p);
        p->points = (uint8_t)(p->points > before ? p->points : full);
        return true;
    }
    if (curves_agree && !p->graded && !c->o->flat) {
        p->graded = true;
        return true;
    }
    if (curves_agree && !columns && !c->o->flat && !cells_columns_differ(c, from, to, &columns)) return false;
    if (layer && c->dim > 1) p->layered = true;
    if (columns) p->parts *= 2;
    else p->halve = true;
    return true;
}

/* The halves of a piece whose base is too long. */
static bool cut_piece(Cells *c, const Piece *p) {
    for (int half = 0; half < 2; half++) {
        if (!CELLS_ROOM(c, piece, 1)) return false;
        Piece *q = &c->piece[c->npiece++];
        *q = *p;
        q->at[p->base][!half] = 0.5 * (p->at[p->base][0] + p->at[p->base][1]);
        q->beyond[!half] = 0, q->leaving[!half] = -1, q->meet[!half] = 0, q->within[!half] = true;
        q->points = 0;
        q->halvings++;
    }
    return true;
}

bool cells_evaluate(Cells *c, uint32_t first) {
    uint32_t n = c->npiece - first;
    if (!find_present(c, first) || !look_at_middles(c, first)) return false;
    if (c->o->flat && !cells_part_borders(c, first)) return false;
    n = c->npiece - first;
    c->ncolumn = c->nroot = c->nspot = c->narc = c->narc_point = 0;
    if (!cells_grow(c, &c->first_column, &c->first_column_cap, n + 1, sizeof *c->first_column)) return false;
    for (uint32_t i = 0; i < n; i++) {
        Piece *p = &c->piece[first + i];
        bool arc;
        c->first_column[i] = c->ncolumn;
        cells_choose_points(c, p);
        if (!cells_add_arc(c, p, &arc)) return false;
        for (int r = 0; r < CELL_RULES && !arc; r++)
            if ((p->present || c->o->volume) && !add_columns(c, first + i, (CellRule)r)) return false;
    }
    c->first_column[n] = c->ncolumn;
    if (!solve_columns(c, c->first_column, n)) return false;
    cells_drop_bent(c, first, n);
    return cells_take_sides(c) && tie_columns(c);
}

bool cells_emit_columns(Cells *c, const Column *from, const Column *to) {
    bool tied = false;
    if (!cells_round_roots(c, from, to)) return false;
    for (const Column *k = from; k < to; k++)
        for (uint32_t r = 0; r < k->nroots; r++) {
            const Root *root = &c->root[k->first + r];
            tied |= root->tie && root->wanted;
            if (root->wanted && !root->tie) emit_crossing(c, root);
        }
    return !tied || cells_emit_tied(c, from, to);
}

/* The part of its cell that a piece is, cut further; false: it is too small for that, or no part by itself. */
static bool put_back(Cells *c, const Piece *p) {
    const Cell *cell = &c->cell[p->cell];
    Box part = cell->box;
    if (c->dim > 2 || cell->slice >= 0 || !cells_may_divide(c, cell) || p->beyond[0] || p->beyond[1]) return false;
    if (p->base >= 0) {
        int d = p->base;
        part.lo[d] = cells_round(c, p->at[d][0]), part.end[d] = cells_round(c, p->at[d][1]);
        if (part.end[d] < part.hi[d]) part.hi[d] = part.end[d];
        if (!(part.lo[d] < part.hi[d])) return false;
    }
    return cells_put_back(c, cell, &part);
}

void cells_copy_piece(Cells *c, uint32_t to, uint32_t from) {
    const Piece *p = &c->piece[from];
    memcpy(&c->piece[to], p, offsetof(Piece, edge));
    for (uint32_t set = p->present, e; cells_take_edge(&set, &e);) c->piece[to].edge[e] = p->edge[e];
}

/* What f, as taken at their points, says of pieces: Piece.smooth, and where it may be steep unseen. */
static bool judge_values(Cells *c, uint32_t first, uint32_t n) {
    for (uint32_t i = 0; i < n; i++) {
        Piece *p = &c->piece[first + i];
        const Column *from = &c->column[c->first_column[i]], *to = &c->column[c->first_column[i + 1]];
        p->layer = p->hides = false;
        if (!p->agrees || p->spots[0] == p->spots[1]) continue;
        p->layer = p->smooth && cells_layer(c, p, from, to, false) > 0, p->smooth &= !p->layer;
        /* Beside its curves f may be steep: then that is a matter for smaller cells, not for longer columns. */
        bool asks = !c->cell[p->cell].curves_done && (p->smooth || (!p->layer && p->parts >= PIECE_STEEP));
        if (asks && !p->smooth && c->dim < 2) p->hides = true;
        else if (asks && !cells_ask_beside(c, first + i, from, to)) return false;
    }
    cells_find_hidden(c);
    return true;
}

/* Integrates over the pieces from `first` on, and puts in their place those that must be halved. */
static bool integrate(Cells *c, uint32_t first) {
    bool compare = !c->o->fixed && c->rule[CELL_COARSE].n;
    if (!cells_evaluate(c, first)) return false;
    uint32_t n = c->npiece - first, kept = first;
    double bent = 0, length = 0;
    cells_compare_curves(c, first, n, compare);
    bool values = compare && c->o->volume && !c->o->flat;
    if (values && (!cells_take_points(c, first, n) || !judge_values(c, first, n))) return false;
    if (c->o->volume && !values && !cells_add_points(c, first)) return false;
    for (uint32_t i = 0; i < n; i++) {
        Piece *p = &c->piece[first + i];
        const Column *from = &c->column[c->first_column[i]], *to = &c->column[c->first_column[i + 1]];
        const uint32_t spot = p->spots[0], end = p->spots[1];
        bool agree = p->agrees, smooth = p->smooth, layer = values && p->layer;
        if (p->bend > 0 && !(p->turn > 0)) bent += p->bend * length_of(p), length += length_of(p);
        if (compare && c->o->flat && c->o->volume && !p->alone && !p->arc) smooth = cells_parts_agree(c, spot, end);
        if (values && p->hides && put_back(c, p)) continue;
        if ((agree && smooth) || p->last || (agree && cells_spent(c))) {
            if (!cells_emit_columns(c, from, to)) return false;
            if (p->graded) cells_doubt_rims(c, from, to, spot, end);
            cells_emit_beyond(c, p);
            cells_add_upset(c, p, NULL);
            bool asked = values && end > spot && (layer || !agree || !smooth);
            if (asked && !c->cell[p->cell].curves_done) cells_layer(c, p, from, to, true);
            if (p->arc) cells_emit_arc(c, p);
            else if (p->alone) cells_emit_borders(c, p, from, to);
            else if (c->o->flat) cells_emit_parts(c, spot, end);
            else cells_emit_spots(c, spot, end, compare);
        } else {
            if (!shorten(c, first + i, agree, layer, from, to)) return false;
            if (kept != first + i) cells_copy_piece(c, kept, first + i);
            kept++;
        }
    }
    if (length > 0) c->bend = c->bend > 0 ? 0.5 * (c->bend + bent / length) : bent / length;
    c->npiece = kept;
    for (uint32_t i = first; i < kept; i++) {
        Piece p = c->piece[i];
        if (!p.halve) continue;
        p.halve = false;
        uint32_t last = c->npiece;
        if (!cut_piece(c, &p)) return false;
        c->piece[i] = c->piece[last], c->piece[last] = c->piece[last + 1], c->npiece--;
    }
    return true;
}

bool cells_integrate(Cells *c) {
    enum { AT_ONCE = 64 }; /* pieces */
    while (c->npiece) {
        uint32_t first = c->npiece > AT_ONCE ? c->npiece - AT_ONCE : 0;
        while (first && c->piece[first].cell == c->piece[first - 1].cell && !c->piece[first].alone) first--;
        if (!integrate(c, first)) return false;
    }
    return true;
}
