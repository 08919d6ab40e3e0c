/* Boxes of rays: are all of them blocked, or none (SLT_QUERY_BLOCKED)?
 *
 * Every ray is o + t d with o, d and the ends of t each anywhere in an interval. Over one triangle of the terrain
 *
 *     F = height of the ray - height of the terrain = (oz - T(o)) + t (dz - grad T . d)
 *
 * is affine in o and, for a given ray, in t: its least and greatest value over a polygon of origins and an interval of
 * t are exact but for the interval of the slope, so a box of a thousandth of a cell is told apart as well as one of a
 * hundred cells. Rays are *free* if F > 0 over every triangle that any of them may be over: a descent of the maximum
 * mipmap, nearest nodes first, which skips what lies below all of the rays. They are *blocked* if at one t all of them
 * are below the terrain; the descent tries that where the middle ray is below.
 *
 * Rays that start on the terrain are where shadows are asked for. Their oz is a height of the terrain at (ox, oy) and
 * a little more, and the two intervals by themselves would allow origins under ground. So a box may say how high its
 * origins lie above the terrain (SLT_RAY_LIFT): it is then cut at the triangles under it, over each of which oz is
 * affine too.
 *
 * What is bounded is what the kernels decide: leaf.h compares F, rounded, at the points where rays cross lines of the
 * grid. Between two of these F is linear, so that over true F the signs are the same but for rounding: of heights, of
 * the order of their magnitude, and of positions, which the slope of the triangle makes an error of height. `unit` is
 * 32 units in the last place, as in packet.inc.h: more than twice the sum of all errors. */
#include "internal.h"

#include <float.h>
#include <math.h>

enum {
    CORNERS = 8,    /* of a polygon: a rectangle cut by one line has five */
    UNDER = 16,     /* cells under a box of origins on the terrain; more are not worth the time: halve the box */
    FOOTPRINT = 16, /* cells in which all rays of a box are at one t, likewise */
    TRIES = 16,     /* cells at whose terrain rays may be, after which the answer is EITHER */
    STACK = 3 * MIP_LEVELS + 4
};

typedef struct Span {
    double lo, hi;
} Span;

/* Without the rules of fmin for NaN, which callers see to, and without a call. */
static double smaller(double a, double b) { return a < b ? a : b; }
static double larger(double a, double b) { return a > b ? a : b; }
static Span sum(Span a, Span b) { return (Span){a.lo + b.lo, a.hi + b.hi}; }
static double most(Span a) { return larger(fabs(a.lo), fabs(a.hi)); }
/* The least and the greatest s * t. */
static Span product(Span s, Span t) {
    double a = s.lo * t.lo, b = s.lo * t.hi, c = s.hi * t.lo, d = s.hi * t.hi;
    return (Span){smaller(smaller(a, b), smaller(c, d)), larger(larger(a, b), larger(c, d))};
}
static Span times_number(Span s, double v) {
    double a = s.lo * v, b = s.hi * v;
    return a < b ? (Span){a, b} : (Span){b, a};
}

/* A coordinate of the direction, turned so that it is not negative throughout, and the reciprocals of its ends. */
typedef struct Way {
    Span d, inverse;
    bool turned;
} Way;

static Way way_of(Span d) {
    Way w = {.d = d, .turned = d.hi < 0};
    if (w.turned) w.d = (Span){-d.hi, -d.lo};
    w.inverse = (Span){1 / w.d.lo, 1 / w.d.hi};
    return w;
}

/* A plane z = at + x (x - ax) + y (y - ay): a triangle's. */
typedef struct Plane {
    double ax, ay, at, x, y;
} Plane;

