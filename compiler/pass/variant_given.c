/* Decisions that are given: g of an event as a function of its own where another decision changes it.
 *
 * Where `if (a) h = p;` goes before, the g of `y < h` jumps along the curve of a; where `best = min(d, best)` does, it
 * bends. Of either no bounds prove that it is one curve. But with a's decision given it is one on each side of a's
 * curve, smooth across it and beyond: two functions, of which each is the g of the program on its own side. So the edge
 * kernels have inputs that name events and, of each, the sign that its own g is to be taken to have; at the event's
 * iteration the decision is as that sign has it. With nothing given nothing changes.
 *
 * Of a rounding one of its boundaries is given, by the last loop index, which it must not need itself: it then is one
 * of the two integers beside that one, everywhere.
 *
 * Events of more than SLT_GIVEN_K loops are not given (roundings: one less), nor decisions whose g does not tell them
 * by its sign: a caller who gives one gets the g that it had. */
#include <math.h>

#include "compiler/pass/variant.h"

typedef struct Giver {
    Fn *fn;
    Inst *below[SLT_GIVEN], *edge[SLT_GIVEN]; /* of each that is given: the sign is that of g < 0; its edge */
} Giver;

static bool is_zero(const Inst *v) { return v->op == OP_constf && v->imm.f == 0; }

/* Is g p - q, as far as one can see? */
static bool is_difference(const Inst *g, const Inst *p, const Inst *q) {
    if (g->op == OP_fsub) return g->args[0] == p && g->args[1] == q;
    if (g->op == OP_fneg) return g->args[0] == q && is_zero(p);
    return g == p && is_zero(q);
}

bool variant_truth_below(const Inst *decision, const Inst *g, bool *truth) {
    if (decision->op != OP_flt && decision->op != OP_fle) return false;
    *truth = is_difference(g, decision->args[0], decision->args[1]);
    return *truth || is_difference(g, decision->args[1], decision->args[0]);
}

static bool rounds(const Giver *s, const Inst *site) {
    SiteKind kind = variant_site_info(s->fn, site)->kind;
    return kind == SITE_FLOOR || kind == SITE_CEIL || kind == SITE_ROUND || kind == SITE_TRUNC || kind == SITE_FMOD;
}

/* Is the event of this site given, and is the sign that of g < 0? boundary, if it is wanted: the largest integer that
 * is not above that of a rounding. */
static void find_given(const Giver *s, Builder *b, const Inst *site, Inst **given, Inst **below, Inst **boundary) {
    *given = *below = NULL;
    for (uint32_t j = 0; j < SLT_GIVEN; j++) {
        Inst *hit = ir_emit2(b, OP_ieq, s->edge[j], ir_consti(b, (int32_t)site->imm.i + 1));
        for (uint32_t d = 0; d + 2 < site->nargs; d++) {
            Inst *k = ir_input(b, (InputSlot)(IN_GIVEN0_K0 + SLT_GIVEN_K * j + d));
            hit = ir_emit2(b, OP_band, hit, ir_emit2(b, OP_ieq, site->args[d + 2], k));
        }
        Inst *under = ir_emit2(b, OP_band, hit, s->below[j]);
        *given = *given ? ir_emit2(b, OP_bor, *given, hit) : hit;
        *below = *below ? ir_emit2(b, OP_bor, *below, under) : under;
        if (!boundary) continue;
        Inst *k = ir_input(b, (InputSlot)(IN_GIVEN0_K0 + SLT_GIVEN_K * j + SLT_GIVEN_K - 1));
        *boundary = j ? ir_select(b, hit, k, *boundary) : k;
    }
}

/* What a rounding is below its boundary, or above. */
static Inst *rounded(Builder *b, SiteKind kind, Inst *boundary, Inst *below) {
    Inst *one = ir_consti(b, 1), *less = ir_emit2(b, OP_isub, boundary, one), *n = boundary; /* below */
    if (kind == SITE_FLOOR) n = less;
    if (kind == SITE_TRUNC || kind == SITE_FMOD)
        n = ir_select(b, ir_emit2(b, OP_ilt, boundary, ir_consti(b, 0)), boundary, less);
    return ir_emit1(b, OP_i2f, ir_select(b, below, n, ir_emit2(b, OP_iadd, n, one)));
}

/* What a minimum or its kin is where its g, the difference of its arguments in either order (a maximum of the same two
 * may have come first, and lent its edge), is below 0 or is not, and an angle where its y is; NULL: g does not tell. */
static Inst *chosen(Builder *b, const Inst *of, const Inst *g, Inst *below) {
    Inst *p = of->args[0], *q = of->nargs > 1 ? of->args[1] : NULL;
    if (of->op == OP_fatan2) { /* behind its cut, where x < 0, an angle goes on */
        Inst *turned = ir_emit2(b, OP_fatan2, ir_emit1(b, OP_fneg, p), ir_emit1(b, OP_fneg, q));
        Inst *half = ir_constf(b, M_PI);
        return ir_select(b, below, ir_emit2(b, OP_fsub, turned, half), ir_emit2(b, OP_fadd, turned, half));
    }
    if (of->op == OP_fabs) return g == p ? ir_select(b, below, ir_emit1(b, OP_fneg, p), p) : NULL;
    bool first = is_difference(g, p, q);
    if (!first && !is_difference(g, q, p)) return NULL;
    return (of->op == OP_fmin) == first ? ir_select(b, below, p, q) : ir_select(b, below, q, p);
}

static void give(const Giver *s, Inst *site) {
    SiteKind kind = variant_site_info(s->fn, site)->kind;
    bool integer = rounds(s, site);
    if (site->nargs + integer > 2 + SLT_GIVEN_K || (!integer && kind != SITE_COMPARE)) return;
    Inst *of = site->args[0], *given, *below, *value, *boundary = NULL;
    bool truth = true, choice = of->op == OP_fmin || of->op == OP_fmax || of->op == OP_fabs || of->op == OP_fatan2;
    if (site->op == OP_site ? !variant_truth_below(of, site->args[1], &truth) : !choice && !integer) return;
    Builder b = ir_before(s->fn, site);
    b.span = site->span;
    find_given(s, &b, site, &given, &below, integer ? &boundary : NULL);
    if (integer) value = rounded(&b, kind, boundary, below);
    else if (site->op == OP_siten) value = chosen(&b, of, site->args[1], below);
    else value = truth ? below : ir_emit1(&b, OP_bnot, below);
    if (value) ir_replace_arg(site, 0, ir_select(&b, given, value, of));
}

static void give_block(const Giver *s, Block *body) {
    for (Inst *i = body->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) give_block(s, i->region[r]);
        if (variant_is_site(i)) give(s, i);
    }
}

void variant_take_given(Fn *fn) {
    Giver s = {.fn = fn};
    if (!fn->body->first) return;
    Builder b = ir_before(fn, fn->body->first);
    for (uint32_t j = 0; j < SLT_GIVEN; j++) {
        Inst *code = ir_input(&b, (InputSlot)(IN_GIVEN0 + j)), *one = ir_consti(&b, 1);
        s.edge[j] = ir_emit2(&b, OP_ishr, code, one);
        s.below[j] = ir_emit2(&b, OP_ine, ir_emit2(&b, OP_iand, code, one), ir_consti(&b, 0));
    }
    give_block(&s, fn->body);
}
