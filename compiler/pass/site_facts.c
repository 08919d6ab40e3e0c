/* What the g of each site depends on: position, parameters, random numbers. A forward data flow to a fixpoint, control
 * included. */
#include "compiler/pass/walk.h"
#include "compiler/pass/site_facts.h"

typedef struct Facts {
    uint8_t *of; /* by id */
    const uint8_t *wrt;
    uint8_t *site;
    bool changed;
} Facts;

static void add(Facts *f, const Inst *i, uint8_t what) {
    if ((f->of[i->id] | what) != f->of[i->id]) {
        f->of[i->id] |= what;
        f->changed = true;
    }
}

static uint8_t param_facts(const Facts *f, const Inst *i) {
    if (!f->wrt) return DEPENDS_PARAM;
    for (uint32_t k = 0; k < i->imm.slot.count; k++)
        if (f->wrt[i->imm.slot.base + k]) return DEPENDS_PARAM;
    return 0;
}

static void flow(Facts *f, Block *b, uint8_t control) {
    for (Inst *i = b->first; i; i = i->next) {
        uint8_t what = control;
        for (uint32_t a = 0; a < i->nargs; a++) what |= f->of[i->args[a]->id];
        if (i->op == OP_input && i->imm.i <= IN_X2) what |= DEPENDS_X;
        if (i->op == OP_input && (i->imm.i == IN_STREAM || i->imm.i == IN_RAND0)) what |= DEPENDS_RAND;
        if (i->op == OP_rand) what |= DEPENDS_RAND;
        if (i->op == OP_param) what |= param_facts(f, i);
        if (i->op == OP_detach) what &= (uint8_t)~DEPENDS_PARAM;
        if (i->op == OP_site || i->op == OP_siten) f->site[i->imm.i] |= f->of[i->args[1]->id];
        if (i->op == OP_proj) {
            Inst *owner = i->args[0];
            for (uint32_t r = 0; r < owner->nregions; r++)
                what |= f->of[walk_results(owner, owner->region[r])[i->imm.i]->id];
            if (owner->op == OP_if_) what |= f->of[owner->args[0]->id];
            if (owner->op == OP_loop) what |= f->of[owner->region[0]->last->args[0]->id];
        }
        if ((i->op == OP_store || i->op == OP_acopy)) add(f, i->args[0], what);
        if (i->op == OP_loop) {
            Block *body = i->region[0];
            uint8_t exit = f->of[body->last->args[0]->id];
            for (uint32_t c = 0; c < i->nargs; c++)
                add(f, body->params[c + 1], f->of[i->args[c]->id] | f->of[body->last->args[c + 1]->id]);
            flow(f, body, control | exit);
        } else if (i->op == OP_if_) {
            for (uint32_t r = 0; r < 2; r++)
                flow(f, i->region[r], control); /* the condition joins at the projections and stores */
        } else if (i->op == OP_custom) {
            for (uint32_t a = 0; a < i->nargs && a < i->region[0]->nparams; a++)
                add(f, i->region[0]->params[a], f->of[i->args[a]->id]);
            flow(f, i->region[0], control);
        }
        add(f, i, what);
    }
}

void site_facts(PassCtx *ctx, Fn *fn, const uint8_t *wrt, uint8_t *site) {
    ArenaMark m = arena_mark(&ctx->session->scratch);
    uint32_t n = ir_number(fn) + 1;
    Facts f = {.of = ARENA_ARRAY(&ctx->session->scratch, uint8_t, n), .wrt = wrt, .site = site, .changed = true};
    for (uint32_t s = 0; s < fn->nsites; s++) site[s] = 0;
    while (f.changed) {
        f.changed = false;
        flow(&f, fn->body, 0);
    }
    arena_reset(&ctx->session->scratch, m);
}
