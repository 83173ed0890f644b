"""Network interfaces: reserves them, sets them up, opens sockets for the control side."""

from __future__ import annotations

import contextlib
import fcntl
import socket
import struct
import time
from collections.abc import Callable, Iterator, Sequence

from ecatd.base.errors import NotPermittedError, StateError, UnreachableError
from ecatd.base.log import Log
from ecatd.base.process import CAP_NET_ADMIN, raised
from ecatd.base.timeouts import Timeout
from ecatd.linux import ethtool
from ecatd.linux.interface_state import LEAST_MTU

from ..engine.engine import Index, open_socket
from .datagrams import Answer, Datagrams, brd, source_address

_SIOCGIFFLAGS, _SIOCSIFFLAGS = 0x8913, 0x8914
_SIOCGIFMTU, _SIOCSIFMTU = 0x8921, 0x8922
_IFF_UP, _IFF_RUNNING, _IFF_PROMISC = 0x1, 0x40, 0x100
_IN_USE = _IFF_UP | _IFF_PROMISC
"""Promiscuous, since another master may send its frames to any address."""
_FLAGS = struct.Struct("16sH14x")  # ifreq
_MTU = struct.Struct("16si12x")  # ifreq
_AL_STATUS = 0x0130

_CARRIER = Timeout(5.0)
"""Time that an interface has to get a carrier. Ethernet ports take one to three to negotiate."""

_LOOK_AGAIN = 0.05


def needs_rights(interface: str) -> str:
    """Returns the message for a process that lacks the rights to use an interface."""
    return (
        f"no right to use interface '{interface}' for EtherCAT, which needs CAP_NET_RAW and "
        f"CAP_NET_ADMIN: run as root (`sudo`; the daemon: `systemctl start ecatd`), or try "
        f"without hardware: `ecatd --simulate troll`, `ecatsim run troll`"
    )


def open_for_control(interface: str) -> socket.socket:
    """Opens a raw socket for the frames of the control side.

    Raises:
        UnreachableError: The interface cannot be used.
        NotPermittedError: The process may not use raw sockets.
    """
    try:
        return open_socket(interface, Index.CONTROL, Index.ENGINE - 1)
    except NotPermittedError as error:
        raise NotPermittedError(needs_rights(interface)) from error


def wait_for_carriers(interfaces: Sequence[str], cancelled: Callable[[], bool]) -> None:
    """Waits until all interfaces have a carrier, at most 5 s.

    An interface that has just been switched on has none for some seconds, and frames that are sent
    meanwhile get lost. With cable redundancy, one interface with a carrier is enough after 5 s.

    Args:
        interfaces: Names of the interfaces, which are up.
        cancelled: When it returns true, waiting ends with `StateError`.

    Raises:
        UnreachableError: There is no such interface, or no interface gets a carrier.
        StateError: `cancelled` returned true.
    """
    deadline = time.monotonic() + _CARRIER.seconds
    while not all(found := [_has_carrier(name) for name in interfaces]):
        if cancelled():
            raise StateError("stopped while the interface was waiting for a carrier")
        if time.monotonic() > deadline:
            break
        time.sleep(_LOOK_AGAIN)
    if not any(found):
        names = " and ".join(f"'{name}'" for name in interfaces)
        raise UnreachableError(
            f"{names} had no carrier for {_CARRIER}: check the cable and the power of the first "
            "slave, and that this is the right interface"
        )


def look(interface: str) -> Answer:
    """Reads the AL status of all slaves at an interface, ORed. Changes nothing on the bus.

    The working counter is the number of slaves. On a closed ring it is 0, since the frame comes
    back at the other interface. Raises as `open_for_control`.
    """
    link = Datagrams(open_for_control(interface), source_address(0, 0))
    try:
        return link.exchange([brd(_AL_STATUS, 2)])[0]
    finally:
        link.close()


