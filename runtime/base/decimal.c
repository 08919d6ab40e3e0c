/* Printing is Schubfach (R. Giulietti, "The Schubfach way to render doubles", 2020, with the round to odd of section
 * 9); reading is that of D. Lemire ("Number parsing at a gigabyte per second", 2021; that 128 bits of a power are
 * always enough is N. Mushtak and D. Lemire, "Fast number parsing without fallback", 2022). Both stand on one table,
 * the first 128 bits of powers of five, which is computed at first use: some ten thousand steps. */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* strtod_l, newlocale */
#endif
#include "runtime/base/decimal.h"

#include <locale.h>
#include <math.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

__extension__ typedef unsigned __int128 Wide;

enum { POWER_MIN = -342, POWER_MAX = 324, EXACT_MAX = 55, LIMBS = 32, MOST_DIGITS = 19 };

/* ---- powers of five */
typedef struct Power {
    uint64_t hi,
        lo; /* 5^e 2^s with the s that makes the highest bit of hi one: below where e > 55, above where e < 0 */
} Power;

static Power powers[POWER_MAX - POWER_MIN + 1];

static Power first_bits(const uint32_t limb[LIMBS]) {
    int n = LIMBS - 1;
    while (!limb[n]) n--;
    Wide v = 0;
    for (int i = n; i > n - 4; i--) v = v << 32 | (i < 0 ? 0 : limb[i]);
    int shift = __builtin_clz(limb[n]);
    v <<= shift;
    if (shift && n >= 4) v |= limb[n - 4] >> (32 - shift);
    return (Power){(uint64_t)(v >> 64), (uint64_t)v};
}

static void make_powers(void) {
    uint32_t limb[LIMBS] = {1};
    for (int e = 0; e <= POWER_MAX; e++) {
        powers[e - POWER_MIN] = first_bits(limb);
        uint64_t carry = 0;
        for (int i = 0; i < LIMBS; i++, carry >>= 32) {
            carry += 5 * (uint64_t)limb[i];
            limb[i] = (uint32_t)carry;
        }
    }
    memset(limb, 0, sizeof limb);
    limb[LIMBS - 1] = 1u << 31; /* 2^1023, of which 5^-342 leaves 229 bits */
    for (int e = -1; e >= POWER_MIN; e--) {
        uint64_t rest = 0;
        for (int i = LIMBS; i-- > 0; rest %= 5) {
            rest = rest << 32 | limb[i];
            limb[i] = (uint32_t)(rest / 5);
        }
        Power p = first_bits(limb);
        if (++p.lo == 0) p.hi++;
        powers[e - POWER_MIN] = p;
    }
}

static Power power(int e) {
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    pthread_once(&once, make_powers);
    return powers[e - POWER_MIN];
}

/* ---- printing */
static int floor_log2_of_10(int e) { return (e * 1741647) >> 19; }

/* x p / 2^128, its last bit set if anything is cut off. */
static uint64_t multiply_to_odd(Power p, uint64_t x) {
    uint64_t below = (uint64_t)((Wide)p.lo * x >> 64);
    Wide y = (Wide)p.hi * x + below;
    return (uint64_t)(y >> 64) | ((uint64_t)y > 1);
}

/* The decimal d 10^*k of c 2^q, c being at least 1; `closer`: the float below is half as far as the one above. */
static uint64_t shortest(uint64_t c, int q, bool closer, int *k) {
    if (q <= 0 && q > -64 && (c & ((UINT64_C(1) << -q) - 1)) == 0) return *k = 0, c >> -q;
    *k = (q * 1262611 - (closer ? 524031 : 0)) >> 22; /* of 2^q, or of 3/4 of it, the logarithm */
    int shift = q + floor_log2_of_10(-*k) + 1;
    Power p = power(-*k);
    if (-*k > EXACT_MAX && ++p.lo == 0) p.hi++; /* not below what it stands for */
    /* In quarters of 10^k: the number, and the ends of what rounds to it, which do so if c is even. */
    uint64_t odd = c & 1, at = multiply_to_odd(p, 4 * c << shift);
    uint64_t lo = multiply_to_odd(p, (4 * c - 2 + closer) << shift) + odd;
    uint64_t hi = multiply_to_odd(p, (4 * c + 2) << shift) - odd;
    uint64_t d = at / 4, tens = d / 10;
    if (d >= 10) {
        bool below = lo <= 40 * tens, above = 40 * tens + 40 <= hi;
        if (below != above) return ++*k, tens + above;
    }
    bool below = lo <= 4 * d, above = 4 * d + 4 <= hi;
    if (below != above) return d + above;
    return d + (at > 4 * d + 2 || (at == 4 * d + 2 && (d & 1)));
}

