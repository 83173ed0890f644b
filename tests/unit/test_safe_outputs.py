"""Safe values and declared ranges, from the configuration to bits and raw numbers."""

import math
from typing import Any

import pytest

from conftest import names, naming
from ecatd.base.errors import ConfigError
from ecatd.config import SafeConfig, SignalConfig
from ecatd.config.meanings import give_meanings, unknown_types
from ecatd.config.profiles import Profiles
from ecatd.config.resolve.safe import SafeOutputs, safe_outputs
from ecatd.description.bus import Bus, Slave
from ecatd.description.bus_reader import read_bus
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatd.operations.encoding import pack, unpack

I8, I16, I32, U16 = (
    DataType.INTEGER8,
    DataType.INTEGER16,
    DataType.INTEGER32,
    DataType.UNSIGNED16,
)
REAL32, REAL64, BIT3 = DataType.REAL32, DataType.REAL64, DataType.BIT3


def entry(index: int, kind: DataType, bits: int, subindex: int = 0) -> Entry:
    return Entry(index, subindex, f"object {index:04X}", kind, bits)


def terminal(position: int = 0) -> Slave:
    """1, 3, 4 and 16 bits, a byte of gap, and two floating-point numbers."""
    entries = [
        *(
            entry(0x7000, kind, bits, sub + 1)
            for sub, (kind, bits) in enumerate(
                ((DataType.BOOLEAN, 1), (BIT3, 3), (DataType.BIT4, 4), (I16, 16))
            )
        ),
        Entry(0, 0, "", 0, 8),
        entry(0x7010, REAL32, 32, 1),
        entry(0x7010, REAL64, 64, 2),
    ]
    return Slave(position, "T", 1, 2, 3, outputs=[Pdo(0x1600, "", 2, entries)])


OUTPUTS = (
    (0x6040, U16, 16),
    (0x6060, I8, 8),
    (0x607A, I32, 32),
    (0x60FF, I32, 32),
    (0x6071, I16, 16),
    (0x6072, U16, 16),
    (0x6083, DataType.UNSIGNED32, 32),
)


def drive(axes: int = 1, position: int = 0, *, status: bool = True) -> Slave:
    """A CiA 402 drive with so many axes, and an output of the vendor."""
    outputs = [
        Pdo(
            0x1600 + 0x10 * axis,
            "",
            2,
            [entry(index + 0x800 * axis, kind, bits) for index, kind, bits in OUTPUTS],
        )
        for axis in range(axes)
    ]
    outputs.append(Pdo(0x1680, "", 2, [entry(0x2000, U16, 16)]))
    inputs = [
        Pdo(0x1A00 + 0x10 * axis, "", 3, [entry(0x6041 + 0x800 * axis, U16, 16)])
        for axis in range(axes if status else 0)
    ]
    return Slave(position, "D", 1, 2, 3, outputs=outputs, inputs=inputs)


def bus(*slaves: Slave) -> Bus:
    return Bus("b", 1000, list(slaves))


def shown(made: Bus, position: int = 0) -> dict[int, Any]:
    """Safe values as the bus description has them, by index."""
    return {e.index: e.safe for _, e, _ in made.slaves[position].entries(outputs=True)}


def image(safe: SafeOutputs, position: int = 0) -> tuple[bytes, bytes]:
    return safe.images[position]


def test_safe_values_reach_the_right_bits() -> None:
    rules = [SafeConfig(0, 5, "0x7000:02"), SafeConfig(0, "hold", "0x7000:04")]
    value, hold = image(safe_outputs(bus(terminal()), rules))
    assert value == bytes([5 << 1]) + bytes(15)
    assert hold == bytes([0, 0xFF, 0xFF]) + bytes(13)
    rules = [SafeConfig(0, "hold"), SafeConfig(0, "zero", "0x7000:01")]
    value, hold = image(safe_outputs(bus(terminal()), rules))
    assert (value, hold) == (bytes(16), b"\xfe" + b"\xff" * 15)


def test_floating_point_outputs_take_fractions() -> None:
    made = bus(terminal())
    rules = [SafeConfig(0, 1.5, "0x7010:01"), SafeConfig(0, -2, "0x7010:02")]
    value, _hold = image(safe_outputs(made, rules))
    assert value[4:] == bytes.fromhex("0000c03f") + bytes.fromhex("00000000000000c0")
    assert [e.safe for _, e, _ in made.slaves[0].entries(outputs=True)] == [0, 0, 0, 0, 1.5, -2.0]


