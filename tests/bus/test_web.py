"""`ecatctl web`: what pages see of a bus and of a recording, and what strangers get."""

import json
import os
import signal
import socket
import struct
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from conftest import PATIENCE, Daemon, names
from ecatd.base.paths import zenoh_socket
from ecatd.web import files

HAS_PAGE = (Path(files.__file__).parent / "_page" / "index.html").is_file()
pytestmark = [
    pytest.mark.bus,
    pytest.mark.skipif(not HAS_PAGE, reason="the page was not built: there is no Node.js"),
]
Message = dict[str, Any]


class Web:
    """`ecatctl web`, started by a test.

    Attributes:
        host: Its address and port.
        cookie: The cookie that its page gets.
    """

    def __init__(self, daemon: Daemon, *options: str) -> None:
        command = [sys.executable, "-m", "ecatd.cli", "web", "--no-browser", "--port", "0"]
        self.process = subprocess.Popen(
            [*command, *options], env=daemon.env, stdout=subprocess.PIPE, text=True
        )
        assert self.process.stdout is not None
        address, _, token = self.process.stdout.readline().strip().partition("/#token=")
        self.host = address.removeprefix("http://")
        self.token = token
        status, headers = self.get("/login", Authorization=f"Bearer {token}")
        assert status == 200
        self.cookie, *flags = headers["Set-Cookie"].split("; ")
        assert {"HttpOnly", "SameSite=Strict"} <= set(flags)
        assert self.cookie.startswith(f"ecatd-{self.host.rpartition(':')[2]}=")

    def get(self, path: str, **headers: str) -> tuple[int, Any]:
        """The status and the headers of an answer."""
        request = urllib.request.Request(f"http://{self.host}{path}", headers=headers)
        try:
            with urllib.request.urlopen(request, timeout=PATIENCE) as answer:
                return answer.status, answer.headers
        except urllib.error.HTTPError as error:
            with error:
                return error.code, error.headers

    def raw(self, text: bytes) -> bytes:
        """What comes back for some bytes."""
        name, _, port = self.host.partition(":")
        with socket.create_connection((name, int(port)), timeout=PATIENCE) as sock:
            with suppress(ConnectionError):
                sock.sendall(text)
            found = b""
            with suppress(ConnectionError):
                while part := sock.recv(4096):
                    found += part
            return found

    def open(self, query: str = "", **headers: str) -> "Page":
        """A page."""
        own = {"Cookie": self.cookie, "Origin": f"http://{self.host}"} | headers
        return Page(
            connect(
                f"ws://{self.host}/socket{query}",
                additional_headers={key: value for key, value in own.items() if value},
                max_size=None,
                compression=None,
            )
        )

    def refused(self, query: str = "", **headers: str) -> int:
        """The status with which a WebSocket is refused."""
        with pytest.raises(InvalidStatus) as found, self.open(query, **headers):
            pass
        return found.value.response.status_code


class Page:
    """A page as the browser has it, without a browser."""

    def __init__(self, connection: AbstractContextManager[ClientConnection]) -> None:
        self._connection = connection
        self.ws: ClientConnection

    def __enter__(self) -> "Page":
        self.ws = self._connection.__enter__()
        return self

    def __exit__(self, *reason: Any) -> None:
        self._connection.__exit__(*reason)

    def say(self, **message: Any) -> None:
        self.ws.send(json.dumps(message))

    def until(self, wanted: Callable[[Message], bool]) -> Message:
        """The next message that is wanted."""
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            text = self.ws.recv(PATIENCE)
            if isinstance(text, str) and wanted(message := json.loads(text)):
                return message
        raise AssertionError("no such message came")

    def of_type(self, *kinds: str) -> Message:
        return self.until(lambda message: message["type"] in kinds)

    def value(self, key: str) -> Message:
        return self.until(lambda message: message.get("key") == key)

    def ask(self, key: str, payload: Message | None = None, **parameters: Any) -> Message:
        number = time.monotonic_ns()
        self.say(type="ask", ask=number, key=key, parameters=parameters, payload=payload or {})
        return self.until(lambda message: message.get("ask") == number)

    def batch(self, generation: int) -> tuple[Message, list[float]]:
        """The header of the next batch of a generation, and its cycles."""
        while True:
            data = self.ws.recv(PATIENCE)
            if isinstance(data, bytes):
                (length,) = struct.unpack_from("<I", data)
                header = json.loads(data[4 : 4 + length])
                if header["generation"] == generation:
                    form = f"<{header['count']}d"
                    return header, [*struct.unpack_from(form, data, header["cycles"])]


@contextmanager
def serving(daemon: Daemon, *options: str) -> Iterator[Web]:
    web = Web(daemon, *options)
    try:
        yield web
        web.process.send_signal(signal.SIGINT)
        assert web.process.wait(PATIENCE) == 0
    finally:
        if web.process.poll() is None:
            web.process.kill()
            web.process.wait()
        assert web.process.stdout is not None
        web.process.stdout.close()


