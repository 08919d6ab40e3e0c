"""Area lights past meshes: derivatives of everything against differences, the same bits everywhere, precision, programs that ask in loops and branches."""
from harness import *

# A tent and a loose triangle between floor and light.
TENT = """v -0.2 -0.25 0.5
v 0.3 -0.2 0.45
v 0.25 0.3 0.5
v -0.3 0.2 0.55
v 0.02 0.03 0.7
v 0.3 0.1 0.3
v 0.5 0.15 0.35
v 0.35 0.4 0.32
f 1 2 5
f 2 3 5
f 3 4 5
f 4 1 5
f 6 7 8
"""
PARAMS = """
param mesh m = "a.obj";
param float3 p = float3(0.21, 0.13, -0.02);
param float3 n = float3(0.1, -0.07, 1.0);
param float3 corner = float3(-0.52, -0.37, 1.03);
param float3 u = float3(0.04, 0.81, 0.02);
param float3 v = float3(1.02, 0.03, -0.06);
param float3 view = float3(0.6, 0.3, 0.9);
param float roughness = 0.43;
"""
# One number, wherever: a sample is enough, and there is no error.
ONE = PARAMS + "shader float main(float2 x) { AreaLight light = {corner, u, v}; return %s; }\n"
IRRADIANCE = "m.irradiance(p, normalize(n), light)"
LTC = "m.ltc(p, normalize(n), normalize(view), roughness, light)"
FLOOR = PARAMS + """
[Domain(float2(-1.0, -1.0), float2(1.0, 1.0))]
shader float2 main(float2 x) {
    AreaLight light = {corner, u, v};
    return float2(m.irradiance(float3(x, p.z), normalize(n), light), m.ltc(float3(x, p.z), normalize(n), normalize(view), roughness, light));
}
"""


