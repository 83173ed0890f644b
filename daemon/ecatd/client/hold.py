"""Outputs that are held by hand over Zenoh, also from another machine."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Self

from ecatd.base.addresses import address_text, parse_address
from ecatd.base.errors import EcatError, LeaseError, StateError
from ecatd.operations.outputs import HoldOutputs, Output, Outputs, ReleaseOutputs

if TYPE_CHECKING:
    from .session import Session

_RENEW_S = 0.1
"""Seconds between two renewals: one may be late, and another one get lost."""
_TRIES = 4
"""How often it tries to begin."""


class Hold:
    """Outputs that a session holds, as long as `renew` is called in time. A context manager.

    Args:
        session: The session.
        values: Values by names as in `Output.name`: a text as a person types it, or a raw number.

    Raises:
        LeaseError: The way to the daemon takes too long to hold anything.
        NotPermittedError: The user of the session may not.
        OwnedError: An output has an owner.
        UsageError: An output cannot have this value.
    """

    def __init__(self, session: Session, values: Mapping[str, str | float]) -> None:
        self._session = session
        self._writer = os.urandom(8).hex()
        self._renewal = HoldOutputs(self._writer, dict.fromkeys(values))
        self._begin(values)
        self._next = time.monotonic() + _RENEW_S

    def _begin(self, values: Mapping[str, str | float]) -> None:
        for left in reversed(range(_TRIES)):
            asked = self._session.request(HoldOutputs(self._writer, dict(values), begin=True))
            ticket = asked.get("ticket", "")
            try:
                self._session.request(HoldOutputs(self._writer, dict(values), ticket=ticket))
            except LeaseError:  # the way was too slow for the ticket
                if left == 0:
                    raise
            else:
                return

    def renew(self) -> None:
        """Waits until it is time to renew, and does so.

        Raises:
            LeaseError: The outputs were lost, and have their safe values.
        """
        time.sleep(max(0.0, self._next - time.monotonic()))
        self._next = time.monotonic() + _RENEW_S
        self._session.request(self._renewal)

    def change(self, values: Mapping[str, str | float | None]) -> None:
        """Holds other values, and perhaps other outputs.

        Args:
            values: All outputs that are held from now on; None keeps a value.

        Raises:
            EcatError: As when it begins; then nothing has changed.
            LeaseError: The outputs were lost, and have their safe values.
        """
        self._session.request(HoldOutputs(self._writer, dict(values)))
        self._renewal = HoldOutputs(self._writer, dict.fromkeys(values))
        self._next = time.monotonic() + _RENEW_S

    def release(self) -> None:
        """Gives the outputs back; they take their safe values."""
        self._session.request(ReleaseOutputs(self._writer))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: object, _: object) -> None:
        if not isinstance(error, EcatError):  # else nothing is held any more
            self.release()


def find_output(outputs: Outputs, name: str) -> Output:
    """The output with a name, in an answer with names.

    Raises:
        StateError: There is no such output, or there are several.
    """
    slave, _, entry = name.rpartition("/")
    address = parse_address(entry)
    wanted = f"{slave}/{address_text(*address) if address else entry}".lower()
    fitting = [row for row in outputs["outputs"] if wanted in _names(row, outputs)]
    if len(fitting) != 1:
        several = ", ".join(row["name"] for row in fitting[:4])
        raise StateError(
            f"there is no output '{name}': `ecatctl claims` lists the outputs with their names"
            if not fitting
            else f"several outputs are called '{name}': {several}; give one of these addresses"
        )
    return fitting[0]


def _names(row: Output, outputs: Outputs) -> Iterator[str]:
    for who in (str(row["slave"]), outputs["slaves"][row["slave"]]["name"]):
        for entry in (row["label"], row["address"]):
            yield f"{who}/{entry}".lower()
