"""What a point light sees of visible pieces: a shadow in closed form, derivatives of everything against differences, the same bits everywhere, precision, what is warned about."""
from harness import *

# A square above a floor of two faces, through whose border it is not seen.
SQUARE = """v -5.0 -5.0 0.0
v 5.0 -5.0 0.0
v 5.0 5.0 0.0
v -5.0 5.0 0.0
v -0.5 -0.4 1.0
v 0.5 -0.4 1.0
v 0.5 0.4 1.0
v -0.5 0.4 1.0
f 1 2 3
f 1 3 4
f 5 6 7
f 5 7 8
"""
# A tent and a triangle through one another, over a floor that they are seen before.
TENT = """v -3.0 -2.5 0.05
v 3.1 -2.4 -0.05
v 0.2 3.0 0.0
v -0.2 -0.25 0.5
v 0.3 -0.2 0.45
v 0.25 0.3 0.5
v -0.3 0.2 0.55
v 0.02 0.03 0.9
v 0.3 0.1 0.3
v 0.1 0.15 0.85
v -0.35 0.4 0.32
f 1 2 3
f 4 5 8
f 5 6 8
f 6 7 8
f 7 4 8
f 9 10 11
"""
LIGHT = (0.35, 0.2, 3.0)
EYE = (0.1, -2.0, 0.5)
CORNER, U, V = (-0.6, -1.3, 0.05), (1.5, 0.0, 0.0), (0.02, 0.0, 0.5)
PARAMS = 'param mesh m = "a.obj";\n' + "".join("param float3 %s = float3(%r, %r, %r);\n" % ((name,) + at) for name, at in (("light", LIGHT), ("eye", EYE), ("corner", CORNER), ("u", U), ("v", V)))
ONE = PARAMS + "Beam window() { Beam b; b.eye = eye; b.corner = corner; b.u = u; b.v = v; return b; }\nshader float main(float2 x) { float sum = 0.0; for (Piece q = m.first(window()); q.found; q = m.next(q)) sum += %s; return sum; }\n"
SHADED = "m.lit(q, light) * (0.4 + max(dot(q.normal, normalize(light - q.p)), 0.0))"
# A picture, by pixels.
PICTURE = PARAMS + """
shader float main(float2 x) {
    Beam b; b.eye = eye; b.corner = corner + x.x * u + x.y * v; b.u = u / 12.0; b.v = v / 10.0;
    float sum = 0.0;
    for (Piece q = m.first(b); q.found; q = m.next(q)) sum += """ + SHADED + """;
    return sum;
}
"""


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def cross(a, b):
    return [a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3] for i in range(3)]


