/* Comparisons under [Disc] with a level, a value that is the same everywhere: exp(-u*u / (w*w)) > 0.3 becomes
 * u*u < -log(0.3) * (w*w), and that |u| < sqrt(...), of which opt_bands makes two faces.
 *
 * exp, tanh, 1/(1 + v) and smoothstep change the sign of g nowhere and its size a lot: where such a function is as good
 * as flat, neither the slope of g nor bounds of it tell that a ridge is near, and a thin one hides between lines and in
 * cells that nothing can close. So functions that only rise, or only fall, are taken from v and their inverses to the
 * level, from outside in, as far as it leads: to a magnitude or a square, or past a function that bends.
 *
 * The decision changes by rounding, as in opt_roots.c: the pass runs once, on the primal. */
#include <math.h>

#include "compiler/ir/range.h"
#include "compiler/pass/depend.h"
#include "compiler/pass/pass.h"
#include "compiler/pass/walk.h"

enum { MOST_STEPS = 64, MOST_FACTORS = 8, DEEP = 4 };
#define NEVER 1e30 /* beyond every value of v that matters, in f32 too: a level that is not reached */

typedef struct Levels {
    Builder b;
    const IrRange *range; /* by id, of what was there before, */
    const Depend *on;     /* likewise */
    uint32_t known;       /* ids below this */
} Levels;

/* A level: a number, or `at`. */
typedef struct Level {
    double c;
    Inst *at; /* NULL: c */
} Level;

/* v < level, or v > level with above; the other way round where `flip` holds, which is the same everywhere too. */
typedef struct Side {
    Inst *v, *flip;
    Level level;
    bool above;
    uint32_t gain; /* steps that mend something */
} Side;

static bool number(const Inst *i, double *c) {
    if (i->op == OP_constf) *c = i->imm.f;
    return i->op == OP_constf && isfinite(i->imm.f);
}

static Level level_of(Inst *i) {
    double c;
    return number(i, &c) ? (Level){.c = c} : (Level){.at = i};
}

static Inst *emit(Levels *s, Level l) { return l.at ? l.at : ir_constf(&s->b, l.c); }

static Level combine(Levels *s, Op op, Level a, Level b) {
    if (a.at || b.at) return (Level){.at = ir_emit2(&s->b, op, emit(s, a), emit(s, b))};
    return (Level){.c = op == OP_fadd ? a.c + b.c : op == OP_fsub ? a.c - b.c : op == OP_fmul ? a.c * b.c : a.c / b.c};
}

static bool is_level(const Levels *s, const Inst *i) { return !(s->on[i->id].on & (DEPENDS_X | DEPENDS_RAND)); }

/* ---- signs */
static bool never_negative(const Levels *s, const Inst *i, uint32_t depth) {
    if (i->id < s->known && s->range[i->id].lo >= 0) return true;
    if (!depth) return false;
    if (i->op == OP_fmul && i->args[0] == i->args[1]) return true;
    if (i->op != OP_fadd && i->op != OP_fmul && i->op != OP_fdiv) return false;
    return never_negative(s, i->args[0], depth - 1) && never_negative(s, i->args[1], depth - 1);
}

static bool positive(const Levels *s, const Inst *i) {
    if (i->id < s->known && s->range[i->id].lo > 0) return true;
    for (uint32_t a = 0; a < 2 && i->op == OP_fadd; a++)
        if (i->args[a]->id < s->known && s->range[i->args[a]->id].lo > 0 && never_negative(s, i->args[1 - a], DEEP))
            return true;
    return false;
}

/* +1, -1, or 0 where it is not known. 0 itself counts as positive: what is divided by it is no number, or never
 * reached. */
static int sign_of(const Levels *s, Level l) {
    if (!l.at) return l.c > 0 ? 1 : l.c < 0 ? -1 : 0;
    if (l.at->id < s->known && s->range[l.at->id].hi < 0) return -1;
    return never_negative(s, l.at, DEEP) ? 1 : 0;
}

/* The two sides change places where l is negative. */
static bool turn_by(Levels *s, Side *h, Level l) {
    int sign = sign_of(s, l);
    if (!l.at && !sign) return false;
    if (sign < 0) h->above = !h->above;
    if (sign) return true;
    Inst *negative = ir_emit2(&s->b, OP_flt, l.at, ir_constf(&s->b, 0));
    h->flip = h->flip ? ir_emit2(&s->b, OP_bxor, h->flip, negative) : negative;
    return true;
}

