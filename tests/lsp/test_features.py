"""What the server says of a document: hover, definitions, references, completion, signatures, symbols."""
import re
import tempfile
import unittest
from pathlib import Path

from client import ROOT, Case, uri_of

TEXT = """import sdf;
// How many discs there are.
const int N = 3;
[Range(0.05, 0.9)] [Doc("half the width")] param float radius = 0.4;
[Log] param float3 ink = float3(0.9, 0.3, 0.1);   // linear light
param texture2D paper = zeros(4, 4);

// A disc, with
// its colour.
struct Disc {
    float2 at;   // its middle
    float r;
};
typedef float Weights[3];

float area(Disc d) { return PI * d.r * d.r; }
float area(float r) { return PI * r * r; }

[Domain(-1.0, 1.0)]
shader float3 main(float2 x) {
    Disc k = { float2(0.0, 0.0), radius };
    float3 c = float3(1.0);
    for (int i = 0; i < N; i++) {
        float d = sd_circle(x - k.at, k.r);
        [Disc] if (d < 0.0) c = lerp(c, ink, 0.5) * area(k) * area(k.r);
    }
    return c * paper.sample(x).rgb;
}
"""


def read_def(name):
    return (ROOT / "compiler" / "front" / name).read_text()


class Open(Case):
    def setUp(self):
        self.s = self.server()
        self.uri = self.s.open("/nowhere/f.salt", TEXT)
        self.assertEqual([], self.s.diagnostics(self.uri))

    def at(self, what, mark, offset=0, **more):
        return self.s.at(what, self.uri, TEXT, mark, offset, **more)

    def hover(self, mark, offset=0):
        return self.s.hover(self.uri, TEXT, mark, offset)

    def labels(self, text, at):
        uri = self.s.open("/nowhere/c.salt", text)
        return [i["label"] for i in self.s.at("completion", uri, text, at)]


class Hover(Open):
    def test_names(self):
        for mark, offset, parts in [
            ("radius =", 0, ["param float radius", "half the width", "Range 0.05 to 0.9"]),
            ("ink =", 1, ["param float3 ink", "linear light", "logarithmic"]),
            ("N = 3", 0, ["const int N = 3", "How many discs there are."]),
            ("Disc k", 0, ["struct Disc {\n    float2 at;\n    float r;\n}", "A disc, with\nits colour."]),
            ("k.at", 2, ["float2 Disc.at", "its middle"]),
            ("area(k)", 0, ["float area(Disc d)"]),
            ("area(k.r)", 0, ["float area(float r)"]),
            ("sd_circle", 0, ["float sd_circle(float2 p, float r)", "Disc of radius r about the origin"]),
            ("lerp", 0, ["floatN lerp(floatN a, floatN b, floatN t)", "a at t = 0"]),
            ("sample", 0, ["float4 texture2D.sample(float2 uv)", "Bilinear"]),
            ("sdf", 0, ["import sdf", "stdlib/sdf.salt"]),
            ("Weights", 0, ["typedef float[3] Weights"]),
            ("PI *", 0, ["const float PI", "3.14159"]),
            ("x - k.at", 0, ["float2 x"]),
            ("* area(k) ", 0, ["float3"]),
            ("i < N", 0, ["int i"]),
        ]:
            got = self.hover(mark, offset)
            for part in parts:
                self.assertIn(part, got or "", mark)

    def test_words(self):
        for mark, part in [("Disc] if", "jumps whose motion counts"), ("Range(", "[Range(lo, hi)]"), ("shader", "entry point"), ("for (", "trip count"),
                           ("float3(1.0)", "float3"), ("Domain", "box over which")]:
            self.assertIn(part, self.hover(mark) or "", mark)
        for mark in ["{ return PI", "= { float2"]:
            self.hover(mark)
        self.assertIsNone(self.hover("// A disc", 4))

    def test_every_builtin_method_attribute_and_keyword_has_a_line(self):
        """Rows of the compiler's tables, as completion lists them: the tables are the compiler's own."""
        items = {i["label"]: i for i in self.s.at("completion", self.uri, TEXT, "return c")}
        for name in re.findall(r'^BUILTIN\(\w+, "(\w+)"', read_def("check/builtins.def"), re.M):
            self.assertTrue(items[name].get("documentation"), name)
            self.assertIn(name + "(", items[name]["detail"], name)
        for name in re.findall(r'KEYWORD\([A-Z]+, "(\w+)"\)', read_def("parse/lex.h")):
            self.assertTrue(items[name].get("documentation"), name)
        attributes = {i["label"]: i for i in self.s.at("completion", self.uri, TEXT, "Disc] if")}
        self.assertEqual(set(re.findall(r'^    \[A_\w+\] = \{"(\w+)"', read_def("parse/attr.c"), re.M)), set(attributes))
        for a in attributes.values():
            self.assertTrue(a.get("documentation") and a.get("detail"), a)
        for row in re.findall(r"^METHOD\((\w+), (\w+), \"(\w+)\"", read_def("check/methods.def"), re.M):
            kind = {"TEXTURE": "texture2D", "TEXTURE3D": "texture3D", "HEIGHTFIELD": "heightfield", "MESH": "mesh"}[row[1]]
            text = f"float f({kind} t) {{ return t.; }}"
            self.assertIn(row[2], self.labels(text, text.index(".;") + 1), row)
        for name in re.findall(r"^OTHER_WORD\((\w+)", (ROOT / "cli/lsp/words.def").read_text(), re.M):
            if name.isupper():
                self.assertEqual([], self.s.diagnostics(self.s.open("/nowhere/w.salt", f"const float a = {name};\n")), name)


