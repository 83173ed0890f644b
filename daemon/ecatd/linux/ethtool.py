"""Settings of network interfaces that `ethtool` shows: ioctl SIOCETHTOOL (linux/ethtool.h)."""

from __future__ import annotations

import ctypes
import fcntl
import socket
import struct
from typing import NamedTuple

_SIOCETHTOOL = 0x8946
_REQUEST = struct.Struct("16sP16x")  # ifreq
_COALESCE = struct.Struct("23I")  # ethtool_coalesce
_GET_COALESCE, _SET_COALESCE = 0x0E, 0x0F
_RX_USECS, _TX_USECS, _ADAPTIVE_RX, _ADAPTIVE_TX = 1, 5, 10, 11
_LINK = struct.Struct("3IH6B2IH2B3I")  # ethtool_cmd
_GET_LINK, _SPEED, _DUPLEX, _SPEED_HIGH = 0x01, 3, 4, 12
_VALUE = struct.Struct("2I")  # ethtool_value
_HAS_LINK = 0x0A
_DUPLEX_WORDS = {0: "half", 1: "full"}


class _Switch(NamedTuple):
    """A setting that is on or off: its commands, and the bit in one of the values."""

    shape: struct.Struct
    get: int
    set: int
    value: int
    bit: int


_SWITCHES = {
    "eee": _Switch(struct.Struct("10I"), 0x44, 0x45, 5, 1),  # eee_enabled of ethtool_eee
    "gro": _Switch(_VALUE, 0x2B, 0x2C, 1, 1),
    "lro": _Switch(_VALUE, 0x25, 0x26, 1, 1 << 15),  # ETH_FLAG_LRO
}

SETTINGS = ("coalescing", *_SWITCHES)
"""`coalescing`: how long the card delays its interrupt, such as `rx 3 tx 0 adaptive off`. Others
are `on` or `off`. `eee`: the port sleeps between frames (IEEE 802.3az). `gro`, `lro`: kernel or
card try to join received frames."""


def speed(interface: str) -> tuple[int, str]:
    """Speed in Mbit/s, 0 if unknown, and `full`, `half` or empty, if unknown.

    Raises:
        OSError: The driver does not report it.
    """
    values = _ask(interface, _LINK, _GET_LINK)
    mbit = values[_SPEED] | values[_SPEED_HIGH] << 16
    return (0 if mbit >= 0xFFFFFFFF else mbit), _DUPLEX_WORDS.get(values[_DUPLEX], "")


def has_link(interface: str) -> bool:
    """Whether an interface has a link now; its flags say that up to a second later.

    Raises:
        OSError: The driver does not report it.
    """
    return bool(_ask(interface, _VALUE, _HAS_LINK)[1])


def read(interface: str, setting: str) -> str:
    """The value of one of `SETTINGS`.

    Raises:
        OSError: The driver does not report it.
    """
    if switch := _SWITCHES.get(setting):
        values = _ask(interface, switch.shape, switch.get)
        return "on" if values[switch.value] & switch.bit else "off"
    values = _ask(interface, _COALESCE, _GET_COALESCE)
    adaptive = "on" if values[_ADAPTIVE_RX] or values[_ADAPTIVE_TX] else "off"
    return f"rx {values[_RX_USECS]} tx {values[_TX_USECS]} adaptive {adaptive}"


def write(interface: str, setting: str, text: str) -> None:
    """Sets what `read` returns.

    Raises:
        OSError: The driver refuses.
    """
    if switch := _SWITCHES.get(setting):
        shape = switch.shape
        values = _ask(interface, shape, switch.get)
        values[0] = switch.set
        values[switch.value] &= ~switch.bit
        values[switch.value] |= switch.bit if text == "on" else 0
    else:
        shape = _COALESCE
        _, receive, _, transmit, _, adaptive = text.split()
        values = _ask(interface, shape, _GET_COALESCE)
        values[0] = _SET_COALESCE
        values[_RX_USECS], values[_TX_USECS] = int(receive), int(transmit)
        if values[_ADAPTIVE_RX] or values[_ADAPTIVE_TX] or adaptive == "on":
            values[_ADAPTIVE_RX] = values[_ADAPTIVE_TX] = int(adaptive == "on")
    _call(interface, bytearray(shape.pack(*values)))


def _ask(interface: str, shape: struct.Struct, command: int) -> list[int]:
    data = bytearray(shape.size)
    data[:4] = command.to_bytes(4, "little")
    _call(interface, data)
    return list(shape.unpack(data))


def _call(interface: str, data: bytearray) -> None:
    memory = (ctypes.c_char * len(data)).from_buffer(data)
    request = _REQUEST.pack(interface.encode(), ctypes.addressof(memory))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        fcntl.ioctl(control, _SIOCETHTOOL, request)
