#!/usr/bin/env python3
"""All tables of speed in one run, one thread, as text, JSON and SVG.

    SALTUS_BENCH=... tests/bench/tables.py BUILD_DIR [-o FOLDER] [--only forward,reverse,images,...] [--rounds N] [--against SALTUS]

forward   shade_*.salt at 1024 x 1024 as 8-bit pixels, beside scalar C of $SALTUS_BENCH/shade/kernels.c: every instruction
          set and width that this machine has, interleaved (bench-shade). Mpixel/s and times scalar C.
second    the same of unseen/shade_*.salt and unseen/kernels.c; `poly` is that C with polynomials in place of libm.
third     likewise of third/.
reverse   ad_k*.salt, kernels alone: nanoseconds a sample of f, and of f with all its derivatives; beside the same
          programs in 16-wide C of $SALTUS_BENCH/ad/primal.c, whose derivatives by the best layout for Enzyme cost as
          many times the primal as stated there (ENZYME below): `gain` is that over ours.
samples   what makes a sample (bench-samples).
images    512 x 512, 16 samples a pixel, lattice: processor time of a render, and of a loss with its gradient.
fits      an iteration of the fit of 200 to 20 000 discs (many_discs.py).
starts    whole processes, cold and from the cache (start.py).
fields    heightfields, and
rays      rays against meshes, beside Embree where it is installed (bench-field, bench-mesh); $SALTUS_DATA has the shapes.
pieces    visible pieces of $SALTUS_DATA's spot.obj and their gradient (bench-pieces).

With --against, another saltus runs in turn with ours in `reverse` and `images`, and the last column is its time over
ours: medians over rounds of the ratio within a round. What needs SALTUS_BENCH says so and is left out without it.
"""
import argparse, json, math, os, pathlib, resource, statistics, subprocess, sys, tempfile

HERE = pathlib.Path(__file__).resolve().parent
EXAMPLES = HERE.parent.parent / "examples"
ENZYME = {1: 3.0, 2: 3.6, 3: 5.7, 4: 1.9, 5: 2.1}  # derivatives / primal, adjoints kept per lane, reduced once
IMAGES = {"circle": "circle/circle.salt", "painterly": "painterly_discs/discs.salt",
          "high_frequency": "high_frequency/zone_plate.salt", "raymarch": "raymarch/raymarch.salt"}


def run(*command):
    p = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    if p.returncode:
        sys.exit(f"{' '.join(map(str, command))}: status {p.returncode}\n{p.stderr}")
    return p.stdout


def processor_seconds(*command):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    run(*command)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def interleaved(rounds, ways):
    """Rounds of all ways in turn: their medians, and of the second over the first the median of the ratios."""
    times = [[] for _ in ways]
    for _ in range(rounds):
        for t, way in zip(times, ways):
            t.append(way())
    ratio = statistics.median(b / a for a, b in zip(*times[:2])) if len(ways) > 1 else None
    return [statistics.median(t) for t in times], ratio


def scalar_library(folder, source, suffix="scalar", *more):
    out = pathlib.Path(folder) / f"{suffix}.so"
    run("clang-19", "-O3", "-fno-vectorize", "-fno-slp-vectorize", f"-DSUF={suffix}", *more, "-shared", "-fPIC",
        "-std=gnu11", "-march=native", source, "-o", out, "-lm")
    return f"{out}:{suffix}"


def forward(args, folder):
    source = pathlib.Path(os.environ["SALTUS_BENCH"]) / "shade" / "kernels.c"
    return shading(args, HERE, scalar_library(folder, source))


def second(args, folder, name="unseen"):
    source = HERE / name / "kernels.c"
    return shading(args, source.parent, scalar_library(folder, source), scalar_library(folder, source, "poly", "-DPOLY"))


def third(args, folder):
    return second(args, folder, "third")


