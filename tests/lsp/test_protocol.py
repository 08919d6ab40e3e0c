"""The protocol: frames, order, exit statuses, what must not end the server."""
import glob
import os
import signal
import subprocess
import tempfile
import time
import unittest
from pathlib import Path

from client import BIN, SOURCES, Case, uri_of

GOOD = "shader float main(float2 x) { return x.x; }\n"
BAD = "shader float main(float2 x) { return y; }\n"
# Some seconds of work: 2^13 copies of f0.
SLOW = "param float a = 0.5;\nfloat f0(float x) { if (x < a) return sin(x); return x; }\n" + "".join(
    f"float f{i}(float x) {{ return f{i - 1}(x) * f{i - 1}(x + {i}.0); }}\n" for i in range(1, 14)) + "shader float main(float2 x) { return f13(x.x); }\n"


class Lifecycle(Case):
    def test_shutdown_and_exit_end_with_0(self):
        s = self.server()
        self.assertEqual(0, s.shutdown())
        self.assertEqual("", s.errors)

    def test_exit_without_shutdown_ends_with_1(self):
        s = self.server()
        s.tell("exit", None)
        self.assertEqual(1, s.wait())

    def test_the_end_of_the_input_is_an_exit(self):
        self.assertEqual(1, self.server().wait())
        s = self.server()
        s.ask("shutdown", None)
        self.assertEqual(0, s.wait())

    def test_nothing_before_initialize_nor_after_shutdown(self):
        s = self.server(initialize=False)
        self.assertEqual(-32002, s.answer(s.request("textDocument/hover", {}))["error"]["code"])
        s.ask("initialize", {"capabilities": {}})
        self.assertEqual(-32600, s.answer(s.request("initialize", {}))["error"]["code"])
        s.ask("shutdown", None)
        self.assertEqual(-32600, s.answer(s.request("textDocument/hover", {}))["error"]["code"])
        s.tell("exit", None)
        self.assertEqual(0, s.wait())

    def test_what_is_offered_is_answered(self):
        s = self.server()
        offered = s.capabilities["capabilities"]
        uri = s.open("/nowhere/a.salt", GOOD)
        for name in offered:
            if not name.endswith("Provider"):
                continue
            method = name[:-len("Provider")].replace("documentFormatting", "formatting")
            params = {"textDocument": {"uri": uri}, "position": {"line": 0, "character": 1}, "options": {}, "context": {}}
            if method not in ("signatureHelp", "completion", "documentSymbol", "documentHighlight", "formatting"):
                method = {"references": "references", "hover": "hover", "definition": "definition"}[method]
            self.assertIn("result", s.answer(s.request("textDocument/" + method, params)), name)

    def test_it_says_a_file_is_not_for_it(self):
        done = subprocess.run([BIN, "lsp", "a.salt"], capture_output=True, text=True)
        self.assertEqual(2, done.returncode)
        self.assertIn("takes no FILE", done.stderr)
        self.assertEqual(0, self.server("--stdio").shutdown())


