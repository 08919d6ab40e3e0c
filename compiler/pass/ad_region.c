/* Reverse mode: ifs and loops.
 *
 * What flows out of the reverse of a region are the adjoints of the active values that it uses from outside: results of
 * an if_, carried values of a revloop. Those that turn out unchanged are taken out again. Arrays need nothing: their
 * adjoints are arrays. A region that pushes frames is reversed by a revloop even if it is the region of an if_: the
 * mask of the frame is its condition. */
#include <math.h>

#include "compiler/pass/ad_tape.h"

typedef Vec(Inst *) Insts;

static void free_active(Vjp *v, Block *b, const Block *root, Insts *out) {
    for (Inst *i = b->first; i; i = i->next) {
        uint32_t n = i->nargs + (i->op == OP_detach && i->tag ? 1 : 0);
        for (uint32_t a = 0; a < n; a++) {
            Inst *x = a < i->nargs ? i->args[a] : v->links.v.data[i->tag - 1];
            if (x->type != TY_FLT || !ad_active(&v->f, x) || v->stamp[x->id] == v->stamps ||
                walk_inside(x->block, root))
                continue;
            v->stamp[x->id] = v->stamps;
            vec_push(v->scratch, out, x);
        }
        for (uint32_t r = 0; r < i->nregions; r++) free_active(v, i->region[r], root, out);
    }
}

static Scope *new_scope(Vjp *v, Inst *owner, uint32_t region) {
    Scope *s = ARENA_NEW(v->scratch, Scope);
    s->parent = vjp_here(v)->scope;
    s->owner = owner;
    s->region = region;
    s->trips = 1;
    vec_push(v->scratch, &v->scopes, s);
    return s;
}

static uint32_t type_bytes(const Vjp *v, const Inst *x) {
    return x->type == TY_TAPE || (x->type == TY_FLT && v->fn->precision == PREC_F64) ? 8 : 4;
}

/* Puts the parameters of a finished revloop in order: the frame's, then the carried. */
static void order_params(Vjp *v, Scope *s, Inst **carried, uint32_t ncarried) {
    Block *b = s->rev_block;
    uint32_t n = 0;
    b->params = ARENA_ARRAY(v->fn->arena, Inst *, s->params.len + ncarried + 1);
    for (uint32_t p = 0; p < s->params.len; p++) b->params[n++] = s->params.data[p];
    for (uint32_t c = 0; c < ncarried; c++) b->params[n++] = carried[c];
    b->nparams = n;
    for (uint32_t p = 0; p < n; p++) b->params[p]->imm.i = p;
}

/* An exact loop that stores nothing is reversed by a loop that counts down. */
static void make_counted(Vjp *v, Scope *s, Inst *rev, Inst **carried, uint32_t ncarried) {
    Block *b = s->rev_block;
    LoopInfo info = s->owner->imm.loop;
    b->nparams = 0;
    b->params = NULL;
    Inst *j = ir_block_param(v->fn, b, TY_INT);
    Builder top = {.fn = v->fn, .block = b, .before = b->first, .fold = true, .span = s->owner->span};
    Inst *last = ir_consti(&top, (int32_t)info.max_iters - 1);
    if (info.cull) { /* over places of the list, from the last to the first */
        Inst *all = ir_consti(&top, (int32_t)info.max_iters);
        all = ir_special(&top, OP_items, TY_INT, 1, &all, (Imm){.i = info.cull_id});
        last = ir_emit2(&top, OP_isub, all, ir_consti(&top, 1));
    }
    if (s->k) {
        Inst *k = ir_emit2(&top, OP_isub, last, j);
        if (info.cull) k = ir_special(&top, OP_item, TY_INT, 1, &k, (Imm){.i = info.cull_id});
        walk_replace(b, s->k, k);
    }
    Inst **params = ARENA_ARRAY(v->fn->arena, Inst *, ncarried + 1);
    params[0] = j;
    for (uint32_t c = 0; c < ncarried; c++) params[c + 1] = carried[c], carried[c]->imm.i = c + 1;
    b->params = params;
    b->nparams = ncarried + 1;
    Builder end = ir_at_end(v->fn, b);
    end.fold = true;
    Inst *on = ir_emit2(&end, OP_ilt, j, last);
    info.exact &= !info.cull, info.cull = false;
    Inst *yield = b->last, **args = ARENA_ARRAY(v->fn->arena, Inst *, yield->nargs + 1);
    args[0] = on;
    for (uint32_t a = 0; a < yield->nargs; a++) args[a + 1] = yield->args[a];
    yield->args = args;
    yield->nargs++;
    rev->op = OP_loop;
    rev->args++;
    rev->nargs--;
    rev->imm.loop = info;
}