def shading(args, kernels, *libraries):
    flags = pathlib.Path("/proc/cpuinfo").read_text()
    ways = [w for w, flag in (("@native", ""), ("@avx512/16", "avx512f"), ("@avx512/32", "avx512f"),
                              ("@avx512/64", "avx512f"), ("@avx2", "avx2"), ("@sse2", "")) if flag in flags]
    out = run(args.build / "tests/bench-shade", kernels, *libraries, *ways)
    rows, best = {}, {}
    for line in out.splitlines():
        words = line.split()
        if line.startswith("geometric mean of"):
            best[words[3].rstrip(":")] = float(words[4][1:])
        else:
            rows.setdefault(words[0], {})[words[1]] = {"Mpixel/s": float(words[2]), "times scalar C": float(words[4][1:])}
    rows["geometric mean"] = {w: {"times scalar C": m} for w, m in best.items()}
    return {"unit": "times scalar C",
            "rows": {k: {w: v["times scalar C"] for w, v in r.items() if w != "scalar"} for k, r in rows.items()},
            "Mpixel/s": {k: {w: v["Mpixel/s"] for w, v in r.items() if "Mpixel/s" in v} for k, r in rows.items()}}


def kernels(saltus, path):
    k = json.loads(run(saltus, "bench", "--kernels", path, "--size", 512, "--json", "--quiet"))["kernels"]
    return k["value"]["ns"], k["vjp"]["ns"]


def reverse(args, folder):
    rows, gains = {}, []
    for k in range(1, 6):
        primal = None
        if "SALTUS_BENCH" in os.environ:
            exe = pathlib.Path(folder) / f"k{k}"
            run("clang-19", "-O3", "-march=native", "-ffast-math", f"-DK={k}", "-DWIDE", "-w",
                pathlib.Path(os.environ["SALTUS_BENCH"]) / "ad" / "primal.c", "-o", exe, "-lm")
            primal = lambda: float(run(exe).split()[3])
        path = HERE / f"ad_k{k}.salt"
        ours = [kernels(args.build / "bin/saltus", path) + ((primal(),) if primal else ()) +
                (kernels(args.against, path) if args.against else ()) for _ in range(args.rounds)]
        row = {"value, ns": statistics.median(o[0] for o in ours), "vjp, ns": statistics.median(o[1] for o in ours)}
        if primal:
            row["16-wide C, ns"] = statistics.median(o[2] for o in ours)
            row["gain"] = statistics.median(ENZYME[k] * o[2] / o[1] for o in ours)
            gains.append(row["gain"])
        if args.against:
            row["other / ours"] = statistics.median(o[-1] / o[1] for o in ours)
        rows[f"k{k}"] = row
    if gains:
        rows["geometric mean"] = {"gain": math.exp(statistics.fmean(map(math.log, gains)))}
    return {"unit": "ns a sample", "rows": rows}


def told(unit, command, *needs):
    """A table that is another program's, as it prints it. `command` is made of args."""
    def table(args, folder):
        missing = [n for n in needs if n not in os.environ]
        return {"left out": f"{missing[0]} is not set"} if missing else {"unit": unit, "text": run(*command(args))}
    return table


def script(name, *more):
    """One of this folder, of our saltus."""
    return lambda args: (sys.executable, HERE / name, args.build / "bin/saltus", *more)


def bench(name, *more):
    return lambda args: (args.build / "tests" / name, *more)


def spot():
    return pathlib.Path(os.environ.get("SALTUS_DATA", "")) / "spot.obj"


def images(args, folder):
    rows = {}
    binaries = [args.build / "bin/saltus"] + ([args.against] if args.against else [])
    for name, file in IMAGES.items():
        path, target = EXAMPLES / file, pathlib.Path(folder) / f"{name}.exr"
        run(binaries[0], "render", path, "--size", 512, "--spp", 4, "--seed", 7, "-o", target, "--quiet")
        common = (path, "--size", 512, "--spp", 16, "--threads", 1, "--quiet")
        row = {}
        for verb, more in (("render", ()), ("grad", ("--target", target, "--estimator", "lattice", "--interior", "samples"))):
            t, ratio = interleaved(args.rounds, [lambda b=b: processor_seconds(b, verb, *common, *more) for b in binaries])
            row[f"{verb}, ms"] = 1e3 * t[0]
            if ratio:
                row[f"{verb}, other / ours"] = ratio
        rows[name] = row
    return {"unit": "ms", "rows": rows}


