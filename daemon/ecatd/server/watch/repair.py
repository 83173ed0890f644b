"""Brings slaves back to OP as `recovery.py` decides, while the watch and other requests go on."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Awaitable, Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress

from ecatd.base.coroutine_steps import Steps
from ecatd.base.errors import EcatError, StateError
from ecatd.config import RecoveryConfig
from ecatd.description.bus import Bus
from ecatd.description.conditions import Condition
from ecatd.etg.al import AlState
from ecatd.master.al_states import WHY_SILENT, SlaveState
from ecatd.master.frames.datagrams import Place
from ecatd.master.frames.wire import WireChangedError
from ecatd.master.master import SilentSlaveError
from ecatd.master.worker import Worker

from ..start.matching import Exchanged, Found
from ..start.running_bus import RunningBus
from ..start.slave_configuration import Missed
from .presence import name_slaves
from .recovery import QUICK_TRIES, Failure, Plan, Recovery
from .reports import Reporter

_LOOKS = 3
_NAMES_MAX = 3


class Repair:
    """Recovery of the slaves of one bus.

    Args:
        running: The bus.
        worker: The worker on which it is done.
        report: Reports the recovery.
        look: Reads the AL states and reports changes.
        restarted: Called on the worker with the position of a slave that has been without power.
    """

    def __init__(
        self,
        running: RunningBus,
        worker: Worker,
        report: Reporter,
        look: Callable[[], Awaitable[object]],
        restarted: Callable[[int], None],
    ) -> None:
        self._running = running
        self._bus: Bus = running.bus
        self._worker = worker
        self._report = report
        self._look = look
        self._restarted = restarted
        found, config = running.found, running.config.recovery
        self._retry_s = config.retry_s
        self._recovery = Recovery(
            *(len(found.bus.slaves), config.slaves, config.retry_s),
            *(running.optional, found.absent),
        )
        self._recovery.want(found.idle, AlState.PREOP)
        self._settled(found.idle)
        self._jobs: dict[asyncio.Task[None], set[int]] = {}
        self._steps: dict[int, str] = {}  # what was last reported about the tries with a slave

    def wanted(self, position: int) -> AlState:
        """The state in which a slave should be."""
        return self._recovery.wanted(position)

    def condition(self, position: int) -> tuple[Condition, str]:
        """What is known of a slave that is not as it should be."""
        condition, text = self._recovery.condition(position)
        if not condition and (uncertain := self._running.found.uncertain.get(position)):
            return uncertain.condition, uncertain.text
        return condition, text

    @property
    def busy(self) -> bool:
        """Whether slaves are being brought back."""
        return bool(self._jobs)

    def left_alone(self) -> dict[int, tuple[int, int] | None]:
        """By position, devices in the places of slaves of which it was told why they are left.

        Each with its vendor ID and product code, or None if it is not clear which device it is.
        """
        return self._recovery.left_alone()

    def down_since(self, position: int) -> float | None:
        """When a slave that should be in OP has left it, in Unix seconds; None if it has not."""
        duration = self._recovery.down_for(position, time.monotonic())
        return None if duration is None else round(time.time() - duration, 3)

    def _want(self, positions: Iterable[int], state: AlState) -> None:
        """Ends the recovery of slaves, because a person or a program has requested a state."""
        chosen = set(positions)
        for task, at_work in list(self._jobs.items()):
            if at_work & chosen:
                task.cancel()
                self._settled(at_work)  # the others are looked at again
        self._recovery.want(chosen, state)

    def _settled(self, positions: Iterable[int]) -> None:
        for position in positions:
            self._recovery.done(position, None)

    async def change(self, positions: Sequence[int], state: AlState) -> None:
        """Brings slaves to a state on request; they stay there.

        If a slave refuses the state, its error is acknowledged, and its wanted state is the one
        before. Only a slave that refuses OP keeps its error, which says why.

        Raises:
            StateError: Slaves did not reach it; the message names each, and why.
        """
        if state == AlState.BOOT:
            self._check_boot(positions)
        before = {position: self._recovery.wanted(position) for position in positions}
        self._want(positions, state)
        try:
            await self._worker.run_steps(self._change(positions, state))
        except StateError:
            if state != AlState.OP:
                with suppress(StateError):  # the bus is being stopped
                    await self._take_back(before)
            raise
        finally:
            self._settled(positions)

    def _check_boot(self, positions: Sequence[int]) -> None:
        without = [item for item in positions if not self._running.set_up.has_boot(item)]
        if without:
            one = len(without) == 1
            raise StateError(
                f"{name_slaves(self._bus, without)} {'has' if one else 'have'} no state BOOT: "
                f"{'its EEPROM describes' if one else 'their EEPROMs describe'} no mailbox for it "
                f"(SII words 0x14 to 0x17); nothing was asked for"
            )

    async def _take_back(self, before: dict[int, AlState]) -> None:
        """Forgets a request for those slaves that have refused it."""
        refused = await self._worker.run_steps(self._running.master.al_states.acknowledge(before))
        for position in refused:
            self._recovery.want([position], before[position])

    def _change(self, positions: Sequence[int], state: AlState) -> Steps[None]:
        """Takes slaves to a state. Sets up those that have restarted. Runs on the worker.

        Nobody waits for slaves that do not answer: they are named when the others are there.
        """
        running = self._running
        yield from self._leave(positions, state)
        seen = yield from self._see(positions)
        found, failures = self._find([position for position in positions if not seen[position]])
        _refuse(self._bus, {p: failure for p, failure in failures.items() if failure.text})
        silent = {p: Failure(f"no answer: {WHY_SILENT}") for p in failures}
        positions = [p for p in positions if p not in silent]
        if state == AlState.BOOT:
            elsewhere = [p for p in positions if seen[p] != AlState.BOOT]
            yield from self._bring(elsewhere, state, AlState.INIT)
        if state in (AlState.PREOP, AlState.SAFEOP, AlState.OP):
            below = (AlState.INIT, AlState.BOOT)
            anew = [*found, *(p for p in positions if seen[p] in below)]
            yield from self._bring(anew, state, AlState.INIT)
        if state in (AlState.SAFEOP, AlState.OP):
            mapped_anew = [p for p in positions if seen[p] == AlState.PREOP]
            yield from self._bring(mapped_anew, state, AlState.PREOP)
        if state == AlState.OP:
            in_safeop = [p for p in positions if seen[p] == AlState.SAFEOP]
            missed = yield from running.set_up.write_before_op(in_safeop)
            _refuse(self._bus, {position: _failure(item) for position, item in missed.items()})
        yield from running.master.al_states.require(state, running.config.state_timeout, positions)
        _refuse(self._bus, silent)

    def _see(self, positions: Sequence[int]) -> Steps[dict[int, int]]:
        """The AL states of slaves by position, 0 without an answer; a frame may get lost."""
        seen: dict[int, int] = {}
        for _ in range(_LOOKS):
            states = self._running.master.al_states.read()
            seen |= {item.position: item.al_state & 0x0F for item in states if item.al_state}
            if seen.keys() >= {*positions}:
                break
            yield
        return {position: seen.get(position, 0) for position in positions}

    def _leave(self, positions: Sequence[int], state: AlState) -> Steps[None]:
        for text in (yield from self._running.set_up.leave(positions, state)):
            self._report.log.warning(text)

    def _bring(self, positions: Sequence[int], state: AlState, begin: AlState) -> Steps[None]:
        missed = yield from self._running.set_up.run(positions, state, begin=begin)
        _refuse(self._bus, {position: _failure(item) for position, item in missed.items()})

    def set_recovery(self, config: RecoveryConfig) -> None:
        """Changes which slaves are recovered, and how often it is tried."""
        self._retry_s = config.retry_s
        self._recovery.set_policy(config.slaves, config.retry_s)

    def close(self) -> None:
        """Ends all repairs that are under way."""
        for task in self._jobs:
            task.cancel()

    def act(
        self,
        states: Sequence[SlaveState],
        strangers: int,
        since: Mapping[str, int],
        *,
        foreign: bool,
    ) -> None:
        """Starts the recovery that the states of the slaves call for, and reports it.

        Args:
            states: The states.
            strangers: How many slaves are there beside them.
            since: The `cycle` in which that has changed, if it is known.
            foreign: Whether another master is at work.
        """
        plan = self._recovery.look(states, strangers, time.monotonic(), foreign=foreign)
        self._report_plan(plan, since)
        if plan.ask:
            self._begin(plan.ask, self._ask(plan.ask))
        if plan.set_up:
            missing = {item.position for item in states if not item.al_state & 0x0F}
            self._begin(plan.set_up, self._set_up(plan.set_up, missing))

    def _ask(self, positions: list[int]) -> Steps[dict[int, Failure]]:
        missed = yield from self._running.set_up.ask(positions)
        return {position: _failure(item) for position, item in missed.items()}

    def _set_up(self, positions: list[int], missing: set[int]) -> Steps[dict[int, Failure]]:
        """Sets up slaves, after checking that they are the slaves of the scan; on the worker."""
        finder, failures = self._running.finder, {}
        here = []
        for position in positions:
            if position not in missing:
                if exchanged := finder.check(position):
                    failures[position] = self._exchanged(position, exchanged)
                else:
                    here.append(position)
                yield
        yield from self._leave(here, AlState.INIT)
        found, lost = self._find([position for position in positions if position in missing])
        yield
        missed = yield from self._running.set_up.run(here + found)
        return failures | lost | {position: _failure(item) for position, item in missed.items()}

    def _find(self, lost: Sequence[int]) -> tuple[list[int], dict[int, Failure]]:
        """Gives slaves that have lost their address their address back.

        Returns:
            The positions of those slaves, and why the others have none.
        """
        found = self._running.finder.look() if lost else Found()
        here, failures = [], {}
        for position in lost:
            if position in found.places:
                self._give_address(position, found.places[position])
                if position in found.other_device:
                    self._running.set_up.is_new(position)
                here.append(position)
            elif position in found.exchanged:
                failures[position] = self._exchanged(position, found.exchanged[position])
            else:
                text = found.unclear.get(position, "")
                absent = position in self._running.optional and not text
                condition = Condition.ABSENT if absent else Condition.MISSING
                failures[position] = Failure(text, condition)
        return here, failures

    def _exchanged(self, position: int, found: Exchanged) -> Failure:
        text = found.text + self._running.found.expectation.restart_without([position])
        return Failure(text, Condition.EXCHANGED, found.device)

    def _give_address(self, position: int, place: int) -> None:
        """Gives an identified slave its address; the reference clock is followed from then on."""
        clocks = self._running.clocks
        if clocks is not None and clocks.reference.position == position:
            clocks.restart_reference(Place(place))
        self._running.finder.give_address(position, place)
        self._restarted(position)

    def _begin(self, positions: list[int], steps: Steps[dict[int, Failure]]) -> None:
        task = asyncio.get_running_loop().create_task(self._carry_out(positions, steps))
        self._jobs[task] = set(positions)
        task.add_done_callback(lambda done: self._jobs.pop(done, None))

    async def _carry_out(self, positions: list[int], steps: Steps[dict[int, Failure]]) -> None:
        failures: dict[int, Failure] = {}
        try:
            failures = await self._worker.run_steps(steps)
        except EcatError as error:
            # What one slave has spoiled for the others is no try of theirs.
            for position in positions:
                early = isinstance(error, WireChangedError) or (
                    isinstance(error, SilentSlaveError) and error.position != position
                )
                failures[position] = Failure(str(error), early=early)
        except Exception as error:
            self._report.log.error(f"defect in ecatd while bringing slaves back: {error!r}")
            failures = dict.fromkeys(positions, Failure(f"defect in ecatd: {error!r}"))
        self._finish(positions, failures)
        await self._look()

    def _finish(self, positions: list[int], failures: dict[int, Failure]) -> None:
        news: dict[int, Failure] = {}
        for position in positions:
            failure = failures.get(position)
            if failure is not None:
                text = failure.text or "no slave is there"
                self._report.log.debug(
                    f"slave {position}: this try failed ({failure.condition}): {text}"
                )
            if self._recovery.done(position, failure) and failure is not None and failure.text:
                news[position] = failure
                (text,) = _lines(self._bus, {position: failure})
                self._publish(position, failure.condition, text)
        for line in _lines(self._bus, news):
            self._report.write("recovery", line, news, level="warning")

    def _report_plan(self, plan: Plan, since: Mapping[str, int]) -> None:
        for position in plan.fallen:
            self._steps.pop(position, None)
            self._publish(
                position, "fallen", f"{self._bus.slaves[position].label}: left OP", **since
            )
        self._report_step(plan.ask, "asked", "asked for OP again")
        self._report_step(plan.set_up, "set_up", "ecatd looks for it and sets it up")
        self._report_recovered(plan.recovered)
        if plan.slow:
            what = (
                f"not back in OP after {QUICK_TRIES} tries; "
                f"ecatd goes on with one try every {self._retry_s:g} s while OP is wanted"
            )
            text = f"{name_slaves(self._bus, plan.slow)}: {what}"
            self._report.write("recovery", text, plan.slow, level="warning")
            for position in plan.slow:
                self._publish(position, "slow", f"{self._bus.slaves[position].label}: {what}")
        for position, text in plan.refused.items():
            line = f"{self._bus.slaves[position].label} stays out of OP: {text}"
            self._report.write("recovery", line, [position])
            self._publish(position, Condition.REFUSED, line)

    def _report_step(self, positions: list[int], step: str, what: str) -> None:
        """Reports what is tried with slaves; an event only if the last try was another one."""
        if positions:
            self._report.log.debug(f"{name_slaves(self._bus, positions)}: {what}")
        for position in positions:
            if self._steps.get(position) != step:
                self._steps[position] = step
                self._publish(position, step, f"{self._bus.slaves[position].label}: {what}")

    def _report_recovered(self, recovered: dict[int, float]) -> None:
        joined = [position for position, seconds in recovered.items() if math.isinf(seconds)]
        first_time = "there for the first time, and in OP"
        for position in joined:
            self._publish(position, "joined", f"{self._bus.slaves[position].label}: {first_time}")
        if joined:
            text = f"{name_slaves(self._bus, joined)}: {first_time}"
            self._report.write("recovery", text, joined, good=True)
        back = {n: seconds for n, seconds in recovered.items() if n not in joined}
        for position, seconds in back.items():
            text = f"{self._bus.slaves[position].label}: back in OP after {seconds:.1f} s"
            self._publish(position, "recovered", text, seconds=seconds)
        if back:
            names = name_slaves(self._bus, list(back))
            text = f"{names}: back in OP after {max(back.values()):.1f} s"
            self._report.write("recovery", text, back, good=True)

    def _publish(self, position: int, state: str, text: str, **facts: object) -> None:
        facts |= {"slave": position, "state": str(state), "text": text}
        self._report.publish("recovery", severity=_SEVERITIES.get(str(state), "warning"), **facts)


_SEVERITIES = {
    **dict.fromkeys(("recovered", "joined"), "info"),
    **dict.fromkeys(("asked", "set_up"), "notice"),
    **dict.fromkeys(map(str, (Condition.REFUSED, Condition.EXCHANGED)), "error"),
}
"""How bad events of some states are."""


def _failure(missed: Missed) -> Failure:
    return Failure(missed.text, Condition.REFUSED if missed.changed else Condition.WAITING)


def _lines(bus: Bus, failures: dict[int, Failure]) -> Iterator[str]:
    """Failures in words. If many slaves failed alike, they share a line."""
    alike: dict[str, list[int]] = {}
    for position, failure in failures.items():
        alike.setdefault(failure.text, []).append(position)
    for text, positions in alike.items():
        groups = [positions] if len(positions) > _NAMES_MAX else [[item] for item in positions]
        for group in groups:
            yield f"{name_slaves(bus, group)}: {text}"


def _refuse(bus: Bus, failures: dict[int, Failure]) -> None:
    if failures:
        raise StateError("; ".join(_lines(bus, failures)))
