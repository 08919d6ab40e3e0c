/* Loops: what they carry, how often they run, and the two forms they take.
 *
 *   rotated          if_(c0) loop { body; step; yield c, ... }      the condition is small and pure
 *   header in body   loop { c = cond; if_(c) { body; step }; yield c, ... }
 *
 * The counter of `for (int i = a; i < b; i += s)` that the body leaves alone is not carried: it is a + k*s. */
#include <math.h>
#include <string.h>

#include "compiler/front/gen/internal.h"

enum { ROTATE_COST = 16 };
#define MAX_TRIPS ((int64_t)1 << 24)

/* ---- what is assigned in a piece of source */

static void add_vars(Lower *l, const Symbol *sym, VarList *out) {
    if (sym->kind != SYM_LOCAL && sym->kind != SYM_ARG) return;
    Bind *b = gen_bind(l, sym);
    if (b->kind != BIND_VARS) return;
    const Layout *layout = gen_layout(l, sym->type);
    for (uint32_t i = 0; i < layout->n; i++) {
        Var *v = &b->vars[i];
        if (layout->leaf[i].count || v->stamp == l->stamps) continue;
        v->stamp = l->stamps;
        vec_push(l->arena, out, v);
    }
}

static void add_place(Lower *l, const Expr *e, VarList *out) {
    while (e->kind == E_FIELD || e->kind == E_SWIZZLE || e->kind == E_INDEX) e = e->a[0];
    if (e->kind == E_NAME) add_vars(l, e->sym, out);
}

void scan_assigned_expr(Lower *l, const Expr *e, VarList *out) {
    if (!e) return;
    if (e->kind == E_ASSIGN || e->kind == E_INCDEC) add_place(l, e->a[0], out);
    if (e->kind == E_CALL)
        for (uint32_t i = 0; i < e->nargs && i < e->func->nargs; i++)
            if (e->func->args[i]->mode != ARG_IN) add_place(l, e->args[i], out);
    for (uint32_t i = 0; i < 3; i++) scan_assigned_expr(l, e->a[i], out);
    for (uint32_t i = 0; i < e->nargs; i++) scan_assigned_expr(l, e->args[i], out);
}

void scan_assigned_stmt(Lower *l, const Stmt *s, VarList *out) {
    if (!s) return;
    for (uint32_t i = 0; i < s->ndecls; i++) {
        scan_assigned_expr(l, s->decls[i]->init, out);
        gen_bind(l, s->decls[i])->kind = BIND_NONE; /* declared inside: nothing of it lives before or after */
    }
    scan_assigned_stmt(l, s->init, out);
    scan_assigned_expr(l, s->expr, out);
    scan_assigned_expr(l, s->step, out);
    for (uint32_t i = 0; i < s->nargs; i++) scan_assigned_expr(l, s->args[i], out);
    scan_assigned_stmt(l, s->body, out);
    scan_assigned_stmt(l, s->orelse, out);
    for (uint32_t i = 0; i < s->nstmts; i++) scan_assigned_stmt(l, s->stmts[i], out);
    for (uint32_t c = 0; c < s->ncases; c++)
        for (uint32_t i = 0; i < s->cases[c].nbody; i++) scan_assigned_stmt(l, s->cases[c].body[i], out);
}

bool expr_uses_rand(Lower *l, const Expr *e) {
    if (!e) return false;
    if (e->kind == E_BUILTIN && (e->builtin == B_rand || e->builtin == B_rand2 || e->builtin == B_rand3)) return true;
    if (e->kind == E_CALL && gen_facts(l, e->func)->rand) return true;
    for (uint32_t i = 0; i < 3; i++)
        if (expr_uses_rand(l, e->a[i])) return true;
    for (uint32_t i = 0; i < e->nargs; i++)
        if (expr_uses_rand(l, e->args[i])) return true;
    return false;
}

