/* Expressions. A value is one instruction a scalar; vectors, matrices and structs exist only here. */
#include <string.h>

#include "compiler/front/gen/internal.h"
#include "compiler/front/rows.h"

Val val_new(Lower *l, Type *t) {
    Val v = {t, gen_layout(l, t)->n, NULL};
    v.c = ARENA_ARRAY(l->arena, Inst *, v.n ? v.n : 1);
    return v;
}

Type *scalar_of(Type *t) { return t->kind == T_VECTOR || t->kind == T_MATRIX ? t->elem : t; }

static bool is_value_type(const Type *t) { return t->kind <= T_MATRIX && t->kind != T_VOID && t->kind != T_ERROR; }

static Inst *const_scalar(Lower *l, const Type *t, const ConstVal *c, uint32_t i) {
    switch (t->kind) {
    case T_FLOAT: return kf(l, c->v[i].f);
    case T_BOOL: return kb(l, c->v[i].i != 0);
    default: return ki(l, (int32_t)(uint32_t)c->v[i].i);
    }
}

Val const_val(Lower *l, Type *t, const ConstVal *c) {
    Val v = val_new(l, t);
    for (uint32_t i = 0; i < v.n; i++) v.c[i] = const_scalar(l, scalar_of(t), c, c->n == 1 ? 0 : i);
    return v;
}

Inst *gen_scalar(Lower *l, Expr *e) {
    Val v = gen_expr(l, e);
    if (v.n < 1) ice(l->s, "an expression without a value");
    return v.c[0];
}

/* ---- conversions */

Inst *convert_scalar(Lower *l, Inst *v, const Type *from, const Type *to, Span span) {
    if (from->kind == to->kind) return v;
    switch (to->kind) {
    case T_FLOAT:
        if (from->kind == T_BOOL) return sel(l, v, kf(l, 1), kf(l, 0));
        return op1(l, from->kind == T_UINT ? OP_u2f : OP_i2f, v);
    case T_INT:
    case T_UINT:
        if (from->kind == T_BOOL) return sel(l, v, ki(l, 1), ki(l, 0));
        if (from->kind == T_FLOAT) {
            Inst *n = op1(l, OP_ftrunc, v);
            return op1(l, to->kind == T_INT ? OP_f2i : OP_f2u, site_integer(l, SITE_TRUNC, n, v, span));
        }
        return v;
    case T_BOOL: return from->kind == T_FLOAT ? op2(l, OP_fne, v, kf(l, 0)) : op2(l, OP_ine, v, ki(l, 0));
    default: ice(l->s, "no conversion from %s to %s", from->name, to->name);
    }
}

static Val gen_convert(Lower *l, Expr *e) {
    Val a = gen_expr(l, e->a[0]);
    if (a.type == e->type) return a;
    Val v = val_new(l, e->type);
    for (uint32_t i = 0; i < v.n; i++)
        v.c[i] = convert_scalar(l, a.c[a.n == 1 ? 0 : i], scalar_of(a.type), scalar_of(e->type), e->span);
    return v;
}

/* ---- operators */

static Inst *fmod_scalar(Lower *l, Inst *a, Inst *b, Span span) {
    Inst *q = op2(l, OP_fdiv, a, b);
    Inst *n = site_integer(l, SITE_FMOD, op1(l, OP_ftrunc, q), q, span);
    if (!ir_is_const(b)) b = sel(l, op1(l, OP_fisinf, b), kf(l, 0), b); /* x % inf is x, and inf * 0 would be NaN */
    return op2(l, OP_fsub, a, op2(l, OP_fmul, b, n));
}

static Inst *binary_scalar(Lower *l, Operator op, Inst *a, Inst *b, TypeKind k, Span span) {
    bool swap;
    Op row = row_of_operator(op, k, &swap);
    if (k == T_FLOAT && op == OPR_MOD) return fmod_scalar(l, a, b, span);
    if (k == T_BOOL && op == OPR_EQ) return op1(l, OP_bnot, op2(l, OP_bxor, a, b));
    if (row == OP_COUNT) ice(l->s, "no binary operator %d", (int)op);
    Inst *v = op2(l, row, swap ? b : a, swap ? a : b);
    if (!ir_ops[row].compares) return v;
    if (k != T_FLOAT) {
        if (l->tag.disc && !l->tag.nodisc) site_untracked(l, v, a, b, span, JUMP_INTEGER);
        return v;
    }
    if (op != OPR_EQ && op != OPR_NE) return site_compare(l, v, a, b, span);
    /* Mostly an equality holds on a curve at most, with the same branch on both sides; pass/warn.c knows when not. */
    site_untracked(l, v, a, b, span, JUMP_EQUALITY);
    return v;
}

