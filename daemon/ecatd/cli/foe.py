"""Commands `foe-read` and `foe-write`: files of a slave, such as firmware (FoE)."""

from __future__ import annotations

import argparse
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from ecatd.base.errors import EcatError, NoAnswerError, StateError, UnreachableError, UsageError
from ecatd.description.bus import Slave
from ecatd.operations.fields import FILE_MAX

from .arguments import add_one_slave, add_yes, bounded, confirm
from .output import print_json, progress
from .saving import add_force, add_out, check_target, read_bytes, save_bytes

if TYPE_CHECKING:
    from ecatd.client.file_transfer import FileTransfer
    from ecatd.client.remote import Remote

COMMANDS = {
    "mailboxes": {
        "foe-read": "Read a file of a slave (FoE).",
        "foe-write": "Write a file to a slave, such as firmware (FoE).",
    },
}

_STDOUT = Path("-")
_PAUSES = 0.02, 0.2
"""Seconds between two requests for the progress of a transfer: the first ones, and later ones."""
_RECONNECTIONS, _RECONNECTION_PAUSE = 10, 1.0
_STEPS = {"to boot": "the slave goes to BOOT", "from boot": "the slave comes back from BOOT"}


def add_arguments(command: argparse.ArgumentParser, name: str) -> None:
    """Adds the arguments of a command."""
    add_one_slave(command)
    if name == "foe-read":
        command.add_argument("name", metavar="NAME", help="name of the file in the slave")
        add_out(command, "save it in this file; - prints it", "--out", required=True)
        add_force(command)
    else:
        command.add_argument("file", metavar="FILE", type=Path, help="the file to write")
        command.add_argument(
            *("--as", "-n"),
            dest="name",
            metavar="NAME",
            help="name of the file in the slave (default: the name of FILE)",
        )
        command.add_argument(
            "--cancel",
            action="store_true",
            help="only cancel the transfer that the same command has started",
        )
    command.add_argument(
        "--password",
        type=bounded(0, 0xFFFFFFFF),
        default=0,
        metavar="NUMBER",
        help="password that the slave wants for this file",
    )
    command.add_argument(
        "--boot", action="store_true", help="bring the slave to BOOT first, and back afterwards"
    )
    add_yes(command)


def foe_read(remote: Remote, options: argparse.Namespace) -> None:
    """Reads a file, and saves or prints it."""
    if options.json and options.out == _STDOUT:
        raise UsageError("with --json, -o must name a file")
    if options.out == _STDOUT and sys.stdout.isatty():
        raise UsageError("a terminal cannot show a file of a slave: name a file, or pipe it")
    if options.out != _STDOUT:
        check_target(options.out, force=options.force)
    found = remote.describe().find(options.slave)
    if options.boot:
        confirm(options, f"This brings {found.label} to BOOT, where it exchanges no process data.")
    begin = time.monotonic()

    def start(*, only_find: bool = False) -> FileTransfer:
        return remote.start_file_read(
            *(found.position, options.name),
            password=options.password,
            boot=options.boot,
            only_find=only_find,
        )

    try:
        transfer = start()
        _follow(transfer)
        data = transfer.result()
    except KeyboardInterrupt:
        with suppress(StateError):  # it has ended, or was not started yet
            start(only_find=True).cancel()
        raise
    if options.out != _STDOUT:
        save_bytes(options.out, data, force=options.force)
    elif not options.json:
        sys.stdout.buffer.write(data)
    _report(remote, options, found, transfer, time.monotonic() - begin, "read")


