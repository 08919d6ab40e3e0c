/* Following fingers that are thinner than the lattice: what a tile of a two-dimensional lattice knows, in its own
 * numbers, and what it hands to others. A thread owns its Follow; the tile is the caller's. */
#ifndef SALTUS_SAMPLE_FOLLOW_H
#define SALTUS_SAMPLE_FOLLOW_H

#include "runtime/sample/finder.h"

typedef struct Follow Follow;
typedef struct Worker Worker;

typedef struct FollowTile {
    const double *pos[2];
    const uint32_t *hash; /* NULL: a visit, nothing is known of the vertices */
    const double *depth;  /* NULL without depth */
    double threshold[2], base[2], spacing[2];
    uint64_t stride[2];                /* of vertices; stride[0] is 1 */
    uint32_t from[2], to[2];           /* edges of a line that the tile owns */
    uint32_t line_from[2], line_to[2]; /* lines across axis i, by their vertex on it */
    uint32_t first[2], lines[2];       /* vertex 0 of the tile in the lattice, whose lines are 1 .. lines */
    uint32_t classes;
} FollowTile;
/* A finger between l and r on a line that is another tile's, and an edge of a tile in which a probe found something. */
typedef struct FollowExit {
    uint32_t line; /* of the lattice */
    uint8_t axis;
    int8_t step;
    double l, r;
} FollowExit;
typedef struct FollowFound {
    uint32_t edge;
    uint8_t axis;
} FollowFound;
Follow *follow_new(void);
void follow_free(Follow *f);
bool follow_begin(Follow *f, const FollowTile *t, uint64_t vertices);
/* Before their crossings are looked for: edges of a line, by their first vertex, whose ends differ; an edge in which
 * another probe found something. */
void follow_line(Follow *f, uint32_t axis, uint32_t line, const bool *searched);
void follow_found(Follow *f, uint32_t axis, uint32_t edge);
/* A crossing with its gradient. */
void follow_note(Follow *f, const Crossing *c);
/* When all the tile's segments are done; and then what is to be kept for the others, valid until the next tile. */
bool follow_run(Worker *w);
const FollowExit *follow_exits(const Follow *f, uint32_t *n);
const FollowFound *follow_seen(const Follow *f, uint32_t *n);
/* On a visit, between follow_begin and follow_run: what the tile has found, then who comes. */
void follow_known(Follow *f, const FollowFound *known);
void follow_enter(Follow *f, const FollowExit *in);

#endif
