"""Ethernet over EtherCAT: fragments and IP parameters (ETG.1000.6)."""

import struct
from ipaddress import IPv4Address

import pytest
from hypothesis import given
from hypothesis import strategies as st

from conftest import names
from ecatd.base.errors import UsageError
from ecatd.etg.eoe import (
    FRAME_MAX,
    HEADER_BYTES,
    IpParameters,
    Reassembly,
    fragments,
    parse_interface,
    parse_mac,
    parse_name,
)

frames = st.binary(min_size=14, max_size=FRAME_MAX)
rooms = st.integers(36, 1486)
addresses = st.none() | st.integers(1, 0xFFFFFFFF).map(IPv4Address)
IP = IpParameters("02:00:00:00:00:01", IPv4Address("192.168.7.2"), IPv4Address("255.255.255.0"))


def joined(parts: list[bytes], by: Reassembly) -> list[bytes]:
    return [frame for part in parts if (frame := by.take(part)) is not None]


@given(st.lists(frames, max_size=5), rooms)
def test_a_frame_survives_its_fragments(sent: list[bytes], room: int) -> None:
    by = Reassembly()
    for number, frame in enumerate(sent):
        parts = list(fragments(frame, room, number))
        assert all(len(part) <= room for part in parts)
        assert all((len(part) - HEADER_BYTES) % 32 == 0 for part in parts[:-1])
        assert joined(parts, by) == [frame]
    assert by.lost == 0


@given(st.lists(frames, min_size=1, max_size=4), rooms, st.data())
def test_what_is_missing_never_makes_another_frame(
    sent: list[bytes], room: int, data: st.DataObject
) -> None:
    by = Reassembly()
    parts = [p for number, frame in enumerate(sent) for p in fragments(frame, room, number)]
    kept = data.draw(st.lists(st.booleans(), min_size=len(parts), max_size=len(parts)))
    found = joined([part for part, keep in zip(parts, kept, strict=True) if keep], by)
    assert all(frame in sent for frame in found)


@given(st.lists(st.binary(max_size=100)))
def test_nonsense_is_no_frame_that_is_too_long(bodies: list[bytes]) -> None:
    assert all(len(frame) <= FRAME_MAX + 4 for frame in joined(bodies, Reassembly()))


def test_a_time_stamp_is_no_part_of_the_frame() -> None:
    frame = bytes(range(60))
    (part,) = fragments(frame + b"time", 100, 1)
    flags, place = struct.unpack_from("<HH", part)
    stamped = struct.pack("<HH", flags | 0x0200, place) + part[4:]
    assert Reassembly().take(stamped) == frame


@given(addresses, addresses, addresses, addresses, st.sampled_from([None, "drive-1"]))
def test_ip_parameters_go_both_ways(
    address: IPv4Address | None,
    mask: IPv4Address | None,
    gateway: IPv4Address | None,
    dns: IPv4Address | None,
    name: str | None,
) -> None:
    sent = IpParameters("02:00:00:00:00:01", address, mask, gateway, dns, name)
    assert IpParameters.unpack(sent.pack()) == sent


def test_parameters_are_where_either_kind_of_slave_looks() -> None:
    """Those at fixed places, and those right behind the one before, are the same bytes."""
    data = IpParameters(IP.mac, IP.address, None, None, IPv4Address("10.0.0.1")).pack()
    assert data.hex(" ") == (
        "1f 00 00 00 02 00 00 00 00 01 02 07 a8 c0 00 00 00 00 00 00 00 00 01 00 00 0a" + 32 * " 00"
    )
    only_dns = struct.pack("<I6x16x4s", 0x10, bytes([1, 0, 0, 10]))[:30]
    packed = IpParameters.unpack(struct.pack("<I4s", 0x10, bytes([1, 0, 0, 10])))
    assert packed.dns == IPv4Address("10.0.0.1")
    fixed = struct.pack("<I6x4x4x4x4s32x", 0x10, bytes([1, 0, 0, 10]))
    assert IpParameters.unpack(fixed) == packed
    with pytest.raises(UsageError):
        IpParameters.unpack(only_dns[:6])


@pytest.mark.parametrize(
    ("parse", "text"),
    [
        (parse_mac, "02:00:00:00:00"),
        (parse_mac, "03:00:00:00:00:01"),
        (parse_mac, "00:00:00:00:00:00"),
        (parse_mac, "0x:00:00:00:00:01"),
        (parse_interface, "192.168.7.2"),
        (parse_interface, "192.168.7.2/33"),
        (parse_interface, "192.168.7/24"),
        (parse_interface, "224.0.0.1/24"),
        (parse_name, ""),
        (parse_name, "a b"),
        (parse_name, 32 * "a"),
    ],
)
def test_wrong_parameters_are_named(parse: object, text: str) -> None:
    assert callable(parse)
    with pytest.raises(UsageError) as caught:
        parse(text)
    names(caught.value, text.split("/")[0] or "''")