/* What the iterations of a loop are told apart by is told: one from the first on adds to the adjoints of parameters,
 * and does so whatever the others do. Where it also needs no frame it is reversed by a loop that runs forwards, as long
 * as the number of the iteration is below this value. NULL: it is another. */
static Inst *free_limit(const Scope *s, uint32_t ncarried) {
    const Block *body = s->owner->region[0];
    if (s->owner->op != OP_loop || ncarried || s->guards.len || s->stored.len || s->segment) return NULL;
    const Inst *on = body->last->args[0];
    const bool counts = on->op == OP_ilt && on->args[0] == body->params[0] && !walk_inside(on->args[1]->block, body);
    return counts && vjp_reads_told(body) ? on->args[1] : NULL;
}

static void make_free(Vjp *v, Scope *s, Inst *rev, Inst *limit) {
    Block *b = s->rev_block;
    b->nparams = 0, b->params = NULL;
    if (s->k) b->params = ARENA_ARRAY(v->fn->arena, Inst *, 1), b->params[b->nparams++] = s->k, s->k->imm.i = 0;
    else s->k = ir_block_param(v->fn, b, TY_INT);
    limit = tape_value(v, limit);
    Builder end = ir_at_end(v->fn, b);
    Inst **on = ARENA_ARRAY(v->fn->arena, Inst *, 1);
    on[0] = ir_emit2(&end, OP_ilt, s->k, limit);
    b->last->args = on, b->last->nargs = 1;
    rev->op = OP_loop, rev->nargs = 0, rev->imm.loop = s->owner->imm.loop;
}

typedef struct Carried {
    Inst *param;    /* of the revloop */
    Inst *primal;   /* the outer value whose adjoint is carried, or NULL */
    uint32_t index; /* of the loop's carried value, if primal is NULL */
    Inst *init, *next, *result;
    bool inf, had; /* had: the adjoint was not zero before */
    bool same;     /* the region does not change it */
} Carried;

/* The sweep of a loop without adjoints for what it hands on makes zeros of zeros: around it goes
 *
 *     if_ (is any of them, in any lane, not 0) { the revloop } else { drop its frames }
 *
 * Rays that hit nothing are not followed back. Of lanes each for itself masks would cost more than they save. Returns
 * the if_. */
static Inst *pass_over(Vjp *v, Inst *rev, Inst *any, const Carried *carried, uint32_t n) {
    Builder b = ir_before(v->fn, rev);
    Inst *guard = ir_if(&b, any), **then = ARENA_ARRAY(v->scratch, Inst *, n + 1),
         **other = ARENA_ARRAY(v->scratch, Inst *, n + 1);
    uint32_t kept = 0;
    Builder in = ir_at_end(v->fn, guard->region[0]), out = ir_at_end(v->fn, guard->region[1]);
    ir_special(&out, OP_tapedrop, TY_VOID, 1, rev->args, (Imm){0});
    for (uint32_t c = 0; c < n; c++)
        if (!carried[c].result) other[kept] = carried[c].init, then[kept] = NULL, kept++;
    Inst *end = ir_yield(&in, 0, NULL);
    ir_move_before(rev, end);
    ir_unlink(end);
    for (uint32_t k = 0; k < kept; k++) then[k] = ir_proj(&in, rev, k);
    ir_yield(&in, kept, then), ir_yield(&out, kept, other);
    return guard;
}

