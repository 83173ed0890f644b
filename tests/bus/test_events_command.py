"""`ecatctl events`: what has happened on a bus, for those who ask later."""

import json
import subprocess
import sys
from collections.abc import Callable

import pytest

from conftest import Daemon, names, one_line_error, wait_for
from ecatd.bus.watch.event_history import EventHistory
from ecatsim.control import Simulator

pytestmark = pytest.mark.bus
LAST = 10
"""Position of the last slave of the rig."""


@pytest.fixture(scope="module")
def bus(start_shared: Callable[..., Daemon]) -> Daemon:
    return start_shared("branches")


def kinds(bus: Daemon, *options: str) -> list[str]:
    return [event["event"] for event in bus.ctl_json("events", *options)["events"]]


def test_events_are_kept(bus: Daemon) -> None:
    with Simulator(str(bus.child_pid("ecatsim"))) as simulator:
        simulator.faults.power_off(LAST)
        wait_for(lambda: "slaves" in kinds(bus), bus)
        silent = bus.ctl("sii-read", str(LAST), check=False)
        assert silent.returncode == 4
        names(silent.stderr, "slave 10 (EL2008)", "does not answer", "switched off")
        simulator.faults.power_on(LAST)
    wait_for(lambda: "recovered" in bus.ctl("events", str(LAST)).stdout, bus)
    found = bus.ctl_json("events")["events"]
    numbers = [event["sequence"] for event in found]
    assert numbers == [*range(numbers[0], numbers[0] + len(numbers))]
    of_slave = bus.ctl_json("events", str(LAST))["events"]
    assert {event["slave"] for event in of_slave if "slave" in event} == {LAST}
    lines = bus.ctl("events").stdout.splitlines()
    assert len(lines) >= len(found)
    names("\n".join(lines), "slave 10 (EL2008)", "recovery", "recovered")
    assert {*kinds(bus, "--kind", "recovery", "--kind", "slaves")} == {"recovery", "slaves"}
    assert kinds(bus, "--since", "1h")[: len(found)] == [event["event"] for event in found]
    later = bus.ctl_json("events", "--since", "0s")["events"]
    assert all(event["sequence"] > numbers[-1] for event in later)
    for kind in ("recovery", "slaves"):
        assert kind in kinds(bus, str(LAST)), "both are about this slave"
    unknown = bus.ctl("events", "--kind", "emergencies", check=False)
    assert unknown.returncode == 2
    names(unknown.stderr, "emergencies", "emergency")
    wrong = bus.ctl("events", "--since", "noon", check=False)
    assert wrong.returncode == 2
    names(wrong.stderr, "'noon'", "10m")


def test_events_are_followed(bus: Daemon) -> None:
    command = [sys.executable, "-m", "ecatd.cli", "events", "--follow", "--json"]
    with subprocess.Popen(command, env=bus.env, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            bus.ctl("log-level", "mailbox", "debug")
            found = map(json.loads, process.stdout)
            event = next(item for item in found if item["event"] == "log_levels")
        finally:
            process.kill()
    bus.ctl("log-level", "mailbox", "info")
    assert (event["event"], event["bus"]) == ("log_levels", bus.bus)


def test_those_that_are_too_old_are_counted() -> None:
    sent: list[dict[str, object]] = []
    history = EventHistory(sent.append)
    history.instance = 7
    assert history.since(0) == {"instance": 7, "events": [], "next": 1, "left_out": 0}
    for number in range(1200):
        history.publish({"event": "x", "number": number})
    assert [event["sequence"] for event in sent] == [*range(1, 1201)]
    assert {event["instance"] for event in sent} == {7}
    answer = history.since(0)
    assert (len(answer["events"]), answer["next"], answer["left_out"]) == (1000, 1201, 200)
    assert history.since(1199)["events"] == sent[-2:]
    assert history.since(1201) == {"instance": 7, "events": [], "next": 1201, "left_out": 0}


def test_a_daemon_that_is_not_there(bus: Daemon) -> None:
    gone = bus.ctl("events", "--bus", "nobody", check=False)
    assert gone.returncode == 3
    one_line_error(gone.stderr, "ecatctl")
