"""Where PDOs lie in the bytes of a slave: whole bytes for every sync manager."""

from hypothesis import given
from hypothesis import strategies as st

from ecatd.description.bus import Slave
from ecatd.etg.pdo import Entry, Pdo
from ecatd.etg.pdo_layout import SyncManagerBytes, byte_length, places, sync_manager_bytes


def pdo(sync_manager: int, *bits: int, index: int = 0x1600) -> Pdo:
    entries = [Entry(0x7000, n, "", 0, size) for n, size in enumerate(bits, 1)]
    return Pdo(index, "", sync_manager, entries)


def test_each_sync_manager_begins_at_a_byte() -> None:
    slave = Slave(0, "", 1, 2, 3, outputs=[pdo(0, 1, 1, 1, 1), pdo(1, 1, 1, 2), pdo(3, 12)])
    assert sync_manager_bytes(slave.outputs) == [
        SyncManagerBytes(0, 0, 4),
        SyncManagerBytes(1, 1, 4),
        SyncManagerBytes(3, 2, 12),
    ]
    assert (slave.output_bytes, slave.input_bytes) == (4, 0)
    assert [bit for _, _, bit in slave.entries(outputs=True)] == [0, 1, 2, 3, 8, 9, 10, 16]


def test_pdos_of_one_sync_manager_are_together() -> None:
    """Also where an EEPROM lists them in turns with those of another one."""
    pdos = [pdo(2, 4), pdo(1, 3), pdo(2, 8), pdo(1, 2)]
    assert [(p.sync_manager, entry.bit_length, bit) for p, entry, bit in places(pdos)] == [
        (1, 3, 0),
        (1, 2, 3),
        (2, 4, 8),
        (2, 8, 12),
    ]
    assert byte_length(pdos) == 3


def test_a_sync_manager_without_bits_has_no_bytes() -> None:
    pdos = [pdo(0), pdo(1, 8), pdo(2)]
    assert sync_manager_bytes(pdos) == [SyncManagerBytes(1, 0, 8)]
    assert byte_length([]) == byte_length([pdo(3)]) == 0


@given(st.lists(st.tuples(st.integers(0, 15), st.lists(st.integers(0, 40), max_size=4))))
def test_r11_nothing_overlaps_and_no_byte_is_shared(rows: list[tuple[int, list[int]]]) -> None:
    pdos = [pdo(number, *bits) for number, bits in rows]
    areas = {area.number: area for area in sync_manager_bytes(pdos)}
    bit = 0
    for owner, entry, at in places(pdos):
        assert at >= bit
        bit = at + entry.bit_length
        if entry.bit_length:
            area = areas[owner.sync_manager]
            assert 8 * area.offset <= at < bit <= 8 * area.offset + area.bits
    assert byte_length(pdos) == sum(area.size for area in areas.values()) == (bit + 7) // 8
