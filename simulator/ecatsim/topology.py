"""The topology of a rig: the links of its devices, and the wire order that follows from them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

from ecatd.base.errors import UsageError

from .slave.device import Device

_PORTS = 4
_DOWNSTREAM = (3, 1, 2)  # in the order in which frames pass them
_EBUS = 2  # port descriptor; lower values mean that there is no port


@dataclass(frozen=True, slots=True)
class Wiring:
    """The links of a segment, by positions.

    Attributes:
        parents: For each slave the position and the port that its port 0 is plugged into; None for
            the first one, which is at the interface.
        ring_end: Position and port at the second interface, or None.
    """

    parents: list[tuple[int, int] | None]
    ring_end: tuple[int, int] | None


class Topology:
    """The links of the devices of a rig. Devices without a call of `connect` form a line."""

    def __init__(self) -> None:
        self._parents: dict[Device, tuple[Device, int]] = {}
        self._ring_end: tuple[Device, int] | None = None

    def connect(
        self, devices: Sequence[Device], device: Device, parent: Device, port: int
    ) -> list[Device]:
        """Plugs a device into a port of another one and returns the devices in wire order."""
        for item in (device, parent):
            if item not in devices:
                raise UsageError(f"{item.order or 'a device'} is not a device of this rig")
        self._complete(devices)
        if device is devices[0]:
            raise UsageError(f"{_name(devices, device)} is at the interface and cannot be moved")
        _check_port(devices, device, 0)
        _check_port(devices, parent, port)
        if port == 0:
            raise UsageError(
                f"port 0 of {_name(devices, parent)} leads to the master: use port 1, 2 or 3"
            )
        above = parent
        while above in self._parents and above is not device:
            above = self._parents[above][0]
        if above is device:
            raise UsageError(
                f"{_name(devices, parent)} is behind {_name(devices, device)}: "
                "the links would be a loop"
            )
        self._check_free(devices, parent, port, but=device)
        self._parents[device] = (parent, port)
        return self._order(devices)

    def close_ring(self, devices: Sequence[Device], device: Device, port: int) -> None:
        """Plugs the second interface into a port of a device."""
        if device not in devices:
            raise UsageError(f"{device.order or 'a device'} is not a device of this rig")
        self._complete(devices)
        _check_port(devices, device, port)
        self._ring_end = None
        self._check_free(devices, device, port)
        self._ring_end = (device, port)

    def wiring(self, devices: Sequence[Device], ring: bool) -> Wiring:
        """Returns the links of all devices, which must be in wire order.

        Raises:
            UsageError: A needed port is taken or does not exist, or the order is wrong.
        """
        self._complete(devices)
        place = {device: position for position, device in enumerate(devices)}
        parents: list[tuple[int, int] | None] = [None] * len(devices)
        for device in devices[1:]:
            parent, port = self._parents[device]
            if parent not in place:
                raise UsageError(
                    f"{_name(devices, device)} is plugged into a device that the rig no longer has"
                )
            _check_port(devices, device, 0)
            _check_port(devices, parent, port)
            self._check_free(devices, parent, port, but=device)
            parents[place[device]] = (place[parent], port)
        if self._order(devices) != list(devices):
            raise UsageError(
                "the devices of the rig are not in wire order: call Rig.connect after the last "
                "change of Rig.devices"
            )
        if not ring:
            return Wiring(parents, None)
        end, port = self._ring_end or self._default_end(devices)
        return Wiring(parents, (place[end], port))

    def _complete(self, devices: Sequence[Device]) -> None:
        """Connects each device without a link to the one before it."""
        for before, device in itertools.pairwise(devices):
            self._parents.setdefault(device, (before, _next_port(before, device)))

    def _users(self, devices: Sequence[Device], parent: Device, port: int) -> list[Device]:
        return [item for item in devices[1:] if self._parents.get(item) == (parent, port)]

    def _check_free(
        self, devices: Sequence[Device], parent: Device, port: int, but: Device | None = None
    ) -> None:
        taken = [user for user in self._users(devices, parent, port) if user is not but]
        if taken:
            raise UsageError(
                f"port {port} of {_name(devices, parent)} is taken by "
                f"{_name(devices, taken[0])}: connect that one elsewhere first"
            )
        if self._ring_end == (parent, port):
            raise UsageError(
                f"port {port} of {_name(devices, parent)} is taken by the second interface"
            )

    def _order(self, devices: Sequence[Device]) -> list[Device]:
        order: list[Device] = []
        waiting = list(devices[:1])
        while waiting:
            device = waiting.pop()
            order.append(device)
            for port in reversed(_DOWNSTREAM):
                waiting += self._users(devices, device, port)
        return order

    def _default_end(self, devices: Sequence[Device]) -> tuple[Device, int]:
        """Returns the first free port of the last device."""
        if not devices:
            raise UsageError("a ring needs at least one slave")
        last = devices[-1]
        for port in range(1, _PORTS):
            if _has_port(last, port) and not self._users(devices, last, port):
                return last, port
        raise UsageError(
            f"{_name(devices, last)} has no free port for the second interface: "
            "say where it is with Rig.close_ring"
        )


def _name(devices: Sequence[Device], device: Device) -> str:
    name = device.order or type(device).__name__
    return f"{name} (position {devices.index(device)})"


def _has_port(device: Device, port: int) -> bool:
    return 0 <= port < _PORTS and (device.chip.ports >> 2 * port & 3) >= _EBUS


def _next_port(before: Device, device: Device) -> int:
    """Returns the first port of the same kind as port 0 of the next device, else port 1."""
    kind = device.chip.ports & 3
    fitting = [port for port in range(1, _PORTS) if before.chip.ports >> 2 * port & 3 == kind]
    return fitting[0] if fitting else 1


def _check_port(devices: Sequence[Device], device: Device, port: int) -> None:
    if not _has_port(device, port):
        ports = [str(number) for number in range(_PORTS) if _has_port(device, number)]
        raise UsageError(
            f"{_name(devices, device)} has no port {port}: its port descriptor "
            f"(register 0x0007) is 0x{device.chip.ports:02X}, it has {', '.join(ports) or 'none'}"
        )
