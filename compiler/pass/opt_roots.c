/* Comparisons under [Disc] without flat sides and multiple roots: max(v, 0) > 0 becomes v > 0, and so do v*v*v > 0,
 * sqrt(v) > 0, cbrt(v) > 0, |v| + v > 0 and acos(1 - v) > 0; and the distance of a box, which inside and outside is of
 * two formulas, becomes the greatest of its sides. Where g is flat on one side of its root, or its slope at
 * the root is 0 or infinite, there is no velocity to be had from it, and no bound of its gradient that leaves 0 out.
 *
 * The decision changes with g, or the sides of g's root would decide alike where one of the two is rounded: by rounding
 * (v*v*v underflows, smoothstep reaches 1 early), and on points without an area. So the pass runs once, on the primal.
 * Rules that lead nowhere by themselves (v + 1 > 1 is v > 0) are taken back unless one that does follows. */
#include <math.h>

#include "compiler/ir/range.h"
#include "compiler/pass/walk.h"

typedef struct Roots {
    Builder b;
    const IrRange *range; /* by id, of the instructions that were there before */
    bool strict;          /* the decision is < or >: what is not a number is not on the half line */
} Roots;

/* The half line v > c, or v < c with below. */
typedef struct Half {
    Inst *v;
    double c;
    bool below;
    uint32_t gain, depth; /* rules applied that mend something, and steps */
} Half;

enum { MOST_FACTORS = 16, MOST_DEPTH = 64 };

static bool number(const Inst *i, double *v) {
    if (i->op == OP_constf) *v = i->imm.f;
    return i->op == OP_constf && isfinite(i->imm.f);
}

static bool zero(const Inst *i) { return i->op == OP_constf && i->imm.f == 0; }

static bool above(const Roots *r, const Inst *i, double least) { return r->range[i->id].lo >= least; }

static void flip(Half *h) { h->c = -h->c, h->below = !h->below; }

/* ---- products, compared with 0: only the signs of their factors count */
typedef struct Product {
    Inst *factor[MOST_FACTORS];
    uint32_t times[MOST_FACTORS], n;
    bool negative, full;
} Product;

static void add_factor(Product *p, Inst *v, uint32_t times) {
    double c;
    if (v->op == OP_fmul) {
        add_factor(p, v->args[0], times), add_factor(p, v->args[1], times);
        return;
    }
    if (v->op == OP_fneg) {
        p->negative ^= times & 1;
        add_factor(p, v->args[0], times);
        return;
    }
    if (v->op == OP_fpow && number(v->args[1], &c) && c > 0 && c <= 1024 && c == floor(c)) {
        add_factor(p, v->args[0], times * (uint32_t)c);
        return;
    }
    if (number(v, &c) && c != 0) {
        p->negative ^= (times & 1) && c < 0;
        return;
    }
    for (uint32_t i = 0; i < p->n; i++)
        if (p->factor[i] == v) {
            p->times[i] += times;
            return;
        }
    if (p->n == MOST_FACTORS) p->full = true;
    else p->factor[p->n] = v, p->times[p->n++] = times;
}

/* Even powers and what is positive go, odd powers become the first; of what is never negative one is kept, since
 * without it nothing may be left that changes sign. */
static bool product_rule(Roots *r, Half *h) {
    Product p = {0};
    add_factor(&p, h->v, 1);
    uint32_t gain = 0, kept = 0;
    for (uint32_t i = 0; i < p.n; i++) {
        bool never_negative = above(r, p.factor[i], 0);
        if (r->range[p.factor[i]->id].lo > 0 || (!never_negative && p.times[i] % 2 == 0)) {
            gain += p.times[i] > 1;
            continue;
        }
        gain += p.times[i] > 1;
        p.factor[kept++] = p.factor[i];
    }
    if (p.full || !kept || (!gain && kept > 1)) return false;
    Inst *v = p.factor[0];
    for (uint32_t i = 1; i < kept; i++) v = ir_emit2(&r->b, OP_fmul, v, p.factor[i]);
    if (v == h->v) return false;
    h->v = v, h->gain += gain, h->below ^= p.negative;
    return true;
}

