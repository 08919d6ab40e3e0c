#!/usr/bin/env python3
"""Fits the polynomials of compiler/pass/lower_math: prints compiler/pass/lower_math_poly.h.

Each fit is a weighted minimax fit (Remez exchange) of sum c_k x^p_k to a function on an interval, in 60 digits. Coefficients are
rounded to the working precision. The last column of each comment is the relative error of the rounded polynomial. Needs mpmath.

    python3 fit_polynomials.py > ../../compiler/pass/lower_math_poly.h
    python3 fit_polynomials.py logs                                         the tables of compiler/ir/logs.h
"""
import struct
import sys
from mpmath import (mp, mpf, sin, cos, tan, exp, log, asin, atan, sinh, tanh, erf, erfc, sqrt, pi, cbrt, matrix, lu_solve, ceil,
                    floor)

mp.dps = 60


def round32(v):
    return mpf(struct.unpack('f', struct.pack('f', float(v)))[0])


def round64(v):
    return mpf(float(v))


def solve(target, powers, weight, lo, hi, iterations=12):
    """Minimises max |weight * (sum c x^p - target)|; returns c. Points start as Chebyshev nodes."""
    # Divided by the lowest power, so that the basis never vanishes inside the interval (its error would not alternate there).
    p0, target0, weight0 = powers[0], target, weight
    target = lambda x: target0(x) / x ** p0
    weight = lambda x: weight0(x) * abs(x) ** p0
    powers = [p - p0 for p in powers]
    n = len(powers)
    grid_n = 40 * (n + 1)
    grid = [lo + (hi - lo) * (1 - cos(pi * k / grid_n)) / 2 for k in range(grid_n + 1)]
    values = [(x, target(x), weight(x)) for x in grid if x != 0 or p0 == 0]
    values = [v for v in values if v[2] != 0]
    table = [([x ** p for p in powers], t, w) for x, t, w in values]
    m = len(table)
    points = [min(m - 1, int(round(float((1 - cos(pi * k / n)) / 2) * (m - 1)))) for k in range(n + 1)]
    best = None
    for _ in range(iterations):
        a = matrix(n + 1, n + 1)
        b = matrix(n + 1, 1)
        for r, k in enumerate(points):
            row, t, w = table[k]
            for c in range(n):
                a[r, c] = row[c] * w
            a[r, n] = (-1) ** r
            b[r] = t * w
        sol = lu_solve(a, b)
        err = [w * (sum(sol[c] * row[c] for c in range(n)) - t) for row, t, w in table]
        top = max(abs(e) for e in err)
        if best is None or top < best[0]:
            best = (top, [sol[c] for c in range(n)])
        # extremes of alternating sign
        ext = []
        for k in range(m):
            left = err[k - 1] if k else 0
            right = err[k + 1] if k + 1 < m else 0
            if abs(err[k]) >= max(abs(left) if left * err[k] > 0 else 0, abs(right) if right * err[k] > 0 else 0):
                if ext and err[ext[-1]] * err[k] > 0:
                    if abs(err[k]) > abs(err[ext[-1]]):
                        ext[-1] = k
                else:
                    ext.append(k)
        while len(ext) > n + 1:
            ext.pop(0 if abs(err[ext[0]]) < abs(err[ext[-1]]) else -1)
        if len(ext) < n + 1 or ext == points:
            break
        points = ext
    return best[1]


def solve_through_zero(target, powers, weight, lo, hi):
    """The same for an interval around 0, where the error is forced to vanish and exchange stalls: Lawson's iteration, least squares
    with weights multiplied by the error until it is level."""
    n, m = len(powers), 24 * len(powers)
    grid = [(lo + hi) / 2 - (hi - lo) / 2 * cos(pi * (k + mpf(1) / 2) / m) for k in range(m)]
    rows = [[weight(x) * x ** p for p in powers] for x in grid]
    goal = [weight(x) * target(x) for x in grid]
    lawson = [mpf(1) / m] * m
    best = None
    for _ in range(60):
        a, b = matrix(n, n), matrix(n, 1)
        for row, t, w in zip(rows, goal, lawson):
            for r in range(n):
                b[r] += w * row[r] * t
                for c in range(r + 1):
                    a[r, c] += w * row[r] * row[c]
        for r in range(n):
            for c in range(r):
                a[c, r] = a[r, c]
        sol = lu_solve(a, b)
        err = [abs(sum(sol[c] * row[c] for c in range(n)) - t) for row, t in zip(rows, goal)]
        if best is None or max(err) < best[0]:
            best = (max(err), [sol[c] for c in range(n)])
        lawson = [w * e for w, e in zip(lawson, err)]
        total = sum(lawson)
        lawson = [w / total for w in lawson]
    return best[1]


