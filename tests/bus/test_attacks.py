"""SECURITY.md says what attackers achieve over Zenoh; each of them tries it at a real gateway.

An attacker is a process (`attacker.py`). Others use the bus meanwhile: they look for what is
forged, and read what may have been changed.
"""

import itertools
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import zenoh
from attacker import FORGED
from test_remote_users import Site, remote_command
from test_router import HUB, PORT, Host, connect, end

from conftest import Daemon, free_port
from ecatd.client.identity import read_identity
from ecatd.operations.encoding import pack, unpack
from ecatd.operations.zenoh_keys import bus_key, session_config

pytestmark = [
    pytest.mark.bus,
    pytest.mark.unprivileged,
    pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl makes the certificates"),
]

PAGE = Path(__file__).parents[2] / "SECURITY.md"
NOTHING, NOT_LET_IN = "–", "not let in"
AUTHORITY = "transport/link/tls/root_ca_certificate_base64"
RIG = str(Path(__file__).parents[1] / "rigs" / "drives.py")
OBJECTS = ("0/0x6083/0x00", "1/0x6083/0x00")
"""An object of the slave that anna may change, and of another one."""
NUMBERS = itertools.count()
NAMES = {"unknown user": "carl", "user without rights": "bob", "user of other slaves": "anna"}
AT_THE_SITE = ["loopback", "no certificate", "other authority", *NAMES, "member of the group"]


def table() -> dict[str, dict[str, str]]:
    """The table of the page: for each attempt, its result for each attacker."""
    text = PAGE.read_text().split("## What an attacker achieves over Zenoh", 1)[1]
    head, _, *rows = (
        [cell.strip() for cell in line.strip("|").split(" | ")]
        for line in re.findall(r"^\|.*\|$", text.split("\n## ")[0], re.MULTILINE)
    )
    return {row[0]: dict(zip(head[1:], row[1:], strict=True)) for row in rows}


@dataclass
class Bus:
    """A bus, and others that use it.

    Attributes:
        daemon: Its daemon.
        users: Sessions of users of other machines.
        told: What the member of the group has heard from the daemon.
    """

    daemon: Daemon
    users: dict[str, zenoh.Session] = field(default_factory=dict)
    told: list[zenoh.Sample] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.member = zenoh.open(session_config("client", member(self.daemon)))
        self.member.declare_subscriber(self.key("ro/**"), self.told.append)
        self.member.liveliness().declare_subscriber("ecat/v1/*/alive", self.told.append)

    def key(self, key: str) -> str:
        return bus_key(self.daemon.bus, *key.split("/"))

    def ask(self, key: str, payload: bytes | None = None, user: str = "") -> dict[str, Any]:
        """Asks as a member of the group or as a user of another machine.

        Each of them must get one answer, from the daemon.
        """
        session = self.users[user] if user else self.member
        (reply,) = session.get(self.key(key), payload=payload, timeout=60.0)
        assert reply.ok is not None, bytes(reply.err.payload)
        return unpack(bytes(reply.ok.payload))

    def state(self) -> list[object]:
        """What attackers try to change."""
        values = [self.ask(f"ro/sdo/{where}")["data"] for where in OBJECTS]
        return [*values, self.ask("ro/log")["levels"]]

    def restore(self, state: Sequence[Any]) -> None:
        for where, data in zip(OBJECTS, state, strict=False):
            self.ask(f"rw/sdo/{where}", change(data=data))
        self.ask("rw/log/dc", change(level=state[-1]["dc"]))

    def use(self) -> list[str]:
        """All do what they may; returns what they were told that does not come from the daemon."""
        wrong = []
        asked = [("", "ro/info", None), ("", "rw/log/dc", change(level="info"))]
        for user in self.users:
            asked += [(user, "ro/info", None), (user, f"as/{user}/ro/rights", None)]
        if "anna" in self.users:
            asked.append(("anna", "as/anna/rw/log/dc", change(level="info")))
        for user, key, payload in asked:
            session = self.users[user] if user else self.member
            replies = [*session.get(self.key(key), payload=payload, timeout=60.0)]
            datas = [bytes(reply.ok.payload) if reply.ok else b"refused" for reply in replies]
            if len(datas) != 1 or FORGED in datas or b"refused" in datas:
                wrong.append(f"{user or 'member'} at {key}: {datas}")
        alive = [
            str(reply.ok.key_expr) for reply in self.member.liveliness().get("ecat/v1/*/alive")
        ]
        if alive != [self.key("alive")]:
            wrong.append(f"alive: {alive}")
        wrong += [
            f"told {sample.kind} {sample.key_expr}"
            for sample in self.told
            if bytes(sample.payload) == FORGED
            or sample.kind != zenoh.SampleKind.PUT
            or not str(sample.key_expr).startswith(self.key(""))
        ]
        self.told.clear()
        return wrong


