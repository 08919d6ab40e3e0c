/* The partials column of ops.def as code.
 *
 * Each row becomes one function that builds the pull-back of a seed g to one argument. Run without emitting, the same
 * function tells which primal values the partial mentions: that, and nothing else, decides what reverse mode keeps. A
 * product that involves g is guarded (zmul, or a select) only where a factor may be infinite or NaN, or the seed
 * infinite: so 0*inf never makes a NaN, a NaN that a choice throws away takes none of the adjoints behind it along, and
 * ordinary code pays nothing. */
#include <math.h>

#include "compiler/pass/ad.h"

#ifdef SALTUS_AD_MUTATION
int ad_mutation_op = -1, ad_mutation_arg, ad_mutation_kind;
#endif

typedef AdTerm E;

static Inst *emit1(AdRule *R, Op op, Inst *x) { return R->emit ? ir_emit1(&R->b, op, x) : NULL; }
static Inst *emit2(AdRule *R, Op op, Inst *x, Inst *y) { return R->emit ? ir_emit2(&R->b, op, x, y) : NULL; }
static Inst *emit3(AdRule *R, Op op, Inst *x, Inst *y, Inst *z) {
    return R->emit ? ir_emit3(&R->b, op, x, y, z) : NULL;
}

Inst *ad_term_value(AdRule *R, AdTerm t) {
    if (!R->emit) return NULL;
    if (t.v) return t.v;
    if (t.x) return ir_emit2(&R->b, OP_fmul, t.x, t.y);
    return ir_constf(&R->b, 0);
}

Inst *ad_term_add(AdRule *R, Inst *acc, AdTerm t) {
    if (t.none || (!t.v && !t.x)) return acc;
    if (!acc) return ad_term_value(R, t);
    if (t.x && R->fma) return emit3(R, OP_ffma, t.x, t.y, acc);
    return emit2(R, OP_fadd, acc, ad_term_value(R, t));
}

AdTerm ad_seed(Inst *v, bool inf) {
    return (E){.v = v, .range = {-INFINITY, INFINITY, inf ? IR_POLE : 0}, .seed = true};
}

static E plain(Inst *v, IrRange range) { return (E){.v = v, .range = range}; }

static E operand(AdRule *R, uint32_t which) {
    R->mentions |= 1u << which;
    const Inst *v = which == 3 ? R->inst : R->inst->args[which];
    IrRange range = v->op == OP_constf                ? ir_range_const(v->imm.f)
                    : R->range && v->id != UINT32_MAX ? R->range[v->id]
                                                      : IR_RANGE_FINITE;
    E e = plain(R->emit ? R->have[which] : NULL, range);
    e.key = v;
    return e;
}

static E e_const(AdRule *R, double v) { return plain(R->emit ? ir_constf(&R->b, v) : NULL, ir_range_const(v)); }
static E e_none(void) { return (E){.none = true}; }

static E e_add(AdRule *R, E x, E y) {
    E e = {.range = ir_range_row(OP_fadd, x.range, y.range, x.range, false), .seed = x.seed || y.seed};
    if (!R->emit) return e;
    if (y.x && R->fma) e.v = ad_term_add(R, ad_term_value(R, x), y);
    else e.v = ad_term_add(R, ad_term_value(R, y), x);
    return e;
}

static E e_neg(AdRule *R, E x) {
    E e = x;
    e.key = NULL;
    e.range = ir_range_row(OP_fneg, x.range, x.range, x.range, false);
    if (!R->emit) return e;
    if (x.v) e.v = emit1(R, OP_fneg, x.v);
    else if (x.x) e.x = emit1(R, OP_fneg, x.x);
    return e;
}

static E e_sub(AdRule *R, E x, E y) {
    E e = {.range = ir_range_row(OP_fsub, x.range, y.range, x.range, false), .seed = x.seed || y.seed};
    if (R->emit) e.v = emit2(R, OP_fsub, ad_term_value(R, x), ad_term_value(R, y));
    return e;
}

static bool same_operand(E x, E y) { return x.key && x.key == y.key; }

/* s has the seed, p the slope. Both guards give 0: a zero seed wins over an infinite slope or one that is NaN, a zero
 * slope over an infinite seed. */
