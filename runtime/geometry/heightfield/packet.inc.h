/* The walk over the maximum mipmap, LANES rays at a time. Each lane is at a node (level, i, j: the low corner in cells)
 * with [t, exit] inside it, and either skips the node, because the ray stays above everything in it, or goes down to
 * the child that it enters first; at a cell it runs the test of leaf.h. All choices compare parameters of grid lines,
 * as leaf.h does.
 *
 * That a node may be skipped is always one inequality, z + slope * t > maximum at the worse end of the node: slope is
 * dz for TRACE, dz minus the best F / t so far for CLEARANCE (is there a point with a smaller one?), the best slope so
 * far for SILHOUETTE. z is lowered by `slack` and by more than all rounding errors of the test and of leaf.h, so no
 * decision of leaf.h is lost. */
#define packet_load FN(packet_load)
#define packet_locate FN(packet_locate)
#define packet_start FN(packet_start)
#define packet_move FN(packet_move)
#define packet_node FN(packet_node)
#define packet_cell FN(packet_cell)
#define packet_line_x FN(packet_line_x)
#define packet_line_y FN(packet_line_y)
#define packet_step FN(packet_step)
#define packet_probe FN(packet_probe)
#define packet_first FN(packet_first)
#define packet_fetch FN(packet_fetch)
#define packet_turn FN(packet_turn)
#define packet_store FN(packet_store)
#define packet_join FN(packet_join)
#define packet_pair FN(packet_pair)
#define packet_two FN(packet_two)
#define packet_join2 FN(packet_join2)
#define packet_join4 FN(packet_join4)
#define packet_walk2 FN(packet_walk2)
#define packet_walk FN(packet_walk)
#define packet_run FN(packet_run)
#define Packet FN(Packet)

/* Before OCCLUDED walks, it looks where the ray crosses the grid lines so far ahead: a ridge that blocks is wide, and
 * is often met at once, where a walk would climb the levels and come down again. */
#ifndef PROBES
#define PROBES {10, 32}
#endif
/* The level where a walk begins that begins high above the terrain. Others begin at their cell, which is read for the
 * start anyway, and a ray from the ground seldom skips anything there; slices of silhouettes, often seen from above, at
 * level 1. */
#ifndef START_FAR
#define START_FAR 4
#endif

/* Does the query search for a blocked point? */
#undef HITS
#define HITS(what) ((what) == SLT_QUERY_TRACE || (what) == SLT_QUERY_OCCLUDED)

/* Where a direction is negative, the packet's coordinate is minus the real one: every ray then walks towards larger i,
 * j, cell i is the real ~i, line n the real -n, and (n - ox) / dx is the same with both signs turned, bit for bit.
 * Blocks of 2^l cells are the same blocks. */
typedef struct Packet {
    Ray r;
    Search s;
    vf t, tx, ty;         /* where the lane is; where it leaves its node in x and in y */
    vf ox, oy, rdx, rdy;  /* of the ray in the packet's coordinates: rdx, rdy positive */
    vi i, j, level, size; /* the low corner of the node; size = 1 << level cells */
    vi flipx, flipy;      /* -1 where the packet's coordinate is minus the real one, else 0 */
    int top;              /* the highest level to go to */
    vf z, zband,
        reach;      /* z of the skipping test; reach: the longest |t| times the rounding unit, how z follows `best` */
    vm on, falling; /* falling: dz < 0 */
    vi lane;        /* TRACE: the ray whose answer it is, of the first `count` lanes */
    uint32_t count;
} Packet;

INLINE vm packet_load(Ray *r, Search *s, SltQuery what, const Field *f, const flt *rays, uint32_t width, vm on) {
    r->ox = f_load(rays), r->oy = f_load(rays + width), r->oz = f_load(rays + 2 * width);
    r->dx = f_load(rays + 3 * width), r->dy = f_load(rays + 4 * width), r->dz = f_load(rays + 5 * width);
    r->te = f_load(rays + 6 * width), r->t1 = f_load(rays + 7 * width);
    s->id = i_all(SLT_WITNESS_NONE), s->done = m_make(0), s->best = f_all((flt)INFINITY),
    s->limit = f_all((flt)f->options.band);
    if (what == SLT_QUERY_SILHOUETTE) {
        s->best = r->te, s->limit = r->t1, on &= m_lt(s->best, s->limit);
        r->dz = f_all(0), r->te = f_all(0), r->t1 = f_all(FLT_BIG);
    } else if (!HITS(what)) {
        if (what == SLT_QUERY_RISE) s->best = f_all((flt)-INFINITY);
        r->te = f_max(f_all(FLT_TINY), r->te); /* a NaN stays one */
    }
    return on;
}

