"""saltus grad: JSON shapes, layers, losses; the same bits whatever the threads; check, explain and bench."""
import math

from harness import *

TAU = 2 * math.pi
KEYS = {"gradient", "stderr", "stderr_kind", "samples", "segments", "crossings", "dropped", "truncated", "seconds", "warnings"}


class Integral(Case):
    def test_circle(self):
        self.put("c.salt", CIRCLE)
        j = self.json_cli("grad", "c.salt", "--integral", "--samples", "2^16", "--estimator", "lattice")
        self.assertLessEqual(KEYS | {"integral", "integral_stderr", "interior", "boundary", "missed_estimate"}, set(j))
        self.assertAlmostEqual(j["integral"][0], 1 + 0.75 * math.pi * 0.16, delta=2e-3)
        g = j["gradient"]
        self.assertEqual(list(g), ["radius", "centre", "ink"])
        self.assertAlmostEqual(g["radius"], 0.75 * TAU * 0.4, delta=5e-3)
        self.assertAlmostEqual(g["ink"], math.pi * 0.16, delta=2e-3)
        for v in g["centre"]:
            self.assertAlmostEqual(v, 0, delta=5e-3)
        for shape in ("stderr", "interior", "boundary", "missed_estimate"):
            self.assertEqual([isinstance(v, list) and len(v) for v in j[shape].values()], [isinstance(v, list) and len(v) for v in g.values()], shape)
        self.assertIn(j["stderr_kind"], ("replicates", "bound"))
        self.assertEqual(j["samples"], 65536)
        self.assertTrue(all(isinstance(v, int) for v in j["dropped"].values()))
        self.assertEqual(j["interior"]["radius"], 0)
        self.assertLess(abs(g["radius"] - 0.75 * TAU * 0.4), 6 * j["stderr"]["radius"] + 1e-4)

    def test_dropped(self):
        # A root of third order by cancellation, mostly without a gradient in f32: little is known, and that is said.
        self.put("d.salt", """
param float r = 0.4;
[Domain(-1.0, 1.0)]
shader float main(float2 x) { float d = r - length(x); [Disc] if (d - sin(d) > 0.0) return 1.0; return 0.0; }
""")
        j = self.json_cli("grad", "d.salt", "--integral", "--samples", "2^16", "--estimator", "lattice")
        self.assertEqual([w["code"] for w in j["warnings"]], ["dropped"])
        self.assertLess(abs(j["gradient"]["r"] - TAU * 0.4), 4 * j["stderr"]["r"])
        self.assertIn("crossings were dropped", self.run_cli("grad", "d.salt", "--integral", "--estimator", "lattice").err)
        err = self.run_cli("grad", "d.salt", "--size", "64", "--samples", "64", "--estimator", "lattice", "-o", "d.npy").err
        self.assertRegex(err, r"derivative images state no errors: pixels with dropped crossings, \d.* % of all crossings, lack their part")

    def test_dropped_in_images(self):
        """Losses and weighted images state what was dropped, as integrals do."""
        self.put("c.salt", CIRCLE.replace("length(x - centre) < radius", "radius - length(x - centre) > 0.0"))
        other = "[Disc] if ({0} > 0.0) f = 2.0 * ink;"
        for name, g in (("one", "e - sin(e)"), ("two", "e")):
            self.put(name + ".salt", CIRCLE.replace("return f;", "float e = 0.35 * radius - length(x - float2(-0.6, 0.5)); %s return f;" % other.format(g)))
        self.put("all.salt", CIRCLE.replace("length(x - centre) < radius", "radius - length(x - centre) - sin(radius - length(x - centre)) > 0.0"))
        size = ["--size", 64, "--spp", 4, "--wrt", "radius"]
        self.run_cli("render", "c.salt", "--param", "radius=0.5", *size[:4], "-o", "t.exr")
        for how in (["--target", "t.exr"], ["--adjoint", "t.exr"]):
            for e in ("lattice", "scanline"):
                j = self.json_cli("grad", "one.salt", *how, *size, "--estimator", e)
                want = self.json_cli("grad", "two.salt", *how, *size, "--estimator", "quadrature", "--precision", "f64")["gradient"]["radius"]
                self.assertGreater(sum(j["dropped"].values()), 8)
                off, bar = abs(j["gradient"]["radius"] - want), j["stderr"]["radius"]
                self.assertLess(off, 2 * bar, (how, e))
                self.assertLess(bar, abs(want))
                j = self.json_cli("grad", "all.salt", *how, *size, "--estimator", e)
                want = self.json_cli("grad", "c.salt", *how, *size, "--estimator", "quadrature", "--precision", "f64")["gradient"]["radius"]
                self.assertLess(abs(j["gradient"]["radius"] - want), 2 * j["stderr"]["radius"])
        # Where nothing could be integrated nothing is known.
        self.put("d.salt", "param float r = 0.4; [Domain(-1.0, 1.0)] shader float main(float2 x) { float d = r - length(x); [Disc] if (d - sin(d) > 0.0) return 1.0; return 0.0; }")
        r = self.run_cli("grad", "d.salt", "--target", "t.exr", "--size", 64, "--spp", 16, "--estimator", "lattice")
        self.assertRegex(r.out, r"r .* \+- inf")
        self.assertIn("are not known", r.err)

    def test_shapes(self):
        self.put("s.salt", """
import m;
struct In { float q; int tag; };
struct S { float2 c; In in; };
param float a = 1.0;
param float2 v = float2(1.0, 2.0);
param float2x2 mat = float2x2(1.0, 2.0, 3.0, 4.0);
param S s[2] = { { float2(1.0, 2.0), { 3.0, 1 } }, { float2(1.0, 2.0), { 3.0, 1 } } };
param float w[2][3] = { { 1.0, 2.0, 3.0 }, { 4.0, 5.0, 6.0 } };
param texture2D t = zeros(3, 2, 2);
param heightfield h = zeros(2, 3);
param int n = 1;
[NoDiff] param float fixed = 1.0;
shader float2 main(float2 x) {
    float f = a + v.y + mat[0][1] * 2.0 + s[1].c.y * 3.0 + s[0].in.q * 4.0 + w[1][2] * 5.0 + t.load(int2(2, 0)).y * 6.0 + h.height(float2(0.0, 1.0)) * 7.0 + k * 8.0;
    return float2(f, 10.0 * f) * fixed;
}""".replace("In in;", "In q;").replace("s[0].in.q", "s[0].q.q"))
        self.put("m.salt", "param float k = 1.0;")
        g = self.json_cli("grad", "s.salt", "--samples", 1024, "--precision", "f64")["gradient"]
        self.assertEqual(set(g), {"a", "v", "mat", "s", "w", "t", "h", "m.k"})
        def near(x, y):
            if isinstance(x, list):
                self.assertEqual(len(x), len(y))
                for p, q in zip(x, y):
                    near(p, q)
            else:
                self.assertAlmostEqual(x, y, delta=1e-9)
        one, z = lambda k: [k, 10.0 * k], [0, 0]
        near(g["a"], one(1))
        near(g["v"], [z, one(1)])
        near(g["mat"], [[z, one(2)], [z, z]])
        self.assertEqual(list(g["s"][1]), ["c", "q"])
        self.assertEqual(list(g["s"][1]["q"]), ["q"])  # the integer has no place
        near(g["s"][1]["c"], [z, one(3)])
        near(g["s"][0]["q"]["q"], one(4))
        near(g["w"], [[z, z, z], [z, z, one(5)]])
        near(g["t"], [[[z, z], [z, z], [z, one(6)]], [[z, z]] * 3])
        near(g["h"], [[one(7), z], [z, z], [z, z]])
        near(g["m.k"], one(8))
        g = self.json_cli("grad", "s.salt", "--samples", 1024, "--wrt", "s[1].c,mat[0][1],a,w[1]")["gradient"]
        self.assertEqual(list(g), ["s[1].c", "mat[0][1]", "a", "w[1]"])
        near(g["s[1].c"], [z, one(3)])
        near(g["mat[0][1]"], one(2))
        near(g["w[1]"], [z, z, one(5)])
        for bad in ("nope", "n", "fixed", "s[9].c", "s[1].c.z", "a.x"):
            self.run_cli("grad", "s.salt", "--wrt", bad, code=2)

    def test_parts_add_up(self):
        self.put("c.salt", CIRCLE)
        args = ["grad", "c.salt", "--samples", 8192, "--seed", 3]
        whole, inner, edge = self.json_cli(*args), self.json_cli(*args, "--interior-only"), self.json_cli(*args, "--boundary-only")
        for p in ("radius", "ink"):
            self.assertAlmostEqual(inner["gradient"][p] + edge["gradient"][p], whole["gradient"][p], delta=1e-12)
        self.assertEqual(inner["gradient"]["radius"], 0)
        self.assertEqual(edge["gradient"]["ink"], 0)

    def test_estimators(self):
        self.put("c.salt", CIRCLE)
        for e in ("lattice", "scanline", "snap-knn", "snap-crofton", "fd"):
            j = self.json_cli("grad", "c.salt", "--samples", 65536, "--estimator", e)
            self.assertAlmostEqual(j["gradient"]["radius"], 0.75 * TAU * 0.4, delta=0.12, msg=e)
            self.assertAlmostEqual(j["gradient"]["ink"], math.pi * 0.16, delta=0.05, msg=e)

    def test_precision(self):
        self.put("c.salt", CIRCLE)
        a, b = (self.json_cli("grad", "c.salt", "--samples", 16384, "--precision", p)["gradient"]["radius"] for p in ("f32", "f64"))
        self.assertNotEqual(a, b)
        self.assertAlmostEqual(a, b, delta=1e-2)

    def test_widths_and_targets(self):
        self.put("c.salt", CIRCLE)
        want = self.json_cli("grad", "c.salt", "--samples", 16384, "--width", 16)["gradient"]
        runs = [(["--width", w], {}) for w in (1, 4, 8)] + [([], {"SALTUS_TARGET": t}) for t in ("sse2", "avx2")] + [(["--target-cpu", "sse2"], {}), (["--no-cache"], {}), (["--interpret"], {})]
        for args, env in runs:
            g = self.json_cli("grad", "c.salt", "--samples", 16384, *args, env=env)["gradient"]
            for p in ("radius", "ink"):
                self.assertAlmostEqual(g[p], want[p], delta=2e-5 if args != ["--interpret"] else 1e-4, msg=str((args, env)))
        self.run_cli("grad", "c.salt", "--target-cpu", "z80", code=2)

    def test_target_that_this_processor_lacks(self):
        """A wider target is refused where kernels would run, and only there."""
        self.put("c.salt", CIRCLE)
        runs = (["grad", "--samples", 512], ["render", "--size", 4], ["bench", "--kernels"])
        for target in ("sse2", "avx2", "avx512"):
            for verb, *args in runs:
                r = self.run_cli(verb, "c.salt", *args, "--target-cpu", target, code=None)
                if r.code:
                    self.assertEqual(r.code, 2, r.err)
                    self.assertIn("`%s`" % target, r.err)
                    self.assertNotEqual(target, "sse2")
            self.run_cli("render", "c.salt", "--size", 4, "--interpret", "--target-cpu", target)
            self.run_cli("build", "c.salt", "-o", "c.o", "--target-cpu", target)
            self.run_cli("explain", "c.salt", "--target-cpu", target)

    def test_human_table(self):
        self.put("c.salt", CIRCLE)
        r = self.run_cli("grad", "c.salt", "--samples", 1024)
        self.assertRegex(r.out, r"radius +1\.\d+ \+- ")
        self.assertRegex(r.out, r"centre\.y")

    def test_static(self):
        self.put("s.salt", "param float p = 0.5;\nshader float main(float2 x) { float f = 0.0; [Disc] if (rand() < p) f = 1.0; return f; }")
        j = self.json_cli("grad", "s.salt", "--samples", 4096)
        self.assertTrue(any("static discontinuity" in w["message"] for w in j["warnings"]))
        self.assertEqual(j["gradient"]["p"], 0)

    def test_truncated(self):
        self.put("t.salt", "shader float main(float2 x) { float s = 0.0; [MaxIters(3)] while (s < 10.0) s += 1.0; return s; }")
        self.assertGreater(self.json_cli("grad", "t.salt", "--samples", 1024)["truncated"], 0)


