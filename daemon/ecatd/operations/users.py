"""The operation for the rights of a user of another machine."""

from __future__ import annotations

from .fields import UserName
from .operation import Map, Operation


class Rights(Map):
    """What a user may do.

    Attributes:
        user: Name of the user.
        read: Whether the user may read.
        write: The rights of the user, such as `sdo`.
        slaves: Positions and names of the slaves that the user may change; empty: all.
    """

    user: str
    read: bool
    write: list[str]
    slaves: list[int | str]


class ReadRights(Operation[Rights]):
    """Asks what a user of another machine may do.

    Attributes:
        user: Name of the user.
    """

    op = "rights"
    key = "as/{user}/ro/rights"
    user: UserName