bool stmt_uses_rand(Lower *l, const Stmt *s) {
    if (!s) return false;
    if (expr_uses_rand(l, s->expr) || expr_uses_rand(l, s->step) || stmt_uses_rand(l, s->init) ||
        stmt_uses_rand(l, s->body) || stmt_uses_rand(l, s->orelse))
        return true;
    for (uint32_t i = 0; i < s->ndecls; i++)
        if (expr_uses_rand(l, s->decls[i]->init)) return true;
    for (uint32_t i = 0; i < s->nargs; i++)
        if (expr_uses_rand(l, s->args[i])) return true;
    for (uint32_t i = 0; i < s->nstmts; i++)
        if (stmt_uses_rand(l, s->stmts[i])) return true;
    for (uint32_t c = 0; c < s->ncases; c++)
        for (uint32_t i = 0; i < s->cases[c].nbody; i++)
            if (stmt_uses_rand(l, s->cases[c].body[i])) return true;
    return false;
}

/* ---- counters */

typedef struct Counter {
    Symbol *sym;
    Var *var;
    int64_t step; /* 0: no counter */
    double fstep; /* of a float counter */
    Operator op;  /* the loop runs while sym op bound */
    Expr *bound;
    bool local;    /* declared in the for: not visible afterwards */
    int64_t trips; /* iterations at most; -1: not known */
    bool exact;
} Counter;

static const Expr *strip(const Expr *e) {
    while (e && (e->kind == E_CONVERT) && e->a[0]->kind == E_NAME && !e->explicit_cast && e->type->kind != T_FLOAT)
        e = e->a[0];
    return e;
}

static Operator mirrored(Operator op) {
    switch (op) {
    case OPR_LT: return OPR_GT;
    case OPR_LE: return OPR_GE;
    case OPR_GT: return OPR_LT;
    case OPR_GE: return OPR_LE;
    default: return op;
    }
}

/* sym += step, in any spelling. */
static bool match_step(const Expr *e, const Symbol **sym, int64_t *step, double *fstep) {
    if (!e) return false;
    const Expr *place = e->a[0];
    if ((e->kind != E_INCDEC && e->kind != E_ASSIGN) || place->kind != E_NAME) return false;
    *sym = place->sym;
    TypeKind k = place->type->kind;
    if (k != T_INT && k != T_UINT && k != T_FLOAT) return false;
    int sign = 1;
    const Expr *by = NULL;
    if (e->kind == E_INCDEC) {
        *step = e->op == OPR_INC ? 1 : -1;
        *fstep = (double)*step;
        return true;
    }
    if (e->op == OPR_ADD || e->op == OPR_SUB) {
        by = e->a[1];
        sign = e->op == OPR_SUB ? -1 : 1;
    } else if (e->op == OPR_NONE && e->a[1]->kind == E_BINARY && (e->a[1]->op == OPR_ADD || e->a[1]->op == OPR_SUB)) {
        const Expr *x = e->a[1]->a[0], *y = e->a[1]->a[1];
        sign = e->a[1]->op == OPR_SUB ? -1 : 1;
        if (x->kind == E_NAME && x->sym == *sym) by = y;
        else if (sign == 1 && y->kind == E_NAME && y->sym == *sym) by = x;
    }
    if (!by) return false;
    const ConstVal *c = by->kind == E_LITERAL || (by->is_const && by->cval.n == 1) ? &by->cval
                        : by->kind == E_NAME && by->sym->kind == SYM_CONST         ? &by->sym->cval
                                                                                   : NULL;
    if (!c || c->n != 1) return false;
    if (k == T_FLOAT) *fstep = sign * c->v[0].f, *step = 1;
    else *step = sign * (k == T_UINT ? (int64_t)(int32_t)c->v[0].i : c->v[0].i);
    return k == T_FLOAT ? *fstep != 0 : *step != 0;
}

static bool reads_assigned(Lower *l, const Expr *e, uint32_t stamp) {
    if (!e) return false;
    if (e->kind == E_NAME && (e->sym->kind == SYM_LOCAL || e->sym->kind == SYM_ARG)) {
        Bind *b = gen_bind(l, e->sym);
        if (b->kind == BIND_VARS) {
            const Layout *layout = gen_layout(l, e->sym->type);
            for (uint32_t i = 0; i < layout->n; i++)
                if (b->vars[i].stamp == stamp || layout->leaf[i].count) return true;
        }
    }
    for (uint32_t i = 0; i < 3; i++)
        if (reads_assigned(l, e->a[i], stamp)) return true;
    for (uint32_t i = 0; i < e->nargs; i++)
        if (reads_assigned(l, e->args[i], stamp)) return true;
    return false;
}

