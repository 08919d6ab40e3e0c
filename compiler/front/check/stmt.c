/* Statements: scopes of locals, conditions, returns, attributes. */
#include "compiler/front/check/internal.h"

#include <string.h>

/* ---- walking */

void visit_expr(Expr *e, void (*f)(Expr *, void *), void *user) {
    if (!e) return;
    for (int i = 0; i < 3; i++) visit_expr(e->a[i], f, user);
    for (uint32_t i = 0; i < e->nargs; i++) visit_expr(e->args[i], f, user);
    f(e, user);
}

void visit_stmt(Stmt *s, void (*f)(Expr *, void *), void *user) {
    if (!s) return;
    visit_stmt(s->init, f, user);
    for (uint32_t i = 0; i < s->ndecls; i++) visit_expr(s->decls[i]->init, f, user);
    visit_expr(s->expr, f, user);
    for (uint32_t i = 0; i < s->nargs; i++) visit_expr(s->args[i], f, user);
    visit_stmt(s->body, f, user);
    visit_stmt(s->orelse, f, user);
    for (uint32_t i = 0; i < s->nstmts; i++) visit_stmt(s->stmts[i], f, user);
    for (uint32_t i = 0; i < s->ncases; i++)
        for (uint32_t j = 0; j < s->cases[i].nbody; j++) visit_stmt(s->cases[i].body[j], f, user);
    visit_expr(s->step, f, user);
}

/* ---- scopes */

static void scope_open(Checker *c) { c->at.depth++; }

static void scope_close(Checker *c) {
    while (c->at.stack && c->at.stack->depth == c->at.depth) {
        Binding *b = c->at.stack;
        map_put(c->arena, &c->at.locals, b->name, b->hidden);
        c->at.stack = b->below;
    }
    c->at.depth--;
}

static void bind(Checker *c, Symbol *sym) {
    Binding *old = map_get(&c->at.locals, sym->name);
    if (old && old->depth == c->at.depth && sym->type->kind != T_ERROR) { /* `retrun a;` looks like a declaration */
        Diag *d = diag_emit(c->s, DIAG_redeclared, sym->span, sym->name);
        diag_note(c->s, d, old->sym->span, "the first is here");
    }
    Binding *b = ARENA_NEW(c->arena, Binding);
    *b = (Binding){.name = sym->name, .sym = sym, .depth = c->at.depth, .hidden = old, .below = c->at.stack};
    c->at.stack = b;
    map_put(c->arena, &c->at.locals, sym->name, b);
}

static void declare_local(Checker *c, Func *f, Symbol *sym) {
    Session *s = c->s;
    bool open = sym->type_ref->ndims && !sym->type_ref->dims[0] && sym->init && sym->init->kind == E_LIST;
    Type *t = resolve_type(c, sym->type_ref, open, CHECK_MAX_LOCAL);
    if (open && t->kind == T_ARRAY) t = type_array(s, t->elem, sym->init->nargs ? sym->init->nargs : 1);
    if (type_is_resource(t)) {
        diag_emit(s, DIAG_bad_resource, sym->span,
                  arena_printf(&s->session, "a %s cannot be a local variable", t->name));
        t = c->t_error;
    } else if (t->kind == T_VOID) {
        diag_emit(s, DIAG_void_value, sym->span, "variable");
        t = c->t_error;
    }
    sym->kind = SYM_LOCAL;
    sym->type = t;
    sym->id = f->nlocals++;
    bool glsl = f->module->glsl; /* where a name is not known in its own value: `float3 normal = normal(p);` */
    if (glsl && sym->init) sym->init = check_init(c, sym->init, t);
    bind(c, sym);
    if (!sym->init) return;
    /* a `const` is no constant in its own value: `cval` and `array_init` are still empty */
    if (!glsl) sym->init = check_init(c, sym->init, t);
    if (!sym->is_const || sym->init->type->kind == T_ERROR || !sym->init->is_const) return;
    if (is_aggregate(t)) sym->array_init = const_list(sym->init);
    else sym->cval = sym->init->cval;
}

/* ---- attributes */

