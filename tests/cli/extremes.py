#!/usr/bin/env python3
"""Stiff and extreme programs with known answers: what the command says of each, how far off it is, and what it reports.

    tests/cli/extremes.py build/bin/saltus                  remakes the tables of docs/extremes.md
    tests/cli/extremes.py build/bin/saltus --only cusp -v   prints rows instead

Every row is a program, its derivatives in closed form, and three estimators in two precisions. A run *holds* where each derivative
is finite and within four of the stated errors (or rounding: 2e-5 in f32, 1e-9 in f64), and is *silent* where one is not and no
warning says so. A `Kink` has two one-sided derivatives: the answer must lie between, its bar reach both, and `coincident` warn."""
import argparse
import json
import math
import os
import subprocess
import sys
import tempfile

WAYS = [(e, p) for p in ("f64", "f32") for e in ("auto", "lattice", "quadrature")]
ROUNDING = {"f64": 1e-9, "f32": 2e-5}
PAGE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "docs", "extremes.md")
PI = math.pi


class Kink:
    def __init__(self, below, above):
        self.below, self.above = min(below, above), max(below, above)


class Row:
    """known: what is silent and wrong all the same, by estimator and precision ("lattice", "f32", "auto f64"), and why."""

    def __init__(self, kind, name, source, want, f32=True, params=(), options=(), known=None):
        self.kind, self.name, self.source, self.want = kind, name, source, want
        self.precisions = ("f64", "f32") if f32 else ("f64",)
        self.params, self.options, self.known = params, list(options), known or {}

    def is_known(self, estimator, precision):
        return any(all(w in (estimator, precision) for w in ways.split()) for ways in self.known)

    def wants(self, precision):
        return self.want(precision) if callable(self.want) else self.want


def shader(params, body, domain="-1.0, 1.0", dim=2):
    """`params` as in the language, without `param float`; `body` changes f, from x."""
    head = "".join("param float %s; " % p for p in params.split(", ") if p)
    return "%s[Domain(%s)] shader float main(float%s x) { float f = 0.0; %s return f; }" % (head, domain, dim if dim > 1 else "", body)


def disc(g, params="r = 0.4", **kw):
    """1 where g < 0, with d = |x| - r to make it of."""
    return shader(params, "float d = length(x) - r; [Disc] if (%s) f = 1.0;" % g, **kw)