static char *put_pair(char *end, unsigned pair) {
    static const char pairs[] =
        "00010203040506070809101112131415161718192021222324252627282930313233343536373839404142434445464748"
        "49505152535455565758596061626364656667686970717273747576777879808182838485868788899091929394959697"
        "9899";
    return memcpy(end - 2, pairs + 2 * pair, 2);
}

/* The form of %.*g with so many digits, or with all that there are. */
static size_t layout(char *text, uint64_t d, int k, int precision) {
    enum { MOST = 20 }; /* digits: as many are copied, whatever their number, where a text has room for them */
    char buffer[24 + MOST], *end = buffer + sizeof buffer - MOST, *digit = end, *out = text;
    while (d % 10 == 0) d /= 10, k++;
    for (; d >= 100; d /= 100) digit = put_pair(digit, (unsigned)(d % 100));
    if (d >= 10) digit = put_pair(digit, (unsigned)d);
    else *--digit = (char)('0' + d);
    int n = (int)(end - digit), e = k + n - 1; /* the exponent of the first digit */
    if (e < -4 || e >= (n > precision ? n : precision)) {
        *out++ = *digit;
        if (n > 1) *out++ = '.';
        memcpy(out, digit + 1, MOST);
        out += n - 1;
        *out++ = 'e';
        *out++ = e < 0 ? '-' : '+';
        if (abs(e) >= 100) *out++ = (char)('0' + abs(e) / 100);
        put_pair(out + 2, (unsigned)(abs(e) % 100));
        out += 2;
    } else if (e < 0) {
        memcpy(out, "0.000", 5);
        out += 1 - e;
        memcpy(out, digit, MOST);
        out += n;
    } else {
        int whole = e + 1 < n ? e + 1 : n;
        memcpy(out, digit, (size_t)whole);
        memset(out + whole, '0', (size_t)(e + 1 - whole));
        out += e + 1;
        if (whole < n) *out++ = '.';
        memcpy(out, digit + whole, (size_t)(n - whole));
        out += n - whole;
    }
    return (size_t)(out - text);
}

static size_t print(char *text, bool negative, uint64_t c, int q, bool closer, int precision) {
    int k;
    if (negative) *text = '-';
    if (c == 0) return text[negative] = '0', 1u + negative;
    uint64_t d = shortest(c, q, closer, &k);
    return negative + layout(text + negative, d, k, precision);
}

size_t decimal_print(char text[DECIMAL_SIZE], double v) {
    uint64_t bits;
    memcpy(&bits, &v, sizeof bits);
    uint64_t fraction = bits & ((UINT64_C(1) << 52) - 1);
    int e = (int)(bits >> 52 & 0x7ff);
    uint64_t c = e ? fraction | UINT64_C(1) << 52 : fraction;
    return print(text, bits >> 63, c, (e ? e : 1) - 1075, fraction == 0 && e > 1, 15);
}

size_t decimal_print_f32(char text[DECIMAL_SIZE], float v) {
    uint32_t bits;
    memcpy(&bits, &v, sizeof bits);
    uint32_t fraction = bits & ((1u << 23) - 1);
    int e = (int)(bits >> 23 & 0xff);
    return print(text, bits >> 31, e ? fraction | 1u << 23 : fraction, (e ? e : 1) - 150, fraction == 0 && e > 1, 6);
}

