/* Reverse mode on structured IR: the primal, then one sweep backwards.
 *
 * Order of work: clone, strip-mine as planned, inline customs, hoist x, split ifs that hold loops on both sides, find
 * facts, emit the sweep. The first attempt replays nothing; what it stored decides which loops are replayed and,
 * while the worst-case tape is above the budget, which loop gets one more level of checkpoints. */
#include <math.h>
#include <string.h>

#include "compiler/pass/ad_tape.h"

enum { MAX_LEVELS = 12, MAX_ATTEMPTS = 32, DEFAULT_BUDGET = 64 * 1024, PATH_BUDGET = 4 * 1024, REPLAY_BYTES = 64 };

Ctx *vjp_push(Vjp *v, Block *primal, RevBlock *rev, Scope *scope) {
    Ctx *c = ARENA_NEW(v->scratch, Ctx);
    *c = (Ctx){primal, rev, scope};
    vec_push(v->scratch, &v->stack, c);
    return c;
}

void vjp_add(Vjp *v, Inst *primal, AdTerm t) {
    if (t.none || !ad_active(&v->f, primal)) return;
    v->rule.b = vjp_builder(v);
    v->rule.emit = true;
    Adjoint *a = &v->adj[primal->id];
    a->v = ad_term_add(&v->rule, a->v, t);
    a->inf |= (t.range.beyond & IR_POLE) != 0;
}

bool vjp_holds_taped(const Vjp *v, const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_loop && v->taped[i->id]) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (vjp_holds_taped(v, i->region[r])) return true;
    }
    return false;
}

/* ---- arrays: the adjoint of an array is an array, made in the reverse of the block that made the array */

static Inst *adjoint_array(Vjp *v, Inst *alloc) {
    if (v->adj_array[alloc->id]) return v->adj_array[alloc->id];
    for (uint32_t d = v->stack.len; d-- > 0;) {
        Ctx *c = v->stack.data[d];
        if (c->primal != alloc->block) continue;
        Builder b = rev_builder(v, c->rev);
        b.span = alloc->span;
        return v->adj_array[alloc->id] = ir_special(&b, OP_alloc, TY_ARRAY, 0, NULL, alloc->imm);
    }
    ice(v->fn->session, "ad: an array is used outside its block");
}

static Inst *load(Builder *b, Inst *array, Inst *index) {
    return ir_special(b, OP_load, TY_FLT, 2, (Inst *[]){array, index}, (Imm){0});
}
static void store(Builder *b, Inst *array, Inst *index, Inst *x) {
    ir_special(b, OP_store, TY_VOID, 3, (Inst *[]){array, index, x}, (Imm){0});
}

static void reverse_load(Vjp *v, Inst *i) {
    Adjoint g = v->adj[i->id];
    if (!g.v) return;
    Inst *array = adjoint_array(v, i->args[0]), *index = tape_value(v, i->args[1]);
    Builder b = vjp_builder(v);
    store(&b, array, index, ir_emit2(&b, OP_fadd, load(&b, array, index), g.v));
}

static void reverse_store(Vjp *v, Inst *i) {
    if (!ad_active(&v->f, i->args[0])) return;
    Inst *array = adjoint_array(v, i->args[0]), *index = tape_value(v, i->args[1]);
    Builder b = vjp_builder(v);
    Inst *g = ad_active(&v->f, i->args[2]) ? load(&b, array, index) : NULL;
    store(&b, array, index, ir_constf(&b, 0));
    if (g) vjp_add(v, i->args[2], ad_seed(g, v->any_inf));
}

/* a = b: the adjoint of every element of a moves to b's. */
static void copy_element(Builder *b, Inst *to, Inst *from, Inst *index) {
    if (from) store(b, from, index, ir_emit2(b, OP_fadd, load(b, from, index), load(b, to, index)));
    store(b, to, index, ir_constf(b, 0));
}

