"""Writes knot.obj: a trefoil knot of a tube that lies on a floor, a group each."""
import math

ALONG, AROUND = 128, 12
LARGE, SMALL, TUBE = 0.78, 0.34, 0.21  # radii: of the torus that the knot winds about, and of the tube


def centre(t):
    r = LARGE + SMALL * math.cos(3 * t)
    return r * math.cos(2 * t), r * math.sin(2 * t), SMALL * math.sin(3 * t) + SMALL + TUBE


def unit(v):
    n = math.sqrt(sum(x * x for x in v))
    return [x / n for x in v]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


lines = ["# a knot on a floor: make_knot.py", "g knot"]
for i in range(ALONG):
    t = 2 * math.pi * i / ALONG
    ahead = unit([a - b for a, b in zip(centre(t + 1e-4), centre(t - 1e-4))])
    # Out of the torus; across to it and to the way of the tube.
    out = [math.cos(3 * t) * math.cos(2 * t), math.cos(3 * t) * math.sin(2 * t), math.sin(3 * t)]
    side = unit(cross(ahead, out))
    up = cross(side, ahead)
    for j in range(AROUND):
        a = 2 * math.pi * j / AROUND
        lines.append("v %.6f %.6f %.6f" % tuple(c + TUBE * (math.cos(a) * u + math.sin(a) * s) for c, u, s in zip(centre(t), up, side)))
for i in range(ALONG):
    for j in range(AROUND):
        a, b = (1 + i * AROUND + k % AROUND for k in (j, j + 1))
        c, d = (1 + (i + 1) % ALONG * AROUND + k % AROUND for k in (j + 1, j))
        lines += ["f %d %d %d" % (a, b, d), "f %d %d %d" % (b, c, d)]
n = ALONG * AROUND
lines += ["g floor"] + ["v %d %d 0" % p for p in ((-20, -20), (20, -20), (20, 20), (-20, 20))] + ["f %d %d %d %d" % (n + 1, n + 2, n + 3, n + 4)]
with open("knot.obj", "w") as f:
    f.write("\n".join(lines) + "\n")
