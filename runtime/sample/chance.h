/* A second estimate of the boundary term of shaders that call rand(): parameters moved forth and back at points of its
 * own, and how often the region changes there. */
#ifndef SALTUS_SAMPLE_CHANCE_H
#define SALTUS_SAMPLE_CHANCE_H

#include "runtime/sample/run.h"

/* A boundary term that lines have estimated, [columns][nfloats]: what it belongs to, and how sure that is. A column is
 * a channel of an integral, or the one sum of a weighted image. */
typedef struct Chance {
    const float *adjoint;   /* of an image, else NULL */
    double *boundary;       /* NULL: only the derivative below holds it */
    const double *interior; /* then this is what the derivative was without it */
    double *gradient, *error;
    const double *smooth;   /* of the error what the interior has; NULL: not known */
    const uint8_t *starved; /* 1: so few crossings that lines of equal number had none; NULL: not known */
    uint64_t points;        /* that an estimate may take for all parameters, four evaluations each */
} Chance;

/* Where both estimates contradict each other the error grows by how much; where the lines starve, or the second is far
 * the surer one, it takes the place of theirs. Nothing where it is no estimate of the same: rays, geometry, and where
 * sites stand still or something is detached. */
SltStatus chance_add(Run *r, Chance *c);

#endif