class Bits(Case):
    """The same seed gives the same bits on any number of threads."""

    def strip(self, text):
        j = json.loads(text)
        j.pop("seconds")
        return j

    def test_threads(self):
        self.put("c.salt", COLOUR)
        self.put("r.salt", "param float r = 0.4; shader float main(float2 x) { float f = rand(); [Disc] if (length(x - rand2()) < r) f = 1.0; return f; }")
        self.put("t.npy", write_npy((24, 24, 3), [0.5] * 1728))
        self.put("t1.npy", write_npy((24, 24, 1), [0.5] * 576))
        jobs = [["render", "-o", "a.npy"], ["grad", "-o", "a.exr"], ["grad", "--integral", "--samples", 20000], ["grad", "--target"], ["grad", "--adjoint"]]
        for shader in ("c.salt", "r.salt"):
            for job in jobs:
                args = [job[0], shader, "--json", "--size", 24, "--seed", 5, "--estimator", "lattice", *job[1:]]
                if job[-1] in ("--target", "--adjoint"):
                    args.append("t.npy" if shader == "c.salt" else "t1.npy")
                seen = set()
                for t in (1, 2, 5):
                    out = json.dumps(self.strip(self.run_cli(*args, "--threads", t).out))
                    if "-o" in job:
                        out += str(hash(self.get(job[-1])))
                    seen.add(out)
                self.assertEqual(len(seen), 1, args)
                args[args.index("--seed") + 1] = 6
                out = json.dumps(self.strip(self.run_cli(*args).out)) + (str(hash(self.get(job[-1]))) if "-o" in job else "")
                self.assertNotIn(out, seen, "another seed, other bits: %s" % args)

    def test_replicates_at_once(self):
        """Lattices of a tile each, of a program that is long enough for several threads."""
        self.put("l.salt", "param float2 c[150] = init(at); float2 at(int i) { return rand2(); } [Domain(0.0, 1.0)] shader float main(float2 x) { float f = 0.0; "
                 "for (int i = 0; i < 150; i++) { [Disc] if (length(x - c[i]) < 0.1) f += 0.1 * c[i].x; } return f; }")
        seen = {json.dumps(self.strip(self.run_cli("grad", "l.salt", "--json", "--samples", 2000, "--estimator", "lattice", "--threads", t).out)) for t in (1, 2, 5)}
        self.assertEqual(len(seen), 1)

    def test_estimators(self):
        self.put("c.salt", CIRCLE)
        for e in ("lattice", "scanline", "snap-knn", "snap-crofton", "fd"):
            seen = {json.dumps(self.strip(self.run_cli("grad", "c.salt", "--json", "--samples", 5000, "--estimator", e, "--threads", t).out)) for t in (1, 2, 5)}
            self.assertEqual(len(seen), 1, e)

    def test_long_arrays(self):
        """Threads write parts of them, which go out in order."""
        n = 9000
        self.put("l.salt", "struct S { float2 c; int tag; float q; }; S none(int i) { S s = { float2(0.0), i, 0.0 }; return s; } param S s[%d] = init(none);"
                 "shader float main(float2 x) { float f = 0.0; for (int i = 0; i < %d; i++) f += float(s[i].tag) * s[i].q + 0.1 * s[i].c.y; return f; }" % (n, n))
        out = [self.run_cli("grad", "l.salt", "--integral", "--json", "--samples", 16, "--precision", "f64", "--threads", t).out for t in (1, 2, 5)]
        cut = [text[:text.index('"seconds"')] for text in out]
        self.assertEqual(cut[0], cut[1])
        self.assertEqual(cut[0], cut[2])
        s = json.loads(out[1])["gradient"]["s"]
        self.assertEqual(len(s), n)
        for i in range(n):
            self.assertAlmostEqual(s[i]["q"], i, delta=1e-9 * n)
            self.assertEqual(s[i]["c"][0], 0)
            self.assertAlmostEqual(s[i]["c"][1], 0.1, delta=1e-12)

    def test_first_look_at_long_loops(self):
        """Threads share the boxes that say whether cells pay."""
        n = 5000
        self.put("l.salt", "float3 at(int i) { return float3(frac(0.618034 * float(i)), float(i) / %d.0, 0.004); } param float3 disc[%d] = init(at);"
                 "shader float main(float2 x) { float f = 0.0; for (int i = 0; i < %d; i++) { float2 d = x - disc[i].xy; [Disc] if (dot(d, d) < disc[i].z * disc[i].z) f = 1.0; } return f; }" % (n, n, n))
        out = [self.run_cli("grad", "l.salt", "--integral", "--json", "--estimator", "quadrature", "--error", 1e-2, "--precision", "f64", "--threads", t).out for t in (1, 2, 3)]
        cut = [text[:text.index('"seconds"')] for text in out]
        self.assertEqual(cut[0], cut[1])
        self.assertEqual(cut[0], cut[2])
        self.assertEqual(json.loads(out[0])["certified"], 1)


