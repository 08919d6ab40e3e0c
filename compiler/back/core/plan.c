/* Lanes, parts and regions: how wide a kernel runs, how a varying value is cut into registers, and how each if_ and
 * loop is run by lanes of which some may not want it. */
#include <string.h>

#include "compiler/back/core/core.h"

#include "saltus/status.h"

/* ---- lanes and parts */
int back_check_width(Session *s, uint32_t width, const char **why) {
    if (width <= BACK_MAX_WIDTH && !(width & (width - 1))) return SLT_OK; /* 0: to be chosen */
    *why = arena_printf(&s->session, "width %u is not a power of two from 1 to %d", width, BACK_MAX_WIDTH);
    return SLT_USAGE;
}

uint32_t back_count_insts(const Block *b) {
    uint32_t n = 0;
    for (const Inst *i = b->first; i; i = i->next) {
        n += ir_is_log_part(i->op) ? ir_ops[i->op].cost : 1;
        for (uint32_t r = 0; r < i->nregions; r++) n += back_count_insts(i->region[r]);
    }
    return n;
}

static bool uses_pairs(const Block *b) { return ir_has(b, OP_partner) || ir_has(b, OP_both); }

/* ---- how many vectors a value */
enum {
    FEW_REGISTERS = 16, /* before AVX-512 */
    MASK_REGISTERS = 7  /* with it: what an instruction can go under; before it masks are vectors */
};
typedef struct Loops {
    uint32_t longest; /* instructions of the longest loop; 0: there is none */
    uint32_t kept;    /* most vectors that one keeps from iteration to iteration */
    uint32_t chain;   /* quotients and roots, one after the other, from an iteration to the next */
    bool aside;       /* lanes of one wait aside, and go on: lanes_wait */
} Loops;

static bool is_inside(const Block *b, const Block *outer) {
    while (b != outer && b->owner) b = b->owner->block;
    return b == outer;
}

/* Varying values from outside that a loop reads, each once: `seen` by id. */
static uint32_t count_read(const Block *b, const Block *loop, bool *seen) {
    uint32_t n = 0;
    for (const Inst *i = b->first; i; i = i->next) {
        for (uint32_t j = 0; j < i->nargs; j++) {
            const Inst *x = i->args[j];
            if (!(x->flags & BACK_VARYING) || seen[x->id] || is_inside(x->block, loop)) continue;
            seen[x->id] = true, n++;
        }
        for (uint32_t r = 0; r < i->nregions; r++) n += count_read(i->region[r], loop, seen);
    }
    return n;
}

typedef enum Known { IS_FALSE, IS_TRUE, UNKNOWN } Known;

/* A flag, for lanes that take this side of an if_. */
static Known flag_on(const Inst *v, const Inst *at, uint32_t side) {
    if (v->op == OP_proj && v->args[0] == at) v = ir_yield_of(at->region[side])->args[v->imm.i];
    if (v->op == OP_constb) return v->imm.i ? IS_TRUE : IS_FALSE;
    if (v->op != OP_bnot && v->op != OP_band && v->op != OP_bor) return UNKNOWN;
    const Known a = flag_on(v->args[0], at, side);
    if (v->op == OP_bnot) return a == UNKNOWN ? a : a == IS_TRUE ? IS_FALSE : IS_TRUE;
    const Known b = flag_on(v->args[1], at, side), decides = v->op == OP_band ? IS_FALSE : IS_TRUE;
    return a == decides || b == decides ? decides : a == b ? a : UNKNOWN;
}

static bool hangs_on(const Inst *flag, const Inst *at) {
    if (flag->op == OP_proj) return flag->args[0] == at;
    if (flag->op != OP_bnot && flag->op != OP_band && flag->op != OP_bor) return false;
    return hangs_on(flag->args[0], at) || (flag->op != OP_bnot && hangs_on(flag->args[1], at));
}

/* In a loop that lanes leave from a side of an if_: do others pass over that side, and go on? Then a vector has two
 * masks, of the lanes inside the loop and of those in that side. */
