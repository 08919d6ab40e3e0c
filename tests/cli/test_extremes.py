"""Stiff and extreme programs with known answers (extremes.py, docs/extremes.md): no derivative of a finite value is NaN, no run
fails, and what is off by more than it states is warned of, or on the page's list."""
import math
import os

import extremes
from harness import *

ROWS = extremes.rows()
ROUNDED = ("scale of g", "cancellation", "denormals", "domains")  # where f32 is a matter of its own; else the default alone stands for it


class Extremes(Case):
    def rows(self, *kinds):
        known = {row.kind for row in ROWS}
        self.assertTrue(set(kinds) <= known, kinds)
        for row in ROWS:
            for e, p in extremes.WAYS:
                if row.kind not in kinds or p not in row.precisions or p == "f32" and e != "auto" and row.kind not in ROUNDED:
                    continue
                with self.subTest(kind=row.kind, name=row.name, estimator=e, precision=p):
                    t = extremes.run(BIN, self.dir, row, e, p, env=self.environment())
                    self.assertIn(t.verdict, ("holds", "wide", "warned", "refused") + (("silent",) if row.is_known(e, p) else ()), "%g +- %g, said %s" % (t.off, t.bar, t.said))
                    if t.verdict == "refused":
                        continue
                    finite = all(v is not None and math.isfinite(v) for v in t.json["integral"])
                    for name in t.json["gradient"]:
                        if finite and t.json["gradient"][name] is None:
                            self.fail("the derivative by %s is NaN, of a finite value" % name)
                        if t.json["stderr"][name] is None:
                            self.assertIn("nonfinite", t.said)

    def test_scale(self):
        self.rows("scale of g", "domains")

    def test_slopes(self):
        self.rows("zero gradient on the zero set", "flat on one side")

    def test_touching(self):
        self.rows("tangent boundaries", "cusps and crossings")

    def test_coinciding(self):
        self.rows("coincident boundaries")

    def test_small(self):
        self.rows("features of 1e-6", "denormals")

    def test_stiff(self):
        self.rows("10^5 iterations", "exp-stiff interiors")

    def test_rounding(self):
        self.rows("cancellation")

    def test_wild(self):
        self.rows("infinities and NaN", "shapes that vanish or leave")


class Page(Case):
    def test_rows(self):
        """The page has every program, and no more."""
        with open(extremes.PAGE) as f:
            text = f.read()
        for row in ROWS:
            self.assertIn("| %s |" % extremes.title(row), text)
        titles = [line for line in text.splitlines() if line.startswith("| ") and " ± " in line]
        self.assertEqual(len(titles), len(ROWS))


if __name__ == "__main__":
    unittest.main()
