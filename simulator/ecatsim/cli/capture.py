"""`ecatsim capture`: reads a real segment and writes a rig file that simulates it."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import tempfile
from pathlib import Path

from ecatd.model.atomic_write import check_owners
from ecatd.model.errors import UsageError

from ..capture import capture
from ..files.rig_writer import rig_text
from .options import Parser

_INTERRUPTED = 130


def add_arguments(parser: Parser, command: str) -> None:
    """Adds the arguments of the command to its parser."""
    del command
    parser.description = (
        "Scans a real segment and writes a rig file that simulates it: EEPROM images, slave "
        "controllers, topology, PDOs and object dictionaries. The slaves go to PREOP, and "
        "afterwards to the state they were in."
    )
    parser.add_argument(
        "--interface", metavar="IF", required=True, help="network interface of the slaves"
    )
    parser.add_argument(
        "-o",
        metavar="FILE",
        dest="output",
        type=Path,
        required=True,
        help="rig file to write, in .toml",
    )
    parser.add_argument("--force", action="store_true", help="overwrite FILE")
    parser.add_argument(
        "--no-objects", action="store_true", help="leave out object dictionaries (much faster)"
    )
    parser.set_defaults(execute=_capture)


def _capture(options: argparse.Namespace) -> int:
    output: Path = options.output
    _check(output, options.force)
    try:
        slaves = capture(options.interface, _progress, objects=not options.no_objects)
        _write(output, rig_text(output.stem, slaves), options.force)
    except KeyboardInterrupt:
        print("ecatsim: interrupted; nothing was written", file=sys.stderr)
        return _INTERRUPTED
    notes = sum(len(slave.notes) for slave in slaves)
    hint = f"; comments in it say what could not be captured ({notes})" if notes else ""
    count = "1 slave" if len(slaves) == 1 else f"{len(slaves)} slaves"
    print(f"{output}: {count}{hint}; `ecatsim run {output}` simulates them")
    return 0


def _progress(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def _check(output: Path, force: bool) -> None:
    """Checks before the scan whether the file can be written after it."""
    if output.suffix != ".toml":
        raise UsageError(f"'{output}' cannot be the name of a rig file: it must end in .toml")
    if output.exists() and not force:
        raise UsageError(f"'{output}' exists already; --force overwrites it")
    try:
        check_owners(output)
    except OSError as error:
        raise UsageError(f"cannot write '{output}': {error.strerror}") from error
    if not output.parent.is_dir():
        raise UsageError(f"cannot write '{output}': there is no folder '{output.parent}'")
    if not os.access(output.parent, os.W_OK):
        raise UsageError(f"cannot write '{output}': no right to write in '{output.parent}'")


def _write(output: Path, text: str, force: bool) -> None:
    """Writes the whole file, or nothing."""
    try:
        with tempfile.NamedTemporaryFile(
            "w", encoding="utf-8", dir=output.parent, prefix=f".{output.name}.", delete=False
        ) as file:
            temporary = Path(file.name)
            file.write(text)
        try:
            mask = os.umask(0)
            os.umask(mask)
            temporary.chmod(0o666 & ~mask)
            if force:
                temporary.replace(output)
            else:
                output.hardlink_to(temporary)  # fails if the file exists by now
        finally:
            with contextlib.suppress(FileNotFoundError):
                temporary.unlink()
    except FileExistsError as error:
        raise UsageError(f"'{output}' exists already; --force overwrites it") from error
    except OSError as error:
        raise UsageError(f"cannot write '{output}': {error.strerror}") from error