/* The rays whose origins lie in one polygon. */
typedef struct Rays {
    const Field *f;
    const void *heights;
    Span d[3], sumd, t; /* sumd: of dx + dy; t: all that count, a superset */
    Way way_d[3];       /* of dx, dy, dx + dy */
    Span climb;         /* dz, and what rounding of t dz makes of it */
    double last, first; /* all rays are there at t from `first` to `last` */
    double x[CORNERS], y[CORNERS];
    int corners;
    Span o[2], sumo;          /* around the polygon; sumo: of x + y */
    bool on_terrain;          /* oz = ground + lift, else oz = lift */
    Plane ground;             /* the triangle under the polygon */
    Span lift, oz;            /* oz: all of it */
    double middle[3], way[3]; /* the middle ray */
    double unit, error[2];    /* error: of positions */
    double rounding;          /* of heights */
    double lift_of;           /* magnitude of what the lift was computed from */
} Rays;

static double height(const Field *f, const void *heights, int i, int j) {
    size_t at = (size_t)((int)f->h - 1 - j) * f->w + (size_t)i;
    return f->f64 ? ((const double *)heights)[at] : (double)((const float *)heights)[at];
}

static Plane plane(const Rays *r, int i, int j, bool upper) {
    double h10 = height(r->f, r->heights, i + 1, j), h01 = height(r->f, r->heights, i, j + 1);
    if (!upper) {
        double h00 = height(r->f, r->heights, i, j);
        return (Plane){i, j, h00, h10 - h00, h01 - h00};
    }
    double h11 = height(r->f, r->heights, i + 1, j + 1);
    return (Plane){i + 1, j + 1, h11, h11 - h01, h11 - h10};
}

static double plane_at(const Plane *p, double x, double y) { return p->at + p->x * (x - p->ax) + p->y * (y - p->ay); }

/* The t, of those in `t`, at which a coordinate o + t d may lie in [a, b]; empty (lo > hi) if at none. */
static Span times(Span o, const Way *w, double a, double b, Span t) {
    Span way = {a - o.hi, b - o.lo}, none = {1, -1}, at = t;
    if (w->turned) way = (Span){-way.hi, -way.lo};
    if (w->d.lo > 0) {
        at.lo = way.lo * (way.lo >= 0 ? w->inverse.hi : w->inverse.lo);
        at.hi = way.hi * (way.hi >= 0 ? w->inverse.lo : w->inverse.hi);
    } else if (t.lo >= 0 && way.lo > 0) { /* d.lo <= 0 <= d.hi */
        if (w->d.hi == 0) return none;
        at.lo = way.lo * w->inverse.hi;
    } else if (t.lo >= 0 && way.hi < 0) {
        if (w->d.lo == 0) return none;
        at.lo = way.hi * w->inverse.lo;
    } else if (w->d.lo == 0 && w->d.hi == 0 && (way.lo > 0 || way.hi < 0)) {
        return none;
    }
    /* A NaN restricts nothing. */
    if (at.lo > t.lo) t.lo = at.lo - fabs(at.lo) * 0x1p-49;
    if (at.hi < t.hi) t.hi = at.hi + fabs(at.hi) * 0x1p-49;
    return t;
}

/* The t at which some ray may be over a rectangle of the ground. */
static Span times_over(const Rays *r, double x0, double x1, double y0, double y1) {
    Span t = times(r->o[0], &r->way_d[0], x0 - r->error[0], x1 + r->error[0], r->t);
    return t.lo <= t.hi ? times(r->o[1], &r->way_d[1], y0 - r->error[1], y1 + r->error[1], t) : t;
}

/* How far a computed F may be from the true one over ground of slopes x and y, but for what grows with t (`climb`). */
static double rounding(const Rays *r, double x, double y) {
    return r->rounding + fabs(x) * r->error[0] + fabs(y) * r->error[1];
}

/* By how much F grows with t over the plane p. */
static Span slope_above(const Rays *r, const Plane *p) {
    Span x = times_number(r->d[0], p->x), y = times_number(r->d[1], p->y), z = r->climb;
    return (Span){z.lo - x.hi - y.hi, z.hi - x.lo - y.lo};
}

/* F at t = 0 over the plane p, from corner c of the polygon, without the lift. */
static double start_above(const Rays *r, const Plane *p, int c) {
    return (r->on_terrain ? plane_at(&r->ground, r->x[c], r->y[c]) : 0) - plane_at(p, r->x[c], r->y[c]);
}

