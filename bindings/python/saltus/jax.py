"""Saltus in JAX: the image as a function that jax.grad and jax.jit understand. Debian has no JAX: this module is untested
until somebody runs tests/python/test_jax.py where there is one.

    image = saltus.jax.render(p, {"radius": r}, 256, spp=4)"""
from __future__ import annotations

from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np

from . import _job
from ._errors import UsageError
from ._program import Program

__all__ = ["render"]


def render(program: Program, params: Mapping, size=None, *, seed: int = 0, **options):
    """The image at these arrays, (height, width, channels), differentiable once in them, by reverse mode.

    params: parameters or components by name, arrays of their shape. seed: 0 to 2^31 - 1; the image has the samples of
    twice it, the derivative those of the next, so that the gradient of a squared loss is not biased."""
    if not 0 <= seed < 1 << 31:
        raise UsageError("seed is from 0 to 2^31 - 1: an image takes twice it, its derivative the next")
    names = tuple(params)
    shape = _job.image_shape(_job.make_job(program.dim, size, dict(options)), program.dim, program.channels)
    image = jax.ShapeDtypeStruct(shape, jnp.float32)

    def values(arrays):
        return dict(zip(names, map(np.asarray, arrays)))

    @jax.custom_vjp
    def run(arrays):
        return jax.pure_callback(lambda a: np.asarray(program.render(size, params=values(a), seed=2 * seed, **options)),
                                 image, arrays)

    def forward(arrays):
        return run(arrays), arrays

    def backward(arrays, adjoint):
        def slopes(a, given):
            gradient = program.vjp(given, params=values(a), wrt=names, seed=2 * seed + 1, **options)
            return tuple(np.asarray(gradient[n], x.dtype).reshape(x.shape) for n, x in zip(names, map(np.asarray, a)))
        kinds = tuple(jax.ShapeDtypeStruct(jnp.shape(a), jnp.result_type(a)) for a in arrays)
        return (jax.pure_callback(slopes, kinds, arrays, adjoint),)

    run.defvjp(forward, backward)
    return run(tuple(jnp.asarray(params[n]) for n in names))