class MeshLight(Case):
    def setUp(self):
        super().setUp()
        self.put("a.obj", TENT)

    def value(self, *more):
        j = self.json_cli("grad", "s.salt", "--integral", "--precision", "f64", *more)
        self.assertEqual(j["samples"], 1)
        return j

    def test_derivatives(self):
        """In each number, of both together, against differences that are extrapolated."""
        self.put("s.salt", ONE % (IRRADIANCE + " + 1.3 * " + LTC))
        gradient = self.value()["gradient"]
        numbers = [("m[%d].%s" % (i, c), at, gradient["m"][i][k]) for i, line in enumerate(TENT.splitlines()[:8]) for k, (c, at) in enumerate(zip("xyz", map(float, line.split()[1:])))]
        for name, text in re.findall(r"param float3 (\w+) = float3\((.*)\)", PARAMS):
            numbers += [("%s.%s" % (name, c), float(at), gradient[name][k]) for k, (c, at) in enumerate(zip("xyz", text.split(",")))]
        numbers.append(("roughness", 0.43, gradient["roughness"]))
        self.assertEqual(len(numbers), 24 + 18 + 1)
        largest = max(abs(g) for _, _, g in numbers)
        self.assertGreater(largest, 0.1)
        for name, at, g in numbers:
            d = []
            for h in 5e-5, 1e-4:
                side = [self.value("--param", "%s=%r" % (name, at + s * h))["integral"][0] for s in (1, -1)]
                d.append((side[0] - side[1]) / (2 * h))
            self.assertLess(abs(d[0] + (d[0] - d[1]) / 3 - g), 1e-8 * largest, name)

    def test_precision(self):
        for what in IRRADIANCE, LTC:
            self.put("s.salt", ONE % what)
            wide, narrow = self.value(), self.json_cli("grad", "s.salt", "--integral")
            self.assertLess(abs(wide["integral"][0] - narrow["integral"][0]), 1e-6)
            for name, g in wide["gradient"].items():
                flat = lambda v: [w for e in v for w in flat(e)] if isinstance(v, list) else [v]
                for a, b in zip(flat(g), flat(narrow["gradient"][name])):
                    self.assertLess(abs(a - b), 1e-4, name)

    def test_bits(self):
        """Images are the same at every width, number of threads and in the interpreter; derivatives with any number of threads."""
        self.put("s.salt", FLOOR)
        for precision in "f32", "f64":
            images, gradients = set(), set()
            for more in ("--width", "1"), ("--width", "4"), ("--width", "8", "--threads", "2"), ("--threads", "1"), ("--interpret",):
                self.run_cli("render", "s.salt", "--size", "12x10", "--spp", "2", "--precision", precision, *more, "-o", "i.npy")
                images.add(self.get("i.npy"))
            for threads in "1", "2", "3":
                j = self.json_cli("grad", "s.salt", "--integral", "--samples", "1024", "--precision", precision, "--threads", threads)
                gradients.add(json.dumps([j["integral"], j["gradient"]]))
            self.assertEqual((len(images), len(gradients)), (1, 1), precision)

    def test_adjoint(self):
        self.put("s.salt", FLOOR.replace("shader float2", "shader float").replace("return float2(", "return dot(float2(0.3, 1.7), float2(").replace("light));\n}", "light)));\n}"))
        for precision in "f32", "f64":
            r = self.run_cli("check", "s.salt", "--precision", precision, "--samples", "2048")
            self.assertIn("PASS", r.out)

    def test_in_programs(self):
        """Asked in loops, branches, functions and of two meshes: sums of what is asked alone, with their derivatives."""
        self.put("b.obj", TENT.replace("0.5\n", "0.9\n"))
        alone = {}
        for k in range(3):
            self.put("s.salt", ONE % ("m.irradiance(p + float3(0.1 * %d.0, 0.0, 0.0), normalize(n), light)" % k))
            alone[k] = self.value()
        self.put("s.salt", (ONE % "0.0").replace('"a.obj"', '"b.obj"').replace("return 0.0", "return " + IRRADIANCE))
        other = self.value()
        self.put("s.salt", PARAMS + """
            param mesh b = "b.obj";
            param float s = 2.0;
            float ask(int i) { AreaLight light = {corner, u, v}; return m.irradiance(p + float3(0.1 * float(i), 0.0, 0.0), normalize(n), light); }
            shader float main(float2 x) {
                float sum = 0.0;
                for (int i = 0; i < 3; i++) if (i != 1) sum += s * ask(i);
                AreaLight light = {corner, u, v};
                return sum + b.irradiance(p, normalize(n), light);
            }""")
        j = self.value()
        self.assertAlmostEqual(j["integral"][0], 2 * alone[0]["integral"][0] + 2 * alone[2]["integral"][0] + other["integral"][0], places=14)
        self.assertAlmostEqual(j["gradient"]["s"], alone[0]["integral"][0] + alone[2]["integral"][0], places=14)
        for i in range(8):
            for k in range(3):
                self.assertAlmostEqual(j["gradient"]["m"][i][k], 2 * alone[0]["gradient"]["m"][i][k] + 2 * alone[2]["gradient"]["m"][i][k], places=13)
                self.assertAlmostEqual(j["gradient"]["b"][i][k], other["gradient"]["m"][i][k], places=13)

    def test_what_is_said(self):
        """No warning of jumps; `explain` names what is asked; a light has three vectors."""
        self.put("s.salt", FLOOR)
        r = self.run_cli("explain", "s.salt")
        self.assertNotIn("warning", r.err)
        self.assertIn("irradiance", r.out)
        self.assertIn("ltc", r.out)
        self.put("t.salt", ONE % "m.irradiance(p, n)")
        self.assertIn("E0120", self.run_cli("render", "t.salt", "-o", "i.npy", code=3).err)
        self.put("t.salt", "float f(AreaLight l) { return l.u.x + l.corner.y + l.v.z; } shader float main(float2 x) { AreaLight l = {float3(1.0), float3(2.0), float3(3.0)}; return f(l); }")
        self.assertAlmostEqual(self.json_cli("grad", "t.salt", "--integral", "--precision", "f64")["integral"][0], 6, places=12)

    def test_placed_vertices(self):
        """Derivatives go through what places vertices, for both, against differences."""
        cube = "".join("v %g %g %g\n" % (x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)) + "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n"
        self.put("cube.obj", cube)
        for what in "m.irradiance(p, n, l)", "m.ltc(p, n, float3(0.48, 0.36, 0.8), 0.4, l)":
            self.put("s.salt", """[Vertex(place)] param mesh m = "cube.obj";
                param float a = 0.3;
                float3 place(int i, float3 p, int part) { return float3(p.x + a * p.z, p.y, p.z); }
                shader float main(float2 x) {
                    AreaLight l = { float3(-1.9, 1.7, 1.2), float3(3.1, 0.1, 0.05), float3(0.07, -2.9, 0.1) };
                    float3 p = float3(0.31, 0.12, -1.9), n = float3(0.0, 0.28, 0.96);
                    return %s;
                }""" % what)
            run = lambda *a: self.json_cli("grad", "s.salt", "--integral", "--precision", "f64", "--samples", "1", *a)
            gradient = run()["gradient"]
            for name, got, at in (("a", gradient["a"], 0.3), ("m[0].z", gradient["m"][0][2], -0.5)):
                value = lambda d: run("--param", "%s=%r" % (name, at + d))["integral"][0]
                want = (8 * (value(2e-4) - value(-2e-4)) - (value(4e-4) - value(-4e-4))) / 24e-4
                self.assertGreater(abs(want), 1e-3)
                self.assertAlmostEqual(got, want, delta=1e-8, msg=(what, name))


if __name__ == "__main__":
    unittest.main()
