"""Ethernet over EtherCAT (ETG.1000.6, "EoE"): the bytes of its messages.

A frame is cut into fragments. All of them but the last have a multiple of 32 bytes, since a
fragment gives its offset in such blocks.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from ipaddress import AddressValueError, IPv4Address, IPv4Interface, IPv4Network, NetmaskValueError

from ecatd.base.errors import UsageError

FRAME_MAX = 1522
"""Most bytes of an Ethernet frame, with a VLAN tag and without its checksum, rounded up."""
FRAME_MIN = 60
"""Fewest bytes of a frame on a cable, without its checksum; shorter ones get zeros."""
NAME_MAX = 31
"""Most bytes of a DNS name; the field has a zero at its end."""

NONE = "none"
"""Stands for no gateway, no DNS server or no name, where None leaves it as it is."""

_HEADER = struct.Struct("<HH")  # type, port and flags; fragment, or result
HEADER_BYTES = _HEADER.size
_BLOCK = 32
_TYPE, _LAST, _TIME_APPENDED = 0x000F, 0x0100, 0x0200
_TIME_BYTES = 4
_SHOWN = 40
"""Most letters of a wrong text in a message."""
_NUMBER_BITS, _OFFSET_BITS = 6, 6
_RESULTS = {
    0x0001: "unspecified error",
    0x0002: "unsupported frame type",
    0x0201: "the slave does not support IP parameters",
    0x0202: "the slave does not support DHCP",
    0x0401: "the slave does not support a filter",
}


class EoeType(IntEnum):
    """Types of messages."""

    FRAGMENT = 0
    TIME_STAMP = 1
    SET_IP = 2
    SET_IP_ANSWER = 3
    SET_FILTER = 4
    SET_FILTER_ANSWER = 5
    GET_IP = 6
    GET_IP_ANSWER = 7


def message(kind: EoeType, value: int = 0, data: bytes = b"") -> bytes:
    """A message that is no fragment; `value` is the result of an answer."""
    return _HEADER.pack(kind | _LAST, value) + data


def type_of(body: bytes) -> int:
    """The type of a message, see `EoeType`; -1 if it is too short for one."""
    return body[0] & _TYPE if len(body) >= HEADER_BYTES else -1


def result_of(body: bytes) -> int:
    """The result in an answer, 0 for success."""
    result: int = _HEADER.unpack_from(body)[1]
    return result


def result_text(result: int) -> str:
    """What a result other than 0 means."""
    return f"EoE result 0x{result:04X}: {_RESULTS.get(result, 'unknown')}"


def fragments(frame: bytes, room: int, number: int) -> Iterator[bytes]:
    """Cuts a frame into messages.

    Args:
        frame: The frame, without its checksum.
        room: Most bytes of a message, header included; at least 36.
        number: A number that is the same in all fragments of the frame, and another one in those
            of the next one.
    """
    step = (room - HEADER_BYTES) // _BLOCK * _BLOCK
    for count, at in enumerate(range(0, len(frame), step)):
        blocks = at // _BLOCK if count else -(-len(frame) // _BLOCK)
        last = _LAST if at + step >= len(frame) else 0
        place = count | blocks << _NUMBER_BITS | (number & 0xF) << (_NUMBER_BITS + _OFFSET_BITS)
        yield _HEADER.pack(EoeType.FRAGMENT | last, place) + frame[at : at + step]


class Reassembly:
    """Joins the fragments of one sender.

    Attributes:
        lost: Number of frames of which fragments were missing or malformed.
    """

    def __init__(self) -> None:
        self.lost = 0
        self._frame = b""
        self._next = 0  # number of the fragment that comes next
        self._number = 0

    def take(self, body: bytes) -> bytes | None:
        """Takes a fragment; returns the frame if it is complete now."""
        if len(body) <= HEADER_BYTES:
            self._drop()
            return None
        flags, place = _HEADER.unpack_from(body)
        count, number = place & 0x3F, place >> (_NUMBER_BITS + _OFFSET_BITS)
        offset = (place >> _NUMBER_BITS & 0x3F) * _BLOCK
        if count == 0:
            if self._next:
                self.lost += 1  # the end of the frame before is missing
            self._frame, self._number = b"", number
        elif (count, number, offset) != (self._next, self._number, len(self._frame)):
            if self._next:  # else its loss is counted already
                self._drop()
            return None
        self._frame += body[HEADER_BYTES:]
        self._next = count + 1
        if len(self._frame) > FRAME_MAX + _TIME_BYTES:
            self._drop()
            return None
        if not flags & _LAST:
            return None
        self._next = 0
        return self._frame[:-_TIME_BYTES] if flags & _TIME_APPENDED else self._frame

    def _drop(self) -> None:
        self.lost += 1
        self._next = 0


@dataclass(frozen=True, slots=True)
class IpParameters:
    """The IP parameters of a slave; None for each that it has not.

    Attributes:
        mac: Its MAC address, as `parse_mac` returns it.
        address: Its IP address.
        mask: The mask of its network.
        gateway: Its default gateway.
        dns: Its DNS server.
        name: Its DNS name.
    """

    mac: str | None = None
    address: IPv4Address | None = None
    mask: IPv4Address | None = None
    gateway: IPv4Address | None = None
    dns: IPv4Address | None = None
    name: str | None = None

    def pack(self) -> bytes:
        """The data of a SET_IP, or of the answer to a GET_IP: always 58 bytes.

        Slaves differ in where they look for a parameter if one before it is left out: some at its
        fixed place, others right behind the parameters that are there. So none before it is left
        out: addresses are zero instead. Zeros follow the last one.

        Raises:
            UsageError: There is no MAC address, which comes first and cannot be zero.
        """
        if self.mac is None:
            raise UsageError("a slave needs a MAC address before it can take an IP address")
        addresses = (self.address, self.mask, self.gateway, self.dns)
        values = (*addresses, self.name)
        used = max((n for n, value in enumerate(values, 1) if value is not None), default=0)
        data = bytes.fromhex(self.mac.replace(":", ""))
        for value in addresses:
            data += int(value or 0).to_bytes(4, "little")
        data += (self.name or "").encode("latin-1").ljust(NAME_MAX + 1, b"\0")
        return struct.pack("<I", (2 << used) - 1) + data

    @staticmethod
    def unpack(data: bytes) -> IpParameters:
        """Reads what `pack` makes; an address of zeros is none.

        Raises:
            UsageError: It is too short.
        """
        flags = int.from_bytes(data[:4], "little")
        sizes = [6, 4, 4, 4, 4, NAME_MAX + 1]
        there = [bool(flags >> n & 1) for n in range(len(sizes))]
        fixed = len(data) >= 4 + sum(sizes)  # the place of each is there, also of those left out
        parts: list[bytes | None] = []
        at = 4
        for size, is_there in zip(sizes, there, strict=True):
            part = data[at : at + size]
            if is_there and len(part) < size and size != sizes[-1]:
                raise UsageError(f"the IP parameters end after {len(data)} bytes")
            parts.append(part if is_there else None)
            at += size if is_there or fixed else 0
        mac, *addresses, name = parts
        address, mask, gateway, dns = (_address(part) for part in addresses)
        return IpParameters(
            mac=None if mac is None else mac.hex(":"),
            address=address,
            mask=mask,
            gateway=gateway,
            dns=dns,
            name=None if name is None else name.split(b"\0", 1)[0].decode("latin-1") or None,
        )

    def to_map(self) -> dict[str, str | None]:
        """The parameters as texts, for messages between processes."""
        addresses = ("address", "mask", "gateway", "dns")
        texts = {key: getattr(self, key) for key in addresses}
        return {
            "mac": self.mac,
            **{key: None if value is None else str(value) for key, value in texts.items()},
            "name": self.name,
        }

    @property
    def text(self) -> str:
        """The parameters in one line, for the log."""
        parts = (("address", self.interface), ("gateway", self.gateway), ("DNS", self.dns))
        named = [f"{name} {value}" for name, value in parts if value]
        return ", ".join([f"MAC {self.mac or 'none'}", *named, *([self.name] if self.name else [])])

    @property
    def interface(self) -> str:
        """Address and size of the network, as `192.168.7.2/24`; empty without an address."""
        if self.address is None:
            return ""
        if self.mask is None:
            return str(self.address)
        try:
            return f"{self.address}/{IPv4Network(f'0.0.0.0/{self.mask}').prefixlen}"
        except NetmaskValueError:
            return f"{self.address} with mask {self.mask}"


def _address(part: bytes | None) -> IPv4Address | None:
    number = int.from_bytes(part or b"", "little")
    return IPv4Address(number) if number else None


def _shown(text: str) -> str:
    letters = "".join(letter if letter.isprintable() else "?" for letter in text)
    return f"'{letters[:_SHOWN]}...'" if len(letters) > _SHOWN else f"'{letters}'"


def parse_mac(text: str) -> str:
    """Reads a MAC address; returns it in small letters.

    Raises:
        UsageError: It is none, or that of a group.
    """
    parts = text.replace("-", ":").lower().split(":")
    try:
        data = bytes(int(part, 16) for part in parts)
    except ValueError:
        data = b""
    if len(data) != 6 or any(len(part) != 2 for part in parts):
        raise UsageError(f"{_shown(text)} is not a MAC address: write it as 02:00:00:00:00:01")
    if data[0] & 1 or not any(data):
        raise UsageError(
            f"{_shown(text)} is not a MAC address of a device: its first byte must be even, and "
            "one byte at least must not be 0"
        )
    return data.hex(":")


def parse_interface(text: str) -> tuple[IPv4Address, IPv4Address]:
    """Reads an address with its network, as `192.168.7.2/24`; returns address and mask.

    Raises:
        UsageError: It is none.
    """
    address, _, size = text.partition("/")
    if not (size.isascii() and size.isdigit() and 1 <= int(size) <= 31):
        raise UsageError(
            f"{_shown(text)} is not an address with its network: write it as 192.168.7.2/24"
        )
    found = IPv4Interface((parse_address(address), int(size)))
    if size != "31" and found.ip in (found.network[0], found.network[-1]):
        raise UsageError(
            f"{_shown(text)} is the network or all of its devices: choose the address of one"
        )
    return found.ip, found.netmask


def parse_address(text: str) -> IPv4Address:
    """Reads an IP address of a device.

    Raises:
        UsageError: It is none.
    """
    try:
        address = IPv4Address(text)
    except AddressValueError:
        raise UsageError(f"{_shown(text)} is not an IP address: write it as 192.168.7.2") from None
    wrong = address.is_multicast or address.is_unspecified or address.is_loopback
    if wrong or address.is_reserved:
        raise UsageError(f"{address} is not an IP address of a device: choose another one")
    return address


def parse_name(text: str) -> str:
    """Reads a DNS name.

    Raises:
        UsageError: It has other characters than letters, digits, `-` and `.`, or too many.
    """
    allowed = all(letter.isalnum() or letter in "-." for letter in text)
    if not text or not allowed or not text.isascii() or len(text) > NAME_MAX:
        raise UsageError(
            f"{_shown(text)} is not a DNS name: write letters, digits, '-' and '.', at most "
            f"{NAME_MAX}"
        )
    return text
