/* Remainders: x - y * floor(x / y), as `mod` of GLSL, `fract` (y = 1) and repetition by rounding are written.
 *
 * Rows know that x and floor(x / y) lie within their bounds, not that one follows the other: on a box as wide as three
 * periods x - y * n might be anything within three, and every box beside a seam has two. Together they never leave one
 * period:  n <= x / y < n + 1,  and so  0 <= x - y n < y  but for rounding, of the quotient, the product and the sum.
 *
 * What is mixed by one, p + t * (q - p) as between two texels, stays between p and q: rows, which let p and q - p go
 * each its own way, say three times as much along every axis of a texture. */
#include "compiler/pass/variant_bounds.h"

#include <float.h>

typedef struct Remainder {
    const Inst *x, *y,
        *given; /* y: NULL is 1; given: a condition under which n is not the rounding of x / y, or NULL */
    Op rounding;
} Remainder;

static bool is_float(const Inst *v, double n) { return v->op == OP_constf && v->imm.f == n; }

/* Is p the value -q? */
static bool is_minus(const Inst *p, const Inst *q) {
    if (p->op == OP_fneg) return p->args[0] == q;
    return p->op == OP_constf && q->op == OP_constf && p->imm.f == -q->imm.f;
}

/* Is n the rounding of x / y, behind its event and a decision that may be given instead (variant_given.c)? times: y as
 * it stands in the product; negated: of the other sign. */
static bool rounds_quotient(const Boxes *b, const Inst *n, const Inst *x, const Inst *times, bool negated,
                            Remainder *r) {
    r->given = NULL;
    if (n->op == OP_siten) n = n->args[0];
    if (n->op == OP_fsel && !bounds_wide(b, n->args[0])) r->given = n->args[0], n = n->args[2];
    r->rounding = (Op)n->op, r->x = x, r->y = NULL;
    if (n->op != OP_ffloor && n->op != OP_fceil && n->op != OP_fround) return false;
    const Inst *of = n->args[0];
    if (!times) return of == x;
    if (of == x) return is_float(times, negated ? -1 : 1);
    if (of->op != OP_fdiv || of->args[0] != x) return false;
    r->y = of->args[1];
    return negated ? is_minus(times, r->y) : times == r->y;
}

static bool find(const Boxes *b, const Inst *i, Remainder *r) {
    if (i->op == OP_ffma) /* opt_contract.c made it */
        return rounds_quotient(b, i->args[1], i->args[2], i->args[0], true, r) ||
               rounds_quotient(b, i->args[0], i->args[2], i->args[1], true, r) ||
               (i->args[0]->op == OP_fneg && rounds_quotient(b, i->args[0]->args[0], i->args[2], i->args[1], false, r));
    if (i->op != OP_fsub) return false;
    const Inst *x = i->args[0], *p = i->args[1];
    if (p->op != OP_fmul) return rounds_quotient(b, p, x, NULL, false, r);
    return rounds_quotient(b, p->args[1], x, p->args[0], false, r) ||
           rounds_quotient(b, p->args[0], x, p->args[1], false, r);
}

static Inst *magnitude(Builder *b, Bound v) {
    return ir_emit2(b, OP_fmax, ir_emit1(b, OP_fabs, v.lo), ir_emit1(b, OP_fabs, v.hi));
}