static bool is_flat(const Plane *p) { return isfinite(p->at + p->x + p->y); } /* its heights are numbers */

/* F over a triangle at t, rounding included. */
static Span above(const Rays *r, const Plane *p, Span t) {
    Span a = {INFINITY, -INFINITY};
    if (!is_flat(p)) return (Span){-INFINITY, INFINITY};
    for (int c = 0; c < r->corners; c++) {
        double over = start_above(r, p, c);
        a = (Span){smaller(a.lo, over), larger(a.hi, over)};
    }
    a = sum(sum(a, r->lift), product(slope_above(r, p), t));
    double error = rounding(r, p->x, p->y);
    return (Span){a.lo - error, a.hi + error};
}

/* The coordinate of corner c along the normal of lines x, y or x + y = const. */
static double corner_along(const Rays *r, int normal, int c) {
    return normal == 0 ? r->x[c] : normal == 1 ? r->y[c] : r->x[c] + r->y[c];
}

/* F over a triangle while the ray is between two such lines, a and b; when that is depends on the origin, and for one
 * direction F at either line is affine in it: its corners say all. The least t of a corner goes to first, the greatest
 * to last. */
static Span above_between(const Rays *r, const Plane *p, int normal, double a, double b, Span *t) {
    const Span any = {-INFINITY, INFINITY};
    Span slope = slope_above(r, p), all = {INFINITY, -INFINITY};
    *t = all;
    if (!is_flat(p) || !(r->way_d[normal].d.lo > 0)) return any;
    for (int c = 0; c < r->corners; c++) {
        double o = corner_along(r, normal, c), over = start_above(r, p, c);
        Span at = times((Span){o, o}, &r->way_d[normal], a, b, any), gain = product(slope, at);
        *t = (Span){smaller(t->lo, at.lo), larger(t->hi, at.hi)};
        all = (Span){smaller(all.lo, over + gain.lo), larger(all.hi, over + gain.hi)};
    }
    all = sum(all, r->lift);
    double error = rounding(r, p->x, p->y);
    return (Span){all.lo - error, all.hi + error};
}

/* Are no rays at the terrain in this cell, at t? */
static bool free_in_cell(const Rays *r, int i, int j, Span t) {
    double e = r->error[0] + r->error[1];
    for (int upper = 0; upper < 2; upper++) {
        double s = i + j + upper;
        Span over = times(r->sumo, &r->way_d[2], s - e, s + 1 + e, t);
        if (!(over.lo <= over.hi)) continue;
        Plane p = plane(r, i, j, upper);
        if (above(r, &p, over).lo > 0) continue;
        if (above_between(r, &p, 2, s - e, s + 1 + e, &over).lo > 0) continue;
        if (above_between(r, &p, 0, i - r->error[0], i + 1 + r->error[0], &over).lo > 0) continue;
        if (above_between(r, &p, 1, j - r->error[1], j + 1 + r->error[1], &over).lo > 0) continue;
        return false;
    }
    return true;
}

/* Are all rays below the terrain at t, inside the box? */
static bool all_below(const Rays *r, double t) {
    const int w = (int)r->f->w, h = (int)r->f->h;
    if (!(t >= r->first && t <= r->last)) return false;
    Span at = {t, t};
    Span x = sum(r->o[0], product(r->d[0], at)), y = sum(r->o[1], product(r->d[1], at)),
         s = sum(r->sumo, product(r->sumd, at));
    if (!(x.lo - r->error[0] >= 0 && x.hi + r->error[0] <= w - 1)) return false;
    if (!(y.lo - r->error[1] >= 0 && y.hi + r->error[1] <= h - 1)) return false;
    int i0 = (int)(x.lo - r->error[0]), i1 = (int)(x.hi + r->error[0]);
    int j0 = (int)(y.lo - r->error[1]), j1 = (int)(y.hi + r->error[1]);
    i1 = i1 < w - 1 ? i1 : w - 2, j1 = j1 < h - 1 ? j1 : h - 2;
    if ((i1 - i0 + 1) * (j1 - j0 + 1) > FOOTPRINT) return false;
    double e = r->error[0] + r->error[1];
    for (int j = j0; j <= j1; j++)
        for (int i = i0; i <= i1; i++)
            for (int upper = 0; upper < 2; upper++) {
                if (s.hi + e < i + j + upper || s.lo - e > i + j + 1 + upper) continue;
                Plane p = plane(r, i, j, upper);
                if (!(above(r, &p, at).hi < 0)) return false;
            }
    return true;
}

