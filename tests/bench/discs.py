#!/usr/bin/env python3
"""Opaque overlapping discs, painted in order: the derivatives of their picture's integral in all centres, radii and colours by quadrature, against exact ones.

    tests/bench/discs.py build/bin/saltus N SMALLEST LARGEST [options of grad]
    tests/bench/discs.py build/bin/saltus 2000 .01 .04 --error 1e-6
    tests/bench/discs.py build/bin/saltus 2000 .01 .04 length --error 1e-6

With `length` the discs are written length(d) < r, else dot(d, d) < r*r.

Prints evaluations, the seconds that the command gives (compiling apart), the largest memory, what it says of its error, and the relative L2 distance from the exact derivatives, arc by arc, which Green's
theorem gives; the areas of all discs and of the paper must add up to 1 for them."""
import json
import math
import os
import random
import resource
import subprocess
import sys
import tempfile

SHADER = """const int N = %d;
float3 none(int i) { return float3(0.0); }
param float3 disc[N] = init(none);
param float3 ink[N] = init(none);
shader float3 main(float2 x) {
    float3 c = float3(0.95, 0.92, 0.85);
    for (int i = 0; i < N; i++) {
        float2 d = x - disc[i].xy;
        [Disc] if (%s) c = ink[i];
    }
    return c;
}
"""
INSIDE = ("dot(d, d) < disc[i].z * disc[i].z", "length(d) < disc[i].z")
PAPER = (0.95, 0.92, 0.85)
TURN = 2 * math.pi


class Near:
    """Which discs reach a cell of a grid over [0,1]^2."""

    def __init__(self, disc):
        self.n = max(1, int(0.5 / max(r for _, _, r in disc)))
        self.cell = {}
        for i, (x, y, r) in enumerate(disc):
            for cell in self.cells(x, y, r + 1e-9):
                self.cell.setdefault(cell, []).append(i)

    def cells(self, x, y, r):
        lo, hi = [[min(self.n - 1, max(0, int(math.floor((v + s * r) * self.n)))) for v in (x, y)] for s in (-1, 1)]
        return [(i, j) for i in range(lo[0], hi[0] + 1) for j in range(lo[1], hi[1] + 1)]

    def touching(self, disc, i):
        x, y, r = disc[i]
        found = {j for cell in self.cells(x, y, r) for j in self.cell.get(cell, ())}
        return sorted(j for j in found if j != i and math.hypot(disc[j][0] - x, disc[j][1] - y) < r + disc[j][2])

    def at(self, x, y):
        return self.cell.get(self.cells(x, y, 0)[0], ())


def top(disc, some, x, y):
    """The disc on top at a place, of those given; -1: the paper."""
    return max((j for j in some if (x - disc[j][0]) ** 2 + (y - disc[j][1]) ** 2 < disc[j][2] ** 2), default=-1)


def arcs(disc, near, i):
    """(from, to, the disc outside) of each arc of a disc that is seen."""
    x, y, r = disc[i]
    by, cut = near.touching(disc, i), [-math.pi, math.pi]
    for at, base in ((x, 0), (1 - x, math.pi), (y, math.pi / 2), (1 - y, -math.pi / 2)):  # the domain's sides
        if at < r:
            cut += [math.remainder(math.pi + base + s * math.acos(at / r), TURN) for s in (-1, 1)]
    for j in by:
        dx, dy, R = disc[j][0] - x, disc[j][1] - y, disc[j][2]
        D = math.hypot(dx, dy)
        if D > abs(r - R):
            a, b = math.acos((D * D + r * r - R * R) / (2 * D * r)), math.atan2(dy, dx)
            cut += [math.remainder(b + s * a, TURN) for s in (-1, 1)]
    cut.sort()
    for a, b in zip(cut, cut[1:]):
        mx, my = x + r * math.cos(0.5 * (a + b)), y + r * math.sin(0.5 * (a + b))
        if b > a and 0 <= mx <= 1 and 0 <= my <= 1:
            out = top(disc, by, mx, my)
            if out < i:
                yield a, b, out