static void reverse_acopy(Vjp *v, Inst *i) {
    if (!ad_active(&v->f, i->args[0]) || i->args[0] == i->args[1]) return;
    Inst *to = adjoint_array(v, i->args[0]), *from = ad_active(&v->f, i->args[1]) ? adjoint_array(v, i->args[1]) : NULL;
    uint32_t n = i->args[0]->imm.arr.count;
    Builder b = vjp_builder(v);
    if (n <= 4) {
        for (uint32_t e = 0; e < n; e++) copy_element(&b, to, from, ir_consti(&b, (int32_t)e));
        return;
    }
    Inst *loop = ir_loop(&b, 0, NULL, (LoopInfo){.max_iters = n, .exact = true});
    Builder in = {.fn = v->fn, .block = loop->region[0], .fold = true, .span = i->span};
    Inst *k = loop->region[0]->params[0];
    copy_element(&in, to, from, k);
    Inst *on = ir_emit2(&in, OP_ilt, k, ir_consti(&in, (int32_t)n - 1));
    ir_yield(&in, 1, &on);
}

/* ---- the sweep */

static bool is_gate(const Inst *i) { return i->op == OP_fmin || i->op == OP_fmax || i->op == OP_fsel; }

static void reverse_row(Vjp *v, Inst *i) {
    Adjoint g = v->adj[i->id];
    if (!g.v || !ad_active(&v->f, i)) return;
    for (uint32_t a = 0; a < i->nargs; a++) {
        if (i->args[a]->type != TY_FLT || !ad_active(&v->f, i->args[a])) continue;
        v->rule.b = vjp_builder(v);
        v->rule.b.span = i->span;
        const uint32_t x = i->args[a]->id;
        v->gated[x] = is_gate(i) && (v->gated[x] || !v->adj[x].v);
        vjp_add(v, i->args[a], ad_partial(&v->rule, i, a, ad_seed(g.v, g.inf)));
    }
}

static void reverse_inst(Vjp *v, Inst *i) {
    switch ((Op)i->op) {
    case OP_if_: vjp_if(v, i); return;
    case OP_loop: vjp_loop(v, i); return;
    case OP_load: reverse_load(v, i); return;
    case OP_store: reverse_store(v, i); return;
    case OP_acopy: reverse_acopy(v, i); return;
    case OP_ghost:
        if (v->adj[i->id].v) vjp_add(v, i->args[0], ad_seed(v->adj[i->id].v, v->adj[i->id].inf));
        return;
    case OP_detach:
        if (i->tag && v->adj[i->id].v)
            vjp_add(v, v->links.v.data[i->tag - 1], ad_seed(v->adj[i->id].v, v->adj[i->id].inf));
        return;
    case OP_param:
        if (v->adj[i->id].v && ad_slot_in_wrt(v->o, i)) {
            Inst *index = tape_value(v, i->args[0]);
            Builder b = vjp_builder(v);
            b.span = i->span;
            ir_special(&b, OP_adj, TY_VOID, 2, (Inst *[]){index, v->adj[i->id].v}, i->imm);
        }
        return;
    case OP_custom:
    case OP_revloop:
    case OP_adj:
    case OP_tapepush:
    case OP_tapemark: ice(v->fn->session, "ad: %s in a primal", ir_ops[i->op].name);
    default:
        if (!ir_ops[i->op].special && i->type == TY_FLT) reverse_row(v, i);
    }
}

void vjp_run(Vjp *v, const Inst *first, Inst *last) {
    /* The sweep also adds code to the forward part: ids tell it apart. */
    Inst *const ahead = first->prev;
    for (Inst *i = last, *prev; i != ahead; i = prev) {
        prev = i->prev;
        if (i->id >= v->f.n || i->op == OP_yield) continue;
        if (v->gated[i->id] && !is_gate(i) && vjp_gate(v, ahead, i, &prev)) continue;
        reverse_inst(v, i);
    }
}

void vjp_block(Vjp *v, Block *b) {
    if (b->last) vjp_run(v, b->first, b->last);
}

