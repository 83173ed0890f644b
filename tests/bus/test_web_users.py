"""`ecatctl web` for other machines: who logs in, what each may do, and what strangers get."""

import base64
import hashlib
import http.client
import json
import select
import shutil
import socket
import ssl
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import pytest
from test_remote_users import expired_identity
from test_web import HAS_PAGE, Page
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from conftest import PATIENCE, Daemon, free_port, names, run_module
from ecatd.base.errors import NotPermittedError
from ecatd.base.openssl import openssl
from ecatd.cli.authority import make_authority, make_identity, make_login, make_server
from ecatd.client.identity import Identity
from ecatd.client.remote import Remote

pytestmark = [
    pytest.mark.bus,
    pytest.mark.skipif(not HAS_PAGE, reason="the page was not built: there is no Node.js"),
    pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl makes the certificates"),
]
CONFIG = """\
[gateway]
listen = ["tls/127.0.0.1:{port}"]
certificate = "{folder}/daemon.pem"
key = "{folder}/daemon.key"
users_ca = "{folder}/authority.pem"
[[gateway.user]]
name = "anna"
write = ["sdo"]
slaves = [0]
[[gateway.user]]
name = "bob"
"""
AXE = Path(__file__).parents[2] / "web" / "node_modules" / "axe-core" / "axe.min.js"
Answer = tuple[int, dict[str, str], str]


def password(user: str) -> str:
    return f"pässword of {user}"