/* Emits revloop { reverse of `body` } where the primal region is owner's; carried[0..n) are set up with init and
 * primal. any: see pass_over; NULL: it always runs. */
static void reverse_scope(Vjp *v, Scope *s, Block *body, Carried *carried, uint32_t n, Inst *any) {
    Ctx *outer = vjp_here(v);
    Inst *saved_before = outer->rev->before;
    Builder b = vjp_builder(v);
    b.span = s->owner->span;
    Inst **args = ARENA_ARRAY(v->fn->arena, Inst *, n + 1);
    for (uint32_t c = 0; c < n; c++) args[c + 1] = carried[c].init;
    Inst *rev = ir_special(&b, OP_revloop, TY_VOID, n + 1, args, (Imm){0});
    s->rev_block = ir_block(v->fn, rev);
    for (uint32_t c = 0; c < n; c++) carried[c].param = ir_block_param(v->fn, s->rev_block, TY_FLT);
    outer->rev->before = rev;

    RevBlock inner = {s->rev_block, NULL};
    vjp_push(v, body, &inner, s);
    bool loop = s->owner->op == OP_loop;
    if (loop) s->fwd_k = tape_forward(v, body->params[0]);
    if (s->replay) tape_replay(v, s, body);
    for (uint32_t c = 0; c < n; c++)
        if (carried[c].primal) v->adj[carried[c].primal->id] = (Adjoint){carried[c].param, carried[c].inf};
    if (loop) {
        for (uint32_t c = 0; c < n; c++)
            if (!carried[c].primal)
                vjp_add(v, body->last->args[carried[c].index + 1], ad_seed(carried[c].param, carried[c].inf));
    } else {
        for (Inst *p = s->owner->next; p && p->op == OP_proj && p->args[0] == s->owner; p = p->next)
            if (vjp_seeded(v, p)) vjp_add(v, body->last->args[p->imm.i], ad_seed(v->adj[p->id].v, v->adj[p->id].inf));
    }
    if (s->guards.len == 1) { /* in every iteration that is visited the guard was taken */
        Guard g = s->guards.data[0];
        Builder top = rev_builder(v, &inner);
        Inst *cond = g.branch->args[0];
        if (cond->block == body) v->memo[cond->id] = ir_constb(&top, g.region == 0);
    }
    vjp_block(v, body);
    Builder end = rev_builder(v, &inner);
    for (uint32_t c = 0; c < n; c++) {
        Inst *of = carried[c].primal ? carried[c].primal : body->params[carried[c].index + 1];
        carried[c].next = v->adj[of->id].v ? v->adj[of->id].v : ir_constf(&end, 0);
    }
    vjp_pop(v);

    /* adjoints that the region does not change need not be carried */
    uint32_t kept = 0;
    Inst **params = ARENA_ARRAY(v->scratch, Inst *, n + 1), **next = ARENA_ARRAY(v->scratch, Inst *, n + 1);
    for (uint32_t c = 0; c < n; c++) {
        if (carried[c].next == carried[c].param) {
            walk_replace(s->rev_block, carried[c].param, carried[c].init);
            for (uint32_t k = 0; k < n; k++)
                if (carried[k].next == carried[c].param) carried[k].next = carried[c].init;
            carried[c].result = carried[c].init;
            carried[c].same = true;
            continue;
        }
        rev->args[kept + 1] = carried[c].init;
        params[kept++] = carried[c].param;
    }
    rev->nargs = kept + 1;
    kept = 0;
    for (uint32_t c = 0; c < n; c++)
        if (!carried[c].result) next[kept++] = carried[c].next;
    Builder y = rev_builder(v, &inner);
    ir_yield(&y, kept, next);
    if (s->replay) tape_fill_replay(v, s);

    Inst *mark = NULL;
    LoopInfo info = loop ? s->owner->imm.loop : (LoopInfo){0};
    bool counts = info.exact && (!info.cull || info.found) && !s->guards.len && !s->stored.len;
    Inst *limit = counts ? NULL : free_limit(s, kept);
    s->framed = !counts && !limit;
    if (counts) {
        make_counted(v, s, rev, params, kept);
    } else if (limit) {
        make_free(v, s, rev, limit);
    } else {
        if (s->k) { /* the iteration number goes first */
            vec_push(v->scratch, &s->stored, NULL);
            vec_push(v->scratch, &s->params, NULL);
            for (uint32_t p = s->stored.len - 1; p > 0; p--)
                s->stored.data[p] = s->stored.data[p - 1], s->params.data[p] = s->params.data[p - 1];
            s->stored.data[0] = s->fwd_k;
            s->params.data[0] = s->k;
        }
        order_params(v, s, params, kept);
        for (uint32_t p = 0; p < s->stored.len; p++)
            s->frame_bytes += s->k && p == 0 ? 0 : type_bytes(v, s->stored.data[p]);
        s->frame_bytes += 4; /* the mask, the iteration number and the padding, at any width */
        Builder before = ir_before(v->fn, tape_run(v, s->owner));
        mark = ir_special(&before, OP_tapemark, TY_TAPE, 0, NULL, (Imm){0});
        rev->args[0] = tape_mark_value(v, mark, s->segment);
        tape_push_frame(v, s);
    }
    if (s->segment) tape_fill_rerun(v, s, mark, rev);
    if (any && s->framed) rev = pass_over(v, rev, any, carried, n);
    Builder after = ir_after(v->fn, rev);
    kept = 0;
    for (uint32_t c = 0; c < n; c++)
        if (!carried[c].result) carried[c].result = ir_proj(&after, rev, kept++);
    outer->rev->before = saved_before;
}

