"""Writes tree.obj: a tree of boughs that fork three times three, with leaves; boughs and leaves run through each other."""
import math
import random

LEVELS, FORKS, SIDES, LEAVES = 4, 3, 6, 9
rnd = random.Random(5)
vertices, faces = [], []


def unit(v):
    n = math.sqrt(sum(x * x for x in v))
    return [x / n for x in v]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def across(along):
    side = unit(cross(along, [0.3, 0.9, 0.31]))
    return side, cross(along, side)


def add(a, b, s=1.0):
    return [x + s * y for x, y in zip(a, b)]


def tube(a, b, ra, rb):
    """Six sides and a tip, open at the root."""
    s, t = across(unit(add(b, a, -1)))
    first = len(vertices) + 1
    for middle, r in ((a, ra), (b, rb)):
        for k in range(SIDES):
            w = 2 * math.pi * k / SIDES
            vertices.append(add(add(middle, s, r * math.cos(w)), t, r * math.sin(w)))
    for k in range(SIDES):
        j = (k + 1) % SIDES
        faces.append((first + k, first + j, first + SIDES + j, first + SIDES + k))
    faces.append(tuple(range(first + SIDES, first + 2 * SIDES)))


def leaf(at):
    along = unit([rnd.gauss(0, 1), rnd.gauss(0, 1), rnd.gauss(0, 1)])
    s, t = across(along)
    size = rnd.uniform(0.05, 0.08)
    first = len(vertices) + 1
    for x, y in ((0, 0), (0.5, 0.35), (1, 0), (0.5, -0.35)):
        vertices.append(add(add(at, along, size * x), s, size * y))
    faces.append((first, first + 1, first + 2, first + 3))


def bough(at, along, length, radius, level):
    end = add(at, along, length)
    tube(at, end, radius, 0.6 * radius)
    if level == LEVELS:
        for k in range(LEAVES):
            leaf(add(add(at, along, length * rnd.uniform(0.1, 1.1)), [rnd.gauss(0, 0.04), rnd.gauss(0, 0.04), rnd.gauss(0, 0.04)]))
        return
    s, t = across(along)
    turn = rnd.uniform(0, 2 * math.pi)
    for k in range(FORKS):
        w = turn + 2 * math.pi * (k + rnd.uniform(-0.2, 0.2)) / FORKS
        lean = rnd.uniform(0.45, 0.75)
        out = add([math.cos(w) * x for x in s], t, math.sin(w))
        way = unit(add([math.cos(lean) * x for x in along], out, math.sin(lean)))
        bough(add(at, along, length * rnd.uniform(0.7, 1.0)), way, length * rnd.uniform(0.6, 0.75), 0.6 * radius, level + 1)


bough([0.0, 0.0, 0.0], [0.0, 0.0, 1.0], 0.55, 0.05, 0)
with open("tree.obj", "w") as f:
    f.write("# a tree: make_tree.py\n")
    for v in vertices:
        f.write("v %.5f %.5f %.5f\n" % tuple(v))
    for face in faces:
        f.write("f " + " ".join(map(str, face)) + "\n")
