#!/usr/bin/env python3
"""What an iteration of a fit of a fine mesh costs: a ball of 20 480 triangles, all 30 726 coordinates of its vertices, to eight views
of a rough one.

    tests/bench/mesh_fit.py build/bin/saltus [--size 256] [--iters 21] [--rounds 3] [OPTION OF saltus fit ...]
    tests/bench/mesh_fit.py --keep FOLDER      the files alone: saltus fit FOLDER/scene.json

Seconds an iteration, on the clock and of processor: a fit of so many iterations less one of a single iteration, the least of rounds."""
import argparse
import json
import math
import os
import resource
import subprocess
import sys
import tempfile
import time

from meshes import SHADED, sphere

VIEWS = ((0.0, 0.4), (0.8, -0.35), (1.6, 0.4), (2.4, -0.35), (3.1, 0.4), (3.9, -0.35), (4.7, 0.4), (5.5, -0.35))


def write_obj(path, points, faces):
    with open(path, "w") as f:
        f.write("".join("v %.7f %.7f %.7f\n" % tuple(p) for p in points) + "".join("f %d %d %d\n" % tuple(i + 1 for i in t) for t in faces))


def rough(p):
    by = 1 + 0.08 * math.sin(5 * p[0]) * math.sin(6 * p[1] + 1) * math.sin(4 * p[2] + 2)
    return [by * v for v in p]


def write_scene(folder, size):
    points, faces = sphere((0, 0, 0), 1, 5)
    write_obj(os.path.join(folder, "ball.obj"), points, faces)
    write_obj(os.path.join(folder, "wanted.obj"), [rough(p) for p in points], faces)
    with open(os.path.join(folder, "ball.salt"), "w") as f:
        f.write(SHADED % ('param mesh m = "ball.obj";\n[NoDiff] param float2 at = float2(0.5, 0.3);\n', "1.15"))
    views = [{"target": {"shader": "ball.salt", "params": {"m": {"file": "wanted.obj"}, "at": at}}, "params": {"at": at}} for at in VIEWS]
    scene = {"shader": "ball.salt", "size": [size, size], "entry": "main", "spp": 1, "params": {"m": {"grad": True, "lr": 0.002}}, "views": views,
             "optimizer": {"type": "adam", "iters": 20}, "output": "out/"}
    with open(os.path.join(folder, "scene.json"), "w") as f:
        json.dump(scene, f)


def fit(saltus, folder, iters, more):
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    r = subprocess.run([saltus, "fit", os.path.join(folder, "scene.json"), "--iters", str(iters), "--quiet", "--json", "-o", os.path.join(folder, "fitted.json"), *more], capture_output=True, text=True)
    after, end = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    if r.returncode:
        sys.exit(r.stderr)
    return end - start, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, json.loads(r.stdout)


def main():
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("saltus", nargs="?")
    p.add_argument("--size", type=int, default=256)
    p.add_argument("--iters", type=int, default=21)
    p.add_argument("--rounds", type=int, default=3)
    p.add_argument("--keep")
    a, more = p.parse_known_args()
    if a.keep:
        os.makedirs(a.keep, exist_ok=True)
        write_scene(a.keep, a.size)
    if not a.saltus:
        return
    with tempfile.TemporaryDirectory() as folder:
        write_scene(folder, a.size)
        one = many = (math.inf, math.inf)
        for _ in range(a.rounds):
            one = tuple(map(min, one, fit(a.saltus, folder, 1, more)[:2]))
            *seconds, result = fit(a.saltus, folder, a.iters, more)
            many = tuple(map(min, many, seconds))
    wall, processor = ((m - o) / (a.iters - 1) for m, o in zip(many, one))
    print("%.3f s an iteration, %.3f s of processor time; loss %.6g -> %.6g" % (wall, processor, result["initial_loss"], result["loss"]))


if __name__ == "__main__":
    main()