def change(**values: object) -> bytes:
    """The payload of a change, with an id of its own."""
    return pack({"id": f"test {next(NUMBERS)}", **values})


def member(daemon: Daemon) -> dict[str, Any]:
    """Settings of a member of the group on the machine of the daemon."""
    path = f"{daemon.env['ECATD_RUNTIME_DIR']}/{daemon.bus}/gateway/zenoh"
    return {"connect/endpoints": [f"unixsock-stream/{path}"]}


class Attack:
    """An attacker who has begun, and what the page says about him.

    Args:
        bus: The bus.
        settings: His settings for Zenoh.
        me: The name that he has, or claims to have.
        says: For each attempt, the result that the page gives.
        preexec: Moves his process to his machine.
    """

    def __init__(
        self,
        bus: Bus,
        settings: dict[str, Any],
        me: str,
        says: dict[str, str],
        preexec: Callable[[], None] | None,
    ) -> None:
        self.bus, self.me, self._says = bus, me, says
        self.process = subprocess.Popen(
            [sys.executable, str(Path(__file__).with_name("attacker.py")), json.dumps(settings)],
            preexec_fn=preexec,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.is_let_in = self._read()

    def _read(self) -> Any:
        assert self.process.stdout is not None
        return json.loads(self.process.stdout.readline())

    def do(
        self, verb: str, keys: Sequence[str], payload: bytes | None = None, seconds: float = 1.0
    ) -> Any:
        assert self.process.stdin is not None
        text = None if payload is None else payload.hex()
        self.process.stdin.write(json.dumps([verb, keys, text, seconds]) + "\n")
        self.process.stdin.flush()
        return self._read()

    def attempt(self, what: str) -> str:
        """Tries one line of the table, and returns the result."""
        verb, keys, payload = ATTEMPTS[what]
        other = "bob" if self.me == "anna" else "anna"
        whole = [
            key if key.startswith(("@", "ecat/")) else self.bus.key(key)
            for key in (key.format(me=self.me, other=other) for key in keys)
        ]
        # What must come about has the time for it on a busy machine.
        seconds = 1.0 if self._says[what] == NOTHING else 60.0
        before = self.bus.state()
        if payload == "data":
            data = before[OBJECTS[1] in whole[0]]
            assert isinstance(data, bytes)
            content: bytes | None = change(data=bytes([data[0] ^ 1]) + data[1:])
        else:
            content = change(level="debug") if payload == "level" else None
        found = self.do(verb, whole, content, seconds)
        results = {*(found or ())} - {NOTHING}
        if found is None:
            # When this is answered, the gateway has seen what came before it.
            can_read = self._says[next(iter(ATTEMPTS))] != NOTHING
            self.do("query", [self.bus.key("ro/config")], None, 60.0 if can_read else 1.0)
            if verb == "listen":
                self.bus.ask("rw/log/dc", change(level="debug"))  # which is an event
                self.bus.restore(before)
            results |= {f"forges: {text}" for text in self.bus.use()}
            wait = seconds if verb == "listen" else 0.0
            results |= {"hears" for _ in self.do("end", [], None, wait)}
            results |= {f"forges: {text}" for text in self.bus.use()}
        if self.bus.state() != before:
            results = {"changes"}
            self.bus.restore(before)
        return ", ".join(sorted(results)) or NOTHING


SDO, OTHER_SDO = (f"rw/sdo/{where}" for where in OBJECTS)
SAYS = (
    "ro/info",
    "ro/event",
    "ro/log/lines",
    "ro/pdo/0/0x6041:00",
    "alive",
    "ecat/v1/forged/ro/info",
)
CHANGES = (SDO, f"as/{{me}}/{SDO}", f"as/{{other}}/{SDO}")
WILD = ("ro/**", "rw/**", "as/*/**", "as/{me}/**", "**", "ecat/v1/**", "ecat/**")
ATTEMPTS: dict[str, tuple[str, Sequence[str], str]] = {
    "query `ro/info`, `ro/slaves`, `ro/stats`": ("query", ("ro/info", "ro/slaves", "ro/stats"), ""),
    "ask who is alive": ("alive", ("alive", "ecat/v1/*/alive"), ""),
    "subscribe to `ro/**`": ("listen", ("ro/**",), ""),
    "query `ro/info` with a payload": ("query", ("ro/info",), "data"),
    "query `ro/*`, `ro/**`": ("query", ("ro/*", "ro/**"), ""),
    "change an object: query `rw/sdo/…` with a payload": ("query", (SDO,), "data"),
    "query `rw/…` without a payload": ("query", (SDO, "rw/log/dc"), ""),
    "query `rw/**`, `rw/*/dc` with a payload": ("query", ("rw/**", "rw/*/dc"), "level"),
    "change slave 0 under one's own name: `as/NAME/rw/sdo/0/…`": (
        "query",
        (f"as/{{me}}/{SDO}",),
        "data",
    ),
    "change slave 1 under one's own name": ("query", (f"as/{{me}}/{OTHER_SDO}",), "data"),
    "change slave 0 under the name of another user": ("query", (f"as/{{other}}/{SDO}",), "data"),
    "query `as/*/rw/sdo/…`, `as/**` with a payload": ("query", (f"as/*/{SDO}", "as/**"), "data"),
    "query `as/…` without a payload": ("query", ("as/{other}/ro/rights", "as/*/ro/rights"), ""),
    "query `rw/log/…` of all buses, `**`, and `@/**` (Zenoh itself)": (
        "query",
        ("ecat/v1/*/rw/log/dc", "ecat/**", "**", "@/**", "@/*/peer/config/**"),
        "level",
    ),
    "put to `ro/…`, `alive`, another bus": ("put", SAYS, ""),
    "put to `rw/…`, `as/…`": ("put", CHANGES, ""),
    "put to `ro/**`, `rw/**`, `as/*/**`, `**`": ("put", WILD, ""),
    "put to `@/…` (Zenoh's configuration)": (
        "put",
        ("@/*/peer/config/access_control/enabled", "@/**"),
        "",
    ),
    "delete `ro/…`, `alive`, another bus": ("delete", SAYS, ""),
    "delete `rw/…`, `as/…`": ("delete", CHANGES, ""),
    "delete `ro/**`, `rw/**`, `as/*/**`, `**`": ("delete", WILD, ""),
    "answer or see queries at `ro/…`, `**`": ("answer", ("ro/info", "ro/**", "**", "ecat/**"), ""),
    "answer or see queries at `rw/…`": ("answer", ("rw/log/dc", "rw/**"), ""),
    "answer or see queries at `as/…`": (
        "answer",
        ("as/{other}/**", "as/{me}/**", "as/{other}/rw/log/dc", "as/**"),
        "",
    ),
    "be alive as this bus or another one": ("live", ("alive", "ecat/v1/forged/alive"), ""),
    "subscribe to `rw/**`, `as/**`, `**`": (
        "listen",
        ("rw/**", "as/**", "as/{me}/**", "as/{other}/**", "**", "ecat/**"),
        "",
    ),
}
"""For each line of the table: the verb of the attacker, the keys, and what the payload changes."""


@pytest.fixture(scope="module")
def port() -> int:
    return free_port()


@pytest.fixture(scope="module")
def site(
    tmp_path_factory: pytest.TempPathFactory, start_shared: Callable[..., Daemon], port: int
) -> Site:
    def start(_rig: str, config: str) -> Daemon:
        plain = f'listen = ["tcp/127.0.0.1:{port}", '
        return start_shared(RIG, config=config.replace("listen = [", plain))

    return Site(tmp_path_factory.mktemp("site"), start)


@pytest.fixture(scope="module")
def bus(site: Site) -> Iterator[Bus]:
    with ExitStack() as stack:
        users = {name: stack.enter_context(site.session(name)) for name in ("anna", "bob")}
        bus = Bus(site.daemon, users)
        stack.enter_context(bus.member)
        yield bus


@pytest.fixture
def settings(site: Site, port: int, tmp_path: Path) -> Callable[[str], dict[str, Any]]:
    """Makes the settings for Zenoh of an attacker at the site."""

    def make(who: str) -> dict[str, Any]:
        if who == "loopback":
            return {"connect/endpoints": [f"tcp/127.0.0.1:{port}"]}
        if who == "member of the group":
            return member(site.daemon)
        endpoint = {"connect/endpoints": [site.endpoint]}
        mine = read_identity(site[NAMES.get(who, "anna")]).settings
        if who == "no certificate":
            return {**endpoint, AUTHORITY: mine[AUTHORITY]}
        if who == "other authority":
            other = tmp_path / "other"
            forged = tmp_path / "anna.pem"
            for made in (
                remote_command("init", "--dir", str(other)),
                remote_command("user", "anna", "--dir", str(other), "-o", str(forged)),
            ):
                assert made.returncode == 0, made.stderr
            # He trusts the daemon, which does not trust him.
            trusted = {AUTHORITY: mine[AUTHORITY]}
            return {**endpoint, **read_identity(forged).settings, **trusted}
        return {**endpoint, **mine}

    return make


def achieved(
    who: str, bus: Bus, settings: dict[str, Any], preexec: Callable[[], None] | None = None
) -> None:
    """Compares what an attacker achieves with the column of the table."""
    says = {what: row[who] for what, row in table().items()}
    assert [*says] == [*ATTEMPTS]
    attack = Attack(bus, settings, NAMES.get(who, "carl"), says, preexec)
    try:
        found = {
            what: attack.attempt(what) if attack.is_let_in else NOT_LET_IN for what in ATTEMPTS
        }
    finally:
        end(attack.process)
    assert found == says
    assert "defect" not in bus.daemon.log


def test_the_table_has_all_attackers() -> None:
    (whole,) = {tuple(row) for row in table().values()}
    assert {*whole} == {*AT_THE_SITE, "network"}


@pytest.mark.parametrize("who", AT_THE_SITE)
def test_r36_what_an_attacker_achieves(
    who: str, bus: Bus, settings: Callable[[str], dict[str, Any]]
) -> None:
    achieved(who, bus, settings(who))


@pytest.mark.long
@pytest.mark.skipif(os.geteuid() != 0, reason="root connects namespaces")
@pytest.mark.skipif(shutil.which("ip") is None, reason="ip (iproute2) connects namespaces")
def test_r36_what_an_attacker_in_the_network_achieves(start_daemon: Callable[..., Daemon]) -> None:
    """Without `anonymous_reading`, the daemon listens at no plain address of the network."""
    with ExitStack() as stack:
        machine, elsewhere = Host("machine"), Host("elsewhere")
        stack.callback(machine.close)
        stack.callback(elsewhere.close)
        machine.ip("addr", "add", f"{HUB}/32", "dev", "lo")
        connect(machine, elsewhere, 1)
        listen = f'[gateway]\nlisten = ["tcp/10.77.1.1:{PORT}"]\nanonymous_reading = true\n'
        bus = Bus(start_daemon(RIG, config=listen, preexec=machine.enter))
        stack.enter_context(bus.member)
        there = {"connect/endpoints": [f"tcp/10.77.1.1:{PORT}"]}
        achieved("network", bus, there, elsewhere.enter)
