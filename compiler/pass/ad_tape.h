/* State of one reverse sweep, shared by ad_vjp.c, ad_region.c, ad_sparse.c, ad_tape.c and ad_replay.c.
 *
 * The sweep is emitted behind the primal, walking it backwards once. A value of the primal is asked for where the sweep
 * needs it (tape_value), and only then is it decided how to have it; the forward part gets its pushes when a scope is
 * closed. So nothing is stored that no rule asked for.
 *
 *   Ctx    leads from a block of the primal to the block of the sweep where its reverse is being emitted
 *   Scope  one frame shape: the body of a loop, or the region of an if that holds loops; the top scope has no frame */
#ifndef SALTUS_PASS_AD_TAPE_H
#define SALTUS_PASS_AD_TAPE_H

#include "compiler/pass/ad.h"

typedef struct RevBlock {
    Block *block;
    Inst *before; /* code goes before this (a region operation under construction), or at the end */
} RevBlock;

typedef struct Guard {
    Inst *branch;    /* an if_ of the loop's body; where no guard is taken the iteration changes nothing active */
    Inst *cond;      /* condition of `branch` in the forward code */
    uint32_t region; /* of `branch`: the one that changes something */
} Guard;

typedef struct Hole { /* what code that is run again reads from outside */
    Inst *primal;
    Inst *forward; /* where the frame is to hold the value (carried values, witnesses): the instance that is pushed */
    Inst *at;      /* what the code reads until the hole is filled */
} Hole;

typedef Vec(Hole) Holes;

typedef struct Scope Scope;
struct Scope {
    Scope *parent;
    Inst *owner;        /* primal loop or if_ */
    Block *fwd_block;   /* where the frame is pushed: the owner's region in the forward code */
    Block *fwd_outer;   /* with one guard: the loop's body around fwd_block, whose values are visible too */
    Block *rev_block;   /* body of the revloop */
    Inst *k;            /* parameter of rev_block that stands for the iteration number; NULL: not needed */
    Inst *fwd_k;        /* the iteration number in the forward code */
    Vec(Inst *) stored; /* values of the forward code, and the parameters of the revloop that they become */
    Vec(Inst *) params;
    Vec(Inst *) what; /* the primal value of each, for the report */
    Vec(Guard) guards;
    Holes rerun_holes, replay_holes;
    bool top;     /* the Fn itself */
    bool framed;  /* pushes frames */
    bool sparse;  /* pushes them only where a guard is taken */
    bool segment; /* the whole loop is run again, pushing */
    bool replay;  /* each iteration is run again, in rev_block, from what its frame holds */
    bool keeps;   /* of a replay: inner loops are not run again; their frames are those of the first run */
    bool told;    /* runs once for each of what a query told: frames are not bounded, and one counts */
    Scope *over;  /* of an if around loops that a replay keeps: that replay, whose rev_block has the if's values */
    uint64_t trips;
    uint32_t frame_bytes, recomputed; /* bytes a lane; values computed again */
    uint32_t region;                  /* of `owner` */
};

typedef struct Ctx {
    Block *primal;
    RevBlock *rev;
    Scope *scope;
} Ctx;

typedef struct Adjoint {
    Inst *v; /* NULL: zero so far */
    bool inf;
} Adjoint;

typedef struct Vjp {
    PassCtx *ctx;
    Fn *fn;
    Arena *scratch;
    const AdOptions *o;
    AdFacts f;
    AdLinks links;
    AdRule rule;
    Adjoint *adj;     /* by id */
    Inst **adj_array; /* by id of the alloc */
    Inst **memo;      /* by id: the primal value in the sweep */
    Inst **fwd;       /* by id: the instance whose value counts, where it was run again */
    Inst **run;       /* by id of a loop or an if: the instance that pushes, if it is another one */
    uint8_t *want;    /* by id: some rule mentions it */
    uint8_t *effect;  /* by id: an if_ or loop that writes active arrays */
    uint8_t *taped;   /* by id: a loop with something active in it */
    uint8_t *gated;   /* by id: what its adjoint is made of came through min, max or select, and is often 0 */
    uint8_t *stable;  /* by id of a load: its array is not written any more after the load */
    uint32_t *stamp;  /* by id: `stamps` of the walk that saw the value last */
    uint32_t stamps;
    Vec(Ctx *) stack;
    Vec(Scope *) scopes;
    bool any_inf;
} Vjp;

