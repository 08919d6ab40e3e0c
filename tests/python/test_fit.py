"""Fits: the bits of the command, what callbacks see and do, files to go on from, every kind of loss, Ctrl-C."""
import contextlib
import io
import signal
import threading
import time

from harness import *

TILTED = DISCS.replace("shader float3 main", "shader float3 dim").replace("return light * c;", "return 0.5 * c;")
SLOW = 4096  # samples a pixel of what must be interrupted


def numbers(program):
    return program.params.vector.copy()


class FitCase(Case):
    def setUp(self):
        super().setUp()
        self.file = self.put("d.salt", DISCS)
        self.p = saltus.load(self.file)
        truth = saltus.load(self.file)
        truth["discs"].radius += 0.05
        truth["paper"] = [0.9, 0.6, 0.5]
        self.target = np.asarray(truth.render((20, 12), spp=16, seed=9))
        np.save(self.path("t.npy"), self.target)
        self.options = {"iters": 6, "spp": 4, "seed": 5}

    def fresh(self):
        return saltus.load(self.file)


class AsTheCommand(FitCase):
    def assert_same(self, p, result, told):
        self.assertEqual((result.losses.tolist(), result.loss, result.initial_loss, result.iterations, result.stopped),
                         (told["losses"], told["loss"], told["initial_loss"], told["iterations"], told["stopped"]))
        q = self.fresh()
        q.set_params_json(json.dumps(told["params"]))
        self.same(np.float32(numbers(p)), np.float32(numbers(q)))

    def test_optimisers(self):
        for name in ("adam", "sgd", "lbfgs"):
            p = self.fresh()
            result = p.fit(self.target, optimizer=name, **self.options)
            self.assert_same(p, result, self.command("fit", "d.salt", "--target", "t.npy", "--optimizer", name, "--iters", 6, "--spp", 4, "--seed", 5))
            self.assertLess(result.loss, result.initial_loss)

    def test_some_parameters(self):
        result = self.p.fit(self.path("t.npy"), wrt=["discs[*].radius", "paper"], lr={"discs[*].radius": 0.02, "paper": 0.1}, **self.options)
        self.assert_same(self.p, result, self.command("fit", "d.salt", "--target", "t.npy", "--wrt", "discs[*].radius,paper", "--lr", "discs[*].radius=0.02,paper=0.1",
                                                      "--iters", 6, "--spp", 4, "--seed", 5))

    def test_minimised(self):
        self.put("b.salt", BOWL)
        p = saltus.load(self.path("b.salt"))
        result = p.fit(minimize=True, iters=9, lr=0.05, samples=256)
        told = self.command("fit", "b.salt", "--minimize", "--iters", 9, "--lr", "0.05", "--samples", 256)
        self.assertEqual((result.losses.tolist(), np.float32(p["a"]), np.float32(p["b"])), (told["losses"], np.float32(told["params"]["a"]), np.float32(told["params"]["b"])))

    def test_threads(self):
        results = [self.fresh().fit(self.target, threads=n, **self.options).losses.tolist() for n in (1, 2)]
        self.assertEqual(*results)


