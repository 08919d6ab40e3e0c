/* A checked entry point becomes a Program: one Fn with every call inlined, and the tables around it. */
#include <string.h>

#include "compiler/front/gen/internal.h"
#include "saltus/mesh.h"

#define MAX_PARAM_NUMBERS ((uint64_t)1 << 30)

_Noreturn void gen_giveup(Lower *l) { longjmp(*l->giveup, 1); }

/* ---- types */

IrType gen_ir_type(const Type *t) { return t->kind == T_FLOAT ? TY_FLT : t->kind == T_BOOL ? TY_BOOL : TY_INT; }

typedef Vec(LeafType) Leaves;

static void add_leaves(Lower *l, Leaves *out, Type *t, uint32_t count, bool in_array) {
    switch (t->kind) {
    case T_VECTOR:
    case T_MATRIX:
        for (uint32_t i = 0; i < type_components(t); i++) add_leaves(l, out, t->elem, count, in_array);
        break;
    case T_ARRAY: add_leaves(l, out, t->elem, count * t->n, true); break;
    case T_STRUCT:
        for (uint32_t f = 0; f < t->nfields; f++) add_leaves(l, out, t->fields[f].type, count, in_array);
        break;
    case T_BOOL:
    case T_INT:
    case T_UINT:
    case T_FLOAT: {
        LeafType leaf = {gen_ir_type(t), in_array ? count : 0};
        vec_push(l->arena, out, leaf);
        break;
    }
    case T_ERROR:
    case T_VOID:
    case T_TEXTURE:
    case T_TEXTURE3D:
    case T_GEOMETRY: break;
    }
}

const Layout *gen_layout(Lower *l, Type *t) {
    Layout **slot = &l->layout_cache[((uintptr_t)t >> 4) & 255];
    if (*slot && (*slot)->type == t) return *slot;
    Leaves leaves = {0};
    add_leaves(l, &leaves, t, 1, false);
    Layout *n = ARENA_NEW(l->arena, Layout);
    n->type = t;
    n->n = leaves.len;
    n->leaf = leaves.data;
    for (uint32_t i = 0; i < leaves.len; i++) {
        uint32_t count = leaves.data[i].count ? leaves.data[i].count : 1;
        if (leaves.data[i].type == TY_FLT) n->nfloats += count;
        else n->nints += count;
    }
    return *slot = n;
}

/* ---- facts about functions, before anything is expanded */

typedef Vec(Func *) FuncList;
typedef struct Census {
    Lower *l;
    uint64_t own;
    bool rand;
    FuncList calls;
} Census;

static void census_expr(Census *c, const Expr *e) {
    if (!e || e->is_const) return;
    uint32_t n = e->type && e->type->kind <= T_MATRIX && e->type->kind > T_VOID ? type_components(e->type) : 1;
    switch (e->kind) {
    case E_UNARY:
    case E_BINARY:
    case E_LOGIC:
    case E_COND:
    case E_CONVERT:
    case E_INCDEC: c->own += n; break;
    case E_ASSIGN: c->own += e->op != OPR_NONE ? n : 0; break;
    case E_BUILTIN: c->own += 2 * (uint64_t)n; break;
    case E_METHOD: c->own += 24; break;
    default: break;
    }
    if (e->kind == E_BUILTIN) c->rand |= e->builtin == B_rand || e->builtin == B_rand2 || e->builtin == B_rand3;
    if (e->kind == E_CALL) vec_push(c->l->arena, &c->calls, e->func);
    for (uint32_t i = 0; i < 3; i++) census_expr(c, e->a[i]);
    for (uint32_t i = 0; i < e->nargs; i++) census_expr(c, e->args[i]);
}

