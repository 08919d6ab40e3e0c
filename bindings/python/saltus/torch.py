"""Saltus in PyTorch: images and integrals as functions of tensors, with the part of the moving jumps in their gradient.

    radius = torch.tensor(0.3, dtype=torch.float64, requires_grad=True)
    image = saltus.torch.render(p, {"radius": radius}, 256, spp=4)
    ((image - target) ** 2).mean().backward()

The image has the samples of seed 2k and its derivative those of 2k + 1, so that their noise is independent and the
gradient of a squared loss is not biased. Everything runs on the CPU; tensors of other devices are copied there and back."""
from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch

from ._errors import UsageError
from ._program import Program
from ._values import Record, Values

__all__ = ["integral", "loss", "render"]

ONCE = ("saltus gives first derivatives only: the derivative of a derivative would need the second derivatives of where "
        "jumps lie. Call backward() without create_graph, or differentiate the gradient by differences")


def _flat(tensors, prefix=""):
    """(name, tensor) of a mapping, whose structs are mappings of their fields: "discs.radius"."""
    for name, value in tensors.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
        elif isinstance(value, torch.Tensor) and value.is_complex():
            raise UsageError(f"{prefix}{name}: a tensor of real numbers is wanted, not of {value.dtype}")
        else:
            yield prefix + name, value


def _assigned(pairs) -> dict:
    """As a mapping of parameters, structs as mappings of their fields."""
    values: dict = {}
    for name, value in pairs:
        first, _, rest = name.partition(".")
        if rest and "[" not in first:
            at = values.setdefault(first, {})
            *inner, last = rest.split(".")
            for part in inner:
                at = at.setdefault(part, {})
            at[last] = value
        else:
            values[name] = value
    return values


def _array(tensor):
    return tensor.detach().to("cpu", torch.float64).numpy().copy()


def _pick(gradient: Values, name: str):
    """Of one tensor: a parameter, a component, or `discs.radius`, the field of all structs."""
    view = gradient
    if "[" in name or "." not in name:
        return view[name]
    for part in name.split("."):
        if isinstance(view, (Values, Record)) and part in view:
            view = view[part]
        else:
            return gradient[name]
    return view


class _Estimate(torch.autograd.Function):
    """An estimate as a node: `work` has the program, and says what value and slopes are."""

    @staticmethod
    def forward(ctx, work, names, *tensors):
        ctx.work, ctx.names, ctx.tensors = work, names, tensors
        ctx.kinds = [(t.dtype, t.device, tuple(t.shape)) for t in tensors]
        ctx.values = _assigned(zip(names, map(_array, tensors)))  # by value: an optimiser steps them in place
        return work.value(ctx.values)

    @staticmethod
    def backward(ctx, adjoint):
        wanted = [n for n, needed in zip(ctx.names, ctx.needs_input_grad[2:]) if needed]
        found = ctx.work.slopes(ctx.values, adjoint.detach(), wanted)
        out = [None, None]
        for name, (dtype, device, shape) in zip(ctx.names, ctx.kinds):
            if name not in wanted:
                out.append(None)
                continue
            gradient = torch.from_numpy(np.array(found(name), np.float64)).reshape(shape).to(device, dtype)
            # With create_graph what is returned depends on all of this, and must say no when it is asked how.
            out.append(_Refuse.apply(gradient, adjoint, *ctx.tensors) if torch.is_grad_enabled() else gradient)
        return tuple(out)


class _Refuse(torch.autograd.Function):
    @staticmethod
    def forward(ctx, gradient, *depends_on):
        return gradient.clone()

    @staticmethod
    def backward(ctx, _):
        raise RuntimeError(ONCE)


def _names(p, wanted):
    """wrt of these tensors: fields of structs are named by all their elements."""
    found = []
    for name in wanted:
        first, _, rest = name.partition(".")
        if rest and "[" not in first and isinstance(p.params[first], Record) and p.params[first].shape:
            found.append(f"{first}{'[*]' * len(p.params[first].shape)}.{rest}")
        else:
            found.append(name)
    return found


class _Render:
    def __init__(self, program, size, seed, dtype, device, options):
        self.program, self.size, self.seed, self.options = program, size, seed, options
        self.dtype, self.device = dtype, device

    def value(self, values):
        image = self.program.render(self.size, params=values, seed=2 * self.seed, **self.options)
        return torch.from_numpy(np.asarray(image)).to(self.device, self.dtype)

    def slopes(self, values, adjoint, wanted):
        given = adjoint.to("cpu", torch.float32).contiguous().numpy()
        gradient = self.program.vjp(given, params=values, wrt=_names(self.program, wanted), seed=2 * self.seed + 1,
                                    **self.options)
        return lambda name: _pick(gradient, name)


