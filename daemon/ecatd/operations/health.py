"""Says what is wrong with a bus: for `ecatctl check`, the status of the service, and the metrics.

The bus server knows it: what interfaces and exchange do, and how the slaves are. No single witness
is believed: slaves in OP are no proof that the exchange succeeds, nor the reverse.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ecatd.description.bus import Slave, display_name
from ecatd.etg.al import AlState
from ecatd.operations.bus import SlaveAlState

from .faults import Fault

_ABSENT, _EXCHANGED = "absent", "exchanged"
_DAY = 86400.0
_SILENT_S = 12.0
"""Seconds without a question of the main process, which comes every second, before that counts."""


@dataclass(frozen=True, slots=True)
class Health:
    """The health of a bus."""

    rows: list[SlaveAlState]  #: AL states of all slaves, as `ReadStates` is answered.
    #: Number of slaves that should be there: all but optional ones that are absent, and those that
    #: were missing at the start, so that they are no part of the bus.
    expected: int
    in_op: int  #: Number of those that are in OP.
    missing: int  #: Number of those that were missing at the start.
    absent: int  #: Number of optional slaves that are absent.
    #: A text for each slave with a problem, by position, in the order of the wire.
    unwell: dict[int, str]
    #: A text for each group of optional slaves of which only some are there.
    incomplete: list[str]
    #: A text for each slave that was missing at the start, and for devices that are no slaves of
    #: the bus.
    differences: list[str]
    #: What is wrong with interfaces, exchange and clocks, causes before consequences.
    faults: list[Fault]
    silence: str  #: That the main process of ecatd hangs, or empty.
    #: A text for each fault, `unwell`, `incomplete`, `differences` and `silence`. What a fault of
    #: an interface or of a slave explains is no problem of its own.
    problems: list[str]
    #: Whether nothing can be done with the bus: no slave is in OP, or no exchange succeeds although
    #: the slaves are there.
    is_down: bool

    @property
    def counts(self) -> str:
        """`7 of 8 slaves in OP`."""
        absent = f" ({self.absent} optional absent)" if self.absent else ""
        return f"{self.in_op} of {self.expected} slaves in OP{absent}"

    def sentence(self, shown: int) -> str:
        """`7 of 8 slaves in OP: slave 5 (EL3008): no answer, missing, since 10:41`.

        Args:
            shown: Most problems to name.
        """
        more = len(self.problems) - shown
        named = self.problems[:shown] + ([f"and {more} more"] if more > 0 else [])
        return self.counts + (f": {'; '.join(named)}" if named else "")


def look_at(reply: Mapping[str, Any]) -> Health:
    """Finds the problems of a bus.

    Args:
        reply: The answer of the bus server to `ReadStates`.
    """
    rows, missing = list(reply["slaves"]), list(reply.get("missing", ()))
    expected = required(rows)
    in_op = [row for row in expected if row["al_state"] == AlState.OP]
    unwell = [row for row in expected if row not in in_op or row.get("recovery")]
    faults = [Fault.of(row) for row in reply.get("faults", ())]
    causes, consequences = _order(faults, {row["position"] for row in unwell})
    if any(fault.blinds for fault in faults):
        # Nobody knows how these slaves are, and the fault of the interface is none of theirs.
        unwell = [row for row in unwell if row["al_state"]]
    texts = {row["position"]: _problem_text(row, consequences) for row in unwell}
    incomplete = [*_incomplete(rows, {row["group"] for row in expected if row.get("group")})]
    differences = [item["text"] for item in missing]
    differences += filter(None, [reply.get("others")])
    silence = ""
    if (silent := reply.get("service_silent_s", 0.0)) > _SILENT_S:
        silence = (
            f"the main process of ecatd has hung for {silent:.0f} s, so nothing looks after the "
            "bus server and the gateway: restart ecatd"
        )
    problems = [fault.text for fault in causes]
    problems += [*texts.values(), *incomplete, *differences, *filter(None, [silence])]
    left_out = sum(len(item["expected"]) for item in missing)
    absent = len(rows) - len(expected)
    count = len(expected) + left_out
    is_down = bool(expected and not in_op) or any(fault.stops for fault in causes)
    return Health(
        rows=rows,
        expected=count,
        in_op=len(in_op),
        missing=left_out,
        absent=absent,
        unwell=texts,
        incomplete=incomplete,
        differences=differences,
        faults=faults,
        silence=silence,
        problems=problems,
        is_down=is_down,
    )


def _order(faults: Sequence[Fault], unwell: Collection[int]) -> tuple[list[Fault], list[Fault]]:
    """Faults that need an explanation, and those that a slave explains that is not well itself."""
    if any(fault.blinds for fault in faults):  # then the exchange cannot succeed
        return [fault for fault in faults if fault.domain is None], []
    explained = [fault for fault in faults if fault.slaves and {*fault.slaves} <= {*unwell}]
    return [fault for fault in faults if fault not in explained], explained


def _incomplete(rows: list[Mapping[str, Any]], there: set[str]) -> Iterator[str]:
    """Groups of optional slaves of which only some are there."""
    for group in sorted(there):
        absent = [row for row in rows if row.get("group") == group and row["recovery"] == _ABSENT]
        if absent:
            names = ", ".join(map(row_label, absent))
            yield f"group {group} is incomplete, because these slaves are absent: {names}"


def required(rows: Iterable[SlaveAlState]) -> list[SlaveAlState]:
    """The rows of the slaves that should be there: all but optional ones that are absent."""
    return [row for row in rows if row.get("recovery") != _ABSENT]


def outdated(slaves: Sequence[Slave], rows: Iterable[SlaveAlState]) -> dict[int, str]:
    """Says which slaves need not be what ecatd has read of them, by position, and why.

    Args:
        slaves: The slaves of the description.
        rows: Their AL states, as `ReadStates` is answered.
    """
    why = {}
    for row in required(rows):
        slave = slaves[row["position"]]
        if row["recovery"] == _EXCHANGED:
            why[slave.position] = "another device is in its place"
        elif not row["al_state"]:
            why[slave.position] = "no answer"
        elif row["revision"] != slave.revision:
            why[slave.position] = f"a device with revision 0x{row['revision']:08X} is in its place"
        elif row["serial"] != slave.serial:
            why[slave.position] = f"a device with serial number {row['serial']} is in its place"
    return why


def _problem_text(row: Mapping[str, Any], consequences: Iterable[Fault] = ()) -> str:
    """Describes a slave with a problem, what is known about its recovery, and what follows."""
    known = (row["text"], row.get("recovery"), row.get("recovery_text"), _since(row.get("since")))
    spoilt = sorted(
        {fault.domain or 0 for fault in consequences if row["position"] in fault.slaves}
    )
    domains = " and ".join(f"domain {number}" for number in spoilt)
    has = "has a wrong working counter" if len(spoilt) == 1 else "have wrong working counters"
    so = f"; so {domains} {has}" if spoilt else ""
    return f"{row_label(row)}: {', '.join(text for text in known if text)}{so}"


def row_label(row: Mapping[str, Any]) -> str:
    """`slave 5 (EL3008)`, of a row as `ReadStates` is answered."""
    return f"slave {row['position']} ({display_name(row.get('given_name', ''), row['name'])})"


def _since(moment: float | None) -> str:
    """`since 10:41`, local time, with the date after a day."""
    if not moment:
        return ""
    pattern = "%H:%M" if time.time() - moment < _DAY else "%Y-%m-%d %H:%M"
    return "since " + time.strftime(pattern, time.localtime(moment))
