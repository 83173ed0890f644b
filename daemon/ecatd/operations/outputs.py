"""Outputs: who decides the value of each, and since when."""

from __future__ import annotations

import re
from typing import NamedTuple, NotRequired

from ecatd.base.addresses import parse_address
from ecatd.base.errors import UsageError
from ecatd.description.limits import POSITION_MAX

from .fields import ClientName, OutputValues, WriterName
from .operation import Map, Operation

LEASE_S = 0.25
"""Seconds for which outputs are held by hand after a request."""


class OutputClient(Map):
    """A client that has, or had, a slot in the shared memory: it owns outputs or sends requests."""

    slot: int  #: Its slot.
    name: str | None  #: Name of its program, by its own account; None if this cannot be read.
    #: Its process, as it sees itself; None if this cannot be read.
    pid: int | None
    #: Whether it sees the same processes as ecatd: in a container, `pid` means another process.
    #: None if this cannot be read.
    pid_is_ours: bool | None
    #: Whether it holds outputs for somebody who asked over Zenoh; then `pid` is a process of ecatd.
    by_hand: bool
    #: Who holds outputs by hand: the first ten characters of the name of the user; else empty.
    user: str
    state: str  #: `active`; or `lapsed`: it has lost its outputs, and may claim them again.
    reason: str  #: Why it has lost all outputs for the last time: as `cause` of Output.
    held: bool | None  #: Whether its process lives; None if this cannot be read.
    #: How the process `pid` is: `runs`, `sleeps`, `waits` (in the kernel, as for a disk), `stopped`
    #: (by a signal), `traced` (by a debugger), `dumps` (core) or `ended`; None if not known.
    process: str | None
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
    #: an input is copied to it; `can`: ecatd exchanges CAN frames with it.
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


class Place(NamedTuple):
    """Where an output is."""

    slave: int  #: Position of its slave.
    object_index: int  #: Object index.
    subindex: int  #: Object subindex.

    @classmethod
    def of(cls, name: str) -> Place:
        """Takes a name of Output apart: `3/0x7000:01`.

        Raises:
            UsageError: It is no such name.
        """
        slave, _, entry = name.partition("/")
        address = parse_address(entry)
        if address is None or not re.fullmatch("[0-9]{1,5}", slave) or int(slave) > POSITION_MAX:
            raise UsageError(
                f"'{name[:80]}' is no output such as '3/0x7000:01': the position of its slave, and "
                "the address of its entry, as `ro/outputs` names it"
            )
        return cls(int(slave), *address)


class HeldOutput(Map):
    """An output that is held by hand."""

    name: str  #: Its name, as in Output.
    value: float | None  #: The raw value that it is held at; None: it still has its safe value.


class Held(Map):
    """What somebody holds by hand now."""

    outputs: list[HeldOutput]  #: The outputs; none with `begin`.
    lease_ms: float  #: Time within which the request must come again.
    #: With `begin`: what the next request must have, within `lease_ms`, to begin.
    ticket: NotRequired[str]


class HoldOutputs(Operation[Held]):
    """Holds outputs at values by hand, for 250 ms; repeat it in time to go on holding them.

    Who begins asks for a ticket first, with `begin`, and holds nothing yet; the same request with
    that ticket begins. So a request that was held up on its way moves nothing, whatever it wants.
    Without another request in time, the outputs take their safe values, and renewals are refused:
    whoever wants them again begins anew. An output that has an owner is never taken from it.
    """

    op = "hold_outputs"
    key = "rw/outputs/hold/{writer}"
    is_repeatable = True  # it says how everything is to be, and must not fill the kept answers
    #: A name that the client gives to this holding: others of the same user are held separately.
    writer: WriterName
    #: All outputs that this writer holds from now on, by name such as `3/0x7000:01`; it releases
    #: all others. A text is a value as a person types it: physical, with or without unit, or a
    #: named value. A number is a raw value. None keeps the value, and is no change: a renewal has
    #: only these.
    values: OutputValues
    #: Whether to get a ticket, and nothing else. Ask only when a person acts.
    begin: bool = False
    ticket: str = ""  #: The ticket with which to begin, if this writer holds nothing now.
    by: ClientName = ""  #: The name that the client gives itself, for the log.

    def _check(self) -> None:
        for name in self.values:
            Place.of(name)

    @property
    def slaves(self) -> list[int | str | None]:
        """See `Operation`."""
        return [Place.of(name).slave for name in self.values]

    @property
    def is_change(self) -> bool:
        """See `Operation`."""
        return not self.begin and any(value is not None for value in self.values.values())


class Released(Map):
    """Outputs that were released."""

    outputs: list[str]  #: Their names, as in Output.


class ReleaseOutputs(Operation[Released]):
    """Releases outputs that are held by hand; they take their safe values at once."""

    op = "release_outputs"
    key = "rw/outputs/release/{writer}"
    is_repeatable = True
    #: The writer, as it has called itself; None for all writers of all users.
    writer: WriterName | None
    by: ClientName = ""  #: The name that the client gives itself, for the log.

    @property
    def slaves(self) -> list[int | str | None]:
        """See `Operation`: whoever may hold outputs may also make all of them safe."""
        return []
