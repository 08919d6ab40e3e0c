/* Reverse mode: how the sweep has a value of the primal.
 *
 * Values of the top block are simply used. For the others:
 *   free        constants, inputs, parameters at known indices: emitted again
 *   cheap       sums, products, comparisons, selects, conversions: recomputed, when that takes at most one value more
 *               than storing would
 *   the rest    carried values, roots, quotients, elementary functions, results of regions, array elements: stored in
 *               the frame of the scope (at the top: made a result of the enclosing ifs). Elements of arrays that are
 *               not written any more are read again.
 * Iteration numbers are stored only if asked for, and never where the reverse of a loop can count itself. In a replayed
 * loop everything is there again: its frames hold what the replay starts from (ad_replay.c). */
#include <string.h>

#include "compiler/pass/ad_tape.h"

Inst *tape_forward(const Vjp *v, Inst *primal) { return v->fwd[primal->id] ? v->fwd[primal->id] : primal; }
Inst *tape_run(const Vjp *v, Inst *primal) { return v->run[primal->id] ? v->run[primal->id] : tape_forward(v, primal); }

static Ctx *ctx_of(const Vjp *v, const Block *primal) {
    for (uint32_t d = v->stack.len; d-- > 0;)
        if (v->stack.data[d]->primal == primal) return v->stack.data[d];
    ice(v->fn->session, "ad: a value is asked for outside its region");
}

/* ---- facts */

static Inst *statement_in(const Inst *i, const Block *b) {
    while (i->block != b) i = i->block->owner;
    return (Inst *)i;
}

static void find_writes(Vjp *v, Block *b, Inst **last_write) {
    for (Inst *i = b->first; i; i = i->next) {
        if (i->op == OP_store || i->op == OP_acopy) {
            const Inst *array = i->args[0];
            Inst *s = statement_in(i, array->block);
            if (!last_write[array->id] || last_write[array->id]->id < s->id) last_write[array->id] = s;
        }
        for (uint32_t r = 0; r < i->nregions; r++) find_writes(v, i->region[r], last_write);
    }
}

static void want_in(Vjp *v, Block *b, Inst **last_write) {
    for (Inst *i = b->first; i; i = i->next) {
        bool active = ad_active(&v->f, i);
        switch ((Op)i->op) {
        case OP_load: {
            const Inst *array = i->args[0];
            v->stable[i->id] =
                array->block == v->fn->body &&
                (!last_write[array->id] || last_write[array->id]->id < statement_in(i, array->block)->id);
            if (active) v->want[i->args[1]->id] = 1;
            break;
        }
        case OP_store:
            if (ad_active(&v->f, i->args[0])) v->want[i->args[1]->id] = 1;
            break;
        case OP_param:
            if (active) v->want[i->args[0]->id] = 1;
            break;
        default:
            if (ir_ops[i->op].special || !active || i->type != TY_FLT) break;
            for (uint32_t a = 0; a < i->nargs; a++) {
                if (i->args[a]->type != TY_FLT || !ad_active(&v->f, i->args[a])) continue;
                uint32_t m = ad_mentions(i, a, v->f.range, NULL);
                if (m == UINT32_MAX) continue;
                for (uint32_t k = 0; k < i->nargs; k++)
                    if (m & 1u << k) v->want[i->args[k]->id] = 1;
                if (m & AD_MENTIONS_RESULT) v->want[i->id] = 1;
            }
        }
        for (uint32_t r = 0; r < i->nregions; r++) want_in(v, i->region[r], last_write);
    }
}

void tape_prepare(Vjp *v) {
    Inst **last_write = ARENA_ARRAY(v->scratch, Inst *, v->f.n + 1);
    find_writes(v, v->fn->body, last_write);
    want_in(v, v->fn->body, last_write);
}

/* ---- stored or recomputed */

