"""Brings a bus up, from an interface to slaves in OP.

The order of the steps matters; it is that of `BringUp.run`: reserve, scan, read, map, exchange
with safe outputs, synchronise clocks, SAFEOP, OP. Each step stores its results as attributes, and
uses those of the steps before it.
"""

from __future__ import annotations

import math
import os
import secrets
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from ecatd.coroutine_steps import finish
from ecatd.log import Log
from ecatd.model.al import AlState
from ecatd.model.applied import Applied, alike_slaves, apply, check_slaves, load_description
from ecatd.model.bus import Bus
from ecatd.model.config import Config, Mark, RecoveryConfig
from ecatd.model.errors import StateError
from ecatd.model.expected_bus import Comparison, compare
from ecatd.model.meanings import raw_parameters, unused_profiles
from ecatd.model.messages import RINGS
from ecatd.model.profiles import Profiles, load_profiles
from ecatd.paths import profile_folders
from ecatd.real_time import SETTINGS

from ..engine.engine import Engine, Grant, Index, RealTime, open_socket
from ..engine.layout import Image, lay_out
from ..engine.shared_memory import SharedMemory
from ..frames.frame_ring import FrameRing
from ..master.emergencies import tell_emergencies
from ..master.master import Master
from .absent import arrange
from .clocks import Clocks, clock_bits
from .doubtful import Doubt, settle
from .gone import find_gone
from .identification import identify
from .identify import Finder, branch_ends
from .mapping import (
    Scanned,
    configure,
    configure_slaves,
    identify_slaves,
    read_modules,
    without_lrw,
)
from .round_trip import measure_round_trip
from .set_up import (
    SetUp,
    count_links,
    read_mailboxes,
    wait_for_outputs,
)
from .telling import leave, write_parameters
from .watchdogs import check_watchdogs
from .wire_time import WireTime, wire_time

_TRIES = 3  # starts, if slaves lose their power while they are read
_MAILBOX_PAUSE = 0.0005
"""Seconds between two rounds of frames while slaves answer over their mailboxes."""

_MIB = 1 << 20
_CLOCK_PAUSE = 0.01
"""Seconds between two reads of the state of SYNC signals."""


