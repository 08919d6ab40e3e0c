#!/usr/bin/env python3
"""Gradient images of examples/cone_light: mean squared error at equal time, by estimator.

    python3 tests/bench/cone.py [--saltus build/bin/saltus] [--size 96] [--spp 16] [--runs 8] [--reference 4096]

For the light's and the terrain's movement: a converged reference by slices, in independent runs whose spread is its standard error; every estimator at --spp samples, --runs seeds; its mean squared
error over all pixels, its seconds (of the estimate, one thread, without compiling), and error x seconds against that of slices: the ratio of errors at equal time, as variance falls with samples.
With --plot FILE.svg, root mean squared error against seconds, at 1 to 64 samples, instead.
Last: how far slices' mean over the runs, and that of sites, is from the reference, in standard errors of a pixel (3 % of all pixels, about, lie beyond 3 of them with 8 runs, as t has 7 degrees of
freedom) and of the whole image."""
import argparse
import array
import json
import math
import os
import subprocess
import sys
import tempfile

HERE = os.path.dirname(os.path.abspath(__file__))
CONE = os.path.join(HERE, "..", "..", "examples", "cone_light")


def image(path):
    with open(path, "rb") as f:
        data = f.read()
    values = array.array("f")
    values.frombytes(data[10 + int.from_bytes(data[8:10], "little"):])
    return values


def gradient(o, shader, parameter, spp, seed, *more):
    """The derivative image of the parameter, its pixels in rows, and the seconds it took."""
    with tempfile.TemporaryDirectory() as folder:
        out = os.path.join(folder, "g.npy")
        line = [o.saltus, "grad", os.path.join(CONE, shader), "--wrt", parameter, "--size", str(o.size), "--spp", str(spp), "--seed", str(seed), "--threads", str(o.threads), "-o", out, "--json", *more]
        run = subprocess.run(line, capture_output=True, text=True)
        if run.returncode:
            sys.exit(" ".join(line) + "\n" + run.stderr)
        values = image(out)
        channels = len(values) // (o.size * o.size)
        return values[CHANNEL if channels > 1 else 0::channels], json.loads(run.stdout)["seconds"]


CHANNEL = 1  # of the array: the picture itself comes first


ESTIMATORS = (("slices", "slices.salt", ()), ("sites", "boundary.salt", ()), ("sites, snap-knn", "boundary.salt", ("--estimator", "snap-knn")),
              ("sites, snap-crofton", "boundary.salt", ("--estimator", "snap-crofton")), ("differences", "boundary.salt", ("--estimator", "fd")))
COLOURS = ("#c0392b", "#2c6fbb", "#7aa7d6", "#a8c8e8", "#444444")


