"""A network interface of this computer whose frames a program reads and writes (TAP)."""

from __future__ import annotations

import errno
import fcntl
import os
import socket
import struct
from ipaddress import IPv4Address

from .errors import StateError
from .process import CAP_NET_ADMIN, raised

_DEVICE = "/dev/net/tun"
_TUNSETIFF = 0x400454CA
_IFF_TAP, _IFF_NO_PI = 0x0002, 0x1000
_SIOCGIFFLAGS, _SIOCSIFFLAGS = 0x8913, 0x8914
_SIOCSIFADDR, _SIOCSIFNETMASK = 0x8916, 0x891C
_IFF_UP = 0x0001
_NAME_BYTES = 16
_READ_MAX = 1 << 16
_REASONS = {
    errno.ENOENT: "this kernel has no TAP interfaces: run `modprobe tun`",
    errno.ENODEV: "this kernel has no TAP interfaces: run `modprobe tun`",
    errno.EBUSY: "another program uses it: choose another name",
    errno.EINVAL: "an interface of another kind has this name: choose another one",
    errno.EPERM: f"the right CAP_NET_ADMIN, or access to {_DEVICE}, is missing",
    errno.EACCES: f"the right CAP_NET_ADMIN, or access to {_DEVICE}, is missing",
}


class Tap:
    """A TAP interface. It exists as long as this object is open, unless somebody made it before.

    Args:
        name: Its name.
        address: Its IP address and the mask of its network; None to leave that to others.

    Raises:
        StateError: The system does not permit it.
    """

    def __init__(self, name: str, address: tuple[IPv4Address, IPv4Address] | None) -> None:
        self.name = name
        self._fd = -1
        if len(name.encode()) >= _NAME_BYTES:
            raise StateError(f"'{name}' is too long for the name of an interface: 15 bytes at most")
        try:
            self._fd = os.open(_DEVICE, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
            wanted = struct.pack(f"{_NAME_BYTES}sH22x", name.encode(), _IFF_TAP | _IFF_NO_PI)
            with raised(CAP_NET_ADMIN):
                fcntl.ioctl(self._fd, _TUNSETIFF, wanted)
                self._set_up()
                if address:
                    self._set_address(address)
        except OSError as error:
            self.close()
            reason = _REASONS.get(error.errno or 0, os.strerror(error.errno or 0))
            raise StateError(
                f"interface {name} for Ethernet over EtherCAT cannot be made: {reason}"
            ) from error

    def _set_address(self, address: tuple[IPv4Address, IPv4Address]) -> None:
        for request, value in zip((_SIOCSIFADDR, _SIOCSIFNETMASK), address, strict=True):
            self._control(request, struct.pack("H2x4s8x", socket.AF_INET, value.packed))

    def _set_up(self) -> None:
        (flags,) = struct.unpack_from("H", self._control(_SIOCGIFFLAGS, b""))
        self._control(_SIOCSIFFLAGS, struct.pack("H", flags | _IFF_UP))

    def _control(self, request: int, value: bytes) -> bytes:
        """Sets or reads a property of the interface (netdevice(7)); returns the answer."""
        data = struct.pack(f"{_NAME_BYTES}s16s", self.name.encode(), value)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
            return fcntl.ioctl(control, request, data)[_NAME_BYTES:]

    def fileno(self) -> int:
        """The file descriptor, which is readable when a frame waits."""
        return self._fd

    def read(self) -> bytes | None:
        """The next frame, or None if none waits.

        Raises:
            StateError: The interface is gone.
        """
        try:
            return os.read(self._fd, _READ_MAX)
        except BlockingIOError:
            return None
        except OSError as error:
            raise StateError(f"interface {self.name} is gone: somebody has removed it") from error

    def write(self, frame: bytes) -> bool:
        """Hands a frame to this computer; returns whether it has taken it."""
        try:
            return os.write(self._fd, frame) == len(frame)
        except OSError:  # it is down, or has no room: a cable would lose the frame, too
            return False

    def close(self) -> None:
        """Removes the interface."""
        fd, self._fd = self._fd, -1
        if fd >= 0:
            os.close(fd)
