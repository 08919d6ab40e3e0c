"""Programs: compiled shaders, their parameters, and what can be estimated of them."""
from __future__ import annotations

import ctypes
import json
import os
import signal
import sys
import threading
import warnings
import weakref
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _abi, _command, _job
from ._errors import CompileError, Diagnostic, SaltusWarning, UsageError, c_path, c_string, error_of, raise_for
from ._images import Image, as_image, empty, floats32, read_image
from ._library import free, initial, lib, text
from ._values import Gradient, Layout, Params, Record, Values, layouts_of

if TYPE_CHECKING:
    from ._fit import FitResult, Iteration

_SEVERITIES = {1: "error", 2: "warning"}
_STATS = bytes(initial(_abi.SltStats))
_TARGETS = ("native", "avx512", "avx2", "sse2")
_LANGUAGES = {"salt": _abi.SLT_LANGUAGE_SALTUS, "glsl": _abi.SLT_LANGUAGE_GLSL}
_FIELDS = {"mipmap": _abi.SLT_STRUCTURE_MIPMAP, "cone": _abi.SLT_STRUCTURE_CONE, "naive": _abi.SLT_STRUCTURE_NAIVE}
_NEAR_MISS = {"auto": -1, "off": 0, "on": 1}
UNKNOWN = ("",)  # as names of what is differentiated: others decided it
IMAGES_MAX = 64  # derivative images of one call


def _place(at: _abi.SltPlace) -> str:
    return f"{text(at.file)}:{at.line}:{at.column}" if at.file else ""


class Stats:
    """Counts of the last call: ``samples``, ``segments``, ``crossings``, ``evaluations``, ``seconds`` and the other
    members of SltStats (docs/library.md), places as "disc.salt:9:17". All of it is copied: what the library says is
    gone with its program."""

    def __init__(self, raw: _abi.SltStats):
        names = (ctypes.c_char_p * _abi.SLT_DROP_REASONS).in_dll(lib, "slt_drop_names")
        #: Crossings that were left out, by reason.
        self.dropped: dict[str, int] = {text(name): n for name, n in zip(names, raw.dropped) if n}
        #: By code: what the result does not say, as sentences. ``saltus explain CODE`` explains.
        self.warnings: dict[str, str] = {}
        one = initial(_abi.SltWarning)
        while lib.slt_warning(ctypes.byref(raw), len(self.warnings), ctypes.byref(one)):
            self.warnings[text(one.code)] = (_place(one.at) + ": " if one.at.file else "") + text(one.text)
        self._counts: dict[str, Any] = {}
        for name, _ in raw._fields_:
            if name not in ("struct_size", "dropped", "dropped_at"):
                value = getattr(raw, name)
                self._counts[name] = _place(value) if isinstance(value, _abi.SltPlace) else value
        self._counts["dropped_at"] = {text(name): _place(at) for name, at in zip(names, raw.dropped_at) if at.file}

    def __getattr__(self, name) -> Any:
        if name.startswith("_") or name not in self._counts:
            raise AttributeError(f"there is no count `{name}`")
        return self._counts[name]

    def __repr__(self):
        return (f"Stats(samples={self.samples}, segments={self.segments}, crossings={self.crossings}, "
                f"evaluations={self.evaluations}, seconds={self.seconds:.3g})")


@dataclass
class Integral:
    """The integral over the domain and its derivatives; c is the number of channels.

    Arrays of a gradient have the shape of the parameter and then c: ``r.gradient["centre"]`` is (2, c)."""
    value: np.ndarray  #: (c,)
    value_stderr: np.ndarray  #: (c,): standard errors
    gradient: Gradient
    stderr: Gradient  #: standard errors of the gradient, of every part of the error
    interior: Gradient  #: the smooth part
    boundary: Gradient  #: the part of the moving jumps
    missed_estimate: Gradient  #: what lines are thought to have missed: not in the gradient, but in its error
    certified: float  #: share of the domain where every jump is proven to be integrated; NaN: nothing was proven
    stderr_kind: str  #: "replicates", "bound", "quadrature" or "mixed", as the command prints it


@dataclass
class Crossing:
    """Where f jumps on a segment from a to b."""
    found: bool
    x: np.ndarray  #: (dim,)
    t: float  #: x = a + t (b - a)
    g: float  #: the boundary function there, nearly 0
    dg: np.ndarray  #: (dim,): its gradient in x
    f_before: np.ndarray  #: (channels,): f on the side of a
    f_after: np.ndarray  #: (channels,): on that of b
    site: int
    drop: str | None  #: why it would not be integrated; None: it would


@dataclass
class Bound:
    """What is proven of a box: interval arithmetic, never wrong and not always tight."""
    settled: bool  #: every decision goes one way on it
    lo: np.ndarray  #: (channels,): f is not below this
    hi: np.ndarray  #: (channels,): nor above this
    open: int  #: events that may decide either way
    rough: bool
    unknown: bool


@_abi.SltJobProgress
def _breathe(user, fraction):
    """A progress callback for nothing but that Python runs, and with it the handlers of signals."""


class _Running:
    """The call that uses a program now, for the callbacks of the program itself."""
    call: _Interrupt | None = None


