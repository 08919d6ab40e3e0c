/* Marching by safety shapes (cone.h), LANES rays at a time: each lane either steps to where the shape of its cell ends,
 * or, where that is near, runs the test of leaf.h on the cell and goes to the next. A step that may hold one crossing
 * (relaxed) is bisected when it ends at or below the surface: at points, not on grid lines, down to less than a cell;
 * leaf.h decides from there on. The march follows the ray lowered by `close`, which is more than all rounding errors:
 * the lowered ray starts above the surface, so it crosses once, and until then no test of leaf.h finds a hit. */
#define cone_gather FN(cone_gather)
#define cone_walk FN(cone_walk)
#define cone_run FN(cone_run)
#define cone_height FN(cone_height)
#define cone_trace FN(cone_trace)

#undef CONE_LEAST
#define CONE_LEAST 1.5 /* cells: a shorter step costs more than the test of a cell */

/* Base and slope of the shapes number `at`. */
INLINE void cone_gather(const FieldCones *c, vi at, vm on, vf *base, vf *slope) {
#if LANES == 16 && !F64
    __m512i p = _mm512_mask_i32gather_epi32(_mm512_setzero_si512(), on, (__m512i)at, c->packed, 4);
    *base = _mm512_cvtepi32_ps(_mm512_and_si512(p, _mm512_set1_epi32(0xffff)));
    *slope = _mm512_castsi512_ps(_mm512_andnot_si512(_mm512_set1_epi32(0xffff), p));
#elif LANES == 8 && !F64
    __m256i p =
        _mm256_mask_i32gather_epi32(_mm256_setzero_si256(), (const int *)c->packed, (__m256i)at, (__m256i)on, 4);
    *base = _mm256_cvtepi32_ps(_mm256_and_si256(p, _mm256_set1_epi32(0xffff)));
    *slope = _mm256_castsi256_ps(_mm256_andnot_si256(_mm256_set1_epi32(0xffff), p));
#else
    int32_t where[LANES];
    flt low[LANES], high[LANES];
    uint32_t bits = m_bits(on);
    i_store(where, at);
    for (int n = 0; n < LANES; n++) {
        uint32_t p = bits >> n & 1 ? c->packed[where[n]] : 0, upper = p & 0xffff0000u;
        float s;
        memcpy(&s, &upper, sizeof s);
        low[n] = (flt)(p & 0xffff), high[n] = (flt)s;
    }
    *base = f_load(low), *slope = f_load(high);
#endif
    *base = f_all((flt)c->lowest) + *base * f_all((flt)c->step);
}

/* The ray's height above the terrain at t, in the cell it is in there. */
INLINE vf cone_height(const Ray *r, const flt *heights, int w, int h, vf t, vm on, vi *i, vi *j) {
    ray_locate(r, t, on, w, h, i, j);
    return (r->oz + t * r->dz) - ray_plane(r, t, heights, w, VERTEX(w, h, *i, *j), *i, *j, on);
}

