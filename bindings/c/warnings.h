/* Parts of what slt_warning says that the command says elsewhere too. Texts go to buf; the place may be none that is
 * known. */
#ifndef SALTUS_BINDINGS_C_WARNINGS_H
#define SALTUS_BINDINGS_C_WARNINGS_H

#include "saltus/saltus.h"

/* Crossings that were dropped; coinciding ones are integrated. */
uint64_t api_lost(const SltStats *stats);
/* How many, why and where. */
const SltPlace *api_lost_text(const SltStats *stats, char *buf, size_t size);
/* NULL: all results were finite. */
const SltPlace *api_nonfinite_text(const SltStats *stats, char *buf, size_t size);

#endif
