/* Boxes of rays: does every ray of a box meet the mesh, or none (SLT_QUERY_BLOCKED), or which lines part those that do
 * from those that do not (SLT_QUERY_LINE)? Proven in intervals, of numbers in double with the vertices as far to all
 * sides as rounding moves them where rays are decided, or not known. */
#ifndef SALTUS_MESH_BOXES_H
#define SALTUS_MESH_BOXES_H

#include "rays.h"
#include "walk.h"

/* rays: rows of a BOX (saltus/query.h); search: what rays are searched with; mesh->adjacency may be NULL. */
void boxes_decide(const BvhScene *s, const WalkMesh *mesh, BvhSearch *search, const void *rays, uint64_t mask,
                  uint32_t width, int32_t *witness);
/* rays: rows of a LINE. */
void boxes_line(const BvhScene *s, const WalkMesh *mesh, BvhSearch *search, const void *rays, uint64_t mask,
                uint32_t width, int32_t *witness);

#endif
