"""Several machines at a Zenoh router, each a network namespace with a `/dev/shm` of its own.

The machines `cell4` and `cell5` have a bus of the same name. `hub` is the router, with the settings
that `ecatctl remote router` has made. Users are at `office`.
"""

from __future__ import annotations

import ctypes
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from following import Following
from test_remote_users import expired_identity

from conftest import Daemon, names, one_line_error, run_module, wait_for
from ecatd.client.identity import read_identity

pytestmark = [
    pytest.mark.bus,
    pytest.mark.long,
    pytest.mark.skipif(os.geteuid() != 0, reason="root connects namespaces"),
    pytest.mark.skipif(shutil.which("ip") is None, reason="ip (iproute2) connects namespaces"),
    pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl makes the certificates"),
]

HUB = "10.77.0.1"
PORT = 7447
BUS = "ecat0"
NEW_MOUNTS, NEW_NETWORK = 0x00020000, 0x40000000
USERS = {"anna": 'write = ["sdo"]', "bob": ""}
CONFIG = """\
[gateway]
host = "{host}"
listen = []
connect = ["tls/{hub}:{port}"]
router_names = ["hub"]
certificate = "{folder}/daemon.pem"
key = "{folder}/daemon.key"
users_ca = "{folder}/authority.pem"
"""
ROUTER = """
import sys, time, zenoh
session = zenoh.open(zenoh.Config.from_file(sys.argv[1]))
print("ready", flush=True)
while True:
    time.sleep(3600)
"""
FORGER = """
import json, sys, time, zenoh
from pathlib import Path
from ecatd.client.identity import read_identity
from ecatd.operations.zenoh_keys import session_config
endpoint, tls = sys.argv[1], json.loads(sys.argv[2])
session = zenoh.open(session_config("client", {"connect/endpoints": [endpoint], **tls}))
for key in ("ro/event", "ro/pdo/0/0x6041:00", "ro/info", "alive"):
    session.put(f"ecat/v1/cell4:ecat0/{key}", b"forged")
    session.delete(f"ecat/v1/cell4:ecat0/{key}")
def answer(query):
    query.reply(query.key_expr, b"forged")
answering = session.declare_queryable("ecat/v1/cell4:ecat0/**", answer)
tokens = [
    session.liveliness().declare_token(f"ecat/v1/{bus}/alive") for bus in ("cell9:ecat0", "ecat0")
]
print("done", flush=True)
sys.stdin.read()
"""
LISTENER = """
import json, sys, zenoh
from ecatd.operations.zenoh_keys import session_config
endpoint, tls = sys.argv[1], json.loads(sys.argv[2])
session = zenoh.open(session_config("client", {"connect/endpoints": [endpoint], **tls}))
def tell(sample):
    is_forged = bytes(sample.payload) == b"forged"
    print("forged" if is_forged else sample.key_expr, sample.kind, flush=True)
session.declare_subscriber("ecat/v1/*/ro/**", tell)
print("ready", flush=True)
sys.stdin.read()
"""


