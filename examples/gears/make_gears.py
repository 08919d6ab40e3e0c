"""Writes gears.obj: fifteen gears side by side, a group each, flat on their axes along z."""
import math

# x, y, z of the middle, radius, teeth
GEARS = [(-2.0, 0.9, 0.5, 0.42, 11), (-1.05, 0.8, 0.7, 0.46, 13), (0.0, 0.95, 0.5, 0.44, 12), (1.0, 0.85, 0.7, 0.48, 14), (2.0, 0.9, 0.5, 0.40, 10),
         (-1.6, -0.05, 0.6, 0.44, 12), (-0.6, 0.0, 0.8, 0.40, 9), (0.45, 0.05, 0.6, 0.46, 13), (1.5, -0.05, 0.8, 0.44, 11), (-2.35, 0.0, 0.8, 0.30, 8),
         (-2.0, -0.95, 0.5, 0.44, 12), (-1.0, -0.9, 0.7, 0.42, 10), (0.0, -0.95, 0.5, 0.48, 14), (1.0, -0.9, 0.7, 0.42, 11), (2.0, -0.95, 0.5, 0.44, 13)]
THICK, HOLE = 0.1, 0.3


def outline(radius, teeth):
    """Four corners a tooth: root, tip, tip, root."""
    for k in range(teeth):
        for part, r in ((0.0, 0.82), (0.25, 1.0), (0.5, 1.0), (0.75, 0.82)):
            a = 2 * math.pi * (k + part) / teeth
            yield radius * r * math.cos(a), radius * r * math.sin(a), a


lines, first = ["# fifteen gears: make_gears.py"], 1
for number, (x, y, z, radius, teeth) in enumerate(GEARS):
    lines.append("g gear%d" % number)
    corners = list(outline(radius, teeth))
    n = len(corners)
    for depth in (0.5 * THICK, -0.5 * THICK):  # front, then back; outside, then the hole
        lines += ["v %.6f %.6f %.6f" % (x + px, y + py, z + depth) for px, py, a in corners]
        lines += ["v %.6f %.6f %.6f" % (x + HOLE * radius * math.cos(a), y + HOLE * radius * math.sin(a), z + depth) for px, py, a in corners]
    for k in range(n):
        j = (k + 1) % n
        front, hole, back, far = (first + i * n for i in range(4))
        lines += ["f %d %d %d %d" % (hole + k, front + k, front + j, hole + j), "f %d %d %d %d" % (far + k, far + j, back + j, back + k),
                  "f %d %d %d %d" % (front + k, back + k, back + j, front + j), "f %d %d %d %d" % (hole + j, far + j, far + k, hole + k)]
    first += 4 * n
with open("gears.obj", "w") as f:
    f.write("\n".join(lines) + "\n")