class Images(Case):
    def test_layers(self):
        self.put("c.salt", COLOUR)
        j = self.json_cli("grad", "c.salt", "--size", "24x16", "--spp", 16, "-o", "g.exr")
        self.assertEqual(j["outputs"], ["g.exr"])
        h, planes, types = read_exr(self.get("g.exr"))
        want = {"R", "G", "B", "crossings.Y"} | {"d.%s.%s" % (p, c) for p in ("radius", "ink.0", "ink.1", "ink.2") for c in "RGB"}
        self.assertEqual(set(planes), want)
        total = sum(sum(r) for r in planes["d.radius.G"]) / (24 * 16) * 4
        self.assertAlmostEqual(total, (0.3 - 1) * TAU * 0.4, delta=0.12)
        total = sum(sum(r) for r in planes["d.ink.1.G"]) / (24 * 16) * 4
        self.assertAlmostEqual(total, math.pi * 0.16, delta=0.03)
        self.assertEqual(sum(sum(map(abs, r)) for r in planes["d.ink.1.R"]), 0)
        self.assertGreater(sum(map(sum, planes["crossings.Y"])), 0)
        self.run_cli("render", "c.salt", "--size", "24x16", "--spp", 16, "-o", "p.exr")
        self.assertEqual(read_exr(self.get("p.exr"))[1]["R"], planes["R"])

    def compilations(self):
        return len([f for f in os.listdir(self.path("cache/saltus")) if f.endswith(".o")])

    def test_one_compilation(self):
        """The image's own kernel is compiled beside those of derivatives, not before them."""
        self.put("c.salt", CIRCLE)
        self.run_cli("grad", "c.salt", "--wrt", "radius", "--size", "8", "--spp", "1", "--estimator", "lattice", "-o", "g.npy")
        self.assertEqual(self.compilations(), 1)

    def test_edges_beside_bounds(self):
        """Kernels of edges of a small program are compiled with those of bounds, where a core is free; with the same result."""
        self.put("c.salt", CIRCLE)
        got = []
        for threads, compilations in (1, 3), (2, 4):  # bounds, edges, the rest; beside them bounds with edges
            got.append(self.json_cli("grad", "c.salt", "--integral", "--threads", threads)["gradient"])
            self.assertEqual(self.compilations(), compilations)
        self.assertEqual(got[0], got[1])

    def test_wrt_component(self):
        self.put("d.salt", """struct D { float2 centre; float radius; };
D f(int i) { D d = { float2(0.2 * i, 0.5), 0.1 }; return d; }
param D discs[40] = init(f);
shader float main(float2 x) { float s = 0.0; for (int i = 0; i < 40; i++) { [Disc] if (length(x - discs[i].centre) < discs[i].radius) s += 1.0; } return s; }""")
        r = self.run_cli("grad", "d.salt", "--size", 8, "-o", "g.exr", code=6)
        self.assertIn("--wrt", r.err)
        self.no_leftovers()
        self.run_cli("grad", "d.salt", "--size", 32, "--wrt", "discs[3].centre.x,discs[2].radius", "-o", "g.exr")
        planes = read_exr(self.get("g.exr"))[1]
        self.assertEqual(len([p for p in planes if p.startswith("d.")]), 2)
        self.assertIn("d.discs[3].centre.x.Y", planes)
        self.run_cli("grad", "d.salt", "--size", 8, "--wrt", "discs[1],discs[2].centre", "-o", "g.exr")
        names = {p for p in read_exr(self.get("g.exr"))[1] if p.startswith("d.")}
        self.assertEqual(names, {"d.discs[1].%d.Y" % i for i in range(3)} | {"d.discs[2].centre.%d.Y" % i for i in range(2)})

    def test_png(self):
        self.put("c.salt", CIRCLE)
        self.run_cli("grad", "c.salt", "--size", 32, "--spp", 16, "--wrt", "radius", "-o", "g.png")
        shape, v = read_png(self.get("g.png"))
        self.assertGreaterEqual(shape[0], 32)
        self.assertEqual(shape[2], 3)
        self.run_cli("grad", "c.salt", "--size", 32, "-o", "all.png")
        self.assertGreater(read_png(self.get("all.png"))[0][1], 3 * 32)

    def test_other_formats(self):
        self.put("c.salt", CIRCLE)
        self.run_cli("grad", "c.salt", "--size", "8x4", "--wrt", "radius", "-o", "g.npy")
        shape, v = read_npy(self.get("g.npy"))
        self.assertEqual(shape, (4, 8, 3))  # the image, its derivative, crossings
        self.run_cli("grad", "c.salt", "--size", "8x4", "--wrt", "radius", "-o", "g.exr")
        layers = read_exr(self.get("g.exr"))[1]
        for k, name in enumerate(("Y", "d.radius.Y", "crossings.Y")):
            self.assertEqual([f32(a) for a in v[k::3]], [f32(a) for row in layers[name] for a in row], name)
        self.run_cli("grad", "c.salt", "--size", 8, "-o", "no/g.exr", code=5)
        self.run_cli("grad", "c.salt", "--size", 8, "-o", "g.gif", code=2)


