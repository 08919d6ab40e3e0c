"""Programs: compiling, estimates to the bit those of the command, arrays of every kind, options, warnings, what goes wrong."""
import gc
import pickle
import threading

from harness import *

GLSL = """
uniform float radius; // default 0.3
void mainImage(out vec4 colour, in vec2 at) {
    vec2 x = at / iResolution.xy;
    float inside = length(x - 0.5) < radius ? 1.0 : 0.0;
    colour = vec4(vec3(inside), 1.0);
}
"""
PRINTS = "shader float main(float2 x) { print(\"x = \", x.x); return x.x; }"
HOLE = "param float a = 0.0;\nshader float main(float2 x) { return x.x / a; }"
UNTRACKED = "param float a = 0.5;\nshader float main(float2 x) { float f = 0.0; if (x.x < a) f = 1.0; return f; }"
STATIC = "param float a = 0.5;\nshader float main(float2 x) { float f = 0.0; [Disc] if (a < 0.3) f = 1.0; return f; }"


class Compiling(Case):
    def test_from_a_file_and_from_text(self):
        file = self.put("c.salt", CIRCLE)
        programs = [saltus.compile(file), saltus.compile(pathlib.Path(file)), saltus.load(file), saltus.compile(CIRCLE)]
        for p in programs:
            self.same(p.render(8), programs[0].render(8))
        self.assertEqual(repr(programs[0]), "<saltus.Program %r: main, 2D, 1 channels, parameters radius, centre, ink>" % file)
        self.assertIn("'disc'", repr(saltus.compile(CIRCLE, name="disc")))

    def test_facts(self):
        p = saltus.compile(DISCS)
        self.assertEqual((p.dim, p.channels, p.entry, p.display, p.sites, p.uses_rand), (2, 3, "main", False, 1, False))
        self.same(saltus.compile(CIRCLE).domain, [[-1, -1], [1, 1]])
        self.assertTrue(saltus.compile(NOISE).uses_rand)

    def test_errors(self):
        error = self.refused("^", saltus.compile, "shader float main(float2 x) {\n    return y;\n}", name="bad.salt", kind=saltus.CompileError)
        self.assertIn("bad.salt:2:12: error: unknown name `y` [E0101]\n    2 |     return y;\n      |            ^", str(error))
        (found,) = error.diagnostics
        self.assertEqual((found.severity, found.code, found.file, found.line, found.column), ("error", "E0101", "bad.salt", 2, 12))
        self.assertEqual(str(found), "bad.salt:2:12: error[E0101]: unknown name `y`")
        self.assertEqual(error.status, 3)

    def test_all_errors_are_listed(self):
        error = self.refused("y", saltus.compile, "shader float main(float2 x) { float a = y; float b = z; return a; }", kind=saltus.CompileError)
        self.assertEqual([d.code for d in error.diagnostics], ["E0101", "E0101"])

    def test_statuses(self):
        self.refused("nix.salt", saltus.compile, "nix.salt", kind=saltus.InputError)
        self.refused("``", saltus.compile, "", kind=saltus.InputError)
        self.refused("no entry point `nix`", saltus.compile, CIRCLE, entry="nix")
        self.refused("there is no constant", saltus.compile, CIRCLE, set={"N": 2})
        self.refused("did you mean `radius`?", saltus.compile, CIRCLE, params={"radus": 2})
        self.refused("radius has the shape ()", saltus.compile, CIRCLE, params={"radius": [1, 2]})
        self.refused("precision is one of f32, f64", saltus.compile, CIRCLE, precision="f16")
        self.refused("width is from 0 to 64", saltus.compile, CIRCLE, width=65)
        self.assertTrue(issubclass(saltus.UsageError, ValueError))

    def test_sizes_of_glsl(self):
        source = "void mainImage(out vec4 o, in vec2 f) { o = vec4(f / iResolution.xy, 0.0, 1.0); }"
        for size, sides in ((8, [8, 8]), ((8, 4), [8, 4])):
            p = saltus.compile(source, language="glsl", size=size)
            self.same(p.domain[1], sides)
            self.assertIn(f"--size {sides[0]}x{sides[1]}", " ".join(saltus._command._arguments(p._origin.options)))
        self.refused("size is one number or 2", saltus.compile, source, language="glsl", size=(1, 2, 3))

    def test_nul(self):
        for function in (lambda: saltus.compile(CIRCLE + "\0 lost"), lambda: saltus.compile(CIRCLE, entry="main\0"), lambda: saltus.compile("a\0.salt"),
                         lambda: saltus.compile(CIRCLE, name="a\0b"), lambda: saltus.compile(CIRCLE, set={"N\0": 1}),
                         lambda: saltus.compile(CIRCLE, import_dirs=["a\0b"]), lambda: saltus.read_image("a\0.png"),
                         lambda: saltus.compile(CIRCLE).vjp(np.ones((4, 4, 1)), wrt=["radius\0"])):
            self.refused("NUL", function)

    def test_constants(self):
        for p in (saltus.compile(DISCS, set={"N": 7}), saltus.compile(DISCS, set={"N": np.int64(7)}), saltus.compile(DISCS, set={"N": "7"}),
                  saltus.load(self.put("d.salt", DISCS), N=7)):
            self.assertEqual(p["discs"].shape, (7,))

    def test_loaded_with_options(self):
        self.put("d.salt", DISCS)
        p = saltus.load(self.path("d.salt"), N=3, precision="f64", set={"N": 2})
        self.assertEqual(p["discs"].shape, (3,))
        self.refused("no constant", saltus.load, self.path("d.salt"), M=3)

    def test_imports(self):
        os.mkdir(self.path("lib"))
        self.put("lib/half.salt", "float half(float x) { return 0.5 * x; }")
        p = saltus.compile("import half;\nshader float main(float2 x) { return half(x.x); }", import_dirs=[pathlib.Path(self.path("lib"))])
        self.assertEqual(p.eval([0.5, 0]), 0.25)

    def test_sandbox(self):
        self.put("m.salt", 'param float xs[] = "../xs.json";\nshader float main(float2 x) { return xs[0]; }')
        self.refused("xs.json", saltus.load, self.path("m.salt"), sandbox=True, kind=saltus.SaltusError)

    def test_glsl(self):
        p = saltus.compile(GLSL, language="glsl", size=(64, 32), params={"radius": 0.3})
        self.assertTrue(p.display)
        image = p.render((64, 32))
        self.assertEqual((image.shape, image.display), ((32, 64, 3), True))
        self.assertAlmostEqual(float(image[..., 0].mean()), np.pi * 0.09, delta=0.02)

    def test_precision(self):
        self.assertEqual(saltus.compile("shader float main(float2 x) { return x.x; }", precision="f64").eval([0.1, 0]), 0.1)
        self.assertEqual(saltus.compile("shader float main(float2 x) { return x.x; }").eval([0.1, 0]), np.float32(0.1))

    def test_the_oracle(self):
        p, q = saltus.compile(CIRCLE), saltus.compile(CIRCLE, interpret=True, cache=False)
        self.same(p.render(8), q.render(8))