static bool cheap(const Vjp *v, const Inst *i) {
    const OpInfo *o = &ir_ops[i->op];
    if (i->op == OP_load) return v->stable[i->id];
    if (o->kind != KIND_PURE) return false;
    if (o->cost < IR_COST_DIVISION) return true;
    /* the division of an integer by a constant is a product: rows and columns of a witness */
    return o->arg == TY_INT && ir_is_const(i->args[1]);
}

typedef struct Cost {
    uint32_t ops, leaves;
} Cost;
enum { MAX_OPS = 24 };

static void cost_of(Vjp *v, Inst *i, Cost *c) {
    if (i->id >= v->f.n || i->block == v->fn->body || v->memo[i->id] || v->stamp[i->id] == v->stamps ||
        c->ops > MAX_OPS)
        return;
    v->stamp[i->id] = v->stamps;
    if (i->op == OP_arg && i->block->owner->op == OP_loop && i->imm.i == 0)
        return; /* iteration numbers are uniform: next to nothing */
    if (!cheap(v, i)) {
        c->leaves += !v->want[i->id]; /* a value that a rule mentions will be there anyway */
        return;
    }
    c->ops += i->nargs > 0;
    if (i->op == OP_site || i->op == OP_siten) cost_of(v, i->args[0], c);
    else
        for (uint32_t a = i->op == OP_load ? 1 : 0; a < i->nargs; a++) cost_of(v, i->args[a], c);
}

static Inst *recompute(Vjp *v, Inst *i, Ctx *c) {
    if (i->op == OP_site || i->op == OP_siten || i->op == OP_detach) return tape_value(v, i->args[0]);
    Inst *args[3];
    if (i->op == OP_ghost) {
        Builder zero = rev_builder(v, c->rev);
        return ir_constf(&zero, 0);
    }
    if (i->nargs > 3) ice(v->fn->session, "ad: %s cannot be recomputed", ir_ops[i->op].name);
    for (uint32_t a = 0; a < i->nargs; a++) args[a] = tape_value(v, i->args[a]);
    Builder b = rev_builder(v, c->rev);
    b.span = i->span;
    c->scope->recomputed += !ir_is_const(i);
    switch ((Op)i->op) {
    case OP_constf: return ir_constf(&b, i->imm.f);
    case OP_consti: return ir_consti(&b, (int32_t)i->imm.i);
    case OP_constb: return ir_constb(&b, i->imm.i != 0);
    case OP_input: return ir_input(&b, (InputSlot)i->imm.i);
    default:
        return ir_ops[i->op].special ? ir_special(&b, (Op)i->op, (IrType)i->type, i->nargs, args, i->imm)
                                     : ir_emit(&b, (Op)i->op, i->nargs, args);
    }
}

/* Makes x a result of the ifs around it until it is in one of two blocks. */
static Inst *export_to(Vjp *v, Inst *x, const Block *to, const Block *or_to) {
    while (x->block != to && x->block != or_to) {
        Inst *owner = x->block->owner;
        if (!owner || owner->op != OP_if_) ice(v->fn->session, "ad: a stored value crosses a loop");
        uint32_t side = owner->region[1] == x->block, index = 0, n = ir_nresults(owner);
        while (index < n && owner->region[side]->last->args[index] != x) index++;
        if (index == n)
            for (uint32_t r = 0; r < 2; r++) {
                Builder b = ir_at_end(v->fn, owner->region[r]);
                ir_append_arg(v->fn, owner->region[r]->last, r == side ? x : ir_zero(&b, (IrType)x->type));
            }
        Builder after = ir_after(v->fn, owner);
        x = ir_proj(&after, owner, index);
    }
    return x;
}

void tape_store(Vjp *v, Scope *s, Inst *x, Inst *param, Inst *what) {
    vec_push(v->scratch, &s->stored, export_to(v, x, s->fwd_block, s->fwd_outer));
    vec_push(v->scratch, &s->params, param);
    vec_push(v->scratch, &s->what, what);
}

