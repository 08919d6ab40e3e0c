"""Writes ball.obj: an icosahedron halved twice, 162 vertices of length 1."""
import math

g = (1 + math.sqrt(5)) / 2
points = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g), (0, -1, -g), (0, 1, -g), (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]
faces = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6), (7, 1, 8),
         (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)]


def unit(v):
    n = math.sqrt(sum(x * x for x in v))
    return tuple(x / n for x in v)


points = [unit(p) for p in points]
for _ in range(2):
    middle, finer = {}, []
    for a, b, c in faces:
        m = []
        for i, j in ((a, b), (b, c), (c, a)):
            key = min(i, j), max(i, j)
            if key not in middle:
                middle[key] = len(points)
                points.append(unit([x + y for x, y in zip(points[i], points[j])]))
            m.append(middle[key])
        finer += [(a, m[0], m[2]), (b, m[1], m[0]), (c, m[2], m[1]), (m[0], m[1], m[2])]
    faces = finer
with open("ball.obj", "w") as f:
    f.write("# a ball of 320 faces: make_ball.py\n")
    f.writelines("v %.9f %.9f %.9f\n" % p for p in points)
    f.writelines("f %d %d %d\n" % tuple(i + 1 for i in face) for face in faces)