/* Are the heights at and beside vertex (i, j) numbers? One that is none spoils a comparison next to it. */
static bool numbers_around(const Field *f, const void *heights, int i, int j) {
    int i0 = i > 0 ? i - 1 : 0, i1 = i + 2 < (int)f->w ? i + 2 : (int)f->w - 1;
    int j0 = j > 0 ? j - 1 : 0, j1 = j + 2 < (int)f->h ? j + 2 : (int)f->h - 1;
    double sum = 0;
    for (int y = j0; y <= j1; y++)
        for (int x = i0; x <= i1; x++) sum += 0 * height(f, heights, x, y);
    return sum == 0;
}

/* Are all rays below the terrain where they cross the line x, y or x + y = n of the grid, inside the box? */
static bool all_below_at(const Rays *r, int normal, int n) {
    const int w = (int)r->f->w, h = (int)r->f->h;
    const Span any = {-INFINITY, INFINITY};
    if (!(r->way_d[normal].d.lo > 0)) return false;
    /* At an end of a ray the crossing may count as that end, which is decided elsewhere. */
    double end = 2 * (r->error[0] + r->error[1]) * r->way_d[normal].inverse.lo;
    Span x = {INFINITY, -INFINITY}, y = x, t;
    for (int c = 0; c < r->corners; c++) {
        double o = corner_along(r, normal, c);
        t = times((Span){o, o}, &r->way_d[normal], n, n, any);
        if (!(t.lo >= r->first + end && t.hi <= r->last - end)) return false;
        Span dx = product(r->d[0], t), dy = product(r->d[1], t);
        x = (Span){smaller(x.lo, r->x[c] + dx.lo), larger(x.hi, r->x[c] + dx.hi)};
        y = (Span){smaller(y.lo, r->y[c] + dy.lo), larger(y.hi, r->y[c] + dy.hi)};
    }
    if (!(x.lo - r->error[0] >= 0 && x.hi + r->error[0] <= w - 1)) return false;
    if (!(y.lo - r->error[1] >= 0 && y.hi + r->error[1] <= h - 1)) return false;
    int along = normal == 1 ? 0 : 1;
    Span across = along ? y : x;
    int from = (int)(across.lo - r->error[along]), to = (int)(across.hi + r->error[along]);
    if (to - from >= FOOTPRINT) return false;
    for (int k = from; k <= to; k++) {
        int i = normal == 0 ? n : normal == 1 ? k : n - 1 - k, j = normal == 1 ? n : k;
        bool upper = false; /* the far border is an edge of the upper triangles */
        if (i == w - 1) upper = normal == 0, i--;
        if (j == h - 1) upper |= normal == 1, j--;
        if (i < 0 || j < 0) return false;
        Plane p = plane(r, i, j, upper);
        if (!(above_between(r, &p, normal, n, n, &t).hi < 0) || !numbers_around(r->f, r->heights, i, j)) return false;
    }
    return true;
}

/* Are all rays that enter or leave the box through its border (a line x or y = n) below the terrain beside it, where
 * the last one has come in or before the first one has left? */
