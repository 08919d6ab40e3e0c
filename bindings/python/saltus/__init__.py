"""Saltus: derivatives of the integrals of shaders, the part of the moving jumps included.

    import saltus
    p = saltus.compile("examples/painterly_discs/discs.salt", set={"N": 200})
    p.fit("photo.png", size=256, spp=4, iters=200)      # discs become the photograph
    p.render(256, spp=16).save("discs.png")
    p.integral().gradient["discs"].radius               # derivatives, in the shape of the parameters

`compile` and `load` make a `Program`; ``help(saltus.Program)`` is the way on, docs/python.md the guide. With PyTorch see
`saltus.torch`, with JAX `saltus.jax`; neither is imported before it is asked for."""
from ._errors import (CheckFailed, CompileError, Diagnostic, InputError, InternalError, LimitError, OutputError,
                      SaltusError, SaltusWarning, UsageError)
from ._fit import FitResult, Iteration
from ._images import Image, encode_png, read_image, save_png, strip, write_image
from ._library import PATH as library_path
from ._library import lib as _lib
from ._plot import Plot, plot
from ._program import Bound, Crossing, Integral, Program, Stats, compile, load
from ._values import Gradient, Info, Params, Record, Values

__version__: str = _lib.slt_version().decode()

__all__ = [
    "Bound", "CheckFailed", "CompileError", "Crossing", "Diagnostic", "FitResult", "Gradient", "Image", "Info",
    "InputError", "Integral", "InternalError", "Iteration", "LimitError", "OutputError", "Params", "Plot", "Program",
    "Record", "SaltusError", "SaltusWarning", "Stats", "UsageError", "Values", "compile", "encode_png", "library_path",
    "load", "plot", "read_image", "save_png", "strip", "write_image",
]


def __getattr__(name):
    if name in ("torch", "jax"):
        import importlib
        return importlib.import_module("." + name, __name__)
    raise AttributeError(f"module 'saltus' has no attribute '{name}'")
