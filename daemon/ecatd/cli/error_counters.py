"""Command `errors`: error counters of the slaves, and how good each cable is."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from ecatd.base.errors import NoAnswerError, UsageError
from ecatd.description.bus import Bus
from ecatd.description.cables import BAD, STRAINED, LinkVerdict, risen
from ecatd.etg.port_errors import LinkErrors, SlaveErrors, links_with_errors

from .arguments import add_slave, add_watch
from .output import print_json, print_json_line, print_table
from .watch import check

if TYPE_CHECKING:
    from ecatd.client.remote import Remote

COMMANDS = {
    "diagnosis": {"errors": "Show the error counters of the slaves, and how good each cable is."}
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
    found, verdicts = remote.cables()
    silent = _silent(bus, chosen, found)
    _print(bus, found, _at(verdicts, chosen), chosen, options)
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
        now, verdicts = remote.cables()
        new, of_links = list(risen(found, now)), _at(verdicts, chosen)
        if options.json:
            print_json_line(_document(bus, new, of_links, chosen))
        else:
            clock = time.strftime("%H:%M:%S")
            for line in _counted(bus, new, of_links, chosen):
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


def _at(verdicts: Sequence[LinkVerdict], chosen: int | None) -> list[LinkVerdict]:
    """The verdicts on all links, or on those of one slave."""
    return [item for item in verdicts if chosen in (None, item.slave, item.before)]


def _links(found: Sequence[SlaveErrors], chosen: int | None) -> list[LinkErrors]:
    """The links with errors; of one slave, those that end there."""
    return [
        link
        for link in links_with_errors(found)
        if chosen is None or chosen in {end[0] for end in link.ends if end is not None}
    ]


def _of(chosen: int | None, found: Sequence[SlaveErrors]) -> list[SlaveErrors]:
    return [item for item in found if chosen in (None, item.position)]


def _document(
    bus: Bus, found: Sequence[SlaveErrors], verdicts: Sequence[LinkVerdict], chosen: int | None
) -> dict[str, Any]:
    return {
        "bus": bus.name,
        "slaves": [item.to_map() for item in _of(chosen, found)],
        "links": [item._asdict() for item in verdicts],
        "counted": [item._asdict() for item in _links(found, chosen)],
        "silent": _silent(bus, chosen, found),
    }


def _print(
    bus: Bus,
    found: Sequence[SlaveErrors],
    verdicts: Sequence[LinkVerdict],
    chosen: int | None,
    options: argparse.Namespace,
) -> None:
    if options.json:
        show = print_json if options.watch is None else print_json_line
        show(_document(bus, found, verdicts, chosen))
        return
    if options.all:
        print_table(
            ("POS", "NAME", "PORT", "LEADS TO", "INVALID", "PHYSICAL", "FORWARDED", "LOST LINKS"),
            _rows(bus, _of(chosen, found)),
            ">   >>>>",
        )
        print()
    lines = [f"{item.verdict}: {item.text}" for item in verdicts if _is_told(item, options.all)]
    counted = list(_counted(bus, found, verdicts, chosen))
    count = len(_of(chosen, found))
    if lines or counted:
        print("\n".join([*lines, *counted]))
    elif count:
        print(f"no errors at the ports of {count} slave{'s' * (count != 1)}")


def _is_told(item: LinkVerdict, all_links: bool) -> bool:
    return all_links or item.verdict in (STRAINED, BAD)


def _rows(bus: Bus, found: Sequence[SlaveErrors]) -> Iterator[tuple[Any, ...]]:
    for item in found:
        name = bus.slaves[item.position].display_name
        for port in item.ports:
            if port.to is None and not any(port.counts):
                continue
            where = "" if port.to is None else _end(bus, port.to)
            yield item.position, name, port.port, where, *port.counts


def _counted(
    bus: Bus, found: Sequence[SlaveErrors], verdicts: Sequence[LinkVerdict], chosen: int | None
) -> Iterator[str]:
    """What the counters have counted, link by link and slave by slave."""
    since = {item.position: item.since for item in found}
    judged = {(item.slave, item.port): item.verdict for item in verdicts}
    for link in _links(found, chosen):
        verdict = judged.get(link.ends[1])
        counts = f"{_counts(link)}{_since(since[link.ends[1][0]])}"
        yield f"{_where(bus, link)}: {counts}{f' (the cable: {verdict})' if verdict else ''}"
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