class Losses(Case):
    def test_target(self):
        self.put("s.salt", SMOOTH)
        self.put("t.npy", write_npy((4, 4, 1), [0.5] * 16))
        j = self.json_cli("grad", "s.salt", "--size", 4, "--spp", 64, "--target", "t.npy")
        self.assertLessEqual(KEYS | {"loss"}, set(j))
        self.run_cli("render", "s.salt", "--size", 4, "--spp", 4096, "-o", "i.npy")
        img = read_npy(self.get("i.npy"))[1]
        self.assertAlmostEqual(j["loss"], sum((v - 0.5) ** 2 for v in img) / 16, delta=2e-3)
        want = sum(2 * (v - 0.5) * ((i % 4) + 0.5) / 4 for i, v in enumerate(img)) / 16
        self.assertAlmostEqual(j["gradient"]["a"], want, delta=1e-2)

    def test_adjoint(self):
        """The sum of adjoint times image is linear in the adjoint, and agrees with the derivative image."""
        self.put("c.salt", COLOUR)
        size = ["--size", "8x6", "--spp", 16, "--seed", 2]
        self.put("a.exr", write_exr(8, 6, {c: [[1.0 * (k + 1)] * 8 for _ in range(6)] for k, c in enumerate("RGB")}))
        j = self.json_cli("grad", "c.salt", *size, "--adjoint", "a.exr")
        self.run_cli("grad", "c.salt", *size, "-o", "g.exr")
        planes = read_exr(self.get("g.exr"))[1]
        for p, layer in (("radius", "d.radius"),):
            want = sum((k + 1) * sum(map(sum, planes["%s.%s" % (layer, c)])) for k, c in enumerate("RGB"))
            self.assertAlmostEqual(j["gradient"][p], want, delta=0.15 * abs(want))
        self.assertAlmostEqual(j["gradient"]["ink"][2], 3 * sum(map(sum, planes["d.ink.2.B"])), delta=1e-3)
        total = sum((k + 1) * sum(map(sum, planes[c])) for k, c in enumerate("RGB"))
        self.assertAlmostEqual(j["loss"], total, delta=1e-3 * abs(total))
        self.run_cli("grad", "c.salt", "--size", 5, "--adjoint", "a.exr", code=4)

    def test_files(self):
        self.put("c.salt", COLOUR)
        self.assertIn("none.exr", self.run_cli("grad", "c.salt", "--size", 4, "--target", "none.exr", code=4).err)
        self.put("bad.exr", b"\x76\x2f\x31\x01junk")
        self.put("bad.png", b"\x89PNG\r\n\x1a\nxx")
        self.put("bad.npy", b"\x93NUMPY\x01\x00\xff\xff{}")
        self.put("bad.pfm", b"PF\n1000000 1000000\n-1\n")
        for n in ("bad.exr", "bad.png", "bad.npy", "c.salt"):
            self.run_cli("grad", "c.salt", "--size", 4, "--target", n, code=4)
        self.run_cli("grad", "c.salt", "--size", 4, "--target", "bad.pfm", code=6)  # a size beyond the limit
        # A PNG target is sRGB: 188 is 0.5.
        rows = b"".join(b"\0" + bytes([188] * 12) for _ in range(4))
        def chunk(k, b):
            return struct.pack(">I", len(b)) + k + b + struct.pack(">I", zlib.crc32(k + b))
        self.put("t.png", b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 4, 4, 8, 2, 0, 0, 0)) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))
        self.put("k.salt", "param float a = 0.0; shader float3 main(float2 x) { return float3(a); }")
        j = self.json_cli("grad", "k.salt", "--size", 4, "--target", "t.png")
        self.assertAlmostEqual(j["loss"], 0.2510, delta=3e-3)
        r = self.run_cli("grad", "k.salt", "--size", 8, "--target", "t.png")
        self.assertIn("resized", r.err)
        r = self.run_cli("grad", "k.salt", "--target", "t.png", "--json")  # which decides the size
        self.assertNotIn("resized", r.err)
        self.assertEqual(r.json["loss"], j["loss"])
        self.put("a.npy", write_npy((2, 3, 3), [1.0] * 18))
        self.assertAlmostEqual(self.json_cli("grad", "k.salt", "--adjoint", "a.npy")["gradient"]["a"], 18, delta=1e-4)