static Inst *stored_param(Vjp *v, Scope *s, Inst *x, Inst *what) {
    Inst *p = ir_block_param(v->fn, s->rev_block, (IrType)x->type);
    tape_store(v, s, x, p, what);
    return p;
}

Inst *tape_value(Vjp *v, Inst *i) {
    if (i->id >= v->f.n) return i;
    if (v->memo[i->id]) return v->memo[i->id];
    if (i->block == v->fn->body) return i;
    Ctx *c = ctx_of(v, i->block);
    Inst *r = NULL;
    if (i->op == OP_arg && i->block->owner->op == OP_loop && i->imm.i == 0) {
        if (!c->scope->k) c->scope->k = ir_block_param(v->fn, c->scope->rev_block, TY_INT);
        r = c->scope->k;
    } else {
        Scope *s = c->scope;
        Inst *x = tape_forward(v, i);
        const Scope *replay = s->replay ? s : s->over; /* all its values are there again */
        bool here = replay && x->block == replay->rev_block;
        Cost cost = {0};
        v->stamps++;
        bool again = !here && cheap(v, i);
        if (again) cost_of(v, i, &cost);
        if (again && cost.ops <= MAX_OPS && (cost.leaves == 0 || (cost.leaves == 1 && cost.ops <= MAX_OPS / 2)))
            r = recompute(v, i, c);
        else if (s->top || replay) r = export_to(v, x, s->top ? s->fwd_block : replay->rev_block, NULL);
        else r = stored_param(v, s, x, i);
    }
    v->memo[i->id] = r;
    return r;
}

Inst *tape_mark_value(Vjp *v, Inst *mark, bool direct) {
    Scope *s = vjp_here(v)->scope;
    bool here = direct || s->top || (s->replay && !s->keeps);
    return here ? mark : stored_param(v, s, mark, mark);
}

void tape_push_frame(Vjp *v, Scope *s) {
    Builder b = ir_at_end(v->fn, s->fwd_block);
    if (s->guards.len > 1) { /* one guard: fwd_block is the guarded region itself */
        Inst *any = NULL;
        for (uint32_t g = 0; g < s->guards.len; g++) {
            Inst *cond = s->guards.data[g].cond;
            if (s->guards.data[g].region == 1) cond = ir_emit1(&b, OP_bnot, cond);
            any = any ? ir_emit2(&b, OP_bor, any, cond) : cond;
        }
        Inst *branch = ir_if(&b, any);
        Builder e = ir_at_end(v->fn, branch->region[1]);
        ir_yield(&e, 0, NULL);
        Builder t = ir_at_end(v->fn, branch->region[0]);
        ir_special(&t, OP_tapepush, TY_VOID, s->stored.len, s->stored.data, (Imm){0});
        ir_yield(&t, 0, NULL);
    } else {
        ir_special(&b, OP_tapepush, TY_VOID, s->stored.len, s->stored.data, (Imm){0});
    }
}

/* ---- sparse loops: iterations that change nothing active push no frame */

static bool has_guard(const Scope *s, const Inst *branch, uint32_t region) {
    for (uint32_t g = 0; g < s->guards.len; g++)
        if (s->guards.data[g].branch == branch && s->guards.data[g].region == region) return true;
    return false;
}
static void add_guard(Vjp *v, Scope *s, Inst *branch, uint32_t region) {
    if (!has_guard(s, branch, region))
        vec_push(v->scratch, &s->guards, ((Guard){branch, tape_forward(v, branch)->args[0], region}));
}

