/* What a condition teaches of the values that it compares, where it is known to hold, or not to.
 *
 * But not that two boundaries are one: where d < r fails, d < q does if r = q. Yet the two move apart, and what is
 * between them then is of the second alone. So where parameters make r and q the same, up to rounding, d stays what it
 * was. */
#include "compiler/pass/variant_bounds.h"

#include <float.h>

static Inst *less(Builder *b, Inst *p, Inst *q) { return bounds_op2(b, OP_flt, p, q); }
static Inst *not_above(Builder *b, Inst *p, Inst *q) { return bounds_op2(b, OP_fle, p, q); }

static void override(Boxes *x, const Inst *v, Boxed to) {
    vec_push(x->arena, &x->undo, ((Undo){v->id, x->value[v->id]}));
    x->value[v->id] = to;
}

/* unless: where this holds the end stays; NULL: nowhere. */
static void raise_lo(Boxes *x, Builder *b, const Inst *v, Inst *lo, Inst *unless) {
    Boxed to = x->value[v->id];
    to.is.lo = unless ? bounds_choose(b, unless, to.is.lo, lo) : lo;
    override(x, v, to);
}

static void lower_hi(Boxes *x, Builder *b, const Inst *v, Inst *hi, Inst *unless) {
    Boxed to = x->value[v->id];
    to.is.hi = unless ? bounds_choose(b, unless, to.is.hi, hi) : hi;
    override(x, v, to);
}

/* Ends that hold one by one. */
static Bound ends(Builder *b, Bound v) { return v.lo == v.hi ? v : ir_bound_ends(b, v); }

/* ---- values that are compared twice */
enum { MOST_RIVALS = 8, DEEP = 8 /* operations */ };
#define SAME 4 /* units in the last place: the rounding of two sums of parameters */

/* What changes on the box, of a comparison with what does not; NULL: it is another one. */
static const Inst *compared(const Boxes *x, const Inst *i, const Inst **with) {
    if ((i->op != OP_flt && i->op != OP_fle) || bounds_wide(x, i->args[0]) == bounds_wide(x, i->args[1])) return NULL;
    bool first = bounds_wide(x, i->args[0]);
    *with = i->args[first];
    return i->args[!first];
}

/* last: by id of a value, the comparison of it that comes next. */
static void find_rivals(Boxes *x, const Block *block, const Inst **last) {
    for (const Inst *i = block->last, *with = NULL; i; i = i->prev) {
        for (uint32_t r = i->nregions; r-- > 0;) find_rivals(x, i->region[r], last);
        const Inst *d = compared(x, i, &with);
        if (d) x->rival[i->id] = last[d->id], last[d->id] = i;
    }
}

void bounds_find_rivals(Boxes *x, uint32_t n) {
    x->rival = ARENA_ARRAY(x->arena, const Inst *, n);
    find_rivals(x, x->from->body, ARENA_ARRAY(x->arena, const Inst *, n));
}

/* Can v, the same on all of the box, be computed where `at` stands, before its own turn? */
static bool is_early(const Boxes *x, const Inst *v, const Inst *at, uint32_t depth) {
    if (v->id < at->id && walk_inside(at->block, v->block)) return true;
    bool early =
        depth && !v->nregions && (walk_is_pure(v) || ir_is_const(v) || v->op == OP_param) && !bounds_wide(x, v);
    for (uint32_t a = 0; a < v->nargs && early; a++) early = is_early(x, v->args[a], at, depth - 1);
    return early;
}

static Inst *compute(Boxes *x, Builder *b, const Inst *v, const Inst *at) {
    if (v->id < at->id && walk_inside(at->block, v->block)) return x->value[v->id].is.lo;
    for (uint32_t a = 0; a < v->nargs; a++) compute(x, b, v->args[a], at);
    vec_push(x->arena, &x->undo, ((Undo){v->id, x->value[v->id]})); /* it is seen here only */
    bounds_value(x, b, v);
    return x->value[v->id].is.lo;
}

/* May a comparison behind this one have the same boundary, and move it by other parameters? NULL: none can. */
static Inst *has_rival(Boxes *x, Builder *b, const Inst *cond) {
    const Inst *own = NULL, *with = NULL, *d = compared(x, cond, &own);
    if (d && walk_is_indexed(own, DEEP)) return NULL;
    Inst *any = NULL, *r = d ? x->value[own->id].is.lo : NULL;
    double unit = SAME * (b->fn->precision == PREC_F64 ? DBL_EPSILON : (double)FLT_EPSILON);
    uint32_t n = 0, mark = x->undo.len;
    for (const Inst *i = d ? x->rival[cond->id] : NULL; i && n < MOST_RIVALS; i = x->rival[i->id], n++) {
        compared(x, i, &with);
        if (with == own || (ir_is_const(with) && ir_is_const(own)) || walk_is_indexed(with, DEEP)) continue;
        if (!is_early(x, with, cond, DEEP)) continue;
        Inst *q = compute(x, b, with, cond), *apart = ir_emit1(b, OP_fabs, ir_emit2(b, OP_fsub, r, q));
        Inst *same = not_above(b, apart, ir_emit2(b, OP_fmul, ir_emit1(b, OP_fabs, r), ir_constf(b, unit)));
        any = any ? bounds_op2(b, OP_bor, any, same) : same;
        bounds_forget(x, mark);
    }
    return any;
}

