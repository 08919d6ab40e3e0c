"""Writes room.obj: a round table that is laid, chairs, a lamp, a shelf with books, a room around; a group for each material and each thing that moves."""
import math
import random

random.seed(4)
vertices, groups = [], {}


def face(group, *points):
    groups.setdefault(group, []).append([len(vertices) + k for k in range(len(points))])
    vertices.extend(points)


def box(group, lo, hi, place=lambda p: p):
    corner = [place([(lo, hi)[k >> a & 1][a] for a in range(3)]) for k in range(8)]
    for a, b, c, d in ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (3, 2, 6, 7), (1, 3, 7, 5), (2, 0, 4, 6)):
        face(group, corner[a], corner[b], corner[c], corner[d])


def turned(group, profile, n, at=(0, 0, 0)):
    """The profile, radii and heights from below to the top of what is seen, about a vertical axis."""
    ring = lambda r, z: [(at[0] + r * math.cos(2 * math.pi * k / n), at[1] + r * math.sin(2 * math.pi * k / n), at[2] + z) for k in range(n)]
    for (r, z), (s, w) in zip(profile, profile[1:]):
        a, b = ring(r, z), ring(s, w)
        for k in range(n):
            j = (k + 1) % n
            face(group, *([a[k], a[j], b[j], b[k]] if r and s else [a[k], a[j], b[k]] if r else [a[k], b[j], b[k]]))


def chair(group, x, y, angle):
    c, s = math.cos(angle), math.sin(angle)
    place = lambda p: (x + c * p[0] - s * p[1], y + s * p[0] + c * p[1], p[2])
    part = lambda lo, hi: box(group, lo, hi, place)
    part((-0.22, -0.22, 0.43), (0.22, 0.22, 0.47))
    for i in (-1, 1):
        part((0.19 * i - 0.02, 0.17, -0.02), (0.19 * i + 0.02, 0.21, 0.44))
        part((0.20 * i - 0.02, -0.22, -0.02), (0.20 * i + 0.02, -0.18, 0.95))
    for z in (0.60, 0.90):
        part((-0.185, -0.21, z), (0.185, -0.19, z + 0.06))
    for i in range(-2, 3):
        part((0.07 * i - 0.012, -0.208, 0.46), (0.07 * i + 0.012, -0.192, 0.91))


# What bends, first: the lamp, the table, plates, bowl, fruit.
turned("lamp", [(0.20, 0.005), (0.14, 0.12), (0.05, 0.20), (0.008, 0.22), (0.008, 1.9)], 20, (0, 0, 1.55))
turned("table", [(0.30, -0.02), (0.28, 0.03), (0.07, 0.09), (0.05, 0.35), (0.08, 0.70), (0.74, 0.71), (0.76, 0.725), (0.74, 0.74), (0, 0.74)], 32)
for k in range(4):
    a = math.pi * (0.5 * k + 0.27)
    turned("plates", [(0.07, -0.002), (0.13, 0.016), (0.132, 0.019), (0.128, 0.020), (0.085, 0.006), (0, 0.006)], 16, (0.52 * math.cos(a), 0.52 * math.sin(a), 0.74))
turned("bowl", [(0.05, -0.002), (0.06, 0.02), (0.13, 0.07), (0.155, 0.11), (0.158, 0.113), (0.15, 0.112), (0.12, 0.07), (0.05, 0.03), (0, 0.028)], 16, (0, 0, 0.74))
for x, y, z in ((0.055, 0.02, 0.82), (-0.05, 0.045, 0.82), (0.0, -0.055, 0.82), (0.0, 0.005, 0.90)):
    turned("fruit", [(0.045 * math.sin(math.pi * k / 5) if 0 < k < 5 else 0, -0.045 * math.cos(math.pi * k / 5)) for k in range(6)], 9, (x, y, z))

# What is flat.
X, Y0, Y1, Z, W = 2.4, -4.0, 2.0, 2.5, 0.7
face("floor", (-X, Y0, 0), (X, Y0, 0), (X, Y1, 0), (-X, Y1, 0))
face("wall", (-X, Y1, 0), (X, Y1, 0), (X, Y1, Z), (-X, Y1, Z))
face("wall", (X, Y1, 0), (X, Y0, 0), (X, Y0, Z), (X, Y1, Z))
face("wall", (-X, Y0, 0), (-X, Y1, 0), (-X, Y1, Z), (-X, Y0, Z))
face("wall", (-X, Y1, Z), (X, Y1, Z), (X, Y0, Z), (-X, Y0, Z))
for y in (0.1, 0.9, 1.7):
    box("frame", (-X - 0.1, y - 0.03, W), (-X + 0.06, y + 0.03, 2.2))
for z in (W, 1.45, 2.2):
    box("frame", (-X - 0.1, 0.07, z - 0.03), (-X + 0.06, 1.73, z + 0.03))
face("pane", (-X + 0.02, 0.1, W), (-X + 0.02, 1.7, W), (-X + 0.02, 1.7, 2.2), (-X + 0.02, 0.1, 2.2))
face("bulb", *[(0.17 * math.cos(-a), 0.17 * math.sin(-a), 1.57) for a in [math.pi * k / 8 for k in range(16)]])
for group, angle, out in (("chair", 4.05, 0.86), ("chairs", 5.5, 0.86), ("chairs", 0.75, 0.84), ("chairs", 2.4, 0.84)):
    chair(group, out * math.cos(angle), out * math.sin(angle), angle + math.pi / 2)
for z in (1.25, 1.70):
    box("frame", (0.35, Y1 - 0.24, z - 0.03), (2.05, Y1 + 0.02, z))
    x = 0.42
    while x < 1.85:
        wide, high = random.uniform(0.025, 0.06), random.uniform(0.2, 0.32)
        box("books%d" % random.randrange(4), (x, Y1 - random.uniform(0.19, 0.22), z - 0.005), (x + wide, Y1 - 0.02, z + high))
        x += wide + (0.004 if random.random() < 0.9 else 0.2)
box("frame", (-1.75, Y1 - 0.03, 1.15), (-0.65, Y1 + 0.02, 1.95))
face("picture", (-1.69, Y1 - 0.035, 1.21), (-0.71, Y1 - 0.035, 1.21), (-0.71, Y1 - 0.035, 1.89), (-1.69, Y1 - 0.035, 1.89))

with open("room.obj", "w") as f:
    f.write("# a dining room: make_room.py\n")
    f.writelines("v %.5f %.5f %.5f\n" % tuple(p) for p in vertices)
    for group, faces in groups.items():
        f.write("g %s\n" % group)
        f.writelines("f %s\n" % " ".join(str(1 + i) for i in face) for face in faces)
