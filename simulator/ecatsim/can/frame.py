"""CAN frames, and which of them a node receives."""

from __future__ import annotations

from dataclasses import dataclass

from ecatd.base.errors import UsageError
from ecatd.etg.can_terminals import DATA_MAX, EXTENDED_MAX, STANDARD_MAX


@dataclass(frozen=True, slots=True)
class CanFrame:
    """A frame.

    Attributes:
        id: Identifier.
        data: Data, at most 8 bytes; empty in a remote frame.
        extended: Whether the identifier has 29 bits rather than 11.
        remote: Whether it is a remote frame, which asks for a frame with this identifier.
        length: The data length code; None: the length of `data`.
        time_ns: When it was complete on the bus (CLOCK_MONOTONIC); 0 before.
        tag: A number of the sender, which is not on the wire.
    """

    id: int
    data: bytes = b""
    extended: bool = False
    remote: bool = False
    length: int | None = None
    time_ns: int = 0
    tag: int = 0

    def __post_init__(self) -> None:
        last = EXTENDED_MAX if self.extended else STANDARD_MAX
        if not 0 <= self.id <= last:
            raise UsageError(f"identifier 0x{self.id:X} of a frame must be from 0 to 0x{last:X}")
        if len(self.data) > DATA_MAX or not 0 <= self.size <= DATA_MAX:
            raise UsageError(f"a frame has at most {DATA_MAX} data bytes")
        if self.remote and self.data:
            raise UsageError("a remote frame has no data")

    @property
    def size(self) -> int:
        """The data length code."""
        return len(self.data) if self.length is None else self.length


@dataclass(frozen=True, slots=True)
class Filter:
    """Identifiers that a node receives, both ends included.

    Attributes:
        first: The first one.
        last: The last one; None: only the first.
        extended: Whether they have 29 bits rather than 11; None: either.
    """

    first: int
    last: int | None = None
    extended: bool | None = False