static void set_result(Vjp *v, const Carried *c) {
    v->adj[c->primal->id] = c->same && !c->had ? (Adjoint){0} : (Adjoint){c->result, c->inf};
}

/* ---- loops */

/* NULL: the loop has adjoints of its own, arrays', or runs again from a checkpoint. */
static Inst *any_seed(Vjp *v, const Scope *s, const Adjoint *seed, uint32_t n) {
    if (v->effect[s->owner->id] || s->segment || v->o->dense) return NULL;
    Builder b = vjp_builder(v);
    Inst *none = ir_constb(&b, true), *zero = ir_constf(&b, 0);
    for (uint32_t c = 0; c < n; c++)
        if (seed[c].v) none = ir_emit2(&b, OP_band, none, ir_emit2(&b, OP_feq, seed[c].v, zero));
    none = ir_emit1(&b, OP_bnot, none);
    return ir_is_const(none) ? NULL : ir_special(&b, OP_any, TY_BOOL, 1, &none, (Imm){0});
}

void vjp_loop(Vjp *v, Inst *loop) {
    Block *body = loop->region[0];
    bool any = v->effect[loop->id];
    uint32_t ncarried = body->nparams - 1;
    Adjoint *seed = ARENA_ARRAY(v->scratch, Adjoint, ncarried + 1);
    for (Inst *p = loop->next; p && p->op == OP_proj && p->args[0] == loop; p = p->next)
        if (vjp_seeded(v, p)) seed[p->imm.i] = v->adj[p->id], any = true;
    if (!any) return;

    Scope *s = new_scope(v, loop, 0);
    s->trips = loop->imm.loop.max_iters;
    s->told = loop->imm.loop.told;
    s->segment = (loop->tag & AD_TAG_SEGMENT) != 0;
    Inst *run = s->segment ? tape_rerun(v, s, loop) : tape_run(v, loop);
    s->fwd_block = run->region[0];
    if (tape_find_guards(v, loop, s)) {
        s->sparse = true;
        if (s->guards.len == 1) {
            s->fwd_outer = s->fwd_block;
            s->fwd_block = tape_forward(v, s->guards.data[0].branch)->region[s->guards.data[0].region];
        }
    } else {
        s->guards.len = 0;
    }
    s->replay = (loop->tag & AD_TAG_REPLAY) && tape_can_replay(v, loop, s);
    s->keeps = s->replay && tape_keeps(v, loop);

    Insts outer = {0};
    v->stamps++;
    free_active(v, body, body, &outer);
    Carried *carried = ARENA_ARRAY(v->scratch, Carried, ncarried + outer.len + 1);
    uint32_t n = 0;
    bool inf = ad_makes_infinite(&v->f, body) || (v->effect[loop->id] && v->any_inf);
    Builder b = vjp_builder(v);
    for (uint32_t c = 0; c < ncarried; c++) inf |= seed[c].inf;
    for (uint32_t c = 0; c < ncarried; c++) {
        Inst *param = body->params[c + 1];
        if (param->type != TY_FLT || (!seed[c].v && !ad_active(&v->f, param))) continue;
        carried[n++] = (Carried){
            .index = c, .init = seed[c].v ? seed[c].v : ir_constf(&b, 0), .inf = inf, .had = seed[c].v != NULL};
    }
    for (uint32_t u = 0; u < outer.len; u++) {
        Adjoint a = v->adj[outer.data[u]->id];
        carried[n++] = (Carried){
            .primal = outer.data[u], .init = a.v ? a.v : ir_constf(&b, 0), .inf = inf || a.inf, .had = a.v != NULL};
    }
    for (uint32_t c = 0; c < n; c++)
        if (!carried[c].primal) v->adj[body->params[carried[c].index + 1]->id] = (Adjoint){0};
    reverse_scope(v, s, body, carried, n, any_seed(v, s, seed, ncarried));
    for (uint32_t c = 0; c < n; c++)
        if (carried[c].primal) set_result(v, &carried[c]);
    for (uint32_t c = 0; c < n; c++)
        if (!carried[c].primal && (carried[c].had || !carried[c].same))
            vjp_add(v, loop->args[carried[c].index], ad_seed(carried[c].result, carried[c].inf));
}