def reference(o, parameter):
    """Means of 8 independent runs, and the variance of each mean."""
    parts = [gradient(o, "slices.salt", parameter, o.reference // 8, 1000 + k)[0] for k in range(8)]
    n = len(parts[0])
    mean = [sum(p[i] for p in parts) / 8 for i in range(n)]
    return mean, [sum((p[i] - mean[i]) ** 2 for p in parts) / 56 for i in range(n)]


def plot(o):
    """Both parameters side by side; logarithmic axes, a grid line a decade."""
    width, height, left, top = 330, 260, 60, 30
    out = ['<svg xmlns="http://www.w3.org/2000/svg" width="%d" height="%d" font-family="sans-serif" font-size="11">' % (2 * (width + left) + 20, height + 110),
           '<rect width="100%" height="100%" fill="white"/>']
    for column, parameter in enumerate(("scene.light", "scene.rise")):
        mean, var = reference(o, parameter)
        signal = math.sqrt(sum(m * m for m in mean) / len(mean))
        curves = []
        for _, shader, more in ESTIMATORS:
            points = []
            for spp in (1, 2, 4, 8, 16, 32, 64):
                images, seconds = zip(*(gradient(o, shader, parameter, spp, 1 + k, *more) for k in range(o.runs)))
                mse = sum((v[i] - mean[i]) ** 2 - var[i] for v in images for i in range(len(mean))) / (o.runs * len(mean))
                points.append((min(seconds), math.sqrt(max(mse, 1e-12)) / signal))
            curves.append(points)
        xs, ys = [[math.log10(p[a]) for c in curves for p in c] for a in (0, 1)]
        x0, x1, y0, y1 = min(xs) - 0.1, max(xs) + 0.1, min(ys) - 0.1, max(ys) + 0.1
        at_x = lambda v: left + column * (width + left) + width * (v - x0) / (x1 - x0)
        at_y = lambda v: top + height * (y1 - v) / (y1 - y0)
        out.append('<text x="%g" y="18">d/d(%s): relative RMS error against seconds</text>' % (at_x(x0), parameter))
        for e in range(-6, 6):
            if x0 < e < x1:
                out.append('<path d="M%g %gV%g" stroke="#ddd"/><text x="%g" y="%g" text-anchor="middle">1e%d</text>' % (at_x(e), top, top + height, at_x(e), top + height + 14, e))
            if y0 < e < y1:
                out.append('<path d="M%g %gH%g" stroke="#ddd"/><text x="%g" y="%g" text-anchor="end">1e%d</text>' % (at_x(x0), at_y(e), at_x(x1), at_x(x0) - 4, at_y(e) + 4, e))
        out.append('<rect x="%g" y="%g" width="%g" height="%g" fill="none" stroke="#888"/>' % (at_x(x0), top, width, height))
        for k, points in enumerate(curves):
            where = ["%.1f,%.1f" % (at_x(math.log10(x)), at_y(math.log10(y))) for x, y in points]
            out.append('<polyline points="%s" fill="none" stroke="%s" stroke-width="1.6"/>' % (" ".join(where), COLOURS[k]))
            out.extend('<circle cx="%s" cy="%s" r="2.4" fill="%s"/>' % (*w.split(","), COLOURS[k]) for w in where)
    for k, (name, _, _) in enumerate(ESTIMATORS):
        x, y = left + 250 * (k % 3), top + height + 40 + 20 * (k // 3)
        out.append('<path d="M%d %dh24" stroke="%s" stroke-width="2"/><text x="%d" y="%d">%s</text>' % (x, y, COLOURS[k], x + 30, y + 4, name))
    with open(o.plot, "w") as f:
        f.write("\n".join(out) + "\n</svg>\n")


def main():
    a = argparse.ArgumentParser()
    a.add_argument("--saltus", default=os.environ.get("SALTUS_BIN", "saltus"))
    a.add_argument("--size", type=int, default=96)
    a.add_argument("--spp", type=int, default=16)
    a.add_argument("--runs", type=int, default=8)
    a.add_argument("--reference", type=int, default=4096)
    a.add_argument("--threads", type=int, default=1)
    a.add_argument("--json", action="store_true")
    a.add_argument("--plot")
    o = a.parse_args()
    if o.plot:
        return plot(o)
    pixels = o.size * o.size
    result = {}
    for parameter in ("scene.light", "scene.rise"):
        mean, var = reference(o, parameter)
        signal = sum(m * m for m in mean) / pixels
        rows = []
        for name, shader, more in ESTIMATORS:
            images, seconds = zip(*(gradient(o, shader, parameter, o.spp, 1 + k, *more) for k in range(o.runs)))
            mse = sum((v[i] - mean[i]) ** 2 - var[i] for v in images for i in range(pixels)) / (o.runs * pixels)
            average = [sum(v[i] for v in images) / o.runs for i in range(pixels)]
            own = [sum((v[i] - average[i]) ** 2 for v in images) / (o.runs * (o.runs - 1)) for i in range(pixels)]
            # A pixel of which no run saw the edge has no spread of its own: counted apart.
            z = [(average[i] - mean[i]) / math.sqrt(own[i] + var[i]) for i in range(pixels) if own[i] > 0 and var[i] > 0]
            totals = [sum(v) for v in images]
            centre = sum(totals) / o.runs
            spread = math.sqrt(sum((t - centre) ** 2 for t in totals) / (o.runs * (o.runs - 1)) + sum(var))
            rows.append({"estimator": name, "mse": mse, "relative_rmse": math.sqrt(max(mse, 0) / signal), "seconds": min(seconds), "beyond_3": sum(abs(x) > 3 for x in z) / len(z),
                         "total_z": (centre - sum(mean)) / spread})
        base = rows[0]["mse"] * rows[0]["seconds"]
        print("d/d(%s): mean square of the reference %.4g, its own error %.2g" % (parameter, signal, sum(var) / pixels))
        print("  %-20s %12s %10s %9s %12s %12s %10s" % ("", "mse", "rel. rmse", "seconds", "equal time", "beyond 3 se", "total, se"))
        for r in rows:
            r["equal_time"] = r["mse"] * r["seconds"] / base
            print("  %-20s %12.5g %10.3g %9.3f %11.3gx %11.2f%% %10.2f" % (r["estimator"], r["mse"], r["relative_rmse"], r["seconds"], r["equal_time"], 100 * r["beyond_3"], r["total_z"]))
        result[parameter] = rows
    if o.json:
        print(json.dumps(result))


if __name__ == "__main__":
    main()
