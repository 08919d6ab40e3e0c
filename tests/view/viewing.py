"""A viewer that runs for a test, and what asks it. The standard library only."""
import http.client
import json
import os
import re
import signal
import socket
import sys
import threading
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "cli"))
import harness
from harness import CIRCLE, HANGS


class Answer:
    def __init__(self, status, headers, body):
        self.status, self.headers, self.body = status, headers, body

    @property
    def json(self):
        return json.loads(self.body)


class Stream(threading.Thread):
    """The events of /events, as (name, data), in order."""

    def __init__(self, viewer):
        super().__init__(daemon=True)
        self.events, self.ended = [], False
        self.connection = http.client.HTTPConnection("127.0.0.1", viewer.port, timeout=HANGS)
        self.connection.request("GET", "/events?token=" + viewer.token)
        self.response = self.connection.getresponse()
        self.start()

    def run(self):
        name = None
        try:
            for line in self.response:
                line = line.decode().rstrip("\n")
                if line.startswith("event: "):
                    name = line[7:]
                elif line.startswith("data: "):
                    self.events.append((name, json.loads(line[6:])))
        except (OSError, ValueError, AttributeError):
            pass
        self.ended = True

    def of(self, name):
        return [data for n, data in list(self.events) if n == name]


class Viewer:
    def __init__(self, case, *args, env=None):
        self.process = case.start_cli("view", *args, "--json", env=env)
        line = self.process.stdout.readline()
        if not line:
            raise AssertionError(self.process.stderr.read().decode())
        at = json.loads(line)
        self.url, self.port, self.token = at["url"], at["port"], at["token"]
        # Standard error is read, so that the viewer never waits for it.
        self.said = []
        self.reader = threading.Thread(target=lambda: self.said.extend(self.process.stderr), daemon=True)
        self.reader.start()
        self.connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=HANGS)

    def ask(self, method, path, body=None, headers=None, token=True):
        if isinstance(body, (dict, list)):
            body = json.dumps(body)
        if method == "POST" and body is None:
            body = ""
        sent = {"X-Saltus-Token": self.token} if token else {}
        sent.update(headers or {})
        try:
            self.connection.request(method, path, body=body, headers=sent)
            r = self.connection.getresponse()
            return Answer(r.status, r.headers, r.read())
        finally:
            if "r" not in locals() or r.headers.get("Connection") == "close":
                self.connection.close()

    def get(self, path, **kw):
        return self.ask("GET", path, **kw)

    def post(self, path, body=None, **kw):
        return self.ask("POST", path, body, **kw)

    def raw(self, data, wait=True):
        """What comes back for bytes on a connection of their own, until the server closes it."""
        s = socket.create_connection(("127.0.0.1", self.port), timeout=HANGS)
        try:
            s.sendall(data)
            out = b""
            while wait:
                got = s.recv(65536)
                if not got:
                    break
                out += got
            return out
        except ConnectionError:
            return out
        finally:
            s.close()

    @property
    def state(self):
        return self.get("/state").json

    def wait(self, condition, seconds=HANGS):
        """Until condition(state) holds, which is returned."""
        end = time.monotonic() + seconds
        while True:
            state = self.state
            if condition(state):
                return state
            assert time.monotonic() < end, state
            time.sleep(0.02)

    def memory(self):
        with open("/proc/%d/status" % self.process.pid) as f:
            return int(re.search(r"VmRSS:\s*(\d+)", f.read()).group(1)) * 1024

    def end(self, sig=signal.SIGINT):
        """Its exit status."""
        self.connection.close()
        if self.process.poll() is None and sig:
            self.process.send_signal(sig)
        status = self.process.wait(HANGS)
        self.reader.join(HANGS)
        self.process.stdout.close()
        self.process.stderr.close()
        return status


class Case(harness.Case):
    source = CIRCLE

    def setUp(self):
        super().setUp()
        self.viewers = []

    def tearDown(self):
        for v in self.viewers:
            status = v.end()
            text = b"".join(v.said).decode(errors="replace")
            self.assertNotIn("Sanitizer", text)
            self.assertIn(status, (0, 2, 6, 130), text)
        super().tearDown()

    def environment(self, env=None):
        e = super().environment(env)
        if os.environ.get("SALTUS_SANITIZE") == "thread":  # which does not see how LLVM locks its own
            e["TSAN_OPTIONS"] = "suppressions=" + self.path(self.put("llvm.txt", "race:libLLVM\n"))
        return e

    def view(self, *args, source=None, name="a.salt", env=None):
        self.put(name, source or self.source)
        v = Viewer(self, name, *args, env=env)
        self.viewers.append(v)
        return v
