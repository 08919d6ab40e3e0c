#!/usr/bin/env python3
"""How much of the pile's outlines is seen, by geometry alone, and whether exactly the discs that are seen have a derivative."""
import json
import math
import os
import subprocess

SALTUS = os.environ.get("SALTUS", "saltus")
POINTS = 1000  # around each disc


def ask(*words):
    return json.loads(subprocess.run([SALTUS, *words, "--quiet"], check=True, stdout=subprocess.PIPE).stdout)


pile = ask("fit", "pile.salt", "--wrt", "discs", "--minimize", "--iters", "0", "-o", "-")["discs"]
grad = ask("grad", "pile.salt", "--wrt", "discs", "--integral", "--json")["gradient"]["discs"]
length = visible = 0.0
seen = set()
for i, disc in enumerate(pile):
    (cx, cy), r = disc["centre"], disc["radius"]
    above = [(x, y, s * s) for (x, y), s in ((d["centre"], d["radius"]) for d in pile[i + 1 :])]
    for k in range(POINTS):
        x, y = cx + r * math.cos(math.tau * k / POINTS), cy + r * math.sin(math.tau * k / POINTS)
        if max(abs(x), abs(y)) > 1.0:
            continue
        length += math.tau * r / POINTS
        if all((x - u) ** 2 + (y - v) ** 2 > rr for u, v, rr in above):
            visible += math.tau * r / POINTS
            seen.add(i)
moved = {i for i, g in enumerate(grad) if any(g["radius"]) or any(map(any, g["centre"]))}
print("%d discs, %.4g of outlines, %.4g of them seen (%.2g %%), of %d discs" % (len(pile), length, visible, 100.0 * visible / length, len(seen)))
print("%d discs have a derivative: %s" % (len(moved), "the ones that are seen" if moved == seen else "not the same: %s" % sorted(moved ^ seen)))
