"""The gateway over Zenoh: what others hear, and what they may not do."""

import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import zenoh

from conftest import CYCLE_TIME_US, Daemon, free_port, names, naming, stop_process, wait_for
from ecatd.base.errors import NoAnswerError, NotPermittedError, StateError, UsageError
from ecatd.base.paths import control_socket, zenoh_socket
from ecatd.client.remote import Remote
from ecatd.etg.datatypes import DataType
from ecatd.operations.bus import ReadEvents, ReadStates, SetState
from ecatd.operations.eeproms import WriteSii
from ecatd.operations.encoding import LENGTH, frame, pack, unpack
from ecatd.operations.ethernet import WriteIp
from ecatd.operations.log import SetLogLevel
from ecatd.operations.registers import ReadRegister, WriteRegister
from ecatd.operations.zenoh_keys import bus_key, session_config

NONSENSE = 200
pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]


PORT = free_port()


@pytest.fixture(scope="module")
def daemon(start_shared: Callable[..., Daemon]) -> Daemon:
    return start_shared(
        "troll", config=f"[gateway]\nlisten = ['tcp/127.0.0.1:{PORT}']\npublish_hz = 50\n"
    )


@pytest.fixture
def network(daemon: Daemon) -> Iterator[zenoh.Session]:
    """A session as another host would have it."""
    session = zenoh.open(session_config("client", {"connect/endpoints": [f"tcp/127.0.0.1:{PORT}"]}))
    yield session
    session.close()


def local(daemon: Daemon) -> zenoh.Session:
    path = f"{daemon.env['ECATD_RUNTIME_DIR']}/{daemon.bus}/gateway/zenoh"
    return zenoh.open(session_config("client", {"connect/endpoints": [f"unixsock-stream/{path}"]}))


def ask(session: zenoh.Session, key: str, payload: bytes | None = None) -> list[dict[str, object]]:
    answers = []
    for reply in session.get(key, payload=payload, timeout=60.0):
        sample = reply.ok if reply.ok is not None else reply.err
        answers.append(unpack(bytes(sample.payload), 1 << 26))
    return answers