def remote(*arguments: str, given: str = "") -> str:
    command = [sys.executable, "-m", "ecatd.cli", "remote", *arguments]
    made = subprocess.run(command, input=given, capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stderr
    return made.stdout


class Site:
    """A daemon, its `ecatctl web` for other machines, and those who may log in there."""

    def __init__(self, folder: Path, start: Callable[..., Daemon]) -> None:
        self.folder = tls = folder / "tls"
        port = free_port()
        for part in (tls, folder / "other", folder / "old"):
            part.mkdir()
        make_authority(tls)
        make_authority(folder / "other")
        make_server(tls, tls, "daemon", "machine", ["localhost", "127.0.0.1"], 9)
        names(remote("web", "--dir", str(tls), "--host", "*.press.example"), "*.press.example")
        remote("login", "anna", "--dir", str(tls), given=f"{password('anna')}\n")
        for user, authority in (("bob", "tls"), ("carl", "tls"), ("eve", "other")):
            out = tls / "logins" / f"{user}.pem"
            make_login(folder / authority, out, user, password(user), 9)
        self._lock(expired_identity(tls, folder / "old"), "dora")
        # The key of this one is open, so it is no login.
        make_identity(tls, tls / "logins" / "frank.pem", "frank", 9)
        self.daemon = start("troll", config=CONFIG.format(port=port, folder=tls))
        self.gateway = f"tls/127.0.0.1:{port}"

    def _lock(self, identity: Path, user: str) -> None:
        text = identity.read_text().replace("user: anna", f"user: {user}")
        begin, end = (f"-----{what} PRIVATE KEY-----\n" for what in ("BEGIN", "END"))
        before, rest = text.split(begin)
        options = ("pkcs8", "-topk8", "-scrypt", "-in", identity, "-passout", "stdin")
        locked = openssl(*options, given=f"{password(user)}\n")
        (self.folder / "logins" / f"{user}.pem").write_text(before + locked + rest.split(end)[1])

    @property
    def options(self) -> list[str]:
        files = {"certificate": "web.pem", "key": "web.key", "logins": "logins"}
        return [f"--{name}={self.folder / file}" for name, file in files.items()]


class Web:
    """`ecatctl web` at all addresses of the machine."""

    def __init__(self, site: Site, *options: str) -> None:
        self._site = site
        command = [sys.executable, "-m", "ecatd.cli", "--connect", site.gateway, "web"]
        command += ["--no-browser", "--address", "0.0.0.0:0", *site.options, *options]
        self.process = subprocess.Popen(
            command, env=site.daemon.env, stdout=subprocess.PIPE, text=True
        )
        assert self.process.stdout is not None
        address = self.process.stdout.readline().strip()
        assert address.startswith("https://*.press.example:"), address
        self.port = int(address.rstrip("/").rpartition(":")[2])
        self.host = f"localhost:{self.port}"
        self.tls = ssl.create_default_context(cafile=str(site.folder / "authority.pem"))

    def get(
        self, path: str, source: str = "127.0.0.1", method: str = "GET", **headers: str
    ) -> Answer:
        """Status, headers and text of an answer to a machine with an address."""
        where = ("localhost", self.port)
        client = http.client.HTTPSConnection(
            *where, timeout=PATIENCE, context=self.tls, source_address=(source, 0)
        )
        try:
            client.request(method, path, headers=headers)
            answer = client.getresponse()
            return answer.status, dict(answer.headers), answer.read().decode()
        finally:
            client.close()

    def try_login(self, user: str, given: str, source: str = "127.0.0.1", **more: str) -> Answer:
        text = base64.b64encode(f"{user}:{given}".encode()).decode()
        return self.get("/login", source, Authorization=f"Basic {text}", **more)

    def login(self, user: str, source: str = "127.0.0.1") -> str:
        """The cookie of a user."""
        status, headers, text = self.try_login(user, password(user), source)
        assert status == 200, text
        cookie, *flags = headers["Set-Cookie"].split("; ")
        assert {"HttpOnly", "Secure", "SameSite=Strict", "Path=/"} <= set(flags)
        assert cookie.startswith(f"__Host-ecatd-{self.port}=")
        return cookie

    def open(self, cookie: str, **headers: str) -> Page:
        own = {"Cookie": cookie, "Origin": f"https://{self.host}"} | headers
        return Page(
            connect(
                f"ws://{self.host}/socket",
                sock=decrypted(self.port, self.tls),
                additional_headers={key: value for key, value in own.items() if value},
                max_size=None,
                compression=None,
            )
        )

    def refused(self, cookie: str, **headers: str) -> int:
        with pytest.raises(InvalidStatus) as found, self.open(cookie, **headers):
            pass
        return found.value.response.status_code


def decrypted(port: int, tls: ssl.SSLContext) -> socket.socket:
    """A connection with TLS, for a client without.

    The client reads and writes in two threads, for which the TLS of Python is not made.
    """
    plain = socket.create_connection(("localhost", port), timeout=PATIENCE)
    outer = tls.wrap_socket(plain, server_hostname="localhost")
    inner, ours = socket.socketpair()

    def relay() -> None:
        ways = {outer: ours, ours: outer}
        with outer, ours, suppress(OSError):
            while True:
                ready = [outer] if outer.pending() else select.select([*ways], [], [])[0]
                for sock in ready:
                    outer.setblocking(False)  # what has come may be no data, but a ticket
                    with suppress(ssl.SSLWantReadError):
                        data = sock.recv(65536)
                        outer.setblocking(True)
                        if not data:
                            return
                        ways[sock].sendall(data)

    threading.Thread(target=relay, daemon=True).start()
    return inner


@contextmanager
def serving(site: Site, *options: str) -> Iterator[Web]:
    web = Web(site, *options)
    try:
        yield web
    finally:
        web.process.terminate()
        assert web.process.wait(PATIENCE) == 0
        assert web.process.stdout is not None
        web.process.stdout.close()


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory, start_shared: Callable[..., Daemon]) -> Site:
    return Site(tmp_path_factory.mktemp("site"), start_shared)


@pytest.fixture(scope="module")
def web(site: Site) -> Iterator[Web]:
    with serving(site, "--allow", "sdo,state") as found:
        yield found


def test_each_user_may_what_the_daemon_says(site: Site, web: Web) -> None:
    with ExitStack() as stack:
        anna, bob = (stack.enter_context(web.open(web.login(user))) for user in ("anna", "bob"))
        found = [signal["name"] for signal in anna.of_type("signals")["signals"]][:1]
        assert anna.until(lambda message: message.get("may"))["may"] == ["sdo"]
        link = bob.until(lambda message: message["type"] == "link")
        assert link["up"], link
        assert bob.of_type("rights", "lamps")["type"] == "lamps"  # none came after the link
        before = anna.ask("ro/sdo/0/0x6083/0")["answer"]["data"]
        assert "answer" in anna.ask("rw/sdo/0/0x6083/0", {"data": "39300000"})
        assert bob.ask("ro/sdo/0/0x6083/0")["answer"]["data"] == "39300000"
        anna.ask("rw/sdo/0/0x6083/0", {"data": before})
        names(site.daemon.log, "user 'anna'", "web page]", "0x6083:00")
        value = {"data": "00000000"}
        for page, key, payload, *why in (
            (bob, "rw/sdo/0/0x6083/0", value, "'bob'", "gateway.user.write"),
            (anna, "rw/sdo/1/0x6083/0", value, "'anna'", "gateway.user.slaves"),
            (anna, "rw/state/0", {"state": "OP"}, "'anna'", "gateway.user.write"),
            (anna, "rw/errors/all", {}, "--allow errors"),
        ):
            failure = page.ask(key, payload)["failure"]
            assert failure["name"] == "permission", failure
            names(failure["message"], *why)
        anna.say(type="trace", signals=found, generation=1)
        assert anna.batch(1)[0]["columns"][0]["name"] == found[0]


