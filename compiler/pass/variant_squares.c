/* g of a length in the edge kernels: r - sqrt(q), where q is of second degree in the position and r does not change
 * with it, becomes (r |r| - q) / (2 |r|). Both have the same sign everywhere, and on the curve the same gradient.
 *
 * Of a quadric bounds know all, its second derivatives being constant: cells tell its curve and its corners by formulas
 * (cells_arc.c), where of a square root they search. So length(x - c) < r costs what dot(x - c, x - c) < r*r does. In
 * f64 alone, as quadrics are. What multiplies the root may be negative: with s |s| in the place of s signs are kept.
 *
 * Decisions stay as they are written, and so does g of the site kernels: lines find where the program decides otherwise
 * to the last float, where the two part. */
#include "compiler/ir/range.h"
#include "compiler/pass/depend.h"
#include "compiler/pass/variant.h"

enum { MOST_STEPS = 256, MOST_LEVELS = 8, UNKNOWN = 3 };

typedef struct Squares {
    const Depend *on; /* by id, of what was there before */
    const IrRange *range;
} Squares;

/* g = times * root + rest, each of which is a product or a sum of what is the same everywhere. */
typedef struct Root {
    Inst *of;                  /* what the root is of; NULL: none was found */
    Inst *factor[MOST_LEVELS]; /* of times, */
    bool divides[MOST_LEVELS]; /* by the factor */
    Inst *term[MOST_LEVELS];   /* of rest, */
    bool less[MOST_LEVELS];    /* subtracted */
    uint32_t nfactors, nterms;
    bool negative, failed;
} Root;

static bool is_level(const Squares *s, const Inst *i) { return !(s->on[i->id].on & (DEPENDS_X | DEPENDS_RAND)); }

/* The degree in the position, UNKNOWN where it is none, above 2, or not found in `steps`. */
static uint32_t degree(const Squares *s, const Inst *i, uint32_t *steps) {
    if (is_level(s, i)) return 0;
    if (i->op == OP_input && i->imm.i >= IN_X0 && i->imm.i <= IN_X2) return 1;
    bool sum = i->op == OP_fadd || i->op == OP_fsub, product = i->op == OP_fmul || i->op == OP_ffma;
    if (!*steps || !(sum || product || i->op == OP_fneg || i->op == OP_fdiv)) return UNKNOWN;
    --*steps;
    uint32_t of[3] = {0};
    for (uint32_t a = 0; a < i->nargs; a++)
        if ((of[a] = degree(s, i->args[a], steps)) == UNKNOWN) return UNKNOWN;
    if (i->op == OP_fdiv && of[1]) return UNKNOWN;
    if (!product) return of[0] > of[1] ? of[0] : of[1];
    uint32_t both = of[0] + of[1] < UNKNOWN ? of[0] + of[1] : UNKNOWN;
    return both > of[2] ? both : of[2];
}

static bool is_zero(const Inst *i) { return i->op == OP_constf && i->imm.f == 0; }

/* q of sqrt(q), and of a length, which is 0 where q is: of second degree, and never negative. NULL: it is neither. */
static Inst *square_of(const Squares *s, const Inst *i) {
    if (is_level(s, i)) return NULL;
    const Inst *at = i->op == OP_fsel ? i->args[0] : NULL, *root = at ? i->args[2] : i;
    if (root->op != OP_fsqrt) return NULL;
    Inst *q = root->args[0];
    if (at && !(at->op == OP_feq && at->args[0] == q && is_zero(at->args[1]) && is_zero(i->args[1]))) return NULL;
    uint32_t steps = MOST_STEPS;
    return s->range[q->id].lo >= 0 && degree(s, q, &steps) < UNKNOWN ? q : NULL;
}

/* A product with one root. */
static void read_product(const Squares *s, Inst *i, Root *r);
static void read_factors(const Squares *s, Inst *p, Inst *q, bool divided, Root *r) {
    bool second = divided || is_level(s, q);
    Inst *level = second ? q : p;
    r->failed = !is_level(s, level) || r->nfactors == MOST_LEVELS;
    if (r->failed) return;
    r->factor[r->nfactors] = level, r->divides[r->nfactors++] = divided;
    read_product(s, second ? p : q, r);
}

