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
        j.pop("seconds"), j.pop("outputs")
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


if __name__ == "__main__":
    unittest.main()
