"""saltus fit with a loss from another program: the framing, the derivative, and every way in which the program can fail."""
import math
import statistics

from harness import *

EDGE = """
param float r = 0.3;
param float2 c = float2(0.45, 0.55);
[NoDiff] param float gain = 1.0;
shader float main(float2 x) {
    float f = 0.0;
    [Disc] if (length(x - c) < r) f = gain;
    return f;
}
"""
NOISE = "param float a = 0.8;\nshader float main(float2 x) { return a * rand(); }\n"

# The squared difference from a target of .pfm, or from zero. MODE is what it does wrong, WHEN in which request.
PROGRAM = """
import json, os, sys, time
from array import array
mode, when, n = sys.argv[1], int(sys.argv[2]), 0
log = open(sys.argv[3], "a") if len(sys.argv) > 3 else None
out = sys.stdout.buffer
def target(path, size):
    if path is None:
        return [0.0] * size
    head, data = open(path, "rb").read().split(b"\\n-1.0\\n", 1)
    w, h = map(int, head.split(b"\\n")[1].split())
    v = array("f", data)
    return [x for y in reversed(range(h)) for x in v[y * w:(y + 1) * w]]
for line in sys.stdin.buffer:
    q = json.loads(line)
    size = q["width"] * q["height"] * q["channels"]
    data = sys.stdin.buffer.read(4 * size)
    assert len(data) == 4 * size
    image = array("f", data)
    if log:
        q["sum"] = sum(image)
        log.write(json.dumps(q) + "\\n")
        log.flush()
    bad = n == when
    n += 1
    d = [a - b for a, b in zip(image, target(q["target"], size))]
    loss, adjoint = sum(x * x for x in d) / size, array("f", [2 * x / size for x in d])
    if bad and mode == "die": sys.exit(7)
    if bad and mode == "kill": os.kill(os.getpid(), 9)
    if bad and mode == "hang": time.sleep(600)
    if bad and mode == "noise": print("hello"); sys.stdout.flush()
    if bad and mode == "nan": adjoint[5] = float("nan")
    if bad and mode == "tell": out.write(json.dumps({"error": "no GPU here"}).encode() + b"\\n"); out.flush(); sys.exit(1)
    if bad and mode == "text": out.write(b'{"loss": "low"}\\n'); out.flush(); continue
    if bad and mode == "step": out.write(b'{"loss": null}\\n' + bytes(4 * size)); out.flush(); continue
    out.write(json.dumps({"loss": loss}).encode() + b"\\n")
    if bad and mode == "long": out.write(b"x" * 4)
    if bad and mode == "short":
        out.write(adjoint.tobytes()[:100]); out.flush(); sys.exit(0)
    out.write(adjoint.tobytes())
    out.flush()
"""


