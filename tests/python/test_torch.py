"""saltus.torch: gradients against those of the library, tensors of every kind, graphs, what is refused."""
from harness import *

try:
    import torch
except ImportError:
    print("skipped: %s has no PyTorch" % sys.executable)
    sys.exit(0)
import saltus.torch as st

SEEDS = 100
BOUND = 4.5  # standard errors, as in test_gradients.py


class Tensors(Case):
    def setUp(self):
        super().setUp()
        self.p = saltus.compile(DISCS)

    def slopes(self, **tensors):
        st.render(self.p, tensors, 12, spp=2, seed=3).sum().backward()
        return {name: t.grad for name, t in tensors.items()}

    def test_the_same_as_vjp(self):
        image = st.render(self.p, {"paper": torch.tensor([0.5, 0.6, 0.7], requires_grad=True)}, 12, spp=2, seed=3)
        self.same(image.detach().numpy(), self.p.render(12, spp=2, seed=6, params={"paper": np.float32([0.5, 0.6, 0.7])}))
        g = self.slopes(paper=torch.tensor([0.5, 0.6, 0.7], dtype=torch.float64, requires_grad=True))["paper"]
        self.same(g.numpy(), self.p.vjp(np.ones((12, 12, 3)), spp=2, seed=7, params={"paper": [0.5, 0.6, 0.7]}, wrt="paper")["paper"])

    def test_mean_of_squares(self):
        p, target = saltus.compile(CIRCLE), np.random.default_rng(0).random((16, 16, 1)).astype(np.float32)
        mine, own = [], []
        for seed in range(SEEDS):
            tensors = [torch.tensor(v, dtype=torch.float64, requires_grad=True) for v in (0.4, [0.1, -0.05], 1.0)]
            image = st.render(p, dict(zip(("radius", "centre", "ink"), tensors)), 16, spp=2, seed=seed, options={"estimator": "lattice"})
            ((image - torch.from_numpy(target)) ** 2).mean().backward()
            mine.append(np.concatenate([t.grad.numpy().reshape(-1) for t in tensors]))
            own.append(p.loss(target, spp=2, seed=seed + 1000, estimator="lattice")[1].vector)
        mine, own = np.array(mine), np.array(own)
        error = np.sqrt((mine.var(0, ddof=1) + own.var(0, ddof=1)) / SEEDS)
        self.assertLess(np.abs((mine.mean(0) - own.mean(0)) / error).max(), BOUND)

    def test_structs_and_components(self):
        whole = self.p.vjp(np.ones((12, 12, 3)), spp=2, seed=7)["discs"]
        radius = torch.tensor(self.p["discs"].radius.copy(), requires_grad=True)
        centre = torch.tensor(self.p["discs"].centre[1].copy(), requires_grad=True)
        for given in ({"discs": {"radius": radius}, "discs[1].centre": centre}, {"discs.radius": radius, "discs[1].centre": centre}):
            radius.grad = centre.grad = None
            st.render(self.p, given, 12, spp=2, seed=3).sum().backward()
            np.testing.assert_allclose(radius.grad, whole.radius, rtol=1e-5, atol=1e-5)
            np.testing.assert_allclose(centre.grad, whole.centre[1], rtol=1e-5, atol=1e-5)

    def test_kinds(self):
        for kind in (torch.float32, torch.float64, torch.float16):
            t = torch.tensor([0.5, 0.25, 0.75], dtype=kind, requires_grad=True)
            image = st.render(self.p, {"paper": t}, 8)
            image.float().sum().backward()
            self.assertEqual((image.dtype, t.grad.dtype, t.grad.shape), (kind, kind, (3,)))
        self.assertEqual(st.render(self.p, {"paper": t}, 8, dtype=torch.float64).dtype, torch.float64)
        self.assertEqual(st.render(self.p, {"light": 1.0, "paper": torch.ones(3)}, 8).dtype, torch.float32)  # of the first tensor
        self.refused("complex64", st.render, self.p, {"paper": torch.ones(3, dtype=torch.complex64)}, 8)

    def test_strides(self):
        wide = torch.rand(3, 2, 4, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
        t = wide.permute(2, 0, 1)[..., 0].requires_grad_()
        st.render(self.p, {"discs.ink": t}, 8, seed=3).sum().backward()
        expected = self.p.vjp(np.ones((8, 8, 3)), spp=4, seed=7, params={"discs": {"ink": t.detach().numpy()}}, wrt="discs[*].ink")["discs"].ink
        self.same(t.grad.numpy(), expected)

    def test_spread(self):
        """What is smaller than the parameter is spread, and has the sum of the derivatives."""
        t = torch.tensor(0.5, dtype=torch.float64, requires_grad=True)
        st.render(self.p, {"paper": t}, 8, seed=3).sum().backward()
        expected = self.p.vjp(np.ones((8, 8, 3)), spp=4, seed=7, params={"paper": 0.5}, wrt="paper")["paper"].sum()
        self.assertAlmostEqual(float(t.grad) / expected, 1, places=6)
        one = torch.tensor([0.4], requires_grad=True)
        st.render(saltus.compile(CIRCLE), {"radius": one}, 8).sum().backward()
        self.assertEqual(one.grad.shape, (1,))
        self.refused("paper has the shape (3,), and the tensor (2,)", st.render, self.p, {"paper": torch.ones(2)}, 8)
        self.refused("no parameter `q`", st.render, self.p, {"q": torch.ones(2)}, 8)
        self.refused("seed is from 0", st.render, self.p, {"paper": torch.ones(3)}, 8, seed=-1)

    def test_only_what_is_asked(self):
        """Tensors that need no gradient are no part of wrt."""
        asked, vjp = [], self.p.vjp

        def spy(*arguments, **options):
            asked.append(options["wrt"])
            return vjp(*arguments, **options)
        self.p.vjp = spy
        paper, ink = torch.ones(3, requires_grad=True), torch.zeros(4, 3)
        st.render(self.p, {"paper": paper, "discs.ink": ink}, 8).sum().backward()
        self.assertEqual((asked, ink.grad), ([["paper"]], None))
        with torch.no_grad():
            self.assertFalse(st.render(self.p, {"paper": paper}, 8).requires_grad)

    def test_integral(self):
        p = saltus.compile(CIRCLE)
        r = torch.tensor(0.3, dtype=torch.float64, requires_grad=True)
        value = st.integral(p, {"radius": r}, options={"exact": True})
        (2 * value.sum()).backward()
        self.assertAlmostEqual(float(value), 1 + 0.75 * np.pi * 0.09, places=3)
        self.assertAlmostEqual(float(r.grad), 2 * 0.75 * 2 * np.pi * 0.3, places=3)


class Graphs(Case):
    def setUp(self):
        super().setUp()
        self.p = saltus.compile(CIRCLE)
        self.r = torch.tensor(0.3, dtype=torch.float64, requires_grad=True)

    def test_two_renders(self):
        (st.render(self.p, radius=self.r, size=8, seed=1).sum() * 2 - st.render(self.p, radius=self.r, size=8, seed=2).sum()).backward()
        ones = np.ones((8, 8, 1))
        one, two = (self.p.vjp(ones, spp=4, seed=s, params={"radius": 0.3}, wrt="radius")["radius"] for s in (3, 5))
        self.assertAlmostEqual(float(self.r.grad), float(2 * one - two), places=5)

    def test_a_step_between_forward_and_backward(self):
        loss = st.render(self.p, {"radius": self.r}, 8).sum()
        with torch.no_grad():
            self.r += 0.2
        self.p["radius"] = 0.9
        loss.backward()
        self.assertEqual(float(self.r.grad), float(self.p.vjp(np.ones((8, 8, 1)), spp=4, seed=1, params={"radius": 0.3}, wrt="radius")["radius"]))

    def test_second_derivatives_are_refused(self):
        """Also where the adjoint is a constant, and nothing but the parameter leads back."""
        for loss in (lambda i: (i ** 2).sum(), lambda i: i.sum()):
            (g,) = torch.autograd.grad(loss(st.render(self.p, {"radius": self.r}, 8)), self.r, create_graph=True)
            with self.assertRaisesRegex(RuntimeError, "first derivatives only"):
                (g ** 2 + self.r).backward()

    def test_modules_and_optimisers(self):
        class Disc(torch.nn.Module):
            def __init__(self, p):
                super().__init__()
                self.p, self.radius, self.centre = p, torch.nn.Parameter(torch.tensor(0.25)), torch.nn.Parameter(torch.tensor([0.2, 0.1]))

            def forward(self, seed):
                return st.render(self.p, {"radius": self.radius, "centre": self.centre}, 24, seed=seed)
        target = torch.from_numpy(np.asarray(self.p.render(24, spp=16)))
        model = Disc(self.p)
        optimiser = torch.optim.Adam(model.parameters(), lr=0.02)
        for k in range(60):
            optimiser.zero_grad()
            ((model(k) - target) ** 2).mean().backward()
            optimiser.step()
        self.assertAlmostEqual(float(model.radius), 0.4, delta=0.03)
        np.testing.assert_allclose(model.centre.detach(), [0.1, -0.05], atol=0.03)

    def test_losses_of_fits(self):
        target = self.p.render(16, spp=16)
        for outer in (torch.enable_grad(), torch.no_grad()):
            q = saltus.compile(CIRCLE, params={"radius": 0.3})
            with outer:
                result = q.fit(target, loss=st.loss(torch.nn.functional.smooth_l1_loss), iters=60, lr=0.02)
            self.assertLess(result.loss, 0.3 * result.initial_loss)
            self.assertAlmostEqual(float(q["radius"]), 0.4, delta=0.05)

    def test_threads(self):
        import concurrent.futures

        def work(seed):
            r = torch.tensor(0.3, requires_grad=True)
            st.render(self.p, {"radius": r}, 8, seed=seed).sum().backward()
            return float(r.grad)
        alone = [work(s) for s in range(20)]
        with concurrent.futures.ThreadPoolExecutor(3) as pool:
            self.assertEqual(list(pool.map(work, range(20))), alone)


if __name__ == "__main__":
    main()
