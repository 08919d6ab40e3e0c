"""Stated errors of quadrature: never smaller than true ones, where bounds prove little."""
import math
import random

from harness import *

HEAD = "param float a = 0.37; param float b = 0.61; param float c = 0.23; "


class Left(Case):
    """What cells leave over, on programs whose derivatives are known."""

    def ask(self, source, *options, code=0):
        self.put("s.salt", HEAD + source)
        return self.json_cli("grad", "s.salt", "--estimator", "quadrature", "--precision", "f64", *options, code=code)

    def holds(self, j, want, most):
        for name, value in want.items():
            self.assertLessEqual(abs(j["gradient"][name] - value), j["stderr"][name] + 1e-12, name)
            self.assertLessEqual(j["stderr"][name], most, name)

    def test_a_cut_between_two_floats(self):
        """The angle jumps from pi to -pi along y = a: cells end there, on its two sides, and nothing is left but a gap
        without a measure. A lower half of 1 - x, and the ray of direction c."""
        j = self.ask("shader float main(float2 x) { [Disc] if (atan2(x.y - a, x.x - b) > c) return 1.0; return x.x; }")
        self.holds(j, {"a": -0.5}, 0.4)
        self.assertGreater(j["left"], 0)

    def test_rounding_without_bounds(self):
        """Of pow near 0 nothing bounds what it rounds by, and yet a root is in its cell."""
        g = math.gamma
        area = lambda p, r: 4 * r * r * g(1 + 1 / p) ** 2 / g(1 + 2 / p)
        p, r = 3.7, 0.8
        want = {"r": 2 * area(p, r) / r, "p": (area(p + 1e-5, r) - area(p - 1e-5, r)) / 2e-5}
        j = self.ask("param float p = 3.7; param float r = 0.8; [Domain(-1.0, 1.0)] shader float main(float2 x) "
                     "{ [Disc] if (pow(abs(x.x) / r, p) + pow(abs(x.y) / r, p) < 1.0) return 1.0; return 0.0; }")
        self.holds(j, want, 2)

    def test_a_gradient_of_zero(self):
        """What lines find and cannot integrate counts as what it would weigh."""
        j = self.ask("shader float main(float2 x) { float d = x.x - a; [Disc] if (d * d * d > 0.0) return 1.0; return b; }")
        self.holds(j, {"a": -0.39}, 1.5)

    def test_a_pole(self):
        j = self.ask("shader float main(float2 x) { [Disc] if (tan(3.0 * x.x + a) < 2.0 * x.y) return 1.0; return 0.3 * b; }")
        self.holds(j, {"a": 0.0198793}, 0.2)

    def test_boxes_close_what_is_only_loose(self):
        """A node: a point is left at every size of cells, and nothing of it matters."""
        j = self.ask("shader float main(float2 x) { float2 d = x - float2(a, b); [Disc] if (d.x * d.y > 0.0) return 1.0 + c; return 0.0; }")
        self.holds(j, {"a": 1.23 * 0.22, "b": -1.23 * 0.26}, 1e-7)

    def test_many_primitives(self):
        """Thousands of discs or boxes, of which evaluations leave nearly all: tiles are left as they are, and lines as far
        apart as the primitives are wide, or much farther, miss most of them. What they meet by chance stands for these."""
        repeat = "shader float main(float2 x) { [%s] float2 q = frac(x * %g) - 0.5; "
        discs = repeat + "[Disc] if (length(q) < %g * r) return 1.0; return 0.0; }"
        boxes = repeat + "float2 d = abs(q) - r; [Disc] if (length(max(d, 0.0)) + min(max(d.x, d.y), 0.0) < 0.0) return 1.0; return 0.0; }"
        loops = ("shader float main(float2 x) { float f = 0.0; for (int i = 0; i < 60; i++) for (int j = 0; j < 60; j++) "
                 "{ [Disc] if (length(60.0 * x - float2(i, j) - 0.5) < r) f = 1.0; } return f; }")
        cases = (("0.3", discs % ("Disc", 1000, 1), 0.6 * math.pi), ("0.03", discs % ("Disc", 200, 1), 0.06 * math.pi),
                 ("0.3", discs % ("NoDisc", 200, 1), 0.6 * math.pi), ("0.3", boxes % ("Disc", 128), 2.4), ("0.3", loops, 0.6 * math.pi))
        for radius, source, want in cases:
            with self.subTest(source=source):
                j = self.ask("param float r = %s; " % radius + source)
                self.assertLess(abs(j["gradient"]["r"] - want), 2 * j["stderr"]["r"])
                self.assertLess(j["stderr"]["r"], 1.5 * want)

    def test_a_solid_that_is_not_finished(self):
        """A ball without two boxes, of which evaluations leave thousands of cells over: few are looked at, and what
        belongs to a face that none of them has is stated all the same. Known from points on the faces of each."""
        self.put("s.salt", """import sdf;
            param float3 a = float3(-0.182, -0.261, 0.195); param float p = 0.585;
            param float3 b = float3(0.246, -0.005, -0.257); param float3 q = float3(0.281, 0.585, 0.56);
            param float3 c = float3(0.095, 0.296, -0.293); param float r = 0.607;
            float box(float3 p, float3 h) { float3 d = abs(p) - h; float m = d.z; if (d.x > m) m = d.x; if (d.y > m) m = d.y; return m; }
            [Domain(-1.0, 1.0)] shader float main(float3 x) {
                float d = length(x - c) - r, e = sd_box(x - a, float3(p)), g = box(x - b, q);
                if (g < e) e = g;
                if (-e > d) d = -e;
                [Disc] if (d < 0.0) return 1.0;
                return 0.0;
            }""")
        want = {"a": [0, -0.258046, 0.217837], "p": [-0.475883], "b": [-0.011323, -0.543011, 0.206790],
                "q": [-1.005615, -0.543011, -0.235612], "c": [0.011327, 0.801050, -0.424624], "r": [2.882927]}
        off = []  # in stated errors
        for most in 250000, 350000, 500000, 700000, 1000000, 2000000, 4000000:
            j = self.json_cli("grad", "s.salt", "--integral", "--estimator", "quadrature", "--precision", "f64",
                              "--error", "1e-3", "--max-evaluations", most, code=None)
            for name, values in want.items():
                got, bar = j["gradient"][name], j["stderr"][name]
                if len(values) == 1: got, bar = [got], [bar]
                for k, value in enumerate(values):
                    off.append(max(0, abs(got[k] - value) - 1e-4) / max(bar[k], 1e-9))
        self.assertLessEqual(max(off), 3)
        self.assertGreaterEqual(sum(z <= 2 for z in off) / len(off), 0.95)

    def test_edges_of_a_solid(self):
        """A box without another: cells along an edge are alike, and lines at the same places of all of them erred
        alike."""
        self.put("s.salt", """import sdf; param float3 c = float3(-0.289, 0.03, -0.157); param float3 p = float3(0.371, 0.489, 0.448);
            param float3 d = float3(-0.04, -0.063, -0.02); param float3 q = float3(0.265, 0.391, 0.637);
            float box(float3 p, float3 h) { float3 d = abs(p) - h; return max(d.x, max(d.y, d.z)); }
            [Domain(-1.0, 1.0)] shader float main(float3 x) {
                bool first = false, other = false;
                [Disc] if (box(x - c, p) < 0.0) first = true;
                [Disc] if (sd_box(x - d, q) < 0.0) other = true;
                return first && !other ? 1.0 : 0.0;
            }""")
        want = {"c": [-0.700672, 0, 0], "p": [1.051904, 1.329664, 0.846084], "d": [0.700672, 0, 0], "q": [-0.700672, -0.693504, 0]}
        for most in 300000, 700000, 1500000:
            j = self.json_cli("grad", "s.salt", "--integral", "--estimator", "quadrature", "--precision", "f64",
                              "--error", "1e-3", "--max-evaluations", most, code=None)
            for name, values in want.items():
                for k, value in enumerate(values):
                    self.assertLessEqual(abs(j["gradient"][name][k] - value), 2.5 * j["stderr"][name][k] + 1e-4, (most, name, k))

    def test_a_step_in_one_dimension(self):
        """Lines are exact there."""
        j = self.ask("shader float main(float x) { float h = b; [Disc] if (x < a) h = c; [Disc] if (x < h) return 1.0; return 0.0; }")
        self.holds(j, {"a": -1, "b": 1, "c": 1}, 1e-9)