class Loss(Case):
    def setUp(self):
        super().setUp()
        self.put("e.salt", EDGE)
        self.put("loss.py", PROGRAM)
        self.run_cli("render", "e.salt", "--size", 16, "--spp", 64, "--param", "r=0.2", "--param", "c=0.5,0.5", "-o", "t.pfm")

    def command(self, mode="none", when=-1, log=""):
        return "exec %s loss.py %s %d %s" % (sys.executable, mode, when, log)

    def fit(self, *args, mode="none", when=-1, log="", **kw):
        return self.run_cli("fit", "e.salt", "--loss-command", self.command(mode, when, log), "--target", "t.pfm", "--size", 16, "--spp", 8, *args, **kw)

    def requests(self, name="log"):
        return [json.loads(line) for line in self.get(name).splitlines()]

    def test_fits(self):
        for name, lr in (("adam", "0.01"), ("sgd", "0.05"), ("lbfgs", None)):
            j = self.fit("--iters", 30, "--optimizer", name, *(["--lr", lr] if lr else []), "--json").json
            self.assertLess(j["loss"], 0.3 * j["initial_loss"], name)
            self.assertAlmostEqual(j["params"]["r"], 0.2, delta=0.05)
        self.assertEqual(len(j["losses"]), j["iterations"])

    def test_requests(self):
        self.fit("--iters", 3, log="log")
        q = self.requests()
        self.assertEqual([r["iteration"] for r in q], [0, 1, 2])
        for r in q:
            self.assertEqual((r["width"], r["height"], r["channels"], r["view"], r["views"], r["target"], r["mask"]), (16, 16, 1, 0, 1, "t.pfm", None))
            self.assertAlmostEqual(r["sum"] / 256, 3.14159 * 0.09, delta=0.05)

    def test_same_bits_and_resume(self):
        runs = []
        for t in (1, 3):
            j = self.fit("--iters", 8, "--threads", t, "--json").json
            j.pop("seconds")
            runs.append(json.dumps(j))
        self.assertEqual(runs[0], runs[1])
        whole = json.loads(runs[0])
        whole.pop("evaluations")
        self.fit("--iters", 3, "--checkpoint", "c.bin", "--every", 1)
        j = self.fit("--iters", 8, "--resume", "c.bin", "--json").json
        j.pop("seconds"), j.pop("evaluations")
        self.assertEqual(j, whole)
        self.fit("--iters", 8, "--resume", "c.bin", mode="nan", code=4)  # another loss is another fit

    def test_independent_samples(self):
        """f = a u with u uniform: the gradient of a squared loss is E[2 f] E[u] / n; with the same samples on both sides it would be E[2 f u] / n, a third more."""
        self.put("e.salt", NOISE)
        j = self.run_cli("fit", "e.salt", "--loss-command", self.command(), "--size", 128, "--spp", 1, "--optimizer", "sgd", "--lr", "1", "--iters", 2, "--seed", 5, "--json").json
        # losses: of the first iteration at 0.8, of the second at 0.8 - gradient; E[f^2] = a^2 / 3
        n = 128 * 128
        self.assertAlmostEqual(j["losses"][0], 0.64 / 3, delta=4 * 0.64 * (4 / 45) ** 0.5 / n ** 0.5)
        gradient = 0.8 - (3 * j["losses"][1]) ** 0.5  # the loss of the next iteration tells where the step went
        expected, other = 2 * 0.8 * 0.25, 2 * 0.8 / 3
        # standard error of the mean of 2 a u v, and of the root of the loss
        se = ((2 * 0.8) ** 2 * (1 / 9 - 1 / 16) / n + (0.4 * 3 * (4 / 45) ** 0.5 / 2 / n ** 0.5) ** 2) ** 0.5
        self.assertLess(4 * se, 0.5 * (other - expected))
        self.assertAlmostEqual(gradient, expected, delta=4 * se)

    def test_views(self):
        self.put("s/t.pfm", self.get("t.pfm"))
        self.put("s/loss.py", PROGRAM)
        self.put("s/e.salt", EDGE)
        scene = {"shader": "e.salt", "size": [16, 16], "spp": 8, "params": {"r": {"value": 0.28, "grad": True}}, "loss": {"command": self.command(log="log"), "timeout": 30},
                 "views": [{"target": "t.pfm"}, {"params": {"gain": 0.5}}], "optimizer": {"iters": 2}, "output": "out"}
        self.put("s/scene.json", json.dumps(scene))
        for refused in ((), ("--sandbox",), ("--sandbox", "--allow-commands")):  # nothing is started that was not asked for
            self.run_cli("fit", "s/scene.json", *refused, code=4)
        self.assertFalse(os.path.exists(self.path("s/log")))
        j = self.run_cli("fit", "s/scene.json", "--json", "--allow-commands").json
        q = self.requests("s/log")  # the command runs in the scene's folder
        self.assertEqual([(r["iteration"], r["view"], r["views"]) for r in q], [(0, 0, 2), (0, 1, 2), (1, 0, 2), (1, 1, 2)])
        self.assertTrue(q[0]["target"].endswith("t.pfm"))
        self.assertIsNone(q[1]["target"])
        self.assertAlmostEqual(q[1]["sum"], 0.5 * q[0]["sum"], delta=2)  # the second view's own value, and only there
        self.assertEqual(j["params"]["gain"], 1)
        self.assertIn("image.exr", os.listdir(self.path("s/out")))
        for key, bad in (("command", 3), ("command", ""), ("timeout", -1), ("comand", "x")):
            scene["loss"] = {"command": "true", key: bad}
            self.put("s/scene.json", json.dumps(scene))
            self.run_cli("fit", "s/scene.json", "--allow-commands", code=4)

    def test_failures(self):
        """Every one of them at once and late: status, text, and what is written."""
        for mode, code, text in (("die", 1, "ended with status 7"), ("kill", 1, "signal 9"), ("noise", 1, "hello"), ("nan", 1, "row 0, column 5"), ("tell", 1, "no GPU here"), ("text", 1, "NUMBER"),
                                 ("short", 1, "of 1024 bytes"), ("hang", 6, "5 s")):
            for when in (0, 2):
                start = time.time()
                r = self.fit("--iters", 5, "--loss-timeout", 5 if mode == "hang" else 100, "-o", "p.json", mode=mode, when=when, code=code)
                self.assertIn(text, r.err)
                self.assertLess(time.time() - start, 300)
                self.assertEqual(os.path.exists(self.path("p.json")), when > 0, mode)  # the best so far, where there is one
                if when:
                    self.assertIn("(failed)", r.out)
                    self.assertEqual(set(json.loads(self.get("p.json"))), {"r", "c", "gain"})
                    os.remove(self.path("p.json"))
        self.assertIn("more than", self.fit("--iters", 5, mode="long", when=0, code=1).err)
        for command, text in (("exit 3", "status 3"), ("no-such-program", "status 127"), ("cat /dev/zero", "64 KiB"), ("exec <&-; sleep 600", "pipe")):
            r = self.run_cli("fit", "e.salt", "--loss-command", command, "--size", 16, "--loss-timeout", 2, "-o", "p.json", code=None)
            self.assertIn(r.code, (1, 6))
            # Which of them it sees first is a matter of time.
            self.assertTrue(any(t in r.err for t in (text, "did not answer", "more than its answer")), r.err)
        self.no_leftovers("loss.py", "t.pfm")

    def test_step_back(self):
        """null: no number there. The optimiser takes the step back, and goes on."""
        j = self.fit("--iters", 12, "--json", mode="step", when=3).json
        self.assertIsNone(j["losses"][3])
        self.assertLess(j["loss"], j["initial_loss"])
        self.fit("--iters", 12, mode="step", when=0, code=1)

    def test_example(self):
        """examples/external_loss: discs find their way to a target that they do not touch, which squared differences do not show them."""
        here = os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../examples/external_loss")
        for name in ("discs.salt", "mover.py"):
            shutil.copy(os.path.join(here, name), self.path(name))
        self.run_cli("render", "discs.salt", "--size", 32, "--spp", 64, "--param", "discs[0].centre=0.7,0.7", "--param", "discs[0].radius=0.16", "--param", "discs[1].centre=0.35,0.3", "-o", "target.pfm")
        common = ["fit", "discs.salt", "--target", "target.pfm", "--size", 32, "--iters", 150, "--lr", "0.01"]
        d = self.json_cli(*common, "--loss-command", sys.executable + " mover.py")["params"]["discs"]
        for got, want in ((d[0]["centre"], (0.7, 0.7)), (d[1]["centre"], (0.35, 0.3))):
            for a, b in zip(got, want):
                self.assertAlmostEqual(a, b, delta=0.02)
        self.assertAlmostEqual(d[0]["radius"], 0.16, delta=0.01)
        self.assertLess(self.json_cli(*common)["params"]["discs"][0]["radius"], 0.06)

    def test_usage(self):
        self.run_cli("fit", "e.salt", "--loss-command", "true", "--minimize", code=2)
        self.run_cli("fit", "e.salt", "--loss-command", "true", "--loss-timeout", "soon", code=2)
        self.run_cli("render", "e.salt", "--loss-command", "true", code=2)

    def test_interrupt(self):
        """Ctrl-C while the program thinks: 130, what is best is kept, and nobody is left behind."""
        p = self.start_cli("fit", "e.salt", "--loss-command", "echo $$ > pid; " + self.command("hang", 2, "log"), "--target", "t.pfm", "--size", 16, "--iters", 9, "-o", "p.json")
        while p.poll() is None and not (os.path.exists(self.path("log")) and self.get("log").count(b"\n") > 2):
            time.sleep(0.05)
        out, err = self.interrupt(p, after=0)
        self.assertIn(b"(interrupted)", out)
        self.assertTrue(os.path.exists(self.path("p.json")))
        with self.assertRaises(ProcessLookupError):
            os.kill(int(self.get("pid")), 0)

    def test_time_limit(self):
        r = self.fit("--iters", 9, "--max-seconds", 10, "-o", "p.json", mode="hang", when=2, code=6)
        self.assertTrue(os.path.exists(self.path("p.json")), r.err)


