"""Manners of the command: colours of pictures, standard output, errors as JSON, warnings where they belong, help and completions."""
import glob
import subprocess

from harness import *

RAMP = "shader float3 main(float2 x) { return float3(x.x, x.x * x.x * x.y, 1.2 - 1.5 * x.y); }"
MOVES = "param float r = 0.4;\n[Range(0.0, 1.0)] param float q = 0.5;\n[Domain(-1.0, 1.0)] shader float main(float2 x) { return x.x < r ? q : 1.0; }"


class Colours(Case):
    def test_rgba8_is_the_picture(self):
        """The kernel's own bytes are those of the float picture's PNG or neighbours of them, through the curve or not."""
        for name, text in (("a", RAMP), ("b", "[Display] " + RAMP)):
            self.put(name + ".salt", text)
            for precision in ("f32", "f64"):
                common = ["render", name + ".salt", "--size", "97x31", "--precision", precision]
                self.run_cli(*common, "--centres", "-o", "f.png")
                self.run_cli(*common, "--format", "rgba8", "-o", "k.png")
                want, got = read_png(self.get("f.png"))[1], read_png(self.get("k.png"))[1]
                got = [v for i, v in enumerate(got) if i % 4 < 3]
                self.assertEqual(len(want), len(got))
                apart = [abs(x - y) for x, y in zip(want, got)]
                self.assertLessEqual(max(apart), 1)
                self.assertLess(sum(apart), len(apart) / 20)

    def test_said_where_one_looks(self):
        self.put("a.salt", RAMP)
        self.put("b.salt", "[Display] " + RAMP)
        self.assertIn("curve of sRGB", self.run_cli("explain", "a.salt").out)
        self.assertIn("as it is", self.run_cli("explain", "b.salt").out)
        self.assertEqual([self.json_cli("explain", n + ".salt")["display"] for n in "ab"], [False, True])
        self.assertIn("sRGB", self.run_cli("render", "--help").out)


class Streams(Case):
    def stream(self, *args, code=0):
        p = subprocess.run([BIN, *map(str, args)], cwd=self.dir, capture_output=True, timeout=120, env=self.environment({"TMPDIR": self.dir}))
        self.assertEqual(p.returncode, code, p.stderr)
        return p.stdout

    def test_pictures(self):
        """-o - is the file that a name would have got."""
        self.put("a.salt", RAMP)
        for format in ("png", "pfm", "npy", "exr"):
            self.run_cli("render", "a.salt", "--size", "9x5", "-o", "f." + format)
            self.assertEqual(self.stream("render", "a.salt", "--size", "9x5", "-o", "-", "--format", format), self.get("f." + format))
        self.assertEqual(self.stream("render", "a.salt", "--size", "9x5", "-o", "-"), self.get("f.png"))
        self.assertEqual(len(self.stream("render", "a.salt", "--size", "9x5", "-o", "-", "--format", "rgba8")), 180)
        self.put("c.salt", CIRCLE)
        self.run_cli("grad", "c.salt", "--wrt", "radius", "--size", 8, "-o", "g.exr")
        self.assertEqual(self.stream("grad", "c.salt", "--wrt", "radius", "--size", 8, "-o", "-", "--format", "exr"), self.get("g.exr"))
        self.no_leftovers("f.png", "f.pfm", "f.npy", "f.exr", "g.exr")

    def test_fit(self):
        self.put("s.salt", SMOOTH)
        out = json.loads(self.stream("fit", "s.salt", "--minimize", "--iters", 2, "-o", "-"))
        self.assertEqual(set(out), {"a", "b"})

    def test_refused(self):
        self.put("a.salt", RAMP)
        self.put("bad.salt", "shader float main(float2 x) { return y; }")
        self.assertEqual(self.stream("render", "a.salt", "--json", "-o", "-", code=2), b"")
        self.assertEqual(self.stream("build", "a.salt", "-o", "-", code=2), b"")
        self.assertEqual(self.stream("render", "a.salt", "--format", "exr", "-o", "a.png", code=2), b"")
        self.assertEqual(self.stream("fit", "a.salt", "--format", "png", "-o", "-", code=2), b"")
        self.assertEqual(self.stream("render", "bad.salt", "-o", "-", code=3), b"")
        self.no_leftovers()

    def test_full(self):
        """What could not be written is not said to have been."""
        self.put("a.salt", RAMP)
        _, err = self.start_cli("render", "a.salt", "--size", "9x5", "-o", "-").communicate()
        self.assertIn(b"saltus: standard output, 9x5", err)
        with open("/dev/full", "w") as full:
            p = subprocess.run([BIN, "render", "a.salt", "--size", "9x5", "-o", "-"], cwd=self.dir, stdout=full, stderr=subprocess.PIPE, text=True, env=self.environment())
        self.assertEqual(p.returncode, 5)
        self.assertEqual(p.stderr, "saltus: standard output could not be written\n")


