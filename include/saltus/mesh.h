/* Triangle meshes as geometries (saltus/query.h): what kernels and runtime agree on.
 *
 * Numbers: 3 a vertex, x y z. Topology: integers that never change, in the int vector of the parameters:
 *   faces [nfaces][3]    vertices of each triangle, counter-clockwise seen from outside
 *   parts [nfaces]       which `o` or `g` of the file
 *   uv    [nfaces][3][2][2]  if the mesh has any: u, v of each corner as the bits of two floats whose sum it is
 *
 * FACE witnesses are triangles, from 0. A ray is in the coordinates of the vertices. What counts as hit: both sides,
 * the borders of triangles included; of equal t the lowest triangle. A triangle seen edge-on is not hit. */
#ifndef SALTUS_MESH_H
#define SALTUS_MESH_H

#include <stdint.h>

enum { SLT_MESH_FACE = 3, SLT_MESH_PART = 1, SLT_MESH_UV = 12 }; /* integers a triangle */

/* How many integers the topology of nfaces triangles is. */
#define SLT_MESH_TOPOLOGY(nfaces, has_uv) \
    ((uint64_t)(nfaces) * (SLT_MESH_FACE + SLT_MESH_PART + ((has_uv) ? SLT_MESH_UV : 0)))

/* Behind all topologies, where a program asks for it:
 *   the part of each vertex [nvertices]
 *   rings [nvertices + 1][...]  where the faces around each vertex begin, and end; then these faces [nfaces * 3] */
#define SLT_MESH_RINGS(nvertices, nfaces) ((uint64_t)(nvertices) + 1 + 3 * (uint64_t)(nfaces))

/* A beam, the rows of SLT_QUERY_PIECES: what is seen from the eye through the window corner + s u + t v, s and t in
 * [0, 1]. Behind them the answer of SLT_QUERY_BEGIN, which only says that it was asked before. */
enum { SLT_BEAM_EYE = 0, SLT_BEAM_CORNER = 3, SLT_BEAM_U = 6, SLT_BEAM_V = 9, SLT_BEAM_ROWS = 12 };

/* What is told of a piece, by its unit, a row of SLT_TOLD numbers of the mesh's precision; where it is an integer, the
 * first four bytes. Its sides that move are the units behind it. Unit 0 is no piece: all is 0. The number of the last
 * unit lies, 32 bits, SLT_TOLD_LAST bytes before unit 0; beyond it kernels read the last. */
enum { SLT_TOLD = 8, SLT_TOLD_LAST = 64 };
enum {
    SLT_PIECE_AREA, /* of the window as 1 */
    SLT_PIECE_S,    /* its centroid */
    SLT_PIECE_T,
    SLT_PIECE_NEXT, /* integers: the next unit, or 0 */
    SLT_PIECE_TRIANGLE,
    SLT_PIECE_SIDES /* how many */
};
enum { SLT_PIECE_MAX_SIDES = 16 };
/* Of a side: it lies on the line g = 0, g > 0 on the piece where the weight is positive, of the edge from vertex a to
 * b, g = d . (A x B), or, b < 0, where triangles a and ~b cross, g = 1 / t of a less that of ~b. */
enum {
    SLT_SIDE_A, /* integers */
    SLT_SIDE_B,
    SLT_SIDE_WEIGHT, /* its length / |grad g|, in (s, t) */
    SLT_SIDE_S0,
    SLT_SIDE_T0,
    SLT_SIDE_S1,
    SLT_SIDE_T1
};

/* The rows of SLT_QUERY_BETWEEN: a ray, its partner, the face that either meets (below 0: none), what parts them and
 * which of its two numbers is asked for.
 *
 * The numbers are those of a side, SLT_SIDE_A and SLT_SIDE_B; and of the triangle a that passes an end of the rays b is
 * a (t = t0) or ~a (t = t1). Kernels hand them on as floats of their precision. */
enum {
    SLT_PAIR_OTHER = 8,
    SLT_PAIR_FACE = 16,
    SLT_PAIR_OTHER_FACE,
    SLT_PAIR_EDGES, /* which edges part two that see one surface: SLT_EDGES_* */
    SLT_PAIR_WHICH, /* 0 a, 1 b */
    SLT_PAIR_ROWS
};
enum {
    SLT_EDGES_NONE,
    SLT_EDGES_SEAMS, /* at which u, v of the two faces differ: of a mesh that has any */
    SLT_EDGES_ALL
};
enum { SLT_BETWEEN_LOST = -4 };    /* for a: something may part them, and it was not found */
enum { SLT_MESH_EXACT = 1 << 24 }; /* vertices and triangles that floats in single precision number */
/* A receiver p, n and a parallelogram that shines towards u x v, the rows of SLT_QUERY_IRRADIANCE; view and roughness
 * behind them of SLT_QUERY_LTC. Behind them the answer of SLT_QUERY_BEGIN. */
enum {
    SLT_LIGHT_P = 0,
    SLT_LIGHT_N = 3,
    SLT_LIGHT_CORNER = 6,
    SLT_LIGHT_U = 9,
    SLT_LIGHT_V = 12,
    SLT_LIGHT_ROWS = 15,
    SLT_LIGHT_VIEW = 15,
    SLT_LIGHT_ROUGHNESS = 18,
    SLT_LOBE_ROWS = 19
};

/* A piece and a point light, the rows of SLT_QUERY_LIT: the beam that the piece was seen through, the light; the unit
 * of the piece as a number. Behind them the answer of SLT_QUERY_BEGIN. */
enum { SLT_LIT_BEAM = 0, SLT_LIT_LIGHT = 12, SLT_LIT_UNIT = 15, SLT_LIT_ROWS = 16 };

/* What is told of light, by the answer's unit and those behind it: how many units there are of vertices, the value,
 * and the derivatives in the numbers that were asked with (but the unit of a piece), in their order, which go on in the
 * units behind; then the units of vertices. Unit 0: nothing shines. */
enum {
    SLT_LIGHT_COUNT, /* integer */
    SLT_LIGHT_VALUE,
    SLT_LIGHT_SLOPES,
    SLT_LIGHT_EDGES = 3, /* units before those of vertices */
    SLT_LIGHT_MAX_COUNT = 1 << 22
};
/* Of a unit of vertices: two of them, the derivatives in both. */
enum { SLT_LIGHT_A, SLT_LIGHT_B, SLT_LIGHT_D_A, SLT_LIGHT_D_B = SLT_LIGHT_D_A + 3 };

#endif
