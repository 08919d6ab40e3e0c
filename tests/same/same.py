#!/usr/bin/env python3
"""Whether two builds of saltus compute the same bits.

    tests/same/same.py record build/bin/saltus before.json
    tests/same/same.py compare before.json after.json
    tests/same/same.py record build/bin/saltus after.json --only circle --quick
    tests/same/same.py count before/bin/saltus after/bin/saltus

A record holds a digest of everything that a build computes from the shaders of this tree (examples, tests/programs,
tests/golden, tests/bench, tests/lang, tests/heightfield): images, integrals, gradients forward and reverse, every estimator,
filters, widths, instruction sets, both precisions, the interpreter, fits, checks, and the operations of every kernel. `count`
compares the instructions of compiling and of running (callgrind; on AVX2, which it knows) and the size of the binaries.
Texts for people and timings are left out. Each run has a cache of its own, so nothing of another build is served.
"""
import argparse
import concurrent.futures
import glob
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
TIMES = {"seconds", "ratio", "seconds_interior", "seconds_boundary", "ns", "compile_ms", "ms", "cached", "outputs", "message",
         "machine_bytes", "time", "warnings", "text", "note", "tape"}
INTEGRAL = ["grad", "--integral", "--json", "--samples", "2000", "--segments", "600"]


def without_times(value):
    if isinstance(value, dict):
        return {k: without_times(v) for k, v in value.items() if k not in TIMES}
    return [without_times(v) for v in value] if isinstance(value, list) else value


def digest(data):
    return hashlib.sha256(data).hexdigest()[:16]


def dimension(path):
    m = re.search(r"shader\s+\w+\s+\w+\s*\(\s*float([23]?)\s", open(path, errors="replace").read())
    return int(m.group(1) or 1) if m else 2


def size(dim, n):
    return {1: str(n * n), 2: f"{n}x{n}", 3: f"{n // 2}x{n // 2}x{n // 2}"}[dim]


def cases(quick):
    """(name, shader, arguments, environment); {out} in an argument is a file that is digested."""
    def shaders(*patterns):
        return sorted(p for pattern in patterns for p in glob.glob(os.path.join(ROOT, pattern)))

    main = shaders("examples/*/*.salt", "tests/programs/*.salt", "tests/golden/*.salt", "tests/bench/*.salt",
                   "tests/heightfield/*.salt")
    for path in main:
        name, dim = os.path.relpath(path, ROOT), dimension(path)
        yield f"{name}: image", path, ["render", "--size", size(dim, 24), "--spp", "3", "-o", "{out}.npy"], {}
        yield f"{name}: image f64", path, ["render", "--precision", "f64", "--size", size(dim, 16), "--spp", "2", "-o", "{out}.npy"], {}
        yield f"{name}: integral", path, INTEGRAL, {}
        yield f"{name}: integral f64", path, INTEGRAL + ["--precision", "f64"], {}
        yield f"{name}: auto", path, INTEGRAL + ["--disc", "auto"], {}
        yield f"{name}: operations", path, ["bench", "--kernels", "--json"], {}
        if dim > 1:
            yield f"{name}: target", path, ["grad", "--json", "--target", os.path.join(ROOT, "examples/painterly_discs/photo.png"), "--size", size(dim, 16), "--spp", "2"], {}
        if quick:
            continue
        for estimator in ["scanline", "snap-knn", "snap-crofton", "fd"]:
            yield f"{name}: {estimator}", path, INTEGRAL + ["--estimator", estimator], {}
        for width in ["1", "8", "32"]:
            yield f"{name}: width {width}", path, INTEGRAL + ["--width", width], {}
        for isa in ["sse2", "avx2"]:
            yield f"{name}: {isa}", path, INTEGRAL + ["--target-cpu", isa], {}
        for variant in ["argmin", "forced", "path"]:
            yield f"{name}: {variant}", path, INTEGRAL + ["--variant", variant], {}
        for near in ["on", "off"]:
            yield f"{name}: near {near}", path, INTEGRAL + ["--near-miss", near], {}
        yield f"{name}: interpreted", path, ["grad", "--integral", "--json", "--samples", "64", "--segments", "32", "--interpret"], {}
        for filter in ["tent", "gaussian"]:
            yield f"{name}: {filter}", path, ["render", "--filter", filter, "--size", size(dim, 12), "--spp", "2", "-o", "{out}.npy"], {}
        yield f"{name}: derivative images", path, ["grad", "--size", size(dim, 12), "--spp", "2", "-o", "{out}.exr"], {}
        yield f"{name}: rgba8", path, ["render", "--format", "rgba8", "--size", size(dim, 16), "-o", "{out}.png"], {}
        yield f"{name}: point", path, ["explain", "--at", ",".join(["0.4"] * dim), "--json"], {}
    for path in shaders("examples/*/*.json") if not quick else []:
        if '"views"' in open(path).read() or '"optimizer"' in open(path).read():
            yield f"{os.path.relpath(path, ROOT)}: fit", path, ["fit", "--json", "--iters", "3", "--size", "24x24", "--spp", "1"], {}
    for optimizer in ["adam", "sgd", "lbfgs"] if not quick else []:
        path = os.path.join(ROOT, "examples/painterly_discs/discs.salt")
        yield f"painterly_discs: fit {optimizer}", path, ["fit", "--json", "--iters", "6", "--optimizer", optimizer, "--target", os.path.join(ROOT, "examples/painterly_discs/photo.png"), "--size", "48x48", "--spp", "1", "-o", "{out}.json"], {}
    for path in ["examples/circle/circle.salt", "tests/programs/line.salt"] if not quick else []:
        yield f"{path}: check", os.path.join(ROOT, path), ["check", "--json"], {}
    lang = shaders("tests/lang/*.salt")
    for path in lang[:: 8 if quick else 1]:
        name, dim = os.path.relpath(path, ROOT), dimension(path)
        yield f"{name}: image", path, ["render", "--size", size(dim, 4), "--spp", "1", "-o", "{out}.npy"], {}