class Errors(Case):
    def test_json(self):
        """With --json every error is an object on standard error, wherever --json stands."""
        self.put("a.salt", MOVES)
        self.put("s.json", "{ no")
        for status, args in ((2, ["render", "a.salt", "--sise", "4", "--json"]), (2, ["rendr", "--json"]), (4, ["render", "none.salt", "--json"]),
                             (2, ["render", "--json", "a.salt", "--param", "z=1"]), (4, ["fit", "s.json", "--json"]), (5, ["render", "a.salt", "--json", "--size", "4", "-o", "no/a.png"]),
                             (6, ["render", "a.salt", "--json", "--size", "1048576x1048576"]), (3, ["render", "--json", "--expr", "y"])):
            r = self.run_cli(*args, code=status)
            self.assertEqual(r.out, "")
            lines = [json.loads(line) for line in r.err.splitlines()]
            errors = [d for d in lines if d["severity"] == 1]
            self.assertEqual(len(errors), 1, r.err)
            self.assertTrue(errors[0]["message"])
            self.assertEqual(errors[0].get("status", 3), status)

    def test_larger_than_single(self):
        """1e39 is infinite in single precision, wherever it comes from."""
        self.put("c.salt", "const float k = 1.0; " + CIRCLE.replace("f = ink", "f = ink * k"))
        self.put("v.json", '{"radius": -1e39}')
        for args in (["--param", "radius=1e39"], ["--params", "v.json"], ["--param", "radius=@v.json"], ["--param", "centre=[0, 1e39]"], ["--set", "k=1e39"]):
            for precision, told in ("f32", 1), ("f64", 0):
                with self.subTest(args=args, precision=precision):
                    err = self.run_cli("grad", "c.salt", "--integral", "--samples", "256", "--precision", precision, *args).err
                    self.assertEqual(err.count("is infinite in single precision"), told)

    def test_zero_byte(self):
        """A byte of value 0 behind what is JSON: what follows it would not be read."""
        self.put("c.salt", CIRCLE)
        for name, text in ("n.json", b'{"radius": 0.3}\n \0 {"radius": 0.2}'), ("s.json", b'{"shader": "c.salt"}\n \0'):
            self.put(name, text)
            for args in (["fit", name],) if name[0] == "s" else (["grad", "c.salt", "--params", name], ["grad", "c.salt", "--param", "radius=@" + name]):
                with self.subTest(args=args):
                    self.assertIn(name + ":2:2: a byte of value 0", self.run_cli(*args, code=4).err)

    def test_json_beside_results(self):
        """Warnings and notes too, and what an interrupt says."""
        self.put("a.frag", "uniform float r;\nvoid mainImage(out vec4 c, vec2 p) {\n  c = vec4(sqrt(p.x - 4.0) * r); }")
        self.put("loop.salt", "shader float main(float2 x) { float t = x.x; [MaxIters(2)] while (t < 1e9) t += 0.1; assert(t < 1.0); return t; }")
        for args, code, want in ((["a.frag", "--param", "iTime=1", "--param", "r=inf"], 0, {"unread": 3, "not_finite": 2, "nonfinite": 2}), (["loop.salt"], 1, {"truncated": 2, "assert": 1})):
            lines = [json.loads(line) for line in self.run_cli("render", *args, "--size", 8, "--json", code=code).err.splitlines()]
            self.assertEqual({d["code"]: d["severity"] for d in lines}, want)
            for d in lines:
                self.assertEqual(set(d), {"uri", "range", "severity", "code", "source", "message"})
        self.put("long.salt", "shader float main(float2 x) { float t = 0.0; for (int i = 0; i < 10000000; i++) t += sin(t + x.x); return t; }")
        for args in (["--max-seconds", 0.5], []):
            p = self.start_cli("render", "long.salt", "--json", "--size", 512, *args)
            err = p.communicate()[1].decode() if args else self.interrupt(p, 0.3)[1].decode()
            lines = [json.loads(line) for line in err.splitlines()]
            self.assertEqual([d["status"] for d in lines if d["severity"] == 1], [6 if args else 130])

    def test_expression(self):
        """Places are those of what was typed."""
        self.assertIn("<expr>:1:8: error", self.run_cli("render", "--expr", "length(y) + x", code=3).err)
        self.assertIn("<expr>:1:9: error", self.run_cli("render", "--expr", "length(x", code=3).err)
        self.assertIn("<expr>:2:5: error", self.run_cli("render", "--expr", "x.x +\n    (y)", code=3).err)

    def test_codes(self):
        r = self.run_cli("explain", "w0401").out
        self.assertTrue(r.startswith("W0401 (warning): untracked"))
        self.assertNotIn("%", r.splitlines()[0])
        self.assertEqual(self.json_cli("explain", "e0101")["code"], "E0101")
        for name in glob.glob(os.path.join(os.path.dirname(__file__), "../../compiler/base/diag_*.def")):
            with open(name, encoding="utf-8") as f:
                for code in re.findall('^DIAG[A-Z_]*\\(\\w+, "(\\w+)"', f.read(), re.M):
                    r = self.run_cli("explain", code).out
                    self.assertRegex(r.splitlines()[0], r"^%s \((error|warning)\): [^%%]{10,}$" % code)
                    self.assertLess(max(map(len, r.splitlines())), 130, r)
        self.assertEqual(self.run_cli("version").out, self.run_cli("--version").out)

    def test_warnings(self):
        """Of derivatives where they are computed; of values outside of their range where they are given."""
        self.put("a.salt", MOVES)
        for extra in ([], ["--integral"], ["--exact"]):
            self.assertNotIn("W04", self.run_cli("render", "a.salt", "--size", 4, *extra).err)
            self.assertEqual(self.json_cli("render", "a.salt", "--size", 4, *extra)["warnings"], [])
        self.assertIn("W0401", self.run_cli("grad", "a.salt", "--integral").err)
        self.put("p.json", '{"q": -1.0}')
        for given in (["--param", "q=2"], ["--params", "p.json"]):
            self.assertIn("W0301", self.run_cli("render", "a.salt", "--size", 4, *given).err)
            self.assertEqual([w["code"] for w in self.json_cli("render", "a.salt", "--size", 4, *given)["warnings"]], ["W0301"])
        self.assertEqual(self.run_cli("render", "a.salt", "--size", 4, "--param", "q=1").err, "")


    def test_library(self):
        """A command without its standard library says what would help, of a source that imports nothing too."""
        self.put("a.frag", "void mainImage(out vec4 c, vec2 p) { c = vec4(mod(p.x, 2.0)); }")
        self.put("a.salt", "import sdf;\nshader float main(float2 x) { return 1.0; }")
        for args in (["a.frag"], ["a.salt"], ["--expr", "x.x"]):
            self.assertIn("$SALTUS_STDLIB", self.run_cli("render", *args, env={"SALTUS_STDLIB": self.dir}, code=3).err)
        self.assertIn("`gl`, which the shader needs", self.run_cli("render", "a.frag", env={"SALTUS_STDLIB": self.dir}, code=3).err)