static bool lanes_wait(const Inst *loop) {
    const Block *body = loop->region[0];
    const Inst *flag = ir_yield_of(body)->args[0];
    for (const Inst *i = body->first; i && loop->flags & BACK_DIVERGES; i = i->next) {
        if (i->op != OP_if_ || !(i->flags & BACK_DIVERGES) || !hangs_on(flag, i)) continue;
        for (uint32_t side = 0; side < 2; side++)
            if (back_is_empty(i->region[side]) && !back_is_empty(i->region[!side]) &&
                flag_on(flag, i, side) != IS_FALSE)
                return true;
    }
    return false;
}

/* Quotients and roots on the longest way from what a loop carries to each value, plus 1; 0 where there is no way. Loops
 * inside have ways of their own. */
static void count_chain(const Block *b, uint32_t *ways) {
    for (const Inst *i = b->first; i; i = i->next) {
        uint32_t most = i->op == OP_proj ? 0 : ways[i->id];
        for (uint32_t j = 0; j < i->nargs; j++) most = ways[i->args[j]->id] > most ? ways[i->args[j]->id] : most;
        if (i->op == OP_if_)
            for (uint32_t r = 0; r < i->nregions; r++) count_chain(i->region[r], ways);
        if (i->op == OP_proj && i->args[0]->op == OP_if_)
            for (uint32_t r = 0; r < 2; r++) {
                const uint32_t way = ways[ir_yield_of(i->args[0]->region[r])->args[i->imm.i]->id];
                most = way > most ? way : most;
            }
        ways[i->id] = most ? most + (i->op == OP_fdiv || i->op == OP_fsqrt) : 0;
    }
}

static uint32_t chain_of(Fn *fn, const Block *body) {
    uint32_t *ways = ARENA_ARRAY(&fn->session->scratch, uint32_t, fn->ninsts + 1), most = 0;
    for (uint32_t p = 0; p < body->nparams; p++)
        if (body->params[p]->flags & BACK_VARYING) ways[body->params[p]->id] = 1;
    count_chain(body, ways);
    const Inst *yield = ir_yield_of(body);
    for (uint32_t j = 1; j < yield->nargs; j++)
        most = ways[yield->args[j]->id] > most ? ways[yield->args[j]->id] : most;
    return most ? most - 1 : 0;
}

static void look_at_loops(Fn *fn, const Block *b, uint32_t registers, Loops *out) {
    for (const Inst *i = b->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) look_at_loops(fn, i->region[r], registers, out);
        if (i->op != OP_loop && i->op != OP_revloop) continue;
        const Block *body = i->region[0];
        uint32_t size = back_count_insts(body);
        ArenaMark m = arena_mark(&fn->session->scratch);
        bool *seen = ARENA_ARRAY(&fn->session->scratch, bool, fn->ninsts + 1);
        uint32_t kept =
            (i->flags & BACK_DIVERGES ? 1 : 0) + (registers > FEW_REGISTERS ? count_read(body, body, seen) : 0);
        for (uint32_t p = 0; p < body->nparams; p++) kept += body->params[p]->flags & BACK_VARYING ? 1 : 0;
        const uint32_t chain = chain_of(fn, body);
        out->chain = chain > out->chain ? chain : out->chain;
        arena_reset(&fn->session->scratch, m);
        out->longest = size > out->longest ? size : out->longest;
        out->aside |= i->op == OP_loop && lanes_wait(i);
        if (i->op == OP_revloop && registers > FEW_REGISTERS) kept = 0; /* adjoints of many values: they spill anyway */
        out->kept = kept > out->kept ? kept : out->kept;
    }
}

/* Does each lane read a place of its own, or look along a ray of its own? That takes as long for each of them. */
static bool lanes_seek(const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        const Inst *at = i->op == OP_param || i->op == OP_iparam ? i->args[0] : i->op == OP_load ? i->args[1] : NULL;
        if (i->op == OP_query || (at && at->flags & BACK_VARYING)) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (lanes_seek(i->region[r])) return true;
    }
    return false;
}

/* Of an image, called for all samples of a tile: vectors are full, and its code is small beside what runs it. */
static bool is_of_images(const Fn *fn) { return !strcmp(fn->name, "value") && !lanes_seek(fn->body); }

