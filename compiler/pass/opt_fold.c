/* Constants and exact identities, to a fixpoint in one walk: values are replaced as their uses come by.
 *
 * Only rewrites that keep every bit: x*1, x-0, x+(-0), select of equal arms or on a constant, if_ on a constant (its
 * region is spliced in), loops that run once, carried values that never change before the loop ends. */
#include <string.h>

#include "compiler/pass/walk.h"

typedef struct Fold {
    Fn *fn;
    Inst **map; /* by id: what replaces it */
    uint32_t nmap;
    bool changed;
} Fold;

static Inst *resolve(Fold *f, Inst *v) {
    while (v->id < f->nmap && f->map[v->id]) v = f->map[v->id];
    return v;
}

static void replace(Fold *f, Inst *i, Inst *by) {
    f->map[i->id] = by;
    f->changed = true;
}

/* A new constant before `at`; its id is outside the map. */
static Inst *constant(Fold *f, Inst *at, IrType t, Imm v) {
    Builder b = ir_before(f->fn, at);
    Inst *c = t == TY_FLT ? ir_constf(&b, v.f) : t == TY_INT ? ir_consti(&b, (int32_t)v.i) : ir_constb(&b, v.i != 0);
    c->id = UINT32_MAX;
    return c;
}

static bool is_f(const Inst *i, double v) { return i->op == OP_constf && memcmp(&i->imm.f, &v, sizeof v) == 0; }
static bool is_i(const Inst *i, int32_t v) { return i->op == OP_consti && (int32_t)i->imm.i == v; }
static bool is_b(const Inst *i, bool v) { return i->op == OP_constb && (i->imm.i != 0) == v; }

static bool rounds(const Inst *i) {
    return i->op == OP_ffloor || i->op == OP_fceil || i->op == OP_ftrunc || i->op == OP_fround;
}

/* What (x ^ x >> by) >> by is, as hashes end in whose halves are numbers: x >> by, from 16 on. */
static Inst *upper_half(const Inst *a, const Inst *by) {
    if (a->op != OP_ixor || by->op != OP_consti || by->imm.i < 16 || by->imm.i > 31) return NULL;
    for (uint32_t k = 0; k < 2; k++) {
        Inst *half = a->args[k];
        if (half->op == OP_ushr && half->args[0] == a->args[1 - k] && is_i(half->args[1], (int32_t)by->imm.i))
            return half;
    }
    return NULL;
}

/* The value that i is equal to, bit for bit, or NULL. */
static Inst *identity(Inst *i) {
    Inst *a = i->nargs > 0 ? i->args[0] : NULL, *b = i->nargs > 1 ? i->args[1] : NULL,
         *c = i->nargs > 2 ? i->args[2] : NULL;
    switch (i->op) {
    case OP_fadd:
        if (is_f(b, -0.0)) return a;
        if (is_f(a, -0.0)) return b;
        return NULL;
    case OP_fsub: return is_f(b, 0.0) ? a : NULL;
    case OP_fmul:
        if (is_f(b, 1.0)) return a;
        return is_f(a, 1.0) ? b : NULL;
    case OP_fdiv: return is_f(b, 1.0) ? a : NULL;
    case OP_fneg: return a->op == OP_fneg ? a->args[0] : NULL;
    case OP_ffloor:
    case OP_fceil:
    case OP_ftrunc:
    case OP_fround: return rounds(a) ? a : NULL;
    case OP_fmin:
    case OP_fmax: return a == b ? a : NULL;
    case OP_fsel:
    case OP_isel:
        if (b == c) return b;
        return a->op == OP_constb ? (a->imm.i ? b : c) : NULL;
    case OP_bsel:
        if (b == c) return b;
        if (a->op == OP_constb) return a->imm.i ? b : c;
        return is_b(b, true) && is_b(c, false) ? a : NULL;
    case OP_band:
        if (is_b(a, true)) return b;
        if (is_b(b, true) || a == b) return a;
        if (is_b(a, false)) return a;
        return is_b(b, false) ? b : NULL;
    case OP_bor:
        if (is_b(a, false)) return b;
        if (is_b(b, false) || a == b) return a;
        if (is_b(a, true)) return a;
        return is_b(b, true) ? b : NULL;
    case OP_bxor:
        if (is_b(a, false)) return b;
        return is_b(b, false) ? a : NULL;
    case OP_bnot: return a->op == OP_bnot ? a->args[0] : NULL;
    case OP_iadd:
    case OP_ior:
    case OP_ixor:
        if (is_i(a, 0)) return b;
        return is_i(b, 0) ? a : NULL;
    case OP_isub:
    case OP_ishl:
    case OP_ishr: return is_i(b, 0) ? a : NULL;
    case OP_ushr: return is_i(b, 0) ? a : upper_half(a, b);
    case OP_imul:
        if (is_i(a, 1)) return b;
        if (is_i(b, 1)) return a;
        if (is_i(a, 0)) return a;
        return is_i(b, 0) ? b : NULL;
    default: return NULL;
    }
}

