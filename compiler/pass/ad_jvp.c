/* Forward mode: every active value gets its tangents right behind it, in the same control flow.
 *
 * A pass carries n tangent directions at once (1 for ad_jvp, dim for ad_grad_x). A tangent that is identically zero has
 * no code: it is NULL. Ifs get tangent results, loops tangent carried values, arrays tangent arrays; of a custom the
 * tangent region is inlined. */
#include <math.h>
#include <string.h>

#include "compiler/pass/ad.h"

typedef struct Jvp {
    Fn *fn;
    Arena *scratch;
    AdFacts facts;
    AdRule rule;
    uint32_t n;     /* directions */
    Inst **tangent; /* by id * n + direction; for alloc: the tangent array */
    bool *inf;      /* by id: its tangents may be infinite */
    bool grad_x, any_inf;
} Jvp;

static Inst *same_value(void *user, Inst *v) {
    (void)user; /* tangents stand beside the primal, whose values are at hand */
    return v;
}

static Inst *tangent(const Jvp *j, const Inst *v, uint32_t d) {
    return v->id < j->facts.n ? j->tangent[v->id * j->n + d] : NULL;
}
static void set_tangent(Jvp *j, const Inst *v, uint32_t d, Inst *t) { j->tangent[v->id * j->n + d] = t; }
static bool active(const Jvp *j, const Inst *v) { return ad_active(&j->facts, v); }

static Inst *tangent_or_zero(const Jvp *j, Builder *b, const Inst *v, uint32_t d) {
    Inst *t = tangent(j, v, d);
    return t ? t : ir_constf(b, 0);
}

static void jvp_block(Jvp *j, Block *b);

/* One select of tangents, not a sum of two: on boxes a sum of hulls with 0 would be wider than the hull. */
static void jvp_select(Jvp *j, Inst *i) {
    for (uint32_t d = 0; d < j->n; d++) {
        const Inst *yes = i->args[1], *no = i->args[2];
        if (!tangent(j, yes, d) && !tangent(j, no, d)) continue;
        Builder *b = &j->rule.b;
        set_tangent(j, i, d, ir_select(b, i->args[0], tangent_or_zero(j, b, yes, d), tangent_or_zero(j, b, no, d)));
        for (uint32_t a = 1; a < 3; a++) j->inf[i->id] |= i->args[a]->id < j->facts.n && j->inf[i->args[a]->id];
    }
}

static void jvp_row(Jvp *j, Inst *i) {
    bool inf = false;
    if (ir_ops[i->op].selects) {
        jvp_select(j, i);
        return;
    }
    for (uint32_t d = 0; d < j->n; d++) {
        Inst *sum = NULL;
        for (uint32_t a = 0; a < i->nargs; a++) {
            const Inst *arg = i->args[a];
            if (arg->type != TY_FLT || !active(j, arg) || !tangent(j, arg, d)) continue;
            AdTerm t = ad_partial(&j->rule, i, a, ad_seed(tangent(j, arg, d), j->inf[arg->id]));
            if (t.none) continue;
            inf |= (t.range.beyond & IR_POLE) != 0;
            sum = ad_term_add(&j->rule, sum, t);
        }
        set_tangent(j, i, d, sum);
    }
    j->inf[i->id] = inf;
}

static void jvp_if(Jvp *j, Inst *i) {
    for (uint32_t r = 0; r < 2; r++) jvp_block(j, i->region[r]);
    for (Inst *p = i->next, *next; p && p->op == OP_proj && p->args[0] == i; p = next) {
        next = p->next;
        if (p->type != TY_FLT || !active(j, p)) continue;
        const Inst *y[2] = {i->region[0]->last->args[p->imm.i], i->region[1]->last->args[p->imm.i]};
        for (uint32_t r = 0; r < 2; r++) j->inf[p->id] |= y[r]->id < j->facts.n && j->inf[y[r]->id];
        for (uint32_t d = 0; d < j->n; d++) {
            if (!tangent(j, y[0], d) && !tangent(j, y[1], d)) continue;
            uint32_t index = ir_nresults(i);
            for (uint32_t r = 0; r < 2; r++) {
                Builder b = ir_at_end(j->fn, i->region[r]);
                ir_append_arg(j->fn, i->region[r]->last, tangent_or_zero(j, &b, y[r], d));
            }
            Builder b = ir_after(j->fn, i);
            set_tangent(j, p, d, ir_proj(&b, i, index));
        }
    }
}

