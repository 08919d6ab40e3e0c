"""What the tests of the command share: a temporary folder, running the binary, and small readers and writers of the file formats.

The readers are written from the formats' specifications, apart from the C code under test. Only the standard library is used."""
import ast
import json
import os
import re
import resource
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import unittest
import zlib

BIN = os.environ.get("SALTUS_BIN", "saltus")
HANGS = 1200  # seconds by the clock after which a command hangs, whatever else the machine does; what is fast is told by processor time

CIRCLE = """
param float radius = 0.4;
param float2 centre = float2(0.1, -0.05);
param float ink = 1.0;
[Domain(-1.0, 1.0)]
shader float main(float2 x) {
    float f = 0.25;
    [Disc] if (length(x - centre) < radius) f = ink;
    return f;
}
"""
COLOUR = """
param float radius = 0.4;
param float3 ink = float3(0.9, 0.3, 0.1);
[Domain(-1.0, 1.0)]
shader float3 main(float2 x) {
    float3 c = float3(1.0);
    [Disc] if (length(x) < radius) c = ink;
    return c;
}
"""
SMOOTH = """
param float a = 0.5;
param float b = 2.0;
shader float main(float2 x) { return a * x.x + sin(b * x.y); }
"""


class Result:
    def __init__(self, code, out, err):
        self.code, self.out, self.err = code, out, err

    @property
    def json(self):
        return json.loads(self.out)


class Case(unittest.TestCase):
    def setUp(self):
        self.dir = tempfile.mkdtemp(prefix="saltus-cli-")

    def tearDown(self):
        shutil.rmtree(self.dir, ignore_errors=True)

    def path(self, name):
        return os.path.join(self.dir, name)

    def put(self, name, text):
        os.makedirs(os.path.dirname(self.path(name)), exist_ok=True)
        with open(self.path(name), "wb" if isinstance(text, bytes) else "w") as f:
            f.write(text)
        return name

    def get(self, name):
        with open(self.path(name), "rb") as f:
            return f.read()

    def environment(self, env=None):
        e = dict(os.environ, XDG_CACHE_HOME=self.path("cache"), NO_COLOR="1")
        e.update(env or {})
        return e

    def run_cli(self, *args, code=0, stdin=None, env=None, timeout=HANGS):
        p = subprocess.run([BIN, *map(str, args)], cwd=self.dir, input=stdin, capture_output=True, timeout=timeout, env=self.environment(env))
        r = Result(p.returncode, p.stdout.decode(), p.stderr.decode())
        if code is not None:
            self.assertEqual(r.code, code, "saltus %s\nstdout: %s\nstderr: %s" % (" ".join(map(str, args)), r.out[:2000], r.err[:2000]))
        return r

    def json_cli(self, *args, **kw):
        r = self.run_cli(*args, "--json", **kw)
        self.assertTrue(r.out.startswith("{") and r.out.endswith("}\n"), r.out[:200])
        return json.loads(r.out, parse_constant=lambda name: self.fail("not JSON: " + name))

    def start_cli(self, *args, env=None):
        return subprocess.Popen([BIN, *map(str, args)], cwd=self.dir, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=self.environment(env))

    def processor(self):
        """Seconds of processor time of all commands that have ended."""
        u = resource.getrusage(resource.RUSAGE_CHILDREN)
        return u.ru_utime + u.ru_stime

    def interrupt(self, p, after, limit=20):
        """SIGINT once the command has computed for `after` seconds, of processor time like `limit`, in which it must end; gives what it printed."""
        def stat(name):
            with open("/proc/%d/%s" % (p.pid, name)) as f:
                return f.read()
        def used():
            return sum(map(int, stat("stat").rsplit(")", 1)[1].split()[11:13])) / os.sysconf("SC_CLK_TCK")
        caught = lambda: int(re.search("SigCgt:\\s*([0-9a-f]+)", stat("status")).group(1), 16) >> signal.SIGINT - 1 & 1
        while p.poll() is None and not (caught() and used() >= after):
            time.sleep(0.02)
        self.assertIsNone(p.poll(), "it was over before it could be interrupted")
        before, at = self.processor(), used()
        p.send_signal(signal.SIGINT)
        out, err = p.communicate(timeout=HANGS)
        self.assertLess(self.processor() - before - at, limit)
        self.assertEqual(p.returncode, 130, err)
        return out, err

    def lsp(self, err):
        """Every line of standard error that is a diagnostic, checked for its shape."""
        out = []
        for line in err.splitlines():
            if not line.startswith("{"):
                continue
            d = json.loads(line)
            self.assertIn(d["severity"], (1, 2, 3, 4))
            self.assertTrue(d["message"] and d["uri"] and d["code"])
            for end in ("start", "end"):
                self.assertGreaterEqual(d["range"][end]["line"], 0)
                self.assertGreaterEqual(d["range"][end]["character"], 0)
            out.append(d)
        return out

    def no_leftovers(self, *allowed):
        left = [n for n in os.listdir(self.dir) if n not in allowed and n != "cache" and not n.endswith(".salt")]
        self.assertEqual(left, [])


