"""saltus fit: optimisers, checkpoints, interrupts, scenes; and build: the object linked into a C program."""
import math

from harness import *

EDGE = """
param float r = 0.3;
param float2 c = float2(0.45, 0.55);
shader float main(float2 x) {
    float f = 0.0;
    [Disc] if (length(x - c) < r) f = 1.0;
    return f;
}
"""
BOWL = "param float a = 0.1;\n[Range(0.0, 0.6)] param float b = 0.2;\nshader float main(float2 x) { return (a - 0.75) * (a - 0.75) + (b - 0.9) * (b - 0.9) + 0.0 * x.x; }\n"
KEYS = {"initial_loss", "loss", "losses", "iterations", "seconds", "stopped", "params", "outputs"}


class Fit(Case):
    def setUp(self):
        super().setUp()
        self.put("e.salt", EDGE)
        self.run_cli("render", "e.salt", "--size", 32, "--spp", 64, "--param", "r=0.2", "--param", "c=0.5,0.5", "-o", "t.exr")

    def test_optimisers(self):
        for name, iters, lr in (("adam", 40, "0.01"), ("sgd", 40, "0.05"), ("lbfgs", 15, None)):
            j = self.json_cli("fit", "e.salt", "--target", "t.exr", "--optimizer", name, "--iters", iters, *(["--lr", lr] if lr else []), "--spp", 16)
            self.assertLessEqual(KEYS, set(j))
            self.assertLess(j["loss"], 0.3 * j["initial_loss"], name)
            self.assertEqual(j["iterations"], len(j["losses"]))
            self.assertEqual(j["losses"][0], j["initial_loss"])
            self.assertIn(j["stopped"], ("iters", "converged"))
            self.assertEqual(j["outputs"], [])
            self.assertAlmostEqual(j["params"]["r"], 0.2, delta=0.05)

    def test_minimize_and_ranges(self):
        self.put("b.salt", BOWL)
        for name in ("adam", "lbfgs"):
            j = self.json_cli("fit", "b.salt", "--minimize", "--optimizer", name, "--iters", 200, "--lr", "0.05", "--samples", 1024)
            self.assertAlmostEqual(j["params"]["a"], 0.75, delta=0.02)
            self.assertAlmostEqual(j["params"]["b"], 0.6, delta=1e-6)  # the edge of its range
            self.assertAlmostEqual(j["loss"], 0.09, delta=2e-3)
        j = self.json_cli("fit", "b.salt", "--minimize", "--iters", 5, "--lr", "a=0.1,b=0", "--samples", 256)
        self.assertEqual(f32(j["params"]["b"]), f32(0.2))
        j = self.json_cli("fit", "b.salt", "--minimize", "--iters", 5, "--wrt", "b", "--samples", 256)
        self.assertEqual(f32(j["params"]["a"]), f32(0.1))
        self.run_cli("fit", "b.salt", code=2)
        self.run_cli("fit", "b.salt", "--minimize", "--target", "t.exr", code=2)
        self.run_cli("fit", "b.salt", "--minimize", "--lr", "q=1", code=2)
        for option in "--lr", "--smooth":
            self.assertIn("`-3` is not a number from 0 to 1e30", self.run_cli("fit", "b.salt", "--minimize", option, "a=-3", code=2).err)

    def test_rate_that_changes_nothing(self):
        self.put("b.salt", BOWL)
        args = ("fit", "b.salt", "--minimize", "--iters", 2, "--samples", 64)
        self.assertIn("--lr 0.5 changes nothing", self.run_cli(*args, "--lr", "0.5,a=0.1,b=0.1").err)
        self.assertIn("--lr 0.5 changes nothing", self.run_cli(*args, "--lr", "0.5,a=0.1", "--wrt", "a").err)
        self.assertEqual(self.run_cli(*args, "--lr", "0.5,a=0.1").err, "")
        self.assertEqual(self.run_cli(*args, "--lr", "a=0.1,b=0.1").err, "")
        self.put("scene.json", json.dumps({"shader": "b.salt", "minimize": True, "params": {"a": {"lr": 0.1}, "b": {"lr": 0.1}}, "optimizer": {"iters": 2, "lr": 0.3}}))
        self.assertIn("--lr 0.5 changes nothing", self.run_cli("fit", "scene.json", "--lr", "0.5", "--samples", 64).err)
        self.assertEqual(self.run_cli("fit", "scene.json", "--samples", 64).err, "")

    def test_nothing_moves(self):
        """A fit that no parameter can reach says so; one that is at its target does not."""
        shader = "param float r = %s; shader float main(float2 x) { float f = 0.0; %s if (length(x - 0.5) < r) f = 1.0; return f; }"
        self.put("d.salt", shader % ("0.3", "[Disc]"))
        self.run_cli("render", "d.salt", "--size", 16, "--spp", 64, "-o", "t.exr")
        args = ("--target", "t.exr", "--iters", 3)
        for begin, tag in (("-0.3", "[Disc]"), ("0.2", "[NoDisc]")):
            self.put("n.salt", shader % (begin, tag))
            self.assertIn("nothing moved", self.run_cli("fit", "n.salt", *args).err)
        self.assertNotIn("nothing moved", self.run_cli("fit", "d.salt", *args, "--param", "r=0.25").err)
        self.put("k.salt", "param float a = 0.5; shader float main(float2 x) { return a; }")
        self.run_cli("render", "k.salt", "--size", 4, "-o", "k.exr")
        self.assertEqual(self.run_cli("fit", "k.salt", "--target", "k.exr", "--iters", 2).err, "")

    def test_seeds(self):
        args = ("fit", "e.salt", "--target", "t.exr", "--iters", 6)
        alone = [self.json_cli(*args, "--seed", k)["loss"] for k in (2, 3, 4, 5)]
        j = self.json_cli(*args, "--seeds", "2..5", "-o", "out")
        self.assertEqual((j["seeds"], j["losses"]), ([2, 5], alone))
        self.assertEqual((j["least"], j["most"], j["median"]), (min(alone), max(alone), sum(sorted(alone)[1:3]) / 2))
        r = self.run_cli(*args, "--seeds", 3, "-o", "out")
        self.assertIn("the median of 3 seeds", r.out)
        self.assertEqual(r.err.count("saltus: seed"), 3)
        self.assertFalse(os.path.exists(self.path("out")))  # nothing is written
        self.put("scene.json", json.dumps({"shader": "e.salt", "target": "t.exr", "seed": 9, "params": {"r": {"lr": 0.02}}, "optimizer": {"iters": 6}, "output": "out"}))
        two = self.json_cli("fit", "scene.json", "--seeds", "1..2")["losses"]
        self.assertEqual(two, [self.json_cli("fit", "scene.json", "--seed", k, "-o", "p.json")["loss"] for k in (1, 2)])
        for bad in ("0", "5..2", "x", "1..", "1...3", "0..3", "1..2000"):
            self.run_cli(*args, "--seeds", bad, code=2)
        self.run_cli(*args, "--seeds", "2", "--checkpoint", "c.bin", code=2)
        self.run_cli("fit", "e.salt", "--target", "missing.exr", "--seeds", "2", code=4)

    def test_same_bits_again(self):
        args = ["fit", "e.salt", "--target", "t.exr", "--iters", 6, "--seed", 4]
        runs = []
        for t in (1, 2, 5):
            j = self.json_cli(*args, "--threads", t)
            j.pop("seconds")
            runs.append(json.dumps(j))
        self.assertEqual(len(set(runs)), 1)

    def test_parameters_round_trip(self):
        """What fit writes, --params reads to the same bits."""
        j = self.json_cli("fit", "e.salt", "--target", "t.exr", "--iters", 3, "-o", "p.json")
        self.assertEqual(j["outputs"], ["p.json"])
        self.assertEqual(json.loads(self.get("p.json")), j["params"])
        again = self.json_cli("fit", "e.salt", "--params", "p.json", "--target", "t.exr", "--iters", 0)
        self.assertEqual(again["params"], j["params"])
        self.run_cli("fit", "e.salt", "--params", "p.json", "--target", "t.exr", "--iters", 0, "-o", "q.json")
        self.assertEqual(self.get("p.json"), self.get("q.json"))
        j = self.json_cli("fit", "e.salt", "--precision", "f64", "--target", "t.exr", "--iters", 3, "-o", "p.json")
        self.run_cli("fit", "e.salt", "--precision", "f64", "--params", "p.json", "--target", "t.exr", "--iters", 0, "-o", "q.json")
        self.assertEqual(self.get("p.json"), self.get("q.json"))

    def test_folder(self):
        self.json_cli("fit", "e.salt", "--target", "t.exr", "--iters", 4, "-o", "out")
        files = os.listdir(self.path("out"))
        self.assertIn("fitted.json", files)
        self.assertIn("image.exr", files)
        self.assertTrue(any("loss" in f for f in files) and any("strip" in f for f in files))
        self.assertEqual(len(self.get("out/loss.csv").splitlines()), 5)
        self.run_cli("fit", "e.salt", "--target", "t.exr", "--iters", 1, "-o", "e.salt/x", code=5)
        self.run_cli("fit", "e.salt", "--target", "t.exr", "--iters", 1, "-o", "no/p.json", code=5)
        self.run_cli("fit", "e.salt", "--target", "none.exr", code=4)

    def strip(self, j):
        j.pop("seconds"), j.pop("evaluations")
        j.pop("outputs")
        return j

    def test_resume(self):
        for name in ("adam", "sgd", "lbfgs"):
            args = ["fit", "e.salt", "--target", "t.exr", "--optimizer", name, "--seed", 3]
            whole = self.strip(self.json_cli(*args, "--iters", 12))
            self.json_cli(*args, "--iters", 5, "--checkpoint", "c.bin", "--every", 2)
            broken = self.strip(self.json_cli(*args, "--iters", 12, "--resume", "c.bin"))
            self.assertEqual(broken, whole, name)
        self.put("c.bin", self.get("c.bin")[:50])
        self.run_cli("fit", "e.salt", "--target", "t.exr", "--optimizer", "lbfgs", "--resume", "c.bin", code=4)
        self.run_cli("fit", "e.salt", "--target", "t.exr", "--resume", "none.bin", code=4)

    def test_killed(self):
        args = ["fit", "e.salt", "--target", "t.exr", "--size", 64, "--spp", 64, "--seed", 3, "--threads", 1, "--iters", 60]
        whole = self.strip(self.json_cli(*args))
        p = self.start_cli(*args, "--checkpoint", "c.bin", "--every", 1)
        start = time.time()
        while not os.path.exists(self.path("c.bin")) and time.time() - start < HANGS:
            time.sleep(0.005)
        p.kill()
        p.communicate()
        self.assertEqual(p.returncode, -signal.SIGKILL, "it was over before it could be killed")
        self.assertEqual(self.strip(self.json_cli(*args, "--resume", "c.bin")), whole)

    def test_interrupted(self):
        p = self.start_cli("fit", "e.salt", "--target", "t.exr", "--size", 128, "--iters", 100000, "-o", "p.json", "--json", "--lr", "0.003")
        out, err = self.interrupt(p, after=2.0)
        j = json.loads(out)
        self.assertEqual(j["stopped"], "interrupted")
        self.assertEqual(j["iterations"], len(j["losses"]))
        self.assertEqual(json.loads(self.get("p.json")), j["params"])
        self.assertLess(j["loss"], j["initial_loss"])

    def test_smooth(self):
        self.put("g.salt", "param texture2D t = zeros(8, 8, 1);\nshader float main(float2 x) { return t.sample(x); }")
        self.put("g.npy", write_npy((16, 16, 1), [0.5 + 0.4 * math.sin(i / 16) for i in range(256)]))
        j = self.json_cli("fit", "g.salt", "--target", "g.npy", "--iters", 40, "--lr", "0.05", "--smooth", "t=2")
        self.assertLess(j["loss"], 0.2 * j["initial_loss"])
        self.assertEqual((len(j["params"]["t"]), len(j["params"]["t"][0])), (8, 8))
        self.run_cli("fit", "e.salt", "--target", "t.exr", "--smooth", "r=2", code=2)

    def test_losses(self):
        args = ["fit", "e.salt", "--target", "t.exr", "--iters", 40, "--spp", 16, "--seed", 3]
        plain = self.json_cli(*args)
        self.assertEqual(self.strip(self.json_cli(*args, "--loss", "l2")), self.strip(plain))
        for loss in ("l1", "huber"):
            j = self.strip(self.json_cli(*args, "--loss", loss))
            self.assertLess(j["loss"], 0.3 * j["initial_loss"], loss)
            self.assertAlmostEqual(j["params"]["r"], 0.2, delta=0.02)
            self.put("s.json", json.dumps({"shader": "e.salt", "target": "t.exr", "loss": loss}))
            self.assertEqual(self.strip(self.json_cli("fit", "s.json", *args[4:])), j)
            self.json_cli(*args[:4], "--iters", 7, *args[6:], "--loss", loss, "--checkpoint", "c.bin")
            self.assertEqual(self.strip(self.json_cli(*args, "--loss", loss, "--resume", "c.bin")), j)
            self.run_cli(*args, "--resume", "c.bin", code=4)
        j = self.strip(self.json_cli(*args, "--loss", "huber", "--huber-delta", 0.5))
        self.put("s.json", json.dumps({"shader": "e.salt", "target": "t.exr", "loss": {"huber": 0.5}}))
        self.assertEqual(self.strip(self.json_cli("fit", "s.json", *args[4:])), j)
        self.run_cli(*args, "--loss", "l3", code=2)
        self.run_cli(*args, "--huber-delta", 1, code=2)
        self.run_cli("fit", "e.salt", "--minimize", "--loss", "l1", code=2)
        self.put("s.json", json.dumps({"shader": "e.salt", "target": "t.exr", "loss": "l3"}))
        self.run_cli("fit", "s.json", code=4)

    def test_failed(self):
        self.put("n.salt", "param float a = 1.0;\nshader float main(float2 x) { return sqrt(a - 2.0); }")
        r = self.run_cli("fit", "n.salt", "--minimize", "--iters", 3, "--samples", 64, "--json", code=None)
        self.assertIn(r.code, (0, 1))
        json.loads(r.out, parse_constant=lambda n: self.fail(n))


