/* Reverse mode: long straight-line programs in chunks that a sweep passes over where they have no adjoints.
 *
 * Of min, max and select one operand has the adjoint and the other 0: of a long expression of them the adjoints of most
 * operations are 0, and so is all that the sweep makes of them. The run of operations is cut into chunks, and the
 * reverse of each stands in an
 *
 *     if_ (is any adjoint of what the chunk hands on not 0) { its reverse; yield adjoints of what it reads }
 *     else { yield those from before }
 *
 * A product with an adjoint of 0 is 0, whatever the slope (ad_rules.c), so sums are the same but for the sign of a
 * zero. An adjoint that is NaN is not 0. (Where f itself is NaN slopes go unguarded, and 0 * NaN is not made here.) */
#include "compiler/pass/ad_tape.h"

enum {
    CHUNK = 32, /* operations that have adjoints: a chunk costs a test of all that it hands on */
    MIN_OPS = 1000,
    MIN_CHOICES = 64,
    MIN_CHUNK = 8 /* what is left between operations of other kinds, and shorter, is not worth a test */
};

static bool is_straight(const Inst *i) { return !ir_ops[i->op].special || i->op == OP_param || ir_is_const(i); }

static bool is_reversed(const Vjp *v, const Inst *i) {
    return !ir_ops[i->op].special && i->type == TY_FLT && ad_active(&v->f, i);
}

bool vjp_is_sparse(const Vjp *v, const Block *b) {
    uint32_t ops = 0, choices = 0;
    for (const Inst *i = b->first; i; i = i->next) {
        if (!is_reversed(v, i)) continue;
        ops++;
        choices += i->op == OP_fmin || i->op == OP_fmax || i->op == OP_fsel;
    }
    return !v->o->dense && ops >= MIN_OPS && choices >= MIN_CHOICES;
}

typedef struct Chunk {
    Inst *first, *last;
    Vec(Inst *) handed; /* adjoints of what it hands on */
    Vec(Inst *) read;   /* values from outside that have adjoints */
    Vec(Adjoint) before;
} Chunk;

static bool holds(const Chunk *c, const Inst *i) {
    for (const Inst *j = c->first; j; j = j->next) {
        if (j == i) return true;
        if (j == c->last) return false;
    }
    return false;
}

static void note_reads(Vjp *v, Chunk *c, const Inst *i) {
    for (uint32_t a = 0; a < i->nargs; a++) {
        Inst *x = i->args[a];
        if (x->type != TY_FLT || !ad_active(&v->f, x) || v->stamp[x->id] == v->stamps || holds(c, x)) continue;
        v->stamp[x->id] = v->stamps;
        vec_push(v->scratch, &c->read, x);
        vec_push(v->scratch, &c->before, v->adj[x->id]);
    }
}

/* The chunk that ends with `last`; false: too little of it has an adjoint. */
static bool find_chunk(Vjp *v, Inst *last, Chunk *c) {
    uint32_t ops = 0;
    *c = (Chunk){.first = last, .last = last};
    for (Inst *i = last; i && is_straight(i) && ops < CHUNK; i = i->prev) {
        c->first = i;
        ops += i->id < v->f.n && is_reversed(v, i);
    }
    if (ops < MIN_CHUNK) return false;
    v->stamps++;
    for (Inst *i = c->first;; i = i->next) {
        if (i->id < v->f.n && i->type == TY_FLT && ad_active(&v->f, i)) {
            if (v->adj[i->id].v) vec_push(v->scratch, &c->handed, v->adj[i->id].v);
            note_reads(v, c, i);
        }
        if (i == last) return c->handed.len > 0;
    }
}

static Inst *any_adjoint(const Chunk *c, Builder *b) {
    Inst *none = ir_constb(b, true), *zero = ir_constf(b, 0);
    for (uint32_t h = 0; h < c->handed.len; h++)
        none = ir_emit2(b, OP_band, none, ir_emit2(b, OP_feq, c->handed.data[h], zero));
    return ir_emit1(b, OP_bnot, none);
}

static bool is_handed(const Chunk *c, const Inst *adjoint) {
    for (uint32_t h = 0; h < c->handed.len; h++)
        if (c->handed.data[h] == adjoint) return true;
    return false;
}

