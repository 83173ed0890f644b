"""What is wrong with a bus: counters over a window, interfaces, and how both are told."""

from dataclasses import replace
from typing import Any

from conftest import names
from ecatd.description.bus import Bus
from ecatd.etg.al import AlState
from ecatd.linux.interface_state import LEAST_MTU, InterfaceState, read_interfaces, remarks
from ecatd.operations.faults import LATE, LOST, UNSENT, WORKING_COUNTER, Fault
from ecatd.operations.health import look_at
from ecatd.server.watch.exchange import Counts, Window, is_well
from ecatd.server.watch.suspects import Finding, are_damaged

LIMIT = 0.01


def test_failures_of_several_kinds_can_spoil_all_exchanges() -> None:
    assert Counts(100, wrong=97, lost=3, late=3, failed=100).none_succeeds
    assert not Counts(100, wrong=97, lost=2, late=2, failed=99).none_succeeds
    both = Counts(
        100, lost=100, failed=50
    )  # two frames in an exchange, both lost in every other one
    assert both.share(LOST) == 1.0
    assert not both.none_succeeds
    assert not Counts().none_succeeds


def test_a_window_forgets_what_is_older() -> None:
    window = Window(Counts(), 0.0)
    assert window.add(Counts(100, lost=50), 1.0, 5.0) == (Counts(100, lost=50), 1.0)
    for second in range(2, 6):
        window.add(Counts(100 * second, lost=50), float(second), 5.0)
    assert window.add(Counts(600, lost=50), 6.0, 5.0) == (Counts(500, lost=0), 5.0)
    # Counters that begin again are no failures, and none are missed.
    assert window.add(Counts(3, lost=1), 7.0, 5.0)[0].lost == 0


def test_a_fault_begins_at_the_limit_and_ends_below_half_of_it() -> None:
    def well(failures: int, *, before: bool) -> bool:
        return is_well(Counts(1000, wrong=failures), WORKING_COUNTER, LIMIT, before=before)

    assert well(9, before=True)
    assert not well(10, before=True)
    assert not well(9, before=False)
    assert not well(5, before=False)
    assert well(4, before=False)
    # One or two failures of a slow domain are an accident, unless nothing succeeds.
    assert is_well(Counts(10, lost=2), LOST, LIMIT, before=True)
    assert not is_well(Counts(2, lost=2), LOST, LIMIT, before=True)
    # Where nothing is exchanged, nothing is learnt.
    assert is_well(Counts(), UNSENT, LIMIT, before=True)
    assert not is_well(Counts(), UNSENT, LIMIT, before=False)


def test_each_kind_of_failure_has_its_own_count() -> None:
    counts = Counts(100, wrong=1, lost=30, late=20, unsent=4)
    assert [counts.of(kind) for kind in (WORKING_COUNTER, LOST, LATE, UNSENT)] == [1, 10, 20, 4]
    assert Counts(10, lost=40).share(LOST) == 1.0


def row(position: int, state: int = AlState.OP) -> dict[str, Any]:
    return {
        "position": position,
        "name": f"EL{position}",
        "al_state": state,
        "text": "OP" if state else "no answer",
        "recovery": "" if state else "missing",
    }


def test_a_fault_of_the_interface_is_none_of_slaves() -> None:
    link = Fault("link", "eth1: no carrier", interface="eth1", blinds=True)
    lost = Fault(LOST, "domain 0: nothing comes back", domain=0, share=1.0, none_succeeds=True)
    faults = [fault.to_map() for fault in (link, lost)]
    found = look_at({"slaves": [row(0, 0), row(1, 0)], "faults": faults})
    assert found.problems == ["eth1: no carrier"]
    assert found.is_down
    assert found.counts == "0 of 2 slaves in OP"


def test_a_slave_that_is_not_well_explains_the_counter_and_another_does_not() -> None:
    wrong = Fault(
        WORKING_COUNTER, "domain 1: wrong", domain=1, share=1.0, none_succeeds=True, slaves=(1,)
    )
    reply = {"slaves": [row(0), row(1, 0)], "faults": [wrong.to_map()]}
    (text,) = look_at(reply).problems
    names(text, "slave 1 (EL1)", "no answer", "domain 1", "wrong working counter")
    assert not look_at(reply).is_down, "the other slave works"
    in_op = look_at({"slaves": [row(0), row(1)], "faults": [wrong.to_map()]})
    assert in_op.problems == ["domain 1: wrong"]
    assert in_op.is_down, "no exchange succeeds, whatever the slaves say"
    half = replace(wrong, share=0.5, none_succeeds=False).to_map()
    assert not look_at({"slaves": [row(0), row(1)], "faults": [half]}).is_down


def test_what_is_wrong_with_an_interface() -> None:
    card = InterfaceState("eth1", speed=100, duplex="full")
    assert not list(remarks(card))
    for state, topic, is_fault, words in (
        (replace(card, mtu=LEAST_MTU - 1), "mtu", True, ("1499", "ip link set eth1 mtu 1500")),
        (replace(card, duplex="half"), "duplex", True, ("half duplex",)),
        (replace(card, speed=10), "speed", True, ("10 Mbit/s", "100")),
        (replace(card, speed=1000), "speed", False, ("1000 Mbit/s", "switch")),
        (replace(card, master="br0"), "bridge", True, ("br0", "nomaster")),
        (replace(card, above=("eth1.5",)), "vlan", True, ("eth1.5",)),
        (replace(card, kind="vlan", below="eth0"), "vlan", True, ("a vlan on eth0",)),
        (replace(card, kind="bond"), "bridge", True, ("bond",)),
        (replace(card, merges=True), "offload", False, ("lro off",)),
    ):
        (remark,) = remarks(state)
        assert (remark.topic, remark.is_fault) == (topic, is_fault)
        names(str(remark), *words)
    # What a virtual interface says of its speed is invented.
    assert not list(remarks(replace(card, kind="veth", speed=10, duplex="half")))


def test_the_kernel_is_asked_for_interfaces() -> None:
    (loopback,) = read_interfaces(["lo", "no such interface"])
    assert loopback.name == "lo"
    assert loopback.mtu >= LEAST_MTU


def test_counters_that_no_device_makes_are_those_of_damaged_frames() -> None:
    assert are_damaged([8192])
    assert are_damaged([4, -2, 64])
    assert not are_damaged([1, 1, 1]), "another device adds the same each time"
    assert not are_damaged([-1, -2, -3]), "slaves come and go"
    assert not are_damaged([])
    text = Finding((), (), damaged=True).text(Bus("b", 1000, []), 64)
    names(text, "damaged frames", "`ecatctl errors`", "another device")
    assert text.index("damaged") < text.index("another device")
