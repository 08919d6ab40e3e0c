"""The notebooks of examples/notebooks run, in copies, and show what is committed. BLESS=1 writes their outputs and pages anew:
look at every picture then."""
import importlib.util
import json
import os
import pathlib
import re
import shutil
import sys
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
FOLDER = ROOT / "examples/notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
BLESS = bool(os.environ.get("BLESS"))
HANGS = 600  # seconds after which a cell hangs, whatever else the machine does
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?")

try:
    import ipykernel  # noqa: F401
    import nbclient
    import nbformat
    import numpy  # noqa: F401
    import torch  # noqa: F401
    from jupyter_client.manager import start_new_kernel
except ImportError as error:
    print(f"skipped: {error}; ./bootstrap test installs what notebooks need")
    sys.exit(0)

spec = importlib.util.spec_from_file_location("render", FOLDER / "render.py")
render = importlib.util.module_from_spec(spec)
spec.loader.exec_module(render)


def text_of(output):
    """What an output says; None of a picture."""
    if output["output_type"] == "stream":
        return render.joined(output["text"])
    if any(kind in output["data"] for kind in render.PICTURES):
        return None
    return re.sub("<[^>]*>", " ", render.joined(output["data"].get("text/html") or output["data"]["text/plain"]))


def shown(cell):
    """Texts and pictures in their order; neighbouring texts as one, since streams are cut by chance."""
    found = []
    for output in cell["outputs"]:
        text = text_of(output)
        if text is not None and found and found[-1] is not None:
            found[-1] += text
        else:
            found.append(text)
    return found


def same(a, b):
    """Words are the same, and numbers to 5 %, or one in their last place: fits on another processor differ a little."""
    if (a is None) or (b is None):
        return a is b
    if NUMBER.sub("#", a).split() != NUMBER.sub("#", b).split():
        return False
    parts = [x.partition("e") for x in NUMBER.findall(a)]
    place = [10.0 ** (int(e or 0) - len(digits.partition(".")[2])) for digits, _, e in parts]
    return all(abs(float(x) - float(y)) <= 0.05 * abs(float(x)) + 1.01 * p for x, y, p in zip(NUMBER.findall(a), NUMBER.findall(b), place))


