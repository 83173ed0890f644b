"""Emergency messages (ETG.1000.6 "Emergency", CiA 301), which a device sends by itself."""

from __future__ import annotations

import struct

from ecatd.etg.al import AlState

_SERVICE = 1 << 12
_DATA_SIZE = 5
RESET = 0x0000
"""Error code that means that all errors are gone."""
PREOP_TO_SAFEOP, SAFEOP_TO_OP = 0xA000, 0xA001


def encode(code: int, register: int, data: bytes = b"") -> bytes:
    """Encodes the body: CoE header, error code, error register, and five bytes of data.

    Raises:
        ValueError: A number does not fit, or there are more than five bytes.
    """
    if not (0 <= code <= 0xFFFF and 0 <= register <= 0xFF and len(data) <= _DATA_SIZE):
        raise ValueError(
            f"an emergency has a code of 16 bits, an error register of 8 bits and at most "
            f"{_DATA_SIZE} bytes of data, not 0x{code:X}, 0x{register:X} and {len(data)} bytes"
        )
    return struct.pack("<HHB", _SERVICE, code, register) + data.ljust(_DATA_SIZE, b"\0")


def refused(old: AlState, new: AlState) -> int | None:
    """Returns the error code for a refused state change; None if the standard has none."""
    return {
        (AlState.PREOP, AlState.SAFEOP): PREOP_TO_SAFEOP,
        (AlState.SAFEOP, AlState.OP): SAFEOP_TO_OP,
    }.get((old, new))
