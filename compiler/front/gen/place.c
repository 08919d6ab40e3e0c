/* What can be named in parts: variables and their arrays, and parameters.
 *
 * A Place is followed outside in: arrays add to a flattened index (clamped in every dimension, without code where the
 * index is known to be inside), fields move the first leaf, and vectors and matrices end in a choice of components.
 * Parameters are read where they lie and never copied. */
#include <string.h>

#include "compiler/front/gen/internal.h"

static Place whole_place(Place p) {
    p.ncomp = 0;
    return p;
}

Place place_of_vars(Type *t, Var *vars) { return whole_place((Place){.kind = PLACE_VARS, .type = t, .vars = vars}); }

Bind *gen_bind(Lower *l, const Symbol *sym) {
    if (!l->frame || sym->id >= l->frame->func->nlocals) ice(l->s, "no place for `%s`", sym->name);
    return &l->frame->bind[sym->id];
}

Symbol *gen_resource(Lower *l, const Expr *e) {
    if (e->kind != E_NAME) ice(l->s, "a resource is not a name");
    if (e->sym->kind == SYM_PARAM) return e->sym;
    Bind *b = gen_bind(l, e->sym);
    if (b->kind != BIND_RESOURCE) ice(l->s, "`%s` is no resource", e->sym->name);
    return b->resource;
}

bool gen_is_place(const Expr *e) {
    switch (e->kind) {
    case E_NAME: return true;
    case E_FIELD:
    case E_SWIZZLE:
    case E_INDEX: return gen_is_place(e->a[0]);
    default: return false;
    }
}

/* ---- constant arrays: memory filled once at the top of the Fn */

static Var *const_array(Lower *l, Symbol *sym) {
    for (uint32_t i = 0; i < l->const_arrays.len; i++)
        if (l->const_arrays.data[i].sym == sym) return l->const_arrays.data[i].vars;
    Builder saved = l->b;
    uint32_t clock = l->clock;
    l->b = ir_after(l->fn, l->anchor);
    l->b.fold = true;
    Expr *list = sym->array_init ? sym->array_init : sym->init;
    Var *vars = vars_for(l, sym->type);
    for (uint32_t i = 0; i < gen_layout(l, sym->type)->n; i++) vars[i].born = 0;
    Val v = gen_expr(l, list);
    for (uint32_t i = 0; i < v.n; i++) vars[i].value = v.c[i]; /* E_LIST makes fresh arrays */
    l->clock = clock + 1;
    l->b = saved;
    vec_push(l->arena, &l->const_arrays, ((ConstArray){sym, vars}));
    return vars;
}

/* ---- following a place */

static uint32_t field_leaf(Lower *l, Type *t, uint32_t field) {
    uint32_t at = 0;
    for (uint32_t f = 0; f < field; f++) at += gen_layout(l, t->fields[f].type)->n;
    return at;
}

static void select_components(Place *p, Type *t, const uint8_t *comp, uint32_t n) {
    uint8_t out[16];
    for (uint32_t j = 0; j < n; j++) out[j] = p->selected ? p->comp[comp[j]] : comp[j];
    memcpy(p->comp, out, n);
    p->ncomp = (uint8_t)n;
    p->selected = true;
    p->type = t;
}

/* v[i] and m[r]: a constant picks components; else dyn. */
static void index_components(Lower *l, Place *p, Type *t, Inst *index, bool is_unsigned) {
    Type *from = p->type;
    uint32_t n = from->n, each = from->kind == T_MATRIX ? from->columns : 1;
    if (index->op == OP_consti) {
        int64_t i = is_unsigned ? (int64_t)(uint32_t)index->imm.i : index->imm.i;
        uint32_t at = i < 0 ? 0 : i >= n ? n - 1 : (uint32_t)i;
        uint8_t comp[4];
        for (uint32_t j = 0; j < each; j++) comp[j] = (uint8_t)(at * each + j);
        select_components(p, t, comp, each);
        return;
    }
    index = clamp_index(l, index, is_unsigned, n);
    if (p->selected && from->kind == T_VECTOR) {
        if (p->dyn) {
            for (uint32_t j = 1; j < n; j++) /* a row of a matrix is in order unless it was swizzled */
                if (p->comp[j] != p->comp[0] + j)
                    session_limit(l->s,
                                  "a swizzle of a matrix row that is chosen at run time cannot be indexed at run time");
        } else {
            p->permuted = true;
            memcpy(p->perm, p->comp, n);
        }
    }
    uint8_t comp[4];
    for (uint32_t j = 0; j < each; j++) comp[j] = (uint8_t)j;
    if (p->dyn) { /* a row was chosen already: rows lie dyn_step apart */
        p->dyn = op2(l, OP_iadd, op2(l, OP_imul, p->dyn, ki(l, n)), index);
        p->dyn_count *= n;
        p->dyn_step = 1;
    } else {
        p->dyn = index;
        p->dyn_count = n;
        p->dyn_step = each;
    }
    select_components(p, t, comp, each);
}