/* The level becomes what a function of positive numbers makes of it, or where it is not positive one that is never
 * reached: values are positive. False: it is a number, and never reached. */
static bool where_positive(Levels *s, Level *l, Op op, double power) {
    if (!l->at) {
        bool reached = l->c > 0;
        l->c = op == OP_flog ? log(l->c) : op == OP_flog2 ? log2(l->c) : pow(l->c, power);
        return reached;
    }
    bool sure = l->at->id < s->known && s->range[l->at->id].lo > 0;
    Inst *of = sure ? l->at : ir_emit2(&s->b, OP_fmax, l->at, ir_constf(&s->b, 0x1p-100));
    Inst *v = op != OP_fpow  ? ir_emit1(&s->b, op, of)
              : power == 2   ? ir_emit2(&s->b, OP_fmul, of, of)
              : power == 0.5 ? ir_emit1(&s->b, OP_fsqrt, of)
                             : ir_emit2(&s->b, OP_fpow, of, ir_constf(&s->b, power));
    if (sure) l->at = v;
    else
        l->at =
            ir_emit3(&s->b, OP_fsel, ir_emit2(&s->b, OP_flt, ir_constf(&s->b, 0), l->at), v, ir_constf(&s->b, -NEVER));
    return true;
}

/* ---- products */
typedef struct Product {
    Inst *factor[MOST_FACTORS];
    uint32_t n, scales; /* of what changes; of what is the same everywhere */
    Level scale;
    bool full;
} Product;

static void add_factor(Levels *s, Product *p, Inst *v) {
    if (is_level(s, v)) p->scale = combine(s, OP_fmul, p->scale, level_of(v)), p->scales++;
    else if (v->op == OP_fmul) add_factor(s, p, v->args[0]), add_factor(s, p, v->args[1]);
    else if (v->op == OP_fneg) p->scale = combine(s, OP_fmul, p->scale, (Level){.c = -1}), add_factor(s, p, v->args[0]);
    else if (v->op == OP_fdiv && is_level(s, v->args[1])) {
        p->scale = combine(s, OP_fdiv, p->scale, level_of(v->args[1])), p->scales++;
        add_factor(s, p, v->args[0]);
    } else if (p->n == MOST_FACTORS) p->full = true;
    else p->factor[p->n++] = v;
}

/* |u| beside b: the end. */
static bool magnitude(Levels *s, Side *h, Inst *u) {
    h->v = ir_emit1(&s->b, OP_fabs, u), h->gain++;
    return false;
}

static bool product_rule(Levels *s, Side *h) {
    Product p = {.scale = {.c = 1}};
    add_factor(s, &p, h->v);
    bool square = p.n == 2 && p.factor[0] == p.factor[1] && !never_negative(s, p.factor[0], DEEP);
    if (p.full || (!square && (p.n != 1 || p.factor[0] == h->v))) return false;
    if (!turn_by(s, h, p.scale)) return false;
    if (p.scale.at || p.scale.c != 1) h->level = combine(s, OP_fdiv, h->level, p.scale);
    h->v = p.factor[0];
    if (!square) return true;
    Level most = h->level.at && sign_of(s, h->level) <= 0
                     ? (Level){.at = ir_emit2(&s->b, OP_fmax, h->level.at, ir_constf(&s->b, 0))}
                     : h->level;
    if (!most.at && most.c < 0) return false; /* it always decides alike */
    h->level = most.at ? (Level){.at = ir_emit1(&s->b, OP_fsqrt, most.at)} : (Level){.c = sqrt(most.c)};
    if (!(s->range[h->v->id].hi <= 0)) return magnitude(s, h, h->v);
    h->v = ir_emit1(&s->b, OP_fneg, h->v), h->gain++;
    return false; /* of what is new nothing is known */
}

/* k / v of what is positive. */
static bool reciprocal_rule(Levels *s, Side *h) {
    Inst *v = h->v->args[1];
    if (!is_level(s, h->v->args[0]) || !positive(s, v) || !turn_by(s, h, h->level)) return false;
    h->level = combine(s, OP_fdiv, level_of(h->v->args[0]), h->level);
    h->v = v, h->above = !h->above, h->gain++;
    return true;
}