/* Is x the carried parameter itself where no guarded region is taken? */
static bool passes(Vjp *v, Scope *s, const Block *body, Inst *x, const Inst *param) {
    if (x == param) return true;
    if (x->op != OP_proj || x->args[0]->op != OP_if_ || x->block != body) return false;
    Inst *branch = x->args[0];
    Inst *y[2] = {branch->region[0]->last->args[x->imm.i], branch->region[1]->last->args[x->imm.i]};
    bool outside[2] = {!walk_inside(y[0]->block, branch->region[0]), !walk_inside(y[1]->block, branch->region[1])};
    if (y[0] == y[1]) return passes(v, s, body, y[0], param);
    for (uint32_t r = 2; r-- > 0;)
        if (outside[r] && passes(v, s, body, y[r], param)) {
            add_guard(v, s, branch, 1 - r);
            return true;
        }
    return false;
}

static bool acts(const Vjp *v, const Block *b) {
    for (const Inst *i = b->first; i; i = i->next) {
        if ((i->op == OP_store || i->op == OP_acopy) && ad_active(&v->f, i->args[0])) return true;
        if (i->op == OP_loop && v->taped[i->id]) return true;
        for (uint32_t r = 0; r < i->nregions; r++)
            if (acts(v, i->region[r])) return true;
    }
    return false;
}

bool tape_find_guards(Vjp *v, Inst *loop, Scope *s) {
    Block *body = loop->region[0];
    s->guards.len = 0;
    for (uint32_t c = 1; c < body->nparams; c++) {
        Inst *param = body->params[c];
        if (param->type != TY_FLT) continue;
        bool matters = ad_active(&v->f, param);
        for (const Inst *p = loop->next; p && p->op == OP_proj && p->args[0] == loop; p = p->next)
            matters |= p->imm.i == c - 1 && vjp_seeded(v, p);
        if (matters && !passes(v, s, body, body->last->args[c], param)) return false;
    }
    for (Inst *i = body->first; i; i = i->next) {
        if ((i->op == OP_store || i->op == OP_acopy) && ad_active(&v->f, i->args[0])) return false;
        if (i->op == OP_loop && v->taped[i->id]) return false;
        if (i->op == OP_if_)
            for (uint32_t r = 0; r < 2; r++)
                if (acts(v, i->region[r])) add_guard(v, s, i, r);
    }
    for (uint32_t g = 0; g < s->guards.len; g++)
        if (has_guard(s, s->guards.data[g].branch, 1 - s->guards.data[g].region)) return false;
    return s->guards.len > 0;
}

/* ---- the report */

/* What the forward run of a scope leaves on the tape. Segments leave nothing there, nor do loops that are run again
 * with a replayed iteration. */
static uint64_t frames_below(const Vjp *v, const Scope *s) {
    uint64_t bytes = 0;
    for (uint32_t k = 0; k < v->scopes.len; k++)
        if (v->scopes.data[k]->parent == s && !v->scopes.data[k]->segment) bytes += tape_left(v, v->scopes.data[k]);
    return bytes;
}
uint64_t tape_left(const Vjp *v, const Scope *s) {
    return ((s->framed ? s->frame_bytes : 0) + (s->replay && !s->keeps ? 0 : frames_below(v, s))) *
           (s->told ? 1 : s->trips);
}

/* The most bytes that code run again adds on top, one segment, one iteration at a time. */
uint64_t tape_on_top(const Vjp *v, const Scope *s) {
    uint64_t most = 0;
    for (uint32_t k = 0; k < v->scopes.len; k++) {
        const Scope *c = v->scopes.data[k];
        if (c->parent != s) continue;
        uint64_t bytes = tape_on_top(v, c) + (c->segment ? tape_left(v, c) : 0);
        if (bytes > most) most = bytes;
    }
    return most + (s->replay && !s->keeps ? frames_below(v, s) : 0);
}

bool tape_grows(const Vjp *v) {
    for (uint32_t k = 0; k < v->scopes.len; k++)
        if (v->scopes.data[k]->told) return true;
    return false;
}

uint64_t tape_bytes(const Vjp *v) { return tape_left(v, v->scopes.data[0]) + tape_on_top(v, v->scopes.data[0]); }

