/* Which name stands where: one walk over the checked tree. */
#include <string.h>

#include "cli/lsp/lsp.h"

typedef struct Walk {
    Analysis *a;
    Names out;
    Module *module;
} Walk;

static void add(Walk *w, Name n) {
    if (n.span.file >= 0 && n.span.len) vec_push(&w->a->s->session, &w->out, n);
}

static const StructDecl *struct_named(const Module *m, const char *name) {
    for (const StructDecl *d = m->struct_decls; d; d = d->next)
        if (d->name == name) return d;
    for (uint32_t i = 0; i < m->nimports; i++)
        for (const StructDecl *d = m->imports[i].module->struct_decls; d; d = d->next)
            if (d->name == name) return d;
    return NULL;
}

static const TypedefDecl *typedef_named(const Module *m, const char *name) {
    for (const TypedefDecl *d = m->typedefs; d; d = d->next)
        if (d->name == name) return d;
    for (uint32_t i = 0; i < m->nimports; i++)
        for (const TypedefDecl *d = m->imports[i].module->typedefs; d; d = d->next)
            if (d->name == name) return d;
    return NULL;
}

static void type_name(Walk *w, const char *text, Span span, Expr *e) {
    if (!text) return;
    Name n = {.kind = NAME_TYPE, .span = span, .text = text, .expr = e};
    n.structure = struct_named(w->module, text);
    n.type_def = n.structure ? NULL : typedef_named(w->module, text);
    if (n.structure) n.kind = NAME_STRUCT, n.type = n.structure->type;
    if (n.type_def) n.kind = NAME_TYPEDEF, n.type = n.type_def->type;
    add(w, n);
}

static void expr(Walk *w, Expr *e);

static void type_ref(Walk *w, const TypeRef *t) {
    if (!t) return;
    type_name(w, t->name, t->span, NULL);
    for (uint32_t i = 0; i < t->ndims; i++) expr(w, t->dims[i]);
}

static void expr(Walk *w, Expr *e) {
    if (!e) return;
    Name n = {.kind = NAME_VALUE, .span = e->op_span, .text = e->name, .type = e->type, .expr = e};
    switch (e->kind) {
    case E_NAME:
        n.kind = NAME_SYMBOL, n.span = e->span, n.sym = e->sym;
        if (n.sym) add(w, n);
        break;
    case E_CALL:
        n.kind = NAME_FUNC, n.func = e->func;
        if (n.func) add(w, n);
        break;
    case E_BUILTIN:
        n.kind = NAME_BUILTIN, n.builtin = e->builtin;
        add(w, n);
        break;
    case E_METHOD:
        n.kind = NAME_METHOD, n.method = e->method;
        if (e->type && e->type->kind != T_ERROR) add(w, n);
        break;
    case E_FIELD:
        n.kind = NAME_FIELD, n.owner = e->a[0]->type, n.field = e->field;
        if (!n.owner) break;
        if (n.owner->kind != T_STRUCT || !e->type || e->type->kind == T_ERROR || n.field >= n.owner->nfields)
            n.kind = NAME_UNKNOWN;
        add(w, n);
        break;
    case E_CONSTRUCT: type_name(w, e->name, e->op_span, e); break;
    case E_LITERAL:
        n.span = e->span;
        add(w, n);
        break;
    case E_CONVERT: /* nobody wrote it, or a cast */
    case E_BROADCAST:
    case E_LIST:
    case E_ERROR: break;
    default: add(w, n);
    }
    for (int i = 0; i < 3; i++) expr(w, e->a[i]);
    for (uint32_t i = 0; i < e->nargs; i++) expr(w, e->args[i]);
}

static void symbol(Walk *w, Symbol *s) {
    type_ref(w, s->type_ref);
    add(w, (Name){.kind = NAME_SYMBOL, .span = s->span, .declares = true, .text = s->name, .sym = s, .type = s->type});
    expr(w, s->init);
    for (uint32_t i = 0; i < s->nzeros_args; i++) expr(w, s->zeros_args[i]);
    for (int i = 0; i < 2; i++) expr(w, s->attrs.range_args[i]), expr(w, s->attrs.height_args[i]);
    for (int i = 0; i < 4; i++) expr(w, s->attrs.extent_args[i]);
    if (s->init_func)
        add(w, (Name){.kind = NAME_FUNC, .span = s->value_span, .text = s->init_name, .func = s->init_func});
    if (s->place)
        add(w, (Name){.kind = NAME_FUNC, .span = s->attrs.vertex_span, .text = s->attrs.vertex_name, .func = s->place});
}

