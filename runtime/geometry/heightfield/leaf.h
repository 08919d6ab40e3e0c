/* The one arithmetic that decides where a ray meets the terrain. Every structure and width uses these functions, so
 * that all give the same answer, bit for bit.
 *
 * A ray's path through the grid is a merge of two sorted lists: the parameters t at which the ray crosses the lines
 * x = 0, 1 ... and y = 0, 1 ... Line X is crossed at (X - ox) * (1 / dx), a monotone function of X in floating point
 * too. All there is to know about a cell (by which side the ray leaves it, when, whether it is visited at all) follows
 * from comparing such parameters, never from positions; so a traversal that jumps over blocks of cells stays on the
 * same path as one that goes cell by cell.
 *
 * What is decided, is decided at crossing points: where the ray leaves a cell (exit), where it crosses the cell's
 * diagonal between (diag), and at the two ends of the ray (start, end). At each, F = height of the ray - height of the
 * terrain; between them F is linear. A crossing belongs to the cell that the ray leaves: it is computed once, and no
 * rounding opens a gap between neighbours.
 *
 *      (i, j+1) ---- (i+1, j+1)
 *          |  \   upper  |
 *          |    \        |
 *          | lower  \    |
 *      (i, j) ------ (i+1, j)
 *
 * Included after simd.h, once for each instance. */
#include <float.h>

#define Ray FN(Ray)
#define Leaf FN(Leaf)
#define Search FN(Search)
#define ray_setup FN(ray_setup)
#define ray_locate FN(ray_locate)
#define ray_plane FN(ray_plane)
#define ray_start FN(ray_start)
#define leaf_test FN(leaf_test)
#define line_x FN(line_x)
#define line_y FN(line_y)
#define lerp FN(lerp)
#define search_start FN(search_start)
#define search_leaf FN(search_leaf)
#define clamp01 FN(clamp01)
#define search_event FN(search_event)

#undef FLT_BIG
#undef FLT_TINY
#undef FLT_MAXIMUM
#if F64
#define FLT_BIG 1e300   /* infinite t are taken as this */
#define FLT_TINY 1e-300 /* the least t at which a clearance or a slope is formed */
#define FLT_MAXIMUM DBL_MAX
#else
#define FLT_BIG 1e30f
#define FLT_TINY 1e-30f
#define FLT_MAXIMUM FLT_MAX
#endif

typedef struct Ray {
    vf ox, oy, oz, dx, dy, dz, t1;
    vf rdx, rdy; /* 1 / dx; +infinity where dx = 0 */
    vf so, rds;  /* x + y of the origin, 1 / (dx + dy) */
    vi sx, sy;   /* 1 where the coordinate grows or stays, else 0: the exit line of cell i is x = i + sx */
    vm xpos, ypos, dsneg;
    vf te, tl;         /* the part of [t0, t1] in the box */
    vm entered, xface; /* te > t0: through a face; through x = const */
} Ray;

INLINE vf line_x(const Ray *r, vi line) { return (i_flt(line) - r->ox) * r->rdx; }
INLINE vf line_y(const Ray *r, vi line) { return (i_flt(line) - r->oy) * r->rdy; }
INLINE vf lerp(vf a, vf b, vf s) { return a + s * (b - a); }
INLINE vf clamp01(vf a) { return f_min(f_max(a, f_all(0)), f_all(1)); }

/* Everything that depends on the ray alone. o, d, t0, t1 are in *r (t0 in te). Returns the lanes that have a part in
 * the box. */