def test_a_drive_is_stopped_and_only_what_moves_it_is_zero() -> None:
    made = bus(drive())
    safe = safe_outputs(made, [SafeConfig(0, "quick_stop")])
    (stop,) = safe.stops
    assert (stop.controlword, stop.statusword, stop.value, stop.timeout) == (
        0x6040,
        0x6041,
        0x0002,
        2.0,
    )
    assert shown(made) == {
        0x6040: "quick_stop",
        0x6060: "hold",
        0x607A: "hold",
        0x60FF: 0,
        0x6071: 0,
        0x6072: "hold",
        0x6083: "hold",
        0x2000: 0,
    }
    assert image(safe)[0] == bytes(made.slaves[0].output_bytes)


def test_one_axis_of_a_drive_is_meant_by_its_controlword() -> None:
    made = bus(drive(2))
    safe = safe_outputs(
        made, [SafeConfig(0, "quick_stop"), SafeConfig(0, "disable", "0x6840:00", 0.5)]
    )
    assert [(s.controlword, s.statusword, s.value, s.timeout) for s in safe.stops] == [
        (0x6040, 0x6041, 0x0002, 2.0),
        (0x6840, 0x6841, 0x0007, 0.5),
    ]
    made = bus(drive(2))
    safe = safe_outputs(made, [SafeConfig(0, "disable", "0x6840:00")])
    assert [s.controlword for s in safe.stops] == [0x6840]
    assert (shown(made)[0x607A], shown(made)[0x687A]) == (0, "hold")


@pytest.mark.parametrize(
    "rule",
    [
        SafeConfig(0, 6, "0x6040:00"),
        SafeConfig(0, "hold", "0x6040:00"),
        SafeConfig(0, "zero"),
    ],
)
def test_no_later_rule_takes_a_stop_away(rule: SafeConfig) -> None:
    """Else the drive would run on, though the configuration says that it is stopped."""
    with pytest.raises(ConfigError, match=naming("slave 0 (D)", '"disable"', "0x6040:00")):
        safe_outputs(bus(drive()), [SafeConfig(0, "disable"), rule])


def test_what_is_no_controlword_can_differ_from_a_stop() -> None:
    made = bus(drive())
    rules = [
        SafeConfig(0, "hold"),
        SafeConfig(0, "quick_stop"),
        SafeConfig(0, 9, "0x6072:00"),
        SafeConfig(0, "disable", "0x6040:00"),
        SafeConfig(0, 7, "0x6083:00"),
    ]
    assert [stop.how for stop in safe_outputs(made, rules).stops] == ["disable"]
    found = shown(made)
    assert (found[0x6040], found[0x6083], found[0x2000]) == ("disable", 7, "hold")
    assert found[0x6072] == "hold", "the later stop has overridden it"


@pytest.mark.parametrize(
    ("rule", "what"),
    [
        (SafeConfig(1, "zero"), "slave 1 (T) | no outputs"),
        (SafeConfig(0, 1, "0x7000:09"), "output | 0x7000:09"),
        (SafeConfig(0, 8, "0x7000:02"), "8 | out of range | 0x7000:02 | 0 | 7"),
        (SafeConfig(0, 1.0, "0x7000:04"), "1.0 | 0x7000:04 | whole numbers"),
        (SafeConfig(0, 1e300, "0x7010:01"), "1e+300 | out of range | 0x7010:01"),
        (SafeConfig(0, "quick_stop"), '"quick_stop" | controlword'),
        (SafeConfig(2, "disable", "0x60FF:00"), "0x60FF:00 | controlword"),
        (SafeConfig(2, "disable", "0x6840:00"), "0x6840:00 | controlword"),
        (SafeConfig(3, "quick_stop"), "statusword | 0x6041:00 | slave 3"),
    ],
)
def test_wrong_safe_values_are_refused(rule: SafeConfig, what: str) -> None:
    inputs_only = terminal(1)
    inputs_only.inputs, inputs_only.outputs = inputs_only.outputs, []
    made = bus(terminal(), inputs_only, drive(1, 2), drive(1, 3, status=False))
    with pytest.raises(ConfigError, match=naming("configuration: ", *what.split(" | "))):
        safe_outputs(made, [rule])