Bound bounds_remainder(const Boxes *x, Builder *b, const Inst *i, Bound row) {
    Remainder r;
    if (!find(x, i, &r)) return row;
    bool f64 = b->fn->precision == PREC_F64;
    Inst *zero = ir_constf(b, 0), *one = ir_constf(b, 1), *slack = zero;
    Bound y = {one, one}, is;
    if (r.y) { /* half as much would do */
        Bound from = x->value[r.x->id].is;
        y = x->value[r.y->id].is;
        Inst *size = ir_emit2(b, OP_fadd, magnitude(b, from), magnitude(b, y));
        slack = ir_emit2(b, OP_fmul, size, ir_constf(b, 2 * (f64 ? DBL_EPSILON : FLT_EPSILON)));
        slack = ir_emit2(b, OP_fmax, slack, ir_constf(b, f64 ? DBL_MIN : FLT_MIN));
    }
    if (r.rounding == OP_fround) {
        is.hi = ir_emit2(b, OP_fmul, magnitude(b, y), ir_constf(b, 0.5)), is.lo = ir_emit1(b, OP_fneg, is.hi);
    } else if (r.rounding == OP_ffloor) {
        is.lo = ir_emit2(b, OP_fmin, zero, y.lo), is.hi = ir_emit2(b, OP_fmax, zero, y.hi);
    } else {
        is.lo = ir_emit1(b, OP_fneg, ir_emit2(b, OP_fmax, zero, y.hi));
        is.hi = ir_emit1(b, OP_fneg, ir_emit2(b, OP_fmin, zero, y.lo));
    }
    if (r.y) is.lo = ir_emit2(b, OP_fsub, is.lo, slack), is.hi = ir_emit2(b, OP_fadd, is.hi, slack);
    /* Where the row might be NaN, or infinite as of a quotient that overflows, nothing follows. */
    Inst *finite = bounds_op2(b, OP_flt, magnitude(b, row), ir_constf(b, f64 ? DBL_MAX : FLT_MAX));
    if (r.given) finite = bounds_and(b, finite, bounds_not(b, x->value[r.given->id].is.lo));
    is.lo = bounds_choose(b, finite, ir_emit2(b, OP_fmax, row.lo, is.lo), row.lo);
    is.hi = bounds_choose(b, finite, ir_emit2(b, OP_fmin, row.hi, is.hi), row.hi);
    return is;
}

/* Is i the mix p + t * (q - p), contracted or not, by a t = v - floor(v)? Returns q, or NULL. */
static const Inst *mixed_with(const Boxes *x, const Inst *i, const Inst **p, Remainder *r) {
    const Inst *product = i->op == OP_ffma ? i : i->op == OP_fadd ? i->args[1] : NULL;
    *p = i->op == OP_ffma ? i->args[2] : i->args[0];
    if (!product || (product != i && product->op != OP_fmul)) return NULL;
    for (int k = 0; k < 2; k++) {
        const Inst *t = product->args[k], *d = product->args[1 - k];
        bool between = d->op == OP_fsub && d->args[1] == *p && t->op == OP_fsub;
        if (between && find(x, t, r) && !r->y && r->rounding == OP_ffloor) return d->args[0];
    }
    return NULL;
}

Bound bounds_mix(const Boxes *x, Builder *b, const Inst *i, Bound row) {
    Remainder r;
    const Inst *from, *to = mixed_with(x, i, &from, &r);
    if (!to) return row;
    bool f64 = b->fn->precision == PREC_F64;
    Bound is = ir_bound_hull(b, x->value[from->id].is, x->value[to->id].is);
    /* Of |p| and |q|: the difference rounds, the product and the sum; half as much would do. */
    Inst *slack = ir_emit2(b, OP_fmul, magnitude(b, is), ir_constf(b, 8 * (f64 ? DBL_EPSILON : FLT_EPSILON)));
    slack = ir_emit2(b, OP_fmax, slack, ir_constf(b, f64 ? DBL_MIN : FLT_MIN));
    Inst *finite = bounds_op2(b, OP_flt, magnitude(b, row), ir_constf(b, f64 ? DBL_MAX : FLT_MAX));
    if (r.given) finite = bounds_and(b, finite, bounds_not(b, x->value[r.given->id].is.lo));
    is.lo = ir_emit2(b, OP_fmax, row.lo, ir_emit2(b, OP_fsub, is.lo, slack));
    is.hi = ir_emit2(b, OP_fmin, row.hi, ir_emit2(b, OP_fadd, is.hi, slack));
    return (Bound){bounds_choose(b, finite, is.lo, row.lo), bounds_choose(b, finite, is.hi, row.hi)};
}