static bool all_below_beside(const Rays *r, int normal, int n, bool enters) {
    const Span any = {-INFINITY, INFINITY};
    double inside = n + (n ? -2 : 2) * r->error[normal], t = enters ? r->first : r->last;
    if (!(r->way_d[normal].d.lo > 0)) return false;
    for (int c = 0; c < r->corners; c++) {
        double o = corner_along(r, normal, c);
        Span at = times((Span){o, o}, &r->way_d[normal], inside, inside, any);
        t = enters ? larger(t, at.hi) : smaller(t, at.lo);
    }
    return all_below(r, t);
}

/* Are all rays below the terrain at one t, or at one line of the grid, where the middle ray is in this cell? */
static bool blocked_in_cell(const Rays *r, int i, int j) {
    const double *o = r->middle, *d = r->way;
    const double lines[3][2] = {{i, i + 1}, {j, j + 1}, {i + j + 1, i + j + 1}};
    double least = 0, best = NAN;
    int normal = 0, line = 0;
    for (int n = 0; n < 3; n++)
        for (int k = 0; k < 2; k++) {
            double along = n < 2 ? o[n] : o[0] + o[1], speed = n < 2 ? d[n] : d[0] + d[1];
            double t = (lines[n][k] - along) / speed, x = o[0] + t * d[0], y = o[1] + t * d[1];
            bool here = x >= i - 1e-9 && x <= i + 1 + 1e-9 && y >= j - 1e-9 && y <= j + 1 + 1e-9;
            if (!here || !(t >= r->first && t <= r->last)) continue;
            Plane p = plane(r, i, j, x + y >= i + j + 1);
            double z = o[2] + t * d[2] - plane_at(&p, x, y);
            if (z < least) least = z, best = t, normal = n, line = (int)lines[n][k];
        }
    if (least < 0 && all_below_at(r, normal, line)) return true;
    int last = normal == 0 ? (int)r->f->w - 1 : (int)r->f->h - 1;
    bool border = normal < 2 && (line == 0 || line == last);
    if (least < 0 && border && all_below_beside(r, normal, line, (line == 0) == (d[normal] > 0))) return true;
    if (r->last < r->first) return false;
    /* Ends of the rays, and origins under ground. */
    if (least < 0) return all_below(r, best);
    return all_below(r, r->first) || all_below(r, r->last);
}

/* Does the middle ray meet anything? If not, not all rays do. */
static bool middle_meets(const Rays *r) {
    const Field *f = r->f;
    double row[SLT_RAY_POINT_ROWS] = {r->middle[0], r->middle[1], r->middle[2], r->way[0],
                                      r->way[1],    r->way[2],    r->first,     r->last};
    float narrow[SLT_RAY_POINT_ROWS];
    for (int n = 0; n < SLT_RAY_POINT_ROWS; n++) narrow[n] = (float)row[n];
    int32_t found;
    field_kernels(f->isa)->query[f->f64][SLT_QUERY_OCCLUDED](&f->base.shared, r->heights,
                                                             f->f64 ? (void *)row : (void *)narrow, 1, 1, &found);
    return found != SLT_WITNESS_NONE;
}

typedef struct Node {
    int level, i, j;
    Span t; /* when rays may be over it */
} Node;

/* Are all rays above everything in the node? */
static bool passes_over(const Rays *r, const Node *at) {
    const Mipmap *m = &r->f->mip;
    double top = (double)m->data[m->base[at->level] + at->j * m->stride[at->level] + at->i];
    return r->oz.lo + product(r->climb, at->t).lo - r->rounding > top + (double)r->f->base.shared.slack;
}

/* Nodes [lo, hi] along an axis, of the cells over which rays are at t. */
static bool node_range(const Rays *r, int axis, int cells, Span t, int level, int range[2]) {
    Span at = sum(r->o[axis], product(r->d[axis], t));
    at = (Span){at.lo - r->error[axis] - 1, at.hi + r->error[axis] + 1};
    if (at.hi < 0 || at.lo > cells) return false;
    range[0] = (int)larger(at.lo, 0) >> level;
    range[1] = (int)smaller(at.hi, cells - 1) >> level;
    return true;
}

