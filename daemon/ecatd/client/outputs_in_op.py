"""Refuses outputs that do not reach their slave."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from ecatd.base.errors import StateError
from ecatd.etg.al import AlState, al_state_text

if TYPE_CHECKING:
    from .client import Client
    from .signals import Signal


def check_in_op(client: Client, wanted: Iterable[Signal]) -> None:
    """Refuses outputs of slaves that do not use them.

    Raises:
        StateError: A slave is not in OP.
    """
    slaves = client.slaves()
    for output in wanted:
        slave = slaves[output.slave]
        if slave.al_state != AlState.OP:
            state = al_state_text(slave.al_state) if slave.al_state else "without an answer"
            raise StateError(
                f"slave {slave.position} ({slave.name}) is {state}, so {output.path} does not "
                "reach it: `ecatctl state` says why"
            )
