"""Boundaries that are one at these parameters, of which the program asks the second where the first has decided one way: the
integral has one derivative to each side. What is printed lies halfway between, the error covers both, and there is a warning;
beside such parameters there is none. Integrals are known: of what is decided between sorted radii."""
import math

from harness import *

# The statements, and what they make of d, a and b.
FORMS = {
    "or": ("[Disc] if (d < a || d < b) f = 1.0;", lambda d, a, b: d < a or d < b),
    "and": ("[Disc] if (d < a && d < b) f = 1.0;", lambda d, a, b: d < a and d < b),
    "not both": ("[Disc] bool p = d > a; [Disc] bool q = d > b; if (!(p && q)) f = 1.0;", lambda d, a, b: not (d > a and d > b)),
    "band": ("[Disc] if (d > a && d < b) f = 1.0;", lambda d, a, b: a < d < b),
    "band, sums": ("[Disc] if (d - a > 0.0 && a - b + d < a) f = 1.0;", lambda d, a, b: a < d < b),
    "unlike": ("[Disc] bool p = d < a; [Disc] bool q = b > d; if (p != q) f = 1.0;", lambda d, a, b: (d < a) != (d < b)),
    "else if": ("[Disc] if (d < a) f = 1.0; else [Disc] if (d < b) f = 3.0;", lambda d, a, b: 1 if d < a else 3 if d < b else 0),
    "choices": ("[Disc] f = d < a ? 1.0 : d < b ? 3.0 : 0.0;", lambda d, a, b: 1 if d < a else 3 if d < b else 0),
    "returns": ("[Disc] if (d > b) return 0.0; [Disc] if (2.0 * d > 2.0 * a) return 3.0; return 1.0;", lambda d, a, b: 0 if d > b else 3 if d > a else 1),
    "painted": ("[Disc] if (d < a) f = 1.0; [Disc] if (d < b) f = 1.0;", lambda d, a, b: d < a or d < b),
    "cancel": ("[Disc] if (d < a) f += 1.0; [Disc] if (d < b) f -= 1.0;", lambda d, a, b: (d < a) - (d < b)),
    "add up": ("[Disc] if (d < a) f += 1.0; [Disc] if (d < b) f += 2.0;", lambda d, a, b: (d < a) + 2 * (d < b)),
}
# d, and the measure of d < r.
SHAPES = {
    "line": (1, "x", lambda r: 1 + r),
    "edge": (2, "x.x + 0.3 * x.y", lambda r: 2 + 2 * r),
    "disc": (2, "length(x)", lambda r: math.pi * r * r),
    "ball": (3, "length(x)", lambda r: 4 / 3 * math.pi * r ** 3),
}
WAYS = [(e, p) for p in ("f64", "f32") for e in ("quadrature", "lattice", "auto")]
AT = 0.45


def integral(f, measure, a, b):
    total, before = 0, None
    for r in sorted((a, b)):
        total += f(r - 1e-9 if before is None else (r + before) / 2, a, b) * (measure(r) - (0 if before is None else measure(before)))
        before = r
    return total + f(before + 1e-9, a, b) * 0


def sides(f, measure, at, which, h=1e-5):
    """The derivatives to both sides."""
    def value(step):
        return integral(f, measure, at[0] + step * (which == 0), at[1] + step * (which == 1))
    return (value(0) - value(-h)) / h, (value(h) - value(0)) / h


def source(form, shape, a, b):
    dim, d, measure = SHAPES[shape]
    return "param float a = %r; param float b = %r; [Domain(-1.0, 1.0)] shader float main(float%s x) { float f = 0.0; float d = %s; %s return f; }" % (
        a, b, dim if dim > 1 else "", d, FORMS[form][0])


class Kinks(Case):
    def ask(self, form, shape, at, way):
        self.put("s.salt", source(form, shape, *at))
        j = self.json_cli("grad", "s.salt", "--integral", "--estimator", way[0], "--precision", way[1], "--samples", "2^15")
        told = [w for w in j["warnings"] if w["code"] == "coincident"]
        f, measure = FORMS[form][1], SHAPES[shape][2]
        kink = False
        for i, p in enumerate("ab"):
            lo, hi = sides(f, measure, at, i)
            got, error, size = j["gradient"][p], j["stderr"][p], max(abs(lo), abs(hi), 1)
            bends = abs(hi - lo) > 1e-3 * size
            kink |= bends
            solid = SHAPES[shape][0] == 3 # of which so few samples leave more open
            self.assertLess(abs(got - (lo + hi) / 2), (0.02 if solid else 1e-3) * size + (0 if bends else 4 * error), (p, got, lo, hi))
            if bends:
                self.assertGreater(error, 0.85 * abs(hi - lo) / 2)
            elif not solid:
                self.assertLess(error, 0.03 * size)
        self.assertEqual(kink, bool(told))
        if told and form in ("or", "else if"):
            self.assertIn("`d < a` and `d < b`", told[0]["message"])
            self.assertTrue(told[0]["uri"].endswith("s.salt") and told[0]["range"]["end"]["character"] > 0)

    def each(self, at, ways):
        for n, form in enumerate(FORMS):
            for m, shape in enumerate(SHAPES):
                for way in ways(n, m, shape):
                    with self.subTest(form=form, shape=shape, way=way, at=at):
                        self.ask(form, shape, at, way)

    def test_equal(self):
        self.each((AT, AT), lambda n, m, shape: WAYS if shape == "disc" else (WAYS[(n + m) % 6], WAYS[(n + m + 2) % 6]))

    def test_beside(self):
        self.each((AT, AT + 0.125), lambda n, m, shape: (WAYS[(n + m) % 6],))
        self.each((AT + 1e-3, AT), lambda n, m, shape: (WAYS[(n + m + 3) % 6],) if shape == "disc" else ())

    def test_centres(self):
        """Discs with centres of their own, written out."""
        for form, truth in (("d < 0.0 || e < 0.0", 0.5), ("d > 0.0 && e < 0.0", -0.5), ("d < 0.0 && e < 0.0", 0.5)):
            for way in WAYS:
                with self.subTest(form=form, way=way):
                    self.put("s.salt", "param float3 a = float3(0.1, -0.05, 0.5); param float3 b = float3(0.1, -0.05, 0.5); [Domain(-1.0, 1.0)] shader float main(float2 x) { "
                             "float d = length(x - a.xy) - a.z; float e = length(x - b.xy) - b.z; [Disc] if (%s) return 1.0; return 0.0; }" % form)
                    j = self.json_cli("grad", "s.salt", "--integral", "--estimator", way[0], "--precision", way[1], "--samples", "2^15")
                    self.assertIn("coincident", [w["code"] for w in j["warnings"]])
                    self.assertLess(abs(j["gradient"]["a"][2] - truth * math.pi), 0.05)
                    self.assertGreater(j["stderr"]["a"][2], 0.85 * math.pi / 2)

    def test_no_width(self):
        """A band about 0 of no width."""
        for way in WAYS:
            with self.subTest(way=way):
                self.put("s.salt", "param float b = 0.0; [Domain(-1.0, 1.0)] shader float main(float2 x) { [Disc] if (abs(x.x + 0.3 * x.y) < b) return 1.0; return 0.0; }")
                j = self.json_cli("grad", "s.salt", "--integral", "--estimator", way[0], "--precision", way[1], "--samples", "2^15")
                self.assertIn("coincident", [w["code"] for w in j["warnings"]])
                self.assertLess(abs(j["gradient"]["b"] - 2), 0.01)
                self.assertGreater(j["stderr"]["b"], 1.7)


if __name__ == "__main__":
    unittest.main()
