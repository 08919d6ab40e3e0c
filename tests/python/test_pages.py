"""Every ```python block of README.md and docs/python.md runs, those of a page one after another in one folder, and prints what
the ```text block below it shows. BLESS=1 writes these anew."""
import contextlib
import io
import os
import pathlib
import re
import shutil
import sys
import tempfile
import traceback
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
BLOCK = re.compile(r"^```python\n(.*?)^```\n(?:\n?^```text\n(.*?)^```\n)?", re.S | re.M)
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?")
sys.path.insert(0, str(ROOT / "bindings/python"))
os.environ.setdefault("SALTUS_LIBRARY", str(ROOT / "build/libsaltus.so.0"))
os.environ.setdefault("SALTUS_COMMAND", str(ROOT / "build/bin/saltus"))
try:
    import numpy  # noqa: F401
except ImportError:
    print("skipped: %s has no NumPy" % sys.executable)
    sys.exit(0)
try:
    import torch  # noqa: F401
except ImportError:
    torch = None


def same(shown, got):
    """Words are the same, and numbers nearly: processors differ in the last places of a sum, and fits make more of it."""
    if NUMBER.sub("#", shown).split() != NUMBER.sub("#", got).split():
        return False
    return all(abs(float(a) - float(b)) <= 2e-2 * abs(float(a)) + 1e-9 for a, b in zip(NUMBER.findall(shown), NUMBER.findall(got)))


class Case(unittest.TestCase):
    """A folder with the files that the pages name, and a cache of kernels of its own."""

    def setUp(self):
        folder = tempfile.mkdtemp(prefix="saltus-pages-")
        self.addCleanup(shutil.rmtree, folder, ignore_errors=True)
        self.addCleanup(os.chdir, os.getcwd())
        os.environ["XDG_CACHE_HOME"] = os.path.join(folder, "cache")
        for file in ("painterly_discs/discs.salt", "painterly_discs/photo.png"):
            shutil.copy(ROOT / "examples" / file, folder)
        source = re.search("```salt\n(.*?)```", (ROOT / "README.md").read_text("utf-8"), re.S)[1]
        pathlib.Path(folder, "disc.salt").write_text(source, "utf-8")
        os.chdir(folder)


class Pages(Case):
    def run_page(self, name):
        """How many blocks ran, and of how many the output was compared."""
        path = ROOT / name
        page = path.read_text("utf-8")
        names, wrong, ran, compared = {"__name__": "__main__"}, [], 0, 0

        def run(found):
            nonlocal ran, compared
            line = page.count("\n", 0, found.start()) + 2
            printed, code, shown = io.StringIO(), found[1], found[2]
            if torch is None and "torch" in code:
                return found[0]
            try:
                with contextlib.redirect_stdout(printed):
                    exec(compile("\n" * (line - 1) + code, str(path), "exec"), names)
            except Exception:
                wrong.append(f"{name}:{line}: this block fails\n{traceback.format_exc()}")
            ran += 1
            if shown is None:
                return found[0]
            compared += 1
            if not same(shown, printed.getvalue()):
                wrong.append(f"{name}:{line}: this block shows\n{shown}and prints\n{printed.getvalue()}")
            return found[0].replace(f"```text\n{shown}", f"```text\n{printed.getvalue()}")
        blessed = BLOCK.sub(run, page)
        if os.environ.get("BLESS") and wrong:
            path.write_text(blessed, "utf-8")
        if wrong:
            self.fail("\n".join(wrong))
        return ran, compared

    def test_readme(self):
        ran, _ = self.run_page("README.md")
        self.assertGreaterEqual(ran, 1)

    def test_python(self):
        ran, compared = self.run_page("docs/python.md")
        self.assertGreaterEqual(ran, 9)
        self.assertGreaterEqual(compared, 9)

    def test_options_are_in_the_table(self):
        """Every option of estimates, of fits and of compile has a row or a word on the page."""
        import ctypes
        import inspect
        import saltus
        from saltus import _abi, _fit, _job
        page = (ROOT / "docs/python.md").read_text("utf-8")
        numbers = {n for n, kind in _abi.SltFitOptions._fields_ if kind in (ctypes.c_double, ctypes.c_uint32) and not n.startswith("n")}
        numbers -= {"iterations", "first", "planned", "metric", "schedule"}
        options = {*_job.OPTIONS, *numbers, *inspect.signature(_fit.fit).parameters, *inspect.signature(saltus.compile).parameters}
        missing = [o for o in options - {"p", "options"} if f"`{o}`" not in page]
        self.assertEqual(missing, [])
        for name in saltus.__all__:
            self.assertTrue(re.search(rf"\b{name}\b", page), f"docs/python.md does not mention saltus.{name}")


if __name__ == "__main__":
    unittest.main()
