"""Parameters as arrays: shapes of every kind, views that write through, names of parts, refusals that name the place."""
import copy
import pickle

from harness import *

KINDS = """
struct Inner { float2 p; int k; };
struct Disc { float2 centre; float radius; Inner inner[2]; bool on; uint mark; };
Disc disc(int i) {
    float f = float(i);
    Disc d = { float2(0.2 * f + 0.1, 0.5), 0.1 + 0.1 * f, { { float2(1.0, 2.0), 1 }, { float2(3.0, 4.0), 2 } }, true, 7u };
    return d;
}
int five(int i) { return i; }
float ramp(int i, int j) { return float(10 * i + j); }
float2x2 turn(int i) { return float2x2(1.0, 2.0, 3.0, float(i)); }
param Disc discs[3] = init(disc);
param Disc one = { float2(0.1, 0.5), 0.1, { { float2(1.0, 2.0), 1 }, { float2(3.0, 4.0), 2 } }, true, 7u };
[Range(-1.0, 4.0)] [Log] [Doc("how long")] param float length_of = 0.5;
[Color] param float3 ink = float3(0.1, 0.2, 0.3);
param float3x2 m = float3x2(1.0, 2.0, 3.0, 4.0, 5.0, 6.0);
param float2x2 ms[4] = init(turn);
param int n = 3;
param uint un = 4000000000u;
param bool flag = true;
param int ns[5] = init(five);
param float grid[3][4] = init(ramp);
param float xs[] = "xs.json";
param texture2D tex = zeros(5, 3, 3);
param texture3D solid = zeros(4, 3, 2, 1);
[Extent(-2.0, -1.0, 2.0, 1.0)] param heightfield terrain = zeros(6, 5);
shader float main(float2 x) {
    float s = 0.0;
    for (int i = 0; i < 3; i++) {
        [Disc] if (length(x - discs[i].centre) < discs[i].radius) s += discs[i].inner[1].p.y;
    }
    s += float(n) + float(un % 7u) + (flag ? 0.5 : 0.0) + float(ns[2]);
    return s + xs[0] + m[0][0] + m[2][1] + ms[3][1][1] + one.radius + ink.y + grid[1][2] + length_of;
}
"""
XS = [1.0, 2.0, 3.0]


class ProgramCase(Case):
    SOURCE = KINDS
    OPTIONS = {"params": {"xs": XS}}

    def setUp(self):
        super().setUp()
        self.p = saltus.compile(self.SOURCE, **self.OPTIONS)


class Shapes(ProgramCase):
    def test_shapes(self):
        p = self.p
        expected = {"length_of": (), "ink": (3,), "m": (3, 2), "ms": (4, 2, 2), "n": (), "un": (), "flag": (), "ns": (5,), "grid": (3, 4), "xs": (3,)}
        self.assertEqual({name: p[name].shape for name in expected}, expected)
        self.assertEqual(list(p.params), ["discs", "one", "length_of", "ink", "m", "ms", "n", "un", "flag", "ns", "grid", "xs", "tex", "solid", "terrain"])

    def test_pictures(self):
        p = self.p
        self.assertEqual(p["tex"].shape[:2], (3, 5))
        self.assertEqual(p["solid"].shape[:3], (2, 3, 4))
        self.assertEqual(p["terrain"].shape, (5, 6))
        self.assertEqual([p.params.info(n).kind for n in ("tex", "solid", "terrain")], ["texture", "texture", "heightfield"])
        self.assertEqual(p.params.info("terrain").extent, (-2, -1, 2, 1))

    def test_values(self):
        p = self.p
        self.same(p["m"], [[1, 2], [3, 4], [5, 6]])
        self.same(p["ms"][:, 1, 1], [0, 1, 2, 3])
        self.same(p["grid"], [[0, 1, 2, 3], [10, 11, 12, 13], [20, 21, 22, 23]])
        self.same(p["ns"], range(5))
        self.same(p["xs"], XS)
        self.assertEqual((p["n"], p["un"], p["flag"]), (3, 4000000000, True))

    def test_types(self):
        p = self.p
        types = {"m": np.float64, "n": np.int32, "un": np.uint32, "flag": np.bool_, "ns": np.int32}
        self.assertEqual({name: p[name].dtype.type for name in types}, types)
        self.assertEqual((p["discs"].on.dtype, p["discs"].mark.dtype), (np.bool_, np.uint32))

    def test_structs(self):
        discs = self.p["discs"]
        self.assertEqual((discs.shape, discs.centre.shape, discs.radius.shape), ((3,), (3, 2), (3,)))
        self.assertEqual((discs.inner.shape, discs.inner.p.shape, discs.inner.k.shape), ((3, 2), (3, 2, 2), (3, 2)))
        self.assertEqual((self.p["one"].shape, self.p["one"].inner.p.shape, self.p["one"].radius.shape), ((), (2, 2), ()))
        self.same(discs.inner.k, [[1, 2]] * 3)
        np.testing.assert_allclose(discs.centre[:, 0], [0.1, 0.3, 0.5], rtol=1e-6)
        self.assertEqual(list(discs), ["centre", "radius", "inner", "on", "mark"])

    def test_infos(self):
        info = self.p.params.info("length_of")
        self.assertEqual((info.name, info.type, info.shape, info.kind), ("length_of", "float", (), "float"))
        self.assertEqual((info.range, info.log, info.doc, info.color, info.differentiable), ((-1, 4), True, "how long", False, True))
        self.assertTrue(self.p.params.info("ink").color)
        self.assertEqual((self.p.params.info("n").differentiable, self.p.params.info("discs").kind), (False, "struct"))
        self.refused("did you mean `ink`?", self.p.params.info, "inkk")

    def test_html(self):
        html = self.p.params._repr_html_()
        self.assertEqual(html.count("<th>"), 5)
        self.assertIn("<td>3 x 5 x 3, 0 to 0</td>", html)  # a texture is no page of numbers
        self.assertIn("<td>ink</td><td>float3</td>", html)
        self.assertIn("how long", html)

    def test_gradients_have_these_shapes(self):
        g = self.p.vjp(np.ones((4, 4, 1)))
        self.assertEqual((g["m"].shape, g["ms"].shape, g["discs"].inner.p.shape, g["grid"].shape), ((3, 2), (4, 2, 2), (3, 2, 2), (3, 4)))
        self.assertNotIn("n", g)
        self.assertNotIn("on", g["discs"])
        r = self.p.integral(64).gradient
        self.assertEqual((r["m"].shape, r["discs"].inner.p.shape, r["discs[1].centre.x"].shape), ((3, 2, 1), (3, 2, 2, 1), (1,)))