static E seeded_product(AdRule *R, E s, E p) {
    E e = {.seed = true, .range = {-INFINITY, INFINITY, (s.range.beyond | p.range.beyond) & IR_POLE}};
    bool slope_zero = s.range.beyond && !ir_range_nonzero(p.range);
    if (!R->emit) return e;
    Inst *g = ad_term_value(R, s), *x = ad_term_value(R, p);
    if (p.range.beyond && slope_zero)
        e.v = emit3(R, OP_fsel, emit2(R, OP_feq, g, ir_constf(&R->b, 0)), ir_constf(&R->b, 0), emit2(R, OP_zmul, x, g));
    else if (p.range.beyond) e.v = emit2(R, OP_zmul, g, x);
    else if (slope_zero) e.v = emit2(R, OP_zmul, x, g);
    else e.x = g, e.y = x;
    return e;
}

static E e_mul(AdRule *R, E x, E y) {
    if (x.seed) return seeded_product(R, x, y);
    if (y.seed) return seeded_product(R, y, x);
    E e = {.range = ir_range_row(OP_fmul, x.range, y.range, x.range, same_operand(x, y))};
    if (R->emit) e.x = ad_term_value(R, x), e.y = ad_term_value(R, y);
    return e;
}

static E e_div(AdRule *R, E x, E y) {
    bool pole = x.seed && !ir_range_nonzero(y.range), guard = pole || (x.seed && y.range.beyond & IR_NAN);
    E e = {.seed = x.seed};
    e.range = x.seed ? (IrRange){-INFINITY, INFINITY, pole ? IR_POLE : x.range.beyond}
                     : ir_range_row(OP_fdiv, x.range, y.range, x.range, false);
    if (R->emit) e.v = emit2(R, guard ? OP_zdiv : OP_fdiv, ad_term_value(R, x), ad_term_value(R, y));
    return e;
}

static E e_fma(AdRule *R, E x, E y, E z) {
    E e = {.range = ir_range_row(OP_ffma, x.range, y.range, z.range, same_operand(x, y))};
    if (!R->emit) return e;
    if (R->fma) e.v = emit3(R, OP_ffma, ad_term_value(R, x), ad_term_value(R, y), ad_term_value(R, z));
    else e.v = emit2(R, OP_fadd, emit2(R, OP_fmul, ad_term_value(R, x), ad_term_value(R, y)), ad_term_value(R, z));
    return e;
}

static E e_select(AdRule *R, Inst *cond, E x, E y) {
    E e = {.seed = x.seed || y.seed};
    e.range = (IrRange){fmin(x.range.lo, y.range.lo), fmax(x.range.hi, y.range.hi), x.range.beyond | y.range.beyond};
    if (R->emit) e.v = ir_select(&R->b, cond, ad_term_value(R, x), ad_term_value(R, y));
    return e;
}

static bool fixed(const AdRule *R, uint32_t which) {
    const Inst *v = R->inst->args[which];
    return ir_is_const(v) || (R->varied && v->id != UINT32_MAX && !R->varied[v->id]);
}

static Inst *e_compare(AdRule *R, Op op, E x, E y) {
    return R->emit ? emit2(R, op, ad_term_value(R, x), ad_term_value(R, y)) : NULL;
}

static E e_row1(AdRule *R, Op op, E x) {
    return plain(R->emit ? emit1(R, op, ad_term_value(R, x)) : NULL,
                 ir_range_row(op, x.range, x.range, x.range, false));
}

static E e_row2(AdRule *R, Op op, E x, E y) {
    return plain(R->emit ? emit2(R, op, ad_term_value(R, x), ad_term_value(R, y)) : NULL,
                 ir_range_row(op, x.range, y.range, x.range, false));
}

