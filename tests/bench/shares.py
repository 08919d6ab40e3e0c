#!/usr/bin/env python3
"""The table of docs/bounds.md: of every example what bounds certify, as rows of Markdown.

    tests/bench/shares.py build/bin/saltus >rows"""
import glob
import json
import os
import subprocess
import sys

OPTIONS = "--integral --estimator quadrature --precision f64 --error 1e-4 --max-evaluations 2^24 --json".split()
EXAMPLES = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "examples")


def numbers(v):
    for x in v.values() if isinstance(v, dict) else v if isinstance(v, list) else ():
        yield from numbers(x)
    if isinstance(v, (int, float)):
        yield abs(v)


def percent(v):
    return "%.3g %%" % (100 * v) if v else "0"


for path in sorted(glob.glob(os.path.join(EXAMPLES, "*", "*.salt"))):
    name = os.path.relpath(path, EXAMPLES)
    run = subprocess.run([sys.argv[1], "grad", path, *OPTIONS], capture_output=True, text=True)
    if run.returncode not in (0, 6):  # a module, or it wants an entry
        continue
    j = json.loads(run.stdout)
    if j["stderr_kind"] not in ("quadrature", "mixed"):
        print("| %s | nothing has bounds | | | |" % name)
        continue
    largest = max(numbers(j["gradient"]), default=0)
    error = "%.1e" % (max(numbers(j["stderr"])) / largest) if largest else "no parameters"
    print("| %s | %s | %s | %s | %s |" % (name, percent(j["settled"]), percent(j["curved"]), percent(j["left"]), error))
