"""Every call site of an allocation or of the system fails in turn, once, the second time and from there on, all or every third call, over all verbs.

    faults.py INJECT.so SALTUS [--every N] [--case NAME] [--calls N] [--jobs N] [--site N --mode once|second|on|third --kinds m|s]

inject.c counts the sites and lets them fail. What is asked of each run: a documented status and no signal, within the
time; words that name the cause; the old outputs whole or the new ones, all of them, and the new ones if the status is
0; no temporary files left; nothing kept that a run without a fault gives back."""
import argparse
import concurrent.futures
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile

OLD = b"what an earlier run wrote"
SOURCE = """
param float radius = 0.4;
param float ink = 1.0;
param texture2D picture = "small.npy";
[Domain(-1.0, 1.0)]
shader float main(float2 x) {
    float f = 0.25 + 0.001 * picture.sample(x).x;
    [Disc] if (length(x) < radius) f = ink;
    return f;
}
"""
SCENE = """{"shader": "circle.salt", "target": "small.npy", "size": [4, 4], "params": {"radius": {"lr": 0.01}, "ink": 0.5, "picture": {"grad": false}},
 "optimizer": {"iters": 2}}"""
PARAMS = '{"radius": 0.3, "ink": 0.7}'

ROUNDS_SALT = """param float2 discs[] = {float2(0.3, 0.2)};
[Domain(-1.0, 1.0)]
shader float main(float2 x) { float f = 0.25; for (int i = 0; i < len(discs); i++) { [Disc] if (length(x - discs[i]) < 0.4) f = 1.0; } return f; }
"""
ROUNDS = """{"shader": "rounds.salt", "target": "small.npy", "size": [4, 4], "rounds": {"iters": 1, "command": "exec env -u LD_PRELOAD cat answer.json"}, "optimizer": {"iters": 2}}"""
ANSWER = """{"params": {"discs": [[0.3, 0.2], [-0.3, 0.1]]}}"""

MESH = """param mesh m = "sheet.obj";
shader float main(float2 x) {
    Beam b = { float3(0.3, 0.4, 3.0), float3(-0.2, -0.1, 0.5), float3(1.1, 0.0, 0.0), float3(0.0, 1.1, 0.0) };
    AreaLight light = { float3(0.2, 0.1, 2.0), float3(0.0, 0.5, 0.0), float3(0.5, 0.0, 0.0) };
    float s = m.irradiance(float3(0.5, 0.5, -1.0), float3(0.0, 0.0, 1.0), light);
    for (Piece q = m.first(b); q.found; q = m.next(q)) s += WHAT;
    return s;
}
"""

# Its loop takes long enough for an image to ask bounds which iterations matter where (bindings/c/listed.h).
PAINTER = """float disc(int i) { return frac(float(i) * 0.618 + 0.37); }
param float d[192] = init(disc);
shader float3 main(float2 x) {
    float3 c = float3(0.9);
    for (int i = 0; i < 48; i++) { [Disc] if (distance(x, float2(d[4 * i], d[4 * i + 1])) < 0.2 * d[4 * i + 2]) c = float3(d[4 * i + 3], d[4 * i + 2], 0.5); }
    return c;
}
"""


def sheet(n=10):
    """Sheets of 2 n^2 triangles, one below the other and through it."""
    text = "".join("v %g %g %g\n" % (i / n, j / n, 0.4 * below - 0.1 * (i * j % 3) - 0.1) for below in (0, 1) for j in range(n + 1) for i in range(n + 1))
    for first in (1, 1 + (n + 1) ** 2):
        for j in range(n):
            for i in range(n):
                a = first + j * (n + 1) + i
                text += "f %d %d %d\nf %d %d %d\n" % (a, a + 1, a + n + 2, a, a + n + 2, a + n + 1)
    return text


