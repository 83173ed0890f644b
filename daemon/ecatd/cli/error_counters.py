"""Command `errors`: error counters of the slaves, and which links they are about."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from ecatd.base.errors import NoAnswerError, UsageError
from ecatd.description.bus import Bus
from ecatd.etg.port_errors import LinkErrors, PortErrors, SlaveErrors, links_with_errors

from .arguments import add_slave, add_watch
from .output import print_json, print_json_line, print_table
from .watch import check

if TYPE_CHECKING:
    from ecatd.client.remote import Remote

COMMANDS = {
    "diagnosis": {"errors": "Show the error counters of the slaves, and which cables cause errors."}
}

_PORTS = 4


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments of the command."""
    add_slave(command)
    command.add_argument("-a", "--all", action="store_true", help="show the counters of all ports")
    command.add_argument(
        "--reset", action="store_true", help="clear the counters after showing them"
    )
    add_watch(command)


def errors(remote: Remote, options: argparse.Namespace) -> int:
    """Shows the error counters; with `--watch`, by how much they rise.

    Returns the exit status: 4 if slaves do not answer.
    """
    check(options)
    if options.reset and options.watch is not None:
        raise UsageError("--reset and --watch: give one of them")
    bus = remote.describe()
    chosen = None if options.slave is None else bus.find(options.slave).position
    found = remote.errors()
    silent = _silent(bus, chosen, found)
    _print(bus, found, chosen, options)
    for label in silent:
        print(f"ecatctl: {label} does not answer, so its counters are not known", file=sys.stderr)
    if options.reset:
        if len(silent) < len(bus.slaves) if chosen is None else not silent:
            remote.reset_errors(chosen)
        if not options.json and not silent:
            print("the counters are cleared")
    if options.watch is None:
        return NoAnswerError.exit_code if silent else 0
    done = 1
    while options.watch is not None and done != options.count:
        time.sleep(options.watch)
        now = remote.errors()
        new = list(_added(found, now))
        if options.json:
            print_json_line(_document(bus, new, chosen))
        else:
            clock = time.strftime("%H:%M:%S")
            for line in _sentences(bus, new, chosen):
                print(f"{clock} {line}", flush=True)
        found, done = now, done + 1
    return 0


def _silent(bus: Bus, chosen: int | None, found: Sequence[SlaveErrors]) -> list[str]:
    """The slaves that should be there, and do not answer."""
    there = {item.position for item in found}
    return [
        slave.label
        for slave in bus.slaves
        if slave.position not in there
        and chosen in (None, slave.position)
        and (not slave.group or chosen is not None)
    ]


def _added(before: Sequence[SlaveErrors], now: Sequence[SlaveErrors]) -> Iterator[SlaveErrors]:
    """By how much the counters have risen. A smaller counter was cleared, so all of it counts."""
    earlier = {item.position: item for item in before}
    for item in now:
        old = earlier.get(item.position)
        if old is None:
            yield item
            continue
        ports = [
            PortErrors.of(port.port, map(_more, was.counts, port.counts), port.to)
            for was, port in zip(old.ports, item.ports, strict=True)
        ]
        yield item._replace(
            ports=ports,
            processing=_more(old.processing, item.processing),
            pdi=_more(old.pdi, item.pdi),
        )


def _more(before: int, now: int) -> int:
    return now - before if now >= before else now


def _links(found: Sequence[SlaveErrors], chosen: int | None) -> list[LinkErrors]:
    """The links with errors; of one slave, those that end there."""
    return [
        link
        for link in links_with_errors(found)
        if chosen is None or chosen in {end[0] for end in link.ends if end is not None}
    ]


def _of(chosen: int | None, found: Sequence[SlaveErrors]) -> list[SlaveErrors]:
    return [item for item in found if chosen in (None, item.position)]


def _document(bus: Bus, found: Sequence[SlaveErrors], chosen: int | None) -> dict[str, Any]:
    links = [item._asdict() for item in _links(found, chosen)]
    slaves = [item.to_map() for item in _of(chosen, found)]
    return {
        "bus": bus.name,
        "slaves": slaves,
        "links": links,
        "silent": _silent(bus, chosen, found),
    }


def _print(
    bus: Bus, found: Sequence[SlaveErrors], chosen: int | None, options: argparse.Namespace
) -> None:
    if options.json:
        show = print_json if options.watch is None else print_json_line
        show(_document(bus, found, chosen))
        return
    if options.all:
        print_table(
            ("POS", "NAME", "PORT", "LEADS TO", "INVALID", "PHYSICAL", "FORWARDED", "LOST LINKS"),
            _rows(bus, _of(chosen, found)),
            ">   >>>>",
        )
        print()
    lines = list(_sentences(bus, found, chosen))
    count = len(_of(chosen, found))
    if lines:
        print("\n".join(lines))
    elif count:
        print(f"no errors at the ports of {count} slave{'s' * (count != 1)}")


def _rows(bus: Bus, found: Sequence[SlaveErrors]) -> Iterator[tuple[Any, ...]]:
    for item in found:
        name = bus.slaves[item.position].display_name
        for port in item.ports:
            if port.to is None and not any(port.counts):
                continue
            where = "" if port.to is None else _end(bus, port.to)
            yield item.position, name, port.port, where, *port.counts


def _sentences(bus: Bus, found: Sequence[SlaveErrors], chosen: int | None) -> Iterator[str]:
    """What the counters mean, link by link and slave by slave."""
    since = {item.position: item.since for item in found}
    for link in _links(found, chosen):
        yield f"{_where(bus, link)}: {_counts(link)}{_since(since[link.ends[1][0]])}{_advice(link)}"
    for item in _of(chosen, found):
        label = bus.slaves[item.position].label
        if item.processing and not any(port.forwarded or port.damaged for port in item.ports):
            yield (
                f"{label}: {item.processing} frames that are malformed or not "
                f"EtherCAT{_since(item.since)}: look for a device on this wire that is no "
                "EtherCAT slave"
            )
        if item.pdi:
            yield (
                f"{label}: {item.pdi} errors between its controller and its processor (PDI)"
                f"{_since(item.since)}: the device itself is at fault"
            )


def _where(bus: Bus, link: LinkErrors) -> str:
    first, second = link.ends
    if first is None:
        return f"at {_end(bus, second)}"
    return f"between {_end(bus, first)} and {_end(bus, second)}"


def _end(bus: Bus, end: tuple[int, int]) -> str:
    position, port = end
    return "the master" if position < 0 else f"{bus.slaves[position].label} port {port}"


def _counts(link: LinkErrors) -> str:
    parts = [
        f"{count} {word if count == 1 else words}"
        for count, word, words in (
            (link.invalid, "damaged frame", "damaged frames"),
            (link.physical, "error of the physical layer", "errors of the physical layer"),
            (link.lost_links, "loss of the link", "losses of the link"),
        )
        if count
    ]
    more = " (a counter has reached 255, its maximum, so there may be more)" if link.full else ""
    text = " and ".join([", ".join(parts[:-1]), parts[-1]] if parts[1:] else parts)
    return text + more


def _since(when: float | None) -> str:
    if when is None:
        return ""
    day = "" if time.time() - when < 86400 else "%Y-%m-%d "
    return time.strftime(f" since {day}%H:%M:%S", time.localtime(when))


def _advice(link: LinkErrors) -> str:
    if link.invalid or link.physical:
        return ": check this cable, its plugs, and sources of interference near it"
    return ": check this cable and its plugs, and the power of both sides"