class _Interrupt:
    """Ctrl-C while a call runs: the handler sets what job.cancel points at. A handler runs between two instructions of
    Python, which is why such a call has a progress callback; it belongs to the main thread, which others need not.

    The job refers to this object and this object not to the job: without a cycle all is freed when the call is over."""

    def __init__(self, running, job, progress):
        self.flag, self.user, self.raised, self.hit = ctypes.c_int(0), progress, None, False
        self.running, self.outer, running.call = running, running.call, self
        job.cancel = ctypes.addressof(self.flag)
        self.old = None
        if threading.current_thread() is threading.main_thread() and callable(signal.getsignal(signal.SIGINT)):
            self.old = signal.signal(signal.SIGINT, self.on_signal)
        if progress:
            job.progress = _abi.SltJobProgress(self.on_progress)
        elif self.old:
            job.progress = _breathe

    def on_signal(self, number, frame):
        self.hit, self.flag.value = True, 1

    def on_progress(self, user, fraction):
        if self.user and not self.flag.value:
            try:
                self.user(fraction)
            except BaseException as error:
                self.stop(error)

    def stop(self, error: BaseException):
        """Ends the call, which raises the first of these then."""
        self.raised, self.flag.value = self.raised or error, 1

    def end(self):
        self.running.call = self.outer
        if self.old:
            signal.signal(signal.SIGINT, self.old)

    def again(self, done: bool):
        """What a Ctrl-C or a callback's exception should do, now that the call is over; done: it has a result."""
        error, self.raised = self.raised, None  # whose traceback leads back here
        try:
            if self.hit:
                self.old(signal.SIGINT, sys._getframe(1))
            if error:
                raise error
            if self.hit and not done:
                raise KeyboardInterrupt
        finally:
            del error


def _text_of(value) -> str:
    """A value as slt_set_text takes it."""
    if isinstance(value, str):
        return value
    def plain(v):
        if isinstance(v, Mapping):
            return {k: plain(x) for k, x in v.items()}
        return np.asarray(v).tolist()
    return json.dumps(plain(value))


def _sets(pairs: Mapping) -> tuple[Any, int, list]:
    """An array of SltSet, its length, and what keeps it alive."""
    kept = [(c_string(str(name), "a name"), c_string(_text_of(value), f"the value of {name}")) for name, value in
            pairs.items()]
    array = (_abi.SltSet * len(kept))(*[_abi.SltSet(name, value) for name, value in kept])
    return array, len(kept), kept


def _is_source(source) -> bool:
    return isinstance(source, str) and any(c in source for c in "{;\n")


def compile(source: str | os.PathLike, *, set: Mapping[str, Any] | None = None, params: Mapping[str, Any] | None = None,
            entry: str | None = None, import_dirs: Iterable[str | os.PathLike] = (), precision: str = "f32",
            language: str | None = None, disc: str = "tagged", near_miss: str = "auto", seed: int = 0, width: int = 0,
            target: str | None = None, interpret: bool = False, cache: bool = True, field: str | None = None,
            sandbox: bool = False, size: int | tuple[int, int] | None = None, name: str | None = None) -> Program:
    """Compiles a shader: a file, or the source itself (a string with a brace, a semicolon or more than one line).

    set: values of constants at file scope, ``{"N": 12}`` or ``{"module.N": 12}``
    params: values of parameters to begin with; arrays and files ("@dem.exr") also decide the length of open arrays, the size
        of textures and heightfields
    entry: which shader (main, or the only one)
    precision: "f32" or "f64", of ``float``
    language: "salt" or "glsl" (by the file's extension)
    disc: "tagged", or "auto": every comparison counts as [Disc]
    sandbox: the source is not trusted: it names files below its own folder only
    size: (width, height) that a GLSL shader is for
    name: what diagnostics call a source

    The other options are those of the command, by the same names. Raises CompileError, whose text shows the lines and
    ``diagnostics`` lists what is wrong; InputError: there is no such file; UsageError: unknown entry or constant."""
    options = initial(_abi.SltOptions)
    kept: list = []

    def encoded(value, what):
        return None if value is None else c_string(value, what)

    options.entry = encoded(entry, "the entry")
    options.set, options.nset = _point(kept, set or {})
    values = dict(params or {})
    files = {k: v[1:] for k, v in values.items() if isinstance(v, str) and v.startswith("@")}
    options.param_files, options.nparam_files = _point(kept, files)
    lengths = {k: n for k, n in ((k, _sizes(v)) for k, v in values.items()) if n is not None}
    options.lengths = json.dumps(lengths).encode() if lengths else None
    folders = [c_path(d) for d in import_dirs]
    array = (ctypes.c_char_p * len(folders))(*folders)
    kept.append(array)
    options.import_dirs, options.nimport_dirs = ctypes.addressof(array), len(folders)
    options.f64 = bool(_job.choice("precision", precision, {"f32": 0, "f64": 1}))
    options.disc_auto = bool(_job.choice("disc", disc, {"tagged": 0, "auto": 1}))
    options.near_miss = _job.choice("near_miss", near_miss, _NEAR_MISS)
    options.language = _job.choice("language", language, _LANGUAGES) if language else _abi.SLT_LANGUAGE_AUTO
    options.field = _job.choice("field", field, _FIELDS) if field else _abi.SLT_STRUCTURE_AUTO
    options.target = encoded(target and _job.choice("target", target, dict(zip(_TARGETS, _TARGETS))), "the target")
    options.seed = _job.whole("seed", seed, 0, 0xffffffff)
    options.width = _job.whole("width", width, 0, 64)
    options.interpret, options.no_cache, options.sandbox = bool(interpret), not cache, bool(sandbox)
    if size is not None:
        options.size[:] = _job.make_job(2, size, {}).size[:2]
    handle = ctypes.c_void_p()
    if _is_source(source):
        status = lib.slt_compile_string(c_string(source, "the source"), encoded(name, "the name"), ctypes.byref(options), ctypes.byref(handle))
    else:
        status = lib.slt_compile_file(c_path(source), ctypes.byref(options), ctypes.byref(handle))
    if status != _abi.SLT_OK:
        try:
            said = text(lib.slt_diagnostics_text(handle)).rstrip()
            message = said or text(lib.slt_last_error(handle)) or f"status {status}"
            if status == _abi.SLT_PROGRAM:
                raise CompileError(message, _diagnostics(handle))
            raise error_of(status, message)
        finally:
            lib.slt_program_free(handle)
    command = _command.Origin(source, _is_source(source), name, dict(
        set=set or {}, entry=entry, import_dirs=[os.fspath(d) for d in import_dirs], precision=precision, lang=language,
        disc=disc, near_miss=near_miss, field=field, width=width or None, target_cpu=target, sandbox=sandbox,
        interpret=interpret, no_cache=not cache, size=tuple(options.size) if size is not None else None))
    program = Program(handle, command)
    for key, value in values.items():
        program.params[key] = value
    return program