INLINE vf packet_line_x(const Packet *p, vi line) { return (i_flt(line) - p->ox) * p->rdx; }
INLINE vf packet_line_y(const Packet *p, vi line) { return (i_flt(line) - p->oy) * p->rdy; }

/* Where the walk begins: at p->t in the real cell p->i, p->j. */
INLINE void packet_locate(Packet *p, const Field *f, SltQuery what, const flt *rays, uint32_t width, vm on) {
    const int w = (int)f->w, h = (int)f->h;
    const Mipmap *m = &f->mip;
    Ray *r = &p->r;
    on = packet_load(r, &p->s, what, f, rays, width, on);
    on = ray_setup(r, w, h, on);

    const flt unit = F64 ? (flt)0x1p-48 : (flt)0x1p-19; /* 32 units in the last place: twice the sum of all errors */
    const flt magnitude = (flt)f->magnitude + (flt)f->base.shared.slack;
    p->reach = f_max(f_abs(r->te), f_abs(r->tl)) * f_all(unit);
    vf error = f_abs(r->oz) * f_all(unit) + (f_abs(r->dz) * p->reach + f_all(magnitude * unit + FLT_TINY));
    p->z = r->oz - (error + f_all((flt)f->base.shared.slack));
    p->zband = p->z - p->s.limit;
    p->falling = m_lt(r->dz, f_all(0));

    /* Nothing happens while the ray is above the highest point of the terrain. */
    vf from = r->te;
    if (HITS(what) || what == SLT_QUERY_SHADOW) {
        vf z = p->z;
        if (what == SLT_QUERY_SHADOW) z = p->zband;
        vf cross = (f_all((flt)m->max) - z) / r->dz, less = f_abs(cross) * f_all(F64 ? (flt)0x1p-48 : (flt)0x1p-20);
        vm above = m_lt(f_all((flt)m->max), z + r->dz * r->te);
        from = f_sel(p->falling & above, f_max(cross - less, r->te), r->te);
        on &= p->falling | m_not(above);
        r->tl = f_sel(m_lt(f_all(0), r->dz), f_min(cross + less, r->tl), r->tl);
    }
    ray_locate(r, from, on, w, h, &p->i, &p->j);
    p->on = on;
    p->t = from;
    p->top = m->top;
    if (what == SLT_QUERY_RISE)
        p->top = 0;                    /* a few cells to the next ridge, and every one of them counts: no level helps */
    if (what == SLT_QUERY_CLEARANCE) { /* sites ask for the clearance in windows of a few cells */
        vf way = f_max(f_abs(r->dx), f_abs(r->dy)) * (r->tl - r->te);
        if (!m_any(on & m_lt(f_all(8), way))) p->top = 1;
    }
}

INLINE void packet_turn(Packet *p) {
    const Ray *r = &p->r;
    const vi zero = i_all(0);
    const vf none = f_all(0);
    p->flipx = i_sel(r->xpos, zero, i_all(-1)), p->flipy = i_sel(r->ypos, zero, i_all(-1));
    p->ox = f_sel(r->xpos, r->ox, none - r->ox), p->oy = f_sel(r->ypos, r->oy, none - r->oy);
    p->rdx = f_abs(r->rdx), p->rdy = f_abs(r->rdy);
}

