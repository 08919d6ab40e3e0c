/* What the search for pieces works on: windows, triangles in them, polygons; the store of the thread. */
#ifndef SALTUS_MESH_WINDOW_H
#define SALTUS_MESH_WINDOW_H

#include "outline.h"
#include "pieces.h"
#include "saltus/mesh.h"

typedef struct Window {
    double eye[3], u[3], v[3], c[3];
    bool far;           /* Beams */
    double q[3], own;   /* the same */
    double plane[3][3]; /* rows of the inverse of (u v c) times |its determinant|: w s, w t, w of a point, w > 0 ahead;
                           where they are asked */
    double beside[2];   /* by which s and t of what lies where are widened */
    /* A frame's: times |(u x v) . c| of a window whose frame it is, the power of two in its bits; 0: it is not one. */
    double per_power;
    int64_t power;
} Window;
#define POWER_OF_TWO 0x7ff0000000000000 /* of the bits of a double */
#define GRAZING 1e8 /* times the square of how far away its plane is: as far as a window with a frame is */

typedef struct Rectangle {
    double lo[2], hi[2];
} Rectangle;

/* A triangle that windows of one eye may see. */
typedef struct Near {
    _Alignas(64) double normal[4][3]; /* of each edge: d . normal is g, positive inside; the last: d . that is 1 / t, of
                                         far eyes less that of the plane through the origin across the eye */
    double spread[4][2]; /* what they add at a window's corners: the least and the most. Adding rounds alike whichever
                            is added, so what is least here is least of the sums */
    double nearest;      /* at least 1 / t of all of it, times a window's Places.far; of far eyes not known */
    int32_t triangle;
    uint32_t turned;    /* edges run from their second corner to their first for g to be positive inside */
    double along[4][2]; /* normals times u and v of the windows that it was listed for */
    double base[4];     /* of far eyes: what normals times the way from the eye to the origin are */
    uint64_t edge[3];   /* window_edge of its edges */
    int32_t corner[3];
} Near;

/* Where eight of them lie in the frame that they were listed in; where there is none, nowhere. */
typedef struct NearBoxes {
    _Alignas(64) double lo[2][8], hi[2][8];
    double nearest[8]; /* Near */
} NearBoxes;

/* Eight of them that windows which are looked through together may see. */
typedef struct Close {
    NearBoxes box;
    uint32_t near[8];
} Close;

/* What the windows of eight lanes have of a triangle. */
typedef struct Found {
    _Alignas(64) double least[8], most[8]; /* of 1 / t at the window's corners */
    double c[3][8];                        /* g of its edges at the first corner */
    uint32_t near;                         /* its number */
    uint32_t turned;
} Found;

/* A triangle that the window of a lane may see. */
typedef struct Candidate {
    double least, most; /* Found */
    int32_t triangle;
    uint32_t near;
    uint32_t part; /* of sheets: where it was measured (sheet.inc.h) */
    uint32_t turned;
} Candidate;

/* The same where that is not all there is to say. */
typedef struct Facet {
    double g[3][3], depth[3];
    double most;         /* of 1 / t at the window's corners */
    double lo[2], hi[2]; /* where it lies, if the window is halved */
    uint32_t own;        /* where its polygon is, if nothing crosses */
    int32_t triangle;
    bool turned;
} Facet;

/* What eight triangles have of a window each: sheet.inc.h. */
typedef struct Parts {
    _Alignas(64) double area[8], centre[2][8];
    double end[3][4][8]; /* of the part of each edge in the window: s and t of its begin, of its end */
    double weight[3][8]; /* SLT_SIDE_WEIGHT */
    uint8_t there[3];    /* bit i: of triangle i this edge has a part */
    uint8_t good;        /* bit i: all that is known */
} Parts;

enum { LINES = 256 };

/* Edges of the triangles of parts that are measured next, as lines g = 0 of their windows. */
typedef struct PartLines {
    double g[3][3][LINES + 8];
    uint32_t measured; /* before them */
} PartLines;

/* Where two facets cross. */
typedef struct Crossing {
    double g[3];
    int32_t a, b; /* triangles: g is 1 / t of a less that of b */
} Crossing;

/* Which line a side lies on: one that does not move, edge k of a facet, a crossing. */
#define SIDE_FIXED 0u
#define SIDE_OF(facet, k) (1 + 3 * (facet) + (k))
#define SIDE_CROSSING 0x80000000u

enum {
    FEW_FACETS = 48, /* facets in a part of a window that is not halved */
    CORNERS = 16,    /* of a polygon, at most; one that is kept has at most KEPT */
    KEPT = 12
};
#define ON_LINE 2e-13 /* of a window's side: nearer to a line is on it */
#define SAME_DEPTH 1e-11
#define COVERED 1e-12 /* of a rectangle may be left of it that counts as covered */

/* Counter-clockwise in (s, t). Side k goes from corner k to the next. */
typedef struct Polygon {
    int32_t facet; /* -1: nothing is seen here */
    uint32_t n;
    double least; /* of 1 / t at the corners */
    double s[CORNERS], t[CORNERS];
    uint32_t side[CORNERS];
} Polygon;