def fit(name, f32, target, powers, weight, lo, hi):
    lo, hi = mpf(lo), mpf(hi)
    c = (solve_through_zero if lo < 0 and f32 else solve)(target, powers, weight, lo, hi)
    coefficients = [(round32 if f32 else round64)(v) for v in c]
    xs = [lo + (hi - lo) * k / 997 for k in range(998)]
    err = max(abs(weight(x) * (sum(c * x ** p for p, c in zip(powers, coefficients)) - target(x))) for x in xs if x != 0)
    print(f'/* {name}: powers {powers[0]}..{powers[-1]} on [{float(lo):.4g}, {float(hi):.4g}], error {float(err):.2g} */')
    print(f'static const double {name}[] = {{' + ', '.join(float(c).hex() for c in coefficients) + '};')
    sys.stdout.flush()


def relative(f):
    return lambda x: 1 / f(x) if f(x) != 0 else mpf(0)


LN2 = log(mpf(2))
R2 = sqrt(mpf(2))


def parts(name, value, bits, n):
    """Splits a constant: n - 1 parts of so many bits, then the rest."""
    out = []
    for k in range(n):
        if k + 1 < n and bits:
            e = int(floor(log(abs(value)) / LN2))
            scale = mpf(2) ** (bits - 1 - e)
            p = floor(value * scale) / scale
        else:
            p = round64(value)
        out.append(p)
        value -= p
    print(f'static const double {name}[] = {{' + ', '.join(float(p).hex() for p in out) + '};')


def odd(a, b):
    return list(range(a, b + 1, 2))


def all_fits(f32):
    s = '32' if f32 else '64'
    pick = lambda a, b: a if f32 else b
    fit('sin_half_' + s, f32, lambda x: sin(x) - x, odd(3, pick(9, 21)), relative(sin), 0, pi / 2)
    fit('sin_quarter_' + s, f32, lambda x: sin(x) - x, odd(3, pick(7, 15)), relative(sin), 0, pi / 4)
    fit('cos_quarter_' + s, f32, lambda x: cos(x) - 1 + x * x / 2, odd(4, pick(8, 16)), relative(cos), 0, pi / 4)
    fit('exp_' + s, f32, lambda x: exp(x) - 1, list(range(1, pick(6, 12))), lambda x: exp(-x), -LN2 / 2, LN2 / 2)
    fit('exp2_' + s, f32, lambda x: exp(x * LN2) - 1, list(range(1, pick(6, 12))), lambda x: exp(-x * LN2), -0.5, 0.5)
    if f32:
        fit('log_32', f32, lambda x: log(1 + x) - x, list(range(2, 10)), relative(lambda x: log(1 + x)), 1 / R2 - 1, R2 - 1)
        fit('log2_32', f32, lambda x: log(1 + x) / LN2, list(range(1, 10)), relative(lambda x: log(1 + x)), 1 / R2 - 1, R2 - 1)
    else:
        top = (R2 - 1) / (R2 + 1)
        fit('log_64', f32, lambda x: log((1 + x) / (1 - x)) - 2 * x, odd(3, 15), relative(lambda x: log((1 + x) / (1 - x))), 0, top)
    at = lambda x: log((1 + x) / (1 - x)) / LN2
    top = (R2 - 1) / (R2 + 1) * mpf('1.0001')
    c = pick(round32, round64)(2 / LN2)
    clo = 2 / LN2 - c
    if f32:
        fit('pow_32', f32, lambda x: at(x) - 2 / LN2 * x, odd(3, 7), relative(at), 0, top)
        fit('log_tail_32', f32, lambda x: log(1 + x) - x + x * x / 2, list(range(3, 7)), relative(lambda x: log(1 + x)),
            -mpf(1) / 16, mpf(1) / 16)
        fit('log_near_32', f32, lambda x: log(1 + x) - x, list(range(2, 7)), relative(lambda x: log(1 + x)), -mpf(1) / 16,
            mpf(1) / 16)
    else:
        fit('pow_64', f32, lambda x: at(x) - 2 / LN2 * x - 2 / LN2 / 3 * x ** 3, odd(5, 17), relative(at), 0, top)
    fit('asin_' + s, f32, lambda x: asin(x) - x, odd(3, pick(11, 27)), relative(asin), 0, 0.5)
    fit('atan_' + s, f32, lambda x: atan(x) - x, odd(3, pick(17, 27)), relative(atan), 0, pick(1, R2 - 1))
    fit('sinh_' + s, f32, lambda x: sinh(x) - x, odd(3, pick(9, 19)), relative(sinh), 0, 1)
    fit('tanh_' + s, f32, lambda x: tanh(x) - x, odd(3, pick(11, 25)), relative(tanh), 0, pick(0.625, 0.55))
    fit('erf_' + s, f32, erf, odd(1, pick(11, 27)), relative(erf), 0, pick(0.875, 1))
    fit('erfc_log2_' + s, f32, lambda x: log(erfc(x)) / LN2, list(range(0, pick(8, 23))), lambda x: erfc(x) / erf(x),
        pick(0.875, 1), pick(4, 6))
    fit('rcbrt_' + s, f32, lambda x: 1 / cbrt(x), list(range(0, pick(4, 6))), cbrt, 1, 2)


