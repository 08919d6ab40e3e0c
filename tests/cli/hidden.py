"""Scenes with a hidden feature of about 1e-6 of the domain, and the derivatives of their integral in closed form.

    tests/cli/hidden.py SALTUS [--scenes 300] [--first 0] [--by 1] [--series 0] [--verbose] [-- options of grad]

300 scenes: 243 in the plane (nine features, each written in nine ways), 30 on a line, 27 in space; among them opaque
decoys elsewhere, domains of all sizes, straight and turned; other numbers by --series. Of every scene: found (every derivative within 1e-4 of its own
size), stated (within two stated errors), reported (something is left over, and no more than 1e-4 of the largest derivative
is wrong: ends of bands, which are as long as these are thin), or silently missed. Fails where one is missed."""
import json
import math
import os
import random
import subprocess
import sys
import tempfile

THIN = 1e-6  # of the side of the domain


class Scene:
    def __init__(self, kind, source, want):
        self.kind, self.source, self.want = kind, source, want


# ---- features: within the disc of radius 1 around the origin of u, of width w; what they add is constant. Each gives
# parameters, statements that leave d (negative inside), and d(area)/d(parameter) in units of u.

def ring(r, w, turn):
    radius = r.uniform(0.3, 0.8)
    return {"w": w, "rho": radius}, "float d = abs(length(u) - rho) - 0.5 * w;", {"w": 2 * math.pi * radius, "rho": 2 * math.pi * w}


def band(r, w, turn):
    half = r.uniform(0.2, 0.7)
    return ({"w": w, "half": half}, "float2 v = float2(%r * u.x + %r * u.y, %r * u.y - %r * u.x); float d = max(abs(v.x) - half, abs(v.y) - 0.5 * w);"
            % (math.cos(turn), math.sin(turn), math.cos(turn), math.sin(turn)), {"w": 2 * half, "half": 2 * w})


def dot(r, w, turn):
    return {"w": w}, "float d = length(u) - 0.5 * w;", {"w": 0.5 * math.pi * w}


def speck(r, w, turn):
    return ({"w": w, "k": 1.5}, "float2 v = float2(%r * u.x + %r * u.y, %r * u.y - %r * u.x); float d = abs(v.x) + k * abs(v.y) - w;"
            % (math.cos(turn), math.sin(turn), math.cos(turn), math.sin(turn)), {"w": 4 * w / 1.5, "k": -2 * w * w / 2.25})


def lens(r, w, turn):
    """Two discs that overlap by w."""
    radius = r.uniform(0.3, 0.5)
    half = math.sqrt(radius * w - 0.25 * w * w)
    angle = math.atan2(half, radius - 0.5 * w)
    far = "float2(%r, %r) * (rho - 0.5 * w)" % (math.cos(turn), math.sin(turn))
    return ({"w": w, "rho": radius}, "float2 c = %s; float d = max(length(u - c), length(u + c)) - rho;" % far,
            {"w": 2 * half, "rho": 2 * (2 * angle * radius) - 4 * half})


def crescent(r, w, turn):
    """A disc that another of its size covers but for w."""
    radius = r.uniform(0.3, 0.6)
    # two discs whose centres are w apart
    half = math.sqrt(radius * radius - 0.25 * w * w)
    low = math.atan2(half, 0.5 * w)
    return ({"w": w, "rho": radius}, "float2 c = float2(%r, %r) * (0.5 * w); float d = max(length(u + c) - rho, rho - length(u - c));" % (math.cos(turn), math.sin(turn)),
            {"w": 2 * half, "rho": 2 * math.pi * radius - 4 * low * radius})


def needle(r, w, turn):
    """A triangle of length 2 h and width w at its foot."""
    h = r.uniform(0.2, 0.6)
    return ({"w": w, "h": h}, "float2 v = float2(%r * u.x + %r * u.y, %r * u.y - %r * u.x); float d = max(abs(v.y) - 0.5 * w * (h - v.x) / (2.0 * h), -v.x - h);"
            % (math.cos(turn), math.sin(turn), math.cos(turn), math.sin(turn)), {"w": h, "h": w})


def wave(r, w, turn):
    """A band whose middle line waves, between u.x = -.6 and .6."""
    return ({"w": w, "a": 0.2}, "float2 v = float2(%r * u.x + %r * u.y, %r * u.y - %r * u.x); float d = max(abs(v.y - a * sin(5.0 * v.x)) - 0.5 * w, abs(v.x) - 0.6);"
            % (math.cos(turn), math.sin(turn), math.cos(turn), math.sin(turn)), {"w": 1.2, "a": 0.0})


def crack(r, w, turn):
    """What two half planes leave between them, in a disc."""
    radius = r.uniform(0.3, 0.7)
    return ({"w": w, "rho": radius}, "float2 v = float2(%r * u.x + %r * u.y, %r * u.y - %r * u.x); float d = max(max(v.y - 0.5 * w, -v.y - 0.5 * w), length(u) - rho);"
            % (math.cos(turn), math.sin(turn), math.cos(turn), math.sin(turn)), {"w": 2 * math.sqrt(radius * radius - 0.25 * w * w), "rho": 4 * radius * math.asin(0.5 * w / radius)})


