"""Fits: slt_fit with arrays, callbacks and a progress bar."""
from __future__ import annotations

import contextlib
import ctypes
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from . import _abi, _job
from ._errors import UsageError, c_path, c_string, raise_for
from ._images import Image, as_image, floats32
from ._library import free, initial, lib, text
from ._plot import plot
from ._progress import Bar
from ._program import _STATS, UNKNOWN, Program, _Interrupt, _names, _sets
from ._values import Gradient, Params

METRICS = {"l2": _abi.SLT_FIT_L2, "l1": _abi.SLT_FIT_L1, "huber": _abi.SLT_FIT_HUBER}
SCHEDULES = {"constant": _abi.SLT_FIT_CONSTANT, "exponential": _abi.SLT_FIT_EXPONENTIAL, "cosine": _abi.SLT_FIT_COSINE}
STOPS = {_abi.SLT_FIT_ITERATIONS: "iters", _abi.SLT_FIT_CONVERGED: "converged", _abi.SLT_FIT_STOPPED: "stopped",
         _abi.SLT_FIT_INTERRUPTED: "interrupted", _abi.SLT_FIT_TIME_LIMIT: "time limit", _abi.SLT_FIT_FAILED: "failed"}
#: Numbers of SltFitOptions, by their names there; what is not given is its default.
REALS = ("beta1", "beta2", "epsilon", "momentum", "gradient_tolerance", "loss_tolerance", "huber_delta", "decay")
COUNTS = ("history", "patience", "max_failures", "views_per_step")


@dataclass
class Iteration:
    """One evaluation of a fit, for its callback. ``params`` are the parameters there; ``image`` and ``gradient`` are
    copies."""
    iteration: int  #: evaluations done with this one
    loss: float
    best: float  #: the least loss so far
    params: Params
    gradient: Gradient
    image: Image | None  #: of the first view; None where the entry is minimised


@dataclass(repr=False)
class FitResult:
    """What a fit came to. The program has the best parameters that were found."""
    initial_loss: float
    loss: float  #: the best
    losses: np.ndarray  #: (iterations,)
    iterations: int
    stopped: str  #: "iters", "converged", "stopped" (by the callback) or "time limit"
    reason: str
    seconds: float

    def _repr_svg_(self) -> str | None:
        """The curve of the losses, logarithmic."""
        losses = np.asarray(self.losses)
        if np.count_nonzero(np.isfinite(losses) & (losses > 0)) < 2:
            return None
        return plot({"loss": losses}, log=True, title=f"best {self.loss:.3g}, {self.iterations} iterations, {self.seconds:.2g} s: "
                    f"{self.stopped}").svg

    def __repr__(self):
        return (f"FitResult(initial_loss={self.initial_loss:.6g}, loss={self.loss:.6g}, iterations={self.iterations}, "
                f"stopped={self.stopped!r}, seconds={self.seconds:.2g})")


def _numbers(kept, name, given):
    """A number for all parameters, or one each, as SltFitNumber."""
    pairs = given.items() if isinstance(given, Mapping) else [(None, given)]
    items = [(k if k is None else c_string(k, name), _job.real(name, v)) for k, v in pairs]
    array = (_abi.SltFitNumber * len(items))(*[_abi.SltFitNumber(*item) for item in items])
    kept.extend((array, items))
    return ctypes.addressof(array), len(items)


