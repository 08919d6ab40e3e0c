"""Heightfields from the outside: which structures are built and which are left out, the choice of one, building ahead of time."""
from harness import *

HEAD = """
[Extent(-1.0, -1.0, 1.0, 1.0)] [Height(0.3, 0.0)] param heightfield h = zeros(17, 17);
param float sun = 0.5;
"""
MAIN = "[Domain(-1.0, 1.0)] shader float main(float2 x) { %s }\n"
SCENES = {
    "none": "return sun * x.x;",
    "plain": "return sun * h.height(x) + h.normal(x).z + h.gradient(x).x;",
    "trace": "[NoDisc] Hit v = h.trace(float3(x, 1.0), float3(0.1, 0.2, -sun), 0.0, 1e9); return v.hit ? v.t : 0.0;",
    "occluded": "[NoDisc] bool b = h.occluded(float3(x, 0.5), float3(0.4, 0.2, -sun), 0.0, 1e9); return b ? 0.0 : h.height(x);",
    "shadow": "float f = 1.0; [Disc] if (h.clearance(float3(x, h.height(x)), float3(0.4, 0.2, sun), 0.05, 1e9) < 0.0) f = 0.1; return f;",
    "clearance": "return h.clearance(float3(x, h.height(x)), float3(0.4, 0.2, sun), 0.05, 1e9);",
    "view": "[Disc] Hit v = h.trace(float3(x, 1.0), float3(0.1, 0.9, -sun), 0.0, 1e9); return v.hit ? 1.0 : 0.0;",
    "cast": "[Disc] bool b = h.occluded(float3(x, 0.5), float3(0.4, 0.2, -sun), 0.0, 1e9); return b ? 0.0 : 1.0;",
    "silhouette": "Silhouette s = h.silhouette(float3(x, 1.0), float2(1.0, 0.1), -sun, 1.0); return s.found ? s.slope : 0.0;",
}
ALL = {"trace", "occluded", "clearance", "shadow", "silhouette", "rise", "blocked"}


