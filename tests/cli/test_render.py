"""saltus render, parameters, sizes, diagnostics and exit statuses."""
import itertools
import math
import resource

from harness import *


class Basics(Case):
    def test_version(self):
        r = self.run_cli("--version")
        for word in ("saltus", "LLVM 19", "targets", "avx2", "sse2", "SIMD"):
            self.assertIn(word, r.out)

    def test_help(self):
        r = self.run_cli("--help")
        verbs = ("render", "grad", "fit", "check", "bench", "explain", "build")
        for v in verbs:
            self.assertIn("saltus " + v, r.out)
            h = self.run_cli(v, "--help").out
            self.assertIn("Exit status", h)
            self.assertIn("--entry", h)
            for line in r.out.splitlines() + h.splitlines():
                self.assertLessEqual(len(line), 160)
        common = ("--entry --set --param --params --size --spp --segments --samples --seed --threads --precision --disc --interior-only --boundary-only "
                  "--estimator --width -I --json --quiet --no-cache").split()
        h = self.run_cli("grad", "--help").out
        for o in common + ["--filter", "--wrt", "--integral", "--target", "--adjoint"]:
            self.assertIn("  " + o, h)
        h = self.run_cli("fit", "--help").out
        for o in "--iters --optimizer --lr --smooth --target --minimize -o --checkpoint --every --resume".split():
            self.assertIn("  " + o, h)

    def test_usage(self):
        self.assertIn("render", self.run_cli(code=2).err)
        self.assertIn("did you mean `render`", self.run_cli("rendr", "x.salt", code=2).err)
        self.assertIn("did you mean `--samples`", self.run_cli("grad", "x.salt", "--sample", "4", code=2).err)
        self.assertIn("not an option of `render`", self.run_cli("render", "x.salt", "--wrt", "a", code=2).err)
        for bad in (["--size", "0"], ["--size", "4x"], ["--size", "4x4x4x4"], ["--spp", "0"], ["--spp", "-1"], ["--seed", "x"], ["--width", "3"], ["--precision", "f16"],
                    ["--filter", "sinc"], ["--estimator", "magic"], ["--disc", "never"], ["--threads", "-2"], ["--samples", "1.5"], ["--set", "N"], ["--param", "=3"], ["--spp"],
                    ["--set", "N=1"] * 257, ["--wrt", "a," * 257], ["-I", "d"] * 257):
            r = self.run_cli("grad", "x.salt", *bad, code=2)
            self.assertIn(bad[0], r.err)
            self.assertEqual(r.out, "")
        self.run_cli("render", code=2)
        self.run_cli("render", "a", "b", code=2)
        self.run_cli("render", "a", "--expr", "1.0", code=2)
        self.put("c.salt", CIRCLE)
        self.run_cli("grad", "c.salt", "--interior-only", "--boundary-only", code=2)
        self.run_cli("grad", "c.salt", "--integral", "--target", "t.exr", code=2)
        self.run_cli("render", "c.salt", "-o", "x.tiff", "--size", 4, code=2)

    def test_cache_belongs_to_the_build(self):
        """Found in $PATH or called by a path, a program finds its own kernels in the cache and not those of another build."""
        self.put("c.salt", CIRCLE)
        for n, name in enumerate(("old", "new")):
            os.mkdir(self.path(name))
            with open(BIN, "rb") as f:
                program = f.read()
            note = struct.pack("<III4s", 4, 20, 3, b"GNU")  # the build id: 20 bytes that the linker makes of the others
            self.assertEqual(program.count(note), 1)
            at = program.index(note) + len(note)
            program = program[:at] + bytes([n]) + program[at + 1:]
            self.put(name + "/saltus", program)  # of one size and, as reproducible builds are, of one time
            os.chmod(self.path(name + "/saltus"), 0o755)
            os.utime(self.path(name + "/saltus"), (1, 1))

        def cached(program, folder):
            env = self.environment({"PATH": self.path(folder) + ":" + os.environ["PATH"]})
            p = subprocess.run([program, "explain", "c.salt"], executable=shutil.which(program, path=env["PATH"]), cwd=self.dir, capture_output=True, env=env)
            self.assertEqual(p.returncode, 0, p.stderr)
            return b"(cached)" in p.stdout

        self.assertFalse(cached("saltus", "old"))
        self.assertTrue(cached("saltus", "old"))
        self.assertTrue(cached(self.path("old/saltus"), "old"))
        self.assertFalse(cached("saltus", "new"))
        self.assertTrue(cached("saltus", "new"))

    def test_sources_are_no_pipes(self):
        """Nothing is waited for: a pipe, a device and a folder are refused by name."""
        os.mkfifo(self.path("pipe.salt"))
        os.mkdir(self.path("folder.salt"))
        for name, word in (("pipe.salt", "pipe"), ("/dev/zero", "device"), ("folder.salt", "directory")):
            r = self.run_cli("render", name, "--size", 4, "-o", "a.png", code=4)
            self.assertIn(word, r.err)
        self.put("c.salt", CIRCLE)
        r = self.run_cli("render", "c.salt", "--size", 4, "-o", "a.png", "--params", "pipe.salt", code=4)
        self.assertIn("pipe", r.err)
        self.no_leftovers("c.salt", "pipe.salt", "folder.salt")

    def test_sources_are_kept(self):
        """An output that is a source is refused, by whatever name, and so is a header that somebody else wrote."""
        self.put("c.salt", CIRCLE)
        os.symlink("c.salt", self.path("link.png"))
        for verb, *args in (("render",), ("grad",), ("fit", "--minimize"), ("bench", "--samples", 512), ("build",)):
            r = self.run_cli(verb, "c.salt", *args, "-o", "link.png", code=5)
            self.assertIn("source", r.err)
        self.assertEqual(self.get("c.salt").decode(), CIRCLE)
        os.mkfifo(self.path("pipe.h"))
        self.assertIn("pipe", self.run_cli("build", "c.salt", "-o", "pipe.o", code=5).err)  # and nothing waits for it
        os.remove(self.path("pipe.h"))
        self.put("k.h", "int mine;\n")
        r = self.run_cli("build", "c.salt", "-o", "k.o", code=5)
        self.assertIn("k.h", r.err)
        self.assertEqual(sorted(os.listdir(self.dir)), ["c.salt", "cache", "k.h", "link.png"])
        self.run_cli("build", "c.salt", "-o", "m.o")
        self.run_cli("build", "c.salt", "-o", "m.o")  # its own header it writes again

    def test_sandbox(self):
        """A source that is not trusted names files below its own folder: no absolute paths, no parents, no links out."""
        secret = "secret-7f3a"
        self.put("outside.csv", "1,2\n3,4\n")
        self.put("outside.salt", "// %s\nfloat k() { return 1.0; }\n" % secret)
        self.put("outside.png", secret)
        self.put("in/below/a.csv", "1,2\n3,4\n")
        self.put("in/ok.salt", "float k() { return 1.0; }\n")
        os.symlink("../outside.csv", self.path("in/link.csv"))
        os.symlink("../outside.salt", self.path("in/stolen.salt"))
        os.symlink("below/a.csv", self.path("in/kept.csv"))
        shader = 'param float a[][2] = "%s";\nshader float main(float2 x) { return a[0][0]; }\n'
        for name, allowed in (("below/a.csv", True), ("kept.csv", True), ("../outside.csv", False), ("below/../../outside.csv", False), (self.path("outside.csv"), False), ("link.csv", False)):
            self.put("in/s.salt", shader % name)
            r = self.run_cli("render", "in/s.salt", "--sandbox", "--size", 4, code=0 if allowed else 4)
            self.assertEqual("sandbox" in r.err, not allowed, r.err)
            self.run_cli("render", "in/s.salt", "--size", 4)
        for module, allowed in (("ok", True), ("sdf", True), ("stolen", False)):
            self.put("in/m.salt", "import %s;\nshader float main(float2 x) { return 1.0; }\n" % module)
            r = self.run_cli("render", "in/m.salt", "--sandbox", "--size", 4, code=0 if allowed else None)
            self.assertEqual("sandbox" in r.err, not allowed, r.err)
            self.assertNotIn(secret, r.err)
            self.assertEqual(r.code == 0, allowed)
        self.put("in/t.salt", shader % "below/a.csv")  # what the caller names is the caller's matter
        self.run_cli("render", "in/t.salt", "--sandbox", "--size", 4, "--param", "a=@outside.csv")
        self.put("in/c.salt", CIRCLE)
        scene = {"shader": "c.salt", "size": [8, 8], "target": "../outside.png", "optimizer": {"iters": 1}}
        for key, value in (("target", "../outside.png"), ("target", self.path("outside.png")), ("output", "../elsewhere"), ("shader", "../outside.salt")):
            self.put("in/scene.json", json.dumps({**scene, key: value}))
            r = self.run_cli("fit", "in/scene.json", "--sandbox", code=4)
            self.assertIn("sandbox", r.err)
            self.assertNotIn(secret, r.err)
        self.assertFalse(os.path.exists(self.path("elsewhere")))

    def test_sandbox_and_stacks(self):
        """Slices may be links, each: of a texture3D of the source, and of a scene's target."""
        self.put("in/v.salt", "param texture3D t = \"st/\";\nshader float main(float3 x) { return t.sample(x); }\n")
        self.put("in/p.salt", "param texture3D t = \"st/%04d.exr\";\nshader float main(float3 x) { return t.sample(x); }\n")
        self.put("in/z.salt", "param float a = 1.0;\nshader float main(float3 x) { return a; }\n")
        self.run_cli("render", "in/z.salt", "--size", "4x4x3", "-o", "in/st/")
        self.run_cli("render", "in/z.salt", "--size", "4x4x3", "-o", "out/")
        self.put("in/scene.json", json.dumps({"shader": "z.salt", "size": [4, 4, 3], "target": "st/", "optimizer": {"iters": 1}}))
        def all_of(code, *sandbox):
            for args in (("render", "in/v.salt", "--integral"), ("render", "in/p.salt", "--integral"), ("fit", "in/scene.json")):
                r = self.run_cli(*args, *sandbox, code=code)
                self.assertEqual("leads out" in r.err, code == 4, r.err)
        all_of(0, "--sandbox")
        os.remove(self.path("in/st/0002.exr"))
        os.symlink("../../out/0002.exr", self.path("in/st/0002.exr"))
        all_of(4, "--sandbox")
        all_of(0)
        self.run_cli("render", "in/v.salt", "--integral", "--sandbox", "--param", "t=@out/")  # what the caller names is the caller's matter

    def test_sandbox_that_cannot_be_resolved(self):
        # Names that are too long to resolve can be opened all the same: a link in such a folder led out.
        top = self.dir
        self.put("out.npy", b"\x93NUMPY\x01\0" + struct.pack("<H", 118) + b"{'descr': '<f4', 'fortran_order': False, 'shape': (1, 1, 1), }".ljust(117) + b"\n" + struct.pack("<f", 7))
        here = os.getcwd()
        try:
            os.chdir(top)
            for _ in range(18):
                os.mkdir("d" * 250)
                os.chdir("d" * 250)
            with open("a.salt", "w") as f:
                f.write('param texture2D t = "t.npy";\nshader float main(float2 x) { return t.sample(x).x; }\n')
            os.symlink(os.path.join(top, "out.npy"), "t.npy")
            ask = lambda *options: subprocess.run([BIN, "render", "a.salt", "--interpret", "--size", "2", *options], capture_output=True, env=self.environment())
            self.assertEqual(ask().returncode, 0)
            refused = ask("--sandbox")
            self.assertEqual(refused.returncode, 4, refused.stderr)
            self.assertIn(b"too long", refused.stderr)
        finally:
            os.chdir(here)

    def test_sandbox_budgets(self):
        self.put("slow.salt", "shader float main(float2 x) { float s = 0.0; for (int i = 0; i < 100000; i++) s += sin(x.x * i + s); return s; }")
        self.run_cli("render", "slow.salt", "--sandbox", "--max-seconds", "0.5", "--size", 512, "--spp", 64, "-o", "a.exr", code=6)
        self.put("big.salt", "shader float4 main(float2 x) { return x.xyxy; }")
        limited = self.run_cli("render", "big.salt", "--sandbox", "--size", "2048", "-o", "big.exr", code=None)
        self.assertIn(limited.code, (0, 6))

    def test_killed_runs_leave_nothing(self):
        """What a killed run left beside an output goes with the next run; what another run writes stays."""
        import fcntl
        self.put("c.salt", CIRCLE)
        self.put(".saltus-00000001.tmp", "left")
        self.put(".saltus-00000002.tmp", "held")
        with open(self.path(".saltus-00000002.tmp")) as held:
            fcntl.flock(held, fcntl.LOCK_EX)
            self.run_cli("render", "c.salt", "--size", 4, "-o", "a.png")
        self.assertEqual(sorted(os.listdir(self.dir)), [".saltus-00000002.tmp", "a.png", "c.salt", "cache"])

    def test_long_names(self):
        self.put("c.salt", CIRCLE)
        name = "a" * 251 + ".png"  # as long as a name may be
        self.run_cli("render", "c.salt", "--size", 4, "-o", name)
        self.assertEqual(self.get(name)[:4], b"\x89PNG")

    def test_passes(self):
        """The IR behind a pass, by name; an unknown one is an error before anything is compiled."""
        self.put("c.salt", CIRCLE)
        for verb, kernel in (("render", "value"), ("grad", "site_vjp"), ("fit", "vjp")):
            more = {"render": [], "grad": ["--integral"], "fit": ["--minimize", "--iters", 2]}[verb]
            r = self.run_cli(verb, "c.salt", *more, "--quiet", "--stop-after", kernel + ":lower_math")
            self.assertTrue(r.out.startswith("; after lower_math of %s\nfn \"%s\"" % (kernel, kernel)), r.out[:200])
            self.assertEqual((r.err, r.out.count("\nfn ")), ("", 1))
        r = self.run_cli("render", "c.salt", "--stop-after", "front", "--dump", "all")
        self.assertTrue(r.out.startswith("; after front of main"))
        self.assertEqual(r.err, r.out)
        r = self.run_cli("render", "c.salt", "--size", 4, "--quiet", "-o", "c.npy", "--verify", "--dump", "primal:opt_fold")
        self.assertEqual(r.err.count("; after "), r.err.count("; after opt_fold of main"))
        self.run_cli("render", "c.salt", "--size", 4, "-o", "c.npy", "--verify=value:opt_dce", "--stop-after", "vjp:opt_dce")
        for option in ("--dump", "--stop-after", "--verify"):
            for text, says in (("opt_fould", "did you mean `opt_fold`"), ("vlue:all", "did you mean `value`"), ("vjp:", "unknown pass"), ("", "unknown pass")):
                r = self.run_cli("render", "c.salt", option + "=" + text, code=2)
                self.assertIn("saltus: %s: unknown" % option, r.err)
                self.assertIn(says, r.err)

    def test_standard_input_and_expression(self):
        a = self.run_cli("render", "-", "--size", 8, "-o", "a.npy", stdin=CIRCLE.encode())
        self.put("c.salt", CIRCLE)
        self.run_cli("render", "c.salt", "--size", 8, "-o", "b.npy")
        self.assertEqual(self.get("a.npy"), self.get("b.npy"))
        self.assertEqual(a.out, "")
        g = self.json_cli("grad", "--expr", "length(x - 0.5) < 0.25 ? 1.0 : 0.0", "--samples", 4096)
        self.assertAlmostEqual(g["integral"][0], 0.19635, delta=0.01)
        self.assertEqual(g["gradient"], {})
        self.json_cli("render", "--expr", "float3(x, 1.0)", "--size", 4)
        self.assertIn("<expr>", self.run_cli("render", "--expr", "lenght(x)", code=3).err)

    def test_json_is_alone_on_standard_output(self):
        self.put("p.salt", "shader float main(float2 x) { print(x.x); return 1.0; }")
        r = self.run_cli("render", "p.salt", "--size", 2, "--json", "-o", "a.png")
        json.loads(r.out)
        self.assertEqual(sorted(float(l) for l in r.err.splitlines())[0] < 0.5, True)
        r = self.run_cli("render", "p.salt", "--size", 2, "-o", "a.png")
        self.assertEqual(r.out, "")