def _views(p, kept, views, target, mask, size, loss):
    """An array of SltFitView, the shape of their images (None: there is no target), and the targets."""
    if views is None:
        if target is None and mask is None:
            return None, 0, None, [None]
        views = [{"target": target, "mask": mask}]
    elif target is not None or mask is not None:
        raise UsageError("views have targets and masks of their own")
    if not views:
        raise UsageError("views is an empty list")
    made, targets, shape = [initial(_abi.SltFitView) for _ in views], [], None
    for i, (view, out) in enumerate(zip(views, made)):
        strange = [k for k in view if k not in ("target", "mask", "params", "program")]
        if strange:
            raise UsageError(f"a view has target, mask, params and program, and no `{strange[0]}`")
        program = view.get("program")
        if view.get("target") is None:
            if not loss:
                raise UsageError(f"view {i} has no target")
            targets.append(None)
        else:
            drawn = p if program is None else program
            image = drawn._target(view["target"], size if shape is None else tuple(reversed(shape[:-1])))
            if shape is not None and image.shape != shape:
                raise UsageError(f"the target of view {i} has the shape {image.shape}, that of the first {shape}")
            shape = image.shape
            targets.append(as_image(image, drawn.display))
            kept.append(image)
            if not loss:
                out.target = image.ctypes.data
        if view.get("mask") is not None:
            if shape is None:
                raise UsageError(f"view {i} has a mask and no target: weigh in the loss instead")
            weights = p._mask(view["mask"], shape)
            kept.append(weights)
            out.mask = weights.ctypes.data
        if view.get("params"):
            array, n, alive = _sets(view["params"])
            kept.extend((array, alive))
            out.values, out.nvalues = ctypes.addressof(array), n
        if program is not None:
            kept.append(program)
            out.program = program._handle
    array = (_abi.SltFitView * len(made))(*made)
    kept.append(array)
    return ctypes.addressof(array), len(made), shape, targets