def run(binary, case, cache):
    name, path, arguments, environment = case
    with tempfile.TemporaryDirectory() as folder:
        out = os.path.join(folder, "out")
        command = [binary, arguments[0], path] + [a.replace("{out}", out) for a in arguments[1:]] + ["--quiet"]
        env = dict(os.environ, XDG_CACHE_HOME=cache, SALTUS_STDLIB=os.path.join(ROOT, "stdlib"), **environment)
        try:
            done = subprocess.run(command, capture_output=True, env=env, timeout=1800, cwd=folder)
        except subprocess.TimeoutExpired:
            return name, "timeout"
        parts = [f"status {done.returncode}"]
        if "--json" in arguments:
            try:
                parts.append(digest(json.dumps(without_times(json.loads(done.stdout)), sort_keys=True).encode()))
            except ValueError:
                parts.append("stdout " + digest(done.stdout))
        for file in sorted(glob.glob(out + "*")):
            parts.append(digest(open(file, "rb").read()))
        return name, " ".join(parts)


def record(options):
    chosen = [c for c in cases(options.quick) if not options.only or re.search(options.only, c[0])]
    result = {}
    with tempfile.TemporaryDirectory() as cache, concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        for done, (name, value) in enumerate(pool.map(lambda c: run(os.path.abspath(options.binary), c, cache), chosen), 1):
            result[name] = value
            if sys.stderr.isatty():
                print(f"\r{done}/{len(chosen)} {name[:70]:70}", end="", file=sys.stderr)
    with open(options.file, "w") as f:
        json.dump(result, f, indent=0, sort_keys=True)
    failed = sum("status 0" not in v for v in result.values())
    print(f"{len(result)} results, {failed} of them errors that must stay what they are")


def compare(options):
    before, after = (json.load(open(f)) for f in (options.before, options.after))
    both = before.keys() & after.keys()
    different = sorted(k for k in both if before[k] != after[k])
    for name in different:
        print(f"differs: {name}\n  {before[name]}\n  {after[name]}")
    alone = len(before.keys() ^ after.keys())
    print(f"{len(both)} compared, {len(different)} differ, {alone} in one record only")
    return 1 if different or not both else 0


def counted(binary, arguments, cache):
    env = dict(os.environ, XDG_CACHE_HOME=cache, SALTUS_STDLIB=os.path.join(ROOT, "stdlib"), SALTUS_TARGET="avx2")
    command = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null", os.path.abspath(binary)] + arguments
    done = subprocess.run(command, capture_output=True, text=True, env=env, cwd=ROOT)
    found = re.search(r"Collected : (\d+)", done.stderr)
    if done.returncode or not found:
        sys.exit(f"{' '.join(command)}\n{done.stderr}")
    return int(found.group(1))


def count(options):
    """What is counted: front and passes alone (the interpreter runs one sample), LLVM with them, kernels from the cache."""
    discs, terrain = "tests/bench/discs_2000.salt", "examples/shadow_art/shadow.salt"
    shaders = ["examples/circle/circle.salt", "examples/painterly_discs/discs.salt", "tests/bench/shade_raymarch.salt", terrain]
    plain = ["--threads", "1", "--quiet"]
    tasks = [("front and passes: " + s, ["grad", s, "--integral", "--samples", "1", "--segments", "1", "--interpret"] + plain) for s in shaders]
    tasks += [("compile: " + s, ["grad", s, "--integral", "--samples", "1", "--segments", "1", "--no-cache"] + plain) for s in shaders]
    tasks += [("integral: " + s, ["grad", s, "--integral", "--samples", "60000"] + plain) for s in shaders]
    photo = "examples/painterly_discs/photo.png"
    tasks += [("image: " + discs, ["render", discs, "--size", "128", "-o", os.path.join(tempfile.gettempdir(), "same.pfm")] + plain),
              ("loss: " + discs, ["grad", discs, "--target", photo, "--size", "64", "--spp", "2"] + plain),
              ("loss: " + terrain, ["grad", terrain, "--target", photo, "--size", "64", "--spp", "1"] + plain)]
    worst = 1
    with tempfile.TemporaryDirectory() as a, tempfile.TemporaryDirectory() as b:
        for name, arguments in tasks:
            if "--no-cache" not in arguments and "--interpret" not in arguments: # fills the caches
                counted(options.before, arguments, a), counted(options.after, arguments, b)
            old, new = counted(options.before, arguments, a), counted(options.after, arguments, b)
            worst = max(worst, new / old)
            print(f"{old:15,} {new:15,} {new / old:7.4f}  {name}", flush=True)
    for binary in (options.before, options.after):
        print(f"{os.path.getsize(binary):,} bytes {binary}")
    print(f"largest ratio {worst:.4f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = parser.add_subparsers(dest="verb", required=True)
    r = verbs.add_parser("record")
    r.add_argument("binary")
    r.add_argument("file")
    r.add_argument("--only", help="a regular expression of names of results")
    r.add_argument("--quick", action="store_true", help="the plain runs only")
    r.add_argument("--jobs", type=int, default=os.cpu_count())
    c = verbs.add_parser("compare")
    c.add_argument("before")
    c.add_argument("after")
    n = verbs.add_parser("count")
    n.add_argument("before")
    n.add_argument("after")
    options = parser.parse_args()
    return {"record": record, "compare": compare, "count": count}[options.verb](options)


if __name__ == "__main__":
    sys.exit(main())
