"""The seven lamps: what is good, what is not, and what nobody knows."""

from dataclasses import replace
from typing import Any

import pytest
from test_health import row
from test_stats import histogram, snapshot

from conftest import names
from ecatd.operations.faults import LOST, WORKING_COUNTER, Fault
from ecatd.operations.health import look_at
from ecatd.shm import contract as shm
from ecatd.shm.statistics import Snapshot
from ecatd.shm.statistics.maps import to_map
from ecatd.view.lamps import OLD_S, TITLES, WINDOW_S, Lamp, Lamps

NOW = 1_800_000_000.0


def well(seconds: int = 10, **counters: int) -> Snapshot:
    """A bus that has been well for some seconds."""
    made = snapshot(
        ring=shm.Ring.CLOSED,
        links=(shm.Link.UP, shm.Link.UP),
        cycle_end_ns=seconds * 10**9,
        read_ns=seconds * 10**9,
        start_ns=0,
    )
    times = {**made.times, "cycle": histogram([300_000] * 100 * seconds)}
    zeros = dict.fromkeys(made.counters, 0)
    ran = {"cycles": 1000 * seconds, "frames": 1000 * seconds}
    domains = tuple(
        replace(
            domain,
            wkc=domain.wkc_expected,
            wkc_state=shm.WkcState.COMPLETE,
            counters={**domain.counters, "exchanges": 1000 * seconds},
        )
        for domain in made.domains
    )
    return replace(made, times=times, counters=zeros | ran | counters, domains=domains)


def stats(made: Snapshot) -> dict[str, Any]:
    return to_map(made, buckets=True)


def states(*rows: dict[str, Any], faults: tuple[Fault, ...] = (), **others: Any) -> dict[str, Any]:
    found = list(rows or (row(0), row(1)))
    return {"slaves": found, "faults": [fault.to_map() for fault in faults], **others}


def output(number: int, owner: int = 0, **others: Any) -> dict[str, Any]:
    return {
        "name": f"1/0x7000:0{number}",
        "slave": 1,
        "owner": owner,
        "state": "active" if owner >= 0 else "safe",
        "cause": "start",
        "reason": "" if owner >= 0 else "no client has claimed it",
        "since": NOW - 5,
        **others,
    }


def outputs(*rows: dict[str, Any]) -> dict[str, Any]:
    return {"outputs": list(rows), "owners": [{"name": "controller", "pid": 412}], "problems": []}


def lit(found: list[Lamp]) -> dict[str, Lamp]:
    assert [lamp["id"] for lamp in found] == list(TITLES)
    return {lamp["id"]: lamp for lamp in found}


def look(
    statistics: Snapshot | None = None,
    slaves: dict[str, Any] | None = None,
    driven: dict[str, Any] | None = None,
) -> dict[str, Lamp]:
    made = stats(statistics or well())
    return lit(Lamps().look(made, slaves or states(), driven or outputs(output(1)), NOW))


def test_a_bus_that_is_well_has_seven_good_lamps() -> None:
    found = look()
    assert {lamp["state"] for lamp in found.values()} == {"good"}
    assert found["slaves_in_op"]["text"] == "2 of 2 slaves in OP"
    assert found["number_of_slaves"]["text"] == "2 of 2 slaves answer"
    names(found["timing"]["text"], "of 1000 µs", "no cycle missed", "none since the start")
    assert found["outputs"]["text"] == "Controller (process 412) drives 1 of 1 outputs"
    assert found["link"]["since"] is None


def test_nothing_is_known_without_answers_and_with_old_ones() -> None:
    lamps = Lamps()
    found = lit(lamps.look(None, None, None, NOW))
    assert {lamp["state"] for lamp in found.values()} == {"unknown"}
    answers = stats(well()), states(), outputs(output(1))
    found = lit(lamps.look(*answers, NOW + 1))
    assert {lamp["state"] for lamp in found.values()} == {"good"}
    assert {lamp["since"] for lamp in found.values()} == {NOW + 1}
    found = lit(lamps.look(*answers, NOW + 2 + OLD_S))
    assert {lamp["state"] for lamp in found.values()} == {"unknown"}
    names(found["timing"]["text"], "has not answered for 7 s")