class Writing(ProgramCase):
    def value(self):
        return float(self.p.eval([0.9, 0.9])[0])

    def test_views_write_through(self):
        before = self.value()
        self.p["m"][0, 0] += 2
        self.p["ink"][1] -= 0.5
        self.p["grid"][1][2] *= 2
        self.assertAlmostEqual(self.value() - before, 2 - 0.5 + 12, places=4)

    def test_numbers_without_dimensions(self):
        before = self.value()
        self.p["length_of"] += 1
        self.p["one"].radius += 2
        self.p["n"] += 4
        self.assertAlmostEqual(self.value() - before, 7, places=4)

    def test_bools(self):
        before = self.value()
        self.p["flag"][...] = False
        self.assertAlmostEqual(self.value() - before, -0.5, places=5)
        self.p["flag"] = 1
        self.assertAlmostEqual(self.value(), before, places=5)
        for wrong in (2, -1, 0.5, float("nan")):
            self.refused("flag is true or false", self.p.params.__setitem__, "flag", wrong)

    def test_unsigned(self):
        self.p["un"] = 4294967295
        self.assertEqual(int(self.p["un"]), 4294967295)
        self.refused("from 0 to 4294967295", self.p.params.__setitem__, "un", -1)
        self.refused("from 0 to 4294967295", self.p.params.__setitem__, "un", 1 << 32)

    def test_records(self):
        discs = self.p["discs"]
        discs.radius = [1, 2, 3]
        discs[1].radius = 9
        discs[2].inner[0].p = [7, 8]
        discs[0] = {"centre": [5, 6], "on": False}
        discs[-1]["mark"] = 3
        self.same(discs.radius, [1, 9, 3])
        self.same(self.p["discs[2].inner[0].p"], [7, 8])
        self.same(self.p["discs"].centre[0], [5, 6])
        self.same(discs.on, [False, True, True])
        self.assertEqual(self.p["discs[2].mark"], 3)
        self.p["discs"] = [{"radius": 4}, {"radius": 5}, {"radius": 6}]
        self.p["discs"] = {"inner": {"k": 11}}
        self.same(discs.radius, [4, 5, 6])
        self.same(discs.inner.k, 11)
        discs[1:].radius[:] = 0
        self.same(discs.radius, [4, 0, 0])

    def test_unknown_names_are_both_errors(self):
        for look, said in ((lambda: self.p["disc"], "did you mean `discs`?"), (lambda: self.p["discs"]["centr"], "did you mean `centre`?")):
            for kind in (KeyError, saltus.UsageError):
                with self.assertRaises(kind) as caught:
                    look()
                self.assertEqual(str(caught.exception).count("there is no"), 1)
                self.assertTrue(str(caught.exception).endswith(said))
        self.assertIsNone(self.p.params.get("disc"))

    def test_floats_that_are_whole(self):
        self.p["n"] = 2.0
        self.p["ns"] = np.arange(5.0) * 2
        self.assertEqual((int(self.p["n"]), int(self.p["ns"][4])), (2, 8))
        for wrong in (2.5, float("nan"), float("inf"), 1 << 31, -(1 << 31) - 1):
            self.refused("n", self.p.params.__setitem__, "n", wrong)
        self.assertEqual(int(self.p["n"]), 2)

    def test_other_kinds_of_numbers(self):
        self.p["ink"] = (1, 2, 3)
        self.p["m"] = np.arange(6, dtype=">f4").reshape(2, 3).T
        self.p["xs"] = [np.float16(1), True, np.int8(4)]
        self.same(self.p["m"], [[0, 3], [1, 4], [2, 5]])
        self.same(self.p["xs"], [1, 1, 4])
        self.p["ink"] = 0.25  # as NumPy spreads it
        self.same(self.p["ink"], [0.25] * 3)

    def test_not_finite(self):
        self.p["length_of"] = float("nan")
        self.assertTrue(np.isnan(self.value()))
        self.p["length_of"] = float("inf")
        self.assertEqual(self.value(), float("inf"))

    def test_text(self):
        self.p["n"] = "7"
        self.p["ink"] = "[0.5, 0.25, 1]"
        self.p["discs[1].centre"] = "0.5,0.75"
        np.save(self.path("grid.npy"), np.full((3, 4), 9.0, np.float32))
        self.p["grid"] = "@" + self.path("grid.npy")
        self.same(self.p["ink"], [0.5, 0.25, 1])
        self.same(self.p["discs"].centre[1], [0.5, 0.75])
        self.same(self.p["grid"], 9)
        self.assertEqual(int(self.p["n"]), 7)
        self.refused("q", self.p.params.__setitem__, "q", "1")
        self.refused("NUL", self.p.params.__setitem__, "n", "7\0")

    def test_json_there_and_back(self):
        self.p["n"], self.p["ink"], self.p["discs"].radius = 5, [0.5, 0.25, 1], [4, 5, 6]
        text = self.p.params_json()
        q = saltus.compile(KINDS, params={"xs": XS})
        q.set_params_json(text)
        self.assertEqual(q.params_json(), text)
        self.same(q["discs"].radius, [4, 5, 6])
        self.put("p.json", text)
        q["n"] = 1
        q.set_params_json(pathlib.Path(self.path("p.json")))
        self.assertEqual(int(q["n"]), 5)
        q.set_params_json('{"n": 9}')
        self.assertEqual(int(q["n"]), 9)
        self.refused("parameters:1:", q.set_params_json, "{bad", kind=saltus.InputError)
        self.refused("none.json", q.set_params_json, self.path("none.json"), kind=saltus.InputError)
        self.assertEqual(int(q["n"]), 9)

    def test_for_one_call(self):
        before = self.value()
        self.assertAlmostEqual(self.p.eval([0.9, 0.9], params={"n": 5, "discs": {"radius": 0.01}})[0] - before, 2, places=4)
        self.assertEqual(self.value(), before)
        self.refused("numbers, not text", self.p.eval, [0.9, 0.9], params={"n": "5"})
        self.refused("did you mean `ink`?", self.p.eval, [0.9, 0.9], params={"inkk": 1})
        self.refused("a mapping", self.p.eval, [0.9, 0.9], params=[1])
        self.assertEqual(self.value(), before)