static void index_array(Lower *l, Place *p, Type *t, Inst *index, bool is_unsigned) {
    uint32_t n = p->type->n;
    if (p->kind == PLACE_VARS) {
        bool last = !p->index && t->kind != T_ARRAY && t->kind != T_STRUCT && !is_unsigned;
        if (!last) index = clamp_index(l, index, is_unsigned, n); /* of the last one, load and store do the clamping */
        p->index = p->index ? op2(l, OP_iadd, op2(l, OP_imul, p->index, ki(l, n)), index) : index;
    } else {
        const Layout *e = gen_layout(l, t);
        if (index->op == OP_consti) {
            int64_t i = is_unsigned ? (int64_t)(uint32_t)index->imm.i : index->imm.i;
            uint32_t at = i < 0 ? 0 : i >= n ? n - 1 : (uint32_t)i;
            p->foff += at * e->nfloats;
            p->ioff += at * e->nints;
        } else {
            index = clamp_index(l, index, is_unsigned, n);
            if (e->nfloats) {
                Inst *d = op2(l, OP_imul, index, ki(l, e->nfloats));
                p->fdyn = p->fdyn ? op2(l, OP_iadd, p->fdyn, d) : d;
                p->fspan += (n - 1) * e->nfloats;
            }
            if (e->nints) {
                Inst *d = op2(l, OP_imul, index, ki(l, e->nints));
                p->idyn = p->idyn ? op2(l, OP_iadd, p->idyn, d) : d;
                p->ispan += (n - 1) * e->nints;
            }
        }
    }
    p->type = t;
}

Place gen_place(Lower *l, Expr *e) {
    Place p;
    switch (e->kind) {
    case E_NAME: {
        Symbol *sym = e->sym;
        if (sym->kind == SYM_PARAM) return (Place){.kind = PLACE_PARAM, .type = sym->type, .param = sym};
        if (sym->kind == SYM_CONST) return place_of_vars(sym->type, const_array(l, sym));
        Bind *b = gen_bind(l, sym);
        if (b->kind == BIND_PLACE) return b->place;
        if (b->kind != BIND_VARS) ice(l->s, "`%s` has no value here", sym->name);
        return place_of_vars(sym->type, b->vars);
    }
    case E_FIELD: {
        Type *t = e->a[0]->type;
        p = gen_place(l, e->a[0]);
        if (p.kind == PLACE_VARS) {
            p.vars += field_leaf(l, t, e->field);
        } else {
            for (uint32_t f = 0; f < e->field; f++) {
                p.foff += gen_layout(l, t->fields[f].type)->nfloats;
                p.ioff += gen_layout(l, t->fields[f].type)->nints;
            }
        }
        p.type = e->type;
        return p;
    }
    case E_SWIZZLE: {
        p = gen_place(l, e->a[0]);
        select_components(&p, e->type, e->swz, e->nswz);
        return p;
    }
    case E_INDEX: {
        p = gen_place(l, e->a[0]);
        Inst *index = gen_scalar(l, e->a[1]);
        bool is_unsigned = e->a[1]->type->kind == T_UINT;
        if (e->a[0]->type->kind == T_ARRAY) index_array(l, &p, e->type, index, is_unsigned);
        else index_components(l, &p, e->type, index, is_unsigned);
        return p;
    }
    default: ice(l->s, "not a place");
    }
}

/* ---- reading */

static Inst *read_slice(Lower *l, Op op, IrType t, uint32_t base, Inst *dyn, uint32_t span) {
    Imm imm = {.slot = {base, span + 1}};
    if (!dyn) dyn = ki(l, 0), imm.slot.count = 1;
    return special(l, op, t, 1, &dyn, imm);
}

Inst *slice_float(Lower *l, uint32_t base, Inst *dyn, uint32_t span) {
    return read_slice(l, OP_param, TY_FLT, base, dyn, span);
}

Inst *slice_int(Lower *l, uint32_t base, Inst *dyn, uint32_t span) {
    return read_slice(l, OP_iparam, TY_INT, base, dyn, span);
}

Inst *param_float(Lower *l, const Symbol *sym, uint32_t offset, Inst *dyn, uint32_t span) {
    return slice_float(l, l->program->params[sym->param_index].fbase + offset, dyn, span);
}

Inst *param_int(Lower *l, const Symbol *sym, uint32_t offset, Inst *dyn, uint32_t span, IrType t) {
    const Param *p = &l->program->params[sym->param_index];
    Inst *i = slice_int(l, (p->is_mesh ? p->tbase : p->ibase) + offset, dyn, span);
    return t == TY_BOOL ? op2(l, OP_ine, i, ki(l, 0)) : i;
}

