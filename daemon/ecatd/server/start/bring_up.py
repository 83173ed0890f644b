"""Brings a bus up, from an interface to slaves in OP, and takes it down again.

The steps must be in the order of `BringUp.run`: reserve, scan, read, map, exchange with safe
outputs, synchronise clocks, SAFEOP, OP. What they know is a class for each phase: `Plan` before the
scan, `FoundBus` after it, with `ProcessData` once they are mapped, and `RunningBus` in OP. If a
step fails, the steps before it are undone.
"""

from __future__ import annotations

import itertools
import secrets
import threading
import time
from collections.abc import Mapping
from contextlib import ExitStack, closing, suppress
from pathlib import Path

from ecatd.base.coroutine_steps import finish
from ecatd.base.errors import StateError
from ecatd.base.log import Log
from ecatd.base.timeouts import Timeout
from ecatd.config import Config
from ecatd.description.bus import Bus
from ecatd.etg.al import AlState
from ecatd.master.engine.engine import Engine, Index, open_socket
from ecatd.master.engine.shared_memory import SharedMemory
from ecatd.master.frames.frame_ring import FrameRing
from ecatd.master.master import Master
from ecatd.operations.frames import RINGS

from .exchange import find_failing, leases, start_exchange
from .found_bus import FoundBus
from .process_data import ProcessData, set_up_process_data
from .reading import Plan, prepare, read, scan
from .running_bus import RunningBus
from .set_up import SetUp
from .slave_configuration import leave
from .to_op import MAILBOX_PAUSE_S, LeftOutError, ToOp

_TRIES = 3  # most tries, if slaves lose their power while they are read
_STOP_PATIENCE = Timeout(1.0)
_MIB = 1 << 20