/* ---- reading */
/* The double nearest to w 10^e, as bits; w has at most 19 digits. */
static uint64_t nearest(uint64_t w, int64_t e) {
    const uint64_t infinite = UINT64_C(0x7ff) << 52;
    if (w == 0 || e < POWER_MIN) return 0;
    if (e > 308) return infinite;
    int zeros = __builtin_clzll(w);
    Power p = power((int)e);
    w <<= zeros;
    Wide product = (Wide)w * p.hi;
    if ((product >> 64 & 0x1ff) == 0x1ff) product += (Wide)w * p.lo >> 64; /* else it cannot change what is kept */
    uint64_t hi = (uint64_t)(product >> 64), lo = (uint64_t)product;
    int top = (int)(hi >> 63), cut = top + 9; /* leaves 54 bits, the last of which rounds */
    uint64_t m = hi >> cut;
    int exponent = (int)((217706 * e) >> 16) + 63 + top - zeros + 1023;
    if (exponent <= 0) {
        if (exponent <= -63) return 0;
        m >>= 1 - exponent;
        return (m + (m & 1)) >> 1; /* where it rounds up to a normal number, that bit is its exponent */
    }
    /* In the middle between two doubles, which only few powers allow: to the even one. */
    if (lo <= 1 && e >= -4 && e <= 23 && (m & 3) == 1 && m << cut == hi) m--;
    m = (m + (m & 1)) >> 1;
    if (m >> 53) m >>= 1, exponent++;
    return exponent >= 0x7ff ? infinite : (uint64_t)exponent << 52 | (m & ((UINT64_C(1) << 52) - 1));
}

static double read_slowly(const char *text, const char **end) {
    char *after;
    locale_t plain = newlocale(LC_ALL_MASK, "C", (locale_t)0); /* allocates nothing */
    double v = plain ? strtod_l(text, &after, plain) : strtod(text, &after);
    if (plain) freelocale(plain);
    *end = after;
    return v;
}

static bool is_digit(char c) { return (unsigned char)(c - '0') < 10; }

typedef struct Digits {
    uint64_t w; /* the first 19 that count */
    int n;
    bool more; /* of those that do not fit some are not 0 */
} Digits;

/* How many of them did not fit. */
static int64_t take_digits(Digits *d, const char **at) {
    int64_t left = 0;
    const char *c = *at;
    for (; is_digit(*c); c++) {
        if (d->n >= MOST_DIGITS) {
            left++, d->more |= *c != '0';
            continue;
        }
        d->w = 10 * d->w + (uint64_t)(*c - '0');
        d->n += d->w != 0;
    }
    *at = c;
    return left;
}

double decimal_read(const char *text, const char **end) {
    const char *c = text;
    bool negative = *c == '-';
    if (negative || *c == '+') c++;
    Digits d = {0};
    const char *first = c;
    int64_t e = take_digits(&d, &c);
    int64_t count = c - first;
    if (*c == '.') {
        first = ++c;
        e += take_digits(&d, &c) - (c - first);
        count += c - first;
    }
    if (count == 0 || (*c | 32) == 'x') return read_slowly(text, end); /* hexadecimal, inf, nan, blanks, no number */
    if ((*c | 32) == 'e') {
        const char *power = c + 1;
        bool minus = *power == '-';
        if (minus || *power == '+') power++;
        if (is_digit(*power)) {
            int64_t stated = 0;
            for (c = power; is_digit(*c); c++)
                if (stated < INT64_C(1000000000000)) stated = 10 * stated + (*c - '0'); /* no text has so many zeros */
            e += minus ? -stated : stated;
        }
    }
    uint64_t bits = nearest(d.w, e);
    if (d.more && bits != nearest(d.w + 1, e)) return read_slowly(text, end);
    bits |= (uint64_t)negative << 63;
    double v;
    memcpy(&v, &bits, sizeof v);
    return *end = c, v;
}
