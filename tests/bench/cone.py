#!/usr/bin/env python3
"""Gradient images of examples/cone_light: mean squared error at equal time, by estimator.

    python3 tests/bench/cone.py [--saltus build/bin/saltus] [--size 96] [--spp 16] [--runs 8] [--reference 4096]

For the light's and the terrain's movement: a converged reference by slices, in independent runs whose spread is its standard error; every estimator at --spp samples, --runs seeds; its mean squared
error over all pixels, its seconds (of the estimate, one thread, without compiling), and error x seconds against that of slices: the ratio of errors at equal time, as variance falls with samples.
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


def main():
    a = argparse.ArgumentParser()
    a.add_argument("--saltus", default=os.environ.get("SALTUS_BIN", "saltus"))
    a.add_argument("--size", type=int, default=96)
    a.add_argument("--spp", type=int, default=16)
    a.add_argument("--runs", type=int, default=8)
    a.add_argument("--reference", type=int, default=4096)
    a.add_argument("--threads", type=int, default=1)
    a.add_argument("--json", action="store_true")
    o = a.parse_args()
    pixels = o.size * o.size
    result = {}
    for parameter in ("scene.light", "scene.rise"):
        parts = [gradient(o, "slices.salt", parameter, o.reference // 8, 1000 + k)[0] for k in range(8)]
        mean = [sum(p[i] for p in parts) / 8 for i in range(pixels)]
        var = [sum((p[i] - mean[i]) ** 2 for p in parts) / 56 for i in range(pixels)]
        signal = sum(m * m for m in mean) / pixels
        rows = []
        for name, shader, more in (("slices", "slices.salt", ()), ("sites", "boundary.salt", ()), ("sites, snap-knn", "boundary.salt", ("--estimator", "snap-knn")),
                                   ("sites, snap-crofton", "boundary.salt", ("--estimator", "snap-crofton")), ("differences", "boundary.salt", ("--estimator", "fd"))):
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