def test_answers_of_another_version_are_unknown() -> None:
    found = lit(Lamps().look({"bus": "x"}, {"slaves": [{}]}, {"outputs": 3}, NOW))
    assert {lamp["state"] for lamp in found.values()} == {"unknown"}
    names(found["outputs"]["text"], "makes no sense")


def test_a_slave_that_is_not_in_op() -> None:
    ill = {**row(1, 2), "text": "PREOP: no valid inputs", "since": NOW - 60}
    found = look(slaves=states(row(0), ill))
    lamp = found["slaves_in_op"]
    assert (lamp["state"], lamp["since"]) == ("bad", NOW - 60)
    assert lamp["evidence"] == {"panel": "topology", "slave": 1}
    names(lamp["text"], "1 of 2 slaves in OP", "slave 1 (EL1)", "no valid inputs")
    assert found["number_of_slaves"]["state"] == "good"
    assert look_at(states(row(0), ill)).problems[0] in lamp["text"]
    damaged = {**row(1), "recovery": "damaged", "recovery_text": "its EEPROM is damaged"}
    found = look(slaves=states(row(0), damaged))
    assert found["slaves_in_op"]["state"] == "warning"


def test_a_slave_that_is_missing() -> None:
    found = look(slaves=states(row(0), row(1, 0)))
    names(found["number_of_slaves"]["text"], "1 of 2 slaves answer", "slave 1 (EL1) is missing")
    assert found["number_of_slaves"]["state"] == "bad"
    found = look(slaves=states(row(0), others="a device behind slave 0 is no slave of the bus"))
    assert found["number_of_slaves"]["state"] == "warning"
    at_start = states(row(0), missing=[{"expected": [1, 2], "text": "slaves 1 and 2 are missing"}])
    found = look(slaves=at_start)
    names(found["number_of_slaves"]["text"], "1 of 3 slaves answer", "slaves 1 and 2 are missing")
    assert found["slaves_in_op"]["text"] == "1 of 3 slaves in OP"
    assert found["slaves_in_op"]["state"] == "bad"


def test_without_a_link_nothing_is_known_of_slaves() -> None:
    link = Fault("link", "eth1: no carrier", since=NOW - 9, interface="eth1", blinds=True)
    found = look(slaves=states(row(0, 0), row(1, 0), faults=(link,)))
    assert (found["link"]["state"], found["link"]["text"]) == ("bad", "Eth1: no carrier")
    assert found["link"]["since"] == NOW - 9
    assert found["slaves_in_op"]["state"] == found["number_of_slaves"]["state"] == "unknown"
    ring = Fault("ring", "the ring is open between slaves 0 and 1")
    assert look(slaves=states(faults=(ring,)))["link"]["state"] == "warning"
    lost = replace(well(), links=(shm.Link.NO_CARRIER, shm.Link.UP))
    found = lit(Lamps().look(stats(lost), None, None, NOW))
    names(found["link"]["text"], "no carrier")
    cables = [{"slave": 1, "before": 0, "verdict": "strained"}]
    lamp = look(slaves=states(cables=cables))["link"]
    assert lamp["state"] == "warning"
    names(lamp["text"], "Strained cable between slave 0", "and slave 1", "reseat or replace it")


def test_a_drive_in_fault_is_in_op() -> None:
    drive = Fault("drive", "slave 1 (EL1): the drive reports a fault", NOW - 3, slaves=(1,))
    found = look(slaves=states(faults=(drive,)))
    lamp = found["slaves_in_op"]
    assert (lamp["state"], lamp["since"], lamp["evidence"]["slave"]) == ("bad", NOW - 3, 1)
    names(lamp["text"], "2 of 2 slaves in OP, but slave 1 (EL1)", "reports a fault")
    assert found["link"]["state"] == "good"


def test_a_main_process_that_hangs_leaves_nothing_good_about_slaves() -> None:
    found = look(slaves=states(service_silent_s=30.0))
    assert found["slaves_in_op"]["state"] == found["number_of_slaves"]["state"] == "unknown"
    names(found["slaves_in_op"]["text"], "hung for 30 s", "restart ecatd")


