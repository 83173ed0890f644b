"""The operation for the rights of a user of another machine."""

from __future__ import annotations

from .fields import UserName
from .operation import Map, Operation


class Rights(Map):
    """What a user may do."""

    user: str  #: Name of the user.
    read: bool  #: Whether the user may read.
    write: list[str]  #: The rights of the user, such as `sdo`.
    #: Positions and names of the slaves that the user may change; empty: all.
    slaves: list[int | str]


class ReadRights(Operation[Rights]):
    """Asks what a user of another machine may do."""

    op = "rights"
    key = "as/{user}/ro/rights"
    user: UserName  #: Name of the user.
