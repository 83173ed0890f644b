"""Command `incident`: what the flight recorder has written."""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ecatd.base.errors import NoAnswerError, StateError, UsageError
from ecatd.base.timeouts import Timeout
from ecatd.operations.incident_files import SUFFIX, describe
from ecatd.operations.incidents import (
    NO_RECORDER,
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
        "names",
        nargs="*",
        metavar="NAME",
        help="the incident, as `list` names it, or `last`; for list and show also a FILE.mcap or a "
        "folder of such files, or several of them; for export also a FILE.mcap, or a file of "
        "`ecatctl record`; for record: the reason",
    )
    command.add_argument(
        "--signal",
        action="append",
        default=[],
        metavar="[NAME=]SIGNAL",
        help=f"for export as {', '.join(_TABLES)}: only this value, such as "
        "'4/AI Standard Channel 1/*'; NAME: the name that it gets; repeat it for more values",
    )
    command.add_argument(
        "--paths",
        action="store_true",
        help="for export as .csv: the columns of `ecatctl record`, each value under its path such "
        "as '4/AI Standard Channel 1/Value', and empty where it is missing",
    )
    add_out(command, f"for export: the file; its name ends in {', '.join(_FORMATS)}", "--out")
    add_force(command)


def incident(options: argparse.Namespace) -> None:
    """Carries out an action; a file on this machine needs no daemon."""
    action, names = options.action, options.names
    if len(names) > 1 and action in ("export", "delete"):
        raise UsageError(f"incident {action} takes one NAME, not {len(names)}")
    options.name = " ".join(names) if action == "record" else names[0] if names else ""
    if action == "list" and names:
        _list_files(options)
    elif action in ("show", "export"):
        {"show": _show, "export": _export}[action](options)
    else:
        with connect(options) as remote:
            {"list": _list, "record": _record, "delete": _delete}[action](remote, options)


def _list_files(options: argparse.Namespace) -> None:
    found = []
    for path in _files(options.names):
        with _told(path):
            found.append((path, describe(path)))
    found.sort(key=lambda item: item[1]["time_ns"])
    if options.json:
        print_json({"incidents": [{"file": str(path), **item} for path, item in found]})
    else:
        _print_list("FILE", ((str(path), item) for path, item in found))


def _files(names: Sequence[str]) -> Iterator[Path]:
    """Files on this machine: those named, and the incidents of named folders."""
    for name in names:
        path = Path(name)
        if path.is_dir():
            with _told(path):
                inside = sorted(path.glob(f"*{SUFFIX}"))
            found = [*filter(_is_incident, inside)]
            if not found:
                raise StateError(f"there are no incidents in {path}")
            yield from found
        elif path.is_file():
            yield path
        else:
            raise UsageError(f"{path} is neither a file nor a folder")


def _is_incident(path: Path) -> bool:
    with suppress(OSError, ValueError):
        describe(path)
        return True
    return False


def _print_list(head: str, named: Iterable[tuple[str, Incident]]) -> None:
    rows = [
        (
            name,
            _utc(item["time_ns"]),
            item["trigger"],
            f"{item['seconds']:.1f} s",
            f"{item['bytes'] / 1e6:.1f} MB",
            _cause(item),
        )
        for name, item in named
    ]
    print_table((head, "TRIGGERED (UTC)", "TRIGGER", "LENGTH", "SIZE", "CAUSE"), rows, "   >>")


def _utc(time_ns: int) -> str:
    return time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime(time_ns // 10**9))


def _cause(item: Incident) -> str:
    """Why there is an incident: who has asked for it, and what the reading says."""
    if item["trigger"] == "request" and item["cause"]:
        return f"{item['reason']}; {item['cause']}"
    return item["cause"] or item["reason"]


def _list(remote: Remote, options: argparse.Namespace) -> None:
    found = remote.request(ListIncidents())
    if options.json:
        print_json({"bus": remote.bus, **found})
        return
    if not found["folder"]:
        print(NO_RECORDER)
        return
    if not found["incidents"]:
        print(f"no incidents in {found['folder']}")
        return
    _print_list("NAME", ((item["name"], item) for item in found["incidents"]))


def _find(remote: Remote, options: argparse.Namespace) -> Incident:
    if not options.name:
        raise UsageError(f"incident {options.action} needs NAME: see `ecatctl incident list`")
    answer = remote.request(ListIncidents())
    if not answer["folder"]:
        raise StateError(NO_RECORDER)
    found = answer["incidents"]
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
    names = options.names
    if len(names) > 1 or (names and Path(names[0]).is_dir()):
        shown = [_shown(path, str(path)) for path in _files(names)]
    else:
        with _local(options) as path:
            shown = [_shown(path, path.name)]
    if options.json:
        print_json({"incidents": shown})
        return
    for number, item in enumerate(shown):
        if len(shown) > 1:
            print(f"{chr(10) * bool(number)}{item['file']}")
        print(item["reading"], end="")
        if item["damage"]:
            print(f"ecatctl: warning: {item['damage']}", file=sys.stderr)


def _shown(path: Path, name: str) -> dict[str, Any]:
    """What `show` tells of a file."""
    found = _open(path)
    with _told(path):
        damage = found.damage()
    try:
        reading = _attachment(found, "reading.txt").decode(errors="replace")
    except StateError as error:
        if not damage:
            raise
        reading = f"{error}\n"
    what: dict[str, Any] = {"file": name, "bus": found.bus, "reading": reading}
    return {**what, "damage": damage, "attachments": found.sizes, "signals": found.signals}


def _export(options: argparse.Namespace) -> None:
    if options.out is None:
        raise UsageError("incident export needs --out FILE")
    suffix = options.out.suffix.lower()
    if suffix not in _FORMATS:
        raise UsageError(f"{options.out}: give a file name that ends with {', '.join(_FORMATS)}")
    if options.signal and suffix not in _TABLES:
        raise UsageError(f"--signal chooses values of a table: {', '.join(_TABLES)}")
    if options.paths and suffix != ".csv":
        raise UsageError("--paths is for an export as .csv")
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
            texts = [tables.path_table(table) if options.paths else tables.csv_table(table)]
        case ".txt":
            texts = [tables.combi_time_table(table)]
        case _:
            texts = [tables.modelica_block(table, options.out), tables.combi_time_table(table)]
    return [text.encode() for text in texts]


def _record(remote: Remote, options: argparse.Namespace) -> None:
    begin = time.monotonic()
    after_s = remote.configuration()[0].flight_recorder.after_s
    patience = Timeout(after_s + _MORE_S, "flight_recorder.after_s")
    asked = remote.request(RecordIncident(options.name))
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