def test_a_gateway_ends_whose_service_was_killed_while_it_started(
    daemon: Daemon, tmp_path: Path
) -> None:
    path = control_socket(Path(daemon.env["ECATD_RUNTIME_DIR"]), daemon.bus)
    mine = tmp_path / "mine"  # the gateway of the daemon has its own socket in the other folder
    mine.mkdir()
    (mine / daemon.bus).mkdir()
    (mine / daemon.bus / path.name).symlink_to(path)
    nobody, gone = os.pipe()
    os.close(nobody)  # whom it would tell that it is ready
    with subprocess.Popen(
        [sys.executable, "-m", "ecatd.gateway", daemon.bus],
        stdin=subprocess.PIPE,
        stdout=gone,
        text=True,
        env={
            **{name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"},
            "ECATD_RUNTIME_DIR": str(mine),
        },
    ) as gateway:
        os.close(gone)
        try:
            gateway.communicate(json.dumps({"parent": os.getpid()}))
        finally:
            gateway.kill()
    assert gateway.returncode == 0


def test_r36_the_network_reads_and_does_not_write(daemon: Daemon, network: zenoh.Session) -> None:
    remote = Remote(daemon.bus, f"tcp/127.0.0.1:{PORT}", 60.0)
    assert [slave.name for slave in remote.describe().slaves][1:3] == ["EK1100", "EL1018"]
    assert remote.sdo_read(0, 0x1018, 1).data == b"\x9a\0\0\0"
    with pytest.raises(NotPermittedError, match=naming("its own machine")):
        remote.sdo_write(0, 0x6060, 0, b"\x09")
    with pytest.raises(NotPermittedError):
        remote.request(SetState("SAFEOP"))
    remote.close()
    wait_for(lambda: {row["text"] for row in daemon.slave_rows("state")} == {"OP"}, daemon)


REMOTE = [
    (lambda remote: Remote(5), "bus | 5"),
    (lambda remote: Remote(remote.bus, 5), "connect | 5"),
    (lambda remote: Remote(remote.bus, timeout="1"), "timeout | '1'"),
    (lambda remote: Remote(remote.bus, identity="x"), "identity | 'x'"),
    (lambda remote: remote.sdo_read(1.5, 0x1018), "slave | float"),
    (lambda remote: remote.sdo_read(0, "0x1018"), "index | str"),
    (lambda remote: remote.sdo_read(0, 0x1018, 256), "subindex | 256 | 255"),
    (lambda remote: remote.sdo_write(0, 0x6060, 0, 8), "data | bytes | 8"),
    (lambda remote: remote.request(ReadRegister(0, "x")), "address | str"),
    (lambda remote: remote.request(WriteRegister(0, 0x400, 1)), "data | bytes | int"),
    (lambda remote: remote.write_idn(0, 47, "1"), "data | bytes | '1'"),
    (lambda remote: remote.request(WriteSii(0, 0, None)), "data | bytes | None"),
    (lambda remote: remote.start_file_read(0, 7), "file | int"),
    (lambda remote: remote.start_file_write(0, "x", "text"), "data | bytes | 'text'"),
    (lambda remote: remote.request(SetState(8)), "state | int"),
    (lambda remote: remote.request(ReadEvents("1")), "since | str"),
    (lambda remote: remote.stream(None, 5), "pattern | None"),
    (lambda remote: remote.stream("0/*", "5"), "rate | '5'"),
    (lambda remote: remote.request(SetLogLevel(1)), "level | int"),
    (lambda remote: remote.request(WriteIp(0, mac=5)), "mac | int"),
]


def test_a_wrong_argument_of_a_request_is_named(
    daemon: Daemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ECATD_RUNTIME_DIR", daemon.env["ECATD_RUNTIME_DIR"])
    with Remote(daemon.bus, timeout=60) as remote:
        for call, said in REMOTE:
            with pytest.raises(UsageError, match=naming(*said.split(" | "))):
                call(remote)  # type: ignore[no-untyped-call]
        assert remote.sdo_write(0, 0x6060, 0, bytearray(b"\x08")).data == b"\x08"


def test_buses_are_found(daemon: Daemon, network: zenoh.Session) -> None:
    (reply,) = network.get("ecat/v1/*/ro/info", timeout=60.0)
    assert str(reply.ok.key_expr) == bus_key(daemon.bus, "ro", "info")
    assert unpack(bytes(reply.ok.payload))["version"]
    (row,) = daemon.ctl_json("buses", "--connect", f"tcp/127.0.0.1:{PORT}")["buses"]
    assert (row["bus"], row["slaves"], row["in_op"]) == (daemon.bus, 8, 8)
    assert row["host"] == socket.gethostname()
    assert row in daemon.ctl_json("buses")["buses"]  # there may be others on this machine
    names(daemon.ctl("buses").stdout, daemon.bus, f"{CYCLE_TIME_US} µs", "8 of 8 in OP")


@pytest.mark.long
def test_a_bus_is_listed_whose_server_does_not_answer(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("line:1")
    path = zenoh_socket(Path(daemon.env["ECATD_RUNTIME_DIR"]), daemon.bus)

    def row() -> dict[str, Any]:
        where = ("--connect", f"unixsock-stream/{path}", "--timeout", "2")
        (found,) = daemon.ctl_json("buses", *where)["buses"]
        assert found["bus"] == daemon.bus
        return found

    server = daemon.child_pid("ecatd.server")
    stop_process(server)
    try:
        silent = row()
    finally:
        os.kill(server, signal.SIGCONT)
    assert silent["error"]["name"] == "timeout"
    names(silent["error"]["message"], "no answer", "bus server")
    wait_for(lambda: row().get("slaves") == 1, daemon)


def test_objects_come_with_their_types(daemon: Daemon, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ECATD_RUNTIME_DIR", daemon.env["ECATD_RUNTIME_DIR"])
    with Remote(daemon.bus) as remote:
        mode = remote.sdo_read(0, 0x6060)
        assert (mode.name, mode.data_type) == ("Mode of operation", DataType.INTEGER8)
        vendor = remote.sdo_read(0, 0x1018, 1)
        assert (vendor.name, vendor.data_type) == ("Vendor ID", DataType.UNSIGNED32)
        written = remote.sdo_write(0, 0x6083, 0, "0x3E8")
        assert written.data == remote.sdo_read(0, 0x6083).data == b"\xe8\3\0\0"
        assert written.data_type == DataType.UNSIGNED32
        with pytest.raises(UsageError, match=naming(900, "INTEGER8")):
            remote.sdo_write(0, 0x6060, 0, "900")
        assert remote.sdo_read(0, 0x6060) == mode, "nothing was written"


def test_a_bus_server_that_does_not_answer(
    start_daemon: Callable[..., Daemon], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever may change things is not told that he may not; nobody minds who is gone."""
    daemon = start_daemon("troll")
    monkeypatch.setenv("ECATD_RUNTIME_DIR", daemon.env["ECATD_RUNTIME_DIR"])
    server = daemon.child_pid("ecatd.server")
    os.kill(server, signal.SIGSTOP)
    try:
        with Remote(daemon.bus, timeout=1.0) as remote:
            with pytest.raises(NoAnswerError, match=naming("1 s", "bus server", "change")):
                remote.request(SetState("OP"))
            with pytest.raises(NoAnswerError, match=naming("1 s", "bus server")):
                remote.request(ReadStates())
        lines = daemon.ctl("info", "--timeout", "1", check=False).stdout.splitlines()
        (silent,) = (line for line in lines if line.startswith("no answer"))
        names(silent, f"'{daemon.bus}'", "shared memory")
        (wire_time,) = (line for line in lines if line.startswith("wire time"))
        names(wire_time, "unknown")
        daemon.process.terminate()
    finally:
        os.kill(server, signal.SIGKILL)
    daemon.process.wait()
    assert "never retrieved" not in daemon.log


def test_r37_a_gateway_that_ends_before_it_has_its_answers(
    start_daemon: Callable[..., Daemon],
) -> None:
    """The bus server finds the connection broken while it answers, and thinks nothing of it."""
    daemon = start_daemon("troll")
    path = control_socket(Path(daemon.env["ECATD_RUNTIME_DIR"]), daemon.bus)
    with socket.socket(socket.AF_UNIX) as gateway:
        gateway.connect(str(path))
        gateway.shutdown(socket.SHUT_RD)  # what is written to it fails; it has not said farewell
        gateway.send(frame({"id": 1, "op": "read_states"}))
        assert gateway.recv(1) == b""
        # The other side has closed it when this fails, too.
        with pytest.raises(ConnectionError):
            while True:
                gateway.send(frame({"id": 2, "op": "read_states"}))
    assert daemon.slave_rows("state")
    assert daemon.stop() == 0
    assert "Traceback" not in daemon.log


def memory(pid: int) -> int:
    """Resident memory of a process in bytes."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def test_r34_a_gateway_that_asks_and_does_not_read(daemon: Daemon) -> None:
    """It gets no more answers, the bus server does not grow, and others are served."""
    path = control_socket(Path(daemon.env["ECATD_RUNTIME_DIR"]), daemon.bus)
    server = daemon.child_pid("ecatd.server")
    before, asked, request = memory(server), 0, frame({"id": 1, "op": "describe"})
    with socket.socket(socket.AF_UNIX) as gateway:
        gateway.connect(str(path))
        gateway.settimeout(3)
        with pytest.raises(TimeoutError):
            while asked < 100_000:  # some gigabytes of answers
                asked += 1
                gateway.sendall(request)
        assert memory(server) - before < 64 << 20
        assert daemon.slave_rows("state")
        gateway.settimeout(None)
        gateway.shutdown(socket.SHUT_WR)
        answers = 0
        while data := gateway.recv(1 << 20):
            answers += len(data)
        assert answers > 100 * len(request)  # it is served again when it reads


def test_r34_who_reads_eeproms_without_end_keeps_nobody_from_changes(daemon: Daemon) -> None:
    path = control_socket(Path(daemon.env["ECATD_RUNTIME_DIR"]), daemon.bus)
    reads = [{"op": "read_sii", "slave": 0, "word": 0, "count": 128} for _ in range(40)]
    change = {"op": "sdo_write", "slave": 0, "index": 0x6060, "data": b"\x03"}
    asked = [{"id": number, **request} for number, request in enumerate([*reads, change])]
    answers: dict[int, dict[str, Any]] = {}
    with socket.socket(socket.AF_UNIX) as gateway, gateway.makefile("rb") as replies:
        gateway.connect(str(path))
        gateway.sendall(b"".join(map(frame, asked)))
        while len(answers) < len(asked):
            answer = unpack(replies.read(LENGTH.unpack(replies.read(LENGTH.size))[0]))
            if "id" in answer:  # the others are events, such as that of the change
                answers[answer["id"]] = answer
    read = [len(answers[number].get("ok", {"data": b""})["data"]) for number in range(40)]
    assert read == 24 * [256] + 16 * [0]
    errors = [answers[number]["error"] for number in range(24, 40)]
    assert {error["name"] for error in errors} == {"busy"}
    assert "24 requests waiting" in errors[0]["message"]
    assert "ok" in answers[40], answers[40]


def test_r34_too_many_gateways(daemon: Daemon) -> None:
    path = control_socket(Path(daemon.env["ECATD_RUNTIME_DIR"]), daemon.bus)
    with contextlib.ExitStack() as stack:
        there = [stack.enter_context(socket.socket(socket.AF_UNIX)) for _ in range(20)]
        for gateway in there:
            gateway.connect(str(path))
        assert there[-1].recv(1) == b""
        assert daemon.slave_rows("state")


def test_values_and_events_are_published(daemon: Daemon, network: zenoh.Session) -> None:
    heard: dict[str, list[dict[str, object]]] = defaultdict(list)

    def hear(sample: zenoh.Sample) -> None:
        heard[str(sample.key_expr)].append(unpack(bytes(sample.payload)))

    subscriber = network.declare_subscriber(bus_key(daemon.bus, "ro", "**"), hear)
    blinking = heard[bus_key(daemon.bus, "ro", "pdo", "2", "0x6040:01")]
    events = heard[bus_key(daemon.bus, "ro", "event")]
    wait_for(lambda: bool(blinking), daemon)
    assert blinking[0]["raw"] in (0, 1)
    assert blinking[0]["name"] == "Input"
    daemon.ctl("state", "3", "SAFEOP", "--yes")
    states = ("al_state", 3, "slave 3 (EL2008): SAFEOP")
    wait_for(
        lambda: states in [(x["event"], x.get("slave"), x.get("text")) for x in events], daemon
    )
    subscriber.undeclare()
    daemon.ctl("state", "3", "OP")


def test_lines_of_the_log_are_published_without_values_of_objects(
    daemon: Daemon, network: zenoh.Session
) -> None:
    heard: list[dict[str, object]] = []
    subscriber = network.declare_subscriber(
        bus_key(daemon.bus, "ro", "log", "lines"),
        lambda sample: heard.append(unpack(bytes(sample.payload))),
    )
    before = len(daemon.log)
    # Somebody has heard a line, so the subscription has reached the gateway.
    wait_for(lambda: daemon.ctl("log-level", "dc", "info") and bool(heard), daemon)
    daemon.ctl("sdo-write", "0", "0x6060", "0", "8")
    daemon.ctl("state", "3", "SAFEOP", "--yes")
    daemon.ctl("state", "3", "OP")
    wait_for(lambda: any(line["event"] == "al_state" for line in heard), daemon)
    wait_for(lambda: any("0x6060:00" in str(line["text"]) for line in heard), daemon)
    subscriber.undeclare()
    (change,) = (line for line in heard if "0x6060:00" in str(line["text"]))
    assert (change["level"], change["part"], change["slaves"]) == ("notice", "service", [])
    names(change["text"], "somebody on this machine")
    assert re.search(r"0x6060:00.*changed from .* to 8 by", daemon.log[before:])
    assert [3] in [line["slaves"] for line in heard if line["event"] == "al_state"]
    numbers = [line["sequence"] for line in heard]
    assert numbers == [*range(int(str(numbers[0])), int(str(numbers[-1])) + 1)]


def test_statistics_are_published_while_somebody_subscribes(
    daemon: Daemon, network: zenoh.Session
) -> None:
    heard: list[dict[str, object]] = []
    subscriber = network.declare_subscriber(
        bus_key(daemon.bus, "ro", "stats"),
        lambda sample: heard.append(unpack(bytes(sample.payload), 1 << 26)),
    )
    wait_for(lambda: bool(heard) and heard[-1] != heard[0], daemon)
    subscriber.undeclare()
    (asked,) = ask(network, bus_key(daemon.bus, "ro", "stats"))
    assert heard[0].keys() == asked.keys()


def test_the_bus_description_is_published_when_a_reload_has_changed_it(
    start_daemon: Callable[..., Daemon],
) -> None:
    config = "[gateway]\nlisten = []\n"
    daemon = start_daemon("troll", config=config)
    key = bus_key(daemon.bus, "ro", "slaves")
    events: list[object] = []
    heard: list[dict[str, object]] = []
    with local(daemon) as session:
        session.declare_subscriber(
            bus_key(daemon.bus, "ro", "event"),
            lambda sample: events.append(unpack(bytes(sample.payload))["event"]),
        )
        session.declare_subscriber(
            key, lambda sample: heard.append(unpack(bytes(sample.payload), 1 << 26))
        )
        (before,) = ask(session, key)
        same, limited = "[log]\ndc = 'debug'\n", "[[signal]]\nslave = 0\nentry = '0x6071:00'\n"
        for text in (config + same, config + same + limited + "maximum = 20\n"):
            count = events.count("configuration")
            daemon.config_file.write_text(text)
            daemon.process.send_signal(signal.SIGHUP)
            wait_for(lambda: events.count("configuration") > count, daemon)  # noqa: B023
        wait_for(lambda: bool(heard), daemon)
        (after,) = ask(session, key)
    assert before != after
    assert heard == [after]


def test_r38_a_change_that_arrives_twice_is_carried_out_once(daemon: Daemon) -> None:
    session = local(daemon)
    key = bus_key(daemon.bus, "rw", "sdo", "0", "0x6060", "0x00")
    payload = pack({"id": "same", "data": b"\x09"})
    assert "error" not in ask(session, key, payload)[0]
    daemon.ctl("sdo-write", "0", "0x6060", "0", "8")
    assert "error" not in ask(session, key, payload)[0]
    assert daemon.ctl("sdo-read", "0", "0x6060").stdout == "0x08 8\n"
    session.close()


def test_r38_a_change_that_arrives_again_at_another_gateway_is_carried_out_once(
    start_daemon: Callable[..., Daemon],
) -> None:
    daemon = start_daemon("troll")
    key = bus_key(daemon.bus, "rw", "sdo", "0", "0x6060", "0x00")
    payload = pack({"id": "same", "data": b"\x09"})
    session = local(daemon)
    answer = ask(session, key, payload)[0]
    session.close()
    daemon.ctl("sdo-write", "0", "0x6060", "0", "8")
    gateway = daemon.child_pid("ecatd.gateway")
    os.kill(gateway, signal.SIGKILL)
    wait_for(lambda: daemon.ctl("info", check=False).returncode == 0, daemon)
    assert daemon.child_pid("ecatd.gateway") != gateway
    session = local(daemon)
    assert ask(session, key, payload)[0] == answer
    assert daemon.ctl("sdo-read", "0", "0x6060").stdout == "0x08 8\n"
    session.close()


@pytest.mark.parametrize("change_id", ["x", ["x"], ["x", 1], {}, 7])
def test_a_gateway_that_names_no_user_for_a_change(daemon: Daemon, change_id: object) -> None:
    path = control_socket(Path(daemon.env["ECATD_RUNTIME_DIR"]), daemon.bus)
    with socket.socket(socket.AF_UNIX) as gateway:
        gateway.connect(str(path))
        body = {"op": "set_log_level", "level": "debug", "part": "dc", "by": "test"}
        gateway.sendall(frame({"id": 1, "change_id": change_id, **body}))
        (length,) = LENGTH.unpack(gateway.recv(LENGTH.size, socket.MSG_WAITALL))
        error = unpack(gateway.recv(length, socket.MSG_WAITALL))["error"]
        names(error["message"], "'change_id'", "user", "id")


@pytest.mark.parametrize(
    ("key", "what"),
    [
        ("ro/sdo/0/0x1018/0?foo=1", "'foo' | parameter"),
        ("ro/sdo/0/0x1018/0?complete=2", "'complete=2' | complete=1 | complete=0"),
        ("ro/info?complete=1", "'complete'"),
    ],
)
def test_parameters_that_are_not_known(daemon: Daemon, key: str, what: str) -> None:
    session = local(daemon)
    (answer,) = ask(session, bus_key(daemon.bus, *key.split("/")))
    names(answer["error"]["message"], *what.split(" | "))
    session.close()


@pytest.mark.parametrize(
    ("key", "payload", "what"),
    [
        ("rw/sdo/0/0x6060/0", {"id": "a", "data": b"\x01", "slave": 3}, "'slave' | key"),
        ("rw/sdo/0/0x6060/0", {"data": b"\x01"}, "'id'"),
        ("rw/sdo/0/0x6060/0", {"id": "b"}, "'data' | 'value'"),
        ("rw/sdo/0/0x6060/0", {"id": "c", "data": b"\x01", "x": 1}, "'x'"),
        ("rw/sdo/0/zzz/0", {"id": "d", "data": b"\x01"}, "'zzz' | index"),
        ("rw/state/all", {"id": "e", "state": "OP", "op": "sdo_write"}, "'op' | key"),
        ("rw/state/all", {"id": "f", "state": "RUN"}, "'RUN' | AL state"),
        ("rw/nonsense", {"id": "g"}, "rw/nonsense | key"),
        ("ro/nonsense", None, "ro/nonsense | key"),
        ("ro/sdo/99/0x6060/0", None, "slave 99"),
        ("rw/state/all", b"\xc1\xc1", "msgpack"),
        ("rw/state/all", b"\0" * 70000, "too long"),
    ],
)
def test_wrong_requests_are_answered_and_change_nothing(
    daemon: Daemon, key: str, payload: dict[str, object] | bytes | None, what: str
) -> None:
    session = local(daemon)
    data = pack(payload) if isinstance(payload, dict) else payload
    (answer,) = ask(session, bus_key(daemon.bus, *key.split("/")), data)
    names(answer["error"]["message"], *what.split(" | "))  # type: ignore[index]
    session.close()


def test_remote_errors_have_their_class(daemon: Daemon, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ECATD_RUNTIME_DIR", daemon.env["ECATD_RUNTIME_DIR"])
    with Remote(daemon.bus) as remote:
        with pytest.raises(StateError, match=naming("slave 99")):
            remote.sdo_read(99, 0x1018)
        with pytest.raises(UsageError, match=naming("'RUN'", "AL state")):
            remote.request(SetState("RUN"))


def test_a_port_in_use_costs_only_the_network(
    daemon: Daemon, start_daemon: Callable[..., Daemon]
) -> None:
    second = start_daemon("line:1", config=f"[gateway]\nlisten = ['tcp/127.0.0.1:{PORT}']\n")
    (told,) = (line for line in second.log.splitlines() if f"tcp/127.0.0.1:{PORT}" in line)
    names(told, "not listening", "in use")
    assert len(second.slave_rows("slaves")) == 1


def test_r40_only_what_is_configured_listens(daemon: Daemon) -> None:
    """No multicast scouting, nothing on other addresses: seen in the kernel's own list."""
    from pathlib import Path

    pid = daemon.child_pid("ecatd.gateway")
    inodes = set()
    for link in Path(f"/proc/{pid}/fd").iterdir():
        target = str(link.readlink())
        if target.startswith("socket:["):
            inodes.add(target[8:-1])
    found = []
    for table in ("tcp", "tcp6", "udp", "udp6"):
        for line in Path(f"/proc/{pid}/net/{table}").read_text().splitlines()[1:]:
            fields = line.split()
            listening = table.startswith("udp") or fields[3] == "0A"
            if fields[9] in inodes and listening:
                found.append((table, fields[1]))
    assert ("tcp", f"0100007F:{PORT:04X}") in found
    assert len(found) == 2, "the other one is that of Zenoh, behind the addresses of the gateway"
    assert {(table, place[:9]) for table, place in found} == {("tcp", "0100007F:")}


def test_nonsense_again_and_again_does_not_fill_the_log(daemon: Daemon) -> None:
    path = control_socket(Path(daemon.env["ECATD_RUNTIME_DIR"]), daemon.bus)
    for _ in range(NONSENSE):
        with socket.socket(socket.AF_UNIX) as client:
            client.connect(str(path))
            client.sendall(b"\xff\xff\xff\x7f")
            with suppress(ConnectionError):
                assert client.recv(1) == b"", "it has lost its connection"
    assert daemon.stop() == 0
    lines = [line for line in daemon.log.splitlines() if "control socket" in line]
    assert 0 < len(lines) < NONSENSE / 4
    numbers = [re.search(r"and (\d+) more", line) for line in lines]
    assert sum(1 + (int(found[1]) if found else 0) for found in numbers) == NONSENSE


@pytest.mark.parametrize("killed", [False, True])
def test_no_file_stays_when_the_daemon_ends(
    start_daemon: Callable[..., Daemon], *, killed: bool
) -> None:
    daemon = start_daemon("line:1")
    folder = Path(daemon.env["ECATD_RUNTIME_DIR"]) / daemon.bus
    assert zenoh_socket(folder.parent, daemon.bus).exists()
    if killed:
        os.kill(daemon.child_pid("ecatd.gateway"), signal.SIGKILL)
    assert daemon.stop() == 0
    assert not folder.exists()
