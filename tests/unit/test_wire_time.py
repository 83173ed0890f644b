"""The time of the frames on the wire, with the sums of ETG.1000.2 and IEEE 802.3 done by hand."""

from math import lcm

import pytest
from hypothesis import given
from hypothesis import strategies as st

from conftest import names, naming
from ecatd.base.errors import StateError
from ecatd.master.engine.process_image import DOMAIN_DATAGRAM_MAX, LRW, Datagram, DomainImage, Image
from ecatd.server.start.wire_time import WireTime, wire_time


def image(*lengths: int) -> Image:
    """One domain with datagrams of these lengths."""
    return Image([DomainImage(0, 0, datagrams=[Datagram(LRW, 0, n, 1) for n in lengths])])


def cycle(cycle_us: int, slaves: int, *lengths: int, clock: bool = False) -> WireTime:
    return wire_time(image(*lengths), cycle_us, slaves, clock=clock)


def test_a_short_frame_is_padded() -> None:
    # 14 + 2 + 14 of the status are less than 60; with 8 + 4 + 12 around them 84 bytes of 80 ns.
    alone = cycle(1000, 3)
    assert (alone.frames, alone.wire_bytes, alone.frames_us) == (1, 84, 6.72)
    assert alone.round_trip_us == 9.72
    # The clock's datagram has 20 bytes, and a byte of process data 13: 14 + 2 + 47 = 63.
    assert cycle(1000, 3, 1, clock=True).wire_bytes == 63 + 24


def test_eight_slaves_of_64_bytes() -> None:
    time = cycle(1000, 8, 512)
    assert time.wire_bytes == 8 + 14 + 2 + (12 + 2) + (12 + 512) + 4 + 12
    assert time.frames_us == pytest.approx(46.24)
    assert time.round_trip_us == pytest.approx(54.24)
    assert time.shortest_cycle_us() == 61
    assert time.check() == ""


def test_a_full_datagram_fills_the_first_frame_to_the_last_byte() -> None:
    time = cycle(1000, 1, DOMAIN_DATAGRAM_MAX, clock=True)
    assert (time.frames, time.wire_bytes) == (1, 8 + 1514 + 4 + 12)
    assert cycle(1000, 1, DOMAIN_DATAGRAM_MAX + 1, clock=True).frames == 2


def test_the_last_piece_of_split_outputs_leaves_when_the_others_are_back() -> None:
    parts = [Datagram(LRW, 0, 1452, 2, -1, 1), Datagram(LRW, 1452, 8, 2, -1, 1, closes=True)]
    split = wire_time(Image([DomainImage(0, 0, datagrams=parts)]), 1000, 5, clock=True)
    assert (split.frames, split.delay_ns) == (2, 2 * 5000)
    assert split.wire_bytes == 8 + 1514 + 4 + 12 + 84


def test_domains_are_due_together() -> None:
    slow = DomainImage(1, 0, divider=10, datagrams=[Datagram(LRW, 0, 1000, 1)])
    both = Image([*image(1000).domains, slow])
    assert wire_time(both, 1000, 1, clock=False) == cycle(1000, 1, 1000, 1000)
    assert cycle(1000, 1, 1000, 1000).frames == 2


def domains(*turns: tuple[int, int, int]) -> Image:
    """Domains with one datagram each: divider, phase, length."""
    return Image(
        [
            DomainImage(n, 0, divider=divider, phase=phase, datagrams=[Datagram(LRW, 0, length, 1)])
            for n, (divider, phase, length) in enumerate(turns)
        ]
    )


def test_domains_with_phases_take_turns() -> None:
    slow = domains((1, 0, 100), (4, 0, 1000), (4, 2, 1200), (2, 1, 300))
    assert wire_time(slow, 1000, 1, clock=False) == WireTime(1000, 1, 2, 1300, 1378, 1000)
    # Dividers without a common divisor meet whatever their phases are.
    assert wire_time(domains((3, 1, 100), (4, 2, 200)), 1000, 1, clock=False).data_bytes == 300