@pytest.fixture(scope="module")
def web(troll: Daemon) -> Iterator[Web]:
    with serving(troll) as found:
        yield found


def test_a_page_sees_the_bus_and_changes_nothing(troll: Daemon, web: Web) -> None:
    with web.open() as page:
        hello = page.of_type("hello")
        assert (hello["source"], hello["may"]) == ("bus", [])
        signals = page.of_type("signals")["signals"]
        assert len({signal["name"] for signal in signals}) == len(signals) > 100
        with troll.client() as client:
            paths = {signal.path for signal in client.signals() if signal.bit_length <= 64}
        assert {signal["path"] for signal in signals} == paths
        link = page.of_type("link")
        assert link["up"], link
        page.of_type("events")
        assert page.value("ro/state")["value"]["slaves"][0]["al_state"] == 8
        assert page.value("ro/outputs")["value"]["outputs"]
        assert len(page.of_type("lamps")["lamps"]) == 7
        answer = page.ask("ro/sdo/0/0x1000/0")["answer"]
        assert bytes.fromhex(answer["data"])[:2] == (402).to_bytes(2, "little")
        refused = page.ask("rw/sdo/0/0x6060/0", {"data": "01"})["failure"]
        assert refused["name"] == "permission"
        names(refused["message"], "sdo", "--allow")
        for key in ("ro/nothing", "as/me/ro/rights", "ro/trace", "ro/sdo/0/x/0", "", "rw/**"):
            assert page.ask(key)["failure"]["name"] == "usage", key


def test_pages_choose_signals_without_a_gap_for_each_other(web: Web) -> None:
    with web.open() as one, web.open() as other:
        found = [signal["name"] for signal in one.of_type("signals")["signals"]]
        other.of_type("signals")
        one.say(type="trace", signals=found[:2], generation=1)
        header, cycles = one.batch(1)
        assert [column["name"] for column in header["columns"]] == found[:2]
        other.say(type="trace", signals=found[5:7], generation=9)
        assert [column["name"] for column in other.batch(9)[0]["columns"]] == found[5:7]
        other.say(type="trace", signals=[], generation=10)
        for _ in range(20):
            before = cycles[-1]
            header, cycles = one.batch(1)
            assert header["lost"] or cycles[0] == before + 1
        one.say(type="trace", signals=[found[2], "9/0x0000:00"], generation=2)
        assert [column["name"] for column in one.batch(2)[0]["columns"]] == [found[2]]


def test_a_page_chooses_a_bus(troll: Daemon, web: Web) -> None:
    silent = zenoh_socket(Path(troll.env["ECATD_RUNTIME_DIR"]), "other")
    silent.parent.mkdir(parents=True)
    with socket.socket(socket.AF_UNIX) as sock:  # a bus that has a gateway, which does not answer
        sock.bind(str(silent))
        try:
            with web.open(f"?bus={troll.bus}") as page, web.open("?bus=other") as other:
                assert page.of_type("hello")["title"] == troll.bus
                page.until(lambda message: message["type"] == "link" and message["up"])
                found = page.until(lambda message: message.get("buses"))["buses"]
                assert found == sorted(["other", troll.bus])
                assert other.of_type("hello")["title"] == "other"
                link = other.of_type("link")
                assert not link["up"]
                names(link["text"], "other")
        finally:
            silent.unlink()
    for wrong in ("..", "a/b", "x" * 500, "%00"):
        assert web.refused(f"?bus={wrong}") == 400, wrong


def test_it_comes_back_after_a_restart_of_the_gateway(troll: Daemon, web: Web) -> None:
    with web.open() as page:
        found = page.of_type("signals")["signals"]
        page.say(type="trace", signals=[found[0]["name"]], generation=4)
        page.batch(4)
        os.kill(troll.child_pid("ecatd.gateway"), signal.SIGKILL)
        page.until(lambda message: message["type"] == "link" and not message["up"])
        page.until(lambda message: message["type"] == "link" and message["up"])
        page.batch(4)


def test_a_right_is_for_the_pages_that_have_it(troll: Daemon) -> None:
    with serving(troll, "--allow", "sdo") as allowed, allowed.open() as page:
        assert page.of_type("hello")["may"] == ["sdo"]
        page.until(lambda message: message["type"] == "link" and message["up"])
        before = page.ask("ro/sdo/0/0x6083/0")["answer"]["data"]
        assert "answer" in page.ask("rw/sdo/0/0x6083/0", {"data": "39300000"})
        assert page.ask("ro/sdo/0/0x6083/0")["answer"]["data"] == "39300000"
        page.ask("rw/sdo/0/0x6083/0", {"data": before})
        assert page.ask("rw/errors/all")["failure"]["name"] == "permission"
        assert "hex" in page.ask("rw/sdo/0/0x6083/0", {"data": "xyz"})["failure"]["message"]