def log_tables():
    """-ln r and ln 2, as a multiple of 2^-17 and a float."""
    values = [-log(mpf(n) / 32) for n in (32, 29, 26, 24, 22, 20, 18, 17, 16)]
    high = [floor(v * 2 ** 17) / 2 ** 17 for v in values]
    for name, row in (('high', high), ('low', [round32(v - h) for v, h in zip(values, high)])):
        print(f'log_table_{name}: ' + ', '.join(float(v).hex() for v in row))


if sys.argv[1:] == ['logs']:
    log_tables()
    sys.exit()

print("""/* Coefficients of lower_math: printed by tests/ir/fit_polynomials.py, which says how they were found. Do not edit. */
#ifndef SALTUS_PASS_LOWER_MATH_POLY_H
#define SALTUS_PASS_LOWER_MATH_POLY_H
""")
print('/* pi and ln 2 in parts: for targets with fma full parts, without it parts short enough that multiples stay exact. */')
p32 = [round32(pi)]
p32.append(round32(pi - p32[0]))
p32.append(round32(pi - p32[0] - p32[1]))
print('static const double pi_fma_32[] = {' + ', '.join(float(p).hex() for p in p32) + '};')
parts('pi_fma_64', pi, 0, 3)
parts('pi_split_32', pi, 8, 5)
parts('pi_split_64', pi, 33, 4)
c = round32(1 / LN2)
print(f'static const double one_over_ln2_32[] = {{{float(c).hex()}, {float(round32(1 / LN2 - c)).hex()}}};')
l32 = [round32(LN2)]
l32.append(round32(LN2 - l32[0]))
print('static const double ln2_fma_32[] = {' + ', '.join(float(p).hex() for p in l32) + '};')
parts('ln2_fma_64', LN2, 0, 2)
parts('ln2_split_32', LN2, 15, 2)
parts('ln2_split_64', LN2, 40, 2)
for s, r in (('32', round32), ('64', round64)):
    c = r(2 / LN2)
    print(f'static const double two_over_ln2_{s}[] = {{{float(c).hex()}, {float(r(2 / LN2 - c)).hex()}}};')
    c = r(2 / LN2 / 3)
    print(f'static const double two_thirds_over_ln2_{s}[] = {{{float(c).hex()}, {float(r(2 / LN2 / 3 - c)).hex()}}};') if s == '64' else None
all_fits(True)
all_fits(False)
print("""
#endif""")
