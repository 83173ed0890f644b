"""Command `incident`: what the flight recorder has written."""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ecatd.base.errors import NoAnswerError, StateError, UsageError
from ecatd.base.timeouts import Timeout
from ecatd.operations.incidents import (
    DeleteIncident,
    ListIncidents,
    ReadIncident,
    RecordIncident,
)

from .arguments import connect
from .output import print_json, print_table
from .saving import add_force, add_out, check_target, save_bytes

if TYPE_CHECKING:
    from ecatd.base.incident_file import IncidentFile
    from ecatd.client.remote import Remote
    from ecatd.operations.incidents import Incident

COMMANDS = {
    "diagnosis": {
        "incident": "List, show, record, export and delete incidents of the flight recorder."
    }
}

_ACTIONS = ("list", "show", "export", "record", "delete")
_PAUSE = 0.1
"""Seconds between two looks whether an incident has been written."""
_MORE_S = 60.0
"""Seconds for that beside those behind the trigger."""
_TABLES = (".csv", ".txt", ".mo")
_FORMATS = (".mcap", ".pcapng", ".json", *_TABLES)


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments."""
    command.add_argument("action", choices=_ACTIONS, metavar="ACTION", help=", ".join(_ACTIONS))
    command.add_argument(
        "name",
        nargs="?",
        metavar="NAME",
        help="the incident, as `list` names it, or `last`; for show and export also a FILE.mcap, "
        "and for export a file of `ecatctl record`; for record: the reason",
    )
    command.add_argument(
        "--signal",
        action="append",
        default=[],
        metavar="[NAME=]SIGNAL",
        help=f"for export as {', '.join(_TABLES)}: only this value, such as '4/Channel 1/*'; NAME: "
        "the name that it gets; repeat it for more values",
    )
    add_out(command, f"for export: the file; its name ends in {', '.join(_FORMATS)}", "--out")
    add_force(command)


def incident(options: argparse.Namespace) -> None:
    """Carries out an action; a file on this machine needs no daemon."""
    if options.action in ("show", "export"):
        {"show": _show, "export": _export}[options.action](options)
        return
    with connect(options) as remote:
        {"list": _list, "record": _record, "delete": _delete}[options.action](remote, options)


def _list(remote: Remote, options: argparse.Namespace) -> None:
    found = remote.request(ListIncidents())
    if options.json:
        print_json({"bus": remote.bus, **found})
        return
    if not found["folder"]:
        print("ecatd records no incidents: flight_recorder.folder of its configuration is empty")
        return
    if not found["incidents"]:
        print(f"no incidents in {found['folder']}")
        return
    rows = [
        (
            item["name"],
            f"{item['bytes'] / 1e6:.1f} MB",
            item["trigger"],
            str(item["cycles"]),
            str(item["missing"]),
            item["reason"],
        )
        for item in found["incidents"]
    ]
    print_table(("NAME", "SIZE", "TRIGGER", "CYCLES", "MISSING", "REASON"), rows)


def _find(remote: Remote, options: argparse.Namespace) -> Incident:
    found = remote.request(ListIncidents())["incidents"]
    if not options.name:
        raise UsageError(f"incident {options.action} needs NAME: see `ecatctl incident list`")
    for item in found[-1:] if options.name == "last" else found:
        if options.name in ("last", item["name"]):
            return item
    raise StateError(f"there is no incident '{options.name}': `ecatctl incident list` shows them")


@contextmanager
def _local(options: argparse.Namespace) -> Iterator[Path]:
    """The incident as a file on this machine: that of the user, or a copy of the daemon's."""
    if options.name and Path(options.name).is_file():
        yield Path(options.name)
        return
    if options.name and ("/" in options.name or Path(options.name).suffix not in ("", ".mcap")):
        raise UsageError(f"{options.name} is not a file")
    with tempfile.TemporaryDirectory(prefix="ecatctl-") as folder:
        with connect(options) as remote:
            item = _find(remote, options)
            path = Path(folder) / item["name"]
            with path.open("wb") as file:
                while data := remote.request(ReadIncident(item["name"], file.tell()))["data"]:
                    file.write(data)
        yield path


@contextmanager
def _told(path: Path) -> Iterator[None]:
    """Tells why a file cannot be read."""
    try:
        yield
    except ImportError as error:
        raise StateError("incidents need the package mcap: pip install 'ecatd[record]'") from error
    except ValueError as error:
        raise StateError(str(error)) from error
    except OSError as error:
        raise StateError(f"{path} cannot be read: {error.strerror}") from error


