"""Long straight-line programs: an expression of thousands of operations, line by line a shader (expression.py)."""
import math

from expression import shader
from harness import *


def discs_and_boxes(n):
    """n x n shapes apart, as one formula of more than 2000 operations, and what they cover."""
    lines, area, whole, h = ["x var-x", "y var-y"], 0.0, None, 1.8 / n

    def op(*words):
        lines.append(" ".join(["t%d" % len(lines), *map(str, words)]))
        return lines[-1].split()[0]

    for i in range(n):
        for j in range(n):
            r = 0.3 * h * (1 + 0.2 * math.sin(i + 2 * j))
            u = op("sub", "x", op("const", -0.9 + h * (i + 0.5) + 0.011 * math.sin(7 * i + j)))
            v = op("sub", "y", op("const", -0.9 + h * (j + 0.5) + 0.009 * math.cos(3 * i + 5 * j)))
            c, d = op("const", r), op("const", 0.8 * r)
            if (i + j) % 2:
                g, area = op("sub", op("add", op("square", u), op("square", v)), op("mul", c, c)), area + math.pi * r * r
            else:
                sides = [op("max", op("sub", w, m), op("sub", op("neg", w), m)) for w, m in ((u, c), (v, d))]
                g, area = op("max", *sides), area + 3.2 * r * r
            whole = op("min", whole, g) if whole else g
    return "\n".join(lines), area


class Expression(Case):
    def test_certified(self):
        """Every choice is a seam in the cells where it is open: nothing is left, and what is stated holds."""
        text, area = discs_and_boxes(14)
        self.put("s.salt", shader(text))
        r = self.json_cli("grad", "s.salt", "--integral", "--estimator", "quadrature", "--precision", "f64", "--error", "1e-6",
                          "--max-evaluations", 1 << 21)
        self.assertAlmostEqual(r["integral"][0], area, delta=2e-6)
        self.assertAlmostEqual(r["gradient"]["scale"], -2 * area, delta=2e-6)
        for shift in r["gradient"]["shift"]:
            self.assertAlmostEqual(shift, 0, delta=2e-6)
        self.assertAlmostEqual(r["certified"], 1, delta=1e-9)

    def test_smooth(self):
        """Derivatives of a value that a long formula chooses: kernels of both precisions against differences."""
        text, _ = discs_and_boxes(14)
        source = shader(text).replace("[Disc] if (", "float g = ").replace(" < 0.0) inside = 1.0", "").replace("return inside", "return g * g")
        self.put("s.salt", source)
        h, sums = 1e-6, {}
        for precision, digits in (("f64", 6), ("f32", 3)):
            r = self.json_cli("grad", "s.salt", "--integral", "--estimator", "lattice", "--samples", 1 << 12, "--seed", 5,
                              "--precision", precision)
            sums[precision] = r["gradient"]
            for k, shift in enumerate(r["gradient"]["shift"]):
                moved = []
                for sign in (h, -h):
                    at = [0.0, 0.0]
                    at[k] = sign
                    moved.append(self.json_cli("render", "s.salt", "--integral", "--estimator", "lattice", "--samples", 1 << 12,
                                               "--seed", 5, "--precision", "f64",
                                               "--param", "shift=[%r,%r]" % tuple(at))["integral"][0])
                self.assertAlmostEqual(shift, (moved[0] - moved[1]) / (2 * h), delta=10.0 ** -digits)
        self.assertAlmostEqual(sums["f64"]["scale"], sums["f32"]["scale"], delta=1e-4)
        # Nothing decides, so choices are not looked at by cells either, asked or not.
        for more in ((), ("--estimator", "quadrature"), ("--interior", "quadrature")):
            r = self.json_cli("grad", "s.salt", "--integral", "--samples", 1 << 12, "--seed", 5, "--precision", "f64", *more)
            self.assertEqual(r["gradient"], sums["f64"])

    def test_converted(self):
        """A disc without a square, and where its edge is."""
        self.put("d.salt", shader("# a comment\n_0 var-x\n_1 var-y\n_2 square _0\n_3 square _1\n_4 add _2 _3\n_5 sqrt _4\n_6 const 0.75\n_7 sub _5 _6\n"
                                  "_8 const -0.25\n_9 sub _0 _8\n_a neg _9\n_b max _7 _a\n"))
        r = self.json_cli("render", "d.salt", "--integral", "--samples", 1 << 16, "--seed", 3)
        whole, x = math.pi * 0.75**2, 0.25 / 0.75
        cut = 0.75**2 * (math.acos(x) - x * math.sqrt(1 - x * x))
        self.assertAlmostEqual(r["integral"][0], whole - cut, delta=5e-3)


class Prospero(Case):
    """prospero.vm of $SALTUS_DATA: text of 7 866 operations, most of them min and max."""

    def setUp(self):
        file = os.path.join(os.environ.get("SALTUS_DATA", ""), "prospero.vm")
        if not os.path.isfile(file):
            self.skipTest("SALTUS_DATA has no prospero.vm")
        super().setUp()
        with open(file) as f:
            self.put("p.salt", shader(f.read()))

    def test_image(self):
        """One sample in the middle of each pixel: pruned the same bytes as by points; most pixels are not sampled."""
        size = 192
        self.run_cli("render", "p.salt", "--format", "rgba8", "--size", size, "-o", "p.raw")
        with open(self.path("p.raw"), "rb") as f:
            pixels = f.read()
        self.run_cli("render", "p.salt", "--centres", "--size", size, "-o", "p.npy")
        self.assertEqual([255 * v for v in read_npy(self.get("p.npy"))[1]], list(pixels[::4]))
        inside = sum(pixels[k] > 127 for k in range(0, len(pixels), 4)) / size**2
        r = self.json_cli("render", "p.salt", "--size", size, "--spp", 4)
        self.assertLess(r["evaluations"], 0.9 * r["samples"])
        self.assertAlmostEqual(inside, r["mean"][0], delta=0.01)

    def test_derivatives(self):
        """The text lies inside the domain: its area shrinks with the square of the scale, and moving it changes nothing."""
        r = self.json_cli("grad", "p.salt", "--integral", "--estimator", "lattice", "--segments", 1 << 20, "--samples", 1 << 20)
        self.assertAlmostEqual(r["gradient"]["scale"], -2 * r["integral"][0], delta=0.03)
        for shift in r["gradient"]["shift"]:
            self.assertAlmostEqual(shift, 0, delta=0.1)

    def test_derivatives_of_a_part(self):
        """A 1024th of it, by cells. What a shift changes is what passes the border: lengths inside along its four sides, by
        halving. An arc ends at the end of a stem there, with a slope across the cut that is all rounding."""
        with open(self.path("p.salt")) as f:
            source = f.read()
        self.put("t.salt", source.replace("float2 q = p * scale", "float2 q = (float2(-0.77, 0.78) + p * 0.03125) * scale"))
        r = self.json_cli("grad", "t.salt", "--integral", "--estimator", "quadrature", "--precision", "f64", "--error", "1e-5",
                          "--wrt", "scale,shift", "--max-evaluations", 200000)
        for got, want, error in zip(r["gradient"]["shift"], (-64.0, 0.690634016), r["stderr"]["shift"]):
            self.assertLessEqual(error, 1e-4)
            self.assertLessEqual(abs(got - want), error + 1e-6)


if __name__ == "__main__":
    unittest.main()
