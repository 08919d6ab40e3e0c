"""saltus bound: what is proven of a box, and boxes that are none; the options of estimators with cells."""
import itertools
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


class Options(Case):
    def test_ranges(self):
        self.put("s.salt", CIRCLE)
        bad = {"--error": ("0", "-1e-3", "nan", "2", "x", ""), "--abs-error": ("0", "-1", "nan", "inf"), "--gauss": ("0", "17", "2.5", "-1"),
               "--max-evaluations": ("0", "-1", "1e6", "2^50"), "--interior": ("exact", ""), "--estimator": ("quadratur",)}
        for option, values in bad.items():
            for v in values:
                r = self.run_cli("grad", "s.salt", option, v, code=2)
                self.assertIn(option, r.err)

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
