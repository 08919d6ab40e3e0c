/* Windows of lanes, eight at a time. Include behind lanes.h. */
typedef D8 Wide __attribute__((aligned(8)));
typedef float Narrow __attribute__((vector_size(32), aligned(4)));

/* NaN is left out. */
INLINE void keep_min(D8 *a, const D8 *b) { *a = lower_D8(*b, *a); }
INLINE void keep_max(D8 *a, const D8 *b) { *a = higher_D8(*b, *a); }

INLINE void dot8(const D8 a[3], const double b[3], D8 *out) { *out = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

INLINE void cross8(const D8 a[3], const D8 b[3], D8 out[3]) {
    for (int i = 0; i < 3; i++) out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

INLINE void size_of(const D8 *x, D8 *size) { *size = (D8)((L8)*x & INT64_MAX); }

/* Borders of windows and of their parts do not move, so an edge that lies on the border of two moves in neither: a
 * square whose corners are those of pixels. Windows are put aside, all alike, by more than what counts as on a line and
 * than rounding moves their corners by, and by more than COVERED, or the sliver that is left beside an edge were lost
 * with the edge; by less than anyone measures in that precision. */
#define ASIDE_S 2.3e-12
#define ASIDE_T 1.9e-12
#define ASIDE_MOST 0x1p-14

/* Of a side of the windows, from its size as seen from the eye. */
INLINE void aside(const D8 *far, const D8 side[3], double precision, double least, D8 *by) {
    D8 size = {0}, one;
    for (int a = 0; a < 3; a++) size_of(&side[a], &one), keep_max(&size, &one);
    const D8 rounding = precision * *far;
    *by = chosen(less(rounding, ASIDE_MOST * size), least + rounding / size, all_D8(ASIDE_MOST));
}

INLINE void largest_of(const D8 x[3], D8 *size) {
    D8 one;
    size_of(&x[0], size);
    for (int a = 1; a < 3; a++) size_of(&x[a], &one), keep_max(size, &one);
}

/* Eight windows of rows of SltBeamRow; those which can be looked through. */
INLINE uint32_t read_row(Beams *b, bool f64, D8 row[SLT_BEAM_ROWS], uint32_t k, double magnitude, bool shared) {
    D8 *corner = row + SLT_BEAM_CORNER, *u = row + SLT_BEAM_U, *v = row + SLT_BEAM_V, c[3], q[3], n[3], eye, near, size,
       whole, s, t;
    uint32_t good = 255;
    for (uint32_t r = 0; r < SLT_BEAM_ROWS; r++) size_of(&row[r], &size), good &= upto(size, all_D8(1e30));
    b->blind |= (uint64_t)(~good & 255) << k;
    for (int a = 0; a < 3; a++) c[a] = corner[a] - row[SLT_BEAM_EYE + a];
    largest_of(row + SLT_BEAM_EYE, &eye), largest_of(corner, &near);
    const uint32_t far = less(all_D8(FAR_EYE * magnitude), eye), own = far & less(near, NEAR_WINDOW * eye);
    b->far |= (uint64_t)far << k;
    /* Where the corner is taken from the origin, the way to the eye rounds nothing. */
    for (int a = 0; a < 3; a++) q[a] = own ? chosen(own, corner[a], c[a]) : c[a];
    largest_of(q, &size);
    aside(&size, u, f64 ? 0x1p-51 : 0x1p-22, ASIDE_S, &s);
    aside(&size, v, f64 ? 0x1p-51 : 0x1p-22, ASIDE_T, &t);
    for (int a = 0; a < 3; a++) {
        const D8 by = s * u[a] + t * v[a];
        c[a] += by, q[a] += by;
        *(Wide *)&b->row[SLT_BEAM_CORNER + a][k] = c[a], *(Wide *)&b->row[BEAM_Q + a][k] = q[a];
        if (shared && k) continue;
        *(Wide *)&b->row[SLT_BEAM_EYE + a][k] = row[SLT_BEAM_EYE + a];
        *(Wide *)&b->row[SLT_BEAM_U + a][k] = u[a], *(Wide *)&b->row[SLT_BEAM_V + a][k] = v[a];
    }
    *(Wide *)&b->row[BEAM_OWN][k] = chosen(own, all_D8(1), all_D8(0));
    /* One that is a line, or passes through its eye, is none. */
    cross8(v, c, n);
    whole = u[0] * n[0] + u[1] * n[1] + u[2] * n[2];
    size_of(&whole, &size);
    return good & less(all_D8(0), size) & upto(size, all_D8(DBL_MAX));
}

/* Is each of the rows of eye, u and v the same number, bit by bit, in all of so many lanes, eights of them? */
INLINE bool is_shared(bool f64, const void *rays, uint32_t width) {
    typedef int64_t Bits __attribute__((vector_size(32), aligned(4), may_alias));
    const size_t size = f64 ? sizeof(double) : sizeof(float), row = width * size;
    const unsigned char *from = rays;
    Bits apart = {0}, one[9];
    for (uint32_t r = 0; r < 9; r++) {
        uint64_t wide;
        uint32_t narrow;
        const unsigned char *first = from + (r < 3 ? r : r + 3) * row;
        memcpy(&wide, first, sizeof wide), memcpy(&narrow, first, sizeof narrow);
        one[r] = (Bits){0} + (int64_t)(f64 ? wide : narrow * 0x100000001u);
    }
    for (size_t at = 0; at < row; at += sizeof(Bits))
        for (uint32_t r = 0; r < 9; r++) apart |= *(const Bits *)(from + (r < 3 ? r : r + 3) * row + at) ^ one[r];
    return !(apart[0] | apart[1] | apart[2] | apart[3]);
}
_Static_assert(SLT_BEAM_CORNER == 3 && SLT_BEAM_U == 6 && SLT_BEAM_ROWS == 12, "eye, corner, u, v");

INLINE D8 eight_of(bool f64, const void *rays, size_t at) {
    return f64 ? *(const Wide *)((const double *)rays + at) : wide_F8(*(const Narrow *)((const float *)rays + at));
}

/* Windows of one eye, all with the same sides, as those of an image are. */
INLINE bool read_shared(Beams *b, bool f64, const void *rays, uint32_t width, double magnitude) {
    D8 row[SLT_BEAM_ROWS];
    if (!is_shared(f64, rays, width)) return false;
    for (uint32_t r = 0; r < SLT_BEAM_ROWS; r++)
        if (r / 3 != SLT_BEAM_CORNER / 3) row[r] = eight_of(f64, rays, (size_t)r * width);
    b->shared = true;
    for (uint32_t k = 0; k < width; k += 8) {
        for (uint32_t a = 0; a < 3; a++)
            row[SLT_BEAM_CORNER + a] = eight_of(f64, rays, (size_t)(SLT_BEAM_CORNER + a) * width + k);
        b->mask |= (uint64_t)read_row(b, f64, row, k, magnitude, true) << k;
    }
    return true;
}

/* What u and v add to where a frame's windows lie, at least and at most. */
INLINE void spread_of(const Window *w, double spread[2][2]) {
    for (int i = 0; i < 2; i++) {
        const double s = window_dot(w->u, w->plane[i]), t = window_dot(w->v, w->plane[i]), add[3] = {s, t, s + t};
        spread[i][0] = spread[i][1] = 0;
        for (int q = 0; q < 3; q++) {
            if (add[q] < spread[i][0]) spread[i][0] = add[q];
            if (add[q] > spread[i][1]) spread[i][1] = add[q];
        }
    }
}

/* Where windows lie with corners c and the frame's u and v, which lie across as it does; those ahead. */
INLINE uint32_t place_alike(const Window *w, const D8 c[3], const double spread[2][2], D8 lo[2], D8 hi[2], D8 *away) {
    D8 far, square, at;
    dot8(c, w->plane[2], &far);
    *away = far;
    square = c[0] * c[0] + c[1] * c[1] + c[2] * c[2];
    const D8 inverse = 1 / far;
    const L8 power = (L8)(far * w->per_power) & POWER_OF_TWO;
    for (int i = 0; i < 2; i++) {
        dot8(c, w->plane[i], &at);
        lo[i] = (at + spread[i][0]) * inverse, hi[i] = (at + spread[i][1]) * inverse;
    }
    return bits_D8(power == w->power) & upto(square, GRAZING * w->per_power * far * far) & less(all_D8(0), far);
}

/* Before they are read: do all windows surely lie in a rectangle of a frame, whose eye and sides they share, and where?
 * They are not put aside here, which moves them by less than what is left at the borders. */
INLINE bool all_inside(const Window *w, const Rectangle *in, bool f64, const void *rays, uint32_t width,
                       Rectangle *all) {
    D8 lo_all[2], hi_all[2];
    double spread[2][2], one[SLT_BEAM_ROWS];
    if (!is_shared(f64, rays, width) || !(w->per_power > 0)) return false;
    for (uint32_t r = 0; r < SLT_BEAM_ROWS; r++)
        one[r] = f64 ? ((const double *)rays)[r * width] : (double)((const float *)rays)[r * width];
    if (memcmp(one + SLT_BEAM_EYE, w->eye, sizeof w->eye) || memcmp(one + SLT_BEAM_U, w->u, sizeof w->u) ||
        memcmp(one + SLT_BEAM_V, w->v, sizeof w->v))
        return false;
    spread_of(w, spread);
    uint32_t inside = 255;
    for (uint32_t k = 0; k < width; k += 8) {
        D8 c[3], lo[2], hi[2], far;
        for (uint32_t a = 0; a < 3; a++)
            c[a] = eight_of(f64, rays, (size_t)(SLT_BEAM_CORNER + a) * width + k) - w->eye[a];
        inside &= place_alike(w, c, (const double(*)[2])spread, lo, hi, &far);
        for (int i = 0; i < 2; i++) {
            const D8 left = 2 * ASIDE_MOST * (hi[i] - lo[i]);
            inside &= upto(in->lo[i] + left, lo[i]) & upto(hi[i] + left, all_D8(in->hi[i]));
            lo_all[i] = k ? lower(lo[i], lo_all[i]) : lo[i], hi_all[i] = k ? higher(hi[i], hi_all[i]) : hi[i];
        }
    }
    if (inside != 255) return false;
    for (int i = 0; i < 2; i++) all->lo[i] = least_of(lo_all[i]), all->hi[i] = -least_of(-hi_all[i]);
    return true;
}

static bool surely_inside(const Window *w, const Rectangle *in, bool f64, const void *rays, uint32_t width,
                          Rectangle *all) {
    if (width % 8) return false;
    return f64 ? all_inside(w, in, true, rays, width, all) : all_inside(w, in, false, rays, width, all);
}

static void read(Beams *b, bool f64, const void *rays, uint64_t mask, uint32_t width, double magnitude) {
    b->mask = 0, b->far = 0, b->blind = 0, b->shared = false;
    if (width % 8 == 0 &&
        (f64 ? read_shared(b, true, rays, width, magnitude) : read_shared(b, false, rays, width, magnitude))) {
        b->mask &= mask, b->blind &= mask;
        return;
    }
    for (uint32_t k = 0; k < width; k += 8) {
        D8 row[SLT_BEAM_ROWS];
        for (uint32_t r = 0; r < SLT_BEAM_ROWS; r++) {
            const size_t at = (size_t)r * width + k;
            const uint32_t n = width - k < 8 ? width - k : 8;
            if (n == 8) {
                row[r] = eight_of(f64, rays, at);
                continue;
            }
            row[r] = (D8){0};
            for (uint32_t i = 0; i < n; i++)
                row[r][i] = f64 ? ((const double *)rays)[at + i] : (double)((const float *)rays)[at + i];
        }
        b->mask |= (uint64_t)read_row(b, f64, row, k, magnitude, false) << k;
    }
    b->mask &= mask & LOW_BITS(width), b->blind &= mask & LOW_BITS(width);
}

INLINE uint32_t same(D8 a, double b) { return upto(a, all_D8(b)) & upto(all_D8(b), a); }

/* Where windows lie whose corners are c + 0, u, v or u + v; those ahead. */
INLINE uint32_t place_any(const Window *w, const D8 c[3], const D8 u[3], const D8 v[3], D8 lo[2], D8 hi[2]) {
    D8 at[3][4];
    uint32_t ahead = 255;
    for (int i = 0; i < 3; i++) {
        D8 first, s, t;
        dot8(c, w->plane[i], &first), dot8(u, w->plane[i], &s), dot8(v, w->plane[i], &t);
        at[i][0] = first, at[i][1] = first + s, at[i][2] = first + t, at[i][3] = first + s + t;
    }
    for (int q = 0; q < 4; q++) {
        const D8 inverse = 1 / at[2][q];
        ahead &= less(all_D8(0), at[2][q]);
        for (int i = 0; i < 2; i++) at[i][q] *= inverse;
    }
    for (int i = 0; i < 2; i++) {
        lo[i] = hi[i] = at[i][0];
        for (int q = 1; q < 4; q++) keep_min(&lo[i], &at[i][q]), keep_max(&hi[i], &at[i][q]);
    }
    return ahead;
}

/* shared: Beams. */
INLINE void place_rows(const Window *w, const Beams *b, uint32_t base, uint32_t width, bool shared, Places *out) {
    const uint64_t who = b->mask & ~0ull << base;
    D8 lo_all[2] = {all_D8(HUGE_VAL), all_D8(HUGE_VAL)}, hi_all[2] = {all_D8(-HUGE_VAL), all_D8(-HUGE_VAL)}, area = {0};
    double spread[2][2];
    uint32_t of_eye = 255, alike = 255;
    spread_of(w, spread);
    out->ahead = out->alike = 0;
    for (uint32_t k = 0; k < width; k += 8) {
        const uint32_t on = (uint32_t)(who >> k) & 255, from = shared ? 0 : k;
        D8 u[3], v[3], c[3], lo[2], hi[2], far;
        if (!shared || k == 0) {
            of_eye = alike = 255;
            for (int a = 0; a < 3; a++) {
                of_eye &= same(*(const Wide *)&b->row[SLT_BEAM_EYE + a][k], w->eye[a]);
                alike &= same(*(const Wide *)&b->row[SLT_BEAM_U + a][k], w->u[a]) &
                         same(*(const Wide *)&b->row[SLT_BEAM_V + a][k], w->v[a]);
            }
        }
        if (!on) continue;
        for (int a = 0; a < 3; a++) c[a] = *(const Wide *)&b->row[SLT_BEAM_CORNER + a][k];
        const uint32_t across = w->per_power > 0 ? alike : 0;
        uint32_t ahead = place_alike(w, c, (const double(*)[2])spread, lo, hi, &far);
        *(Wide *)&out->far[k] = chosen(across & ahead, far, all_D8(HUGE_VAL));
        if (on & ~across) {
            D8 any_lo[2], any_hi[2];
            for (int a = 0; a < 3; a++)
                u[a] = *(const Wide *)&b->row[SLT_BEAM_U + a][from],
                v[a] = *(const Wide *)&b->row[SLT_BEAM_V + a][from];
            const uint32_t any = place_any(w, c, u, v, any_lo, any_hi);
            ahead = (ahead & across) | (any & ~across);
            for (int i = 0; i < 2; i++)
                lo[i] = chosen(across, lo[i], any_lo[i]), hi[i] = chosen(across, hi[i], any_hi[i]);
        }
        for (int i = 0; i < 2; i++) {
            *(Wide *)&out->lo[i][k] = lo[i], *(Wide *)&out->hi[i][k] = hi[i];
            lo_all[i] = lower(chosen(on, lo[i], lo_all[i]), lo_all[i]);
            hi_all[i] = higher(chosen(on, hi[i], hi_all[i]), hi_all[i]);
        }
        area += chosen(on, (hi[0] - lo[0]) * (hi[1] - lo[1]), all_D8(0));
        out->ahead |= (uint64_t)(ahead & of_eye) << k, out->alike |= (uint64_t)alike << k;
    }
    for (int i = 0; i < 2; i++) out->all.lo[i] = least_of(lo_all[i]), out->all.hi[i] = -least_of(-hi_all[i]);
    out->area = 0;
    for (int i = 0; i < 8; i++) out->area += area[i];
}

static void place(const Window *w, const Beams *b, uint32_t base, uint32_t width, Places *out) {
    if (b->shared) place_rows(w, b, base, width, true, out);
    else place_rows(w, b, base, width, false, out);
}
