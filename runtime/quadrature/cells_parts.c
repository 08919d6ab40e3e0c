/* How many points a column gets between its roots. Its length alone says how many f may need there; how many it does
 * need, what the two rules make of the pieces before tells: of parts with one hash f is one formula. A part on which f
 * is constant needs hardly any, and one that varies slowly not many more. */
#include <string.h>

#include "runtime/quadrature/cells_inner.h"

enum { FIRST = 3, LEAST = 2, TRIES = 4 };

/* Does f itself tell? Its derivatives are not asked, and may vary where it does not: then it tells only by how far it
 * needs less than its length says, and nothing where it is constant. */
static bool tells(const Cells *c) { return c->s->rigid; }

/* Of a program with lists bounds may not be asked what fewer points do not see. */
static bool may_cap(const Cells *c, const Piece *p) {
    return c->o->fewer && cells_may_ask(c) && !p->graded && p->parts == 1 && p->tries < TRIES &&
           c->rule[CELL_FINE].n > LEAST;
}

static Depth *depth_of(Cells *c, bool known, uint32_t hash) {
    Depth *d = &c->deep[known ? hash % CELL_SHAPES : CELL_SHAPES];
    if (!d->used || (known && d->hash != hash))
        *d = (Depth){.used = true, .hash = hash, .points = tells(c) ? FIRST : GAUSS_MAX, .least = LEAST};
    return d;
}

/* Those of the parts of a piece; how many these are. */
static uint32_t depths_of(Cells *c, const Column *k, Depth *depth[CELL_EDGES + 1]) {
    bool known[CELL_EDGES + 1] = {false};
    uint32_t hash[CELL_EDGES + 1] = {0}, parts = k->nroots + 1;
    cells_part_hashes(c, k, known, hash);
    for (uint32_t i = 0; i < parts; i++) depth[i] = depth_of(c, known[i], hash[i]);
    return parts;
}

static bool fill(Cells *c, uint32_t i, Column *from, Column *to) {
    uint32_t most[CELL_EDGES + 1];
    Depth *depth[CELL_EDGES + 1];
    Piece *p = &c->piece[i];
    if (from == to || !may_cap(c, p)) return cells_fill_piece(c, i, from, to, NULL);
    uint32_t parts = depths_of(c, from, depth);
    for (uint32_t k = 0; k < parts; k++) most[k] = depth[k]->points;
    return cells_fill_piece(c, i, from, to, most);
}

/* Bit by part: f is not the same at all places of it. Those from bit 31 on are taken together. */
static uint32_t varying(const Cells *c, const Piece *p) {
    const Spot *first[CELL_EDGES + 1] = {NULL};
    uint32_t bits = 0;
    for (const Spot *s = c->spot + p->spots[0]; s < c->spot + p->spots[1]; s++) {
        if (!first[s->part]) first[s->part] = s;
        for (uint32_t ch = 0; ch < c->s->channels; ch++)
            if (s->f[ch] != first[s->part]->f[ch]) bits |= cells_part_bit(s->part);
    }
    return bits;
}

/* What the two rules make of a piece with fewer points tells how many the next ones get. True: this one needs more. */
static bool learn(Cells *c, const Piece *p, const Column *from) {
    Depth *depth[CELL_EDGES + 1];
    uint32_t parts = depths_of(c, from, depth), vary = varying(c, p);
    bool fewer = false;
    for (uint32_t k = 0; k < parts && p->smooth; k++)
        fewer |= vary & cells_part_bit(k) && depth[k]->points >= p->depth && p->depth > depth[k]->least;
    fewer = fewer && cells_values_agree(c, p->spots[0], p->spots[1], CELL_FEWER);
    for (uint32_t k = 0; k < parts; k++) {
        Depth *d = depth[k];
        bool varies = vary & cells_part_bit(k), more = !p->smooth && varies && p->capped & cells_part_bit(k);
        if (p->smooth && !varies && tells(c)) d->points = d->least;
        else if (more && d->points <= p->depth) d->points = d->least = p->depth + 1;
        else if (fewer && varies && d->points >= p->depth && p->depth > d->least) d->points = p->depth - 1;
    }
    return !p->smooth && (vary & p->capped);
}

bool cells_take_points(Cells *c, uint32_t first, uint32_t n) {
    uint32_t waiting = n, taken = c->nspot;
    for (uint32_t i = 0; i < n; i++) c->piece[first + i].again = true, c->piece[first + i].tries = 0;
    while (waiting) {
        for (uint32_t i = 0; i < n; i++) {
            Piece *p = &c->piece[first + i];
            Column *from = &c->column[c->first_column[i]], *to = &c->column[c->first_column[i + 1]];
            if (!p->again) continue;
            p->spots[0] = p->spots[1] = c->nspot, p->capped = p->depth = 0;
            if ((p->agrees || p->last) && !fill(c, first + i, from, to)) return false;
        }
        if (!cells_take_values(c, taken)) return false;
        taken = c->nspot, waiting = 0;
        for (uint32_t i = 0; i < n; i++) {
            Piece *p = &c->piece[first + i];
            if (!p->again) continue;
            bool any = p->spots[1] > p->spots[0];
            p->smooth = !any || cells_values_agree(c, p->spots[0], p->spots[1], 1);
            p->again = any && may_cap(c, p) && learn(c, p, &c->column[c->first_column[i]]);
            p->tries += p->again, waiting += p->again;
        }
    }
    return true;
}
