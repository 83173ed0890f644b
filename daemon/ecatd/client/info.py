"""Information for clients about slaves, domains, outputs and their owners."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from ecatd.shm import contract as shm

if TYPE_CHECKING:
    from .signals import Signal


@dataclass(frozen=True, slots=True)
class SlaveInfo:
    """One slave: identity, AL status (register 0x0130) and its code (0x0134), and its outputs.

    Attributes:
        position: On the wire, 0 first.
        name: From SII.
        vendor: Vendor ID.
        product: Product code.
        revision: Revision number.
        serial: Serial number.
        al_state: 1 INIT, 2 PREOP, 4 SAFEOP, 8 OP, with 0x10 where there is an error; 0: no answer.
        al_code: AL status code.
        domain: Its domain, 0 first.
        optional: Whether it may come and go while the bus runs.
        absent: Whether it is optional, and it or its group did not take part in the last sample.
        has_outputs: Whether there is something to claim.
        outputs: Who controls its outputs, as a whole.
        owned: Whether this client owns one of them.
    """

    position: int
    name: str
    vendor: int
    product: int
    revision: int
    serial: int
    al_state: int
    al_code: int
    domain: int
    optional: bool
    absent: bool
    has_outputs: bool
    outputs: shm.Outputs
    owned: bool


@dataclass(frozen=True, slots=True)
class DomainInfo:
    """The last sample of a domain.

    Attributes:
        name: From the configuration.
        divider: It is exchanged every so many base cycles.
        cycle: The cycle in which it was exchanged; 0: never.
        time_ns: CLOCK_MONOTONIC when its frames came back, in ns; 0: never.
        age: Seconds since then; 1e9 before there was an exchange.
        wkc: Working counter.
        wkc_expected: Working counter when all slaves take part.
        wkc_state: Whether none, some or all slaves took part.
    """

    name: str
    divider: int
    cycle: int
    time_ns: int
    age: float
    wkc: int
    wkc_expected: int
    wkc_state: shm.WkcState


@dataclass(frozen=True, slots=True)
class OutputInfo:
    """Who controls one output now.

    Attributes:
        signal: The output.
        owner: Client slot of its owner; None if it has none.
        owned: Whether that is this client.
        state: Whether it is at its safe value.
        reason: Why it is, or was last, at its safe value.
        since_cycle: Cycle of the last change of owner or state.
        age: Seconds since then.
        pid: Process number of the owner, as it says itself; 0 if this user may not see it, or if
            it is in another PID namespace (a container).
        program: Its name, as it says itself.
    """

    signal: Signal
    owner: int | None
    owned: bool
    state: shm.Outputs
    reason: shm.Reason
    since_cycle: int
    age: float
    pid: int
    program: str


@dataclass(frozen=True, slots=True)
class Owner:
    """A client that owns outputs.

    Attributes:
        slot: Its client slot.
        pid: Its process number, as it says itself; 0 as in `OutputInfo`.
        program: Its name, as it says itself.
        me: Whether it is this client.
        outputs: The outputs that it owns.
    """

    slot: int
    pid: int
    program: str
    me: bool
    outputs: tuple[Signal, ...]


class Summary(NamedTuple):
    """An entry during some cycles, in its unit.

    Attributes:
        minimum: Its smallest value; infinite if it could not be trusted in any cycle.
        maximum: Its largest one.
        mean: Their mean.
        last: The last one.
        cycles: Cycles in which it could be trusted.
    """

    minimum: float
    maximum: float
    mean: float
    last: float
    cycles: int
