/* Rows of adjoints: a crossing moves an integral's channels by one and the same derivative of g, each with a weight of
 * its own. One sweep, with the seed 1, does for all; its adjoints are multiplied by the seed of each row as they go
 * out. Images have one row: what the others need stands in an if_ of its own at the end of each block. */
#include "compiler/pass/ad.h"

typedef struct Sums {
    Inst *adj, *value; /* value: for the seed 1 */
} Sums;

/* Seeds are 0 in lanes of the tail, where the derivative may be infinite. */
static Inst *of_row(Builder *b, Inst *value, uint32_t row) {
    return ir_emit2(b, OP_zmul, ir_input(b, (InputSlot)(IN_SEED0 + row)), value);
}

static void other_rows(Fn *fn, Block *block, const Sums *sums, uint32_t n, uint32_t rows) {
    Builder b = ir_at_end(fn, block);
    b.fold = true;
    Inst *several = ir_if(&b, ir_emit2(&b, OP_ilt, ir_consti(&b, 1), ir_input(&b, IN_ROWS)));
    for (uint32_t r = 0; r < 2; r++) {
        Builder in = ir_at_end(fn, several->region[r]);
        for (uint32_t row = 1; r == 0 && row < rows; row++)
            for (uint32_t k = 0; k < n; k++) {
                Imm at = sums[k].adj->imm;
                at.slot.base += row * fn->nfloats;
                Inst *value = of_row(&in, sums[k].value, row);
                ir_special(&in, OP_adj, TY_VOID, 2, (Inst *[]){sums[k].adj->args[0], value}, at);
            }
        ir_yield(&in, 0, NULL);
    }
}

static void block_rows(Fn *fn, Block *block, uint32_t rows) {
    Arena *scratch = &fn->session->scratch;
    ArenaMark mark = arena_mark(scratch);
    Vec(Sums) sums = {0};
    for (Inst *i = block->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) block_rows(fn, i->region[r], rows);
        if (i->op != OP_adj) continue;
        vec_push(scratch, &sums, ((Sums){i, i->args[1]}));
        Builder b = ir_before(fn, i);
        ir_replace_arg(i, 1, of_row(&b, i->args[1], 0));
    }
    if (sums.len) other_rows(fn, block, sums.data, sums.len, rows);
    arena_reset(scratch, mark);
}

void ad_rows(Fn *fn, uint32_t rows) { block_rows(fn, fn->body, rows); }