class Render(Case):
    RAMP = "shader float3 main(float2 x) { return float3(x.x, x.y, 0.25); }"

    def rows(self):
        """x to the right, y up, row 0 on top: 4 x 3 pixels, one sample each in the lattice's place; the pixel mean of a ramp is its centre only
        with many samples, so that 64 are taken."""
        return [((i + 0.5) / 4, 1 - (j + 0.5) / 3, 0.25) for j in range(3) for i in range(4)]

    def test_formats(self):
        self.put("r.salt", self.RAMP)
        for ext in ("exr", "png", "pfm", "npy"):
            self.run_cli("render", "r.salt", "--size", "4x3", "--spp", 256, "-o", "a." + ext)
        shape, v = read_npy(self.get("a.npy"))
        self.assertEqual(shape, (3, 4, 3))
        for a, b in zip(v, [c for p in self.rows() for c in p]):
            self.assertAlmostEqual(a, b, delta=0.02)
        self.assertGreater(v[1], v[-2])
        h, planes, types = read_exr(self.get("a.exr"))
        self.assertEqual((h["width"], h["height"]), (4, 3))
        self.assertEqual(types, {"R": 2, "G": 2, "B": 2})
        for j in range(3):
            for i in range(4):
                for k, c in enumerate("RGB"):
                    self.assertEqual(planes[c][j][i], v[(j * 4 + i) * 3 + k])
        shape, w = read_pfm(self.get("a.pfm"))
        self.assertEqual((shape, tuple(w)), ((3, 4, 3), v))
        shape, b = read_png(self.get("a.png"))
        self.assertEqual(shape[:2], (3, 4))
        for i in range(12):
            for k in range(3):
                self.assertAlmostEqual(b[i * shape[2] + k], 255 * to_srgb(v[i * 3 + k]), delta=0.51)

    def test_exr_header(self):
        self.put("c.salt", CIRCLE)
        self.run_cli("render", "c.salt", "--size", 8, "--spp", 7, "--seed", 9, "--param", "radius=0.25", "-o", "a.exr")
        h, planes, types = read_exr(self.get("a.exr"))
        self.assertEqual(list(planes), ["Y"])
        everything = " ".join(h["text"].values())
        self.assertIn("c.salt", everything)
        self.assertIn("saltus 0.", everything)
        params = [v for k, v in h["text"].items() if "param" in k]
        self.assertEqual(json.loads(params[0])["radius"], 0.25)
        numbers = {k.split(":")[-1]: v for k, v in h["number"].items()}
        self.assertEqual((numbers["seed"], numbers["spp"]), (9, 7))

    def test_channels(self):
        for n, names in ((1, "Y"), (2, "RG"), (3, "RGB"), (4, "RGBA")):
            t = "float" if n == 1 else "float%d" % n
            self.put("s.salt", "shader %s main(float2 x) { return %s; }" % (t, "0.5" if n == 1 else t + "(0.5)"))
            self.run_cli("render", "s.salt", "--size", 3, "-o", "a.exr")
            self.assertEqual(sorted(read_exr(self.get("a.exr"))[1]), sorted(names))
            self.run_cli("render", "s.salt", "--size", 3, "-o", "a.png")
            self.run_cli("render", "s.salt", "--size", 3, "-o", "a.npy")
            self.assertEqual(read_npy(self.get("a.npy"))[0], (3, 3, n))

    def test_sizes(self):
        self.put("one.salt", "shader float main(float x) { return x; }")
        self.put("two.salt", SMOOTH)
        self.put("three.salt", "shader float main(float3 x) { return x.x + 10.0 * x.y + 100.0 * x.z; }")
        for args, shape in ((["one.salt", "--size", "5"], (1, 5, 1)), (["two.salt", "--size", "5"], (5, 5, 1)), (["two.salt", "--size", "5x3"], (3, 5, 1)),
                            (["three.salt", "--size", "4"], (4, 4, 4, 1)), (["three.salt", "--size", "4x3x2"], (2, 3, 4, 1))):
            self.run_cli("render", *args, "-o", "a.npy")
            self.assertEqual(read_npy(self.get("a.npy"))[0], shape)
        for args, said in ((["two.salt", "--size", "5x3"], "5x3"), (["three.salt", "--size", "4x3x2"], "4x3x2"), (["three.salt", "--size", "4"], "4x4x4")):
            self.assertIn("saltus: a.npy, %s, " % said, self.run_cli("render", *args, "-o", "a.npy").err)
        j = self.json_cli("render", "two.salt")
        self.assertEqual(j["size"][:2], [512, 512])
        self.run_cli("render", "two.salt", "--size", "4x4x2", code=2)
        self.assertIn("limit", self.run_cli("render", "two.salt", "--size", "1048576x1048576", code=6).err)
        self.run_cli("render", "one.salt", "--size", 16, "-o", "c.npy", "--spp", 64)
        v = read_npy(self.get("c.npy"))[1]
        for i in range(16):
            self.assertAlmostEqual(v[i], (i + 0.5) / 16, delta=0.01)

    def test_rgba8(self):
        self.put("r.salt", self.RAMP)
        self.run_cli("render", "r.salt", "--size", "33x7", "--format", "rgba8", "-o", "a.png")
        shape, v = read_png(self.get("a.png"))
        self.assertEqual(shape, (7, 33, 4))
        self.assertGreater(v[1], v[-3])
        self.assertEqual(set(v[3::4]), {255})
        for w in (1, 4, 8, 16):
            self.run_cli("render", "r.salt", "--size", "33x7", "--format", "rgba8", "-o", "b.png", "--width", w)
            self.assertEqual(read_png(self.get("b.png"))[1], v)
        self.run_cli("render", "r.salt", "--size", "33x7", "--format", "rgba8", "-o", "c.PNG")
        self.assertEqual(self.get("c.PNG"), self.get("a.png"))
        self.run_cli("render", "r.salt", "--size", "33x7", "--format", "rgba8", "-o", "d.raw")
        self.assertEqual(list(self.get("d.raw")), list(v))

    def test_centres(self):
        """One sample in the middle of each pixel, whatever else is said about samples."""
        self.put("x.salt", "[Domain(0.0, 1.0)] shader float2 main(float2 x) { return x; }")
        self.run_cli("render", "x.salt", "--size", "8x4", "--centres", "-o", "a.npy")
        v = read_npy(self.get("a.npy"))[1]
        self.assertEqual(list(v), [c for row in range(4) for col in range(8) for c in ((col + 0.5) / 8, (3.5 - row) / 4)])
        for args in (["--spp", 9], ["--seed", 7], ["--filter", "gaussian"], ["--threads", 1], ["--estimator", "quadrature"]):
            self.run_cli("render", "x.salt", "--size", "8x4", "--centres", *args, "-o", "b.npy")
            self.assertEqual(self.get("b.npy"), self.get("a.npy"))
        for args in (["--integral"], ["--exact"], ["--interior", "quadrature"]):
            self.assertIn("--centres", self.run_cli("render", "x.salt", "--centres", *args, code=2).err)
        self.put("r.salt", "shader float main(float2 x) { return rand(); }")
        self.run_cli("render", "r.salt", "--size", 16, "--centres", "-o", "c.npy")
        v = read_npy(self.get("c.npy"))[1]
        self.assertAlmostEqual(sum(v) / 256, 0.5, delta=0.1)

    def test_rgba8_elsewhere(self):
        """Pixels without a header are not written as if they were another format, nor integrated."""
        self.put("r.salt", self.RAMP)
        for name in ("a.exr", "a.npy", "a.pfm", "a.EXR", "a.jpg"):
            r = self.run_cli("render", "r.salt", "--size", 4, "--format", "rgba8", "-o", name, code=2)
            self.assertIn(".png", r.err)
            self.assertFalse(os.path.exists(self.path(name)))
        for extra in ([], ["--json"]):
            r = self.run_cli("render", "r.salt", "--format", "rgba8", "--integral", *extra, code=2)
            self.assertIn("leave it out", r.err)
            self.assertEqual(r.out, "")

    def test_filters(self):
        self.put("c.salt", CIRCLE)
        seen = set()
        for f in ("box", "tent", "gaussian"):
            j = self.json_cli("render", "c.salt", "--size", 16, "--spp", 16, "--filter", f, "-o", f + ".npy")
            self.assertAlmostEqual(j["mean"][0], 0.25 + 0.75 * 3.14159 * 0.16 / 4, delta=0.02)
            seen.add(self.get(f + ".npy"))
        self.assertEqual(len(seen), 3)

    def test_entries(self):
        self.put("e.salt", "shader float a(float2 x) { return 0.25; } shader float b(float2 x) { return 0.75; }")
        self.assertEqual(self.json_cli("render", "e.salt", "--entry", "b", "--size", 2)["mean"], [0.75])
        self.run_cli("render", "e.salt", "--entry", "c", code=2)
        self.assertRegex(self.run_cli("render", "e.salt", code=3).err, r"e\.salt:\d+:\d+: error")

    def test_disk(self):
        self.put("c.salt", CIRCLE)
        for name in ("no/such/a.exr", "no/such/a.png", "no/a.npy", "no/a.pfm", "/dev/full/a.exr"):
            self.run_cli("render", "c.salt", "--size", 4, "-o", name, code=5)
        self.no_leftovers()
        if os.path.exists("/dev/full"):
            with open("/dev/full", "w") as full:
                p = subprocess.run([BIN, "render", "c.salt", "--size", "4", "--json"], cwd=self.dir, stdout=full, stderr=subprocess.PIPE, env=self.environment())
            self.assertEqual(p.returncode, 5)
        # A file size limit stands for the full disk: the temporary file must go again, an old file must stay.
        self.put("old.exr", b"old")
        import resource
        def limit():
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
        for name in ("old.exr", "new.exr", "new.npy", "new.pfm", "new.png"):
            p = subprocess.run([BIN, "render", "-", "--size", "256", "--no-cache", "-o", name], input=b"shader float main(float2 x) { return rand(); }", cwd=self.dir, capture_output=True,
                               env=self.environment(), preexec_fn=limit)
            self.assertEqual(p.returncode, 5, p.stderr)
        self.assertEqual(self.get("old.exr"), b"old")
        self.no_leftovers("old.exr")

    def test_address_space(self):
        # Whatever memory there is beyond the process itself: done, or status 6 and the cause in words. The loader says
        # of LLVM only that it could not be mapped.
        if os.environ.get("SALTUS_SANITIZE"):
            self.skipTest("the sanitizer takes terabytes of address space")
        self.put("c.salt", CIRCLE)
        codes = set()
        for mib in (14, 20, 30, 40, 60, 80, 100, 130, 150, 160, 170, 180, 190, 200, 220, 240, 270, 300, 4096):
            p = subprocess.run([BIN, "render", "c.salt", "--no-cache", "--size", "4", "--threads", "2", "-o", "a.pfm"], cwd=self.dir, capture_output=True, env=self.environment(),
                               preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (mib << 20, mib << 20)))
            self.assertIn(p.returncode, (0, 6), (mib, p.stderr))
            if p.returncode:
                self.assertIn(b"out of memory", p.stderr, mib)
            codes.add(p.returncode)
        self.assertEqual(codes, {0, 6})
        self.no_leftovers("a.pfm")

    def test_no_executable_memory(self):
        # Hardened systems refuse it: no fault of ours, and the interpreter needs none.
        import ctypes
        self.put("c.salt", CIRCLE)
        libc = ctypes.CDLL(None)
        refuse = lambda: libc.prctl(65, 1, 0, 0, 0)  # PR_SET_MDWE, PR_MDWE_REFUSE_EXEC_GAIN
        if subprocess.run([sys.executable, "-c", "import ctypes, sys; sys.exit(ctypes.CDLL(None).prctl(65, 1, 0, 0, 0) != 0)"]).returncode:
            self.skipTest("a kernel before 6.3")
        for more, code in (("--no-cache", 6), ("--interpret", 0)):
            p = subprocess.run([BIN, "render", "c.salt", more, "--size", "4", "-o", "a.pfm"], cwd=self.dir, capture_output=True, env=self.environment(), preexec_fn=refuse)
            self.assertEqual(p.returncode, code, p.stderr)
            self.assertEqual(b"system refuses executable memory" in p.stderr, code == 6, p.stderr)
        self.no_leftovers("a.pfm")

    def test_time_limit(self):
        self.put("slow.salt", "shader float main(float2 x) { float s = 0.0; for (int i = 0; i < 100000; i++) s += sin(x.x * i + s); return s; }")
        start = self.processor()
        self.run_cli("render", "slow.salt", "--size", 512, "--spp", 64, "--max-seconds", "0.5", "-o", "a.exr", code=6)
        self.assertLess(self.processor() - start, 20)  # to the end it would take minutes
        self.no_leftovers()

    def test_interrupt(self):
        self.put("slow.salt", "shader float main(float2 x) { float s = 0.0; for (int i = 0; i < 100000; i++) s += sin(x.x * i + s); return s; }")
        p = self.start_cli("render", "slow.salt", "--size", 512, "--spp", 64, "-o", "a.exr")
        self.interrupt(p, after=1.0)
        self.no_leftovers()