TABLES = {"forward": (forward, True, ["bench-shade"]), "second": (second, False, ["bench-shade"]),
          "third": (third, False, ["bench-shade"]),
          "reverse": (reverse, False, []),
          "samples": (told("ns a sample", bench("bench-samples")), False, ["bench-samples"]), "images": (images, False, []),
          "fits": (told("an iteration", script("many_discs.py", "200", "2000", "20000", "--threads", "1")), False, []),
          "starts": (told("ms a process", script("start.py", "--rounds", "5")), False, []),
          "fields": (told("beside Embree", bench("bench-field"), "SALTUS_DATA"), False, ["bench-field"]),
          "rays": (told("beside Embree", bench("bench-mesh"), "SALTUS_DATA"), False, ["bench-mesh"]),
          "pieces": (told("ns a pixel", lambda args: (args.build / "tests/bench-pieces", spot()), "SALTUS_DATA"), False,
                     ["bench-pieces"])}


def print_table(name, t):
    print(f"\n{name}" + (f" ({t['unit']})" if "unit" in t else ""))
    if "rows" not in t:
        print(t.get("text") or f"  left out: {t['left out']}")
        return
    columns = list(dict.fromkeys(c for r in t["rows"].values() for c in r))
    print("  " + " " * 16 + "".join(f"{c:>22}" for c in columns))
    for row, cells in t["rows"].items():
        print(f"  {row:16}" + "".join(f"{cells[c]:22.3g}" if c in cells else " " * 22 for c in columns))


def svg(tables):
    """Bars of the ratios, on a logarithmic scale."""
    bars = []
    for name, t in tables.items():
        for row, cells in t.get("rows", {}).items():
            for column, v in cells.items():
                if t["unit"].startswith("times") or column == "gain" or "other" in column:
                    bars.append((f"{name}: {row}, {column}", v))
    if not bars:
        return None
    most = max(v for _, v in bars)
    left, across, high = 360, 480, 16
    x = lambda v: left + across * max(0.0, math.log(v) / math.log(max(most, 2)))
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{left + across + 60}" height="{high * len(bars) + 16}" '
           'font-family="sans-serif" font-size="11"><rect width="100%" height="100%" fill="white"/>']
    for i, (label, v) in enumerate(bars):
        y = 8 + i * high
        out.append(f'<text x="{left - 6}" y="{y + 11}" text-anchor="end">{label}</text>'
                   f'<rect x="{left}" y="{y + 2}" width="{x(v) - left:.1f}" height="{high - 4}" fill="#4477aa"/>'
                   f'<text x="{x(v) + 4:.1f}" y="{y + 11}">{v:.3g}</text>')
    return "\n".join(out + ["</svg>\n"])


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("build", type=pathlib.Path)
    p.add_argument("-o", dest="out", type=pathlib.Path, help="a folder for tables.json and tables.svg")
    p.add_argument("--only", default=",".join(TABLES), help="which tables, by comma")
    p.add_argument("--rounds", type=int, default=5)
    p.add_argument("--against", type=pathlib.Path, help="another saltus, run in turn")
    args = p.parse_args()
    wanted = args.only.split(",")
    for w in wanted:
        if w not in TABLES:
            p.error(f"there is no table {w}: {', '.join(TABLES)}")
    targets = ["saltus-cli"] + [t for w in wanted for t in TABLES[w][2]]
    run("cmake", "--build", args.build, "--target", *targets)
    tables = {}
    with tempfile.TemporaryDirectory() as folder:
        for w in wanted:
            make, needs, _ = TABLES[w]
            if needs and "SALTUS_BENCH" not in os.environ:
                tables[w] = {"left out": "SALTUS_BENCH is not set"}
            else:
                tables[w] = make(args, folder)
            print_table(w, tables[w])
            sys.stdout.flush()
    if args.out:
        args.out.mkdir(parents=True, exist_ok=True)
        (args.out / "tables.json").write_text(json.dumps(tables, indent=1) + "\n")
        picture = svg(tables)
        if picture:
            (args.out / "tables.svg").write_text(picture)


main()
