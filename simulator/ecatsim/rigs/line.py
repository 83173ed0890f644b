"""The rig `line:N`: a line of equal slaves."""

from __future__ import annotations

from ecatd.base.errors import UsageError

from ..devices.generic import Loopback
from ..esc import MAX_SLAVES
from ..rig import Rig


def rig(count: int) -> Rig:
    """Makes a line of `count` slaves."""
    if not 1 <= count <= MAX_SLAVES:
        raise UsageError(f"line:{count}: a line has 1 to {MAX_SLAVES} slaves")
    return Rig(f"line:{count}", [Loopback() for _ in range(count)])
