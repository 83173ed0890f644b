"""Whoever may do nothing, or little, cannot keep others out: sessions, handshakes, long messages.

While each flood goes on, a member of the group at the Unix socket and a user of another machine
open sessions and are answered. All come from one address.
"""

import shutil
import socket
import ssl
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import pytest
import zenoh
from test_remote_users import CONFIG, Site

from conftest import Daemon, free_port, names, wait_for
from ecatd.client.identity import read_identity
from ecatd.operations.zenoh_keys import bus_key, session_config

pytestmark = [
    pytest.mark.bus,
    pytest.mark.unprivileged,
    pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl makes the certificates"),
]

SESSIONS, GUESTS = 3, 8
LONG = 64 << 20


@pytest.fixture(scope="module")
def plain() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture(scope="module")
def site(
    tmp_path_factory: pytest.TempPathFactory, start_shared: Callable[..., Daemon], plain: str
) -> Site:
    def start(_rig: str, config: str) -> Daemon:
        config = config.replace("listen = [", f'guests_max = {GUESTS}\nlisten = ["{plain}", ')
        limited = config.replace('name = "bob"\n', f'name = "bob"\nsessions_max = {SESSIONS}\n')
        return start_shared("line:1", config=limited.replace('slaves = [0, "EK1100"]\n', ""))

    assert 'name = "bob"\n' in CONFIG
    return Site(tmp_path_factory.mktemp("site"), start)


def is_answered(session: zenoh.Session, site: Site, seconds: float) -> bool:
    key = bus_key(site.daemon.bus, "ro", "info")
    return any(reply.ok for reply in session.get(key, timeout=seconds))


def all_are_served(site: Site) -> None:
    """Both open a session of their own and are answered."""
    deadline = time.monotonic() + 60.0
    assert len(site.daemon.slave_rows()) == 1
    while True:
        with suppress(zenoh.ZError), site.session("anna") as anna:
            if is_answered(anna, site, 5.0):
                return
        assert time.monotonic() < deadline, site.daemon.log


def open_sessions(stack: ExitStack, settings: dict[str, object], count: int) -> int:
    """Opens sessions; returns how many are connected to the gateway in the end."""
    opened = []
    for _ in range(count):
        with suppress(zenoh.ZError):
            opened.append(stack.enter_context(zenoh.open(session_config("client", settings))))
    return len(opened)


@contextmanager
def again_and_again(act: Callable[[], None], pause: float) -> Iterator[None]:
    """Does something in a thread, until the end."""
    ends = threading.Event()

    def run() -> None:
        while not ends.wait(pause):
            with suppress(OSError):
                act()

    threads = [threading.Thread(target=run) for _ in range(2)]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        ends.set()
        for thread in threads:
            thread.join()


def test_sessions_of_a_user_without_rights(site: Site) -> None:
    settings = {"connect/endpoints": [site.endpoint], **read_identity(site["bob"]).settings}
    with ExitStack() as stack:
        open_sessions(stack, settings, 4 * SESSIONS)
        wait_for(
            lambda: f"user 'bob' has {SESSIONS} sessions already" in site.daemon.log, site.daemon
        )
        names(site.daemon.log, "127.0.0.1", "sessions_max")
        all_are_served(site)


def test_sessions_of_guests(site: Site, plain: str) -> None:
    with ExitStack() as stack:
        open_sessions(stack, {"connect/endpoints": [plain]}, 2 * GUESTS)
        wait_for(lambda: "gateway.guests_max" in site.daemon.log, site.daemon)
        all_are_served(site)


def test_who_has_gone_makes_room(site: Site) -> None:
    for _ in range(2 * SESSIONS):
        with site.session("bob") as bob:
            assert is_answered(bob, site, 60.0)


def test_silent_connections(site: Site) -> None:
    address = "127.0.0.1", site.port
    with ExitStack() as stack:
        for _ in range(150):
            stack.enter_context(socket.create_connection(address))
        all_are_served(site)


def test_half_a_handshake(site: Site) -> None:
    """A whole ClientHello, after which nothing comes."""
    hello = ssl.MemoryBIO()
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    with suppress(ssl.SSLWantReadError):
        context.wrap_bio(ssl.MemoryBIO(), hello).do_handshake()
    begin = hello.read()
    with ExitStack() as stack:
        for _ in range(150):
            with suppress(OSError):
                connection = stack.enter_context(socket.create_connection(("127.0.0.1", site.port)))
                connection.sendall(begin)
        all_are_served(site)


@pytest.mark.parametrize("kind", ["garbage", "no certificate"])
def test_broken_handshakes(site: Site, kind: str) -> None:
    address = "127.0.0.1", site.port
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE

    def garbage() -> None:
        with socket.create_connection(address, 1.0) as connection:
            connection.sendall(b"GET / HTTP/1.0\r\n\r\n")

    def handshake() -> None:
        with (
            socket.create_connection(address, 1.0) as connection,
            context.wrap_socket(connection) as encrypted,
        ):
            encrypted.recv(1)  # the alert that a certificate is missing

    with again_and_again(garbage if kind == "garbage" else handshake, 0.05):
        time.sleep(1.0)  # so that what piles up does so
        for _ in range(3):
            all_are_served(site)


def test_a_long_message_is_not_put_together(site: Site) -> None:
    """The memory is limited before anybody knows the rights of the sender."""
    pid = site.daemon.child_pid("ecatd.gateway")

    def peak() -> int:
        (line,) = (
            line
            for line in Path(f"/proc/{pid}/status").read_text().splitlines()
            if line.startswith("VmHWM")
        )
        return int(line.split()[1]) << 10

    before = peak()
    with site.session("bob") as bob:
        assert is_answered(bob, site, 60.0)
        for key in ("ro/info", "rw/log/dc", "as/bob/rw/log/dc"):
            whole = bus_key(site.daemon.bus, *key.split("/"))
            replies = list(bob.get(whole, payload=bytes(LONG), timeout=5.0))
            assert not any(reply.ok for reply in replies)
    all_are_served(site)
    assert peak() - before < LONG / 2
    assert site.daemon.child_pid("ecatd.gateway") == pid