class Parameters(Case):
    def setUp(self):
        super().setUp()
        self.put("mod.salt", "const int Q = 1;\nparam float k = 0.125;\nfloat use(float z) { return z * k * Q; }\n")
        self.put("p.salt", """
import mod;
const int N = 3;
const int M = N * 2;
struct Disc { float2 centre; float radius; int tag; };
Disc make(int i) { Disc d = { float2(0.1 * i, 0.2), 0.25, i }; return d; }
param Disc discs[N] = init(make);
param float a = 0.5;
param float3 v = float3(1.0, 2.0, 3.0);
param float2x2 m = float2x2(1.0, 2.0, 3.0, 4.0);
param float w[2][3] = { { 1.0, 2.0, 3.0 }, { 4.0, 5.0, 6.0 } };
param int n = 4;
param bool on = true;
param uint u = 7u;
[NoDiff] param float fixed = 1.0;
param texture2D t = zeros(3, 2, 2);
param heightfield h = zeros(2, 2);
shader float main(float2 x) {
    float s = a * fixed + v.x * x.x + v.y * 2.0 + v.z + m[0][1] + m[1][0] * x.y + w[1][2] + n + float(u) + use(1.0) + M;
    for (int i = 0; i < N; i++) s += discs[i].centre.x * discs[i].radius + discs[i].tag;
    s += t.sample(x).x + 2.0 * t.sample(x).y + h.height(x);
    return on ? s : -s;
}
""")

    def mean(self, *args, **kw):
        return self.json_cli("render", "p.salt", "--integral", "--samples", 4096, "--precision", "f64", *args, **kw)["integral"][0]

    def test_forms(self):
        base = self.mean()
        def moved(by, *args):
            self.assertAlmostEqual(self.mean(*args) - base, by, delta=1e-6, msg=str(args))
        moved(0.5, "--param", "a=1.0")
        moved(0.5, "--param", "a=1.")
        moved(0.0, "--param", "a=.5")
        moved(-0.4, "--param", "a=1e-1")
        moved(8.0, "--param", "v=[1, 6, 3]")
        moved(8.0, "--param", "v=1,6,3")
        moved(-2.75, "--param", "v=1.,.5,3.25")
        moved(-2.75, "--param", "v=[1., .5, 3.25]")
        moved(8.0, "--param", "v.y=6")
        moved(1.0, "--param", "m[0][1]=3")
        moved(1.0, "--param", "m=[[1,3],[3,4]]")
        moved(4.0, "--param", "w[1][2]=10")
        moved(4.0, "--param", "w=[[1,2,3],[4,5,10]]")
        moved(0.25, "--param", "discs[1].centre.x=1.1")
        moved(5.0, "--param", "n=9")
        moved(2.0, "--param", "u=9")
        moved(0.875, "--param", "mod.k=1")
        moved(0.5, "--param", "fixed=2")
        moved(2.0, "--param", "h=[[2,2],[2,2]]")
        moved(5.0, "--param", "t=[[[1,2],[1,2],[1,2]],[[1,2],[1,2],[1,2]]]")
        moved(2.0, "--set", "M=8")
        moved(0.125, "--set", "mod.Q=2")
        self.assertAlmostEqual(self.mean("--param", "on=false"), -base, delta=1e-6)
        # N = 5: two more discs at x = 0.3 and 0.4, tags 3 and 4, M = 10
        moved(0.25 * 0.7 + 7 + 4, "--set", "N=5")

    def test_files(self):
        base = self.mean()
        def moved(by, *args):
            self.assertAlmostEqual(self.mean(*args) - base, by, delta=1e-6, msg=str(args))
        self.put("w.csv", "1,2,3\n4,5,10\n")
        self.put("w.json", "[[1,2,3],[4,5,10]]")
        self.put("w.npy", write_npy((2, 3), [1, 2, 3, 4, 5, 10]))
        self.put("w.exr", write_exr(3, 2, {"Y": [(1, 2, 3), (4, 5, 10)]}))
        self.put("d.csv", "# discs\n0.5,0,1,0\n0.5,0,1,0\n0.5,0,1,0\n")
        for ext in ("csv", "json", "npy", "exr"):
            moved(4.0, "--param", "w=@w." + ext)
        moved(1.5 - 0.075 - 3, "--param", "discs=@d.csv")
        self.put("t.exr", write_exr(3, 2, {"R": [(1, 1, 1), (1, 1, 1)], "G": [(2, 2, 2), (2, 2, 2)]}))
        moved(5.0, "--param", "t=@t.exr")
        self.put("h.npy", write_npy((2, 2), [2, 2, 2, 2]))
        moved(2.0, "--param", "h=@h.npy")
        self.put("all.json", '{"a": 1.0, "v": [1, 6, 3], "mod.k": 1}')
        moved(0.5 + 8 + 0.875, "--params", "all.json")
        moved(0.25 + 8 + 0.875, "--params", "all.json", "--param", "a=0.75")

    def test_bad(self):
        for p in ("b=1", "a=x", "a=[1,2]", "v=[1,2]", "v=1", "v.q=1", "discs[7].radius=1", "n=1.5", "on=2", "k=1", "main=3", "discs[0].centre=5", "u=-1"):
            r = self.run_cli("render", "p.salt", "--size", 2, "--param", p, code=2)
            self.assertTrue(p.split("=")[0].split(".")[0].split("[")[0] in r.err, (p, r.err))
        self.assertIn("radius", self.run_cli("render", "p.salt", "--param", "discs[0].radus=1", code=2).err)
        for s in ("Z=1", "N=x", "N=1.5", "a=1"):
            self.assertTrue(self.run_cli("render", "p.salt", "--size", 2, "--set", s, code=2).err)
        self.put("w.csv", "1,2\n")
        self.put("bad.json", '{"a": ')
        self.put("unknown.json", '{"aa": 1}')
        self.put("shape.json", '{"v": [1, 2]}')
        for args in (["--param", "w=@missing.csv"], ["--param", "w=@w.csv"], ["--params", "missing.json"], ["--params", "bad.json"], ["--params", "unknown.json"], ["--params", "shape.json"],
                     ["--param", "t=@missing.exr"], ["--param", "h=@w.csv"]):
            r = self.run_cli("render", "p.salt", "--size", 2, *args, code=4)
            self.assertIn(args[1].split("@")[-1], r.err)

    def test_open_size(self):
        self.put("o.salt", 'param float pts[][2] = "pts.npy";\nshader float main(float2 x) { float s = 0.0; for (int i = 0; i < len(pts); i++) s += pts[i].y; return s; }'.replace("pts[i].y", "pts[i][1]"))
        self.put("pts.npy", write_npy((3, 2), [0, 1, 0, 2, 0, 3]))
        self.assertEqual(self.json_cli("render", "o.salt", "--size", 2)["mean"], [6])
        self.put("five.npy", write_npy((5, 2), [0, 1] * 5))
        self.assertEqual(self.json_cli("render", "o.salt", "--size", 2, "--param", "pts=@five.npy")["mean"], [5])
        body = "%s %s p[] = \"p.json\"; shader float main(float2 x) { float s = float(len(p)); for (int i = 0; i < len(p); i++) s += %s; return s; }"
        for before, kind, rows, term, want in (("param", "float", "[1, 2, 4]", "p[i]", 10), ("param", "float3", "[[1, 2, 3], [4, 5, 6]]", "p[i].z", 11),
                                               ("param", "float2x2", "[[[1, 2], [3, 4]]]", "p[i][1][0]", 4),
                                               ("struct S { float2 c; float r; }; param", "S", '[{"c": [1, 2], "r": 3}, {"r": 5, "c": [0, 1]}]', "p[i].c.y * p[i].r", 13)):
            with self.subTest(kind):
                self.put("j.salt", body % (before, kind, term))
                self.put("p.json", rows)
                self.assertEqual(self.json_cli("render", "j.salt", "--size", 2)["mean"], [want])
                self.put("named.json", '{"p": %s, "q": 1}' % rows)
                self.assertEqual(self.json_cli("render", "j.salt", "--size", 2, "--param", "p=@named.json")["mean"], [want])
                line = re.findall(r"[0-9]+", rows) if kind != "S" else ["1", "2", "3", "0", "1", "5"]
                elements = len(json.loads(rows))
                each = len(line) // elements
                for text in ('{"p": %s}' % rows, "[%s]" % ", ".join(line), "[[%s]]" % "], [".join(", ".join(line[k * each:(k + 1) * each]) for k in range(elements)))[:2 if kind == "float" else 3]:
                    self.put("p.json", text)  # by name in the source's own file; all in a line; a line for each element
                    self.assertEqual(self.json_cli("render", "j.salt", "--size", 2)["mean"], [want])
        for rows in ("[[1, 2], [3]]", "[[1, 2], 3]", "[1, 2, 3]", "3", "{}", "[]"):
            self.put("j.salt", body % ("param", "float2", "p[i].y"))
            self.put("p.json", rows)
            self.assertIn("p.json", self.run_cli("render", "j.salt", "--size", 2, code=4).err)
        n = 170  # more numbers than an array may list
        self.put("big.salt", 'param float g[][%d][%d] = "g.npy"; shader float main(float x) { return g[int(%d * x)][1][2]; }' % (n, n, n))
        plane = [0.0] * (n * n)
        plane[n + 2] = 0.5
        self.put("g.npy", write_npy((n, n, n), plane * n, "<f4"))
        self.assertEqual(self.json_cli("render", "big.salt", "--size", 16)["mean"], [0.5])
        os.remove(self.path("pts.npy"))
        self.assertIn("pts.npy", self.run_cli("render", "o.salt", "--size", 2, code=4).err)

    def test_meshes(self):
        self.put("m.obj", "o a\nv 0 0 0\nv 2 0 0\nv 2 2 0\nv 0 2 0\nvt 0 0\nvt 1 0\nvt 1 0.5\nf 1/1 2/2 3/3 4\ng b\nv 0 0 4\nf 1 2 -1\n")
        self.put("m.ply", "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
        self.put("m.salt", """param float3 v[] = "m.obj"; param int3 f[] = "m.obj"; param float3 n[] = "m.obj:normals"; param float2 uv[][3] = "m.obj:uv"; param int part[] = "m.obj:parts";
shader float4 main(float2 x) {
    float area = 0.0;
    for (int i = 0; i < len(f); i++) area += 0.5 * length(cross(v[f[i].y] - v[f[i].x], v[f[i].z] - v[f[i].x]));
    return float4(area, len(v), n[2].z + 10.0 * uv[1][1].x + 100.0 * uv[1][2].x, 10.0 * part[0] + part[2]);
}""")
        j = self.json_cli("render", "m.salt", "--size", 2)
        self.assertEqual(j["mean"], [8, 5, 11, 1])
        self.put("one.salt", "param float3 v[] = {float3(1.0)}; param uint f[][3] = {{0u, 0u, 0u}}; shader float3 main(float2 x) { return float3(len(v), v[f[0][1]].x, len(f)); }")
        self.assertEqual(self.json_cli("render", "one.salt", "--size", 1, "--param", "v=@m.ply", "--param", "f=@m.ply")["mean"], [3, 1, 1])
        g = self.json_cli("grad", "m.salt", "--integral", "--samples", 64, "--wrt", "v")["gradient"]["v"]
        self.assertAlmostEqual(g[4][2][0], 1, 4)
        for path, said in (("m.obj:edges", "no `edges`"), ("m.obj:faces", "integers"), ("m.ply:uv", "no texture coordinates"), ("none.obj", "none.obj"), ("none.obj:faces", "integers")):
            self.assertIn(said, self.run_cli("render", "one.salt", "--param", "v=@" + path, code=4).err)

    def test_volumes(self):
        self.put("s.salt", "shader float2 main(float3 x) { return float2(1.0 + x.x + 2.0 * x.y + 4.0 * x.z, x.x * x.z); }")
        self.put("v.salt", 'param texture3D v = "v.npy"; param float3 p = float3(0.3, 0.6, 0.7); shader float4 main(float x) { return v.sample(p); }')
        self.put("g.frag", "#version 300 es\nprecision highp float; uniform highp sampler3D v; out vec4 o;\nvoid main() { o = texture(v, vec3(0.3, 0.6, 0.7)) + float(textureSize(v, 0).z) - texelFetch(v, ivec3(1, 2, 0), 0); }")
        size = (6, 5, 4)
        texel = lambda x, y, z: (1 + (x + .5) / 6 + (y + .5) / 2.5 + (z + .5), (x + .5) / 6 * (z + .5) / 4)
        for name in ("v.npy", "one.exr", "stack/", "s%03d.exr", "s%d.exr"):
            j = self.json_cli("render", "s.salt", "--size", "6x5x4", "--centres", "-o", name)
            self.assertEqual(j["size"], [6, 5, 4])
            value = self.json_cli("render", "v.salt", "--size", 1, "--param", "v=@" + name)["mean"]
            for got, want in zip(value, (1 + .3 + 1.2 + 2.8, .3 * .7, 0, 1)):
                self.assertAlmostEqual(got, want, 5)
        self.assertEqual(sorted(os.listdir(self.path("stack"))), ["%04d.exr" % k for k in range(4)])
        shape, values = read_npy(self.get("v.npy"))
        self.assertEqual(tuple(shape), (4, 5, 6, 2))  # slices, rows from the top, columns, channels
        for z, y, x in itertools.product(range(4), range(5), range(6)):
            at = ((z * 5 + y) * 6 + x) * 2
            for got, want in zip(values[at:at + 2], texel(x, 4 - y, z)):
                self.assertAlmostEqual(got, want, 5)
        got = self.json_cli("render", "g.frag", "--size", 1, "--param", "v=@v.npy")["mean"]
        for k in range(2):
            self.assertAlmostEqual(got[k], (1 + .3 + 1.2 + 2.8, .3 * .7)[k] + 4 - texel(1, 2, 0)[k], 5)
        self.put("v3.salt", "param float2 p = float2(0.5); shader float main(float3 x) { return p.x * x.z; }")
        self.json_cli("grad", "v3.salt", "--size", "2x3x2", "--wrt", "p.x", "-o", "d.npy")
        shape, values = read_npy(self.get("d.npy"))
        self.assertEqual(tuple(shape), (2, 3, 2, 3))  # the volume, its derivative, crossings
        for at, v in enumerate(values):
            self.assertAlmostEqual(v, (0.125, 0.25, 0, 0.375, 0.75, 0)[at % 3 + 3 * (at >= 18)], 1)
        # a volume as the target of a fit, from every kind of file, and what the fit writes as one
        self.put("f.salt", "param texture3D v = zeros(6, 5, 4, 2); shader float2 main(float3 x) { return v.sample(x).xy; }")
        for name in ("v.npy", "one.exr", "stack/", "s%03d.exr"):
            j = self.json_cli("fit", "f.salt", "--target", name, "--iters", 30, "--lr", 0.5, "--spp", 2, "-o", "fit/")
            self.assertLess(j["loss"], 0.02 * j["initial_loss"])
        a = self.json_cli("render", "f.salt", "--size", "6x5x4", "--params", "fit/fitted.json", "--centres")["mean"]
        self.assertEqual(a, self.json_cli("render", "f.salt", "--size", "6x5x4", "--param", "v=@fit/v.exr", "--centres")["mean"])
        self.assertIn("4 slices", self.run_cli("fit", "f.salt", "--target", "v.npy", "--size", "6x5x3", "--iters", 1, code=4).err)
        # smoothed, one slice pulls the others with it
        self.put("one.salt", "param texture3D v = zeros(6, 5, 4, 1); shader float main(float3 x) { float f = 0.0; [NoDisc] if (x.z < 0.25) f = v.sample(x).x; return f; }")
        self.put("x.salt", "shader float main(float3 x) { return x.x + x.y + x.z; }")
        self.run_cli("render", "x.salt", "--size", "6x5x4", "-o", "x.npy")
        last = []
        for smooth in (), ("--smooth", "v=20"):
            self.json_cli("fit", "one.salt", "--target", "x.npy", "--optimizer", "sgd", "--lr", 1, "--iters", 2, *smooth, "-o", "fit/")
            last.append(json.loads(self.get("fit/fitted.json"))["v"][3])
        self.assertEqual(last[0], [[[0]] * 6] * 5 if isinstance(last[0][0][0], list) else [[0] * 6] * 5)
        self.assertTrue(all(v != 0 for row in last[1] for v in (sum(row, []) if isinstance(row[0], list) else row)))
        self.run_cli("render", "s.salt", "--size", "6x4x1", "-o", "stack/0002.exr")
        for bad in ("none%d.exr", "flat.npy", "empty/", "s.salt", "stack"):
            self.put("flat.npy", write_npy((2, 2), [0] * 4))
            os.makedirs(self.path("empty"), exist_ok=True)
            self.assertIn(bad.strip("/"), self.run_cli("render", "v.salt", "--size", 1, "--param", "v=@" + bad, code=4).err)

    def test_not_a_number(self):
        for v in ("nan", "inf", "-inf", "1e308", "1e-320"):
            for verb in ("render", "grad"):
                extra = ["--size", 4] if verb == "render" else ["--samples", 1024]
                self.assertIn(self.run_cli(verb, "p.salt", "--json", "--param", "a=" + v, *extra, code=None).code, (0, 2, 4))
        self.put("c.salt", CIRCLE)
        for v in ("nan", "inf", "0", "-1", "1e30"):
            r = self.run_cli("grad", "c.salt", "--json", "--samples", 1024, "--param", "radius=" + v)
            json.loads(r.out, parse_constant=lambda n: self.fail(n))


class Sizes(Case):
    def test_params_decide_the_size(self):
        """Of a texture, as --param P=@FILE does: a fit that began with another grid writes parameters that others read."""
        self.put("t.salt", "param texture2D t = zeros(2, 2, 1); param texture3D v = zeros(2, 2, 2, 1); shader float main(float2 x) { return t.sample(x).x * 1.0 + v.sample(float3(x, 0.5)).x; }")
        self.put("d/a.npy", write_npy((3, 5, 1), [float(k) for k in range(15)]))
        def mean(*args):
            return self.json_cli("render", "t.salt", "--integral", "--samples", 4096, *args)["integral"][0]
        want = mean("--param", "t=@d/a.npy")
        self.put("d/p.json", json.dumps({"t": {"file": "a.npy"}}))
        self.assertEqual(mean("--params", "d/p.json"), want)
        rows = [[float(5 * j + i) for i in range(5)] for j in range(3)]
        self.put("r.json", json.dumps({"t": rows}))
        self.assertEqual(mean("--params", "r.json"), want)
        self.put("v.json", json.dumps({"v": [rows, rows, rows]}))
        self.assertAlmostEqual(mean("--params", "v.json"), want, delta=1e-5)
        self.put("bad.json", json.dumps({"t": [[1, 2, 3], [1, 2]]}))
        self.assertIn("t", self.run_cli("render", "t.salt", "--integral", "--params", "bad.json", code=4).err)
        self.put("none.json", json.dumps({"t": {"file": "none.npy"}}))
        self.assertIn("none.npy", self.run_cli("render", "t.salt", "--integral", "--params", "none.json", code=4).err)


class Errors(Case):
    def test_program(self):
        self.put("bad.salt", "shader float main(float2 x) {\n    float y = lenght(x);\n    return z;\n}\n")
        r = self.run_cli("render", "bad.salt", code=3)
        self.assertRegex(r.err, r"bad\.salt:2:15: error: .*E0101|bad\.salt:2:15: error")
        self.assertRegex(r.err, r"bad\.salt:3:12: error")
        self.assertIn("length", r.err)
        self.assertIn("^", r.err)
        self.assertEqual(r.out, "")
        r = self.run_cli("render", "bad.salt", "--json", code=3)
        d = self.lsp(r.err)
        self.assertEqual(len(d), 2)
        self.assertEqual(d[0]["range"]["start"], {"line": 1, "character": 14})
        self.assertTrue(d[0]["uri"].endswith("bad.salt"))
        self.assertEqual(d[0]["severity"], 1)
        self.assertEqual([l for l in r.err.splitlines() if not l.startswith("{")], [])

    def test_missing(self):
        self.put("i.salt", "import nosuch;\nshader float main(float2 x) { return 1.0; }")
        self.assertRegex(self.run_cli("render", "i.salt", code=3).err, r"i\.salt:1:\d+: error")
        self.put("e.salt", "float f(float x) { return x; }\n")
        self.assertRegex(self.run_cli("render", "e.salt", code=3).err, r"e\.salt:\d+:\d+: error")
        self.put("empty.salt", "")
        self.assertRegex(self.run_cli("render", "empty.salt", code=3).err, r"empty\.salt:\d+:\d+: error")
        self.put("a.salt", 'param texture2D t = "none.exr";\nshader float main(float2 x) { return t.sample(x); }')
        self.assertIn("none.exr", self.run_cli("render", "a.salt", code=4).err)
        self.assertIn("nothere.salt", self.run_cli("render", "nothere.salt", code=4).err)
        self.assertTrue(self.run_cli("render", ".", code=4).err)
        self.put("bin.salt", bytes(range(256)) * 8)
        self.run_cli("render", "bin.salt", code=3)

    def test_limits(self):
        """What would compile or run for ever ends soon, with a place or a status."""
        self.put("init.salt", "float f(int i) { float s = 0.0; for (int k = 0; k < 16000000; k++) for (int q = 0; q < 1000; q++) s += sin(float(k)); return s; }\n"
                 "param float a[100] = init(f);\nshader float main(float2 x) { return a[0]; }")
        self.assertRegex(self.run_cli("render", "init.salt", code=3).err, r"init\.salt:2:\d+: error")
        loops = "".join("for (int i%d = 0; i%d < 16777216; i%d++) " % (k, k, k) for k in range(6))
        self.put("loops.salt", "shader float main(float2 x) { float s = 0.0; %s s += x.x; return s; }" % loops)
        self.run_cli("render", "loops.salt", "--size", 2, "--max-seconds", 1, code=6)
        twice = "float f0(float x) { return sin(x); }" + "".join("float f%d(float x) { return f%d(x) + f%d(x + 1.0); }" % (i, i - 1, i - 1) for i in range(1, 26))
        self.put("twice.salt", twice + "shader float main(float2 x) { return f25(x.x); }")
        self.run_cli("render", "twice.salt", code=3)
        self.put("deep.salt", "shader float main(float2 x) { return " + "(" * 10000 + "x.x" + ")" * 10000 + "; }")
        self.run_cli("render", "deep.salt", code=3)

    def test_assert(self):
        self.put("a.salt", "shader float main(float2 x) { assert(x.x < 0.5); return 1.0; }")
        for args in (["render", "a.salt", "--size", 4], ["grad", "a.salt", "--samples", 1024]):
            r = self.run_cli(*args, "--json", code=1)
            self.assertGreater(r.json["asserts_failed"], 0)
            self.assertIn("assert", r.err)

    def test_import_folders(self):
        self.put("lib/m.salt", "float twice(float x) { return 2.0 * x; }")
        self.put("s.salt", "import m;\nshader float main(float2 x) { return twice(0.25); }")
        self.run_cli("render", "s.salt", "--size", 2, code=3)
        self.assertEqual(self.json_cli("render", "s.salt", "--size", 2, "-I", "lib")["mean"], [0.5])
        self.assertEqual(self.json_cli("render", "s.salt", "--size", 2, "-Ilib")["mean"], [0.5])

    def test_warnings(self):
        self.put("w.salt", "param float r = 0.5;\nshader float main(float2 x) { if (x.x < r) return 1.0; return 0.0; }")
        j = self.json_cli("grad", "w.salt", "--samples", 1024)
        self.assertEqual(len(j["warnings"]), 1)
        self.assertEqual(j["warnings"][0]["severity"], 2)
        self.assertIn("untracked discontinuity", j["warnings"][0]["message"])
        auto = self.json_cli("grad", "w.salt", "--samples", 4096, "--disc", "auto")
        self.assertEqual(auto["warnings"], [])
        self.assertAlmostEqual(auto["gradient"]["r"], 1.0, delta=1e-3)

    def test_a_file_beyond_the_limit_of_the_system_is_a_failed_write(self):
        self.put("circle.salt", CIRCLE)
        self.put("out.pfm", "old")
        p = subprocess.run([BIN, "render", "circle.salt", "--interpret", "--size", "64x64", "-o", "out.pfm"], cwd=self.dir, env=self.environment(),
                           capture_output=True, timeout=HANGS, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096)))
        self.assertEqual(p.returncode, 5, p.stderr)
        self.assertIn(b"File too large", p.stderr)
        self.assertEqual(self.get("out.pfm"), b"old")
        self.assertEqual([n for n in os.listdir(self.dir) if n.endswith(".tmp")], [])


class Wanted(Case):
    SOURCE = "param float r = 0.61; [Domain(-1.0, 1.0)] shader float main(float2 x) { [Disc] if (length(x) < r) return 1.0 + x.x; return 0.0; }"

    def test_an_error_is_wanted(self):
        """Pixels are integrated then, until they are known so well; or what ended it is said."""
        self.put("s.salt", self.SOURCE)
        ask = lambda *o, code=0: self.json_cli("render", "s.salt", "--size", "32", "-o", "o.pfm", "--precision", "f64", *o, code=code)
        reached = ask("--error", "1e-5")
        self.assertIsNone(reached["stopped"])
        self.assertGreater(reached["certified"], 1 - 1e-9)
        self.assertAlmostEqual(reached["mean"][0], math.pi * 0.61 ** 2 / 4, delta=1e-5)
        self.assertEqual(ask("--error", "1e-9", code=6)["stopped"], "rounding")
        self.assertEqual(ask("--abs-error", "1e-5", "--max-evaluations", "3000", code=6)["stopped"], "evaluations")


if __name__ == "__main__":
    unittest.main()
