"""Crossings that cannot be integrated: jumps that an untagged decision makes under a [Disc]. What moves is lost, and the bars say so, of lines and in
the cells that are left over alike; what stands still is no loss, and costs nothing."""
import math

from harness import *

HEAD = "param float a = %s; param float b = 0.6; [Domain(%s)] shader float main(%s) { float f = 0.0; %s return f; }"

# Parameter a, domain, position, body, derivatives.
MOVES = {
    "largest of an array": (0.1, "-1.0, 1.0", "float2 x", "float v[3] = { sin(2.0 * x.x + a), 0.4 * x.y, 0.2 }; int k = 0; for (int i = 1; i < 3; i++) if (v[i] > v[k]) k = i; "
                            "[Disc] if (float(k) - 0.5 + 0.0 * x.x < 0.0) f = 1.0;", {"a": 1}),
    "bits": (0.4, "0.5, 1.0", "float2 x", "uint k = asuint(x.x + a); float h = float((k >> 20u) & 1u) - 0.5; [Disc] if (h * (1.0 + x.y) > 0.0) f = 1.0;", {"a": 0.5}),
    "slanted saw": (0.23, "0.0, 1.0", "float2 x", "float s = frac(3.0 * x.x + x.y + a) - 0.5; [Disc] if (s < 0.0) f = 1.0;", {"a": 0}),
    "quotient with NaN": (0.3, "0.0, 1.0", "float2 x", "float q = (x.y - b) / sqrt(x.x - a); [Disc] if (q < 0.0) f = 1.0;", {"a": -0.6, "b": 0.7}),
    "choice of slopes": (0.4, "0.0, 1.0", "float2 x", "float h = x.x < a ? x.y - 0.3 : 0.7 - x.y; [Disc] if (h < 0.0) f = 1.0;", {"a": 0}),
    "two lines": (0.4, "0.0, 1.0", "float2 x", "float h = x.x < a ? -0.5 : 0.5; [Disc] if (h < 0.0) f = 1.0; [Disc] if (x.y < b) f += 1.0;", {"a": 1, "b": 1}),
    "steps in space": (0.37, "0.0, 1.0", "float3 x", "int i = int(2.0 * (x.x + 0.2 * x.y) + a); float h = float(i & 1) - 0.5; [Disc] if (h + 0.0 * x.z < 0.0) f = 1.0;", None),
}
# An offset k of x.y < a + 0.08 k in steps that stay, and the derivative.
STANDS = {
    "floor": ("float k = floor(5.0 * x.x);", 2),
    "round": ("float k = round(5.0 * x.x);", 2),
    "int": ("float k = float(int(5.0 * x.x));", 2),
    "slanted": ("float k = floor(3.0 * x.x + 0.5 * x.y);", 2.08), # three steps, at each of which it covers itself by .04 / 3
    "choice": ("float k = x.x < 0.3 ? 1.0 : 0.0;", 2),
    "branch": ("float k = 0.0; if (x.x * x.x < 0.3) k = 2.0;", 2),
    "array": ("float v[5] = { 0.1, 1.4, 0.3, 2.0, 0.7 }; float k = v[int(5.0 * x.x)];", 2),
    "loop": ("float k = 0.0; for (int i = 1; i < 4; i++) if (x.x > 0.23 * float(i)) k += 0.7;", 2),
    "bits": ("float k = float((asuint(x.x + 1.0) >> 20u) & 3u);", 2),
}