def load(path: str | os.PathLike, **constants) -> Program:
    """`compile` of a file, with constants by name: ``saltus.load("discs.salt", N=200)``. What is an option of `compile`
    is that option; a constant of such a name goes into ``set=``."""
    options = {k: constants.pop(k) for k in list(constants) if k in compile.__kwdefaults__}
    options["set"] = {**(options.get("set") or {}), **constants}
    return compile(os.fspath(path) if not isinstance(path, os.PathLike) else path, **options)


def _point(kept, pairs):
    array, n, alive = _sets(pairs)
    kept.extend((array, alive))
    return ctypes.addressof(array), n


def _sizes(value) -> list | None:
    """Of a list, an array, text of a list, or a mapping of fields to such: a list as long, of which the first element is
    such a list again where that of the value is one."""
    if isinstance(value, str):
        try:
            value = json.loads(value)
        except ValueError:
            return None
    if isinstance(value, Mapping):
        found = [n for n in map(_sizes, value.values()) if n is not None]
        return max(found, key=len) if found else None
    try:
        n = len(value)
    except TypeError:
        return None
    first = _sizes(value[0]) if n and hasattr(value, "__getitem__") else None
    return [0 if first is None else first] * min(n, 1) + [0] * (n - 1)


def _diagnostics(handle, first=0) -> list[Diagnostic]:
    found, one = [], initial(_abi.SltDiagnostic)
    for i in range(first, lib.slt_diagnostic_count(handle)):
        if lib.slt_diagnostic(handle, i, ctypes.byref(one)):
            found.append(Diagnostic(_SEVERITIES.get(one.severity, "information"), text(one.code), text(one.message),
                                    text(one.file), one.line, one.column))
    return found


