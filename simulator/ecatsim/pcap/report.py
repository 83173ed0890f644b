"""What a capture has in it, as a document for programs and as lines for people."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ecatd.base.pcap_reader import PcapReader
from ecatd.base.sanitized_output import printable
from ecatd.etg.al import AlState, al_state_text, al_status_text
from ecatd.etg.error_codes import abort_text

from .mailboxes import Sdo
from .segment import LRD, LWR, Area, Segment, Slave, StateChange
from .wire import Pairing

_COMMANDS = {LRD: "LRD", LWR: "LWR"}
_ERROR, _STATE = 0x10, 0x0F
_HEAD: tuple[str, ...] = (
    *("POS", "STATION", "VENDOR:PRODUCT:REVISION", "NAME", "STATES", "OUT", "IN"),
)
_SHOWN, _BYTES_SHOWN = 20, 16
_PORTS = 4


@dataclass(slots=True)
class Capture:
    """A capture that was read.

    Attributes:
        path: The file.
        reader: Its reader, with remarks.
        pairing: Its frames.
        segment: Its slaves and process data.
    """

    path: Path
    reader: PcapReader
    pairing: Pairing
    segment: Segment


def read_capture(path: Path) -> Capture:
    """Reads a file.

    Raises:
        ConfigError: It cannot be read, or is no capture.
    """
    capture = Capture(path, PcapReader(path), Pairing(), Segment())
    for exchange in capture.pairing.exchanges(capture.reader.frames()):
        capture.segment.take(exchange)
    return capture


# --- the document --------------------------------------------------------------------------------


def document(capture: Capture) -> dict[str, Any]:
    """Everything that is known, with times in seconds since the first datagram."""
    segment, pairing = capture.segment, capture.pairing
    begin = segment.first_ns
    return {
        "schema": 1,
        "file": str(capture.path),
        "frames": pairing.frames,
        "other_frames": pairing.others,
        "seconds": (segment.last_ns - begin) / 1e9,
        "slave_count": segment.count or None,
        "reference_clock": segment.clock.position if segment.clock else None,
        "states": [
            _state(change, begin) | {"state": states_text(change.status)}
            for change in segment.states
        ],
        "slaves": [_slave(slave, begin, set_up=_set_up(segment)) for slave in segment.in_order()],
        "process_data": [_area(area) for area in segment.areas.values()],
        "faults": list(faults(capture)),
        "unknown": list(unknown(capture)),
    }


def _state(change: StateChange, begin: int) -> dict[str, Any]:
    return {
        "at": (change.time_ns - begin) / 1e9,
        "state": al_state_text(change.status),
        "al_status_code": change.code,
    }


def states_text(status: int) -> str:
    """The AL status of a broadcast in words: all slaves together, ORed."""
    names = [state.name for state in AlState if state.bit_count() == 1 and state & status]
    return "/".join(names) + ("+ERROR" if status & _ERROR else "")


def _slave(slave: Slave, begin: int, *, set_up: bool) -> dict[str, Any]:
    identity = slave.identity
    keys = ("vendor", "product", "revision", "serial")
    managers = slave.sync_managers
    return {
        "position": slave.position,
        "station": slave.station or None,
        "name": slave.name,
        **dict(zip(keys, identity or (None,) * 4, strict=True)),
        "states": [_state(change, begin) for change in slave.states],
        "output_bytes": _bytes(slave, set_up=set_up, outputs=True),
        "input_bytes": _bytes(slave, set_up=set_up, outputs=False),
        "sync_managers": [
            {
                "number": item.number,
                "start": item.start,
                "bytes": item.size,
                "mailbox": item.mailbox,
                "outputs": item.outputs,
            }
            for item in managers
            if item.enabled
        ],
        "eeprom": "whole" if slave.image is not None else "part" if slave.words else "none",
        "sdos": [_sdo(sdo, begin) for sdo in slave.mailbox.sdos],
        "emergencies": [
            {
                "at": (item.time_ns - begin) / 1e9,
                "code": item.code,
                "register": item.register,
                "data": item.data.hex(),
            }
            for item in slave.mailbox.emergencies
        ],
        "other_messages": dict(slave.mailbox.messages),
        "port_errors": list(slave.port_errors),
    }


def _set_up(segment: Segment) -> bool:
    """Whether the capture has how the master sets up the process data of slaves."""
    return any(slave.fmmus for slave in segment.slaves)


def _bytes(slave: Slave, *, set_up: bool, outputs: bool) -> int | None:
    """Bytes of process data in one direction; None if the master was not seen setting them up."""
    return sum(item.size for item in slave.fmmus if item.outputs == outputs) if set_up else None


def _sdo(sdo: Sdo, begin: int) -> dict[str, Any]:
    return {
        "at": (sdo.time_ns - begin) / 1e9,
        "index": sdo.index,
        "subindex": sdo.subindex,
        "complete": sdo.complete,
        "written": sdo.writes,
        "data": None if sdo.data is None else sdo.data.hex(),
        "abort_code": sdo.abort or None,
    }


def _area(area: Area) -> dict[str, Any]:
    cycle = area.cycle_us
    return {
        "command": _COMMANDS.get(area.command, "LRW"),
        "address": area.address,
        "bytes": area.size,
        "exchanges": area.exchanges,
        "lost": area.lost,
        "working_counters": {str(wkc): count for wkc, count in area.counters.most_common()},
        "cycle_us": None if cycle is None else dict(zip(_CYCLE, cycle, strict=True)),
        "last": area.last.hex(),
        "bytes_that_changed": sum(area.changed),
    }


_CYCLE = ("median", "shortest", "longest")


def faults(capture: Capture) -> Iterator[str]:
    """What went wrong on the wire and in the slaves, in sentences."""
    segment, pairing = capture.segment, capture.pairing
    if pairing.lost:
        yield f"{pairing.lost} of {pairing.frames} frames did not come back"
    for area in segment.areas.values():
        wrong = sum(area.counters.values()) - area.counters[area.usual]
        if wrong:
            counts = ", ".join(f"{n} ({c} times)" for n, c in area.counters.most_common())
            yield f"{_place(area)}: the working counter was not always {area.usual}: {counts}"
        elif area.counters and not area.usual:
            yield f"{_place(area)}: no slave has exchanged it (working counter 0)"
    if len(segment.counts) > 1:
        counts = ", ".join(f"{n} ({c} times)" for n, c in segment.counts.most_common())
        yield f"not always the same number of slaves has answered: {counts}"
    for slave in segment.in_order():
        for change in slave.states:
            if change.status & _ERROR:
                code = f", code {al_status_text(change.code)}" if change.code else ""
                yield f"{label(slave)}: AL error in {al_state_text(change.status & _STATE)}{code}"
        for sdo in slave.mailbox.sdos:
            if sdo.abort:
                yield (
                    f"{label(slave)}: refused to {'write' if sdo.writes else 'read'} "
                    f"0x{sdo.index:04X}:{sdo.subindex:02X}: 0x{sdo.abort:08X}, "
                    f"{abort_text(sdo.abort)}"
                )
        for item in slave.mailbox.emergencies:
            yield (
                f"{label(slave)}: emergency 0x{item.code:04X}, error register "
                f"0x{item.register:02X}, data {item.data.hex(' ')}"
            )
        errors = slave.port_errors
        for port in range(_PORTS):
            frames, physical, lost = errors[2 * port], errors[2 * port + 1], errors[16 + port]
            if frames or physical or lost:
                yield (
                    f"{label(slave)}, port {port}: {frames} invalid frames, {physical} physical "
                    f"errors, {lost} lost links (as last read)"
                )


def unknown(capture: Capture) -> Iterator[str]:
    """What the capture does not tell, or was not understood, in sentences."""
    for remarks in (capture.reader.remarks, capture.pairing.remarks, capture.segment.unread):
        for remark, count in remarks.items():
            yield f"{remark} ({count})" if count > 1 else remark
    segment = capture.segment
    if not capture.pairing.frames:
        yield "there are no EtherCAT frames in it"
        return
    if segment.count > len(segment.slaves):
        yield (
            f"{segment.count} slaves have answered, but only {len(segment.slaves)} were addressed "
            "alone"
        )
    for slave in segment.in_order():
        missing = []
        if slave.position is None:
            missing.append("position")
        if slave.identity is None:
            missing.append("identity")
        if slave.image is None:
            missing.append("a part of its EEPROM" if slave.words else "EEPROM")
        if not _set_up(segment):
            missing.append("process data")
        if slave.mailbox.malformed:
            missing.append(f"{slave.mailbox.malformed} malformed mailbox messages")
        if missing:
            yield f"{label(slave)}: not in the capture: {', '.join(missing)}"


# --- lines for people ----------------------------------------------------------------------------


def label(slave: Slave) -> str:
    """The slave as messages name it."""
    if slave.position is None:
        text = f"the slave with the station address 0x{slave.station:04X}"
    else:
        text = f"slave {slave.position}"
    return f"{text} ({printable(slave.name)})" if slave.name else text


def lines(capture: Capture) -> Iterator[str]:
    """Everything that people want to know, in lines."""
    segment, pairing = capture.segment, capture.pairing
    seconds = (segment.last_ns - segment.first_ns) / 1e9
    others = f", and {pairing.others} others" if pairing.others else ""
    yield f"{capture.path}: {pairing.frames} EtherCAT frames in {seconds:.3f} s{others}"
    slaves = segment.in_order()
    if slaves:
        yield ""
        rows = [_HEAD, *(_row(slave, set_up=_set_up(segment)) for slave in slaves)]
        widths = [max(len(row[n]) for row in rows) for n in range(len(rows[0]))]
        for row in rows:
            cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
            yield "  ".join(cells).rstrip()
    if segment.clock is not None:
        yield f"the clock of {label(segment.clock)} is the reference clock"
    yield from _section("process data", map(_area_line, segment.areas.values()))
    sdos = ((slave, sdo) for slave in slaves for sdo in slave.mailbox.sdos)
    yield from _section("SDOs", (_sdo_line(slave, sdo) for slave, sdo in sdos))
    other = (
        f"{label(slave)}: {count} {name} messages"
        for slave in slaves
        for name, count in slave.mailbox.messages.items()
    )
    yield from _section("other messages", other)
    yield from _section("faults", faults(capture))
    yield from _section("not known", unknown(capture))


def _section(title: str, texts: Iterator[str]) -> Iterator[str]:
    found = list(texts)
    if found:
        yield from ("", f"{title}:")
        yield from (f"  {text}" for text in found[:_SHOWN])
        if len(found) > _SHOWN:
            yield f"  and {len(found) - _SHOWN} more (--json has all)"


def _row(slave: Slave, *, set_up: bool) -> tuple[str, ...]:
    identity = slave.identity
    states = [al_state_text(change.status) for change in slave.states]
    shown = " ".join(states[:6]) + (" ..." if len(states) > 6 else "")
    sizes = (_bytes(slave, set_up=set_up, outputs=outputs) for outputs in (True, False))
    return (
        "?" if slave.position is None else str(slave.position),
        f"0x{slave.station:04X}" if slave.station else "-",
        f"{identity[0]:08x}:{identity[1]:08x}:{identity[2]:08x}" if identity else "?",
        printable(slave.name) or "-",
        shown or "-",
        *("?" if size is None else str(size) for size in sizes),
    )


def _place(area: Area) -> str:
    name = _COMMANDS.get(area.command, "LRW")
    return f"{name} of {area.size} bytes at 0x{area.address:08X}"


def _area_line(area: Area) -> str:
    cycle = area.cycle_us
    every = ""
    if cycle is not None:
        every = f" every {cycle[0]:.0f} µs ({cycle[1]:.0f} to {cycle[2]:.0f})"
    changed = sum(area.changed)
    return (
        f"{_place(area)}: {area.exchanges} exchanges{every}, working counter {area.usual}, "
        f"{changed} bytes have changed"
    )


def _sdo_line(slave: Slave, sdo: Sdo) -> str:
    what = "writes" if sdo.writes else "reads"
    where = f"0x{sdo.index:04X}" if sdo.complete else f"0x{sdo.index:04X}:{sdo.subindex:02X}"
    if sdo.data is None:
        value = f"refused, 0x{sdo.abort:08X}"
    else:
        more = " ..." if len(sdo.data) > _BYTES_SHOWN else ""
        value = sdo.data[:_BYTES_SHOWN].hex(" ") + more
    return f"{label(slave)}: {what} {where}: {value}"
