/* First values of parameters: constants as checked, `init(f)` by running f in the interpreter for every element. */
#include <string.h>

#include "compiler/front/gen/internal.h"
#include "include/saltus/kernel.h"
#include "include/saltus/status.h"

/* About two seconds in the interpreter, and of large arrays 128 instructions an element: it takes 16 at once. */
enum { INIT_INSTRUCTIONS = 1 << 25, INIT_INSTRUCTIONS_EACH = 8 };

typedef struct Filler {
    Lower *l;
    Param *p;
    double *floats; /* next to fill */
    int32_t *ints;
} Filler;

static void put_const(Filler *f, const Type *t, const ConstVal *c) {
    uint32_t n = type_components(t);
    TypeKind k = n > 1 ? t->elem->kind : t->kind;
    for (uint32_t i = 0; i < n; i++) {
        uint32_t from = c->n == 1 ? 0 : i;
        if (k == T_FLOAT) *f->floats++ = c->v[from].f;
        else *f->ints++ = (int32_t)(uint32_t)c->v[from].i;
    }
}

/* Runs a Fn over n elements; returns an SltStatus. k: [nk][n], the inputs k0..; streams: [n]. out: of each output an
 * array [n] of double or int32_t. */
static int run(Lower *l, Fn *fn, uint32_t n, const int32_t *const *k, uint32_t nk, const int32_t *streams, void **out) {
    Program *p = l->program;
    Arena *scratch = &l->s->scratch;
    SltKernelArgs args = {.iparams = p->init_ints, .n_valid = n};
    bool single = fn->precision == PREC_F32;
    float *as_float = NULL;
    if (single) {
        as_float = ARENA_ARRAY(scratch, float, p->nfloats + 1);
        for (uint32_t i = 0; i < p->nfloats; i++) as_float[i] = (float)p->init_floats[i];
    }
    args.params = single ? (const void *)as_float : p->init_floats;
    for (uint32_t i = 0; i < nk; i++) args.in[IN_K0 + i] = k[i];
    args.in[IN_STREAM] = streams;
    void *zeros = arena_alloc(scratch, sizeof(double) * ((size_t)n + SLT_PAD));
    for (int i = 0; i < SLT_IN_VARYING; i++)
        if (!args.in[i]) args.in[i] = zeros;
    uint32_t nout = fn->body->last->nargs;
    for (uint32_t i = 0; i < nout; i++) args.out[i] = out[i];
    ir_number(fn);
    const int status = ir_interpret_within(fn, &args, n, n > 1 ? 16 : 1, &p->init_fuel);
    if (status == SLT_LIMIT && p->init_fuel) session_limit(l->s, "out of memory");
    return status;
}

static Val expression_value(Lower *l, Expr *e) {
    Func f = {.name = "value", .nlocals = 1};
    Frame frame = {.func = &f};
    frame.ret_flag = var_new(l, TY_BOOL, 1);
    frame.ret_flag->value = kb(l, false);
    frame.bind = ARENA_ARRAY(l->arena, Bind, 1);
    l->frame = &frame;
    Val v = gen_expr(l, e);
    l->frame = NULL;
    return v;
}

/* A constant expression that the checker did not evaluate itself. */
static void put_evaluated(Filler *f, Expr *e) {
    Lower fresh = gen_fresh(f->l, "value"), *l = &fresh;
    Val v = expression_value(l, e);
    if (v.n > SLT_OUT_MAX) ice(l->s, "a constant with %u parts", v.n);
    ir_yield(&l->b, v.n, v.c);
    bool single = l->fn->precision == PREC_F32;
    void *out[SLT_OUT_MAX];
    for (uint32_t i = 0; i < v.n; i++) out[i] = arena_alloc(&l->s->scratch, sizeof(double) * (1 + SLT_PAD));
    int32_t stream[1 + SLT_PAD] = {0};
    int status = run(l, l->fn, 1, NULL, 0, stream, out);
    if (status == SLT_LIMIT) {
        diag_emit(l->s, DIAG_init_failed, e->span, f->p->name, "the program exceeds a limit of the interpreter");
        gen_giveup(f->l);
    }
    if (status) ice(l->s, "evaluating a constant: status %d", status);
    for (uint32_t i = 0; i < v.n; i++)
        if (v.c[i]->type == TY_FLT) *f->floats++ = single ? (double)*(float *)out[i] : *(double *)out[i];
        else *f->ints++ = *(int32_t *)out[i];
}

static void put_expr(Filler *f, Expr *e) {
    if (e->kind == E_LIST) {
        for (uint32_t i = 0; i < e->nargs; i++) put_expr(f, e->args[i]);
        return;
    }
    bool value = e->type->kind <= T_MATRIX && e->type->kind > T_VOID;
    if (value && (e->is_const || e->kind == E_LITERAL) && e->cval.n) put_const(f, e->type, &e->cval);
    else if (e->kind == E_NAME && e->sym->kind == SYM_CONST && e->sym->array_init) put_expr(f, e->sym->array_init);
    else put_evaluated(f, e);
}

/* ---- init(f) */

/* Where the scalars of an element lie among its floats and ints, in the order in which gen_function gives them: leaf
 * after leaf. A parameter has arrays element after element, so float2 p[2] is p.x[2] p.y[2] here and
 * p[0].x p[0].y p[1].x p[1].y there. */
typedef struct Slots {
    uint32_t *slot;        /* by place in the leaves */
    const uint32_t *start; /* [leaves]: the place of a leaf's first scalar */
    uint32_t nfloats, nints;
} Slots;

