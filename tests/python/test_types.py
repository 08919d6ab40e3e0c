"""Type hints: mypy finds nothing in the package, nor in a script that uses what docs/python.md shows. Skipped without mypy."""
import importlib.util

from harness import *

SCRIPT = """
import numpy as np
import saltus


def callback(at: saltus.Iteration) -> bool:
    return at.loss < 1e-4


p = saltus.compile("disc.salt", set={"N": 3}, params={"radius": 0.3}, size=64)
p.wrt = ["radius", "centre.x"]
p.wrt = "radius"
p.wrt = None
p["radius"] = 0.3
p["discs"].opacity[:] = 0.7
image = p.render((64, 64), spp=4, seed=2)
image.save("a.png")
saltus.strip([image, saltus.read_image("b.png", (64, 64))]).save("c.png")
g = p.vjp(2 * (image - image) / image.size, stderr=True)
value, gradient = p.loss("a.png")
result = p.fit(image, wrt="radius", lr={"radius": 0.02}, callback=callback, progress=False, spp=8)
saltus.plot({"loss": result.losses}, log=True).save("d.svg")
print(value + result.loss, result.stopped.upper(), gradient.vector.sum(), float(g["radius"]), p.stats.crossings, p.integral().certified)
"""


class Types(Case):
    def test_package_and_script(self):
        if not importlib.util.find_spec("mypy"):
            self.skipTest("there is no mypy")
        others = "".join(f"[mypy-{name}.*]\nfollow_imports = skip\nignore_errors = True\n" for name in ("numpy", "torch", "jax"))
        self.put("mypy.ini", f"[mypy]\nignore_missing_imports = True\n[mypy-user]\ndisallow_untyped_calls = True\n{others}")
        user = self.put("user.py", SCRIPT)
        done = subprocess.run([sys.executable, "-m", "mypy", "--config-file", self.path("mypy.ini"), "--cache-dir", os.devnull, user,
                               *map(str, sorted((ROOT / "bindings/python/saltus").glob("*.py")))], capture_output=True, text=True,
                              env={**os.environ, "MYPYPATH": str(ROOT / "bindings/python")}, cwd=self.path("."))
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)


if __name__ == "__main__":
    main()
