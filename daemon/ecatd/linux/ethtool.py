"""Settings of network interfaces that `ethtool` shows: ioctl SIOCETHTOOL (linux/ethtool.h)."""

from __future__ import annotations

import ctypes
import fcntl
import socket
import struct

_SIOCETHTOOL = 0x8946
_REQUEST = struct.Struct("16sP16x")  # ifreq
_COALESCE = struct.Struct("23I")  # ethtool_coalesce
_GET_COALESCE, _SET_COALESCE = 0x0E, 0x0F
_RX_USECS, _TX_USECS, _ADAPTIVE_RX, _ADAPTIVE_TX = 1, 5, 10, 11
_EEE = struct.Struct("10I")  # ethtool_eee
_GET_EEE, _SET_EEE, _EEE_ENABLED = 0x44, 0x45, 5
_VALUE = struct.Struct("2I")  # ethtool_value
_SETTINGS = struct.Struct("3IH6B2IH2B3I")  # ethtool_cmd
_GET_SETTINGS, _SPEED, _DUPLEX, _SPEED_HIGH = 0x01, 3, 4, 12
_DUPLEX_WORDS = {0: "half", 1: "full"}
_GET_FLAGS, _SET_FLAGS, _LRO = 0x25, 0x26, 1 << 15
_GET_GRO, _SET_GRO = 0x2B, 0x2C

OFFLOADS = ("gro", "lro")
"""Offloads for received frames, with the names of `ethtool -K`."""


def speed(interface: str) -> tuple[int, str]:
    """Speed in Mbit/s, 0 if unknown, and `full`, `half` or empty, if unknown.

    Raises:
        OSError: The driver does not report it.
    """
    values = _ask(interface, _SETTINGS, _GET_SETTINGS)
    mbit = values[_SPEED] | values[_SPEED_HIGH] << 16
    return (0 if mbit >= 0xFFFFFFFF else mbit), _DUPLEX_WORDS.get(values[_DUPLEX], "")


def coalescing(interface: str) -> str:
    """How long the card delays its interrupt, such as `rx 3 tx 0 adaptive off`.

    Raises:
        OSError: The driver does not report it.
    """
    values = _ask(interface, _COALESCE, _GET_COALESCE)
    adaptive = "on" if values[_ADAPTIVE_RX] or values[_ADAPTIVE_TX] else "off"
    return f"rx {values[_RX_USECS]} tx {values[_TX_USECS]} adaptive {adaptive}"


def set_coalescing(interface: str, text: str) -> None:
    """Sets what `coalescing` returns.

    Raises:
        OSError: The driver refuses.
    """
    _, receive, _, transmit, _, adaptive = text.split()
    values = list(_ask(interface, _COALESCE, _GET_COALESCE))
    values[0] = _SET_COALESCE
    values[_RX_USECS], values[_TX_USECS] = int(receive), int(transmit)
    if values[_ADAPTIVE_RX] or values[_ADAPTIVE_TX] or adaptive == "on":
        values[_ADAPTIVE_RX] = values[_ADAPTIVE_TX] = int(adaptive == "on")
    _call(interface, bytearray(_COALESCE.pack(*values)))


def offload(interface: str, name: str) -> str:
    """Whether kernel (`gro`) or card (`lro`) try to join received frames: `on` or `off`.

    Raises:
        OSError: The driver does not report it.
    """
    if name == "lro":
        return "on" if _ask(interface, _VALUE, _GET_FLAGS)[1] & _LRO else "off"
    return "on" if _ask(interface, _VALUE, _GET_GRO)[1] else "off"


def set_offload(interface: str, name: str, text: str) -> None:
    """Sets what `offload` returns.

    Raises:
        OSError: The driver refuses.
    """
    if name == "lro":
        flags = _ask(interface, _VALUE, _GET_FLAGS)[1] & ~_LRO
        data = _VALUE.pack(_SET_FLAGS, flags | (_LRO if text == "on" else 0))
    else:
        data = _VALUE.pack(_SET_GRO, int(text == "on"))
    _call(interface, bytearray(data))


def energy_efficient(interface: str) -> str:
    """Whether the port sleeps between frames (EEE, IEEE 802.3az): `on` or `off`.

    Raises:
        OSError: The driver does not report it.
    """
    return "on" if _ask(interface, _EEE, _GET_EEE)[_EEE_ENABLED] else "off"


def set_energy_efficient(interface: str, text: str) -> None:
    """Sets what `energy_efficient` returns.

    Raises:
        OSError: The driver refuses.
    """
    values = list(_ask(interface, _EEE, _GET_EEE))
    values[0], values[_EEE_ENABLED] = _SET_EEE, int(text == "on")
    _call(interface, bytearray(_EEE.pack(*values)))


def _ask(interface: str, shape: struct.Struct, command: int) -> tuple[int, ...]:
    data = bytearray(shape.size)
    data[:4] = command.to_bytes(4, "little")
    _call(interface, data)
    return shape.unpack(data)


def _call(interface: str, data: bytearray) -> None:
    memory = (ctypes.c_char * len(data)).from_buffer(data)
    request = _REQUEST.pack(interface.encode(), ctypes.addressof(memory))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        fcntl.ioctl(control, _SIOCETHTOOL, request)
