#!/usr/bin/env python3
"""Exact pieces beside sites on meshes, for docs/meshes.md: its tables and plots.

    tests/bench/meshes.py build/bin/saltus                 all of it, in some minutes; SALTUS_DATA has spot.obj
    tests/bench/meshes.py build/bin/saltus errors gears    some of it: tables to standard output alone

`errors`: the gradient of sum(adjoint * image), adjoint the difference of the images at the start and at other parameters, as of a
loss; relative to that of the pieces in f64, root mean square over seeds. `fits`: the distance of the parameters to those that the
target was made with. Seconds are processor time of one thread, less that of one pixel (`fits`: of one iteration)."""
import array
import csv
import json
import math
import os
import resource
import statistics
import subprocess
import sys
import tempfile

from errors import DOCS, ROOT, ms, per_cent, plot

SPOT = os.path.join(os.environ.get("SALTUS_DATA", ""), "spot.obj")
SEEDS = 3
FLOOR = 1e-16  # of plots: where an error is 0
EACH = 2  # processor seconds, after which a curve ends
SHADED = """import camera;
import mesh;
%s
const float WIDE = %s;
float3 shading(float3 n) {
    float3 lamps = float3(dot(n, float3(0.8, 0.0, 0.6)), dot(n, float3(-0.4, 0.69, 0.6)), dot(n, float3(-0.4, -0.69, 0.6)));
    return 0.15 + 0.75 * (0.5 + 0.5 * lamps);
}
Camera camera() { return look_at(4.0 * float3(sin(at.x) * cos(at.y), sin(at.y), cos(at.x) * cos(at.y)), float3(0.0), float3(0.0, 1.0, 0.0)); }
shader float3 main(float2 x) {
    Camera c = camera();
    float3 right = WIDE * c.right, up = WIDE * c.up, sum = float3(0.0);
    float seen = 0.0;
    for (Piece q = m.first(pixel_beam(c.eye, -right - up, 2.0 * right, 2.0 * up)); q.found;) {
        sum += q.area * shading(q.normal);
        seen += q.area;
        q = m.next(q);
    }
    return sum + (1.0 - seen) * 0.03;
}
[Domain(-1.0, 1.0)]
shader float3 sites(float2 x) {
    Camera c = camera();
    [Disc] MeshHit hit = m.trace(c.eye, WIDE * (x.x * c.right + x.y * c.up) - c.eye, 0.0, 10.0);
    return hit.hit ? shading(hit.normal) : float3(0.03);
}
"""
AT = "param float2 at = float2(0.5, 0.3);\n"
APART = """param float3 off = float3(0.1, 0.05, 0.0);
float3 moved(int i, float3 p, int part) { return part == 0 ? p : p + off; }
[Vertex(moved)] [NoDiff] param mesh m = "spheres.obj";
"""
ERRORS = {  # name: program, or what makes one in a folder; size; with respect to; the other parameters
    "gears": ("examples/gears/gears.salt", "160x96", "angle", None),
    "displacement": ("examples/displacement/displacement.salt", "96x96", "out_by", None),
    "spheres": (SHADED % (AT + APART, "1.4"), "96x96", "off", "off=[0.12,0.03,0.02]"),
    "spot, camera": (SHADED % ('[NoDiff] param mesh m = "%s";\n' % SPOT + AT, "1.1"), "128x128", "at", "at=[0.52,0.31]"),
    "spot, vertices": (SHADED % ('param mesh m = "%s";\n[NoDiff] ' % SPOT + AT, "1.1"), "128x128", "m", "at=[0.52,0.31]"),
}
ESTIMATORS = ("lattice", "scanline", "snap-knn", "snap-crofton", "fd", "quadrature")
MASKS = ("gears",)  # only whether a ray hits counts, which quadrature integrates along lines
FITS = ("gears", "tree_shadow", "kaleidoscope", "displacement")