/* Numbers one t, which is element `index` of its leaves; returns how many leaves t has. */
static uint32_t number_scalars(Slots *s, const Type *t, uint32_t leaf, uint32_t index) {
    uint32_t n = 0;
    switch (t->kind) {
    case T_VECTOR:
    case T_MATRIX:
        for (uint32_t parts = type_components(t); n < parts;) n += number_scalars(s, t->elem, leaf + n, index);
        return n;
    case T_ARRAY:
        for (uint32_t i = 0; i < t->n; i++) n = number_scalars(s, t->elem, leaf, index * t->n + i);
        return n;
    case T_STRUCT:
        for (uint32_t f = 0; f < t->nfields; f++) n += number_scalars(s, t->fields[f].type, leaf + n, index);
        return n;
    case T_BOOL:
    case T_INT:
    case T_UINT: s->slot[s->start[leaf] + index] = s->nints++; return 1;
    case T_FLOAT: s->slot[s->start[leaf] + index] = s->nfloats++; return 1;
    case T_ERROR:
    case T_VOID:
    case T_TEXTURE:
    case T_TEXTURE3D:
    case T_GEOMETRY: break;
    }
    return 0;
}

static uint32_t *parameter_slots(Lower *l, const Type *elem, const Layout *layout) {
    Arena *scratch = &l->s->scratch;
    uint32_t *start = ARENA_ARRAY(scratch, uint32_t, layout->n + 1);
    for (uint32_t i = 0; i < layout->n; i++)
        start[i + 1] = start[i] + (layout->leaf[i].count ? layout->leaf[i].count : 1);
    Slots s = {.slot = ARENA_ARRAY(scratch, uint32_t, start[layout->n] + 1), .start = start};
    number_scalars(&s, elem, 0, 0);
    return s.slot;
}

/* Stores scalars [first, first + count) of n elements. */
static void put_elements(Filler *f, const Layout *layout, const uint32_t *slots, uint32_t first, uint32_t count,
                         uint32_t n, void **out, bool single) {
    uint32_t at = 0;
    for (uint32_t i = 0; i < layout->n; i++) {
        uint32_t parts = layout->leaf[i].count ? layout->leaf[i].count : 1;
        bool is_float = layout->leaf[i].type == TY_FLT;
        for (uint32_t k = 0; k < parts; k++, at++) {
            if (at < first || at >= first + count) continue;
            void *from = out[at - first];
            for (uint32_t e = 0; e < n; e++)
                if (is_float)
                    f->floats[e * layout->nfloats + slots[at]] =
                        single ? (double)((float *)from)[e] : ((double *)from)[e];
                else f->ints[e * layout->nints + slots[at]] = ((int32_t *)from)[e];
        }
    }
}

static void run_init(Filler *f, Symbol *sym) {
    Lower *l = f->l;
    Func *fn = sym->init_func;
    Type *elem = sym->type;
    uint32_t dims[8], nd = 0, n = 1;
    while (nd < fn->nargs && nd < 8 && elem->kind == T_ARRAY) {
        dims[nd++] = elem->n;
        n *= elem->n;
        elem = elem->elem;
    }
    Arena *scratch = &l->s->scratch;
    int32_t *k[8], *streams = ARENA_ARRAY(scratch, int32_t, n + SLT_PAD);
    for (uint32_t d = 0; d < nd; d++) k[d] = ARENA_ARRAY(scratch, int32_t, n + SLT_PAD);
    for (uint32_t e = 0; e < n; e++) {
        uint32_t rest = e;
        for (uint32_t d = nd; d-- > 0;) k[d][e] = (int32_t)(rest % dims[d]), rest /= dims[d];
        streams[e] = (int32_t)ir_mix(ir_mix(ir_mix(0x53a17u, l->opt->seed), sym->param_index), e);
    }
    const Layout *layout = gen_layout(l, elem);
    const uint32_t *slots = parameter_slots(l, elem, layout);
    uint32_t total = layout->nfloats + layout->nints;
    bool single = l->opt->precision == PREC_F32;
    for (uint32_t first = 0; first < total; first += SLT_OUT_MAX) {
        uint32_t count = total - first < SLT_OUT_MAX ? total - first : SLT_OUT_MAX;
        Fn *code = gen_function(l, fn, fn->name, IN_K0, first, count);
        void *out[SLT_OUT_MAX];
        for (uint32_t i = 0; i < count; i++) out[i] = arena_alloc(scratch, sizeof(double) * ((size_t)n + SLT_PAD));
        int status = run(l, code, n, (const int32_t *const *)k, nd, streams, out);
        if (status) {
            diag_emit(l->s, DIAG_init_failed, sym->value_span.file >= 0 ? sym->value_span : sym->span, sym->name,
                      "the program exceeds a limit of the interpreter");
            gen_giveup(l);
        }
        put_elements(f, layout, slots, first, count, n, out, single);
    }
}

void gen_initial_values(Lower *l) {
    Program *p = l->program;
    p->init_floats = ARENA_ARRAY(l->arena, double, p->nfloats + 1);
    p->init_ints = ARENA_ARRAY(l->arena, int32_t, p->nints + 1);
    p->init_fuel = INIT_INSTRUCTIONS + INIT_INSTRUCTIONS_EACH * ((uint64_t)p->nfloats + p->nints);
    for (uint32_t i = 0; i < p->nparams; i++) {
        Param *q = &p->params[i];
        Symbol *sym = q->sym;
        if (param_is_image(q) || sym->asset || sym->zeros || sym->sized) continue;
        ArenaMark mark = arena_mark(&l->s->scratch);
        Filler f = {l, q, p->init_floats + q->fbase, p->init_ints + q->ibase};
        if (sym->init_func) run_init(&f, sym);
        else if (sym->array_init) put_expr(&f, sym->array_init);
        else if (sym->init) put_expr(&f, sym->init);
        arena_reset(&l->s->scratch, mark);
    }
}
