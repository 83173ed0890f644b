"""Mutated requests: each is refused with a reason, and costs the daemon nothing.

They go through the code that both ways have in common, then to a real daemon: to its control
socket, and over Zenoh.
"""

import random
import socket
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest
import zenoh
from mutations import inputs, mutants

from conftest import Daemon
from ecatd.encoding import LENGTH, frame, pack, unpack
from ecatd.model.errors import EcatError, UsageError
from ecatd.model.requests.bus import SetState
from ecatd.model.requests.eeproms import ReadSii
from ecatd.model.requests.files import CancelFoe, PutFoe, StartFoe, TakeFoe
from ecatd.model.requests.frames import ReadFrames
from ecatd.model.requests.idns import ReadIdn, WriteIdn
from ecatd.model.requests.log import SetLogLevel
from ecatd.model.requests.objects import DescribeObject, SdoRead, SdoWrite
from ecatd.model.requests.parsing import parse_request
from ecatd.model.requests.registers import ReadRegister
from ecatd.model.requests.request import to_map
from ecatd.paths import control_socket
from ecatd.zenoh_keys import bus_key, session_config

pytestmark = pytest.mark.long

REQUESTS = [
    to_map(SdoRead(3, 0x6060)),
    to_map(SdoWrite(0, 0x1C12, b"\x00", 1, complete=True)),
    to_map(SdoWrite(0, 0x6060, value="-3")),
    to_map(SetState("OP")),
    to_map(SetState("PREOP", 2)),
    to_map(SetLogLevel("debug", "mailbox", "'ecatctl' (pid 7, uid 0)")),
    to_map(DescribeObject(0, 0x1018)),
    to_map(ReadRegister("EK1100", 0x0130)),
    to_map(ReadSii(2, 0x40, 8)),
    to_map(ReadIdn(0, 17)),
    to_map(WriteIdn(0, 0x8064, b"\x01\x02", 1, "ecatctl (pid 7, uid 0)")),
    to_map(StartFoe(0, "firmware", True, 5, 64 * "0", 7, boot=False, by="somebody")),
    to_map(StartFoe(1, "log.txt")),
    to_map(PutFoe(1 << 40, 0, b"12345")),
    to_map(TakeFoe(1 << 40, 0)),
    to_map(CancelFoe(1 << 40, "somebody")),
    to_map(ReadFrames("cycle", 100)),
    {"op": "rescan"},
    {"op": "describe"},
    {"op": "states"},
    {"id": "a", "data": b"\x01"},
    {"id": "b", "value": "1.5"},
    {"op": "sdo_read", "slave": [{"a": [1.5, None]}] * 5, "index": 2**63},
]
SEEDS = [pack(request) for request in REQUESTS]
KEYS = [
    "ro/sdo/0/0x1018/0",
    "rw/sdo/0/0x6060/0",
    "rw/state/all",
    "rw/log/mailbox",
    "ro/info",
    "ro/states",
    "rw/x",
    "ro/config",
    "ro/wire",
    "ro/stream",
    "ro/sii/0",
    "ro/idn/0/0/17",
    "rw/idn/0/0/17",
    "rw/foe/0",
    "rw/frames/cycle",
    "rw/foe/1/put",
    "ro/foe/1/0",
]
GROWTH_KIB = 4096
"""What allocators keep, whatever the number of requests."""


def test_r34_mutated_messages_are_requests_or_refused() -> None:
    accepted = refused = 0
    for data in mutants(SEEDS, inputs(50_000), 1):
        try:
            parse_request(unpack(data))
            accepted += 1
        except UsageError:
            refused += 1
    assert min(accepted, refused) > inputs(50_000) / 100


def rss(pid: int) -> int:
    """Resident memory of a process in KiB."""
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1])
    raise AssertionError(f"no process {pid}")


def handles(pid: int) -> int:
    return len(list(Path(f"/proc/{pid}/fd").iterdir()))


@pytest.fixture(scope="module")
def daemon(start_shared: Callable[..., Daemon]) -> Daemon:
    return start_shared("troll", config="[gateway]\nlisten = []\n")


def framed(count: int) -> Iterator[bytes]:
    """Messages with their length in front; some have a wrong one."""
    dice = random.Random(2)
    for data in mutants(SEEDS, count, 2):
        length = len(data) if dice.random() < 0.7 else dice.choice((0, 1, 2**16, 2**31, 2**32 - 1))
        yield LENGTH.pack(length) + data


@pytest.mark.bus
def test_r34_the_control_socket_survives_anything(daemon: Daemon) -> None:
    path = control_socket(Path(daemon.env["ECATD_RUNTIME_DIR"]), daemon.bus)
    pid = daemon.child_pid("ecatd.bus")
    before = 0
    opened = 0
    count = inputs(3_000)
    for number, data in enumerate(framed(count)):
        if number == count // 5:
            before, opened = rss(pid), handles(pid)
        with socket.socket(socket.AF_UNIX) as there, suppress(ConnectionError):
            there.settimeout(30)
            there.connect(str(path))
            there.sendall(data)
            there.shutdown(socket.SHUT_WR)
            while there.recv(65536):
                pass
    assert daemon.child_pid("ecatd.bus") == pid
    assert rss(pid) - before < GROWTH_KIB
    assert handles(pid) <= opened + 2
    answers(daemon)


@pytest.mark.bus
def test_r34_each_request_over_zenoh_gets_an_answer(daemon: Daemon) -> None:
    path = f"{daemon.env['ECATD_RUNTIME_DIR']}/{daemon.bus}/gateway/zenoh"
    pids = [daemon.child_pid(name) for name in ("ecatd.bus", "ecatd.gateway")]
    before: list[int] = []
    count = inputs(2_000)
    dice = random.Random(3)
    settings = session_config("client", {"connect/endpoints": [f"unixsock-stream/{path}"]})
    with zenoh.open(settings) as session:
        for number, data in enumerate(mutants(SEEDS, count, 3)):
            if number == count // 5:
                before = [rss(pid) for pid in pids]
            key = bus_key(daemon.bus, *dice.choice(KEYS).split("/"))
            replies = [
                reply.ok if reply.ok is not None else reply.err
                for reply in session.get(key, payload=data, timeout=60.0)
            ]
            assert len(replies) == 1, (key, data)
            answer = unpack(bytes(replies[0].payload), 1 << 26)
            if "error" in answer:
                assert answer["error"]["message"], (key, data, answer)
                assert answer["error"]["name"] != EcatError.name, (key, data, answer)
    assert [daemon.child_pid(name) for name in ("ecatd.bus", "ecatd.gateway")] == pids
    assert [rss(pid) - was < GROWTH_KIB for pid, was in zip(pids, before, strict=True)] == [
        True
    ] * 2
    answers(daemon)


def answers(daemon: Daemon) -> None:
    """The daemon still does what it is asked."""
    path = control_socket(Path(daemon.env["ECATD_RUNTIME_DIR"]), daemon.bus)
    with socket.socket(socket.AF_UNIX) as there:
        there.settimeout(60)
        there.connect(str(path))
        there.sendall(frame({"op": "states"}))
        assert there.recv(4)
    assert len(daemon.slave_rows("state")) == 8