FEATURES = (ring, band, dot, speck, lens, crescent, needle, wave, crack)

# ---- ways to write it: u is there; adds `ink` where d < 0

WAYS = {
    "if": "{0} [Disc] if (d < 0.0) f += ink;",
    "choice": "{0} [Disc] f += d < 0.0 ? ink : 0.0;",
    "else": "{0} [Disc] if (d >= 0.0) f += 0.0; else f += ink;",
    "within": "[Disc] if (length(u) < 1.5) {{ {0} [Disc] if (d < 0.0) f += ink; }}",
    "and": "{0} [Disc] if (dot(u, u) < 2.25 && d < 0.0) f += ink;",
    "flag": "{0} bool inside; [Disc] inside = d < 0.0; if (inside) f += ink;",
    "loop": "for (int i = 0; i < 9; i++) {{ float2 u = (x - places[i]) / unit; {0} [Disc] if (d < 0.0 && i == 5) f += ink; }}",
    "step": "{0} [Disc] f += ink * step(d, 0.0);",
    "function": "f += ink * feature(u);",
}


def plane(n, series):
    r = random.Random(7000 + n + 100000 * series)
    feature, way = FEATURES[n % len(FEATURES)], list(WAYS)[n // len(FEATURES) % len(WAYS)]
    lo, side = r.choice(((-1.0, 2.0), (0.0, 1.0), (-3.0, 8.0), (10.0, 50.0)))
    unit = side * r.uniform(0.06, 0.2)  # of u, in units of x
    turn = r.choice((0.0, 0.5 * math.pi, r.uniform(0, 2 * math.pi)))
    at = [lo + side * r.uniform(0.25, 0.75) for _ in range(2)]
    w = THIN * side / unit * r.uniform(0.5, 2)
    params, body, area = feature(r, w, turn)
    ink = r.uniform(0.5, 2)
    where = "float2(%r, %r)" % tuple(at)
    decoys = ["float2(%r, %r)" % (lo - 9 * side, at[1] + i) for i in range(9)]
    decoys[5] = where
    radius = side * r.uniform(0.1, 0.2)
    other = [lo + side * r.uniform(0.25, 0.75) for _ in range(2)]
    lines = ["param float %s = %r;" % (k, v) for k, v in params.items()]
    source = "\n".join(lines + [
        "param float big = %r;" % radius,
        "float feature(float2 u) { %s [Disc] if (d < 0.0) return 1.0; return 0.0; }" % body if way == "function" else "",
        "[Domain(%r, %r)] shader float main(float2 x) {" % (lo, lo + side),
        "  float ink = %r, unit = %r;" % (ink, unit),
        "  float2 places[9] = {%s};" % ", ".join(decoys) if way == "loop" else "",
        "  float2 u = (x - %s) / unit;" % where if way != "loop" else "",
        "  float f = 0.0; [Disc] if (length(x - float2(%r, %r)) < big) f = 0.7;" % tuple(other),
        "  " + WAYS[way].format(body),
        "  return f; }"])
    want = {k: ink * unit * unit * v for k, v in area.items()}
    want["big"] = 0.7 * 2 * math.pi * radius
    return Scene("%s, %s" % (feature.__name__, way), source, want)


def finish(kind, params, dim, lo, side, body, want):
    lines = ["param float %s = %r;" % (k, v) for k, v in params.items()]
    lines += ["[Domain(%r, %r)] shader float main(float%s x) { float f = 0.0; %s return f; }" % (lo, lo + side, dim if dim > 1 else "", body)]
    return Scene(kind, "\n".join(lines), want)


def line(n, series):
    r = random.Random(8000 + n + 100000 * series)
    lo, side = r.choice(((-1.0, 2.0), (0.0, 1.0), (10.0, 50.0)))
    at, w, ink = lo + side * r.uniform(0.3, 0.7), THIN * side * r.uniform(0.5, 2), r.uniform(0.5, 2)
    big = lo + side * r.uniform(0.1, 0.9)
    body = "[Disc] if (x < big) f = 0.7; "
    kind = ("part", "product", "two steps", "peaks", "gap")[n % 5]
    want = {"big": 0.7}
    if kind == "part":
        params, text = {"w": w}, "[Disc] if (abs(x - %r) < 0.5 * w) f += %r;" % (at, ink)
        want["w"] = ink
    elif kind == "product":
        params, text = {"a": at, "b": at + w}, "[Disc] if ((x - a) * (x - b) < 0.0) f += %r;" % ink
        want.update(a=-ink, b=ink)
    elif kind == "two steps":
        params, text = {"w": w}, "[Disc] f += %r * step(%r, x); [Disc] f -= %r * step(%r + w, x);" % (ink, at, ink, at)
        want["w"] = ink
    elif kind == "peaks":  # of a cosine, seven of them, of width w each
        k = 2 * math.pi * 7 / side
        low = 2 * math.sin(0.25 * k * w) ** 2
        params, text = {"t": low}, "[Disc] if (cos(%r * (x - %r)) > 1.0 - t) f += %r;" % (k, lo + side / 14, ink)
        want["t"] = ink * 7 * 2 / (k * math.sqrt(low * (2 - low)))
    else:  # between two that are seen
        params, text = {"w": w}, "float g = 0.5; [Disc] if (x < %r) g = %r; [Disc] if (x > %r + w) g = %r; f += g;" % (at, ink, at, ink)
        want["w"] = 0.5 - ink
    params["big"] = big
    return finish("line, " + kind, params, 1, lo, side, body + text, want)


def solid(n, series):
    r = random.Random(9000 + n + 100000 * series)
    lo, side = r.choice(((-1.0, 2.0), (0.0, 1.0)))
    w, ink, radius = THIN * side * r.uniform(0.5, 2), r.uniform(0.5, 2), side * r.uniform(0.1, 0.2)
    at = tuple(lo + side * r.uniform(0.3, 0.7) for _ in range(3))
    other = tuple(lo + side * r.uniform(0.3, 0.7) for _ in range(3))
    kind = ("slab", "shell", "ball", "rod")[n % 4]
    u = "float3 u = x - float3(%r, %r, %r); " % at
    want = {"big": 0.7 * 4 * math.pi * radius * radius}
    if kind == "slab":
        text, want["w"] = "[Disc] if (abs(u.z) < 0.5 * w) f += %r;" % ink, ink * side * side
    elif kind == "shell":
        rho = side * r.uniform(0.1, 0.25)
        text, want["w"] = "[Disc] if (abs(length(u) - %r) < 0.5 * w) f += %r;" % (rho, ink), ink * 4 * math.pi * rho * rho
    elif kind == "ball":
        text, want["w"] = "[Disc] if (length(u) < 0.5 * w) f += %r;" % ink, ink * 0.5 * math.pi * w * w
    else:
        half = side * r.uniform(0.1, 0.25)
        text, want["w"] = "[Disc] if (max(length(u.xy) - 0.5 * w, abs(u.z) - %r) < 0.0) f += %r;" % (half, ink), ink * math.pi * w * half
    return finish("solid, " + kind, {"w": w, "big": radius}, 3, lo, side, "[Disc] if (length(x - float3(%r, %r, %r)) < big) f = 0.7; " % other + u + text, want)


def scene(n, series=0):
    return (plane if n < 243 else line if n < 273 else solid)(n, series)


def judge(s, j):
    kinds, largest = [], max(map(abs, s.want.values()))
    for k, want in s.want.items():
        got, bar = j["gradient"][k], j["stderr"][k]
        off = abs(got - want) if got is not None else math.inf
        bar = bar if bar is not None else math.inf
        if off <= 1e-4 * abs(want) + 1e-12 * largest:
            kinds.append("found")
        elif off <= 2 * bar:
            kinds.append("stated")
        elif j["left"] > 0 and off <= max(10 * bar, 1e-4 * largest):
            kinds.append("reported")
        else:
            kinds.append("missed")
    return max(kinds, key=("found", "stated", "reported", "missed").index)


def measure(saltus, n, folder, options, series=0):
    s = scene(n, series)
    with open(os.path.join(folder, "s.salt"), "w") as f:
        f.write(s.source)
    run = subprocess.run([saltus, "grad", "s.salt", "--integral", "--json", "--precision", "f64", "--threads", "1", "--no-cache", *options],
                         cwd=folder, capture_output=True, text=True, timeout=1200)
    if run.returncode not in (0, 6):
        raise RuntimeError("scene %d, %s: status %d\n%s\n%s" % (n, s.kind, run.returncode, run.stderr, s.source))
    j = json.loads(run.stdout)
    return s, j, judge(s, j)


def main():
    own, _, rest = "\0".join(sys.argv[1:]).partition("\0--\0")
    own = own.split("\0")
    saltus, verbose = os.path.abspath(own[0]), "--verbose" in own
    number = lambda name, usual: int(own[own.index(name) + 1]) if name in own else usual
    first, scenes, by, series = number("--first", 0), number("--scenes", 300), number("--by", 1), number("--series", 0)
    count = {}
    with tempfile.TemporaryDirectory() as folder:
        for n in range(first, first + scenes, by):
            s, j, is_ = measure(saltus, n, folder, rest.split("\0") if rest else [], series)
            count[is_] = count.get(is_, 0) + 1
            if verbose or is_ == "missed":
                print(n, s.kind, is_, "certified %.9g evaluations %d" % (j["certified"], j["evaluations"]),
                      {k: "%.6g +- %.2g (%.6g)" % (j["gradient"][k], j["stderr"][k], v) for k, v in s.want.items()}, flush=True)
    print(count)
    return "missed" in count


if __name__ == "__main__":
    sys.exit(main())