/* ---- ifs */

static void reverse_framed_region(Vjp *v, Inst *i, uint32_t r) {
    Scope *s = new_scope(v, i, r);
    Block *body = i->region[r];
    s->fwd_block = tape_run(v, i)->region[r];
    if (v->run[i->id]) s->over = s->parent->replay ? s->parent : s->parent->over;
    Insts outer = {0};
    v->stamps++;
    free_active(v, body, body, &outer);
    Carried *carried = ARENA_ARRAY(v->scratch, Carried, outer.len + 1);
    Builder b = vjp_builder(v);
    bool inf = v->any_inf;
    for (uint32_t u = 0; u < outer.len; u++) {
        Adjoint a = v->adj[outer.data[u]->id];
        carried[u] = (Carried){
            .primal = outer.data[u], .init = a.v ? a.v : ir_constf(&b, 0), .inf = inf || a.inf, .had = a.v != NULL};
    }
    reverse_scope(v, s, body, carried, outer.len, NULL);
    for (uint32_t u = 0; u < outer.len; u++) set_result(v, &carried[u]);
}

static void seed_region(Vjp *v, Inst *i, uint32_t r) {
    for (Inst *p = i->next; p && p->op == OP_proj && p->args[0] == i; p = p->next)
        if (vjp_seeded(v, p))
            vjp_add(v, i->region[r]->last->args[p->imm.i], ad_seed(v->adj[p->id].v, v->adj[p->id].inf));
}

/* Has the block no instruction? What its yield hands on stands outside then. */
static bool hollow(const Block *b) { return b->first == NULL; }