/* GLSL's == and != of matrices, structs and arrays: of all that they hold. */
static Val gen_whole(Lower *l, Operator op, Val a, Val b, Type *type, Span span) {
    const Layout *layout = gen_layout(l, a.type);
    Val v = val_new(l, type);
    v.c[0] = kb(l, true);
    for (uint32_t i = 0; i < a.n; i++) {
        const LeafType *leaf = &layout->leaf[i];
        TypeKind k = leaf->type == TY_FLT ? T_FLOAT : leaf->type == TY_BOOL ? T_BOOL : T_INT;
        for (uint32_t j = 0; j < (leaf->count ? leaf->count : 1); j++) {
            Inst *at[2][2] = {{a.c[i], ki(l, j)}, {b.c[i], ki(l, j)}}, *x[2] = {a.c[i], b.c[i]};
            for (int side = 0; side < 2 && leaf->count; side++)
                x[side] = special(l, OP_load, leaf->type, 2, at[side], (Imm){0});
            v.c[0] = op2(l, OP_band, v.c[0], binary_scalar(l, OPR_EQ, x[0], x[1], k, span));
        }
    }
    if (op == OPR_NE) v.c[0] = op1(l, OP_bnot, v.c[0]);
    return v;
}

Val gen_binary(Lower *l, Operator op, Val a, Val b, Type *type, Span span) {
    if (op == OPR_MUL && (a.type->kind == T_MATRIX || b.type->kind == T_MATRIX)) return gen_matmul(l, a, b, type);
    if (type->kind == T_BOOL && a.type->kind >= T_MATRIX) return gen_whole(l, op, a, b, type, span);
    Val v = val_new(l, type);
    TypeKind k = scalar_of(a.type)->kind;
    for (uint32_t i = 0; i < v.n; i++)
        v.c[i] = binary_scalar(l, op, a.c[a.n == 1 ? 0 : i], b.c[b.n == 1 ? 0 : i], k, span);
    return v;
}

static Val gen_unary(Lower *l, Expr *e) {
    Val a = gen_expr(l, e->a[0]), v = val_new(l, e->type);
    bool swap;
    Op row = row_of_operator(e->op, scalar_of(e->type)->kind, &swap);
    for (uint32_t i = 0; i < v.n; i++) v.c[i] = row == OP_COUNT ? a.c[i] : op1(l, row, a.c[i]); /* +a is a */
    return v;
}

/* ---- cost: what may run although its result is not needed */

static uint32_t builtin_cost(Builtin b) {
    /* clang-format off */
    switch (b) {
    case B_abs: case B_min: case B_max: case B_fma: case B_asfloat: case B_detach: case B_select: case B_isnan: case B_pixel: case B_resolution:
    case B_sample_index: case B_any: case B_all: return 1;
    case B_clamp: case B_saturate: case B_isinf: case B_isfinite: case B_dot: case B_sqrt: case B_sign: return 3;
    case B_rand: case B_rand2: case B_rand3: return UINT16_MAX;
    case B_lerp: case B_length: case B_distance: case B_cross: case B_step: case B_floor: case B_frac: case B_ceil: case B_round: case B_trunc: return 6;
    default: return 12;
    }
    /* clang-format on */
}

