/* The walk over the maximum mipmap, LANES rays at a time. Each lane is at a node (level, i, j: the low corner in cells) with [t, exit] inside it, and either skips the node, because the ray
 * stays above everything in it, or goes down to the child that it enters first; at a cell it runs the test of leaf.h. All choices compare parameters of grid lines, as leaf.h does.
 *
 * That a node may be skipped is always one inequality, z + slope * t > maximum at the worse end of the node: slope is dz for TRACE, dz minus the best F / t so far for CLEARANCE (is there a point
 * with a smaller one?), the best slope so far for SILHOUETTE. z is lowered by `slack` and by more than all rounding errors of the test and of leaf.h, so no decision of leaf.h is lost. */
#define packet_load FN(packet_load)
#define packet_walk FN(packet_walk)
#define packet_run FN(packet_run)
#define Bound FN(Bound)

/* z of the skipping test, and how it follows `best`. */
typedef struct Bound {
    vf z, zband, reach; /* reach: longest |t|, times the rounding unit */
} Bound;

INLINE vm packet_load(Ray *r, Search *s, SltFieldWhat what, const Field *f, const flt *rays, uint32_t width, vm on) {
    r->ox = f_load(rays), r->oy = f_load(rays + width), r->oz = f_load(rays + 2 * width);
    r->dx = f_load(rays + 3 * width), r->dy = f_load(rays + 4 * width), r->dz = f_load(rays + 5 * width);
    r->te = f_load(rays + 6 * width), r->t1 = f_load(rays + 7 * width);
    s->id = i_all(SLT_FIELD_NONE), s->done = m_make(0), s->best = f_all((flt)INFINITY), s->limit = f_all((flt)f->shared.band);
    if (what == SLT_FIELD_SILHOUETTE) {
        s->best = r->te, s->limit = r->t1, on &= m_lt(s->best, s->limit);
        r->dz = f_all(0), r->te = f_all(0), r->t1 = f_all(FLT_BIG);
    } else if (what != SLT_FIELD_TRACE) {
        r->te = f_max(f_all(FLT_TINY), r->te); /* keeps a NaN */
    }
    return on;
}