static void reverse_plain_if(Vjp *v, Inst *i, const bool skip[2]) {
    Ctx *outer = vjp_here(v);
    Inst *saved_before = outer->rev->before;
    Builder b = vjp_builder(v);
    b.span = i->span;
    Inst *rev = ir_if(&b, NULL);
    outer->rev->before = rev;
    Insts used = {0};
    v->stamps++;
    for (uint32_t r = 0; r < 2; r++)
        if (!skip[r]) free_active(v, i->region[r], i->region[r], &used);
    Adjoint *before = ARENA_ARRAY(v->scratch, Adjoint, used.len + 1), *after[2];
    for (uint32_t u = 0; u < used.len; u++) before[u] = v->adj[used.data[u]->id];
    for (uint32_t r = 0; r < 2; r++) {
        RevBlock inner = {rev->region[r], NULL};
        after[r] = ARENA_ARRAY(v->scratch, Adjoint, used.len + 1);
        for (uint32_t u = 0; u < used.len; u++) v->adj[used.data[u]->id] = before[u];
        vjp_push(v, i->region[r], &inner, outer->scope);
        if (!skip[r]) {
            seed_region(v, i, r);
            vjp_block(v, i->region[r]);
        }
        vjp_pop(v);
        for (uint32_t u = 0; u < used.len; u++) after[r][u] = v->adj[used.data[u]->id];
    }
    uint32_t n = 0;
    Inst **out[2] = {ARENA_ARRAY(v->scratch, Inst *, used.len + 1), ARENA_ARRAY(v->scratch, Inst *, used.len + 1)};
    uint32_t *which = ARENA_ARRAY(v->scratch, uint32_t, used.len + 1);
    bool empty = hollow(rev->region[0]) && hollow(rev->region[1]);
    for (uint32_t u = 0; u < used.len; u++) {
        v->adj[used.data[u]->id] = before[u];
        if (after[0][u].v == before[u].v && after[1][u].v == before[u].v) continue;
        Builder o = vjp_builder(v);
        for (uint32_t r = 0; r < 2; r++) out[r][n] = after[r][u].v ? after[r][u].v : ir_constf(&o, 0);
        which[n++] = u;
    }
    if (empty && !n) {
        ir_unlink(rev);
        outer->rev->before = saved_before;
        return;
    }
    Inst *cond = tape_value(v, i->args[0]);
    if (empty) ir_unlink(rev);
    else {
        ir_replace_arg(rev, 0, cond);
        for (uint32_t r = 0; r < 2; r++) {
            Builder y = {.fn = v->fn, .block = rev->region[r], .span = i->span};
            ir_yield(&y, n, out[r]);
        }
    }
    outer->rev->before = saved_before;
    for (uint32_t k = 0; k < n; k++) {
        uint32_t u = which[k];
        Inst *joined;
        if (empty) {
            Builder o = vjp_builder(v);
            joined = ir_select(&o, cond, out[0][k], out[1][k]);
        } else {
            Builder o = ir_after(v->fn, rev);
            joined = ir_proj(&o, rev, k);
        }
        v->adj[used.data[u]->id] = (Adjoint){joined, after[0][u].inf || after[1][u].inf};
    }
}

void vjp_if(Vjp *v, Inst *i) {
    bool any = v->effect[i->id];
    for (Inst *p = i->next; p && p->op == OP_proj && p->args[0] == i; p = p->next) any |= vjp_seeded(v, p);
    if (!any) return;
    Ctx *here = vjp_here(v);
    Scope *s = here->scope;
    if (s->guards.len == 1 && s->guards.data[0].branch == i) {
        uint32_t r = s->guards.data[0].region;
        vjp_push(v, i->region[r], here->rev, s);
        seed_region(v, i, r);
        vjp_block(v, i->region[r]);
        vjp_pop(v);
        return;
    }
    bool framed[2] = {vjp_holds_taped(v, i->region[0]), vjp_holds_taped(v, i->region[1])};
    for (uint32_t r = 0; r < 2; r++)
        if (framed[r]) reverse_framed_region(v, i, r);
    reverse_plain_if(v, i, framed);
}