@pytest.mark.parametrize(
    ("declared", "kind", "expected"),
    [
        ({"maximum": 10.0, "scale": 10 / 32767}, I16, (-math.inf, 32767)),
        ({"minimum": -10.0, "maximum": 10.0, "scale": 10 / 32767}, I16, (-32767, 32767)),
        ({"minimum": 0.0, "maximum": 1.0, "scale": 0.3}, I16, (0, 3)),
        ({"minimum": -1.0, "maximum": 2.0, "scale": -1.0, "offset": 1.0}, I16, (-1, 2)),
        ({"minimum": -1.0, "scale": -1.0}, I16, (-math.inf, 1)),
        ({"maximum": 0.1}, REAL32, (-math.inf, pytest.approx(0.1, abs=1e-7))),
        ({"maximum": 1e300}, REAL32, (-math.inf, math.inf)),
        ({"minimum": 0.1}, REAL64, (0.1, math.inf)),
    ],
)
def test_declared_ranges_in_raw_units(
    declared: dict[str, float], kind: DataType, expected: tuple[float, float]
) -> None:
    made = bus(Slave(0, "S", 1, 2, 3, outputs=[Pdo(0x1600, "", 2, [entry(0x7000, kind, 32)])]))
    give_meanings(made, Profiles(), [SignalConfig(0, "0x7000:00", **declared)])
    ((_, found, _),) = made.slaves[0].entries(outputs=True)
    assert found.raw_range() == expected


def test_a_limit_of_a_float_is_a_value_that_can_be_written() -> None:
    """0.1 as a 32-bit number is more than 0.1 as a 64-bit one, and must be allowed."""
    limited = Entry(0x7000, 0, "", REAL32, 32, maximum=0.1)
    assert limited.raw_range()[1] > 0.1


def test_what_the_configuration_says_is_in_the_description() -> None:
    made = bus(drive())
    shared = made.slaves[0].outputs[0]
    give_meanings(
        made,
        Profiles(),
        [
            SignalConfig(0, "0x60FF:00", "speed", "rpm", 0.5, 1.0, -100.0, 100.0),
            SignalConfig(0, "0x6041:00", unit="bits"),
        ],
    )
    found = {e.index: e for _, e, _ in made.slaves[0].entries(outputs=True)}
    assert (found[0x60FF].name, found[0x60FF].unit, found[0x60FF].scale) == ("speed", "rpm", 0.5)
    assert found[0x60FF].raw_range() == (-202, 198)
    assert found[0x6071].name == "object 6071"
    ((_, status, _),) = made.slaves[0].entries(outputs=False)
    assert (status.name, status.unit, status.minimum) == ("object 6041", "bits", None)
    assert {e.name for e in shared.entries} == {f"object {index:04X}" for index, *_ in OUTPUTS}
    assert read_bus(unpack(pack(made.to_dict())), "x") == made


@pytest.mark.parametrize(
    ("rule", "what"),
    [
        (SignalConfig(0, "0x60FE:01"), "slave 0 (D) | 0x60FE:01 | process data"),
        (SignalConfig(0, "0x6041:00", maximum=3.0), "0x6041:00 | input | minimum | maximum"),
        (SignalConfig(0, "0x6040:00", minimum=-5.0, maximum=-1.0), "0x6040:00 | -5 | -1"),
        (SignalConfig(0, "0x6040:00", minimum=0.2, maximum=0.8), "0x6040:00 | 0.2 | 0.8"),
        (SignalConfig(0, "0x6040:00", minimum=7e4), "0x6040:00 | 70000"),
        (SignalConfig(0, "0x6040:00", type="real"), "0x6040:00 | 16 bits | REAL32 | 32"),
        (SignalConfig(0, "0x6040:00", type="int8"), "0x6040:00 | 16 bits | INTEGER8 | 8"),
    ],
)
def test_wrong_signals_are_refused(rule: SignalConfig, what: str) -> None:
    with pytest.raises(ConfigError, match=naming("configuration: ", *what.split(" | "))):
        give_meanings(bus(drive()), Profiles(), [rule])