class Program:
    """A compiled shader. ``p.params["radius"]``, or ``p["radius"]``, are its parameters, as arrays without a copy.

    Estimating methods take, by name, the options of the command: spp, segments, seed, threads, filter ("box", "tent",
    "gaussian"), estimator, interior, exact, error, abs_error, samples, time_limit and the others of docs/python.md;
    ``params={"radius": 0.3}``: values for this call alone; ``progress``: called with a fraction from 0 to 1.

    Several threads may use a program, one at a time: a lock sees to it. Calls release the GIL. After a fork only the
    process that compiled a program should use it."""

    def __init__(self, handle, origin):
        """Use `compile` or `load`."""
        self._handle = handle.value
        self._free = weakref.finalize(self, lib.slt_program_free, self._handle)
        self._lock = threading.RLock()
        self._origin = origin
        self._told, self._warned = 0, set()
        self._wrt_now: tuple[str, ...] | None = None  # what the library differentiates
        self._names_now: list[str] = []  # the parameters in it, found for _names_of
        self._names_of: tuple[str, ...] | None = UNKNOWN
        self._wrt: tuple[str, ...] | None = None
        self._stats = _abi.SltStats.from_buffer_copy(_STATS)
        self._print = None
        self._running = _Running()
        self.dim: int = lib.slt_dim(handle)  #: axes of the domain, 1 to 3
        self.channels: int = lib.slt_channels(handle)  #: 1 to 4
        self.entry: str = text(lib.slt_entry(handle))
        self.display: bool = lib.slt_is_display(handle)  #: colours are encoded for a screen already
        self.sites: int = lib.slt_site_count(handle)  #: places under [Disc] that may jump
        self.uses_rand: bool = lib.slt_uses_rand(handle)
        lo, hi = (ctypes.c_double * 3)(), (ctypes.c_double * 3)()
        lib.slt_domain(handle, lo, hi)
        #: (lo, hi), arrays (dim,)
        self.domain = np.array(lo[:self.dim]), np.array(hi[:self.dim])
        self._layouts: dict[str, Layout] = layouts_of(handle)
        self._floats = np.empty(lib.slt_float_count(handle))
        self._ints = np.empty(lib.slt_int_count(handle), np.int32)
        self._fetch()
        self._params = _ProgramParams(self._layouts, self._floats, self._ints)
        self._params._program = weakref.ref(self)
        self._tell()

    # ---- parameters

    @property
    def params(self) -> Params:
        """The parameters by name; see `Params`."""
        return self._params

    def __getitem__(self, name: str):
        return self._params[name]

    def __setitem__(self, name: str, value):
        self._params[name] = value

    @property
    def wrt(self) -> Any:  # checkers have no setter of another type than the getter
        """Which parameters or components are differentiated, ``["discs[*].centre", "ink"]``; None: all that can be.
        What is left out costs nothing. Calls that differ in it may take turns (`jvp` is of what its direction names): what
        was compiled for the last five is kept. With more, derivatives are compiled at each turn, and memory is kept until
        the program goes."""
        return self._wrt

    @wrt.setter
    def wrt(self, names: str | Iterable[str] | None):
        names = _names(names)
        with self._lock:
            self._set_wrt(names)
            self._wrt = names

    def _set_wrt(self, names):
        if names == self._wrt_now:
            return
        error = _abi.SltError()
        array = (ctypes.c_char_p * len(names or ()))(*[c_string(n, "wrt") for n in names or ()])
        raise_for(lib.slt_wrt(self._handle, array if names else None, len(names or ()), ctypes.byref(error)), error)
        self._wrt_now = names

    def _fetch(self):
        """The library's values into the arrays."""
        for array, at in ((self._floats, lib.slt_floats), (self._ints, lib.slt_ints)):
            if array.size:
                ctypes.memmove(array.ctypes.data, at(self._handle), array.nbytes)

    def _store(self):
        """The arrays' values into the library, for what takes its own."""
        error = _abi.SltError()
        if self._floats.size:
            raise_for(lib.slt_set_floats(self._handle, 0, self._floats.size, self._floats.ctypes.data,
                                         ctypes.byref(error)), error)
        if self._ints.size:
            raise_for(lib.slt_set_ints(self._handle, 0, self._ints.size, self._ints.ctypes.data, ctypes.byref(error)), error)

    def _set_text(self, name, value):
        error = _abi.SltError()
        with self._lock:
            self._store()
            raise_for(lib.slt_set_text(self._handle, c_string(name, "a name"), c_string(value, f"the value of {name}"),
                                       ctypes.byref(error)), error)
            self._fetch()

    def params_json(self) -> str:
        """All parameters as the JSON that ``saltus fit`` writes and ``--params`` reads."""
        with self._lock:
            self._store()
            at = lib.slt_params_json(self._handle)
            if not at:
                raise MemoryError("no memory for the parameters as text")
            try:
                return ctypes.string_at(at).decode()
            finally:
                free(at)

    def set_params_json(self, source: str | os.PathLike):
        """Sets parameters from such JSON, or from a file of it (a path, or a string without a brace)."""
        if isinstance(source, os.PathLike) or "{" not in source:
            shown = os.fspath(source)
            try:
                with open(source, encoding="utf-8") as file:
                    source = file.read()
            except OSError as wrong:
                raise error_of(_abi.SLT_INPUT, f"{shown}: {wrong.strerror}") from None
        else:
            shown = "parameters"
        error = _abi.SltError()
        with self._lock:
            self._store()
            raise_for(lib.slt_set_params_json(self._handle, c_string(source, "the parameters"), c_path(shown),
                                              ctypes.byref(error)), error)
            self._fetch()

    def mesh(self, name: str) -> dict[str, np.ndarray]:
        """What a parameter that is a mesh is made of, beside its vertices: faces (n, 3) and parts (n,)."""
        for i, found in enumerate(self._layouts):
            if found == name:
                n, uv = ctypes.c_uint32(), ctypes.c_bool()
                at = lib.slt_mesh(self._handle, i, ctypes.byref(n), ctypes.byref(uv))
                if not at:
                    raise UsageError(f"{name} is no mesh")
                ints = np.ctypeslib.as_array(ctypes.cast(at, ctypes.POINTER(ctypes.c_int32)), (4 * n.value,)).copy()
                return {"faces": ints[:3 * n.value].reshape(-1, 3), "parts": ints[3 * n.value:]}
        raise UsageError(f"there is no parameter `{name}`")

    # ---- calls

    def _call(self, function, job, *arguments, progress=None, params=None, wrt=None, derivatives=False, counts=True):
        """Runs an estimating function: function(program, job, *arguments, stats, error), without stats if nothing counts."""
        floats, ints = self._lent(params)
        job.floats, job.ints = floats.ctypes.data, ints.ctypes.data
        stats, error = _abi.SltStats.from_buffer_copy(_STATS), _abi.SltError()
        with self._lock:
            if derivatives:
                self._set_wrt(self._wrt if wrt is None else _names(wrt))
            interrupt = _Interrupt(self._running, job, progress)
            try:
                status = function(self._handle, ctypes.byref(job), *arguments, *(ctypes.byref(stats),)[:counts],
                                  ctypes.byref(error))
            finally:
                interrupt.end()
            if counts:
                self._stats = stats
        interrupt.again(status == _abi.SLT_OK)
        if status == _abi.SLT_PROGRAM:
            raise CompileError(text(lib.slt_diagnostics_text(self._handle)) or text(error.text), self.diagnostics)
        raise_for(status, error)
        self._tell()
        self._warn(stats)

    def _lent(self, params):
        """The numbers of a call. Floats are read when it begins, integers as long as it runs: those are a copy, which no
        other thread changes."""
        if not params:
            return self._floats, self._ints.copy()
        if not isinstance(params, Mapping):
            raise UsageError(f"params is a mapping of names to values, not {type(params).__name__}")
        floats, ints = self._floats.copy(), self._ints.copy()
        values = Params(self._layouts, floats, ints)
        for name, value in params.items():
            values[name] = value
        return floats, ints

    def _tell(self):
        """Warns of diagnostics that are new: some come when kernels are made."""
        with self._lock:
            if lib.slt_diagnostic_count(self._handle) == self._told:
                return
            new = _diagnostics(self._handle, self._told)
            self._told += len(new)
        for one in new:
            if one.severity == "warning":
                warnings.warn(SaltusWarning(str(one)), stacklevel=_outside())

    def _warn(self, raw):
        one = initial(_abi.SltWarning)
        if not lib.slt_warning(ctypes.byref(raw), 0, ctypes.byref(one)):
            return
        for code, said in Stats(raw).warnings.items():
            if code not in self._warned:  # a loop says it once
                self._warned.add(code)
                warnings.warn(SaltusWarning(f"{said} (`saltus explain {code}`)" if "`saltus explain" not in said else said),
                              stacklevel=_outside())

    @property
    def stats(self) -> Stats:
        """Counts of the last call."""
        return Stats(self._stats)

    @property
    def diagnostics(self) -> list[Diagnostic]:
        """What the compiler said."""
        return _diagnostics(self._handle)

    def _out(self, out, shape):
        """Where the library writes, and what gets a copy of that behind the call (None: nothing)."""
        if out is None:
            return as_image(empty(shape), self.display), None
        if not isinstance(out, np.ndarray) or out.dtype.kind != "f":
            raise UsageError(f"out is an array of floats, not {getattr(out, 'dtype', type(out).__name__)}")
        if out.shape != shape and out.shape + (1,) != shape:
            raise UsageError(f"out has the shape {out.shape}, and the image {shape}")
        if not out.flags.writeable:
            raise UsageError("out cannot be written to")
        if out.dtype == np.float32 and out.dtype.isnative and out.flags.c_contiguous and out.flags.aligned:
            return out, None
        return empty(shape), out

    def render(self, size: int | tuple[int, ...] | None = None, *, out: np.ndarray | None = None, params=None,
               progress: Callable[[float], Any] | None = None, **options) -> Image:
        """The image: float32 (height, width, channels), a curve (width, channels), a volume (depth, height, width,
        channels). size: one number for all axes, or (width, height, depth) (default 512; of volumes 64).
        out: written in place if it is C-ordered float32, else through a copy."""
        job = _job.make_job(self.dim, size, options)
        image, copy = self._out(out, _job.image_shape(job, self.dim, self.channels))
        self._call(lib.slt_render, job, image.ctypes.data, progress=progress, params=params)
        if copy is None:
            return image
        copy[...] = image.reshape(copy.shape)
        return copy

    def eval(self, x, *, streams=None, params=None, progress=None, **options) -> np.ndarray:
        """f at points: x (..., dim), of a program in 1D also a number or (n,). Returns float64 (..., channels). rand()
        depends on `seed` and on the point's stream, an integer (...) below 2^32 (default: its number)."""
        x = _job.numbers("x", x).astype(np.float64, copy=False)
        points = x[..., None] if self.dim == 1 and x.ndim < 2 else x
        if points.ndim == 0 or points.shape[-1] != self.dim:
            raise UsageError(f"x has the shape {x.shape}, and the points of this program (..., {self.dim})")
        points = np.ascontiguousarray(points)
        n = points.size // self.dim
        if streams is not None:
            streams = np.asarray(streams)
            if streams.dtype.kind not in "iu" or streams.size != n:
                raise UsageError(f"streams are {n} integers, one a point")
            if n and (streams.min() < 0 or streams.max() > 0xffffffff):
                raise UsageError("streams are from 0 to 4294967295")
            streams = np.ascontiguousarray(streams, np.uint32)
        out = empty(points.shape[:-1] + (self.channels,), np.float64)
        job = _job.make_job(self.dim, None, options)
        self._call(lib.slt_eval, job, n, points.ctypes.data, None if streams is None else streams.ctypes.data,
                   out.ctypes.data, progress=progress, params=params)
        return out

    def integral(self, samples: int = 1 << 18, *, wrt=None, params=None, progress=None, **options) -> Integral:
        """The integral over the domain and its derivative with respect to every parameter. samples: in all, where cells
        do not do it; ``error=1e-6`` refines until the stated error is below that part of the largest component."""
        job = _job.make_job(self.dim, None, {"samples": samples, **options})
        job.integral = True
        n, c = self._floats.size, self.channels
        value, value_stderr = np.empty(c), np.empty(c)
        parts = {name: np.zeros((c, n)) for name in ("gradient", "gradient_stderr", "interior", "boundary",
                                                     "missed_estimate")}
        result = initial(_abi.SltIntegral)
        result.value, result.value_stderr = value.ctypes.data, value_stderr.ctypes.data
        for name, array in parts.items():
            setattr(result, name, array.ctypes.data)
        with self._lock:
            self._call(lib.slt_grad_integral, job, ctypes.byref(result), params=params, progress=progress, wrt=wrt,
                       derivatives=True)
            names, stats = self._differentiated(), self._stats
        shaped = {k: Gradient(self._layouts, v, None, names, c) for k, v in parts.items()}
        kind = "replicates" if result.replicates else "bound"
        if stats.cells:
            kind = "mixed" if result.mixed else "quadrature"
        return Integral(value, value_stderr, shaped["gradient"], shaped["gradient_stderr"], shaped["interior"],
                        shaped["boundary"], shaped["missed_estimate"],
                        stats.certified if stats.cells else float("nan"), kind)

    def _differentiated(self) -> list[str]:
        """Parameters of which something is differentiated now."""
        if self._names_of != self._wrt_now:
            self._names_now, self._names_of = self._find_differentiated(), self._wrt_now
        return self._names_now

    def _find_differentiated(self):
        n = self._floats.size
        if not n:
            return []
        mask = np.ctypeslib.as_array(ctypes.cast(lib.slt_wrt_mask(self._handle), ctypes.POINTER(ctypes.c_uint8)), (n,))
        mask = mask.astype(np.float64)

        def any_of(view):
            return any(map(any_of, view.values())) if isinstance(view, Record) else bool(np.any(view))
        return [name for name, layout in self._layouts.items()
                if layout.holds_floats and any_of(layout.view(mask, None))]

    def vjp(self, adjoint, *, stderr: bool = False, wrt=None, params=None, progress=None, **options) -> Gradient:
        """The gradient of the sum of adjoint * image: adjoint has the shape of the image, (height, width, channels), any
        dtype and strides. Any loss is chained by it; let the image of the loss and this derivative have different
        seeds. stderr: also upper bounds of the standard errors, as ``.stderr``."""
        given = np.asarray(adjoint)
        shape = given.shape if given.ndim == self.dim + 1 else given.shape + (1,) * (self.channels == 1)
        if len(shape) != self.dim + 1 or shape[-1] != self.channels:
            raise UsageError(f"the adjoint has the shape {given.shape}, and images of this program "
                             f"{('depth, ', '')[self.dim < 3]}{('height, ', '')[self.dim < 2]}width, {self.channels}")
        given = floats32(given, "the adjoint", shape)
        job = _job.make_job(self.dim, tuple(reversed(shape[:-1])), options)
        gradient = np.zeros(self._floats.size)
        bound = np.zeros(self._floats.size) if stderr else None
        with self._lock:
            self._call(lib.slt_grad_adjoint, job, given.ctypes.data, gradient.ctypes.data,
                       None if bound is None else bound.ctypes.data, params=params, progress=progress, wrt=wrt, derivatives=True)
            names = self._differentiated()
        return self._gradient(gradient, bound, names)

    grad = vjp

    def jvp(self, direction: Mapping[str, Any], size: int | tuple[int, ...] | None = None, *, out=None, params=None,
            progress=None, **options) -> Image:
        """The derivative of the image along a direction, ``{"radius": 1.0}``; parameters that it does not name stay."""
        if not direction:
            raise UsageError("the direction names no parameter")
        directions = np.zeros(self._floats.size)
        tangent = Params(self._layouts, directions, None, [n for n, l in self._layouts.items() if l.holds_floats])
        for name, value in direction.items():
            tangent[name] = value
        job = _job.make_job(self.dim, size, options)
        image, copy = self._out(out, _job.image_shape(job, self.dim, self.channels))
        self._images(job, directions[None], image[None], params, progress, tuple(direction), None)
        if copy is None:
            return as_image(image, self.display, True) if out is None else image
        copy[...] = image.reshape(copy.shape)
        return copy

    def grad_images(self, wrt: str | Iterable[str] | None = None, size: int | tuple[int, ...] | None = None, *,
                    crossings: bool = False, params=None, progress=None, **options) -> dict[str, Any]:
        """Derivative images by name: of a float (height, width, channels), of a float2 (2, height, width, channels), of
        structs a dict of their fields; at most 64 in all. wrt: parameters or components, ``"discs[3].centre"`` (default:
        ``p.wrt``). crossings: also ``"crossings"``, (height, width), how many each pixel has."""
        names = _names(wrt) or self._wrt or tuple(n for n, l in self._layouts.items()
                                                  if l.holds_floats and l.info.differentiable)
        number = Values(self._layouts, np.arange(float(self._floats.size)), None,
                        [n for n, l in self._layouts.items() if l.holds_floats])
        try:
            wanted = {name: number[name] for name in names}
        except KeyError as wrong:
            raise UsageError(wrong.args[0]) from None
        rows: dict[int, int] = {}

        def count(view):
            for v in view.values() if isinstance(view, Record) else ():
                count(v)
            if not isinstance(view, Record):
                for i in view.reshape(-1):
                    rows.setdefault(int(i), len(rows))
        for view in wanted.values():
            count(view)
        if not 0 < len(rows) <= IMAGES_MAX:
            raise UsageError(f"{len(rows)} derivative images, and a call makes 1 to {IMAGES_MAX}: name fewer components "
                             "in wrt, or take `vjp` of a loss")
        job = _job.make_job(self.dim, size, options)
        shape = _job.image_shape(job, self.dim, self.channels)
        directions = np.zeros((len(rows), self._floats.size))
        for i, row in rows.items():
            directions[row, i] = 1
        images = empty((len(rows),) + shape)
        counted = np.zeros(shape[:-1], np.float32) if crossings else None
        self._images(job, directions, images, params, progress, names, counted)

        def pick(view):
            if isinstance(view, Record):
                return {k: pick(v) for k, v in view.items()}
            return as_image(images[np.vectorize(lambda i: rows[int(i)], otypes=[int])(view)], self.display, True)
        found = {name: pick(view) for name, view in wanted.items()}
        if crossings:
            found["crossings"] = counted
        return found

    def _images(self, job, directions, images, params, progress, wrt, crossings):
        n = len(directions)
        dirs = (ctypes.c_void_p * n)(*[d.ctypes.data for d in directions])
        outs = (ctypes.c_void_p * n)(*[i.ctypes.data for i in images])
        self._call(lib.slt_grad_images, job, n, dirs, outs, None if crossings is None else crossings.ctypes.data,
                   params=params, progress=progress, wrt=wrt, derivatives=True)

    def loss(self, target, *, mask=None, stderr: bool = False, wrt=None, params=None, progress=None,
             **options) -> tuple[float, Gradient]:
        """The mean over pixels and channels of mask * (image - target)^2, and its gradient, which is not biased: image and
        derivative have samples of their own. target: an image, or a file, at its own size. stderr: as of `vjp`."""
        target = self._target(target, None)
        job = _job.make_job(self.dim, tuple(reversed(target.shape[:-1])), options)
        mask = None if mask is None else self._mask(mask, target.shape)
        value, gradient = ctypes.c_double(), np.zeros(self._floats.size)
        bound = np.zeros(self._floats.size) if stderr else None
        with self._lock:
            self._call(lib.slt_grad_loss, job, target.ctypes.data, None if mask is None else mask.ctypes.data,
                       ctypes.byref(value), gradient.ctypes.data, None if bound is None else bound.ctypes.data, None,
                       params=params, progress=progress, wrt=wrt, derivatives=True)
            names = self._differentiated()
        return value.value, self._gradient(gradient, bound, names)

    def _gradient(self, gradient, bound, names) -> Gradient:
        result = Gradient(self._layouts, gradient, None, names)
        result.stderr = None if bound is None else Gradient(self._layouts, bound, None, names)
        return result

    def _target(self, target, size):
        """float32 (height, width, channels): an array as it is, a file at this size."""
        if isinstance(target, (str, os.PathLike)):
            if self.dim == 3:
                raise UsageError("the target of a volume is an array (depth, height, width, channels)")
            box = (size, size) if isinstance(size, int) else tuple(size)[:2] if size is not None else None
            image = np.asarray(read_image(target, box, channels=self.channels, display=self.display))
            return np.ascontiguousarray(image if self.dim == 2 else image[0])
        target = np.asarray(target)
        shape = target.shape if target.ndim == self.dim + 1 else target.shape + (1,) * (self.channels == 1)
        if len(shape) != self.dim + 1 or shape[-1] != self.channels:
            raise UsageError(f"the target has the shape {target.shape}, and images of this program end in {self.channels} "
                             "channels")
        return floats32(target, "the target", shape).reshape(shape)

    def _mask(self, mask, shape):
        mask = np.asarray(mask)
        if mask.shape == shape[:-1]:
            mask = mask[..., None]
        if mask.shape == (*shape[:-1], 1):
            mask = np.broadcast_to(mask, shape)
        return floats32(mask, "the mask", shape)

    def crossing(self, a, b, *, stream: int = 0, params=None) -> Crossing:
        """The crossing nearest to a on the segment from a to b, points (dim,)."""
        ends = [_job.numbers(name, e).astype(np.float64, copy=False).reshape(-1) for e, name in ((a, "a"), (b, "b"))]
        if any(e.size != self.dim for e in ends):
            raise UsageError(f"points of this program have {self.dim} coordinates")
        a, b = ((ctypes.c_double * 3)(*e) for e in ends)
        job, out = _job.make_job(self.dim, None, {}), initial(_abi.SltCrossing)
        self._call(lib.slt_crossing, job, a, b, _job.whole("stream", stream, 0, 0xffffffff), ctypes.byref(out),
                   params=params, counts=False)
        names = (ctypes.c_char_p * _abi.SLT_DROP_REASONS).in_dll(lib, "slt_drop_names")
        return Crossing(out.found, np.array(out.x[:self.dim]), out.t, out.g, np.array(out.dg[:self.dim]),
                        np.array(out.f_before[:self.channels]), np.array(out.f_after[:self.channels]), out.site,
                        text(names[out.drop]) if out.drop >= 0 else None)

    def bound(self, lo, hi, *, params=None) -> list[Bound]:
        """What is proven of boxes with corners lo and hi, (n, dim) or (dim,)."""
        lo, hi = (np.ascontiguousarray(np.atleast_2d(_job.numbers("a corner", v).astype(np.float64, copy=False))) for v in (lo, hi))
        if lo.shape != hi.shape or lo.shape[-1] != self.dim:
            raise UsageError(f"corners have the shape (n, {self.dim})")
        out = (_abi.SltBound * len(lo))(*[initial(_abi.SltBound) for _ in lo])
        self._call(lib.slt_bound, _job.make_job(self.dim, None, {}), len(lo), lo.ctypes.data, hi.ctypes.data, out,
                   params=params, counts=False)
        return [Bound(b.settled, np.array(b.lo[:self.channels]), np.array(b.hi[:self.channels]), b.count, b.rough, b.unknown)
                for b in out]

    def set_print(self, function: Callable[[str], Any] | None = print):
        """Who gets the lines that shaders print(); None: nobody. Called by any thread of an estimate; what it raises ends
        the estimate, which raises it."""
        if function is not None and not callable(function):
            raise UsageError(f"what gets lines is a function or None, not {function!r}")
        running = self._running

        def printed(user, line, values, n):
            call = running.call
            if call and call.raised:
                return
            try:
                function(text(line))
            except BaseException as error:
                if not call:
                    raise  # a callback of ctypes: Python prints it and goes on
                call.stop(error)
        callback = _abi.SltPrint(printed) if function else _abi.SltPrint(0)
        error = _abi.SltError()
        with self._lock:
            raise_for(lib.slt_set_print(self._handle, callback, None, ctypes.byref(error)), error)
            self._print = callback

    # ---- more

    def fit(self, target=None, *, wrt=None, iters: int = 200, lr: float | Mapping[str, float] | None = None,
            optimizer: str = "adam", mask=None, views: Sequence[Mapping[str, Any]] | None = None, minimize: bool = False,
            loss: str | Callable = "l2", loss_entry: str | None = None, smooth: Mapping[str, float] | None = None,
            smooth_faces: Mapping[str, str] | None = None, smooth_grids: Mapping[str, str] | None = None,
            lr_masks: Mapping[str, Any] | None = None, schedule: str = "constant",
            callback: Callable[[Iteration], Any] | None = None, progress: bool | None = None, size=None,
            checkpoint: str | os.PathLike | None = None, every: int = 10, resume: str | os.PathLike | None = None,
            **options) -> FitResult:
        """Optimises the parameters of `wrt` (default: all that can be), within [Range], from the values they have. The program
        has the best parameters when it ends, however it ends.

        target: an image (height, width, channels), any dtype, or a file, which is resized to `size` if that is given
        mask: weighs its pixels
        views: instead, a list of ``{"target": ..., "mask": ..., "params": {...}, "program": ...}``; a program that draws a
            view has the fit's values in it, of parameters of the same name, and afterwards its own again
        minimize: the integral of the entry itself is the loss
        loss: "l2", "l1", "huber" (`huber_delta`), or a function (image, target) -> (value, adjoint), the adjoint an array
            like the image. "l2" does not count the noise of the image, so near 0 it may be a little below
        loss_entry: a function of the shader as the loss
        iters: evaluations in all
        optimizer: "adam" (`beta1`, `beta2`, `epsilon`), "sgd" (`momentum`) or "lbfgs" (`history`)
        lr: a learning rate, or ``{"radius": 0.1, "discs[*].centre": 0.01}``; 0 holds (default 0.01, L-BFGS 0.1)
        lr_masks: factors of it for the texels of a texture or heightfield
        schedule: of the rate: "constant", "exponential" (times `decay` an iteration) or "cosine"
        smooth: Laplacian preconditioning, ``{"h": 20}``; smooth_faces, smooth_grids: of a mesh, a grid in one list
        callback: called with an `Iteration` behind every evaluation; returning True stops the fit
        progress: a line with iteration, loss and time left (None: on a terminal and in notebooks)
        checkpoint, every, resume: the state in a file, to go on from, to the same bits
        size: of a target that is a file, or of views without one

        Beside these: gradient_tolerance, loss_tolerance and patience (when it has converged), max_failures,
        views_per_step, and the estimating options of `render` (spp, seed, threads, estimator, time_limit, ...).
        Ctrl-C raises KeyboardInterrupt."""
        from ._fit import fit
        return fit(self, target, wrt=wrt, iters=iters, lr=lr, optimizer=optimizer, mask=mask, views=views, minimize=minimize,
                   loss=loss, loss_entry=loss_entry, smooth=smooth, smooth_faces=smooth_faces,
                   smooth_grids=smooth_grids, lr_masks=lr_masks, schedule=schedule, callback=callback,
                   progress=progress, size=size, checkpoint=checkpoint, every=every, resume=resume, **options)

    def check(self, **options) -> dict:
        """Certifies the derivatives against finite differences, by ``saltus check``: its JSON. Raises CheckFailed with
        the table where a row fails."""
        return _command.check(self, options)

    def explain(self, **options) -> str:
        """Sites, kernels, what gets no gradient and why, what was left out: the text of ``saltus explain``. at=(x, y):
        the story of one point; cost=True: what every kernel costs."""
        return _command.explain(self, options)

    def __repr__(self):
        return (f"<saltus.Program {self._origin.shown!r}: {self.entry}, {self.dim}D, {self.channels} channels, "
                f"parameters {', '.join(self._layouts) or 'none'}>")

    def __reduce__(self):
        raise TypeError("a program holds machine code and cannot be pickled: compile it in every process")


class _ProgramParams(Params):
    """Those of a program: they also read text and files."""
    _program: weakref.ref

    def _set_text(self, name, value):
        program = self._program()
        if program is None:
            raise UsageError("the program is gone")
        program._set_text(name, value)

    def __reduce__(self):
        return Params, (self._layouts, self.vector, self._ints)  # a copy is of numbers, and of no program


def _names(names) -> tuple[str, ...] | None:
    if names is None:
        return None
    names = (names,) if isinstance(names, str) else tuple(names)
    if not names:
        raise UsageError("wrt names nothing; None: all that can be differentiated")
    return names


_HERE = os.path.dirname(os.path.abspath(__file__))


def _outside() -> int:
    """The stacklevel of the caller's own line, for warnings."""
    frame, level = sys._getframe(1), 1
    while frame.f_back and frame.f_code.co_filename.startswith(_HERE):
        frame, level = frame.f_back, level + 1
    return level