@pytest.mark.parametrize(
    ("user", "why"),
    [
        ("carl", ("'carl'", "[[gateway.user]]")),  # the daemon does not know this user
        ("eve", ("authority",)),  # another authority has signed the certificate
        ("dora", ("expired",)),
    ],
)
def test_who_has_no_right_to_read_sees_why(web: Web, user: str, why: tuple[str, ...]) -> None:
    with web.open(web.login(user)) as page:
        assert page.of_type("hello")["may"] == []
        link = page.of_type("link")
        assert not link["up"]
        names(link["text"], *why)
        assert "failure" in page.ask("ro/info")


def test_strangers_get_nothing_over_tls(site: Site, web: Web) -> None:
    cookie = web.login("anna")
    for wrong in ("", f"__Host-ecatd-{web.port}=wrong", cookie.replace("__Host-", "")):
        assert web.refused(wrong) == 401
    for origin in ("", "null", "https://evil.example", f"http://{web.host}", "https://localhost"):
        assert web.refused(cookie, Origin=origin) == 403
    for host in ("evil.example", "192.168.0.9", "press.example", "a.b.press.example", "", "[::1]"):
        status, _, text = web.get("/", Host=host)
        assert status == 421, host
        names(text, "certificate", "--host")
    for host in ("localhost:1", "127.0.0.1", "CELL4.press.example:9000"):
        assert web.get("/", Host=host)[0] == 200
    assert web.get("/login", Cookie=cookie)[0] == 200
    status, _, text = web.get("/login")
    assert (status, json.loads(text)["by"]) == (401, "password")
    assert web.get("/login", Authorization="Bearer x")[0] == 401
    for path in ("/login", "/logout"):
        assert web.get(path, Cookie=cookie, **{"Sec-Fetch-Site": "same-site"})[0] == 403
    for path, status, name in (("/?" + "a" * 20_000, 414, "X"), ("/", 431, "X-Long")):
        found, _, text = web.get(path, **{name: "a" * (20_000 if path == "/" else 1)})
        assert found == status
        names(text, "too long")
        assert "WebSocket" not in text
    for method in ("POST", "PUT", "DELETE", "TRACE", "HEAD"):
        status, headers, text = web.get("/login", method=method)
        assert (status, headers["Allow"]) == (405, "GET")
        assert ("GET only" in text) == (method != "HEAD")
    status, _, text = web.get("/socket", Cookie=cookie, Origin=f"https://{web.host}")
    assert (status, text) == (426, "Only pages of this server open a WebSocket.")
    with serving(site) as other:  # the cookie of one server is none of another one
        own = cookie.replace(str(web.port), str(other.port))
        assert other.refused(own) == 401
    with web.open(cookie) as page, web.open(cookie) as second, web.open(web.login("anna")) as third:
        page.of_type("hello")
        assert web.get("/logout", Cookie=cookie)[1]["Set-Cookie"].startswith(cookie.split("=")[0])
        for closed in (page, second):
            with pytest.raises(ConnectionClosed):
                while True:
                    closed.ws.recv(PATIENCE)
        assert web.refused(cookie) == 401
        third.until(lambda message: message["type"] == "link" and message["up"])


def test_the_key_of_the_server_opens_nothing_else(site: Site) -> None:
    pair = [(site.folder / f"web.{end}").read_text() for end in ("pem", "key")]
    authority = (site.folder / "authority.pem").read_text()
    for user in ("anna", f"ecatctl web of {socket.gethostname()}"):
        identity = Identity(site.folder / "web.pem", user, *pair, authority)
        with pytest.raises(NotPermittedError, match=r"not one for users|does not accept"):
            Remote(site.daemon.bus, site.gateway, 5.0, identity).rights()


