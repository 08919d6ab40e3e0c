#!/usr/bin/env python3
"""The table of docs/performance.md, "Compiling": whole processes that compile all kernels of a gradient, or find them in the cache, as rows of Markdown. Several programs are run in turn.

    tests/bench/start.py [--rounds 20] [--only circle,raymarch] build/bin/saltus [other/saltus ...]

The least and the median processor time and the median time of the clock, in ms; --threads T as for saltus."""
import argparse
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time

HERE = os.path.dirname(os.path.abspath(__file__))
EXAMPLES = os.path.join(HERE, "..", "..", "examples")
INTEGRAL = "--integral --samples 1024 --segments 64"
IMAGE = "--size 16 --spp 1 -o image.npy"
CASES = {
    "circle": ("circle/circle.salt", "grad", INTEGRAL),
    "painterly": ("painterly_discs/discs.salt", "grad", INTEGRAL),
    "raymarch": ("raymarch/raymarch.salt", "grad", "--wrt radius " + IMAGE),
    "pathtrace": ("pathtrace/soft_sun.salt", "grad", "--entry sites --set pathtrace.NEAR=0.01171875 --wrt elevation --estimator lattice " + IMAGE),
    "straight line of 8 000": (None, "render", IMAGE),
}


def straight_line(path, operations=8000):
    """Circles, thousands of which are joined by minima and maxima: no two operations are the same."""
    lines = ["float v0 = x.x;"]
    for i in range(1, operations // 8):
        lines.append("float v%d = %s(v%d, sqrt((x.x - %.5f) * (x.x - %.5f) + (x.y + %.5f) * (x.y + %.5f)) - 0.02);"
                     % (i, "min" if i % 5 else "max", i - 1, i * 0.618 % 1, i * 0.618 % 1, i * 0.377 % 1, i * 0.377 % 1))
    with open(path, "w") as f:
        f.write("[Domain(-1.0, 1.0)] shader float main(float2 x) {\n%s\nreturn v%d; }\n" % ("\n".join(lines), operations // 8 - 1))


def run(command, folder, env):
    start = time.perf_counter()
    p = subprocess.Popen(command, cwd=folder, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    text = p.stderr.read()
    _, status, used = os.wait4(p.pid, 0)
    p.returncode = os.waitstatus_to_exitcode(status)
    if p.returncode:
        sys.exit("%s: %s" % (" ".join(command), text.decode()))
    return 1e3 * (used.ru_utime + used.ru_stime), 1e3 * (time.perf_counter() - start)


def main():
    a = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    a.add_argument("saltus", nargs="+")
    a.add_argument("--rounds", type=int, default=20)
    a.add_argument("--only", default=",".join(CASES))
    a.add_argument("--threads", default="0")
    a = a.parse_args()
    folder = tempfile.mkdtemp()
    env = dict(os.environ, XDG_CACHE_HOME=folder)
    print("| program | | cold: processor, least | median | clock | from the cache: processor, least | median | clock |\n|---|---|---|---|---|---|---|---|")
    try:
        for name in a.only.split(","):
            path, verb, options = CASES[name]
            path = os.path.abspath(os.path.join(EXAMPLES, path)) if path else os.path.join(folder, "line.salt")
            if not os.path.exists(path):
                straight_line(path)
            threads = [] if a.threads == "0" else ["--threads", a.threads]
            times = {}
            for r in range(a.rounds + 1):  # the first fills the cache
                for saltus in a.saltus:
                    line = [os.path.abspath(saltus), verb, path, *options.split(), "--quiet", *threads]
                    for cold in (True, False):
                        used = run(line + ["--no-cache"] * cold, folder, env)
                        if r:
                            times.setdefault((saltus, cold), []).append(used)
            for saltus in a.saltus:
                row = [name, saltus]
                for cold in (True, False):
                    used, clock = zip(*times[saltus, cold])
                    row += ["%.3g" % v for v in (min(used), statistics.median(used), statistics.median(clock))]
                print("| %s |" % " | ".join(row), flush=True)
    finally:
        shutil.rmtree(folder)


main()
