"""Faults of frames. The slave controllers carry them out, exactly in their cycles."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from ecatd.base.errors import UsageError

from ..links import FaultKind
from ..links import FrameFault as SegmentFault
from ..parameters import Is
from .fault import Fault, Slave

_MAX_DELAY_US = 10_000_000
_MAX_BITS = 64


@dataclass(frozen=True)
class FrameFault(Fault):
    """A fault of frames with process data, or of all frames."""

    on_wire: ClassVar[FaultKind]

    all_frames: Annotated[bool, Is("strike frames without process data, too")] = field(
        default=False, kw_only=True
    )

    def on_segment(self, now: int) -> SegmentFault:
        """Converts the fault for the segment of a bus that is in cycle `now`."""
        return SegmentFault(
            self.on_wire,
            first=self.at_cycle if self.at_cycle or self.every == 1 else now + 1,
            count=self.count,
            every=self.every,
            probability=self.probability,
            seed=self.seed,
            slave=self._slave(),
            value=self._value(),
            process_data_only=not self.all_frames,
        )

    def _slave(self) -> int:
        return 0

    def _value(self) -> int:
        return 0


@dataclass(frozen=True)
class Drop(FrameFault):
    """Frames get lost on their way to the first slave, or on their way back."""

    kind: ClassVar[str] = "drop"
    on_wire: ClassVar[FaultKind] = FaultKind.DROP
    way_back: Annotated[
        bool, Is("lose frames on their way back, after the slaves have seen them")
    ] = False

    def _value(self) -> int:
        return int(self.way_back)


@dataclass(frozen=True)
class Delay(FrameFault):
    """Frames come back late."""

    kind: ClassVar[str] = "delay"
    on_wire: ClassVar[FaultKind] = FaultKind.DELAY
    delay_us: Annotated[int, Is("how late", unit="µs", minimum=1, maximum=_MAX_DELAY_US)]

    def _value(self) -> int:
        return 1000 * self.delay_us


@dataclass(frozen=True)
class Duplicate(FrameFault):
    """Frames come back twice."""

    kind: ClassVar[str] = "duplicate"
    on_wire: ClassVar[FaultKind] = FaultKind.DUPLICATE


@dataclass(frozen=True)
class Corrupt(FrameFault):
    """Frames come back with some adjacent bits inverted."""

    kind: ClassVar[str] = "corrupt"
    on_wire: ClassVar[FaultKind] = FaultKind.CORRUPT
    bits: Annotated[int, Is("number of bits", minimum=1, maximum=_MAX_BITS)] = 1

    def _value(self) -> int:
        return self.bits


@dataclass(frozen=True)
class Noise(FrameFault):
    """Frames are damaged in front of a slave, which counts a CRC error, and get lost."""

    kind: ClassVar[str] = "noise"
    on_wire: ClassVar[FaultKind] = FaultKind.NOISE
    slave: Slave

    def _slave(self) -> int:
        return self.slave


@dataclass(frozen=True)
class Wkc(FrameFault):
    """The working counter of process data is wrong."""

    kind: ClassVar[str] = "wkc"
    on_wire: ClassVar[FaultKind] = FaultKind.WKC
    value: Annotated[int, Is("number to add", minimum=-0xFFFF, maximum=0xFFFF)]

    def _value(self) -> int:
        return self.value

    def _validate(self) -> None:
        if self.value == 0:
            raise UsageError(f"{self.kind}: a value of 0 changes nothing")