class Structures(Case):
    def explain(self, name, *args):
        self.put(name + ".salt", HEAD + MAIN % SCENES[name])
        return self.json_cli("explain", name + ".salt", *args)

    def test_pay_for_what_you_use(self):
        """No field, no module; only the queries that the shader's calls need, in any kernel."""
        for name, may in (("none", set()), ("plain", set()), ("trace", {"trace"}), ("occluded", {"occluded"}), ("shadow", {"shadow", "clearance"}), ("clearance", {"clearance"}),
                          ("view", {"trace", "occluded", "clearance", "rise"}), ("silhouette", {"silhouette"})):
            j = self.explain(name)
            fields = j["structures"]["fields"]
            if not may:
                self.assertEqual(fields, [], name)
                self.assertIn("structure of h", j["left_out"])
                continue
            self.assertEqual(len(fields), 1, name)
            f = fields[0]
            self.assertEqual((f["name"], f["width"], f["height"], f["structure"]), ("h", 17, 17, "mipmap"))
            self.assertTrue(f["queries"] and set(f["queries"]) <= may | {"blocked"}, (name, f["queries"]))  # blocked: by bounds alone
            for kernel in set(f["kernels"]) - {"bounds", "edge_bounds"}:
                self.assertLessEqual(set(f["kernels"][kernel]), may, (name, kernel))
            self.assertEqual(set(f["queries"]) | set(f["left_out"]), ALL)
            self.assertEqual(set(f["queries"]) & set(f["left_out"]), set())
            self.assertEqual(set(q for k in f["kernels"].values() for q in k), set(f["queries"]))
            self.assertLessEqual(set(f["kernels"]["value"]), may)
            self.assertGreater(f["bytes"], 0)
            self.assertLess(f["bytes"], 6 * 17 * 17 + 1024)
            self.assertNotIn("structure of h", j["left_out"])
        self.assertEqual(self.explain("clearance", "--interior-only")["structures"]["fields"][0]["queries"], ["clearance"])
        kernels = self.explain("cast")["structures"]["fields"][0]["kernels"]
        self.assertEqual(kernels["value"], ["occluded"])  # any blocked point; the edge's g begins at the first
        self.assertIn("trace", kernels["event"])

    def test_text(self):
        self.explain("shadow")
        text = self.run_cli("explain", "shadow.salt").out
        self.assertRegex(text, r"structures built\n  h, 17 x 17 numbers: .*mipmap.*\n    \d+ bytes, [0-9.]+ a number; asked: ")
        self.assertIn("silhouette of h: no kernel asks", text)
        self.explain("view")
        self.assertRegex(self.run_cli("explain", "view.salt").out, r"view\.salt:\d+:\d+  silhouette")
        self.assertEqual([s["kind"] for s in self.explain("view")["sites"]], ["silhouette"])
        self.assertEqual([s["kind"] for s in self.explain("cast")["sites"]], ["shadow"])
        self.explain("plain")
        text = self.run_cli("explain", "plain.salt").out
        self.assertIn("structures built\n  none", text)
        self.assertIn("structure of h: nothing searches it", text)
        self.put("c.salt", CIRCLE)
        self.assertIn("there is no geometry", self.run_cli("explain", "c.salt").out)

    def test_no_query_in_the_code(self):
        """In the IR itself: no search where no call asks for one."""
        for name, may in (("plain", set()), ("trace", {0}), ("shadow", {2, 3})):
            self.put(name + ".salt", HEAD + MAIN % SCENES[name])
            dump = self.run_cli("grad", name + ".salt", "--samples", 256, "--estimator", "lattice", "--dump", "all").err
            self.assertIn("fmul", dump)
            import re
            found = set(int(m) for m in re.findall(r"= query [^\n]*?what (\d)", dump))
            self.assertLessEqual(found, may, name)
            self.assertEqual("= query " in dump, bool(may), name)

    def test_structures_give_the_same(self):
        self.put("h_17x17.f32", struct.pack("<289f", *[(x * 7 + y * 13) % 11 / 11 for y in range(17) for x in range(17)]))
        for name in ("trace", "occluded", "shadow", "clearance", "view", "silhouette"):
            self.put(name + ".salt", HEAD + MAIN % SCENES[name])
            for width in (1, 16):  # sums over lanes depend on the width
                seen = set()
                for s in ("mipmap", "cone", "naive"):
                    j = self.json_cli("grad", name + ".salt", "--param", "h=@h_17x17.f32", "--wrt", "sun", "--samples", 2048, "--field", s, "--width", width)
                    seen.add(json.dumps([j["integral"], j["gradient"], j["crossings"]]))
                self.assertEqual(len(seen), 1, name)
        self.run_cli("render", "trace.salt", "--field", "tree", code=2)

    def test_views_of_their_own(self):
        """Two views, each with a heightfield of its own: each is seen with its own, iteration after iteration."""
        self.put("v.salt", "[NoDiff] [Height(0.3, 0.0)] param heightfield h = zeros(9, 9);\nparam float albedo = 0.5;\nshader float main(float2 x) {\n"
                 "    [NoDisc] Hit v = h.trace(float3(x, 1.0), float3(0.0, 0.0, -1.0), 0.0, 1e9);\n    return albedo * v.t;\n}\n")
        for name, height, albedo in (("a", 1.0, 0.8), ("b", 2.0, 0.8)):
            self.put(name + ".npy", write_npy((9, 9), [height] * 81))
            self.run_cli("render", "v.salt", "--param", "h=@%s.npy" % name, "--param", "albedo=%g" % albedo, "--size", 8, "-o", name + ".exr")
        scene = {"shader": "v.salt", "size": [8, 8], "spp": 2, "params": {"albedo": {"grad": True, "lr": 0.02}},
                 "views": [{"target": n + ".exr", "params": {"h": {"file": n + ".npy"}}} for n in "ab"], "optimizer": {"iters": 80}}
        self.put("scene.json", json.dumps(scene))
        j = self.json_cli("fit", "scene.json")
        self.assertAlmostEqual(j["params"]["albedo"], 0.8, delta=0.01)
        self.assertLess(j["loss"], 1e-4)
        self.assertEqual(j["params"]["h"][0][0], 0)
        del scene["views"][1]["params"]  # seen with zeros, the second target cannot be met
        self.put("scene.json", json.dumps(scene))
        self.assertGreater(self.json_cli("fit", "scene.json")["loss"], 0.01)

    def test_every_verb(self):
        """Searched heights wherever kernels run: 8-bit pixels, the interpreter, derivative images, losses, finite differences, check, bench."""
        self.put("h_17x17.f32", struct.pack("<289f", *[(x * 7 + y * 13) % 11 / 11 for y in range(17) for x in range(17)]))
        for name in ("view", "shadow"):
            self.put(name + ".salt", HEAD + MAIN % SCENES[name])
            args = [name + ".salt", "--param", "h=@h_17x17.f32"]
            self.run_cli("render", *args, "--size", 24, "--format", "rgba8", "-o", "a.png")
            self.run_cli("render", *args, "--size", 24, "--spp", 64, "-o", "b.npy")
            bytes8, floats = read_png(self.get("a.png"))[1][0::4], read_npy(self.get("b.npy"))[1]
            self.assertGreater(len(set(bytes8)), 1)
            linear = [v / 255 / 12.92 if v < 10.3 else ((v / 255 + 0.055) / 1.055) ** 2.4 for v in bytes8]
            self.assertAlmostEqual(sum(linear) / 576, sum(floats) / 576, delta=4 * 0.5 / 24)  # one sample in each pixel
            self.run_cli("render", *args, "--size", 8, "--spp", 1, "--interpret", "-o", "i.npy")
            self.run_cli("render", *args, "--size", 8, "--spp", 1, "-o", "j.npy")
            self.assertEqual(self.get("i.npy"), self.get("j.npy"))
            self.run_cli("grad", *args, "--wrt", "sun", "--size", 16, "-o", "g.exr")
            self.json_cli("grad", *args, "--target", "b.npy", "--size", 16)
            a = self.json_cli("grad", *args, "--wrt", "sun", "--samples", 65536)
            b = self.json_cli("grad", *args, "--wrt", "sun", "--samples", 262144, "--estimator", "fd")
            se = (a["stderr"]["sun"] ** 2 + b["stderr"]["sun"] ** 2) ** 0.5
            self.assertAlmostEqual(a["gradient"]["sun"], b["gradient"]["sun"], delta=5 * se + 0.02 * abs(b["gradient"]["sun"]))
            self.json_cli("bench", *args, "--kernels", "--samples", 4096)
            self.json_cli("bench", *args, "--wrt", "sun", "--samples", 1024, "--repeats", 2, "--estimators", "lattice,fd")
            self.json_cli("check", *args, "--wrt", "sun", "--samples", 65536, code=None)

    def test_explain_at(self):
        self.put("h_17x17.f32", struct.pack("<289f", *[(x * 7 + y * 13) % 11 / 11 for y in range(17) for x in range(17)]))
        self.put("shadow.salt", HEAD + MAIN % SCENES["shadow"])
        j = self.json_cli("explain", "shadow.salt", "--param", "h=@h_17x17.f32", "--at", "0.1,0.2")
        self.assertEqual(len(j["trace"]), 1)
        self.assertIn(j["f"][0], (1, f32(0.1)))

    def test_build(self):
        """What stands alone cannot search: said, with the parameter's name, before anything is written."""
        self.put("trace.salt", HEAD + MAIN % SCENES["trace"])
        r = self.run_cli("build", "trace.salt", "-o", "out.o", code=2)
        self.assertIn("`h`", r.err)
        self.no_leftovers()
        self.put("plain.salt", HEAD + MAIN % SCENES["plain"])
        self.run_cli("build", "plain.salt", "-o", "out.o")

    def test_shadow_moves_in_a_fit(self):
        """Heights, found from where their shadow falls: the structure follows them through the iterations."""
        self.put("s.salt", "[Extent(-1.0, -1.0, 1.0, 1.0)] param heightfield h = zeros(17, 17);\nparam float up = 0.0;\n[Domain(-1.0, 1.0)] shader float main(float2 x) {\n"
                 "    float3 o = float3(x, 0.001);\n    float f = 1.0;\n    [Disc] if (h.clearance(o, float3(1.0, 0.0, 0.6), 0.02, 1e9) < 0.0) f = 0.0;\n    return f;\n}\n")
        bump = [0.35 if 7 <= x <= 8 and 5 <= y <= 11 else 0.0 for y in range(17) for x in range(17)]
        start = [0.2 if 7 <= x <= 8 and 5 <= y <= 11 else 0.0 for y in range(17) for x in range(17)]
        self.put("bump.npy", write_npy((17, 17), bump))
        self.put("start.npy", write_npy((17, 17), start))
        self.put("m.npy", write_npy((17, 17), [1.0 if b else 0.0 for b in bump]))
        self.run_cli("render", "s.salt", "--param", "h=@bump.npy", "--size", 48, "--spp", 64, "-o", "t.exr")
        self.put("scene.json", json.dumps({"shader": "s.salt", "size": [48, 48], "spp": 4, "params": {"h": {"file": "start.npy", "mask": "m.npy", "grad": True, "lr": 0.01}}, "views": [{"target": "t.exr"}],
                                           "optimizer": {"iters": 40}}))
        j = self.json_cli("fit", "scene.json")
        self.assertLess(j["loss"], 0.1 * j["initial_loss"])
        rows = j["params"]["h"]
        self.assertAlmostEqual(sum(rows[y][7] for y in range(6, 11)) / 5, 0.35, delta=0.03)  # of the ridge, what the sun sees last
        self.assertTrue(all(rows[y][x] == 0 for y in range(17) for x in range(17) if not bump[17 * y + x]))
        # A structure made anew in the middle answers as one that followed: the same bits on any number of threads, killed and resumed.
        def strip(r, *more):
            for name in ("seconds", *more):
                r.pop(name)
            return json.dumps(r)
        args = ["fit", "scene.json", "--smooth", "h=2", "--seed", 3]
        whole = self.json_cli(*args, "--iters", 9, "--threads", 1)
        self.assertEqual(strip(self.json_cli(*args, "--iters", 9, "--threads", 3)), strip(dict(whole)))
        self.json_cli(*args, "--iters", 4, "--checkpoint", "c.bin", "--every", 1)
        resumed = self.json_cli(*args, "--iters", 9, "--resume", "c.bin")
        self.assertLess(resumed["evaluations"], whole["evaluations"])  # what it did itself
        self.assertEqual(strip(resumed, "evaluations"), strip(whole, "evaluations"))


if __name__ == "__main__":
    unittest.main()
