"""Who may use the page of `ecatctl web`: names of hosts, cookies, sessions, tries of passwords."""

import asyncio
import socket
import time
from contextlib import suppress
from typing import Any

import pytest
from websockets.datastructures import Headers

from conftest import PATIENCE
from ecatd.base.errors import BusyError, UsageError
from ecatd.web.guard import LOOPBACK, Guard
from ecatd.web.hub import Hub
from ecatd.web.listening import Address, Listening, bind, read_address
from ecatd.web.logins import Attempts
from ecatd.web.sessions import Account, Sessions
from ecatd.web.turns import WAITING_MAX, Turns, network


@pytest.mark.parametrize(
    ("text", "host", "port"),
    [
        ("0.0.0.0", "0.0.0.0", None),
        ("192.168.1.7:9000", "192.168.1.7", 9000),
        ("::", "::", None),
        ("[::1]", "::1", None),
        ("[fe80::1]:0", "fe80::1", 0),
    ],
)
def test_an_address_with_and_without_a_port(text: str, host: str, port: int | None) -> None:
    assert read_address(text) == Address(host, port)


@pytest.mark.parametrize(
    "text", ["", "cell4", "cell4:8570", "1.2.3.4:", "1.2.3.4:65536", "[::1", "::1]:2", "1.2.3:5"]
)
def test_what_is_no_address(text: str) -> None:
    with pytest.raises(ValueError, match=r"."):
        read_address(text)


def test_only_loopback_is_for_this_machine() -> None:
    assert [Address(host).is_loopback for host in ("127.9.9.9", "::1", "0.0.0.0", "::")] == [
        True,
        True,
        False,
        False,
    ]


def test_names_of_the_server() -> None:
    guard = Guard(
        1, ["Cell4.example", "*.press.example", "10.0.0.7", "0:0:0:0:0:0:0:1"], encrypted=True
    )
    good = ("cell4.EXAMPLE:1", "a.press.example", "10.0.0.7:8570", "[::1]:8570", "[0::1]")
    bad = ("press.example", "a.b.press.example", "10.0.0.70", "[::2]", "localhost", "", "x y", "*")
    for host in (*good, *bad):
        assert guard.is_for_us(Headers({"Host": host})) == (host in good), host
    assert Guard(1, LOOPBACK, encrypted=False).is_for_us(Headers({"Host": "[::1]:9"}))


def test_a_cookie_is_of_one_server() -> None:
    guard, other = Guard(1, encrypted=True), Guard(2, encrypted=True)
    name = guard.cookie("secret").partition(";")[0]
    assert guard.secret(Headers({"Cookie": name})) == "secret"
    assert guard.secret(Headers({"Cookie": f"a=b; {name}"})) == "secret"
    assert other.secret(Headers({"Cookie": name})) == ""
    assert Guard(1, encrypted=False).secret(Headers({"Cookie": name})) == ""
    two = Headers([("Cookie", name), ("Cookie", "a=b")])
    assert guard.secret(two) == ""


class Connection:
    """Stands for a WebSocket of a page."""

    def __init__(self) -> None:
        self.closed = 0

    async def close(self, code: int, _: str) -> None:
        self.closed = code


def no_hub(bus: str) -> Hub:
    raise UsageError(f"no bus {bus}")


def test_a_session_ends_with_its_pages_by_time_and_by_request() -> None:
    async def run() -> None:
        sessions = Sessions(0.05)
        account = Account("anna", no_hub)
        secret = sessions.begin(account)
        found = sessions.find(secret)
        assert found is not None
        page: Any = Connection()
        found.connections.add(page)
        assert sessions.account("anna") is account
        assert sessions.find(secret + "x") is None
        while not page.closed:  # its time ends
            await asyncio.sleep(0.01)
        assert found.is_over
        assert sessions.find(secret) is None
        assert sessions.account("anna") is None
        lasting = Sessions(None)
        first, second = lasting.begin(account), lasting.begin(account)
        lasting.end(first)
        lasting.end("unknown")
        assert lasting.find(first) is None
        assert lasting.find(second) is not None

    asyncio.run(run())


def test_who_logs_in_again_and_again_ends_own_sessions_only() -> None:
    sessions = Sessions(None)

    def begin(user: str, count: int = 1) -> list[str]:
        return [sessions.begin(Account(user, no_hub)) for _ in range(count)]

    def left(secrets: list[str]) -> list[bool]:
        return [sessions.find(secret) is not None for secret in secrets]

    other = begin("anna")
    assert left(begin("bob", 40)) == [False] * 32 + [True] * 8
    assert left(other) == [True]
    more = [begin(f"user{number}", 4) for number in range(5)]
    dora = begin("dora", 3)  # 32 in all
    assert all(map(all, map(left, (other, dora, *more))))
    bob = begin("bob")
    assert left(bob) == [True]
    begin("eve", 3)  # bob has the most, so places for them are his
    assert all(map(all, map(left, (other, dora, bob, *more))))