class Losses(FitCase):
    def test_kinds(self):
        for loss in ("l1", "huber"):
            p = self.fresh()
            result = p.fit(self.target, loss=loss, iters=20, lr=0.02)
            self.assertLess(result.loss, 0.9 * result.initial_loss)
        self.refused("loss is one of l2, l1, huber", self.p.fit, self.target, loss="l3")

    def test_of_a_function(self):
        """Of the mean of squares it is nearly the one that is built in: only its noise differs."""
        def squares(image, target):
            seen.append((type(image), image.shape, target.shape))
            d = np.asarray(image, np.float64) - target
            return (d * d).mean(), 2 * d / d.size
        seen, options = [], {"iters": 20, "lr": 0.02, "spp": 8}
        result, p, q = self.p.fit(self.target, loss=squares, **options), self.p, self.fresh()
        other = q.fit(self.target, **options)
        self.assertEqual(seen[0], (saltus.Image, (12, 20, 3), (12, 20, 3)))
        for r in (result, other):
            self.assertLess(r.loss, 0.7 * r.initial_loss)
        np.testing.assert_allclose(p["paper"], q["paper"], atol=0.02)

    def test_of_a_function_without_a_target(self):
        """Only the program draws; here it is to be dark."""
        result = self.p.fit(loss=lambda image, target: (float(image.mean()), np.full(image.shape, 1 / image.size)), size=(8, 6), iters=20, lr=0.1, wrt="paper")
        self.assertLess(result.loss, result.initial_loss)
        self.assertLess(self.p["paper"].max(), 0.1)

    def test_bad_functions(self):
        for said, kind, loss in (("mine", KeyError, lambda i, t: {}["mine"]), ("a number and the adjoint", saltus.UsageError, lambda i, t: 1.0), ("adjoint of the loss", saltus.UsageError, lambda i, t: (1.0, i[0])),
                                 ("complex", saltus.UsageError, lambda i, t: (1.0, i * 1j)), ("object", saltus.UsageError, lambda i, t: (1.0, None))):
            with self.assertRaisesRegex(kind, said):
                self.p.fit(self.target, loss=loss, **self.options)
        self.assertEqual(self.p.render(4).shape, (4, 4, 3))

    def test_losses_that_are_no_number(self):
        error = self.refused("fit failed", self.p.fit, self.target, loss=lambda i, t: (float("nan"), i), iters=30, kind=saltus.CheckFailed)
        self.assertEqual(error.status, 1)

    def test_starts_that_are_no_place(self):
        self.p["discs"].centre[1, 0] = np.inf
        self.refused("`discs` (number ", self.p.fit, self.target, iters=2)
        p = saltus.compile("[Log] param float a = 1.0; shader float main(float2 x) { return a; }", params={"a": -1})
        self.refused("`a` is [Log] and starts at -1", p.fit, np.zeros((4, 4, 1)))

    def test_masks(self):
        mask = np.random.default_rng(2).random(self.target.shape[:2])
        losses = [self.p.loss(self.target, mask=m)[0] for m in (mask, mask[..., None], np.repeat(mask[..., None], 3, 2))]
        self.assertEqual(len(set(losses)), 1)

    def test_nothing_to_match(self):
        self.refused("what is to be matched?", self.p.fit)
        self.refused("views", self.p.fit, self.target, minimize=True)
        self.refused("is one of", self.p.fit, self.target, schedule="linear")
        self.refused("no optimiser `adagrad`", self.p.fit, self.target, optimizer="adagrad")
        self.refused("has no gradient", self.p.fit, self.target, wrt="light")
        self.refused("names nothing", self.p.fit, self.target, wrt=[])
        self.refused("history is a whole number", self.p.fit, self.target, optimizer="lbfgs", history=2.5)
        self.refused("q", self.p.fit, self.target, lr={"q": 1})
        self.refused("none.png", self.p.fit, "none.png", kind=saltus.InputError)
        self.refused("nothing to optimise", saltus.compile(PLAIN).fit, np.ones((4, 4, 1)))

    def test_masks(self):
        left = np.zeros((12, 20))
        left[:, :10] = 1
        result = self.p.fit(self.target, mask=left, **self.options)
        masked = self.fresh().fit(views=[{"target": self.target, "mask": left}], **self.options)
        self.assertEqual(result.losses.tolist(), masked.losses.tolist())
        self.assertNotEqual(result.losses[0], self.fresh().fit(self.target, **self.options).losses[0])
        self.refused("the mask has the shape", self.p.fit, self.target, mask=np.ones((5, 5)))

    def test_learning_rates_by_mask(self):
        before = self.p["discs"].radius.copy()
        self.p.fit(self.target, lr_masks={"discs": np.array([[0], [1], [1], [0]])}, wrt="discs[*].radius", **self.options)
        moved = self.p["discs"].radius != before
        self.assertEqual(moved.tolist(), [False, True, True, False])
        self.refused("(rows, columns)", self.p.fit, self.target, lr_masks={"discs": [1, 0]})


PLAIN = "shader float main(float2 x) { return x.x; }"


class Views(FitCase):
    def test_values_of_their_own(self):
        dark = self.target * 0.5
        result = self.p.fit(views=[{"target": self.target}, {"target": dark, "params": {"light": 0.5}}], **self.options)
        self.assertLess(result.loss, result.initial_loss)
        self.same(self.p["light"], 1)

    def test_another_program(self):
        other = saltus.compile(TILTED)
        other["discs"].radius = 0.01
        before = numbers(other)
        adjoint = np.ones((12, 20, 3))
        expected = other.vjp(adjoint, wrt=None).vector
        result = self.p.fit(views=[{"target": self.target}, {"target": self.target * 0.5, "program": other}], wrt="paper", **self.options)
        self.assertLess(result.loss, result.initial_loss)
        self.same(numbers(other), before)
        self.same(other.vjp(adjoint).vector, expected)  # all is differentiated again, not what the fit did

    def test_refused(self):
        for said, views in (("empty list", []), ("no `targt`", [{"targt": 1}]), ("no target", [{}]), ("of the first", [{"target": self.target}, {"target": self.target[:5]}]),
                            ("3 channels", [{"target": self.target[..., :2]}]), ("q", [{"target": self.target, "params": {"q": 1}}])):
            self.refused(said, self.p.fit, views=views, kind=saltus.SaltusError)
        self.refused("targets and masks of their own", self.p.fit, self.target, views=[{"target": self.target}])


