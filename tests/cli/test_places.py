"""Where something went wrong: the pixel, the point and the line of what is not finite, the line of what was dropped; and codes explained."""
from harness import CIRCLE, Case

# 1 / 0 is chosen in the lower half, and seen by nobody above it, where the square root is.
GUARDED = """param float a = 0.5;
shader float main(float2 x) {
    float r = length(x - 0.5);
    float g = x.x < 0.3 ? 1.0 / (x.x - x.x) : 0.0;
    float h = x.y > 0.5 ? r : g;
    return x.y > 0.5 ? sqrt(x.x - a) : r + 0.0 * abs(min(h, 2.0));
}
"""
STEEP_ROOT = """param float a = 0.0;
shader float main(float2 x) {
    float r = x.x * x.x;
    float s = r * a;
    return x.x < 0.75 ? r : sqrt(s) + r;
}
"""
# g of the second is constant but for a jump that nothing tags.
STEPS = """param float a = 0.5;
float band(float v) { return v < 0.31 ? 1.0 : -1.0; }
shader float main(float2 x) {
    float f = 0.0;
    [Disc] if (length(x - 0.5) < 0.3 * a) f = 1.0;
    [Disc] if (band(x.x - a * 0.1) < 0.0) f += 0.5;
    return f;
}
"""


class Nonfinite(Case):
    def warned(self, j):
        w = [w for w in j["warnings"] if w["code"] == "nonfinite"]
        self.assertEqual(len(w), 1)
        self.assertEqual(w[0]["range"]["start"]["line"] + 1, j["nonfinite_at"]["line"])
        return j["nonfinite_at"]

    def test_image(self):
        self.put("n.salt", GUARDED)
        for precision in "f32", "f64":
            j = self.json_cli("render", "n.salt", "--size", 16, "--precision", precision)
            at = self.warned(j)
            self.assertEqual((at["pixel"], at["line"], at["text"]), ([0, 0, 0], 6, "sqrt(x.x - a)"))
            self.assertLess(at["x"][0], 1 / 16)
            self.assertGreater(at["x"][1], 15 / 16)
        self.assertRegex(self.run_cli("render", "n.salt", "--size", 16).err, r"n\.salt:6:\d+: results that are not finite.*column 0, row 0")

    def test_pixels(self):
        """A point of an image is looked at with its pixel, and the image's size."""
        self.put("n.salt", "param float a = 1.0;\nshader float main(float2 x) {\n    return a / float(pixel().x - 3) / float(resolution().y - 1 - pixel().y);\n}")
        for verb in "render", "grad":
            at = self.warned(self.json_cli(verb, "n.salt", "--size", "8x4", "-o", "o.npy"))
            self.assertEqual((at["pixel"], at["line"]), ([3, 0, 0], 3))

    def test_derivatives(self):
        """sqrt has no slope at 0; its value is finite. Of an image, of an integral by lines and by cells, of a loss."""
        self.put("n.salt", STEEP_ROOT)
        at = self.warned(self.json_cli("grad", "n.salt", "-o", "d.exr", "--size", 8))
        self.assertEqual((at["pixel"], at["line"], at["text"]), ([6, 0, 0], 5, "sqrt(s)"))
        for estimator in "lattice", "auto":
            at = self.warned(self.json_cli("grad", "n.salt", "--integral", "--samples", 4096, "--estimator", estimator))
            self.assertEqual((at["pixel"], at["line"], at["text"]), (None, 5, "sqrt(s)"))
            self.assertGreaterEqual(at["x"][0], 0.75)
        self.run_cli("render", "n.salt", "--size", 8, "-o", "t.exr")
        at = self.warned(self.json_cli("grad", "n.salt", "--target", "t.exr", "--size", 8))
        self.assertEqual((at["line"], at["text"]), (5, "sqrt(s)"))

    def test_loops_and_arrays(self):
        """What a loop carries and an array holds is followed to where it was made."""
        self.put("n.salt", "param float a = 1.0;\nshader float main(float2 x) {\n    float s[3];\n    for (int i = 0; i < 3; i++)\n"
                 "        s[i] = log(x.x - float(i) * a);\n    float t = 0.0;\n    for (int i = 0; i < 3; i++) t += s[i];\n    return t;\n}")
        at = self.warned(self.json_cli("render", "n.salt", "--size", 4))
        self.assertEqual((at["line"], at["text"]), (5, "log(x.x - float(i) * a)"))

    def test_check(self):
        """check says so too, also where values alone are not finite."""
        self.put("v.salt", "param float a = 0.5;\nshader float main(float2 x) {\n    return a + sqrt(x.x - 0.25);\n}")
        self.put("n.salt", STEEP_ROOT)
        for file, line, text in ("v.salt", 3, "sqrt(x.x - 0.25)"), ("n.salt", 5, "sqrt(s)"):
            j = self.json_cli("check", file, "--samples", 4096, code=1)
            at = self.warned(j)
            self.assertEqual((at["line"], at["text"]), (line, text))
            self.assertIn("not finite", j["why"])
            r = self.run_cli("check", file, "--samples", 4096, code=1)
            self.assertRegex(r.out, r"FAIL: .*%s:%d:\d+: results that are not finite.* by `" % (file, line))

    def test_on_an_edge(self):
        """Infinite only where d is 0, on the curve that throws away what is beyond."""
        for domain, d in ("float x", "x - c"), ("float2 x", "length(x) - c"):
            self.put("n.salt", "param float c = 0.37;\n[Domain(0.0, 1.0)] shader float main(%s) {\n    float d = %s;\n    float f = 1.0 + sqrt(d);\n"
                     "    [Disc] if (d < 0.0) f = 0.25;\n    return f;\n}" % (domain, d))
            j = self.json_cli("grad", "n.salt", "--integral", "--estimator", "quadrature")
            if j["nonfinite"]:
                at = self.warned(j)
                self.assertEqual((at["line"], at["text"]), (4, "sqrt(d)"))
                self.assertLess(abs(sum(v * v for v in at["x"]) - 0.37 ** 2), 1e-6)

    def test_finite(self):
        self.put("c.salt", CIRCLE)
        for args in (["render", "c.salt", "--size", 8], ["grad", "c.salt", "--integral"]):
            j = self.json_cli(*args)
            self.assertEqual((j["nonfinite"], j["nonfinite_at"]), (0, None))


