"""Marches as people write them, every comparison [Disc]: each step asks whether it arrived, and neighbouring rays do not take
the same number of steps. Derivatives have closed forms; eps, where a march stops, is part of them only in the last digits."""
import math

from harness import *

HEAD = "uniform float r, z;\n%s\n"
# Parallel rays along z through a picture of 4 x 3: a ball of radius r in front of a wall at z.
BALL = "float map(vec3 p) { return length(p) - r; }"
SCENE = "vec2 map(vec3 p) { vec2 a = vec2(length(p) - r, 1.0), b = vec2(z - p.z, 2.0); return a.x < b.x ? a : b; }"
IMAGE = "void mainImage(out vec4 c, vec2 f) {\n    vec3 o = vec3((f / iResolution.xy - 0.5) * vec2(4, 3), -3), d = vec3(0, 0, 1);\n%s\n}\n"

MARCHES = {
    "asked behind the step": (BALL, "float t = 0.0; for (int i = 0; i < 400; i++) { float h = map(o + d * t); t += h; if (t > 20. || abs(h) < .0001) break; } c = vec4(t < 20. ? 1.0 : 0.0);"),
    "asked before the step": (BALL, "float t = 0.0; bool hit = false; for (int i = 0; i < 400; i++) { float h = map(o + d * t); if (h < .0001) { hit = true; break; } t += h; if (t > 20.) break; } if (hit) c = vec4(1);"),
    "the place itself moves": (BALL, "bool hit = false; vec3 p = o; for (int i = 0; i < 400; i++) { float h = map(p); if (h < .0001) { hit = true; break; } p += d * h; if (p.z > 20.) break; } if (hit) c = vec4(1);"),
    "in a function that returns": ("float map(vec3 p) { return length(p) - r; }\nfloat lit(vec3 o, vec3 d) { float t = 0.0; for (int i = 0; i < 400 && t < 20.; i++) { float h = map(o + d * t); if (h < .0001) return 1.0; t += h; } return 0.0; }", "c = vec4(lit(o, d));"),
    "asked first, by while": (BALL, "float t = 0.0, h = 1.0; while (h > .0001 && t < 20.) { h = map(o + d * t); t += h; } c = vec4(t < 20. ? 1.0 : 0.0);"),
    "asked first, by for": (BALL, "float t = 0.0, h = 1.0; for (int i = 0; i < 400 && h > .0001 && t < 20.; i++) { h = map(o + d * t); t += h; } if (h < .0001) c = vec4(1);"),
    "nothing bounds it": (BALL, "float t = 0.0; int i = 0; for (;;) { float h = map(o + d * t); if (h < .0001 || t > 20. || i > 400) break; t += h; i++; } c = vec4(t < 20. ? 1.0 : 0.0);"),
}


