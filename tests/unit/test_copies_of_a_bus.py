"""`[[copy]]` on a bus: which raw number an output gets, and what is refused."""

import math
import tomllib

import pytest

from conftest import names, naming
from ecatd.base.errors import ConfigError
from ecatd.config import ABSENT, Config, CopyConfig, SafeConfig, read_config
from ecatd.config.resolve.copies import Copy, find_copies
from ecatd.config.resolve.safe import safe_outputs
from ecatd.config.writer import write_config
from ecatd.description.bus import Bus, Slave
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo

KINDS = {
    1: (DataType.INTEGER16, 16),
    2: (DataType.UNSIGNED16, 16),
    3: (DataType.REAL32, 32),
    4: (DataType.BIT4, 4),
    5: (DataType.WORD, 16),
    6: (DataType.OCTET_STRING, 16),
    7: (DataType.OCTET_STRING, 256),
}
SCALES = {"V": (0.01, 5.0), "mV": (2.0, 100.0)}


def entries(index: int) -> list[Entry]:
    """One entry of each type, and numbers in V and mV."""
    plain = [Entry(index, sub, "", kind, bits) for sub, (kind, bits) in KINDS.items()]
    scaled = [
        Entry(index, 0x10 + n, "", DataType.INTEGER16, 16, unit, scale, offset)
        for n, (unit, (scale, offset)) in enumerate(SCALES.items())
    ]
    return plain + scaled


def made_bus() -> Bus:
    sensor = Slave(0, "S", 1, 2, 3, inputs=[Pdo(0x1A00, "", 3, entries(0x6000))])
    words = [
        Entry(0x6000 + 0x800 * axis + offset, 0, "", DataType.UNSIGNED16, 16)
        for axis in range(2)
        for offset in (0x40, 0x71)
    ]
    words.append(Entry(0x2000, 0, "", DataType.UNSIGNED16, 16))
    status = [Entry(0x6841, 0, "", DataType.UNSIGNED16, 16)]
    drive = Slave(
        1,
        "D",
        1,
        2,
        3,
        outputs=[Pdo(0x1600, "", 2, entries(0x7000) + words)],
        inputs=[Pdo(0x1A00, "", 3, status)],
    )
    return Bus("b", 1000, [sensor, drive])


def tokens_of(text: str) -> str:
    return naming(*text.split(" | "))


def copied(source: int, target: int, bus: Bus | None = None, **more: float) -> Copy:
    rule = CopyConfig(1, f"0x7000:{target:02X}", 0, f"0x6000:{source:02X}", **more)
    [copy] = find_copies(bus or made_bus(), [rule], [], [])
    return copy


@pytest.mark.parametrize(
    ("source", "target", "more", "raw"),
    [
        (1, 2, {}, 300),  # two numbers without a meaning
        (1, 3, {}, 300),
        (4, 4, {}, 300),
        (5, 2, {}, 300),  # bits of the same number
        (0x10, 0x10, {}, 300),
        (0x10, 1, {"factor": 1.0}, 8),  # 300 * 0.01 + 5 V, and no meaning: the number of volts
        (0x10, 0x11, {"factor": 1000.0}, (8000 - 100) / 2),
        (0x10, 0x11, {"factor": 1000.0, "offset": 50.0}, (8050 - 100) / 2),
        (0x10, 0x10, {"offset": -1.0}, 200),
        (1, 1, {"factor": -0.5, "offset": 3}, -147),
    ],
)
def test_the_physical_value_stays_the_same(
    source: int, target: int, more: dict[str, float], raw: float
) -> None:
    copy = copied(source, target, **more)
    assert math.isclose(300 * copy.factor + copy.offset, raw)