/* ---- facts of regions */

static bool mark_regions(const AdFacts *f, Block *b, uint8_t *taped, uint8_t *effect, bool *effects) {
    bool any = false;
    for (Inst *i = b->first; i; i = i->next) {
        bool inner = false, writes = false;
        for (uint32_t r = 0; r < i->nregions; r++) inner |= mark_regions(f, i->region[r], taped, effect, &writes);
        if ((i->op == OP_store || i->op == OP_acopy) && ad_active(f, i->args[0])) writes = inner = true;
        effect[i->id] = writes;
        if (i->op == OP_loop) taped[i->id] = inner;
        if (i->type == TY_FLT && ad_active(f, i)) inner = true;
        any |= inner;
        *effects |= writes;
    }
    /* a yield may hand on a value that is active outside: it overwrites a carried value */
    for (uint32_t a = 0; b->owner && b->last && a < b->last->nargs; a++)
        any |= b->last->args[a]->type == TY_FLT && ad_active(f, b->last->args[a]);
    return any;
}

static void facts(Vjp *v) {
    uint8_t *told = ARENA_ARRAY(v->scratch, uint8_t, ir_number(v->fn) + 1);
    ir_told(v->fn, v->scratch, told); /* where f is NaN, so may its derivatives be */
    ad_facts(&v->f, v->fn, v->scratch, v->o, v->links.v.data, told);
    v->taped = ARENA_ARRAY(v->scratch, uint8_t, v->f.n + 1);
    v->effect = ARENA_ARRAY(v->scratch, uint8_t, v->f.n + 1);
    bool effects = false;
    mark_regions(&v->f, v->fn->body, v->taped, v->effect, &effects);
}

/* ---- one attempt */

static Inst *value_in_sweep(void *user, Inst *primal) { return tape_value(user, primal); }

static void sweep(Vjp *v, const Fn *primal) {
    Fn *fn = v->fn;
    v->adj = ARENA_ARRAY(v->scratch, Adjoint, v->f.n + 1);
    v->adj_array = ARENA_ARRAY(v->scratch, Inst *, v->f.n + 1);
    v->memo = ARENA_ARRAY(v->scratch, Inst *, v->f.n + 1);
    v->fwd = ARENA_ARRAY(v->scratch, Inst *, v->f.n + 1);
    v->run = ARENA_ARRAY(v->scratch, Inst *, v->f.n + 1);
    v->want = ARENA_ARRAY(v->scratch, uint8_t, v->f.n + 1);
    v->gated = ARENA_ARRAY(v->scratch, uint8_t, v->f.n + 1);
    v->stable = ARENA_ARRAY(v->scratch, uint8_t, v->f.n + 1);
    v->stamp = ARENA_ARRAY(v->scratch, uint32_t, v->f.n + 1);
    v->any_inf = ad_makes_infinite(&v->f, fn->body);
    v->rule = (AdRule){
        .fma = v->ctx->has_fma, .value = value_in_sweep, .user = v, .range = v->f.range, .varied = v->f.varied};
    tape_prepare(v);

    Inst *yield = fn->body->last;
    Scope *top = ARENA_NEW(v->scratch, Scope);
    *top = (Scope){.top = true, .trips = 1, .fwd_block = fn->body};
    vec_push(v->scratch, &v->scopes, top);
    RevBlock rev = {fn->body, yield};
    vjp_push(v, fn->body, &rev, top);
    uint32_t floats = 0;
    for (uint32_t k = 0; k < yield->nargs; k++) floats += yield->args[k]->type == TY_FLT;
    if (floats > SLT_MAX_CHANNELS) ice(fn->session, "ad: %u float outputs, more than there are seeds", floats);
    if (v->o->rows > 1 && (floats != 1 || v->o->wrt_x)) ice(fn->session, "ad: rows of more than one number");
    Inst **out = ARENA_ARRAY(fn->arena, Inst *, floats + 4);
    Output *names = ARENA_ARRAY(fn->arena, Output, floats + 4);
    uint32_t n = 0;
    Inst *last = yield->prev; /* the sweep starts behind it */
    for (uint32_t k = 0; k < yield->nargs; k++) {
        if (yield->args[k]->type != TY_FLT) continue;
        names[n] = ad_output(primal, k);
        out[n] = yield->args[k];
        if (ad_active(&v->f, out[n])) {
            Builder b = vjp_builder(v);
            Inst *seed = v->o->rows > 1 ? ir_constf(&b, 1) : ir_input(&b, (InputSlot)(IN_SEED0 + n));
            vjp_add(v, out[n], ad_seed(seed, false));
        }
        n++;
    }
    if (vjp_is_sparse(v, fn->body))
        for (Inst *i = last; i;) i = vjp_chunk(v, i);
    else if (last) vjp_run(v, fn->body->first, last);
    if (v->o->no_value) n = 0;
    for (uint32_t d = 0; v->o->wrt_x && d < fn->dim; d++) {
        Inst *g = NULL;
        for (Inst *i = fn->body->first; i; i = i->next)
            if (i->op == OP_input && i->imm.i == IN_X0 + (int)d && i->id < v->f.n && v->adj[i->id].v)
                g = v->adj[i->id].v;
        Builder b = vjp_builder(v);
        names[n] = (Output){SLT_OUT_X_ADJOINT, d};
        out[n++] = g ? g : ir_constf(&b, 0);
    }
    yield->args = out;
    yield->nargs = n;
    fn->outputs = names;
}