class Messages(Case):
    def test_faults_of_messages_are_told_and_survived(self):
        s = self.server()
        for body, code in [(b"{", -32700), (b"[1,2", -32700), (b'"text"', -32700), (b'{"jsonrpc":"2.0"}', -32600), (b"[]", -32600), (b"\xff\xfe", -32700),
                           (b'{"id":7,"method":"nothing/known"}', -32601), (b'{"id":8,"method":"textDocument/hover"}', -32602),
                           (b'{"id":9,"method":"textDocument/hover","params":{"textDocument":{"uri":"file:///not/open"}}}', -32602)]:
            s.raw(b"Content-Length: %d\r\n\r\n%s" % (len(body), body))
            self.assertEqual(code, s.read()["error"]["code"], body)
        for body in [b'{"method":"nothing/known"}', b'{"id":1,"result":null}', b'{"method":"textDocument/didChange"}', b'{"method":"textDocument/didOpen","params":[]}',
                     b'{"method":"textDocument/didChange","params":{"textDocument":{"uri":"file:///x"},"contentChanges":[7]}}', b'{"method":"$/cancelRequest"}']:
            s.raw(b"Content-Length: %d\r\n\r\n%s" % (len(body), body))
        self.assertEqual(0, s.shutdown())

    def test_headers_in_any_form_and_in_pieces(self):
        s = self.server()
        body = b'{"id":"a","method":"nothing"}'
        for head in [b"content-length: %d\r\nContent-Type: application/vscode-jsonrpc; charset=utf-8\r\n\r\n", b"Content-Type: x\r\nContent-Length:%d\r\n\r\n"]:
            for byte in head % len(body) + body:
                s.raw(bytes([byte]))
            self.assertEqual("a", s.read()["id"])

    def test_a_header_without_a_length_ends_with_4(self):
        for head in [b"Content-Type: x\r\n\r\n{}", b"Content-Length: many\r\n\r\n{}", b"x" * 20000]:
            s = self.server()
            s.raw(head)
            self.assertEqual(-32700, s.read()["error"]["code"])
            self.assertEqual(4, s.wait())

    def test_a_message_beyond_the_limit_is_skipped(self):
        s = self.server()
        n = (64 << 20) + 1
        s.raw(b"Content-Length: %d\r\n\r\n" % n)
        for _ in range(n >> 20):
            s.raw(b" " * (1 << 20))
        s.raw(b" " * (n & ((1 << 20) - 1)))
        self.assertIn("64 MiB", s.read()["error"]["message"])
        self.assertEqual(0, s.shutdown())

    def test_a_closed_output_ends_it(self):
        s = self.server()
        s.p.stdout.close()
        s.send({"id": 1, "method": "nothing"})
        self.assertEqual(5, s.p.wait(60))


class Jobs(Case):
    def children(self, s):
        return [int(c) for f in glob.glob(f"/proc/{s.p.pid}/task/*/children") for c in Path(f).read_text().split()]

    def slow(self, s):
        uri = s.open("/nowhere/slow.salt", SLOW)
        end = time.monotonic() + 60
        while time.monotonic() < end and not self.children(s):
            time.sleep(0.001)
        return uri

    def test_a_crash_of_an_analysis_is_a_message(self):
        s = self.server()
        uri = self.slow(s)
        for child in self.children(s):
            os.kill(child, signal.SIGKILL)  # which no sanitizer makes an exit of
        told = s.diagnostics(uri)
        self.assertEqual([("internal", 1)], [(d["code"], d["severity"]) for d in told])
        self.assertIn("signal 9", told[0]["message"])
        s.change(uri, GOOD)
        self.assertEqual([], s.diagnostics(uri))
        self.assertEqual(0, s.shutdown())

    def test_answers_come_about_as_they_were_asked(self):
        """What takes longer may come later; what is ready together comes in order (it came last first)."""
        s = self.server()
        uri = s.open("/x/a.salt", GOOD)
        asked, got = [], []
        for i in range(100):
            s.change(uri, GOOD + "//%d" % i)
            asked.append(s.request("textDocument/hover", {"textDocument": {"uri": uri}, "position": {"line": 0, "character": 37}}))
        while len(got) < len(asked):
            m = s.read()
            got += [m["id"]] if "id" in m and "method" not in m else []
        self.assertEqual(sorted(got), asked)
        self.assertLess(sum(b < a for a, b in zip(got, got[1:])), 40)

    def test_a_request_can_be_cancelled(self):
        s = self.server()
        uri = self.slow(s)
        ident = s.request("textDocument/hover", {"textDocument": {"uri": uri}, "position": {"line": 0, "character": 15}})
        s.tell("$/cancelRequest", {"id": ident})
        s.tell("$/cancelRequest", {"id": 12345})
        self.assertIn(s.answer(ident).get("error", {}).get("code"), (-32800, None))
        self.assertEqual(0, s.shutdown())

    def test_an_edit_ends_the_analysis_of_what_was(self):
        s = self.server()
        uri = self.slow(s)
        s.change(uri, BAD)
        self.assertEqual(1, len(s.diagnostics(uri)))
        self.assertFalse([m for m in s.notes if m["params"].get("version") == 1])

    def test_no_child_is_left(self):
        s = self.server()
        self.slow(s)
        children = self.children(s)
        self.assertEqual(0, s.shutdown())
        for child in children:
            self.assertFalse(os.path.exists(f"/proc/{child}"))

    @unittest.skipIf("address" in os.environ.get("SALTUS_SANITIZE", ""), "the sanitizer's run time opens libraries of its own")
    def test_llvm_is_never_loaded(self):
        """Neither by the server nor by a job: the loader's own log names what it opens."""
        with tempfile.TemporaryDirectory() as folder:
            s = self.server(env={"LD_DEBUG": "files", "LD_DEBUG_OUTPUT": folder + "/log"})
            path = [p for p in SOURCES if p.endswith("/circle.salt")][0]
            text = Path(path).read_text()
            uri = s.open(path, text)
            s.diagnostics(uri)
            for what in ["hover", "definition", "references", "documentHighlight", "completion", "signatureHelp"]:
                s.at(what, uri, text, "radius")
            s.ask("textDocument/documentSymbol", {"textDocument": {"uri": uri}})
            s.ask("textDocument/formatting", {"textDocument": {"uri": uri}, "options": {}})
            maps = Path(f"/proc/{s.p.pid}/maps").read_text()
            self.assertIn("saltus", maps)
            self.assertNotIn("LLVM", maps)
            self.assertEqual(0, s.shutdown())
            logs = "".join(Path(f).read_text() for f in glob.glob(folder + "/log*"))
            self.assertIn("libjansson", logs)
            self.assertNotIn("libLLVM", logs)