/* The event at the start, and the first node. */
INLINE void packet_start(Packet *p, const Field *f, SltQuery what, const flt *heights) {
    const int w = (int)f->w, h = (int)f->h;
    const vi zero = i_all(0);
    Ray *r = &p->r;
    vm start = p->on & m_eq(p->t, r->te);
    if (m_any(start)) {
        vi id;
        vf terrain = ray_start(r, heights, w, h, p->i, p->j, start, &id);
        search_start(&p->s, what, r, terrain, id, start);
    }
    p->on &= m_not(p->s.done) & m_lt(p->t, r->tl); /* a ray that only touches the box has no cells */
    packet_turn(p);
    p->level = i_sel(start, i_all(what == SLT_QUERY_SILHOUETTE), i_all(START_FAR < p->top ? START_FAR : p->top));
    p->size = i_all(1) << p->level;
    p->i = (p->i ^ p->flipx) & (zero - p->size);
    p->j = (p->j ^ p->flipy) & (zero - p->size);
    p->tx = packet_line_x(p, p->i + p->size);
    p->ty = packet_line_y(p, p->j + p->size);
}

/* The lanes `leave` go to the neighbour of their node, and up a level where that has another parent; the lanes `down`
 * to the child that they are in after t: on the far side of the middle line if that is crossed already. Either way one
 * new line is needed in each direction: `size` of the new level after the corner. */
INLINE void packet_move(Packet *p, vm leave, vm down) {
    const vi zero = i_all(0), one = i_all(1);
    vi size = p->size;
    leave = m_opaque(leave), down = m_opaque(down);
    vm xexit = m_opaque(m_le(p->tx, p->ty)), lx = leave & xexit, ly = leave & m_not(xexit);
    vi i = i_sel(lx, p->i + size, p->i), j = i_sel(ly, p->j + size, p->j);
    vm up = m_opaque(leave & mi_eq(i_sel(xexit, i, j) & size, zero) & mi_gt(i_all(p->top), p->level));
    p->level = i_sel(down, p->level - one, p->level);
    p->level = i_sel(up, p->level + one, p->level);
    size = one << p->level;
    p->size = size;
    vi keep = zero - size;
    i = i_sel(up, i & keep, i), j = i_sel(up, j & keep, j);
    vf tx = packet_line_x(p, i + size), ty = packet_line_y(p, j + size);
    vm farx = m_opaque(down & m_not(m_lt(p->t, tx))), fary = m_opaque(down & m_not(m_lt(p->t, ty)));
    p->i = i_sel(farx, i + size, i);
    p->j = i_sel(fary, j + size, j);
    vm move = leave | down;
    p->tx = f_sel(move & m_not(farx), tx, p->tx);
    p->ty = f_sel(move & m_not(fary), ty, p->ty);
}

/* All lanes above level 0 look at their node. */
INLINE void packet_node(Packet *p, const Mipmap *m, SltQuery what, Slice *slice) {
    vm look = p->on & m_not(mi_eq(p->level, i_all(0)));
    vf tout = f_min(p->tx, p->ty), tend = f_min(tout, p->r.tl), slope, z = p->z, low;
    if (HITS(what)) {
        low = z + p->r.dz * f_sel(p->falling, tend, p->t);
    } else {
        if (what == SLT_QUERY_SILHOUETTE) slope = p->s.best;
        else slope = p->r.dz - p->s.best;
        z = z - f_abs(p->s.best) * p->reach;
        low = z + slope * f_sel(m_lt(slope, f_all(0)), tend, p->t);
        if (what == SLT_QUERY_SHADOW)
            low =
                f_max(low, p->zband + p->r.dz * f_sel(p->falling, tend, p->t)); /* the second where the first is NaN */
    }
    vi at = i_lookup(m->base, p->level) + ((p->j ^ p->flipy) >> p->level) * i_lookup(m->stride, p->level) +
            ((p->i ^ p->flipx) >> p->level);
    vm leave = m_opaque(look & m_lt(mip_gather(m->data, at, look), low)), down = look & m_not(leave);
    if (what == SLT_QUERY_SILHOUETTE) { /* the whole node is lower: the edge that was found is a peak */
        vm peaks = leave & m_lt(p->t, tout) & m_not(mi_eq(p->s.id, i_all(SLT_WITNESS_NONE)));
        if (!slice) {
            p->on &= m_not(peaks);
        } else if (m_any(peaks)) {
            int32_t peak[LANES];
            i_store(peak, p->s.id);
            slice_add(slice, peak[0]);
            p->s.id = i_all(SLT_WITNESS_NONE);
        }
    }
    p->t = f_sel(leave, tout, p->t);
    p->on = m_opaque(p->on & m_not(leave & m_le(p->r.tl, p->t)));
    packet_move(p, leave & p->on, down);
}

