"""Man pages of all commands, and completion for bash, zsh and fish.

`python -m ecatdev.command_pages share` writes them from the parsers, with argparse-manpage and
shtab. The files are in the repository, so that a build or installation does not need these two.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

import shtab
from argparse_manpage.manpage import Manpage

import ecatd.cli.main
import ecatd.service.main
import ecatsim.cli.main
from ecatd.base.lazy_command import LazyCommand

_PARSERS = {
    "ecatd": ecatd.service.main.make_parser,
    "ecatctl": ecatd.cli.main.make_parser,
    "ecatsim": ecatsim.cli.main.make_parser,
}
_COMPLETION = {
    "bash": "bash-completion/completions/{}",
    "zsh": "zsh/site-functions/_{}",
    "fish": "fish/vendor_completions.d/{}.fish",
}
"""Path of the completion of a command below /usr/share, by shell."""


def pages() -> dict[str, str]:
    """Returns the text of all files, by their path below /usr/share."""
    files = {}
    for name, make_parser in _PARSERS.items():
        files[f"man/man1/{name}.1"] = _man_page(_declared(make_parser()))
        for shell, place in _COMPLETION.items():
            files[place.format(name)] = shtab.complete(_declared(make_parser()), shell)
    return files


def _man_page(parser: argparse.ArgumentParser) -> str:
    data = {
        "manual_section": "1",
        "project_name": "ecatd",
        "description": (parser.description or "").split(".")[0],
    }
    text = _with_epilogs(str(Manpage(parser, _data=data, format="pretty")), parser)
    # No date, because it would change the page every day.
    header = f'.TH {parser.prog.upper()} "1" "" "ecatd" "User Commands"'
    text = text.replace(".SH COMMENTS\n", ".SH NOTES\n")
    return "\n".join(header if line.startswith(".TH ") else line for line in text.splitlines())


def _with_epilogs(text: str, parser: argparse.ArgumentParser) -> str:
    """Adds the epilogs of commands, such as lists of their actions, which Manpage leaves out.

    Raises:
        ValueError: A command with an epilog is not in the page.
    """
    commands = {one.prog: one.epilog for one in _with_commands(parser) if one is not parser}
    for prog, epilog in commands.items():
        if not epilog:
            continue
        name = f"\\fI\\,'{_escaped(prog)}'\\/\\fR"
        end = text.index("\n.SH ", text.index(f".SH OPTIONS {name}"))
        notes = _escaped(epilog.rstrip())
        notes = f".nf\n{notes}\n.fi" if "\n" in notes else notes  # lists keep their lines
        text = f"{text[:end]}\n.SH NOTES {name}\n{notes}\n{text[end:]}"
    return text


def _escaped(text: str) -> str:
    """Returns a text with the special characters of roff escaped."""
    escaped = text.replace("\\", "\\e").replace("-", "\\-")
    return "\n".join(
        f"\\&{line}" if line.startswith((".", "'")) else line for line in escaped.split("\n")
    )


def _declared(parser: argparse.ArgumentParser) -> argparse.ArgumentParser:
    """Makes all commands of a parser declare their arguments, and returns the parser."""
    for one in _with_commands(parser):
        for action in one._actions:
            if isinstance(action.choices, dict) and not isinstance(
                action, argparse._SubParsersAction
            ):
                action.choices = list(action.choices)  # shtab mistakes a dict for commands
            if action.type is Path or action.metavar == "DIR":
                what = shtab.DIRECTORY if action.metavar == "DIR" else shtab.FILE
                action.complete = what  # type: ignore[attr-defined]
    return parser


def _with_commands(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    if isinstance(parser, LazyCommand):
        parser.declare()
    yield parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for command in {id(one): one for one in action.choices.values()}.values():
                yield from _with_commands(command)


def main() -> None:
    """Writes all files into the folder that the command line names."""
    for path, text in pages().items():
        file = Path(sys.argv[1]) / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text.rstrip("\n") + "\n")


if __name__ == "__main__":
    main()