def leases(config: Config) -> tuple[int, int]:
    """The shortest and the longest lease, in ns."""
    longest = config.outputs.lease_max_ms * 1_000_000
    return min(config.outputs.lease_cycles * config.cycle_time_us * 1000, longest), longest


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
        absent: Positions of the optional slaves that were absent at the start.
        doubtful: Slaves whose process data are in doubt, by position, and why.
        idle: Positions of the doubtful slaves that stay in PREOP and are not exchanged.
        set_up: Sets up slaves that have restarted.
        finder: Finds slaves that have lost their station address.
        recovery: Configuration: which slaves are recovered automatically.
        state_timeout_s: Seconds that slaves have to reach a state.
    """

    bus: Bus
    interfaces: list[str]
    run: int
    shared: SharedMemory
    master: Master
    engine: Engine
    clocks: Clocks | None
    absent: set[int]
    doubtful: dict[int, Doubt]
    idle: list[int]
    set_up: SetUp
    finder: Finder
    recovery: RecoveryConfig
    state_timeout_s: float


class BringUp:
    """The start of one bus. Its attributes hold what the steps so far have made.

    Args:
        config: The configuration.
        interface: The interface, which may come from the simulator instead of the configuration.
        log: The log for progress and warnings.
        cancelled: Called while waiting for slaves; when true, the start ends with `StateError`.

    Attributes:
        interfaces: Names of the interfaces: one, or two with cable redundancy.
        bus: The bus description; it has slaves after the step "read".
        shared: The shared memory: made by "reserve", filled by "exchange".
        master: The master, from "scan" on.
        engine: The cyclic engine, from "exchange" on.
        image: The process image, from "map" on.
        wire: How long the frames of a cycle are on the wire, from "map" on.
        clocks: The distributed clocks, from "map" on, if the configuration enables them.
        applied: What the configuration says about this bus, from "map" on.
        config: The configuration; from "read" on, it is about the slaves where they were found.
        frame_rings: The last frames: `cycle` those of the engine, `control` all others; none if the
            configuration gives no memory.
        differences: How the bus differs from the expected one, from "read" on.
        summary: The bus in one line, once it is in OP.
    """

    def __init__(
        self, config: Config, interface: str, log: Log, cancelled: Callable[[], bool]
    ) -> None:
        self.config = config
        self._interface = interface
        self._log = log.of("start")
        self._cancelled = cancelled
        self._begin = time.monotonic()
        self._profiles = Profiles()
        self._description: Bus | None = None
        self._scanned: list[Scanned] = []
        self._doubtful: dict[int, Doubt] = {}
        self._mailboxes: list[bytes] = []
        self._ends: list[int] = []
        self.interfaces = [name for name in (interface, config.second_interface) if name]
        self._run = secrets.randbits(32)
        self.bus = Bus(config.bus, config.cycle_time_us)
        self.shared: SharedMemory | None = None
        self.master: Master | None = None
        self.engine: Engine | None = None
        self.image: Image | None = None
        self.wire: WireTime | None = None
        self.applied: Applied | None = None
        self.clocks: Clocks | None = None
        self.frame_rings: dict[str, FrameRing] = {}
        self.differences: list[str] = []
        self.summary = ""

    def run(self) -> RunningBus:
        """Brings the bus to OP. It blocks, so call it on the worker.

        Raises:
            EcatError: A step failed. What the steps before it have made stays in the attributes.
        """
        self._read_files()
        # Reserving comes next: nothing must be done to a bus that another daemon runs.
        self.shared = shared = SharedMemory(self.config.bus)
        if size := self.config.capture.memory_mb * _MIB:
            self.frame_rings = {name: FrameRing(size // 2) for name in RINGS}
        master, image = self._describe()
        engine = self._exchange(shared, master, image)
        self._synchronise(shared)
        self._reach(master, AlState.SAFEOP)
        self._reach_op(master, shared)
        engine.restart_counting()  # before OP, working counters could not be complete
        self.summary = self._summarise(image)
        return RunningBus(
            self.bus,
            self.interfaces,
            self._run,
            shared,
            master,
            engine,
            self.clocks,
            self._absent,
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
                self.config,
            ),
            Finder(master.registers, self.bus.slaves, self._ends, self._anywhere, self._identified),
            self.config.recovery,
            self.config.state_timeout_s,
        )

    def describe(self) -> Bus:
        """Scans and describes the bus without starting the exchange; slaves stay in PREOP.

        Raises:
            EcatError: As `run`.
        """
        self._read_files()
        self._describe()
        return self.bus

    def leave(self, state: AlState, timeout_s: float) -> None:
        """Tells the slaves what they are told on the way down to a state; see `leave`."""
        if self.master is not None:
            steps = leave(self.master, self._present, state, timeout_s)
            for text in finish(steps, _MAILBOX_PAUSE):
                self._log.warning(text)

    def _read_files(self) -> None:
        """Reads what the configuration names: mistakes show before anything is sent."""
        self._profiles = load_profiles(self.config, profile_folders())
        self._description = load_description(self.config)
        for warning in alike_slaves(self.config):
            self._log.warning(warning)

    def _describe(self) -> tuple[Master, Image]:
        """Scans and describes the bus; begins again if slaves lose their power meanwhile."""
        configured, tries = self.config, 0
        while True:
            tries += 1
            self.master = master = Master(
                self.interfaces,
                self._cancelled,
                run=self._run,
                share=self.config.mailbox.share,
                priority=max(self.config.realtime.priority - 1, 0),
                frame_ring=self.frame_rings.get("control"),
                log=self._log,
            )
            try:
                self._scan(master)
                self._read(master)
                return master, self._map(master)
            except StateError as error:
                gone = find_gone(master)
                if not gone or self._cancelled():
                    raise
                text = (
                    f"{self._labels(gone)} answered at first, but no longer: check power and cable"
                )
                if tries == _TRIES:
                    raise StateError(text) from error
                self._log.warning(f"{text}; the start begins again")
            self.master = None
            master.close()
            self.config, self.clocks, self.bus.slaves = configured, None, []
            self._scanned = []

    def _labels(self, positions: Sequence[int]) -> str:
        scanned = self._scanned
        return ", ".join(
            scanned[n].slave.label if n < len(scanned) else f"slave {n}" for n in positions
        )

    def _scan(self, master: Master) -> None:
        """Finds the slaves and takes them to PREOP."""
        # A bus of optional slaves may be empty.
        slaves = self.config.slave
        may_be_empty = bool(slaves) and all(item.optional for item in slaves)
        why = master.scan(self.config.state_timeout_s, may_be_empty=may_be_empty)
        count = len(master.stations)
        text = f"{count} slave{'s' * (count != 1)} found on {self._interface}"
        self._log.info(f"{text} (numbered by ecatd: {why})" if why else text)
        master.wait_for_state(AlState.PREOP, self.config.state_timeout_s)

    def _read(self, master: Master) -> None:
        """Reads SII and PDOs of every slave into the bus description."""
        found = identify_slaves(master)
        for item in found:
            slave = item.slave
            self._log.debug(
                f"{slave.label}: vendor 0x{slave.vendor:08X}, product 0x{slave.product:08X}, "
                f"revision 0x{slave.revision:08X}, serial number 0x{slave.serial:08X}, alias "
                f"{slave.alias}",
                slaves=[slave.position],
            )
        identify(master.registers, found, self.config)
        read_modules(master, found, self._cancelled)
        unexpected = self._follow(master, found, self._compare(found))
        check_slaves(self.config, replace(self.bus, slaves=[item.slave for item in self._scanned]))
        self._make_raw()
        configure_slaves(master, self._scanned, self.config, unexpected, self._cancelled)
        if any(item.silence for item in self._scanned) and find_gone(master):
            raise StateError("slaves have lost their power or their cable")
        mailbox_log = self._log.of("mailbox")
        for item in self._scanned:
            for text in item.refused:
                self._log.warning(text)
            tell_emergencies(mailbox_log, [(item.slave, *found) for found in item.emergencies])
        self._doubtful = settle(
            master,
            self._scanned,
            unexpected,
            self.config.state_timeout_s,
            self._log.warning,
        )
        for position, bits in clock_bits(master).items():
            self._scanned[position].slave.dc_bits = bits
        self.bus.slaves = [item.slave for item in self._scanned]
        self._mailboxes = read_mailboxes(master)
        self._ends = self._branch_ends(master)

    @property
    def _anywhere(self) -> dict[Mark, list[int]]:
        """Positions of the optional slaves that are found by the mark of the first one."""
        return {
            wanted.mark: [wanted.position, *(n.position for n in self.config.followers(wanted))]
            for wanted in self.config.slave
            if wanted.optional and wanted.mark is not None
        }

    @property
    def _identified(self) -> dict[int, tuple[int, int]]:
        """See `Finder`."""
        return {
            wanted.position: (
                wanted.identification,
                wanted.identification_register
                or self._scanned[wanted.position].sii.identification_register,
            )
            for wanted in self.config.slave
            if wanted.identification is not None
        }

    def _branch_ends(self, master: Master) -> list[int]:
        """See `branch_ends`. Where slaves are absent, nobody knows who is reached through whom."""
        count = len(self._scanned)
        if master.wire != [*range(count)]:
            return [position + 1 for position in range(count)]
        return branch_ends(count_links(master), ring=bool(self.config.second_interface))

    def _compare(self, found: Sequence[Scanned]) -> Comparison:
        """Compares the slaves, numbered as on the wire, with those that are expected.

        Raises:
            StateError: There are differences, and the configuration does not tolerate them.
        """
        comparison = compare(self.config, [item.slave for item in found])
        self.differences = [item.text for item in comparison.differences]
        for item in comparison.differences:
            tell = self._log.error if item.strict else self._log.warning
            tell(f"bus not as expected: {item.text}", "expected_bus")
        strict = [item.text for item in comparison.differences if item.strict]
        if strict:
            count = len(strict)
            raise StateError(
                f"the bus is not the one that the configuration expects: {count} "
                f"difference{'s' * (count != 1)}; the first: {strict[0]} "
                '(policy = "tolerant" in [expected] starts the other slaves)'
            )
        return comparison

    def _follow(
        self, master: Master, found: Sequence[Scanned], comparison: Comparison
    ) -> dict[int, str]:
        """Gives the slaves their positions; from then on, the configuration is about these.

        Returns:
            By position, why a slave is not the expected one.
        """
        arranged = arrange(
            master, found, self.config, comparison, self._description, self._log.warning
        )
        self._scanned = arranged.scanned
        unexpected = {arranged.found[n]: text for n, text in comparison.unexpected.items()}
        places = arranged.places.items()
        self.config = self.config.moved({n: at for n, at in places if at not in unexpected})
        return unexpected

    def _make_raw(self) -> None:
        """Makes the physical values of start-up parameters raw, before any of them is written.

        The PDOs of the EEPROM say which device profiles fit: those in use are not known yet.

        Raises:
            ConfigError: A value has no meaning, or does not fit.
        """
        raw = []
        for wanted in self.config.slave:
            if wanted.position < len(self._scanned):
                item = self._scanned[wanted.position]
                slave = replace(
                    item.slave,
                    outputs=[*item.slave.outputs, *item.sii.outputs],
                    inputs=[*item.slave.inputs, *item.sii.inputs],
                )
                wanted = raw_parameters(wanted, slave, self._profiles, self.config.signal)
            raw.append(wanted)
        self.config = replace(self.config, slave=raw)

    @property
    def _absent(self) -> set[int]:
        """Positions of the optional slaves that have not been there yet."""
        return {item.slave.position for item in self._scanned if not item.known}

    @property
    def _present(self) -> list[Scanned]:
        return [item for item in self._scanned if item.known]

    @property
    def _idle(self) -> list[int]:
        """Positions of doubtful slaves without process data; they are not exchanged."""
        slaves = self.bus.slaves
        return [n for n in self._doubtful if not (slaves[n].outputs or slaves[n].inputs)]

    def _reach(self, master: Master, state: AlState) -> None:
        """Takes all slaves to a state, except those that stay in PREOP.

        A doubtful slave that does not reach the state is no error: recovery takes care of it.
        """
        out = {*self._idle, *self._absent}
        used = [n for n in range(len(self.bus.slaves)) if n not in out] if out else None
        master.wait_for_state(state, self.config.state_timeout_s, used, optional=self._doubtful)

    def _map(self, master: Master) -> Image:
        """Lays out the process image, checks its timing, and configures the slaves for it."""
        self.applied = applied = apply(
            self.config, self.bus, self._profiles, master.wire, self._doubtful, self._idle
        )
        for warning in unused_profiles(self.bus, self._profiles):
            self._log.warning(warning)
        for copy in applied.copies:
            if copy.missing:
                self._log.warning(copy.missing)
        self.image = image = lay_out(self.bus, without_lrw(master, self._present))
        self.wire = wire_time(
            image,
            self.config.cycle_time_us,
            len(self.bus.slaves),
            clock=self.config.dc.enabled,
            delay_ns=measure_round_trip(master),
        )
        if warning := self.wire.check():
            self._log.warning(warning)
        configure(master, self._present, image)
        for warning in check_watchdogs(master, self.bus, self._present, self.config):
            self._log.warning(warning)
        if self.config.dc.slave and not self.config.dc.enabled:
            self._log.warning(
                "dc.enabled is false, so the slaves in [[dc.slave]] get no SYNC signals"
            )
        if self.config.dc.reference >= 0 and not self.config.dc.enabled:
            self._log.warning(
                f"dc.enabled is false, so dc.reference = {self.config.dc.reference} does nothing"
            )
        if applied.clocks is not None:
            self.clocks = Clocks(self.bus, self.config, applied.clocks, master)
            self.clocks.measure()
        return image

    def _exchange(self, shared: SharedMemory, master: Master, image: Image) -> Engine:
        """Starts the cyclic exchange with all outputs safe."""
        config = self.config
        shared.fill(self.bus, image, *leases(config))
        self.engine = engine = Engine(
            shared.address,
            shared.out_fd,
            [open_socket(name, Index.ENGINE, Index.LAST) for name in self.interfaces],
            self._run,
        )
        for domain in image.domains:
            engine.add_domain(domain)
        if self.frame_rings:
            self.frame_rings["cycle"].of_engine(engine.handle)
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
        """Gives the engine the safe values, ranges and copies, and how drives are stopped."""
        numbers = {}
        for number, row in enumerate(shared.signals[: shared.header.signal_count]):
            numbers[row.slave, row.index, row.subindex, row.output] = number
            if row.output and (row.minimum > -math.inf or row.maximum < math.inf):
                engine.set_limit(number, row.minimum, row.maximum)
        assert self.applied is not None
        for position, (value, hold) in self.applied.safe.images.items():
            engine.set_safe(position, value, hold)
        for stop in self.applied.safe.stops:
            engine.set_stop(
                numbers[stop.slave, stop.controlword, 0, 1],
                numbers[stop.slave, stop.statusword, 0, 0],
                stop.value,
                stop.patience,
            )
        for copy in self.applied.copies:
            engine.set_copy(
                None if copy.source is None else numbers[*copy.source, 0],
                numbers[*copy.target, 1],
                copy.factor,
                copy.offset,
                -1 if copy.stop is None else numbers[copy.target[0], copy.stop.controlword, 0, 1],
            )

    def _synchronise(self, shared: SharedMemory) -> None:
        """Waits until all clocks are in step, and starts the SYNC signals."""
        if self.clocks is None:
            return
        seconds = self.clocks.wait_for_lock(shared, self._cancelled)
        count = len(self.clocks.followers)
        self._log.of("dc").info(
            f"cycle and {count} clock{'s' * (count != 1)} follow that of "
            f"{self.clocks.reference.label} (after {seconds:.1f} s)"
        )
        here = {item.slave.position for item in self._present}
        failed = finish(self.clocks.sync_signals.start(shared, here), _CLOCK_PAUSE)
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
        """Requests OP after outputs have been sent a few times: slaves need valid ones first."""
        timeout = self.config.state_timeout_s
        # A doubtful slave must not keep the others from OP, and may be in PREOP.
        sure = [item for item in self._present if item.slave.position not in self._doubtful]
        told, refused = finish(write_parameters(master, sure, "SO"), _MAILBOX_PAUSE)
        for text in told:
            self._log.warning(text)
        if refused:
            raise StateError("; ".join(missed.text for missed in refused.values()))
        finish(wait_for_outputs(shared, self.bus, timeout, self._cancelled))
        self._reach(master, AlState.OP)

    def _summarise(self, image: Image) -> str:
        absent = len(self._absent)
        count = len(self.bus.slaves) - absent
        away = f" (and {absent} optional, absent)" if absent else ""
        return (
            f"bus '{self.bus.name}' is in OP: {count} slave{'s' * (count != 1)}{away}, "
            f"{image.output_bytes} bytes of outputs, "
            f"{sum(domain.input_bytes for domain in image.domains)} of inputs, every "
            f"{self.config.cycle_time_us} µs (after {time.monotonic() - self._begin:.1f} s)"
            f"{self._differences}"
        )

    @property
    def _differences(self) -> str:
        count = len(self.differences)
        if not count:
            return ""
        return f"; {count} difference{'s' * (count != 1)} from the expected bus"
