/* What [Disc] covers.
 *
 * [Disc] marks the comparisons of floats and the jumping builtins written in the statement itself. If there are none,
 * the tag is in the wrong place, and the note shows the right one: the comparison that computed the value, in the
 * declaration or assignment of a local that the statement uses, or in a function that it calls.
 *
 * A function of the standard library that jumps (its statements without [NoDisc]) is like a jumping builtin: its places
 * are sites where the statement that calls it is tagged, and only there. */
#include "compiler/front/check/internal.h"

typedef struct Discs {
    Checker *c;
    Expr **source; /* by Symbol.id: the last comparison that went into it */
} Discs;

enum { JUMPS_UNKNOWN, JUMPS_ASKED, JUMPS_NO, JUMPS_YES }; /* FuncInfo.jumps */

static bool library_jumps(Checker *c, Func *f);

static bool is_float_value(const Type *t) { return t && scalar_kind(t) == T_FLOAT; }

/* A comparison with a boundary or a jumping builtin. */
static bool is_site(const Expr *e) {
    switch (e->kind) {
    case E_BINARY:
        if (!e->a[0]->type || !is_float_value(e->a[0]->type)) return false;
        return (e->op >= OPR_LT && e->op <= OPR_GE) || e->op == OPR_MOD;
    case E_ASSIGN: return e->op == OPR_MOD && is_float_value(e->a[0]->type);
    case E_CONVERT:
        return e->explicit_cast && is_float_value(e->a[0]->type) &&
               (scalar_kind(e->type) == T_INT || scalar_kind(e->type) == T_UINT);
    case E_BUILTIN:
        switch (e->builtin) {
        case B_floor:
        case B_frac:
        case B_ceil:
        case B_round:
        case B_trunc:
        case B_fmod:
        case B_step:
        case B_atan2:
        case B_refract: return true;
        case B_sign: return is_float_value(e->type);
        default: return false;
        }
    case E_METHOD: return methods[e->method].kind == METHOD_JUMPS;
    default: return false;
    }
}

/* A site, or a call of a function of the library that has one. */
static bool covers(Checker *c, const Expr *e) {
    return is_site(e) || (e->kind == E_CALL && e->func && library_jumps(c, e->func));
}

/* The expressions that belong to the statement itself. */
static void visit_own(Stmt *st, void (*f)(Expr *, void *), void *user) {
    for (uint32_t i = 0; i < st->ndecls; i++) visit_expr(st->decls[i]->init, f, user);
    if (st->init) visit_own(st->init, f, user);
    visit_expr(st->expr, f, user);
    visit_expr(st->step, f, user);
    for (uint32_t i = 0; i < st->nargs; i++) visit_expr(st->args[i], f, user);
}

typedef struct Cover {
    Discs *d;
    Expr *site, *equality;
    Expr *computed; /* the site elsewhere that computed a value used here */
    Func *called;   /* the function in which `computed` stands */
    bool error;
} Cover;

static void first_site(Expr *e, void *user) {
    Expr **found = user;
    if (!*found && is_site(e)) *found = e;
}

typedef struct Jumps {
    Checker *c;
    bool found;
} Jumps;

static void find_jump(Expr *e, void *user) {
    Jumps *j = user;
    j->found = j->found || covers(j->c, e);
}

static void find_jumps(Stmt *st, Jumps *j) {
    if (!st || j->found) return;
    if (!st->attrs.nodisc) visit_own(st, find_jump, j);
    find_jumps(st->body, j);
    find_jumps(st->orelse, j);
    for (uint32_t i = 0; i < st->nstmts; i++) find_jumps(st->stmts[i], j);
    for (uint32_t i = 0; i < st->ncases; i++)
        for (uint32_t k = 0; k < st->cases[i].nbody; k++) find_jumps(st->cases[i].body[k], j);
}

/* One that calls itself is an error elsewhere; here it only has to end. */
static bool library_jumps(Checker *c, Func *f) {
    if (!f->module->is_stdlib || !f->body || f->nodisc) return false;
    FuncInfo *info = func_info(c, f);
    if (info->jumps == JUMPS_UNKNOWN) {
        info->jumps = JUMPS_ASKED;
        Jumps j = {c, false};
        find_jumps(f->body, &j);
        info->jumps = j.found ? JUMPS_YES : JUMPS_NO;
        f->jumps = j.found;
    }
    return info->jumps == JUMPS_YES;
}

static void cover(Expr *e, void *user) {
    Cover *k = user;
    if (e->type && e->type->kind == T_ERROR) k->error = true;
    if (!k->site && covers(k->d->c, e)) k->site = e;
    if (e->kind == E_BINARY && (e->op == OPR_EQ || e->op == OPR_NE) && is_float_value(e->a[0]->type) && !k->equality)
        k->equality = e;
    if (k->computed) return;
    if (e->kind == E_NAME && e->sym && e->sym->kind == SYM_LOCAL) k->computed = k->d->source[e->sym->id];
    if (e->kind == E_CALL && e->func && e->func->body && !e->func->module->is_stdlib) {
        FuncInfo *info = func_info(k->d->c, e->func);
        if (!info->looked_for_site) visit_stmt(e->func->body, first_site, &info->first_site);
        info->looked_for_site = true;
        k->computed = info->first_site;
        if (k->computed) k->called = e->func;
    }
}

static void remember(Discs *d, Symbol *sym, Expr *value) {
    if (!sym || sym->kind != SYM_LOCAL || !value) return;
    Cover k = {.d = d};
    visit_expr(value, cover, &k);
    if (k.site) d->source[sym->id] = k.site;
    else if (k.computed) d->source[sym->id] = k.computed;
}

static void remember_assign(Expr *e, void *user) {
    if (e->kind == E_ASSIGN) remember(user, place_root(e->a[0]), e->a[1]);
}

static void check_tag(Discs *d, Stmt *st) {
    Session *s = d->c->s;
    Cover k = {.d = d};
    visit_own(st, cover, &k);
    if (k.equality) {
        diag_emit(s, DIAG_disc_equality, k.equality->op_span, k.equality->op == OPR_EQ ? "==" : "!=");
        return;
    }
    if (k.site || k.error) return;
    Diag *diag = diag_emit(s, DIAG_disc_empty, st->attrs.disc_span);
    if (k.called)
        diag_note(s, diag, k.computed->op_span, "the comparison is in `%s`: [Disc] belongs on the statement there",
                  k.called->name);
    else if (k.computed)
        diag_note(s, diag, k.computed->op_span, "the value was computed here: [Disc] belongs on this statement");
}

static void walk(Discs *d, Stmt *st) {
    if (!st) return;
    if (st->attrs.disc) check_tag(d, st);
    for (uint32_t i = 0; i < st->ndecls; i++) remember(d, st->decls[i], st->decls[i]->init);
    visit_expr(st->expr, remember_assign, d);
    walk(d, st->init);
    walk(d, st->body);
    walk(d, st->orelse);
    for (uint32_t i = 0; i < st->nstmts; i++) walk(d, st->stmts[i]);
    for (uint32_t i = 0; i < st->ncases; i++)
        for (uint32_t j = 0; j < st->cases[i].nbody; j++) walk(d, st->cases[i].body[j]);
}

void check_discs(Checker *c, Func *f) {
    if (!f->body) return;
    library_jumps(c, f);
    ArenaMark mark = arena_mark(&c->s->scratch);
    Discs d = {.c = c, .source = ARENA_ARRAY(&c->s->scratch, Expr *, f->nlocals + 1)};
    walk(&d, f->body);
    arena_reset(&c->s->scratch, mark);
}