# name: what it does, its outputs, which an earlier run has written too.
SMALL = "--size 4x4 --samples 64 --threads 1"
CASES = {
    "render-exr": ("render circle.salt --interpret %s -o out.exr" % SMALL, ["out.exr"]),
    "render-png": ("render circle.salt --interpret %s --params params.json --param ink=0.5 -o out.png" % SMALL, ["out.png"]),
    "render-cached": ("render circle.salt %s -o out.pfm" % SMALL, ["out.pfm"]),
    "render-text": ("render --expr sin(x.x)*step(x.y,0.5) --interpret %s -o out.npy" % SMALL, ["out.npy"]),
    "grad": ("grad circle.salt --interpret %s --wrt radius,ink -o out.exr" % SMALL, ["out.exr"]),
    "grad-cached": ("grad circle.salt %s --integral --json" % SMALL.replace("--size 4x4", ""), []),
    "grad-quadrature": ("grad circle.salt --interpret --size 2x2 --threads 1 --wrt radius --estimator quadrature --gauss 4 -o out.npy", ["out.npy"]),
    "grad-target": ("grad circle.salt --interpret --size 4x4 --spp 1 --threads 1 --target small.npy", []),
    "grad-pieces": ("grad pieces.salt --interpret --integral --estimator lattice --samples 64 --threads 1 --wrt m", []),
    "grad-lit": ("grad lit.salt --interpret --integral --estimator lattice --samples 64 --threads 1 --wrt m", []),
    "grad-cells": ("grad circle.salt --interpret --integral --estimator quadrature --error 1e-4 --threads 1", []),
    "render-lists": ("render painter.salt --size 256x256 --spp 64 --threads 1 -o out.npy", ["out.npy"]),
    "sandbox": ("render circle.salt --sandbox --interpret %s -o out.png" % SMALL, ["out.png"]),
    "fit": ("fit circle.salt --interpret %s --target small.npy --wrt radius --iters 2 -o out" % SMALL, ["out/fitted.json", "out/loss.csv", "out/image.exr", "out/strip.png"]),
    "fit-scene": ("fit scene.json --interpret --threads 1 -o out", ["out/fitted.json", "out/loss.csv", "out/image.exr", "out/strip.png"]),
    "fit-rounds": ("fit rounds.json --interpret --threads 1 --allow-commands -o out", ["out/fitted.json", "out/loss.csv", "out/image.exr", "out/strip.png"]),
    "check": ("check circle.salt --interpret --samples 256 --size 2x2 --threads 1 --wrt radius --tolerance 100 --json", []),
    "bench": ("bench circle.salt --interpret --samples 256 --repeats 2 --threads 1 --wrt radius -o out", ["out/bench.csv", "out/bench.json", "out/bench.svg"]),
    "explain": ("explain circle.salt --json", []),
    "bound": ("bound circle.salt --box 0.2,0.3;0.1,0.2", []),
    "build-o": ("build circle.salt -o out.o", ["out.o", "out.h"]),
    "build-h": ("build circle.salt -o out.h", ["out.h"]),
    "wrong": ("render wrong.salt -o out.exr", ["out.exr"]),
    "help": ("--help", []),
}
STORES = ("grad-pieces", "grad-lit")  # searches of meshes keep their rows with the thread, wherever these grew
SYSTEM_ONLY = ("build-o",)  # its memory is build-h's, and what compiling takes has `--calls`
MEMORY = re.compile("memory", re.I)
CAUSES = re.compile("memory|Too many open files|Input/output error|No space left|Permission denied|Resource temporarily unavailable|Operation not permitted|could not be|system refuses", re.I)


def write_npy(path):
    head = b"{'descr': '<f4', 'fortran_order': False, 'shape': (4, 4, 1), }"
    head += b" " * (63 - (len(head) + 10) % 64) + b"\n"
    with open(path, "wb") as f:
        f.write(b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head + b"\0\0\0\x3f" * 16)