def test_a_safe_value_is_within_the_declared_range() -> None:
    rules = [SignalConfig(0, "0x6072:00", minimum=100.0)]
    made = bus(drive())
    give_meanings(made, Profiles(), rules)
    with pytest.raises(ConfigError, match=naming("0x6072:00", "slave 0 (D)", "0 (raw)")):
        safe_outputs(made, [])
    give_meanings(made, Profiles(), rules)
    safe_outputs(made, [SafeConfig(0, 500, "0x6072:00")])
    assert shown(made)[0x6072] == 500


def positions(slave: Slave, **actual: Any) -> Slave:
    """A drive whose axes have their actual positions in the process data."""
    for axis, pdo in enumerate(slave.inputs):
        pdo.entries.append(entry(0x6064 + 0x800 * axis, I32, 32))
        for key, value in actual.items():
            setattr(pdo.entries[-1], key, value)
    return slave


def test_target_positions_follow_the_actual_ones() -> None:
    made = bus(positions(drive(axes=2)))
    safe = safe_outputs(made, [])
    found = [(one.slave, one.target, one.actual, one.stop) for one in safe.follows]
    assert found == [(0, 0x607A, 0x6064, None), (0, 0x687A, 0x6864, None)]
    assert shown(made)[0x607A] == shown(made)[0x687A] == "actual"
    assert shown(made)[0x60FF] == shown(made)[0x6071] == 0  # following would keep an axis moving
    assert safe.unguarded == []


def test_a_rule_for_a_target_position_wins() -> None:
    for rules in (
        [SafeConfig(0, "hold")],
        [SafeConfig(0, "zero")],
        [SafeConfig(0, 5, "0x607A:00")],
    ):
        assert safe_outputs(bus(positions(drive())), rules).follows == []
    # A stop does not name a position: it ends, and then the target follows.
    safe = safe_outputs(bus(positions(drive())), [SafeConfig(0, "quick_stop")])
    assert [one.stop for one in safe.follows] == safe.stops


@pytest.mark.parametrize(
    ("slave", "why"),
    [
        (drive(), "process data"),
        (positions(drive(), unit="m"), "unit"),
        (positions(drive(), scale=2.0), "scale"),
        (positions(drive(), data_type=DataType.UNSIGNED32), "type"),
        (positions(drive(), data_type=I16, bit_length=16), "size"),
    ],
)
def test_a_target_position_that_cannot_follow_is_told(slave: Slave, why: str) -> None:
    safe = safe_outputs(bus(slave), [])
    (told,) = safe.unguarded
    names(told, "0x607A:00", "0x6064:00", why, "[[outputs.safe]]")
    assert safe.follows == []
    assert safe_outputs(bus(slave), [SafeConfig(0, "hold")]).unguarded == []


def test_a_target_position_starts_within_its_range() -> None:
    """Until the actual position is known; so it needs no safe value of its own."""
    made = bus(positions(drive()))
    target = next(e for _, e, _ in made.slaves[0].entries(outputs=True) if e.index == 0x607A)
    target.minimum, target.maximum = 100.0, 200.0
    value, _hold = image(safe_outputs(made, []))
    assert value[3:7] == (100).to_bytes(4, "little")


def test_the_type_that_nobody_tells_is_told_and_can_be_configured() -> None:
    entries = [entry(0x7000, U16, 16), entry(0x7001, REAL32, 16), entry(0x7002, U16, 16)]
    text = entry(0x7003, DataType.VISIBLE_STRING, 32)
    slave = Slave(0, "S", 1, 2, 3, outputs=[Pdo(0x1600, "", 2, [*entries, text])])
    unknown, odd = unknown_types(slave, {(0x7000, 0)})
    names(unknown, "slave 0 (S)", "0x7000:00", "[[signal]]", "--esi")
    names(odd, "0x7001:00", "REAL32", "16 bits", "0x7003:00", "VISIBLE_STRING", "32 bits")
    assert "0x7002" not in unknown + odd
    assert unknown_types(slave, {(0x7000, 0)}, [(0x7000, 0), (0x7001, 0), (0x7003, 0)]) == []
    give_meanings(bus(slave), Profiles(), [SignalConfig(0, "0x7000:00", type="int16")])
    found = {e.index: e for _, e, _ in slave.entries(outputs=True)}
    assert (found[0x7000].data_type, found[0x7000].raw_range()) == (I16, (-math.inf, math.inf))