class Names(ProgramCase):
    def test_parts(self):
        p = self.p
        shapes = {"discs[*].inner[*].p.x": (3, 2), "discs[1].inner[*].p": (2, 2), "discs[*].inner[1].k": (3,), "discs[1].radius": (), "m.y": (3,),
                  "m[0]": (2,), "m[0].x": (), "grid[1][2]": (), "grid[*][2]": (3,), "grid[1]": (4,), "ink.b": (), "ms[*][1]": (4, 2), "discs.radius": (3,)}
        self.assertEqual({name: p[name].shape for name in shapes}, shapes)
        self.assertEqual((p["discs[2]"].shape, p["discs[*]"].shape), ((), (3,)))
        self.same(p["grid[*][2]"], [2, 12, 22])
        self.same(p["m.y"], [2, 4, 6])

    def test_parts_are_set(self):
        self.p["discs[*].centre.x"] = [7, 8, 9]
        self.p["grid[1][2]"] = 40
        self.p["discs[1]"] = {"radius": 3}
        self.same(self.p["discs"].centre[:, 0], [7, 8, 9])
        self.assertEqual((float(self.p["grid"][1, 2]), float(self.p["discs"].radius[1])), (40, 3))

    def test_unknown(self):
        for name, said in {"q": "no parameter `q`", "discs[3]": "beyond the end", "discs[0].radus": "did you mean `radius`?", "ink.w": "beyond the end",
                           "n[0]": "`[0]`", "grid[1][9]": "beyond the end", "discs[x]": "discs[x]", "n.x": "`.x`", "": "``", "discs..x": "discs..x",
                           "ink[0][0]": "`[0]`"}.items():
            with self.assertRaises(KeyError, msg=name) as raised:
                self.p[name]
            self.assertIn(said, raised.exception.args[0])
            self.assertNotIn(name, self.p.params)
        self.assertIsNone(self.p.params.get("q"))
        self.assertNotIn(3, self.p.params)

    def test_refusals(self):
        def put(name, value):
            self.p[name] = value
        for said, name, value in (("grid has the shape (3, 4), and the value (4, 3)", "grid", np.ones((4, 3))),
                                  ("did you mean `ink`?", "inkk", 1), ("made of structs of shape (3,)", "discs", 3),
                                  ("made of structs of shape (3,)", "discs", [{"radius": 1}] * 2),
                                  ("did you mean `radius`?", "discs", {"radus": 3}), ("discs[1].radius", "discs", [{}, {"radius": [1, 2]}, {}]),
                                  ("discs.centre has the shape (3, 2), and the value (3,)", "discs", {"centre": [1, 2, 3]}),
                                  ("numbers are wanted, not complex128", "ink", 1j), ("numbers are wanted, not object", "ink", [None] * 3),
                                  ("ink", "ink", [1, [2], 3]), ("numbers are wanted, not <U1", "ink", ["a", "b", "c"])):
            self.refused(said, put, name, value)

    def test_fields(self):
        discs = self.p["discs"]
        with self.assertRaisesRegex(AttributeError, "did you mean `radius`"):
            discs.radus
        with self.assertRaisesRegex(AttributeError, "no field `foo`"):
            discs.foo = 1
        with self.assertRaisesRegex(KeyError, "no field `foo`"):
            discs["foo"]
        for wrong in (Ellipsis, [0, 1], (0, 0)):
            with self.assertRaisesRegex(TypeError, "indexed by numbers, slices"):
                discs[wrong]
        with self.assertRaises(IndexError):
            discs[3]
        with self.assertRaises(TypeError):
            del discs["radius"]
        with self.assertRaises(TypeError):
            del self.p.params["ink"]
        self.assertEqual((len(discs), "radius" in dir(discs)), (5, True))


