"""docs/notebooks are the pages of examples/notebooks. The standard library is enough."""
import base64
import importlib.util
import json
import pathlib
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
spec = importlib.util.spec_from_file_location("render", ROOT / "examples/notebooks/render.py")
render = importlib.util.module_from_spec(spec)
spec.loader.exec_module(render)
NOTEBOOKS = sorted(render.HERE.glob("*.ipynb"))


class Case(unittest.TestCase):
    pass


class Pages(Case):
    def test_are_those_of_the_notebooks(self):
        made = render.pages()
        there = {p.name: p.read_bytes() for p in render.PAGES.iterdir()}
        self.assertEqual(sorted(made), sorted(there), "run examples/notebooks/render.py")
        for name in made:
            self.assertTrue(made[name] == there[name], f"docs/notebooks/{name} is not that of its notebook: run examples/notebooks/render.py")
        self.assertGreater(len(made), 2 * len(NOTEBOOKS))

    def test_pictures_are_small(self):
        for path in NOTEBOOKS:
            for cell in json.loads(path.read_text("utf-8"))["cells"]:
                for output in cell.get("outputs", []):
                    png = output.get("data", {}).get("image/png")
                    if png:
                        self.assertLess(len(base64.b64decode(render.joined(png))), 60 << 10)


if __name__ == "__main__":
    unittest.main()