class Chance(Case):
    """Derivatives of weighted images of shaders that call rand(): bars are as wide as the errors want, and hardly a matter of chance themselves."""

    def test_bars(self):
        for name, body in {
            "number 0": "length(x - float2(0.013, 0.027)) < r + 0.1 * rand()",
            "number 0 along an edge": "x.x + 0.3 * rand() < r",
            "a product": "length(x - float2(0.013, 0.027)) < r + 0.2 * rand() * rand()",
        }.items():
            with self.subTest(name):
                self.put("p.salt", "param float r = 0.4;\n[Domain(-1.0, 1.0)] shader float main(float2 x) { float f = 0.0; [Disc] if (%s) f = 1.0; return f; }" % body)
                adjoint = [1 + 0.5 * math.cos(0.31 * i + 0.17 * (63 - j)) for j in range(64) for i in range(64)]
                self.put("a.npy", write_npy((64, 64, 1), adjoint))
                run = lambda seed, *spp: self.json_cli("grad", "p.salt", "--adjoint", "a.npy", "--size", 64, "--seed", seed, "--quiet", *spp)
                truth = statistics.fmean(run(1000 + s, "--spp", 256)["gradient"]["r"] for s in range(4))
                runs = [run(s) for s in range(1, 25)]
                off = [abs(j["gradient"]["r"] - truth) for j in runs]
                bars = sorted(j["stderr"]["r"] for j in runs)
                rms = math.sqrt(statistics.fmean(o * o for o in off))
                self.assertLess(bars[12], (4.5 if "edge" in name else 2.5) * rms)
                self.assertLess(bars[20], 1.5 * bars[4])
                self.assertLessEqual(sum(o > 2 * j["stderr"]["r"] for o, j in zip(off, runs)), 2)


