"""Maps that are published: values, streams, and the kinds of events."""

from __future__ import annotations

from typing import NotRequired, TypedDict


class AlStateEvent(TypedDict):
    """The AL state of a slave has changed."""

    slave: int
    al_state: int
    al_code: int
    text: str


class SlavesEvent(TypedDict):
    """Slaves have left the wire or come back."""

    found: int
    expected: int
    missing: list[int]
    text: str


class RecoveryEvent(TypedDict):
    """A slave is brought back to OP, or that has failed."""

    slave: int
    state: str
    seconds: NotRequired[float]
    text: str


class EmergencyEvent(TypedDict):
    """A slave has sent an emergency."""

    slave: int
    code: int
    register: int
    text: str


class LinkEvent(TypedDict):
    """The link of an interface has changed."""

    interface: str
    state: str
    text: str


class SendingEvent(TypedDict):
    """An interface refuses frames, or takes them again."""

    interface: str
    error: str
    cycle: int
    text: str


class RingEvent(TypedDict):
    """The ring has opened or closed."""

    state: str
    slaves_before: int
    text: str
    cycle: int


class DisturbanceEvent(TypedDict):
    """Counters of errors are rising, or stand still again."""

    counts: dict[str, int]
    seconds: float
    over: bool
    text: str


class ForeignMasterEvent(TypedDict):
    """Another master sends frames."""

    interface: str
    source: str
    count: int
    wrote: list[str]
    over: bool
    text: str


class WorkingCounterEvent(TypedDict):
    """Slaves have stopped or begun to take part in the exchange of a domain."""

    domain: int
    state: str
    cycle: int
    text: str


class ExchangeEvent(TypedDict):
    """Exchanges of a domain begin to fail, for another reason, or succeed again."""

    fault: str
    domain: int | None
    share: float
    exchanges: int
    failures: int
    slaves: list[int]
    over: bool
    text: str


class InterfaceEvent(TypedDict):
    """Something is wrong with an interface, or no longer."""

    interface: str
    topic: str
    over: bool
    text: str


class ClockEvent(TypedDict):
    """The cycle follows the reference clock, or does not any more."""

    state: str
    offset_ns: int
    drift_ppb: int
    cycle: int
    text: str


class ClockDifferenceEvent(TypedDict):
    """The clock of a slave is out of step, or in step again."""

    slave: int
    difference_ns: int
    text: str


class ExpectedBusEvent(TypedDict):
    """The bus is not as the configuration expects it, or is so again."""

    differences: list[str]


class AbsentEvent(TypedDict):
    """Optional slaves have left the bus."""

    slaves: list[int]
    text: str


class ChangeEvent(TypedDict):
    """Somebody has changed something, or tried to."""

    what: str
    by: str
    failed: bool
    text: str


class NothingMoreEvent(TypedDict):
    """Something was changed; ask for it."""


class ClaimedEvent(TypedDict):
    """Outputs of a slave have an owner."""

    slave: int
    slot: int
    program: str
    pid: int
    cycle: int
    text: str


class SafeEvent(TypedDict):
    """Outputs of a slave are safe; the owner is the one before, if there was one."""

    slave: int
    reason: str
    slot: NotRequired[int]
    program: NotRequired[str]
    pid: NotRequired[int]
    cycle: int
    text: str


class StoppedEvent(TypedDict):
    """The drive of a slave was brought to a stop."""

    slave: int
    in_time: bool
    slot: NotRequired[int]
    program: NotRequired[str]
    pid: NotRequired[int]
    cycle: int
    text: str


class RefusedEvent(TypedDict):
    """An owner wrote a value out of its declared range."""

    slave: int
    entry: str
    slot: int
    program: str
    pid: int
    programs: list[str]
    cycle: int
    text: str


class MalformedEvent(TypedDict):
    """A slot contains data that no client library writes."""

    slot: int
    program: str
    pid: int
    programs: list[str]
    cycle: int
    text: str


class TamperedEvent(TypedDict):
    """A file of the shared memory was damaged."""

    file: str
    damage: str
    programs: list[str]


EVENTS: dict[str, type] = {
    "al_state": AlStateEvent,
    "slaves": SlavesEvent,
    "absent": AbsentEvent,
    "recovery": RecoveryEvent,
    "emergency": EmergencyEvent,
    "link": LinkEvent,
    "sending": SendingEvent,
    "ring": RingEvent,
    "disturbance": DisturbanceEvent,
    "exchange": ExchangeEvent,
    "interface": InterfaceEvent,
    "foreign_master": ForeignMasterEvent,
    "working_counter": WorkingCounterEvent,
    "clock": ClockEvent,
    "clock_difference": ClockDifferenceEvent,
    "expected_bus": ExpectedBusEvent,
    "change": ChangeEvent,
    "configuration": NothingMoreEvent,
    "log_levels": NothingMoreEvent,
    "claimed": ClaimedEvent,
    "safe": SafeEvent,
    "stopped": StoppedEvent,
    "refused": RefusedEvent,
    "malformed": MalformedEvent,
    "tampered": TamperedEvent,
}
"""The facts of each kind of event."""