class Case(unittest.TestCase):
    """A copy of the examples that notebooks name, a kernel of this Python, and nobody's settings."""

    def setUp(self):
        self.dir = pathlib.Path(tempfile.mkdtemp(prefix="saltus-notebook-"))
        self.addCleanup(shutil.rmtree, self.dir, ignore_errors=True)
        self.folder = self.dir / "examples/notebooks"
        self.folder.mkdir(parents=True)
        kernel = self.dir / "jupyter/kernels/python3"
        kernel.mkdir(parents=True)
        (kernel / "kernel.json").write_text(json.dumps({
            "argv": [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"], "display_name": "Python 3", "language": "python"}))
        library = os.environ.get("SALTUS_LIBRARY") or str(ROOT / "build/libsaltus.so.0")
        here = {"JUPYTER_PATH": self.dir / "jupyter", "JUPYTER_RUNTIME_DIR": self.dir / "runtime", "JUPYTER_CONFIG_DIR": self.dir / "config",
                "JUPYTER_DATA_DIR": self.dir / "data", "IPYTHONDIR": self.dir / "ipython", "XDG_CACHE_HOME": self.dir / "cache", "SALTUS_LIBRARY": library,
                "PYTHONPATH": ROOT / "bindings/python", "PYTHONDONTWRITEBYTECODE": "1",
                "PYDEVD_DISABLE_FILE_VALIDATION": "1"}
        before = dict(os.environ)
        os.environ.update({k: str(v) for k, v in here.items()})
        self.addCleanup(lambda: (os.environ.clear(), os.environ.update(before)))

    def execute(self, notebook):
        for name in set(re.findall(r"\.\./(\w+)/", json.dumps(notebook["cells"]))):
            if (ROOT / "examples" / name).is_dir():
                shutil.copytree(ROOT / "examples" / name, self.dir / "examples" / name, dirs_exist_ok=True)
        client = nbclient.NotebookClient(notebook, timeout=HANGS, kernel_name="python3", record_timing=False, resources={"metadata": {"path": str(self.folder)}})
        client.execute()
        return notebook


def clean(notebook):
    """What is committed: the same bytes from the same outputs."""
    for cell in notebook["cells"]:
        cell["metadata"] = {}
        for output in cell.get("outputs", []):
            output.get("metadata", {}).clear()
            output.get("transient", {}).clear()
            if any(kind in output.get("data", {}) for kind in render.PICTURES):
                output["data"].pop("text/plain", None)  # an array, as text
    notebook["metadata"] = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}, "language_info": {"name": "python"}}
    return notebook


class Notebooks(Case):
    def run_one(self, path):
        committed = json.loads(path.read_text("utf-8"))
        made = self.execute(nbformat.read(path, as_version=4))
        if BLESS:
            nbformat.write(clean(made), path)
            render.write()
            committed = json.loads(path.read_text("utf-8"))
        for old, new in zip(committed["cells"], made["cells"]):
            if old["cell_type"] != "code":
                continue
            a, b = shown(old), shown(new)
            self.assertTrue(len(a) == len(b) and all(map(same, a, b)), f"{path.name}:\n{render.joined(old['source'])}\nshows {a}\nand is committed with {b}")
        data = path.read_text("utf-8")
        self.assertLess(len(data), 1 << 20)
        found = re.search("/(?:tmp|home|work|root|usr)/[^ ]*", data)
        self.assertFalse(found, f"{path.name} has a path of this machine: {found and found[0]}")


def add(path):
    def test(self):
        self.run_one(path)
    setattr(Notebooks, "test_" + re.sub(r"\W", "_", path.stem), test)


for path in NOTEBOOKS:
    add(path)


class Kernel(Case):
    """What a notebook does while a fit runs."""

    DISC = """
import numpy as np, saltus
p = saltus.compile('''param float radius = 0.3;
[Domain(-1.0, 1.0)] shader float main(float2 x) { float f = 0.0; [Disc] if (length(x) < radius) f = 1.0; return f; }''')
target = p.render(64, spp=4, params={"radius": 0.7})
"""

    def setUp(self):
        super().setUp()
        self.manager, self.client = start_new_kernel(kernel_name="python3", startup_timeout=HANGS, cwd=str(self.folder))
        self.addCleanup(self.manager.shutdown_kernel, now=True)
        self.addCleanup(self.client.stop_channels)
        self.assertEqual(self.run_cell(self.DISC)[0]["status"], "ok")

    def run_cell(self, code, seen=lambda message: None):
        """The reply to a cell, and what it sent: (kind, content); `seen` is told of each."""
        sent = []

        def hook(message):
            if message["msg_type"] not in ("status", "execute_input"):
                sent.append((message["msg_type"], message["content"]))
            seen(message)
        reply = self.client.execute_interactive(code, timeout=HANGS, output_hook=hook, stop_on_error=False)  # else cells behind an error are aborted for a while
        return reply["content"], sent

    def test_a_fit_updates_one_line(self):
        reply, sent = self.run_cell("r = p.fit(target, iters=400, lr=0.01)")
        self.assertEqual(reply["status"], "ok", reply)
        kinds = [kind for kind, _ in sent]
        self.assertEqual(kinds.count("display_data"), 1)
        self.assertGreaterEqual(kinds.count("update_display_data"), 1)
        self.assertEqual(set(kinds) - {"display_data", "update_display_data"}, set(), "a fit shows nothing else")
        self.assertEqual(len({c["transient"]["display_id"] for kind, c in sent}), 1)
        first, last = sent[0][1]["data"]["text/plain"], sent[-1][1]["data"]["text/plain"]
        self.assertRegex(first, r"^\[\.{24}\] 1/400  loss [0-9.e-]+, best [0-9.e-]+$")
        self.assertRegex(last, r"^\[#{24}\] 400/400  loss -?[0-9.e-]+, best -?[0-9.e-]+$")

    def test_progress_may_be_off(self):
        _, sent = self.run_cell("p.fit(target, iters=30, progress=False); None")
        self.assertEqual(sent, [])

    def test_interrupt_keeps_the_best(self):
        """The kernel's interrupt ends a fit that would take hours, as a KeyboardInterrupt; the program has what it found."""
        interrupted = []

        def seen(message):
            if message["msg_type"] == "update_display_data" and not interrupted:
                interrupted.append(True)
                self.manager.interrupt_kernel()
        reply, _ = self.run_cell("p['radius'] = 0.3; best = []\n"
                                 "p.fit(target, iters=10**7, lr=0.01, callback=lambda at: best.append((at.loss, float(at.params['radius']))) and None)", seen)
        self.assertTrue(interrupted)
        self.assertEqual((reply["status"], reply.get("ename")), ("error", "KeyboardInterrupt"))
        reply, sent = self.run_cell("print(len(best) > 2, float(p['radius']) in [r for _, r in best], abs(p['radius'] - 0.7) < abs(0.3 - 0.7), p.render(8).shape)")
        self.assertEqual(reply["status"], "ok", reply)
        self.assertEqual("".join(c["text"] for kind, c in sent if kind == "stream"), "True True True (8, 8, 1)\n")

    def test_interrupt_of_a_render(self):
        interrupted = []

        def seen(message):
            if message["msg_type"] == "stream" and not interrupted:
                interrupted.append(True)
                self.manager.interrupt_kernel()
        reply, _ = self.run_cell("print('begins', flush=True); p.render(4096, spp=1 << 16)", seen)
        self.assertTrue(interrupted)
        self.assertEqual((reply["status"], reply.get("ename")), ("error", "KeyboardInterrupt"))
        self.assertEqual(self.run_cell("p.render(8)")[0]["status"], "ok")


if __name__ == "__main__":
    unittest.main()