uint32_t expr_cost(Lower *l, const Expr *e, uint32_t limit) {
    if (!e || e->is_const || e->kind == E_LITERAL || e->kind == E_LEN) return 0;
    uint32_t n = is_value_type(e->type) ? type_components(e->type) : 8, cost = 0;
    switch (e->kind) {
    case E_NAME: return is_value_type(e->type) ? (e->sym->kind == SYM_PARAM ? n : 0) : limit + 1;
    case E_UNARY:
    case E_BINARY: cost = n * (e->op == OPR_DIV || e->op == OPR_MOD ? 4 : 1); break;
    case E_BUILTIN: cost = n * builtin_cost(e->builtin); break;
    case E_INDEX: cost = 3; break;
    case E_LOGIC:
    case E_CONVERT: cost = n; break;
    case E_COND: cost = 2 * n; break;
    case E_CONSTRUCT:
    case E_BROADCAST:
    case E_FIELD:
    case E_SWIZZLE: break;
    default: return limit + 1; /* assignments, calls, textures, lists */
    }
    if (e->kind == E_BUILTIN && e->builtin == B_mul) cost *= 4;
    for (uint32_t i = 0; i < 3 && cost <= limit; i++)
        if (e->a[i]) {
            /* reading a part of a parameter array or struct is one access */
            bool part = (e->kind == E_FIELD || e->kind == E_INDEX || e->kind == E_SWIZZLE) && i == 0 && gen_is_place(e);
            const Expr *x = e->a[i];
            while (part && x->kind != E_NAME) {
                if (x->kind == E_INDEX) cost += 3 + expr_cost(l, x->a[1], limit);
                x = x->a[0];
            }
            cost += part ? n : expr_cost(l, x, limit);
        }
    for (uint32_t i = 0; i < e->nargs && cost <= limit; i++) cost += expr_cost(l, e->args[i], limit);
    return cost > limit ? limit + 1 : cost;
}

static bool jumping_builtin(Builtin b) {
    /* clang-format off */
    switch (b) {
    case B_floor: case B_ceil: case B_round: case B_trunc: case B_frac: case B_fmod: case B_step: case B_sign: case B_atan2: case B_refract: return true;
    default: return false;
    }
    /* clang-format on */
}

/* Would [Disc] make a site of something written here? Of calls, in those of the standard library that jump. */
bool expr_has_site(const Expr *e) {
    if (!e || e->is_const) return false;
    if (e->kind == E_BINARY && type_is_float(e->a[0]->type) &&
        (e->op == OPR_LT || e->op == OPR_LE || e->op == OPR_GT || e->op == OPR_GE || e->op == OPR_MOD))
        return true;
    if (e->kind == E_ASSIGN && e->op == OPR_MOD && type_is_float(e->type)) return true;
    if (e->kind == E_BUILTIN && jumping_builtin(e->builtin)) return true;
    if (e->kind == E_METHOD && (methods[e->method].kind == METHOD_JUMPS || methods[e->method].query != SLT_QUERIES))
        return true;
    if (e->kind == E_CONVERT && type_is_float(e->a[0]->type) && !type_is_float(e->type)) return true;
    if (e->kind == E_CALL && e->func->jumps) return true;
    for (uint32_t i = 0; i < 3; i++)
        if (expr_has_site(e->a[i])) return true;
    for (uint32_t i = 0; i < e->nargs; i++)
        if (expr_has_site(e->args[i])) return true;
    return false;
}

bool expr_assigns(const Expr *e) {
    if (!e) return false;
    if (e->kind == E_ASSIGN || e->kind == E_INCDEC) return true;
    if (e->kind == E_CALL)
        for (uint32_t i = 0; i < e->func->nargs; i++)
            if (e->func->args[i]->mode != ARG_IN) return true;
    for (uint32_t i = 0; i < 3; i++)
        if (expr_assigns(e->a[i])) return true;
    for (uint32_t i = 0; i < e->nargs; i++)
        if (expr_assigns(e->args[i])) return true;
    return false;
}

enum { CHEAP = 8 };
static bool may_speculate(Lower *l, const Expr *e) {
    return expr_cost(l, e, CHEAP) <= CHEAP && !((l->tag.disc || l->tag.skip) && expr_has_site(e));
}

/* ---- && || ?: evaluate only what they need */

