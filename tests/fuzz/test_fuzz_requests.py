"""Mutated requests: each is refused with a reason, and costs the daemon nothing.

They go through the code that both ways have in common, then to a real daemon: to its control
socket, and over Zenoh.
"""

import random
import shutil
import socket
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import pytest
import zenoh

sys.path.insert(0, str(Path(__file__).parents[1] / "bus"))
from mutations import inputs, mutants
from test_remote_users import Site

from conftest import Daemon
from ecatd.base.errors import EcatError, UsageError
from ecatd.base.paths import control_socket
from ecatd.operations.catalog import parse
from ecatd.operations.encoding import LENGTH, frame, pack, unpack
from ecatd.operations.operation import to_map
from ecatd.operations.query import to_query
from ecatd.operations.zenoh_keys import bus_key, session_config
from request_samples import KEYS, SAMPLES

pytestmark = pytest.mark.long

SEEDS = [
    pack(message)
    for message in (
        *map(to_map, SAMPLES),
        {"id": "a", "data": b"\x01"},
        {"id": "b", "value": "1.5"},
        {"id": "c", "level": "info", "by": "somebody"},
        {"op": "sdo_read", "slave": [{"a": [1.5, None]}] * 5, "index": 2**63},
    )
]
PARAMETERS = [
    "",
    "",
    "",
    *(f"?{query.parameters}" for query in map(to_query, SAMPLES) if query.parameters),
    *(
        "?buckets=1",
        "?pattern=4%2F*;hz=10",
        "?hz=nan",
        "?hz=-1",
        "?pattern=%FF",
        "?count=x",
        "?=;;",
    ),
]
GROWTH_KIB = 4096
"""What allocators keep, whatever the number of requests."""


def test_r34_mutated_messages_are_requests_or_refused() -> None:
    accepted = refused = 0
    for data in mutants(SEEDS, inputs(50_000), 1):
        try:
            parse(unpack(data))
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
    pid = daemon.child_pid("ecatd.server")
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
    assert daemon.child_pid("ecatd.server") == pid
    assert rss(pid) - before < GROWTH_KIB
    assert handles(pid) <= opened + 2
    answers(daemon)


@pytest.mark.bus
def test_r34_each_request_over_zenoh_gets_an_answer(daemon: Daemon) -> None:
    path = f"{daemon.env['ECATD_RUNTIME_DIR']}/{daemon.bus}/gateway/zenoh"
    settings = session_config("client", {"connect/endpoints": [f"unixsock-stream/{path}"]})
    with zenoh.open(settings) as session:
        each_gets_an_answer(daemon, session, [*KEYS, "ro/x", "rw/x"], 3)


@pytest.mark.bus
@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl makes the certificates")
def test_r34_each_request_of_a_user_of_another_machine_gets_an_answer(
    tmp_path: Path, start_daemon: Callable[..., Daemon]
) -> None:
    site = Site(tmp_path, start_daemon)
    with site.session("anna") as session:
        keys = [f"as/anna/{key}" for key in (*KEYS, "ro/rights", "rw/x")]
        each_gets_an_answer(site.daemon, session, keys, 4)


def each_gets_an_answer(
    daemon: Daemon, session: zenoh.Session, keys: Sequence[str], seed: int
) -> None:
    """Asks at all keys, and at random ones, with mutated payloads and parameters."""
    pids = [daemon.child_pid(name) for name in ("ecatd.server", "ecatd.gateway")]
    before: list[int] = []
    count = inputs(2_000)
    dice = random.Random(seed)
    for number, data in enumerate(mutants(SEEDS, count, seed)):
        if number == count // 5:
            before = [rss(pid) for pid in pids]
        key = keys[number] if number < len(keys) else dice.choice(keys)
        selector = bus_key(daemon.bus, *key.split("/")) + dice.choice(PARAMETERS)
        # Half of the requests that only read come without a payload, as they should.
        payload = None if "rw" not in key.split("/") and dice.random() < 0.5 else data
        replies = [
            reply.ok if reply.ok is not None else reply.err
            for reply in session.get(selector, payload=payload, timeout=60.0)
        ]
        assert len(replies) == 1, (selector, payload)
        answer = unpack(bytes(replies[0].payload), 1 << 26)
        if "error" in answer:
            assert answer["error"]["message"], (selector, payload, answer)
            assert answer["error"]["name"] != EcatError.name, (selector, payload, answer)
    assert [daemon.child_pid(name) for name in ("ecatd.server", "ecatd.gateway")] == pids
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
