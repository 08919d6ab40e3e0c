"""What is to be estimated: keyword arguments as an SltJob."""
from __future__ import annotations

import ctypes
import difflib
import operator

import numpy as np

from . import _abi
from ._errors import UsageError
from ._library import initial

SIDE_MAX = 1 << 24
FILTERS = {"box": _abi.SLT_FILTER_BOX, "tent": _abi.SLT_FILTER_TENT, "gaussian": _abi.SLT_FILTER_GAUSSIAN}
INTERIORS = {"auto": _abi.SLT_INTERIOR_AUTO, "samples": _abi.SLT_INTERIOR_SAMPLES,
             "quadrature": _abi.SLT_INTERIOR_QUADRATURE}
_TEMPLATE = bytes(initial(_abi.SltJob))


def whole(name, value, lowest, highest):
    try:
        number = operator.index(value)
    except TypeError:
        raise UsageError(f"{name} is a whole number, not {value!r}") from None
    if not lowest <= number <= highest:
        raise UsageError(f"{name} is from {lowest} to {highest}, not {number}")
    return number


def real(name, value, lowest=0.0):
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise UsageError(f"{name} is a number, not {value!r}") from None
    if not number >= lowest:
        raise UsageError(f"{name} is at least {lowest:g}, not {number}")
    return number


def numbers(name, value) -> np.ndarray:
    """Real numbers as an array, not copied; what is none is refused."""
    try:
        array = np.asarray(value)
    except ValueError as error:  # rows of different lengths
        raise UsageError(f"{name}: {error}") from None
    if array.dtype.kind not in "fiub":
        raise UsageError(f"{name}: real numbers are wanted, not {array.dtype}")
    return array


def choice(name, value, among):
    try:
        return among[value]
    except (KeyError, TypeError):
        raise UsageError(f"{name} is one of {', '.join(among)}, not {value!r}") from None


def _flag(member):
    return lambda job, name, value: setattr(job, member, bool(value))


def _whole(member, lowest, highest):
    return lambda job, name, value: setattr(job, member, whole(name, value, lowest, highest))


def _real(member):
    return lambda job, name, value: setattr(job, member, real(name, value))


def _choice(member, among):
    return lambda job, name, value: setattr(job, member, choice(name, value, among))


def _exact(job, name, value):
    if value:
        job.estimator, job.interior = _abi.SLT_EST_QUADRATURE, _abi.SLT_INTERIOR_QUADRATURE


#: The options of every estimate, by the names of the command: docs/python.md has them in a table.
OPTIONS = {
    "spp": _whole("spp", 1, 1 << 24), "samples": _whole("samples", 1, 1 << 40), "segments": _whole("segments", 1, 1 << 40),
    "seed": _whole("seed", 0, 0xffffffff), "threads": _whole("threads", 0, 1024), "filter": _choice("filter", FILTERS),
    "estimator": _choice("estimator", _abi.ESTIMATORS), "interior": _choice("interior", INTERIORS), "exact": _exact,
    "interior_only": _flag("no_boundary"), "boundary_only": _flag("no_interior"), "centres": _flag("centred"),
    "error": _real("error"), "abs_error": _real("abs_error"), "max_evaluations": _whole("max_evaluations", 1, 1 << 40),
    "gauss": _whole("gauss", 1, _abi.SLT_GAUSS_MAX), "replicates": _whole("replicates", 0, 1 << 16),
    "step": _real("fd_step"), "time_limit": _real("time_limit"),
}


def make_job(dim: int, size, options: dict, also=()) -> _abi.SltJob:
    """size: pixels along every axis, or (width, height, depth) as far as the program has axes; None: 512, of volumes 64.

    also: names that options could be meant for, beside these."""
    job = _abi.SltJob.from_buffer_copy(_TEMPLATE)
    if size is not None:
        try:
            sides = tuple(size)
        except TypeError:
            sides = (size,) * dim
        if len(sides) != dim or isinstance(size, str):
            raise UsageError(f"size is one number or {dim}, (width, height, depth) as far as the program has axes, "
                             f"not {size!r}")
        for d, n in enumerate(sides):
            job.size[d] = whole("size", n, 1, SIDE_MAX)
    elif dim == 3:
        job.size[:] = 64, 64, 64
    for name, value in options.items():
        put = OPTIONS.get(name)
        if put is None:
            near = difflib.get_close_matches(name, [*OPTIONS, *also], 1)
            raise UsageError(f"there is no option `{name}`" + (f"; did you mean `{near[0]}`?" if near else ""))
        if value is not None:
            put(job, name, value)
    return job


def image_shape(job, dim: int, channels: int):
    return tuple(job.size[d] for d in reversed(range(dim))) + (channels,)