/* Two vectors a value hide the latency of one: 1.1 to 1.9 times faster on every kernel measured, also where half of the
 * values spill (ray marchers, their reverse sweeps), on all three targets. Of loops, whose iterations wait for each
 * other, four do, up to 1.9 times faster again, as long as registers hold what they keep, and they are not so long that
 * the rest spills. Where registers are few, what a loop only reads counts for nothing: it spills at any width, and is
 * an operand from memory. Not of what compares neighbouring lanes, which takes masks through general registers.
 * Of images, four also where no loop waits for itself, 1.05 to 1.4 times faster, and in long loops, 1.1 to 1.4: a
 * processor looks some hundred instructions ahead, which is not far in the code of two. And where iterations wait for
 * quotients or roots that wait for each other, 1.1 to 1.5 times: two vectors leave the divider idle.
 * Compiling so much code must not cost more than it gains. */
static WidthChoice vectors(Fn *fn, const Target *t) {
    enum { LARGE = 4096 };
    const bool few = t->vector_bytes < 64;
    const uint32_t small = few ? 600 : 1000;
    const uint32_t registers = few ? FEW_REGISTERS : 2 * FEW_REGISTERS, long_loop = few ? 160 : 200;
    uint32_t most = 0;
    for (const Fn *part = fn; part; part = part->next_part) {
        uint32_t count = back_count_insts(part->body);
        most = count > most ? count : most;
    }
    if (most > LARGE) return (WidthChoice){.vectors = 1, .why = WIDTH_MOST_CODE, .found = most, .limit = LARGE};
    if (most > small) return (WidthChoice){.vectors = 2, .why = WIDTH_MUCH_CODE, .found = most, .limit = small};
    Loops loops = {0};
    bool pairs = false;
    for (Fn *part = fn; part; part = part->next_part) {
        ArenaMark m = arena_mark(&fn->session->scratch);
        FrameTable frames;
        ir_number(part);
        back_analyse_frames(part, &frames);
        look_at_loops(part, part->body, registers, &loops);
        pairs |= uses_pairs(part->body);
        arena_reset(&fn->session->scratch, m);
    }
    const uint32_t spare = few ? 2 : 0, room = (registers - spare) / 4; /* else masks have registers of their own */
    const bool image = is_of_images(fn), is_long = loops.longest > long_loop;
    const bool waits = image && loops.chain > 1;
    const uint32_t most_kept = waits              ? FEW_REGISTERS
                               : image && is_long ? 2 * room
                                                  : room; /* beside so much a few loads are little */
    if (!loops.longest)
        return image ? (WidthChoice){.vectors = 4, .why = WIDTH_IMAGE}
                     : (WidthChoice){.vectors = 2, .why = WIDTH_STRAIGHT};
    if (pairs) return (WidthChoice){.vectors = 2, .why = WIDTH_NEIGHBOURS};
    if (is_long && !image)
        return (WidthChoice){.vectors = 2, .why = WIDTH_LONG_LOOP, .found = loops.longest, .limit = long_loop};
    if (loops.kept > most_kept)
        return (WidthChoice){.vectors = 2, .why = WIDTH_MUCH_KEPT, .found = loops.kept, .limit = most_kept};
    if (loops.aside && !few && !(image && is_long))
        return (WidthChoice){.vectors = 2, .why = WIDTH_MANY_MASKS, .found = 2 * 4, .limit = MASK_REGISTERS};
    if (is_long) return (WidthChoice){.vectors = 4, .why = WIDTH_IMAGE};
    if (loops.kept > room) return (WidthChoice){.vectors = 4, .why = WIDTH_CHAIN, .found = loops.chain};
    return (WidthChoice){.vectors = 4, .why = WIDTH_SHORT_LOOP, .found = loops.kept, .limit = room};
}

uint32_t back_register_lanes(const Target *t, Precision p) { return t->vector_bytes / (p == PREC_F64 ? 8 : 4); }

WidthChoice back_width_choice(const KernelRequest *k, uint32_t j, const BackOptions *o) {
    const uint32_t given = o->lanes ? o->lanes : o->width;
    if (given) return (WidthChoice){.lanes = given, .why = WIDTH_GIVEN};
    WidthChoice c =
        j < 64 && o->few >> j & 1 ? (WidthChoice){.vectors = 1, .why = WIDTH_FEW} : vectors(k[j].fn, &o->target);
    c.lanes = c.vectors * back_register_lanes(&o->target, k[j].fn->precision);
    return c;
}

uint32_t back_choose_width(const KernelRequest *k, uint32_t j, const BackOptions *o) {
    return back_width_choice(k, j, o).lanes;
}

