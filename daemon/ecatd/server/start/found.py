"""The slaves of one try to start a bus, with the results of its steps."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from ecatd.config import STRICT, TOLERANT, Config, Mark
from ecatd.config.expected_bus import Difference
from ecatd.description.bus import Bus, Slave
from ecatd.master.master import Master

from .identify import Finder
from .mapping import Scanned
from .uncertain import Uncertain

STARTS_OTHERS = 'policy = "tolerant" in [expected] or in a [[slave]] table starts the others'
"""What a message says about a slave without which the bus must not start."""


@dataclass(frozen=True, slots=True)
class Expectation:
    """The bus that the configuration expects, and its differences from the bus of the start.

    Attributes:
        config: The configuration, with the positions that it expects.
        wire: The slaves of the start in the order of the wire.
        differences: The differences, with places on this wire.
        positions: Positions of the expected slaves on the bus, by position in the configuration.
    """

    config: Config
    wire: list[Slave]
    differences: list[Difference]
    positions: dict[int, int]

    @property
    def left_out(self) -> list[dict[str, Any]]:
        """Slaves that the bus has no place for, since they were missing: `expected` and `text`.

        They stay left out until the next start. `expected` are positions in the configuration.
        """
        return [
            {"expected": list(item.expected), "text": item.text}
            for item in self.differences
            if item.expected and not item.found and self.positions.keys().isdisjoint(item.expected)
        ]

    def restart_without(self, positions: Iterable[int]) -> str:
        """What a restart would do if slaves stay missing, or others stay in their places.

        Args:
            positions: Positions of these slaves on the bus.

        Returns:
            The end of a sentence; empty if that is not up to the configuration, because it expects
            none of these slaves.
        """
        wanted = {at: n for n, at in self.positions.items()}
        tables = [self.config.settings_of(wanted[n]) for n in positions if n in wanted]
        listed = [item for item in tables if item.product is not None and not item.optional]
        strict = STRICT in map(self.config.policy_of, listed)
        return f"; until then {restart_text(strict=strict)}" if listed else ""


def restart_text(*, strict: bool) -> str:
    """What a restart would do with a difference from the expected bus."""
    then = "is refused" if strict else "starts the other slaves"
    return f'a restart of ecatd {then} (policy = "{STRICT if strict else TOLERANT}")'


@dataclass(slots=True)
class FoundBus:
    """The results of the steps of the start so far.

    Attributes:
        bus: The bus description; it has slaves once all of them have been read.
        master: The master.
        config: The configuration. Once the slaves have been compared, it has the positions at which
            they were found.
        stuck: Slaves that do not reach PREOP, by their place on the wire, and their AL states.
        scanned: All slaves by position, including optional slaves that are absent.
        expectation: The expected bus, and the differences; set when the slaves are compared.
        uncertain: Slaves whose process data are uncertain, by position, and the reasons.
        mailboxes: See `set_up.read_mailboxes`.
        ends: See `matching.branch_ends`.
        lost: Positions of slaves that have lost their power or cable since they were read.
        awaited: Positions of slaves that are not optional, but were missing, and are used when they
            come.
        refused: By position, why slaves did not come to OP in an earlier try of this start, though
            their process data were exchanged. They are left out of this one.
    """

    bus: Bus
    master: Master
    config: Config
    stuck: dict[int, str] = field(default_factory=dict)
    scanned: list[Scanned] = field(default_factory=list)
    expectation: Expectation = field(init=False)
    uncertain: dict[int, Uncertain] = field(default_factory=dict)
    mailboxes: list[bytes] = field(default_factory=list)
    ends: list[int] = field(default_factory=list)
    lost: set[int] = field(default_factory=set)
    awaited: set[int] = field(default_factory=set)
    refused: dict[int, str] = field(default_factory=dict)

    @property
    def absent(self) -> set[int]:
        """Positions of the optional slaves that are absent."""
        return {
            item.slave.position
            for item in self.scanned
            if not item.known or (item.slave.group and item.slave.position in self.lost)
        } - self.awaited

    @property
    def missing(self) -> set[int]:
        """Positions of the other slaves that are absent."""
        return (self.lost | self.awaited) - self.absent

    @property
    def present(self) -> list[Scanned]:
        """The slaves that are there."""
        return [
            item for item in self.scanned if item.known and item.slave.position not in self.lost
        ]

    @property
    def idle(self) -> list[int]:
        """Positions of uncertain slaves without process data; they are not exchanged."""
        slaves = self.bus.slaves
        return [n for n in self.uncertain if not (slaves[n].outputs or slaves[n].inputs)]

    def must_be_there(self, position: int) -> bool:
        """Whether the bus must not start without the slave at a position."""
        settings = self.config.settings_of(position)
        return not settings.optional and self.config.policy_of(settings) == STRICT

    def labels(self, positions: Iterable[int]) -> str:
        """Returns the labels of slaves for messages, also before the slaves have been read."""
        scanned = self.scanned
        return ", ".join(
            scanned[n].slave.label if n < len(scanned) else f"slave {n}" for n in positions
        )

    def finder(self) -> Finder:
        """Returns a finder for slaves that have lost their station address."""
        master, slaves = self.master, self.bus.slaves
        tables = [self.config.settings_of(slave.position) for slave in slaves]
        return Finder(master.registers, slaves, tables, self.ends, self._anywhere, self._identified)

    @property
    def _anywhere(self) -> dict[Mark, list[int]]:
        """Positions of optional slaves, by the mark that identifies the first slave of a group."""
        return {
            wanted.mark: [wanted.position, *(n.position for n in self.config.followers(wanted))]
            for wanted in self.config.slave
            if wanted.optional and wanted.mark is not None
        }

    @property
    def _identified(self) -> dict[int, tuple[int, int]]:
        """The argument `identified` of `Finder`."""
        return {
            wanted.position: (
                wanted.identification,
                wanted.identification_register
                or self.scanned[wanted.position].sii.identification_register,
            )
            for wanted in self.config.slave
            if wanted.identification is not None
        }
