"""Brings slaves back to OP as `recovery.py` decides, beside the watch and beside other requests."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable, Iterable, Sequence

from ecatd.log import Log
from ecatd.model.al import AlState
from ecatd.model.bus import Bus
from ecatd.model.errors import EcatError

from ..datagrams import Place
from ..mailbox import Mailbox
from ..master import SlaveState
from ..start.bring_up import RunningBus
from ..start.identify import Found
from ..start.set_up import Missed
from ..steps import Steps
from .presence import name_slaves
from .recovery import QUICK_TRIES, Condition, Failure, Plan, Recovery

_NAMES_MAX = 3


class Repair:
    """Recovery of the slaves of one bus.

    Args:
        running: The bus.
        mailbox: The worker on which it is done.
        log: Where it is told.
        tell: Publishes an event: its kind, and facts.
        look: Reads the AL states and tells of changes.
    """

    def __init__(
        self,
        running: RunningBus,
        mailbox: Mailbox,
        log: Log,
        tell: Callable[..., None],
        look: Callable[[], Awaitable[object]],
    ) -> None:
        self._running = running
        self._bus: Bus = running.bus
        self._mailbox = mailbox
        self._log = log
        self._tell = tell
        self._look = look
        self._retry_s = running.recovery.retry_s
        self._recovery = Recovery(
            len(running.bus.slaves), running.recovery.slaves, running.recovery.retry_s
        )
        self._jobs: dict[asyncio.Task[None], set[int]] = {}

    def condition(self, position: int) -> tuple[Condition, str]:
        """What is known of a slave that should be in OP and is not."""
        return self._recovery.condition(position)

    def want(self, positions: Iterable[int], state: AlState) -> None:
        """Somebody brings slaves to a state: what is done to them here ends."""
        chosen = set(positions)
        for task, at_work in list(self._jobs.items()):
            if at_work & chosen:
                task.cancel()
                self.settled(at_work)  # the others are looked at again
        self._recovery.want(chosen, state)

    def settled(self, positions: Iterable[int]) -> None:
        """Nobody else is at work on these slaves any more."""
        for position in positions:
            self._recovery.done(position, None)

    def close(self) -> None:
        """Ends what is under way."""
        for task in self._jobs:
            task.cancel()

    def act(self, states: Sequence[SlaveState], strangers: int, *, foreign: bool) -> None:
        """Begins what the states of the slaves ask for, and tells it."""
        plan = self._recovery.look(states, strangers, time.monotonic(), foreign=foreign)
        self._tell_plan(plan)
        if plan.ask:
            self._begin(plan.ask, self._ask(plan.ask))
        if plan.set_up:
            missing = {item.position for item in states if not item.al_state & 0x0F}
            self._begin(plan.set_up, self._set_up(plan.set_up, missing))

    def _ask(self, positions: list[int]) -> Steps[dict[int, Failure]]:
        missed = yield from self._running.set_up.ask(positions)
        return {position: _failure(item) for position, item in missed.items()}

    def _set_up(self, positions: list[int], missing: set[int]) -> Steps[dict[int, Failure]]:
        """Sets slaves up that are what they were; on the mailbox worker."""
        finder, failures = self._running.finder, {}
        here = []
        for position in positions:
            if position not in missing:
                if text := finder.check(position):
                    failures[position] = Failure(text, Condition.EXCHANGED)
                else:
                    here.append(position)
                yield
        lost = [position for position in positions if position in missing]
        found = finder.look() if lost else Found()
        for position in lost:
            if position in found.places:
                self._take_back(position, found.places[position])
                here.append(position)
            elif position in found.exchanged:
                failures[position] = Failure(found.exchanged[position], Condition.EXCHANGED)
            else:
                text = found.unclear.get(position, "")
                failures[position] = Failure(text, Condition.MISSING)
        yield
        missed = yield from self._running.set_up.run(here)
        return failures | {position: _failure(item) for position, item in missed.items()}

    def _take_back(self, position: int, place: int) -> None:
        """Gives an identified slave its address; the reference clock is followed from then on."""
        clocks = self._running.clocks
        if clocks is not None and clocks.reference.position == position:
            clocks.restart_reference(Place(place))
        self._running.finder.give_address(position, place)

    def _begin(self, positions: list[int], steps: Steps[dict[int, Failure]]) -> None:
        task = asyncio.get_running_loop().create_task(self._carry_out(positions, steps))
        self._jobs[task] = set(positions)
        task.add_done_callback(lambda done: self._jobs.pop(done, None))

    async def _carry_out(self, positions: list[int], steps: Steps[dict[int, Failure]]) -> None:
        failures: dict[int, Failure] = {}
        try:
            failures = await self._mailbox.run_steps(steps)
        except EcatError as error:
            failures = dict.fromkeys(positions, Failure(str(error)))
        except Exception as error:
            self._log.error(f"defect while bringing slaves back: {error!r}")
            failures = dict.fromkeys(positions, Failure(f"defect: {error!r}"))
        self._finish(positions, failures)
        await self._look()

    def _finish(self, positions: list[int], failures: dict[int, Failure]) -> None:
        news: dict[str, list[int]] = {}
        for position in positions:
            failure = failures.get(position)
            if self._recovery.done(position, failure) and failure is not None and failure.text:
                news.setdefault(failure.text, []).append(position)
                self._tell_one(position, failure.condition, text=failure.text)
        for text, who in news.items():
            named = who if len(who) <= _NAMES_MAX else []
            for position in named:
                label = self._bus.slaves[position].label
                self._log.warning(text if label in text else f"{label}: {text}")
            if not named:
                self._log.warning(f"{name_slaves(self._bus, who)}: {text}")

    def _tell_plan(self, plan: Plan) -> None:
        for position in plan.fallen:
            self._tell_one(position, "fallen")
        for position in plan.ask:
            self._tell_one(position, "asked")
        for position in plan.set_up:
            self._tell_one(position, "set_up")
        if plan.ask:
            self._log.debug(f"{name_slaves(self._bus, plan.ask)}: asked for OP again")
        if plan.set_up:
            self._log.debug(f"{name_slaves(self._bus, plan.set_up)}: looked for and set up")
        self._tell_recovered(plan.recovered)
        if plan.slow:
            self._log.warning(
                f"{name_slaves(self._bus, plan.slow)}: not back in OP after {QUICK_TRIES} tries; "
                f"from now on one every {self._retry_s:g} s, for as long as OP is wanted"
            )
        for position in plan.slow:
            self._tell_one(position, "slow")
        for position, text in plan.refused.items():
            self._log.error(f"{self._bus.slaves[position].label} stays out of OP: {text}")
            self._tell_one(position, Condition.REFUSED, text=text)

    def _tell_recovered(self, recovered: dict[int, float]) -> None:
        for position, seconds in recovered.items():
            self._tell_one(position, "recovered", seconds=seconds)
        if recovered:
            names = name_slaves(self._bus, list(recovered))
            self._log.info(f"{names}: back in OP after {max(recovered.values()):.1f} s")

    def _tell_one(self, position: int, state: str, **facts: object) -> None:
        self._tell("recovery", slave=position, state=str(state), **facts)


def _failure(missed: Missed) -> Failure:
    return Failure(missed.text, Condition.REFUSED if missed.changed else Condition.WAITING)