# ---- file formats
def read_npy(data):
    assert data[:6] == b"\x93NUMPY"
    n = struct.unpack("<H", data[8:10])[0]
    h = ast.literal_eval(data[10:10 + n].decode())
    assert not h["fortran_order"]
    code = {"<f4": "f", "<f8": "d", "<i4": "i"}[h["descr"]]
    count = 1
    for s in h["shape"]:
        count *= s
    return h["shape"], struct.unpack("<%d%s" % (count, code), data[10 + n:])


def write_npy(shape, values, descr="<f8"):
    head = repr({"descr": descr, "fortran_order": False, "shape": tuple(shape)}).encode()
    head += b" " * (63 - (len(head) + 10) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + struct.pack("<%d%s" % (len(values), {"<f8": "d", "<f4": "f"}[descr]), *values)


def read_pfm(data):
    kind, size, scale, rest = data.split(b"\n", 3)
    w, h = map(int, size.split())
    c = 3 if kind == b"PF" else 1
    v = struct.unpack(("<" if float(scale) < 0 else ">") + "%df" % (w * h * c), rest)
    rows = [v[y * w * c:(y + 1) * w * c] for y in range(h)]
    return (h, w, c), [x for row in reversed(rows) for x in row]  # the file runs from the bottom row up


def write_pfm(w, h, c, values):
    rows = [values[y * w * c:(y + 1) * w * c] for y in range(h)]
    flat = [x for row in reversed(rows) for x in row]
    return b"%s\n%d %d\n-1.0\n" % (b"PF" if c == 3 else b"Pf", w, h) + struct.pack("<%df" % len(flat), *flat)


def read_png(data):
    """8-bit, not interlaced: (h, w, c), bytes in rows from the top."""
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    at, idat, chunks = 8, b"", {}
    while at < len(data):
        n, kind = struct.unpack(">I4s", data[at:at + 8])
        body = data[at + 8:at + 8 + n]
        assert struct.unpack(">I", data[at + 8 + n:at + 12 + n])[0] == zlib.crc32(kind + body)
        if kind == b"IDAT":
            idat += body
        chunks[kind] = body
        at += 12 + n
    w, h, depth, colour, _, _, interlace = struct.unpack(">IIBBBBB", chunks[b"IHDR"])
    assert depth == 8 and interlace == 0
    c = {0: 1, 2: 3, 4: 2, 6: 4}[colour]
    raw, out, prev = zlib.decompress(idat), [], [0] * (w * c)
    for y in range(h):
        f, line = raw[y * (w * c + 1)], list(raw[y * (w * c + 1) + 1:(y + 1) * (w * c + 1)])
        for i in range(w * c):
            a, b = line[i - c] if i >= c else 0, prev[i]
            d = prev[i - c] if i >= c else 0
            if f == 1: line[i] += a
            elif f == 2: line[i] += b
            elif f == 3: line[i] += (a + b) // 2
            elif f == 4:
                p = a + b - d
                pa, pb, pd = abs(p - a), abs(p - b), abs(p - d)
                line[i] += a if pa <= pb and pa <= pd else b if pb <= pd else d
            line[i] &= 255
        out += line
        prev = line
    return (h, w, c), out


def read_exr(data):
    """Scan lines, compression none, ZIPS or ZIP: header, and a dict of channel name to (h, w) rows."""
    assert struct.unpack("<I", data[:4])[0] == 20000630
    at, header = 8, {}
    def name():
        nonlocal at
        end = data.index(b"\0", at)
        s = data[at:end].decode()
        at = end + 1
        return s
    while data[at]:
        key, kind = name(), name()
        n = struct.unpack("<I", data[at:at + 4])[0]
        header[key] = (kind, data[at + 4:at + 4 + n])
        at += 4 + n
    at += 1
    channels, body, p = [], header["channels"][1], 0
    while body[p]:
        end = body.index(b"\0", p)
        channels.append((body[p:end].decode(), struct.unpack("<I", body[end + 1:end + 5])[0]))
        p = end + 17
    x0, y0, x1, y1 = struct.unpack("<4i", header["dataWindow"][1])
    w, h, comp = x1 - x0 + 1, y1 - y0 + 1, header["compression"][1][0]
    lines = {0: 1, 2: 1, 3: 16}[comp]
    blocks = (h + lines - 1) // lines
    offsets = struct.unpack("<%dQ" % blocks, data[at:at + 8 * blocks])
    planes = {c: [None] * h for c, _ in channels}
    size = {0: 4, 1: 2, 2: 4}
    for o in offsets:
        y, n = struct.unpack("<iI", data[o:o + 8])
        raw, count = data[o + 8:o + 8 + n], min(lines, y1 + 1 - y)
        want = sum(size[t] for _, t in channels) * w * count
        if comp and n < want:
            d = bytearray(zlib.decompress(raw))
            for i in range(1, len(d)):
                d[i] = (d[i - 1] + d[i] - 128) & 255
            raw = bytearray(len(d))
            half = (len(d) + 1) // 2
            raw[0::2], raw[1::2] = d[:half], d[half:]
        q = 0
        for row in range(y - y0, y - y0 + count):
            for c, t in channels:
                planes[c][row] = struct.unpack_from("<%d%s" % (w, "Ief"[t]), raw, q)
                q += size[t] * w
    text = {k: v.decode(errors="replace") for k, (t, v) in header.items() if t == "string"}
    number = {k: struct.unpack("<f" if t == "float" else "<d" if t == "double" else "<i", v)[0] for k, (t, v) in header.items() if t in ("float", "double", "int")}
    return dict(text=text, number=number, width=w, height=h), planes, dict(channels)


def write_exr(w, h, planes):
    """Float channels, no compression; planes: name to rows from the top."""
    names = sorted(planes)
    def attr(key, kind, body):
        return key + b"\0" + kind + b"\0" + struct.pack("<I", len(body)) + body
    box = struct.pack("<4i", 0, 0, w - 1, h - 1)
    ch = b"".join(n.encode() + b"\0" + struct.pack("<IIII", 2, 0, 1, 1)[:4] + b"\0\0\0\0" + struct.pack("<II", 1, 1) for n in names) + b"\0"
    head = struct.pack("<II", 20000630, 2) + attr(b"channels", b"chlist", ch) + attr(b"compression", b"compression", b"\0") + attr(b"dataWindow", b"box2i", box)
    head += attr(b"displayWindow", b"box2i", box) + attr(b"lineOrder", b"lineOrder", b"\0") + attr(b"pixelAspectRatio", b"float", struct.pack("<f", 1))
    head += attr(b"screenWindowCenter", b"v2f", struct.pack("<2f", 0, 0)) + attr(b"screenWindowWidth", b"float", struct.pack("<f", 1)) + b"\0"
    size = 8 + 4 * w * len(names)
    out = head + struct.pack("<%dQ" % h, *[len(head) + 8 * h + y * size for y in range(h)])
    for y in range(h):
        out += struct.pack("<iI", y, size - 8) + b"".join(struct.pack("<%df" % w, *planes[n][y]) for n in names)
    return out


def to_srgb(v):
    v = min(max(v, 0.0), 1.0)
    return 12.92 * v if v <= 0.0031308 else 1.055 * v ** (1 / 2.4) - 0.055


def f32(x):
    return struct.unpack("<f", struct.pack("<f", x))[0]
