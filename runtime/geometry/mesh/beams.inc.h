/* Windows of lanes, eight at a time. Include behind lanes.h. */
typedef D8 Wide __attribute__((aligned(8)));

/* NaN is left out. */
INLINE void keep_min(D8 *a, const D8 *b) { *a = lower_D8(*b, *a); }
INLINE void keep_max(D8 *a, const D8 *b) { *a = higher_D8(*b, *a); }

INLINE void dot8(const D8 a[3], const double b[3], D8 *out) { *out = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

INLINE void size_of(const D8 *x, D8 *size) {
    D8 negative = -*x;
    *size = *x;
    keep_max(size, &negative);
}

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
    const L8 small = rounding < ASIDE_MOST * size;
    *by = (D8)((small & (L8)(least + rounding / size)) | (~small & (L8)((D8){0} + ASIDE_MOST)));
}

INLINE void put_aside(Beams *b, bool f64, uint32_t k) {
    D8 row[SLT_BEAM_ROWS], q[3], far = {0}, near = {0}, one, s, t;
    for (uint32_t r = SLT_BEAM_CORNER; r < SLT_BEAM_ROWS; r++) row[r] = *(const Wide *)&b->row[r][k];
    for (int a = 0; a < 3; a++) size_of(&row[SLT_BEAM_CORNER + a], &one), keep_max(&far, &one);
    /* Where the corner is taken from the origin, the way to the eye rounds nothing. */
    const L8 own = *(const Wide *)&b->row[BEAM_OWN][k] != 0;
    for (int a = 0; a < 3; a++)
        q[a] = *(const Wide *)&b->row[BEAM_Q + a][k], size_of(&q[a], &one), keep_max(&near, &one);
    far = (D8)((own & (L8)near) | (~own & (L8)far));
    aside(&far, row + SLT_BEAM_U, f64 ? 0x1p-51 : 0x1p-22, ASIDE_S, &s);
    aside(&far, row + SLT_BEAM_V, f64 ? 0x1p-51 : 0x1p-22, ASIDE_T, &t);
    for (int a = 0; a < 3; a++) {
        const D8 by = s * row[SLT_BEAM_U + a] + t * row[SLT_BEAM_V + a];
        *(Wide *)&b->row[SLT_BEAM_CORNER + a][k] = row[SLT_BEAM_CORNER + a] + by;
        *(Wide *)&b->row[BEAM_Q + a][k] = q[a] + by;
    }
}

static void read(Beams *b, bool f64, const void *rays, uint64_t mask, uint32_t width, double magnitude) {
    const uint32_t padded = (width + 7) / 8 * 8;
    b->mask = width < LANES ? mask & ((1ull << width) - 1) : mask, b->far = 0;
    for (uint32_t k = 0; k < SLT_BEAM_ROWS; k++) {
        double *to = b->row[k];
        if (f64) memcpy(to, (const double *)rays + (size_t)k * width, width * sizeof *to);
        else
            for (uint32_t i = 0; i < width; i++) to[i] = (double)((const float *)rays)[(size_t)k * width + i];
        for (uint32_t i = width; i < padded; i++) to[i] = 0;
    }
    for (uint32_t i = 0; i < width; i += 8) {
        L8 good = ~(L8){0};
        for (uint32_t k = 0; k < SLT_BEAM_ROWS; k++) {
            const D8 at = *(const Wide *)&b->row[k][i];
            good &= (at <= 1e30) & (at >= -1e30);
        }
        D8 corner[3], c[3], one, eye = {0}, near = {0};
        for (int a = 0; a < 3; a++) {
            const D8 from = *(const Wide *)&b->row[SLT_BEAM_EYE + a][i];
            corner[a] = *(const Wide *)&b->row[SLT_BEAM_CORNER + a][i];
            size_of(&from, &one), keep_max(&eye, &one), size_of(&corner[a], &one), keep_max(&near, &one);
            *(Wide *)&b->row[SLT_BEAM_CORNER + a][i] = c[a] = corner[a] - from;
        }
        const L8 far = eye > FAR_EYE * magnitude, own = far & (near < NEAR_WINDOW * eye);
        b->far |= (uint64_t)bits_D8(far) << i;
        for (int a = 0; a < 3; a++) *(Wide *)&b->row[BEAM_Q + a][i] = (D8)((own & (L8)corner[a]) | (~own & (L8)c[a]));
        *(Wide *)&b->row[BEAM_OWN][i] = (D8)(own & (L8)((D8){0} + 1));
        put_aside(b, f64, i);
        b->mask &= ~((uint64_t)(~bits_D8(good) & 255) << i);
    }
}

static void place(const Window *w, const Beams *b, uint32_t width, Places *out) {
    out->ahead = 0;
    for (uint32_t k = 0; k < width; k += 8) {
        D8 u[3], v[3], c[3], at[3][4];
        L8 ahead = ~(L8){0};
        for (int a = 0; a < 3; a++) {
            ahead &= *(const Wide *)&b->row[SLT_BEAM_EYE + a][k] == w->eye[a];
            c[a] = *(const Wide *)&b->row[SLT_BEAM_CORNER + a][k];
            u[a] = *(const Wide *)&b->row[SLT_BEAM_U + a][k], v[a] = *(const Wide *)&b->row[SLT_BEAM_V + a][k];
        }
        for (int i = 0; i < 3; i++) {
            D8 first, s, t;
            dot8(c, w->plane[i], &first), dot8(u, w->plane[i], &s), dot8(v, w->plane[i], &t);
            at[i][0] = first, at[i][1] = first + s, at[i][2] = first + t, at[i][3] = first + s + t;
        }
        for (int q = 0; q < 4; q++) {
            const D8 inverse = 1 / at[2][q];
            ahead &= at[2][q] > 0;
            for (int i = 0; i < 2; i++) at[i][q] *= inverse;
        }
        for (int i = 0; i < 2; i++) {
            D8 lo = at[i][0], hi = lo;
            for (int q = 1; q < 4; q++) keep_min(&lo, &at[i][q]), keep_max(&hi, &at[i][q]);
            *(Wide *)&out->lo[i][k] = lo, *(Wide *)&out->hi[i][k] = hi;
        }
        out->ahead |= (uint64_t)bits_D8(ahead) << k;
    }
}