static void jvp_loop(Jvp *j, Inst *i) {
    Block *body = i->region[0];
    uint32_t carried = body->nparams - 1;
    bool *with = ARENA_ARRAY(j->scratch, bool, carried + 1);
    uint32_t *index = ARENA_ARRAY(j->scratch, uint32_t, carried + 1), n = carried;
    Inst **projs = ARENA_ARRAY(j->scratch, Inst *, carried + 1);
    bool inf = ad_makes_infinite(&j->facts, body);
    for (uint32_t c = 0; c < carried; c++) inf |= i->args[c]->id < j->facts.n && j->inf[i->args[c]->id];
    for (Inst *p = i->next; p && p->op == OP_proj && p->args[0] == i; p = p->next) projs[p->imm.i] = p;
    for (uint32_t c = 0; c < carried; c++) {
        const Inst *param = body->params[c + 1];
        with[c] = active(j, param) || (projs[c] && projs[c]->type == TY_FLT && active(j, projs[c]));
        if (!with[c]) continue;
        index[c] = n;
        j->inf[param->id] = inf;
        for (uint32_t d = 0; d < j->n; d++, n++) {
            Builder b = ir_before(j->fn, i);
            ir_append_arg(j->fn, i, tangent_or_zero(j, &b, i->args[c], d));
            set_tangent(j, param, d, ir_block_param(j->fn, body, TY_FLT));
        }
    }
    jvp_block(j, body);
    for (uint32_t c = 0; c < carried; c++)
        for (uint32_t d = 0; with[c] && d < j->n; d++) {
            Builder b = ir_at_end(j->fn, body);
            ir_append_arg(j->fn, body->last, tangent_or_zero(j, &b, body->last->args[c + 1], d));
        }
    for (uint32_t c = 0; c < carried; c++)
        for (uint32_t d = 0; with[c] && projs[c] && d < j->n; d++) {
            Builder b = ir_after(j->fn, i);
            set_tangent(j, projs[c], d, ir_proj(&b, i, index[c] + d));
            j->inf[projs[c]->id] = inf;
        }
}

/* Tangents of a custom come from its second region, once for each direction; the instruction stays for the values. */
static void jvp_custom(Jvp *j, Inst *i) {
    Block *region = i->region[1];
    Inst *last = i;
    while (last->next && last->next->op == OP_proj && last->next->args[0] == i) last = last->next;
    for (uint32_t d = 0; d < j->n; d++) {
        bool any = false;
        for (uint32_t a = 0; a < i->nargs; a++)
            any |= i->args[a]->type == TY_FLT && active(j, i->args[a]) && tangent(j, i->args[a], d);
        if (!any) continue;
        Inst **map = ARENA_ARRAY(j->scratch, Inst *, j->facts.n + 1);
        Builder b = ir_after(j->fn, i);
        uint32_t next = i->nargs;
        for (uint32_t a = 0; a < i->nargs; a++) map[region->params[a]->id] = i->args[a];
        for (uint32_t a = 0; a < i->nargs; a++)
            if (i->args[a]->type == TY_FLT) map[region->params[next++]->id] = tangent_or_zero(j, &b, i->args[a], d);
        ir_clone_insts(&b, region, region->first, region->last, map);
        uint32_t float_index = 0;
        for (Inst *p = i->next; p && p->op == OP_proj && p->args[0] == i; p = p->next) {
            if (p->type != TY_FLT) continue;
            float_index = 0;
            for (uint32_t k = 0; k < (uint32_t)p->imm.i; k++)
                float_index += i->region[0]->last->args[k]->type == TY_FLT;
            uint32_t at = region->last->nargs == i->region[0]->last->nargs ? (uint32_t)p->imm.i : float_index;
            Inst *y = region->last->args[at];
            if (active(j, p)) set_tangent(j, p, d, map[y->id] ? map[y->id] : y), j->inf[p->id] = true;
        }
    }
}

/* Values that chunks hand to each other (variant_chunks.c) lie with their tangents side by side: whoever takes one does
 * not know which. */