def foe_write(remote: Remote, options: argparse.Namespace) -> None:
    """Writes a file, after a question."""
    name = options.name or options.file.name
    data = read_bytes(options.file, FILE_MAX)
    found = remote.describe().find(options.slave)
    about = f"This writes {len(data)} bytes to {found.label}, as file '{name}'."
    if options.boot:
        about += (
            " Before, ecatd brings it to BOOT, where it exchanges no process data, and "
            "afterwards back."
        )

    def start(*, only_find: bool) -> FileTransfer:
        return remote.start_file_write(
            *(found.position, name, data),
            password=options.password,
            boot=options.boot,
            only_find=only_find,
        )

    if options.cancel:
        _cancel(remote, options, found, start(only_find=True), name)
        return
    confirm(options, about)
    begin = time.monotonic()
    transfer = start(only_find=False)
    try:
        _insist(remote, transfer)
    except KeyboardInterrupt:
        if transfer.step != "receiving":
            print(
                "\necatctl: the daemon goes on with the file; repeat the command to see how far "
                "it is",
                file=sys.stderr,
            )
        raise
    _report(remote, options, found, transfer, time.monotonic() - begin, "written")


def _cancel(
    remote: Remote, options: argparse.Namespace, found: Slave, transfer: FileTransfer, name: str
) -> None:
    """Cancels a transfer.

    Raises:
        StateError: It was done before.
    """
    transfer.cancel()
    if transfer.step == "done":
        raise StateError(f"{found.label}: file '{name}' was written before it could be cancelled")
    if options.json:
        document = {"bus": remote.bus, "slave": found.position, "file": name}
        print_json({**document, "bytes": transfer.moved, "cancelled": True})
    else:
        print(f"{found.label}: file '{name}': the transfer was cancelled")


def _insist(remote: Remote, transfer: FileTransfer) -> None:
    """Follows a transfer that is written, also over a restart of the gateway.

    The bus server knows the transfer by its number, also if it has ended meanwhile. The same
    request as at the start would write a file that is done once more.

    Raises:
        EcatError: It has failed, or the daemon no longer answers.
    """
    for left in reversed(range(_RECONNECTIONS)):
        try:
            _follow(transfer)
            return
        except (UnreachableError, NoAnswerError) as error:
            if transfer.has_failed:
                raise
            if not left:
                raise type(error)(
                    f"{error}. If the daemon runs, it goes on with the file; repeat the command "
                    "to see how far it is"
                ) from error
            time.sleep(_RECONNECTION_PAUSE)
            with suppress(EcatError):
                remote.reconnect()


def _follow(transfer: FileTransfer) -> None:
    """Shows how far a transfer is, until it is done.

    Raises:
        EcatError: It has failed.
    """
    begin, (pause, longest) = time.monotonic(), _PAUSES
    with progress() as show:
        while transfer.step == "receiving":
            show("the file goes to the daemon")
            transfer.send()
        while not transfer.look():
            show(_text(transfer, time.monotonic() - begin))
            time.sleep(pause)
            pause = min(2 * pause, longest)


def _text(transfer: FileTransfer, seconds: float) -> str:
    """How far it is: `120.5 of 482.0 kB, 25 %, 61.3 kB/s`."""
    if transfer.step in _STEPS:
        return _STEPS[transfer.step]
    moved = f"{transfer.moved / 1e3:.1f}"
    if transfer.size:
        share = 100 * transfer.moved / transfer.size
        moved += f" of {transfer.size / 1e3:.1f} kB, {share:.0f} %"
    else:
        moved += " kB"
    busy = f", the slave is busy ({transfer.busy})" if transfer.busy else ""
    return f"{moved}, {transfer.moved / 1e3 / seconds:.1f} kB/s{busy}"


def _report(
    remote: Remote,
    options: argparse.Namespace,
    found: Slave,
    transfer: FileTransfer,
    seconds: float,
    verb: str,
) -> None:
    """Reports the result.

    Raises:
        StateError: The slave does not come back from BOOT.
    """
    if options.json:
        print_json(
            {
                "bus": remote.bus,
                "slave": found.position,
                "file": options.name or options.file.name,
                "bytes": transfer.moved,
                "seconds": round(seconds, 3),
                "note": transfer.note,
            }
        )
    else:
        out = sys.stderr if verb == "read" and options.out == _STDOUT else sys.stdout
        print(f"{found.label}: {transfer.moved} bytes {verb} in {seconds:.1f} s", file=out)
    if transfer.note:
        raise StateError(f"the file was {verb}, but {transfer.note}")