class Callbacks(FitCase):
    def test_what_they_see(self):
        seen = []

        def look(at):
            seen.append((at.iteration, at.loss, at.best, at.params["discs"].radius.copy(), at.gradient["discs"].radius.copy(), at.image.shape))
            self.same(at.params.vector, self.p.params.vector)
        result = self.p.fit(self.target, callback=look, **self.options)
        self.assertEqual([s[0] for s in seen], [1, 2, 3, 4, 5, 6])
        self.assertEqual([s[1] for s in seen], result.losses.tolist())
        self.assertEqual([s[2] for s in seen], np.minimum.accumulate(result.losses).tolist())
        self.assertEqual({s[5] for s in seen}, {(12, 20, 3)})
        self.assertTrue(all(np.any(s[4]) for s in seen) and not np.array_equal(seen[0][3], seen[5][3]))

    def test_they_stop(self):
        result = self.p.fit(self.target, callback=lambda at: at.iteration == 3, **self.options)
        self.assertEqual((result.stopped, result.iterations, len(result.losses)), ("stopped", 3, 3))

    def test_they_render(self):
        images = []
        self.p.fit(self.target, callback=lambda at: images.append(self.p.render(8)) and False, **self.options)
        self.assertEqual(len(images), 6)
        self.assertFalse(np.array_equal(images[0], images[5]))

    def test_they_raise(self):
        best = []

        def broken(at):
            best.append((at.loss, numbers(self.p)))
            if at.iteration == 4:
                raise KeyError("mine")
        with self.assertRaisesRegex(KeyError, "mine"):
            self.p.fit(self.target, callback=broken, **self.options)
        self.same(numbers(self.p), min(best, key=lambda b: b[0])[1])
        self.assertEqual(self.p.fit(self.target, **self.options).iterations, 6)

    def test_another_fit_within(self):
        self.refused("fit", self.p.fit, self.target, callback=lambda at: self.p.fit(self.target), **self.options)
        self.assertEqual(self.p.fit(self.target, **self.options).iterations, 6)

    def test_progress(self):
        told = io.StringIO()
        with contextlib.redirect_stderr(told):
            self.p.fit(self.target, **self.options)
            self.assertEqual(told.getvalue(), "")  # no terminal
            self.p.fit(self.target, progress=True, **self.options)
        self.assertIn("6/6  loss", told.getvalue())
        self.assertTrue(told.getvalue().endswith("\n"))

    def test_curve(self):
        svg = self.p.fit(self.target, **self.options)._repr_svg_()
        self.assertTrue(svg.startswith("<svg") and "6 iterations" in svg)
        self.assertIsNone(self.p.fit(self.target, iters=1)._repr_svg_())

    def test_time_limit(self):
        result = self.p.fit(self.target, iters=10 ** 6, time_limit=0.05)
        self.assertEqual(result.stopped, "time limit")
        self.assertEqual(len(result.losses), result.iterations)

    def test_convergence(self):
        p = saltus.compile(BOWL)
        result = p.fit(minimize=True, optimizer="lbfgs", iters=100, samples=64)
        self.assertEqual(result.stopped, "converged")
        self.assertTrue(result.reason)


class Checkpoints(FitCase):
    def test_goes_on_to_the_same_bits(self):
        for name in ("adam", "lbfgs"):
            whole, p, file = self.fresh(), self.fresh(), self.path("c.bin")
            result = whole.fit(self.target, optimizer=name, **self.options)
            p.fit(self.target, optimizer=name, checkpoint=file, every=2, callback=lambda at: at.iteration == 3, **self.options)
            q = self.fresh()
            rest = q.fit(self.target, optimizer=name, resume=pathlib.Path(file), **self.options)
            self.assertEqual((rest.losses.tolist(), rest.iterations), (result.losses.tolist(), 6))
            self.same(numbers(q), numbers(whole))

    def test_of_the_command(self):
        result = self.p.fit(self.target, **self.options)
        line = [COMMAND, "fit", "d.salt", "-o", "o.json", "--target", "t.npy", "--iters", "3", "--spp", "4", "--seed", "5", "--checkpoint", "c.bin", "--quiet"]
        self.assertEqual(subprocess.run(line, cwd=self.dir, capture_output=True, timeout=HANGS).returncode, 0)
        self.assertEqual(self.fresh().fit(self.target, resume=self.path("c.bin"), **self.options).losses.tolist(), result.losses.tolist())

    def test_files(self):
        self.refused("none.bin", self.p.fit, self.target, resume=self.path("none.bin"), kind=saltus.InputError)
        self.refused("none/c.bin", self.p.fit, self.target, checkpoint=self.path("none/c.bin"), kind=saltus.OutputError, **self.options)
        self.p.fit(self.target, checkpoint=self.path("c.bin"), **self.options)
        self.refused("c.bin", self.fresh().fit, self.target, resume=self.path("c.bin"), optimizer="sgd", kind=saltus.InputError)