/* Around eight polygons of the row: nothing of one that has been taken out. */
typedef struct Extents {
    _Alignas(64) double lo[2][8], hi[2][8], area[8];
} Extents;

#define ROW(type) \
    struct { \
        type *data; \
        uint32_t n, room; \
    }

typedef struct Unit {
    double number[SLT_TOLD];
} Unit;

/* held.c */
struct Held {
    bool on, full;           /* full: nothing more is kept */
    uint32_t n, kept;        /* windows; units of the store that stay */
    struct HeldWindows *all; /* NULL: none so far */
};

/* What store->near was listed for. */
typedef struct Listed {
    uint64_t version; /* Bvh; 0: of nothing that could come again */
    Window window;    /* window_frame */
    Rectangle in;
    double middle[2]; /* of the windows that were looked through last */
    uint32_t reach;   /* how many windows ahead */
} Listed;

typedef struct Store {
    Unit *unit; /* the number of the last unit, then n units, of floats half as long */
    uint32_t n, room;
    bool lost;        /* something did not fit */
    uint32_t edge_on; /* of `near` or beside it some may be seen as lines; 0: none is */
    Held held;
    ROW(int32_t) list;
    ROW(Near) near;
    ROW(NearBoxes) boxes;
    ROW(Close) close; /* n triangles, in eights */
    Listed listed;
    ROW(Found) found;         /* of a row of eight lanes */
    ROW(uint8_t) met;         /* which of them */
    ROW(uint32_t) order;      /* of what a lane has found */
    ROW(double) most;         /* the same */
    ROW(Candidate) candidate; /* FEW_FACETS for each lane, OTHER_CANDIDATES behind */
    ROW(Parts) parts;
    PartLines lines;
    ROW(Facet) facet;
    ROW(uint32_t) chosen; /* facets of a part of the window */
    ROW(Crossing) crossing;
    ROW(Polygon) piece;   /* number 0 is none */
    ROW(uint32_t) live;   /* those of the row */
    ROW(Extents) extents; /* of these: n, of how many */
    ROW(OutlineBeam) beam;
    ROW(OutlineRow) outline; /* of pieces, by unit */
    ROW(OutlinePlace) corner;
    ROW(OutlinePart) part;
    ROW(OutlineAnswer) answer;
} Store;

/* Room for `more`; false: there is none, which the store remembers. */
bool window_more_room(Store *s, void *row, uint32_t n, uint32_t *room, uint32_t more, size_t size);
static inline bool window_room(Store *s, void *row, uint32_t n, uint32_t *room, uint32_t more, size_t size) {
    return n + more <= *room || window_more_room(s, row, n, room, more, size);
}
#define PUSH(store, row, value) \
    (window_room(store, &(row).data, (row).n, &(row).room, 1, sizeof *(row).data) \
         ? ((row).data[(row).n++] = (value), true) \
         : false)

/* A search in progress. */
typedef struct Search {
    const PieceScene *scene;
    Store *store;
    bool f64;
    Window window;
    const Candidate *candidate; /* what it may see, nearest first */
    bool alike;                 /* its u and v are those of the window that was listed for */
    uint32_t first, last;       /* units of pieces; 0: none yet */
} Search;

enum { LANES = 64, OTHER_CANDIDATES = LANES * FEW_FACETS };

/* Windows of lanes, rows of SltBeamRow; the corner seen from the eye. */
enum { BEAM_Q = SLT_BEAM_ROWS, BEAM_OWN = BEAM_Q + 3, BEAM_ALL };
typedef struct Beams {
    /* Behind them the corner once more: BEAM_Q from the origin, BEAM_OWN 1, where the eye is far from the mesh and the
     * window is not; elsewhere BEAM_Q is from the eye, BEAM_OWN 0. For all that is linear in directions the corner
     * counts BEAM_Q + BEAM_OWN * (the origin from the eye), of which the second part is the triangle's (Near.base). */
    _Alignas(64) double row[BEAM_ALL][LANES];
    uint64_t mask, far; /* far: the eye is */
    uint64_t blind;     /* asked, but with a number that is not finite, or beyond 1e30 */
    bool shared;        /* eye, u and v are those of all lanes: their rows are eight long */
} Beams;
/* Where a lane's eye, u and v are in their rows. */
static inline uint32_t beam_lane(const Beams *b, uint32_t lane) { return b->shared ? lane % 8 : lane; }
#define FAR_EYE 8.0 /* times the mesh's largest coordinate */
#define NEAR_WINDOW 0.25 /* of the way to the eye: a corner nearer to the origin */

/* Where they lie in the frame of one of them. */
typedef struct Places {
    uint64_t ahead; /* of which that can be said, and whose frame it is if they are alike */
    uint64_t alike; /* whose u and v are the same */
    _Alignas(64) double lo[2][LANES], hi[2][LANES];
    double far[LANES]; /* how far the window's plane is from the eye, of those which are alike; else infinite */
    Rectangle all;     /* around those of the mask from `base` on */
    double area;       /* of these */
} Places;