static void census_stmt(Census *c, const Stmt *s) {
    if (!s) return;
    if (s->kind == S_IF && s->expr->is_const && s->expr->cval.n == 1) { /* decided already */
        census_stmt(c, s->expr->cval.v[0].i ? s->body : s->orelse);
        return;
    }
    census_expr(c, s->expr);
    census_expr(c, s->step);
    census_stmt(c, s->init);
    census_stmt(c, s->body);
    census_stmt(c, s->orelse);
    for (uint32_t i = 0; i < s->ndecls; i++) census_expr(c, s->decls[i]->init);
    for (uint32_t i = 0; i < s->nargs; i++)
        if (s->args[i]->type) census_expr(c, s->args[i]);
    for (uint32_t i = 0; i < s->nstmts; i++) census_stmt(c, s->stmts[i]);
    for (uint32_t k = 0; k < s->ncases; k++)
        for (uint32_t i = 0; i < s->cases[k].nbody; i++) census_stmt(c, s->cases[k].body[i]);
}

static FuncFacts **fact_slot(FuncFacts **table, uint32_t cap, const Func *f) {
    uint32_t h = (uint32_t)(((uintptr_t)f >> 4) * 0x9e3779b97f4a7c15u >> 32) & (cap - 1);
    while (table[h] && table[h]->func != f) h = (h + 1) & (cap - 1);
    return &table[h];
}

FuncFacts *gen_facts(Lower *l, Func *f) {
    if (l->fact_cap) {
        FuncFacts *known = *fact_slot(l->fact_table, l->fact_cap, f);
        if (known) return known;
    }
    FuncFacts *x = ARENA_NEW(l->arena, FuncFacts);
    x->func = f;
    Census c = {.l = l};
    census_stmt(&c, f->body);
    x->own = x->ops = c.own + 1;
    x->rand = c.rand;
    if (f->tangent) vec_push(l->arena, &c.calls, f->tangent);
    for (uint32_t i = 0; i < c.calls.len; i++) {
        FuncFacts *g = gen_facts(l, c.calls.data[i]);
        x->rand |= g->rand;
        x->ops = x->ops > UINT64_MAX / 2 - g->ops ? UINT64_MAX / 2 : x->ops + g->ops;
    }
    vec_push(l->arena, &l->facts, x);
    if (l->facts.len * 2 >= l->fact_cap) {
        uint32_t cap = l->fact_cap ? l->fact_cap * 2 : 64;
        FuncFacts **table = ARENA_ARRAY(l->arena, FuncFacts *, cap);
        for (uint32_t i = 0; i < l->facts.len; i++) *fact_slot(table, cap, l->facts.data[i]->func) = l->facts.data[i];
        l->fact_table = table, l->fact_cap = cap;
    } else {
        *fact_slot(l->fact_table, l->fact_cap, f) = x;
    }
    return x;
}

/* The call tree with counts: the functions that make most of it. */
static void note_calls(Lower *l, Diag *d) {
    uint32_t n = l->facts.len;
    if (!n) return;
    for (uint32_t i = 0; i < n; i++) l->facts.data[i]->copies = 0;
    l->facts.data[n - 1]->copies = 1; /* callees come before callers: the entry is last */
    for (uint32_t i = 0; i < n; i++)
        if (l->facts.data[i]->func == l->program->entry_func) l->facts.data[i]->copies = 1;
    for (uint32_t i = n; i-- > 0;) {
        FuncFacts *x = l->facts.data[i];
        if (!x->copies) continue;
        Census c = {.l = l};
        census_stmt(&c, x->func->body);
        for (uint32_t k = 0; k < c.calls.len; k++) {
            FuncFacts *g = gen_facts(l, c.calls.data[k]);
            g->copies = g->copies > UINT64_MAX / 2 - x->copies ? UINT64_MAX / 2 : g->copies + x->copies;
        }
    }
    for (uint32_t shown = 0; shown < 12 && shown < n; shown++) {
        FuncFacts *best = NULL;
        for (uint32_t i = n; i-- > 0;) {
            FuncFacts *x = l->facts.data[i];
            if (x->done || !x->copies) continue;
            if (!best || (double)x->copies * (double)x->own > (double)best->copies * (double)best->own) best = x;
        }
        if (!best) break;
        best->done = true;
        diag_note(l->s, d, best->func->name_span,
                  "`%s`: inlined %llu times, about %.0f operations of its own in all, %llu in each copy with its calls",
                  best->func->name, (unsigned long long)best->copies, (double)best->copies * (double)best->own,
                  (unsigned long long)best->ops);
    }
}

