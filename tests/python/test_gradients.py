"""Derivatives: forward is the transpose of reverse, closed forms, and means over seeds within their standard errors."""
from harness import *

SEEDS = 100
BOUND = 4.5  # standard errors, of the largest of at most ten numbers: one run in 15 000 is beyond, and the seeds are fixed
AREA = 4.0  # of the domain of CIRCLE


def dot(gradient, direction):
    """The sum over everything that the direction names of gradient * direction."""
    total = 0.0
    for name, value in direction.items():
        total += dot(gradient[name], value) if isinstance(value, dict) else float((np.asarray(gradient[name]) * value).sum())
    return total


class Transpose(Case):
    """<a, J v> = <J^T a, v>, with the same samples on both sides."""

    def assert_transposed(self, p, shape, direction, **options):
        a = np.random.default_rng(7).normal(size=shape).astype(np.float32)
        size = tuple(reversed(shape[:-1]))
        left = float((a * p.jvp(direction, size, spp=4, seed=2, **options).astype(np.float64)).sum())
        right = dot(p.vjp(a, spp=4, seed=2, wrt=tuple(direction), **options), direction)
        self.assertNotEqual(left, 0)
        self.assertAlmostEqual(left / right, 1, delta=2e-4)

    def test_discs(self):
        p = saltus.compile(DISCS)
        random = np.random.default_rng(3)
        direction = {"discs": {"centre": random.normal(size=(4, 2)), "radius": random.normal(size=4), "ink": random.normal(size=(4, 3))}, "paper": random.normal(size=3)}
        for estimator in ("lattice", "scanline", "quadrature"):
            self.assert_transposed(p, (24, 20, 3), direction, estimator=estimator)
        self.assert_transposed(p, (24, 20, 3), direction, filter="gaussian", estimator="lattice")

    def test_one_part(self):
        self.assert_transposed(saltus.compile(DISCS), (24, 20, 3), {"discs[2].centre": np.array([1.0, -2.0])}, estimator="lattice")

    def test_curve_and_volume(self):
        self.assert_transposed(saltus.compile(CURVE), (40, 2), {"edge": np.array(1.0), "slope": np.array(0.5)}, estimator="lattice")
        self.assert_transposed(saltus.compile(VOLUME), (6, 7, 8, 2), {"wall": np.array(1.0)}, estimator="lattice")

    def test_double(self):
        self.assert_transposed(saltus.compile(CIRCLE, precision="f64"), (24, 20, 1), {"radius": np.array(1.0), "centre": np.array([1.0, 0.5])}, estimator="lattice")

    def test_images_are_rows(self):
        """A directional derivative is the sum of derivative images, and these of the whole are the parts."""
        p = saltus.compile(CIRCLE)
        options = {"estimator": "lattice", "seed": 4}
        rows = p.grad_images(["centre", "radius"], 16, **options)
        together = p.jvp({"centre": [2, -1], "radius": 3}, 16, **options)
        np.testing.assert_allclose(2 * rows["centre"][0] - rows["centre"][1] + 3 * rows["radius"], together, rtol=1e-4, atol=1e-4)