/* All lanes at level 0 test their cell. */
INLINE void packet_cell(Packet *p, const Field *f, SltQuery what, const flt *heights, vm look, Slice *slice) {
    const int w = (int)f->w, h = (int)f->h;
    Leaf leaf;
    vi i = p->i ^ p->flipx, j = p->j ^ p->flipy;
    leaf_test(&leaf, &p->r, heights, w, h, i, j, p->t, p->tx, p->ty, look);
    search_leaf(&p->s, what, &p->r, &leaf, w, i, j, look);
    if (slice && m_any(p->s.done) &&
        m_any(
            m_not(mi_eq(p->s.id, i_all(SLT_WITNESS_NONE))))) { /* one lane: a peak; the same cell again, now above it */
        int32_t peak[LANES];
        i_store(peak, p->s.id);
        slice_add(slice, peak[0]);
        p->s.id = i_all(SLT_WITNESS_NONE), p->s.done = m_make(0);
        search_leaf(&p->s, what, &p->r, &leaf, w, i, j, look);
    }
    p->t = f_sel(look, leaf.te, p->t);
    p->on = m_opaque(p->on & m_not(look & (p->s.done | m_le(p->r.tl, p->t))));
    packet_move(p, look & p->on, m_make(0));
}

/* Is the ray below the terrain where it crosses the grid line `line`, in the direction in which it moves faster (xm:
 * x)? That is an exit of leaf.h like any other, where the row (or column) that it is in is certain. */
INLINE void packet_probe(Packet *p, const Field *f, const flt *heights, vm xm, vi line, vm on) {
    const int w = (int)f->w, h = (int)f->h;
    const vi one = i_all(1), zero = i_all(0);
    const Ray *r = &p->r;
    vf o = f_sel(xm, p->ox, p->oy), rd = f_sel(xm, p->rdx, p->rdy);
    vf t = (i_flt(line) - o) * rd, before = (i_flt(line - one) - o) * rd;
    on = m_opaque(on & m_lt(p->t, before) & m_lt(before, t) & m_le(t, r->tl));
    if (!m_any(on)) return;
    vf across = f_sel(xm, r->oy + t * r->dy, r->ox + t * r->dx);
    vi c = f_int(f_min(f_max(across, f_all(0)), f_sel(xm, f_all((flt)(h - 2)), f_all((flt)(w - 2)))));
    vf oc = f_sel(xm, r->oy, r->ox), rdc = f_sel(xm, r->rdy, r->rdx);
    vf low = (i_flt(c) - oc) * rdc, high = (i_flt(c + one) - oc) * rdc;
    on = m_opaque(on & m_lt(f_min(low, high), t) & m_lt(t, f_max(low, high)));
    line = i_sel((xm & r->xpos) | (m_not(xm) & r->ypos), line, zero - line);
    vi at = VERTEX(w, h, i_sel(xm, line, c), i_sel(xm, c, line));
    vf terrain = lerp(f_gather(heights, at, on), f_gather(heights, at + i_sel(xm, i_all(-w), one), on),
                      clamp01(across - i_flt(c)));
    vm hit = m_opaque(on & m_lt((r->oz + t * r->dz) - terrain, f_all(0)));
    p->s.id = i_sel(hit, i_all(SLT_WITNESS_AT_T1), p->s.id);
    p->on = m_opaque(p->on & m_not(hit));
}

/* Walks begin in a cell, all lanes at once: no node is looked at yet. There most shadows begin. The rest of OCCLUDED
 * then looks where falling rays end, which is mostly below the ground or where they leave the box, so that a view from
 * above needs no walk, and at the lines of PROBES. */
