"""Every command that a message of any program advises can be typed as it stands there."""

import argparse
import ast
import contextlib
import io
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

from ecatd.base.errors import UsageError
from ecatd.cli.main import make_parser as ecatctl
from ecatd.service.main import make_parser as ecatd
from ecatsim.cli.main import make_parser as ecatsim

ROOT = Path(__file__).parents[2]
PARSERS: dict[str, argparse.ArgumentParser] = {
    "ecatctl": ecatctl(),
    "ecatd": ecatd(),
    "ecatsim": ecatsim(),
}
ADVICE = re.compile(r"([`'])(?:sudo )?((?:ecatctl|ecatsim|ecatd) [^`'\n]+)\1")
SYNTAX = frozenset("[]…|*")
NAMED_ONLY = re.compile("arguments are required|expected one argument")
"""What is said of a command or an option whose name alone stands in a text."""
HOLE = "\0"
"""Stands in a text for what is known only when the program runs."""
C_TEXTS = re.compile(r'"(?:[^"\\\n]|\\.)*"(?:\s*"(?:[^"\\\n]|\\.)*")*')
C_HOLE = re.compile(r"%[-.*0-9l]*[a-z]")


def python_texts(path: Path) -> Iterator[str]:
    """The texts of a program; an f-string is one text."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.JoinedStr):
            yield "".join(
                str(part.value) if isinstance(part, ast.Constant) else HOLE for part in node.values
            )
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def c_texts(path: Path) -> Iterator[str]:
    for match in C_TEXTS.finditer(path.read_text()):
        yield C_HOLE.sub(HOLE, re.sub(r'"\s*"', "", match[0]))


def pages(path: Path) -> Iterator[str]:
    yield re.sub(r"@ECAT_[A-Z]+@", HOLE, path.read_text())


KINDS = (
    ("**/*.py", python_texts),
    ("**/*.[ch]", c_texts),
    ("**/*.mo", c_texts),
    ("**/*.catalog", pages),
)


def advised() -> Iterator[tuple[str, str]]:
    """Where each command is advised, and the command with values in its holes."""
    for top in ("daemon", "simulator", "codegen", "client_c", "systemd"):
        for pattern, texts in KINDS:
            for path in sorted((ROOT / top).glob(pattern)):
                for text in texts(path):
                    for match in ADVICE.finditer(text):
                        if SYNTAX & set(match[2]):  # usage in a docstring
                            continue
                        command = re.sub(rf"{HOLE}(?=[a-z])|(?<=[a-z]){HOLE}", "", match[2])
                        yield str(path.relative_to(ROOT)), command.replace(HOLE, "3")


def complaint(command: str) -> str:
    """What the program says of a command; empty if all is well, or if only its name is there."""
    program, *arguments = shlex.split(command)
    errors = io.StringIO()
    with contextlib.redirect_stderr(errors), contextlib.redirect_stdout(io.StringIO()):
        try:
            PARSERS[program].parse_args(arguments)
        except (SystemExit, UsageError) as end:
            if getattr(end, "code", "") == 0:
                return ""
            said = str(end) if isinstance(end, UsageError) else errors.getvalue().splitlines()[-1]
            named = arguments[-1].startswith("-") or len(arguments) <= 2
            named = named and NAMED_ONLY.search(said)
            return "" if named else said
    return ""


def test_an_advised_command_is_one() -> None:
    commands = {command: place for place, command in advised()}
    assert len(commands) > 60
    said = {command: (complaint(command), place) for command, place in commands.items()}
    assert not {command: why for command, why in said.items() if why[0]}


def test_a_wrong_command_is_found() -> None:
    assert complaint("ecatctl pdos --slave 3")
    assert complaint("ecatctl sdo-reed 0 0x6060")