class Bars(Case):
    """What is printed beside a derivative covers what lines miss, and says so where it is much."""
    HAIRS = ("param float w = 4e-4;\n[Domain(-1.0, 1.0)]\nshader float main(float2 x) { float f = 0.0; for (int i = 0; i < 90; i++) { float a = 0.07 * i;"
             " [Disc] if (abs(x.x * cos(a) + x.y * sin(a) - 0.02 * (i %% 7)) < %s) f += 1.0; } return f; }")

    def test_missed(self):
        """Hairs of 90 events, where there is no probe: the truth is 403 for thin ones, and nothing is missed of wide ones."""
        for width, missed in (("w", True), ("100.0 * w", False)):
            self.put("h.salt", self.HAIRS % width)
            j = self.json_cli("grad", "h.salt", "--integral", "--estimator", "lattice")
            g, e, m = j["gradient"]["w"], j["stderr"]["w"], j["missed_estimate"]["w"]
            (self.assertGreater if missed else self.assertLess)(abs(m), (0.1 if missed else 2e-3) * abs(g))
            self.assertGreaterEqual(e, abs(m))
            self.assertEqual("missed" in [w["code"] for w in j["warnings"]], missed)
            r = self.run_cli("grad", "h.salt", "--integral", "--estimator", "lattice")
            self.assertEqual("lines miss" in r.err, missed)

    def test_missed_in_images(self):
        """100 discs, none as wide as the distance of lines: the stated error of a loss holds what is missed."""
        self.put("d.salt", "param float r = 0.002;\nshader float main(float2 x) { float f = 0.0; for (int i = 0; i < 10; i++) { for (int j = 0; j < 10; j++) {"
                 " [Disc] if (length(x - float2(0.05 + 0.1 * i, 0.0513 + 0.1 * j)) < r) f = 1.0; } } return f; }")
        self.put("one.salt", "shader float main(float2 x) { return 1.0; }")
        self.run_cli("render", "one.salt", "-o", "one.pfm", "--size", "64")
        j = self.json_cli("grad", "d.salt", "--adjoint", "one.pfm", "--size", "64", "--estimator", "lattice")
        want = 64 * 64 * 200 * 3.14159265 * 0.002
        self.assertLess(abs(j["gradient"]["r"] - want), 3 * j["stderr"]["r"])

    def test_decided_twice(self):
        """What hangs on a decision is computed from what hangs on it, too: regions by provenance (above 64 events, and where rays are searched) tell its sides apart all the same."""
        for i, value in enumerate(("if (c) v = sin(s + 0.5);", "if (c) { float q = s; for (int i = 0; i < 3; i++) q = sin(q + 0.5); v = q; }", "v = c ? s * x.x + 1.0 : 0.0;")):
            self.put("%d.salt" % i, "param float r = 0.5;\n[Domain(float2(-1.0), float2(1.0))]\nshader float main(float2 x) { float v = 0.0; [Disc] bool c = length(x) < r; float s = c ? 1.0 : 0.0; %s return v; }" % value)
            a, b = (self.json_cli("grad", "%d.salt" % i, "--integral", "--estimator", "lattice", "--near-miss", probe) for probe in ("on", "off"))
            self.assertGreater(b["crossings"], 1000)
            self.assertAlmostEqual(a["gradient"]["r"], b["gradient"]["r"], delta=2 * (a["stderr"]["r"] + b["stderr"]["r"]))

    def test_far_away(self):
        """In f32 a domain that far has 16 places a side: silence would be a lie."""
        self.put("f.salt", "param float r = 0.4;\n[Domain(1000000.0, 1000001.0)]\nshader float main(float2 x) { [Disc] if (length(x - 1000000.5) < r) return 1.0; return 0.0; }")
        for options in ((), ("--estimator", "lattice")):
            self.assertIn("few_ulps", [w["code"] for w in self.json_cli("grad", "f.salt", "--integral", *options)["warnings"]])
        self.assertIn("single precision", self.run_cli("grad", "f.salt", "--integral").err)
        self.assertEqual([], self.json_cli("grad", "f.salt", "--integral", "--precision", "f64")["warnings"])
        self.put("c.salt", CIRCLE)
        self.assertEqual([], self.json_cli("grad", "c.salt", "--integral")["warnings"])

    def test_squares_beyond_floats(self):
        """Lengths that f32 cannot square are 0 or infinite: nothing is inside, and only a warning tells."""
        disc = "param float r = %g;\n[Domain(-%g, %g)]\nshader float main(float2 x) { [Disc] if (%s) return 1.0; return 0.0; }"
        said = lambda *options: [w["code"] for w in self.json_cli("grad", "f.salt", "--integral", *options)["warnings"]]
        for side in 1e-30, 1e-22, 1e20, 1e30:
            for g in "length(x) < r", "dot(x, x) < r * r":
                self.put("f.salt", disc % (0.4 * side, side, side, g))
                for estimator in "auto", "lattice", "quadrature":
                    self.assertIn("out_of_range", said("--estimator", estimator), (side, g))
                self.assertEqual([], said("--precision", "f64"))
            self.assertRegex(self.run_cli("grad", "f.salt", "--integral").err, r"f\.salt:3.*single precision.*`saltus explain out_of_range`")
            self.put("f.salt", disc % (0.4 * side, side, side, "x.x < r"))
            self.assertEqual([], said())
        self.put("f.salt", disc % (0.4, 1, 1, "length(1e25 * x) < 1e25 * r"))
        self.assertIn("out_of_range", said())
        for g in "length(max(abs(x) - r, 0.0)) <= 0.0", "exp(-1e4 * dot(x, x)) > r", "1e-30 * length(x) < 1e-30 * r":
            self.put("f.salt", disc % (0.4, 1, 1, g))
            self.assertNotIn("out_of_range", said(), g)
        self.put("f.salt", disc % (0.4, 1, 1, "length(x + 1e25 * float2(pixel())) < 1e25 * r"))
        codes = lambda: [w["code"] for w in self.json_cli("grad", "f.salt", "--size", 16, "-o", "o.npy")["warnings"]]
        self.assertIn("out_of_range", codes())  # pixels are those of the image
        self.put("m.obj", "v -1 -1 0\nv 1 -1 0\nv 0 1 0\nf 1 2 3\n")
        for far in 1, 1e25:  # where windows are searched, at fewer points
            self.put("f.salt", 'import mesh;\nparam mesh m = "m.obj";\n' + disc.replace("[Disc] if (%s) return 1.0; return 0.0;", "Beam b = pixel_beam(float3(0.0, 0.0, 2.0), float3(-1.0, -1.0, 0.0), float3(2.0, 0.0, 0.0), float3(0.0, 2.0, 0.0)); float f = 0.0; for (Piece q = m.first(b); q.found; q = m.next(q)) f += q.area; [Disc] if (length(%g * x) < %g * r) f *= 0.5; return f;") % (0.4, 1, 1, far, far))
            (self.assertIn if far > 1 else self.assertNotIn)("out_of_range", codes())

    def test_what_no_line_meets(self):
        """Of specks bounds tell where they are; the stated error grows by what may hide there, and by next to nothing where nothing does."""
        speck = "param float r = %g;\nshader float main(float2 x) { float f = 0.0; %s return f; }"
        for body in "[Disc] if (length(x - 0.5) < r) f = 1.0;", "for (int i = 0; i < 20; i++) { [Disc] if (length(x - float2(0.04 * i + 0.1, 0.5 + 0.4 * sin(float(i)))) < r) f = 1.0; }":
            for r in 1e-9, 1e-40:
                self.put("s.salt", speck % (r, body))
                j = self.json_cli("grad", "s.salt", "--integral", "--estimator", "lattice", "--precision", "f64")
                self.assertGreater(4 * j["stderr"]["r"], 40 * 3.15 * r if "for" in body else 6.3 * r)
                self.assertLess(j["stderr"]["r"], 1e-6)

    def test_thin_ellipse(self):
        """Near its ends the slope of g changes within what roots of wider shapes are known to: .023 of the derivative was lost, and not stated."""
        self.put("e.salt", "param float a = 0.5, b = 1e-6;\n[Domain(-1.0, 1.0)]\nshader float main(float2 x) { [Disc] if (length(float2(x.x / a, (x.y - 0.1) / b)) < 1.0) return 1.0; return 0.0; }"
                 .replace("a = 0.5, b", "a = 0.5; param float b"))
        j = self.json_cli("grad", "e.salt", "--integral", "--estimator", "lattice", "--precision", "f64", "--samples", 65536)
        self.assertLess(abs(j["gradient"]["b"] - 1.5707963), 0.002)


