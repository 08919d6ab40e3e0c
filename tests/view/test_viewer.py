"""What the viewer shows, how it follows its file, fits and ends."""
import json
import math
import os
import signal
import socket
import struct
import subprocess
import time
import unittest

from viewing import CIRCLE, Case, Stream, Viewer, harness

LINE = """
[Range(0.0, 1.0)] param float a = 0.4;
[Domain(0.0, 2.0)] shader float2 main(float x) { float f = 0.25; [Disc] if (x > a) f += 0.5; return float2(f, x); }
"""
BALL = """
[Range(0.1, 1.0)] param float r = 0.5;
[Domain(-1.0, 1.0)] shader float main(float3 x) { float f = 0.0; [Disc] if (length(x) < r) f = 1.0; return f + 0.125 * (x.z > 0.0 ? 1.0 : 0.0); }
"""
ARRAY = """
struct Disc { float2 centre; float radius; };
const int N = 3;
Disc place(int i) { Disc d; d.centre = float2(0.25 * float(i), 0.5); d.radius = 0.1; return d; }
param Disc discs[N] = init(place);
param int mode = 1;
param bool on = true;
[Color] [Doc("of the paper")] param float3 paper = float3(0.5, 0.25, 1.0);
[Domain(0.0, 1.0)] shader float3 main(float2 x) {
    float3 c = paper;
    for (int i = 0; i < N; i++) { [Disc] if (on && length(x - discs[i].centre) < discs[i].radius) c = float3(float(mode)); }
    return c;
}
"""


