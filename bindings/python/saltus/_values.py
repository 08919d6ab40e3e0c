"""Parameters as arrays: views of the vectors in which all numbers of a program lie, shaped by the parameters' types.

A float3 is an array of shape (3,), Disc[200] a Record whose fields have shapes that begin with 200, a float an array of
no dimensions. Nothing is copied: writing into an array sets the parameter."""
from __future__ import annotations

import ctypes
import difflib
import re
from collections.abc import Iterator, Mapping, MutableMapping
from dataclasses import dataclass

import numpy as np

from . import _abi
from ._errors import UnknownName, UsageError
from ._job import numbers
from ._library import initial, lib, text

#: Of a bool, an int32 of 0 or 1, the lowest byte is looked at.
INTEGERS = {_abi.SLT_KIND_BOOL: np.bool_, _abi.SLT_KIND_INT: np.int32, _abi.SLT_KIND_UINT: np.uint32}


@dataclass(frozen=True)
class Info:
    """What a parameter, or a field of one, is."""
    name: str
    type: str  #: as written: "Disc[200]"
    shape: tuple  #: of the array; of a Record, of its structs
    differentiable: bool  #: a gradient can be asked for
    range: tuple[float, float] | None  #: of ``[Range(lo, hi)]``
    log: bool  #: ``[Log]``: fits move it on a logarithmic scale
    color: bool  #: ``[Color]``
    doc: str  #: of ``[Doc("...")]``, or ""
    extent: tuple[float, ...] | None  #: of a heightfield: x0, y0, x1, y1
    kind: str  #: "float", "int", "uint", "bool", "struct", "texture" or "heightfield"


class Layout:
    """Where a parameter lies in the vectors: its base, its shape, its strides, and the same of its fields.

    `dims` are (size, stride in floats, stride in integers) of the structs around it, outermost first."""

    def __init__(self, param: _abi.SltParam, dims=()):
        self.kind = param.kind
        self.fbase, self.ibase = param.fbase, param.ibase
        own: list[tuple[int, int, int]] = []
        fstep, istep = param.fstride, param.istride
        for size in reversed(param.shape[:param.rank]):
            own.insert(0, (size, fstep, istep))
            fstep, istep = fstep * size, istep * size
        self.dims = tuple(dims) + tuple(own)
        self.holds_floats = param.kind == _abi.SLT_KIND_FLOAT
        self.fields: dict[str, Layout] = {}
        for i in range(param.nfields):
            field = initial(_abi.SltParam)
            if lib.slt_param_field(ctypes.byref(param), i, ctypes.byref(field)):
                self.fields[text(field.name)] = Layout(field, self.dims)
        self.holds_floats |= any(f.holds_floats for f in self.fields.values())
        kinds = {_abi.SLT_KIND_BOOL: "bool", _abi.SLT_KIND_INT: "int", _abi.SLT_KIND_UINT: "uint",
                 _abi.SLT_KIND_STRUCT: "struct", _abi.SLT_KIND_FLOAT: "float"}
        self.info = Info(text(param.name), text(param.type), tuple(param.shape[:param.rank]), param.differentiable,
                         (param.lo, param.hi) if param.has_range else None, param.log, param.color, text(param.doc),
                         tuple(param.extent) if param.has_extent else None,
                         "heightfield" if param.is_heightfield else "texture" if param.is_texture else kinds[param.kind])

    def array(self, floats: np.ndarray, ints: np.ndarray | None, channels: int | None = None) -> np.ndarray:
        """The view of a parameter that is no struct. With channels, `floats` is (channels, n), and they come last."""
        shape = tuple(d[0] for d in self.dims)
        if self.kind != _abi.SLT_KIND_FLOAT:
            assert ints is not None
            return _strided(ints[self.ibase:].view(INTEGERS[self.kind]), shape, tuple(d[2] for d in self.dims),
                            ints.itemsize)
        if channels is None:
            return _strided(floats[self.fbase:], shape, tuple(d[1] for d in self.dims))
        return _strided(floats.reshape(-1)[self.fbase:], shape + (channels,),
                        tuple(d[1] for d in self.dims) + (floats.shape[1],))

    def view(self, floats, ints, channels=None):
        if self.kind != _abi.SLT_KIND_STRUCT:
            return self.array(floats, ints, channels)
        return Record({name: f.view(floats, ints, channels) for name, f in self.fields.items()
                       if ints is not None or f.holds_floats}, len(self.dims))


def _strided(base, shape, strides, unit=8):
    if 0 in shape:
        return np.empty(shape, base.dtype)
    return np.ndarray(shape, base.dtype, base, 0, tuple(s * unit for s in strides))