class Where(Open):
    def line(self, got):
        return got["uri"], got["range"]["start"]["line"]

    def test_definitions(self):
        sdf = uri_of(ROOT / "stdlib" / "sdf.salt")
        lines = (ROOT / "stdlib" / "sdf.salt").read_text().split("\n")
        for mark, offset, text in [("radius }", 0, "param float radius"), ("N; i++", 0, "const int N"), ("k.at", 0, "Disc k ="), ("k.at", 2, "float2 at"), ("Disc k", 0, "struct Disc"),
                                   ("area(k)", 0, "float area(Disc"), ("area(k.r)", 0, "float area(float"), ("d < 0.0", 0, "float d ="), ("x - k", 0, "shader float3 main"),
                                   ("ink, 0.5", 3, "param float3 ink")]:
            self.assertEqual((self.uri, next(n for n, l in enumerate(TEXT.split("\n")) if text in l)), self.line(self.at("definition", mark, offset)), mark)
        uri, line = self.line(self.at("definition", "sd_circle"))
        self.assertEqual(sdf, uri)
        self.assertIn("float sd_circle(", lines[line])
        self.assertEqual((sdf, 0), self.line(self.at("definition", "sdf;")))
        self.assertIsNone(self.at("definition", "lerp"))
        self.assertIsNone(self.at("definition", "// A disc"))

    def test_attributes_lead_to_their_functions(self):
        text = "float4 box(int i) { return float4(0.0); }\nfloat make(int i) { return 1.0; }\nparam float p[2] = init(make);\n" \
               "shader float main(float2 x) { float s = 0.0; [Cull(box)] for (int i = 0; i < 2; i++) s += p[i]; return s; }\n"
        uri = self.s.open("/nowhere/d.salt", text)
        self.assertEqual(0, self.s.at("definition", uri, text, "box)]")["range"]["start"]["line"])
        self.assertEqual(1, self.s.at("definition", uri, text, "make);")["range"]["start"]["line"])

    def test_references_and_highlights(self):
        self.assertEqual(2, len(self.at("references", "radius =")))
        self.assertEqual(1, len(self.at("references", "radius =", context={"includeDeclaration": False})))
        self.assertEqual(2, len(self.at("documentHighlight", "area(k)")))
        self.assertEqual(2, len(self.at("documentHighlight", "area(k.r)")))
        self.assertEqual(5, len(self.at("references", "r;\n};")))
        self.assertGreater(len({r["uri"] for r in self.at("references", "sd_circle")}), 1)

    def test_symbols(self):
        got = self.s.ask("textDocument/documentSymbol", {"textDocument": {"uri": self.uri}})
        self.assertEqual({"Disc", "Weights", "N", "radius", "ink", "paper", "area", "main"}, {g["name"] for g in got})
        self.assertEqual(["at", "r"], [c["name"] for g in got if g["name"] == "Disc" for c in g["children"]])
        for g in got:
            a, b = g["range"], g["selectionRange"]
            self.assertLessEqual((a["start"]["line"], a["start"]["character"]), (b["start"]["line"], b["start"]["character"]))
            self.assertGreaterEqual((a["end"]["line"], a["end"]["character"]), (b["end"]["line"], b["end"]["character"]))
        self.assertEqual("shader float3 main(float2 x)", next(g["detail"] for g in got if g["name"] == "main"))