/* t*t * (3 - 2*t) with t in [0, 1] rises, and is flat at both ends. */
static Inst *smoothstep_of(const Roots *r, const Inst *v) {
    double three, two;
    if (v->op != OP_fmul || v->args[0]->op != OP_fmul || v->args[1]->op != OP_fsub) return NULL;
    Inst *t = v->args[0]->args[0];
    const Inst *line = v->args[1], *twice = line->args[1];
    bool is = v->args[0]->args[1] == t && number(line->args[0], &three) && three == 3 && twice->op == OP_fmul &&
              ((number(twice->args[0], &two) && twice->args[1] == t) ||
               (number(twice->args[1], &two) && twice->args[0] == t)) &&
              two == 2;
    return is && above(r, t, 0) && r->range[t->id].hi <= 1 ? t : NULL;
}

/* ---- minima and maxima */
static Half reduced(Roots *r, Half h);
static Inst *function_of(Roots *r, Half h, bool positive);

/* max(u, w) > c where u > c or w > c, and < c where both are; min likewise: of the two half lines the greater or the
 * lesser function. */
static bool either(Roots *r, Half *h, Inst *u, Inst *w, bool greater) {
    Half of_u = reduced(r, (Half){u, h->c, h->below, 0, h->depth + 1}),
         of_w = reduced(r, (Half){w, h->c, h->below, 0, h->depth + 1});
    uint32_t gain = of_u.gain + of_w.gain;
    if (!gain) return false;
    Inst *x = function_of(r, of_u, true), *y = function_of(r, of_w, true);
    *h = (Half){ir_emit2(&r->b, greater ? OP_fmax : OP_fmin, x, y), 0, false, h->gain + gain, MOST_DEPTH};
    return true;
}

static bool extremum_rule(Roots *r, Half *h) {
    Inst *u = h->v->args[0], *w = h->v->args[1];
    bool greater = h->v->op == OP_fmax;
    double k;
    if (number(u, &k)) u = w;
    else if (!number(w, &k)) return either(r, h, u, w, greater != h->below);
    /* The constant decides by itself, for ever: there is no boundary. */
    if (greater ? (h->below ? k >= h->c : k > h->c) : (h->below ? k < h->c : k <= h->c)) return false;
    h->v = u, h->gain++;
    return true;
}

/* max(u, w) - w is positive where u - w is, and its kin likewise. */
static bool difference_rule(Roots *r, Half *h) {
    for (uint32_t side = 0; side < 2 && h->c == 0; side++) {
        const Inst *m = h->v->args[side];
        Inst *w = h->v->args[1 - side];
        if ((m->op != OP_fmax && m->op != OP_fmin) || (m->args[0] != w && m->args[1] != w)) continue;
        if (((m->op == OP_fmax) == (side == 0)) == h->below) continue; /* it is never on that side of 0 */
        Inst *u = m->args[m->args[0] == w];
        h->v = side == 0 ? ir_emit2(&r->b, OP_fsub, u, w) : ir_emit2(&r->b, OP_fsub, w, u);
        h->gain++, h->depth = MOST_DEPTH;
        return true;
    }
    return false;
}

/* |w| + w is positive where w is, |w| - w where -w is; on the other side of w = 0 they are 0. */
static bool magnitude_rule(Half *h) {
    bool minus = h->v->op == OP_fsub;
    for (uint32_t side = 0; side < 2 && h->c == 0; side++) {
        const Inst *m = h->v->args[side];
        Inst *w = h->v->args[1 - side];
        if (m->op != OP_fabs || m->args[0] != w) continue;
        if (h->below != (minus && side == 1)) continue; /* it is never on that side of 0 */
        h->v = w, h->gain++;
        if (minus && side == 0) h->below = true;
        return true;
    }
    return false;
}

/* length(): 0 where its square is 0. */
static bool is_length(const Inst *v) {
    return v->op == OP_fsel && v->args[0]->op == OP_feq && v->args[2]->op == OP_fsqrt &&
           v->args[0]->args[0] == v->args[2]->args[0] && zero(v->args[0]->args[1]) && zero(v->args[1]);
}

/* ---- distances of boxes: length(max(d, 0)) + min(max(d.x, d.y), 0) */
typedef struct Leaves {
    const Inst *leaf[MOST_FACTORS];
    uint32_t n;
    bool full;
} Leaves;