INLINE void packet_first(Packet *p, const Field *f, SltQuery what, const flt *heights, FieldCounts *counts) {
    static const int ahead[] = PROBES;
    vm cells = p->on & mi_eq(p->level, i_all(0));
    if (m_any(cells)) {
        if (counts) counts->cells++;
        packet_cell(p, f, what, heights, cells, NULL);
    }
    if (what != SLT_QUERY_OCCLUDED) return;
    vm xm = m_opaque(m_le(p->rdx, p->rdy));
    vi from = i_sel(xm, p->i, p->j);
    vm falling = m_opaque(p->on & p->falling);
    if (m_any(falling)) {
        if (counts) counts->cells++;
        vf end = f_sel(xm, p->ox, p->oy) + p->r.tl * f_abs(f_sel(xm, p->r.dx, p->r.dy));
        packet_probe(p, f, heights, xm, f_int(end) + i_sel(xm, p->flipx, p->flipy), falling);
    }
    for (uint32_t n = 0; n < sizeof ahead / sizeof *ahead && m_any(p->on); n++) {
        if (counts) counts->cells++;
        packet_probe(p, f, heights, xm, from + i_all(ahead[n]), p->on);
    }
}

/* One step of a packet that still has rays. */
INLINE void packet_step(Packet *p, const Field *f, SltQuery what, const flt *heights, Slice *slice,
                        FieldCounts *counts) {
    if (what != SLT_QUERY_RISE && m_any(p->on & m_not(mi_eq(p->level, i_all(0))))) {
        if (counts) counts->nodes++;
        packet_node(p, &f->mip, what, slice);
    }
    vm cells = p->on & mi_eq(p->level, i_all(0));
    if (m_any(cells)) {
        if (counts) counts->cells++;
        packet_cell(p, f, what, heights, cells, slice);
    }
}

INLINE vi packet_walk(const Field *f, SltQuery what, const flt *heights, const flt *rays, uint32_t width, vm on,
                      Slice *slice, FieldCounts *counts) {
    Packet p;
    packet_locate(&p, f, what, rays, width, on);
    packet_start(&p, f, what, heights);
    if (HITS(what)) packet_first(&p, f, what, heights, counts);
    while (m_any(p.on)) packet_step(&p, f, what, heights, slice, counts);
    return p.s.id;
}

/* Two at once: while one waits for memory the other computes. */
INLINE void packet_walk2(const Field *f, SltQuery what, const flt *heights, const flt *rays, uint32_t width,
                         uint32_t bits0, uint32_t bits1, int32_t *id) {
    Packet p, q;
    packet_locate(&p, f, what, rays, width, m_make(bits0));
    packet_locate(&q, f, what, rays + LANES, width, m_make(bits1));
    packet_start(&p, f, what, heights);
    packet_start(&q, f, what, heights);
    if (HITS(what)) packet_first(&p, f, what, heights, NULL), packet_first(&q, f, what, heights, NULL);
    while (m_any(p.on) && m_any(q.on)) {
        if (what != SLT_QUERY_RISE) {
            packet_node(&p, &f->mip, what, NULL);
            packet_node(&q, &f->mip, what, NULL);
        }
        vm cp = p.on & mi_eq(p.level, i_all(0)), cq = q.on & mi_eq(q.level, i_all(0));
        if (m_any(cp)) packet_cell(&p, f, what, heights, cp, NULL);
        if (m_any(cq)) packet_cell(&q, f, what, heights, cq, NULL);
    }
    while (m_any(p.on)) packet_step(&p, f, what, heights, NULL, NULL);
    while (m_any(q.on)) packet_step(&q, f, what, heights, NULL, NULL);
    i_store(id, p.s.id);
    i_store(id + LANES, q.s.id);
}

#if PACKS
/* Writes the answers so far. */
INLINE void packet_store(const Packet *p, int32_t *id) {
    int32_t lane[LANES], found[LANES];
    i_store(lane, p->lane);
    i_store(found, p->s.id);
    for (uint32_t n = 0; n < p->count; n++) id[lane[n]] = found[n];
}

/* The rays of q that go on join those of p that do: together no more than one packet holds. TRACE only: other searches
 * carry more. */