class Shared(Case):
    """Boxes in one formula that share edges: g bends in its own curve, in the gap between two floats where cells are
    cut, or as far off as two ways of writing one number round. Scaled or moved as a whole such a drawing has the area
    that it has: -2 A by scale, nothing by shift."""

    def drawing(self, area, *boxes, combine="min(g, %s)", k=8.13008):
        lines = "".join("g = %s; " % (combine if i else "min(1.0, %s)").replace("%s", box) for i, box in enumerate(boxes))
        self.put("s.salt", "param float scale = 1.0; param float2 shift = float2(0.0, 0.0); "
                 "shader float main(float2 p) { float2 q = (p * scale + shift) * %r; float x = q.x; float y = q.y; "
                 "float g; %s [Disc] if (g < 0.0) return 1.0; return 0.0; }" % (k, lines))
        for error in ("1e-6", "1e-9"):  # two trees
            j = self.json_cli("grad", "s.salt", "--integral", "--estimator", "quadrature", "--precision", "f64",
                              "--error", error, "--max-evaluations", "2000000")
            self.assertEqual(j["left"], 0)
            for got, want in zip([j["gradient"]["scale"], *j["gradient"]["shift"]], (-2 * area, 0, 0)):
                self.assertAlmostEqual(got, want, delta=1e-12)

    def test_stems_under_a_bar(self):
        self.drawing((0.725 + 0.1 + 1.175 * 0.1) / 8.13008**2,
                     "max(max(max(2.95 - x, x - 3.675), 5.3 - y), y - 6.3)",
                     "max(max(max(4.025 - x, x - 4.125), 5.3 - y), y - 6.3)",
                     "max(max(max(2.95 - x, x - 4.125), 5.2 - y), y - 5.3)")

    def test_written_in_two_ways(self):
        """Between the boxes rounding leaves a strip of a few floats, with two pieces of one g on its sides."""
        self.drawing(2 * 0.7 / 8.13008**2,
                     "max(max(max(1.3 - x, (x + 0.7) - 3.1), 5.3 - y), y - 6.0)",
                     "max(max(max((2.4 + 0.9) - (x + 0.9), x - 3.3), 5.3 - y), y - 6.0)")

    def test_three_at_a_corner(self):
        """What g is beside the gap hangs on the place along it: only slopes at all of its points tell."""
        x, X = 1.0408682623684957, 1.2134029706878944
        y, Y = 1.0283930375425516, 2.7821370317920113
        self.drawing(((x - 0.38732662329201806) * (Y - y) + (X - x) * (1.0740616491406256 - y + Y - 1.2479281968925098))
                     / 3.7**2,
                     "max(max(max(%r - x, -(%r - x)), -(y - %r)), y - 1.0740616491406256)" % (x, X, y),
                     "max(max(0.38732662329201806 - x, x - %r), max(0.9578509919610367 - (y + -0.07054204558151489), "
                     "(y + -0.07054204558151489) - 2.711594986210496))" % x,
                     "max(max(%r - x, x - %r), max(1.2479281968925098 - y, y - %r))" % (x, X, Y), k=3.7)

    def test_a_box_less_another(self):
        self.drawing((2 * 2 - 0.5 * 1) / 8.13008**2, "max(max(1.5 - x, x - 3.5), max(2.25 - y, y - 4.25))",
                     "max(max(1.5 - x, x - 2.0), max(2.25 - y, y - 3.25))", combine="max(g, -(%s))")

    def test_few_evaluations(self):
        """Boxes between five places along each axis, written in two ways: cells are left on one side of a gap that holds
        the strip between two boxes. Lines through them end where the gap begins, and count nothing that it counts."""
        for seed in (4, 5, 9):
            rng = random.Random(seed)
            xs, ys = (sorted(rng.uniform(0.1, 0.9) for _ in range(5)) for _ in range(2))
            lines, cells = "", set()
            for _ in range(8):
                (i, j), (l, m), o = sorted(rng.sample(range(5), 2)), sorted(rng.sample(range(5), 2)), rng.uniform(-1, 1)
                X, Z, Y, T = (8.13008 * v for v in (xs[i], xs[j], ys[l], ys[m]))
                lines += rng.choice(("g = min(g, max(max(max(%r - x, -(%r - x)), -(y - %r)), y - %r)); " % (X, Z, Y, T),
                                     "g = min(g, max(max(%r - x, x - %r), max(%r - (y + %r), (y + %r) - %r))); "
                                     % (X, Z, Y + o, o, o, T + o)))
                cells |= {(p, q) for p in range(i, j) for q in range(l, m)}
            area = sum((xs[p + 1] - xs[p]) * (ys[q + 1] - ys[q]) for p, q in cells)
            self.put("s.salt", "param float scale = 1.0; param float2 shift = float2(0.0, 0.0); "
                     "shader float main(float2 p) { float2 q = (p * scale + shift) * 8.13008; float x = q.x; float y = q.y; "
                     "float g = 1.0; %s [Disc] if (g < 0.0) return 1.0; return 0.0; }" % lines)
            for most in ("5000", "12000", "30000"):
                j = self.json_cli("grad", "s.salt", "--integral", "--estimator", "quadrature", "--precision", "f64",
                                  "--error", "1e-6", "--max-evaluations", most, code=6)
                for got, want, error in zip([j["gradient"]["scale"], *j["gradient"]["shift"]], (-2 * area, 0, 0),
                                            [j["stderr"]["scale"], *j["stderr"]["shift"]]):
                    self.assertLessEqual(abs(got - want), 2 * error)

    def test_a_distance_taken_twice(self):
        """The two parts of a ring overlap: a choice between values that are the same but for rounding, of which bounds
        see slopes. Boxes out of sight make the formula one that is cut into chunks."""
        far = "".join("g = min(g, max(max(%r - x, x - %r), max(%r - y, y - %r))); " % (20.5 + i, 21.0 + i, 20.5 - i, 21.0 - i)
                      for i in range(200))
        self.put("s.salt", "param float scale = 1.0; param float2 shift = float2(0.0, 0.0); param float outer = 5.7; "
                 "[Domain(-1.0, 1.0)] shader float main(float2 p) { float2 q = (p * scale + shift) * 8.13; "
                 "float x = q.x; float y = q.y; float g = 1.0; %s"
                 "float a = sqrt((x - 0.2) * (x - 0.2) + (y + 0.3) * (y + 0.3)); "
                 "float b = sqrt(((x - 1.7) + 1.5) * ((x - 1.7) + 1.5) + (y + 0.3) * (y + 0.3)); "
                 "g = min(g, max(max(a - outer, 3.0 - a), x + 0.1 * y - 0.5)); "
                 "g = min(g, max(max(b - outer, 3.0 - b), -0.1 - x - 0.1 * y)); "
                 "[Disc] if (g < 0.0) return 1.0; return 0.0; }" % far)
        j = self.json_cli("grad", "s.salt", "--integral", "--estimator", "quadrature", "--precision", "f64", "--error", "1e-6")
        self.assertEqual(j["left"], 0)
        area = math.pi * (5.7**2 - 3.0**2) / 8.13**2
        for got, want in zip([j["gradient"]["scale"], *j["gradient"]["shift"], j["gradient"]["outer"]],
                             (-2 * area, 0, 0, 2 * math.pi * 5.7 / 8.13**2)):
            self.assertAlmostEqual(got, want, delta=1e-8)
        self.assertLess(j["evaluations"], 150000)