static void fold_block(Fold *f, Block *b);

/* Projections of i become the values given. */
static void replace_projs(Fold *f, Inst *i, Inst *const *values) {
    for (Inst *p = i->next, *next; p && p->op == OP_proj && p->args[0] == i; p = next) {
        next = p->next;
        replace(f, p, values[p->imm.i]);
        ir_unlink(p);
    }
}

static void fold_if(Fold *f, Inst *i) {
    if (i->args[0]->op == OP_constb) {
        Block *taken = i->region[i->args[0]->imm.i ? 0 : 1];
        fold_block(f, taken);
        Inst **values = taken->last->args;
        walk_splice(taken, i);
        replace_projs(f, i, values);
        ir_unlink(i);
        f->changed = true;
        return;
    }
    fold_block(f, i->region[0]);
    fold_block(f, i->region[1]);
    Inst **x = i->region[0]->last->args, **y = i->region[1]->last->args;
    for (Inst *p = i->next, *next; p && p->op == OP_proj && p->args[0] == i; p = next) {
        next = p->next;
        uint32_t r = (uint32_t)p->imm.i;
        bool same = x[r] == y[r] || (x[r]->op == y[r]->op && ir_is_const(x[r]) &&
                                     memcmp(&x[r]->imm, &y[r]->imm, sizeof x[r]->imm) == 0);
        if (!same) continue;
        if (ir_is_const(x[r])) replace(f, p, constant(f, i, (IrType)x[r]->type, x[r]->imm));
        else if (!walk_inside(x[r]->block, i->region[0]) && !walk_inside(x[r]->block, i->region[1]))
            replace(f, p, x[r]);
        else continue;
        ir_unlink(p);
    }
}

static void fold_loop(Fold *f, Inst *i) {
    Block *body = i->region[0];
    /* What ends the loop when it changes has its initial value in every iteration: "already found" is false. */
    for (uint32_t c = 0; c < i->nargs; c++)
        for (int value = 0; i->args[c]->type == TY_BOOL && value < 2; value++) {
            Inst *init = i->args[c];
            if (!walk_begins(i, init, value) || !walk_tells(body->last->args[0], body->last->args[c + 1], value))
                continue;
            if (init->op != OP_constb) init = constant(f, body->first, TY_BOOL, (Imm){.i = value});
            replace(f, body->params[c + 1], init);
        }
    /* A carried value that its own next value returns is its initial value. */
    for (uint32_t c = 0; c < i->nargs; c++)
        if (body->last->args[c + 1] == body->params[c + 1]) replace(f, body->params[c + 1], i->args[c]);
    fold_block(f, body);
    bool once = i->imm.loop.max_iters == 1 || is_b(body->last->args[0], false);
    if (!once) return;
    replace(f, body->params[0], constant(f, i, TY_INT, (Imm){.i = 0}));
    for (uint32_t c = 0; c < i->nargs; c++) replace(f, body->params[c + 1], i->args[c]);
    fold_block(f, body);
    Inst **values = body->last->args + 1;
    walk_splice(body, i);
    replace_projs(f, i, values);
    ir_unlink(i);
}

static void fold_block(Fold *f, Block *b) {
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        for (uint32_t a = 0; a < i->nargs; a++) i->args[a] = resolve(f, i->args[a]);
        if (i->op == OP_if_ || i->op == OP_loop) {
            while (next && next->op == OP_proj) next = next->next;
            if (i->op == OP_if_) fold_if(f, i);
            else fold_loop(f, i);
            continue;
        }
        for (uint32_t r = 0; r < i->nregions; r++) fold_block(f, i->region[r]);
        if (ir_ops[i->op].special) continue;
        if ((i->op == OP_f2i || i->op == OP_f2u) && i->args[0]->op == OP_ftrunc) /* they truncate as well */
            ir_replace_arg(i, 0, i->args[0]->args[0]), f->changed = true;
        Imm imm;
        Inst *same = identity(i);
        if (same) replace(f, i, same);
        else if (ir_fold(i, f->fn->precision, &imm)) replace(f, i, constant(f, i, (IrType)i->type, imm));
        else continue;
        ir_unlink(i);
    }
}

static void resolve_all(Fold *f, Block *b) {
    for (Inst *i = b->first; i; i = i->next) {
        for (uint32_t a = 0; a < i->nargs; a++) i->args[a] = resolve(f, i->args[a]);
        for (uint32_t r = 0; r < i->nregions; r++) resolve_all(f, i->region[r]);
    }
}

bool opt_fold(PassCtx *ctx, Fn *fn) {
    ArenaMark m = arena_mark(&ctx->session->scratch);
    Fold f = {.fn = fn};
    f.nmap = ir_number(fn) + 1;
    f.map = ARENA_ARRAY(&ctx->session->scratch, Inst *, f.nmap);
    fold_block(&f, fn->body);
    if (f.changed) resolve_all(&f, fn->body); /* operands seen before their replacement was known */
    arena_reset(&ctx->session->scratch, m);
    return f.changed;
}
