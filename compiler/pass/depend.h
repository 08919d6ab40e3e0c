/* The one dependence analysis: what the values of a primal depend on. The warnings, the pipeline ("does a boundary move
 * with what is differentiated?"), the runtime's list of static sites and `explain` all ask it.
 *
 * A value depends on its operands; a result of an if_ also on the condition; a result or a carried value of a loop also
 * on the loop's exit; an array on what is stored and on the conditions around the store. The number of an iteration
 * depends on nothing: where a loop ends decides which iterations there are, not where iteration k has its boundary. */
#ifndef SALTUS_PASS_DEPEND_H
#define SALTUS_PASS_DEPEND_H

#include "compiler/pass/pass.h"

enum {
    DEPENDS_X = 1, /* the position */
    DEPENDS_PARAM = 2,
    DEPENDS_RAND = 4,
    DEPENDS_PIECES = 8, /* chosen from several values, where the choice depends on the position: the value may be
                           constant, or equal to another, on an area */
    DEPENDS_SLOPE = 16, /* the position, otherwise than by jumps */
    DEPENDS_VALUE = 64, /* a parameter, otherwise than by jumps */
    DEPENDS_JUMPS = 32, /* jumps that no [Disc] tags, and whose places move with a parameter */
    DEPENDS_TIES = 128  /* a choice that parameters alone make: between equal values it has a kink */
};
enum { DEPEND_NAMED = 3 };

typedef struct Depend {
    uint8_t on;                   /* DEPENDS_* */
    uint8_t nnamed;               /* how many parameters are named, DEPEND_NAMED at most */
    uint32_t named[DEPEND_NAMED]; /* indices into Program.params: the first few found; 0 without a Program */
} Depend;

typedef struct DependOptions {
    const Program *program; /* names the parameters, and only those that are differentiable count; NULL: all do */
    const uint8_t *wrt; /* [nfloats]: a read of parameters counts if it may be of a float marked here; NULL: all do */
    bool whole_loops; /* coarser: a value in a loop also depends on the loop's exit, and each result of the loop on all
                         its initial values */
} DependOptions;

/* By id, in the session's scratch arena. Numbers the Fn. */
const Depend *depend_values(Fn *fn, DependOptions options);
/* Does it jump by itself, somewhere that moves with a parameter? of: what its operands depend on. */
bool depend_jumps(const Depend *of, const Inst *i);
/* Adds `from`; true if that was new. */
bool depend_merge(Depend *to, const Depend *from);
/* site[nsites] gets the DEPENDS_* flags of the boundary function of each site, with whole_loops. Numbers the Fn. */
void depend_sites(Fn *fn, const uint8_t *wrt, uint8_t *site);

/* Two sites whose g are one, up to a factor, where some parameters are equal: twins.c. */
typedef struct Twins {
    uint32_t site[2];
    double times; /* g of the second is so many times that of the first */
    bool indexed; /* the parameters are those of an iteration */
} Twins;
/* How many; *out, in the arena, are they. None of more than 64 sites. Numbers the Fn. */
uint32_t depend_twins(Fn *fn, Arena *arena, Twins **out);

#endif
