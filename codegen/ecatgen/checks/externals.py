"""External functions: what Modelica declares against what the header offers."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
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


def check_externals(library: Path) -> Iterator[str]:
    """Problems with the external functions of the library EtherCAT.

    Each declaration is compiled in a translation unit of its own, as C89.
    """
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        yield "there is no C compiler to check external functions with"
        return
    resources = library / "Resources"
    include = [resources / "Include", resources / "Source" / "standalone"]
    found = 0
    for file in sorted(library.rglob("*.mo")):
        for match in _FUNCTION.finditer(file.read_text("utf-8")):
            found += 1
            error = _compile(compiler, include, _unit(match))
            if error:
                yield f"{file.relative_to(library.parent)}: {match['name']}: {error}"
    if found == 0:
        yield f"{library} has no external functions"


def _unit(match: re.Match[str]) -> str:
    """A translation unit that is valid if the function has the declared type."""
    variables = {v["name"]: v for v in _VARIABLE.finditer(match["body"])}
    result = _c_type(variables[match["result"]]["type"]) if match["result"] else "void"
    parameters = [
        "size_t" if argument["sized"] else _parameter(variables[argument["name"]])
        for argument in _ARGUMENT.finditer(match["arguments"])
    ]
    return (
        '#include "ecat_modelica.h"\n'
        f"{result} (*declared)({', '.join(parameters) or 'void'}) = {match['c']};\n"
    )


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


def _compile(compiler: str, include: list[Path], source: str) -> str:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "unit.c"
        file.write_text(source)
        paths = [f"-I{path}" for path in include]
        done = subprocess.run(
            [compiler, *_FLAGS, *paths, str(file)], capture_output=True, text=True, check=False
        )
    return "" if done.returncode == 0 else done.stderr.strip() or "does not compile"