def run(saltus, *args, at=ROOT):
    """The JSON that a command prints, and its processor seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    r = subprocess.run([saltus, *args, "--quiet", "--threads", "1"], cwd=at, capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if r.returncode:
        sys.exit("%s\n%s" % (" ".join(args), r.stderr))
    return json.loads(r.stdout or "{}"), after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def flat(v):
    return [x for row in v for x in flat(row)] if isinstance(v, list) else [v]


def distance(a, b):
    return math.sqrt(sum((x - y) ** 2 for x, y in zip(a, b)))


# ---- the spheres, of 1280 faces each
def sphere(centre, radius, levels=3):
    g = (1 + math.sqrt(5)) / 2
    points = [(a, b * g, 0) for a in (-1, 1) for b in (-1, 1)] + [(0, a, b * g) for a in (-1, 1) for b in (-1, 1)] + [(b * g, 0, a) for a in (-1, 1) for b in (-1, 1)]
    points = [tuple(v / math.hypot(*p) for v in p) for p in points]
    near = lambda i, j: distance(points[i], points[j]) < 1.1
    faces = [(i, j, k) for i in range(12) for j in range(i) for k in range(j) if near(i, j) and near(j, k) and near(i, k)]
    for _ in range(levels):
        middle, finer = {}, []
        for f in faces:
            for e in ((f[0], f[1]), (f[1], f[2]), (f[2], f[0])):
                if frozenset(e) not in middle:
                    p = [points[e[0]][d] + points[e[1]][d] for d in range(3)]
                    middle[frozenset(e)] = len(points)
                    points.append(tuple(v / math.hypot(*p) for v in p))
            ab, bc, ca = (middle[frozenset(e)] for e in ((f[0], f[1]), (f[1], f[2]), (f[2], f[0])))
            finer += [(f[0], ab, ca), (f[1], bc, ab), (f[2], ca, bc), (ab, bc, ca)]
        faces = finer
    out = []
    for f in faces:  # counter-clockwise from outside
        a, b, c = (points[i] for i in f)
        u, v = [b[d] - a[d] for d in range(3)], [c[d] - a[d] for d in range(3)]
        volume = a[0] * (u[1] * v[2] - u[2] * v[1]) + a[1] * (u[2] * v[0] - u[0] * v[2]) + a[2] * (u[0] * v[1] - u[1] * v[0])
        out.append(f if volume > 0 else (f[0], f[2], f[1]))
    return [[centre[d] + radius * p[d] for d in range(3)] for p in points], out


def write_spheres(path):
    with open(path, "w") as f:
        first = 1
        for name, centre, radius in (("a", (-0.3, 0.0, 0.0), 0.8), ("b", (0.3, 0.05, 0.2), 0.7)):
            points, faces = sphere(centre, radius)
            f.write("o %s\n" % name + "".join("v %.6f %.6f %.6f\n" % tuple(p) for p in points) + "".join("f %d %d %d\n" % tuple(first + i for i in t) for t in faces))
            first += len(points)


# ---- images, as .npy of 32-bit floats
def read_npy(path):
    with open(path, "rb") as f:
        data = f.read()
    n = 10 + int.from_bytes(data[8:10], "little")
    assert b"'<f4'" in data[:n], path
    return data[:n], array.array("f", data[n:])


# ---- errors of gradients
def scene_error(saltus, name, folder):
    source, size, wrt, other = ERRORS[name]
    if "spot" in name and not os.path.exists(SPOT):
        sys.exit("set SALTUS_DATA to where spot.obj is, or name other scenes")
    if "\n" in source:
        write_spheres(os.path.join(folder, "spheres.obj"))
        text, source = source, os.path.join(folder, "s.salt")
        with open(source, "w") as f:
            f.write(text)
    if not other:
        of = os.path.dirname(os.path.join(ROOT, source))
        with open(os.path.join(of, "scene.json")) as f:
            value = json.load(f)["views"][0]["target"]["params"][wrt]
        other = "%s=%s" % (wrt, "@" + os.path.join(of, value["file"]) if isinstance(value, dict) else json.dumps(value))
    images = [os.path.join(folder, "%s.npy" % n) for n in ("here", "there", "adjoint", "one")]
    run(saltus, "render", source, "--size", size, "-o", images[0])
    run(saltus, "render", source, "--size", size, "--param", other, "-o", images[1])
    run(saltus, "render", source, "--size", "1x1", "-o", images[3])
    head, here = read_npy(images[0])
    _, there = read_npy(images[1])
    with open(images[2], "wb") as f:
        f.write(head + array.array("f", [a - b for a, b in zip(here, there)]).tobytes())

    line = ["grad", source, "--wrt", wrt, "--json"]
    one = [*line, "--entry", "sites", "--size", "1x1", "--adjoint", images[3], "--spp", "1", "--segments", "1", "--estimator", "lattice"]
    start = min(run(saltus, *one)[1] for _ in range(3))

    def gradient(*options):
        j, seconds = min((run(saltus, *line, "--size", size, "--adjoint", images[2], *options) for _ in range(1 if "--seed" in options else 2)), key=lambda r: r[1])
        return flat(j["gradient"][wrt]), max(seconds - start, 1e-4)

    wanted, seconds = gradient("--precision", "f64")
    scale = distance(wanted, [0] * len(wanted))
    single = gradient()
    curves = {"pieces, f32": [(single[1], distance(single[0], wanted) / scale)]}
    table = {"`pieces`, f64": ["the reference, %s" % ms(seconds)], "`pieces`, f32": ["%s %%, %s" % (per_cent(curves["pieces, f32"][0][1]), ms(curves["pieces, f32"][0][0]))]}
    for e in ESTIMATORS:
        if (e == "fd" and len(wanted) > 300) or (e == "quadrature" and name not in MASKS):
            continue
        precision = ["--precision", "f64"] if e == "quadrature" else []
        curves[e], spent, row = [], 0, []
        for spp in (1, 4, 16, 64, 256):
            square, taken = 0, []
            for seed in range(1, SEEDS + 1):
                g, seconds = gradient("--entry", "sites", "--estimator", e, "--spp", str(spp), "--segments", str(spp), "--seed", str(seed), *precision)
                square += (distance(g, wanted) / scale) ** 2 / SEEDS
                taken.append(seconds)
            curves[e].append((statistics.median(taken), math.sqrt(square)))
            spent += sum(taken)
            if 2 * spent > EACH:
                break
        some = [curves[e][0], curves[e][len(curves[e]) // 2], curves[e][-1]]
        table["`%s`" % e] = ["%s %%, %s" % (per_cent(error), ms(t)) for t, error in some]
    return curves, table


# ---- fits
def absolute(v, folder):
    """A scene that names files by whole paths."""
    if isinstance(v, dict):
        return {k: os.path.join(folder, w) if k in ("shader", "file") else absolute(w, folder) for k, w in v.items()}
    return [absolute(w, folder) for w in v] if isinstance(v, list) else v


def read_csv(path):
    with open(path) as f:
        return [float(v) for row in csv.reader(f) for v in row]


def scene_fit(saltus, name, folder):
    of, curves, table = os.path.join(ROOT, "examples", name), {}, {}
    for optimizer in ("lbfgs", "adam"):
        for entry in ("pieces", "sites"):
            with open(os.path.join(of, "adam.json" if entry == "sites" else "scene.json")) as f:
                scene = absolute(json.load(f), of)
            scene["optimizer"]["type"] = optimizer
            (parameter, how), = scene["params"].items()
            how.update({"lr": 0.02} if optimizer == "adam" else {})
            for view in scene["views"]:
                view["target"]["entry"] = "main"
            true = scene["views"][0]["target"]["params"][parameter]
            true = read_csv(true["file"]) if isinstance(true, dict) else flat(true)
            path, label = os.path.join(folder, "scene.json"), "%s, %s" % ({"lbfgs": "L-BFGS", "adam": "Adam"}[optimizer], entry)
            with open(path, "w") as f:
                json.dump(scene, f)
            curve, first, ended = [], None, ""
            for iters in (1, 2, 4, 8, 16, 32, 64, 128, 256):
                j, seconds = run(saltus, "fit", path, "--iters", str(iters), "--json", "-o", os.path.join(folder, "out"))
                with open(os.path.join(folder, "out", "fitted.json")) as f:
                    found = flat(json.load(f)[parameter])
                first = seconds if first is None else first
                if iters > 1:
                    curve.append((j["iterations"], max(seconds - first, 1e-3), distance(found, true) / math.sqrt(len(true))))
                if j["iterations"] < iters:
                    ended = ", where it ends"
                if ended or seconds > EACH:
                    break
            curves[label] = [(t, max(e, FLOOR)) for _, t, e in curve]
            at = lambda n: next(("%.1e" % e if e else "0" for i, _, e in curve if i == n), "")
            table[label] = [at(8), at(32), "%.1e after %d%s, %.3g s" % (curve[-1][2], curve[-1][0], ended, curve[-1][1])]
    return curves, table


PARTS = {
    "errors": (ERRORS, scene_error, "relative RMSE", "| %s | error at least cost | in the middle | at most |"),
    "fits": (FITS, scene_fit, "RMSE of the parameters", "| %s | after 8 iterations | after 32 | at the end |"),
}


def compose(path, panels):
    """One picture of several, two beside each other: as groups, since not every viewer places pictures in pictures."""
    ground = '<rect width="100%" height="100%" fill="white"/>\n'
    with open(path, "w") as f:
        f.write('<svg xmlns="http://www.w3.org/2000/svg" width="1040" height="%d">\n%s' % (340 * ((len(panels) + 1) // 2), ground))
        for i, p in enumerate(panels):
            inner = p.replace(ground, "").partition("\n")[2].replace("</svg>", "</g>")
            f.write('<g transform="translate(%d,%d)" font-family="sans-serif" font-size="11">\n%s' % (520 * (i % 2), 340 * (i // 2), inner))
        f.write("</svg>\n")


def write_page(what, lines, panels):
    compose(os.path.join(DOCS, "meshes-%s.svg" % what), panels)
    page, mark, end = os.path.join(DOCS, "meshes.md"), "<!-- %s -->\n" % what, "<!-- end of %s -->\n" % what
    with open(page) as f:
        before, _, rest = f.read().partition(mark)
    with open(page, "w") as f:
        f.write(before + mark + "\n".join(lines) + end + rest.partition(end)[2])


def part(saltus, what, names):
    scenes, measure, y_name, head = PARTS[what]
    lines, panels = [], []
    for name in names or scenes:
        with tempfile.TemporaryDirectory() as folder:
            curves, table = measure(saltus, name, folder)
            plot(os.path.join(folder, "plot.svg"), name.replace("_", " "), "processor seconds", y_name, curves)
            with open(os.path.join(folder, "plot.svg")) as f:
                panels.append(f.read())
        rows = [head % name.replace("_", " "), "|---|---|---|---|"] + ["| %s | %s |" % (k, " | ".join(v + [""] * (3 - len(v)))) for k, v in table.items()]
        print("\n".join(rows) + "\n", flush=True)
        lines += rows + [""]
        if not names:  # what has been measured stands there, if the rest is not waited for
            write_page(what, lines, panels)


def main(saltus, what=None, *names):
    for w in [what] if what else PARTS:
        part(os.path.abspath(saltus), w, names)


if __name__ == "__main__":
    main(*sys.argv[1:])
