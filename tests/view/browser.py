"""Chromium without a display, driven through its DevTools protocol: one page, by a WebSocket client of the standard library."""
import base64
import http.client
import json
import os
import re
import shutil
import socket
import struct
import subprocess
import tempfile
import time

CHROMIUM = shutil.which("chromium")
HANGS = 120  # seconds


class Browser:
    def __init__(self, width=1280, height=800, dark=False):
        self.folder = tempfile.mkdtemp(prefix="saltus-chromium-")
        command = [CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run", "--mute-audio",
                   "--disable-background-networking", "--remote-debugging-port=0", "--user-data-dir=" + self.folder, "--window-size=%d,%d" % (width, height), "about:blank"]
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=dict(os.environ, HOME=self.folder))
        port = None
        for line in self.process.stderr:
            found = re.search(r"listening on ws://127\.0\.0\.1:(\d+)/", line)
            if found:
                port = int(found.group(1))
                break
        assert port, "chromium does not start"
        self.number, self.errors, self.rest = 0, [], b""
        self.socket = self.open_socket(port, self.find_page(port))
        for domain in ("Page", "Runtime", "Log"):
            self.call(domain + ".enable")
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        if dark:
            self.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark"}])

    def close(self):
        self.socket.close()
        self.process.terminate()
        try:
            self.process.wait(20)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.process.stderr.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    # ---- the protocol
    def find_page(self, port):
        for _ in range(HANGS * 10):
            c = http.client.HTTPConnection("127.0.0.1", port, timeout=HANGS)
            c.request("GET", "/json/list")
            pages = [p for p in json.loads(c.getresponse().read()) if p["type"] == "page"]
            c.close()
            if pages:
                return "/devtools/page/" + pages[0]["id"]
            time.sleep(0.1)
        raise AssertionError("chromium has no page")

    def open_socket(self, port, path):
        s = socket.create_connection(("127.0.0.1", port), timeout=HANGS)
        s.sendall(("GET %s HTTP/1.1\r\nHost: 127.0.0.1:%d\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: %s\r\nSec-WebSocket-Version: 13\r\n\r\n"
                   % (path, port, base64.b64encode(os.urandom(16)).decode())).encode())
        while b"\r\n\r\n" not in self.rest:
            self.rest += s.recv(65536)
        self.rest = self.rest.split(b"\r\n\r\n", 1)[1]
        return s

    def take(self, n):
        while len(self.rest) < n:
            got = self.socket.recv(1 << 20)
            assert got, "chromium has gone"
            self.rest += got
        out, self.rest = self.rest[:n], self.rest[n:]
        return out

    def receive(self):
        text = b""
        while True:
            a, b = self.take(2)
            n = b & 127
            if n == 126:
                n = struct.unpack(">H", self.take(2))[0]
            elif n == 127:
                n = struct.unpack(">Q", self.take(8))[0]
            text += self.take(n)
            if a & 128:
                return json.loads(text)

    def call(self, method, **params):
        self.number += 1
        data, mask = json.dumps({"id": self.number, "method": method, "params": params}).encode(), os.urandom(4)
        n = len(data)
        head = struct.pack(">BB", 0x81, 0x80 | n) if n < 126 else struct.pack(">BBH", 0x81, 0xfe, n) if n < 65536 else struct.pack(">BBQ", 0x81, 0xff, n)
        self.socket.sendall(head + mask + bytes(x ^ mask[i & 3] for i, x in enumerate(data)))
        while True:
            m = self.receive()
            if m.get("method") == "Runtime.exceptionThrown":
                self.errors.append(m["params"]["exceptionDetails"].get("exception", {}).get("description", "an exception"))
            if m.get("method") == "Log.entryAdded" and m["params"]["entry"]["level"] == "error":
                self.errors.append(m["params"]["entry"]["text"])
            if m.get("id") == self.number:
                assert "error" not in m, m.get("error")
                return m["result"]

    # ---- the page
    def open(self, url):
        self.call("Page.navigate", url=url)

    def run(self, script):
        """The value of an expression of JavaScript; promises are waited for."""
        r = self.call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in r, r.get("exceptionDetails")
        return r["result"].get("value")

    def wait(self, condition, seconds=HANGS):
        end = time.monotonic() + seconds
        while not self.run("!!(%s)" % condition):
            assert time.monotonic() < end, "never: %s; errors: %s" % (condition, self.errors)
            time.sleep(0.02)

    def mouse(self, kind, x, y):
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=0 if kind == "mouseReleased" else 1, clickCount=1)

    def picture(self):
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
