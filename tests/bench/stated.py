#!/usr/bin/env python3
"""Stated errors of quadrature against true ones, over the programs of tests/bench/stated, of tests/lang and the examples.

    tests/bench/stated.py build/bin/saltus [--cache DIR] [--only TEXT] [--held-out] [--verbose] [-- options of grad]

The truth is quadrature to 1e-11 where that certifies the whole domain and agrees with the lattice, else the lattice
with 2^24 segments, whose own error is given the benefit of the doubt. Answers are kept in the cache. --held-out: programs that no rule of stated
errors was chosen by, instead."""
import argparse
import glob
import hashlib
import json
import os
import statistics
import subprocess
import sys
import tempfile

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
NO_CELLS = ("shadow", "cone_light", "glossy", "pathtrace", "terrain", "two_suns", "raymarch", "texture", "rand", "heightfield", "field_")
FINE = 1e-12  # below this part of the largest component an error is rounding


def flat(v):
    for x in v.values() if isinstance(v, dict) else v if isinstance(v, list) else [v]:
        if isinstance(x, (dict, list)):
            yield from flat(x)
        elif x is not None or not isinstance(v, (dict, list)):
            yield x if isinstance(x, (int, float)) else float("nan")


def grad(saltus, path, options):
    try:
        run = subprocess.run([saltus, "grad", path, "--integral", "--json", "--quiet", *options], capture_output=True,
                             text=True, timeout=1200)
    except subprocess.TimeoutExpired:
        print("%s: not done in 120 s" % path)
        return None
    if run.returncode not in (0, 6) or not run.stdout.strip():
        return None
    j = json.loads(run.stdout)
    return {"g": list(flat(j["gradient"])), "e": list(flat(j["stderr"])), "certified": j.get("certified", 0),
            "parts": list(flat(j["interior"])) + list(flat(j["boundary"])), "left": j.get("left", 1),
            "stopped": j.get("stopped"), "evaluations": j["evaluations"]}


def truth(saltus, path, cache):
    key = hashlib.sha1(open(path, "rb").read()).hexdigest()
    kept = os.path.join(cache, key + ".json")
    if os.path.exists(kept):
        return json.load(open(kept))
    wide = ["--precision", "f64"]
    line = grad(saltus, path, wide + ["--estimator", "lattice", "--segments", "2^24", "--samples", "2^22"])
    if not line or not line["g"]:
        json.dump(None, open(kept, "w"))
        return None
    # Four replicates agree by chance now and then: none is taken to be better than most.
    usual = statistics.median(line["e"])
    t = {"g": line["g"], "u": [4 * max(e, usual) for e in line["e"]], "kind": "lattice"}
    for error in ("1e-11", "1e-8"):
        cell = grad(saltus, path, wide + ["--estimator", "quadrature", "--error", error, "--max-evaluations", "2^25"])
        if not cell or cell["left"] > 0 or cell["certified"] < 1 - 1e-10:
            continue
        size = max(map(abs, line["g"])) or 1
        if all(abs(a - b) <= 5 * u + 1e-3 * size for a, b, u in zip(cell["g"], line["g"], t["u"])):
            t = {"g": cell["g"], "u": cell["e"], "kind": "quadrature"}
            break
    json.dump(t, open(kept, "w"))
    return t


def main():
    p = argparse.ArgumentParser()
    p.add_argument("saltus"), p.add_argument("--cache", default=os.path.join(tempfile.gettempdir(), "stated")), p.add_argument("--only", default="")
    p.add_argument("--verbose", action="store_true"), p.add_argument("--held-out", action="store_true")
    own, _, rest = " ".join(sys.argv[1:]).partition(" -- ")
    a = p.parse_args(own.split())
    a.options = rest.split()
    os.makedirs(a.cache, exist_ok=True)
    options = ["--estimator", "quadrature", *(a.options or ["--precision", "f64"])]
    if any(o in options for o in ("--error", "--abs-error")) and "--max-evaluations" not in options:
        options += ["--max-evaluations", "2^22"]
    sets = ("tests/bench/stated/held_out",) if a.held_out else ("tests/lang", "examples/*", "tests/bench/stated")
    paths = sorted(path for s in sets for path in glob.glob(os.path.join(ROOT, s, "*.salt")))
    programs = components = small = wrongs = 0
    ratios, evaluations = [], 0
    for path in paths:
        name = os.path.relpath(path, ROOT)
        text = open(path).read()
        if a.only not in name or any(s in name for s in NO_CELLS) or "[Disc" not in text and "disc:" not in text:
            continue
        t = truth(a.saltus, path, a.cache)
        r = t and grad(a.saltus, path, options)
        if not r or len(r["g"]) != len(t["g"]):
            continue
        programs += 1
        evaluations += r["evaluations"]
        size = max(abs(v) for v in t["g"] + r["parts"] if v == v)  # the two parts may cancel
        worst, bad, own = 0, 0, []
        for g, e, want, u in zip(r["g"], r["e"], t["g"], t["u"]):
            if not (g == g and want == want):
                continue
            off = abs(g - want)
            u += 1e-6 * size if t["kind"] == "lattice" else 0  # roots of lines are known to 2^-15 of a segment
            wrong = off - u > e + FINE * size
            components += 1
            small += wrong
            bad += wrong
            worst = max(worst, (off - u) / (e + FINE * size) if off > u else 0)
            if e > 100 * FINE * size and off > u:
                own.append(e / off)
        ratios += [statistics.median(own)] if own else []
        wrongs += bad > 0.05 * len(r["g"])
        if bad or a.verbose:
            print("%-44s %-10s off/stated %8.3g  bad %d/%d  median stated/off %8.3g  left %.2g  error %.1e %s %d" % (
                name, t["kind"], worst, bad, len(r["g"]), statistics.median(own) if own else 0, r["left"],
                max(r["e"]) / size if size else 0, r["stopped"], r["evaluations"]))
    print("%d programs, %d components; %.1f %% of components and %.1f %% of programs within the stated error; "
          "stated / true: median %.3g over %d programs above rounding; %d evaluations" % (
        programs, components, 100 * (1 - small / max(components, 1)), 100 * (1 - wrongs / max(programs, 1)),
        statistics.median(ratios) if ratios else 0, len(ratios), evaluations))


main()