def exact(disc, ink):
    """Derivatives of the integral, by channel: of all discs, and the areas that are seen."""
    near, n = Near(disc), len(disc)
    d = [[0.0] * (3 * n) for _ in range(3)]
    area = [0.0] * (n + 1)  # the last: the paper
    for i, (x, y, r) in enumerate(disc):
        for a, b, out in arcs(disc, near, i):
            moved = (r * (math.sin(b) - math.sin(a)), r * (math.cos(a) - math.cos(b)), r * (b - a))
            for c in range(3):
                jump = ink[i][c] - (ink[out][c] if out >= 0 else PAPER[c])
                for k in range(3):
                    d[c][3 * i + k] += jump * moved[k]
            green = 0.5 * (r * moved[2] + x * moved[0] + y * moved[1])
            area[i] += green
            area[out] -= green
    for side in (0, 1):  # of the four, x = 0 and y = 0 give nothing
        cut = [0.0, 1.0]
        for x, y, r in disc:
            across, along = (1 - x, y) if side == 0 else (1 - y, x)
            if across < r:
                h = math.sqrt(r * r - across * across)
                cut += [min(1, max(0, along - h)), min(1, max(0, along + h))]
        cut.sort()
        for a, b in zip(cut, cut[1:]):
            at = (1.0, 0.5 * (a + b)) if side == 0 else (0.5 * (a + b), 1.0)
            area[top(disc, near.at(*at), *at)] += 0.5 * (b - a)
    assert abs(math.fsum(area) - 1) < 1e-9 and min(area) > -1e-12, math.fsum(area)
    return d, area


def scene(n, least, most):
    rng = random.Random(n)
    disc = [(rng.random(), rng.random(), rng.uniform(least, most)) for _ in range(n)]
    return disc, [tuple(rng.random() for _ in range(3)) for _ in range(n)]


def main(saltus, n, least, most, *options):
    length = "length" in options
    options = [o for o in options if o != "length"]
    disc, ink = scene(int(n), float(least), float(most))
    with tempfile.TemporaryDirectory() as folder:
        shader, values = os.path.join(folder, "discs.salt"), os.path.join(folder, "discs.json")
        with open(shader, "w") as f:
            f.write(SHADER % (len(disc), INSIDE[length]))
        with open(values, "w") as f:
            json.dump({"disc": disc, "ink": ink}, f)
        line = [saltus, "grad", shader, "--params", values, "--integral", "--precision", "f64", "--estimator", "quadrature", "--json", *options]
        run = subprocess.run(line, capture_output=True, text=True)
    if run.returncode not in (0, 6):
        sys.exit(run.stderr)
    j = json.loads(run.stdout)
    memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    print("%d evaluations, %.4g s, %.0f MiB; left %.3g%s" % (j["evaluations"], j["seconds"], memory, j["left"], ", stopped: " + j["stopped"] if j.get("stopped") else ""))
    want, area = exact(disc, ink)
    pairs = [(j["gradient"]["disc"][i][k][c], want[c][3 * i + k]) for i in range(len(disc)) for k in range(3) for c in range(3)]
    pairs += [(j["gradient"]["ink"][i][k][c], area[i] if k == c else 0) for i in range(len(disc)) for k in range(3) for c in range(3)]
    norm = math.sqrt(sum(b * b for _, b in pairs))
    stated = max(v for kind in ("disc", "ink") for row in j["stderr"][kind] for k in row for v in k)
    print("relative L2 error %.2g; of the largest component: error %.2g, stated %.2g" % (math.sqrt(sum((a - b) ** 2 for a, b in pairs)) / norm, max(abs(a - b) for a, b in pairs) / max(abs(b) for _, b in pairs), stated / max(abs(b) for _, b in pairs)))


if __name__ == "__main__":
    main(*sys.argv[1:])