def _open(path: Path) -> IncidentFile:
    from ecatd.base.incident_file import IncidentFile

    with _told(path):
        return IncidentFile(path)


def _attachment(found: IncidentFile, name: str) -> bytes:
    with _told(found.path):
        return found.attachment(name)


def _show(options: argparse.Namespace) -> None:
    with _local(options) as path:
        found = _open(path)
        reading = _attachment(found, "reading.txt").decode(errors="replace")
        if options.json:
            signals = found.signals
            what: dict[str, Any] = {"file": path.name, "reading": reading}
            print_json({"bus": found.bus, **what, "attachments": found.sizes, "signals": signals})
        else:
            print(reading, end="")


def _export(options: argparse.Namespace) -> None:
    if options.out is None:
        raise UsageError("incident export needs --out FILE")
    suffix = options.out.suffix.lower()
    if suffix not in _FORMATS:
        raise UsageError(f"{options.out}: give a file name that ends with {', '.join(_FORMATS)}")
    if options.signal and suffix not in _TABLES:
        raise UsageError(f"--signal chooses values of a table: {', '.join(_TABLES)}")
    targets = [options.out]
    if suffix == ".mo":
        targets.append(options.out.with_suffix(".txt"))
    for target in targets:
        check_target(target, force=options.force)
    with _local(options) as path:
        contents = _contents(path, options)
    # The block comes last: if it is there, its table is, too.
    for target, data in reversed([*zip(targets, contents, strict=True)]):
        save_bytes(target, data, force=options.force)
    if options.json:
        files = [str(target) for target in targets]
        sizes = [len(data) for data in contents]
        print_json({"file": files[0], "bytes": sizes[0], "files": files})
    else:
        for target, data in zip(targets, contents, strict=True):
            print(f"{target}: {len(data)} bytes")


def _contents(path: Path, options: argparse.Namespace) -> list[bytes]:
    """What goes into each file of an export."""
    suffix = options.out.suffix.lower()
    if suffix in _TABLES:
        return _tables(path, options)
    if suffix == ".mcap":
        return [path.read_bytes()]
    name = {".pcapng": "frames.pcapng", ".json": "events.json"}[suffix]
    return [_attachment(_open(path), name)]


def _tables(path: Path, options: argparse.Namespace) -> list[bytes]:
    from ecatd.base.incident_file import IncidentFile, NoIncidentError

    from . import incident_tables as tables

    with _told(path):
        try:
            found = IncidentFile(path) if path.suffix.lower() == ".mcap" else None
        except NoIncidentError:
            found = None
        if found is not None:
            table = tables.incident_table(found, options.signal)
        else:
            table = tables.recording_table(path, options.signal)
    for note in table.source.notes:
        print(f"ecatctl: warning: {note}", file=sys.stderr)
    match options.out.suffix.lower():
        case ".csv":
            texts = [tables.csv_table(table)]
        case ".txt":
            texts = [tables.combi_time_table(table)]
        case _:
            texts = [tables.modelica_block(table, options.out), tables.combi_time_table(table)]
    return [text.encode() for text in texts]


def _record(remote: Remote, options: argparse.Namespace) -> None:
    begin = time.monotonic()
    after_s = remote.configuration()[0].flight_recorder.after_s
    patience = Timeout(after_s + _MORE_S, "flight_recorder.after_s")
    asked = remote.request(RecordIncident(options.name or ""))
    while True:
        found = [
            item
            for item in remote.request(ListIncidents())["incidents"]
            # A request within the window of another incident belongs to that one.
            if item["time_ns"] // 1000 >= asked["time_ns"] // 1000 - int(1e6 * after_s)
        ]
        if found:
            break
        if time.monotonic() - begin > patience.seconds:
            raise NoAnswerError(
                f"the incident has not been written within {patience}: the log of "
                "ecatd says why (`ecatctl log`)"
            )
        time.sleep(_PAUSE)
    if options.json:
        print_json({"bus": remote.bus, **found[0]})
    else:
        print(f"{found[0]['name']}: {found[0]['cycles']} cycles", file=sys.stdout)


def _delete(remote: Remote, options: argparse.Namespace) -> None:
    item = _find(remote, options)
    left = remote.request(DeleteIncident(item["name"]))["incidents"]
    if options.json:
        print_json({"bus": remote.bus, "deleted": item["name"], "left": len(left)})
    else:
        print(f"{item['name']} deleted, {len(left)} left")
