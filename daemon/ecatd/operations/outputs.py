"""Outputs: who decides the value of each, and since when."""

from __future__ import annotations

from typing import NotRequired

from .operation import Map, Operation


class OutputClient(Map):
    """A client that has, or had, a slot in the shared memory: it owns outputs or sends requests."""

    slot: int  #: Its slot.
    name: str | None  #: Name of its program, by its own account; None if this cannot be read.
    #: Its process, as it sees itself; None if this cannot be read.
    pid: int | None
    #: Whether it sees the same processes as ecatd: in a container, `pid` means another process.
    #: None if this cannot be read.
    pid_is_ours: bool | None
    #: Whether it holds outputs for somebody who asked over Zenoh; then `pid` is the gateway.
    by_hand: bool
    user: str  #: Who holds outputs by hand; else empty.
    state: str  #: `active`; or `lapsed`: it has lost its outputs, and may claim them again.
    reason: str  #: Why it has lost all outputs for the last time: as `cause` of Output.
    held: bool | None  #: Whether its process lives; None if this cannot be read.
    since: float | None  #: Unix time in seconds at which it took the slot; None if not known.
    lease_ms: float  #: Its lease.
    silent_ms: float  #: Time since its last sign of life. At `lease_ms` it loses its outputs.
    outputs: int  #: How many outputs it owns.
    lapses: int  #: How many leases were lost in this slot since the start of the daemon.
    refused: int  #: Values out of their range that were not taken over.
    commit_cycle: int  #: Cycle in which its last commit was taken over.


class Output(Map):
    """An output, and what decides its value."""

    name: str  #: SLAVE/ENTRY, as in traces: `3/0x7000:01`.
    slave: int  #: Position of its slave.
    address: str  #: Its address, as `0x7000:01`.
    #: `safe`: it has no owner; `claimed`: its owner has not written it, so it is still safe;
    #: `active`: its owner has written it; `stopping`: ecatd brings the drive to a stop; `copied`:
    #: an input is copied to it.
    state: str
    owner: int  #: Place of its owner in `owners`; -1 for none.
    #: Why it is safe, or was so last: `start`, `released`, `lapsed`, `gone`, `stopping`, `wkc`,
    #: `source` or `died`.
    cause: str
    reason: str  #: The same as a sentence; empty if it is not safe.
    source: str | None  #: Name of the input that is copied to it, else None.
    since: float | None  #: Unix time in seconds of the last change of owner or state; None: never.
    value: float | None  #: The value in the frame; None if it cannot be read.
    label: NotRequired[str]  #: With `names`: name of the entry; may be empty.
    physical: NotRequired[float | None]  #: With `names`: physical value.
    unit: NotRequired[str]  #: With `names`: unit of the physical value; may be empty.


class NamedSlave(Map):
    """A slave and its name."""

    position: int  #: Its position.
    name: str  #: Its name from the EEPROM; may be empty.


class Outputs(Map):
    """Who decides the values of all outputs."""

    bus: str  #: Name of the bus.
    state: str  #: `starting`, `running`, `stopping` or `stopped`.
    cycle: int  #: Number of the last finished cycle.
    age_us: float  #: Time since its end.
    owners: list[OutputClient]  #: Clients with a slot, also those that own no output.
    outputs: list[Output]  #: All outputs, in the order of the bus description.
    slaves: NotRequired[list[NamedSlave]]  #: With `names`: all slaves, by position.
    problems: list[str]  #: What makes no sense in the shared memory; empty if it is sound.


class ReadOutputs(Operation[Outputs]):
    """Asks which client owns which output, and why the others are safe."""

    op = "outputs"
    key = "ro/outputs"
    names: bool = False  #: Whether to have names, units and physical values.
