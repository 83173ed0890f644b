"""The first reading of an incident: its chains of causes and consequences."""

from collections.abc import Sequence
from typing import Any

from ecatd.operations.traces import TraceSignal
from ecatd.recorder.incident import Incident, Row, Trigger
from ecatd.recorder.moments import place_events
from ecatd.recorder.reading import read

BEGIN_NS = 1_764_000_000_000_000_000
"""2025-11-24 16:00:00 UTC: cycle 1000; the cycle is 1 ms."""


def event(kind: str, ms: float, text: str, **facts: Any) -> dict[str, Any]:
    return {"event": kind, "time_ns": BEGIN_NS + int(1e6 * ms), "text": text, **facts}


def reading(
    events: Sequence[dict[str, Any]] = (),
    *,
    failing: Sequence[int] = (),
    lost: Sequence[int] = (),
    missing: Sequence[int] = (),
    triggers: Sequence[Trigger] = (),
    count: int = 3000,
) -> list[str]:
    """The lines behind the head."""
    rows = [
        Row(1000 + n, BEGIN_NS + n * 1_000_000, 80.0, int(n in failing or n in lost), [],
            unanswered=int(n in lost))
        for n in range(count)
        if n not in missing
    ]  # fmt: skip
    names = ["EK1100", "EL1018", "EL2008", "EL3008"]
    found = Incident(
        "ecat0", [*triggers] or [Trigger("fault", BEGIN_NS, "x")],
        [], rows, [*events], [], [], [], 0,
        documents={"bus": {"slaves": [{"name": name} for name in names]}},
    )  # fmt: skip
    return read(found)[0].partition("\n\n")[2].splitlines()


def test_a_lost_link_explains_what_was_noticed_before_it() -> None:
    gone = [event("al_state", 508, "no answer", slave=n, al_state=0, al_code=0) for n in (2, 3)]
    fallen = [
        event("recovery", 509, f"slave {n} (X): left OP", slave=n, state="fallen") for n in (2, 3)
    ]
    slaves = event("slaves", 506, "slave count changed from 4 to 2", missing=[2, 3])
    told = event("working_counter", 505, "domain 0: incomplete", state="incomplete", cycle=1500)
    again = event("disturbance", 900, "44 exchanges", counts={"wkc_bad": 44}, over=False)
    late = event("disturbance", 920, "1 missed cycle", counts={"missed": 1}, over=False)
    assert reading([told, slaves, *gone, *fallen, again, late], failing=range(500, 950)) == [
        "16:00:00.500 (cycle 1500) slave count changed from 4 to 2 (noticed 6 cycles later)",
        "  in the same cycle: the working counter was wrong (1 domain)",
        "  8 cycles later: slaves 2 (EL2008) and 3 (EL3008): no answer",
        "  1 cycle later: slaves 2 (EL2008) and 3 (EL3008): left OP",
        "  391 cycles later: 44 exchanges",
        "  20 cycles later: 1 missed cycle",
        "  30 cycles later: the exchanges of all domains are complete again",
    ]


def test_the_time_of_frames_decides_whether_they_are_the_cause() -> None:
    """A slave that gets no data in time leaves OP; one with a fault of its own fails exchanges."""
    text = "SAFEOP with error (AL status 0x{:04X}: …)"
    starved = event("al_state", 620, text.format(0x1B), slave=2, al_state=0x14, al_code=0x1B)
    own = event("al_state", 620, text.format(0x1D), slave=2, al_state=0x14, al_code=0x1D)
    left = event("recovery", 621, "slave 2 (EL2008): left OP", slave=2, state="fallen")
    line, *_ = reading([starved, left], lost=range(500, 600))
    assert line == "16:00:00.500 (cycle 1500) 1 frame did not come back (1 domain)"
    assert reading([own, left], failing=range(500, 600)) == [
        f"16:00:00.500 (cycle 1500) slave 2 (EL2008): {own['text']} (noticed 120 cycles later)",
        "  in the same cycle: the working counter was wrong (1 domain)",
        "  100 cycles later: the exchanges of all domains are complete again",
        "  21 cycles later: slave 2 (EL2008): left OP",
    ]


def test_what_frames_say_again_and_again_is_counted() -> None:
    gone = event("link", 2001, "the interface lost its link", state="down")
    lines = reading([gone], lost=[*range(20, 2000, 20), *range(2002, 3000)])
    assert len(lines) < 8
    assert "1 frame did not come back (1 domain); 98 times more, up to 16:00:01.980" in lines[0]
    assert any("the interface lost its link" in line for line in lines)