class AsTheCommand(Case):
    """The same numbers, to the bit."""

    def setUp(self):
        super().setUp()
        self.file = self.put("c.salt", CIRCLE)
        self.p = saltus.load(self.file)

    def rendered(self, *arguments):
        done = subprocess.run([COMMAND, *map(str, arguments), "-o", "out.npy", "--quiet"], cwd=self.dir, capture_output=True, text=True, timeout=HANGS)
        self.assertEqual(done.returncode, 0, done.stderr)
        return np.load(self.path("out.npy"))

    def test_render(self):
        self.same(self.p.render((9, 7), spp=3, seed=5, filter="tent"), self.rendered("render", "c.salt", "--size", "9x7", "--spp", 3, "--seed", 5, "--filter", "tent"))
        self.same(self.p.render(), self.rendered("render", "c.salt"))

    def test_curve_and_volume(self):
        curve, volume = self.put("curve.salt", CURVE), self.put("volume.salt", VOLUME)
        self.same(saltus.load(curve).render(9), self.rendered("render", "curve.salt", "--size", 9)[0])
        self.same(saltus.load(volume).render((4, 5, 6)), self.rendered("render", "volume.salt", "--size", "4x5x6"))

    def test_integral(self):
        for samples, options in ((1 << 12, {}), (1 << 10, {"estimator": "lattice", "seed": 3}), (1 << 10, {"estimator": "scanline", "interior_only": True})):
            r = self.p.integral(samples, **options)
            flags = [part for k, v in options.items() for part in (["--" + k.replace("_", "-")] if v is True else ["--" + k, v])]
            j = self.command("grad", "c.salt", "--integral", "--samples", samples, *flags)
            self.assertEqual((r.value.tolist(), r.value_stderr.tolist(), r.stderr_kind), (j["integral"], j["integral_stderr"], j["stderr_kind"]))
            for name, part in (("gradient", r.gradient), ("stderr", r.stderr), ("interior", r.interior), ("boundary", r.boundary), ("missed_estimate", r.missed_estimate)):
                self.assertEqual([part["radius"][0], part["centre"][:, 0].tolist(), part["ink"][0]], [j[name]["radius"], j[name]["centre"], j[name]["ink"]])
            for name in ("samples", "segments", "crossings"):
                self.assertEqual(getattr(self.p.stats, name), j[name], name)

    def test_certified(self):
        r, j = self.p.integral(exact=True), self.command("grad", "c.salt", "--integral", "--estimator", "quadrature", "--interior", "quadrature")
        self.assertEqual((r.certified, r.value.tolist()), (j["certified"], j["integral"]))
        self.assertTrue(np.isnan(self.p.integral(64, estimator="lattice").certified))

    def test_vjp(self):
        adjoint = np.random.default_rng(0).normal(size=(6, 8, 1)).astype(np.float32)
        np.save(self.path("a.npy"), adjoint)
        j = self.command("grad", "c.salt", "--adjoint", "a.npy", "--seed", 3)
        g = self.p.vjp(adjoint, seed=3, stderr=True)
        self.assertEqual([float(g["radius"]), g["centre"].tolist()], [j["gradient"]["radius"], j["gradient"]["centre"]])
        self.assertEqual([float(g.stderr["radius"]), g.stderr["centre"].tolist()], [j["stderr"]["radius"], j["stderr"]["centre"]])

    def test_loss(self):
        target = np.random.default_rng(0).random((6, 8, 1)).astype(np.float32)
        np.save(self.path("t.npy"), target)
        j = self.command("grad", "c.salt", "--target", "t.npy", "--seed", 3)
        for given in (target, target[..., 0], target.astype(np.float64), self.path("t.npy"), pathlib.Path(self.path("t.npy"))):
            value, g = self.p.loss(given, seed=3, stderr=True)
            self.assertEqual([value, float(g["radius"]), g["centre"].tolist()], [j["loss"], j["gradient"]["radius"], j["gradient"]["centre"]])
            self.assertEqual(float(g.stderr["radius"]), j["stderr"]["radius"])

    def test_derivative_images(self):
        told = self.rendered("grad", "c.salt", "--size", "8x6", "--wrt", "centre")  # f, the two derivatives, crossings
        found = self.p.grad_images("centre", (8, 6), crossings=True)
        self.same(found["centre"][..., 0].transpose(1, 2, 0), told[..., 1:3])
        self.same(found["crossings"], told[..., 3])
        np.testing.assert_allclose(self.p.jvp({"centre": [0, 1]}, (8, 6))[..., 0], told[..., 2], rtol=1e-5, atol=1e-6)

    def test_bound(self):
        (b,), j = self.p.bound([[-1, -1]], [[1, 0.25]]), self.command("bound", "c.salt", "--box", "-1,1;-1,0.25")
        self.assertEqual((b.settled, b.rough, b.unknown, b.open, [[b.lo[0], b.hi[0]]]), (j["settled"], j["rough"], j["unknown"], j["count"], j["channels"]))

    def test_check(self):
        self.p["radius"] = 0.3
        result = self.p.check(size=(4, 4), wrt="radius")
        self.assertTrue(result["pass"])
        self.assertEqual([row["param"] for row in result["rows"]], ["radius"])
        self.assertAlmostEqual(result["rows"][0]["ad"], 0.75 * 2 * np.pi * 0.3, delta=0.05)  # at the value that it has now

    def test_check_that_fails(self):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            p = saltus.compile(UNTRACKED)
            error = self.refused("FAIL", p.check, samples=1 << 12, kind=saltus.CheckFailed)
        self.assertFalse(error.result["pass"])

    def test_explain(self):
        text = self.p.explain()
        self.assertIn("main: 2D, 1 channel", text)
        self.assertIn("f(-0.5, 0.25) = 0.25", self.p.explain(at=(-0.5, 0.25)))
        self.assertIn("site", saltus.compile(CIRCLE).explain(wrt="radius"))

    def test_crossing(self):
        c = self.p.crossing([0.1, -0.05], [1, -0.05])
        self.assertTrue(c.found)
        np.testing.assert_allclose(c.x, [0.5, -0.05], atol=1e-5)
        self.assertEqual((c.f_before.tolist(), c.f_after.tolist(), c.site, c.drop), ([1], [0.25], 0, None))
        self.assertFalse(self.p.crossing([0.1, 0], [0.2, 0]).found)
        self.refused("2 coordinates", self.p.crossing, [0], [1])
        self.refused("stream is from 0", self.p.crossing, [0, 0], [1, 0], stream=-1)