class Places(Case):
    TEXT = "// \u00e4\u20ac\U0001f600\n/* \U0001f600\U0001f600 */ const int N = zzz;\r\nconst int M = yyy;\rconst int L = xxx;\n"

    def columns(self, *args, **more):
        s = self.server(*args, **more)
        uri = s.open("/nowhere/p.salt", self.TEXT)
        return s, uri, [(d["range"]["start"]["line"], d["range"]["start"]["character"], d["range"]["end"]["character"]) for d in s.diagnostics(uri)]

    def test_places_are_utf_16_units(self):
        s, uri, at = self.columns()
        self.assertEqual([(1, 25, 28), (2, 14, 17), (3, 14, 17)], at)
        s.change(uri, {"range": {"start": {"line": 1, "character": 25}, "end": {"line": 1, "character": 28}}, "text": "1"},
                 {"range": {"start": {"line": 3, "character": 14}, "end": {"line": 3, "character": 17}}, "text": "2"})
        self.assertEqual([2], [d["range"]["start"]["line"] for d in s.diagnostics(uri)])

    def test_or_bytes_where_the_client_offers_them(self):
        s, uri, at = self.columns(encodings=["utf-32", "utf-8", "utf-16"])
        self.assertEqual("utf-8", s.capabilities["capabilities"]["positionEncoding"])
        self.assertEqual([(1, 29, 32), (2, 14, 17), (3, 14, 17)], at)
        s.change(uri, {"range": {"start": {"line": 1, "character": 29}, "end": {"line": 1, "character": 32}}, "text": "1"})
        self.assertEqual([2, 3], [d["range"]["start"]["line"] for d in s.diagnostics(uri)])

    def test_places_beyond_the_text_are_its_end(self):
        s = self.server()
        uri = s.open("/nowhere/q.salt", GOOD)
        far = {"line": 9999, "character": 4294967295}
        s.change(uri, {"range": {"start": far, "end": far}, "text": "const int N = zzz;"})
        self.assertEqual([(1, 14)], [(d["range"]["start"]["line"], d["range"]["start"]["character"]) for d in s.diagnostics(uri)])
        s.change(uri, {"range": {"start": {"line": -1, "character": -5}, "end": {"line": 0, "character": 0}}, "text": "\n"})
        self.assertEqual(2, s.diagnostics(uri)[0]["range"]["start"]["line"])


