#!/usr/bin/env python3
"""Fits of many opaque discs under a [Cull] painter's loop: what an iteration costs.

    tests/bench/many_discs.py build/bin/saltus [N ...] [--threads T] [--rounds R]

For 200, 2000, 20 000 and 200 000 discs, or those of N: processor and wall time of an iteration, the difference between a longer and a shorter fit, the least of R rounds (default 3), and the largest memory of the process.
The target is a render of the same discs from other samples. Discs are as much smaller as they are more, so that about as many lie over a point."""
import argparse
import os
import subprocess
import sys
import tempfile
import time

# discs, pixels a side, least and greatest radius, iterations of the shorter and of the longer fit
SIZES = [(200, 256, .02, .08, 5, 45), (2000, 256, .005, .02, 5, 35), (20000, 1024, .00158, .00632, 1, 5), (200000, 1024, .0005, .002, 1, 3)]
SHADER = """struct Disc { float2 centre; float radius; float3 ink; };
const int N = %d;
Disc make(int i) {
    Disc d = { rand2(), %g + %g * rand(), rand3() };
    return d;
}
param Disc discs[N] = init(make);
float4 extent(int i) { return float4(discs[i].centre - discs[i].radius, discs[i].centre + discs[i].radius); }
shader float3 main(float2 x) {
    float3 c = float3(1.0);
    [Cull(extent)] for (int i = 0; i < N; i++) {
        [Disc] if (length(x - discs[i].centre) < discs[i].radius) c = discs[i].ink;
    }
    return c;
}
"""


def run(arguments):
    """Processor seconds, wall seconds, largest memory in MB."""
    start = time.monotonic()
    process = subprocess.Popen(arguments, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        sys.exit("failed: " + " ".join(arguments))
    return usage.ru_utime + usage.ru_stime, time.monotonic() - start, usage.ru_maxrss / 1024


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("saltus")
    parser.add_argument("discs", nargs="*", type=int)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    print("| discs | pixels | processor, ms | wall, ms | MB |\n|---|---|---|---|---|")
    for discs, side, least, most, short, long in SIZES:
        if options.discs and discs not in options.discs:
            continue
        with tempfile.TemporaryDirectory() as folder:
            shader, target = os.path.join(folder, "discs.salt"), os.path.join(folder, "target.exr")
            with open(shader, "w") as file:
                file.write(SHADER % (discs, least, most - least))
            run([options.saltus, "render", shader, "--size", str(side), "--spp", "16", "--seed", "7", "-o", target])
            fit = [options.saltus, "fit", shader, "--size", str(side), "--spp", "4", "--target", target, "--estimator", "lattice"]
            fit += ["--threads", str(options.threads), "-o", os.path.join(folder, "out"), "--iters"]
            rounds = [(run(fit + [str(short)]), run(fit + [str(long)])) for _ in range(options.rounds)]
        cost = [min(b[k] - a[k] for a, b in rounds) / (long - short) * 1e3 for k in range(2)]
        print(f"| {discs} | {side}² | {cost[0]:.3g} | {cost[1]:.3g} | {max(b[2] for _, b in rounds):.0f} |", flush=True)


if __name__ == "__main__":
    main()