INLINE void packet_join(Packet *p, const Packet *q) {
    const vi one = i_all(1);
    const vf none = f_all(0);
    const vm mp = p->on, mq = q->on;
    const uint32_t np = (uint32_t)__builtin_popcount(m_bits(mp));
    const vm after = m_make(~0u << np);
    Ray *r = &p->r;
    p->count = np + (uint32_t)__builtin_popcount(m_bits(mq));
#define JOIN(a) p->a = f_pack(p->a, mp, q->a, mq, after)
    JOIN(r.ox), JOIN(r.oy), JOIN(r.oz), JOIN(r.dx), JOIN(r.dy), JOIN(r.dz), JOIN(r.t1), JOIN(r.tl), JOIN(r.rdx),
        JOIN(r.rdy), JOIN(r.rds), JOIN(t), JOIN(tx), JOIN(ty), JOIN(z);
#undef JOIN
#define JOIN(a) p->a = i_pack(p->a, mp, q->a, mq, after)
    JOIN(i), JOIN(j), JOIN(level), JOIN(lane);
#undef JOIN
    r->xpos = m_opaque(m_lt(none, r->rdx)), r->ypos = m_opaque(m_lt(none, r->rdy)),
    r->dsneg = m_opaque(m_lt(r->dx + r->dy, none));
    r->so = r->ox + r->oy;
    packet_turn(p);
    p->size = one << p->level;
    p->falling = m_lt(r->dz, none);
    p->s.id = i_all(SLT_WITNESS_NONE), p->s.done = m_make(0);
    p->on = m_make((1u << p->count) - 1);
}

/* Walks two packets until one, p, holds all rays that go on. */
INLINE void packet_pair(Packet *p, Packet *q, const Field *f, SltQuery what, const flt *heights, int32_t *id) {
    while (__builtin_popcount(m_bits(p->on)) + __builtin_popcount(m_bits(q->on)) > LANES) {
        packet_node(p, &f->mip, what, NULL);
        packet_node(q, &f->mip, what, NULL);
        vm cp = p->on & mi_eq(p->level, i_all(0)), cq = q->on & mi_eq(q->level, i_all(0));
        if (m_any(cp)) packet_cell(p, f, what, heights, cp, NULL);
        if (m_any(cq)) packet_cell(q, f, what, heights, cq, NULL);
    }
    packet_store(p, id);
    packet_store(q, id);
    packet_join(p, q);
}

/* Where the rays begin: asks for the heights there, which come from memory while the next packet does the same. */
INLINE void packet_fetch(Packet *p, const Field *f, SltQuery what, const flt *heights, const flt *rays, uint32_t width,
                         uint64_t mask, uint32_t at) {
    const int w = (int)f->w, h = (int)f->h;
    int32_t vertex[LANES];
    packet_locate(p, f, what, rays + at, width, m_make((uint32_t)(mask >> at) & ((1u << LANES) - 1)));
    p->lane = i_count((int)at), p->count = LANES;
    if (!m_any(p->on & m_eq(p->t, p->r.te))) return;
    i_store(vertex, VERTEX(w, h, p->i, p->j));
    for (uint32_t n = 0; n < LANES; n++)
        __builtin_prefetch(heights + vertex[n]), __builtin_prefetch(heights + vertex[n] - w);
}

/* After packet_fetch: walks until one packet, p, holds all rays that go on. */
INLINE void packet_two(Packet *p, Packet *q, const Field *f, SltQuery what, const flt *heights, int32_t *id) {
    packet_start(p, f, what, heights);
    packet_start(q, f, what, heights);
    packet_first(p, f, what, heights, NULL);
    packet_first(q, f, what, heights, NULL);
    packet_pair(p, q, f, what, heights, id);
}

INLINE void packet_join2(const Field *f, SltQuery what, const flt *heights, const flt *rays, uint32_t width,
                         uint64_t mask, uint32_t at, int32_t *id) {
    Packet p, q;
    packet_fetch(&p, f, what, heights, rays, width, mask, at);
    packet_fetch(&q, f, what, heights, rays, width, mask, at + LANES);
    packet_two(&p, &q, f, what, heights, id);
    while (m_any(p.on)) packet_step(&p, f, what, heights, NULL, NULL);
    packet_store(&p, id);
}

