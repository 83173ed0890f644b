"""Values to be written, and what the rule of docs/process-image.md makes of them.

`expected` follows the rule with numbers of Python, which are exact where they are whole; nothing of
the client is used.
"""

from __future__ import annotations

import math
import random
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from runpy import run_path
from typing import Any

from ecatd.etg.datatypes import DataType, is_real, value_range
from ecatd.etg.pdo import Entry

RIG = Path(__file__).parents[1] / "rigs" / "values.py"
_RIG = run_path(str(RIG))
SHAPES: tuple[Any, ...] = _RIG["SHAPES"]
"""The outputs of the rig, in the order of their numbers."""
configuration = _RIG["configuration"]

A_ROUND = 66
"""Values for each shape, so that there are more than 10 000."""


@dataclass(frozen=True)
class Case:
    """A value for an output.

    Attributes:
        number: Number of the output.
        kind: "r": a raw value; "i": a raw value as an integer; "p": a physical value.
        value: The value.
    """

    number: int
    kind: str
    value: float | int

    @property
    def shape(self) -> Any:
        """The output."""
        return SHAPES[self.number]

    def line(self) -> str:
        """The value as the programs in C read it."""
        text = self.value.hex() if isinstance(self.value, float) else str(self.value)
        return f"{self.number} {self.kind} {text}"


def raw_limits(shape: Any) -> tuple[float | int, float | int]:
    """Smallest and largest raw value."""
    entry = Entry(0x7000, 0, "", shape.data_type, shape.bits, shape.unit, shape.scale, shape.offset)
    entry.minimum, entry.maximum = shape.minimum, shape.maximum
    low, high = entry.raw_range()
    if is_real(shape.data_type):
        largest = float.fromhex("0x1.fffffep127" if shape.bits == 32 else "0x1.fffffffffffffp1023")
        return max(low, -largest), min(high, largest)
    least, most = value_range(shape.data_type, shape.bits)
    return max(int(low) if math.isfinite(low) else least, least), min(
        int(high) if math.isfinite(high) else most, most
    )


def expected(case: Case) -> int | None:
    """The bits that the output gets, or None: the value is refused."""
    shape, value = case.shape, case.value
    analog = case.kind == "p" and shape.is_analog
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if analog:
        try:
            value = (value - shape.offset) / shape.scale
        except OverflowError:
            value = math.inf * value * shape.scale
    low, high = raw_limits(shape)
    rounded = _nearest(shape, value)
    if not low <= rounded <= high:
        if not analog:
            return None
        rounded = low if rounded < low else high
    return bits_of(shape, rounded)


def _nearest(shape: Any, value: float) -> float | int:
    if shape.data_type == DataType.REAL32:
        try:
            return float(struct.unpack("<f", struct.pack("<f", value))[0])
        except OverflowError:
            return math.copysign(math.inf, value)
    if is_real(shape.data_type) or not math.isfinite(value):
        return float(value)
    return round(value)  # ties to even; exact, also for integers beyond 2^53


def bits_of(shape: Any, raw: float) -> int:
    """The bits of a raw value."""
    if is_real(shape.data_type):
        data = struct.pack("<f" if shape.bits == 32 else "<d", raw)
        return int.from_bytes(data, "little")
    return int(raw) & (1 << shape.bits) - 1


def first_case(number: int) -> Case:
    """A value that the output takes."""
    low, high = raw_limits(SHAPES[number])
    return Case(number, "r", float(min(max(0, low), high)))


def cases(seed: int = 13) -> Iterator[Case]:
    """Values of all kinds for all outputs, always the same."""
    source = random.Random(seed)
    for number, shape in enumerate(SHAPES):
        raws = [*_corners(shape), *(_some(shape, source) for _ in range(A_ROUND))]
        for raw in source.sample(raws, A_ROUND):
            yield _case(number, raw, source)
        for raw in (0.5, 1.5, 2.5, 3.5, -0.5, -1.5, -2.5):  # the ties that everybody tries first
            yield Case(number, "r", raw)
            yield Case(number, "p", raw * shape.scale + shape.offset)


def _case(number: int, raw: float, source: random.Random) -> Case:
    shape = SHAPES[number]
    kind = source.choice("ripp" if shape.is_analog else "rip")
    finite = math.isfinite(raw)
    if kind == "i" and finite and -(1 << 63) <= raw < 1 << 64:
        whole = int(raw) + source.choice((-1, 0, 1))
        # 64 bits without a sign are given to C as they are, so that there is no -1.
        unsigned = shape.data_type == DataType.UNSIGNED64 and shape.bits == 64
        low, high = (0, (1 << 64) - 1) if unsigned else (-(1 << 63), (1 << 63) - 1)
        return Case(number, "i", min(max(whole, low), high))
    try:
        value = float(raw)
    except OverflowError:
        value = math.inf
    if kind != "p":
        return Case(number, "r", value)
    physical = value * shape.scale + shape.offset
    towards = source.choice((physical, -math.inf, math.inf))
    return Case(number, "p", math.nextafter(physical, towards))


def _corners(shape: Any) -> Iterator[float | int]:
    """Raw values at which something might change."""
    yield from (0.0, -0.0, 1.0, -1.0, math.nan, math.inf, -math.inf, 1e300, -1e300)
    yield from (5e-324, -5e-324, 1e-310, 1e-40, -1e-45, 0.1, -0.1, 0.49999999999999994)
    for number in (2.0**24, 2.0**31, 2.0**32, 2.0**52, 2.0**53, 2.0**62, 2.0**63, 2.0**64):
        yield from (number, -number, number - 0.5, number + 1, math.nextafter(number, 0))
    for limit in raw_limits(shape):
        yield limit
        for around in (float(limit), limit + 0.5, limit - 0.5, limit + 1.0, limit - 1.0):
            yield from (around, math.nextafter(around, math.inf), math.nextafter(around, -math.inf))


def _some(shape: Any, source: random.Random) -> float | int:
    low, high = raw_limits(shape)
    wild = source.random()
    if wild < 0.2:
        return source.uniform(-4, 4)
    if wild < 0.3:
        return source.choice((-1, 1)) * 2.0 ** source.uniform(-1074, 1023)
    if is_real(shape.data_type):
        return source.uniform(low / 2, high / 2) * 2.0 ** source.uniform(-200, 0)
    whole = source.randint(int(low), int(high))
    return whole if wild < 0.5 else whole + source.choice((-0.5, 0.5, 0.25, -0.49))
