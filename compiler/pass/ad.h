/* What the automatic differentiation passes share: rules, activity. Private to compiler/pass/ad_*.c and tests/ad.
 *
 *   ad_rules.c       the partials column of ops.def, as code: emits it, or tells which values it mentions
 *   ad_activity.c    which values carry derivatives (varied and useful)
 *   ad_jvp.c         forward mode: ad_jvp, ad_grad_x
 *   ad_prepare.c     reverse mode, before: custom regions, ifs that hold loops, strip-mining
 *   ad_tape.c        reverse mode: how the sweep has a primal value (stored, recomputed, read again)
 *   ad_replay.c      reverse mode: segments and iterations that are run again
 *   ad_vjp.c         reverse mode: the sweep
 *   ad_region.c      reverse mode: loops and ifs
 *   ad_sparse.c      reverse mode: long straight-line programs in chunks
 *   ad_rows.c        reverse mode, after: several seeds of one output
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
    const Inst *key; /* the primal value that the term is, or NULL: tells a*a from a*b without emitting */
    bool seed;       /* a multiple of the seed g */
    bool none;       /* no derivative at all */
} AdTerm;

enum { AD_MENTIONS_RESULT = 8 }; /* of a set of operands; bits 0..2: the arguments */

typedef struct AdRule AdRule;
struct AdRule {
    Builder b;
    bool emit; /* false: only `mentions` is found */
    bool fma;  /* products may be added by ffma */
    /* Gives the primal value v where code is being emitted. */
    Inst *(*value)(void *user, Inst *v);
    void *user;
    const IrRange *range;  /* by id; may be NULL */
    const uint8_t *varied; /* by id; NULL: all but constants */
    /* of the partial at hand */
    const Inst *inst;
    Inst *have[4];     /* a, b, c, r as `value` gave them; NULL: not asked yet */
    uint32_t mentions; /* bits */
};
/* The partial of value row i in argument `which` applied to the seed g: {.none} where there is none. Emits at rule->b.
 */
AdTerm ad_partial(AdRule *rule, const Inst *i, uint32_t which, AdTerm g);
/* Which of a, b, c, r that partial mentions (bits), without emitting; UINT32_MAX: no derivative. *inf: the partial may
 * turn a finite seed infinite. */
uint32_t ad_mentions(const Inst *i, uint32_t which, const IrRange *range, bool *inf);
AdTerm ad_seed(Inst *v, bool inf);
Inst *ad_term_value(AdRule *rule, AdTerm t);
/* acc + t; acc may be NULL. */
Inst *ad_term_add(AdRule *rule, Inst *acc, AdTerm t);

#ifdef SALTUS_AD_MUTATION
/* Test builds only: spoils the partial of row `op` in argument `arg`; kind 0 negates it, 1 doubles it, 2 drops it. */
extern int ad_mutation_op, ad_mutation_arg, ad_mutation_kind;
#endif

/* ---- facts (ad_activity.c) */
typedef struct AdFacts {
    Fn *fn;
    Arena *arena;
    uint32_t n;      /* ids */
    uint8_t *varied; /* by id: depends differentiably on what is differentiated; for arrays: their elements may */
    uint8_t *useful; /* by id: an output depends differentiably on it */
    IrRange *range;
    Inst **links; /* a detach with tag t > 0 takes its derivative from links[t - 1] (customs in reverse mode) */
    const AdOptions *o;
} AdFacts;
/* Numbers fn and computes the facts; tags of detach must be 0 or valid links. */
void ad_facts(AdFacts *f, Fn *fn, Arena *arena, const AdOptions *o, Inst **links, const uint8_t *told);
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
/* Tags of loops. */
enum {
    AD_TAG_SEGMENT = 1, /* the inner loop of a strip-mined one: the sweep runs it again as a whole */
    AD_TAG_REPLAY = 2   /* the sweep runs each iteration again */
};
typedef struct AdLinks {
    Vec(Inst *) v;
} AdLinks;
void ad_expand_customs(Fn *fn, Arena *scratch, AdLinks *links);
void ad_hoist_inputs(Fn *fn, Arena *scratch);
/* Splits each if_ both of whose regions hold loops with taped[id] != 0, so that at most one region pushes frames. True
 * if any was split. */
bool ad_split_ifs(Fn *fn, const uint8_t *taped);
/* segment: iterations of the inner loop. */
bool ad_strip_mine(Fn *fn, Inst *loop, uint32_t segment);

/* ---- ad_rows.c */
/* Makes of adjoints for the seed 1 those for each of the seeds IN_SEED0.., of the first alone where IN_ROWS says so. */
void ad_scale_rows(Fn *fn, uint32_t rows);

#endif
