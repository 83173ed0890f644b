"""Compares the declarations of external functions in Modelica with the C header."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

_FUNCTION = re.compile(
    r"function (?P<name>\w+)\b(?P<body>(?:(?!\bend \w+;).)*?)"
    r'external "C" (?:(?P<result>\w+) = )?(?P<c>\w+)\((?P<arguments>.*?)\)\s*(?:annotation|;)',
    re.DOTALL,
)
_VARIABLE = re.compile(
    r"^ *(?P<io>input|output) (?P<type>[\w.]+) (?P<name>\w+)(?P<array>\[[:, \d]+\])?", re.MULTILINE
)
_ARGUMENT = re.compile(r"size\((?P<sized>\w+), *\d+\)|(?P<name>\w+)")
_TYPES = {"Real": "double", "Integer": "int", "Boolean": "int", "String": "const char *"}
_FLAGS = ("-std=c89", "-pedantic-errors", "-Wall", "-Wextra", "-Werror", "-fsyntax-only")
_ERROR = re.compile(r"^(.+?):\d+(?::\d+)?: (?:fatal )?error: (.*)$", re.MULTILINE)


def check_externals(library: Path) -> Iterator[str]:
    """Yields problems with the external functions of the library EtherCAT.

    All declarations are compiled in one translation unit, as C89.
    """
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        yield "there is no C compiler to check external functions with"
        return
    resources = library / "Resources"
    include = [resources / "Include", resources / "Source" / "standalone"]
    unit = ['#include "ecat_modelica.h"']
    for file in sorted(library.rglob("*.mo")):
        for match in _FUNCTION.finditer(file.read_text("utf-8")):
            # With this line, an error names the function instead of a line of this unit.
            unit.append(f'#line 1 "{file.relative_to(library.parent)}: {match["name"]}"')
            unit.append(_declaration(match, f"declared{len(unit)}"))
    if len(unit) == 1:
        yield f"{library} has no external functions"
    yield from _compile(compiler, include, "\n".join(unit) + "\n")


def _declaration(match: re.Match[str], name: str) -> str:
    """Returns the declaration of a pointer to the function, with the type that Modelica declares.

    It is valid C only if the function in the header has the same type.
    """
    variables = {v["name"]: v for v in _VARIABLE.finditer(match["body"])}
    result = _c_type(variables[match["result"]]["type"]) if match["result"] else "void"
    parameters = [
        "size_t" if argument["sized"] else _parameter(variables[argument["name"]])
        for argument in _ARGUMENT.finditer(match["arguments"])
    ]
    return f"{result} (*{name})({', '.join(parameters) or 'void'}) = {match['c']};"


def _parameter(variable: re.Match[str]) -> str:
    kind = _c_type(variable["type"])
    if variable["array"]:
        return (
            f"const {kind} *".replace("const const", "const")
            if variable["io"] == "input"
            else f"{kind} *"
        )
    return kind + (" *" if variable["io"] == "output" else "")


def _c_type(kind: str) -> str:
    if kind.startswith("EtherCAT.Types."):
        return "int"  # enumerations
    if kind.startswith("Modelica.Units."):
        return "double"
    return _TYPES.get(kind, "void *")  # everything else is an external object


def _compile(compiler: str, include: list[Path], source: str) -> Iterator[str]:
    """Compiles the source, and yields a sentence for each error of the compiler."""
    done = subprocess.run(
        [compiler, *_FLAGS, *(f"-I{path}" for path in include), "-x", "c", "-"],
        input=source,
        env={**os.environ, "LC_ALL": "C"},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        errors = _ERROR.findall(done.stderr)
        yield from (f"{where}: {what}" for where, what in errors)
        if not errors:
            yield f"the declarations do not compile: {done.stderr.strip()}"
