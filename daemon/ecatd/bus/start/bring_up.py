"""From an interface to slaves in OP, step by step.

Order matters, and `BringUp.run` is where it is written: reserve, scan, read, map, exchange with
safe outputs, clocks in step, SAFEOP, OP. Each step uses what the ones before it have found, and
leaves it as attributes.
"""

from __future__ import annotations

import math
import os
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ecatd.coroutine_steps import finish
from ecatd.log import Log
from ecatd.model.al import AlState
from ecatd.model.bus import Bus
from ecatd.model.config import Config, RecoveryConfig
from ecatd.model.errors import StateError
from ecatd.model.meanings import give_meanings, unused_profiles
from ecatd.model.profiles import Profiles, load_profiles
from ecatd.paths import profile_folders
from ecatd.real_time import SETTINGS

from ..engine.engine import Engine, Grant, Index, RealTime, open_socket
from ..engine.layout import Image, assign_domains, lay_out
from ..engine.shared_memory import SharedMemory
from ..master.emergencies import tell_emergencies
from ..master.master import Master
from .clocks import Clocks, clock_bits
from .doubtful import Doubt, fitting, settle
from .identify import Finder, branch_ends
from .mapping import Scanned, configure, scan_slaves, without_lrw
from .round_trip import measure_round_trip
from .safe import SafeOutputs, safe_outputs
from .set_up import SetUp, count_links, read_mailboxes, wait_for_outputs
from .watchdogs import check_watchdogs
from .wire_time import WireTime, wire_time

_CLOCK_PAUSE = 0.01
"""Seconds between two looks at the SYNC signals of slaves."""


@dataclass(slots=True)
class RunningBus:
    """A bus that is in OP, and everything that it consists of.

    Attributes:
        bus: Its description.
        interfaces: Names of its interfaces: one, or two with cable redundancy.
        run: The number of this run, in the source address of its frames.
        shared: The shared memory.
        master: The master.
        engine: The cyclic engine.
        clocks: The distributed clocks, where they are used.
        doubtful: Slaves whose process data are in doubt, and what is known of them.
        idle: Those of them that stay in PREOP and take no part.
        set_up: Sets slaves up again that have begun anew.
        finder: Finds slaves again that have forgotten their address.
        recovery: Which slaves come back by themselves.
        state_timeout_s: Seconds that slaves have to reach a state.
    """

    bus: Bus
    interfaces: list[str]
    run: int
    shared: SharedMemory
    master: Master
    engine: Engine
    clocks: Clocks | None
    doubtful: dict[int, Doubt]
    idle: list[int]
    set_up: SetUp
    finder: Finder
    recovery: RecoveryConfig
    state_timeout_s: float


