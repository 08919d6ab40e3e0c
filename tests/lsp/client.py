"""A client of `saltus lsp` for tests: messages, documents, places. Only the standard library is used."""
import glob
import json
import os
import select
import subprocess
import time
import unittest
from pathlib import Path
from urllib.parse import quote

BIN = os.environ.get("SALTUS_BIN", "saltus")
ROOT = Path(__file__).resolve().parent.parent.parent
HANGS = int(os.environ.get("LSP_HANGS", 600))  # seconds by the clock after which a server hangs, whatever else the machine does
SOURCES = sorted(glob.glob(str(ROOT / "examples" / "**" / "*.salt"), recursive=True)) + sorted(
    glob.glob(str(ROOT / "stdlib" / "*.salt")))


def uri_of(path):
    return "file://" + quote(str(path))


class Ended(Exception):
    """The server has closed its output."""


class Server:
    def __init__(self, *args, encodings=None, env=None, initialize=True):
        self.p = subprocess.Popen([BIN, "lsp", *args], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                  env=None if env is None else {**os.environ, **env})
        self.buffer = b""
        self.id = 0
        self.notes = []  # notifications not yet taken
        self.version = {}
        if initialize:
            capabilities = {"general": {"positionEncodings": encodings}} if encodings else {}
            self.capabilities = self.ask("initialize", {"processId": None, "rootUri": None, "capabilities": capabilities})
            self.tell("initialized", {})

    # -- frames
    def raw(self, data):
        self.p.stdin.write(data)
        self.p.stdin.flush()

    def send(self, message):
        body = json.dumps(message).encode()
        self.raw(b"Content-Length: %d\r\n\r\n" % len(body) + body)

    def read(self, seconds=HANGS):
        """The next message; None: none came in that time."""
        end = time.monotonic() + seconds
        while True:
            head = self.buffer.find(b"\r\n\r\n")
            if head >= 0:
                length = int(self.buffer[:head].split(b":")[1])
                if len(self.buffer) >= head + 4 + length:
                    body = self.buffer[head + 4:head + 4 + length]
                    self.buffer = self.buffer[head + 4 + length:]
                    return json.loads(body)
            left = end - time.monotonic()
            if left <= 0 or not select.select([self.p.stdout], [], [], left)[0]:
                return None
            data = os.read(self.p.stdout.fileno(), 1 << 20)
            if not data:
                raise Ended()
            self.buffer += data

    # -- messages
    def tell(self, method, params):
        self.send({"jsonrpc": "2.0", "method": method, "params": params})

    def request(self, method, params):
        self.id += 1
        self.send({"jsonrpc": "2.0", "id": self.id, "method": method, "params": params})
        return self.id

    def answer(self, ident):
        """The whole response to a request."""
        while True:
            m = self.read()
            assert m is not None, "no answer"
            if m.get("id") == ident and "method" not in m:
                return m
            self.notes.append(m)

    def ask(self, method, params):
        m = self.answer(self.request(method, params))
        assert "error" not in m, m
        return m["result"]

    # -- documents
    def open(self, path, text, language="saltus"):
        uri = path if ":" in str(path) else uri_of(path)
        self.version[uri] = 1
        self.tell("textDocument/didOpen", {"textDocument": {"uri": uri, "languageId": language, "version": 1, "text": text}})
        return uri

    def change(self, uri, *changes):
        self.version[uri] += 1
        self.tell("textDocument/didChange", {"textDocument": {"uri": uri, "version": self.version[uri]},
                                             "contentChanges": [c if isinstance(c, dict) else {"text": c} for c in changes]})

    def diagnostics(self, uri, version=None):
        """Those of the last version of the document: waits for them."""
        version = version or self.version[uri]
        while True:
            for k, m in enumerate(self.notes):
                if m.get("method") == "textDocument/publishDiagnostics" and m["params"]["uri"] == uri and \
                        m["params"].get("version") == version:
                    self.notes = [n for i, n in enumerate(self.notes) if i > k or n.get("params", {}).get("uri") != uri]
                    return m["params"]["diagnostics"]
            m = self.read()
            assert m is not None, "no diagnostics"
            self.notes.append(m)

    def diagnostics_again(self, uri):
        """The same once more, of an edit that changes nothing."""
        self.change(uri, {"range": {"start": {"line": 0, "character": 0}, "end": {"line": 0, "character": 0}}, "text": ""})
        return self.diagnostics(uri)

    def at(self, method, uri, text, mark, offset=0, **more):
        """A request about the place where `mark` stands in the text, offset characters on."""
        return self.ask("textDocument/" + method, {"textDocument": {"uri": uri}, "position": place(text, mark, offset), **more})

    def hover(self, uri, text, mark, offset=0):
        got = self.at("hover", uri, text, mark, offset)
        return got and got["contents"]["value"]

    # -- the end
    def shutdown(self):
        self.ask("shutdown", None)
        self.tell("exit", None)
        return self.wait()

    def wait(self):
        self.p.stdin.close()
        while True:
            try:
                if self.read() is None:
                    break
            except Ended:
                break
        code = self.p.wait(HANGS)
        self.errors = self.p.stderr.read().decode(errors="replace")
        self.p.stdout.close()
        self.p.stderr.close()
        return code


def place(text, mark, offset=0):
    at = mark if isinstance(mark, int) else text.index(mark)
    return position(text, at + offset)


def position(text, at):
    """UTF-16 units, as the protocol counts without negotiation; lines end in LF, CR LF or CR."""
    before = text[:at]
    ends = before.count("\n") + before.count("\r") - before.count("\r\n")
    start = max(before.rfind("\n"), before.rfind("\r")) + 1
    return {"line": ends, "character": len(text[start:at].encode("utf-16-le")) // 2}


def whole(text, at):
    """The place itself, or the one before a CR LF that it would cut, which no client can name."""
    return at - 1 if text[at - 1:at + 1] == "\r\n" else at


class Case(unittest.TestCase):
    def server(self, *args, **more):
        s = Server(*args, **more)
        self.addCleanup(lambda: s.p.poll() is None and (s.p.kill(), s.p.wait()))
        for stream in (s.p.stdin, s.p.stdout, s.p.stderr):
            self.addCleanup(stream.close)
        return s