static int64_t ceil_div(int64_t a, int64_t b) { return a <= 0 ? 0 : (a + b - 1) / b; }

/* Trips of `for (i = a; i op b; i += step)` with a in [lo0, hi0] and b in [blo, bhi]. */
static int64_t count_trips(const Counter *c, int64_t lo0, int64_t hi0, int64_t blo, int64_t bhi) {
    switch (c->op) {
    case OPR_LT: return c->step > 0 ? ceil_div(bhi - lo0, c->step) : -1;
    case OPR_LE: return c->step > 0 ? ceil_div(bhi + 1 - lo0, c->step) : -1;
    case OPR_GT: return c->step < 0 ? ceil_div(hi0 - blo, -c->step) : -1;
    case OPR_GE: return c->step < 0 ? ceil_div(hi0 + 1 - blo, -c->step) : -1;
    case OPR_NE: {
        if (lo0 != hi0 || blo != bhi || (blo - lo0) % c->step != 0) return -1;
        int64_t n = (blo - lo0) / c->step;
        return n >= 0 ? n : -1;
    }
    default: return -1;
    }
}

/* A float counter runs as the loop itself would, in its precision. */
static int64_t count_float_trips(Lower *l, const Counter *c, double at, double bound) {
    int64_t n = 0;
    bool single = l->fn->precision == PREC_F32;
    for (; n <= MAX_TRIPS; n++) {
        bool goes = c->op == OPR_LT   ? at < bound
                    : c->op == OPR_LE ? at <= bound
                    : c->op == OPR_GT ? at > bound
                    : c->op == OPR_GE ? at >= bound
                                      : at != bound;
        if (!goes) break;
        at = single ? (double)((float)at + (float)c->fstep) : at + c->fstep;
    }
    return n;
}

static Counter find_counter(Lower *l, Stmt *s, uint32_t stamp) {
    Counter c = {.trips = -1};
    const Symbol *sym = NULL;
    int64_t step = 0;
    double fstep = 0;
    if (s->kind != S_FOR || !s->expr || !match_step(s->step, &sym, &step, &fstep)) return c;
    if (sym->kind != SYM_LOCAL && sym->kind != SYM_ARG) return c;
    Bind *b = gen_bind(l, sym);
    if (b->kind != BIND_VARS) return c;
    if (b->vars->stamp == stamp || expr_assigns(s->expr)) return c; /* the body writes the counter */
    const Expr *cond = s->expr;
    if (cond->kind != E_BINARY) return c;
    Operator op = cond->op;
    Expr *bound;
    const Expr *left = strip(cond->a[0]), *right = strip(cond->a[1]);
    if (left->kind == E_NAME && left->sym == sym) bound = cond->a[1];
    else if (right->kind == E_NAME && right->sym == sym) bound = cond->a[0], op = mirrored(op);
    else return c;
    if (op != OPR_LT && op != OPR_LE && op != OPR_GT && op != OPR_GE && op != OPR_NE) return c;
    if (reads_assigned(l, bound, stamp) || expr_cost(l, bound, ROTATE_COST) > ROTATE_COST) return c;
    Stmt *init = s->init;
    if (init && init->kind == S_DECL)
        for (uint32_t i = 0; i < init->ndecls; i++) c.local |= init->decls[i] == sym;
    c.sym = (Symbol *)sym;
    c.var = b->vars;
    c.step = step, c.fstep = fstep;
    c.op = op, c.bound = bound;
    Inst *start = var_get(l, c.var), *stop = gen_scalar(l, bound);
    if (sym->type->kind == T_FLOAT) {
        c.step = 0;
        if (start->op == OP_constf && stop->op == OP_constf) {
            c.trips = count_float_trips(l, &c, start->imm.f, stop->imm.f);
            c.exact = true;
        }
        return c;
    }
    int64_t lo0, hi0, blo, bhi;
    range_get(l, start, &lo0, &hi0);
    range_get(l, stop, &blo, &bhi);
    if (bound->type->kind == T_UINT) { /* compared as unsigned: only ranges that mean the same */
        if (start->op == OP_consti) lo0 = hi0 = (uint32_t)start->imm.i;
        if (stop->op == OP_consti) blo = bhi = (uint32_t)stop->imm.i;
        if (lo0 < 0 || blo < 0) return c;
    }
    bool open_lo = lo0 <= INT32_MIN && start->op != OP_consti, open_hi = hi0 >= INT32_MAX && start->op != OP_consti;
    bool open_b = (step > 0 ? bhi >= INT32_MAX : blo <= INT32_MIN) && stop->op != OP_consti;
    if ((step > 0 ? open_lo : open_hi) || open_b) return c;
    c.trips = count_trips(&c, lo0, hi0, blo, bhi);
    c.exact = c.trips >= 0 && start->op == OP_consti && stop->op == OP_consti;
    if (c.exact && c.trips > 0) { /* a counter that would wrap around never ends */
        int64_t last = lo0 + c.trips * c.step;
        if (last > (bound->type->kind == T_UINT ? (int64_t)UINT32_MAX : INT32_MAX) || last < INT32_MIN)
            c.trips = MAX_TRIPS + 1;
    }
    return c;
}