class Documents(Case):
    def test_imports_are_read_beside_the_file_and_from_buffers(self):
        with tempfile.TemporaryDirectory() as folder:
            folder = os.path.realpath(folder)
            main, part = folder + "/main.salt", folder + "/part.salt"
            text = "import part;\nshader float main(float2 x) { return f(x.x); }\n"
            s = self.server()
            uri = s.open(main, text)
            self.assertEqual(["E0020"], [d["code"] for d in s.diagnostics(uri)])
            Path(part).write_text("float f(float v) { return v; }\n")
            s.tell("workspace/didChangeWatchedFiles", {"changes": [{"uri": uri_of(part), "type": 1}]})
            self.assertEqual([], s.diagnostics(uri))
            # what is open and not saved counts, and its importers hear of it
            other = s.open(part, "float g(float v) { return v; }\n")
            self.assertEqual([], s.diagnostics(other))
            self.assertIn("`f`", s.diagnostics(uri)[0]["message"])
            s.change(other, "float f(float v) { return w; }\n")
            self.assertEqual(1, len(s.diagnostics(other)))
            s.tell("textDocument/didClose", {"textDocument": {"uri": other}})
            self.assertEqual([], s.diagnostics(uri))

    def test_an_error_in_an_import_is_told_there(self):
        with tempfile.TemporaryDirectory() as folder:
            folder = os.path.realpath(folder)
            Path(folder + "/part.salt").write_text("float f(float v) { return w; }\n")
            s = self.server()
            uri = s.open(folder + "/main.salt", "import part;\nshader float main(float2 x) { return f(x.x); }\n")
            self.assertEqual([], s.diagnostics(uri))
            there = [m["params"] for m in s.notes if m["params"]["uri"] == uri_of(folder + "/part.salt")]
            while not there:
                there = [m["params"] for m in [s.read()] if m["params"]["uri"] == uri_of(folder + "/part.salt")]
            self.assertEqual(1, len(there[0]["diagnostics"]))
            s.change(uri, GOOD)
            s.diagnostics(uri)
            m = s.read()
            self.assertEqual((uri_of(folder + "/part.salt"), []), (m["params"]["uri"], m["params"]["diagnostics"]))

    def test_include_folders_and_constants_of_the_command_line(self):
        with tempfile.TemporaryDirectory() as folder:
            Path(folder + "/part.salt").write_text("const int K = 2;\n")
            s = self.server("-I", folder, "--set", "N=7")
            text = "import part;\nconst int N = 3;\nshader float main(float2 x) { return x.x * K * N; }\n"
            uri = s.open("/nowhere/i.salt", text)
            self.assertEqual([], s.diagnostics(uri))
            self.assertIn("N = 7", s.hover(uri, text, "N = 3"))

    def test_a_module_without_a_shader_and_a_file_with_several_are_well(self):
        s = self.server()
        self.assertEqual([], s.diagnostics(s.open("/nowhere/m.salt", "float f(float x) { return x; }\n")))
        two = "param float a = 0.5;\nshader float one(float2 x) { return x.x; }\nshader float two(float2 x) { if (x.x < a) return 1.0; return 0.0; }\n"
        told = s.diagnostics(s.open("/nowhere/t.salt", two))
        self.assertEqual(["W0401"], [d["code"] for d in told]) # of the second shader too

    def test_glsl_is_diagnosed_in_its_own_words(self):
        s = self.server()
        uri = s.open("/nowhere/a.frag", "void mainImage(out vec4 c, in vec2 p) { c = vec4(p, 0.0, q); }\n", "glsl")
        told = s.diagnostics(uri)
        self.assertEqual([(1, 0)], [(d["severity"], d["range"]["start"]["line"]) for d in told])
        self.assertIn("`q`", told[0]["message"])
        self.assertIsNone(s.at("hover", uri, "void", 0))
        s.change(uri, "void mainImage(out vec4 c, in vec2 p) { c = vec4(p, 0.0, 1.0); }\n")
        self.assertEqual([], [d for d in s.diagnostics(uri) if d["severity"] == 1])

    def test_untitled_documents_work(self):
        s = self.server()
        uri = s.open("untitled:Untitled-1", BAD)
        self.assertEqual(1, len(s.diagnostics(uri)))
        s.change(uri, GOOD)
        self.assertEqual([], s.diagnostics(uri))


if __name__ == "__main__":
    unittest.main()
