"""Derivatives that a few samples hold: where f is a small power of the distance to a place, the error of their sum is none that replicates
show."""
import math

from harness import *

POWERS = (0.1, 0.2, 0.3)
SEEDS = (1, 2, 3, 4)
PROGRAMS = {
    "line": ("param float p = 0.3; shader float main(float x) { return pow(max(x - p, 0.0), %g); }", lambda a: -(0.7 ** a)),
    "disc": ("param float p = 0.3; shader float main(float2 x) { return pow(max(1.0 - length(x - 0.5) / p, 0.0), %g); }",
             lambda a: 4 * math.pi * 0.3 / ((a + 1) * (a + 2))),
    "ball": ("param float p = 0.3; shader float main(float3 x) { return pow(max(1.0 - length(x - 0.5) / p, 0.0), %g); }",
             lambda a: 4 * math.pi * 0.09 * 3 * 2 / ((a + 1) * (a + 2) * (a + 3))),
    # one side takes from the other, and a smooth part hides both
    "both sides": ("param float p = 0.3; shader float main(float x) { return pow(abs(x - p), %g); }", lambda a: 0.3 ** a - 0.7 ** a),
    "hidden": ("param float p = 0.3; shader float main(float x) { return 0.2 * pow(max(x - p, 0.0), %g) + sin(3.0 * (x - p)); }",
               lambda a: -0.2 * 0.7 ** a - math.sin(2.1) - math.sin(0.9)),
}
PLAIN = (
    "param float p = 0.3; shader float main(float2 x) { return sin(9.0 * x.x * p) * cos(7.0 * x.y + p); }",
    "param float p = 0.3; shader float main(float2 x) { return length(x - p); }",
    "param float p = 0.3; shader float main(float2 x) { return exp(-1e4 * dot(x - p, x - 0.31)); }",
    "param float p = 0.3; shader float main(float x) { return sqrt(abs(x - p)); }",
    "param float p = 0.3; shader float main(float2 x) { return max(0.0, 0.1 * p - length(x - 0.5)); }",
)


class Tails(Case):
    def measure(self, source, seed, estimator="lattice"):
        self.put("p.salt", source)
        j = self.json_cli("grad", "p.salt", "--integral", "--estimator", estimator, "--seed", str(seed), "--quiet")
        return j["gradient"]["p"], j["stderr"]["p"], [w["code"] for w in j["warnings"]]

    def test_small_powers(self):
        for name, (source, truth) in PROGRAMS.items():
            for a in POWERS:
                for seed in SEEDS:
                    with self.subTest(name, power=a, seed=seed):
                        got, bar, _ = self.measure(source % a, seed)
                        self.assertLess(abs(got - truth(a)), 2 * bar)

    def test_cells(self):
        """Rules agree beside such a place on what neither has met."""
        for name, (source, truth) in PROGRAMS.items():
            for a in POWERS + (0.4,):
                for estimator in ("quadrature", "auto"):
                    with self.subTest(name, power=a, estimator=estimator):
                        got, bar, _ = self.measure(source % a, 1, estimator)
                        self.assertLess(abs(got - truth(a)), 4 * bar)
        for source in PLAIN[:4]:
            with self.subTest(source):
                got, bar, words = self.measure(source, 1, "quadrature")
                self.assertLess(bar, 1e-5)
                self.assertNotIn("singular", words)

    def test_derivative_images(self):
        """They state no error; of a rim like this a third of the derivative is missing, or as much too much."""
        source = "param float r = 0.3; shader float main(float2 x) { float d = length(x - 0.5), f = 0.0; [Disc] if (d < r) f = %s; return f; }"
        shading = {"pow(1.0 - d / r, 0.1)": True, "pow(1.0 - d / r, 0.2)": True, "sqrt(1.0 - d / r)": False, "1.0 + d": False,
                   "exp(-20.0 * (r - d))": False}
        for f, warned in shading.items():
            for estimator in ("auto", "lattice", "quadrature"):
                with self.subTest(f, estimator=estimator):
                    self.put("p.salt", source % f)
                    said = self.run_cli("grad", "p.salt", "--wrt", "r", "--size", "32x32", "-o", "p.npy", "--estimator", estimator).err
                    self.assertEqual("explain singular" in said, warned, said)

    def test_words(self):
        for name, (source, _) in PROGRAMS.items():
            with self.subTest(name):
                self.assertIn("singular", self.measure(source % 0.1, 1)[2])
        for source in PLAIN:
            for seed in SEEDS:
                with self.subTest(source, seed=seed):
                    self.assertNotIn("singular", self.measure(source, seed)[2])


if __name__ == "__main__":
    unittest.main()
