"""The base classes of faults, with their schedule and parameters."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Self

from ecatd.base.errors import UsageError

from ..esc import MAX_SLAVES
from ..parameters import Described, Is, parameters
from . import named_devices
from .target import Target

MAX_CYCLE = 2**63 - 1
_MAX_32 = 2**32 - 1

Slave = Annotated[int, Is("position of the slave", minimum=0, maximum=MAX_SLAVES - 1)]


@dataclass(frozen=True)
class Fault(Described):
    """A fault and its schedule.

    It strikes in the cycles `at_cycle`, `at_cycle + every`, … until it has struck `count` times.
    In each of them it strikes with `probability`; the random numbers come from `seed` alone, so
    the same fault strikes in the same cycles in every run. Cycles are counted as in
    `ecatsim.esc.Counters.cycles`.
    """

    _: KW_ONLY
    at_cycle: Annotated[
        int, Is("cycle of the first strike; 0 = at once", minimum=0, maximum=MAX_CYCLE)
    ] = 0
    every: Annotated[
        int, Is("from one strike to the next", unit="cycles", minimum=1, maximum=_MAX_32)
    ] = 1
    count: Annotated[int, Is("number of strikes; 0 = for ever", minimum=0, maximum=_MAX_32)] = 1
    probability: Annotated[float, Is("chance of each strike", minimum=0.0, maximum=1.0)] = 1.0
    seed: Annotated[int, Is("seed of the random numbers", minimum=0, maximum=_MAX_32)] = 1

    def check_slave(self, count: int) -> None:
        """Checks that the slave of the fault, if it has one, exists in a rig of `count` slaves.

        Raises:
            UsageError: The rig has no such slave.
        """
        position = getattr(self, "slave", None)
        if position is not None and position >= count:
            there = f"slaves 0 to {count - 1}" if count else "no slaves"
            raise UsageError(f"{self.kind}: there is no slave {position}; the rig has {there}")

    def relative_to(self, folder: Path) -> Self:
        """Returns the same fault with absolute paths; relative paths count from a folder."""
        paths: dict[str, Any] = {
            p.name: named_devices.absolute(getattr(self, p.name), folder)
            for p in parameters(type(self))
            if p.about.file and getattr(self, p.name)
        }
        return replace(self, **paths) if paths else self


@dataclass(frozen=True)
class SlaveFault(Fault):
    """A fault that the simulation loop carries out, before its next step."""

    slave: Slave = field(kw_only=False)

    def check(self, target: Target) -> None:
        """Checks before the strike that the simulation can carry out the fault.

        Raises:
            UsageError: The simulation cannot carry it out.
        """

    def strike(self, target: Target) -> None:
        """Carries out the fault.

        Raises:
            EcatError: The fault could not be carried out.
        """
        raise NotImplementedError