class Place:
    """A folder with the inputs, an old output, and a cache of kernels that a case's run without faults fills."""

    def __init__(self, case, args):
        self.args, self.case = args, case
        self.line, self.outputs = CASES[case]
        self.dir = tempfile.mkdtemp(prefix="saltus-fault-")
        for name, text in (("circle.salt", SOURCE), ("scene.json", SCENE), ("params.json", PARAMS), ("rounds.salt", ROUNDS_SALT), ("rounds.json", ROUNDS), ("answer.json", ANSWER), ("wrong.salt", SOURCE.replace("ink;", "inc;")), ("painter.salt", PAINTER),
                           ("sheet.obj", sheet()), ("pieces.salt", MESH.replace("WHAT", "q.area * q.normal.z")), ("lit.salt", MESH.replace("WHAT", "m.lit(q, float3(0.3, 0.2, 1.0))"))):
            with open(os.path.join(self.dir, name), "w") as f:
                f.write(text)
        write_npy(os.path.join(self.dir, "small.npy"))
        self.inputs = set(os.listdir(self.dir))

    def path(self, name):
        return os.path.join(self.dir, name)

    def clean(self):
        for name in set(os.listdir(self.dir)) - self.inputs - {"cache"}:
            shutil.rmtree(self.path(name)) if os.path.isdir(self.path(name)) else os.remove(self.path(name))
        for name in self.outputs:
            os.makedirs(os.path.dirname(self.path(name)), exist_ok=True)
            with open(self.path(name), "wb") as f:
                f.write(OLD if not name.endswith(".h") else b"/* made by saltus */\n" + OLD)

    def read(self):
        """Every file of the outputs and its bytes."""
        found = {}
        for folder, _, names in os.walk(self.dir):
            for name in names:
                full = os.path.join(folder, name)
                short = os.path.relpath(full, self.dir)
                if short.split(os.sep)[0] not in self.inputs | {"cache", "log"}:
                    with open(full, "rb") as f:
                        found[short] = f.read()
        return found

    def run(self, kinds, site=None, mode="once", call=None):
        self.clean()
        env = dict(os.environ, XDG_CACHE_HOME=self.path("cache"), NO_COLOR="1", FAULT_MODE=mode, FAULT_KINDS=kinds, FAULT_LOG=self.path("log"),
                   LC_ALL="C", LD_PRELOAD=self.args.inject)
        if site is not None:
            env["FAULT_SITE"] = str(site)
        if call is not None:
            env["FAULT_CALL"] = str(call)
        if os.path.exists(self.path("log")):
            os.remove(self.path("log"))
        try:
            p = subprocess.run([self.args.saltus, *self.line.split()], cwd=self.dir, env=env, capture_output=True, timeout=self.args.timeout, stdin=subprocess.DEVNULL)
            code, out, err = p.returncode, p.stdout.decode(errors="replace"), p.stderr.decode(errors="replace")
        except subprocess.TimeoutExpired:
            code, out, err = "hang", "", ""
        log = open(self.path("log")).read() if os.path.exists(self.path("log")) else ""
        return code, out, err, log, self.read()


def kept(log):
    # What LLVM makes once a process stays until its end. Of the C library only who called it: it takes other ways where
    # there is no second thread.
    return {" ".join(f for f in line.split(" ", 2)[2].split() if not f.startswith(("libc.", "ld-linux", "?")))
            for line in log.splitlines() if line.startswith("kept") and "libLLVM" not in line}


def is_timing(name):
    return name.endswith((".csv", ".json", ".svg", ".bench"))


def complaints(result, base, kinds, place):
    code, out, err, log, files = result
    if "failed" not in log and "calls 0" in log and code not in ("hang",) and not (isinstance(code, int) and code < 0) and log:
        return []  # the site was not reached this time
    found = []
    if code == 127 and kinds == "m" and err == "out of memory\n":
        return []  # the loader's own end, while LLVM comes in: glibc saves nothing there
    if code == "hang" or code < 0 or code not in (0, 1, 2, 3, 4, 5, 6):
        return ["ends with %s" % code]
    if kinds == "m" and code not in (0, 6) and code != base[0]:
        found.append("status %d, and 6 is meant" % code)
    if code != base[0] and code != 0 and not (MEMORY if kinds == "m" else CAUSES).search(err):
        found.append("status %d without the cause: %r" % (code, err[-200:]))
    if code == 0 and base[0] != 0:
        found.append("status 0 of a program with errors")
    for name, data in files.items():
        if name.endswith(".tmp"):
            found.append("leaves " + name)
        elif name in base[4] and data != base[4][name] and not data.endswith(OLD) and not is_timing(name) and not (place.line.startswith("fit") and code):
            found.append("%s is neither the old nor the new one" % name)
    old = [name for name in place.outputs if files.get(name, b"").endswith(OLD)]
    new = [name for name in files if name in base[4] and name not in old]
    if old and new:
        found.append("%s are new beside the old %s" % (new, old))
    gone = set(place.outputs) - set(files)
    if gone:
        found.append("what an earlier run wrote is gone: " + ", ".join(sorted(gone)))
    if old and code == 0 and base[0] == 0:
        found.append("status 0, and the outputs are the old ones")
    if code == 0 and base[0] == 0:
        missing = set(base[4]) - set(files)
        if missing:
            found.append("status 0 without " + ", ".join(sorted(missing)))
        if not re.search("seconds|_ms|, [0-9.]+ s", base[1]) and out != base[1]:
            found.append("status 0 with another text")
    # a command that ends where it is leaves that to the system
    leaks = set() if place.case in STORES or err.endswith(("saltus: out of memory\n", '"message":"out of memory","status":6}\n')) else kept(log) - kept(base[3])
    if leaks:
        found.append("keeps " + "\n      ".join(sorted(leaks)[:3]))
    return found


