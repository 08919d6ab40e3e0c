/* Reverse mode on structured IR: the primal, then one sweep backwards.
 *
 * Order of work: clone, strip-mine what an earlier attempt found too big, inline customs, hoist x, split ifs that hold loops on both sides, find facts,
 * emit the sweep. The attempt is repeated while the worst-case tape is above the budget and some loop can still be strip-mined. */
#include <math.h>
#include <string.h>

#include "compiler/pass/ad_tape.h"

enum { MAX_STRIPS = 12, DEFAULT_BUDGET = 64 * 1024 };

typedef struct Strip {
    uint32_t ordinal; /* of the loop, in program order of the primal */
    uint32_t segment;
} Strip;

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
    a->inf |= t.range.inf;
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

static Inst *load(Builder *b, Inst *array, Inst *index) { return ir_special(b, OP_load, TY_FLT, 2, (Inst *[]){array, index}, (Imm){0}); }
static void store(Builder *b, Inst *array, Inst *index, Inst *x) { ir_special(b, OP_store, TY_VOID, 3, (Inst *[]){array, index, x}, (Imm){0}); }

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

static void reverse_row(Vjp *v, Inst *i) {
    Adjoint g = v->adj[i->id];
    if (!g.v || !ad_active(&v->f, i)) return;
    for (uint32_t a = 0; a < i->nargs; a++) {
        if (i->args[a]->type != TY_FLT || !ad_active(&v->f, i->args[a])) continue;
        v->rule.b = vjp_builder(v);
        v->rule.b.span = i->span;
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
    case OP_detach:
        if (i->tag && v->adj[i->id].v) vjp_add(v, v->links.v.data[i->tag - 1], ad_seed(v->adj[i->id].v, v->adj[i->id].inf));
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

void vjp_block(Vjp *v, Block *b) {
    /* Code that the sweep asks for lands in the forward part too: ids tell it apart. */
    for (Inst *i = b->last, *prev; i; i = prev) {
        prev = i->prev;
        if (i->id < v->f.n && i->op != OP_yield) reverse_inst(v, i);
    }
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
    /* a yield may hand on what is active outside: an overwrite of a carried value */
    for (uint32_t a = 0; b->owner && b->last && a < b->last->nargs; a++) any |= b->last->args[a]->type == TY_FLT && ad_active(f, b->last->args[a]);
    return any;
}

static void facts(Vjp *v) {
    ad_facts(&v->f, v->fn, v->scratch, v->o, v->links.v.data);
    v->taped = ARENA_ARRAY(v->scratch, uint8_t, v->f.n + 1);
    v->effect = ARENA_ARRAY(v->scratch, uint8_t, v->f.n + 1);
    bool effects = false;
    mark_regions(&v->f, v->fn->body, v->taped, v->effect, &effects);
}

/* ---- one attempt */

static void collect_loops(Block *b, Vjp *v, void *list) {
    Vec(Inst *) *loops = list;
    for (Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_loop) vec_push(v->scratch, loops, i);
        for (uint32_t r = 0; r < i->nregions; r++) collect_loops(i->region[r], v, list);
    }
}

static Inst *value_in_sweep(void *user, Inst *primal) { return tape_value(user, primal); }

static void sweep(Vjp *v, const Fn *primal) {
    Fn *fn = v->fn;
    v->adj = ARENA_ARRAY(v->scratch, Adjoint, v->f.n + 1);
    v->adj_array = ARENA_ARRAY(v->scratch, Inst *, v->f.n + 1);
    v->memo = ARENA_ARRAY(v->scratch, Inst *, v->f.n + 1);
    v->fwd = ARENA_ARRAY(v->scratch, Inst *, v->f.n + 1);
    v->want = ARENA_ARRAY(v->scratch, uint8_t, v->f.n + 1);
    v->stable = ARENA_ARRAY(v->scratch, uint8_t, v->f.n + 1);
    v->stamp = ARENA_ARRAY(v->scratch, uint32_t, v->f.n + 1);
    v->any_inf = ad_makes_infinite(&v->f, fn->body);
    v->rule = (AdRule){.fma = v->ctx->has_fma, .value = value_in_sweep, .user = v, .range = v->f.range, .varied = v->f.varied};
    tape_prepare(v);

    Inst *yield = fn->body->last;
    Scope *top = ARENA_NEW(v->scratch, Scope);
    *top = (Scope){.top = true, .trips = 1, .fwd_block = fn->body};
    vec_push(v->scratch, &v->scopes, top);
    RevBlock rev = {fn->body, yield};
    vjp_push(v, fn->body, &rev, top);
    uint32_t floats = 0;
    for (uint32_t k = 0; k < yield->nargs; k++) floats += yield->args[k]->type == TY_FLT;
    if (floats > IN_SEED3 - IN_SEED0 + 1) ice(fn->session, "ad: %u float outputs, more than there are seeds", floats);
    Inst **out = ARENA_ARRAY(fn->arena, Inst *, floats + 4);
    const char **names = ARENA_ARRAY(fn->arena, const char *, floats + 4);
    uint32_t n = 0;
    Inst *last = yield->prev; /* the sweep starts behind it */
    for (uint32_t k = 0; k < yield->nargs; k++) {
        if (yield->args[k]->type != TY_FLT) continue;
        names[n] = ad_output_name(fn, primal, k, "");
        out[n] = yield->args[k];
        if (ad_active(&v->f, out[n])) {
            Builder b = vjp_builder(v);
            vjp_add(v, out[n], ad_seed(ir_input(&b, (InputSlot)(IN_SEED0 + n)), false));
        }
        n++;
    }
    for (Inst *i = last, *prev; i; i = prev) {
        prev = i->prev;
        if (i->id < v->f.n) reverse_inst(v, i);
    }
    for (uint32_t d = 0; v->o->wrt_x && d < fn->dim; d++) {
        Inst *g = NULL;
        for (Inst *i = fn->body->first; i; i = i->next)
            if (i->op == OP_input && i->imm.i == IN_X0 + (int)d && i->id < v->f.n && v->adj[i->id].v) g = v->adj[i->id].v;
        Builder b = vjp_builder(v);
        names[n] = arena_printf(fn->arena, "adj.x%u", d);
        out[n++] = g ? g : ir_constf(&b, 0);
    }
    yield->args = out;
    yield->nargs = n;
    fn->outputs = names;
}

static bool attempt(Vjp *v, const Fn *primal, const Strip *strips, uint32_t nstrips, void *loops) {
    Vec(Inst *) *list = loops;
    v->fn = ir_clone(primal, primal->arena, arena_printf(primal->arena, "%s_vjp", primal->name));
    ad_clear_tags(v->fn->body);
    list->len = 0;
    collect_loops(v->fn->body, v, loops);
    for (uint32_t s = 0; s < nstrips; s++)
        if (!ad_strip_mine(v->fn, list->data[strips[s].ordinal], strips[s].segment)) return false;
    ad_expand_customs(v->fn, v->scratch, &v->links);
    ad_hoist_inputs(v->fn, v->scratch);
    facts(v);
    if (ad_split_ifs(v->fn, v->taped)) facts(v);
    sweep(v, primal);
    return true;
}

/* The scope that strip-mining would help most: the one with the most bytes in all, outermost first. */
static uint64_t total_bytes(const Vjp *v, const Scope *s) {
    uint64_t bytes = s->framed ? s->frame_bytes : 0;
    for (uint32_t k = 0; k < v->scopes.len; k++)
        if (v->scopes.data[k]->parent == s) bytes += total_bytes(v, v->scopes.data[k]);
    return bytes * s->trips;
}

static bool choose_strip(const Vjp *v, Inst *const *loops, uint32_t nloops, const Strip *strips, uint32_t nstrips, Strip *out) {
    uint64_t most = 0;
    for (uint32_t k = 0; k < v->scopes.len; k++) {
        const Scope *s = v->scopes.data[k];
        if (s->top || s->owner->op != OP_loop || s->trips < 4 || s->owner->imm.loop.cull || !tape_can_rerun(v, s->owner)) continue;
        uint64_t bytes = total_bytes(v, s);
        for (const Scope *p = s->parent; p; p = p->parent) bytes *= p->trips;
        uint32_t ordinal = 0;
        while (ordinal < nloops && loops[ordinal] != s->owner) ordinal++;
        bool fresh = ordinal < nloops;
        for (uint32_t t = 0; t < nstrips; t++) fresh &= strips[t].ordinal != ordinal;
        if (!fresh || bytes <= most) continue;
        most = bytes;
        *out = (Strip){ordinal, (uint32_t)ceil(sqrt((double)s->trips))};
    }
    return most > 0;
}

Fn *ad_vjp(PassCtx *ctx, const Fn *fn, const AdOptions *o, TapeReport *report) {
    Arena *scratch = &ctx->session->scratch;
    ArenaMark m = arena_mark(scratch);
    AdOptions none = {0};
    uint64_t budget = o && o->tape_budget ? o->tape_budget : DEFAULT_BUDGET, bytes = 0;
    Strip strips[MAX_STRIPS];
    uint32_t nstrips = 0;
    Fn *best = NULL;
    for (;;) {
        Vjp v = {.ctx = ctx, .scratch = scratch, .o = o ? o : &none};
        Vec(Inst *) loops = {0};
        if (!attempt(&v, fn, strips, nstrips, &loops)) ice(ctx->session, "ad: a loop chosen for checkpoints cannot be strip-mined");
        uint64_t now = tape_bytes(&v);
        if (!best || now < bytes) {
            best = v.fn;
            bytes = now;
            if (report) {
                *report = (TapeReport){.bytes_per_lane = now};
                for (uint32_t s = 0; s < v.scopes.len; s++) report->frame_values += v.scopes.data[s]->framed ? v.scopes.data[s]->stored.len : 0;
                report->text = tape_report(&v, fn->arena, now, budget);
            }
        }
        if (now <= budget || nstrips == MAX_STRIPS || !choose_strip(&v, loops.data, loops.len, strips, nstrips, &strips[nstrips])) break;
        nstrips++;
    }
    arena_reset(scratch, m);
    return best;
}
