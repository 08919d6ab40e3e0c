/* Following fingers that are thinner than the lattice, from line to line. FollowTile is what a tile of a
 * two-dimensional lattice knows; its vertices and lines are numbered from 0 within the tile. A worker owns its Follow;
 * the tile is the caller's, and lives from follow_begin to follow_exits. */
#ifndef SALTUS_SAMPLE_FOLLOW_H
#define SALTUS_SAMPLE_FOLLOW_H

#include "runtime/sample/finder.h"

typedef struct Follow Follow;
typedef struct Worker Worker;

typedef struct FollowTile {
    const double *pos[2];                     /* positions of vertices along each axis */
    const uint32_t *hash;                     /* by vertex; NULL: a visit, nothing is known of the vertices */
    const double *depth;                      /* by vertex; NULL in scenes without depth */
    bool faces;                               /* edges whose ends differ in Mark.face alone are searched, too */
    double threshold[2], base[2], spacing[2]; /* by axis: Segment.threshold, Segment.base, distance of vertices */
    uint64_t stride[2];                       /* of vertices; stride[0] is 1 */
    uint32_t from[2], to[2];                  /* edges [from, to) of a line along axis i that the tile owns */
    uint32_t line_from[2], line_to[2];        /* lines across axis i, by their vertex on it */
    uint32_t first[2], lines[2];              /* vertex 0 of the tile in the lattice, whose lines are 1 .. lines */
    uint32_t classes;                         /* Boundary.classes */
} FollowTile;
/* A finger that goes to another tile: it lies between positions l and r of a line along `axis`. */
typedef struct FollowExit {
    uint32_t line; /* number in the lattice */
    uint8_t axis;
    int8_t step; /* 1 or -1: to the next line or the one before */
    double l, r;
} FollowExit;
/* An edge of a tile, by its first vertex, in which a probe found something. */
typedef struct FollowFound {
    uint32_t edge;
    uint8_t axis;
} FollowFound;
Follow *follow_new(void);
void follow_free(Follow *f);
bool follow_begin(Follow *f, const FollowTile *t, uint64_t vertices);
/* Before the crossings of its edges are looked for: a line; edge[n]: the first vertices of those whose ends differ,
 * ascending. */
void follow_line(Follow *f, uint32_t axis, uint32_t line, const uint32_t *edge, uint32_t n);
/* The near-miss probe found something in an edge; `edge` is 1 + its first vertex, as in Segment. */
void follow_found(Follow *f, uint32_t axis, uint32_t edge);
/* A crossing on an edge of the tile, with its gradient. */
void follow_note(Follow *f, const Crossing *c);
/* When all segments of the tile are done: follows its fingers. False when memory runs out. */
bool follow_run(Worker *w);
/* After follow_run, valid until the next tile: fingers for other tiles, and edges in which probes found something. */
const FollowExit *follow_exits(const Follow *f, uint32_t *n);
const FollowFound *follow_seen(const Follow *f, uint32_t *n);
/* On a visit, between follow_begin and follow_run: first the edges that the tile had seen, then the fingers that come.
 */
void follow_known(Follow *f, const FollowFound *known);
void follow_enter(Follow *f, const FollowExit *in);

#endif