INLINE vi cone_walk(const Field *f, const flt *heights, const flt *rays, uint32_t width, vm on, FieldCounts *counts) {
    const int w = (int)f->w, h = (int)f->h;
    const FieldCones *c = &f->cones;
    const bool relaxed = c->relaxed;
    const vi one = i_all(1), zero = i_all(0);
    const vf fzero = f_all(0);
    Ray r;
    Search s;
    Leaf leaf;
    vi i, j, start_id;
    r.ox = f_load(rays), r.oy = f_load(rays + width), r.oz = f_load(rays + 2 * width);
    r.dx = f_load(rays + 3 * width), r.dy = f_load(rays + 4 * width), r.dz = f_load(rays + 5 * width);
    r.te = f_load(rays + 6 * width), r.t1 = f_load(rays + 7 * width);
    s.id = i_all(SLT_WITNESS_NONE), s.done = m_make(0), s.best = s.limit = fzero;
    on = ray_setup(&r, w, h, on);
    if (!m_any(on)) return s.id;

    const flt unit = !F64      ? (flt)0x1p-19
                     : relaxed ? (flt)0x1p-30
                               : (flt)0x1p-48; /* many units in the last place; of relaxed shapes also more than what
                                                  cone_build.c neglects */
    vf adx = f_abs(r.dx), ady = f_abs(r.dy),
       rspeed = f_min(f_abs(r.rdx), f_abs(r.rdy)); /* t a cell of the main axis; infinite for a vertical ray */
    vf rise = r.dz * rspeed;
    vf close = f_abs(r.oz) * f_all(unit) + f_abs(r.dz) * f_max(f_abs(r.te), f_abs(r.tl)) * f_all(unit) +
               f_all((flt)((f->magnitude + (double)f->base.shared.slack) * unit + FLT_TINY));
    const vf z = r.oz - (close + f_all((flt)f->base.shared.slack));
    vi class = zero;
    if (c->classes == 4) {
        vm alongx = m_le(ady, adx);
        class = i_sel(alongx, i_sel(r.xpos, zero, one), i_sel(r.ypos, i_all(2), i_all(3))) * i_all(w * h);
    }
    vm steps = m_lt(rspeed, f_all(FLT_MAXIMUM));
    /* The place of a ray in its cell is known only up to rounding: to this part of a cell. */
    vf blur = f_all((flt)0.01) +
              f_all(unit) * (f_abs(r.ox) + f_abs(r.oy) + f_max(f_abs(r.te), f_abs(r.tl)) * f_max(adx, ady));
    if (c->relaxed && c->options.bounded) {
        vf m = f_all((flt)c->options.max_slope);
        steps = m_opaque(steps & (m_le(r.dz * f_abs(r.dz), m * f_abs(m) * (r.dx * r.dx + r.dy * r.dy))));
    }

    ray_locate(&r, r.te, on, w, h, &i, &j);
    vf start = ray_start(&r, heights, w, h, i, j, on, &start_id);
    search_start(&s, SLT_QUERY_TRACE, &r, start, start_id, on);
    vf t = r.te, above = (r.oz + t * r.dz) - start; /* above: at t; kept where relaxed */
    on = m_opaque(on & (m_not(s.done)));
    while (m_any(on)) {
        vf base, slope;
        vi cell = j * i_all(w) + i, at = class + cell;
        vm may = m_opaque(on & steps);
        if (relaxed) may &= m_lt(close + close, above);
        cone_gather(c, at, may, &base, &slope);
        if (counts) counts->nodes++;
        vf room = (z + t * r.dz) - base, opening = slope - rise;
        vf u = f_sel(m_lt(fzero, opening), room / opening, f_all((flt)1e6));
        u = f_sel(m_lt(fzero, room), u, fzero);
        if (relaxed && c->radius) {
            flt radius[LANES];
            int32_t where[LANES];
            i_store(where, at);
            uint32_t bits = m_bits(may);
            for (int n = 0; n < LANES; n++) radius[n] = bits >> n & 1 ? (flt)c->radius[where[n]] : 0;
            u = f_max(u, f_load(radius));
        }
        u = u * f_all((flt)0.9999) - blur;
        vm step = may & m_lt(f_all((flt)CONE_LEAST), u), stay = on & m_not(step);
        if (m_any(step)) {
            vf to = t + u * rspeed;
            step = m_opaque(step & (m_lt(t, to))); /* rounding may leave nothing of the step */
            stay = m_opaque(on & m_not(step));
            vm last = step & m_le(r.tl, to);
            to = f_min(to, r.tl);
            vm move = m_opaque(step & m_not(last));
            if (!relaxed) {
                on = m_opaque(on & (m_not(last))); /* the shape is free up to the ray's end: no hit */
                if (m_any(move)) {
                    vi ni, nj;
                    ray_locate(&r, to, move, w, h, &ni, &nj);
                    i = i_sel(move, ni, i), j = i_sel(move, nj, j), t = f_sel(move, to, t);
                }
            } else {
                vi ni, nj;
                vf there = cone_height(&r, heights, w, h, to, step, &ni, &nj);
                vm clear = step & m_lt(close, there);
                on = m_opaque(on & (m_not(last & clear)));
                vm cross = m_opaque(step & m_not(clear));
                i = i_sel(clear, ni, i), j = i_sel(clear, nj, j), t = f_sel(clear, to, t),
                above = f_sel(clear, there, above);
                /* [t, to] has the only place where the height falls to `close`: halve it, keeping t above. */
                vf cellt = rspeed * f_all((flt)0.5);
                vm wide = cross & m_lt(cellt, to - t);
                for (int n = 0; n < 24 && m_any(wide); n++, wide = m_opaque(wide & m_lt(cellt, to - t))) {
                    vf mid = t + (to - t) * f_all((flt)0.5);
                    there = cone_height(&r, heights, w, h, mid, wide, &ni, &nj);
                    vm high = wide & m_lt(close, there);
                    i = i_sel(high, ni, i), j = i_sel(high, nj, j), t = f_sel(high, mid, t),
                    above = f_sel(high, there, above);
                    to = f_sel(wide & m_not(high), mid, to);
                    if (counts) counts->nodes++;
                }
                stay |= m_opaque(cross); /* on by cells, from a point above */
            }
        }
        stay = m_opaque(stay & (on));
        if (m_any(stay)) {
            leaf_test(&leaf, &r, heights, w, h, i, j, t, line_x(&r, i + r.sx), line_y(&r, j + r.sy), stay);
            search_leaf(&s, SLT_QUERY_TRACE, &r, &leaf, w, i, j, stay);
            if (counts) counts->cells++;
            t = f_sel(stay, leaf.te, t);
            if (relaxed) above = f_sel(stay, (r.oz + t * r.dz) - leaf.he, above);
            on = m_opaque(on & (m_not(s.done) & m_not(stay & m_le(r.tl, t))));
            vm lx = stay & leaf.xexit, ly = stay & m_not(leaf.xexit);
            i = i_sel(lx, i + (r.sx + r.sx - one), i);
            j = i_sel(ly, j + (r.sy + r.sy - one), j);
        }
    }
    return s.id;
}

