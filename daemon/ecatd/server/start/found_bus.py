"""A bus whose slaves have been found: what the start knows between its scan and OP."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from ecatd.config import STRICT, Config, Mark
from ecatd.description.bus import Bus
from ecatd.master.master import Master

from .expectation import Expectation
from .identify import Finder
from .scanned import Scanned, Uncertain


@dataclass(slots=True)
class FoundBus:
    """A bus after the scan. The slaves are there, and at their positions.

    Attributes:
        bus: The bus description; it has slaves once all of them have been read.
        master: The master.
        config: The configuration, with the positions at which the slaves were found.
        scanned: All slaves by position, including optional slaves that are absent.
        expectation: The expected bus, and the differences.
        awaited: Positions of slaves that are not optional, but were missing, and are used when they
            come.
        unexpected: By position, why a slave is not the expected one.
        refused: By position, why slaves did not come to OP in an earlier try of this start, though
            their process data were exchanged. They are left out of this one.
        uncertain: Slaves whose process data are uncertain, by position, and the reasons; those that
            have answered again since are removed.
        mailboxes: See `set_up.read_mailboxes`.
        ends: See `matching.branch_ends`.
        lost: Positions of slaves that have lost their power or cable since they were read.
    """

    bus: Bus
    master: Master
    config: Config
    scanned: list[Scanned]
    expectation: Expectation
    awaited: set[int]
    unexpected: dict[int, str]
    refused: dict[int, str]
    uncertain: dict[int, Uncertain] = field(default_factory=dict)
    mailboxes: list[bytes] = field(default_factory=list)
    ends: list[int] = field(default_factory=list)
    lost: set[int] = field(default_factory=set)

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

    def label(self, position: int) -> str:
        """Returns the label of a slave for messages."""
        return self.scanned[position].slave.label

    def labels(self, positions: Iterable[int]) -> str:
        """Returns the labels of slaves for messages."""
        return ", ".join(map(self.label, positions))

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