def test_causes_that_compete_and_what_is_beside_them() -> None:
    first = event("al_state", 501, "no answer", slave=2, al_state=0, al_code=0)
    own = event("al_state", 502, "SAFEOP with error", slave=3, al_state=0x14, al_code=0x1D)
    assert reading([first, own], failing=range(500, 510))[:4] == [
        "16:00:00.500 (cycle 1500) 2 things may be the cause, and nothing here says which:",
        "  - slave 2 (EL2008): no answer (noticed 1 cycle later)",
        "  - slave 3 (EL3008): SAFEOP with error (noticed 2 cycles later)",
        "  in the same cycle: the working counter was wrong (1 domain)",
    ]
    hot = event("emergency", 490, "slave 3 (EL3008) sent an emergency: 0x4310: too hot", slave=3)
    assert reading([hot, own], failing=range(500, 510))[0] == (
        "16:00:00.490 (cycle 1490) slave 3 (EL3008) sent an emergency: 0x4310: too hot"
    )
    other = event("emergency", 490, "0x4310: too hot", slave=2)
    assert reading([other, own], failing=range(500, 510))[0].endswith("nothing here says which:")
    old = event("cable", 600, "strained cable", slave=3)
    told = event("disturbance", 700, "9 exchanges", counts={"wkc_bad": 9})
    assert reading([own, old, told])[0].endswith("SAFEOP with error")  # the cable is another story
    apart = [
        event("emergency", 100, "overheated", slave=3),
        event("slaves", 2500, "g", missing=[2]),
    ]
    assert [line[0] for line in reading(apart)] == ["1", "1"]


def test_clients_conditions_and_requests() -> None:
    claimed = event("claimed", 499, "'plc' (pid 7) owns outputs of slave 2", slave=2, cycle=1499)
    condition = Trigger(
        "condition", BEGIN_NS + 500_000_000, "2/Out was 1, above 0.5, in cycle 1500"
    )
    assert reading([claimed], triggers=[condition]) == [
        "16:00:00.499 (cycle 1499) 'plc' (pid 7) owns outputs of slave 2",
        "  1 cycle later: 2/Out was 1, above 0.5",
    ]
    facts = {"slave": 2, "reason": "lapsed", "cycle": 1600}
    lapse = event("safe", 610, "outputs of slave 2 are safe: 'plc' hung", **facts)
    stop = event("stopped", 900, "slave 2 was stopped", slave=2, cycle=1890)
    assert reading([claimed, lapse, stop]) == [
        "16:00:00.499 (cycle 1499) 'plc' (pid 7) owns outputs of slave 2",
        "16:00:00.600 (cycle 1600) outputs of slave 2 are safe: 'plc' hung",
        "  290 cycles later: slave 2 was stopped",
    ]
    own = event("incident", 500, "me has asked for an incident", by="me")
    asked = event(
        "change", 500, "an incident: asked for by me", what="an incident", by="me", failed=False
    )
    first, second = reading([own, asked])
    assert first == "No fault of the bus is known: every exchange was complete."
    assert "judged the values" in second


def test_without_frames_times_stand_for_cycles() -> None:
    slaves = event("slaves", 500, "gone", missing=[2])
    left = event("recovery", 540, "slave 2 (EL2008): left OP", slave=2, state="fallen")
    assert reading([slaves, left], count=0) == [
        "16:00:00.500 gone",
        "  40 ms later: slave 2 (EL2008): left OP",
    ]
    assert reading(missing=[500, 501], count=1000) == [
        "16:00:00.500 (cycle 1500) 2 cycles missing: no frame was sent in time",
    ]


def test_events_stand_at_the_values_that_they_are_about() -> None:
    def signal(address: str) -> TraceSignal:
        return TraceSignal(
            name=f"2/{address}", slave=2, address=address, output=False,
            type="uint16", scale=1.0, offset=0.0, unit="",
        )  # fmt: skip

    signals = [signal("0x6041:00"), signal("0x6841:00")]
    statuswords = {n: (0x27, 0x27 if n < 30 else 0x08) for n in range(100)} | {40: (None, None)}
    rows = [
        Row(1000 + n, BEGIN_NS + n * 1_000_000, 80.0, 0, [*statuswords[n]])
        for n in range(100)
        if n not in (50, 51)
    ]
    fault = event("drive", 90, "fault", slave=2, over=False, cycle=1080)
    over = event("drive", 90, "no fault", slave=2, over=True, cycle=1080)
    gone = event("slaves", 95, "gone", missing=[2], cycle=1051)
    later = event("slaves", 95, "gone", missing=[2], cycle=1200)
    unknown = event("emergency", 95, "hot", slave=2)
    found = place_events([fault, over, gone, later, unknown], rows, signals)
    assert [(it.get("cycle"), (it["time_ns"] - BEGIN_NS) / 1e6) for it in found] == [
        (1030, 30), (1080, 80), (1051, 49), (1200, 95), (None, 95),
    ]  # fmt: skip
