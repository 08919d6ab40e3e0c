"""Visible pieces from the outside: what a window sees of simple meshes, pieces handed about, differences, what is not asked."""
import math

from harness import *

# Seen from (0, 0, 2) through the window [-1, 1]^2 at z = 0: a quarter of it, its half of the depth beyond nearer.
NEAR = "v -0.25 -0.25 1\nv 0.25 -0.25 1\nv 0.25 0.25 1\nv -0.25 0.25 1\nf 1 2 3 4\n"
BEYOND = "v -2 -2 -2\nv 2 -2 -2\nv 2 2 -2\nv -2 2 -2\no far\nf 1 2 3 4\n"
BOTH = NEAR + BEYOND.replace("f 1 2 3 4", "f 5 6 7 8")
CROSSING = "v -0.6 -0.4 0.1\nv 0.5 -0.3 0.3\nv 0.1 0.6 -0.2\nv 0.0 -0.5 0.5\nv 0.6 0.4 -0.4\nv -0.4 0.5 0.2\nf 1 2 3\nf 4 5 6\n"
WINDOW = """param float3 eye = float3(0.0, 0.0, 2.0);
Beam window() { Beam b; b.eye = eye; b.corner = float3(-1.0, -1.0, 0.0); b.u = float3(2.0, 0.0, 0.0); b.v = float3(0.0, 2.0, 0.0); return b; }
"""