class Arrays(Case):
    """Whatever arrays are given: right, or refused."""

    def setUp(self):
        super().setUp()
        self.p = saltus.compile(DISCS)

    def test_out(self):
        expected = self.p.render((6, 5))
        big = np.zeros((10, 12, 6), np.float32)
        for out in (np.empty((5, 6, 3), np.float32), np.empty((5, 6, 3)), np.empty((5, 6, 3), np.float16), np.empty((5, 6, 3), ">f4"),
                    np.empty((5, 6, 3), np.float32, order="F"), big[::2, ::2, ::2], np.empty((3, 6, 5), np.float32).T, np.empty((5, 6, 3), np.longdouble),
                    np.frombuffer(bytearray(5 * 6 * 3 * 4 + 1), np.uint8)[1:].view(np.float32).reshape(5, 6, 3)):
            got = self.p.render((6, 5), out=out)
            self.assertIs(got, out)
            self.same(out, expected.astype(out.dtype))
        self.same(big[1::2], 0)

    def test_out_of_one_channel(self):
        p = saltus.compile(CIRCLE)
        for out in (np.empty((5, 6), np.float32), np.empty((5, 6))):
            self.same(p.render((6, 5), out=out), p.render((6, 5))[..., 0])

    def test_out_in_place(self):
        """C-ordered float32 is written without a copy; of other threads' progress too."""
        out = np.full((64, 64, 3), -1, np.float32)
        at = []
        self.p.render(64, out=out, threads=1, progress=lambda f: at.append(out.min()))
        self.assertGreaterEqual(out.min(), 0)
        self.same(out, self.p.render(64))

    def test_bad_out(self):
        for said, out in (("the shape (6, 5, 3)", np.empty((6, 5, 3), np.float32)), ("floats, not int32", np.empty((5, 6, 3), np.int32)),
                          ("floats, not complex64", np.empty((5, 6, 3), np.complex64)), ("floats, not list", [[0]]), ("floats, not object", np.empty((5, 6, 3), object)),
                          ("cannot be written to", np.broadcast_to(np.float32(0), (5, 6, 3)))):
            self.refused(said, self.p.render, (6, 5), out=out)
        self.refused("the shape", self.p.jvp, {"paper": 1}, (6, 5), out=np.empty((4, 4, 3)))

    def test_jvp_out(self):
        expected = self.p.jvp({"paper": [1, 0, 0]}, (6, 5))
        for out in (np.empty((5, 6, 3), np.float32), np.empty((5, 6, 3))):
            self.assertIs(self.p.jvp({"paper": [1, 0, 0]}, (6, 5), out=out), out)
            self.same(out, expected)
        self.assertTrue(expected.signed)

    def test_adjoints(self):
        adjoint = np.arange(90.0).reshape(5, 6, 3) / 90
        expected = self.p.vjp(adjoint.astype(np.float32)).vector
        stretched = np.zeros((5, 12, 3))
        stretched[:, ::2] = adjoint
        for given in (adjoint, np.asfortranarray(adjoint), adjoint.astype(">f8"), stretched[:, ::2], adjoint.tolist(), adjoint[::-1][::-1]):
            self.same(self.p.vjp(given).vector, expected)
        self.same(self.p.vjp(np.ones((5, 6, 3), bool)).vector, self.p.vjp(np.ones((5, 6, 3), np.uint8)).vector)

    def test_bad_adjoints(self):
        for said, given in (("height, width, 3", np.ones((5, 6, 1))), ("height, width, 3", np.ones((5, 6))), ("height, width, 3", np.ones(3)), ("height, width, 3", 1.0),
                            ("complex128", np.ones((5, 6, 3), complex)), ("object", np.full((5, 6, 3), None)), ("size is from 1", np.ones((0, 6, 3))), ("<U1", np.full((5, 6, 3), "a"))):
            self.refused(said, self.p.vjp, given)

    def test_targets(self):
        for said, given in (("3 channels", np.ones((5, 6, 1))), ("complex128", np.ones((5, 6, 3), complex)), ("3 channels", np.ones((5, 6)))):
            self.refused(said, self.p.loss, given)
        self.refused("none.png", self.p.loss, "none.png", kind=saltus.InputError)
        target, mask = np.ones((5, 6, 3)), np.random.default_rng(0).random((5, 6))
        self.same(self.p.loss(target, mask=mask)[1].vector, self.p.loss(target, mask=np.repeat(mask[..., None], 3, 2))[1].vector)
        self.assertEqual(self.p.loss(target, mask=np.zeros((5, 6)))[0], 0)
        self.refused("the mask has the shape", self.p.loss, target, mask=np.ones((6, 5)))

    def test_sizes(self):
        for size in (7, np.int64(7), np.uint8(7), (7, 7), [7, 7], np.array([7, 7]), np.array(7), (np.int32(7), 7)):
            self.assertEqual(self.p.render(size).shape, (7, 7, 3))
        for said, size in (("from 1 to", 0), ("from 1 to", -3), ("from 1 to", 1 << 25), ("one number or 2", (1, 2, 3)), ("one number or 2", ()), ("one number or 2", "64"),
                           ("a whole number", 7.5), ("a whole number", (7.0, 7)), ("from 1 to", (7, -7)), ("a whole number", {7.5, 8.5})):
            self.refused(said, self.p.render, size)

    def test_sizes_without_memory(self):
        for size in ((1 << 24, 1 << 24), 1 << 22):
            self.refused("no memory", self.p.render, size, kind=saltus.LimitError)
            self.refused("no memory", self.p.jvp, {"paper": 1}, size, kind=saltus.LimitError)
        self.assertEqual(self.p.render(4).shape, (4, 4, 3))

    def test_points(self):
        p = saltus.compile(CIRCLE)
        for x, shape in (([0, 0], (1,)), ([[0, 0], [1, 1]], (2, 1)), (np.zeros((0, 2)), (0, 1)), (np.zeros((3, 4, 2), np.float16), (3, 4, 1)), (np.zeros((4, 2), int).T[:, :2], (2, 1)),
                         (((0, 0),), (1, 1))):
            self.assertEqual(p.eval(x).shape, shape)
        self.same(p.eval([[0.1, 0], [0.9, 0.9], [7, 7]])[:, 0], [1, 0.25, 0.25])
        for said, x in (("(0,)", []), ("()", 0.5), ("(3,)", [1, 2, 3]), ("complex128", [[1j, 0]]), ("object", [[None, 0]])):
            self.refused(said, p.eval, x)

    def test_points_of_a_curve(self):
        p = saltus.compile(CURVE)
        for x, shape in ((0.5, (2,)), ([0.5], (1, 2)), ([0.1, 0.5], (2, 2)), ([[0.1], [0.5], [0.6]], (3, 2)), (np.zeros(0), (0, 2)), (np.zeros((4, 1)), (4, 2)), (np.float32(0.5), (2,))):
            self.assertEqual(p.eval(x).shape, shape, x)
        self.refused("(..., 1)", p.eval, np.zeros((2, 3)))

    def test_streams(self):
        p = saltus.compile(NOISE)
        x = np.random.default_rng(0).random((200, 2))
        self.same(p.eval(x), p.eval(x, streams=range(200)))
        self.same(p.eval(x[::-1], streams=np.arange(200)[::-1]), p.eval(x)[::-1])
        self.assertFalse(np.array_equal(p.eval(x), p.eval(x, seed=1)))
        self.assertFalse(np.array_equal(p.eval(x), p.eval(x, streams=np.arange(200) + 2 ** 31)))
        for streams in ([0], np.zeros(200), [-1] * 200, [1 << 32] * 200):
            self.refused("streams are", p.eval, x, streams=streams)

    def test_boxes(self):
        p = saltus.compile(CIRCLE)
        self.assertEqual((len(p.bound(np.zeros((0, 2)), np.zeros((0, 2)))), len(p.bound([0, 0], [1, 1])), len(p.bound([[0, 0]] * 3, [[1, 1]] * 3))), (0, 1, 3))
        self.refused("(n, 2)", p.bound, [0], [1])
        self.refused("(n, 2)", p.bound, [[0, 0]], [[1, 1]] * 2)
        self.refused("complex", p.bound, [0, 1j], [1, 1])


