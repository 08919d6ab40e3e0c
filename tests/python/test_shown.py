"""What a notebook shows without another package: curves as SVG, pictures side by side."""
import os
import pathlib
import re
import sys
import tempfile
import unittest
import xml.etree.ElementTree as xml

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "bindings/python"))
try:
    import numpy as np
    import saltus
except ImportError as error:
    if "numpy" not in str(error):
        raise
    print(f"skipped: {error}")
    sys.exit(0)


def paths(plot):
    """Of each curve its points, in pixels."""
    root = xml.fromstring(plot.svg)
    return [[tuple(map(float, p.split())) for p in re.findall(r"[ML]([^ML]+)", e.get("d"))]
            for e in root.iter("{http://www.w3.org/2000/svg}path") if e.get("stroke-width")]


class Case(unittest.TestCase):
    pass


class Plots(Case):
    def test_points_lie_in_proportion(self):
        (line,), (other,) = paths(saltus.plot({"a": ([0, 1, 4], [0.0, 1.0, 2.0])})), paths(saltus.plot({"a": [1, 100, 1e4]}, log=True))
        x, y = zip(*line)
        self.assertAlmostEqual((x[1] - x[0]) * 4, x[2] - x[0], delta=0.5)
        self.assertAlmostEqual((y[1] - y[0]) * 2, y[2] - y[0], delta=0.3)
        self.assertLess(y[2], y[0])  # upwards
        y = [p[1] for p in other]
        self.assertAlmostEqual((y[1] - y[0]) * 2, y[2] - y[0], delta=0.3)

    def test_words_and_files(self):
        plot = saltus.plot({"adam": [1, 2], "sgd": [2, 1]})
        self.assertEqual(repr(plot), "<saltus.Plot of adam, sgd>")
        with self.assertRaisesRegex(saltus.OutputError, "cannot write"):
            plot.save("/no/where.svg")

    def test_what_cannot_be_drawn_breaks_the_line(self):
        plot = saltus.plot({"a": [1.0, 2.0, np.nan, -1.0, 3.0, 4.0]}, log=True)
        self.assertEqual(len(paths(plot)[0]), 4)
        self.assertEqual(len(re.findall("M", re.search('d="([^"]*)" fill="none" stroke="#3465a4"', plot.svg)[1])), 2)

    def test_flat_curves_and_single_points(self):
        for ys in ([1.0, 1.0], [0.0], [0.0, 0.0, 0.0]):
            for _, y in paths(saltus.plot({"": ys}))[0]:
                self.assertTrue(10 < y < 178)

    def test_names_are_text(self):
        self.assertIn("a &lt;b&gt; &amp; c", saltus.plot({"a <b> & c": [1, 2]}).svg)

    def test_nothing_to_draw(self):
        for curves, log in (({}, False), ({"a": []}, False), ({"a": [np.nan]}, False), ({"a": [-1.0, 0.0]}, True)):
            with self.assertRaisesRegex(saltus.UsageError, "nothing to draw"):
                saltus.plot(curves, log=log)
        with self.assertRaisesRegex(saltus.UsageError, "two rows of one length"):
            saltus.plot({"a": ([1, 2], [1, 2, 3])})

    def test_a_file_of_it(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "a.svg")
            plot = saltus.plot({"a": [1, 2]})
            plot.save(path)
            with open(path, encoding="utf-8") as file:
                self.assertEqual(file.read(), plot.svg)

    def test_a_fit_shows_its_losses(self):
        result = saltus.FitResult(1.0, 0.5, np.array([1.0, 0.7, 0.5]), 3, "iters", "", 0.1)
        self.assertEqual(len(paths(saltus.Plot(result._repr_svg_()))[0]), 3)
        self.assertIsNone(saltus.FitResult(0.0, 0.0, np.zeros(3), 3, "iters", "", 0.1)._repr_svg_())
        self.assertNotIn("array", repr(result))


class Strips(Case):
    def test_side_by_side(self):
        grey, colour = np.zeros((4, 5)), np.full((4, 2, 3), 0.5)
        strip = saltus.strip([grey, colour], gap=1)
        self.assertEqual((type(strip), strip.dtype, strip.shape), (saltus.Image, np.float32, (4, 8, 3)))
        np.testing.assert_array_equal(strip[0, :, 1], [0, 0, 0, 0, 0, 1, 0.5, 0.5])
        self.assertEqual(strip._repr_png_()[:4], b"\x89PNG")

    def test_signed_stays_signed(self):
        image = np.ones((2, 6, 1), np.float32).view(saltus.Image)
        image.signed = True
        strip = saltus.strip([image, image], gap=2)
        self.assertTrue(strip.signed)
        np.testing.assert_array_equal(strip[0, 5:9, 0], [1, 0, 0, 1])
        with self.assertRaisesRegex(saltus.UsageError, "one kind"):
            saltus.strip([image, np.ones((2, 6))])

    def test_what_does_not_fit(self):
        for images, said in (([], "one or more"), ([np.zeros((2, 2, 7))], "one or more"), ([np.zeros((9, 9)), np.zeros((8, 9))], "one height"),
                             ([np.zeros((9, 9, 2)), np.zeros((9, 9, 3))], "1 or 3 channels")):
            with self.assertRaisesRegex(saltus.UsageError, said):
                saltus.strip(images)


if __name__ == "__main__":
    unittest.main()