class Record(MutableMapping):
    """Structs as arrays of their fields: ``discs.centre`` and ``discs["centre"]`` are views of shape (200, 2), and
    ``discs[3]`` is the record of one disc. Assigning to a field sets it."""

    __slots__ = ("_fields", "_rank")

    def __init__(self, fields: dict, rank: int):
        object.__setattr__(self, "_fields", fields)
        object.__setattr__(self, "_rank", rank)

    @property
    def shape(self) -> tuple:
        """Of the structs: (200,) of Disc[200], () of one struct."""
        first = next(iter(self._fields.values()), None)
        return () if first is None else first.shape[:self._rank]

    def __getitem__(self, key):
        if not isinstance(key, str):
            key = key if isinstance(key, tuple) else (key,)
            if not all(isinstance(k, (int, np.integer, slice)) for k in key) or len(key) > self._rank:
                raise TypeError(f"structs of shape {self.shape} are indexed by numbers, slices or the names of fields; "
                                "index the field's array for more")
            # With the dots a number is a view of no dimensions: else writing to it would be lost.
            return Record({name: f[key] if isinstance(f, Record) else f[(*key, ...)] for name, f in self._fields.items()},
                          self._rank - sum(not isinstance(k, slice) for k in key))
        try:
            return self._fields[key]
        except KeyError:
            raise UnknownName(_unknown("field", key, self._fields)) from None

    def __setitem__(self, key, value):
        if not isinstance(key, str):
            assign(self[key], value, f"[{key}]")
        else:
            assign(self[key], value, key)

    def __getattr__(self, name):
        if name.startswith("_") or name not in self._fields:
            raise AttributeError(_unknown("field", name, self._fields))
        return self._fields[name]

    def __setattr__(self, name, value):
        if name not in self._fields:
            raise AttributeError(_unknown("field", name, self._fields))
        self[name] = value

    def __dir__(self):
        return [*super().__dir__(), *self._fields]

    def __delitem__(self, key):
        raise TypeError("a struct keeps its fields")

    def __reduce__(self):
        return Record, (self._fields, self._rank)  # attributes are fields: these two are none

    def __iter__(self) -> Iterator[str]:
        return iter(self._fields)

    def __len__(self) -> int:
        """How many fields; ``shape`` says how many structs."""
        return len(self._fields)

    def __repr__(self):
        return "Record(" + ", ".join(f"{name}={value!r}" for name, value in self._fields.items()) + ")"


def assign(view, value, name: str):
    """Puts a value into a view: numbers into arrays, by NumPy's rules; mappings and lists of them into records."""
    if isinstance(view, Record):
        if isinstance(value, Mapping):
            for key in value:
                if key not in view:
                    raise UsageError(f"{name}: " + _unknown("field", key, view))
            for key, part in value.items():
                assign(view[key], part, f"{name}.{key}")
        elif view.shape and isinstance(value, (list, tuple)) and len(value) == view.shape[0]:
            for i, part in enumerate(value):
                assign(view[i], part, f"{name}[{i}]")
        else:
            raise UsageError(f"{name} is made of structs of shape {view.shape}: give a mapping of fields to arrays, or a list "
                             "of such mappings of that length")
        return
    given = numbers(name, value)
    if view.dtype.kind == "b" and not np.array_equal(given, given.astype(bool)):
        raise UsageError(f"{name} is true or false, and {value} is neither")
    if view.dtype.kind in "iu" and given.dtype.kind == "f":
        if not np.array_equal(given, np.floor(given)):
            raise UsageError(f"{name} is an integer, and {value} is none")
    if view.dtype.kind in "iu" and given.size:
        limits = np.iinfo(view.dtype)
        if given.min() < limits.min or given.max() > limits.max:
            raise UsageError(f"{name}: integers here are from {limits.min} to {limits.max}")
    if given.shape == (*view.shape, 1):
        given = given[..., 0]  # a picture of one channel is a texture, a heightfield or an array of numbers
    try:
        view[...] = given
    except ValueError:
        raise UsageError(f"{name} has the shape {view.shape}, and the value {given.shape}") from None


def _unknown(what, name, known):
    near = difflib.get_close_matches(str(name), list(known), 1)
    return f"there is no {what} `{name}`" + (f"; did you mean `{near[0]}`?" if near else
                                             f"; there are {', '.join(known) or 'none'}")


