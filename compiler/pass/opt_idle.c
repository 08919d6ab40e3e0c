/* Iterations in which a clamp is flat and nothing comes of them: soft discs and splats beyond their edges.
 *
 *     t = max(u, 0); ...; yield on, T (1 - a(t)), c + T a(t) b
 *
 * Where u <= 0, t is 0, and if so is a, the iteration hands on what it was handed. What t makes goes into
 *
 *     if_ (0 < u) { ... } else { hand on }
 *
 * which a vector of samples passes over, forwards, and whose reverse is never run (sparse loops of ad_region.c). That
 * is for the kernel that sweeps alone: with f it shares no decision, and a product of 0 with what is infinite, an
 * infinity or a NaN in all others, is not made here. Derivatives in u are 0 where max takes the 0, at u = 0 too. */
#include <math.h>
#include <string.h>

#include "compiler/pass/walk.h"

typedef enum Is { ANYTHING, NUMBER, ANOTHER } Is;
/* What a value is where the clamp is flat. */
typedef struct Flat {
    Is is;
    double number;
    const Inst *another;
} Flat;

typedef struct Idle {
    Fn *fn;
    Block *body;
    Flat *flat;     /* by id */
    uint8_t *hangs; /* by id: on the clamp */
    uint8_t *use;   /* by id: who asks for it */
} Idle;
enum {
    NEXT = 1 /* the loop, as a carried value */,
    INSIDE = 2 /* what goes into the if_, and so goes it */,
    OUTSIDE = 4
};

static bool is_number(const Inst *v, double number) {
    return v->op == OP_constf && v->imm.f == number && !signbit(v->imm.f);
}

static Flat number(const Fn *fn, double v) {
    return (Flat){.is = NUMBER, .number = fn->precision == PREC_F32 ? (double)(float)v : v};
}
static Flat another(const Idle *s, const Inst *v) {
    if (v->op == OP_constf) return number(s->fn, v->imm.f);
    const Flat *f = v->id < s->fn->ninsts && s->hangs[v->id] ? &s->flat[v->id] : NULL;
    return f && f->is != ANYTHING ? *f : (Flat){.is = f ? ANYTHING : ANOTHER, .another = v};
}
static bool is(const Flat *f, double number) { return f->is == NUMBER && f->number == number; }

/* a + b, a b: of finite numbers, and but for the sign of a zero. */
static Flat sum(const Idle *s, Flat a, Flat b) {
    if (is(&a, 0)) return b;
    if (is(&b, 0)) return a;
    return a.is == NUMBER && b.is == NUMBER ? number(s->fn, a.number + b.number) : (Flat){0};
}
static Flat product(const Idle *s, Flat a, Flat b) {
    if (is(&a, 0) || is(&b, 0)) return number(s->fn, 0);
    if (is(&a, 1)) return b;
    if (is(&b, 1)) return a;
    return a.is == NUMBER && b.is == NUMBER ? number(s->fn, a.number * b.number) : (Flat){0};
}
static Flat negative(const Idle *s, Flat a) { return a.is == NUMBER ? number(s->fn, 0 - a.number) : (Flat){0}; }

static Flat flat_of(const Idle *s, const Inst *i) {
    Flat x[3] = {{0}};
    for (uint32_t a = 0; a < i->nargs && a < 3; a++) x[a] = another(s, i->args[a]);
    switch ((Op)i->op) {
    case OP_fadd: return sum(s, x[0], x[1]);
    case OP_fsub: return sum(s, x[0], negative(s, x[1]));
    case OP_fneg: return negative(s, x[0]);
    case OP_fmul: return product(s, x[0], x[1]);
    case OP_ffma: return sum(s, product(s, x[0], x[1]), x[2]);
    case OP_fdiv:
    case OP_fsqrt: return is(&x[0], 0) ? x[0] : (Flat){0};
    case OP_fmin:
    case OP_fmax:
        if (x[0].is != NUMBER || x[1].is != NUMBER) return (Flat){0};
        return (x[0].number < x[1].number) == (i->op == OP_fmin) ? x[0] : x[1];
    default: return (Flat){0};
    }
}

/* Is it max(u, 0)? Then u. */
static Inst *clamped(const Inst *i) {
    if (i->op != OP_fmax || is_number(i->args[0], 0) == is_number(i->args[1], 0)) return NULL;
    return i->args[is_number(i->args[0], 0)];
}

static bool is_result(const Inst *i, const Inst *of) { return i->op == OP_proj && i->args[0] == of; }

/* A test for the loop's end is an if_ that yields what stands outside of it. One result: that moves where the if_ does.
 */
static bool is_choice(const Inst *i) {
    return i->op == OP_if_ && ir_yield_of(i->region[0])->prev == NULL && ir_yield_of(i->region[1])->prev == NULL &&
           is_result(i->next, i) && !is_result(i->next->next, i);
}

/* Operand number a, with those of a choice's regions; NULL: there are no more. */
static Inst *operand(const Inst *i, uint32_t a) {
    if (a < i->nargs) return i->args[a];
    a -= i->nargs;
    for (uint32_t r = 0; r < i->nregions; a -= ir_yield_of(i->region[r++])->nargs)
        if (a < ir_yield_of(i->region[r])->nargs) return ir_yield_of(i->region[r])->args[a];
    return NULL;
}