class Adjoint(Case):
    """The adjoint of a loss comes of samples too, and its error is a part of the bar: by the lattice two bars hold the truth."""

    def test_bars(self):
        for name, body, spp in (("edge", "x.x < r", 4), ("oblique edge", "x.x + 0.5 * x.y < r", 16), ("disc", "length(x - float2(0.013, 0.027)) < r", 4), ("chance", None, 16)):
            with self.subTest(name):
                f = "float f = r * rand() * (1.0 + x.x);" if body is None else "float f = 0.0; [Disc] if (%s) f = 1.0;" % body
                self.put("p.salt", "param float r = 0.4;\n[Domain(-1.0, 1.0)] shader float main(float2 x) { %s return f; }" % f)
                self.run_cli("render", "p.salt", "--size", 32, "--spp", 256, "--param", "r=0.47", "-o", "t.npy", "--quiet")
                run = lambda seed, n: self.json_cli("grad", "p.salt", "--target", "t.npy", "--size", 32, "--seed", seed, "--spp", n, "--estimator", "lattice", "--quiet")
                truth = statistics.fmean(run(1000 + s, 1024)["gradient"]["r"] for s in range(3))
                runs = [run(s, spp) for s in range(1, 25)]
                off = [abs(j["gradient"]["r"] - truth) for j in runs]
                bars = [j["stderr"]["r"] for j in runs]
                self.assertLessEqual(sum(o > 2 * b for o, b in zip(off, bars)), 2)
                self.assertFalse(any(o > 4 * b for o, b in zip(off, bars)))
                self.assertLess(statistics.median(bars), 2.5 * math.sqrt(statistics.fmean(o * o for o in off)))

    def test_many_parameters(self):
        """Of more than 4096 tiles are not told apart, and the adjoint's noise is in the bars all the same."""
        self.put("p.salt", "param float a[5000] = {%s};\n[Domain(-1.0, 1.0)] shader float main(float2 x) { float f = a[4999]; "
                 "[Disc] if (x.x + 0.5 * x.y < 0.4 + a[17]) f = 1.0 + a[3]; return f; }" % ", ".join(["0.0"] * 5000))
        self.put("t.npy", write_npy((32, 32, 1), [float(i % 32 < 22) for i in range(1024)]))
        run = lambda seed, n: self.json_cli("grad", "p.salt", "--target", "t.npy", "--size", 32, "--seed", seed, "--spp", n, "--estimator", "lattice", "--quiet")
        truth = run(1000, 1024)["gradient"]["a"]
        runs = [run(s, 4) for s in range(1, 13)]
        z = [abs(j["gradient"]["a"][i] - truth[i]) / j["stderr"]["a"][i] for j in runs for i in (3, 17, 4999)]
        self.assertLessEqual(sum(v > 2 for v in z), 4)
        self.assertLess(max(z), 4)
        self.assertGreater(statistics.median(z), 0.15)
        self.assertEqual(runs[0]["stderr"]["a"][5], 0)

    def test_one_sample(self):
        """Half of it says nothing of the other half: what a pixel errs by is not known."""
        self.put("p.salt", "param float a = 0.3;\nparam float b = 0.3;\nshader float main(float x) { float f = 0.0; [Disc] if (x < a) f = 1.0; return f; }")
        self.put("t.npy", write_npy((1, 1, 1), [0.5]))
        ask = lambda *o: self.json_cli("grad", "p.salt", "--target", "t.npy", "--size", 1, "--wrt", "a", "--quiet", *o)
        j = ask("--spp", 1, "--estimator", "lattice")
        self.assertEqual(j["stderr"]["a"], math.inf)
        self.assertIn("are not known", self.run_cli("grad", "p.salt", "--target", "t.npy", "--size", 1, "--spp", 1, "--estimator", "lattice").err)
        self.assertAlmostEqual(ask("--spp", 1, "--estimator", "quadrature")["gradient"]["a"], -0.4, delta=1e-6)

    def test_halves_that_agree(self):
        """One pixel, and two halves of its samples that see the same: still a sample of the jump may be missed."""
        self.put("p.salt", "param float a = 0.3;\nshader float main(float x) { float f = 0.0; [Disc] if (x < a) f = 1.0; return f; }")
        self.put("t.npy", write_npy((1, 1, 1), [0.5]))
        for seed in range(1, 9):
            j = self.json_cli("grad", "p.salt", "--target", "t.npy", "--size", 1, "--spp", 256, "--estimator", "lattice", "--seed", seed, "--quiet")
            self.assertLessEqual(abs(j["gradient"]["a"] + 0.4), 4 * j["stderr"]["a"])
            self.assertLess(j["stderr"]["a"], 0.03)


