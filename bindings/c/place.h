/* place.c: places in the source for what went wrong in a call. They go into the call's counts. */
#ifndef SALTUS_BINDINGS_C_PLACE_H
#define SALTUS_BINDINGS_C_PLACE_H

#include "bindings/c/api.h"

/* What was not finite: f or a derivative of it, of a pixel (column, row from the top, slice) or of a sum over all. */
typedef struct Blame {
    const uint32_t *pixel; /* NULL: of which is not known, or it is an integral */
    bool derivative;
    const double *direction; /* [nfloats], of a forward derivative; NULL: in every parameter */
} Blame;

/* Of the crossings that were dropped: their site, or the first decision that differs on their two sides. */
void api_name_drops(SltProgram *p, SltStats *stats);
/* Looks among the samples of the job for a point that is to blame, and for the operation that made it so. */
void api_find_nonfinite(SltProgram *p, const SltJob *job, const Blame *blame, SltStats *stats);

#endif
