"""Open arrays whose length values decide, and fits in rounds, between which a program changes the parameters."""
from harness import *

DISCS = """
struct Disc { float2 c; float r; };
param Disc discs[] = { { float2(0.3, 0.3), 0.1 }, { float2(0.7, 0.7), 0.1 } };
param float gain = 1.0;
param float w[][2] = "w.csv";
shader float main(float2 x) {
    float f = 0.0;
    for (int i = 0; i < len(discs); i++) { [Disc] if (length(x - discs[i].c) < discs[i].r) f += gain; }
    return f + w[0][1] * len(w);
}
"""
PI = 3.14159265


class Lengths(Case):
    def setUp(self):
        super().setUp()
        self.put("d.salt", DISCS)
        self.put("w.csv", "0,0\n0,0\n")
        self.three = [{"c": [0.5, 0.5], "r": 0.2}, {"c": [0.1, 0.1], "r": 0.05}, {"c": [0.9, 0.1], "r": 0.05}]

    def integral(self, values, *args, code=0):
        self.put("p.json", json.dumps(values))
        r = self.run_cli("render", "d.salt", "--integral", "--json", "--params", "p.json", *args, code=code)
        return r.err if code else r.json["integral"][0]

    def test_params_give_lengths(self):
        area = PI * (0.04 + 2 * 0.0025)
        self.assertAlmostEqual(self.integral({"discs": self.three}), area, delta=1e-4)
        self.assertAlmostEqual(self.integral({"discs": self.three, "w": [[5, 1]] * 7}), area + 7, delta=1e-4)
        self.assertAlmostEqual(self.integral({"gain": 2}), 2 * 2 * PI * 0.01, delta=1e-4)
        self.put("one.json", json.dumps([self.three[0]]))
        self.assertAlmostEqual(self.integral({"gain": 2}, "--param", "discs=@one.json"), 2 * PI * 0.04, delta=1e-4)
        g = self.run_cli("grad", "d.salt", "--integral", "--wrt", "discs[2].r", "--params", "p.json", code=2).err
        self.assertIn("discs[2]", g)
        self.put("p.json", json.dumps({"discs": self.three}))
        g = self.run_cli("grad", "d.salt", "--integral", "--wrt", "discs", "--params", "p.json", "--json").json["gradient"]["discs"]
        self.assertEqual(len(g), 3)
        self.assertAlmostEqual(g[0]["r"], 2 * PI * 0.2, delta=1e-4)

    def test_bad_values(self):
        self.assertIn("at least one element", self.integral({"discs": []}, code=4))
        self.assertIn("discs[0]", self.integral({"discs": [1, 2]}, code=4))
        self.assertIn("discs[1].c", self.integral({"discs": [self.three[0], {"c": [1], "r": 1}]}, code=4))
        self.assertIn("w[2]", self.integral({"w": [[1, 2], [1, 2], [1]]}, code=4))
        self.put("p.json", '{"discs": [')
        self.assertIn("p.json:1:", self.run_cli("render", "d.salt", "--integral", "--params", "p.json", code=4).err)
        # The program's own errors come first.
        self.put("bad.salt", "shader float main(float2 x) { return y; }")
        self.run_cli("render", "bad.salt", "--params", "missing.json", code=3)
        self.assertIn("missing.json", self.run_cli("render", "d.salt", "--params", "missing.json", code=4).err)


SPOTS = """
struct Disc { float2 c; float r; float ink; };
param Disc discs[] = { { float2(0.4, 0.4), 0.2, 0.5 } };
[NoDiff] param float gain = 1.0;
param float floor[2] = { 0.05, 0.0 };
float spots(float2 x) {
    float f = floor[0] + floor[1] * 2.0;
    for (int i = 0; i < len(discs); i++) { [Disc] if (length(x - discs[i].c) < discs[i].r) f = discs[i].ink; }
    return gain * f;
}
shader float main(float2 x) { return spots(x); }
shader float dim(float2 x) { return 0.5 * spots(x); }
"""
# What stands between two rounds. MODE is what it does, WHEN in which round.
PROGRAM = """
import json, os, sys, time
mode, when = sys.argv[1], int(sys.argv[2])
q = json.load(sys.stdin)
p = q["params"]
if q["round"] == when:
    if mode == "die": sys.exit(7)
    if mode == "late": json.dump(q, sys.stdout); sys.stdout.flush(); os._exit(3)
    if mode == "kill": os.kill(os.getpid(), 9)
    if mode == "hang": open("hangs", "w").write(str(os.getpid())); time.sleep(600)
    if mode == "words": print("hello")
    if mode == "list": print([1])
    if mode == "none": print('{"discs": []}')
    if mode == "tell": print('{"error": "no more discs"}')
    if mode == "quiet": sys.exit(0)
    if mode == "empty": p["discs"] = []
    if mode == "fixed": p["floor"] = [1, 2, 3]
    if mode == "shape": p["discs"][0]["c"] = 3
    if mode == "twice": p["discs"] = [p["discs"][0], {"c": [0.5, 0.5]}]
    if mode == "unknown": p["disks"] = p["discs"]
    if mode in ("words", "list", "none", "tell"): sys.exit(0)
if mode == "grow" and len(p["discs"]) < 3: p["discs"].append(dict(p["discs"][0], c=[0.68, 0.64]))
if mode == "part": q["params"] = {"discs": p["discs"] + [dict(p["discs"][0], c=[0.68, 0.64])]}
if mode == "log":
    views = q.pop("views")
    for v in views:
        for key, path in v.items():
            v[key] = path and list(open(path, "rb").read())
    with open("log", "a") as f: f.write(json.dumps(dict(q, seen=views)) + "\\n")
json.dump(q, sys.stdout)
"""


