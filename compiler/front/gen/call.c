/* Calls: every one is inlined. [Tangent] functions become OP_custom with both bodies. */
#include <string.h>

#include "compiler/front/gen/internal.h"

enum { MAX_CALL_DEPTH = 400 }; /* bounds the C stack */

const char *gen_path(Lower *l) {
    const Frame *chain[MAX_CALL_DEPTH + 2];
    uint32_t n = 0;
    for (const Frame *f = l->frame; f && n < MAX_CALL_DEPTH + 2; f = f->caller)
        if (!f->shown) chain[n++] = f;
    size_t len = 1;
    for (uint32_t i = 0; i < n; i++) len += strlen(chain[i]->func->name) + 3;
    char *text = arena_alloc(l->arena, len), *at = text;
    while (n-- > 0) {
        size_t k = strlen(chain[n]->func->name);
        memcpy(at, chain[n]->func->name, k);
        at += k;
        if (n) memcpy(at, " > ", 3), at += 3;
    }
    *at = 0;
    return text;
}

/* What only the caller makes a site, or could, is shown where it calls. */
Span gen_shown(const Lower *l, Span span) {
    const Frame *f = l->frame;
    if (f && f->shown) return *f->shown;
    return f && f->library && !l->tag.own ? *f->library : span;
}

Val gen_inline(Lower *l, Func *f, const Bind *args, Span span) {
    Frame frame = {.func = f, .caller = l->frame, .call_span = span, .depth = l->frame ? l->frame->depth + 1 : 0};
    if (frame.depth > MAX_CALL_DEPTH) gen_too_large(l, span);
    if (l->frame && l->frame->shown) frame.shown = l->frame->shown;
    else if (l->program->is_glsl && f->module->is_stdlib) frame.shown = &frame.call_span;
    if (f->module->is_stdlib) {
        frame.library = l->frame && l->frame->library ? l->frame->library : &frame.call_span;
        frame.asked = l->tag.disc, frame.by_auto = l->tag.by_auto, frame.quiet = l->tag.nodisc;
    }
    frame.bind = ARENA_ARRAY(l->arena, Bind, f->nlocals + 1);
    for (uint32_t i = 0; i < f->nargs; i++) frame.bind[f->args[i]->id] = args[i];
    bool is_void = f->ret->kind == T_VOID;
    if (!is_void) frame.ret = vars_for(l, f->ret);
    frame.ret_flag = var_new(l, TY_BOOL, 1);
    frame.ret_flag->value = kb(l, false);
    Tag tag = l->tag;
    l->frame = &frame;
    l->tag = (Tag){.skip = tag.skip};
    gen_list(l, &f->body, 1);
    Val out = is_void ? (Val){f->ret, 0, NULL} : vars_load(l, f->ret, frame.ret);
    for (uint32_t i = 0; i < out.n; i++)
        if (!out.c[i]) out.c[i] = ir_zero(&l->b, frame.ret[i].type);
    l->frame = frame.caller;
    l->tag = tag;
    return out;
}

/* ---- does a function assign to an argument? Then an array passed for the argument has to be copied. */
static bool assigns_expr(const Expr *e, const Symbol *sym);
static const Symbol *root_symbol(const Expr *e) {
    while (e->kind == E_FIELD || e->kind == E_SWIZZLE || e->kind == E_INDEX) e = e->a[0];
    return e->kind == E_NAME ? e->sym : NULL;
}
static bool assigns_expr(const Expr *e, const Symbol *sym) {
    if (!e) return false;
    if ((e->kind == E_ASSIGN || e->kind == E_INCDEC) && root_symbol(e->a[0]) == sym) return true;
    if (e->kind == E_CALL)
        for (uint32_t i = 0; i < e->nargs && i < e->func->nargs; i++)
            if (e->func->args[i]->mode != ARG_IN && root_symbol(e->args[i]) == sym) return true;
    for (uint32_t i = 0; i < 3; i++)
        if (assigns_expr(e->a[i], sym)) return true;
    for (uint32_t i = 0; i < e->nargs; i++)
        if (assigns_expr(e->args[i], sym)) return true;
    return false;
}
static bool assigns_stmt(const Stmt *s, const Symbol *sym) {
    if (!s) return false;
    if (assigns_expr(s->expr, sym) || assigns_expr(s->step, sym) || assigns_stmt(s->init, sym) ||
        assigns_stmt(s->body, sym) || assigns_stmt(s->orelse, sym))
        return true;
    for (uint32_t i = 0; i < s->ndecls; i++)
        if (assigns_expr(s->decls[i]->init, sym)) return true;
    for (uint32_t i = 0; i < s->nargs; i++)
        if (assigns_expr(s->args[i], sym)) return true;
    for (uint32_t i = 0; i < s->nstmts; i++)
        if (assigns_stmt(s->stmts[i], sym)) return true;
    for (uint32_t c = 0; c < s->ncases; c++)
        for (uint32_t i = 0; i < s->cases[c].nbody; i++)
            if (assigns_stmt(s->cases[c].body[i], sym)) return true;
    return false;
}

