"""What is infinite or NaN in a part of the picture that the shader replaces afterwards: values never showed it, and derivatives do not either,
in reverse, forwards, in pictures and losses, compiled at any width or interpreted. tests/ad/test_thrown.c has the combinations."""
import math

from harness import *

# f is continuous where d is 0, so that its derivative is that of what is kept; d < 0 on a third of the domain.
PROGRAMS = {
    "root": "return d < 0.0 ? 0.0 : d * sqrt(d) * cos(sqrt(d) * 9.0);",
    "root before an if": "float f = d * cos(sqrt(d)); if (d < 0.0) f = 0.0; return f;",
    "log of a log": "float f = d * sin(log(1.0 + log(1.0 + 3.0 * d))); if (d < 0.0) f = 0.0; return f;",
    "power": "float f = saturate(pow(d, 1.5)); return d > 0.0 ? f : 0.0;",
    "arc": "float f = 1.0 - cos(acos(1.0 - d * c)); return d > 0.0 ? f * d : 0.0;",
    "nothing by nothing": "float u = max(d, 0.0), f = sin(u / u + c) * u; return u > 0.0 ? f : 0.0;",
    "unit of nothing": "float2 u = float2(max(d, 0.0), max(2.0 * d, 0.0)), n = normalize(u); return d > 0.0 ? d * atan(n.x + c) : 0.0;",
    "angle of nothing": "float u = max(d, 0.0), f = u * exp(-pow(atan2(u, u * c), 2.0)); return d > 0.0 ? f : 0.0;",
    "overflows that meet": "float e = exp(-2000.0 * d), f = tanh((e + c) / (e + 2.0)); return d > 0.1 ? f - tanh(0.5 * c) + d - 0.1 : 0.0;",
    "a march to nowhere": "float t = d; for (int i = 0; i < 6; i++) t += 0.1 * log(t); return d > 0.0 ? d * d * sin(isnan(t) ? 0.0 : 1.0) : 0.0;",
    "squares of squares": "float2 z = float2(1.0 - d, c); for (int i = 0; i < 40; i++) z = float2(z.x * z.x - z.y * z.y, 2.0 * z.x * z.y) * 0.9; return d > 0.2 && d < 0.9 ? cos(z.x) - 1.0 + d : 0.0;",
    "an iteration later": "float f = 0.0, r = sqrt(d); for (int i = 0; i < 3; i++) { f = sin(r * float(i + 1)) * d; if (i == 1 && d < 0.0) r = 0.0; } return d < 0.0 ? 0.0 : f;",
    "in an array": "float a[2]; a[0] = d * atan(sqrt(d)); a[1] = 0.0; if (d < 0.0) a[0] = a[1]; return a[0] * c;",
}
SOURCE = "param float c = 0.4;\n[Domain(0.0, 1.0)] shader float main(float2 x) { float d = x.x + 0.3 * x.y - c; [NoDisc] { %s } }"
CUSP = """uniform float c;
void mainImage(out vec4 o, vec2 u) {
    vec2 p = u / iResolution.xy;
    float d = length(p - .5) - .3 - c;
    o = vec4(.5 + .5 * cos(sqrt(d) * 9. + vec3(0, 1, 2)), 1);
    if (d < 0.) o = vec4(0);
}
"""


