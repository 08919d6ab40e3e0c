"""What the command does better than a copy of it would: `check` and `explain`."""
from __future__ import annotations

import json
import os
import pathlib
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from typing import Any

from . import _abi
from ._errors import InputError, error_of



@dataclass
class Origin:
    """Where a program came from, to compile it again."""
    source: str | os.PathLike
    is_source: bool
    name: str | None
    options: dict

    @property
    def shown(self) -> str:
        return self.name or "<string>" if self.is_source else os.fspath(self.source)


def find() -> str:
    """The command `saltus`: $SALTUS_COMMAND, that of the build or the installation this package is part of, or on PATH."""
    given = os.environ.get("SALTUS_COMMAND")
    here = pathlib.Path(__file__).resolve().parent
    beside = [here.parents[2] / "build/bin/saltus"]
    beside += [p.parent / "bin/saltus" for p in here.parents if p.name in ("lib", "lib64")][:1]
    found = given or next((str(p) for p in beside if p.is_file()), None) or shutil.which("saltus")
    if not found:
        raise InputError("the command `saltus` was not found: install it (the package saltus), or set SALTUS_COMMAND")
    return found


def _arguments(options: dict) -> list[str]:
    """--entry main --set N=5 --cost ...: an option's name with - for _."""
    out = []
    for name, value in options.items():
        flag = "--" + name.replace("_", "-")
        if value is None or value is False or value == "" or value == {} or value == []:
            continue
        if value is True:
            out.append(flag)
        elif name == "import_dirs":
            out += [part for folder in value for part in ("-I", folder)]
        elif isinstance(value, dict):
            out += [part for k, v in value.items() for part in (flag, f"{k}={_number(v)}")]
        elif isinstance(value, (list, tuple)):
            out += [flag, ("x" if name == "size" else ",").join(map(str, value))]
        else:
            out += [flag, str(value)]
    return out


def _number(value):
    return str(value).lower() if isinstance(value, bool) else str(value)


def _run(verb, program, options, as_json):
    origin = program._origin
    if not isinstance(options.get("wrt"), str):
        options["wrt"] = list(options.get("wrt") or program.wrt or ())
    if options.pop("integral", False):
        options["integral"] = True
    with tempfile.TemporaryDirectory(prefix="saltus-") as folder:
        values = os.path.join(folder, "params.json")
        with open(values, "w", encoding="utf-8") as file:
            file.write(program.params_json())
        line = [find(), verb, "-" if origin.is_source else os.fspath(origin.source), "--params", values]
        line += _arguments(origin.options) + _arguments(options) + (["--json"] if as_json else [])
        return subprocess.run(line, input=origin.source if origin.is_source else "", capture_output=True, text=True)


def check(program, options) -> dict:
    done = _run("check", program, options, True)
    if done.stdout.strip():
        result = json.loads(done.stdout)
        if done.returncode == 0:
            return result
        shown = _run("check", program, options, False)
        error: Any = error_of(done.returncode, shown.stdout + shown.stderr)
        error.result = result
        raise error
    raise error_of(done.returncode, _said(done.stderr))


def _said(stderr: str) -> str:
    """The messages in what was printed as JSON."""
    lines = []
    for line in stderr.splitlines():
        try:
            lines.append(json.loads(line)["message"])
        except (ValueError, KeyError, TypeError):
            lines.append(line)
    return "\n".join(lines)


def explain(program, options) -> str:
    done = _run("explain", program, options, False)
    if done.returncode != _abi.SLT_OK:
        raise error_of(done.returncode, done.stderr.strip())
    return done.stdout or done.stderr