def test_strangers_get_nothing(troll: Daemon, web: Web) -> None:
    port = web.host.rpartition(":")[2]
    assert web.refused(Cookie="") == 401
    assert web.refused(Cookie=f"ecatd-{port}=wrong") == 401
    assert web.refused(Cookie=web.cookie.replace(port, "1")) == 401
    assert web.refused(Origin="") == 403
    assert web.refused(Origin="null") == 403
    assert web.refused(Origin="http://evil.example") == 403
    assert web.refused(Origin="http://127.0.0.1:1") == 403
    assert web.get("/login")[0] == 401
    assert web.get("/login", Authorization="Bearer wrong")[0] == 401
    assert web.get("/login", Cookie=web.cookie)[0] == 200
    assert web.get("/login", Cookie=web.cookie, Host="evil.example")[0] == 421
    for host in ("evil.example", f"127.0.0.1.evil.example:{port}", "", "localhost@evil"):
        assert web.get("/", Host=host)[0] == 421, host
    assert web.get("/", Host="localhost:9000")[0] == 200  # ssh -L
    status, headers = web.get("/")
    assert status == 200
    for part in ("default-src 'none'", "script-src 'self'", "frame-ancestors 'none'"):
        assert part in headers["Content-Security-Policy"]
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Cache-Control"] == "no-store"
    for path in ("/../../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "//etc/passwd", "/page.js/."):
        answer = web.raw(f"GET {path} HTTP/1.1\r\nHost: {web.host}\r\n\r\n".encode())
        assert answer.split(b"\r\n")[0].endswith(b"404 Not Found"), path
    two = f"GET /socket HTTP/1.1\r\nHost: {web.host}\r\nHost: evil.example\r\n\r\n"
    assert b" 421 " in web.raw(two.encode()).split(b"\r\n")[0]
    with serving(troll) as second:  # the cookie of one server is none of the other
        assert second.refused(Cookie=web.cookie) == 401


def test_attackers_end_only_their_own_connections(web: Web) -> None:
    garbage = [
        b"\x16\x03\x01" + b"\xff" * 400 + b"\r\n",
        b"GET / HTTP/1.1\r\n" + b"A: b\r\n" * 10000,
    ]
    for text in garbage:
        web.raw(text)
    name, _, number = web.host.partition(":")
    slow = [socket.create_connection((name, int(number))) for _ in range(90)]
    try:
        for sock in slow:
            sock.send(b"GET / HT")
        with web.open() as page:
            page.of_type("hello")
            for message in (
                b"\x00" * 9,
                "{",
                "[]",
                '{"type":"ask","ask":true}',
                "[" * 90000,
                "1" * 300_000,
            ):
                with web.open() as bad:
                    bad.ws.send(message)
                    with pytest.raises(ConnectionClosed):
                        while True:
                            bad.ws.recv(PATIENCE)
            for sock in slow:  # they had their time
                sock.settimeout(PATIENCE)
                with suppress(ConnectionError):
                    while sock.recv(4096):
                        pass
            assert page.ask("ro/info")["answer"]["host"]
    finally:
        for sock in slow:
            sock.close()


def test_a_recording_is_shown_without_a_daemon(troll: Daemon, tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    path = tmp_path / "run.mcap"
    troll.ctl("record", "0/*", "--raw", "--for", "1", "-o", str(path))
    with serving(troll, str(path)) as found, found.open() as page:
        assert page.of_type("hello")["source"] == "file"
        signals = page.of_type("signals")["signals"]
        chosen = [signal["name"] for signal in signals if signal["address"].startswith("0x6")][:2]
        page.say(type="trace", signals=chosen, generation=1)
        header, cycles = page.batch(1)
        assert [column["name"] for column in header["columns"]] == chosen
        assert cycles == sorted(set(cycles))
        assert len(cycles) > 10
        page.of_type("end")
        assert page.ask("ro/info")["failure"]["name"] == "state"


def test_programs_get_the_address_in_json(troll: Daemon) -> None:
    command = [sys.executable, "-m", "ecatd.cli", "web", "--json", "--no-browser", "--port", "0"]
    with subprocess.Popen(command, env=troll.env, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        told = json.loads(process.stdout.readline())
        process.terminate()
    assert told["address"].startswith("http://127.0.0.1:")
    assert "/#token=" in told["address"]


def test_what_cannot_start_says_why(troll: Daemon, web: Web, tmp_path: Path) -> None:
    taken = troll.ctl("web", "--no-browser", "--port", web.host.rpartition(":")[2], check=False)
    assert taken.returncode == 7
    names(taken.stderr, "--port 0")
    wrong = tmp_path / "wrong.mcap"
    wrong.write_bytes(b"no recording")
    pipe = tmp_path / "pipe.mcap"
    os.mkfifo(pipe)
    for options, text in (
        ((str(wrong),), "is no MCAP file"),
        ((str(pipe),), "not a regular file"),
        ((str(tmp_path / "none.mcap"),), "No such file"),
        ((str(tmp_path / "run.csv"),), "MCAP"),
        (("--allow", "everything"), "everything"),
    ):
        refused = troll.ctl("web", "--no-browser", *options, check=False)
        assert refused.returncode == 2
        assert text in refused.stderr