class Check(Case):
    def test_pass(self):
        self.put("c.salt", CIRCLE)
        r = self.run_cli("check", "c.salt", "--samples", 65536)
        self.assertRegex(r.out, r"radius .*PASS")
        j = self.json_cli("check", "c.salt", "--samples", 65536)
        self.assertTrue(j["pass"])
        self.assertEqual([row["param"] for row in j["rows"]], ["radius", "centre.x", "centre.y", "ink"])
        for row in j["rows"]:
            self.assertLessEqual({"ad", "fd", "fd_stderr", "step", "slope", "z", "pass"}, set(row))
        self.put("s.salt", SMOOTH)
        for row in self.json_cli("check", "s.salt", "--precision", "f64", "--wrt", "b")["rows"]:
            self.assertAlmostEqual(row["slope"], 2, delta=0.1)

    def test_why_a_row_fails(self):
        """L bends where a jump lies on the edge of the domain; it changes without a boundary where cells decide."""
        edge = "param float r = 0.0; [Domain(0.0, 1.0)] shader float main(float2 x) { float f = 0.0; [Disc] if (x.x < r) f = %s; return f; }"
        self.put("edge.salt", edge % "1.0")
        j = self.json_cli("check", "edge.salt", code=6)  # the derivative is known for a kink, and says nothing
        self.assertEqual([w["code"] for w in j["warnings"]], ["coincident"])
        self.assertGreater(j["rows"][0]["ad_stderr"], 0.49)
        self.put("edge.salt", edge % "(rand() < 2.0 ? 1.0 : 0.0)")  # with rand() nobody looks for one
        j = self.json_cli("check", "edge.salt", code=1)
        self.assertRegex(j["why"], r"bends or jumps where r is: its derivative is (-?0|-?[0-9.]+e-\d+) below and (1|0.99\d+|1.00\d+) above")
        self.assertIn("bends or jumps where r is", self.run_cli("check", "edge.salt", code=1).out)
        self.assertTrue(self.json_cli("check", "edge.salt", "--param", "r=0.3")["pass"])
        self.put("cells.salt", "param float r = 0.45; shader float main(float2 x) { float f = 0.0; int2 c = int2(x * 64.0); [Disc] if (float(hash(uint2(c)) >> 8) / 16777216.0 < r) f = 1.0; return f; }")
        self.assertIn("no boundary moves with it", self.json_cli("check", "cells.salt", "--step", 0.05, code=1)["why"])

    def test_error_is_that_of_z(self):
        """What is printed as the error is what z divides by, with cells and without; cells leave the values no noise."""
        self.put("c.salt", CIRCLE)
        for estimator in "lattice", "quadrature":
            rows = self.json_cli("check", "c.salt", "--samples", 16384, "--estimator", estimator)["rows"]
            for row in rows:
                self.assertAlmostEqual((row["ad"] - row["fd"]) / row["error"], row["z"], delta=1e-9 * abs(row["z"]))
                self.assertGreaterEqual(row["error"], 0.999 * row["ad_stderr"])
                self.assertGreaterEqual(row["error"], 0.999 * row["fd_stderr"])
        automatic = self.json_cli("check", "c.salt")["rows"]
        self.assertEqual([row["step"] for row in automatic], [row["step"] for row in self.json_cli("check", "c.salt", "--estimator", "quadrature")["rows"]])

    def test_fail(self):
        self.put("w.salt", "param float r = 0.4;\nshader float main(float2 x) { float f = 0.0; [NoDisc] if (length(x - 0.5) < r) f = 1.0; return f; }")
        r = self.run_cli("check", "w.salt", "--samples", 65536, code=1)
        self.assertRegex(r.out, r"r .*FAIL")
        self.assertFalse(self.json_cli("check", "w.salt", "--samples", 65536, code=1)["pass"])
        self.put("t.salt", "float df(float a, float da) { return 3.0 * da; }\n[Tangent(df)] float f(float a) { return a * a; }\nparam float p = 0.7;\nshader float main(float2 x) { return f(p) * x.x; }")
        self.run_cli("check", "t.salt", "--samples", 4096, code=1)
        self.assertRegex(r.out, r"FAIL: 1 of 1 rows: r \(z -?[0-9.e+]+\)")

    def test_step(self):
        """What a step leaves out is part of the error: a large one does not fail, and is not hidden. sinh(2 h)/2h - 1 is 0.026."""
        self.put("e.salt", "param float a = 1.0;\nshader float main(float x) { return exp(2.0 * a * x) * x; }")
        j = self.json_cli("check", "e.salt", "--precision", "f64", "--step", "0.2")
        self.assertEqual(j["rows"][0]["step"], 0.2)
        self.assertTrue(j["pass"])
        self.assertGreater(j["rows"][0]["truncation"], 0.5 * abs(j["rows"][0]["fd"] - j["rows"][0]["ad"]))
        d = self.json_cli("grad", "e.salt", "--integral", "--precision", "f64", "--estimator", "fd", "--step", "0.2")
        a = self.json_cli("grad", "e.salt", "--integral", "--precision", "f64")
        off = abs(d["gradient"]["a"] - a["gradient"]["a"])
        self.assertLess(off, 2 * d["stderr"]["a"])
        self.assertGreater(off, 0.3 * d["stderr"]["a"])

    def test_element_near_zero(self):
        """An element of an array steps as the others do: by itself one of -.007 took steps of 3e-5, whose noise hides the row or fails it."""
        self.put("g.salt", "param float g[6] = { 0.5, -0.4, 0.3, -0.007, 0.35, -0.6 }; [Domain(float2(0.0), float2(5.0, 1.0))] shader float main(float2 x) { "
                 "[NoDisc] int i = min(int(x.x), 4); float v = lerp(g[i], g[i + 1], x.x - i) + 0.2 * sin(9.0 * x.y); [Disc] if (v > 0.0) return 1.0; return 0.0; }")
        for seed in 1, 2, 3:
            row = next(r for r in self.json_cli("check", "g.salt", "--estimator", "lattice", "--seed", seed)["rows"] if r["param"] == "g[3]")
            self.assertLess(row["error"], 0.1)
            self.assertGreater(row["step"], 1e-3)
            self.assertTrue(row["pass"])

    def test_order_of_the_truncation(self):
        """Of p + p^3 the error of a difference is h^2, a third of what doubling h changes; of p + 3 p |p| it is 3 h, all of it."""
        for term, truncation in (("p * p * p", 0.01), ("3.0 * p * abs(p)", 0.3)):
            self.put("t.salt", "param float p = 0.0;\nshader float main(float x) { return p + %s; }\n" % term)
            (row,) = self.json_cli("check", "t.salt", "--precision", "f64", "--step", 0.1)["rows"]
            self.assertAlmostEqual(row["truncation"], truncation, delta=1e-6)
            self.assertAlmostEqual(row["ad"], 1, delta=1e-6)
            self.assertLess(abs(row["z"]), 1.1)

    def test_rows_of_long_arrays_are_sure(self):
        """Of 64 components nearly all estimates are as large as their noise; the rows are those that are known."""
        self.put("a.salt", "param float g[64] = init(f);\nfloat f(int i) { return i * 0.01; }\n"
                 "shader float main(float2 x) { float w = rand(); int i = min(int(rand() * 4000.0), 63);\n"
                 "    return i < 60 ? 60.0 * g[i] : 0.04 * (g[60] + 0.9 * g[61] + 0.8 * g[62]) * w; }\n")
        rows = self.json_cli("check", "a.salt", "--samples", 16384, code=None)["rows"]
        self.assertEqual([r["param"] for r in rows[:3]], ["g[60]", "g[61]", "g[62]"])

    def test_what_happens_within_a_step(self):
        """Where cells of a mosaic meet other neighbours within a step, two steps differ by as little as one: a quarter of the step is asked before a row fails."""
        self.put("v.salt", "const int N = 30;\nfloat fill(int i) { return rand(); }\nparam float p[5 * N] = init(fill);\nshader float3 main(float2 x) {\n"
                 "    float3 c = 0.0;\n    float least = INFINITY;\n    for (int i = 0; i < N; i++) {\n        float2 q = float2(p[5 * i], p[5 * i + 1]);\n"
                 "        [Disc] if (length(x - q) < least) { least = length(x - q); c = float3(p[5 * i + 2], p[5 * i + 3], p[5 * i + 4]); }\n    }\n    return c;\n}\n")
        for arguments in (), ("--step", 0.0024):
            (row,) = self.json_cli("check", "v.salt", "--wrt", "p[41]", *arguments)["rows"]
            self.assertLess(abs(row["z"]), 2)
        self.assertEqual(row["step"], 0.0024)
        # A derivative that is wrong fails by a quarter of the step as well.
        self.put("w.salt", "param float r = 0.3;\nshader float main(float2 x) { float f = 0.0; [Disc] if (length(x - 0.5) < detach(r)) f = 1.0; return f + sin(30.0 * r) / 30.0; }")
        self.run_cli("check", "w.salt", code=1)

    def test_random_direction(self):
        """It goes up the slope: of a grid of noise the sum towards all sides is smaller than its error. What lines miss adds up, it is no noise."""
        for dim, size, at in ((2, 24, "g[i.y][i.x]"), (3, 12, "g[i.z][i.y][i.x]")):
            float_d, int_d = "float%d" % dim, "int%d" % dim
            corners = " + ".join("%s * %s" % (at.replace("i.", "j%d." % k), " * ".join(("w.%s" if k >> d & 1 else "(1.0 - w.%s)") % "xyz"[d] for d in range(dim))) for k in range(2 ** dim))
            moved = "".join("%s j%d = i + %s(%s); " % (int_d, k, int_d, ", ".join(str(k >> d & 1) for d in range(dim))) for k in range(2 ** dim))
            self.put("n.salt", "const int N = %d;\nfloat start(%s) { return rand() - 0.5; }\nparam float g%s = init(start);\nshader float main(%s x) {\n    [NoDisc] %s i = clamp(%s(x * (N - 1.0)), %s(0), %s(N - 2));\n    %s w = x * (N - 1.0) - %s(i);\n    %s\n    [Disc] if (%s > 0.0) return 1.0;\n    return 0.0;\n}\n"
                     % (size, ", ".join("int %s" % c for c in "abc"[:dim]), "[N]" * dim, float_d, int_d, int_d, int_d, int_d, float_d, float_d, moved, corners))
            row = self.json_cli("check", "n.salt", "--samples", 65536)["rows"][-1]
            self.assertIn("random direction", row["param"])
            self.assertGreater(row["ad"], 2 * row["error"])