INLINE vm ray_setup(Ray *r, int w, int h, vm on) {
    const vf zero = f_all(0), inf = f_all((flt)INFINITY), w1 = f_all((flt)(w - 1)), h1 = f_all((flt)(h - 1));
    vf t0 = f_max(r->te, f_all(-FLT_BIG));
    /* 0 times a NaN or infinite component is NaN. A NaN in t0 or t1 fails the comparison (f_max above returns its
     * second argument then, hence te). */
    vf finite = (r->ox * zero + r->oy * zero + r->oz * zero) + (r->dx * zero + r->dy * zero + r->dz * zero);
    on &= m_le(r->te, r->t1) & m_eq(finite, zero);
    r->t1 = f_min(r->t1, f_all(FLT_BIG));
    vf rdx = f_all(1) / r->dx, rdy = f_all(1) / r->dy;
    vm flat_x = m_lt(f_all(FLT_MAXIMUM), f_abs(rdx)), flat_y = m_lt(f_all(FLT_MAXIMUM), f_abs(rdy));
    r->dx = f_sel(flat_x, zero, r->dx);
    r->dy = f_sel(flat_y, zero, r->dy);
    r->rdx = f_sel(flat_x, inf, rdx);
    r->rdy = f_sel(flat_y, inf, rdy);
    /* A ray along the far border is taken one ulp inside: every exit line then lies strictly ahead, and (line - ox) *
     * infinity is never NaN for one. */
    const flt below = F64 ? (flt)0x1.fffffffffffffp-1 : (flt)0x1.fffffep-1;
    r->ox = f_sel(flat_x & m_eq(r->ox, w1), w1 * f_all(below), r->ox);
    r->oy = f_sel(flat_y & m_eq(r->oy, h1), h1 * f_all(below), r->oy);
    r->xpos = m_opaque(m_lt(zero, r->rdx));
    r->ypos = m_opaque(m_lt(zero, r->rdy));
    r->sx = i_sel(r->xpos, i_all(1), i_all(0));
    r->sy = i_sel(r->ypos, i_all(1), i_all(0));
    vf ds = r->dx + r->dy;
    r->dsneg = m_opaque(m_lt(ds, zero));
    r->rds = f_all(1) / (ds + zero); /* -0 + 0 = 0: along a diagonal, +infinity */
    r->so = r->ox + r->oy;
    vf near_x = (f_sel(r->xpos, zero, w1) - r->ox) * r->rdx, far_x = (f_sel(r->xpos, w1, zero) - r->ox) * r->rdx;
    vf near_y = (f_sel(r->ypos, zero, h1) - r->oy) * r->rdy, far_y = (f_sel(r->ypos, h1, zero) - r->oy) * r->rdy;
    vf te = f_max(near_x, t0);
    r->te = f_max(near_y, te);
    r->entered = m_lt(t0, r->te);
    r->xface = m_le(r->te, near_x);
    r->tl = f_min(far_y, f_min(far_x, r->t1));
    return on & m_le(r->te, r->tl);
}

/* The cell that the ray is in just after t. It is counted in lines crossed (at parameters <= t), so that it agrees with
 * every later comparison; the position is only where the count begins. */
INLINE void ray_locate(const Ray *r, vf t, vm on, int w, int h, vi *ci, vi *cj) {
    vf x = f_min(f_max(r->ox + t * r->dx, f_all(0)), f_all((flt)(w - 2)));
    vf y = f_min(f_max(r->oy + t * r->dy, f_all(0)), f_all((flt)(h - 2)));
    vi i = f_int(x), j = f_int(y), one = i_all(1), zero = i_all(0);
    vi stepx = r->sx + r->sx - one, stepy = r->sy + r->sy - one;
    for (;;) { /* exit lines that are crossed already */
        vm mx = on & m_not(m_lt(t, line_x(r, i + r->sx))) & m_not(mi_eq(i, i_sel(r->xpos, i_all(w - 2), zero)));
        vm my = on & m_not(m_lt(t, line_y(r, j + r->sy))) & m_not(mi_eq(j, i_sel(r->ypos, i_all(h - 2), zero)));
        if (!m_any(mx | my)) break;
        i = i_sel(mx, i + stepx, i);
        j = i_sel(my, j + stepy, j);
    }
    for (;;) { /* entry lines that are not crossed yet */
        vm mx = on & m_lt(t, line_x(r, i + one - r->sx)) & m_not(mi_eq(i, i_sel(r->xpos, zero, i_all(w - 2))));
        vm my = on & m_lt(t, line_y(r, j + one - r->sy)) & m_not(mi_eq(j, i_sel(r->ypos, zero, i_all(h - 2))));
        if (!m_any(mx | my)) break;
        i = i_sel(mx, i - stepx, i);
        j = i_sel(my, j - stepy, j);
    }
    *ci = i;
    *cj = j;
}

/* Height of the terrain inside cell (i, j) at t: the plane of the triangle, a convex combination of its vertices. */
INLINE vf ray_plane(const Ray *r, vf t, const flt *heights, int w, vi at, vi i, vi j, vm on) {
    const vf one = f_all(1);
    vf u = clamp01((r->ox + t * r->dx) - i_flt(i)), v = clamp01((r->oy + t * r->dy) - i_flt(j));
    vm lower = m_lt(u + v, one);
    vf h10 = f_gather(heights, at + i_all(1), on), h01 = f_gather(heights, at - i_all(w), on);
    vf corner = f_gather(heights, i_sel(lower, at, at + i_all(1 - w)), on);
    vf a = f_sel(lower, u, one - v), b = f_sel(lower, v, one - u);
    return (corner + a * (h10 - corner)) + b * (h01 - corner);
}

