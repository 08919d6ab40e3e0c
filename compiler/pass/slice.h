/* What values are computed from, through control flow and arrays: backwards, of one Fn. */
#ifndef SALTUS_PASS_SLICE_H
#define SALTUS_PASS_SLICE_H

#include "compiler/pass/pass.h"

typedef struct Slice {
    Arena *arena;
    bool *in;       /* by id */
    bool decisions; /* what a site decides comes from its comparison, not from its g alone */
    Vec(Inst *) work;
    Inst **stores, **next_store; /* by id of the alloc; chained by id */
} Slice;

/* ids are dense. Everything lives in the arena. */
Slice slice_begin(Fn *fn, Arena *arena, bool decisions);
void slice_add(Slice *s, Inst *i); /* NULL: nothing */
void slice_close(Slice *s);        /* everything that what was added comes from */

#endif
