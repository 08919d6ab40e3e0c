/* Edge kernels of a straight-line program in chunks (variant_chunks.c): g of its sites, and of its choices.
 *
 * A g that is thousands of operations long bends wherever one of its choices does. Seams for all of these, with a slice
 * of the program each, would be its square; but where a choice is made its two sides are at hand. So the one program
 * answers for every edge: its sites are captured, and behind them choice #c is edge nsites + c, whose g is the
 * difference of what it compares:
 *
 *     %n = live #chunk;  if_ %n { ...  if_ (site == nsites + c) { give [nexports], %a - %b; yield } { yield }  ... }
 *
 * Which choices are open in a box is what `bounds` notes, and to give a decision is to call it settled: neither costs
 * an operation here. Forward AD and the bounds transformation work on chunks as they stand, so the derivative is as
 * short as what runs. */
#include "compiler/pass/variant.h"

/* What was made of a choice: settled 2c+1 ? second : settled 2c ? first : the min, max or select itself. */
static Inst *made_of(Inst *choice) {
    for (Inst *i = choice->prev; i; i = i->prev) {
        const Inst *by = ir_ops[i->op].selects ? i->args[0] : NULL;
        if (by && by->op == OP_settled && by->imm.i == 2 * choice->imm.i + 1) return i;
    }
    return NULL;
}

/* The same as one select by a decision that may be given (variant_given.c): a tangent of it is one more, and on boxes
 * neither costs what three do. */
static void select_once(Fn *fn, Inst *choice, const Inst *is, uint32_t operand) {
    Inst *was = made_of(choice), *inner = was->args[2], *known[2] = {inner->args[0], was->args[0]};
    Inst *value[2] = {inner->args[1], was->args[1]};
    Builder b = ir_before(fn, choice);
    Inst *given = ir_emit2(&b, OP_bor, known[0], known[1]);
    Inst *decided = ir_select(&b, given, known[operand], (Inst *)is);
    Inst *r = ir_select(&b, decided, value[operand], value[!operand]);
    for (Inst *i = choice; i; i = i->next)
        for (uint32_t a = 0; a < i->nargs; a++)
            if (i->args[a] == was) i->args[a] = r;
}

static void give_difference(Fn *fn, Inst *choice, const SltChunks *table, uint32_t number) {
    uint32_t operand;
    const Inst *is = variant_choice_comparison(choice, &operand);
    Builder b = ir_before(fn, choice);
    if (is) {
        Inst *edge = ir_consti(&b, (int32_t)(fn->nsites + number));
        Inst *asked = ir_if(&b, ir_emit2(&b, OP_ieq, ir_input(&b, IN_SITE), edge));
        Builder then = ir_at_end(fn, asked->region[0]), other = ir_at_end(fn, asked->region[1]);
        Inst *difference = ir_emit2(&then, OP_fsub, is->args[0], is->args[1]);
        Imm imm = {0};
        imm.frame.which = table->nexports, imm.frame.places = 1;
        ir_special(&then, OP_give, TY_VOID, 1, &difference, imm);
        ir_yield(&then, 0, NULL), ir_yield(&other, 0, NULL);
        select_once(fn, choice, is, operand);
    }
    ir_unlink(choice);
}

void variant_give_differences(Fn *fn, const SltChunks *table) {
    for (Inst *chunk = fn->body->first; chunk; chunk = chunk->next) {
        if (chunk->op != OP_if_ || chunk->args[0]->op != OP_live) continue;
        for (Inst *i = chunk->region[0]->first, *next; i; i = next) {
            next = i->next;
            if (i->op == OP_choice) give_difference(fn, i, table, (uint32_t)i->imm.i);
        }
    }
}

Inst *variant_take_difference(Builder *b, const SltChunks *table, Inst *captured) {
    Imm imm = {0};
    imm.frame.which = table->nimports, imm.frame.places = 1;
    Inst *difference = ir_special(b, OP_take, TY_FLT, 0, NULL, imm);
    Inst *site = ir_emit2(b, OP_ilt, ir_input(b, IN_SITE), ir_consti(b, (int32_t)b->fn->nsites));
    return ir_select(b, site, captured, difference);
}