def test_phases_are_proposed_where_they_help() -> None:
    with pytest.raises(StateError) as caught:
        wire_time(domains((1, 0, 1000), (4, 0, 1000), (6, 2, 1000)), 200, 1, clock=False).check()
    names(caught.value, "fewer PDOs", "domains 1, 2", "phases")
    with pytest.raises(StateError) as caught:
        wire_time(domains((1, 0, 1000), (4, 0, 1000), (5, 2, 1000)), 200, 1, clock=False).check()
    names(caught.value, "fewer PDOs")
    assert "phases" not in str(caught.value)


@st.composite
def turns(draw: st.DrawFn) -> list[tuple[int, int, int]]:
    dividers = draw(st.lists(st.integers(1, 12), min_size=1, max_size=6))
    return [
        (divider, draw(st.integers(0, divider - 1)), draw(st.integers(1, 1452)))
        for divider in dividers
    ]


@given(turns())
def test_the_longest_cycle_is_that_of_all_cycles(turns: list[tuple[int, int, int]]) -> None:
    longest = 0
    for number in range(lcm(*(divider for divider, _, _ in turns))):
        due = [(1, 0, length) for divider, phase, length in turns if number % divider == phase]
        longest = max(longest, wire_time(domains(*due), 1000, 1, clock=True).wire_bytes)
    assert wire_time(domains(*turns), 1000, 1, clock=True).wire_bytes == longest


def test_measured_delays_take_the_place_of_the_estimate() -> None:
    assert wire_time(image(8), 1000, 100, clock=False, delay_ns=71_500).delay_ns == 71_500
    assert cycle(1000, 100, 8).delay_ns == 100_000


def test_more_than_the_wire_allows_is_refused_with_the_arithmetic() -> None:
    # 199 slaves of 32 + 32 bytes: 8 datagrams of 45 halves and one of 38.
    with pytest.raises(StateError) as caught:
        cycle(1000, 199, *[1440] * 8, 1216).check()
    text = str(caught.value)
    names(text, "12736 bytes", "9 frames", "13218 bytes")
    names(text, "1057.4 µs", "100 Mbit/s", "1000 µs")
    # (1057.44 + 199) / 0.9
    names(text, "cycle_time_us", 1397, "fewer PDOs")


def test_a_cycle_too_short_for_the_way_through_the_slaves_is_refused() -> None:
    with pytest.raises(StateError) as caught:
        cycle(200, 150, 512).check()
    names(caught.value, "cycle time too short", "512 bytes", "1 frame", "578 bytes", "46.2 µs")
    names(caught.value, "150.0 µs", "196.2 µs", "200 µs", "cycle_time_us", 219)
    assert cycle(219, 150, 512).check() != ""


def test_above_four_fifths_there_is_a_warning() -> None:
    assert cycle(246, 150, 512).check() == ""
    warning = cycle(240, 150, 512).check()
    names(warning, "little room", "240 µs", "cycle_time_us", 246)


def test_what_the_engine_has_no_room_for_is_refused() -> None:
    with pytest.raises(StateError, match=naming("engine", "65 frames")):
        cycle(1_000_000, 1, *[DOMAIN_DATAGRAM_MAX] * 65).check()
    with pytest.raises(StateError, match=naming("255 datagrams")):
        cycle(1_000_000, 1, *[10] * 255).check()
    assert cycle(1_000_000, 1, *[DOMAIN_DATAGRAM_MAX] * 64).check() == ""


@given(
    st.lists(st.integers(1, DOMAIN_DATAGRAM_MAX), max_size=60), st.booleans(), st.integers(1, 200)
)
def test_what_is_said_to_work_works(lengths: list[int], clock: bool, slaves: int) -> None:
    time = cycle(1_000_000, slaves, *lengths, clock=clock)
    framing = 12 * (len(lengths) + 1) + 2 + (20 if clock else 0)
    least = sum(lengths) + framing + time.frames * (14 + 2 + 8 + 4 + 12)
    assert least <= time.wire_bytes <= least + 44  # only the last frame can be a short one
    assert time.frames >= -(-(sum(lengths) + framing) // 1498)
    shortest = time.shortest_cycle_us()
    cycle(shortest, slaves, *lengths, clock=clock).check()
    with pytest.raises(StateError):
        cycle(shortest - 1, slaves, *lengths, clock=clock).check()
