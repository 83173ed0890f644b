"""The control socket: what it understands, what it refuses, and that nobody can hold it up."""

import contextlib
import json
import os
import socket
import stat
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from conftest import names, naming
from ecatd.base.errors import NoAnswerError, NotPermittedError, StateError, UsageError
from ecatd.base.timeouts import Timeout
from ecatsim import DataType, Device, Entry, Mailbox, Pdo, Rig, Simulation
from ecatsim.control import Server, client, sockets
from ecatsim.control.server import MAX_CONNECTIONS, MAX_REQUEST


class Analog(Device):
    vendor, product, revision, order = 1, 2, 3, "Analog"
    mailbox = Mailbox()
    tx_pdos = (
        Pdo(
            0x1A00,
            "Inputs",
            3,
            [
                Entry(0x6000, 1, "Value", DataType.INTEGER16, 16),
                Entry(0x6000, 2, "Level", DataType.REAL32, 32),
            ],
        ),
    )

    def describe(self):
        self.dictionary.variable(0x2000, "Broken", DataType.UNSIGNED8).on_read = self._broken

    def _broken(self):
        raise KeyError("oops")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv(sockets.FOLDER_VARIABLE, str(tmp_path / "run"))
    return tmp_path / "run"


@pytest.fixture
def simulation(folder):
    simulation = Simulation(Rig("bench", [Analog(), Analog()]))
    yield simulation
    simulation.close()


@pytest.fixture
def stopped():
    return []


@pytest.fixture
def server(simulation, stopped):
    server = Server(simulation, "me", "eth7", lambda: stopped.append(True))
    yield server
    server.close()


class Peer:
    """A client that speaks bytes; the server runs when it waits."""

    def __init__(self, server):
        self.server = server
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.connect(str(server.path))
        self.socket.setblocking(False)
        self.received = b""

    def line(self):
        """The next answer, None if the server has closed."""
        for _ in range(1000):
            if b"\n" in self.received:
                line, _, self.received = self.received.partition(b"\n")
                return json.loads(line)
            self.server.serve()
            try:
                piece = self.socket.recv(1 << 16)
            except BlockingIOError:
                continue
            except ConnectionResetError:
                return None
            if not piece:
                return None
            self.received += piece
        raise AssertionError("no answer")

    def ask(self, command, **arguments):
        request = {"schema": 1, "command": command, "arguments": arguments}
        self.socket.sendall(json.dumps(request).encode() + b"\n")
        return self.line()

    def close(self):
        self.socket.close()


@pytest.fixture
def peer(server):
    peer = Peer(server)
    yield peer
    peer.close()


def message(reply):
    assert set(reply) == {"schema", "error"}
    return reply["error"]["message"]


def test_status(peer):
    reply = peer.ask("status")
    assert reply["schema"] == 1
    result = reply["result"]
    assert (result["name"], result["pid"], result["rig"]) == ("me", os.getpid(), "bench")
    assert result["interface"] == "eth7"
    assert [slave["name"] for slave in result["slaves"]] == ["Analog", "Analog"]
    assert result["slaves"][1]["state"] == "INIT"


def test_a_fault_strikes_and_is_listed(peer, simulation):
    assert peer.ask("al-error", slave=1, code=0x1D)["result"] == {"id": 1}
    assert peer.ask("status")["result"]["slaves"][1]["state"] == "INIT+ERROR"
    assert simulation.segment.read(1, 0x0134, 2) == b"\x1d\x00"
    (fault,) = peer.ask("faults")["result"]["faults"]
    assert (fault["kind"], fault["parameters"]) == ("al-error", {"slave": 1, "code": 0x1D})
    assert (fault["struck"], fault["done"]) == (1, True)
    assert peer.ask("clear", id=1)["result"] == {"cleared": 1}
    assert peer.ask("faults")["result"]["faults"] == []
    names(message(peer.ask("clear", id=1)), "fault 1", "`faults`")


def test_values(peer, simulation):
    assert peer.ask("set", slave=1, object="0x6000:01", value="-5")["result"] == {}
    assert simulation.rig.devices[1][0x6000, 1] == -5
    answer = peer.ask("get", slave=1, object="6000:01")["result"]
    assert answer == {"value": -5, "type": "INTEGER16", "name": "Value"}
    peer.ask("set", slave=1, object="0x6000:02", value="2.5")
    assert peer.ask("get", slave=1, object="0x6000:2")["result"]["value"] == 2.5
    peer.ask("set", slave=1, object="0x1008", value="Better")
    assert peer.ask("get", slave=1, object="0x1008")["result"]["value"] == "Better"


def test_registers(peer):
    assert peer.ask("registers", slave=0, address=0, count=2)["result"] == {"data": "1100"}
    names(message(peer.ask("registers", slave=0, address=0xFFFF, count=2)), "register", "0xFFFF")


def served(server, call):
    """What a call of a client returns; the server runs until it does."""
    with ThreadPoolExecutor(1) as pool:
        result = pool.submit(call)
        while not result.done():
            server.serve()
        return result.result()


