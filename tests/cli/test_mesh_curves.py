"""Curves of estimator `quadrature` on meshes, where only whether a ray hits counts: silhouettes are integrated to the last digits, and what is not is stated."""
import math
import os
import random
import unittest

from harness import *
from test_mesh_sites import ball, box, soup, turned

ALONG = 'param mesh m = "a.obj"; shader float main(float2 x) { [Disc] MeshHit v = m.trace(float3(x, 2.0), float3(0.0, 0.0, -1.0), %s); return v.hit ? 1.0 : 0.0; }\n'
SEEN = """param mesh m = "a.obj"; param float3 eye = float3(%(eye)s);
shader float main(float2 x) {
    float3 d = float3(%(scale)s * (x.x - 0.5), %(scale)s * (x.y - 0.5), -1.0);
    [Disc] MeshHit v = m.trace(eye, d, 0.01, 100.0);
    return v.hit ? 1.0 : 0.0;
}
"""
PIECES = """param mesh m = "a.obj"; param float3 eye = float3(%(eye)s);
shader float main(float2 x) {
    Beam b = {eye, eye + float3(-0.5 * %(scale)s, -0.5 * %(scale)s, -1.0), float3(%(scale)s, 0.0, 0.0), float3(0.0, %(scale)s, 0.0)};
    float sum = 0.0;
    for (Piece q = m.first(b); q.found; q = m.next(q)) sum += q.area;
    return sum;
}
"""
EYE = {"eye": "0.05, -0.03, 4.2", "scale": "0.8"}


def flat(v):
    return [w for u in v for w in flat(u)] if isinstance(v, list) else [v]


def read_obj(text):
    rows = [line.split() for line in text.splitlines()]
    at = [tuple(map(float, r[1:4])) for r in rows if r and r[0] == "v"]
    faces = [[int(w.split("/")[0]) - 1 for w in r[1:]] for r in rows if r and r[0] == "f"]
    return at, [(f[0], f[k], f[k + 1]) for f in faces for k in range(1, len(f) - 1)]


def shadow_of_convex(at, faces):
    """The area of a convex body seen along -z, which is that of the faces towards there, and its derivatives."""
    area, slope = 0.0, [[0.0, 0.0, 0.0] for _ in at]
    for f in faces:
        p = [at[v] for v in f]
        part = 0.5 * ((p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[1][1] - p[0][1]) * (p[2][0] - p[0][0]))
        if part < 0:
            continue
        area += part
        for k in range(3):
            q, r = p[(k + 1) % 3], p[(k + 2) % 3]
            slope[f[k]][0] += 0.5 * (q[1] - r[1])
            slope[f[k]][1] += 0.5 * (r[0] - q[0])
    return area, slope


def moved(at, scale, by):
    return [tuple(scale * c + b for c, b in zip(p, by)) for p in at]


def obj(at, faces):
    return "".join("v %r %r %r\n" % tuple(p) for p in at) + "".join("f %d %d %d\n" % tuple(v + 1 for v in f) for f in faces)