static const char *stmt_what(const Stmt *st) {
    switch (st->kind) {
    case S_EXPR: return "an expression";
    case S_DECL: return "a declaration";
    case S_IF: return "`if`";
    case S_FOR: return "`for`";
    case S_WHILE: return "`while`";
    case S_DO: return "`do`";
    case S_SWITCH: return "`switch`";
    case S_BREAK: return "`break`";
    case S_CONTINUE: return "`continue`";
    case S_RETURN: return "`return`";
    case S_BLOCK: return "a block";
    case S_EMPTY: return "an empty statement";
    case S_PRINT: return "`print`";
    case S_ASSERT: return "`assert`";
    }
    return "this statement";
}

/* for (int i = 0; i < n; i++): the form that [Cull] takes. */
static bool counted_from_zero(const Stmt *st) {
    if (!st->init || st->init->kind != S_DECL || st->init->ndecls != 1) return false;
    const Symbol *i = st->init->decls[0];
    if (!i->type || i->type->kind != T_INT || !i->init || !i->init->is_const || i->init->cval.v[0].i) return false;
    const Expr *cond = st->expr, *step = st->step;
    if (!cond || cond->kind != E_BINARY || cond->op != OPR_LT || cond->a[0]->kind != E_NAME || cond->a[0]->sym != i)
        return false;
    if (!step || !step->a[0] || step->a[0]->kind != E_NAME || step->a[0]->sym != i) return false;
    if (step->kind == E_INCDEC) return step->op == OPR_INC;
    return step->kind == E_ASSIGN && step->op == OPR_ADD && step->a[1]->is_const && step->a[1]->cval.v[0].i == 1;
}

static void check_cull(Checker *c, Stmt *st) {
    Session *s = c->s;
    StmtAttrs *a = &st->attrs;
    if (st->kind != S_FOR) {
        diag_emit(s, DIAG_attr_misplaced, a->cull_span, "Cull", stmt_what(st));
        return;
    }
    if (!counted_from_zero(st))
        diag_emit(s, DIAG_bad_cull, a->cull_span,
                  "[Cull] stands before a loop of the form `for (int i = 0; i < n; i++)`");
    if (c->at.func && c->at.func->cull_span.file < 0) c->at.func->cull_span = a->cull_span;
    vec_push(c->arena, &c->culls, ((CullLoop){st, c->at.func ? c->at.func->func : NULL}));
    Decl *d = scope_find(c, a->cull_name, a->cull_span);
    if (d && d->kind == DECL_ERROR) return;
    for (uint32_t i = 0; d && d->kind == DECL_FUNC && i < d->nfuncs; i++) {
        Func *f = d->funcs[i];
        func_signature(c, f);
        if (!func_info(c, f)->signature_ok) return;
        if (f->is_shader || f->ret != type_vector(s, T_FLOAT, 4) || f->nargs != 1 || f->args[0]->type != c->t_int ||
            f->args[0]->mode != ARG_IN)
            continue;
        a->cull = f;
        if (c->at.func) vec_push(c->arena, &c->at.func->calls, ((CallEdge){f, a->cull_span}));
        return;
    }
    Diag *diag = diag_emit(
        s, DIAG_bad_cull, a->cull_span,
        arena_printf(&s->session, "[Cull(%s)] needs a function `float4 %s(int i)`", a->cull_name, a->cull_name));
    if (d) diag_note(s, diag, d->span, "`%s` is declared here", d->name);
}

