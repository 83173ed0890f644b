"""Faults of slaves: state, emergency. The simulation loop carries them out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from ecatd.model.al import AlState

from ..parameters import Is
from .fault import SlaveFault

if TYPE_CHECKING:
    from ..simulation import Simulation

_MAX_16 = 0xFFFF
Lower = Literal["INIT", "PREOP", "SAFEOP"]


@dataclass(frozen=True)
class AlError(SlaveFault):
    """A slave falls back to a state by itself, with the error flag and an AL status code.

    A slave that is in a lower state stays there, with the error flag.
    """

    kind: ClassVar[str] = "al-error"
    code: Annotated[
        int, Is("AL status code, register 0x0134", minimum=1, maximum=_MAX_16, hexadecimal=True)
    ]
    state: Annotated[Lower, Is("state that it falls back to")] = "SAFEOP"

    def strike(self, simulation: Simulation) -> None:
        """Sets AL status and AL status code."""
        simulation.rig.devices[self.slave].fail(self.code, AlState[self.state])