static bool has_arrays(Lower *l, Type *t) {
    const Layout *layout = gen_layout(l, t);
    for (uint32_t i = 0; i < layout->n; i++)
        if (layout->leaf[i].count) return true;
    return false;
}

/* ---- [Tangent] */

enum { DEG_NONE, DEG_LINEAR, DEG_BAD }; /* in Inst.flags: how a value depends on the tangents */

static bool is_zero(const Inst *i) { return i->op == OP_constf && i->imm.f == 0; }
static uint8_t degree(const Inst *i) { return i->flags; }
/* Is i a sum or a product of zeros? The folder keeps those, for the sake of NaN. */
static bool null_within(const Inst *i, int depth) {
    if (is_zero(i)) return true;
    if (depth == 0) return false;
    if (i->op == OP_fmul || i->op == OP_zmul)
        return null_within(i->args[0], depth - 1) || null_within(i->args[1], depth - 1);
    return (i->op == OP_fadd || i->op == OP_fsub) && null_within(i->args[0], depth - 1) &&
           null_within(i->args[1], depth - 1);
}
static bool is_null(const Inst *i) { return null_within(i, 6); }

static uint8_t join(const Inst *a, const Inst *b) {
    if (is_null(a)) return degree(b);
    if (is_null(b)) return degree(a);
    return degree(a) == degree(b) ? degree(a) : DEG_BAD;
}

static uint8_t product(const Inst *a, const Inst *b) {
    if (is_null(a) || is_null(b)) return DEG_NONE;
    uint8_t d = (uint8_t)(degree(a) + degree(b));
    return d > DEG_LINEAR ? DEG_BAD : d;
}

typedef struct Linear {
    Span where;
    const char *why;
} Linear;

static uint8_t bad(Linear *c, const Inst *i, const char *why) {
    if (!c->why) c->where = i->span, c->why = why;
    return DEG_BAD;
}

static bool raise_to(Inst *i, uint8_t d) {
    if (d <= i->flags) return false;
    i->flags = d;
    return true;
}

/* One pass over a block; true if a degree went up (loops run it again). */
static bool degrees(Linear *c, Block *b);

static bool degree_loop(Linear *c, Inst *i) {
    bool changed = false, again = true;
    Block *body = i->region[0];
    for (uint32_t p = 1; p < body->nparams; p++) changed |= raise_to(body->params[p], degree(i->args[p - 1]));
    for (uint32_t round = 0; again && round < 8; round++) {
        again = degrees(c, body);
        for (uint32_t p = 1; p < body->nparams; p++) {
            Inst *v = body->last->args[p];
            uint8_t d = is_zero(i->args[p - 1]) || v == body->params[p] ? degree(v) : join(body->params[p], v);
            if (d == DEG_BAD) bad(c, i, "a value carried by a loop mixes tangents with other values");
            again |= raise_to(body->params[p], d);
        }
        changed |= again;
    }
    if (degree(body->last->args[0])) bad(c, i, "the loop goes on depending on a tangent");
    return changed;
}