def test_lost_frames_are_a_warning_for_a_minute_and_remembered() -> None:
    lamps = Lamps()

    def at(seconds: float, **counters: int) -> dict[str, Lamp]:
        made = stats(well(10 + int(seconds), **counters))
        return lit(lamps.look(made, states(), None, NOW + seconds))

    assert at(0, lost=7)["frames_lost"]["text"] == "7 lost since the start"
    few = at(5, lost=8, missed=1)
    assert few["frames_lost"]["state"] == few["timing"]["state"] == "good", "that is no reason"
    names(few["frames_lost"]["text"], "1 of 5000 frames lost")
    lamp = at(10, lost=11, wkc_bad=4, missed=4)["frames_lost"]
    assert (lamp["state"], lamp["since"]) == ("warning", NOW + 10)
    names(lamp["text"], "4 of 10000 frames lost in the last 10 s", "400 of a million")
    found = at(40, lost=11, wkc_bad=4, missed=4)
    assert found["working_counter"]["state"] == "good", "lost frames have a lamp of their own"
    assert found["timing"]["state"] == "warning"
    names(found["timing"]["text"], "4 of 40004 cycles missed")
    found = at(11 + WINDOW_S, lost=11, wkc_bad=4, missed=4)
    lamp = found["frames_lost"]
    assert (lamp["state"], lamp["since"]) == ("good", NOW + 11 + WINDOW_S)
    names(lamp["text"], "None lost in the last", "11 since the start, last at ")
    assert found["working_counter"]["state"] == found["timing"]["state"] == "good"
    again = replace(well(1, lost=1), instance=5)
    lamp = lit(lamps.look(stats(again), states(), None, NOW + 200))["frames_lost"]
    assert lamp["text"] == "1 lost since the start"


@pytest.mark.parametrize(
    ("kind", "lamp"),
    [(WORKING_COUNTER, "working_counter"), (LOST, "frames_lost"), ("clock", "timing")],
)
def test_faults_of_the_exchange_are_told_in_the_words_of_the_daemon(kind: str, lamp: str) -> None:
    fault = Fault(kind, "something is wrong", since=NOW - 3, share=0.5, slaves=(1,))
    found = look(slaves=states(faults=(fault,)))[lamp]
    assert (found["state"], found["since"]) == ("bad", NOW - 3)
    assert found["text"] == "Something is wrong (slave 1 (EL1))"
    assert found["evidence"]["slave"] == 1


def test_timing() -> None:
    slow = well()
    slow = replace(slow, times={**slow.times, "cycle": histogram([950_000] * 100)})
    found = look(slow)["timing"]
    assert found["state"] == "warning"
    names(found["text"], "of 1000 µs")
    stands = replace(well(), cycle_end_ns=5 * 10**9)
    found_all = look(stands)
    assert found_all["timing"]["state"] == "bad"
    names(found_all["timing"]["text"], "the exchange stands still")
    assert found_all["frames_lost"]["state"] == "unknown"
    stopped = look(replace(well(), state=shm.BusState.STOPPING))
    assert stopped["timing"]["text"] == "The daemon is stopping"


def test_outputs() -> None:
    free = look(driven=outputs(output(1, -1)))["outputs"]
    assert (free["state"], free["text"]) == (
        "good",
        "Nobody drives the 1 outputs, so they are safe",
    )
    lapsed = output(2, -1, cause="lapsed", reason="controller was silent for too long")
    lamp = look(driven=outputs(output(1), lapsed))["outputs"]
    assert (lamp["state"], lamp["since"], lamp["evidence"]["slave"]) == ("bad", NOW - 5, 1)
    names(lamp["text"], "1 of 2 outputs are safe", "1/0x7000:02", "silent for too long")
    lamps, driven = Lamps(), outputs(output(1), lapsed)
    driven["owners"].append({"name": "press", "pid": 7, "state": "lapsed"})
    text = lit(lamps.look(None, None, driven, NOW))["outputs"]["text"]
    assert text.startswith("Press (process 7) gives no sign of life: 1 of 2 outputs are safe")
    again = lit(lamps.look(None, None, outputs(output(1), output(2)), NOW + 4))["outputs"]
    assert again["state"] == "good"
    names(again["text"], "drives 2 of 2 outputs; until ", "press (process 7) gives no sign of life")
    assert look(driven=outputs())["outputs"]["text"] == "The bus has no outputs"
    part = look(driven=outputs(output(1), output(2, -1), output(3, -1, state="copied")))["outputs"]
    names(part["text"], "drives 1 of 3 outputs", "1 are copied from inputs; 1 are safe")
