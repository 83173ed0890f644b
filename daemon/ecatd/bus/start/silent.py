"""Slaves with CoE whose mailboxes do not answer: what becomes of them.

Such a slave cannot say which process data it has, and must not keep the others from OP. It is used
with the process data of its EEPROM, if it has some and goes to SAFEOP with them. Otherwise it stays
in PREOP, and takes no part in the exchange.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import Protocol, TypeVar

from ecatd.model.al import AlState
from ecatd.model.bus import Bus, Slave
from ecatd.model.errors import StateError

from ..layout import lay_out
from ..master import Master
from ..steps import Steps, finish
from .mapping import Scanned, configure

_R = TypeVar("_R", bound="_Rule")

_CURE = "switch it off and on, then restart ecatd"


def settle(
    master: Master, scanned: Sequence[Scanned], timeout_s: float, tell: Callable[[str], None]
) -> dict[int, str]:
    """Decides about silent slaves, which must be in PREOP.

    Args:
        master: The master.
        scanned: All slaves. Of those that stay in PREOP the process data are taken away.
        timeout_s: Seconds that slaves have to reach a state.
        tell: Takes a warning about each of them.

    Returns:
        What is known of each of them, by position.
    """
    silent = [item for item in scanned if item.silence]
    described = [item for item in silent if item.slave.outputs or item.slave.inputs]
    refused = finish(_try(master, described, timeout_s))
    known = {}
    for item in silent:
        slave = item.slave
        if item in described and slave.position not in refused:
            text = "is used with the process data of its EEPROM, and its objects cannot be reached"
        else:
            slave.outputs, slave.inputs = [], []
            why = refused.get(slave.position, "its EEPROM describes no process data")
            text = f"stays in PREOP and takes no part: {why}"
        known[slave.position] = f"its mailbox did not answer at the start, so it {text}"
        tell(f"{item.silence}; {slave.label} {text}; {_CURE}")
    return known


class _Rule(Protocol):
    slave: int

    @property
    def address(self) -> tuple[int, int] | None: ...


def fitting(rules: Sequence[_R], bus: Bus, silent: Collection[int]) -> list[_R]:
    """Rules of the configuration without those about process data that a silent slave has not told.

    Args:
        rules: Rules about a slave, or about one of its entries.
        bus: The bus.
        silent: Positions of silent slaves.
    """
    return [
        rule for rule in rules if rule.slave not in silent or _has(bus.slaves[rule.slave], rule)
    ]


def _has(slave: Slave, rule: _Rule) -> bool:
    entries = {
        (entry.index, entry.subindex)
        for outputs in (True, False)
        for _, entry, _ in slave.entries(outputs=outputs)
    }
    return bool(slave.output_bytes) if rule.address is None else rule.address in entries


def _try(master: Master, items: Sequence[Scanned], timeout_s: float) -> Steps[dict[int, str]]:
    """Takes slaves to SAFEOP with their process data, and back; why some do not go there."""
    refused = {}
    for item in items:
        slave = item.slave
        try:
            configure(master, [item], lay_out(Bus("", 0, [slave]), set()))
        except StateError as error:
            refused[slave.position] = str(error)
    here = [item.slave.position for item in items if item.slave.position not in refused]
    if here:
        for missed in (yield from master.approach(AlState.SAFEOP, timeout_s, here)):
            refused[missed.position] = (
                f"with the process data of its EEPROM it does not reach SAFEOP: {missed.describe()}"
            )
        yield from master.approach(AlState.PREOP, timeout_s, here)
    return refused