class Values(Mapping):
    """Numbers in the shape of the parameters: ``values["centre"]`` is an array, ``values["discs"].radius`` a field, and
    ``values["discs[*].centre.x"]`` or ``values["discs[3].radius"]`` a part. All are views of ``vector``."""

    _shown = "Values"

    def __init__(self, layouts: dict[str, Layout], vector, ints=None, names=None, channels=None):
        self._layouts, self._ints, self._channels = layouts, ints, channels
        self._names = list(layouts) if names is None else names
        #: All floats, float64: (n,), or with channels (channels, n).
        self.vector: np.ndarray = vector

    def __getitem__(self, name: str):
        if not isinstance(name, str):
            raise UnknownName(f"parameters have names, and {name!r} is none")
        if name in self._names:
            return self._layouts[name].view(self.vector, self._ints, self._channels)
        return self._part(name)

    def _part(self, name):
        parts = re.fullmatch(r"(\w+)((?:\[(?:\d+|\*)\]|\.\w+)*)", name)
        if not parts or parts[1] not in self._names:
            raise UnknownName(_unknown("parameter", parts[1] if parts else name, self._names))
        view, stars = self._layouts[parts[1]].view(self.vector, self._ints, self._channels), 0
        for index, field in re.findall(r"\[(\d+|\*)\]|\.(\w+)", parts[2]):
            rank = view._rank if isinstance(view, Record) else view.ndim - (self._channels is not None)
            if index == "*" and stars < rank:
                stars += 1
            elif index and index != "*" and stars < rank:
                at = (slice(None),) * stars + (int(index), ...) if not isinstance(view, Record) else \
                    (slice(None),) * stars + (int(index),)
                try:
                    view = view[at]
                except IndexError:
                    raise UnknownName(f"{name}: [{index}] is beyond the end") from None
            elif field and isinstance(view, Record):
                view = view[field]
            elif field in ("x", "y", "z", "w", "r", "g", "b", "a") and rank > stars:
                at = "xyzw".find(field) if field in "xyzw" else "rgba".find(field)
                axis = view.ndim - 1 - (self._channels is not None)
                if at >= view.shape[axis]:
                    raise UnknownName(f"{name}: .{field} is beyond the end")
                view = view[(..., at) if self._channels is None else (..., at, slice(None))]
            else:
                raise UnknownName(f"{name}: there is no `{'.' + field if field else '[' + index + ']'}`")
        return view

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def __contains__(self, name) -> bool:
        try:
            self[name]
        except KeyError:
            return False
        return True

    def arrays(self) -> dict:
        """Copies, as a plain dict of arrays; structs are dicts of their fields."""
        def copied(view):
            return {k: copied(v) for k, v in view.items()} if isinstance(view, Record) else np.array(view)
        return {name: copied(self[name]) for name in self}

    def __repr__(self):
        return f"{self._shown}(" + ", ".join(f"{name}={self[name]!r}" for name in self) + ")"


class Gradient(Values):
    """Derivatives with respect to the parameters that `wrt` names, in their shape."""
    _shown = "Gradient"
    #: Upper bounds of the standard errors, where they were asked for.
    stderr: Gradient | None = None


class Params(Values, MutableMapping):
    """The parameters of a program. Arrays are views: ``p.params["centre"][0] = 0.3`` sets it. Assigning sets the whole:
    ``p.params["discs"] = {"centre": c, "radius": r}``; a string is read as ``saltus --param`` reads it, ``"@dem.exr"``."""
    _shown = "Params"

    def __setitem__(self, name, value):
        if isinstance(value, str):
            self._set_text(name, value)
            return
        try:
            view = self[name]
        except KeyError as error:
            raise UsageError(error.args[0]) from None
        assign(view, value, name)

    def _set_text(self, name, value):
        raise UsageError(f"{name}: a value for one call, or of a copy, is numbers, not text; set p.params[{name!r}]")

    def __delitem__(self, name):
        raise TypeError("a program keeps its parameters")

    def info(self, name: str) -> Info:
        """Type, range, doc and more of a parameter."""
        try:
            return self._layouts[name].info
        except KeyError:
            raise UsageError(_unknown("parameter", name, self._layouts)) from None

    def _repr_html_(self):
        import html
        rows = []
        for name, layout in self._layouts.items():
            i = layout.info
            if i.kind == "struct":
                value = ", ".join(layout.fields)
            elif self[name].ndim < 2 or self[name].size <= 16:
                value = np.array2string(self[name], precision=4, threshold=6)
            else:
                value = f"{' x '.join(map(str, i.shape))}, {self[name].min():.4g} to {self[name].max():.4g}"
            rows.append("".join(f"<td>{html.escape(str(cell))}</td>" for cell in
                                (name, i.type, value, i.range or "", i.doc)))
        return ("<table><tr><th>parameter<th>type<th>value<th>range<th>doc</tr>" +
                "".join(f"<tr>{row}</tr>" for row in rows) + "</table>")


def layouts_of(program) -> dict[str, Layout]:
    found = {}
    for i in range(lib.slt_param_count(program)):
        param = initial(_abi.SltParam)
        if lib.slt_param(program, i, ctypes.byref(param)):
            found[text(param.name)] = Layout(param)
    return found