/* The rays of one polygon of origins: the mipmap, from a level where few nodes hold all that may be met. */
static int descend(Rays *r) {
    const Field *f = r->f;
    const Mipmap *m = &f->mip;
    const int cells[2] = {(int)f->w - 1, (int)f->h - 1}, near[2] = {r->way[0] >= 0, r->way[1] >= 0};
    const double highest = (double)m->max + (double)f->base.shared.slack;
    /* Rays that rise are above everything some time. */
    if (r->t.lo >= 0 && r->climb.lo > 0) {
        double end = (highest + r->rounding - r->oz.lo) / r->climb.lo;
        if (end < r->t.hi) r->t.hi = larger(end + fabs(end) * 0x1p-49, 0);
    }
    if (!(r->t.lo <= r->t.hi)) return SLT_RAYS_FREE;
    int level = 1, range[2][2];
    for (;; level++) {
        for (int a = 0; a < 2; a++)
            if (!node_range(r, a, cells[a], r->t, level, range[a])) return SLT_RAYS_FREE;
        if (level == m->top || (range[0][1] - range[0][0] < 2 && range[1][1] - range[1][0] < 2)) break;
    }
    bool free = true;
    int tries = 0, columns = range[0][1] - range[0][0] + 1, rows = range[1][1] - range[1][0] + 1;
    for (int start = 0; start < columns * rows; start++) {
        int column = start % columns, row = start / columns, n = 0;
        Node stack[STACK];
        Node first = {level, near[0] ? range[0][0] + column : range[0][1] - column,
                      near[1] ? range[1][0] + row : range[1][1] - row, r->t};
        int size = 1 << level;
        first.t = times_over(r, first.i * size, (first.i + 1) * size, first.j * size, (first.j + 1) * size);
        if (first.t.lo <= first.t.hi && !passes_over(r, &first)) stack[n++] = first;
        while (n) {
            Node at = stack[--n];
            if (!at.level) {
                if (free_in_cell(r, at.i, at.j, at.t)) continue;
                if (free && !middle_meets(r)) return SLT_RAYS_EITHER;
                free = false;
                if (blocked_in_cell(r, at.i, at.j)) return SLT_RAYS_BLOCKED;
                if (++tries == TRIES) return SLT_RAYS_EITHER;
                continue;
            }
            /* The two halves along each axis make four children, the nearest on top. */
            int half = 1 << (at.level - 1), corner[2] = {2 * at.i, 2 * at.j};
            Span t[2][2];
            for (int a = 0; a < 2; a++)
                for (int k = 0; k < 2; k++) {
                    double low = (double)(corner[a] + k) * half;
                    t[a][k] = times(r->o[a], &r->way_d[a], low - r->error[a], low + half + r->error[a], at.t);
                }
            for (int k = 3; k >= 0; k--) {
                int x = (k & 1) == near[0], y = (k >> 1) == near[1];
                Node child = {at.level - 1,
                              corner[0] + x,
                              corner[1] + y,
                              {larger(t[0][x].lo, t[1][y].lo), smaller(t[0][x].hi, t[1][y].hi)}};
                if (child.i * half >= cells[0] || child.j * half >= cells[1]) continue; /* no such cells */
                if (child.t.lo <= child.t.hi && (!child.level || !passes_over(r, &child))) stack[n++] = child;
            }
        }
    }
    return free ? SLT_RAYS_FREE : SLT_RAYS_EITHER;
}

