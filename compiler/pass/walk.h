/* Small helpers that several passes share: walking, effects, replacement while walking. */
#ifndef SALTUS_PASS_WALK_H
#define SALTUS_PASS_WALK_H

#include "compiler/ir/ir.h"
#include "compiler/pass/pass.h"

/* Instructions that may be removed, merged or moved freely when their operands allow it: no effect, no memory, no
 * control. */
bool walk_is_pure(const Inst *i);
/* Number of instructions in a block and all regions below (constants do not count). */
uint32_t walk_size(const Block *b);
uint32_t walk_fn_size(const Fn *fn); /* over all parts */
/* Each as often as the loops around it may run: what a sample takes at most. */
double walk_work(const Block *b);
/* opt_lists.c: may iterations of this loop be left out, where they change nothing? */
bool walk_can_leave_out(const Fn *fn, const Inst *loop);
/* Is any of the floats marked that a read of parameters may be of? Slots are as many as an image has numbers. */
bool walk_any_marked(const uint8_t *marks, const Inst *param);
/* Is block `inner` equal to `outer` or somewhere inside one of its regions? */
bool walk_inside(const Block *inner, const Block *outer);

/* Inst.tag of all instructions and parameters below becomes 0. */
void walk_clear_tags(Block *b);

/* Is it made, in so many operations, of what a loop carries, or its number? */
bool walk_is_indexed(const Inst *v, uint32_t depth);

/* Rewrites the operands of i through map (ids), following chains. */
void walk_remap(Inst *i, Inst **map);

/* Replaces the operand `from` by `to` in a block and all regions below. */
void walk_replace(Block *b, const Inst *from, Inst *to);

/* For many replacements at once: an unlinked instruction forwards to the value that stands for it; one walk resolves
 * all uses. */
void walk_forward(Fn *fn, Inst *i, Inst *to);
void walk_resolve_forwards(Block *b);

/* Makes the decision `at` a site with this g, of every iteration of the loops around it: it stands for `at` from then
 * on. Completes info, which has room in fn->sites. false: in too many loops. */
bool walk_make_site(Fn *fn, Inst *at, Inst *g0, Inst *g1, SiteInfo *info);

/* Is v, a boolean, `value` wherever the flag is true? Wherever the loop is reached? */
bool walk_tells(const Inst *flag, const Inst *v, bool value);
bool walk_begins(const Inst *loop, const Inst *v, bool value);

/* Moves every instruction of `from` except its yield before `at`; the yield is dropped. */
void walk_splice(Block *from, Inst *at);

/* The values of the yield that belong to results: args of an if_'s yield, args + 1 of a loop's. */
static inline Inst **walk_results(const Inst *structured, const Block *region) {
    Inst **all = region->last->args; /* none when nothing is yielded */
    return structured->op == OP_loop ? all + 1 : all;
}

/* Threads extra values through the control structure of a clone: a variant gives the initial values and a callback that
 * may update them at an instruction; ifs, loops and custom regions get the results and carried values that it needs,
 * and only where something inside changes them. */
typedef struct Thread {
    Fn *fn;
    uint32_t n;      /* how many values are threaded */
    Inst *value[16]; /* the values at the instruction that the walk has reached */
    /* Updates value[] at i (insert code after i). True if anything changed. */
    bool (*at)(struct Thread *t, Inst *i);
    /* May i, or something below it, change a value? Decides where results are added. */
    bool (*touches)(struct Thread *t, const Inst *i);
    /* Called with the continue flag of a loop that was threaded, at the end of its body; returns the flag to use (may
     * be NULL). */
    Inst *(*cont)(struct Thread *t, Builder *b, Inst *flag);
    void *user;
    Inst *loop_k[SLT_MAX_K * 4]; /* k of the `depth` loops around */
    uint32_t depth;
} Thread;
void thread_block(Thread *t, Block *b);

#endif