def rows():
    out = []
    add = lambda *a, **kw: out.append(Row(*a, **kw))
    circle = {"r": 0.8 * PI}

    # ---- The size of g and of its gradient
    k = "scale of g"
    for s in (1e-30, 1e-20, 1e-10, 1e10, 1e20, 1e30):
        add(k, "`S * d < 0`, S = %.0e" % s, disc("S * d < 0.0", "r = 0.4, S = %r" % s), circle)
    for s in (1e-300, 1e300):
        add(k, "`S * d < 0`, S = %.0e" % s, disc("S * d < 0.0", "r = 0.4, S = %r" % s), circle, f32=False)
    add(k, "`S * d < 0`, S = 1e-40 (a denormal in f32)", disc("S * d < 0.0", "r = 0.4, S = 1e-40"), circle)
    add(k, "`exp(130 x) d < 0`: over 45 orders along one circle", disc("exp(130.0 * x.x) * d < 0.0"), circle)
    add(k, "`S dot(x, x) < S r r`, S = 1e-30", disc("S * dot(x, x) < S * r * r", "r = 0.4, S = 1e-30"), circle)
    add(k, "`exp(200 d) < 1`", disc("exp(200.0 * d) < 1.0"), circle)

    # ---- No slope, or an infinite one, where g is 0
    k = "zero gradient on the zero set"
    add(k, "`d d d < 0`", disc("d * d * d < 0.0"), circle)
    add(k, "`pow5(d) < 0`, by products", disc("d * d * d * d * d < 0.0"), circle)
    add(k, "`d abs(d) < 0`", disc("d * abs(d) < 0.0"), circle)
    add(k, "`d d <= 0`: a set of no area", disc("d * d <= 0.0"), {"r": 0})
    add(k, "`d d > 0`: all but a set of no area", disc("d * d > 0.0"), {"r": 0})
    add(k, "`cbrt(d) < 0`: infinite slope", disc("cbrt(d) < 0.0"), circle)
    add(k, "`sign(d) sqrt(abs(d)) < 0`", disc("sign(d) * sqrt(abs(d)) < 0.0"), circle)
    add(k, "`tanh(1e4 d) < 0`", disc("tanh(1e4 * d) < 0.0"), circle)
    add(k, "`atan(1e8 d) < 0`", disc("atan(1e8 * d) < 0.0"), circle)
    add(k, "`exp(-1 / max(d, 0)) > 0`: flat of every order, until it is 0 as rounded", disc("exp(-1.0 / max(d, 1e-30)) > 0.0"),
        lambda p: {"r": -2 * PI * (0.4 + {"f64": 1 / 708.396, "f32": 1 / 87.3365}[p])})

    # ---- Flat on one side
    k = "flat on one side"
    add(k, "`max(d, 0) > 0`", disc("max(d, 0.0) > 0.0"), {"r": -0.8 * PI})
    add(k, "`(d > 0 ? d : 0) > 0`", disc("(d > 0.0 ? d : 0.0) > 0.0"), {"r": -0.8 * PI})
    add(k, "`saturate(d) > 0`", disc("saturate(d) > 0.0"), {"r": -0.8 * PI})
    add(k, "`max(d, 0) max(d, 0) > 0`", disc("max(d, 0.0) * max(d, 0.0) > 0.0"), {"r": -0.8 * PI})
    add(k, "`max(d, -1e-3) > -1e-3`", disc("max(d, -1e-3) > -1e-3"), {"r": -2 * PI * 0.399})
    add(k, "`abs(d) - d > 0`", disc("abs(d) - d > 0.0"), circle)
    add(k, "`smoothstep(-.1, .1, d) > 0`", disc("smoothstep(-0.1, 0.1, d) > 0.0"), {"r": -2 * PI * 0.3})
    add(k, "`length(max(abs(x) - r, 0)) <= 0`: a box", disc("length(max(abs(x) - r, 0.0)) <= 0.0"), {"r": 8 * 0.4})

    # ---- Boundaries that touch
    k = "tangent boundaries"
    two = "float d = length(x - float2(-%s, 0.0)) - r; float e = length(x - float2(%s, 0.0)) - q; "
    add(k, "two discs that touch from outside", shader("r = 0.4, q = 0.4", two % ("0.4", "0.4") + "[Disc] if (min(d, e) < 0.0) f = 1.0;"), {"r": 0.8 * PI, "q": 0.8 * PI})
    add(k, "the same by two comparisons", shader("r = 0.4, q = 0.4", two % ("0.4", "0.4") + "[Disc] if (d < 0.0) f = 1.0; [Disc] if (e < 0.0) f = 2.0;"), {"r": 0.8 * PI, "q": 1.6 * PI})
    add(k, "a disc that touches a larger one from inside", shader("r = 0.5, q = 0.2", two % ("0.0", "0.3") + "[Disc] if (d < 0.0) f = 1.0; [Disc] if (e < 0.0) f = 3.0;"), {"r": PI, "q": 0.8 * PI})
    add(k, "the same, hidden below it", shader("r = 0.5, q = 0.2", two % ("0.0", "0.3") + "[Disc] if (min(d, e) < 0.0) f = 1.0;"), {"r": PI, "q": 0})
    add(k, "a disc that touches the domain's border", shader("r = 0.4, c = 0.6", "[Disc] if (length(x - float2(c, 0.0)) < r) f = 1.0;"), {"r": 0.8 * PI, "c": 0})
    add(k, "a disc that touches all four sides", shader("r = 1.0", "[Disc] if (length(x) < r) f = 1.0;"), {"r": 2 * PI})
    add(k, "a line that touches a disc", shader("r = 0.4, a = 0.4", "[Disc] if (max(length(x) - r, x.x - a) < 0.0) f = 1.0;"), {"r": 0.8 * PI, "a": 0})
    add(k, "parabolas that touch to fourth order, unlike", shader("a = 0.0, b = 0.0", "float u = x.x * x.x; [Disc] bool p = x.y < u + a; [Disc] bool q = x.y < u + u * u + b; if (p != q) f = 1.0;",
        "float2(-1.0, -1.0), float2(1.0, 3.0)"), {"a": -2, "b": 2})
    add(k, "three discs through one point", shader("r = 0.4", "for (int i = 0; i < 3; i++) { [Disc] if (length(x - 0.4 * float2(cos(2.0943951 * float(i)), sin(2.0943951 * float(i)))) < r) f += 1.0; }"), {"r": 2.4 * PI})

    # ---- Boundaries that coincide
    k = "coincident boundaries"
    add(k, "one disc over another of its size", shader("r = 0.4, q = 0.4", "float d = length(x); [Disc] if (d < r) f = 1.0; [Disc] if (d < q) f = 3.0;"), {"r": Kink(0, 0.8 * PI), "q": Kink(2.4 * PI, 1.6 * PI)})
    add(k, "`d < r || d < q`", shader("r = 0.4, q = 0.4", "float d = length(x); [Disc] if (d < r || d < q) f = 1.0;"), {"r": Kink(0, 0.8 * PI), "q": Kink(0, 0.8 * PI)})
    add(k, "`max(d - r, d - q) < 0`", shader("r = 0.4, q = 0.4", "float d = length(x); [Disc] if (max(d - r, d - q) < 0.0) f = 1.0;"), {"r": Kink(0, 0.8 * PI), "q": Kink(0, 0.8 * PI)})
    add(k, "`d > r && d < q`: a band of no width", shader("r = 0.4, q = 0.4", "float d = length(x); [Disc] if (d > r && d < q) f = 1.0;"), {"r": Kink(-0.8 * PI, 0), "q": Kink(0, 0.8 * PI)})
    add(k, "jumps that cancel", shader("a = 0.1, b = 0.1", "[Disc] if (x.x < a) f += 1.0; [Disc] if (x.x > b) f += 1.0;"), {"a": 2, "b": -2})
    add(k, "one test asked twice", shader("r = 0.4", "float d = length(x); [Disc] if (d < r) f += 1.0; [Disc] if (d < r) f += 2.0;"), {"r": 2.4 * PI})
    add(k, "boxes that share a side", shader("a = 0.1, b = 0.1", "[Disc] if (x.x < a) f = 1.0; [Disc] if (x.x > b) f = 3.0;"), {"a": Kink(2, 0), "b": Kink(-6, -4)})
    add(k, "a half plane that ends on the domain's border", shader("a = 1.0", "[Disc] if (x.x < a) f = 1.0;"), {"a": Kink(2, 0)})
    add(k, "a box of the domain's size", shader("a = 1.0", "[Disc] if (max(abs(x.x), abs(x.y)) < a) f = 1.0;"), {"a": Kink(8, 0)})

    # ---- Points where a curve is none
    k = "cusps and crossings"
    add(k, "`y y < (x - a)^3`", shader("a = 0.1", "float u = x.x - a; [Disc] if (x.y * x.y < u * u * u) f = 1.0;"), {"a": -2 * 0.9 ** 1.5})
    add(k, "`abs(y) < (x - a)^4`, x > a: a needle", shader("a = 0.1", "float u = max(x.x - a, 0.0); [Disc] if (abs(x.y) < u * u * u * u) f = 1.0;"), {"a": -2 * 0.9 ** 4})
    add(k, "astroid, by roots", shader("s = 0.6", "[Disc] if (pow(abs(x.x), 0.66666667) + pow(abs(x.y), 0.66666667) < pow(s, 0.66666667)) f = 1.0;"), {"s": 0.75 * PI * 0.6})
    add(k, "cardioid", shader("s = 0.3", "float q = dot(x, x) - s * x.x; [Disc] if (q * q < s * s * dot(x, x)) f = 1.0;"), {"s": 3 * PI * 0.3})
    add(k, "`abs(x - a) < abs(y)`: two wedges", shader("a = 0.1", "[Disc] if (abs(x.x - a) < abs(x.y)) f = 1.0;"), {"a": -0.2})
    add(k, "`(x - a) y < 0`: two lines that cross", shader("a = 0.1", "[Disc] if ((x.x - a) * x.y < 0.0) f = 1.0;"), {"a": 0})
    add(k, "`x y < c`, c = 0: an infinite derivative", shader("c = 0.0", "[Disc] if (x.x * x.y < c) f = 1.0;"), {"c": math.inf})
    add(k, "`x y < c`, c = 1e-6", shader("c = 1e-6", "[Disc] if (x.x * x.y < c) f = 1.0;"), {"c": -2 * math.log(1e-6)})
    add(k, "lemniscate through its node", shader("s = 0.7", "float u = dot(x, x); [Disc] if (u * u < s * s * (x.x * x.x - x.y * x.y)) f = 1.0;"), {"s": 2 * 0.7})

    # ---- What is small
    k = "features of 1e-6"
    add(k, "ring of width w, `abs(d) < w / 2`", disc("abs(d) < 0.5 * w", "r = 0.4, w = 1e-6"), {"w": 0.8 * PI, "r": 2e-6 * PI})
    add(k, "ring of width w, `d > 0 && d < w`", disc("d > 0.0 && d < w", "r = 0.4, w = 1e-6"), {"w": 2 * PI * (0.4 + 1e-6), "r": 2e-6 * PI})
    add(k, "disc of radius 1e-6", shader("r = 1e-6, a = 0.1234", "[Disc] if (length(x - float2(a, 0.3)) < r) f = 1.0;"), {"r": 2e-6 * PI, "a": 0})
    add(k, "slit between half planes", shader("a = 0.1, w = 1e-6", "f = 1.0; [Disc] if (x.x > a && x.x < a + w) f = 0.0;"), {"a": 0, "w": -2})
    add(k, "slanted band of width w", shader("w = 1e-6", "[Disc] if (abs(x.x + 0.3 * x.y - 0.1) < w) f = 1.0;"), {"w": 4})
    add(k, "wedge `abs(y) < w x`", shader("w = 1e-6", "[Disc] if (abs(x.y) < w * x.x) f = 1.0;"), {"w": 1})
    add(k, "1000 teeth of 1e-6", shader("w = 1e-3", "[Disc] float u = frac(500.0 * x.x + 0.25); [Disc] if (u < w) f = 1.0;"), {"w": 4})
    add(k, "hole of 1e-6 in a disc", shader("r = 0.4, q = 1e-6", "float d = length(x); [Disc] if (d < r) f = 1.0; [Disc] if (d < q) f = 0.0;"), {"r": 0.8 * PI, "q": -2e-6 * PI})
    add(k, "ellipse of 0.5 by 1e-6", shader("a = 0.5, b = 1e-6", "[Disc] if (length(float2(x.x / a, (x.y - 0.1) / b)) < 1.0) f = 1.0;"), {"a": PI * 1e-6, "b": PI * 0.5})
    add(k, "ellipse of 0.3 by 1e-5", shader("a = 0.3, b = 1e-5", "[Disc] if (length(float2(x.x / a, (x.y - 0.1) / b)) < 1.0) f = 1.0;"), {"a": PI * 1e-5, "b": PI * 0.3})
    add(k, "the same, turned", shader("a = 0.3, b = 1e-5", "float2 u = float2(0.8 * x.x + 0.6 * x.y, 0.8 * x.y - 0.6 * x.x) - 0.1; [Disc] if (length(float2(u.x / a, u.y / b)) < 1.0) f = 1.0;"), {"a": PI * 1e-5, "b": PI * 0.3})
    add(k, "ellipse of 1e-3 by 1e-6", shader("a = 1e-3, b = 1e-6", "[Disc] if (length(float2((x.x - 0.1) / a, (x.y - 0.3) / b)) < 1.0) f = 1.0;"), {"a": PI * 1e-6, "b": PI * 1e-3})

    # ---- Long loops
    k = "10^5 iterations"
    relax = 0.4 * (1 - (1 - 1e-4) ** 100000)
    add(k, "a radius that 10^5 steps approach", shader("r = 0.4", "float s = 0.0; for (int i = 0; i < 100000; i++) s = s + 1e-4 * (r - s); [Disc] if (length(x) < s) f = 1.0;"),
        {"r": 2 * PI * relax * relax / 0.4}, options=["--samples", "4096"])
    add(k, "a point turned 10^5 times, then asked", shader("r = 0.4", "float2 p = x - float2(0.2, 0.1); for (int i = 0; i < 100000; i++) p = float2(p.x - 1e-5 * p.y, p.y + 1e-5 * (p.x - 1e-5 * p.y)); [Disc] if (length(p) < r) f = 1.0;"),
        {"r": 0.8 * PI}, options=["--samples", "1024"])
    add(k, "a sum of 10^5 terms inside", shader("a = 0.5", "for (int i = 0; i < 100000; i++) f += 1e-5 * a * x.x * x.x;"), {"a": 4 / 3}, options=["--samples", "1024"])
    stiff = [0.0, 0.0]
    for i in range(1000):
        stiff = [stiff[0] + 0.9 * (0.4 * math.cos(1e-3 * i) - stiff[0]), stiff[1] + 0.9 * (math.cos(1e-3 * i) - stiff[1])]
    add(k, "a stiff equation in 1000 steps", shader("r = 0.4", "float s = 0.0; for (int i = 0; i < 1000; i++) s = s + 0.9 * (r * cos(1e-3 * float(i)) - s); [Disc] if (length(x) < s) f = 1.0;"),
        {"r": 2 * PI * stiff[0] * stiff[1]}, options=["--samples", "65536"])

    # ---- Interiors that rise within less than a sample
    k = "exp-stiff interiors"
    add(k, "`exp(-k (x - c)^2)`, k = 1e8", shader("c = 0.1, k = 1e8", "f = exp(-k * (x.x - c) * (x.x - c));"), {"c": 0})
    add(k, "`exp(a x)`, a = 80", shader("a = 80.0", "f = exp(a * x.x);"), {"a": 2 * (math.exp(80) * (1 / 80 - 1 / 6400) + math.exp(-80) * (1 / 80 + 1 / 6400))})
    add(k, "`1 / (1 + exp(-k (x - c)))`, k = 1e6", shader("c = 0.1", "f = 1.0 / (1.0 + exp(-1e6 * (x.x - c)));"), {"c": -2})
    add(k, "`tanh(1e6 d)`", shader("r = 0.4", "f = tanh(1e6 * (r - length(x)));"), {"r": 1.6 * PI})
    add(k, "`exp(-1e6 d d)`: a soft ring", shader("r = 0.4", "float d = length(x) - r; f = exp(-1e6 * d * d);"), {"r": 2 * PI * math.sqrt(PI * 1e-6)})
    add(k, "`exp(100 (d - 1))` inside a disc", shader("r = 0.8", "float d = length(x); [Disc] if (d < r) f = exp(100.0 * (d - r));"),
        {"r": 2 * PI * (1 / 100 - math.exp(-80) / 100)})

    # ---- Digits that are gone before g is compared
    k = "cancellation"
    add(k, "`1e6 + d < 1e6`", disc("1e6 + d < 1e6"), circle)
    add(k, "`1e4 + d < 1e4`", disc("1e4 + d < 1e4"), circle)
    add(k, "`sqrt(1 + 1e-4 d) < 1`", disc("sqrt(1.0 + 1e-4 * d) < 1.0"), circle)
    add(k, "`cos(1e-3 |x|) > cos(1e-3 r)`", disc("cos(1e-3 * length(x)) > cos(1e-3 * r)"), circle, known={"quadrature f32": "g has eight values in all of the domain, and of the bound of its rounding a quarter is stated"})
    add(k, "`(|x| + 1e4)^2 < (r + 1e4)^2`", disc("(length(x) + 1e4) * (length(x) + 1e4) < (r + 1e4) * (r + 1e4)"), circle)
    add(k, "`(|x|^2 - r^2)^3`, multiplied out", disc("u * u * u - 3.0 * u * u * s + 3.0 * u * s * s - s * s * s < 0.0".replace("u", "dot(x, x)").replace("s", "(r * r)")), circle)
    add(k, "shading `1e7 + x - 1e7`", shader("r = 0.4", "[Disc] if (length(x) < r) f = (1e7 + 100.0 * x.x) - 1e7;"), {"r": 0})

    # ---- Denormals
    k = "denormals"
    for s in (1e-38, 1e-42, 1e-44):
        add(k, "a jump of %.0e" % s, shader("r = 0.4", "[Disc] if (length(x) < r) f = %r;" % s), {"r": 0.8 * PI * s})
    add(k, "a jump of 1e-310", shader("r = 0.4, j = 1e-310", "[Disc] if (length(x) < r) f = j;"), {"r": 0.8 * PI * 1e-310, "j": 0.16 * PI}, f32=False)
    add(k, "a disc of radius 1e-40", shader("r = 1e-40", "[Disc] if (length(x) < r) f = 1.0;"), {"r": 2e-40 * PI})
    for s in (1e-20, 1e-12):
        add(k, "a disc of radius %.0e" % s, shader("r = %r" % s, "[Disc] if (length(x - float2(0.1, 0.3)) < r) f = 1.0;"), {"r": 2 * PI * s})
    add(k, "a disc of 1e-12 by `dot(x, x) < r r`", shader("r = 1e-12", "[Disc] if (dot(x, x) < r * r) f = 1.0;"), {"r": 2e-12 * PI})
    add(k, "two specks of 1e-9", shader("r = 1e-9, q = 1e-9", "[Disc] if (min(length(x - 0.1) - r, length(x + 0.3) - q) < 0.0) f = 1.0;"), {"r": 2e-9 * PI, "q": 2e-9 * PI})
    add(k, "two specks of 1e-9, by two comparisons", shader("r = 1e-9, q = 1e-9", "[Disc] if (length(x - 0.1) < r) f += 1.0; [Disc] if (length(x + 0.3) < q) f += 1.0;"), {"r": 2e-9 * PI, "q": 2e-9 * PI})
    add(k, "twenty specks of 1e-9", shader("r = 1e-9", "for (int i = 0; i < 20; i++) { [Disc] if (length(x - float2(0.09 * float(i) - 0.87, sin(float(i)))) < r) f += 1.0; }"), {"r": 40e-9 * PI})
    add(k, "a ball of 1e-9", shader("r = 1e-9", "[Disc] if (length(x - 0.1) < r) f = 1.0;", dim=3), {"r": 4e-18 * PI})
    add(k, "a stretch of 1e-9", shader("r = 1e-9", "[Disc] if (abs(x - 0.1) < r) f = 1.0;", dim=1), {"r": 2})
    add(k, "a stretch of 1e-40", shader("r = 1e-40", "[Disc] if (abs(x) < r) f = 1.0;", dim=1), {"r": 2})
    add(k, "a domain of 1e-40", shader("a = 4e-41", "[Disc] if (x.x < a) f = 1.0;", "0.0, 1e-40"), {"a": 1e-40})
    add(k, "`1e-40 x + 1e-40 y < 1e-40 a`", shader("a = 0.1", "[Disc] if (1e-40 * x.x + 1e-40 * x.y < 1e-40 * a) f = 1.0;"), {"a": 1.9})

    # ---- Infinities and NaN
    k = "infinities and NaN"
    add(k, "NaN that is thrown away: `x > a ? sqrt(x - a) : 0`", shader("a = 0.1", "[Disc] if (x.x > a) f = sqrt(x.x - a);"), {"a": -2 * math.sqrt(0.9)})
    add(k, "NaN in an area: `sqrt(x - a)`", shader("a = 0.1", "f = sqrt(x.x - a);"), {"a": math.nan})
    add(k, "g is NaN beyond its edge: `log(x - a) < -1`", shader("a = 0.1", "[Disc] if (log(x.x - a) < -1.0) f = 1.0;"), {"a": 0})
    add(k, "g is infinite on one side: `1 / (x - a) > 2`", shader("a = 0.1", "[Disc] if (1.0 / (x.x - a) > 2.0) f = 1.0;"), {"a": 0})
    add(k, "g is infinite on one side: `log(x) < log(a)`", shader("a = 0.3", "[Disc] if (log(max(x.x, 0.0)) < log(a)) f = 1.0;"), {"a": 2})
    add(k, "`log(abs(x - c))`: a principal value", shader("c = 0.1", "f = log(abs(x.x - c));"), {"c": 2 * math.log(1.1 / 0.9)})
    add(k, "`1 / sqrt(x - a)` beside its edge", shader("a = 0.1", "[Disc] if (x.x > a) f = 1.0 / sqrt(x.x - a);"), {"a": -2 / math.sqrt(0.9)})
    add(k, "an infinite jump", shader("r = 0.4", "[Disc] if (length(x) < r) f = 1.0 / 0.0;"), {"r": math.inf})
    add(k, "a NaN inside", shader("r = 0.4", "[Disc] if (length(x) < r) f = 0.0 / 0.0;"), {"r": math.nan})
    add(k, "a radius that is NaN", shader("r = 0.4", "[Disc] if (length(x) < r) f = 1.0;"), {"r": 0}, params=["r=nan"])
    add(k, "a radius that is infinite", shader("r = 0.4", "[Disc] if (length(x) < r) f = 1.0;"), {"r": 0}, params=["r=inf"])
    add(k, "a colour that is infinite", shader("r = 0.4, j = 1.0", "[Disc] if (length(x) < r) f = j;"), {"r": math.inf, "j": 0.16 * PI}, params=["j=inf"])
    add(k, "`exp(200 x)`, overflows in f32", shader("a = 200.0", "f = exp(a * x.x);"), lambda p: {"a": math.inf if p == "f32" else 2 * (math.exp(200) * (1 / 200 - 1 / 40000))})

    # ---- Shapes that vanish or leave the domain
    k = "shapes that vanish or leave"
    at = lambda r, c: shader("r = %r, c = %r" % (r, c), "[Disc] if (length(x - float2(c, 0.0)) < r) f = 1.0;")
    add(k, "radius 0", at(0.0, 0.1), {"r": 0, "c": 0})
    add(k, "radius -0.4", at(-0.4, 0.1), {"r": 0, "c": 0})
    add(k, "outside the domain", at(0.4, 5.0), {"r": 0, "c": 0})
    add(k, "larger than the domain", at(10.0, 0.1), {"r": 0, "c": 0})
    add(k, "half outside", at(0.4, 1.0), {"r": 0.4 * PI, "c": -0.8})
    add(k, "1e-3 of it inside", at(0.4, 1.399), {"r": 0.8 * math.acos(0.399 / 0.4), "c": -2 * math.sqrt(0.4 ** 2 - 0.399 ** 2)})
    add(k, "1e-6 of it inside", at(0.4, 1.399999), lambda p: cap(0.4, 1.399999, p))
    add(k, "touches from outside", at(0.4, 1.4), {"r": 0, "c": 0})
    add(k, "its circle goes through the domain's corners", at(math.sqrt(2.0), 0.0), {"r": 0, "c": 0})
    add(k, "a box of no height", shader("h = 0.0", "[Disc] if (max(abs(x.x) - 0.5, abs(x.y) - h) < 0.0) f = 1.0;"), {"h": Kink(0, 2)})

    # ---- Domains
    k = "domains"
    far = lambda o, side=2.0, r=0.4: shader("r = %r" % (r * side / 2), "[Disc] if (length(x - %r) < r) f = 1.0;" % (o + side / 2), "%r, %r" % (o, o + side))
    for o in (1e3, 1e5, 1e6, 1e7):
        add(k, "%.0e from the origin" % o, far(o), circle)
    for o in (1e9, 1e12, 1e15):
        add(k, "%.0e from the origin" % o, far(o), circle, f32=False)
    for s in (1e-30, 1e-25, 1e-22, 1e-20, 1e-19, 1e-15, 1e15, 1e18, 1e19, 1e20, 1e25, 1e30):
        add(k, "sides of %.0e" % s, far(-s / 2, s), {"r": 0.4 * PI * s})
    by_squares = lambda s: shader("r = %r" % (0.2 * s), "[Disc] if (dot(x, x) < r * r) f = 1.0;", "%r, %r" % (-s / 2, s / 2))
    for s in (1e-30, 1e-20, 1e20, 1e30):
        add(k, "sides of %.0e, `dot(x, x) < r r`" % s, by_squares(s), {"r": 0.4 * PI * s})
    for s in (1e-25, 1e25):
        add(k, "lengths times %.0e" % s, shader("r = %r" % (0.4 * s), "[Disc] if (length(%r * x) < r) f = 1.0;" % s), {"r": 0.8 * PI / s})
        add(k, "sides of %.0e, a line" % s, shader("a = %r" % (0.2 * s), "[Disc] if (x.x < a) f = 1.0;", "%r, %r" % (-s / 2, s / 2)), {"a": s})
        add(k, "sides of %.0e, 3D" % s, shader("r = %r" % (0.2 * s), "[Disc] if (length(x) < r) f = 1.0;", "%r, %r" % (-s / 2, s / 2), 3), {"r": 4 * PI * (0.2 * s) ** 2}, options=["--samples", "16384"], f32=s < 1)
    add(k, "a centre of 1e30", shader("r = 0.4, c = 1e30", "[Disc] if (length(x - c) < r) f = 1.0;"), {"r": 0, "c": 0})
    add(k, "a radius of 1e30", shader("r = 1e30", "[Disc] if (length(x) < r) f = 1.0;"), {"r": 0})
    add(k, "a radius of 1e30, by squares", shader("r = 1e30", "[Disc] if (dot(x, x) < r * r) f = 1.0;"), {"r": 0})
    add(k, "1e20 from the origin, sides of 1e19", far(1e20, 1e19), {"r": 0.4 * PI * 1e19})
    add(k, "`tan(1.5707 x) < a`, a = 1e4", shader("a = 1e4", "[Disc] if (tan(1.5707 * x.x) < a) f = 1.0;"), {"a": 2 / 1.5707 / (1 + 1e8)})
    add(k, "`exp(180 x) < exp(180 a)`", shader("a = 0.3", "[Disc] if (exp(180.0 * x.x) < exp(180.0 * a)) f = 1.0;"), {"a": 2})
    add(k, "`exp(180 x) exp(180 y) < a`", shader("a = 1e30", "[Disc] if (exp(180.0 * x.x) * exp(180.0 * x.y) < a) f = 1.0;"), {"a": (2 - math.log(1e30) / 180) / 180e30})
    add(k, "1e6 by 1e-6", shader("a = 0.3", "[Disc] if (x.x * 1e-6 + x.y * 1e6 < a) f = 1.0;", "float2(0.0, 0.0), float2(1e6, 1e-6)"), {"a": 0.3})
    add(k, "a line of 1e-6", shader("a = 3e-7", "[Disc] if (x < a) f = 1.0;", "0.0, 1e-6", 1), {"a": 1})
    return out