def fit(p: Program, target, *, wrt, iters, lr, optimizer, mask, views, minimize, loss, loss_entry, smooth, smooth_faces,
        smooth_grids, lr_masks, schedule, callback, progress, size, checkpoint, every, resume, **options) -> FitResult:
    """`Program.fit`, which has the defaults and says what they mean."""
    own = callable(loss)
    kept: list = []
    o = initial(_abi.SltFitOptions)
    for name in [n for n in options if n in REALS]:
        setattr(o, name, _job.real(name, options.pop(name)))
    for name in [n for n in options if n in COUNTS]:
        setattr(o, name, _job.whole(name, options.pop(name), 0, 2 ** 31 - 1))
    o.views, o.nviews, shape, targets = _views(p, kept, views, target, mask, size, own)
    job = _job.make_job(p.dim, tuple(reversed(shape[:-1])) if shape is not None else size, options,
                        (*Program.fit.__kwdefaults__, *REALS, *COUNTS))
    o.minimize = bool(minimize)
    if not own and not minimize and not o.nviews:
        raise UsageError("what is to be matched? give a target, views, minimize=True or a loss function")
    if not own:
        o.metric = _job.choice("loss", loss, METRICS)
    o.optimizer = c_string(str(optimizer), "the optimizer")
    o.iterations, o.every = _job.whole("iters", iters, 0, 10 ** 8), _job.whole("every", every, 1, 10 ** 8)
    if lr is not None:
        o.rates, o.nrates = _numbers(kept, "lr", lr)
    if smooth:
        o.smooth, o.nsmooth = _numbers(kept, "smooth", smooth)
    for name, given in (("smooth_faces", smooth_faces), ("smooth_grids", smooth_grids)):
        if given:
            array, n, alive = _sets(given)
            kept.extend((array, alive))
            setattr(o, name, ctypes.addressof(array))
            setattr(o, "n" + name, n)
    if lr_masks:
        factors = {name: floats32(m, f"lr_masks of {name}") for name, m in lr_masks.items()}
        for name, m in factors.items():
            if m.ndim != 2:
                raise UsageError(f"lr_masks of {name}: (rows, columns) is wanted, not the shape {m.shape}")
        array = (_abi.SltFitMask * len(factors))(*[
            _abi.SltFitMask(c_string(name, "lr_masks"), m.shape[1], m.shape[0], m.ctypes.data)
            for name, m in factors.items()])
        kept.extend((array, factors))
        o.rate_masks, o.nrate_masks = ctypes.addressof(array), len(factors)
    o.schedule = _job.choice("schedule", schedule, SCHEDULES)
    o.loss_entry = c_string(loss_entry, "loss_entry") if loss_entry else None
    o.checkpoint = c_path(checkpoint) if checkpoint else None
    o.resume = c_path(resume) if resume else None
    stats = _abi.SltStats.from_buffer_copy(_STATS)
    o.job, o.stats = ctypes.addressof(job), ctypes.addressof(stats)
    bar, begun = Bar(o.iterations, progress), time.monotonic()
    interrupt: Any = None  # of the call, which the functions below belong to

    def guarded(function, failed):
        """Exceptions may not pass through the library: they end the fit, and are raised behind it."""
        def run(*arguments):
            try:
                return function(*arguments)
            except BaseException as error:
                interrupt.stop(error)
                return failed
        return run

    def lost(user, request, value, adjoint, error):
        r = _abi.SltFitRequest.from_address(request)
        form = tuple(r.pixels[d] for d in reversed(range(p.dim))) + (r.channels,)
        image = np.ctypeslib.as_array((ctypes.c_float * int(np.prod(form))).from_address(r.image)).reshape(form)
        answer = loss(as_image(image.copy(), p.display), targets[r.view])
        if not isinstance(answer, (tuple, list)) or len(answer) != 2:
            raise UsageError(f"the loss returns a number and the adjoint, an array like the image, not {type(answer).__name__}")
        given, slope = answer
        ctypes.c_double.from_address(value).value = float(given)
        if adjoint:
            slope = floats32(slope, "the adjoint of the loss", form)
            ctypes.memmove(adjoint, slope.ctypes.data, slope.nbytes)
        return _abi.SLT_OK

    def iterated(user, at):
        it = _abi.SltFitIteration.from_address(at)
        bar.step(it.iteration, it.loss, it.best)
        if not callback:
            return False
        index, values, slopes = (np.ctypeslib.as_array((kind * it.count).from_address(where)) for kind, where in
                                 ((ctypes.c_uint32, it.index), (ctypes.c_double, it.parameters),
                                  (ctypes.c_double, it.gradient)))
        p._floats[index] = values
        gradient = np.zeros(p._floats.size)
        gradient[index] = slopes
        image = None
        if it.image:
            n = int(np.prod(_job.image_shape(job, p.dim, p.channels)))
            image = np.ctypeslib.as_array((ctypes.c_float * n).from_address(it.image)).copy()
            image = as_image(image.reshape(_job.image_shape(job, p.dim, p.channels)), p.display)
        return bool(callback(Iteration(it.iteration, it.loss, it.best, p.params,
                                       Gradient(p._layouts, gradient, None, names), image)))

    drawing = {q._handle: q for q in (p, *(v["program"] for v in views or () if v.get("program") is not None))}
    if own:
        o.loss = _abi.SltFitLoss(guarded(lost, _abi.SLT_INTERRUPTED))
        o.loss_name = c_string(getattr(loss, "__qualname__", "loss"), "the name of the loss")
    o.iterated = _abi.SltFitIterated(guarded(iterated, True))
    result, error = initial(_abi.SltFitResult), _abi.SltError()
    with contextlib.ExitStack() as locks:
        for handle in sorted(drawing):  # in one order everywhere: two fits do not wait for each other
            locks.enter_context(drawing[handle]._lock)
        p._set_wrt(p._wrt if wrt is None else _names(wrt))
        names = p._differentiated()
        for q in drawing.values():
            q._store()
        interrupt = _Interrupt(p._running, job, None)
        try:
            status = lib.slt_fit(p._handle, ctypes.byref(o), ctypes.byref(result), ctypes.byref(error))
        finally:
            interrupt.end()
            bar.end()
            for q in drawing.values():
                if q is not p:
                    q._wrt_now = UNKNOWN  # it was the fit's
        p._fetch()
        p._stats = stats
    losses = np.empty(0)
    if result.losses:
        losses = np.ctypeslib.as_array((ctypes.c_double * result.iterations).from_address(result.losses)).copy()
        free(result.losses)
    interrupt.again(status == _abi.SLT_OK)
    if result.stop != _abi.SLT_FIT_TIME_LIMIT:
        raise_for(status, error)
    p._tell()
    p._warn(stats)
    return FitResult(result.initial_loss, result.loss, losses, result.iterations, STOPS.get(result.stop, "failed"),
                     text(result.reason), time.monotonic() - begun)