static void reverse_chunk(Vjp *v, const Chunk *c, Inst *any) {
    Ctx *outer = vjp_here(v);
    Builder b = vjp_builder(v);
    Inst *zero = ir_constf(&b, 0), *guard = ir_if(&b, any), *saved_before = outer->rev->before;
    RevBlock inner = {guard->region[0], NULL};
    vjp_push(v, NULL, &inner, outer->scope); /* primal values that it asks for others may ask for, too */
    outer->rev->before = guard;
    vjp_run(v, c->first, c->last);
    outer->rev->before = saved_before;
    vjp_pop(v);
    uint32_t n = 0;
    Inst **then = ARENA_ARRAY(v->scratch, Inst *, c->read.len + 1),
         **other = ARENA_ARRAY(v->scratch, Inst *, c->read.len + 1);
    Adjoint **joined = ARENA_ARRAY(v->scratch, Adjoint *, c->read.len + 1);
    for (uint32_t r = 0; r < c->read.len; r++) {
        Adjoint before = c->before.data[r], *after = &v->adj[c->read.data[r]->id];
        /* what was handed on as it is, is 0 in the lanes that are passed over */
        if (after->v == before.v || (!before.v && is_handed(c, after->v))) continue;
        then[n] = after->v;
        other[n] = before.v ? before.v : zero;
        joined[n++] = after;
    }
    Builder end[2] = {ir_at_end(v->fn, guard->region[0]), ir_at_end(v->fn, guard->region[1])};
    ir_yield(&end[0], n, then);
    ir_yield(&end[1], n, other);
    Builder behind = ir_after(v->fn, guard);
    for (uint32_t k = 0; k < n; k++) joined[k]->v = ir_proj(&behind, guard, k);
}

Inst *vjp_chunk(Vjp *v, Inst *last) {
    Chunk c;
    Inst *any = NULL, *prev = last->prev;
    if (find_chunk(v, last, &c)) {
        Builder b = vjp_builder(v);
        any = any_adjoint(&c, &b);
        prev = c.first->prev;
    } else {
        c.first = c.last = last;
    }
    if (any && !ir_is_const(any)) reverse_chunk(v, &c, any);
    else vjp_run(v, c.first, c.last);
    return prev;
}

/* ---- gates, in loops: what makes the operand of a min, a max or a choice, and nothing else. Its adjoint is 0 wherever
 * the other operand was taken: a disc is reversed where its edge is, not where a clamp is flat. */

/* In instructions: what the sweep does for i. */
static uint32_t work_of(const Vjp *v, const Inst *i) {
    enum { SUM = 6 /* over lanes, into memory */ };
    if (i->op == OP_param) return ad_slot_in_wrt(v->o, i) ? SUM : 0;
    return is_reversed(v, i) ? ir_ops[i->op].cost : 0;
}

bool vjp_gate(Vjp *v, const Inst *ahead, Inst *last, Inst **next) {
    enum { MIN_WORK = 24 }; /* a test and a branch, which may go wrong */
    Chunk c = {.first = last, .last = last};
    uint32_t work = 0;
    for (Inst *i = last; i && i != ahead && is_straight(i); i = i->prev) {
        if (i->id >= v->f.n) continue;
        if (i != last && v->adj[i->id].v) break;
        c.first = i, work += work_of(v, i);
    }
    if (v->o->dense || vjp_here(v)->scope->top || !v->adj[last->id].v || work < MIN_WORK) return false;
    v->stamps++;
    vec_push(v->scratch, &c.handed, v->adj[last->id].v);
    for (Inst *i = last; i; i = i == c.first ? NULL : i->prev)
        if (i->id < v->f.n && i->type == TY_FLT && ad_active(&v->f, i)) note_reads(v, &c, i);
    Builder b = vjp_builder(v);
    Inst *any = any_adjoint(&c, &b);
    if (ir_is_const(any)) return false;
    v->gated[last->id] = false, *next = c.first->prev;
    reverse_chunk(v, &c, ir_special(&b, OP_any, TY_BOOL, 1, &any, (Imm){0}));
    return true;
}