/* ---- the loop */

static void note_path(Lower *l, Diag *d) {
    if (l->frame && l->frame->caller) diag_note(l->s, d, l->frame->call_span, "inlined as %s", gen_path(l));
}

typedef struct LoopPlan {
    int64_t bound; /* most runs of the body */
    bool cut;      /* [MaxIters] may end the loop */
    bool exact;
} LoopPlan;

static LoopPlan plan(Lower *l, Stmt *s, const Counter *c, Jumps j) {
    LoopPlan p = {.bound = c->trips};
    int64_t max = s->attrs.max_iters ? s->attrs.max_iters->cval.v[0].i : 0;
    if (s->trip_exact && s->trip_bound > 0 && (p.bound < 0 || s->trip_bound < p.bound)) p.bound = s->trip_bound;
    if (!max && p.bound < 0 && s->open_ended) max = GLSL_MAX_ITERS;
    if (p.bound < 0 || (max && p.bound > max)) {
        if (!max) {
            Diag *d = diag_emit(l->s, DIAG_loop_needs_max, s->span, "its trip count is not bounded by constants");
            note_path(l, d);
            gen_giveup(l);
        }
        p.bound = max;
        p.cut = true;
    }
    if (p.bound > MAX_TRIPS) {
        const char *times = p.bound > MAX_TRIPS ? arena_printf(l->arena, "%lld", (long long)p.bound) : "";
        Diag *d = diag_emit(l->s, DIAG_loop_too_long, s->span, p.bound == MAX_TRIPS + 1 ? "more than 16777216" : times);
        note_path(l, d);
        gen_giveup(l);
    }
    p.exact = c->exact && !p.cut && !j.brk && !j.ret && p.bound == c->trips;
    return p;
}

static Inst *gen_condition(Lower *l, Stmt *s) {
    if (!s->expr) return kb(l, true);
    Tag tag = l->tag;
    l->tag = tag_for(l, s);
    Inst *c = gen_scalar(l, s->expr);
    l->tag = tag;
    return c;
}

static void gen_step(Lower *l, Stmt *s) {
    if (!s->step) return;
    Tag tag = l->tag;
    l->tag = tag_for(l, s);
    gen_expr(l, s->step);
    l->tag = tag;
}

/* Counts the loops that [MaxIters] ended although the condition held. `more`: the condition holds after iteration k. */
static Inst *cut_short(Lower *l, Inst *more, Inst *k, int64_t bound) {
    Inst *last = op2(l, OP_ieq, k, ki(l, bound - 1));
    Inst *cut = op2(l, OP_band, more, last);
    if (!is_false(cut)) special(l, OP_count, TY_VOID, 1, &cut, (Imm){.i = COUNTER_TRUNCATED});
    return op2(l, OP_band, more, op1(l, OP_bnot, last));
}