def test_a_late_answer_is_not_taken_for_that_of_the_next_request(server, monkeypatch):
    monkeypatch.setattr(client, "_PATIENCE", Timeout(0.01))
    simulator = client.Simulator("me")
    with pytest.raises(NoAnswerError):
        simulator.get(0, 0x1018, 1)
    monkeypatch.undo()
    monkeypatch.setenv(sockets.FOLDER_VARIABLE, str(server.path.parent))
    assert served(server, lambda: simulator.registers(0, 0, 2)) == b"\x11\x00"
    simulator.close()


def test_a_client_waits_until_those_before_it_are_accepted(server):
    others = []
    with contextlib.suppress(BlockingIOError):
        while True:
            others.append(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK))
            others[-1].connect(str(server.path))
    simulator = served(server, lambda: client.Simulator("me"))
    assert served(server, simulator.status).name == "me"
    for item in (*others, simulator):
        item.close()


def test_stop(peer, stopped):
    assert peer.ask("stop")["result"] == {}
    assert stopped == [True]


@pytest.mark.parametrize(
    ("command", "arguments", "tokens"),
    [
        ("fly", {}, "'fly' | status | faults"),
        ("status", {"x": 1}, "status: | parameter | 'x'"),
        ("get", {"slave": 0}, "get: | object | missing | INDEX:SUBINDEX"),
        ("get", {"slave": 7, "object": "0x6000:01"}, "slave 7 | 0 | 1"),
        ("get", {"slave": 0, "object": "x"}, "'x' | INDEX:SUBINDEX | 0x6000:01"),
        ("get", {"slave": 0, "object": "0x7777:01"}, "slave 0 (Analog) | object | 0x7777:01"),
        ("get", {"slave": 0, "object": "0x6000:03"}, "slave 0 (Analog) | entry | 0x6000:03"),
        ("get", {"slave": True, "object": "1"}, "get: | slave | True | 0"),
        (
            "set",
            {"slave": 0, "object": "0x6000:01", "value": "40000"},
            "40000 | INTEGER16 | -32768 | 32767",
        ),
        (
            "set",
            {"slave": 0, "object": "0x6000:01", "value": "blue"},
            "'blue' | INTEGER16",
        ),
        (
            "set",
            {"slave": 0, "object": "0x6000:02", "value": "1e300"},
            "'1e300' | REAL32",
        ),
        (
            "set",
            {"slave": 0, "object": "0x6000:02", "value": "nan"},
            "'nan' | REAL32",
        ),
        (
            "set",
            {"slave": 0, "object": "0x1C13:00", "value": "9"},
            "0x1C13 | process data | master",
        ),
        ("al-error", {"slave": 5, "code": 1}, "al-error: | slave 5 | 0 | 1"),
        ("al-error", {"slave": 0, "code": 0}, "al-error: | code | 0x0000 | 0x0001"),
        ("al-error", {"slave": 0, "code": 1, "state": "OP"}, "al-error: | state | 'OP' | PREOP"),
        ("al-error", {"slave": 0, "code": 1, "every": 0}, "al-error: | every | 0 | 1"),
    ],
)
def test_wrong_requests_are_one_sentence(peer, command, arguments, tokens):
    text = message(peer.ask(command, **arguments))
    names(text, *tokens.split(" | "))
    assert "\n" not in text
    assert "result" in peer.ask("status"), "the connection goes on"


@pytest.mark.parametrize(
    ("line", "tokens"),
    [
        (b"[" * 50_000, "request | JSON"),
        (b"[]", 'request | map | "schema": 1'),
        (b'{"schema": 1, "x": 1}', "'x' | arguments | command | schema"),
        (b'{"schema": 1, "command": 5}', "text | command"),
    ],
)
def test_what_is_no_request(peer, stopped, line, tokens):
    peer.socket.setblocking(True)
    peer.socket.sendall(line + b"\n")
    peer.socket.setblocking(False)
    names(message(peer.line()), *tokens.split(" | "))
    assert "result" in peer.ask("status")
    assert stopped == []