/* The same on every target, so that sums have the same bits at one width. */
uint32_t back_adjoint_lanes(const BackOptions *o, Precision p) {
    enum { ROW_BYTES = 64 };
    uint32_t lanes = ROW_BYTES / (p == PREC_F64 ? 8 : 4);
    return o->adj == ADJ_FLAT ? 1 : o->width && o->width < lanes ? o->width : lanes;
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

bool back_lacks_rounding(const Target *t) {
    return t->vector_bytes <= 16 && !strcmp(t->cpu, "x86-64") && !strstr(t->features, "+sse4.1");
}

bool back_is_vector(const Plan *plan, const Inst *i) { return plan->W > 1 && (i->flags & BACK_VARYING); }
uint32_t back_value_parts(const Plan *plan, const Inst *i) { return back_is_vector(plan, i) ? plan->P : 1; }

/* ---- if_ */
enum {                   /* in vector instructions */
       BLEND_BUDGET = 8, /* what a test and a branch cost */
       BOTH_BUDGET = 16, /* where there are two sides: one of them runs anyway, and which is harder to foresee */
       PICK_BUDGET = 4,  /* what a branch costs that all lanes take together */
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
        else if (i->op == OP_ffma && !plan->has_fma) cost += BACK_LIBRARY_FMA_COST;
        else cost += reads && back_is_vector(plan, i) ? BACK_GATHER_COST : o->cost;
    }
    return cost;
}

bool back_is_empty(const Block *b) {
    for (const Inst *i = b->first; i; i = i->next)
        if (i->op != OP_yield && !ir_is_const(i)) return false;
    return true;
}

/* Cheap enough to run both sides; a condition that is known to be rare is always a branch. */
IfForm back_if_form(const Plan *plan, const Inst *i) {
    const uint32_t cost = region_cost(plan, i->region[0]) + region_cost(plan, i->region[1]);
    const bool no_else = back_is_empty(i->region[1]), no_then = back_is_empty(i->region[0]);
    if (!back_is_vector(plan, i->args[0])) return cost <= PICK_BUDGET ? IF_PICK : IF_JUMP;
    if (i->imm.i != IR_IF_RARE && cost * plan->P <= (no_else || no_then ? BLEND_BUDGET : BOTH_BUDGET)) return IF_BLEND;
    return no_else ? IF_THEN_ONLY : no_then ? IF_ELSE_ONLY : IF_BOTH;
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

static bool branches(const Plan *plan, const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_query) return true;
        if (i->flags & BACK_DIVERGES && (i->op != OP_if_ || back_if_form(plan, i) != IF_BLEND)) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (branches(plan, i->region[r])) return true;
    }
    return false;
}

/* Vector instructions an execution, by the loops around them: those that all lanes run, and those that some may. */
typedef struct Work {
    uint64_t all, some;
} Work;

static void count_work(const Block *b, uint64_t times, bool some, Work *w) {
    enum { ITERATIONS = 16, MOST = 1 << 16, SEARCH = 100 };
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->flags & BACK_VARYING && i->op != OP_proj) *(some ? &w->some : &w->all) += times;
        if (i->op == OP_query) w->some += SEARCH * times;
        bool loops = i->op == OP_loop || i->op == OP_revloop;
        for (uint32_t r = 0; r < i->nregions; r++)
            count_work(i->region[r], loops && times < MOST ? times * ITERATIONS : times,
                       some || (i->flags & BACK_DIVERGES), w);
    }
}

static Work work_of(Fn *fn, const Target *target, uint32_t width, uint64_t same, bool *any_branch) {
    ArenaMark m = arena_mark(&fn->session->scratch);
    Work w = {0};
    fn->same = same;
    Plan plan = back_plan(fn, target, width);
    *any_branch = branches(&plan, fn->body);
    count_work(fn->body, 1, false, &w);
    arena_reset(&fn->session->scratch, m);
    return w;
}

void back_share_row(Fn *fn, const Target *target, uint32_t width) {
    const uint64_t column = 1ull << SLT_IN_X0 | 1ull << SLT_IN_PIXEL0;
    bool branch;
    Work own = work_of(fn, target, width, 0, &branch), shared = work_of(fn, target, width, ~column, &branch);
    if (branch && own.all < shared.all + shared.some) fn->same = 0;
}