class Scene(Case):
    def setUp(self):
        super().setUp()
        self.put("s/e.salt", EDGE + "const int N = 1;\nparam float gain = 1.0;\nparam texture2D h = zeros(2, 2, 1);\nshader float other(float2 x) { return main2(x) + h.sample(x).x; }\n"
                 "float main2(float2 x) { float f = 0.0; [Disc] if (length(x - c) < r) f = gain * N; return f; }\n")
        self.run_cli("render", "s/e.salt", "--entry", "other", "--size", 16, "--spp", 64, "--param", "r=0.2", "-o", "s/a.exr")
        self.put("s/m.npy", write_npy((16, 16, 1), [1.0] * 256))
        self.put("s/init.npy", write_npy((2, 2, 1), [0.0] * 4))
        self.scene = {"shader": "e.salt", "entry": "other", "set": {"N": 1}, "size": [16, 16], "spp": 8,
                      "params": {"r": {"value": 0.28, "grad": True, "lr": 0.01}, "c": {"value": [0.45, 0.55], "grad": False}, "h": {"file": "init.npy", "grad": True, "smooth": 20}},
                      "views": [{"target": "a.exr", "mask": "m.npy", "params": {"gain": 1}}, {"target": "a.exr"}],
                      "optimizer": {"type": "adam", "iters": 20}, "output": "out/"}

    def fit(self, code=0, *args):
        self.put("s/scene.json", json.dumps(self.scene))
        return self.run_cli("fit", "s/scene.json", "--json", *args, code=code)

    def test_scene(self):
        j = self.fit().json
        self.assertLess(j["loss"], 0.7 * j["initial_loss"])
        self.assertEqual(j["iterations"], 20)
        self.assertEqual([f32(v) for v in j["params"]["c"]], [f32(0.45), f32(0.55)])
        self.assertNotEqual(f32(j["params"]["r"]), f32(0.28))
        self.assertEqual(j["params"]["gain"], 1)
        self.assertTrue(os.path.exists(self.path("s/out/fitted.json")))
        self.assertEqual(self.fit(0, "--iters", 3).json["iterations"], 3)

    def test_parts_left_out(self):
        """"grad": false of a field of all elements, of an element, of a component."""
        self.put("s/p.salt", "struct Disc { float2 centre; float radius; };\nparam Disc d[2] = { { float2(0.3), 0.2 }, { float2(0.7), 0.2 } };\nparam float3 c = float3(1.0, 0.5, 0.2);\n"
                 "shader float3 main(float2 x) { float3 f = 0.0; for (int i = 0; i < 2; i++) { [Disc] if (length(x - d[i].centre) < d[i].radius) f = c; } return f; }\n")
        self.run_cli("render", "s/p.salt", "--size", 16, "--spp", 16, "--param", "c=.8,.3,.3", "--param", "d[0].radius=.25", "--param", "d[1].radius=.25", "-o", "s/t.exr")
        for params, still in (({"d[*].centre": {"grad": False}}, "d[0].centre d[1].centre"), ({"d": {"grad": True}, "d[1]": {"grad": False}}, "d[1] c"),
                              ({"c.y": {"grad": False}, "d[0].radius": {"grad": False}}, "c.y d[0].radius"), ({"d": {"grad": False}, "d[*].radius": {"grad": True}}, "d[0].centre d[1].centre c")):
            self.scene = {"shader": "p.salt", "spp": 4, "target": "t.exr", "params": params, "optimizer": {"iters": 2}}
            j = self.fit().json["params"]
            was = {"d": [{"centre": [0.3, 0.3], "radius": 0.2}, {"centre": [0.7, 0.7], "radius": 0.2}], "c": [1, 0.5, 0.2]}
            for part in ("d[0].centre", "d[1].centre", "d[0].radius", "d[1].radius", "c.y"):
                def value(of):
                    if part == "c.y":
                        return [f32(of["c"][1])]
                    v = of["d"][int(part[2])][part[5:]]
                    return [f32(k) for k in (v if isinstance(v, list) else [v])]
                held = any(part.startswith(k) for k in still.split())
                (self.assertEqual if held else self.assertNotEqual)(value(j), value(was), (part, params))

    def test_unknown_keys(self):
        for where, key, near in ((self.scene, "shadr", "shader"), (self.scene["views"][0], "taget", "target"), (self.scene["optimizer"], "iter", "iters"), (self.scene["params"]["r"], "smoth", "smooth")):
            where[key] = 1
            r = self.fit(4)
            self.assertIn("`%s`" % near, r.err)
            self.assertIn("scene.json", r.err)
            del where[key]
        for key, bad in (("size", "big"), ("spp", -1), ("params", []), ("views", []), ("optimizer", {"type": "magic"}), ("shader", 3)):
            old, self.scene[key] = self.scene[key], bad
            self.fit(4)
            self.scene[key] = old
        self.scene["params"]["zz"] = 1
        self.fit(4)
        self.scene["params"]["zz"] = {"value": None}
        self.assertIn("not null", self.fit(4).err)
        del self.scene["params"]["zz"]
        self.scene["set"] = {"ZZ": 1}
        self.assertIn(self.fit(None).code, (2, 4))
        self.scene["set"] = {}
        self.scene["views"][1]["target"] = "none.exr"
        self.assertIn("s/none.exr", self.fit(4).err)
        self.put("s/scene.json", "{")
        self.assertRegex(self.run_cli("fit", "s/scene.json", code=4).err, r"scene\.json:\d+:\d+")
        self.run_cli("fit", "none.json", code=4)