class Marches(Case):
    def gradient(self, declarations, body, *args):
        self.put("m.frag", HEAD % declarations + IMAGE % body)
        j = self.json_cli("grad", "m.frag", "--integral", "--size", "64x48", "--param", "r=0.8", "--param", "z=1.5", "--quiet", *args)
        scale = 12.0 / (64 * 48)
        return {k: (j["gradient"][k][0] * scale, j["stderr"][k][0] * scale) for k in ("r", "z") if k in j["gradient"]}, j

    def near(self, what, got, want, limit):
        value, bar = got
        self.assertLessEqual(abs(value - want), 4 * bar + 2e-3 * abs(want), (what, value, bar, want))
        self.assertLess(bar, limit * abs(want) + 1e-3, (what, value, bar))

    def test_outline(self):
        for name, (declarations, body) in MARCHES.items():
            for precision in ("f32", "f64"):
                with self.subTest(name, precision=precision):
                    got, j = self.gradient(declarations, body, "--precision", precision)
                    self.near(name, got["r"], 2 * math.pi * 0.8, 0.02)
                    self.assertLess(j["crossings"], 20000)
                    self.assertEqual([w for w in j["warnings"] if w["code"] == "W0407"], [])

    def test_bounds(self):
        """Whatever a march carries, its bounds can be asked for."""
        for name, (declarations, body) in MARCHES.items():
            with self.subTest(name):
                self.put("m.frag", HEAD % declarations + IMAGE % body)
                self.assertIn("sites", self.run_cli("explain", "m.frag").out)

    def test_what_is_seen(self):
        """How far it is to what the ray meets, and of what colour: a ball before a wall, which the rays hit too."""
        march = "float t = 0.0, m = 0.0; for (int i = 0; i < 400; i++) { vec2 h = map(o + d * t); m = h.y; if (abs(h.x) < .0001) break; t += h.x; if (t > 20.) break; }"
        # Inside, dt/dr is -r / sqrt(r^2 - rho^2), whose integral is -2 pi r^2.
        area, rim = math.pi * 0.64, 2 * math.pi * 0.8
        for name, out, truth in (
            ("colour", "c = vec4(m);", {"r": -rim, "z": 0.0}),
            ("depth", "c = vec4(t);", {"r": -rim * 0.8 + rim * (3.0 - 4.5), "z": 12 - area}),
        ):
            got, j = self.gradient(SCENE, march + out)
            for k, want in truth.items():
                with self.subTest(name, wrt=k):
                    self.near(name, got[k], want, 0.05)

    def test_limits(self):
        """A limit ends rays on their way to a slanting plane: which step is the last one changes from ray to ray, and g
        of the outline must not. The plane comes nearer by .2 of what a ray goes; it is hit before t = 5 left of a line."""
        plane = "float map(vec3 p) { return r + .9797959 * p.x - .2 * (p.z + 3.) + 1.; }"
        for name, march in (
            ("behind the step", "float h = map(o + d * t); if (h < eps) { hit = true; break; } t += h; if (t > 5.) break;"),
            ("before the step", "float h = map(o + d * t); if (t > 5.) break; if (h < eps) { hit = true; break; } t += h;"),
        ):
            for eps in (".001", ".001 * t"):
                with self.subTest(name, eps=eps):
                    body = "float t = 0.0; bool hit = false; for (int i = 0; i < 200; i++) { %s } if (hit) c = vec4(1);" % march.replace("eps", eps)
                    got, j = self.gradient(plane, body)
                    self.near(name, got["r"], -3 / 0.9797959, 0.02)
                    self.assertEqual(sum(j["dropped"].values()), 0)

    def test_rims(self):
        """Rays that run out of steps beside an outline make a ramp of f that is thinner than a pixel, and stand anywhere
        in it. What is seen is the ball of radius r + eps, up to the thickness of the ramp."""
        radius = 0.8 + 0.002
        for steps in (60, 90, 400):
            march = "float t = 0.0; for (int i = 0; i < %d; i++) { float h = map(o + d * t); if (h < .002 || t > 20.) break; t += h; } c = vec4(t < 20. ? t : 0.0);"
            with self.subTest(steps=steps):
                got, j = self.gradient(BALL, march % steps)
                self.near(steps, got["r"], 6 * math.pi * radius - 2 * math.pi * radius**2, 0.02)

    def test_shadows(self):
        """Rays to the light begin on what another march hit: how far they come says little, and what f does not show is
        no crossing lost."""
        scene = "float map(vec3 p) { return min(length(p) - r, z - p.z); }"
        march = "float t = 0.0; bool hit = false; for (int i = 0; i < 200; i++) { float h = map(o + d * t); if (h < .001) { hit = true; break; } t += h; if (t > 20.) break; } if (hit) { vec3 q = o + d * t, l = vec3(.6, .0, -.8); float s = .1, w = 1.; for (int i = 0; i < 200; i++) { float h = map(q + l * s); if (h < .001) { w = .3; break; } s += h; if (s > 10.) break; } c = vec4(w); }"
        got, j = self.gradient(scene, march)
        for k in ("r", "z"):
            self.assertLess(got[k][1], 0.02 * abs(got["r"][0]), (k, got, j["dropped"]))
        # Differences of the same picture, by twice as many samples each way.
        for k, step in (("r", 0.02), ("z", 0.05)):
            ends = []
            for sign in (1, -1):
                p = {"r": 0.8, "z": 1.5}
                p[k] += sign * step
                v = self.json_cli("render", "m.frag", "--integral", "--size", "64x48", "--samples", "1000000", "--quiet", "--param", "r=%r" % p["r"], "--param", "z=%r" % p["z"])
                ends.append(v["integral"][0])
            self.near(k, got[k], (ends[0] - ends[1]) / (2 * step) * 12.0 / (64 * 48), 1)

    def test_what_shows_steps(self):
        """A sum over the steps, or a colour by their number, jumps from one number of steps to the next: every step keeps
        its own site."""
        for body in (
            "float t = 0.0, glow = 0.0; for (int i = 0; i < 40; i++) { float h = map(o + d * t); if (h < .01) break; glow += .02; t += h; if (t > 8.) break; } c = vec4(glow);",
            "float t = 0.0; for (int i = 0; i < 40; i++) { float h = map(o + d * t); if (h < .01) { c = vec4(1. - float(i) / 40.); break; } t += h; if (t > 8.) break; }",
        ):
            self.put("m.frag", HEAD % BALL + IMAGE % body)
            text = self.run_cli("explain", "m.frag", "--size", "64x48").out
            self.assertNotIn("silhouette", text)
            self.assertNotIn("shadow", text)
            said = self.run_cli("grad", "m.frag", "--integral", "--size", "64x48", "--samples", "4096", "--param", "r=0.8")
            self.assertIn("W0407", said.err)


if __name__ == "__main__":
    unittest.main()
