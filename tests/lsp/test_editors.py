"""The files of editors: their lists of words are the compiler's; where the editors are there, they load them."""
import json
import re
import shutil
import subprocess
import tempfile
import unittest
from pathlib import Path

from client import ROOT, SOURCES, Case

EDITORS = ROOT / "bindings" / "editors"
CONTROL = {"if", "else", "for", "while", "do", "switch", "case", "default", "break", "continue", "return"}
BOOLEAN = {"true", "false"}
PROGRAM = '''import sdf;
/* a block
   of it */
[Range(0.0, 1.5e3)] param float a = .5; // a comment
[Disc] if (d < 0.0) c[i] = lerp(c, PI, float3(0x1Fu));
import_me(return_it, "text \\" [Disc]");
'''


class Words(Case):
    def setUp(self):
        s = self.server()
        uri = s.open("/nowhere/words.salt", "")
        items = s.at("completion", uri, "", 0)
        kind = {k: {i["label"] for i in items if i["kind"] == k} for k in (3, 14, 21, 25)}
        uri = s.open("/nowhere/attributes.salt", "[")
        self.attributes = {i["label"] for i in s.at("completion", uri, "[", 1)}
        self.keywords, self.types = kind[14], kind[25]
        self.constants = {w for w in kind[21] if w.isupper()}
        self.functions = kind[3] | (kind[21] - self.constants)
        self.assertTrue(self.keywords and self.types and self.constants and kind[3] and self.attributes)

    def test_textmate(self):
        rules = {}
        grammar = json.loads((EDITORS / "saltus.tmLanguage.json").read_text())
        for rule in grammar["repository"]["words"]["patterns"] + grammar["repository"]["attributes"]["patterns"]:
            found = re.match(r"\\b\(([\w|]+)\)\\b", rule.get("match", ""))
            if found:
                rules[rule["name"]] = set(found[1].split("|"))
        self.assertEqual(self.keywords & CONTROL, rules["keyword.control.saltus"])
        self.assertEqual(self.keywords - CONTROL - BOOLEAN, rules["keyword.other.saltus"])
        self.assertEqual(BOOLEAN, rules["constant.language.saltus"])
        self.assertEqual(self.types, rules["storage.type.saltus"])
        self.assertEqual(self.constants, rules["support.constant.saltus"])
        self.assertEqual(self.functions, rules["support.function.saltus"])
        self.assertEqual(self.attributes, rules["entity.other.attribute-name.saltus"])

    def test_vim(self):
        groups = {}
        for group, words in re.findall(r"^syn keyword (\w+) (.*)$", (EDITORS / "vim/syntax/saltus.vim").read_text(), re.M):
            groups.setdefault(group, set()).update(set(words.split()) - {"contained"})
        self.assertEqual(self.keywords, groups["saltusStatement"] | groups["saltusStorage"] | groups["saltusBoolean"])
        self.assertEqual(self.types, groups["saltusType"])
        self.assertEqual(self.constants, groups["saltusConstant"])
        self.assertEqual(self.functions, groups["saltusFunction"])
        self.assertEqual(self.attributes, groups["saltusAttribute"])

    def test_emacs(self):
        lists = {}
        for name, words in re.findall(r"\(defconst saltus-(\w+)\s+'\(([^)]*)\)\)", (EDITORS / "emacs/saltus-mode.el").read_text()):
            lists[name] = set(re.findall(r'"(\w+)"', words))
        self.assertEqual(self.keywords | self.constants, lists["keywords"] | lists["constants"])
        self.assertEqual(self.types, lists["types"])
        self.assertEqual(self.functions, lists["functions"])
        self.assertEqual(self.attributes, lists["attributes"])


