"""Scenes of several views: entries of their own, targets that shaders draw, losses that are functions of the shader."""
from harness import *

SHADER = """
param float3 centre = float3(0.45, 0.55, 0.4);
param float r = 0.3;
param float gain = 1.0;
float soft(float image, float target) { float d = image - target; return sqrt(d * d + 0.0004) - 0.02; }
shader float top(float2 x) {
    float f = 0.1;
    [Disc] if (length(x - centre.xy) < r) f = gain;
    return f;
}
shader float front(float2 x) {
    float f = 0.1;
    [Disc] if (length(x - centre.xz) < r) f = gain;
    return f;
}
"""
TRUTH = """
const float SIZE = 0.1;
param float3 centre = float3(0.5);
shader float from_top(float2 x) { return length(x - centre.xy) < SIZE ? 1.0 : 0.1; }
shader float from_front(float2 x) { return length(x - centre.xz) < SIZE ? 1.0 : 0.1; }
"""


class Views(Case):
    def setUp(self):
        super().setUp()
        self.put("s/a.salt", SHADER)
        self.put("s/truth.salt", TRUTH)
        drawn = {"shader": "truth.salt", "params": {"centre": [0.55, 0.5, 0.5]}, "set": {"SIZE": 0.2}}
        self.scene = {"shader": "a.salt", "entry": "top", "size": [24, 24], "spp": 16, "seed": 5, "params": {"gain": {"grad": False}},
                      "views": [{"target": dict(drawn, entry="from_top")}, {"entry": "front", "target": dict(drawn, entry="from_front")}],
                      "optimizer": {"type": "adam", "iters": 60, "lr": 0.01}}

    def fit(self, *args, code=0):
        self.put("s/scene.json", json.dumps(self.scene))
        r = self.run_cli("fit", "s/scene.json", "--json", *args, code=code)
        if code:
            return r
        j = r.json
        j.pop("seconds"), j.pop("evaluations"), j.pop("outputs")
        return j

    def found(self, j):
        for value, truth in zip(j["params"]["centre"] + [j["params"]["r"]], (0.55, 0.5, 0.5, 0.2)):
            self.assertAlmostEqual(value, truth, delta=0.01)

    def test_entries_and_drawn_targets(self):
        j = self.fit()
        self.found(j)
        self.assertEqual(j["params"]["gain"], 1)
        self.assertEqual(self.fit("--threads", 1), j)
        self.fit("--iters", 13, "--checkpoint", "c.bin")
        self.assertEqual(self.fit("--resume", "c.bin"), j)
        self.scene["views"][1]["entry"] = "top"
        self.assertIn("belongs to", self.fit("--resume", "c.bin", code=4).err)
        self.scene["views"][1]["entry"] = "side"
        self.fit(code=2)
        del self.scene["entry"]
        self.assertIn("E0215", self.fit("--iters", 1, code=3).err)  # which is view 0 of?
        self.scene["views"][0]["entry"], self.scene["views"][1]["entry"] = "top", "front"
        self.fit("--iters", 1)

    def test_one_view(self):
        self.scene["target"] = self.scene.pop("views")[0]["target"]
        j = self.fit()
        self.assertAlmostEqual(j["params"]["centre"][0], 0.55, delta=0.01)
        self.assertEqual(f32(j["params"]["centre"][2]), f32(0.4))

    def test_bad_targets(self):
        good = self.scene["views"][0]["target"]
        for bad, text in (({"entry": "from_top"}, "`shader` is missing"), (dict(good, shader="none.salt"), "none.salt"), (dict(good, param={}), "did you mean `params`"),
                          (dict(good, params={"centre": [1, 2]}), "centre"), (dict(good, params=3), "an object is wanted"), (dict(good, spp=0), "spp")):
            self.scene["views"][0]["target"] = bad
            self.assertIn(text, self.fit(code=4).err)
        self.put("s/bad.salt", "shader float main(float2 x) { return y; }")
        self.scene["views"][0]["target"] = {"shader": "bad.salt"}
        self.fit(code=3)
        self.assertIn("bad.salt:1:", self.run_cli("fit", "s/scene.json", code=3).err)
        self.put("s/two.salt", "shader float2 main(float2 x) { return x; }")
        self.scene["views"][0]["target"] = {"shader": "two.salt"}
        self.assertIn("2 channels", self.fit(code=4).err)
        self.scene["views"][0]["target"] = {"shader": "../out.salt"}
        self.fit("--sandbox", code=4)

    def chunks(self, name):
        data, found, at = self.get(name), [], 8
        while at < len(data):
            n, = struct.unpack(">I", data[at:at + 4])
            self.assertEqual(zlib.crc32(data[at + 4:at + 8 + n]), struct.unpack(">I", data[at + 8 + n:at + 12 + n])[0])
            found.append((data[at + 4:at + 8].decode(), data[at + 8:at + 8 + n]))
            at += 12 + n
        return found

    def size(self, name):
        return struct.unpack(">II", self.chunks(name)[0][1][:8])

    def test_pictures(self):
        """The folder shows every view; the frames are those of the animation, in it and as files."""
        self.scene["views"].append(dict(self.scene["views"][1], params={"gain": 0.5}))
        self.scene.update(output="out", frames=5, size=[16, 12])
        j = self.fit("--iters", 12)
        files = sorted(os.listdir(self.path("s/out")))
        for name in ("image", "image_1", "image_2"):
            self.assertIn(name + ".exr", files)
            self.assertEqual(self.size("s/out/%s.png" % name), (16, 12))
        self.assertNotIn("image_3.exr", files)
        self.assertEqual(self.size("s/out/strip.png"), (7 * 20 - 4, 3 * 16 - 4))
        frames = sorted(os.listdir(self.path("s/out/frames")))
        self.assertEqual(frames, ["%04d.png" % k for k in range(4)])  # iterations 0, 5, 10, and the best
        chunks = self.chunks("s/out/fit.png")
        self.assertEqual(chunks[0][1][:8], struct.pack(">II", 2 * 20 - 4, 2 * 16 - 4))
        self.assertEqual([n for n, _ in chunks if n != "IDAT"], ["IHDR", "acTL"] + ["fcTL"] + ["fcTL", "fdAT"] * 3 + ["IEND"])
        self.assertEqual(dict(chunks)["acTL"], struct.pack(">II", 4, 0))
        data = [b"".join(d for n, d in self.chunks("s/out/frames/" + name) if n == "IDAT") for name in frames]
        self.assertEqual([d for n, d in chunks if n == "IDAT"] + [d[4:] for n, d in chunks if n == "fdAT"], data)
        self.assertEqual([struct.unpack(">I", d[:4])[0] for n, d in chunks if n in ("fcTL", "fdAT")], list(range(7)))
        # Looking changes nothing.
        del self.scene["frames"], self.scene["output"]
        self.assertEqual(self.fit("--iters", 12), j)
        self.fit("--frames", 3, code=2)
        self.fit("--frames", 1, "--iters", 100000, "-o", "s/out", code=2)

    def test_volume(self):
        self.put("s/a.salt", "param float r = 0.35;\nshader float main(float3 x) { float f = 0.1; [Disc] if (length(x - 0.5) < r) f = 1.0; return f; }")
        self.put("s/truth.salt", "shader float main(float3 x) { return length(x - 0.5) < 0.25 ? 1.0 : 0.1; }")
        self.scene = {"shader": "a.salt", "size": [12, 10, 8], "spp": 8, "target": {"shader": "truth.salt"}, "optimizer": {"iters": 60}, "output": "out"}
        self.assertAlmostEqual(self.fit()["params"]["r"], 0.25, delta=0.01)
        self.assertEqual(self.size("s/out/image.png"), (4 * 16 - 4, 10))

    def test_mesh(self):
        """The vertices of a mesh under its own Laplacian, in a scene and on the command line."""
        self.put("s/a.salt", "param float2 v[4] = {float2(0.2, 0.3), float2(0.7, 0.2), float2(0.4, 0.8), float2(0.8, 0.7)};\nparam int3 f[2] = {int3(0, 1, 2), int3(2, 1, 3)};\n"
                 "shader float main(float2 x) { float s = 0.0; for (int i = 0; i < 4; i++) s += exp(-9.0 * dot(x - v[i], x - v[i])); return s; }")
        self.scene = {"shader": "a.salt", "size": [16, 16], "target": {"shader": "a.salt", "params": {"v": [[0.3, 0.3], [0.8, 0.3], [0.5, 0.8], [0.8, 0.8]]}}, "optimizer": {"iters": 9}}
        plain = self.fit("--smooth", "v=5")
        mesh = self.fit("--smooth", "v=5", "--smooth-faces", "v=f")
        self.assertNotEqual(plain["losses"], mesh["losses"])
        self.scene["params"] = {"v": {"smooth": 5, "faces": "f"}}
        self.assertEqual(self.fit(), mesh)
        self.fit("--iters", 4, "--checkpoint", "c.bin")
        self.assertEqual(self.fit("--resume", "c.bin"), mesh)
        self.run_cli("fit", "s/scene.json", "--param", "f=[[0,1,2],[2,0,3]]", "--resume", "c.bin", code=4)
        self.scene["params"]["v"]["faces"] = "g"
        self.fit(code=2)
        # The same four as a grid of two by two, which has other neighbours than a list.
        self.scene["params"] = {"v": {"smooth": 5, "grid": [2, 2]}}
        grid = self.fit()
        self.assertNotEqual(grid["losses"], plain["losses"])
        self.scene["params"] = {}
        self.assertEqual(self.fit("--smooth", "v=5", "--smooth-grid", "v=2x2"), grid)
        for bad, code in (([2, 3], 2), ([4], 4), (4, 4), ([2, 2.5], 4), ([0, 4], 4)):
            self.scene["params"] = {"v": {"smooth": 5, "grid": bad}}
            self.assertIn("grid", self.fit(code=code).err)

    def test_zero_by_chance(self):
        """A gradient that the first samples make zero is no convergence: here one pixel alone holds the edge."""
        self.put("s/a.salt", "param float c = 0.4;\nshader float main(float x) { float f = 0.1; [Disc] if (x < c) f = 1.0; return f; }")
        self.run_cli("render", "s/a.salt", "--size", 32, "--param", "c=0.6", "--spp", 64, "-o", "t.exr")
        for seed in range(6):
            j = self.json_cli("fit", "s/a.salt", "--target", "t.exr", "--loss", "l1", "--iters", 60, "--lr", 0.02, "--seed", seed)
            self.assertEqual(j["iterations"], 60)
            self.assertAlmostEqual(j["params"]["c"], 0.6, delta=0.02)
        # Without any gradient it ends soon all the same.
        self.put("s/b.salt", "param float c = 0.4;\nshader float main(float x) { return c < 0.5 ? 0.5 : x; }")
        j = self.json_cli("fit", "s/b.salt", "--target", "t.exr", "--iters", 60)
        self.assertEqual((j["stopped"], j["iterations"]), ("converged", 8))

    def test_loss_entry(self):
        self.scene["loss"] = {"entry": "soft"}
        j = self.fit()
        self.found(j)
        del self.scene["loss"]
        self.assertEqual(self.fit("--loss-entry", "soft"), j)
        self.fit("--loss-entry", "soft", "--iters", 13, "--checkpoint", "c.bin")
        self.assertEqual(self.fit("--loss-entry", "soft", "--resume", "c.bin"), j)
        self.fit("--resume", "c.bin", code=4)
        self.fit("--loss-entry", "soft", "--loss", "l1", code=2)
        self.assertIn("float hard(float image, float target)", self.fit("--loss-entry", "hard", code=2).err)

    def test_optimizer(self):
        """Schedules, betas, some views an iteration and rates by pattern are the same in a scene and on the command line."""
        plain = self.fit("--iters", 9)
        for key, value, args in (("schedule", "cosine", ["--schedule", "cosine"]), ("schedule", {"exponential": 0.9}, ["--schedule", "exponential=0.9"]),
                                 ("betas", [0.5, 0.9], ["--betas", "0.5,0.9"]), ("views_per_step", 1, ["--views-per-step", 1])):
            given = self.fit("--iters", 9, *args)
            self.assertNotEqual(given["losses"], plain["losses"], key)
            self.scene["optimizer"][key] = value
            self.assertEqual(self.fit("--iters", 9), given, key)
            del self.scene["optimizer"][key]
            for bad in (-1, "high", [0.5], {}):
                self.scene["optimizer"][key] = bad
                self.fit(code=4)
            del self.scene["optimizer"][key]
        self.scene["optimizer"]["schedule"] = "constant"
        self.assertEqual(self.fit("--iters", 9), plain)
        for args in (["--schedule", "slow"], ["--schedule", "exponential=2"], ["--betas", "0.9"], ["--betas", "1,0.9"], ["--views-per-step", 3]):
            self.fit(*args, code=2)

    def test_going_on(self):
        """What a fit has found (--params) wins over where the scene says that it begins, and --param over both."""
        self.scene["params"] = {"r": {"value": 0.3}, "gain": {"value": 1, "grad": False}}
        self.put("found.json", json.dumps({"r": 0.2, "gain": 0.7}))
        on = self.fit("--iters", 1, "--params", "found.json", "--param", "gain=0.9")
        self.scene["params"]["r"]["value"], self.scene["params"]["gain"]["value"] = 0.2, 0.9
        self.assertEqual(on, self.fit("--iters", 1))

    def test_patterns(self):
        self.put("s/a.salt", "struct Spot { float2 at; float ink; };\nparam Spot spots[2] = {{float2(0.3), 0.5}, {float2(0.6), 0.8}};\n"
                 "shader float main(float2 x) { float f = 0.1; for (int i = 0; i < 2; i++) { [Disc] if (length(x - spots[i].at) < 0.2) f = spots[i].ink; } return f; }")
        self.scene = {"shader": "a.salt", "size": [16, 16], "target": {"shader": "truth.salt", "entry": "from_top"}, "optimizer": {"iters": 5}}
        spots = [[f32(0.3), f32(0.3), f32(0.5)], [f32(0.6), f32(0.6), f32(0.8)]]

        def moved(j):
            return [[f32(v) != b for v, b in zip(s["at"] + [s["ink"]], before)] for s, before in zip(j["params"]["spots"], spots)]
        self.scene["params"] = {"spots[*].at": {"lr": 0}}
        self.assertEqual(moved(self.fit()), [[False, False, True]] * 2)
        self.scene["params"] = {"spots[*].at": {"lr": 0.1, "grad": True}}
        self.assertEqual(moved(self.fit()), [[True, True, False]] * 2)
        self.scene["params"] = {}
        self.assertEqual(moved(self.fit("--lr", "0.1,spots[*].at=0,spots[0].at.x=0.1")), [[True, False, True], [False, False, True]])
        self.assertEqual(moved(self.fit("--wrt", "spots[*].ink")), [[False, False, True]] * 2)
        self.scene["params"] = {"spots[*].at": {"value": 0.5}}
        self.fit(code=4)
        self.scene["params"] = {"spots[*].on": {"lr": 0.5}}
        self.assertIn("no field `on`", self.fit(code=2).err)
        self.run_cli("grad", "s/a.salt", "--integral", "--wrt", "spots[*].ink", code=2)


if __name__ == "__main__":
    unittest.main()
