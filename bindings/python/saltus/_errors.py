"""What goes wrong, as exceptions: one for each status of the library (docs/command.md lists them)."""
from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from . import _abi
from ._library import text


@dataclass(frozen=True)
class Diagnostic:
    """What the compiler says of one place. Lines and columns count from 1; 0: it is about no place."""
    severity: str  #: "error", "warning" or "information"
    code: str  #: "E0101"; ``saltus explain E0101`` explains it
    message: str
    file: str
    line: int
    column: int

    def __str__(self):
        place = f"{self.file}:{self.line}:{self.column}: " if self.line else ""
        return f"{place}{self.severity}[{self.code}]: {self.message}"


class SaltusError(Exception):
    """Any error of the library. ``status`` is the exit status that the command would have."""
    status = _abi.SLT_INTERNAL


class UsageError(SaltusError, ValueError):
    """Wrong arguments: an unknown entry, constant, parameter or option, a shape that does not fit."""
    status = _abi.SLT_USAGE


class UnknownName(UsageError, KeyError):
    """A name of no parameter or field, looked up."""
    __str__ = Exception.__str__  # KeyError's puts quotes around it


class CompileError(SaltusError):
    """The shader has errors: the text shows them with their lines and carets, ``diagnostics`` lists them."""
    status = _abi.SLT_PROGRAM

    def __init__(self, message, diagnostics=()):
        super().__init__(message)
        self.diagnostics: list[Diagnostic] = list(diagnostics)


class InputError(SaltusError):
    """An input file is missing or bad."""
    status = _abi.SLT_INPUT


class OutputError(SaltusError):
    """An output could not be written."""
    status = _abi.SLT_OUTPUT


class LimitError(SaltusError):
    """A limit of time, memory or size was reached."""
    status = _abi.SLT_LIMIT


class CheckFailed(SaltusError):
    """A check or a fit failed."""
    status = _abi.SLT_CHECK_FAILED


class InternalError(SaltusError):
    """A fault of Saltus: please report it."""


class SaltusWarning(UserWarning):
    """What a result does not say: a derivative that misses a part, an estimate that is worse than it seems."""


def c_string(value, what: str, encode: Callable[[Any], bytes] = str.encode) -> bytes:
    """A string for the library, to which it would end at a NUL character."""
    found = encode(value)
    if b"\0" in found:
        raise UsageError(f"there is a NUL character in {what}")
    return found


def c_path(value: str | os.PathLike) -> bytes:
    return c_string(value, "a path", os.fsencode)


_BY_STATUS = {kind.status: kind for kind in (UsageError, InputError, OutputError, LimitError, CheckFailed, InternalError)}


def error_of(status: int, message: str) -> BaseException:
    """The exception for a status that is not SLT_OK."""
    if status == _abi.SLT_INTERRUPTED:
        return KeyboardInterrupt(message)
    return _BY_STATUS.get(status, InternalError)(message)


def raise_for(status: int, error: _abi.SltError):
    if status != _abi.SLT_OK:
        raise error_of(status, text(error.text) or f"status {status}")
