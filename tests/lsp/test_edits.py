"""Half-typed files: prefixes of all shipped sources, random edits, junk. `edits.py` in the build's target `lsp-edits` runs all of
them: LSP_PREFIXES=1 (every prefix), LSP_EDITS=100000."""
import os
import random
import unittest

from client import SOURCES, Case, position, whole

STRIDE = int(os.environ.get("LSP_PREFIXES", 97))  # every so many bytes
EDITS = int(os.environ.get("LSP_EDITS", 1500))
WORDS = ["[Disc] ", "if (", "float3 ", "param ", "x.", "}", "{", ")", "(", ";", "\n", " ", "1.0", "for (int i = 0; i < 9; i++) ", "/*", "*/", "//", '"', "[",
         "]", "struct S { float a; };\n", "import sdf;\n", "import nothing;", "shader float m(float2 x) { return x.x; }\n", "\u00e9", "\U0001f600", "\0", "\r\n",
         "= init(f);", "while (true) ", "[MaxIters(9)] ", "const int N = 1000000000;", "float a[N][N];", "a = a;", "0x", "1e", "#", "\\", "typedef float F[3];"]


def text_of(path):
    with open(path, encoding="utf-8", newline="") as f:
        return f.read()


class Prefixes(Case):
    def test_every_source_can_be_typed(self):
        s = self.server()
        for path in SOURCES:
            text = text_of(path)
            uri = s.open(path, "")
            s.diagnostics(uri)
            last = 0
            for end in list(range(STRIDE, len(text), STRIDE)) + [len(text)]:
                at = position(text, last)
                s.change(uri, {"range": {"start": at, "end": at}, "text": text[last:end]})
                last = end
                for d in s.diagnostics(uri):
                    self.assertNotIn(d.get("code"), ("internal", "limit"), (path, end, d))
            self.assertEqual([], [d for d in s.diagnostics_again(uri) if d["severity"] == 1], path)
            s.tell("textDocument/didClose", {"textDocument": {"uri": uri}})
        self.assertEqual(0, s.shutdown(), s.errors)


def edit(rng, text):
    """(start, end, new) of a random change."""
    n = len(text)
    at = rng.randrange(n + 1)
    kind = rng.random()
    if kind < 0.35:
        return at, min(n, at + 1 + int(rng.expovariate(0.2))), ""
    if kind < 0.75:
        return at, at, rng.choice(WORDS)
    if kind < 0.85:
        other = rng.randrange(n + 1)
        return at, at, text[other:other + rng.randrange(60)]
    if kind < 0.97:
        return at, min(n, at + rng.randrange(4)), "".join(chr(rng.randrange(32, 127)) for _ in range(rng.randrange(1, 5)))
    return at, min(n, at + rng.randrange(400)), ""


class Edits(Case):
    def test_random_edits_end_nothing(self):
        rng = random.Random(7)
        s = self.server()
        sources = [text_of(p) for p in SOURCES]
        done = 0
        while done < EDITS:
            text = rng.choice(sources)
            uri = s.open(f"/nowhere/{rng.randrange(6)}.salt", text)
            for _ in range(min(60, EDITS - done)):
                done += 1
                start, end, new = edit(rng, text)
                start, end = whole(text, start), whole(text, end)
                s.change(uri, {"range": {"start": position(text, start), "end": position(text, end)}, "text": new})
                text = text[:start] + new + text[end:]
                if done % 4 == 0:
                    for d in s.diagnostics(uri):
                        self.assertNotEqual("internal", d.get("code"), (done, d, text))
                if done % 7 == 0:
                    what = rng.choice(["hover", "completion", "definition", "references", "signatureHelp", "documentHighlight"])
                    s.at(what, uri, text, rng.randrange(len(text) + 1))
                if done % 31 == 0:
                    s.ask("textDocument/documentSymbol", {"textDocument": {"uri": uri}})
                    s.ask("textDocument/formatting", {"textDocument": {"uri": uri}, "options": {}})
            told = s.diagnostics_again(uri)
            s.change(uri, text)  # the whole text: the server's was the same
            self.assertEqual(told, s.diagnostics(uri))
            s.tell("textDocument/didClose", {"textDocument": {"uri": uri}})
        self.assertEqual(0, s.shutdown(), s.errors)

    def test_binary_junk_and_odd_files(self):
        rng = random.Random(3)
        s = self.server()
        for text in ["", "\0", "\ufeff", "\ufeffshader float main(float2 x) { return x.x; }", "\r", "{" * 10000, "(" * 10000, "a.b" * 5000,
                     "".join(chr(rng.randrange(1, 0xd000)) for _ in range(5000)), "float f(float x) { return f(f(x)); }\n" * 200,
                     "const int A = B; const int B = A;", "import a;\nimport a;", "[" * 500, "/*" * 100, '"' * 101, "x" * 100000]:
            uri = s.open("/nowhere/junk.salt", text)
            for d in s.diagnostics(uri):
                self.assertNotEqual("internal", d.get("code"), (d, text[:60]))
            s.at("hover", uri, text, len(text) // 2)
            s.at("completion", uri, text, len(text) // 2)
            s.ask("textDocument/formatting", {"textDocument": {"uri": uri}, "options": {}})
        self.assertEqual(0, s.shutdown(), s.errors)

    def test_a_file_beyond_the_limit_is_told(self):
        s = self.server()
        uri = s.open("/nowhere/huge.salt", "// " + "x" * (17 << 20))
        told = s.diagnostics(uri)
        self.assertEqual(1, len(told))
        self.assertEqual(1, told[0]["severity"])
        self.assertEqual(0, s.shutdown(), s.errors)


if __name__ == "__main__":
    unittest.main()
