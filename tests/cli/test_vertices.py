"""Vertices that a function places, and normals of vertices: values and derivatives against closed forms and differences, fits, what is refused, what costs nothing."""
import json
import math

from harness import *

# Two parts: a quadrilateral of two triangles, and a triangle; a vertex too many.
TWO = """o a
v -0.5 -0.5 0
v 0.5 -0.4 0.1
v 0.5 0.5 0.05
v -0.4 0.5 0.2
f 1 2 3
f 1 3 4
o b
v 0.6 0.1 0.3
v 0.9 0.2 0.4
v 0.7 0.8 0.3
f 5 6 7
v 9 9 9
"""
PLACE = """param float angle[2] = {0.3, -0.2};
param float3 shift = float3(0.05, 0.02, 0.1);
float3 place(int i, float3 p, int part) {
    float c = cos(angle[part]), s = sin(angle[part]);
    return float3(c * p.x - s * p.y, s * p.x + c * p.y, p.z) + shift * (1.0 + 0.1 * float(i));
}
"""
SEEN = """
    Beam b;
    b.eye = float3(0.0, 0.0, 5.0); b.corner = float3(-1.0, -1.0, 0.0); b.u = float3(2.0, 0.0, 0.0); b.v = float3(0.0, 2.0, 0.0);
    float sum = 0.0;
    for (Piece q = m.first(b); q.found; q = m.next(q)) sum += q.area * (1.0 + 0.3 * q.p.z) * q.normal.z;
    return sum;"""
DOWN = "[NoDisc] MeshHit v = m.trace(float3(x, 2.0), float3(0.0, 0.0, -1.0), 0.0, 100.0);"
TINY = 1e-9  # the side of a domain that is a point