def test_strangers_leave_a_turn_to_those_who_have_logged_in_before() -> None:
    async def run() -> None:
        turns, order = Turns(), []
        ends = asyncio.Event()

        async def attempt(near: str) -> str:
            try:
                async with turns.turn(near):
                    order.append(near)
                    await ends.wait()
            except BusyError:
                return "busy"
            return "tried"

        async def begin(*nears: str) -> list[asyncio.Task[str]]:
            tasks = [asyncio.create_task(attempt(near)) for near in nears]
            await asyncio.sleep(0)
            return tasks

        turns.know("known")
        many = await begin("bad", *(["bad"] * WAITING_MAX))
        assert order == ["bad"]
        assert len(await begin("known")) == 1
        assert order == ["bad", "known"]  # at once
        one, two = await begin("one", "two")  # for each of them, one of many has to go
        await asyncio.sleep(0)
        assert [task.done() for task in many[-3:]] == [False, True, True]
        many[1].cancel()  # a connection that has been closed
        (three,) = await begin("three")
        (late,) = await begin("bad")
        assert await late == "busy"
        ends.set()
        assert await asyncio.gather(one, two, three) == ["tried"] * 3
        assert order[2:6] == ["bad", "one", "two", "three"]  # each in its turn
        await asyncio.wait(many)
        crowd = await begin(*(f"bad {number}" for number in range(2 * WAITING_MAX)))
        results = await asyncio.gather(*crowd, attempt("known"))
        assert results[-1] == "tried"

    asyncio.run(run())


def test_an_address_stands_for_its_network() -> None:
    assert network("192.0.2.1") == network("::ffff:192.0.2.1") == "192.0.2.1"
    assert network("2001:db8::1") == network("2001:db8::ffff:2") == "2001:db8::/64"
    assert network("fe80::1%eth0") == "fe80::/64"


def test_tries_of_an_address_are_few_and_those_of_others_go_on() -> None:
    now = [0.0]
    attempts = Attempts(lambda: now[0])
    for _ in range(10):
        attempts.count("a")
    for _ in range(100):
        with pytest.raises(BusyError, match="wait 6 s"):
            attempts.count("a")
    attempts.count("b")
    now[0] = 6.0
    attempts.count("a")
    with pytest.raises(BusyError):
        attempts.count("a")
    now[0] = 1000.0
    for _ in range(10):
        attempts.count("a")
    with pytest.raises(BusyError):
        attempts.count("a")


@pytest.mark.parametrize("said", [b"", b"G"])
def test_connections_without_a_request_give_their_places_to_others(said: bytes) -> None:
    listening: Listening = bind(Address(port=0))
    there = listening.getsockname()
    taken: list[socket.socket] = []

    def accept() -> None:
        with suppress(BlockingIOError):
            while True:
                taken.append(listening.accept()[0])

    def come(source: str) -> socket.socket:
        theirs = socket.create_connection(there, source_address=(source, 0))
        theirs.sendall(said)
        theirs.settimeout(PATIENCE)
        accept()
        if said:
            accept()
        sockets.append(theirs)
        return theirs

    def ended(theirs: socket.socket) -> bool:
        theirs.setblocking(False)
        try:
            return theirs.recv(1) == b""
        except BlockingIOError:
            return False

    sockets: list[socket.socket] = []
    try:
        page = come("127.0.0.1")
        listening.keep(page.getsockname())
        many = [come("127.0.0.2") for _ in range(40)]
        other = come("127.0.0.3")
        assert [ended(theirs) for theirs in many] == [True] * 8 + [False] * 32
        more = [come(f"127.0.0.{10 + number}") for number in range(40)]
        # Of those who have the most. The page has a place only as long as it says nothing.
        assert sum(ended(theirs) for theirs in many) == 8 + (9 if said else 10)
        assert not any(ended(theirs) for theirs in (page, other, *more))
        assert len(taken) == (len(sockets) if said else 0)
        listening.hurry(0.0)
        assert not ended(other)
        listening.hurry(time.monotonic() + 1)
        assert ended(other) == (not said)
    finally:
        for sock in (*sockets, *taken):
            sock.close()
        listening.close()