INLINE void packet_join4(const Field *f, SltQuery what, const flt *heights, const flt *rays, uint32_t width,
                         uint64_t mask, uint32_t at, int32_t *id) {
    Packet p, q, r, s;
    packet_fetch(&p, f, what, heights, rays, width, mask, at);
    packet_fetch(&q, f, what, heights, rays, width, mask, at + LANES);
    packet_fetch(&r, f, what, heights, rays, width, mask, at + 2 * LANES);
    packet_fetch(&s, f, what, heights, rays, width, mask, at + 3 * LANES);
    packet_two(&p, &q, f, what, heights, id);
    packet_two(&r, &s, f, what, heights, id);
    packet_pair(&p, &r, f, what, heights, id);
    while (m_any(p.on)) packet_step(&p, f, what, heights, NULL, NULL);
    packet_store(&p, id);
}

/* Functions of their own: compilers then see one walk at a time. */
typedef void FN(Joined)(const Field *f, const flt *heights, const flt *rays, uint32_t width, uint64_t mask, uint32_t at,
                        int32_t *id);
#define JOINED(name, join, what)                                                                                                                                             \
    static __attribute__((noinline)) void FN(name)(const Field *f, const flt *heights, const flt *rays, uint32_t width, uint64_t mask, uint32_t at, int32_t *id) {         \
        join(f, what, heights, rays, width, mask, at, id);                                                                                                                 \
    }
JOINED(trace2, packet_join2, SLT_QUERY_TRACE)
JOINED(trace4, packet_join4, SLT_QUERY_TRACE)
JOINED(occluded2, packet_join2, SLT_QUERY_OCCLUDED)
JOINED(occluded4, packet_join4, SLT_QUERY_OCCLUDED)
#undef JOINED
#endif

INLINE void packet_run(const Field *f, SltQuery what, const void *heights, const void *rays, uint64_t mask,
                       uint32_t width, int32_t *id, FieldCounts *counts) {
    const flt *p = rays;
    for (uint32_t at = 0; at < width; at += LANES) {
#if PACKS
        if (HITS(what) && width - at >= 2 * LANES) {
            const bool four = width - at >= 4 * LANES;
            FN(Joined) *const join =
                what == SLT_QUERY_TRACE ? (four ? FN(trace4) : FN(trace2)) : (four ? FN(occluded4) : FN(occluded2));
            join(f, heights, p, width, mask, at, id);
            at += (four ? 3 : 1) * LANES;
            continue;
        }
#endif
        if (LANES > 1 && width - at >= 2 * LANES) {
            const uint32_t all = (1u << (LANES & 31)) - 1;
            packet_walk2(f, what, heights, p + at, width, (uint32_t)(mask >> at) & all,
                         (uint32_t)(mask >> (at + LANES)) & all, id + at);
            at += LANES;
            continue;
        }
        uint32_t bits = (uint32_t)(mask >> at), rest = width - at;
        if (LANES < 32) bits &= (1u << LANES) - 1;
        if (rest >= LANES) {
            i_store(id + at, packet_walk(f, what, heights, p + at, width, m_make(bits), NULL, counts));
        } else { /* the last lanes of a width that is no multiple of LANES */
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
    static void FN(name)(const SltGeometry *field, const void *heights, const void *rays, uint64_t mask, uint32_t width, int32_t *id) {                                       \
        Field room;                                                                                                                                                        \
        packet_run(field_asked(field, &room), what, heights, rays, mask, width, id, NULL);                                                                                 \
    }
PACKET_QUERY(trace, SLT_QUERY_TRACE)
PACKET_QUERY(occluded, SLT_QUERY_OCCLUDED)
PACKET_QUERY(clearance, SLT_QUERY_CLEARANCE)
PACKET_QUERY(shadow, SLT_QUERY_SHADOW)
PACKET_QUERY(silhouette, SLT_QUERY_SILHOUETTE)
PACKET_QUERY(rise, SLT_QUERY_RISE)