def test_a_request_that_never_ends_is_dropped(server, peer):
    other = Peer(server)
    with pytest.raises((BrokenPipeError, ConnectionResetError, StopIteration)):
        for _ in range(10 * MAX_REQUEST // 4096):
            try:
                other.socket.send(bytes(4096).replace(b"\0", b"x"))
            except BlockingIOError:
                server.serve()
        raise StopIteration
    names(message(other.line()), f"{MAX_REQUEST} bytes")
    assert other.line() is None
    assert "result" in peer.ask("status")
    other.close()


def test_requests_in_pieces_and_together(peer):
    request = b'{"schema": 1, "command": "faults"}\n'
    for byte in request:
        assert peer.received == b""
        peer.socket.send(bytes([byte]))
        peer.server.serve()
    assert "result" in peer.line()
    peer.socket.send(request * 3)
    assert [set(peer.line()) for _ in range(3)] == [{"schema", "result"}] * 3


def test_one_request_a_step_of_each_client(peer, simulation):
    request = b'{"schema": 1, "command": "al-error", "arguments": {"slave": 0, "code": 1}}\n'
    peer.server.serve()
    peer.socket.send(request * 5)
    for struck in range(1, 6):
        peer.server.serve()
        assert len(simulation.faults.list()) == struck


def test_a_client_that_sends_and_goes(server, simulation):
    peer = Peer(server)
    peer.socket.sendall(
        b'{"schema": 1, "command": "al-error", "arguments": {"slave": 0, "code": 1}}\n'
    )
    peer.close()
    for _ in range(5):
        server.serve()
    (fault,) = simulation.faults.list()
    assert fault.struck == 1


def test_a_client_that_takes_no_answers_holds_nobody_up(server, peer):
    greedy = Peer(server)
    arguments = b'{"slave": 0, "address": 0, "count": 4096}'
    request = b'{"schema": 1, "command": "registers", "arguments": ' + arguments + b"}\n"
    sent = 0
    for _ in range(2000):
        server.serve()
        try:
            sent += greedy.socket.send(request)
        except BlockingIOError:
            break
    else:
        raise AssertionError("the server takes requests without end")
    assert sent < 4 * 1024 * 1024
    assert "result" in peer.ask("status")
    greedy.close()


def test_too_many_clients_make_room(server):
    peers = []
    for _ in range(MAX_CONNECTIONS + 3):
        peer = Peer(server)
        assert "result" in peer.ask("faults")
        peers.append(peer)
    assert [peer.line() for peer in peers[:3]] == [None, None, None], "the oldest are gone"
    assert all("result" in peer.ask("faults") for peer in peers[3:])
    for peer in peers:
        peer.close()


def test_a_defect_of_a_device_does_not_end_the_simulation(peer, capsys):
    text = message(peer.ask("get", slave=0, object="0x2000"))
    names(text, "defect", "KeyError: 'oops'", "stderr of ecatsim")
    assert "KeyError" in capsys.readouterr().err
    assert "result" in peer.ask("status")


@settings(
    max_examples=300,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(
    line=st.one_of(
        st.binary(max_size=200),
        st.fixed_dictionaries(
            {"schema": st.just(1), "command": st.sampled_from(["get", "al-error", "registers"])},
            optional={
                "arguments": st.dictionaries(
                    st.sampled_from(["slave", "object", "code", "address", "count", "state"]),
                    st.one_of(
                        st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=9)
                    ),
                )
            },
        ).map(lambda document: json.dumps(document).encode()),
    )
)
def test_whatever_comes_is_answered(peer, line):
    line = line.replace(b"\n", b"")
    peer.socket.send(line + b"\n")
    assert set(peer.line()) in ({"schema", "error"}, {"schema", "result"})


# --- sockets ---------------------------------------------------------------------------------


def test_only_the_user_may_connect(server):
    assert stat.S_IMODE(server.path.stat().st_mode) == 0o600
    assert stat.S_IMODE(server.path.parent.stat().st_mode) & 0o077 == 0


def test_the_socket_goes_with_the_server(simulation, folder):
    server = Server(simulation)
    assert server.name == str(os.getpid())
    assert sockets.names() == [server.name]
    server.close()
    assert list(folder.iterdir()) == []


def test_a_name_is_taken_only_while_its_simulator_runs(simulation, server):
    with pytest.raises(StateError, match=naming("'me'", "running already")):
        Server(simulation, "me")
    left = sockets.path_of("killed")
    with socket.socket(socket.AF_UNIX) as killed:
        killed.bind(str(left))
    assert left.exists()
    other = Server(simulation, "other")
    assert not left.exists(), "the next start cleans up"
    assert sockets.names() == ["me", "other"]
    other.close()


@pytest.mark.parametrize("name", ["", "a/b", "../x", ".hidden", "a b", "x" * 49])
def test_names(simulation, name):
    with pytest.raises(UsageError, match=naming(f"'{name}'", "name of a simulator")):
        Server(simulation, name)


def test_where_the_sockets_are(monkeypatch, tmp_path):
    monkeypatch.delenv(sockets.FOLDER_VARIABLE, raising=False)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert sockets.folder() == tmp_path / "ecatsim"
    monkeypatch.setenv("XDG_RUNTIME_DIR", "/proc/1/nowhere")
    own = "/run/ecatsim" if os.geteuid() == 0 else f"/tmp/ecatsim-{os.geteuid()}"
    assert sockets.folder() == Path(own)


def test_a_directory_that_cannot_be_used(simulation, monkeypatch, tmp_path):
    monkeypatch.setenv(sockets.FOLDER_VARIABLE, "/proc/nowhere")
    with pytest.raises(NotPermittedError, match=naming("control socket", "/proc/nowhere")):
        Server(simulation)
    monkeypatch.setenv(sockets.FOLDER_VARIABLE, str(tmp_path / ("x" * 120)))
    with pytest.raises(UsageError, match=naming("too long", "x" * 120)):
        Server(simulation)
    if os.geteuid() == 0:
        os.chown(tmp_path, 12345, -1)
        monkeypatch.setenv(sockets.FOLDER_VARIABLE, str(tmp_path))
        with pytest.raises(NotPermittedError, match=naming(tmp_path, "user 12345")):
            Server(simulation)
