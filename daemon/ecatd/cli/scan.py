"""Command `scan`: the description of a bus as a file, from which libraries can be generated."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

from ecatd.model.bus import Bus
from ecatd.model.bus_file import dump
from ecatd.model.errors import NotPermittedError, StateError
from ecatd.version import VERSION

from .bus_source import get_bus
from .output import print_json


def scan(options: argparse.Namespace) -> None:
    """Prints the description of the bus, or saves it."""
    bus = get_bus(options)
    text = dump(bus, VERSION)
    if options.out is None:
        sys.stdout.write(text)
        return
    save(options.out, text)
    inputs, outputs = (_entries(bus, outputs=which) for which in (False, True))
    if options.json:
        print_json(
            {
                "bus": bus.name,
                "file": str(options.out),
                "fingerprint": f"{bus.fingerprint:016x}",
                "slaves": len(bus.slaves),
                "inputs": inputs,
                "outputs": outputs,
            }
        )
        return
    print(
        f"{options.out}: bus {bus.name}, {len(bus.slaves)} slaves with {inputs} inputs and "
        f"{outputs} outputs; 'ecatctl generate NAME DIR --from {options.out}' makes a library of it"
    )


def _entries(bus: Bus, *, outputs: bool) -> int:
    return sum(1 for slave in bus.slaves for _ in slave.entries(outputs=outputs))


def save(path: Path, text: str) -> None:
    """Writes a file as a whole: what was there is still there if that fails.

    Raises:
        NotPermittedError: The file cannot be written.
        StateError: The disk is full, or something else is in the way.
    """
    try:
        if path.exists() and not path.is_file():  # /dev/stdout, a pipe
            path.write_text(text, "utf-8")
            return
        target = path.resolve()  # of a link: what it leads to
        fd, name = tempfile.mkstemp(prefix=f".{target.name}-", dir=target.parent)
        try:
            with os.fdopen(fd, "w", encoding="utf-8") as file:
                file.write(text)
            Path(name).chmod(_mode(target))
            Path(name).replace(target)
        except BaseException:
            with suppress(OSError):
                Path(name).unlink()
            raise
    except PermissionError as error:
        raise NotPermittedError(f"{path} cannot be written: {error.strerror}") from error
    except OSError as error:
        raise StateError(f"{path} cannot be written: {error.strerror}") from error


def _mode(path: Path) -> int:
    """The rights of a file that is there, else those that a new one gets."""
    with suppress(OSError):
        return path.stat().st_mode & 0o777
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask
