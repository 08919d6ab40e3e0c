#!/usr/bin/env python3
"""make_targets.py SCENE.json [N]: renders the photographs that the scene asks for, of a terrain with N x N heights (128).

The terrain is the elevation model of Jacksboro, Tennessee, where $SALTUS_DATA has it, and a made-up one elsewhere. Its heights run from 0 to 1. Beside the photographs: heights.npy
and colours.exr, the truth, and grey.exr, colours to start from. $SALTUS is the command, if it is not on the path. Only the standard library is used."""
import json
import os
import subprocess
import sys
from array import array

SALTUS = os.environ.get("SALTUS", "saltus")
HERE = os.path.dirname(os.path.abspath(__file__))
DEM = os.path.join(os.environ.get("SALTUS_DATA", ""), "jacksboro_403x344.f32")


def render(shader, out, size, params, *more):
    options = [o for name, value in params.items() for o in ("--param", "%s=%s" % (name, value if isinstance(value, str) else json.dumps(value)))]
    size = "x".join(map(str, size))
    subprocess.run([SALTUS, "render", os.path.join(HERE, shader), "--quiet", "--size", size, "-o", out, *options, *more], check=True)


def stretch(path):
    """From 0 to 1: the mean over a pixel has lost some of the range."""
    with open(path, "rb") as f:
        data = f.read()
    start = 10 + int.from_bytes(data[8:10], "little")
    v = array("f", data[start:])
    lo, hi = min(v), max(v)
    with open(path, "wb") as f:
        f.write(data[:start] + array("f", ((x - lo) / (hi - lo) for x in v)).tobytes())


path = sys.argv[1] if len(sys.argv) > 1 else "scene.json"
n = int(sys.argv[2]) if len(sys.argv) > 2 else 128
scene = json.load(open(path))
folder = os.path.dirname(os.path.abspath(path))
targets = [os.path.join(folder, view["target"]) for view in scene["views"]]
truth = os.path.dirname(targets[0])
os.makedirs(truth, exist_ok=True)
heights, colours = os.path.join(truth, "heights.npy"), os.path.join(truth, "colours.exr")

corners = ("--set", "N=%d" % n, "--spp", "16")
if os.path.exists(DEM):
    render("truth.salt", heights, [n, n], {"dem": "@" + DEM, "low": 236, "high": 1076, "crop": [0.072, 0, 0.928, 1]}, "--entry", "real", *corners)
else:
    render("truth.salt", heights, [n, n], {}, "--entry", "made_up", *corners)
stretch(heights)
render("truth.salt", colours, [128, 128], {"h": "@" + heights}, "--entry", "colours", "--spp", "16")
render("truth.salt", os.path.join(truth, "grey.exr"), [128, 128], {}, "--entry", "grey", "--spp", "1")
for view, target in zip(scene["views"], targets):
    render(scene["shader"], target, scene["size"], {"h": "@" + heights, "albedo": "@" + colours, **view["params"]}, "--spp", "16")
