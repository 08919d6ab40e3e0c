/* What the files of the bounds transformation share: a Fn evaluated on boxes. Private to variant_bounds*.c.
 *
 *   variant_bounds.c         the kernels bounds and edge_bounds: inputs, outputs
 *   variant_bounds_facts.c   which values differ within a box at all, and which may depend on something open
 *   variant_bounds_value.c   one operation; decisions and the events they record
 *   variant_bounds_learn.c   what a condition teaches
 *   variant_bounds_remainder.c  x - y * floor(x / y), whose parts follow each other
 *   variant_bounds_lean.c    how floats follow the position: tighter bounds of what is compared
 *   variant_bounds_error.c   how far a value as computed is from what exact arithmetic gives
 *   variant_bounds_flow.c    if_ and loop
 *   variant_bounds_query.c   queries along rays
 *   variant_bounds_array.c   arrays, and parameters at an index that is not one number
 *
 * Every value of the source becomes a Boxed: bounds (ir/bounds.h), and a set, `open`, of what the value hangs on that
 * may go either way on the box: away from the zeros of the events in it the value is a smooth function of the position
 * (an integer or a boolean: constant). A value that is constant on the box has an empty set, whatever went in; that is
 * how an event which a settled decision hides is forgotten. The set is a mask: a bit for each event that was recorded
 * on the way, and OPEN_* for what has no event. */
#ifndef SALTUS_PASS_VARIANT_BOUNDS_H
#define SALTUS_PASS_VARIANT_BOUNDS_H

#include "compiler/ir/bounds.h"
#include "compiler/pass/variant.h"

enum {
    OPEN_SLOTS = 24, /* events of a box that are told apart; the first of the mask's bits */
    OPEN_MORE = 1 << 24,
    OPEN_JUMP = 1 << 25, /* may jump where no event says */
    OPEN_BEND = 1 << 26  /* likewise, is continuous, but may be not smooth */
};

/* How a float follows the position: variant_bounds_lean.c. */
typedef struct Lean {
    Inst *mid, *slope[2], *rest; /* slopes and rest: NULL: 0 */
} Lean;

typedef struct Boxed {
    Bound is;    /* of a value that is the same on all of the box: lo and hi are one instruction */
    Inst *open;  /* int; NULL: the empty set */
    Inst *error; /* of floats, FACT_ERROR: how far from its value without rounding, at most; NULL: not at all */
    Lean lean;   /* of floats, FACT_LEAN; mid: NULL: what the bounds say */
} Boxed;

/* Facts of a value of the source. */
enum {
    FACT_WIDE = 1,   /* may differ within a box */
    FACT_OPEN = 2,   /* its set may be not empty */
    FACT_ERROR = 4,  /* a float that carries a rounding error, which is wanted */
    FACT_SLOPE = 16, /* a float that is not constant between the jumps of others */
    FACT_LEAN = 32,  /* a float that leans */
    FACT_CAPTURE = 8 /* g or its gradient on the way from the event, or nothing yet (VARIANT_UNCAPTURED) */
};

/* A condition under which the transformation stands, that may hold on a part of the box only. */
typedef struct PathStep {
    Inst *certain; /* it holds on all of the box */
    Inst *open;    /* the set of what it hangs on; NULL: empty */
} PathStep;

typedef struct BoxedArray {
    Inst *lo, *hi, *open, *error; /* allocs; NULL: as in a Boxed, for all elements */
    uint32_t path;                /* steps of the path that lead to the alloc */
} BoxedArray;

/* Of an if_: what its results are worth where result `index` is `truth`, which is what it takes to stay in a loop. */
typedef struct Goal {
    bool set, truth;
    uint32_t index;
} Goal;

/* An override of a value's Boxed while a region is transformed. */
typedef struct Undo {
    uint32_t id;
    Boxed was;
} Undo;

/* Where an event of an edge was recorded; seams that share its number find it there. */
typedef struct Recorded {
    const Inst *site;
    Inst *bit; /* in the sets; 0 where it is not open */
} Recorded;

typedef struct Boxes {
    PassCtx *ctx;
    const Fn *from; /* dense ids */
    Fn *to;
    Arena *arena;
    bool edges;        /* edge_bounds, prune: nothing is recorded */
    bool ends_alone;   /* prune: chunks hand on lower and upper ends, and nothing else */
    uint8_t *fact;     /* by id: FACT_* */
    bool *wanted;      /* by id: its error is; NULL: no error is */
    bool *leans;       /* by id: how it leans is wanted; NULL: of none */
    bool wants_given;  /* ... and those of all that chunks give */
    Boxed *value;      /* by id */
    Inst **answer;     /* by id of a query: what is known of its rays */
    Goal *goal;        /* by id of the if_ */
    Boxed *given;      /* by id of a result of an if_ with a goal: its value where that holds */
    BoxedArray *array; /* by id of the alloc */
    Vec(PathStep) path;
    Vec(Undo) undo;
    Vec(const Inst *) compared; /* comparisons of what changes on the box with what does not, in order */
    /* Arrays of the events recorded so far; slots elements and one for those beyond. NULL: none can be recorded. */
    uint32_t slots, depth;
    Recorded *known;                                               /* by edge */
    Inst *recorded, *edge, *first, *last, *line[2], *k[SLT_MAX_K]; /* `recorded`: one element, how many */
} Boxes;

