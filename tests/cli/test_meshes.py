"""Meshes from the outside: what a file becomes, rays against closed forms, derivatives in vertices, what is refused, what is saved."""
import json
import math

from harness import *

# A square of two triangles at z = 0 with places in a texture, its corners written twice; a triangle at z = 1 in another part; a vertex too many.
SQUARE = """# a square, a triangle
o floor
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 1 1 -0.0
vt 0 0
vt 2 0
vt 2 3
vt 0 3
f 1/1 2/2 5/3
f 1/1 3/3 4/4
o lid
v 0 0 1
v 0.5 0 1
v 0 0.5 1
f 6 7 8
v 9 9 9
"""
DOWN = "[NoDisc] MeshHit v = m.trace(float3(x, 2.0), float3(0.0, 0.0, -1.0), 0.0, 100.0);"


class Meshes(Case):
    def mesh(self, body, more="", domain="", text=SQUARE):
        self.put("a.obj", text)
        self.put("m.salt", 'param mesh m = "a.obj"; %s %s shader float main(float2 x) { %s }\n' % (more, domain, body))

    def at(self, body, x, y, **more):
        """The value at a point: the integral over a box of one float around it."""
        self.mesh(body, domain="[Domain(float2(%r, %r), float2(%r, %r))]" % (x, y, x + 1e-6, y + 1e-6), **more)
        return self.json_cli("grad", "m.salt", "--integral", "--precision", "f64", "--samples", "64", "--estimator", "lattice")["integral"][0] / 1e-12

    def test_hits(self):
        for what, x, y, want in (("v.hit ? 1.0 : 0.0", 0.9, 0.3, 1), ("v.hit ? 1.0 : 0.0", 1.5, 0.3, 0), ("v.t", 0.9, 0.3, 2), ("v.t", 0.1, 0.1, 1), ("v.t", 1.5, 0.3, 100), ("v.p.z", 0.1, 0.1, 1),
                                 ("v.p.x", 1.5, 0.3, 1.5), ("v.normal.z", 0.9, 0.3, 1), ("v.normal.z", 0.1, 0.1, 1), ("float(v.tri)", 0.9, 0.3, 0), ("float(v.tri)", 0.3, 0.9, 1),
                                 ("float(v.tri)", 0.1, 0.1, 2), ("float(v.tri)", 1.5, 0.3, -1), ("float(v.part)", 0.9, 0.3, 0), ("float(v.part)", 0.1, 0.1, 1), ("v.uv.x", 0.9, 0.3, 1.8), ("v.uv.y", 0.9, 0.3, 0.9),
                                 ("v.uv.y", 0.3, 0.9, 2.7), ("v.uv.y", 0.1, 0.2, 0)):
            with self.subTest(what, x=x, y=y):
                self.assertAlmostEqual(self.at(DOWN + "return %s;" % what, x, y), want, delta=1e-5)

    def test_barycentric_without_vt(self):
        """u, v weigh the second and the third corner."""
        for c, want in (("x", 0.2), ("y", 0.3)):
            got = self.at(DOWN + "return v.uv.%s;" % c, 0.2, 0.3, text="v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
            self.assertAlmostEqual(got, want, delta=1e-5)

    def test_welded(self):
        """Equal positions of one part are one vertex, in the order of the lines; a vertex of no face stays."""
        self.mesh("return m_sum();".replace("m_sum()", "0.0"))
        j = self.json_cli("grad", "m.salt", "--integral")
        self.assertEqual(len(j["gradient"]["m"]), 8)
        self.mesh(DOWN + "return v.t;", text="o a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\no b\nv 0 0 0\nv -1 0 0\nv 0 -1 0\nf 4 5 6\n")
        self.assertEqual(len(self.json_cli("grad", "m.salt", "--integral")["gradient"]["m"]), 6)

    def test_derivatives(self):
        """The mean height of a tent over its floor, in every vertex: f is linear in the heights of the corners, a third of the triangle's area each."""
        for precision in "f32", "f64":
            self.mesh(DOWN + "return 2.0 - v.t;", text="v 0 0 0.1\nv 1 0 0.2\nv 1 1 0.3\nv 0 1 0.5\nf 1 2 3\nf 1 3 4\n")
            j = self.json_cli("grad", "m.salt", "--integral", "--precision", precision, "--samples", "262144")
            for vertex, want in enumerate((1 / 3, 1 / 6, 1 / 3, 1 / 6)):
                self.assertLess(abs(j["gradient"]["m"][vertex][2] - want), 2e-3)

    def test_faces_square_to_rays(self):
        """All corners at one t: the mean over the floor still hangs on every corner."""
        self.mesh(DOWN + "return 2.0 - v.t;", text="v 0 0 0.1\nv 1 0 0.1\nv 1 1 0.1\nv 0 1 0.1\nf 1 2 3\nf 1 3 4\n")
        for precision in "f32", "f64":
            j = self.json_cli("grad", "m.salt", "--integral", "--precision", precision, "--samples", "262144")
            for vertex, want in enumerate((1 / 3, 1 / 6, 1 / 3, 1 / 6)):
                self.assertLess(abs(j["gradient"]["m"][vertex][2] - want), 2e-3)

    def test_adjoint(self):
        self.mesh("float2 y = 0.8 * x + 0.1; float3 d = normalize(float3(0.1, s, -1.0)); [NoDisc] MeshHit v = m.trace(float3(y, 2.0), d, 0.0, 100.0);"
                  "return v.t * v.uv.x + dot(v.normal, float3(1.0, 2.0, 3.0)) * v.p.y;", more="param float s = 0.07;", text="v -2 -2 0.1\nv 5 -2 0.2\nv -2 5 0.3\nf 1 2 3\n")
        r = self.run_cli("check", "m.salt", "--precision", "f64", "--samples", "65536")
        self.assertEqual(r.code, 0, r.out + r.err)
        self.assertIn("PASS", r.out)

    def test_values(self):
        """Positions are set by number, as lists, by another file, before the program is compiled, whatever its triangles; the integers of a mesh are nobody's."""
        self.mesh(DOWN + "return v.t;", domain="[Domain(float2(0.6, 0.1), float2(0.7, 0.2))]")
        run = lambda *a: self.json_cli("grad", "m.salt", "--integral", *a)["integral"][0] * 100
        self.assertAlmostEqual(run(), 2, places=5)
        self.assertAlmostEqual(run("--param", "m[0].z=-1", "--param", "m[1].z=-1", "--param", "m[2].z=-1"), 3, places=5)
        self.put("b.obj", SQUARE.replace(" 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 1 1 -0.0", " -2\nv 1 0 -2\nv 1 1 -2\nv 0 1 -2\nv 1 1 -2"))
        self.assertAlmostEqual(run("--param", "m=@b.obj"), 4, places=5)
        self.put("one.obj", "v 0 0 -5\nv 3 0 -5\nv 0 3 -5\nf 1 2 3\n")
        self.assertAlmostEqual(run("--param", "m=@one.obj"), 7, places=5)
        self.put("p.json", json.dumps({"m": [[0, 0, -3], [1, 0, -3], [1, 1, -3], [0, 1, -3], [0, 0, 1], [.5, 0, 1], [0, .5, 1], [9, 9, 9]]}))
        self.assertAlmostEqual(run("--params", "p.json"), 5, places=5)

    def test_refused(self):
        for text, words in (("v 0 0 0\n", "no faces"), ("v 0 0 0\nf 1 2 3\n", "there is no vertex 3"), ("v 0 0 nan\n", "finite")):
            self.mesh("return 0.0;", text=text)
            self.refused(words, "grad", "m.salt", "--integral")
        for value, words in (('"a.csv"', ".obj or .ply"), ("zeros(3, 3)", ".obj"), ('"none.obj"', "none.obj")):
            self.put("a.csv", "1,2,3\n")
            self.put("m.salt", "param mesh m = %s; shader float main(float2 x) { return 0.0; }\n" % value)
            self.refused(words, "grad", "m.salt", "--integral")

    def refused(self, words, *args):
        r = self.run_cli(*args, code=None)
        self.assertIn(r.code, (3, 4), r.err)
        self.assertIn(words, r.err)

    def test_what_nothing_meets(self):
        """Boxes end where single precision does: what is beyond is not met, and counted; nor does anything go round for ever there."""
        beyond = "v 1e80 0 0\nv 0 1e80 0\nv 0 0 1e80\nf 1 2 3\n"
        self.put("a.obj", beyond)
        for tag, ray in (("[Disc]", "float3(0.3, 0.0, -1.0)"), ("[NoDisc]", "float3(0.0, 0.0, -1.0)")):
            self.put("m.salt", 'param mesh m = "a.obj"; shader float main(float2 x) { %s if (m.occluded(float3(x, 3.0), %s, 0.0, 9.0)) return 1.0; return 0.0; }\n' % (tag, ray))
            for estimator in ("lattice", "fd"):
                r = self.run_cli("grad", "m.salt", "--integral", "--precision", "f64", "--samples", "4096", "--estimator", estimator)
                self.assertIn("triangles of `m` that nothing meets: 1", r.err)
        self.put("b.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
        self.put("m.salt", """param float e = 1.0;
float3 place(int i, float3 p, int part) { return p / e; }
[Vertex(place)] param mesh m = "b.obj";
shader float main(float2 x) { [Disc] if (m.occluded(float3(x, 3.0), float3(0.3, 0.0, -1.0), 0.0, 9.0)) return 1.0; return 0.0; }
""")
        for precision in ("f32", "f64"):
            r = self.run_cli("grad", "m.salt", "--integral", "--precision", precision, "--param", "e=0", "--samples", "4096")
            self.assertIn("that nothing meets: 1", r.err)
            r = self.run_cli("grad", "m.salt", "--integral", "--precision", precision, "--samples", "4096")
            self.assertNotIn("meets", r.err)

    def test_jumps_are_warned_about(self):
        for body in (DOWN.replace("[NoDisc] ", "") + "return v.t;", "return m.occluded(float3(x, 2.0), float3(0.0, 0.0, -1.0), 0.0, 9.0) ? 1.0 : 0.0;"):
            self.mesh(body)
            err = self.run_cli("grad", "m.salt", "--integral").err
            self.assertIn("W0401", err)
            self.assertNotIn("cannot be a site", err)

    def test_names_stay_free(self):
        """`mesh` and `MeshHit` are no keywords: the standard library has a module of this name, people have structs."""
        self.put("m.salt", "import mesh; struct MeshHit { float a; }; shader float main(float2 x) { MeshHit h; h.a = x.x; float mesh = h.a; return mesh; }\n")
        self.assertEqual(self.run_cli("render", "m.salt", "-o", "m.pfm", "--size", "2x2").code, 0)

    def test_two_of_one_name(self):
        self.mesh("Beam b = {float3(0.0), float3(0.0), float3(1.0), float3(1.0)}; Piece q = m.first(b); return q.a;", more="struct Piece { float a; };")
        self.refused("cannot convert Piece to Piece: the language has one of this name", "explain", "m.salt")

    def test_pay_for_what_you_use(self):
        for body, asked in (("return x.x;", None), (DOWN + "return v.t;", "trace"), ("[NoDisc] bool b = m.occluded(float3(x, 2.0), float3(0.0, 0.0, -1.0), 0.0, 9.0); return b ? 1.0 : 0.0;", "occluded")):
            self.mesh(body)
            fields = self.json_cli("explain", "m.salt")["structures"]["fields"]
            self.assertEqual(len(fields), 0 if asked is None else 1)
            if asked:
                self.assertEqual((fields[0]["vertices"], fields[0]["triangles"]), (8, 3))
                self.assertIn(asked, fields[0]["queries"])
                self.assertEqual("trace" in fields[0]["queries"], asked == "trace")

    def test_fit_saves(self):
        """A fit of heights writes the mesh with its parts and places in textures: read again, it is the same program."""
        self.mesh(DOWN + "return v.t + 0.1 * v.uv.y + float(v.part);", domain="[Domain(float2(0.6, 0.1), float2(0.7, 0.2))]")
        self.put("t.salt", "[Domain(float2(0.6, 0.1), float2(0.7, 0.2))] shader float main(float2 x) { return 2.5; }\n")
        self.run_cli("render", "t.salt", "--size", "4x4", "-o", "t.exr")
        r = self.run_cli("fit", "m.salt", "--target", "t.exr", "--size", "4x4", "--iters", "30", "-o", "out")
        self.assertEqual(r.code, 0, r.err)
        self.mesh(DOWN + "return v.t + 0.1 * v.uv.y + float(v.part);", domain="[Domain(float2(0.6, 0.1), float2(0.7, 0.2))]")
        fitted = self.json_cli("grad", "m.salt", "--integral", "--params", "out/fitted.json")
        saved = self.json_cli("grad", "m.salt", "--integral", "--param", "m=@out/m.obj")
        self.assertEqual(fitted["integral"], saved["integral"])
        self.assertLess(abs(saved["integral"][0] * 100 - 2.5), 0.1)


if __name__ == "__main__":
    unittest.main()