class Host:
    """A machine: a network of its own, and a `/dev/shm` of its own."""

    def __init__(self, name: str) -> None:
        self.name = name
        script = "mount -t tmpfs none /dev/shm && ip link set lo up && echo ready && exec sleep inf"
        self._holder = subprocess.Popen(
            ["unshare", "--net", "--mount", "sh", "-ec", script], stdout=subprocess.PIPE, text=True
        )
        assert self._holder.stdout is not None
        assert self._holder.stdout.readline() == "ready\n"
        self.pid = self._holder.pid

    def enter(self) -> None:
        """Moves this process there; for `preexec_fn`."""
        libc = ctypes.CDLL(None, use_errno=True)
        for kind, flag in (("net", NEW_NETWORK), ("mnt", NEW_MOUNTS)):
            descriptor = os.open(f"/proc/{self.pid}/ns/{kind}", os.O_RDONLY)
            assert libc.setns(descriptor, flag) == 0, os.strerror(ctypes.get_errno())
            os.close(descriptor)

    def ip(self, *arguments: str) -> None:
        command = ["nsenter", "-t", str(self.pid), "-n", "ip", *arguments]
        subprocess.run(command, check=True)

    def python(self, code: str, *arguments: object) -> subprocess.Popen[str]:
        """Starts a program there, and waits for its first line."""
        process = subprocess.Popen(
            [sys.executable, "-c", code, *map(str, arguments)],
            preexec_fn=self.enter,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert process.stdout is not None
        assert process.stdout.readline() in ("ready\n", "done\n")
        return process

    def close(self) -> None:
        end(self._holder)


def end(process: subprocess.Popen[str]) -> None:
    """Kills a program, and closes its pipes."""
    process.kill()
    process.communicate()


def connect(hub: Host, host: Host, number: int) -> None:
    """Puts a cable between a host and the hub, which has its own address behind it."""
    link = f"h{number}"
    hub.ip("link", "add", link, "type", "veth", "peer", "name", "eth0", "netns", str(host.pid))
    hub.ip("addr", "add", f"10.77.{number}.1/24", "dev", link)
    hub.ip("link", "set", link, "up")
    host.ip("addr", "add", f"10.77.{number}.2/24", "dev", "eth0")
    host.ip("link", "set", "eth0", "up")
    host.ip("route", "add", "default", "via", f"10.77.{number}.1")


class Plant:
    """The machines, the router, and what the users have."""

    def __init__(self, folder: Path, start: Callable[..., Daemon]) -> None:
        self.folder = folder
        self._start = start
        self.hosts = {name: Host(name) for name in ("hub", "cell4", "cell5", "office")}
        self.hub = self.hosts["hub"]
        self.hub.ip("addr", "add", f"{HUB}/32", "dev", "lo")
        for number, name in enumerate(("cell4", "cell5", "office"), 1):
            connect(self.hub, self.hosts[name], number)
        authority = ("--dir", str(folder / "tls"))
        make("init", *authority)
        for cell in ("cell4", "cell5"):
            make("machine", cell, *authority, "-o", str(folder / cell))
        for user in (*USERS, "eve"):
            make("user", user, *authority, "-o", str(self.identity(user)))
        allowed = [f"--user={user}" for user in USERS]
        cells = ("--machine=cell4", "--machine=cell5")
        out = ("-o", str(folder / "hub"))
        make("router", "hub", "--host", HUB, *cells, *allowed, *authority, *out)
        self.start_router()
        self.daemons: dict[str, Daemon] = {}
        for cell in ("cell4", "cell5"):
            self.start_daemon(cell)
        wait_for(lambda: len(self.buses()) == 2, self.daemons["cell4"])

    def _config(self, cell: str) -> str:
        folder = self.folder / cell
        config = CONFIG.format(host=cell, hub=HUB, port=PORT, folder=folder)
        for user, rights in USERS.items():
            config += f'[[gateway.user]]\nname = "{user}"\n{rights if cell == "cell4" else ""}\n'
        return config

    def without_the_name_of_the_router(self, cell: str) -> Daemon:
        """Another bus of a machine, whose configuration does not say how the router is called."""
        config = self._config(cell).replace('router_names = ["hub"]', "")
        return self._start(
            *("line:1", "--bus", "odd"), config=config, preexec=self.hosts[cell].enter
        )

    def start_daemon(self, cell: str) -> None:
        self.daemons[cell] = self._start(
            *("troll", "--bus", BUS), config=self._config(cell), preexec=self.hosts[cell].enter
        )

    def start_router(self) -> None:
        self.router = self.hub.python(ROUTER, self.folder / "hub" / "zenohd.json5")

    def identity(self, user: str) -> Path:
        return self.folder / f"{user}.pem"

    @property
    def endpoint(self) -> str:
        return f"tls/{HUB}:{PORT}"

    def where(self, user: str, bus: str) -> tuple[str, ...]:
        """Options of `ecatctl` at the office."""
        return ("--connect", self.endpoint, "--identity", str(self.identity(user)), "--bus", bus)

    def ctl(self, user: str, bus: str, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Runs `ecatctl` at the office."""
        return subprocess.run(
            [sys.executable, "-m", "ecatd.cli", *self.where(user, bus), *arguments],
            preexec_fn=self.hosts["office"].enter,
            capture_output=True,
            text=True,
            check=False,
        )

    def local(self, cell: str, *arguments: str) -> dict[str, Any]:
        """Runs `ecatctl` on a machine, and returns its document."""
        found = subprocess.run(
            [sys.executable, "-m", "ecatd.cli", "--bus", BUS, *arguments, "--json"],
            preexec_fn=self.hosts[cell].enter,
            env=self.daemons[cell].env,
            capture_output=True,
            text=True,
            check=False,
        )
        assert found.returncode == 0, found
        document: dict[str, Any] = json.loads(found.stdout)
        return document

    def buses(self, *, silent: bool = False) -> list[str]:
        """The buses that answer, or also those that the router only believes to be there."""
        found = self.ctl("bob", f"cell4/{BUS}", "buses", "--json", "--timeout", "5")
        rows = json.loads(found.stdout).get("buses", ())
        return [row["bus"] for row in rows if silent or "error" not in row]

    def program(self, host: str, code: str, tls: dict[str, Any]) -> subprocess.Popen[str]:
        return self.hosts[host].python(code, self.endpoint, json.dumps(tls))

    def close(self) -> None:
        end(self.router)
        for host in self.hosts.values():
            host.close()


class Followers:
    """Commands at the office that follow a bus."""

    def __init__(self, plant: Plant, cell: str) -> None:
        self._plant, self._cell = plant, cell
        where = (*plant.where("bob", f"{cell}/{BUS}"), "--timeout", "5")
        enter = plant.hosts["office"].enter
        self.watch = Following(*where, "watch", "2/*", "--hz", "5", preexec=enter)
        self.events = Following(*where, "events", "-f", preexec=enter)
        self._told = dict.fromkeys((self.watch, self.events), 0)

    def wait_until_cut_off(self) -> None:
        """Waits until both have said once more that they wait."""
        for item, told in self._told.items():
            while item.said.count("waiting for it") <= told:
                assert item.documents
                time.sleep(0.02)

    def wait_until_they_go_on(self) -> None:
        """Waits until both have shown something new."""
        daemon = self._plant.daemons[self._cell]
        rows, events = len(self.watch.documents), len(self.events.documents)
        for level in ("debug", "info"):  # each is an event
            self._plant.local(self._cell, "log-level", "dc", level)
        wait_for(lambda: len(self.watch.documents) > rows, daemon)
        wait_for(lambda: len(self.events.documents) > events, daemon)
        self._told = {item: item.said.count("waiting for it") for item in self._told}

    def close(self) -> None:
        self.watch.close()
        self.events.close()


def make(*arguments: str) -> None:
    made = run_module("ecatd.cli", "remote", *arguments)
    assert made.returncode == 0, made.stderr


@pytest.fixture(scope="module")
def plant(
    tmp_path_factory: pytest.TempPathFactory, start_shared: Callable[..., Daemon]
) -> Iterator[Plant]:
    plant = Plant(tmp_path_factory.mktemp("plant"), start_shared)
    yield plant
    for daemon in plant.daemons.values():
        assert daemon.stop() == 0
    plant.close()


def test_the_buses_of_all_machines_are_found_and_read(plant: Plant) -> None:
    assert plant.buses() == ["cell4/ecat0", "cell5/ecat0"]
    for cell in ("cell4", "cell5"):
        found = plant.ctl("bob", f"{cell}/{BUS}", "slaves", "--json")
        assert len(json.loads(found.stdout)["slaves"]) == 8
        read = plant.ctl("bob", f"{cell}/{BUS}", "sdo-read", "0", "0x1018", "1", "--json")
        assert json.loads(read.stdout)["value"] == 0x9A
        watched = plant.ctl("bob", f"{cell}/{BUS}", "watch", "0/*", "--count", "2", "--json")
        assert watched.returncode == 0, watched.stderr
        assert len(watched.stdout.splitlines()) == 2
        names(plant.daemons[cell].log, "connected", plant.endpoint)
    wrong = plant.ctl("bob", BUS, "slaves")
    assert wrong.returncode == 3
    names(one_line_error(wrong.stderr, "ecatctl"), "'ecat0'", "cell4/ecat0", "cell5/ecat0")
    assert len(plant.local("cell4", "slaves")["slaves"]) == 8


def test_users_change_what_each_machine_says(plant: Plant) -> None:
    write = ("sdo-write", "0", "0x6083", "0", "1234")
    done = plant.ctl("anna", f"cell4/{BUS}", *write)
    assert done.returncode == 0, done.stderr
    names(plant.daemons["cell4"].log, "0x6083:00", "user 'anna'")
    for user, cell in (("anna", "cell5"), ("bob", "cell4")):
        denied = plant.ctl(user, f"{cell}/{BUS}", *write)
        assert denied.returncode == 6, denied
        names(one_line_error(denied.stderr, "ecatctl"), f"'{user}'", "'sdo'")
    for daemon in plant.daemons.values():
        assert daemon.log.count("0x6083:00") == ("cell4" in daemon.config_file.read_text())


def test_nobody_can_speak_for_another_machine(plant: Plant) -> None:
    """A user, another machine, and somebody whom the router does not know try it."""
    as_user = {
        name: read_identity(plant.identity(name)).settings for name in ("anna", "bob", "eve")
    }
    tls = "transport/link/tls"
    as_cell5 = {
        f"{tls}/connect_certificate": str(plant.folder / "cell5" / "daemon.pem"),
        f"{tls}/connect_private_key": str(plant.folder / "cell5" / "daemon.key"),
        f"{tls}/root_ca_certificate": str(plant.folder / "cell5" / "authority.pem"),
        f"{tls}/enable_mtls": True,
    }
    listener = plant.program("office", LISTENER, as_user["bob"])
    forgers = [
        plant.program("office", FORGER, as_user["anna"]),
        plant.program("office", FORGER, as_user["eve"]),
        plant.program("cell5", FORGER, as_cell5),
    ]
    try:
        time.sleep(0.5)  # what is forged would have the time to arrive
        assert plant.buses() == ["cell4/ecat0", "cell5/ecat0"]
        info = plant.ctl("bob", f"cell4/{BUS}", "info", "--json")
        assert json.loads(info.stdout)["slaves"]["found"] == 8
        plant.local("cell4", "log-level", "dc", "debug")  # which is an event
        plant.local("cell4", "log-level", "dc", "info")
        heard: list[str] = []
        assert listener.stdout is not None
        while not any("cell4:ecat0/ro/event" in line for line in heard):
            heard.append(listener.stdout.readline())
        assert all("forged" not in line and "DELETE" not in line for line in heard), heard
    finally:
        for process in (*forgers, listener):
            end(process)


def test_whom_the_router_does_not_know_gets_nothing(plant: Plant) -> None:
    denied = plant.ctl("eve", f"cell4/{BUS}", "slaves", "--timeout", "5")
    assert denied.returncode == 6, denied
    names(one_line_error(denied.stderr, "ecatctl"), "'eve'", "[[gateway.user]]")


def test_a_router_with_another_name_in_its_certificate_is_told(plant: Plant) -> None:
    odd = plant.without_the_name_of_the_router("cell5")
    try:
        wait_for(lambda: "router_names" in odd.log, odd)
        names(odd.log, plant.endpoint, "'hub'", 'router_names = ["hub"]')
    finally:
        odd.close()
    assert "router_names" not in plant.daemons["cell5"].log


def test_an_expired_certificate_is_not_let_in(plant: Plant, tmp_path: Path) -> None:
    old = expired_identity(plant.folder / "tls", tmp_path)
    old.rename(plant.identity("old"))
    denied = plant.ctl("old", f"cell4/{BUS}", "slaves", "--timeout", "2")
    assert denied.returncode == 6, denied
    names(one_line_error(denied.stderr, "ecatctl"), plant.endpoint, "certificate", "expired")


@pytest.fixture(scope="module")
def followers(plant: Plant) -> Iterator[Followers]:
    """Commands that follow `cell4` from before its faults until after the last one."""
    followers = Followers(plant, "cell4")
    followers.wait_until_they_go_on()
    yield followers
    followers.close()


def test_a_cable_that_is_cut_and_mended(plant: Plant, followers: Followers) -> None:
    cycles = plant.local("cell4", "stats")["cycles"]
    plant.hub.ip("link", "set", "h1", "down")
    lost = plant.ctl("bob", f"cell4/{BUS}", "info", "--timeout", "1")
    assert lost.returncode != 0
    one_line_error(lost.stderr, "ecatctl")
    assert plant.ctl("bob", f"cell5/{BUS}", "info").returncode == 0
    followers.wait_until_cut_off()
    given_up = ["cell5/ecat0"]
    wait_for(lambda: plant.buses(silent=True) == given_up, plant.daemons["cell4"])
    plant.hub.ip("link", "set", "h1", "up")
    plant.hub.ip("route", "replace", "10.77.1.0/24", "dev", "h1")
    wait_for(lambda: plant.buses() == ["cell4/ecat0", "cell5/ecat0"], plant.daemons["cell4"])
    assert plant.local("cell4", "stats")["cycles"] > cycles
    followers.wait_until_they_go_on()


def test_a_router_that_is_killed_and_comes_back(plant: Plant, followers: Followers) -> None:
    daemon = plant.daemons["cell5"]
    end(plant.router)
    wait_for(lambda: "no router is reached" in daemon.log, daemon)
    gone = plant.ctl("bob", f"cell5/{BUS}", "info", "--timeout", "2")
    assert gone.returncode == 3
    names(one_line_error(gone.stderr, "ecatctl"), plant.endpoint)
    followers.wait_until_cut_off()
    plant.start_router()
    wait_for(lambda: plant.buses() == ["cell4/ecat0", "cell5/ecat0"], daemon)
    wait_for(lambda: daemon.log.count("connected to") == 2, daemon)
    assert {row["text"] for row in plant.local("cell5", "state")["slaves"]} == {"OP"}
    followers.wait_until_they_go_on()


def test_a_daemon_that_is_killed_and_comes_back(plant: Plant, followers: Followers) -> None:
    plant.daemons["cell4"].kill_all()
    followers.wait_until_cut_off()
    plant.start_daemon("cell4")
    followers.wait_until_they_go_on()
    names(followers.events.said, "started again", f"'cell4/{BUS}'")
    instance = plant.local("cell4", "stats")["instance"]
    shown = followers.events.documents
    new = [item["sequence"] for item in shown if item["instance"] == instance]
    assert new == [*range(1, len(new) + 1)]
