/* Derivatives by differences of what is rendered with the parameters moved. */
#ifndef SALTUS_SAMPLE_DIFFERENCE_H
#define SALTUS_SAMPLE_DIFFERENCE_H

#include "runtime/sample/estimate.h"

/* A scene whose parameters are moved: difference.c */
typedef struct Moved {
    SltScene scene;
    void *params;
    struct SltGeometry *geometry; /* moved copies */
    const struct SltGeometry **geometries;
} Moved;
/* Along dir (NULL: along axis p). Free it, whatever the result. */
bool scene_move(Moved *m, const SltScene *s, const double *dir, uint32_t axis, double h);
void moved_free(Moved *m);

SltStatus difference_forward(const SltScene *s, const SltJob *j, uint32_t ndir, const double *const *dirs,
                             float *const *out, SltStats *stats, SltError *err);
SltStatus difference_reverse(const SltScene *s, const SltJob *j, const float *const adjoint[2], double *gradient,
                             double *stderr_bound, SltStats *stats, SltError *err);
SltStatus difference_integral(const SltScene *s, const SltJob *j, SltIntegral *out, SltStats *stats, SltError *err);

#endif
