/* Leads a program to the event that is asked for, so that its g is a function of all x.
 *
 * Where g needs carried values, the edge kernels run the program and keep g on the way (variant_site.c). An event that
 * exists only behind others, a later iteration of a loop that these leave, would have no g on their far side: there a
 * curve would end in the middle of a cell, and no bounds could follow it. So the conditions on the way are taken as the
 * event needs them: loops go on until its iteration, as if what leaves them had not held, and ifs around it lead to its
 * side. Where the event exists nothing changes. The slices of other events leave their ifs out for the same reason. */
#include "compiler/pass/variant.h"

typedef struct Lead {
    Fn *fn;
    const uint8_t *wanted; /* by site */
    Inst *k[SLT_MAX_K];    /* of the loops around, outermost first */
    uint32_t depth;
} Lead;

/* Is the event asked for one of a wanted site in here? NULL: there is none. */
static Inst *asked_inside(const Lead *l, Builder *b, const Block *body) {
    Inst *any = NULL;
    for (const Inst *i = body->first; i; i = i->next) {
        Inst *here = NULL;
        if (variant_is_site(i) && l->wanted[i->imm.i])
            here = ir_emit2(b, OP_ieq, ir_input(b, IN_SITE), ir_consti(b, (int32_t)i->imm.i));
        for (uint32_t r = 0; r < i->nregions; r++) {
            Inst *below = asked_inside(l, b, i->region[r]);
            here = here && below ? ir_emit2(b, OP_bor, here, below) : below ? below : here;
        }
        any = any && here ? ir_emit2(b, OP_bor, any, here) : here ? here : any;
    }
    return any;
}

/* Is this the event's iteration of all loops around? */
static Inst *at_iteration(const Lead *l, Builder *b, Inst *asked) {
    for (uint32_t d = 0; d < l->depth; d++) {
        Inst *same = ir_emit2(b, OP_ieq, l->k[d], ir_input(b, (InputSlot)(IN_K0 + d)));
        asked = ir_emit2(b, OP_band, asked, same);
    }
    return asked;
}

/* Where `when` holds, the condition of an if_ becomes `truth`. */
static void take(Lead *l, Inst *branch, Inst *when, bool truth) {
    Builder b = ir_before(l->fn, branch);
    Inst *cond = branch->args[0];
    cond = truth ? ir_emit2(&b, OP_bor, cond, when) : ir_emit2(&b, OP_band, cond, ir_emit1(&b, OP_bnot, when));
    ir_replace_arg(branch, 0, cond);
}

/* Where `when` holds, v must become `truth`: ifs that give v the other value on one side take the other side. */
static void want(Lead *l, Inst *v, bool truth, Inst *when) {
    if (v->op == OP_bnot) want(l, v->args[0], !truth, when);
    if (v->op == (truth ? OP_band : OP_bor))
        for (uint32_t a = 0; a < 2; a++) want(l, v->args[a], truth, when);
    if (v->op != OP_proj || v->args[0]->op != OP_if_) return;
    Inst *branch = v->args[0];
    for (uint32_t r = 0; r < 2; r++) {
        Inst *side = branch->region[r]->last->args[v->imm.i];
        if (side->op == OP_constb && (side->imm.i != 0) != truth) take(l, branch, when, r != 0);
        else want(l, side, truth, when);
    }
}

static void lead_block(Lead *l, Block *body);

static void lead_loop(Lead *l, Inst *loop) {
    Block *body = loop->region[0];
    uint32_t depth = l->depth;
    Builder b = body->first ? ir_before(l->fn, body->first) : ir_at_end(l->fn, body);
    b.fold = true;
    Inst *asked = depth < SLT_MAX_K ? asked_inside(l, &b, body) : NULL;
    if (!asked) return;
    Inst *before = ir_emit2(&b, OP_ilt, body->params[0], ir_input(&b, (InputSlot)(IN_K0 + depth)));
    Inst *go_on = ir_emit2(&b, OP_band, at_iteration(l, &b, asked), before);
    l->k[l->depth++] = body->params[0];
    lead_block(l, body);
    l->depth = depth;
    Inst *flag = body->last->args[0];
    if (loop->imm.loop.exact) return;
    want(l, flag, true, go_on);
    b = ir_before(l->fn, body->last);
    ir_replace_arg(body->last, 0, ir_emit2(&b, OP_bor, flag, go_on));
}

static void lead_block(Lead *l, Block *body) {
    for (Inst *i = body->first; i; i = i->next) {
        if (i->op == OP_loop) lead_loop(l, i);
        if (i->op != OP_if_) continue;
        for (uint32_t r = 0; r < 2; r++) {
            Builder b = ir_before(l->fn, i);
            b.fold = true;
            Inst *asked = asked_inside(l, &b, i->region[r]);
            if (!asked) continue;
            take(l, i, at_iteration(l, &b, asked), r == 0);
            lead_block(l, i->region[r]);
        }
    }
}

void variant_lead_to_events(Fn *fn, const uint8_t *wanted) {
    Lead l = {.fn = fn, .wanted = wanted};
    lead_block(&l, fn->body);
}
