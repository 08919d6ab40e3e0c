"""Boundaries that are one at these parameters, of which the program asks the second where the first has decided one way: the
integral has one derivative to each side. What is printed lies halfway between, the error covers both, and there is a warning;
beside such parameters there is none. Integrals are known: of what is decided between sorted radii."""
import math
import os

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

    def sides_of(self, params, body, truth, ways=WAYS, samples="2^16"):
        """Each derivative lies between those to its two sides, as truth has them, and the error reaches them."""
        for way in ways:
            with self.subTest(body=body, way=way):
                self.put("s.salt", " ".join("param %s;" % p for p in params) + " [Domain(-1.0, 1.0)] shader float main(float2 x) { float f = 0.0; %s return f; }" % body)
                j = self.json_cli("grad", "s.salt", "--integral", "--estimator", way[0], "--precision", way[1], "--samples", samples)
                size = max(abs(v) for s in truth.values() for v in s)
                for name, (lo, hi) in truth.items():
                    p, _, i = name.partition(".")
                    got, error = (j[k][p] if not i else j[k][p][int(i)] for k in ("gradient", "stderr"))
                    off = max(0, lo - got, got - hi)
                    self.assertLess(off, 4 * error + 2e-3 * size, (name, got, error))
                    self.assertGreaterEqual(error, 0.45 * (hi - lo) / 2, (name, got, error))
                self.assertIn("coincident", [w["code"] for w in j["warnings"]])

    def test_three(self):
        """Of three that are equal any may be the one that is seen."""
        d, all_of = "float d = length(x); ", 0.8 * math.pi
        for body in ("[Disc] if (d < a || d < b || d < c) f = 1.0;", "[Disc] if (d < a && d < b && d < c) f = 1.0;", "[Disc] if (d < min(a, min(b, c))) f = 1.0;",
                     "[Disc] if (min(d - a, min(d - b, d - c)) < 0.0) f = 1.0;", "[Disc] if (d < a) f = 1.0; [Disc] if (d < b) f = 1.0; [Disc] if (d < c) f = 1.0;"):
            self.sides_of(["float %s = 0.4" % p for p in "abc"], d + body, {p: (0, all_of) for p in "abc"})

    def test_discs_of_one_place(self):
        """Whichever way one centre goes, that side of its disc shows."""
        disc = "length(x - float2(%sx, %sy)) < %s"
        centres = ["float %s%s = %s" % (p, k, v) for p in "ab" for k, v in (("x", "0.1"), ("y", "0.2"))]
        self.sides_of(centres, "[Disc] if (%s || %s) f = 1.0;" % (disc % ("a", "a", "0.3"), disc % ("b", "b", "0.3")), {p + k: (-0.6, 0.6) for p in "ab" for k in "xy"})
        self.sides_of(centres + ["float r = 0.3", "float q = 0.3"], "[Disc] if (%s) f = 1.0; [Disc] if (%s) f = 3.0;" % (disc % ("a", "a", "r"), disc % ("b", "b", "q")),
                      {"ax": (-0.6, 0.6), "by": (-0.6, 0.6), "r": (0, 0.6 * math.pi), "q": (1.2 * math.pi, 1.8 * math.pi)})

    def test_border(self):
        """A boundary on the border of the domain moves in or out of it."""
        self.sides_of(["float a = 1.0"], "[Disc] if (x.x < a) f = 1.0 + 0.5 * x.y;", {"a": (0, 2)})
        self.sides_of(["float a = -1.0"], "[Disc] if (x.x > a) f = 1.0;", {"a": (-2, 0)})
        self.sides_of(["float a = 1.0", "float b = 0.3"], "[Disc] if (x.x < a && x.y < b) f = 1.0;", {"a": (0, 1.3), "b": (2, 2)})
        self.sides_of(["float w = 1.0", "float h = 1.0"], "[Disc] if (max(abs(x.x) - w, abs(x.y) - h) < 0.0) f = 1.0;", {"w": (0, 4), "h": (0, 4)})
        self.sides_of(["float p[2] = { 1.0, 0.5 }"], "for (int i = 0; i < 2; i++) { [Disc] if (x.y < p[i]) f += 1.0; }", {"p.0": (0, 2), "p.1": (2, 2)})

    def test_nothing_on_the_border(self):
        """What ends there and does not move, or moves along it, is no kink."""
        for body in ("[Disc] if (x.x < 1.0) f = x.y < a ? 1.0 : 2.0;", "[Disc] if (x.y < a + 0.1 * x.x) f = 1.0;", "[Disc] if (x.x * x.x < 1.0) f = a * x.y * x.y;",
                     "f = max(x.x - 1.0, 0.0) + a * x.x;", "[Disc] if (length(x) < 1.0) f = a;"):
            for way in WAYS:
                with self.subTest(body=body, way=way):
                    self.put("s.salt", "param float a = 0.3; [Domain(-1.0, 1.0)] shader float main(float2 x) { float f = 0.0; %s return f; }" % body)
                    j = self.json_cli("grad", "s.salt", "--integral", "--estimator", way[0], "--precision", way[1], "--samples", "2^15")
                    self.assertNotIn("coincident", [w["code"] for w in j["warnings"]])

    def test_few(self):
        """Faces seen at a grazing angle have edges that are almost one: of 7 600 crossings one or two say kink."""
        mesh = os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../examples/mesh_views/mesh.salt")
        for seed in (1, 2):
            j = self.json_cli("grad", mesh, "--integral", "--estimator", "lattice", "--param", "at=0,0", "--seed", seed, "--samples", "2^16")
            self.assertNotIn("coincident", [w["code"] for w in j["warnings"]])

    def test_arrays(self):
        """Bounds that an iteration takes from arrays by its number."""
        self.sides_of(["float p[3] = { 0.3, 0.5, 0.6 }", "float q[3] = { 0.3, 0.55, 0.6 }"], "float d = length(x); for (int i = 0; i < 3; i++) { [Disc] if (d < p[i] || d < q[i]) f += 1.0; }",
                      {"p.0": (0, 0.6 * math.pi), "p.2": (0, 1.2 * math.pi), "q.0": (0, 0.6 * math.pi), "q.1": (1.1 * math.pi, 1.1 * math.pi), "p.1": (0, 0)})

    def test_polygon(self):
        """A square by crossings with an edge, whose ends each edge has for itself: where one end moves alone, another edge ends there."""
        v = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
        params, body = [], ""
        for i in range(4):
            for name, (x, y) in (("a", v[i]), ("b", v[(i + 1) % 4])):
                params.append("float2 %s%d = float2(%r, %r)" % (name, i, x, y))
            body += "[Disc] if ((a{0}.y > x.y) != (b{0}.y > x.y) && x.x < (b{0}.x - a{0}.x) * (x.y - a{0}.y) / (b{0}.y - a{0}.y) + a{0}.x) f = 1.0 - f; ".format(i)
        self.sides_of(params, body, {"a0.1": (-1, 0), "b0.1": (-1, 0), "a1.0": (0.5, 0.5), "a1.1": (-1.5, -0.5), "b1.1": (0.5, 1.5), "a2.1": (0, 1), "b2.1": (0, 1), "b3.1": (-0.5, 0.5)})


if __name__ == "__main__":
    unittest.main()