INLINE vi packet_walk(const Field *f, SltFieldWhat what, const flt *heights, const flt *rays, uint32_t width, vm on, Slice *slice, FieldCounts *counts) {
    const int w = (int)f->shared.w, h = (int)f->shared.h;
    const Mipmap *m = &f->mip;
    const vi one = i_all(1), zero = i_all(0);
    Ray r;
    Search s;
    Bound b;
    Leaf leaf;
    vi i, j, start_id;
    on = packet_load(&r, &s, what, f, rays, width, on);
    on = ray_setup(&r, w, h, on);
    if (!m_any(on)) return s.id;

    const flt unit = F64 ? (flt)0x1p-48 : (flt)0x1p-19; /* 32 units in the last place: twice the sum of all errors */
    const flt magnitude = (flt)f->magnitude + (flt)f->shared.slack;
    b.reach = f_max(f_abs(r.te), f_abs(r.tl)) * f_all(unit);
    vf error = f_abs(r.oz) * f_all(unit) + (f_abs(r.dz) * b.reach + f_all(magnitude * unit + FLT_TINY));
    b.z = r.oz - (error + f_all((flt)f->shared.slack));
    b.zband = b.z - s.limit;
    ray_locate(&r, r.te, on, w, h, &i, &j);
    vf start = ray_start(&r, heights, w, h, i, j, on, &start_id);
    search_start(&s, what, &r, start, start_id, on);

    vi level = i_all(m->top < 4 ? m->top : 4);
    i &= zero - (one << level);
    j &= zero - (one << level);
    vf t = r.te;
    on &= m_not(s.done) & m_lt(r.te, r.tl); /* a ray that only touches the box has no cells */
    while (m_any(on)) {
        vi size = one << level;
        vm at_cell = on & mi_eq(level, zero), at_node = on & m_not(at_cell);
        vm xexit = m_make(0), leave = m_make(0);
        vf tout = t;
        if (m_any(at_node)) {
            vf tx = line_x(&r, i + (size & (zero - r.sx))), ty = line_y(&r, j + (size & (zero - r.sy)));
            tout = f_min(tx, ty);
            xexit = m_le(tx, ty);
            vf tend = f_min(tout, r.tl);
            vf slope, z = b.z;
            if (what == SLT_FIELD_TRACE) slope = r.dz;
            else if (what == SLT_FIELD_SILHOUETTE) slope = s.best, z = z - f_abs(s.best) * b.reach;
            else slope = r.dz - s.best, z = z - f_abs(s.best) * b.reach;
            vf low = z + slope * f_sel(m_lt(slope, f_all(0)), tend, t);
            if (what == SLT_FIELD_SHADOW) {
                vf band = b.zband + r.dz * f_sel(m_lt(r.dz, f_all(0)), tend, t);
                low = f_sel(m_lt(low, band), band, low);
                low = f_sel(m_eq(low, low), low, band);
            }
            vi at = i_lookup(m->base, level) + (j >> level) * i_lookup(m->stride, level) + (i >> level);
            vf most = mip_gather(m->data, at, at_node);
            leave = at_node & m_lt(most, low);
            if (counts) counts->nodes++;
            vm down = at_node & m_not(leave);
            vi half = size >> one;
            /* The child that the ray is in after t: on the far side of the middle line if that is crossed already. */
            vm crossx = m_not(m_lt(t, line_x(&r, i + half))), crossy = m_not(m_lt(t, line_y(&r, j + half)));
            vm upx = (crossx & r.xpos) | (m_not(crossx) & m_not(r.xpos)), upy = (crossy & r.ypos) | (m_not(crossy) & m_not(r.ypos));
            i = i_sel(down & upx, i + half, i);
            j = i_sel(down & upy, j + half, j);
            level = i_sel(down, level - one, level);
        }
        if (m_any(at_cell)) {
            leaf_test(&leaf, &r, heights, w, h, i, j, t, at_cell);
            search_leaf(&s, what, &r, &leaf, w, i, j, at_cell);
            if (counts) counts->cells++;
            if (slice && m_any(s.done) && m_any(m_not(mi_eq(s.id, i_all(SLT_FIELD_NONE))))) { /* one lane: a peak; the same cell again, now above it */
                int32_t peak[LANES];
                i_store(peak, s.id);
                slice_add(slice, peak[0]);
                s.id = i_all(SLT_FIELD_NONE), s.done = m_make(0);
                search_leaf(&s, what, &r, &leaf, w, i, j, at_cell);
            }
            tout = f_sel(at_cell, leaf.te, tout);
            xexit = (at_cell & leaf.xexit) | (m_not(at_cell) & xexit);
            leave |= at_cell;
            on &= m_not(s.done & at_cell);
        }
        if (what == SLT_FIELD_SILHOUETTE) { /* all in the node is lower: what was found is a peak */
            vm peaks = leave & m_not(at_cell) & m_lt(t, tout) & m_not(mi_eq(s.id, i_all(SLT_FIELD_NONE)));
            if (!slice) {
                on &= m_not(peaks);
            } else if (m_any(peaks)) {
                int32_t peak[LANES];
                i_store(peak, s.id);
                slice_add(slice, peak[0]);
                s.id = i_all(SLT_FIELD_NONE);
            }
        }
        leave &= on;
        t = f_sel(leave, tout, t);
        on &= m_not(leave & m_le(r.tl, t));
        /* To the neighbour, and up a level where it has another parent. */
        vi stepx = i_sel(r.xpos, size, zero - size), stepy = i_sel(r.ypos, size, zero - size);
        vm lx = leave & xexit, ly = leave & m_not(xexit);
        i = i_sel(lx, i + stepx, i);
        j = i_sel(ly, j + stepy, j);
        vi side = i_sel(xexit, i_sel(r.xpos, i, i + size), i_sel(r.ypos, j, j + size)) & size;
        vm up = leave & mi_eq(side, zero) & mi_gt(i_all(m->top), level);
        level = i_sel(up, level + one, level);
        vi keep = zero - (one << level);
        i = i_sel(up, i & keep, i);
        j = i_sel(up, j & keep, j);
    }
    return s.id;
}

INLINE void packet_run(const Field *f, SltFieldWhat what, const void *heights, const void *rays, uint64_t mask, uint32_t width, int32_t *id, FieldCounts *counts) {
    const flt *p = rays;
    for (uint32_t at = 0; at < width; at += LANES) {
        uint32_t bits = (uint32_t)(mask >> at), rest = width - at;
        if (LANES < 32) bits &= (1u << LANES) - 1;
        if (rest >= LANES) {
            i_store(id + at, packet_walk(f, what, heights, p + at, width, m_make(bits), NULL, counts));
        } else { /* the last lanes of a width that is no multiple */
            flt some[8 * LANES] = {0};
            int32_t out[LANES];
            for (uint32_t row = 0; row < 8; row++)
                for (uint32_t n = 0; n < rest; n++) some[row * LANES + n] = p[row * width + at + n];
            i_store(out, packet_walk(f, what, heights, some, LANES, m_make(bits & ((1u << rest) - 1)), NULL, counts));
            for (uint32_t n = 0; n < rest; n++) id[at + n] = out[n];
        }
    }
    if (counts) counts->rays += (uint64_t)__builtin_popcountll(width < 64 ? mask & ((1ull << width) - 1) : mask);
}

#define PACKET_QUERY(name, what)                                                                                                                                            \
    static void FN(name)(const SltField *field, const void *heights, const void *rays, uint64_t mask, uint32_t width, int32_t *id) {                                       \
        Field room;                                                                                                                                                        \
        packet_run(field_asked(field, &room), what, heights, rays, mask, width, id, NULL);                                                                                 \
    }
PACKET_QUERY(trace, SLT_FIELD_TRACE)
PACKET_QUERY(clearance, SLT_FIELD_CLEARANCE)
PACKET_QUERY(shadow, SLT_FIELD_SHADOW)
PACKET_QUERY(silhouette, SLT_FIELD_SILHOUETTE)
