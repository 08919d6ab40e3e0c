"""saltus bound: what is proven of a box, and boxes that are none; the options of estimators with cells."""
import itertools
import math
import random

from harness import *


class Bound(Case):
    SHADERS = {
        1: "[Domain(-1.0, 1.0)] shader float main(float x) { float f = 0.0; [Disc] if (x * x < 0.25) f = 1.0 + x; return f; }",
        2: CIRCLE,
        3: "[Domain(-1.0, 1.0)] shader float2 main(float3 x) { float2 f = float2(0.1); [Disc] if (length(x) < 0.5) f = x.xy; return f; }",
    }

    def boxes(self, dim):
        """Nested boxes around a point of the edge and around one that is far from it."""
        rnd = random.Random(dim)
        for _ in range(3):
            at = [rnd.uniform(-0.6, 0.6) for _ in range(dim)]
            for side in (0.5, 0.05, 1e-3, 0.0):
                yield [(v - side / 2, v + side / 2) for v in at]

    def text(self, box):
        return ";".join("%r,%r" % ends for ends in box)

    def test_points_keep_to_their_box(self):
        for dim, source in self.SHADERS.items():
            self.put("s.salt", source)
            for precision, box in itertools.product(("f32", "f64"), self.boxes(dim)):
                args = ["s.salt", "--box", self.text(box), "--precision", precision]
                j = self.json_cli("bound", *args)
                self.assertLessEqual({"settled", "open", "channels", "unknown", "rough", "count", "warnings"}, set(j))
                self.assertEqual(len(j["channels"]), 2 if dim == 3 else 1)
                if j["settled"]:
                    self.assertEqual((j["open"], j["count"], j["unknown"], j["rough"]), ([], 0, False, False))
                for e in j["open"]:
                    self.assertLessEqual({"site", "line", "column", "index", "g", "dg", "kind"}, set(e))
                    lo, hi = e["g"]
                    self.assertFalse(lo is not None and lo > 0 or hi is not None and hi < 0, e)
                    self.assertEqual(len(e["dg"]), dim)
                text = self.run_cli("bound", *args).out
                self.assertEqual(text.startswith("settled"), j["settled"])
                self.assertEqual(text.count("open: ") + text.count("seam: "), len(j["open"]))

    def test_g_is_the_one_that_is_written(self):
        """Of a length too, whose square cells ask in f64."""
        for precision, written in itertools.product(("f32", "f64"), ("length(x) < r", "1.0 - length(x) / r > 0.0")):
            self.put("s.salt", "param float r = 0.5; [Domain(-1.0, 1.0)] shader float main(float2 x) { float f = 0.0; [Disc] if (%s) f = 1.0; return f; }" % written)
            g = [self.json_cli("bound", "s.salt", "--precision", precision, "--box", box)["open"][0] for box in ("0.3,0.4;0.3,0.5",)][0]
            near, far = math.hypot(0.3, 0.3), math.hypot(0.4, 0.5)
            lo, hi = (near - 0.5, far - 0.5) if "<" in written else (1 - far / 0.5, 1 - near / 0.5)
            for end, want in zip(g["g"], (lo, hi)):
                self.assertAlmostEqual(end, want, 5)
            slopes = [0.3 / math.hypot(0.3, 0.5), 0.4 / math.hypot(0.4, 0.3)]
            if "<" not in written:
                slopes = [-2 * v for v in reversed(slopes)]
            self.assertLessEqual(g["dg"][0][0], slopes[0] + 1e-6)
            self.assertGreaterEqual(g["dg"][0][1], slopes[1] - 1e-6)
            self.assertLess(g["dg"][0][1] - g["dg"][0][0], 1.5)

    def test_textures_stay_between_the_texels_they_reach(self):
        rnd = random.Random(5)
        for kind, sides, channels in (("texture2D", (70, 9), 3), ("texture3D", (6, 5, 7), 1), ("texture3D", (4, 5, 3), 4)):
            dim = len(sides)
            size = math.prod(sides) * channels
            texels = [rnd.uniform(-3, 5) for _ in range(size)]
            self.put("t.npy", write_npy(tuple(reversed(sides)) + (channels,), texels))
            self.put("s.salt", 'param %s t = "t.npy"; shader float main(float%d x) { return t.sample(x)[%d]; }' % (kind, dim, channels // 2))

            def texel(at):
                index = 0
                for n, k in reversed(list(zip(sides, at))):
                    index = index * n + min(max(k, 0), n - 1)
                return texels[index * channels + channels // 2]

            def sample(x):
                p = [(1 - v if a == 1 else v) * n - 0.5 for a, (v, n) in enumerate(zip(x, sides))]
                cell = [math.floor(v) for v in p]
                return sum(texel([c + k for c, k in zip(cell, corner)]) * math.prod(v - c if k else 1 - v + c for v, c, k in zip(p, cell, corner))
                           for corner in itertools.product((0, 1), repeat=dim))
            for width in (0.02, 0.15, 0.3):
                box = [(v, v + min(width, 2.6 / n)) for n, v in zip(sides, [rnd.uniform(-0.05, 0.8) for _ in sides])]
                j = self.json_cli("bound", "s.salt", "--precision", "f64", "--box", self.text(box))
                lo, hi = j["channels"][0]
                ends = [sorted(math.floor((1 - v if a == 1 else v) * n - 0.5) for v in ends) for a, (ends, n) in enumerate(zip(box, sides))]
                reached = [texel(at) for at in itertools.product(*(range(e[0], e[1] + 2) for e in ends))]
                self.assertGreaterEqual(lo, min(reached) - 1e-6)
                self.assertLessEqual(hi, max(reached) + 1e-6)
                for _ in range(50):
                    f = sample([rnd.uniform(*e) for e in box])
                    self.assertTrue(lo - 1e-6 <= f <= hi + 1e-6, (f, lo, hi))

    def test_bad_boxes(self):
        for dim, source in self.SHADERS.items():
            self.put("s.salt", source)
            good = ["0,1"] * dim
            bad = ["", "0", "0,1,2", "a,b", "0;1", "nan,1", "0,nan", "-inf,inf", "0,1e300", "1,0", "0 1", "0,1;"]
            for text in bad:
                axes = list(good)
                axes[dim - 1] = text
                box = ";".join(axes)
                r = self.run_cli("bound", "s.salt", "--box", box, code=2)
                self.assertEqual(r.out, "")
                self.assertTrue(r.err.startswith("saltus: "), r.err)
            for n in range(5):
                self.run_cli("bound", "s.salt", "--box", ";".join(["0,1"] * n), code=0 if n == dim else 2)
        self.put("s.salt", self.SHADERS[1])
        self.run_cli("bound", "s.salt", "--box", "0,1e300", "--precision", "f64")
        self.run_cli("bound", "s.salt", "--box=-1,-0.5")
        self.run_cli("bound", "nothing.salt", code=4)
        self.run_cli("bound", "s.salt", "--box", code=2)
        self.run_cli("render", "s.salt", "--box", "0,1", code=2)

    def test_without_a_box_it_is_the_domain(self):
        self.put("s.salt", self.SHADERS[1])
        self.assertEqual(self.run_cli("bound", "s.salt").out, self.run_cli("bound", "s.salt", "--box", "-1,1").out)


class Explain(Case):
    def test_seams_and_what_has_no_bounds(self):
        self.put("s.salt", """param float r = 0.5;
[Domain(-1.0, 1.0)] shader float main(float2 x) {
    float f = max(x.x,
                  0.2);
    if (x.y < 0.3) f = f + 1.0;
    f = f + floor(4.0 * x.x);
    [Disc] if (length(x) < r) f = f + rand();
    return f;
}""")
        b = self.json_cli("explain", "s.salt")["bounds"]
        self.assertEqual(sorted(s["line"] for s in b["seams"]), [3, 5, 6])
        seams = sorted(b["seams"], key=lambda s: s["line"])
        self.assertEqual([(s["text"], s["what"]) for s in seams], [("max", "kink"), ("<", "jump"), ("floor", "jump")])
        self.assertEqual([(u["line"], "rand()" in u["what"]) for u in b["unbounded"]], [(7, True)])
        self.assertEqual(b["boxes"], b["settled"] + b["open"] + b["unknown"])
        text = self.run_cli("explain", "s.salt").out
        self.assertIn("s.salt:7:", text[text.index("without bounds"):])

    def test_picture(self):
        import xml.dom.minidom
        self.put("c.salt", CIRCLE)
        self.put("one.salt", "[Domain(-1.0, 1.0)] shader float main(float x) { float f = 0.0; [Disc] if (x * x < 0.25) f = 1.0 + x; return f; }")
        for name in ("c", "one"):
            j = self.json_cli("explain", name + ".salt", "--cells", name + ".svg")
            self.assertAlmostEqual(j["settled"] + j["curved"] + j["left"], 1, delta=1e-6)
            self.assertEqual(j["outputs"], [name + ".svg"])
            self.assertLess(j["left"], 1e-3)
            svg = xml.dom.minidom.parseString(self.get(name + ".svg")).documentElement
            self.assertEqual(svg.tagName, "svg")
            self.assertEqual(sum(p.getAttribute("d").count("z") for p in svg.getElementsByTagName("path")), j["cells"])
            self.assertEqual(len(svg.getElementsByTagName("text")), 3)
            self.assertTrue(svg.getElementsByTagName("image")[0].getAttribute("href").startswith("data:image/png;base64,"))
        # The points of the circle lie on it: 720 pixels for the domain [-1, 1], y down.
        circles = xml.dom.minidom.parseString(self.get("c.svg")).getElementsByTagName("circle")
        self.assertGreater(len(circles), 20)
        for p in circles:
            x, y = float(p.getAttribute("cx")) / 360 - 1, 1 - float(p.getAttribute("cy")) / 360
            self.assertAlmostEqual(math.hypot(x - 0.1, y + 0.05), 0.4, delta=1e-4)
        self.put("three.salt", "shader float main(float3 x) { return x.x; }")
        self.run_cli("explain", "three.salt", "--cells", "a.svg", code=2)
        self.run_cli("explain", "c.salt", "--cells", "nowhere/a.svg", code=5)


class Estimate(Case):
    """What estimators with cells print."""

    def test_json(self):
        self.put("c.salt", CIRCLE)
        j = self.json_cli("grad", "c.salt", "--error", "1e-9", "--precision", "f64")
        self.assertEqual((j["stderr_kind"], j["left"], j["left_bound"], j["stopped"]), ("quadrature", 0, 0, None))
        self.assertAlmostEqual(j["certified"], 1, delta=1e-9)
        self.assertAlmostEqual(j["settled"] + j["curved"], j["certified"], delta=1e-9)
        self.assertTrue(0 < j["boxes"] < j["evaluations"] < 100000)
        self.assertAlmostEqual(j["gradient"]["radius"], 0.75 * 2 * math.pi * 0.4, delta=4e-9)
        self.assertAlmostEqual(j["integral"][0], 1 + 0.75 * math.pi * 0.16, delta=4e-9)
        self.assertEqual(set(j["gradient_left_bound"]), set(j["gradient"]))
        text = self.run_cli("grad", "c.salt", "--error", "1e-9", "--precision", "f64")
        self.assertIn("certified", text.err)
        self.assertIn("1.8849555", text.out)
        j = self.json_cli("grad", "c.salt", "--estimator", "lattice")  # nothing is proven by looking at points
        self.assertEqual((j["certified"], j["left"], j["left_bound"], j["stopped"]), (0, 1, None, None))
        self.assertEqual(self.json_cli("grad", "c.salt")["stderr_kind"], "quadrature")

    def test_stopped(self):
        """The result is printed all the same."""
        self.put("c.salt", CIRCLE)
        j = self.json_cli("grad", "c.salt", "--error", "1e-12", "--precision", "f64", "--max-evaluations", 500, code=6)
        self.assertEqual(j["stopped"], "evaluations")
        self.assertIn("radius", j["gradient"])
        r = self.run_cli("grad", "c.salt", "--error", "1e-12", "--precision", "f64", "--max-evaluations", 500, code=6)
        self.assertIn("radius", r.out)
        self.assertIn("not reached", r.err)
        j = self.json_cli("grad", "c.salt", "--error", "1e-15", "--precision", "f32", code=6)
        self.assertEqual(j["stopped"], "rounding")
        self.assertLess(j["evaluations"], 1e6)

    def test_an_error_without_cells(self):
        """Lines and samples go on too, or say that they will not get there."""
        self.put("r.salt", "param float r = 0.5; [Domain(-1.0, 1.0)] shader float main(float2 x) { float f = rand(); [Disc] if (length(x) < r) f = 2.0; return f; }")
        j = self.json_cli("grad", "r.salt", "--samples", 4096, "--error", "1e-3")
        self.assertLess(j["stderr"]["r"], 1e-3 * j["gradient"]["r"])
        self.assertGreater(j["samples"], 2 * 4096)
        self.assertEqual(j["stopped"], None)
        for estimator in ("auto", "quadrature"):
            j = self.json_cli("grad", "r.salt", "--samples", 4096, "--error", "1e-7", "--estimator", estimator, code=6)
            self.assertEqual(j["stopped"], "evaluations")
        r = self.run_cli("grad", "r.salt", "--samples", 4096, "--error", "1e-7", code=6)
        self.assertIn("not reached", r.err)

    def test_pixels_whose_edges_are_no_floats(self):
        """Cells end on the rounded edge, and are not cut there again."""
        self.put("e.salt", "param float r = 0.3333; [Domain(-1.0, 1.0)] shader float main(float2 x) { [Disc] if (x.y + 0.37 * x.x < r) return 1.0; return 0.0; }")
        j = self.json_cli("grad", "e.salt", "--wrt", "r", "--size", "9x11", "--spp", 16, "--error", "1e-5", "--max-evaluations", 100000, "-o", "e.npy")
        self.assertEqual((j["left"], j["stopped"]), (0, None))

    def test_a_small_sphere_by_default(self):
        """A trial of tiles must not cost more than cells of all sizes would: no sample meets so small a solid."""
        self.put("s.salt", "param float r = 0.001; [Domain(-1.0, 1.0)] shader float main(float3 x) { [Disc] return length(x - 0.3) < r ? 1.0 : 0.0; }")
        j = self.json_cli("grad", "s.salt", "--precision", "f64")
        self.assertEqual(j["stderr_kind"], "quadrature")
        self.assertAlmostEqual(j["gradient"]["r"], 4 * math.pi * 1e-6, delta=1e-8)

    def test_a_g_that_jumps_over_0(self):
        """Where an untagged floor makes a tagged decision, nothing is certified there, and the crossing is said to be dropped."""
        self.put("j.salt", "param float t = 0.3; shader float main(float2 x) { [NoDisc] float k = floor(4.0 * x.x - t); [Disc] if (k + 0.0001 * (x.x - 0.3) < 1.5) return 1.0; return 0.0; }")
        j = self.json_cli("grad", "j.salt", "--estimator", "quadrature")
        self.assertGreater(j["left"], 0)
        self.assertGreater(sum(j["dropped"].values()), 0)

    def test_fixed_rules_converge(self):
        self.put("c.salt", CIRCLE)
        error = [abs(self.json_cli("grad", "c.salt", "--gauss", q, "--estimator", "quadrature", "--precision", "f64")["gradient"]["radius"] - 0.6 * math.pi) for q in (2, 4, 6)]
        self.assertLess(error[1], error[0] / 10)
        self.assertLess(error[2], error[1] / 10)

    def test_nothing_to_certify(self):
        """rand() has no bounds: the lattice, and nothing certified."""
        self.put("r.salt", "param float r = 0.5; [Domain(-1.0, 1.0)] shader float main(float2 x) { float f = rand(); [Disc] if (length(x) < r) f = 2.0; return f; }")
        for estimator in ("quadrature", "auto"):
            j = self.json_cli("grad", "r.salt", "--estimator", estimator, "--samples", 4096)
            self.assertEqual((j["certified"], j["left"]), (0, 1))
            self.assertIn(j["stderr_kind"], ("replicates", "bound"))

    def test_nothing_to_find(self):
        """Without a site, and without anything that bends: Gauss points alone."""
        for dim, source in enumerate(("float x) { return exp(a * x); }", "float2 x) { return exp(a * x.x); }", "float3 x) { return exp(a * x.x) * x.y; }")):
            self.put("s.salt", "param float a = 2.0; shader float main(" + source)
            j = self.json_cli("grad", "s.salt", "--error", "1e-9", "--precision", "f64")
            self.assertAlmostEqual(j["certified"], 1, delta=1e-9)
            self.assertEqual((j["curved"], j["left"]), (0, 0))
            scale = 0.5 if dim == 2 else 1
            self.assertAlmostEqual(j["integral"][0], scale * (math.exp(2) - 1) / 2, delta=1e-8)
            self.assertAlmostEqual(j["gradient"]["a"], scale * (math.exp(2) + 1) / 4, delta=1e-8)

    def test_exact_pixels(self):
        """Antialiasing that is exact: each pixel of a half plane is its covered part."""
        self.put("h.salt", "[Domain(0.0, 1.0)] shader float main(float2 x) { float f = 0.0; [Disc] if (x.y < 0.3 + 0.2 * x.x) f = 1.0; return f; }")
        self.run_cli("render", "h.salt", "--exact", "--size", 8, "-o", "h.npy")
        (h, w), v = read_npy(self.get("h.npy"))[0][:2], read_npy(self.get("h.npy"))[1]
        def below(a, b):  # of pixel columns from a to b, the mean of the clamped height over the row from y to y + 1/8
            n = 1000
            return [min(max(0.3 + 0.2 * (a + (b - a) * (i + 0.5) / n), 0), 1) for i in range(n)]
        for row in range(h):
            y = 1 - (row + 1) / h
            for col in range(w):
                heights = below(col / w, (col + 1) / w)
                want = sum(min(max((t - y) * h, 0), 1) for t in heights) / len(heights)
                self.assertAlmostEqual(v[row * w + col], want, delta=2e-4)

    def test_check(self):
        """Values without noise: one difference says it, with a small error; a jump that was left out is seen."""
        self.put("c.salt", CIRCLE)
        j = self.json_cli("check", "c.salt", "--estimator", "quadrature", "--precision", "f64")
        self.assertTrue(j["pass"])
        radius = j["rows"][0]
        self.assertEqual(radius["param"], "radius")
        self.assertAlmostEqual(radius["fd"], 0.6 * math.pi, delta=1e-5)
        self.assertLess(radius["fd_stderr"], 1e-3)
        self.put("n.salt", CIRCLE.replace("[Disc]", "[NoDisc]"))
        self.assertFalse(self.json_cli("check", "n.salt", "--estimator", "quadrature", "--precision", "f64", code=1)["pass"])

    def test_says_nothing(self):
        """A row that would pass whatever it was does not: it says so."""
        self.put("n.salt", "param float a = 0.3;\nshader float main(float2 x) { return a * sin(900.0 * rand()); }")
        text = self.run_cli("check", "n.salt", "--samples", 256, code=6).out
        self.assertIn("\n1 of 1 rows say nothing: their +- is larger than the derivative", text)
        self.assertNotIn("PASS", text)
        j = self.json_cli("check", "n.salt", "--samples", 256, code=6)
        self.assertEqual((j["pass"], j["rows"][0]["pass"], j["rows"][0]["says_nothing"]), (False, False, True))
        self.assertIn("--samples", j["why"])
        self.put("c.salt", CIRCLE)
        self.assertNotIn("say nothing", self.run_cli("check", "c.salt").out)

    def test_values_that_cells_sample(self):
        """Cells state more of two values than these differ by: lines, whose noise is common to both, tell."""
        self.put("f.frag", """uniform float k;
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
        row = self.json_cli("check", "f.frag", "--param", "k=0.0137", "--size", "256x144", "--estimator", "quadrature")["rows"][0]
        self.assertTrue(row["pass"])
        self.assertLess(row["error"], 0.5 * abs(row["ad"]))

    def test_losses(self):
        self.put("c.salt", CIRCLE)
        self.run_cli("render", "c.salt", "--exact", "--size", 16, "--param", "radius=0.45", "-o", "t.exr")
        self.run_cli("render", "c.salt", "--exact", "--size", 16, "-o", "a.exr")
        for kind in (["--target", "t.exr"], ["--adjoint", "a.exr"]):
            j = self.json_cli("grad", "c.salt", "--size", 16, "--estimator", "quadrature", *kind)
            self.assertLessEqual({"certified", "left", "left_bound", "stopped", "evaluations", "loss"}, set(j))
            self.assertIn(j["stderr_kind"], ("quadrature", "mixed"))


class Options(Case):
    def test_ranges(self):
        self.put("s.salt", CIRCLE)
        bad = {"--error": ("0", "-1e-3", "nan", "2", "x", ""), "--abs-error": ("0", "-1", "nan", "inf"), "--gauss": ("0", "17", "2.5", "-1"),
               "--max-evaluations": ("0", "-1", "1e6", "2^50"), "--interior": ("exact", ""), "--estimator": ("quadratur",)}
        for option, values in bad.items():
            for v in values:
                r = self.run_cli("grad", "s.salt", option, v, code=2)
                self.assertIn(option, r.err)

    def test_cells_want_the_usual_variant(self):
        self.put("s.salt", CIRCLE)
        for variant in ("argmin", "forced"):
            r = self.run_cli("grad", "s.salt", "--variant", variant, "--estimator", "quadrature", code=2)
            self.assertIn("variant", r.err)
            self.assertEqual(self.json_cli("grad", "s.salt", "--variant", variant)["certified"], 0)

    def test_cells_want_an_estimator_that_has_them(self):
        self.put("s.salt", CIRCLE)
        for option in (("--error", "1e-3"), ("--abs-error", "1e-3"), ("--gauss", 4), ("--max-evaluations", 1000), ("--interior", "quadrature")):
            for estimator in ("lattice", "scanline", "fd"):
                r = self.run_cli("grad", "s.salt", *option, "--estimator", estimator, code=2)
                self.assertIn(option[0], r.err)

    def test_pixels_of_8_bits_are_not_integrated(self):
        self.put("s.salt", CIRCLE)
        r = self.run_cli("render", "s.salt", "--exact", "--format", "rgba8", "-o", "a.png", code=2)
        self.assertIn("middle", r.err)
        self.no_leftovers()

    def test_help_has_them(self):
        text = self.run_cli("grad", "--help").out
        for option in ("--error", "--abs-error", "--gauss", "--max-evaluations", "--interior"):
            self.assertIn("\n  %s " % option, text)
        self.assertNotIn("--exact", text)
        self.assertIn("--exact", self.run_cli("render", "--help").out)


if __name__ == "__main__":
    unittest.main()
