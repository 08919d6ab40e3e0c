#!/usr/bin/env python3
"""What a call from Python costs beyond the call of the library: render and vjp of 16 x 16 pixels, 1 sample each, 1 thread.

    PYTHONPATH=bindings/python tests/bench/python.py [ROUNDS]

The library's own time is that of the same call by ctypes with everything prepared, less what an empty call by ctypes takes.
Rounds alternate, and the least of each counts; so does the slider: a parameter set, then an image."""
import ctypes
import sys
import time

import numpy as np
import saltus
from saltus import _abi, _job, _library

SOURCE = """
param float radius = 0.4;
[Domain(-1.0, 1.0)]
shader float3 main(float2 x) {
    float3 f = float3(0.25);
    [Disc] if (length(x) < radius) f = float3(1.0);
    return f;
}
"""
SIDE, CALLS = 16, 200


def least(rounds, functions):
    """Microseconds a call of each, the least over the rounds."""
    best = [float("inf")] * len(functions)
    for _ in range(rounds):
        for i, function in enumerate(functions):
            start = time.perf_counter()
            for _ in range(CALLS):
                function()
            best[i] = min(best[i], (time.perf_counter() - start) / CALLS * 1e6)
    return best


def main():
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    p = saltus.compile(SOURCE)
    job = _job.make_job(2, SIDE, {"spp": 1, "threads": 1, "estimator": "lattice"})
    image, adjoint = np.empty((SIDE, SIDE, 3), np.float32), np.ones((SIDE, SIDE, 3), np.float32)
    gradient, stats, error = np.zeros(1), _library.initial(_abi.SltStats), _abi.SltError()
    lib, at = _library.lib, ctypes.byref
    arguments = p._handle, at(job)
    render = arguments + (image.ctypes.data, at(stats), at(error))
    reverse = arguments + (adjoint.ctypes.data, gradient.ctypes.data, None, at(stats), at(error))
    options = {"spp": 1, "threads": 1, "estimator": "lattice"}

    def slide():
        p["radius"] = 0.3
        p.render(SIDE, out=image, **options)
    empty, c_render, py_render, c_vjp, py_vjp, slider = least(rounds, [
        lambda: lib.slt_dim(p._handle), lambda: lib.slt_render(*render), lambda: p.render(SIDE, **options),
        lambda: lib.slt_grad_adjoint(*reverse), lambda: p.vjp(adjoint, **options), slide])
    print("microseconds       library   Python   beyond")
    for name, inner, outer in (("render", c_render, py_render), ("vjp", c_vjp, py_vjp), ("set and render", c_render, slider)):
        print(f"{name:18s} {inner - empty:7.1f}  {outer:7.1f}  {outer - inner + empty:7.1f}")


if __name__ == "__main__":
    main()