static Inst *gen_logic(Lower *l, Expr *e) {
    Inst *a = gen_scalar(l, e->a[0]);
    bool is_and = e->op == OPR_LAND;
    if (ir_is_const(a)) return (a->imm.i != 0) == is_and ? gen_scalar(l, e->a[1]) : a;
    if (may_speculate(l, e->a[1])) return op2(l, is_and ? OP_band : OP_bor, a, gen_scalar(l, e->a[1]));
    Var *v = var_new(l, TY_BOOL, 1);
    IfCtx c;
    v->value = a; /* the value where the right side is not needed */
    if_begin(l, &c, a);
    if (is_and) var_set(l, v, gen_scalar(l, e->a[1]));
    else var_set(l, v, kb(l, true));
    if_else(l, &c);
    if (is_and) var_set(l, v, kb(l, false));
    else var_set(l, v, gen_scalar(l, e->a[1]));
    if_end(l, &c);
    return v->value;
}

static Val gen_cond(Lower *l, Expr *e) {
    Inst *cond = gen_scalar(l, e->a[0]);
    if (ir_is_const(cond)) return gen_expr(l, e->a[cond->imm.i ? 1 : 2]);
    const Layout *layout = gen_layout(l, e->type);
    bool arrays = false;
    for (uint32_t i = 0; i < layout->n; i++) arrays |= layout->leaf[i].count != 0;
    if (!arrays && may_speculate(l, e->a[1]) && may_speculate(l, e->a[2])) {
        Val x = gen_expr(l, e->a[1]), y = gen_expr(l, e->a[2]), v = val_new(l, e->type);
        for (uint32_t i = 0; i < v.n; i++) v.c[i] = sel(l, cond, x.c[i], y.c[i]);
        return v;
    }
    Var *vars = vars_for(l, e->type);
    IfCtx c;
    if_begin(l, &c, cond);
    vars_store(l, e->type, vars, gen_expr(l, e->a[1]), false);
    if_else(l, &c);
    vars_store(l, e->type, vars, gen_expr(l, e->a[2]), false);
    if_end(l, &c);
    return vars_load(l, e->type, vars);
}

/* ---- assignment */

static Val gen_assign(Lower *l, Expr *e) {
    Place p = gen_place(l, e->a[0]);
    if (e->op == OPR_NONE) {
        Val v = gen_expr(l, e->a[1]);
        place_store(l, &p, v);
        return v;
    }
    Val old = place_load(l, &p);
    Val v = gen_binary(l, e->op, old, gen_expr(l, e->a[1]), e->a[0]->type, e->op_span);
    place_store(l, &p, v);
    return v;
}

static Val gen_incdec(Lower *l, Expr *e) {
    Place p = gen_place(l, e->a[0]);
    Val old = place_load(l, &p), v = val_new(l, old.type);
    bool f = scalar_of(old.type)->kind == T_FLOAT;
    for (uint32_t i = 0; i < v.n; i++)
        if (f) v.c[i] = op2(l, OP_fadd, old.c[i], kf(l, e->op == OPR_INC ? 1 : -1));
        else v.c[i] = op2(l, OP_iadd, old.c[i], ki(l, e->op == OPR_INC ? 1 : -1));
    place_store(l, &p, v);
    return e->prefix ? v : old;
}

/* ---- building values */

/* The leaves of t from a list; arrays inside become fresh memory filled element by element. */
static void store_elements(Lower *l, Type *elem, Inst **arrays, uint32_t element, Val v) {
    const Layout *layout = gen_layout(l, elem);
    for (uint32_t i = 0; i < layout->n; i++) {
        const LeafType *leaf = &layout->leaf[i];
        if (!leaf->count) {
            Inst *args[3] = {arrays[i], ki(l, element), v.c[i]};
            special(l, OP_store, TY_VOID, 3, args, (Imm){0});
            continue;
        }
        for (uint32_t j = 0; j < leaf->count; j++) {
            Inst *get[2] = {v.c[i], ki(l, j)};
            Inst *x = special(l, OP_load, leaf->type, 2, get, (Imm){0});
            Inst *args[3] = {arrays[i], ki(l, element * leaf->count + j), x};
            special(l, OP_store, TY_VOID, 3, args, (Imm){0});
        }
    }
}