static void jvp_frame(Jvp *j, Builder *b, Inst *i) {
    i->imm.frame.places = 1 + j->n;
    for (uint32_t d = 0; d < j->n; d++) {
        Imm imm = i->imm;
        imm.frame.place = 1 + d;
        if (i->op == OP_take) {
            if (i->type == TY_FLT) set_tangent(j, i, d, ir_special(b, OP_take, TY_FLT, 0, NULL, imm));
        } else if (i->args[0]->type == TY_FLT) {
            Inst *t = tangent_or_zero(j, b, i->args[0], d);
            ir_special(b, OP_give, TY_VOID, 1, &t, imm);
        }
    }
    if (i->op == OP_take) j->inf[i->id] = j->any_inf;
}

static void jvp_inst(Jvp *j, Inst *i) {
    j->rule.b = ir_after(j->fn, i);
    j->rule.b.fold = true;
    Builder *b = &j->rule.b;
    switch ((Op)i->op) {
    case OP_if_: jvp_if(j, i); return;
    case OP_loop: jvp_loop(j, i); return;
    case OP_custom: jvp_custom(j, i); return;
    case OP_param:
        if (active(j, i) && !j->grad_x) set_tangent(j, i, 0, ir_special(b, OP_dparam, TY_FLT, 1, i->args, i->imm));
        return;
    case OP_input:
        if (!active(j, i)) return;
        if (j->grad_x) set_tangent(j, i, (uint32_t)(i->imm.i - IN_X0), ir_constf(b, 1));
        else set_tangent(j, i, 0, ir_input(b, (InputSlot)(IN_DX0 + (i->imm.i - IN_X0))));
        return;
    case OP_seed: set_tangent(j, i, 0, i->args[1]); return;
    case OP_ghost:
        for (uint32_t d = 0; active(j, i) && d < j->n; d++) set_tangent(j, i, d, tangent_or_zero(j, b, i->args[0], d));
        return;
    case OP_give:
    case OP_take: jvp_frame(j, b, i); return;
    case OP_alloc:
        for (uint32_t d = 0; active(j, i) && d < j->n; d++)
            set_tangent(j, i, d, ir_special(b, OP_alloc, TY_ARRAY, 0, NULL, i->imm));
        return;
    case OP_load:
        if (!active(j, i)) return;
        for (uint32_t d = 0; d < j->n; d++)
            set_tangent(j, i, d,
                        ir_special(b, OP_load, TY_FLT, 2, (Inst *[]){tangent(j, i->args[0], d), i->args[1]}, (Imm){0}));
        j->inf[i->id] = j->any_inf;
        return;
    case OP_store:
        if (!active(j, i->args[0])) return;
        for (uint32_t d = 0; d < j->n; d++)
            ir_special(b, OP_store, TY_VOID, 3,
                       (Inst *[]){tangent(j, i->args[0], d), i->args[1], tangent_or_zero(j, b, i->args[2], d)},
                       (Imm){0});
        return;
    case OP_acopy:
        if (!active(j, i->args[0])) return;
        for (uint32_t d = 0; d < j->n; d++) {
            Inst *from = tangent(j, i->args[1], d);
            /* what has no tangent copies zeros: a new array is zeroed where it is made */
            if (!from) from = ir_special(b, OP_alloc, TY_ARRAY, 0, NULL, i->args[0]->imm);
            ir_special(b, OP_acopy, TY_VOID, 2, (Inst *[]){tangent(j, i->args[0], d), from}, (Imm){0});
        }
        return;
    default:
        if (!ir_ops[i->op].special && i->type == TY_FLT && active(j, i)) jvp_row(j, i);
    }
}

static void jvp_block(Jvp *j, Block *b) {
    for (Inst *i = b->first; i; i = i->next)
        if (i->id < j->facts.n) jvp_inst(j, i); /* newer instructions are tangents */
}

/* Tangents for everything in fn, beside it. */
static Jvp sweep(PassCtx *ctx, Fn *fn, const AdOptions *o, uint32_t n, bool grad_x) {
    Arena *scratch = &ctx->session->scratch;
    ad_clear_tags(fn->body);
    Jvp j = {.fn = fn, .scratch = scratch, .n = n, .grad_x = grad_x};
    ad_facts(&j.facts, fn, scratch, o, NULL, NULL);
    j.any_inf = ad_makes_infinite(&j.facts, fn->body);
    j.tangent = ARENA_ARRAY(scratch, Inst *, (size_t)j.facts.n * n + 1);
    j.inf = ARENA_ARRAY(scratch, bool, j.facts.n + 1);
    j.rule = (AdRule){.fma = ctx->has_fma, .value = same_value, .range = j.facts.range, .varied = j.facts.varied};
    jvp_block(&j, fn->body);
    return j;
}

