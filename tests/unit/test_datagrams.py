"""Batched register access and EEPROMs, with simulated slave controllers at the other end."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from wire_bench import Wire, served

from conftest import naming
from ecatd.base.coroutine_steps import finish
from ecatd.base.errors import StateError
from ecatd.master.engine.process_image import DATAGRAM_MAX
from ecatd.master.frames.datagrams import Datagrams, Station, aprd, apwr, brd, bwr, fprd, fpwr
from ecatd.master.frames.eeprom import read_eeproms, reading_eeproms
from ecatsim.esc import Chip, Segment
from ecatsim.slave.sii import Description, build

PROCESS_MEMORY = 0x1000
HOUR_US = 3_600_000_000
PATIENT = 10.0


@contextmanager
def bus(*chips: Chip, timeout: float = 0.02) -> Iterator[tuple[Datagrams, Segment, Wire]]:
    segment = Segment()
    for position, chip in enumerate(chips):
        segment.add(chip, image(position))
    with served(segment, len(chips), timeout=timeout) as (registers, wire):
        yield registers, segment, wire


def image(position: int) -> bytes:
    return build(Description(0x11, 0x20 + position, 0x33, order="S" * 40, pdi_control=0x0C05))


def test_each_command_reaches_whom_it_should() -> None:
    with bus(Chip(), Chip(), Chip(), timeout=PATIENT) as (registers, _segment, wire):
        answers = registers.exchange(
            [
                bwr(PROCESS_MEMORY, b"\x01"),
                apwr(1, PROCESS_MEMORY, b"\x02"),
                fpwr(0x1003, PROCESS_MEMORY, b"\x04"),
                fprd(0x1002, PROCESS_MEMORY, 1),
                aprd(2, PROCESS_MEMORY, 1),
                brd(PROCESS_MEMORY, 1),
                fprd(0x1009, PROCESS_MEMORY, 1),
            ]
        )
        assert [answer.wkc for answer in answers] == [3, 1, 1, 1, 1, 3, 0]
        assert [answer.data for answer in answers[3:]] == [b"\x02", b"\x04", b"\x07", b"\x00"]
        assert registers.read_all([0x1003, 0x1001], PROCESS_MEMORY, 2) == [
            (b"\x04\x00", 1),
            (b"\x01\x00", 1),
        ]
        assert len(wire.frames) == 2


def test_frames_that_are_lost_together_are_sent_again_in_order() -> None:
    with bus(Chip()) as (registers, _segment, wire):
        wire.lose, wire.unseen = lambda number: number < 3, True
        data = [bytes([value]) * 800 for value in (1, 2, 3)]
        written = registers.exchange([fpwr(0x1001, PROCESS_MEMORY, item) for item in data])
        assert [answer.wkc for answer in written] == [1, 1, 1]
        assert registers.read_all([0x1001], PROCESS_MEMORY, 800) == [(data[-1], 1)]


def test_frames_are_full_and_have_indices_of_their_own() -> None:
    with bus(Chip(), timeout=PATIENT) as (registers, _segment, wire):
        assert registers.exchange([]) == []
        for size, per_frame in ((2, 107), (14, 57), (DATAGRAM_MAX // 2, 1), (DATAGRAM_MAX, 1)):
            wire.frames.clear()
            count = 3 * per_frame + 1
            answers = registers.exchange([fprd(0x1001, PROCESS_MEMORY, size)] * count)
            assert answers == [(bytes(size), 1)] * count
            assert len(wire.frames) == 4
            assert max(map(len, wire.frames)) <= 1514
        with pytest.raises(ValueError, match=naming("1487 bytes")):
            registers.exchange([fprd(0x1001, PROCESS_MEMORY, DATAGRAM_MAX + 1)])
        wire.frames.clear()
        for _ in range(300):
            registers.exchange([brd(0x0130, 2)])
        assert {frame[17] for frame in wire.frames} == set(range(0x80))
        assert {frame[6:12] for frame in wire.frames} == {b"\x02test\x00"}
        assert {len(frame) for frame in wire.frames} == {60}


@pytest.mark.parametrize("unseen", [True, False])
def test_what_is_lost_is_sent_again_and_given_up_in_the_end(unseen: bool) -> None:
    with bus(Chip()) as (registers, _segment, wire):
        wire.unseen = unseen
        wire.lose = lambda number: number % 3 == 1
        writes = [fpwr(0x1001, PROCESS_MEMORY + i, bytes([i & 0xFF])) for i in range(1000)]
        assert [answer.wkc for answer in registers.exchange(writes)] == [1] * 1000
        assert registers.read_all([0x1001], PROCESS_MEMORY, 1000)[0].data == bytes(
            i & 0xFF for i in range(1000)
        )
        wire.frames.clear()
        wire.lose = lambda _number: True
        assert registers.exchange([brd(0x0130, 2)]) == [(bytes(2), 0)]
        assert len(wire.frames) == 3
        wire.frames.clear()
        assert registers.exchange([brd(0x0130, 2)], repeat=False) == [(bytes(2), 0)]
        assert len(wire.frames) == 1, "an access with an effect is not repeated"
        wire.lose = lambda _number: False
        assert registers.exchange([brd(0x0130, 2)])[0].wkc == 1


@pytest.mark.parametrize("loss", [0, 4])
def test_eeproms_of_all_kinds_are_read_at_the_same_time(loss: int) -> None:
    chips = [
        Chip(),
        Chip(eeprom_bytes=4),
        Chip(eeprom_bytes=4, eeprom_read_us=300),
        Chip(eeprom_read_us=2000),
        Chip(ports=3),
    ]
    with bus(*chips) as (registers, _segment, wire):
        if loss:
            wire.lose = lambda number: number % 10 == loss
        stations = [(Station(0x1001 + i), f"slave {i}") for i in range(len(chips))]

        def decode(words: Callable[[int, int], bytes]) -> bytes:
            # Odd addresses, and some that depend on what was read before.
            product = int.from_bytes(words(0x0A, 1), "little")
            return words(product & 1, 3) + words(7, 0x60)

        assert read_eeproms(registers, stations, decode) == [
            image(i)[2 * (i & 1) :][:6] + image(i)[14 : 14 + 0xC0].ljust(0xC0, b"\xff")
            for i in range(len(chips))
        ]
        owners = registers.read_all([slave.address for slave, _ in stations], 0x0500, 1)
        assert [answer.data for answer in owners] == [b"\x01"] * len(chips)


def test_eeproms_that_cannot_be_read_are_named() -> None:
    def decode(words: Callable[[int, int], bytes]) -> bytes:
        if words(0x0A, 1) == b"\x21\x00":
            raise StateError("it makes no sense")
        return words(0, 8)

    with bus(Chip(), Chip(), Chip(eeprom_read_us=HOUR_US)) as (registers, segment, _wire):
        with pytest.raises(StateError, match=naming("B: EEPROM: ", "it makes no sense")):
            read_eeproms(registers, [(Station(0x1001), "A"), (Station(0x1002), "B")], decode)
        with pytest.raises(StateError, match=naming("C: EEPROM: ", "busy", "0.5 s")):
            read_eeproms(registers, [(Station(0x1001), "A"), (Station(0x1003), "C")], decode)
        with pytest.raises(StateError, match=naming("D: EEPROM: ", "answer")):
            read_eeproms(registers, [(Station(0x1001), "A"), (Station(0x1004), "D")], decode)
        with pytest.raises(StateError, match=naming("stopped")):
            read_eeproms(registers, [(Station(0x1001), "A")], decode, lambda: True)
        segment.set_eeprom(0, b"")
        with pytest.raises(StateError, match=r"^A: EEPROM: .* acknowledge .* 0x2\w+\)"):
            read_eeproms(registers, [(Station(0x1001), "A")], decode)
        segment.set_eeprom(0, image(0))
        assert read_eeproms(registers, [(Station(0x1001), "A")], decode) == [image(0)[:16]]


def test_slow_eeproms_let_others_be_read_meanwhile() -> None:
    def words(number: int) -> Callable[[Callable[[int, int], bytes]], bytes]:
        return lambda read: read(0, number)

    with bus(Chip(), Chip(eeprom_read_us=100_000)) as (registers, _segment, _wire):
        slow, silent = (Station(0x1002), "slow"), (Station(0x1009), "silent")
        first = reading_eeproms(registers, [slow], words(8))
        lost = reading_eeproms(registers, [(Station(0x1001), "quick"), silent], words(8))
        next(first)
        next(lost)
        # Those who read the same EEPROM meanwhile give it back to the device.
        assert read_eeproms(registers, [slow], words(4)) == [image(1)[:8]]
        assert read_eeproms(registers, [(Station(0x1001), "quick")], words(4)) == [image(0)[:8]]
        assert finish(first) == [image(1)[:16]]
        with pytest.raises(StateError, match=naming("silent: EEPROM: ", "answer")):
            finish(lost)
        owners = registers.read_all([0x1001, 0x1002], 0x0500, 1)
        assert [answer.data for answer in owners] == [b"\x01"] * 2


def test_a_device_that_keeps_its_eeprom_is_overruled() -> None:
    with bus(Chip()) as (registers, segment, _wire):
        registers.exchange([fpwr(0x1001, 0x0500, b"\x01")])
        segment.write(0, 0x0501, b"\x01")  # the device takes it
        assert read_eeproms(registers, [(Station(0x1001), "A")], lambda words: words(0, 8)) == [
            image(0)[:16]
        ]
