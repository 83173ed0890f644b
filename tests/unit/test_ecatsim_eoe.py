"""The EoE of a simulated device: IP parameters, ping and echo."""

import struct
from ipaddress import IPv4Address

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecatd.etg.eoe import (
    HEADER_BYTES,
    EoeType,
    IpParameters,
    Reassembly,
    fragments,
    message,
    result_of,
    type_of,
)
from ecatsim.slave.eoe import EoeServer
from ecatsim.slave.ethernet import EchoHost

OWN, OTHER = bytes.fromhex("020000000001"), bytes.fromhex("020000000002")
IP = IpParameters("02:00:00:00:00:01", IPv4Address("192.168.7.2"), IPv4Address("255.255.255.0"))


@pytest.fixture
def server() -> EoeServer:
    server = EoeServer(EchoHost(), lambda body: None)
    server.start(134)
    assert result_of(server.handle(message(EoeType.SET_IP, data=IP.pack()))[0]) == 0
    return server


def ask(server: EoeServer, frame: bytes) -> bytes | None:
    answers = [a for part in fragments(frame, 128, 3) for a in server.handle(part)]
    by = Reassembly()
    found = [frame for answer in answers if (frame := by.take(answer)) is not None]
    return found[0] if found else None


def packet(protocol: int, data: bytes, to: str = "192.168.7.2") -> bytes:
    head = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(data), 0, 0, 64, protocol, 0)
    ends = IPv4Address("192.168.7.1").packed + IPv4Address(to).packed
    return OWN + OTHER + b"\x08\0" + head + ends + data


def test_a_device_answers_ping_and_echo(server: EoeServer) -> None:
    arp = OWN + OTHER + struct.pack(">HHHBBH", 0x0806, 1, 0x0800, 6, 4, 1)
    arp += OTHER + IPv4Address("192.168.7.1").packed + bytes(6) + IPv4Address("192.168.7.2").packed
    answer = ask(server, arp)
    assert answer is not None
    assert (answer[:12], answer[22:28]) == (OTHER + OWN, OWN)
    ping = bytes([8, 0, 0, 0, 0, 1, 0, 1]) + bytes(1400)
    answer = ask(server, packet(1, ping))
    assert answer is not None
    assert answer[34] == 0
    assert answer[38:] == ping[4:]
    echo = ask(server, packet(17, struct.pack(">HHHH", 4711, 7, 8 + 500, 0) + 500 * b"x"))
    assert echo is not None
    assert echo[34:42] == struct.pack(">HHHH", 7, 4711, 8 + 500, 0)
    assert echo[42:] == 500 * b"x"


@given(st.binary(max_size=120))
def test_nothing_that_a_device_gets_breaks_it(body: bytes) -> None:
    host = EchoHost()
    host.set_ip(IP)
    for frame in (body, OWN + OTHER + b"\x08\0" + body, OWN + OTHER + b"\x08\6" + body):
        for answer in host.receive(frame):
            assert answer[6:12] == OWN


def test_others_get_no_answer(server: EoeServer) -> None:
    assert ask(server, packet(1, bytes([8, 0, 0, 0, 0, 1, 0, 1]), to="192.168.7.3")) is None
    assert ask(server, packet(6, bytes(20))) is None


def test_parameters_are_given_back_and_other_messages_are_refused(server: EoeServer) -> None:
    (answer,) = server.handle(message(EoeType.GET_IP, data=bytes(4)))
    assert type_of(answer) == EoeType.GET_IP_ANSWER
    assert IpParameters.unpack(answer[HEADER_BYTES:]) == IP
    (answer,) = server.handle(message(EoeType.SET_FILTER))
    assert type_of(answer) == EoeType.SET_FILTER_ANSWER
    assert result_of(answer) == 0x0002
    (answer,) = server.handle(message(EoeType.SET_IP, data=b"\xff\0\0\0"))
    assert result_of(answer) == 0x0001