static void follow(Idle *s, const Inst *clamp) {
    memset(s->flat, 0, s->fn->ninsts * sizeof *s->flat), memset(s->hangs, 0, s->fn->ninsts);
    s->hangs[clamp->id] = true, s->flat[clamp->id] = number(s->fn, 0);
    for (const Inst *i = clamp->next; i; i = i->next) {
        for (uint32_t a = 0; operand(i, a); a++) s->hangs[i->id] |= s->hangs[operand(i, a)->id];
        if (s->hangs[i->id] && i->type == TY_FLT) s->flat[i->id] = flat_of(s, i);
    }
}

static bool hands_on(const Idle *s) {
    const Inst *yield = ir_yield_of(s->body);
    bool any = false;
    for (uint32_t c = 1; c < yield->nargs; c++) {
        if (yield->args[c] == s->body->params[c]) continue;
        const Flat f = another(s, yield->args[c]);
        if (f.is != ANOTHER || f.another != s->body->params[c]) return false;
        any = true;
    }
    return any;
}

/* What makes the next values out of the clamp goes in, and what else it alone asks for. Behind it stays what is made of
 * next values, as a test for the loop's end. False: something else asks for a part of it, or it is too little. */
static bool choose(Idle *s, const Inst *u) {
    enum { MIN_WORK = 12 }; /* in instructions: a test, a branch, and masks for what is behind it */
    const Inst *yield = ir_yield_of(s->body);
    uint32_t work = 0;
    memset(s->use, 0, s->fn->ninsts);
    for (uint32_t c = 1; c < yield->nargs; c++) s->use[yield->args[c]->id] |= NEXT;
    s->use[yield->args[0]->id] |= OUTSIDE, s->use[u->id] |= OUTSIDE;
    for (const Inst *i = yield->prev; i; i = i->prev) {
        uint8_t *use = &s->use[i->id];
        if (s->hangs[i->id] && *use & INSIDE && *use & OUTSIDE && !(*use & NEXT)) return false;
        if (*use & NEXT && s->hangs[i->id]) *use |= INSIDE;
        else if (*use & OUTSIDE) *use &= ~INSIDE;
        for (uint32_t a = 0; operand(i, a) && *use; a++) s->use[operand(i, a)->id] |= *use & INSIDE ? INSIDE : OUTSIDE;
        if (*use & INSIDE) work += ir_ops[i->op].cost;
    }
    return work >= MIN_WORK;
}

static void wrap(Idle *s, Inst *u) {
    Inst *yield = ir_yield_of(s->body), *zero;
    Builder b = ir_before(s->fn, yield);
    zero = ir_constf(&b, 0);
    Inst *branch = ir_if(&b, ir_emit2(&b, OP_flt, zero, u));
    Builder in = ir_at_end(s->fn, branch->region[0]), out = ir_at_end(s->fn, branch->region[1]);
    const uint32_t n = yield->nargs - 1;
    Inst *end = ir_yield(&in, n, yield->args + 1);
    ir_yield(&out, n, s->body->params + 1);
    for (Inst *i = s->body->first, *next; i != zero; i = next) {
        next = i->next;
        if (i->id >= s->fn->ninsts || !s->use[i->id]) continue;
        if (s->use[i->id] & INSIDE) ir_move_before(i, end);
        else if (s->hangs[i->id]) ir_move_before(i, yield);
    }
    Builder behind = ir_after(s->fn, branch);
    for (uint32_t c = 0; c < n; c++) {
        Inst *made = end->args[c], *handed = ir_proj(&behind, branch, c);
        yield->args[c + 1] = handed;
        for (Inst *i = branch->next; i && s->hangs[made->id]; i = i->next) {
            for (uint32_t a = 0; a < i->nargs; a++)
                if (i->args[a] == made) i->args[a] = handed;
            for (uint32_t r = 0; r < i->nregions; r++) walk_replace(i->region[r], made, handed);
        }
    }
}

static bool is_plain(const Block *body) {
    for (const Inst *i = body->first; i != body->last; i = i->next) {
        const bool reads = i->op == OP_param || i->op == OP_iparam || i->op == OP_input || ir_is_const(i);
        if (!reads && !is_choice(i) && i->op != OP_proj && (ir_ops[i->op].special || !walk_is_pure(i))) return false;
    }
    return true;
}

static bool idle_in(Fn *fn, Block *b) {
    Arena *scratch = &fn->session->scratch;
    bool changed = false;
    for (Inst *i = b->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) changed |= idle_in(fn, i->region[r]);
        if (i->op != OP_loop || !is_plain(i->region[0])) continue;
        ArenaMark mark = arena_mark(scratch);
        const uint32_t n = ir_number(fn) + 1;
        Idle s = {fn, i->region[0], ARENA_ARRAY(scratch, Flat, n), ARENA_ARRAY(scratch, uint8_t, n),
                  ARENA_ARRAY(scratch, uint8_t, n)};
        bool wrapped = false;
        for (Inst *j = s.body->first; j && !wrapped; j = j->next) {
            Inst *u = clamped(j);
            if (!u) continue;
            follow(&s, j);
            wrapped = hands_on(&s) && choose(&s, u);
            if (wrapped) wrap(&s, u);
        }
        changed |= wrapped;
        arena_reset(scratch, mark);
    }
    return changed;
}

bool opt_idle(PassCtx *ctx, Fn *fn) {
    (void)ctx;
    return idle_in(fn, fn->body);
}