/* Index of vertex (i, j) in the data, whose first row is the last j. */
#define VERTEX(w, h, i, j) (i_all(((h) - 1) * (w)) - (j) * i_all(w) + (i))

/* Height at te and its witness as a clearance: AT_T0, or the border edge through which the ray enters. */
INLINE vf ray_start(const Ray *r, const flt *heights, int w, int h, vi i, vi j, vm on, vi *id) {
    vi at = VERTEX(w, h, i, j), one = i_all(1), up = i_all(w);
    vf height = f_all(0);
    *id = i_all(SLT_WITNESS_AT_T0);
    vm inside = on & m_not(r->entered), edge = on & r->entered;
    if (m_any(inside)) height = ray_plane(r, r->te, heights, w, at, i, j, inside);
    if (m_any(edge)) {
        vm pos = (r->xface & r->xpos) | (m_not(r->xface) & r->ypos);
        vf x = r->ox + r->te * r->dx - i_flt(i), y = r->oy + r->te * r->dy - i_flt(j);
        vi a = at + i_sel(pos, i_all(0), i_sel(r->xface, one, i_all(-w)));
        vi b = a + i_sel(r->xface, i_all(-w), one);
        vf on_edge = lerp(f_gather(heights, a, edge), f_gather(heights, b, edge), clamp01(f_sel(r->xface, y, x)));
        vi cell = j * up + i + i_sel(pos, i_all(0), i_sel(r->xface, one, up));
        height = f_sel(edge, on_edge, height);
        *id = i_sel(edge, cell * i_all(4) + i_sel(r->xface, one, i_all(0)), *id);
    }
    return height;
}

/* What happens in cell (i, j) from t on. */
typedef struct Leaf {
    vf td, hd; /* the diagonal, if diag: parameter and height of the terrain */
    vf te, he; /* the exit; if end: t1 */
    vm diag, end, xexit;
    vm some; /* the ray has a part in the cell: else nothing counts here (a corner is crossed once, as a point of x =
                const) */
    vm last_lower; /* the triangle before the exit */
} Leaf;

/* tx, ty: where the ray leaves the cell's column and its row, line_x(i + sx) and line_y(j + sy). */
INLINE void leaf_test(Leaf *l, const Ray *r, const flt *heights, int w, int h, vi i, vi j, vf t, vf tx, vf ty, vm on) {
    const vi one = i_all(1);
    vf x0 = i_flt(i), y0 = i_flt(j);
    vf tout = f_min(tx, ty);
    l->xexit = m_opaque(m_le(tx, ty));
    l->end = m_opaque(m_lt(r->t1, tout));
    l->te = f_min(r->t1, tout);
    l->td = (i_flt(i + j + one) - r->so) * r->rds;
    l->some = m_opaque(m_lt(t, l->te));
    l->diag = m_opaque(m_lt(t, l->td) & m_lt(l->td, l->te));
    vm before = m_opaque(m_le(l->te, l->td));
    l->last_lower = m_opaque((before & m_not(r->dsneg)) | (m_not(before) & r->dsneg));
    vi at = VERTEX(w, h, i, j);
    vm pos = m_opaque((l->xexit & r->xpos) | (m_not(l->xexit) & r->ypos));
    vf h10, h01, corner;
    f_corners(heights, at, w, pos, on, &h10, &h01,
              &corner); /* the exit edge has one end on the diagonal; this is the other */
    vf ud = clamp01((r->ox + l->td * r->dx) - x0);
    l->hd = lerp(h01, h10, ud);
    vf s = clamp01(f_sel(l->xexit, (r->oy + tout * r->dy) - y0, (r->ox + tout * r->dx) - x0));
    vf other = f_sel((l->xexit & pos) | (m_not(l->xexit) & m_not(pos)), h10, h01);
    l->he = lerp(f_sel(pos, other, corner), f_sel(pos, corner, other), s);
    vm end = on & l->end;
    if (m_any(end)) l->he = f_sel(end, ray_plane(r, r->t1, heights, w, at, i, j, end), l->he);
}