static uint8_t degree_of(Linear *c, Inst *i) {
    uint8_t d;
    switch ((Op)i->op) {
    case OP_fadd:
    case OP_fsub:
        d = join(i->args[0], i->args[1]);
        return d == DEG_BAD ? bad(c, i, "a sum of a tangent and something that is none") : d;
    case OP_fneg:
    case OP_detach: return degree(i->args[0]);
    case OP_fmul:
    case OP_zmul: d = product(i->args[0], i->args[1]); return d == DEG_BAD ? bad(c, i, "a product of two tangents") : d;
    case OP_fdiv:
    case OP_zdiv: return degree(i->args[1]) ? bad(c, i, "a division by a tangent") : degree(i->args[0]);
    case OP_ffma:
        d = product(i->args[0], i->args[1]);
        if (d == DEG_BAD) return bad(c, i, "a product of two tangents");
        return is_zero(i->args[2]) || d == degree(i->args[2])
                   ? d
                   : bad(c, i, "a sum of a tangent and something that is none");
    case OP_fsel:
        if (degree(i->args[0])) return bad(c, i, "a choice that depends on a tangent");
        d = join(i->args[1], i->args[2]);
        return d == DEG_BAD ? bad(c, i, "a choice between a tangent and something that is none") : d;
    case OP_load: return degree(i->args[1]) ? bad(c, i, "an index that depends on a tangent") : degree(i->args[0]);
    case OP_proj: {
        const Inst *op = i->args[0];
        if (op->op == OP_if_) {
            d = join(op->region[0]->last->args[i->imm.i], op->region[1]->last->args[i->imm.i]);
            return d == DEG_BAD ? bad(c, i, "a branch gives a tangent, the other something that is none") : d;
        }
        return degree(op->region[0]->last->args[i->imm.i + (op->op == OP_loop ? 1 : 0)]);
    }
    default: break;
    }
    for (uint32_t a = 0; a < i->nargs; a++)
        if (degree(i->args[a])) return bad(c, i, "an operation that is not linear is applied to a tangent");
    return DEG_NONE;
}

static bool degrees(Linear *c, Block *b) {
    bool changed = false;
    for (Inst *i = b->first; i; i = i->next) {
        switch ((Op)i->op) {
        case OP_yield: break;
        case OP_if_:
            if (degree(i->args[0])) bad(c, i, "a branch that depends on a tangent");
            changed |= degrees(c, i->region[0]);
            changed |= degrees(c, i->region[1]);
            break;
        case OP_loop: changed |= degree_loop(c, i); break;
        case OP_custom:
            for (uint32_t a = 0; a < i->nargs; a++)
                if (degree(i->args[a])) bad(c, i, "a tangent is passed to a function with [Tangent]");
            break;
        case OP_store:
            if (degree(i->args[1])) bad(c, i, "an index that depends on a tangent");
            changed |= raise_to(i->args[0], degree(i->args[2]));
            break;
        case OP_acopy: changed |= raise_to(i->args[0], degree(i->args[1])); break;
        case OP_alloc: break; /* the stores tell */
        default: changed |= raise_to(i, degree_of(c, i));
        }
    }
    return changed;
}

static bool tangent_type(Lower *l, Type *t) { return !type_is_resource(t) && !has_arrays(l, t); }

static void tangent_body(Lower *l, Inst *op, uint32_t region, Func *f, Inst **params) {
    Builder saved = l->b;
    l->b = ir_at_end(l->fn, op->region[region]);
    l->b.fold = true;
    l->b.span = saved.span;
    Bind *binds = ARENA_ARRAY(l->arena, Bind, f->nargs + 1);
    uint32_t at = 0;
    for (uint32_t i = 0; i < f->nargs; i++) {
        uint32_t n = gen_layout(l, f->args[i]->type)->n;
        Var *vars = var_new(l, TY_VOID, n);
        for (uint32_t j = 0; j < n; j++) vars[j].value = params[at++], vars[j].type = (IrType)vars[j].value->type;
        binds[i] = (Bind){.kind = BIND_VARS, .vars = vars};
    }
    Val v = gen_inline(l, f, binds, saved.span);
    ir_yield(&l->b, v.n, v.c);
    l->b = saved;
}