class Options(Case):
    def setUp(self):
        super().setUp()
        self.p = saltus.compile(CIRCLE)

    def test_unknown(self):
        for name, near in (("sp", "spp"), ("thread", "threads"), ("estimater", "estimator")):
            self.refused("did you mean `%s`?" % near, self.p.render, 8, **{name: 1})
        self.refused("no option `zzzz`", self.p.render, 8, zzzz=1)
        self.refused("did you mean `iters`?", self.p.fit, np.ones((4, 4, 1)), iter=3)
        self.refused("did you mean `momentum`?", self.p.fit, np.ones((4, 4, 1)), momentun=3)

    def test_values(self):
        for said, name, value in (("spp is from 1", "spp", 0), ("spp is a whole number", "spp", 1.5), ("spp is a whole number", "spp", "4"), ("seed is from 0", "seed", -1),
                                  ("seed is from 0", "seed", 1 << 32), ("threads is from 0", "threads", -1), ("filter is one of box, tent, gaussian", "filter", "cone"),
                                  ("estimator is one of", "estimator", ["lattice"]), ("time_limit is at least 0", "time_limit", -1),
                                  ("error is at least 0", "error", float("nan")), ("step is a number", "step", "x")):
            self.refused(said, self.p.render, 8, **{name: value})
        self.same(self.p.render(8, spp=np.int16(4), seed=None), self.p.render(8))

    def test_threads_do_not_matter(self):
        self.same(self.p.render(40, threads=1), self.p.render(40, threads=2))
        adjoint = np.ones((40, 40, 1))
        self.same(self.p.vjp(adjoint, threads=1).vector, self.p.vjp(adjoint, threads=2).vector)

    def test_parts(self):
        adjoint = np.ones((40, 40, 1))
        both, inner, outer = (self.p.vjp(adjoint, **o).vector for o in ({"estimator": "lattice"}, {"estimator": "lattice", "interior_only": True}, {"estimator": "lattice", "boundary_only": True}))
        np.testing.assert_allclose(inner + outer, both, rtol=1e-6, atol=1e-6)
        self.assertEqual((inner[0], outer[3]), (0, 0))  # radius, ink

    def test_time_limit(self):
        self.refused("time limit", self.p.render, 2000, spp=1000, time_limit=0.01, kind=saltus.LimitError)
        self.assertEqual(self.p.render(8).shape, (8, 8, 1))

    def test_progress(self):
        told = []
        self.p.render(256, spp=16, progress=told.append)
        self.assertTrue(told and all(0 <= f <= 1 for f in told))
        self.assertEqual(told, sorted(told))

    def test_progress_that_raises(self):
        def broken(fraction):
            raise KeyError("mine")
        with self.assertRaisesRegex(KeyError, "mine"):
            self.p.render(1024, spp=64, progress=broken)
        self.assertEqual(self.p.render(8).shape, (8, 8, 1))

    def test_call_within_a_call(self):
        seen = []

        def nested(fraction):
            try:
                self.p.render(4)
            except Exception as error:
                seen.append(error)
        self.p.render(64, threads=1, progress=nested)
        self.assertTrue(seen and all(isinstance(e, saltus.UsageError) for e in seen))

    def test_stats(self):
        self.p.vjp(np.ones((8, 8, 1)), estimator="lattice")
        stats = self.p.stats
        self.assertGreater(stats.crossings, 0)
        self.assertEqual((stats.dropped, stats.warnings), ({}, {}))
        with self.assertRaises(AttributeError):
            stats.nothing
        self.assertEqual(repr(pickle.loads(pickle.dumps(stats))), repr(stats))

    def test_stats_outlive_their_program(self):
        p = saltus.compile("param float a = 1.0; shader float main(float2 x) { return a / (x.x - x.x); }", name="n" * 100)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            p.render(4)
        stats = p.stats
        del p
        gc.collect()
        others = [saltus.compile("shader float main(float2 x) { return x.x; }", name="z" * 100) for _ in range(9)]
        self.assertIn("n" * 100 + ":1:59", stats.warnings["nonfinite"])
        self.assertEqual(stats.nonfinite_at, "n" * 100 + ":1:59")
        self.assertEqual(len(others), 9)

    def test_lines_go_to_functions(self):
        self.refused("a function or None", self.p.set_print, 3)


