"""Traffic that nodes make and check in C, for tests with full buses."""

from __future__ import annotations

from dataclasses import dataclass

from ecatd.base.errors import UsageError
from ecatd.etg.can_terminals import DATA_MAX, EXTENDED_MAX, STANDARD_MAX


@dataclass(frozen=True, slots=True)
class Traffic:
    """Frames that a node sends by itself, or that another one expects.

    The n-th frame (from 0) has the identifier `id + n % span` and, little-endian, n in its data,
    as many bytes of it as the frame has.

    Attributes:
        id: The first identifier.
        span: Number of identifiers, used in turns.
        extended: Whether they have 29 bits.
        length: Data bytes.
        rate: Frames a second; 0: as many as the bus allows.
        count: Number of frames; 0: without end.
        delay: Seconds to the first one.
        remote: Whether they are remote frames.
    """

    id: int
    span: int = 1
    extended: bool = False
    length: int = DATA_MAX
    rate: float = 0.0
    count: int = 0
    delay: float = 0.0
    remote: bool = False

    def __post_init__(self) -> None:
        last = EXTENDED_MAX if self.extended else STANDARD_MAX
        if self.span < 1 or self.id < 0 or self.id + self.span - 1 > last:
            raise UsageError(f"the identifiers of traffic must be from 0 to 0x{last:X}")
        if not 0 <= self.length <= DATA_MAX or self.rate < 0 or self.count < 0 or self.delay < 0:
            raise UsageError("traffic has 0 to 8 data bytes, and no negative rate, count or delay")


@dataclass(frozen=True, slots=True)
class CheckStatus:
    """What a node has found in traffic that it expects.

    Attributes:
        received: Frames with its identifiers.
        lost: Frames that are missing between two others.
        doubled: Frames that came again, or too late.
        wrong: Frames with another length or with other data.
    """

    received: int
    lost: int
    doubled: int
    wrong: int
