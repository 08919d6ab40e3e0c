"""Every shader of examples and tests/programs by quadrature, few samples: for the sanitizers, which the tests of values see little of."""
import glob

from harness import *

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")


class Quadrature(Case):
    def test_each(self):
        shaders = [p for pattern in ("examples/*/*.salt", "examples/*/*.frag", "tests/programs/*.salt") for p in glob.glob(os.path.join(ROOT, pattern))]
        self.assertGreater(len(shaders), 30)
        for path in sorted(shaders):
            with self.subTest(os.path.relpath(path, ROOT)):
                self.integrate(path, "--samples", 500, "--segments", 200)
                if "shadow_art" in path:
                    self.integrate(path, "--samples", 3000, "--segments", 50, "--disc", "auto")
                if "/programs/" in path:
                    self.integrate(path, "--samples", 3000, "--segments", 50, "--interior", "quadrature")

    def integrate(self, path, *options):
        r = self.run_cli("grad", os.path.abspath(path), "--integral", "--json", "--estimator", "quadrature", *options, code=None)
        if not re.search("E0213|E0215", r.err):  # no entry point, or several
            self.assertEqual(r.code, 0, r.err[-2000:])


if __name__ == "__main__":
    unittest.main()
