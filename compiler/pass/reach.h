/* Does a gradient reach a value of the primal, and if not, where is it lost? For editors, which ask about values that
 * a source names, before any pass has rewritten them.
 *
 * An edge leads from a value to one that uses it. It is smooth where the derivative passes: where the partial of the
 * row (ops.def) is not ZERO, through memory, carried values and results of regions. Others pass on the value alone:
 * into a comparison, a rounding, an index. A gradient reaches what has a smooth way to an output, or to the boundary
 * function of a site that moves in x and can reach an output. */
#ifndef SALTUS_PASS_REACH_H
#define SALTUS_PASS_REACH_H

#include "compiler/pass/pass.h"

enum {
    REACH_VARIED = 1,   /* depends smoothly on a parameter that has a gradient */
    REACH_OUTPUT = 2,   /* a gradient reaches it from the outputs */
    REACH_BOUNDARY = 4, /* and from where a site's boundary moves */
    REACH_USED = 8,     /* an output depends on it, somehow */
    REACH_MOVES = 16    /* depends on a parameter that has a gradient, somehow */
};

typedef struct Reach Reach;
/* Of the primal that gen_program made, which it numbers; lives in the arena. Customs, sites and derived arrays are in
 * place. */
Reach *reach_of(const Program *p, Arena *arena);
/* REACH_ flags; 0 too of what is no instruction of the primal any more. */
uint8_t reach_flags(const Reach *r, const Inst *i);
/* Of a value with REACH_USED that no gradient reaches: the nearest use where the derivative is lost; NULL: none is
 * near. */
const Inst *reach_lost_at(Reach *r, const Inst *i);
/* reached[nfloats]: 1 where a gradient reaches that number of a parameter; also through derived arrays. */
void reach_params(Reach *r, uint8_t *reached);
/* The same flags of all reads of parameter numbers base .. base + count - 1 together, and one such read that is used
 * and not reached, or NULL. */
uint8_t reach_of_param(const Reach *r, uint32_t base, uint32_t count, const Inst **read);

#endif