class MeshCurves(Case):
    def grad(self, file="m.salt", *more, precision="f64", estimator="quadrature"):
        return self.json_cli("grad", file, "--integral", "--estimator", estimator, "--precision", precision, *more)

    def near(self, j, value, slope, part, covered=True):
        """j is as near to it as part of the largest component says; and no farther than twice what it states, but for a hundredth."""
        got, want, error = flat(j["gradient"]["m"]), flat(slope), flat(j["stderr"]["m"])
        size = max(map(abs, want))
        self.assertLess(max(abs(g - w) for g, w in zip(got, want)), part * size)
        self.assertLess(abs(j["integral"][0] - value), max(part, 2 * j["integral_stderr"][0]))
        inside = sum(abs(g - w) <= 2 * e + 6e-11 * size for g, w, e in zip(got, want, error))
        if covered:
            self.assertGreaterEqual(inside, 0.99 * len(want))

    def against_pieces(self, text, part, precision="f64", *more):
        self.put("a.obj", text)
        self.put("m.salt", SEEN % EYE)
        self.put("p.salt", PIECES % EYE)
        exact = self.json_cli("grad", "p.salt", "--integral", "--samples", "1", "--precision", "f64")
        j = self.grad("m.salt", *more, precision=precision)
        self.near(j, exact["integral"][0], exact["gradient"]["m"], part)
        return j

    def test_triangle(self):
        """Its area and how that goes with its corners: few hundred evaluations, and all digits."""
        at, faces = [(0.2, 0.3, 0.1), (0.8, 0.25, -0.1), (0.45, 0.85, 0.0)], [(0, 1, 2)]
        self.put("a.obj", obj(at, faces))
        self.put("m.salt", ALONG % "0.0, 100.0")
        for precision, part, most in (("f64", 1e-14, 1000), ("f32", 1e-6, 20000)):
            j = self.grad(precision=precision)
            self.near(j, *shadow_of_convex(at, faces), part)
            self.assertEqual(j["left"], 0)
            self.assertLess(j["evaluations"], most)

    def test_convex(self):
        for text, most in ((box()[1], 2000), (ball(20, 40, 1.0)[1], 20000)):
            at, faces = read_obj(text)
            at = moved([turned(p, 0.5, 0.7) for p in at], 0.25, (0.5, 0.5, 0.0))  # no face is seen edge-on
            self.put("a.obj", obj(at, faces))
            self.put("m.salt", ALONG % "0.0, 100.0")
            j = self.grad()
            self.near(j, *shadow_of_convex(at, faces), 1e-12)
            self.assertEqual(j["left"], 0)
            self.assertLess(j["evaluations"], most)
            self.near(self.grad(precision="f32"), *shadow_of_convex(at, faces), 3e-2)  # of the ball's flat corners rounding leaves some

    def test_perspective(self):
        """Seen from a point, against exact pieces: bodies, triangles through each other, a body whose faces bend both ways."""
        at, faces = read_obj(ball(30, 60, 1.0)[1])
        rough = [tuple(c * (1 + 0.1 * math.sin(40 * p[0] + 17 * p[1] * p[2])) for c in p) for p in at]
        for text in (box()[1], ball(20, 40, 1.0)[1], soup(40, 0.3), obj(rough, faces)):
            j = self.against_pieces(text, 1e-9)
            self.assertLess(j["left"], 1e-9)

    @unittest.skipUnless(os.path.exists(os.path.join(os.environ.get("SALTUS_DATA", ""), "spot.obj")), "no spot.obj")
    def test_spot(self):
        """Where four lines meet in a point pieces between them are as short as rounding, and tell nothing of the next."""
        with open(os.path.join(os.environ["SALTUS_DATA"], "spot.obj")) as f:
            at, faces = read_obj(f.read())
        for turn in range(3):
            a = 0.7 + 2 * turn
            text = obj([(p[0] * math.cos(a) - p[2] * math.sin(a), p[1] - 0.2, p[0] * math.sin(a) + p[2] * math.cos(a)) for p in at], faces)
            self.assertGreater(self.against_pieces(text, 1e-9)["certified"], 1 - 1e-9)

    def test_many_in_a_point(self):
        """Triangles around a point with gaps between them, and a sheet of many faces, whose borders go on in each other."""
        for n in 3, 6, 12:
            at = [(0.0, 0.0, 0.0)]
            for i in range(n):
                for a in (2 * math.pi * i / n, 2 * math.pi * (i + 0.5) / n):
                    at.append((1.2 * math.cos(a), 1.2 * math.sin(a), 0.3 * math.cos(3 * a)))
            text = obj(at, [(0, 2 * i + 1, 2 * i + 2) for i in range(n)])
            self.against_pieces(text, 1e-9)
            self.against_pieces(text, 1e-3, "f32")
        n = 4
        at = [(2.0 * i / n - 1, 1.6 * j / n - 0.8 - 0.1 * i / n, 0.4 * i / n) for i in range(n + 1) for j in range(n + 1)]
        corner = [(i * (n + 1) + j) for i in range(n) for j in range(n)]
        text = obj(at, [f for c in corner for f in ((c, c + n + 1, c + n + 2), (c, c + n + 2, c + 1))])
        self.against_pieces(text, 1e-9)

    def test_ends_of_rays(self):
        """A slope that is seen between t0 and t1: both its ends move with the heights of its corners."""
        at, faces = [(-1.0, 0.2, -2.0), (3.0, 0.2, 2.0), (3.0, 0.7, 2.0), (-1.0, 0.7, -2.0)], [(0, 1, 2), (0, 2, 3)]
        self.put("a.obj", obj(at, faces))
        self.put("m.salt", ALONG % "1.7, 2.4")  # from height 2: of the slope z = x - 1 what lies between -0.4 and 0.3
        j = self.grad()
        self.assertAlmostEqual(j["integral"][0], 0.5 * (1 - 0.6), delta=1e-12)
        self.assertLess(j["left"], 1e-20)  # where the edge between the two faces passes an end
        self.assertAlmostEqual(sum(p[2] for p in j["gradient"]["m"]), 0.5, delta=1e-12)  # raised, more of it is seen at one end

    def test_shadow(self):
        """A box over a plane, shaded on both sides of its shadow's border, in the light of a sun."""
        corners, text = box(scale=0.12, at=(0.45, 0.5, 0.35))
        self.put("a.obj", text)
        self.put("m.salt", """param mesh m = "a.obj"; param float3 sun = float3(0.2, 0.3, 1.0);
            shader float main(float2 x) {
                float f = 0.3 + x.x;
                [Disc] if (m.occluded(float3(x, 0.0), sun, 0.0, 100.0)) f = 0.1 * x.y;
                return f;
            }""")

        def total(at, sun):
            points = sorted((p[0] - sun[0] * p[2] / sun[2], p[1] - sun[1] * p[2] / sun[2]) for p in at)

            def half(row):
                out = []
                for p in row:
                    while len(out) > 1 and (out[-1][0] - out[-2][0]) * (p[1] - out[-2][1]) <= (out[-1][1] - out[-2][1]) * (p[0] - out[-2][0]):
                        out.pop()
                    out.append(p)
                return out[:-1]
            hull, sum_ = half(points) + half(points[::-1]), 0.8
            for a, b in zip(hull, hull[1:] + hull[:1]):  # of 0.1 y - 0.3 - x
                turn = a[0] * b[1] - a[1] * b[0]
                sum_ += turn * (0.1 * (a[1] + b[1]) - (a[0] + b[0])) / 6 - 0.15 * turn
            return sum_

        def slope(f):
            e = 1e-3
            return (8 * (f(e) - f(-e)) - (f(2 * e) - f(-2 * e))) / (12 * e)
        sun = [0.2, 0.3, 1.0]
        shifted = lambda p, a, e: [c + e * (a == k) for k, c in enumerate(p)]
        want = [[slope(lambda e: total(corners[:i] + [shifted(corners[i], a, e)] + corners[i + 1:], sun)) for a in range(3)] for i in range(8)]
        j = self.grad()
        self.near(j, total(corners, sun), want, 1e-8, covered=False)
        self.assertEqual(j["left"], 0)
        for a in range(3):
            self.assertAlmostEqual(j["gradient"]["sun"][a], slope(lambda e: total(corners, shifted(sun, a, e))), delta=1e-9)

    def test_borders_of_pixels(self):
        """An edge along a row of pixels counts once, whichever way it is rounded."""
        eye = (0.3, 0.2, 1.3)
        for y in 0.25, 0.5, 0.75:
            for n in 4, 12:
                seen = [(0.2, y), (0.8, y), (0.45, y + 0.23)]
                far = [1.0 + 0.2 * k for k in range(3)]
                at = [tuple(e + f * (p - e) for e, p in zip(eye, (*s, 0.0))) for s, f in zip(seen, far)]
                self.put("a.obj", obj(at, [(0, 1, 2)]))
                self.put("m.salt", """param mesh m = "a.obj"; shader float main(float2 x) {
                    float3 eye = float3(0.3, 0.2, 1.3);
                    [Disc] MeshHit v = m.trace(eye, float3(x, 0.0) - eye, 0.0, 10.0);
                    return v.hit ? 1.0 : 0.0; }""")
                self.put("ones.pfm", b"Pf\n%d %d\n-1.0\n" % (n, n) + struct.pack("<%df" % (n * n), *[1.0] * (n * n)))
                j = self.json_cli("grad", "m.salt", "--estimator", "quadrature", "--precision", "f64", "--size", "%dx%d" % (n, n), "--adjoint", "ones.pfm")
                for k in range(3):
                    want = 0.5 * n * n * (seen[(k + 2) % 3][0] - seen[(k + 1) % 3][0]) / far[k]
                    self.assertAlmostEqual(j["gradient"]["m"][k][1] / want, 1, delta=1e-9)

    def test_edges_on_one_line(self):
        """An eye in the plane of a border sees its edges on one line, each of which still moves what is its own; also where they do not meet."""
        rng = random.Random(3)
        fan = [(-1.0, 1.0, 0.0), (0.0, 1.0, 0.3), (1.0, 1.0, 0.1), (-0.2, -0.8, 0.1)], [(0, 3, 1), (1, 3, 2)]
        row = [(-1.0, 1.0, 0.0), (-0.4, 1.0, 0.3), (-0.6, 0.1, 0.1), (-0.1, 1.0, 0.2), (0.3, 1.0, -0.2), (0.2, 0.3, 0.0), (0.6, 1.0, 0.0), (1.0, 1.0, 0.3), (0.7, 1.6, 0.1)], [(0, 2, 1), (3, 5, 4), (6, 7, 8)]
        n = 3
        sheet = [(2.0 * i / n - 1, 2.0 * j / n - 1, 0.3 * rng.random()) for j in range(n + 1) for i in range(n + 1)]
        rough = sheet, [f for j in range(n) for i in range(n) for c in [j * (n + 1) + i] for f in ((c, c + 1, c + n + 2), (c, c + n + 2, c + n + 1))]
        for at, faces in fan, row, rough:
            for eye, turn in (("-0.7, 1.0, 4.2", 0.0), ("-0.7, 1.00000001, 4.2", 0.0), (None, 0.6)):
                if eye is None:
                    eye = "%r, %r, %r" % turned((-0.7, 1.0, 4.2), turn, 0.3)
                    at = [turned(p, turn, 0.3) for p in at]
                for precision, part in (("f64", 1e-9), ("f32", 1e-4)):
                    self.put("a.obj", obj(at, faces))
                    self.put("m.salt", SEEN % {"eye": eye, "scale": "1.7"})
                    self.put("p.salt", PIECES % {"eye": eye, "scale": "1.7"})
                    exact = self.json_cli("grad", "p.salt", "--integral", "--samples", "1", "--precision", "f64")
                    j = self.grad(precision=precision)
                    self.near(j, exact["integral"][0], exact["gradient"]["m"], part, covered=precision == "f64")
                    self.assertLess(max(abs(a - b) for a, b in zip(j["gradient"]["eye"], exact["gradient"]["eye"])), part)
                    if precision == "f64":
                        self.assertLess(j["evaluations"], 20000)

    def test_one_line_from_a_light(self):
        """The same of shadows, whose rays begin all over a plane and end in the light."""
        at = [(-1.0, 1.0, 0.5), (0.0, 1.0, 0.8), (1.0, 1.0, 0.6), (-0.2, -0.8, 0.6)]
        light = (-0.7, 1.0, 3.0)

        def area(at):
            def thrown(p):
                return [(p[a] + p[2] / (light[2] - p[2]) * (p[a] - light[a]) + 3) / 6 for a in range(2)]
            q = [thrown(p) for p in at]
            return sum(0.5 * abs((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) for a, b, c in ((q[0], q[3], q[1]), (q[1], q[3], q[2])))

        def slope(i, k):
            def f(e):
                return area([[c + e * ((v, a) == (i, k)) for a, c in enumerate(p)] for v, p in enumerate(at)])
            e = 1e-3
            return (8 * (f(e) - f(-e)) - (f(2 * e) - f(-2 * e))) / (12 * e)
        self.put("a.obj", obj(at, [(0, 3, 1), (1, 3, 2)]))
        for way in "light - p, 0.0, 1.0", "normalize(light - p), 0.0, length(light - p)":
            self.put("m.salt", """param mesh m = "a.obj";
                shader float main(float2 x) {
                    float3 light = float3(%r, %r, %r), p = float3(6.0 * x.x - 3.0, 6.0 * x.y - 3.0, 0.0);
                    [Disc] if (m.occluded(p, %s)) return 1.0;
                    return 0.0;
                }""" % (*light, way))
            self.near(self.grad(), area(at), [[slope(i, k) for k in range(3)] for i in range(4)], 1e-8)

    def test_one_plane_through_an_end(self):
        """A flat sheet of many faces that t1 cuts: each moves the stretch of the cut that is its own."""
        n, far = 3, 2.03
        at = [(0.8 * i / n + 0.1 + 0.02 * j, 0.7 * j / n + 0.13, 0.31 * i / n + 0.2 * j / n - 0.4) for j in range(n + 1) for i in range(n + 1)]
        faces = [f for j in range(n) for i in range(n) for c in [j * (n + 1) + i] for f in ((c, c + 1, c + n + 2), (c, c + n + 2, c + n + 1))]

        def above(at):  # the area of what is higher than 2 - far
            total = 0.0
            for f in faces:
                p, out = [at[v] for v in f], []
                for a, b in zip(p, p[1:] + p[:1]):
                    u, v = a[2] - (2 - far), b[2] - (2 - far)
                    out += [a] if u > 0 else []
                    out += [[a[k] + u / (u - v) * (b[k] - a[k]) for k in range(3)]] if u * v < 0 else []
                total += 0.5 * sum(a[0] * b[1] - a[1] * b[0] for a, b in zip(out, out[1:] + out[:1]))
            return total

        def slope(i, k):
            def f(e):
                return above([[c + e * ((v, a) == (i, k)) for a, c in enumerate(p)] for v, p in enumerate(at)])
            e = 1e-4
            return (8 * (f(e) - f(-e)) - (f(2 * e) - f(-2 * e))) / (12 * e)
        self.put("a.obj", obj(at, faces))
        self.put("m.salt", ALONG % ("0.0, %r" % far))
        self.near(self.grad(), above(at), [[slope(i, k) for k in range(3)] for i in range(len(at))], 1e-9)

    def test_without_area(self):
        """Triangles that no ray meets cost and change nothing, where they lie free and where they close a body."""
        at, faces = [(-0.6, -0.5, 0.0), (0.7, -0.4, 0.1), (0.1, 0.8, -0.1), (0.25, 0.25, 0.5), (0.5, 0.5, 0.25), (0.375, 0.375, 0.375)], [(0, 1, 2)]
        self.put("m.salt", SEEN % EYE)
        for estimator, precision in ("quadrature", "f64"), ("quadrature", "f32"), ("lattice", "f32"):
            run = []
            for more in [], [(4, 4, 4)], [(3, 3, 4)], [(0, 0, 1), (1, 2, 2)], [(4, 4, 4)] * 30, [(3, 4, 5)]:
                self.put("a.obj", obj(at, faces + more))  # all the same vertices
                run.append(self.grad(estimator=estimator, precision=precision))
                self.assertEqual((run[-1]["gradient"], run[-1]["stderr"]), (run[0]["gradient"], run[0]["stderr"]))
                self.assertLessEqual(run[-1]["evaluations"], 1.01 * run[0]["evaluations"])
        at = [(-0.6, 0.1, 0.0), (0.6, -0.1, 0.25), (0.1, 0.8, -0.1), (0.1, -0.7, -0.2), (0.0, 0.0, 0.125), (0.1, 0.8, -0.1)]
        for before, closed in (([(0, 1, 2), (1, 0, 3)], [(0, 1, 2), (0, 3, 4), (4, 3, 1), (0, 4, 1)]),  # 4 lies on the edge between two faces
                               ([(0, 1, 2), (0, 2, 3), (1, 3, 2)], [(0, 1, 2), (0, 2, 3), (1, 3, 5), (5, 2, 1), (3, 2, 5)])):  # a face has a corner of its own
            run = []
            for faces in before, closed:
                self.put("a.obj", obj(at, faces))
                run.append(self.grad())
            self.assertAlmostEqual(run[0]["integral"][0], run[1]["integral"][0], delta=1e-13)
            self.assertLess(run[1]["evaluations"], 2 * run[0]["evaluations"])

    def test_image(self):
        """The gradient of an image takes few evaluations a pixel, and is that of exact pieces."""
        n = 48
        self.put("a.obj", ball(12, 24, 1.0)[1])
        self.put("m.salt", SEEN % EYE)
        self.put("p.salt", (PIECES % EYE).replace("Beam b = {eye, eye + float3(-0.5 * 0.8, -0.5 * 0.8, -1.0), float3(0.8, 0.0, 0.0), float3(0.0, 0.8, 0.0)};",
                                                  "Beam b = pixel_beam(eye, eye + float3(-0.4, -0.4, -1.0), float3(0.8, 0.0, 0.0), float3(0.0, 0.8, 0.0));").replace("param mesh", "import mesh; param mesh"))
        values = [math.sin(0.3 * (k % n)) * math.cos(0.2 * (k // n)) for k in range(n * n)]
        self.put("a.pfm", b"Pf\n%d %d\n-1.0\n" % (n, n) + struct.pack("<%df" % (n * n), *values))
        size = ("--size", "%dx%d" % (n, n), "--adjoint", "a.pfm", "--precision", "f64")
        exact = self.json_cli("grad", "p.salt", "--spp", "1", *size)
        for estimator in "quadrature", "auto":
            j = self.json_cli("grad", "m.salt", "--estimator", estimator, *size)
            got, want = flat(j["gradient"]["m"]), flat(exact["gradient"]["m"])
            self.assertLess(max(abs(a - b) for a, b in zip(got, want)), 1e-9 * max(map(abs, want)))
            self.assertLess(j["evaluations"], 60 * n * n)

    def test_stated(self):
        """Where evaluations run out, what is left is stated: of nearly all components no more is missing than twice the bars."""
        for text in ball(20, 40, 1.0)[1], soup(150, 0.1):
            self.put("a.obj", text)
            self.put("m.salt", SEEN % EYE)
            self.put("p.salt", PIECES % EYE)
            exact = self.json_cli("grad", "p.salt", "--integral", "--samples", "1", "--precision", "f64")
            want = flat(exact["gradient"]["m"])
            for most in "2000", "10000":
                j = json.loads(self.run_cli("grad", "m.salt", "--integral", "--estimator", "quadrature", "--precision", "f64", "--max-evaluations", most, "--json", code=None).out)
                got, error = flat(j["gradient"]["m"]), flat(j["stderr"]["m"])
                inside = sum(abs(g - w) <= 2 * e + 3e-11 for g, w, e in zip(got, want, error))
                self.assertGreaterEqual(inside, 0.95 * len(want))
                self.assertLess(abs(j["integral"][0] - exact["integral"][0]), 2 * j["integral_stderr"][0] + 1e-12)

    def test_auto(self):
        """In f64 `auto` takes quadrature where only hits count; where f hangs on what is hit, and in f32, lines."""
        self.put("a.obj", ball(20, 40, 1.0)[1])
        self.put("m.salt", SEEN % EYE)
        self.assertEqual(self.grad(estimator="auto")["certified"], 1)
        self.assertEqual(self.grad(estimator="auto", precision="f32")["certified"], 0)
        self.put("m.salt", (SEEN % EYE).replace("1.0 : 0.0", "v.t : 0.0"))
        self.assertEqual(self.grad(estimator="auto")["certified"], 0)


if __name__ == "__main__":
    unittest.main()
