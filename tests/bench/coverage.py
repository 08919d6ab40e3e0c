#!/usr/bin/env python3
"""How often stated errors of derivatives hold: every program of coverage_programs.py by 64 seeds, and as many values of
its parameters where --estimator auto has no use for a seed.

    tests/bench/coverage.py build/bin/saltus [--seeds 64] [--only TEXT] [--quick] [--verbose] [-- options of grad]

By estimator and group: the share of (component, seed) that err by no more than 2 and 4 stated errors (plus rounding),
and the root mean square over components of (root mean square error) / (median stated error). Fails where the share
is below 90 or 99 %, or the ratio outside 0.4 .. 1.5. What errs by less than rounding is within, and in no ratio."""
import argparse
import json
import math
import os
import random
import statistics
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor

from coverage_programs import PROGRAMS, pixel_adjoint

ROUNDING = 8e-6  # of the largest component or part of one: f32, shading 40 times as steep as it is high
QUICK = ("1D two sides", "2D curved disc", "2D curved parabola", "straight slope 0.5", "straight box", "straight short edge", "3D box by maxima",
         "thin ring 0.0001", "thin hairs", "random radius", "random blurred disc", "images shaded")
WANTED = {2: 0.90, 4: 0.99}
RATIO = (0.4, 1.5)


def flat(v):
    for x in v.values() if isinstance(v, dict) else v if isinstance(v, list) else [v]:
        if isinstance(x, (dict, list)):
            yield from flat(x)
        else:
            yield float("nan") if x is None else x


def prepare(p, folder):
    os.makedirs(folder, exist_ok=True)
    with open(os.path.join(folder, "p.salt"), "w") as f:
        f.write(p.source)
    if p.heights:
        write_pfm(os.path.join(folder, "heights.pfm"), p.heights)
    if p.adjoint:
        n = p.adjoint
        middle = [-1 + (i + 0.5) * 2 / n for i in range(n)]
        write_pfm(os.path.join(folder, "adjoint.pfm"), [[pixel_adjoint(x, y, n) for x in middle] for y in middle])


def write_pfm(path, rows):
    import array
    with open(path, "wb") as f:
        f.write(b"Pf\n%d %d\n-1.0\n" % (len(rows[0]), len(rows)))
        for row in rows:  # from the bottom
            f.write(array.array("f", row).tobytes())


def grad(saltus, p, folder, values, seed, options):
    set_ = [o for k, v in values.items() for o in ("--param", "%s=%s" % (k, ",".join(map(repr, v)) if isinstance(v, tuple) else repr(v)))]
    kind = ["--adjoint", "adjoint.pfm"] if p.adjoint else ["--integral"]
    run = subprocess.run([saltus, "grad", "p.salt", *kind, "--json", "--quiet", "--threads", "1", "--seed", str(seed), *map(str, p.options),
                          *set_, "--wrt", ",".join(values), *options], capture_output=True, text=True, cwd=folder, timeout=1800)
    if run.returncode:
        raise RuntimeError("%s: status %d\n%s" % (p.name, run.returncode, run.stderr[:2000]))
    j = json.loads(run.stdout)
    parts = [abs(v) for key in ("interior", "boundary") if key in j for v in flat(j[key])]  # which may cancel
    return list(flat(j["gradient"])), list(flat(j["stderr"])), j["evaluations"], max(parts, default=0)


def moved(p, seed):
    """The parameters of run `seed`: all of them a little elsewhere, together."""
    r = random.Random(seed)
    nudge = lambda v: v * (1 + 0.1 * p.moves * (r.random() - 0.5))
    return {k: tuple(map(nudge, v)) if isinstance(v, tuple) else nudge(v) for k, v in p.params.items()}


def reference(saltus, p, folder):
    path = os.path.join(folder, "truth.json")
    if not os.path.exists(path):
        fine = ["--estimator", "lattice", "--precision", "f64", "--samples", "2^22"]
        runs = [grad(saltus, p, folder, p.params, 1000 + i, fine)[0] for i in range(4)]
        json.dump([statistics.fmean(c) for c in zip(*runs)], open(path, "w"))
    return json.load(open(path))