class Lost(Case):
    def grad(self, *options):
        return self.json_cli("grad", "s.salt", "--integral", "--no-cache", *options)

    def test_moves(self):
        for name, (a, domain, position, body, want) in MOVES.items():
            self.put("s.salt", HEAD % (a, domain, position, body))
            for precision, estimator in (("f32", "quadrature"), ("f64", "auto"), ("f32", "lattice")):
                with self.subTest(name, precision=precision, estimator=estimator):
                    j = self.grad("--precision", precision, "--estimator", estimator)
                    self.assertTrue({"dropped", "upset"} & {w["code"] for w in j["warnings"]}, j["warnings"])
                    for p, bar in j["stderr"].items():
                        if want is None:
                            self.assertGreater(bar, 0.1)
                        elif p in want:
                            self.assertLessEqual(abs(j["gradient"][p] - want[p]), 2 * bar + 1e-4)

    def test_stands(self):
        for name, (body, want) in STANDS.items():
            self.put("s.salt", HEAD % (0.5, "0.0, 1.0", "float2 x", body + " [Disc] if (x.y - 0.08 * k < a) f = 2.0;"))
            for precision, estimator in (("f32", "lattice"), ("f64", "auto"), ("f32", "quadrature")):
                with self.subTest(name, precision=precision, estimator=estimator):
                    j = self.grad("--precision", precision, "--estimator", estimator)
                    self.assertEqual([w["code"] for w in j["warnings"]], [])
                    self.assertLessEqual(abs(j["gradient"]["a"] - want), 4 * j["stderr"]["a"] + 1e-5)
                    self.assertLess(j["stderr"]["a"], 0.02)
                    self.assertEqual(sum(j["dropped"].values()), 0)

    def test_differences_that_see_nothing(self):
        """Where no sample changes sides a difference is 0, and so was its error."""
        self.put("s.salt", HEAD % (0.3, "0.0, 1.0", "float2 x", "float u = length(x - 0.45) - a; [Disc] if (u > 0.0 && u < 0.01 * b) f = 1.0; [Disc] if (x.x < 0.1) f += 0.5;"))
        for samples in 16, 64, 1024:
            j = self.grad("--estimator", "fd", "--samples", samples)
            for p, want in (("a", 2 * math.pi * 0.006), ("b", 2 * math.pi * 0.306 * 0.01)):
                self.assertLess(abs(j["gradient"][p] - want), 4 * j["stderr"][p], (p, samples))

    def test_steps_of_rounding(self):
        """g rises in steps, or places lie so far apart, that what decides stays where it is until r has gone far: no jump that nothing moves."""
        bodies = {"offset": ("-1.0, 1.0", "float u = length(x) + 1e4, v = r + 1e4; [Disc] if (u * u < v * v) return 1.0; return 0.0;"),
                  "eight values": ("-1.0, 1.0", "[Disc] if (cos(1e-3 * length(x)) > cos(1e-3 * r)) return 1.0; return 0.0;"),
                  "far": ("9999999.0, 10000001.0", "[Disc] if (length(x - 1e7) < r) return 1.0; return 0.0;")}
        for name, (domain, body) in bodies.items():
            with self.subTest(name):
                self.put("s.salt", "param float r = 0.4;\n[Domain(%s)] shader float main(float2 x) { %s }" % (domain, body))
                j = self.grad("--estimator", "lattice", "--precision", "f32", "--samples", 65536)
                self.assertIn("dropped", [w["code"] for w in j["warnings"]])
                self.assertGreater(j["stderr"]["r"], 1)

    def test_stands_beside_what_moves(self):
        """A loss and an image's gradient: the edge of a disc in steps."""
        self.put("s.salt", HEAD % (0.3, "-1.0, 1.0", "float2 x", "float k = floor(4.0 * x.x); [Disc] if (length(x) - 0.02 * k < a) f = 1.0;"))
        for options in (("--adjoint", "w.npy", "--size", 16), ("--target", "w.npy", "--size", 16)):
            self.run_cli("render", "s.salt", "--size", 16, "--param", "a=0.5", "-o", "w.npy")
            for estimator in "lattice", "auto":
                j = self.json_cli("grad", "s.salt", "--estimator", estimator, *options)
                self.assertEqual(j["warnings"], [], estimator)


if __name__ == "__main__":
    unittest.main()
