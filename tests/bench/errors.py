#!/usr/bin/env python3
"""Error against run time, for docs/errors.md: its tables and plots.

    tests/bench/errors.py build/bin/saltus              all of it, in some minutes (and the target bench-search)
    tests/bench/errors.py build/bin/saltus circle depth    some of it: the plots, and the tables to standard output

Errors are relative to a reference (quadrature to 1e-11 where that states so, else a lattice of 64 times the samples), root mean
square over seeds; evaluations are exact; seconds are processor time of one thread, which a loaded machine lengthens by some tenths."""
import csv
import math
import os
import shutil
import subprocess
import sys
import tempfile

ROOT = os.path.normpath(os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", ".."))
DOCS = os.path.join(ROOT, "docs")
ALL = "lattice,scanline,snap-knn,snap-crofton,fd,quadrature"
FEW = "discs[60].centre,discs[60].radius,discs[60].ink"
SCENES = {  # name: file, options
    "circle": ("examples/circle/circle.salt", []),
    "flower": ("examples/implicit_flower/flower.salt", []),
    "thin_bands": ("examples/thin_bands/bands.salt", []),
    "high_frequency": ("examples/high_frequency/zone_plate.salt", ["--wrt", "frequency,phase"]),
    "checkerboard": ("examples/checkerboard_tree/tree.salt", []),
    "painterly": ("examples/painterly_discs/discs.salt", ["--wrt", FEW, "--samples", "2^16"]),
}
GRID = """const int G = %d;
float dome(int i, int j) { float u = float(i) / float(G - 1) - 0.48, v = float(j) / float(G - 1) - 0.52; return 0.1 - u * u - v * v; }
param float level[G][G] = init(dome);
shader float main(float2 x) {
    float2 p = x * (G - 1);
    [NoDisc] int2 c = clamp(int2(floor(p)), int2(0, 0), int2(G - 2, G - 2));
    float2 t = p - c;
    float a = lerp(level[c.y][c.x], level[c.y][c.x + 1], t.x), b = lerp(level[c.y + 1][c.x], level[c.y + 1][c.x + 1], t.x), f = 0.0;
    [Disc] if (lerp(a, b, t.y) > 0.0) f = 1.0;
    return f;
}
"""


def bench(saltus, source, *options, estimators=ALL, repeats=8, seconds=240):
    """Rows of its CSV as dicts of numbers, and its plot."""
    with tempfile.TemporaryDirectory() as folder:
        line = [saltus, "bench", source, "--precision", "f64", "--threads", "1", "--quiet", "--estimators", estimators, "--repeats", str(repeats),
                "--max-seconds", str(seconds), "-o", folder, *options]
        r = subprocess.run(line, cwd=ROOT, capture_output=True, text=True)
        if not os.path.exists(os.path.join(folder, "bench.csv")):
            sys.exit("%s\n%s" % (" ".join(line), r.stderr))
        with open(os.path.join(folder, "bench.csv")) as f:
            rows = [{k: v if k == "estimator" else float(v) for k, v in row.items()} for row in csv.DictReader(f)]
        with open(os.path.join(folder, "bench.svg")) as f:
            return rows, f.read()


# ---- plots of what `bench` does not plot itself
COLOURS = ("#1b6ca8", "#c0392b", "#2e8b57", "#8e44ad", "#d68910", "#555555", "#0e9aa7")


def plot(path, title, x_name, y_name, curves):
    """Curves {name: [(x, y)]} on logarithmic axes."""
    W, H, L, R, T, B = 520, 340, 62, 130, 30, 44
    points = [p for c in curves.values() for p in c if p[0] > 0 and p[1] > 0]
    ends = [(math.floor(math.log10(min(p[k] for p in points))), math.ceil(math.log10(max(p[k] for p in points)))) for k in (0, 1)]
    ends = [(a, max(b, a + 1)) for a, b in ends]
    at = lambda v, k: (math.log10(v) - ends[k][0]) / (ends[k][1] - ends[k][0])
    px, py = lambda x: L + at(x, 0) * (W - L - R), lambda y: H - B - at(y, 1) * (H - T - B)
    out = ['<svg xmlns="http://www.w3.org/2000/svg" width="%d" height="%d" font-family="sans-serif" font-size="11">' % (W, H), '<rect width="100%" height="100%" fill="white"/>',
           '<text x="%d" y="18" font-size="13">%s</text>' % (L, title)]
    for k in (0, 1):
        for d in range(ends[k][0], ends[k][1] + 1):
            a = px(10.0 ** d) if k == 0 else py(10.0 ** d)
            out.append('<path d="M%s" stroke="#ddd"/>' % ("%.1f %d V%d" % (a, T, H - B) if k == 0 else "%d %.1f H%d" % (L, a, W - R)))
            out.append('<text x="%.1f" y="%.1f" text-anchor="%s">1e%d</text>' % ((a, H - B + 14, "middle", d) if k == 0 else (L - 5, a + 4, "end", d)))
    out.append('<text x="%d" y="%d" text-anchor="middle">%s</text>' % ((L + W - R) / 2, H - 8, x_name))
    out.append('<text transform="translate(14,%d) rotate(-90)" text-anchor="middle">%s</text>' % ((T + H - B) / 2, y_name))
    for i, (name, c) in enumerate(curves.items()):
        colour = COLOURS[i % len(COLOURS)]
        c = [p for p in c if p[0] > 0 and p[1] > 0]
        out.append('<polyline fill="none" stroke="%s" stroke-width="1.5" points="%s"/>' % (colour, " ".join("%.1f,%.1f" % (px(x), py(y)) for x, y in c)))
        out += ['<circle cx="%.1f" cy="%.1f" r="2.5" fill="%s"/>' % (px(x), py(y), colour) for x, y in c]
        out.append('<text x="%d" y="%d" fill="%s">%s</text>' % (W - R + 8, T + 14 + 16 * i, colour, name))
    with open(path, "w") as f:
        f.write("\n".join(out + ["</svg>", ""]))


def per_cent(v):
    v *= 100
    return "0" if v == 0 else "%.2g" % v if 1e-3 <= v < 100 else "%.0f" % v if v >= 100 else "%.0e" % v


def count(v):
    return "%.3g M" % (v / 1e6) if v >= 1e6 else "%.3g k" % (v / 1e3) if v >= 1e3 else "%d" % v


def ms(v):
    return "%.3g ms" % (1e3 * v)


# ---- what is measured
def scene(saltus, name):
    path, options = SCENES[name]
    rows, svg = bench(saltus, path, *options)
    with open(os.path.join(DOCS, "errors-%s.svg" % name), "w") as f:
        f.write(svg)
    best = {}
    for r in rows:
        best.setdefault(r["estimator"], []).append(r)
    lines = ["| | error at least cost | in the middle | at most |", "|---|---|---|---|"]
    for e, found in best.items():
        if e.startswith("lattice, "):
            continue
        some = [found[0], found[len(found) // 2], found[-1]]
        lines.append("| `%s` | %s |" % (e, " | ".join("%s %%, %s, %s" % (per_cent(r["relative_rmse"]), count(r["evaluations"]), ms(r["seconds"])) for r in some)))
    return lines


def segments(saltus):
    """Boundary segments alone, at samples that stay: of the discs, whose colours have a smooth part as well."""
    lines = ["| segments | " + " | ".join("%s: boundary" % n for n in ("circle", "thin_bands", "checkerboard")) + " |", "|---|---|---|---|"]
    curves = {}
    for name in ("circle", "thin_bands", "checkerboard"):
        rows, _ = bench(saltus, SCENES[name][0], "--boundary-only", "--samples", "2^18", estimators="lattice")
        curves[name] = [(r["samples"], r["relative_rmse"]) for r in rows if r["estimator"] == "lattice"]
    plot(os.path.join(DOCS, "errors-segments.svg"), "lattice: boundary term against segments", "segments", "relative RMSE", curves)
    for i in range(len(curves["circle"])):
        lines.append("| %d | %s |" % (curves["circle"][i][0], " | ".join("%s %%" % per_cent(c[i][1]) for c in curves.values())))
    return lines


def gauss(saltus):
    rows, _ = bench(saltus, SCENES["circle"][0], estimators="quadrature", repeats=3)
    return ["| Gauss points | evaluations | error |", "|---|---|---|"] + ["| %d | %d | %.1e |" % (r["gauss"], r["evaluations"], r["relative_rmse"]) for r in rows if r["estimator"] == "quadrature"]


def search(saltus):
    """Neighbours and halvings, which the command has no options for: `cmake --build build --target bench-search`."""
    lines, found = [], {}
    program = os.path.join(os.path.dirname(saltus), "..", "tests", "bench-search")
    for samples, seeds in (("32768", "16"), ("524288", "8")):
        r = subprocess.run([program, samples, seeds], capture_output=True, text=True, check=True)
        for row in csv.DictReader(r.stdout.splitlines()):
            knob = "neighbours" if row["neighbours"] != "0" else "halvings"
            found.setdefault((knob, row["estimator"], int(row[knob])), []).append((float(row["evaluations"]), float(row["relative_rmse"])))
    for knob in ("neighbours", "halvings"):
        for (k, e, value), at in found.items():
            if k == knob:
                lines.append("| %d %s | `%s` | %s |" % (value, knob, e, " | ".join("%s %%, %s" % (per_cent(error), count(n)) for n, error in at)))
    return ["| | | 32 768 segments | 524 288 |", "|---|---|---|---|"] + lines


def parameters(saltus):
    """A disc as the zero set of a grid: a gradient in 9 to 66 049 numbers of a picture that stays the same."""
    lines, curves = ["| parameters | `lattice` | `quadrature` | `fd` |", "|---|---|---|---|"], {"lattice": [], "quadrature": [], "fd": []}
    with tempfile.TemporaryDirectory() as folder:
        for side in (3, 5, 9, 17, 33, 65, 129, 257):
            source, n, found = os.path.join(folder, "s.salt"), side * side, {}
            with open(source, "w") as f:
                f.write(GRID % side)
            for e in curves:
                if e == "fd" and n > 300:
                    continue
                rows, _ = bench(saltus, source, "--samples", "2^16" if e != "fd" else "2^12", estimators=e, repeats=3)
                r = [r for r in rows if r["estimator"] == e][-1]
                scale = 16 if e == "fd" else 1  # its cost is in proportion to its samples, to the last evaluation
                found[e] = (r["evaluations"] * scale, r["seconds"] * scale)
                curves[e].append((n, r["seconds"] * scale))
            lines.append("| %d | %s |" % (n, " | ".join("%s, %s" % (count(found[e][0]), ms(found[e][1])) if e in found else "" for e in curves)))
    plot(os.path.join(DOCS, "errors-parameters.svg"), "time of a gradient against the number of parameters", "parameters", "processor seconds", curves)
    return lines


def depth(saltus):
    lines, curves, error = ["| depth | parameters | `lattice` | error | `quadrature` |", "|---|---|---|---|---|"], {"lattice": [], "quadrature": []}, []
    for n in range(2, 13, 2):
        found = {}
        for e in curves:
            rows, _ = bench(saltus, SCENES["checkerboard"][0], "--set", "DEPTH=%d" % n, "--samples", "2^16", estimators=e, repeats=4)
            r = [r for r in rows if r["estimator"] == e][-1]
            found[e] = r
            curves[e].append((n, r["seconds"]))
        lines.append("| %d | %d | %s, %s | %s %% | %s, %s |" % (n, 2 ** n - 1, count(found["lattice"]["evaluations"]), ms(found["lattice"]["seconds"]), per_cent(found["lattice"]["relative_rmse"]),
                                                              count(found["quadrature"]["evaluations"]), ms(found["quadrature"]["seconds"])))
        error.append((n, found["lattice"]["relative_rmse"]))
    plot(os.path.join(DOCS, "errors-depth.svg"), "checkerboard tree: against the depth of branching", "depth", "processor seconds; error", dict(curves, **{"error, lattice": error}))
    return lines


PARTS = dict({name: (lambda s, n=name: scene(s, n)) for name in SCENES}, segments=segments, gauss=gauss, search=search, parameters=parameters, depth=depth)


def main(saltus, *names):
    saltus = os.path.abspath(saltus)
    page = os.path.join(DOCS, "errors.md")
    for name in names or PARTS:
        lines = PARTS[name](saltus)
        print("\n".join(lines), flush=True)
        with open(page) as f:
            text = f.read()
        mark = "<!-- %s -->\n" % name
        before, found, after = text.partition(mark)
        assert found, "docs/errors.md has no " + mark
        rest = after.partition("\n\n")[2]
        with open(page, "w") as f:
            f.write(before + mark + "\n".join(lines) + "\n\n" + rest)


if __name__ == "__main__":
    main(*sys.argv[1:])