class Lit(Case):
    def value(self, *more):
        j = self.json_cli("grad", "s.salt", "--integral", "--precision", "f64", *more)
        self.assertEqual(j["samples"], 1)
        return j

    def ask(self, what, mesh=TENT, *more):
        self.put("a.obj", mesh)
        self.put("s.salt", ONE % what)
        return self.value(*more)

    def test_closed_form(self):
        """The shadow of the square, as a camera under it sees it: its corners on the floor, in the window."""
        shadow = 0.0
        corners = []
        for x, y in ((-0.5, -0.4), (0.5, -0.4), (0.5, 0.4), (-0.5, 0.4)):
            far = LIGHT[2] / (LIGHT[2] - 1.0)
            d = [LIGHT[i] + far * (p - LIGHT[i]) - EYE[i] for i, p in enumerate((x, y, 1.0))]
            c = [a - b for a, b in zip(CORNER, EYE)]
            whole = dot(d, cross(U, V))
            corners.append((dot(d, cross(V, c)) / whole, dot(d, cross(c, U)) / whole))
        for (s, t), (q, r) in zip(corners, corners[1:] + corners[:1]):
            self.assertTrue(0 < s < 1 and 0 < t < 1)
            shadow += 0.5 * (s * r - t * q)
        self.assertGreater(abs(shadow), 0.05)
        area = self.ask("q.area", SQUARE)["integral"][0]
        self.assertAlmostEqual(self.ask("m.lit(q, light)", SQUARE)["integral"][0], area - abs(shadow), delta=1e-11)

    def test_nothing_between(self):
        for mesh in SQUARE.replace("f 5 6 7\nf 5 7 8\n", ""), TENT.split("f 1 2 3")[0] + "f 1 2 3\n":
            area, lit = self.ask("q.area", mesh), self.ask("m.lit(q, light)", mesh)
            self.assertAlmostEqual(lit["integral"][0], area["integral"][0], delta=1e-13)
            for i, at in enumerate(area["gradient"]["m"]):
                for k in range(3):
                    self.assertAlmostEqual(lit["gradient"]["m"][i][k], at[k], delta=1e-11)
            for k in range(3):
                self.assertAlmostEqual(lit["gradient"]["eye"][k], area["gradient"]["eye"][k], delta=1e-11)
                self.assertAlmostEqual(lit["gradient"]["light"][k], 0, delta=1e-11)

    def test_derivatives(self):
        """In each number, against differences that are extrapolated."""
        gradient = self.ask(SHADED)["gradient"]
        numbers = [("m[%d].%s" % (i, c), float(at), gradient["m"][i][k]) for i, line in enumerate(TENT.splitlines()[:11]) for k, (c, at) in enumerate(zip("xyz", line.split()[1:]))]
        for name, at in ("light", LIGHT), ("eye", EYE), ("corner", CORNER), ("u", U), ("v", V):
            numbers += [("%s.%s" % (name, c), at[k], gradient[name][k]) for k, c in enumerate("xyz")]
        self.assertEqual(len(numbers), 33 + 15)
        largest = max(abs(g) for _, _, g in numbers)
        self.assertGreater(max(abs(g) for g in gradient["light"]), 1e-3)
        for name, at, g in numbers:
            d = []
            for h in 1e-5, 2e-5:
                side = [self.value("--param", "%s=%r" % (name, at + s * h))["integral"][0] for s in (1, -1)]
                d.append((side[0] - side[1]) / (2 * h))
            self.assertLess(abs(d[0] + (d[0] - d[1]) / 3 - g), 1e-8 * largest, name)

    def test_precision(self):
        wide, narrow = self.ask(SHADED), self.json_cli("grad", "s.salt", "--integral")
        self.assertLess(abs(wide["integral"][0] - narrow["integral"][0]), 1e-5)
        flat = lambda v: [w for e in v for w in flat(e)] if isinstance(v, list) else [v]
        largest = max(abs(g) for v in wide["gradient"].values() for g in flat(v))
        for name, g in wide["gradient"].items():
            for a, b in zip(flat(g), flat(narrow["gradient"][name])):
                self.assertLess(abs(a - b), 1e-4 * largest, name)

    def test_bits(self):
        """Images are the same at every width, for every processor and number of threads, and in the interpreter; derivatives with any number of threads."""
        self.put("a.obj", TENT)
        self.put("s.salt", PICTURE)
        for precision in "f32", "f64":
            images, gradients = set(), set()
            for more in ("--width", "1"), ("--width", "4"), ("--width", "8", "--threads", "2"), ("--width", "64"), ("--threads", "1"), ("--target-cpu", "avx2"), ("--interpret",):
                self.run_cli("render", "s.salt", "--size", "12x10", "--centres", "--precision", precision, *more, "-o", "i.npy")
                images.add(self.get("i.npy"))
            for threads in "1", "2", "3":
                j = self.json_cli("grad", "s.salt", "--integral", "--samples", "1024", "--precision", precision, "--threads", threads)
                gradients.add(json.dumps([j["integral"], j["gradient"]]))
            self.assertEqual((len(images), len(gradients)), (1, 1), precision)

    def test_adjoint(self):
        """Forwards, backwards and differences agree."""
        self.put("a.obj", TENT)
        self.put("s.salt", PICTURE)
        for precision in "f32", "f64":
            self.assertIn("PASS", self.run_cli("check", "s.salt", "--precision", precision, "--samples", "2048").out)

    def test_derivatives_alone(self):
        """Nobody asks how large the piece is: its sides move all the same."""
        self.ask("q.area")
        both = self.ask("m.lit(q, light) + q.area")["gradient"]
        alone, area = self.ask("m.lit(q, light)")["gradient"], self.ask("q.area")["gradient"]
        for name in "eye", "light":
            for k in range(3):
                self.assertAlmostEqual(both[name][k], alone[name][k] + area[name][k], delta=1e-11)
        for wrt in "light", "m", "eye":
            self.assertEqual(alone[wrt], self.ask("m.lit(q, light)", TENT, "--wrt", wrt)["gradient"][wrt])

    def test_handed_about(self):
        """In functions and loops; of another mesh, of what is not found, 0."""
        lit = self.ask("m.lit(q, light)")["integral"][0]
        self.put("b.obj", SQUARE)
        for body, want in (
            ("float sum = 0.0; Piece q = m.first(window()); while (q.found) { sum += ask(q); q = m.next(q); } return sum;", lit),
            ("float sum = 0.0; for (int i = 0; i < 2; i++) for (Piece q = m.first(window()); q.found; q = m.next(q)) if (i == 1) sum += 2.0 * ask(q); return sum;", 2 * lit),
            ("float sum = 0.0; for (Piece q = m.first(window()); q.found; q = m.next(q)) sum += other.lit(q, light); return sum;", 0),
            ("Piece q = m.first(window()); while (q.found) q = m.next(q); return m.lit(q, light);", 0),
            ("float sum = 0.0; Piece r = other.first(window()); for (Piece q = m.first(window()); q.found; q = m.next(q)) sum += m.lit(q, light) + 0.0 * other.lit(r, light); return sum;", lit),
        ):
            self.put("s.salt", (ONE % "0.0").split("shader")[0] + 'param mesh other = "b.obj";\nfloat ask(Piece q) { return m.lit(q, light); }\nshader float main(float2 x) { ' + body + " }")
            self.assertAlmostEqual(self.value()["integral"][0], want, delta=1e-13, msg=body)
            self.assertAlmostEqual(self.value("--interpret")["integral"][0], want, delta=1e-13, msg=body)

    def test_what_is_said(self):
        """What is lit counts by area; whether anything is, does not. `explain` names what is asked."""
        self.put("a.obj", TENT)
        for what, warned in ((SHADED, False), ("m.lit(q, light)", False), ("0.5 * m.lit(q, light) + 0.1 * q.area", False), ("m.lit(q, light) > 0.01 ? 1.0 : 0.0", True), ("sqrt(m.lit(q, light))", True)):
            self.put("s.salt", PICTURE.replace(SHADED, what))
            self.assertEqual("W0401" in self.run_cli("explain", "s.salt").err, warned, what)
        self.put("s.salt", ONE % SHADED)
        self.assertRegex(self.run_cli("explain", "s.salt").out, r"asked: .*\blit\b")
        self.put("t.salt", ONE % "m.lit(q)")
        self.assertIn("E0120", self.run_cli("render", "t.salt", "-o", "i.npy", code=3).err)

    def test_placed_vertices(self):
        """Derivatives go through what places vertices."""
        self.put("a.obj", TENT)
        self.put("s.salt", (ONE % SHADED).replace("param mesh", "[Vertex(place)] param mesh") + "param float a = 0.3;\nfloat3 place(int i, float3 p, int part) { return float3(p.x + a * p.z, p.y, p.z); }\n")
        gradient = self.value()["gradient"]["a"]
        value = lambda d: self.value("--param", "a=%r" % (0.3 + d))["integral"][0]
        want = (8 * (value(1e-5) - value(-1e-5)) - (value(2e-5) - value(-2e-5))) / 12e-5
        self.assertGreater(abs(want), 1e-3)
        self.assertAlmostEqual(gradient, want, delta=1e-8)

    def test_fit(self):
        """The light is found from its shadow: the floor's cosine alone says little of where it is."""
        self.put("a.obj", TENT)
        self.put("s.salt", "import mesh;\n" + PARAMS.replace("param mesh", "[NoDiff] param mesh") + "shader float main(float2 x) { Beam b = pixel_beam(eye, corner, u, v); float sum = 0.0; for (Piece q = m.first(b); q.found; q = m.next(q)) sum += %s; return sum; }\n" % SHADED)
        self.put("scene.json", json.dumps({"shader": "s.salt", "size": [24, 16], "precision": "f64", "params": {"light": {"grad": True, "value": [0.6, 0.1, 2.4]}},
                                           "views": [{"target": {"shader": "s.salt", "params": {"light": list(LIGHT)}}}], "optimizer": {"type": "lbfgs", "iters": 60}, "output": "out/"}))
        self.run_cli("fit", "scene.json")
        for got, want in zip(json.loads(self.get("out/fitted.json"))["light"], LIGHT):
            self.assertAlmostEqual(got, want, delta=1e-6)


if __name__ == "__main__":
    unittest.main()