static void read_product(const Squares *s, Inst *i, Root *r) {
    r->of = square_of(s, i);
    if (r->of) return;
    if (i->op == OP_fmul || i->op == OP_fdiv) {
        read_factors(s, i->args[0], i->args[1], i->op == OP_fdiv, r);
    } else if (i->op == OP_fneg) {
        r->negative = !r->negative;
        read_product(s, i->args[0], r);
    } else {
        r->failed = true;
    }
}

/* A sum in which one term has the root; negative: all of it is subtracted. */
static void read_sum(const Squares *s, Inst *i, bool negative, Root *r) {
    if (r->failed) return;
    if (is_level(s, i)) {
        r->failed = r->nterms == MOST_LEVELS;
        if (!r->failed) r->term[r->nterms] = i, r->less[r->nterms++] = negative;
    } else if (i->op == OP_fadd || i->op == OP_fsub) {
        read_sum(s, i->args[0], negative, r);
        read_sum(s, i->args[1], negative != (i->op == OP_fsub), r);
    } else if (i->op == OP_fneg) {
        read_sum(s, i->args[0], !negative, r);
    } else if (r->of) {
        r->failed = true;
    } else {
        r->negative = negative;
        if (i->op == OP_ffma) read_factors(s, i->args[0], i->args[1], false, r), read_sum(s, i->args[2], negative, r);
        else read_product(s, i, r);
    }
}

/* v |v| */
static Inst *signed_square(Builder *b, Inst *v) { return ir_emit2(b, OP_fmul, v, ir_emit1(b, OP_fabs, v)); }

/* A radius of 0 is a point, on which nothing lies. */
static Inst *squared(Builder *b, const Root *r) {
    Inst *q = r->of, *rest = NULL;
    for (uint32_t f = 0; f < r->nfactors; f++)
        q = ir_emit2(b, r->divides[f] ? OP_fdiv : OP_fmul, q, signed_square(b, r->factor[f]));
    for (uint32_t t = 0; t < r->nterms; t++) {
        Inst *term = r->less[t] && !t ? ir_emit1(b, OP_fneg, r->term[t]) : r->term[t];
        rest = rest ? ir_emit2(b, r->less[t] ? OP_fsub : OP_fadd, rest, term) : term;
    }
    Inst *size = ir_emit1(b, OP_fabs, rest), *half = ir_constf(b, 0.5), *zero = ir_constf(b, 0);
    Inst *by = ir_emit3(b, OP_fsel, ir_emit2(b, OP_feq, rest, zero), half, ir_emit2(b, OP_fdiv, half, size));
    return ir_emit2(b, r->negative ? OP_fsub : OP_fadd, ir_emit2(b, OP_fmul, half, rest), ir_emit2(b, OP_fmul, q, by));
}

static bool squares_in(Fn *fn, const Block *body, const Squares *s) {
    bool changed = false;
    for (Inst *i = body->first; i; i = i->next) {
        for (uint32_t r = 0; r < i->nregions; r++) changed |= squares_in(fn, i->region[r], s);
        if (!variant_is_site(i) || variant_site_info(fn, i)->kind != SITE_COMPARE) continue;
        Root root = {0};
        read_sum(s, i->args[1], false, &root);
        if (root.failed || !root.of || !root.nterms) continue;
        Builder b = ir_before(fn, i);
        b.span = i->span, b.fold = true;
        ir_replace_arg(i, 1, squared(&b, &root));
        changed = true;
    }
    return changed;
}

bool variant_squares(PassCtx *ctx, Fn *seamed) {
    if (seamed->precision != PREC_F64 || !seamed->nsites) return false;
    Arena *scratch = &ctx->session->scratch;
    ArenaMark m = arena_mark(scratch);
    IrRange *range = ARENA_ARRAY(scratch, IrRange, ir_number(seamed) + 1);
    ir_ranges(seamed, scratch, NULL, range);
    Squares s = {.on = depend_values(seamed, (DependOptions){0}), .range = range};
    bool changed = squares_in(seamed, seamed->body, &s);
    arena_reset(scratch, m);
    return changed;
}
