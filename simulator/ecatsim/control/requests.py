"""The requests to a running simulator, besides faults."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from ecatd.base.addresses import INDEX_MOST, address_text, parse_address, parse_number
from ecatd.base.errors import SdoAbortError, StateError, UsageError
from ecatd.etg import error_codes
from ecatd.etg.datatypes import STRINGS, is_real, is_signed
from ecatd.etg.sii_check import is_description

from ..faults import FAULTS, Fault
from ..faults.fault import Slave
from ..parameters import Described, Is
from ..simulation import Simulation
from ..slave.objects import Value, Variable
from .can import can_bus
from .status import Status, of_slave, to_map

_MEMORY = 0x10000
_MAX_READ = 4096

Object = Annotated[str, Is("object as INDEX:SUBINDEX, both hexadecimal: 6000:01")]


@dataclass(frozen=True, slots=True)
class Session:
    """The simulator that carries out a request.

    Attributes:
        simulation: The simulation.
        name: Name of the simulator.
        interface: Interface on which a master reaches it.
        stop: Function that ends the simulation.
    """

    simulation: Simulation
    name: str
    interface: str
    stop: Callable[[], None]


@dataclass(frozen=True)
class Request(Described):
    """A command that is not a fault."""

    def answer(self, session: Session) -> dict[str, Any]:
        """Carries out the request and returns the result for the reply.

        Raises:
            EcatError: The request failed.
        """
        raise NotImplementedError


@dataclass(frozen=True)
class ShowStatus(Request):
    """Show the rig, its counters and its slaves."""

    kind: ClassVar[str] = "status"

    def answer(self, session: Session) -> dict[str, Any]:
        """Returns the status as a map."""
        simulation = session.simulation
        counters = simulation.segment.counters()
        status = Status(
            name=session.name,
            pid=os.getpid(),
            rig=simulation.rig.name,
            interface=session.interface,
            cycles=counters.cycles,
            frames=counters.frames,
            malformed=counters.malformed,
            dropped=counters.dropped,
            slaves=tuple(of_slave(simulation, i) for i in range(len(simulation.rig.devices))),
        )
        return to_map(status) | {"slaves": [to_map(slave) for slave in status.slaves]}


@dataclass(frozen=True)
class ShowFaults(Request):
    """Show the faults that strike, will strike or have struck."""

    kind: ClassVar[str] = "faults"

    def answer(self, session: Session) -> dict[str, Any]:
        """Returns the faults as maps."""
        faults = [
            {
                "id": item.id,
                "kind": item.fault.kind,
                "parameters": item.fault.to_values(),
                "struck": item.struck,
                "last_cycle": item.last_cycle,
                "done": item.done,
                "error": item.error,
            }
            for item in session.simulation.faults.list()
        ]
        return {"faults": faults}


@dataclass(frozen=True)
class Clear(Request):
    """Forget a fault, or all of them: they no longer strike, but past effects stay."""

    kind: ClassVar[str] = "clear"
    id: Annotated[int, Is("number of the fault; 0 = all", minimum=0, positional=True)] = 0

    def answer(self, session: Session) -> dict[str, Any]:
        """Removes the faults and returns their number."""
        return {"cleared": session.simulation.faults.clear(self.id or None)}


@dataclass(frozen=True)
class Get(Request):
    """Read an entry of a slave's object dictionary, even if a master may not read it."""

    kind: ClassVar[str] = "get"
    slave: Slave
    object: Object

    def answer(self, session: Session) -> dict[str, Any]:
        """Returns value, type and name of the entry."""
        entry = _entry(session.simulation, self.slave, self.object)
        value = entry.on_read() if entry.on_read else entry.value
        return {
            "value": value.hex() if isinstance(value, bytes) else value,
            "type": entry.type.name,
            "name": entry.name,
        }


@dataclass(frozen=True)
class Set(Request):
    """Write an entry of a slave's object dictionary, even if a master may not write it.

    An input that the device, a wire or a plant computes is computed again in the next step. PDO
    mapping and assignment cannot be changed like this.
    """

    kind: ClassVar[str] = "set"
    slave: Slave
    object: Object
    value: Annotated[str, Is("new value: a number, a text, or bytes as hexadecimal digits")]

    def answer(self, session: Session) -> dict[str, Any]:
        """Returns an empty result."""
        entry = _entry(session.simulation, self.slave, self.object)
        objects = session.simulation.rig.devices[self.slave].dictionary
        if is_description(entry.index) and entry is not objects.beside(entry.index, entry.subindex):
            raise UsageError(
                f"0x{entry.index:04X} describes the process data: only a master can change it"
            )
        entry.value = _value(entry, self.value)
        return {}


