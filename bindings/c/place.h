/* place.c: places in the source for what went wrong in a call. They go into the call's counts. */
#ifndef SALTUS_BINDINGS_C_PLACE_H
#define SALTUS_BINDINGS_C_PLACE_H

#include "bindings/c/api.h"

/* Inputs of the interpreter: up to so many points, of an image's pixels if the job is one. */
enum { POINT_LANES = 64 };
typedef struct PointInputs {
    SltKernelArgs args;
    bool f64;
    double flt[4][POINT_LANES], ones[POINT_LANES], zero[POINT_LANES]; /* float or double, by f64 */
    int32_t stream[POINT_LANES], pixel[2][POINT_LANES];
    double lo[2], side[2];                /* of pixels */
    double out[SLT_OUT_MAX][POINT_LANES]; /* not cleared: mostly nobody asks, and these are pages */
} PointInputs;
void api_inputs_begin(PointInputs *in, const SltProgram *p, const SltJob *job); /* job: NULL, or its pixels */
void api_inputs_point(PointInputs *in, uint32_t lane, const double x[3], int32_t stream, double rand0);
/* Adds file, line, column and text of a span. */
void api_name_place(const SltProgram *p, SltPlace *at, Span span);

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
/* scale.c: does single precision hold the squares that a root or a site asks about? Else that is noted, and where.
 * Before the job runs: what geometries say of a call is forgotten. */
void api_find_scale(SltProgram *p, const SltJob *job, SltStats *stats);

#endif