class Editors(Case):
    def test_visual_studio_code(self):
        package = json.loads((EDITORS / "vscode/package.json").read_text())
        json.loads((EDITORS / "vscode/language-configuration.json").read_text())
        self.assertEqual([".salt"], package["contributes"]["languages"][0]["extensions"])
        self.assertEqual(["saltus", "lsp"], package["contributes"]["configuration"]["properties"]["saltus.command"]["default"])
        if not shutil.which("node"):
            self.skipTest("node is not installed")
        done = subprocess.run(["node", "--check", str(EDITORS / "vscode/extension.js")], capture_output=True, text=True)
        self.assertEqual(0, done.returncode, done.stderr)

    def scopes(self, text):
        done = subprocess.run(["node", str(Path(__file__).parent / "grammar.js"), str(EDITORS / "saltus.tmLanguage.json")], input=text,
                              capture_output=True, text=True)
        self.assertEqual(0, done.returncode, done.stderr)
        return [json.loads(l) for l in done.stdout.splitlines()]

    def test_the_grammar_in_its_engine(self):
        if not shutil.which("node") or subprocess.run(["node", "-e", "require('vscode-textmate'); require('vscode-oniguruma')"], capture_output=True).returncode:
            self.skipTest("npm's vscode-textmate and vscode-oniguruma are not where node looks (NODE_PATH)")
        got = {}
        for text, scopes in self.scopes(PROGRAM):
            got.setdefault(text.strip(), scopes[1:])
        for text, scope in [("import", "keyword.other"), ("sdf", "entity.name.namespace"), ("/*", "comment.block"), ("of it", "comment.block"), ("Range", "entity.other.attribute-name"),
                            ("1.5e3", "constant.numeric.float"), ("param", "keyword.other"), ("float", "storage.type"), (".5", "constant.numeric.float"), ("// a comment", "comment.line"),
                            ("Disc", "entity.other.attribute-name"), ("if", "keyword.control"), ("lerp", "support.function"), ("PI", "support.constant"), ("float3", "storage.type"),
                            ("0x1Fu", "constant.numeric.hex"), ("import_me", "entity.name.function"), ("\\\"", "constant.character.escape")]:
            self.assertTrue(any(s.startswith(scope) for s in got.get(text, [])), (text, got.get(text)))
        self.assertFalse([t for t, s in got.items() if t.startswith("c[i]") and "meta.attribute.saltus" in s])
        ends = self.scopes("".join(Path(p).read_text() + "\nimport the_end;\n" for p in SOURCES))
        ends = [scopes for text, scopes in ends if text == "the_end"]  # nothing runs on beyond the end of a file
        self.assertEqual([["source.saltus", "entity.name.namespace.saltus"]] * len(SOURCES), ends)

    def test_vim_loads_its_files(self):
        if not shutil.which("vim") or "+syntax" not in subprocess.run(["vim", "--version"], capture_output=True, text=True).stdout:
            self.skipTest("a vim with syntax is not installed")
        path = [p for p in SOURCES if p.endswith("/circle.salt")][0]
        with tempfile.TemporaryDirectory() as folder:
            out = folder + "/out"
            ask = [f'echo synIDattr(synID(search("{w}"),col("."),1),"name")' for w in ("shader", "float", r"\[Disc", "Disc", "//")]
            commands = ["syntax on", "filetype plugin indent on", "e " + path, f"redir! > {out}", "echo &filetype &commentstring", *ask, "echo v:errmsg", "redir END", "qa!"]
            (Path(folder) / "ask.vim").write_text("\n".join(commands))
            subprocess.run(["vim", "-es", "-N", "-u", "NONE", "-i", "NONE", "--cmd", f"set rtp^={EDITORS}/vim", "-S", folder + "/ask.vim"], stdin=subprocess.DEVNULL, capture_output=True, timeout=60)
            self.assertEqual(["saltus // %s", "saltusStorage", "saltusType", "saltusBracket", "saltusAttribute", "saltusComment"],
                             [l for l in Path(out).read_text().split("\n") if l])

    def test_emacs_loads_its_mode(self):
        if not shutil.which("emacs"):
            self.skipTest("emacs is not installed")
        path = [p for p in SOURCES if p.endswith("/circle.salt")][0]
        ask = """(progn (find-file "%s") (font-lock-ensure) (princ (format "%%s" major-mode))
                   (dolist (w '("shader" "float" "Disc" "// ")) (goto-char (point-min)) (let ((case-fold-search nil)) (search-forward w))
                     (princ (format " %%s" (get-text-property (- (point) 2) 'face))))
                   (let ((before (buffer-string))) (indent-region (point-min) (point-max)) (princ (format " %%s" (string= before (buffer-string))))))""" % path
        with tempfile.TemporaryDirectory() as folder:
            shutil.copy(EDITORS / "emacs/saltus-mode.el", folder)
            done = subprocess.run(["emacs", "-Q", "--batch", "-L", folder, "--eval", "(setq byte-compile-error-on-warn t)", "-f", "batch-byte-compile",
                                   folder + "/saltus-mode.el"], capture_output=True, text=True)
            self.assertEqual(0, done.returncode, done.stderr)
            done = subprocess.run(["emacs", "-Q", "--batch", "-L", folder, "-l", "saltus-mode", "--eval", ask], capture_output=True, text=True)
        self.assertEqual("saltus-mode font-lock-keyword-face font-lock-type-face font-lock-preprocessor-face font-lock-comment-delimiter-face t",
                         done.stdout, done.stderr)


if __name__ == "__main__":
    unittest.main()