class Helps(Case):
    def test_help_all(self):
        for option in ("--dump", "--variant", "--stop-after", "--verify"):
            self.assertNotIn("  " + option, self.run_cli("render", "--help").out)
            self.assertIn("  " + option, self.run_cli("render", "--help-all").out)

    def complete(self, *words):
        script = "source <(%s completions bash); COMP_WORDS=(%s); COMP_CWORD=%d; _saltus; printf '%%s\\n' \"${COMPREPLY[@]}\"" % (
            BIN, " ".join("'%s'" % w for w in words), len(words) - 1)
        p = subprocess.run(["bash", "-c", script], cwd=self.dir, capture_output=True, timeout=60)
        self.assertEqual(p.stderr, b"")
        return p.stdout.decode().split()

    def test_bash(self):
        if not shutil.which("bash"):
            self.skipTest("no bash")
        self.put("a.salt", MOVES)
        self.assertEqual(self.complete("saltus", "ren"), ["render"])
        self.assertEqual(self.complete("saltus", "render", "--filt"), ["--filter"])
        self.assertEqual(self.complete("saltus", "render", "--filter", ""), ["box", "tent", "gaussian"])
        self.assertEqual(self.complete("saltus", "grad", "--filter", "=", "t"), ["tent"])
        self.assertEqual(self.complete("saltus", "render", "a"), ["a.salt"])
        self.assertEqual(self.complete("saltus", "render", "--param", "h", "=", "@a"), ["@a.salt"])
        self.assertEqual(self.complete("saltus", "render", "--dum"), [])
        self.assertIn("--optimizer", self.complete("saltus", "fit", "--"))
        self.assertNotIn("--optimizer", self.complete("saltus", "render", "--"))

    def test_other_shells(self):
        """Each knows every verb and every option of the help; a shell that is here reads its script."""
        for shell in ("zsh", "fish"):
            text = self.run_cli("completions", shell).out
            for word in ("render", "--estimator" if shell == "zsh" else "-l estimator", "box tent gaussian"):
                self.assertIn(word, text)
            self.put("script", text)
            if shutil.which(shell):
                subprocess.run([shell, "-n", "script"], cwd=self.dir, check=True, timeout=60)
        self.run_cli("completions", "tcsh", code=2)


if __name__ == "__main__":
    unittest.main()
