"""A slave with outputs of every shape that a value can have: types, lengths, scales, limits."""

from dataclasses import dataclass

from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatsim.rig import Rig
from ecatsim.slave.device import Device


@dataclass(frozen=True)
class Shape:
    """An output, and what the configuration says about its value.

    Attributes:
        name: Name of the entry.
        data_type: CoE data type.
        bits: Bits in the process data.
        unit: Unit of the physical value.
        scale: Physical value = raw value * scale + offset.
        offset: See `scale`.
        minimum: Smallest physical value, None: as the type allows.
        maximum: Largest one.
        safe: Raw value while nobody owns it.
    """

    name: str
    data_type: DataType
    bits: int
    unit: str = ""
    scale: float = 1.0
    offset: float = 0.0
    minimum: float | None = None
    maximum: float | None = None
    safe: int = 0

    @property
    def is_analog(self) -> bool:
        """Whether the value has a physical meaning."""
        return bool(self.unit) or self.scale != 1 or self.offset != 0


def _integers() -> list[Shape]:
    """Integers of all lengths; each begins where the one before ends, in the middle of a byte."""
    shapes = []
    for bits in range(1, 65):
        size = next(n for n in range(8, 65, 8) if bits <= n)
        shapes.append(Shape(f"u{bits}", DataType[f"UNSIGNED{size}"], bits))
        shapes.append(Shape(f"s{bits}", DataType[f"INTEGER{size}"], bits))
    return shapes


T = DataType
SHAPES = (
    *_integers(),
    Shape("bit", T.BOOLEAN, 1),
    Shape("single", T.REAL32, 32),  # neither of them begins with a byte
    Shape("double", T.REAL64, 64),
    # Numbers with limits:
    Shape("limited s16", T.INTEGER16, 16, minimum=-300.0, maximum=299.5),
    Shape("limited u7", T.UNSIGNED8, 7, minimum=3.0, maximum=100.0, safe=3),
    Shape("limited s64", T.INTEGER64, 64, minimum=-(2.0**62), maximum=2.0**53),
    Shape("limited u64", T.UNSIGNED64, 64, minimum=1.0, maximum=2.0**63, safe=1),
    Shape("limited single", T.REAL32, 32, minimum=-2.5, maximum=0.1),
    Shape("limited double", T.REAL64, 64, minimum=-1e300, maximum=1e-300),
    # Analog quantities:
    Shape("volt", T.INTEGER16, 16, "V", 10 / 32767),
    Shape("half", T.INTEGER16, 16, "m", 0.5, -10.0),
    Shape("down", T.UNSIGNED8, 8, "K", -2.0, 3.0),
    Shape("unit alone", T.UNSIGNED16, 16, "A"),
    Shape("offset alone", T.INTEGER8, 8, "", 1.0, 0.25),
    Shape("relay", T.BOOLEAN, 1, "V", 24.0),
    Shape("odd", T.INTEGER16, 11, "N.m", 0.1, 0.05),
    Shape("coarse", T.UNSIGNED64, 64, "s", 1e-9),
    Shape("long", T.INTEGER64, 64, "rad", 2.0**-40, 1.0),
    Shape("huge", T.INTEGER32, 32, "Pa", 1e300),
    Shape("tiny", T.INTEGER24, 24, "A", 5e-324),
    Shape("held s16", T.INTEGER16, 16, "V", 10 / 32767, 0.0, -5.0, 7.5),
    Shape("held down", T.INTEGER32, 32, "Hz", -0.125, 0.0, -1000.0, 2000.0),
    Shape("held u33", T.UNSIGNED40, 33, "W", 3.0, -1.0, 0.0, 1e9, safe=1),
    Shape("bar", T.REAL32, 32, "Pa", 1e5, 1e5),
    Shape("thin", T.REAL32, 32, "m", 1e30),
    Shape("wide", T.REAL64, 64, "m", 1e-3, -0.5),
    Shape("held single", T.REAL32, 32, "rad", 0.5, 0.0, -3.5, 3.5),
    Shape("held double", T.REAL64, 64, "V", 1.0, 0.0, -10.0, 10.0),
)
"""Number n of them is the object 0x7000 + n."""


def configuration() -> str:
    """The tables of a configuration that say all of this, and what is safe where 0 is not."""
    text = ""
    for number, shape in enumerate(SHAPES):
        meaning = {"unit": shape.unit, "scale": shape.scale, "offset": shape.offset}
        limits = {"minimum": shape.minimum, "maximum": shape.maximum}
        if not shape.is_analog and limits == {"minimum": None, "maximum": None}:
            continue
        text += f'[[signal]]\nslave = 0\nentry = "0x{0x7000 + number:04X}:00"\n'
        for key, value in (meaning | limits).items():
            if value is not None:
                text += f'{key} = "{value}"\n' if key == "unit" else f"{key} = {value!r}\n"
        if shape.safe != 0:
            text += f'[[outputs.safe]]\nslave = 0\nentry = "0x{0x7000 + number:04X}:00"\n'
            text += f"value = {shape.safe}\n"
    return text


_A_PDO = 64  # entries


def _pdos() -> tuple[Pdo, ...]:
    entries = [
        Entry(0x7000 + number, 0, shape.name, shape.data_type, shape.bits)
        for number, shape in enumerate(SHAPES)
    ]
    filled = -sum(entry.bit_length for entry in entries) % 8
    entries.append(Entry(0, 0, "", DataType.PADDING, filled))
    parts = [entries[at : at + _A_PDO] for at in range(0, len(entries), _A_PDO)]
    return tuple(Pdo(0x1600 + n, f"Part {n}", 0, part) for n, part in enumerate(parts))


class Values(Device):
    vendor, product, revision = 0x0000FFFF, 0xBA1E5, 1
    order = "Values"
    rx_pdos = _pdos()


def rig() -> Rig:
    return Rig("values", [Values()])