/* p < q or p <= q holds: neither is NaN. An end that is NaN stays: nothing is known of the other either. */
static void learn_below(Boxes *x, Builder *b, const Inst *p, const Inst *q, Inst *unless) {
    Bound vp = x->value[p->id].is, vq = x->value[q->id].is;
    bool floats = p->type == TY_FLT;
    Bound ep = floats ? ends(b, vp) : vp, eq = floats ? ends(b, vq) : vq;
    if (bounds_wide(x, p)) lower_hi(x, b, p, ir_emit2(b, floats ? OP_fmin : OP_imin, vp.hi, eq.hi), unless);
    if (bounds_wide(x, q)) raise_lo(x, b, q, ir_emit2(b, floats ? OP_fmax : OP_imax, vq.lo, ep.lo), unless);
}

/* p < q or p <= q does not hold. Of a NaN that would say nothing; the end taken over proves that the other operand is
 * none. */
static void learn_not_below(Boxes *x, Builder *b, const Inst *p, const Inst *q, Inst *unless) {
    if (p->type != TY_FLT) {
        learn_below(x, b, q, p, NULL);
        return;
    }
    Bound vp = x->value[p->id].is, vq = x->value[q->id].is;
    Bound ep = ends(b, vp), eq = ends(b, vq);
    if (bounds_wide(x, q)) {
        Inst *better = bounds_op2(b, OP_band, less(b, ep.hi, vq.hi), ir_bound_is_number(b, vq));
        lower_hi(x, b, q, bounds_choose(b, better, ep.hi, vq.hi), unless);
    }
    if (bounds_wide(x, p)) {
        Inst *better = bounds_op2(b, OP_band, less(b, vp.lo, eq.lo), ir_bound_is_number(b, vp));
        raise_lo(x, b, p, bounds_choose(b, better, eq.lo, vp.lo), unless);
    }
}

bool bounds_may_be_given(const Boxes *x, const Inst *v) {
    return v->op == OP_bsel && !bounds_wide(x, v->args[0]) && !bounds_wide(x, v->args[1]);
}

static void learn(Boxes *x, Builder *b, const Inst *cond, bool truth);

/* One that is given says nothing of what it compares. */
static void learn_unless_given(Boxes *x, Builder *b, const Inst *cond, bool truth) {
    Inst *given = x->value[cond->args[0]->id].is.lo;
    uint32_t mark = x->undo.len;
    learn(x, b, cond->args[2], truth);
    for (uint32_t k = x->undo.len; k-- > mark;) {
        Bound was = x->undo.data[k].was.is, *is = &x->value[x->undo.data[k].id].is;
        is->lo = bounds_choose(b, given, was.lo, is->lo);
        is->hi = bounds_choose(b, given, was.hi, is->hi);
    }
}

static void learn(Boxes *x, Builder *b, const Inst *cond, bool truth) {
    if (!bounds_wide(x, cond)) return;
    const Inst *p = cond->nargs > 0 ? cond->args[0] : NULL, *q = cond->nargs > 1 ? cond->args[1] : NULL;
    switch ((Op)cond->op) {
    case OP_site:
    case OP_bnot: learn(x, b, p, cond->op == OP_bnot ? !truth : truth); break;
    case OP_bsel:
        if (bounds_may_be_given(x, cond)) learn_unless_given(x, b, cond, truth);
        break;
    case OP_band:
        if (truth) learn(x, b, p, true), learn(x, b, q, true);
        break;
    case OP_bor:
        if (!truth) learn(x, b, p, false), learn(x, b, q, false);
        break;
    case OP_flt:
    case OP_fle:
    case OP_ilt:
    case OP_ile:
        if (truth) learn_below(x, b, p, q, has_rival(x, b, cond));
        else learn_not_below(x, b, p, q, has_rival(x, b, cond));
        break;
    case OP_feq:
    case OP_ieq:
        if (truth) learn_below(x, b, p, q, NULL), learn_below(x, b, q, p, NULL);
        break;
    case OP_fne:
    case OP_ine:
        if (!truth) learn_below(x, b, p, q, NULL), learn_below(x, b, q, p, NULL);
        break;
    default: break;
    }
    Inst *known = ir_constb(b, truth);
    override(x, cond, (Boxed){.is = {known, known}});
}

uint32_t bounds_learn(Boxes *x, Builder *b, const Inst *cond, bool truth) {
    uint32_t mark = x->undo.len;
    learn(x, b, cond, truth);
    return mark;
}

void bounds_forget(Boxes *x, uint32_t mark) {
    while (x->undo.len > mark) {
        Undo u = x->undo.data[--x->undo.len];
        x->value[u.id] = u.was;
    }
}