@pytest.mark.parametrize(
    ("source", "target", "more", "tokens"),
    [
        (0x20, 1, {}, "slave 0 | no input 0x6000:20 | ecatctl pdos 0"),
        (1, 0x20, {}, "slave 1 | no output 0x7000:20 | ecatctl pdos 1"),
        (7, 7, {}, "0x7000:07 | slave 1 (D) | 256 bits | at most 64 | remove"),
        (4, 2, {}, "0x6000:04 of slave 0 | 0x7000:02 of slave 1 | BIT4 | 4 bits | correct"),
        (1, 6, {}, "0x7000:06 | OCTET_STRING | not a number"),
        (5, 1, {}, "WORD | without sign"),
        (5, 5, {"factor": 2.0}, "WORD | no factor"),
        (0x10, 0x11, {}, "the input is in V, the output in mV | factor ="),
        (0x10, 1, {}, "the input is in V, the output a number without a unit | factor ="),
        (0x10, 0x11, {"offset": 1.0}, "factor ="),
        (0x10, 0x10, {"factor": 1e308, "offset": 1.0}, "inf"),
    ],
)
def test_what_does_not_fit_is_refused(
    source: int, target: int, more: dict[str, float], tokens: str
) -> None:
    with pytest.raises(ConfigError, match=tokens_of(tokens)):
        copied(source, target, **more)


def test_inputs_and_outputs_are_told_apart() -> None:
    bus = made_bus()
    for rule, tokens in (
        (CopyConfig(0, "0x6000:01", 0, "0x6000:02"), "slave 0 | no output 0x6000:01 | an input"),
        (CopyConfig(1, "0x7000:01", 1, "0x7000:02"), "slave 1 | no input 0x7000:02 | an output"),
    ):
        with pytest.raises(ConfigError, match=tokens_of(tokens)):
            find_copies(bus, [rule], [], [])


def test_a_stop_wins_on_its_own_axis_only() -> None:
    bus = made_bus()
    rule = SafeConfig(slave=1, value="quick_stop", entry="0x6840:00")
    stops = safe_outputs(bus, [rule]).stops

    def stop_of(entry: str) -> int | None:
        [copy] = find_copies(bus, [CopyConfig(1, entry, 0, "0x6000:02")], stops, [])
        return copy.stop and copy.stop.controlword

    assert stop_of("0x6871:00") == 0x6840
    assert [stop_of(entry) for entry in ("0x6071:00", "0x6040:00", "0x2000:00")] == [None] * 3
    with pytest.raises(
        ConfigError, match=tokens_of("0x6840:00 of slave 1 | [[outputs.safe]] | remove one")
    ):
        stop_of("0x6840:00")


def test_a_slave_in_doubt_does_not_keep_the_bus_from_its_start() -> None:
    bus = made_bus()
    here, gone = CopyConfig(1, "0x7000:01", 0, "0x6000:01"), CopyConfig(1, "0x7000:02", 0, "0x1:1")
    absent, lost = CopyConfig(1, "0x7000:03", ABSENT, "0x1:1"), CopyConfig(1, "0x1:1", 0, "0x1:1")
    copies = find_copies(bus, [here, gone, absent], [], [0])
    assert [copy.target for copy in copies] == [(1, 0x7000, 1), (1, 0x7000, 2), (1, 0x7000, 3)]
    assert [copy.source for copy in copies] == [(0, 0x6000, 1), None, None]
    names(copies[1].missing, "0x1:1", "slave 0 (S)", "0x7000:02", "slave 1 (D)", "[[copy]]")
    names(copies[2].missing, "0x7000:03", "slave 1 (D)", "[[copy]]")
    assert not copies[0].missing
    assert not find_copies(bus, [lost], [], [0, 1])


def test_a_written_configuration_has_the_same_copies() -> None:
    copies = [
        CopyConfig(1, "0x7000:01", 0, "0x6000:01", -2.0, 0.5),
        CopyConfig(1, "0x0001:02", 0, "0x0003:04"),
    ]
    text = write_config(Config(copy=copies), made_bus(), "1.0")
    assert read_config(tomllib.loads(text)).copy == copies
    assert 'from_slave = "S"' in text
