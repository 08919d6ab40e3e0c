"""Hover: does a gradient reach this? The same answer as the derivatives that the compiler makes; and why not."""
import json
import os
import subprocess
import unittest
from pathlib import Path

from client import BIN, ROOT, SOURCES, Case

PROGRAM = """const int N = 3;
const float HALF = 0.5;
param float value = 0.4;          // through values
param float edge = 0.4;           // through a boundary
param float both = 0.4;
[NoDiff] param float fixed = 1.0;
param int count = 2;
param float rounded = 0.3;
param float compared = 0.3;
param float indexed = 1.5;
param float held = 0.3;
param float unused = 0.3;
param float still = 0.3;
param float table[4] = { 1.0, 2.0, 3.0, 4.0 };
struct Pair { float a; float b; };
float twice(float v) { return 2.0 * v; }
float lonely(float v) { return v; }
shader float main(float2 x) {
    float f = value * x.x + both;
    float d = x.y - edge - both;
    [Disc] if (d < 0.0) f += 1.0;
    float q = floor(rounded * 3.0);
    if (compared > x.x) f += 0.25;
    [Disc] if (still < 0.5) f += 0.125;
    float w = table[int(indexed)];
    float h = detach(held);
    Pair p = { twice(value), fixed };
    bool sure = f > 0.5;
    float nothing = twice(unused);
    for (int i = 0; i < N; i++) f += p.a * p.b * h * q * w * HALF * float(count);
    return f;
}
"""
CASES = [
    ("value =", "A gradient reaches this: through values."),
    ("edge =", "A gradient reaches this: through a boundary that `[Disc]` marks."),
    ("both =", "A gradient reaches this: through values, and through a boundary that `[Disc]` marks."),
    ("fixed =", "No gradient: `[NoDiff]`."),
    ("count =", "No gradient: an integer has none."),
    ("rounded =", "only `floor` uses it (line 22), whose slope is 0"),
    ("compared =", "it is only compared (line 23), and no `[Disc]` marks that"),
    ("still =", "only a `[Disc]` whose boundary does not depend on the position uses it (line 24)"),
    ("indexed =", "only a rounding towards 0 uses it (line 25)"),
    ("held =", "`detach` ends its derivative (line 26)"),
    ("unused =", "No gradient reaches this: no output depends on it."),
    ("table[4] =", "A gradient reaches this: through values."),
    ("N = 3", "A constant: it has no gradient."),
    ("HALF =", "A constant: it has no gradient."),
    ("f = value", "A gradient reaches this: through values."),
    ("d = x.y", "A gradient reaches this: through a boundary that `[Disc]` marks."),
    ("d < 0.0", "A gradient reaches this: through a boundary that `[Disc]` marks."),
    ("q = floor", "No gradient passes here: it changes with a parameter by jumps or decisions alone."),
    ("w = table", "A gradient reaches this: through values."),
    ("h = detach", "No gradient passes here: it changes with a parameter by jumps or decisions alone."),
    ("sure =", "No gradient: a bool has none."),
    ("nothing =", "No gradient reaches this: no output depends on it."),
    ("x.x + both", "No gradient passes here: it depends on no parameter that has one."),
    ("a * p.b", "A gradient reaches this: through values."),
    ("twice(value)", "A gradient reaches this: through values."),
    ("v; }\nfloat lonely", "A gradient reaches this: through values."),
    ("v; }\nshader", "No gradient reaches this: no shader of this file uses it."),
    ("i++", "No gradient: an integer has none."),
]
SMALL = ["circle.salt", "kaleidoscope.salt", "gears.salt", "bands.salt", "grid.salt", "csg.salt"]


class Reasons(Case):
    def test_every_reason(self):
        s = self.server()
        uri = s.open("/nowhere/gradient.salt", PROGRAM)
        self.assertEqual([], [d for d in s.diagnostics(uri) if d["severity"] == 1])
        for mark, text in CASES:
            got = s.hover(uri, PROGRAM, mark)
            self.assertIn(text, got, mark)
        self.assertEqual(1, sum(got.count(w) for w in ("No gradient", "A gradient", "A constant")))

    def test_the_lines_are_those_of_the_program(self):
        for mark, text in CASES:
            if "(line " in text:
                line = int(text.split("(line ")[1].split(")")[0])
                self.assertIn(mark.split()[0].split("[")[0], PROGRAM.split("\n")[line - 1], mark)

    def test_errors_and_files_without_a_shader(self):
        s = self.server()
        text = "param float a = 1.0;\nshader float main(float2 x) { return a * y; }\n"
        self.assertIn("once the errors are mended", s.hover(s.open("/nowhere/g1.salt", text), text, "a ="))
        text = "param float a = 1.0;\nfloat f() { return a; }\n"
        self.assertIn("this file has none", s.hover(s.open("/nowhere/g2.salt", text), text, "a ="))

    def test_shaders_of_a_file_are_named(self):
        s = self.server()
        text = "param float a = 1.0;\nparam float b = 1.0;\nshader float one(float2 x) { return a; }\nshader float two(float2 x) { return a * b; }\n"
        uri = s.open("/nowhere/g3.salt", text)
        self.assertIn("In `one`, `two`.", s.hover(uri, text, "a ="))
        self.assertIn("In `two`.", s.hover(uri, text, "b ="))


class Agreement(Case):
    def test_parameters_are_as_explain_says(self):
        """`explain` reads it off the reverse kernels, after all passes; hover off the primal as it was written."""
        asked = 0
        for path in SOURCES:
            if "/stdlib/" in path or (os.path.basename(path) not in SMALL and not os.environ.get("LSP_ALL")):
                continue
            done = subprocess.run([BIN, "explain", path, "--json"], capture_output=True, text=True)
            if done.returncode:
                continue  # a part of another program, or one with several shaders
            said = json.loads(done.stdout)
            without = said["no_gradient"]  # name: why
            text = Path(path).read_text()
            s = self.server()
            uri = s.open(path, text)
            for item in s.ask("textDocument/documentSymbol", {"textDocument": {"uri": uri}}):
                if item["kind"] != 13 or len([f for f in text.split("\n") if f.startswith("shader ")]) > 1:
                    continue
                got = s.ask("textDocument/hover", {"textDocument": {"uri": uri}, "position": item["selectionRange"]["start"]})
                reached = "A gradient reaches this" in got["contents"]["value"]
                self.assertEqual(item["name"] not in without, reached, (path, item["name"], without.get(item["name"]), got["contents"]["value"]))
                asked += 1
            s.shutdown()
        self.assertGreater(asked, 6)


if __name__ == "__main__":
    unittest.main()