def test_nothing_is_said_without_encryption(web: Web) -> None:
    def plain(text: bytes) -> bytes:
        with socket.create_connection(("127.0.0.1", web.port), timeout=PATIENCE) as sock:
            sock.sendall(text)
            found = b""
            with suppress(ConnectionError):
                while part := sock.recv(4096):
                    found += part
            return found

    head = f"GET /login HTTP/1.1\r\nHost: {web.host}\r\n\r\n".encode()
    told = plain(head)
    assert told.startswith(b"HTTP/1.1 308 ")
    assert f"Location: https://{web.host}/\r\n".encode() in told
    assert b"Set-Cookie" not in told
    for host in (b"evil.example", b"localhost.evil.example", b"[::1]", b"a\r\nb", b"localhost:x"):
        told = plain(b"GET / HTTP/1.1\r\nHost: " + host + b"\r\n\r\n")
        assert told.startswith(b"HTTP/1.1 400 ")
        assert b"Location" not in told
    assert plain(b"\x00" * 100).startswith(b"HTTP/1.1 400 ")
    tried = (
        "openssl",
        "s_client",
        "-connect",
        f"127.0.0.1:{web.port}",
        "-cipher",
        "ALL:@SECLEVEL=0",
    )
    for version in ("-tls1_1", "-tls1_2"):
        shown = subprocess.run([*tried, version], input="", capture_output=True, text=True)
        assert ("Cipher is (NONE)" in shown.stdout) == (version == "-tls1_1"), shown.stdout


def test_passwords_cannot_be_guessed(web: Web) -> None:
    attacker = "127.0.0.2"
    texts = {
        web.try_login(user, "wrong password", attacker)[2]
        for user in ("anna", "nobody", "frank", "../web", "eve", "", "a" * 65, "anna\n")
    }
    assert len(texts) == 1, "who has a login is a secret"
    tried = [web.try_login("anna", f"guess {n}", attacker) for n in range(6)]
    assert tried[-1][0] == 429
    names(json.loads(tried[-1][2])["message"], "wait", "s")
    assert web.try_login("anna", password("anna"), attacker)[0] == 429
    web.login("anna")  # from another address


def test_open_handshakes_hold_up_nobody(web: Web) -> None:
    hello = b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03"  # a ClientHello that goes on
    with ExitStack() as stack, web.open(web.login("bob")) as page:
        page.of_type("hello")
        begun = time.monotonic()
        slow = []
        for number in range(200):
            source = (f"127.0.0.{3 + number % 2}", 0)
            sock = socket.create_connection(("127.0.0.1", web.port), source_address=source)
            slow.append(stack.enter_context(sock))
            with suppress(ConnectionError):
                sock.sendall(hello[: number % len(hello)])
        assert web.get("/", "127.0.0.3")[0] == 200  # behind the same address, too
        with web.open(web.login("anna")) as other:
            other.of_type("hello")
            assert page.ask("ro/info")["answer"]["host"]
        slow[0].settimeout(PATIENCE)
        with suppress(ConnectionError):
            assert slow[0].recv(1) == b""
        assert time.monotonic() - begun < PATIENCE


def test_thousands_of_connections_need_no_memory(site: Site) -> None:
    """Without a login they need as much as there are places, however many come one by one."""
    begun = b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03"
    wrong = b"\x16\x03\x01\x00\x05\x01\x00\x00\x01\x00"  # a ClientHello that is none

    def memory() -> int:
        text = Path(f"/proc/{web.process.pid}/status").read_text()
        return int(text.partition("VmHWM:")[2].split()[0])

    with serving(site) as web:
        assert web.get("/")[0] == 200
        before = memory()
        for said, count in ((b"", 3000), (begun, 1000), (wrong, 1000)):
            for _ in range(count):
                with socket.create_connection(("127.0.0.1", web.port), timeout=PATIENCE) as sock:
                    sock.sendall(said)
        for _ in range(200):  # those with a whole handshake
            with socket.create_connection(("localhost", web.port), timeout=PATIENCE) as sock:
                web.tls.wrap_socket(sock, server_hostname="localhost").close()
        assert web.get("/")[0] == 200
        assert memory() - before < 64 * 1024, "kB"


