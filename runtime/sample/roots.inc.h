/* roots.h in the vectors of fill.inc.h. */
INLINE D magnitude(D x) { return (D)((L)x & INT64_MAX); }

/* Where to look next in [x1, x2], as a fraction of the way from x1 to x2 (Chandrupatla 1997): where the parabola
 * through three points is 0, if these lie well for it, else in the middle. */
INLINE D fraction(D x1, D x2, D x3, D f1, D f2, D f3, D tol, D width, L left) {
    enum { BIAS = 1023, MANTISSA = 52 };
    const D least = 0.75 * tol / width, half = all(0.5);
    const L many = left > BIAS, power = (left & ~many) | (many & BIAS);
    const D within = (D)((power + BIAS) << MANTISSA) * tol;
    const D xi = (x1 - x2) / (x3 - x2), phi = (f1 - f2) / (f3 - f2);
    const D parabola = f1 / (f2 - f1) * f3 / (f2 - f3) + (x3 - x1) / (x2 - x1) * f1 / (f3 - f1) * f2 / (f3 - f2);
    const L lies_well = (phi * phi < xi) & ((1 - phi) * (1 - phi) < 1 - xi), two = (x3 == x2) | (f3 == f2);
    D t = either(two, f1 / (f1 - f2), either(lies_well, parabola, half));
    t = either(magnitude(t) < HUGE_VAL, t, half);
    t = either(t < least, least, either(t > 1 - least, 1 - least, t));
    /* Once only bisection can still arrive in time, bisect. And where the window of a ray is empty g has a sign, but is
     * no number to draw lines through. */
    const L endless = (magnitude(f1) == HUGE_VAL) | (magnitude(f2) == HUGE_VAL);
    return either((least >= 0.5) | (width > within) | endless, half, t);
}

/* Prepares the next evaluation of brackets 0 .. n - 1. */
static void roots_step(Roots *r, uint32_t n) {
    for (uint32_t i = 0; i < n; i += LANES) {
        const D x1 = LOAD(D, r->x1 + i), x2 = LOAD(D, r->x2 + i), tol = LOAD(D, r->tol + i);
        const L left = LOAD(L, r->left + i);
        const D width = magnitude(x2 - x1);
        const D t = fraction(x1, x2, LOAD(D, r->x3 + i), LOAD(D, r->f1 + i), LOAD(D, r->f2 + i), LOAD(D, r->f3 + i),
                             tol, width, left);
        const D next = x1 + t * (x2 - x1);
        const L go = ~LOAD(L, r->exact + i) & ~(width <= tol) & (left != 0) & (next != x1) & (next != x2),
                rest = left + go;
        memcpy(r->next + i, &next, sizeof next), memcpy(r->go + i, &go, sizeof go);
        memcpy(r->left + i, &rest, sizeof rest);
    }
}

INLINE void take_root(Roots *r, uint32_t i, D g) {
    const D x1 = LOAD(D, r->x1 + i), x2 = LOAD(D, r->x2 + i), f1 = LOAD(D, r->f1 + i), f2 = LOAD(D, r->f2 + i);
    /* A g of NaN counts as positive, so that the bracket still shrinks. */
    const L zero = g == 0, same = ~((g < 0) ^ (f1 < 0)), older = same & ~zero, other = ~same & ~zero,
            exact = LOAD(L, r->exact + i) | zero;
    const D next = LOAD(D, r->next + i), at = either(zero, all(0), g);
    const D x3 = either(older, x1, either(other, x2, LOAD(D, r->x3 + i))),
            f3 = either(older, f1, either(other, f2, LOAD(D, r->f3 + i)));
    const D y2 = either(other, x1, x2), h2 = either(other, f1, f2);
    memcpy(r->x1 + i, &next, sizeof next), memcpy(r->f1 + i, &at, sizeof at);
    memcpy(r->x2 + i, &y2, sizeof y2), memcpy(r->f2 + i, &h2, sizeof h2);
    memcpy(r->x3 + i, &x3, sizeof x3), memcpy(r->f3 + i, &f3, sizeof f3);
    memcpy(r->exact + i, &exact, sizeof exact);
}

/* g at `next` of brackets 0 .. n - 1: doubles, or floats. */
static void roots_take(Roots *r, uint32_t n, const void *g, bool f64) {
    if (f64)
        for (uint32_t i = 0; i < n; i += LANES) take_root(r, i, LOAD(D, (const double *)g + i));
    else
        for (uint32_t i = 0; i < n; i += LANES)
            take_root(r, i, __builtin_convertvector(LOAD(F, (const float *)g + i), D));
}
