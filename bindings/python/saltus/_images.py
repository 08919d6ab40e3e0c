"""Images as arrays that a notebook shows, and pictures in files."""
from __future__ import annotations

import ctypes
import io
import os
from collections.abc import Iterable

import numpy as np

from . import _abi, _job
from ._errors import LimitError, OutputError, UsageError, c_path, c_string, raise_for
from ._library import free, lib


class Image(np.ndarray):
    """An array of float32, (height, width, channels), top row first; a volume (depth, height, width, channels), a curve
    (width, channels). It is an ndarray that notebooks show as a picture, linear colours through the curve of sRGB."""

    #: Colours are encoded for a screen already ([Display], GLSL).
    display = False
    #: Values are signed: blue below 0, red above. Of derivatives.
    signed = False

    def __array_finalize__(self, origin):
        self.display, self.signed = getattr(origin, "display", False), getattr(origin, "signed", False)

    def __array_wrap__(self, result, context=None, return_scalar=False):
        wrapped = super().__array_wrap__(result, context)
        return wrapped[()] if wrapped.ndim == 0 else wrapped

    def __reduce__(self):
        make, arguments, state = super().__reduce__()
        return make, arguments, (state, self.display, self.signed)

    def __setstate__(self, state):
        state, self.display, self.signed = state
        super().__setstate__(state)

    def _repr_png_(self) -> bytes | None:
        flat = _picture(self)
        return None if flat is None else encode_png(flat, display=self.display, signed=self.signed)

    def save(self, path: str | os.PathLike) -> None:
        """Writes .png, .exr, .pfm or .npy: `write_image`."""
        write_image(path, self)


def as_image(array, display=False, signed=False) -> Image:
    image = array.view(Image)
    image.display, image.signed = display, signed
    return image


def strip(images: Iterable, gap: int = 4) -> Image:
    """Pictures of one height side by side, as one: a film of a fit, a result beside its target. Arrays (height, width) or
    (height, width, channels); grey beside colour becomes colour. Between them are `gap` columns of white (of signed
    pictures: of 0). Display and signed are those of the first, which those of the others must be."""
    images = list(images)
    shown = [_picture(image) for image in images]
    if not shown or any(s is None for s in shown):
        raise UsageError("a strip is made of one or more pictures (height, width) or (height, width, channels)")
    of = [(getattr(i, "display", False), getattr(i, "signed", False)) for i in images]
    if len(set(of)) > 1:
        raise UsageError("a strip is of pictures of one kind: linear, display or signed")
    if len({s.shape[0] for s in shown}) > 1:
        raise UsageError(f"the pictures of a strip have one height, not {', '.join(str(s.shape[0]) for s in shown)}")
    channels = max(s.shape[2] for s in shown)
    if any(s.shape[2] not in (1, channels) for s in shown):
        raise UsageError(f"the pictures of a strip have 1 or {channels} channels")
    between = np.full((shown[0].shape[0], gap, channels), 0 if of[0][1] else 1, np.float32)
    parts = [p for s in shown for p in (between, np.broadcast_to(s, s.shape[:2] + (channels,)))][1:]
    return as_image(np.concatenate(parts, axis=1).astype(np.float32), *of[0])