class Rounds(Case):
    def setUp(self):
        super().setUp()
        self.put("s.salt", SPOTS)
        self.put("round.py", PROGRAM)
        self.put("truth.json", json.dumps({"discs": [{"c": [0.3, 0.3], "r": 0.15, "ink": 0.9}, {"c": [0.7, 0.6], "r": 0.2, "ink": 0.6}], "floor": [0.1, 0.0]}))
        self.run_cli("render", "s.salt", "--params", "truth.json", "--size", 24, "--spp", 64, "-o", "t.exr")
        os.mkdir(self.path("tmp"))

    def command(self, mode, when=1):
        return "exec %s round.py %s %d" % (sys.executable, mode, when)

    def fit(self, *args, mode="grow", when=1, iters=(60, 30), command=None, **kw):
        return self.run_cli("fit", "s.salt", "--target", "t.exr", "--size", 24, "--spp", 8, "--iters", iters[0], "--round-iters", iters[1], "--round-command",
                            command or self.command(mode, when), *args, env={"TMPDIR": self.path("tmp")}, **kw)

    def tearDown(self):
        self.assertEqual(os.listdir(self.path("tmp")), [])  # what the program could read is gone
        super().tearDown()

    def test_grows(self):
        alone = self.run_cli("fit", "s.salt", "--target", "t.exr", "--size", 24, "--spp", 8, "--iters", 120, "--json").json
        self.assertNotIn("rounds", alone)
        j = self.fit("--json", "--threads", 1, iters=(120, 40)).json
        self.assertEqual((j["rounds"], j["iterations"], len(j["losses"]), len(j["params"]["discs"])), (3, 120, 120, 3))
        self.assertEqual(j["initial_loss"], alone["initial_loss"])
        self.assertEqual(j["losses"][:40], alone["losses"][:40])
        self.assertLess(j["loss"], 0.05 * alone["loss"])
        again = self.fit("--json", "--threads", 3, iters=(120, 40)).json
        j.pop("seconds"), again.pop("seconds")
        self.assertEqual(again, j)
        r = self.fit("-o", "out", "--frames", 10)
        self.assertIn("round 1: loss", r.err)
        self.assertIn("discs 1 -> 2", r.err)
        self.assertEqual(self.get("out/loss.csv").count(b"\n"), 61)
        self.assertEqual(len(os.listdir(self.path("out/frames"))), 60 // 10 + 2)
        self.assertEqual(self.get("out/loss.svg").count(b"stroke-dasharray"), 1)  # where the program was
        self.assertEqual(len(json.loads(self.get("out/fitted.json"))["discs"]), 2)
        self.run_cli("render", "s.salt", "--params", "out/fitted.json", "--size", 4, "-o", "a.png")

    def test_question(self):
        self.fit("-o", "p.json", mode="log", iters=(12, 5))
        log = [json.loads(line) for line in self.get("log").splitlines()]
        self.assertEqual([(q["round"], q["iteration"], q["iterations"]) for q in log], [(1, 5, 12), (2, 10, 12)])  # and none behind the last
        for q in log:
            (view,) = q["seen"]
            self.assertIsNone(view["mask"])
            shape, image = read_npy(bytes(view["image"]))
            self.assertEqual(shape, (24, 24, 1))
            _, target = read_npy(bytes(view["target"]))
            loss = sum((a - b) ** 2 for a, b in zip(image, target)) / 576
            self.assertAlmostEqual(loss, q["loss"], delta=0.1 * loss)
            self.put("q.json", json.dumps(q["params"]))
            self.run_cli("render", "s.salt", "--params", "q.json", "--size", 24, "--spp", 256, "-o", "q.npy")
            self.assertLess(sum((a - b) ** 2 for a, b in zip(image, read_npy(self.get("q.npy"))[1])) / 576, 1e-3)
            self.assertEqual(set(q["slopes"]), {"discs", "floor"})  # of what is differentiated
            self.assertGreater(min(q["slopes"]["discs"][0]["c"]), 0)

    def test_slopes_are_means(self):
        """f = a: the loss is (a - t)^2, its slope 2 |a - t|, by SGD with a rate of 0."""
        self.put("s.salt", "param float a = 0.75; param float b = 0.5; shader float main(float2 x) { return a + 0.0 * b; }")
        self.put("t.pfm", write_pfm(4, 4, 1, [0.5] * 16))
        self.run_cli("fit", "s.salt", "--target", "t.pfm", "--wrt", "a", "--lr", "0", "--optimizer", "sgd", "--iters", 9, "--round-iters", 4, "--round-command", self.command("log"), "--json")
        q = json.loads(self.get("log").splitlines()[0])
        self.assertAlmostEqual(q["slopes"]["a"], 0.5, delta=1e-4)
        self.assertEqual(q["slopes"]["b"], 0)

    def test_leaves_out(self):
        """A parameter that the answer does not have keeps its value, also where the shader is compiled again."""
        j = self.fit("--json", "--lr", "floor=0,discs=0", "--param", "gain=0.5", "--param", "floor=0.25,0.5", mode="part", iters=(20, 10)).json
        self.assertEqual((j["params"]["gain"], j["params"]["floor"], len(j["params"]["discs"])), (0.5, [0.25, 0.5], 2))

    def test_scene(self):
        scene = {"shader": "s.salt", "size": [24, 24], "spp": 8, "params": {"floor": {"grad": False}, "discs": {"file": "start.json", "lr": 0.02}},
                 "views": [{"target": "t.exr"}, {"entry": "dim", "target": {"shader": "s.salt", "entry": "dim", "params": {"discs": {"file": "truth.json"}, "floor": [0.1, 0]}}}],
                 "optimizer": {"iters": 40, "schedule": "cosine"}, "rounds": [{"iters": 10, "command": self.command("grow")}, {"iters": 20, "command": self.command("part"), "timeout": 100}]}
        for name in ("s.salt", "t.exr", "round.py", "truth.json"):
            with open(self.path(name), "rb") as a, open(self.path(os.path.join(os.makedirs(self.path("d"), exist_ok=True) or "d", name)), "wb") as b:
                b.write(a.read())
        self.put("d/start.json", json.dumps([{"c": [0.4, 0.4], "r": 0.2, "ink": 0.5}, {"c": [0.6, 0.6], "r": 0.1, "ink": 0.5}]))
        def fit(*args, code=0):
            self.put("d/scene.json", json.dumps(scene))
            return self.run_cli("fit", "d/scene.json", *args, code=code, env={"TMPDIR": self.path("tmp")})
        for refused in ((), ("--sandbox",), ("--sandbox", "--allow-commands")):  # nothing is started that was not asked for
            fit(*refused, code=4)
        j = fit("--allow-commands", "--json").json  # the commands run in the scene's folder
        self.assertEqual((j["rounds"], len(j["params"]["discs"]), j["iterations"]), (3, 4, 40))
        self.assertEqual([f32(v) for v in j["params"]["floor"]], [f32(0.05), 0])
        self.assertLess(j["loss"], 0.3 * j["initial_loss"])
        self.assertEqual(fit("--round-iters", 100, "--round-command", "false", "--json").json["rounds"], 1)  # the command line wins
        scene["rounds"] = {"iters": 10, "command": self.command("grow")}
        self.assertEqual(fit("--allow-commands", "--json").json["rounds"], 4)
        for bad, text in (({"iters": 5}, "`command` is missing"), ({"command": "x"}, "`iters` is missing"), ({"iters": 5, "command": ""}, "missing"), ({"iters": 0, "command": "x"}, "1 to"),
                          ([{"iters": 5, "comand": "x"}], "did you mean `command`"), ([3], "wanted"), ("x", "wanted"), ({"iters": 5, "command": "x", "timeout": 0}, "timeout")):
            scene["rounds"] = bad
            self.assertIn(text, fit("--allow-commands", code=4).err)

    def test_failures(self):
        """Status, text, and what the round before had made is written."""
        for mode, code, text in (("die", 1, "ended with status 7 without an answer"), ("late", 1, "status 3 behind its answer"), ("kill", 1, "signal 9"), ("words", 1, "hello"), ("list", 1, "is wanted"),
                                 ("none", 1, '{"params": {...}} is wanted'), ("tell", 1, "says: no more discs"), ("quiet", 1, "answered ``"), ("empty", 1, "at least one element"),
                                 ("fixed", 1, "`floor` should be a list of 2"), ("shape", 1, "discs[0].c"), ("twice", 1, "discs[1]"), ("unknown", 1, "disks")):
            for when in (1, 2) if mode in ("die", "fixed") else (2,):
                r = self.fit("-o", "p.json", mode=mode, when=when, iters=(9, 3), code=code)
                self.assertIn(text, r.err, mode)
                self.assertIn("%d iterations" % (3 * when), r.out)
                self.assertIn("(failed)", r.out)
                self.assertEqual(len(json.loads(self.get("p.json"))["discs"]), 1, mode)
                os.remove(self.path("p.json"))
        r = self.fit(mode="grow", iters=(9, 3), code=1, command="exec /nonexistent/program")
        self.assertIn("status 127", r.err)
        self.assertIn("--round-iters", self.run_cli("fit", "s.salt", "--target", "t.exr", "--round-command", "x", code=2).err)
        self.assertIn("checkpoint", self.fit("--checkpoint", "c.bin", code=2).err)

    def test_what_it_leaves(self):
        """A round that cannot begin leaves the one before it."""
        r = self.fit("-o", "p.json", "--wrt", "discs[1].c,floor", "--param", "discs=@two.json", iters=(9, 3), code=4)
        self.put("two.json", '[{"c": [0.4, 0.4], "r": 0.2, "ink": 0.5}, {"c": [0.6, 0.6], "r": 0.2, "ink": 0.5}]')
        self.put("one.py", "import json, sys; q = json.load(sys.stdin); del q['params']['discs'][1]; json.dump(q, sys.stdout)")
        r = self.fit("-o", "p.json", "--wrt", "discs[1].c,floor", "--param", "discs=@two.json", iters=(9, 3), command="exec %s one.py" % sys.executable, code=1)
        self.assertIn("discs[1]", r.err)
        self.assertEqual(len(json.loads(self.get("p.json"))["discs"]), 2)

    def test_reads_nothing(self):
        """A program need not read what it gets; and neither way does a full pipe stop the other."""
        many = [{"c": [0.1 + 0.0001 * k, 0.5], "r": 0.01, "ink": 0.5} for k in range(5000)]
        self.put("many.json", json.dumps({"params": {"discs": many}}))
        self.put("start.json", json.dumps(many[:4000]))
        r = self.fit("--json", "--param", "discs=@start.json", iters=(2, 1), command="cat many.json")
        self.assertEqual(len(r.json["params"]["discs"]), 5000)
        # What it warns of may be of the shader as it was before the round, which is gone.
        told = [json.loads(line) for line in r.err.splitlines()]
        self.assertIn("coincident", [w["code"] for w in told])
        for w in told:
            self.assertTrue(w["uri"].endswith("/s.salt"), w)
            self.assertIn("`length(x - discs[i].c) < discs[i].r`", w["message"])

    def test_interrupt_and_time(self):
        for stop in ("signal", "--max-seconds", "timeout"):
            if stop == "timeout":
                scene = {"shader": "s.salt", "size": [24, 24], "target": "t.exr", "optimizer": {"iters": 9}, "rounds": {"iters": 3, "command": self.command("hang"), "timeout": 3}, "output": "p.json"}
                self.put("scene.json", json.dumps(scene))
                r = self.run_cli("fit", "scene.json", "--allow-commands", code=6, env={"TMPDIR": self.path("tmp")})
                self.assertIn("did not answer within 3 s", r.err)
            elif stop == "--max-seconds":
                self.fit("-o", "p.json", stop, 8, mode="hang", iters=(9, 3), code=6)
            else:
                p = self.start_cli("fit", "s.salt", "--target", "t.exr", "--size", 24, "--iters", 9, "--round-iters", 3, "--round-command", self.command("hang"), "-o", "p.json", env={"TMPDIR": self.path("tmp")})
                while not os.path.exists(self.path("hangs")):
                    time.sleep(0.02)
                p.send_signal(signal.SIGINT)
                out, err = p.communicate(timeout=HANGS)
                self.assertEqual(p.returncode, 130, err)
            self.assertEqual(len(json.loads(self.get("p.json"))["discs"]), 1)
            while os.path.exists("/proc/%s/cmdline" % self.get("hangs")):  # no orphan
                time.sleep(0.02)
            os.remove(self.path("hangs")), os.remove(self.path("p.json"))

    def test_other_fits(self):
        with open(self.path("s.salt"), "rb") as f:
            source = f.read()
        j = self.run_cli("fit", "-", "--minimize", "--iters", 4, "--round-iters", 2, "--samples", 4096, "--round-command", self.command("grow"), "--json", stdin=source).json
        self.assertEqual((j["rounds"], len(j["params"]["discs"])), (2, 2))
        j = self.fit("--json", "--optimizer", "lbfgs", "--loss", "huber", iters=(40, 20)).json
        self.assertLess(j["loss"], 0.2 * j["initial_loss"])


if __name__ == "__main__":
    unittest.main()