class Explain(Case):
    def test_sections(self):
        self.put("c.salt", CIRCLE + "[NoDiff] param float off = 1.0; param float unused = 2.0;\n")
        r = self.run_cli("explain", "c.salt")
        for s in ("sites", "events bound", "kernels", "without a gradient", "structures built", "left out", "time to compile"):
            self.assertIn(s, r.out)
        self.assertIn("c.salt:8:", r.out)
        j = self.json_cli("explain", "c.salt")
        self.assertEqual(len(j["sites"]), 1)
        self.assertEqual((j["sites"][0]["line"], j["sites"][0]["kind"]), (8, "comparison"))
        self.assertEqual(j["events_bound"], 1)
        self.assertIn("value", j["kernels"])
        self.assertIn("off", j["no_gradient"])
        self.assertIn("left_out", j)

    def test_codes(self):
        r = self.run_cli("explain", "E0101")
        self.assertIn("E0101", r.out)
        self.assertGreater(len(r.out), 100)
        self.run_cli("explain", "E9999", code=2)
        self.json_cli("explain", "E0101")

    def test_point(self):
        self.put("c.salt", CIRCLE)
        r = self.run_cli("explain", "c.salt", "--at", "0.3,0.3")
        self.assertIn("g = ", r.out)
        self.assertIn("crossing", r.out)
        j = self.json_cli("explain", "c.salt", "--at", "0.3,0.3")
        self.assertTrue(j)
        self.run_cli("explain", "c.salt", "--at", "zero", code=2)

    def kernels(self, *args):
        return self.json_cli("explain", *args)["kernels"]

    def test_pay_for_what_you_use(self):
        """No boundary kernels without a site; what --wrt leaves out has no code. explain tries bounds."""
        self.put("s.salt", SMOOTH)
        self.assertEqual(set(self.kernels("s.salt")), {"value", "vjp", "bounds"})
        self.put("c.salt", CIRCLE)
        whole, ink, radius = (self.kernels("c.salt", *w) for w in ([], ["--wrt", "ink"], ["--wrt", "radius"]))
        self.assertLess(radius["site_vjp"]["ops"], whole["site_vjp"]["ops"])
        self.assertLess(radius["vjp"]["ops"] if "vjp" in radius else 0, whole["vjp"]["ops"])
        self.assertLess(ink["vjp"]["ops"], whole["vjp"]["ops"] + 1)
        self.assertLess(ink.get("site_vjp", {"ops": 0})["ops"], radius["site_vjp"]["ops"])
        for k in whole:
            self.assertLessEqual(radius.get(k, {"ops": 0})["ops"], whole[k]["ops"])
        self.put("n.salt", CIRCLE.replace("float f = 0.25;", "float f = 0.25; float unused = sin(x.x) * exp(x.y) + radius; "))
        self.assertEqual(self.kernels("n.salt")["value"]["ops"], whole["value"]["ops"])
        many = "".join("param float p%d = 0.5;\n" % i for i in range(20)) + "shader float main(float2 x) { float s = 0.0; %s return s; }" % "".join("s += sin(p%d * x.x);" % i for i in range(20))
        self.put("m.salt", many)
        one, all_of_them = self.kernels("m.salt", "--wrt", "p3"), self.kernels("m.salt")
        primal = one["value"]["ops"]  # the reverse kernel gives the value too
        self.assertLess(10 * (one["vjp"]["ops"] - primal), all_of_them["vjp"]["ops"] - primal)
        self.assertNotIn("p3", self.json_cli("explain", "m.salt", "--wrt", "p3")["no_gradient"])