/* ---- one step */
static bool sum_rule(Levels *s, Side *h) {
    Op op = (Op)h->v->op;
    for (uint32_t a = 0; a < 2; a++) {
        if (!is_level(s, h->v->args[a])) continue;
        Level k = level_of(h->v->args[a]);
        if (op == OP_fsub && a == 0) h->level = combine(s, OP_fsub, k, h->level), h->above = !h->above;
        else h->level = combine(s, op == OP_fadd ? OP_fsub : OP_fadd, h->level, k);
        h->v = h->v->args[1 - a];
        return true;
    }
    return false;
}

/* One side of the level is cut off by a number that is not on that side. */
static bool extremum_rule(Side *h) {
    double k;
    uint32_t a = number(h->v->args[0], &k) ? 1 : 0;
    if (!number(h->v->args[1 - a], &k) || h->level.at || (h->v->op == OP_fmax ? k >= h->level.c : k <= h->level.c))
        return false;
    h->v = h->v->args[a];
    return true;
}

/* t*t * (3 - 2*t) with t in [0, 1] rises; between its ends its inverse is a cosine's third. */
static bool smoothstep_rule(Levels *s, Side *h) {
    const Inst *v = h->v;
    double three, two;
    for (uint32_t a = 0; a < 2 && !h->level.at; a++) {
        const Inst *square = v->args[a], *line = v->args[1 - a];
        if (square->op != OP_fmul || square->args[0] != square->args[1] || line->op != OP_fsub) continue;
        Inst *t = square->args[0];
        const Inst *twice = line->args[1];
        bool is = number(line->args[0], &three) && three == 3 && twice->op == OP_fmul &&
                  ((number(twice->args[0], &two) && twice->args[1] == t) ||
                   (number(twice->args[1], &two) && twice->args[0] == t)) &&
                  two == 2;
        if (!is || !(h->level.c > 0 && h->level.c < 1) || !(s->range[t->id].lo >= 0 && s->range[t->id].hi <= 1))
            continue;
        h->level.c = 0.5 - sin(asin(1 - 2 * h->level.c) / 3);
        h->v = t, h->gain++;
        return true;
    }
    return false;
}

static bool power_rule(Levels *s, Side *h) {
    Inst *of = h->v->args[0];
    double n;
    if (!number(h->v->args[1], &n) || !(n > 0)) return false;
    bool even = n == floor(n) && fmod(n, 2) == 0;
    if (!even && !never_negative(s, of, DEEP)) return false;
    if (!where_positive(s, &h->level, OP_fpow, 1 / n)) return false;
    h->v = of, h->gain++;
    return even && !never_negative(s, of, DEEP) ? magnitude(s, h, of) : true;
}

/* The inverse of a function that rises everywhere: of levels that are numbers it takes. */
static bool number_rule(Side *h, double inverse) {
    if (h->level.at || !isfinite(inverse)) return false;
    h->level.c = inverse, h->v = h->v->args[0], h->gain++;
    return true;
}

static bool step(Levels *s, Side *h) {
    Inst *v = h->v;
    if (!h->level.at && !(fabs(h->level.c) < NEVER)) return false;
    switch ((int)v->op) {
    case OP_fneg: return product_rule(s, h);
    case OP_fmul: return smoothstep_rule(s, h) || product_rule(s, h);
    case OP_fdiv: return is_level(s, v->args[1]) ? product_rule(s, h) : reciprocal_rule(s, h);
    case OP_fadd:
    case OP_fsub: return sum_rule(s, h);
    case OP_fmin:
    case OP_fmax: return extremum_rule(h);
    case OP_fabs: h->gain++; return false;
    case OP_fexp:
    case OP_fexp2:
        if (!where_positive(s, &h->level, v->op == OP_fexp ? OP_flog : OP_flog2, 1)) return false;
        h->v = v->args[0], h->gain++;
        return true;
    case OP_fsqrt:
        if (!never_negative(s, v->args[0], DEEP) || !where_positive(s, &h->level, OP_fpow, 2)) return false;
        h->v = v->args[0];
        return true;
    case OP_flog: return never_negative(s, v->args[0], DEEP) && number_rule(h, exp(h->level.c));
    case OP_fpow: return power_rule(s, h);
    case OP_fcbrt: return number_rule(h, h->level.c * h->level.c * h->level.c);
    case OP_ftanh: return number_rule(h, atanh(h->level.c));
    case OP_fatan: return fabs(h->level.c) < 1.5 && number_rule(h, tan(h->level.c));
    default: return false;
    }
}

