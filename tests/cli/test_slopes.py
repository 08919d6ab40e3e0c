"""Shading so steep beside a jump that it changes on the bracket of the root, between floats: what it changes by is no part
of the jump. The boundary terms have closed forms, whatever the slope."""
import math

from harness import *

SLOPES = (1e3, 1e5, 1e7)
# {}: the slope. The jump is 1 everywhere.
PROGRAMS = {
    "one side": ("[Domain(0.0, 1.0)] shader float main(float x) { [Disc] if (x < c) return 1.0 + %g * (x - c); return 0.0; }", 1),
    "both sides": ("[Domain(0.0, 1.0)] shader float main(float x) { float f = %g * (x - c); [Disc] if (x < c) f = 1.0 + 0.5 * f; return f; }", 1),
    "oblique": ("[Domain(0.0, 1.0)] shader float main(float2 x) { float d = x.x + 0.3 * x.y - c; [Disc] if (d < 0.0) return 1.0 + %g * d; return 0.0; }", 1),
    "disc": ("[Domain(-1.0, 1.0)] shader float main(float2 x) { float d = length(x - float2(0.013, 0.027)) - c; [Disc] if (d < 0.0) return 1.0 + %g * d; return 0.0; }",
             2 * math.pi * 0.37),
}


class Slopes(Case):
    def measure(self, name, slope, precision, estimator):
        source, truth = PROGRAMS[name]
        self.put("p.salt", "param float c = 0.37;\n" + source % slope)
        j = self.json_cli("grad", "p.salt", "--integral", "--boundary-only", "--precision", precision, "--estimator", estimator, "--quiet")
        return abs(j["gradient"]["c"] / truth - 1), j["stderr"]["c"] / truth

    def test_steep_beside_a_jump(self):
        # What lines leave, and in f32 a float's part of the change between two.
        least = {("f64", "quadrature"): 1e-8, ("f64", "lattice"): 3e-4, ("f32", "quadrature"): 1e-5, ("f32", "lattice"): 3e-4}
        for name in PROGRAMS:
            for (precision, estimator), limit in least.items():
                for slope in SLOPES:
                    with self.subTest(name, slope=slope, precision=precision, estimator=estimator):
                        off, bar = self.measure(name, slope, precision, estimator)
                        self.assertLess(off, limit + (4e-8 * slope if precision == "f32" else 0))
                        self.assertLess(off, 2 * bar + 1e-6)

    def test_roots_where_g_bends(self):
        """The slope of g is what a crossing weighs: beside a pole it changes within what is known of a root, of all lines alike, and no bar holds that."""
        programs = {  # a decision of x, its level, and the truth: twice dx/dc
            "tan": ("tan(1.5707 * x.x) < c", (1e3, 1e4), lambda c: 2 / 1.5707 / (1 + c * c)),
            "pole": ("1.0 / (1.0 + 1e-7 - x.x) < c", (1e3, 1e5), lambda c: 2 / (c * c)),
            "root": ("sqrt(x.x + 1.0) < c", (1e-1, 1e-2), lambda c: 4 * c),
        }
        for name, (decision, levels, truth) in programs.items():
            for level in levels:
                with self.subTest(name, level=level):
                    self.put("p.salt", "param float c = %r;\n[Domain(-1.0, 1.0)] shader float main(float2 x) { float f = 0.0; [Disc] if (%s) f = 1.0; return f; }" % (level, decision))
                    j = self.json_cli("grad", "p.salt", "--integral", "--precision", "f64", "--estimator", "lattice", "--quiet")
                    self.assertLess(abs(j["gradient"]["c"] / truth(level) - 1), 2 * j["stderr"]["c"] / truth(level) + 1e-9)

    def test_bands_that_move_as_a_whole(self):
        """Of the derivative by a band's place all that is left is by how much f differs at its two edges: as much as f changes by on the bracket of a root."""
        programs = {  # the width is twice {}; the truth by that
            "line, rand": ("[Domain(0.0, 1.0)] shader float main(float x) { float u = rand(); float f = 0.0; [Disc] if (abs(x - c - 0.2 * u) < %g) f = x; return f; }", 2),
            "plane": ("[Domain(0.0, 1.0)] shader float main(float2 x) { float f = 0.0; [Disc] if (abs(x.y - c) < %g) f = x.y; return f; }", 2),
            "plane, rand": ("[Domain(0.0, 1.0)] shader float main(float2 x) { float u = rand(); float f = 0.0; [Disc] if (abs(x.y - c - 0.2 * u) < %g) f = x.y; return f; }", 2),
            "volume": ("[Domain(-1.0, 1.0)] shader float main(float3 x) { float f = 0.0; [Disc] if (abs(x.z - c) < %g) f = 1.0 + x.z * x.z; return f; }", 16 * 0.37),
        }
        for name, (source, truth) in programs.items():
            for width in (1e-6, 1e-5, 1e-3):
                for precision, least in (("f64", 1e-8), ("f32", 2e-6)):
                    with self.subTest(name, width=width, precision=precision):
                        self.put("p.salt", "param float c = 0.37;\n" + source % width)
                        j = self.json_cli("grad", "p.salt", "--integral", "--boundary-only", "--precision", precision, "--estimator", "lattice", "--quiet")
                        off = abs(j["gradient"]["c"] - truth * width)
                        self.assertLess(off, 2 * j["stderr"]["c"] + 1e-8 * truth * width)
                        self.assertLess(off, least * (1 if precision == "f32" else truth * width))

    def test_jumps_that_nearly_cancel(self):
        """Two ends of a narrow slit, in which f is a slight ramp: of the derivative by its place two jumps leave a third of one, and of straight edges
        lines agree on it, however far off it is."""
        self.put("p.salt", "param float c = 0.03; param float w = 0.01; [Domain(-1.0, 1.0)] shader float main(float2 x) { [Disc] if (abs(x.x - c) < 0.5 * w) return x.x; return 0.0; }")
        for samples in (12, 14, 16, 18):
            for seed in (1, 2):
                j = self.json_cli("grad", "p.salt", "--integral", "--estimator", "lattice", "--precision", "f64", "--samples", "2^%d" % samples, "--seed", seed)
                for p, want in {"c": 0.02, "w": 0.06}.items():
                    self.assertLess(abs(j["gradient"][p] - want), 4 * j["stderr"][p] + 1e-10, (p, samples))

    def test_layers_beside_a_jump(self):
        """f falls from 1 to 0 so fast that points on either side of the layer see nothing of it: with the layer, the derivative is nearly 0."""
        layers = {"line": ("x.x - r", lambda k: 0), "disc": ("length(x) - r", lambda k: 2 * math.pi / k)}
        for name, (g, truth) in layers.items():
            for k in (1e2, 1e3, 1e4):
                for args in ((), ("--estimator", "quadrature"), ("--precision", "f64"), ("--precision", "f64", "--estimator", "quadrature")):
                    with self.subTest(name, k=k, args=args):
                        self.put("p.salt", "param float r = 0.4; [Domain(-1.0, 1.0)] shader float main(float2 x) { float d = %s; [Disc] if (d < 0.0) return exp(%g * d); return 0.0; }" % (g, k))
                        j = self.json_cli("grad", "p.salt", "--integral", "--quiet", *args)
                        self.assertLess(abs(j["gradient"]["r"] - truth(k)), 4 * j["stderr"]["r"] + 1e-6)

    def test_layers_away_from_jumps(self):
        """The same of a step between the curves: points on both its sides agree on what f is there, and derivatives know nothing of it."""
        programs = {  # the step is at q, where its height is 2 along a line of that length
            "beside a jump": ("float", "if (x < p) return 1.0 + tanh(%g * (x - q)); return 0.0;", 1, 0.6),
            "under a jump": ("float", "float f = 1.0 + tanh(%g * (x - q)); [Disc] if (x < p) f += 1.0; return f;", 1, 1),
            "across a curve": ("float2", "[Disc] if (x.y < p + 0.1 * x.x) return 1.0 + tanh(%g * (x.x - q)); return 0.0;", 2, 1),
        }
        for name, (domain, body, dim, last) in programs.items():
            for k in (1e3, 1e4, 1e5):
                for q in (0.55, 0.3571):
                    for args in ((), ("--precision", "f64")):
                        with self.subTest(name, k=k, q=q, args=args):
                            body_of = (body if "[Disc]" in body else "[Disc] " + body) % k
                            self.put("p.salt", "param float p = 0.6; param float q = %g; shader float main(%s x) { %s }" % (q, domain, body_of))
                            j = self.json_cli("grad", "p.salt", "--integral", "--quiet", *args)
                            truth = -(math.tanh(k * (last - q)) + math.tanh(k * q)) if dim == 1 else -2 * (0.6 + 0.1 * q)
                            off, bar = abs(j["gradient"]["q"] - truth), j["stderr"]["q"]
                            self.assertLess(off, 4 * bar + 2e-5)
                            if dim == 1:
                                self.assertLess(off, 1e-2)
                                self.assertLess(bar, 0.1)


if __name__ == "__main__":
    unittest.main()
