"""What `auto` takes: its bars are not twice those of the lattice where the lattice is right, nor those of the lattice where cells are exact."""
import math
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

    BOX = "float s = box(q, vec2(.204 + k, .252)); if (s < 0.) c = vec3(.897, .2, .904);"

    def test_boxes(self):
        """The distance of a box is of one formula inside and of another outside, and both are flat beyond: turned by an
        angle its edges were left over in however small cells."""
        for turn, want in (("", 5225.472), ("q *= mat2(cos(.4), -sin(.4), sin(.4), cos(.4));", 5225.472),
                           ("float a = atan(q.y, q.x); q = length(q) * vec2(cos(a), sin(a));", 5225.472)):
            self.put("s.frag", self.HEAD + "vec2 q = p - vec2(k * .5 - .262, -.315); %s float s = box(q, vec2(.204 + k, .252)); "
                     "o = vec4(s < 0. ? 1. : 0.); }" % turn)
            for precision, most in (("f32", .3), ("f64", 1e-3)):
                j = self.ask("--precision", precision)
                self.assertLessEqual(abs(j["gradient"]["k"][0] - want), j["stderr"]["k"][0] + 1e-9)
                self.assertLessEqual(j["stderr"]["k"][0], most)
                self.assertLessEqual(j["evaluations"], 200000)

    def test_repeated(self):
        """Remainders keep to their period, so that seams of a repetition, and the cut of an angle, settle beside a shape."""
        j = self.compare("vec2 q = p - vec2(.141 - k, .333); q = pol(q, 6.); c = mix(c, vec3(.7, .5, .6), step(length(q) - .188, .028)); "
                         "q = pol(p - vec2(k * .5 - .262, -.315), 3.); %s "
                         "q = abs(p - vec2(k * .5 - .295, -.042)) - vec2(.206 + k * k + k, .272); "
                         "if (box(q, vec2(.13 + k * k + k, .108)) < 0.) c = vec3(.737, .738, .411);" % self.BOX)
        self.assertLessEqual(max(j["stderr"]["k"]), 2)
        self.assertEqual(j["dropped"]["coincident"], 0)
        self.assertGreater(j["certified"], .99999)

    def test_a_pole(self):
        """At the centre of an angle boxes end between two curves that meet in one float: no bar is of a section of 0."""
        j = self.compare("vec2 q = pol(p - vec2(.303 + k, .19 + k * k + k), 6.); c = mix(c, 1. - c, smoothstep(.03, -.03, length(q) - .151 - sin(k)));")
        for error in j["stderr"]["k"]:
            self.assertLess(error, 100)