/* Sets up what follows from the polygon. */
static int ask_polygon(const Rays *whole) {
    Rays room = *whole, *r = &room;
    r->o[0] = r->o[1] = r->sumo = (Span){INFINITY, -INFINITY};
    double mx = 0, my = 0;
    Span ground = {INFINITY, -INFINITY};
    for (int c = 0; c < r->corners; c++) {
        double x = r->x[c], y = r->y[c];
        r->o[0] = (Span){smaller(r->o[0].lo, x), larger(r->o[0].hi, x)};
        r->o[1] = (Span){smaller(r->o[1].lo, y), larger(r->o[1].hi, y)};
        r->sumo = (Span){smaller(r->sumo.lo, x + y), larger(r->sumo.hi, x + y)};
        mx += x / r->corners, my += y / r->corners;
        double z = r->on_terrain ? plane_at(&r->ground, x, y) : 0;
        ground = (Span){smaller(ground.lo, z), larger(ground.hi, z)};
    }
    r->oz = sum(ground, r->lift);
    r->middle[0] = mx, r->middle[1] = my;
    r->middle[2] = (r->on_terrain ? plane_at(&r->ground, mx, my) : 0) + 0.5 * (r->lift.lo + r->lift.hi);
    double side = (double)(r->f->w > r->f->h ? r->f->w : r->f->h);
    for (int a = 0; a < 2; a++) r->error[a] = r->unit * (most(r->o[a]) + side) + FLT_MIN;
    double heights = most(r->oz) + r->f->magnitude + (double)r->f->base.shared.slack + r->lift_of;
    r->rounding = r->unit * heights + FLT_MIN;
    if (!(r->oz.lo <= r->oz.hi)) return SLT_RAYS_EITHER; /* NaN: heights that are not finite */
    return descend(r);
}

/* Cuts the polygon by x + y <= s, or >= s. */
static void cut(Rays *r, double s, bool above_it) {
    double x[CORNERS], y[CORNERS];
    int n = 0;
    for (int c = 0; c < r->corners; c++) {
        int next = c + 1 < r->corners ? c + 1 : 0;
        double a = r->x[c] + r->y[c] - s, b = r->x[next] + r->y[next] - s;
        if (above_it ? a >= 0 : a <= 0) x[n] = r->x[c], y[n++] = r->y[c];
        if ((a < 0 && b > 0) || (a > 0 && b < 0)) {
            double u = a / (a - b);
            x[n] = r->x[c] + u * (r->x[next] - r->x[c]), y[n++] = r->y[c] + u * (r->y[next] - r->y[c]);
        }
    }
    r->corners = n;
    for (int c = 0; c < n; c++) r->x[c] = x[c], r->y[c] = y[c];
}

static void rectangle(Rays *r, double x0, double x1, double y0, double y1) {
    const double x[4] = {x0, x1, x1, x0}, y[4] = {y0, y0, y1, y1};
    r->corners = 4;
    for (int c = 0; c < 4; c++) r->x[c] = x[c], r->y[c] = y[c];
}

/* Origins on the terrain: the answer of all the triangles under them. */
static int ask_on_terrain(Rays *r, Span x, Span y) {
    const int w = (int)r->f->w, h = (int)r->f->h;
    int i0 = (int)floor(x.lo), i1 = (int)floor(x.hi), j0 = (int)floor(y.lo), j1 = (int)floor(y.hi), answer = 0;
    if (i1 == w - 1) i1--;
    if (j1 == h - 1) j1--;
    if (i0 > i1) i0 = i1;
    if (j0 > j1) j0 = j1;
    if ((i1 - i0 + 1) * (j1 - j0 + 1) > UNDER) return SLT_RAYS_EITHER;
    bool any = false;
    for (int j = j0; j <= j1; j++)
        for (int i = i0; i <= i1; i++)
            for (int upper = 0; upper < 2; upper++) {
                rectangle(r, fmax(x.lo, i), fmin(x.hi, i + 1), fmax(y.lo, j), fmin(y.hi, j + 1));
                cut(r, i + j + 1, upper);
                if (!r->corners) continue;
                r->ground = plane(r, i, j, upper);
                /* The line at the far end is that of the cell before too, where all heights are numbers. */
                bool line = (i == x.hi && i > i0) || (j == y.hi && j > j0);
                if (line && isfinite(r->ground.at + r->ground.x + r->ground.y)) continue;
                int one = ask_polygon(r);
                if (one == SLT_RAYS_EITHER || (any && one != answer)) return SLT_RAYS_EITHER;
                answer = one, any = true;
            }
    return any ? answer : SLT_RAYS_EITHER;
}

