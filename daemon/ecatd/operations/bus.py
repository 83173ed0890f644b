"""Requests about the bus as a whole: its description, configuration, slaves, AL states, events."""

from __future__ import annotations

from .operation import Request


class Describe(Request):
    """Asks for the bus description. Only a reload changes it, in limits of outputs."""

    op = "describe"
    key = "ro/slaves"


class ReadInfo(Request):
    """Asks about the daemon: version, interface, start, cycle, and present links and recovery."""

    op = "info"
    key = "ro/info"


class ReadConfig(Request):
    """Asks for the configuration in force, and for the origins of its values."""

    op = "config"
    key = "ro/config"


class ReadStates(Request):
    """Asks for the AL states of all slaves, which are read for this request."""

    op = "states"
    key = "ro/state"


class Rescan(Request):
    """Asks which devices are on the wire now."""

    op = "rescan"
    key = "ro/wire"


class SetState(Request):
    """Asks to bring one slave or all slaves to an AL state.

    Attributes:
        state: `INIT`, `PREOP`, `BOOT`, `SAFEOP` or `OP`.
        slave: Position or name, or None for all slaves.
        by: The name that the client gives itself, for the log.
    """

    op = "set_state"
    key = "rw/state/{slave}"
    state: str
    slave: int | str | None = None
    by: str = ""


class ReadEvents(Request):
    """Asks for the last events.

    Attributes:
        since: Number of the first one; 0 for all that are kept.
    """

    op = "read_events"
    key = "ro/events"
    since: int = 0