_Noreturn void gen_too_large(Lower *l, Span span) {
    if (span.file < 0) span = l->program->entry_func->name_span;
    Diag *d = diag_emit(l->s, DIAG_program_too_large, span, IR_MAX_OPS);
    if (l->frame) diag_note(l->s, d, span, "reached while inlining %s", gen_path(l));
    note_calls(l, d);
    gen_giveup(l);
}

/* ---- functions of their own: bounds of [Cull], initialisers */

static void start_fn(Lower *l, const char *name) {
    l->fn = ir_fn(l->s, l->arena, name, l->opt->precision);
    l->fn->dim = l->program->dim;
    l->fn->channels = l->program->channels;
    l->fn->nfloats = l->program->nfloats;
    l->fn->nints = l->program->nints;
    l->b = ir_at_end(l->fn, l->fn->body);
    l->b.fold = true;
    l->rand_counter = var_new(l, TY_INT, 1);
    l->rand_counter->born = 0;
    l->anchor = l->rand_counter->value = ki(l, 0);
}

Lower gen_fresh(Lower *l, const char *name) {
    Lower n = {.s = l->s,
               .arena = l->arena,
               .opt = l->opt,
               .program = l->program,
               .giveup = l->giveup,
               .quiet = true,
               .clock = 1,
               .fact_table = l->fact_table,
               .fact_cap = l->fact_cap};
    n.facts.data = l->facts.data, n.facts.len = l->facts.len, n.facts.cap = l->facts.cap;
    start_fn(&n, name);
    return n;
}

Fn *gen_function(Lower *outer, Func *f, const char *name, InputSlot arg, uint32_t first, uint32_t count) {
    Lower fresh = gen_fresh(outer, name), *l = &fresh;
    l->rand_counter->value = ki(l, 1); /* number 0 of a stream is the runtime's to give */
    Bind *binds = ARENA_ARRAY(l->arena, Bind, f->nargs + 1);
    for (uint32_t i = 0; i < f->nargs; i++) {
        Var *v = var_new(l, TY_INT, 1);
        v->value = ir_input(&l->b, (InputSlot)(arg + i));
        binds[i] = (Bind){.kind = BIND_VARS, .vars = v};
    }
    Val v = gen_inline(l, f, binds, f->name_span);
    const Layout *layout = gen_layout(l, f->ret);
    Vec(Inst *) all = {0};
    for (uint32_t i = 0; i < layout->n; i++) {
        if (!layout->leaf[i].count) {
            vec_push(l->arena, &all, v.c[i]);
            continue;
        }
        for (uint32_t k = 0; k < layout->leaf[i].count; k++) {
            Inst *get[2] = {v.c[i], ki(l, k)};
            vec_push(l->arena, &all, special(l, OP_load, layout->leaf[i].type, 2, get, (Imm){0}));
        }
    }
    if (first > all.len) first = all.len;
    if (count > all.len - first) count = all.len - first;
    ir_yield(&l->b, count, all.data + first);
    gen_prune_loops(l);
    return l->fn;
}

/* ---- parameters */

void gen_reserve(Lower *l, uint32_t *n, uint64_t more, Span span) {
    if (*n + more > MAX_PARAM_NUMBERS) {
        diag_emit(l->s, DIAG_too_many_params, span);
        gen_giveup(l);
    }
    *n += (uint32_t)more;
}

