/* What the automatic differentiation passes share: rules, activity. Private to compiler/pass/ad_*.c and its
 * tests.
 *
 *   ad_rules.c       the partials column of ops.def, as code: emits it, or tells which values it mentions
 *   ad_activity.c    which values carry derivatives (varied and useful)
 *   ad_jvp.c         forward mode: ad_jvp, ad_grad_x
 *   ad_prepare.c     reverse mode, before: custom regions, ifs that hold loops, strip-mining
 *   ad_tape.c        reverse mode: how a primal value is had in the reverse sweep (stored, recomputed, read again)
 *   ad_replay.c      reverse mode: segments and iterations that are run again
 *   ad_vjp.c         reverse mode: the sweep
 *   ad_region.c      reverse mode: loops and ifs
 *
 * A product with a seed is guarded where a factor may be infinite (ir/range.h): behind an overflow too, but the
 * adjoints there count as finite.
 *
 * All facts are arrays over the ids of one ir_number(); instructions made afterwards have the id UINT32_MAX and no
 * facts. */
#ifndef SALTUS_PASS_AD_H
#define SALTUS_PASS_AD_H

#include "compiler/ir/range.h"
#include "compiler/pass/pass.h"
#include "compiler/pass/walk.h"

/* ---- rules (ad_rules.c). A term is an expression of a partial while it is built; a product waits in (x, y) so that
 * adding it is one ffma. */
typedef struct AdTerm {
    Inst *v;     /* the value, or NULL: zero, or a product still waiting */
    Inst *x, *y; /* the product */
    IrRange range;
    const Inst *key; /* the primal value that it is, or NULL: tells a*a from a*b without emitting */
    bool seed;       /* a multiple of the seed g */
    bool none;       /* no derivative at all */
} AdTerm;

enum { AD_MENTIONS_RESULT = 8 }; /* bits 0..2: arguments */

typedef struct AdRule AdRule;
struct AdRule {
    Builder b;
    bool emit, fma;
    /* The primal value v where code is being emitted. */
    Inst *(*value)(void *user, Inst *v);
    void *user;
    const IrRange *range;  /* by id; may be NULL */
    const uint8_t *varied; /* by id; NULL: all but constants */
    /* of the partial at hand */
    const Inst *inst;
    Inst *have[4];
    uint32_t mentions;
};
/* The partial of value row i in argument `which` applied to the seed: {.none} where there is none. Emits at rule->b. */
AdTerm ad_partial(AdRule *rule, const Inst *i, uint32_t which, AdTerm g);
/* Which of a, b, c, r that partial mentions (bits), without emitting; *inf: it may turn a finite seed infinite.
 * UINT32_MAX: no derivative. */
uint32_t ad_mentions(const Inst *i, uint32_t which, const IrRange *range, bool *inf);
AdTerm ad_seed(Inst *v, bool inf);
Inst *ad_term_value(AdRule *rule, AdTerm t);
/* acc + t; acc may be NULL. */
Inst *ad_term_add(AdRule *rule, Inst *acc, AdTerm t);

#ifdef SALTUS_AD_MUTATION
/* Test builds only: the partial (op, arg) is spoilt: 0 negated, 1 doubled, 2 dropped. */
extern int ad_mutation_op, ad_mutation_arg, ad_mutation_kind;
#endif

/* ---- facts (ad_activity.c) */
typedef struct AdFacts {
    Fn *fn;
    Arena *arena;
    uint32_t n;
    uint8_t *varied; /* by id: depends differentiably on what is differentiated; for arrays: their elements may */
    uint8_t *useful; /* by id: an output depends differentiably on it */
    IrRange *range;
    Inst **links; /* a detach with tag t > 0 takes its derivative from links[t - 1] (customs in reverse mode) */
    const AdOptions *o;
} AdFacts;
/* Numbers fn and computes the facts; tags of detach must be 0 or valid links. */
void ad_facts(AdFacts *f, Fn *fn, Arena *arena, const AdOptions *o, Inst **links);
static inline bool ad_active(const AdFacts *f, const Inst *v) {
    return v->id < f->n && f->varied[v->id] && f->useful[v->id];
}
/* May a finite seed become infinite somewhere in this block or below? */
bool ad_makes_infinite(const AdFacts *f, const Block *b);
bool ad_slot_in_wrt(const AdOptions *o, const Inst *param);
/* Zeroes flags and tags of every instruction. */
void ad_clear_tags(Block *b);
/* What output `index` of a Fn is, and what its tangent is. */
Output ad_output(const Fn *fn, uint32_t index);
Output ad_tangent_output(const Fn *fn, uint32_t index);

/* ---- ad_prepare.c */
/* Tags of loops: the inner loop of a strip-mined one, run again in the reverse sweep; a loop whose iterations are each
 * run again there. */
enum { AD_TAG_SEGMENT = 1, AD_TAG_REPLAY = 2 };
typedef struct AdLinks {
    Vec(Inst *) v;
} AdLinks;
void ad_expand_customs(Fn *fn, Arena *scratch, AdLinks *links);
void ad_hoist_inputs(Fn *fn, Arena *scratch);
/* Splits each if_ both of whose regions hold loops that `taped` names (by id), so that at most one region pushes
 * frames. True if any. */
bool ad_split_ifs(Fn *fn, const uint8_t *taped);
bool ad_strip_mine(Fn *fn, Inst *loop, uint32_t segment);

#endif
