"""The wheel of bindings/python has the whole module, and finds the library that it is told of."""
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest
import zipfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
BUILD = pathlib.Path(os.environ["SALTUS_BUILD"])
SHADER = "shader float main(float2 x) { return x.x; }"


def has(module):
    return subprocess.run([sys.executable, "-c", f"import {module}"], stderr=subprocess.DEVNULL).returncode == 0


class Wheel(unittest.TestCase):
    def test_wheel_is_the_module(self):
        if not (has("setuptools.build_meta") and has("wheel")):
            self.skipTest("setuptools or wheel is not installed")
        with tempfile.TemporaryDirectory() as folder:
            source, unpacked = pathlib.Path(folder, "source"), pathlib.Path(folder, "unpacked")
            shutil.copytree(ROOT / "bindings/python", source, ignore=shutil.ignore_patterns("__pycache__"))
            subprocess.run([sys.executable, "-c", "import setuptools.build_meta as b; b.build_wheel('.')"], cwd=source, check=True, capture_output=True)
            wheel = next(source.glob("*.whl"))
            self.assertTrue(wheel.name.endswith("-py3-none-any.whl"), wheel.name)
            with zipfile.ZipFile(wheel) as z:
                z.extractall(unpacked)
            want = {p.name for p in (ROOT / "bindings/python/saltus").iterdir() if p.suffix in (".py", ".typed")}
            self.assertEqual({p.name for p in (unpacked / "saltus").iterdir()}, want)
            if not has("numpy"):
                self.skipTest("the wheel is whole; NumPy is not installed, so that it was not used")
            library = str(BUILD / "libsaltus.so")
            said = subprocess.run([sys.executable, "-c", f"import saltus; saltus.compile({SHADER!r}).render(8); print(saltus.__file__, saltus.library_path)"],
                                  cwd=folder, env={**os.environ, "PYTHONPATH": str(unpacked), "SALTUS_LIBRARY": library}, capture_output=True, text=True)
            self.assertEqual(said.stdout.split(), [str(unpacked / "saltus/__init__.py"), library], said.stderr)


if __name__ == "__main__":
    unittest.main()