def floats(body):
    return struct.unpack("<%df" % (len(body) // 4), body)


class Images(Case):
    def test_pixels_are_those_of_render(self):
        v = self.view("--size", "48x32")
        self.run_cli("render", "a.salt", "--size", "48x32", "--format", "rgba8", "-o", "a.raw")
        a = v.get("/image?draft=1")
        self.assertEqual(a.body, self.get("a.raw"))
        self.assertEqual((a.headers["X-Saltus-Width"], a.headers["X-Saltus-Height"], a.headers["X-Saltus-Channels"]), ("48", "32", "4"))
        self.run_cli("render", "a.salt", "--size", "48x32", "--spp", 4, "-o", "a.npy")
        self.assertEqual(floats(v.get("/image?format=f32").body), harness.read_npy(self.get("a.npy"))[1])
        self.run_cli("render", "a.salt", "--size", "48x32", "--spp", 4, "-o", "a.png")
        shape, png = harness.read_png(self.get("a.png"))
        shape4, png4 = harness.read_png(v.get("/image?format=png").body)
        self.assertEqual((shape, shape4), ((32, 48, 1), (32, 48, 4)))
        self.assertEqual(png4[0::4], png)
        self.assertEqual(len(v.get("/image?scale=4").body), 4 * 12 * 8)

    def test_a_step_is_one_request(self):
        v = self.view("--size", 32)
        a = v.post("/image?draft=1", {"params": {"radius": 0.7, "centre.x": 0.0}})
        self.run_cli("render", "a.salt", "--size", 32, "--format", "rgba8", "--param", "radius=0.7", "--param", "centre=[0,-0.05]", "-o", "a.raw")
        self.assertEqual(a.body, self.get("a.raw"))
        self.assertEqual(v.state["version"], int(a.headers["X-Saltus-Version"]))
        self.assertEqual(v.post("/image?draft=1", {"reset": True}).body, v.get("/image?draft=1").body)
        self.assertEqual(v.state["values"]["radius"], 0.4)

    def test_options(self):
        self.put("p.json", '{"ink": 0.5}')
        v = self.view("--size", 16, "--params", "p.json", "--param", "radius=0.2", "--spp", 16, "--precision", "f64")
        state = v.state
        self.assertEqual((state["values"]["ink"], state["values"]["radius"], state["spp"], state["size"]), (0.5, 0.2, 16, [16, 16, 1]))

    def test_one_dimension(self):
        v = self.view("--size", 64, source=LINE)
        a = v.get("/image?format=f32&draft=1")
        self.assertEqual(floats(a.body)[1::2], tuple(harness.f32((i + 0.5) / 32) for i in range(64)))
        self.assertEqual(a.headers["X-Saltus-Channels"], "2")
        g = floats(v.get("/gradient?component=a&format=f32").body)
        self.assertAlmostEqual(sum(g[0::2]) / 32, -0.5, 5)
        self.assertEqual(v.get("/point?at=0.5").json["f"], [0.75, 0.5])

    def test_a_slice_of_a_volume(self):
        v = self.view("--size", "16x16x8", source=BALL)
        for slice_at in (0, 3, 4, 7):
            a = v.post("/image?format=f32", {"slice": slice_at})
            z = (slice_at + 0.5) / 4 - 1
            for i, f in enumerate(floats(a.body)):
                x, y = (i % 16 + 0.5) / 8 - 1, 1 - (i // 16 + 0.5) / 8
                self.assertEqual(f, (math.sqrt(x * x + y * y + z * z) < 0.5) + 0.125 * (z > 0), (slice_at, x, y))
        self.assertEqual(v.post("/params", {"slice": 8}).status, 422)
        self.assertEqual(len(v.get("/gradient?component=r").body), 4 * 256)

    def test_what_is_told(self):
        v = self.view("--size", 16, source=ARRAY)
        state = v.state
        p = {q["name"]: q for q in state["program"]["parameters"]}
        self.assertEqual((p["discs"]["kind"], p["discs"]["shape"], [f["name"] for f in p["discs"]["fields"]]), ("struct", [3], ["centre", "radius"]))
        self.assertEqual((p["paper"]["color"], p["paper"]["doc"], p["mode"]["kind"], p["on"]["kind"]), (True, "of the paper", "int", "bool"))
        self.assertEqual(state["values"], {"discs": [{"centre": [0.25 * i, 0.5], "radius": 0.1} for i in range(3)], "mode": 1, "on": True, "paper": [0.5, 0.25, 1]})
        self.assertEqual(v.post("/params", {"params": {"discs[1].centre": [0.5, 0.75], "discs[2].radius": 0.3, "mode": 0, "on": False}}).status, 200)
        now = v.state["values"]
        self.assertEqual((now["discs"][1]["centre"], now["discs"][2]["radius"], now["mode"], now["on"]), ([0.5, 0.75], 0.3, 0, False))
        saved = v.get("/params")
        self.assertIn("params.json", saved.headers["Content-Disposition"])
        self.put("saved.json", saved.body)
        self.run_cli("render", "a.salt", "--size", 16, "--params", "saved.json", "--format", "rgba8", "-o", "a.raw")
        self.assertEqual(v.get("/image?draft=1").body, self.get("a.raw"))

    def test_numbers_that_are_refused(self):
        v = self.view("--size", 8, source=ARRAY)
        for name, value in (("paper", "[1e39, 0, 0]"), ("discs[0].radius", "-1e39"), ("paper", "NaN"), ("mode", "2147483648")):
            self.assertIn(v.post("/params", '{"params": {"%s": %s}}' % (name, value)).status, (400, 422), name)
        self.assertEqual((v.state["values"]["paper"], v.state["values"]["discs"][0]["radius"]), ([0.5, 0.25, 1], 0.1))
        self.assertIn("no float", v.get("/gradient?component=mode").json["error"])
        v = self.view("--size", 8, "--precision", "f64")
        self.assertEqual(v.post("/params", {"params": {"ink": 1e39}}).status, 200)
        self.assertEqual(v.state["values"]["ink"], 1e39)

    def test_gradients(self):
        v = self.view("--size", 64, "--spp", 16)
        g = floats(v.get("/gradient?component=radius&format=f32").body)
        self.assertAlmostEqual(sum(g) / len(g) * 4, 2 * math.pi * 0.4 * 0.75, 2)
        a = v.get("/gradient?component=radius")
        self.assertAlmostEqual(float(a.headers["X-Saltus-Scale"]), max(map(abs, g)), 4)
        inside, edge = 4 * (32 * 64 + 35), max(range(len(g)), key=lambda i: abs(g[i]))
        self.assertEqual(a.body[inside + 3], 0)  # nothing there: clear
        self.assertEqual(a.body[4 * edge + 3], 255)
        self.assertGreater(a.body[4 * edge], a.body[4 * edge + 2])  # red: up
        self.assertEqual(v.get("/gradient?component=ink").status, 200)

    def test_points_and_cells_are_those_of_explain(self):
        v = self.view("--size", 64, "--param", "radius=0.3")
        self.assertEqual(v.get("/point?at=0.3,0.2").json, self.json_cli("explain", "a.salt", "--at", "0.3,0.2", "--param", "radius=0.3"))
        self.run_cli("explain", "a.salt", "--cells", "a.svg", "--param", "radius=0.3")
        self.assertEqual(v.get("/cells").body, self.get("a.svg"))
        self.assertEqual(v.get("/point?at=0.3,0.2").json["trace"][0]["site"], 0)
        self.assertEqual(v.state["program"]["sites"][0]["line"], 8)

    def test_steps_take_no_memory(self):
        v = self.view("--size", 32)
        step = lambda i: self.assertEqual(v.post("/image?draft=1", {"params": {"radius": 0.2 + 1e-4 * (i % 1000)}}).status, 200)
        for i in range(300):
            step(i)
        v.get("/point?at=0.3,0.2")
        before = v.memory()
        for i in range(2000):
            step(i)
        for i in range(200):
            v.get("/point?at=0.3,%g" % (0.001 * i))
        self.assertLess(v.memory() - before, (1024 if os.environ.get("SALTUS_SANITIZE") else 2) << 20)


class Follows(Case):
    """The file, as it is saved."""

    def save(self, text, name="a.salt"):
        self.put(name + "~", text)
        os.rename(self.path(name + "~"), self.path(name))

    def test_saving_makes_a_new_image(self):
        v = self.view("--size", 16)
        v.wait(lambda s: s["generation"] == 1)
        first = v.get("/image").body
        self.put("a.salt", CIRCLE.replace("0.25", "0.75"))  # written in place
        v.wait(lambda s: s["generation"] == 2)
        second = v.get("/image").body
        self.assertNotEqual(first, second)
        self.save(CIRCLE)  # renamed into place
        v.wait(lambda s: s["generation"] == 3)
        self.assertEqual(v.get("/image").body, first)

    def test_errors_keep_the_last_image(self):
        v = self.view("--size", 16)
        v.wait(lambda s: s["generation"] == 1)
        image = v.get("/image").body
        self.save(CIRCLE.replace("length(x - centre)", "length(x - center)"))
        state = v.wait(lambda s: s["status"] == "error")
        self.assertIn("a.salt:8:", state["message"])
        self.assertIn("^", state["message"])
        self.assertEqual((state["generation"], v.get("/image").body), (1, image))
        self.assertEqual(v.post("/image", {"params": {"radius": 0.5}}).status, 200)
        self.save(CIRCLE)
        state = v.wait(lambda s: s["status"] == "ready")
        self.assertEqual((state["message"], state["values"]["radius"]), ("", 0.5))

    def test_errors_from_the_start(self):
        v = self.view("--size", 16, source="shader float main(float2 x) { return y; }")
        state = v.state
        self.assertEqual((state["status"], state["program"], state["generation"]), ("error", None, 0))
        for method, path in (("GET", "/image"), ("POST", "/image"), ("GET", "/gradient?component=a"), ("GET", "/point?at=0,0"), ("GET", "/params"), ("POST", "/target?current=1"), ("POST", "/fit")):
            self.assertEqual(v.ask(method, path).status, 409, path)
        self.assertEqual(v.post("/params", {"params": {"radius": 1}}).status, 409)
        self.save(CIRCLE)
        v.wait(lambda s: s["status"] == "ready")
        self.assertEqual(v.get("/image").status, 200)

    def test_values_that_were_moved_stay(self):
        v = self.view("--size", 16)
        v.post("/params", {"params": {"radius": 0.3}})
        self.save("param float more = 2.0;\n" + CIRCLE.replace("ink = 1.0", "ink = 0.5").replace("radius = 0.4", "radius = 0.6"))
        values = v.wait(lambda s: s["generation"] == 2)["values"]
        self.assertEqual(values, {"more": 2, "radius": 0.3, "centre": [0.1, -0.05], "ink": 0.5})
        self.save(CIRCLE.replace("float radius = 0.4", "float2 radius = float2(0.5, 0.6)").replace("< radius", "< radius.x"))  # of another shape
        self.assertEqual(v.wait(lambda s: s["generation"] == 3)["values"]["radius"], [0.5, 0.6])

    def test_imports(self):
        os.mkdir(self.path("lib"))
        self.put("lib/tone.salt", "float tone() { return 0.25; }")
        v = self.view("--size", 4, "-I", "lib", source="import tone; shader float main(float2 x) { return tone(); }")
        self.assertEqual(floats(v.get("/image?format=f32").body)[0], 0.25)
        self.save("float tone() { return 0.5; }", "lib/tone.salt")
        v.wait(lambda s: s["generation"] == 2)
        self.assertEqual(floats(v.get("/image?format=f32").body)[0], 0.5)
        os.remove(self.path("lib/tone.salt"))
        self.save("import tone;\nshader float main(float2 x) { return tone(); }")
        v.wait(lambda s: s["status"] == "error")
        self.save("float tone() { return 0.75; }", "lib/tone.salt")
        v.wait(lambda s: s["status"] == "ready")
        self.assertEqual(floats(v.get("/image?format=f32").body)[0], 0.75)

    def test_what_the_system_does_not_tell_of(self):
        """A file that goes, one that a link takes the place of, a folder that is moved and made anew."""
        os.mkdir(self.path("sub"))
        self.put("sub/a.salt", CIRCLE)
        v = Viewer(self, "sub/a.salt", "--size", 8)
        self.viewers.append(v)
        v.wait(lambda s: s["status"] == "ready")
        paper = lambda: floats(v.get("/image?format=f32").body)[0]
        until = lambda value: v.wait(lambda s: s["status"] == "ready" and paper() == value)
        until(0.25)
        os.remove(self.path("sub/a.salt"))
        self.assertIn("sub/a.salt", v.wait(lambda s: s["status"] == "error")["message"])
        self.assertEqual(paper(), 0.25)
        self.put("other.salt", CIRCLE.replace("0.25", "0.5"))
        os.symlink("../other.salt", self.path("sub/a.salt"))
        until(0.5)
        os.rename(self.path("sub"), self.path("moved"))
        v.wait(lambda s: s["status"] == "error")
        os.mkdir(self.path("sub"))
        self.put("sub/a.salt", CIRCLE.replace("0.25", "0.75"))
        until(0.75)
        self.save(CIRCLE.replace("0.25", "0.125"), "sub/a.salt")
        until(0.125)

    def test_links(self):
        os.mkdir(self.path("real"))
        self.put("real/b.salt", CIRCLE)
        os.symlink("real/b.salt", self.path("link.salt"))
        self.put("a.salt", CIRCLE)
        v = Viewer(self, "link.salt", "--size", 8)
        self.viewers.append(v)
        self.save(CIRCLE.replace("0.25", "0.5"), "real/b.salt")
        v.wait(lambda s: s["generation"] == 2)

    def test_other_files_do_not_matter(self):
        v = self.view("--size", 8)
        v.wait(lambda s: s["generation"] == 1)
        self.put("b.salt", CIRCLE)
        self.put("a.salt.swp", "x")
        time.sleep(0.3)
        self.assertEqual(v.state["generation"], 1)
        self.assertEqual(v.post("/compile").status, 202)
        v.wait(lambda s: s["generation"] == 2)

    def test_a_burst_of_saves(self):
        v = self.view("--size", 8)
        for i in range(40):
            self.save(CIRCLE.replace("0.25", "0.%02d" % (i + 10)))
        v.wait(lambda s: s["status"] == "ready" and floats(v.get("/image?format=f32&draft=1").body)[0] == harness.f32(0.49))

    def test_events(self):
        v = self.view("--size", 8)
        v.wait(lambda s: s["generation"] == 1)
        stream = Stream(v)
        other = Stream(v)
        until = lambda condition: v.wait(lambda s: condition())
        until(lambda: stream.of("program") and stream.of("values"))
        v.post("/params", {"params": {"radius": 0.125}})
        until(lambda: stream.of("values")[-1]["values"]["radius"] == 0.125 and other.of("values")[-1]["values"]["radius"] == 0.125)
        self.save(CIRCLE + "!")
        until(lambda: stream.of("program")[-1]["status"] == "error")
        self.save(CIRCLE)
        until(lambda: stream.of("program")[-1] == {"status": "ready", "generation": 2})
        self.assertEqual(stream.of("values")[-1]["values"]["radius"], 0.125)


class Fits(Case):
    def test_a_fit(self):
        v = self.view("--size", 32)
        stream = Stream(v)
        self.assertEqual(v.post("/target?current=1").json, {"size": [32, 32]})
        self.assertEqual(harness.read_png(v.get("/target").body)[0], (32, 32, 3))
        v.post("/params", {"params": {"radius": 0.55, "ink": 0.8}})
        self.assertEqual(v.post("/fit", {"iterations": 120, "rate": 0.01}).status, 202)
        state = v.wait(lambda s: s["fit"]["done"] and not s["fit"]["running"])
        fit = state["fit"]
        self.assertEqual((fit["done"], len(fit["losses"])), (120, 120))
        self.assertLess(fit["losses"][-1], 0.05 * fit["losses"][0])
        self.assertAlmostEqual(state["values"]["radius"], 0.4, 1)
        v.wait(lambda s: stream.of("fit") and not stream.of("fit")[-1]["running"] and stream.of("fit")[-1]["done"] == 120)
        told = [None] * 120
        for e in stream.of("fit"):
            told[e["first"]:e["first"] + len(e["losses"])] = e["losses"]
        self.assertEqual(told, fit["losses"])
        # The program goes on with what was fitted.
        self.assertEqual(v.get("/params").json["radius"], state["values"]["radius"])
        self.assertEqual(v.get("/gradient?component=radius").status, 200)

    def test_only_what_is_named(self):
        v = self.view("--size", 32)
        v.post("/target?current=1")
        v.post("/params", {"params": {"radius": 0.5, "ink": 0.7}})
        v.post("/fit", {"iterations": 20, "parameters": ["radius"], "rate": {"radius": 0.01}, "spp": 2, "optimizer": "sgd"})
        state = v.wait(lambda s: s["fit"]["done"] == 20 and not s["fit"]["running"])
        self.assertEqual(state["values"]["ink"], 0.7)
        self.assertNotEqual(state["values"]["radius"], 0.5)

    def test_a_running_fit(self):
        v = self.view("--size", 64)
        v.post("/target?current=1")
        v.post("/params", {"params": {"radius": 0.6}})
        v.post("/fit", {"iterations": 100000, "rate": 0.0001})
        v.wait(lambda s: s["fit"]["done"] > 3)
        for method, path, body in (("POST", "/params", {"params": {"radius": 1}}), ("POST", "/image", {"reset": True}), ("GET", "/gradient?component=radius", None), ("GET", "/cells", None), ("GET", "/point?at=0,0", None), ("POST", "/fit", {})):
            self.assertEqual(v.ask(method, path, body).status, 409, path)
        self.assertEqual(v.get("/image").status, 200)
        self.assertEqual(v.post("/image", {"spp": 2}).status, 200)
        self.assertEqual(v.post("/fit/stop").status, 202)
        state = v.wait(lambda s: not s["fit"]["running"])
        self.assertEqual(state["fit"]["reason"], "stopped")
        self.assertEqual(v.post("/params", {"params": {"radius": 1}}).status, 200)
        self.assertEqual(v.post("/fit/stop").status, 202)  # there is none: nothing happens
        self.assertEqual(v.get("/image").status, 200)

    def test_saving_ends_it(self):
        v = self.view("--size", 64)
        v.post("/target?current=1")
        v.post("/params", {"params": {"radius": 0.6}})
        v.post("/fit", {"iterations": 100000, "rate": 0.0001})
        v.wait(lambda s: s["fit"]["done"] > 3)
        self.put("a.salt", CIRCLE.replace("0.25", "0.5"))
        state = v.wait(lambda s: s["generation"] == 2)
        self.assertFalse(state["fit"]["running"])
        self.assertNotIn(state["values"]["radius"], (0.4, 0.6))  # what the fit had reached

    def test_targets(self):
        self.run_cli("render", "--expr", "length(x - 0.5) < 0.3 ? 1.0 : 0.0", "--size", 24, "-o", "t.png")
        v = self.view("--size", 32, "--target", "t.png")
        self.assertTrue(v.state["target"])
        self.assertEqual(v.post("/target?name=b.png", self.get("t.png")).json, {"size": [24, 24]})
        self.assertEqual(v.post("/fit", {"iterations": 3}).status, 202)
        v.wait(lambda s: s["fit"]["done"] == 3 and not s["fit"]["running"])
        for wish in ({"iterations": 0}, {"iteration": 3}, {"optimizer": "newton"}, {"optimizer": 1}, {"parameters": ["nothing"]}, {"parameters": "radius"}, {"rate": -1}, {"rate": {"nothing": 1}}, {"rate": {"radius": "1"}}, {"spp": 0}):
            self.assertEqual(v.post("/fit", wish).status, 422, wish)
        self.assertFalse(v.state["fit"]["running"])


class Ends(Case):
    def test_addresses(self):
        self.put("a.salt", CIRCLE)
        p = self.start_cli("view", "a.salt")
        line = p.stdout.readline().decode()
        self.assertRegex(line, r"^http://127\.0\.0\.1:\d+/\?token=[0-9a-f]{32}\n$")
        p.send_signal(signal.SIGINT)
        out, err = p.communicate(timeout=harness.HANGS)
        self.assertEqual((p.returncode, out), (130, b""), err)
        self.assertIn(b"saltus: interrupted", err)

    def test_ports(self):
        with socket.socket() as s:
            s.bind(("127.0.0.1", 0))
            port = s.getsockname()[1]
        v = self.view("--port", port, "--size", 8)
        self.assertEqual(v.port, port)
        self.assertIn("--port", self.run_cli("view", "a.salt", "--port", port, code=2).err)
        self.assertEqual(v.end(), 130)
        self.view("--port", port, "--size", 8)  # at once again

    def test_quit(self):
        v = self.view("--size", 8)
        self.assertEqual(v.post("/quit").status, 202)
        self.assertEqual(v.end(None), 0)

    def test_while_it_works(self):
        v = self.view("--size", 512)
        v.post("/target?current=1")
        v.post("/params", {"params": {"radius": 0.6}})
        v.post("/fit", {"iterations": 100000})
        v.wait(lambda s: s["fit"]["done"])
        self.assertEqual(v.end(), 130)

    def test_limits(self):
        v = self.view("--size", 8, "--max-seconds", 1)
        self.assertEqual(v.end(None), 6)

    def test_usage(self):
        self.put("a.salt", CIRCLE)
        for args, code in ((["b.salt"], 4), (["-"], 2), ([], 2), (["a.salt", "--param", "nothing=1"], 2), (["a.salt", "--entry", "nothing"], 2), (["a.salt", "--set", "N=1"], 2), (["a.salt", "--port", "0"], 2),
                           (["a.salt", "--port", "70000"], 2), (["a.salt", "-o", "a.png"], 2), (["a.salt", "--size", "8x8x8"], 2), (["a.salt", "--size", "5000"], 6), (["a.salt", "--target", "b.png"], 4), (["a.salt", "--integral"], 2)):
            self.assertEqual(self.run_cli("view", *args, code=code, stdin=b"").out, "", args)

    def test_address_that_nobody_gets(self):
        self.put("a.salt", CIRCLE)
        with open("/dev/full", "wb") as full:
            ended = subprocess.run([harness.BIN, "view", "a.salt"], cwd=self.dir, stdout=full, stderr=subprocess.PIPE, timeout=harness.HANGS)
        self.assertEqual(ended.returncode, 5)
        self.assertIn(b"standard output could not be written", ended.stderr)

    def test_expressions(self):
        v = self.view("--size", 8)
        e = Viewer(self, "--expr", "x.x < 0.5 ? 1.0 : 0.0", "--size", 8)
        self.viewers.append(e)
        self.assertEqual(floats(e.get("/image?format=f32&draft=1").body)[:8], (1, 1, 1, 1, 0, 0, 0, 0))
        self.assertEqual(v.get("/image").status, 200)


if __name__ == "__main__":
    unittest.main()