static inline Ctx *vjp_here(const Vjp *v) { return v->stack.data[v->stack.len - 1]; }
static inline Builder rev_builder(const Vjp *v, const RevBlock *r) {
    return (Builder){.fn = v->fn, .block = r->block, .before = r->before, .fold = true, .span = SPAN_NONE};
}
static inline Builder vjp_builder(const Vjp *v) { return rev_builder(v, vjp_here(v)->rev); }
/* Has this result of a region an adjoint? Results that tape_value added have none. */
static inline bool vjp_seeded(const Vjp *v, const Inst *proj) {
    return proj->id < v->f.n && proj->type == TY_FLT && v->adj[proj->id].v;
}
Ctx *vjp_push(Vjp *v, Block *primal, RevBlock *rev, Scope *scope);
static inline void vjp_pop(Vjp *v) { v->stack.len--; }

/* ad_vjp.c */
void vjp_block(Vjp *v, Block *b);
void vjp_run(Vjp *v, const Inst *first, Inst *last); /* of one block, backwards */
void vjp_add(Vjp *v, Inst *primal, AdTerm t);
bool vjp_holds_taped(const Vjp *v, const Block *b);
bool vjp_reads_told(const Block *b); /* itself, not in a loop */

/* ad_region.c */
void vjp_if(Vjp *v, Inst *i);
void vjp_loop(Vjp *v, Inst *i);

/* ad_sparse.c */
bool vjp_is_sparse(const Vjp *v, const Block *b);
/* Emits the reverse of the chunk that ends with `last`; returns what stands ahead of it, or NULL. */
Inst *vjp_chunk(Vjp *v, Inst *last);
/* Emits the reverse of what makes the gated value `last`, and stands behind `ahead`, in an if_; *next is what comes
 * then. False: it is too little, and nothing is emitted. */
bool vjp_gate(Vjp *v, const Inst *ahead, Inst *last, Inst **next);

/* ad_tape.c */
Inst *tape_value(Vjp *v, Inst *primal);
/* Of a primal instruction: the instance that has its value; of a loop or an if, the instance that pushes. */
Inst *tape_forward(const Vjp *v, Inst *primal);
Inst *tape_run(const Vjp *v, Inst *primal);
/* A tape mark of the forward code, as seen by the sweep. */
Inst *tape_mark_value(Vjp *v, Inst *mark, bool direct);
/* Inserts the push of a scope whose reverse has been emitted. */
void tape_push_frame(Vjp *v, Scope *s);
/* x of the forward code goes into the frame, and is `param` in the sweep; what: the primal value, for the report. */
void tape_store(Vjp *v, Scope *s, Inst *x, Inst *param, Inst *what);
/* Finds the facts that decide storing: Vjp.want, Vjp.stable. */
void tape_prepare(Vjp *v);
bool tape_find_guards(Vjp *v, Inst *loop, Scope *s);
uint64_t tape_bytes(const Vjp *v);
bool tape_grows(const Vjp *v); /* beyond that, with what queries tell */
uint64_t tape_left(const Vjp *v, const Scope *s);
uint64_t tape_on_top(const Vjp *v, const Scope *s);
const char *tape_report(Vjp *v, Arena *arena, uint64_t bytes, uint64_t budget);

/* ad_replay.c */
bool tape_can_rerun(const Vjp *v, const Inst *loop);
bool tape_can_replay(const Vjp *v, const Inst *loop, const Scope *s);
bool tape_keeps(const Vjp *v, const Inst *loop);
/* Is there a query in this block or below? */
bool tape_searches(const Block *b);
/* Clones a segment into the sweep, in the current block, to be run again with pushes; and fills the clone's holes once
 * the sweep knows what it pushes. */
Inst *tape_rerun(Vjp *v, Scope *s, Inst *loop);
void tape_fill_rerun(Vjp *v, Scope *s, Inst *mark_of_tape, Inst *rev);
/* Clones one iteration into the body of its revloop; and fills the clone's holes when that body is complete. */
void tape_replay(Vjp *v, Scope *s, Block *body);
void tape_fill_replay(Vjp *v, Scope *s);

#endif
