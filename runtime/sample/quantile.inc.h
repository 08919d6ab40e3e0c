/* The quantile of the normal distribution, for numbers (grid.c) and for vectors of them (fill.inc.h): Wichura, The
 * percentage points of the normal distribution, Applied Statistics 37 (1988), algorithm AS 241, without its last range,
 * for which 4 standard deviations are too few. Nothing here but what IEEE rounds, so all give the same bits.
 *
 * Who includes it has the types D, of doubles, U and L, of as many unsigned and signed words; U bits_of(D) and
 * D with_bits(U), which take one for the other; D all(double), D root(D); and D either(L where, D a, D b). */
INLINE D horner8(D x, const double c[8]) {
    D sum = all(c[7]);
    for (int i = 6; i >= 0; i--) sum = sum * x + c[i];
    return sum;
}

/* log x of a normal number: x = 2^e m, m from sqrt(1/2) to sqrt(2), and log m = 2 atanh((m - 1) / (m + 1)). */
INLINE D natural_log(D x) {
    const uint64_t least = 0x3fe6a09e00000000u; /* sqrt(1/2), cut off */
    const U bits = bits_of(x) - least + (1024ull << 52);
    const D e = with_bits(bits >> 52 | 0x4330000000000000u) - (0x1p52 + 1024);
    const D m = with_bits((bits & 0x000fffffffffffffu) + least), s = (m - 1.0) / (m + 1.0), square = s * s;
    D sum = all(1.0 / 21);
    for (int k = 19; k >= 1; k -= 2) sum = sum * square + 1.0 / k;
    return e * 0.69314718055994530942 + 2.0 * s * sum;
}

/* In standard deviations, of p from 1e-11 to 1 - 1e-11. */
INLINE D normal_quantile(D p) {
    static const double a[8] = {3.3871328727963666080e0, 1.3314166789178437745e2, 1.9715909503065514427e3,
                                1.3731693765509461125e4, 4.5921953931549871457e4, 6.7265770927008700853e4,
                                3.3430575583588128105e4, 2.5090809287301226727e3},
                        b[8] = {1.0,
                                4.2313330701600911252e1,
                                6.8718700749205790830e2,
                                5.3941960214247511077e3,
                                2.1213794301586595867e4,
                                3.9307895800092710610e4,
                                2.8729085735721942674e4,
                                5.2264952788528545610e3},
                        c[8] = {1.42343711074968357734e0,  4.63033784615654529590e0, 5.76949722146069140550e0,
                                3.64784832476320460504e0,  1.27045825245236838258e0, 2.41780725177450611770e-1,
                                2.27238449892691845833e-2, 7.74545014278341407640e-4},
                        d[8] = {1.0,
                                2.05319162663775882187e0,
                                1.67638483018380384940e0,
                                6.89767334985100004550e-1,
                                1.48103976427480074590e-1,
                                1.51986665636164571966e-2,
                                5.47593808499534494600e-4,
                                1.05075007164441684324e-9};
    const D q = p - 0.5, near = 0.180625 - q * q, middle = q * horner8(near, a) / horner8(near, b);
    const L below = q < 0.0;
    const D far = root(-natural_log(either(below, p, 1.0 - p))) - 1.6, tail = horner8(far, c) / horner8(far, d);
    return either(near > 0.0, middle, either(below, -tail, tail));
}

/* A Gaussian of half a pixel, cut at 4 standard deviations: the place in pixels up to which it holds the part q. */
INLINE D gaussian_quantile(D q) {
    const double mass = 0.99993665751633376; /* erf(4 / sqrt 2) */
    return 0.5 * normal_quantile(0.5 + (q - 0.5) * mass);
}
