/* The insides of loops: emit_loop.c has the loop, emit_path.c an iteration of it. */
#ifndef SALTUS_BACK_CPU_EMIT_LOOP_H
#define SALTUS_BACK_CPU_EMIT_LOOP_H

#include "compiler/back/cpu/emit_control.h"

/* Is a list given? Small loops are emitted twice, for yes and for no: then whoever gives none pays nothing. */
typedef enum Listed { LISTED_NO, LISTED_YES, LISTED_PERHAPS } Listed;

/* A carried value. */
typedef struct Carried {
    Inst *param;
    bool vector; /* the parameter is */
    bool wanted; /* after the loop */
    bool read;   /* in the body */
    bool apart; /* lanes that have left hold its result in vectors of their own: the parameter is uniform, or none reads
                   it. Else they hold it in the parameter's. */
} Carried;

/* What lanes hold of a carried value. */
typedef struct Kept {
    Part *v;        /* vectors or a scalar */
    const Inst *of; /* the value that the lanes on a path have there; NULL: of several */
} Kept;
typedef struct Held {
    Kept next;   /* of the parameter */
    Kept result; /* apart: of lanes that have left */
} Held;

/* Where edges meet that carry masks and values. */
typedef struct Join {
    LLVMBasicBlockRef at;
    Part go;    /* latch: the uniform part of the flag */
    Part *live; /* latch: the lanes that go on */
    Held *held;
} Join;

typedef struct LoopState {
    Inst *i;
    const Inst *yield;
    Listed listed;
    bool diverges;
    Part j; /* iterations done */
    uint32_t n;
    Carried *carried; /* [n] */
    LLVMBasicBlockRef head;
    Join latch, done; /* done: of each value `next` or, apart, `result` */
} LoopState;

/* Which side of an if at the end of a block the path takes. */
typedef struct Step {
    const Inst *at;
    uint32_t side;
} Step;
enum { MAX_STEPS = 8 };

typedef struct Path {
    Step step[MAX_STEPS];
    uint32_t nsteps;
    Part *on, *live; /* the lanes that execute here, and those inside the loop, others than these
                        have skipped what is here. NULL: the loop does not diverge */
    bool alike;      /* on and live are the same */
    bool some;       /* live is known not to be empty */
    Held *held;      /* [n] */
} Path;

/* ---- emit_loop.c: values where edges meet */
bool loop_needed(const Carried *c);
LLVMTypeRef loop_result_type(Emit *e, const Carried *c); /* of vectors */
uint32_t loop_next_parts(const Emit *e, const Carried *c);
Held *loop_copy_held(Emit *e, const LoopState *s, const Held *from);
void loop_new_phis(Emit *e, LLVMTypeRef t, uint32_t n, Part *out);
/* The edges from here: values, and of the latch the lanes that are left (NULL: the loop does not diverge)
 * and the uniform part of the flag (NULL: true). The branch is the caller's. */
void loop_to_done(Emit *e, const LoopState *s, const Held *h);
void loop_to_latch(Emit *e, const LoopState *s, const Part *live, Part go, const Held *h);

/* ---- emit_path.c */
/* Emits a body from where the builder stands up to its edges to the latch and out of the loop. */
void loop_path(Emit *e, LoopState *s, Path *p, Block *b);

#endif
