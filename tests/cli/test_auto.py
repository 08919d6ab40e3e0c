"""What `auto` takes: its bars are not twice those of the lattice where the lattice is right, nor those of the lattice where cells are exact."""
import unittest

from harness import *


class Lines(Case):
    """Plain pictures of which cells state much."""

    HEAD = """uniform float k;
        float box(vec2 p, vec2 b) { vec2 d = abs(p) - b; return length(max(d, 0.)) + min(max(d.x, d.y), 0.); }
        vec2 pol(vec2 p, float n) {
            float a = atan(p.y, p.x), w = 6.2831853 / n; a = mod(a + .5 * w, w) - .5 * w; return length(p) * vec2(cos(a), sin(a));
        }
        void mainImage(out vec4 o, vec2 at) { vec2 p = (2. * at - iResolution.xy) / iResolution.y; vec3 c = vec3(.27, .145, .015);"""

    def ask(self, *options):
        return self.json_cli("grad", "s.frag", "--integral", "--param", "k=0.0137", "--size", "256x144", *options)

    def compare(self, text):
        self.put("s.frag", self.HEAD + text + " o = vec4(c, 1); }")
        lines, j = self.ask("--estimator", "lattice"), self.ask()
        self.assertLessEqual(max(j["stderr"]["k"]), 2 * max(lines["stderr"]["k"]))
        for a, b, e, f in zip(j["gradient"]["k"], lines["gradient"]["k"], j["stderr"]["k"], lines["stderr"]["k"]):
            self.assertLessEqual(abs(a - b), 3 * (e + f))
        return j

    def test_a_lattice_that_misses(self):
        """A 32nd of the lines misses what is narrower than their spacing, and states so much: an eighth tells more."""
        self.compare("""
            vec2 q = p - vec2(.572 + k, -.082);
            c = mix(c, 1. - c, smoothstep(.03, -.03, length(q) - .397 - k * k + k));
            q = mod(p - vec2(.52 + k * .5, .263 - k) + .029, .958 + sin(k) * .2) - .26;
            float s = max(q.x - .134, abs(q.y) - .137 - k * .5);
            c += (s < 0. ? 1. : 0.) * .2 * fract(s * 7.791);
            q = p - vec2(-.238, .265 + k * k + k);
            q.x += .116 * sin(q.y * 8.522 + k * k + k * 3.);
            if (length(q) - .26 < 0.) c = vec3(.194, .577, .476);""")


if __name__ == "__main__":
    unittest.main()