class BringUp:
    """The start of one bus, and what it has made so far.

    Args:
        config: The configuration.
        interface: The interface, which may come from the simulator instead of the configuration.
        log: Where steps are told.
        cancelled: Asked while slaves are waited for; when true, the start ends with `StateError`.

    Attributes:
        bus: The description of the bus; its slaves are there after `read`.
        shared: The shared memory: reserved by `reserve`, filled by `exchange`.
        master: The master, from `reserve` on.
        engine: The cyclic engine, from `exchange` on.
        image: The process image, from `map` on.
        wire: How long its frames are on the wire, from `map` on.
        clocks: The distributed clocks, from `map` on, where the configuration wants them.
        safe: What outputs are while nobody owns them, from `map` on.
        summary: The bus in one line, when it is in OP.
    """

    def __init__(
        self, config: Config, interface: str, log: Log, cancelled: Callable[[], bool]
    ) -> None:
        self._config = config
        self._interface = interface
        self._log = log
        self._cancelled = cancelled
        self._begin = time.monotonic()
        self._profiles = Profiles()
        self._scanned: list[Scanned] = []
        self._doubtful: dict[int, Doubt] = {}
        self._mailboxes: list[bytes] = []
        self._ends: list[int] = []
        self._interfaces = [name for name in (interface, config.second_interface) if name]
        self._run = secrets.randbits(32)
        self.bus = Bus(config.bus, config.cycle_time_us)
        self.shared: SharedMemory | None = None
        self.master: Master | None = None
        self.engine: Engine | None = None
        self.image: Image | None = None
        self.wire: WireTime | None = None
        self.clocks: Clocks | None = None
        self.safe = SafeOutputs()
        self.summary = ""

    def run(self) -> RunningBus:
        """Brings the bus to OP; blocks, and belongs on the mailbox worker.

        Raises:
            EcatError: A step does not work; what was made so far stays in the attributes.
        """
        self._load_profiles()
        # Next what keeps others away, so that nothing is done to a bus that somebody else runs.
        self.shared = shared = SharedMemory(self._config.bus)
        master, image = self._describe()
        engine = self._exchange(shared, master, image)
        self._synchronise(shared)
        self._reach(master, AlState.SAFEOP)
        self._reach_op(master, shared)
        engine.restart_counting()  # until now working counters could not be complete
        self.summary = self._summarise(image)
        return RunningBus(
            self.bus,
            self._interfaces,
            self._run,
            shared,
            master,
            engine,
            self.clocks,
            self._doubtful,
            self._idle,
            SetUp(
                master,
                shared,
                self.bus,
                self._scanned,
                image,
                self._mailboxes,
                self.clocks,
                self._doubtful,
                self._config.state_timeout_s,
            ),
            Finder(master.registers, self.bus.slaves, self._ends),
            self._config.recovery,
            self._config.state_timeout_s,
        )

    def describe(self) -> Bus:
        """The description of the bus, whose slaves are left in PREOP: nothing is exchanged.

        Raises:
            EcatError: As `run`.
        """
        self._load_profiles()
        self._describe()
        return self.bus

    def _load_profiles(self) -> None:
        """Reads what may be wrong without a bus, before anything is sent."""
        self._profiles = load_profiles(map(Path, self._config.profiles), profile_folders())

    def _describe(self) -> tuple[Master, Image]:
        self.master = master = Master(
            self._interfaces,
            self._cancelled,
            run=self._run,
            share=self._config.mailbox.share,
            priority=max(self._config.realtime.priority - 1, 0),
        )
        self._scan(master)
        self._read(master)
        return master, self._map(master)

    def _scan(self, master: Master) -> None:
        """Finds the slaves and takes them to PREOP."""
        why = master.scan(self._config.state_timeout_s)
        count = len(master.stations)
        text = f"{count} slave{'s' * (count != 1)} found on {self._interface}"
        self._log.info(f"{text} (numbered by ecatd: {why})" if why else text)
        master.wait_for_state(AlState.PREOP, self._config.state_timeout_s)

    def _read(self, master: Master) -> None:
        """Reads what every slave says about itself into the description of the bus."""
        self._scanned = scan_slaves(master, self._cancelled)
        for item in self._scanned:
            tell_emergencies(self._log, [(item.slave, *found) for found in item.emergencies])
        self._doubtful = settle(
            master, self._scanned, self._config.state_timeout_s, self._log.warning
        )
        for item, bits in zip(self._scanned, clock_bits(master), strict=True):
            item.slave.dc_bits = bits
        self.bus.slaves = [item.slave for item in self._scanned]
        self._mailboxes = read_mailboxes(master)
        self._ends = branch_ends(count_links(master), ring=bool(self._config.second_interface))

    @property
    def _idle(self) -> list[int]:
        """Doubtful slaves that take no part in the exchange."""
        slaves = self.bus.slaves
        return [n for n in self._doubtful if not (slaves[n].outputs or slaves[n].inputs)]

    def _reach(self, master: Master, state: AlState) -> None:
        """Takes all slaves to a state but those that take no part.

        A doubtful one that does not come along does not keep the others: recovery looks after it.
        """
        idle = set(self._idle)
        used = [n for n in range(len(self.bus.slaves)) if n not in idle] if idle else None
        master.wait_for_state(state, self._config.state_timeout_s, used, optional=self._doubtful)

    def _map(self, master: Master) -> Image:
        """Gives every slave its place in the process image, and its time."""
        signals = fitting(self._config.signal, self.bus, self._doubtful)
        give_meanings(self.bus, self._profiles, signals)
        for warning in unused_profiles(self.bus, self._profiles):
            self._log.warning(warning)
        safe = fitting(self._config.outputs.safe, self.bus, self._doubtful)
        self.safe = safe_outputs(self.bus, safe)
        assign_domains(self.bus, self._config.domain, self._idle)
        self.image = image = lay_out(self.bus, without_lrw(master, self._scanned))
        self.wire = wire_time(
            image,
            self._config.cycle_time_us,
            len(self.bus.slaves),
            clock=self._config.dc.enabled,
            delay_ns=measure_round_trip(master),
        )
        if warning := self.wire.check():
            self._log.warning(warning)
        for warning in check_watchdogs(master, self.bus, self._scanned):
            self._log.warning(warning)
        configure(master, self._scanned, image)
        if self._config.dc.slave and not self._config.dc.enabled:
            self._log.warning(
                "dc.enabled is false, so the slaves in [[dc.slave]] get no SYNC signals"
            )
        if self._config.dc.reference >= 0 and not self._config.dc.enabled:
            self._log.warning(
                f"dc.enabled is false, so dc.reference = {self._config.dc.reference} does nothing"
            )
        if self._config.dc.enabled:
            self.clocks = Clocks(self.bus, self._config, master)
            self.clocks.measure()
        return image

    def _exchange(self, shared: SharedMemory, master: Master, image: Image) -> Engine:
        """Starts the cyclic exchange with all outputs safe."""
        config = self._config
        cycle_ns = config.cycle_time_us * 1000
        lease_max = config.outputs.lease_max_ms * 1_000_000
        lease = min(config.outputs.lease_cycles * cycle_ns, lease_max)
        shared.fill(self.bus, image, lease, lease_max)
        self.engine = engine = Engine(
            shared.address,
            shared.out_fd,
            [open_socket(name, Index.ENGINE, Index.LAST) for name in self._interfaces],
            self._run,
        )
        for domain in image.domains:
            engine.add_domain(domain)
        if self.clocks is not None:
            engine.set_clock(self.clocks.engine_clock)
        self._guard(shared, engine)
        wanted = config.realtime
        grants = engine.start(
            RealTime(
                wanted.priority,
                wanted.cpu,
                wanted.lock_memory,
                wanted.busy_receive,
                wanted.poll_us,
                wanted.dma_latency_us,
                config.outputs.wkc_limit,
            )
        )
        master.relay.follow(engine)
        shared.set_grants(grants)
        self._tell_grants(grants)
        return engine

    def _guard(self, shared: SharedMemory, engine: Engine) -> None:
        """Tells the engine what outputs are without an owner, and what they never are."""
        numbers = {}
        for number, row in enumerate(shared.signals[: shared.header.signal_count]):
            numbers[row.slave, row.index, row.subindex, row.output] = number
            if row.output and (row.minimum > -math.inf or row.maximum < math.inf):
                engine.set_limit(number, row.minimum, row.maximum)
        for position, (value, hold) in self.safe.images.items():
            engine.set_safe(position, value, hold)
        for stop in self.safe.stops:
            engine.set_stop(
                numbers[stop.slave, stop.controlword, 0, 1],
                numbers[stop.slave, stop.statusword, 0, 0],
                stop.value,
                stop.patience,
            )

    def _synchronise(self, shared: SharedMemory) -> None:
        """Waits until all clocks are in step, and starts the SYNC signals."""
        if self.clocks is None:
            return
        seconds = self.clocks.wait_for_lock(shared, self._cancelled)
        count = len(self.clocks.followers)
        self._log.info(
            f"cycle and {count} clock{'s' * (count != 1)} follow that of "
            f"{self.clocks.reference.label} (after {seconds:.1f} s)"
        )
        failed = finish(self.clocks.sync_signals.start(shared), _CLOCK_PAUSE)
        for position, why in failed.items():
            raise StateError(f"{self.bus.slaves[position].label}: {why}")

    def _tell_grants(self, grants: list[Grant]) -> None:
        for grant in grants:
            if grant.error:
                words = SETTINGS[grant.setting]
                self._log.warning(
                    f"no real time: {words.title} ({words.value.format(grant.value)}) was refused "
                    f"({os.strerror(grant.error)}): {words.without}; {words.how}"
                )

    def _reach_op(self, master: Master, shared: SharedMemory) -> None:
        """Asks for OP when outputs have been sent a few times; slaves want valid ones first."""
        timeout = self._config.state_timeout_s
        finish(wait_for_outputs(shared, self.bus, timeout, self._cancelled))
        self._reach(master, AlState.OP)

    def _summarise(self, image: Image) -> str:
        count = len(self.bus.slaves)
        return (
            f"bus '{self.bus.name}' is in OP: {count} slave{'s' * (count != 1)}, "
            f"{image.output_bytes} bytes of outputs, "
            f"{sum(domain.input_bytes for domain in image.domains)} of inputs, every "
            f"{self._config.cycle_time_us} µs (after {time.monotonic() - self._begin:.1f} s)"
        )