static void stmt(Walk *w, Stmt *s) {
    if (!s) return;
    expr(w, s->attrs.max_iters);
    if (s->attrs.cull)
        add(w,
            (Name){.kind = NAME_FUNC, .span = s->attrs.cull_span, .text = s->attrs.cull_name, .func = s->attrs.cull});
    stmt(w, s->init);
    for (uint32_t i = 0; i < s->ndecls; i++) symbol(w, s->decls[i]);
    expr(w, s->expr);
    expr(w, s->step);
    for (uint32_t i = 0; i < s->nargs; i++) expr(w, s->args[i]);
    stmt(w, s->body);
    stmt(w, s->orelse);
    for (uint32_t i = 0; i < s->nstmts; i++) stmt(w, s->stmts[i]);
    for (uint32_t i = 0; i < s->ncases; i++) {
        expr(w, s->cases[i].label_expr);
        for (uint32_t k = 0; k < s->cases[i].nbody; k++) stmt(w, s->cases[i].body[k]);
    }
}

static void function(Walk *w, Func *f) {
    type_ref(w, f->ret_ref);
    add(w, (Name){.kind = NAME_FUNC, .span = f->name_span, .declares = true, .text = f->name, .func = f});
    for (uint32_t i = 0; i < f->nargs; i++) symbol(w, f->args[i]);
    if (f->tangent)
        add(w, (Name){.kind = NAME_FUNC, .span = f->tangent_span, .text = f->tangent_name, .func = f->tangent});
    expr(w, f->domain_lo);
    expr(w, f->domain_hi);
    stmt(w, f->body);
}

static void module(Walk *w, Module *m) {
    w->module = m;
    for (uint32_t i = 0; i < m->nimports; i++)
        add(w, (Name){.kind = NAME_MODULE,
                      .span = m->imports[i].span,
                      .text = m->imports[i].name,
                      .module = m->imports[i].module});
    for (const StructDecl *d = m->struct_decls; d; d = d->next) {
        add(w, (Name){.kind = NAME_STRUCT,
                      .span = d->span,
                      .declares = true,
                      .text = d->name,
                      .structure = d,
                      .type = d->type});
        for (uint32_t i = 0; i < d->nfields; i++) {
            type_ref(w, d->fields[i].type_ref);
            bool known = d->type && d->type->kind == T_STRUCT && i < d->type->nfields;
            add(w, (Name){.kind = NAME_FIELD,
                          .span = d->fields[i].span,
                          .declares = true,
                          .text = d->fields[i].name,
                          .owner = d->type,
                          .type = known ? d->type->fields[i].type : NULL,
                          .field = i});
        }
    }
    for (const TypedefDecl *d = m->typedefs; d; d = d->next) {
        type_ref(w, d->type_ref);
        add(w, (Name){.kind = NAME_TYPEDEF,
                      .span = d->span,
                      .declares = true,
                      .text = d->name,
                      .type_def = d,
                      .type = d->type});
    }
    for (Symbol *s = m->consts; s; s = s->next) symbol(w, s);
    for (Symbol *s = m->params; s; s = s->next) symbol(w, s);
    for (Func *f = m->funcs; f; f = f->next) function(w, f);
}

Names names_of(Analysis *a, bool imports_too) {
    Walk w = {.a = a};
    for (Module *m = a->main; m; m = imports_too ? m->next : NULL)
        if (!m->glsl) module(&w, m); /* whose tokens may come from macros */
    return w.out;
}

const Name *name_at(const Analysis *a, const Names *names, uint32_t offset) {
    const Name *best = NULL;
    for (uint32_t i = 0; i < names->len; i++) {
        const Name *n = &names->data[i];
        if (n->span.file != a->file || offset < n->span.pos || offset > n->span.pos + n->span.len) continue;
        /* At the border of two the one that begins, unless only the other is a name. */
        bool named = n->kind != NAME_VALUE, best_named = best && best->kind != NAME_VALUE;
        if (!best || (named && !best_named) ||
            (named == best_named && (n->span.len < best->span.len || n->span.pos > best->span.pos)))
            best = n;
    }
    return best;
}

Span name_declared(const Name *n) {
    switch (n->kind) {
    case NAME_SYMBOL: return n->sym->span;
    case NAME_FUNC: return n->func->name_span;
    case NAME_STRUCT: return n->structure->span;
    case NAME_TYPEDEF: return n->type_def->span;
    case NAME_FIELD: return n->owner && n->field < n->owner->nfields ? n->owner->fields[n->field].span : SPAN_NONE;
    case NAME_MODULE: return n->module->missing ? SPAN_NONE : (Span){n->module->file, 0, 0};
    default: return SPAN_NONE;
    }
}

bool name_same(const Name *a, const Name *b) {
    if (a->kind != b->kind) return false;
    switch (a->kind) {
    case NAME_SYMBOL: return a->sym == b->sym;
    case NAME_FUNC: return a->func == b->func;
    case NAME_STRUCT: return a->structure == b->structure;
    case NAME_TYPEDEF: return a->type_def == b->type_def;
    case NAME_FIELD: return a->owner == b->owner && a->field == b->field;
    case NAME_BUILTIN: return a->builtin == b->builtin;
    case NAME_METHOD: return a->method == b->method;
    case NAME_MODULE: return a->module == b->module;
    case NAME_TYPE: return a->text == b->text;
    case NAME_VALUE:
    case NAME_UNKNOWN: return false;
    }
    return false;
}
