"""An incident, and its file: MCAP, which Rerun, PlotJuggler and Lichtblick open.

The file has three channels: `/BUS/cycles` with a message for each cycle (protobuf, so that integers
stay exact), `/BUS/events` and `/BUS/log` with lines of a log. All else is attached.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from ecatd.base.cycle_messages import (
    LOG_NAME,
    LOG_SCHEMA,
    CycleMessages,
    MessageField,
    identifier,
    log_message,
)
from ecatd.base.incident_file import CYCLE, FIELDS, SIGNALS
from ecatd.base.paths import give_to_group
from ecatd.base.pcapng import Frame, header, packet
from ecatd.base.recording_file import iso_utc
from ecatd.base.version import VERSION
from ecatd.etg.scaling import to_physical
from ecatd.operations.incident_files import METADATA, PART
from ecatd.operations.traces import TraceSignal

OWN = (
    MessageField(CYCLE, "uint64"),
    MessageField("missing_before", "uint64"),
    MessageField("exchange_us", "float64"),
    MessageField("incomplete_domains", "uint32"),
)
"""Fields of each message before those of the entries: number of the cycle, how many cycles before
it are missing, time from its first frame to its last answer, domains whose last exchange failed."""
LAPSES = ("lapsed", "died", "gone")
"""Why outputs became safe, if their client has not given them back."""
CYCLES, EVENTS, LOG = "cycles", "events", "log"
"""Ends of topics."""


@dataclass(slots=True)
class Row:
    """A cycle."""

    number: int  #: Its number.
    time_ns: int  #: Unix time of its last answer.
    exchange_us: float  #: From its first frame to its last answer.
    incomplete: int  #: Domains whose last exchange failed.
    values: list[float | None]  #: The raw value of each entry; None if it is an older one.
    unanswered: int = 0  #: Frames without an answer.


@dataclass(slots=True)
class Trigger:
    """What begins an incident."""

    kind: str  #: `fault`, `lapse`, `condition` or `request`.
    time_ns: int  #: Unix time.
    reason: str  #: A sentence.
    cause: str = ""  #: What is alike in triggers of the same cause; see `Budget`.


@dataclass(slots=True)
class Incident:
    """All that a file has."""

    bus: str  #: Name of the bus.
    triggers: list[Trigger]  #: What has begun it, and what followed within its window.
    signals: list[TraceSignal]  #: The entries.
    rows: list[Row]  #: The cycles.
    events: list[dict[str, Any]]  #: Events, the oldest first.
    lines: list[dict[str, Any]]  #: Lines of the log, as they are published.
    interfaces: list[str]  #: Names of the interfaces.
    frames: list[Frame]  #: All frames, in the order of time.
    clock_ns: int  #: The time of a frame plus this is Unix time.
    reading: str = ""  #: What has happened, in words.
    cause: str = ""  #: Its cause, in a sentence; empty if none is known.
    documents: dict[str, Any] = field(default_factory=dict)  #: JSON documents, by name.

    @property
    def missing(self) -> int:
        """How many cycles between the first and the last one are missing."""
        return self.rows[-1].number - self.rows[0].number + 1 - len(self.rows) if self.rows else 0

    @property
    def seconds(self) -> float:
        """From the first cycle to the last one."""
        return (self.rows[-1].time_ns - self.rows[0].time_ns) / 1e9 if self.rows else 0.0


class SignalFields:
    """How the entries are fields of a message.

    Each has its physical value, and one with a scale its raw value, too, which a replay needs.
    """

    def __init__(self, signals: Sequence[Mapping[str, Any]]) -> None:
        self.signals = signals
        names: dict[str, str] = {item.name: item.type for item in OWN}
        self.described: list[dict[str, Any]] = []
        self._scaled: list[int] = []
        for signal in signals:
            name = identifier(f"slave_{signal['name']}", names)
            is_scaled = (signal["scale"], signal["offset"]) != (1.0, 0.0)
            names[name] = "float64" if is_scaled else signal["type"]
            self.described.append({**signal, "field": name, "raw": name})
        for number, entry in enumerate(self.described):
            if (entry["scale"], entry["offset"]) != (1.0, 0.0):
                entry["raw"] = identifier(f"{entry['field']}_raw", names)
                names[entry["raw"]] = entry["type"]
                self._scaled.append(number)
        self.messages = CycleMessages([MessageField(*item) for item in names.items()])

    def pack(self, row: Row, missing: int) -> bytes:
        """The message of a cycle."""
        physical: list[float | None] = [*row.values]
        for number in self._scaled:
            signal, raw = self.signals[number], row.values[number]
            if raw is not None:
                physical[number] = to_physical(raw, signal["scale"], signal["offset"])
        raws = (row.values[number] for number in self._scaled)
        own = (row.number, missing, row.exchange_us, row.incomplete)
        return self.messages.pack([*own, *physical, *raws])


def write(path: Path, incident: Incident) -> None:
    """Writes the file: under another name first, so that there is never half a file of this name.

    Raises:
        OSError: It cannot be written, for example because the disk is full; nothing is left of it.
        ImportError: The package `mcap` is missing.
    """
    unfinished = path.with_suffix(PART)
    try:
        with unfinished.open("wb") as out:
            os.fchmod(out.fileno(), 0o640)
            give_to_group(out.fileno())
            _write(import_module("mcap.writer").Writer(out), incident)
            out.flush()
            os.fsync(out.fileno())
        unfinished.rename(path)
    except BaseException:
        with suppress(OSError):
            unfinished.unlink(missing_ok=True)
        raise


def _write(writer: Any, incident: Incident) -> None:
    bus, first = incident.bus, incident.triggers[0]
    writer.start(library=f"ecatd {VERSION}")
    facts = {
        "bus": bus,
        "time_ns": str(first.time_ns),
        "trigger": first.kind,
        "reason": first.reason[:2000],
        "cause": incident.cause[:2000],
        "cycles": str(len(incident.rows)),
        "seconds": f"{incident.seconds:.3f}",
        "missing": str(incident.missing),
        "version": VERSION,
    }
    writer.add_metadata(METADATA, facts)
    fields = SignalFields(incident.signals)
    schema = writer.register_schema("ecatd.Cycle", "protobuf", fields.messages.schema)
    about = {SIGNALS: json.dumps(fields.described), FIELDS: json.dumps(fields.messages.fields)}
    cycles = writer.register_channel(f"/{bus}/{CYCLES}", "protobuf", schema, about)
    log = writer.register_schema(LOG_NAME, "protobuf", LOG_SCHEMA)
    events = writer.register_channel(f"/{bus}/{EVENTS}", "protobuf", log)
    lines = writer.register_channel(f"/{bus}/{LOG}", "protobuf", log)
    before = None
    for row in incident.rows:
        missing = 0 if before is None else row.number - before - 1
        before = row.number
        _add(writer, cycles, row.time_ns, row.number, fields.pack(row, missing))
    for number, event in enumerate(incident.events):
        text = log_message(event["time_ns"], event["severity"], event["text"], event["event"])
        _add(writer, events, event["time_ns"], number, text)
    for line in incident.lines:
        text = log_message(line["time_ns"], line["level"], line["text"], line["part"])
        _add(writer, lines, line["time_ns"], line["sequence"], text)
    pcap = [header(incident.interfaces, first.reason)]
    pcap += [packet(frame, incident.clock_ns) for frame in incident.frames]
    _attach(writer, first, "frames.pcapng", "application/x-pcapng", b"".join(pcap))
    _attach(writer, first, "reading.txt", "text/plain", incident.reading.encode())
    log_text = "".join(
        f"{iso_utc(line['time_ns'])} {line['level']}: {line['text']}\n" for line in incident.lines
    )
    _attach(writer, first, "log.txt", "text/plain", log_text.encode())
    for name, document in {**incident.documents, "events": incident.events}.items():
        data = json.dumps(document, indent=1, default=repr).encode()
        _attach(writer, first, f"{name}.json", "application/json", data)
    writer.finish()


def _add(writer: Any, channel: int, time_ns: int, sequence: int, data: bytes) -> None:
    writer.add_message(
        channel_id=channel,
        log_time=time_ns,
        publish_time=time_ns,
        sequence=sequence & 0xFFFFFFFF,
        data=data,
    )


def _attach(writer: Any, first: Trigger, name: str, kind: str, data: bytes) -> None:
    writer.add_attachment(first.time_ns, first.time_ns, name, kind, data)
