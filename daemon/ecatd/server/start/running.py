"""A bus that the start has brought to OP, for the modules that watch it."""

from __future__ import annotations

from dataclasses import dataclass

from ecatd.base.timeouts import Timeout
from ecatd.config import RecoveryConfig
from ecatd.description.bus import Bus
from ecatd.master.engine.engine import Engine
from ecatd.master.engine.shared_memory import SharedMemory
from ecatd.master.master import Master

from .clocks import Clocks
from .found import Expectation
from .identify import Finder
from .set_up import SetUp
from .uncertain import Uncertain


@dataclass(slots=True)
class RunningBus:
    """A bus that is in OP, with all its parts.

    Attributes:
        bus: Its description.
        interfaces: Names of its interfaces: one, or two with cable redundancy.
        run: The number of this run, in the source address of its frames.
        shared: The shared memory.
        master: The master.
        engine: The engine.
        clocks: The distributed clocks; None if they are not used.
        absent: Positions of the optional slaves that were absent at the start.
        awaited: Positions of the other slaves that were missing at the start, and are used when
            they come.
        uncertain: Slaves whose process data are uncertain, by position, and the reasons.
        idle: Positions of the uncertain slaves that stay in PREOP and are not exchanged.
        set_up: Sets up slaves that have restarted.
        finder: Finds slaves that have lost their station address.
        expectation: The expected bus, and the differences at the start.
        polls: Seconds between two looks at the mailbox of each slave, by position; 0 for no looks.
        recovery: The configuration of recovery.
        state_timeout: Time that slaves have to reach a state.
    """

    bus: Bus
    interfaces: list[str]
    run: int
    shared: SharedMemory
    master: Master
    engine: Engine
    clocks: Clocks | None
    absent: set[int]
    awaited: set[int]
    uncertain: dict[int, Uncertain]
    idle: list[int]
    set_up: SetUp
    finder: Finder
    expectation: Expectation
    polls: list[float]
    recovery: RecoveryConfig
    state_timeout: Timeout

    @property
    def optional(self) -> set[int]:
        """Positions of the slaves that may come and go."""
        return {slave.position for slave in self.bus.slaves if slave.group} - self.awaited
