"""The host behind the EoE of a simulated device.

A device without an interface of its own answers ARP (RFC 826), ping (RFC 792) and the echo service
of UDP (RFC 862). A device with one is a cable to it: whatever runs at the interface is the device.
"""

from __future__ import annotations

import struct

from ecatd.base.errors import StateError
from ecatd.base.tap import Tap
from ecatd.etg.eoe import FRAME_MAX, FRAME_MIN, IpParameters

_ETHERNET = struct.Struct(">6s6sH")
_ARP, _IP = 0x0806, 0x0800
_ARP_PACKET = struct.Struct(">HHBBH6s4s6s4s")
_ARP_REQUEST, _ARP_REPLY = 1, 2
_ICMP, _UDP = 1, 17
_ECHO_REQUEST, _ECHO_REPLY = 8, 0
_ECHO_PORT = 7
_AT_ONCE = 4
"""Most frames of an interface that are sent in one step; the mailbox has room for some more."""


class TapHost:
    """Passes all frames to a network interface (TAP) of the simulator, and back.

    Args:
        name: Name of the interface.
    """

    sends_unasked = True

    def __init__(self, name: str) -> None:
        self.ip = IpParameters()
        self._name = name
        self._tap: Tap | None = None

    def set_ip(self, parameters: IpParameters) -> None:
        """Takes other IP parameters; the interface has its own."""
        self.ip = parameters

    def close(self) -> None:
        """Removes the interface."""
        if self._tap is not None:
            self._tap.close()
            self._tap = None

    def receive(self, frame: bytes) -> list[bytes]:
        """Takes a frame of the master."""
        if self._tap is not None:
            self._tap.write(frame)
        return []

    def poll(self) -> list[bytes]:
        """Returns the frames that wait at the interface, which is made if it is not there.

        Raises:
            StateError: The system does not permit it.
        """
        if self._tap is None:
            self._tap = Tap(self._name, None)
        frames: list[bytes] = []
        try:
            while len(frames) < _AT_ONCE and (frame := self._tap.read()) is not None:
                frames.append(frame[:FRAME_MAX])
        except StateError:  # somebody has removed it
            self.close()
        return frames


class EchoHost:
    """Answers ARP, ping and echo at its IP address."""

    sends_unasked = False

    def __init__(self) -> None:
        self.ip = IpParameters()

    def close(self) -> None:
        """Forgets its IP parameters."""
        self.ip = IpParameters()

    def set_ip(self, parameters: IpParameters) -> None:
        """Takes other IP parameters."""
        self.ip = parameters

    def poll(self) -> list[bytes]:
        """It sends nothing unasked."""
        return []

    def receive(self, frame: bytes) -> list[bytes]:
        """Takes a frame of the master; returns the answer."""
        if self.ip.mac is None or self.ip.address is None or len(frame) < _ETHERNET.size:
            return []
        own = bytes.fromhex(self.ip.mac.replace(":", ""))
        receiver, sender, kind = _ETHERNET.unpack_from(frame)
        packet = frame[_ETHERNET.size :]
        if kind == _ARP:
            answer = _answer_arp(packet, own, self.ip.address.packed)
        elif kind == _IP and receiver == own:
            answer = _answer_ip(packet, self.ip.address.packed)
        else:
            answer = b""
        if not answer:
            return []
        return [(_ETHERNET.pack(sender, own, kind) + answer).ljust(FRAME_MIN, b"\0")]


def _answer_arp(packet: bytes, own: bytes, address: bytes) -> bytes:
    if len(packet) < _ARP_PACKET.size:
        return b""
    hardware, protocol, *sizes, operation, mac, sender, _, target = _ARP_PACKET.unpack_from(packet)
    if (hardware, protocol, operation, target) != (1, _IP, _ARP_REQUEST, address):
        return b""
    packed: bytes = _ARP_PACKET.pack(1, _IP, *sizes, _ARP_REPLY, own, address, mac, sender)
    return packed


def _answer_ip(packet: bytes, address: bytes) -> bytes:
    if len(packet) < 20 or packet[0] >> 4 != 4:
        return b""
    header, total = (packet[0] & 0x0F) * 4, int.from_bytes(packet[2:4], "big")
    if packet[16:20] != address or not header <= total <= len(packet):
        return b""
    data = packet[header:total]
    if packet[9] == _ICMP and len(data) >= 8 and data[0] == _ECHO_REQUEST:
        data = bytes([_ECHO_REPLY, 0, 0, 0]) + data[4:]
        data = data[:2] + _checksum(data) + data[4:]
    elif packet[9] == _UDP and len(data) >= 8 and data[2:4] == _ECHO_PORT.to_bytes(2, "big"):
        # A checksum of 0 is none (RFC 768).
        data = data[2:4] + data[:2] + data[4:6] + bytes(2) + data[8:]
    else:
        return b""
    head = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(data), 0, 0, 64, packet[9], 0)
    head += address + packet[12:16]
    return head[:10] + _checksum(head) + head[12:] + data


def _checksum(data: bytes) -> bytes:
    """The checksum of the Internet protocols (RFC 1071)."""
    total: int = sum(struct.unpack(f">{len(data) // 2}H", data[: len(data) // 2 * 2]))
    total += data[-1] << 8 if len(data) % 2 else 0
    while total >> 16:
        total = (total & 0xFFFF) + (total >> 16)
    return (~total & 0xFFFF).to_bytes(2, "big")