static Val call_with_tangent(Lower *l, Expr *e) {
    Func *f = e->func, *df = f->tangent;
    bool good = type_is_float(f->ret) && !gen_facts(l, f)->rand && !gen_facts(l, df)->rand;
    for (uint32_t i = 0; i < f->nargs; i++)
        good = good && f->args[i]->mode == ARG_IN && tangent_type(l, f->args[i]->type);
    if (!good) {
        diag_emit(l->s, DIAG_tangent_form, f->tangent_span, "[Tangent] does not work on a function of this form");
        gen_giveup(l);
    }
    Vec(Inst *) args = {0};
    for (uint32_t i = 0; i < e->nargs; i++) {
        Val v = gen_expr(l, e->args[i]);
        for (uint32_t j = 0; j < v.n; j++) vec_push(l->arena, &args, v.c[j]);
    }
    Inst *op = special(l, OP_custom, TY_VOID, args.len, args.data, (Imm){0});
    Block *primal = ir_block(l->fn, op), *tangent = ir_block(l->fn, op);
    Vec(Inst *) pp = {0}, tp = {0};
    for (uint32_t i = 0; i < args.len; i++) {
        vec_push(l->arena, &pp, ir_block_param(l->fn, primal, (IrType)args.data[i]->type));
        vec_push(l->arena, &tp, ir_block_param(l->fn, tangent, (IrType)args.data[i]->type));
        if (args.data[i]->type == TY_INT) {
            int64_t lo, hi;
            range_get(l, args.data[i], &lo, &hi);
            range_set(l, pp.data[i], lo, hi);
            range_set(l, tp.data[i], lo, hi);
        }
    }
    /* One tangent for every float argument; df names those of float-typed arguments, in order. */
    uint32_t at = 0;
    Vec(Inst *) dp = {0};
    for (uint32_t i = 0; i < f->nargs; i++) {
        uint32_t n = gen_layout(l, f->args[i]->type)->n;
        bool named = type_is_float(f->args[i]->type);
        for (uint32_t j = 0; j < n; j++, at++) {
            if (args.data[at]->type != TY_FLT) continue;
            Inst *d = ir_block_param(l->fn, tangent, TY_FLT);
            d->flags = DEG_LINEAR;
            if (named) vec_push(l->arena, &dp, d);
        }
    }
    for (uint32_t i = 0; i < dp.len; i++) vec_push(l->arena, &tp, dp.data[i]);
    tangent_body(l, op, 0, f, pp.data);
    bool was = l->in_tangent;
    l->in_tangent = true;
    tangent_body(l, op, 1, df, tp.data);
    l->in_tangent = was;
    Linear check = {SPAN_NONE, NULL};
    degrees(&check, tangent);
    for (uint32_t i = 0; i < tangent->last->nargs && !check.why; i++) {
        Inst *r = tangent->last->args[i];
        if (degree(r) == DEG_NONE && !is_null(r))
            check.where = r->span, check.why = "its result has a part without a tangent";
    }
    if (check.why) {
        Diag *d = diag_emit(l->s, DIAG_tangent_not_linear, check.where.file >= 0 ? check.where : df->name_span,
                            df->name, check.why);
        diag_note(l->s, d, f->tangent_span, "`%s` is the derivative of `%s`", df->name, f->name);
        gen_giveup(l);
    }
    Val out = val_new(l, f->ret);
    for (uint32_t i = 0; i < out.n; i++) out.c[i] = ir_proj(&l->b, op, i);
    return out;
}

/* ---- calls */

Val gen_call(Lower *l, Expr *e) {
    Func *f = e->func;
    if (f->tangent) return call_with_tangent(l, e);
    Bind *binds = ARENA_ARRAY(l->arena, Bind, f->nargs + 1);
    Place *places = ARENA_ARRAY(l->arena, Place, f->nargs + 1);
    bool effects = false; /* an argument writes something that another might share */
    for (uint32_t i = 0; i < e->nargs; i++) effects |= expr_assigns(e->args[i]);
    for (uint32_t i = 0; i < f->nargs; i++) {
        Symbol *arg = f->args[i];
        Expr *given = e->args[i];
        Type *t = arg->type;
        if (type_is_resource(t)) {
            binds[i] = (Bind){.kind = BIND_RESOURCE, .resource = gen_resource(l, given)};
            continue;
        }
        bool arrays = has_arrays(l, t);
        if (arg->mode == ARG_IN && arrays && !effects && gen_is_place(given) && !assigns_stmt(f->body, arg)) {
            binds[i] = (Bind){.kind = BIND_PLACE, .place = gen_place(l, given)};
            continue;
        }
        Var *vars;
        if (arg->mode == ARG_IN) {
            Val v = gen_expr(l, given);
            vars = arrays ? vars_for(l, t) : var_new(l, TY_VOID, v.n);
            if (arrays) vars_store(l, t, vars, v, false);
            for (uint32_t j = 0; j < v.n && !arrays; j++) vars[j].value = v.c[j], vars[j].type = (IrType)v.c[j]->type;
        } else {
            places[i] = gen_place(l, given);
            vars = vars_for(l, t);
            if (arg->mode == ARG_INOUT) vars_store(l, t, vars, place_load(l, &places[i]), false);
        }
        binds[i] = (Bind){.kind = BIND_VARS, .vars = vars};
    }
    Val out = gen_inline(l, f, binds, e->span);
    /* A variable of the file that was handed over as an argument too holds what the argument does. */
    for (int hidden = 1; hidden >= 0; hidden--)
        for (uint32_t i = 0; i < f->nargs; i++)
            if (f->args[i]->mode != ARG_IN && f->args[i]->hidden == hidden)
                place_store(l, &places[i], vars_load(l, f->args[i]->type, binds[i].vars));
    return out;
}
