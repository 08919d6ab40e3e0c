/* Cell by cell, one ray at a time: the oracle. Included by naive.c with F64 = 0 and 1. */
#define naive_ray FN(naive_ray)
#define naive_load FN(naive_load)
#define naive_run FN(naive_run)

/* Reads ray `lane` of rays (rows as SltRayRow says) and begins its search. Returns whether there is anything to search.
 */
INLINE vm naive_load(Ray *r, Search *s, SltQuery what, const Field *f, const flt *rays, uint32_t width, uint32_t lane) {
    const flt *p = rays + lane;
    vm on = -1;
    r->ox = p[0], r->oy = p[width], r->oz = p[2 * width], r->dx = p[3 * width], r->dy = p[4 * width],
    r->dz = p[5 * width];
    r->te = p[6 * width], r->t1 = p[7 * width];
    s->id = SLT_WITNESS_NONE, s->done = 0, s->best = (flt)INFINITY, s->limit = (flt)f->options.band;
    if (what == SLT_QUERY_SILHOUETTE) {
        s->best = r->te, s->limit = r->t1, on = m_lt(s->best, s->limit);
        r->dz = 0, r->te = 0, r->t1 = FLT_BIG;
    } else if (what == SLT_QUERY_RISE) {
        s->best = (flt)-INFINITY;
    }
    if (what != SLT_QUERY_TRACE && what != SLT_QUERY_OCCLUDED && what != SLT_QUERY_SILHOUETTE && r->te < FLT_TINY)
        r->te = FLT_TINY;
    return on;
}

static int32_t naive_ray(const Field *f, SltQuery what, const flt *heights, const flt *rays, uint32_t width,
                         uint32_t lane, Slice *slice, FieldCounts *counts) {
    const int w = (int)f->w, h = (int)f->h;
    Ray r;
    Search s;
    Leaf l;
    int i, j, id;
    vm on = naive_load(&r, &s, what, f, rays, width, lane);
    if (!ray_setup(&r, w, h, on)) return SLT_WITNESS_NONE;
    ray_locate(&r, r.te, -1, w, h, &i, &j);
    flt start = ray_start(&r, heights, w, h, i, j, -1, &id);
    search_start(&s, what, &r, start, id, -1);
    flt t = r.te;
    for (int n = 0; n < w + h && !s.done; n++) {
        leaf_test(&l, &r, heights, w, h, i, j, t, line_x(&r, i + r.sx), line_y(&r, j + r.sy), -1);
        search_leaf(&s, what, &r, &l, w, i, j, -1);
        if (counts) counts->cells++;
        if (slice && s.done && s.id != SLT_WITNESS_NONE) { /* a peak: the same cell again, now above it */
            slice_add(slice, s.id);
            s.id = SLT_WITNESS_NONE, s.done = 0;
            search_leaf(&s, what, &r, &l, w, i, j, -1);
        }
        t = l.te;
        if (t >= r.tl) break;
        if (l.xexit) i += 2 * r.sx - 1;
        else j += 2 * r.sy - 1;
    }
    return s.id;
}

static void naive_run(const Field *f, SltQuery what, const void *heights, const void *rays, uint64_t mask,
                      uint32_t width, int32_t *id, FieldCounts *counts) {
    for (uint32_t lane = 0; lane < width; lane++) {
        bool on = mask >> lane & 1;
        id[lane] = on ? naive_ray(f, what, heights, rays, width, lane, NULL, counts) : SLT_WITNESS_NONE;
        if (on && counts) counts->rays++;
    }
}
