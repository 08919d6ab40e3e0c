"""Writes knot.obj: a tube along a trefoil, of RINGS x SIDES quadrilaterals cut in two."""
import math

RINGS, SIDES, RADIUS, SCALE = 48, 6, 0.17, 0.235


def curve(t):
    r = 2 + math.cos(3 * t)
    return [SCALE * r * math.cos(2 * t), SCALE * r * math.sin(2 * t), 0.3 * math.sin(3 * t)]


def unit(v):
    n = math.sqrt(sum(x * x for x in v))
    return [x / n for x in v]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


lines = ["# a trefoil knot: make_mesh.py"]
for i in range(RINGS):
    t = 2 * math.pi * i / RINGS
    p = curve(t)
    along = unit([b - a for a, b in zip(curve(t - 1e-3), curve(t + 1e-3))])
    side = unit(cross(along, [0, 0, 1]))
    up = cross(side, along)
    for j in range(SIDES):
        a = 2 * math.pi * j / SIDES
        lines.append("v " + " ".join("%.5f" % (c + RADIUS * (math.cos(a) * s + math.sin(a) * u)) for c, s, u in zip(p, side, up)))
for i in range(RINGS):
    for j in range(SIDES):
        a, b = i * SIDES + j + 1, i * SIDES + (j + 1) % SIDES + 1
        c, d = (i + 1) % RINGS * SIDES + j + 1, (i + 1) % RINGS * SIDES + (j + 1) % SIDES + 1
        lines += ["f %d %d %d" % (a, d, b), "f %d %d %d" % (a, c, d)]
with open("knot.obj", "w") as f:
    f.write("\n".join(lines) + "\n")