def run_case(case, args):
    lines, runs = [], 0
    place = Place(case, args)
    try:
        for kinds in "s" if case in SYSTEM_ONLY else args.kinds:
            for _ in range(2):  # the first fills the cache
                base = place.run(kinds)
            if base[0] != (3 if case == "wrong" else 0):
                return ["%s: status %s without a fault: %s" % (case, base[0], base[2])], 0
            count = int(re.search("sites ([0-9]+)", base[3]).group(1))
            again = {int(n) for n in re.findall("again ([0-9]+)", base[3])}
            seen = {}
            for mode in args.mode.split(","):
                sites = [args.site] if args.site is not None else range(args.first % args.every, count, args.every)
                for site in sites:
                    if mode == "second" and site not in again:
                        continue
                    result = place.run(kinds, site, mode)
                    runs += 1
                    if args.site is not None:
                        print(result[0], result[2], result[3], sep="\n")
                    for text in complaints(result, base, kinds, place):
                        where = re.search("failed (.*)", result[3])
                        key = re.sub("[0-9]+", "#", text)
                        seen.setdefault(key, []).append((site, mode, text, where.group(1) if where else "?"))
            for group in seen.values():
                for site, mode, text, where in group[:args.show]:
                    lines.append("%s %s site %d %s: %s\n    %s%s" % (case, kinds, site, mode, text, where, "\n    and %d more of this kind" % (len(group) - args.show) if len(group) > args.show and (site, mode, text, where) == group[args.show - 1] else ""))
            lines.append("# %s %s: %d sites" % (case, kinds, count))
    finally:
        shutil.rmtree(place.dir, ignore_errors=True)
    return lines, runs


def compile_calls(n, args):
    """Random calls for memory fail while kernels are compiled, LLVM's own among them; nothing comes from the cache."""
    place, lines, pick = Place("render-cached", args), [], random.Random(args.first)
    place.line += " --no-cache"
    try:
        base = place.run("m", call=1 << 40)
        count = int(re.search("calls ([0-9]+)", base[3]).group(1))
        for _ in range(n):
            call, mode = pick.randrange(count), pick.choice(("once", "on", "third"))
            for text in complaints(place.run("m", None, mode, call), base, "m", place):
                lines.append("compile call %d %s: %s" % (call, mode, text))
        lines.append("# compile: %d of %d calls" % (n, count))
    finally:
        shutil.rmtree(place.dir, ignore_errors=True)
    return lines, n


def main():
    p = argparse.ArgumentParser()
    p.add_argument("inject")
    p.add_argument("saltus")
    p.add_argument("--every", type=int, default=1)
    p.add_argument("--first", type=int, default=0)
    p.add_argument("--case", default=",".join(CASES))
    p.add_argument("--jobs", type=int, default=2)
    p.add_argument("--calls", type=int, default=0, help="so many random failures while kernels are compiled")
    p.add_argument("--site", type=int)
    p.add_argument("--mode", default="once,second,on,third")
    p.add_argument("--kinds", default="ms")
    p.add_argument("--show", type=int, default=2)
    p.add_argument("--timeout", type=float, default=300)
    args = p.parse_args()
    args.inject, args.saltus = os.path.abspath(args.inject), os.path.abspath(args.saltus)
    bad, runs = 0, 0
    with concurrent.futures.ThreadPoolExecutor(args.jobs) as pool:
        cases = [] if not args.case else args.case.split(",")
        jobs = [pool.submit(run_case, case, args) for case in cases] + [pool.submit(compile_calls, args.calls, args)] * (args.calls > 0)
        for lines, n in (job.result() for job in jobs):
            runs += n
            bad += sum(not line.startswith("#") for line in lines)
            print("\n".join(lines), flush=True)
    print("%d runs, %d complaints" % (runs, bad))
    return bad != 0


sys.exit(main())
