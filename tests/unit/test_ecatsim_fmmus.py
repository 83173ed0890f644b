"""What slave controllers do not allow of FMMUs (Beckhoff, ESC data sheet, section I)."""

from collections.abc import Iterator

import pytest
from test_ecatsim_frames import APRW, BRW, FPRW, LRD, LRW, LWR, logical, send, set_fmmu, set_sm

from ecatsim.chip import Chip
from ecatsim.esc import Segment
from ecatsim.slave.sii import Description, build

READ, WRITE = 1, 2
BYTES, BITS = (0, 7, 0), (0, 3, 0)
MEMORY, DIGITAL_OUTPUTS = 0x1000, 0x0F00


def one(chip: Chip) -> Segment:
    segment = Segment()
    segment.add(chip, build(Description(1, 2, 3, pdi_control=5)))
    return segment


@pytest.fixture
def segment() -> Iterator[Segment]:
    made = one(Chip())
    yield made
    made.close()


@pytest.mark.parametrize("kind", [READ, WRITE])
@pytest.mark.parametrize(("first", "second"), [(BITS, BITS), (BITS, BYTES), (BYTES, (4, 7, 0))])
@pytest.mark.parametrize("free", [0, 1, 2, 3, 4])
def test_bits_need_three_free_bytes(
    segment: Segment,
    kind: int,
    first: tuple[int, int, int],
    second: tuple[int, int, int],
    free: int,
) -> None:
    """Between two FMMUs of a direction, if one of them maps bits, whatever their numbers."""
    for low, high in ((0, 1), (1, 0)):
        set_fmmu(segment, 0, low, 0x100, 1, first, MEMORY, kind)
        set_fmmu(segment, 0, high, 0x101 + free, 1, second, MEMORY + 16, kind)
        answers = [logical(segment, LRW, at, bytes(1))[1] for at in (0x100, 0x101 + free)]
        counts = kind if free >= 3 else 0
        assert answers == [counts, counts]
        assert segment.refused_fmmus(0) == ([] if counts else [0, 1])


def test_bytes_need_no_free_bytes(segment: Segment) -> None:
    for number in range(4):
        set_fmmu(segment, 0, number, 2 * number, 2, BYTES, MEMORY + 16 * number, WRITE)
    assert send(segment, LWR, 0, 0, b"aAbBcCdD")[1] == 1
    found = [bytes(segment.read(0, MEMORY + 16 * number, 2)) for number in range(4)]
    assert found == [b"aA", b"bB", b"cC", b"dD"]


def test_the_other_direction_may_be_near(segment: Segment) -> None:
    set_fmmu(segment, 0, 0, 0, 1, BITS, DIGITAL_OUTPUTS, WRITE)
    set_fmmu(segment, 0, 1, 0, 1, (4, 7, 0), MEMORY, READ)
    assert send(segment, LRW, 0, 0, bytes(1))[1] == 3


def test_the_fmmu_with_the_lower_number_has_a_byte(segment: Segment) -> None:
    """Where two of a direction map the same logical byte, the other one does without it."""
    set_fmmu(segment, 0, 0, 2, 2, BYTES, MEMORY, WRITE)
    set_fmmu(segment, 0, 1, 0, 6, BYTES, MEMORY + 16, WRITE)
    set_fmmu(segment, 0, 2, 3, 4, BYTES, MEMORY + 32, WRITE)
    assert send(segment, LWR, 0, 0, b"abcdefg")[1] == 1
    assert bytes(segment.read(0, MEMORY, 2)) == b"cd"
    assert bytes(segment.read(0, MEMORY + 16, 6)) == b"ab\0\0ef"
    assert bytes(segment.read(0, MEMORY + 32, 4)) == b"\0\0\0g"
    set_fmmu(segment, 0, 3, 0, 7, BYTES, MEMORY + 16, READ)
    set_fmmu(segment, 0, 4, 1, 1, BYTES, MEMORY, READ)
    assert send(segment, LRD, 0, 0, bytes(7))[0] == b"ab\0\0ef\0"


@pytest.mark.parametrize(
    ("address", "before", "after"), [(DIGITAL_OUTPUTS, 0x05, 0x65), (MEMORY, 0x05, 0x6F)]
)
def test_only_digital_outputs_are_written_bit_by_bit(
    segment: Segment, address: int, before: int, after: int
) -> None:
    """Elsewhere the bits that are not mapped become anything."""
    segment.write(0, address, bytes([before]))
    set_fmmu(segment, 0, 0, 0, 1, (0, 3, 4), address, WRITE)
    assert send(segment, LWR, 0, 0, b"\x06")[1] == 1
    assert segment.read(0, address, 1)[0] == after


def test_bits_of_a_sync_manager(segment: Segment) -> None:
    set_sm(segment, 0, 2, MEMORY, 2, 0x64)
    set_fmmu(segment, 0, 0, 0, 2, (0, 3, 0), MEMORY, WRITE)
    assert send(segment, LWR, 0, 0, b"\x01\x02")[1] == 1
    assert bytes(segment.read(0, MEMORY, 2)) == b"\x01\xf2"


def test_controllers_that_map_bytes_only() -> None:
    segment = one(Chip(map_bits=False))
    assert send(segment, 1, 0, 0x0008, bytes(2))[0][0] & 1
    set_fmmu(segment, 0, 0, 0, 1, (4, 5, 3), MEMORY, WRITE)
    set_fmmu(segment, 0, 1, 1, 1, (0, 2, 0), MEMORY + 16, WRITE)
    assert send(segment, LWR, 0, 0, b"\x5a\xa5")[1] == 1
    assert segment.read(0, MEMORY, 1) + segment.read(0, MEMORY + 16, 1) == b"\x5a\xa5"
    segment.close()


def test_controllers_without_commands_that_read_and_write() -> None:
    segment = Segment()
    for chip in (Chip(read_write=False), Chip(), Chip(read_write=False)):
        segment.add(chip, build(Description(1, 2, 3, pdi_control=5)))
    assert send(segment, 1, 0, 0x0008, bytes(2))[0][1] & 4
    send(segment, 2, 0, 0x0010, b"\x01\x10")
    send(segment, 2, -1, 0x0010, b"\x02\x10")
    answers = [
        send(segment, command, position, MEMORY, bytes(1))[1]
        for command, position in ((APRW, 0), (APRW, -1), (FPRW, 0x1001), (FPRW, 0x1002), (BRW, 0))
    ]
    assert answers == [0, 3, 0, 3, 3]
    assert send(segment, 13, 0, MEMORY, bytes(1))[1] == 3, "ARMW is none of them"
    segment.close()