/* No jump out of the loop was taken in this iteration; NULL: none can have been. */
static Inst *staying(Lower *l, Jumps j) {
    Inst *gone = NULL;
    Inst *flags[2] = {j.brk ? l->frame->brk->value : NULL, j.ret ? l->frame->ret_flag->value : NULL};
    for (int i = 0; i < 2; i++)
        if (flags[i] && !is_false(flags[i])) gone = gone ? op2(l, OP_bor, gone, flags[i]) : flags[i];
    return gone ? op1(l, OP_bnot, gone) : NULL;
}

static Inst *counter_value(Lower *l, const Counter *c, Inst *start, Inst *k) {
    Inst *scaled = c->step == 1 ? k : op2(l, OP_imul, k, ki(l, c->step));
    return start->op == OP_consti && !start->imm.i ? scaled : op2(l, OP_iadd, start, scaled);
}

typedef struct LoopJob {
    Stmt *s;
    Counter counter;
    LoopPlan plan;
    bool by_index; /* the counter is start + k*step, not carried */
    Inst *start;
    VarList carried;
    Jumps jumps;
} LoopJob;

/* Body and step of one iteration; returns "go on" without looking at the bound. */
static Inst *iteration(Lower *l, LoopJob *job, Inst *k, bool condition_after) {
    Stmt *s = job->s;
    Counter *c = &job->counter;
    if (job->jumps.cnt) {
        l->frame->cnt = var_new(l, TY_BOOL, 1);
        l->frame->cnt->value = kb(l, false);
    }
    if (job->by_index) {
        Inst *i = counter_value(l, c, job->start, k);
        int64_t lo0, hi0, last = (job->plan.bound - 1) * c->step;
        range_get(l, job->start, &lo0, &hi0);
        if (!job->plan.cut && i != k) range_set(l, i, lo0 + (last < 0 ? last : 0), hi0 + (last > 0 ? last : 0));
        var_set(l, c->var, i);
    }
    gen_list(l, &s->body, s->body ? 1 : 0);
    Inst *stay = staying(l, job->jumps);
    if (stay && is_false(stay)) return stay;
    if (job->by_index) {
        if (!condition_after) return stay ? stay : kb(l, true);
        if (job->plan.exact || (c->exact && !job->plan.cut)) {
            Inst *more = op2(l, OP_ilt, k, ki(l, job->plan.bound - 1));
            return stay ? op2(l, OP_band, stay, more) : more;
        }
        var_set(l, c->var, op2(l, OP_iadd, c->var->value, ki(l, c->step)));
        Inst *more = gen_condition(l, s);
        return stay ? op2(l, OP_band, stay, more) : more;
    }
    if (!stay || is_true(stay)) {
        if (s->kind == S_FOR) gen_step(l, s);
        return condition_after ? gen_condition(l, s) : kb(l, true);
    }
    Var *more = var_new(l, TY_BOOL, 1);
    more->value = kb(l, false);
    IfCtx ctx;
    if_begin(l, &ctx, stay);
    if (s->kind == S_FOR) gen_step(l, s);
    var_set(l, more, condition_after ? gen_condition(l, s) : kb(l, true));
    if_else(l, &ctx);
    if_end(l, &ctx);
    return more->value;
}

static void finish(Lower *l, LoopJob *job, LoopCtx *ctx, Inst *go_on) {
    bool outermost = l->frame->first_loop == ctx;
    loop_end(l, ctx, go_on);
    if (job->by_index)
        var_set(l, job->counter.var,
                job->start); /* the counter's value inside is not visible here, and nobody reads it */
    if (outermost) site_flush_skips(l, ctx);
}

