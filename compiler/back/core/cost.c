/* The estimate of what a kernel costs, from its IR under its plan. */
#include <stdlib.h>
#include <string.h>

#include "compiler/back/core/core.h"
#include "compiler/back/cost.h"

const CostRow back_cost_rows[COST_KINDS] = {
#define COST(id, ...) {__VA_ARGS__},
#include "compiler/back/cost.def"
};

typedef struct Costing {
    Session *session;
    const Target *target;
    Plan plan;
    KernelCost *out;
    Vec(CostLine) lines;
    uint32_t last; /* the line of the instruction before: mostly that of the next */
} Costing;

/* Chances that are not known, in a word. */
static const double HALF = 0.5, RARE = 1.0 / 16;

static CostLine *line_of(Costing *c, const Inst *i) {
    CostLine at = {.file = i->span.file};
    uint32_t column;
    if (at.file >= 0) span_position(c->session, i->span, &at.line, &column);
    if (c->last < c->lines.len && c->lines.data[c->last].file == at.file && c->lines.data[c->last].line == at.line)
        return &c->lines.data[c->last];
    for (c->last = 0; c->last < c->lines.len; c->last++)
        if (c->lines.data[c->last].file == at.file && c->lines.data[c->last].line == at.line)
            return &c->lines.data[c->last];
    vec_push(&c->session->scratch, &c->lines, at);
    return &c->lines.data[c->last];
}

static bool reads_apart(const Plan *plan, const Inst *i) {
    switch (i->op) {
    case OP_param:
    case OP_iparam:
    case OP_dparam:
    case OP_told: return back_is_vector(plan, i->args[0]);
    case OP_load: return back_is_vector(plan, i->args[1]);
    default: return false;
    }
}

/* COST_KINDS: nothing. */
static CostKind kind_of(const Costing *c, const Inst *i) {
    const Plan *plan = &c->plan;
    if (reads_apart(plan, i)) return COST_GATHER;
    switch (i->op) {
    case OP_store:
        return back_is_vector(plan, i->args[0]) && back_is_vector(plan, i->args[1]) ? COST_SCATTER : COST_KINDS;
    case OP_adj: return i->args[0]->flags & BACK_VARYING ? COST_LOG : COST_KINDS;
    case OP_fdiv:
    case OP_zdiv: return COST_DIVISION;
    case OP_fsqrt: return COST_ROOT;
    case OP_idiv:
    case OP_irem:
    case OP_udiv:
    case OP_urem: return COST_INTEGER_DIVISION;
    case OP_ffma: return plan->has_fma ? COST_KINDS : COST_FMA;
    case OP_ffloor:
    case OP_fceil:
    case OP_fround:
    case OP_ftrunc: return back_lacks_rounding(c->target) ? COST_ROUNDING : COST_KINDS;
    case OP_query: return COST_SEARCH;
    case OP_if_: return back_if_form(plan, i) == IF_BOTH ? COST_BOTH_SIDES : COST_KINDS;
    case OP_loop: return plan->W > 1 && i->flags & BACK_DIVERGES ? COST_WAIT : COST_KINDS;
    case OP_tapepush: return COST_TAPE;
    default: return COST_KINDS;
    }
}

/* Vector instructions that i takes, without its regions. */
static double own_cost(const Costing *c, const Inst *i, CostKind kind) {
    enum { ROUNDING = 6 }; /* emit_ops.c, where there is no instruction */
    double cost = kind == COST_GATHER || kind == COST_SCATTER || kind == COST_LOG ? BACK_GATHER_COST
                  : kind == COST_FMA                                              ? BACK_LIBRARY_FMA_COST
                  : kind == COST_ROUNDING                                         ? ROUNDING
                  : i->op == OP_tapepush                                          ? i->nargs
                  : i->op == OP_acopy                                             ? 2.0 * i->args[0]->imm.arr.count
                                                                                  : ir_ops[i->op].cost;
    bool vector = back_is_vector(&c->plan, i);
    if (i->op == OP_query) return cost; /* all lanes at once */
    if (i->type == TY_VOID || i->nregions)
        for (uint32_t j = 0; j < i->nargs; j++) vector |= back_is_vector(&c->plan, i->args[j]);
    return cost * (vector ? c->plan.P : 1);
}

static bool pushes(const Block *b) {
    for (const Inst *i = b->first; i; i = i->next)
        if (i->op == OP_tapepush) return true;
    return false;
}

static double trips(const Inst *loop) { return loop->imm.loop.told ? 1 : loop->imm.loop.max_iters; }

/* A revloop runs once for each frame above its mark: as often as what pushed them, which stands behind the mark. */
static double frames(const Inst *revloop) {
    const Inst *mark = revloop->args[0];
    if (mark->op != OP_tapemark) return 1;
    for (const Inst *i = mark->next; i; i = i->next)
        if (i->op == OP_loop && pushes(i->region[0])) return trips(i);
        else if (i->op == OP_if_ && (pushes(i->region[0]) || pushes(i->region[1]))) return 1;
    return 1;
}

static void add_block(Costing *c, const Block *b, double runs, uint64_t times) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (ir_is_const(i) || ir_ops[i->op].kind == KIND_LINK) continue;
        CostKind kind = kind_of(c, i);
        double cost = runs * own_cost(c, i, kind);
        CostLine *line = line_of(c, i);
        line->ops++, line->cost += cost, c->out->cost += cost;
        if (times > line->times) line->times = times;
        if (kind < COST_KINDS) line->kinds[kind]++, c->out->kinds[kind]++;
        if (i->op == OP_alloc)
            c->out->array_bytes += (uint64_t)i->imm.arr.count * back_type_bytes(&c->plan, i->imm.arr.elem) *
                                   (back_is_vector(&c->plan, i) ? c->plan.W : 1);
        double n = i->op == OP_loop ? trips(i) : i->op == OP_revloop ? frames(i) : 1;
        for (uint32_t r = 0; r < i->nregions; r++) {
            double share = n;
            if (i->op == OP_if_ && back_if_form(&c->plan, i) == IF_JUMP) share = HALF;
            if (i->op == OP_if_ && i->imm.i == IR_IF_RARE) share = r ? 1 : RARE;
            add_block(c, i->region[r], runs * share,
                      (uint64_t)n > UINT64_MAX / times ? UINT64_MAX : times * (uint64_t)n);
        }
    }
}

static int dearer(const void *a, const void *b) {
    const CostLine *x = a, *y = b;
    if (x->cost != y->cost) return x->cost < y->cost ? 1 : -1;
    if (x->file != y->file) return x->file < y->file ? -1 : 1;
    return (x->line > y->line) - (x->line < y->line);
}

void back_estimate(Session *s, const KernelRequest *k, const BackOptions *o, KernelCost *out) {
    *out = (KernelCost){0};
    ArenaMark m = arena_mark(&s->scratch);
    Costing c = {.session = s, .target = &o->target, .out = out};
    uint32_t width = back_choose_width(k, 0, o);
    for (Fn *part = k->fn; part; part = part->next_part) {
        ir_number(part);
        c.plan = back_plan(part, &o->target, width);
        out->vectors = c.plan.P;
        add_block(&c, part->body, 1, 1);
    }
    out->lines = ARENA_ARRAY(&s->session, CostLine, c.lines.len + 1);
    out->nlines = c.lines.len;
    if (c.lines.len) memcpy(out->lines, c.lines.data, c.lines.len * sizeof *out->lines);
    qsort(out->lines, out->nlines, sizeof *out->lines, dearer);
    arena_reset(&s->scratch, m);
}