static void add_leaves(Leaves *l, const Inst *v) {
    if (v->op == OP_fmax) {
        add_leaves(l, v->args[0]), add_leaves(l, v->args[1]);
        return;
    }
    for (uint32_t i = 0; i < l->n; i++)
        if (l->leaf[i] == v) return;
    if (l->n == MOST_FACTORS) l->full = true;
    else l->leaf[l->n++] = v;
}

/* The values of which one must be positive for v to be: lengths of what is cut off at 0. False: v is no such thing. */
static bool outside_leaves(const Inst *v, Leaves *l) {
    if (is_length(v)) v = v->args[2];
    if (v->op == OP_fsqrt) v = v->args[0];
    if (v->op == OP_fadd) return outside_leaves(v->args[0], l) && outside_leaves(v->args[1], l);
    if (v->op == OP_fmul && v->args[0] == v->args[1]) v = v->args[0];
    if (v->op != OP_fmax || (!zero(v->args[0]) && !zero(v->args[1]))) return false;
    add_leaves(l, v->args[zero(v->args[0])]);
    return true;
}

static bool same_leaves(const Leaves *a, const Leaves *b) {
    bool same = a->n == b->n && !a->full && !b->full;
    for (uint32_t i = 0; i < a->n && same; i++) {
        same = false;
        for (uint32_t k = 0; k < b->n; k++) same |= a->leaf[i] == b->leaf[k];
    }
    return same;
}

/* p + min(m, 0), where p is never negative and positive where m is: it has the sign of m. As it stands each part is
 * flat on one side of its boundary, where the other one begins. */
static bool outside_rule(Half *h) {
    for (uint32_t side = 0; side < 2 && h->c == 0; side++) {
        const Inst *in = h->v->args[1 - side];
        if (in->op != OP_fmin || (!zero(in->args[0]) && !zero(in->args[1]))) continue;
        Inst *m = in->args[zero(in->args[0])];
        Leaves of_m = {0}, of_p = {0};
        add_leaves(&of_m, m);
        if (!outside_leaves(h->v->args[side], &of_p) || !same_leaves(&of_m, &of_p)) continue;
        h->v = m, h->gain++;
        return true;
    }
    return false;
}

/* acos falls to 0 at 1, with a slope that is infinite there. */
static bool arc_rule(const Roots *r, Half *h) {
    IrRange of = r->range[h->v->args[0]->id];
    if (h->c != 0 || h->below || !(of.lo >= -1) || !(r->strict || of.hi <= 1)) return false;
    h->v = h->v->args[0], h->c = 1, h->below = true, h->gain++;
    return true;
}

/* ---- one step */
/* Roots: never below 0. */
static bool root_rule(const Roots *r, Half *h, Inst *of) {
    if (h->c != 0 || h->below || !(r->strict || above(r, of, 0))) return false;
    h->v = of, h->gain++;
    return true;
}

static bool power_rule(const Roots *r, Half *h) {
    double n;
    if (h->c != 0 || !number(h->v->args[1], &n) || !(n > 0) || n == 1) return false;
    if (n != floor(n)) return root_rule(r, h, h->v->args[0]);
    if (fmod(n, 2) == 0) return false;
    h->v = h->v->args[0], h->gain++;
    return true;
}

static bool scale_rule(const Roots *r, Half *h) {
    Inst *u = h->v->args[0], *w = h->v->args[1];
    double k;
    if (h->v->op == OP_fmul && number(u, &k)) u = w;
    else if (!number(w, &k)) {
        if (h->v->op != OP_fdiv || h->c != 0 || !(r->range[w->id].lo > 0)) return false;
        h->v = u;
        return true;
    }
    if (k == 0) return false;
    h->v = u, h->c = h->v->op == OP_fdiv ? h->c * k : h->c / k;
    if (k < 0) h->below = !h->below;
    return isfinite(h->c);
}