/* ---- plans: which loops are replayed, and in how many levels they are checkpointed. An attempt follows a plan, and
 * tells what it costs. */

typedef struct LoopPlan {
    Inst *loop; /* of the attempt at hand; the outermost, where it has been strip-mined */
    uint32_t trips;
    uint8_t levels;
    bool replay;
    bool done;             /* more levels do not help */
    uint32_t stored_bytes; /* of a frame without replay */
} LoopPlan;

typedef struct Plan {
    Vec(LoopPlan) loops; /* in program order of the primal */
} Plan;

typedef Vec(Inst *) Loops;

static void collect_loops(Block *b, Vjp *v, Loops *loops) {
    for (Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_loop) vec_push(v->scratch, loops, i);
        for (uint32_t r = 0; r < i->nregions; r++) collect_loops(i->region[r], v, loops);
    }
}

/* Iterations of the innermost of `levels` + 1 nested loops that make n in all: the n^(1/(levels + 1))-th root, rounded
 * up. */
static uint32_t fan_out(uint32_t n, uint32_t levels) {
    uint32_t f = (uint32_t)pow((double)n, 1.0 / (levels + 1));
    for (;; f++) {
        double all = 1;
        for (uint32_t l = 0; l <= levels; l++) all *= f;
        if (all >= n) return f;
    }
}

static bool strip_mine(Vjp *v, LoopPlan *p) {
    uint32_t f = fan_out(p->trips, p->levels), made = 0;
    for (uint32_t l = 0; l < p->levels; l++) made += ad_strip_mine(v->fn, p->loop, f);
    return made == p->levels;
}

static bool attempt(Vjp *v, const Fn *primal, Plan *plan) {
    v->fn = ir_clone(primal, primal->arena, arena_printf(primal->arena, "%s_vjp", primal->name));
    ad_clear_tags(v->fn->body);
    Loops loops = {0};
    collect_loops(v->fn->body, v, &loops);
    for (uint32_t n = 0; n < loops.len; n++) {
        if (n == plan->loops.len)
            vec_push(v->scratch, &plan->loops, ((LoopPlan){.trips = loops.data[n]->imm.loop.max_iters}));
        plan->loops.data[n].loop = loops.data[n];
    }
    for (uint32_t n = 0; n < loops.len; n++) {
        LoopPlan *p = &plan->loops.data[n];
        if (p->replay) p->loop->tag = AD_TAG_REPLAY;
        if (!strip_mine(v, p)) return false;
    }
    ad_expand_customs(v->fn, v->scratch, &v->links);
    ad_hoist_inputs(v->fn, v->scratch);
    facts(v);
    if (ad_split_ifs(v->fn, v->taped)) facts(v);
    sweep(v, primal);
    return true;
}