class Interrupts(FitCase):
    """Ctrl-C: the call ends soon with KeyboardInterrupt, the program goes on working, handlers are as they were."""
    SOON = 5.0  # seconds of the clock, on a busy machine: an uninterrupted call takes a minute

    def setUp(self):
        super().setUp()
        self.before = signal.getsignal(signal.SIGINT)
        self.addCleanup(signal.signal, signal.SIGINT, self.before)

    def interrupted(self, function, *arguments, kind=KeyboardInterrupt, **options):
        sent = []

        def send():
            sent.append(time.monotonic())
            os.kill(os.getpid(), signal.SIGINT)
        timer = threading.Timer(0.1, send)
        timer.start()
        try:
            with self.assertRaises(kind):
                function(*arguments, **options)
            self.assertLess(time.monotonic() - sent[0], self.SOON)
        finally:
            timer.cancel()
            timer.join()

    def usable(self):
        self.assertEqual(self.p.render(4).shape, (4, 4, 3))
        self.assertEqual(len(self.p.fit(self.target, iters=2).losses), 2)

    def test_estimates(self):
        adjoint = np.ones((1024, 1024, 3))
        for threads in (1, 2):
            self.interrupted(self.p.render, 2048, spp=SLOW, threads=threads)
            for function, arguments in ((self.p.vjp, (adjoint,)), (self.p.jvp, ({"paper": 1}, 2048)), (self.p.loss, (adjoint,)), (self.p.grad_images, ("paper", 2048))):
                self.interrupted(function, *arguments, spp=SLOW, threads=threads, estimator="lattice")
        self.interrupted(self.p.integral, 1 << 36, estimator="lattice")
        self.interrupted(self.p.eval, np.zeros((1 << 25, 2)))
        self.assertIs(signal.getsignal(signal.SIGINT), self.before)
        self.usable()

    def test_fits(self):
        self.interrupted(self.p.fit, np.ones((1024, 1024, 3)), spp=SLOW, estimator="lattice")  # within one evaluation
        self.interrupted(self.p.fit, self.target, iters=10 ** 6)
        self.interrupted(self.p.fit, self.target, iters=10 ** 6, loss=lambda i, t: (1.0, i))
        self.interrupted(self.p.fit, self.target, iters=10 ** 6, callback=lambda at: time.sleep(0.001))
        self.assertIs(signal.getsignal(signal.SIGINT), self.before)
        self.usable()

    def test_best_parameters_stay(self):
        seen = []

        def look(at):
            seen.append((at.loss, numbers(self.p)))
            if at.iteration == 5:
                os.kill(os.getpid(), signal.SIGINT)
        with self.assertRaises(KeyboardInterrupt):
            self.p.fit(self.target, callback=look, optimizer="lbfgs", iters=1000)
        self.same(numbers(self.p), min(seen, key=lambda s: s[0])[1])

    def test_own_handler(self):
        class Mine(Exception):
            pass

        def raises(number, frame):
            raise Mine
        signal.signal(signal.SIGINT, raises)
        self.interrupted(self.p.render, 2048, spp=SLOW, kind=Mine)
        self.assertIs(signal.getsignal(signal.SIGINT), raises)
        calls = []
        signal.signal(signal.SIGINT, lambda number, frame: calls.append((number, frame is not None)))
        self.interrupted(self.p.render, 2048, spp=SLOW)  # there is no image to return
        self.assertEqual(calls, [(signal.SIGINT, True)])
        self.usable()

    def test_own_handler_and_a_call_within(self):
        """Ctrl-C in a render of a fit's callback ends both, and calls the handler once."""
        calls = []
        signal.signal(signal.SIGINT, lambda number, frame: calls.append(number))
        self.interrupted(self.p.fit, self.target, iters=10 ** 6, callback=lambda at: self.p.render(2048, spp=SLOW) is None)
        self.assertEqual(calls, [signal.SIGINT])
        self.usable()

    def test_ignored(self):
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        os.kill(os.getpid(), signal.SIGINT)
        self.usable()
        self.assertIs(signal.getsignal(signal.SIGINT), signal.SIG_IGN)

    def test_another_thread(self):
        """Its calls neither take the handler nor are ended."""
        done = []
        thread = threading.Thread(target=lambda: done.append(self.p.render(256, spp=64).shape))
        thread.start()
        with self.assertRaises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(5)
        thread.join()
        self.assertEqual(done, [(256, 256, 3)])


if __name__ == "__main__":
    main()
