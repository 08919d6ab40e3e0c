"""Programs made to fool a certificate: a tagged decision that changes by jumps which are not tagged. What [NoDisc] hides
the same program with [Disc] in its place shows: that is the truth."""
import math
import os

from harness import *

HEAD = "param float t = 0.3; param float w = 0.21; "

# {0}: what it jumps by; {1}: the tag.
JUMPS = {
    "floor": "{1} float k = floor(4.0 * {0} - t);",
    "ceil": "{1} float k = ceil(4.0 * {0} - t);",
    "round": "{1} float k = round(4.0 * {0} - t);",
    "trunc": "{1} float k = trunc(4.0 * {0} + t);",
    "sign": "{1} float k = sign({0} - t);",
    "step": "{1} float k = 2.0 * step(t, {0});",
    "frac": "float u = 4.0 * {0} - t; {1} float k = u - frac(u);",
    "int": "{1} float k = float(int(4.0 * {0} + t));",
    "branch": "float k = 0.0; {1} if ({0} < t) k = 2.0;",
    "choice": "{1} float k = {0} < t ? 2.0 : 0.0;",
    "choices": "{1} float k = {0} < t ? 0.0 : {0} < 2.0 * t ? 1.2 : 3.0;",
    "index": "float a[4] = {{ 0.1, 2.0, 0.3, 1.5 }}; {1} float k = a[clamp(int(4.0 * {0} + t - 0.2), 0, 3)];",
    "loop": "float k = 0.0; for (int i = 0; i < 4; i++) {{ {1} if ({0} > t * float(i) + 0.05) k += 0.7; }}",
    "integers": "{1} int i = int(4.0 * {0} + t); float k = i == 2 ? 0.0 : 2.0;",
    "NaN": "float d = max({0} - t, 0.0); {1} float k = d > 0.0 ? 3.0 : 0.0 * (d / d);",
}
PLACES = {1: ("x",), 2: ("x.x", "length(x)", "(x.x + 0.5 * x.y)"), 3: ("x.z", "length(x)")}
DECIDES = {
    "alone": ("k", "1.05"),
    "and a slope": ("k + 0.1 * {0}", "1.07"),
    "and a curve": ("k + 0.3 * dot({1}, {1}) - 0.2 * w", "1.11"),
}


def programs():
    for dim, places in PLACES.items():
        other = {1: "x", 2: "x.y", 3: "x.y"}[dim]
        for i, place in enumerate(places):
            for n, (name, jump) in enumerate(JUMPS.items()):
                how = list(DECIDES)[(n + i) % len(DECIDES)]
                if dim == 3 and n % 4:
                    continue # solids cost more
                g, least = DECIDES[how]
                one = lambda tag: (HEAD + "shader float main(float%s x) { %s float c = 0.0; [Disc] if (%s < %s) c = 1.0; return c; }" % (
                    dim if dim > 1 else "", jump.format(place, tag), g.format(other, "x" if dim > 1 else "float2(x, w)"), least))
                yield "%dD, %s of %s, %s" % (dim, name, place, how), one("[NoDisc]"), one("[Disc]")