def measure(saltus, p, estimator, seeds, options, top):
    folder = os.path.join(top, p.group.replace(" ", "_"), p.name.replace(" ", "_").replace(",", ""))
    prepare(p, folder)
    stays = None if p.truth else reference(saltus, p, folder)
    rows, cost, known, largest = [], 0, {}, 0
    for seed in range(1, seeds + 1):
        values = moved(p, seed) if estimator == "auto" and p.truth else p.params
        g, e, n, part = grad(saltus, p, folder, values, seed, ["--estimator", estimator, *options])
        key = str(values)
        if key not in known:
            known[key] = stays or list(flat({k: p.truth(**values)[k] for k in values}))
        rows.append((g, e, known[key]))
        cost, largest = cost + n, max(largest, part)
    return Result(p, rows, cost / seeds, largest)


class Result:
    def __init__(self, p, rows, cost, largest):
        self.p, self.cost, self.within, self.n, self.ratios, self.rms = p, cost, {2: 0, 4: 0}, 0, [], []
        size = max([largest] + [abs(v) for g, e, want in rows for v in want + g if v == v]) or 1
        for c in range(len(rows[0][2])):
            off = [abs(g[c] - want[c]) if g[c] == g[c] else float("inf") for g, e, want in rows]
            bar = [e[c] if e[c] == e[c] else 0 for g, e, want in rows]
            for o, b in zip(off, bar):
                self.n += 1
                for k in self.within:
                    self.within[k] += o <= k * b + ROUNDING * size
            rms, median = math.sqrt(statistics.fmean(o * o for o in off)), statistics.median(bar)
            self.rms.append(rms / size)
            if rms > ROUNDING * size or median > 10 * ROUNDING * size:
                self.ratios.append(rms / median if median > 0 else float("inf"))


def pooled(ratios):
    return math.sqrt(statistics.fmean(r * r for r in ratios)) if ratios else None


def text(results):
    n = sum(r.n for r in results)
    share = {k: sum(r.within[k] for r in results) / n for k in WANTED}
    ratio = pooled([v for r in results for v in r.ratios])
    good = all(share[k] >= WANTED[k] for k in WANTED) and (ratio is None or RATIO[0] <= ratio <= RATIO[1])
    rms = math.sqrt(statistics.fmean(v * v for r in results for v in r.rms))
    return good, "%.1f | %.1f | %s | %.2g | %.0f" % (100 * share[2], 100 * share[4], "rounding" if ratio is None else "%.2f" % ratio, rms,
                                                  statistics.fmean(r.cost for r in results))


def main():
    a = argparse.ArgumentParser()
    a.add_argument("saltus"), a.add_argument("--seeds", type=int, default=64), a.add_argument("--only", default="")
    a.add_argument("--estimator", action="append"), a.add_argument("--verbose", action="store_true"), a.add_argument("--quick", action="store_true")
    a.add_argument("--folder", default=os.path.join(tempfile.gettempdir(), "saltus-coverage"))
    own, _, rest = " ".join(sys.argv[1:]).partition(" -- ")
    a = a.parse_args(own.split())
    programs = [p for p in PROGRAMS if a.only in p.group + " " + p.name and (not a.quick or p.group + " " + p.name in QUICK)]
    saltus, bad = os.path.abspath(a.saltus), 0
    print("| estimator | group | programs | within 2, % | within 4, % | rms / stated | rms, of the largest | evaluations |\n|---|---|---|---|---|---|---|---|")
    for estimator in a.estimator or ("lattice", "auto"):
        with ThreadPoolExecutor(2) as pool:
            results = list(pool.map(lambda p: measure(saltus, p, estimator, a.seeds, rest.split(), a.folder), programs))
        for group in dict.fromkeys(p.group for p in programs):
            mine = [r for r in results if r.p.group == group]
            good, line = text(mine)
            bad += not good
            print("| %s | %s | %d | %s |%s" % (estimator, group, len(mine), line, "" if good else " <--"), flush=True)
            for r in mine if a.verbose else []:
                good, line = text([r])
                print("|   |   %s | | %s |%s" % (r.p.name, line, "" if good else " <-"))
    return bad != 0


sys.exit(main())