/* A value in a parameter: scalars in order of declaration; arrays inside are copied into fresh memory. */
typedef struct ParamReader {
    const Place *p;
    uint32_t foff, ioff;
    Val *out;
    uint32_t at; /* leaf */
} ParamReader;

static Inst *read_param(Lower *l, ParamReader *r, IrType t) {
    const Place *p = r->p;
    return t == TY_FLT ? param_float(l, p->param, r->foff++, p->fdyn, p->fspan)
                       : param_int(l, p->param, r->ioff++, p->idyn, p->ispan, t);
}

static void read_param_type(Lower *l, ParamReader *r, Type *t, uint32_t element, bool in_array);

static void put(Lower *l, ParamReader *r, Inst *v, uint32_t element, bool in_array) {
    if (!in_array) {
        r->out->c[r->at++] = v;
    } else {
        Inst *args[3] = {r->out->c[r->at++], ki(l, element), v};
        special(l, OP_store, TY_VOID, 3, args, (Imm){0});
    }
}

static void read_param_type(Lower *l, ParamReader *r, Type *t, uint32_t element, bool in_array) {
    switch (t->kind) {
    case T_VECTOR:
    case T_MATRIX: {
        uint32_t n = type_components(t);
        for (uint32_t i = 0; i < n; i++) put(l, r, read_param(l, r, gen_ir_type(t->elem)), element, in_array);
        break;
    }
    case T_ARRAY: {
        uint32_t at = r->at;
        for (uint32_t i = 0; i < t->n; i++) {
            r->at = at;
            read_param_type(l, r, t->elem, element * t->n + i, true);
        }
        break;
    }
    case T_STRUCT:
        for (uint32_t f = 0; f < t->nfields; f++) read_param_type(l, r, t->fields[f].type, element, in_array);
        break;
    default: put(l, r, read_param(l, r, gen_ir_type(t)), element, in_array);
    }
}

/* Where the components of a place with a dynamic component index come from. */
static Inst *choose(Lower *l, Inst *dyn, Inst *const *options, uint32_t n) {
    Inst *v = options[n - 1];
    for (uint32_t i = n - 1; i-- > 0;) v = sel(l, op2(l, OP_ieq, dyn, ki(l, i)), options[i], v);
    return v;
}

static Inst *load_leaf(Lower *l, const Place *p, uint32_t leaf) {
    Var *v = &p->vars[leaf];
    if (!p->index) return var_get(l, v);
    Inst *args[2] = {v->value, p->index};
    return special(l, OP_load, (IrType)v->value->imm.arr.elem, 2, args, (Imm){0});
}

/* The leaf of result component j when dyn is i. */
static uint32_t dyn_leaf(const Place *p, uint32_t j, uint32_t i) {
    return p->permuted ? p->perm[i] : p->comp[j] + i * p->dyn_step;
}

static Val load_components(Lower *l, const Place *p) {
    Val out = val_new(l, p->type);
    for (uint32_t j = 0; j < p->ncomp; j++) {
        if (p->kind == PLACE_PARAM) {
            Place q = *p;
            IrType t = gen_ir_type(scalar_of(p->type));
            ParamReader r = {.p = &q,
                             .foff = q.foff + (t == TY_FLT ? p->comp[j] : 0),
                             .ioff = q.ioff + (t == TY_FLT ? 0 : p->comp[j])};
            if (p->dyn) {
                Inst *d = op2(l, OP_imul, p->dyn, ki(l, p->dyn_step));
                uint32_t span = (p->dyn_count - 1) * p->dyn_step;
                if (t == TY_FLT) q.fdyn = q.fdyn ? op2(l, OP_iadd, q.fdyn, d) : d, q.fspan += span;
                else q.idyn = q.idyn ? op2(l, OP_iadd, q.idyn, d) : d, q.ispan += span;
            }
            out.c[j] = read_param(l, &r, t);
        } else if (p->dyn) {
            Inst *options[16];
            for (uint32_t i = 0; i < p->dyn_count; i++) options[i] = load_leaf(l, p, dyn_leaf(p, j, i));
            out.c[j] = choose(l, p->dyn, options, p->dyn_count);
        } else {
            out.c[j] = load_leaf(l, p, p->comp[j]);
        }
    }
    return out;
}