class Dropped(Case):
    def test_line(self):
        """The site is named by warnings and by the summary of check, which says what explains it."""
        self.put("s.salt", STEPS)
        lines = [["grad", "s.salt", "--integral", "--estimator", "lattice", "--threads", n] for n in (1, 3)]
        found = [[w for w in self.json_cli(*args)["warnings"] if w["code"] == "dropped"] for args in lines]
        self.assertEqual(found[0], found[1])
        self.assertEqual(found[0][0]["range"]["start"]["line"], 5)
        r = self.run_cli("check", "s.salt", "--estimator", "lattice", "--samples", 16384, code=1)
        self.assertRegex(r.out, r"FAIL.* s\.salt:6:\d+: \d+ of \d+ crossings were dropped: .*`saltus explain zero_gradient`")
        j = self.json_cli("check", "s.salt", "--estimator", "lattice", "--samples", 16384, code=1)
        self.assertIn("explain zero_gradient", j["why"])

    def test_no_event(self):
        """No site decides differently: the first decision that does is named."""
        self.put("n.salt", "param float a = 0.4;\nshader float main(float2 x) {\n    float f = 0.0;\n    if (x.x < a) {\n"
                 "        [Disc] if (x.y < 0.3 + 0.1 * a) f = 1.0;\n    }\n    return f;\n}")
        j = self.json_cli("grad", "n.salt", "--integral", "--estimator", "lattice")
        self.assertGreater(j["dropped"]["no_event"], 0)
        dropped = [w for w in j["warnings"] if w["code"] == "dropped"]
        self.assertEqual([w["range"]["start"] for w in dropped], [{"line": 3, "character": 8}])
        self.assertIn("`x.x < a`", dropped[0]["message"])


class Explain(Case):
    def test_codes(self):
        for code in "dropped", "coincident", "no_event", "no_root", "zero_gradient", "not_finite", "inconsistent", "static", "depth", "upset", "few_ulps", "out_of_range", "nonfinite", "steep", "missed":
            self.assertRegex(self.run_cli("explain", code).out, r"^%s \(warning\): " % code)
        self.assertEqual(self.run_cli("explain", "NO_EVENT").out, self.run_cli("explain", "no_event").out)
        self.assertEqual(self.run_cli("explain", "e0401").out, self.run_cli("explain", "E0401").out)
        self.assertRegex(self.run_cli("explain", "w0402").out, r"^W0402 \(warning\)")
        self.assertEqual(self.json_cli("explain", "upset")["code"], "upset")

    def test_warnings_name_their_code(self):
        """What is printed for people says what explains it."""
        self.put("n.salt", STEEP_ROOT)
        self.assertIn("`saltus explain nonfinite`", self.run_cli("grad", "n.salt", "--integral", "--samples", 4096).err)
        self.put("m.salt", "param float a = 0.5;\nshader float main(float2 x) { float s = 0.0; [MaxIters(3)] while (s < 9.0 * a) s += 1.0; return s; }")
        self.assertIn("`saltus explain truncated`", self.run_cli("render", "m.salt", "--size", 4).err)

    def test_file_first(self):
        """A shader that is called like a code is a shader."""
        self.put("static", "shader float main(float2 x) { return x.x; }")
        self.assertRegex(self.run_cli("explain", "static").out, r"^main: 2D")