/* variant_bounds_facts.c */
void bounds_facts(Boxes *x);
void bounds_want_error(Boxes *x, const Inst *v); /* before bounds_facts */
/* Facts of result `index` of a structured operation. */
uint8_t bounds_result_fact(const Boxes *x, const Inst *structured, uint32_t index);
static inline bool bounds_wide(const Boxes *x, const Inst *v) { return x->fact[v->id] & FACT_WIDE; }
/* Does an argument change otherwise than by jumps? Else the operation has none of its own. */
bool bounds_slopes(const Boxes *x, const Inst *i);

/* variant_bounds_value.c */
void bounds_value(Boxes *x, Builder *b, const Inst *i);
/* Sets of what is open. Unions know NULL; a select has its sets as ints. */
Inst *open_union(Builder *b, Inst *p, Inst *q);
Inst *open_where(Builder *b, Inst *cond, Inst *p, Inst *q); /* cond ? p : q, cond NULL: p */
/* Integers and booleans, folded while built. */
Inst *bounds_op1(Builder *b, Op op, Inst *p);
Inst *bounds_op2(Builder *b, Op op, Inst *p, Inst *q);
Inst *bounds_choose(Builder *b, Inst *cond, Inst *p, Inst *q);
Inst *bounds_not(Builder *b, Inst *p);
Inst *bounds_and(Builder *b, Inst *p, Inst *q); /* NULL is true */
/* What a choice between two values adds to the set of its result: what the condition hangs on, or only a bend where the
 * two are equal on the boundary. */
Inst *bounds_choice_open(Boxes *x, Builder *b, const Inst *cond, const Inst *yes, const Inst *no);
/* What was not captured: least and greatest the wrong way round, so that every hull forgets it. */
Boxed bounds_nothing(Builder *b);
Inst *bounds_is_nothing(Builder *b, Bound v);
static inline Inst *bounds_undecided(Builder *b, Bound c) { return bounds_op2(b, OP_bxor, c.lo, c.hi); }

/* variant_bounds_learn.c */
/* Boxes.compared; after bounds_facts. */
void bounds_find_compared(Boxes *x);
/* Narrows the bounds of what `cond` compares to where it is `truth`; bounds_forget takes that back. */
uint32_t bounds_learn(Boxes *x, Builder *b, const Inst *cond, bool truth);
void bounds_forget(Boxes *x, uint32_t mark);
/* A decision that may be given instead (variant_given.c): by a condition and a value that are the same on all of the
 * box. */
bool bounds_may_be_given(const Boxes *x, const Inst *v);

/* variant_bounds_remainder.c */
/* Bounds of row i, where it is a remainder; else what the row says. */
Bound bounds_remainder(const Boxes *x, Builder *b, const Inst *i, Bound row);
Bound bounds_mix(const Boxes *x, Builder *b, const Inst *i, Bound row); /* likewise, a mix by a remainder */

/* variant_bounds_error.c */
/* Of the result of float row i, from those of its arguments; NULL: none. */
Inst *bounds_error(Boxes *x, Builder *b, const Inst *i, const Boxed *a, Bound result);
Inst *error_larger(Builder *b, Inst *p, Inst *q); /* NULL is 0 */
/* Of which ? p : q, where `which` is settled on the box: that of the side which is taken. */
Inst *error_where(Builder *b, Inst *which, Inst *p, Inst *q);

/* variant_bounds_lean.c */
void bounds_want_lean(Boxes *x, uint32_t n); /* behind bounds_facts, which runs again then; n: ids */
bool bounds_hands_on_lean(const Inst *i);
Lean bounds_lean(const Boxes *x, Builder *b, const Inst *i, const Boxed *a); /* of a row, from its arguments */
Lean bounds_lean_input(const Boxes *x, Builder *b, uint32_t axis, Bound is);
/* Of p < q, or p <= q, where both lean. */
Bound bounds_lean_order(const Boxes *x, Builder *b, const Inst *i, const Boxed *a, Bound is);
Lean bounds_lean_of(const Boxes *x, Builder *b, Boxed v);
Lean bounds_lean_where(const Boxes *x, Builder *b, Inst *which, Boxed p, Boxed q); /* which ? p : q */
Bound bounds_lean_meets(const Boxes *x, Builder *b, Bound is, Lean v);             /* what both say */

/* variant_bounds_flow.c */
void bounds_block(Boxes *x, Builder *b, const Block *from);
void bounds_if(Boxes *x, Builder *b, const Inst *i);
void bounds_loop(Boxes *x, Builder *b, const Inst *i);

/* variant_bounds_query.c */
void bounds_query(Boxes *x, Builder *b, const Inst *i);
/* The search that a site of a mesh decides by, whose answer may name lines; NULL: none is known. */
const Inst *bounds_searched(const Boxes *x, const Inst *site);
/* Number `which`, 2 n + k, of the lines that part its rays. */
Inst *bounds_line(Boxes *x, Builder *b, const Inst *search, uint32_t which);
/* Bounds of a comparison that asks whether a ray meets anything; false: it is another one. */
bool bounds_found(Boxes *x, Builder *b, const Inst *i);

/* variant_bounds_array.c */
void bounds_alloc(Boxes *x, Builder *b, const Inst *i);
void bounds_load(Boxes *x, Builder *b, const Inst *i);
void bounds_store(Boxes *x, Builder *b, const Inst *i);
void bounds_acopy(Boxes *x, Builder *b, const Inst *i);
void bounds_param(Boxes *x, Builder *b, const Inst *i);

#endif