def test_what_cannot_listen_says_why(site: Site, tmp_path: Path) -> None:
    def told(*options: str, status: int = 7) -> str:
        command = ("web", "--no-browser", *options)
        found = run_module("ecatd.cli", *command, env=site.daemon.env)
        assert found.returncode == status, found.stderr
        return found.stderr

    missing = ("--certificate", str(tmp_path / "none.pem"), "--key", str(tmp_path / "none.key"))
    names(told("--address", "0.0.0.0", *missing), "remote web", "ssh -L", "none.pem")
    other = (f"--key={site.folder / 'daemon.key'}", "--address=0.0.0.0:0")
    names(told(*site.options, *other), "do not belong together", "daemon.key")
    user = f"--certificate={site.folder / 'logins' / 'frank.pem'}"
    key = f"--key={site.folder / 'logins' / 'frank.pem'}"
    names(told("--address=0.0.0.0:0", user, key), "subjectAltName", "remote web")
    old = site.folder.parent / "old" / "old.pem"
    names(told("--address=0.0.0.0:0", f"--certificate={old}", f"--key={old}"), "expired")
    names(told("--address", "192.0.2.1:0", *site.options), "192.0.2.1")
    names(told("--address", "cell4", status=2), "cell4", "ADDRESS")
    names(told("--address", "127.0.0.1:1", "--port", "2", status=2), "twice")
    names(told("run.mcap", "--address", "0.0.0.0", status=2), "run.mcap", "loopback")
    login = site.folder / "logins" / "anna.pem"
    found = run_module(
        "ecatd.cli", "--connect", site.gateway, "--identity", str(login), "info", env={}
    )
    assert found.returncode == 2
    names(found.stderr, "ecatctl web", "remote user anna")


def test_the_login_in_a_browser(site: Site, web: Web) -> None:
    sync_api = pytest.importorskip("playwright.sync_api", reason="needs the package playwright")
    if (chromium := shutil.which("chromium")) is None or not AXE.exists():
        pytest.skip("needs chromium, and axe-core of web/node_modules")
    sync_api.expect.set_options(timeout=1000 * PATIENCE)
    expect = sync_api.expect
    public = openssl("x509", "-in", site.folder / "web.pem", "-noout", "-pubkey")
    key = base64.b64decode("".join(public.splitlines()[1:-1]))
    pin = base64.b64encode(hashlib.sha256(key).digest()).decode()
    trust = f"--ignore-certificate-errors-spki-list={pin}"  # the key of this server, and no other
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox", trust])
        context = browser.new_context(viewport={"width": 1024, "height": 768}, bypass_csp=False)
        page = context.new_page()
        broken: list[str] = []
        page.on("pageerror", lambda error: broken.append(str(error)))
        page.on(
            "console", lambda said: "Content Security" in said.text and broken.append(said.text)
        )
        page.goto(f"https://{web.host}/?bus={site.daemon.bus}#tab=events")
        user, secret = page.get_by_label("User"), page.get_by_label("Password")
        expect(user).to_be_focused()
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme=scheme)
            # Of the tool, not of the page: it may run here although the page forbids such code.
            page.evaluate(f"() => {{ {AXE.read_text()} }}")
            found = page.evaluate("axe.run().then(({ violations }) => violations.map((v) => v.id))")
            assert found == [], scheme
        user.fill("bob")
        secret.fill("wrong password")
        page.keyboard.press("Enter")
        expect(page.get_by_role("alert")).to_have_text("User and password do not fit.")
        expect(secret).to_be_focused()
        secret.fill(password("bob"))
        page.get_by_role("button", name="Log in").click()
        expect(page.locator(".lamp")).to_have_count(7)
        expect(page.locator(".title-line")).to_contain_text("read only")
        expect(page.locator(".title-line")).to_contain_text("bob")
        assert "tab=events" in page.evaluate("location.hash")
        (cookie,) = context.cookies()
        assert cookie["name"] == f"__Host-ecatd-{web.port}"
        assert (cookie["secure"], cookie["httpOnly"], cookie["sameSite"]) == (True, True, "Strict")
        assert page.evaluate("document.cookie") == ""
        page.reload()  # the cookie is enough
        expect(page.locator(".lamp")).to_have_count(7)
        page.get_by_role("button", name="Log out").click()
        expect(user).to_be_visible()
        assert context.cookies() == []
        user.fill("carl")
        secret.fill(password("carl"))
        page.keyboard.press("Enter")
        expect(page.locator(".way")).to_contain_text("does not name this user")
        browser.close()
        assert broken == []