/* `count` elements from index*count of array `from`, or all of it: a fresh array. */
static Inst *copy_array(Lower *l, Inst *from, Inst *index, const LeafType *leaf) {
    Inst *to = alloc_array(l, leaf->type, leaf->count);
    if (!index) {
        Inst *args[2] = {to, from};
        special(l, OP_acopy, TY_VOID, 2, args, (Imm){0});
        return to;
    }
    Inst *base = op2(l, OP_imul, index, ki(l, leaf->count));
    LoopInfo info = {.max_iters = leaf->count, .exact = true};
    LoopCtx c = {0};
    VarList none = {0};
    Inst *k = NULL;
    loop_begin(l, &c, &none, info);
    k = c.k;
    Inst *get[2] = {from, op2(l, OP_iadd, base, k)};
    Inst *put_args[3] = {to, k, special(l, OP_load, leaf->type, 2, get, (Imm){0})};
    special(l, OP_store, TY_VOID, 3, put_args, (Imm){0});
    loop_end(l, &c, op2(l, OP_ilt, k, ki(l, (int64_t)leaf->count - 1)));
    return to;
}

Val place_load(Lower *l, const Place *p) {
    if (p->selected) return load_components(l, p);
    const Layout *layout = gen_layout(l, p->type);
    Val out = val_new(l, p->type);
    if (p->kind == PLACE_PARAM) {
        for (uint32_t i = 0; i < layout->n; i++)
            if (layout->leaf[i].count) out.c[i] = alloc_array(l, layout->leaf[i].type, layout->leaf[i].count);
        ParamReader r = {.p = p, .foff = p->foff, .ioff = p->ioff, .out = &out};
        read_param_type(l, &r, p->type, 0, false);
        return out;
    }
    for (uint32_t i = 0; i < layout->n; i++)
        if (!layout->leaf[i].count) out.c[i] = load_leaf(l, p, i);
        else if (p->index) out.c[i] = copy_array(l, p->vars[i].value, p->index, &layout->leaf[i]);
        else out.c[i] = p->vars[i].value; /* the array is shared: whoever keeps the value copies it */
    return out;
}

/* ---- writing */

static void store_leaf(Lower *l, const Place *p, uint32_t leaf, Inst *v) {
    Var *var = &p->vars[leaf];
    if (!p->index) {
        var_set(l, var, v);
    } else {
        Inst *args[3] = {var->value, p->index, v};
        special(l, OP_store, TY_VOID, 3, args, (Imm){0});
    }
}

static void store_array(Lower *l, Inst *to, Inst *index, Inst *from, const LeafType *leaf) {
    if (!index) {
        if (to == from) return;
        Inst *args[2] = {to, from};
        special(l, OP_acopy, TY_VOID, 2, args, (Imm){0});
        return;
    }
    Inst *base = op2(l, OP_imul, index, ki(l, leaf->count));
    LoopCtx c = {0};
    VarList none = {0};
    loop_begin(l, &c, &none, (LoopInfo){.max_iters = leaf->count, .exact = true});
    Inst *k = c.k;
    Inst *get[2] = {from, k};
    Inst *put_args[3] = {to, op2(l, OP_iadd, base, k), special(l, OP_load, leaf->type, 2, get, (Imm){0})};
    special(l, OP_store, TY_VOID, 3, put_args, (Imm){0});
    loop_end(l, &c, op2(l, OP_ilt, k, ki(l, (int64_t)leaf->count - 1)));
}

void place_store(Lower *l, const Place *p, Val v) {
    if (p->kind != PLACE_VARS) ice(l->s, "a parameter is written");
    if (p->selected) {
        for (uint32_t j = 0; j < p->ncomp; j++) {
            if (!p->dyn) {
                store_leaf(l, p, p->comp[j], v.c[j]);
                continue;
            }
            for (uint32_t i = 0; i < p->dyn_count; i++) {
                uint32_t leaf = dyn_leaf(p, j, i);
                store_leaf(l, p, leaf, sel(l, op2(l, OP_ieq, p->dyn, ki(l, i)), v.c[j], load_leaf(l, p, leaf)));
            }
        }
        return;
    }
    const Layout *layout = gen_layout(l, p->type);
    for (uint32_t i = 0; i < layout->n; i++)
        if (layout->leaf[i].count) store_array(l, p->vars[i].value, p->index, v.c[i], &layout->leaf[i]);
        else store_leaf(l, p, i, v.c[i]);
}

Val vars_load(Lower *l, Type *t, Var *vars) {
    Place p = place_of_vars(t, vars);
    return place_load(l, &p);
}

void vars_store(Lower *l, Type *t, Var *vars, Val v, bool own) {
    const Layout *layout = gen_layout(l, t);
    for (uint32_t i = 0; i < layout->n; i++)
        if (!layout->leaf[i].count) var_set(l, &vars[i], v.c[i]);
        else if (own) vars[i].value = v.c[i];
        else store_array(l, vars[i].value, NULL, v.c[i], &layout->leaf[i]);
}