static void gen_rotated(Lower *l, LoopJob *job) {
    LoopCtx ctx = {.iters = (uint64_t)job->plan.bound};
    LoopInfo info = {.max_iters = (uint32_t)job->plan.bound, .exact = job->plan.exact, .told = job->s->trip_told};
    loop_begin(l, &ctx, &job->carried, info);
    Inst *more = iteration(l, job, ctx.k, true);
    if (job->plan.cut) more = cut_short(l, more, ctx.k, job->plan.bound);
    else if (!job->plan.exact && !is_false(more))
        more = op2(l, OP_band, more, op2(l, OP_ilt, ctx.k, ki(l, job->plan.bound - 1)));
    finish(l, job, &ctx, more);
}

static void gen_header_in_body(Lower *l, LoopJob *job) {
    Stmt *s = job->s;
    LoopCtx ctx = {.iters = (uint64_t)job->plan.bound + 1};
    loop_begin(l, &ctx, &job->carried, (LoopInfo){.max_iters = (uint32_t)job->plan.bound + 1, .told = s->trip_told});
    if (job->by_index) {
        Inst *i = counter_value(l, &job->counter, job->start, ctx.k);
        var_set(l, job->counter.var, i);
    }
    Inst *c = gen_condition(l, s);
    if (job->plan.cut) {
        Inst *last = op2(l, OP_ieq, ctx.k, ki(l, job->plan.bound)), *cut = op2(l, OP_band, c, last);
        special(l, OP_count, TY_VOID, 1, &cut, (Imm){.i = COUNTER_TRUNCATED});
        c = op2(l, OP_band, c, op1(l, OP_bnot, last));
    } else {
        c = op2(l, OP_band, c, op2(l, OP_ilt, ctx.k, ki(l, job->plan.bound)));
    }
    Var *more = var_new(l, TY_BOOL, 1);
    more->value = kb(l, false);
    IfCtx ic;
    if_begin(l, &ic, c);
    var_set(l, more, iteration(l, job, ctx.k, false));
    if_else(l, &ic);
    if_end(l, &ic);
    finish(l, job, &ctx, more->value);
}

/* [Cull]: the runtime may leave iterations out, so k is the index and the IR loop has a constant bound; iterations
 * beyond the source's own bound do nothing. */
static void gen_cull(Lower *l, LoopJob *job) {
    Stmt *s = job->s;
    Counter *c = &job->counter;
    if (l->culls.len >= SLT_MAX_CULL) session_limit(l->s, "more than %d [Cull] loops in one program", SLT_MAX_CULL);
    LoopInfo info = {.max_iters = (uint32_t)job->plan.bound, .cull = true, .cull_id = l->culls.len};
    Fn *bounds = gen_function(l, s->attrs.cull, s->attrs.cull->name, IN_ITERATION, 0, 4);
    ir_name_outputs(bounds, SLT_OUT_BOX);
    vec_push(l->arena, &l->culls, bounds);
    Inst *limit = c->exact ? NULL : gen_scalar(l, c->bound);
    if (job->plan.cut && limit) {
        Inst *cut = op2(l, OP_ilt, ki(l, job->plan.bound), limit);
        if (!is_false(cut)) special(l, OP_count, TY_VOID, 1, &cut, (Imm){.i = COUNTER_TRUNCATED});
    }
    LoopCtx ctx = {.iters = (uint64_t)job->plan.bound};
    info.exact = !job->jumps.brk && !job->jumps.ret;
    loop_begin(l, &ctx, &job->carried, info);
    Inst *stay;
    if (limit) {
        Var *more = var_new(l, TY_BOOL, 1);
        more->value = kb(l, true);
        IfCtx ic;
        if_begin(l, &ic, op2(l, OP_ilt, ctx.k, limit));
        var_set(l, more, iteration(l, job, ctx.k, false));
        if_else(l, &ic);
        if_end(l, &ic);
        stay = more->value;
    } else {
        stay = iteration(l, job, ctx.k, false);
    }
    finish(l, job, &ctx, op2(l, OP_band, stay, op2(l, OP_ilt, ctx.k, ki(l, job->plan.bound - 1))));
}

