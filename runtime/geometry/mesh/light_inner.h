/* The insides of light: nobody else includes this.
 *
 * light.c         the query: light and receiver, the store, what is told
 * light_edges.c   triangles in the beam, the edges that may end a shadow
 * light_arrange.c how silhouettes cross, light_tie.c how many faces hide beside them, light_border.c the border of what
 *                 is lit: where rounding hides nothing of it (arrangement.h)
 * light_pieces.c  else: sub-windows, pieces, which are lit
 * light_ask.c     does anything hide a place of the light?
 * light_kept.c    what the other query of the same receiver has found
 * light_sum.c     what a piece adds, and its sides' J
 * light_turn.c    from J to derivatives
 * lit.c           the other query: p is a point light, the light a window on a piece's plane
 * lit_turn.c      its derivatives */
#ifndef SALTUS_MESH_LIGHT_INNER_H
#define SALTUS_MESH_LIGHT_INNER_H

#include "light.h"
#include "outline.h"

#include "rows.h"
#include "vec.h"

enum {
    LIGHT_CORNERS = 32, /* of a polygon, at most; above LIGHT_KEPT it is halved */
    LIGHT_KEPT = 26,
    LIGHT_FEW = 12, /* edges, or triangles, of a window that is not halved */
    LIGHT_HALVINGS = 30
};
#define LIGHT_ON_LINE 2e-13   /* nearer to a line is on it */
#define LIGHT_CONTINUES 1e-6 /* an edge that leaves the line of another by no more is its continuation */

typedef enum SegmentKind {
    SEGMENT_BORDER,  /* of the light, from one corner to the next */
    SEGMENT_HORIZON, /* n . w = 0 */
    SEGMENT_FIXED,   /* cuts that do not move, and the horizon of the lobe, where nothing shines */
    SEGMENT_EDGE,    /* between vertices a < b */
    SEGMENT_PLANE,   /* where triangle a meets the light's plane */
    SEGMENT_PIECE    /* a side of what is lit: part a of its outline, of which b further ones follow; g > 0 inside */
} SegmentKind;
/* Numbers of segments: borders come first. */
enum { LINE_HORIZON = 4, LINE_FIXED, LINE_MESH };

/* A piece of a line in the window, on the plane through p with normal G: g = G . (c + u U + v V) up to a factor that
 * makes its slope 1. */
typedef struct Segment {
    double g[3];
    double from, to; /* along (-g1, g0) */
    double end[2][2], low[2], high[2];
    double j[3]; /* sum of J over sides of lit pieces, positive where the piece is on the side g > 0 (of Lit: of the
                    side's length in (s, t) times (s, t, 1) at its middle) */
    int32_t a, b;
    SegmentKind kind;
    /* Of the mesh's: how many more faces hide where g > 0, which is left of the way from end 0 to end 1; the border
     * that each end was cut at, or what else it is. */
    int32_t more;
    int8_t cut[2];
    bool many; /* of an edge of more than two faces; each has a segment */
} Segment;
enum { CUT_NOT = -1, CUT_DEEP = -2 }; /* Segment's `cut`: where a vertex is; at the light's plane */

/* Side k goes from corner k to the next, counter-clockwise, on segment side[k]. */
typedef struct Polygon {
    uint32_t n;
    double u[LIGHT_CORNERS], v[LIGHT_CORNERS];
    uint32_t side[LIGHT_CORNERS];
    double low[2], high[2]; /* of one in a row */
} Polygon;

/* A triangle in the window, of the way that subtracts. */
typedef struct Facet {
    uint32_t line; /* of its edges, and of its cut with the light's plane, which it has if `cut` */
    double sign[3];
    bool cut;
} Facet;

typedef struct Window {
    double lo[2], hi[2];
} Window;

/* The derivatives in two vertices. */
typedef struct LightEdge {
    int32_t vertex[2];
    double d[2][3];
} LightEdge;

/* A lit piece, and list[from .. from + n - 1] of segments in its sub-window: of the row `near`. */
typedef struct Shown {
    Polygon p;
    uint32_t from, n;
} Shown;

/* A part of the border of what is lit, which lies left of it. sign: 1 where that is the side g > 0 of the line, or -1.
 */
typedef struct Arc {
    double from[2], to[2], sign;
    uint32_t line;
} Arc;

/* What was found for a receiver and a light. */
enum { LIGHT_KEY = 15, LIGHT_SLOTS = 512 };
typedef struct Kept {
    const void *bvh, *values;
    uint64_t begun; /* pieces_begun */
    double key[LIGHT_KEY];
    uint32_t nsegments, nshown, nnear, narcs;
    unsigned char *data;
    size_t room;
} Kept;

typedef struct LightStore {
    ROW(LightEdge) edge; /* what is told of vertices */
    ROW(int32_t) triangle;
    ROW(Segment) segment;
    ROW(Facet) facet;
    ROW(uint32_t) list;
    ROW(Polygon) piece;
    ROW(bool) lit;
    ROW(Shown) shown;
    ROW(uint32_t) near;
    ROW(Arc) arc;
    struct Arrangement *arrangement;
    uint32_t *stamp, stamps, marked; /* of each face: what is known of it, by the queries so far */
    Kept kept[LIGHT_SLOTS];
} LightStore;