def cap(r, c, precision):
    """What is left of a disc at c on the left of x = 1, with r and c as rounded."""
    if precision == "f32":
        import struct
        r, c = (struct.unpack("f", struct.pack("f", v))[0] for v in (r, c))
    return {"r": 2 * r * math.acos((c - 1) / r), "c": -2 * math.sqrt(r * r - (c - 1) ** 2)}


# ---- running a row
class Answer:
    """Of one run: its derivatives with their bars, the codes of what was said, and what to think of it."""

    def __init__(self, row, precision, code, out, err):
        self.said, self.row, self.code = set(), row, code
        for line in err.splitlines():
            try:
                self.said.add(str(json.loads(line).get("code")))
            except ValueError:
                self.said.add("text")
        self.off = self.bar = self.z = math.nan
        try:
            j = json.loads(out)
        except ValueError:
            self.verdict = "refused" if code not in (0, 70) and code > 0 and self.said else "failed"
            return
        if not isinstance(j.get("gradient"), dict):
            self.verdict = "refused"
            return
        self.said |= {w["code"] for w in j["warnings"]}
        self.json = j
        number = lambda v: math.nan if v is None else float(v)
        want = row.wants(precision)
        middle = {n: 0.5 * (v.below + v.above) if isinstance(v, Kink) else v for n, v in want.items()}
        finite = [abs(v) for v in middle.values() if math.isfinite(v)]
        size = max(finite, default=0) or 1
        kink, off, bar, held = False, 0, 0, True
        for name, w in want.items():
            got, stated = number(j["gradient"][name]), number(j["stderr"][name])
            if not math.isfinite(middle[name]):
                # Nothing finite is right: a bar that is no number, or as large as the answer, says so.
                fine = not math.isfinite(got) or not math.isfinite(stated) or stated >= 0.1 * abs(got)
                held, off, bar = held and fine, math.inf if fine else off, max(bar, stated / max(abs(got), 1e-300) if math.isfinite(got) else math.inf)
                continue
            o, b = abs(got - middle[name]) / size, stated / size
            if isinstance(w, Kink):
                kink = True
                o = max(0, w.below - got, got - w.above) / size
                held = held and (2 * b >= (w.above - w.below) / size / 2 * 0.9)
            held = held and (o <= 4 * b + ROUNDING[precision])
            off, bar = max(off, o), max(bar, b) if b == b else math.inf
        if kink:
            held = held and "coincident" in self.said
        self.off, self.bar = off, bar
        self.verdict = "holds" if held and (bar < 0.1 or kink) else "wide" if held else "warned" if self.said - {"text"} else "silent"