@contextlib.contextmanager
def own(interface: str, log: Log) -> Iterator[None]:
    """Reserves an interface and sets it up; at the end of the block restores flags and MTU.

    Args:
        interface: Its name.
        log: Where it is told if frames of the bus had no room in the MTU.

    Raises:
        UnreachableError: There is no such interface, or it cannot carry the frames of the bus.
        NotPermittedError: The process may not configure it.
        StateError: Another ecatd uses it.
    """
    with _reserve(interface):
        flags, mtu = _flags(interface), _mtu(interface)
        _make_room(interface, mtu, log)
        _set_flags(interface, flags | _IN_USE)
        try:
            yield
        finally:  # the interface may be gone by now
            with contextlib.suppress(NotPermittedError, UnreachableError):
                _set_flags(interface, flags)
                if mtu < LEAST_MTU:
                    _set_mtu(interface, mtu)


def _make_room(interface: str, mtu: int, log: Log) -> None:
    """Raises an MTU that is too small for the frames of the bus, as `own` also switches it on.

    Raises:
        UnreachableError: The interface refuses.
        NotPermittedError: The process may not do that.
    """
    if mtu >= LEAST_MTU:
        return
    try:
        _set_mtu(interface, LEAST_MTU)
    except UnreachableError as error:
        raise UnreachableError(
            f"{interface} has an MTU of {mtu} bytes, but frames of the bus have up to {LEAST_MTU}, "
            f"and it cannot be raised ({error}): use another interface, or the one below it"
        ) from error
    log.warning(
        f"{interface} had an MTU of {mtu} bytes, but frames of the bus have up to {LEAST_MTU}: "
        f"ecatd has raised it, until it ends"
    )


def _mtu(interface: str) -> int:
    """Returns the MTU of an interface: most bytes of a frame after its Ethernet header."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        try:
            answer = fcntl.ioctl(control, _SIOCGIFMTU, _MTU.pack(interface.encode(), 0))
        except OSError as error:
            raise UnreachableError(f"no MTU of '{interface}': {error.strerror}") from error
        mtu: int = _MTU.unpack(answer)[1]
        return mtu


def _set_mtu(interface: str, mtu: int) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        try:
            with raised(CAP_NET_ADMIN):
                fcntl.ioctl(control, _SIOCSIFMTU, _MTU.pack(interface.encode(), mtu))
        except PermissionError as error:
            raise NotPermittedError(needs_rights(interface)) from error
        except OSError as error:
            raise UnreachableError(error.strerror or str(error)) from error


def switch_on(interface: str) -> None:
    """Sets an interface up that has gone down, or is there again.

    Raises:
        UnreachableError: There is no such interface, or it does not go up.
        NotPermittedError: The process may not do that.
    """
    _set_flags(interface, _flags(interface) | _IN_USE)


def _reserve(interface: str) -> socket.socket:
    """Keeps other daemons off the interface: two masters would disturb each other's slaves.

    The reservation is a bound abstract Unix socket. Its name is unique in the network namespace,
    as interfaces are, and the kernel frees it when the process ends, however that happens.
    """
    reservation = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        reservation.bind(f"\0ecatd.interface.{interface}")
    except OSError as error:
        reservation.close()
        raise StateError(
            f"another ecatd already uses interface '{interface}'; stop it first"
        ) from error
    return reservation


def _has_carrier(interface: str) -> bool:
    """Whether flags and driver say so. Of an interface that was just off, flags may be old."""
    if not _flags(interface) & _IFF_RUNNING:
        return False
    try:
        return ethtool.has_link(interface)
    except OSError:  # not every driver reports it
        return True


def _flags(interface: str) -> int:
    """Returns the flags of an interface (`man 7 netdevice`)."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        request = _FLAGS.pack(interface.encode(), 0)
        try:
            flags: int = _FLAGS.unpack(fcntl.ioctl(control, _SIOCGIFFLAGS, request))[1]
        except OSError as error:
            names = ", ".join(name for _, name in socket.if_nameindex())
            raise UnreachableError(
                f"there is no network interface '{interface}'; this machine has {names}"
            ) from error
        return flags


def _set_flags(interface: str, flags: int) -> None:
    """Sets the flags of an interface; SOEM does not set it up."""
    if flags == _flags(interface):
        return
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        try:
            with raised(CAP_NET_ADMIN):
                fcntl.ioctl(control, _SIOCSIFFLAGS, _FLAGS.pack(interface.encode(), flags))
        except PermissionError as error:
            raise NotPermittedError(needs_rights(interface)) from error
        except OSError as error:
            raise UnreachableError(f"'{interface}' cannot be set up: {error.strerror}") from error