static void check_attrs_before(Checker *c, Stmt *st) {
    Session *s = c->s;
    StmtAttrs *a = &st->attrs;
    bool loop = st->kind == S_FOR || st->kind == S_WHILE || st->kind == S_DO;
    if (a->max_iters) {
        Span at = a->max_iters_span.file >= 0 && a->max_iters_span.len ? a->max_iters_span : a->max_iters->span;
        a->max_iters = check_value(c, a->max_iters);
        Expr *n = a->max_iters;
        if (!loop) {
            diag_emit(s, DIAG_attr_misplaced, at, "MaxIters", stmt_what(st));
        } else if (n->type->kind != T_ERROR) {
            bool ok = (n->type->kind == T_INT || n->type->kind == T_UINT) && n->is_const;
            int64_t v = ok ? n->cval.v[0].i : 0;
            if (ok && v > CHECK_MAX_TRIPS)
                diag_emit(s, DIAG_loop_too_long, n->span, arena_printf(&s->session, "%lld", (long long)v));
            else if (!ok || v < 1) diag_emit(s, DIAG_max_iters_value, n->span);
        }
    }
    if (a->disc && a->nodisc) {
        Diag *d = diag_emit(s, DIAG_disc_nodisc, a->disc_span);
        if (a->nodisc_span.file >= 0 && a->nodisc_span.len) diag_note(s, d, a->nodisc_span, "[NoDisc] is here");
    }
    if (a->skip_loop && (!a->disc || st->kind != S_IF || !c->at.loops)) diag_emit(s, DIAG_skip_loop, a->skip_span);
}

/* ---- statements */

static void check_stmt(Checker *c, Func *f, Stmt *st);

static void check_stmts(Checker *c, Func *f, Stmt **list, uint32_t n) {
    for (uint32_t i = 0; i < n; i++) check_stmt(c, f, list[i]);
}

/* A body that is a lone declaration has a scope of its own all the same. */
static void check_nested(Checker *c, Func *f, Stmt *st) {
    if (!st) return;
    scope_open(c);
    check_stmt(c, f, st);
    scope_close(c);
}

static void check_loop_body(Checker *c, Func *f, Stmt *st) {
    c->at.loops++;
    uint32_t switches = c->at.switches;
    c->at.switches = 0;
    check_nested(c, f, st);
    c->at.switches = switches;
    c->at.loops--;
}

static int64_t case_value(Checker *c, SwitchCase *k, Type *t, bool *ok) {
    int64_t v = 0;
    k->label_expr = check_value(c, k->label_expr);
    *ok = const_int(c, k->label_expr, "a `case` label", &v);
    return *ok && t->kind != T_ERROR ? const_wrap(t->kind, v) : v;
}

typedef struct Label {
    int64_t value;
    Span span;
    struct Label *next;
} Label;

static void check_switch(Checker *c, Func *f, Stmt *st) {
    Session *s = c->s;
    st->expr = check_value(c, st->expr);
    Type *t = st->expr->type;
    if (t->kind != T_ERROR && t->kind != T_INT && t->kind != T_UINT) {
        diag_emit(s, DIAG_bad_switch, st->expr->span, t->name);
        t = c->t_error;
    }
    SwitchCase *fallback = NULL;
    uint32_t cap = 1;
    while (cap < st->ncases * 2) cap *= 2;
    Label **labels = ARENA_ARRAY(c->arena, Label *, cap);
    scope_open(c);
    c->at.switches++;
    for (uint32_t i = 0; i < st->ncases; i++) {
        SwitchCase *k = &st->cases[i];
        if (k->is_default) {
            if (fallback) {
                Diag *d = diag_emit(s, DIAG_bad_case, k->span, "this `switch` has a second `default`");
                diag_note(s, d, fallback->span, "the first is here");
            }
            fallback = k;
        } else if (k->label_expr) {
            bool ok;
            k->label = case_value(c, k, t, &ok);
            Label **slot = &labels[((uint64_t)k->label * 0x9E3779B97F4A7C15ull >> 32) & (cap - 1)];
            for (Label *l = ok ? *slot : NULL; l; l = l->next)
                if (l->value == k->label) {
                    Diag *d = diag_emit(s, DIAG_bad_case, k->label_expr->span,
                                        arena_printf(&s->session, "a second `case %lld`", (long long)k->label));
                    diag_note(s, d, l->span, "the first is here");
                    ok = false;
                    break;
                }
            if (ok) {
                Label *l = ARENA_NEW(c->arena, Label);
                *l = (Label){k->label, k->label_expr->span, *slot};
                *slot = l;
            }
        }
        check_stmts(c, f, k->body, k->nbody);
    }
    c->at.switches--;
    scope_close(c);
}