class Bench(Case):
    def test_outputs(self):
        self.put("c.salt", CIRCLE)
        r = self.run_cli("bench", "c.salt", "--samples", 4096, "--repeats", 2, "-o", "out")
        self.assertRegex(r.out, r"lattice +\d+")
        self.assertEqual(sorted(os.listdir(self.path("out"))), ["bench.csv", "bench.json", "bench.svg"])
        lines = self.get("out/bench.csv").decode().splitlines()
        self.assertIn("seconds", lines[0])
        self.assertTrue({"lattice", "fd"} <= {l.split(",")[0] for l in lines[1:]})
        json.loads(self.get("out/bench.json"))
        import xml.dom.minidom
        self.assertEqual(xml.dom.minidom.parseString(self.get("out/bench.svg")).documentElement.tagName, "svg")
        j = self.json_cli("bench", "c.salt", "--samples", 2048, "--repeats", 2, "--estimators", "lattice,fd")
        self.assertEqual(set(j["curves"]), {"lattice", "fd"})
        for p in j["curves"]["lattice"]:
            self.assertEqual(set(p), {"samples", "evaluations", "seconds", "error"})
        self.run_cli("bench", "c.salt", "--samples", 512, "--repeats", 1, "-o", "c.salt", code=5)

    def test_one_file(self):
        """-o x.svg is a plot, not a folder of that name; which files were written is said."""
        self.put("c.salt", CIRCLE)
        bench = ["bench", "c.salt", "--samples", 512, "--repeats", 1, "--estimators", "lattice"]
        for name, start in (("x.svg", b"<svg"), ("x.json", b"{"), ("x.csv", b"estimator")):
            r = self.run_cli(*bench, "-o", name)
            self.assertIn(start, self.get(name)[:200])
            self.assertIn("saltus: %s\n" % name, r.err)
        self.assertIn("saltus: out/bench.csv, .json and .svg\n", self.run_cli(*bench, "-o", "out").err)
        self.assertEqual(self.run_cli(*bench, "-o", "out", "--quiet").err, "")
        self.assertIn(".svg", self.run_cli(*bench, "-o", "x.png", code=2).err)
        self.assertIn(b">seconds<", self.get("x.svg"))
        self.run_cli(*bench, "--against", "evaluations", "-o", "x.svg")
        self.assertIn(b">evaluations<", self.get("x.svg"))
        self.run_cli("bench", "c.salt", "--kernels", "-o", "x.csv", code=2)
        self.assertEqual(sorted(os.listdir(self.dir)), ["c.salt", "cache", "out", "x.csv", "x.json", "x.svg"])

    def test_estimators(self):
        """What --estimators names must be known, every one of it."""
        self.put("c.salt", CIRCLE)
        for names in ("nope", "", ",", "lattice,", "lattice,nope", "lat", "lattices", "Lattice"):
            r = self.run_cli("bench", "c.salt", "--samples", 512, "--repeats", 1, "--estimators", names, code=2)
            self.assertRegex(r.err, r"lattice\|.*fd")
            self.assertEqual(r.out, "")
        self.assertIn("`nope`", self.run_cli("bench", "c.salt", "--estimators", "lattice,nope", code=2).err)

    def test_kernels(self):
        self.put("c.salt", CIRCLE)
        j = self.json_cli("bench", "c.salt", "--kernels")
        self.assertEqual(set(j), {"kernels", "compile_ms"})
        self.assertEqual(set(j["compile_ms"]), {"front", "passes", "llvm", "total"})
        self.assertLessEqual({"value", "region", "event", "sides", "vjp", "site_vjp"}, set(j["kernels"]))
        for k in j["kernels"].values():
            self.assertLessEqual({"ns", "width", "ops", "tape_bytes"}, set(k))
            self.assertGreater(k["ns"], 0)
        self.put("s.salt", SMOOTH)
        self.assertEqual(set(self.json_cli("bench", "s.salt", "--kernels")["kernels"]), {"value", "vjp"})

    def test_bench_kernels_with_lists(self):
        """Of a painter's loop an image of that size runs the iterations that matter in parts of its tiles; a small one all."""
        self.put("p.salt", """param float2 at[100] = init(place);
float2 place(int i) { return rand2(); }
shader float main(float2 x) {
    float c = 0.0;
    for (int i = 0; i < 100; i++) { [Disc] if (length(x - at[i]) < 0.05) c = float(i); }
    return c;
}""")
        small, large = (self.json_cli("bench", "p.salt", "--kernels", "--size", n)["kernels"]["value"] for n in (32, 2048))
        self.assertNotIn("without_lists", small)
        self.assertIn("without_lists", large)


if __name__ == "__main__":
    unittest.main()
