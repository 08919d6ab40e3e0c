"""Writes tiles.obj: what lies at the end of two mirrors. Part 0 is a black ring beside them, which turns with them and hides what is not between;
the others are coloured triangles, strewn over each other, each at its own depth."""
import math
import random

TILES, REACH, RING = 40, 1.15, 64
rnd = random.Random(3)
lines = ["# two mirrors' blind, and tiles: make_tiles.py", "g blind"]
# The wedge between the mirrors is from 0 to 60 degrees before it is turned. The blind is a fan around the axis over all the rest.
lines.append("v 0 0 0")
for k in range(RING + 1):
    w = math.radians(60 + 300 * k / RING)
    lines.append("v %.9f %.9f 0" % (4 * math.cos(w), 4 * math.sin(w)))
lines += ["f 1 %d %d" % (k + 2, k + 3) for k in range(RING)]
first = RING + 3
for k in range(TILES):
    lines.append("g tile%d" % k)
    x, y, z = rnd.uniform(-REACH, REACH), rnd.uniform(-REACH, REACH), -0.02 - 0.004 * k
    size, turn = rnd.uniform(0.35, 0.8), rnd.uniform(0, 2 * math.pi)
    for corner in range(3):
        w = turn + 2 * math.pi * (corner + rnd.uniform(-0.25, 0.25)) / 3
        lines.append("v %.6f %.6f %.6f" % (x + size * math.cos(w), y + size * math.sin(w), z))
    lines.append("f %d %d %d" % (first, first + 1, first + 2))
    first += 3
with open("tiles.obj", "w") as f:
    f.write("\n".join(lines) + "\n")
