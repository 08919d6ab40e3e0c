/* Rows of adjoints: one sweep for several seeds, those of the channels of an integral. Where the caller asks for one
 * row, the kernel does what it would without them.
 *
 * Of g: a crossing moves all channels by one and the same derivative, each with a weight of its own. The sweep has the
 * seed 1, and its adjoints are multiplied by the seed of each row as they go out. Of f: where each adjoint comes from
 * the seed of one channel alone (of colours, whose numbers are one a channel), it goes to the row of that channel. */
#include "compiler/pass/ad.h"

static void adj(Builder *b, const Inst *like, Inst *value, uint32_t row) {
    Imm at = like->imm;
    at.slot.base += row * b->fn->nfloats;
    ir_special(b, OP_adj, TY_VOID, 2, (Inst *[]){like->args[0], value}, at);
}

/* An if_ at the end of the block: region 0 is for several rows. */
static Inst *if_several(Fn *fn, Block *block) {
    Builder b = ir_at_end(fn, block);
    b.fold = true;
    return ir_if(&b, ir_emit2(&b, OP_ilt, ir_consti(&b, 1), ir_input(&b, IN_ROWS)));
}

/* ---- of g */
typedef struct Sum {
    Inst *adj, *value; /* value: for the seed 1 */
} Sum;
typedef Vec(Sum) Sums;

/* Seeds are 0 in lanes of the tail, where the derivative may be infinite. */
static Inst *of_row(Builder *b, Inst *value, uint32_t row) {
    return ir_emit2(b, OP_zmul, ir_input(b, (InputSlot)(IN_SEED0 + row)), value);
}

static void scale_block(Fn *fn, Block *block, uint32_t rows) {
    Arena *scratch = &fn->session->scratch;
    ArenaMark mark = arena_mark(scratch);
    Sums sums = {0};
    for (Inst *i = block->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) scale_block(fn, i->region[r], rows);
        if (i->op != OP_adj) continue;
        vec_push(scratch, &sums, ((Sum){i, i->args[1]}));
        Builder b = ir_before(fn, i);
        ir_replace_arg(i, 1, of_row(&b, i->args[1], 0));
    }
    Inst *several = sums.len ? if_several(fn, block) : NULL;
    for (uint32_t r = 0; r < 2 && several; r++) {
        Builder b = ir_at_end(fn, several->region[r]);
        for (uint32_t row = 1; r == 0 && row < rows; row++)
            for (uint32_t k = 0; k < sums.len; k++) adj(&b, sums.data[k].adj, of_row(&b, sums.data[k].value, row), row);
        ir_yield(&b, 0, NULL);
    }
    arena_reset(scratch, mark);
}

void ad_scale_rows(Fn *fn, uint32_t rows) { scale_block(fn, fn->body, rows); }

/* ---- of f */
typedef struct Seeds {
    uint8_t *of; /* by id: which seeds the value hangs on, of an array any of its elements; bits */
    bool changed, mixed;
} Seeds;

static void hangs_on(Seeds *s, const Inst *v, uint32_t seeds) {
    if (seeds & ~s->of[v->id]) s->of[v->id] |= (uint8_t)seeds, s->changed = true;
}

/* Loops of both kinds: parameters of the body, in front of which are its index or the numbers of a frame. */
static void seeds_around(Seeds *s, const Inst *loop) {
    const Block *body = loop->region[0];
    uint32_t carried = ir_nresults(loop), front = body->nparams - carried;
    if (!carried) return; /* then there may be no list of arguments */
    Inst *const *init = loop->args + (loop->nargs - carried), **next = walk_results(loop, body);
    for (uint32_t c = 0; c < carried; c++)
        hangs_on(s, body->params[front + c], s->of[init[c]->id] | s->of[next[c]->id]);
}

static void seeds_in(Seeds *s, const Block *block) {
    for (const Inst *i = block->first; i; i = i->next) {
        uint32_t seeds = 0;
        if (i->op == OP_loop || i->op == OP_revloop) seeds_around(s, i);
        if (i->op == OP_loop) s->mixed |= s->of[i->region[0]->last->args[0]->id] != 0;
        for (uint32_t r = 0; r < i->nregions; r++) seeds_in(s, i->region[r]);
        if (i->op == OP_yield || i->op == OP_any) continue; /* it rules out what is 0 of all rows */
        if (i->op == OP_input && i->imm.i >= IN_SEED0 && i->imm.i < IN_SEED0 + SLT_MAX_CHANNELS)
            seeds = 1u << (i->imm.i - IN_SEED0);
        for (uint32_t a = 0; a < i->nargs; a++) seeds |= s->of[i->args[a]->id];
        if (i->op == OP_proj) {
            const Inst *of = i->args[0];
            for (uint32_t r = 0; r < of->nregions; r++) seeds |= s->of[walk_results(of, of->region[r])[i->imm.i]->id];
        }
        if (i->op == OP_store || i->op == OP_acopy) hangs_on(s, i->args[0], seeds);
        if (i->op == OP_adj) s->mixed |= (seeds & (seeds - 1)) != 0;
        else if (i->op == OP_if_ || i->op == OP_tapepush) s->mixed |= seeds != 0; /* adjoints do not decide, nor wait */
        else if (!i->nregions) hangs_on(s, i, seeds);
    }
}

static void part_block(Fn *fn, Block *block, const Seeds *s) {
    Arena *scratch = &fn->session->scratch;
    ArenaMark mark = arena_mark(scratch);
    Vec(Inst *) later = {0};
    for (Inst *i = block->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) part_block(fn, i->region[r], s);
        if (i->op == OP_adj && s->of[i->args[1]->id] > 1) vec_push(scratch, &later, i);
    }
    Inst *several = later.len ? if_several(fn, block) : NULL;
    for (uint32_t r = 0; r < 2 && several; r++) {
        Builder b = ir_at_end(fn, several->region[r]);
        for (uint32_t k = 0; k < later.len; k++) {
            Inst *i = later.data[k];
            adj(&b, i, i->args[1], r == 0 ? (uint32_t)__builtin_ctz(s->of[i->args[1]->id]) : 0);
        }
        ir_yield(&b, 0, NULL);
    }
    for (uint32_t k = 0; k < later.len; k++) ir_unlink(later.data[k]);
    arena_reset(scratch, mark);
}

bool ad_part_rows(Fn *fn) {
    Arena *scratch = &fn->session->scratch;
    ArenaMark mark = arena_mark(scratch);
    Seeds s = {.of = ARENA_ARRAY(scratch, uint8_t, ir_number(fn) + 1)};
    do {
        s.changed = false;
        seeds_in(&s, fn->body);
    } while (s.changed && !s.mixed);
    if (!s.mixed) part_block(fn, fn->body, &s);
    arena_reset(scratch, mark);
    return !s.mixed;
}