/* The rows. a, b, c, r stand for operands only while ops.def is read. */
#define ADD(x, y) e_add(R, x, y)
#define SUB(x, y) e_sub(R, x, y)
#define MUL(x, y) e_mul(R, x, y)
#define DIV(x, y) e_div(R, x, y)
#define NEG(x) e_neg(R, x)
#define FMA(x, y, z) e_fma(R, x, y, z)
#define ZMUL(x, y) e_mul(R, x, y) /* the ranges know where the guard is needed */
#define ZDIV(x, y) e_div(R, x, y)
#define SEL(cond, x, y) e_select(R, cond, x, y)
#define LT(x, y) e_compare(R, OP_flt, x, y)
#define LE(x, y) e_compare(R, OP_fle, x, y)
/* min or max takes the other argument: also where both are equal, if that one is a constant, so that the slope at the
 * kink is 0. */
#define TAKES(other, x, y) e_compare(R, fixed(R, other) ? OP_fle : OP_flt, x, y)
#define EQ(x, y) e_compare(R, OP_feq, x, y)
#define K(v) e_const(R, v)
#define F1(op, x) e_row1(R, OP_##op, x)
#define F2(op, x, y) e_row2(R, OP_##op, x, y)
#define ZERO e_none()
#define P1(x) case 0: return x;
#define P2(x, y) case 0: return x; case 1: return y;
#define P3(x, y, z) case 0: return x; case 1: return y; case 2: return z;
#define ROW(name, partials)                                                                                                                 \
    case OP_##name:                                                                                                                         \
        switch (which) { partials default: return e_none(); }
#define FOP1(name, value, partials, ...) ROW(name, partials)
#define FOP2(name, value, partials, ...) ROW(name, partials)
#define FOP3(name, value, partials, ...) ROW(name, partials)
#define FCMP2(name, ...) case OP_##name: return e_none();
#define FSEL(name, ...) case OP_##name: return select_partial(R, which, g);
#define IOP1(name, ...) case OP_##name: return e_none();
#define IOP2(name, ...) case OP_##name: return e_none();
#define ICMP2(name, ...) case OP_##name: return e_none();
#define BOP1(name, ...) case OP_##name: return e_none();
#define BOP2(name, ...) case OP_##name: return e_none();
#define CONV(name, ...) case OP_##name: return e_none();
#define SPECIAL(name, ...) case OP_##name: return e_none();

static E select_partial(AdRule *R, uint32_t which, E g) {
    if (R->inst->op != OP_fsel || which == 0) return e_none();
    Inst *cond = operand(R, 0).v;
    E zero = e_const(R, 0);
    E e = which == 1 ? e_select(R, cond, g, zero) : e_select(R, cond, zero, g);
    return e;
}

static E row(AdRule *R, uint32_t which, E g) {
#define a operand(R, 0)
#define b operand(R, 1)
#define c operand(R, 2)
#define r operand(R, 3)
    switch ((Op)R->inst->op) {
#include "compiler/ir/ops.def"
#include "compiler/ir/ops_undef.h"
    case OP_COUNT: break;
    }
#undef a
#undef b
#undef c
#undef r
    return e_none();
}

uint32_t ad_mentions(const Inst *i, uint32_t which, const IrRange *range, bool *inf) {
    AdRule R = {.inst = i, .range = range};
    E e = row(&R, which, ad_seed(NULL, false));
    if (inf) *inf = !e.none && (e.range.beyond & IR_POLE);
    return e.none ? UINT32_MAX : R.mentions;
}

AdTerm ad_partial(AdRule *R, const Inst *i, uint32_t which, AdTerm g) {
    uint32_t mentions = ad_mentions(i, which, R->range, NULL);
    if (mentions == UINT32_MAX) return e_none();
    for (uint32_t k = 0; k < 4; k++) /* in a fixed order: C leaves the order of the row's own calls open */
        if (mentions & 1u << k) R->have[k] = R->value(R->user, k == 3 ? (Inst *)i : i->args[k]);
    R->inst = i;
    R->emit = true;
    E e = row(R, which, g);
#ifdef SALTUS_AD_MUTATION
    if (ad_mutation_op == i->op && ad_mutation_arg == (int)which) {
        Inst *v = ad_term_value(R, e);
        e = plain(ad_mutation_kind == 0   ? emit1(R, OP_fneg, v)
                  : ad_mutation_kind == 1 ? emit2(R, OP_fadd, v, v)
                                          : ir_constf(&R->b, 0),
                  e.range);
    }
#endif
    return e;
}
