"""[Disc] on rays that meet meshes: silhouettes, borders, crossings of surfaces, ends of rays, edges and seams, against closed forms, exact pieces and finite differences."""
import math
import unittest

from harness import *

CAMERA = """float2 s = (x - 0.5) * %(size)s;
    float3 f = normalize(float3(%(to)s)), r = normalize(cross(f, float3(0.0, 0.0, 1.0))), u = cross(r, f);
    float3 d = f + r * s.x + u * s.y;
"""
SEEN = """param mesh m = "a.obj"; param float3 eye = float3(%(eye)s);
shader float main(float2 x) {
    """ + CAMERA + """    [Disc] MeshHit v = m.trace(eye, d, 0.01, 100.0);
    return %(value)s;
}
"""
PIECES = """param mesh m = "a.obj"; param float3 eye = float3(%(eye)s);
shader float main(float2 x) {
    float3 f = normalize(float3(%(to)s)), r = normalize(cross(f, float3(0.0, 0.0, 1.0))), u = cross(r, f);
    Beam b; b.eye = eye; b.corner = eye + f - 0.5 * %(size)s * (r + u); b.u = %(size)s * r; b.v = %(size)s * u;
    float sum = 0.0;
    for (Piece q = m.first(b); q.found; q = m.next(q)) sum += q.area * (%(piece)s);
    return sum;
}
"""
TRIANGLE = "v 0.2 0.2 0\nv 0.8 0.25 0\nv 0.35 0.75 0\nf 1 2 3\n"
DOWN = 'param mesh m = "a.obj"; shader float main(float2 x) { [Disc] MeshHit v = m.trace(float3(x, 2.0), float3(0.0, 0.0, -1.0), 0.0, 100.0); return %s; }\n'


def turned(p, a, b):
    x, y, z = p
    x, y = x * math.cos(a) - y * math.sin(a), x * math.sin(a) + y * math.cos(a)
    return x, y * math.cos(b) - z * math.sin(b), y * math.sin(b) + z * math.cos(b)


def box(angles=(0.4, 0.7), scale=1.0, at=(0.0, 0.0, 0.0), first=1):
    corners = [turned(p, *angles) for p in ((-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1))]
    corners = [tuple(scale * c + o for c, o in zip(p, at)) for p in corners]
    faces = ((1, 4, 3, 2), (5, 6, 7, 8), (1, 2, 6, 5), (2, 3, 7, 6), (3, 4, 8, 7), (4, 1, 5, 8))
    return corners, "".join("v %r %r %r\n" % p for p in corners) + "".join("f %s\n" % " ".join(str(c + first - 1) for c in f) for f in faces)


def ball(rings, columns, radius):
    at = [(0.0, 0.0, radius)]
    for i in range(1, rings + 1):
        for j in range(columns):
            u, v = math.pi * i / (rings + 1), 2 * math.pi * (j + 0.37) / columns
            at.append((radius * math.sin(u) * math.cos(v), radius * math.sin(u) * math.sin(v), radius * math.cos(u)))
    at.append((0.0, 0.0, -radius))
    ring = lambda i, j: 0 if i == 0 else len(at) - 1 if i > rings else 1 + (i - 1) * columns + j % columns
    faces = [(ring(i, j), ring(i + 1, j), ring(i + 1, j + 1)) for i in range(rings) for j in range(columns)] + \
            [(ring(i, j), ring(i + 1, j + 1), ring(i, j + 1)) for i in range(1, rings + 1) for j in range(columns)]
    faces = [f for f in faces if len(set(f)) == 3]
    return at, "".join("v %r %r %r\n" % p for p in at) + "".join("f %d %d %d\n" % tuple(c + 1 for c in f) for f in faces)


def soup(n, size, seed=3):
    state, text = seed, ""
    def uniform():
        nonlocal state
        state = (state * 6364136223846793005 + 1442695040888963407) % 2 ** 64
        return (state >> 11) / 2 ** 53
    for i in range(n):
        c = [2 * uniform() - 1 for _ in range(3)]
        for _ in range(3):
            text += "v %r %r %r\n" % tuple(c[a] + size * (2 * uniform() - 1) for a in range(3))
        text += "f %d %d %d\n" % (3 * i + 1, 3 * i + 2, 3 * i + 3)
    return text