/* The state of a query, and what an event does to it. */
typedef struct Search {
    vf best;  /* CLEARANCE, SHADOW: the least F / t; SILHOUETTE, RISE: the greatest (height - oz) / t */
    vf limit; /* SHADOW: the band; SILHOUETTE: kmax */
    vi id;
    vm done;
} Search;

/* A decision point at t over terrain of height `terrain`, in the lanes `on`. `tri` is the triangle before the point,
 * `edge` the witness of the point itself. */
INLINE void search_event(Search *s, SltQuery what, const Ray *r, vf t, vf terrain, vi tri, vi edge, vm on) {
    on = m_opaque(on & m_not(s->done));
    if (what == SLT_QUERY_TRACE || what == SLT_QUERY_OCCLUDED) {
        vm hit = on & m_lt((r->oz + t * r->dz) - terrain, f_all(0));
        s->id = i_sel(hit, tri, s->id);
        s->done = m_opaque(s->done | hit);
    } else if (what == SLT_QUERY_CLEARANCE || what == SLT_QUERY_SHADOW) {
        vf gap = (r->oz + t * r->dz) - terrain, c = gap / t;
        vm less = on & m_lt(c, s->best);
        if (what == SLT_QUERY_SHADOW) {
            less &= m_lt(gap, s->limit);
            /* A later point with a smaller F / t is deeper still, so outside the band. Only the point with the least F
             * / t so far may end the search: a structure may skip the others. */
            s->done |= less & m_le(gap, f_all(0) - s->limit) & m_lt(gap, f_all(0));
        }
        s->best = f_sel(less, c, s->best);
        s->id = i_sel(less, edge, s->id);
    } else {
        vf k = (terrain - r->oz) / t;
        vm candidate = m_not(mi_eq(s->id, i_all(SLT_WITNESS_NONE)));
        vm rise = on & m_lt(s->best, k), fall = on & candidate & m_lt(k, s->best);
        s->done |= fall;
        s->best = f_sel(rise, k, s->best);
        s->id = i_sel(rise, edge, s->id);
        if (what == SLT_QUERY_SILHOUETTE) { /* the next peak is higher still */
            vm over = rise & m_not(m_lt(k, s->limit));
            s->id = i_sel(over, i_all(SLT_WITNESS_NONE), s->id);
            s->done |= over;
        }
    }
}

/* The decision point at te: blocked at once, the first candidate, or nothing. `id` and `terrain` are ray_start's. */
INLINE void search_start(Search *s, SltQuery what, const Ray *r, vf terrain, vi id, vm on) {
    if (what == SLT_QUERY_TRACE || what == SLT_QUERY_OCCLUDED) {
        vi face = i_sel(r->xface, i_sel(r->xpos, i_all(SLT_HEIGHTFIELD_WALL), i_all(SLT_HEIGHTFIELD_WALL - 1)),
                        i_sel(r->ypos, i_all(SLT_HEIGHTFIELD_WALL - 2), i_all(SLT_HEIGHTFIELD_WALL - 3)));
        search_event(s, what, r, r->te, terrain, i_sel(r->entered, face, i_all(SLT_WITNESS_AT_T0)), id, on);
    } else if (what == SLT_QUERY_SILHOUETTE) { /* at t = 0 there is no slope */
        search_event(s, what, r, r->te, terrain, id, id, on & r->entered);
    } else {
        search_event(s, what, r, r->te, terrain, id, id, on);
    }
}

INLINE void search_leaf(Search *s, SltQuery what, const Ray *r, const Leaf *l, int w, vi i, vi j, vm on) {
    vi cell = j * i_all(w) + i, zero = i_all(0), one = i_all(1);
    vi tri = cell + cell, edge = zero;
    vm ends = on & l->some;
    if (what != SLT_QUERY_TRACE && what != SLT_QUERY_OCCLUDED) {
        vi far_cell = cell + i_sel(l->xexit, r->sx, i_sel(r->ypos, i_all(w), zero));
        edge = i_sel(l->end, i_all(SLT_WITNESS_AT_T1), far_cell * i_all(4) + i_sel(l->xexit, one, zero));
    }
    if (what == SLT_QUERY_SILHOUETTE) ends &= m_not(l->end);
    search_event(s, what, r, l->td, l->hd, tri + i_sel(r->dsneg, one, zero), cell * i_all(4) + i_all(2), on & l->diag);
    search_event(s, what, r, l->te, l->he, tri + i_sel(l->last_lower, zero, one), edge, ends);
}