static Val own_arrays(Lower *l, Val v) {
    const Layout *layout = gen_layout(l, v.type);
    Val out = val_new(l, v.type);
    for (uint32_t i = 0; i < v.n; i++) {
        out.c[i] = v.c[i];
        if (!layout->leaf[i].count) continue;
        out.c[i] = alloc_array(l, layout->leaf[i].type, layout->leaf[i].count);
        Inst *args[2] = {out.c[i], v.c[i]};
        special(l, OP_acopy, TY_VOID, 2, args, (Imm){0});
    }
    return out;
}

static Val gen_parts(Lower *l, Expr *e) {
    Type *t = e->type;
    Val v = val_new(l, t);
    uint32_t at = 0;
    if (t->kind == T_ARRAY) {
        const Layout *layout = gen_layout(l, t);
        for (uint32_t i = 0; i < v.n; i++) v.c[i] = alloc_array(l, layout->leaf[i].type, layout->leaf[i].count);
        for (uint32_t i = 0; i < e->nargs; i++) store_elements(l, t->elem, v.c, i, gen_expr(l, e->args[i]));
        return v;
    }
    for (uint32_t i = 0; i < e->nargs; i++) {
        Val a = gen_expr(l, e->args[i]);
        if (t->kind == T_STRUCT) a = own_arrays(l, a);
        else if (a.type->kind != T_STRUCT && scalar_of(a.type) != scalar_of(t)) {
            Val c = val_new(l, a.type);
            for (uint32_t j = 0; j < a.n; j++)
                c.c[j] = convert_scalar(l, a.c[j], scalar_of(a.type), scalar_of(t), e->span);
            a = c;
        }
        for (uint32_t j = 0; j < a.n && at < v.n; j++) v.c[at++] = a.c[j];
    }
    if (at == 1)
        while (at < v.n) v.c[at++] = v.c[0]; /* one scalar fills a vector */
    if (at != v.n) ice(l->s, "%u parts for %s", at, t->name);
    return v;
}

/* ---- constant arrays: an element at a constant index needs no memory */

static Expr *const_element(const Expr *e) {
    switch (e->kind) {
    case E_NAME: return e->sym->kind == SYM_CONST ? e->sym->array_init : NULL;
    case E_FIELD: {
        Expr *list = const_element(e->a[0]);
        return list && list->kind == E_LIST && e->field < list->nargs ? list->args[e->field] : NULL;
    }
    case E_INDEX: {
        if (e->a[0]->type->kind != T_ARRAY || !e->a[1]->is_const || !e->a[1]->cval.n) return NULL;
        Expr *list = const_element(e->a[0]);
        if (!list || list->kind != E_LIST || !list->nargs) return NULL;
        int64_t i = e->a[1]->cval.v[0].i;
        return list->args[i < 0 ? 0 : i >= list->nargs ? list->nargs - 1 : i];
    }
    default: return NULL;
    }
}

/* A short table of vectors or scalars is a chain of selects, which needs no memory in any variant. */
static bool small_table(Lower *l, Expr *e, Val *out) {
    if (e->kind != E_INDEX || e->a[0]->type->kind != T_ARRAY || !is_value_type(e->type)) return false;
    Expr *list = const_element(e->a[0]);
    if (!list || list->kind != E_LIST || !list->nargs || list->nargs > 8) return false;
    Inst *index = clamp_index(l, gen_scalar(l, e->a[1]), e->a[1]->type->kind == T_UINT, list->nargs);
    *out = gen_expr(l, list->args[list->nargs - 1]);
    for (uint32_t i = list->nargs - 1; i-- > 0;) {
        Val x = gen_expr(l, list->args[i]), v = val_new(l, e->type);
        Inst *here = op2(l, OP_ieq, index, ki(l, i));
        for (uint32_t j = 0; j < v.n; j++) v.c[j] = sel(l, here, x.c[j], out->c[j]);
        *out = v;
    }
    return true;
}