static const char *describe(const Inst *x) {
    if (x->op == OP_arg) return "carried value";
    if (x->op == OP_proj) return "result of a region";
    if (x->op == OP_tapemark) return "mark of an inner tape";
    if (x->op == OP_query) return "witness";
    return ir_ops[x->op].name;
}

static const char *why_stored(const Vjp *v, const Inst *x) {
    return x->op == OP_arg || x->op == OP_proj ? "not a function of the iteration alone"
           : x->op == OP_tapemark              ? "where its frames end"
           : x->op == OP_query                 ? "nothing is searched again"
           : cheap(v, x)                       ? "needs two or more values to recompute"
                                               : "expensive to recompute";
}

/* Segments within segments below a strip-mined loop. */
static uint32_t levels_of(const Vjp *v, const Scope *s) {
    for (uint32_t k = 0; k < v->scopes.len; k++) {
        const Scope *c = v->scopes.data[k];
        if (c->parent == s && c->segment && c->owner->block == s->owner->region[0]) return 1 + levels_of(v, c);
    }
    return 0;
}

static const char *report_stored(const Vjp *v, Arena *arena, const char *text, const Scope *s) {
    if (s->k) text = arena_printf(arena, "%s iteration number (uniform);", text);
    uint8_t *seen = ARENA_ARRAY(v->scratch, uint8_t, s->what.len + 1);
    for (uint32_t p = 0; p < s->what.len; p++) {
        if (seen[p]) continue;
        const Inst *x = s->what.data[p];
        uint32_t n = 0;
        for (uint32_t q = p; q < s->what.len; q++) {
            const Inst *y = s->what.data[q];
            if (describe(x) != describe(y) || why_stored(v, x) != why_stored(v, y)) continue;
            seen[q] = 1;
            n++;
        }
        text = n > 1 ? arena_printf(arena, "%s %u x %s (%s);", text, n, describe(x), why_stored(v, x))
                     : arena_printf(arena, "%s %s (%s);", text, describe(x), why_stored(v, x));
    }
    return arena_printf(arena, "%s%s\n", text, s->what.len || s->k ? "" : " the mask only");
}

const char *tape_report(Vjp *v, Arena *arena, uint64_t bytes, uint64_t budget) {
    const char *text = "";
    for (uint32_t k = 1; k < v->scopes.len; k++) {
        const Scope *s = v->scopes.data[k];
        const char *what = s->owner->op == OP_loop ? "loop" : "if";
        uint32_t line = 0, column = 0, levels = s->owner->op == OP_loop && !s->segment ? levels_of(v, s) : 0;
        if (s->owner->span.file >= 0) span_position(v->fn->session, s->owner->span, &line, &column);
        const char *where = line ? arena_printf(arena, "%s at line %u", what, line) : what;
        if (levels) where = arena_printf(arena, "%s: checkpointed in %u level%s", where, levels, levels > 1 ? "s" : "");
        if (s->segment) where = arena_printf(arena, "%s: segment of a strip-mined loop, run again", where);
        if (s->replay) where = arena_printf(arena, "%s: each iteration replayed from its frame", where);
        if (!s->framed) {
            text = arena_printf(arena, "%s%s: no tape, %llu iterations counted backwards; %u values recomputed\n", text,
                                where, (unsigned long long)s->trips, s->recomputed);
            continue;
        }
        const char *many = s->told ? "for each of what is told"
                                   : arena_printf(arena, "at most %llu of them", (unsigned long long)s->trips);
        text = arena_printf(arena, "%s%s: %s frame of %u bytes, %s; %u values recomputed; stored:", text, where,
                            s->sparse ? "only iterations that are taken," : "one", s->frame_bytes, many, s->recomputed);
        text = report_stored(v, arena, text, s);
    }
    if (bytes > budget)
        text = arena_printf(arena, "%sworst case of %llu bytes per lane is above the budget of %llu\n", text,
                            (unsigned long long)bytes, (unsigned long long)budget);
    return text;
}