class Pieces(Case):
    def program(self, body, mesh=BOTH, more=""):
        self.put("a.obj", mesh)
        self.put("m.salt", 'param mesh m = "a.obj";\n' + WINDOW + more + "shader float main(float2 x) { Beam b = window(); float sum = 0.0; " + body + " return sum; }\n")

    def integral(self, *args):
        return self.json_cli("grad", "m.salt", "--integral", "--samples", "64", "--precision", "f64", *args)

    def sum_of(self, what, **more):
        self.program("for (Piece q = m.first(b); q.found; q = m.next(q)) sum += %s;" % what, **more)
        return self.integral()["integral"][0]

    def test_what_is_seen(self):
        for what, want in (("q.area", 1), ("q.part == 0 ? q.area : 0.0", 0.25), ("q.tri < 2 ? q.area : 0.0", 0.25), ("q.area * q.centre.x", 0.5), ("q.area * q.centre.y", 0.5),
                           ("q.area * q.p.z", 0.25 - 1.5), ("q.area * q.normal.z", 1)):
            with self.subTest(what):
                self.assertAlmostEqual(self.sum_of(what), want, delta=1e-11)  # windows are put aside by 7e-13, and this floor ends at their border

    def test_known_derivative(self):
        """The side of the square at x = 0.25 seen at x = 0.5: dA = 0.5 / 2 * 2 dx, of the window's 2 by 2."""
        self.sum_of("q.part == 0 ? q.area : 0.0")
        m = self.integral()["gradient"]["m"]
        self.assertAlmostEqual(m[1][0] + m[2][0], 0.5, delta=1e-12)
        self.assertAlmostEqual(sum(v[0] for v in m), 0, delta=1e-12)
        self.assertAlmostEqual(sum(v[2] for v in m[:4]), 0.5, delta=1e-12)

    def test_edge_on(self):
        """A tread that is seen as a line, at its height, between two risers: they fill the window before and behind it, wherever anything goes, so nothing moves the area."""
        stairs = [(-9.0, -9.0, 0.0), (9.0, -9.0, 0.0), (9.0, 0.3, 0.0), (-9.0, 0.3, 0.0), (9.0, 0.3, -1.0), (-9.0, 0.3, -1.0), (9.0, 12.0, -1.0), (-9.0, 12.0, -1.0)]
        faces = [(1, 2, 3), (1, 3, 4), (4, 3, 5), (4, 5, 6), (6, 5, 7), (6, 7, 8)]
        for turn in 0.0, 0.4:
            c, s = math.cos(turn), math.sin(turn)
            lines = ["v %r %r %r" % (c * p[0] - s * p[1], s * p[0] + c * p[1], p[2]) for p in stairs] + ["f %d %d %d" % f for f in faces]
            eye = "param float3 eye = float3(%r, %r, 2.0);\n" % (-s * 0.3, c * 0.3)
            for size in "1x1", "48x48":
                self.program("b = pixel_beam(b.eye, b.corner, b.u, b.v); for (Piece q = m.first(b); q.found; q = m.next(q)) sum += q.area;", "\n".join(lines))
                with open(self.path("m.salt")) as f:
                    text = f.read()
                self.put("m.salt", "import mesh;\n" + text.replace(WINDOW.splitlines()[0] + "\n", eye))
                n = int(size.split("x")[0])
                self.put("ones.pfm", b"Pf\n%d %d\n-1.0\n" % (n, n) + struct.pack("<%df" % (n * n), *[1.0] * (n * n)))
                j = self.json_cli("grad", "m.salt", "--spp", "1", "--precision", "f64", "--size", size, "--adjoint", "ones.pfm")
                for g in [j["gradient"]["eye"]] + j["gradient"]["m"]:
                    self.assertLess(max(map(abs, g)), 1e-9 * n * n)

    def test_without_area(self):
        """What a triangle without area closes is closed wherever its corners go, one of which lies on an edge between two faces."""
        self.program("for (Piece q = m.first(b); q.found; q = m.next(q)) sum += q.area;",
                     "v -0.6 0.1 0\nv 0.6 -0.1 0.25\nv 0.1 0.8 -0.1\nv 0.1 -0.7 -0.2\nv 0 0 0.125\nf 1 2 3\nf 1 4 5\nf 5 4 2\nf 1 5 2\n")
        self.assertLess(max(map(abs, self.integral()["gradient"]["m"][4])), 1e-10)

    def test_handed_about(self):
        loop = self.sum_of("q.area * (1.0 + q.centre.x)", mesh=CROSSING)
        weigh = "float weigh(Piece q) { return q.area * (1.0 + q.centre.x); }\n"
        for name, more, body in (
            ("function", weigh, "for (Piece q = m.first(b); q.found; q = m.next(q)) sum += weigh(q);"),
            ("while", weigh, "Piece q = m.first(b); while (q.found) { sum += weigh(q); q = m.next(q); }"),
            ("mesh", weigh + "float all(in mesh s, Beam b) { float sum = 0.0; for (Piece q = s.first(b); q.found; q = s.next(q)) sum += weigh(q); return sum; }\n", "sum = 0.5 * all(m, b) + 0.5 * all(m, b);"),
            ("nested", weigh, "float n = 0.0; for (Piece q = m.first(b); q.found; q = m.next(q)) { n += 1.0; for (Piece r = m.first(b); r.found; r = m.next(r)) sum += weigh(r); } sum /= n;"),
        ):
            with self.subTest(name):
                self.program(body, mesh=CROSSING, more=more)
                self.assertAlmostEqual(self.integral()["integral"][0], loop, delta=1e-12)
                self.assertAlmostEqual(self.integral("--interpret")["integral"][0], loop, delta=1e-12)

    def test_windows_that_are_not_finite(self):
        """Nothing is seen through them, which the answer does not tell."""
        for number, blind in (("sqrt(x.x - 0.9)", True), ("1.0 / (x.x - x.x)", True), ("sqrt(max(x.x - 0.9, 0.0))", False)):
            for where in ("eye.x", "u.y"):
                with self.subTest(number + where):
                    self.program("b.%s = %s; for (Piece q = m.first(b); q.found; q = m.next(q)) sum += q.area;" % (where, number))
                    for args in (("grad", "m.salt", "--integral", "--samples", "64"), ("grad", "m.salt", "--integral", "--samples", "64", "--interpret"), ("render", "m.salt", "--size", "8")):
                        err = self.run_cli(*args).err
                        (self.assertIn if blind else self.assertNotIn)("a window through which pieces of `m` were asked had a number that is not finite", err)
        self.program("if (x.x > 0.9) { b.eye.x = sqrt(x.x - 0.9); for (Piece q = m.first(b); q.found; q = m.next(q)) sum += q.area; }")
        self.assertNotIn("finite", self.run_cli("grad", "m.salt", "--integral", "--samples", "64").err)

    def test_of_another_mesh(self):
        """A piece has a next one in its own mesh alone."""
        self.put("b.obj", NEAR)
        self.program("for (Piece q = m.first(b); q.found; q = other.next(q)) sum += 1.0;", more='param mesh other = "b.obj";\n')
        self.assertEqual(self.integral()["integral"][0], 1)

    def test_check(self):
        self.program("for (Piece q = m.first(b); q.found; q = m.next(q)) sum += q.area * (1.0 + q.p.z + q.normal.x * q.centre.y);", mesh=CROSSING)
        for args in ((), ("--precision", "f64"), ("--width", "4")):
            with self.subTest(args):
                self.assertIn("PASS", self.run_cli("check", "m.salt", *args).out)

    def test_reverse_searches_once(self):
        """Of many pieces that ask for light: a frame for each on the tape, with what was found, whatever the bound of the loop; and the derivative is right."""
        n = 12
        wavy = "".join("v %.4f %.4f %.4f\n" % (1.6 * i / n - 0.8, 1.6 * k / n - 0.8, 0.1 * math.sin(2.0 * i) * math.cos(1.7 * k)) for k in range(n + 1) for i in range(n + 1))
        wavy += "".join("f %d %d %d %d\n" % (a, a + 1, a + n + 2, a + n + 1) for k in range(n) for i in range(n) for a in [k * (n + 1) + i + 1])
        more = "param float3 lamp = float3(-0.4, -0.3, 1.5);\nparam float s = 1.3;\n"
        self.program("AreaLight l = {lamp, float3(0.0, 0.7, 0.0), float3(0.6, 0.0, 0.0)}; for (Piece q = m.first(b); q.found; q = m.next(q)) sum += s * q.area * m.irradiance(q.p, q.normal, l);", mesh=wavy, more=more)
        tape = self.run_cli("explain", "m.salt").out.split("tape of vjp")[1].split("\n\n")[0]
        self.assertIn("for each of what is told", tape)
        self.assertIn("witness (nothing is searched again)", tape)
        self.assertNotIn("checkpointed", tape)
        gradient = self.integral()["gradient"]
        self.assertAlmostEqual(gradient["s"] * 1.3, self.integral()["integral"][0], delta=1e-12)
        self.assertEqual(gradient["lamp"], self.integral("--interpret")["gradient"]["lamp"])
        h = 1e-4
        for k, at in enumerate((-0.4, -0.3, 1.5)):
            sides = [self.integral("--param", "lamp.%s=%r" % ("xyz"[k], at + sign * h))["integral"][0] for sign in (1, -1)]
            self.assertAlmostEqual(gradient["lamp"][k], (sides[0] - sides[1]) / (2 * h), delta=1e-6)

    def test_nothing_knows_bounds(self):
        """Nobody runs boxes through a loop over pieces, which would not end."""
        self.program("for (Piece q = m.first(b); q.found; q = m.next(q)) sum += q.area;", mesh=CROSSING)
        self.assertIn("no cells", self.run_cli("grad", "m.salt", "--integral", "--estimator", "quadrature").err)

    def test_what_kernels_ask(self):
        """Sides are for derivatives."""
        self.program("for (Piece q = m.first(b); q.found; q = m.next(q)) sum += q.area;", mesh=CROSSING)
        text = self.run_cli("explain", "m.salt").out
        self.assertRegex(text, r"value +begin, seen")
        self.assertRegex(text, r"vjp +begin, pieces")

    def test_arrays_in_the_loop(self):
        """What reverse mode keeps of a loop over pieces is bounded by the faces."""
        self.program("float s[4]; for (Piece q = m.first(b); q.found; q = m.next(q)) s[q.tri] += q.area; sum = s[0] * s[1];")
        whole = self.integral()["gradient"]["m"]
        self.program("float u = 0.0, v = 0.0; for (Piece q = m.first(b); q.found; q = m.next(q)) { u += q.tri == 0 ? q.area : 0.0; v += q.tri == 1 ? q.area : 0.0; } sum = u * v;")
        for got, want in zip(whole, self.integral()["gradient"]["m"]):
            for a, b in zip(got, want):
                self.assertAlmostEqual(a, b, delta=1e-12)

    def test_what_jumps_is_warned_about(self):
        """What has the factor `area`, and is summed over all pieces, does not jump where one comes, goes or is cut."""
        loop = "for (Piece q = m.first(b); q.found; q = m.next(q)) "
        silent = (
            "sum += q.area * (k + q.normal.x * q.centre.x);",
            "{ if (q.part == 0) sum += q.area; else sum += 2.0 * q.area; }",
            "{ if (q.tri == 3) continue; sum += q.area; }",
            "{ sum += q.area; other += q.area * k; } sum = sum * sum + sqrt(other + 1.0);",
            "sum += q.area; sum = lerp(0.2, k, sum);",
            "{ float w = 0.0; for (int i = 0; i < 4; i++) w += q.area * float(i); sum += w; }",
            "{ float w = k; for (int i = 0; i < 4; i++) w = w * 0.5 + q.p.x; sum += q.area * w; }",
            "{ float w = q.area; if (x.x > 0.5) w *= 2.0; sum += w; }",
            "{ if (q.area > 0.0) sum += q.area * k; }",
            "{ float3 c = q.part == 0 ? float3(1.0) : q.normal; sum += q.area * dot(c, c) / (1.0 + q.p.z * q.p.z); }",
            "acc[q.part & 3] += q.area; sum = acc[0] + acc[1] * k;",
        )
        loud = (
            "sum += 1.0;",
            "{ if (q.part == 0) sum += q.area; else sum += 2.0; }",
            "sum += q.area * q.area;",
            "sum = max(sum, q.area);",
            "sum = q.normal.z;",
            "{ sum += other * k; other *= 1.0 - q.area; }",
            "acc[q.part & 3] += 1.0; sum = acc[0] + acc[1] * k;",
            "{} sum = m.first(b).found ? 1.0 : 0.0;",
            "{} sum = k * m.first(b).area;",
            "{} sum = m.next(m.first(b)).area;",
            "sum += q.area / max(q.area, 1e-9);",
            "{ other += 1.0; sum += q.area * other; }",
            "{ other += 1.0; sum += q.area; if (other > 2.0) break; }",
            "{ sum += q.area; if (q.part == 1) break; }",
            "sum += q.area * (1.0 + sum);",
            "sum = lerp(sum, 1.0, q.area);",
            "{ if (q.area > 0.1) sum += q.area; }",
            "sum += sqrt(q.area);",
        )
        before = "float other = 1.0; float acc[4]; for (int i = 0; i < 4; i++) acc[i] = 0.0; b.corner.x += 0.1 * x.x; "
        for body, warned in [(s, False) for s in silent] + [(s, True) for s in loud] + [("sum += 1.0;", None)]:
            with self.subTest(body=body):
                self.program(before + ("[NoDisc] " if warned is None else "") + loop + body, more="param float k = 1.0;\n")
                self.assertEqual("visible pieces" in self.run_cli("explain", "m.salt").err, bool(warned))
        for window in ("b.corner.x += 0.01 * float(pixel().x); ", ""):  # one for a pixel, one for all
            self.program(window + loop + "sum += 1.0;")
            self.assertIn("W0402", self.run_cli("explain", "m.salt").err)
            self.program(window + loop + "sum += q.area * q.p.z;")
            self.assertNotIn("W04", self.run_cli("explain", "m.salt").err)
        self.program("for (int i = 0; i < 3; i++) { b.eye.x += 0.1; " + loop + "sum += q.area * float(i); }")
        self.assertNotIn("W04", self.run_cli("explain", "m.salt").err)

    def test_edges_on_borders(self):
        """A square whose corners are those of pixels, and a floor behind it: borders of pixels do not move, and its edges must in one of two."""
        square = lambda a, z: "".join("v %g %g %g\n" % (x * a, y * a, z) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
        self.put("two.obj", "g floor\n" + square(3, -0.001) + "f 1 2 3 4\ng square\n" + square(1, 0) + "f 5 6 7 8\n")
        self.put("s.salt", """const float AWAY = 1e3; param float size = 0.5;
            float3 grown(int i, float3 p, int part) { return part == 0 ? p : float3(p.xy * size, p.z); }
            [Vertex(grown)] [NoDiff] param mesh two = "two.obj";
            shader float main(float2 x) {
                float2 n = float2(resolution()), at = float2(pixel());
                Beam b = { float3(0.0, 0.0, AWAY), float3(-1.0 + 2.0 * at.x / n.x, 1.0 - 2.0 * (at.y + 1.0) / n.y, 0.0), float3(2.0 / n.x, 0.0, 0.0), float3(0.0, 2.0 / n.y, 0.0) };
                float sum = 0.0;
                for (Piece q = two.first(b); q.found; q = two.next(q)) sum += q.area * (q.part == 0 ? 0.25 : 1.0);
                return sum;
            }""")
        for n in 1, 4, 12, 100:
            self.put("one.pfm", write_pfm(n, n, 1, [1 / (n * n)] * (n * n)))
            for precision, close, away in ("f32", 1e-6, "1e3"), ("f64", 1e-7, "1e3"), ("f32", 1e-6, "2.0"), ("f64", 1e-7, "2.0"), ("f64", 1e-7, "0.7"):
                j = self.json_cli("grad", "s.salt", "--adjoint", "one.pfm", "--size", str(n), "--precision", precision, "--set", "AWAY=" + away)
                self.assertAlmostEqual(j["gradient"]["size"], 0.75, delta=close, msg=(n, precision, away))

    def test_once_for_value_and_derivative(self):
        """What the value of a loss has seen serves its derivative: more windows than are kept, two meshes, pixels without a residual."""
        self.put("a.obj", CROSSING)
        self.put("b.obj", NEAR)
        self.put("l.salt", """import mesh;
            param mesh m = "a.obj";
            param mesh other = "b.obj";
            shader float main(float2 x) {
                float sum = 0.0;
                for (int i = 0; i < 12; i++) {
                    Beam b = pixel_beam(float3(0.05 * float(i), 0.0, 2.0), float3(-1.0, -1.0, 0.0), float3(2.0, 0.0, 0.0), float3(0.0, 2.0, 0.0));
                    for (Piece q = m.first(b); q.found; q = m.next(q)) sum += q.area * (1.0 + q.centre.x);
                    for (Piece q = other.first(b); q.found; q = other.next(q)) sum += 0.5 * q.area * q.p.x;
                }
                return sum;
            }""")
        n = 40
        self.run_cli("render", "l.salt", "--size", str(n), "-o", "image.pfm")
        _, image = read_pfm(self.get("image.pfm"))
        target = [v if i % 3 == 0 else 0.1 for i, v in enumerate(image)]
        self.put("target.pfm", write_pfm(n, n, 1, target))
        self.put("adjoint.pfm", write_pfm(n, n, 1, [2 * (a - b) / (n * n) for a, b in zip(image, target)]))
        loss = self.json_cli("grad", "l.salt", "--target", "target.pfm", "--size", str(n))
        weighed = self.json_cli("grad", "l.salt", "--adjoint", "adjoint.pfm", "--size", str(n))
        self.assertAlmostEqual(loss["loss"], sum((a - b) ** 2 for a, b in zip(image, target)) / (n * n), delta=1e-6 * loss["loss"])
        for name in "m", "other":
            for a, b in zip(loss["gradient"][name], weighed["gradient"][name]):
                for x, y in zip(a, b):
                    self.assertAlmostEqual(x, y, delta=1e-6 * abs(y) + 1e-8, msg=name)


if __name__ == "__main__":
    unittest.main()