class ClosedForms(Case):
    def test_circle(self):
        p = saltus.compile(CIRCLE)
        for options in ({"exact": True}, {"estimator": "auto", "error": 1e-5}):
            r = p.integral(**options)
            np.testing.assert_allclose(r.value, 0.25 * AREA + 0.75 * np.pi * 0.16, rtol=1e-4)
            np.testing.assert_allclose(r.gradient["radius"], 0.75 * 2 * np.pi * 0.4, rtol=1e-4)
            np.testing.assert_allclose(r.gradient["ink"], np.pi * 0.16, rtol=1e-4)
            np.testing.assert_allclose(r.gradient["centre"], 0, atol=1e-4)
            np.testing.assert_allclose(r.interior["ink"], r.gradient["ink"], rtol=1e-6)
            np.testing.assert_allclose(r.boundary["radius"], r.gradient["radius"], rtol=1e-6)
            self.assertEqual(r.certified, 1)

    def test_stated_errors(self):
        """What is stated with few samples covers what is true."""
        p = saltus.compile(CIRCLE)
        r = p.integral(1 << 12, estimator="lattice")
        self.assertLess(abs(r.gradient["radius"][0] - 0.6 * np.pi), 6 * r.stderr["radius"][0])
        self.assertLess(abs(r.value[0] - 1 - 0.12 * np.pi), 6 * r.value_stderr[0])
        g = p.vjp(np.ones((16, 16, 1)), estimator="lattice", stderr=True)
        self.assertLess(abs(g["radius"] - 0.6 * np.pi * 64), 6 * g.stderr["radius"])

    def test_image_of_derivatives(self):
        """Summed over its pixels it is the derivative of the integral."""
        image = saltus.compile(CIRCLE).jvp({"radius": 1}, 32, exact=True)
        self.assertAlmostEqual(float(image.sum()) * AREA / 32 ** 2, 0.6 * np.pi, delta=1e-3)
        self.assertEqual(float(image[0, 0, 0]), 0)


class OverSeeds(Case):
    """Means of many seeds: no bias that the standard errors do not explain."""

    def test_vjp(self):
        p, adjoint = saltus.compile(CIRCLE), np.ones((16, 16, 1))
        truth = np.array([0.6 * np.pi, 0, 0, 0.16 * np.pi]) * 16 ** 2 / AREA
        for estimator in ("lattice", "scanline"):
            found = [p.vjp(adjoint, spp=2, seed=s, estimator=estimator).vector for s in range(SEEDS)]
            self.assertLess(z_score(found, truth), BOUND, estimator)

    def test_weighed_vjp(self):
        """Each pixel's derivative goes where its weight is: against exact derivative images."""
        p = saltus.compile(CIRCLE)
        adjoint = np.random.default_rng(1).normal(size=(12, 12, 1))
        exact = p.grad_images(size=12, exact=True, spp=64)
        truth = [float((adjoint * exact["radius"]).sum()), *(float((adjoint * row).sum()) for row in exact["centre"]), float((adjoint * exact["ink"]).sum())]
        found = [p.vjp(adjoint, spp=2, seed=s, estimator="lattice").vector for s in range(SEEDS)]
        self.assertLess(z_score(found, truth), BOUND)

    def test_loss(self):
        p = saltus.compile(CIRCLE)
        target = np.random.default_rng(2).random((12, 12, 1))
        image, exact = p.render(12, spp=4096), p.grad_images(size=12, exact=True, spp=64)
        slope = 2 * (image - target) / image.size
        truth = [float((slope * exact["radius"]).sum()), *(float((slope * row).sum()) for row in exact["centre"]), float((slope * exact["ink"]).sum())]
        found = [p.loss(target, spp=2, seed=s, estimator="lattice")[1].vector for s in range(SEEDS)]
        self.assertLess(z_score(found, truth), BOUND)

    def test_own_chain(self):
        """The same by hand, image and derivative of different seeds; of one seed it is biased, as the page says."""
        p = saltus.compile(CIRCLE)
        target = np.random.default_rng(2).random((12, 12, 1))
        image, exact = p.render(12, spp=4096), p.grad_images("ink", size=12, exact=True, spp=64)
        truth = float((2 * (image - target) / image.size * exact["ink"]).sum())

        def chained(seed, other):
            return p.vjp(2 * (p.render(12, spp=1, seed=seed) - target) / image.size, spp=1, seed=other, estimator="lattice")["ink"]
        apart, together = ([float(chained(2 * s, 2 * s + k)) for s in range(SEEDS)] for k in (1, 0))
        self.assertLess(z_score(apart, truth), BOUND)
        self.assertGreater(z_score(together, truth), BOUND)

    def test_integral(self):
        p = saltus.compile(CIRCLE)
        truth = np.array([0.6 * np.pi, 0, 0, 0.16 * np.pi])
        found = [p.integral(256, seed=s, estimator="lattice").gradient.vector[0] for s in range(SEEDS)]
        self.assertLess(z_score(found, truth), BOUND)


if __name__ == "__main__":
    main()
