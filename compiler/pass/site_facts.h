/* What the boundary function of each site depends on. */
#ifndef SALTUS_PASS_SITE_FACTS_H
#define SALTUS_PASS_SITE_FACTS_H

#include "compiler/pass/pass.h"

enum { DEPENDS_X = 1, DEPENDS_PARAM = 2, DEPENDS_RAND = 4 };
/* site[nsites] gets the flags; wrt (per float, NULL: all) says which parameters count. Numbers the Fn. */
void site_facts(PassCtx *ctx, Fn *fn, const uint8_t *wrt, uint8_t *site);

#endif