class Wrt(Case):
    def setUp(self):
        super().setUp()
        self.p = saltus.compile(DISCS)
        self.adjoint = np.ones((8, 8, 3))

    def test_names(self):
        p = self.p
        everything = p.vjp(self.adjoint)
        self.assertEqual(list(everything), ["discs", "paper"])
        p.wrt = "paper"
        self.assertEqual((p.wrt, list(p.vjp(self.adjoint))), (("paper",), ["paper"]))
        self.same(p.vjp(self.adjoint)["paper"], everything["paper"])
        p.wrt = ["discs[*].radius", "discs[1].centre.x"]
        g = p.vjp(self.adjoint)["discs"]
        self.same(g.radius, everything["discs"].radius)
        self.same(g.ink, 0)
        self.same(g.centre, [[0, 0], [everything["discs"].centre[1, 0], 0], [0, 0], [0, 0]])
        p.wrt = None
        self.same(p.vjp(self.adjoint).vector, everything.vector)

    def test_of_one_call(self):
        self.p.wrt = "paper"
        self.assertEqual(list(self.p.vjp(self.adjoint, wrt="discs")), ["discs"])
        self.assertEqual(list(self.p.integral(64, wrt=["discs"]).gradient), ["discs"])
        self.assertEqual(list(self.p.loss(self.adjoint, wrt=("discs",))[1]), ["discs"])
        self.assertEqual(list(self.p.grad_images(size=4)), ["paper"])
        self.p.jvp({"discs": {"radius": 1}}, 4)
        self.assertEqual((self.p.wrt, list(self.p.vjp(self.adjoint))), (("paper",), ["paper"]))

    def test_refused(self):
        def put(names):
            self.p.wrt = names
        self.p.wrt = "paper"
        for said, names in (("q", "q"), ("light", "light"), ("names nothing", []), ("names nothing", ()), ("discs[9]", "discs[9].radius")):
            self.refused(said, put, names)
            self.refused(said, self.p.vjp, self.adjoint, wrt=names)
            self.refused(said, self.p.integral, 64, wrt=names)
        self.assertEqual((self.p.wrt, list(self.p.vjp(self.adjoint))), (("paper",), ["paper"]))
        self.refused("names no parameter", self.p.jvp, {}, 4)
        self.refused("no parameter `q`", self.p.jvp, {"q": 1}, 4)
        self.refused("names nothing", self.p.grad_images, [], 4)
        self.refused("no parameter `q`", self.p.grad_images, "q", 4)

    def test_images(self):
        found = self.p.grad_images(["discs[*].radius", "paper", "discs[1]"], 4)
        self.assertEqual((found["discs[*].radius"].shape, found["paper"].shape, found["discs[1]"]["centre"].shape), ((4, 4, 4, 3), (3, 4, 4, 3), (2, 4, 4, 3)))
        self.same(found["discs[1]"]["radius"], found["discs[*].radius"][1])
        q = saltus.compile(DISCS, set={"N": 20})
        self.refused("120 derivative images", q.grad_images, "discs", 4)

    def test_params_of_one_call(self):
        p, q = self.p, saltus.compile(DISCS)
        other = {"discs": {"radius": [0.1, 0.2, 0.05, 0.1]}, "paper": 0.3, "light": 2}
        for name, value in other.items():
            q[name] = value
        self.same(p.render(8, params=other), q.render(8))
        self.same(p.vjp(self.adjoint, params=other).vector, q.vjp(self.adjoint).vector)
        self.same(p.integral(256, params=other).value, q.integral(256).value)
        self.same(p.eval([0.3, 0.3], params=other), q.eval([0.3, 0.3]))
        self.same(p.jvp({"paper": 1}, 8, params=other), q.jvp({"paper": 1}, 8))
        self.same(p.render(8), saltus.compile(DISCS).render(8))
        self.same(p["light"], 1)


