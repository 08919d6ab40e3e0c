/* Derivatives by central differences: SLT_EST_FD, without a boundary term. And scenes with moved parameters. */
#ifndef SALTUS_SAMPLE_DIFFERENCE_H
#define SALTUS_SAMPLE_DIFFERENCE_H

#include "runtime/sample/estimate.h"

/* A scene with other values of the parameters; what the values are used by (geometries) is moved, not made
 * again; derived arrays follow. */
typedef struct Moved {
    SltScene scene;               /* points at the members below, and else at what the original points at */
    void *params;                 /* flt[nfloats] */
    struct SltGeometry *geometry; /* [ngeometries]: moved copies */
    const struct SltGeometry **geometries;
} Moved;
/* The parameters of s plus h times dir[nfloats], of which derived arrays are not read, or plus h in parameter `axis`
 * where dir is NULL. False when memory runs out. moved_free follows, whatever the result. */
bool scene_move(Moved *m, const SltScene *s, const double *dir, uint32_t axis, double h);
void moved_free(Moved *m);

/* As the functions of the same names in estimate.h. */
SltStatus difference_forward(const SltScene *s, const SltJob *j, uint32_t ndir, const double *const *dirs,
                             float *const *out, SltStats *stats, SltError *err);
SltStatus difference_reverse(const SltScene *s, const SltJob *j, const float *const adjoint[2], double *gradient,
                             double *stderr_bound, SltStats *stats, SltError *err);
SltStatus difference_integral(const SltScene *s, const SltJob *j, SltIntegral *out, SltStats *stats, SltError *err);

#endif