static Side reduced(Levels *s, Side h) {
    Side best = h;
    for (uint32_t steps = 0; steps < MOST_STEPS; steps++) {
        bool more = step(s, &h);
        if (h.gain > best.gain) best = h;
        if (!more) break;
    }
    return best;
}

/* Which operand is compared with a level? The difference from 0 that stands for a comparison is one of its own. */
static bool find(const Levels *s, const Inst *cmp, Side *h) {
    Inst *p = cmp->args[0], *q = cmp->args[1];
    if (is_level(s, p) == is_level(s, q)) return false;
    bool above = is_level(s, p);
    *h = (Side){.v = above ? q : p, .level = level_of(above ? p : q), .above = above};
    return true;
}

/* opt_bands.c has this one, to the bit. */
static bool is_band(const Side *h) {
    const Inst *v = h->v, *b = h->level.at;
    return v->op == OP_fabs ||
           (v->op == OP_fmul && v->args[0] == v->args[1] && b && b->op == OP_fmul && b->args[0] == b->args[1]);
}

/* Is g the difference of what is compared, and of which order? */
static bool rises_outside(const Inst *cmp, const Inst *g, bool *known) {
    const Inst *p = cmp->args[0], *q = cmp->args[1];
    double c;
    *known = true;
    if (g->op == OP_fsub && g->args[0] == p && g->args[1] == q) return true;
    if (g->op == OP_fsub && g->args[0] == q && g->args[1] == p) return false;
    if (g == p && number(q, &c) && c == 0) return true;
    if (g == q && number(p, &c) && c == 0) return false;
    *known = false;
    return false;
}

static bool levels_in(Fn *fn, Block *b, Levels *s) {
    bool changed = false;
    for (Inst *i = b->first, *next; i; i = next) {
        next = i->next;
        for (uint32_t r = 0; r < i->nregions; r++) changed |= levels_in(fn, i->region[r], s);
        if (i->op != OP_site || (i->args[0]->op != OP_flt && i->args[0]->op != OP_fle)) continue;
        const SiteInfo *info = &fn->sites[i->imm.i];
        bool known, outside = rises_outside(i->args[0], i->args[1], &known);
        Side h;
        if (!known || info->skip_loop || info->still || !find(s, i->args[0], &h) || is_band(&h)) continue;
        s->b = ir_before(fn, i), s->b.span = i->span;
        h = reduced(s, h);
        if (!h.gain) continue;
        Inst *level = emit(s, h.level), *less = h.above ? level : h.v, *more = h.above ? h.v : level;
        ir_replace_arg(i, 0, ir_emit2(&s->b, (Op)i->args[0]->op, less, more));
        ir_replace_arg(i, 1, outside ? ir_emit2(&s->b, OP_fsub, less, more) : ir_emit2(&s->b, OP_fsub, more, less));
        changed = true;
        if (!h.flip) continue;
        Builder after = ir_after(fn, i);
        after.span = i->span;
        Inst *decides = ir_emit2(&after, OP_bxor, h.flip, h.flip);
        walk_replace(fn->body, i, decides);
        ir_replace_arg(decides, 0, i);
    }
    return changed;
}

bool opt_levels(PassCtx *ctx, Fn *fn) {
    Arena *scratch = &ctx->session->scratch;
    ArenaMark m = arena_mark(scratch);
    uint32_t n = ir_number(fn);
    IrRange *range = ARENA_ARRAY(scratch, IrRange, n + 1);
    ir_ranges(fn, scratch, NULL, range);
    Levels s = {.range = range, .on = depend_values(fn, (DependOptions){0}), .known = n};
    bool changed = levels_in(fn, fn->body, &s);
    arena_reset(scratch, m);
    return changed;
}