static bool step(Roots *r, Half *h) {
    Inst *v = h->v, *t;
    double k;
    if (h->depth++ >= MOST_DEPTH) return false;
    switch ((int)v->op) {
    case OP_fneg: h->v = v->args[0], flip(h); return true;
    case OP_fadd:
        for (uint32_t a = 0; a < 2; a++)
            if (number(v->args[a], &k)) {
                h->v = v->args[1 - a], h->c -= k;
                return true;
            }
        if (magnitude_rule(h) || outside_rule(h)) return true;
        /* A sum of what is never negative is positive where one of them is. */
        return h->c == 0 && !h->below && above(r, v->args[0], 0) && above(r, v->args[1], 0) &&
               either(r, h, v->args[0], v->args[1], true);
    case OP_fsub:
        if (number(v->args[1], &k)) {
            h->v = v->args[0], h->c += k;
            return true;
        }
        if (number(v->args[0], &k)) {
            h->v = v->args[1], h->c -= k, flip(h);
            return true;
        }
        return difference_rule(r, h) || magnitude_rule(h);
    case OP_fmin:
    case OP_fmax: return extremum_rule(r, h);
    case OP_fmul:
        if (h->c == 1 && h->below && (t = smoothstep_of(r, v))) {
            h->v = t, h->gain++;
            return true;
        }
        return h->c == 0 ? product_rule(r, h) : scale_rule(r, h);
    case OP_fdiv: return scale_rule(r, h);
    case OP_fsqrt: return root_rule(r, h, v->args[0]);
    case OP_fsel:
        if (!is_length(v)) return false;
        h->v = v->args[2];
        return true;
    case OP_facos: return arc_rule(r, h);
    case OP_fcbrt:
        if (h->c != 0) return false;
        h->v = v->args[0], h->gain++;
        return true;
    case OP_fpow: return power_rule(r, h);
    default: return false;
    }
}

static Half reduced(Roots *r, Half h) {
    Half best = h;
    while (step(r, &h))
        if (h.gain > best.gain) best = h;
    return best;
}

/* A function that is positive on the half line, or negative there. */
static Inst *function_of(Roots *r, Half h, bool positive) {
    if (h.c == 0) return positive != h.below ? h.v : ir_emit1(&r->b, OP_fneg, h.v);
    Inst *c = ir_constf(&r->b, h.c);
    return positive != h.below ? ir_emit2(&r->b, OP_fsub, h.v, c) : ir_emit2(&r->b, OP_fsub, c, h.v);
}

/* Does the decision ask whether g > 0 (or not), rather than g < 0? False in *known where g is not the difference of
 * what is compared: it is another function already. */
static bool asks_positive(const Inst *decision, const Inst *g, bool *known) {
    const Inst *a = decision->args[0], *b = decision->args[1];
    *known = true;
    bool less = decision->op == OP_flt;
    if (g->op == OP_fsub && g->args[0] == a && g->args[1] == b) return !less;
    if (g->op == OP_fsub && g->args[0] == b && g->args[1] == a) return less;
    if (g == a && zero(b)) return !less;
    if (g == b && zero(a)) return less;
    *known = false;
    return false;
}

static bool roots_in(Fn *fn, Block *b, const IrRange *range) {
    bool changed = false;
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        for (uint32_t k = 0; k < i->nregions; k++) changed |= roots_in(fn, i->region[k], range);
        if (i->op != OP_site || (i->args[0]->op != OP_flt && i->args[0]->op != OP_fle)) continue;
        bool known, positive = asks_positive(i->args[0], i->args[1], &known);
        if (!known) continue;
        bool strict = i->args[0]->op == OP_flt;
        Roots r = {ir_before(fn, i), range, strict};
        r.b.span = i->span;
        Half h = reduced(&r, (Half){.v = i->args[1], .below = !positive});
        if (!h.gain) continue;
        Inst *c = ir_constf(&r.b, h.c);
        bool swap = h.below != strict; /* v > c is c < v; not v > c is v <= c */
        ir_replace_arg(i, 0, ir_emit2(&r.b, (Op)i->args[0]->op, swap ? c : h.v, swap ? h.v : c));
        ir_replace_arg(i, 1, function_of(&r, h, positive));
        changed = true;
    }
    return changed;
}

bool opt_roots(PassCtx *ctx, Fn *fn) {
    Arena *scratch = &ctx->session->scratch;
    ArenaMark m = arena_mark(scratch);
    uint32_t n = ir_number(fn);
    IrRange *range = ARENA_ARRAY(scratch, IrRange, n + 1);
    ir_ranges(fn, scratch, NULL, range);
    bool changed = roots_in(fn, fn->body, range);
    arena_reset(scratch, m);
    return changed;
}
