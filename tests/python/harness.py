"""What the tests of the Python package share: programs, a folder and a cache of their own, refusals, statistics.

Without NumPy a file says so and ends: CTest counts it as skipped."""
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest
import warnings

try:
    import numpy as np
except ImportError:
    print("skipped: %s has no NumPy" % sys.executable)
    sys.exit(0)

CACHE = tempfile.TemporaryDirectory(prefix="saltus-python-")
os.environ["XDG_CACHE_HOME"] = CACHE.name  # kernels: those of the user stay as they are

import saltus

ROOT = pathlib.Path(__file__).resolve().parents[2]
COMMAND = os.environ.get("SALTUS_COMMAND", "saltus")
HANGS = 600  # seconds after which something hangs, whatever else the machine does

CIRCLE = """
param float radius = 0.4;
param float2 centre = float2(0.1, -0.05);
param float ink = 1.0;
[Domain(-1.0, 1.0)]
shader float main(float2 x) {
    float f = 0.25;
    [Disc] if (length(x - centre) < radius) f = ink;
    return f;
}
"""
DISCS = """
const int N = 4;
struct Disc { float2 centre; float radius; float3 ink; };
Disc place(int i) {
    Disc d = { float2(0.2 + 0.15 * float(i), 0.3 + 0.1 * float(i)), 0.15, float3(0.2 * float(i), 0.5, 0.8) };
    return d;
}
param Disc discs[N] = init(place);
[Range(0.0, 1.0)] param float3 paper = float3(0.8, 0.8, 0.7);
[NoDiff] param float light = 1.0;
shader float3 main(float2 x) {
    float3 c = paper;
    for (int i = 0; i < N; i++) {
        [Disc] if (length(x - discs[i].centre) < discs[i].radius) c = discs[i].ink;
    }
    return light * c;
}
"""
CURVE = """
param float edge = 0.3;
param float slope = 2.0;
shader float2 main(float x) {
    float f = slope * x;
    [Disc] if (x < edge) f = 1.0;
    return float2(f, x);
}
"""
VOLUME = """
param float wall = 0.4;
shader float2 main(float3 x) {
    float f = x.z;
    [Disc] if (x.x < wall) f = 1.0;
    return float2(f, x.y);
}
"""
BOWL = """
param float a = 0.1;
[Range(0.0, 0.6)] param float b = 0.2;
shader float main(float2 x) { return (a - 0.75) * (a - 0.75) + (b - 0.9) * (b - 0.9) + 0.0 * x.x; }
"""
NOISE = """
param float level = 0.5;
shader float main(float2 x) {
    float f = 0.0;
    [Disc] if (rand() < level * x.x) f = 1.0;
    return f;
}
"""


class Case(unittest.TestCase):
    """Warnings are errors: a test that expects one says so."""

    def setUp(self):
        self.dir = tempfile.mkdtemp(prefix="saltus-python-")
        self.addCleanup(shutil.rmtree, self.dir, ignore_errors=True)
        quiet = warnings.catch_warnings()
        quiet.__enter__()
        self.addCleanup(quiet.__exit__, None, None, None)
        warnings.simplefilter("error", saltus.SaltusWarning)

    def path(self, name):
        return os.path.join(self.dir, name)

    def put(self, name, text):
        with open(self.path(name), "w", encoding="utf-8") as file:
            file.write(text)
        return self.path(name)

    def command(self, *arguments):
        """The command's result as JSON."""
        done = subprocess.run([COMMAND, *map(str, arguments), "--json"], cwd=self.dir, capture_output=True, text=True, timeout=HANGS)
        self.assertEqual(done.returncode, 0, done.stderr)
        return json.loads(done.stdout)

    def refused(self, said, function, *arguments, kind=saltus.UsageError, **more):
        """It raises `kind`, whose text has `said` in it."""
        with self.assertRaises(kind) as raised:
            function(*arguments, **more)
        self.assertIn(said, str(raised.exception))
        return raised.exception

    def same(self, got, expected):
        """The same numbers, to the bit."""
        np.testing.assert_array_equal(np.asarray(got), np.asarray(expected))

    def python(self, text, *flags, env=None, code=0):
        """Another Python, in the test's folder; what it printed."""
        done = subprocess.run([sys.executable, *flags, "-c", text], cwd=self.dir, capture_output=True, text=True, timeout=HANGS,
                              env={**os.environ, **(env or {})})
        self.assertEqual(done.returncode, code, done.stdout + done.stderr)
        return done.stdout + done.stderr


def z_score(values, truth):
    """How many standard errors the mean over the first axis is off, the largest of all."""
    values = np.asarray(values, float)
    error = values.std(0, ddof=1) / np.sqrt(len(values))
    return np.abs((values.mean(0) - truth) / np.maximum(error, 1e-12)).max()


def main():
    unittest.main(module="__main__")