class Rules(Case):
    """Where all is certified: the distance of two rules, on pieces that converge slowly beside others that do not."""

    def check(self, body):
        self.put("s.salt", HEAD + "shader float main(float2 x) { %s }" % body)
        ask = lambda *o: self.json_cli("grad", "s.salt", "--estimator", "quadrature", "--precision", "f64", *o)
        best = ask("--error", "1e-11")
        for options in ((), ("--error", "1e-3"), ("--error", "1e-4"), ("--error", "1e-7")):
            j = ask(*options)
            self.assertEqual(j["left"], 0)
            for name, value in best["gradient"].items():
                most = j["stderr"][name] + best["stderr"][name] + 1e-12
                self.assertLessEqual(abs(j["gradient"][name] - value), most, (name, options))

    def test_a_power_at_its_zero(self):
        self.check("[Disc] if (pow(x.x, 1.0 + b) + pow(x.y, 0.5 + a) < 0.7 + c) return 1.0; return 0.2 * x.x;")

    def test_a_gear(self):
        self.check("float2 p = x - 0.5; float2 u = p / max(length(p), 1e-3); float k = 4.0 * u.x * u.x * u.x - 3.0 * u.x; "
                   "[Disc] if (length(p) < 0.3 + 0.2 * a * k) return exp(-c * dot(p, p)) + b; return 0.0;")

    def test_threads(self):
        """Cells of edges that have decisions given: the same bits, and as many evaluations, on any number of threads."""
        path = os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../examples/voronoi_mosaic/mosaic.salt")
        seen = set()
        for threads in (1, 2, 3, 5):
            j = self.json_cli("grad", path, "--integral", "--estimator", "quadrature", "--precision", "f64", "--threads", threads)
            j.pop("seconds")
            seen.add(str(j))
        self.assertEqual(len(seen), 1)

    def test_volume_that_is_only_sampled(self):
        """Where three inks meet, the one that no point has met may have a part: the evaluations end before that is known."""
        path = os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../examples/voronoi_mosaic/mosaic.salt")
        ask = lambda *o: self.json_cli("grad", path, "--integral", "--estimator", "quadrature", "--precision", "f64", *o)
        best, j = ask("--error", "1e-7"), ask()
        for seed, error, want in zip(j["gradient"]["seeds"], j["stderr"]["seeds"], best["gradient"]["seeds"]):
            for c in range(3):
                self.assertLessEqual(abs(seed["ink"][c][c] - want["ink"][c][c]), error["ink"][c][c] + 1e-12)

    def test_volume_beside_curves(self):
        """Folds that a `break` ends: curves of one cell have no height axis in common, kinks lie between them, or the
        evaluations end before the volume is cut, of which two points told nothing. The bar was ten times the lattice's."""
        self.put("s.frag", """uniform float k;
            float box(vec2 p, vec2 b) { vec2 d = abs(p) - b; return length(max(d, 0.)) + min(max(d.x, d.y), 0.); }
            void mainImage(out vec4 o, vec2 at) {
                vec2 p = (2. * at - iResolution.xy) / iResolution.y, q = p - vec2(.375 + sin(k), k * k + k - .398);
                q.x += .057 * sin(q.y * 3.465 + k * 3.);
                for (int i = 0; i < 3; i++) {
                    q = abs(q) - .3 - k * .15, q *= mat2(cos(.5), -sin(.5), sin(.5), cos(.5));
                    if (q.x > .618) break;
                }
                float c = q.x * .586 + q.y * .372 + .026 - k * .5 < 0. ? .2 : .1;
                o = vec4(mix(c, 1. - c, smoothstep(.03, -.03, box(p - vec2(k * k + k - .304, .335 + k * .5), vec2(.28 - k, .239)))));
            }""")
        ask = lambda *o: self.json_cli("grad", "s.frag", "--integral", "--param", "k=0.0137", "--size", "256x144", *o)
        lines, best = ask("--estimator", "lattice"), ask("--estimator", "lattice", "--samples", 1 << 22)
        for estimator in ("auto", "quadrature"):
            j = ask("--estimator", estimator)
            self.assertLessEqual(abs(j["gradient"]["k"][0] - best["gradient"]["k"][0]),
                                 2 * (j["stderr"]["k"][0] + best["stderr"]["k"][0]))
            self.assertLessEqual(j["stderr"]["k"][0], 3 * lines["stderr"]["k"][0], estimator)

    def test_auto_turns_where_cells_state_much(self):
        """Steep shading without jumps that move: the rules agree on the value to what is asked, not on its derivative, and
        finer ones cost more than the lattice, which states a 30th."""
        self.put("s.frag", """uniform float k;
            void mainImage(out vec4 o, vec2 at) {
                vec2 p = (2. * at - iResolution.xy) / iResolution.y, q = p - vec2(.037 - k, .265 + sin(k));
                float w = 6.2831853 / 6., a = mod(atan(q.y, q.x) + .5 * w, w) - .5 * w, c = .1;
                q = length(q) * vec2(cos(a), sin(a));
                c = mix(c, 1. - c, smoothstep(.03, -.03, abs(length(q) - .459 - k * k + k) - .068));
                q = p - vec2(.537 + k * .5, .001 + k);
                for (int i = 0; i < 3; i++) {
                    q = abs(q) - .3 + k * .3, q *= mat2(cos(.5), -sin(.5), sin(.5), cos(.5));
                    if (q.x > .374) break;
                }
                o = vec4(mix(c, 1. - c, smoothstep(.03, -.03, (q.x - q.y) * .953 - .081 - k)));
            }""")
        ask = lambda *o: self.json_cli("grad", "s.frag", "--integral", "--param", "k=0.0137", "--size", "256x144", *o)
        lines, cells, j = ask("--estimator", "lattice"), ask("--estimator", "quadrature"), ask()
        self.assertGreater(cells["stderr"]["k"][0], 20 * lines["stderr"]["k"][0])
        for key in ("gradient", "stderr", "stderr_kind", "missed_estimate", "gradient_left_bound"):
            self.assertEqual(j.get(key), lines.get(key), key)

    def test_auto_stays_where_lines_are_blind(self):
        """Jumps that nothing tracks: cells state what lines do not see, and a narrower bar is no better one."""
        self.put("s.salt", HEAD + "shader float main(float2 x) { float h = floor(4.0 * x.x + a); "
                 "[Disc] if (h > 2.0) return 1.0; return 0.0; }")
        for estimator in ("auto", "quadrature"):
            self.assertGreater(self.json_cli("grad", "s.salt", "--integral", "--estimator", estimator)["stderr"]["a"], 0.2)

    def test_a_root_at_the_edge(self):
        """Shading that falls like a root of the distance: the nearest floats to the curve see a hundredth of it."""
        self.put("s.salt", HEAD + "shader float main(float2 x) { float2 d = x - float2(a, b); float q = dot(d, d); "
                 "[Disc] if (q < c * c) return sqrt(max(c * c - q, 0.0)); return 0.1; }")
        want = {"a": 0, "b": 0, "c": 2 * math.pi * 0.23 * (0.23 - 0.1)}
        for options in (("f64",), ("f64", "--error", "1e-4"), ("f64", "--gauss", "12"), ("f32", "--error", "1e-4")):
            j = self.json_cli("grad", "s.salt", "--estimator", "quadrature", "--precision", *options)
            for name, value in want.items():
                self.assertLessEqual(abs(j["gradient"][name] - value), j["stderr"][name] + 1e-12, (name, options))

    def test_rounding_of_curves(self):
        """In f32 it is part of what derivatives of shading state, which jump where f does, or where it does not: thin bands
        in one, two and three dimensions, a small disc."""
        disc = math.pi * 1e-8  # its area
        programs = [("float x", "abs(x - 0.6131) < w", "A", 0, 2), ("float x", "abs(x - 0.317) < w", "A", 1, 2)]
        for a in 0.15, 0.3, 0.42:
            for jumps in 0, 1:
                programs.append(("float2 x", "abs(x.y - %g - 0.3 * x.x * x.x) < w" % a, "A", jumps, 2))
            programs.append(("float2 x", "abs(x.y - %g - 0.3 * x.x * x.x) < w" % a, "A * (1.0 + x.x)", 0, 3))
            programs.append(("float3 x", "abs(x.y - %g - 0.3 * x.x * x.z) < w" % a, "A", 0, 2))
        for x, condition, f, outside, slope in programs:
            for w in (1e-4, 1e-5) if x != "float3 x" else (1e-3,):
                self.put("s.salt", "param float A = 1.0; param float w = %g; shader float main(%s) { float f = %d.0; "
                         "[Disc] if (%s) f = %s; return f; }" % (w, x, outside, condition, f))
                j = self.json_cli("grad", "s.salt", "--integral", "--estimator", "quadrature")
                with self.subTest(condition=condition, w=w, outside=outside):
                    self.assertLessEqual(abs(j["gradient"]["A"] - slope * w), j["stderr"]["A"])
                    self.assertLessEqual(j["stderr"]["A"], 1e-6 if x != "float3 x" else 0.25 * w)
        self.put("s.salt", "param float A = 1.0; param float r = 1e-4; [Domain(-1.0, 1.0)] shader float main(float2 x) { float f = 0.0; "
                 "[Disc] if (length(x - float2(0.613, 0.317)) < r) f = A; return f; }")
        j = self.json_cli("grad", "s.salt", "--integral", "--estimator", "quadrature")
        self.assertLessEqual(abs(j["gradient"]["A"] - disc), j["stderr"]["A"])
        self.assertLessEqual(j["stderr"]["A"], 1e-3 * disc)


if __name__ == "__main__":
    unittest.main()