class Thrown(Case):
    def gradient(self, *args):
        j = self.json_cli("grad", "p.salt", "--integral", "--samples", 4096, "--estimator", "lattice", "--quiet", *args)
        self.assertEqual(j["nonfinite"], 0)
        return j["gradient"]["c"]

    def test_programs(self):
        same = ("--estimator", "lattice", "--samples", 4096, "--precision", "f64", "--quiet")
        for name, body in PROGRAMS.items():
            with self.subTest(name):
                self.put("p.salt", SOURCE % body)
                value = lambda c: self.json_cli("render", "p.salt", "--integral", *same, "--param", "c=%.12g" % c)["integral"][0]
                h = 1e-5  # the same samples: only those between the two steps see another branch
                truth = (value(0.4 + h) - value(0.4 - h)) / (2 * h)
                exact = self.gradient("--precision", "f64")
                self.assertLess(abs(exact - truth), 2e-3 * (1 + abs(truth)))
                for args in ((), ("--width", 1), ("--width", 64), ("--target-cpu", "sse2"), ("--interpret",), ("--interpret", "--precision", "f64")):
                    self.assertLess(abs(self.gradient(*args) - exact), 2e-3 * (1 + abs(exact)), args)
                picture = self.json_cli("grad", "p.salt", "--size", 16, "-o", "d.exr", "--quiet")
                self.assertEqual(picture["nonfinite"], 0)

    def test_losses(self):
        for name, body in PROGRAMS.items():
            with self.subTest(name):
                self.put("p.salt", SOURCE % body)
                self.run_cli("render", "p.salt", "--size", 16, "--param", "c=0.5", "-o", "t.exr")
                j = self.json_cli("grad", "p.salt", "--size", 16, "--target", "t.exr", "--quiet")
                self.assertEqual(j["nonfinite"], 0)
                self.assertTrue(math.isfinite(j["gradient"]["c"]) and j["gradient"]["c"] != 0)

    def test_told(self):
        """A NaN that makes f NaN needs no guard, in steps that carry it on neither; one that a branch or a later step may throw away does."""
        body = "param float c[3] = {0.4, 0.2, 0.5};\n[Domain(0.0, 1.0)] shader float main(float2 x) { float t = x.x, q = clamp((x.y - c[1]) / c[2], 0.0, 1.0); for (int i = 0; i < 9; i++) { %s } %s return t * sin(t - c[1]); }"
        step = "t = clamp(t + 0.1 * sin(q * t) - c[0] * t * q * q, -8.0, 8.0);"
        guards = {}
        for name, of in {
            "told": (step, ""), "an if": ("if (x.x > 0.3) { %s }" % step, ""), "behind": (step, "if (x.x > 0.9) t = 0.3;"), "max": (step, "t = max(0.1, t);"),
            "carried": ("%s if (i == 4) t = x.y;" % step, ""),
        }.items():
            self.put("p.salt", body % of)
            r = self.run_cli("explain", "p.salt", "--dump", "vjp:cut")
            text = r.out + r.err
            self.assertIn("after cut of vjp", text)
            guards[name] = text.count("= zmul")
        self.assertLessEqual(guards.pop("told"), 1)  # the infinity of q, which clamp throws away
        self.assertTrue(all(n > 1 for n in guards.values()), guards)
        for keeps in "q + x.x", "x.x - q", "q * 0.0", "x.x / q", "q / 0.0", "-q", "abs(q)", "sqrt(q)", "exp(q)", "exp2(q)", "sin(q)", "cos(q)", "min(q, 0.5)", "max(q, 0.5)", "q * x.x + 1.0", "x.x * x.y + q":
            self.put("p.salt", "param float c = -0.4;\n[Domain(0.0, 1.0)] shader float main(float2 x) { float q = sqrt(c - x.y); return %s; }" % keeps)
            for args in ((), ("--precision", "f64"), ("--target-cpu", "sse2"), ("--interpret",)):
                r = self.json_cli("render", "p.salt", "--integral", "--samples", 64, "--estimator", "lattice", "--quiet", *args)
                self.assertIsNone(r["integral"][0], (keeps, args))

    def test_unasked(self):
        """f is NaN in half of the pixels, the adjoint 0 there: the derivative is that of the other half."""
        self.put("p.salt", "param float c = 0.4;\n[Domain(0.0, 1.0)] shader float main(float2 x) { float s = sqrt(x.y - 0.5); return s * c / (s - s * 0.5) * c; }")
        self.put("a.npy", write_npy((8, 8, 1), [1.0 if i < 32 else 0.0 for i in range(64)]))
        for args in ((), ("--precision", "f64"), ("--interpret",), ("--width", 1)):
            j = self.json_cli("grad", "p.salt", "--size", 8, "--adjoint", "a.npy", "--quiet", *args)
            self.assertLess(abs(j["gradient"]["c"] - 32 * 4 * 0.4), 1e-3, args)

    def test_jump(self):
        """A jump where the root begins: its inner side is not a number, and the sides are those of the curve."""
        self.put("p.frag", CUSP)
        value = lambda c: self.json_cli("render", "p.frag", "--integral", "--size", "256x144", "--samples", 2 ** 20, "--precision", "f64", "--param", "c=%g" % c, "--quiet")["integral"]
        h = 1e-3
        truth = [(a - b) / (2 * h) for a, b in zip(value(h), value(-h))]
        for args in ((), ("--precision", "f64")):
            j = self.json_cli("grad", "p.frag", "--integral", "--size", "256x144", "--quiet", *args)
            self.assertEqual(j["nonfinite"], 0)
            for g, bar, t in zip(j["gradient"]["c"], j["stderr"]["c"], truth):
                self.assertLess(abs(g - t), 4 * bar + 0.01 * abs(t))

    def test_poles(self):
        """The derivative is infinite at single points, where cells close in on the curve; f and the integral of the derivative are finite there. On an area it stays infinite."""
        cases = {
            ("float x", "x - c", "1.0 + sqrt(d)"): -0.75 - math.sqrt(0.63),
            ("float x", "x - c", "1.0 + sqrt(d) * c"): None,
            ("float2 x", "length(x) - c", "1.0 + sqrt(d)"): None,
        }
        for (domain, d, f), truth in cases.items():
            self.put("p.salt", "param float c = 0.37;\n[Domain(0.0, 1.0)] shader float main(%s) { float d = %s, f = %s; [Disc] if (d < 0.0) f = 0.25; return f; }" % (domain, d, f))
            if truth is None:
                value = lambda c: self.json_cli("render", "p.salt", "--integral", "--samples", 2 ** 20, "--precision", "f64", "--param", "c=%g" % c, "--quiet")["integral"][0]
                truth = (value(0.371) - value(0.369)) / 2e-3
            for args in ((), ("--estimator", "lattice"), ("--estimator", "quadrature"), ("--precision", "f64")):
                with self.subTest(d, f=f, args=args):
                    j = self.json_cli("grad", "p.salt", "--integral", "--quiet", *args)
                    self.assertLess(abs(j["gradient"]["c"] - truth), 4 * j["stderr"]["c"] + 5e-3)
        self.put("p.salt", "param float c = 0.0;\n[Domain(0.0, 1.0)] shader float main(float x) { return x < 0.9 ? x : x + sqrt(c * x); }")
        for estimator in "lattice", "quadrature":
            j = self.json_cli("grad", "p.salt", "--integral", "--quiet", "--estimator", estimator)
            self.assertFalse(math.isfinite(j["gradient"]["c"] or math.inf))


if __name__ == "__main__":
    unittest.main()