/* Is what the loop asks first true, whatever the shader is given? Nothing of the question stays: no site, no record. */
static bool begins(Lower *l, Stmt *s) {
    bool quiet = l->quiet;
    l->quiet = true;
    bool is = is_true(gen_condition(l, s));
    l->quiet = quiet;
    return is;
}

void gen_loop(Lower *l, Stmt *s) {
    Frame *f = l->frame;
    Var *brk = f->brk, *cnt = f->cnt;
    LoopJob job = {.s = s, .jumps = stmt_jumps(s->body)};
    if (s->init) {
        Tag tag = l->tag;
        l->tag = tag_for(l, s);
        if (s->init->kind == S_DECL) {
            bool disc = s->init->attrs.disc, nodisc = s->init->attrs.nodisc;
            s->init->attrs.disc |= s->attrs.disc, s->init->attrs.nodisc |= s->attrs.nodisc;
            gen_stmt(l, s->init);
            s->init->attrs.disc = disc, s->init->attrs.nodisc = nodisc;
        } else if (s->init->expr) {
            gen_expr(l, s->init->expr);
        }
        l->tag = tag;
    }
    /* What the body alone writes, to tell counters; then all that the loop carries. */
    uint32_t body_stamp = ++l->stamps;
    VarList body = {0};
    scan_assigned_stmt(l, s->body, &body);
    job.counter = find_counter(l, s, body_stamp);
    job.plan = plan(l, s, &job.counter, job.jumps);
    if (job.plan.bound == 0) { /* exactly no iteration */
        f->brk = brk, f->cnt = cnt;
        return;
    }
    job.by_index = job.counter.step != 0 && job.counter.local;
    ++l->stamps;
    scan_assigned_stmt(l, s->body, &job.carried);
    scan_assigned_expr(l, s->expr, &job.carried);
    if (!job.by_index) scan_assigned_expr(l, s->step, &job.carried);
    if (stmt_uses_rand(l, s->body) || expr_uses_rand(l, s->expr) || expr_uses_rand(l, s->step))
        vec_push(l->arena, &job.carried, l->rand_counter);
    f->brk = NULL;
    if (job.jumps.brk) {
        f->brk = var_new(l, TY_BOOL, 1);
        f->brk->value = kb(l, false);
        vec_push(l->arena, &job.carried, f->brk);
    }
    if (job.jumps.ret) {
        vec_push(l->arena, &job.carried, f->ret_flag);
        uint32_t n = f->func->ret->kind == T_VOID ? 0 : gen_layout(l, f->func->ret)->n;
        for (uint32_t i = 0; i < n; i++)
            if (f->ret[i].type != TY_ARRAY) vec_push(l->arena, &job.carried, &f->ret[i]);
    }
    if (job.by_index) job.start = var_get(l, job.counter.var);

    bool sites = tag_for(l, s).disc && expr_has_site(s->expr);
    bool cheap = !s->expr || (!expr_uses_rand(l, s->expr) && expr_cost(l, s->expr, ROTATE_COST) <= ROTATE_COST);
    bool plain = s->kind == S_DO || !s->expr || (!sites && cheap);
    /* `while (h > eps)` asks what the step before it found: there it is the march that opt_marches knows. */
    bool asks_behind = sites && cheap && l->opt->front.disc_auto && !plain && begins(l, s);
    Counter *c = &job.counter;
    bool cull = s->attrs.cull && job.by_index && c->step == 1 && c->op == OPR_LT && job.start->op == OP_consti &&
                !job.start->imm.i;
    if (cull && !l->quiet) {
        gen_cull(l, &job);
    } else if (s->kind == S_DO || !s->expr || asks_behind) {
        gen_rotated(l, &job);
    } else if (plain) {
        Inst *first = c->exact && c->trips > 0 ? kb(l, true) : gen_condition(l, s);
        if (is_true(first)) {
            gen_rotated(l, &job);
        } else if (!is_false(first)) {
            IfCtx ctx;
            if_begin(l, &ctx, first);
            gen_rotated(l, &job);
            if_else(l, &ctx);
            if_end(l, &ctx);
        }
    } else {
        gen_header_in_body(l, &job);
    }
    f->brk = brk, f->cnt = cnt;
}
