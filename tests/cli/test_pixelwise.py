"""Shaders that are one colour all over a pixel: one sample tells it, and there is no error to state."""

from harness import *

# Exact coverage of each pixel by a half-plane's shadow: of its place in the image alone.
ROWS = """
param float a = 0.3;
param float2 b = float2(0.2, 0.7);
shader float main(float2 x) {
    float2 at = float2(pixel()) / float2(resolution());
    return a * a + dot(at, b) + sin(at.x);
}
"""


class Pixelwise(Case):
    def test_integral(self):
        """Of visible pieces, which have no bounds, one sample is taken of an integral too."""
        self.put("s.salt", ROWS)
        j = self.json_cli("grad", "s.salt", "--integral", "--precision", "f64")
        self.assertAlmostEqual(j["integral"][0], 0.09, places=14)
        self.assertAlmostEqual(j["gradient"]["a"], 0.6, places=14)
        self.put("m.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
        self.put("s.salt", """param mesh m = "m.obj";
            shader float main(float2 x) {
                Beam b = { float3(0.0, 0.0, 1.0), float3(-1.0, -1.0, 0.0), float3(2.0, 0.0, 0.0), float3(0.0, 2.0, 0.0) };
                float sum = 0.0;
                for (Piece q = m.first(b); q.found; q = m.next(q)) sum += q.area;
                return sum;
            }""")
        j = self.json_cli("grad", "s.salt", "--integral", "--precision", "f64")
        self.assertEqual((j["samples"], j["integral_stderr"], j["stderr"]["m"]), (1, [0], [[0, 0, 0]] * 3))
        self.assertAlmostEqual(j["integral"][0], 0.125, places=11)
        self.assertAlmostEqual(j["gradient"]["m"][1][0], 0.125, places=11)

    def test_images(self):
        """However many samples are asked for, one of each pixel is taken, for the image, its derivatives and a loss."""
        self.put("s.salt", ROWS)
        self.run_cli("render", "s.salt", "--size", "8x6", "--spp", "1", "--param", "a=0.9", "-o", "t.pfm")
        for name, spp in (("one.pfm", "1"), ("many.pfm", "16")):
            self.run_cli("render", "s.salt", "--size", "8x6", "--spp", spp, "-o", name)
        self.assertEqual(self.get("one.pfm"), self.get("many.pfm"))
        one, many = (self.json_cli("grad", "s.salt", "--target", "t.pfm", "--size", "8x6", "--spp", n) for n in ("1", "16"))
        for key in "loss", "gradient", "stderr", "samples":
            self.assertEqual(one[key], many[key])
        self.assertEqual(one["stderr"], {"a": 0, "b": [0, 0]})
        self.assertAlmostEqual(one["loss"], (0.81 - 0.09) ** 2, places=5)
        self.assertAlmostEqual(one["gradient"]["a"], 2 * (0.09 - 0.81) * 0.6, places=5)

    def test_filters(self):
        """Whatever the filter: a sample belongs to one pixel."""
        self.put("s.salt", ROWS)
        for name in "box", "tent", "gaussian":
            self.run_cli("render", "s.salt", "--size", "8x6", "--spp", "4", "--filter", name, "-o", name + ".pfm")
        self.assertEqual(self.get("box.pfm"), self.get("tent.pfm"))
        self.assertEqual(self.get("box.pfm"), self.get("gaussian.pfm"))

    def test_differences(self):
        """Moved parameters, too, need one sample each: two of either step for each of three numbers, and one as they are."""
        self.put("s.salt", ROWS)
        j = self.json_cli("grad", "s.salt", "--integral", "--precision", "f64", "--estimator", "fd")
        self.assertEqual(j["evaluations"], 13)
        self.assertAlmostEqual(j["gradient"]["a"], 0.6, places=9)
        self.run_cli("render", "s.salt", "--size", "8x6", "--param", "a=0.9", "-o", "t.pfm")
        one, many = (self.json_cli("grad", "s.salt", "--target", "t.pfm", "--size", "8x6", "--estimator", "fd", "--spp", n) for n in ("1", "16"))
        self.assertEqual(one["gradient"], many["gradient"])
        self.assertAlmostEqual(one["gradient"]["a"], 2 * (0.09 - 0.81) * 0.6, places=3)

    def test_bench(self):
        """A curve of one point, without an error; differences have theirs, and nobody else is asked."""
        self.put("s.salt", ROWS)
        j = self.json_cli("bench", "s.salt", "--repeats", "2", "--precision", "f64", "-o", "out")
        self.assertEqual(set(j["curves"]), {"lattice", "fd"})
        (exact,), (fd,) = j["curves"]["lattice"], j["curves"]["fd"]
        self.assertEqual(fd["samples"], 1)
        self.assertLess(exact["error"], 1e-14)
        self.assertLess(fd["error"], 1e-8)
        self.assertIn("scanline", j["skipped"])
        self.assertNotIn(b"nan", self.get("out/bench.svg"))


if __name__ == "__main__":
    unittest.main()