static void check_return(Checker *c, Func *f, Stmt *st) {
    Session *s = c->s;
    if (!st->expr) {
        if (f->ret->kind != T_VOID && f->ret->kind != T_ERROR && !f->module->glsl)
            diag_emit(s, DIAG_bad_return, st->span,
                      arena_printf(&s->session, "`%s` returns a value of type %s", f->name, f->ret->name));
        return;
    }
    if (f->ret->kind == T_VOID) {
        st->expr = check_expr(c, st->expr);
        if (st->expr->type->kind != T_ERROR)
            diag_emit(s, DIAG_bad_return, st->expr->span,
                      arena_printf(&s->session, "`%s` is void and returns no value", f->name));
        return;
    }
    st->expr = check_init(c, st->expr, f->ret);
}

static void check_stmt_kind(Checker *c, Func *f, Stmt *st) {
    Session *s = c->s;
    switch (st->kind) {
    case S_EXPR:
        if (st->expr) st->expr = check_expr(c, st->expr);
        break;
    case S_DECL:
        for (uint32_t i = 0; i < st->ndecls; i++) declare_local(c, f, st->decls[i]);
        break;
    case S_IF:
        st->expr = check_condition(c, st->expr, "the condition of `if`");
        check_nested(c, f, st->body);
        check_nested(c, f, st->orelse);
        break;
    case S_FOR:
        scope_open(c);
        if (st->init) check_stmt(c, f, st->init);
        if (st->expr) st->expr = check_condition(c, st->expr, "the condition of `for`");
        if (st->step) st->step = check_expr(c, st->step);
        check_loop_body(c, f, st->body);
        scope_close(c);
        break;
    case S_WHILE:
        st->expr = check_condition(c, st->expr, "the condition of `while`");
        check_loop_body(c, f, st->body);
        break;
    case S_DO:
        check_loop_body(c, f, st->body);
        st->expr = check_condition(c, st->expr, "the condition of `do`");
        break;
    case S_SWITCH: check_switch(c, f, st); break;
    case S_BREAK:
        if (!c->at.loops && !c->at.switches) diag_emit(s, DIAG_bad_break, st->span, "break", "a loop or switch");
        break;
    case S_CONTINUE:
        if (!c->at.loops) diag_emit(s, DIAG_bad_break, st->span, "continue", "a loop");
        break;
    case S_RETURN: check_return(c, f, st); break;
    case S_BLOCK:
        scope_open(c);
        check_stmts(c, f, st->stmts, st->nstmts);
        scope_close(c);
        break;
    case S_EMPTY: break;
    case S_PRINT:
        for (uint32_t i = 0; i < st->nargs; i++) {
            if (st->args[i]->kind == E_LITERAL && !st->args[i]->type) continue;
            st->args[i] = check_value(c, st->args[i]);
            if (is_aggregate(st->args[i]->type)) {
                diag_emit(s, DIAG_bad_argument, st->args[i]->span,
                          arena_printf(&s->session, "`print` takes scalars, vectors, matrices and texts, not %s",
                                       st->args[i]->type->name));
                fail(c, st->args[i]);
            }
        }
        break;
    case S_ASSERT: st->expr = check_condition(c, st->expr, "the condition of `assert`"); break;
    }
}

static void check_stmt(Checker *c, Func *f, Stmt *st) {
    enter_depth(c);
    check_attrs_before(c, st);
    check_stmt_kind(c, f, st);
    if (st->attrs.cull_name) check_cull(c, st);
    c->depth--;
}

void check_body(Checker *c, Func *f) {
    scope_open(c);
    f->nlocals = 0;
    for (uint32_t i = 0; i < f->nargs; i++) {
        f->args[i]->id = f->nlocals++;
        bind(c, f->args[i]);
    }
    /* the outermost block shares the scope of the arguments, so that neither hides the other by accident */
    if (f->body->kind == S_BLOCK) {
        check_attrs_before(c, f->body);
        check_stmts(c, f, f->body->stmts, f->body->nstmts);
    } else {
        check_stmt(c, f, f->body);
    }
    scope_close(c);
}
