/* What warn.c asks of the other files of its pass. */
#ifndef SALTUS_PASS_WARN_H
#define SALTUS_PASS_WARN_H

#include "compiler/pass/depend.h"

/* ---- warn_probe.c: shows[k] becomes false where f was seen on both sides of changes of the decision list[k], and does
 * not jump there. The Fn, a primal, is numbered; dep is by id. */
void warn_probe(PassCtx *ctx, const Fn *fn, const Depend *dep, const Untracked **list, uint32_t n, bool *shows);

/* ---- warn_pieces.c: may an output jump where a visible piece that the query finds comes, goes or is cut? False: each
 * counts by its area. many: there may be more than one. The Fn, a primal, is numbered. */
bool warn_pieces(Fn *fn, const Inst *query, bool many);

#endif
