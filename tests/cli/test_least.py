"""The least that an option may say: one sample, one line, no iteration, a step that vanishes. No bar of 0, no NaN."""
import json
import math

from harness import *


class Least(Case):
    def test_one_sample(self):
        """What a few samples or lines happen to agree on is no error: it is not known, and that is said."""
        self.put("c.salt", CIRCLE)
        for e in ("auto", "lattice", "scanline", "snap-knn", "snap-crofton", "fd"):
            for n in (1, 3, 12):
                r = self.run_cli("grad", "c.salt", "--samples", n, "--estimator", e)
                self.assertRegex(r.out, r"integral .* \+- inf")
                self.assertRegex(r.out, r"radius .* \+- inf")
                self.assertIn("are not known", r.err)
        said = self.run_cli("grad", "c.salt", "--samples", 3, "--estimator", "lattice", "--json").err.splitlines()
        self.assertIn("unknown_errors", [json.loads(line)["code"] for line in said])
        for verb in (["grad"], ["render", "--integral"]):
            j = self.json_cli(verb[0], "c.salt", *verb[1:], "--samples", 3, "--estimator", "lattice")
            self.assertIn("unknown_errors", [w["code"] for w in j["warnings"]])
            self.assertNotIn("unknown_errors", [w["code"] for w in self.json_cli(verb[0], "c.salt", *verb[1:])["warnings"]])
        for e in ("lattice", "snap-knn"):
            r = self.run_cli("grad", "c.salt", "--segments", 1, "--estimator", e)
            self.assertNotRegex(r.out, r"integral .* \+- inf")  # only lines are few
            self.assertRegex(r.out, r"radius .* \+- inf")
        self.assertRegex(self.run_cli("render", "c.salt", "--integral", "--samples", 1).out, r"\+- inf")
        j = self.json_cli("grad", "c.salt", "--samples", 64, "--estimator", "lattice")
        self.assertTrue(0 < j["stderr"]["radius"] < 10, j["stderr"])
        # With an error wanted it is only where to begin.
        self.put("r.salt", "param float r = 0.5; shader float main(float2 x) { [Disc] if (x.x + 0.2 * rand() < r) return 1.0; return 0.0; }")
        j = self.json_cli("grad", "r.salt", "--samples", 1, "--error", "1e-2")
        self.assertLess(abs(j["gradient"]["r"] - 1), 0.05)
        self.assertFalse(self.run_cli("check", "c.salt", "--samples", 1, code=1).out.endswith("PASS\n"))

    def test_no_step(self):
        self.put("c.salt", CIRCLE)
        for step, precision in (("1e-30", "f32"), ("1e-9", "f32"), ("1e-30", "f64")):
            for verb in (["check"], ["grad", "--integral", "--estimator", "fd"], ["grad", "-o", "d.exr", "--size", 8, "--estimator", "fd"]):
                r = self.run_cli(*verb, "c.salt", "--wrt", "radius", "--step", step, "--precision", precision, code=2)
                self.assertIn("vanishes beside", r.err)
        # Steps of few units in the last place are divided by what they are.
        self.put("s.salt", "param float a = 1.0; shader float main(float x) { return a; }")
        j = self.json_cli("grad", "s.salt", "--integral", "--estimator", "fd", "--step", "1e-7")
        self.assertAlmostEqual(j["gradient"]["a"], 1, delta=1e-6)

    def test_more_axes(self):
        self.put("c.salt", CIRCLE)
        for verb in (["render", "-o", "c.png"], ["grad", "--integral"], ["grad", "-o", "c.exr"]):
            self.assertIn("2D domain", self.run_cli(*verb, "c.salt", "--size", "8x8x8", code=2).err)
        self.put("l.salt", "shader float main(float x) { return x; }")
        self.run_cli("render", "l.salt", "--size", "8x8", code=2)
        self.run_cli("render", "l.salt", "--size", "8x1")
        self.run_cli("render", "l.salt", "--size", "8")

    def test_infinite(self):
        self.put("i.salt", """
param float r = 0.4;
[Domain(0.0, 1.0)]
shader float main(float x) { float f = 0.0; [Disc] if (x < r) f = 1.0; return f + r / max(x - 0.5, 0.0); }
""")
        r = self.run_cli("render", "i.salt", "--integral")
        self.assertIn("inf +- inf", r.out)
        self.assertIn("not finite", r.err)
        j = self.json_cli("grad", "i.salt", "--integral")
        self.assertIn("nonfinite", [w["code"] for w in j["warnings"]])

    def test_no_iteration(self):
        self.put("c.salt", CIRCLE)
        self.run_cli("render", "c.salt", "--size", 8, "-o", "t.exr")
        r = self.run_cli("fit", "c.salt", "--target", "t.exr", "--iters", 0)
        self.assertNotIn("nan", r.out)
        self.assertIn("no iteration", r.out)

    def test_memory_of_a_png(self):
        """No more than its floats, and a row."""
        def chunk(name, data):
            return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        side = 4096
        data = zlib.compress((b"\0" + b"\x80" * 8 * side) * side, 1)
        self.put("big.png", b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", side, side, 16, 6, 0, 0, 0)) + chunk(b"IDAT", data) + chunk(b"IEND", b""))
        self.put("c.salt", CIRCLE)
        p = subprocess.Popen([BIN, "grad", self.path("c.salt"), "--target", self.path("big.png"), "--size", "8"], env=self.environment(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        _, status, usage = os.wait4(p.pid, 0)
        p.returncode = status
        self.assertEqual(status, 0)
        if not os.environ.get("SALTUS_SANITIZE"):  # they keep books of their own
            self.assertLess(usage.ru_maxrss, (16 * side * side + (96 << 20)) / 1024)


if __name__ == "__main__":
    unittest.main()