class Fooled(Case):
    def test_no_certificate(self):
        wrong = seen = 0
        for name, hidden, shown in programs():
            with self.subTest(name):
                self.put("hidden.salt", hidden)
                self.put("shown.salt", shown)
                ask = lambda f, *o: self.json_cli("grad", f, "--integral", "--precision", "f64", *o)
                j, want = ask("hidden.salt"), ask("shown.salt", "--estimator", "lattice", "--samples", "2^16")
                seen += 1
                off = abs(j["gradient"]["t"] - want["gradient"]["t"]) > 0.05 * abs(want["gradient"]["t"]) + 0.01
                wrong += off
                if off:
                    self.assertLess(j.get("certified", 0), 1 - 1e-9, hidden)
        self.assertGreaterEqual(seen, 60)
        self.assertGreaterEqual(wrong, seen // 2) # they do fool automatic differentiation

    def test_continuous(self):
        """Jumps of floor that cancel: noise and repetition keep their certificates."""
        for body in ("[NoDisc] float2 q = frac(3.0 * x + t) - 0.5; [Disc] if (length(q) < 0.1 + w) return 1.0; return 0.0;",
                     "float u = 4.0 * x.x + t; [NoDisc] float i = floor(u); float s = u - i; s = s * s * (3.0 - 2.0 * s); "
                     "float n = lerp(frac(0.37 * i * i), frac(0.37 * (i + 1.0) * (i + 1.0)), s); [Disc] if (x.y < n) return 1.0; return 0.0;"):
            self.put("s.salt", HEAD + "shader float main(float2 x) { %s }" % body)
            j = self.json_cli("grad", "s.salt", "--integral", "--estimator", "quadrature", "--precision", "f64")
            self.assertGreater(j["certified"], 1 - 1e-9, body)


    def test_stated_f32(self):
        """Rounding of roots, and of how far from them f is taken, is part of what f32 states."""
        stated = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "bench", "stated")
        for name in "coincide_seam one_sin one_cbrt abs1 frac node expo".split():
            path = os.path.join(stated, name + ".salt")
            ask = lambda precision, error: self.json_cli("grad", path, "--integral", "--estimator", "quadrature", "--precision", precision, "--error", error)
            f32, f64 = ask("f32", "1e-4"), ask("f64", "1e-9")
            size = max(map(abs, f64["gradient"].values()))
            for p, want in f64["gradient"].items():
                with self.subTest(name, parameter=p):
                    self.assertLess(abs(f32["gradient"][p] - want), 2 * f32["stderr"][p] + 1e-9 * size)

    def test_touching(self):
        """Where curves touch each other, or the border, rounding hides a piece of them that is no small part of f32."""
        disc = "[Disc] if (length(x - float2(%s, 0.0)) < %s) f %s; "
        for name, body, want in (
            ("border", disc % (0.5, "r", "= 1.0"), {"r": math.pi}),
            ("disc in a disc", disc % (0.0, "w", "= 1.0") + disc % (0.25, "r - 0.25", "+= 2.0"), {"w": math.pi, "r": math.pi}),
            ("two at the border", disc % (-0.5, "r", "= 1.0") + disc % (0.5, "r", "= 2.0"), {"r": 3 * math.pi}),
        ):
            for precision in ("f32", "f64"):
                self.put("s.salt", "param float r = 0.5; param float w = 0.5; [Domain(-1.0, 1.0)] shader float main(float2 x) { float f = 0.0; %s return f; }" % body)
                j = self.json_cli("grad", "s.salt", "--integral", "--estimator", "quadrature", "--precision", precision)
                for p, v in want.items():
                    with self.subTest(name, precision=precision, parameter=p):
                        self.assertLess(abs(j["gradient"][p] - v), 2 * j["stderr"][p])
                        self.assertLess(j["stderr"][p], 2e-3 * v)
                        self.assertEqual((j["certified"], j["left"]), (1, 0))

    def test_thin(self):
        """What is thinner than rounding lets one see is found all the same, or not certified."""
        disc = "float d = length(x - float2(0.123, 0.05)) - r; "
        bodies = {
            "ring": ("float2 x", disc + "[Disc] if (abs(d) < w) return 1.0; return 0.0;", 1.6 * math.pi),
            "ring of two": ("float2 x", disc + "[Disc] if (d > 0.0 && d < w) return 1.0; return 0.0;", 0.8 * math.pi),
            "ring of two, nested": ("float2 x", disc + "float f = 0.5; [Disc] if (d < w) f = 2.5; [Disc] if (d < 0.0) f = 0.5; return f;", 1.6 * math.pi),
            "band": ("float2 x", "float u = 0.6 * x.x + 0.8 * x.y - r; [Disc] if (u > 0.0 && u < w) return 1.0 + x.x; return 0.0;", None),
            "part": ("float x", "float u = x - r; [Disc] if (u > 0.0 && u < w) return 1.0; return 0.0;", 1),
        }
        for name, (point, body, want) in bodies.items():
            for f64 in (False, True):
                for w in ("1e-3", "1e-5", "3e-6", "1e-6", "1e-7", "1e-8", "1e-10"):
                    if f64 and float(w) < 1e-7:
                        continue
                    self.put("s.salt", "param float r = 0.4; param float w = %s; [Domain(-1.0, 1.0)] shader float main(%s) { %s }" % (w, point, body))
                    j = self.json_cli("grad", "s.salt", "--integral", "--estimator", "quadrature", "--precision", "f64" if f64 else "f32")
                    if want is None: # the integral of 1 + x along the line, from one side of the square to the other
                        lo, hi = (0.4 - 0.8) / 0.6, 1.0
                        want = (hi - lo) * (1 + 0.5 * (lo + hi)) / 0.8
                    off, bar = abs(j["gradient"]["w"] - want), j["stderr"]["w"]
                    with self.subTest(name, w=w, f64=f64):
                        if j["certified"] > 1 - 1e-6:
                            self.assertLess(off, (1e-5 if f64 else 1e-3) * want + 2 * float(w) * 7, j)
                        self.assertLess(off, 4 * bar + (1e-5 if f64 else 1e-3) * want + 2 * float(w) * 7, j)


if __name__ == "__main__":
    unittest.main()
