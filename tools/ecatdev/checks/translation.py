"""Checks a library with two independent Modelica front ends, pymoca and rumoca."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

_INTERFACE = Path(__file__).parent / "Modelica"


def check_syntax(library: Path) -> Iterator[str]:
    """Yields a problem for each file that pymoca cannot parse."""
    from pymoca import parser

    for file in sorted(library.rglob("*.mo")):
        try:
            parser.parse(file.read_text("utf-8"))
        except parser.ModelicaSyntaxError as error:
            yield f"{file.relative_to(library.parent)}: {error}"


def check_translation(
    out: Path, models: Iterable[str], standard_library: Path | None = None
) -> Iterator[str]:
    """Translates models with rumoca, and yields the problems that it finds.

    rumoca resolves names, checks types and counts equations. It does not support ExternalObject,
    functions with several outputs in when-clauses, or getInstanceName() in a constructor. So it
    reads a copy of the libraries with these changes: external objects are Integers, and their
    constructors are functions; a function with several outputs is split into one function per
    output; and all instances have the same name.

    Args:
        out: Directory with the libraries.
        models: Full names of the models, each in a file of its own.
        standard_library: Directory with the Modelica Standard Library. By default, a stand-in with
            the interfaces that our libraries need is used.
    """
    import rumoca

    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "libraries"
        shutil.copytree(out, copy, ignore=lambda _, names: [n for n in names if n == "Resources"])
        if standard_library is None:
            shutil.copytree(_INTERFACE, copy / "Modelica")
        _replace_external_objects(copy)
        _split_functions(copy)
        roots = [str(copy), *([str(standard_library)] if standard_library else [])]
        for model in models:
            file = copy.joinpath(*model.split(".")).with_suffix(".mo")
            try:
                rumoca.Session(roots=roots).load(str(file), model=model)
            except rumoca.RumocaError as error:
                yield f"{model}: {error}"


def _replace_external_objects(copy: Path) -> None:
    objects = [
        file for file in copy.rglob("*.mo") if "extends ExternalObject;" in file.read_text("utf-8")
    ]
    names = "|".join(file.stem for file in objects)
    call = re.compile(rf"(EtherCAT\.Objects\.)({names})\(")
    for file in copy.rglob("*.mo"):
        source = file.read_text("utf-8").replace("getInstanceName()", '"instance"')
        file.write_text(call.sub(r"\1new\2(", source))
    for file in objects:
        source = file.read_text("utf-8")
        constructor = source.split("function constructor", 1)[1].split("end constructor;", 1)[0]
        file.with_name(f"new{file.name}").write_text(
            f"within EtherCAT.Objects;\n"
            f"impure function new{file.stem}{constructor}end new{file.stem};\n"
        )
        file.write_text(f"within EtherCAT.Objects;\ntype {file.stem} = Integer;\n")
    order = copy / "EtherCAT" / "Objects" / "package.order"
    order.write_text(order.read_text() + "".join(f"new{file.stem}\n" for file in objects))


_CALL = re.compile(r"\((?P<targets>\w+(?:, \w+)+)\) =\s+(?P<name>[\w.]+)\((?P<inputs>[^()]*)\);")


def _split_functions(copy: Path) -> None:
    for file in copy.rglob("*.mo"):
        source = file.read_text("utf-8")
        for call in _CALL.finditer(source):
            _split_function(copy, call["name"], len(call["targets"].split(",")))
        file.write_text(_CALL.sub(_split_call, source))


def _split_call(call: re.Match[str]) -> str:
    return "\n    ".join(
        f"{target} = {call['name']}Output{number}({call['inputs']});"
        for number, target in enumerate(call["targets"].split(", "))
    )


def _split_function(copy: Path, name: str, targets: int) -> None:
    file = copy.joinpath(*name.split(".")).with_suffix(".mo")
    lines = file.read_text("utf-8").splitlines()
    inputs = "\n".join(line for line in lines if line.startswith("  input "))
    outputs = [line for line in lines if line.startswith("  output ")]
    for number, output in enumerate(outputs[:targets]):
        part = file.with_name(f"{file.stem}Output{number}.mo")
        part.write_text(
            f"{lines[0]}\nimpure function {part.stem}\n{inputs}\n{output}\n"
            f'  external "C" {output.split()[2]} = {part.stem}();\nend {part.stem};\n'
        )
        order = file.with_name("package.order")
        if part.stem not in order.read_text().split():
            order.write_text(f"{order.read_text()}{part.stem}\n")
