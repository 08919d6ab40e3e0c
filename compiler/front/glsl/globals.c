/* Variables at file scope. The language has none: a function that uses one, or calls one that does, gets it as a hidden
 * `inout` argument, and the entry declares it. All calls are inlined, so nothing of this is left in the program.
 *
 * Names are compared by their address: a hidden argument is called by a copy of the variable's name that is not
 * interned, so that no local variable can hide it. */
#include "compiler/front/glsl/glsl.h"

#include <string.h>

typedef struct Global {
    Symbol *sym;
    const char *hidden; /* the copy of its name */
    bool written;
} Global;

/* All functions of one name: what they and what they call use, a bit a global. */
typedef struct Uses {
    const char *name;
    uint64_t *bits;
    bool takes_places; /* some overload has an `out` argument */
    Vec(struct Uses *) calls;
} Uses;

typedef struct Globals {
    Global *list;
    uint32_t n, words;
    NameMap index; /* -> Global */
    NameMap funcs; /* -> Uses */
    Vec(Uses *) all;
    Uses *here;
} Globals;

static Expr *root(Expr *e) {
    while (e->kind == E_FIELD || e->kind == E_INDEX) e = e->a[0];
    return e;
}

static void mark_written(GlslWalk *w, const Globals *g, Expr *e) {
    e = root(e);
    Global *global = e->kind == E_NAME && !glsl_is_local(w, e->name) ? map_get(&g->index, e->name) : NULL;
    if (global) global->written = true;
}

static void find_writes(GlslWalk *w, Expr *e) {
    Globals *g = w->user;
    if (e->kind == E_ASSIGN || e->kind == E_INCDEC) mark_written(w, g, e->a[0]);
    if (e->kind != E_CALL) return;
    const Uses *u = map_get(&g->funcs, e->name);
    for (uint32_t i = 0; u && u->takes_places && i < e->nargs; i++) mark_written(w, g, e->args[i]);
}

static void fill(Parser *p, Globals *g) {
    Arena *a = &p->s->module;
    const SymbolVec *v = &p->unit->globals;
    *g = (Globals){.n = v->len, .words = v->len / 64 + 1, .list = ARENA_ARRAY(a, Global, v->len + 1)};
    for (uint32_t i = 0; i < v->len; i++) {
        Symbol *sym = v->data[i];
        g->list[i] = (Global){.sym = sym, .hidden = arena_strndup(a, sym->name, strlen(sym->name))};
        if (map_get(&g->index, sym->name)) diag_emit(p->s, DIAG_redeclared, sym->span, sym->name);
        map_put(a, &g->index, sym->name, &g->list[i]);
    }
    for (Func *f = p->module->funcs; f; f = f->next) {
        Uses *u = map_get(&g->funcs, f->name);
        if (!u) {
            u = ARENA_NEW(a, Uses);
            u->name = f->name;
            u->bits = ARENA_ARRAY(a, uint64_t, g->words);
            map_put(a, &g->funcs, f->name, u);
            vec_push(a, &g->all, u);
        }
        for (uint32_t i = 0; i < f->nargs; i++) u->takes_places |= f->args[i]->mode != ARG_IN;
    }
}

/* ---- constants */

typedef struct Constancy {
    const Globals *g;
    NameMap *known;
    bool constant;
} Constancy;

/* Literals, operators, constructors, builtins of the language, and constants before it. */
static void test_constant(GlslWalk *w, Expr *e) {
    Constancy *c = w->user;
    if (e->kind == E_NAME && !map_get(c->known, e->name)) c->constant = false;
    if (e->kind == E_CALL && (map_get(&c->g->funcs, e->name) || glsl_is_function_of_module(e->name)))
        c->constant = false;
    if (e->kind == E_METHOD || e->kind == E_ASSIGN || e->kind == E_INCDEC) c->constant = false;
}

void glsl_find_constants(Parser *p) {
    Globals g;
    Arena *a = &p->s->module;
    fill(p, &g);
    GlslWalk w = {.p = p, .visit = find_writes, .user = &g};
    for (Func *f = p->module->funcs; f; f = f->next) glsl_walk(&w, f);
    NameMap known = {0};
    for (Symbol *sym = p->module->consts; sym; sym = sym->next) map_put(a, &known, sym->name, sym);
    SymbolVec variables = {0};
    for (uint32_t i = 0; i < g.n; i++) {
        Symbol *sym = g.list[i].sym;
        Constancy c = {&g, &known, sym->init && !g.list[i].written};
        w = (GlslWalk){.p = p, .visit = test_constant, .user = &c};
        glsl_walk_expr(&w, sym->init);
        if (!c.constant) {
            sym->is_const = false;
            vec_push(a, &variables, sym);
            continue;
        }
        map_put(a, &known, sym->name, sym);
        sym->kind = SYM_CONST;
        sym->is_const = true;
        sym->value_span = sym->init->span;
        *p->consts_end = sym;
        p->consts_end = &sym->next;
    }
    p->unit->globals = variables;
}