static LoopPlan *plan_of(Plan *plan, const Scope *s) {
    for (uint32_t n = 0; n < plan->loops.len; n++)
        if (plan->loops.data[n].loop == s->owner) return &plan->loops.data[n];
    return NULL;
}

bool vjp_reads_told(const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_told) return true;
        for (uint32_t r = 0; r < i->nregions && i->op != OP_loop; r++)
            if (vjp_reads_told(i->region[r])) return true;
    }
    return false;
}

/* Replay where it may pay: the frame is large, the loop runs often enough, and the iteration can be run again. */
static bool choose_replays(const Vjp *v, Plan *plan) {
    bool any = false;
    for (uint32_t k = 0; k < v->scopes.len; k++) {
        const Scope *s = v->scopes.data[k];
        LoopPlan *p = s->top ? NULL : plan_of(plan, s);
        if (!p || !s->framed || !tape_can_replay(v, s->owner, s)) continue;
        if (v->o->replay == AD_REPLAY_AUTO &&
            (s->trips < 2 || s->frame_bytes < REPLAY_BYTES || !tape_searches(s->owner->region[0])) &&
            !vjp_reads_told(s->owner->region[0]))
            continue;
        p->replay = true;
        p->stored_bytes = s->frame_bytes;
        any = true;
    }
    return any;
}

/* Takes back replays that have not made frames clearly smaller. */
static bool drop_replays(const Vjp *v, Plan *plan) {
    bool any = false;
    for (uint32_t k = 0; v->o->replay == AD_REPLAY_AUTO && k < v->scopes.len; k++) {
        const Scope *s = v->scopes.data[k];
        LoopPlan *p = s->top ? NULL : plan_of(plan, s);
        if (!p || !p->replay || (uint64_t)s->frame_bytes * 3 <= (uint64_t)p->stored_bytes * 2) continue;
        p->replay = false;
        any = true;
    }
    return any;
}

/* The next number of levels that makes the innermost loop shorter, 0 if there is none. */
static uint32_t next_levels(const LoopPlan *p) {
    for (uint32_t l = p->levels + 1; l <= MAX_LEVELS; l++) {
        uint32_t f = fan_out(p->trips, l);
        if (f < 2 || pow(f, l) >= p->trips) continue; /* the outermost loop would run once */
        if (f < fan_out(p->trips, p->levels)) return l;
    }
    return 0;
}

/* Does the loop belong to a path: does it, or the outermost loop or if around it, ask a query? */
static bool of_path(const Scope *s) {
    while (!s->parent->top) s = s->parent;
    return tape_searches(s->owner->region[s->region]);
}

static uint64_t path_bytes(const Vjp *v) {
    uint64_t left = 0, most = 0;
    for (uint32_t k = 1; k < v->scopes.len; k++) {
        const Scope *s = v->scopes.data[k];
        if (!s->parent->top || !of_path(s)) continue;
        uint64_t on_top = tape_on_top(v, s) + (s->segment ? tape_left(v, s) : 0);
        if (!s->segment) left += tape_left(v, s);
        if (on_top > most) most = on_top;
    }
    return left + most;
}

/* A list that [Cull] promises stays; one that was found goes where the tape needs the loop cut. */
static bool is_promised(const Inst *loop) { return loop->imm.loop.cull && !loop->imm.loop.found; }