static void collect_params(Lower *l, Module *main) {
    Program *p = l->program;
    uint32_t n = 0;
    for (const Module *m = main; m; m = m->next)
        for (const Symbol *s = m->params; s; s = s->next) n++;
    p->params = ARENA_ARRAY(l->arena, Param, n + 1);
    for (Module *m = main; m; m = m->next)
        for (Symbol *s = m->params; s; s = s->next) {
            Param *q = &p->params[p->nparams];
            s->param_index = p->nparams++;
            q->name = s->doc_name  ? s->doc_name
                      : m->is_main ? s->name
                                   : arena_printf(l->arena, "%s.%s", m->name, s->name);
            q->type = s->type;
            q->sym = s;
            q->attrs = s->attrs;
            q->is_texture = type_is_texture(s->type);
            q->is_geometry = s->type->kind == T_GEOMETRY;
            q->is_mesh = type_is_mesh(s->type);
            if (q->is_mesh) q->type = type_array(l->s, type_vector(l->s, T_FLOAT, 3), s->nvertices);
            q->asset = s->asset;
            uint64_t nf, ni = 0;
            if (q->is_texture || (q->is_geometry && !q->is_mesh)) {
                q->tex_w = s->tex_w, q->tex_h = s->tex_h, q->tex_d = s->tex_d, q->tex_c = s->tex_c;
                nf = (uint64_t)q->tex_w * q->tex_h * (q->tex_d ? q->tex_d : 1) * q->tex_c;
            } else {
                const Layout *layout = gen_layout(l, q->type);
                nf = layout->nfloats, ni = layout->nints;
            }
            q->fbase = p->nfloats, q->fcount = (uint32_t)nf;
            q->ibase = p->nints, q->icount = (uint32_t)ni;
            gen_reserve(l, &p->nfloats, nf, s->span);
            gen_reserve(l, &p->nints, ni, s->span);
            q->differentiable = nf > 0 && !s->attrs.nodiff;
        }
    const uint32_t own = p->nints;
    for (uint32_t i = 0; i < p->nparams; i++) {
        Param *q = &p->params[i];
        if (!q->is_mesh) continue;
        uint64_t n = SLT_MESH_TOPOLOGY(q->sym->nfaces, q->sym->has_uv);
        q->tbase = p->nints, q->tcount = (uint32_t)n;
        gen_reserve(l, &p->nints, n, q->sym->span);
    }
    p->ntopology = p->nints - own;
}

/* ---- the program */

static void gen_entry(Lower *l, Func *entry) {
    Program *p = l->program;
    if (gen_facts(l, entry)->ops > 4 * (uint64_t)IR_MAX_OPS) gen_too_large(l, entry->name_span);
    start_fn(l, entry->name);
    Bind bind = {.kind = BIND_VARS, .vars = var_new(l, TY_FLT, p->dim)};
    for (uint32_t d = 0; d < p->dim; d++) bind.vars[d].value = ir_input(&l->b, (InputSlot)(IN_X0 + d));
    Val v = gen_inline(l, entry, &bind, entry->name_span);
    ir_yield(&l->b, v.n, v.c);
    ir_name_outputs(l->fn, SLT_OUT_F);
    l->fn->sites = l->sites.data;
    l->fn->nsites = l->sites.len;
    gen_geometry_finish(l);
    gen_derived_finish(l);
    p->geometries = l->geometries.data;
    p->ngeometries = l->geometries.len;
    p->untracked = l->untracked.data;
    p->nuntracked = l->untracked.len;
    p->silenced = l->silenced.data, p->nsilenced = l->silenced.len;
    gen_prune_loops(l);
    ir_require(l->fn, "lowering");
    p->primal = l->fn;
    p->uses_rand = gen_facts(l, entry)->rand;
    p->ncull = l->culls.len;
    p->cull_bounds = l->culls.data;
    gen_initial_values(l);
}

Program *gen_program(Session *s, Module *main, Func *entry, const ProgramOptions *opt) {
    Lower *l = ARENA_NEW(&s->module, Lower);
    jmp_buf giveup;
    l->s = s;
    l->arena = &s->module;
    l->opt = opt;
    l->clock = 1;
    l->giveup = &giveup;
    Program *p = l->program = ARENA_NEW(l->arena, Program);
    p->session = s;
    p->entry = entry->name;
    p->entry_func = entry;
    p->display = entry->display;
    p->is_glsl = main->glsl;
    p->dim = entry->dim;
    p->channels = type_components(entry->ret);
    for (int i = 0; i < 3; i++)
        p->lo[i] = entry->has_domain ? entry->lo[i] : 0, p->hi[i] = entry->has_domain ? entry->hi[i] : 1;
    if (setjmp(giveup)) return NULL;
    collect_params(l, main);
    gen_entry(l, entry);
    return p;
}
