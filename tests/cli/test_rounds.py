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


if __name__ == "__main__":
    unittest.main()
