/* Which faces of a mesh meet along an edge, and which edges meet at a vertex. Faces do not change, so it is made once,
 * by who needs it.
 *
 * Half-edge 3 f + k goes from corner k of face f to the next. */
#ifndef SALTUS_MESH_ADJACENCY_H
#define SALTUS_MESH_ADJACENCY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum {
    ADJACENCY_BORDER = -1, /* no other face has the edge */
    ADJACENCY_MANY = -2    /* more than one other; or of a face of which two corners are one vertex, which is no
                            face to any other */
};

typedef struct Adjacency {
    uint32_t nvertices, nfaces;
    int32_t *across; /* [nfaces][3] the half-edge on the other side, whichever way it goes, or one of the above */
    uint32_t *first; /* [nvertices + 1] the edges at vertex v go to end[first[v]], ..., end[first[v + 1] - 1] */
    int32_t *end;    /* ascending at each vertex */
} Adjacency;

/* face: [nfaces][3]. False when out of memory; then nothing is held. */
bool adjacency_make(Adjacency *a, const int32_t *face, uint32_t nfaces, uint32_t nvertices);
void adjacency_free(Adjacency *a);
size_t adjacency_bytes(const Adjacency *a);

#endif
