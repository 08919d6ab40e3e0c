#!/usr/bin/env python3
"""Curves of meshes: error, stated error and cost of the estimator `quadrature`, where only hits count, against closed forms and exact pieces: the table of docs/meshes.md.

    SALTUS_DATA=... tests/bench/mesh_curves.py build/bin/saltus"""
import math
import os
import subprocess
import sys
import tempfile
import json

BINARY = os.path.abspath(sys.argv[1])
sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "cli"))
from test_mesh_curves import ALONG, EYE, PIECES, SEEN, ball, box, flat, moved, obj, read_obj, shadow_of_convex, soup, turned


def grad(folder, file, *more):
    run = subprocess.run([BINARY, "grad", file, "--integral", "--json", "--quiet", "--threads", "2", *more], cwd=folder, capture_output=True, text=True)
    return json.loads(run.stdout)


def row(name, text, along):
    with tempfile.TemporaryDirectory() as folder:
        def put(file, content):
            with open(os.path.join(folder, file), "w") as f:
                f.write(content)
        at, faces = read_obj(text)
        if along and len(faces) > 1:
            at = moved([turned(p, 0.5, 0.7) for p in at], 0.25, (0.5, 0.5, 0.0))
        put("a.obj", obj(at, faces))
        put("m.salt", ALONG % "0.0, 100.0" if along else SEEN % EYE)
        put("p.salt", PIECES % EYE)
        want = flat(shadow_of_convex(at, faces)[1] if along else grad(folder, "p.salt", "--samples", "1", "--precision", "f64")["gradient"]["m"])
        for precision in ("f64", "f32") if len(faces) < 100 else ("f64",):
            j = grad(folder, "m.salt", "--estimator", "quadrature", "--precision", precision)
            got, error, size = flat(j["gradient"]["m"]), flat(j["stderr"]["m"]), max(map(abs, want))
            worst = max(abs(g - w) for g, w in zip(got, want)) / size
            print("| %s | %s | %d | %.2g | %.1e | %.1e | %.3f |" % (name, precision, j["evaluations"], j["left"], worst, max(error) / size, j["seconds"]), flush=True)


def around(n):
    at = [(0.0, 0.0, 0.0)]
    for i in range(n):
        at += [(1.2 * math.cos(a), 1.2 * math.sin(a), 0.3 * math.cos(3 * a)) for a in (2 * math.pi * i / n, 2 * math.pi * (i + 0.5) / n)]
    return obj(at, [(0, 2 * i + 1, 2 * i + 2) for i in range(n)])


print("| | precision | evaluations | left | error | stated | seconds |\n|---|---|---|---|---|---|---|")
row("one triangle, along an axis", obj([(0.2, 0.3, 0.1), (0.8, 0.25, -0.1), (0.45, 0.85, 0.0)], [(0, 1, 2)]), True)
row("a box, along an axis", box()[1], True)
row("a ball of 1 600 triangles, along an axis", ball(20, 40, 1.0)[1], True)
row("the ball, from a point", ball(20, 40, 1.0)[1], False)
row("a ball of 25 280 triangles, from a point", ball(79, 160, 1.0)[1], False)
row("300 triangles through each other", soup(300, 0.08), False)
row("12 triangles around a point", around(12), False)
if os.environ.get("SALTUS_DATA"):
    with open(os.path.join(os.environ["SALTUS_DATA"], "spot.obj")) as f:
        row("`spot.obj`", f.read(), False)