/* Windows from `base` to `last`, which are looked through together. Of a lane first the triangles that face as the
 * nearest does are known: candidates from first[k] on, nearest first; of more than FEW_FACETS only that. */
typedef struct Neighbours {
    uint32_t base, last;
    Rectangle all;           /* around them */
    bool alike;              /* all have the same u and v */
    uint64_t whole;          /* lanes with nothing but triangle[k], which fills the window */
    uint64_t open;           /* those with others */
    int32_t triangle[LANES]; /* of these */
    uint32_t first[LANES], count[LANES];
    double others[LANES]; /* the most of 1 / t of those which face the other way */
} Neighbours;

/* beams.inc.h, facets.inc.h, cover.inc.h */
typedef struct FacetSearch {
    /* Do all windows, of rows as they come, surely lie in a rectangle of the frame, and where? */
    bool (*inside)(const Window *frame, const Rectangle *in, bool f64, const void *rays, uint32_t width,
                   Rectangle *all);
    /* Windows as the search takes them. */
    void (*read)(Beams *b, bool f64, const void *rays, uint64_t mask, uint32_t width, double magnitude);
    void (*place)(const Window *window, const Beams *b, uint32_t base, uint32_t width, Places *out);
    /* Fills store->near with the triangles in a rectangle of the window. */
    void (*list)(Search *s, const Window *window, const Rectangle *r);
    /* Fills store->candidate with those of them that the windows may see and that face as the nearest does, and
     * measures them: they may be one sheet. */
    void (*survey)(Search *s, const Beams *b, const Places *lie, Neighbours *n);
    /* Adds all that the window of one lane may see. */
    void (*survey_all)(Search *s, const Beams *b, const Places *lie, Neighbours *n, uint32_t lane);
    /* store->live becomes what is seen in a rectangle of facets chosen[from], ..., nearest first. */
    void (*cover)(Search *s, const Rectangle *r, uint32_t from, uint32_t n);
    /* What lies on either side of the line g = 0; in: where it is positive. */
    void (*split)(const Polygon *p, const double g[3], uint32_t side, Polygon *in, Polygon *out);
} FacetSearch;

void window_planes(Window *w);
static inline double window_at(const double g[3], double s, double t) { return g[0] * s + g[1] * t + g[2]; }
static inline double window_dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
static inline void window_cross(const double a[3], const double b[3], double out[3]) {
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        out[i] = a[j] * b[k] - a[k] * b[j];
    }
}
/* A number of an edge, from its first corner to its second, for sums in which the other way is the same less. */
static inline uint64_t window_edge(int32_t a, int32_t b) {
    const uint32_t low = (uint32_t)(a < b ? a : b), high = (uint32_t)(a < b ? b : a);
    uint64_t n = ((uint64_t)low << 32 | high) * 0x9e3779b97f4a7c15u;
    n = (n ^ n >> 32) * 0xd6e8feb86659fd93u;
    return a < b ? n ^ n >> 32 : 0 - (n ^ n >> 32);
}
/* A vertex from the eye. */
static inline void window_vertex(const Search *s, int32_t vertex, double out[3]) {
    const size_t at = 3 * (size_t)vertex;
    for (size_t a = 0; a < 3; a++)
        out[a] =
            (s->f64 ? ((const double *)s->scene->values)[at + a] : (double)((const float *)s->scene->values)[at + a]) -
            s->window.eye[a];
}

/* Makes facets of the first n candidates; some may be there. */
static inline void window_facets(const Search *s, uint32_t n) {
    Store *store = s->store;
    for (; store->facet.n < n; store->facet.n++) {
        const Candidate *c = &s->candidate[store->facet.n];
        const Near *near = &store->near.data[c->near];
        Facet *f = &store->facet.data[store->facet.n];
        for (int k = 0; k < 4; k++) {
            double *to = k < 3 ? f->g[k] : f->depth;
            to[0] = s->alike ? near->along[k][0] : window_dot(near->normal[k], s->window.u);
            to[1] = s->alike ? near->along[k][1] : window_dot(near->normal[k], s->window.v);
            to[2] = window_dot(near->normal[k], s->window.q);
            if (s->window.far) to[2] += s->window.own * near->base[k];
        }
        f->most = c->most, f->triangle = c->triangle, f->turned = c->turned != 0;
    }
}

/* told.c */
Store *told_store(void); /* of the thread; NULL: out of memory */
void told_end(Store *s); /* behind the last of a search */
void told_whole(Search *s, int32_t triangle);
/* Of n candidates, at most FEW_FACETS, nearest first, that face alike; others: the most of 1 / t of those which do not.
 * False: they are not one sheet in front of all others, and nothing is told. */
bool told_sheet(Search *s, const Candidate *c, uint32_t n, double others);
void told_piece(Search *s, const Polygon *p);

#endif