class Telling(Case):
    """Warnings, diagnostics, print."""

    def test_when_compiled(self):
        with self.assertWarnsRegex(saltus.SaltusWarning, "W0401") as seen:
            saltus.compile(UNTRACKED)
        self.assertEqual(os.path.basename(seen.filename), "test_program.py")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self.assertEqual([d.code for d in saltus.compile(UNTRACKED).diagnostics], ["W0401"])
        with self.assertWarnsRegex(saltus.SaltusWarning, "W0402"):
            saltus.compile(STATIC)

    def test_once_a_code(self):
        with warnings.catch_warnings(record=True) as seen:
            warnings.simplefilter("always")
            p = saltus.compile(HOLE)
            for _ in range(3):
                p.render(4)
                p.integral(64)
        self.assertEqual([str(w.message).count("not finite") for w in seen], [1])
        self.assertIn("saltus explain nonfinite", str(seen[0].message))
        self.assertEqual(list(p.stats.warnings), ["nonfinite"])
        self.assertEqual(os.path.basename(seen[0].filename), "test_program.py")

    def test_warnings_as_errors(self):
        """In the middle of a call: the program is usable behind it."""
        p = saltus.compile(HOLE)
        with self.assertRaises(saltus.SaltusWarning):
            p.render(4)
        p["a"] = 2
        self.assertEqual(p.eval([0.5, 0]), 0.25)
        with self.assertRaises(saltus.SaltusWarning):
            saltus.compile(UNTRACKED)

    def test_print(self):
        p, lines = saltus.compile(PRINTS), []
        p.render(2, spp=1)
        p.set_print(lines.append)
        p.render(2, spp=1)
        self.assertEqual((len(lines), lines[0][:4]), (4, "x = "))
        p.set_print(None)
        p.render(2, spp=1)
        self.assertEqual(len(lines), 4)

    def test_print_that_raises(self):
        def broken(line):
            raise KeyError("mine")
        p = saltus.compile(PRINTS)
        p.set_print(broken)
        for threads in (1, 2):
            with self.assertRaisesRegex(KeyError, "mine"):
                p.render(64, threads=threads)
        p.set_print(None)
        self.assertEqual(p.render(4).shape, (4, 4, 1))

    def test_print_goes_away_with_the_program(self):
        import weakref

        class Lines(list):
            pass
        lines, p = Lines(), saltus.compile(PRINTS)
        seen = weakref.ref(lines)
        p.set_print(lines.append)
        p.render(2)
        del p, lines
        self.assertIsNone(seen())