def _picture(array):
    """(h, w, c) of what can be shown: an image, a curve as a strip, the middle slice of a volume; else None."""
    array = np.asarray(array)
    if array.dtype.kind not in "fiub" or not array.size:
        return None
    if array.ndim == 4:
        array = array[array.shape[0] // 2]
    if array.ndim == 2:
        array = array[None].repeat(16, 0) if array.shape[1] <= 4 else array[..., None]
    return array if array.ndim == 3 and 1 <= array.shape[2] <= 4 else None


def empty(shape, dtype=np.float32) -> np.ndarray:
    """An array to be written to."""
    try:
        return np.empty(shape, dtype)
    except (MemoryError, ValueError):  # NumPy's, of sizes that no integer holds
        raise LimitError(f"there is no memory for an array of shape {shape}") from None


def floats32(array, what: str, shape=None) -> np.ndarray:
    """A C-ordered array of float32 with these numbers, copied if need be. Complex numbers and objects are refused."""
    array = _job.numbers(what, array)
    if shape is not None and array.shape != shape and array.shape + (1,) != shape:
        raise UsageError(f"{what} has the shape {array.shape}, and {shape} is wanted")
    with np.errstate(over="ignore"):
        return np.ascontiguousarray(array, np.float32)


def _checked(array):
    flat = _picture(array)
    if flat is None:
        raise UsageError(f"a picture is an array (height, width, channels) with 1 to 4 channels, not of shape {np.shape(array)}")
    flat = floats32(flat, "picture")
    return flat, (ctypes.c_uint32 * 2)(flat.shape[1], flat.shape[0]), flat.shape[2]


def _taken(bytes_at, n) -> bytes:
    try:
        return ctypes.string_at(bytes_at, n.value)
    finally:
        free(bytes_at)


def encode_png(image, *, display: bool = False, signed: bool = False, title: str | None = None,
               scale: float = 0.0) -> bytes:
    """A PNG file of an image, as bytes. `display`: its colours are encoded for a screen already. `signed`: a diverging
    map, blue below 0 and red above, with its scale printed below, behind `title`; full colour stands for `scale` (0: for
    the largest magnitude)."""
    flat, size, channels = _checked(image)
    at, n, error = ctypes.c_void_p(), ctypes.c_size_t(), _abi.SltError()
    if signed:
        said = c_string(title, "the title") if title else None
        status = lib.slt_image_encode_signed(scale, said, size, channels, flat.ctypes.data, ctypes.byref(at),
                                             ctypes.byref(n), ctypes.byref(error))
    else:
        status = lib.slt_image_encode(b".png", display, size, channels, flat.ctypes.data, ctypes.byref(at),
                                      ctypes.byref(n), ctypes.byref(error))
    raise_for(status, error)
    return _taken(at, n)


def write_image(path: str | os.PathLike, image, *, display: bool | None = None) -> None:
    """Writes (height, width, channels) by the extension of `path`: .exr, .png, .pfm, .npy. The file appears whole or not
    at all. `display`: a PNG takes the numbers as they are (default: what the image says, else linear colours). A volume,
    (depth, height, width, channels), goes into a .npy only."""
    if os.fspath(path).lower().endswith(".npy"):
        made = io.BytesIO()
        np.save(made, floats32(image, "the image"))
        write_whole(path, made.getvalue())
        return
    if np.ndim(image) == 4:
        raise UsageError(f"a volume, {np.shape(image)}, goes into a .npy; of a picture give one slice, image[z]")
    flat, size, channels = _checked(image)
    display = getattr(image, "display", False) if display is None else display
    error = _abi.SltError()
    raise_for(lib.slt_image_write(c_path(path), display, size, channels, flat.ctypes.data, ctypes.byref(error)), error)


def save_png(path: str | os.PathLike, image, *, display: bool | None = None, title: str | None = None,
             scale: float = 0.0) -> None:
    """A PNG of an image; of a derivative (`Image.signed`) a diverging map with its scale printed below."""
    display = getattr(image, "display", False) if display is None else display
    write_whole(path, encode_png(image, display=display, signed=getattr(image, "signed", False), title=title, scale=scale))


def write_whole(path, data: bytes):
    """The file appears whole or not at all; a link is followed, and what is no regular file is written to as it is."""
    place = os.path.realpath(path)
    beside = place if os.path.exists(place) and not os.path.isfile(place) else f"{place}.{os.getpid()}.tmp"
    try:
        with open(beside, "wb") as file:
            file.write(data)
            file.flush()
            if beside != place:
                os.fsync(file.fileno())
        if beside != place:
            os.replace(beside, place)
    except BaseException as error:
        if beside != place and os.path.exists(beside):
            os.unlink(beside)
        if isinstance(error, OSError):
            raise OutputError(f"cannot write `{os.fspath(path)}`: {error.strerror}") from None
        raise


def read_image(path: str | os.PathLike, size: int | tuple[int, int] | None = None, *, channels: int | None = None,
               display: bool = False) -> Image:
    """Reads .exr, .png, .pfm, .npy or .hgt as (height, width, channels) of float32, colours linear. `size`: resized to
    (width, height), or a square. `channels`: converted, grey to colour or back. `display`: the numbers of a PNG as they
    are, for programs with ``[Display]``."""
    wanted = _job.make_job(2, size, {}).size[:2] if size is not None else (0, 0)
    box = (ctypes.c_uint32 * 2)(*wanted)
    found = ctypes.c_uint32(0 if channels is None else _job.whole("channels", channels, 1, 4))
    at, error = ctypes.c_void_p(), _abi.SltError()
    raise_for(lib.slt_image_read(c_path(path), display, box, ctypes.byref(found), ctypes.byref(at),
                                 ctypes.byref(error)), error)
    shape = (box[1], box[0], found.value)
    try:
        pixels = np.ctypeslib.as_array(ctypes.cast(at, ctypes.POINTER(ctypes.c_float)), shape).copy()
    finally:
        free(at)
    return as_image(pixels, display)