class Build(Case):
    MAIN = r"""
#include "out.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
int main(void) {
    /* Inputs in the order of the contract's slots; 64 points of a row. */
    enum { N = 64 };
    static _Alignas(64) float x[4][N + 64], zero[N + 64], out[4][N + 64];
    static float params[64];
    FILE *f = fopen("params.txt", "r");
    for (int i = 0; f && i < 64; i++) if (fscanf(f, "%f", &params[i]) != 1) break;
    SltKernelArgs args;
    memset(&args, 0, sizeof args);
    for (int i = 0; i < SLT_IN_VARYING; i++) args.in[i] = zero;
    for (int i = 0; i < N + 64; i++) x[0][i] = ((i & 7) + 0.5f) / 8.0f, x[1][i] = ((i / 8 & 7) + 0.5f) / 8.0f;
    args.in[0] = x[0], args.in[1] = x[1];
    for (int k = 0; k < 4; k++) args.out[k] = out[k];
    args.params = params;
    args.resolution[0] = args.resolution[1] = 8;
    args.n_valid = N;
    VALUE(&args, N);
    for (int i = 0; i < N; i++) printf("%.9g\n", (double)out[0][i]);
    return 0;
}
"""

    def test_kinds(self):
        self.put("c.salt", CIRCLE)
        for ext, magic in (("o", b"\x7fELF"), ("so", b"\x7fELF"), ("s", b""), ("ll", b""), ("h", b"")):
            self.run_cli("build", "c.salt", "-o", "out." + ext)
            self.assertEqual(self.get("out." + ext)[:len(magic)], magic)
        self.assertIn(b".text", self.get("out.s"))
        self.assertIn(b"define", self.get("out.ll"))
        self.assertIn(b"SltKernelArgs", self.get("out.h"))
        self.run_cli("build", "c.salt", "-o", "out.xyz", code=2)
        self.run_cli("build", "c.salt", code=2)
        self.run_cli("build", "c.salt", "-o", "no/out.o", code=5)
        if shutil.which("cc"):
            self.put("odd.salt", "param float a = 0.1;\nparam float b = 1e-40;\nparam float c[3] = {1.0, 2.0, 3.0};\nparam int n = -3;\nshader float2 main(float2 x) { return float2(a + b, c[0] + float(n)); }")
            self.run_cli("build", "odd.salt", "-o", "odd.h", "--param", "a=inf", "--param", "b=-inf", "--param", "c[1]=nan", "--precision", "f64")
            for name in ("out.h", "odd.h"):
                self.put("use.c", '#include "%s"\nint main(void) { return 0; }\n' % name)
                for compiler, language, std in (("cc", "c", "c99"), ("cc", "c", "c17"), ("c++", "c++", "c++11"), ("c++", "c++", "c++17"), ("clang++-19", "c++", "c++14")):
                    if shutil.which(compiler):
                        subprocess.run([compiler, "-std=" + std, "-Wall", "-Wextra", "-Werror", "-pedantic", "-fsyntax-only", "-x", language, "use.c"], cwd=self.dir, check=True)

    @unittest.skipUnless(shutil.which("cc"), "no C compiler")
    def test_linked(self):
        """The kernel in another program gives the values of `render`."""
        self.put("k.salt", "param float a = 0.5;\nparam float2 c = float2(0.25, 2.0);\nshader float main(float2 x) { float f = a * sin(c.y * x.x); [Disc] if (x.y > c.x) f += x.x; return f; }")
        self.put("params.txt", "0.5 0.25 2.0")
        self.put("main.c", self.MAIN)
        os.mkdir(self.path("tmp"))
        env = {"TMPDIR": self.path("tmp")}
        for kind in ("o", "so"):
            j = self.json_cli("build", "k.salt", "-o", "out." + kind, env=env)
            self.assertEqual(os.listdir(self.path("tmp")), [])
            self.assertIn("out." + kind, j["outputs"])
            self.run_cli("build", "k.salt", "-o", "out.h")
            header = self.get("out.h").decode()
            import re
            value = re.findall(r"\b(\w*value\w*)\s*\(SltKernelArgs", header)
            self.assertTrue(value, header[-2000:])
            subprocess.run(["cc", "-std=c17", "-Wall", "-Wextra", "-Werror", "-DVALUE=" + value[0], "main.c", "out." + kind, "-o", "prog", "-lm", "-Wl,-rpath,."], cwd=self.dir, check=True)
            got = [float(v) for v in subprocess.run(["./prog"], cwd=self.dir, check=True, capture_output=True).stdout.split()]
            for i, v in enumerate(got):
                x, y = (i % 8 + 0.5) / 8, (i // 8 + 0.5) / 8
                self.assertAlmostEqual(v, 0.5 * math.sin(2 * x) + (x if y > 0.25 else 0), delta=2e-7)
        os.rmdir(self.path("tmp"))
        self.assertIn(self.path("tmp"), self.run_cli("build", "k.salt", "-o", "new.so", env=env, code=5).err)
        self.assertFalse(os.path.exists(self.path("new.h")))
        self.assertIn("cannot link", self.run_cli("build", "k.salt", "-o", "new.so", env={"CC": "false"}, code=5).err)


if __name__ == "__main__":
    unittest.main()
