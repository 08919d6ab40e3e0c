"""saltus.jax, where JAX is installed: the gradient is that of vjp, under jit too."""
from harness import *

try:
    import jax
    import jax.numpy as jnp
except ImportError:
    print("skipped: %s has no JAX" % sys.executable)
    sys.exit(0)
import saltus.jax as sj


class Arrays(Case):
    def test_gradient(self):
        p = saltus.compile(CIRCLE)
        expected = p.vjp(np.ones((8, 8, 1)), spp=4, seed=7, params={"radius": np.float32(0.3)}, wrt=("radius",))["radius"]
        for wrap in (lambda f: f, jax.jit):
            slope = wrap(jax.grad(lambda r: sj.render(p, {"radius": r}, 8, spp=4, seed=3).sum()))(jnp.float32(0.3))
            self.assertAlmostEqual(float(slope) / float(expected), 1, places=5)
        self.refused("seed is from 0", sj.render, p, {"radius": 0.3}, 8, seed=-1)


if __name__ == "__main__":
    main()