static bool ordered(Span a) { return a.lo <= a.hi && a.lo > -INFINITY && a.hi < INFINITY; }

static int ask(const Field *f, const void *heights, const double row[SLT_BOX_ROWS]) {
    Span in[SLT_RAY_ROWS];
    for (int n = 0; n < SLT_RAY_ROWS; n++) in[n] = (Span){row[n], row[n + SLT_RAY_ROWS]};
    for (int n = SLT_RAY_OX; n <= SLT_RAY_DZ; n++)
        if (n != SLT_RAY_OZ && !ordered(in[n])) return SLT_RAYS_EITHER;
    const double big = f->f64 ? 1e300 : 1e30, flat = f->f64 ? 1 / DBL_MAX : 1 / (double)FLT_MAX;
    Span t0 = in[SLT_RAY_T0], t1 = in[SLT_RAY_T1];
    /* Differences of such heights overflow in the kernels. */
    if (!(f->magnitude < 0.25 * (f->f64 ? DBL_MAX : (double)FLT_MAX))) return SLT_RAYS_EITHER;
    if (!(t0.lo <= t0.hi) || !(t1.lo <= t1.hi)) return SLT_RAYS_EITHER;
    Rays r = {.f = f,
              .heights = heights,
              .d = {in[SLT_RAY_DX], in[SLT_RAY_DY], in[SLT_RAY_DZ]},
              .t = {fmax(t0.lo, -big), fmin(t1.hi, big)},
              .first = fmax(t0.hi, -big),
              .last = fmin(t1.lo, big),
              .unit = f->f64 ? 0x1p-48 : 0x1p-19};
    if (!(r.t.lo <= r.t.hi)) return SLT_RAYS_FREE; /* no ray has any t */
    for (int a = 0; a < 2; a++) {                  /* so small a component may count as 0 */
        if (r.d[a].lo > 0 && r.d[a].lo <= 2 * flat) r.d[a].lo = 0;
        if (r.d[a].hi < 0 && r.d[a].hi >= -2 * flat) r.d[a].hi = 0;
    }
    r.sumd = sum(r.d[0], r.d[1]);
    for (int a = 0; a < 3; a++) r.way_d[a] = way_of(a < 2 ? r.d[a] : r.sumd);
    double steep = r.unit * most(r.d[2]);
    r.climb = (Span){r.d[2].lo - steep, r.d[2].hi + steep};
    for (int a = 0; a < 3; a++) r.way[a] = 0.5 * (r.d[a].lo + r.d[a].hi);
    Span x = in[SLT_RAY_OX], y = in[SLT_RAY_OY], lift = in[SLT_RAY_LIFT];
    const double wide = (double)f->w - 1, high = (double)f->h - 1;
    if (ordered(lift) && ordered(in[SLT_RAY_LIFT_OF]) && x.lo >= 0 && x.hi <= wide && y.lo >= 0 && y.hi <= high) {
        r.on_terrain = true, r.lift = lift, r.lift_of = most(in[SLT_RAY_LIFT_OF]);
        return ask_on_terrain(&r, x, y);
    }
    if (!ordered(in[SLT_RAY_OZ])) return SLT_RAYS_EITHER;
    r.lift = in[SLT_RAY_OZ];
    rectangle(&r, x.lo, x.hi, y.lo, y.hi);
    return ask_polygon(&r);
}

void field_boxes(const SltGeometry *field, const void *heights, const void *rays, uint64_t mask, uint32_t width,
                 int32_t *out) {
    Field room;
    const Field *f = field_asked(field, &room);
    for (uint32_t lane = 0; lane < width; lane++) {
        out[lane] = SLT_RAYS_FREE;
        if (!(mask >> lane & 1)) continue;
        double row[SLT_BOX_ROWS];
        for (uint32_t n = 0; n < SLT_BOX_ROWS; n++)
            row[n] =
                f->f64 ? ((const double *)rays)[n * width + lane] : (double)((const float *)rays)[n * width + lane];
        out[lane] = ask(f, heights, row);
    }
}
