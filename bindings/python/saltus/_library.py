"""Finds libsaltus, loads it, and tells ctypes what its functions take."""
from __future__ import annotations

import ctypes
import glob
import os
import pathlib

from . import _abi

NAME = "libsaltus.so.0"


def _candidates():
    given = os.environ.get("SALTUS_LIBRARY")
    if given:
        yield given
        return
    here = pathlib.Path(__file__).resolve().parent
    if (here.parents[2] / "bindings" / "python").is_dir():  # the source tree: what was built there
        yield str(here.parents[2] / "build" / NAME)
    for prefix in here.parents:  # PREFIX/lib/python3/dist-packages/saltus: beside it, and nowhere above it
        if prefix.name in ("lib", "lib64"):
            yield str(prefix / NAME)
            yield from glob.glob(str(prefix / "*-linux-gnu" / NAME))
            break
    yield NAME  # where the system looks


def _load():
    tried = []
    for path in _candidates():
        if os.sep in path and not os.path.exists(path):
            tried.append(path)
            continue
        try:
            return ctypes.CDLL(path), path
        except OSError as error:
            tried.append(f"{path}: {error}")
    raise ImportError(f"{NAME} was not found: install it (./bootstrap install, or the package libsaltus0), or set "
                      f"SALTUS_LIBRARY to the file. Tried: {'; '.join(tried)}")


lib, PATH = _load()
for _name, (_result, _given) in _abi.FUNCTIONS.items():
    try:
        _function = getattr(lib, _name)
    except AttributeError:
        raise ImportError(f"{PATH} has no {_name}: it is older than this package; install the two together") from None
    _function.restype, _function.argtypes = _result, _given

free = ctypes.CDLL(None).free
free.restype, free.argtypes = None, [ctypes.c_void_p]


def initial(struct):
    """A struct as its _INIT macro makes it."""
    made = struct(struct_size=ctypes.sizeof(struct))
    for name, value in _abi.INITIAL[struct].items():
        setattr(made, name, value)
    return made


def text(value: bytes | None) -> str:
    return (value or b"").decode("utf-8", "replace")
