"""Each fault is told once, and so is its end: nothing of it is left out, and nothing repeated.

The faults happen to slave 5 of the rig `troll`, in front of slaves 6 and 7. None of the three has
outputs, so that no watchdog adds events of its own on a busy machine.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import pytest
from test_bad_conditions import Bench, simple

from conftest import PATIENCE, Daemon, names
from ecatsim.control import Simulator
from ecatsim.control.client import RemoteFaults as Faults

pytestmark = [pytest.mark.bus, pytest.mark.long]

CYCLE_TIME_US = 1000
"""These tests wait for many cycles."""

CONFIG = "state_timeout_s = 10.0\n[gateway]\nlisten = []\n[recovery]\nretry_s = 0.2\n"
SLAVE, BEHIND = 5, (6, 7)
REASON, WATCHDOG = 0x001D, 0x001B
LOST = 100
LOOKS = 1500
"""Cycles of 1 ms in which there are several tries."""

Fact = tuple[str, int, str]
"""Kind of an event, slave, and what is said of it."""


class Fault(NamedTuple):
    """A fault, and all that is told about it.

    Attributes:
        strike: Has it happen.
        begin: What is told while it lasts.
        end: Undoes it; None: it ends by itself.
        after: What is told when it is over.
        log: Words of one line of the log.
    """

    strike: Callable[[Faults], None]
    begin: list[Fact]
    end: Callable[[Bench, Faults], None] | None
    after: list[Fact]
    log: tuple[str, ...]


def of(kind: str, text: str, slaves: tuple[int, ...] = (SLAVE,)) -> list[Fact]:
    return [(kind, slave, text) for slave in slaves]


ALL = (SLAVE, *BEHIND)
GONE = of("al_state", "no answer", ALL) + of("recovery", "fallen", ALL)
BACK = of("al_state", "OP", ALL) + of("recovery", "recovered", ALL)
ONE_BACK = of("al_state", "OP") + of("recovery", "recovered")

FAULTS = {
    "a cable breaks": Fault(
        lambda faults: faults.break_link(SLAVE, 0),
        GONE,
        lambda bench, faults: faults.heal_link(SLAVE, 0),
        BACK,
        ("slave count changed", "3 slaves missing"),
    ),
    "a slave loses its power": Fault(
        lambda faults: faults.power_off(SLAVE),
        GONE,
        lambda bench, faults: faults.power_on(SLAVE),
        BACK + of("recovery", "set_up"),
        ("slave count changed", "3 slaves missing"),
    ),
    "a slave is exchanged": Fault(
        lambda faults: faults.swap(SLAVE, "EL1008"),
        of("al_state", "no answer")
        + of("recovery", "fallen")
        + of("recovery", "set_up")
        + of("recovery", "exchanged"),
        lambda bench, faults: faults.swap(SLAVE, "original"),
        ONE_BACK,
        ("another device", "slave 5"),
    ),
    "a watchdog expires": Fault(
        lambda faults: faults.al_error(SLAVE, code=WATCHDOG),
        of("al_state", "SAFEOP+ERROR") + of("recovery", "fallen") + of("recovery", "asked"),
        None,
        ONE_BACK,
        ("slave 5", "0x001B"),
    ),
    "a slave leaves OP for a reason of its own": Fault(
        lambda faults: faults.al_error(SLAVE, code=REASON),
        of("al_state", "SAFEOP+ERROR") + of("recovery", "fallen") + of("recovery", "refused"),
        lambda bench, faults: bench.daemon.ctl("state", str(SLAVE), "OP") and None,
        ONE_BACK,
        ("slave 5", "stays out of OP", "0x001D"),
    ),
    "an emergency": Fault(
        lambda faults: faults.emergency(BEHIND[0], 0x8110),
        [("emergency", BEHIND[0], "0x8110")],
        None,
        [],
        ("slave 6", "emergency", "0x8110"),
    ),
}


@pytest.fixture
def bench(start_daemon: Callable[..., Daemon]) -> Iterator[Bench]:
    bench = Bench(start_daemon("troll", config=CONFIG))
    bench.wait_for_data()
    yield bench
    bench.close()


def facts(events: list[dict[str, Any]]) -> Counter[Fact]:
    """What is told of the three slaves, without the states on the way to OP."""
    found: Counter[Fact] = Counter()
    for event in events:
        kind, slave = event["event"], event.get("slave", -1)
        if slave < SLAVE:
            continue
        if kind == "al_state":
            text = event["text"].partition(": ")[2].partition(" (")[0]
            if text not in ("PREOP", "SAFEOP"):
                found[kind, slave, text] += 1
        elif kind == "recovery":
            found[kind, slave, event["state"]] += 1
        elif kind == "emergency":
            found[kind, slave, f"0x{event['code']:04X}"] += event["times"]
    return found


def wait_for_tries(bench: Bench) -> None:
    """Waits until the daemon has looked at the slaves, and tried to help them, several times."""
    with bench.daemon.client() as client:
        client.wait(LOOKS, timeout=PATIENCE)


@pytest.mark.parametrize("name", list(FAULTS))
def test_r44_a_fault_and_its_end_are_told_once(bench: Bench, name: str) -> None:
    fault, since = FAULTS[name], len(bench.daemon.log)
    begun, told = Counter(fault.begin), Counter(fault.begin + fault.after)
    with Simulator(str(bench.simulator)) as simulator:
        fault.strike(simulator.faults)
        bench.wait_for(lambda: begun <= facts(bench.events))
        if fault.end:
            wait_for_tries(bench)
            assert facts(bench.events) == begun
            fault.end(bench, simulator.faults)
    bench.wait_for(lambda: told <= facts(bench.events))
    bench.wait_for_op()
    bench.wait_for_data()
    wait_for_tries(bench)
    assert facts(bench.events) == told
    lines = [
        line
        for line in bench.daemon.log[since:].splitlines()
        if all(word in line for word in fault.log)
    ]
    assert len(lines) == 1, bench.daemon.log


def test_r02_a_hundred_lost_frames_are_counted_and_told(bench: Bench) -> None:
    """The inputs are marked from the first one on, and all slaves are in OP again afterwards."""
    before, since = bench.health(), len(bench.events)
    with Simulator(str(bench.simulator)) as simulator:
        simulator.faults.drop(count=LOST)
    bench.wait_for(lambda: bench.health().lost >= before.lost + LOST)
    bench.wait_for_op()
    bench.wait_for_data()
    states = [
        event["state"]
        for event in map(simple, bench.events[since:])
        if event["event"] == "working_counter"
    ]
    assert states[0] == "zero"

    def told() -> int:  # a busy machine has disturbances of its own
        found = (event for event in bench.events[since:] if event["event"] == "disturbance")
        return sum(event["counts"].get("lost", 0) for event in found)

    bench.wait_for(lambda: told() >= LOST)
    names(bench.daemon.log, "lost ")
