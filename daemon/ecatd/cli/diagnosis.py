"""Command `diagnosis`: the diagnosis history of a slave (object 0x10F3, ETG.1020)."""

from __future__ import annotations

import argparse
import datetime
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from ecatd.base.errors import SdoAbortError, StateError
from ecatd.description.bus import Slave
from ecatd.etg.diagnosis import (
    ACKNOWLEDGED,
    HISTORY,
    MOST,
    NEWEST,
    DiagnosisMessage,
    order,
    parse_message,
)
from ecatd.etg.error_codes import NO_OBJECT

from .arguments import add_one_slave, add_yes, confirm
from .output import counted, print_json, print_table

if TYPE_CHECKING:
    from ecatd.client.remote import Remote

COMMANDS = {"diagnosis": {"diagnosis": "Show the diagnosis history of a slave (object 0x10F3)."}}

_KEYS = ("code", "text_id", "time_ns", "local_time", "parameters")
_EPOCH = datetime.datetime(2000, 1, 1, tzinfo=datetime.UTC)
"""Distributed clocks count from here (ETG.1000.4)."""
_FIRST_YEAR_NS = 365 * 86400 * 10**9
"""A clock that was not set counts from the moment when the slave was switched on."""


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments of the command."""
    add_one_slave(command)
    command.add_argument(
        "--esi", metavar="PATH", help="take the texts from this ESI file, or a folder of them"
    )
    command.add_argument("--clear", action="store_true", help="delete all messages")
    add_yes(command)


def diagnosis(remote: Remote, options: argparse.Namespace) -> None:
    """Shows the messages, the oldest first, or deletes them."""
    found = remote.describe().find_coe(options.slave)
    newest = _read(remote, found, NEWEST)
    if options.clear:
        confirm(options, f"This deletes the diagnosis history of {found.label}.")
        remote.sdo_write(found.position, HISTORY, ACKNOWLEDGED, b"\0")
        if options.json:
            print_json({"bus": remote.bus, "slave": found.position, "messages": []})
        else:
            print(f"the diagnosis history of {found.label} is empty")
        return
    texts = _texts(found, options.esi)
    most = _read(remote, found, MOST)
    messages = list(_messages(remote, found, order(newest, most)))
    if options.json:
        rows = [_document(item, texts) for item in messages]
        print_json({"bus": remote.bus, "slave": found.position, "messages": rows})
    elif not messages:
        print(f"the diagnosis history of {found.label} is empty")
    else:
        print_table(
            ("WHEN", "KIND", "CODE", "MESSAGE"),
            (
                (_when(item), item.kind_name, f"0x{item.code:08X}", item.text(texts))
                for item in messages
            ),
        )


def _read(remote: Remote, found: Slave, subindex: int) -> int:
    try:
        return int.from_bytes(remote.sdo_read(found.position, HISTORY, subindex).data, "little")
    except SdoAbortError as error:
        if error.code != NO_OBJECT:
            raise
        raise StateError(
            f"{found.label} has no diagnosis history (object 0x{HISTORY:04X}); `ecatctl events` "
            "shows the emergencies that it has sent"
        ) from error


def _texts(found: Slave, source: str | None) -> dict[int, str]:
    if source is None:
        return {}
    from .esi_devices import device_of

    return device_of(found, source).diagnosis_texts


def _messages(remote: Remote, found: Slave, places: list[int]) -> Iterator[DiagnosisMessage]:
    for subindex in counted(places, "messages"):
        data = remote.sdo_read(found.position, HISTORY, subindex).data
        try:
            message = parse_message(data)
        except StateError as error:
            where = f"{found.label}, 0x{HISTORY:04X}:{subindex:02X}"
            raise StateError(f"{where}: {error} ({data.hex(' ')})") from error
        if message is not None:
            yield message


def _when(item: DiagnosisMessage) -> str:
    if item.local_time or item.time_ns < _FIRST_YEAR_NS:
        return f"{item.time_ns / 1e9:.3f} s"
    moment = _EPOCH + datetime.timedelta(microseconds=item.time_ns // 1000)
    return moment.astimezone().strftime("%Y-%m-%d %H:%M:%S.%f")[:-3]


def _document(item: DiagnosisMessage, texts: dict[int, str]) -> dict[str, Any]:
    return {
        **{key: getattr(item, key) for key in _KEYS},
        "kind": item.kind_name,
        "text": item.text(texts),
    }