class _Integral:
    def __init__(self, program, samples, seed, dtype, device, options):
        self.program, self.samples, self.seed, self.options = program, samples, seed, options
        self.dtype, self.device = dtype, device

    def value(self, values):
        found = self.program.integral(self.samples, params=values, seed=2 * self.seed, interior_only=True, **self.options)
        return torch.from_numpy(found.value).to(self.device, self.dtype)

    def slopes(self, values, adjoint, wanted):
        weights = adjoint.to("cpu", torch.float64).numpy()
        found = self.program.integral(self.samples, params=values, wrt=_names(self.program, wanted), seed=2 * self.seed + 1,
                                      **self.options)
        return lambda name: np.asarray(_pick(found.gradient, name)) @ weights


def _apply(work_of, params, tensors, options):
    pairs = list(_flat({**(params or {}), **tensors}))
    seed = options.pop("seed", 0)
    if not 0 <= seed < 1 << 31:
        raise UsageError("seed is from 0 to 2^31 - 1: an image takes twice it, its derivative the next")
    given = [t for _, t in pairs if isinstance(t, torch.Tensor)]
    first = next((t for t in given if t.is_floating_point()), torch.empty(0))
    work = work_of(seed, first.dtype, first.device)
    return _Estimate.apply(work, [n for n, _ in pairs], *[_shaped(work.program, n, t) for n, t in pairs])


def _shaped(program, name, value):
    """A tensor of the shape of the parameter: what is spread over it gets the sum of the derivatives."""
    tensor = value if isinstance(value, torch.Tensor) else torch.as_tensor(np.asarray(value, np.float64))
    try:
        shape = np.shape(_pick(program.params, name))
    except KeyError as error:
        raise UsageError(error.args[0]) from None
    try:
        return tensor.reshape(shape) if tensor.numel() == 1 and shape == () else tensor.expand(shape)
    except RuntimeError:
        raise UsageError(f"{name} has the shape {shape}, and the tensor {tuple(tensor.shape)}") from None


def render(program: Program, params: Mapping | None = None, size=None, *, dtype: torch.dtype | None = None, spp: int = 4,
           seed: int = 0, options: Mapping | None = None, **tensors) -> torch.Tensor:
    """The image at these tensors, (height, width, channels), differentiable in them.

    params: parameters, fields of structs (``{"discs": {"radius": r}}`` or ``"discs.radius"``) or components
    ("discs[3].centre") to tensors of their shape, any float type, any device; others keep the program's values.
    Tensors may also be given by name, ``radius=t``. size: as `Program.render`.
    dtype: of the image (default: of the first tensor). seed: 0 to 2^31 - 1; take another in every iteration.
    options: more of the estimating options, ``{"estimator": "lattice"}``."""
    more = {"spp": spp, **(options or {})}
    return _apply(lambda seed, kind, device: _Render(program, size, seed, dtype or kind, device, more), params, tensors,
                  {"seed": seed})


def integral(program: Program, params: Mapping | None = None, samples: int = 1 << 18, *, dtype: torch.dtype | None = None,
             seed: int = 0, options: Mapping | None = None, **tensors) -> torch.Tensor:
    """The integral over the domain at these tensors, (channels,), differentiable in them; arguments as of `render`."""
    more = dict(options or {})
    return _apply(lambda seed, kind, device: _Integral(program, samples, seed, dtype or kind, device, more), params, tensors,
                  {"seed": seed})


def loss(function: Callable[[Any, Any], torch.Tensor]) -> Callable[[Any, Any], tuple[float, np.ndarray]]:
    """A loss for `Program.fit`, of a function of tensors (image, target) that returns a scalar tensor:
    ``p.fit(target, loss=saltus.torch.loss(torch.nn.functional.smooth_l1_loss))``."""
    def value_and_adjoint(image, target):
        at = torch.from_numpy(np.asarray(image)).requires_grad_()
        with torch.enable_grad():
            value = function(at, None if target is None else torch.from_numpy(np.asarray(target)))
        (adjoint,) = torch.autograd.grad(value, at)
        return value.item(), adjoint.numpy()
    value_and_adjoint.__qualname__ = getattr(function, "__qualname__", "loss")
    return value_and_adjoint
