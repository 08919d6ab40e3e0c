/* State of one reverse sweep, shared by ad_vjp.c, ad_region.c, ad_tape.c and ad_replay.c.
 *
 * The sweep is emitted behind the primal, walking it backwards once. What it needs of the primal is asked for where it
 * is needed (tape_value), and only then is it decided how to have it; the forward part gets its pushes when a scope is
 * closed. So nothing is stored that no rule asked for.
 *
 *   primal block  --Ctx-->  the block of the sweep where its reverse is being emitted
 *   Scope         one frame shape: the body of a loop, or the region of an if that holds loops; the top scope has no
 * frame */
#ifndef SALTUS_PASS_AD_TAPE_H
#define SALTUS_PASS_AD_TAPE_H

#include "compiler/pass/ad.h"

typedef struct RevBlock {
    Block *block;
    Inst *before; /* code goes before this (a region operation under construction), or at the end */
} RevBlock;

typedef struct Guard {
    Inst *branch;    /* an if_ of the loop's body: without it the iteration changes nothing active */
    Inst *cond;      /* its condition in the forward code */
    uint32_t region; /* the region that does */
} Guard;

typedef struct Hole { /* what code that is run again reads from outside */
    Inst *primal;
    Inst *forward; /* the instance that pushes, if it is to be in the frame: carried values, witnesses */
    Inst *at;      /* what the code reads until it is filled */
} Hole;

typedef Vec(Hole) Holes;

typedef struct Scope Scope;
struct Scope {
    Scope *parent;
    Inst *owner;        /* primal loop or if_ */
    Block *fwd_block;   /* where the frame is pushed: the owner's region in the forward code */
    Block *fwd_outer;   /* with one guard: the loop's body around fwd_block, whose values are visible too */
    Block *rev_block;   /* body of the revloop */
    Inst *k;            /* placeholder of the iteration number, if asked for */
    Inst *fwd_k;        /* the iteration number in the forward code */
    Vec(Inst *) stored; /* values of the forward code, and the parameters of the revloop that they become */
    Vec(Inst *) params;
    Vec(Inst *) what; /* the primal value of each, for the report */
    Vec(Guard) guards;
    Holes rerun_holes, replay_holes;
    bool top, framed, sparse;
    bool segment; /* the whole loop is run again, pushing */
    bool replay;  /* each iteration is run again, in rev_block, from what its frame holds */
    bool keeps;   /* but not its inner loops: their frames are those of the first run */
    Scope *over;  /* of an if around such loops: the replay whose rev_block has its values */
    uint64_t trips;
    uint32_t frame_bytes, recomputed, region;
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
    uint8_t *stable;  /* by id of a load: its array is not written any more after it */
    uint32_t *stamp;  /* by id */
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
/* Has this result of a region an adjoint? Results that exports added have none. */
static inline bool vjp_seeded(const Vjp *v, const Inst *proj) {
    return proj->id < v->f.n && proj->type == TY_FLT && v->adj[proj->id].v;
}
Ctx *vjp_push(Vjp *v, Block *primal, RevBlock *rev, Scope *scope);
static inline void vjp_pop(Vjp *v) { v->stack.len--; }

/* ad_vjp.c */
void vjp_block(Vjp *v, Block *b);
void vjp_add(Vjp *v, Inst *primal, AdTerm t);
bool vjp_holds_taped(const Vjp *v, const Block *b);

/* ad_region.c */
void vjp_if(Vjp *v, Inst *i);
void vjp_loop(Vjp *v, Inst *i);

/* ad_tape.c */
Inst *tape_value(Vjp *v, Inst *primal);
/* The instance of this primal instruction that has its value; the instance of a loop or an if that pushes. */
Inst *tape_forward(const Vjp *v, Inst *primal);
Inst *tape_run(const Vjp *v, Inst *primal);
/* A tape mark of the forward code, as seen by the sweep. */
Inst *tape_mark_value(Vjp *v, Inst *mark, bool direct);
/* Inserts the push of a scope whose reverse has been emitted; false if it needs none. */
void tape_push_frame(Vjp *v, Scope *s);
/* x of the forward code goes into the frame, and is param in the sweep. */
void tape_store(Vjp *v, Scope *s, Inst *x, Inst *param, Inst *what);
/* Facts that decide storing: want, stable. */
void tape_prepare(Vjp *v);
bool tape_find_guards(Vjp *v, Inst *loop, Scope *s);
uint64_t tape_bytes(const Vjp *v);
uint64_t tape_left(const Vjp *v, const Scope *s);
uint64_t tape_on_top(const Vjp *v, const Scope *s);
const char *tape_report(Vjp *v, Arena *arena, uint64_t bytes, uint64_t budget);

/* ad_replay.c */
bool tape_can_rerun(const Vjp *v, const Inst *loop);
bool tape_can_replay(const Vjp *v, const Inst *loop, const Scope *s);
bool tape_keeps(const Vjp *v, const Inst *loop);
/* Is there a query in this block or below? */
bool tape_searches(const Block *b);
/* Clones a segment into the sweep, in the current block, to be run again with pushes; and fills its holes once the
 * sweep knows what it pushes. */
Inst *tape_rerun(Vjp *v, Scope *s, Inst *loop);
void tape_fill_rerun(Vjp *v, Scope *s, Inst *mark_of_tape, Inst *rev);
/* Clones one iteration into the body of its revloop; and fills its holes when that is complete. */
void tape_replay(Vjp *v, Scope *s, Block *body);
void tape_fill_replay(Vjp *v, Scope *s);

#endif