class Cells(Case):
    """What cells integrate exactly is theirs, though a place of the outlook lies beside an edge."""

    def ask(self, source, n):
        self.put("s.salt", source)
        j = self.json_cli("grad", "s.salt", "--integral")
        self.assertEqual(j["certified"], 1)
        self.assertLessEqual(j["evaluations"], n)
        return j

    def outline(self, corners, test):
        """Derivatives of an area in its corners: half of what the neighbours are apart."""
        n, place = len(corners), lambda p: "float2(%r, %r)" % p
        j = self.ask("param float2 v[%d] = {%s}; [Domain(-1.0, 1.0)] shader float main(float2 x) { float f = 0.0; "
                     "for (int i = 0; i < %d; i++) { float2 a = v[i]; float2 b = v[(i + 1) %% %d]; %s } return f; }"
                     % (n, ", ".join(map(place, corners)), n, n, test), 100000)
        for i, (x, y) in enumerate(corners):
            (ax, ay), (bx, by) = corners[i - 1], corners[(i + 1) % n]
            for got, error, want in zip(j["gradient"]["v"][i], j["stderr"]["v"][i], (.5 * (by - ay), .5 * (ax - bx))):
                self.assertLessEqual(error, 1e-3)
                self.assertLessEqual(abs(got - want), error + 2e-5, (i, got, want))

    def test_polygons_with_edges_along_an_axis(self):
        test = "[Disc] if ((a.y > x.y) != (b.y > x.y) && x.x < lerp(a.x, b.x, (x.y - a.y) / (b.y - a.y))) f = 1.0 - f;"
        self.outline([(-.65, -.55), (.55, -.55), (.55, -.05), (.05, -.05), (.05, .6), (-.65, .6)], test)
        self.outline([(-.7, .3), (-.15, .3), (-.15, -.7), (.15, -.7), (.15, .3), (.7, .3), (.7, .7), (-.7, .7)], test)
        self.outline([(-.7, -.4), (.6, -.4), (.6, .5), (-.7, .5)], test)

    def test_comparisons_that_coincide_by_rounding(self):
        """The distance of a polygon: its edges' comparisons are one curve but for rounding, along which signs change by
        chance. Stretches of it were halved for minutes."""
        corners = [(-.65, -.55), (.55, -.55), (.55, -.05), (.05, -.05), (.05, .6), (-.65, .6)]
        self.put("s.salt", "param float2 v[6] = {%s}; [Domain(-1.0, 1.0)] shader float main(float2 p) { "
                 "float d = dot(p - v[0], p - v[0]); float s = 1.0; for (int i = 0; i < 6; i++) { "
                 "float2 e = v[(i + 5) %% 6] - v[i]; float2 w = p - v[i]; "
                 "float2 b = w - e * clamp(dot(w, e) / dot(e, e), 0.0, 1.0); d = min(d, dot(b, b)); "
                 "[Disc] bool c1 = p.y >= v[i].y; [Disc] bool c2 = p.y < v[(i + 5) %% 6].y; [Disc] bool c3 = e.x * w.y > e.y * w.x; "
                 "if ((c1 && c2 && c3) || (!c1 && !c2 && !c3)) s = -s; } "
                 "[Disc] if (s * sqrt(d) < 0.0) return 1.0; return 0.0; }" % ", ".join("float2(%r, %r)" % p for p in corners))
        for estimator in ("auto", "quadrature"):
            j = self.json_cli("grad", "s.salt", "--integral", "--precision", "f64", "--estimator", estimator)
            self.assertLessEqual(j["evaluations"], 2000000)
            self.assertLessEqual(abs(j["gradient"]["v"][0][0] + .575), 2 * j["stderr"]["v"][0][0])


class Fits(Case):
    """Steps that bear noise want more steps, not better ones: in a fit auto spends what the lattice does."""

    def evaluations(self, source, *arguments):
        self.put("s.salt", source)
        return [self.json_cli("fit", "s.salt", "--size", 96, "--spp", 8, "--iters", 1, "--target", "t.exr", "--estimator", estimator, *arguments)["evaluations"]
                for estimator in ("auto", "lattice")]

    def test_price(self):
        self.put("t.salt", "shader float main(float2 x) { return x.x; }")
        self.run_cli("render", "t.salt", "--size", 96, "-o", "t.exr")
        self.put("grid.npy", write_npy((48, 48, 1), [math.sin(.15 * i + .3 * math.sin(.1 * j)) * math.sin(.1 * j + 1) + .1 for i in range(48) for j in range(48)]))
        grid = "param texture2D grid = \"grid.npy\"; shader float main(float2 x) { float v = grid.sample(x).x; [Disc] if (v > 0.0) return 1.0; return 0.0; }"
        auto, lattice = self.evaluations(grid)
        self.assertLess(auto, 1.5 * lattice)  # cells take ten times as much
        auto, lattice = self.evaluations(grid, "--optimizer", "lbfgs")  # which compares losses
        self.assertGreater(auto, 5 * lattice)
        disc = "param float r = 0.3; shader float main(float2 x) { float f = 0.0; [Disc] if (length(x - 0.5) < r) f = 1.0; return f; }"
        auto, lattice = self.evaluations(disc)
        self.assertLess(auto, 0.5 * lattice)


if __name__ == "__main__":
    unittest.main()
