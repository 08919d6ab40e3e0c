"""Images: arrays that stay arrays, pictures in memory and in files."""
import copy
import os
import pickle

from harness import *

PNG = b"\x89PNG\r\n\x1a\n"


class Pictures(Case):
    def setUp(self):
        super().setUp()
        self.p = saltus.compile(DISCS)
        self.image = self.p.render(9)

    def test_reductions_are_numbers(self):
        image = self.image
        for value in (image.mean(), image.sum(), image.max(), np.median(image), image[0, 0, 0], np.linalg.norm(np.asarray(image)), image.min(axis=(0, 1, 2))):
            self.assertIsInstance(value, np.floating)

    def test_slices_and_arithmetic_are_images(self):
        image = self.p.jvp({"paper": 1}, 9)
        for made in (image[2:5], image * 2, image - image, image.mean(axis=0), image.copy(), copy.copy(image), copy.deepcopy(image), pickle.loads(pickle.dumps(image))):
            self.assertIsInstance(made, saltus.Image)
        for made in (image[2:5], image.copy(), copy.deepcopy(image), pickle.loads(pickle.dumps(image))):
            self.assertEqual((made.signed, made.display), (True, False))
        self.same(pickle.loads(pickle.dumps(image)), image)

    def test_display_is_kept(self):
        image = saltus.compile("[Display] shader float3 main(float2 x) { return float3(x.x); }").render(8)
        self.assertEqual((image.display, pickle.loads(pickle.dumps(image)).display, image[:4].display), (True, True, True))
        self.assertNotEqual(image._repr_png_(), np.asarray(image).view(saltus.Image)._repr_png_())

    def test_shown(self):
        curve, volume = saltus.compile(CURVE).render(8), saltus.compile(VOLUME).render(4)
        for shown in (self.image, self.image[..., 0], curve, volume, self.image > 0.5, self.p.jvp({"paper": 1}, 9)):
            self.assertTrue(shown._repr_png_().startswith(PNG))
        self.assertIsNone(self.image[:0]._repr_png_())
        self.assertIsNone(self.image[0, 0]._repr_png_())

    def test_encoded(self):
        self.assertTrue(saltus.encode_png(np.zeros((3, 4, 1))).startswith(PNG))
        self.assertTrue(saltus.encode_png(np.zeros((3, 4, 3)) - 1, signed=True, title="d/dr", scale=2).startswith(PNG))
        self.assertTrue(saltus.encode_png(np.full((3, 4), np.nan)).startswith(PNG))
        for bad in (np.zeros((3, 4, 5)), np.zeros(3), np.zeros((0, 4, 3)), np.zeros((3, 4, 3), complex), 1.0):
            self.refused("a picture is an array", saltus.encode_png, bad)


class Files(Case):
    def test_there_and_back(self):
        pixels = np.random.default_rng(0).random((5, 7, 3)).astype(np.float32)
        for name, error in (("a.exr", 2e-3), ("a.pfm", 0), ("a.npy", 0), ("a.png", 0.01)):
            for given in (pixels, pixels.astype(np.float64), np.asfortranarray(pixels)):
                saltus.write_image(self.path(name), given)
                found = saltus.read_image(pathlib.Path(self.path(name)))
                self.assertEqual((type(found), found.dtype, found.shape), (saltus.Image, np.float32, (5, 7, 3)))
                self.assertLessEqual(np.abs(found - pixels).max(), error, name)

    def test_resized(self):
        saltus.write_image(self.path("a.npy"), np.ones((4, 6, 3)))
        for size, shape in ((3, (3, 3)), ((2, 5), (5, 2)), (np.int64(3), (3, 3)), (np.array([2, 5]), (5, 2)), (None, (4, 6))):
            self.assertEqual(saltus.read_image(self.path("a.npy"), size).shape[:2], shape)
        self.assertEqual([saltus.read_image(self.path("a.npy"), channels=c).shape[2] for c in (1, 3, 4)], [1, 3, 4])
        for said, more in (("size is from 1", {"size": -1}), ("size is one number or 2", {"size": (1, 2, 3)}), ("channels is from 1 to 4", {"channels": 7}), ("channels is from 1 to 4", {"channels": 0})):
            self.refused(said, saltus.read_image, self.path("a.npy"), **more)

    def test_display(self):
        saltus.write_image(self.path("a.png"), np.full((2, 2, 1), 0.5), display=True)
        self.assertAlmostEqual(float(saltus.read_image(self.path("a.png"), display=True)[0, 0, 0]), 0.5, delta=0.01)
        self.assertAlmostEqual(float(saltus.read_image(self.path("a.png"))[0, 0, 0]), 0.214, delta=0.01)

    def test_volumes_and_curves(self):
        """All of a volume is written, or it is refused: never one slice for the whole."""
        volume, curve = saltus.compile(VOLUME).render((3, 4, 5)), saltus.compile(CURVE).render(6)
        volume.save(self.path("v.npy"))
        curve.save(self.path("c.npy"))
        self.same(np.load(self.path("v.npy")), volume)
        self.same(np.load(self.path("c.npy")), curve)
        self.refused("goes into a .npy", volume.save, self.path("v.png"))
        self.refused("complex", saltus.write_image, self.path("c.npy"), np.ones((2, 2, 1), complex))

    def test_signed(self):
        slope = saltus.compile(CIRCLE).jvp({"radius": 1}, 8)
        saltus.save_png(self.path("s.png"), slope, title="d/d radius")
        with open(self.path("s.png"), "rb") as file:
            self.assertEqual(file.read(), saltus.encode_png(slope, signed=True, title="d/d radius"))

    def test_places(self):
        """A link is followed, and what is no file stays what it is."""
        saltus.save_png(self.path("s.png"), np.ones((1, 1, 3)))
        os.symlink("s.png", self.path("link.png"))
        saltus.save_png(self.path("link.png"), np.zeros((2, 2, 3)))
        self.assertTrue(os.path.islink(self.path("link.png")))
        self.assertEqual(saltus.read_image(self.path("s.png")).shape, (2, 2, 3))
        os.symlink("/dev/full", self.path("full.png"))
        self.refused("No space left", saltus.save_png, self.path("full.png"), np.ones((2, 2, 3)), kind=saltus.OutputError)
        self.assertFalse(os.path.isfile("/dev/full"))

    def test_errors(self):
        self.refused("none/a.png", saltus.save_png, self.path("none/a.png"), np.ones((2, 2, 3)), kind=saltus.OutputError)
        self.refused("none/a.npy", saltus.write_image, self.path("none/a.npy"), np.ones((2, 2, 3)), kind=saltus.OutputError)
        self.refused("none/a.exr", saltus.write_image, self.path("none/a.exr"), np.ones((2, 2, 3)), kind=saltus.OutputError)
        self.refused("a.xyz", saltus.write_image, self.path("a.xyz"), np.ones((2, 2, 3)))
        self.refused("none.png", saltus.read_image, self.path("none.png"), kind=saltus.InputError)
        self.put("bad.png", "this is no picture")
        self.refused("bad.png", saltus.read_image, self.path("bad.png"), kind=saltus.InputError)
        self.assertEqual(os.listdir(self.dir), ["bad.png"])


if __name__ == "__main__":
    main()