class Vertices(Case):
    def mesh(self, body, more=PLACE, text=TWO, mark="[Vertex(place)]", domain="[Domain(0.0, 1.0)]"):
        self.put("a.obj", text)
        self.put("m.salt", '%s param mesh m = "a.obj";\n%s%s\nshader float main(float2 x) {%s}\n' % (mark, more, domain, body))

    def grad(self, *args, samples=64):
        return self.json_cli("grad", "m.salt", "--integral", "--precision", "f64", "--estimator", "lattice", "--samples", samples, *args)

    def at(self, body, x, y, *args, **more):
        """The value at a point and its derivatives."""
        self.mesh(body, domain="[Domain(float2(%r, %r), float2(%r, %r))]" % (x, y, x + TINY, y + TINY), **more)
        j, area = self.grad(*args), (x + TINY - x) * (y + TINY - y)
        scale = lambda v: [scale(w) for w in v] if isinstance(v, list) else v / area
        return scale(j["integral"])[0], {k: scale(v) for k, v in j["gradient"].items()}

    def difference(self, name, value, h=1e-3):
        """By five points: what is left goes with the fourth power of h."""
        f = lambda v: self.grad("--param", "%s=%r" % (name, v))["integral"][0]
        return (8 * (f(value + h) - f(value - h)) - (f(value + 2 * h) - f(value - 2 * h))) / (12 * h)

    def test_rigid_in_closed_form(self):
        """A plane turned about an axis in it: its height is x tan a, its normal (sin a, 0, cos a)."""
        turn = "param float a = 0.4; float3 place(int i, float3 p, int part) { return float3(cos(a) * p.x, p.y, -sin(a) * p.x); }"
        flat = "v -2 -2 0\nv 2 -2 0\nv 2 2 0\nv -2 2 0\nf 1 2 3\nf 1 3 4\n"
        for body, value, slope in (("return v.t;", lambda x, a: 2 + x * math.tan(a), lambda x, a: x / math.cos(a) ** 2), ("return v.normal.x;", lambda x, a: math.sin(a), lambda x, a: math.cos(a)),
                                   ("return m.smooth_normal(v).x;", lambda x, a: math.sin(a), lambda x, a: math.cos(a))):
            with self.subTest(body):
                f, g = self.at(DOWN + body, 0.6, 0.3, more=turn, text=flat)
                self.assertAlmostEqual(f, value(0.6, 0.4), delta=1e-8)
                self.assertAlmostEqual(g["a"], slope(0.6, 0.4), delta=1e-8)

    def test_base_positions_in_closed_form(self):
        """What is placed twice as high moves twice as far: the height of a corner weighs what it does in the triangle, doubled."""
        f, g = self.at(DOWN + "return v.p.z;", 0.2, 0.3, more="param float k = 2.0; float3 place(int i, float3 p, int part) { return float3(p.xy, k * p.z); }", text="v 0 0 0.1\nv 1 0 0.2\nv 0 1 0.4\nf 1 2 3\n")
        self.assertAlmostEqual(f, 2 * (0.5 * 0.1 + 0.2 * 0.2 + 0.3 * 0.4), delta=1e-8)
        self.assertAlmostEqual(g["k"], f / 2, delta=1e-8)
        for vertex, weight in enumerate((0.5, 0.2, 0.3)):
            self.assertAlmostEqual(g["m"][vertex][2], 2 * weight, delta=1e-8)

    def test_differences(self):
        """Parameters that place vertices, and the positions themselves, both at once."""
        self.mesh(SEEN)
        g = self.grad()["gradient"]
        for name, value, got in (("angle[0]", 0.3, g["angle"][0]), ("angle[1]", -0.2, g["angle"][1]), ("shift.x", 0.05, g["shift"][0]), ("shift.z", 0.1, g["shift"][2]), ("m[2].y", 0.5, g["m"][2][1]),
                                 ("m[5].x", 0.9, g["m"][5][0]), ("m[1].z", 0.1, g["m"][1][2])):
            with self.subTest(name):
                self.assertNotEqual(got, 0)
                self.assertAlmostEqual(got, self.difference(name, value), delta=1e-8)
        self.assertEqual(g["m"][7], [0, 0, 0])

    def test_smooth_normals(self):
        """Against differences, and continuous across an edge; of a vertex of no face and of one whose faces cancel, zero."""
        body = DOWN + "return dot(m.smooth_normal(v), float3(1.0, 2.0, -3.0));"
        for mark in "", "[Vertex(place)]":
            f, g = self.at(body, 0.1, 0.2, mark=mark)
            for name, value, got in (("m[0].x", -0.5, g["m"][0][0]), ("m[2].z", 0.05, g["m"][2][2]), ("m[3].z", 0.2, g["m"][3][2])):
                self.assertAlmostEqual(got, self.difference(name, value) / TINY ** 2, delta=2e-7)
        tent = "v 0 0 0\nv 1 0 0.5\nv 1 1 0\nv 0 1 0.5\nf 1 2 3\nf 1 3 4\n"
        sides = [self.at(DOWN + "return m.smooth_normal(v).x;", x, 0.4, mark="", more="", text=tent)[0] for x in (0.4 - 1e-7, 0.4 + 1e-7)]
        self.assertAlmostEqual(*sides, delta=1e-5)
        # Twice the same triangle, once from behind: no side is out.
        f, g = self.at(DOWN + "return m.smooth_normal(v).z;", 0.2, 0.2, mark="", more="", text="v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 3 2\n")
        self.assertEqual(f, 0)
        # A miss.
        self.assertEqual(self.at(DOWN + "return m.smooth_normal(v).z;", 5, 5, mark="", more="")[0], 0)

    def test_smooth_normals_of_pieces(self):
        """Against differences; of a flat part the face's own; of no piece zero; of something else an error that names a hit."""
        smooth = SEEN.replace("q.normal.z", "dot(m.smooth_normal(q), float3(0.2, -0.4, 1.0))")
        self.mesh(smooth)
        g = self.grad()["gradient"]
        for name, value, got in (("angle[0]", 0.3, g["angle"][0]), ("m[1].z", 0.1, g["m"][1][2]), ("m[2].y", 0.5, g["m"][2][1])):
            with self.subTest(name):
                self.assertNotEqual(got, 0)
                self.assertAlmostEqual(got, self.difference(name, value), delta=1e-8)
        flat = "v -0.6 -0.6 0.1\nv 0.7 -0.6 0.3\nv 0.7 0.8 0.4\nf 1 2 3\n"
        values = []
        for body in smooth, smooth.replace("m.smooth_normal(q)", "q.normal"):
            self.mesh(body, mark="", more="", text=flat)
            values.append(self.grad()["integral"][0])
        self.assertAlmostEqual(*values, delta=1e-12)
        self.mesh(SEEN.replace("return sum", "Piece none = m.first(b); for (int i = 0; i < 9; i++) none = m.next(none); return sum * 0.0 + length(m.smooth_normal(none))"), mark="", more="", text=flat)
        self.assertEqual(self.grad()["integral"][0], 0)
        self.mesh(SEEN.replace("return sum", "return m.smooth_normal(b).x"), mark="", more="", text=flat)
        self.assertIn("MeshHit", self.run_cli("render", "m.salt", "-o", "m.npy", code=3).err)

    def test_adjoint(self):
        self.mesh(DOWN.replace("float3(x,", "float3(0.2 * x,") + "return v.t + dot(m.smooth_normal(v), float3(0.3, 0.5, 1.0));")
        r = self.run_cli("check", "m.salt", "--precision", "f64", "--samples", 4096)
        self.assertIn("PASS", r.out)
        self.assertNotIn("FAIL", r.out)

    def test_errors_are_those_of_differences(self):
        """Vertices err together: the error of an angle is told by whole replicates."""
        self.mesh(DOWN.replace("float3(x,", "float3(0.2 * x,") + "return v.t * v.t;")
        lattice, fd = self.grad("--wrt", "angle", samples=1024), self.json_cli("grad", "m.salt", "--integral", "--precision", "f64", "--estimator", "fd", "--wrt", "angle", "--samples", 1024)
        self.assertAlmostEqual(lattice["gradient"]["angle"][0], fd["gradient"]["angle"][0], delta=5e-4)
        self.assertLess(lattice["stderr"]["angle"][0], 2 * fd["stderr"]["angle"][0])
        self.assertGreater(lattice["stderr"]["angle"][0], 0.5 * fd["stderr"]["angle"][0])

    def test_images_forward_and_reverse(self):
        """The derivative of the mean of an image, from derivative images and from a loss."""
        self.mesh(DOWN.replace("float3(x,", "float3(0.2 * x,") + "return v.t + m.smooth_normal(v).x;")
        for name in "angle[0]", "m[2].z":
            self.run_cli("grad", "m.salt", "--wrt", name, "--size", "8x8", "--spp", 16, "-o", "d.exr")
            planes = {k: v for k, v in read_exr(self.get("d.exr"))[1].items() if k.startswith("d.")}
            self.assertEqual(len(planes), 1)
            forward = sum(map(sum, *planes.values())) / 64
            got = self.grad("--wrt", name, samples=1 << 16)["gradient"][name]
            self.assertAlmostEqual(forward, got, delta=2e-3 * max(1, abs(got)))

    def test_one_arithmetic(self):
        self.mesh(SEEN)
        want = self.grad()
        for args in ("--interpret",), ("--target-cpu", "avx2"), ("--width", "1"):
            got = self.grad(*args)
            self.assertEqual(got["integral"], want["integral"])
            self.assertAlmostEqual(got["gradient"]["angle"][1], want["gradient"]["angle"][1], delta=1e-13)

    def test_activity(self):
        """What is not differentiated has no derivative; [NoDiff] holds the positions, not what places them."""
        self.mesh(SEEN)
        self.assertEqual(list(self.grad("--wrt", "angle")["gradient"]), ["angle"])
        whole, alone = self.grad()["gradient"], self.grad("--wrt", "m[2].x")["gradient"]
        self.assertEqual(alone, {"m[2].x": whole["m"][2][0]})
        self.mesh(SEEN, mark="[NoDiff] [Vertex(place)]")
        held = self.grad()["gradient"]
        self.assertEqual(sorted(held), ["angle", "shift"])
        self.assertEqual(held["angle"], whole["angle"])

    def test_two_meshes(self):
        self.put("b.obj", "v -1 -1 -0.5\nv 1 -1 -0.5\nv 1 1 -0.5\nf 1 2 3\n")
        more = 'param float lift = 0.25; float3 up(int i, float3 p, int part) { return p + float3(0.0, 0.0, lift); }\n[Vertex(up)] param mesh n = "b.obj";\n'
        self.mesh(SEEN.replace("return sum;", "for (Piece q = n.first(b); q.found; q = n.next(q)) sum += 2.0 * q.area; return sum;"), more=PLACE + more)
        g = self.grad()["gradient"]
        for name, value, got in (("lift", 0.25, g["lift"]), ("n[1].x", 1.0, g["n"][1][0]), ("angle[0]", 0.3, g["angle"][0])):
            self.assertAlmostEqual(got, self.difference(name, value), delta=1e-8)

    def test_integers_and_arrays(self):
        """What places may read integers, arrays and textures, call functions, and loop: skinning by two bones."""
        more = """param float2 weight[8] = {float2(1.0, 0.0), float2(0.5, 0.5), float2(0.2, 0.8), float2(0.0, 1.0), float2(1.0, 0.0), float2(0.3, 0.7), float2(0.0, 1.0), float2(1.0, 0.0)};
param int first = 0;
param float bone[2] = {0.1, -0.3};
float3 turned(float3 p, float a) { return float3(cos(a) * p.x - sin(a) * p.y, sin(a) * p.x + cos(a) * p.y, p.z); }
float3 place(int i, float3 p, int part) { float3 sum = float3(0.0); for (int k = 0; k < 2; k++) sum += weight[i][k] * turned(p, bone[(first + k) % 2]); return sum; }
"""
        self.mesh(SEEN, more=more)
        g = self.grad()["gradient"]
        self.assertAlmostEqual(g["bone"][1], self.difference("bone[1]", -0.3), delta=1e-8)
        self.assertAlmostEqual(g["weight"][2][1], self.difference("weight[2].y", 0.8), delta=1e-8)
        one, other = self.grad()["integral"], self.grad("--param", "first=1")["integral"]
        self.assertNotEqual(one, other)
        self.assertEqual(other, self.grad("--param", "bone=[-0.3, 0.1]")["integral"])

    def test_fit(self):
        """An angle is found again, and what is saved are the positions of the file."""
        body = DOWN.replace("float3(x,", "float3(0.2 * x,") + "return v.t;"
        self.mesh(body)
        before = self.grad()
        self.run_cli("render", "m.salt", "--size", "12x12", "--param", "shift.z=0.3", "--param", "angle[0]=0.5", "-o", "t.exr")
        for optimizer, iterations in ("lbfgs", 40), ("adam", 400):
            r = self.run_cli("fit", "m.salt", "--target", "t.exr", "--size", "12x12", "--wrt", "angle[0],shift.z", "--optimizer", optimizer, "--lr", 0.02, "--iters", iterations, "-o", "out")
            self.assertEqual(r.code, 0, r.err)
            fitted = json.loads(self.get("out/fitted.json"))
            self.assertAlmostEqual(fitted["angle"][0], 0.5, delta=5e-3)
            self.assertAlmostEqual(fitted["shift"][2], 0.3, delta=5e-3)
            self.assertEqual(fitted["m"][1][:2], [0.5, -0.4])
        self.assertEqual(self.grad("--params", "out/fitted.json", "--param", "angle[0]=0.3", "--param", "shift.z=0.1")["integral"], before["integral"])

    def test_smoothed(self):
        """A step of gradient descent under the mesh's own Laplacian, against a dense solve with its edges: (I + lambda L)^2 step = gradient."""
        self.mesh(SEEN)
        run = lambda *a: self.json_cli("fit", "m.salt", "--minimize", "--precision", "f64", "--optimizer", "sgd", "--lr", 1, "--iters", 1, "--wrt", "m", "--samples", 64, *a)["params"]["m"]
        start = [[float(v) for v in line.split()[1:]] for line in TWO.splitlines() if line.startswith("v ")]
        plain, smooth = run(), run("--smooth", "m=3")
        n, edges = 8, {(0, 1), (1, 2), (0, 2), (2, 3), (0, 3), (4, 5), (5, 6), (4, 6)}
        for axis in range(3):
            step = [smooth[i][axis] - start[i][axis] for i in range(n)]
            for _ in range(2):
                out = step[:]
                for a, b in edges:
                    out[a] += 3 * (step[a] - step[b])
                    out[b] += 3 * (step[b] - step[a])
                step = out
            for i in range(n):
                self.assertAlmostEqual(step[i], plain[i][axis] - start[i][axis], delta=1e-7)

    def test_pay_for_what_you_use(self):
        for mark, body, want in (("", SEEN, []), ("[Vertex(place)]", "return angle[0];", []), ("[Vertex(place)]", SEEN, ["placed vertices"]),
                                 ("", DOWN + "return m.smooth_normal(v).x;", ["normals of vertices"]), ("[Vertex(place)]", DOWN + "return m.smooth_normal(v).x;", ["placed vertices", "normals of vertices"])):
            self.mesh(body, mark=mark)
            j = self.json_cli("explain", "m.salt")
            self.assertEqual([d["what"] for d in j["derived"]], want)
        self.assertEqual(j["derived"][1]["from"], "m, angle, shift")
        self.assertEqual(j["no_gradient"], {})

    def test_refused(self):
        for place, words in (("float3 place(int i, float3 p) { return p; }", "E0314"), ("float2 place(int i, float3 p, int part) { return p.xy; }", "E0314"), ("", "E0314"),
                             ("float3 place(int i, float3 p, int part) { return p * rand(); }", "rand()"), ("float3 place(int i, float3 p, int part) { return p * float(pixel().x); }", "no pixel"),
                             ("float3 place(int i, float3 p, int part) { return m.trace(p, p, 0.0, 1.0).p; }", "E0503")):
            with self.subTest(place):
                self.mesh(SEEN, more=place)
                r = self.run_cli("render", "m.salt", "-o", "r.pfm", "--size", "2x2", code=3)
                self.assertIn(words, r.err)
        self.put("m.salt", "float3 place(int i, float3 p, int part) { return p; }\n[Vertex(place)] param float a = 1.0;\nshader float main(float2 x) { return a; }\n")
        self.assertIn("[Vertex]", self.run_cli("render", "m.salt", "-o", "r.pfm", "--size", "2x2", code=3).err)
        self.mesh(SEEN)
        self.assertIn("stands alone", self.run_cli("build", "m.salt", "-o", "m.o", code=2).err)

    def test_jumps_are_warned_about(self):
        self.mesh(SEEN, more=PLACE.replace("float3(c *", "(p.x > shift.x ? 1.1 : 1.0) * float3(c *"))
        self.assertIn("W0402", self.run_cli("grad", "m.salt", "--integral", "--samples", 64).err)
        self.mesh(SEEN, more=PLACE.replace("float3(c *", "max(p.x, shift.x) * (i > 3 ? 1.1 : 1.0) * float3(c *"))
        self.assertNotIn("W04", self.run_cli("grad", "m.salt", "--integral", "--samples", 64).err)

    def test_counts(self):
        text = "v 0 0 0\nv 2 0 0\nv 2 2 0\nv 0 2 0\nv 1 0 0\nv 1 -1 0\nv 2 -1 0\nv 7 7 7\nf 1 2 3 4\nf 6 2 5\nf 6 7 2\nf 2 3 1\nf 1 1 3\n"
        self.mesh(DOWN + "return v.t;", mark="", more="", text=text)
        c = self.json_cli("explain", "m.salt")["meshes"][0]
        self.assertEqual({k: c[k] for k in ("vertices", "triangles", "parts", "nonmanifold_edges", "duplicates", "degenerate", "coincident", "lone")},
                         {"vertices": 8, "triangles": 6, "parts": 1, "nonmanifold_edges": 1, "duplicates": 1, "degenerate": 1, "coincident": 1, "lone": 1})
        self.assertIn("vertex on an edge of others", self.run_cli("explain", "m.salt").out)


if __name__ == "__main__":
    unittest.main()