/* The other query: p is a point light, the window lies on the plane of a piece's triangle around the piece. */
typedef struct Lit {
    Outline piece;
    double corner[3][3], normal[3], det; /* of its triangle, from the camera's eye; det = corner . normal */
    double eye[3];                       /* from the light */
    double to_camera[3][3];              /* of (u, v, 1), a multiple of (s, t, 1) */
    double turn;                         /* -1: (s, t) is (u, v) mirrored; else 1 */
    Polygon polygon;                     /* the piece, in (u, v) */
    double area;                         /* of what is lit, in (s, t) */
} Lit;

/* Derivatives of that area. */
typedef struct LitSlopes {
    double eye[3], corner[3], u[3], v[3], light[3];
} LitSlopes;

typedef struct Light {
    const LightScene *s;
    LightStore *store;
    Lit *lit;         /* NULL: of an area light */
    int32_t own;      /* the triangle that the window lies on, which hides nothing; -1: none */
    int nplanes;      /* of the beam: a point light has no horizon */
    uint32_t nborder; /* segments before those of the mesh */
    bool f64, lost;
    bool touches;                        /* p lies on a triangle in the beam, as far as rounding can tell */
    bool skipped;                        /* not all triangles in the beam are in the row */
    bool through;                        /* some of the mesh is on the light's plane or behind it */
    double key[LIGHT_KEY];               /* rows SLT_LIGHT_P to SLT_LIGHT_V of the question */
    double p[3], n[3], c[3], u[3], v[3]; /* c, u, v: the light's v is u here, so that det(u, v, c) > 0 */
    double row[3][3];                    /* of [u v c]^-1 */
    double near, beyond;                 /* h_z from which on nothing hides */
    double map[3][3];                    /* T */
    double cm[3], um[3], vm[3];          /* c, u, v by T */
    double uv[3], cv[3], cu[3];          /* their products */
    double clip[2][3];                   /* lines of the horizons, g as of a segment; the second if `lobe` */
    bool lobe;
    double flux[3]; /* vector irradiance, mapped: E = n . flux */
} Light;

/* Derivatives of n . flux. */
typedef struct LightSlopes {
    double n[3], corner[3], u[3], v[3], map[3][3];
    double moved[3]; /* the sum over all vertices */
} LightSlopes;

/* What a triangle is for p. */
typedef enum Facing { FACING_NOT, FACING_BEYOND, FACING_TO, FACING_AWAY } Facing; /* from FACING_TO on: it hides */

/* light_edges.c */
/* From p. */
void light_vertex(const Light *l, int32_t vertex, double at[3]);
void light_corners(const Light *l, int32_t triangle, double at[3][3]);
Facing light_facing(const Light *l, int32_t triangle, double at[3][3]);
/* The triangles that may hide something. edges: but for those none of whose edges ends a shadow; l->skipped: there were
 * such. */
void light_gather(Light *l, bool edges);
void light_edges(Light *l);  /* the way of silhouettes: all further segments, but for the lines that edges lie on */
void light_lines(Light *l);  /* which pieces need */
void light_facets(Light *l); /* the other: facets and their segments */
bool light_hides(const Light *l, int32_t triangle, double u, double v);

bool light_hides_some(const Light *l, int32_t triangle); /* it does, somewhere */

/* light_arrange.c */
/* The row of arcs. False: rounding hides how segments lie, and pieces tell. */
bool light_arrange(Light *l);
void light_arrangement_free(struct Arrangement *a);

/* light_ask.c */
enum { LIGHT_AT_ONCE = 32 }; /* places */
/* Does anything hide these places of the window? One ray each answers. */
void light_ask(Light *l, const double (*place)[2], uint32_t n, bool *dark);
/* The same by all triangles in the beam, in double precision. */
bool light_ask_all(Light *l, const double place[2]);

/* light_pieces.c */
/* The window as far as it is above the receiver's horizon: that of the lobe clips what is lit, for both queries find
 * the same. Of a piece, as far as it is the piece. */
void light_above(const Light *l, const Window *w, Polygon *p);
void light_look(Light *l, bool facets); /* the rows `shown` and `near` */
void light_shine(Light *l);             /* adds what is shown, above the lobe's horizon */

/* light_kept.c */
/* Of the receiver in this lane: fills the rows of segments, of what is shown and `near`. False: it was not asked. */
bool light_recall(Light *l, uint32_t lane);
void light_keep(Light *l, uint32_t lane);

/* light.c */
LightStore *light_store(void); /* of the thread; NULL: out of memory */
void light_borders(Light *l);  /* segments 0 .. LINE_MESH - 1; all rows are empty but for them */
bool light_wants_triangles(const Light *l);
/* The unit of the answer, 0: out of memory. head: SLT_LIGHT_EDGES units; edge: of which `n` are told, times scale. */
int32_t light_tell(const Light *l, const double *head, const LightEdge *edge, uint32_t n, double scale);

/* light_sum.c */
void light_add(Light *l, const Polygon *p, const uint32_t *list, uint32_t n);
void light_add_arcs(Light *l); /* of what is above the lobe's horizon */

/* lit.c */
void lit_add(Light *l, const Polygon *p); /* its area */
void lit_add_side(const Light *l, const double from[2], const double to[2], double sign, double j[3]);
/* lit_turn.c: makes the row of edges. */
void lit_turn(Light *l, LitSlopes *s);

/* light_turn.c */
/* Makes the row of edges. */
void light_turn(Light *l, LightSlopes *s);

/* Of numbers, inline. */
static inline double light_min(double a, double b) { return b < a ? b : a; }
static inline double light_max(double a, double b) { return b > a ? b : a; }

static inline double light_at(const double g[3], double u, double v) { return g[0] * u + g[1] * v + g[2]; }

#endif