class Copies(ProgramCase):
    def test_records(self):
        for copied in (copy.deepcopy(self.p["discs"]), pickle.loads(pickle.dumps(self.p["discs"]))):
            self.same(copied.radius, self.p["discs"].radius)
            copied.radius[:] = 77
            self.assertEqual((copied.shape, copied.inner.k.shape), ((3,), (3, 2)))
            self.assertNotIn(77, self.p["discs"].radius)
        copy.copy(self.p["discs"]).radius[0] = 5  # of the same numbers
        self.assertEqual(self.p["discs"].radius[0], 5)

    def test_parameters(self):
        for copied in (copy.deepcopy(self.p.params), pickle.loads(pickle.dumps(self.p.params))):
            copied["n"], copied["ink"] = 8, 4
            self.assertEqual((int(copied["n"]), int(self.p["n"])), (8, 3))
            self.same(copied["discs"].radius, self.p["discs"].radius)
            self.refused("numbers, not text", copied.__setitem__, "n", "9")
            self.assertTrue(repr(copied).startswith("Params(discs=Record("))

    def test_gradients(self):
        g = self.p.vjp(np.ones((4, 4, 1)), stderr=True)
        for copied in (copy.deepcopy(g), pickle.loads(pickle.dumps(g))):
            self.same(copied["m"], g["m"])
            self.same(copied.stderr["m"], g.stderr["m"])

    def test_plain(self):
        plain = self.p.params.arrays()
        plain["discs"]["inner"]["p"][:] = 50
        self.assertEqual(type(plain["discs"]["inner"]), dict)
        self.assertNotIn(50, self.p["discs"].inner.p)

    def test_views_outlive_the_program(self):
        ink, discs, params = self.p["ink"], self.p["discs"], self.p.params
        del self.p
        ink[0] = 3
        discs[1].radius = 4
        self.assertEqual((ink[0], discs.radius[1], params["ink"][0]), (3, 4, 3))
        self.refused("the program is gone", params.__setitem__, "n", "4")

    def test_programs_are_not_copied(self):
        for function in (copy.copy, copy.deepcopy, pickle.dumps):
            with self.assertRaisesRegex(TypeError, "machine code"):
                function(self.p)


