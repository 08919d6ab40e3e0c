/* What a point light sees of a visible piece past the mesh, exactly, with its derivatives: the area of that in the
 * camera's window.
 *
 * It is the search for the light of a parallelogram (light.h) with other parts: the light is the point p, planes
 * through which are lines on the plane of the piece's triangle; there the window lies, around the piece. What is cut
 * by the edges that end shadows, and is lit, is mapped back to the camera's window, where lines are lines again. */
#ifndef SALTUS_MESH_LIT_H
#define SALTUS_MESH_LIT_H

#include "light.h"

/* rays: rows of SLT_LIT_*. witness: the unit of the answer, or 0 where nothing is lit: of no piece too; of numbers that
 * are not finite NaN is told. False: out of memory, some are missing. */
bool lit_find(const LightScene *s, const void *rays, uint64_t mask, uint32_t width, int32_t *witness);

#endif