@dataclass(frozen=True)
class Registers(Request):
    """Read registers or memory of a slave controller, without acknowledging anything."""

    kind: ClassVar[str] = "registers"
    slave: Slave
    address: Annotated[int, Is("first register", minimum=0, maximum=_MEMORY - 1, hexadecimal=True)]
    count: Annotated[int, Is("how many", unit="bytes", minimum=1, maximum=_MAX_READ)]

    def _validate(self) -> None:
        if self.address + self.count > _MEMORY:
            raise UsageError(f"{self.kind}: the last register is 0x{_MEMORY - 1:04X}")

    def answer(self, session: Session) -> dict[str, Any]:
        """Returns the bytes as hexadecimal digits."""
        _check_slave(session.simulation, self.slave)
        data = session.simulation.segment.peek(self.slave, self.address, self.count)
        return {"data": data.hex()}


@dataclass(frozen=True)
class ShowClocks(Request):
    """Show the distributed clocks of all slaves, at one moment."""

    kind: ClassVar[str] = "clocks"

    def answer(self, session: Session) -> dict[str, Any]:
        """Returns the clocks as maps, in wire order."""
        return {"clocks": [to_map(clock) for clock in session.simulation.segment.clocks()]}


@dataclass(frozen=True)
class ShowCan(Request):
    """Show the CAN buses behind terminals: their nodes, with states and counters."""

    kind: ClassVar[str] = "can"

    def answer(self, session: Session) -> dict[str, Any]:
        """Returns the buses as maps."""
        return {"buses": [can_bus(session.simulation, bus) for bus in session.simulation.rig.can]}


@dataclass(frozen=True)
class Stop(Request):
    """End the simulator, as SIGTERM does."""

    kind: ClassVar[str] = "stop"

    def answer(self, session: Session) -> dict[str, Any]:
        """Returns an empty result."""
        session.stop()
        return {}


REQUESTS: dict[str, type[Request]] = {
    cls.kind: cls
    for cls in (ShowStatus, ShowFaults, Clear, Get, Set, Registers, ShowClocks, ShowCan, Stop)
}


def carry_out(session: Session, kind: str, arguments: dict[str, object]) -> dict[str, Any]:
    """Carries out a request or adds a fault.

    Raises:
        EcatError: There is no such request or fault, an argument is wrong, or it failed.
    """
    simulation = session.simulation
    if kind in REQUESTS:
        request = REQUESTS[kind].from_values(arguments)
        with simulation.lock:
            return request.answer(session)
    if kind in FAULTS:
        fault: Fault = FAULTS[kind].from_values(arguments)
        return {"id": simulation.faults.add(fault)}
    known = ", ".join([*REQUESTS, *FAULTS])
    raise UsageError(f"there is no command '{kind[:40]}'; there are {known}")


def _check_slave(simulation: Simulation, position: int) -> None:
    count = len(simulation.rig.devices)
    if position >= count:
        there = f"slaves 0 to {count - 1}" if count else "no slaves"
        raise UsageError(f"there is no slave {position}; the rig has {there}")


def _entry(simulation: Simulation, position: int, text: str) -> Variable:
    _check_slave(simulation, position)
    address = parse_address(text)
    if address is None and not text[:1].isdigit():
        raise UsageError(f"'{text[:40]}' is not an object: use INDEX:SUBINDEX, as 0x6000:01")
    index, subindex = address or (parse_number(text, "index", INDEX_MOST), 0)
    device = simulation.rig.devices[position]
    try:
        objects = device.dictionary
        return objects.beside(index, subindex) or objects.entry(index, subindex)
    except SdoAbortError as error:
        what = "object" if error.code == error_codes.NO_OBJECT else "entry"
        raise StateError(
            f"slave {position} ({device.order or device.name}) has no {what} "
            f"{address_text(index, subindex)}"
        ) from None


def _value(entry: Variable, text: str) -> Value:
    """Converts a text to a value and checks it against the type of the entry."""
    try:
        if entry.type in STRINGS:
            return text if isinstance(entry.value, str) else bytes.fromhex(text)
        if is_real(entry.type):
            number = float(text)
            if not math.isfinite(number):
                raise ValueError
            entry.pack(number)
            return number
        value = int(text, 0)
    except (ValueError, OverflowError):  # OverflowError: too large for REAL32
        raise UsageError(f"'{text[:40]}' is not a value of type {entry.type.name}") from None
    low = -(1 << entry.bits - 1) if is_signed(entry.type) else 0
    high = low + (1 << entry.bits) - 1
    if not low <= value <= high:
        raise UsageError(f"{value} does not fit {entry.type.name}: {low} to {high}")
    return value