class Lengths(Case):
    def test_open_arrays(self):
        for given in ([1, 2], np.array([1.0, 2.0]), "[1, 2]", (1, 2)):
            p = saltus.compile(KINDS, params={"xs": given})
            self.same(p["xs"], [1, 2])
            self.assertEqual(p.params.info("xs").type, "float[2]")

    def test_pictures_have_the_size_of_arrays(self):
        h, colour = np.random.default_rng(1).random((7, 9)), [[[1, 2, 3, 4], [5, 6, 7, 8]]]
        source = """param heightfield h = zeros(4, 4); param texture2D t = zeros(2, 2, 3); param texture3D v = zeros(2, 2, 2, 1);
shader float main(float2 x) { return h.height(x) + t.sample(x).x + v.sample(float3(x, 0.5)).x; }"""
        for form in (h, h[::-1, ::-1][::-1, ::-1], h.tolist(), np.asfortranarray(h), h[..., None]):
            self.same(saltus.compile(source, params={"h": form})["h"], h)
        p = saltus.compile(source, params={"t": colour, "v": np.full((3, 1, 5), 2.0)})
        self.same(p["t"], colour)
        self.same(p["v"], np.full((3, 1, 5), 2.0))
        self.assertEqual(p["h"].shape, (4, 4))
        self.same(saltus.compile(source, params={"t": [1, 2, 3]})["t"], [[[1, 2, 3]] * 2] * 2)
        for name, wrong in (("h", [[1, 2]]), ("h", np.zeros((3, 3, 2))), ("t", np.zeros((3, 3, 5))), ("v", np.zeros((3, 3, 0)))):
            with self.assertRaises((saltus.InputError, saltus.UsageError)):
                saltus.compile(source, params={name: wrong})

    def test_textures_keep_sizes_of_one(self):
        p = saltus.compile("param texture2D t = zeros(1, 3, 1); shader float main(float2 x) { return t.sample(x).x; }")
        self.assertEqual((p["t"].shape, p.params.info("t").shape, p["t[2]"].shape), ((3, 1), (3, 1), (1,)))

    def test_open_arrays_from_files(self):
        np.save(self.path("xs.npy"), np.arange(4, dtype=np.float32))
        self.same(saltus.compile(KINDS, params={"xs": "@" + self.path("xs.npy")})["xs"], range(4))

    def test_open_arrays_of_structs(self):
        source = "struct D { float2 c; float r; };\nparam D ds[] = \"d.json\";\nshader float main(float2 x) { float s = 0.0;\n" \
                 "for (int i = 0; i < 3; i++) s += ds[i].r * x.x + ds[i].c.x; return s; }"
        for given in ({"c": np.ones((3, 2)), "r": 2}, [{"c": [1, 1], "r": 2}] * 3):
            p = saltus.compile(source, params={"ds": given})
            self.same(p["ds"].r, [2, 2, 2])
            self.assertEqual(p["ds"].c.shape, (3, 2))

    def test_empty(self):
        for given in ([], np.zeros(0), "[]"):
            self.refused("at least one element", saltus.compile, KINDS, params={"xs": given}, kind=saltus.InputError)

    def test_no_parameters(self):
        p = saltus.compile("shader float main(float2 x) { return x.x; }")
        self.assertEqual((list(p.params), dict(p.vjp(np.ones((4, 4, 1)))), list(p.integral(64).gradient)), ([], {}, []))

    def test_meshes(self):
        self.put("m.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n")
        self.put("m.salt", 'param mesh m = "m.obj";\nshader float main(float2 x) {\n'
                 '[Disc] if (m.occluded(float3(x.x, x.y, 5.0), float3(0.0, 0.0, -1.0), 0.0, 9.0)) return 1.0;\nreturn 0.0; }\n')
        p = saltus.load(self.path("m.salt"))
        self.assertEqual((p["m"].shape, p.mesh("m")["faces"].tolist(), p.mesh("m")["parts"].shape), ((4, 3), [[0, 1, 2], [0, 1, 3]], (2,)))
        self.refused("no parameter `q`", p.mesh, "q")


if __name__ == "__main__":
    main()
