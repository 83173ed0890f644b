"""`ecatctl events`: what has happened on a bus, for those who ask later."""

import asyncio
import json
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import pytest

from conftest import Daemon, names, one_line_error, wait_for
from ecatd.server.watch.event_history import EventHistory
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
    wait_for(lambda: "back in OP" in bus.ctl("events", str(LAST)).stdout, bus)
    found = bus.ctl_json("events")["events"]
    numbers = [event["sequence"] for event in found]
    assert numbers == [*range(numbers[0], numbers[0] + len(numbers))]
    of_slave = bus.ctl_json("events", str(LAST))["events"]
    assert {event["slave"] for event in of_slave if "slave" in event} == {LAST}
    lines = bus.ctl("events").stdout.splitlines()
    assert len(lines) >= len(found)
    names("\n".join(lines), "slave 10 (EL2008)", "recovery", "back in OP after")
    assert {*kinds(bus, "--kind", "recovery", "--kind", "slaves")} == {"recovery", "slaves"}
    assert {event["severity"] for event in found} > {"error"}
    bad = [event for event in found if event["severity"] in ("error", "warning")]
    assert bus.ctl_json("events", "--severity", "warning")["events"][: len(bad)] == bad
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


def test_events_say_the_sentences_of_the_log(bus: Daemon) -> None:
    """A program comes and goes, and a slave gets an alias: who did what is in whole sentences."""
    with bus.client() as client:
        client.claim(LAST, lease=30)
        wait_for(lambda: "claimed" in kinds(bus), bus)
    wait_for(lambda: "safe" in kinds(bus), bus)
    bus.ctl("alias", str(LAST), "77", "--yes")
    lines = bus.ctl("events").stdout
    log = bus.log
    for kind, *words in (
        ("claimed", "owns outputs of slave 10 (EL2008)", "pid"),
        ("safe", "outputs of slave 10 (EL2008) are safe:", "released them"),
        ("change", "slave 10 (EL2008), EEPROM words", "0x0004"),
    ):
        texts = [event["text"] for event in bus.ctl_json("events", "--kind", kind)["events"]]
        (text,) = [text for text in texts if all(word in text for word in words)]
        assert text in log
        assert text in lines


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
    history = EventHistory(sent.append, 7)
    assert history.since(0) == {"instance": 7, "events": [], "next": 1, "left_out": 0}
    for number in range(1200):
        history.publish({"event": "x", "slave": number})
    assert [event["sequence"] for event in sent] == [*range(1, 1201)]
    assert {event["instance"] for event in sent} == {7}
    answer = history.since(0)
    assert (len(answer["events"]), answer["next"], answer["left_out"]) == (1000, 1201, 200)
    assert history.since(1199)["events"] == sent[-2:]
    assert history.since(1201) == {"instance": 7, "events": [], "next": 1201, "left_out": 0}


def test_a_flood_is_one_event_with_a_count() -> None:
    sent: list[dict[str, Any]] = []
    history = EventHistory(sent.append, 0)

    async def flood() -> None:
        for number in range(5000):
            history.publish({"event": "emergency", "slave": 3, "times": 2, "code": number})
        history.publish({"event": "emergency", "slave": 4, "times": 1, "code": 7})
        history.publish({"event": "al_state", "slave": 3})
        told = len(sent)
        assert told < 50, "others still find room"
        assert [event["event"] for event in sent[-2:]] == ["emergency", "al_state"]
        while len(sent) == told:
            await asyncio.sleep(0.01)
        assert sent[-1]["code"] == 4999
        assert (
            sum(
                event["times"]
                for event in sent
                if (event["event"], event["slave"]) == ("emergency", 3)
            )
            == 10000
        )
        history.publish({"event": "emergency", "slave": 3, "times": 5, "code": 5000})
        history.close()
        assert (sent[-1]["code"], sent[-1]["times"]) == (5000, 5), "the end loses nothing"

    asyncio.run(flood())
    assert [event["sequence"] for event in sent] == [*range(1, len(sent) + 1)]


def test_a_daemon_that_is_not_there(bus: Daemon) -> None:
    gone = bus.ctl("events", "--bus", "nobody", check=False)
    assert gone.returncode == 3
    one_line_error(gone.stderr, "ecatctl")
