/* What quadrature.c, images.c and choose.c share. */
#ifndef SALTUS_QUADRATURE_INNER_H
#define SALTUS_QUADRATURE_INNER_H

#include "runtime/quadrature/sweep.h"
#include "runtime/quadrature/quadrature.h"

#define QUADRATURE_HOPELESS 0.5 /* share of the domain without bounds, beyond which cells are not tried */

/* Does f hang on shadows and no views of terrain, in a plane's integral? Then curves are followed through what cells
 * leave: march.c. */
bool quadrature_marches(const SltScene *s, const SltJob *j);
/* Does the program have a boundary term, and the kernels for it; `last`: SITE_VJP or SITE_JVP. */
bool quadrature_has_boundary(const SltScene *s, SltKernelKind last);
/* Of a derivative: must it be known where f jumps at seams? */
bool quadrature_compares_seams(const SltScene *s, const SltJob *j);
/* Segments of the lattice that the job speaks of: a pixel, or of an integral in all. */
double quadrature_segments(const SltJob *j);
/* Evaluations that the lattice spends on the job: a sample is one of f and one of the adjoint of each channel. */
double quadrature_lattice(const SltScene *s, const SltJob *j, bool boundary, bool interior);
/* What a few hundred boxes say of a program. */
typedef struct Outlook {
    double seen;     /* |f| is at least that large somewhere */
    double unproven; /* share of the domain where bounds prove nothing even on small boxes; 1: no bounds at all */
    double cells;    /* how many there will be, about: the mean over places, of which a few tell most */
    double likely;   /* and as those places have it that lie beside no edge */
    double side;     /* of a usual one (the median over places), in parts of the domain */
    bool no_memory;  /* to ask with */
} Outlook;
Outlook quadrature_outlook(const SltScene *s, const SltJob *j, SltStats *stats);
/* turn.c: may the answer of cells be as wide as it states, or does a small lattice tell that the whole one would state
 * far less? scale: of the gradient, as errors are told by it. stats gets what that costs. */
SltStatus quadrature_turns(const SltScene *s, const SltJob *job, const double *gradient, const double *error,
                           double scale, bool *turned, SltStats *stats, SltError *err);
/* The run's counts tell what the sweep has proven. */
void quadrature_state(Run *r, const Sweep *p);
/* Of the sweeps of images: options from the job, and the end of a call. */
void quadrature_image_options(Sweep *p);
SltStatus quadrature_image_end(Run *r, Sweep *p, SltStatus st, SltStop stop, SltStats *stats);

#endif