class BringUp:
    """The start of one bus. It blocks, so use it on the worker, but for `abort`.

    Args:
        config: The configuration.
        interface: The interface, which may come from the simulator instead of the configuration.
        log: The log for progress and warnings.
    """

    def __init__(self, config: Config, interface: str, log: Log) -> None:
        self._config = config
        self._interface = interface
        self._log = log.of("start")
        self._run = secrets.randbits(32)
        self._begin = time.monotonic()
        self._aborted = threading.Event()
        self._goes_down = False  # taking the bus down has to wait for slaves

    def abort(self) -> None:
        """Makes a start that is under way fail soon; in any thread."""
        self._aborted.set()

    def run(self, memory: Path) -> RunningBus:
        """Brings the bus to OP.

        Args:
            memory: The folder for the shared memory.

        Raises:
            EcatError: A step failed.
        """
        plan = self._prepare()
        left_out: dict[int, str] = {}
        with ExitStack() as opened:
            size = self._config.flight_recorder.memory_mb * _MIB
            rings = {
                name: opened.enter_context(closing(FrameRing(size // 2)))
                for name in (RINGS if size else ())
            }
            while True:
                try:
                    return self._to_op(plan, memory, left_out, rings, opened)
                except LeftOutError as error:
                    if self._cancelled():
                        raise
                    left_out |= error.why
                    them = "it" if len(error.why) == 1 else "them"
                    self._log.warning(f"{error}; the start begins again without {them}")

    def describe(self) -> Bus:
        """Reads the bus and sets its slaves up as for a run, without the exchange.

        Afterwards the slaves are in INIT. It makes no shared memory, so it does not disturb a
        daemon that runs a bus of the same name on another interface.

        Raises:
            EcatError: As `run`.
        """
        found, _ = self._read(self._prepare(), {}, None)
        with closing(found.master):
            self._to_init(found)
        return found.bus

    def _to_op(
        self,
        plan: Plan,
        memory: Path,
        left_out: dict[int, str],
        rings: Mapping[str, FrameRing],
        opened: ExitStack,
    ) -> RunningBus:
        """Tries it once.

        Args:
            plan: What is wanted.
            memory: The folder for the shared memory.
            left_out: See `FoundBus.refused`.
            rings: Keep the last frames.
            opened: Closes what other tries use, too; the bus takes it over.
        """
        with ExitStack() as undo:
            # This reserves the bus, before anything is sent: another daemon may run it.
            shared = undo.enter_context(closing(SharedMemory(plan.config.bus, memory)))
            found, data = self._read(plan, left_out, rings.get("control"))
            undo.callback(found.master.close)
            after_init = undo.enter_context(ExitStack())  # the exchange goes on until INIT
            undo.callback(self._to_init, found)

            shared.fill(found.bus, data.image, *leases(plan.config), data.resolved.can)
            engine = Engine(
                shared.address,
                shared.out_fd,
                [open_socket(name, Index.ENGINE, Index.LAST) for name in found.master.interfaces],
                self._run,
            )
            after_init.callback(engine.close)
            if rings:
                rings["cycle"].of_engine(engine.handle)
            if data.clocks is not None:
                after_init.callback(data.clocks.sync_signals.stop)
            start_exchange(engine, shared, data, plan.config, self._log)
            found.master.relay.follow(engine)

            ToOp(found, shared, data.clocks, self._cancelled, self._log).run()
            engine.restart_counting()  # working counters were not complete before OP
            facts = self._facts(found, data)
            summary = begin = f"bus '{found.bus.name}' is in OP: {facts}"
            # Slaves in OP are no proof that the exchange succeeds.
            if failing := finish(find_failing(shared, found.bus), MAILBOX_PAUSE_S):
                begin = (
                    f"bus '{found.bus.name}' has begun, but no exchange of {', '.join(failing)} "
                    f"has succeeded: `ecatctl check` says why; {facts}"
                )
            opened.push(undo.pop_all())
            return RunningBus(
                *(found, data, shared, engine, SetUp(found, data, shared), found.finder()),
                *(plan.profiles, rings, summary, begin, opened.pop_all().close),
            )

    def _cancelled(self) -> bool:
        return self._aborted.is_set() and not self._goes_down

    def _prepare(self) -> Plan:
        return prepare(self._config, self._interface, self._cancelled, self._log)

    def _read(
        self, plan: Plan, left_out: dict[int, str], ring: FrameRing | None
    ) -> tuple[FoundBus, ProcessData]:
        """Scans, reads and maps the bus; begins again if slaves lose their power meanwhile."""
        for number in itertools.count(1):
            with ExitStack() as undo:
                master = undo.enter_context(closing(self._open_master(plan.config, ring)))
                label = master.label
                try:
                    found = scan(plan, master, left_out)
                    label = found.label
                    undo.callback(self._to_init, found)
                    read(plan, found)
                    data = set_up_process_data(found, plan.profiles, self._log)
                except StateError as error:
                    gone = master.find_gone()
                    if not gone or self._cancelled():
                        raise
                    names = ", ".join(map(label, gone))
                    text = f"{names} answered at first, but no longer: check power and cable"
                    if number == _TRIES:
                        raise StateError(text) from error
                    self._log.warning(f"{text}; the start begins again")
                else:
                    undo.pop_all()
                    return found, data
        raise AssertionError("the last try returns or raises")

    def _open_master(self, config: Config, ring: FrameRing | None) -> Master:
        return Master(
            [name for name in (self._interface, config.second_interface) if name],
            self._cancelled,
            run=self._run,
            share=config.mailbox.share,
            priority=max(config.realtime.priority - 1, 0),
            frame_ring=ring,
            log=self._log,
        )

    def _to_init(self, found: FoundBus) -> None:
        """Takes the slaves down to INIT, with what the configuration writes on the way."""
        self._goes_down = True
        states = found.master.al_states
        # Nobody waits for slaves that are gone; their watchdogs make their outputs safe.
        here = {item.position: item.al_state & 0x0F for item in states.read() if item.al_state}
        # Only slaves in OP go to SAFEOP. Those of a refused start are in PREOP, below it.
        in_op = [position for position, state in here.items() if state == AlState.OP]
        with suppress(StateError):
            steps = leave(found.master, found.present, AlState.INIT, _STOP_PATIENCE)
            for text in finish(steps, MAILBOX_PAUSE_S):
                self._log.warning(text)
        for state, asked in ((AlState.SAFEOP, in_op), (AlState.INIT, list(here))):
            if asked:
                try:
                    states.wait_for(state, _STOP_PATIENCE, asked)
                except StateError as error:
                    self._log.warning(f"at the stop: {error}")
        # A slave may hear this although its answers were lost.
        states.request_of_all(AlState.INIT)
        self._goes_down = False

    def _facts(self, found: FoundBus, data: ProcessData) -> str:
        absent, missing = len(found.absent), len(found.missing)
        count = len(found.bus.slaves) - absent - missing
        away = f" (and {absent} optional, absent)" if absent else ""
        away += f" (and {missing} missing)" if missing else ""
        differences = len(found.expectation.differences)
        differs = f"; {differences} difference{'s' * (differences != 1)} from the expected bus"
        return (
            f"{count} slave{'s' * (count != 1)}{away}, "
            f"{data.image.output_bytes} bytes of outputs, "
            f"{sum(domain.input_bytes for domain in data.image.domains)} of inputs, every "
            f"{self._config.cycle_time_us} µs (after {time.monotonic() - self._begin:.1f} s)"
            f"{differs * bool(differences)}"
        )
