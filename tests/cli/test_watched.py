"""Whoever waits is answered: interrupts and limits inside a compilation, a search or a tile, and notes on progress."""
import json
import random
import signal
import time
import unittest

from harness import Case

# Hundreds of crossings on every line, close to each other: minutes in one tile.
MANDEL = """
void mainImage(out vec4 color, in vec2 at) {
    vec2 c = vec2(-0.6, 0.0) + (1.3 + iTime) * (2.0 * at - iResolution.xy) / iResolution.y, z = vec2(0.0);
    float n = 0.0;
    for (int i = 0; i < 200; i++) {
        z = vec2(z.x * z.x - z.y * z.y, 2.0 * z.x * z.y) + c;
        if (length(z) > 2.0) break;
        n += 1.0;
    }
    color = vec4(n / 200.0);
}
"""
SOON = 15  # seconds; half a second where nothing else runs


def straight_line(operations):
    """What LLVM compiles for long, and cannot be told to stop."""
    pick = random.Random(1)
    lines = ["float v0 = x.x * a; float v1 = x.y;"]
    for i in range(2, operations):
        lines.append("float v%d = %s(v%d, v%d + %d.5);" % (i, pick.choice(("min", "max", "atan2")), pick.randrange(max(0, i - 30), i), i - 1, i % 7))
    return "param float a = 1.0;\nshader float main(float2 x) {\n%s\nfloat f = 0.0; [Disc] if (v%d < 3.0) f = 1.0; return f; }" % ("\n".join(lines), operations - 1)


def written_out(n):
    """n steps, each with a weight of its own, and the derivative of the integral in p."""
    pick = random.Random(2)
    steps = [(pick.random() - 0.5, pick.random() / n) for _ in range(n)]
    lines = ["[Disc] if (x.x < p + %.6f) f += %.8f;" % step for step in steps]
    return "param float p = 0.5;\n[Domain(0.0, 1.0)] shader float main(float2 x) { float f = 0.0;\n%s\nreturn f; }" % "\n".join(lines), sum(weight for _, weight in steps)


def long_sites(operations):
    """Every comparison has nearly the whole program behind it."""
    lines = ["float u0 = x.y * a, v0 = x.x * a, u1 = x.x, v1 = x.y;"]
    for i in range(2, operations):
        lines.append("float u%d = u%d * 0.3 + u%d, v%d = v%d * 0.7 - v%d;" % (i, i - 1, i - 2, i, i - 1, i - 2))
    lines += ["[Disc] if (u%d + v%d < %d.0) f += 1.0;" % (operations - 1 - i, operations - 1 - i, i) for i in range(12)]
    return "param float a = 1.0;\nshader float main(float2 x) {\nfloat f = 0.0;\n%s\nreturn f; }" % "\n".join(lines)


class Watched(Case):
    def interrupt(self, *args, after=2.0, code=130):
        p = self.start_cli(*args)
        time.sleep(after)
        self.assertIsNone(p.poll(), "it was over before it could be interrupted")
        start = time.time()
        p.send_signal(signal.SIGINT)
        out, err = p.communicate(timeout=120)
        self.assertEqual(p.returncode, code, err)
        self.assertLess(time.time() - start, SOON)
        self.assertEqual(err.decode().count("saltus: interrupted\n"), 1, err)
        self.assertEqual(out, b"")
        return err.decode()

    def test_too_large(self):
        """What would compile for minutes is left out with words, unless it is asked for."""
        self.put("c.salt", long_sites(3600))
        r = self.run_cli("grad", "c.salt", "--integral", "--size", "8")
        self.assertRegex(r.err, r"the boundary is left out, because its 12 sites need \d+ operations.*\[NoDisc\]")
        self.assertIn('"left_out": "boundary"', self.run_cli("grad", "c.salt", "--integral", "--size", "8", "--json").out)
        self.assertRegex(self.run_cli("grad", "c.salt", "-o", "g.exr", "--size", "8").err, "the boundary is left out, because its")

    def test_search(self):
        self.put("m.frag", MANDEL)
        for i, args in enumerate((["grad", "m.frag", "--integral"], ["grad", "m.frag", "--integral", "--samples", "262144"], ["grad", "m.frag", "-o", "g.exr"], ["check", "m.frag"], ["grad", "m.frag", "--estimator", "quadrature"],
                     ["render", "m.frag", "--exact", "--size", "512", "-o", "r.png"], ["grad", "m.frag", "--estimator", "fd", "--samples", "100000000"])):
            self.interrupt(*args, "--threads", 2 - i % 2)
        self.no_leftovers("m.frag")

    def test_compilation(self):
        self.put("s.salt", straight_line(4000))
        for verb in ("explain", "grad", "build"):
            self.interrupt(verb, "s.salt", "--no-cache", *(["-o", "s.o"] if verb == "build" else []))
        self.run_cli("explain", "s.salt", "--no-cache", "--max-seconds", "0.5", code=6)
        self.no_leftovers()

    def test_effort(self):
        """Without a word about effort there is an answer, which says what it leaves out."""
        self.put("m.frag", MANDEL)
        r = self.run_cli("grad", "m.frag", "--integral", timeout=280)
        self.assertRegex(r.err, "warning: (256|4096) samples and lines instead of 262144|warning: the boundary is left out")
        self.assertRegex(r.out, r"(?m)^iTime +-?\d")

    def test_written_out(self):
        """Hundreds of sites are compiled without optimisation; thousands are refused, with what to do, where LLVM would take minutes."""
        text, truth = written_out(600)
        self.put("s.salt", text)
        r = self.run_cli("grad", "s.salt", "--integral", "--estimator", "lattice", "--samples", "4096", "--no-cache", "--json")
        self.assertAlmostEqual(json.loads(r.out)["gradient"]["p"], truth, delta=1e-4)
        self.put("s.salt", written_out(3000)[0])
        words = "3000 decisions under .Disc. are written out.*at most 2048.*a loop over an array"
        for args in (["grad", "s.salt", "--integral", "--samples", "4096"], ["check", "s.salt"], ["grad", "s.salt", "--size", "8", "--estimator", "quadrature", "-o", "g.npy"]):
            self.assertRegex(self.run_cli(*args, "--no-cache", code=6).err, words)
        self.assertRegex(self.run_cli("grad", "s.salt", "--integral", "--no-cache").err, "warning: the boundary is left out.*" + words)
        self.run_cli("render", "s.salt", "--size", "8", "--no-cache", "-o", "r.npy")
        self.run_cli("grad", "s.salt", "--integral", "--interior-only", "--samples", "64", "--no-cache")

    def test_notes(self):
        self.put("m.frag", MANDEL)
        err = self.interrupt("grad", "m.frag", "--samples", "1000000", "--threads", "1", after=13)
        self.assertRegex(err, r"note: grad, 1\d s.*1 site with at most 200 events.*m\.frag:7")
        start = time.time()
        r = self.run_cli("grad", "m.frag", "--max-seconds", "1", "--json", code=6)
        self.assertLess(time.time() - start, 1 + SOON)
        self.assertNotIn("note:", r.err)


if __name__ == "__main__":
    unittest.main()