def run(saltus, folder, row, estimator, precision, samples="65536", env=None):
    path = os.path.join(folder, "s.salt")
    with open(path, "w") as f:
        f.write(row.source)
    options = list(row.options)
    if "--samples" not in options:
        options += ["--samples", samples]
    for p in row.params:
        options += ["--param", p]
    line = [saltus, "grad", path, "--integral", "--json", "--wrt", ",".join(row.wants(precision)), "--estimator", estimator, "--precision", precision, *options]
    r = subprocess.run(line, capture_output=True, text=True, timeout=1200, env=env)
    return Answer(row, precision, r.returncode, r.stdout, r.stderr)


# ---- the page
def number(v):
    if not math.isfinite(v) or v >= 1e30:
        return "∞" if v == v else "?"
    if v == 0:
        return "0"
    text = "%.1g" % v if v < 1e4 else "%.0e" % v
    return text.replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")


def cell(t):
    if t is None:
        return ""
    if t.verdict in ("refused", "failed"):
        return t.verdict
    text = "%s ± %s" % (number(t.off), number(t.bar))
    return {"warned": text + " †", "silent": "**" + text + "** ‡"}.get(t.verdict, text)


def title(row):
    """A bar would end the cell, in code too."""
    return row.name.replace("|", "\\|")