INLINE void cone_run(const Field *f, const void *heights, const void *rays, uint64_t mask, uint32_t width, int32_t *id,
                     FieldCounts *counts) {
    const flt *p = rays;
    for (uint32_t at = 0; at < width; at += LANES) {
        uint32_t bits = (uint32_t)(mask >> at), rest = width - at;
        if (LANES < 32) bits &= (1u << LANES) - 1;
        if (rest >= LANES) {
            i_store(id + at, cone_walk(f, heights, p + at, width, m_make(bits), counts));
        } else { /* the last lanes of a width that is no multiple of LANES */
            flt some[8 * LANES] = {0};
            int32_t out[LANES];
            for (uint32_t row = 0; row < 8; row++)
                for (uint32_t n = 0; n < rest; n++) some[row * LANES + n] = p[row * width + at + n];
            i_store(out, cone_walk(f, heights, some, LANES, m_make(bits & ((1u << rest) - 1)), counts));
            for (uint32_t n = 0; n < rest; n++) id[at + n] = out[n];
        }
    }
    if (counts) counts->rays += (uint64_t)__builtin_popcountll(width < 64 ? mask & ((1ull << width) - 1) : mask);
}

static void cone_trace(const SltGeometry *field, const void *heights, const void *rays, uint64_t mask, uint32_t width,
                       int32_t *id) {
    Field room;
    const Field *f = field_asked(field, &room);
    /* A shape that may hold a crossing holds for the heights it was made from, not for others. */
    if (f->cones.relaxed && f->base.shared.slack > 0)
        field_naive[F64][SLT_QUERY_TRACE](field, heights, rays, mask, width, id);
    else cone_run(f, heights, rays, mask, width, id, NULL);
}
