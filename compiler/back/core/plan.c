/* Lanes, parts and regions: how wide a kernel runs, how a varying value is cut into registers, and how each if_ and
 * loop is run by lanes of which some may not want it. */
#include "compiler/back/core/core.h"

#include "saltus/status.h"

/* ---- lanes and parts */
int back_check_width(Session *s, uint32_t width, const char **why) {
    if (width && width <= BACK_MAX_WIDTH && !(width & (width - 1))) return SLT_OK;
    *why = arena_printf(&s->session, "width %u is not a power of two from 1 to %d", width, BACK_MAX_WIDTH);
    return SLT_USAGE;
}

static uint32_t count_insts(const Block *b) {
    uint32_t n = 0;
    for (const Inst *i = b->first; i; i = i->next) {
        n++;
        for (uint32_t r = 0; r < i->nregions; r++) n += count_insts(i->region[r]);
    }
    return n;
}

/* Two vectors a value hide the latency of one: 1.1 to 1.9 times faster on every kernel measured, also where half of the
 * values spill (ray marchers, their reverse sweeps), on all three targets. Not where compiling twice the code would
 * cost more than it gains. */
uint32_t back_choose_width(const KernelRequest *k, uint32_t n, const Target *t) {
    enum { LARGE = 4096 };
    uint32_t bytes = 4, most = 0;
    for (uint32_t j = 0; j < n; j++) {
        if (k[j].fn->precision == PREC_F64) bytes = 8;
        for (const Fn *fn = k[j].fn; fn; fn = fn->next_part) {
            uint32_t count = count_insts(fn->body);
            most = count > most ? count : most;
        }
    }
    uint32_t lanes = t->vector_bytes / bytes;
    return most <= LARGE ? 2 * lanes : lanes;
}

uint32_t back_kernel_width(const KernelRequest *k, uint32_t j, const BackOptions *o, uint32_t width) {
    uint32_t lanes = o->target.vector_bytes / (k[j].fn->precision == PREC_F64 ? 8 : 4);
    bool few = !o->width && j < 64 && o->few >> j & 1;
    return few && width > lanes ? lanes : width;
}

static bool uses_pairs(const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_partner || i->op == OP_both) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (uses_pairs(i->region[r])) return true;
    }
    return false;
}

Plan back_plan(Fn *fn, const Target *target, uint32_t width) {
    Plan plan = {.flt_bytes = fn->precision == PREC_F64 ? 8 : 4, .has_fma = target->has_fma};
    uint32_t native = target->vector_bytes / plan.flt_bytes;
    plan.W = width < 2 && uses_pairs(fn->body) ? 2 : width;
    plan.L = plan.W < native ? plan.W : native;
    plan.P = plan.W / plan.L;
    back_analyse_frames(fn, &plan.frames);
    back_layout_frames(&plan);
    return plan;
}

bool back_is_vector(const Plan *plan, const Inst *i) { return plan->W > 1 && (i->flags & BACK_VARYING); }
uint32_t back_value_parts(const Plan *plan, const Inst *i) { return back_is_vector(plan, i) ? plan->P : 1; }

/* ---- if_ */
enum {                    /* in vector instructions */
       BLEND_BUDGET = 8,  /* what a test and a branch cost */
       PICK_BUDGET = 4,   /* what a branch costs that all lanes take together */
       GATHER = 8,        /* a read whose lanes may want different places */
       LIBRARY_FMA = 100, /* a fused product without hardware for it */
       NOT_CHEAP = 1000
};

/* About how many vector instructions a region costs, NOT_CHEAP if it must not run for lanes that did not ask. */
static uint32_t region_cost(const Plan *plan, const Block *b) {
    uint32_t cost = 0;
    for (const Inst *i = b->first; i && cost < NOT_CHEAP; i = i->next) {
        const OpInfo *o = &ir_ops[i->op];
        bool reads = i->op == OP_load || i->op == OP_param || i->op == OP_iparam || i->op == OP_dparam;
        if (i->op == OP_if_) cost += o->cost + region_cost(plan, i->region[0]) + region_cost(plan, i->region[1]);
        else if (o->kind == KIND_PLACED || o->kind == KIND_EFFECT) cost += NOT_CHEAP;
        else if (i->op == OP_ffma && !plan->has_fma) cost += LIBRARY_FMA;
        else cost += reads && back_is_vector(plan, i) ? GATHER : o->cost;
    }
    return cost;
}

static bool is_empty(const Block *b) {
    for (const Inst *i = b->first; i; i = i->next)
        if (i->op != OP_yield && !ir_is_const(i)) return false;
    return true;
}

/* Cheap enough to run both sides; a condition that is known to be rare is always a branch. */
IfForm back_if_form(const Plan *plan, const Inst *i) {
    uint32_t cost = region_cost(plan, i->region[0]) + region_cost(plan, i->region[1]);
    if (!back_is_vector(plan, i->args[0])) return cost <= PICK_BUDGET ? IF_PICK : IF_JUMP;
    if (i->imm.i != IR_IF_RARE && cost * plan->P <= BLEND_BUDGET) return IF_BLEND;
    if (is_empty(i->region[1])) return IF_THEN_ONLY;
    return is_empty(i->region[0]) ? IF_ELSE_ONLY : IF_BOTH;
}

/* ---- loop */
/* v may pass through one-sided branches whose empty side yields c: they blend under the mask already. */
bool back_keeps_itself(const Plan *plan, const Inst *v, const Inst *c) {
    if (v == c) return true;
    if (v->op != OP_proj || v->args[0]->op != OP_if_) return false;
    const Inst *i = v->args[0];
    IfForm form = back_if_form(plan, i);
    if (form != IF_THEN_ONLY && form != IF_ELSE_ONLY) return false;
    return back_keeps_itself(plan, ir_yield_of(i->region[form == IF_THEN_ONLY])->args[v->imm.i], c);
}

void back_split_flag(const Plan *plan, const Inst *flag, Conjuncts *out) {
    bool room = out->nuniform + out->nvarying < 14;
    if (flag->op == OP_band && room) {
        back_split_flag(plan, flag->args[0], out);
        back_split_flag(plan, flag->args[1], out);
    } else if (back_is_vector(plan, flag)) {
        out->varying[out->nvarying++] = flag;
    } else {
        out->uniform[out->nuniform++] = flag;
    }
}
