"""What the viewer's server lets through, and what it does not."""
import socket
import time
import unittest

from viewing import Case


class Doors(Case):
    """Who may ask."""

    def test_hosts(self):
        v = self.view("--size", 16)
        for host, status in (("127.0.0.1:%d" % v.port, 200), ("localhost:1234", 200), ("LOCALHOST", 200), ("[::1]:80", 200), ("evil.example", 403), ("evil.example:%d" % v.port, 403),
                             ("127.0.0.1.evil.example", 403), ("localhost.evil.example:80", 403), ("127.0.0.1:80@evil", 403), ("0.0.0.0", 403), ("", 403)):
            a = v.raw(b"GET /state?token=%s HTTP/1.1\r\nHost: %s\r\nConnection: close\r\n\r\n" % (v.token.encode(), host.encode()))
            self.assertEqual(int(a.split()[1]), status, host)
        self.assertIn(b" 400 ", v.raw(b"GET /state HTTP/1.1\r\n\r\n"))
        self.assertIn(b" 400 ", v.raw(b"GET /state HTTP/1.1\r\nHost: localhost\r\nHost: localhost\r\n\r\n"))

    def test_origins(self):
        v = self.view("--size", 16)
        own = "http://127.0.0.1:%d" % v.port
        for origin, status in ((own, 200), ("http://evil.example", 403), ("null", 403), ("http://127.0.0.1:1", 403), ("https" + own[4:], 403), (own + ".evil.example", 403)):
            self.assertEqual(v.post("/params", {"params": {"radius": 0.3}}, headers={"Origin": origin}).status, status, origin)
            self.assertEqual(v.get("/state", headers={"Origin": origin}).status, status, origin)
        for method in (b"OPTIONS", b"PUT", b"DELETE", b"HEAD"):
            a = v.raw(method + b" /params HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
            self.assertIn(b" 405 ", a)
            self.assertNotIn(b"Access-Control", a)

    def test_tokens(self):
        v = self.view("--size", 16)
        for token in (None, "", "x" * 32, v.token[:-1], v.token + "0", v.token.upper() + " "):
            headers = {} if token is None else {"X-Saltus-Token": token}
            for method, path in (("GET", "/state"), ("GET", "/image"), ("GET", "/events"), ("GET", "/params"), ("POST", "/image"), ("POST", "/params"), ("POST", "/fit"), ("POST", "/quit"), ("POST", "/nothing")):
                self.assertEqual(v.ask(method, path, headers=headers, token=False).status, 403, (method, path, token))
        self.assertEqual(v.get("/state?token=" + v.token, token=False).status, 200)
        self.assertIsNone(v.process.poll())

    def test_the_page_needs_none_and_holds_none(self):
        v = self.view("--size", 16)
        for path, kind in (("/", "text/html"), ("/page.js", "text/javascript"), ("/page.css", "text/css")):
            a = v.get(path, token=False)
            self.assertEqual(a.status, 200)
            self.assertTrue(a.headers["Content-Type"].startswith(kind))
            self.assertNotIn(v.token.encode(), a.body)
            self.assertNotIn(b"http://", a.body.replace(b"http://www.w3.org/2000/svg", b""))
            self.assertIn("default-src 'none'", a.headers["Content-Security-Policy"])
            self.assertEqual((a.headers["X-Content-Type-Options"], a.headers["Referrer-Policy"]), ("nosniff", "no-referrer"))

    def test_paths(self):
        self.put("secret.txt", "secret")
        v = self.view("--size", 16)
        for path in ("/../secret.txt", "/secret.txt", "/a.salt", "/%2e%2e/secret.txt", "//state", "/state/", "/page.js/../a.salt", "/image/..", "/.", "/\\state"):
            a = v.get(path)
            self.assertEqual(a.status, 404, path)
            self.assertNotIn(b"secret", a.body)
        self.assertEqual(v.get("/fit").status, 405)
        self.assertEqual(v.post("/state").status, 405)

    def test_only_the_loopback_listens(self):
        v = self.view("--size", 16)
        with open("/proc/net/tcp") as f:
            listening = [line.split()[1] for line in f if line.split()[3] == "0A"]
        self.assertEqual([a for a in listening if a.endswith(":%04X" % v.port)], ["0100007F:%04X" % v.port])


class Requests(Case):
    """What is no request, and what is too much of one."""

    def status(self, v, data):
        a = v.raw(data)
        self.assertTrue(a.startswith(b"HTTP/1.1 "), (data[:80], a[:80]))
        return int(a.split()[1])

    def test_malformed(self):
        v = self.view("--size", 16)
        host = b"Host: localhost\r\nX-Saltus-Token: %s\r\n" % v.token.encode()
        for data, status in ((b"\r\n\r\n", 400), (b"GET\r\n\r\n", 400), (b"GET /state\r\n\r\n", 400), (b"GET /state HTTP/2.0\r\n" + host + b"\r\n", 400), (b"GET state HTTP/1.1\r\n" + host + b"\r\n", 400),
                             (b"GET http://localhost/state HTTP/1.1\r\n" + host + b"\r\n", 400), (b"GET /st\x01ate HTTP/1.1\r\n" + host + b"\r\n", 400), (b"GET /state HTTP/1.1\r\n" + host + b"no colon\r\n\r\n", 400),
                             (b"GET /state HTTP/1.1\r\n" + host + b" folded: yes\r\n\r\n", 400), (b"GET /state HTTP/1.1\r\n" + host + b"spaced : yes\r\n\r\n", 400), (b"GET /\0 HTTP/1.1\r\n" + host + b"\r\n", 400),
                             (b"POST /params HTTP/1.1\r\n" + host + b"Content-Length: 2\r\nContent-Length: 2\r\n\r\n{}", 400), (b"POST /params HTTP/1.1\r\n" + host + b"Content-Length: -2\r\n\r\n{}", 400),
                             (b"POST /params HTTP/1.1\r\n" + host + b"Content-Length: 0x2\r\n\r\n{}", 400), (b"POST /params HTTP/1.1\r\n" + host + b"Content-Length: 99999999999999999999\r\n\r\n", 400),
                             (b"POST /params HTTP/1.1\r\n" + host + b"Transfer-Encoding: chunked\r\n\r\n0\r\n\r\n", 501), (b"POST /params HTTP/1.1\r\n" + host + b"\r\n", 411),
                             (b"POST /target HTTP/1.1\r\n" + host + b"Content-Length: 33554433\r\n\r\n", 413), (b"GET /state HTTP/1.1\r\n" + host + b"Content-Length: 2\r\n\r\n{}", 400),
                             (b"GET /" + b"a" * 20000 + b" HTTP/1.1\r\n" + host + b"\r\n", 431), (b"GET /state HTTP/1.1\r\n" + host + b"X: " + b"y" * 20000, 431),
                             (b"GET /state HTTP/1.1\r\n" + host + b"X: y\r\n" * 101 + b"\r\n", 431)):
            self.assertEqual(self.status(v, data), status, data[:100])
        self.assertEqual(v.state["status"], "ready")

    def test_one_connection_serves_many(self):
        v = self.view("--size", 16)
        one = b"GET /state HTTP/1.1\r\nHost: localhost\r\nX-Saltus-Token: %s\r\n" % v.token.encode()
        a = v.raw(one + b"\r\n" + one + b"\r\n" + one + b"Connection: close\r\n\r\n")  # before the first is answered
        self.assertEqual(a.count(b"HTTP/1.1 200 OK"), 3)
        self.assertEqual(v.raw(b"GET /state HTTP/1.0\r\nHost: localhost\r\nX-Saltus-Token: %s\r\n\r\n" % v.token.encode()).count(b"HTTP/1.1 200"), 1)
        body = b'{"params": {"radius": 0.25}}'
        s = socket.create_connection(("127.0.0.1", v.port))
        for byte in b"POST /params HTTP/1.1\r\nHost: localhost\r\nX-Saltus-Token: %s\r\nContent-Length: %d\r\n\r\n%s" % (v.token.encode(), len(body), body):
            s.send(bytes([byte]))  # in as many pieces as it has bytes
        self.assertTrue(s.recv(1000).startswith(b"HTTP/1.1 200"))
        s.close()
        self.assertEqual(v.state["values"]["radius"], 0.25)

    def test_a_large_body_is_waited_for(self):
        v = self.view("--size", 16)
        s = socket.create_connection(("127.0.0.1", v.port))
        s.sendall(b"POST /target?name=a.png HTTP/1.1\r\nHost: localhost\r\nX-Saltus-Token: %s\r\nContent-Length: 3000000\r\nExpect: 100-continue\r\n\r\n" % v.token.encode())
        self.assertTrue(s.recv(1000).startswith(b"HTTP/1.1 100 "))
        s.sendall(b"x" * 3000000)
        self.assertTrue(s.recv(1000).startswith(b"HTTP/1.1 422 "))
        s.close()

    def test_idle_connections_give_way(self):
        v = self.view("--size", 16)
        idle = [socket.create_connection(("127.0.0.1", v.port)) for _ in range(100)]
        self.assertEqual(v.state["status"], "ready")
        for s in idle:
            s.close()

    def test_heads_that_never_end_are_given_up(self):
        v = self.view("--size", 16)
        v.connection.close()
        slow = []
        for _ in range(64):
            s = socket.create_connection(("127.0.0.1", v.port))
            s.sendall(b"GET /state HTTP/1.1\r\nHost: loc")
            slow.append(s)
        time.sleep(0.3)
        self.assertIn(b" 503 ", v.raw(b"GET / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"))
        for _ in range(30):  # a byte a second is no life
            for s in slow:
                try:
                    s.sendall(b"a")
                except OSError:
                    pass
            time.sleep(1)
            if b" 200 " in v.raw(b"GET / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"):
                break
        self.assertEqual(v.state["status"], "ready")
        for s in slow:
            s.close()

    def test_who_reads_nothing_holds_up_nobody(self):
        v = self.view("--size", 2048)
        slow = []
        for _ in range(8):
            s = socket.create_connection(("127.0.0.1", v.port))
            s.sendall(b"GET /image HTTP/1.1\r\nHost: localhost\r\nX-Saltus-Token: %s\r\n\r\n" % v.token.encode())
            slow.append(s)
        self.assertEqual(len(v.get("/image").body), 4 * 2048 * 2048)
        for s in slow:
            s.close()
        self.assertEqual(len(v.get("/image").body), 4 * 2048 * 2048)


class Bodies(Case):
    """What is asked of the program."""

    def test_json(self):
        v = self.view("--size", 16)
        for body, status in (("{", 400), ("[]", 400), ("1", 400), ('{"params": {"radius": NaN}}', 400), ('{"params": {"radius": 1e999}}', 400), ('{"params": {"radius": 1, "radius": 2}}', 400),
                             ("{" * 100000, 400), ("\0", 400), ('{"params": 1}', 422), ('{"param": {}}', 422), ('{"params": {"radius": null}}', 422), ('{"params": {"radius": "0.3"}}', 422),
                             ('{"params": {"radius": [1, 2]}}', 422), ('{"params": {"centre": [1]}}', 422), ('{"params": {"centre": {"x": 1}}}', 422), ('{"params": {"radios": 1}}', 422),
                             ('{"spp": 0}', 422), ('{"spp": 1.5}', 422), ('{"spp": 100000}', 422), ('{"slice": 1}', 422), ('{"reset": 1}', 422)):
            for path in ("/params", "/image"):
                a = v.post(path, body)
                self.assertEqual(a.status, status, (body[:60], a.body))
                self.assertTrue(a.json["error"])
        self.assertIn("did you mean `radius`", v.post("/params", {"params": {"radios": 1}}).json["error"])
        self.assertEqual(v.state["values"], {"radius": 0.4, "centre": [0.1, -0.05], "ink": 1})

    def test_all_or_nothing(self):
        v = self.view("--size", 16)
        self.assertEqual(v.post("/params", {"params": {"radius": 0.2, "ink": 0.5, "nothing": 1}}).status, 422)
        self.assertEqual(v.state["values"], {"radius": 0.4, "centre": [0.1, -0.05], "ink": 1})

    def test_no_file_is_read(self):
        self.put("values.json", "[0.5, 0.5]")
        v = self.view("--size", 16)
        for value in ("@values.json", {"file": "values.json"}, ["@values.json"], "@/etc/passwd"):
            a = v.post("/params", {"params": {"centre": value}})
            self.assertEqual(a.status, 422)
            self.assertIn("numbers are wanted", a.json["error"])

    def test_queries(self):
        v = self.view("--size", 16)
        for path in ("/image?format=gif", "/image?scale=0", "/image?scale=1e9", "/image?scale=x", "/gradient", "/gradient?component=", "/gradient?component=nothing", "/gradient?component=centre",
                     "/gradient?component=radius&gain=0", "/gradient?component=radius&gain=nan", "/point", "/point?at=", "/point?at=1", "/point?at=1,2,3", "/point?at=1,2,3,4", "/point?at=nan,1",
                     "/point?at=1,b", "/gradient?component=" + "a" * 5000):
            self.assertEqual(v.get(path).status, 422, path)
        self.assertEqual(v.get("/target").status, 404)
        self.assertEqual(v.get("/gradient?component=centre%2ex").status, 200)

    def test_targets(self):
        v = self.view("--size", 16)
        for name, body in (("a.png", b"\x89PNG\r\n\x1a\n"), ("a.exr", b"v/1\x01" + b"\0" * 100), ("a.gif", b"GIF89a"), ("../../etc/passwd", b"x"), ("a.png", b"")):
            self.assertEqual(v.post("/target?name=" + name, body).status, 422, name)
        self.assertEqual(v.post("/fit").status, 422)
        self.assertIn("no target", v.post("/fit").json["error"])
        self.assertFalse(v.state["target"])


if __name__ == "__main__":
    unittest.main()