class Dimensions(Case):
    def test_curve(self):
        p = saltus.compile(CURVE)
        self.assertEqual((p.render(9).shape, p.jvp({"edge": 1}, 9).shape, p.render((9,)).shape), ((9, 2), (9, 2), (9, 2)))
        g = p.vjp(np.ones((512, 2)), spp=16)
        self.assertAlmostEqual(g["edge"] / 512, 1 - 2 * 0.3, delta=0.02)
        self.refused("width, 2", p.vjp, np.ones((8, 8, 2)))
        self.assertEqual(p.grad_images("edge", 5, crossings=True)["crossings"].shape, (5,))
        self.assertEqual(p.crossing(0, 1).found, True)
        self.assertEqual(len(p.bound([[0.0], [0.5]], [[0.2], [0.6]])), 2)

    def test_volume(self):
        p = saltus.compile(VOLUME)
        self.assertEqual((p.render((3, 4, 5)).shape, p.render(spp=1).shape), ((5, 4, 3, 2), (64, 64, 64, 2)))
        g = p.vjp(np.ones((8, 8, 8, 2)), spp=4)
        self.assertAlmostEqual(g["wall"] / 512, 0.5, delta=0.1)
        self.assertAlmostEqual(p.integral(1 << 14).gradient["wall"][0], 0.5, delta=0.02)
        self.refused("an array", p.loss, "t.npy")
        value, _ = p.loss(np.zeros((5, 4, 3, 2)))
        self.assertGreater(value, 0)


if __name__ == "__main__":
    main()