class Completion(Open):
    def test_behind_a_dot(self):
        body = "struct S { float2 p; float q; };\nparam texture2D t = zeros(2, 2);\nfloat f(S s, float3 v, S a[2]) {\n    %s\n    return 1.0;\n}\n"
        for written, wanted in [("s.", ["p", "q"]), ("s.p", ["p", "q"]), ("float z = s.p.", ["x", "y", "r", "g"]), ("v.", list("xyzrgb")), ("a[1].", ["p", "q"]),
                                ("t.", ["sample", "nearest", "load", "size"]), ("a[int(v.x) + 0].p.", ["x", "y", "r", "g"]), ("float w = (v + v).", list("xyzrgb")),
                                ("if (s.", ["p", "q"]), ("return f(s, v.", list("xyzrgb")), ("1.", [])]:
            text = body % written
            got = self.labels(text, text.index(written) + len(written))
            self.assertEqual(sorted(wanted), sorted(got), written)

    def test_names_in_scope(self):
        got = self.labels(TEXT, TEXT.index("[Disc] if") + 12)
        self.assertEqual(["d", "i", "c", "k", "x"], got[:5])
        for name in ["radius", "N", "Disc", "Weights", "area", "sd_circle", "lerp", "PI", "float3", "for", "len"]:
            self.assertIn(name, got)
        self.assertNotIn("main", got)  # a shader cannot be called
        got = self.labels(TEXT, TEXT.index("return c"))
        self.assertNotIn("d", got)
        self.assertIn("c", got)
        self.assertNotIn("k", self.labels(TEXT, TEXT.index("return PI * d")))

    def test_attributes_modules_and_where_nothing_fits(self):
        for text in ["[", "[Disc, ", "[Disc] [", "[Ra", "shader float f(float2 x) {\n    [", "float a; ["]:
            self.assertIn("SkipLoop", self.labels(text, len(text)), text)
        for text in ["float f(float a[2]) { return a[", "const float x = v[1]["]:
            self.assertNotIn("SkipLoop", self.labels(text, len(text)), text)
        for text in ["// a ", "/* a ", "param texture2D t = \"a", "float f() { /* x */ // ", "float x = 12"]:
            self.assertEqual([], self.labels(text, len(text)), text)
        self.assertIn("float3", self.labels("/* a */ ", 8))
        with tempfile.TemporaryDirectory() as folder:
            Path(folder + "/own.salt").write_text("")
            uri = self.s.open(folder + "/main.salt", "import ")
            got = [i["label"] for i in self.s.at("completion", uri, "import ", 7)]
            self.assertIn("own", got)
            self.assertIn("sdf", got)

    def test_signatures(self):
        for mark, offset, label, active in [("(x - k.at", 1, "float sd_circle(float2 p, float r)", 0), ("k.r);\n", 0, "float sd_circle(float2 p, float r)", 1),
                                            ("ink, 0.5", 0, "floatN lerp(floatN a, floatN b, floatN t)", 1), ("(x).rgb", 1, "float4 texture2D.sample(float2 uv)", 0)]:
            got = self.at("signatureHelp", mark, offset)
            self.assertEqual((label, active), (got["signatures"][0]["label"], got["activeParameter"]), mark)
            for p in got["signatures"][0]["parameters"]:
                self.assertNotIn(",", label[p["label"][0]:p["label"][1]])
        self.assertEqual(2, len(self.at("signatureHelp", "(k) *", 1)["signatures"]))
        self.assertIsNone(self.at("signatureHelp", "float3 c"))


if __name__ == "__main__":
    unittest.main()