class Grids(Case):
    """Textures and heights as what is fitted: masks, smoothing, rates of their own, files in views, what the folder holds."""
    SHADER = """
param texture2D t = zeros(8, 8, 1);
[Extent(-1.0, -1.0, 1.0, 1.0)] param heightfield h = zeros(9, 9);
[NoDiff] param texture2D light = zeros(2, 2, 1);
shader float main(float2 x) { return t.sample(x).x + h.height(2.0 * x - 1.0) + light.sample(x).x; }
"""

    def setUp(self):
        super().setUp()
        self.put("g.salt", self.SHADER)
        self.put("one.npy", write_npy((16, 16, 1), [1.0] * 256))
        self.put("two.npy", write_npy((16, 16, 1), [2.0] * 256))

    def scene(self, **change):
        s = {"shader": "g.salt", "size": [16, 16], "spp": 4, "params": {"t": {"grad": True, "lr": 0.02}, "h": {"grad": True, "lr": 0.05, "smooth": 2}}, "views": [{"target": "one.npy"}],
             "optimizer": {"iters": 60}, "output": "out"}
        s.update(change)
        self.put("scene.json", json.dumps(s))
        return self.run_cli("fit", "scene.json", "--json", code=None)

    def test_jointly(self):
        r = self.scene()
        self.assertEqual(r.code, 0, r.err)
        j = r.json
        self.assertLess(j["loss"], 1e-3)
        t, h = [sum(map(sum, j["params"][k])) / (len(j["params"][k]) ** 2) for k in "th"]
        self.assertAlmostEqual(t + h, 1, delta=0.1)
        self.assertGreater(h, 1.5 * t)  # the higher rate
        head, planes, _ = read_exr(self.get("out/h.exr"))
        self.assertEqual((head["width"], head["height"]), (9, 9))
        rows = list(planes.values())[0]
        for y in range(9):
            for x in range(9):
                self.assertEqual(rows[y][x], f32(j["params"]["h"][y][x]))
        self.assertEqual(read_png(self.get("out/h.png"))[0], (9, 9, 3))
        self.assertEqual(read_exr(self.get("out/t.exr"))[0]["width"], 8)
        self.assertFalse(os.path.exists(self.path("out/light.exr")))
        # and the file goes back in
        again = self.json_cli("fit", "scene.json", "--param", "h=@out/h.exr", "--param", "t=@out/t.exr", "--iters", 0)
        self.assertEqual(again["params"]["h"], j["params"]["h"])

    def test_command_line_wins(self):
        """Over rates and smoothing of the scene, not on top of them."""
        def fitted(h, *options):
            self.scene(params={"t": {"grad": True, "lr": 0.02}, "h": {"grad": True, **h}}, optimizer={"iters": 5})
            return self.json_cli("fit", "scene.json", *options)["params"]

        want = fitted({"lr": 0.01, "smooth": 3})
        self.assertEqual(fitted({"lr": 0.05, "smooth": 2}, "--lr", "h=0.01", "--smooth", "h=3"), want)
        self.assertEqual(fitted({"lr": 0.01, "smooth": 2}, "--lr", "0.5", "--smooth", "h=3"), want)  # t and h have their own
        self.assertNotEqual(fitted({"lr": 0.01, "smooth": 2}), want)

    def test_mask(self):
        """0 holds to the bit, also under a Laplacian; 0.5 is slower."""
        mask = [0.0 if x < 4 else 1.0 for y in range(9) for x in range(9)]
        self.put("m.npy", write_npy((9, 9, 1), mask))
        self.put("h0.npy", write_npy((9, 9, 1), [0.125 * i for i in range(81)]))
        params = {"t": {"grad": False}, "h": {"file": "h0.npy", "mask": "m.npy", "smooth": 3, "grad": True}}
        r = self.scene(params=params)
        self.assertEqual(r.code, 0, r.err)
        h = r.json["params"]["h"]
        for y in range(9):
            for x in range(9):
                (self.assertEqual if x < 4 else self.assertNotEqual)(h[y][x], 0.125 * (9 * y + x))
        self.put("m.npy", write_npy((9, 9, 1), [0.5 if x < 4 else 1.0 for y in range(9) for x in range(9)]))
        h = self.scene(params={"t": {"grad": False}, "h": {"mask": "m.npy", "grad": True, "lr": 0.01}}, optimizer={"iters": 2}).json["params"]["h"]
        self.assertAlmostEqual(h[4][1], 0.005, delta=1e-6)
        self.assertAlmostEqual(h[4][6], 0.01, delta=1e-6)
        for shape, value, code in (((8, 9, 1), 1.0, 4), ((9, 9, 1), -1.0, 4), ((9, 9, 1), float("nan"), 4)):
            self.put("m.npy", write_npy(shape, [value] * (shape[0] * shape[1])))
            self.assertEqual(self.scene(params=params).code, code)
        self.assertEqual(self.scene(params={"h": {"mask": "none.npy"}}).code, 4)

    def test_views_with_files(self):
        """A view's texture from a file, seen by that view alone; a mask on a target."""
        self.put("l.npy", write_npy((2, 2, 1), [1.0] * 4))
        self.put("m.npy", write_npy((16, 16, 1), [1.0] * 128 + [0.0] * 128))
        views = [{"target": "one.npy"}, {"target": "two.npy", "params": {"light": {"file": "l.npy"}}}]
        r = self.scene(views=views)
        self.assertEqual(r.code, 0, r.err)
        self.assertLess(r.json["loss"], 1e-3)
        self.assertEqual(r.json["params"]["light"], [[0, 0], [0, 0]])
        r = self.scene(views=[{"target": "one.npy", "mask": "m.npy"}], params={"t": {"grad": True, "lr": 0.05}})
        self.assertEqual(r.code, 0, r.err)
        t = r.json["params"]["t"]
        self.assertTrue(all(abs(v - 1) < 0.1 for row in t[:3] for v in row), t)
        self.assertTrue(all(v == 0 for row in t[5:] for v in row), t)
        self.assertEqual(self.scene(views=[{"target": "one.npy", "params": {"h": {"file": "l.npy"}}}]).code, 4)  # optimised, and of another size
        self.assertEqual(self.scene(views=[{"target": "one.npy", "params": {"light": {"file": "none.npy"}}}]).code, 4)

    def test_file_decides_the_size(self):
        self.put("big.npy", write_npy((5, 7, 1), [0.25] * 35))
        j = self.scene(params={"h": {"file": "big.npy", "grad": True}}, optimizer={"iters": 1}).json
        self.assertEqual((len(j["params"]["h"]), len(j["params"]["h"][0])), (5, 7))

    def test_two_floats(self):
        """Two outlines that meet in a box of two floats by one: its longer side cannot be cut, and the other one is."""
        self.put("s.salt", """param float2 at[2] = {float2(0.32783165258793406, 5.224420316292058), float2(0.889050670179403, 5.8926263365138745)};
            param float r[2] = {0.6617347606050976, 0.561849752170844}; param float o[2] = {0.8975985380620104, 0.8830958923406742};
            [Domain(float2(0.0, 0.0), float2(9.0, 6.0))] shader float main(float2 x) {
                float c = 0.2;
                for (int i = 0; i < 2; i++) [Disc] if (length(x - at[i]) < r[i]) c = lerp(c, 0.01 + 0.01 * i, o[i]);
                return c;
            }""")
        self.put("t.pfm", write_pfm(240, 160, 1, [0.3] * (240 * 160)))
        j = self.json_cli("grad", "s.salt", "--target", "t.pfm", "--size", "240x160", "--spp", 4, "--interior", "quadrature", "--threads", 1)
        self.assertLess(j["evaluations"], 10000000)

    def test_heights_from_files(self):
        """Every format, in the source and on the command line: linear, raw, row 0 at the top."""
        w, rows = 3, [[0, 1000, 65535], [17, 300, 40000], [5, 6, 7]]
        def png(depth):
            raw = b"".join(b"\0" + b"".join(struct.pack(">H" if depth == 16 else "B", v if depth == 16 else v >> 8) for v in r) for r in rows)
            def chunk(k, b):
                return struct.pack(">I", len(b)) + k + b + struct.pack(">I", zlib.crc32(k + b))
            return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 3, 3, depth, 0, 0, 0, 0)) + chunk(b"IDAT", zlib.compress(raw)) + chunk(b"IEND", b"")
        flat = [float(v) for r in rows for v in r]
        signed = [[v if v < 32768 else v - 65536 for v in r] for r in rows]
        files = {"a.png": (png(16), lambda v: v / 65535), "b.png": (png(8), lambda v: (v >> 8) / 255), "a.npy": (write_npy((3, 3), flat, "<f4"), float), "a_3x3.f32": (struct.pack("<9f", *flat), float),
                 "a.exr": (write_exr(3, 3, {"Y": [[float(v) for v in r] for r in rows]}), float), "N01W002.hgt": (b"".join(struct.pack(">3h", *r) for r in signed), lambda v: v if v < 32768 else v - 65536),
                 "a.pfm": (write_pfm(3, 3, 1, flat), float)}
        for name, (data, value) in files.items():
            self.put(name, data)
            for source, args in (('"%s"' % name, []), ("zeros(2, 2)", ["--param", "h=@" + name])):
                self.put("f.salt", "param heightfield h = %s;\nshader float main(float2 x) { return h.height(x); }\n" % source)
                j = self.json_cli("fit", "f.salt", "--minimize", "--iters", 0, *args)
                for y in range(w):
                    for x in range(w):
                        self.assertEqual(f32(j["params"]["h"][y][x]), f32(value(rows[y][x])), (name, source, x, y))
            j = self.json_cli("render", "f.salt", "--param", "h=@" + name, "--size", 64, "--spp", 1)
            self.assertEqual(j["channels"], 1)
        for name, data in (("bad.hgt", b"xxx"), ("void.hgt", b"\x80\0" * 9), ("bad_4x4.f32", b"1234"), ("noname.f32", b"1234"), ("bad.png", b"\x89PNG"), ("nan.npy", write_npy((3, 3), [float("nan")] * 9)),
                           ("inf_3x3.f32", struct.pack("<9f", *([1.0] * 8 + [float("inf")]))), ("line.npy", write_npy((1, 9), flat)), ("none.exr", None)):
            if data is not None:
                self.put(name, data)
            self.put("f.salt", "param heightfield h = zeros(3, 3);\nshader float main(float2 x) { return h.height(x); }\n")
            self.assertIn(name, self.run_cli("render", "f.salt", "--param", "h=@" + name, "--size", 4, code=4).err)
            self.put("f.salt", 'param heightfield h = "%s";\nshader float main(float2 x) { return h.height(x); }\n' % name)
            self.assertIn(name, self.run_cli("render", "f.salt", "--size", 4, code=4).err)
        self.put("p.json", json.dumps({"h": [[0.5, 1], [2, 3]]}))
        self.put("f.salt", "param heightfield h = zeros(2, 2);\nshader float main(float2 x) { return h.height(x); }\n")
        j = self.json_cli("fit", "f.salt", "--params", "p.json", "--minimize", "--iters", 0)
        self.assertEqual(j["params"]["h"], [[0.5, 1], [2, 3]])
        # rows as JSON, bare or in a file of fit, also of another size; a file named in JSON
        for text in ([[1, 2, 3], [4, 5, 6]], {"h": [[1, 2, 3], [4, 5, 6]], "other": 3}):
            self.put("r.json", json.dumps(text))
            j = self.json_cli("fit", "f.salt", "--param", "h=@r.json", "--minimize", "--iters", 0)
            self.assertEqual(j["params"]["h"], [[1, 2, 3], [4, 5, 6]])
        self.put("d/p.json", json.dumps({"h": {"file": "two.npy"}}))
        self.put("d/two.npy", write_npy((2, 2), [1.0, 2.0, 3.0, 4.0]))
        self.assertEqual(self.json_cli("fit", "f.salt", "--params", "d/p.json", "--minimize", "--iters", 0)["params"]["h"], [[1, 2], [3, 4]])
        for bad in ([1, 2], [], {"k": [[1]]}, [["a"]], [[1, 2], [3]], {"h": {"file": "none.npy"}}):
            self.put("r.json", json.dumps(bad))
            self.assertIn("r.json", self.run_cli("render", "f.salt", "--param", "h=@r.json", "--size", 4, code=4).err)
            self.run_cli("render", "f.salt", "--params", "r.json", "--size", 4, code=4)


if __name__ == "__main__":
    unittest.main()
