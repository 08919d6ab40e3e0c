#!/usr/bin/env python3
"""A loss program for `saltus fit --loss-command`: how far colour has to be moved, seen along the rows and along the columns.

In: a line of JSON, then the image. Out: a line with the loss, then its derivative with respect to every value of the image.
The target is a .pfm file that the request names. Only the standard library is used."""
import json
import sys
from array import array
from itertools import accumulate


def read_pfm(path):
    kind, size, _, data = open(path, "rb").read().split(b"\n", 3)
    w, h = map(int, size.split())
    row = w * (3 if kind == b"PF" else 1)
    v = array("f", data)
    return [x for y in reversed(range(h)) for x in v[y * row:(y + 1) * row]]  # the file runs upwards


def moved(profile):
    """The mean square of the running sum of a profile, and its derivative: a difference counts until something balances it."""
    n = len(profile)
    sums = [s / n for s in accumulate(profile)]
    back = accumulate(2 * s / n / n for s in reversed(sums))
    return sum(s * s for s in sums) / n, list(back)[::-1]


def loss_and_adjoint(d, w, h, c):
    """Of the differences d, image - target."""
    loss = sum(x * x for x in d) / len(d)
    adjoint = [2 * x / len(d) for x in d]
    for k in range(c):
        for n, m, step, across in ((w, h, c, w * c), (h, w, w * c, c)):
            lines = [slice(k + i * step, k + i * step + (m - 1) * across + 1, across) for i in range(n)]
            part, a = moved([sum(d[s]) / m for s in lines])
            loss += WEIGHT * part
            for i, s in enumerate(lines):
                adjoint[s] = [x + WEIGHT * a[i] / m for x in adjoint[s]]
    return loss, adjoint


WEIGHT = 100
targets = {}
for line in sys.stdin.buffer:
    q = json.loads(line)
    w, h, c = q["width"], q["height"], q["channels"]
    image = array("f", sys.stdin.buffer.read(4 * w * h * c))
    if q["target"] not in targets:
        targets[q["target"]] = read_pfm(q["target"])
    loss, adjoint = loss_and_adjoint([a - b for a, b in zip(image, targets[q["target"]])], w, h, c)
    sys.stdout.buffer.write(json.dumps({"loss": loss}).encode() + b"\n" + array("f", adjoint).tobytes())
    sys.stdout.buffer.flush()
