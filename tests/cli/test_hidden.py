"""What is hidden is found, by what runs where nothing is asked for: hidden.py, whose 300 scenes are too many for every run."""
import tempfile

import hidden
from harness import *


class Hidden(Case):
    def count(self, scenes, *options):
        with tempfile.TemporaryDirectory() as folder:
            for n in scenes:
                s, j, is_ = hidden.measure(BIN, n, folder, list(options))
                with self.subTest(s.kind, n=n):
                    self.assertNotEqual(is_, "missed", (j["gradient"], j["stderr"], s.want))

    def test_plane(self):
        """One of each feature, each written in another way; a ring of 1e-6 costs `auto` less than the lattice does."""
        self.count(range(0, 243, 30))

    def test_line(self):
        """Two of each kind: crests of a cosine, of which a root lies nearer to the next than the cosine is exact, among them."""
        self.count(range(253, 263))
        self.count((258, 263), "--estimator", "quadrature")


if __name__ == "__main__":
    unittest.main()