def table(answers):
    lines = ["| | " + " | ".join("%s %s" % (p, e) for e, p in WAYS) + " | said |", "|---|" + "---|" * (len(WAYS) + 1)]
    for row, found in answers:
        said = set().union(*(t.said for t in found.values())) - {"text"}
        lines.append("| %s | %s | %s |" % (title(row), " | ".join(cell(found.get(w)) for w in WAYS), ", ".join("`%s`" % c for c in sorted(said))))
    return lines


def remake(page, answers):
    """The tables between `<!-- rows: KIND -->` and the next empty line, and the list of what is silent and wrong."""
    with open(page) as f:
        text = f.read()
    blocks = {}
    for row, found in answers:
        blocks.setdefault("rows: " + row.kind, []).append((row, found))
    blocks = {k: table(v) for k, v in blocks.items()}
    count = {}
    for _, found in answers:
        for t in found.values():
            count[t.verdict] = count.get(t.verdict, 0) + 1
    blocks["counts"] = ["%d runs of %d programs: %s." % (sum(count.values()), len(answers), ", ".join("%d %s" % (count[v], v) for v in ("holds", "wide", "warned", "silent", "refused", "failed") if v in count))]
    blocks["known"] = ["- %s, %s (%s): %s" % (row.kind, row.name, ways or "all", why) for row, _ in answers for ways, why in row.known.items()] or ["None of the runs above."]
    for key, lines in blocks.items():
        mark = "<!-- %s -->\n" % key
        before, _, after = text.partition(mark)
        assert after, "docs/extremes.md has no " + mark
        text = before + mark + "\n".join(lines) + "\n\n" + after[after.index("\n\n") + 2:] if "\n\n" in after else before + mark + "\n".join(lines) + "\n"
    with open(page, "w") as f:
        f.write(text)


def main():
    a = argparse.ArgumentParser()
    a.add_argument("saltus"), a.add_argument("--only", default=""), a.add_argument("-v", action="store_true")
    a = a.parse_args()
    answers = []
    with tempfile.TemporaryDirectory() as folder:
        for row in rows():
            if a.only not in row.kind + ": " + row.name:
                continue
            found = {(e, p): run(a.saltus, folder, row, e, p) for e, p in WAYS if p in row.precisions}
            answers.append((row, found))
            for (e, p), t in found.items():
                if a.v or t.verdict in ("silent", "failed") and not row.is_known(e, p):
                    print("%s: %s: %s %s: %s, %.2g +- %.2g %s" % (row.kind, row.name, e, p, t.verdict, t.off, t.bar, ",".join(sorted(t.said))), flush=True)
    if not a.only:
        remake(PAGE, answers)


if __name__ == "__main__":
    main()
