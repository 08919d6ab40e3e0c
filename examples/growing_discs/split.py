#!/usr/bin/env python3
"""Between two rounds of `saltus fit`: prunes the discs that the picture hardly misses, and splits those where it is wrong.

Reads one JSON object and answers with one (docs/command.md, Rounds). Needs nothing but Python; `split.py 200` ends with 200 discs.
"""
import ast
import json
import math
import struct
import sys

WIDE, HIGH = 9.0, 6.0  # the domain of discs.salt
PIXELS = 10000         # about so many are looked at
MORE = 0.4             # discs are split, of those there are; the smaller part of them takes the place of what is pruned
LESS = 0.1             # pruned, at most


def read_npy(path):
    """Rows of pixels of an image of 32-bit floats."""
    with open(path, "rb") as file:
        data = file.read()
    head = 10 + struct.unpack("<H", data[8:10])[0]
    rows, columns, channels = ast.literal_eval(data[10:head].decode())["shape"]
    values = struct.unpack("<%df" % (rows * columns * channels), data[head:])
    return [[values[(y * columns + x) * channels:][:channels] for x in range(columns)] for y in range(rows)]


def look(discs, paper, image, target):
    """Of every disc: by how much the squared error grows without it; the error where it is the topmost one; its second moments."""
    missed, wrong, moments = ([0.0] * len(discs) for _ in range(3))
    moments = [[0.0, 0.0, 0.0] for _ in discs]
    rows, columns = len(image), len(image[0])
    stride = max(1, round(math.sqrt(rows * columns / PIXELS)))
    for row in range(stride // 2, rows, stride):
        for column in range(stride // 2, columns, stride):
            x, y = (column + 0.5) * WIDE / columns, HIGH - (row + 0.5) * HIGH / rows
            here = [i for i, d in enumerate(discs) if (x - d["centre"][0]) ** 2 + (y - d["centre"][1]) ** 2 < d["radius"] ** 2]
            if not here:
                continue
            off = [a - b for a, b in zip(image[row][column], target[row][column])]
            error = sum(e * e for e in off)
            below, colour = [], paper
            for i in here:
                below.append(colour)
                colour = [c + discs[i]["opacity"] * (ink - c) for c, ink in zip(colour, discs[i]["ink"])]
            seen = 1.0
            for i, under in zip(reversed(here), reversed(below)):
                weight = seen * discs[i]["opacity"]
                missed[i] += sum((e - weight * (ink - c)) ** 2 for e, ink, c in zip(off, discs[i]["ink"], under)) - error
                seen *= 1 - discs[i]["opacity"]
            top = here[-1]
            dx, dy = x - discs[top]["centre"][0], y - discs[top]["centre"][1]
            wrong[top] += error
            for k, product in enumerate((dx * dx, dx * dy, dy * dy)):
                moments[top][k] += error * product
    return missed, wrong, moments


def halves(disc, moments):
    """Two along the direction in which the error lies, that together have the area of the one."""
    xx, xy, yy = moments
    angle, step = 0.5 * math.atan2(2 * xy, xx - yy), 0.5 * abs(disc["radius"])
    for side in (-step, step):
        centre = [disc["centre"][0] + side * math.cos(angle), disc["centre"][1] + side * math.sin(angle)]
        yield dict(disc, centre=centre, radius=0.7 * abs(disc["radius"]))


def main():
    limit = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    question = json.load(sys.stdin)
    discs = question["params"]["discs"]
    missed, wrong, moments = look(discs, question["params"]["paper"], *(read_npy(question["views"][0][key]) for key in ("image", "target")))
    worst = sorted(range(len(discs)), key=lambda i: -wrong[i])
    gain = 0.2 * wrong[worst[len(discs) // 8]]  # about what splitting one of the worst may win
    pruned = set(i for i in sorted(range(len(discs)), key=lambda i: missed[i])[:int(LESS * len(discs))] if missed[i] < gain)
    room = min(limit - len(discs) + len(pruned), int(MORE * len(discs)))
    split = set([i for i in worst if i not in pruned][:room])
    out = []
    for i, disc in enumerate(discs):
        out += [] if i in pruned else halves(disc, moments[i]) if i in split else [disc]
    print("split.py: %d discs, %d pruned, %d split, %d now" % (len(discs), len(pruned), len(split), len(out)), file=sys.stderr)
    json.dump({"params": {"discs": out}}, sys.stdout)


if __name__ == "__main__":
    main()