static Fn *forward(PassCtx *ctx, const Fn *primal, const AdOptions *o, uint32_t n, bool grad_x) {
    Arena *scratch = &ctx->session->scratch;
    ArenaMark m = arena_mark(scratch);
    Fn *fn =
        ir_clone(primal, primal->arena, arena_printf(primal->arena, "%s_%s", primal->name, grad_x ? "grad" : "jvp"));
    Jvp j = sweep(ctx, fn, o, n, grad_x);
    Inst *yield = fn->body->last;
    uint32_t floats = 0, out = 0;
    for (uint32_t k = 0; k < yield->nargs; k++) floats += yield->args[k]->type == TY_FLT;
    Inst **values = ARENA_ARRAY(fn->arena, Inst *, floats * (1 + n) + 1);
    Output *names = ARENA_ARRAY(fn->arena, Output, floats * (1 + n) + 1);
    Builder b = ir_at_end(fn, fn->body);
    for (uint32_t k = 0; k < yield->nargs; k++) {
        Inst *v = yield->args[k];
        if (v->type != TY_FLT) continue;
        values[out] = v;
        names[out] = ad_output(primal, k);
        for (uint32_t d = 0; d < n; d++) {
            values[floats + out * n + d] = tangent_or_zero(&j, &b, v, d);
            names[floats + out * n + d] = grad_x ? (Output){SLT_OUT_G_DX, out * n + d} : ad_tangent_output(primal, k);
        }
        out++;
    }
    yield->args = values;
    yield->nargs = floats * (1 + n);
    fn->outputs = names;
    arena_reset(scratch, m);
    return fn;
}

Fn *ad_jvp(PassCtx *ctx, const Fn *fn, const AdOptions *o) {
    return forward(ctx, fn, o ? o : &(AdOptions){0}, 1, false);
}

Fn *ad_grad_x(PassCtx *ctx, const Fn *fn) {
    return forward(ctx, fn, &(AdOptions){.wrt_none = true, .wrt_x = true}, fn->dim ? fn->dim : 1, true);
}

static void replace_along(const Jvp *j, Block *b) {
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        for (uint32_t r = 0; r < i->nregions; r++) replace_along(j, i->region[r]);
        Builder at = ir_before(j->fn, i);
        if (i->op == OP_along) walk_forward(j->fn, i, tangent_or_zero(j, &at, i->args[0], 0));
        else if (i->op == OP_seed) walk_forward(j->fn, i, i->args[0]);
    }
}

void ad_along(PassCtx *ctx, Fn *fn) {
    ArenaMark m = arena_mark(&ctx->session->scratch);
    Jvp j = sweep(ctx, fn, &(AdOptions){.wrt_none = true, .wrt_seeds = true}, 1, false);
    replace_along(&j, fn->body);
    walk_resolve_forwards(fn->body);
    arena_reset(&ctx->session->scratch, m);
}

static bool has_ddx(const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_ddx) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (has_ddx(i->region[r])) return true;
    }
    return false;
}

static void replace_ddx(const Jvp *j, Block *b) {
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        for (uint32_t r = 0; r < i->nregions; r++) replace_ddx(j, i->region[r]);
        if (i->op != OP_ddx) continue;
        Builder at = ir_before(j->fn, i);
        walk_replace(j->fn->body, i, tangent_or_zero(j, &at, i->args[0], (uint32_t)i->imm.i));
        ir_unlink(i);
    }
}

/* In place: what the front end recorded stays where it is. A derivative of a derivative is 0, as good as any: GLSL
 * leaves it undefined. */
bool lower_ddx(PassCtx *ctx, Fn *fn) {
    if (!has_ddx(fn->body)) return false;
    ArenaMark m = arena_mark(&ctx->session->scratch);
    uint32_t dim = fn->dim ? fn->dim : 1;
    Jvp j = sweep(ctx, fn, &(AdOptions){.wrt_none = true, .wrt_x = true}, dim, true);
    replace_ddx(&j, fn->body);
    arena_reset(&ctx->session->scratch, m);
    return true;
}