def hull_area(points):
    points = sorted(points)
    def half(points):
        h = []
        for p in points:
            while len(h) > 1 and (h[-1][0] - h[-2][0]) * (p[1] - h[-2][1]) - (h[-1][1] - h[-2][1]) * (p[0] - h[-2][0]) <= 0:
                h.pop()
            h.append(p)
        return h[:-1]
    h = half(points) + half(points[::-1])
    return 0.5 * sum(a[0] * b[1] - a[1] * b[0] for a, b in zip(h, h[1:] + h[:1]))


class MeshSites(Case):
    def grad(self, file="m.salt", segments=262144, precision="f64", clean=True, *more):
        j = self.json_cli("grad", file, "--integral", "--estimator", "lattice", "--precision", precision, "--segments", str(segments), *more)
        if clean:
            self.assertEqual([n for n in j["dropped"].values() if n], [])
            self.assertEqual([w["message"] for w in j["warnings"] if w["code"] != "missed"], [])
        return j

    def near(self, got, want, part):
        """rms, of the rms of what is wanted"""
        got, want = [[c for row in g for c in (row if isinstance(row, list) else [row])] for g in (got, want)]
        self.assertEqual(len(got), len(want))
        error = math.sqrt(sum((a - b) ** 2 for a, b in zip(got, want)) / max(sum(b * b for b in want), 1e-300))
        self.assertLess(error, part)

    def test_triangle(self):
        """The area of a triangle, in its corners: half the side across, turned; and what border edges do."""
        self.put("a.obj", TRIANGLE)
        self.put("m.salt", DOWN % "v.hit ? 1.0 : 0.0")
        p = ((0.2, 0.2), (0.8, 0.25), (0.35, 0.75))
        want = [[0.5 * (p[(k + 1) % 3][1] - p[(k + 2) % 3][1]), 0.5 * (p[(k + 2) % 3][0] - p[(k + 1) % 3][0]), 0.0] for k in range(3)]
        for precision in "f32", "f64":
            self.near(self.grad(precision=precision)["gradient"]["m"], want, 4e-3)

    def test_box_in_perspective(self):
        """All vertices and the camera, against exact pieces."""
        self.against_pieces(box()[1], eye="3.1, 2.3, 4.2", to="-3.1, -2.3, -4.2", size="1.2", value="v.hit ? 1.0 : 0.0", piece="1.0", part=6e-3)

    def against_pieces(self, text, part, segments=1048576, **scene):
        self.put("a.obj", text)
        self.put("m.salt", SEEN % scene)
        self.put("p.salt", PIECES % scene)
        exact = self.json_cli("grad", "p.salt", "--integral", "--estimator", "lattice", "--samples", "1", "--precision", "f64")["gradient"]
        for precision in "f32", "f64":
            j = self.grad(segments=segments, precision=precision)
            self.near(j["gradient"]["m"], exact["m"], part)
            self.near([j["gradient"]["eye"]], [exact["eye"]], part)

    def test_crossing(self):
        """Triangles through each other, each of its own colour."""
        self.against_pieces(soup(20, 0.9), eye="0.1, -4.0, 0.2", to="0.02, 1.0, 0.01", size="0.7", value="v.hit ? float(v.tri % 5 + 1) : 0.0", piece="float(q.tri % 5 + 1)", part=2e-2)

    def test_missed_in_any_form(self):
        """What lines miss is stated however a hit is used, in a select or in a branch: every form weighs the same silhouettes."""
        self.put("a.obj", "v -0.5 -0.6 0\nv 0.7 -0.3 0\nv -0.1 0.8 0\nf 1 2 3\n")
        p = ((-0.5, -0.6), (0.7, -0.3), (-0.1, 0.8))
        want = [c for k in range(3) for c in (0.5 * (p[(k + 1) % 3][1] - p[(k + 2) % 3][1]), 0.5 * (p[(k + 2) % 3][0] - p[(k + 1) % 3][0]))]
        forms = {"v.hit ? 1.0 : 0.0": 1.0, "v.hit ? v.p.x - x.x + 2.0 : 0.0": 2.0, "v.hit ? c[v.part] : 0.0": 1.5, "v.hit ? c[0] : 0.0": 1.5, "v.hit ? sin(v.t) : 0.0": math.sin(2.0), "v.hit ? v.t : 0.0": 2.0}
        plane = lambda j, key, size: [c / size for row in j[key]["m"] for c in row[:2]]
        first = {}
        for value, size in forms.items():
            text = DOWN.replace("shader", "[NoDiff] param float c[1] = {1.5}; [Domain(float2(-1.0), float2(1.0))] shader")
            self.put("m.salt", text % value)
            within = n = 0
            for seed in range(1, 7):
                for samples in 1024, 16384:
                    j = self.json_cli("grad", "m.salt", "--integral", "--estimator", "lattice", "--precision", "f64", "--seed", str(seed), "--samples", str(samples))
                    g, e, m = (plane(j, key, size) for key in ("gradient", "stderr", "missed_estimate"))
                    within += sum(abs(a - b) <= 2 * c for a, b, c in zip(g, want, e))
                    n += len(g)
                    much = math.sqrt(sum(c * c for c in m))
                    self.assertGreater(much, 0, value)
                    other = first.setdefault((seed, samples), much)
                    self.assertLess(max(much / other, other / much), 1.5, value)
            self.assertGreaterEqual(within, 0.9 * n, value)

    def test_tips_of_crossings(self):
        """Two triangles through each other: the narrow ends of what one shows before the other are followed, and what is missed of them is stated."""
        self.put("a.obj", "v -0.5 -0.6 0.1\nv 0.7 -0.3 0.2\nv -0.1 0.8 -0.3\nv -0.5 0.5 -0.5\nv 0.6 0.4 0.6\nv 0.1 -0.7 0.4\nf 1 2 3\nf 4 5 6\n")
        scene = 'param mesh m = "a.obj"; shader float main(float2 x) { float3 e = float3(%s); '
        for eye in "0.0, 0.0, -10.0", "3.0, -2.0, -10.0":
            self.put("p.salt", scene % eye + "Beam b = {e, float3(-1.0, -1.0, -0.5), float3(2.0, 0.0, 0.0), float3(0.0, 2.0, 0.0)};"
                     " float s = 0.0; for (Piece q = m.first(b); q.found; q = m.next(q)) s += q.area * (1.0 + q.tri); return s; }")
            flat = lambda j, key: [c for row in j[key]["m"] for c in row]
            want = flat(self.json_cli("grad", "p.salt", "--integral", "--samples", "1", "--precision", "f64"), "gradient")
            for value in "1.0 + v.tri", "sin(1.0 + v.tri) + 1.0 + v.tri - sin(1.0 + v.tri)":
                self.put("m.salt", scene % eye + "[Disc] MeshHit v = m.trace(e, float3(2.0 * x - 1.0, -0.5) - e, 0.0, 100.0); return v.hit ? %s : 0.0; }" % value)
                within = n = 0
                for seed in range(1, 5):
                    for samples in 16384, 65536:
                        j = self.json_cli("grad", "m.salt", "--integral", "--estimator", "lattice", "--precision", "f64", "--seed", str(seed), "--samples", str(samples))
                        g, e = flat(j, "gradient"), flat(j, "stderr")
                        within += sum(abs(a - b) <= 2 * c for a, b, c in zip(g, want, e))
                        n += len(g)
                        if samples == 65536:
                            self.near([g], [want], 0.03)
                self.assertGreaterEqual(within, 0.95 * n)

    def test_two_boxes(self):
        """A box before and through another: near silhouettes before far faces, told apart by depth alone."""
        text = box()[1] + box((0.9, 0.2), 0.8, (0.9, 0.7, 0.3), 9)[1]
        self.against_pieces(text, eye="3.1, 2.3, 4.2", to="-3.1, -2.3, -4.2", size="1.2", value="v.hit ? 0.5 + float(v.part) + v.normal.x : 0.0", piece="0.5 + float(q.part) + q.normal.x", part=1e-2)

    def test_ball_grows(self):
        """The share of the view that a ball covers, by its radius: the tangent cone, within what 40 x 80 corners leave."""
        at, text = ball(40, 80, 0.5)
        self.put("a.obj", text)
        self.put("m.salt", DOWN.replace("float3(x, 2.0)", "float3(2.0 * x - 1.0, 2.0)") % "v.hit ? 1.0 : 0.0")
        g = self.grad()["gradient"]["m"]
        grows = sum(a * b for row, p in zip(g, at) for a, b in zip(row, p)) / 0.5
        self.assertAlmostEqual(grows, 2 * math.pi * 0.5 / 4, delta=0.006)

    def test_shadow_of_a_box(self):
        """The area of the shadow on a floor, in the corners and the light: the hull of the projected corners."""
        corners, text = box()
        light, floor = (0.7, 0.4, 6.0), -2.5
        self.put("a.obj", text)
        self.put("m.salt", """param mesh m = "a.obj"; param float3 light = float3(0.7, 0.4, 6.0);
            [Domain(float2(-4.0, -4.0), float2(4.0, 4.0))] shader float main(float2 x) {
                float3 p = float3(x, -2.5);
                [Disc] if (m.occluded(p, light - p, 0.001, 1.0)) return 1.0;
                return 0.0;
            }""")

        def area(corners, light):
            s = [(light[2] - floor) / (light[2] - p[2]) for p in corners]
            return hull_area([(light[0] + t * (p[0] - light[0]), light[1] + t * (p[1] - light[1])) for t, p in zip(s, corners)])

        def slope(f, p):
            e, out = 1e-6, []
            for a in range(3):
                up, down = ([c + s * e * (a == b) for b, c in enumerate(p)] for s in (1, -1))
                out.append((f(up) - f(down)) / (2 * e))
            return out
        want = [slope(lambda q: area(corners[:i] + [q] + corners[i + 1:], light), corners[i]) for i in range(8)]
        for precision in "f32", "f64":
            j = self.grad(precision=precision)
            self.near(j["gradient"]["m"], want, 6e-3)
            self.near([j["gradient"]["light"]], [slope(lambda l: area(corners, l), light)], 1e-2)

    def test_smooth_normals_and_placed_vertices(self):
        """An interpolated normal is continuous over edges: no more crossings than the silhouette's. Vertices that a function places move edges by its parameters."""
        text = ball(12, 24, 0.5)[1]
        self.put("a.obj", text)
        place = '[Vertex(place)] param mesh m = "a.obj"; param float grow = 1.2; float3 place(int i, float3 p, int part) { return grow * p; }'
        for value, most in (("v.hit ? m.smooth_normal(v).x : 2.0", 3000), ("v.hit ? v.normal.x : 2.0", None)):
            self.put("m.salt", (DOWN % value).replace('param mesh m = "a.obj";', place).replace("float3(x, 2.0)", "float3(2.0 * x - 1.0, 2.0)"))
            j = self.grad()
            if most:
                self.assertLess(j["crossings"], most)
            else:
                self.assertGreater(j["crossings"], 3000)
        self.put("m.salt", (DOWN % "v.hit ? 1.0 : 0.0").replace('param mesh m = "a.obj";', place).replace("float3(x, 2.0)", "float3(2.0 * x - 1.0, 2.0)"))
        j = self.grad()
        # the area goes with the square of the size
        self.assertAlmostEqual(j["gradient"]["grow"], 2 * j["integral"][0] / 1.2, delta=5e-3)

    def test_far_eyes_in_single_precision(self):
        """Of an eye D away depths differ by few roundings of t where surfaces cross, end or turn away; what parts two rays is told all the same."""
        self.put("a.obj", "v -0.5 -0.6 0.1\nv 0.7 -0.3 0.2\nv -0.1 0.8 -0.3\nv -0.5 0.5 -0.5\nv 0.6 0.4 0.6\nv 0.1 -0.7 0.4\nf 1 2 3\nf 4 5 6\n")
        self.put("m.salt", """param mesh m = "a.obj"; param float s = 1.0; const float D = 3.0; const bool CUT = false;
shader float main(float2 x) {
    float3 e = float3(0.3 * D, -0.2 * D, -D), d = float3(2.0 * x - 1.0, -0.5) - e;
    [Disc] MeshHit v = m.trace(e, d, 0.0, CUT ? s + 0.6 / D : 100.0);
    return v.hit ? 1.0 + (CUT ? 0.3 : 1.0) * v.tri : 0.0;
}
shader float pieces(float2 x) {
    float3 e = float3(0.3 * D, -0.2 * D, -D);
    Beam b = {e, float3(-1.0, -1.0, -0.5), float3(2.0, 0.0, 0.0), float3(0.0, 2.0, 0.0)};
    float sum = 0.0;
    for (Piece q = m.first(b); q.found; q = m.next(q)) sum += q.area * (1.0 + q.tri);
    return sum;
}
""")
        common = ("grad", "m.salt", "--integral", "--samples", "65536", "--estimator", "lattice")
        for away in (3, 10, 30, 100):
            with self.subTest(away=away):
                got = self.json_cli(*common, "--set", "D=%d" % away, "--wrt", "m")
                want = self.json_cli(*common, "--set", "D=%d" % away, "--wrt", "m", "--entry", "pieces", "--precision", "f64")
                self.assertLess(sum(got["dropped"].values()), 0.03 * got["crossings"])
                of = lambda r, k: [c for v in r[k]["m"] for c in v]
                most = max(map(abs, of(want, "gradient")))
                for g, w, e in zip(of(got, "gradient"), of(want, "gradient"), of(got, "stderr")):
                    self.assertLess(abs(g - w), 5 * e + 0.03 * most)
        for away in (30, 300, 1000):  # cut at the rays' end
            cut = ("--set", "D=%d" % away, "--set", "CUT=true", "--wrt", "s")
            single, double = self.json_cli(*common, *cut), self.json_cli(*common, *cut, "--precision", "f64")
            self.assertAlmostEqual(single["gradient"]["s"], double["gradient"]["s"], delta=0.03 * double["gradient"]["s"])

    def test_what_is_behind_an_edge(self):
        """Of a closed surface the back, which no ray sees, begins at the edges where the front ends."""
        self.put("a.obj", "v 0.5040053566320472 -0.8858986174209551 -0.3457685843405046\nv -0.12270515514487705 -0.358718013768552 0.8564874957810475\n"
                          "v 0.3945363687829276 0.5138803043470116 0.6106175424748931\nv -0.16540634916389507 -0.7120487118801835 0.7084679749543553\nf 1 2 3\nf 1 4 2\nf 2 4 3\nf 3 4 1\n")
        self.put("m.salt", """param mesh m = "a.obj";
shader float main(float2 x) {
    float3 eye = float3(0.0784233591, 0.1098848923, -3.1306808879);
    float3 d = float3(-1.0636663415, -0.8245640107, -1.0844769722) - eye + x.x * float3(2.183361380911663, -0.14564329616529468, -0.1486075621922201) + x.y * float3(-0.017928827165873518, 1.9430229656873126, 0.06621220321730582);
    [Disc] MeshHit h = m.trace(eye, d, 0.0, 100.0);
    return h.tri == 1 ? 1.0 : 0.0;
}
""")
        j = self.json_cli("grad", "m.salt", "--integral", "--samples", "262144", "--estimator", "lattice")
        self.assertEqual([c for v in j["gradient"]["m"] for c in v], [0.0] * 12)

    def test_ends_of_rays(self):
        """A slope that leaves [t0, t1] at both ends: the seen part is a strip whose borders are the ends'."""
        self.put("a.obj", "v -9 -9 -9\nv 9 -9 9\nv 9 9 9\nv -9 9 -9\nf 1 2 3 4\n")
        self.put("m.salt", """param mesh m = "a.obj"; param float near = 1.3; param float far = 1.75;
            shader float main(float2 x) { [Disc] MeshHit v = m.trace(float3(x, 2.0), float3(0.0, 0.0, -1.0), near, far); return v.hit ? x.x : 0.0; }""")
        g = self.grad()["gradient"]
        # z = x, so t = 2 - x: the strip 2 - far < x < 2 - near
        self.assertAlmostEqual(g["far"], 0.25, delta=1e-3)
        self.assertAlmostEqual(g["near"], -0.7, delta=1e-3)

    def test_seams(self):
        """A texture that jumps at an edge between faces: the edge is a site. At others it is continuous, and nothing is integrated."""
        square = "v -0.4 -1 0\nv 0.2 -1 0\nv 2 -1 0\nv 2 2 0\nv 0.8 2 0\nv -0.4 2 0\n"
        places = "vt -0.4 0\nvt 0.2 0\nvt 2 0\nvt 2 1\nvt 0.8 1\nvt -0.4 1\nvt 3 0\nvt 5 0\nvt 5 1\nvt 3 1\n"
        left = "f 1/1 2/2 5/5\nf 1/1 5/5 6/6\n"
        # u is x on the left of the edge from 2 to 5, at x = 0.4 + 0.2 y, and 3 just right of it, or x
        for right, jump in (("f 2/7 3/8 4/9\nf 2/7 4/9 5/10\n", True), ("f 2/2 3/3 4/4\nf 2/2 4/4 5/5\n", False)):
            self.put("a.obj", square + places + left + right)
            self.put("m.salt", DOWN % "v.uv.x")
            j = self.grad()
            self.assertEqual(j["crossings"] > 100, jump)
            # where its upper end goes by e the edge goes by e (y + 1) / 3
            heights = [(k + 0.5) / 1000 for k in range(1000)]
            moves = sum((0.4 + 0.2 * y - 3) * (y + 1) / 3 for y in heights) / 1000
            self.assertAlmostEqual(j["boundary"]["m"][4][0], moves if jump else 0.0, delta=5e-3)

    def test_faces(self):
        """Who uses `tri` or the normal has an event at every edge; who uses `t` has none."""
        self.put("a.obj", "v -1 -1 0.1\nv 2 -1 0.2\nv 2 2 0.3\nv -1 2 0.5\nf 1 2 3\nf 1 3 4\n")
        for value, jumps in (("float(v.tri)", True), ("v.normal.x", True), ("v.uv.x", True), ("v.t", False), ("v.p.z", False), ("float(v.part)", False)):
            self.put("m.salt", DOWN % value)
            j = self.grad()
            with self.subTest(value):
                self.assertEqual(j["crossings"] > 100, jumps)
        # tri is 1 above the diagonal: an end that goes right by e shows e / 2 more of it
        self.put("m.salt", DOWN % "float(v.tri)")
        self.near(self.grad()["boundary"]["m"], [[0.5, -0.5, 0], [0, 0, 0], [0.5, -0.5, 0], [0, 0, 0]], 5e-3)

    def test_check(self):
        """A camera, shadows and a mirror in a loop, against finite differences."""
        self.put("a.obj", box()[1] + box(scale=0.7, at=(2.2, 0.3, -0.4), first=9)[1])
        self.put("m.salt", """param mesh m = "a.obj"; param float3 light = float3(0.7, 3.4, 6.0);
            shader float main(float2 x) {
                """ + CAMERA % {"size": "1.6", "to": "-3.1, -4.3, -4.2"} + """
                float3 o = float3(3.1, 4.3, 4.2);
                float w = 1.0, sum = 0.0;
                [MaxIters(3)] for (int i = 0; i < 3; i++) {
                    [Disc] MeshHit v = m.trace(o, d, 0.001, 100.0);
                    if (!v.hit) { sum += w * (0.5 + 0.5 * normalize(d).z); break; }
                    [Disc] bool dark = m.occluded(v.p + 0.001 * v.normal, light - v.p, 0.001, 1.0);
                    sum += w * (dark ? 0.05 : 0.3 * max(dot(v.normal, normalize(light - v.p)), 0.0));
                    w *= 0.6; o = v.p; d = reflect(d, v.normal);
                }
                return sum;
            }""")
        for precision in "f32", "f64":
            r = self.run_cli("check", "m.salt", "--precision", precision, "--samples", "65536")
            self.assertEqual(r.code, 0, r.out + r.err)
            self.assertIn("PASS", r.out)
        self.grad()

    def test_same_everywhere(self):
        """The same crossings at every width, in the interpreter; the same bits from any number of threads."""
        self.put("a.obj", soup(20, 0.9))
        self.put("m.salt", SEEN % {"eye": "0.1, -4.0, 0.2", "to": "0.02, 1.0, 0.01", "size": "0.7", "value": "v.hit ? v.t + float(v.tri % 5) : 0.0"})
        run = lambda *more: self.grad("m.salt", 4096, "f32", False, "--samples", "1024", *more)
        first = run("--threads", "1")
        self.assertEqual(run("--threads", "3")["gradient"], first["gradient"])
        for more in (["--width", "1"], ["--width", "4"], ["--interpret"]):
            j = run(*more)
            self.assertEqual((j["crossings"], j["evaluations"]), (first["crossings"], first["evaluations"]))
            self.near(j["gradient"]["m"], first["gradient"]["m"], 1e-5)

    def test_images(self):
        """A fit of positions by the picture of a triangle."""
        self.put("a.obj", TRIANGLE)
        self.put("m.salt", DOWN % "v.hit ? 1.0 : 0.0")
        self.run_cli("render", "m.salt", "--size", "32x32", "--spp", "256", "-o", "t.exr")
        self.put("a.obj", TRIANGLE.replace("0.35 0.75", "0.45 0.65"))
        r = self.run_cli("fit", "m.salt", "--target", "t.exr", "--size", "32x32", "--spp", "16", "--optimizer", "lbfgs", "--iters", "25", "-o", "out")
        self.assertEqual(r.code, 0, r.err)
        p = self.json_cli("grad", "m.salt", "--integral", "--params", "out/fitted.json", "--samples", "262144")
        self.assertAlmostEqual(p["integral"][0], 0.16125, delta=2e-3)

    def test_pay_for_what_you_use(self):
        """Neighbours of faces are found where [Disc] asks, faces' own edges are sites where faces are told apart."""
        self.put("a.obj", TRIANGLE)
        for value, disc, kinds in (("v.hit ? 1.0 : 0.0", True, ["silhouette"]), ("v.normal.z", True, ["edge of faces"]), ("v.t", False, [])):
            self.put("m.salt", (DOWN if disc else DOWN.replace("[Disc]", "[NoDisc]")) % value)
            j = self.json_cli("explain", "m.salt")
            self.assertEqual([s["kind"] for s in j["sites"] if s["live"]], kinds)
            self.assertEqual("between" in j["structures"]["fields"][0]["queries"], disc)

    @unittest.skipUnless(os.environ.get("SALTUS_DATA"), "SALTUS_DATA: where spot.obj is")
    def test_spot(self):
        """A real mesh: coverage in all vertices within a hundredth of exact pieces at 2^20 segments, nothing dropped."""
        with open(os.path.join(os.environ["SALTUS_DATA"], "spot.obj")) as f:
            text = f.read()
        self.against_pieces(text, eye="1.5, -2.2, 1.0", to="-1.5, 2.2, -0.9", size="0.9", value="v.hit ? 1.0 : 0.0", piece="1.0", part=1e-2)

    def test_differences(self):
        """Which need no edges: nobody asks for them, single precision's look at scales neither; `bench` takes every estimator."""
        self.put("a.obj", TRIANGLE)
        self.put("m.salt", DOWN % "v.hit ? 1.0 : 0.0")
        self.run_cli("render", "m.salt", "--size", "4", "-o", "a.pfm")
        j = self.json_cli("grad", "m.salt", "--size", "4", "--adjoint", "a.pfm", "--spp", "1", "--estimator", "fd")
        self.assertEqual(len(j["gradient"]["m"]), 3)
        j = self.json_cli("bench", "m.salt", "--samples", "512", "--repeats", "1")
        self.assertLess({"lattice", "scanline", "snap-knn", "snap-crofton", "fd"}, set(j["curves"]) | {"quadrature"})


if __name__ == "__main__":
    unittest.main()
