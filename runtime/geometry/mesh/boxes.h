/* Boxes of rays: does every ray of a box meet the mesh, or none (SLT_QUERY_BLOCKED)? Proven in intervals, of numbers in
 * double with the vertices as far to all sides as rounding moves them where rays are decided, or not known. */
#ifndef SALTUS_MESH_BOXES_H
#define SALTUS_MESH_BOXES_H

#include "rays.h"
#include "walk.h"

/* rays: rows of a BOX (saltus/query.h); search: what rays are searched with; mesh->adjacency may be NULL; names: which
 * face is wanted, too (SLT_QUERY_SURFACE). */
void boxes_decide(const BvhScene *s, const WalkMesh *mesh, BvhSearch *search, const void *rays, uint64_t mask,
                  uint32_t width, bool names, int32_t *witness);

#endif
