/* Over the functions of a module as parsed, with the names that are local at every place. */
#include "compiler/front/glsl/glsl.h"

bool glsl_is_local(const GlslWalk *w, const char *name) {
    for (uint32_t i = w->locals.len; i-- > 0;)
        if (w->locals.data[i] == name) return true;
    return false;
}

void glsl_walk_expr(GlslWalk *w, Expr *e) {
    if (!e) return;
    w->visit(w, e);
    for (int i = 0; i < 3; i++) glsl_walk_expr(w, e->a[i]);
    for (uint32_t i = 0; i < e->nargs; i++) glsl_walk_expr(w, e->args[i]);
}

static void walk_stmt(GlslWalk *w, Stmt *st);

static void walk_list(GlslWalk *w, Stmt **list, uint32_t n) {
    for (uint32_t i = 0; i < n; i++) walk_stmt(w, list[i]);
}

static void walk_scope(GlslWalk *w, Stmt *st) {
    uint32_t outer = w->locals.len;
    walk_stmt(w, st);
    w->locals.len = outer;
}

static void walk_stmt(GlslWalk *w, Stmt *st) {
    if (!st) return;
    uint32_t outer = w->locals.len;
    bool scope = st->kind != S_DECL;
    for (uint32_t i = 0; i < st->ndecls; i++) {
        /* A name is not yet known in its own value. */
        if (st->decls[i]->type_ref)
            for (uint32_t d = 0; d < st->decls[i]->type_ref->ndims; d++)
                glsl_walk_expr(w, st->decls[i]->type_ref->dims[d]);
        glsl_walk_expr(w, st->decls[i]->init);
        vec_push(&w->p->s->module, &w->locals, st->decls[i]->name);
    }
    walk_stmt(w, st->init);
    glsl_walk_expr(w, st->expr);
    glsl_walk_expr(w, st->step);
    for (uint32_t i = 0; i < st->nargs; i++) glsl_walk_expr(w, st->args[i]);
    walk_scope(w, st->body);
    walk_scope(w, st->orelse);
    walk_list(w, st->stmts, st->nstmts);
    for (uint32_t i = 0; i < st->ncases; i++) {
        glsl_walk_expr(w, st->cases[i].label_expr);
        walk_list(w, st->cases[i].body, st->cases[i].nbody);
    }
    if (scope) w->locals.len = outer;
}

void glsl_walk(GlslWalk *w, Func *f) {
    w->func = f;
    w->locals.len = 0;
    for (uint32_t i = 0; i < f->nargs; i++) vec_push(&w->p->s->module, &w->locals, f->args[i]->name);
    walk_stmt(w, f->body);
}
