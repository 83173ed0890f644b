"""Brings a bus up, from an interface to slaves in OP.

The steps must be in the order of `BringUp.run`: reserve, scan, read, map, exchange with safe
outputs, synchronise clocks, SAFEOP, OP. Each step stores its results as attributes, and uses those
of the steps before it.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable
from pathlib import Path

from ecatd.base.coroutine_steps import finish
from ecatd.base.errors import StateError
from ecatd.base.log import Log
from ecatd.base.timeouts import Timeout
from ecatd.config import Config
from ecatd.config.profiles import Profiles
from ecatd.config.resolve import alike_slaves
from ecatd.description.bus import Bus
from ecatd.etg.al import AlState
from ecatd.master.engine.engine import Engine, Index, open_socket
from ecatd.master.engine.shared_memory import SharedMemory
from ecatd.master.frames.frame_ring import FrameRing
from ecatd.master.master import Master
from ecatd.operations.frames import RINGS

from .clocks import Clocks
from .configurations import leave
from .exchange import find_failing, leases, start_exchange
from .found import FoundBus
from .gone import find_gone
from .limits import Limits
from .process_data import ProcessData, set_up_process_data
from .reading import Files, read, read_files, scan
from .running import RunningBus
from .set_up import SetUp
from .to_op import MAILBOX_PAUSE_S, LeftOutError, ToOp
from .wire_time import WireTime

_TRIES = 3  # most tries, if slaves lose their power while they are read
_MIB = 1 << 20


class BringUp:
    """The start of one bus. Its attributes are the results of the steps so far.

    Args:
        config: The configuration.
        interface: The interface, which may come from the simulator instead of the configuration.
        log: The log for progress and warnings.
        cancelled: Called while waiting for slaves; when it returns true, the start ends with
            `StateError`.
        memory: The folder for the shared memory; `describe` needs none.

    Attributes:
        interfaces: Names of the interfaces: one, or two with cable redundancy.
        bus: The bus description; it has slaves after the step "read".
        shared: The shared memory: made by "reserve", filled by "exchange".
        master: The master, from "scan" on.
        engine: The engine, from "exchange" on.
        wire: The time that the frames of a cycle take on the wire, from "map" on.
        clocks: The distributed clocks, from "map" on, if the configuration enables them.
        limits: The limits of outputs, which may change, from "exchange" on.
        profiles: The device profiles, once the files of the configuration have been read.
        config: The configuration; from "map" on, it has the positions at which slaves were found.
        frame_rings: The last frames: those of the engine are in `cycle`, all others in `control`;
            empty if the configuration gives no memory for them.
        summary: The bus in one line, once it is in OP.
        begin: The same at the end of the start, which also says if no exchange has succeeded.
    """

    def __init__(
        self,
        config: Config,
        interface: str,
        log: Log,
        cancelled: Callable[[], bool],
        memory: Path | None = None,
    ) -> None:
        self.config = config
        self._memory = memory
        self._interface = interface
        self._log = log.of("start")
        self._cancelled = cancelled
        self._begin = time.monotonic()
        self._found: FoundBus | None = None
        self.interfaces = [name for name in (interface, config.second_interface) if name]
        self._run = secrets.randbits(32)
        self.bus = Bus(config.bus, config.cycle_time_us)
        self.shared: SharedMemory | None = None
        self.master: Master | None = None
        self.engine: Engine | None = None
        self.wire: WireTime | None = None
        self.clocks: Clocks | None = None
        self.limits: Limits | None = None
        self.profiles = Profiles((), 0)
        self.frame_rings: dict[str, FrameRing] = {}
        self.summary = self.begin = ""

    def run(self) -> RunningBus:
        """Brings the bus to OP. It blocks, so call it on the worker.

        Raises:
            EcatError: A step failed. The results of the steps before it stay in the attributes.
        """
        files = self._read_files()
        self.profiles = files.profiles
        if size := self.config.capture.memory_mb * _MIB:
            self.frame_rings = {name: FrameRing(size // 2) for name in RINGS}
        asked, refused = self.config, dict[int, str]()
        while True:
            self.config = asked  # "map" gives it the positions that it has found
            # This reserves the bus, before anything is sent: another daemon may run it.
            assert self._memory is not None, "only `describe` needs no folder"
            self.shared = shared = SharedMemory(self.config.bus, self._memory)
            found, data = self._describe(files, refused)
            engine = self._exchange(shared, found, data)
            self.limits = Limits(found, shared, engine, files.profiles)
            try:
                ToOp(found, shared, data.clocks, self._cancelled, self._log).run()
                break
            except LeftOutError as error:
                if self._cancelled():
                    raise
                refused |= error.why
                them = "it" if len(error.why) == 1 else "them"
                self._log.warning(f"{error}; the start begins again without {them}")
                self._take_back(shared, engine, found.master)
        engine.restart_counting()  # working counters were not complete before OP
        facts = self._summarise(found, data)
        self.summary = f"bus '{self.bus.name}' is in OP: {facts}"
        failing = finish(find_failing(shared, self.bus), MAILBOX_PAUSE_S)
        self.begin = self._say_how(failing, facts)
        return RunningBus(
            self.bus,
            self.interfaces,
            self._run,
            shared,
            found.master,
            engine,
            data.clocks,
            found.absent,
            found.awaited,
            found.uncertain,
            found.idle,
            SetUp(
                found.master,
                shared,
                self.bus,
                found.scanned,
                data.image,
                found.mailboxes,
                data.clocks,
                found.uncertain,
                self.config,
            ),
            found.finder(),
            found.expectation,
            [self.config.settings_of(slave.position).poll_s for slave in self.bus.slaves],
            self.config.recovery,
            self.config.state_timeout,
        )

    def describe(self) -> Bus:
        """Scans and describes the bus without starting the exchange; slaves stay in PREOP.

        Raises:
            EcatError: As `run`.
        """
        self._describe(self._read_files(), {})
        return self.bus

    def leave(self, state: AlState, patience: Timeout) -> None:
        """Writes the slaves' parameters for the way down to a state; see `configurations.leave`."""
        if self._found is not None:
            steps = leave(self._found.master, self._found.present, state, patience)
            for text in finish(steps, MAILBOX_PAUSE_S):
                self._log.warning(text)

    def _read_files(self) -> Files:
        """Reads the files that the configuration names, before anything is sent to the bus."""
        files = read_files(self.config)
        for warning in alike_slaves(self.config):
            self._log.warning(warning)
        return files

    def _take_back(self, shared: SharedMemory, engine: Engine, master: Master) -> None:
        """Ends an exchange that no client has seen yet; slaves that have left PREOP go back."""
        self.leave(AlState.PREOP, self.config.state_timeout)
        there = [item.position for item in master.al_states.read() if item.al_state > AlState.PREOP]
        finish(master.al_states.request(AlState.PREOP, self.config.state_timeout, there))
        self.engine = self.limits = self.shared = self.clocks = self.master = self._found = None
        engine.close()
        master.close()
        shared.close()
        self.bus.slaves = []

    def _describe(self, files: Files, refused: dict[int, str]) -> tuple[FoundBus, ProcessData]:
        """Scans, reads and maps the bus; begins again if slaves lose their power meanwhile.

        Args:
            files: The files of the configuration.
            refused: See `FoundBus.refused`.
        """
        tries = 0
        while True:
            tries += 1
            self.master = master = self._open_master()
            self._found = found = FoundBus(self.bus, master, self.config, refused=refused)
            try:
                scan(found, self._interface, files, self._log)
                read(found, files, self._cancelled, self._log)
                data = set_up_process_data(found, files.profiles, self._log)
            except StateError as error:
                gone = find_gone(master)
                if not gone or self._cancelled():
                    raise
                text = (
                    f"{found.labels(gone)} answered at first, but no longer: check power and cable"
                )
                if tries == _TRIES:
                    raise StateError(text) from error
                self._log.warning(f"{text}; the start begins again")
            else:
                self.config, self.wire, self.clocks = found.config, data.wire, data.clocks
                return found, data
            self.master = self._found = None
            master.close()
            self.bus.slaves = []

    def _open_master(self) -> Master:
        return Master(
            self.interfaces,
            self._cancelled,
            run=self._run,
            share=self.config.mailbox.share,
            priority=max(self.config.realtime.priority - 1, 0),
            frame_ring=self.frame_rings.get("control"),
            log=self._log,
        )

    def _exchange(self, shared: SharedMemory, found: FoundBus, data: ProcessData) -> Engine:
        """Starts the exchange, with all outputs at their safe values."""
        shared.fill(self.bus, data.image, *leases(self.config))
        self.engine = engine = Engine(
            shared.address,
            shared.out_fd,
            [open_socket(name, Index.ENGINE, Index.LAST) for name in self.interfaces],
            self._run,
        )
        if self.frame_rings:
            self.frame_rings["cycle"].of_engine(engine.handle)
        start_exchange(engine, shared, data, self.config, self._log)
        found.master.relay.follow(engine)
        return engine

    def _say_how(self, failing: list[str], facts: str) -> str:
        """What the start says at its end. Slaves in OP are no proof that the exchange succeeds."""
        if not failing:
            return self.summary
        return (
            f"bus '{self.bus.name}' has begun, but no exchange of {', '.join(failing)} has "
            f"succeeded: `ecatctl check` says why; {facts}"
        )

    def _summarise(self, found: FoundBus, data: ProcessData) -> str:
        absent, missing = len(found.absent), len(found.missing)
        count = len(self.bus.slaves) - absent - missing
        away = f" (and {absent} optional, absent)" if absent else ""
        away += f" (and {missing} missing)" if missing else ""
        differences = len(found.expectation.differences)
        differs = f"; {differences} difference{'s' * (differences != 1)} from the expected bus"
        return (
            f"{count} slave{'s' * (count != 1)}{away}, "
            f"{data.image.output_bytes} bytes of outputs, "
            f"{sum(domain.input_bytes for domain in data.image.domains)} of inputs, every "
            f"{self.config.cycle_time_us} µs (after {time.monotonic() - self._begin:.1f} s)"
            f"{differs * bool(differences)}"
        )