/* ---- hidden arguments */

static void find_uses(GlslWalk *w, Expr *e) {
    Globals *g = w->user;
    if ((e->kind != E_NAME && e->kind != E_CALL) || glsl_is_local(w, e->name)) return;
    if (e->kind == E_NAME) {
        const Global *global = map_get(&g->index, e->name);
        if (!global) return;
        uint32_t k = (uint32_t)(global - g->list);
        g->here->bits[k / 64] |= (uint64_t)1 << (k % 64);
        e->name = global->hidden;
    } else {
        Uses *callee = map_get(&g->funcs, e->name);
        for (uint32_t i = 0; callee && i < g->here->calls.len; i++)
            if (g->here->calls.data[i] == callee) callee = NULL;
        if (callee) vec_push(&w->p->s->module, &g->here->calls, callee);
    }
}

static void close_over_calls(Globals *g) {
    for (bool changed = true; changed;) {
        changed = false;
        for (uint32_t i = 0; i < g->all.len; i++)
            for (uint32_t c = 0; c < g->all.data[i]->calls.len; c++)
                for (uint32_t k = 0; k < g->words; k++) {
                    uint64_t *to = &g->all.data[i]->bits[k], from = g->all.data[i]->calls.data[c]->bits[k];
                    changed |= (from & ~*to) != 0;
                    *to |= from;
                }
    }
}

static void pass_on(GlslWalk *w, Expr *e) {
    Globals *g = w->user;
    if (e->kind != E_CALL || glsl_is_local(w, e->name)) return;
    const Uses *u = map_get(&g->funcs, e->name);
    if (!u) return;
    Arena *a = &w->p->s->module;
    Vec(Expr *) args = {0};
    for (uint32_t i = 0; i < e->nargs; i++) vec_push(a, &args, e->args[i]);
    for (uint32_t k = 0; k < g->n; k++) {
        if (!(u->bits[k / 64] >> (k % 64) & 1)) continue;
        Expr *name = ARENA_NEW(a, Expr);
        *name =
            (Expr){.kind = E_NAME, .span = e->op_span, .op_span = e->op_span, .name = g->list[k].hidden, .depth = 1};
        vec_push(a, &args, name);
    }
    e->args = args.data;
    e->nargs = args.len;
}

static void take(Parser *p, const Globals *g, Func *f) {
    const Uses *u = map_get(&g->funcs, f->name);
    SymbolVec args = {0};
    for (uint32_t i = 0; i < f->nargs; i++) vec_push(&p->s->module, &args, f->args[i]);
    for (uint32_t k = 0; k < g->n; k++) {
        if (!(u->bits[k / 64] >> (k % 64) & 1)) continue;
        Symbol *arg = ARENA_NEW(&p->s->module, Symbol);
        *arg = (Symbol){.kind = SYM_ARG,
                        .name = g->list[k].hidden,
                        .span = g->list[k].sym->span,
                        .mode = ARG_INOUT,
                        .hidden = true,
                        .type_ref = g->list[k].sym->type_ref};
        vec_push(&p->s->module, &args, arg);
    }
    f->args = args.data;
    f->nargs = args.len;
}

/* All of them, at the start of the entry, in the order of the file. */
static void declare(Parser *p, const Globals *g, Func *entry) {
    Arena *a = &p->s->module;
    StmtVec body = {0};
    for (uint32_t k = 0; k < g->n; k++) {
        Symbol *sym = g->list[k].sym;
        sym->kind = SYM_LOCAL;
        Stmt *st = ARENA_NEW(a, Stmt);
        st->kind = S_DECL;
        st->span = sym->span;
        st->ndecls = 1;
        st->decls = ARENA_NEW(a, Symbol *);
        st->decls[0] = sym;
        vec_push(a, &body, st);
    }
    for (uint32_t i = 0; i < entry->body->nstmts; i++) vec_push(a, &body, entry->body->stmts[i]);
    entry->body->stmts = body.data;
    entry->body->nstmts = body.len;
}

void glsl_pass_globals(Parser *p, Func *entry) {
    Globals g;
    fill(p, &g);
    if (!g.n) return;
    declare(p, &g, entry);
    /* In the entry itself the variables are locals by their declarations, and these have the hidden names. */
    for (uint32_t k = 0; k < g.n; k++) g.list[k].sym->name = g.list[k].hidden;
    GlslWalk w = {.p = p, .visit = find_uses, .user = &g};
    for (Func *f = p->module->funcs; f; f = f->next) {
        g.here = map_get(&g.funcs, f->name);
        glsl_walk(&w, f);
    }
    close_over_calls(&g);
    w.visit = pass_on;
    for (Func *f = p->module->funcs; f; f = f->next) glsl_walk(&w, f);
    for (Func *f = p->module->funcs; f; f = f->next)
        if (f != entry) take(p, &g, f);
}
