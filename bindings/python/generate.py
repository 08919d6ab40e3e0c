#!/usr/bin/env python3
"""Writes saltus/_abi.py, what ctypes must know of libsaltus, from the headers in include/saltus.

    bindings/python/generate.py            write it
    bindings/python/generate.py --print    print it; tests/python/test_abi.py compares

The headers are C that the preprocessor (cc -E) has seen; what is parsed is the small part of C in which they are written.
Pointers are void pointers to ctypes, but for strings, which are bytes, and functions."""
import pathlib
import re
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
INCLUDE = HERE.parents[1] / "include"
HEADERS = ("fit.h", "image.h")
NUMBERS = {"size_t": "c_size_t", "_Bool": "c_bool", "int": "c_int", "uint8_t": "c_uint8", "uint32_t": "c_uint32",
           "int32_t": "c_int32", "uint64_t": "c_uint64", "float": "c_float", "double": "c_double", "char": "c_char"}


def preprocessed():
    """The text of our own headers alone, without comments."""
    source = "".join(f"#include <saltus/{h}>\n" for h in HEADERS)
    out = subprocess.run(["cc", "-E", "-I", INCLUDE, "-"], input=source, text=True, capture_output=True, check=True).stdout
    ours, lines = False, []
    for line in out.splitlines():
        marker = re.match(r'# \d+ "(.*?)"', line)
        if marker:
            ours = marker[1].startswith(str(INCLUDE))
        elif ours:
            lines.append(line)
    return " ".join(" ".join(lines).split())


class Abi:
    def __init__(self, text):
        self.constants, self.structs, self.callbacks, self.functions = {}, {}, {}, {}
        self.enums = set()
        for body, name in re.findall(r"(?:typedef )?enum(?: \w+)? \{([^}]*)\}\s*(\w*);", text):
            self.enum(body)
            if name:
                self.enums.add(name)
        for returns, name, arguments in re.findall(r"typedef (\w+) (\w+)\(([^)]*)\);", text):
            self.callbacks[name] = self.signature(returns, arguments)
        for name, body in re.findall(r"typedef struct (\w+) \{([^}]*)\} \1;", text):
            self.structs[name] = [m for member in body.split(";") if member.strip() for m in self.member(name, member)]
        functions = re.sub(r"typedef .*?;|\{[^}]*\}", lambda m: m[0] if m[0][0] == "{" else "", text)
        for returns, name, arguments in re.findall(r"((?:const )?\w+ \**)\s*(slt_\w+)\(([^)]*)\);", functions):
            self.functions[name] = self.signature(returns, arguments)

    def enum(self, body):
        value = -1
        for item in filter(None, (i.strip() for i in body.split(","))):
            name, _, written = item.partition("=")
            value = eval(written, {}, self.constants) if written else value + 1  # numbers, names and shifts
            self.constants[name.strip()] = value

    def ctype(self, written, pointer):
        written = re.sub(r"\b(const|volatile|struct)\b", "", written).split()
        base = written[0]
        if pointer == 1 and base == "char":
            return "c_char_p"
        if pointer and base in self.callbacks:
            return base
        if pointer:
            return "c_void_p"
        if base == "void":
            return "None"
        if base in NUMBERS:
            return NUMBERS[base]
        if base in self.enums:
            return "c_int"
        if base in self.structs:
            return base
        raise ValueError(f"{HERE.name}: what is `{base}`?")

    def member(self, struct, text):
        call = re.match(r"\s*(\w+) \(\*(\w+)\)\(([^)]*)\)", text)
        if call:
            kind = struct + call[2].capitalize()
            self.callbacks[kind] = self.signature(call[1], call[3])
            yield call[2], kind
            return
        base = re.match(r"\s*((?:const |volatile )*\w+(?: const\b)?)(.*)", text)
        for item in base[2].split(","):
            stars, name, sizes = re.match(r"\s*((?:\*\s*(?:const)?\s*)*)(\w+)((?:\[[^]]*\])*)", item).groups()
            kind = self.ctype(base[1], stars.count("*"))
            for size in reversed(re.findall(r"\[([^]]*)\]", sizes)):
                kind = f"{kind} * {eval(size, {}, self.constants)}"
                kind = f"({kind})" if sizes.count("[") > 1 else kind
            yield name, kind

    def signature(self, returns, arguments):
        given = []
        for a in filter(None, (a.strip() for a in arguments.split(","))):
            if a == "void":
                continue
            a, arrays = re.subn(r"\[[^]]*\]", "", a)
            base = re.match(r"((?:const |volatile )*\w+)", a)
            given.append(self.ctype(base[1], a.count("*") + (arrays > 0)))
        pointer = returns.count("*")
        result = self.ctype(returns.replace("*", " "), pointer)
        # A string that the caller frees must not become bytes: its address would be lost.
        return ("c_void_p" if result == "c_char_p" and "const" not in returns else result), given

    def estimators(self):
        """Of estimators.def: their names and numbers."""
        rows = re.findall(r'^SLT_\w+\(\s*(\w+),\s*"(.*?)"', (INCLUDE / "saltus/estimators.def").read_text(), re.M)
        return {name: self.constants["SLT_EST_" + row] for row, name in rows}

    def initial(self):
        """What the _INIT macros set, by struct: the size is always set."""
        found = {}
        for header in sorted((INCLUDE / "saltus").glob("*.h")):
            text = header.read_text().replace("\\\n", " ")
            for name, body in re.findall(r"#define SLT_\w+_INIT\s+\(\((\w+)\)\{(.*)\}\)", text):
                found[name] = {k: eval(v.replace("{", "(").replace("}", ")"), {}, self.constants) for k, v in
                               re.findall(r"\.(\w+) = (\{[^}]*\}|[^,]+)", body) if k != "struct_size"}
        return {name: found[name] for name in self.structs if name in found}


def names(kinds):
    return "[" + ", ".join(kinds) + "]"


def write():
    abi = Abi(preprocessed())
    used = {"CFUNCTYPE", "Structure", "c_int", "c_void_p", "c_char_p"} | set(NUMBERS.values())
    out = ['"""Structs, enums and functions of libsaltus, for ctypes. Written by generate.py from include/saltus; do not edit."""',
           "# fmt: off", f"from ctypes import {', '.join(sorted(used))}", ""]
    out += [f"{name} = {value}" for name, value in abi.constants.items()]
    for name, (result, given) in abi.callbacks.items():
        out.append(f"{name} = CFUNCTYPE({', '.join([result] + given)})")
    for name, members in abi.structs.items():
        out += ["", "", f"class {name}(Structure):", "    _fields_ = ["]
        out += [f'        ("{member}", {kind}),' for member, kind in members]
        out.append("    ]")
    out += ["", "", f"ESTIMATORS = {abi.estimators()}", "INITIAL = {  # what the _INIT macros set, beside the size"]
    out += [f"    {name}: {values}," for name, values in abi.initial().items()]
    out += ["}", "", "FUNCTIONS = {  # name: what it returns, what it takes"]
    out += [f'    "{name}": ({result}, {names(given)}),' for name, (result, given) in abi.functions.items()]
    out += ["}", ""]
    return "\n".join(out)


if __name__ == "__main__":
    if sys.argv[1:] == ["--print"]:
        sys.stdout.write(write())
    elif sys.argv[1:]:
        sys.exit(__doc__)
    else:
        (HERE / "saltus" / "_abi.py").write_text(write())