static Val gen_part(Lower *l, Expr *e) {
    Val v;
    Expr *element = const_element(e);
    if (element) return gen_expr(l, element);
    if (small_table(l, e, &v)) return v;
    bool swizzled_index = e->kind == E_INDEX && e->a[0]->kind == E_SWIZZLE;
    if (gen_is_place(e) && !swizzled_index) {
        Place p = gen_place(l, e);
        return place_load(l, &p);
    }
    Val a = gen_expr(l, e->a[0]);
    if (e->kind == E_SWIZZLE) {
        v = val_new(l, e->type);
        for (uint32_t i = 0; i < v.n; i++) v.c[i] = a.c[e->swz[i]];
        return v;
    }
    /* A part of a temporary: give it a place. */
    Var *vars = var_new(l, TY_VOID, a.n);
    for (uint32_t i = 0; i < a.n; i++) vars[i].type = (IrType)a.c[i]->type, vars[i].value = a.c[i];
    Bind *old = l->frame->bind;
    Symbol temp = {.kind = SYM_LOCAL, .name = "a temporary", .type = a.type, .id = 0};
    Bind bind = {.kind = BIND_VARS, .vars = vars};
    Expr name = {.kind = E_NAME, .type = a.type, .sym = &temp}, part = *e;
    if (e->kind == E_INDEX) { /* the index belongs to this frame: evaluate it before the binding changes */
        Expr index = {.kind = E_NAME, .type = e->a[1]->type};
        Symbol number = {.kind = SYM_LOCAL, .name = "an index", .type = e->a[1]->type, .id = 1};
        Var *iv = var_new(l, TY_INT, 1);
        iv->value = gen_scalar(l, e->a[1]);
        index.sym = &number;
        Bind both[2] = {bind, {.kind = BIND_VARS, .vars = iv}};
        part.a[0] = &name, part.a[1] = &index;
        Func f = *l->frame->func;
        Func *real = l->frame->func;
        f.nlocals = 2;
        l->frame->func = &f, l->frame->bind = both;
        Place p = gen_place(l, &part);
        v = place_load(l, &p);
        l->frame->func = real, l->frame->bind = old;
        return v;
    }
    uint32_t at = 0;
    for (uint32_t f = 0; f < e->field; f++) at += gen_layout(l, a.type->fields[f].type)->n;
    v = val_new(l, e->type);
    for (uint32_t i = 0; i < v.n; i++) v.c[i] = a.c[at + i];
    return v;
}

static Val gen_kind(Lower *l, Expr *e) {
    Val v;
    switch (e->kind) {
    case E_LITERAL:
    case E_LEN: return const_val(l, e->type, &e->cval);
    case E_NAME:
        if (e->sym->kind == SYM_CONST && is_value_type(e->type)) return const_val(l, e->type, &e->sym->cval);
        /* fall through */
    case E_INDEX:
    case E_FIELD:
    case E_SWIZZLE: return gen_part(l, e);
    case E_UNARY: return gen_unary(l, e);
    case E_BINARY: {
        Val a = gen_expr(l, e->a[0]);
        return gen_binary(l, e->op, a, gen_expr(l, e->a[1]), e->type, e->span);
    }
    case E_LOGIC:
        v = val_new(l, e->type);
        v.c[0] = gen_logic(l, e);
        return v;
    case E_COND: return gen_cond(l, e);
    case E_ASSIGN: return gen_assign(l, e);
    case E_INCDEC: return gen_incdec(l, e);
    case E_CALL: return gen_call(l, e);
    case E_BUILTIN: return gen_builtin(l, e);
    case E_METHOD: return gen_method(l, e);
    case E_CONSTRUCT:
    case E_LIST: return gen_parts(l, e);
    case E_CONVERT: return gen_convert(l, e);
    case E_BROADCAST: {
        Inst *a = gen_scalar(l, e->a[0]);
        v = val_new(l, e->type);
        for (uint32_t i = 0; i < v.n; i++) v.c[i] = a;
        return v;
    }
    case E_COMMA: gen_expr(l, e->a[0]); return gen_expr(l, e->a[1]);
    case E_ERROR: break;
    }
    ice(l->s, "an erroneous expression reached lowering");
}

Val gen_expr(Lower *l, Expr *e) {
    if (e->is_const && e->cval.n && is_value_type(e->type)) return const_val(l, e->type, &e->cval);
    Span span = l->b.span;
    l->b.span = gen_shown(l, e->span);
    Val v = gen_kind(l, e);
    l->b.span = span;
    if (l->opt->watch && !l->quiet) l->opt->watch(l->opt->watch_user, e, v.c, v.n);
    return v;
}