/* The loop that more levels would help most: the one that needs the most bytes in all, outermost first. */
static LoopPlan *choose_level(const Vjp *v, Plan *plan, bool paths_only) {
    uint64_t most = 0;
    LoopPlan *best = NULL;
    for (uint32_t k = 0; k < v->scopes.len; k++) {
        const Scope *s = v->scopes.data[k];
        LoopPlan *p = s->top ? NULL : plan_of(plan, s);
        if (!p || p->done || s->told || (paths_only && !of_path(s)) || is_promised(s->owner) ||
            !tape_can_rerun(v, s->owner) || !next_levels(p))
            continue;
        uint64_t bytes = tape_left(v, s) + tape_on_top(v, s);
        for (const Scope *up = s->parent; up && !s->segment && (!up->replay || up->keeps); up = up->parent)
            bytes *= up->told ? 1 : up->trips;
        if (bytes <= most) continue;
        most = bytes;
        best = p;
    }
    return best;
}

static void copy_plan(Arena *scratch, Plan *to, const Plan *from) {
    to->loops.len = 0;
    for (uint32_t n = 0; n < from->loops.len; n++) vec_push(scratch, &to->loops, from->loops.data[n]);
}

typedef struct Search {
    PassCtx *ctx;
    const Fn *primal;
    const AdOptions *o;
    TapeReport *report;
    uint64_t budget, path_budget, bytes;
    Fn *best;
} Search;

static void try_plan(Search *q, Plan *plan, Vjp *v) {
    *v = (Vjp){.ctx = q->ctx, .scratch = &q->ctx->session->scratch, .o = q->o};
    if (!attempt(v, q->primal, plan)) ice(q->ctx->session, "ad: a loop chosen for checkpoints cannot be strip-mined");
}

static void keep(Search *q, Vjp *v) {
    q->best = v->fn;
    q->bytes = tape_bytes(v);
    if (!q->report) return;
    *q->report = (TapeReport){.bytes_per_lane = q->bytes, .grows = tape_grows(v)};
    for (uint32_t s = 0; s < v->scopes.len; s++)
        q->report->frame_values += v->scopes.data[s]->framed ? v->scopes.data[s]->stored.len : 0;
    q->report->text = tape_report(v, q->primal->arena, q->bytes, q->budget);
}

Fn *ad_vjp(PassCtx *ctx, const Fn *fn, const AdOptions *o, TapeReport *report) {
    Arena *scratch = &ctx->session->scratch;
    ArenaMark m = arena_mark(scratch);
    AdOptions none = {0};
    Search q = {.ctx = ctx, .primal = fn, .o = o ? o : &none, .report = report};
    q.budget = q.o->tape_budget ? q.o->tape_budget : DEFAULT_BUDGET;
    q.path_budget = q.o->tape_budget ? q.o->tape_budget : PATH_BUDGET;
    Plan plan = {0}, next = {0};
    Vjp v, w;
    try_plan(&q, &plan, &v);
    uint32_t replays = 0;
    while (q.o->replay != AD_REPLAY_NEVER && (replays == 0 ? choose_replays(&v, &plan) : drop_replays(&v, &plan)) &&
           replays++ < 3)
        try_plan(&q, &plan, &v);
    keep(&q, &v);
    /* Levels, one after the other, while the worst case is above the budget: a level costs about one more run of its
     * loop. */
    for (uint32_t n = 0; n < MAX_ATTEMPTS; n++) {
        bool paths_only = q.bytes <= q.budget;
        if (paths_only && path_bytes(&v) <= q.path_budget) break;
        LoopPlan *p = choose_level(&v, &plan, paths_only);
        if (!p) break;
        copy_plan(scratch, &next, &plan);
        next.loops.data[p - plan.loops.data].levels = (uint8_t)next_levels(p);
        ArenaMark kept = arena_mark(fn->arena);
        try_plan(&q, &next, &w);
        if (tape_bytes(&w) >= q.bytes) {
            if (fn->arena != scratch) arena_reset(fn->arena, kept);
            p->done = true;
            continue;
        }
        copy_plan(scratch, &plan, &next);
        v = w;
        keep(&q, &v);
    }
    arena_reset(scratch, m);
    if (q.o->rows > 1) ad_scale_rows(q.best, q.o->rows);
    return q.best;
}
