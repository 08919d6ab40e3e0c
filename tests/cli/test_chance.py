"""Random numbers that nearly decide alone: few lines are crossed, and bars hold all the same."""
from harness import *

SEEDS = 16


class Chance(Case):
    def answers(self, *options):
        """Of each seed in both precisions, (derivative, bar, evaluations)."""
        for precision in ("f32", "f64"):
            for seed in range(SEEDS):
                j = self.json_cli("grad", "s.salt", "--precision", precision, "--seed", str(seed), *options)
                yield j["gradient"]["p"], j["stderr"]["p"], j["evaluations"]

    def holds(self, source, want, most, *options):
        """Within four bars every time, within two all but 3 of 32 times (of a coverage of 95.4 % one in thirty suites
        would see more), and the usual bar no larger than `most`."""
        self.put("s.salt", "param float p = 0.3;\nshader float main(float2 x) { " + source + " }")
        all = list(self.answers(*options))
        off = [abs(value - want) / max(bar, 1e-12) for value, bar, _ in all]
        self.assertLessEqual(max(off), 4, (want, all[off.index(max(off))]))
        self.assertLessEqual(sum(o > 2 for o in off), 3, sorted(off))
        self.assertLessEqual(sorted(bar for _, bar, _ in all)[len(all) // 2], most)

    def test_the_place_hardly_matters(self):
        """P(u + e x < p) has the derivative 1, and of e = 1 p."""
        for e, want, most in (1.0, 0.3, 0.002), (0.1, 1, 0.02), (0.01, 1, 0.1), (0.001, 1, 0.006), (0.0001, 1, 0.006):
            self.holds("[Disc] if (rand() + %g * x.x < p) return 1.0; return 0.0;" % e, want, most, "--integral")

    def test_shading(self):
        """The half jumps by 1 - p x, and what is beside has the slope x: 1 - p / 2 + (1 - p) / 2."""
        self.holds("float u = rand(); float f = p * x.x; [Disc] if (u < p + 0.0001 * x.y) f = 1.0; return f;", 1.2, 0.01,
                   "--integral")

    def test_beside_an_edge_of_its_own(self):
        """The strong edge of another parameter hides nothing: its own errors are larger than what p weighs."""
        self.put("s.salt", "param float p = 0.3; param float q = 0.5;\nshader float main(float2 x) { float f = 0.0; "
                 "[Disc] if (rand() < p + 0.0003 * x.x) f = 1.0; [Disc] if (x.y < q) f += 2.0; return f; }")
        for seed in range(SEEDS):
            j = self.json_cli("grad", "s.salt", "--integral", "--seed", str(seed))
            for name, want in ("p", 1), ("q", 2):
                self.assertLessEqual(abs(j["gradient"][name] - want), 4 * j["stderr"][name] + 1e-6, (seed, name))
            self.assertLess(j["stderr"]["p"], 0.05)

    def test_a_loss(self):
        """Pixels are P = p + 0.001 x: of the mean of P^2 the derivative is 2 (p + 0.0005)."""
        self.put("black.salt", "shader float main(float2 x) { return 0.0; }")
        self.run_cli("render", "black.salt", "--size", "32x32", "-o", "zero.npy")
        self.holds("[Disc] if (rand() < p + 0.001 * x.x) return 1.0; return 0.0;", 0.601, 0.02, "--target", "zero.npy",
                   "--spp", "64", "--size", "32x32")

    def test_what_it_costs(self):
        """An edge that lines see well is asked about once, at few points. Where something is detached it is not asked."""
        def evaluations(more):
            self.put("s.salt", "param float r = 0.6; [Domain(-1.0, 1.0)] shader float main(float2 x) { "
                     "[Disc] if (length(x) < r + 0.2 * rand()" + more + ") return 1.0; return 0.0; }")
            return self.json_cli("grad", "s.salt", "--integral")["evaluations"]
        without = evaluations(" + 1e-30 * detach(x.x)")
        self.assertLess(without, evaluations(""))
        self.assertLess(evaluations(""), 1.03 * without)


if __name__ == "__main__":
    unittest.main()
